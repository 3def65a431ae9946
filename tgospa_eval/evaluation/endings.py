"""The last steps of beginnings of a solved problem, side by side as one problem.

A *beginning* is a component up to a step; an *ending* are its steps from some step on, before which
all stays as the whole has it: paths go on from the best values that they have by then.
"""

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.problem import Floats, Ints, Problem
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.warm_start import Origin

SIZE = 1 << 18
"""Near pairs of the endings that are solved together."""

ENTERED = 1 - 1e-9
"""A pair that is worth less than "none" by so much of the switch price was entered from there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Listed:
    """Entries or objects of the problem, those of a block together and in order of time.

    Parameters
    ----------
    which : (L,) int array
        The entries or rows.
    key : (L,) int array
        ``block * steps + step`` of each.
    steps : int
        T.
    """

    which: Ints
    key: Ints
    steps: int

    @classmethod
    def of(cls, which: Ints, block: Ints, step: Ints, steps: int) -> "_Listed":
        key = block.astype(np.int64) * steps + step
        order = np.argsort(key, kind="stable")
        return cls(which=which[order], key=key[order], steps=steps)

    def spans(self, block: Ints, begin: Ints, end: Ints) -> tuple[Ints, Ints]:
        """First from a step of each block on, and how many there are up to another."""
        block = block * np.int64(self.steps)
        low = np.searchsorted(self.key, block + begin)
        return low, np.searchsorted(self.key, block + end, "right") - low


@dataclass(frozen=True, kw_only=True, eq=False)
class Before:
    """What there is at the step before each ending; arrays are (H,), sorted by ending and pair.

    Parameters
    ----------
    ending, pair : int arrays
        The pairs that come near in each ending, or are assigned before it.
    weight : int array
        What the whole assigns, in units of 1/ONE.
    value, none, other : float arrays
        Best values, from above, of what the row of a pair has done until then, if it is in the
        pair, in "none", or in any pair that is not listed.
    """

    ending: Ints
    pair: Ints
    weight: Ints
    value: Floats
    none: Floats
    other: Floats

    @classmethod
    def nothing(cls) -> "Before":
        """Of endings that are whole beginnings."""
        ints, floats = np.zeros(0, np.int64), np.zeros(0)
        return cls(ending=ints, pair=ints, weight=ints, value=floats, none=floats, other=floats)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cut:
    """Endings as one problem.

    Parameters
    ----------
    problem : Problem
        The steps of one after those of the other. Where something is known of the step before an
        ending, that comes first: each listed pair gains there by how much its value exceeds "none".
    origin : Origin
        Where that comes from.
    block, begin, end : (E,) int arrays
        Block, and first and last step of each in the whole.
    first : (E,) int array
        Where the steps of each begin in the problem, the one before them included.
    before : Before
        What there is at that step.
    """

    problem: Problem
    origin: Origin
    block: Ints
    begin: Ints
    end: Ints
    first: Ints
    before: Before

    @property
    def length(self) -> Ints:
        """Number of steps of each, (E,)."""
        return self.end - self.begin + 1

    @property
    def ending(self) -> Ints:
        """Of each step of the problem, (T,)."""
        return np.repeat(np.arange(len(self.first)), np.diff(self.first, append=self.problem.steps))

    @property
    def own(self) -> Ints:
        """The steps of the problem that are not before an ending."""
        at = np.ones(self.problem.steps, bool)
        at[self.first[self.before.ending]] = False
        return np.flatnonzero(at)


class Endings:
    """Endings of beginnings of a problem that has the assignment `weights` (S,), in 1/ONE."""

    def __init__(self, states: States, weights: Ints) -> None:
        self.states, self.weights = states, weights
        problem, steps = states.problem, states.problem.steps
        gains = np.flatnonzero(states.entry >= 0)
        entry = states.entry[gains].astype(np.int64)
        pair = states.pair
        order = np.argsort(entry)
        entry, block = entry[order], states.pair_block[pair[gains[order]]]
        self._entries = _Listed.of(entry, block, problem.entry_step[entry], steps)
        self._pair_of = np.zeros(len(problem.cost), np.int64)
        self._pair_of[entry] = pair[gains[order]]
        self._used = np.unique(pair[weights > 0])
        self._key = pair * np.int64(steps) + states.begin
        self._sides: list[tuple[_Listed, Ints, _Listed, Ints]] = []
        for side, pair_track in zip(problem.sides, states.pair_tracks, strict=True):
            some, at = np.unique(side.row[entry].astype(np.int64), return_index=True)
            objects = _Listed.of(some, block[at], side.step[some], steps)
            place = np.zeros(len(side.step), np.int64)
            place[objects.which] = np.arange(len(some))
            track, at = np.unique(pair_track, return_index=True)
            order = np.argsort(states.pair_block[at], kind="stable")
            number = np.zeros(side.count, np.int64)
            number[track[order]] = np.arange(len(track))
            members = _Listed(which=track[order], key=states.pair_block[at][order], steps=1)
            self._sides.append((objects, place, members, number))

    def groups(self, block: Ints, begin: Ints, end: Ints) -> list[slice]:
        """Neighbours of which each but the last have SIZE entries, or are a single one."""
        size = np.cumsum(self._entries.spans(block, begin, end)[1])
        bounds = [0]
        while bounds[-1] < len(block):
            done = size[bounds[-1] - 1] if bounds[-1] else 0
            bounds.append(max(int(np.searchsorted(size, done + SIZE)), bounds[-1] + 1))
        return [slice(a, b) for a, b in itertools.pairwise(bounds)]

    def pairs(self, block: Ints, begin: Ints, end: Ints) -> tuple[Ints, Ints]:
        """Ending and pair, in order, of the pairs that come near, or are assigned before."""
        size = np.int64(len(self.states.pair_row))
        taken, ending = _ranges(*self._entries.spans(block, begin, end))
        near = self._pair_of[self._entries.which[taken]]
        block_of = self.states.pair_block[self._used]
        low = np.searchsorted(block_of, block)
        at, whose = _ranges(low, np.searchsorted(block_of, block, "right") - low)
        held = self._used[at]
        some = self.assigned(held, (begin - 1)[whose]) > 0
        both = np.concatenate((ending * size + near, whose[some] * size + held[some]))
        found, pair = np.divmod(np.unique(both), size)
        return found, pair

    def assigned(self, pair: Ints, step: Ints) -> Ints:
        """What the whole assigns of pairs at steps inside of their blocks."""
        key = pair * np.int64(self.states.problem.steps) + step
        weights: Ints = self.weights[np.searchsorted(self._key, key, "right") - 1]
        return weights

    def cut(self, block: Ints, begin: Ints, end: Ints, before: Before) -> Cut:
        """The endings as one problem."""
        whole = self.states.problem
        head = np.zeros(len(block), np.int64)
        head[before.ending] = 1
        length = end - begin + 1 + head
        first = np.cumsum(length) - length
        step = concatenated(begin - head, length)
        taken, ending = _ranges(*self._entries.spans(block, begin, end))
        entry = self._entries.which[taken]
        mixed = _Mixed(ending, before.ending, len(block))
        price = max(side.price.max(initial=0.0) for side in whole.sides)
        columns: dict[str, Any] = {}
        tracks = []
        for name, side, pair_track, (objects, place, members, number) in zip(
            ("truth", "estimate"),
            whole.sides,
            self.states.pair_tracks,
            self._sides,
            strict=True,
        ):
            low, count = members.spans(block, 0 * block, 0 * block)
            member, _ = _ranges(low, count)
            tracks.append(members.which[member])
            fresh = np.cumsum(count) - count - low
            low, count = objects.spans(block, begin, end)
            at, of = _ranges(low, count)
            row = objects.which[at]
            head_key, at_head = np.unique(
                before.ending * np.int64(side.count) + pair_track[before.pair], return_inverse=True
            )
            of_head, head_track = np.divmod(head_key, max(side.count, 1))
            both = _Mixed(of, of_head, len(block))
            track = number[side.track[row]] + fresh[of]
            own_step = side.step[row] + (first + head - begin)[of]
            shift = np.cumsum(count) - count - low
            own_row = both.first[place[side.row[entry]] + shift[ending]]
            columns[f"{name}_track"] = both.join(track, number[head_track] + fresh[of_head])
            columns[f"{name}_step"] = both.join(own_step, first[of_head])
            columns[f"{name}_price"] = both.join(side.price[row], np.full(len(of_head), price))
            columns[f"{name}_row"] = mixed.join(own_row, both.second[at_head]).astype(np.int32)
        switch = whole.switch_price
        problem = Problem(
            steps=len(step),
            truths=len(tracks[0]),
            estimates=len(tracks[1]),
            cost=mixed.join(whole.cost[entry], 2 * price - self._worth(begin, before)),
            switch_price=switch if isinstance(switch, float) else switch[_from(step)],
            signed=True,
            **columns,
        )
        origin = Origin(
            truth=tracks[0],
            estimate=tracks[1],
            step=step,
            estimates=whole.estimates,
            steps=whole.steps,
        )
        return Cut(
            problem=problem,
            origin=origin,
            block=block,
            begin=begin,
            end=end,
            first=first,
            before=before,
        )

    def _worth(self, begin: Ints, before: Before) -> Floats:
        """By how much the values of the listed pairs exceed that of "none", which may be negative.

        Pairs that were entered from "none" are better entered later, so they are worth still less:
        what ties only makes work.
        """
        price = self.states.problem.switch_price_at[begin][before.ending]
        worth: Floats = before.value - np.maximum(before.none, before.other - price)
        return np.where(worth <= -ENTERED * price, -2.0 * price, worth)


class _Mixed:
    """Two lists as one, in which those of each ending follow each other, of the second first.

    Parameters
    ----------
    ending, other : int arrays
        Ending of each of the first and of the second, in order.
    endings : int
        How many there are.

    Attributes
    ----------
    first, second : int arrays
        Places in the one list.
    """

    def __init__(self, ending: Ints, other: Ints, endings: int) -> None:
        of_first = np.bincount(ending, minlength=endings)
        of_second = np.bincount(other, minlength=endings)
        self.first = np.arange(len(ending)) + np.cumsum(of_second)[ending]
        self.second = np.arange(len(other)) + (np.cumsum(of_first) - of_first)[other]

    def join(self, first: Ints | Floats, second: Ints | Floats) -> NDArray[Any]:
        """Values of both."""
        joined = np.empty(len(first) + len(second), np.result_type(first, second))
        joined[self.first], joined[self.second] = first, second
        return joined


def _from(step: Ints) -> Ints:
    """The transition of the whole that leads to each step but the first."""
    return np.maximum(step[1:] - 1, 0)


def _ranges(low: Ints, count: Ints) -> tuple[Ints, Ints]:
    """The numbers of each range, one range after the other, and whose each is."""
    return concatenated(low, count), np.repeat(np.arange(len(low)), count)
