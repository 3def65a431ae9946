"""Where no kernel was built: the linear programme of the rows that compete, by HiGHS alone."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from tgospa_eval.common.progress import StoppedError
from tgospa_eval.problem.paths import best_values
from tgospa_eval.problem.problem import Floats, sum_by
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.batches import Answer, Batch
from tgospa_eval.solvers.best_paths import best_paths
from tgospa_eval.solvers.block_costs import better, price_cap
from tgospa_eval.solvers.restricted_lp import solve_restricted_lp

ROUNDS = 30
MOST = 0.6
"""After so many rounds, or with so large a share of its rows active, a block is solved whole."""

LARGE = 25_000
"""A programme of more states takes longer than sweeps and the smaller programmes after them."""

REGRET = 1e-11
"""A row that could gain no more than this by leaving its path stays; sums round to 1e-12."""


def solve_active_sets(batch: Batch, ascend: Callable[[Batch], Answer]) -> Answer:
    """Solve each block of a batch on the rows that matter; `ascend` solves the large ones."""
    begin = time.perf_counter()
    iterations, unsolved = 0, []
    large = np.zeros(len(batch.wanted), bool)
    for number in np.flatnonzero(batch.wanted).tolist():
        part, state, slot = batch.states.between(number, number + 1)
        found = _solve(part, batch)
        if found is None:
            large[number] = True
            continue
        batch.weights[state], batch.prices[slot], steps, solved = found
        iterations += steps
        if not solved:
            unsolved.append(number)
    late = batch.limit.status if batch.limit.late() else "HiGHS failed"
    answer = Answer(
        iterations=iterations,
        status=late if unsolved else "solved",
        open=np.array(unsolved, np.int64),
        left=np.flatnonzero(batch.wanted),
        seconds={"lp": time.perf_counter() - begin},
    )
    if not large.any():
        return answer
    # Of blocks that are solved here the bracket is not known.
    progress = batch.progress.silent() if large.sum() < batch.wanted.sum() else batch.progress
    rest = ascend(replace(batch, wanted=large, quickly=np.zeros_like(large), progress=progress))
    return replace(
        rest,
        iterations=iterations + rest.iterations,
        status=rest.status if len(rest.open) or not unsolved else answer.status,
        open=np.sort(np.concatenate((answer.open, rest.open))),
        left=answer.left,
        seconds={**rest.seconds, "lp": answer.seconds["lp"] + rest.seconds.get("lp", 0.0)},
    )


def _solve(states: States, batch: Batch) -> tuple[Floats, Floats, int, bool] | None:
    """Rows that clash on their best paths are *active* and go into a linear programme.

    The others keep their paths, which use up columns. At the prices of the programme a row that
    would rather leave its path becomes active too, and the programme is solved again. When no such
    row is left the certificate closes: no row has regret, and priced columns are full. None if a
    programme would be too large.
    """
    slots = states.columns
    prices = np.zeros(len(slots.step))
    switch_price = np.minimum(states.problem.switch_price_at, price_cap(states)[0])
    row = states.pair_row[states.pair]
    paths = best_paths(states, prices)
    clash = np.concatenate(([0], np.cumsum(slots.sums(paths.astype(np.int64)) > 1)))
    active = np.zeros(states.nodes, bool)
    active[row[(paths > 0) & (clash[slots.end] > clash[slots.begin])]] = True
    is_row = np.zeros(states.nodes, bool)
    is_row[states.pair_row] = True

    iterations = 0
    for attempt in range(ROUNDS + 1):
        if attempt == ROUNDS or active.sum() > MOST * is_row.sum():
            active |= is_row
        free = np.flatnonzero(active[row])
        if len(free) > LARGE:
            return None
        if batch.limit.late():
            return paths, prices, iterations, False
        try:
            found = batch.limit.progress.apart(
                partial(
                    solve_restricted_lp, states, free, np.where(active[row], 0.0, paths),
                    np.zeros(len(prices)), switch_price, np.inf, batch.limit.left(),
                )
            )  # fmt: skip
        except StoppedError:
            return paths, prices, iterations, False
        weights, prices = paths.copy(), np.zeros(len(prices))
        weights[free], prices[found.slot] = found.weights, found.prices
        iterations += found.iterations
        if not found.finished:
            return better(states, weights, best_paths(states, prices)), prices, iterations, False
        value = states.gain - slots.totals(prices)
        own = sum_by(row, paths * value, states.nodes)
        follows = states.pair[1:] == states.pair[:-1]
        moved = np.flatnonzero(follows & (np.diff(paths) != 0)) + 1
        own -= sum_by(row[moved], states.problem.switch_price_at[states.begin[moved]], states.nodes)
        late = (best_values(states, value) - own > REGRET) & ~active & is_row
        if not late.any():
            break
        active |= late
    return weights, prices, iterations, True
