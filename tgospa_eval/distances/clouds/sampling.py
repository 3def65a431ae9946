"""Fewer particles, by choice or by chance: highest weights and the usual resampling methods.

Sources: [Danu], sections 4.2 and 4.3. Knows single clouds only.
"""

import math
import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tgospa_eval.errors import ConfigError, TgospaWarning, real_number
from tgospa_eval.text import quoted
from tgospa_eval.tracks.clouds import LARGEST_COORDINATE, UNEVEN_SUM, are_normalised

Floats = NDArray[np.float64]

RESAMPLING = ("systematic", "stratified", "multinomial")


def as_cloud(
    points: ArrayLike, weights: ArrayLike | None, name: str, *, depth: int = 2
) -> tuple[Floats, Floats]:
    """Points (N, d) and weights (N,) that sum to 1; `name` begins the messages.

    Weights that are None are equal ones. A warning is for the line `depth` calls further out.

    Warns
    -----
    UserWarning
        The weights sum to something else than 1, by more than 1e-3.

    Raises
    ------
    ConfigError
        Not the shapes (N, d) or (N,) and (N,), no particles, a number that is not finite or a
        coordinate beyond 1e150, a negative weight, or no weight above zero.
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
    fault = weight_fault(given)
    if fault is not None:
        raise ConfigError(f"{name}: {fault[1]}")
    # Divided first: a sum of huge weights may overflow. Exact: the order of particles is no matter.
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


def weight_fault(weights: Floats) -> tuple[int, str] | None:
    """The first weight of a cloud that cannot be one, and what is wrong with it."""
    for wrong, what in (
        (np.isnan(weights), "a weight is NaN or blank"),
        (np.isinf(weights), "a weight is infinite"),
        (weights < 0, "a weight is negative"),
    ):
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            value = "" if np.isnan(weights[row]) else f" ({weights[row]:g})"
            return row, f"{what}{value}; weights must be finite, >= 0 and not all zero"
    if not (weights > 0).any():
        return 0, "all weights are zero; weights must be finite, >= 0 and not all zero"
    return None


def as_size(size: object) -> int:
    """A number of particles.

    Raises
    ------
    ConfigError
        The size is no whole number, or below 1.
    """
    if isinstance(size, bool) or not isinstance(size, int | np.integer) or size < 1:
        raise ConfigError(f"size is {size!r}: must be a whole number of particles, from 1")
    return int(size)


def restrict_cloud(
    points: ArrayLike, weights: ArrayLike | None, size: int
) -> tuple[Floats, Floats]:
    """The particles of the highest weights, their weights normalised again.

    The tails of the distribution go with the light particles: the distance between clouds that are
    restricted to few is biased, often by a third and more. Offered for comparisons.

    Parameters
    ----------
    points : (N, d) array-like
        Particles.
    weights : (N,) array-like or None
        >= 0, not all zero; normalised. None: equal ones.
    size : int
        Particles to keep, >= 1; of equal weights the earlier. All are kept if there are no more.

    Returns
    -------
    points, weights : (n, d) and (n,) arrays
        By descending weight, with the sum 1.

    Raises
    ------
    ConfigError
        As for `cloud_wasserstein`, or `size` is below 1.

    Notes
    -----
    Source: [Danu], section 4.2.
    """
    points, weights = as_cloud(points, weights, "cloud")
    size = as_size(size)
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
    """Particles drawn with replacement, each with the weight ``1 / size``.

    The i-th is the first whose cumulative weight exceeds u_i, where

    - systematic: ``u_i = (i + U) / size`` with one U;
    - stratified: ``u_i = (i + U_i) / size``;
    - multinomial: ``u_i = U_i``;

    and U is uniform in [0, 1).

    Parameters
    ----------
    points : (N, d) array-like
        Particles.
    weights : (N,) array-like or None
        >= 0, not all zero; normalised. None: equal ones.
    size : int
        Particles to draw, >= 1.
    method : {"systematic", "stratified", "multinomial"}
        How.
    offset : float or (size,) array-like, optional
        U or the U_i, in [0, 1], instead of random ones; at u_i = 1 the last particle is taken.
    rng : numpy.random.Generator or int, optional
        Where they come from, or a seed; 0 by default.

    Returns
    -------
    points, weights : (size, d) and (size,) arrays
        In the order of the u_i.

    Raises
    ------
    ConfigError
        As for `cloud_wasserstein`, or an unknown method, a size below 1, an offset outside [0, 1].

    Notes
    -----
    Source: [Danu], section 4.3.
    """
    points, weights = as_cloud(points, weights, "cloud")
    size = as_size(size)
    chosen = drawn(weights, size, method, offset, rng)
    return points[chosen], np.full(size, 1 / size)


def drawn(
    weights: Floats,
    size: int,
    method: str,
    offset: float | ArrayLike | None = None,
    rng: "np.random.Generator | int | None" = None,
) -> NDArray[np.intp]:
    """Positions of the particles that are drawn; the weights sum to 1."""
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
            f"offset must be in [0, 1], one number{'' if count == 1 else f' or {count}'}"
        )
    at = within if method == "multinomial" else (np.arange(size) + within) / size
    # Rounding may leave the last sum below 1, and a particle without weight is never drawn.
    last = np.flatnonzero(weights)[-1]
    return np.searchsorted(np.cumsum(weights), np.broadcast_to(at, (size,)), side="right").clip(
        max=last
    )


def _generator(rng: "np.random.Generator | int | None") -> "np.random.Generator":
    try:
        return np.random.default_rng(0 if rng is None else rng)
    except (TypeError, ValueError):
        raise ConfigError(f"rng is {rng!r}: must be a numpy.random.Generator or a seed") from None
