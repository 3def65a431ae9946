"""A cutoff that suits the data, and why: well above the errors, from their median."""

import math

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.problem import Floats

MULTIPLE = 3
"""Of the median error: of normal errors in a plane 99.8 % are below that."""

FOLLOWED = 0.75
"""Share of truths that must have an estimate so near, for the median to be that of errors."""

LARGEST_MEDIAN = 1e300
"""Of a median: multiples are still numbers."""

LEADING = (1.0, 2.0, 5.0, 10.0)
"""Leading digits of what is suggested."""


@dataclass(frozen=True, kw_only=True)
class Suggestion:
    """A cutoff to begin with.

    Parameters
    ----------
    cutoff : float
        In the unit of the distance.
    reason : str
        Where it is from.
    """

    cutoff: float
    reason: str


def suggest_cutoff(near: Floats, others: Floats) -> Suggestion | None:
    """A cutoff for such distances; None where they do not tell errors from misses.

    Parameters
    ----------
    near : (N,) float array
        From truths to the nearest estimate of their step.
    others : (N,) float array
        From these truths to the nearest other truth, inf where there is none.
    """
    if not len(near):
        return None
    middle, apart = (float(np.sort(values)[len(near) // 2]) for values in (near, others))
    # What belongs to a truth is nearer to it than to the next one.
    if not 0 < middle < min(apart / 2, LARGEST_MEDIAN):
        return None
    cutoff = _rounded_up(MULTIPLE * middle)
    followed = float(np.count_nonzero(near < cutoff) / len(near))
    if followed < FOLLOWED:
        return None
    reason = (
        f"{MULTIPLE} times the median distance, {middle:.3g}, rounded up; "
        f"{100 * followed:.0f} % of the truths have an estimate nearer than that"
    )
    crowded = float(np.count_nonzero(others < cutoff) / len(near))
    if crowded >= 0.005:
        reason += f", and {100 * crowded:.0f} % another truth"
    return Suggestion(cutoff=cutoff, reason=reason)


def _rounded_up(value: float) -> float:
    """To a leading digit of `LEADING`."""
    power = math.floor(math.log10(value))
    ends = (float(f"{digit:g}e{power}") for digit in LEADING)
    return next((end for end in ends if value <= end), float(f"1e{power + 1}"))
