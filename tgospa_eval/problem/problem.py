"""The linear programme of the metric family: sparse and dimensionless, without files or distances.

    max  sum_k <G(k), W(k)> - sum_k lambda(k) |W(k + 1) - W(k)|,   G = A + B - D,

over W >= 0 with row and column sums of at most 1 (docs/theory/metric.md, "Gain form"). The letters
are those of docs/theory/notation.md. All costs are divided by c^p, because the tolerances of LP
solvers are absolute. Without the division, small costs could be less than the tolerances, and
values would be wrong without any message.
`metric_family.tgospa_problem` makes a problem from distances, cutoff, order and penalty.
"""

import math
from functools import cached_property

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, freeze
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError


def sum_by(index: Ints, value: Floats, size: int) -> Floats:
    """Return, for each number from 0 to size - 1, the sum of the values with this `index`.

    Values are added in the given order.
    """
    return np.bincount(index, value, minlength=size).astype(np.float64, copy=False)


def sum_parts(value: Floats, first: Ints) -> Floats:
    """Sum each part of the values; part i begins at first[i] and ends before first[i + 1]."""
    total: Floats = np.zeros(len(first) - 1)
    filled = first[1:] > first[:-1]  # reduceat returns a wrong value for empty parts
    if filled.any():
        total[filled] = np.add.reduceat(value, first[:-1][filled])
    return total


