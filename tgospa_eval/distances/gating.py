"""Which pairs of one step are nearer than the cutoff: time and memory for the near pairs only."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import index_type
from tgospa_eval.common.cores import cores
from tgospa_eval.common.threads import in_order
from tgospa_eval.distances.base import Distance, Effort, Floats, Pairs, Sides
from tgospa_eval.distances.points import near_points
from tgospa_eval.distances.search import Side, search
from tgospa_eval.tracks.trajectories import Ints, Trajectories

Value = TypeVar("Value", bound=np.generic)

ROWS_TOGETHER = 1 << 15
"""Rows searched at a time; a step is never divided."""


# Differences and sums of huge coordinates may overflow: infinitely far is right.
@np.errstate(over="ignore", invalid="ignore")
def near_pairs(
    truth: Trajectories,
    estimate: Trajectories,
    cutoff: float,
    distance: Distance,
    effort: Effort | None = None,
) -> Pairs:
    """All pairs of one step that are nearer than `cutoff`, in one thread unless `effort` says more.

    Both must be on the same times.
    """
    effort = effort or Effort(jobs=1)
    sides, distance = distance.prepared((truth, estimate), effort)
    return prepared_pairs(sides, cutoff, distance, effort)


@np.errstate(over="ignore", invalid="ignore")
def prepared_pairs(sides: Sides, cutoff: float, distance: Distance, effort: Effort) -> Pairs:
    """As `near_pairs`, of sides and a distance that `Distance.prepared` has made ready."""
    truth, estimate = sides
    horizon = distance.horizon(sides, cutoff)
    starts = starts_of_steps(truth), starts_of_steps(estimate)
    rows = tuple(np.stack((at[:-1], at[1:])) for at in starts)
    found = near_points(sides, (rows[0], rows[1]), horizon, distance)
    if found is not None:
        return found
    kind = index_type(max(len(truth.step), len(estimate.step)))
    truth_rows, estimate_rows, distances = _Column(kind), _Column(kind), _Column(np.float64)

    @np.errstate(over="ignore", invalid="ignore")  # of each thread
    def between(steps: tuple[int, int]) -> list[tuple[Ints, Ints, Floats]]:
        a = _rows(truth, starts[0], *steps, distance)
        b = _rows(estimate, starts[1], *steps, distance)
        found = []
        for i, j in _search(a, b, horizon, distance):
            value = distance.between((x[i], y[j]) for x, y in zip(a.axes, b.axes, strict=True))
            near = np.flatnonzero(value < horizon)
            found.append((i[near] + a.first, j[near] + b.first, value[near]))
        return found

    stretches = list(_together(starts[0] + starts[1]))
    for pieces in in_order(between, stretches, min(effort.jobs or cores(), len(stretches))):
        for i, j, value in pieces:
            truth_rows.add(i)
            estimate_rows.add(j)
            distances.add(value)
    found = Pairs(
        truth_row=truth_rows.done(), estimate_row=estimate_rows.done(), distance=distances.done()
    )
    return distance.refined(found, sides, cutoff, effort)


def _search(a: Side, b: Side, cutoff: float, distance: Distance) -> Iterator[tuple[Ints, Ints]]:
    """Candidates, by those axes of the embedded states that can separate some."""
    points = [replace(side, axes=distance.embed(side.axes)) for side in (a, b)]
    reach = [distance.reach(cutoff, side.axes) for side in (a, b)]
    finite = np.isfinite(reach[0]).all(axis=1) & np.isfinite(reach[1]).all(axis=1)
    if not finite.all():
        points = [replace(side, axes=side.axes[finite]) for side in points]
        reach = [own[finite] for own in reach]
    return search(points[0], points[1], (reach[0], reach[1]), distance.tree_power)


class _Column(Generic[Value]):
    """An array that grows in place: many small parts would leave holes in memory when joined."""

    def __init__(self, kind: type[Value]) -> None:
        self.values: NDArray[Value] = np.zeros(0, kind)
        self.size = 0

    def add(self, part: NDArray[Value]) -> None:
        """Put it behind what is there."""
        end = self.size + len(part)
        if end > len(self.values):
            self.values.resize(end + end // 8, refcheck=False)
        self.values[self.size : end] = part
        self.size = end

    def done(self) -> NDArray[Value]:
        """What was added."""
        self.values.resize(self.size, refcheck=False)
        return self.values


def starts_of_steps(side: Trajectories) -> Ints:
    """First row of each step, and the number of rows."""
    steps = np.arange(len(side.times) + 1, dtype=side.step.dtype)
    return np.searchsorted(side.step, steps)


def _together(done: Ints) -> Iterator[tuple[int, int]]:
    """Ranges of steps with some `ROWS_TOGETHER` rows each; `done` is what lies before each step."""
    cuts = np.flatnonzero(np.diff(done[:-1] // ROWS_TOGETHER)) + 1
    yield from pairwise([0, *cuts.tolist(), len(done) - 1])


def _rows(side: Trajectories, starts: Ints, begin: int, end: int, distance: Distance) -> Side:
    first, last = int(starts[begin]), int(starts[end])
    return Side(
        first=first,
        step=side.step[first:last].astype(np.int64) - begin,
        at=starts[begin : end + 1] - first,
        axes=distance.axes(side, slice(first, last)),
    )
