"""The Mahalanobis distance with one covariance for the whole run."""

from collections.abc import Iterable, Sequence
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.base import (
    REACH_ROUNDING,
    Distance,
    DistanceSettings,
    Pairs,
    Resources,
    Sides,
    check_length,
    pair_named,
)
from tgospa_eval.distances.vector import positive_numbers, shares
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.quoting import option
from tgospa_eval.tracks import covariances
from tgospa_eval.tracks.trajectories import Trajectories

SINGULAR = 1e-6
"""A covariance counts as singular if the Cholesky factor of its correlations has a number below
this on the diagonal."""

NEARLY_DETERMINED = 0.5
"""The residual of a column is the column minus its regression on the columns before it. The search
also sorts by the residual if its standard deviation is at most this share of the standard deviation
of the column."""

LARGEST_REST = 1e300
"""Limit of residuals, so that their differences do not overflow."""


@dataclass(frozen=True, kw_only=True)
class Mahalanobis(Distance):
    """Difference in units of its own standard deviation, ``sqrt((a - b)' C^-1 (a - b))``.

    It is a metric on states because the covariance C is the same for all of them. Differences are
    scaled first, so C is in state units. Result, cutoff and switch penalty have no unit.

    Parameters
    ----------
    covariance : (d, d) array-like
        Symmetric and positive definite matrix. `DISTANCES["mahalanobis"]` has no covariance, and
        cannot compare states.
    scale : sequence of float, optional
        Factor of each column, > 0: from its unit to the state unit.

    Raises
    ------
    ConfigError
        The matrix is not square, symmetric and positive definite; a scale is out of range.
    """

    covariance: ArrayLike | None = None
    scale: Sequence[float] | None = None
    name = "mahalanobis"
    options = ("scale", "covariance")

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale", positive_numbers("scale", self.scale))
        if self.covariance is None:
            return
        matrix = _matrix(self.covariance)
        deviation, factor = _factor(matrix)
        object.__setattr__(self, "covariance", tuple(map(tuple, matrix.tolist())))
        object.__setattr__(self, "_deviation", deviation)
        object.__setattr__(self, "_factor", deviation[:, None] * factor)
        object.__setattr__(self, "_residuals", _residuals(factor))

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the norm of ``L^-1 (a - b)``, by forward substitution, with ``C = L L'``."""
        whitened: list[Floats] = []
        factor: Floats = self.__dict__["_factor"]
        for k, (a, b) in enumerate(components):
            rest = a - b if self.scale is None else self.scale[k] * (a - b)
            for weight, done in zip(factor[k], whitened, strict=False):
                if weight:
                    rest = rest - weight * done
            whitened.append(rest / factor[k, k])
        return reduce(np.hypot, whitened, np.zeros(()))

    def slopes_between(self, a: Floats, b: Floats) -> Floats:
        """Return ``S C^-1 S (b - a) / d`` with the scales S."""
        scale = np.asarray(self.scale or (1.0,) * len(a))[:, None]
        difference = scale * (b - a)
        pull = np.linalg.solve(np.asarray(self.covariance), difference)
        length = np.sqrt(np.maximum((difference * pull).sum(axis=0), 0.0))
        return np.asarray(scale * shares(pull, length))

    def embed(self, axes: Floats) -> Floats:
        """Return the columns, then the residuals of columns that are nearly determined."""
        weights = self._weights()
        if not len(weights):
            return axes
        left = np.clip(weights @ axes, -LARGEST_REST, LARGEST_REST)  # NaN if infinities cancel
        return np.concatenate((axes, np.nan_to_num(left, copy=False, nan=0.0)))

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the cutoff times the standard deviation of each column and of each residual.

        A column or a residual is a sum ``f' v`` with weights f, where v is the difference of two
        states. By Cauchy and Schwarz, ``|f' v| <= |L' f| sqrt(v' C^-1 v)`` with C = L L'. Rounding
        of the distance increases ``|L' f|`` by about 2^-50 of the sum of |f| in standard
        deviations, because forward substitution is backward stable. Rounding of a residual is at
        most a similar share of the sum of its terms. If this sum overflows for a state, the reach
        is so large that the state is near all states on this axis.
        """
        deviation: Floats = self.__dict__["_deviation"] / np.asarray(self.scale or 1.0)
        plain = (cutoff * (1 + REACH_ROUNDING) ** 2 * deviation)[:, None]
        weights = self._weights()
        if not len(weights):
            return plain
        length: Floats = self.__dict__["_residuals"][1][:, None]
        rounding = (len(axes) + 4) * 2.0**-52 * (np.abs(weights) @ np.abs(axes))
        left = np.minimum(cutoff * (1 + REACH_ROUNDING) * length + rounding, 4 * LARGEST_REST)
        return np.concatenate((np.broadcast_to(plain, axes.shape), left))

    def _weights(self) -> Floats:
        """Return the weights of the d columns in each of the m residuals, (m, d)."""
        weights: Floats = self.__dict__["_residuals"][0]
        deviation: Floats = self.__dict__["_deviation"]
        return weights * (np.asarray(self.scale or 1.0) / deviation)

    def check_columns(self, columns: tuple[str, ...], name: str) -> None:
        """Check that covariance and scale fit the number of columns."""
        if self.covariance is None:
            raise ConfigError("mahalanobis needs a covariance: Mahalanobis(covariance=...)")
        check_length("covariance", np.asarray(self.covariance), columns, name)
        super().check_columns(columns, name)

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """Return the matrix, and scales by column name."""
        matrix = np.asarray(self.covariance).tolist()
        return {"covariance": matrix, **super().settings(columns)}


def cholesky(covariance: ArrayLike, size: int | None = None) -> Floats:
    """Return the lower factor L of a covariance ``L L'``; check its size if `size` is given.

    Raises
    ------
    ConfigError
        The matrix is not square, symmetric and positive definite, or has another size.
    """
    matrix = _matrix(covariance)
    if size is not None and len(matrix) != size:
        raise ConfigError(f"covariance is {len(matrix)} x {len(matrix)}: must be {size} x {size}")
    deviation, factor = _factor(matrix)
    return deviation[:, None] * factor


@dataclass(frozen=True, kw_only=True)
class PairMahalanobis(Distance):
    """Mahalanobis distance with the mean covariance of the two states; it is not a metric.

    It is for the association of single pairs, never for TGOSPA. States without covariance are
    points. The distance depends neither on the units of the columns nor on their `scale`.
    """

    scale: Sequence[float] | None = None
    name = "mahalanobis"
    options = ("scale", "fix_cov", "missing_cov")

    @property
    def kinds(self) -> tuple[str, ...]:
        """Gaussians."""
        return ("gaussian",)

    def fitted(self, sides: Sides) -> "PairMahalanobis":
        """Return the distance itself, after a check that there are covariances.

        Raises
        ------
        InputError
            Neither side has covariances.
        """
        if sides[0].kind == sides[1].kind == "point":
            raise InputError(
                "neither file has covariances: mahalanobis needs the columns "
                f"cov_xx and so on, or {option('covariance', metavar='FILE')}"
            )
        return self

    def axes(self, side: Trajectories, rows: slice | Ints) -> Floats:
        """Return means and lower triangles of the covariances."""
        means = side.state[rows].T
        components = np.zeros((len(means) * (len(means) + 3) // 2, means.shape[1]))
        components[: len(means)] = means
        if side.covariance is not None:
            components[len(means) :] = side.covariance[rows].T
        return components

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the distance of Gaussians by components; 0 if the covariance is singular."""
        rows = [np.broadcast_arrays(a, b) for a, b in components]
        d = covariances.size_of(len(rows) + 1) - 1
        differences = [(a - b).ravel() for a, b in rows[:d]]
        factor = covariances.factor(np.array([0.5 * (a + b).ravel() for a, b in rows[d:]]))
        singular = (factor[_diagonal(d)] == 0).any(axis=0)
        squares = np.zeros(len(singular))
        whitened: list[Floats] = []
        for i in range(d):
            row = factor[i * (i + 1) // 2 :]
            rest = differences[i] - sum(row[k] * whitened[k] for k in range(i))
            whitened.append(np.divide(rest, row[i], out=np.zeros_like(squares), where=~singular))
            squares += whitened[-1] ** 2
        return np.sqrt(squares).reshape(rows[0][0].shape)

    def embed(self, axes: Floats) -> Floats:
        """Return the means."""
        return axes[: covariances.size_of(len(axes) + 1) - 1]

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the cutoff times the standard deviations.

        This reach is wide enough, because the mean of two variances is at most the larger one.
        """
        d = covariances.size_of(len(axes) + 1) - 1
        return cutoff * (1 + REACH_ROUNDING) * np.sqrt(axes[d:][_diagonal(d)])

    def refined(self, pairs: Pairs, sides: Sides, cutoff: float, resources: Resources) -> Pairs:
        """Return the pairs, after a check that the mean covariance of each is not singular.

        Raises
        ------
        InputError
            The mean covariance of a pair is singular.
        """
        truth, estimate = sides
        i, j = pairs.truth_row, pairs.estimate_row
        d = truth.state.shape[1]
        packed = 0.5 * (self.axes(truth, i)[d:] + self.axes(estimate, j)[d:])
        singular = np.flatnonzero((covariances.factor(packed)[_diagonal(d)] == 0).any(axis=0))
        if len(singular):
            raise InputError(
                f"{pair_named(sides, i[singular[0]], j[singular[0]])}: the covariance of the pair "
                f"is singular; use {option('covariance', metavar='FILE')}, or another distance"
            )
        return pairs

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """Return "pair" as the covariance."""
        return {"covariance": "pair"}


def _diagonal(d: int) -> list[int]:
    """Return the indices of the diagonal in a packed lower triangle."""
    return [i * (i + 3) // 2 for i in range(d)]


def _matrix(covariance: ArrayLike) -> Floats:
    try:
        matrix = np.array(covariance, dtype=np.float64)
    except (TypeError, ValueError):
        raise ConfigError("covariance must be a matrix of numbers") from None
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not matrix.size:
        raise ConfigError(f"covariance has the shape {matrix.shape}: must be (d, d)")
    variance = np.diag(matrix)
    if not np.isfinite(matrix).all() or not np.all((variance >= 1e-200) & (variance <= 1e200)):
        raise ConfigError(
            "covariance must have finite numbers, those on the diagonal from 1e-200 to 1e200"
        )
    bound = np.sqrt(variance)[:, None] * np.sqrt(variance)
    asymmetric = np.abs(0.5 * matrix - 0.5 * matrix.T) > 1e-12 * bound
    if asymmetric.any():
        i, j = (int(axis[0]) for axis in np.nonzero(asymmetric))
        raise ConfigError(
            f"covariance is not symmetric: {matrix[i, j]:g} in row {i + 1}, column {j + 1}, but "
            f"{matrix[j, i]:g} in row {j + 1}, column {i + 1}"
        )
    return 0.5 * matrix + 0.5 * matrix.T


def _factor(matrix: Floats) -> tuple[Floats, Floats]:
    """Return standard deviations (d,), and the Cholesky factor (d, d) of the correlations."""
    deviation: Floats = np.sqrt(np.diag(matrix))
    try:
        with np.errstate(over="ignore"):  # infinity is refused below: it has no factor
            factor = np.linalg.cholesky(matrix / deviation[:, None] / deviation)
    except np.linalg.LinAlgError:
        factor = np.zeros_like(matrix)
    if not np.diag(factor).min() >= SINGULAR:
        raise ConfigError(
            "covariance is not positive definite: some combination of the columns has no variance"
        )
    return deviation, np.asarray(factor, np.float64)


def _residuals(factor: Floats) -> tuple[Floats, Floats]:
    """Return weights f (m, d) of the residuals of m nearly determined columns, and ``|L' f|``.

    Let L be `factor`, and v a state in standard deviations. The residual of a column is the column
    minus its regression on the columns before it. It is equal to f' v, where f is the row of L^-1
    of the column, scaled so that the column itself has the weight 1. The accuracy of L^-1 does not
    matter.
    """
    strong = np.diag(factor) < NEARLY_DETERMINED
    weights: Floats = (np.linalg.inv(factor) * np.diag(factor)[:, None])[strong]
    length = np.linalg.norm(weights @ factor, axis=1) + REACH_ROUNDING * np.abs(weights).sum(axis=1)
    return weights, np.asarray(length)
