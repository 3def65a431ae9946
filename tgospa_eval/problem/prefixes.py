"""Bounds of the costs of the steps 1..k, for every k, from a solution of the whole, in one pass.

Its assignment up to k is feasible there, and its prices up to k are prices there
(docs/theory/solvers.md, "The curve").
"""

import itertools

import numpy as np

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.paths import down, up
from tgospa_eval.problem.problem import Floats, Ints, Problem, sum_by
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE, changes


@dataclass(frozen=True, kw_only=True, eq=False)
class Cells:
    """A cell for each block and each step of its window; arrays over cells are (C,).

    Parameters
    ----------
    first : (B + 1,) int array
        First cell of each block.
    begin : (B,) int array
        First step of each window.
    """

    first: Ints
    begin: Ints

    def of(self, block: Ints, step: Ints) -> Ints:
        """Cells of blocks at steps."""
        return self.first[block] + (step - self.begin[block])

    @property
    def block(self) -> Ints:
        """Block of each cell."""
        return np.repeat(np.arange(len(self.begin)), np.diff(self.first))

    @property
    def step(self) -> Ints:
        """Step of each cell."""
        step: Ints = np.arange(self.first[-1]) - (self.first[:-1] - self.begin)[self.block]
        return step

    def sums(self, block: Ints, step: Ints, value: Floats) -> Floats:
        """For each cell the sum of the values of its block up to its step."""
        return self.running(sum_by(self.of(block, step), value, int(self.first[-1])))

    def running(self, value: Floats) -> Floats:
        """Running sums in each block.

        Of values >= 0 they are off by as many units of rounding, relative, as there are terms, and
        no sum is touched by larger ones elsewhere.
        """
        total = np.empty_like(value)
        for low, high in itertools.pairwise(self.first.tolist()):
            np.cumsum(value[low:high], out=total[low:high])
        return total

    def totals(self, value: Floats, steps: int) -> tuple[Floats, Floats]:
        """Sum over the blocks at each step, and how far off it may be, (T,), (T,).

        Blocks that have ended keep their last value. Of values 0 or more, as parts of a cost are,
        which may fall; no sum rounds to less than 0.
        """
        rise = np.diff(value, prepend=0.0)
        rise[self.first[:-1]] = value[self.first[:-1]]
        total: Floats = np.maximum(np.cumsum(sum_by(self.step, rise, steps)), 0.0)
        size = sum_by(self.step, np.abs(rise), steps)
        blocks = len(self.begin)
        return total, np.cumsum((blocks + 4) * size + 2 * total) * 2.0**-53


@dataclass(frozen=True, kw_only=True, eq=False)
class PrefixBounds:
    """Costs and bounds of the beginnings of each block, in units of c^p.

    Only objects that have a near pair are counted.

    Parameters
    ----------
    cells : Cells
        Blocks and steps.
    parts : (4, C) float array
        Localisation, missed, false and switch cost of the assignment up to the step.
    lower : (C,) float array
        Lower bound of the least possible cost.
    error : (C,) float array
        How much the parts together may be too small by rounding.
    """

    cells: Cells
    parts: Floats
    lower: Floats
    error: Floats


def bound_prefixes(states: States, weights: Ints, prices: Floats) -> PrefixBounds:
    """Of a feasible assignment (S,), in units of 1/ONE, and prices >= 0 (K,)."""
    length = states.block_end - states.block_begin + 1
    cells = Cells(
        first=np.concatenate(([0], np.cumsum(length))).astype(np.int64),
        begin=states.block_begin.astype(np.int64),
    )
    parts = _costs(states, cells, weights, changes(states, weights))
    terms = 16 + 2 * _busiest(states) + length[cells.block]
    error = parts.sum(axis=0) * terms * 2.0**-53
    return PrefixBounds(
        cells=cells, parts=parts, lower=np.maximum(_lower(states, cells, prices), 0.0), error=error
    )


