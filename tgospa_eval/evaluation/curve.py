"""The normalised curve: proven costs of the steps 1..k for each k (docs/theory/solvers.md).

A solution of the whole brackets every beginning. The beginnings of components whose bracket stays
open are solved again, from as few steps before their end as will do, many side by side in one
problem that starts from the solution of the whole.
"""

from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Limit, Progress, Stopwatch
from tgospa_eval.evaluation.endings import (
    ContinuedPrefixes,
    SeparateStretches,
    Suffixes,
    unpaired_by_step,
    whole_blocks,
)
from tgospa_eval.problem.certificate import ROUNDOFF, fair_prices
from tgospa_eval.problem.prefixes import (
    Cells,
    PrefixBounds,
    costs_so_far,
    whole_prices,
)
from tgospa_eval.problem.problem import Problem, sum_by
from tgospa_eval.problem.solution import Brackets, Reduced, Windows
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import SavedSolution, save_solution

SPAN = 8
"""Steps of the first endings: of 8, 12, 16, 24, 32 the quickest on crowds of 20 and of 100."""


def trace(
    states: States,
    weights: Ints,
    prices: Floats,
    solver: Certified,
    reduced: tuple[Reduced, ...] = (),
    progress: Progress | None = None,
) -> Brackets:
    """The curve of a solved problem; its last point is what the solution proves of the whole.

    Parameters
    ----------
    states : States
        The whole.
    weights : (S,) int array
        A feasible assignment, in units of 1/ONE.
    prices : (K,) float array
        Prices of its column slots, 0 or more.
    solver : Certified
        What solves beginnings, and to which gap; its time limit is that of all of them together.
    reduced : tuple of Reduced
        What is known of the whole at smaller cutoffs.
    progress : Progress, optional
        Gets the share that is done; what is not begun when it is to stop stays open.
    """
    progress = progress or Progress()
    prices = fair_prices(prices)
    found = PrefixBounds.of(states, weights, prices)
    cells, parts = found.cells, found.parts.copy()
    least, error = found.whole_lower(states), found.error.copy()
    unpaired_costs = np.cumsum(unpaired_by_step(states), axis=1)
    ends = cells.first[1:] - 1
    least[ends] = np.maximum(least[ends], whole_blocks(states, prices, reduced))

    bracket = _Brackets(cells=cells, parts=parts, least=least, error=error, gap=solver.gap)
    bracket.open[ends] = False  # a whole block: the solver has had its chance
    if bracket.open.any():
        endings, saved = Suffixes(states, weights), save_solution(states, weights, prices)
        from_begin = states.transposed.copy()
        for part in reduced:
            from_begin |= part.blocks
        _narrow(bracket, endings, found, saved, from_begin, solver, progress)

    problem = states.problem
    shown = np.array([cells.totals(part, problem.steps)[0] for part in parts])
    shown[1:3] += unpaired_costs
    # Of objects that are near to none: sums of so many prices.
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
    lower, off = cells.totals(least, problem.steps)
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
    """Of every cell costs by kind, a lower bound, and whether the bracket is to become narrower."""

    def __init__(
        self, *, cells: Cells, parts: Floats, least: Floats, error: Floats, gap: float
    ) -> None:
        self.cells, self.parts, self.least, self.error, self.gap = cells, parts, least, error, gap
        self.cost = parts.sum(axis=0)
        self.open = self.wide

    @property
    def wide(self) -> Mask:
        """Which brackets are wider than the gap."""
        wide: Mask = self.cost + self.error - self.least > self.gap * self.cost
        return wide

    def take(self, cell: Ints, parts: Floats, lower: Floats, error: Floats) -> None:
        """Take what is better."""
        np.maximum.at(self.least, cell, lower)
        cost = parts.sum(axis=0)
        order = np.lexsort((cost, cell))
        order = order[np.flatnonzero(np.diff(cell[order], prepend=-1))]
        order = order[cost[order] < self.cost[cell[order]]]
        wins = cell[order]
        self.parts[:, wins], self.error[wins] = parts[:, order], error[order]
        self.cost[wins] = cost[order]


