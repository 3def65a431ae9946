"""What is proven of beginnings by solving their endings (docs/theory/solvers.md, "The curve")."""

import itertools
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.solver_status import Status
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.evaluation.endings import Before, Cut, Endings
from tgospa_eval.problem.certificate import (
    ROUNDOFF,
    break_down,
    fair_prices,
    lower_bounds,
    prove,
)
from tgospa_eval.problem.forward import Moves, forward, offsets
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.paths import up
from tgospa_eval.problem.prefixes import PrefixBounds, whole_prices
from tgospa_eval.problem.problem import Floats, Ints, sum_by
from tgospa_eval.problem.solution import Reduced, Solution
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE, repair
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import SavedSolution, make_warm_start


@dataclass(frozen=True, kw_only=True, eq=False)
class Proven:
    """What is proven of some beginnings; arrays over them are (N,).

    Parameters
    ----------
    cell : (N,) int array
        Which, perhaps several times.
    parts : (4, N) float array
        Cost by kind.
    lower : (N,) float array
        Lower bound of the least possible cost.
    error : (N,) float array
        How much the parts together may be too small by rounding.
    """

    cell: Ints
    parts: Floats
    lower: Floats
    error: Floats


class Alone:
    """Stretches of steps of blocks, each a problem of its own; many side by side.

    Parameters
    ----------
    endings : Endings
        Of the whole.
    saved : SavedSolution
        Its solution.
    block, begin, end : (N,) int arrays
        Block, and first and last step of each.
    """

    def __init__(
        self, endings: Endings, saved: SavedSolution, block: Ints, begin: Ints, end: Ints
    ) -> None:
        self.cut = endings.cut(block, begin, end, Before.nothing())
        self.states = merge_runs(self.cut.problem)
        self.warm_start = make_warm_start(self.states, (saved,), (1.0,), self.cut.origin)

    def held(self) -> tuple[Floats, Floats, Floats]:
        """What the solution of the whole proves, as `solve` returns it."""
        (weights,) = self.warm_start.weights
        return self._proven(
            Solution(weights=weights, prices=self.warm_start.prices, status=Status.SOLVED)
        )

    def solve(self, solver: Certified, stopwatch: Stopwatch) -> tuple[Floats, Floats, Floats]:
        """Solve them, and prove each as any result is.

        Returns
        -------
        parts : (4, N) float array
            Cost by kind.
        lower, error : (N,) float arrays
            As of `Proven`.
        """
        return self._proven(solver(self.states, stopwatch, replace(self.warm_start, near=True)))

    def _proven(self, solution: Solution) -> tuple[Floats, Floats, Floats]:
        cut, states = self.cut, self.states
        _, lower, split = prove(states, solution, consume=solution.disposable)
        parts = np.array(
            [
                np.add.reduceat(kind, cut.first)
                for kind in (split.localisation, split.missed, split.false, split.switch)
            ]
        )
        ending = np.searchsorted(cut.first, states.block_begin, side="right") - 1
        bound = sum_by(ending, lower, len(cut.first))
        bound *= 1 - len(states.block_begin) * ROUNDOFF
        return parts, bound, _rounding(states, parts, cut.length)


class Whole:
    """Beginnings that are solved from their first step on.

    Parameters
    ----------
    endings : Endings
        Of the whole.
    found : PrefixBounds
        What its solution proves of all beginnings.
    saved : SavedSolution
        That solution.
    """

    def __init__(self, endings: Endings, found: PrefixBounds, saved: SavedSolution) -> None:
        self.endings, self.found, self.saved = endings, found, saved

    def solve(
        self, block: Ints, begin: Ints, end: Ints, solver: Certified, stopwatch: Stopwatch
    ) -> Proven:
        """Solve them, and prove each as any result is."""
        alone = Alone(self.endings, self.saved, block, begin, end)
        parts, lower, error = alone.solve(solver, stopwatch)
        cell = self.found.cells.of(block, end)
        return Proven(cell=cell, parts=parts, lower=lower, error=error)


