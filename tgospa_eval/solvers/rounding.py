"""From prices and soft assignments to one path per row that share no column."""

import numpy as np

from tgospa_eval.problem import Floats, Ints, sum_by
from tgospa_eval.solvers.kernels import alone_costs, block_costs, paths
from tgospa_eval.states import States

ROUNDS = 12

NEARLY_PERFECT = 1e-6
"""A block that costs less than this fraction of leaving all unassigned."""


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
    for _ in range(ROUNDS):
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
    slot = (
        np.arange(len(state))
        - np.repeat(np.cumsum(length) - length, length)
        + np.repeat(slots.begin[claimed], length)
    )
    order = np.lexsort((-preference[state], slot))
    second = np.flatnonzero(np.diff(slot[order]) == 0) + 1
    return np.unique(state[order[second]])


def nearly_perfect(states: States, weights: Floats) -> Ints:
    """Blocks of several pairs that may cost less than `NEARLY_PERFECT`, switches aside."""
    alone = alone_costs(states)
    of_state = np.repeat(states.pair_block, np.diff(states.pair_first))
    saved = sum_by(of_state, np.clip(weights, 0.0, 1.0) * states.gain, len(alone))
    pairs = np.bincount(states.pair_block, minlength=len(alone))
    return np.flatnonzero((alone - saved < 2 * NEARLY_PERFECT * alone) & (pairs > 1))


def polish(states: States, weights: Floats, prices: Floats, blocks: Ints) -> tuple[Floats, Floats]:
    """Where estimates are nearly perfect, the best held assignment and its prices if it is better.

    Gains near 1 differ by less there than a solver can see, while the costs differ by a factor: of
    coincident truths each must get its own estimate. A misplaced object or a switch would cost more
    than the whole block, so the optimum is held throughout: one assignment of summed costs.
    `blocks` are those of `nearly_perfect`.
    """
    before = block_costs(states, weights)
    chosen = blocks[(before > 0)[blocks] & (before < NEARLY_PERFECT * alone_costs(states))[blocks]]
    if not len(chosen):
        return weights, prices
    of_state = np.repeat(states.pair_block, np.diff(states.pair_first))
    proposed, fair = weights.copy(), prices.copy()
    for block in chosen.tolist():
        part, state, slot = states.between(block, block + 1)
        proposed[state], fair[slot] = _hold_all(part)
    won = np.zeros(len(before), bool)
    # Equal sums in another order differ in the last digit; the prices fit the held assignment only.
    won[chosen] = (block_costs(states, proposed) <= before * (1 + 1e-12))[chosen]
    return (
        np.where(won[of_state], proposed, weights),
        np.where(won[states.node_block[states.columns.node]], fair, prices),
    )


def _hold_all(states: States) -> tuple[Floats, Floats]:
    """The best assignment of one block that never changes, and prices that prove it."""
    from scipy.optimize import linear_sum_assignment  # here: slow to import and rarely needed

    problem = states.problem
    gains = np.flatnonzero(states.entry >= 0)
    pair, entry = states.pair[gains], states.entry[gains]
    count = len(states.pair_row)
    price_t = problem.truth_price[problem.truth_row[entry]]
    price_e = problem.estimate_price[problem.estimate_row[entry]]
    all_t, all_e = problem.alone
    truth, i = np.unique(states.pair_truth, return_inverse=True)
    estimate, j = np.unique(states.pair_estimate, return_inverse=True)
    m, n = len(truth), len(estimate)
    # Unassigned truths go to the last m columns, unassigned estimates to the last n rows.
    cost = np.zeros((m + n, n + m))
    cost[:m, :n] = all_t[truth][:, None] + all_e[estimate][None, :]
    cost[i, j] = (
        sum_by(pair, problem.cost[entry], count)
        + (all_t[states.pair_truth] - sum_by(pair, price_t, count))
        + (all_e[states.pair_estimate] - sum_by(pair, price_e, count))
    )
    cost[:m, n:] = all_t[truth][:, None]
    cost[m:, :n] = all_e[estimate][None, :]
    _, column = linear_sum_assignment(cost)
    taken = (column[i] == j).astype(np.float64)
    if states.transposed[0]:
        fair = _fair_prices(cost.T, np.argsort(column))[:m]
    else:
        fair = _fair_prices(cost, column)[:n]
    # Nodes come in the order of the tracks, rows first; a price is spread over the slots.
    each = np.zeros(states.nodes)
    each[np.unique(states.pair_column)] = fair
    slots = np.diff(states.columns.first)
    return taken[states.pair], np.repeat(each / np.maximum(slots, 1), slots)


def _fair_prices(cost: Floats, column: Ints) -> Floats:
    """Least prices of the columns at which no row would rather have another column.

    price[j] = max over rows i of own cost of i - cost[i, j] + own price of i, and 0: the fixed
    point of Bellman and Ford on the residual graph, from below.
    """
    size = len(cost)
    own = cost[np.arange(size), column]
    price = np.zeros(size)
    for _ in range(size):
        wanted = (own[:, None] - cost + price[column][:, None]).max(axis=0)
        if np.all(wanted <= price):
            break
        price = np.maximum(price, wanted)
    return price
