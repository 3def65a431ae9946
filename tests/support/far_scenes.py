"""Scenes whose cutoff is far above the errors: every kind that made a number wrong.

For the tests and for ``python tests/benchmarks --parts exactness``. A scene is known by family,
seed and index.
"""

import math
from dataclasses import dataclass

import numpy as np

Array = np.ndarray

KINDS = ("uniform", "walks", "lattice", "swaps", "equal", "near")

LIMIT = 295.0
"""Largest order * log10(cutoff) in either direction: the product refuses 300."""


@dataclass(frozen=True, eq=False)
class FarScene:
    """Trajectories (T, m, d) and (T, n, d), NaN where absent, and parameters of the metric."""

    truth: Array
    estimate: Array
    c: float
    p: float
    gamma: float
    distance: str = "euclidean"

    def __str__(self) -> str:
        steps, m, dimension = self.truth.shape
        return (
            f"{m} x {self.estimate.shape[1]} x {steps} in {dimension}-D, {self.distance}, "
            f"c={self.c!r}, p={self.p!r}, gamma={self.gamma!r}"
        )


def sides(
    rng: np.random.Generator, kind: str, m: int, n: int, steps: int, dimension: int, holes: float
) -> tuple[Array, Array]:
    """Truth and estimate of one of `KINDS`, in units of about 1."""
    shape = (steps, max(m, n), dimension)
    both = np.stack((rng.uniform(0, 1, shape), rng.uniform(0, 1, shape)))
    if kind == "lattice":
        both = rng.integers(0, 3, both.shape).astype(float)
    elif kind != "uniform":
        both[0] = rng.uniform(0, 1, shape[1:]) + np.cumsum(rng.normal(0, 0.2, shape), axis=0)
        error = {"walks": 0.5, "near": 1e-7}.get(kind, 0.0)
        both[1] = both[0] + rng.normal(0, 1, shape) * error
        who = rng.permutation(shape[1])
        for k in range(steps):
            if kind in ("swaps", "near") and shape[1] > 1 and rng.random() < 0.3:
                a, b = rng.choice(shape[1], 2, replace=False)
                who[[a, b]] = who[[b, a]]
            both[1, k] = both[1, k, who]
    truth, estimate = both[0, :, :m].copy(), both[1, :, :n].copy()
    for side in (truth, estimate):
        side[rng.random(side.shape[:2]) < holes] = np.nan
    return truth, estimate


def largest_distance(truth: Array, estimate: Array, distance: str = "euclidean") -> float:
    """Between objects of one step; 1 if nothing is apart."""
    order = {"euclidean": 2, "manhattan": 1, "chebyshev": np.inf}[distance]
    apart = np.linalg.norm(truth[:, :, None] - estimate[:, None], ord=order, axis=3)
    found = float(np.max(apart, initial=0.0, where=~np.isnan(apart)))
    return found or 1.0


def within_range(c: float, p: float) -> float:
    """The cutoff, or the nearest whose power is a double."""
    return min(max(c, 10 ** (-LIMIT / p)), 10 ** (LIMIT / p))


# --- families -------------------------------------------------------------------------------------


def tiny(rng: np.random.Generator) -> FarScene:
    """2 to 3 tracks, 1 to 4 steps; ties, swaps, equal sets, holes; whole orders."""
    m, n, steps = *rng.integers(2, 4, 2).tolist(), int(rng.integers(1, 5))
    kind, holes = str(rng.choice(KINDS)), float(rng.choice([0.0, 0.0, 0.2]))
    distance = str(rng.choice(["euclidean", "euclidean", "manhattan", "chebyshev"]))
    truth, estimate = sides(rng, kind, m, n, steps, int(rng.integers(1, 3)), holes)
    d = largest_distance(truth, estimate, distance)
    p = float(rng.choice([1, 2, 3, 4, 5, 10]))
    c = d * 2 * 10 ** rng.uniform(-0.3, 6)
    return FarScene(truth, estimate, float(c), p, float(d * 10 ** rng.uniform(-3, 6)), distance)


