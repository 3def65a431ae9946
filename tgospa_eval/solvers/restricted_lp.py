"""The linear programme of some states, solved by HiGHS; the weights of all other states are fixed.

A *linear programme* looks for numbers x (*variables*) that make a weighted sum ``reward x`` as
large as possible. Its *constraints* are upper limits of other weighted sums of x. The *slack of a
constraint* is the unused part of its limit. The *dual* of a constraint says how much the largest
reward would grow with the limit. If the constraint is the capacity of a column slot, its dual is
the price of the slot (or minus the price, if HiGHS minimises). The *reduced cost* of a variable is
what one more unit of it costs, if the room that it takes in constraints is paid at their duals. At
the optimum it is 0 for each variable that is strictly between its limits.

Some optimum is always at a corner (*vertex*) of the set of allowed x. A vertex has a *basis*: the
list of the variables and constraints that are *basic*. All others are at a limit. The *simplex
method* goes from one vertex to a better one until there is none. An *interior point method* reaches
an optimum in few but long iterations; a *crossover* then looks for a vertex.

The result is only a proposal: both bounds are computed on all states afterwards. The other words
and the letters of array sizes are in `solvers`.
"""

import time
from dataclasses import replace
from functools import cached_property

import highspy
import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.capacities import CapacityRows, capacity_rows

Long = NDArray[np.longdouble]


