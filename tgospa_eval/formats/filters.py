"""Which rows take part: ranges of time and of columns, as texts and applied. Knows no file."""

import math
import re
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats.fields import floats
from tgospa_eval.formats.times import TimeError, parse_times
from tgospa_eval.text import quoted
from tgospa_eval.tracks.durations import Duration, Steps
from tgospa_eval.tracks.trajectories import CLOCKS, TimeArray

Flags = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Moments:
    """A range of time, ends included.

    Parameters
    ----------
    low, high : int, float or None
        Numbers, or nanoseconds since 1970; None is open.
    clock : {"number", "local", "zoned"}
        Kind of time.
    text : str
        As given.
    """

    low: int | float | None
    high: int | float | None
    clock: str
    text: str

    def inside(self, times: TimeArray, clock: str, where: str) -> Flags:
        """Which of the times lie in the range; integers are compared exactly.

        Raises
        ------
        ConfigError
            The times are of another kind.
        """
        if clock != self.clock and len(times):
            raise ConfigError(
                f"--time {self.text}: {CLOCKS[self.clock]}, but {where} has {CLOCKS[clock]}; "
                "write the range alike"
            )
        keep = np.ones(len(times), bool)
        for end, is_low in ((self.low, True), (self.high, False)):
            if end is not None:
                if times.dtype.kind == "i":
                    end = math.ceil(end) if is_low else math.floor(end)
                keep &= times >= end if is_low else times <= end
        return keep


def parse_moments(text: str | None) -> Moments | None:
    """The range ``A:B``; of ISO times, which contain colons, it is split where both halves parse.

    Raises
    ------
    ConfigError
        It is no range, or its ends are of two kinds.
    """
    if text is None:
        return None
    found = []
    for colon in (match.start() for match in re.finditer(":", text)):
        halves = [text[:colon].strip(), text[colon + 1 :].strip()]
        given = [half for half in halves if half]
        try:
            times = parse_times(given, floats) if given else None
        except TimeError:
            continue
        ends = iter(times.value.tolist() if times else ())
        low, high = (next(ends) if half else None for half in halves)
        found.append((low, high, times.clock if times else None))
    if len(found) != 1 or found[0][2] is None:
        raise ConfigError(
            f"--time {quoted(text)}: must be A:B, two numbers or two ISO times, of which one may "
            "be blank"
        )
    low, high, clock = found[0]
    if low is not None and high is not None and low > high:
        raise ConfigError(f"--time {quoted(text)}: ends before it begins")
    return Moments(low=low, high=high, clock=str(clock), text=text)


def parse_steps(text: str | None) -> Steps | None:
    """Declared steps, ``FIRST:LAST[:EVERY]``; of ISO times, which contain colons, as it parses.

    Raises
    ------
    ConfigError
        It is none, its ends are of two kinds, or it ends before it begins.
    """
    if text is None:
        return None
    found: list[Steps] = []
    parts = text.split(":")
    for i in range(1, len(parts)):
        for j in range(i + 1, len(parts) + 1):
            first, last, every = (
                ":".join(parts[a:b]).strip() for a, b in ((0, i), (i, j), (j, None))
            )
            if j < len(parts) - 1 or not (first and last) or (j < len(parts) and not every):
                continue
            try:
                times = parse_times([first, last], floats)
                apart = Duration.of(every, "--steps") if every else None
            except (TimeError, ConfigError):
                continue
            low, high = times.value.tolist()
            found.append(Steps(first=low, last=high, every=apart, clock=times.clock, text=text))
    if len(found) != 1:
        raise ConfigError(
            f"--steps {quoted(text)}: must be FIRST:LAST or FIRST:LAST:EVERY, two numbers or two "
            "ISO times, and how far apart the steps are, such as 0:99 or 0:10:100ms"
        )
    if found[0].first > found[0].last:
        raise ConfigError(f"--steps {quoted(text)}: ends before it begins")
    return found[0]


def class_named(name: str, there: Collection[str]) -> str | None:
    """The class of this name; if there is none, the only one that differs in case alone."""
    found = [other for other in there if is_alike(name, other)]
    return name if name in found else found[0] if len(found) == 1 else None


def is_alike(name: str, other: str) -> bool:
    """Whether two names differ in upper and lower case at most."""
    return name.casefold() == other.casefold()


def parse_region(text: str | None) -> dict[str, tuple[float, float]]:
    """Ranges by column of ``x=-50:50,y=0:``.

    Raises
    ------
    ConfigError
        It cannot be understood.
    """
    ranges: dict[str, tuple[float, float]] = {}
    for item in () if text is None else text.split(","):
        name, equals, span = (part.strip() for part in item.partition("="))
        ends = [part.strip() for part in span.split(":")]
        try:
            if not name or not equals or len(ends) != 2 or not any(ends) or name in ranges:
                raise ValueError
            low = floats([ends[0]])[0] if ends[0] else -math.inf
            high = floats([ends[1]])[0] if ends[1] else math.inf
            if not low <= high or not all(map(math.isfinite, floats([e for e in ends if e]))):
                raise ValueError
        except ValueError:
            raise ConfigError(
                f"--region {quoted(item)}: must be NAME=LOW:HIGH, each name once, LOW <= HIGH, "
                "of which one may be blank"
            ) from None
        ranges[name] = (float(low), float(high))
    return ranges
