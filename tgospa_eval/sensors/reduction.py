"""Clouds of a whole recording reduced, and what that changed. Knows no file."""

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.machine import cores, in_order
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Reduction, Resources, cloud_wasserstein
from tgospa_eval.distances.clouds import reduced
from tgospa_eval.distances.reduction import sliced_wasserstein, spread_directions
from tgospa_eval.distances.transport import MOST_PARTICLES, POT_NEEDED, can_transport
from tgospa_eval.results.records import Columns
from tgospa_eval.tracks.clouds import Cloud, Clouds
from tgospa_eval.tracks.trajectories import Trajectories

CloudChange = tuple[int, int, float | None, float, float | None, float]
"""Values of `CHANGES` of a cloud; None where one is not known or has no meaning."""

CHANGES = ("particles", "kept", "wasserstein", "sliced_wasserstein", "trace_kept", "mean_shift")
HISTORY = "history"
"""Distance to the cloud before each iteration of the reduction: a list each."""


def reduce_trajectories(
    side: Trajectories, reduction: Reduction, effort: Resources | None = None
) -> tuple[Trajectories, Columns]:
    """Every cloud with fewer particles, and a row of what changed for each.

    Parameters
    ----------
    side : Trajectories
        With clouds; without, every state is one particle, and nothing changes.
    reduction : Reduction
        How.
    effort : Resources, optional
        Threads, and progress.

    Returns
    -------
    Trajectories
        With the reduced clouds and their means.
    dict of lists
        By cloud: id, t, particles, kept, wasserstein and sliced_wasserstein distance of both
        clouds (order 2), trace_kept as share of the trace of the covariance, mean_shift, and the
        history, as `Reduction.trace` has it. None where a cloud is too large for the exact
        distance, POT is missing, or there is no spread.
    """
    effort = effort or Resources()
    if side.clouds is None:
        return side, _table(side, [(1, 1, 0.0, 0.0, None, 0.0)] * len(side.step), [])
    histories: list[list[float]] = []
    after = reduced(side.clouds, reduction, effort, histories)
    return side.with_clouds(after), _table(side, _changes(side.clouds, after, effort), histories)


def _table(side: Trajectories, changes: list[CloudChange], histories: list[list[float]]) -> Columns:
    table = {"id": side.ids[side.track].tolist(), "t": side.shown[side.step].tolist()}
    table |= {name: [change[k] for change in changes] for k, name in enumerate(CHANGES)}
    return table | {HISTORY: histories or [[] for _ in changes]}


def _changes(before: Clouds, after: Clouds, effort: Resources) -> list[CloudChange]:
    """A row for each cloud: in threads, as it takes longer than to reduce."""
    directions = spread_directions(before.points.shape[1], None, np.random.default_rng(0))
    is_exact = can_transport()

    def change(row: int) -> CloudChange:
        return _compared(before[row], after[row], directions, is_exact=is_exact)

    is_changed = before.counts > after.counts
    if is_changed.any() and not is_exact:
        effort.stopwatch.notify(f"no exact distances from the clouds before: {POT_NEEDED}")
    what = f"{counted(int(np.count_nonzero(is_changed)), 'cloud')} to compare with those before"
    works = (is_changed * (before.counts * after.counts.astype(float)) ** 1.05).tolist()
    found = in_order(change, range(len(before)), effort.jobs or cores())
    with effort.stopwatch.showing("comparing clouds with those before"):
        return list(effort.stopwatch.paced(found, works, what))


def _compared(before: Cloud, after: Cloud, directions: Floats, *, is_exact: bool) -> CloudChange:
    sizes = len(before[1]), len(after[1])
    if sizes[0] == sizes[1]:
        return *sizes, 0.0, 0.0, 1.0, 0.0
    means = [weights @ points for points, weights in (before, after)]
    traces = [
        float(weights @ ((points - mean) ** 2).sum(axis=1))
        for (points, weights), mean in zip((before, after), means, strict=True)
    ]
    # Without a warning for weights of single precision: they were normalised when read.
    exact = (
        cloud_wasserstein(*before, *after)
        if is_exact and sizes[0] * sizes[1] <= MOST_PARTICLES**2
        else None
    )
    return (
        *sizes,
        exact,
        sliced_wasserstein(before, after, directions),
        traces[1] / traces[0] if traces[0] else None,
        float(np.linalg.norm(means[1] - means[0])),
    )
