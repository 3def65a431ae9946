"""Durations as text, and timestamps and states in other units, independent of files.

A side is the truth or the estimate. Timestamps are converted as decimals, so that 100.5 ms and
0.1005 s are the same double. Whole numbers stay exact.
"""

import math
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Self, cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.trajectories import CLOCKS, PLACES, TimeArray, Trajectories

SECOND = 1_000_000_000
"""Nanoseconds of a second; ISO times are stored in nanoseconds."""

EARLIEST, LATEST = 10**8, 4 * 10**9
"""Numbers in this range could be seconds since 1970: the years 1973 to 2096."""

TIME_UNITS = {
    "ns": 1,
    "us": 10**3,
    "ms": 10**6,
    "s": SECOND,
    "min": 60 * SECOND,
    "h": 3600 * SECOND,
}
"""Nanoseconds of each unit."""

EPOCHS = ("s", "ms", "us", "ns")
"""Units of numbers that count from 1970."""

MAX_STEPS = 10_000_000
"""Largest number of declared steps."""

DURATION = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?|\.[0-9]+)\s*([a-z]*)\s*")


class Duration(float):
    """Time between two timestamps: in their unit if they are plain numbers, else in seconds.

    Attributes
    ----------
    text : str
        Duration as it was written.
    unit : str
        Unit of `TIME_UNITS`; blank if it was written without a unit.
    """

    text: str
    unit: str

    @classmethod
    def of(cls, given: object, name: str) -> Self:
        """Parse a number, or a text such as ``20ms`` or ``30min``.

        Raises
        ------
        ConfigError
            The value is negative or not finite, or it is neither a number nor such a text.
        """
        if isinstance(given, cls):
            return given
        value, unit = given, ""
        if isinstance(given, str):
            match = DURATION.fullmatch(given)
            if match is None or match[2] not in ("", *TIME_UNITS):
                raise ConfigError(
                    f"{name} is {quoted(given)}: must be a number, or one with a unit of "
                    f"{', '.join(TIME_UNITS)}, such as 20ms"
                )
            unit = match[2]
            value = float(match[1]) * TIME_UNITS[unit] / SECOND if unit else float(match[1])
        if isinstance(value, bool) or not isinstance(value, int | float | np.number):
            raise ConfigError(f"{name} is {given!r}: must be a number, or a text such as 20ms")
        if not 0 <= value < math.inf:
            shown = quoted(given) if isinstance(given, str) else given
            raise ConfigError(f"{name} is {shown}: must be finite and >= 0")
        made = cls(value)
        made.text, made.unit = str(given), unit
        return made

    def check(self, clock: str, name: str, remedy: str = "give a number in their unit") -> None:
        """Refuse a duration with a unit if the timestamps are plain numbers.

        `clock` is the kind of the timestamps; `name` and `remedy` are for the message.

        Raises
        ------
        ConfigError
            The duration has a unit, but the unit of the timestamps is unknown.
        """
        if self.unit and clock == "number":
            raise ConfigError(
                f"{name} {self.text}: the times are plain numbers, whose unit is not known; "
                f"{remedy}"
            )

    @property
    def nanoseconds(self) -> int:
        """Duration in nanoseconds."""
        return round(float(self) * SECOND)


def epoch_unit(times: TimeArray) -> str:
    """Return the unit of times that may count from 1970, by their size; blank if no unit fits."""
    ends = [abs(float(times[k])) for k in (0, -1)]
    scales = {unit: SECOND / TIME_UNITS[unit] for unit in EPOCHS}
    fits = (u for u, s in scales.items() if all(EARLIEST * s <= end < LATEST * s for end in ends))
    return next(fits, "")


