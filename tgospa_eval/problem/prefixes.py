"""Bounds of the cost of the steps 1..k, for all k at once, from one solution of all steps.

The assignment of the steps 1..k is feasible for these steps, and its cost is an upper bound. The
prices of these steps give a lower bound (docs/theory/solvers.md, "The curve"). Sizes of arrays,
such as (S,), are explained in `problem.states`.
"""

import itertools
from collections.abc import Iterator

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.paths import down, up
from tgospa_eval.problem.problem import Problem, sum_by
from tgospa_eval.problem.states import ONE, States, changes

Offsets = tuple[Ints, Ints, Ints, Floats, Floats]
"""Return type of `offsets`."""


def offsets(states: States) -> Offsets:
    """Return the cheapest entry of each row and step, and gains relative to it.

    The arrays (G,) have an element for each row and each step at which the row has an entry.

    Returns
    -------
    step, row : (G,) int arrays
        The step, and the node of the row, sorted by (step, row).
    entry : (G,) int array
        The cheapest entry of this row and step.
    loss : (G,) float array
        The *offset*: a lower bound of the gain of the cheapest entry. All paths of the row *lose*
        it: it is subtracted from their values.
    relative : (S,) float array
        Upper bound of the gain of each state minus the offset of its row and step; 0 for runs
        without gain.
    """
    problem, pair = states.problem, states.pair
    gaining = np.flatnonzero(states.entry >= 0)
    row = states.pair_row[pair[gaining]].astype(np.int64)
    key = states.begin[gaining] * np.int64(states.nodes) + row
    order = np.argsort(key, kind="stable")
    gaining, key = gaining[order], key[order]
    opens = np.flatnonzero(np.diff(key, prepend=-1))
    at = np.repeat(np.arange(len(opens)), np.diff(opens, append=len(key)))
    entry = states.entry[gaining].astype(np.intp)
    cost = problem.cost[entry]
    smallest = np.minimum.reduceat(cost, opens) if len(opens) else cost
    cheapest_at = np.flatnonzero(cost == smallest[at])
    cheapest = entry[cheapest_at[np.flatnonzero(np.diff(at[cheapest_at], prepend=-1))]]
    gain = up(smallest[at] - cost)
    bases = [side.price[side.row] for side in problem.sides]
    for base in bases:
        gain = up(gain + up(base[entry] - base[cheapest][at]))
    of_cheapest = [base[cheapest] for base in bases]
    loss = np.maximum(down(down(of_cheapest[0] + of_cheapest[1]) - smallest), 0.0)
    relative = np.zeros(len(pair))
    relative[gaining] = gain
    step, node = np.divmod(key[opens], states.nodes)
    return step, node, cheapest, loss, relative


