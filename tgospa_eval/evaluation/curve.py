"""The normalised curve: proven costs of the steps 1..k for each k (docs/theory/solvers.md).

The whole problem is that of all steps. A block is one of its components. A *prefix* is a block up
to some step. A *suffix* has the last steps of a prefix. The solution of the whole problem gives a
bracket of the cost of each prefix.

A bracket is *open* if it is wider than requested. For a prefix with an open bracket, only a suffix
is solved, as short as possible. Before the suffix, the assignment of the whole problem is kept. A
path in the suffix begins with the best value that a path can have before it. Many suffixes are
solved together as one problem, and the solver starts from the solution of the whole problem.
"""

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Limit, Progress, Status, Stopwatch
from tgospa_eval.problem.certificate import (
    ROUNDOFF,
    break_down,
    fair_prices,
    lower_bounds,
    prove,
)
from tgospa_eval.problem.paths import up
from tgospa_eval.problem.prefixes import (
    Cells,
    PrefixBounds,
    RowMoves,
    costs_so_far,
    forward,
    offsets,
    whole_prices,
)
from tgospa_eval.problem.problem import Problem, sum_by
from tgospa_eval.problem.solution import Brackets, Reduced, Solution, Windows
from tgospa_eval.problem.states import ONE, States, merge_runs, repair
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import SavedSolution, make_warm_start, save_solution

SIZE = 1 << 18
"""Largest number of near pairs that are solved together, if there are several suffixes."""

ENTERED = 1 - 1e-9
"""Share of the switch price that shows if a pair was entered from "none".

It was, if its value is below that of "none" by at least this share. Without rounding, the share
would be 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Listed:
    """Near pairs, rows or tracks of the problem, sorted by block and then by step.

    Parameters
    ----------
    which : (L,) int array
        Indices of the near pairs, rows or tracks.
    key : (L,) int array
        ``block * steps + step`` of each.
    steps : int
        Number of steps, T.
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
        """Return, for each stretch, the index of its first element, and the number of its elements.

        A stretch has the steps from `begin` to `end` of a block.
        """
        block = block * np.int64(self.steps)
        low = np.searchsorted(self.key, block + begin)
        return low, np.searchsorted(self.key, block + end, "right") - low


@dataclass(frozen=True, kw_only=True, eq=False)
class Before:
    """Assignment and best values at the step before each suffix.

    The arrays (H,) have an element for each listed pair of each suffix, sorted by suffix and pair.
    A pair is listed if it is near in the suffix or assigned at the step before.

    Parameters
    ----------
    ending : int array
        Index of the suffix.
    pair : int array
        Index of the pair.
    weight : int array
        Weight of the pair in the solution of the whole problem, in units of 1/ONE.
    value, none, other : float arrays
        Upper bounds of the values of paths up to the step before the suffix, in the row of the
        pair. At this step, the path is in the pair (`value`), in "none" (`none`), or in a pair that
        is not listed (`other`).
    """

    ending: Ints
    pair: Ints
    weight: Ints
    value: Floats
    none: Floats
    other: Floats

    @classmethod
    def nothing(cls) -> "Before":
        """Return empty arrays, for suffixes that begin at the first step of their block."""
        ints, floats = np.zeros(0, np.int64), np.zeros(0)
        return cls(ending=ints, pair=ints, weight=ints, value=floats, none=floats, other=floats)


@dataclass(frozen=True, kw_only=True, eq=False)
class SuffixProblem:
    """Several suffixes as one problem.

    Parameters
    ----------
    problem : Problem
        All suffixes, one after the other in time. If a suffix has elements in `before`, the step
        before the suffix is included. At this step, the gain of a pair is its value minus that of
        "none".
    origin : tuple of int arrays
        For each object, estimate and step of this problem, its index in the whole problem.
    block, begin, end : (E,) int arrays
        Block, and first and last step of each suffix in the whole problem.
    first : (E,) int array
        First step of each suffix in this problem, or the step before the suffix if this step is
        included.
    before : Before
        Assignment and best values at the step before each suffix.
    """

    problem: Problem
    origin: tuple[Ints, Ints, Ints]
    block: Ints
    begin: Ints
    end: Ints
    first: Ints
    before: Before

    @property
    def length(self) -> Ints:
        """Number of steps of each suffix, (E,)."""
        return self.end - self.begin + 1

    @property
    def ending(self) -> Ints:
        """Index of the suffix of each step of the problem, (T,)."""
        return np.repeat(np.arange(len(self.first)), np.diff(self.first, append=self.problem.steps))

    @property
    def own(self) -> Ints:
        """Steps of the problem without those before the suffixes."""
        at = np.ones(self.problem.steps, bool)
        at[self.first[self.before.ending]] = False
        return np.flatnonzero(at)


