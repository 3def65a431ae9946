"""Problems of the metric family: TGOSPA, and its variants.

The variants are weighted steps, objects with probabilities of existence, and ignored states. This
module also has the parameters of the metric, and bounds of the rounding errors of powers. The
letters are those of docs/theory/notation.md.
"""

import math
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem.problem import Problem
from tgospa_eval.quoting import option

POWER = 2.0**-50
"""Assumed largest relative error of a power of doubles: 8 units of rounding, of 2^-53 each. The
mathematical libraries in use are off by less than 2 units. The square is more accurate: it is
rounded once."""

SMALLEST_RHO = 1e-6
"""Smallest value of rho and of 1 - rho. If one of the two is smaller, its digits are lost when it
is computed from the other."""

SMALLEST_POWER = 1e-306
"""Smallest positive cost and distance, near the smallest double. Smaller positive values are
replaced by it."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Parameters of the metric.

    Parameters
    ----------
    cutoff : float
        c > 0, in units of the base distance: an error counts at most c.
    order : float
        p >= 1: the exponent of all costs. It does not change the base distance.
    switch_penalty : float
        gamma >= 0: a full track switch costs gamma^p. If gamma is 0, the total is the sum of the
        GOSPA costs of all steps.
    rho : float
        0 < rho < 1: a false target costs rho c^p, a missed target (1 - rho) c^p. With 1/2 the
        result is the metric, with other values the quasi-metric of Garcia-Fernandez et al. (arXiv
        2507.13706).

    Raises
    ------
    ConfigError
        A parameter is out of its range or not finite.
    """

    cutoff: float
    order: float = 2.0
    switch_penalty: float
    rho: float = 0.5

    def __post_init__(self) -> None:
        for name, low, inclusive in (
            ("cutoff", 0.0, False),
            ("order", 1.0, True),
            ("switch_penalty", 0.0, True),
        ):
            value = real_number(name.replace("_", " "), getattr(self, name))
            object.__setattr__(self, name, value)
            fine = math.isfinite(value) and (value >= low if inclusive else value > low)
            if not fine:
                word = name.replace("_", " ")
                rule = ">=" if inclusive else ">"
                raise ConfigError(f"{word} is {value:g}: must be finite and {rule} {low:g}")
        object.__setattr__(self, "rho", real_number("rho", self.rho))
        if not SMALLEST_RHO <= self.rho <= 1 - SMALLEST_RHO:
            raise ConfigError(
                f"rho is {self.rho:g}: must be between 0 and 1, at least {SMALLEST_RHO:g} from "
                "both; it is the share of c^p that a false target costs"
            )
        if not -300 < self.order * math.log10(self.cutoff) < 300:
            raise ConfigError(
                f"cutoff {self.cutoff:g} to the order {self.order:g} is out of the range of "
                "doubles; choose another unit"
            )

    @property
    def recorded(self) -> dict[str, float]:
        """Parameters by name, as they are saved in results. rho is left out if it is 1/2."""
        return {k: v for k, v in vars(self).items() if k != "rho" or v != 0.5}

    @property
    def scale(self) -> float:
        """c^p, the cost that is one unit of the dimensionless problem."""
        return float(self.cutoff**self.order)

    @property
    def unassigned_prices(self) -> tuple[float, float]:
        """Costs of a missed and of a false target in units of c^p; their sum is exactly 1."""
        missed = 1.0 - self.rho
        return missed, 1.0 - missed

    def in_words(self, unit: str | None = None) -> str:
        """Format the parameters as "c = 10 m, p = 2, gamma = 2 m"; rho follows if it is not 1/2."""
        after = f" {unit}" if unit else ""
        rho = "" if self.rho == 0.5 else f", rho = {self.rho:g}"
        return (
            f"c = {self.cutoff:g}{after}, p = {self.order:g}, "
            f"gamma = {self.switch_penalty:g}{after}{rho}"
        )

    def root(self, total: float) -> float:
        """Return TGOSPA in state units from a total cost in units of c^p."""
        return float(self.cutoff * total ** (1 / self.order))

    @property
    def switch_price(self) -> float:
        """Dimensionless price of half a switch, gamma^p / (2 c^p).

        It is at most 1e100: an infinite price times 0 switches would be NaN. This limit does not
        change the metric, because the optimum is the same for all prices above a much smaller one.
        """
        try:
            return min(0.5 * math.pow(self.switch_penalty / self.cutoff, self.order), 1e100)
        except OverflowError:
            return 1e100


