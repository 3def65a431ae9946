"""Near pairs of particle clouds that are Euclidean already: bounds first, transport for the rest.

Two bounds cost next to nothing: the distance of the means, ``|m_a - m_b| <= W_q`` for every q, and
of order 2 the Gelbrich bound, the Wasserstein distance of the Gaussians with the same moments,

    |m_a - m_b|^2 + B(P_a, P_b)^2  <=  W_2^2,

with the Bures distance B of their covariances; it is attained where one cloud is a point. A pair at
the cutoff or beyond it gains nothing, so that only pairs whose bounds are below it are solved.
"""

import time
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.machine import cores
from tgospa_eval.common.words import counted
from tgospa_eval.distances.base import Distance, Effort, Floats, Pairs, Sides
from tgospa_eval.distances.clouds.transport import (
    MOST_PARTICLES,
    TOO_LARGE,
    distance,
    whitened,
    whitened_points,
)
from tgospa_eval.distances.gaussian import bures
from tgospa_eval.distances.mahalanobis import cholesky
from tgospa_eval.distances.vector import Norm
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.text import quoted
from tgospa_eval.tracks import covariances
from tgospa_eval.tracks.clouds import Clouds
from tgospa_eval.tracks.trajectories import Ints, Trajectories

SLACK = 1e-12
"""Of the cutoff: a bound that is above it by rounding alone decides nothing."""

UNSURE = 1e-11
"""Of the variances: what rounding may add to the Gelbrich bound, and far more."""

BOUNDS_TOGETHER = 1 << 16
"""Pairs whose bounds are computed at a time."""

ANNOUNCED_FROM = 2.0
"""Seconds of work from which on the user is notified how long it will take."""

SECONDS_TOGETHER = 0.25
"""Seconds of work that a thread does at a time, about."""

MANY_PARTICLES = 300
"""Particles from which on there is a hint to reduce them."""


@dataclass(frozen=True, kw_only=True)
class CloudPairs(Distance):
    """Of clouds of distinct particles, Euclidean."""

    order: int
    gating: bool
    name = "cloud-wasserstein"

    @property
    def tree_power(self) -> float:
        """Euclidean."""
        return 2.0

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Distance of the means."""
        return _EUCLIDEAN.between(components)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Of the means."""
        return _EUCLIDEAN.reach(cutoff, axes)

    def horizon(self, sides: Sides, cutoff: float) -> float:
        """The cutoff and what rounding of the means may add."""
        if not self.gating:
            return np.inf
        largest = max(float(np.abs(side.state).max(initial=0)) for side in sides)
        return cutoff * (1 + SLACK) + 2.0**-46 * largest

    def refined(self, pairs: Pairs, sides: Sides, cutoff: float, effort: Effort) -> Pairs:
        """Near pairs with their distances: closed forms first, then what bounds leave open."""
        a, b = (side.clouds for side in sides)
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
            is_open &= value < self.horizon(sides, cutoff)
        rows = np.flatnonzero(is_open)
        value[rows] = _solved((a, b), (i[rows], j[rows]), self.order, sides, effort)
        near = np.flatnonzero(value < cutoff)
        return Pairs(truth_row=i[near], estimate_row=j[near], distance=value[near])

    def parts(self, pairs: Pairs, sides: Sides) -> tuple[Floats, Floats] | None:
        """Of order 2: distances of the means, and of the clouds moved onto one mean."""
        if self.order != 2:
            return None
        a, b = self.axes(sides[0], pairs.truth_row), self.axes(sides[1], pairs.estimate_row)
        means = np.minimum(self.between(zip(a, b, strict=True)), pairs.distance)
        # As a product: a difference of squares would lose what is left of nearly equal ones.
        spreads = np.sqrt((pairs.distance - means) * (pairs.distance + means))
        return means, spreads


