"""The approximate solver: sweeps without linear programmes, down to a given temperature.

`Sinkhorn` divides each row among its paths pi. The share of a path is its mass theta, and the
masses of a row sum to 1. At each column slot, the load is the sum of the masses of the paths
through it, and the *slack of the slot* sigma is the part that no path uses. The best masses would
be 0 or 1 for most paths. The *entropy* sum H(theta) + sum H(sigma), with H(t) = t - t log t, is
largest for masses that are spread. The sweeps approach the masses that

    maximise  sum theta value(pi) + epsilon (entropy).

The temperature epsilon is the weight of the entropy. The prices determine theta and sigma. Each
sweep changes the prices so that load and sigma of each slot come nearer to a sum of 1. The bounds
of the result come from the prices, and from the assignment that is rounded from the masses.

`entropic_trace` computes what the problem with entropy itself costs. This *entropic value* is no
bound of TGOSPA. With row i and column slot r the problem is

    min  cost(theta) + epsilon sum theta log theta + epsilon sum (sigma log sigma - sigma)
    with  sum_pi theta_i,pi = 1 for each row,   load_r + sigma_r = 1 for each slot.

Except for constants, it is the same problem: the sum of the missing -theta is 1 for each row. The
*primal* value is the objective at the masses. The *dual* value is a bound of it from the prices.
The two meet at the optimum. The sweeps of `Sinkhorn` use a part of the states (the working set).
`entropic_trace` uses all states and slots, so the value does not depend on the algorithm
(docs/theory/solvers.md, "The entropic value").

Source: Nevelius Wernholm, Wärnsäter and Ringh, "Fast computation of the TGOSPA metric for multiple
target tracking via unbalanced optimal transport", theorem 1; below [Wernholm]. Other words and
letters: `solvers`, and docs/theory/solvers.md, "Sinkhorn sweeps".
"""

import itertools
import time
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import numpy as np

from tgospa_eval.common.arrays import Floats, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Status
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.batches import Answer, BatchSolver, BlockBatch, Routine
from tgospa_eval.solvers.dual_ascent import Ascent
from tgospa_eval.solvers.lp_rounds import solve_whole
from tgospa_eval.solvers.trivial import solve_conflict_free, solve_steps
from tgospa_eval.solvers.tuning import check_settings

