"""The certified solver: sweeps first, then linear programmes for the states that stay undecided.

The sweeps are in `solvers.dual_ascent`, and the programmes in `solvers.lp_rounds`. All results are
only proposals. `problem.certificate.certify` proves the bounds that are reported. Words and
letters: `solvers`.
"""

import time
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from tgospa_eval.common.arrays import places_of
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Status
from tgospa_eval.kernels import kernels
from tgospa_eval.solvers.batches import Answer, BatchSolver, BlockBatch, Routine
from tgospa_eval.solvers.dual_ascent import Ascent
from tgospa_eval.solvers.lp_rounds import Programmes, solve_whole
from tgospa_eval.solvers.trivial import solve_conflict_free, solve_steps
from tgospa_eval.solvers.tuning import (
    ASCENT,
    CROWDS,
    PROGRAMMES,
    TIME_WINDOWS,
    WINDOWS,
    Stage,
    check_settings,
)


@dataclass(frozen=True, kw_only=True)
class Certified(BatchSolver):
    """Exact solver with a proof (docs/theory/solvers.md, "The certified solver").

    Parameters
    ----------
    gap : float
        Relative gap of the total that counts as exact.
    time_limit : float, optional
        Seconds; the solution reached by then is returned, with proven bounds.
    jobs : int, optional
        Number of threads; all cores by default. The result does not depend on it.

    Raises
    ------
    ConfigError
        A setting is out of its range.
    """

    name: ClassVar[str] = "certified"
    proves: ClassVar[bool] = True
    gap: float = 1e-9
    time_limit: float | None = None
    jobs: int | None = None

    def __post_init__(self) -> None:
        check_settings(self, gap=self.gap, time_limit=self.time_limit, jobs=self.jobs)

    @property
    def routine(self) -> Routine:
        """Functions that solve every block exactly, or as far as the time limit allows.

        With compiled kernels, a warm start may solve some blocks without further work.
        """
        return Routine(
            solve_steps if kernels else solve_conflict_free,
            self._ascend if kernels else solve_whole,
            self.jobs,
            tries=bool(kernels),
            resumes=bool(kernels),
        )

    def _ascend(self, batch: BlockBatch) -> Answer:
        """Run stages of sweeps, then programmes, until all gaps are small."""
        begin = time.perf_counter()
        tried = batch.wanted | batch.quickly
        near = batch.warm_start is not None and batch.warm_start.near
        if near and batch.warm_start is not None:  # these prices are better than prices 0
            np.copyto(batch.prices, batch.warm_start.prices, where=batch.states.slots_of(tried))
        ascent = Ascent(batch.states, tried, self.gap, batch.weights, batch.prices)
        preparation = time.perf_counter() - begin
        programmes = Programmes(ascent, batch)
        if batch.limit.progress.watched:
            programmes.report_progress()
        if batch.warm_start is not None:
            if not near:
                ascent.try_prices(batch.warm_start.prices)
            for weights in batch.warm_start.weights:
                ascent.try_weights(weights)
        ascent.keep(ascent.wide())
        left = places_of(ascent.open)
        # Blocks in `quickly` that are not solved yet stay open.
        too_far = ascent.open & batch.quickly
        ascent.keep(ascent.open & ~too_far)
        unit = 1.0 if batch.warm_start else _try_steps(ascent)
        if near and len(batch.weights) >= TIME_WINDOWS.min_states:  # sweeps of all states take long
            programmes.run(PROGRAMMES.early, max_states=PROGRAMMES.early_states)
        iterations = _sweep(ascent, programmes, batch, near=near, unit=unit)
        if near:
            programmes.run(PROGRAMMES.resumed, max_states=PROGRAMMES.early_states)
        if programmes.crowd:
            programmes.run_crowd()
        if ascent.open_gap > PROGRAMMES.early_gap * ascent.open_cost:
            reach = programmes.close_reach()
            programmes.run((reach, 2 * reach, 4 * reach))
        programmes.run(PROGRAMMES.rounds)
        wide = ascent.wide() | too_far
        late = batch.limit.status if batch.limit.late() else Status.NOT_SOLVED
        return Answer(
            iterations=iterations + programmes.iterations,
            status=late if wide.any() else Status.SOLVED,
            open=places_of(wide),
            left=left,
            work=ascent.work,
            sweeping=ascent.sweeping,
            seconds={"preparation": preparation, **ascent.seconds, "lp": programmes.seconds},
        )


