"""Exact optimal transport between two particle clouds.

The mass of one cloud is moved to the other at the least cost

    W_q = (min_w  sum_ij w_ij d(x_i, y_j)^q)^(1/q),   w_ij >= 0,
    sum_j w_ij = weight of x_i,   sum_i w_ij = weight of y_j,

These are equations 7 and 14 of [Danu]. Its equation 13 has no root, and is not a metric. In one
dimension sorting solves the problem. If one cloud is a point, there is only one plan. If both
clouds have the same number of particles of equal weight, it is an assignment problem. POT, which
comes with the extra ``clouds``, solves all other pairs.
"""

import math
import warnings
from importlib.util import find_spec
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.words import install
from tgospa_eval.distances.mahalanobis import cholesky
from tgospa_eval.errors import ConfigError, SolverError, TgospaWarning, real_number, whole_number
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.clouds import LARGEST_COORDINATE, UNEVEN_SUM, are_normalised

Ints = NDArray[np.intp]

RESAMPLING = ("systematic", "stratified", "multinomial")


def as_cloud(
    points: ArrayLike, weights: ArrayLike | None, name: str, *, depth: int = 2
) -> tuple[Floats, Floats]:
    """Check and return points (N, d) and weights (N,) with the sum 1; `name` begins the messages.

    If `weights` is None, weights are equal. A warning names the line of the user's code: `depth` is
    the number of calls from that line to this function.

    Warns
    -----
    UserWarning
        The sum of the weights differs from 1 by more than 1e-3.

    Raises
    ------
    ConfigError
        The shapes are not (N, d) or (N,) and (N,), there are no particles, a number is not finite,
        a coordinate is beyond 1e150, a weight is negative, or no weight is above zero.
    """
    try:
        points = np.array(points, dtype=np.float64)
        given = None if weights is None else np.array(weights, dtype=np.float64)
    except (TypeError, ValueError):
        raise ConfigError(f"{name}: points and weights must be arrays of numbers") from None
    if points.ndim == 1:
        points = points[:, None]
    if points.ndim != 2 or not points.size:
        raise ConfigError(
            f"{name}: points have the shape {points.shape}: must be (N, d), not empty"
        )
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise ConfigError(f"{name}: particle {row} is not finite; leave it out")
    if np.abs(points).max() > LARGEST_COORDINATE:
        raise ConfigError(f"{name}: a particle is beyond {LARGEST_COORDINATE:g}; use another unit")
    if given is None:
        return points, np.full(len(points), 1 / len(points))
    if given.shape != (len(points),):
        raise ConfigError(
            f"{name}: weights have the shape {given.shape}: must be ({len(points)},), one per point"
            + ("; a single point is [[x, y]]" if given.shape == (1,) else "")
        )
    fault = _weight_fault(given)
    if fault:
        raise ConfigError(f"{name}: {fault}")
    # Weights are divided first, so that sums of huge weights do not overflow. An exact sum does not
    # depend on the order of particles.
    largest = float(given.max())
    scaled = given / largest
    total = math.fsum(scaled)
    if abs(total * largest - 1) > UNEVEN_SUM:
        warnings.warn(
            f"{name}: the weights sum to {total * largest:g}, not 1: normalised",
            TgospaWarning,
            stacklevel=depth + 1,
        )
    return points, given if are_normalised(total * largest, len(given)) else scaled / total


def _weight_fault(weights: Floats) -> str:
    """Return what is wrong with the weights of a cloud, with an example; "" if they are valid."""
    what = "" if (weights > 0).any() else "all weights are zero"
    for wrong, name in (
        (weights < 0, "a weight is negative"),
        (np.isinf(weights), "a weight is infinite"),
        (np.isnan(weights), "a weight is NaN or blank"),
    ):
        if wrong.any():
            value = weights[wrong][0]
            what = name if np.isnan(value) else f"{name} ({value:g})"
    return what and f"{what}; weights must be finite, >= 0 and not all zero"


def restrict_cloud(
    points: ArrayLike, weights: ArrayLike | None, size: int
) -> tuple[Floats, Floats]:
    """Return the particles with the highest weights, normalised again.

    The tails of the distribution are lost with the light particles. So the distance between
    clouds of few remaining particles is biased, often by a third and more. The function is for
    comparisons.

    Parameters
    ----------
    points : (N, d) array-like
        Particles.
    weights : (N,) array-like or None
        Weights >= 0, not all zero, which are normalised. None means equal weights.
    size : int
        Number of particles to keep, >= 1. Among equal weights the earlier particles are kept. A
        cloud of at most `size` particles is kept whole.

    Returns
    -------
    points, weights : (n, d) and (n,) arrays
        The n kept particles by descending weight, and weights with the sum 1.

    Raises
    ------
    ConfigError
        As for `cloud_wasserstein`, or `size` is below 1.

    Notes
    -----
    Source: [Danu], section 4.2.
    """
    points, weights = as_cloud(points, weights, "cloud")
    size = whole_number("size", size)
    if size >= len(points):
        return points, weights
    order = np.argsort(-weights, kind="stable")[:size]
    return points[order], weights[order] / weights[order].sum()


