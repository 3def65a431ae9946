"""Best paths of the rows at given prices, and what those prices prove."""

import itertools

import numpy as np

from tgospa_eval.problem.paths import best_values, turns
from tgospa_eval.problem.problem import Floats, sum_by
from tgospa_eval.problem.states import States


def best_paths(states: States, prices: Floats) -> Floats:
    """An optimal path of each row at the given column prices, as weights 0 and 1, (S,)."""
    return paths(states, states.gain - states.columns.totals(prices))


def paths(states: States, value: Floats) -> Floats:
    """A path of largest value of each row, as weights 0 and 1, (S,).

    The recursion of `problem.paths.best_values` with back pointers: the state from which each state
    is reached, and that from which "none" of each row got its value.
    """
    turn, switch_price = turns(states), states.problem.switch_price_at
    row = states.pair_row
    unassigned_value = np.zeros(states.nodes)
    unassigned_from = np.full(states.nodes, -1)
    current = np.zeros(len(row))
    came_from = np.full(len(value), -1)
    for low, high in itertools.pairwise(turn.bounds):
        state, pair, at = turn.order[low:high], turn.pair[low:high], turn.row[low:high]
        price = switch_price[states.begin[state]]
        reached, before = current[pair], unassigned_value[at]
        np.maximum.at(unassigned_value, at, reached - price)
        after = unassigned_value[at]
        left = np.flatnonzero((after > before) & (reached - price == after))[::-1]
        unassigned_from[at[left]] = state[left] - 1  # the first of equals: the last assignment wins
        enter = after - price
        stays = (reached >= enter) & (state > states.pair_first[pair])
        came_from[state] = np.where(stays, state - 1, unassigned_from[at])
        current[pair] = np.maximum(reached, enter) + value[state]

    for_pairs = np.lexsort((current, row))  # the last of each row is its best
    last = for_pairs[np.flatnonzero(np.diff(row[for_pairs], append=-1))]
    at = row[last]
    ends_on_pair = current[last] > unassigned_value[at]
    final = unassigned_from.copy()
    final[at[ends_on_pair]] = states.pair_first[last[ends_on_pair] + 1] - 1

    weights = np.zeros(len(value))
    on_path = final[final >= 0]
    while len(on_path):
        weights[on_path] = 1.0
        on_path = came_from[on_path]
        on_path = on_path[on_path >= 0]
    return weights


def dual_values(states: States, prices: Floats) -> Floats:
    """``Z(v) = sum v + sum_i best_i(v)`` of each block, (B,): above what can be gained."""
    blocks = len(states.block_begin)
    best = best_values(states, states.gain - states.columns.totals(prices))
    slot_block = states.node_block[states.columns.node]
    return sum_by(states.node_block, best, blocks) + sum_by(slot_block, prices, blocks)
