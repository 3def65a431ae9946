"""Weighted particles of many states in one flat table, independent of files and distances."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated, freeze
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.machine import cores, in_order
from tgospa_eval.errors import InputError

Cloud = tuple[Floats, Floats]
"""Points (N, d) and weights (N,) of one cloud."""

Changed = TypeVar("Changed")

LARGEST_COORDINATE = 1e150
"""Largest coordinate of a particle; its square still fits in a double."""

UNEVEN_SUM = 1e-3
"""Largest difference from 1 of a sum of weights that is normalised without a message."""


def are_normalised(sums: Floats | float, counts: Ints | int) -> Mask:
    """Return a mask of the sums of weights that are 1 up to rounding."""
    return np.asarray(np.abs(np.subtract(sums, 1)) <= np.add(counts, 4) * 2.0**-53)


@dataclass(frozen=True, kw_only=True, eq=False)
class Clouds:
    """Clouds of particles, one for each of the R rows of a table.

    The particles of all clouds are in one array, one cloud after another.

    Parameters
    ----------
    points : (P, d) float array
        Finite positions of all P particles, up to 1e150.
    weights : (P,) float array
        Weights >= 0, which sum to 1 in each cloud up to rounding.
    first : (R + 1,) int array
        Index of the first particle of each cloud, and P at the end. No cloud is empty.

    Raises
    ------
    InputError
        Shapes do not fit, a cloud is empty, a point is not finite or too far, or weights are wrong.
    """

    points: Floats
    weights: Floats
    first: Ints

    def __post_init__(self) -> None:
        for name, kind in (("points", np.float64), ("weights", np.float64), ("first", np.int64)):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=kind))
        freeze(self)
        points, weights, first = self.points, self.weights, self.first
        if points.ndim != 2 or weights.shape != points.shape[:1] or first.ndim != 1:
            raise InputError(
                f"clouds: points {points.shape}, weights {weights.shape} and first {first.shape} "
                "do not fit; use (P, d), (P,) and (R + 1,)"
            )
        ends = len(first) and first[0] == 0 and first[-1] == len(points)
        if not ends or not (np.diff(first) > 0).all():
            raise InputError(
                f"clouds: first must increase strictly from 0 to the {len(points)} particles"
            )
        if not np.isfinite(points).all():
            raise InputError("clouds: points must be finite; leave out other particles")
        if np.abs(points).max(initial=0) > LARGEST_COORDINATE:
            raise InputError(
                f"clouds: a particle is beyond {LARGEST_COORDINATE:g}; use another unit"
            )
        if not (weights >= 0).all() or not np.all(np.abs(self.sums(weights) - 1) <= 1e-6):
            raise InputError("clouds: weights must be >= 0 and sum to 1 in every cloud")

    def __len__(self) -> int:
        return len(self.first) - 1

    def __getitem__(self, row: int) -> Cloud:
        part = slice(self.first[row], self.first[row + 1])
        return self.points[part], self.weights[part]

    @property
    def counts(self) -> Ints:
        """Number of particles of each cloud (R,)."""
        return np.diff(self.first)

    def sums(self, values: Floats) -> Floats:
        """Sum values of the particles (P, ...) over each cloud, to (R, ...)."""
        if not len(self):
            return np.zeros((0, *values.shape[1:]))
        return np.asarray(np.add.reduceat(values, self.first[:-1]))

    @cached_property
    def means(self) -> Floats:
        """Weighted means (R, d), computed from differences to the first particle of each cloud."""
        centre = self.points[self.first[:-1]]
        difference = self.points - np.repeat(centre, self.counts, axis=0)
        return np.asarray(centre + self.sums(self.weights[:, None] * difference))

    @cached_property
    def covariances(self) -> Floats:
        """Weighted covariances (R, d, d), without a correction of the bias."""
        difference = self.points - np.repeat(self.means, self.counts, axis=0)
        size = difference.shape[1]
        matrices = np.empty((len(self), size, size))
        for i in range(size):
            for j in range(i + 1):
                matrices[:, i, j] = matrices[:, j, i] = self.sums(
                    self.weights * difference[:, i] * difference[:, j]
                )
        return matrices

    def chosen(self, rows: Ints) -> "Clouds":
        """Return some of the clouds, in order."""
        counts = self.counts[rows]
        at = concatenated(self.first[:-1][rows], counts)
        first = np.concatenate(([0], np.cumsum(counts)))
        return Clouds(points=self.points[at], weights=self.weights[at], first=first)

    def merged(self) -> "Clouds":
        """Merge equal particles of each cloud, and leave out particles of weight 0."""
        if len(self.points) == len(self):
            return self
        row = np.repeat(np.arange(len(self)), self.counts)
        order = np.lexsort((*self.points.T[::-1], row))
        points, row = self.points[order], row[order]
        fresh = np.ones(len(points), bool)
        fresh[1:] = (row[1:] != row[:-1]) | (points[1:] != points[:-1]).any(axis=1)
        begin = np.flatnonzero(fresh)
        weights = np.add.reduceat(self.weights[order], begin)
        kept = weights > 0
        counts = np.bincount(row[begin[kept]], minlength=len(self))
        return Clouds(
            points=points[begin[kept]],
            weights=weights[kept],
            first=np.concatenate(([0], np.cumsum(counts))),
        )

    def moved(self, points: Floats) -> "Clouds":
        """Return clouds with the same weights at other points."""
        return replace(self, points=points)

    def changed(
        self,
        change: Callable[[Cloud], Changed],
        jobs: int | None,
        passed: Callable[[Iterator[Changed]], Iterator[Cloud]],
    ) -> "Clouds":
        """Apply `change` to each cloud, in `jobs` threads.

        `passed` turns the results, in the order of the clouds, into the new clouds.
        """
        clouds = in_order(lambda row: change(self[row]), range(len(self)), jobs or cores())
        return joined(list(passed(clouds)), self)


def joined(clouds: list[Cloud], like: Clouds) -> Clouds:
    """Join clouds one after another; return `like` if there are none."""
    if not clouds:
        return like
    return Clouds(
        points=np.concatenate([points for points, _ in clouds]),
        weights=np.concatenate([weights for _, weights in clouds]),
        first=np.concatenate(([0], np.cumsum([len(weights) for _, weights in clouds]))),
    )


def single(state: Floats) -> Clouds:
    """Return points (R, d) as clouds of one particle each."""
    return Clouds(points=state, weights=np.ones(len(state)), first=np.arange(len(state) + 1))