class Suffixes:
    """Suffixes of the whole problem, from which separate problems are made.

    `weights` (S,) is the assignment of the whole problem, in units of 1/ONE.
    """

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
        """Divide suffixes into groups, which are slices of the given arrays.

        A group has fewer than `SIZE` near pairs, or is a single suffix.
        """
        size = np.cumsum(self._entries.spans(block, begin, end)[1])
        bounds = [0]
        while bounds[-1] < len(block):
            done = size[bounds[-1] - 1] if bounds[-1] else 0
            bounds.append(max(int(np.searchsorted(size, done + SIZE)), bounds[-1] + 1))
        return [slice(a, b) for a, b in itertools.pairwise(bounds)]

    def pairs(self, block: Ints, begin: Ints, end: Ints) -> tuple[Ints, Ints]:
        """Return the listed pairs of all suffixes: indices of suffix and pair, sorted.

        A listed pair is near in the suffix or assigned at the step before it.
        """
        size = np.int64(len(self.states.pair_row))
        taken, ending = _ranges(*self._entries.spans(block, begin, end))
        near = self._pair_of[self._entries.which[taken]]
        block_of = self.states.pair_block[self._used]
        low = np.searchsorted(block_of, block)
        at, whose = _ranges(low, np.searchsorted(block_of, block, "right") - low)
        used = self._used[at]
        some = self.assigned(used, (begin - 1)[whose]) > 0
        both = np.concatenate((ending * size + near, whose[some] * size + used[some]))
        suffix, pair = np.divmod(np.unique(both), size)
        return suffix, pair

    def assigned(self, pair: Ints, step: Ints) -> Ints:
        """Return the weight of each pair at a step of its block, in the whole solution."""
        key = pair * np.int64(self.states.problem.steps) + step
        weights: Ints = self.weights[np.searchsorted(self._key, key, "right") - 1]
        return weights

    def make_problem(self, block: Ints, begin: Ints, end: Ints, before: Before) -> SuffixProblem:
        """Return the suffixes as one problem."""
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
            switch_price=switch
            if isinstance(switch, float)
            else switch[np.maximum(step[1:] - 1, 0)],
            signed=True,
            **columns,
        )
        return SuffixProblem(
            problem=problem,
            origin=(tracks[0], tracks[1], step),
            block=block,
            begin=begin,
            end=end,
            first=first,
            before=before,
        )

    def _worth(self, begin: Ints, before: Before) -> Floats:
        """Return how much better each listed pair is than "none" at the step before a suffix.

        The result can be negative. If a pair was entered from "none", it is just as good to enter
        it later. The result of such a pair is made smaller, because the solver would need time for
        the tie.
        """
        price = self.states.problem.switch_price_at[begin][before.ending]
        worth: Floats = before.value - np.maximum(before.none, before.other - price)
        return np.where(worth <= -ENTERED * price, -2.0 * price, worth)


class _Mixed:
    """Order of two lists after they are merged by suffix.

    For each suffix, the elements of the second list come before those of the first list.

    Parameters
    ----------
    ending, other : int arrays
        Index of the suffix of each element, in the first list and in the second list, sorted.
    suffixes : int
        Number of suffixes.

    Attributes
    ----------
    first, second : int arrays
        Indices of the elements of each list in the merged list.
    """

    def __init__(self, ending: Ints, other: Ints, suffixes: int) -> None:
        of_first = np.bincount(ending, minlength=suffixes)
        of_second = np.bincount(other, minlength=suffixes)
        self.first = np.arange(len(ending)) + np.cumsum(of_second)[ending]
        self.second = np.arange(len(other)) + (np.cumsum(of_first) - of_first)[other]

    def join(self, first: Ints | Floats, second: Ints | Floats) -> NDArray[Any]:
        """Join values of both lists."""
        joined = np.empty(len(first) + len(second), np.result_type(first, second))
        joined[self.first], joined[self.second] = first, second
        return joined


def _ranges(low: Ints, count: Ints) -> tuple[Ints, Ints]:
    """Return all integers of the ranges, range by range, and the index of the range of each.

    A range has `count` integers, from `low` on.
    """
    return concatenated(low, count), np.repeat(np.arange(len(low)), count)