@dataclass(frozen=True, kw_only=True, eq=False)
class RowMoves:
    """Events of rows, in order of time: states begin, prices are paid, offsets are lost.

    Rows and pairs are those of the states given to `RowMoves.of`, numbered in the same order. A
    time is an integer from 0 on. The events of a kind are sorted by time. An array (times + 1,) has
    the index of the first event of each time, and at the end the number of events. Other arrays
    have an element for each event.

    Parameters
    ----------
    rows : (R,) int array
        Node of each row.
    first : (R,) int array
        First pair of each row.
    row : (P,) int array
        Row of each pair.
    begins : (times + 1,) int array
        Index of the first state that begins at each time.
    begin_pair, gains, relative, switch_price : arrays
        For each state that begins: its pair, a mask that is True if it has a gain, its gain minus
        the offset, and the switch price. A path pays the switch price if it enters the state from
        "none", or if it leaves the state before in the same pair for "none".
    charges : (times + 1,) int array
        Index of the first payment at each time.
    charge_pair, charge : arrays
        Pair and amount of each payment. The amount is the price of one slot.
    losses : (times + 1,) int array
        Index of the first loss at each time.
    loss_row, loss : arrays
        Row and amount of each loss of an offset.
    """

    rows: Ints
    first: Ints
    row: Ints
    begins: Ints
    begin_pair: Ints
    gains: Mask
    relative: Floats
    switch_price: Floats
    charges: Ints
    charge_pair: Ints
    charge: Floats
    losses: Ints
    loss_row: Ints
    loss: Floats

    @classmethod
    def of(
        cls, states: States, offsets: Offsets, prices: Floats, since: Ints | None = None
    ) -> "RowMoves":
        """Return the events of all states at prices (K,).

        The time of step k is k, or k - since[k] if `since` (T,) is given. Events before time 0 are
        left out.
        """
        offset_step, offset_row, _, loss, relative = offsets
        steps = states.problem.steps
        time_of = np.arange(steps) - (np.zeros(steps, np.int64) if since is None else since)
        times = int(time_of.max(initial=-1)) + 1
        edges = np.arange(times + 1)
        rows, first, row = np.unique(states.pair_row, return_index=True, return_inverse=True)
        pair = states.pair

        time = time_of[states.begin]
        order = np.argsort(time, kind="stable")
        order = order[np.searchsorted(time[order], 0) :]
        begins = np.searchsorted(time[order], edges)

        slots = states.columns
        costly = np.flatnonzero(prices > 0)
        of_slot = np.full(len(prices) + 1, len(costly))
        of_slot[:-1] = np.searchsorted(costly, np.arange(len(prices)))
        low, high = of_slot[slots.begin], of_slot[slots.end]
        slot = costly[concatenated(low, high - low)]
        paying = np.repeat(pair, high - low)
        paid_at = time_of[slots.step[slot]]
        by_time = np.argsort(paid_at, kind="stable")
        by_time = by_time[np.searchsorted(paid_at[by_time], 0) :]

        lost_at = time_of[offset_step]
        by_loss = np.argsort(lost_at, kind="stable")
        by_loss = by_loss[np.searchsorted(lost_at[by_loss], 0) :]
        return cls(
            rows=rows,
            first=first,
            row=row,
            begins=begins,
            begin_pair=pair[order],
            gains=states.entry[order] >= 0,
            relative=relative[order],
            switch_price=states.problem.switch_price_at[states.begin[order]],
            charges=np.searchsorted(paid_at[by_time], edges),
            charge_pair=paying[by_time],
            charge=prices[slot[by_time]],
            losses=np.searchsorted(lost_at[by_loss], edges),
            loss_row=np.searchsorted(rows, offset_row[by_loss]),
            loss=loss[by_loss],
        )

    @property
    def times(self) -> int:
        """Number of times."""
        return len(self.begins) - 1


