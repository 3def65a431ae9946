"""TGOSPA as numbers of a `Problem`: its three parameters, powers of distances, their rounding."""

import math

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem.problem import Floats, Ints, Problem

POWER = 2.0**-50
"""Largest relative error of a power of doubles, 8 units of rounding: the mathematical libraries in
use are off by less than two. Squares are rounded once."""

SMALLEST_POWER = 1e-306
"""Costs and distances below this, near the end of the doubles, count as this much."""

_HALF = np.full(1, 0.5)
_HALF.setflags(write=False)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The three numbers of the metric.

    Parameters
    ----------
    cutoff : float
        c > 0: an error counts at most c; in units of the base distance.
    order : float
        p >= 1: the exponent of the sum, never the norm of the base distance.
    switch_penalty : float
        gamma >= 0: a full track switch costs gamma^p; 0 gives per-step GOSPA, summed.

    Raises
    ------
    ConfigError
        A number is out of its range or not finite.
    """

    cutoff: float
    order: float = 2.0
    switch_penalty: float

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
        if not -300 < self.order * math.log10(self.cutoff) < 300:
            raise ConfigError(
                f"cutoff {self.cutoff:g} to the order {self.order:g} is out of the range of "
                "doubles; choose another unit"
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


def tgospa_problem(  # noqa: PLR0913  (arrays by name, as the fields of Problem)
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
    """``D = (d/c)^p, A = B = 1/2, lambda = gamma^p / (2 c^p)`` of the pairs nearer than the cutoff.

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
    lifted = np.flatnonzero((cost < SMALLEST_POWER) | (distance < SMALLEST_POWER))
    lifted = lifted[distance[lifted] > 0]
    if len(lifted):
        least = max(SMALLEST_POWER, min(SMALLEST_POWER / parameters.cutoff, 1.0) ** order)
        cost[lifted] = np.maximum(cost[lifted], least)
        slack = least * min(len(truth_step), len(estimate_step))
    keep = (distance < parameters.cutoff) & (cost < 1.0)
    if not keep.all():
        truth_row, estimate_row, cost = truth_row[keep], estimate_row[keep], cost[keep]
    objects = len(truth_step) + len(estimate_step)
    blur = last_place / parameters.cutoff
    return Problem(
        steps=steps,
        truths=truths,
        estimates=estimates,
        truth_step=truth_step,
        truth_track=truth_track,
        truth_price=_halves(len(truth_step)),
        estimate_step=estimate_step,
        estimate_track=estimate_track,
        estimate_price=_halves(len(estimate_step)),
        truth_row=truth_row,
        estimate_row=estimate_row,
        cost=cost,
        switch_price=parameters.switch_price,
        cost_slack=slack,
        cost_error=_cost_error(order, distance_error),
        rounding=objects * blur**order if blur < 1 else 0.0,
    )


def _halves(size: int) -> Floats:
    """A half so many times, in the memory of one, as by `np.broadcast_to`."""
    return np.ndarray((size,), np.float64, _HALF, strides=(0,))


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
