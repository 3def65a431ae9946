"""Wasserstein distance of particle clouds as base distance: bounds first, transport for the rest.

Two bounds cost next to nothing: the distance of the means, ``|m_a - m_b| <= W_q`` for every q, and
of order 2 the Gelbrich bound, the Wasserstein distance of the normal laws with the same moments,

    |m_a - m_b|^2 + B(P_a, P_b)^2  <=  W_2^2,

with the Bures distance B of their covariances; it is attained where one cloud is a point. A pair at
the cutoff or beyond it gains nothing, so that only pairs whose bounds are below it are solved.
"""

import os
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tgospa_eval import covariances
from tgospa_eval.clouds import Clouds, single
from tgospa_eval.distances.base import Distance, Effort, Floats, Pairs
from tgospa_eval.distances.gaussian import bures
from tgospa_eval.distances.mahalanobis import Mahalanobis, cholesky
from tgospa_eval.distances.reduction import Reduction
from tgospa_eval.distances.transport import LARGEST, check_order, distance, whitened
from tgospa_eval.distances.vector import Norm
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.trajectories import Ints, Trajectories

INNER = ("euclidean", "mahalanobis")

SLACK = 1e-12
"""Of the cutoff: a bound that is above it by rounding alone decides nothing."""

UNSURE = 1e-11
"""Of the variances: what rounding may add to the Gelbrich bound, and far more."""

TOGETHER = 1 << 16
"""Pairs whose bounds are computed at a time."""

PATIENCE = 2.0
"""Seconds of work from which on the user is told how long it will take."""

MANY = 300
"""Particles from which on reducing them is worth a hint."""


@dataclass(frozen=True, kw_only=True)
class CloudWasserstein(Distance):
    """Wasserstein distance of order q of the particle clouds; states without particles are points.

    A metric on clouds, also with a Mahalanobis distance of particles, because its covariance is
    the same for all pairs of the run. The order q has nothing to do with the order p of TGOSPA.

    Parameters
    ----------
    order : {1, 2}
        q.
    inner : {"euclidean", "mahalanobis"}
        Distance of particles.
    covariance : (d, d) array-like, optional
        Of mahalanobis. Without it, the mean of the covariances of all clouds of the run: such
        results are comparable within a run only.
    reduction : Reduction, optional
        Clouds are reduced first, each once. The distance of the reduced clouds is a metric on them.
    scale : sequence of float, optional
        State units per unit of each column, > 0.
    gating : bool
        Without, every pair of a step is solved; to check that nothing else changes.

    Raises
    ------
    ConfigError
        A setting has no meaning.
    """

    order: int = 2
    inner: str = "euclidean"
    covariance: ArrayLike | None = None
    reduction: Reduction | None = None
    scale: Sequence[float] | None = None
    gating: bool = True
    name = "cloud-wasserstein"

    def __post_init__(self) -> None:
        check_order(self.order)
        if self.inner not in INNER:
            raise ConfigError(f'inner is "{self.inner}": must be one of {", ".join(INNER)}')
        if self.covariance is not None and self.inner != "mahalanobis":
            raise ConfigError("a covariance of particles needs the inner distance mahalanobis")
        # Checks scale and covariance, and keeps them as tuples.
        for name in ("scale", "covariance"):
            if hasattr(self.rough, name):
                object.__setattr__(self, name, getattr(self.rough, name))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Clouds."""
        return ("cloud",)

    @property
    def rough(self) -> Distance:
        """The inner distance of the means, a lower bound."""
        if self.covariance is not None:
            return Mahalanobis(covariance=self.covariance, scale=self.scale)
        return Norm(name="euclidean", power=2.0, scale=self.scale)

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Distance of points, as states alone are; of clouds the distance of their means."""
        return self.rough.between(components)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """That of the distance of the means."""
        return self.rough.reach(cutoff, axes)

    def check_columns(self, columns: tuple[str, ...], name: str) -> None:
        """Whether covariance and scale are for so many columns."""
        self.rough.check_columns(columns, name)

    def settings(self, columns: tuple[str, ...]) -> dict[str, Any]:
        """Order, inner distance and reduction by the names of the options."""
        found: dict[str, Any] = {"cloud_order": self.order, "inner": self.inner}
        if self.covariance is not None:
            found["inner_cov"] = np.asarray(self.covariance).tolist()
        if self.scale is not None:
            found["scale"] = dict(zip(columns, self.scale, strict=True))
        if self.reduction is not None:
            found |= self.reduction.settings()
        return found

    def fitted(self, truth: Trajectories, estimate: Trajectories) -> "CloudWasserstein":
        """With the mean covariance of all clouds, where it is wanted and not given."""
        if self.inner != "mahalanobis" or self.covariance is not None:
            return self
        spreads = [side.clouds.covariances for side in (truth, estimate) if side.clouds is not None]
        if not any(len(side.step) for side in (truth, estimate)):
            return self  # nothing to compare
        if not spreads:
            raise ConfigError(
                "the inner distance mahalanobis takes the mean covariance of the clouds, and there "
                "are none; name one with --inner-cov FILE"
            )
        matrices = np.concatenate(spreads)
        mean = matrices.mean(axis=0) * np.multiply.outer(*2 * [np.array(self.scale or 1.0)])
        try:
            return replace(self, covariance=mean)
        except ConfigError:
            raise InputError(
                "the mean covariance of the clouds is singular, too few distinct particles for the "
                "inner distance mahalanobis; name one with --inner-cov FILE"
            ) from None

    def prepared(
        self, truth: Trajectories, estimate: Trajectories, effort: Effort
    ) -> tuple[Trajectories, Trajectories, Distance]:
        """Scaled, reduced, whitened, and coincident particles merged: then Euclidean."""
        centre = np.concatenate((truth.state[:1], estimate.state[:1]))[:1]
        factor = None
        if self.covariance is not None:
            factor = cholesky(self.covariance)
        sides = []
        for side in (truth, estimate):
            clouds = single(side.state) if side.clouds is None else side.clouds
            if self.scale is not None:
                clouds = clouds.moved(clouds.points * np.asarray(self.scale))
            if self.reduction is not None:
                clouds = reduced(clouds, self.reduction, effort)
            if factor is not None and len(clouds):
                clouds = clouds.moved(_whitened(clouds.points, factor, centre))
            sides.append(side.with_clouds(clouds.merged()))
        return sides[0], sides[1], self._measure()

    def _measure(self) -> Distance:
        """Of clouds as they are prepared."""
        return _Plain(order=self.order, gating=self.gating)