def resample_cloud(
    points: ArrayLike,
    weights: ArrayLike | None,
    size: int,
    *,
    method: str = "systematic",
    offset: float | ArrayLike | None = None,
    rng: "np.random.Generator | int | None" = None,
) -> tuple[Floats, Floats]:
    """Draw particles with replacement, each with the weight ``1 / size``.

    Drawn particle i, from 0, is the first particle whose cumulative weight exceeds u_i, where

    - systematic: ``u_i = (i + U) / size`` with one U;
    - stratified: ``u_i = (i + U_i) / size``;
    - multinomial: ``u_i = U_i``;

    and U is uniform in [0, 1).

    Parameters
    ----------
    points : (N, d) array-like
        Particles.
    weights : (N,) array-like or None
        Weights >= 0, not all zero, which are normalised. None means equal weights.
    size : int
        Number of particles to draw, >= 1.
    method : {"systematic", "stratified", "multinomial"}
        Method of drawing.
    offset : float or (size,) array-like, optional
        U or the U_i in [0, 1], which are random by default. If u_i is 1, the last particle is
        drawn.
    rng : numpy.random.Generator or int, optional
        Generator of U, or its seed; 0 by default.

    Returns
    -------
    points, weights : (size, d) and (size,) arrays
        Drawn particles, in the order of the u_i, and their weights.

    Raises
    ------
    ConfigError
        As for `cloud_wasserstein`; or the method is unknown, the size is below 1, or an offset is
        outside [0, 1].

    Notes
    -----
    Source: [Danu], section 4.3.
    """
    points, weights = as_cloud(points, weights, "cloud")
    size = whole_number("size", size)
    chosen = sampled(weights, size, method, offset, rng)
    return points[chosen], np.full(size, 1 / size)


def sampled(
    weights: Floats,
    size: int,
    method: str,
    offset: float | ArrayLike | None = None,
    rng: "np.random.Generator | int | None" = None,
) -> NDArray[np.intp]:
    """Return the indices of drawn particles in the cloud; the weights must sum to 1."""
    if method not in RESAMPLING:
        raise ConfigError(f"method is {quoted(method)}: must be one of {', '.join(RESAMPLING)}")
    count = 1 if method == "systematic" else size
    if offset is None:
        within = _generator(rng).random(count)
    elif np.ndim(offset) == 0:
        within = np.full(count, real_number("offset", offset))
    else:
        within = np.asarray(offset, np.float64)
    if within.shape not in ((count,), (1,)) or not np.all((within >= 0) & (within <= 1)):
        raise ConfigError(
            f"offset must be one number{'' if count == 1 else f' or {count} numbers'} in [0, 1]"
        )
    at = within if method == "multinomial" else (np.arange(size) + within) / size
    # If rounding leaves the last sum below 1, draw the last particle that has a weight.
    last = np.flatnonzero(weights)[-1]
    return np.searchsorted(np.cumsum(weights), np.broadcast_to(at, (size,)), side="right").clip(
        max=last
    )


def _generator(rng: "np.random.Generator | int | None") -> "np.random.Generator":
    try:
        return np.random.default_rng(0 if rng is None else rng)
    except (TypeError, ValueError):
        raise ConfigError(f"rng is {rng!r}: must be a numpy.random.Generator or a seed") from None


Cloud = tuple[Floats, Floats]
"""Points (N, d) and weights (N,) > 0 that sum to 1."""

ASSIGNED = 200
"""Number of particles up to which an assignment is faster than transport."""

WIDEST = 1e150
"""Largest whitened coordinate, so that squares do not overflow."""

MAX_PARTICLES = 4000
"""Largest number of particles of a cloud that is compared with one of the same size. The costs of
the pair take 128 MB, and transport takes half a minute."""


def too_large() -> str:
    """Return the message about a pair of clouds with too many particles."""
    return (
        f"more than {MAX_PARTICLES} x {MAX_PARTICLES} particles in a pair take too much time and "
        f"memory; reduce the clouds first with {option('reduce', 100)} or reduce_cloud"
    )


