"""Solution of blocks in batches, in several threads; the result does not depend on the threads.

A *batch* is a sequence of blocks that one thread solves together. A block with very many states and
steps is first solved in *windows in time*, which overlap. A window has a *core*, and some steps on
either side. A *seam* is where two cores meet.

    core |---------|---------|---------|
         |------------|                  a window
              |---------------|          the next window

The answer of a window is its weights and prices. Those of the core are kept, and the cores are
joined to an answer of the block. Any prices >= 0 and any feasible weights bound the optimum, so the
joined answer does, too (docs/theory/windows-in-time.md). Both bounds of the whole block show how
far the seams move them apart. From the joined answer, the block is then solved as a whole. Other
words and letters: `solvers`.
"""

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
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import ONE, Slots, States, merge_runs, repair
from tgospa_eval.solvers import Solver
from tgospa_eval.solvers.block_costs import (
    BatchProgress,
    BracketProgress,
    block_costs,
    settle,
    unassigned_costs,
)
from tgospa_eval.solvers.far_cutoff import solve_at_fitting_cutoffs
from tgospa_eval.solvers.tuning import TIME_WINDOWS
from tgospa_eval.solvers.warm_start import WarmStart

FULLER = 1e-15
"""Excess of a load over 1 above which a slot is too full."""

SOME_ROOM = 1e-9
"""Smallest room in a slot that is worth filling."""

BEFORE_SEAMS = 0.9
"""Share of the solving time of a block that its windows may use. It is also their share in the
displayed progress of the block."""

UNKNOWN = -1.0
"""Mark in place of the weight of a state for which no window has an answer."""


TimeWindow = tuple[int, int, int, int]
"""First step of the core, step after the end of the core, first step of the window, and step after
the end of the window."""


def divisible_blocks(states: States) -> Ints:
    """Return the blocks to solve in windows: very large and long blocks in which rows compete.

    There are none in four cases: switch prices vary (a run is then several states); switches are
    free; half a switch costs very much (the overlaps would have to be long); or gains can be
    negative.
    """
    problem = states.problem
    price = problem.switch_price
    allowed = isinstance(price, float) and 0 < price <= TIME_WINDOWS.highest_price
    if problem.signed or not allowed:
        return np.zeros(0, np.int64)
    if len(states.begin) < TIME_WINDOWS.min_states:
        return np.zeros(0, np.int64)
    steps = states.block_end - states.block_begin + 1
    long = steps >= TIME_WINDOWS.steps
    large = np.diff(states.block_first) >= TIME_WINDOWS.min_states
    slots = sum_by(states.node_block, np.diff(states.columns.first), len(steps))
    return np.flatnonzero(large & long & ~states.transposed & (slots > 0))