class Continued:
    """Beginnings that are as the whole has them before some step, and are solved from there on.

    They are to be asked for in the order of these steps.
    """

    def __init__(self, endings: Endings, found: PrefixBounds, saved: SavedSolution) -> None:
        self.endings, self.found, self.saved = endings, found, saved
        moves = found.prices.moves
        self._none, self._reached = np.zeros(len(moves.rows)), np.zeros(len(moves.row))
        self._best, self._done = np.zeros(len(moves.rows)), 0
        self._pass = forward(moves, self._none, self._reached)

    def solve(
        self, block: Ints, begin: Ints, end: Ints, solver: Certified, stopwatch: Stopwatch
    ) -> Proven:
        """Solve endings, none of which begins with its block; of all steps in them."""
        before, rest = self._before(block, begin, end)
        cut = self.endings.cut(block, begin, end, before)
        states = merge_runs(cut.problem, transpose=False)
        warm_start = make_warm_start(states, (self.saved,), (1.0,), cut.origin)
        # What is paid until then is in the values already.
        until_then = np.zeros(cut.problem.steps, bool)
        until_then[cut.first] = True
        prices = np.where(until_then[states.columns.step], 0.0, warm_start.prices)
        solution = solver(states, stopwatch, replace(warm_start, prices=prices, near=True))
        listed = self._listed(cut, states)
        parts, error = self._costs(cut, states, listed, repair(states, solution.weights))
        return Proven(
            cell=concatenated(self.found.cells.of(block, begin), cut.length),
            parts=parts,
            lower=self._lower(cut, states, listed, fair_prices(solution.prices), rest),
            error=error,
        )

    def _before(self, block: Ints, begin: Ints, end: Ints) -> tuple[Before, Floats]:
        """What there is before endings; of rows without a listed pair sums of values and sizes."""
        moves = self.found.prices.moves
        row_block = self.endings.states.node_block[moves.rows]
        ending, pair = self.endings.pairs(block, begin, end)
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
        weight = self.endings.assigned(pair, (begin - 1)[ending])
        before = Before(
            ending=ending, pair=pair, weight=weight, value=value, none=none, other=other
        )
        return before, rest

    def _listed(self, cut: Cut, states: States) -> Ints:
        """The place in `Before` of each pair."""
        whole, before = self.endings.states, cut.before
        truths, estimates = np.int64(whole.problem.truths), np.int64(whole.problem.estimates)
        known = before.ending * truths + whole.pair_truth[before.pair]
        known = known * estimates + whole.pair_estimate[before.pair]
        sought = cut.ending[states.begin[states.pair_first[:-1]]] * truths
        sought = (sought + cut.origin.truth[states.pair_truth]) * estimates
        sought = sought + cut.origin.estimate[states.pair_estimate]
        order = np.argsort(known)
        found: Ints = order[np.searchsorted(known, sought, sorter=order)]
        return found

    def _costs(
        self, cut: Cut, states: States, listed: Ints, weights: Ints
    ) -> tuple[Floats, Floats]:
        """Cost by kind, and its error, up to each step of each ending."""
        split = break_down(states, weights)
        # Into the first step switches are from what the whole assigns before.
        before = cut.before.weight[listed]
        state, last = states.pair_first[:-1] + 1, states.pair_first[1:] - 1
        # Nothing happens any more to blocks of a single step.
        after = np.where(state > last, before, weights[np.minimum(state, last)])
        step = states.begin[states.pair_first[:-1]] + 1
        amount = np.abs(after - before) / ONE * states.problem.switch_price_at[step]
        switch = split.switch.copy()
        switch[cut.first + 1] = sum_by(step, amount, len(switch))[cut.first + 1]
        kinds = np.array([split.localisation, split.missed, split.false, switch])[:, cut.own]
        ending = cut.ending[cut.own]
        at = self.found.cells.of(cut.block, cut.begin - 1)
        parts = self.found.parts[:, at][:, ending] + _running(kinds, cut.length)
        error = self.found.error[at][ending] + _rounding(states, parts, cut.length[ending])
        return parts, error

    def _lower(
        self, cut: Cut, states: States, listed: Ints, prices: Floats, rest: Floats
    ) -> Floats:
        """Lower bound up to each step of each ending."""
        found, slots, before = self.found.prices, states.columns, cut.before
        moves = Moves.of(states, offsets(states), prices, since=cut.first[cut.ending] + 1)
        of_row = cut.ending[states.block_begin[states.node_block[moves.rows]]]
        reached = before.value[listed]
        opens = states.pair_first[:-1]  # what is paid at the step before
        pays = np.flatnonzero(slots.end[opens] > slots.begin[opens])
        reached[pays] = up(reached[pays] - prices[slots.begin[opens[pays]]])
        some = listed[moves.first]
        other = before.other[some]
        price = self.endings.states.problem.switch_price_at[cut.begin][of_row]
        none = np.maximum(before.none[some], up(other - price))
        begins = np.cumsum(cut.length) - cut.length
        values = np.zeros((2, int(cut.length.sum())))
        for time, best in enumerate(forward(moves, none, reached, other)):
            live = np.flatnonzero(cut.length > time)
            for kind, value in enumerate((best, np.abs(best))):
                total = np.bincount(of_row, value, minlength=len(cut.first)) + rest[kind]
                values[kind, begins[live] + time] = total[live]
        paid = sum_by(slots.step, prices, cut.problem.steps)
        paid[cut.first + 1] += paid[cut.first]
        ending = cut.ending[cut.own]
        earlier = found.paid[self.found.cells.of(cut.block, cut.begin - 1)][ending]
        cells = concatenated(self.found.cells.of(cut.block, cut.begin), cut.length)
        paid = earlier + _running(paid[cut.own][None], cut.length)[0]
        return found.bounds(cells, values[0], values[1], paid)


def _running(value: Floats, length: Ints) -> Floats:
    """Running sums, in each row, of parts of so many values."""
    total = np.empty_like(value)
    for low, high in itertools.pairwise(np.concatenate(([0], np.cumsum(length))).tolist()):
        np.cumsum(value[:, low:high], axis=1, out=total[:, low:high])
    return total


def _rounding(states: States, parts: Floats, length: Ints) -> Floats:
    """How far off costs by kind may be: sums of the steps of an ending, and of its states."""
    terms = int(np.bincount(states.begin, minlength=1).max())
    error: Floats = parts.sum(axis=0) * (length + 2 * terms + 16) * ROUNDOFF
    return error


def unpaired_by_step(states: States) -> Floats:
    """Cost at each step of the truths and estimates that are near to none, (2, T)."""
    problem = states.problem
    total = np.zeros((2, problem.steps))
    for own, side in zip(total, problem.sides, strict=True):
        price = side.price.copy()
        price[side.row] = 0.0
        own[:] = sum_by(side.step, price, problem.steps)
    return total


def whole_blocks(states: States, prices: Floats, reduced: tuple[Reduced, ...]) -> Floats:
    """Lower bound of each whole block, (B,), of objects and steps with a near pair only."""
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
