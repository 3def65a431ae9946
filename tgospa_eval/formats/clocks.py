"""Conversion of formatted times, epochs, GPS weeks and time zones to nanoseconds since 1970."""

from dataclasses import replace
from decimal import Decimal, InvalidOperation
from typing import cast

import numpy as np

from tgospa_eval.common.arrays import Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import more, plain
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.fields import Coded, TimeError, Times
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.conversion import EPOCHS, SECOND, TIME_UNITS, epoch_unit, iso
from tgospa_eval.tracks.trajectories import TimeArray, Trajectories

GPS = "gps"

GPS_EPOCH = 315_964_800
"""1980-01-06 in seconds since 1970."""

DAY, WEEK = 86_400, 604_800

NO_DATE = -25_567 * DAY * SECOND
"""1900-01-01, the date of times that were read without a date, in nanoseconds since 1970."""

LEAPS = (
    *(46_828_800, 78_364_801, 109_900_802, 173_059_203, 252_028_804, 315_187_205, 346_723_206),
    *(393_984_007, 425_520_008, 457_056_009, 504_489_610, 551_750_411, 599_184_012, 820_108_813),
    *(914_803_214, 1_025_136_015, 1_119_744_016, 1_167_264_017),
)
"""Leap seconds from 1981-07-01 to 2017-01-01 (IERS), in seconds of GPS.

Each sets UTC back by 1 s."""


@dataclass(frozen=True, kw_only=True)
class TimeForm:
    """Format, time zone and epoch of the times of the truth or the estimate.

    Parameters
    ----------
    format : str
        A format of ``strptime``; ``s``, ``ms``, ``us`` or ``ns`` since 1970; ``gps`` for weeks and
        seconds of GPS. Blank means numbers or ISO times.
    zone : str
        Time zone of times without a zone, such as ``Europe/Copenhagen``; blank means unknown.
    role : str
        Role of the file with these times, ``truth`` or ``estimate``, for messages.

    Raises
    ------
    ConfigError
        The format or the time zone is unknown.
    """

    format: str = ""
    zone: str = ""
    role: str = "truth"

    def __post_init__(self) -> None:
        shown = f"{option(f'{self.role}_time_format')} {quoted(self.format)}"
        if self.format and "%" not in self.format and self.format not in (*EPOCHS, GPS):
            raise ConfigError(
                f"{shown}: must be a format such as '%d/%m/%Y %H:%M:%S', {', '.join(EPOCHS)} "
                f"since 1970, or {GPS} for weeks and seconds"
            )
        if self.zone:
            from zoneinfo import ZoneInfo, ZoneInfoNotFoundError  # lazy: slow to import

            try:
                ZoneInfo(self.zone)
            except (ZoneInfoNotFoundError, ValueError, OSError):
                raise ConfigError(
                    f"{option(f'{self.role}_time_zone')} {quoted(self.zone)}: unknown time zone; "
                    "write UTC, or one such as Europe/Copenhagen"
                ) from None

    def read(self, column: Coded) -> Times | None:
        """Read the times of a column by the format; return None if there is no format.

        Raises
        ------
        TimeError
            A text does not fit the format.
        """
        if not self.format:
            return None
        if "%" in self.format:
            return self._formatted(column)
        parse = _gps if self.format == GPS else self._since_1970
        nanoseconds, wrong = [], None
        for code, text in enumerate(column.distinct):
            try:
                nanoseconds.append(parse(text))
            except (ValueError, InvalidOperation, OverflowError):
                wrong = code if wrong is None else wrong
                nanoseconds.append(0)
        if wrong is not None:
            raise self._misfit(column, np.isin(column.code, wrong))
        return _in_utc(column.code, np.array(nanoseconds, np.int64))

    def _since_1970(self, text: str) -> int:
        exact = Decimal(text.strip()) * TIME_UNITS[self.format]
        if not exact.is_finite() or not -(2**63) <= exact < 2**63:
            raise ValueError
        return int(exact.to_integral_value())

    def _formatted(self, column: Coded) -> Times:
        import pandas as pd  # lazy: most times are numbers or ISO

        try:
            parsed = pd.to_datetime(
                pd.Series(column.distinct, dtype=object).str.strip(),
                format=self.format,
                errors="coerce",
                utc="%z" in self.format,
            )
        except ValueError as error:
            raise ConfigError(
                f"{option(f'{self.role}_time_format')} {quoted(self.format)}: {error}"
            ) from None
        missing = parsed.isna().to_numpy()
        if missing.any():
            raise self._misfit(column, missing[column.code])
        value = parsed.to_numpy("datetime64[ns]").astype(np.int64)
        if "%z" in self.format:
            return _in_utc(column.code, value)
        return _in_words(column.code, value, "local")

    def _misfit(
        self, column: Coded, wrong: "np.ndarray[tuple[int], np.dtype[np.bool_]]"
    ) -> TimeError:
        row = int(np.argmax(wrong))
        return TimeError(
            row,
            f"{quoted(column[row])} does not fit {option(f'{self.role}_time_format')} "
            f"{quoted(self.format)}{more(int(np.count_nonzero(wrong)))}"
            + "; write week and seconds, such as 2295 86418"
            * (self.format == GPS),
        )

    def zoned(self, times: Times) -> Times:
        """Convert times without a zone to UTC, if the user gave their zone.

        Raises
        ------
        TimeError
            A time occurs twice or never in the zone, as daylight saving begins or ends.
        """
        if not self.zone or times.clock != "local":
            return times
        import pandas as pd  # lazy: few sides have a time zone

        value, code = np.unique(times.value, return_inverse=True)
        local = pd.Series(value.astype("datetime64[ns]"))
        known = local.dt.tz_localize(self.zone, ambiguous="NaT", nonexistent="NaT")
        missing = known.isna().to_numpy()
        if missing.any():
            row = int(np.argmax(missing[code]))
            text = iso(int(times.value[row]), "local")
            raise TimeError(
                row,
                f"{text} is ambiguous or missing in {self.zone}, as daylight saving ends or begins"
                f"{more(int(np.count_nonzero(missing[code])))}; write UTC, or times with a zone",
            )
        utc = known.dt.tz_convert("UTC").dt.tz_localize(None)
        return _in_utc(code, utc.to_numpy("datetime64[ns]").astype(np.int64))


