"""Times between stamps, as people write them, and steps that no file decides."""

import math
import re
from typing import Self

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.text import option, quoted
from tgospa_eval.tracks.trajectories import TimeArray

SECOND = 1_000_000_000
"""Nanoseconds of a second, in which ISO times are counted."""

TIME_UNITS = {
    "ns": 1,
    "us": 10**3,
    "ms": 10**6,
    "s": SECOND,
    "min": 60 * SECOND,
    "h": 3600 * SECOND,
}
"""Nanoseconds of each unit."""

MAX_STEPS = 10_000_000
"""Steps that may be declared."""

DURATION = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?|\.[0-9]+)\s*([a-z]*)\s*")


class Duration(float):
    """A time between two stamps: seconds, or the unit of stamps that are plain numbers.

    Attributes
    ----------
    text : str
        As it was written.
    unit : str
        Of `TIME_UNITS`; blank if it was written without.
    """

    text: str
    unit: str

    @classmethod
    def of(cls, given: object, name: str) -> Self:
        """What is meant by a number, or a text such as ``20ms`` or ``30min``.

        Raises
        ------
        ConfigError
            It is neither, negative or not finite.
        """
        if isinstance(given, cls):
            return given
        value, unit = given, ""
        if isinstance(given, str):
            found = DURATION.fullmatch(given)
            if found is None or found[2] not in ("", *TIME_UNITS):
                raise ConfigError(
                    f"{name} is {quoted(given)}: must be a number, or one with a unit of "
                    f"{', '.join(TIME_UNITS)}, such as 20ms"
                )
            unit = found[2]
            value = float(found[1]) * TIME_UNITS[unit] / SECOND if unit else float(found[1])
        if isinstance(value, bool) or not isinstance(value, int | float | np.number):
            raise ConfigError(f"{name} is {given!r}: must be a number, or a text such as 20ms")
        if not 0 <= value < math.inf:
            shown = quoted(given) if isinstance(given, str) else given
            raise ConfigError(f"{name} is {shown}: must be finite and >= 0")
        made = cls(value)
        made.text, made.unit = str(given), unit
        return made

    def check(self, clock: str, name: str, remedy: str = "give a number in their unit") -> None:
        """Whether stamps of this kind have seconds, if it has a unit.

        Raises
        ------
        ConfigError
            They are plain numbers, whose unit is not known.
        """
        if self.unit and clock == "number":
            raise ConfigError(
                f"{name} {self.text}: the times are plain numbers, whose unit is not known; "
                f"{remedy}"
            )

    @property
    def nanoseconds(self) -> int:
        """Of stamps that are times."""
        return round(float(self) * SECOND)


@dataclass(frozen=True, kw_only=True)
class Steps:
    """Declared steps: from `first` to `last`, ends included.

    Parameters
    ----------
    first, last : int or float
        As stamps are: numbers, or nanoseconds since 1970.
    every : Duration, optional
        From one to the next; 1 for stamps that are integers.
    clock : {"number", "local", "zoned"}
        What stamps are.
    text : str
        As given.
    """

    first: int | float
    last: int | float
    every: Duration | None
    clock: str
    text: str

    def ticks(self) -> TimeArray:
        """The steps (K,), each the number that its decimals say.

        Raises
        ------
        ConfigError
            It is not said how far apart they are, or they are too many.
        """
        whole = isinstance(self.first, int) and isinstance(self.last, int)
        every = self.every
        if every is None:
            if self.clock != "number" or not whole:
                raise ConfigError(
                    f"{option('steps', self.text)}: say how far apart the steps are, "
                    "FIRST:LAST:EVERY"
                )
            every = Duration.of(1, option("steps"))
        every.check(self.clock, option("steps"))
        return stretch(self.first, self.last, every, self.clock, option("steps", self.text))


def signed_seconds(given: object, name: str) -> float:
    """Seconds, or the unit of stamps that are numbers, of a number or a text such as ``-500ms``.

    Raises
    ------
    ConfigError
        It is neither.
    """
    if isinstance(given, str):
        text = given.strip()
        sign = -1.0 if text.startswith("-") else 1.0
        return sign * float(Duration.of(text.lstrip("+-") or text, name))
    return real_number(name, given)


def multiples(first: int | float, last: int | float, every: Duration, clock: str) -> TimeArray:
    """The multiples of a duration from one stamp to another, ends included.

    Raises
    ------
    ConfigError
        They are too many.
    """
    every.check(clock, option("resample"))
    return stretch(first, last, every, clock, option("resample", every.text), aligned=True)


def stretch(
    first: int | float,
    last: int | float,
    every: Duration,
    clock: str,
    name: str,
    *,
    aligned: bool = False,
) -> TimeArray:
    """Stamps `every` apart, from the first or from its next multiple on.

    They are decimals counted in integers, so that the third of 0.1 is 0.3.
    """
    if clock != "number":
        begin, end, step, scale = int(first), int(last), every.nanoseconds, 1
    else:
        from decimal import Decimal  # lazy: slow to import

        exact = [Decimal(repr(x)) for x in (first, last, float(every))]
        places = max(0, *(-int(x.normalize().as_tuple().exponent) for x in exact))
        scale = 10**places
        begin, end, step = (int(x * scale) for x in exact)
    if step < 1:
        raise ConfigError(f"{name}: steps must be more than 0 apart")
    if aligned:
        begin = -(-begin // step) * step
    count = max((end - begin) // step + 1, 0)
    if count > MAX_STEPS:
        raise ConfigError(f"{name}: has {count:,} steps; at most {MAX_STEPS:,} are evaluated")
    found = [begin + k * step for k in range(count)]
    if scale == 1 and all(-(2**63) <= x < 2**63 for x in found[:1] + found[-1:]):
        return np.array(found, np.int64)
    return np.array([x / scale for x in found], float)  # of integers: rounded once
