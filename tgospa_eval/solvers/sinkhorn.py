"""The approximation: entropy on the paths, block coordinate ascent in the dual.

    max  sum theta value(path) + epsilon sum H(theta) + epsilon sum H(slack),   H(t) = t - t log t

over mixtures theta of the paths of each row. After Nevelius Wernholm, Wärnsäter and Ringh, "Fast
computation of the TGOSPA metric for multiple target tracking via unbalanced optimal transport"
(docs/theory/solvers.md, "Sinkhorn sweeps"). Reported is the bracket of the prices and of the
rounded assignment, not the entropic value, which is no bound.
"""

import time
from dataclasses import replace
from typing import ClassVar

import numpy as np

from tgospa_eval.common.arrays import Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Status
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.kernels import kernels
from tgospa_eval.solvers.batches import Answer, BatchSolver, BlockBatch, Routine
from tgospa_eval.solvers.dual_ascent import Ascent
from tgospa_eval.solvers.trivial import solve_conflict_free, solve_steps
from tgospa_eval.solvers.tuning import check_settings
from tgospa_eval.solvers.whole_lp import solve_whole

WARM_STAGES = (0.3, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
"""Temperatures on the way to a smaller one, each for `WARM_SWEEPS` sweeps."""

WARM_SWEEPS = 12
CHECK_SWEEPS, CHECKS = 24, 4
"""Sweeps between two looks at the bracket, and how many of these it takes as a rule."""

MOST_SWEEPS = 2000
FULL_TO = 1e-6
NEGLIGIBLE_SLACK = 25.0
"""States with more slack than so many temperatures have a share below 1e-10 and are left out."""


@dataclass(frozen=True, kw_only=True)
class Sinkhorn(BatchSolver):
    """Entropic approximation, with a proven bracket.

    Parameters
    ----------
    epsilon : float
        Temperature as a fraction of c^p, approached from 0.3 in steps.
    gap : float
        Relative gap of the total at which to stop early.
    time_limit : float, optional
        Seconds.
    jobs : int, optional
        Threads; all cores by default. The result does not depend on it.

    Raises
    ------
    ConfigError
        A setting is out of its range.
    """

    name: ClassVar[str] = "sinkhorn"
    epsilon: float = 0.03
    gap: float = 1e-9
    time_limit: float | None = None
    jobs: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "epsilon", real_number("epsilon", self.epsilon))
        if not (self.epsilon > 0 and np.isfinite(self.epsilon)):
            raise ConfigError(f"epsilon is {self.epsilon:g}: must be finite and more than 0")
        check_settings(self, gap=self.gap, time_limit=self.time_limit, jobs=self.jobs)

    @property
    def routine(self) -> Routine:
        """Sweep until the bracket is met or settles, or the columns are full to 1e-6.

        A warm start is passed over: hot sweeps would forget it. Without kernels linear programmes
        are quicker than sweeps, and exact: they take their place.
        """
        return Routine(
            solve_steps if kernels else solve_conflict_free,
            self._sweep if kernels else _without_kernels,
            self.jobs,
        )

    def _sweep(self, batch: BlockBatch) -> Answer:
        """Sweeps of one batch."""
        begin = time.perf_counter()
        ascent = Ascent(batch.states, batch.wanted, self.gap, batch.weights, batch.prices)
        wanted = ascent.wide(0.0)
        ascent.keep(ascent.wide())
        preparation = time.perf_counter() - begin
        half = 0.5 * float(min(batch.states.problem.switch_price_at.max(), 1.0))
        warm = [epsilon for epsilon in WARM_STAGES if epsilon > self.epsilon]
        history: list[dict[str, float]] = []
        status: Status | None = None
        count = 0
        if not ascent.open.any():
            status = Status.MET
            history.append(_check(ascent, wanted, 0, self.epsilon, 0.0))
        while status is None:
            cold = len(history) >= len(warm)
            epsilon = self.epsilon if cold else warm[len(history)]
            sweeps = min(CHECK_SWEEPS if cold else WARM_SWEEPS, MOST_SWEEPS - count)
            before = ascent.gap[wanted].sum()
            done, violation = ascent.stage(
                epsilon, sweeps, NEGLIGIBLE_SLACK * epsilon + half, batch.limit.late
            )
            count += done
            after = ascent.gap[wanted].sum()
            ascent.keep(ascent.wide())
            history.append(_check(ascent, wanted, count, epsilon, violation))
            share = min(len(history) / (len(warm) + CHECKS), 0.95)
            batch.progress.update(wanted, ascent.gap, ascent.cost, ascent.unassigned_cost, share)
            if not ascent.open.any():
                status = Status.MET
            elif batch.limit.late():
                status = batch.limit.status
            elif cold and violation <= FULL_TO:
                status = Status.FULL
            elif cold and after > 0.95 * before:
                status = Status.SETTLED
            elif count >= MOST_SWEEPS:
                status = Status.SWEPT
        return Answer(
            iterations=count,
            status=status,
            open=np.flatnonzero(ascent.open & (status in (Status.LATE, Status.INTERRUPTED))),
            left=np.flatnonzero(wanted),
            work=ascent.work,
            sweeping=ascent.sweeping,
            seconds={"preparation": preparation, **ascent.seconds},
            history=tuple(history),
        )


def _check(
    ascent: Ascent,
    blocks: Mask,
    sweep: int,
    epsilon: float,
    violation: float,
) -> dict[str, float]:
    """One record of the history."""
    upper = float((ascent.cost - ascent.unassigned_cost)[blocks].sum())
    return {
        "sweep": sweep,
        "epsilon": epsilon,
        "violation": violation,
        "lower": upper - max(float(ascent.gap[blocks].sum()), 0.0),
        "upper": upper,
    }


def _without_kernels(batch: BlockBatch) -> Answer:
    """`solve_whole`, which says so."""
    return replace(solve_whole(batch), detail="by a linear programme: no compiled kernels")