def _narrow(
    brackets: _Brackets,
    endings: Suffixes,
    found: PrefixBounds,
    saved: SavedSolution,
    from_begin: Mask,
    solver: Certified,
    progress: Progress,
) -> None:
    """Solve endings of what is open, the few last steps first, then twice as many, and so on.

    Blocks that are marked in `from_begin` (B,) are solved from their first step on at once.
    """
    limit = Limit.of(solver.time_limit, progress)
    cells, span, most = brackets.cells, SPAN, np.count_nonzero(brackets.open)
    while brackets.open.any():
        cell = np.flatnonzero(brackets.open)
        block, end = cells.block[cell], cells.step[cell]
        first = cells.begin[block]
        begin = np.maximum(end + 1 - span, first)
        begin = np.where((begin - first < span // 2) | from_begin[block], first, begin)
        continued = ContinuedPrefixes(endings, found, saved)
        for whole in (False, True):
            at = np.flatnonzero((begin == first) == whole)
            at = at[np.argsort(begin[at], kind="stable")]
            for group in endings.groups(block[at], begin[at], end[at]):
                if limit.late():
                    return
                progress.again("the curve", 1 - np.count_nonzero(brackets.open) / most)
                own = at[group]
                own = own[brackets.open[cell[own]]]  # others may have shown it
                if not len(own):
                    continue
                timed = _for_the_rest(solver, limit)
                asked = block[own], begin[own], end[own]
                if whole:
                    alone = SeparateStretches(endings, saved, *asked).solve(*timed)
                    brackets.take(cell[own], *alone)
                else:
                    brackets.take(*continued.solve(*asked, *timed))
                brackets.open &= brackets.wide
            if whole:
                brackets.open[cell[at]] = False
        span *= 2


def _for_the_rest(solver: Certified, limit: Limit) -> tuple[Certified, Stopwatch]:
    """The solver for the time that is left, and a clock of its own that shows nothing."""
    stopwatch, left = Stopwatch(), limit.left()
    stopwatch.progress = limit.progress.silent()
    return replace(solver, time_limit=None if left is None else max(left, 1e-9)), stopwatch


# -------------------------------------------------------------------------------------------------
# Sliding windows: proven costs of stretches of steps, each by itself (docs/theory/solvers.md).
#
# A component of which all steps are in a window costs there what it costs in the whole. Of the
# others
# the stretch in the window is a problem of its own: the assignment and the prices of the whole
# bracket it; what stays open is solved, from there, many stretches side by side.


def slide(
    states: States,
    weights: Ints,
    prices: Floats,
    solver: Certified,
    spans: tuple[Ints, Ints],
    reduced: tuple[Reduced, ...] = (),
    progress: Progress | None = None,
) -> Windows:
    """The windows of a solved problem.

    Parameters
    ----------
    states : States
        The whole.
    weights : (S,) int array
        A feasible assignment, in units of 1/ONE.
    prices : (K,) float array
        Prices of its column slots, 0 or more.
    solver : Certified
        What solves stretches, and to which gap; its time limit is that of all of them together.
    spans : pair of (K,) int arrays
        First and last step of each window, in order.
    reduced : tuple of Reduced
        What is known of the whole at smaller cutoffs.
    progress : Progress, optional
        Gets the share that is done; what is not begun when it is to stop has the bracket that the
        solution of the whole proves.
    """
    problem = states.problem
    first, last = spans
    prices = fair_prices(prices)
    stretches = _WindowStretches.of(states, first, last)
    found = np.zeros((6, len(stretches.block)))  # four kinds of costs, a lower bound, an error
    complete = stretches.complete(states)
    block = stretches.block[complete]
    found[:, complete] = np.vstack(_of_blocks(states, weights, prices, reduced, block))
    rest = np.setdiff1d(np.arange(len(stretches.block)), complete)
    if len(rest):
        endings, saved = Suffixes(states, weights), save_solution(states, weights, prices)
        limit = Limit.of(solver.time_limit, progress or Progress())
        done = 0
        for group in endings.groups(*stretches.some(rest)):
            limit.progress.again("the windows", done / len(rest))
            own = rest[group]
            alone = SeparateStretches(endings, saved, *stretches.some(own))
            found[:, own] = np.vstack(_solved(alone, solver, limit))
            done += len(own)
    return _added(problem, unpaired_by_step(states), found, stretches, spans)


@dataclass(frozen=True, kw_only=True, eq=False)
class _WindowStretches:
    """What the windows have of the blocks, each once.

    Parameters
    ----------
    block, begin, end : (N,) int arrays
        Block, and first and last step of each.
    of_window, stretch : (M,) int arrays
        Windows, and a stretch that each consists of.
    """

    block: Ints
    begin: Ints
    end: Ints
    of_window: Ints
    stretch: Ints

    @classmethod
    def of(cls, states: States, first: Ints, last: Ints) -> "_WindowStretches":
        opens, closes = states.block_begin.astype(np.int64), states.block_end.astype(np.int64)
        low = np.searchsorted(last, opens)
        count = np.maximum(np.searchsorted(first, closes, "right") - low, 0)
        block = np.repeat(np.arange(len(opens)), count)
        window = np.arange(len(block)) + np.repeat(low - np.cumsum(count) + count, count)
        begin = np.maximum(first[window], opens[block])
        end = np.minimum(last[window], closes[block])
        steps = np.int64(states.problem.steps)
        # Windows go on in time, so equal ones follow each other.
        fresh = np.diff(block, prepend=-1) != 0
        fresh[1:] |= np.diff(begin * steps + end) != 0
        at = np.flatnonzero(fresh)
        return cls(
            block=block[at],
            begin=begin[at],
            end=end[at],
            of_window=window,
            stretch=np.cumsum(fresh) - 1,
        )

    def complete(self, states: States) -> Ints:
        """Those that are all steps of their block."""
        whole = self.begin == states.block_begin[self.block]
        return np.flatnonzero(whole & (self.end == states.block_end[self.block]))

    def some(self, chosen: Ints) -> tuple[Ints, Ints, Ints]:
        """Block, and first and last step of some."""
        return self.block[chosen], self.begin[chosen], self.end[chosen]


def _of_blocks(
    states: States, weights: Ints, prices: Floats, reduced: tuple[Reduced, ...], block: Ints
) -> tuple[Floats, Floats, Floats]:
    """Costs by kind, lower bound and error of whole blocks."""
    if not len(block):
        return np.zeros((4, 0)), np.zeros(0), np.zeros(0)
    cells = Cells.of_blocks(states)
    ends = cells.first[1:][block] - 1
    parts, error = costs_so_far(states, cells, weights)
    return parts[:, ends], whole_blocks(states, prices, reduced)[block], error[ends]


def _solved(
    alone: SeparateStretches, solver: Certified, limit: Limit
) -> tuple[Floats, Floats, Floats]:
    """Costs by kind, lower bound and error, as narrow as asked if time allows."""
    held = alone.held()
    parts, lower, error = held
    cost = parts.sum(axis=0)
    if limit.late() or not (cost + error - lower > solver.gap * cost).any():
        return held
    solved = alone.solve(*_for_the_rest(solver, limit))
    cheaper = solved[0].sum(axis=0) < cost
    return (
        np.where(cheaper, solved[0], parts),
        np.maximum(lower, solved[1]),
        np.where(cheaper, solved[2], error),
    )


def _added(
    problem: Problem,
    unpaired: Floats,
    found: Floats,
    stretches: _WindowStretches,
    spans: tuple[Ints, Ints],
) -> Windows:
    """Sums of the stretches of each window, and of the objects in it that are near to none."""
    (first, last), parts, least, error = spans, found[:4], found[4], found[5]

    def total(value: Floats) -> Floats:
        return sum_by(stretches.of_window, value[stretches.stretch], len(first))

    def between(value: Floats) -> Floats:
        """Sums of the values >= 0 of the steps of each window, nothing taken away again."""
        if not len(first):
            return np.zeros(0)
        edges = np.stack((first, last + 1), axis=1).ravel()
        sums: Floats = np.add.reduceat(np.append(value, 0.0), edges)[::2]
        return sums

    alone = np.array([between(side) for side in unpaired])
    shown = np.array([total(part) for part in parts])
    shown[1:3] += alone
    counts = np.array(
        [
            between(np.bincount(step, minlength=problem.steps).astype(float))
            for step in (problem.truth_step, problem.estimate_step)
        ]
    )
    terms = 8 + np.bincount(stretches.of_window, minlength=len(first))
    if not (whole_prices(problem) and alone.max(initial=0.0) < 2.0**31):
        terms = terms + counts.sum(axis=0) + (last - first)
    few = terms * ROUNDOFF
    upper = (total(parts.sum(axis=0) + error) + alone.sum(axis=0)) * (1 + few)
    upper /= 1 - problem.cost_error
    lower = (total(least) + alone.sum(axis=0)) * (1 - few)
    most = min(len(problem.truth_step), len(problem.estimate_step))
    lower -= problem.cost_slack * counts.min(axis=0) * (1 + 8 * ROUNDOFF) / max(most, 1)
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
