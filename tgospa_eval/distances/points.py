"""Near points by a compiled loop over all pairs, where these are few."""

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.distances.base import Distance, Floats, Pairs, Sides
from tgospa_eval.distances.vector import Norm
from tgospa_eval.problem.compiled import kernels
from tgospa_eval.tracks.trajectories import Ints, Trajectories

MOST_PAIRS = 1 << 18
"""Pairs, near or not, of which all are looked at."""

NORMS = {1.0: 1, 2.0: 2, np.inf: 0}
"""Norms as the kernels call them."""

Ranges = tuple[Ints, Ints]
"""Of truth and estimate the first row and the end of the rows of each step (2, T)."""


def rows_at(side: Trajectories, steps: Ints) -> NDArray[np.int64]:
    """First row and end of the rows of each of some steps (2, T)."""
    wanted = np.empty((2, len(steps)), side.step.dtype)  # else all of the others are converted
    wanted[0] = steps
    np.add(wanted[0], 1, out=wanted[1])
    return np.searchsorted(side.step, wanted)


def near_points(sides: Sides, rows: Ranges, cutoff: float, distance: Distance) -> Pairs | None:
    """Pairs of the same of some steps that are nearer than the cutoff; None if that is not quick.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate.
    rows : pair of (2, T) int64 arrays
        Rows of either side that are compared with each other, as of `rows_at`.
    cutoff : float
        > 0.
    distance : Distance
        Base distance of points.

    Returns
    -------
    Pairs, optional
        Of rows that are counted from the first of these steps, without those of others.
    """
    norm = plain_norm(sides, distance)
    if norm is None:
        return None
    states = (side.state for side in sides)
    found = kernels.near_points(*states, *rows, cutoff, *norm, MOST_PAIRS)
    if found is None:
        return None
    return Pairs(truth_row=found[0], estimate_row=found[1], distance=found[2])


def plain_norm(sides: Sides, distance: Distance) -> tuple[int, Floats] | None:
    """Power and scales of a norm that the kernels know, of states that they can read."""
    if kernels is None or not isinstance(distance, Norm) or distance.period is not None:
        return None
    if not all(side.state.flags.c_contiguous for side in sides):
        return None
    size = sides[0].state.shape[1]
    return NORMS[distance.power], np.array(distance.scale or (1.0,) * size)