def _gps(text: str) -> int:
    """Convert a GPS week and its seconds, separated by a blank, to nanoseconds in UTC."""
    week, seconds = text.split()
    exact = Decimal(week) * WEEK + Decimal(seconds)
    if not exact.is_finite() or not 0 <= exact < 2**33 or not 0 <= Decimal(seconds) <= WEEK:
        raise ValueError
    behind = sum(exact >= leap for leap in LEAPS)
    return int(((exact + GPS_EPOCH - behind) * SECOND).to_integral_value())


def _in_utc(code: Ints, value: Ints) -> Times:
    return _in_words(code, value, "zoned")


def _in_words(code: Ints, value: Ints, clock: str) -> Times:
    """Return times with their ISO texts.

    `value` has the distinct times. The time of row r is `value[code[r]]`.
    """
    texts = Coded([iso(moment, clock) for moment in value.tolist()], code)
    return Times(value=cast(TimeArray, value[code]), clock=clock, text=texts)


def carried(times: Times, begins: float, name: str) -> Times:
    """Move times of day before `begins` to the next day, for recordings that go over midnight.

    Parameters
    ----------
    times : Times
        Times of day.
    begins : float
        Earliest time of day of the first day, in the unit of the times; in seconds if they are
        texts.
    name : str
        Beginning of messages.

    Raises
    ------
    InputError
        The times are not all within one day.
    """
    unit = 1 if times.clock == "number" else SECOND
    day = _day_of(begins * unit) if unit == 1 else DAY * SECOND
    value = times.value
    if not len(value):
        return times
    first = 0 if unit == 1 else int(value.min()) // day * day
    if value.min() < first or value.max() >= first + day:
        raise InputError(
            f"{name}: {option('day_begins', plain(begins))} is for times of day, below "
            f"{day // unit:,}, but some times are larger; leave it out if times have dates"
        )
    later = np.where(value - first < begins * unit, value + np.asarray(day, value.dtype), value)
    if unit == 1:
        return replace(times, value=cast(TimeArray, later))
    distinct, code = np.unique(later, return_inverse=True)
    return _in_words(code, distinct, times.clock)


