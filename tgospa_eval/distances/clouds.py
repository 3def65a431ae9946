"""Wasserstein distances of particle clouds as base distances: their settings and their near pairs.

W_q is the Wasserstein distance of order q (`distances.transport`). Clouds are scaled once, and
whitened if there is a covariance; after that, the distance of two particles is Euclidean. Two lower
bounds of W_q are cheap. One is the distance of the means m_a and m_b of the clouds, for every q:
``|m_a - m_b| <= W_q``. For the order 2 the Gelbrich bound is larger,

    |m_a - m_b|^2 + B(P_a, P_b)^2  <=  W_2^2,

with the Bures distance B of the covariances P_a and P_b. The Gelbrich bound is the Wasserstein
distance of the Gaussians with these means and covariances. It is equal to W_2 if one cloud is a
point. A pair at the cutoff or beyond has no gain, so transport is solved only for pairs whose
bounds are below the cutoff.

The sliced and the max-sliced Wasserstein distance of clouds X and Y use their projections on V
fixed directions v_k,

    SW_q = (1/V sum_k W_q^q(v_k'X, v_k'Y))^(1/q),      max SW_q = max_k W_q(v_k'X, v_k'Y).

W_q of projections, which have one dimension, is computed by sorting. POT is not needed.
Every W_q is a metric, so both distances satisfy the triangle inequality for any directions. With
all directions of the sphere they would be metrics ([Kolouri]). With V directions they are
pseudometrics, because different clouds may have the same V projections. SW_2^2 is [Prossel]
equation 12. The directions are the same for all pairs and runs.

The means satisfy W_q(v'X, v'Y) >= |v'(m_X - m_Y)|, with equality for points. The directions are a
tight frame, ``sum_k (v_k'x)^2 = V |x|^2 / d``. So two points with the difference x satisfy
``|x| <= sqrt(d) SW_2``, ``|x| <= sqrt(d) max SW``, and, by ``|v_k'x| <= |x|``, ``|x| <= d SW_1``.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.machine import cores, in_order
from tgospa_eval.common.words import counted
from tgospa_eval.distances.base import (
    REACH_ROUNDING,
    Distance,
    DistanceSettings,
    Pairs,
    Resources,
    Sides,
    pair_named,
)
from tgospa_eval.distances.gaussian import bures
from tgospa_eval.distances.mahalanobis import Mahalanobis, cholesky
from tgospa_eval.distances.reduction import Reduction, spread_directions
from tgospa_eval.distances.transport import (
    MAX_PARTICLES,
    Cloud,
    Lines,
    are_alike,
    check_order,
    distance,
    line_costs,
    on_lines,
    plan,
    too_large,
    whitened,
    whitened_points,
)
from tgospa_eval.distances.vector import EUCLIDEAN, Norm
from tgospa_eval.errors import ConfigError, InputError, whole_number
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks import covariances
from tgospa_eval.tracks.clouds import Clouds, single
from tgospa_eval.tracks.trajectories import Trajectories

SLACK = 1e-12
"""Share of the cutoff by which rounding can raise a bound. A pair is excluded only if its bound
exceeds the cutoff by more."""

UNSURE = 1e-11
"""Share of the variances that is subtracted from the square of the Gelbrich bound. It is far above
the rounding of this square."""

BOUNDS_TOGETHER = 1 << 16
"""Number of pairs whose bounds are computed at a time."""

SOON = 250.0
"""Approximate milliseconds of work that a thread does at a time."""

MANY_PARTICLES = 300
"""Number of particles of a cloud above which a message proposes to reduce clouds."""


@dataclass(frozen=True, kw_only=True)
class CloudPairs(Distance):
    """Wasserstein distance of clouds of distinct particles, for the Euclidean inner distance."""

    order: int
    gating: bool
    name = "cloud-wasserstein"

    @property
    def tree_power(self) -> float:
        """Power 2, because the means are compared by their Euclidean distance."""
        return 2.0

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the distance of the means."""
        return EUCLIDEAN.between(components)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the reach of the means."""
        return EUCLIDEAN.reach(cutoff, axes)

    def horizon(self, sides: Sides, cutoff: float) -> float:
        """Return the cutoff plus the rounding of the means; infinity if `gating` is False."""
        if not self.gating:
            return np.inf
        largest = max(float(np.abs(side.state).max(initial=0)) for side in sides)
        return cutoff * (1 + SLACK) + 2.0**-46 * largest

    def refined(self, pairs: Pairs, sides: Sides, cutoff: float, resources: Resources) -> Pairs:
        """Return the near pairs with their distances, from closed forms or from transport."""
        a, b = (side.clouds for side in sides)
        if a is None or b is None:
            return pairs
        i, j, value = pairs.truth_row, pairs.estimate_row, pairs.distance.copy()
        are_points = a.counts[i] == 1, b.counts[j] == 1
        is_open = ~(are_points[0] & are_points[1])
        if self.has_gelbrich_bound:
            spreads = [_traces_and_factors(clouds) for clouds in (a, b)]
            unsolved = np.flatnonzero(is_open)
            for begin in range(0, len(unsolved), BOUNDS_TOGETHER):
                part = unsolved[begin : begin + BOUNDS_TOGETHER]
                value[part] = np.sqrt(value[part] ** 2 + _spread(spreads, i[part], j[part]))
            # If one cloud is a point, the bound is the distance itself.
            is_open &= ~(are_points[0] | are_points[1])
        if self.gating:
            is_open &= value < self.horizon(sides, cutoff)
        at = np.flatnonzero(is_open)
        rows = i[at], j[at]
        sizes = a.counts[rows[0]], b.counts[rows[1]]
        works = self.works(sizes, rows, sides)
        largest = max(int(size.max(initial=0)) for size in sizes)
        what = f"{counted(len(at), 'distance')} of clouds of up to {largest} particles"
        what += f"; {option('reduce', 50)} reduces them" if largest > MANY_PARTICLES else ""
        value[at] = _solved(partial(self.one, (a, b)), rows, works, what, resources)
        near = np.flatnonzero(value < cutoff)
        return Pairs(truth_row=i[near], estimate_row=j[near], distance=value[near])

    @property
    def has_gelbrich_bound(self) -> bool:
        """True if the Gelbrich bound is a lower bound of the distance: for order 2."""
        return self.order == 2

    def works(self, sizes: tuple[Ints, Ints], rows: tuple[Ints, Ints], sides: Sides) -> Floats:
        """Estimate the milliseconds for each pair, by sorting in one dimension or by transport."""
        if len(sides[0].columns) == 1:
            return np.asarray(0.1 + 2e-4 * (sizes[0] + sizes[1]))
        _check_sizes(sizes, rows, sides)
        return np.asarray(0.1 + 2.0 * (sizes[0] * (sizes[1] / 1e4)) ** 1.05)

    def one(self, clouds: tuple[Clouds, Clouds]) -> Callable[[int, int], float]:
        """Return a function of a truth row and an estimate row: the distance of their clouds."""
        return lambda i, j: distance(clouds[0][i], clouds[1][j], self.order)

    def parts(self, pairs: Pairs, sides: Sides) -> tuple[Floats, Floats] | None:
        """Return distances of means, and of clouds moved to the same mean; None for order 1."""
        if self.order != 2:
            return None
        a, b = self.axes(sides[0], pairs.truth_row), self.axes(sides[1], pairs.estimate_row)
        means = np.minimum(self.between(zip(a, b, strict=True)), pairs.distance)
        # A product keeps the digits that a difference of nearly equal squares would lose.
        spreads = np.sqrt((pairs.distance - means) * (pairs.distance + means))
        return means, spreads


class OwnCovariance(CloudPairs):
    """Distance that whitens each pair by the mean covariance of its two clouds."""

    def horizon(self, sides: Sides, cutoff: float) -> float:
        """Return infinity, because the distance of the means is not a bound here."""
        return np.inf

    def refined(self, pairs: Pairs, sides: Sides, cutoff: float, resources: Resources) -> Pairs:
        """Return the near pairs; the Mahalanobis distance of the means excludes pairs first."""
        truth, estimate = sides
        a, b = truth.clouds, estimate.clouds
        if a is None or b is None or not len(pairs.distance):
            return pairs
        i, j = pairs.truth_row, pairs.estimate_row
        covariance = 0.5 * (a.covariances[i] + b.covariances[j])
        value = np.full(len(i), np.inf)
        self.works((a.counts[i], b.counts[j]), (i, j), sides)
        for k, matrix in enumerate(covariance):
            try:
                factor = cholesky(matrix)
            except ConfigError:
                raise InputError(
                    f"{pair_named(sides, i[k], j[k])}: the covariance of the pair is singular, "
                    "as there are too few distinct particles; use "
                    f"{option('inner_cov', 'global')} or {option('inner_cov', metavar='FILE')}"
                ) from None
            difference = whitened_points(truth.state[i[k]][None], factor, estimate.state[j[k]])
            if not self.gating or np.linalg.norm(difference) < cutoff * (1 + SLACK):
                pair = whitened((a[int(i[k])], b[int(j[k])]), factor)
                value[k] = distance(pair[0], pair[1], self.order)
        near = np.flatnonzero(value < cutoff)
        return Pairs(truth_row=i[near], estimate_row=j[near], distance=value[near])


def _traces_and_factors(clouds: Clouds) -> tuple[Floats, Floats]:
    """Return traces (R,) and lower factors (d (d + 1) / 2, R) of the covariances."""
    matrices = clouds.covariances
    traces = np.trace(matrices, axis1=1, axis2=2)
    return traces, covariances.factor(covariances.pack(matrices))


def _spread(spreads: list[tuple[Floats, Floats]], i: Ints, j: Ints) -> Floats:
    """Return, for each pair, a lower bound of W_2^2 minus the squared distance of the means.

    The bounds follow from the covariances of the clouds in the rows `i` and `j`.
    """
    (trace_a, factor_a), (trace_b, factor_b) = spreads
    length = bures(list(zip(factor_a[:, i], factor_b[:, j], strict=True)))
    total = trace_a[i] + trace_b[j]
    is_point = (trace_a[i] == 0) | (trace_b[j] == 0)  # the sum of traces is exact for a point
    return np.where(is_point, total, (length * length - UNSURE * total).clip(min=0))


def _solved(
    one: Callable[[], Callable[[int, int], float]],
    rows: tuple[Ints, Ints],
    works: Floats,
    what: str,
    resources: Resources,
) -> Floats:
    """Compute the distances (N,) of pairs of clouds in threads.

    `one()` returns a function of a truth row and an estimate row: their distance. `works` has the
    approximate milliseconds that each pair takes. `what` names the work, for messages.
    """
    count = len(works)
    if not count:
        return np.zeros(0)
    jobs = min(resources.jobs or cores(), count)
    answer = np.zeros(count)
    # The pieces of work are small, so that the work stops soon after an interrupt.
    step = max(1, min(64, count // (8 * jobs), int(SOON * count / works.sum())))

    def solve(begin: int) -> int:
        between, part = one(), range(begin, min(begin + step, count))
        for k in part:
            answer[k] = between(int(rows[0][k]), int(rows[1][k]))
        return part.stop

    solve(0)  # import errors appear before threads start
    begins = range(step, count, step)
    together = np.add.reduceat(works, np.arange(0, count, step))[1:]
    with resources.stopwatch.showing():
        for done in resources.stopwatch.paced(in_order(solve, begins, jobs), together, what):
            resources.stopwatch.stage = f"distances of clouds, {done:,} of {count:,}"
    return answer


def _check_sizes(sizes: tuple[Ints, Ints], rows: tuple[Ints, Ints], sides: Sides) -> None:
    """Check that no pair has too many particles for its matrix of costs (`MAX_PARTICLES`)."""
    wrong = np.flatnonzero(sizes[0].astype(np.int64) * sizes[1] > MAX_PARTICLES**2)
    if len(wrong):
        k = int(wrong[0])
        which = [f" with {size[k]} particles" for size in sizes]
        raise InputError(f"{pair_named(sides, rows[0][k], rows[1][k], *which)}: {too_large()}")


def slopes_of_particles(
    clouds: tuple[Clouds, Clouds], pairs: Pairs, order: int, factor: Floats | None
) -> Floats:
    """Return the derivative of each pair's distance by each particle of its estimate.

    For true particles x_i, estimated particles y_j, the distance W and the optimal plan pi,

        ``dW/dy_j = W^(1-q) sum_i pi_ij |x_i - y_j|^(q-2) (y_j - x_i)``

    by the envelope theorem, because W^q is a minimum over plans. If several plans are optimal, the
    result is the derivative for one of them. It is 0 where the distance is 0.

    Parameters
    ----------
    clouds : pair of Clouds
        Scaled clouds of truth and estimate.
    pairs : Pairs
        Pairs to compare, with their distances.
    order : {1, 2}
        q.
    factor : (d, d) float array, optional
        Factor L of the covariance L L', if the distance of particles is Mahalanobis.

    Returns
    -------
    (M, d) float array
        Derivatives by the particles of the estimate of each pair, pair after pair.
    """
    slopes = [np.zeros((0, clouds[1].points.shape[1]))]
    near = zip(
        pairs.truth_row.tolist(), pairs.estimate_row.tolist(), pairs.distance.tolist(), strict=True
    )
    for i, j, length in near:
        pair = clouds[0][i], clouds[1][j]
        if length == 0:
            slopes.append(np.zeros_like(pair[1][0]))
            continue
        a, b = pair if factor is None else whitened(pair, factor)
        share = plan(a, b, order)
        if order == 1:
            lengths = np.linalg.norm(a[0][:, None] - b[0], axis=2)
            share = np.divide(share, lengths, out=np.zeros_like(share), where=lengths > 0)
        # sum_i share_ij (y_j - x_i); coordinates relative to one particle keep their digits
        centre = b[0][0]
        moved = share.sum(axis=0)[:, None] * (b[0] - centre) - share.T @ (a[0] - centre)
        moved *= length ** (1 - order)
        slopes.append(moved if factor is None else np.linalg.solve(factor.T, moved.T).T)
    return np.concatenate(slopes)


INNER = ("euclidean", "mahalanobis")


@dataclass(frozen=True, kw_only=True)
class CloudWasserstein(Distance):
    """Wasserstein distance of order q of particle clouds; states without particles are points.

    It is a metric on clouds, also with a Mahalanobis distance of particles, because its covariance
    is the same for all pairs of the run. The order q is independent of the order p of TGOSPA.

    Parameters
    ----------
    order : {1, 2}
        Order q.
    inner : {"euclidean", "mahalanobis"}
        Distance of particles.
    covariance : (d, d) array-like, optional
        Covariance of the inner distance mahalanobis. By default it is the mean of the covariances
        of all clouds of the run. Then only results of the same run are comparable.
    reduction : Reduction, optional
        Reduction of each cloud before it is compared. The distance of reduced clouds is a metric on
        them.
    scale : sequence of float, optional
        Factor of each column, > 0: from its unit to the state unit.
    gating : bool
        If True, the distance is not computed for pairs whose bounds are too large. If False, it is
        computed for every pair of a step; this serves as a check.

    Raises
    ------
    ConfigError
        The order or inner distance is unknown, a covariance or scale is wrong, or a covariance is
        given without mahalanobis.
    """

    order: int = 2
    inner: str = "euclidean"
    covariance: ArrayLike | None = None
    reduction: Reduction | None = None
    scale: Sequence[float] | None = None
    gating: bool = True
    name = "cloud-wasserstein"
    options = (
        *("scale", "cloud_order", "inner", "inner_cov", "no_gating", "reduce", "reduce_method"),
        *("directions", "iterations", "restarts", "polish", "seed"),
    )

    def __post_init__(self) -> None:
        check_order(self.order)
        if self.inner not in INNER:
            raise ConfigError(f"inner is {quoted(self.inner)}: must be one of {', '.join(INNER)}")
        if not isinstance(self.reduction, Reduction | None):
            raise ConfigError(f"reduction is {self.reduction!r}: must be a Reduction(size=...)")
        if self.covariance is not None and self.inner != "mahalanobis":
            raise ConfigError("a covariance of particles needs the inner distance mahalanobis")
        # This checks scale and covariance, and makes them tuples.
        for name in ("scale", "covariance"):
            if hasattr(self.inner_of_means, name):
                object.__setattr__(self, name, getattr(self.inner_of_means, name))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Particle clouds."""
        return ("cloud",)

    @property
    def lower_bound(self) -> Distance:
        """The inner distance of the means."""
        return self.inner_of_means

    @property
    def inner_of_means(self) -> Distance:
        """The inner distance, for points."""
        if self.covariance is not None:
            return Mahalanobis(covariance=self.covariance, scale=self.scale)
        return Norm(name="euclidean", power=2.0, scale=self.scale)

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the distance of points, or of the means of clouds."""
        return self.inner_of_means.between(components)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the reach of the distance of the means."""
        return self.inner_of_means.reach(cutoff, axes)

    def check_columns(self, columns: tuple[str, ...], name: str) -> None:
        """Check that covariance and scale fit the number of columns."""
        self.inner_of_means.check_columns(columns, name)

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """Return order, inner distance and reduction by the names of the options."""
        record: DistanceSettings = {"cloud_order": self.order, "inner": self.inner}
        if self.covariance is not None:
            record["inner_cov"] = np.asarray(self.covariance).tolist()
        record |= super().settings(columns)
        if self.reduction is not None:
            record |= self.reduction.settings()
        return record

    def fitted(self, sides: Sides) -> "CloudWasserstein":
        """Return the distance; the default covariance is the mean of those of all clouds."""
        if self.inner != "mahalanobis" or self.covariance is not None:
            return self
        spreads = [side.clouds.covariances for side in sides if side.clouds is not None]
        if not any(len(side.step) for side in sides):
            return self  # nothing to compare
        if not spreads:
            raise ConfigError(
                "the inner distance mahalanobis needs the mean covariance of the clouds, but "
                f"there are no clouds; give a covariance with {option('inner_cov', metavar='FILE')}"
            )
        matrices = np.concatenate(spreads)
        mean = matrices.mean(axis=0) * np.multiply.outer(*2 * [np.array(self.scale or 1.0)])
        try:
            return replace(self, covariance=mean)
        except ConfigError:
            raise InputError(
                "the mean covariance of the clouds is singular, as there are too few distinct "
                "particles for the inner distance mahalanobis; give a covariance with "
                f"{option('inner_cov', metavar='FILE')}"
            ) from None

    def prepared(self, sides: Sides, resources: Resources) -> tuple[Sides, Distance]:
        """Scale, reduce, merge and whiten the clouds; the inner distance is then Euclidean."""
        centre = np.concatenate([side.state[:1] for side in sides])[:1]
        factor = None if self.covariance is None else cholesky(self.covariance)
        ready = []
        for side in sides:
            clouds = self._scaled(side)
            if self.reduction is not None:
                clouds = reduced(clouds, self.reduction, resources)
            clouds = clouds.merged()
            if factor is not None and len(clouds):
                clouds = clouds.moved(whitened_points(clouds.points, factor, centre[0]))
            ready.append(side.with_clouds(clouds))
        return (ready[0], ready[1]), self._measure(len(sides[0].columns))

    def particle_slopes(self, pairs: Pairs, sides: Sides) -> Floats:
        """Return derivatives by the envelope theorem, for a fixed optimal plan and fixed weights.

        Raises
        ------
        ConfigError
            The clouds are reduced.
        """
        if self.reduction is not None:
            raise ConfigError(
                "no derivative is known for reduced clouds: evaluate without reduce, or reduce the "
                "clouds before"
            )
        scale = np.ones(sides[1].state.shape[1]) if self.scale is None else np.asarray(self.scale)
        factor = None if self.covariance is None else cholesky(self.covariance)
        clouds = self._scaled(sides[0]), self._scaled(sides[1])
        return slopes_of_particles(clouds, pairs, self.order, factor) * scale

    def _scaled(self, side: Trajectories) -> Clouds:
        clouds = single(side.state) if side.clouds is None else side.clouds
        return clouds if self.scale is None else clouds.moved(clouds.points * self.scale)

    def _measure(self, size: int) -> Distance:
        """Return the distance of prepared clouds."""
        return CloudPairs(order=self.order, gating=self.gating)


