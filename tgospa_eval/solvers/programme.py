"""The linear programme of some states, the others held, as sparse arrays; knows no LP solver."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.capacities import CapacityRows, capacity_rows

Long = NDArray[np.longdouble]


@dataclass(frozen=True, kw_only=True, eq=False)
class Moves:
    """Transitions that a rise of the weight is charged for: w[to] - w[source] <= constant + rise.

    Parameters
    ----------
    reward : (F,) long float array
        What all transitions add to the rewards of the free states.
    to, source : (A,) int arrays
        Positions among the free states; `source` counts only where `two` are free.
    two : (A,) bool array
    paid, constant : (A,) float arrays
    into : (A,) int array
        The later of the two states.
    """

    reward: Long
    to: Ints
    source: Ints
    two: NDArray[np.bool_]
    paid: Floats
    constant: Floats
    into: Ints


@dataclass(frozen=True, kw_only=True, eq=False)
class Programme:
    """Maximise reward x over 0 <= x <= upper with A x <= full.

    The columns of A are the free states, a rise for each transition, and for each constraint with a
    price what it leaves idle: there A x = full. Its rows are the capacities of the rows, those of
    the columns, and the transitions.

    Parameters
    ----------
    states : States
    free : (F,) int array
        The states that it decides, in order.
    moves : Moves
    rows, columns : CapacityRows
    idle : (I,) int array
        Rows of A that hold with equality.
    reward : float array
    row, column, entry : (nnz,) arrays
        A; nothing appears twice.
    full, upper : float arrays
    """

    states: States
    free: Ints
    moves: Moves
    rows: CapacityRows
    columns: CapacityRows
    idle: Ints
    reward: Floats
    row: Ints
    column: Ints
    entry: Floats
    full: Floats
    upper: Floats

    @cached_property
    def parts(self) -> tuple[slice, slice, slice]:
        """Columns of A: states, rises, idle."""
        a, b, c = np.cumsum([len(self.free), len(self.moves.to), len(self.idle)]).tolist()
        return slice(0, a), slice(a, b), slice(b, c)

    @cached_property
    def constraints(self) -> tuple[slice, slice, slice]:
        """Rows of A: capacities of the rows, of the columns, transitions."""
        a, b = len(self.rows.room), len(self.columns.room)
        return slice(0, a), slice(a, a + b), slice(a + b, len(self.full))

    @cached_property
    def anchor(self) -> Floats:
        """The prices as duals <= 0 of the constraints, 0 of those that have none."""
        dual = np.zeros(len(self.full))
        dual[self.constraints[1]] = -self.columns.price
        return dual

    @cached_property
    def least(self) -> Floats:
        """Lower bounds of A x: `full` where there is an idle column."""
        least = np.full(len(self.full), -np.inf)
        least[self.idle] = self.full[self.idle]
        return least

    @cached_property
    def spare(self) -> Ints:
        """Rows of A without an idle column."""
        spare = np.ones(len(self.full), bool)
        spare[self.idle] = False
        return np.flatnonzero(spare)

    def reduced(self, dual: Floats) -> Floats:
        """Reduced costs of the minimisation of -reward x at duals <= 0 of the constraints."""
        return -self.reward - np.bincount(
            self.column, self.entry * dual[self.row], len(self.reward)
        )

    @cached_property
    def offset(self) -> Long:
        """What the gains of each constraint of the rows have in common, 0 of other constraints.

        Gains are A + B - cost: beside the prices A and B small costs lose digits. A row slot with a
        gain is charged with A + B instead: its dual is that much smaller.
        """
        entry, constraint = self.states.entry[self.free], self.rows.constraint
        count = np.bincount(self.rows.state, minlength=len(entry))
        only = (count == 1) & (entry >= 0)
        mine = np.flatnonzero(only[self.rows.state])
        offset = np.zeros(len(self.full), np.longdouble)
        offset[constraint[mine]] = _prices(self.states, entry[self.rows.state[mine]])
        return offset

    def reduced_long(self, dual: Long) -> Long:
        """`reduced`, in long doubles, at the duals with `offset` added to them."""
        entry = self.states.entry[self.free]
        gains = np.flatnonzero(entry >= 0)
        cost = -self.reward.astype(np.longdouble)
        own = cost[self.parts[0]]
        own[:] = 0.0
        own[gains] -= _prices(self.states, entry[gains])
        np.add.at(own, self.rows.state, self.offset[self.rows.constraint])  # mostly 0 now
        own[gains] += self.states.problem.cost[entry[gains]]
        own -= self.moves.reward
        np.subtract.at(cost, self.column, self.entry * dual[self.row])
        return cost


def make_programme(
    states: States, free: Ints, weights: Floats, prices: Floats, switch_price: Floats
) -> Programme:
    """The programme of the free states, in order, the others held at their weights.

    maximise sum g_s w_s - sum_a price_a |w_a+1 - w_a| over w >= 0 with every slot at most full.
    |d| = 2 max(d, 0) - d leaves one column and one row for each transition a.
    """
    size = len(free)
    held = weights.copy()
    held[free] = 0.0
    moves = _moves(states, free, held, switch_price)
    rows = capacity_rows(states.rows, free, held)
    columns = capacity_rows(states.columns, free, held, prices)
    del held

    nr, nc, na = len(rows.room), len(columns.room), len(moves.paid)
    idle = nr + np.flatnonzero(columns.price)
    rise, two = nr + nc + np.arange(na), moves.two
    row = np.concatenate((rows.constraint, nr + columns.constraint, rise, rise[two], rise, idle))
    rises, slacks = size + np.arange(na), size + na + np.arange(len(idle))
    column = np.concatenate((rows.state, columns.state, moves.to, moves.source[two], rises, slacks))
    entry = np.ones(len(row))
    begin = len(rows.constraint) + len(columns.constraint) + na
    entry[begin : begin + two.sum() + na] = -1.0
    reward = np.concatenate(
        (
            states.gains(free) + moves.reward.astype(np.float64),
            -2.0 * moves.paid,
            np.zeros(len(idle)),
        )
    )
    upper = np.full(len(reward), np.inf)
    bare = np.ones(size, bool)
    bare[rows.state] = False
    upper[:size][bare] = 1.0
    return Programme(
        states=states,
        free=free,
        moves=moves,
        rows=rows,
        columns=columns,
        idle=idle,
        reward=reward,
        row=row,
        column=column,
        entry=entry,
        full=np.concatenate((rows.room, columns.room, moves.constant)),
        upper=upper,
    )


def _prices(states: States, entry: Ints) -> Long:
    """Prices A + B of leaving the pairs of some entries unassigned."""
    problem = states.problem
    price: Long = problem.truth_price[problem.truth_row[entry]].astype(np.longdouble)
    price += problem.estimate_price[problem.estimate_row[entry]]
    return price


def _moves(states: States, free: Ints, held: Floats, switch_price: Floats) -> Moves:
    """Transitions between a free state and the next of its pair, either of which may be held."""
    before = np.concatenate((free, free - 1))
    before.sort()
    before = before[np.diff(before, prepend=-2) > 0]
    is_last = np.zeros(len(held) + 1, bool)
    is_last[states.pair_first[1:] - 1] = True
    before = before[(before >= 0) & ~is_last[before]]
    a, b = _position(free, before), _position(free, before + 1)
    paid = switch_price[states.begin[before + 1]]
    constant = np.where(a < 0, held[before], held[before + 1])
    both = (a >= 0) & (b >= 0)
    own = np.maximum(a, b)  # the free one, if one is held
    reward = np.zeros(len(free), np.longdouble)
    np.add.at(reward, b[both], paid[both])
    np.subtract.at(reward, a[both], paid[both])
    one_held = ~both
    np.add.at(reward, own[one_held], np.where(constant > 0, paid, -paid)[one_held])
    part = one_held & (constant > 0) & (constant < 1)
    arcs = np.flatnonzero(both | part)
    return Moves(
        reward=reward,
        to=np.where(both, b, own)[arcs],
        source=a[arcs],
        two=both[arcs],
        paid=paid[arcs],
        constant=np.where(both, 0.0, constant)[arcs],
        into=before[arcs] + 1,
    )


def _position(ordered: Ints, sought: Ints) -> Ints:
    """Where each is in the ordered numbers, -1 where it is not."""
    at = np.minimum(np.searchsorted(ordered, sought), len(ordered) - 1)
    return np.where(ordered[at] == sought, at, -1)
