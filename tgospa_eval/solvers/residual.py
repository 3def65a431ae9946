"""The residual linear programme: what prices could not settle, by HiGHS, the rest held.

HiGHS only proposes; bounds are evaluated on all states afterwards.
"""

from dataclasses import dataclass

import highspy
import numpy as np

from tgospa_eval.problem import Floats, Ints
from tgospa_eval.states import Slots, States


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Capacity constraints on some states: sum of the states of each limit <= room.

    Parameters
    ----------
    limit, state : (nnz,) int arrays
        Limit, and position among the chosen states, of every entry.
    room : (L,) float array
        What the held states leave.
    price : (L,) float array
        Sum of the prices of its slots.
    of_slot : (K,) int array
        Limit of each slot, -1 where none is needed.
    """

    limit: Ints
    state: Ints
    room: Floats
    price: Floats
    of_slot: Ints

    def spread(self, new: Floats, prices: Floats) -> Floats:
        """Slot prices for new prices of the limits: the rise on the first slot, or all scaled."""
        slots = np.flatnonzero(self.of_slot >= 0)
        limit = self.of_slot[slots]
        spread = prices.copy()
        with np.errstate(invalid="ignore", divide="ignore"):
            factor = np.where(new < self.price, new / self.price, 1.0)
        spread[slots] *= factor[limit]
        first = slots[np.flatnonzero(np.diff(limit, prepend=-1))]
        spread[first] += np.maximum(new - self.price, 0.0)
        return spread


def limits(slots: Slots, chosen: Ints, held: Floats, prices: Floats) -> Limits:
    """The constraints of the chosen states where `held` (S,) of the others use the slots up.

    Neighbouring slots with the same states and the same room are one. Slots without a price that
    have room for their only state are left out.
    """
    count = len(slots.step)
    end = slots.end
    used = np.flatnonzero(held)
    load = np.cumsum(
        np.bincount(slots.begin[used], held[used], count + 1)
        - np.bincount(end[used], held[used], count + 1)
    )[:count]
    begin, end = slots.begin[chosen], end[chosen]
    state = np.flatnonzero(end > begin)
    begin, end = begin[state], end[state]
    room = np.clip(1.0 - load, 0.0, 1.0)
    fresh = np.zeros(count + 1, bool)
    fresh[begin] = fresh[end] = fresh[slots.first] = True
    fresh = fresh[:count]
    fresh[1:] |= np.abs(np.diff(room)) > 1e-12
    group = np.cumsum(fresh) - 1
    covers = np.cumsum(np.bincount(begin, minlength=count + 1) - np.bincount(end, minlength=count + 1))
    first = np.flatnonzero(fresh)
    covers, room = covers[first], room[first]
    price = np.bincount(group, prices, len(first))
    needed = (covers > 1) | ((covers > 0) & ((room < 1) | (price > 0)))
    number = np.where(needed, np.cumsum(needed) - 1, -1)

    length = group[end - 1] + 1 - group[begin]
    entry = np.repeat(state, length)
    offset = np.arange(len(entry)) - np.repeat(np.cumsum(length) - length, length)
    limit = number[np.repeat(group[begin], length) + offset]
    return Limits(
        limit=limit[limit >= 0],
        state=entry[limit >= 0],
        room=room[needed],
        price=price[needed],
        of_slot=number[group] if count else np.zeros(0, np.int64),
    )


def residual(
    states: States,
    free: Ints,
    weights: Floats,
    prices: Floats,
    crossing: Floats,
    box: float,
    seconds: float | None,
) -> tuple[Floats, Floats, int, bool]:
    """Weights and prices that are best for the free states, the others held at their weights.

    maximise sum g_s w_s - sum_a price_a |w_a+1 - w_a| over w >= 0 with every slot at most full.
    |d| = 2 max(d, 0) - d leaves one column and one row for each transition a. Prices stay within
    `box` of where they are: leaving a slot idle earns the lowest, overfilling it costs the highest.

    Returns
    -------
    weights, prices : (S,), (K,) float arrays
    iterations : int
    finished : bool
        Whether HiGHS says that it is optimal.
    """
    size = len(free)
    held = weights.copy()
    held[free] = 0.0
    number = np.full(len(weights), -1)
    number[free] = np.arange(size)
    reward = states.gain[free]
    # Transitions between a free state and the next of its pair, either of which may be held.
    is_last = np.zeros(len(weights) + 1, bool)
    is_last[states.pair_first[1:] - 1] = True
    before = np.union1d(free, free - 1)
    before = before[(before >= 0) & ~is_last[before]]
    a, b = number[before], number[before + 1]
    paid = crossing[states.begin[before + 1]]
    constant = np.where(a < 0, held[before], held[before + 1])
    both = (a >= 0) & (b >= 0)
    own = np.maximum(a, b)  # the free one, if one is held
    np.add.at(reward, b[both], paid[both])
    np.subtract.at(reward, a[both], paid[both])
    lone = ~both
    np.add.at(reward, own[lone], np.where(constant > 0, paid, -paid)[lone])
    part = lone & (constant > 0) & (constant < 1)
    arcs = np.flatnonzero(both | part)
    rising, falling = np.where(both, b, own)[arcs], a[arcs]

    rows = limits(states.rows, free, held, np.zeros(len(states.rows.step)))
    columns = limits(states.columns, free, held, prices)
    nr, nc, na = len(rows.room), len(columns.room), len(arcs)
    low = np.maximum(columns.price - box, 0.0)
    idle = np.flatnonzero(low > 0)
    over = np.arange(nc if np.isfinite(box) else 0)
    rise = nr + nc + np.arange(na)
    two = both[arcs]
    row = np.concatenate(
        (rows.limit, nr + columns.limit, rise, rise[two], rise, nr + idle, nr + over)
    )
    place = size + np.arange(na)
    column = np.concatenate(
        (
            rows.state,
            columns.state,
            rising,
            falling[two],
            place,
            size + na + np.arange(len(idle)),
            size + na + len(idle) + np.arange(len(over)),
        )
    )
    entry = np.ones(len(row))
    begin = len(rows.limit) + len(columns.limit) + na
    entry[begin : begin + two.sum() + na] = -1.0
    entry[len(row) - len(over) :] = -1.0
    reward = np.concatenate((reward, -2.0 * paid[arcs], low[idle], -(columns.price + box)[over]))
    full = np.concatenate((rows.room, columns.room, np.where(two, 0.0, constant[arcs])))
    upper = np.full(len(reward), np.inf)
    bare = np.ones(size, bool)
    bare[rows.state] = False
    upper[:size][bare] = 1.0

    highs = _load(reward, row, column, entry, full, upper)
    if seconds is not None:
        highs.setOptionValue("time_limit", max(seconds, 0.0))
    highs.run()
    status = highs.getModelStatus()
    answer = highs.getSolution()
    if not (answer.value_valid and answer.dual_valid):
        return weights, prices, 0, False
    held[free] = np.clip(np.asarray(answer.col_value)[:size], 0.0, 1.0)
    dual = np.maximum(-np.asarray(answer.row_dual)[nr : nr + nc], 0.0)
    return (
        held,
        columns.spread(dual, prices),
        int(highs.getInfo().simplex_iteration_count),
        status == highspy.HighsModelStatus.kOptimal,
    )


def _load(
    reward: Floats, row: Ints, column: Ints, entry: Floats, full: Floats, upper: Floats
) -> highspy.Highs:
    """A HiGHS model: maximise reward x over 0 <= x <= upper with sparse A x <= full."""
    order = np.lexsort((row, column))
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = len(reward), len(full)
    lp.col_cost_ = -reward
    lp.col_lower_ = np.zeros(len(reward))
    lp.col_upper_ = upper
    lp.row_lower_ = np.full(len(full), -np.inf)
    lp.row_upper_ = full
    lp.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    lp.a_matrix_.start_ = np.searchsorted(column[order], np.arange(len(reward) + 1))
    lp.a_matrix_.index_ = row[order].astype(np.int32)
    lp.a_matrix_.value_ = entry[order]
    highs = highspy.Highs()  # type: ignore[no-untyped-call]
    for option, value in (
        ("output_flag", False),
        ("presolve", "off"),
        ("solver", "simplex"),
        ("threads", 1),
        ("primal_feasibility_tolerance", 1e-9),
        ("dual_feasibility_tolerance", 1e-9),
    ):
        highs.setOptionValue(option, value)
    highs.passModel(lp)
    return highs
