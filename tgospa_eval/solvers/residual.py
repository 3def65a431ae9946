"""The residual linear programme: what prices could not settle, by HiGHS, the rest held.

HiGHS only proposes; bounds are evaluated on all states afterwards.
"""

import highspy
import numpy as np

from tgospa_eval.problem import Floats, Ints
from tgospa_eval.solvers.kernels import limits
from tgospa_eval.states import States


def residual(
    states: States,
    free: Ints,
    weights: Floats,
    prices: Floats,
    crossing: Floats,
    box: Floats,
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
    reward = states.gains(free)
    # Transitions between a free state and the next of its pair, either of which may be held.
    follows = np.zeros(len(weights) + 1, bool)
    follows[free] = follows[free + 1] = True
    follows[states.pair_first] = False
    before = np.flatnonzero(follows) - 1
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

    unpriced = np.zeros(len(states.rows.step))
    rows = limits(states.rows, free, held, unpriced, unpriced)
    columns = limits(states.columns, free, held, prices, box)
    nr, nc, na = len(rows.room), len(columns.room), len(arcs)
    low = np.maximum(columns.price - columns.box, 0.0)
    idle = np.flatnonzero(low > 0)
    over = np.flatnonzero(np.isfinite(columns.box))
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
    reward = np.concatenate(
        (reward, -2.0 * paid[arcs], low[idle], -(columns.price + columns.box)[over])
    )
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
    if status not in (highspy.HighsModelStatus.kOptimal, highspy.HighsModelStatus.kTimeLimit):
        highs.setOptionValue("solver", "ipm")
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
        ("parallel", "off"),  # the number of threads is shared with other users of HiGHS
        ("primal_feasibility_tolerance", 1e-9),
        ("dual_feasibility_tolerance", 1e-9),
    ):
        highs.setOptionValue(option, value)
    highs.passModel(lp)
    return highs
