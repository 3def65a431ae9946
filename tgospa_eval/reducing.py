"""Clouds of a whole recording reduced, and what that changed. Knows no file."""

from typing import Any

import numpy as np

from tgospa_eval.clouds import Cloud, Clouds
from tgospa_eval.distances import Effort, Reduction, cloud_wasserstein
from tgospa_eval.distances.clouds import reduced
from tgospa_eval.distances.reduction import sliced_wasserstein, spread_directions
from tgospa_eval.distances.transport import LARGEST
from tgospa_eval.trajectories import Trajectories

Table = dict[str, list[Any]]


def reduce_trajectories(
    side: Trajectories, reduction: Reduction, effort: Effort | None = None
) -> tuple[Trajectories, Table]:
    """Every cloud with fewer particles, and a row of what changed for each.

    Parameters
    ----------
    side : Trajectories
        With clouds; without, every state is one particle, and nothing changes.
    reduction : Reduction
        How.
    effort : Effort, optional
        Threads, and progress.

    Returns
    -------
    Trajectories
        With the reduced clouds and their means.
    dict of lists
        By cloud: id, t, particles, kept, wasserstein and sliced_wasserstein distance of both
        clouds (order 2), trace_kept as share of the trace of the covariance, mean_shift. None
        where a cloud is too large for the exact distance or has no spread.
    """
    effort = effort or Effort()
    if side.clouds is None:
        return side, _table(side, None, None)
    after = reduced(side.clouds, reduction, effort)
    return side.with_clouds(after), _table(side, side.clouds, after)


def _table(side: Trajectories, before: Clouds | None, after: Clouds | None) -> Table:
    table: Table = {name: [] for name in NAMES}
    directions = spread_directions(len(side.columns), None, np.random.default_rng(0))
    shown, ids = side.shown.tolist(), side.ids.tolist()
    for row, (step, track) in enumerate(zip(side.step.tolist(), side.track.tolist(), strict=True)):
        values: tuple[Any, ...] = (1, 1, 0.0, 0.0, None, 0.0)
        if before is not None and after is not None:
            values = _compared(before[row], after[row], directions)
        for name, value in zip(NAMES, (ids[track], shown[step], *values), strict=True):
            table[name].append(value)
    return table


NAMES = (
    "id",
    "t",
    "particles",
    "kept",
    "wasserstein",
    "sliced_wasserstein",
    "trace_kept",
    "mean_shift",
)


def _compared(before: Cloud, after: Cloud, directions: np.ndarray[Any, Any]) -> tuple[Any, ...]:
    sizes = len(before[1]), len(after[1])
    if sizes[0] == sizes[1]:
        return (*sizes, 0.0, 0.0, 1.0, 0.0)
    means = [weights @ points for points, weights in (before, after)]
    traces = [
        float(weights @ ((points - mean) ** 2).sum(axis=1))
        for (points, weights), mean in zip((before, after), means, strict=True)
    ]
    # Without a warning for weights of single precision: they were normalised when read.
    exact = cloud_wasserstein(*before, *after) if sizes[0] <= LARGEST else None
    return (
        *sizes,
        exact,
        sliced_wasserstein(before, after, directions),
        traces[1] / traces[0] if traces[0] else None,
        float(np.linalg.norm(means[1] - means[0])),
    )
