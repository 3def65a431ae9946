"""The Wasserstein distance of order 2 between Gaussians."""

import math
import warnings
from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.base import Distance, DistanceSettings, Pairs, Sides
from tgospa_eval.distances.vector import Norm, shares
from tgospa_eval.errors import ConfigError, InputError, TgospaWarning
from tgospa_eval.quoting import quoted
from tgospa_eval.tracks import covariances
from tgospa_eval.tracks.trajectories import Trajectories

PAIRS_TOGETHER = 1 << 13
"""Number of pairs in a call of the SVD, for states of more than two components."""

MIXED = ("error", "moments")

Pair = tuple[Floats, Floats]


@dataclass(frozen=True, kw_only=True)
class GaussianWasserstein(Distance):
    """W2 of Gaussians, ``sqrt(|a - b|^2 + B^2)``: means a and b, Bures distance B.

    W2 is the Wasserstein distance of order 2. B is the least ``||F - G Q||`` over rotations and
    reflections Q, where the covariances are F F' and G G'. W2 is a metric on Gaussians. States
    without covariance are points. Means are compared by the Euclidean norm of their scaled
    difference; components with a period lie on a circle. With a periodic component W2 is still a
    metric, but it is not the distance of Gaussians on a circle.

    If the distance is called with arrays, their last axis has the d components of the mean and the
    d (d + 1) / 2 components of a lower factor of the covariance, row by row. The function
    `gaussian_wasserstein` takes covariances.

    Parameters
    ----------
    scale : sequence of float, optional
        Factor of each column, > 0: from its unit to the state unit. Covariances are scaled, too.
    period : sequence of float, optional
        Period of each column, > 0 in its unit; inf for a column that is not periodic.
    mixed : {"error", "moments"}
        Treatment of particle clouds. ``"error"`` refuses clouds. ``"moments"`` replaces each cloud
        by the Gaussian of its mean and covariance. Clouds with equal moments then have the distance
        0, so W2 is not a metric on clouds. It is a lower bound of their Wasserstein distance.

    Raises
    ------
    ConfigError
        A number is out of range, or `mixed` is unknown.
    """

    scale: Sequence[float] | None = None
    period: Sequence[float] | None = None
    mixed: str = "error"
    name = "gaussian-wasserstein"
    options = ("scale", "periodic", "fix_cov", "missing_cov", "mixed")

    def __post_init__(self) -> None:
        if self.mixed not in MIXED:
            raise ConfigError(f"mixed is {quoted(self.mixed)}: must be one of {', '.join(MIXED)}")
        for name in ("scale", "period"):  # check both, and make them tuples
            object.__setattr__(self, name, getattr(self._means, name))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Gaussians; also clouds if `mixed` is "moments"."""
        return ("gaussian", "cloud") if self.mixed == "moments" else ("gaussian",)

    @property
    def tree_power(self) -> float:
        """Power of the norm of the means, because the distance of the means is at most W2."""
        return self._means.tree_power

    @cached_property
    def _means(self) -> Norm:
        return Norm(name="euclidean", power=2.0, scale=self.scale, period=self.period)

    def axes(self, side: Trajectories, rows: slice | Ints) -> Floats:
        """Return means and scaled lower factors; each covariance is factored here, only once."""
        means = side.state[rows].T
        d, count = means.shape
        components = np.zeros((d * (d + 3) // 2, count))
        components[:d] = means
        packed = None
        if side.clouds is not None:
            packed = covariances.pack(side.clouds.covariances[rows])
        elif side.covariance is not None:
            packed = np.ascontiguousarray(side.covariance[rows].T)
        if packed is not None:
            components[d:] = covariances.factor(packed)
            for row, scale in enumerate(self.scale or ()):
                begin = d + row * (row + 1) // 2
                components[begin : begin + row + 1] *= scale
        return components

    def between(self, components: Iterable[Pair]) -> Floats:
        """Return the distance of Gaussians, given by components: first means, then factors."""
        return np.hypot(*self._parts(components))

    def parts(self, pairs: Pairs, sides: Sides) -> Pair:
        """Return the distances of the means, and of the covariances."""
        a, b = self.axes(sides[0], pairs.truth_row), self.axes(sides[1], pairs.estimate_row)
        return self._parts(zip(a, b, strict=True))

    def slopes(self, pairs: Pairs, sides: Sides) -> Floats:
        """Return the derivatives by the means of the estimates.

        They are the derivatives of the distance of the means, times the ratio of this distance to
        W2.
        """
        slopes = self._means.slopes(pairs, sides)
        means, spreads = self.parts(pairs, sides)
        whole = np.hypot(means, spreads)
        return slopes * shares(means, whole)

    def _parts(self, components: Iterable[Pair]) -> Pair:
        pairs = list(components)
        d = _dimension(len(pairs))
        return self._means.between(pairs[:d]), bures(pairs[d:])

    def embed(self, axes: Floats) -> Floats:
        """Return the points of the means (`Distance.embed`)."""
        return self._means.embed(axes[: _dimension(len(axes))])

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the reach of the means, whose distance is never larger than W2."""
        return self._means.reach(cutoff, axes[: _dimension(len(axes))])

    def settings(self, columns: tuple[str, ...]) -> DistanceSettings:
        """Return periods and scales by column name, and the treatment of clouds."""
        return {**super().settings(columns), "mixed": self.mixed}


