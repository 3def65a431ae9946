"""Upper bounds of the value of each row's best path, at given prices.

After every operation that rounds, the result is moved to the next double in the safe direction. For
this reason, all bounds are valid in exact arithmetic (docs/theory/certificate.md, "Rounding"). The
letters are those of docs/theory/notation.md, and sizes of arrays, such as (S,), those of
`problem.states`. G is the number of slots that `row_steps` returns.
"""

import itertools

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.problem import sum_parts
from tgospa_eval.problem.states import Slots, States

SUMMANDS = 1024
"""Number of values in a chunk of a long sum (see `lower_sums`)."""


def up(value: Floats) -> Floats:
    """Replace rounded results by the next larger doubles, in place.

    They are upper bounds of the exact results.
    """
    return np.nextafter(value, np.inf, out=value)


def down(value: Floats) -> Floats:
    """Replace rounded results by the next smaller doubles, in place.

    They are lower bounds of the exact results.
    """
    return np.nextafter(value, -np.inf, out=value)


def lower_sums(value: Floats, first: Ints) -> Floats:
    """Return a lower bound of the sum of each part of the values; part i begins at first[i].

    All values must be >= 0. The computed sum of n such values is off by at most (n - 1) 2^-53 times
    the sum, in any order. To keep n small, long parts are summed in chunks, and then the sums of
    the chunks are added.
    """
    size = first[1:] - first[:-1]
    if len(value) <= SUMMANDS:
        total, terms = sum_parts(value, first), size
    else:  # no chunk has values of two parts: the bound of a part depends on no other part
        chunks = -(-size // SUMMANDS)
        of_part = np.concatenate(([0], np.cumsum(chunks)))
        number = np.arange(of_part[-1]) - np.repeat(of_part[:-1], chunks)
        starts = np.repeat(first[:-1], chunks) + SUMMANDS * number
        total = sum_parts(np.add.reduceat(value, starts), of_part)
        terms = np.where(chunks > 1, SUMMANDS + chunks, size)
    total *= 1.0 - (terms + 2) * 2.0**-53
    return total


Gains = tuple[Floats, Floats, Ints]


def relative_gains(states: States, steps: Slots, price: Floats | None = None) -> Gains:
    """Return the gain minus price of each state, relative to the best pair of its row and step.

    The best pair of a row at a step has the largest gain minus price, G - v. If this value is
    positive, it is the *offset* r of the row at the step. In all other cases, r is 0. Subtracting
    offsets decreases the values of all paths of a row by the same sum
    (docs/theory/certificate.md, "The bounds that are computed").

    The result ``(G - v) - r`` is computed as ``(D_best - D) + (v_best - v)``, plus differences of
    A and B. Gains near 1 would lose digits that these differences keep.

    `steps` is the result of `row_steps`. `price` (S,) must have the exact price of each state with
    a gain, and a lower bound of the price of each run without gain.

    Returns
    -------
    relative : (S,) float array
        Upper bound of the result of each state. From a run, the offsets of all its steps are
        subtracted.
    offset : (G,) float array
        Lower bound of the offset of each row and step.
    best : (G,) int array
        State of the best pair of each row and step; -1 if no pair has a positive gain minus price.
    """
    problem, entry = states.problem, states.entry
    price = np.zeros(len(entry)) if price is None else price
    relative: Floats
    if kernels and problem.pair_price is not None:
        relative, offset, best = kernels.upper_gains(
            steps.begin, len(steps.step), entry, problem.cost, price, problem.pair_price
        )
    else:
        relative, offset, best = _relative_gains(states, steps, price)
    # The offsets of all steps of a run are subtracted from its value.
    running = steps.running(offset, floor=True)
    if kernels:
        kernels.run_gains(
            steps.first,
            steps.begin,
            steps.pair_first,
            steps.pair_node,
            *running,
            entry,
            price,
            relative,
        )
    else:
        runs = np.flatnonzero(entry < 0)
        relative[runs] = up(-price[runs] - steps.spans(running, runs, floor=True))
    return relative, offset, best


def _relative_gains(states: States, steps: Slots, price: Floats) -> Gains:
    """Compute `relative_gains` without kernels. Elements of runs without gain are not computed."""
    problem, entry = states.problem, states.entry
    at = steps.begin.astype(np.intp)
    cost = np.empty(len(entry))
    np.take(problem.cost, entry, out=cost, mode="clip")
    cost[entry < 0] = np.inf
    base: float | Floats
    sides: tuple[Floats, ...] = ()
    if problem.pair_price is None:
        sides = tuple(side.price[side.row[entry]] for side in problem.sides)
        base = sides[0] + sides[1]
    else:
        base = problem.pair_price
    loss = cost + price - base
    smallest = np.zeros(len(steps.step))
    np.minimum.at(smallest, at, loss)
    best = np.full(len(smallest), -1)
    is_best = np.flatnonzero((loss == smallest[at]) & (loss < 0))
    best[at[is_best]] = is_best
    with np.errstate(invalid="ignore"):
        relative = up(up(cost[best][at] - cost) + up(price[best][at] - price))
        for side in sides:  # only if the prices A or B differ between rows
            relative = up(relative + up(side - side[best][at]))
        offset = np.broadcast_to(base, len(entry))[best]
        offset = down(down(down(offset) - cost[best]) - price[best])
        np.maximum(np.where(best >= 0, offset, 0.0), 0.0, out=offset)
        single = np.flatnonzero((best[at] < 0) & (entry >= 0))
        own = up(np.broadcast_to(base, len(entry))[single] - cost[single])
        relative[single] = up(up(own) - price[single])
    return relative, offset, best


def row_steps(states: States) -> Slots:
    """Return slots of all rows, including rows with one pair.

    A row has a slot for each step at which one of its states begins.
    """
    rows, size = states.rows, np.diff(states.pair_first)
    single = rows.first[states.pair_row] == rows.first[states.pair_row + 1]
    if not single.any():
        return rows
    count = np.diff(rows.first)
    count[states.pair_row[single]] = size[single]
    first = np.concatenate(([0], np.cumsum(count))).astype(np.int32)
    begin = rows.begin + np.repeat((first[:-1] - rows.first[:-1])[states.pair_row], size)
    state = np.arange(len(begin), dtype=np.int32)
    begin += (state - np.repeat(states.pair_first[:-1], size)) * np.repeat(single, size)
    step = np.empty(first[-1], np.int32)
    step[begin] = states.begin
    return Slots(
        first=first, step=step, begin=begin, pair_first=states.pair_first, pair_node=states.pair_row
    )


def turns(states: States, steps: Slots | None = None) -> tuple[list[int], Ints, Ints, Ints]:
    """Return the states in the order of a Viterbi pass over all rows at once.

    A row has a list of the steps at which one of its states begins. Turn k of the pass has, for all
    rows together, the states that begin at the k-th step in the list of their row.

    Parameters
    ----------
    states : States
        The reduced problem.
    steps : Slots, optional
        Result of `row_steps`, if it is known.

    Returns
    -------
    bounds : list of int
        Index in `order` at which each turn begins, and the end of the last turn.
    order : (S,) int array
        The states, turn by turn.
    pair, row : (S,) int arrays
        Pair and row of each state in `order`.
    """
    steps = steps or row_steps(states)
    size = np.diff(states.pair_first)
    order, bounds = _ranked(steps.begin - np.repeat(steps.first[states.pair_row], size))
    pair = np.repeat(np.arange(len(size)), size)[order]
    return bounds, order, pair, states.pair_row.astype(np.intp)[pair]


def _ranked(rank: Ints) -> tuple[Ints, list[int]]:
    """Return the indices that sort `rank` (stable), and where each rank begins in this order.

    The second result has a further element: the number of all elements.
    """
    count = int(rank.max(initial=-1)) + 1
    if count <= 1 << 16:
        rank = rank.astype(np.uint16)  # NumPy sorts 16 bits by radix
    order = np.argsort(rank, kind="stable")
    return order, np.searchsorted(rank[order], np.arange(count + 1)).tolist()


def best_values(
    states: States, value: Floats, steps: Slots | None = None, offsets: Floats | None = None
) -> Floats:
    """Return an upper bound of the value of each row's best path, (nodes,), by Viterbi.

    Let h be the best value of the paths that are at "none", and F_s that of the paths in state s.
    All are 0 at the beginning. At each of the `steps` (the result of `row_steps`), they change:

    1. ``h = max(h, F_t - lambda)`` for each state t that ends.
    2. ``F_s = max(F_t, h - lambda) + value_s`` for each state s that begins. In its pair, t is the
       state before s.
    3. ``h = h - r``, with the offset r of the step.

    The result of a row is the largest of its h and all its F at the end
    (docs/theory/certificate.md, "The bounds that are computed").
    """
    steps = steps or row_steps(states)
    if kernels:
        one = isinstance(states.problem.switch_price, float)
        values: Floats = kernels.upper_values(
            steps.begin,
            steps.first,
            states.pair_first,
            states.pair_row,
            states.begin,
            value,
            np.array([states.problem.switch_price]) if one else states.problem.switch_price_at,
            np.zeros(len(steps.step)) if offsets is None else offsets,
        )
        return values
    return _best_values(states, value, steps, offsets)


def _best_values(states: States, value: Floats, steps: Slots, offsets: Floats | None) -> Floats:
    """Compute `best_values` without kernels."""
    bounds, order, pairs, rows = turns(states, steps)
    value = value[order]
    count = np.diff(steps.first)
    at, lost = _ranked(np.arange(count.sum()) - np.repeat(steps.first[:-1], count))
    row_lost = np.repeat(np.arange(states.nodes), count)[at]
    offsets = np.zeros(len(at)) if offsets is None else offsets[at]

    unassigned_value = np.zeros(states.nodes)
    current = np.zeros(len(states.pair_row))  # 0, because a path can begin in any pair at no cost
    price: Floats = np.asarray(states.problem.switch_price)
    varies, switch_price = price.ndim > 0, states.problem.switch_price_at
    next_double, top = np.nextafter, np.array(np.inf)  # for `up` without a call of a function
    for (low, high), (first, last) in zip(
        itertools.pairwise(bounds), itertools.pairwise(lost), strict=True
    ):
        pair, row = pairs[low:high], rows[low:high]
        reached = current[pair]
        if varies:
            price = switch_price[states.begin[order[low:high]]]
        left = reached - price
        np.maximum.at(unassigned_value, row, next_double(left, top, left))
        enter = unassigned_value[row]
        enter -= price
        np.maximum(reached, next_double(enter, top, enter), out=reached)
        reached += value[low:high]
        current[pair] = next_double(reached, top, reached)
        if first < last:
            losing = row_lost[first:last]
            less = unassigned_value[losing]
            less -= offsets[first:last]
            unassigned_value[losing] = next_double(less, top, less)
    np.maximum.at(unassigned_value, states.pair_row, current)
    return unassigned_value
