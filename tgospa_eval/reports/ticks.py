"""Axes of the charts of pages: ticks at round numbers, room above."""

import math

from tgospa_eval.common.frozen import dataclass

ROOM = 1.05
"""Height of a chart, as a multiple of what is in it."""


@dataclass(frozen=True, kw_only=True)
class Tick:
    """A place on an axis.

    Parameters
    ----------
    at : float
        In percent.
    text : str
        What it says.
    """

    at: float
    text: str


def round_steps(low: float, high: float, most: int = 6) -> list[float]:
    """Round numbers from `low` to `high`, at most so many."""
    if not high > low:
        return [low]
    raw = (high - low) / (most - 1)
    unit = 10.0 ** math.floor(math.log10(raw))
    each = next(unit * factor for factor in (1, 2, 5, 10) if unit * factor >= raw * (1 - 1e-9))
    first = math.ceil(low / each - 1e-9)
    return [k * each for k in range(first, math.floor(high / each + 1e-9) + 1)]