@dataclass(frozen=True, kw_only=True)
class PairCloudWasserstein(CloudWasserstein):
    """Wasserstein distance of clouds, whitened by the mean covariance of the two clouds.

    It is not a metric: it is for the association of single pairs, never for TGOSPA.
    """

    inner: str = "mahalanobis"

    def fitted(self, sides: Sides) -> "PairCloudWasserstein":
        """Return the same distance: every pair has its own covariance."""
        return self

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """Return the settings of clouds, with "pair" as the covariance."""
        return {**super().settings(columns), "inner_cov": "pair"}

    def _measure(self, size: int) -> Distance:
        return OwnCovariance(order=self.order, gating=self.gating)


def reduced(
    clouds: Clouds,
    reduction: Reduction,
    resources: Resources,
    histories: list[list[float]] | None = None,
) -> Clouds:
    """Reduce every cloud, and notify the user if that takes long.

    `histories` receives a list for each cloud: the distances from its reduction to the cloud,
    before each iteration.
    """
    is_large = clouds.counts > reduction.size
    if not is_large.any():
        return clouds
    what = counted(int(np.count_nonzero(is_large)), "cloud")
    works = (clouds.counts * is_large).tolist()

    def passed(reductions: Iterator[tuple[Cloud, list[float]]]) -> Iterator[Cloud]:
        for cloud, history in resources.stopwatch.paced(reductions, works, f"{what} to reduce"):
            if histories is not None:
                histories.append(history)
            yield cloud

    with resources.stopwatch.showing(f"reducing {what}"):
        return clouds.changed(reduction.trace, resources.jobs, passed)


