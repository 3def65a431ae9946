"""Solution of blocks at a smaller cutoff, if the cutoff is far above the errors.

Solvers work to absolute tolerances in units of c^p, where c is the cutoff of the problem. These are
too coarse for costs far below c^p. A smaller cutoff that *fits* the costs makes them fine enough,
and far fewer pairs are near. The *scale* of a smaller cutoff is its p-th power, as a fraction of
c^p.

Prices at the smaller cutoff also prove a bound of the whole problem. `problem.certificate` computes
this bound. The assignment is evaluated at the cutoff c. Other words and letters: `solvers`.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats, Mask, places_of
from tgospa_eval.common.progress import Limit, Status
from tgospa_eval.problem.certificate import home_blocks, lower_bounds, of_whole, reduce_cutoff
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.solution import Reduced, Solution
from tgospa_eval.problem.states import States, repair
from tgospa_eval.solvers.block_costs import block_costs
from tgospa_eval.solvers.warm_start import make_warm_start, save_solution

FAR_CUTOFF = 2.0**-8
"""Largest scale of a block for which smaller cutoffs are tried before the cutoff c."""

NEAR_CUTOFF = 2.0**-2
"""Largest scale of any attempt. Blocks that need a larger scale are solved at the cutoff c."""

DOUBTFUL, PROOF_ROUNDING = 2.0**-20, 1e-12
"""Below the scale DOUBTFUL, the precision of a solver is too low to show if a block is solved. For
such a block the certificate decides. Its relative rounding error is less than PROOF_ROUNDING."""

CUTOFF_ROOM = 16.0
"""Ratio of the p-th power of a fitting cutoff to the largest cost that cannot be avoided."""

STEP, LEAP = 2.0**6, 2.0**1000
"""Factors by which a scale grows if it is too small. An attempt at a smaller cutoff calls
`solve_at_fitting_cutoffs` again, and this inner call can try still smaller cutoffs. In the first
attempt of a block, the inner call uses STEP. In later attempts the smaller cutoffs were tried
before. So the inner call uses LEAP, which leads directly to the cutoff of the attempt."""


Base = Callable[[States, Mask, Mask], Solution]
"""Callable that solves blocks of a problem at the cutoff of the problem.

