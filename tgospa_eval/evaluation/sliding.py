"""Sliding windows: stretches of steps or of time, each some way after the one before."""

import re

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.problem import Ints
from tgospa_eval.text import quoted
from tgospa_eval.tracks.durations import MAX_STEPS, SECOND, TIME_UNITS, Duration
from tgospa_eval.tracks.trajectories import TimeArray


@dataclass(frozen=True, kw_only=True)
class Sliding:
    """Windows of `size` that begin at the first step, `every` after it, and so on.

    Parameters
    ----------
    size : int or Duration
        Length of each, more than 0: steps, or time.
    every : int or Duration
        From one to the next, more than 0 and at most `size`, so that each step is in a window.

    Raises
    ------
    ConfigError
        A length is out of its range, or one is in steps and the other a time.
    """

    size: int | Duration
    every: int | Duration

    def __post_init__(self) -> None:
        if isinstance(self.size, Duration) != isinstance(self.every, Duration):
            raise ConfigError(
                f"window is {in_words(self.size)} and every is {in_words(self.every)}: give both "
                "in steps, or both as times"
            )
        if self.every > self.size:
            raise ConfigError(
                f"every is {in_words(self.every)}: must be at most the {in_words(self.size)} of a "
                "window, or there would be steps in none"
            )

    @classmethod
    def asked(cls, window: int | str | None, every: int | str | None) -> "Sliding | None":
        """From options: `every` is half a window by default; None without a window.

        Raises
        ------
        ConfigError
            `every` is given without a window, or a length is out of its range.
        """
        if window is None:
            if every is not None:
                raise ConfigError("every is given without window: say how long a window is")
            return None
        size = _length(window, "window")
        if every is not None:
            return cls(size=size, every=_length(every, "every"))
        if not isinstance(size, Duration):
            return cls(size=size, every=max(size // 2, 1))
        half = float(size) * SECOND / TIME_UNITS[size.unit] / 2
        return cls(size=size, every=_length(f"{half:.15g}{size.unit}", "every"))

    def check(self, clock: str) -> None:
        """Whether stamps of this kind have seconds, if windows are stretches of time.

        Raises
        ------
        ConfigError
            They are plain numbers.
        """
        for value, name in ((self.size, "--window"), (self.every, "--every")):
            if isinstance(value, Duration):
                value.check(clock, name, "give a number of steps")

    def shown(self, steps: int) -> str:
        """The length of a window of a recording of so many steps, in words."""
        return in_words(self.size if isinstance(self.size, Duration) else min(self.size, steps))

    def spans(self, times: TimeArray) -> tuple[Ints, Ints]:
        """First and last step of each window among those at some times, (K,), (K,).

        Where the last regular window ends before the last step, one more ends with it, so that all
        are of one length and no step is left out. A stretch of time without a step is no window.

        Raises
        ------
        ConfigError
            They are too many.
        """
        if isinstance(self.size, Duration) and isinstance(self.every, Duration):
            return _spans_of_time(times, self.size, self.every)
        steps = len(times)
        size = min(int(self.size), steps)
        every = min(int(self.every), size)  # numbers of any size are asked for
        first = np.arange(0, steps - size + 1, every) if steps else np.zeros(0, np.int64)
        if len(first) and first[-1] + size < steps:
            first = np.append(first, steps - size)
        return first, first + size - 1


def in_words(length: int | Duration) -> str:
    """As a length is shown: 30 steps, or 2min."""
    return length.text if isinstance(length, Duration) else counted(length, "step")


def _length(given: object, name: str) -> int | Duration:
    """Steps, or a time with a unit."""
    if isinstance(given, str) and re.fullmatch(r"\s*[0-9]{1,99}\s*", given):
        given = int(given)
    if isinstance(given, int | np.integer) and not isinstance(given, bool):
        if given >= 1:
            return int(given)
    elif isinstance(given, str):
        found = Duration.of(given, name)
        if found.unit and found.nanoseconds >= 1:
            return found
    shown = quoted(given) if isinstance(given, str) else repr(given)
    raise ConfigError(
        f"{name} is {shown}: must be a whole number of steps, 1 or more, or a time with a unit, "
        "such as 30min"
    )


def _spans_of_time(times: TimeArray, size: Duration, every: Duration) -> tuple[Ints, Ints]:
    """Windows from t to before t + size; the last one ends with the last step."""
    if not len(times):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    begin, end = int(times[0]), int(times[-1])
    length = min(size.nanoseconds, end - begin + 1)  # numbers of any size are asked for
    apart = min(every.nanoseconds, length)
    count = max((end - length - begin) // apart + 1, 0)
    if count > MAX_STEPS:
        raise ConfigError(
            f"--every {every.text}: there are {count:,} windows; at most {MAX_STEPS:,}"
        )
    opens = np.append(begin + apart * np.arange(count, dtype=np.int64), end - length + 1)
    first = np.searchsorted(times, opens)
    last = np.searchsorted(times, opens + length) - 1
    other = (np.diff(first, prepend=-1) != 0) | (np.diff(last, prepend=-1) != 0)
    kept = (first <= last) & other
    return first[kept], last[kept]
