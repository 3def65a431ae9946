"""Where a solver may start: at the assignment and the prices of a problem like the one at hand."""

from dataclasses import dataclass

import numpy as np

from tgospa_eval.problem import Floats, Ints
from tgospa_eval.states import States


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """What solved another problem of the same objects, as a proposal for this one.

    Parameters
    ----------
    weights : (S,) float array
        Assignment of each state; need not be feasible.
    prices : (K,) float array
        Price of each column slot, 0 or more.
    """

    weights: Floats
    prices: Floats

    def between(self, state: slice, slot: slice) -> "Start":
        """The part of some blocks."""
        return Start(weights=self.weights[state], prices=self.prices[slot])


@dataclass(frozen=True, kw_only=True, eq=False)
class Origin:
    """Where the truths, estimates and steps of a problem were in the one before; int arrays."""

    truth: Ints
    estimate: Ints
    step: Ints


def carried(
    before: States, weights: Floats, prices: Floats, after: States, origin: Origin | None = None
) -> Start:
    """A solution of one problem as a start for another.

    Parameters
    ----------
    before : States
        What was solved.
    weights, prices : (S,), (K,) float arrays
        Its solution.
    after : States
        What is to be solved. A state takes the weight that its pair had where it begins; a slot
        takes what the same trajectory was priced while it lasts.
    origin : Origin, optional
        By default truths, estimates and steps are the same.
    """
    problem = before.problem
    same = Origin(
        truth=np.arange(problem.truths),
        estimate=np.arange(problem.estimates),
        step=np.arange(problem.steps + 1),
    )
    origin = origin or same
    steps = np.int64(problem.steps + 1)

    def keys_of_states(states: States, origin: Origin) -> Ints:
        truth, estimate = origin.truth[states.pair_truth], origin.estimate[states.pair_estimate]
        pair = truth * np.int64(problem.estimates) + estimate
        return np.repeat(pair * steps, np.diff(states.pair_first)) + origin.step[states.begin]

    def keys_of_nodes(states: States, origin: Origin) -> Ints:
        node = np.zeros(states.nodes, np.int64)
        node[states.pair_column] = np.where(
            states.transposed[states.pair_block],
            origin.truth[states.pair_truth],
            problem.truths + origin.estimate[states.pair_estimate],
        )
        return node * steps

    old, new = keys_of_states(before, same), keys_of_states(after, origin)
    if not len(old):
        return Start(weights=np.zeros(len(new)), prices=np.zeros(len(after.columns.step)))
    order = np.argsort(old, kind="stable")
    source = order[np.searchsorted(old[order], new, side="right") - 1]
    moved = np.where(old[source] // steps == new // steps, weights[source], 0.0)

    paid = np.flatnonzero(prices > 0)
    old = keys_of_nodes(before, same)[before.columns.node[paid]] + before.columns.step[paid]
    order = np.argsort(old, kind="stable")
    running = np.concatenate(([0.0], np.cumsum(prices[paid][order])))
    slots, node = after.columns, keys_of_nodes(after, origin)
    of = slots.node
    low = node[of] + origin.step[slots.step]
    high = node[of] + origin.step[after.block_end[after.node_block[of]]] + 1
    goes_on = np.flatnonzero(of[1:] == of[:-1])
    high[goes_on] = low[goes_on + 1]
    first, last = np.searchsorted(old[order], (low, high))
    return Start(weights=moved, prices=running[last] - running[first])
