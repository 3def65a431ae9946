"""Proof: bounds of the optimum from whatever a solver left, and the split of the cost.

Plain NumPy over the whole reduced problem; knows no solver, and no solver grades its own work.
Weights become integers (multiples of 2^-50) first, so that feasibility is checked, not estimated.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from tgospa_eval.problem import Floats, Ints, Problem, sum_by
from tgospa_eval.states import Slots, States

ONE = 1 << 50
"""The integer that stands for the weight 1."""

SNAP = ONE * 1e-9
"""Weights this near to 0 or 1 are meant to be 0 or 1."""

ROUNDING = 4 * 2.0**-53
"""Rounding allowance of a bracket, as a fraction of the sum of all unassigned prices."""


@dataclass(frozen=True, kw_only=True)
class Solution:
    """What a solver proposes; nothing in it is trusted.

    Parameters
    ----------
    weights : (S,) float array
        Assignment of each state, between 0 and 1.
    prices : (K,) float array
        Price of each column slot.
    status : str
        One sentence for the user.
    iterations : int
        Sweeps or simplex iterations.
    finished : bool
        False if a limit or a failure stopped the solver early.
    history : tuple of dict
        Convergence, one record per check.
    """

    weights: Floats
    prices: Floats
    status: str
    iterations: int = 0
    finished: bool = True
    history: tuple[dict[str, float], ...] = field(default=())


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Proven: ``lower <= optimum <= upper``, in units of c^p.

    Parameters
    ----------
    lower, upper : float
        The bracket; `upper` is the cost of a feasible assignment.
    allowance : float
        A bracket narrower than this is met: it is rounding.
    """

    lower: float
    upper: float
    allowance: float

    @property
    def relative_gap(self) -> float:
        """(upper - lower) / upper, 0 if upper is 0."""
        return (self.upper - self.lower) / self.upper if self.upper > 0 else 0.0

    def met(self, gap: float) -> bool:
        """Whether the bracket is as narrow as `gap`, relative, or as rounding allows."""
        return self.upper - self.lower <= max(gap * self.upper, self.allowance)


@dataclass(frozen=True, kw_only=True)
class Breakdown:
    """Where the cost of a feasible assignment comes from, in units of c^p.

    Parameters
    ----------
    localisation, missed, false, switch : (T,) float arrays
        Cost at each step; a switch between two steps is booked at the later one.
    missed_count, false_count, switch_count : (T,) float arrays
        Unassigned existing objects, and half the total variation of the assignment.
    """

    localisation: Floats
    missed: Floats
    false: Floats
    switch: Floats
    missed_count: Floats
    false_count: Floats
    switch_count: Floats

    @property
    def total(self) -> float:
        """The whole cost."""
        return float((self.localisation + self.missed + self.false + self.switch).sum())


def certify(states: States, solution: Solution) -> tuple[Bounds, Ints, Breakdown]:
    """Prove bounds from a proposed assignment and proposed prices.

    The upper bound U is the cost of the repaired assignment, summed in cost form. The lower bound
    is L = max(0, U - sum_i (best_i - own_i) - sum_s v_s (1 - load_s)): the Lagrangian bound of any
    prices v >= 0, in a form that does not cancel (docs/theory, "Certificate").

    Returns
    -------
    Bounds
        In units of c^p.
    weights : (S,) int array
        The feasible assignment, in units of 1/ONE.
    Breakdown
        Its cost by step; sums to the upper bound.
    """
    weights = repair(states, solution.weights)
    breakdown = break_down(states, weights)
    prices = np.maximum(np.nan_to_num(solution.prices, nan=0.0, posinf=0.0, neginf=0.0), 0.0)
    value, offsets = relative_values(states, prices)

    row = states.pair_row[states.pair]
    own = sum_by(row, weights / ONE * value, states.nodes)
    uncovered = (ONE - _coverage(states, weights, offsets)) / ONE
    own -= sum_by(offsets.row, uncovered * offsets.amount, states.nodes)
    changed, amount = changes(states, weights)
    paid = states.problem.crossing_price[states.begin[changed]] * amount
    own -= sum_by(row[changed], paid, states.nodes)
    regret = np.maximum(best_values(states, value, offsets) - own, 0.0)
    idle = (ONE - states.columns.sums(weights)) / ONE

    upper = breakdown.total
    problem = states.problem
    lower = min(max(upper - regret.sum() - (prices * idle).sum(), 0.0), upper)
    allowance = ROUNDING * float(problem.truth_price.sum() + problem.estimate_price.sum())
    return Bounds(lower=float(lower), upper=upper, allowance=allowance), weights, breakdown


