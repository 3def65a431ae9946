"""Words of messages and reports: counts with nouns, commands to install, natural order."""

import math
import re
import sys
from collections.abc import Mapping
from importlib.util import find_spec

from tgospa_eval.errors import ConfigError

THOUSANDS = 1e9
"""Numbers below this are written without an exponent, with commas."""


PLAIN_DECIMAL = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
"""Regular expression of a plain decimal. Python also accepts 1_0, digits of other scripts, nan and
inf; these do not match."""

PLAIN_WHOLE = "[-+]?[0-9]{1,30}"


def parsed(text: str) -> float | None:
    """Parse a plain decimal to a finite number; return None for any other text."""
    value = float(text) if re.fullmatch(PLAIN_DECIMAL, text.strip()) else math.inf
    return value if math.isfinite(value) else None


def parsed_whole(text: str) -> int | None:
    """Parse a plain integer; return None for any other text."""
    return int(text) if re.fullmatch(PLAIN_WHOLE, text.strip()) else None


BYTES_OF = {"": 10**9, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
BYTES_OF |= {"KIB": 2**10, "MIB": 2**20, "GIB": 2**30, "TIB": 2**40}

MIN_MEMORY = 100 * 10**6
"""Smallest number of bytes with which a process can work."""


def parsed_size(value: object) -> int:
    """Return the bytes of a size such as 4GB, 500MB or 1.5GiB; a plain number means GB.

    Raises
    ------
    ConfigError
        The text is not a size, or the size is less than `MIN_MEMORY` or at least 1 PiB.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ConfigError(f"{value!r} is not a size; write 4GB or 500MB")
    parts = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([A-Za-z]*)\s*", str(value))
    unit = BYTES_OF.get(parts[2].upper()) if parts else None
    if parts is None or unit is None:
        raise ConfigError(
            f"{str(value)!r} is not a size; write 4GB or 500MB, a number alone means GB"
        )
    size = float(parts[1]) * unit
    if not MIN_MEMORY <= size < 2**50:
        raise ConfigError(f"{value} is less than 100MB, or more than this machine has")
    return int(size)


def shortest(value: float, noise: float) -> float:
    """Return the number with the fewest digits, up to 5, that is within `noise` of the value.

    If there is no such number, return the value. Example: the difference of two timestamps is
    0.0999999 because of rounding errors, and 0.1 is shown instead.
    """
    shorter = (float(f"{value:.{digits}g}") for digits in range(1, 6))
    return next((short for short in shorter if abs(short - value) <= noise), value)


def number(value: float, digits: int = 6) -> str:
    """Format a value with this many significant digits, and commas between thousands.

    Large values below `THOUSANDS` have no exponent: 1234567 becomes 1,234,570.
    """
    value = float(f"{value:.{digits}g}")
    if 10.0**digits <= abs(value) < THOUSANDS:
        return f"{value:,.0f}"
    return f"{value:,.{digits}g}"


def plain(value: float) -> int | float:
    """Return a whole number as an int, so that it is written without a decimal point."""
    return int(value) if value.is_integer() else value


def counted(number: int, one: str, many: str = "") -> str:
    """Format a count with its noun: 1 row, 2 rows.

    Parameters
    ----------
    number : int
        The count.
    one : str
        Singular of the noun, possibly with further words: ``"row has"``.
    many : str
        Plural of the same: ``"rows have"``. By default, an s is added to `one`.
    """
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def sizes_in_words(sizes: Mapping[str, int]) -> str:
    """Format the counts of true objects, estimates and steps."""
    nouns = {"truth": "ground-truth object", "estimates": "estimate", "steps": "step"}
    return ", ".join(counted(sizes[name], noun) for name, noun in nouns.items())


def more(count: int) -> str:
    """Format how many of `count` equal mistakes are not shown, because only one is shown."""
    return f" (and {count - 1} more)" if count > 1 else ""


def in_both(steps: Mapping[str, int]) -> str:
    """Format the number of steps in both files, or the number of steps with states of both."""
    if "truth" in steps:
        return (
            f"{counted(steps['counted'], 'step counts', 'steps count')}: {steps['truth']:,} with "
            f"states of the truth, {steps['estimate']:,} of the estimate, {steps['common']:,} of "
            "both"
        )
    are = "step is" if steps["union"] == 1 else "steps are"
    return f"{steps['common']:,} of {steps['union']:,} {are} in both files"


def install(extra: str) -> str:
    """Return the command that adds an extra to this installation.

    The command works even if tgospa-eval is not on a package index: pip keeps the installed
    version, and fetches only the packages of the extra. In an environment of uv, which has no pip,
    the command begins with uv. Double quotes work in all shells.
    """
    python = f'"{sys.executable}"' if " " in sys.executable else sys.executable
    if find_spec("pip") is None:
        return f'uv pip install --python {python} "tgospa-eval[{extra}]"'
    return f'{python} -m pip install "tgospa-eval[{extra}]"'


def natural(text: str) -> tuple[list[tuple[int, int, str]], str]:
    """Return a sort key that compares numbers in texts by value: a2 is before a10."""
    if text.isascii() and text.isdigit():  # most ids
        digits = text.lstrip("0")
        return [(0, len(digits), digits)], text
    parts = re.findall(r"[0-9]+|[^0-9]+", text)
    keys = [(0, len(p.lstrip("0")), p.lstrip("0")) if p[0].isdigit() else (1, 0, p) for p in parts]
    return keys, text
