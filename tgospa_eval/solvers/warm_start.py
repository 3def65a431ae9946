"""Proposals for a problem from solutions of *neighbours*, which differ in one parameter only.

The parameter C is c^p or gamma^p. A *proposal* is an assignment, or prices, to try before a solver
begins; some blocks may need nothing more. Let a neighbour have the prices v_0 at C_0, and another
one v_1 at C_1. Between them, at C = (1 - t) C_0 + t C_1 with 0 <= t <= 1, prices are mixed in the
same proportion. The lower bound L is concave in prices and C together, so

    L((1 - t) v_0 + t v_1, C) >= (1 - t) L(v_0, C_0) + t L(v_1, C_1).

So the mixed prices prove at least the mixed bound (docs/theory/solvers.md, "Sweeps of a
parameter"). If both neighbours have the same best assignment, its cost at C is the mixture of its
costs at C_0 and C_1, and so the optimum. Other words and letters: `solvers`.
"""

from functools import cached_property

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.states import ONE, States

OVERFULL = 1e-12
"""Largest excess of a load over 1 that counts as rounding. The proof repairs it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SavedSolution:
    """Saved part of a solution, independent of the states of its problem.

    Parameters
    ----------
    truth, estimate, begin, end : (A,) int arrays
        Assigned pairs, and the first and the last step of each assignment.
    weight : (A,) float array
        Weight of each assignment.
    priced, step : (V,) int arrays
        Estimate and first step of each price.
    price : (V,) float array
        Prices, > 0.
    estimates, steps : int
        Number of estimates and of steps of the problem.
    """

    truth: Ints
    estimate: Ints
    begin: Ints
    end: Ints
    weight: Floats
    priced: Ints
    step: Ints
    price: Floats
    estimates: int
    steps: int

    @cached_property
    def runs(self) -> tuple[Ints, Ints, Floats]:
        """First step, last step and weight of each assignment, sorted by pair and first step.

        A step of a pair, (truth, estimate, step), is coded as one number.
        """
        pair = (self.truth * np.int64(self.estimates) + self.estimate) * self.steps
        order = np.argsort(pair + self.begin, kind="stable")
        return (pair + self.begin)[order], (pair + self.end)[order], self.weight[order]

    @cached_property
    def running_prices(self) -> tuple[Ints, Floats]:
        """Place of each price, sorted, and running sums of the prices, which begin with 0.

        The place, (estimate, step), is coded as one number.
        """
        place = self.priced * np.int64(self.steps) + self.step
        order = np.argsort(place, kind="stable")
        return place[order], np.concatenate(([0.0], np.cumsum(self.price[order])))


@dataclass(frozen=True, kw_only=True, eq=False)
class WarmStart:
    """Proposals for a problem that are tried before it is solved.

    Parameters
    ----------
    weights : tuple of (S,) float arrays
        Feasible assignments.
    prices : (K,) float array
        Prices of the column slots, >= 0.
    near : bool
        True if `prices` are near the best ones, so that sweeps can begin at a low temperature.
    """

    weights: tuple[Floats, ...]
    prices: Floats
    near: bool = False

    def between(self, state: slice, slot: slice) -> "WarmStart":
        """Return the proposals for some blocks, whose states and column slots are given."""
        return WarmStart(
            weights=tuple(weights[state] for weights in self.weights),
            prices=self.prices[slot],
            near=self.near,
        )


def save_solution(states: States, weights: Ints, prices: Floats) -> SavedSolution:
    """Save feasible weights (S,), in units of 1/ONE, and prices (K,).

    Consecutive states of a pair with the same weight are joined. If an assignment begins where its
    block begins, it is extended to the first step of the problem. If it ends where its block ends,
    it is extended to the last step.
    """
    steps = states.problem.steps
    used = np.flatnonzero(weights)
    pair, weight = states.pair[used], weights[used]
    block = states.pair_block[pair]
    begin, end = states.begin[used].astype(np.int64), states.end[used].astype(np.int64)
    begin = np.where(begin == states.block_begin[block], 0, begin)
    end = np.where(end == states.block_end[block], steps - 1, end)
    opens = np.ones(len(used), bool)
    opens[1:] = (np.diff(pair) != 0) | (begin[1:] != end[:-1] + 1) | (np.diff(weight) != 0)
    first = np.flatnonzero(opens)
    last = np.append(first[1:], len(used)) - 1 if len(used) else first
    paid = np.flatnonzero(prices > 0)
    return SavedSolution(
        truth=states.pair_truth[pair[first]].astype(np.int64),
        estimate=states.pair_estimate[pair[first]].astype(np.int64),
        begin=begin[first],
        end=end[last],
        weight=weight[first] / ONE,
        priced=_estimates(states, np.arange(states.problem.estimates))[states.columns.node[paid]],
        step=states.columns.step[paid].astype(np.int64),
        price=prices[paid],
        estimates=states.problem.estimates,
        steps=steps,
    )


def _estimates(states: States, number: Ints) -> Ints:
    """Return for each node the number of its estimate, (nodes,), or 0 if it is not a column.

    `number` has the number of each estimate. In transposed blocks, the columns are true objects.
    The result means nothing for them, but they have one pair each and so no slots.
    """
    numbers = np.zeros(states.nodes, np.int64)
    numbers[states.pair_column] = number[states.pair_estimate]
    return numbers


def make_warm_start(
    states: States,
    saved: tuple[SavedSolution, ...],
    shares: tuple[float, ...],
    origin: tuple[Ints, Ints, Ints] | None = None,
) -> WarmStart:
    """Build a warm start: the assignments of neighbours, and a sum of their prices times `shares`.

    The weight of a state is the saved weight of its pair at the first step of the state. The price
    of a slot is the sum of the saved prices of its estimate at the steps of the slot. `origin` has
    the indices of the true objects, estimates and steps of this problem in the saved problems. By
    default the indices are the same.
    """
    problem, estimates, steps = states.problem, saved[0].estimates, saved[0].steps
    same = (np.arange(size) for size in (problem.truths, problem.estimates, problem.steps))
    truth, estimate, step = same if origin is None else origin
    pair = truth[states.pair_truth] * np.int64(estimates) + estimate[states.pair_estimate]
    sought = (pair * steps)[states.pair] + step[states.begin]
    slots, node = states.columns, states.columns.node
    number = _estimates(states, estimate)[node] * steps
    begin = number + step[slots.step]
    end = number + step[states.block_end[states.node_block[node]]] + 1
    goes_on = np.flatnonzero(node[1:] == node[:-1])
    end[goes_on] = begin[goes_on + 1]
    prices = np.zeros(len(begin))
    for part, share in zip(saved, shares, strict=True):
        place, running = part.running_prices
        low, high = np.searchsorted(place, (begin, end))
        prices += share * (running[high] - running[low])
    weights = tuple(_feasible(states, _weights_at(part, sought)) for part in saved)
    return WarmStart(weights=weights, prices=prices)


def _feasible(states: States, weights: Floats) -> Floats:
    """Return the weights, but 0 in each block in which they are not feasible."""
    used = np.flatnonzero(weights)
    begin, end = states.begin[used], states.end[used]
    pair = states.pair[used]
    full = np.zeros(len(states.block_begin), bool)
    for node in (states.pair_row[pair], states.pair_column[pair]):
        # The end of an assignment comes before a begin at the next step.
        moment = np.concatenate((begin * np.int64(2) + 1, end * np.int64(2) + 2))
        change = np.concatenate((weights[used], -weights[used]))
        whose = np.concatenate((node, node))
        order = np.lexsort((moment, whose))
        over = np.cumsum(change[order]) > 1 + OVERFULL
        full[states.node_block[whose[order[over]]]] = True
    if not full.any():
        return weights
    return np.where(states.states_of(full), 0.0, weights)


def _weights_at(saved: SavedSolution, sought: Ints) -> Floats:
    begin, end, weight = saved.runs
    if not len(begin):
        return np.zeros(len(sought))
    at = np.searchsorted(begin, sought, side="right") - 1
    inside = (at >= 0) & (sought <= end[at])
    return np.where(inside, weight[at], 0.0)