def _busiest(states: States) -> int:
    """Most states that begin at one step, a bound of the terms that are added for it."""
    return int(np.bincount(states.begin, minlength=1).max())


def _costs(states: States, cells: Cells, weights: Ints, switched: tuple[Ints, Floats]) -> Floats:
    """Cost of the assignment up to each step, by kind, (4, C)."""
    problem, pair = states.problem, states.pair
    block = states.pair_block[pair]
    gains = np.flatnonzero(states.entry >= 0)
    entry, step = states.entry[gains].astype(np.intp), states.begin[gains]
    parts = [cells.sums(block[gains], step, weights[gains] / ONE * problem.cost[entry])]
    for side in problem.sides:
        row, price = side.row[entry].astype(np.intp), side.price
        used = np.bincount(row, weights[gains].astype(np.float64), minlength=len(price))
        some, at = np.unique(row, return_index=True)
        left = (ONE - used[some]) / ONE * price[some]
        parts.append(cells.sums(block[gains][at], step[at], left))
    moved, amount = switched
    begin = states.begin[moved]
    parts.append(cells.sums(block[moved], begin, problem.switch_price_at[begin] * amount))
    return np.array(parts)


def _lower(states: States, cells: Cells, prices: Floats) -> Floats:
    """The bound of `problem.certificate` for the steps of each block up to each step, (C,).

    Values are relative to the cheapest pair of each row and step, as in `problem.paths`.
    """
    problem, slots, pair = states.problem, states.columns, states.pair
    # What happens: a state begins; a slot of it does, and costs its price.
    count = slots.end - slots.begin
    slot = concatenated(slots.begin, count)
    charged = np.repeat(np.arange(len(pair)), count)

    gaining = np.flatnonzero(states.entry >= 0)
    row = states.pair_row[pair[gaining]].astype(np.int64)
    key, at = np.unique(states.begin[gaining] * np.int64(states.nodes) + row, return_inverse=True)
    entry = states.entry[gaining].astype(np.intp)
    cost = problem.cost[entry]
    order = np.lexsort((cost, at))
    cheapest = entry[order[np.flatnonzero(np.diff(at[order], prepend=-1))]]
    relative = up(problem.cost[cheapest][at] - cost)
    bases = [side.price[side.row] for side in problem.sides]
    for base in bases:
        relative = up(relative + up(base[entry] - base[cheapest][at]))
    of_cheapest = [base[cheapest] for base in bases]
    offset = np.maximum(down(down(of_cheapest[0] + of_cheapest[1]) - problem.cost[cheapest]), 0.0)
    offset_step, offset_row = np.divmod(key, states.nodes)
    offset_block = states.node_block[offset_row]

    # Unassigned prices of all objects less those of the pairs put aside, and the costs of these.
    total = np.zeros(int(cells.first[-1]))
    least = cells.sums(offset_block, offset_step, problem.cost[cheapest])
    size, exact = least.copy(), whole_prices(problem)
    total += least
    for side, base in zip(problem.sides, of_cheapest, strict=True):
        some, first = np.unique(side.row[entry].astype(np.intp), return_index=True)
        price = side.price[some]
        block = states.pair_block[pair[gaining[first]]]
        of_objects = cells.sums(block, states.begin[gaining[first]], price)
        of_pairs = cells.sums(offset_block, offset_step, base)
        total += of_objects - of_pairs
        if not exact:
            size += of_objects + of_pairs
    slot_block = states.node_block[slots.node]
    paid = cells.sums(slot_block, slots.step, prices)
    offsets = offset_step, offset_row, offset
    best = _best(states, cells, offsets, (gaining, relative), (charged, slot), prices)
    # Sums at a step, of as many terms as states begin or rows there are; then running sums.
    rows = int(np.bincount(states.node_block).max(initial=0))
    terms = 16 + 2 * _busiest(states) + 2 * rows + np.diff(cells.first)[cells.block]
    error = (size + paid + best[1] + np.abs(total)) * terms * 2.0**-53
    answer: Floats = total - best[0] - paid - error
    return answer


