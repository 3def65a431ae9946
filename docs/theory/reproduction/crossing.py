"""Crossing targets of [Danu], equations 28 and 29 with T = 1 s, and their exact posteriors.

A state is (x, vx, y, vy). Sensors see positions; labels are known here and nothing is missed or
false. The model is linear and normal, so that Kalman filters give the posteriors which particle
filters approximate.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tgospa_eval.distances import reduce_cloud, resample_cloud, restrict_cloud

F = np.array([[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1.0]])
G = np.array([[0.5, 0], [1, 0], [0, 0.5], [0, 1]])
H = np.array([[1, 0, 0, 0], [0, 0, 1, 0.0]])
PLACE = [0, 2]
DRIVE, NOISE = np.array([1.0, 0.1]), 2.5
"""Standard deviations of the process and of a measured component."""

Q, R = G @ np.diag(DRIVE**2) @ G.T, NOISE**2 * np.eye(2)
STARTS = np.array([(-63.1, 3.8, 40, -1.8), (-35.1, 2.1, 75, -3.1)])
P0 = np.diag([6.25, 1, 6.25, 1])
PARTICLES, STEPS = 2000, (14, 16)

Floats = np.ndarray
Cloud = tuple[Floats, Floats]

WAYS: dict[str, Callable[[Cloud, int, np.random.Generator], Cloud]] = {
    "highest weights": lambda cloud, n, _: restrict_cloud(*cloud, n),
    "multinomial": lambda cloud, n, rng: resample_cloud(*cloud, n, method="multinomial", rng=rng),
    "stratified": lambda cloud, n, rng: resample_cloud(*cloud, n, method="stratified", rng=rng),
    "systematic": lambda cloud, n, rng: resample_cloud(*cloud, n, method="systematic", rng=rng),
    "sliced": lambda cloud, n, _: reduce_cloud(*cloud, n),
}
"""To fewer particles."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What two sensors have of two targets at a step.

    `clouds[s][k]` is that of sensor s of target k, before resampling; `means` (2, 2, 4) and
    `covariance` (4, 4) are those of the exact posteriors.
    """

    step: int
    clouds: list[list[Cloud]]
    means: Floats
    covariance: Floats


def truths(rng: np.random.Generator, meet: int | None = None) -> Floats:
    """States (K + 1, 2, 4); with `meet` the second path is moved to the first at that step."""
    path = [STARTS]
    for _ in range(max(STEPS)):
        path.append(path[-1] @ F.T + rng.standard_normal((2, 2)) * DRIVE @ G.T)
    states = np.array(path)
    if meet is not None:
        states[:, 1, PLACE] += states[meet, 0, PLACE] - states[meet, 1, PLACE]
    return states


def moved(points: Floats, rng: np.random.Generator) -> Floats:
    """Particles a step later."""
    return points @ F.T + rng.standard_normal((len(points), 2)) * DRIVE @ G.T


def position(cloud: Cloud) -> Cloud:
    """Without velocities."""
    return cloud[0][:, PLACE], cloud[1]


def moments(cloud: Cloud) -> tuple[Floats, Floats]:
    """Mean, and covariance with divisor 1."""
    mean = cloud[1] @ cloud[0]
    apart = cloud[0] - mean
    return mean, (apart * cloud[1][:, None]).T @ apart


def particle_filter(start: Floats, seen: Floats, rng: np.random.Generator) -> dict[int, Cloud]:
    """A bootstrap filter; the clouds of `STEPS`, before they are resampled."""
    points = rng.multivariate_normal(start, P0, PARTICLES)
    weights = np.full(PARTICLES, 1 / PARTICLES)
    kept = {}
    for step, y in enumerate(seen, 1):
        points = moved(points[rng.choice(PARTICLES, PARTICLES, p=weights)], rng)
        squares = ((y - points[:, PLACE]) ** 2).sum(axis=1) / NOISE**2
        weights = np.exp(-0.5 * (squares - squares.min()))
        weights /= weights.sum()
        if step in STEPS:
            kept[step] = points, weights
    return kept


def kalman_filter(start: Floats, seen: Floats) -> dict[int, tuple[Floats, Floats]]:
    """Mean and covariance of the same posteriors."""
    mean, spread = start, P0
    kept = {}
    for step, y in enumerate(seen, 1):
        mean, spread = F @ mean, F @ spread @ F.T + Q
        gain = spread @ H.T @ np.linalg.inv(H @ spread @ H.T + R)
        mean, spread = mean + gain @ (y - H @ mean), spread - gain @ H @ spread
        kept[step] = mean, spread
    return kept


def scenes(seed: int, meet: int | None = None) -> list[Scene]:
    """One run, at each of `STEPS`."""
    rng = np.random.default_rng(seed)
    states = truths(rng, meet)
    seen = states[1:, :, PLACE] + NOISE * rng.standard_normal((2, len(states) - 1, 2, 2))
    filtered = [[particle_filter(states[0, k], seen[s, :, k], rng) for k in (0, 1)] for s in (0, 1)]
    exact = [[kalman_filter(states[0, k], seen[s, :, k]) for k in (0, 1)] for s in (0, 1)]
    return [
        Scene(
            step=step,
            clouds=[[each[step] for each in side] for side in filtered],
            means=np.array([[each[step][0] for each in side] for side in exact]),
            covariance=exact[0][0][step][1],
        )
        for step in STEPS
    ]