# -------------------------------------------------------------------------------------------------
# Bounds of prefixes from solutions of their suffixes (docs/theory/solvers.md, "The curve").


class SeparateStretches:
    """Stretches of blocks that are solved together, each with the steps from `begin` to `end`.

    The stretches are independent of each other, and of the steps before them.

    Parameters
    ----------
    suffixes : Suffixes
        Suffixes of the whole problem.
    saved : SavedSolution
        Solution of the whole problem.
    block, begin, end : (N,) int arrays
        Block, and first and last step of each stretch.
    """

    def __init__(
        self, suffixes: Suffixes, saved: SavedSolution, block: Ints, begin: Ints, end: Ints
    ) -> None:
        self.joint = suffixes.make_problem(block, begin, end, Before.nothing())
        self.states = merge_runs(self.joint.problem)
        self.warm_start = make_warm_start(self.states, (saved,), (1.0,), self.joint.origin)

    def of_whole(self) -> tuple[Floats, Floats, Floats]:
        """Return results in the form of `solve`, from the solution of the whole problem."""
        (weights,) = self.warm_start.weights
        return self._proven(
            Solution(weights=weights, prices=self.warm_start.prices, status=Status.SOLVED)
        )

    def solve(self, solver: Certified, stopwatch: Stopwatch) -> tuple[Floats, Floats, Floats]:
        """Solve the stretches, and prove each result.

        Returns
        -------
        parts : (4, N) float array
            Localisation, missed, false and switch cost of each stretch.
        lower : (N,) float array
            Lower bound of the optimal cost.
        error : (N,) float array
            Bound of the rounding error by which the sum of the parts may be too small.
        """
        return self._proven(solver(self.states, stopwatch, replace(self.warm_start, near=True)))

    def _proven(self, solution: Solution) -> tuple[Floats, Floats, Floats]:
        joint, states = self.joint, self.states
        _, lower, split = prove(states, solution, consume=solution.disposable)
        parts = np.array(
            [
                np.add.reduceat(kind, joint.first)
                for kind in (split.localisation, split.missed, split.false, split.switch)
            ]
        )
        ending = np.searchsorted(joint.first, states.block_begin, side="right") - 1
        bound = sum_by(ending, lower, len(joint.first))
        bound *= 1 - len(states.block_begin) * ROUNDOFF
        return parts, bound, _rounding(states, parts, joint.length)