def tgospa_problem(
    *,
    parameters: Parameters,
    steps: int,
    truths: int,
    estimates: int,
    truth_step: Ints,
    truth_track: Ints,
    estimate_step: Ints,
    estimate_track: Ints,
    truth_row: Ints,
    estimate_row: Ints,
    distance: Floats,
    distance_error: float = 0.0,
    last_place: float = 0.0,
    near: Mask | None = None,
) -> Problem:
    """Build the problem ``D = (d/c)^p, A = 1 - rho, B = rho, lambda = gamma^p / (2 c^p)``.

    This is the LP of García-Fernández, Rahmathullah and Svensson (IEEE TSP 2020) in units of c^p.
    Pairs at the cutoff or beyond are left out. For parameters that are not listed here, see
    `Problem`.

    Parameters
    ----------
    parameters : Parameters
        Parameters of the metric.
    distance : (N,) float array
        Distances of the pairs, in the unit of the cutoff.
    distance_error : float
        Largest relative error of the distances.
    last_place : float
        Largest change of a distance that rounding of the last digits of the states can cause.
    near : (N,) bool array, optional
        Mask of the pairs that count as nearer than the cutoff. By default, these are the pairs with
        a distance less than the cutoff. If a mask is given, the caller must pass the built problem
        to `ignore_states`.

    Raises
    ------
    ConfigError
        All powers (d / c)^p, or the power (gamma / c)^p, underflow.
    """
    order = parameters.order
    cost = distance / parameters.cutoff
    cost **= order
    _check_powers(distance, cost, parameters)
    slack = 0.0
    is_small = (cost < SMALLEST_POWER) | (distance < SMALLEST_POWER)
    lifted = np.flatnonzero(is_small & (distance > 0)) if is_small.any() else ()
    if len(lifted):
        smallest = max(SMALLEST_POWER, min(SMALLEST_POWER / parameters.cutoff, 1.0) ** order)
        cost[lifted] = np.maximum(cost[lifted], smallest)
        slack = smallest * min(len(truth_step), len(estimate_step))
    keep = (distance < parameters.cutoff) & (cost < 1.0) if near is None else near
    if not keep.all():
        truth_row, estimate_row, cost = truth_row[keep], estimate_row[keep], cost[keep]
    objects = len(truth_step) + len(estimate_step)
    blur = last_place / parameters.cutoff
    missed, false = parameters.unassigned_prices
    return Problem(
        steps=steps,
        truths=truths,
        estimates=estimates,
        truth_step=truth_step,
        truth_track=truth_track,
        truth_price=_alike(missed, len(truth_step)),
        estimate_step=estimate_step,
        estimate_track=estimate_track,
        estimate_price=_alike(false, len(estimate_step)),
        truth_row=truth_row,
        estimate_row=estimate_row,
        cost=cost,
        switch_price=parameters.switch_price,
        cost_slack=slack,
        cost_error=max(_cost_error(order, distance_error), _price_error(parameters)),
        rounding=objects * blur**order if blur < 1 else 0.0,
        signed=near is not None,
    )


def _alike(price: float, size: int) -> Floats:
    """Return an array of `size` equal prices that needs the memory of one number."""
    return np.ndarray((size,), np.float64, np.array(price), strides=(0,))


def check_underflow(problem: Problem, parameters: Parameters, cost: float) -> None:
    """Check that underflow of powers does not matter for the total cost `cost`.

    Raises
    ------
    ConfigError
        Powers below the smallest double can change the total by more than 1e-9 of its value.
    """
    if 0 < 1e-9 * cost < problem.cost_slack:
        raise ConfigError(
            f"cutoff {parameters.cutoff:g} is too large for order {parameters.order:g} and these "
            "errors: (error / cutoff)^p is below the smallest double; choose a smaller cutoff or a "
            "lower order"
        )


def _cost_error(order: float, distance_error: float) -> float:
    """Return the largest relative error of computed costs ``(d / c)^p``.

    It is ``(1 + e + u)^p - 1 + 2 q``. The distance has the relative error e, the division adds
    u = 2^-53, and the power adds q (docs/theory/certificate.md, "Rounding").
    """
    power = {1.0: 0.0, 2.0: 2.0**-53}.get(order, POWER)
    return math.expm1(order * math.log1p(distance_error + 2.0**-53)) + 2 * power