@dataclass(frozen=True, kw_only=True)
class OwnCovariance(CloudPairs):
    """With the mean covariance of the pair."""

    def horizon(self, sides: Sides, cutoff: float) -> float:
        """Any pair of a step: the distance of means bounds nothing here."""
        del sides, cutoff
        return np.inf

    def refined(self, pairs: Pairs, sides: Sides, cutoff: float, effort: Effort) -> Pairs:
        """Near pairs, bounded by the Mahalanobis distances of their means."""
        del effort
        truth, estimate = sides
        a, b = truth.clouds, estimate.clouds
        if a is None or b is None or not len(pairs.distance):
            return pairs
        i, j = pairs.truth_row, pairs.estimate_row
        covariance = 0.5 * (a.covariances[i] + b.covariances[j])
        value = np.full(len(i), np.inf)
        _check_sizes([a.counts[i], b.counts[j]], (i, j), sides)
        for k, matrix in enumerate(covariance):
            try:
                factor = cholesky(matrix)
            except ConfigError:
                raise InputError(
                    f"id {quoted(truth.ids[truth.track[i[k]]])} and id "
                    f"{quoted(estimate.ids[estimate.track[j[k]]])} at t "
                    f"{truth.shown[truth.step[i[k]]]}: the covariance of the pair is singular, too "
                    "few distinct particles; take --inner-cov global or a file"
                ) from None
            apart = whitened_points(truth.state[i[k]][None], factor, estimate.state[j[k]])
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
    clouds: tuple[Clouds, Clouds], rows: tuple[Ints, Ints], order: int, sides: Sides, effort: Effort
) -> Floats:
    """Distances (N,) of pairs of clouds, in threads: POT lets go of the interpreter."""
    count = len(rows[0])
    if not count:
        return np.zeros(0)
    sizes = [part.counts[at] for part, at in zip(clouds, rows, strict=True)]
    _check_sizes(sizes, rows, sides)
    jobs = min(effort.jobs or cores(), count)
    seconds = estimated_seconds(*sizes, is_line=len(sides[0].columns) == 1) / jobs
    if seconds > ANNOUNCED_FROM:
        most = int(max(size.max() for size in sizes))
        hint = "; --reduce 50 makes them small" if most > MANY_PARTICLES else ""
        effort.stopwatch.notify(
            f"{counted(count, 'transport')} of up to {most} particles to solve, about "
            f"{_time(seconds)}{hint}"
        )
    answer = np.zeros(count)
    # Small enough that an interrupt is heeded soon.
    soon = int(SECONDS_TOGETHER * count / (seconds * jobs))
    step = max(1, min(64, count // (8 * jobs), soon))

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


def estimated_seconds(first: Ints, second: Ints, *, is_line: bool = False) -> float:
    """Of transports between clouds of so many particles: about 2 ms for 100, and N^2.1.

    On a line they are sorted by their place.
    """
    if is_line:
        return float(np.sum(1e-4 + 2e-7 * (first + second)))
    scale = np.sqrt(first.astype(np.float64) * second) / 100
    return float(np.sum(2e-3 * scale**2.1 + 1e-4))


def announce(effort: Effort, count: int, what: str, one: Callable[[], object]) -> None:
    """Notify the user if so many pieces of work like this one take long."""
    for _ in range(2):  # imports are what may take long the first time
        begin = time.perf_counter()
        one()
        seconds = count * (time.perf_counter() - begin)
        if seconds <= ANNOUNCED_FROM:
            return
    effort.stopwatch.notify(f"{what}, at most about {_time(seconds)}")


def _check_sizes(
    sizes: list[Ints], rows: tuple[Ints, Ints], sides: tuple[Trajectories, Trajectories]
) -> None:
    """Whether costs of all pairs fit; of points on a line there are none."""
    wrong = np.flatnonzero(sizes[0].astype(np.int64) * sizes[1] > MOST_PARTICLES**2)
    if len(wrong) and len(sides[0].columns) > 1:
        first = int(wrong[0])
        names = [
            f"id {quoted(side.ids[side.track[at[first]]])} with {size[first]} particles"
            for side, at, size in zip(sides, rows, sizes, strict=True)
        ]
        moment = sides[0].shown[sides[0].step[rows[0][first]]]
        raise InputError(f"{names[0]} and {names[1]} at t {moment}: {TOO_LARGE}")


def _parts(rows: Ints) -> Iterator[Ints]:
    for begin in range(0, len(rows), BOUNDS_TOGETHER):
        yield rows[begin : begin + BOUNDS_TOGETHER]


def _time(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