@dataclass(frozen=True, kw_only=True, eq=False)
class Programme:
    """Maximise reward x over 0 <= x <= upper with A x <= full.

    A *free* state is one whose weight the programme chooses. A *transition* is the change from a
    state of a pair to the next. The switch price of a transition is paid for rising and for falling
    weights. To express this, x has a *rise* for a transition: the increase of the weight, and zero
    if it falls. If one state is fixed, the rise is what the free weight exceeds the fixed one by,
    or zero. No rise is needed next to a fixed weight of 0 or 1, because the free weight can be only
    on one side of it.

    The columns of A are the weights of the free states, and then the rises. The rows of A are the
    capacities of the row slots, those of the column slots, and the transitions that have a rise.

    Parameters
    ----------
    states : States
        The problem.
    free : (F,) int array
        The free states, sorted.
    transition_reward : (F,) long float array
        Part of the reward of each free state that comes from its transitions.
    to, source : (A,) int arrays
        Later and earlier state of each transition that has a rise, as indices in `free`. The
        constraint of the transition is ``w[to] - w[source] <= constant + rise``. If one state of a
        transition is fixed, `to` is the free state, and `source` is not used.
    two : (A,) bool array
        True where both states of a transition are free.
    paid : (A,) float array
        Switch price of each transition.
    rows, columns : CapacityRows
        Capacities of the row slots and of the column slots.
    before : (L,) float array
        Previous prices of the L column slots in `columns.slot`.
    reward : float array
        Reward of each column of A.
    row, column, entry : (nnz,) arrays
        Row, column and value of each element of A that is not 0.
    full, upper : float arrays
        Limit of each row of A, and largest value of each column of A.
    unit : float
        Unit of the costs that HiGHS receives and of the duals that it returns, in c^p.
    """

    states: States
    free: Ints
    transition_reward: Long
    to: Ints
    source: Ints
    two: Mask
    paid: Floats
    rows: CapacityRows
    columns: CapacityRows
    before: Floats
    reward: Floats
    row: Ints
    column: Ints
    entry: Floats
    full: Floats
    upper: Floats
    unit: float

    @cached_property
    def parts(self) -> tuple[slice, slice]:
        """Ranges of the columns of A: free states, rises."""
        size = len(self.free)
        return slice(0, size), slice(size, size + len(self.to))

    @cached_property
    def constraints(self) -> tuple[slice, slice, slice]:
        """Ranges of the rows of A: row slots, column slots, transitions."""
        a, b = len(self.rows.room), len(self.columns.room)
        return slice(0, a), slice(a, a + b), slice(a + b, len(self.full))

    @cached_property
    def potentials(self) -> Floats:
        """Duals >= 0 of all constraints that fit the prices; see `_potentials`."""
        return _potentials(self)

    @cached_property
    def anchor(self) -> Floats:
        """Duals <= 0 of all constraints, near the best ones. HiGHS computes differences to them.

        They are <= 0 because HiGHS minimises. The duals of column slots are minus the prices. With
        compiled kernels, the duals of row slots are minus the `potentials`, and the duals of
        transitions are minus the switch prices. Without kernels, both are 0.
        """
        dual = np.zeros(len(self.full))
        rows, columns, transitions = self.constraints
        dual[columns] = -self.columns.price
        if kernels:
            dual[rows] = -self.potentials[rows]
            dual[transitions] = -self.paid
        return dual

    @cached_property
    def idle(self) -> Ints:
        """Constraints with a dual other than 0 in `anchor`.

        For each of them, the model of HiGHS has an additional column with a cost: the slack.
        """
        return np.flatnonzero(self.anchor)

    @cached_property
    def spare(self) -> Ints:
        """Constraints that are not `idle`."""
        return np.flatnonzero(self.anchor == 0)

    def reduced(self, dual: Floats) -> Floats:
        """Return the reduced costs at duals <= 0, for the minimisation of -reward x."""
        return -self.reward - np.bincount(
            self.column, self.entry * dual[self.row], len(self.reward)
        )

    @cached_property
    def offset(self) -> Long:
        """Part A + B of the gains that is moved to the constraint of each row slot; 0 elsewhere.

        A gain is A + B - cost, with the prices A and B of leaving object and estimate unassigned. A
        small cost would lose digits in this sum. So `refine` uses gains without A + B, and adds A +
        B to the dual of the row slot instead.
        """
        entry, constraint = self.states.entry[self.free], self.rows.constraint
        count = np.bincount(self.rows.state, minlength=len(entry))
        only = (count == 1) & (entry >= 0)
        mine = np.flatnonzero(only[self.rows.state])
        offset = np.zeros(len(self.full), np.longdouble)
        offset[constraint[mine]] = _prices(self.states, entry[self.rows.state[mine]])
        return offset

    def reduced_long(self, dual: Long) -> Long:
        """Return the reduced costs in long doubles; `dual` is the sum of the duals and `offset`."""
        entry = self.states.entry[self.free]
        gains = np.flatnonzero(entry >= 0)
        cost = -self.reward.astype(np.longdouble)
        own = cost[self.parts[0]]
        own[:] = 0.0
        own[gains] -= _prices(self.states, entry[gains])
        np.add.at(own, self.rows.state, self.offset[self.rows.constraint])  # the result is mostly 0
        own[gains] += self.states.problem.cost[entry[gains]]
        own -= self.transition_reward
        np.subtract.at(cost, self.column, self.entry * dual[self.row])
        return cost


def make_programme(
    states: States,
    free: Ints,
    weights: Floats,
    prices: Floats,
    switch_price: Floats,
    unit: float = 1.0,
) -> Programme:
    """Build the programme of the free states (sorted); other states are fixed at their weights.

    The programme maximises

        sum_s gain_s w_s - sum_a price_a |change_a|

    over states s and transitions a, with weights w >= 0 that sum to at most 1 in every slot.
    price_a is the switch price of the transition, and change_a its change of weight. Since
    ``|d| = 2 max(d, 0) - d``, one column and one row of A are enough for each transition.
    """
    size = len(free)
    fixed = weights.copy()
    fixed[free] = 0.0
    transition_reward, to, source, two, paid, constant = _moves(states, free, fixed, switch_price)
    rows = capacity_rows(states.rows, free, fixed)
    columns = capacity_rows(states.columns, free, fixed, prices)
    del fixed

    nr, nc, na = len(rows.room), len(columns.room), len(paid)
    rise = nr + nc + np.arange(na)
    row = np.concatenate((rows.constraint, nr + columns.constraint, rise, rise[two], rise))
    rises = size + np.arange(na)
    column = np.concatenate((rows.state, columns.state, to, source[two], rises))
    entry = np.ones(len(row))
    entry[len(rows.constraint) + len(columns.constraint) + na :] = -1.0
    reward = np.concatenate(
        (states.gains(free) + transition_reward.astype(np.float64), -2.0 * paid)
    )
    upper = np.full(len(reward), np.inf)
    bare = np.ones(size, bool)
    bare[rows.state] = False
    upper[:size][bare] = 1.0
    return Programme(
        states=states,
        free=free,
        transition_reward=transition_reward,
        to=to,
        source=source,
        two=two,
        paid=paid,
        rows=rows,
        columns=columns,
        before=prices[columns.slot],
        reward=reward,
        row=row,
        column=column,
        entry=entry,
        full=np.concatenate((rows.room, columns.room, constant)),
        upper=upper,
        unit=unit,
    )


