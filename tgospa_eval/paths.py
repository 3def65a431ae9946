"""Best paths of rows for given prices: upper bounds of what each is worth.

Every operation that rounds is followed by a step outward, so that what is called a bound is one of
the exact value in real numbers (docs/theory, "Rounding").
"""

import itertools
from dataclasses import dataclass

import numpy as np

from tgospa_eval.problem import Floats, Ints, sum_parts
from tgospa_eval.slots import Slots
from tgospa_eval.states import States

CHUNK = 1024
"""Terms of a sum whose rounding is bounded together."""


def up(value: Floats) -> Floats:
    """The next larger doubles, in place: at least the exact results of one rounded operation."""
    return np.nextafter(value, np.inf, out=value)


def down(value: Floats) -> Floats:
    """The next smaller doubles, in place."""
    return np.nextafter(value, -np.inf, out=value)


def lower_sums(value: Floats, first: Ints) -> Floats:
    """Lower bounds of the sums of parts of values >= 0; part i begins at first[i].

    A sum of n terms >= 0 is off by at most (n - 1) units of rounding, whatever the order; sums of
    chunks, and then of these, keep n small.
    """
    if len(value) <= CHUNK:
        total, terms = sum_parts(value, first), len(value)
    else:
        begins = np.zeros(len(value), bool)
        begins[::CHUNK] = begins[first[first < len(value)]] = True
        starts = np.flatnonzero(begins)
        chunks = np.add.reduceat(value, starts)
        of_part = np.searchsorted(starts, np.minimum(first, len(value)))
        of_part[first >= len(value)] = len(starts)
        total = sum_parts(chunks, of_part)
        terms = CHUNK + int(np.diff(of_part).max(initial=0))
    total *= 1.0 - (terms + 2) * 2.0**-53
    return total


@dataclass(frozen=True, kw_only=True, eq=False)
class Gains:
    """Gains of states relative to the cheapest pair of their row and step.

    Gains near 1 differ in their last digits, which sums over many steps lose; their differences are
    differences of costs, and keep the digits of those. Every path of a row is lowered by the same
    sum.

    Parameters
    ----------
    relative : (S,) float array
        Upper bounds of the gains less the offsets of their steps.
    offset : (G,) float array
        Lower bounds of the gain of the cheapest pair of each row and step, 0 where there is none.
    least : (G,) float array
        Its cost, infinite where there is none.
    cheapest : (G,) int array, optional
        Its entry, -1 where there is none; None where all pairs of objects have the same prices.
    """

    relative: Floats
    offset: Floats
    least: Floats
    cheapest: Ints | None


def relative_gains(states: States, steps: Slots) -> Gains:
    """The gains of all states; `steps` are those of `row_steps`."""
    problem, entry = states.problem, states.entry
    runs = np.flatnonzero(entry < 0)
    at = steps.begin.astype(np.intp)
    cost = np.empty(len(entry))
    np.take(problem.cost, entry, out=cost, mode="clip")
    cost[runs] = np.inf
    least = np.full(len(steps.step), np.inf)
    np.minimum.at(least, at, cost)
    with np.errstate(invalid="ignore"):
        relative = up(least[at] - cost)
    base: float | Floats
    if problem.pair_price is None:
        cheapest = np.full(len(least), -1)
        is_least = np.flatnonzero((cost == least[at]) & (entry >= 0))
        cheapest[at[is_least]] = entry[is_least]
        base = _lower_price(states, cheapest)
        # What two pairs of objects cost if they are left unassigned differs: four rounded steps.
        own = (
            problem.truth_price[problem.truth_row[entry]]
            - (problem.truth_price[problem.truth_row[cheapest]][at])
        )
        other = (
            problem.estimate_price[problem.estimate_row[entry]]
            - (problem.estimate_price[problem.estimate_row[cheapest]][at])
        )
        relative = up(relative + up(up(own) + up(other)))
    else:
        cheapest, base = None, problem.pair_price
        if base - float(problem.truth_price[0]) != float(problem.estimate_price[0]):
            base = np.nextafter(base, 0.0)
    offset = np.where(least < np.inf, base - least, 0.0)
    np.maximum(down(offset), 0.0, out=offset)
    relative[runs] = -steps.totals(offset, runs, floor=True)
    return Gains(relative=relative, offset=offset, least=least, cheapest=cheapest)


def _lower_price(states: States, entry: Ints) -> Floats:
    problem = states.problem
    return down(
        problem.truth_price[problem.truth_row[entry]]
        + problem.estimate_price[problem.estimate_row[entry]]
    )


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
    """Upper bound of the value of the best path of each row, (nodes,): Viterbi over the states.

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
        np.maximum.at(hub, row, up(reached - price))
        enter = hub[row]
        enter -= price
        np.maximum(reached, up(enter), out=reached)
        reached += value[low:high]
        current[pair] = up(reached)
        if first < last:
            losing = row_lost[first:last]
            hub[losing] = up(hub[losing] - offsets[first:last])
    np.maximum.at(hub, states.pair_row, current)
    return hub