def gaussian_wasserstein(
    mean_a: ArrayLike,
    covariance_a: ArrayLike | None,
    mean_b: ArrayLike,
    covariance_b: ArrayLike | None,
    *,
    period: ArrayLike | None = None,
) -> Floats:
    """Return the Wasserstein distance of order 2 between Gaussians; all arguments broadcast.

    Parameters
    ----------
    mean_a, mean_b : (..., d) array-like
        Means; a single number is a mean of one component.
    covariance_a, covariance_b : (..., d, d) array-like, optional
        Covariances, which may be singular; None means a point, a number is a variance. If the least
        eigenvalue is negative by up to a thousandth of the largest, the matrix is replaced by the
        nearest one without negative eigenvalues, with a warning.
    period : float or (d,) array-like, optional
        Period of each component; inf for a component that is not periodic.

    Returns
    -------
    (...) float array
        Distances, in the unit of the means.

    Raises
    ------
    InputError
        Shapes do not fit, a number is not finite, or a matrix is not a covariance.
    ConfigError
        A period is out of range.
    """
    means = [_numbers("mean", mean) for mean in (mean_a, mean_b)]
    if not (means[0].ndim or means[1].ndim):
        means = [mean.reshape(1) for mean in means]
    if means[0].shape[-1:] != means[1].shape[-1:]:
        shapes = f"{means[0].shape} and {means[1].shape}"
        raise InputError(f"means have the shapes {shapes}: must be (..., d), with the same d")
    d = means[0].shape[-1]
    if not d:
        raise InputError("means have no components")
    factors = [_factors(matrix, d) for matrix in (covariance_a, covariance_b)]
    periods = None
    if period is not None:
        try:
            periods = np.broadcast_to(np.asarray(period, np.float64), (d,)).tolist()
        except (TypeError, ValueError):
            raise InputError(f"period is {period!r}: must be one number per component") from None
    parts = [*(np.moveaxis(mean, -1, 0) for mean in means), *factors]
    try:
        shape = np.broadcast_shapes(*(part.shape[1:] for part in parts))
    except ValueError:
        shapes = ", ".join(str(part.shape[1:]) for part in parts)
        raise InputError(f"the arguments do not broadcast: stacks of shapes {shapes}") from None
    sides = [
        [np.broadcast_to(x, shape) for x in (*mean, *factor)]
        for mean, factor in zip(parts[:2], factors, strict=True)
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        return GaussianWasserstein(period=periods).between(zip(*sides, strict=True))


def _numbers(name: str, values: ArrayLike) -> Floats:
    try:
        array = np.asarray(values)
        if array.dtype.kind == "c":
            raise TypeError("complex")
        array = array.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be an array of real numbers") from None
    if not np.isfinite(array).all():
        raise InputError(f"{name}: a number is not finite")
    return array


def _factors(matrices: ArrayLike | None, d: int) -> Floats:
    """Return the components of the lower factors of the covariances, (d (d + 1) / 2, ...)."""
    if matrices is None:
        return np.zeros(d * (d + 1) // 2)
    array = _numbers("covariance", matrices)
    if d == 1 and not array.ndim:
        array = array.reshape(1, 1)
    if array.shape[-2:] != (d, d):
        raise InputError(f"covariance has the shape {array.shape}: must be (..., {d}, {d})")
    stack = array.shape[:-2]

    def where(k: int) -> str:
        at = tuple(map(int, np.unravel_index(k, stack)))
        return f"covariance {at}" if stack else "covariance"

    packed, notices = covariances.from_matrices(array.reshape(math.prod(stack), d, d), where)
    for notice in notices:
        warnings.warn(notice.sentence, TgospaWarning, stacklevel=3)
    return covariances.factor(packed).reshape(len(packed), *stack)


def bures(factors: Sequence[Pair]) -> Floats:
    """Return the Bures distance of covariances, given by the components of their lower factors."""
    d = covariances.size_of(len(factors))
    if d == 1:
        ((a, b),) = factors
        return np.abs(a - b)
    return _bures_two(*factors) if d == 2 else _bures_many(factors)


def _bures_two(first: Pair, second: Pair, third: Pair) -> Floats:
    """Return the Bures distance of covariances of two components, in closed form.

    Let L1 and L2 be the lower factors, A = L2' L1, ``p = A11 + A22`` and ``s = A21 - A12``. The
    best Q (see `GaussianWasserstein`) turns by the angle t of the vector (p, s). It is a rotation
    because det A >= 0. R(t) is the rotation by t. The result is ``||L1 R(-t/2) - L2 R(t/2)||``.
    Each factor is turned by half of t, so that the result is symmetric, and 0 for equal
    covariances.
    """
    (a1, a2), (b1, b2), (c1, c2) = first, second, third
    s = b1 * c2 - b2 * c1
    p = a1 * a2 + b1 * b2 + c1 * c2
    # (|p| + h, s), where h is the length of (p, s), has half the angle of (|p|, s).
    ahead = np.abs(p) + np.sqrt(p * p + s * s)  # np.hypot is ten times slower
    length = np.sqrt(ahead * ahead + s * s)
    if not length.all():  # (p, s) is zero: there is no angle
        ahead, length = (np.where(length > 0, x, 1.0) for x in (ahead, length))
    cosine, sine = ahead / length, s / length
    back = p < 0
    if back.any():  # half of an angle t beyond a right angle is pi / 2 - (pi - |t|) / 2
        turned = np.copysign(cosine, s)
        cosine, sine = np.where(back, np.abs(sine), cosine), np.where(back, turned, sine)
    parts = (
        (a1 - a2) * cosine,
        (a1 + a2) * sine,
        (b1 - b2) * cosine - (c1 + c2) * sine,
        (b1 + b2) * sine + (c1 - c2) * cosine,
    )
    return np.asarray(np.sqrt(sum(part * part for part in parts)))


def _bures_many(factors: Sequence[Pair]) -> Floats:
    """Return the Bures distance of covariances of any size, by the SVD of many pairs at a time.

    The best Q is U V', where A = L2' L1 = U S V' for the lower factors L1 and L2. The entries of
    the factors decide which of two covariances comes first. So an exchange of the two does not
    change the rounding.
    """
    shape = np.broadcast_shapes(*(side.shape for side in factors[0]))
    sides = [[np.broadcast_to(pair[side], shape).ravel() for pair in factors] for side in (0, 1)]
    lengths = np.empty(len(sides[0][0]))
    for begin in range(0, len(lengths), PAIRS_TOGETHER):
        a, b = (np.array([x[begin : begin + PAIRS_TOGETHER] for x in side]) for side in sides)
        at = np.argmax(a != b, axis=0)[None]  # the first component in which they differ
        later = np.take_along_axis(a, at, axis=0) > np.take_along_axis(b, at, axis=0)
        one, two = (
            covariances.unpack(np.where(later, *pair), lower=True) for pair in ((b, a), (a, b))
        )
        u, _, v = np.linalg.svd(two.transpose(0, 2, 1) @ one)
        rest = one - two @ (u @ v)
        equal = (one == two).all(axis=(1, 2))
        norm = np.sqrt(np.einsum("rij,rij->r", rest, rest))
        lengths[begin : begin + PAIRS_TOGETHER] = np.where(equal, 0.0, norm)
    return lengths.reshape(shape)


def _dimension(count: int) -> int:
    """Return d from the number of components: d of the mean and d (d + 1) / 2 of the factor."""
    d = covariances.size_of(count + 1) - 1
    if d < 1 or d * (d + 3) // 2 != count:
        raise InputError(
            f"a Gaussian has d components of a mean and d (d + 1) / 2 of a factor, but there are "
            f"{count}; for covariances call gaussian_wasserstein"
        )
    return d
