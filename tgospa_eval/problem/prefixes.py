"""Bounds of the costs of the steps 1..k, for every k, from a solution of the whole, in one pass.

Its assignment up to k is feasible there, and its prices up to k are prices there
(docs/theory/solvers.md, "The curve").
"""

import itertools

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.forward import Moves, forward, offsets
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
    prices : Prices
        What the lower bounds are made of.
    """

    cells: Cells
    parts: Floats
    lower: Floats
    error: Floats
    prices: "Prices"


def bound_prefixes(states: States, weights: Ints, prices: Floats) -> PrefixBounds:
    """Of a feasible assignment (S,), in units of 1/ONE, and prices >= 0 (K,)."""
    length = states.block_end - states.block_begin + 1
    cells = Cells(
        first=np.concatenate(([0], np.cumsum(length))).astype(np.int64),
        begin=states.block_begin.astype(np.int64),
    )
    parts = costs_so_far(states, cells, weights, changes(states, weights))
    terms = 16 + 2 * _busiest(states) + length[cells.block]
    error = parts.sum(axis=0) * terms * 2.0**-53
    found = Prices.of(states, cells, prices)
    return PrefixBounds(
        cells=cells, parts=parts, lower=found.whole_bounds(states), error=error, prices=found
    )


def _busiest(states: States) -> int:
    """Most states that begin at one step, a bound of the terms that are added for it."""
    return int(np.bincount(states.begin, minlength=1).max())


def costs_so_far(
    states: States, cells: Cells, weights: Ints, switched: tuple[Ints, Floats]
) -> Floats:
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Prices:
    """Lower bounds of the beginnings of each block from prices, by parts; arrays are (C,).

    ``L = unassigned - offsets - sum of the best values of the rows - paid``, the bound of
    `problem.certificate` for the steps of each block up to each step.

    Parameters
    ----------
    cells : Cells
        Blocks and steps.
    moves : Moves
        What happens at the prices.
    total, size : (C,) float arrays
        Unassigned prices of all objects less those of the cheapest pairs, and the costs of these;
        and the sizes of what was added for it with rounding.
    paid : (C,) float array
        Sums of the prices.
    terms : (C,) int array
        How many terms were added at most.
    """

    cells: Cells
    moves: Moves
    total: Floats
    size: Floats
    paid: Floats
    terms: Ints

    @classmethod
    def of(cls, states: States, cells: Cells, prices: Floats) -> "Prices":
        """Of prices >= 0, (K,)."""
        problem, slots, pair = states.problem, states.columns, states.pair
        found = offsets(states)
        offset_block = states.node_block[found.row]
        total = cells.sums(offset_block, found.step, problem.cost[found.entry])
        size, exact = total.copy(), whole_prices(problem)
        gaining = np.flatnonzero(states.entry >= 0)
        entry = states.entry[gaining].astype(np.intp)
        for side in problem.sides:
            some, first = np.unique(side.row[entry].astype(np.intp), return_index=True)
            block = states.pair_block[pair[gaining[first]]]
            of_objects = cells.sums(block, states.begin[gaining[first]], side.price[some])
            base = side.price[side.row[found.entry]]
            of_pairs = cells.sums(offset_block, found.step, base)
            total += of_objects - of_pairs
            if not exact:
                size += of_objects + of_pairs
        # Sums at a step, of as many terms as states begin or rows there are; then running sums.
        rows = int(np.bincount(states.node_block).max(initial=0))
        return cls(
            cells=cells,
            moves=Moves.of(states, found, prices),
            total=total,
            size=size,
            paid=cells.sums(states.node_block[slots.node], slots.step, prices),
            terms=16 + 2 * _busiest(states) + 2 * rows + np.diff(cells.first)[cells.block],
        )

    def bounds(
        self, cells: Ints, best: Floats, sizes: Floats, paid: Floats | None = None
    ) -> Floats:
        """Lower bounds of some cells, 0 at least.

        Parameters
        ----------
        cells : (N,) int array
            Which.
        best, sizes : (N,) float arrays
            Sum of the best values of the rows, and the sum of their sizes, rounded to the nearest.
        paid : (N,) float array, optional
            What was paid, where that is not `paid`.
        """
        paid = self.paid[cells] if paid is None else paid
        total = self.total[cells]
        error = (self.size[cells] + paid + sizes + np.abs(total)) * self.terms[cells] * 2.0**-53
        lower: Floats = np.maximum(total - best - paid - error, 0.0)
        return lower

    def whole_bounds(self, states: States) -> Floats:
        """Lower bounds of all cells."""
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
        return self.bounds(np.arange(values.shape[1]), values[0], values[1])


def whole_prices(problem: Problem) -> bool:
    """Whether sums and differences of unassigned prices are exact: multiples of a half."""
    return all(
        len(side.price) < 1 << 31 and bool(np.all(2.0 * side.price == np.rint(2.0 * side.price)))
        for side in problem.sides
    )
