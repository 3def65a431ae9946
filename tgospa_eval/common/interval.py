"""Intervals that contain an unknown value, such as brackets of TGOSPA."""

import math
from collections.abc import Callable, Sequence
from typing import Literal

from tgospa_eval.common.frozen import dataclass


@dataclass(frozen=True, kw_only=True)
class Interval:
    """Interval ``lower <= value <= upper`` of an unknown value.

    Functions that take several intervals assume that all of them have the same unit.

    Parameters
    ----------
    lower, upper : float
        The bounds.
    """

    lower: float
    upper: float

    def scaled(self, factor: float) -> "Interval":
        """Return the interval of ``factor * value``; the factor is positive."""
        return Interval(lower=self.lower * factor, upper=self.upper * factor)


# -------------------------------------------------------------------------------------------------
# Comparing proven brackets.

EQUAL = 1e-9
"""Largest relative difference of two values that count as equal."""


def overlap(first: Interval, second: Interval) -> bool:
    """Return whether both intervals have a value in common."""
    return first.lower <= second.upper and second.lower <= first.upper


def less(first: Interval, second: Interval) -> bool:
    """Return whether the first value is proven to be below the second."""
    return first.upper < second.lower


def equal(first: Interval, second: Interval) -> bool:
    """Return whether both values are proven to be equal, up to the relative difference `EQUAL`."""
    difference = max(first.upper - second.lower, second.upper - first.lower)
    return difference <= EQUAL * max(first.upper, second.upper)


def verdict(first: Interval, second: Interval) -> Literal["less", "equal", "not separated"]:
    """Return the proven order of two values."""
    if equal(first, second):
        return "equal"
    return "less" if less(first, second) else "not separated"


def second_less_first(first: Interval, second: Interval) -> Interval:
    """Return bounds of the difference second minus first."""
    return Interval(lower=second.lower - first.upper, upper=second.upper - first.lower)


def narrowest(brackets: Sequence[Interval]) -> Interval:
    """Return the intersection of several brackets of the same value."""
    return Interval(
        lower=max(bracket.lower for bracket in brackets),
        upper=min(bracket.upper for bracket in brackets),
    )


def excess(value: float, floor: float) -> float:
    """Return (value - floor) / floor; 0 if the value is not above the floor.

    For a value above a floor of 0, the result is infinite.
    """
    if value <= floor:
        return 0.0
    return (value - floor) / floor if floor > 0 else math.inf


def shortfall(value: float, ceiling: float) -> float:
    """Return (ceiling - value) / ceiling, or 0 if the value is not below the ceiling."""
    return (ceiling - value) / ceiling if value < ceiling else 0.0


def places(
    brackets: Sequence[Interval], alike: Callable[[int, int], bool] | None = None
) -> list[tuple[int, int]]:
    """Return the best and the worst possible rank of each value, counted from 1.

    A value ranks before another one only if it is proven to be smaller. Equal values share ranks.

    Parameters
    ----------
    brackets : sequence of Interval
        Brackets of the values.
    alike : callable, optional
        Function that receives two indices and returns whether the values count as equal. By
        default, two values count as equal if their brackets prove it.
    """
    alike = alike or (lambda k, other: equal(brackets[k], brackets[other]))
    ranks = []
    for k, own in enumerate(brackets):
        ahead = sum(less(other, own) and not alike(k, j) for j, other in enumerate(brackets))
        behind = sum(
            j != k and (less(own, other) or alike(k, j)) for j, other in enumerate(brackets)
        )
        ranks.append((1 + ahead, len(brackets) - behind))
    return ranks