def forward(
    moves: RowMoves, unassigned: Floats, reached: Floats, rest: Floats | None = None
) -> Iterator[Floats]:
    """Yield an upper bound of the value of each row's best path, (R,), after each time.

    The offsets up to a time are subtracted from the values of all paths. A path can change from a
    pair to "none" only when a state of the pair begins. The arrays `unassigned`, `reached` and
    `rest` are changed in place.

    Parameters
    ----------
    moves : RowMoves
        The events.
    unassigned : (R,) float array
        For each row, the best value before time 0 of its paths that are at "none".
    reached : (P,) float array
        For each pair, the best value before time 0 of the paths that are in the pair.
    rest : (R,) float array, optional
        For each row, the best value of its paths that are in states without events.
    """
    for time in range(moves.times):
        own = slice(moves.begins[time], moves.begins[time + 1])
        lost = slice(moves.losses[time], moves.losses[time + 1])
        paid = slice(moves.charges[time], moves.charges[time + 1])
        at = moves.begin_pair[own]
        if len(at):
            row = moves.row[at]
            price = moves.switch_price[own]
            before = reached[at]
            np.maximum.at(unassigned, row, up(before - price))
            reached[at] = np.maximum(before, up(unassigned[row] - price))
        if lost.stop > lost.start:
            lose = np.zeros(len(unassigned))
            lose[moves.loss_row[lost]] = moves.loss[lost]
            spare = lose[moves.row]
            spare[at[moves.gains[own]]] = 0.0
            np.copyto(reached, up(reached - spare), where=spare > 0)
            np.copyto(unassigned, up(unassigned - lose), where=lose > 0)
            if rest is not None:
                np.copyto(rest, up(rest - lose), where=lose > 0)
        if len(at):
            reached[at] = up(reached[at] + moves.relative[own])
        if paid.stop > paid.start:  # each pair at most once: at most one of its slots begins
            charging = moves.charge_pair[paid]
            reached[charging] = up(reached[charging] - moves.charge[paid])
        best = np.maximum(unassigned, np.maximum.reduceat(reached, moves.first))
        yield best if rest is None else np.maximum(best, rest)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cells:
    """Indices of cells. A *cell* is a step in the window of a block. Arrays (C,) are over cells.

    Parameters
    ----------
    first : (B + 1,) int array
        First cell of each block.
    begin : (B,) int array
        First step of each window.
    """

    first: Ints
    begin: Ints

    @classmethod
    def of_blocks(cls, states: States) -> "Cells":
        """Return the cells of all blocks."""
        ends = np.cumsum(states.block_end - states.block_begin + 1, dtype=np.int64)
        return cls(
            first=np.concatenate((np.zeros(1, np.int64), ends)),
            begin=states.block_begin.astype(np.int64),
        )

    def of(self, block: Ints, step: Ints) -> Ints:
        """Return the cell of each `block` at each `step`; both arrays have the same length."""
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
        """Return, for each cell, the sum of the values of its block up to its step.

        The arrays `block` and `step` have the block and the step of each value.
        """
        return self.running(sum_by(self.of(block, step), value, int(self.first[-1])))

    def running(self, value: Floats) -> Floats:
        """Return the running sums of values (C,) in each block.

        For values >= 0, the relative error of a sum of n terms is at most n 2^-53. Values of other
        blocks do not change it.
        """
        total = np.empty_like(value)
        for low, high in itertools.pairwise(self.first.tolist()):
            np.cumsum(value[low:high], out=total[low:high])
        return total

    def totals(self, value: Floats, steps: int) -> tuple[Floats, Floats]:
        """Return the sum over all blocks at each step (T,), and bounds of the rounding errors (T,).

        A block counts 0 before its window, and its last value after its window. Values (C,) must be
        >= 0, but can decrease from step to step. Sums are at least 0, in spite of rounding.
        """
        rise = np.diff(value, prepend=0.0)
        rise[self.first[:-1]] = value[self.first[:-1]]
        total: Floats = np.maximum(np.cumsum(sum_by(self.step, rise, steps)), 0.0)
        size = sum_by(self.step, np.abs(rise), steps)
        blocks = len(self.begin)
        return total, np.cumsum((blocks + 4) * size + 2 * total) * 2.0**-53


def _busiest(states: States) -> int:
    """Return the largest number of states that begin at one step."""
    return int(np.bincount(states.begin, minlength=1).max())


def costs_so_far(states: States, cells: Cells, weights: Ints) -> tuple[Floats, Floats]:
    """Return the cost of the assignment up to each cell by kind, (4, C), and its error, (C,).

    The cost of a cell is that of its block up to its step. The kinds are localisation, missed,
    false and switch. The error bounds the rounding error of the sum of the four kinds.
    """
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
    moved, amount = changes(states, weights)
    begin = states.begin[moved]
    parts.append(cells.sums(block[moved], begin, problem.switch_price_at[begin] * amount))
    terms = 16 + 2 * _busiest(states) + np.diff(cells.first)[cells.block]
    return np.array(parts), np.array(parts).sum(axis=0) * terms * 2.0**-53


