"""Candidates for near pairs: what sorting along the axes leaves of all pairs of a step.

It sees points, and for each of them and each axis its reach: near ones differ by less than the
larger of their two reaches. The estimates are sorted by (step, cell, coordinate), where the cells
are as wide as the largest reach: the candidates of a truth are a few runs of that order, found by
bisection. One axis after the other is used until the candidates are few. The exact differences of
the candidates decide, so that rounding of the cells costs candidates, never pairs.

Where that leaves many and reaches are unequal, points with a small one are searched apart from
those with a large one, and so on. Where it leaves many all the same, a tree is asked.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.base import Floats
from tgospa_eval.tracks.trajectories import Ints

CANDIDATES_TOGETHER = 1 << 14
"""Candidates compared at a time; those of one truth are never divided."""

FEW_CANDIDATES = 8
"""Candidates per row that are compared rather than sorted out by one more axis."""

CELL_AXES = 3
"""Axes that cells are made of; each but one multiplies the runs of a truth by 3."""

MANY_CANDIDATES = 64
"""Candidates per row and per near pair beyond which a tree is the quicker way."""

SAMPLED_TRUTHS = 100
"""Truths whose near pairs are counted for a guess."""

EQUAL_REACHES = 4.0
"""Reaches of a side are one class if the largest is no more than so many times the least."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """The rows of one side at some consecutive steps.

    Parameters
    ----------
    first : int
        Row where they begin.
    step : (R,) int array
        Counted from the first of the steps.
    at : (steps + 1,) int array
        Where each step begins, counted from `first`.
    axes : (d, R) float array
        Coordinates.
    """

    first: int
    step: Ints
    at: Ints
    axes: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class _Candidates:
    """For each truth, runs of the estimates in an order of their own.

    Parameters
    ----------
    order : (E,) int array
        Estimates in that order.
    begin, count : (runs, R) int arrays
        The runs of each truth.
    """

    order: Ints
    begin: Ints
    count: Ints


def search(
    a: Side, b: Side, reaches: tuple[Floats, Floats], power: float
) -> Iterator[tuple[Ints, Ints]]:
    """Pairs that differ by less than the larger reach on every axis, or some more, in order.

    Parameters
    ----------
    a, b : Side
        Points.
    reaches : two (d, R) or (d, 1) float arrays
        Of `a` and of `b`; finite and > 0.
    power : float
        Minkowski norm of the differences, in units of the larger reach, that is at most 1 for all
        pairs that are needed.
    """
    if not len(a.step) or not len(b.step):
        return
    reach = np.maximum(*(own.max(axis=1) for own in reaches))
    candidates = _candidates(a, b, reach)
    rows = len(a.step) + len(b.step)
    if len(reach) and candidates.count.sum() > max(MANY_CANDIDATES * rows, CANDIDATES_TOGETHER):
        widest = _widest(reaches)
        if widest:
            del candidates
            yield from _divided((a, b), reaches, power, *widest)
            return
        some = np.arange(0, len(a.step), -(-len(a.step) // SAMPLED_TRUTHS))
        sample = replace(
            candidates, begin=candidates.begin[:, some], count=candidates.count[:, some]
        )
        near = sum(len(i) for i, _ in _compared(a.axes[:, some], b.axes, sample, reach))
        if near * MANY_CANDIDATES < sample.count.sum():
            for step in np.flatnonzero(np.diff(a.at) * np.diff(b.at)).tolist():
                yield _tree(a, b, step, reach, power)
            return
    yield from _compared(a.axes, b.axes, candidates, reach)


def _widest(reaches: tuple[Floats, Floats]) -> tuple[int, int] | None:
    """The side and the axis on which reaches differ the most; None if they hardly do."""
    ratio = np.array([own.max(axis=1) / own.min(axis=1) for own in reaches])
    which, axis = divmod(int(ratio.argmax()), ratio.shape[1])
    return (which, axis) if ratio[which, axis] > EQUAL_REACHES else None


def _divided(
    sides: tuple[Side, Side], reaches: tuple[Floats, Floats], power: float, which: int, axis: int
) -> Iterator[tuple[Ints, Ints]]:
    """Pairs, searched for small and for large reaches of a side, in order.

    They are divided at their geometric mean: a few halvings of the logarithm leave equal ones.
    """
    own = reaches[which]
    small = own[axis] < np.sqrt(own[axis].min()) * np.sqrt(own[axis].max())
    found = [np.zeros(0, np.int64)]
    for rows in (np.flatnonzero(small), np.flatnonzero(~small)):
        part, reach = _taken(sides[which], rows), own[:, rows]
        if which == 0:
            pieces = search(part, sides[1], (reach, reaches[1]), power)
            found += [rows[i] << 32 | j for i, j in pieces]
        else:
            pieces = search(sides[0], part, (reaches[0], reach), power)
            found += [i << 32 | rows[j] for i, j in pieces]
    pairs = np.sort(np.concatenate(found))
    del found
    for begin in range(0, len(pairs), CANDIDATES_TOGETHER):
        pair = pairs[begin : begin + CANDIDATES_TOGETHER]
        yield pair >> 32, pair & 0xFFFFFFFF


def _taken(side: Side, rows: Ints) -> Side:
    step = side.step[rows]
    at = np.searchsorted(step, np.arange(len(side.at)))
    return replace(side, step=step, at=at, axes=side.axes[:, rows])


def _candidates(a: Side, b: Side, reach: Floats) -> _Candidates:
    """By the fewest axes that leave few, those with the largest spread in reaches first."""
    begin = b.at[a.step]
    found = _Candidates(
        order=np.arange(len(b.step)), begin=begin[None], count=(b.at[a.step + 1] - begin)[None]
    )
    enough = FEW_CANDIDATES * (len(a.step) + len(b.step))
    if found.count.sum() <= enough:
        return found
    least, most = ([of(side.axes, axis=1) for side in (a, b)] for of in (np.min, np.max))
    if np.any(np.maximum(*least) - np.minimum(*most) >= reach):
        return replace(found, count=np.zeros_like(found.count))
    # Halves, whose differences do not overflow.
    low = 0.5 * np.minimum(*least)
    spread = 0.5 * np.maximum(*most) - low
    axes = np.argsort(-spread / reach, kind="stable")[:CELL_AXES]
    for used in range(1, len(axes) + 1):
        found = _by_cells(a, b, axes[:used], (low, spread), reach)
        if found.count.sum() <= enough:
            break
    return found


def _by_cells(
    a: Side, b: Side, axes: Ints, extent: tuple[Floats, Floats], reach: Floats
) -> _Candidates:
    """Candidates by cells along all but the first of the axes, and by finer ones along that.

    A cell of width w has the number floor((x - low) / w) < 2^40, where the quotient is exact to
    2^-12. With n cells to a reach, widened by 2^-10, numbers of near points differ by n at most:
    |x - y| / w + 2^-11 <= n (1 - 2^-10.01) + 2^-11 < n.

    The numbers of all axes and of the step make one key; the margin of an axis keeps its
    neighbours from reaching those of another key. Where a key would have too many bits, or the
    quotient too few, the cells are wider.
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
    asked = np.argsort(key_a)  # bisection is twice as quick for sorted questions
    key_a = key_a[asked]
    begin = np.empty((len(offset), len(key_a)), np.int64)
    count = np.empty_like(begin)
    for run, shift in enumerate(offset.tolist()):
        low_end = np.searchsorted(key_b, key_a + (shift - cells))
        begin[run, asked] = low_end
        count[run, asked] = np.searchsorted(key_b, key_a + (shift + cells + 1)) - low_end
    return _Candidates(order=order, begin=begin, count=count)