class SuffixSolver:
    """Solver of suffixes; before a suffix, the assignment of the whole problem is kept.

    Calls of `solve` must be in the order of the first steps of the suffixes.

    Parameters
    ----------
    suffixes : Suffixes
        Suffixes of the whole problem.
    prefixes : PrefixBounds
        Bounds of all prefixes, which the solution of the whole problem proves.
    saved : SavedSolution
        Solution of the whole problem.
    """

    def __init__(self, suffixes: Suffixes, prefixes: PrefixBounds, saved: SavedSolution) -> None:
        self.suffixes, self.prefixes, self.saved = suffixes, prefixes, saved
        moves = prefixes.moves
        self._none, self._reached = np.zeros(len(moves.rows)), np.zeros(len(moves.row))
        self._best, self._done = np.zeros(len(moves.rows)), 0
        self._pass = forward(moves, self._none, self._reached)

    def solve(
        self, block: Ints, begin: Ints, end: Ints, solver: Certified, stopwatch: Stopwatch
    ) -> tuple[Ints, Floats, Floats, Floats]:
        """Solve suffixes that begin after the first step of their block.

        A cell stands for a prefix: it is a block and the last step of the prefix. Each step of a
        suffix is the last step of one prefix.

        Returns
        -------
        cell : int array
            Cells of these prefixes. A cell can occur several times.
        parts, lower, error : float arrays
            Bounds of the prefixes, in the form of `SeparateStretches.solve`.
        """
        before, rest = self._before(block, begin, end)
        joint = self.suffixes.make_problem(block, begin, end, before)
        states = merge_runs(joint.problem, transpose=False)
        warm_start = make_warm_start(states, (self.saved,), (1.0,), joint.origin)
        # The values in `before` include the prices up to the step before the suffix, so the prices
        # at this step are 0 here.
        until_then = np.zeros(joint.problem.steps, bool)
        until_then[joint.first] = True
        prices = np.where(until_then[states.columns.step], 0.0, warm_start.prices)
        solution = solver(states, stopwatch, replace(warm_start, prices=prices, near=True))
        listed = self._listed(joint, states)
        parts, error = self._costs(joint, states, listed, repair(states, solution.weights))
        lower = self._lower(joint, states, listed, fair_prices(solution.prices), rest)
        return concatenated(self.prefixes.cells.of(block, begin), joint.length), parts, lower, error

    def _before(self, block: Ints, begin: Ints, end: Ints) -> tuple[Before, Floats]:
        """Return assignment and values before suffixes, and sums over rows without a listed pair.

        The sums (2, E) are those of the best values of these rows, and of their absolute values.
        """
        moves = self.prefixes.moves
        row_block = self.suffixes.states.node_block[moves.rows]
        ending, pair = self.suffixes.pairs(block, begin, end)
        value, none, other = np.zeros((3, len(pair)))
        rest = np.zeros((2, len(block)))
        edges = np.searchsorted(ending, np.arange(len(block) + 1))
        pair_first = np.append(moves.first, len(moves.row))
        for number, step in enumerate(begin.tolist()):
            while self._done < step:
                self._best = next(self._pass)
                self._done += 1
            own = slice(edges[number], edges[number + 1])
            low, high = np.searchsorted(row_block, (block[number], block[number] + 1))
            values = self._reached[pair_first[low] : pair_first[high]].copy()
            row, at = moves.row[pair[own]], pair[own] - pair_first[low]
            value[own], none[own] = values[at], self._none[row]
            values[at] = -np.inf
            left = np.maximum.reduceat(values, moves.first[low:high] - pair_first[low])
            other[own] = left[row - low]
            unlisted = self._best[low:high].copy()
            unlisted[row - low] = 0.0
            rest[:, number] = unlisted.sum(), np.abs(unlisted).sum()
        weight = self.suffixes.assigned(pair, (begin - 1)[ending])
        before = Before(
            ending=ending, pair=pair, weight=weight, value=value, none=none, other=other
        )
        return before, rest

    def _listed(self, joint: SuffixProblem, states: States) -> Ints:
        """Return the index in `Before` of each pair of the joint problem."""
        whole, before = self.suffixes.states, joint.before
        truths, estimates = np.int64(whole.problem.truths), np.int64(whole.problem.estimates)
        known = before.ending * truths + whole.pair_truth[before.pair]
        known = known * estimates + whole.pair_estimate[before.pair]
        sought = joint.ending[states.begin[states.pair_first[:-1]]] * truths
        sought = (sought + joint.origin[0][states.pair_truth]) * estimates
        sought = sought + joint.origin[1][states.pair_estimate]
        order = np.argsort(known)
        place: Ints = order[np.searchsorted(known, sought, sorter=order)]
        return place

    def _costs(
        self, joint: SuffixProblem, states: States, listed: Ints, weights: Ints
    ) -> tuple[Floats, Floats]:
        """Return the four kinds of cost of each prefix, and a bound of their error.

        There is a prefix for each step of each suffix.
        """
        split = break_down(states, weights)
        # Switches at the first step of a suffix are changes from the assignment of the whole
        # problem at the step before.
        before = joint.before.weight[listed]
        state, last = states.pair_first[:-1] + 1, states.pair_first[1:] - 1
        # A pair with only the step before the suffix keeps its weight.
        after = np.where(state > last, before, weights[np.minimum(state, last)])
        step = states.begin[states.pair_first[:-1]] + 1
        amount = np.abs(after - before) / ONE * states.problem.switch_price_at[step]
        switch = split.switch.copy()
        switch[joint.first + 1] = sum_by(step, amount, len(switch))[joint.first + 1]
        kinds = np.array([split.localisation, split.missed, split.false, switch])[:, joint.own]
        ending = joint.ending[joint.own]
        at = self.prefixes.cells.of(joint.block, joint.begin - 1)
        parts = self.prefixes.parts[:, at][:, ending] + _running(kinds, joint.length)
        error = self.prefixes.error[at][ending] + _rounding(states, parts, joint.length[ending])
        return parts, error

    def _lower(
        self, joint: SuffixProblem, states: States, listed: Ints, prices: Floats, rest: Floats
    ) -> Floats:
        """Return the lower bound of each prefix, one for each step of each suffix."""
        prefixes, slots, before = self.prefixes, states.columns, joint.before
        moves = RowMoves.of(states, offsets(states), prices, since=joint.first[joint.ending] + 1)
        of_row = joint.ending[states.block_begin[states.node_block[moves.rows]]]
        reached = before.value[listed]
        opens = states.pair_first[:-1]  # states at the step before a suffix
        pays = np.flatnonzero(slots.end[opens] > slots.begin[opens])
        reached[pays] = up(reached[pays] - prices[slots.begin[opens[pays]]])
        some = listed[moves.first]
        other = before.other[some]
        price = self.suffixes.states.problem.switch_price_at[joint.begin][of_row]
        none = np.maximum(before.none[some], up(other - price))
        begins = np.cumsum(joint.length) - joint.length
        values = np.zeros((2, int(joint.length.sum())))
        for time, best in enumerate(forward(moves, none, reached, other)):
            live = np.flatnonzero(joint.length > time)
            for kind, value in enumerate((best, np.abs(best))):
                total = np.bincount(of_row, value, minlength=len(joint.first)) + rest[kind]
                values[kind, begins[live] + time] = total[live]
        paid = sum_by(slots.step, prices, joint.problem.steps)
        paid[joint.first + 1] += paid[joint.first]
        ending = joint.ending[joint.own]
        earlier = prefixes.paid[self.prefixes.cells.of(joint.block, joint.begin - 1)][ending]
        cells = concatenated(self.prefixes.cells.of(joint.block, joint.begin), joint.length)
        paid = earlier + _running(paid[joint.own][None], joint.length)[0]
        return prefixes.lower(cells, values[0], values[1], paid)