@dataclass(frozen=True, kw_only=True, eq=False)
class PrefixBounds:
    """Costs and bounds of the prefixes of each block, in units of c^p.

    A *prefix* is the window of a block up to a step. There is one prefix for each cell. Only states
    with a near pair are counted. The lower bound of a prefix is the bound of `problem.certificate`
    for its steps: `total` minus the sum of the best values of the rows, minus `paid`.

    Parameters
    ----------
    cells : Cells
        Blocks and steps.
    parts : (4, C) float array
        Localisation, missed, false and switch cost of the assignment in the prefix.
    error : (C,) float array
        Bound of the rounding error of the sum of the parts.
    moves : RowMoves
        Events of the rows at the prices.
    total : (C,) float array
        Sum of the costs of the cheapest pair of each row and step in the prefix, plus the prices of
        leaving unassigned all objects that are not in these pairs.
    size : (C,) float array
        Sum of the absolute values of those terms of `total` that were added with rounding errors.
    paid : (C,) float array
        Sum of the prices of the column slots that begin in the prefix.
    terms : (C,) int array
        Upper bound of the number of terms that were added.
    """

    cells: Cells
    parts: Floats
    error: Floats
    moves: RowMoves
    total: Floats
    size: Floats
    paid: Floats
    terms: Ints

    @classmethod
    def of(cls, states: States, weights: Ints, prices: Floats) -> "PrefixBounds":
        """Return the bounds from an assignment (S,), in units of 1/ONE, and prices >= 0 (K,)."""
        cells = Cells.of_blocks(states)
        parts, off = costs_so_far(states, cells, weights)
        problem, slots, pair = states.problem, states.columns, states.pair
        gains = offsets(states)
        offset_step, offset_row, offset_entry, _, _ = gains
        offset_block = states.node_block[offset_row]
        total = cells.sums(offset_block, offset_step, problem.cost[offset_entry])
        size, exact = total.copy(), whole_prices(problem)
        gaining = np.flatnonzero(states.entry >= 0)
        entry = states.entry[gaining].astype(np.intp)
        for side in problem.sides:
            some, first = np.unique(side.row[entry].astype(np.intp), return_index=True)
            block = states.pair_block[pair[gaining[first]]]
            of_objects = cells.sums(block, states.begin[gaining[first]], side.price[some])
            base = side.price[side.row[offset_entry]]
            of_pairs = cells.sums(offset_block, offset_step, base)
            total += of_objects - of_pairs
            if not exact:
                size += of_objects + of_pairs
        # The sum of one step has at most one term for each state that begins, or for each row. The
        # running sum has a term for each step.
        rows = int(np.bincount(states.node_block).max(initial=0))
        return cls(
            cells=cells,
            parts=parts,
            error=off,
            moves=RowMoves.of(states, gains, prices),
            total=total,
            size=size,
            paid=cells.sums(states.node_block[slots.node], slots.step, prices),
            terms=16 + 2 * _busiest(states) + 2 * rows + np.diff(cells.first)[cells.block],
        )

    def lower(self, cells: Ints, best: Floats, sizes: Floats, paid: Floats) -> Floats:
        """Return lower bounds of the optimal cost of some cells, at least 0.

        Parameters
        ----------
        cells : (N,) int array
            The cells.
        best, sizes : (N,) float arrays
            For each cell: sum of the best values of the rows, and sum of their absolute values.
            Both sums are rounded to nearest.
        paid : (N,) float array
            For each cell, sum of the prices of the column slots that begin up to it.
        """
        total = self.total[cells]
        error = (self.size[cells] + paid + sizes + np.abs(total)) * self.terms[cells] * 2.0**-53
        lower: Floats = np.maximum(total - best - paid - error, 0.0)
        return lower

    def whole_lower(self, states: States) -> Floats:
        """Return lower bounds of all cells."""
        cells, moves = self.cells, self.moves
        row_block = states.node_block[moves.rows]
        values = np.zeros((2, int(cells.first[-1])))
        last = cells.begin + np.diff(cells.first) - 1
        values_of = forward(moves, np.zeros(len(moves.rows)), np.zeros(len(moves.row)))
        for step, best in enumerate(values_of):
            live = np.flatnonzero((cells.begin <= step) & (step <= last))
            at_live = cells.of(live, np.full(len(live), step))
            for kind, some in enumerate((best, np.abs(best))):
                values[kind, at_live] = np.bincount(row_block, some, minlength=len(last))[live]
        return self.lower(np.arange(values.shape[1]), values[0], values[1], self.paid)


def whole_prices(problem: Problem) -> bool:
    """Check that all prices of unassigned objects are multiples of 1/2: their sums are exact."""
    return all(
        len(side.price) < 1 << 31 and bool(np.all(2.0 * side.price == np.rint(2.0 * side.price)))
        for side in problem.sides
    )