@dataclass(frozen=True, eq=False)
class Objects:
    """The true objects or the estimates of a problem.

    The fields `step`, `track`, `price` and `row` are those of `Problem` with the prefix ``truth_``
    or ``estimate_``. `count` is the number of objects. `unjudged` is the mask of the rows that are
    ignored or excused, or None if the problem has no masks.
    """

    count: int
    step: Ints
    track: Ints
    price: Floats
    row: Ints
    unjudged: Mask | None

    @property
    def evaluated(self) -> Ints | slice:
        """Rows that are neither ignored nor excused."""
        return slice(None) if self.unjudged is None else np.flatnonzero(~self.unjudged)


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Prices A and B, costs D and switch prices lambda of a linear programme, in units of c^p.

    A solver needs only these numbers, for the metric and for all its variants. Truth and estimate
    (the two sides) are flat tables. Each table has a row for each object at each step at which the
    object exists. Rows are sorted by (step, track). An *entry* is a pair of rows of one step with a
    gain: assigning the two costs less than leaving both unassigned. Assigning any other pair gains
    nothing.

    Parameters
    ----------
    steps, truths, estimates : int
        Number T of steps, m of true objects and n of estimates.
    truth_step, truth_track, truth_price : (R_truth,) arrays
        Step and track of each existing true object, and the price A of leaving it unassigned.
    estimate_step, estimate_track, estimate_price : (R_estimate,) arrays
        Step and track of each existing estimate, and the price B of leaving it unassigned.
    truth_row, estimate_row : (N,) int arrays
        The two rows of each entry; entries are sorted by (step, truth, estimate).
    cost : (N,) float array
        Cost of each assigned pair, less than A + B.
    switch_price : float or (T - 1,) float array
        Price of half a switch: one number, or a number for each change from a step to the next.
    cost_error : float
        Largest relative error of the costs and switch prices. Bounds are widened by it.
    cost_slack : float
        Largest amount by which the sum of the costs of an assignment can be too large. It is
        positive if tiny costs were raised to a smallest cost.
    rounding : float
        Cost that rounding of the last digits of the states can cause.
    distance_power : (N,) float array, optional
        (d / c)^p of each entry. By default, it is the cost of the entry divided by A + B. It is
        given in variants with another cost: see `weight_existence` and `ignore_states`.
    unjudged : pair of (R,) bool arrays, optional
        Masks of ignored objects and of excused estimates: see `ignore_states`.
    pair_share : (N,) float array, optional
        Factor of (d / c)^p in the cost of each entry, from `ignore_states`; it is 0 for an ignored
        object. By default, the factor is A + B, or 2 min(A, B) if objects have probabilities of
        existence.
    at_cutoff : int
        Number of pairs with an ignored object for which only the rounding of the distance decides
        if the pair has a gain.
    signed : bool
        Whether gains are allowed to be negative. The certificate does not support such a problem.
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
    distance_power: Floats | None = None
    unjudged: tuple[Mask, Mask] | None = None
    pair_share: Floats | None = None
    at_cutoff: int = 0
    signed: bool = False

    def __post_init__(self) -> None:
        freeze(self)
        if (self.truth_step[self.truth_row] != self.estimate_step[self.estimate_row]).any():
            raise ConfigError("an entry pairs a truth and an estimate of different steps")
        if not (
            (self._min_gain > 0 or (self.signed and self._min_gain > -np.inf))
            and -np.inf < self.cost.min(initial=0.0)
        ):
            raise ConfigError("gains must be positive and finite")
        if not isinstance(self.switch_price, float) and self.switch_price.shape != (
            max(self.steps - 1, 0),
        ):
            raise ConfigError("switch prices must be one number or one for each transition")

    @cached_property
    def sides(self) -> tuple[Objects, Objects]:
        """True objects and estimates."""
        ignored, excused = self.unjudged or (None, None)
        return (
            Objects(
                self.truths,
                self.truth_step,
                self.truth_track,
                self.truth_price,
                self.truth_row,
                ignored,
            ),
            Objects(
                self.estimates,
                self.estimate_step,
                self.estimate_track,
                self.estimate_price,
                self.estimate_row,
                excused,
            ),
        )

    @property
    def _min_gain(self) -> float:
        if self.pair_price is None:
            return float(self.gain.min(initial=np.inf))
        return self.pair_price - float(self.cost.max(initial=-np.inf))

    @property
    def entry_step(self) -> Ints:
        """Step of each entry, (N,)."""
        return self.truth_step[self.truth_row].astype(np.int32, copy=False)

    @cached_property
    def unassigned_costs(self) -> tuple[Floats, Floats]:
        """Cost of leaving each true object (m,) and each estimate (n,) unassigned at all steps."""
        truths, estimates = (sum_by(side.track, side.price, side.count) for side in self.sides)
        return truths, estimates

    @cached_property
    def object_prices(self) -> tuple[float, float] | None:
        """A and B, if each is the same for all rows and A + B is exact in doubles; else None."""
        for price in (self.truth_price, self.estimate_price):
            if not len(price) or (price.strides != (0,) and (price != price[0]).any()):
                return None
        first, second = float(self.truth_price[0]), float(self.estimate_price[0])
        whole = math.fsum((first, second, -(first + second))) == 0.0
        return (first, second) if whole else None

    @cached_property
    def pair_price(self) -> float | None:
        """A + B, or None if `object_prices` is None."""
        return None if self.object_prices is None else sum(self.object_prices)

    def weight(self, entry: Ints | slice) -> Floats | float:
        """Return A + B of some entries."""
        if self.pair_price is not None:
            return self.pair_price
        first, second = self._prices(entry)
        first += second
        return first

    def share(self, entry: Ints | slice) -> Floats | float:
        """Return the factor of (d / c)^p in the cost of some entries: A + B, or 2 min(A, B)."""
        if self.pair_share is not None:
            return self.pair_share[entry]
        if self.distance_power is None:
            return self.weight(entry)
        return 2.0 * np.minimum(*self._prices(entry))

    def powers(self, entry: Ints | slice) -> Floats:
        """Return (d / c)^p of some entries."""
        if self.distance_power is None:
            return self.cost[entry] / self.weight(entry)
        return self.distance_power[entry]

    def mismatch(self, entry: Ints | slice) -> Floats | float:
        """Return the part |A - B| of the cost of some entries.

        Unequal probabilities of existence cause this part. It is 0 if no such probabilities are
        used.
        """
        if self.distance_power is None or self.unjudged is not None:
            return 0.0
        return np.abs(np.subtract(*self._prices(entry)))

    def _prices(self, entry: Ints | slice) -> tuple[Floats, Floats]:
        return self.truth_price[self.truth_row[entry]], self.estimate_price[
            self.estimate_row[entry]
        ]

    @property
    def gain(self) -> Floats:
        """Gain A + B - cost of assigning each entry, (N,). Digits of small costs are lost."""
        return self.gains(slice(None))

    def gains(self, entry: Ints | slice) -> Floats:
        """Return the gain of some entries."""
        return self.weight(entry) - self.cost[entry]

    @cached_property
    def switch_price_at(self) -> Floats:
        """Price of half a switch into each step from the step before, (T + 1,).

        It is 0 into the first step. The last element is also 0, for a step after the last.
        """
        price = np.zeros(self.steps + 1)
        price[1 : self.steps] = self.switch_price
        price.flags.writeable = False
        return price
