"""Scenes to measure on: targets that move in a square, and what a tracker makes of them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Floats = NDArray[np.float64]
Ints = NDArray[np.integer]

SPEED_STEP = 0.2
DETECTION = 0.95
SWAP_RATE = 0.03
FALSE_LENGTHS = (3, 12)
"""Steps of a false track, half-open."""


@dataclass(frozen=True)
class Scene:
    """`targets` in a square of side `area` for `steps`, seen with errors N(0, `noise`)."""

    targets: int
    steps: int
    area: float
    noise: float = 0.5

    @classmethod
    def parse(cls, text: str) -> "Scene":
        """From ``"10,50,20,0.5"``; the noise may be left out."""
        targets, steps, *rest = text.split(",")
        return cls(int(targets), int(steps), *(float(number) for number in rest))

    def __str__(self) -> str:
        return f"{self.targets},{self.steps},{self.area:g},{self.noise:g}"

    @property
    def estimates(self) -> int:
        """One for each target, and a false one for every five."""
        return self.targets + self.targets // 5

    def arrays(self, seed: int) -> tuple[Floats, Floats]:
        """Truths (T, m, 2) and estimates (T, n, 2), NaN where absent."""
        frames = list(self.frames(seed))
        return np.stack([truth for truth, _ in frames]), np.stack([seen for _, seen in frames])

    def frames(self, seed: int) -> Iterator[tuple[Floats, Floats]]:
        """Truths (m, 2) and estimates (n, 2) of each step.

        The velocity walks at random, the border reflects. A target that loses its identity swaps it
        with the nearest target.
        """
        rng = np.random.default_rng(seed)
        m = self.targets
        position = rng.uniform(0, self.area, (m, 2))
        velocity = rng.normal(0, 1, (m, 2))
        identity = np.arange(m)
        clutter = _Clutter(rng, m // 5, self.steps, self.area)
        for step in range(self.steps):
            swap(identity, position, np.flatnonzero(rng.random(m) < SWAP_RATE))
            seen = np.full((self.estimates, 2), np.nan)
            detected = rng.random(m) < DETECTION
            noisy = position + rng.normal(0, self.noise, (m, 2))
            seen[identity[detected]] = noisy[detected]
            seen[m:] = clutter.at(step)
            yield position, seen
            velocity = velocity + rng.normal(0, SPEED_STEP, (m, 2))
            position, velocity = reflect(position + velocity, velocity, self.area)


class _Clutter:
    """Short tracks with constant velocity that nothing real causes."""

    def __init__(self, rng: np.random.Generator, count: int, steps: int, area: float) -> None:
        length = rng.integers(*FALSE_LENGTHS, count)
        self.begin = rng.integers(0, np.maximum(steps - length, 1))
        self.end = self.begin + length
        self.origin = rng.uniform(0, area, (count, 2))
        self.velocity = rng.normal(0, 1, (count, 2))

    def at(self, step: int) -> Floats:
        alive = (self.begin <= step) & (step < self.end)
        where = self.origin + self.velocity * (step - self.begin)[:, None]
        return np.where(alive[:, None], where, np.nan)


def swap(identity: Ints, position: Floats, who: Ints) -> None:
    """Exchange the identities of the given targets with those of their nearest neighbours."""
    if len(position) < 2 or not len(who):
        return
    nearest = KDTree(position).query(position[who], k=2)[1]
    other = np.where(nearest[:, 0] == who, nearest[:, 1], nearest[:, 0])
    for a, b in zip(who.tolist(), other.tolist(), strict=True):
        identity[[a, b]] = identity[[b, a]]


def reflect(position: Floats, velocity: Floats, area: float) -> tuple[Floats, Floats]:
    """Fold positions back into the square, as often as needed."""
    crossings = np.floor(position / area)
    inside = position - crossings * area
    odd = crossings % 2 == 1
    return np.where(odd, area - inside, inside), np.where(odd, -velocity, velocity)
