"""What is known of a number that is between two others. Knows no metric."""

import math
from collections.abc import Callable, Sequence
from typing import Literal

from tgospa_eval.common.frozen import dataclass


@dataclass(frozen=True, kw_only=True)
class Interval:
    """``lower <= value <= upper``, in one unit for all that are compared.

    Parameters
    ----------
    lower, upper : float
        The bounds.
    """

    lower: float
    upper: float

    def scaled(self, factor: float) -> "Interval":
        """Of the value times a positive factor."""
        return Interval(lower=self.lower * factor, upper=self.upper * factor)


# -------------------------------------------------------------------------------------------------
# What follows from proven brackets: whether they agree, what is nearest, which is less.

EQUAL = 1e-9
"""Values that differ by at most this share of themselves are equal."""


def overlap(first: Interval, second: Interval) -> bool:
    """Whether both can hold the same value."""
    return first.lower <= second.upper and second.lower <= first.upper


def less(first: Interval, second: Interval) -> bool:
    """Whether the first value is proven to be below the second."""
    return first.upper < second.lower


def equal(first: Interval, second: Interval) -> bool:
    """Whether both values are proven to be the same, but for `EQUAL` of them."""
    most = max(first.upper - second.lower, second.upper - first.lower)
    return most <= EQUAL * max(first.upper, second.upper)


def verdict(first: Interval, second: Interval) -> Literal["less", "equal", "not separated"]:
    """What is proven of two values."""
    if less(first, second):
        return "less"
    return "equal" if equal(first, second) else "not separated"


def second_less_first(first: Interval, second: Interval) -> Interval:
    """Bounds of the difference."""
    return Interval(lower=second.lower - first.upper, upper=second.upper - first.lower)


def narrowest(brackets: Sequence[Interval]) -> Interval:
    """The intersection of brackets of one value: the largest lower and the least upper bound."""
    return Interval(
        lower=max(bracket.lower for bracket in brackets),
        upper=min(bracket.upper for bracket in brackets),
    )


def excess(value: float, floor: float) -> float:
    """(value - floor) / floor, at least 0: how far a value may be above what it bounds."""
    if value <= floor:
        return 0.0
    return (value - floor) / floor if floor > 0 else math.inf


def shortfall(value: float, ceiling: float) -> float:
    """(ceiling - value) / ceiling, at least 0: how far a value may be below what it bounds."""
    return (ceiling - value) / ceiling if value < ceiling else 0.0


def places(
    brackets: Sequence[Interval], alike: Callable[[int, int], bool] | None = None
) -> list[tuple[int, int]]:
    """Best and worst place, counted from 1, that each can have in the order of the values.

    One is ahead only of those that are proven to be above it; equal ones share their places.

    Parameters
    ----------
    brackets : sequence of Interval
        Of the values.
    alike : callable, optional
        Whether two of them, by their numbers, are equal; by default if their brackets prove it.
    """
    alike = alike or (lambda k, other: equal(brackets[k], brackets[other]))
    found = []
    for k, own in enumerate(brackets):
        ahead = sum(less(other, own) for other in brackets)
        behind = sum(
            j != k and (less(own, other) or alike(k, j)) for j, other in enumerate(brackets)
        )
        found.append((1 + ahead, len(brackets) - behind))
    return found
