"""Proof: bounds of the optimum from whatever a solver left, and the split of the cost.

Plain NumPy over the whole reduced problem; knows no solver, and no solver grades its own work.
Weights become integers (multiples of 2^-50) first, so that feasibility is checked, not estimated.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from tgospa_eval.problem import Floats, Ints, sum_by
from tgospa_eval.states import PART, Slots, States, changed, divided, parts

ONE = 1 << 50
"""The integer that stands for the weight 1."""

SNAP = ONE * 1e-9
"""Weights this near to 0 or 1 are meant to be 0 or 1."""

ROUNDING = 4 * 2.0**-53
"""Rounding allowance of a bracket, as a fraction of the sum of all unassigned prices."""


@dataclass(kw_only=True)
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
    disposable : bool
        Whether nobody needs the arrays any more, so that the proof may write over them; it takes
        them away then.
    """

    weights: Floats
    prices: Floats
    status: str
    iterations: int = 0
    finished: bool = True
    history: tuple[dict[str, float], ...] = field(default=())
    disposable: bool = False

    def give_up(self) -> tuple[Floats, Floats]:
        """Weights and prices, which the solution holds no longer: they are large."""
        weights, prices = self.weights, self.prices
        self.weights = self.prices = np.zeros(0)
        return weights, prices


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

    Parameters
    ----------
    states : States
        What was solved.
    solution : Solution
        What is proposed.

    Returns
    -------
    Bounds
        In units of c^p.
    weights : (S,) int array
        The feasible assignment, in units of 1/ONE.
    Breakdown
        Its cost by step; sums to the upper bound.
    """
    given, prices = (
        solution.give_up()
        if solution.disposable
        else (solution.weights.copy(), solution.prices.copy())
    )
    given = np.require(given, np.float64, ["C", "W"])
    prices = np.require(prices, np.float64, ["C", "W"])
    weights = given.view(np.int64)
    regret = np.zeros(states.nodes)
    for low, high in states.cuts(PART):
        part, state, slot = states.between(low, high)
        node = slice(*np.searchsorted(states.node_block, (low, high)))
        _whole(given[state], weights[state])
        regret[node] = _regrets(part, weights[state], prices[slot])
    idle = prices.sum()
    del prices
    breakdown = break_down(states, weights)

    upper = breakdown.total
    problem = states.problem
    lower = min(max(upper - regret.sum() - idle, 0.0), upper)
    allowance = ROUNDING * float(problem.truth_price.sum() + problem.estimate_price.sum())
    return Bounds(lower=float(lower), upper=upper, allowance=allowance), weights, breakdown


def _regrets(states: States, weights: Ints, prices: Floats) -> Floats:
    """Make the weights feasible and the prices fair, in place; what each row loses by then.

    The prices become what is lost by leaving their slots idle.
    """
    loads = _feasible(states, weights)
    np.fmax(prices, 0.0, out=prices)  # NaN becomes 0
    prices[prices > 1e100] = 0.0
    running = states.columns.running(prices)
    for part in parts(len(prices)):
        prices[part] *= (ONE - loads[part]) / ONE
    del loads
    regret = np.zeros(states.nodes)
    for rows, own in row_parts(states):
        value = rows.columns.spans(running)
        np.negative(value, out=value)
        regret += regrets(rows, value, weights[own])
    return regret


def repair(states: States, weights: Floats) -> Ints:
    """A feasible assignment nearby: clipped, snapped to 0 and 1, scaled where too full."""
    return repaired(states, weights)[0]


def repaired(states: States, weights: Floats) -> tuple[Ints, Ints]:
    """What `repair` gives, and its sums over the column slots."""
    whole = np.empty(len(weights), np.int64)
    _whole(weights, whole)
    return whole, _feasible(states, whole)


def _whole(weights: Floats, whole: Ints) -> None:
    """The weights in units of 1/ONE, clipped and snapped; both may be the same memory."""
    for part in parts(len(weights)):
        used = np.flatnonzero(weights[part] != 0)
        fixed = np.fmin(np.fmax(weights[part][used], 0.0), 1.0)  # NaN becomes 0
        fixed *= ONE
        fixed[fixed < SNAP] = 0
        fixed[fixed > ONE - SNAP] = ONE
        whole[part] = 0
        whole[part][used] = fixed


def _feasible(states: States, weights: Ints) -> Ints:
    """Scale the weights where a slot is too full, in place; their sums over the column slots."""
    for part, own in row_parts(states):
        _fit(part.rows, weights[own])
    return _fit(states.columns, weights)


def _fit(slots: Slots, weights: Ints) -> Ints:
    """Scale the states of every slot whose sum exceeds ONE by that sum, in place; the new sums."""
    sums = slots.sums(weights)
    if sums.max(initial=0) <= ONE:
        return sums
    full = np.zeros(len(sums) + 1, np.int32)  # how many slots before each are too full
    np.cumsum(sums > ONE, out=full[1:])
    sums = np.append(sums, 0)
    ends = slots.end
    for part in parts(len(weights)):
        own, begin, end = weights[part], slots.begin[part], ends[part]
        over = np.flatnonzero((full[end] > full[begin]) & (own > 0))
        over = over[np.argsort(begin[over], kind="stable")]
        bounds = np.stack((begin[over], end[over]), axis=1).ravel()
        fullest = np.maximum.reduceat(sums, bounds)[::2]
        # Rounded down by more than the product can be rounded up.
        factor = ONE / fullest * (1 - 2.0**-48)
        own[over] = np.floor(own[over] * factor)
    return slots.sums(weights)


def row_parts(states: States) -> Iterator[tuple[States, slice]]:
    """The states in parts of whole rows, about PART states each, and where they are.

    Rows do not depend on each other once prices are given. Nodes and column slots keep their
    numbers.
    """
    if 0 < len(states.begin) <= PART:
        yield states, slice(None)
        return
    bounds = divided(states.pair_row, states.pair_first, PART)
    for pairs in itertools.starmap(slice, itertools.pairwise(bounds)):
        first = states.pair_first[pairs.start : pairs.stop + 1]
        own = slice(int(first[0]), int(first[-1]))
        row, column = states.pair_row[pairs], states.pair_column[pairs]
        yield (
            replace(
                states,
                pair_row=row,
                pair_column=column,
                pair_block=states.pair_block[pairs],
                pair_first=first - first[0],
                pair_truth=states.pair_truth[pairs],
                pair_estimate=states.pair_estimate[pairs],
                begin=states.begin[own],
                entry=states.entry[own],
                columns=replace(
                    states.columns,
                    begin=states.columns.begin[own],
                    pair_first=first - first[0],
                    pair_node=column,
                ),
            ),
            own,
        )


def regrets(states: States, value: Floats, weights: Ints) -> Floats:
    """What the weights of each row lose against its best path, (nodes,).

    `value` (S,) comes as the negative prices and is used up.
    """
    steps = row_steps(states)
    offsets = add_gains(states, steps, value)
    first = np.flatnonzero(np.diff(states.pair_row, prepend=-1))  # pair of each row
    row = states.pair_row[first]
    own = np.zeros(states.nodes)
    own[row] = np.add.reduceat(weights * value, states.pair_first[first])
    uncovered = ONE - steps.sums(weights)
    own[row] -= np.add.reduceat(uncovered * offsets, steps.first[row])
    own /= ONE
    moved, amount = changes(states, weights)
    paid = states.problem.crossing_price[states.begin[moved]] * amount
    own -= sum_by(states.pair_row[states.pair[moved]], paid, states.nodes)
    return np.maximum(best_values(states, value, steps, offsets) - own, 0.0)


def add_gains(states: States, steps: Slots, value: Floats) -> Floats:
    """Add what states gain to their values, less the offsets of their steps; the offsets, (steps,).

    The offset of a row and a step is what its cheapest pair gains there, 0 where it has none. Gains
    near 1 differ in their last digits, which sums over many steps lose; their differences are
    differences of costs, and exact. Every path of a row is lowered by the same sum.
    """
    problem, entry = states.problem, states.entry
    runs = np.flatnonzero(entry < 0)
    at = steps.begin.astype(np.intp)
    cost = np.empty(len(entry))
    np.take(problem.cost, entry, out=cost, mode="clip")
    cost[runs] = np.inf
    least = np.full(len(steps.step), np.inf)
    np.minimum.at(least, at, cost)
    with np.errstate(invalid="ignore"):
        relative = least[at] - cost
    of_cheapest: float | Floats
    if problem.pair_price is None:
        base = (
            problem.truth_price[problem.truth_row[entry]]
            + problem.estimate_price[problem.estimate_row[entry]]
        )
        cheapest = np.flatnonzero(relative == 0)
        of_cheapest = np.zeros(len(least))
        of_cheapest[at[cheapest]] = base[cheapest]
        relative += base - of_cheapest[at]
    else:
        of_cheapest = problem.pair_price
    offsets = np.where(least < np.inf, of_cheapest - least, 0.0)
    relative[runs] = -steps.totals(offsets, runs)
    value += relative
    return offsets


def row_steps(states: States) -> Slots:
    """The slots of the rows, with those of a single pair: the steps at which states begin."""
    rows, size = states.rows, np.diff(states.pair_first)
    alone = rows.first[states.pair_row] == rows.first[states.pair_row + 1]
    if not alone.any():
        return rows
    count = np.diff(rows.first)
    count[states.pair_row[alone]] = size[alone]
    first = np.concatenate(([0], np.cumsum(count))).astype(np.int32)
    begin = rows.begin + np.repeat((first[:-1] - rows.first[:-1])[states.pair_row], size)
    state = np.arange(len(begin), dtype=np.int32)
    begin += (state - np.repeat(states.pair_first[:-1], size)) * np.repeat(alone, size)
    step = np.empty(first[-1], np.int32)
    step[begin] = states.begin
    return Slots(
        first=first,
        step=step,
        begin=begin,
        pair_first=states.pair_first,
        pair_node=states.pair_row,
    )


@dataclass(frozen=True, kw_only=True)
class Turns:
    """The states in the order of a Viterbi pass over all rows at once.

    A turn takes the states that begin at the same step of their rows, counted in steps at which any
    begin. The states before them end there; those of the first turn open the window.

    Parameters
    ----------
    bounds : list of int
        Where the states of each turn begin in the order, and the end.
    order : (S,) int array
        The states.
    pair, row : (S,) int arrays
        Pair and row of each, in that order.
    """

    bounds: list[int]
    order: Ints
    pair: Ints
    row: Ints


def turns(states: States, steps: Slots | None = None) -> Turns:
    """The turns of all states; `steps` are those of `row_steps` if they are known."""
    steps = steps or row_steps(states)
    size = np.diff(states.pair_first)
    order, bounds = _ranked(steps.begin - np.repeat(steps.first[states.pair_row], size))
    pair = np.repeat(np.arange(len(size)), size)[order]
    return Turns(bounds=bounds, order=order, pair=pair, row=states.pair_row.astype(np.intp)[pair])


def _ranked(rank: Ints) -> tuple[Ints, list[int]]:
    """Order by (rank, place), and where the ranks 0, 1, 2, ... begin in it, and the end."""
    count = int(rank.max(initial=-1)) + 1
    if count <= 1 << 16:
        rank = rank.astype(np.uint16)  # sorted by radix
    order = np.argsort(rank, kind="stable")
    return order, np.searchsorted(rank[order], np.arange(count + 1)).tolist()


def best_values(
    states: States, value: Floats, steps: Slots | None = None, offsets: Floats | None = None
) -> Floats:
    """Value of the best path of each row, (nodes,): Viterbi over the states (docs/theory).

    hub = best value at "none"; a state is entered from the one before it or from the hub, and left
    into the hub, each for the price of half a switch. At "none" a path loses the offsets, which
    belong to the `steps` of `row_steps`.
    """
    steps = steps or row_steps(states)
    turn = turns(states, steps)
    value = value[turn.order]
    count = np.diff(steps.first)
    at, lost = _ranked(np.arange(count.sum()) - np.repeat(steps.first[:-1], count))
    row_lost = np.repeat(np.arange(states.nodes), count)[at]
    offsets = np.zeros(len(at)) if offsets is None else offsets[at]

    hub = np.zeros(states.nodes)
    current = np.zeros(len(states.pair_row))  # at the first turn: a window is entered for free
    price: Floats = np.asarray(states.problem.switch_price)
    varies, crossing = price.ndim > 0, states.problem.crossing_price
    for (low, high), (first, last) in zip(
        itertools.pairwise(turn.bounds), itertools.pairwise(lost), strict=True
    ):
        pair, row = turn.pair[low:high], turn.row[low:high]
        reached = current[pair]
        if varies:
            price = crossing[states.begin[turn.order[low:high]]]
        np.maximum.at(hub, row, reached - price)
        enter = hub[row]
        enter -= price
        np.maximum(reached, enter, out=reached)
        reached += value[low:high]
        current[pair] = reached
        hub[row_lost[first:last]] -= offsets[first:last]
    np.maximum.at(hub, states.pair_row, current)
    return hub


def changes(states: States, weights: Ints) -> tuple[Ints, Floats]:
    """States whose weight differs from that of the state before, and by how much, as a fraction."""
    moved = np.flatnonzero(changed(states.pair_first, weights))
    return moved, np.abs(weights[moved] - weights[moved - 1]) / ONE


def break_down(states: States, weights: Ints) -> Breakdown:
    """Split the cost of a feasible assignment by step and kind; sums are exact in the weights."""
    problem, steps = states.problem, states.problem.steps

    localisation = np.zeros(steps)

    def unassigned(name: str) -> tuple[Floats, Floats]:
        """Cost and number of one side's unassigned objects at each step; one side at a time."""
        row, step, price = (getattr(problem, f"{name}_{of}") for of in ("row", "step", "price"))
        free = np.full(len(step), ONE)
        for part in parts(len(weights)):
            used = np.flatnonzero((weights[part] != 0) & (states.entry[part] >= 0))
            entry, whole = states.entry[part][used].astype(np.intp), weights[part][used]
            np.subtract.at(free, row[entry].astype(np.intp), whole)
            if name == "truth":
                paid = whole / ONE * problem.cost[entry]
                np.add(localisation, sum_by(states.begin[part][used], paid, steps), localisation)
        cost, count = np.zeros(steps), np.zeros(steps)
        for part in parts(len(free)):
            left = np.flatnonzero(free[part])
            at, share = step[part][left].astype(np.intp), free[part][left] / ONE
            np.add.at(count, at, share)
            np.add.at(cost, at, share * price[part][left])
        return cost, count

    missed, false = unassigned("truth"), unassigned("estimate")
    moved, amount = changes(states, weights)
    variation = sum_by(states.begin[moved], amount, steps)
    return Breakdown(
        localisation=localisation,
        missed=missed[0],
        false=false[0],
        switch=variation * problem.crossing_price[:-1],
        missed_count=missed[1],
        false_count=false[1],
        switch_count=0.5 * variation,
    )
