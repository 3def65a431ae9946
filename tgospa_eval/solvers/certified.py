"""The exact solver: independent rows first, then the linear programme of what competes.

HiGHS only proposes; the bracket is made by `tgospa_eval.result.certify`.
"""

import time
from dataclasses import dataclass
from typing import ClassVar

import highspy
import numpy as np

from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem import Floats, Ints
from tgospa_eval.result import Solution
from tgospa_eval.solvers.kernels import (
    best_paths,
    better,
    capped_price,
    check_time_limit,
    incidence,
    settled,
)
from tgospa_eval.solvers.rounding import polish
from tgospa_eval.solvers.trivial import solve_trivial
from tgospa_eval.states import Block, States
from tgospa_eval.timing import Stopwatch


@dataclass(frozen=True, kw_only=True)
class Certified:
    """Exact, with proof (docs/theory, "The certified solver").

    Parameters
    ----------
    gap : float
        Relative gap of the total that counts as exact.
    time_limit : float, optional
        Seconds; what is reached by then is bracketed and returned.

    Raises
    ------
    ConfigError
        A setting is out of its range.
    """

    name: ClassVar[str] = "certified"
    gap: float = 1e-9
    time_limit: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "gap", real_number("gap", self.gap))
        if not 0 <= self.gap < np.inf:
            raise ConfigError(f"gap is {self.gap:g}: must be finite and 0 or more")
        object.__setattr__(self, "time_limit", check_time_limit(self.time_limit))

    def __call__(self, states: States, stopwatch: Stopwatch) -> Solution:
        """Solve every block exactly, or as far as the time limit allows."""
        deadline = None if self.time_limit is None else time.monotonic() + self.time_limit
        with stopwatch.span("solve/preparation"):
            weights, prices, left = solve_trivial(states, conflict_free=True)
        stopped = 0
        iterations = 0
        with stopwatch.span("solve/lp"):
            for block in states.blocks(left):
                seconds = None if deadline is None else deadline - time.monotonic()
                proposal = solve_block(states, block, seconds)
                weights[block.states] = proposal.weights
                prices[block.column_slots] = proposal.prices
                iterations += proposal.iterations
                stopped += not proposal.finished
        if stopped:
            weights = better(states, weights, best_paths(states, prices))
        weights, prices = polish(states, weights, prices)
        status = f"stopped early on {stopped} of {len(left)} components" if stopped else "solved"
        return Solution(
            weights=weights,
            prices=prices,
            status=status,
            iterations=iterations,
            finished=not stopped,
        )


def solve_block(states: States, block: Block, seconds: float | None) -> Solution:
    """One block as a linear programme, by the dual simplex of HiGHS without presolve.

    maximise sum g_s w_s - sum_a price_a |w_a+1 - w_a| over w >= 0 with every slot at most full;
    |d| = 2 max(d, 0) - d leaves one column and one row for each transition a. Presolve is off: it
    can cost ten times what the solve takes.
    """
    gain = states.gain[block.states]
    pair = states.pair[block.states]
    size = len(gain)
    arc = np.flatnonzero(pair[1:] == pair[:-1])
    price = capped_price(states, block.window, float(gain.max()))
    paid = price[states.begin[block.states][arc + 1] - block.window[0]]

    reward = np.concatenate((gain, -2.0 * paid))
    np.add.at(reward, arc + 1, paid)
    np.subtract.at(reward, arc, paid)
    row_slots = incidence(states.rows, block.states, block.row_slots)
    column_slots = incidence(states.columns, block.states, block.column_slots)
    slots_r = block.row_slots.stop - block.row_slots.start
    slots_c = block.column_slots.stop - block.column_slots.start
    rise = slots_r + slots_c + np.arange(len(arc))
    row = np.concatenate((row_slots[0], slots_r + column_slots[0], rise, rise, rise))
    column = np.concatenate(
        (row_slots[1], column_slots[1], arc + 1, arc, size + np.arange(len(arc)))
    )
    entry = np.ones(len(row))
    entry[len(row) - 2 * len(arc) :] = -1.0
    full = np.repeat((1.0, 0.0), (slots_r + slots_c, len(arc)))

    highs = _load(reward, row, column, entry, full)
    if seconds is not None:
        highs.setOptionValue("time_limit", max(seconds, 0.0))
    highs.run()
    if highs.getModelStatus() not in (
        highspy.HighsModelStatus.kOptimal,
        highspy.HighsModelStatus.kTimeLimit,
    ):
        highs.setOptionValue("solver", "ipm")
        highs.run()
    finished = highs.getModelStatus() == highspy.HighsModelStatus.kOptimal
    answer = highs.getSolution()
    weights = np.zeros(size)
    prices = np.zeros(slots_c)
    if answer.value_valid:
        weights = settled(states, block, price, np.asarray(answer.col_value)[:size])
    if answer.dual_valid:
        prices = -np.asarray(answer.row_dual)[slots_r : slots_r + slots_c]
    return Solution(
        weights=weights,
        prices=prices,
        status="solved" if finished else "stopped",
        iterations=int(highs.getInfo().simplex_iteration_count),
        finished=finished,
    )


def _load(reward: Floats, row: Ints, column: Ints, entry: Floats, full: Floats) -> highspy.Highs:
    """A HiGHS model: maximise reward x over x >= 0 with sparse A x <= full."""
    order = np.lexsort((row, column))
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = len(reward), len(full)
    lp.col_cost_ = -reward
    lp.col_lower_ = np.zeros(len(reward))
    lp.col_upper_ = np.full(len(reward), np.inf)
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
