"""What solvers share: best paths at given prices, capacities as a matrix, prices cut to size."""

from dataclasses import dataclass

import numpy as np

from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem import Floats, Ints, sum_by
from tgospa_eval.result import ONE, best_values, changes, events, repair
from tgospa_eval.states import Block, Slots, States


def best_paths(states: States, prices: Floats) -> Floats:
    """An optimal path of each row at the given column prices, as weights 0 and 1, (S,)."""
    return paths(states, states.gain - states.columns.totals(prices))


def paths(states: States, value: Floats) -> Floats:
    """A path of largest value of each row, as weights 0 and 1, (S,).

    The Viterbi recursion of `tgospa_eval.result.best_values` with back pointers: the state from
    which each state is reached, and the state from which the hub of each row got its value.
    """
    price = states.problem.crossing_price
    row = states.pair_row
    hub = np.zeros(states.nodes)
    hub_from = np.full(states.nodes, -1)
    current = np.zeros(len(row))
    came_from = np.full(len(value), -1)
    for step, opening, closing, groups in events(states):
        pair = states.pair[opening]
        at = row[pair]
        enter = hub[at] - price[step]
        stays = (current[pair] >= enter) & (opening > states.pair_first[pair])
        came_from[opening] = np.where(stays, opening - 1, hub_from[at])
        current[pair] = np.maximum(current[pair], enter) + value[opening]
        if len(closing):
            reached = current[states.pair[closing]]
            top = np.maximum.reduceat(reached, groups)
            is_top = np.flatnonzero(reached == np.repeat(top, np.diff(groups, append=len(reached))))
            first = is_top[np.searchsorted(is_top, groups)]
            at = row[states.pair[closing[groups]]]
            better = top - price[step + 1] > hub[at]
            hub[at[better]] = top[better] - price[step + 1]
            hub_from[at[better]] = closing[first[better]]

    for_pairs = np.lexsort((current, row))  # the last of each row is its best
    last = for_pairs[np.flatnonzero(np.diff(row[for_pairs], append=-1))]
    at = row[last]
    ends_on_pair = current[last] > hub[at]
    final = hub_from.copy()
    final[at[ends_on_pair]] = states.pair_first[last[ends_on_pair] + 1] - 1

    weights = np.zeros(len(value))
    on_path = final[final >= 0]
    while len(on_path):
        weights[on_path] = 1.0
        on_path = came_from[on_path]
        on_path = on_path[on_path >= 0]
    return weights


def capped_price(states: States, block: Block) -> Floats:
    """Switch prices into each step of the window of a block, cut where more cannot matter.

    An assignment that is held for n steps gains at most n times the largest gain: at any higher
    price it pays to leave it out. LP tolerances are absolute, so huge prices harm.
    """
    begin, end = block.window
    most = float(states.gain[block.states].max())
    prices = states.problem.crossing_price[begin : end + 1]
    return np.minimum(prices, 2.0 * (end - begin + 1) * most)


def settled(states: States, block: Block, weights: Floats) -> Floats:
    """The weights of a block, averaged over time for each pair where every price was cut.

    There an optimum has no switches, and what a solver leaves of them (1e-12, say) would be charged
    at the true price. The average over time is as feasible as what it averages.
    """
    begin, end = block.window
    price = capped_price(states, block)
    if not np.all(states.problem.crossing_price[begin + 1 : end + 1] > price[1:]):
        return weights
    pair = states.pair[block.states] - block.pairs.start
    length = states.end[block.states] - states.begin[block.states] + 1
    pairs = block.pairs.stop - block.pairs.start
    mean = sum_by(pair, weights * length, pairs) / sum_by(pair, length.astype(float), pairs)
    return np.asarray(mean[pair], np.float64)


def dual_values(states: States, prices: Floats) -> Floats:
    """Upper bound of what can be gained in each block, from prices >= 0, (B,)."""
    blocks = len(states.block_begin)
    best = best_values(states, states.gain - states.columns.totals(prices))
    slot_block = states.node_block[states.columns.node]
    return sum_by(states.node_block, best, blocks) + sum_by(slot_block, prices, blocks)


