"""Distances to the nearest points, by a compiled loop where the distance is plain."""

import numpy as np

from tgospa_eval.common.arrays import median
from tgospa_eval.distances.base import Distance
from tgospa_eval.distances.points import plain_norm, rows_at
from tgospa_eval.problem.compiled import kernels
from tgospa_eval.tracks.trajectories import Trajectories

SAMPLED_STEPS = 100
"""Steps, and truths of a step, whose nearest estimate is looked at for a notice."""


@np.errstate(over="ignore", invalid="ignore")
def median_nearest(truth: Trajectories, estimate: Trajectories, distance: Distance) -> float | None:
    """Median distance from a truth to the nearest estimate of its step, over up to 100 steps.

    None if no step has both. Both sides must be on the same times.
    """
    distance = distance.lower_bound
    sides = truth, estimate
    rows = [rows_at(side, np.arange(len(side.times))) for side in sides]
    both = np.flatnonzero((rows[0][1] > rows[0][0]) & (rows[1][1] > rows[1][0]))
    if not len(both):
        return None
    both = both[:: -(-len(both) // SAMPLED_STEPS)]
    mine, others = (np.ascontiguousarray(side[:, both]) for side in rows)
    norm = plain_norm(sides, distance)
    if norm is not None:
        states = (side.state for side in sides)
        return median(kernels.nearest_points(*states, mine, others, *norm, SAMPLED_STEPS))
    nearest = []
    for bounds in zip(mine.T.tolist(), others.T.tolist(), strict=True):
        a, b = (
            distance.axes(side, slice(*rows)).T for side, rows in zip(sides, bounds, strict=True)
        )
        a = a[:: -(-len(a) // SAMPLED_STEPS)]
        nearest.append(distance(a[:, None], b[None, :]).min(axis=1))
    return median(np.concatenate(nearest))
