"""Best paths of rows for given prices: what each is worth, and what weights lose against it."""

import itertools
from dataclasses import dataclass

import numpy as np

from tgospa_eval.problem import Floats, Ints, sum_by
from tgospa_eval.slots import Slots
from tgospa_eval.states import States
from tgospa_eval.weights import ONE, changes


def regrets(states: States, value: Floats, weights: Ints) -> Floats:
    """What the weights of each row lose against its best path, (nodes,).

    `value` (S,) comes as the negative prices and is used up.
    """
    steps = row_steps(states)
    offsets = add_gains(states, steps, value)
    first = np.flatnonzero(np.diff(states.pair_row, prepend=-1))  # pair of each row
    row = states.pair_row[first]
    own = np.zeros(states.nodes)
    own[row] = np.add.reduceat(weights * value, states.pair_first[first])
    uncovered = ONE - steps.sums(weights)
    own[row] -= np.add.reduceat(uncovered * offsets, steps.first[row])
    own /= ONE
    moved, amount = changes(states, weights)
    paid = states.problem.crossing_price[states.begin[moved]] * amount
    own -= sum_by(states.pair_row[states.pair[moved]], paid, states.nodes)
    return np.maximum(best_values(states, value, steps, offsets) - own, 0.0)


def add_gains(states: States, steps: Slots, value: Floats) -> Floats:
    """Add what states gain to their values, less the offsets of their steps; the offsets, (steps,).

    The offset of a row and a step is what its cheapest pair gains there, 0 where it has none. Gains
    near 1 differ in their last digits, which sums over many steps lose; their differences are
    differences of costs, and exact. Every path of a row is lowered by the same sum.
    """
    problem, entry = states.problem, states.entry
    runs = np.flatnonzero(entry < 0)
    at = steps.begin.astype(np.intp)
    cost = np.empty(len(entry))
    np.take(problem.cost, entry, out=cost, mode="clip")
    cost[runs] = np.inf
    least = np.full(len(steps.step), np.inf)
    np.minimum.at(least, at, cost)
    with np.errstate(invalid="ignore"):
        relative = least[at] - cost
    of_cheapest: float | Floats
    if problem.pair_price is None:
        base = (
            problem.truth_price[problem.truth_row[entry]]
            + problem.estimate_price[problem.estimate_row[entry]]
        )
        cheapest = np.flatnonzero(relative == 0)
        of_cheapest = np.zeros(len(least))
        of_cheapest[at[cheapest]] = base[cheapest]
        relative += base - of_cheapest[at]
    else:
        of_cheapest = problem.pair_price
    offsets = np.where(least < np.inf, of_cheapest - least, 0.0)
    relative[runs] = -steps.totals(offsets, runs)
    value += relative
    return offsets


def row_steps(states: States) -> Slots:
    """The slots of the rows, with those of a single pair: the steps at which states begin."""
    rows, size = states.rows, np.diff(states.pair_first)
    alone = rows.first[states.pair_row] == rows.first[states.pair_row + 1]
    if not alone.any():
        return rows
    count = np.diff(rows.first)
    count[states.pair_row[alone]] = size[alone]
    first = np.concatenate(([0], np.cumsum(count))).astype(np.int32)
    begin = rows.begin + np.repeat((first[:-1] - rows.first[:-1])[states.pair_row], size)
    state = np.arange(len(begin), dtype=np.int32)
    begin += (state - np.repeat(states.pair_first[:-1], size)) * np.repeat(alone, size)
    step = np.empty(first[-1], np.int32)
    step[begin] = states.begin
    return Slots(
        first=first,
        step=step,
        begin=begin,
        pair_first=states.pair_first,
        pair_node=states.pair_row,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Turns:
    """The states in the order of a Viterbi pass over all rows at once.

    A turn takes the states that begin at the same step of their rows, counted in steps at which any
    begin. The states before them end there; those of the first turn open the window.

    Parameters
    ----------
    bounds : list of int
        Where the states of each turn begin in the order, and the end.
    order : (S,) int array
        The states.
    pair, row : (S,) int arrays
        Pair and row of each, in that order.
    """

    bounds: list[int]
    order: Ints
    pair: Ints
    row: Ints


def turns(states: States, steps: Slots | None = None) -> Turns:
    """The turns of all states; `steps` are those of `row_steps` if they are known."""
    steps = steps or row_steps(states)
    size = np.diff(states.pair_first)
    order, bounds = _ranked(steps.begin - np.repeat(steps.first[states.pair_row], size))
    pair = np.repeat(np.arange(len(size)), size)[order]
    return Turns(bounds=bounds, order=order, pair=pair, row=states.pair_row.astype(np.intp)[pair])


def _ranked(rank: Ints) -> tuple[Ints, list[int]]:
    """Order by (rank, place), and where the ranks 0, 1, 2, ... begin in it, and the end."""
    count = int(rank.max(initial=-1)) + 1
    if count <= 1 << 16:
        rank = rank.astype(np.uint16)  # sorted by radix
    order = np.argsort(rank, kind="stable")
    return order, np.searchsorted(rank[order], np.arange(count + 1)).tolist()


def best_values(
    states: States, value: Floats, steps: Slots | None = None, offsets: Floats | None = None
) -> Floats:
    """Value of the best path of each row, (nodes,): Viterbi over the states (docs/theory).

    hub = best value at "none"; a state is entered from the one before it or from the hub, and left
    into the hub, each for the price of half a switch. At "none" a path loses the offsets, which
    belong to the `steps` of `row_steps`.
    """
    steps = steps or row_steps(states)
    turn = turns(states, steps)
    value = value[turn.order]
    count = np.diff(steps.first)
    at, lost = _ranked(np.arange(count.sum()) - np.repeat(steps.first[:-1], count))
    row_lost = np.repeat(np.arange(states.nodes), count)[at]
    offsets = np.zeros(len(at)) if offsets is None else offsets[at]

    hub = np.zeros(states.nodes)
    current = np.zeros(len(states.pair_row))  # at the first turn: a window is entered for free
    price: Floats = np.asarray(states.problem.switch_price)
    varies, crossing = price.ndim > 0, states.problem.crossing_price
    for (low, high), (first, last) in zip(
        itertools.pairwise(turn.bounds), itertools.pairwise(lost), strict=True
    ):
        pair, row = turn.pair[low:high], turn.row[low:high]
        reached = current[pair]
        if varies:
            price = crossing[states.begin[turn.order[low:high]]]
        np.maximum.at(hub, row, reached - price)
        enter = hub[row]
        enter -= price
        np.maximum(reached, enter, out=reached)
        reached += value[low:high]
        current[pair] = reached
        hub[row_lost[first:last]] -= offsets[first:last]
    np.maximum.at(hub, states.pair_row, current)
    return hub
