"""The referee, which checks the other solvers: the linear programme by CVXPY and Clarabel.

CVXPY translates formulas to a linear programme, and Clarabel solves it by an interior point method
(`solvers.restricted_lp` explains these words). The referee shares with the other solvers only the
reduced problem and some of the trivial blocks. It is slower, but has another formulation, another
modelling tool and another algorithm. No other file imports cvxpy. Other words and letters:
`solvers`.
"""

import sys
import time
import warnings
from typing import Any, ClassVar

import numpy as np
from scipy import sparse

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Status, StoppedError
from tgospa_eval.errors import SolverError
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.batches import Answer, BatchSolver, BlockBatch, Routine
from tgospa_eval.solvers.block_costs import better, price_cap, settle
from tgospa_eval.solvers.capacities import CapacityRows, capacity_rows
from tgospa_eval.solvers.trivial import dual_values, round_paths, solve_rows
from tgospa_eval.solvers.tuning import check_settings

IMPORT, BUILD, FACTOR, WIDTH_POWER = 2.0, 6e-5, 4e-7, 1.1
"""Numbers to estimate the seconds of work that cannot be stopped. Importing cvxpy takes IMPORT.
Compiling a programme of n states takes BUILD n. The first iteration of Clarabel factors a matrix,
which takes FACTOR n w^WIDTH_POWER, where w is the mean number of states that begin at a step. This
was measured on crowds of 2,000 to 40,000 states, and is true within a factor of three."""

CVXPY_ENDS = {
    "optimal": Status.SOLVED,
    "optimal_inaccurate": Status.SOLVED,  # to a looser tolerance; the bounds say how good it is
    "user_limit": Status.LATE,
}
"""Status by the outcome that CVXPY reports."""

Programme = tuple[Any, Any, Any, CapacityRows]
"""The problem, its weights and the constraints of the column slots, as objects of CVXPY (without
types); and the `CapacityRows` of these constraints."""

CLARABEL_SETTINGS = {
    "tol_gap_abs": 1e-11,
    "tol_gap_rel": 1e-11,
    "tol_feas": 1e-11,
    "max_threads": 1,
}


@dataclass(frozen=True, kw_only=True)
class Exact(BatchSolver):
    """The linear programme by CVXPY and Clarabel, to a tolerance of 1e-11.

    Parameters
    ----------
    time_limit : float, optional
        Seconds; the solution reached by then is returned, with proven bounds.

    Raises
    ------
    ConfigError
        A setting is out of its range.
    """

    name: ClassVar[str] = "exact"
    referee: ClassVar[bool] = True
    jobs: ClassVar[int | None] = 1
    time_limit: float | None = None

    def __post_init__(self) -> None:
        check_settings(self, time_limit=self.time_limit)

    @property
    def routine(self) -> Routine:
        """Functions that solve each block that is not trivial separately, without a warm start."""
        return Routine(solve_rows, _solve_blocks, self.jobs)


def _solve_blocks(batch: BlockBatch) -> Answer:
    """Solve the blocks of a batch, one by one."""
    states, blocks = batch.states, np.flatnonzero(batch.wanted).tolist()
    failures: list[tuple[Status, str]] = []
    open_blocks: list[int] = []
    iterations = 0
    seconds = {"build": 0.0, "lp": 0.0}
    for done, block in enumerate(blocks):
        batch.progress.advance(done / len(blocks))
        part, state, slot = states.between(block, block + 1)
        status, detail, steps, programme = _solve_block(batch, part, seconds)
        iterations += steps
        if not status.good:
            failures.append((status, detail))
            open_blocks.append(block)
        if programme is not None:
            given = batch.weights[state], batch.prices[slot]
            late = status == batch.limit.status
            batch.weights[state], batch.prices[slot] = _read(programme, part, given, late=late)
    settle(states, batch.wanted, batch.weights)
    # The interior point method returns small weights everywhere. Rounded paths may cost less.
    value = states.gain - states.columns.totals(np.maximum(batch.prices, 0.0))
    batch.weights[:] = better(states, batch.weights, round_paths(states, value, batch.weights))
    status, detail = failures[0] if failures else (Status.SOLVED, "")
    return Answer(
        iterations=iterations,
        status=status,
        detail=detail,
        open=np.array(open_blocks, np.int64),
        left=np.array(blocks, np.int64),
        seconds=seconds,
    )


