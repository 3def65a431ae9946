"""Norms of the difference of two points, with scaled components or components on a circle."""

from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.arrays import Floats, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.base import REACH_ROUNDING, Distance, Pairs, Sides, exactly_nearer
from tgospa_eval.errors import ConfigError, real_number

if TYPE_CHECKING:
    from fractions import Fraction

SMALLEST_SCALE, LARGEST_SCALE = 1e-150, 1e150
"""Limits of scales and periods, beyond which products with a cutoff may overflow."""

MAX_BLUR = 2.0**-20
"""Largest value of `Norm.margin` as a share of the cutoff. If coordinates have larger rounding
errors, they are too coarse for this cutoff anyway."""


@dataclass(frozen=True, kw_only=True)
class Norm(Distance):
    """Minkowski norm of the difference of two points, with scales and periods.

    For points a and b it is the norm of the vector delta, ``delta_k = s_k min(r_k, P_k - r_k)``,
    where ``r_k = |a_k - b_k| mod P_k``, with scales s and periods P. By default scales are 1 and
    periods are infinite. It is a metric on points (docs/theory/distances.md). A period is in the
    unit of its column, before scaling.

    Parameters
    ----------
    name : str
        Name as on the command line.
    power : {1.0, 2.0, inf}
        1.0 means Manhattan, 2.0 Euclidean, and inf Chebyshev.
    scale : sequence of float, optional
        Factor of each column, > 0: from its unit to the unit of the distance.
    period : sequence of float, optional
        Period of each column, > 0 in its unit; inf for a column that is not periodic.

    Raises
    ------
    ConfigError
        A number is out of range.
    """

    name: str
    power: float
    scale: Sequence[float] | None = None
    period: Sequence[float] | None = None
    options = ("scale", "periodic")

    def __post_init__(self) -> None:
        if self.power not in (1.0, 2.0, np.inf):
            raise ConfigError(f"power is {self.power!r}: must be 1, 2 or inf")
        for name, also in (("scale", ()), ("period", (np.inf,))):
            object.__setattr__(self, name, positive_numbers(name, getattr(self, name), also))

    @property
    def tree_power(self) -> float:
        """Power of the search tree: the power of the norm, but at least 2 if there are periods.

        With periods, the search sorts points on circles. The Euclidean length of a chord is at most
        its arc, but the sum of its two coordinates may be longer.
        """
        return max(self.power, 2.0) if self.period is not None else self.power

    def error(self, dimension: int) -> float:
        """Return a bound of the relative rounding error, or 0 if no bound is known.

        The difference, its scaling, and ``dimension - 1`` sums or hypotenuses are rounded. With
        periodic components no bound is known, because the subtraction from the period cancels
        digits.
        """
        return 0.0 if self.period is not None else (2 * dimension + 2) * 2.0**-53

    def margin(self, sides: Sides, cutoff: float) -> float:
        """Return a margin around the cutoff in which rounding may decide if a pair is near.

        Differences, decimal coordinates and remainders by a period are rounded.
        """
        size = max(np.abs(side.state).max(initial=0.0) for side in sides)
        if self.period is not None:
            size = max(size, *(period for period in self.period if period < np.inf), 0.0)
        blur = 2.0**-50 * size * max(self.scale or (1.0,))
        return float(min(REACH_ROUNDING * cutoff + blur, MAX_BLUR * cutoff))

    def nearer(self, pairs: Pairs, sides: Sides, cutoff: Floats) -> Mask:
        """Return, exactly, for each of N pairs whether it is nearer than its own cutoff, (N,)."""
        from fractions import Fraction  # lazy: slow to import, and few pairs are at the cutoff

        def decide(a: "list[Fraction]", b: "list[Fraction]", cutoff: "Fraction") -> bool:
            sizes = [abs(x - y) for x, y in zip(a, b, strict=True)]
            for k, period in enumerate(self.period or ()):
                if period < np.inf:
                    sizes[k] %= Fraction(period)
                    sizes[k] = min(sizes[k], Fraction(period) - sizes[k])
            for k, scale in enumerate(self.scale or ()):
                sizes[k] *= Fraction(scale)
            if self.power == 2.0:
                return sum(size * size for size in sizes) < cutoff * cutoff
            return (sum(sizes) if self.power == 1.0 else max(sizes)) < cutoff

        return exactly_nearer(self, pairs, sides, cutoff, decide)

    def last_place(self, sides: Sides) -> float:
        """Return roughly how much a distance changes with the last bits of states.

        Without periods it is 0, because differences of doubles are exact to their last place.
        """
        if self.period is None:
            return 0.0
        return 2.0**-50 * min(self.period) * min(self.scale or (1.0,))

    def between(self, components: Iterable[tuple[Floats, Floats]]) -> Floats:
        """Return the distances of states (see `Distance.between`), without overflow."""
        sizes = self._sizes(components)
        if self.power == 1.0:
            return reduce(np.add, sizes)
        if self.power == np.inf:
            return reduce(np.maximum, sizes)
        return reduce(np.hypot, sizes)

    def _sizes(self, components: Iterable[tuple[Floats, Floats]]) -> Iterator[Floats]:
        """Return the absolute difference of each component."""
        for k, (a, b) in enumerate(components):
            period = np.inf if self.period is None else self.period[k]
            size = np.abs(a - b) if period == np.inf else _around(a, b, period)
            yield size if self.scale is None else self.scale[k] * size

    def slopes_between(self, a: Floats, b: Floats) -> Floats:
        """Return the derivative of the norm by the point `b`; all arrays are (d, N)."""
        scale = np.ones((len(a), 1)) if self.scale is None else np.array(self.scale)[:, None]
        difference = b - a
        for k, period in enumerate(self.period or ()):
            if period < np.inf:
                difference[k] = np.remainder(difference[k] + 0.5 * period, period) - 0.5 * period
        difference = difference * scale
        sign = np.sign(difference)
        if self.power == 1.0:
            return scale * sign
        if self.power == np.inf:
            largest = np.argmax(np.abs(difference), axis=0) == np.arange(len(difference))[:, None]
            return np.where(largest, scale * sign, 0.0)
        length = reduce(np.hypot, np.abs(difference))  # np.abs: for one component, no hypot
        return scale * shares(difference, length)

    def embed(self, axes: Floats) -> Floats:
        """Return points, in which a periodic component becomes two coordinates on a circle."""
        if self.period is None:
            return axes
        points: list[Floats] = []
        for x, period in zip(axes, self.period, strict=True):
            if period == np.inf:
                points.append(x)
            else:
                radius, angle = period / (2 * np.pi), 2 * np.pi * (np.fmod(x, period) / period)
                points += [radius * np.cos(angle), radius * np.sin(angle)]
        return np.array(points)

    def reach(self, cutoff: float, axes: Floats) -> Floats:
        """Return the cutoff in the unit of each column: near points differ by less."""
        if self.scale is None and self.period is None:
            return np.full((len(axes), 1), cutoff)
        reach: list[float] = []
        for scale, period in zip(
            self.scale or (1.0,) * len(axes), self.period or (np.inf,) * len(axes), strict=True
        ):
            own = cutoff / scale * (1 + REACH_ROUNDING)
            # Coordinates on the circle are rounded in units of its radius.
            reach += [own] if period == np.inf else [own + 2.0**-46 * period] * 2
        return np.array(reach)[:, None]


