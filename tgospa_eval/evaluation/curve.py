"""The normalised curve: proven costs of the steps 1..k for each k (docs/theory/solvers.md).

A solution of the whole brackets every beginning. The beginnings of components whose bracket stays
open are solved again, from as few steps before their end as will do, many side by side in one
problem that starts from the solution of the whole.
"""

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.progress import Limit, Progress
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.evaluation.ending_bounds import (
    Continued,
    Proven,
    Whole,
    unpaired_by_step,
    whole_blocks,
)
from tgospa_eval.evaluation.endings import Endings
from tgospa_eval.problem.certificate import ROUNDOFF, fair_prices
from tgospa_eval.problem.prefixes import Cells, PrefixBounds, bound_prefixes, whole_prices
from tgospa_eval.problem.problem import Floats, Ints, sum_by
from tgospa_eval.problem.solution import Curve, Reduced
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
) -> Curve:
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
    found = bound_prefixes(states, weights, prices)
    cells, parts = found.cells, found.parts.copy()
    least, error = found.lower.copy(), found.error.copy()
    unpaired_costs = np.cumsum(unpaired_by_step(states), axis=1)
    ends = cells.first[1:] - 1
    least[ends] = np.maximum(least[ends], whole_blocks(states, prices, reduced))

    bracket = _Brackets(cells=cells, parts=parts, least=least, error=error, gap=solver.gap)
    bracket.open[ends] = False  # a whole block: the solver has had its chance
    if bracket.open.any():
        endings, saved = Endings(states, weights), save_solution(states, weights, prices)
        from_begin = states.transposed.copy()
        for part in reduced:
            from_begin |= part.blocks
        _narrow(bracket, (endings, found, saved), from_begin, solver, progress)

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
    return Curve(
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
    def wide(self) -> NDArray[np.bool_]:
        """Which brackets are wider than the gap."""
        wide: NDArray[np.bool_] = self.cost + self.error - self.least > self.gap * self.cost
        return wide

    def take(self, found: Proven) -> None:
        """Take what is better."""
        np.maximum.at(self.least, found.cell, found.lower)
        cost = found.parts.sum(axis=0)
        order = np.lexsort((cost, found.cell))
        order = order[np.flatnonzero(np.diff(found.cell[order], prepend=-1))]
        order = order[cost[order] < self.cost[found.cell[order]]]
        wins = found.cell[order]
        self.parts[:, wins], self.error[wins] = found.parts[:, order], found.error[order]
        self.cost[wins] = cost[order]


def _narrow(
    brackets: _Brackets,
    whole: tuple[Endings, PrefixBounds, SavedSolution],
    from_begin: NDArray[np.bool_],
    solver: Certified,
    progress: Progress,
) -> None:
    """Solve endings of what is open, the few last steps first, then twice as many, and so on.

    Blocks that are marked in `from_begin` (B,) are solved from their first step on at once.
    """
    limit = Limit(
        deadline=None if solver.time_limit is None else time.monotonic() + solver.time_limit,
        progress=progress,
    )
    cells, span, most = brackets.cells, SPAN, np.count_nonzero(brackets.open)
    while brackets.open.any():
        cell = np.flatnonzero(brackets.open)
        block, end = cells.block[cell], cells.step[cell]
        first = cells.begin[block]
        begin = np.maximum(end + 1 - span, first)
        begin = np.where((begin - first < span // 2) | from_begin[block], first, begin)
        for kind, chosen in ((Continued, begin > first), (Whole, begin == first)):
            at = np.flatnonzero(chosen)
            at = at[np.argsort(begin[at], kind="stable")]
            group_of = kind(*whole)
            for group in whole[0].groups(block[at], begin[at], end[at]):
                if limit.late():
                    return
                progress.again("the curve", 1 - np.count_nonzero(brackets.open) / most)
                own, stopwatch = at[group], Stopwatch()
                own = own[brackets.open[cell[own]]]  # others may have shown it
                if not len(own):
                    continue
                stopwatch.progress = progress.silent()
                left = limit.left()
                timed = replace(solver, time_limit=None if left is None else max(left, 1e-9))
                brackets.take(group_of.solve(block[own], begin[own], end[own], timed, stopwatch))
                brackets.open &= brackets.wide
            if kind is Whole:
                brackets.open[cell[at]] = False
        span *= 2
