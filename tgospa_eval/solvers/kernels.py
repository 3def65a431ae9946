"""What solvers share: best paths at given prices, costs block by block, checks of settings."""

import itertools

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem.paths import best_values, turns
from tgospa_eval.problem.problem import Floats, sum_by
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE, changes, repair

DEAR = 1000.0
"""At lower switch prices, what rounding leaves of a switch costs less than 1e-9."""

THRESHOLDS = (1.0, 0.0, 3.0)
"""Prices below these multiples of the temperature are tried at 0: nobody contests those columns."""


def best_paths(states: States, prices: Floats) -> Floats:
    """An optimal path of each row at the given column prices, as weights 0 and 1, (S,)."""
    return paths(states, states.gain - states.columns.totals(prices))


def paths(states: States, value: Floats) -> Floats:
    """A path of largest value of each row, as weights 0 and 1, (S,).

    The Viterbi recursion of `problem.paths.best_values` with back pointers: the state from
    which each state is reached, and the state from which the hub of each row got its value.
    """
    turn, crossing = turns(states), states.problem.crossing_price
    row = states.pair_row
    hub = np.zeros(states.nodes)
    hub_from = np.full(states.nodes, -1)
    current = np.zeros(len(row))
    came_from = np.full(len(value), -1)
    for low, high in itertools.pairwise(turn.bounds):
        state, pair, at = turn.order[low:high], turn.pair[low:high], turn.row[low:high]
        price = crossing[states.begin[state]]
        reached, before = current[pair], hub[at]
        np.maximum.at(hub, at, reached - price)
        after = hub[at]
        left = np.flatnonzero((after > before) & (reached - price == after))[::-1]
        hub_from[at[left]] = state[left] - 1  # the first of equals: the last assignment wins
        enter = after - price
        stays = (reached >= enter) & (state > states.pair_first[pair])
        came_from[state] = np.where(stays, state - 1, hub_from[at])
        current[pair] = np.maximum(reached, enter) + value[state]

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


def price_cap(states: States) -> Floats:
    """Switch price of each block beyond which more cannot matter, (B,).

    An assignment that is held for n steps gains at most n times the largest gain: at any higher
    price it pays to leave it out. LP tolerances are absolute, so huge prices harm.
    """
    first = states.pair_first[
        np.searchsorted(states.pair_block, np.arange(len(states.block_begin)))
    ]
    most: Floats = np.maximum.reduceat(states.gain, first)
    return 2.0 * (states.block_end - states.block_begin + 1) * most


def settle(states: States, blocks: NDArray[np.bool_], weights: Floats) -> None:
    """Average the weights over time for each pair of those blocks where every price was cut.

    There an optimum has no switches, and what a solver leaves of them (1e-12, say) would be charged
    at the true price. The average over time is as feasible as what it averages.
    """
    crossing = states.problem.crossing_price
    if crossing.max() < DEAR or not blocks.any():
        return
    spans = zip(states.block_begin.tolist(), states.block_end.tolist(), strict=True)
    least = np.array([crossing[a + 1 : b + 1].min(initial=np.inf) for a, b in spans])
    held = blocks & (least > price_cap(states)) & np.isfinite(least)
    if not held.any():
        return
    length = (states.end - states.begin + 1).astype(np.float64)
    pair, pairs = states.pair, len(states.pair_row)
    mean = sum_by(pair, weights * length, pairs) / sum_by(pair, length, pairs)
    np.copyto(weights, mean[pair], where=held[states.pair_block[pair]])


def dual_values(states: States, prices: Floats) -> Floats:
    """Upper bound of what can be gained in each block, from prices >= 0, (B,)."""
    blocks = len(states.block_begin)
    best = best_values(states, states.gain - states.columns.totals(prices))
    slot_block = states.node_block[states.columns.node]
    return sum_by(states.node_block, best, blocks) + sum_by(slot_block, prices, blocks)


def alone_costs(states: States) -> Floats:
    """Cost of each block if all its objects stay unassigned, (B,)."""
    total = np.zeros(len(states.block_begin))
    for track, alone in zip(
        (states.pair_truth, states.pair_estimate), states.problem.alone, strict=True
    ):
        block = np.full(len(alone), -1)
        block[track] = states.pair_block
        mine = np.flatnonzero(block >= 0)
        total += sum_by(block[mine], alone[mine], len(total))
    return total


def block_costs(states: States, weights: Floats) -> Floats:
    """Cost of each block under a proposed assignment, once that is made feasible, (B,).

    In cost form: gains lose the digits of small costs. Objects without a pair are left out.
    """
    problem = states.problem
    whole = repair(states, weights)
    blocks = len(states.block_begin)
    of_state = np.repeat(states.pair_block, np.diff(states.pair_first))
    used = np.flatnonzero((states.entry >= 0) & (whole > 0))
    entry, block = states.entry[used], of_state[used]
    total = sum_by(block, whole[used] / ONE * problem.cost[entry], blocks)
    changed, amount = changes(states, whole)
    paid = problem.crossing_price[states.begin[changed]] * amount
    total += sum_by(of_state[changed], paid, blocks)
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


def is_wide(width: Floats, cost: Floats, gap: float) -> NDArray[np.bool_]:
    """Whether the bracket of each block is wider than `gap`, relative."""
    return width > gap * cost


def check_gap(gap: float) -> float:
    """The gap as a float; it must be finite and 0 or more.

    Raises
    ------
    ConfigError
        It is not.
    """
    gap = real_number("gap", gap)
    if not 0 <= gap < np.inf:
        raise ConfigError(f"gap is {gap:g}: must be finite and 0 or more")
    return gap


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