WARM_STAGES = (0.3, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
"""Temperatures of the first stages: those above the requested one, with `WARM_SWEEPS` sweeps
each."""

WARM_SWEEPS = 12
CHECK_SWEEPS, CHECKS = 24, 4
"""Sweeps between two checks of the bounds, and usual number of checks (for the progress)."""

MAX_SWEEPS = 2000
FULL_TO = 1e-6
NEGLIGIBLE_SLACK = 25.0
"""Largest slack, in units of the temperature, of the states in the working set, not counting half
the switch price that is added to it. States with more slack have a mass below 1e-10."""


@dataclass(frozen=True, kw_only=True)
class Sinkhorn(BatchSolver):
    """Approximate solver with proven bounds.

    Parameters
    ----------
    epsilon : float
        Temperature as a fraction of c^p. Stages at higher temperatures, from 0.3 on, come first.
    gap : float
        Relative gap of the total at which to stop early.
    time_limit : float, optional
        Seconds.
    jobs : int, optional
        Number of threads; all cores by default. The result does not depend on it.

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
        """Functions that sweep until one of four conditions is true.

        The gap is closed; sweeps hardly make it smaller; loads and slacks of column slots sum to 1
        within `FULL_TO`; or `MAX_SWEEPS` is reached. A warm start is ignored, because sweeps at
        high temperatures would forget it. Without compiled kernels, linear programmes replace the
        sweeps: they are faster, and exact.
        """
        return Routine(
            solve_steps if kernels else solve_conflict_free,
            self._sweep if kernels else _without_kernels,
            self.jobs,
        )

    def _sweep(self, batch: BlockBatch) -> Answer:
        """Sweep over one batch."""
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
            sweeps = min(CHECK_SWEEPS if cold else WARM_SWEEPS, MAX_SWEEPS - count)
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
            elif count >= MAX_SWEEPS:
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
    """Return the numbers of one check, for `Answer.history`."""
    upper = float((ascent.cost - ascent.unassigned_cost)[blocks].sum())
    return {
        "sweep": sweep,
        "epsilon": epsilon,
        "violation": violation,
        "lower": upper - max(float(ascent.gap[blocks].sum()), 0.0),
        "upper": upper,
    }


def _without_kernels(batch: BlockBatch) -> Answer:
    """Solve by `solve_whole`, and say so in the answer."""
    return replace(solve_whole(batch), detail="by a linear programme: no compiled kernels")


MAX_TRACE, MAX_LINKS = 1000, 5_000_000
"""Number of sweeps after which a trace ends, and largest number of links (`kernels.Chain`)."""

MET, STILL = 1e-7, 1e-9
"""Limits at which a trace has converged: the difference of primal and dual is at most the share MET
of the dual, or the last sweeps changed the dual by at most the share STILL of it."""

NEVER = 700.0
"""Ratio of switch price to temperature above which the mass that switches is 0 in doubles."""

Trace = list[dict[str, float]]
"""Numbers of each check in a dict: sweep, epsilon, violation (the largest error of a sum of load
and slack), and primal, dual and cost in units of c^p."""


def entropic_trace(states: States, epsilon: float, late: Callable[[], bool]) -> Trace:
    """Sweep over all states until primal and dual meet; return the numbers of each check.

    Parameters
    ----------
    states : States
        The problem.
    epsilon : float
        Last temperature, in units of c^p. Higher ones, from 0.3 on, come first.
    late : callable
        Function that returns whether to stop.
    """
    problem = states.problem
    unassigned = float(problem.truth_price.sum() + problem.estimate_price.sum())
    soft = np.zeros(len(states.columns.step))
    layout = None
    if len(soft):
        price = problem.weight(slice(None))  # one number for all entries, or one for each
        both = (price, None) if isinstance(price, float) else (0.0, price)
        layout = kernels.Layout(states, problem.switch_price_at, *both)
        layout.keep(np.ones(len(states.block_begin), np.uint8))
    every = np.ones(len(states.begin), np.uint8)
    trace: Trace = []
    sweeps, violation = 0, 0.0
    for temperature in itertools.chain(
        (stage for stage in WARM_STAGES if stage > epsilon), itertools.repeat(epsilon)
    ):
        if layout is not None:
            chain = kernels.Chain(layout, every, soft, MAX_LINKS)
            if chain.links > MAX_LINKS:
                break
            chain.heat(temperature)
            done, violation = chain.sweep(WARM_SWEEPS)
            sweeps += done
            chain.cool(temperature)
            chain.write_prices(soft)
        primal, dual, cost = (unassigned - gain for gain in gains(states, soft, temperature))
        check = {"sweep": sweeps, "epsilon": temperature, "violation": float(violation)}
        trace.append(check | {"primal": primal, "dual": dual, "cost": cost})
        if temperature == epsilon:
            change = abs(dual - trace[-2]["dual"]) if len(trace) > 1 else np.inf
            if abs(primal - dual) <= MET * abs(dual) or change <= STILL * abs(dual):
                break
        if sweeps >= MAX_TRACE or late():
            break
    return trace


def gains(states: States, prices: Floats, epsilon: float) -> tuple[float, float, float]:
    """Return primal and dual value with entropy, and the gain without entropy, at prices v.

    The letters are those of the docstring of this module. Let value_v be the value of a path minus
    the prices on its way. The prices determine

        alpha_i = epsilon log sum_pi exp(value_v / epsilon),
        theta = exp((value_v - alpha) / epsilon),   sigma = exp(-v / epsilon).

    The results are gains, so their signs are opposite to those of costs:

        primal  sum_i alpha_i + sum_r v_r load_r + sum_r (epsilon + v_r) sigma_r,
        dual    sum_i alpha_i + sum_r v_r        + sum_r epsilon sigma_r,
        gain    sum_s mass_s gain_s - sum_a lambda_a (mass that changes at a),

    with states s, and transitions a from a state of a pair to the next. Dual and primal come from
    the Lagrangian dual of [Wernholm]. The dual is never below the largest primal. They are equal
    where load + sigma = 1.

    Parameters
    ----------
    states : States
        The problem.
    prices : (K,) float array
        The prices v >= 0 of the column slots.
    epsilon : float
        Temperature, in units of c^p.

    Returns
    -------
    primal, dual, gain : float
        In units of c^p.
    """
    value, mass, stay = _masses(states, prices, epsilon)
    slack = np.exp(-prices / epsilon)
    load = states.columns.loads(mass)
    primal = value.sum() + (prices * load).sum() + ((epsilon + prices) * slack).sum()
    dual = value.sum() + prices.sum() + epsilon * slack.sum()
    arc = np.flatnonzero(np.diff(states.pair) == 0) + 1
    changing = mass[arc] + mass[arc - 1] - 2 * stay[arc]
    half = states.problem.switch_price_at[states.begin[arc]]
    half = np.where(half < NEVER * epsilon, half, 0.0)  # at higher prices, changes are rounding
    gain = (mass * states.gain).sum() - (half * changing).sum()
    return float(primal), float(dual), float(gain)


def _masses(states: States, prices: Floats, epsilon: float) -> tuple[Floats, Floats, Floats]:
    """Return alpha of each row, the mass of each state, and the part of it that stays in its pair.

    This part comes from the state before in the pair. All are computed in logarithms from messages
    (docs/theory/solvers.md, "Messages").
    """
    row = np.repeat(states.pair_row, np.diff(states.pair_first))
    order = np.lexsort((row, states.begin))  # by step, then by row
    weight = ((states.gain - states.columns.totals(prices)) / epsilon)[order]
    row, step, place = row[order], states.begin[order], np.argsort(order)
    before = place[order - 1]
    fresh = np.zeros(len(order), bool)
    fresh[place[states.pair_first[:-1]]] = True
    q = np.where(fresh, 0.0, -states.problem.switch_price_at[step] / epsilon)
    with np.errstate(divide="ignore"):
        rest = np.where(fresh, 0.0, np.log(-np.expm1(2 * q)))
    node = np.flatnonzero((np.diff(row, prepend=-1) != 0) | (np.diff(step, prepend=-1) != 0))
    ends = np.flatnonzero(np.diff(step[node], prepend=-1, append=-1))  # first node of each step
    begins = np.append(node, len(order))
    sizes = np.diff(begins)
    spans = [(slice(m, n), slice(begins[m], begins[n])) for m, n in itertools.pairwise(ends)]
    ahead, behind, into, none = *np.zeros((3, len(order))), np.zeros(states.nodes)
    for nodes, at in spans:
        into[at] = np.where(fresh[at], -np.inf, ahead[before[at]])
        first, rows = node[nodes], row[node[nodes]]
        arrived = np.logaddexp.reduceat(into[at], first - at.start)
        none[rows] = np.logaddexp(none[rows], q[first] + arrived)
        through = q[at] + np.repeat(none[rows], sizes[nodes])
        ahead[at] = np.logaddexp(into[at] + rest[at], through) + weight[at]
    none[:] = 0.0
    for nodes, at in reversed(spans):
        onward = weight[at] + behind[at]
        first, rows = node[nodes], row[node[nodes]]
        left = np.logaddexp.reduceat(onward, first - at.start)
        none[rows] = np.logaddexp(none[rows], q[first] + left)
        through = np.logaddexp(onward + rest[at], q[at] + np.repeat(none[rows], sizes[nodes]))
        behind[before[at][~fresh[at]]] = through[~fresh[at]]
    mass = np.exp(ahead + behind - none[row])[place]
    stay = np.exp(into + weight + behind - none[row])[place]
    return epsilon * none[np.unique(row)], mass, stay
