"""Search for near pairs: an object and an estimate at one step, nearer than the cutoff.

Time and memory grow with the number of these pairs. With a margin, a search also returns pairs a
little beyond the cutoff. `tgospa_problem` in `problem.metric_family` decides which of these are
near.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, concatenated, index_type
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.machine import cores, in_order
from tgospa_eval.distances import DISTANCES
from tgospa_eval.distances.base import Distance, Pairs, Resources, Sides
from tgospa_eval.distances.vector import Norm
from tgospa_eval.kernels import kernels
from tgospa_eval.tracks.trajectories import Trajectories

MAX_PAIRS = 128
"""Largest number of compared pairs per row in a search that sorts along one axis only."""

NORMS = {1.0: 1, 2.0: 2, np.inf: 0}
"""Code for each norm in the compiled kernels, by the power of the norm."""

Ranges = tuple[Ints, Ints]
"""Rows of truth and of estimate at T steps. Each array has the shape (2, T): the first row of each
step, and the row after the last row of the step."""


def rows_at(side: Trajectories, steps: Ints) -> NDArray[np.int64]:
    """Return the first row of each of T steps, and the row after its last row, (2, T)."""
    # With another type, searchsorted would convert the whole column.
    wanted = np.empty((2, len(steps)), side.step.dtype)
    wanted[0] = steps
    np.add(wanted[0], 1, out=wanted[1])
    return side.step.searchsorted(wanted)


def near_points(sides: Sides, rows: Ranges, cutoff: float, distance: Distance) -> Pairs | None:
    """Return the near pairs of some steps; None if the compiled kernels have no quick method.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate.
    rows : pair of (2, T) int64 arrays
        Rows of either side at the steps, as from `rows_at`.
    cutoff : float
        > 0.
    distance : Distance
        Base distance of points.

    Returns
    -------
    Pairs, optional
        Near pairs. Their rows are counted from 0 among the rows of these steps only.
    """
    norm = plain_norm(sides, distance)
    if norm is None:
        return None
    states = (side.state for side in sides)
    size = sum(int((end - begin).sum()) for begin, end in rows)
    pairs = kernels.near_points(*states, *rows, cutoff, *norm, MAX_PAIRS * size)
    if pairs is None:
        return None
    return Pairs(truth_row=pairs[0], estimate_row=pairs[1], distance=pairs[2])


def plain_norm(sides: Sides, distance: Distance) -> tuple[int, Floats] | None:
    """Return the code and the scales of a norm for the kernels; None if they cannot be used."""
    if kernels is None or not isinstance(distance, Norm) or distance.period is not None:
        return None
    if not all(side.state.flags.c_contiguous for side in sides):
        return None
    size = sides[0].state.shape[1]
    return NORMS[distance.power], np.array(distance.scale or (1.0,) * size)


# -------------------------------------------------------------------------------------------------
# Candidates for near pairs: the pairs of a step that remain after sorting along the axes.
#
# Each point has a reach on each axis: near points differ by less than the larger of their two
# reaches. The estimates are sorted by step, and then by cells along the axes. A cell is about as
# wide as the largest reach; along the first axis, cells are finer. The candidates of a truth row
# are a few ranges of this order, found by bisection. Axes are added one by one until the candidates
# are few. Rounding of the cells only adds candidates, and loses no pair. Afterwards, the
# differences of the candidates are compared with the reaches.
#
# If too many candidates remain and reaches are unequal, the points with small reaches and the
# points with large reaches are searched separately, recursively. If there are still too many
# candidates, a tree is searched.

CANDIDATES_TOGETHER = 1 << 14
"""Number of candidates compared at a time; the candidates of a truth row stay together."""

FEW_CANDIDATES = 8
"""If there are at most this many candidates per row, no further axis is used."""

CELL_AXES = 3
"""Largest number of axes that are divided into cells. Each axis after the first one triples the
number of ranges of a truth row."""

MANY_CANDIDATES = 64
"""A tree is faster if there are more candidates than this per row and also per near pair."""

SAMPLED_TRUTHS = 100
"""Number of truth rows whose near pairs are counted, to estimate the number of all near pairs."""

EQUAL_REACHES = 4.0
"""All points of a side are searched together if its largest reach is at most this many times its
least reach."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchedSide:
    """Rows of one side at some consecutive steps.

    Parameters
    ----------
    first : int
        The first row.
    step : (R,) int array
        Step of each row, counted from the first of the steps.
    at : (steps + 1,) int array
        First row of each step, counted from `first`; at the end, the number of rows.
    axes : (d, R) float array
        Coordinates.
    """

    first: int
    step: Ints
    at: Ints
    axes: Floats


