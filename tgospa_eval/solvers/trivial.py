"""Trivial blocks: a single row, independent steps, or best paths that do not conflict.

They need no solver. A block with a single row is solved by the best path of the row. If a block has
one step only, or switches are free, each step is a *linear assignment*: rows and columns are
matched one to one so that the sum of gains is largest. A *conflict* is a column slot that the paths
of two rows use. Best paths at prices 0 without conflict are the optimum. This module also rounds
weights to paths without conflict. Words and letters: `solvers`.
"""

import itertools

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated, places_of
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.paths import best_values, turns
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.states import ONE, States, connected_components


def best_paths(states: States, prices: Floats) -> Floats:
    """Return a best path of each row at `prices` (K,), as weights 0 and 1, (S,)."""
    return paths(states, states.gain - states.columns.totals(prices))


def paths(states: States, value: Floats) -> Floats:
    """Return the path of each row with the largest sum of `value` (S,), as weights 0 and 1, (S,).

    Switch prices are subtracted from the sum. Like `problem.paths.best_values`, it goes through the
    steps and keeps the value of the best path to each place. Here it also keeps the place before,
    for each state and for "none".
    """
    bounds, order, pairs, rows = turns(states)
    row, switch_price = states.pair_row, states.problem.switch_price_at
    unassigned_value = np.zeros(states.nodes)
    unassigned_from = np.full(states.nodes, -1)
    current = np.zeros(len(row))
    came_from = np.full(len(value), -1)
    for low, high in itertools.pairwise(bounds):
        state, pair, at = order[low:high], pairs[low:high], rows[low:high]
        price = switch_price[states.begin[state]]
        reached, before = current[pair], unassigned_value[at]
        np.maximum.at(unassigned_value, at, reached - price)
        after = unassigned_value[at]
        left = np.flatnonzero((after > before) & (reached - price == after))[::-1]
        unassigned_from[at[left]] = state[left] - 1  # of equal states, the first is written last
        enter = after - price
        stays = (reached >= enter) & (state > states.pair_first[pair])
        came_from[state] = np.where(stays, state - 1, unassigned_from[at])
        current[pair] = np.maximum(reached, enter) + value[state]

    for_pairs = np.lexsort((current, row))  # the last pair of each row is its best
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
    """Return ``Z(v) = sum v + sum_i best_i(v)`` of each block, (B,): an upper bound of its gain."""
    blocks = len(states.block_begin)
    best = best_values(states, states.gain - states.columns.totals(prices))
    slot_block = states.node_block[states.columns.node]
    return sum_by(states.node_block, best, blocks) + sum_by(slot_block, prices, blocks)


# -------------------------------------------------------------------------------------------------
# Rounding: one path for each row, without conflicts.

ROUNDINGS = 12