def shares(parts: Floats, whole: Floats) -> Floats:
    """Return quotients; a quotient is 0 if the whole is 0."""
    return np.asarray(np.divide(parts, whole, out=np.zeros_like(parts), where=whole > 0))


def _around(a: Floats, b: Floats, period: float) -> Floats:
    """Return the difference by the shorter way round the circle; fmod has no rounding errors."""
    size = np.fmod(np.abs(np.fmod(a, period) - np.fmod(b, period)), period)
    return np.asarray(np.minimum(size, period - size))


def positive_numbers(
    name: str, values: Sequence[float] | None, also: tuple[float, ...] = ()
) -> tuple[float, ...] | None:
    """Check and return one number for each column.

    Raises
    ------
    ConfigError
        A value is not a number, or is out of range.
    """
    if values is None:
        return None
    if isinstance(values, str) or not np.iterable(values):
        raise ConfigError(f"{name} is {values!r}: must be one number per state column")
    numbers = tuple(real_number(name, value) for value in values)
    for number in numbers:
        if not (SMALLEST_SCALE <= number <= LARGEST_SCALE or number in also):
            raise ConfigError(
                f"{name} is {number:g}: must be > 0, from {SMALLEST_SCALE:g} to {LARGEST_SCALE:g}"
            )
    return numbers


EUCLIDEAN = Norm(name="euclidean", power=2.0)
MANHATTAN = Norm(name="manhattan", power=1.0)
CHEBYSHEV = Norm(name="chebyshev", power=np.inf)
