"""Which pairs of one step are nearer than the cutoff: memory for the near pairs only.

Steps with few pairs are compared all at once, in pieces; a step with many gets a k-d tree. The
small table is faster than a tree up to some thousand pairs and does without importing SciPy.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.distances.vector import Floats, Norm
from tgospa_eval.trajectories import Ints, Trajectories

TABLE = 40_000
"""Pairs of one step that are compared in a table."""

SAMPLE = 100
"""Steps, and truths of a step, whose nearest estimate is looked at for a notice."""

PIECE = 1 << 20
"""Pairs compared at a time."""


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Near pairs, sorted by (step, truth, estimate).

    Parameters
    ----------
    truth_row, estimate_row : (N,) int arrays
        Rows of the two tables.
    distance : (N,) float array
        Base distance, less than the cutoff.
    """

    truth_row: Ints
    estimate_row: Ints
    distance: Floats


# Differences and sums of huge coordinates may overflow: infinitely far is right.
@np.errstate(over="ignore", invalid="ignore")
def near_pairs(truth: Trajectories, estimate: Trajectories, cutoff: float, norm: Norm) -> Pairs:
    """All pairs of one step that are nearer than `cutoff`; both must be on the same times."""
    every = np.arange(len(truth.times) + 1)
    truth_at = np.searchsorted(truth.step, every)
    estimate_at = np.searchsorted(estimate.step, every)
    sizes = np.diff(truth_at) * np.diff(estimate_at)
    found: list[tuple[Ints, Ints, Floats]] = []
    for steps in _pieces(sizes):
        if sizes[steps[0]] > TABLE:
            k = int(steps[0])
            rows = _tree(
                truth.state[truth_at[k] : truth_at[k + 1]],
                estimate.state[estimate_at[k] : estimate_at[k + 1]],
                cutoff,
                norm,
            )
            i, j = truth_at[k] + rows[0], estimate_at[k] + rows[1]
        else:
            i, j = _table(truth_at, estimate_at, sizes, steps)
            for axis in range(truth.state.shape[1]):  # no norm is below any one difference
                apart = truth.state[i, axis] - estimate.state[j, axis]
                close = np.abs(apart) < cutoff
                i, j = i[close], j[close]
        distance = norm(truth.state[i], estimate.state[j])
        near = distance < cutoff
        found.append((i[near], j[near], distance[near]))
    if not found:
        empty = np.zeros(0, np.int64)
        return Pairs(truth_row=empty, estimate_row=empty, distance=np.zeros(0))
    truth_row, estimate_row, distance = (np.concatenate(part) for part in zip(*found, strict=True))
    return Pairs(truth_row=truth_row, estimate_row=estimate_row, distance=distance)


def _pieces(sizes: NDArray[np.int64]) -> Iterator[Ints]:
    """Runs of steps whose tables fit in one piece; a step with a large table is alone."""
    steps = np.flatnonzero(sizes)
    large = sizes[steps] > TABLE
    filled = np.cumsum(np.where(large, PIECE, sizes[steps])) // PIECE
    cut = (np.diff(filled) > 0) | large[1:] | large[:-1]
    yield from (piece for piece in np.split(steps, np.flatnonzero(cut) + 1) if len(piece))


def _table(truth_at: Ints, estimate_at: Ints, sizes: Ints, steps: Ints) -> tuple[Ints, Ints]:
    """Rows of all pairs of the steps."""
    step = np.repeat(steps, sizes[steps])
    offset = np.arange(len(step)) - np.repeat(np.cumsum(sizes[steps]) - sizes[steps], sizes[steps])
    width = np.diff(estimate_at)[step]
    return truth_at[step] + offset // width, estimate_at[step] + offset % width


def _tree(a: Floats, b: Floats, cutoff: float, norm: Norm) -> tuple[Ints, Ints]:
    """Rows of the pairs within the cutoff, and some of rounding beyond, by a k-d tree."""
    from scipy.spatial import KDTree  # here: small evaluations do without SciPy

    exponent = math.frexp(cutoff)[1]  # exact scaling, so that no square overflows
    near = KDTree(np.ldexp(a, -exponent)).sparse_distance_matrix(
        KDTree(np.ldexp(b, -exponent)),
        math.ldexp(cutoff, -exponent) * (1 + 1e-9),
        p=norm.power,
        output_type="ndarray",
    )
    order = np.lexsort((near["j"], near["i"]))
    return near["i"][order], near["j"][order]


@np.errstate(over="ignore", invalid="ignore")
def median_nearest(truth: Trajectories, estimate: Trajectories, norm: Norm) -> float | None:
    """Median distance from a truth to the nearest estimate of its step, over up to 100 steps.

    None if no step has both. Both sides must be on the same times.
    """
    both = np.intersect1d(truth.step, estimate.step)
    if not len(both):
        return None
    nearest = []
    for step in both[:: -(-len(both) // SAMPLE)]:
        a, b = (
            side.state[slice(*np.searchsorted(side.step, (step, step + 1)))]
            for side in (truth, estimate)
        )
        a = a[:: -(-len(a) // SAMPLE)]
        nearest.append(norm(a[:, None], b[None, :]).min(axis=1))
    return float(np.median(np.concatenate(nearest)))