@dataclass(frozen=True, kw_only=True)
class Steps:
    """Declared steps from `first` to `last`, ends included.

    Parameters
    ----------
    first, last : int or float
        First and last step, as timestamps: numbers, or nanoseconds since 1970.
    every : Duration, optional
        Time between two steps. The default is 1 if both ends are integers and not ISO times. In all
        other cases, it is required.
    clock : {"number", "local", "zoned"}
        Kind of the timestamps.
    text : str
        Steps as they were given.
    """

    first: int | float
    last: int | float
    every: Duration | None
    clock: str
    text: str

    def ticks(self) -> TimeArray:
        """Return the K steps (K,), computed as exact decimals.

        Raises
        ------
        ConfigError
            `every` is missing, 0, or has a unit that the timestamps lack, or there are too many
            steps.
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


def signed_duration(given: object, name: str) -> float:
    """Parse a number or a text such as ``-500ms``, to seconds if it has a unit.

    A number that is not a text is returned as it is; a text gives a `Duration`.

    Raises
    ------
    ConfigError
        The value is not a number or such a text.
    """
    if not isinstance(given, str):
        return real_number(name, given)
    text = given.strip()
    size = Duration.of(text.lstrip("+-") or text, name)
    signed = Duration(-size if text.startswith("-") else size)
    signed.text, signed.unit = text, size.unit
    return signed


def multiples(first: int | float, last: int | float, every: Duration, clock: str) -> TimeArray:
    """Return the multiples of a duration from `first` to `last`, ends included.

    Raises
    ------
    ConfigError
        There are too many multiples, or the duration is 0 or has a unit that the timestamps lack.
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
    """Return the times from `first` to `last` in steps of `every`.

    With `aligned` they are the multiples of `every` in this range. Times are computed as integers
    and divided at the end, so that the third multiple of 0.1 is 0.3.
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
    ticks = [begin + k * step for k in range(count)]
    if scale == 1 and all(-(2**63) <= x < 2**63 for x in ticks[:1] + ticks[-1:]):
        return np.array(ticks, np.int64)
    return np.array([x / scale for x in ticks], float)  # nothing before is rounded


EXACT_INTEGERS = 2.0**53
DIGITS_OF_SUMS = 60
"""Digits of intermediate results: more than timestamp, factor and offset have together."""


@dataclass(frozen=True, kw_only=True)
class Conversion:
    """Conversion of the times and states of one side to the units in which sides are compared.

    Parameters
    ----------
    time_offset : float
        Offset that is added to the timestamps after `time_scale`; in seconds for ISO times.
    time_scale : float
        Factor > 0 by which timestamps are multiplied; 1 for ISO times.
    unit_scale : float
        Factor > 0 by which lengths are multiplied: all state columns except `angles`. Covariances
        and particles are scaled accordingly.
    angles : tuple of str
        State columns that are not lengths.
    scale : tuple of (str, float)
        Factors > 0 of single state columns, which are applied in addition to `unit_scale`.
    scale_option : str
        Option that gives `scale`, for messages.

    Raises
    ------
    ConfigError
        A number is not finite, or a factor is not positive.
    """

    time_offset: float = 0.0
    time_scale: float = 1.0
    unit_scale: float = 1.0
    angles: tuple[str, ...] = ()
    scale: tuple[tuple[str, float], ...] = ()
    scale_option: str = "estimate_scale"

    def __post_init__(self) -> None:
        for name in ("time_offset", "time_scale", "unit_scale"):
            value = real_number(option(name), getattr(self, name))
            if not math.isfinite(value):
                raise ConfigError(f"{option(name)} is {value:g}: must be finite")
            if name != "time_offset" and value <= 0:
                raise ConfigError(f"{option(name)} is {value:g}: must be > 0")
            if not isinstance(getattr(self, name), Duration):
                object.__setattr__(self, name, value + 0.0)

    def recorded_of(self, role: str) -> dict[str, object]:
        """Return the settings that change something, by JSON name; `role` names the side."""
        neutral = {"time_offset": 0.0, "time_scale": 1.0, "unit_scale": 1.0}
        values = {name: getattr(self, name) for name in neutral}
        record: dict[str, object] = {k: v for k, v in values.items() if v != neutral[k]}
        return record | ({f"{role}_scale": dict(self.scale)} if self.scale else {})

    def times(
        self, times: TimeArray, clock: str, labels: NDArray[np.object_] | None, name: str
    ) -> tuple[TimeArray, NDArray[np.object_] | None]:
        """Convert strictly increasing times (T,) and their labels.

        Raises
        ------
        ConfigError
            ISO times would be scaled, a converted time is too large, two converted times are equal,
            or the offset has a unit, and the times are plain numbers.
        """
        if not len(times) or (self.time_offset == 0 and self.time_scale == 1):
            return times, labels
        if clock != "number":
            moved = self._calendar(times, clock, name)
            texts = np.empty(len(moved), dtype=object)
            texts[:] = [iso(moment, clock) for moment in moved.tolist()]
            return moved, texts
        if isinstance(self.time_offset, Duration):
            unit = epoch_unit(times)
            named = f", or name it: {option('estimate_time_format', unit)}" if unit else ""
            remedy = f"give a number in their unit{named}"
            self.time_offset.check(clock, option("time_offset"), remedy)
        from decimal import (  # lazy: slow to import, and few times are converted
            Context,
            Decimal,
            Overflow,
        )

        exact = Context(prec=DIGITS_OF_SUMS, traps=[Overflow])
        factor, offset = Decimal(repr(self.time_scale)), Decimal(repr(self.time_offset))
        try:
            values = [exact.fma(Decimal(repr(time)), factor, offset) for time in times.tolist()]
        except Overflow:
            raise ConfigError(_beyond(name)) from None
        size = max(abs(values[0]), abs(values[-1]))
        whole = all(value == value.to_integral_value() for value in values)
        converted: TimeArray
        if whole and size < 2**63 and (times.dtype.kind == "i" or size >= EXACT_INTEGERS):
            converted = np.array([int(value) for value in values], np.int64)
        else:
            converted = np.array([float(value) for value in values]) + 0.0
        if not np.isfinite(converted[[0, -1]].astype(float)).all():
            raise ConfigError(_beyond(name))
        same = np.flatnonzero(converted[1:] <= converted[:-1])
        if len(same):
            k = int(same[0])
            raise ConfigError(
                f"{option('time_offset')}, {option('time_scale')}: the times {times[k]} and "
                f"{times[k + 1]} of {name} would become the same number, {converted[k]}, by "
                "rounding"
            )
        return converted, None

    def _times_undone(self, side: Trajectories) -> Trajectories:
        """Undo the conversion of times; converting again gives the same times, if possible."""
        if self.time_offset == 0 and self.time_scale == 1:
            return side
        if side.clock != "number":
            back = replace(self, time_offset=-self.time_offset)
            times, labels = back.times(side.times, side.clock, side.labels, "repaired")
            return replace(side, times=times, labels=labels)
        from decimal import Context, Decimal  # lazy: slow to import

        exact = Context(prec=DIGITS_OF_SUMS)
        factor, offset = Decimal(repr(self.time_scale)), Decimal(repr(self.time_offset))

        def before(time: float) -> float:
            quotient = exact.divide(exact.subtract(Decimal(repr(time)), offset), factor)
            near = float(quotient)
            whole = [int(quotient)] if abs(quotient) < 2**63 else []
            for one in (
                *whole,
                near,
                math.nextafter(near, -math.inf),
                math.nextafter(near, math.inf),
            ):
                moved = exact.fma(Decimal(repr(one)), factor, offset)
                if (moved if isinstance(time, int) else float(moved)) == time:
                    return one
            return near

        originals = [before(time) for time in side.times.tolist()]
        return replace(side, times=np.array(originals, None if originals else side.times.dtype))

    def undone(self, side: Trajectories) -> Trajectories:
        """Convert a side back to its own units, as exactly as doubles allow.

        Converting the result again gives the same side. An exception are values below about 1e-308,
        which a double stores with fewer digits.
        """
        before = self._times_undone(side)
        factors = self.factors(side.columns)
        if factors is None:
            return before
        if side.clouds is not None:
            return before.with_clouds(side.clouds.moved(_divided(side.clouds.points, factors)))
        spread = side.covariance
        if spread is not None:
            row, column = np.tril_indices(len(factors))
            spread = _divided(spread, factors[row] * factors[column])
        return replace(before, state=_divided(side.state, factors), covariance=spread)

    def _calendar(self, times: TimeArray, clock: str, name: str) -> TimeArray:
        if self.time_scale != 1:
            raise ConfigError(
                f"{option('time_scale')} is for times that are numbers; {name} has {CLOCKS[clock]}"
            )
        from decimal import Decimal  # lazy: slow to import

        by = int((Decimal(repr(self.time_offset)) * SECOND).to_integral_value())
        if not all(-(2**63) <= int(end) + by < 2**63 for end in (times[0], times[-1])):
            raise ConfigError(_beyond(name))
        return cast(TimeArray, times + np.int64(by))

    def factors(self, columns: tuple[str, ...]) -> Floats | None:
        """Return the factor of each state column; None if no column changes.

        Raises
        ------
        ConfigError
            `unit_scale` is given for latitude and longitude, or a column of `scale` does not exist.
        """
        own = dict(self.scale)
        unknown = [name for name in own if name not in columns]
        if unknown:
            raise ConfigError(
                f"{option(self.scale_option)}: {quoted(unknown[0])} is not a state column; state "
                f"columns: {','.join(columns)}; choose them with {option('columns')}"
            )
        if self.unit_scale == 1:
            return np.array([own.get(name, 1.0) for name in columns]) if own else None
        if any(column in PLACES for column in columns):
            raise ConfigError(
                f"{option('unit_scale')} is for lengths, and lat,lon are degrees; give a column a "
                f"factor with {option('estimate_scale', 'alt=0.3048')}"
            )
        angles = columns[1:] if columns[:2] == ("range", "bearing") else self.angles
        return np.array(
            [own.get(name, 1.0) * (1.0 if name in angles else self.unit_scale) for name in columns]
        )

    def __call__(self, side: Trajectories, name: str) -> Trajectories:
        """Convert times and states of a side; `name` is for messages."""
        times, labels = self.times(side.times, side.clock, side.labels, name)
        moved = side if times is side.times else replace(side, times=times, labels=labels)
        factors = self.factors(side.columns)
        if factors is None:
            return moved
        if side.clouds is not None:
            return moved.with_clouds(side.clouds.moved(scaled(side.clouds.points, factors, name)))
        covariance = side.covariance
        return replace(
            moved,
            state=scaled(side.state, factors, name),
            covariance=None if covariance is None else scaled_spread(covariance, factors, name),
        )


def scaled(state: Floats, factors: Floats, name: str) -> Floats:
    """Multiply each column of states (R, d) by its factor.

    Raises
    ------
    ConfigError
        A product is too large for a double.
    """
    with np.errstate(over="ignore"):
        product = state * factors
    if np.isinf(product).any():
        raise ConfigError(f"{name}: a state times its scale is too large for a number")
    return product


def _divided(values: Floats, factors: Floats) -> Floats:
    """Divide values by factors, so that the product with the factor is the value again if possible.

    If the product of the quotient differs from the value, the next smaller and the next larger
    double are tried.
    """
    ratio = values / factors
    for toward in (-np.inf, np.inf):
        other = np.nextafter(ratio, toward)
        ratio = np.where((ratio * factors != values) & (other * factors == values), other, ratio)
    return ratio


def scaled_spread(packed: Floats, factors: Floats, name: str) -> Floats:
    """Scale covariances (lower triangles, (R, d (d + 1) / 2)) by the factors of the states."""
    row, column = np.tril_indices(len(factors))
    with np.errstate(over="ignore"):
        squares = factors[row] * factors[column]
    return scaled(packed, squares, name)


def _beyond(name: str) -> str:
    return f"{option('time_offset')}, {option('time_scale')}: times of {name} become too large"


def iso(nanoseconds: int, clock: str) -> str:
    """Format a time as ISO-8601, with Z if it has a zone, with as many digits as it needs."""
    seconds, rest = divmod(nanoseconds, SECOND)
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)
    fraction = f".{rest:09d}".rstrip("0") if rest else ""
    return f"{moment:%Y-%m-%dT%H:%M:%S}{fraction}{'Z' if clock == 'zoned' else ''}"