def _solve_block(
    batch: BlockBatch, part: States, seconds: dict[str, float]
) -> tuple[Status, str, int, Programme | None]:
    """Solve a block if there is time; return status, detail, iterations and the programme."""
    limit = batch.limit
    build, factor = _seconds(part)
    if _short(batch, build + factor):
        return limit.status, "", 0, None
    try:
        begin = time.perf_counter()
        programme = limit.progress.in_thread(lambda: _build(part))
        built = time.perf_counter()
        seconds["build"] += built - begin
        if _short(batch, factor):
            return limit.status, "", 0, None
        left = limit.left()
        # Clarabel checks the time only after an iteration, which needs a factorisation.
        until = None if left is None else left - 0.5 * factor
        status, detail, steps = limit.progress.in_thread(lambda: _solve(programme, until))
        seconds["lp"] += time.perf_counter() - built
    except StoppedError:  # Clarabel cannot be stopped: its thread continues
        return limit.status, "", 0, None
    return limit.status if status == Status.LATE else status, detail, steps, programme


def _read(
    programme: Programme, part: States, given: tuple[Floats, Floats], *, late: bool
) -> tuple[Floats, Floats]:
    """Return weights and prices of a block from Clarabel; where it has none, those `given`."""
    weights, prices = given
    _, variables, columns, priced = programme
    if variables.value is not None:
        weights = variables.value
    if columns is not None and columns.dual_value is not None:
        none = np.zeros(len(priced.slot))
        duals = np.zeros(len(part.columns.step))
        duals[priced.slot] = priced.spread(np.maximum(columns.dual_value, 0.0), none)
        # Prices of an early iteration may prove less than prices 0.
        if not late or dual_values(part, duals) < dual_values(part, 0 * duals):
            prices = duals
    return weights, prices


def _seconds(states: States) -> tuple[float, float]:
    """Estimate the seconds of importing and compiling, and of one iteration of Clarabel."""
    size = len(states.begin)
    width = size / max(len(np.unique(states.begin)), 1)
    begun = 0.0 if "cvxpy" in sys.modules else IMPORT
    return begun + size * BUILD, size * FACTOR * width**WIDTH_POWER


def _short(batch: BlockBatch, seconds: float) -> bool:
    """Return whether the time limit leaves less than `seconds`."""
    left = batch.limit.left()
    return left is not None and left < seconds


def _build(states: States) -> Programme:
    """Build the programme of one block: maximise ``gain w - price |D w|`` over weights w >= 0.

    D w are the changes of weight from each state of a pair to the next, and price are the switch
    prices. The weights in every slot sum to at most 1.
    """
    import clarabel  # noqa: F401  fails here if memory is short; cvxpy would call it missing
    import cvxpy as cp  # lazy: importing it takes longer than most evaluations

    gain, pair = states.gain, states.pair
    arc = np.flatnonzero(pair[1:] == pair[:-1])
    price = np.minimum(states.problem.switch_price_at, price_cap(states)[0])
    paid = price[states.begin[arc + 1]]
    every = np.arange(len(arc))
    difference = sparse.csr_array(
        (np.repeat((1.0, -1.0), len(arc)), (np.tile(every, 2), np.concatenate((arc + 1, arc)))),
        shape=(len(arc), len(gain)),
    )
    weights = cp.Variable(len(gain), nonneg=True)
    objective = gain @ weights
    if len(arc):
        objective = objective - paid @ cp.abs(difference @ weights)
    every = np.arange(len(gain))
    constraints = []
    for slots in (states.rows, states.columns):
        priced = capacity_rows(slots, every, np.zeros(len(gain)))
        count = len(priced.room)
        matrix = sparse.csr_array(
            (np.ones(len(priced.constraint)), (priced.constraint, priced.state)),
            shape=(count, len(gain)),
        )
        constraints.append(matrix @ weights <= 1 if count else None)
    problem = cp.Problem(cp.Maximize(objective), [c for c in constraints if c is not None])
    problem.get_problem_data(cp.CLARABEL)  # compile now: `_solve` then only runs Clarabel
    return problem, weights, constraints[-1], priced


def _solve(programme: Programme, seconds: float | None) -> tuple[Status, str, int]:
    """Run Clarabel; return its status, details for the user, and the number of iterations."""
    import cvxpy as cp

    settings: dict[str, float] = dict(CLARABEL_SETTINGS)
    if seconds is not None:
        settings["time_limit"] = max(seconds, 1e-3)
    problem, *_ = programme
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # cvxpy repeats the status as a warning
            problem.solve(solver=cp.CLARABEL, warm_start=False, **settings)
    except cp.error.SolverError as error:
        return Status.CLARABEL_FAILED, " ".join(str(error).split())[:80], 0
    if problem.status not in CVXPY_ENDS:
        raise SolverError(f"Clarabel reports {problem.status}, but every programme has an optimum")
    return CVXPY_ENDS[problem.status], "", int(problem.solver_stats.num_iters or 0)