def block_costs(states: States, weights: Floats) -> Floats:
    """Cost of each block under a proposed assignment, once that is made feasible, (B,).

    In cost form: gains lose the digits of small costs. Objects without a pair are left out.
    """
    problem = states.problem
    whole = repair(states, weights)
    blocks = len(states.block_begin)
    used = np.flatnonzero((states.entry >= 0) & (whole > 0))
    entry, block = states.entry[used], states.pair_block[states.pair[used]]
    total = sum_by(block, whole[used] / ONE * problem.cost[entry], blocks)
    changed, amount = changes(states, whole)
    paid = problem.crossing_price[states.begin[changed]] * amount
    total += sum_by(states.pair_block[states.pair[changed]], paid, blocks)
    for side, count in (("truth", problem.truths), ("estimate", problem.estimates)):
        home = np.full(count, -1)
        home[getattr(states, f"pair_{side}")] = states.pair_block
        track = getattr(problem, f"{side}_track")
        free = np.full(len(track), ONE)
        np.subtract.at(free, getattr(problem, f"{side}_row")[entry], whole[used])
        at = home[track]
        price = free / ONE * getattr(problem, f"{side}_price")
        total += sum_by(at[at >= 0], price[at >= 0], blocks)
    return total


def better(states: States, first: Floats, second: Floats) -> Floats:
    """Block by block the better of two proposed assignments."""
    wins = block_costs(states, second) < block_costs(states, first)
    return np.where(wins[states.pair_block[states.pair]], second, first)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Capacity constraints on some states: sum of the states of each limit <= room.

    Parameters
    ----------
    limit, state : (nnz,) int arrays
        Limit and position among the chosen states of every entry.
    room : (L,) float array
        What the others leave.
    of_slot : (K,) int array
        Limit of each slot of the block, -1 where none is needed.
    """

    limit: Ints
    state: Ints
    room: Floats
    of_slot: Ints

    def spread(self, price: Floats) -> Floats:
        """Prices of the limits (L,), spread evenly over their slots, (K,)."""
        counts = np.bincount(self.of_slot[self.of_slot >= 0], minlength=len(price))
        each = np.append(price / np.maximum(counts, 1), 0.0)
        return np.asarray(each[self.of_slot], np.float64)


def limits(slots: Slots, chosen: Ints, own: slice, load: Ints) -> Limits:
    """The constraints of the chosen states of a block, where others fill `load` (K,) of the slots.

    Neighbouring slots with the same states and the same load are one; slots with room for their
    only pair are left out.
    """
    begin, end = slots.begin[chosen] - own.start, slots.end[chosen] - own.start
    count = own.stop - own.start
    node, held = slots.node[own], load[own]
    state = np.flatnonzero(end > begin)
    begin, end = begin[state], end[state]
    fresh = np.zeros(count, bool)
    fresh[begin] = True
    fresh[:1] = True
    fresh[1:] |= (np.diff(node) != 0) | (np.diff(held) != 0)
    group = np.cumsum(fresh) - 1
    covers = np.zeros(count + 1, np.int64)
    np.add.at(covers, begin, 1)
    np.subtract.at(covers, end, 1)
    covers = np.cumsum(covers[:-1])
    first = np.flatnonzero(fresh)
    needed = (covers[first] > 1) | ((covers[first] > 0) & (held[first] > 0))
    number = np.where(needed, np.cumsum(needed) - 1, -1)

    length = group[end - 1] + 1 - group[begin]
    entry = np.repeat(state, length)
    offset = np.arange(len(entry)) - np.repeat(np.cumsum(length) - length, length)
    limit = number[np.repeat(group[begin], length) + offset]
    return Limits(
        limit=limit[limit >= 0],
        state=entry[limit >= 0],
        room=1.0 - held[first[needed]].astype(np.float64),
        of_slot=number[group] if count else np.zeros(0, np.int64),
    )


def check_time_limit(seconds: float | None) -> float | None:
    """The limit as a float; it must be finite and positive, None is no limit.

    Raises
    ------
    ConfigError
        It is not.
    """
    if seconds is None:
        return None
    seconds = real_number("time limit", seconds)
    if not 0 < seconds < np.inf:
        raise ConfigError(f"time limit is {seconds:g} s: must be finite and more than 0")
    return seconds
