"""TGOSPA as numbers of a `Problem`: its three parameters, powers of distances, their rounding."""

import math

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem.problem import Floats, Ints, Problem

POWER = 2.0**-50
"""Largest relative error of a power of doubles, 8 units of rounding: the mathematical libraries in
use are off by less than two. Squares are rounded once."""

SMALLEST_RHO = 1e-6
"""A share of c^p below this would lose digits beside the rest; such targets cost nothing."""

SMALLEST_POWER = 1e-306
"""Costs and distances below this, near the end of the doubles, count as this much."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The numbers of the metric.

    Parameters
    ----------
    cutoff : float
        c > 0: an error counts at most c; in units of the base distance.
    order : float
        p >= 1: the exponent of the sum, never the norm of the base distance.
    switch_penalty : float
        gamma >= 0: a full track switch costs gamma^p; 0 gives per-step GOSPA, summed.
    rho : float
        0 < rho < 1: the share of c^p that a false target costs, a missed one costs the rest. 1/2
        is the metric; any other the quasi-metric of Garcia-Fernandez et al. (arXiv 2507.13706).

    Raises
    ------
    ConfigError
        A number is out of its range or not finite.
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
                f"rho is {self.rho:g}: must be between 0 and 1, {SMALLEST_RHO:g} from either at "
                "least; it is the share of c^p that a false target costs"
            )
        if not -300 < self.order * math.log10(self.cutoff) < 300:
            raise ConfigError(
                f"cutoff {self.cutoff:g} to the order {self.order:g} is out of the range of "
                "doubles; choose another unit"
            )

    @property
    def recorded(self) -> dict[str, float]:
        """By name, for documents; rho only where it makes another metric."""
        return {k: v for k, v in vars(self).items() if k != "rho" or v != 0.5}

    @property
    def unassigned_prices(self) -> tuple[float, float]:
        """What a missed and a false target cost in units of c^p; they sum to 1 exactly."""
        missed = 1.0 - self.rho
        return missed, 1.0 - missed

    def in_words(self, unit: str | None = None) -> str:
        """All of them as "c = 10 m, p = 2, gamma = 2 m"."""
        after = f" {unit}" if unit else ""
        rho = "" if self.rho == 0.5 else f", rho = {self.rho:g}"
        return (
            f"c = {self.cutoff:g}{after}, p = {self.order:g}, "
            f"gamma = {self.switch_penalty:g}{after}{rho}"
        )

    def root(self, total: float) -> float:
        """TGOSPA in state units of a total cost in units of c^p."""
        return float(self.cutoff * total ** (1 / self.order))

    @property
    def switch_price(self) -> float:
        """Dimensionless price of half a switch, gamma^p / (2 c^p).

        At most 1e100: the value is constant long before, and infinity times zero is no number.
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
) -> Problem:
    """``D = (d/c)^p, A = 1 - rho, B = rho, lambda = gamma^p / (2 c^p)`` of pairs below the cutoff.

    The LP of García-Fernández, Rahmathullah and Svensson (IEEE TSP 2020) in units of c^p.
    `distance` (N,) in the units of the cutoff; pairs at the cutoff or beyond are left out.

    Parameters
    ----------
    distance_error : float
        Largest relative error of the distances.
    last_place : float
        What the last places of the states can change of a distance.

    Raises
    ------
    ConfigError
        A power of a distance or of the switch penalty is no double beside that of the cutoff.
    """
    order = parameters.order
    cost = distance / parameters.cutoff
    cost **= order
    _check_powers(distance, cost, parameters)
    slack = 0.0
    is_small = (cost < SMALLEST_POWER) | (distance < SMALLEST_POWER)
    lifted = np.flatnonzero(is_small & (distance > 0)) if is_small.any() else ()
    if len(lifted):
        least = max(SMALLEST_POWER, min(SMALLEST_POWER / parameters.cutoff, 1.0) ** order)
        cost[lifted] = np.maximum(cost[lifted], least)
        slack = least * min(len(truth_step), len(estimate_step))
    keep = (distance < parameters.cutoff) & (cost < 1.0)
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
    )


def _alike(price: float, size: int) -> Floats:
    """A price so many times, in the memory of one, as by `np.broadcast_to`."""
    return np.ndarray((size,), np.float64, np.array(price), strides=(0,))


def check_underflow(problem: Problem, parameters: Parameters, cost: float) -> None:
    """Refuse a cost that is made of powers that underflow; others do not matter beside it.

    Raises
    ------
    ConfigError
        The cost is made of powers below the smallest double.
    """
    if 0 < 1e-9 * cost < problem.cost_slack:
        raise ConfigError(
            f"cutoff {parameters.cutoff:g} is too large for order {parameters.order:g} and the "
            "distances that make the result: powers of their ratio are below the smallest double; "
            "choose a smaller cutoff or a lower order"
        )


def _cost_error(order: float, distance_error: float) -> float:
    """``(1 + error of the distance + u)^p - 1 + 2 pi``, docs/theory/certificate.md, "Rounding"."""
    power = {1.0: 0.0, 2.0: 2.0**-53}.get(order, POWER)
    return math.expm1(order * math.log1p(distance_error + 2.0**-53)) + 2 * power


def _price_error(parameters: Parameters) -> float:
    """Relative error of the prices 1 - rho, rounded once, and 1 - (1 - rho), exact after that."""
    missed, false = parameters.unassigned_prices
    return 0.0 if false == 0.5 else 2.0**-53 / min(missed, false)


def _check_powers(distance: Floats, cost: Floats, parameters: Parameters) -> None:
    """Refuse powers of which all digits that decide are lost by underflow."""
    order, penalty = parameters.order, parameters.switch_penalty
    farthest = float(distance.max(initial=0.0))
    lost = farthest if farthest > 0 and cost.max(initial=0.0) < SMALLEST_POWER else 0.0
    if penalty > 0 and parameters.switch_price < SMALLEST_POWER:
        lost = max(lost, penalty)
    if lost:
        what = "distance" if lost == farthest else "switch penalty"
        most = math.pow(10.0, math.log10(lost) + 305 / order)
        raise ConfigError(
            f"cutoff {parameters.cutoff:g} is too large for order {order:g} and a {what} of "
            f"{lost:g}: the power of their ratio is below the smallest double; "
            f"{'set the penalty to 0, or ' if what == 'switch penalty' else ''}"
            f"choose a cutoff of at most {most:.2g}"
        )
