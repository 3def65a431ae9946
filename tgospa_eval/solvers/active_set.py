"""Where no kernel was built: the linear programme of the rows that compete, by HiGHS alone.

Rows that clash on their best paths are *active* and go into a linear programme. The others keep
their paths, which use up columns. At the prices of the programme a row that would rather leave its
path becomes active too, and the programme is solved again. When no such row is left the certificate
closes: no row has regret, and priced columns are full.
"""

import time
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.progress import Status, StoppedError
from tgospa_eval.problem.paths import best_values
from tgospa_eval.problem.problem import REGRET, sum_by
from tgospa_eval.problem.slots import changed
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.batches import Answer, BlockBatch
from tgospa_eval.solvers.block_costs import better, price_cap
from tgospa_eval.solvers.restricted_lp import Proposal, solve_restricted_lp
from tgospa_eval.solvers.trivial import best_paths

MOST_ROUNDS = 30
MOST_ACTIVE = 0.6
"""After so many rounds, or with so large a share of its rows active, a block is solved whole."""

INTERIOR = 25_000
"""States from which on the interior point method begins: without prices there is no basis to start
from. 47,000 states took 82 s, the simplex method more than 190 s, and 11,000 the same by either."""


def solve_active_sets(batch: BlockBatch) -> Answer:
    """Solve each block of a batch on the rows that matter."""
    begin = time.perf_counter()
    iterations, unsolved = 0, []
    for number in np.flatnonzero(batch.wanted).tolist():
        part, state, slot = batch.states.between(number, number + 1)
        block = _Block(part, batch)
        solved = block.solve()
        batch.weights[state], batch.prices[slot] = block.weights, block.prices
        iterations += block.iterations
        if not solved:
            unsolved.append(number)
    late = batch.limit.status if batch.limit.late() else Status.HIGHS_FAILED
    return Answer(
        iterations=iterations,
        status=late if unsolved else Status.SOLVED,
        open=np.array(unsolved, np.int64),
        left=np.flatnonzero(batch.wanted),
        seconds={"lp": time.perf_counter() - begin},
    )


class _Block:
    """One block, and the best that is known of it."""

    def __init__(self, states: States, batch: BlockBatch) -> None:
        self.states, self.limit = states, batch.limit
        self.switch_price = np.minimum(states.problem.switch_price_at, price_cap(states)[0])
        self.row = states.pair_row[states.pair]
        self.prices = np.zeros(len(states.columns.step))
        self.weights = self.paths = best_paths(states, self.prices)
        self.iterations = 0

    def solve(self) -> bool:
        """Programmes of more and more rows; whether the last one left nothing open."""
        rows = np.zeros(self.states.nodes, bool)
        rows[self.states.pair_row] = True
        active = self._clashing()
        for attempt in range(MOST_ROUNDS + 1):
            if attempt == MOST_ROUNDS or active.sum() > MOST_ACTIVE * rows.sum():
                active |= rows
            found = self._solve_rows(active)
            if found is None:
                return False
            self.iterations += found.iterations
            self.weights, self.prices = self.paths.copy(), np.zeros(len(self.prices))
            self.weights[active[self.row]] = found.weights
            self.prices[found.slot] = found.prices
            if not found.finished:
                paths = best_paths(self.states, self.prices)
                self.weights = better(self.states, self.weights, paths)
                return False
            late = self._regret() & ~active & rows
            if not late.any():
                break
            active |= late
        return True

    def _clashing(self) -> NDArray[np.bool_]:
        """Rows whose best paths share a slot with another, (nodes,)."""
        slots = self.states.columns
        clash = np.concatenate(([0], np.cumsum(slots.sums(self.paths.astype(np.int64)) > 1)))
        rows = np.zeros(self.states.nodes, bool)
        rows[self.row[(self.paths > 0) & (clash[slots.end] > clash[slots.begin])]] = True
        return rows

    def _solve_rows(self, active: NDArray[np.bool_]) -> Proposal | None:
        """The programme of the active rows, the others held; None if there is no time."""
        free = np.flatnonzero(active[self.row])
        if self.limit.late():
            return None
        work = partial(
            solve_restricted_lp,
            self.states,
            free,
            np.where(active[self.row], 0.0, self.paths),
            np.zeros(len(self.prices)),
            self.switch_price,
            self.limit.left(),
            interior=len(free) > INTERIOR,
        )
        try:
            return self.limit.progress.apart(work)
        except StoppedError:
            return None

    def _regret(self) -> NDArray[np.bool_]:
        """Rows that would gain by leaving their paths at the prices, (nodes,)."""
        states = self.states
        value = states.gain - states.columns.totals(self.prices)
        own = sum_by(self.row, self.paths * value, states.nodes)
        moved = np.flatnonzero(changed(states.pair_first, self.paths))
        paid = states.problem.switch_price_at[states.begin[moved]]
        own -= sum_by(self.row[moved], paid, states.nodes)
        return best_values(states, value) - own > REGRET
