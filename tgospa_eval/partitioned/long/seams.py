"""Seams that keep a bracket open, and windows around them."""

import numpy as np

from tgospa_eval.partitioned.long.borders import Borders
from tgospa_eval.partitioned.long.component import Joined, Long
from tgospa_eval.partitioned.long.plan import Plan
from tgospa_eval.partitioned.long.tables import Piece
from tgospa_eval.partitioned.long.windows import Window, pieces_of

OPEN_FROM = 0.1
"""A seam is open where more is lost than this share of its part of the gap allowed."""

WORST_STEPS = 1000
"""Steps that are looked at in a round beside seams: others are mostly near these."""


def repairs(
    component: Long, plan: Plan, joined: Joined, overlap: int, number: int
) -> tuple[list[Borders], list[Window], tuple[Piece, ...]]:
    """Windows around the open seams, their borders, and the pieces once these are solved.

    Parameters
    ----------
    component, plan
        What is solved.
    joined : Joined
        What is proven so far.
    overlap : int
        Of the windows of this round: four times as many steps are solved on either side of a seam.
    number : int
        Which round it is.
    """
    stretches = _stretches(component, plan, joined, 4 * overlap)
    borders = [
        Borders(
            output=f"{component.work}/round-{number}/borders/{index:05d}",
            rows=rows,
            windows=stretches,
        )
        for index, rows in enumerate(joined.rows)
        if component.parameters.switch_price > 0  # else steps are apart
    ]
    windows = []
    for index, around in enumerate(stretches):
        windows.append(
            Window(
                output=f"{component.work}/round-{number}/repairs/{index:06d}",
                entries=plan.between(*around),
                around=around,
                core=around,
                parameters=component.parameters,
                truth_bounds=plan.truth_bounds,
                estimate_bounds=plan.estimate_bounds,
                gap=0.25 * component.gap,
                end=component.end,
                near=tuple(p for p in joined.pieces if p.low < around[1] and p.high > around[0]),
                borders=tuple(task.output for task in borders),
                number=index,
                ends=(around[0] <= plan.window[0], around[1] > plan.window[1]),
            )
        )
    return borders, windows, _replaced(joined.pieces, windows)


def _stretches(
    component: Long, plan: Plan, joined: Joined, overlap: int
) -> tuple[tuple[int, int], ...]:
    """Stretches around seams and steps that keep the bracket open, the worst first, none twice.

    What is worth most at the borders of one depends on what is inside of its neighbours: those are
    left for another round.
    """
    share = joined.share
    seams = [piece.low for piece in joined.pieces[1:]]
    allowed = OPEN_FROM * component.gap * share.upper / max(len(seams), 1)
    open_ = np.flatnonzero(joined.lost > allowed)
    worst = open_[np.argsort(-joined.lost[open_], kind="stable")[:WORST_STEPS]]
    steps = np.unique((*seams, *(worst + share.first)))
    lost = np.concatenate(([0.0], np.cumsum(joined.lost)))
    regret, begin, end = joined.regret
    around = [plan.around(step, step, overlap, component.together // 2) for step in steps.tolist()]
    left = np.array(
        [
            lost[high - share.first]
            - lost[low - share.first]
            + regret[(begin < high) & (end >= low)].sum()
            for low, high in around
        ]
    )
    chosen: list[tuple[int, int]] = []
    for index in np.argsort(-left, kind="stable").tolist():
        low, high = around[index]
        if left[index] > allowed and all(high < a or low > b for a, b in chosen):
            chosen.append((low, high))
    return tuple(sorted(chosen))


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
