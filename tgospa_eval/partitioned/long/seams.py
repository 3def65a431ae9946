"""Seams that keep a bracket open, and windows around them."""

import numpy as np

from tgospa_eval.partitioned.long.component import Joined, Long
from tgospa_eval.partitioned.long.plan import Plan
from tgospa_eval.partitioned.long.tables import Piece
from tgospa_eval.partitioned.long.windows import Window, pieces_of

OPEN_FROM = 0.1
"""A seam is open where more is lost than this share of its part of the gap allowed."""


def repairs(
    component: Long, plan: Plan, joined: Joined, overlap: int, number: int
) -> tuple[list[Window], tuple[Piece, ...]]:
    """Windows around the open seams, and the pieces once these are solved.

    Parameters
    ----------
    component, plan
        What is solved.
    joined : Joined
        What is proven so far.
    overlap : int
        Steps on either side of a seam that are solved again, and as many beyond these.
    number : int
        Which round it is.
    """
    middles = _middles(component, plan, joined, 2 * overlap)
    windows = []
    for index, middle in enumerate(middles):
        around = plan.around(*middle, 2 * overlap, component.together // 4)
        windows.append(
            Window(
                output=f"{component.work}/round-{number}/repairs/{index:06d}",
                entries=plan.between(*around),
                around=around,
                core=middle,
                parameters=component.parameters,
                truth_bounds=plan.truth_bounds,
                estimate_bounds=plan.estimate_bounds,
                gap=0.25 * component.gap,
                near=tuple(p for p in joined.pieces if p.low < around[1] and p.high > around[0]),
            )
        )
    return windows, _replaced(joined.pieces, windows)


def _middles(component: Long, plan: Plan, joined: Joined, overlap: int) -> list[tuple[int, int]]:
    """Stretches around the open seams; neighbours are one as long as they are small enough."""
    seams = [piece.low for piece in joined.pieces[1:]]
    share = joined.share
    allowed = OPEN_FROM * component.gap * share.upper / max(len(seams), 1)
    lost = np.concatenate(([0.0], np.cumsum(joined.lost)))
    regret, begin, end = joined.regret
    middles: list[tuple[int, int]] = []
    for seam in seams:
        low, high = plan.around(seam, seam, overlap, component.together // 8)
        left = float(lost[high - share.first] - lost[low - share.first])
        left += float(regret[(begin < high) & (end >= low)].sum())
        if left <= allowed:
            continue
        if middles and low < middles[-1][1]:
            before = middles[-1]
            size = sum(b - a for _, a, b in plan.between(before[0], high))
            if size <= component.together // 2:
                middles[-1] = (before[0], max(high, before[1]))
                continue
            low = before[1]
        if low < high:
            middles.append((low, high))
    return middles


def _replaced(pieces: tuple[Piece, ...], windows: list[Window]) -> tuple[Piece, ...]:
    """The pieces with the cores of the windows in the place of what was there."""
    fresh = pieces_of(windows)
    kept: list[Piece] = []
    for piece in pieces:
        low = piece.low
        for new in fresh:
            if new.high <= low or new.low >= piece.high:
                continue
            if new.low > low:
                kept.append(Piece(folder=piece.folder, low=low, high=new.low))
            low = max(low, new.high)
        if low < piece.high:
            kept.append(Piece(folder=piece.folder, low=low, high=piece.high))
    return tuple(sorted((*kept, *fresh), key=lambda piece: piece.low))