@dataclass(frozen=True, kw_only=True)
class PairCloudWasserstein(CloudWasserstein):
    """With a covariance of each pair, the mean of those of its two clouds: no metric.

    It is for the association of single pairs, never for TGOSPA.
    """

    inner: str = "mahalanobis"

    def fitted(self, truth: Trajectories, estimate: Trajectories) -> "PairCloudWasserstein":
        """As it is: every pair has its own."""
        del truth, estimate
        return self

    def settings(self, columns: tuple[str, ...]) -> dict[str, Any]:
        """As of other clouds, with the word for it."""
        return {**super().settings(columns), "inner_cov": "pair"}

    def _measure(self) -> Distance:
        return _Pairwise(order=self.order, gating=self.gating)


@dataclass(frozen=True, kw_only=True)
class _Plain(Distance):
    """Of clouds of distinct particles, Euclidean."""

    order: int
    gating: bool
    name = "cloud-wasserstein"

    @property
    def tree_power(self) -> float:
        return 2.0

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        return _EUCLIDEAN.between(components)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        return _EUCLIDEAN.reach(cutoff, axes)

    def horizon(self, truth: Trajectories, estimate: Trajectories, cutoff: float) -> float:
        """The cutoff and what rounding of the means may add."""
        if not self.gating:
            return np.inf
        largest = max(float(np.abs(side.state).max(initial=0)) for side in (truth, estimate))
        return cutoff * (1 + SLACK) + 2.0**-46 * largest

    def refined(
        self,
        pairs: Pairs,
        truth: Trajectories,
        estimate: Trajectories,
        cutoff: float,
        effort: Effort,
    ) -> Pairs:
        """Near pairs with their distances: closed forms first, then what bounds leave open."""
        a, b = truth.clouds, estimate.clouds
        if a is None or b is None:
            return pairs
        i, j, value = pairs.truth_row, pairs.estimate_row, pairs.distance.copy()
        are_points = a.counts[i] == 1, b.counts[j] == 1
        is_open = ~(are_points[0] & are_points[1])
        if self.order == 2:
            moments = [_Moments.of(clouds) for clouds in (a, b)]
            for part in _parts(np.flatnonzero(is_open)):
                spread = moments[0].spread(moments[1], i[part], j[part])
                value[part] = np.sqrt(value[part] ** 2 + spread)
            # With a point the bound is the distance itself.
            is_open &= ~(are_points[0] | are_points[1])
        if self.gating:
            is_open &= value < self.horizon(truth, estimate, cutoff)
        rows = np.flatnonzero(is_open)
        value[rows] = _solved((a, b), (i[rows], j[rows]), self.order, (truth, estimate), effort)
        near = np.flatnonzero(value < cutoff)
        return Pairs(truth_row=i[near], estimate_row=j[near], distance=value[near])

    def parts(
        self, pairs: Pairs, truth: Trajectories, estimate: Trajectories
    ) -> tuple[Floats, Floats] | None:
        """Of order 2: distances of the means, and of the clouds moved onto one mean."""
        if self.order != 2:
            return None
        a, b = self.axes(truth, pairs.truth_row), self.axes(estimate, pairs.estimate_row)
        means = np.minimum(self.between(zip(a, b, strict=True)), pairs.distance)
        # As a product: a difference of squares would lose what is left of nearly equal ones.
        spreads = np.sqrt((pairs.distance - means) * (pairs.distance + means))
        return means, spreads