class Division:
    """Windows of one block, and their answers so far; answers can come from several threads.

    Parameters
    ----------
    states : States
        The block.

    Attributes
    ----------
    windows : list of TimeWindow
        Windows with about equal numbers of gains.
    weights, prices : (S,), (K,) float arrays
        Joined answers so far.
    done : int
        Number of windows that are joined.
    """

    def __init__(self, states: States) -> None:
        self.states, self.done = states, 0
        self.weights = np.full(len(states.begin), UNKNOWN)
        self.prices = np.zeros(len(states.columns.step))
        problem = states.problem
        gains = np.flatnonzero(states.entry >= 0).astype(np.int32)
        state = np.full(len(problem.cost), -1, np.int32)
        state[states.entry[gains]] = gains
        self._entry = np.flatnonzero(state >= 0).astype(np.int32)
        self._state = state[self._entry]
        self._step = problem.truth_step[problem.truth_row[self._entry]]
        self._end = states.end
        self.windows = self._windows()

    def _windows(self) -> list[TimeWindow]:
        begin, end = int(self.states.block_begin[0]), int(self.states.block_end[0]) + 1
        price = float(np.max(self.states.problem.switch_price, initial=0.0))
        overlap = TIME_WINDOWS.overlap + int(TIME_WINDOWS.fading * price)
        count = len(self.weights) // TIME_WINDOWS.size
        count = max(min(count, (end - begin) // TIME_WINDOWS.shortest), 1)
        at = len(self._step) * np.arange(1, count) // count
        seams = [begin, *np.unique(self._step[at]).tolist(), end]
        return [
            (low, high, max(low - overlap, begin), min(high + overlap, end))
            for low, high in itertools.pairwise(seams)
            if low < high
        ]

    def problem_of(self, window: TimeWindow) -> States:
        """Return the window as a separate problem, whose first step is 0."""
        problem, (first, stop) = self.states.problem, window[2:]
        steps = first, stop
        own = slice(*np.searchsorted(self._step, steps).tolist())
        truths = slice(*np.searchsorted(problem.truth_step, steps).tolist())
        estimates = slice(*np.searchsorted(problem.estimate_step, steps).tolist())
        entry = self._entry[own]
        piece = replace(
            problem,
            steps=stop - first,
            truth_step=problem.truth_step[truths] - first,
            truth_track=problem.truth_track[truths],
            truth_price=problem.truth_price[truths],
            estimate_step=problem.estimate_step[estimates] - first,
            estimate_track=problem.estimate_track[estimates],
            estimate_price=problem.estimate_price[estimates],
            truth_row=problem.truth_row[entry] - truths.start,
            estimate_row=problem.estimate_row[entry] - estimates.start,
            cost=problem.cost[entry],
            distance_power=None,
            pair_share=None,
            unjudged=None,
        )
        # Columns are estimates, as in the block, because each may need prices.
        return merge_runs(piece, transpose=False)

    def take(self, window: TimeWindow, piece: States, weights: Floats, prices: Floats) -> None:
        """Keep the weights of states that lie in the core of a window, and prices of its slots.

        The kept prices are those of slots that begin in the core.
        """
        whole, (low, high, first, _) = self.states, window
        home = self._homes(first, piece)
        begin = whole.begin[home]
        inside = begin >= low
        inside &= self._end[home] < high
        self.weights[home[inside]] = weights[inside]
        slot = piece.columns.begin
        shared = np.diff(piece.columns.first)[piece.pair_column] > 0
        priced = np.repeat(shared, np.diff(piece.pair_first))
        priced &= (begin == piece.begin + first) & (begin >= low) & (begin < high)
        self.prices[whole.columns.begin[home[priced]]] = prices[slot[priced]]
        self.done += 1

    def _homes(self, first: int, piece: States) -> Ints:
        """Return the index in the block of each state of a window.

        If the window contains only a part of a run, this is the index of the whole run.
        """
        start = int(np.searchsorted(self._step, first))
        home = np.empty(len(piece.begin), np.int32)
        run = piece.entry < 0
        gains = np.flatnonzero(~run)
        home[gains] = self._state[start + piece.entry[gains]]
        opens = np.zeros(len(home), bool)
        opens[piece.pair_first[:-1]] = True
        leading = np.flatnonzero(run & opens)
        other = np.flatnonzero(run & ~opens)
        home[other] = home[other - 1] + 1
        home[leading] = home[leading + 1] - 1
        return home

    def join(self) -> Floats:
        """Return feasible weights of all states, also of runs that no window contains whole.

        A run between two states with a gain gets the smaller of their weights. This causes no
        additional cost, and needs the least room. A run at an end of the block gets the weight of
        the state next to it.
        """
        states, weights = self.states, self.weights
        run = np.flatnonzero(states.entry < 0)
        first = np.zeros(len(weights) + 1, bool)
        first[states.pair_first] = True
        around = np.maximum(weights, 0.0)
        before = np.where(first[run], np.inf, around[run - 1])
        after = np.where(first[run + 1], np.inf, around[np.minimum(run + 1, len(around) - 1)])
        bound = np.minimum(before, after)
        known = weights[run] >= 0
        joined: Floats = around
        joined[run] = np.where(known, np.minimum(weights[run], bound), bound)
        seams = run[~known & (bound > 0)]
        _make_room(states, joined, seams)
        if any(_too_full(slots, joined).any() for slots in (states.rows, states.columns)):
            joined = repair(states, joined) / ONE
        return joined


class TimeShares:
    """Time limits of windows: each has an equal share of the time that is left.

    Time that a window does not use is left for later windows. So if the time is short, all windows
    are solved in part.

    Parameters
    ----------
    limit : Limit
        Limit of the whole solution.
    threads : int
        Number of windows that are solved at once.

    Attributes
    ----------
    waiting : int
        Number of windows that have not begun.
    """

    def __init__(self, limit: Limit, threads: int) -> None:
        self.limit = replace(limit, progress=limit.progress.silent())
        left = limit.left()
        self.until = None if left is None else time.monotonic() + BEFORE_SEAMS * left
        self.threads, self.waiting = threads, 0

    def take(self) -> Limit:
        """Return the limit of the next waiting window."""
        waiting = max(self.waiting, 1)
        self.waiting -= 1
        if self.until is None:
            return self.limit
        now = time.monotonic()
        share = max(self.until - now, 0.0) * min(self.threads, waiting) / waiting
        return replace(self.limit, deadline=now + share)


def _too_full(slots: Slots, weights: Floats) -> Mask:
    return slots.loads(weights) > 1 + FULLER


def _make_room(states: States, weights: Floats, runs: Ints) -> None:
    """Lower the weights of `runs` in place until they fit; short runs get the room first."""
    wanted = weights[runs]
    weights[runs] = 0.0
    possible = np.ones(len(runs), bool)
    for slots in (states.rows, states.columns):
        possible &= ~slots.touching(slots.loads(weights) > 1 - SOME_ROOM, runs)
    runs, wanted = runs[possible], wanted[possible]
    weights[runs] = wanted
    clash = np.zeros(len(runs), bool)
    for slots in (states.rows, states.columns):
        clash |= slots.touching(_too_full(slots, weights), runs)
    runs, wanted = runs[clash], wanted[clash]
    weights[runs] = 0.0
    room = [
        (1.0 - slots.loads(weights), slots.begin[runs], slots.end[runs])
        for slots in (states.rows, states.columns)
        if len(runs)
    ]
    length = states.end[runs] - states.begin[runs]
    for k in np.argsort(length, kind="stable").tolist():
        spans = [own[begin[k] : end[k]] for own, begin, end in room]
        kept = max(min(wanted[k], *(float(span.min(initial=1.0)) for span in spans)), 0.0)
        weights[runs[k]] = kept
        for span in spans:
            span -= kept


BATCH_STATES = 20_000
"""Fewest states of a batch, except the last, so that calls take little of the time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockBatch:
    """Some neighbouring blocks, what to do with each, and the limit.

    Parameters
    ----------
    states : States
        The blocks.
    wanted : (B,) bool array
        Blocks to solve.
    quickly : (B,) bool array
        Other blocks, which stay open unless solving them takes hardly any time.
    weights, prices : (S,), (K,) float arrays
        Arrays for the answer (`Solution` explains them); zeros in the wanted blocks at first.
    limit : Limit
        Time limit and request to stop.
    progress : BatchProgress
        Receiver of the bounds during the work.
    warm_start : WarmStart, optional
        Proposals that may already solve some blocks.
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
    """Answer of a batch or of a window; the weights and prices are in the arrays of the batch.

    Parameters
    ----------
    iterations : int
        Number of sweeps, plus the number of iterations of programmes.
    status, detail : Status, str
        Reason for the end of the work, and details of the reason, for the user.
    open : int array
        Blocks that were not solved.
    work : int
        Number of states, including "none", summed over all half sweeps.
    sweeping : float
        Seconds of sweeps.
    seconds : dict
        Seconds by kind of work.
    history : tuple of dict
        A dict for each check of the bounds, with ``sweep``, ``epsilon``, ``violation``, ``lower``
        and ``upper``. The last two are bounds of the cost of the blocks, minus the cost of leaving
        all objects unassigned.
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
"""Function that writes weights and prices of trivial blocks, and returns the other blocks."""


@dataclass(frozen=True)
class Routine:
    """Functions with which a solver solves each batch, and their settings.

    Parameters
    ----------
    trivial : Trivial
        One of the functions of `solvers.trivial`.
    solve : callable
        Function that solves one batch; called from several threads.
    jobs : int, optional
        Number of threads; all cores by default.
    tries : bool
        True if `solve` also tries the blocks in `BlockBatch.quickly`.
    resumes : bool
        True if `solve` can use a warm start. Only then are long blocks first solved in windows in
        time.
    """

    trivial: Trivial
    solve: Callable[[BlockBatch], Answer]
    jobs: int | None
    tries: bool = False
    resumes: bool = False


class BatchSolver(Solver):
    """Solver that solves blocks batch by batch."""

    @property
    @abstractmethod
    def routine(self) -> Routine:
        """Functions that solve each batch, and their settings."""

    def __call__(
        self, states: States, stopwatch: Stopwatch, warm_start: WarmStart | None = None
    ) -> Solution:
        """Solve batch by batch, trivial blocks first, and join the answers.

        Parameters
        ----------
        states : States
            The reduced problem.
        stopwatch : Stopwatch
            Receiver of the time by kind of work. With several threads, the elapsed time is divided
            among the kinds of work like the sum of the times of all threads.
        warm_start : WarmStart, optional
            Proposals that may already solve some blocks; ignored if `Routine.resumes` is False.
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
    """Solve blocks batch by batch; `masks` are `wanted` and `quickly` of a `BlockBatch`.

    A block that is solved in windows is a batch by itself, which begins from their joined answer.
    """
    wanted, quickly = masks
    weights = np.zeros(len(states.begin))
    prices = np.zeros(len(states.columns.step))

    long: Ints = np.zeros(0, np.int64)
    if routine.resumes and warm_start is None and not limit.late():
        long = divisible_blocks(states)
        long = long[wanted[long] & ~quickly[long]]
    cuts = _separated(states.cuts(BATCH_STATES), long)
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
        with np.errstate(under="ignore"):  # each thread begins with the default error handling
            answer = _answer(batch, routine)
            if limit.progress.watched and len(cuts) > 1:
                batch.progress.finish()
        return answer

    windows: list[Callable[[], Answer]] = []
    if len(long):
        shares = TimeShares(limit, routine.jobs or cores())
        inner = replace(routine, jobs=1, resumes=False)
        for number, span in enumerate(cuts):
            if span[0] in long:
                divided[number] = Division(states.between(*span)[0])

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
    solved = list(in_order(lambda task: task(), first, threads))
    by_number = dict(zip(whole, solved[len(windows) :], strict=True))
    by_number.update(zip(last, in_order(work, last, min(threads, len(last))), strict=True))
    answers = [by_number[number] for number in range(len(cuts))]
    _book(stopwatch, [*solved[: len(windows)], *answers], time.perf_counter() - begin)

    missing = sum(len(answer.open) for answer in answers)
    open_ = np.zeros(len(states.block_begin), bool)
    for (low, _), answer in zip(cuts, answers, strict=True):
        open_[low + answer.open] = True
    # If some batches were not solved, report the reason of one of these.
    ended = [a for a in answers if len(a.left) and (len(a.open) or not missing)] or [Answer()]
    worst = next((answer for answer in ended if not answer.status.good), ended[0])
    return Solution(
        weights=weights,
        prices=prices,
        status=worst.status,
        detail=worst.detail,
        unsolved=(missing, sum(len(a.left) for a in answers)) if missing else None,
        iterations=sum(answer.iterations for answer in (*solved[: len(windows)], *answers)),
        finished=not missing,
        history=_merge(states, cuts, answers, weights),
        disposable=True,
        missing=open_,
    )


def _separated(cuts: list[tuple[int, int]], long: Ints) -> list[tuple[int, int]]:
    """Return the ranges of blocks, divided so that each block in `long` is a range by itself."""
    if not len(long):
        return cuts
    edges = sorted({*(low for low, _ in cuts), cuts[-1][1], *long.tolist(), *(long + 1).tolist()})
    return list(itertools.pairwise(edges))


def _solve_window(
    division: Division, routine: Routine, window: TimeWindow, shares: TimeShares
) -> Answer:
    """Solve one window of a block, and keep its core; called from several threads."""
    watch, begin = Stopwatch(), time.perf_counter()
    piece = division.problem_of(window)
    every = np.ones(len(piece.block_begin), bool)
    preparation = time.perf_counter() - begin
    with np.errstate(under="ignore"):
        solution = _solve_some(piece, (every, ~every), routine, watch, shares.take(), None)
    begin = time.perf_counter()
    division.take(window, piece, solution.weights, solution.prices)
    seconds = {name.removeprefix("solve/"): span for name, span in watch.spans.items()}
    preparation += time.perf_counter() - begin
    seconds["preparation"] = seconds.get("preparation", 0.0) + preparation
    return Answer(
        iterations=solution.iterations, work=watch.work, sweeping=watch.busy, seconds=seconds
    )


def _answer(batch: BlockBatch, routine: Routine) -> Answer:
    """Solve a batch: trivial blocks first, then the other wanted blocks."""
    states, quickly = batch.states, batch.quickly
    begin = time.perf_counter()
    left = routine.trivial(states, batch.weights, batch.prices)
    not_trivial = np.zeros(len(quickly), bool)
    not_trivial[left] = True
    batch = replace(batch, wanted=batch.wanted & not_trivial)
    tentative = bool(quickly.any())
    if tentative:  # far cutoffs: trivial answers are too inexact, because gains are near 1
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
    spent = answer.seconds
    for name, seconds in (("rounding", time.perf_counter() - begin), ("preparation", preparation)):
        spent[name] = spent.get(name, 0.0) + seconds
    return answer


def _book(stopwatch: Stopwatch, answers: list[Answer], elapsed: float) -> None:
    """Record the work in the stopwatch, and the elapsed time divided among the kinds of work."""
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
    """Merge histories: costs are added, and the last check of a shorter history is repeated."""
    recorded = [answer for answer in answers if answer.history]
    merged: list[dict[str, float]] = []
    if not recorded:
        return ()
    problem = states.problem
    base = float(problem.truth_price.sum() + problem.estimate_price.sum())
    for span, answer in zip(cuts, answers, strict=True):
        part, state, _ = states.between(*span)
        trivial = block_costs(part, weights[state]) - unassigned_costs(part)
        trivial[answer.left] = 0.0
        base += float(trivial.sum())
    for k in range(max(len(answer.history) for answer in recorded)):
        at = [answer.history[min(k, len(answer.history) - 1)] for answer in recorded]
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
