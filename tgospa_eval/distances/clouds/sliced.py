"""Sliced and max-sliced Wasserstein distance of particle clouds, over fixed directions.

    SW_q = (1/V sum_k W_q^q(v_k'X, v_k'Y))^(1/q),      max SW_q = max_k W_q(v_k'X, v_k'Y),

with W_q of the projections in one dimension, which sorting solves: no transport, no extra. Every
W_q is a metric, so that both keep the triangle inequality over any directions; over all of the
sphere they are metrics ([Kolouri]), over V of them pseudometrics, for different clouds may have the
same V projections. SW_2^2 is [Prossel] equation 12. The directions are the same for all pairs and
runs.

Of the means W_q(v'X, v'Y) >= |v'(m_X - m_Y)|, with equality for points. The directions are a tight
frame, ``sum_k (v_k'x)^2 = V |x|^2 / d``, from which ``|x| <= sqrt(d) SW_2`` of two points at the
difference x, ``|x| <= sqrt(d) max SW``, and with ``|v_k'x| <= |x|`` also ``|x| <= d SW_1``.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache
from typing import NoReturn

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.base import REACH_ROUNDING, Distance, DistanceSettings, Pairs, Sides
from tgospa_eval.distances.clouds.distance import CloudPairs, CloudWasserstein
from tgospa_eval.distances.clouds.reduction import spread_directions
from tgospa_eval.distances.clouds.transport import Lines, are_alike, line_costs, on_lines
from tgospa_eval.distances.mahalanobis import cholesky
from tgospa_eval.errors import ConfigError, whole_number
from tgospa_eval.tracks.clouds import Clouds


@lru_cache(maxsize=8)
def fixed_directions(size: int, count: int | None, seed: int) -> Floats:
    """Unit vectors (V, d) that are a tight frame, the same for the same numbers."""
    found = spread_directions(size, count, np.random.default_rng(seed))
    found.flags.writeable = False
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class SlicedPairs(CloudPairs):
    """Of clouds of distinct particles, in the space of the directions (V, d)."""

    directions: Floats
    maximum: bool

    @property
    def has_moments_bound(self) -> bool:
        """It bounds the whole distance, which is larger."""
        return False

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Distance of the means."""
        apart, total = [a - b for a, b in components], np.zeros(())
        for direction in self.directions:  # one after the other: there may be many pairs
            size = np.abs(sum(v * part for v, part in zip(direction, apart, strict=True)))
            total = np.maximum(total, size) if self.maximum else total + size**self.order
        whole = total if self.maximum else (total / len(self.directions)) ** (1 / self.order)
        return np.asarray(whole)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """That of the Euclidean distance that two means may have."""
        size = float(len(axes))
        factor = size if self.order == 1 and not self.maximum else np.sqrt(size)
        return super().reach(cutoff * factor * (1 + REACH_ROUNDING), axes)

    def works(self, sizes: tuple[Ints, Ints], rows: tuple[Ints, Ints], sides: Sides) -> Floats:
        """Of sorting along each direction."""
        return np.asarray(0.05 + 5e-5 * len(self.directions) * (sizes[0] + sizes[1]))

    def one(self, clouds: tuple[Clouds, Clouds]) -> Callable[[int, int], float]:
        """Each cloud is sorted once for neighbouring pairs."""
        centre = clouds[0].points[0]  # sums of small numbers keep their digits
        known: dict[tuple[int, int], Lines] = {}

        def lines(side: int, row: int) -> Lines:
            if (side, row) not in known:
                points, weights = clouds[side][row]
                known[side, row] = on_lines((points - centre, weights), self.directions)
            return known[side, row]

        def between(i: int, j: int) -> float:
            if are_alike(clouds[0][i], clouds[1][j]):
                return 0.0
            costs = line_costs(lines(0, i), lines(1, j), self.order)
            return float((costs.max() if self.maximum else costs.mean()) ** (1 / self.order))

        return between

    def parts(self, pairs: Pairs, sides: Sides) -> tuple[Floats, Floats] | None:
        """Of order 2, where squares of means and of spreads add up along each direction."""
        return None if self.maximum else super().parts(pairs, sides)


@dataclass(frozen=True, kw_only=True)
class SlicedWasserstein(CloudWasserstein):
    """Wasserstein distance of the projections of clouds, mean of order q or largest of all.

    A pseudometric on clouds: over finitely many directions different clouds may be at the distance
    0. Exactly computed, by sorting; POT is not needed. Two points at the Euclidean distance r are
    r / sqrt(d) apart with q = 2, less with q = 1, and more, up to r, by the largest.

    Parameters
    ----------
    order, inner, covariance, reduction, scale, gating
        As of `CloudWasserstein`; directions are taken in the space of the inner distance.
    maximum : bool
        The largest over the directions, max-sliced, instead of the mean.
    directions : int, optional
        How many, >= 2; by default 32 in two dimensions and 24 d in more, where they are rounded up
        to whole orthonormal frames. In two dimensions their angles are pi (k + 1/2) / V, V >= 2.
    seed : int
        Of the frames.

    Raises
    ------
    ConfigError
        As of `CloudWasserstein`, or a number is out of range, or the reduction has others.
    """

    maximum: bool = False
    directions: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        whole_number("seed", self.seed, 0)
        if self.directions is not None:
            whole_number("directions", self.directions, 2)
        other = {} if self.reduction is None else self.reduction.settings()
        for name in ("directions", "seed"):
            if name in other and other[name] != getattr(self, name):
                raise ConfigError(
                    f"{name} is {getattr(self, name)}, and {other[name]} of the reduction: must be "
                    "the same"
                )

    @property
    def name(self) -> str:  # type: ignore[override]
        """As on the command line."""
        return "max-sliced-wasserstein" if self.maximum else "sliced-wasserstein"

    @property
    def lower_bound(self) -> Distance:
        """Itself, which is cheap for means."""
        return self

    def _measure(self, size: int) -> SlicedPairs:
        return SlicedPairs(
            order=self.order,
            gating=self.gating,
            directions=fixed_directions(size, self.directions, self.seed),
            maximum=self.maximum,
        )

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Distance of points, as states alone are; of clouds the distance of their means."""
        pairs = list(components)
        measure = self._measure(len(pairs))
        lines = measure.directions
        if self.covariance is not None:
            lines = np.asarray(np.linalg.solve(cholesky(self.covariance).T, lines.T).T)
        if self.scale is not None:
            lines = lines * np.asarray(self.scale)
        return replace(measure, directions=lines).between(pairs)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """That of the distance of the means."""
        ratio = self._measure(len(axes)).reach(1.0, axes)
        return self.inner_of_means.reach(cutoff * float(ratio[0, 0]), axes)

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """As of clouds, and the directions."""
        count = len(self._measure(len(columns)).directions)
        return super().settings(columns) | {"directions": count, "seed": self.seed}

    def particle_slopes(self, pairs: object, sides: object) -> NoReturn:
        """None is known.

        Raises
        ------
        ConfigError
            Always.
        """
        raise ConfigError(f"no derivative is known of the distance {self.name}")


MAX_SLICED = SlicedWasserstein(maximum=True)