def _running(value: Floats, length: Ints) -> Floats:
    """Return running sums along each row of `value`; they restart in each part.

    `length` has the lengths of the parts.
    """
    total = np.empty_like(value)
    for low, high in itertools.pairwise(np.concatenate(([0], np.cumsum(length))).tolist()):
        np.cumsum(value[:, low:high], axis=1, out=total[:, low:high])
    return total


def _rounding(states: States, parts: Floats, length: Ints) -> Floats:
    """Return a bound of the rounding error of the costs `parts` of stretches."""
    terms = int(np.bincount(states.begin, minlength=1).max())
    error: Floats = parts.sum(axis=0) * (length + 2 * terms + 16) * ROUNDOFF
    return error


def unpaired_by_step(states: States) -> Floats:
    """Return the cost of states of truth and estimate without a near pair, by step, (2, T)."""
    problem = states.problem
    total = np.zeros((2, problem.steps))
    for own, side in zip(total, problem.sides, strict=True):
        price = side.price.copy()
        price[side.row] = 0.0
        own[:] = sum_by(side.step, price, problem.steps)
    return total


def whole_blocks(states: States, prices: Floats, reduced: tuple[Reduced, ...]) -> Floats:
    """Return the lower bound of each block, (B,); states without a near pair are left out."""
    problem, blocks = states.problem, len(states.block_begin)
    lower = lower_bounds(states, prices, reduced)
    unpaired = np.zeros(blocks)
    for side, blocks_of in zip(problem.sides, states.track_blocks, strict=True):
        block = blocks_of[side.track]
        price = side.price.copy()
        price[side.row] = 0.0
        unpaired += sum_by(block[block >= 0], price[block >= 0], blocks)
    exact = whole_prices(problem)
    error = (lower + unpaired) * (2 if exact else 2 + len(problem.truth_price)) * ROUNDOFF
    return lower - unpaired - error


SPAN = 8
"""Number of steps of the first suffixes.

8 was the fastest of 8, 12, 16, 24 and 32, for 20 objects and for 100 objects."""


