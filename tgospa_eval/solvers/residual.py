"""The residual linear programme: what prices could not settle, by HiGHS, the rest held.

HiGHS only proposes; bounds are evaluated on all states afterwards.
"""

from dataclasses import dataclass

import highspy
import numpy as np
from numpy.typing import NDArray

from tgospa_eval.problem import Floats, Ints
from tgospa_eval.solvers.limits import limits
from tgospa_eval.states import States


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """What a programme says of its states and of the slots that they compete for.

    Parameters
    ----------
    weights : (F,) float array
        Of the free states.
    slot, prices : (k,), (k,) arrays
        Column slots, and their new prices.
    iterations : int
        Of the simplex.
    finished : bool
        Whether HiGHS says that it is optimal.
    """

    weights: Floats
    slot: Ints
    prices: Floats
    iterations: int
    finished: bool


def residual(
    states: States,
    free: Ints,
    weights: Floats,
    prices: Floats,
    crossing: Floats,
    box: float,
    seconds: float | None,
) -> Proposal:
    """Weights and prices that are best for the free states, the others held at their weights.

    maximise sum g_s w_s - sum_a price_a |w_a+1 - w_a| over w >= 0 with every slot at most full.
    |d| = 2 max(d, 0) - d leaves one column and one row for each transition a. Prices stay within
    `box` of where they are: leaving a slot idle earns the lowest, overfilling it costs the highest.
    `free` comes in order.
    """
    size = len(free)
    held = weights.copy()
    held[free] = 0.0
    moves = _moves(states, free, held, crossing)
    rows = limits(states.rows, free, held)
    columns = limits(states.columns, free, held, prices)
    del held

    nr, nc, na = len(rows.room), len(columns.room), len(moves.paid)
    low = np.maximum(columns.price - box, 0.0)
    idle = np.flatnonzero(low > 0)
    over = np.arange(nc if np.isfinite(box) else 0)
    rise, two = nr + nc + np.arange(na), moves.two
    row = np.concatenate(
        (rows.limit, nr + columns.limit, rise, rise[two], rise, nr + idle, nr + over)
    )
    rises = size + np.arange(na)
    slacks = size + na + np.arange(len(idle) + len(over))
    column = np.concatenate((rows.state, columns.state, moves.to, moves.source[two], rises, slacks))
    entry = np.ones(len(row))
    begin = len(rows.limit) + len(columns.limit) + na
    entry[begin : begin + two.sum() + na] = -1.0
    entry[len(row) - len(over) :] = -1.0
    reward = np.concatenate(
        (
            states.gains(free) + moves.reward,
            -2.0 * moves.paid,
            low[idle],
            -(columns.price + box)[over],
        )
    )
    full = np.concatenate((rows.room, columns.room, moves.constant))
    upper = np.full(len(reward), np.inf)
    bare = np.ones(size, bool)
    bare[rows.state] = False
    upper[:size][bare] = 1.0

    answer, iterations, finished = _run(_load(reward, row, column, entry, full, upper), seconds)
    if answer is None:
        return Proposal(
            weights=weights[free],
            slot=columns.slot,
            prices=prices[columns.slot],
            iterations=iterations,
            finished=False,
        )
    dual = np.maximum(-np.asarray(answer.row_dual)[nr : nr + nc], 0.0)
    return Proposal(
        weights=np.clip(np.asarray(answer.col_value)[:size], 0.0, 1.0),
        slot=columns.slot,
        prices=columns.spread(dual, prices[columns.slot]),
        iterations=iterations,
        finished=finished,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Moves:
    """Transitions that a rise of the weight is charged for: w[to] - w[source] <= constant + rise.

    Parameters
    ----------
    reward : (F,) float array
        What all transitions add to the rewards of the free states.
    to, source : (A,) int arrays
        Positions among the free states; `source` counts only where `two` are free.
    two : (A,) bool array
    paid, constant : (A,) float arrays
    """

    reward: Floats
    to: Ints
    source: Ints
    two: NDArray[np.bool_]
    paid: Floats
    constant: Floats


def _moves(states: States, free: Ints, held: Floats, crossing: Floats) -> _Moves:
    """Transitions between a free state and the next of its pair, either of which may be held."""
    before = np.concatenate((free, free - 1))
    before.sort()
    before = before[np.diff(before, prepend=-2) > 0]
    is_last = np.zeros(len(held) + 1, bool)
    is_last[states.pair_first[1:] - 1] = True
    before = before[(before >= 0) & ~is_last[before]]
    a, b = _position(free, before), _position(free, before + 1)
    paid = crossing[states.begin[before + 1]]
    constant = np.where(a < 0, held[before], held[before + 1])
    both = (a >= 0) & (b >= 0)
    own = np.maximum(a, b)  # the free one, if one is held
    reward = np.zeros(len(free))
    np.add.at(reward, b[both], paid[both])
    np.subtract.at(reward, a[both], paid[both])
    lone = ~both
    np.add.at(reward, own[lone], np.where(constant > 0, paid, -paid)[lone])
    part = lone & (constant > 0) & (constant < 1)
    arcs = np.flatnonzero(both | part)
    return _Moves(
        reward=reward,
        to=np.where(both, b, own)[arcs],
        source=a[arcs],
        two=both[arcs],
        paid=paid[arcs],
        constant=np.where(both, 0.0, constant)[arcs],
    )


def _position(ordered: Ints, sought: Ints) -> Ints:
    """Where each is in the ordered numbers, -1 where it is not."""
    at = np.minimum(np.searchsorted(ordered, sought), len(ordered) - 1)
    return np.where(ordered[at] == sought, at, -1)


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
        ("parallel", "off"),  # the number of threads is shared with other users of HiGHS
        ("primal_feasibility_tolerance", 1e-9),
        ("dual_feasibility_tolerance", 1e-9),
    ):
        highs.setOptionValue(option, value)
    highs.passModel(lp)
    return highs


def _run(
    highs: highspy.Highs, seconds: float | None
) -> tuple[highspy.HighsSolution | None, int, bool]:
    """The solution if there is one, iterations, and whether it is optimal."""
    if seconds is not None:
        highs.setOptionValue("time_limit", max(seconds, 0.0))
    highs.run()
    status = highs.getModelStatus()
    if status not in (highspy.HighsModelStatus.kOptimal, highspy.HighsModelStatus.kTimeLimit):
        highs.setOptionValue("solver", "ipm")
        highs.run()
        status = highs.getModelStatus()
    answer = highs.getSolution()
    if not (answer.value_valid and answer.dual_valid):
        return None, 0, False
    iterations = int(highs.getInfo().simplex_iteration_count)
    return answer, iterations, status == highspy.HighsModelStatus.kOptimal