def repair(states: States, weights: Floats) -> Ints:
    """A feasible assignment nearby: clipped, snapped to 0 and 1, scaled where too full."""
    fixed = np.clip(np.nan_to_num(weights, nan=0.0), 0.0, 1.0) * ONE
    fixed[fixed < SNAP] = 0
    fixed[fixed > ONE - SNAP] = ONE
    whole: Ints = fixed.astype(np.int64)
    for slots in (states.rows, states.columns):
        whole = _fit(slots, whole)
    return whole


def _fit(slots: Slots, weights: Ints) -> Ints:
    """Scale the states of every slot whose sum exceeds ONE by that sum."""
    sums = slots.sums(weights)
    if not len(sums) or sums.max() <= ONE:
        return weights
    used = np.flatnonzero((weights > 0) & (slots.end > slots.begin))
    used = used[np.argsort(slots.begin[used], kind="stable")]
    bounds = np.stack((slots.begin[used], slots.end[used]), axis=1).ravel()
    fullest = np.maximum.reduceat(np.append(sums, 0), bounds)[::2]
    over = fullest > ONE
    # Rounded down by more than the product can be rounded up.
    factor = ONE / fullest[over] * (1 - 2.0**-48)
    fitted = weights.copy()
    fitted[used[over]] = np.floor(weights[used[over]] * factor)
    return fitted


@dataclass(frozen=True, kw_only=True)
class Offsets:
    """What is taken from every path of a row at a step, sorted by (step, row).

    Parameters
    ----------
    row, step : (N,) int arrays
        Rows and steps with a gain; each once.
    amount : (N,) float array
        The gain of the cheapest pair there.
    state : (N,) int array
        The state that has it.
    """

    row: Ints
    step: Ints
    amount: Floats
    state: Ints


def relative_values(states: States, prices: Floats) -> tuple[Floats, Offsets]:
    """Value of each state less what the cheapest pairs of its row would gain on its steps.

    Gains near 1 differ in their last digits, which sums over many steps lose; their differences are
    differences of costs, and exact. Every path of a row is lowered by the same sum.
    """
    problem = states.problem
    gains = np.flatnonzero(states.entry >= 0)
    entry, step = states.entry[gains], states.begin[gains].astype(np.int64)
    row = states.pair_row[states.pair[gains]]
    cost = problem.cost[entry]
    key = step * max(states.nodes, 1) + row
    order = np.lexsort((cost, key))
    first = np.ones(len(order), bool)
    first[1:] = np.diff(key[order]) != 0
    best = order[first]
    of_best = np.empty_like(order)
    of_best[order] = best[np.cumsum(first) - 1]
    base = (
        problem.truth_price[problem.truth_row[entry]]
        + problem.estimate_price[problem.estimate_row[entry]]
    )
    offsets = Offsets(
        row=row[best], step=step[best], amount=problem.gain[entry[best]], state=gains[best]
    )

    value = -states.columns.totals(prices)
    value[gains] += (base - base[of_best]) - (cost - cost[of_best])
    runs = np.flatnonzero(states.entry < 0)
    by_row = np.lexsort((offsets.step, offsets.row))
    place = offsets.row[by_row] * problem.steps + offsets.step[by_row]
    total = np.concatenate(([0.0], np.cumsum(offsets.amount[by_row])))
    start = states.pair_row[states.pair[runs]].astype(np.int64) * problem.steps
    low = np.searchsorted(place, start + states.begin[runs])
    high = np.searchsorted(place, start + states.end[runs], side="right")
    value[runs] -= total[high] - total[low]
    return value, offsets


def _coverage(states: States, weights: Ints, offsets: Offsets) -> Ints:
    """Sum of the weights of a row at each of the offsets; exact."""
    slot = states.rows.begin[offsets.state]
    shared = states.rows.end[offsets.state] > slot
    covered: Ints = weights[offsets.state].copy()
    covered[shared] = states.rows.sums(weights)[slot[shared]]
    return covered


