"""How numbers are written for people, everywhere alike: 12,345.7. Files for programs do without."""

THOUSANDS = 1e9
"""Up to here a number is written out."""


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