def _try_steps(ascent: Ascent) -> float:
    """Solve each step separately if switches cost nearly nothing; return a unit for `_sweep`."""
    price = float(ascent.switch_price.max())
    if not ascent.open.any() or price >= ASCENT.stages[-1][0]:
        return 1.0
    ascent.try_steps()
    ascent.keep(ascent.wide())
    near = ascent.open_gap < PROGRAMMES.nearly * ascent.open_cost
    return ASCENT.free * price if near else 1.0


def _sweep(
    ascent: Ascent, programmes: Programmes, batch: BlockBatch, *, near: bool, unit: float
) -> int:
    """Run stages from high to low temperatures, with programmes between; count the sweeps.

    The `unit` of temperatures and reaches is a fraction of c^p. As a rule, the stages begin from
    zero prices. They begin from the current prices in two cases: these are `near` the best prices,
    or the `unit` is below 1, so that the errors of the current prices are about one unit.
    """
    if near or unit < 1:
        ascent.soft[:] = ascent.prices
    half = 0.5 * min(float(ascent.switch_price.max()), 1.0)
    large = len(batch.weights) > WINDOWS.large
    small = len(batch.weights) <= ASCENT.small
    early_from = PROGRAMMES.early_from_small if small else PROGRAMMES.early_from
    stages = ASCENT.small_stages if small else ASCENT.stages
    skip_above = ASCENT.skip_above_large if large else ASCENT.skip_above
    sweeps, skip = 0, False
    for stage in ASCENT.resumed if near else stages:
        if not ascent.open.any() or batch.limit.late():
            break
        if skip:
            skip = False
            continue
        epsilon = stage[0]
        reach = unit * min(10 * epsilon, 1.3) + half
        sweeps += _stage(ascent, (unit * epsilon, stage[1]), reach, batch.limit.late)
        ascent.keep(ascent.wide())
        if batch.limit.progress.watched:
            programmes.report_progress()
        skip = ascent.open_gap < unit * ASCENT.skip * ascent.open_cost and epsilon > skip_above
        coldest = CROWDS.coldest
        if len(batch.weights) <= CROWDS.large:
            coldest = min(coldest, CROWDS.of_located * ascent.located_cost / unit)
        if epsilon <= coldest and len(batch.weights) > CROWDS.size:
            programmes.crowd |= ascent.undecidedness > CROWDS.undecided
        if programmes.crowd:
            continue
        if epsilon <= early_from and ascent.open_gap < PROGRAMMES.early_gap * ascent.open_cost:
            programmes.run(PROGRAMMES.early, max_states=PROGRAMMES.early_states)
            programmes.run_nearby(PROGRAMMES.rounds[0])
    return sweeps


def _stage(ascent: Ascent, stage: Stage, threshold: float, late: Callable[[], bool]) -> int:
    """Repeat a stage with new working sets until prices settle; count the sweeps."""
    calm = ASCENT.calm if stage[0] > ASCENT.calm_above else 0.0
    sweeps = 0
    for _ in range(ASCENT.repeats):
        before = ascent.open_dual
        done, violation = ascent.stage(*stage, threshold, late, calm)
        sweeps += done
        gained = before - ascent.open_dual
        settled = violation < max(calm, ASCENT.settled)
        if settled or late() or gained < ASCENT.gained * ascent.open_cost:
            break
    return sweeps