@lru_cache(maxsize=8)
def fixed_directions(size: int, count: int | None, seed: int) -> Floats:
    """Return V unit vectors (V, d) of a tight frame; equal arguments give equal vectors."""
    directions = spread_directions(size, count, np.random.default_rng(seed))
    directions.flags.writeable = False
    return directions


@dataclass(frozen=True, kw_only=True, eq=False)
class SlicedPairs(CloudPairs):
    """Sliced or max-sliced distance of clouds of distinct particles, with V directions (V, d)."""

    directions: Floats
    maximum: bool

    @property
    def has_gelbrich_bound(self) -> bool:
        """False, because the Gelbrich bound is for the Wasserstein distance, which is larger."""
        return False

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the distance of the means."""
        differences, total = [a - b for a, b in components], np.zeros(())
        for direction in self.directions:  # one by one, to save memory if there are many pairs
            size = np.abs(sum(v * part for v, part in zip(direction, differences, strict=True)))
            total = np.maximum(total, size) if self.maximum else total + size**self.order
        whole = total if self.maximum else (total / len(self.directions)) ** (1 / self.order)
        return np.asarray(whole)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the reach of the means: the largest Euclidean distance that near clouds allow."""
        size = float(len(axes))
        factor = size if self.order == 1 and not self.maximum else np.sqrt(size)
        return super().reach(cutoff * factor * (1 + REACH_ROUNDING), axes)

    def works(self, sizes: tuple[Ints, Ints], rows: tuple[Ints, Ints], sides: Sides) -> Floats:
        """Estimate the work of sorting along each direction."""
        return np.asarray(0.05 + 5e-5 * len(self.directions) * (sizes[0] + sizes[1]))

    def one(self, clouds: tuple[Clouds, Clouds]) -> Callable[[int, int], float]:
        """Return a function as in `CloudPairs.one`; it stores sorted projections of clouds."""
        centre = clouds[0].points[0]  # coordinates relative to it keep their digits in sums
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
        """Return the parts as `CloudPairs` does; None for order 1 and for the maximum."""
        return None if self.maximum else super().parts(pairs, sides)