def trace(
    states: States,
    weights: Ints,
    prices: Floats,
    solver: Certified,
    reduced: tuple[Reduced, ...] = (),
    progress: Progress | None = None,
) -> Brackets:
    """Return the curve of a solved problem: a bracket of the cost of the steps 1 to k, for each k.

    The last bracket is that of the whole problem.

    Parameters
    ----------
    states : States
        The whole problem.
    weights : (S,) int array
        A feasible assignment, in units of 1/ONE.
    prices : (K,) float array
        Prices of the column slots, 0 or more.
    solver : Certified
        Solver of the suffixes. Its gap is that of the curve, and its time limit is for all suffixes
        together.
    reduced : tuple of Reduced
        Bounds of the whole problem at smaller cutoffs.
    progress : Progress, optional
        Receiver of the share that is done. It can stop the work; then some brackets stay open.
    """
    progress = progress or Progress()
    prices = fair_prices(prices)
    prefixes = PrefixBounds.of(states, weights, prices)
    cells, parts = prefixes.cells, prefixes.parts.copy()
    lower_bounds, error = prefixes.whole_lower(states), prefixes.error.copy()
    unpaired_costs = np.cumsum(unpaired_by_step(states), axis=1)
    ends = cells.first[1:] - 1
    lower_bounds[ends] = np.maximum(lower_bounds[ends], whole_blocks(states, prices, reduced))

    bracket = _Brackets(cells=cells, parts=parts, lower=lower_bounds, error=error, gap=solver.gap)
    bracket.open[ends] = False  # the solver has already solved whole blocks
    if bracket.open.any():
        suffixes, saved = Suffixes(states, weights), save_solution(states, weights, prices)
        from_begin = states.transposed.copy()
        for part in reduced:
            from_begin |= part.blocks
        _narrow(bracket, suffixes, prefixes, saved, from_begin, solver, progress)

    problem = states.problem
    shown = np.array([cells.totals(part, problem.steps)[0] for part in parts])
    shown[1:3] += unpaired_costs
    # The cost of states without a near pair is a sum of at most this many prices.
    rows = len(problem.truth_step) + len(problem.estimate_step)
    unsure = (
        0.0
        if unpaired_costs.max(initial=0.0) < 2.0**31 and whole_prices(problem)
        else rows * ROUNDOFF
    )
    few = 8 * ROUNDOFF
    upper, off = cells.totals(parts.sum(axis=0) + error, problem.steps)
    upper = (
        (upper + off + unpaired_costs.sum(axis=0)) * (1 + few + unsure) / (1 - problem.cost_error)
    )
    lower, off = cells.totals(lower_bounds, problem.steps)
    lower = (lower - off + unpaired_costs.sum(axis=0)) * (1 - few - unsure) - problem.cost_slack
    lower *= 1 - few - problem.cost_error
    share = np.cumsum(sum_by(problem.truth_step, problem.truth_price, problem.steps))
    share += np.cumsum(sum_by(problem.estimate_step, problem.estimate_price, problem.steps))
    return Brackets(
        lower=np.clip(lower, 0.0, upper),
        upper=upper,
        parts=shown,
        rounding=problem.rounding * share / max(float(share[-1:].sum()), 1e-300),
    )


class _Brackets:
    """Bracket of each cell: its four kinds of cost, their error, and a lower bound.

    `open` is a mask of the cells whose bracket must still become narrower.
    """

    def __init__(
        self, *, cells: Cells, parts: Floats, lower: Floats, error: Floats, gap: float
    ) -> None:
        self.cells, self.parts, self.lower, self.error, self.gap = cells, parts, lower, error, gap
        self.cost = parts.sum(axis=0)
        self.open = self.wide

    @property
    def wide(self) -> Mask:
        """Mask of the cells whose bracket is wider than the gap allows."""
        wide: Mask = self.cost + self.error - self.lower > self.gap * self.cost
        return wide

    def take(self, cell: Ints, parts: Floats, lower: Floats, error: Floats) -> None:
        """Keep new bounds where they are better; `cell` can have a cell several times."""
        np.maximum.at(self.lower, cell, lower)
        cost = parts.sum(axis=0)
        order = np.lexsort((cost, cell))
        order = order[np.flatnonzero(np.diff(cell[order], prepend=-1))]
        order = order[cost[order] < self.cost[cell[order]]]
        wins = cell[order]
        self.parts[:, wins], self.error[wins] = parts[:, order], error[order]
        self.cost[wins] = cost[order]