def _compared(
    truth: Floats, estimate: Floats, candidates: _Candidates, reach: Floats
) -> Iterator[tuple[Ints, Ints]]:
    """The candidates that are near on every axis (d, R), in order, in pieces."""
    ordered = [y.take(candidates.order) for y in estimate]
    begin, count = candidates.begin, candidates.count
    total = count.sum(axis=0)
    done = np.cumsum(total)
    cuts = np.searchsorted(done, np.arange(0, done[-1], CANDIDATES_TOGETHER), side="right").tolist()
    for lower, upper in pairwise([0, *cuts[1:], len(total)]):
        number = count[:, lower:upper].ravel()
        i = np.repeat(np.tile(np.arange(lower, upper, dtype=np.int64), len(count)), number)
        at = concatenated(begin[:, lower:upper].ravel(), number)
        for x, y, least in zip(truth, ordered, reach.tolist(), strict=True):
            near = np.flatnonzero(np.abs(x.take(i) - y.take(at)) < least)
            i, at = i.take(near), at.take(near)
        pair = np.sort(i << 32 | candidates.order[at])
        yield pair >> 32, pair & 0xFFFFFFFF


def _tree(a: Side, b: Side, step: int, reach: Floats, power: float) -> tuple[Ints, Ints]:
    """Pairs of a step within the reach, and some beyond, by a k-d tree.

    Axes are scaled by powers of two, which is exact, and so that no square overflows. Where their
    reaches differ, that leaves them up to twice as wide as need be.
    """
    from scipy.spatial import KDTree  # here: most evaluations do without SciPy

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