@dataclass(frozen=True, kw_only=True)
class _Pairwise(_Plain):
    """With the mean covariance of the pair."""

    def horizon(self, truth: Trajectories, estimate: Trajectories, cutoff: float) -> float:
        """Any pair of a step: the distance of means bounds nothing here."""
        del truth, estimate, cutoff
        return np.inf

    def refined(
        self,
        pairs: Pairs,
        truth: Trajectories,
        estimate: Trajectories,
        cutoff: float,
        effort: Effort,
    ) -> Pairs:
        """Near pairs, bounded by the Mahalanobis distances of their means."""
        del effort
        a, b = truth.clouds, estimate.clouds
        if a is None or b is None or not len(pairs.distance):
            return pairs
        i, j = pairs.truth_row, pairs.estimate_row
        covariance = 0.5 * (a.covariances[i] + b.covariances[j])
        value = np.full(len(i), np.inf)
        _check_sizes([a.counts[i], b.counts[j]], (i, j), (truth, estimate))
        for k, matrix in enumerate(covariance):
            try:
                factor = cholesky(matrix)
            except ConfigError:
                raise InputError(
                    f'id "{truth.ids[truth.track[i[k]]]}" and id '
                    f'"{estimate.ids[estimate.track[j[k]]]}" at t '
                    f"{truth.shown[truth.step[i[k]]]}: the covariance of the pair is singular, too "
                    "few distinct particles; take --inner-cov global or a file"
                ) from None
            apart = _whitened(truth.state[i[k]][None], factor, estimate.state[j[k]][None])
            if not self.gating or np.linalg.norm(apart) < cutoff * (1 + SLACK):
                pair = whitened((a[int(i[k])], b[int(j[k])]), factor)
                value[k] = distance(pair[0], pair[1], self.order)
        near = np.flatnonzero(value < cutoff)
        return Pairs(truth_row=i[near], estimate_row=j[near], distance=value[near])