def whole_prices(problem: Problem) -> bool:
    """Whether sums and differences of unassigned prices are exact: multiples of a half."""
    return all(
        len(side.price) < 1 << 31 and bool(np.all(2.0 * side.price == np.rint(2.0 * side.price)))
        for side in problem.sides
    )


def _best(
    states: States,
    cells: Cells,
    offsets: tuple[Ints, Ints, Floats],
    gains: tuple[Ints, Floats],
    charges: tuple[Ints, Ints],
    prices: Floats,
) -> tuple[Floats, Floats]:
    """Upper bound of the sum of the best path values of the rows of each block, in cells.

    And the sum of their sizes. Values are rounded up, their sum to the nearest.

    Viterbi over all pairs at once, step by step: `unassigned_value` is the best value of a row at
    "none", `reached` that of each pair. A run without gain may be left only where its next state
    begins.
    """
    pair, begin = states.pair, states.begin
    switch_price = states.problem.switch_price_at
    steps = states.problem.steps
    by_row = np.argsort(states.pair_row, kind="stable")
    rows, first_of_row = np.unique(states.pair_row[by_row], return_index=True)
    row_block = states.node_block[rows]
    place = np.empty_like(by_row)
    place[by_row] = np.arange(len(by_row))
    row_at = np.searchsorted(rows, states.pair_row[by_row])  # of each pair, in that order

    state_order = np.argsort(begin, kind="stable")
    begins = np.searchsorted(begin[state_order], np.arange(steps + 1))
    relative = np.zeros(len(begin))
    relative[gains[0]] = gains[1]
    is_gain = np.zeros(len(begin), bool)
    is_gain[gains[0]] = True

    charged, slot = charges
    slot_step = states.columns.step[slot]
    charge_order = np.argsort(slot_step, kind="stable")
    charge_pair = place[pair[charged[charge_order]]]
    charge = prices[slot[charge_order]]
    charge_at = np.searchsorted(slot_step[charge_order], np.arange(steps + 1))
    offset_step, offset_row, offset = offsets
    offset_at = np.searchsorted(offset_step, np.arange(steps + 1))
    offset_place = np.searchsorted(rows, offset_row)

    unassigned_value, reached = np.zeros(len(rows)), np.zeros(len(by_row))
    answer = np.zeros((2, int(cells.first[-1])))
    last = np.zeros(len(rows))
    for step in range(steps):
        own = state_order[begins[step] : begins[step + 1]]
        lost = slice(offset_at[step], offset_at[step + 1])
        if len(own):
            at = place[pair[own]]
            row = row_at[at]
            price = switch_price[step]
            before = reached[at]
            np.maximum.at(unassigned_value, row, up(before - price))
            reached[at] = np.maximum(before, up(unassigned_value[row] - price))
        if lost.stop > lost.start:
            lose = np.zeros(len(rows))
            lose[offset_place[lost]] = offset[lost]
            spare = lose[row_at]
            if len(own):
                spare[at[is_gain[own]]] = 0.0
            reached = np.where(spare > 0, up(reached - spare), reached)
            unassigned_value = np.where(lose > 0, up(unassigned_value - lose), unassigned_value)
        if len(own):
            reached[at] = up(reached[at] + relative[own])
        paid = slice(charge_at[step], charge_at[step + 1])
        if paid.stop > paid.start:  # a pair has one slot that begins here
            charging = charge_pair[paid]
            reached[charging] = up(reached[charging] - charge[paid])
        last = (
            np.maximum(unassigned_value, np.maximum.reduceat(reached, first_of_row))
            if len(rows)
            else last
        )
        live = np.flatnonzero(
            (cells.begin <= step) & (step <= cells.begin + np.diff(cells.first) - 1)
        )
        at_live = cells.of(live, np.full(len(live), step))
        for kind, values in enumerate((last, np.abs(last))):
            total = np.bincount(row_block, values, minlength=len(cells.begin))
            answer[kind, at_live] = total[live]
    return answer[0], answer[1]
