"""Where the targets of long recordings go: ships in lanes, cars in streets.

A position depends on the numbers of its target and on its age alone, so that any stretch of time
can be made without those before it. Lengths are in metres, speeds in metres a step.
"""

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class ShippingLanes:
    """Ships on straight lanes between ports, and others that go anywhere.

    With the age k a ship is at o + u v k + w a sin(omega k + phi), w across u: o and u of a lane,
    in one of its two directions and to the right of its middle, or anywhere; v, a, omega and phi
    uniform.

    Parameters
    ----------
    area : float
        Side of the square.
    ports : int
        On a square grid of so many a side, in the middle of the fields.
    in_lanes : float
        Share of the ships on lanes; a lane is chosen as often as it is long.
    right, spread : float
        Distance from the middle of a lane: mean and standard deviation.
    speeds, sways, periods : (float, float)
        Least and most of v, a and 2 pi / omega.
    """

    area: float
    ports: int
    in_lanes: float
    right: float
    spread: float
    speeds: tuple[float, float]
    sways: tuple[float, float]
    periods: tuple[float, float]

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Numbers (count, 9) of ships: o, u, v, a, omega, phi."""
        begin, along = self._lanes()
        length = np.hypot(*along.T)
        lane = rng.choice(len(length), count, p=length / length.sum())
        heading = along[lane] / length[lane, None]
        heading *= rng.choice((-1.0, 1.0), count)[:, None]
        start = begin[lane] + along[lane] * rng.random((count, 1))
        start += _right_of(heading) * rng.normal(self.right, self.spread, (count, 1))
        free = rng.random(count) >= self.in_lanes
        anywhere = rng.uniform(0, self.area, (count, 2))
        angle = rng.uniform(0, 2 * np.pi, count)
        start[free] = anywhere[free]
        heading[free] = np.stack((np.cos(angle), np.sin(angle)), axis=-1)[free]
        rates = (
            rng.uniform(*self.speeds, count),
            rng.uniform(*self.sways, count),
            2 * np.pi / rng.uniform(*self.periods, count),
            rng.uniform(0, 2 * np.pi, count),
        )
        return np.column_stack((start, heading, *rates))

    def positions(self, drawn: Floats, age: Ints) -> Floats:
        """Positions (B, n, 2) of n ships at ages (B, n)."""
        x, y, east, north, speed, sway, turn, phase = drawn.T
        ahead = speed * age
        aside = sway * np.sin(turn * age + phase)
        return np.stack(
            (x + east * ahead + north * aside, y + north * ahead - east * aside), axis=-1
        )

    def _lanes(self) -> tuple[Floats, Floats]:
        """Begin and extent of a lane from each port to those a field further and two aside."""
        field = self.area / self.ports
        middle = field * (np.arange(self.ports) + 0.5)
        port = np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)
        ways = field * np.array([(1, 0), (0, 1), (1, 2), (2, -1)])
        begin = np.repeat(port, len(ways), axis=0)
        along = np.tile(ways, (len(port), 1))
        there = ((begin + along > 0) & (begin + along < self.area)).all(axis=1)
        return begin[there], along[there]


@dataclass(frozen=True, kw_only=True)
class Streets:
    """Cars in a square grid of streets, which turn at crossings.

    A car keeps its speed; at each crossing it goes straight on with probability 1/2, else left or
    right. It keeps to the right of the street. At the sides of the square it is reflected.

    Parameters
    ----------
    blocks : int
        Between streets, on each side of the square.
    block : float
        Distance of the streets.
    right : float
        Distance from the middle of the street.
    speeds : (float, float)
        Least and most, each as likely as any between.
    most : int
        Largest age.
    """

    blocks: int
    block: float
    right: float
    speeds: tuple[float, float]
    most: int

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Numbers (count, P): speed, way since the crossing before, then crossings and headings."""
        legs = int(self.most * self.speeds[1] / self.block) + 2
        turn = rng.choice((-1, 0, 0, 1), (count, legs))
        turn[:, 0] = rng.integers(4, size=count)
        heading = np.cumsum(turn, axis=1) % 4
        ways = np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])[heading]
        crossing = rng.integers(self.blocks + 1, size=(count, 1, 2)) + np.cumsum(ways, axis=1)
        crossing -= ways
        speed = rng.uniform(*self.speeds, count)
        since = rng.uniform(0, self.block, count)
        return np.column_stack(
            (speed, since, crossing.reshape(count, 2 * legs), ways.reshape(count, 2 * legs))
        )

    def positions(self, drawn: Floats, age: Ints) -> Floats:
        """Positions (B, n, 2) of n cars at ages (B, n)."""
        legs = (drawn.shape[1] - 2) // 4
        corners, ways = drawn[:, 2:].reshape(len(drawn), 2, legs, 2).swapaxes(0, 1)
        way = drawn[:, 1] + drawn[:, 0] * np.clip(age, 0, self.most)
        leg = (way / self.block).astype(np.int64)
        car = np.arange(len(drawn))
        heading = ways[car, leg]
        middle = self.block * corners[car, leg] + heading * (way - self.block * leg)[..., None]
        area = self.block * self.blocks
        place = middle + self.right * _right_of(heading)
        reflected: Floats = area - np.abs(place % (2 * area) - area)
        return reflected


def _right_of(heading: Floats) -> Floats:
    """The direction to the right."""
    return np.stack((heading[..., 1], -heading[..., 0]), axis=-1)
