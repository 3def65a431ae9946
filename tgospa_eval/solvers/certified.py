"""The exact solver: independent rows first, then the linear programme of what competes.

HiGHS only proposes; the bracket is made by `tgospa_eval.result.certify`.
"""

import time
from dataclasses import dataclass
from typing import ClassVar

import highspy
import numpy as np

from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem import Floats, Ints, sum_by
from tgospa_eval.result import Solution, best_values
from tgospa_eval.solvers.kernels import (
    best_paths,
    better,
    capped_price,
    check_time_limit,
    limits,
    settled,
)
from tgospa_eval.solvers.rounding import polish
from tgospa_eval.solvers.trivial import solve_trivial
from tgospa_eval.states import Block, States
from tgospa_eval.timing import Stopwatch

ROUNDS = 30
MOST = 0.6
"""After so many rounds, or with so large a share of its rows active, a block is solved whole."""

REGRET = 1e-11
"""A row that could gain no more than this by leaving its path stays; sums round to 1e-12."""


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
        iterations = stopped = 0
        with stopwatch.span("solve/lp"):
            if len(left):
                contest = _Contest(states, left, weights, prices)
                while contest.open:
                    contest.solve(deadline)
                weights, prices = contest.weights, contest.prices
                iterations, stopped = contest.iterations, contest.stopped
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


class _Contest:
    """The blocks in which rows want the same columns, solved on the rows that matter.

    Rows that clash on their best paths are *active* and go into a linear programme; the others keep
    their paths, which use up columns. At the prices of the programme a row that would rather leave
    its path becomes active too, and the programme is solved again. When no such row is left, the
    certificate closes: no row has regret, and priced columns are full (docs/theory).
    """

    def __init__(self, states: States, left: Ints, weights: Floats, prices: Floats) -> None:
        self.states, self.prices = states, prices
        self.open = states.blocks(left)
        self.iterations = self.stopped = self.round = 0
        of_state = states.pair_block[states.pair]
        paths = best_paths(states, np.zeros(len(prices)))
        self.paths = np.where(np.isin(of_state, left), paths, 0.0)
        self.weights = np.where(self.paths > 0, 1.0, weights)
        slots = states.columns
        clash = np.concatenate(([0], np.cumsum(slots.sums(self.paths.astype(np.int64)) > 1)))
        clashes = (self.paths > 0) & (clash[slots.end] > clash[slots.begin])
        self.active = np.zeros(states.nodes, bool)
        self.active[states.pair_row[states.pair[clashes]]] = True

    def solve(self, deadline: float | None) -> None:
        """One round: the programmes of the open blocks, then the rows that they disturb."""
        states = self.states
        row = states.pair_row[states.pair]
        self.round += 1
        for block in self.open:
            rows = self.active[block.rows]
            if self.round > ROUNDS or rows.mean() > MOST:
                rows[:] = True
        held = np.where(self.active[row], 0, self.paths.astype(np.int64))
        load = states.columns.sums(held)
        unfinished = set()
        for block in self.open:
            chosen = block.states.start + np.flatnonzero(self.active[row[block.states]])
            seconds = None if deadline is None else deadline - time.monotonic()
            weights, prices, iterations, finished = _programme(states, block, chosen, load, seconds)
            self.weights[chosen] = weights
            self.weights[block.states] = settled(states, block, self.weights[block.states])
            self.prices[block.column_slots] = prices
            self.iterations += iterations
            if not finished:
                unfinished.add(block.states.start)
        self.stopped += len(unfinished)

        value = states.gain - states.columns.totals(self.prices)
        own = sum_by(row, self.paths * value, states.nodes)
        follows = states.pair[1:] == states.pair[:-1]
        moved = np.flatnonzero(follows & (np.diff(self.paths) != 0)) + 1
        own -= sum_by(row[moved], states.problem.crossing_price[states.begin[moved]], states.nodes)
        late = (best_values(states, value) - own > REGRET) & ~self.active
        self.open = [
            block
            for block in self.open
            if block.states.start not in unfinished and late[block.rows].any()
        ]
        for block in self.open:
            self.active[block.rows] |= late[block.rows]


def _programme(
    states: States, block: Block, chosen: Ints, load: Ints, seconds: float | None
) -> tuple[Floats, Floats, int, bool]:
    """The chosen states of a block as a linear programme, by dual simplex without presolve.

    maximise sum g_s w_s - sum_a price_a |w_a+1 - w_a| over w >= 0 with every slot at most full;
    |d| = 2 max(d, 0) - d leaves one column and one row for each transition a. Presolve is off: it
    can cost ten times what the solve takes.

    Returns
    -------
    weights : (len(chosen),) float array
    prices : float array
        Of the column slots of the block.
    iterations : int
    finished : bool
    """
    gain = states.gain[chosen]
    pair = states.pair[chosen]
    size = len(gain)
    arc = np.flatnonzero(pair[1:] == pair[:-1])
    price = capped_price(states, block)
    paid = price[states.begin[chosen][arc + 1] - block.window[0]]

    reward = np.concatenate((gain, -2.0 * paid))
    np.add.at(reward, arc + 1, paid)
    np.subtract.at(reward, arc, paid)
    rows = limits(states.rows, chosen, block.row_slots, np.zeros(len(states.rows.node), np.int64))
    columns = limits(states.columns, chosen, block.column_slots, load)
    above = len(rows.room) + len(columns.room)
    rise = above + np.arange(len(arc))
    row = np.concatenate((rows.limit, len(rows.room) + columns.limit, rise, rise, rise))
    column = np.concatenate((rows.state, columns.state, arc + 1, arc, size + np.arange(len(arc))))
    entry = np.ones(len(row))
    entry[len(row) - 2 * len(arc) :] = -1.0
    full = np.concatenate((rows.room, columns.room, np.zeros(len(arc))))

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
    answer = highs.getSolution()
    weights = np.asarray(answer.col_value)[:size] if answer.value_valid else np.zeros(size)
    dual = np.zeros(len(columns.room))
    if answer.dual_valid:
        dual = -np.asarray(answer.row_dual)[len(rows.room) : above]
    return (
        weights,
        columns.spread(dual),
        int(highs.getInfo().simplex_iteration_count),
        highs.getModelStatus() == highspy.HighsModelStatus.kOptimal,
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