POT_NEEDED = f"distances of particle clouds need the extra clouds: {install('clouds')}"

WEIGHT_ROUNDING = 1e-13
"""Share by which a weight may change if its sums and quotients are computed in another order."""


def cloud_wasserstein(
    points_a: ArrayLike,
    weights_a: ArrayLike | None,
    points_b: ArrayLike,
    weights_b: ArrayLike | None,
    *,
    order: int = 2,
    covariance: ArrayLike | None = None,
) -> float:
    """Return the Wasserstein distance of two particle clouds: a metric on weighted clouds.

    Parameters
    ----------
    points_a, points_b : (N, d) and (M, d) array-like
        Particles, in state units; (N,) and (M,) in one dimension.
    weights_a, weights_b : (N,) and (M,) array-like or None
        Weights >= 0, not all zero, which are normalised. None means equal weights.
    order : {1, 2}
        q, the power of the distances of particles in the sum.
    covariance : (d, d) array-like, optional
        Covariance of the Mahalanobis distance. If it is given, particles have this distance instead
        of the Euclidean one. Distances of several pairs are a metric only with the same covariance
        for all.

    Returns
    -------
    float
        Distance in state units; without unit if a covariance is given.

    Warns
    -----
    UserWarning
        A sum of weights differs from 1 by more than 1e-3.

    Raises
    ------
    ConfigError
        A weight is negative, NaN or infinite, or all are zero; a point is not finite; shapes, order
        or covariance are wrong; the clouds have more than 4,000 x 4,000 distinct particles in more
        than one dimension; or POT is needed and not installed.

    Notes
    -----
    Source: [Danu], equations 7, 10, 14, 26.
    """
    check_order(order)
    a, b = _pair(points_a, weights_a, points_b, weights_b)
    if covariance is not None:
        a, b = whitened((a, b), cholesky(covariance, a[0].shape[1]))
    return distance(merged(a), merged(b), order)


def transport_plan(
    points_a: ArrayLike,
    weights_a: ArrayLike | None,
    points_b: ArrayLike,
    weights_b: ArrayLike | None,
    *,
    order: int = 2,
) -> Floats:
    """Return an optimal plan that moves the mass between two clouds, for Euclidean distances.

    If ties make several plans optimal, the result is one of these.

    Parameters
    ----------
    points_a, weights_a, points_b, weights_b, order
        As for `cloud_wasserstein`.

    Returns
    -------
    (N, M) array
        Entry (i, j) is the mass that moves from particle i of the first cloud to particle j of the
        second. Sums of rows and of columns are the normalised weights.

    Raises
    ------
    ConfigError
        As for `cloud_wasserstein`.

    Notes
    -----
    Source: [Danu], equations 8 and 14.
    """
    check_order(order)
    a, b = _pair(points_a, weights_a, points_b, weights_b)
    return plan(a, b, order)


def cross_covariance(
    points_a: ArrayLike,
    weights_a: ArrayLike | None,
    points_b: ArrayLike,
    weights_b: ArrayLike | None,
) -> Floats:
    """Return the covariance between the states of two clouds under their optimal plan.

    ``P12 = sum_ij w_ij (x_i - m_a) (y_j - m_b)'`` with the means m and the plan of order 2. With
    the covariances P1 and P2 of the clouds, ``W_2^2 = |m_a - m_b|^2 + tr(P1 + P2 - P12 - P12')``.
    The matrix P1 + P2 - P12 - P12' has the least trace of all joint distributions. It is zero if
    one cloud is a shifted copy of the other, so it must not be inverted as the covariance of a
    difference.

    Parameters
    ----------
    points_a, weights_a, points_b, weights_b
        As for `cloud_wasserstein`.

    Returns
    -------
    (d, d) array
        Covariance; its rows are components of the first cloud. If several plans are optimal, only
        its trace is determined.

    Raises
    ------
    ConfigError
        As for `cloud_wasserstein`.

    Notes
    -----
    Source: [Danu], equation 27.
    """
    a, b = _pair(points_a, weights_a, points_b, weights_b)
    centred = [points - weights @ points for points, weights in (a, b)]
    return np.asarray(centred[0].T @ plan(a, b, 2) @ centred[1])


def check_order(order: object) -> None:
    """Check that clouds can be compared with this order.

    Raises
    ------
    ConfigError
        The order is neither 1 nor 2.
    """
    if isinstance(order, bool) or order not in (1, 2):
        raise ConfigError(f"cloud-order is {order!r}: must be 1 or 2")