def _prices(states: States, entry: Ints) -> Long:
    """Return the price A + B of leaving object and estimate of some entries unassigned."""
    problem = states.problem
    price: Long = problem.truth_price[problem.truth_row[entry]].astype(np.longdouble)
    price += problem.estimate_price[problem.estimate_row[entry]]
    return price


def _moves(
    states: States, free: Ints, fixed: Floats, switch_price: Floats
) -> tuple[Long, Ints, Ints, Mask, Floats, Floats]:
    """Return the transitions from or to a free state.

    The result has `transition_reward`, `to`, `source`, `two` and `paid` of a `Programme`, and then
    the constant of each transition that has a rise.
    """
    before = np.concatenate((free, free - 1))
    before.sort()
    before = before[np.diff(before, prepend=-2) > 0]
    is_last = np.zeros(len(fixed) + 1, bool)
    is_last[states.pair_first[1:] - 1] = True
    before = before[(before >= 0) & ~is_last[before]]
    a, b = _position(free, before), _position(free, before + 1)
    paid = switch_price[states.begin[before + 1]]
    constant = np.where(a < 0, fixed[before], fixed[before + 1])
    both = (a >= 0) & (b >= 0)
    own = np.maximum(a, b)  # the free one, if one is fixed
    reward = np.zeros(len(free), np.longdouble)
    np.add.at(reward, b[both], paid[both])
    np.subtract.at(reward, a[both], paid[both])
    one_fixed = ~both
    np.add.at(reward, own[one_fixed], np.where(constant > 0, paid, -paid)[one_fixed])
    part = one_fixed & (constant > 0) & (constant < 1)
    arcs = np.flatnonzero(both | part)
    constant = np.where(both, 0.0, constant)[arcs]
    return reward, np.where(both, b, own)[arcs], a[arcs], both[arcs], paid[arcs], constant


def _position(ordered: Ints, sought: Ints) -> Ints:
    """Return the index of each `sought` number in the `ordered` numbers, -1 if it is missing."""
    at = np.minimum(np.searchsorted(ordered, sought), len(ordered) - 1)
    return np.where(ordered[at] == sought, at, -1)


# -------------------------------------------------------------------------------------------------
# A basis from which the simplex method starts. It is computed from the prices.
#
# It need not be valid: HiGHS adds constraints to it, and removes columns, as necessary. It only
# changes the number of iterations.


MIN_STATES = 300
"""Fewest free states for which a basis is suggested. Smaller programmes take milliseconds."""

BASIC = 1e-10
"""Limit below which reduced costs and duals count as 0."""


def suggest(p: Programme) -> tuple[Mask, Mask] | None:
    """Suggest a basis from the prices; None if the programme is small.

    Basic are the columns with a reduced cost near 0, and the constraints with a dual near 0. The
    duals of row slots and transitions come from `_potentials`, because prices do not determine
    them.
    """
    if not kernels or len(p.free) < MIN_STATES:
        return None
    dual, zero = p.potentials, BASIC * p.unit
    rows = dual <= zero
    rows[p.constraints[1]] = True
    columns = np.abs(p.reduced(-dual)) <= zero
    return np.append(columns, dual[p.idle] <= zero), rows