def _price_error(parameters: Parameters) -> float:
    """Return the largest relative error of the prices of a missed and of a false target.

    A missed target costs 1 - rho, which is rounded. A false target costs 1 minus this rounded
    number, and this second subtraction is exact.
    """
    missed, false = parameters.unassigned_prices
    return 0.0 if false == 0.5 else 2.0**-53 / min(missed, false)


def _check_powers(distance: Floats, cost: Floats, parameters: Parameters) -> None:
    """Refuse a cutoff that is so large that powers underflow.

    Raises
    ------
    ConfigError
        The powers of all distances, or the power of the switch penalty, underflow.
    """
    order, penalty = parameters.order, parameters.switch_penalty
    farthest = float(distance.max(initial=0.0))
    lost = farthest if farthest > 0 and cost.max(initial=0.0) < SMALLEST_POWER else 0.0
    if penalty > 0 and parameters.switch_price < SMALLEST_POWER:
        lost = max(lost, penalty)
    if lost:
        what = "distance" if lost == farthest else "switch penalty"
        largest = math.pow(10.0, math.log10(lost) + 305 / order)
        raise ConfigError(
            f"cutoff {parameters.cutoff:g} is too large for order {order:g} and a {what} of "
            f"{lost:g}: the power of their ratio is below the smallest double; "
            f"{'set the penalty to 0, or ' if what == 'switch penalty' else ''}"
            f"choose a cutoff of at most {largest:.2g}"
        )


# -------------------------------------------------------------------------------------------------
# Variants of the metric: weighted steps, objects with a probability of existence, ignored states.
#
# The same solvers solve all variants: only the numbers A, B, D and lambda of a `Problem` change.

LARGEST_WEIGHT, SMALLEST_WEIGHT = 1e100, 1e-100
"""Limits of the positive weights of steps; a weight can also be 0. Beyond these limits, costs would
leave the range of doubles."""

ROUNDED = 6 * 2.0**-53
"""Bound of the relative error that weights and probabilities add to prices and costs. Each of
these is the result of at most four rounded operations."""

SMALLEST_COST = 1e-300
"""Smallest positive weighted cost, near the smallest double. Smaller positive costs are replaced by
it."""


def check_weights(cost: Floats, switch: Floats) -> tuple[Floats, Floats]:
    """Check and return the weights of steps of the time-weighted metric (arXiv 2110.13444).

    Parameters
    ----------
    cost : (T,) float array
        Factor >= 0 of localisation, missed and false costs at each step.
    switch : (T - 1,) float array
        Factor >= 0 of the cost of switches between each step and the next.

    Raises
    ------
    ConfigError
        A weight is negative, not finite, too large or too small, or all weights `cost` are 0.
    """
    for weights in (cost, switch):
        fine = (weights == 0) | ((weights >= SMALLEST_WEIGHT) & (weights <= LARGEST_WEIGHT))
        if not fine.all():
            raise ConfigError(
                f"a weight of a step is {weights[~fine][0]:g}: must be 0 or from "
                f"{SMALLEST_WEIGHT:g} to {LARGEST_WEIGHT:g}"
            )
    if len(cost) and not cost.any():
        raise ConfigError("all weights of steps are 0: nothing would count")
    return cost, switch


def weight_steps(problem: Problem, cost: Floats, switch: Floats) -> Problem:
    """Return the problem with weighted steps.

    Prices, costs and switch prices become ``A w(k), B w(k), D w(k), lambda w'(k)`` at step k. The
    weights w are the argument `cost`, and w' are `switch` (see `check_weights`). Pairs at steps
    with w(k) = 0 have no gain and are left out.
    """
    factor = cost[problem.entry_step]
    if problem.pair_share is not None:
        problem = replace(problem, pair_share=problem.pair_share * factor)
    switch = problem.switch_price * switch
    # If the price is one number for all steps, `merge_runs` makes one state of each run.
    same = bool(len(switch)) and bool((switch == switch[0]).all())
    largest = float(cost.max(initial=0.0))
    return _repriced(
        replace(
            problem,
            switch_price=float(switch[0]) if same else switch,
            cost_slack=problem.cost_slack * largest,
            rounding=problem.rounding * largest,
        ),
        problem.truth_price * cost[problem.truth_step],
        problem.estimate_price * cost[problem.estimate_step],
        problem.cost * factor,
    )