def best_values(states: States, value: Floats, offsets: Offsets | None = None) -> Floats:
    """Value of the best path of each row, (nodes,): Viterbi over the states (docs/theory).

    hub = best value at "none"; a state is entered from the one before it or from the hub, and left
    into the hub, each for the price of half a switch. At "none" a path loses the offsets.
    """
    lost: dict[int, slice] = {}
    if offsets is not None and len(offsets.step):
        steps, lows = np.unique(offsets.step, return_index=True)
        highs = np.append(lows[1:], len(offsets.step))
        lost = {
            k: slice(low, high)
            for k, low, high in zip(steps.tolist(), lows.tolist(), highs.tolist(), strict=True)
        }
    price = states.problem.crossing_price
    hub = np.zeros(states.nodes)
    current = np.zeros(len(states.pair_row))
    row = states.pair_row
    for step, opening, closing, groups in events(states):
        pair = states.pair[opening]
        current[pair] = np.maximum(current[pair], hub[row[pair]] - price[step]) + value[opening]
        if offsets is not None and step in lost:
            hub[offsets.row[lost[step]]] -= offsets.amount[lost[step]]
        if len(closing):
            pair = states.pair[closing]
            top = np.maximum.reduceat(current[pair], groups) - price[step + 1]
            at = row[pair[groups]]
            hub[at] = np.maximum(hub[at], top)
    best = hub
    np.maximum.at(best, row, current)
    return best


def events(states: States) -> Iterator[tuple[int, Ints, Ints, Ints]]:
    """Steps at which states begin or end, in order: step, beginning, ending, row groups of those.

    States that end are sorted by row; `groups` are the starts of the rows among them.
    """
    order_begin = np.argsort(states.begin, kind="stable")
    order_end = np.lexsort((states.pair, states.end))  # pairs are sorted by row
    steps = np.union1d(states.begin, states.end)
    begins = np.searchsorted(states.begin[order_begin], np.stack((steps, steps + 1)))
    ends = np.searchsorted(states.end[order_end], np.stack((steps, steps + 1)))
    row = states.pair_row[states.pair[order_end]]
    fresh = np.ones(len(row) + 1, bool)
    fresh[1:-1] = (row[1:] != row[:-1]) | np.diff(states.end[order_end]).astype(bool)
    starts = np.flatnonzero(fresh)
    first = np.searchsorted(starts, ends)
    for k, step in enumerate(steps.tolist()):
        low, high = ends[0, k], ends[1, k]
        yield (
            step,
            order_begin[begins[0, k] : begins[1, k]],
            order_end[low:high],
            starts[first[0, k] : first[1, k]] - low,
        )


def changes(states: States, weights: Ints) -> tuple[Ints, Floats]:
    """States whose weight differs from that of the state before, and by how much, as a fraction."""
    follows = states.pair[1:] == states.pair[:-1]
    change = np.where(follows, np.diff(weights), 0)
    moved = np.flatnonzero(change)
    return moved + 1, np.abs(change[moved]) / ONE


def break_down(states: States, weights: Ints) -> Breakdown:
    """Split the cost of a feasible assignment by step and kind; sums are exact in the weights."""
    problem: Problem = states.problem
    used = np.flatnonzero((states.entry >= 0) & (weights > 0))
    entry = states.entry[used]
    steps = problem.steps

    def by_step(step: Ints, amount: Floats) -> Floats:
        return sum_by(step, amount, steps)

    def unassigned(step: Ints, price: Floats, row: Ints) -> tuple[Floats, Floats]:
        free = np.full(len(step), ONE)
        np.subtract.at(free, row, weights[used])
        return by_step(step, free / ONE * price), by_step(step, free / ONE)

    missed, missed_count = unassigned(
        problem.truth_step, problem.truth_price, problem.truth_row[entry]
    )
    false, false_count = unassigned(
        problem.estimate_step, problem.estimate_price, problem.estimate_row[entry]
    )
    changed, amount = changes(states, weights)
    variation = by_step(states.begin[changed], amount)
    return Breakdown(
        localisation=by_step(states.begin[used], weights[used] / ONE * problem.cost[entry]),
        missed=missed,
        false=false,
        switch=variation * problem.crossing_price[:-1],
        missed_count=missed_count,
        false_count=false_count,
        switch_count=0.5 * variation,
    )