def _narrow(
    brackets: _Brackets,
    suffixes: Suffixes,
    prefixes: PrefixBounds,
    saved: SavedSolution,
    from_begin: Mask,
    solver: Certified,
    progress: Progress,
) -> None:
    """Solve suffixes of the prefixes with open brackets, until no bracket is open.

    The first suffixes have few steps, the next ones twice as many, and so on. In the blocks of the
    mask `from_begin` (B,), whole prefixes are solved at once.
    """
    limit = Limit.of(solver.time_limit, progress)
    cells, span, open_at_start = brackets.cells, SPAN, np.count_nonzero(brackets.open)
    while brackets.open.any():
        cell = np.flatnonzero(brackets.open)
        block, end = cells.block[cell], cells.step[cell]
        first = cells.begin[block]
        begin = np.maximum(end + 1 - span, first)
        begin = np.where((begin - first < span // 2) | from_begin[block], first, begin)
        suffix_solver = SuffixSolver(suffixes, prefixes, saved)
        for whole in (False, True):
            at = np.flatnonzero((begin == first) == whole)
            at = at[np.argsort(begin[at], kind="stable")]
            for group in suffixes.groups(block[at], begin[at], end[at]):
                if limit.late():
                    return
                progress.again("the curve", 1 - np.count_nonzero(brackets.open) / open_at_start)
                own = at[group]
                own = own[brackets.open[cell[own]]]  # other suffixes may have closed the bracket
                if not len(own):
                    continue
                timed = _for_the_rest(solver, limit)
                stretch = block[own], begin[own], end[own]
                if whole:
                    proven = SeparateStretches(suffixes, saved, *stretch).solve(*timed)
                    brackets.take(cell[own], *proven)
                else:
                    brackets.take(*suffix_solver.solve(*stretch, *timed))
                brackets.open &= brackets.wide
            if whole:
                brackets.open[cell[at]] = False
        span *= 2


def _for_the_rest(solver: Certified, limit: Limit) -> tuple[Certified, Stopwatch]:
    """Return the solver with the remaining time as limit, and a stopwatch without progress."""
    stopwatch, left = Stopwatch(), limit.left()
    stopwatch.progress = limit.progress.silent()
    return replace(solver, time_limit=None if left is None else max(left, 1e-9)), stopwatch


# -------------------------------------------------------------------------------------------------
# Sliding windows: proven costs of separate stretches of steps (docs/theory/solvers.md).
#
# A block with all its steps in a window has the same cost there as in the whole problem. The part
# of any other block in the window is a stretch, which is a separate problem. The assignment and the
# prices of the whole problem give a bracket of the cost of the stretch. If the bracket is too wide,
# the stretch is solved, together with many others. The solver starts from the assignment and the
# prices of the whole problem.


def slide(
    states: States,
    weights: Ints,
    prices: Floats,
    solver: Certified,
    spans: tuple[Ints, Ints],
    reduced: tuple[Reduced, ...] = (),
    progress: Progress | None = None,
) -> Windows:
    """Return a bracket of the cost of each window of a solved problem.

    Parameters
    ----------
    states : States
        The whole problem.
    weights : (S,) int array
        A feasible assignment, in units of 1/ONE.
    prices : (K,) float array
        Prices of the column slots, 0 or more.
    solver : Certified
        Solver of the stretches. Its gap is that of the windows, and its time limit is for all
        stretches together.
    spans : pair of (W,) int arrays
        First and last step of each window, in order of time.
    reduced : tuple of Reduced
        Bounds of the whole problem at smaller cutoffs.
    progress : Progress, optional
        Receiver of the share that is done. It can stop the work; then some stretches keep the
        bracket that the solution of the whole problem proves.
    """
    problem = states.problem
    first, last = spans
    prices = fair_prices(prices)
    stretches, of_windows = _of_windows(states, first, last)
    block, begin, end = stretches
    bounds = np.zeros((6, len(block)))  # four kinds of costs, a lower bound, an error
    whole = (begin == states.block_begin[block]) & (end == states.block_end[block])
    bounds[:, whole] = np.vstack(_of_blocks(states, weights, prices, reduced, block[whole]))
    rest = np.flatnonzero(~whole)
    if len(rest):
        suffixes, saved = Suffixes(states, weights), save_solution(states, weights, prices)
        limit = Limit.of(solver.time_limit, progress or Progress())
        done = 0
        for group in suffixes.groups(*stretches[:, rest]):
            limit.progress.again("the windows", done / len(rest))
            own = rest[group]
            separate = SeparateStretches(suffixes, saved, *stretches[:, own])
            bounds[:, own] = np.vstack(_solved(separate, solver, limit))
            done += len(own)
    return _added(problem, unpaired_by_step(states), bounds, of_windows, spans)


def _of_windows(states: States, first: Ints, last: Ints) -> tuple[Ints, tuple[Ints, Ints]]:
    """Return the distinct stretches of blocks in the windows.

    Returns
    -------
    stretches : (3, N) int array
        Block, and first and last step of each stretch.
    parts : pair of (M,) int arrays
        Indices of the window and of the stretch, for each stretch in each window.
    """
    opens, closes = states.block_begin.astype(np.int64), states.block_end.astype(np.int64)
    low = np.searchsorted(last, opens)
    count = np.maximum(np.searchsorted(first, closes, "right") - low, 0)
    block = np.repeat(np.arange(len(opens)), count)
    window = np.arange(len(block)) + np.repeat(low - np.cumsum(count) + count, count)
    begin = np.maximum(first[window], opens[block])
    end = np.minimum(last[window], closes[block])
    steps = np.int64(states.problem.steps)
    # Windows are in order of time, so equal stretches follow each other.
    fresh = np.diff(block, prepend=-1) != 0
    fresh[1:] |= np.diff(begin * steps + end) != 0
    return np.stack((block, begin, end))[:, fresh], (window, np.cumsum(fresh) - 1)


def _of_blocks(
    states: States, weights: Ints, prices: Floats, reduced: tuple[Reduced, ...], block: Ints
) -> tuple[Floats, Floats, Floats]:
    """Return the results of `SeparateStretches.solve` for the whole blocks `block`."""
    if not len(block):
        return np.zeros((4, 0)), np.zeros(0), np.zeros(0)
    cells = Cells.of_blocks(states)
    ends = cells.first[1:][block] - 1
    parts, error = costs_so_far(states, cells, weights)
    return parts[:, ends], whole_blocks(states, prices, reduced)[block], error[ends]


def _solved(
    stretches: SeparateStretches, solver: Certified, limit: Limit
) -> tuple[Floats, Floats, Floats]:
    """Return bounds in the form of `SeparateStretches.solve`; solve only if they are too wide."""
    known = stretches.of_whole()
    parts, lower, error = known
    cost = parts.sum(axis=0)
    if limit.late() or not (cost + error - lower > solver.gap * cost).any():
        return known
    solved = stretches.solve(*_for_the_rest(solver, limit))
    cheaper = solved[0].sum(axis=0) < cost
    return (
        np.where(cheaper, solved[0], parts),
        np.maximum(lower, solved[1]),
        np.where(cheaper, solved[2], error),
    )


def _added(
    problem: Problem,
    unpaired: Floats,
    bounds: Floats,
    of_windows: tuple[Ints, Ints],
    spans: tuple[Ints, Ints],
) -> Windows:
    """Sum, for each window, the costs of its stretches and of states without a near pair.

    `bounds` has the four kinds of cost, the lower bound and the error of each stretch.
    """
    (first, last), parts, lower_bounds, error = spans, bounds[:4], bounds[4], bounds[5]
    window, stretch = of_windows

    def total(value: Floats) -> Floats:
        return sum_by(window, value[stretch], len(first))

    def between(value: Floats) -> Floats:
        """Sum values >= 0 over the steps of each window; no digits are lost by subtraction."""
        if not len(first):
            return np.zeros(0)
        edges = np.stack((first, last + 1), axis=1).ravel()
        sums: Floats = np.add.reduceat(np.append(value, 0.0), edges)[::2]
        return sums

    of_unpaired = np.array([between(side) for side in unpaired])
    shown = np.array([total(part) for part in parts])
    shown[1:3] += of_unpaired
    counts = np.array(
        [
            between(np.bincount(step, minlength=problem.steps).astype(float))
            for step in (problem.truth_step, problem.estimate_step)
        ]
    )
    terms = 8 + np.bincount(window, minlength=len(first))
    if not (whole_prices(problem) and of_unpaired.max(initial=0.0) < 2.0**31):
        terms = terms + counts.sum(axis=0) + (last - first)
    few = terms * ROUNDOFF
    upper = (total(parts.sum(axis=0) + error) + of_unpaired.sum(axis=0)) * (1 + few)
    upper /= 1 - problem.cost_error
    lower = (total(lower_bounds) + of_unpaired.sum(axis=0)) * (1 - few)
    fewer_rows = min(len(problem.truth_step), len(problem.estimate_step))
    lower -= problem.cost_slack * counts.min(axis=0) * (1 + 8 * ROUNDOFF) / max(fewer_rows, 1)
    lower *= 1 - few - problem.cost_error
    price = sum(sum_by(side.step, side.price, problem.steps) for side in problem.sides)
    share = between(np.asarray(price)) / max(float(np.sum(price)), 1e-300)
    return Windows(
        first=first,
        last=last,
        lower=np.clip(lower, 0.0, upper),
        upper=upper,
        parts=shown,
        rounding=problem.rounding * share,
    )
