"""Capacities of slots as constraints of a linear programme on some chosen states.

The capacity of a slot is 1: the weights of its states sum to at most 1. If some weights are fixed,
the chosen states share the rest, the *room*. Other words and letters: `solvers`.
"""

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.states import Slots

SAME_ROOM = 1e-12
"""Difference below which the rooms of two slots count as equal."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CapacityRows:
    """Constraints of some states: the weights in each constraint sum to at most its room.

    Parameters
    ----------
    constraint, state : (nnz,) int arrays
        Which state is in which constraint. A state is named by its index among the chosen states.
    room : (L,) float array
        Room in each constraint: 1 minus the sum of the fixed weights in it.
    price : (L,) float array
        Sum of the prices of the slots of each constraint.
    slot, of_slot : (n,), (n,) int arrays
        The n slots that have a constraint, and the constraint of each.
    """

    constraint: Ints
    state: Ints
    room: Floats
    price: Floats
    slot: Ints
    of_slot: Ints

    def spread(self, new: Floats, prices: Floats) -> Floats:
        """Return new prices of the n slots from new prices (L,) of the constraints.

        `prices` (n,) are the previous prices of the slots. If the price of a constraint is higher
        than before, the difference is added to the price of its first slot. If it is lower, the
        prices of all its slots are scaled.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            factor = np.where(new < self.price, new / self.price, 1.0)
        spread = prices * factor[self.of_slot]
        first = np.flatnonzero(np.diff(self.of_slot, prepend=-1))
        spread[first] += np.maximum(new - self.price, 0.0)
        return spread


def capacity_rows(
    slots: Slots, chosen: Ints, fixed: Floats, prices: Floats | None = None
) -> CapacityRows:
    """Return the constraints of the chosen states; `fixed` (S,) are weights of the other states.

    Neighbouring slots with the same chosen states and the same room are one constraint. A slot
    needs no constraint if three conditions are true: it has one chosen state, its room is 1, and
    its price in `prices` (K,) is 0.
    """
    begin, end = slots.begin[chosen], slots.end[chosen]
    state = np.flatnonzero(end > begin)
    begin, end = begin[state], end[state]
    marked = np.zeros(len(fixed), bool)
    marked[chosen[state]] = True
    covers = slots.loads(marked)
    slot = np.flatnonzero(covers)
    covers = covers[slot]
    room = np.clip(1.0 - slots.loads(fixed)[slot], 0.0, 1.0)
    edge = np.zeros(len(slots.step) + 1, bool)
    edge[begin] = edge[end] = edge[slots.first] = True
    fresh = edge[slot]
    fresh[:1] = True
    fresh[1:] |= (np.diff(slot) > 1) | (np.abs(np.diff(room)) > SAME_ROOM)
    group = np.cumsum(fresh) - 1
    first = np.flatnonzero(fresh)
    covers, room = covers[first], room[first]
    price = np.zeros(len(first)) if prices is None else sum_by(group, prices[slot], len(first))
    needed = (covers > 1) | (room < 1) | (price > 0)
    number = np.where(needed, np.cumsum(needed) - 1, -1)

    low = group[np.searchsorted(slot, begin)]
    length = group[np.searchsorted(slot, end) - 1] + 1 - low
    entry = np.repeat(state, length)
    constraint = number[concatenated(low, length)]
    of_slot = number[group]
    return CapacityRows(
        constraint=constraint[constraint >= 0],
        state=entry[constraint >= 0],
        room=room[needed],
        price=price[needed],
        slot=slot[of_slot >= 0],
        of_slot=of_slot[of_slot >= 0],
    )