_EUCLIDEAN = Norm(name="euclidean", power=2.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Moments:
    """Traces (R,) and lower factors (d (d + 1) / 2, R) of the covariances."""

    trace: Floats
    factor: Floats

    @classmethod
    def of(cls, clouds: Clouds) -> "_Moments":
        covariance = clouds.covariances
        return cls(
            trace=np.trace(covariance, axis1=1, axis2=2),
            factor=covariances.factor(covariances.pack(covariance)),
        )

    def spread(self, other: "_Moments", i: Ints, j: Ints) -> Floats:
        """What a spread adds to the squared distance of the means, at least."""
        apart = bures(list(zip(self.factor[:, i], other.factor[:, j], strict=True)))
        total = self.trace[i] + other.trace[j]
        # Of a point the value is exact.
        is_point = (self.trace[i] == 0) | (other.trace[j] == 0)
        return np.where(is_point, total, (apart * apart - UNSURE * total).clip(min=0))


def _solved(
    clouds: tuple[Clouds, Clouds],
    rows: tuple[Ints, Ints],
    order: int,
    sides: tuple[Trajectories, Trajectories],
    effort: Effort,
) -> Floats:
    """Distances (N,) of pairs of clouds, in threads: POT lets go of the interpreter."""
    count = len(rows[0])
    if not count:
        return np.zeros(0)
    sizes = [part.counts[at] for part, at in zip(clouds, rows, strict=True)]
    _check_sizes(sizes, rows, sides)
    jobs = min(effort.jobs or _cores(), count)
    seconds = estimated_seconds(*sizes) / jobs
    if seconds > PATIENCE:
        most = int(max(size.max() for size in sizes))
        hint = "; --reduce 50 makes them small" if most > MANY else ""
        effort.stopwatch.tell(
            f"{count:,} transports of up to {most} particles to solve, about {_time(seconds)}{hint}"
        )
    answer = np.zeros(count)
    step = max(1, min(64, count // (8 * jobs)))

    def solve(begin: int) -> int:
        for k in range(begin, min(begin + step, count)):
            first, second = (part[int(at[k])] for part, at in zip(clouds, rows, strict=True))
            answer[k] = distance(first, second, order)
        return begin + step

    solve(0)  # what cannot be imported says so before threads are made
    from concurrent.futures import ThreadPoolExecutor  # here: most runs do without

    with ThreadPoolExecutor(jobs) as pool:
        for done in _while_shown(pool.map(solve, range(step, count, step)), effort):
            effort.stopwatch.stage = f"transports, {min(done, count):,} of {count:,}"
    return answer


def _while_shown(done: Iterator[int], effort: Effort) -> Iterator[int]:
    """The numbers, with the name of the stage restored in the end."""
    outer = effort.stopwatch.stage
    try:
        yield from done
    finally:
        effort.stopwatch.stage = outer


def estimated_seconds(first: Ints, second: Ints) -> float:
    """Of transports between clouds of so many particles: about 2 ms for 100, and N^2.1."""
    scale = np.sqrt(first.astype(np.float64) * second) / 100
    return float(np.sum(2e-3 * scale**2.1 + 1e-4))


def reduced(clouds: Clouds, reduction: Reduction, effort: Effort) -> Clouds:
    """Every cloud reduced; the user is told if that takes long, as one of them tells."""
    large = int(np.count_nonzero(clouds.counts > reduction.size))
    if not large:
        return clouds
    begin = time.perf_counter()
    reduction(clouds[int(clouds.counts.argmax())])
    seconds = large * (time.perf_counter() - begin)
    if seconds > PATIENCE:
        effort.stopwatch.tell(f"{large:,} clouds to reduce, at most about {_time(seconds)}")
    outer, effort.stopwatch.stage = effort.stopwatch.stage, f"reducing {large:,} clouds"
    try:
        return clouds.changed(reduction, effort.jobs)
    finally:
        effort.stopwatch.stage = outer


def _check_sizes(
    sizes: list[Ints], rows: tuple[Ints, Ints], sides: tuple[Trajectories, Trajectories]
) -> None:
    for own, other, at, side in zip(sizes, sizes[::-1], rows, sides, strict=True):
        wrong = np.flatnonzero((own > LARGEST) & (other > 1))
        if len(wrong):
            row = at[wrong[0]]
            raise InputError(
                f'id "{side.ids[side.track[row]]}" at t {side.shown[side.step[row]]} has '
                f"{own[wrong[0]]} particles, more than {LARGEST} take too long and too much "
                "memory; reduce the clouds first, --reduce 100"
            )


def _whitened(points: Floats, factor: Floats, centre: Floats) -> Floats:
    from scipy.linalg import solve_triangular

    return np.ascontiguousarray(solve_triangular(factor, (points - centre).T, lower=True).T)


def _parts(rows: Ints) -> Iterator[Ints]:
    for begin in range(0, len(rows), TOGETHER):
        yield rows[begin : begin + TOGETHER]


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _time(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