def _potentials(p: Programme) -> Floats:
    """Return duals >= 0 of all constraints that fit the prices.

    They come from the best paths of each row from the past. Let h be the largest value up to a time
    of a path that is then at "none". Let F be the same for a path that is then at the end of state
    s. The dual of a row slot is the increase of h over the slot. The dual of a transition from s is
    lambda - (F - h), with its switch price lambda. F - h is limited to [-lambda, lambda].
    """
    size = len(p.free)
    source, to, paid = p.source[p.two], p.to[p.two], p.paid[p.two]
    value = p.reward[:size].copy()
    value[to] -= paid
    value[source] += paid
    np.subtract.at(value, p.columns.state, p.columns.price[p.columns.constraint])
    leave = np.zeros(size)
    leave[source] = paid
    follows = np.zeros(size, np.uint8)
    follows[to] = True

    low, high, row, first = _spans(p)
    none, through = kernels.row_potentials(
        np.argsort(high, kind="stable").astype(np.int32),
        row.astype(np.int32),
        first.astype(np.int32),
        low.astype(np.int32),
        high.astype(np.int32),
        value,
        leave,
        follows,
    )
    inner = np.ones(len(none), bool)
    inner[first[1:] - 1] = False
    dual = np.empty(len(p.full))
    rows, columns, transitions = p.constraints
    dual[rows] = np.diff(none, append=0.0)[inner]
    dual[columns] = p.columns.price
    dual[transitions] = p.paid
    dual[transitions][p.two] -= through[source]
    return np.maximum(dual, 0.0)


def _spans(p: Programme) -> tuple[Ints, Ints, Ints, Ints]:
    """Return the borders between which free states lie.

    Each row has a *border* before its first constraint, and one after each constraint. Borders are
    numbered row by row. If a state has no constraint, its first and its last border are the same:
    the last border of the state before it in its pair.

    Returns
    -------
    tuple
        First border, last border and row of each free state; and the first border of each row.
    """
    states, size = p.states, len(p.free)
    pair = states.pairs_of(p.free)
    used, row = np.unique(states.pair_row[pair], return_inverse=True)
    row_of = np.zeros(len(p.rows.room), np.intp)
    row_of[p.rows.constraint] = row[p.rows.state]
    base = np.searchsorted(row_of, np.arange(len(used))) + np.arange(len(used))
    first = np.flatnonzero(np.diff(p.rows.state, prepend=-1))
    last = np.flatnonzero(np.diff(p.rows.state, append=-1))
    low, high = np.full(size, -1), np.full(size, -1)
    has = p.rows.state[first]
    low[has] = p.rows.constraint[first] + row[has]
    high[has] = p.rows.constraint[last] + 1 + row[has]
    known = low >= 0
    opens = known | (np.diff(pair, prepend=-1) != 0)
    before = np.maximum.accumulate(np.where(opens, np.arange(size), 0))
    border = np.where(known[before], high[before], base[row])
    return (
        np.where(known, low, border),
        np.where(known, high, border),
        row,
        np.append(base, len(row_of) + len(used)),
    )


LARGE_LP, ITERATIONS_EACH, WORK_EACH, SAMPLED_ROWS = 2000, 2.0, 150, 6
"""Limits of the simplex method. A programme of LARGE_LP constraints or more is *large*. In a large
programme, the simplex method may use ITERATIONS_EACH iterations for each constraint, and the work
WORK_EACH for each constraint. The work of an iteration is the mean number of nonzeros in a row of
the inverse matrix of the basis, estimated from SAMPLED_ROWS rows. It is 5 to 20 as a rule, but
2,000 if very many costs are equal. Beyond these limits the interior point method is up to ten times
faster. In other programmes it is two to four times slower."""

TAKEN_FOR_ZERO = 1e-9
"""Tolerance of HiGHS for constraints and for reduced costs."""

