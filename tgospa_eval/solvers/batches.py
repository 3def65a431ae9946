"""Blocks in batches, batches in threads; what comes out does not depend on the threads."""

import itertools
import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import field
from functools import partial

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass, replace
from tgospa_eval.common.machine import cores, in_order
from tgospa_eval.common.progress import Limit, Status, Stopwatch
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import States
from tgospa_eval.solvers import Solver
from tgospa_eval.solvers.block_costs import (
    BatchProgress,
    BracketProgress,
    block_costs,
    settle,
    unassigned_costs,
)
from tgospa_eval.solvers.far_cutoff import solve_at_fitting_cutoffs
from tgospa_eval.solvers.time_windows import (
    BEFORE_SEAMS,
    Division,
    TimeShares,
    TimeWindow,
    divisible_blocks,
)
from tgospa_eval.solvers.warm_start import WarmStart

BATCH_STATES = 20_000
"""States of a batch of small blocks: enough to hide the cost of a call."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockBatch:
    """Some neighbouring blocks, those of them that are to be solved, and until when.

    Parameters
    ----------
    states : States
        The blocks.
    wanted : (B,) bool array
        Which to solve.
    quickly : (B,) bool array
        Others, that are solved if that takes no time; they are open otherwise.
    weights, prices : (S,), (K,) float arrays
        Zeros in the wanted blocks, where the answer is written to, as in `Solution`.
    limit : Limit
        Until when to go on.
    progress : BatchProgress
        Takes what is known on the way.
    warm_start : WarmStart, optional
        What may solve some blocks already.
    """

    states: States
    wanted: Mask
    quickly: Mask
    weights: Floats
    prices: Floats
    limit: Limit
    progress: BatchProgress
    warm_start: WarmStart | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """What came out of a batch.

    Parameters
    ----------
    iterations : int
        Sweeps and simplex iterations.
    status, detail : Status, str
        How it ended, for the user.
    open : int array
        Blocks that were not solved.
    work, sweeping : int, float
        States times half sweeps, and the seconds that they took.
    seconds : dict
        Time by kind of work.
    history : tuple of dict
        Convergence, one record per check: ``sweep``, ``epsilon``, ``violation``, and the costs
        ``lower`` and ``upper`` of the blocks, less those of leaving all unassigned.
    left : int array
        Blocks that were not trivial.
    """

    iterations: int = 0
    status: Status = Status.SOLVED
    detail: str = ""
    open: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    work: int = 0
    sweeping: float = 0.0
    seconds: dict[str, float] = field(default_factory=dict)
    history: tuple[dict[str, float], ...] = ()
    left: Ints = field(default_factory=lambda: np.zeros(0, np.int64))


Trivial = Callable[[States, Floats, Floats], Ints]
"""Writes weights and prices of the blocks that need no solver; returns the others."""


@dataclass(frozen=True)
class Routine:
    """What is done with each batch.

    Parameters
    ----------
    trivial : Trivial
        One of `solvers.trivial`.
    solve : callable
        Solves one batch; called from several threads.
    jobs : int, optional
        Threads, all cores by default.
    tries : bool
        Whether `solve` looks at blocks that are only to be tried.
    resumes : bool
        Whether `solve` can begin from something: long blocks are solved in windows of time first.
    """

    trivial: Trivial
    solve: Callable[[BlockBatch], Answer]
    jobs: int | None
    tries: bool = False
    resumes: bool = False


class BatchSolver(Solver):
    """A solver that takes blocks batch by batch."""

    @property
    @abstractmethod
    def routine(self) -> Routine:
        """What is done with each batch."""

    def __call__(
        self, states: States, stopwatch: Stopwatch, warm_start: WarmStart | None = None
    ) -> Solution:
        """Solve batch by batch, what is trivial first, and put the answers together.

        Parameters
        ----------
        states : States
            The reduced problem.
        stopwatch : Stopwatch
            Gets the time by kind of work; of several threads, their shares of the time on the wall.
        warm_start : WarmStart, optional
            What may solve some blocks already; routines that cannot begin from it pass it over.
        """
        routine, progress = self.routine, stopwatch.progress
        limit = Limit.of(self.time_limit, progress)
        start = warm_start if routine.resumes else None

        def base(inner: States, wanted: Mask, quickly: Mask) -> Solution:
            whole = inner is states
            return _solve_some(
                inner,
                (wanted, quickly),
                routine,
                stopwatch,
                limit if whole else replace(limit, progress=progress.silent()),
                start if whole else None,
            )

        return solve_at_fitting_cutoffs(states, base, gap=self.gap, limit=limit)


def _solve_some(
    states: States,
    masks: tuple[Mask, Mask],
    routine: Routine,
    stopwatch: Stopwatch,
    limit: Limit,
    warm_start: WarmStart | None,
) -> Solution:
    """The wanted blocks batch by batch, and those of the others that are `quickly` solved.

    Long blocks are batches of their own, which begin from what is found for windows of them.
    """
    wanted, quickly = masks
    weights = np.zeros(len(states.begin))
    prices = np.zeros(len(states.columns.step))

    long: Ints = np.zeros(0, np.int64)
    if routine.resumes and warm_start is None and not limit.late():
        long = divisible_blocks(states)
        long = long[wanted[long] & ~quickly[long]]
    cuts = _apart(states.cuts(BATCH_STATES), long)
    bracket = BracketProgress(states, cuts, limit.progress)
    divided: dict[int, Division] = {}

    def work(number: int) -> Answer:
        blocks = slice(*cuts[number])
        if not (wanted[blocks].any() or quickly[blocks].any()):
            return Answer()
        part, state, slot = states.between(*cuts[number])
        start = None if warm_start is None else warm_start.between(state, slot)
        if number in divided:
            division = divided.pop(number)
            start = WarmStart(weights=(division.join(),), prices=division.prices, near=True)
        batch = BlockBatch(
            states=part,
            wanted=wanted[blocks],
            quickly=quickly[blocks],
            weights=weights[state],
            prices=prices[slot],
            limit=limit,
            progress=BatchProgress(bracket, number, part, weights[state], quickly[blocks]),
            warm_start=start,
        )
        with np.errstate(under="ignore"):  # whatever the caller has set: threads begin anew
            answer = _answer(batch, routine)
            if limit.progress.watched and len(cuts) > 1:
                batch.progress.finish()
        return answer

    windows: list[Callable[[], Answer]] = []
    if len(long):
        shares = TimeShares(limit, routine.jobs or cores())
        inner = replace(routine, jobs=1, resumes=False)
        for number, cut in enumerate(cuts):
            if cut[0] in long:
                divided[number] = Division(states.between(*cut)[0])

        def solve_window(number: int, window: TimeWindow) -> Answer:
            division = divided[number]
            answer = _solve_window(division, inner, window, shares)
            bracket.advance(number, BEFORE_SEAMS * division.done / len(division.windows))
            return answer

        windows = [
            partial(solve_window, number, window)
            for number, division in divided.items()
            for window in division.windows
        ]
        shares.waiting = len(windows)
    begin, stopwatch.stage = time.perf_counter(), "solve/sweeps"
    whole = [number for number in range(len(cuts)) if number not in divided]
    last = list(divided)
    first: list[Callable[[], Answer]] = [*windows, *(partial(work, number) for number in whole)]
    threads = min(routine.jobs or cores(), len(first))
    found = list(in_order(lambda task: task(), first, threads))
    by_number = dict(zip(whole, found[len(windows) :], strict=True))
    by_number.update(zip(last, in_order(work, last, min(threads, len(last))), strict=True))
    answers = [by_number[number] for number in range(len(cuts))]
    _book(stopwatch, [*found[: len(windows)], *answers], time.perf_counter() - begin)

    missing = sum(len(answer.open) for answer in answers)
    open_ = np.zeros(len(states.block_begin), bool)
    for (low, _), answer in zip(cuts, answers, strict=True):
        open_[low + answer.open] = True
    # What is reported, if batches ended differently: what kept one from being solved.
    ended = [a for a in answers if len(a.left) and (len(a.open) or not missing)] or [Answer()]
    worst = next((answer for answer in ended if not answer.status.good), ended[0])
    return Solution(
        weights=weights,
        prices=prices,
        status=worst.status,
        detail=worst.detail,
        unsolved=(missing, sum(len(a.left) for a in answers)) if missing else None,
        iterations=sum(answer.iterations for answer in (*found[: len(windows)], *answers)),
        finished=not missing,
        history=_merge(states, cuts, answers, weights),
        disposable=True,
        missing=open_,
    )


def _apart(cuts: list[tuple[int, int]], long: Ints) -> list[tuple[int, int]]:
    """The cuts, further divided so that each of the long blocks is by itself."""
    if not len(long):
        return cuts
    edges = sorted({*(low for low, _ in cuts), cuts[-1][1], *long.tolist(), *(long + 1).tolist()})
    return list(itertools.pairwise(edges))


def _solve_window(
    division: Division, routine: Routine, window: TimeWindow, shares: TimeShares
) -> Answer:
    """Solve one window of a block, and keep its core; called from several threads."""
    watch, begin = Stopwatch(), time.perf_counter()
    piece = division.cut(window)
    every = np.ones(len(piece.block_begin), bool)
    preparation = time.perf_counter() - begin
    with np.errstate(under="ignore"):
        found = _solve_some(piece, (every, ~every), routine, watch, shares.take(), None)
    begin = time.perf_counter()
    division.take(window, piece, found.weights, found.prices)
    seconds = {name.removeprefix("solve/"): span for name, span in watch.spans.items()}
    preparation += time.perf_counter() - begin
    seconds["preparation"] = seconds.get("preparation", 0.0) + preparation
    return Answer(
        iterations=found.iterations, work=watch.work, sweeping=watch.busy, seconds=seconds
    )


def _answer(batch: BlockBatch, routine: Routine) -> Answer:
    """Solve a batch, of the wanted blocks those that are not trivial."""
    states, quickly = batch.states, batch.quickly
    begin = time.perf_counter()
    left = routine.trivial(states, batch.weights, batch.prices)
    not_trivial = np.zeros(len(quickly), bool)
    not_trivial[left] = True
    batch = replace(batch, wanted=batch.wanted & not_trivial)
    tentative = bool(quickly.any())
    if tentative:  # gains near 1 have lost the digits that decide
        batch.weights[states.states_of(quickly)] = 0.0
        batch.prices[states.slots_of(quickly)] = 0.0
    preparation = time.perf_counter() - begin
    tried = tentative and routine.tries
    answer = routine.solve(batch) if tried or batch.wanted.any() else Answer()
    if tentative and not tried:
        open_ = quickly.copy()
        open_[answer.open] = True
        answer = replace(answer, open=np.flatnonzero(open_))
    begin = time.perf_counter()
    settle(states, batch.wanted, batch.weights)
    spent = answer.seconds  # that of this answer alone
    for name, seconds in (("rounding", time.perf_counter() - begin), ("preparation", preparation)):
        spent[name] = spent.get(name, 0.0) + seconds
    return answer


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


def _merge(
    states: States, cuts: list[tuple[int, int]], answers: list[Answer], weights: Floats
) -> tuple[dict[str, float], ...]:
    """Histories side by side: costs add up, the last of a shorter one stays."""
    found = [answer for answer in answers if answer.history]
    merged: list[dict[str, float]] = []
    if not found:
        return ()
    problem = states.problem
    base = float(problem.truth_price.sum() + problem.estimate_price.sum())
    for cut, answer in zip(cuts, answers, strict=True):
        part, state, _ = states.between(*cut)
        trivial = block_costs(part, weights[state]) - unassigned_costs(part)
        trivial[answer.left] = 0.0
        base += float(trivial.sum())
    for k in range(max(len(answer.history) for answer in found)):
        at = [answer.history[min(k, len(answer.history) - 1)] for answer in found]
        merged.append(
            {
                "sweep": max(check["sweep"] for check in at),
                "epsilon": min(check["epsilon"] for check in at),
                "violation": max(check["violation"] for check in at),
                "lower": max(base + sum(check["lower"] for check in at), 0.0),
                "upper": base + sum(check["upper"] for check in at),
            }
        )
    return tuple(merged)