def _pair(
    points_a: ArrayLike,
    weights_a: ArrayLike | None,
    points_b: ArrayLike,
    weights_b: ArrayLike | None,
) -> tuple[Cloud, Cloud]:
    a = as_cloud(points_a, weights_a, "first cloud", depth=4)
    b = as_cloud(points_b, weights_b, "second cloud", depth=4)
    if a[0].shape[1] != b[0].shape[1]:
        raise ConfigError(
            f"the first cloud has {a[0].shape[1]} components, the second has {b[0].shape[1]}; "
            "both must have the same number"
        )
    return a, b


def whitened(clouds: tuple[Cloud, ...], factor: Floats) -> tuple[Cloud, ...]:
    """Return clouds ``L^-1 (x - centre)``, whose Euclidean distance is the Mahalanobis distance.

    Raises
    ------
    ConfigError
        Particles are so far apart that squares of distances overflow.
    """
    centre = clouds[0][0][0]
    with np.errstate(over="ignore", invalid="ignore"):  # checked below
        white = tuple((whitened_points(x, factor, centre), weights) for x, weights in clouds)
    if any(not (np.abs(points) <= WIDEST).all() for points, _ in white):
        raise ConfigError(
            f"particles are more than {WIDEST:g} standard deviations apart; the covariance is "
            "too small for them"
        )
    return white


def whitened_points(points: Floats, factor: Floats, centre: Floats) -> Floats:
    """Return ``L^-1 (x - centre)`` by forward substitution, where L is `factor`.

    Routines for matrices are not used, because they may round equal particles differently.
    """
    solved = np.empty(points.shape)
    for k, row in enumerate(factor):
        rest = points[:, k] - centre[k]
        for weight, done in zip(row[:k], solved.T, strict=False):
            rest = rest - weight * done
        solved[:, k] = rest / row[k]
    return solved


def merged(cloud: Cloud) -> Cloud:
    """Return the cloud with each distinct particle once, without particles of weight 0."""
    points, weights, _ = _merged(cloud)
    return points, weights


