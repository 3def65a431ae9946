"""From prices and soft assignments to one path per row that share no column."""

import numpy as np

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.best_paths import paths

ROUNDINGS = 12


def round_paths(states: States, value: Floats, preference: Floats) -> Floats:
    """Feasible weights 0 and 1: best paths, with the states that lose a clash taken away.

    Parameters
    ----------
    states : States
        The reduced problem.
    value : (S,) float array
        Gain less price of each state.
    preference : (S,) float array
        Who wins where two rows claim a column at once.
    """
    value = value.copy()
    for _ in range(ROUNDINGS):
        weights = paths(states, value)
        lost = _losers(states, np.flatnonzero(weights), preference)
        if not len(lost):
            return weights
        value[lost] = -np.inf
    weights[lost] = 0.0
    return weights


def _losers(states: States, claimed: Ints, preference: Floats) -> Ints:
    """Claimed states that share a slot with a claimed state that is preferred."""
    slots = states.columns
    claimed = claimed[slots.end[claimed] > slots.begin[claimed]]
    length = slots.end[claimed] - slots.begin[claimed]
    state = np.repeat(claimed, length)
    slot = concatenated(slots.begin[claimed], length)
    order = np.lexsort((-preference[state], slot))
    second = np.flatnonzero(np.diff(slot[order]) == 0) + 1
    return np.unique(state[order[second]])
