"""What of either side is read for a block of steps, and how its rows come to these steps."""

import itertools
from collections.abc import Iterator
from functools import cached_property
from typing import Protocol

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.formats import Reading
from tgospa_eval.problem.problem import Ints
from tgospa_eval.tracks.alignment import Times
from tgospa_eval.tracks.interpolation import found_at
from tgospa_eval.tracks.trajectories import Trajectories

Ends = tuple[float, float]
"""The first and the last of some times."""

NO_SPAN = (1, 0)
"""The ends of none."""


class Readable(Protocol):
    """One side of the data, from which any stretch of time can be read."""

    def read(self, first: float, last: float) -> Reading:
        """The rows from one time to another, both included."""


class SideStretch(Protocol):
    """What of a side is read for a block."""

    def read(self) -> Reading:
        """Its rows."""

    def at(self, found: Trajectories, times: Times) -> Trajectories:
        """Those rows at the steps of the block."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockPiece:
    """Some steps, and what is read for them.

    Parameters
    ----------
    low, high : int
        The first step, and the one after the last; there may be none.
    stretches : pair of SideStretch
        Of truth and estimate.
    told : bool
        Whether what is read is to be counted: no other piece counts it.
    """

    low: int
    high: int
    stretches: tuple[SideStretch, SideStretch]
    told: bool = True


class BlockPlan(Protocol):
    """Both sides along the steps."""

    @property
    def rows(self) -> Ints:
        """Rows of both at each step (T,)."""

    def pieces(self, most: int) -> Iterator[BlockPiece]:
        """All steps, and all stamps of either side, in pieces of about so many rows."""

    def piece(self, low: int, high: int) -> BlockPiece:
        """What is read for steps from `low` on, up to `high` at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stamped:
    """A stretch whose own stamps are steps, or not.

    Parameters
    ----------
    side : Readable
        The side.
    span : pair of int or float
        What is read: from one time to another.
    own, step : (k,) arrays
        Times that are steps, and which of the block.
    """

    side: Readable
    span: Ends
    own: Times
    step: Ints

    def read(self) -> Reading:
        """Its rows."""
        return self.side.read(*self.span)

    def at(self, found: Trajectories, times: Times) -> Trajectories:
        """Those at steps."""
        place, there = found_at(found.times, self.own)
        rows = np.flatnonzero(there[found.step])
        return found.chosen(rows, self.step[place[found.step[rows]]], times)


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnTimes:
    """The stamps of a side.

    Parameters
    ----------
    side : Readable
        The side.
    times : (K,) array
        Distinct, in order.
    counts : (K,) int array
        Rows at each.
    step : (K,) int array
        Which step each is, -1 for none.
    """

    side: Readable
    times: Times
    counts: Ints
    step: Ints


@dataclass(frozen=True, kw_only=True, eq=False)
class Stamping:
    """Sides whose own stamps are steps, or not.

    Parameters
    ----------
    times : (T,) array
        The steps.
    sides : pair of OwnTimes
        Of truth and estimate.
    """

    times: Times
    sides: tuple[OwnTimes, OwnTimes]

    @cached_property
    def rows(self) -> Ints:
        """Rows of both at each step (T,), those between it and the next as well."""
        rows = np.zeros(len(self.times), np.int64)
        if len(rows):
            for side, moments in zip(self.sides, self.moments, strict=True):
                begin, end = places(moments, self.times[0], self.times[-1])
                at = np.searchsorted(self.times, moments[begin:end], side="right") - 1
                np.add.at(rows, at, side.counts[begin:end])
        return rows

    @cached_property
    def moments(self) -> tuple[Times, ...]:
        """Times of both, each in the order in which they and the steps are."""
        found = []
        for side in self.sides:
            on = side.step >= 0
            moments = side.times.astype(np.result_type(side.times, self.times))
            moments[on] = self.times[side.step[on]]
            found.append(moments)
        return tuple(found)

    def pieces(self, most: int) -> Iterator[BlockPiece]:
        """All steps, and all stamps of either side, in pieces of about so many rows."""
        for begin, end in self.spans(most):
            yield self._between(begin, end)

    def spans(self, most: int) -> Iterator[Ends]:
        """The first and the last moment of each piece."""
        moments = np.unique(np.concatenate((*self.moments, self.times)))
        rows = np.zeros(len(moments), np.int64)
        for side, own in zip(self.sides, self.moments, strict=True):
            rows[np.searchsorted(moments, own)] += side.counts
        before = np.cumsum(rows) - rows
        cuts = np.flatnonzero(np.diff(before // most, prepend=-1))
        for begin, end in itertools.pairwise([*cuts.tolist(), len(moments)]):
            yield moments[begin].item(), moments[end - 1].item()

    def piece(self, low: int, high: int) -> BlockPiece:
        """What is read for these steps."""
        return self._between(self.times[low].item(), self.times[high - 1].item())

    def _between(self, first: float, last: float) -> BlockPiece:
        low, high = places(self.times, first, last)
        stretches = []
        for side, moments in zip(self.sides, self.moments, strict=True):
            begin, end = places(moments, first, last)
            own, step = side.times[begin:end], side.step[begin:end]
            stretches.append(
                Stamped(
                    side=side.side,
                    span=(own[0].item(), own[-1].item()) if len(own) else NO_SPAN,
                    own=own[step >= 0],
                    step=step[step >= 0] - low,
                )
            )
        return BlockPiece(low=low, high=high, stretches=(stretches[0], stretches[1]))


def places(times: Times, first: float, last: float) -> tuple[int, int]:
    """Where times from one to another are, both included."""
    begin = int(np.searchsorted(times, first, side="left"))
    return begin, int(np.searchsorted(times, last, side="right"))