Its arguments are the problem and two masks (B,): blocks to solve, and other blocks to solve only if
that is quick. `Solution.missing` marks the blocks that were not solved."""


def solve_at_fitting_cutoffs(
    states: States, base: Base, *, gap: float, limit: Limit, step: float = STEP
) -> Solution:
    """Solve each block at the cutoff c, or at a smaller cutoff if c is far above the costs.

    Parameters
    ----------
    states : States
        The problem.
    base : Base
        Callable that solves at the cutoff of the problem.
    gap : float
        Relative gap that counts as exact.
    limit : Limit
        Time limit and request to stop.
    step : float
        Factor by which a scale grows if it is too small.
    """
    scale = fitting_scales(states)
    far = scale < 1
    solution = base(states, ~far, far)
    missing = solution.missing
    doubtful = (scale < DOUBTFUL) & ~missing
    if doubtful.any():
        cost = block_costs(states, solution.weights)
        width = cost - lower_bounds(states, solution.prices)
        missing = missing | (doubtful & (width > max(gap, PROOF_ROUNDING) * cost))
        solution = replace(solution, missing=missing)
    if not missing.any() or states.problem.pair_price is None:
        return solution
    scale = np.where(scale < 1, scale, _scales_of_costs(states, solution.weights))
    if not (missing & (scale < 1)).any():
        return solution
    ladder = _Ladder(states, solution, base, gap, limit, step)
    ladder.climb(np.where(missing, scale, 1.0))
    return ladder.solution()


def fitting_scales(states: States) -> Floats:
    """Return the scale of a fitting cutoff for each block, (B,): a power of 2, or 1 for c itself.

    Take the cheapest near pair of each true object and of each track at each step. The scale is
    `CUTOFF_ROOM` times the largest of their costs, rounded up (docs/theory/solvers.md, "Cutoffs
    that fit").
    """
    problem = states.problem
    blocks = len(states.block_begin)
    if problem.pair_price is None or not len(problem.cost):
        return np.ones(blocks)
    # The costs of true objects alone often show that c is not far above the costs.
    costs = _largest_cheapest_costs(states)
    if (CUTOFF_ROOM * costs > FAR_CUTOFF).all():
        return np.ones(blocks)
    for side, blocks_of in zip(problem.sides, states.track_blocks, strict=True):
        small = np.full(len(side.track), np.inf)
        np.minimum.at(small, side.row, problem.cost)
        near = np.flatnonzero(small < np.inf)
        np.maximum.at(costs, blocks_of[side.track[near]], small[near])
    # If all objects have a pair that costs 0, use the least positive cost of a pair, or the largest
    # switch price if that is less.
    small = np.full(blocks, np.max(problem.switch_price, initial=0.0))
    small[small == 0] = np.inf
    first = states.block_first
    for block in np.flatnonzero(costs == 0).tolist():
        entry = states.entry[first[block] : first[block + 1]]
        cost = problem.cost[entry[entry >= 0]]
        small[block] = min(small[block], cost.min(where=cost > 0, initial=np.inf))
    return _powers(np.where(costs > 0, costs, np.where(small < np.inf, small, 0.0)), FAR_CUTOFF)


def _largest_cheapest_costs(states: States) -> Floats:
    """Return the largest cost, by block, of the cheapest pair of a true object at a step, (B,)."""
    problem, blocks_of = states.problem, states.track_blocks[0]
    row, track = problem.truth_row, problem.truth_track
    largest = np.zeros(len(states.block_begin))
    first = np.concatenate(([0], places_of(row[1:] != row[:-1]) + 1))  # sorted by row
    np.maximum.at(largest, blocks_of[track[row[first]]], np.minimum.reduceat(problem.cost, first))
    return largest


def _scales_of_costs(states: States, weights: Floats) -> Floats:
    """Return the scale of each block from the largest cost of an assigned pair in it."""
    problem = states.problem
    used = np.flatnonzero((states.entry >= 0) & (weights > 0.01))
    largest = np.zeros(len(states.block_begin))
    block = states.pair_block[states.pairs_of(used)]
    np.maximum.at(largest, block, problem.cost[states.entry[used]])
    return _powers(largest, NEAR_CUTOFF)


def _powers(costs: Floats, largest: float) -> Floats:
    """Return the next power of 2 above CUTOFF_ROOM times each cost.

    The result is 1 if this power is above `largest`, or if the cost is 0.
    """
    scale = np.ldexp(1.0, np.frexp(CUTOFF_ROOM * np.minimum(costs, 1.0))[1])
    return np.where((costs > 0) & (scale <= largest), scale, 1.0)


class _Ladder:
    """Attempts at growing cutoffs until one fits, and the best solution so far."""

    def __init__(
        self, states: States, first: Solution, base: Base, gap: float, limit: Limit, step: float
    ) -> None:
        self.states, self.first, self.base = states, first, base
        self.gap, self.limit, self.step = gap, limit, step
        self.weights, self.prices = first.weights, first.prices
        self.missing, self.iterations = first.missing.copy(), first.iterations
        self.cost = block_costs(states, self.weights)
        self.lower = np.full(len(self.cost), -np.inf)
        self.parts: list[Reduced] = []

    def climb(self, scale: Floats) -> None:
        """Solve the blocks with a scale below 1, first at this scale, then at larger scales."""
        pending, first = scale < 1, np.ones(len(scale), bool)
        while pending.any() and not self.limit.late():
            size = float(scale[pending].min())
            chosen = pending & (scale == size)
            again = bool((chosen & ~first).any())
            pending &= ~(chosen & self._attempt(chosen, size, LEAP if again else self.step))
            first &= ~chosen
            scale[chosen] *= self.step
            last = pending & (scale > NEAR_CUTOFF)
            if last.any():
                self._solve_directly(last)
                pending &= ~last

    def solution(self) -> Solution:
        """Return the solution of all blocks."""
        count = int(self.missing.sum())
        late = self.limit.status if self.limit.late() else Status.NOT_SOLVED
        return replace(
            self.first,
            weights=self.weights,
            prices=self.prices,
            status=late if count else Status.SOLVED,
            detail="",
            unsolved=(count, len(self.missing)) if count else None,
            iterations=self.iterations,
            finished=not count,
            missing=self.missing,
            history=(),
            reduced=tuple(part for part in self.parts if part.blocks.any()),
        )

    def _attempt(self, chosen: Mask, scale: float, step: float) -> Mask:
        """Solve blocks at a smaller cutoff; return a mask of those that need no larger cutoff."""
        states = self.states
        reduced = reduce_cutoff(states, chosen, scale)
        solution = solve_at_fitting_cutoffs(
            reduced, self.base, gap=self.gap, limit=self.limit, step=step
        )
        self.iterations += solution.iterations
        whole = repair(reduced, solution.weights)
        warm_start = make_warm_start(
            states, (save_solution(reduced, whole, scale * solution.prices),), (1.0,)
        )
        part = Reduced(states=reduced, blocks=chosen, scale=scale, solution=solution)

        blocks, home = len(chosen), home_blocks(states, reduced)
        rest = of_whole(states, part, np.zeros(len(home)))
        inner = lower_bounds(reduced, solution.prices, solution.reduced)
        lower = rest + scale * sum_by(home, inner, blocks)
        own = rest + scale * sum_by(home, block_costs(reduced, solution.weights), blocks)
        self._take(chosen, warm_start.weights[0], warm_start.prices)
        self._prove(chosen & (lower > self.lower), lower, part)
        width = self.cost - self.lower
        met = width <= self.gap * self.cost
        missing = sum_by(home, solution.missing.astype(np.float64), blocks) > 0
        self.missing[chosen] = missing[chosen]
        # If the gap at the smaller cutoff is most of the width, a larger cutoff does not help.
        fits: Mask = met | (own - lower > 0.5 * width)
        return fits

    def _solve_directly(self, chosen: Mask) -> None:
        """Solve blocks at the cutoff c."""
        whole = self.base(self.states, chosen, np.zeros_like(chosen))
        self.iterations += whole.iterations
        prices = np.where(self.states.slots_of(chosen), whole.prices, 0.0)
        lower = lower_bounds(self.states, prices)
        wins = chosen & (lower > self.lower)
        self._take(chosen, whole.weights, np.where(self.states.slots_of(wins), prices, self.prices))
        self._prove(wins, lower, None)
        self.missing[chosen] = whole.missing[chosen]

    def _take(self, chosen: Mask, weights: Floats, prices: Floats) -> None:
        """Keep the prices in all chosen blocks, and the weights in those where they cost less."""
        states = self.states
        mixed = np.where(states.states_of(chosen), weights, self.weights)
        cost = block_costs(states, mixed)
        wins = chosen & (cost < self.cost)
        self.weights = np.where(states.states_of(wins), weights, self.weights)
        self.cost = np.where(wins, cost, self.cost)
        self.prices = np.where(self.states.slots_of(chosen), prices, self.prices)

    def _prove(self, wins: Mask, lower: Floats, part: Reduced | None) -> None:
        """Use `part` as the proof of some blocks, or the prices at the cutoff c if it is None.

        `wins` (B,) marks these blocks, and `lower` (B,) are their lower bounds.
        """
        self.lower = np.where(wins, lower, self.lower)
        self.parts = [replace(other, blocks=other.blocks & ~wins) for other in self.parts]
        if part is not None:
            self.parts.append(replace(part, blocks=wins))