Candidates = tuple[Ints, Ints, Ints]
"""The estimate rows in some order, and for each of R truth rows the begins and the lengths of its
ranges in this order, (ranges, R) each. The candidates of a truth row are the estimate rows in its
ranges."""


def search(
    a: SearchedSide, b: SearchedSide, reaches: tuple[Floats, Floats], power: float
) -> Iterator[tuple[Ints, Ints]]:
    """Yield, in order, all pairs that the reaches do not exclude, and maybe other pairs.

    A pair is a row of `a` and a row of `b`. It is excluded if its points differ on some axis by the
    larger of their reaches or more, or if `power` excludes it.

    Parameters
    ----------
    a, b : SearchedSide
        Points.
    reaches : two (d, R) or (d, 1) float arrays
        Reaches of `a` and of `b`; finite and > 0.
    power : float
        Power of a Minkowski norm (`Distance.tree_power`). On each axis, divide the difference of
        two points by the larger reach. A pair is excluded if the norm of the quotients is above 1.
    """
    if not len(a.step) or not len(b.step):
        return
    reach = np.maximum(*(own.max(axis=1) for own in reaches))
    order, begin, count = _candidates(a, b, reach)
    rows = len(a.step) + len(b.step)
    if len(reach) and count.sum() > max(MANY_CANDIDATES * rows, CANDIDATES_TOGETHER):
        ratio = np.array([own.max(axis=1) / own.min(axis=1) for own in reaches])
        which, axis = divmod(int(ratio.argmax()), ratio.shape[1])
        if ratio[which, axis] > EQUAL_REACHES:  # reaches differ most on this side and axis
            del order, begin, count
            yield from _divided((a, b), reaches, power, which, axis)
            return
        some = np.arange(0, len(a.step), -(-len(a.step) // SAMPLED_TRUTHS))
        sample = order, begin[:, some], count[:, some]
        near = sum(len(i) for i, _ in _compared(a.axes[:, some], b.axes, sample, reach))
        if near * MANY_CANDIDATES < sample[2].sum():
            for step in np.flatnonzero(np.diff(a.at) * np.diff(b.at)).tolist():
                yield _tree(a, b, step, reach, power)
            return
    yield from _compared(a.axes, b.axes, (order, begin, count), reach)


def _divided(
    sides: tuple[SearchedSide, SearchedSide],
    reaches: tuple[Floats, Floats],
    power: float,
    which: int,
    axis: int,
) -> Iterator[tuple[Ints, Ints]]:
    """Yield pairs in order; search small and large reaches of a side separately.

    Reaches are divided at the geometric mean of the least and the largest one. After a few
    divisions, the reaches in each part are nearly equal.
    """
    own = reaches[which]
    small = own[axis] < np.sqrt(own[axis].min()) * np.sqrt(own[axis].max())
    keys = [np.zeros(0, np.int64)]
    for rows in (np.flatnonzero(small), np.flatnonzero(~small)):
        side, reach = sides[which], own[:, rows]
        at = np.searchsorted(side.step[rows], np.arange(len(side.at)))
        part = replace(side, step=side.step[rows], at=at, axes=side.axes[:, rows])
        if which == 0:
            pieces = search(part, sides[1], (reach, reaches[1]), power)
            keys += [rows[i] << 32 | j for i, j in pieces]
        else:
            pieces = search(sides[0], part, (reaches[0], reach), power)
            keys += [i << 32 | rows[j] for i, j in pieces]
    pairs = np.sort(np.concatenate(keys))
    del keys
    for begin in range(0, len(pairs), CANDIDATES_TOGETHER):
        pair = pairs[begin : begin + CANDIDATES_TOGETHER]
        yield pair >> 32, pair & 0xFFFFFFFF


def _candidates(a: SearchedSide, b: SearchedSide, reach: Floats) -> Candidates:
    """Return candidates; add axes, those with wide spreads first, until the candidates are few."""
    begin = b.at[a.step]
    candidates: Candidates = np.arange(len(b.step)), begin[None], (b.at[a.step + 1] - begin)[None]
    enough = FEW_CANDIDATES * (len(a.step) + len(b.step))
    if candidates[2].sum() <= enough:
        return candidates
    smallest, largest = ([of(side.axes, axis=1) for side in (a, b)] for of in (np.min, np.max))
    if np.any(np.maximum(*smallest) - np.minimum(*largest) >= reach):
        return *candidates[:2], np.zeros_like(candidates[2])
    # Differences of halves do not overflow.
    low = 0.5 * np.minimum(*smallest)
    spread = 0.5 * np.maximum(*largest) - low
    axes = np.argsort(-spread / reach, kind="stable")[:CELL_AXES]
    for used in range(1, len(axes) + 1):
        candidates = _by_cells(a, b, axes[:used], (low, spread), reach)
        if candidates[2].sum() <= enough:
            break
    return candidates


def _by_cells(
    a: SearchedSide, b: SearchedSide, axes: Ints, extent: tuple[Floats, Floats], reach: Floats
) -> Candidates:
    """Return candidates by cells along all axes; the cells along the first axis are finer.

    Let `low` be the least coordinate, and w the width of a cell. The point x is in the cell with
    the index floor((x - low) / w) < 2^40, where the quotient is exact to 2^-12. n cells are as wide
    as a reach that is widened by the share 2^-10. So the indices of near points x and y differ by
    at most n: |x - y| / w + 2^-11 <= n (1 - 2^-10.01) + 2^-11 < n.

    The step and the indices of all axes make one key. Empty cells at the ends of each axis separate
    the neighbours of different keys. If a key would have too many bits, or the quotient too few,
    the cells are wider.
    """
    bits = min(40, (62 - len(a.at).bit_length()) // len(axes) - 1)
    key_a, key_b = a.step, b.step
    offset = np.zeros(1, np.int64)
    cells = 1
    for axis in axes[::-1]:
        cells = 16 if axis == axes[0] else 1
        low, spread = (float(of[axis]) for of in extent)
        width = max(0.5 * float(reach[axis]) * (1 + 2**-10) / cells, spread * 2.0**-bits)
        size = int(spread / width) + 1 + 2 * cells
        key_a, key_b = (
            key * size + ((0.5 * side.axes[axis] - low) / width).astype(np.int64) + cells
            for key, side in ((key_a, a), (key_b, b))
        )
        offset = offset * size
        if axis != axes[0]:
            offset = (offset[:, None] + np.arange(-1, 2)).ravel()
    order = np.argsort(key_b)
    key_b = key_b[order]
    order_a = np.argsort(key_a)  # bisection is twice as fast for sorted keys
    key_a = key_a[order_a]
    begin = np.empty((len(offset), len(key_a)), np.int64)
    count = np.empty_like(begin)
    for run, shift in enumerate(offset.tolist()):
        low_end = np.searchsorted(key_b, key_a + (shift - cells))
        begin[run, order_a] = low_end
        count[run, order_a] = np.searchsorted(key_b, key_a + (shift + cells + 1)) - low_end
    return order, begin, count


def _compared(
    truth: Floats, estimate: Floats, candidates: Candidates, reach: Floats
) -> Iterator[tuple[Ints, Ints]]:
    """Yield, in order and in pieces, the candidates that differ by less than `reach` on each axis.

    `truth` and `estimate` have the coordinates (d, R).
    """
    order, begin, count = candidates
    ordered = [y.take(order) for y in estimate]
    total = count.sum(axis=0)
    done = np.cumsum(total)
    cuts = np.searchsorted(done, np.arange(0, done[-1], CANDIDATES_TOGETHER), side="right").tolist()
    for lower, upper in pairwise([0, *cuts[1:], len(total)]):
        number = count[:, lower:upper].ravel()
        i = np.repeat(np.tile(np.arange(lower, upper, dtype=np.int64), len(count)), number)
        at = concatenated(begin[:, lower:upper].ravel(), number)
        for x, y, limit in zip(truth, ordered, reach.tolist(), strict=True):
            near = np.flatnonzero(np.abs(x.take(i) - y.take(at)) < limit)
            i, at = i.take(near), at.take(near)
        pair = np.sort(i << 32 | order[at])
        yield pair >> 32, pair & 0xFFFFFFFF


def _tree(
    a: SearchedSide, b: SearchedSide, step: int, reach: Floats, power: float
) -> tuple[Ints, Ints]:
    """Return the pairs of a step within the reach, and some beyond it, by a k-d tree.

    Axes are scaled by powers of 2, which is exact and avoids overflow of squares. If reaches of
    axes differ, the scaled reaches are up to twice as wide as necessary.
    """
    from scipy.spatial import KDTree  # lazy: most evaluations do not need SciPy

    radius, exponent = np.frexp(reach)
    trees = []
    for side in (a, b):
        points = np.ldexp(side.axes[:, side.at[step] : side.at[step + 1]].T, -exponent)
        trees.append(KDTree(np.clip(points, -1e150, 1e150)))
    near = trees[0].sparse_distance_matrix(
        trees[1], float(radius.max()) * (1 + 1e-9), p=power, output_type="ndarray"
    )
    order = np.lexsort((near["j"], near["i"]))
    return near["i"][order] + a.at[step], near["j"][order] + b.at[step]


Value = TypeVar("Value", bound=np.generic)

ROWS_TOGETHER = 1 << 15
"""Number of rows searched at a time; a step is never divided."""


# Differences and sums of huge coordinates may overflow to infinity; results are right all the same.
@np.errstate(over="ignore", invalid="ignore")
def near_pairs(
    truth: Trajectories,
    estimate: Trajectories,
    cutoff: float,
    distance: Distance,
    resources: Resources | None = None,
) -> Pairs:
    """Return the pairs at one step that are nearer than `cutoff`.

    Both sides must be at the same times. The work is in one thread if there are no `resources`.
    """
    resources = resources or Resources(jobs=1)
    sides, distance = distance.prepared((truth, estimate), resources)
    return prepared_pairs(sides, cutoff, distance, resources)


def prepared_pairs(
    sides: Sides, cutoff: float, distance: Distance, resources: Resources, *, margin: float = 0.0
) -> Pairs:
    """Return near pairs as `near_pairs` does, for sides that come from `Distance.prepared`.

    With a `margin`, pairs up to this distance beyond the cutoff are included.
    """
    with DISTANCES.blamed(distance.name), np.errstate(over="ignore", invalid="ignore"):
        return _prepared_pairs(sides, cutoff, distance, resources, margin)


def _prepared_pairs(
    sides: Sides, cutoff: float, distance: Distance, resources: Resources, margin: float
) -> Pairs:
    truth, estimate = sides
    cutoff = max(cutoff, min(cutoff + margin, distance.largest))
    horizon = distance.horizon(sides, cutoff)
    limit = float(np.nextafter(horizon, np.inf)) if margin else horizon
    starts = starts_of_steps(truth), starts_of_steps(estimate)
    stretches = list(_together(starts[0] + starts[1]))

    def quickly(begin: int, end: int) -> Pairs | None:
        rows = (np.array((at[begin:end], at[begin + 1 : end + 1])) for at in starts)
        return near_points(sides, (next(rows), next(rows)), limit, distance)

    if len(stretches) == 1 and (pairs := quickly(*stretches[0])) is not None:
        return pairs
    kind = index_type(max(len(truth.step), len(estimate.step)))
    truth_rows, estimate_rows, distances = _Column(kind), _Column(kind), _Column(np.float64)

    @np.errstate(over="ignore", invalid="ignore")  # each thread has its own error state
    def between(steps: tuple[int, int]) -> list[tuple[Ints, Ints, Floats]]:
        known = quickly(*steps)
        if known is not None:
            first, second = (at[steps[0]] for at in starts)
            return [(known.truth_row + first, known.estimate_row + second, known.distance)]
        a = _rows(truth, starts[0], *steps, distance)
        b = _rows(estimate, starts[1], *steps, distance)
        near_rows = []
        for i, j in _search(a, b, horizon, distance):
            value = distance.between((x[i], y[j]) for x, y in zip(a.axes, b.axes, strict=True))
            near = np.flatnonzero(value < limit)
            near_rows.append((i[near] + a.first, j[near] + b.first, value[near]))
        return near_rows

    for pieces in in_order(between, stretches, min(resources.jobs or cores(), len(stretches))):
        for i, j, value in pieces:
            truth_rows.add(i)
            estimate_rows.add(j)
            distances.add(value)
    pairs = Pairs(
        truth_row=truth_rows.done(), estimate_row=estimate_rows.done(), distance=distances.done()
    )
    return distance.refined(pairs, sides, cutoff, resources)


def _search(
    a: SearchedSide, b: SearchedSide, cutoff: float, distance: Distance
) -> Iterator[tuple[Ints, Ints]]:
    """Embed the states, search on the axes with finite reaches, and yield the candidates."""
    points = [replace(side, axes=distance.embed(side.axes)) for side in (a, b)]
    reach = [distance.reach(cutoff, side.axes) for side in (a, b)]
    finite = np.isfinite(reach[0]).all(axis=1) & np.isfinite(reach[1]).all(axis=1)
    if not finite.all():
        points = [replace(side, axes=side.axes[finite]) for side in points]
        reach = [own[finite] for own in reach]
    return search(points[0], points[1], (reach[0], reach[1]), distance.tree_power)


class _Column(Generic[Value]):
    """Array that grows in place, because joining many small parts would fragment the memory."""

    def __init__(self, kind: type[Value]) -> None:
        self.values: NDArray[Value] = np.zeros(0, kind)
        self.size = 0

    def add(self, part: NDArray[Value]) -> None:
        """Append a part."""
        end = self.size + len(part)
        if end > len(self.values):
            self.values.resize(end + end // 8, refcheck=False)
        self.values[self.size : end] = part
        self.size = end

    def done(self) -> NDArray[Value]:
        """Return the array of all parts."""
        self.values.resize(self.size, refcheck=False)
        return self.values


def starts_of_steps(side: Trajectories) -> Ints:
    """Return the first row of each step, and at the end the number of rows."""
    steps = np.arange(len(side.times) + 1, dtype=side.step.dtype)
    return np.searchsorted(side.step, steps)


def _together(done: Ints) -> Iterator[tuple[int, int]]:
    """Yield ranges of steps with about `ROWS_TOGETHER` rows.

    `done` has the number of rows before each step.
    """
    cuts = np.flatnonzero(np.diff(done[:-1] // ROWS_TOGETHER)) + 1
    yield from pairwise([0, *cuts.tolist(), len(done) - 1])


def _rows(
    side: Trajectories, starts: Ints, begin: int, end: int, distance: Distance
) -> SearchedSide:
    first, last = int(starts[begin]), int(starts[end])
    return SearchedSide(
        first=first,
        step=side.step[first:last].astype(np.int64) - begin,
        at=starts[begin : end + 1] - first,
        axes=distance.axes(side, slice(first, last)),
    )