def _merged(cloud: Cloud) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Return distinct particles of weight > 0, their weights, and an index for each given particle.

    The index is that of the distinct particle at the same place; -1 if its weight is 0.
    """
    points, weights = cloud
    order = np.lexsort(points.T[::-1])
    ordered = points[order]
    fresh = np.ones(len(points), bool)
    fresh[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    place = np.empty(len(points), np.intp)
    place[order] = np.cumsum(fresh) - 1
    total = np.asarray(np.bincount(place, weights), np.float64)
    kept = total > 0
    moved = np.cumsum(kept) - 1
    return ordered[fresh][kept], total[kept], np.where(kept, moved, -1)[place]


def distance(a: Cloud, b: Cloud, order: int) -> float:
    """Return W_q of two clouds. Distinct, sorted particles with weights > 0 make it faster."""
    if are_alike(a, b):
        return 0.0
    if a[0].shape[1] == 1:
        along = np.ones((1, 1))
        return float(line_costs(on_lines(a, along), on_lines(b, along), order)[0] ** (1 / order))
    _check_size(a, b)
    costs = _costs(a[0], b[0], order)
    return float(np.vdot(_optimal(a[1], b[1], costs), costs) ** (1 / order))


def are_alike(a: Cloud, b: Cloud) -> bool:
    """Return whether clouds have the same particles, with weights equal up to rounding.

    Such clouds have the distance 0. Without this rule a tiny mass from rounding would move far, and
    the root of its cost would not be small.
    """
    (x, u), (y, v) = a, b
    return (
        x.shape == y.shape
        and bool((np.abs(u - v) <= WEIGHT_ROUNDING * u).all())
        and bool((x == y).all())
    )


def plan(a: Cloud, b: Cloud, order: int) -> Floats:
    """Return an optimal plan (N, M); particles at the same place share the mass of this place."""
    (x, u, at_x), (y, v, at_y) = _merged(a), _merged(b)
    _check_size((x, u), (y, v))
    # In one dimension merged points are sorted, so that the north-west corner rule is optimal.
    is_line = x.shape[1] == 1
    best = north_west(u, v) if is_line else _optimal(u, v, _costs(x, y, order))
    shares = [
        np.where(at >= 0, weights / total[at], 0.0)
        for at, weights, total in ((at_x, a[1], u), (at_y, b[1], v))
    ]
    return np.asarray(shares[0][:, None] * best[np.ix_(at_x, at_y)] * shares[1])


def north_west(u: Floats, v: Floats) -> Floats:
    """Return the plan of sorted clouds by the north-west corner rule."""
    table = np.zeros((len(u), len(v)))
    i, j, mass = (part[0] for part in _pieces(np.cumsum(u)[None], np.cumsum(v)[None]))
    np.add.at(table, (i, j), mass)
    return table


def _pieces(u: Floats, v: Floats) -> tuple[Ints, Ints, Floats]:
    """Cut the mass into pieces: return the particle of each cloud, and the mass of each piece.

    The shape of each result is (V, N + M - 1). `u` (V, N) and `v` (V, M) are running sums of the
    weights of the particles, sorted along each of V lines. The first axis has size 1 if the weights
    are the same for all lines.
    """
    rows = max(len(u), len(v))
    inner = [np.broadcast_to(ends[:, :-1], (rows, ends.shape[1] - 1)) for ends in (u, v)]
    cuts = np.concatenate(inner, axis=1)
    by_place = np.argsort(cuts, axis=1, kind="stable")
    cuts = np.take_along_axis(cuts, by_place, axis=1).clip(0.0, 1.0)
    of_u = by_place < u.shape[1] - 1  # if False, the cut is one of v
    i = np.concatenate((np.zeros((rows, 1), np.intp), np.cumsum(of_u, axis=1)), axis=1)
    return i, np.arange(i.shape[1]) - i, np.diff(cuts, prepend=0.0, append=1.0, axis=1)


Lines = tuple[Floats, Floats]
"""Sorted projections (V, N) of a cloud on V lines, and running sums of their weights, (V, N) or
(1, N)."""


def on_lines(cloud: Cloud, directions: Floats) -> Lines:
    """Return sorted projections on directions (V, d), with running sums of their weights.

    Routines for matrices are not used, because they may round equal particles differently.
    """
    points, weights = cloud
    places = sum(v[:, None] * x for v, x in zip(directions.T, points.T, strict=True))
    places = np.asarray(places)
    if (weights == weights[0]).all():
        places.sort(axis=1)
        ends = np.cumsum(weights)[None]
    else:
        order = np.argsort(places, axis=1, kind="stable")
        places = np.take_along_axis(places, order, axis=1)
        ends = np.cumsum(weights[order], axis=1)
    ends[:, -1] = 1.0
    return places, ends


def line_costs(a: Lines, b: Lines, order: int) -> Floats:
    """Return W_q^q in one dimension, (V,), by quantiles: ``int_0^1 |F^-1(s) - G^-1(s)|^q ds``."""
    (x, u), (y, v) = a, b
    if u.shape == v.shape and (u == v).all():
        return np.asarray((np.diff(u, prepend=0.0) * np.abs(x - y) ** order).sum(axis=1))
    i, j, mass = _pieces(u, v)
    difference = np.take_along_axis(x, i, axis=1) - np.take_along_axis(y, j, axis=1)
    return np.asarray((mass * np.abs(difference) ** order).sum(axis=1))


def _check_size(a: Cloud, b: Cloud) -> None:
    if len(a[0]) * len(b[0]) > MAX_PARTICLES**2:
        raise ConfigError(f"clouds of {len(a[0])} and {len(b[0])} particles: {too_large()}")


def _costs(x: Floats, y: Floats, order: int) -> Floats:
    """Return distances of particles to the power q, from differences, so that no digits cancel."""
    from scipy.spatial.distance import cdist

    return np.asarray(cdist(x, y, "sqeuclidean" if order == 2 else "euclidean"))


def _optimal(u: Floats, v: Floats, costs: Floats) -> Floats:
    """Return an optimal plan for these costs."""
    if 1 in costs.shape:
        return u[:, None] * v
    if len(u) == len(v) <= ASSIGNED and (u == u[0]).all() and (v == v[0]).all():
        from scipy.optimize import linear_sum_assignment

        table = np.zeros(costs.shape)
        table[linear_sum_assignment(costs)] = 1 / len(u)
        return table
    # POT returns 0 for invalid weights. The weights are valid here, so their sums need no check.
    best, log = _pot().emd(u, v, costs, numItermax=10_000_000, log=True, check_marginals=False)
    if log["warning"] is not None:
        raise SolverError(f"POT did not solve a transport: {log['warning']}")
    return np.asarray(best)


def can_transport() -> bool:
    """Return whether POT is installed."""
    return find_spec("ot") is not None


def _pot() -> ModuleType:
    try:
        from ot import lp  # lazy: slow to import, and an extra
    except ModuleNotFoundError:
        raise ConfigError(POT_NEEDED) from None
    module: ModuleType = lp
    return module
