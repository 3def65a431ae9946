"""Blocks in batches, batches in threads; what comes out does not depend on the threads."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.errors import ConfigError
from tgospa_eval.problem import Floats, Ints
from tgospa_eval.result import Solution
from tgospa_eval.solvers.kernels import block_costs, settled
from tgospa_eval.solvers.rounding import polish
from tgospa_eval.solvers.trivial import solve_trivial
from tgospa_eval.states import States
from tgospa_eval.timing import Stopwatch

SIZE = 20_000
"""States of a batch of small blocks: enough to hide the cost of a call."""


@dataclass(frozen=True, kw_only=True)
class Batch:
    """Some neighbouring blocks, those of them that are to be solved, and until when.

    Parameters
    ----------
    states : States
        The blocks.
    wanted : (B,) bool array
        Which to solve.
    deadline : float, optional
        On the clock of `time.monotonic`.
    """

    states: States
    wanted: NDArray[np.bool_]
    deadline: float | None

    def left(self) -> float | None:
        """Seconds left, 0 at least; None is no limit."""
        return None if self.deadline is None else max(self.deadline - time.monotonic(), 0.0)

    def late(self) -> bool:
        """Whether the time is up."""
        return self.deadline is not None and time.monotonic() > self.deadline


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a solver says of a batch.

    Parameters
    ----------
    weights, prices : (S,), (K,) float arrays
        As in `Solution`.
    iterations : int
        Sweeps and simplex iterations.
    status : str
        How it ended, for the user.
    open : int
        Blocks that were not solved.
    work, sweeping : int, float
        States times half sweeps, and the seconds that they took.
    seconds : dict
        Time by kind of work.
    history : tuple of dict
        Convergence, one record per check: ``sweep``, ``epsilon``, ``violation``, and the costs
        ``lower`` and ``upper`` of the batch.
    """

    weights: Floats
    prices: Floats
    iterations: int
    status: str = "solved"
    open: int = 0
    work: int = 0
    sweeping: float = 0.0
    seconds: dict[str, float] = field(default_factory=dict)
    history: tuple[dict[str, float], ...] = field(default=())


def solve_in_batches(
    states: States,
    solve: Callable[[Batch], Answer],
    stopwatch: Stopwatch,
    *,
    conflict_free: bool,
    time_limit: float | None,
    jobs: int | None,
    size: int = SIZE,
) -> Solution:
    """Solve what is not trivial, batch by batch, and put the answers together.

    Parameters
    ----------
    states : States
        The reduced problem.
    solve : callable
        Solves one batch; called from several threads.
    stopwatch : Stopwatch
        Gets the time by kind of work; of several threads, their shares of the time on the wall.
    conflict_free : bool
        As of `solve_trivial`.
    time_limit : float, optional
        Seconds.
    jobs : int, optional
        Threads, all cores by default.
    size : int
        States of a batch of small blocks.
    """
    deadline = None if time_limit is None else time.monotonic() + time_limit
    with stopwatch.span("solve/preparation"):
        weights, prices, left = solve_trivial(states, conflict_free=conflict_free)
        cuts = _cut(states, left, size)
    answers: list[Answer] = []
    if cuts:
        wanted = np.zeros(len(states.block_begin), bool)
        wanted[left] = True

        def work(cut: tuple[int, int]) -> Answer:
            part, state, slot = states.between(*cut)
            chosen = wanted[cut[0] : cut[1]]
            answer = solve(Batch(states=part, wanted=chosen, deadline=deadline))
            mine = np.repeat(chosen[part.pair_block], np.diff(part.pair_first))
            weights[state][mine] = settled(part, answer.weights)[mine]
            mine = np.repeat(chosen[part.node_block], np.diff(part.columns.first))
            prices[slot][mine] = answer.prices[mine]
            return answer

        begin, stopwatch.stage = time.perf_counter(), "solve/sweeps"
        threads = min(jobs or os.cpu_count() or 1, len(cuts))
        if threads == 1:
            answers = [work(cut) for cut in cuts]
        else:
            with ThreadPoolExecutor(threads) as pool:
                answers = list(pool.map(work, cuts))
        _book(stopwatch, answers, time.perf_counter() - begin)
    with stopwatch.span("solve/rounding"):
        weights, prices = polish(states, weights, prices)
    history: tuple[dict[str, float], ...] = ()
    if any(answer.history for answer in answers):
        history = _merge([a.history for a in answers], _elsewhere(states, weights, left))
    missing = sum(answer.open for answer in answers)
    status = next((a.status for a in answers if a.open or not missing), "solved")
    return Solution(
        weights=weights,
        prices=prices,
        status=f"{status} ({missing} of {len(left)} components)" if missing else status,
        iterations=sum(answer.iterations for answer in answers),
        finished=not missing,
        history=history,
    )


def _cut(states: States, left: Ints, size: int) -> list[tuple[int, int]]:
    """Ranges of blocks, each with at least one of those left and `size` states of them."""
    if not len(left):
        return []
    length = np.diff(
        states.pair_first[
            np.searchsorted(states.pair_block, np.arange(len(states.block_begin) + 1))
        ]
    )
    batch = (np.cumsum(length[left]) - 1) // size
    starts = np.flatnonzero(np.diff(batch, prepend=-1))
    ends = np.append(starts[1:], len(left)) - 1
    return [(int(left[a]), int(left[b]) + 1) for a, b in zip(starts, ends, strict=True)]


def _book(stopwatch: Stopwatch, answers: list[Answer], elapsed: float) -> None:
    """Divide the elapsed time by kind of work; count the work."""
    seconds: dict[str, float] = {}
    for answer in answers:
        for name, spent in answer.seconds.items():
            seconds[name] = seconds.get(name, 0.0) + spent
        stopwatch.work += answer.work
        stopwatch.busy += answer.sweeping
    total = sum(seconds.values())
    for name, spent in seconds.items():
        stopwatch.add(f"solve/{name}", elapsed * spent / total if total else 0.0)


def _elsewhere(states: States, weights: Floats, left: Ints) -> float:
    """Cost of all that is outside the blocks that were left."""
    problem = states.problem
    alone = block_costs(states, np.zeros(len(weights)))
    saved = alone - block_costs(states, weights)
    saved[left] = alone[left]
    return float(problem.truth_price.sum() + problem.estimate_price.sum() - saved.sum())


def _merge(
    histories: list[tuple[dict[str, float], ...]], elsewhere: float
) -> tuple[dict[str, float], ...]:
    """Histories side by side: costs add up, the last of a shorter one stays."""
    merged = []
    for k in range(max(map(len, histories), default=0)):
        at = [history[min(k, len(history) - 1)] for history in histories if history]
        merged.append(
            {
                "sweep": max(check["sweep"] for check in at),
                "epsilon": min(check["epsilon"] for check in at),
                "violation": max(check["violation"] for check in at),
                "lower": elsewhere + sum(check["lower"] for check in at),
                "upper": elsewhere + sum(check["upper"] for check in at),
            }
        )
    return tuple(merged)


def check_jobs(jobs: int | None) -> int | None:
    """The number of threads, 1 or more; None is all cores.

    Raises
    ------
    ConfigError
        It is not.
    """
    if jobs is None:
        return None
    if isinstance(jobs, bool) or not isinstance(jobs, int | np.integer) or jobs < 1:
        raise ConfigError(f"jobs is {jobs!r}: must be a whole number, 1 or more")
    return int(jobs)
