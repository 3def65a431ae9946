"""Wasserstein distance of particle clouds as base distance: settings, and clouds made ready.

Which pairs of them are near is found in `tgospa_eval.distances.clouds.pairs`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.distances.base import Distance, DistanceSettings, Effort, Floats, Pairs, Sides
from tgospa_eval.distances.clouds.pairs import CloudPairs, OwnCovariance, announce
from tgospa_eval.distances.clouds.reduction import Reduction
from tgospa_eval.distances.clouds.transport import check_order, plan, whitened, whitened_points
from tgospa_eval.distances.mahalanobis import Mahalanobis, cholesky
from tgospa_eval.distances.vector import Norm
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.text import quoted
from tgospa_eval.tracks.clouds import Clouds, single


def slopes_of_particles(
    clouds: tuple[Clouds, Clouds], pairs: Pairs, order: int, factor: Floats | None
) -> Floats:
    """``dW/dy_j = W^(1-q) sum_i pi_ij |x_i - y_j|^(q-2) (y_j - x_i)`` with the optimal plan pi.

    By the envelope theorem: W^q is a minimum over plans. One of the derivatives where several plans
    are optimal; 0 where the distance is 0.

    Parameters
    ----------
    clouds : pair of Clouds
        Of truth and estimate, scaled.
    pairs : Pairs
        Which to compare, with their distances.
    order : {1, 2}
        q.
    factor : (d, d) float array, optional
        L of the covariance L L' of a Mahalanobis distance of particles.

    Returns
    -------
    (M, d) float array
        Of the particles of the estimate of each pair, one pair behind the other.
    """
    found = [np.zeros((0, clouds[1].points.shape[1]))]
    near = zip(
        pairs.truth_row.tolist(), pairs.estimate_row.tolist(), pairs.distance.tolist(), strict=True
    )
    for i, j, distance in near:
        pair = clouds[0][i], clouds[1][j]
        if distance == 0:
            found.append(np.zeros_like(pair[1][0]))
            continue
        a, b = pair if factor is None else whitened(pair, factor)
        share = plan(a, b, order)
        if order == 1:
            apart = np.linalg.norm(a[0][:, None] - b[0], axis=2)
            share = np.divide(share, apart, out=np.zeros_like(share), where=apart > 0)
        # sum_i share_ij (y_j - x_i), from differences to one place
        centre = b[0][0]
        moved = share.sum(axis=0)[:, None] * (b[0] - centre) - share.T @ (a[0] - centre)
        moved *= distance ** (1 - order)
        found.append(moved if factor is None else np.linalg.solve(factor.T, moved.T).T)
    return np.concatenate(found)


INNER = ("euclidean", "mahalanobis")


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
        A word is none of these, or a covariance or scale is given that is wrong or of no use.
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
            raise ConfigError(f"inner is {quoted(self.inner)}: must be one of {', '.join(INNER)}")
        if not isinstance(self.reduction, Reduction | None):
            raise ConfigError(f"reduction is {self.reduction!r}: must be a Reduction(size=...)")
        if self.covariance is not None and self.inner != "mahalanobis":
            raise ConfigError("a covariance of particles needs the inner distance mahalanobis")
        # Checks scale and covariance, and keeps them as tuples.
        for name in ("scale", "covariance"):
            if hasattr(self.lower_bound, name):
                object.__setattr__(self, name, getattr(self.lower_bound, name))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Clouds."""
        return ("cloud",)

    @property
    def lower_bound(self) -> Distance:
        """The inner distance of the means, a lower bound."""
        if self.covariance is not None:
            return Mahalanobis(covariance=self.covariance, scale=self.scale)
        return Norm(name="euclidean", power=2.0, scale=self.scale)

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Distance of points, as states alone are; of clouds the distance of their means."""
        return self.lower_bound.between(components)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """That of the distance of the means."""
        return self.lower_bound.reach(cutoff, axes)

    def check_columns(self, columns: tuple[str, ...], name: str) -> None:
        """Whether covariance and scale are for so many columns."""
        self.lower_bound.check_columns(columns, name)

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """Order, inner distance and reduction by the names of the options."""
        found: DistanceSettings = {"cloud_order": self.order, "inner": self.inner}
        if self.covariance is not None:
            found["inner_cov"] = np.asarray(self.covariance).tolist()
        if self.scale is not None:
            found["scale"] = dict(zip(columns, self.scale, strict=True))
        if self.reduction is not None:
            found |= self.reduction.settings()
        return found

    def fitted(self, sides: Sides) -> "CloudWasserstein":
        """With the mean covariance of all clouds, where it is wanted and not given."""
        if self.inner != "mahalanobis" or self.covariance is not None:
            return self
        spreads = [side.clouds.covariances for side in sides if side.clouds is not None]
        if not any(len(side.step) for side in sides):
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

    def prepared(self, sides: Sides, effort: Effort) -> tuple[Sides, Distance]:
        """Scaled, reduced, coincident particles merged, whitened: then Euclidean."""
        centre = np.concatenate([side.state[:1] for side in sides])[:1]
        factor = None if self.covariance is None else cholesky(self.covariance)
        found = []
        for side in sides:
            clouds = single(side.state) if side.clouds is None else side.clouds
            if self.scale is not None:
                clouds = clouds.moved(clouds.points * np.asarray(self.scale))
            if self.reduction is not None:
                clouds = reduced(clouds, self.reduction, effort)
            clouds = clouds.merged()
            if factor is not None and len(clouds):
                clouds = clouds.moved(whitened_points(clouds.points, factor, centre[0]))
            found.append(side.with_clouds(clouds))
        return (found[0], found[1]), self._measure()

    def particle_slopes(self, pairs: Pairs, sides: Sides) -> Floats:
        """By the envelope theorem: the optimal plan and the weights are held.

        Raises
        ------
        ConfigError
            The clouds are reduced.
        """
        if self.reduction is not None:
            raise ConfigError(
                "no derivative is known of reduced clouds: evaluate without reduce, or reduce them "
                "before"
            )
        scale = np.ones(sides[1].state.shape[1]) if self.scale is None else np.asarray(self.scale)
        factor = None if self.covariance is None else cholesky(self.covariance)
        clouds = []
        for side in sides:
            own = single(side.state) if side.clouds is None else side.clouds
            clouds.append(own.moved(own.points * scale))
        return slopes_of_particles((clouds[0], clouds[1]), pairs, self.order, factor) * scale

    def _measure(self) -> Distance:
        """Of clouds as they are prepared."""
        return CloudPairs(order=self.order, gating=self.gating)


@dataclass(frozen=True, kw_only=True)
class PairCloudWasserstein(CloudWasserstein):
    """With a covariance of each pair, the mean of those of its two clouds: no metric.

    It is for the association of single pairs, never for TGOSPA.
    """

    inner: str = "mahalanobis"

    def fitted(self, sides: Sides) -> "PairCloudWasserstein":
        """As it is: every pair has its own."""
        del sides
        return self

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """As of other clouds, with the word for it."""
        return {**super().settings(columns), "inner_cov": "pair"}

    def _measure(self) -> Distance:
        return OwnCovariance(order=self.order, gating=self.gating)


def reduced(clouds: Clouds, reduction: Reduction, effort: Effort) -> Clouds:
    """Every cloud reduced; the user is notified if that takes long, as one of them shows."""
    large = int(np.count_nonzero(clouds.counts > reduction.size))
    if not large:
        return clouds
    what = counted(large, "cloud")
    longest = clouds[int(clouds.counts.argmax())]
    announce(effort, large, f"{what} to reduce", lambda: reduction(longest))
    outer, effort.stopwatch.stage = effort.stopwatch.stage, f"reducing {what}"
    try:
        return clouds.changed(reduction, effort.jobs)
    finally:
        effort.stopwatch.stage = outer
