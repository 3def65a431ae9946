"""How numbers are written for people, everywhere alike: 12,345.7, and how people write them.

Files for programs do without.
"""

import math
import re

THOUSANDS = 1e9
"""Up to here a number is written out."""


PLAIN_DECIMAL = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
"""A number as people write it; Python also takes 1_0, digits of any script, nan and inf."""

PLAIN_WHOLE = "[-+]?[0-9]{1,30}"


def parsed(text: str) -> float | None:
    """The finite number that a plain decimal stands for; None of any other text."""
    value = float(text) if re.fullmatch(PLAIN_DECIMAL, text.strip()) else math.inf
    return value if math.isfinite(value) else None


def parsed_whole(text: str) -> int | None:
    """The same of whole numbers."""
    return int(text) if re.fullmatch(PLAIN_WHOLE, text.strip()) else None


def shortest(value: float, noise: float) -> float:
    """The number of fewest digits within `noise` of the value.

    A difference of stamps has the rounding of the stamps: 0.1 rather than 0.0999999.
    """
    shorter = (float(f"{value:.{digits}g}") for digits in range(1, 6))
    return next((short for short in shorter if abs(short - value) <= noise), value)


def number(value: float, digits: int = 6) -> str:
    """The value with at most so many significant digits, and commas between thousands.

    Whole digits in front of the point are all written, rounded.
    """
    value = float(f"{value:.{digits}g}")
    if 10.0**digits <= abs(value) < THOUSANDS:
        return f"{value:,.0f}"
    return f"{value:,.{digits}g}"


def plain(value: float) -> int | float:
    """A number to type, without a decimal point where it is whole."""
    return int(value) if value.is_integer() else value