def weight_existence(problem: Problem, truth: Floats, estimate: Floats) -> Problem:
    """Return the problem of objects that exist with probabilities r (truth) and s (estimate).

    Its prices are A r and B s, and its costs are ``D min(r, s) + |r - s| / 2``. This is the LP of
    the probabilistic metric (arXiv 2506.15148); `problem` must have A = B = 1/2. If all
    probabilities are 1, the result is `problem` itself.

    The cost of a pair is the cost of moving one probability distribution to another at the smallest
    cost (optimal transport). The truth is at its state with probability r, and at "none" with
    1 - r. The estimate is at its state with probability s, and at "none" with 1 - s. The distance
    from "none" to every state is c / 2^(1/p). The probability min(r, s) moves by the distance d,
    and the difference |r - s| moves to or from "none". The gain of an assigned pair is therefore
    min(r, s) (1 - D). Pairs with r = 0 or s = 0 have no gain and are left out.

    Parameters
    ----------
    problem : Problem
        The problem in which all objects exist with probability 1.
    truth, estimate : (R_truth,), (R_estimate,) float arrays
        Probabilities r and s.

    Raises
    ------
    ConfigError
        Prices of missed and false targets differ. For such prices, no proof of a metric is known.
    """
    if np.any(problem.truth_price != 0.5) or np.any(problem.estimate_price != 0.5):
        raise ConfigError(needs_symmetry())
    if (truth == 1).all() and (estimate == 1).all():
        return problem
    first, second = truth[problem.truth_row], estimate[problem.estimate_row]
    cost = np.minimum(first, second) * problem.cost + 0.5 * np.abs(first - second)
    certain = replace(problem, distance_power=problem.cost)
    return _repriced(certain, 0.5 * truth, 0.5 * estimate, cost)


def needs_symmetry() -> str:
    """Return the message that missed and false targets must cost the same."""
    return (
        f"{option('existence', 'use')} needs {option('rho', 0.5)}: with other prices of missed and "
        "false targets no proof is known that the result is a metric"
    )


def ignore_states(problem: Problem, ignored: Mask, excused: Mask) -> Problem:
    """Return the problem in which ignored objects and excused estimates do not count.

    Its prices are A w and B (1 - e), and its costs are D w. Here w is 0 for ignored objects and 1
    for all other objects; e is 1 for excused estimates and 0 for all other estimates. An ignored
    object can *absorb* one estimate at a time: assigning the two costs nothing. An excused estimate
    costs nothing if it is unassigned.

    The gain of a near pair with an ignored object is B (1 - e). The gain of an evaluated object and
    an excused estimate is A - D. Pairs without a positive gain are left out. If nothing is ignored
    or excused, the result is `problem` itself.

    The result is not a metric: a truth whose states are all ignored has the distance 0 from the
    empty set.

    Parameters
    ----------
    problem : Problem
        The problem in which all states are evaluated.
    ignored, excused : (R_truth,), (R_estimate,) bool arrays
        Rows of the truth and of the estimate that are not evaluated.
    """
    if not (ignored.any() or excused.any()):
        return problem
    counted = (~ignored).astype(np.float64)
    share = counted[problem.truth_row]
    changed = replace(
        problem,
        cost=problem.cost * share,
        distance_power=problem.cost,
        pair_share=share,
        unjudged=(ignored, excused),
        signed=False,
    )
    prices = problem.truth_price * counted, problem.estimate_price * ~excused
    return _repriced(changed, *prices, changed.cost, error=0.0)  # products with 0 and 1 are exact


def _repriced(
    problem: Problem,
    truth_price: Floats,
    estimate_price: Floats,
    cost: Floats,
    *,
    error: float = ROUNDED,
) -> Problem:
    """Return the problem with other prices and costs, without pairs that no longer gain.

    `error` is the relative error that the new prices and costs add. Pairs whose gain is lost by
    rounding are left out, too. This changes the cost by no more than `error`.
    """
    lifted = (problem.cost > 0) & (cost < SMALLEST_COST)
    cost = np.where(lifted, SMALLEST_COST, cost)
    count = min(len(problem.truth_step), len(problem.estimate_step))
    unassigned = truth_price[problem.truth_row] + estimate_price[problem.estimate_row]
    kept = np.flatnonzero(unassigned - cost > 0)
    return replace(
        problem,
        truth_price=truth_price,
        estimate_price=estimate_price,
        truth_row=problem.truth_row[kept],
        estimate_row=problem.estimate_row[kept],
        cost=cost[kept],
        distance_power=None if problem.distance_power is None else problem.distance_power[kept],
        pair_share=None if problem.pair_share is None else problem.pair_share[kept],
        cost_error=problem.cost_error + error,
        cost_slack=problem.cost_slack + (SMALLEST_COST * count if lifted.any() else 0.0),
    )
