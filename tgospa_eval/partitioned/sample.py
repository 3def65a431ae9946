"""What looks wrong with two sides, judged by a stretch of them that fits into memory."""

from dataclasses import replace
from functools import partial

import numpy as np

from tgospa_eval.common.notices import Notice
from tgospa_eval.evaluation.diagnosis import alignment_notices, diagnose
from tgospa_eval.evaluation.prepare import fit
from tgospa_eval.partitioned.run import PartsPlan
from tgospa_eval.partitioned.scan import placed
from tgospa_eval.problem.problem import Ints
from tgospa_eval.tracks.alignment import Alignment

LOOKED_AT = 50_000
"""Rows of both sides together that are looked at: a diagnosis of so many takes a tenth of a
second."""


def look(plan: PartsPlan, grid: Alignment) -> list[Notice]:
    """Notices about both sides, and warnings about the middle of the recording.

    Parameters
    ----------
    plan : PartsPlan
        What is evaluated.
    grid : Alignment
        The steps of both sides, without their rows.
    """
    request = plan.request
    steps = replace(grid, left_out=(0, 0))  # whose rows are not counted yet
    notices = [Notice(text=text) for text in alignment_notices(steps, request.time_matching)]
    first, last = middle(plan.cut.rows, LOOKED_AT)
    piece = plan.cut.piece(first, last + 1)
    last = piece.high - 1
    truth, estimate = (stretch.read().trajectories for stretch in piece.stretches)
    # Of their own stamps what is wrong with clocks is seen.
    at_steps = partial(placed, piece, plan.times[piece.low : piece.high])
    decided = request.time_matching.decided
    sides = fit(truth, estimate, request, plan.names, at_steps if decided else None)
    found = diagnose(sides, request)
    shown = grid.truth.shown
    return notices + [
        notice.about(f"from step {shown[first]} to {shown[last]}") for notice in found
    ]


def middle(rows: Ints, size: int) -> tuple[int, int]:
    """First and last of the steps with so many rows around the middle one of all rows."""
    after = np.cumsum(rows)
    half = int(after[-1]) // 2
    first = int(np.searchsorted(after, half - size // 2, side="right"))
    last = int(np.searchsorted(after, half + size // 2, side="left"))
    return min(first, len(rows) - 1), min(max(first, last), len(rows) - 1)