SCALE, SHIFT = 2.0**70, 2.0**20
"""Largest factor by which `refine` multiplies costs, and limit to which it clips the products."""

ROOMIER = 1e-6
"""Additional room in the column slots while duals are refined. With it, HiGHS finds the smallest of
the best prices. Small prices are better, because they keep more digits. A basis that is optimal
with this room is optimal without it."""

DUAL_VIOLATION, REFINEMENTS = 1e-25, 4
"""Largest error of a dual after refinement, and largest number of refinements."""

DENOMINATORS, SNAP_FRACTION = 64, 1e-9
"""A weight is rounded to a fraction with a denominator of at most DENOMINATORS, if the fraction
differs from it by at most SNAP_FRACTION."""

SNAP_EXCESS = 1e-13
"""Largest excess of rounded weights over a capacity."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """Proposed weights of the free states of a programme, and proposed prices of column slots.

    Parameters
    ----------
    weights : (F,) float array
        Weights of the free states.
    slot, prices : (L,), (L,) arrays
        Column slots of the free states, and their new prices.
    iterations : int
        Iterations of the simplex method, or of the interior point method and the crossover.
    finished : bool
        Whether an optimum was reached.
    interior : bool
        True if the simplex method would have taken too long.
    vertex : tuple, optional
        Start of `refine`, if HiGHS reached an optimum: the programme, the duals of its constraints
        (<= 0 because HiGHS minimises), and the basis as an object of HiGHS.
    """

    weights: Floats
    slot: Ints
    prices: Floats
    iterations: int
    finished: bool
    interior: bool = False
    vertex: tuple[Programme, Long, highspy.HighsBasis] | None = None


def solve_restricted_lp(
    states: States,
    free: Ints,
    weights: Floats,
    prices: Floats,
    switch_price: Floats,
    seconds: float | None,
    *,
    unit: float = 1.0,
    interior: bool = False,
) -> Proposal:
    """Return the best weights of the free states, and prices; all other states stay fixed.

    `free` must be sorted. The simplex method is tried first. If `interior` is True and the
    programme is large (`LARGE_LP`), the interior point method is tried first.
    """
    p = make_programme(states, free, weights, prices, switch_price, unit)
    highs, finished, iterations, dense = _solve(p, interior, seconds)
    answer = highs.getSolution()
    if not (answer.value_valid and answer.dual_valid):
        return Proposal(
            weights=weights[free],
            slot=p.columns.slot,
            prices=p.before,
            iterations=0,
            finished=False,
        )
    dual = np.asarray(answer.row_dual) * p.unit + p.anchor
    long = np.minimum(dual, 0.0).astype(np.longdouble)
    return Proposal(
        weights=_snapped(p, np.asarray(answer.col_value)),
        slot=p.columns.slot,
        prices=_spread(p, dual),
        iterations=iterations,
        finished=finished,
        interior=dense,
        vertex=(p, long, highs.getBasis()) if finished else None,
    )


SOFT = 0.01
"""Stiffness (`solvers.interior_point`) of the duals of row slots and transitions, as a fraction of
that of prices. It is small, because these duals are not kept."""


def solve_interior(
    states: States,
    free: Ints,
    weights: Floats,
    prices: Floats,
    switch_price: Floats,
    seconds: float | None,
    shares: Floats,
    *,
    exact: bool,
) -> Proposal | None:
    """Solve by `solvers.interior_point`; None if this method breaks down.

    The parameters are those of `solve_restricted_lp`. The method starts from the weights `shares`
    (F,) and from `prices`. Among the optimal prices, it returns those nearest to `prices`. If
    `exact` is True, the result is exact up to rounding. The method needs the compiled kernels.
    """
    from scipy import sparse  # lazy: slow to import and rarely needed

    from tgospa_eval.solvers.interior_point import Inequalities, solve_nearest

    p = make_programme(states, free, weights, prices, switch_price)
    deadline = None if seconds is None else time.monotonic() + seconds
    size = len(free)
    bare = np.flatnonzero(np.isfinite(p.upper))  # upper bounds become constraints
    inner = p.column < size
    ends = len(p.full), len(p.full) + len(bare)
    row = np.append(p.row[inner], np.arange(*ends))
    column, entry = np.append(p.column[inner], bare), np.append(p.entry[inner], np.ones(len(bare)))
    matrix = sparse.csr_array((entry, (row, column)), shape=(ends[1], size))
    task = Inequalities(
        matrix=matrix,
        full=np.append(p.full, np.ones(len(bare))),
        reward=p.reward[:size],
        rises=np.arange(p.constraints[2].start, ends[0]),
        paid=-p.reward[p.parts[1]],
    )
    near = np.append(p.potentials, np.maximum(-p.reduced(-p.potentials)[bare], 0.0))

    stiff = np.full(ends[1], SOFT)
    stiff[p.constraints[1]] = 1.0
    point = solve_nearest(task, (shares, near), stiff, lambda: _over(deadline), exact=exact)
    if point is None:
        return None
    new = p.columns.spread(point[1][p.constraints[1]], p.before)
    return Proposal(
        weights=_snapped(p, point[0]), slot=p.columns.slot, prices=new, iterations=0, finished=True
    )


def refine(proposal: Proposal, seconds: float | None) -> Proposal:
    """Improve the prices of a proposal, whose error may be 1e-9, to the last digit.

    The reduced costs at the current duals y are computed in long doubles, and multiplied by a large
    factor s. HiGHS minimises with them as costs, from the same basis and with the same constraints.
    Its duals y', divided by s, are the correction: y is replaced by ``y + y' / s``. This is
    repeated. The slack of every constraint is a column of the model, because it has a cost. Source:
    Gleixner, Steffy and Wolter, "Iterative refinement for linear programming" (INFORMS Journal on
    Computing 2016).
    """
    if proposal.vertex is None:
        return proposal
    p, dual, basis = proposal.vertex
    dual = dual + p.offset
    free = np.append(np.isinf(p.upper), np.ones(len(dual), bool))
    columns, rows = _basic(basis)
    size = len(p.reward)
    slack = rows.copy()
    slack[p.idle] = columns[size:]
    basic = np.append(columns[:size], slack)
    rows[p.spare] = False
    deadline = None if seconds is None else time.monotonic() + seconds
    highs = _highs(_model(p, np.arange(len(dual))))
    highs.setBasis(_basis(basic, rows))
    _set_room(highs, p, ROOMIER)
    iterations, solved = proposal.iterations, False
    for _ in range(REFINEMENTS):
        cost = np.append(p.reduced_long(dual), p.offset - dual)
        wrong = float(np.where(basic, np.abs(cost), np.where(free, -cost, 0.0)).max(initial=0.0))
        if solved and wrong <= DUAL_VIOLATION:
            break
        scale = min(SCALE, 2.0 ** -np.ceil(np.log2(max(wrong, 1e-40))))
        scaled = np.clip((cost * scale).astype(np.float64), -SHIFT, SHIFT)
        highs.changeColsCost(len(cost), np.arange(len(cost), dtype=np.int32), scaled)
        solved, done = _run(highs, deadline)
        iterations += done
        if not solved:
            break
        answer = highs.getSolution()
        dual += np.asarray(answer.row_dual).astype(np.longdouble) / scale
        np.minimum(dual, p.offset, out=dual)
        basic, _ = _basic(highs.getBasis())
    weights = proposal.weights
    if solved:
        _set_room(highs, p, 0.0)
        solved, done = _run(highs, deadline)
        iterations += done
        if solved:
            weights = _snapped(p, np.asarray(highs.getSolution().col_value))
    return replace(
        proposal,
        weights=weights,
        prices=_spread(p, dual.astype(np.float64)),
        iterations=iterations,
        vertex=None,
    )


def _set_room(highs: highspy.Highs, p: Programme, more: float) -> None:
    """Add `more` room to the column slots, in a model in which every slack is a column."""
    columns = p.constraints[1]
    for row, room in enumerate((p.full[columns] + more).tolist(), columns.start):
        highs.changeRowBounds(row, room, room)


def _spread(p: Programme, dual: Floats) -> Floats:
    """Return new prices of the column slots from the duals of all constraints."""
    return p.columns.spread(np.maximum(-dual[p.constraints[1]], 0.0), p.before)


def _snapped(p: Programme, values: Floats) -> Floats:
    """Return the weights, rounded to fractions with small denominators if capacities allow this.

    HiGHS returns weights with errors up to 1e-9. The exact weights at a vertex are fractions,
    mostly 0, 1, 1/2 or 1/3.
    """
    weights = np.clip(values[p.parts[0]], 0.0, 1.0)
    left = np.flatnonzero((weights != 0) & (weights != 1))
    snapped = weights.copy()
    for denominator in range(1, DENOMINATORS + 1):
        if not len(left):
            break
        whole = np.rint(weights[left] * denominator) / denominator
        near = np.abs(whole - weights[left]) <= SNAP_FRACTION
        snapped[left[near]] = whole[near]
        left = left[~near]
    for capacity in (p.rows, p.columns):
        room = capacity.room + SNAP_EXCESS
        over = np.bincount(capacity.constraint, snapped[capacity.state], len(room)) - room
        was = np.bincount(capacity.constraint, weights[capacity.state], len(room)) - room
        if np.any(over > np.maximum(was, 0.0)):
            return weights
    return snapped


def _model(p: Programme, slack: Ints) -> highspy.HighsLp:
    """Return the programme for HiGHS, with the reduced costs at `anchor` as costs to minimise.

    So its duals are differences to `anchor`. The model has an additional column for the slack of
    each constraint in `slack`.
    """
    row = np.append(p.row, slack)
    column = np.append(p.column, len(p.upper) + np.arange(len(slack)))
    entry = np.append(p.entry, np.ones(len(slack)))
    cost = np.append(p.reduced(p.anchor), -p.anchor[slack])
    upper = np.append(p.upper, np.full(len(slack), np.inf))
    lower = np.full(len(p.full), -np.inf)
    lower[slack] = p.full[slack]
    order = np.argsort(column, kind="stable")
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = len(cost), len(p.full)
    lp.col_cost_ = cost.astype(np.float64) / p.unit
    lp.col_lower_ = np.zeros(len(cost))
    lp.col_upper_ = upper
    lp.row_lower_ = lower
    lp.row_upper_ = p.full
    lp.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    lp.a_matrix_.start_ = np.append(0, np.cumsum(np.bincount(column, minlength=len(cost))))
    lp.a_matrix_.index_ = row[order].astype(np.int32)
    lp.a_matrix_.value_ = entry[order]
    return lp


class _Silent(highspy.Highs):
    """HiGHS without output.

    Since HiGHS 1.16.0, the constructor calls `enableCallbacks`, which prints a banner before any
    option can be set. Here `enableCallbacks` only switches the output off, because callbacks are
    not used.
    """

    def enableCallbacks(self) -> None:  # noqa: N802
        self.setOptionValue("output_flag", False)


def _highs(model: highspy.HighsLp) -> highspy.Highs:
    """Return HiGHS with the model and the options of this package."""
    highs = _Silent()  # type: ignore[no-untyped-call]
    for option, value in (
        ("output_flag", False),
        ("presolve", "off"),
        ("solver", "simplex"),
        ("parallel", "off"),  # the number of threads is shared with other users of HiGHS
        ("primal_feasibility_tolerance", TAKEN_FOR_ZERO),
        ("dual_feasibility_tolerance", TAKEN_FOR_ZERO),
    ):
        highs.setOptionValue(option, value)
    highs.passModel(model)
    return highs


def _solve(
    p: Programme, interior: bool, seconds: float | None
) -> tuple[highspy.Highs, bool, int, bool]:
    """Run HiGHS until it reaches an optimum, or until the time is over.

    First comes the simplex method, unless `interior` is True and the programme is large. If it
    fails or takes long, the interior point method with crossover is next. If both fail, the simplex
    method runs without a limit of iterations.

    Returns
    -------
    tuple
        HiGHS; whether it reached an optimum; number of iterations; and whether the simplex method
        would take too long.
    """
    deadline = None if seconds is None else time.monotonic() + seconds
    large = len(p.full) >= LARGE_LP
    interior &= large
    model = _model(p, p.idle)
    simplex, iterations = _highs(model), 0
    if not interior:
        start = suggest(p)
        if start is not None:
            simplex.setBasis(_basis(*start))
        finished, iterations = (_portions if large else _run)(simplex, deadline)
        if finished or _over(deadline):
            return simplex, finished, iterations, False
    highs = _highs(model)
    highs.setOptionValue("solver", "ipm")
    highs.setOptionValue("presolve", "on")  # without it, ties keep errors above the tolerances
    finished, done = _run(highs, deadline)
    iterations += done
    if finished or _over(deadline):
        return highs if finished or interior else simplex, finished, iterations, large
    simplex.setOptionValue("simplex_iteration_limit", np.iinfo(np.int32).max)
    finished, done = _run(simplex, deadline)
    return simplex, finished, iterations + done, False


def _portions(highs: highspy.Highs, deadline: float | None) -> tuple[bool, int]:
    """Run the simplex method within the limits of `LARGE_LP`; return the results of `_run`."""
    rows = highs.getNumRow()
    done, work, portion = 0, 0.0, 3 * rows // 8
    while True:
        highs.setOptionValue("simplex_iteration_limit", portion)
        finished, iterations = _run(highs, deadline)
        done += iterations
        stopped = highs.getModelStatus() == highspy.HighsModelStatus.kIterationLimit
        if not stopped or done > ITERATIONS_EACH * rows:
            return finished, done
        work += iterations * _density(highs, rows)
        if work > WORK_EACH * rows:
            return finished, done
        portion = done  # runs become longer: if many costs are equal, short runs do not progress


def _density(highs: highspy.Highs, rows: int) -> float:
    """Estimate the mean number of nonzeros in a row of the inverse matrix of the basis."""
    sample = np.linspace(0, rows - 1, SAMPLED_ROWS).astype(int).tolist()
    sampled = [highs.getBasisInverseRowSparse(row) for row in sample]  # type: ignore[attr-defined]
    return float(np.mean([count for _, _, count, *_ in sampled]))


def _over(deadline: float | None) -> bool:
    return deadline is not None and time.monotonic() >= deadline


def _run(highs: highspy.Highs, deadline: float | None) -> tuple[bool, int]:
    """Run until the deadline; return whether the optimum is reached, and the iterations."""
    if deadline is not None:
        # HiGHS compares its time limit with the total time of all runs of a model.
        left = max(deadline - time.monotonic(), 0.0)
        highs.setOptionValue("time_limit", highs.getRunTime() + left)
    highs.run()
    info = highs.getInfo()
    counts = info.simplex_iteration_count, info.ipm_iteration_count, info.crossover_iteration_count
    finished = highs.getModelStatus() == highspy.HighsModelStatus.kOptimal
    return finished, sum(max(int(count), 0) for count in counts)


def _basic(basis: highspy.HighsBasis) -> tuple[Mask, Mask]:
    """Return which columns and which constraints are basic."""
    basic = highspy.HighsBasisStatus.kBasic
    return (
        np.array([status == basic for status in basis.col_status], bool),
        np.array([status == basic for status in basis.row_status], bool),
    )


def _basis(columns: Mask, rows: Mask) -> highspy.HighsBasis:
    """Return a starting basis, which need not be valid."""
    status = highspy.HighsBasisStatus
    basis = highspy.HighsBasis()
    basis.col_status = [status.kBasic if basic else status.kLower for basic in columns.tolist()]
    basis.row_status = [status.kBasic if basic else status.kUpper for basic in rows.tolist()]
    basis.valid = basis.alien = True
    return basis
