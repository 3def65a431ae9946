"""Recordings of any length, made a stretch of time after another in memory of one stretch.

The number of targets is the same at every step: whoever leaves is replaced at once. A longer
recording has more steps and is in no other way different.
"""

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.simulation import Tracker

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

GRAIN = 128
"""Positions are multiples of 1/128: files compress to half of what decimals take, and machines
whose sines differ in the last digit still make the same files."""

STATES_MADE_AT_ONCE = 1 << 16
"""Targets times steps of a stretch, about."""

STRETCHES_A_PART = 8
LEAST_PARTS = 4


class Motion(Protocol):
    """Where targets go; a row of numbers says it of each."""

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Draw the numbers of new targets, (count, P)."""
        ...

    def positions(self, drawn: Floats, age: Ints) -> Floats:
        """Positions (B, n, 2) of n targets at ages (B, n) in steps; of no meaning below 0."""
        ...


@dataclass(frozen=True, kw_only=True)
class RecordingKind:
    """A kind of recording.

    Parameters
    ----------
    targets : int
        How many there are at every step.
    lifetimes : (int, int)
        Least and most steps of a target.
    area : float
        Side of the square, in metres.
    motion : Motion
        Where targets go.
    false_speed : float
        Standard deviation of each coordinate of the velocity of false tracks, in metres a step.
    tracker : Tracker
        The errors of the estimate: noise, misses, swaps, fragmentation, false tracks.
    cutoff, switch_penalty : float
        Of the metric, that fit, in metres.
    """

    targets: int
    lifetimes: tuple[int, int]
    area: float
    motion: Motion
    false_speed: float
    tracker: Tracker
    cutoff: float
    switch_penalty: float


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How a recording is divided.

    Parameters
    ----------
    steps : int
        Of all of it.
    stretch : int
        Steps that are made at once.
    part : int
        Steps of a part, a multiple of those.
    """

    steps: int
    stretch: int
    part: int

    @property
    def parts(self) -> int:
        """How many there are."""
        return -(-self.steps // self.part)

    @classmethod
    def of(cls, kind: RecordingKind, rows: int) -> "Layout":
        """The least number of whole steps with so many rows of truth, in four parts at least."""
        steps = -(-rows // kind.targets)
        stretch = min(STATES_MADE_AT_ONCE // kind.targets, max(steps // (2 * LEAST_PARTS), 1))
        stretches = -(-steps // stretch)
        part = stretch * min(STRETCHES_A_PART, max(stretches // LEAST_PARTS, 1))
        return cls(steps=steps, stretch=stretch, part=part)


@dataclass(frozen=True, kw_only=True, eq=False)
class Present:
    """The targets of a stretch of time, in the order of their ids.

    Parameters
    ----------
    first : int
        Its first step, from 0.
    ids : (n,) int64 array
        Of the targets.
    alive : (B, n) bool array
        Which are there.
    positions : (B, n, 2) array
        Of no meaning where they are not.
    """

    first: int
    ids: Ints
    alive: Bools
    positions: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Rows of a side, sorted by time, then id.

    Parameters
    ----------
    t, id : (R,) int64 array
        Times, which count from 1, and ids.
    x, y : (R,) array
        Position, in metres.
    """

    t: Ints
    id: Ints
    x: Floats
    y: Floats


def present_targets(
    kind: RecordingKind, layout: Layout, rng: np.random.Generator
) -> Iterator[Present]:
    """The targets, a stretch after another.

    Lifetimes are log-uniform. At the first step ages and lifetimes are as at any other: a target
    that is met there has a lifetime with a probability in proportion to it, and any age.
    """
    least, most = kind.lifetimes
    lives = np.arange(least, most + 1)
    odds = np.log1p(1 / lives)
    life = rng.choice(lives, kind.targets, p=odds * lives / (odds * lives).sum())
    begin = -(rng.random(kind.targets) * life).astype(np.int64)
    end = begin + life
    ids = np.arange(1, kind.targets + 1)
    drawn = kind.motion.draw(kind.targets, rng)
    odds = np.cumsum(odds / odds.sum())
    for first in range(0, layout.steps, layout.stretch):
        last = min(first + layout.stretch, layout.steps)
        fresh, added = np.sort(end[end < last]), []
        while len(fresh):  # who is born in this stretch may die in it, too
            added.append(fresh)
            life = lives[np.minimum(np.searchsorted(odds, rng.random(len(fresh))), len(lives) - 1)]
            ended = fresh + life
            end = np.append(end, ended)
            begin = np.append(begin, fresh)
            fresh = np.sort(ended[ended < last])
        count = sum(map(len, added))
        ids = np.append(ids, np.arange(ids[-1] + 1, ids[-1] + 1 + count))
        drawn = np.concatenate((drawn, kind.motion.draw(count, rng)))
        step = np.arange(first, last)[:, None]
        yield Present(
            first=first,
            ids=ids,
            alive=(step >= begin) & (step < end),
            positions=kind.motion.positions(drawn, step - begin),
        )
        left = end > last - 1
        ids, begin, end, drawn = ids[left], begin[left], end[left], drawn[left]


def truth_rows(present: Present) -> Rows:
    """What is there, row by row."""
    step, column = np.nonzero(present.alive)
    x, y = rounded(present.positions[present.alive]).T
    return Rows(t=step + present.first + 1, id=present.ids[column], x=x, y=y)


def rounded(positions: Floats) -> Floats:
    """Multiples of 1 / `GRAIN`."""
    nearest: Floats = np.round(positions * GRAIN) / GRAIN
    return nearest