def small(rng: np.random.Generator) -> FarScene:
    """2 to 5 tracks, 1 to 20 steps, contested; cutoff 2 to 10^6 times the largest distance."""
    m, n = rng.integers(2, 6, 2).tolist()
    kind = str(rng.choice(["uniform", "walks", "lattice"]))
    if rng.random() < 0.7:
        n = m
    holes = float(rng.choice([0.0, 0.0, 0.1]))
    truth, estimate = sides(rng, kind, m, n, int(rng.integers(1, 21)), 2, holes)
    d = largest_distance(truth, estimate)
    p = float(rng.choice([1, 2, 3, 5, 10]))
    c = d * 10 ** rng.uniform(math.log10(2), 6)
    return FarScene(truth, estimate, float(c), p, float(d * 10 ** rng.uniform(-3, 1)))


def wild(rng: np.random.Generator) -> FarScene:
    """The same of every kind, in any unit, cutoff up to 10^100 distances, orders not whole."""
    m, n = rng.integers(1, 5, 2).tolist()
    truth, estimate = sides(
        rng,
        str(rng.choice(KINDS)),
        m,
        n,
        int(rng.integers(1, 13)),
        int(rng.integers(1, 4)),
        float(rng.choice([0.0, 0.1, 0.4])),
    )
    unit = 10 ** float(rng.choice([0.0, -6.0, 3.0]))
    truth, estimate = truth * unit, estimate * unit
    d = largest_distance(truth, estimate)
    p = float(rng.choice([1.5, 2.0, 2.9, 4.0, float(10 ** rng.uniform(0, 1))]))
    c = (
        d
        * 2
        * 10 ** float(rng.choice([rng.uniform(0, 6), rng.uniform(0, 20), rng.uniform(0, 100)]))
    )
    return FarScene(truth, estimate, within_range(c, p), p, float(d * 10 ** rng.uniform(-3, 6)))


def walks(
    rng: np.random.Generator, m: int, steps: int, c: float, p: float, gamma: float, error: float
) -> FarScene:
    """Walks with unit steps in a square of 1, 4 or 9 per track; estimates with errors.

    The identities of two estimates are exchanged at every tenth step or so.
    """
    side = math.sqrt(m) * rng.integers(1, 4)
    free = rng.uniform(0, side, (m, 2)) + np.cumsum(rng.normal(0, 1, (steps, m, 2)), axis=0)
    truth = np.abs((free + side) % (2 * side) - side)  # reflected at the borders
    estimate = truth + rng.normal(0, error, truth.shape)
    who = np.arange(m)
    for k in range(steps):
        if rng.random() < 0.1:
            a, b = rng.choice(m, 2, replace=False)
            who[[a, b]] = who[[b, a]]
        estimate[k] = estimate[k, who]
    return FarScene(truth, estimate, c, p, gamma)


RANDOM = {"tiny": tiny, "small": small, "wild": wild}

WALKS = {
    f"walks {m}x{m}x{steps} p={p} c={c:g}": (m, steps, float(c), float(p), gamma, error)
    for m, steps, gamma, error, settings in (
        (5, 10, 1.0, 0.5, ((10, 50), (10, 100), (2, 1e8))),
        (
            10,
            20,
            1.0,
            0.5,
            ((2, 1e4), (2, 1e5), (5, 20), (5, 50), (5, 100), (10, 5), (10, 10), (10, 20)),
        ),
        (12, 100, 0.1, 1.0, ((2, 1e3),)),
        (24, 40, 1.0, 0.5, ((2, 1e4),)),
    )
    for p, c in settings
}

FAMILIES = (*RANDOM, *WALKS)


def far_scene(family: str, seed: int, index: int) -> FarScene:
    """The scene of that number."""
    rng = np.random.default_rng([FAMILIES.index(family), seed, index])
    if family in RANDOM:
        return RANDOM[family](rng)
    m, steps, c, p, gamma, error = WALKS[family]
    return walks(rng, m, steps, c, p, gamma, error)
