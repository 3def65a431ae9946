"""The optimisation problem: sparse, dimensionless, the same for the whole metric family.

Knows nothing of files, states or distances: those arrive as numbers. Everything is divided by
c^p, because the tolerances of LP solvers are absolute: unscaled small units give silently wrong
values. A member of the family is one choice of the arrays below (unassigned prices, gains, switch
prices); no solver knows which.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.errors import ConfigError, real_number

Ints = NDArray[np.integer]
Floats = NDArray[np.float64]

POWER = 2.0**-50
"""Largest relative error of a power of doubles, 8 units of rounding: the mathematical libraries in
use are off by less than two. Squares are rounded once."""

REGRET = 1e-11
"""What a row could gain by leaving its path that is rounding: sums of gains round to 1e-12."""

SMALLEST_POWER = 1e-306
"""Costs and distances below this, near the end of the doubles, count as this much."""


def sum_by(index: Ints, value: Floats, size: int) -> Floats:
    """Sum of the values that share an index, (size,); added in the order given."""
    return np.bincount(index, value, minlength=size).astype(np.float64, copy=False)


def sum_parts(value: Floats, first: Ints) -> Floats:
    """Sum of each part of the values; part i begins at first[i] and ends before first[i + 1]."""
    total: Floats = np.add.reduceat(np.append(value, 0.0), first[:-1])
    total[first[1:] == first[:-1]] = 0.0  # reduceat gives the value at hand there
    return total


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

    cutoff: float = 10.0
    order: float = 2.0
    switch_penalty: float = 2.0

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Which pairs gain what at which step, in units of c^p.

    Objects are numbered by their row in two flat tables, one row per existing object and step,
    sorted by (step, track). An entry is a pair of rows of one step that gains by being assigned;
    all other pairs are neutral.

    Parameters
    ----------
    steps, truths, estimates : int
        Sizes T, m, n.
    truth_step, truth_track, truth_price : (R_truth,) arrays
        Step and track of each existing truth, and the price A of leaving it unassigned.
    estimate_step, estimate_track, estimate_price : (R_estimate,) arrays
        The same for estimates, price B.
    truth_row, estimate_row : (N,) int arrays
        The rows of each entry, sorted by (step, truth, estimate).
    cost : (N,) float array
        What the assigned pair costs, less than A + B.
    switch_price : float or (T - 1,) float array
        Price of half a switch, for all transitions or for each.
    cost_error : float
        Largest relative error of the costs and switch prices; bounds are widened by it.
    cost_slack : float
        By how much the costs of all pairs that can be assigned at once are too large at most.
    rounding : float
        An optimum below this says nothing: it may come from the last places of the states alone.
    """

    steps: int
    truths: int
    estimates: int
    truth_step: Ints
    truth_track: Ints
    truth_price: Floats
    estimate_step: Ints
    estimate_track: Ints
    estimate_price: Floats
    truth_row: Ints
    estimate_row: Ints
    cost: Floats
    switch_price: float | Floats
    cost_error: float = 0.0
    cost_slack: float = 0.0
    rounding: float = 0.0

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if isinstance(value, np.ndarray):
                frozen = value.view()
                frozen.setflags(write=False)
                object.__setattr__(self, name, frozen)
        if np.any(self.truth_step[self.truth_row] != self.estimate_step[self.estimate_row]):
            raise ConfigError("an entry pairs a truth and an estimate of different steps")
        if np.any(~(self.gain > 0)) or np.any(~np.isfinite(self.cost)):
            raise ConfigError("gains must be positive and finite")
        if not isinstance(self.switch_price, float) and self.switch_price.shape != (
            max(self.steps - 1, 0),
        ):
            raise ConfigError("switch prices must be one number or one for each transition")

    @property
    def entry_step(self) -> Ints:
        """Step of each entry, (N,)."""
        return self.truth_step[self.truth_row].astype(np.int32, copy=False)

    @cached_property
    def unassigned_costs(self) -> tuple[Floats, Floats]:
        """Cost of leaving each truth (m,), and each estimate (n,), unassigned throughout."""
        return (
            sum_by(self.truth_track, self.truth_price, self.truths),
            sum_by(self.estimate_track, self.estimate_price, self.estimates),
        )

    @cached_property
    def pair_price(self) -> float | None:
        """A + B where all objects have the same price, A = B, and the sum is no rounded one."""
        prices = self.truth_price, self.estimate_price
        if any(not len(price) or (price != self.truth_price[:1]).any() for price in prices):
            return None
        return float(2.0 * self.truth_price[0])

    @property
    def gain(self) -> Floats:
        """What assigning each pair saves, A + B - cost, (N,); small costs lose digits."""
        return self.gains(slice(None))

    def gains(self, entry: Ints | slice) -> Floats:
        """The gain of some entries."""
        price = self.truth_price[self.truth_row[entry]]
        price += self.estimate_price[self.estimate_row[entry]]
        price -= self.cost[entry]
        return price

    @property
    def switch_price_at(self) -> Floats:
        """Price of half a switch into each step, (T + 1,); 0 into the first and after the last."""
        price = np.zeros(self.steps + 1)
        price[1 : self.steps] = self.switch_price
        return price


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
    """The TGOSPA problem of the pairs of rows that are nearer than the cutoff.

    Cost (d/c)^p, gain 1 - (d/c)^p, half the cutoff price per unassigned object: the LP of
    García-Fernández, Rahmathullah and Svensson (IEEE TSP 2020) in the gain form of docs/theory.
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
        truth_price=np.broadcast_to(0.5, len(truth_step)),
        estimate_step=estimate_step,
        estimate_track=estimate_track,
        estimate_price=np.broadcast_to(0.5, len(estimate_step)),
        truth_row=truth_row,
        estimate_row=estimate_row,
        cost=cost,
        switch_price=parameters.switch_price,
        cost_slack=slack,
        cost_error=_cost_error(order, distance_error),
        rounding=objects * blur**order if blur < 1 else 0.0,
    )


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
    """Largest relative error of a cost or switch price: of a distance, a quotient, and a power."""
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
