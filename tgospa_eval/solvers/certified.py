"""The exact solver: prices by entropic ascent, a linear programme for what they leave open.

Whatever happens here only proposes; the bracket is made by `tgospa_eval.result.certify`.
"""

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tgospa_eval.compiled import kernels
from tgospa_eval.problem import Floats, Ints
from tgospa_eval.result import Solution
from tgospa_eval.solvers.ascent import TEMPTED, Ascent
from tgospa_eval.solvers.batches import LATE, Answer, Batch, check_jobs, solve_in_batches
from tgospa_eval.solvers.kernels import check_gap, check_time_limit
from tgospa_eval.solvers.limits import load
from tgospa_eval.solvers.trivial import solve_conflict_free, solve_steps
from tgospa_eval.states import States
from tgospa_eval.timing import Stopwatch
from tgospa_eval.weights import ONE, repair

if TYPE_CHECKING:
    from tgospa_eval.solvers.offers import Offer
    from tgospa_eval.solvers.residual import Proposal

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
        self, states: States, stopwatch: Stopwatch, offered: "Offer | None" = None
    ) -> Solution:
        """Solve every block exactly, or as far as the time limit allows.

        What is offered, from neighbouring problems, may solve some; without kernels it is not used.
        """
        trivial, solve = solve_steps, self._ascend
        if not kernels:
            from tgospa_eval.solvers.contest import solve_contest as solve

            trivial = solve_conflict_free
        return solve_in_batches(
            states,
            trivial,
            solve,
            stopwatch,
            gap=self.gap,
            time_limit=self.time_limit,
            jobs=self.jobs,
            offered=offered,
        )

    def _ascend(self, batch: Batch) -> Answer:
        """Stages of sweeps, then programmes, until no bracket is wide."""
        begin = time.perf_counter()
        ascent = Ascent(batch.states, batch.wanted, self.gap, batch.weights, batch.prices)
        preparation = time.perf_counter() - begin
        half = 0.5 * min(float(ascent.crossing.max()), 1.0)
        iterations, skip = 0, False
        programmes = _Programmes(ascent, batch)
        if batch.offered is not None:
            ascent.offer_prices(batch.offered.prices)
            for weights in batch.offered.weights:
                ascent.offer_weights(weights)
        ascent.keep(ascent.wide(self.gap))
        left = np.flatnonzero(ascent.open)
        near = batch.offered is not None and batch.offered.near
        if near:
            ascent.soft[:] = ascent.prices
        for epsilon, sweeps in RESUMED if near else STAGES:
            if not ascent.open.any() or batch.late():
                break
            if skip:
                skip = False
                continue
            done, _ = ascent.stage(
                epsilon, sweeps, min(10 * epsilon, 1.3) + half, batch.late,
                CALM if epsilon > WARM else 0.0,
            )  # fmt: skip
            iterations += done
            ascent.keep(ascent.wide(self.gap))
            cost = ascent.cost[ascent.open].sum()
            skip = ascent.gap[ascent.open].sum() < EASY * cost and epsilon > EARLY * 2
            if epsilon <= EARLY and ascent.gap[ascent.open].sum() < HOPE * cost:
                programmes.run(SMALL, self.gap, most=FEW)
        if near:
            programmes.run(FAR, self.gap, most=FEW)
        programmes.run(ROUNDS, self.gap, most=None)
        wide = ascent.wide(self.gap)
        return Answer(
            iterations=iterations + programmes.iterations,
            status=(LATE if batch.late() else "not solved") if wide.any() else "solved",
            open=np.flatnonzero(wide),
            left=left,
            wide=np.flatnonzero(wide),
            work=ascent.work,
            sweeping=ascent.sweeping,
            seconds={"preparation": preparation, **ascent.seconds, "lp": programmes.seconds},
        )


class _Programmes:
    """Linear programmes on the states that the ascent left undecided."""

    def __init__(self, ascent: Ascent, batch: Batch) -> None:
        self.ascent, self.batch = ascent, batch
        self.tempted = np.zeros(len(ascent.states.begin), bool)
        self.interior = False
        self.iterations, self.seconds = 0, 0.0

    def run(self, rounds: tuple[tuple[float, float], ...], gap: float, most: int | None) -> None:
        """One programme a round until the brackets are met, or it would be larger than `most`."""
        ascent = self.ascent
        begin, stuck = time.perf_counter(), 0.0
        for reach, box in rounds:
            if self.batch.late() or not ascent.open.any():
                break
            if reach == stuck:
                continue
            ascent.survey(ascent.prices, reach)
            free = ascent.undecided(self.tempted)
            if not len(free) and np.isinf(reach):  # regret that passes for rounding
                pairs = ascent.open[ascent.states.pair_block]
                free = np.flatnonzero(np.repeat(pairs, np.diff(ascent.states.pair_first)))
            if most is not None and len(free) > most:
                break
            if not len(free):  # what keeps the bracket open is farther away
                continue
            before = ascent.gap[ascent.open].sum()
            self._solve(free, box)
            ascent.keep(ascent.wide(gap))
            after, cost = ascent.gap[ascent.open].sum(), ascent.cost[ascent.open].sum()
            if most is None and after > max(STUCK * before, HOPE * cost):
                stuck = reach
        self.seconds += time.perf_counter() - begin

    def _solve(self, free: Ints, box: float) -> None:
        """Propose what is best for the free states, refined where tolerances keep a bracket open.

        The prices of a programme may miss the best by `TOLERANCE` for each state.
        """
        from tgospa_eval.solvers.residual import refined, residual  # HiGHS: slow to import

        ascent = self.ascent
        found = residual(
            ascent.states, free, ascent.weights, ascent.prices, ascent.crossing, box,
            self.batch.left(), interior=self.interior,
        )  # fmt: skip
        self.interior = found.interior
        self._propose(free, found)
        wide = ascent.wide(ascent.wanted_gap)
        if wide.any() and ascent.gap[wide].sum() <= TOLERANCE * len(free):
            self._propose(free, refined(found, self.batch.left()))
        self.iterations += found.iterations

    def _propose(self, free: Ints, found: "Proposal") -> None:
        """Offer weights and prices; mixtures of prices may be better."""
        ascent = self.ascent
        self._propose_weights(free, found.weights)
        prices = ascent.prices.copy()
        before = prices[found.slot]
        prices[found.slot] = found.prices
        ascent.offer_prices(prices)
        ascent.survey(prices, 0.0)
        self.tempted |= ascent.has(TEMPTED)
        for share in (0.5, 0.2):
            prices[found.slot] = share * found.prices + (1 - share) * before
            ascent.offer_prices(prices)
        prices[:] = ascent.prices
        prices[~ascent.full()] = 0.0
        ascent.offer_prices(prices)

    def _propose_weights(self, free: Ints, weights: Floats) -> None:
        """Offer the weights for the free states, made feasible."""
        states = self.ascent.states
        proposed = self.ascent.weights.copy()
        proposed[free] = np.where(weights < SNAP, 0.0, np.where(weights > 1 - SNAP, 1.0, weights))
        if any(
            load(slots, proposed).max(initial=0.0) > 1 + OVERFULL
            for slots in (states.rows, states.columns)
        ):
            proposed = repair(states, proposed) / ONE
        self.ascent.offer_weights(proposed)
