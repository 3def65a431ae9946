"""The exact solver: prices by entropic ascent, a linear programme for what they leave open.

Whatever happens here only proposes; the bracket is made by `problem.solution.certify`.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.progress import StoppedError
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.problem.compiled import kernels
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE, repair
from tgospa_eval.solvers.batches import Answer, Batch, solve_in_batches
from tgospa_eval.solvers.bracket_progress import share_of_digits
from tgospa_eval.solvers.capacities import load
from tgospa_eval.solvers.dual_ascent import Ascent
from tgospa_eval.solvers.settings import check_gap, check_jobs, check_time_limit
from tgospa_eval.solvers.subproblem import cut_out
from tgospa_eval.solvers.trivial import solve_conflict_free, solve_steps

if TYPE_CHECKING:
    from tgospa_eval.solvers.restricted_lp import Proposal
    from tgospa_eval.solvers.warm_start import WarmStart

T = TypeVar("T")

STAGES = ((0.1, 16), (0.05, 16), (0.02, 16), (0.01, 64), (0.005, 64), (0.002, 64), (0.001, 64))
"""Temperatures, as fractions of c^p, and sweeps at each."""

RESUMED = ((0.01, 32), (0.005, 32), (0.002, 64), (0.001, 64))
"""The same from the solution of a problem like this one."""

CALM, WARM = 0.1, 0.01
"""Above the temperature, columns violated by less than this are good enough to go on."""

EASY = 0.01
"""A bracket that is narrower than this fraction of the cost may skip a stage."""

EARLY, HOPE = 0.01, 0.005
"""From this temperature on, and with a bracket so narrow, a small programme is tried."""

FEW = 3000
"""States of a small programme."""

SMALL = ((0.05, 0.02), (0.2, 0.05))
FAR = 2 * ((0.05, 0.02), (0.05, 0.1))
ROUNDS = ((0.3, 0.07), (0.3, 0.05), (0.3, 0.05), (0.4, 0.1), (1.0, 0.3), (np.inf, np.inf))
"""Slack of the states that enter a programme, and how far it may move prices: much less, or the
states that are left out would win, yet not so little that it takes many rounds. Early; after the
stages where a solution nearby was given, of which a few prices may be far off; and at the end.
"""

MODEL = 3000
"""States of components that share a programme: the time of the simplex method grows faster than
its size, so that components in one programme cost more than one after the other."""

MANY, SPAN, WIDEN, SHRINK = 50_000, 25, 4, 0.3
"""Where more states than this are undecided, programmes take those within so many steps of what
keeps a bracket open; the span grows by that factor where more than this share of it stays."""

LARGE, SHARE = 200_000, 0.02
"""A problem with more states is searched in windows before the temperature falls further, as long
as no more than this share of its states is undecided there: a stage of sweeps takes about as long.
"""

FARTHER = 1.0
"""Reach in a window that did not help, before the span grows."""

QUICK = 500
"""States of a programme that is solved before anyone waits."""

BUILD = 1e-5
"""Seconds that building a programme takes for each state of it, and HiGHS to begin: 3 to 10 us."""

AFTER = 10
"""Steps after the last state of a programme in which what it loses may still show."""

STUCK = 0.5
"""A round at the end that leaves more than this of a wide gap is followed by one that reaches
farther."""

TOLERANCE = 1e-9
"""What HiGHS takes for zero."""

SNAP, OVERFULL = 1e-9, 1e-15
"""Weights of a programme that are this near to 0 or 1 are meant to be; sums of them that exceed 1
by more than rounding are scaled."""


@dataclass(frozen=True, kw_only=True)
class Certified:
    """Exact, with proof (docs/theory, "The certified solver").

    Parameters
    ----------
    gap : float
        Relative gap of the total that counts as exact.
    time_limit : float, optional
        Seconds; what is reached by then is bracketed and returned.
    jobs : int, optional
        Threads; all cores by default. The result does not depend on it.

    Raises
    ------
    ConfigError
        A setting is out of its range.
    """

    name: ClassVar[str] = "certified"
    gap: float = 1e-9
    time_limit: float | None = None
    jobs: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "gap", check_gap(self.gap))
        object.__setattr__(self, "time_limit", check_time_limit(self.time_limit))
        object.__setattr__(self, "jobs", check_jobs(self.jobs))

    def __call__(
        self, states: States, stopwatch: Stopwatch, warm_start: "WarmStart | None" = None
    ) -> Solution:
        """Solve every block exactly, or as far as the time limit allows.

        A warm start, from neighbouring problems, may solve some; without kernels it is not used.
        """
        return solve_in_batches(
            states,
            solve_steps if kernels else solve_conflict_free,
            self._ascend if kernels else _without_kernels,
            stopwatch,
            gap=self.gap,
            time_limit=self.time_limit,
            jobs=self.jobs,
            warm_start=warm_start if kernels else None,
            tries=bool(kernels),
        )

    def _ascend(self, batch: Batch) -> Answer:
        """Stages of sweeps, then programmes, until no bracket is wide."""
        begin = time.perf_counter()
        tried = batch.wanted | batch.quickly
        ascent = Ascent(batch.states, tried, self.gap, batch.weights, batch.prices)
        preparation = time.perf_counter() - begin
        half = 0.5 * min(float(ascent.switch_price.max()), 1.0)
        iterations, skip = 0, False
        programmes = _Programmes(ascent, batch)
        programmes.report_progress()
        if batch.warm_start is not None:
            ascent.try_prices(batch.warm_start.prices)
            for weights in batch.warm_start.weights:
                ascent.try_weights(weights)
        ascent.keep(ascent.wide(self.gap))
        left = np.flatnonzero(ascent.open)
        too_far = ascent.open & batch.quickly
        ascent.keep(ascent.open & ~too_far)
        near = batch.warm_start is not None and batch.warm_start.near
        if near:
            ascent.soft[:] = ascent.prices
        for epsilon, sweeps in RESUMED if near else STAGES:
            if not ascent.open.any() or batch.limit.late():
                break
            if skip:
                skip = False
                continue
            done, _ = ascent.stage(
                epsilon, sweeps, min(10 * epsilon, 1.3) + half, batch.limit.late,
                CALM if epsilon > WARM else 0.0,
            )  # fmt: skip
            iterations += done
            ascent.keep(ascent.wide(self.gap))
            programmes.report_progress()
            cost = ascent.cost[ascent.open].sum()
            # A long recording has some hard spots, however narrow the bracket of the whole is.
            last = 0.05 if len(batch.weights) > LARGE else 2 * EARLY
            skip = ascent.gap[ascent.open].sum() < EASY * cost and epsilon > last
            if epsilon <= EARLY and ascent.gap[ascent.open].sum() < HOPE * cost:
                programmes.run(SMALL, self.gap, most=FEW)
                programmes.run_nearby(*ROUNDS[0], self.gap)
        if near:
            programmes.run(FAR, self.gap, most=FEW)
        programmes.run(ROUNDS, self.gap, most=None)
        wide = ascent.wide(self.gap) | too_far
        return Answer(
            iterations=iterations + programmes.iterations,
            status=(batch.limit.status if batch.limit.late() else "not solved")
            if wide.any()
            else "solved",
            open=np.flatnonzero(wide),
            left=left,
            work=ascent.work,
            sweeping=ascent.sweeping,
            seconds={"preparation": preparation, **ascent.seconds, "lp": programmes.seconds},
        )


class _Programmes:
    """Linear programmes on the states that the ascent left undecided."""

    def __init__(self, ascent: Ascent, batch: Batch) -> None:
        self.ascent, self.batch = ascent, batch
        self.tried = batch.wanted | batch.quickly
        self.tempted = np.zeros(len(ascent.states.begin), bool)
        self.interior = False
        self.iterations, self.seconds = 0, 0.0

    def report_progress(self) -> None:
        """How far the brackets are, for whoever watches."""
        ascent, tried = self.ascent, self.tried
        width, cost = ascent.gap, ascent.cost
        share = share_of_digits(width[ascent.open].sum(), cost[tried].sum(), ascent.wanted_gap)
        self.batch.progress.update(self.batch, tried, width, cost, ascent.unassigned_cost, share)

    def run(self, rounds: tuple[tuple[float, float], ...], gap: float, most: int | None) -> None:
        """A round of programmes each, until the brackets are met; components up to `most` states.

        Where very much is undecided, programmes look at the neighbourhood of what keeps the
        brackets open first.
        """
        ascent = self.ascent
        begin, stuck = time.perf_counter(), 0.0
        for reach, box in rounds:
            if self.batch.limit.late() or not ascent.open.any():
                break
            if reach == stuck:
                continue
            ascent.survey(ascent.prices, reach)
            near = ascent.near(self.tempted)
            if np.count_nonzero(near) > MANY:
                self._run_windows(near, reach, box, gap, most, len(near))
                continue
            before = ascent.gap[ascent.open].sum()
            if not self._solve_undecided(near, box, gap, most):
                break
            after, cost = ascent.gap[ascent.open].sum(), ascent.cost[ascent.open].sum()
            if most is None and after > max(STUCK * before, HOPE * cost):
                stuck = reach
        self.seconds += time.perf_counter() - begin

    def run_nearby(self, reach: float, box: float, gap: float) -> None:
        """Of a large problem only: programmes in windows, unless sweeps of all take less time."""
        ascent = self.ascent
        size = len(self.tempted)
        if size < LARGE or self.batch.limit.late() or not ascent.open.any():
            return
        begin = time.perf_counter()
        ascent.survey(ascent.prices, reach)
        self._run_windows(ascent.near(self.tempted), reach, box, gap, None, int(SHARE * size))
        self.seconds += time.perf_counter() - begin

    def _run_windows(
        self,
        near: NDArray[np.bool_],
        reach: float,
        box: float,
        gap: float,
        most: int | None,
        room: int,
    ) -> None:
        """Programmes around the steps that keep the brackets open, in growing windows of time.

        Components of more than `most` states are left out, and windows of more than `room`.
        """
        ascent = self.ascent
        steps = ascent.states.problem.steps
        span, farther = SPAN, reach
        while ascent.open.any() and not self.batch.limit.late():
            before = ascent.gap[ascent.open].sum()
            if span < steps:
                around = _windows(
                    ascent.losses(ascent.prices), 0.25 * gap * ascent.cost[ascent.open].sum(), span
                )
                around = ascent.within(near, around)
                if np.count_nonzero(around) > room:
                    return
                self._solve_undecided(around, box, gap, most)
            else:
                self._solve_undecided(near, box, gap, most)
                return
            if ascent.gap[ascent.open].sum() > SHRINK * before:
                if most is not None:
                    return
                # Either states that were left out win now, or the window is too short.
                if farther < FARTHER:
                    farther = FARTHER
                else:
                    span, farther = span * WIDEN, reach
            ascent.survey(ascent.prices, farther)
            near = ascent.near(self.tempted)

    def _solve_undecided(
        self, near: NDArray[np.bool_], box: float, gap: float, most: int | None
    ) -> bool:
        """Solve what has to be decided among the states near; False if all of it is too large."""
        states = self.ascent.states
        free, component = self.ascent.undecided(near)
        if not len(free) and np.isinf(box):  # what keeps the bracket open passes for rounding
            pairs = self.ascent.open[states.pair_block]
            free = np.flatnonzero(np.repeat(pairs, np.diff(states.pair_first)))
            component = states.pair_block[states.pair[free]]
        groups = _groups(states, free, component, most)
        if groups:
            self._solve(groups, box)
            self.ascent.keep(self.ascent.wide(gap))
        # Where there is nothing to decide, what keeps the bracket open is farther away.
        return bool(groups) or not len(free)

    def _solve(self, groups: list[Ints], box: float) -> None:
        """Propose what is best for each group of states, refined where tolerances matter.

        The prices of a programme may miss the best by `TOLERANCE` for each state.
        """
        ascent, solved = self.ascent, []
        for group in groups:
            left = self.batch.limit.left()
            if left is not None and left <= BUILD * len(group):
                break
            try:
                solved.append(self._solve_group(group, box, len(groups) == 1))
            except StoppedError:
                break
        if not solved:
            return
        self._propose(solved)
        self.report_progress()
        wide = ascent.wide(ascent.wanted_gap)
        size = sum(len(one.free) for one in solved)
        if wide.any() and ascent.gap[wide].sum() <= TOLERANCE * size:
            from tgospa_eval.solvers.restricted_lp import refine  # HiGHS: slow to import

            with suppress(StoppedError):
                exact = self._apart(
                    lambda: [
                        replace(one, found=refine(one.found, self.batch.limit.left()))
                        for one in solved
                    ],
                    size,
                )
                self._propose(exact)
                self.report_progress()

    def _propose(self, solved: "list[_Solved]") -> None:
        """WarmStart weights and prices; mixtures of prices may be better."""
        ascent = self.ascent
        weights, prices = ascent.weights.copy(), ascent.prices.copy()
        for one in solved:
            weights[one.free] = one.found.weights
            prices[one.slot] = one.found.prices
        wide = ascent.gap[ascent.open].sum()
        self._propose_weights(np.concatenate([one.free for one in solved]), weights)
        slot = np.concatenate([one.slot for one in solved])
        found, before = prices[slot], ascent.prices[slot]
        if len(solved) > 1:
            self._try_best(solved, prices)
        ascent.try_prices(prices)
        ascent.survey(prices, 0.0)
        self.tempted |= ascent.has(kernels.TEMPTED)
        if len(solved) > 1 and ascent.gap[ascent.open].sum() < 0.5 * wide:
            return
        for share in (0.5, 0.2):
            prices[slot] = share * found + (1 - share) * before
            ascent.try_prices(prices)
        prices[:] = ascent.prices
        prices[~ascent.full()] = 0.0
        ascent.try_prices(prices)

    def _try_best(self, solved: "list[_Solved]", prices: Floats) -> None:
        """WarmStart the new prices of the groups in whose time less is lost by them."""
        ascent = self.ascent
        states, prices = ascent.states, prices.copy()
        change = ascent.losses(prices)
        change -= ascent.losses(ascent.prices)
        change = np.concatenate(([0.0], np.cumsum(change)))
        for one in solved:
            begin, end = states.begin[one.free].min(), states.begin[one.free].max() + AFTER
            if change[min(end, len(change) - 1)] > change[begin]:
                prices[one.slot] = ascent.prices[one.slot]
        ascent.try_prices(prices)

    def _solve_group(self, free: Ints, box: float, whole: bool) -> "_Solved":
        """Solve one programme."""
        from tgospa_eval.solvers.restricted_lp import (
            solve_restricted_lp,  # HiGHS: slow to import, not always used
        )

        ascent, left = self.ascent, self.batch.limit.left()
        if left is not None:
            left = max(left - BUILD * len(free), 0.0)
        given = ascent.weights, ascent.prices
        if whole:
            found = self._apart(
                lambda: solve_restricted_lp(
                    ascent.states,
                    free,
                    *given,
                    ascent.switch_price,
                    box,
                    left,
                    interior=self.interior,
                ),
                len(free),
            )
            slot = found.slot
        else:
            piece = cut_out(ascent.states, free)
            found = self._apart(
                lambda: solve_restricted_lp(
                    piece.states, piece.free, given[0][piece.state], given[1][piece.slot],
                    ascent.switch_price, box, left, interior=self.interior,
                ),
                len(free),
            )  # fmt: skip
            slot = piece.slot[found.slot]
        self.interior = found.interior
        self.iterations += found.iterations
        return _Solved(free=free, slot=slot, found=found)

    def _apart(self, work: Callable[[], T], size: int) -> T:
        """Do work with a programme of so many states; HiGHS cannot be stopped, but left behind.

        Raises
        ------
        StoppedError
            It is.
        """
        return self.batch.limit.progress.apart(work) if size > QUICK else work()

    def _propose_weights(self, free: Ints, weights: Floats) -> None:
        """WarmStart the weights (S,), of which those of the free states are new, made feasible."""
        states = self.ascent.states
        proposed, weights = weights, weights[free]
        proposed[free] = np.where(weights < SNAP, 0.0, np.where(weights > 1 - SNAP, 1.0, weights))
        if any(
            load(slots, proposed).max(initial=0.0) > 1 + OVERFULL
            for slots in (states.rows, states.columns)
        ):
            proposed = repair(states, proposed) / ONE
        self.ascent.try_weights(proposed)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Solved:
    """A programme that was solved.

    Parameters
    ----------
    free, slot : int arrays
        Its free states and the slots that it has priced, in the whole.
    found : Proposal
        What it says of them.
    """

    free: Ints
    slot: Ints
    found: "Proposal"


def _groups(states: States, free: Ints, component: Ints, most: int | None) -> list[Ints]:
    """The free states by programme: neighbouring components of up to MODEL states in all, in time.

    Components of more than `most` states are left out.
    """
    _, number, size = np.unique(component, return_inverse=True, return_counts=True)
    if most is not None and size.max(initial=0) > most:
        kept = size[number] <= most
        free = free[kept]
        _, number, size = np.unique(number[kept], return_inverse=True, return_counts=True)
    if len(free) <= MODEL:
        return [free] if len(free) else []
    begin = np.full(len(size), np.iinfo(np.int32).max)
    np.minimum.at(begin, number, states.begin[free])
    in_time = np.argsort(begin, kind="stable")
    group = np.empty(len(size), np.int64)
    group[in_time] = (np.cumsum(size[in_time]) - 1) // MODEL
    of_state = group[number]
    order = np.argsort(of_state, kind="stable")  # in each group the states stay in order
    return np.split(free[order], np.flatnonzero(np.diff(of_state[order])) + 1)


def _windows(lost: Floats, allowed: float, span: int) -> NDArray[np.bool_]:
    """The steps (T,) within `span` of those that lose most, but for as much as is allowed."""
    order = np.argsort(lost)
    bad = order[np.cumsum(lost[order]) > allowed]
    change = np.zeros(len(lost) + 1, np.int32)
    np.add.at(change, np.maximum(bad - span, 0), 1)
    np.subtract.at(change, np.minimum(bad + span + 1, len(lost)), 1)
    around: NDArray[np.bool_] = np.cumsum(change[:-1]) > 0
    return around


def _without_kernels(batch: Batch) -> Answer:
    """Programmes of the rows that compete."""
    from tgospa_eval.solvers.active_set import solve_active_sets  # HiGHS: slow to import

    return solve_active_sets(batch)
