"""Proposals for a problem from solutions of neighbouring problems; they may solve some blocks.

Neighbours differ in one parameter C, which is c^p or gamma^p. The lower bound L is concave in the
prices and C together, so interpolated prices prove at least the interpolated bound:

    L((1 - t) v_0 + t v_1, C) >= (1 - t) L(v_0, C_0) + t L(v_1, C_1),   C = (1 - t) C_0 + t C_1,

with the prices v_0 and v_1 of the neighbours at C_0 and C_1, and 0 <= t <= 1
(docs/theory/solvers.md, "Sweeps of a parameter"). If both neighbours have the same best assignment,
the optimum at C is the interpolated optimum.
"""

from functools import cached_property

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.states import ONE, States

OVERFULL = 1e-12
"""Largest excess of a sum of weights above 1 that counts as rounding. The proof repairs it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SavedSolution:
    """Saved part of a solution, independent of the states of its problem.

    Parameters
    ----------
    truth, estimate, begin, end : (A,) int arrays
        Assigned pairs, and the first and the last step of each assignment.
    weight : (A,) float array
        Weight of each assignment.
    priced, step : (P,) int arrays
        Estimate and first step of each price.
    price : (P,) float array
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
        """Begin, end and weight of each assignment, sorted by begin.

        A begin or end is (truth, estimate, step), coded as one number.
        """
        pair = (self.truth * np.int64(self.estimates) + self.estimate) * self.steps
        order = np.argsort(pair + self.begin, kind="stable")
        return (pair + self.begin)[order], (pair + self.end)[order], self.weight[order]

    @cached_property
    def running_prices(self) -> tuple[Ints, Floats]:
        """Estimate and step of each price, coded as one number, sorted; running sums of prices.

        The running sums begin with 0.
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
        True if `prices` are near the best ones, so the solver can begin with low temperatures.
    """

    weights: tuple[Floats, ...]
    prices: Floats
    near: bool = False

    def between(self, state: slice, slot: slice) -> "WarmStart":
        """Return the proposals for some blocks, by their states and column slots."""
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
    """Return the index of the estimate of each column that has slots, (nodes,).

    Columns of transposed blocks are true objects, which have one pair each and no slots.
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
    """Build a warm start from the assignments of neighbours, and shares of their prices.

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
    """Return the weights, but 0 in all blocks in which the weights of a row or column exceed 1."""
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
