"""Sliding windows: proven costs of stretches of steps, each by itself (docs/theory/solvers.md).

A component of which all steps are in a window costs there what it costs in the whole. Of the others
the stretch in the window is a problem of its own: the assignment and the prices of the whole
bracket it; what stays open is solved, from there, many stretches side by side.
"""

import time
from dataclasses import replace

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Limit, Progress
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.evaluation.ending_bounds import Alone, unpaired_by_step, whole_blocks
from tgospa_eval.evaluation.endings import Endings
from tgospa_eval.problem.certificate import ROUNDOFF, fair_prices
from tgospa_eval.problem.prefixes import Cells, costs_so_far, whole_prices
from tgospa_eval.problem.problem import Floats, Ints, Problem, sum_by
from tgospa_eval.problem.solution import Reduced, Windows
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import changes
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import save_solution


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
    stretches = _Stretches.of(states, first, last)
    found = _WindowBrackets(len(stretches.block))
    complete = stretches.complete(states)
    block = stretches.block[complete]
    found.put(complete, *_of_blocks(states, weights, prices, reduced, block))
    rest = np.setdiff1d(np.arange(len(stretches.block)), complete)
    if len(rest):
        endings, saved = Endings(states, weights), save_solution(states, weights, prices)
        limit = Limit(
            deadline=None if solver.time_limit is None else time.monotonic() + solver.time_limit,
            progress=progress or Progress(),
        )
        done = 0
        for group in endings.groups(*stretches.some(rest)):
            limit.progress.again("the windows", done / len(rest))
            own = rest[group]
            found.put(own, *_solved(Alone(endings, saved, *stretches.some(own)), solver, limit))
            done += len(own)
    return _added(problem, unpaired_by_step(states), found, stretches, spans)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stretches:
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
    def of(cls, states: States, first: Ints, last: Ints) -> "_Stretches":
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


class _WindowBrackets:
    """Of every stretch costs by kind, a lower bound, and how much the costs may be too small."""

    def __init__(self, size: int) -> None:
        self.parts, self.lower, self.error = np.zeros((4, size)), np.zeros(size), np.zeros(size)

    def put(self, at: Ints, parts: Floats, lower: Floats, error: Floats) -> None:
        self.parts[:, at], self.lower[at], self.error[at] = parts, lower, error


def _of_blocks(
    states: States, weights: Ints, prices: Floats, reduced: tuple[Reduced, ...], block: Ints
) -> tuple[Floats, Floats, Floats]:
    """Costs by kind, lower bound and error of whole blocks."""
    if not len(block):
        return np.zeros((4, 0)), np.zeros(0), np.zeros(0)
    length = states.block_end - states.block_begin + 1
    cells = Cells(
        first=np.concatenate(([0], np.cumsum(length))).astype(np.int64),
        begin=states.block_begin.astype(np.int64),
    )
    ends = cells.first[1:][block] - 1
    parts = costs_so_far(states, cells, weights, changes(states, weights))[:, ends]
    busiest = int(np.bincount(states.begin, minlength=1).max())
    error = parts.sum(axis=0) * (16 + 2 * busiest + length[block]) * ROUNDOFF
    return parts, whole_blocks(states, prices, reduced)[block], error


def _solved(alone: Alone, solver: Certified, limit: Limit) -> tuple[Floats, Floats, Floats]:
    """Costs by kind, lower bound and error, as narrow as asked if time allows."""
    held = alone.held()
    parts, lower, error = held
    cost = parts.sum(axis=0)
    if limit.late() or not (cost + error - lower > solver.gap * cost).any():
        return held
    stopwatch, left = Stopwatch(), limit.left()
    stopwatch.progress = limit.progress.silent()
    timed = replace(solver, time_limit=None if left is None else max(left, 1e-9))
    solved = alone.solve(timed, stopwatch)
    cheaper = solved[0].sum(axis=0) < cost
    return (
        np.where(cheaper, solved[0], parts),
        np.maximum(lower, solved[1]),
        np.where(cheaper, solved[2], error),
    )


def _added(
    problem: Problem,
    unpaired: Floats,
    found: _WindowBrackets,
    stretches: _Stretches,
    spans: tuple[Ints, Ints],
) -> Windows:
    """Sums of the stretches of each window, and of the objects in it that are near to none."""
    first, last = spans

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
    shown = np.array([total(part) for part in found.parts])
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
    upper = (total(found.parts.sum(axis=0) + found.error) + alone.sum(axis=0)) * (1 + few)
    upper /= 1 - problem.cost_error
    lower = (total(found.lower) + alone.sum(axis=0)) * (1 - few)
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
