"""From prices and soft assignments to one path per row that share no column."""

from collections.abc import Callable

import numpy as np

from tgospa_eval.problem import Floats, Ints, sum_by
from tgospa_eval.solvers.kernels import alone_costs, is_wide, paths, proven
from tgospa_eval.states import States

ROUNDS = 12

NEARLY_PERFECT = 1e-6
"""A block that costs less than this fraction of leaving all unassigned."""

MOST = 2000
"""Tracks of a block that is held as a whole: the assignment is dense."""


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


def polish(
    states: States,
    weights: Floats,
    prices: Floats,
    blocks: Ints,
    gap: float,
    late: Callable[[], bool],
) -> Ints:
    """Close those of the blocks that are nearly perfect, in place; which ones are closed then.

    Gains near 1 differ by less there than the tolerance of a programme, while the costs differ by
    a factor: of coincident truths each must get its own estimate. A misplaced object or a switch
    would cost more than all the rest, so that the best assignment is mostly one that never changes:
    one assignment of summed costs, by SciPy, whose prices are spread over time.
    """
    if not len(blocks):
        return blocks
    alone = alone_costs(states)
    of_state = np.repeat(states.pair_block, np.diff(states.pair_first))
    chosen = np.zeros(len(alone), bool)
    chosen[blocks] = True
    saved = sum_by(of_state, np.clip(weights, 0.0, 1.0) * states.gain, len(alone))
    chosen &= alone - saved < 2 * NEARLY_PERFECT * alone
    if not chosen.any():
        return np.zeros(0, np.int64)
    cost, width = proven(states, weights, prices)
    chosen &= (cost < NEARLY_PERFECT * alone) & is_wide(width, cost, alone, gap)
    if not chosen.any():
        return np.zeros(0, np.int64)
    held, even, alive = weights.copy(), prices.copy(), prices.copy()
    for block in np.flatnonzero(chosen).tolist():
        part, state, slot = states.between(block, block + 1)
        if np.ptp(part.pair_row) + np.ptp(part.pair_column) > MOST or late():
            continue
        held[state], fair = _hold_all(part)
        even[slot], alive[slot] = (fair[part.columns.node] * share for share in _shares(part))
    of_slot = states.node_block[states.columns.node]
    proposed = proven(states, held, prices)
    # Equal sums in another order differ in the last digit; prices may fit the held assignment only.
    won = chosen & (proposed[0] <= cost * (1 + 1e-12))
    np.copyto(weights, held, where=won[of_state])
    cost, width = np.where(won, proposed[0], cost), np.where(won, proposed[1], width)
    for candidate in (even, alive):
        trial = proven(states, weights, candidate)[1]
        won = chosen & (trial < width)
        np.copyto(prices, candidate, where=won[of_slot])
        width = np.where(won, trial, width)
    return np.flatnonzero(chosen & ~is_wide(width, cost, alone, gap))


def _shares(states: States) -> tuple[Floats, Floats]:
    """Spread of the price of a column over its slots: evenly, or where its object exists."""
    columns, problem = states.columns, states.problem
    count = np.maximum(np.diff(columns.first), 1)
    even = 1.0 / count[columns.node]
    flip = bool(states.transposed[0])
    track, step, price, of_pair = (
        (problem.truth_track, problem.truth_step, problem.truth_price, states.pair_truth)
        if flip
        else (
            problem.estimate_track,
            problem.estimate_step,
            problem.estimate_price,
            states.pair_estimate,
        )
    )
    node_of = np.full(problem.truths if flip else problem.estimates, -1)
    node_of[of_pair] = states.pair_column
    mine = np.flatnonzero(node_of[track] >= 0)
    node, step, price = node_of[track[mine]], step[mine], price[mine]
    within = (step >= states.block_begin[0]) & (step <= states.block_end[0])
    node, step, price = node[within], step[within], price[within]
    slot_key = columns.node.astype(np.int64) * problem.steps + columns.step
    slot = np.searchsorted(slot_key, node * np.int64(problem.steps) + step, side="right") - 1
    shared = np.diff(columns.first)[node] > 0
    worth = sum_by(slot[shared], price[shared], len(columns.step))
    total = sum_by(columns.node, worth, states.nodes)[columns.node]
    return even, np.where(total > 0, worth / np.maximum(total, 1e-300), even)


def _hold_all(states: States) -> tuple[Floats, Floats]:
    """The best assignment of one block that never changes, and the price of each node."""
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
    each = np.zeros(states.nodes)
    each[np.unique(states.pair_column)] = fair  # nodes come in the order of the tracks
    return taken[states.pair], each


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
