"""Reduction of a particle cloud to fewer particles (Dirac mixture reduction).

The sliced method minimises the mean squared Wasserstein distance of projections,

    sum_k W_2^2(v_k' X, v_k' Y)  over the positions X of n particles of weight 1/n.

In each direction v_k the sorted projections of Y are cut into n slots of equal mass. b_k[r] is the
mean of slot r. It is the best partner of the particle of X whose projection has the rank r. For
fixed ranks, least squares give all particles at once,

    x_i <- S^-1 sum_k v_k b_k[rank of v_k' x_i],   S = sum_k v_k v_k'.

No step increases the sum. This is algorithm 2 of [Prossel] without its large sparse matrix R: for
all permutations R'R is block diagonal with blocks S. docs/theory/clouds.md lists corrections of the
paper.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.base import DistanceSettings
from tgospa_eval.distances.transport import (
    RESAMPLING,
    Cloud,
    as_cloud,
    distance,
    line_costs,
    merged,
    on_lines,
    plan,
    restrict_cloud,
    sampled,
)
from tgospa_eval.errors import ConfigError, whole_number
from tgospa_eval.quoting import quoted

METHODS = ("sliced", "recursive", "atl", "kmeans", *RESAMPLING, "top")

PRIOR = 100.0
"""Variance that the recursive method assumes for the positions before each iteration. The unit is
the variance of a slot mean."""


@dataclass(frozen=True, kw_only=True)
class Reduction:
    """Settings of the reduction of clouds.

    Parameters
    ----------
    size : int
        Number of particles to keep, >= 1. A cloud of at most `size` particles is not changed. If a
        cloud has at most `size` distinct particles, these are kept with their weights.
    method : str
        ``"sliced"``: least squares on projections on `directions`; ``"recursive"``: the same,
        direction by direction; ``"atl"``: transport and location in turn (Cooper); ``"kmeans"``:
        means of clusters, weighted with the mass of the clusters; ``"systematic"``,
        ``"stratified"``, ``"multinomial"``: resampling; ``"top"``: the highest weights.
    directions : int or (V, d) array-like, optional
        Number of directions of sliced and recursive. The default is 32 in two dimensions, and 24 d
        in d > 2. An array has the V directions themselves, as rows that span the space.
    iterations : int
        Largest number of iterations of sliced, recursive, atl and kmeans.
    restarts : int
        Number of starts of these four methods. Starts after the first are random, and the result
        nearest to the cloud is kept.
    polish : int
        Number of steps of ``"atl"`` after the last iteration of sliced and recursive.
    seed : int
        Seed of random directions, starts and draws. Each cloud uses the same seed, so equal clouds
        have equal reductions, in any order of their particles.

    Raises
    ------
    ConfigError
        The size is below 1, the method is unknown, or a number is out of its range.
    """

    size: int
    method: str = "sliced"
    directions: int | ArrayLike | None = None
    iterations: int = 25
    restarts: int = 1
    polish: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        size = whole_number("size", self.size)
        object.__setattr__(self, "size", size)
        if self.method not in METHODS:
            raise ConfigError(
                f"reduce-method is {quoted(self.method)}: must be one of {', '.join(METHODS)}"
            )
        for name, low in (("iterations", 1), ("restarts", 1), ("polish", 0), ("seed", 0)):
            whole_number(name, getattr(self, name), low)
        if self.directions is not None and np.ndim(self.directions) == 0:
            whole_number("directions", self.directions)

    def settings(self) -> DistanceSettings:
        """Return the settings that change the value, by the names of the options."""
        record: DistanceSettings = {"reduce": self.size, "reduce_method": self.method}
        if self.method != "top":
            record["seed"] = self.seed
        if self.method in _METHODS:
            record |= {"iterations": self.iterations, "restarts": self.restarts}
        if self.method in ("sliced", "recursive"):
            given = self.directions
            record["directions"] = given if given is None else np.asarray(given).tolist()
            record["polish"] = self.polish
        return record

    def __call__(self, cloud: Cloud, start: Floats | None = None) -> Cloud:
        """Return the cloud with fewer particles; points (N, d), weights (N,) that sum to 1.

        `start` has the first positions (size, d). By default these are drawn systematically.
        """
        return self.trace(cloud, start)[0]

    def trace(self, cloud: Cloud, start: Floats | None = None) -> tuple[Cloud, list[float]]:
        """Return the reduced cloud, and the distance to the given cloud before each iteration.

        The distance is the root of the objective of the method. The objective of sliced and
        recursive is the mean of W_2^2 along the directions ([Prossel] equation 12). For atl it is
        W_2^2 (equation 3), and for kmeans the mean squared distance to the nearest centre. The list
        is empty for other methods, and for a cloud of at most `size` distinct particles.
        """
        points, weights = cloud
        if self.size >= len(points):
            return cloud, []
        points, weights = merged(cloud)  # sorted, so that equal clouds have equal reductions
        if self.size >= len(points):
            return (points, weights), []
        rng = np.random.default_rng(self.seed)
        if self.method == "top":
            return restrict_cloud(points, weights, self.size), []
        if self.method in RESAMPLING:
            chosen = sampled(weights, self.size, self.method, None, rng)
            return (points[chosen], np.full(self.size, 1 / self.size)), []
        centre = weights @ points  # coordinates relative to it keep their digits in sums
        centred = points - centre, weights
        step = _METHODS[self.method](self, centred, rng)
        attempts = []
        for k in range(self.restarts):
            if k:
                first = centred[0][sampled(weights, self.size, "multinomial", None, rng)]
            elif start is not None:
                first = start - centre
            else:
                first = centred[0][sampled(weights, self.size, "systematic", 0.5)]
            attempts.append(self._improved(centred, first, step))
        best = attempts[0]
        if len(attempts) > 1:
            best = min(attempts, key=lambda each: distance(merged(each[0]), centred, 2))
        (x, mass), costs = best
        return (x + centre, mass), costs

    def _improved(self, cloud: Cloud, x: Floats, step: "Step") -> tuple[Cloud, list[float]]:
        """Iterate until positions do not change, or up to the limit; then polish."""
        costs = []
        for _ in range(self.iterations):
            before = x
            (x, weights), cost = step(x)
            costs.append(cost)
            if np.array_equal(before, x):
                break
        if self.method in ("sliced", "recursive"):
            for _ in range(self.polish):
                x = _relocated(cloud, x)[0][0]
        return (x, weights), [float(np.sqrt(max(cost, 0.0))) for cost in costs]


def reduce_cloud(
    points: ArrayLike,
    weights: ArrayLike | None,
    size: int,
    *,
    method: str = "sliced",
    directions: int | ArrayLike | None = None,
    iterations: int = 25,
    restarts: int = 1,
    polish: int = 0,
    seed: int = 0,
    start: ArrayLike | None = None,
) -> tuple[Floats, Floats]:
    """Return a cloud of fewer particles that is near the given one; the mean is kept.

    Parameters
    ----------
    points : (N, d) array-like
        Particles.
    weights : (N,) array-like or None
        Weights >= 0, not all zero, which are normalised. None means equal weights.
    size : int
        Number of particles to keep, >= 1. A cloud of at most `size` particles is returned as it is.
        If a cloud has at most `size` distinct particles, these are returned with their weights.
    method, directions, iterations, restarts, polish, seed
        See `Reduction`. Resampling and ``"top"`` do not keep the mean.
    start : (size, d) array-like, optional
        First positions. By default these are drawn systematically.

    Returns
    -------
    points, weights : (size, d) and (size,) arrays
        Particles of equal weight, except with ``"kmeans"`` and ``"top"``.

    Raises
    ------
    ConfigError
        As for `cloud_wasserstein`; a setting is invalid; or POT, which ``"atl"``, `polish` and
        `restarts` need, is not installed.

    Notes
    -----
    Source: [Prossel], sections II and III, corrected.
    """
    cloud = as_cloud(points, weights, "cloud")
    reduction = Reduction(
        size=size,
        method=method,
        directions=directions,
        iterations=iterations,
        restarts=restarts,
        polish=polish,
        seed=seed,
    )
    first = None
    if start is not None:
        first = np.asarray(start, np.float64)
        if first.shape != (size, cloud[0].shape[1]) or not np.isfinite(first).all():
            raise ConfigError(
                f"start has the shape {first.shape}: must be ({size}, {cloud[0].shape[1]}), finite"
            )
    return reduction(cloud, first)


def sliced_wasserstein(a: Cloud, b: Cloud, directions: Floats) -> float:
    """Return the root of the mean of W_2^2 over projections on unit directions (V, d)."""
    squares = line_costs(on_lines(a, directions), on_lines(b, directions), 2)
    return float(np.sqrt(squares.mean()))


def spread_directions(size: int, count: int | None, rng: "np.random.Generator") -> Floats:
    """Return evenly spread unit vectors (V, d): fixed angles if d = 2, random frames if d > 2.

    If d > 2, V is rounded up to whole frames. If d = 1, there is one vector.
    """
    if size == 1:
        return np.ones((1, 1))
    if size == 2:
        number = count or 32
        angle = np.pi * (np.arange(number) + 0.5) / number
        return np.column_stack((np.cos(angle), np.sin(angle)))
    frames = -(-(count or 24 * size) // size)
    turned, upper = np.linalg.qr(rng.standard_normal((frames, size, size)))
    signs = np.sign(np.diagonal(upper, axis1=1, axis2=2))  # else some rotations are preferred
    return np.asarray(turned * signs[:, None, :]).transpose(0, 2, 1).reshape(-1, size)


def slot_means(values: Floats, weights: Floats, size: int) -> Floats:
    """Sort values (N,), cut them into `size` slots of equal mass, and return the slot means.

    The slots are cut from the cumulative sums of weight and of weight times value, without a plan.
    """
    order = np.argsort(values, kind="stable")
    mass = np.concatenate(([0.0], np.cumsum(weights[order])))
    moment = np.concatenate(([0.0], np.cumsum(weights[order] * values[order])))
    return size * np.diff(np.interp(np.arange(size + 1) / size, mass / mass[-1], moment))


# --- methods: each takes a cloud, and returns a function that improves positions ------------------

Step = Callable[[Floats], tuple[Cloud, float]]
"""Function of positions. It returns better positions with weights, and the cost of the given
positions."""


def _projections(
    reduction: Reduction, cloud: Cloud, rng: "np.random.Generator"
) -> tuple[Floats, Floats, float]:
    """Return directions (V, d), slot means (V, n) of projections, and mean variance in slots."""
    size = cloud[0].shape[1]
    if reduction.directions is None or np.ndim(reduction.directions) == 0:
        count = reduction.directions
        v = spread_directions(size, None if count is None else int(count), rng)  # type: ignore[arg-type]
    else:
        v = np.array(reduction.directions, dtype=np.float64)
        if v.ndim != 2 or v.shape[1] != size or not np.isfinite(v).all():
            raise ConfigError(f"directions have the shape {v.shape}: must be (V, {size}), finite")
    if np.linalg.matrix_rank(v) < size:
        raise ConfigError(
            f"{len(v)} directions do not span {size} dimensions; give at least {size}, "
            "not all in a plane"
        )
    b = np.array([slot_means(cloud[0] @ each, cloud[1], reduction.size) for each in v])
    return v, b, float((((cloud[0] @ v.T) ** 2).T @ cloud[1]).mean() - (b**2).mean())


def _matched(v: Floats, b: Floats, x: Floats) -> Floats:
    """Return the slot mean that belongs to the rank of each particle in each direction, (V, n).

    `v` are the directions, `b` the slot means, and `x` the positions. Equal projections are ranked
    in the order of `x`. So particles at the same place have different ranks, and the next step
    moves them to different places.
    """
    order = np.argsort(v @ x.T, axis=1, kind="stable")
    matched = np.empty_like(b)
    np.put_along_axis(matched, order, b, axis=1)
    return matched


def _sliced(reduction: Reduction, cloud: Cloud, rng: "np.random.Generator") -> Step:
    v, b, within = _projections(reduction, cloud, rng)
    solve = np.linalg.solve(v.T @ v, v.T)

    def step(x: Floats) -> tuple[Cloud, float]:
        matched = _matched(v, b, x)
        return _even((solve @ matched).T), float(((v @ x.T - matched) ** 2).mean()) + within

    return step


def _recursive(reduction: Reduction, cloud: Cloud, rng: "np.random.Generator") -> Step:
    """Iterate ``x <- x + K (b - v'x)``, ``K = C v / (1 + v'C v)``, ``C <- C - K v'C`` for each v.

    [Prossel] equations 19 to 24, with the gain in equation 20: least squares with a weak pull to
    the start. Ranks are computed once, before the first v: new ranks for each v lead to worse
    positions.
    """
    v, b, within = _projections(reduction, cloud, rng)

    def step(x: Floats) -> tuple[Cloud, float]:
        matched = _matched(v, b, x)
        cost = float(((v @ x.T - matched) ** 2).mean()) + within
        covariance = PRIOR * np.eye(v.shape[1])
        for each, targets in zip(v, matched, strict=True):
            gain = covariance @ each / (1 + each @ covariance @ each)
            x = x + np.outer(targets - x @ each, gain)
            covariance = covariance - np.outer(gain, each @ covariance)
        return _even(x), cost

    return step


def _atl(reduction: Reduction, cloud: Cloud, rng: "np.random.Generator") -> Step:  # noqa: ARG001
    return lambda x: _relocated(cloud, x)


def _even(x: Floats) -> Cloud:
    return x, np.full(len(x), 1 / len(x))


def _relocated(cloud: Cloud, x: Floats) -> tuple[Cloud, float]:
    """Move each particle to the mean of its mass in an optimal plan, [Prossel] equation 7.

    Also return the cost of the plan, as |x|^2 + |y|^2 - 2 x'y under the plan.
    """
    points, weights = cloud
    brought = plan(_even(x), cloud, 2) @ points
    squares = (x**2).sum() / len(x) + weights @ (points**2).sum(axis=1)
    return _even(np.asarray(len(x) * brought)), float(squares - 2 * (x * brought).sum())


def _kmeans(reduction: Reduction, cloud: Cloud, rng: "np.random.Generator") -> Step:  # noqa: ARG001
    """Iterate Lloyd's algorithm; a centre without particles moves to the costliest particle."""
    from scipy.spatial.distance import cdist

    points, weights = cloud

    def step(x: Floats) -> tuple[Cloud, float]:
        squares = cdist(points, x, "sqeuclidean")
        nearest = squares.argmin(axis=1)
        cost = weights * squares[np.arange(len(points)), nearest]
        total = float(cost.sum())
        for empty in np.flatnonzero(np.bincount(nearest, minlength=len(x)) == 0):
            only_one = np.bincount(nearest, minlength=len(x))[nearest] == 1
            worst = int(np.argmax(np.where(only_one, -1.0, cost)))
            nearest[worst], cost[worst] = empty, 0.0
        mass = np.asarray(np.bincount(nearest, weights, len(x)), np.float64)
        sums = [np.bincount(nearest, weights * each, len(x)) for each in points.T]
        return (np.column_stack(sums) / mass[:, None], mass), total

    return step


_METHODS: "dict[str, Callable[[Reduction, Cloud, np.random.Generator], Step]]" = {
    "sliced": _sliced,
    "recursive": _recursive,
    "atl": _atl,
    "kmeans": _kmeans,
}