@dataclass(frozen=True, kw_only=True)
class SlicedWasserstein(CloudWasserstein):
    """Wasserstein distances of projections of clouds: their mean of order q, or the largest.

    It is a pseudometric on clouds: with finitely many directions, different clouds may have the
    distance 0. Sorting computes it exactly; POT is not needed. Let two points have the Euclidean
    distance r. The distance of this class is r / sqrt(d) with q = 2, and smaller with q = 1. If
    `maximum` is True, it is larger, up to r.

    Parameters
    ----------
    order, inner, covariance, reduction, scale, gating
        As in `CloudWasserstein`; directions are in the space of the inner distance.
    maximum : bool
        True for the largest distance over the directions (max-sliced), False for the mean.
    directions : int, optional
        Number V of directions, at least 2. In two dimensions the default is 32, and direction k
        from 0 has the angle pi (k + 1/2) / V. In d > 2 dimensions the default is 24 d, and V is
        rounded up to whole orthonormal frames.
    seed : int
        Seed of the frames.

    Raises
    ------
    ConfigError
        A setting is wrong (see `CloudWasserstein`), a number is out of range, or directions or seed
        differ from those of the reduction.
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
                    f"{name} is {getattr(self, name)}, but {other[name]} in the reduction: must "
                    "be the same"
                )

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name as on the command line."""
        return "max-sliced-wasserstein" if self.maximum else "sliced-wasserstein"

    @property
    def lower_bound(self) -> Distance:
        """The distance itself, which is cheap for means."""
        return self

    def _measure(self, size: int) -> SlicedPairs:
        return SlicedPairs(
            order=self.order,
            gating=self.gating,
            directions=fixed_directions(size, self.directions, self.seed),
            maximum=self.maximum,
        )

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the distance of points, or of the means of clouds."""
        pairs = list(components)
        measure = self._measure(len(pairs))
        lines = measure.directions
        if self.covariance is not None:
            lines = np.asarray(np.linalg.solve(cholesky(self.covariance).T, lines.T).T)
        if self.scale is not None:
            lines = lines * np.asarray(self.scale)
        return replace(measure, directions=lines).between(pairs)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the reach of the distance of the means."""
        ratio = self._measure(len(axes)).reach(1.0, axes)
        return self.inner_of_means.reach(cutoff * float(ratio[0, 0]), axes)

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """Return the settings of clouds, and the directions."""
        count = len(self._measure(len(columns)).directions)
        return super().settings(columns) | {"directions": count, "seed": self.seed}

    def particle_slopes(self, pairs: object, sides: object) -> NoReturn:
        """Raise an error, because no derivative is known.

        Raises
        ------
        ConfigError
            Always.
        """
        raise ConfigError(f"the distance {self.name} has no known derivative")


MAX_SLICED = SlicedWasserstein(maximum=True)
