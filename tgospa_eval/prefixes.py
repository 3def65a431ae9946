"""What a solution of the whole says of every beginning of it, in one pass.

Its assignment up to a step is feasible there, and its prices up to it bound from below; both meet
at many steps.
"""

from dataclasses import dataclass

import numpy as np

from tgospa_eval.problem import Floats, Ints, sum_by
from tgospa_eval.states import States
from tgospa_eval.weights import ONE, changes


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
        """Running sums in each block."""
        total = np.cumsum(value)
        before = np.concatenate(([0.0], total))[self.first[:-1]]
        return total - before[self.block]

    def rises(self, value: Floats) -> Floats:
        """What the values grow by from the step before."""
        rise = np.diff(value, prepend=0.0)
        first = self.first[:-1]
        rise[first] = value[first]
        return rise

    def totals(self, value: Floats, steps: int) -> Floats:
        """Sum over the blocks at each step; blocks that have ended keep their last value.

        Of values 0 or more, as parts of a cost are, which may fall; no sum rounds to less than 0.
        """
        total: Floats = np.maximum(np.cumsum(sum_by(self.step, self.rises(value), steps)), 0.0)
        return total


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """What an assignment and prices say of the beginnings of each block, in units of c^p.

    Only objects that have a near pair are counted.

    Parameters
    ----------
    cells : Cells
        Blocks and steps.
    parts : (4, C) float array
        Localisation, missed, false and switch cost of the assignment up to the step.
    gap : (C,) float array
        By how much the least possible cost may be smaller.
    """

    cells: Cells
    parts: Floats
    gap: Floats


def propose(states: States, weights: Ints, prices: Floats) -> Proposal:
    """Judge a feasible assignment (S,), in units of 1/ONE, and prices >= 0 (K,) everywhere."""
    length = states.block_end - states.block_begin + 1
    cells = Cells(
        first=np.concatenate(([0], np.cumsum(length))).astype(np.int64),
        begin=states.block_begin.astype(np.int64),
    )
    switched = changes(states, weights)
    return Proposal(
        cells=cells,
        parts=_costs(states, cells, weights, switched),
        gap=np.maximum(_gaps(states, cells, weights, prices, switched), 0.0),
    )


def _costs(states: States, cells: Cells, weights: Ints, switched: tuple[Ints, Floats]) -> Floats:
    """Cost of the assignment up to each step, by kind, (4, C)."""
    problem, pair = states.problem, states.pair
    block = states.pair_block[pair]
    gains = np.flatnonzero(states.entry >= 0)
    entry, step = states.entry[gains].astype(np.intp), states.begin[gains]
    parts = [cells.sums(block[gains], step, weights[gains] / ONE * problem.cost[entry])]
    for rows, price in (
        (problem.truth_row, problem.truth_price),
        (problem.estimate_row, problem.estimate_price),
    ):
        row = rows[entry].astype(np.intp)
        used = np.bincount(row, weights[gains].astype(np.float64), minlength=len(price))
        some, at = np.unique(row, return_index=True)
        left = (1 - used[some] / ONE) * price[some]
        parts.append(cells.sums(block[gains][at], step[at], left))
    moved, amount = switched
    begin = states.begin[moved]
    parts.append(cells.sums(block[moved], begin, problem.crossing_price[begin] * amount))
    return np.array(parts)


def _gaps(
    states: States, cells: Cells, weights: Ints, prices: Floats, switched: tuple[Ints, Floats]
) -> Floats:
    """What the rows of each block lose against their best paths, and idle slots, up to each step.

    Values are relative to the cheapest pair of each row and step, as in `tgospa_eval.paths`.
    """
    problem, slots = states.problem, states.columns
    pair, ends = states.pair, slots.end
    crossing = problem.crossing_price
    share = weights / ONE

    # What happens: a state begins; a slot of it does, and costs its price.
    count = ends - slots.begin
    slot = np.arange(count.sum()) + np.repeat(slots.begin - (np.cumsum(count) - count), count)
    charged = np.repeat(np.arange(len(pair)), count)

    gaining = np.flatnonzero(states.entry >= 0)
    row = states.pair_row[pair[gaining]].astype(np.int64)
    key, at = np.unique(states.begin[gaining] * np.int64(states.nodes) + row, return_inverse=True)
    entry = states.entry[gaining].astype(np.intp)
    gain, price_cost = problem.gains(entry), problem.cost[entry]
    base = (
        problem.truth_price[problem.truth_row[entry]]
        + problem.estimate_price[problem.estimate_row[entry]]
    )
    order = np.lexsort((price_cost, at))
    cheapest = order[np.flatnonzero(np.diff(at[order], prepend=-1))]
    relative = (price_cost[cheapest][at] - price_cost) + (base - base[cheapest][at])
    offset = gain[cheapest]
    offset_step, offset_row = np.divmod(key, states.nodes)

    # What the assignment is worth to its rows, and what idle slots would have cost.
    block_of_row = states.node_block[offset_row]
    covered = sum_by(at, share[gaining], len(key))
    own = cells.sums(
        states.pair_block[pair[gaining]], states.begin[gaining], share[gaining] * relative
    )
    own -= cells.sums(block_of_row, offset_step, offset * (1 - covered))
    moved, amount = switched
    own -= cells.sums(
        states.pair_block[pair[moved]], states.begin[moved], crossing[states.begin[moved]] * amount
    )
    slot_block = states.node_block[slots.node]
    own -= cells.sums(slot_block, slots.step, prices)

    best = _best(
        states, cells, (offset_step, offset_row, offset), (gaining, relative), (charged, slot),
        prices,
    )  # fmt: skip
    return best - own


def _best(
    states: States,
    cells: Cells,
    offsets: tuple[Ints, Ints, Floats],
    gains: tuple[Ints, Floats],
    charges: tuple[Ints, Ints],
    prices: Floats,
) -> Floats:
    """Sum of the best path values of the rows of each block, up to each step, in cells.

    Viterbi over all pairs at once, step by step: `hub` is the best value of a row at "none",
    `reached` that of each pair. A run without gain may be left only where its next state begins.
    """
    pair, begin = states.pair, states.begin
    crossing = states.problem.crossing_price
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

    hub, reached = np.zeros(len(rows)), np.zeros(len(by_row))
    answer = np.zeros(int(cells.first[-1]))
    last = np.zeros(len(rows))
    for step in range(steps):
        own = state_order[begins[step] : begins[step + 1]]
        lost = slice(offset_at[step], offset_at[step + 1])
        if len(own):
            at = place[pair[own]]
            row = row_at[at]
            price = crossing[step]
            before = reached[at]
            np.maximum.at(hub, row, before - price)
            reached[at] = np.maximum(before, hub[row] - price)
        if lost.stop > lost.start:
            lose = np.zeros(len(rows))
            lose[offset_place[lost]] = offset[lost]
            spare = lose[row_at]
            if len(own):
                spare[at[is_gain[own]]] = 0.0
            reached -= spare
            hub -= lose
        if len(own):
            reached[at] += relative[own]
        paid = slice(charge_at[step], charge_at[step + 1])
        if paid.stop > paid.start:
            np.subtract.at(reached, charge_pair[paid], charge[paid])
        last = np.maximum(hub, np.maximum.reduceat(reached, first_of_row)) if len(rows) else last
        live = np.flatnonzero(
            (cells.begin <= step) & (step <= cells.begin + np.diff(cells.first) - 1)
        )
        total = np.bincount(row_block, last, minlength=len(cells.begin))
        answer[cells.of(live, np.full(len(live), step))] = total[live]
    return answer
