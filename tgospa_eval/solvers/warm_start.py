"""Proposals for a problem from solutions of neighbours: components that need no solver.

    L((1 - t) v_0 + t v_1, C) >= (1 - t) L(v_0, C_0) + t L(v_1, C_1),   C = (1 - t) C_0 + t C_1,

for the bound L is concave in prices and C = c^p, or gamma^p (docs/theory/solvers.md, "Sweeps of a
parameter"). Where both neighbours have the same best assignment the chord is met.
"""

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.problem import Floats, Ints, Problem
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE

OVERFULL = 1e-12
"""Sums of weights that exceed 1 by more than rounding; the proof scales what is left."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SavedSolution:
    """What is saved of a solution, whatever the states of its problem were.

    Parameters
    ----------
    begin, end : (A,) int arrays
        What is assigned, by first and last step: (truth, estimate, step) as one number, in order.
    weight : (A,) float array
        How much of it.
    slot : (B,) int array
        What is priced: (estimate, step) as one number, in order.
    price : (B,) float array
        More than 0.
    """

    begin: Ints
    end: Ints
    weight: Floats
    slot: Ints
    price: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class WarmStart:
    """Proposals for a problem that are looked at before it is solved.

    Parameters
    ----------
    weights : tuple of (S,) float arrays
        Feasible assignments.
    prices : (K,) float array
        Of the column slots, 0 or more.
    near : bool
        Whether the best prices are near, so that a solver need not begin from afar.
    """

    weights: tuple[Floats, ...]
    prices: Floats
    near: bool = False

    def between(self, state: slice, slot: slice) -> "WarmStart":
        """The part of some blocks."""
        return WarmStart(
            weights=tuple(weights[state] for weights in self.weights),
            prices=self.prices[slot],
            near=self.near,
        )


def save_solution(states: States, weights: Ints, prices: Floats) -> SavedSolution:
    """What is saved of feasible weights (S,), in units of 1/ONE, and prices (K,).

    What is held at the end of the window of its block goes on being held.
    """
    steps = states.problem.steps
    used = np.flatnonzero(weights)
    block = states.pair_block[states.pair[used]]
    begin, end = states.begin[used], states.end[used]
    begin = np.where(begin == states.block_begin[block], 0, begin)
    end = np.where(end == states.block_end[block], steps - 1, end)
    origin = ProblemOrigin.same(states.problem)
    pair = origin.pairs(states)[states.pair[used]]
    order = np.argsort(pair + begin)
    paid = np.flatnonzero(prices > 0)
    slot = origin.nodes(states)[states.columns.node[paid]] + states.columns.step[paid]
    by_slot = np.argsort(slot)
    return SavedSolution(
        begin=(pair + begin)[order],
        end=(pair + end)[order],
        weight=weights[used][order] / ONE,
        slot=slot[by_slot],
        price=prices[paid][by_slot],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ProblemOrigin:
    """Where the truths, estimates and steps of a problem are in that of the solutions saved.

    Parameters
    ----------
    truth, estimate, step : int arrays
        The number there of each one here.
    estimates, steps : int
        Sizes there.
    """

    truth: Ints
    estimate: Ints
    step: Ints
    estimates: int
    steps: int

    @classmethod
    def same(cls, problem: Problem) -> "ProblemOrigin":
        """Of a problem with the same objects."""
        return cls(
            truth=np.arange(problem.truths),
            estimate=np.arange(problem.estimates),
            step=np.arange(problem.steps),
            estimates=problem.estimates,
            steps=problem.steps,
        )

    def pairs(self, states: States) -> Ints:
        """A number for each pair, (P,), with room for the steps."""
        truth = self.truth[states.pair_truth].astype(np.int64)
        return (truth * self.estimates + self.estimate[states.pair_estimate]) * self.steps

    def nodes(self, states: States) -> Ints:
        """A number for each node that has column slots, with room for the steps.

        Columns of transposed blocks are truths; they have one pair each, and no slots.
        """
        number = np.zeros(states.nodes, np.int64)
        number[states.pair_column] = self.estimate[states.pair_estimate]
        return number * self.steps


def make_warm_start(
    states: States,
    saved: tuple[SavedSolution, ...],
    shares: tuple[float, ...],
    origin: ProblemOrigin | None = None,
) -> WarmStart:
    """The assignments of neighbours, and their prices in so many shares.

    A state has the weight that its pair had where it begins; a slot has the prices that its
    estimate was paid while it lasts. How they are spread over a slot means nothing.
    """
    origin = origin or ProblemOrigin.same(states.problem)
    sought = origin.pairs(states)[states.pair] + origin.step[states.begin]
    slots, node = states.columns, states.columns.node
    number = origin.nodes(states)[node]
    begin = number + origin.step[slots.step]
    end = number + origin.step[states.block_end[states.node_block[node]]] + 1
    goes_on = np.flatnonzero(node[1:] == node[:-1])
    end[goes_on] = begin[goes_on + 1]
    prices = np.zeros(len(begin))
    for part, share in zip(saved, shares, strict=True):
        running = np.concatenate(([0.0], np.cumsum(part.price)))
        low, high = np.searchsorted(part.slot, (begin, end))
        prices += share * (running[high] - running[low])
    weights = tuple(_feasible(states, _held(part, sought)) for part in saved)
    return WarmStart(weights=weights, prices=prices)


def _feasible(states: States, weights: Floats) -> Floats:
    """The weights, 0 in blocks where they overfill a row or a column at some step."""
    used = np.flatnonzero(weights)
    begin, end = states.begin[used], states.end[used]
    pair = states.pair[used]
    full = np.zeros(len(states.block_begin), bool)
    for node in (states.pair_row[pair], states.pair_column[pair]):
        # What ends comes before what begins at the next step.
        moment = np.concatenate((begin * np.int64(2) + 1, end * np.int64(2) + 2))
        change = np.concatenate((weights[used], -weights[used]))
        whose = np.concatenate((node, node))
        order = np.lexsort((moment, whose))
        over = np.cumsum(change[order]) > 1 + OVERFULL
        full[states.node_block[whose[order[over]]]] = True
    if not full.any():
        return weights
    return np.where(full[states.pair_block[states.pair]], 0.0, weights)


def _held(saved: SavedSolution, sought: Ints) -> Floats:
    if not len(saved.begin):
        return np.zeros(len(sought))
    at = np.searchsorted(saved.begin, sought, side="right") - 1
    found = (at >= 0) & (sought <= saved.end[at])
    return np.where(found, saved.weight[at], 0.0)
