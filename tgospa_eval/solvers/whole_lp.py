"""Where no kernel was built: each block is one linear programme, by HiGHS alone.

Sweeps in NumPy would take longer than that, and prove less (docs/theory/solvers.md, "Without
compiled kernels").
"""

import time
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.progress import Limit, Status, StoppedError
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.batches import Answer, BlockBatch
from tgospa_eval.solvers.block_costs import better, price_cap
from tgospa_eval.solvers.trivial import best_paths

if TYPE_CHECKING:
    from tgospa_eval.solvers.restricted_lp import Proposal

INTERIOR = 25_000
"""States from which on the interior point method begins: without prices there is no basis to start
from. 47,000 states took 82 s, the simplex method more than 190 s, and 11,000 the same by either."""


def solve_whole(batch: BlockBatch) -> Answer:
    """Solve each block of a batch; best paths, made feasible, where there is no time for it."""
    begin = time.perf_counter()
    iterations, unsolved = 0, []
    for number in np.flatnonzero(batch.wanted).tolist():
        states, state, slot = batch.states.between(number, number + 1)
        found = None if batch.limit.late() else _programme(states, batch.limit)
        if found is not None:
            iterations += found.iterations
            batch.prices[slot][found.slot] = found.prices
            batch.weights[state] = found.weights
        if found is None or not found.finished:
            paths = best_paths(states, batch.prices[slot])
            batch.weights[state] = better(states, batch.weights[state], paths)
            unsolved.append(number)
    late = batch.limit.status if batch.limit.late() else Status.HIGHS_FAILED
    return Answer(
        iterations=iterations,
        status=late if unsolved else Status.SOLVED,
        open=np.array(unsolved, np.int64),
        left=np.flatnonzero(batch.wanted),
        seconds={"lp": time.perf_counter() - begin},
    )


def _programme(states: States, limit: Limit) -> "Proposal | None":
    """What HiGHS finds for one block; None if there is no time."""
    from tgospa_eval.solvers.restricted_lp import solve_restricted_lp  # HiGHS: slow to import

    size = len(states.begin)
    work = partial(
        solve_restricted_lp,
        states,
        np.arange(size),
        np.zeros(size),
        np.zeros(len(states.columns.step)),
        np.minimum(states.problem.switch_price_at, price_cap(states)[0]),
        limit.left(),
        interior=size > INTERIOR,
    )
    try:
        return limit.progress.apart(work)
    except StoppedError:
        return None