def over_midnight(times: Times, timestamps: TimeArray, track: Ints) -> tuple[int, str] | None:
    """Return the first row that seems to begin a new day, with a remedy.

    Such a row is more than half a day earlier than the previous row of its track in the file. The
    result is None in three cases: there is no such row; the times are not times of day; or a row is
    more than half a day later than the previous row of its track. In the last case the rows are
    probably not sorted by time.

    Parameters
    ----------
    times : Times
        Times of all rows.
    timestamps : array
        Distinct times in order.
    track : (R,) int array
        Index of the track of each row.
    """
    ends = timestamps[0].item(), timestamps[-1].item()
    unit = 1 if times.clock == "number" else SECOND
    first = 0 if unit == 1 else NO_DATE
    day = _day_of(float(ends[1])) if unit == 1 else DAY * SECOND
    if ends[0] < first or ends[1] >= first + day or ends[1] - ends[0] <= day / 2:
        return None
    order = np.argsort(track, kind="stable")
    step, same = np.diff(times.value[order]), np.diff(track[order]) == 0
    back = order[1:][same & (step < -day / 2)]
    if not len(back) or (same & (step > day / 2)).any():
        return None
    if len(np.unique(track[back])) < len(back):
        return int(back.min()), "write the times with dates"
    gap = int(np.argmax(np.diff(timestamps)))
    low, high = ((float(timestamps[gap + k]) - first) / unit for k in (0, 1))
    noon = day / unit / 2
    at = noon if low < noon <= high else round((low + high) / 2)
    way = f"{option('day_begins', plain(float(at)))} puts earlier times on the next day"
    return int(back.min()), way if low < at <= high else "write the times with dates"


CALENDAR = {8: "%Y%m%d", 12: "%Y%m%d%H%M", 14: "%Y%m%d%H%M%S", 17: "%Y%m%d%H%M%S%f"}
"""Format of a date that is written as one number, by its number of digits."""


def calendar_format(timestamps: TimeArray) -> str:
    """Return the format of numbers that look like dates, such as 20260301120058.

    Ten numbers or more, such as 120058, look like times of day in two or more minutes if the
    intervals between these times of day have fewer distinct lengths than the differences of the
    numbers. Numbers below 10000 do not: they are frames or seconds. The result is blank if a number
    is neither a date nor a time of day. It is ``"?"`` in two cases: some of the numbers have
    fractions and others are integers; or a time of day is before 10:00 and lacks a leading zero.
    """
    if len(timestamps) < 2 or timestamps[0] < 0 or not timestamps[-1] < 2.2e16:
        return ""
    if timestamps[-1] < 240_000:
        seconds, minutes = timestamps % 100, timestamps // 100 % 100
        crossed = timestamps[-1] // 100 - timestamps[0] // 100
        if max(seconds.max(), minutes.max()) >= 60 or crossed < 2 or len(timestamps) < 10:
            return ""
        time_of_day = timestamps // 10_000 * 3600 + minutes * 60 + seconds
        if _distinct_lengths(time_of_day) >= _distinct_lengths(timestamps):
            return ""
        form = "%H%M%S" if timestamps[0] >= 100_000 else "?"
    elif timestamps[0] <= 1.9e7:
        return ""
    else:
        texts = timestamps.astype(np.int64).astype(str)
        form = CALENDAR.get(len(texts[0]), "")
        if not form or len(texts[-1]) != len(texts[0]) or not "19" <= texts[0][:2] <= "21":
            return ""
        import pandas as pd  # lazy: few times have so many digits

        if pd.to_datetime(pd.Series(texts), format=form, errors="coerce").isna().any():
            return ""
    is_whole = timestamps % 1 == 0
    form = "?" if is_whole.any() and not is_whole.all() else form
    return form + ".%f" * (timestamps.dtype.kind == "f" and form != "?")


def _distinct_lengths(times: TimeArray) -> int:
    """Return the number of distinct intervals between successive times, up to rounding."""
    return len({*np.diff(times).round(6).tolist()})  # `np.unique` imports numpy.ma


def _day_of(time: float) -> int:
    """Return the length of a day in the likely unit of a time of day: s, ms, us or ns."""
    return next((DAY * 10**k for k in (0, 3, 6) if time < DAY * 10**k), DAY * SECOND)


def since_1970(side: Trajectories) -> tuple[Trajectories, str]:
    """Read numeric times as times since 1970, in the unit that their size suggests.

    Return the trajectories `side` with the new times, and the unit. If no unit fits, or the numbers
    look like dates, `side` is unchanged, and the unit is blank.
    """
    unit = epoch_unit(side.times)
    if not unit or calendar_format(side.times):
        return side, ""
    exact = [int(Decimal(str(time)) * TIME_UNITS[unit]) for time in side.times.tolist()]
    value = np.array(exact, np.int64)
    labels = np.empty(len(value), dtype=object)
    labels[:] = [iso(moment, "zoned") for moment in value.tolist()]
    return replace(side, times=value, clock="zoned", labels=labels), unit