def round_paths(states: States, value: Floats, preference: Floats) -> Floats:
    """Return feasible weights 0 and 1, (S,): best paths without the states that lose a conflict.

    A state that loses is forbidden, and paths are computed again, up to ROUNDINGS times.

    Parameters
    ----------
    states : States
        The reduced problem.
    value : (S,) float array
        Gain minus price of each state.
    preference : (S,) float array
        In a conflict, the state with the larger preference wins.
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
    """Return the claimed states that lose a column slot to another claimed state."""
    slots = states.columns
    claimed = claimed[slots.end[claimed] > slots.begin[claimed]]
    length = slots.end[claimed] - slots.begin[claimed]
    state = np.repeat(claimed, length)
    slot = concatenated(slots.begin[claimed], length)
    order = np.lexsort((-preference[state], slot))
    second = np.flatnonzero(np.diff(slot[order]) == 0) + 1
    return np.unique(state[order[second]])


def solve_steps(states: States, weights: Floats, prices: Floats) -> Ints:
    """Write weights (S,) and prices (K,) of blocks with independent steps; return the other blocks.

    Steps are independent if a block has one step only, or if switches are free. `weights` and
    `prices` must be zeros at first.
    """
    price = states.problem.switch_price
    if not price if isinstance(price, float) else not price.any():
        assign_steps(states, np.ones(len(states.block_begin), bool), weights, prices)
        return np.zeros(0, np.int64)
    one_step = states.block_begin == states.block_end
    if one_step.any():
        assign_steps(states, one_step, weights, prices)
    return places_of(~one_step)


def solve_conflict_free(states: States, weights: Floats, prices: Floats) -> Ints:
    """Do as `solve_rows`, and also solve blocks whose best paths at prices 0 have no conflict."""
    return solve_rows(states, weights, prices, conflict_free=True)


def solve_rows(
    states: States, weights: Floats, prices: Floats, *, conflict_free: bool = False
) -> Ints:
    """Do as `solve_steps`, and also solve blocks with a single row, by its best path.

    With `conflict_free`, blocks whose best paths at prices 0 have no conflict are solved, too.
    """
    left = solve_steps(states, weights, prices)
    is_row = np.zeros(states.nodes, bool)
    is_row[states.pair_row] = True
    blocks = len(states.block_begin)
    done = np.bincount(states.node_block[is_row], minlength=blocks) == 1
    if len(left) and (conflict_free or done[left].any()):
        best = paths(states, states.gain)
        if conflict_free:
            claims = states.columns.sums(best.astype(np.int64))
            clash = states.node_block[states.columns.node[claims > 1]]
            done |= np.bincount(clash, minlength=blocks) == 0
        mine = np.zeros(blocks, bool)
        mine[left] = done[left]
        np.copyto(weights, best, where=states.states_of(mine))
    open_ones: Ints = left[~done[left]]
    return open_ones


def assign_steps(states: States, blocks: Mask, weights: Floats, prices: Floats) -> None:
    """Write the weights (S,) and prices (K,) of some blocks that are best if switches are free."""
    chosen = np.flatnonzero(states.states_of(blocks) & (states.entry >= 0))
    _assign_steps(states, chosen, weights, prices)
    _hold(states, weights)


def _assign_steps(states: States, chosen: Ints, weights: Floats, prices: Floats) -> None:
    """Solve the chosen states, which have a gain, step by step; write weights and column prices.

    At each step, connected entries are one component with its own matrix. So the choice among equal
    optima does not depend on other components. This matters for data in parts, because the parts
    are solved separately.
    """
    problem = states.problem
    entry = states.entry[chosen]
    truth = problem.truth_row[entry].astype(np.int64)
    estimate = problem.estimate_row[entry] + len(problem.truth_step)
    objects = len(problem.truth_step) + len(problem.estimate_step)
    component = connected_components(truth, estimate, objects)[truth]
    order = np.argsort(component, kind="stable")
    starts = np.flatnonzero(np.diff(component[order], prepend=-1))
    sizes = np.diff(starts, append=len(order))
    weights[chosen[order[starts[sizes == 1]]]] = 1.0
    order = order[np.repeat(sizes > 1, sizes)]
    state = chosen[order]
    flip = states.transposed[states.pair_block[states.pair[state]]]
    sides = truth[order], estimate[order]
    starts = np.concatenate(([0], np.cumsum(sizes[sizes > 1])))
    row, rows = _numbered(np.where(flip, *sides[::-1]), component[order], starts)
    column, columns = _numbered(np.where(flip, *sides), component[order], starts)
    gains = states.gains(state)
    parts = (starts, row, rows, column, columns)
    if kernels:
        taken, price = kernels.assign(*(part.astype(np.int32) for part in parts), gains)
    else:
        taken, price = np.zeros(len(state), bool), np.zeros(len(state))
        for begin, end, *shape in zip(starts[:-1], starts[1:], rows, columns, strict=True):
            i, j = row[begin:end], column[begin:end]
            gain = np.zeros(shape)
            gain[i, j] = gains[begin:end]
            assigned, lowest = _assign(gain)
            taken[begin:end], price[begin:end] = assigned[i] == j, lowest[j]
    weights[state] = taken
    priced = states.columns.end[state] > states.columns.begin[state]
    prices[states.columns.begin[state[priced]]] = price[priced]


def _numbered(items: Ints, component: Ints, starts: Ints) -> tuple[Ints, Ints]:
    """Return numbers of the items, from 0 on in each component, and their counts by component.

    Equal items of a component have the same number.
    """
    order = np.lexsort((items, component))
    new = np.diff(items[order], prepend=-1) != 0
    number = np.empty(len(items), np.int64)
    number[order] = np.cumsum(new) - 1
    firsts = number[order[starts[:-1]]]
    return number - np.repeat(firsts, np.diff(starts)), np.diff(firsts, append=new.sum())


def _assign(gain: Floats) -> tuple[Ints, Floats]:
    """Return an assignment of largest gain, and the lowest column prices that prove it.

    `gain` is (m, n). The results are the column of each row, (m,), -1 for none, and the prices
    v >= 0 of the columns, (n,). Let u[i] be the gain of row i minus the price of its column, or 0
    without a column. The prices prove the assignment if no row would do better in another column:
    gain[i, j] - v[j] <= u[i]. To find them, prices 0 are raised to ``max_i (gain[i, j] - u[i])``
    again and again, until nothing changes (Bellman-Ford). The prices do not grow without end,
    because the assignment is the best.
    """
    from scipy.optimize import linear_sum_assignment  # lazy: slow to import and rarely needed

    rows, columns = gain.shape
    i, j = linear_sum_assignment(gain, maximize=True)
    took = gain[i, j] > 0
    i, j = i[took], j[took]
    assigned, price, rival = np.full(rows, -1), np.zeros(columns), np.zeros((rows, columns))
    assigned[i] = j
    for _ in range(rows + 1):
        have = np.zeros(rows)
        have[i] = gain[i, j] - price[j]
        rival[:, j] = gain[:, j] - have[:, None]
        rival[i, j] = 0.0
        wanted = np.maximum(rival.max(axis=0), 0.0)
        if not (wanted > price + 1e-15).any():
            break
        price = np.maximum(price, wanted)
    return assigned, price


def _hold(states: States, weights: Floats) -> None:
    """Assign pairs also in the runs between their assigned states, if no other pair uses the slots.

    If switches are free, this does not change the cost, because a run has no gain. But fewer
    switches are reported. Short runs come first.
    """
    run = states.entry < 0
    size = len(weights)
    before = np.zeros(size)
    after = np.zeros(size)
    before[1:] = np.where(states.pair[1:] == states.pair[:-1], weights[:-1], 1.0)
    after[:-1] = np.where(states.pair[1:] == states.pair[:-1], weights[1:], 1.0)
    if size:
        before[0] = after[-1] = 1.0
    kept = np.flatnonzero(run & (before > 0) & (after > 0))
    whole = (weights * ONE).astype(np.int64)
    sides = [(slots.begin, slots.end) for slots in (states.rows, states.columns)]
    room = [ONE - slots.sums(whole) for slots in (states.rows, states.columns)]
    for s in kept[np.argsort(states.end[kept] - states.begin[kept], kind="stable")].tolist():
        spans = [r[begin[s] : end[s]] for r, (begin, end) in zip(room, sides, strict=True)]
        if all((span >= ONE).all() for span in spans):
            for span in spans:
                span -= ONE
            weights[s] = 1.0
