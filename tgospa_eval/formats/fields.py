"""Fields of text: the rule for numbers, columns that store each text once, and times."""

import re
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from typing import Protocol, overload

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import more
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.conversion import EARLIEST, LATEST, SECOND, iso
from tgospa_eval.tracks.trajectories import TimeArray, Values

MISSING = frozenset(
    (
        *("", "NaN", "nan", "-NaN", "-nan", "NA", "<NA>", "N/A", "n/a", "NULL", "null", "None"),
        *("#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "1.#IND", "1.#QNAN"),
    )
)
"""Texts that mean a missing number, as in pandas."""


def floats(texts: Sequence[str], decimal: str = ".") -> Floats:
    """Parse a column to exact doubles; raise ValueError unless every text is a number."""
    joined = "".join(texts)
    if "_" in joined or not joined.isascii():  # float() accepts 1_000 and digits of any script
        raise ValueError
    if decimal == ",":
        if "." in joined:
            raise ValueError
        texts = [text.replace(",", ".") for text in texts]
    return np.array(list(map(float, texts)), dtype=np.float64)


def is_number(text: str, decimal: str = ".") -> bool:
    """Return whether a text is a number with this decimal mark, or without a mark."""
    if "_" in text or not text.isascii() or (decimal == "," and "." in text):  # as in `floats`
        return False
    try:
        float(text.replace(decimal, "."))
    except ValueError:
        return False
    return True


@dataclass(frozen=True, eq=False)
class Coded(Sequence[str]):
    """Column of texts that stores each distinct text once.

    Parameters
    ----------
    distinct : list of str
        Distinct texts in the order of first appearance.
    code : (R,) int array
        Position in `distinct` of the text of each row.
    """

    distinct: list[str]
    code: Ints

    def __len__(self) -> int:
        return len(self.code)

    @overload
    def __getitem__(self, row: int) -> str: ...
    @overload
    def __getitem__(self, row: slice) -> list[str]: ...
    def __getitem__(self, row: int | slice) -> str | list[str]:
        if isinstance(row, slice):
            return [self.distinct[code] for code in self.code[row].tolist()]
        return self.distinct[int(self.code[row])]

    def __iter__(self) -> Iterator[str]:
        return map(self.distinct.__getitem__, self.code.tolist())


def joined_texts(first: Coded, second: Coded) -> Coded:
    """Join the texts of two columns, with a blank between them."""
    width = max(len(second.distinct), 1)
    pair, code = np.unique(first.code.astype(np.int64) * width + second.code, return_inverse=True)
    texts = [
        f"{first.distinct[a].strip()} {second.distinct[b].strip()}"
        for a, b in zip(*(part.tolist() for part in np.divmod(pair, width)), strict=True)
    ]
    return Coded(texts, code)


def attribute_of(column: Coded, decimal: str = ".") -> Values:
    """Convert a column to numbers, NaN where blank; keep the texts if some are not numbers."""
    texts = [text.strip() for text in column.distinct]
    try:
        numbers = ["nan" if text in MISSING else text for text in texts]
        return floats(numbers, decimal)[column.code]
    except ValueError:
        table = np.empty(len(texts), dtype=object)
        table[:] = texts
        return np.asarray(table[column.code])


ISO = r"(.*\d\d:?\d\d:?\d\d)[.,](\d+)(.*)"
EXACT_BELOW = 2.0**53
"""Bound below which every integer is a double."""

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, kw_only=True, eq=False)
class Times:
    """Times of all rows.

    Parameters
    ----------
    value : (R,) int64 or float64 array
        Numbers as given, or nanoseconds since 1970.
    clock : {"number", "local", "zoned"}
        Kind of time.
    text : list of str, optional
        Texts of the times, unless they are numbers.
    """

    value: TimeArray
    clock: str
    text: Sequence[str] | None


class Form(Protocol):
    """Interface of `formats.clocks.TimeForm`: how times are written."""

    @property
    def format(self) -> str:
        """Format of the times; blank for numbers and ISO times."""

    def read(self, column: Coded) -> Times | None:
        """Read the times of a column by the format; return None if there is no format."""

    def zoned(self, times: Times) -> Times:
        """Convert times without zone to UTC, if a zone is given."""


class RowError(ValueError):
    """Error in row `row`; the message says what is wrong and what is right."""

    def __init__(self, row: int, message: str) -> None:
        super().__init__(message)
        self.row = row


class TimeError(RowError):
    """Error that a value is not a valid time."""


def parse_times(texts: Sequence[str], to_floats: Callable[[Sequence[str]], Floats]) -> Times:
    """Parse all times of a column; they must be of one kind.

    Parameters
    ----------
    texts : sequence of str
        Texts of the column.
    to_floats : callable
        Callable that converts the whole column to floats or raises ValueError.

    Raises
    ------
    TimeError
        A row is blank, not a time, infinite, or of another kind than the first row.
    """
    joined = "".join(texts)
    if joined.isascii() and "_" not in joined:
        try:
            return Times(value=np.array(list(map(int, texts)), np.int64), clock="number", text=None)
        except (ValueError, OverflowError):
            pass
    try:
        value = to_floats(texts)
    except ValueError:
        return _iso(texts, to_floats)
    odd = np.flatnonzero(~np.isfinite(value))
    if len(odd):
        text = texts[odd[0]]
        what = f"not a finite time: {quoted(text)}" if text.strip() else "blank time"
        raise TimeError(int(odd[0]), f"{what}{more(len(odd))}; write a number")
    for row in np.flatnonzero(np.abs(value) >= EXACT_BELOW).tolist():
        if texts[row].strip().lstrip("+-").isdigit():
            raise TimeError(
                row,
                f"the integer {quoted(texts[row])} cannot be compared exactly with decimal or "
                "larger times; write all times as 64-bit integers",
            )
    return Times(value=value + 0.0, clock="number", text=None)  # + 0.0 makes -0.0 the same step


def coded_times(column: Coded, decimal: str) -> Times:
    """Parse the times of a column, each distinct text once.

    Raises
    ------
    TimeError
        An error of `parse_times`, about the first wrong row.
    """

    def to_floats(texts: Sequence[str]) -> Floats:
        return floats(texts, decimal)

    try:
        times = parse_times(column.distinct, to_floats)
    except TimeError:
        return parse_times(list(column), to_floats)  # its error has the row and the number of rows
    text = None if times.text is None else column
    return Times(value=times.value[column.code], clock=times.clock, text=text)


def read_times(
    column: Coded,
    decimal: str,
    form: Form | None = None,
    second: Coded | None = None,
    digits: int = 0,
) -> Times:
    """Read the times of a column, or of two columns that are one timestamp, by a form if given.

    `digits` is the number of decimal places of a second that the second column has by its header.

    Raises
    ------
    TimeError
        An error of `parse_times`, or a text does not fit the form.
    """
    if second is not None:
        column = joined_texts(column, second)
        joined = None if form and form.format not in ("", "s") else _of_fractions(column, digits)
        if joined is not None:
            return joined
    if form is None:
        return coded_times(column, decimal)
    return form.zoned(form.read(column) or coded_times(column, decimal))


def _of_fractions(column: Coded, digits: int) -> Times | None:
    """Parse times of whole seconds, a blank and an integer fraction; return None for other texts.

    Numbers whose size suggests seconds since 1970 are times in UTC.

    Raises
    ------
    TimeError
        The unit of the fraction is unknown, or a fraction is a second or more.
    """
    parts = [text.partition(" ")[::2] for text in column.distinct]
    if not parts or not all(re.fullmatch("[0-9]{1,18}", text) for pair in parts for text in pair):
        return None
    pairs = [(int(a), int(b)) for a, b in parts]
    is_epoch = all(EARLIEST <= whole < LATEST for whole, _ in pairs)
    largest = max(fraction for _, fraction in pairs)
    if not digits and is_epoch and largest >= 10**6:
        digits = 9
    if not digits or largest >= 10**digits:
        row = int(np.argmax(column.code == [part for _, part in pairs].index(largest)))
        raise TimeError(
            row,
            f"{quoted(column[row])} is not a second and its fraction; name the column of the "
            f"fraction nsec, usec or msec, or give the format, {option('truth_time_format')} or "
            f"{option('estimate_time_format')}",
        )
    if is_epoch:
        exact = [whole * SECOND + part * 10 ** (9 - digits) for whole, part in pairs]
        texts = Coded([iso(moment, "zoned") for moment in exact], column.code)
        return Times(value=np.array(exact, np.int64)[column.code], clock="zoned", text=texts)
    seconds = np.array([float(f"{whole}.{part:0{digits}}") for whole, part in pairs])
    return Times(value=seconds[column.code], clock="number", text=None)


def places(series: Sequence[Sequence[int | float | str]]) -> list[NDArray[np.int64]]:
    """Return the rank of each time of each series among all times, exact for all numbers.

    Parameters
    ----------
    series : sequence of sequence of int, float or str
        Times as they were read: numbers, or texts that are ISO-8601 times.

    Raises
    ------
    TimeError
        A text is not a time, or times are of several kinds.
    """
    times = [t for own in series for t in own]
    texts = [t for t in times if isinstance(t, str)]
    keys: list[int | float] = [t for t in times if not isinstance(t, str)]
    if texts:
        if keys:
            examples = f"{quoted(str(keys[0]))} and {quoted(texts[0])}"
            raise TimeError(0, f"mixed kinds of time: {examples}; write all in one format")
        keys = parse_times(texts, floats).value.tolist()
    rank = {key: k for k, key in enumerate(sorted(set(keys)))}
    ranks = np.array([rank[key] for key in keys], np.int64)
    return np.split(ranks, np.cumsum([len(own) for own in series])[:-1])


def _iso(texts: Sequence[str], to_floats: Callable[[Sequence[str]], Floats]) -> Times:
    """Parse ISO-8601 times, each distinct text once."""
    known = {text: _parse(text, to_floats) for text in dict.fromkeys(texts)}
    for fault in ("none", "far"):
        wrong = [row for row, text in enumerate(texts) if known[text][1] == fault]
        if not wrong:
            continue
        text = texts[wrong[0]]
        if fault == "far":
            what = f"a time beyond 64-bit nanoseconds: {quoted(text)}"
            remedy = "write times from 1677-09-22 to 2262-04-11, or numbers"
        else:
            what = f"not a time: {quoted(text)}" if text.strip() else "blank time"
            remedy = reading_of(text) or "write a number or an ISO-8601 time"
            if re.fullmatch(r"\s*[-+]?[\d.]+\s*[A-Za-z]+\s*", text):
                remedy = remedy_for(text)
            remedy += f"; {remedy_for(text)}" if "," in text else ""
        raise TimeError(wrong[0], f"{what}{more(len(wrong))}; {remedy}")
    clock = known[texts[0]][1]
    for row, text in enumerate(texts):
        if known[text][1] != clock:
            raise TimeError(
                row, f"mixed kinds of time: {quoted(texts[0])} and {quoted(text)}; write all alike"
            )
    value = np.array([known[text][0] for text in texts], np.int64)
    return Times(value=value, clock=clock, text=texts)


def _parse(text: str, to_floats: Callable[[Sequence[str]], Floats]) -> tuple[int, str]:
    """Parse one text to nanoseconds and its kind of clock."""
    try:
        to_floats([text])
    except ValueError:
        pass
    else:
        return 0, "number" if text.strip() else "none"
    # datetime stores only microseconds, so the digits of the fraction are parsed here.
    match = re.fullmatch(ISO, text.strip())
    plain, fraction = (match[1] + match[3], match[2]) if match else (text.strip(), "")
    if fraction[9:].strip("0"):
        return 0, "none"
    try:
        moment = datetime.fromisoformat(plain)
    except ValueError:
        return 0, "none"
    clock = "local" if moment.tzinfo is None else "zoned"
    since = (moment.replace(tzinfo=UTC) if clock == "local" else moment) - EPOCH
    seconds = since.days * 86_400 + since.seconds
    nanoseconds = seconds * 1_000_000_000 + since.microseconds * 1000
    nanoseconds += int(fraction[:9].ljust(9, "0"))
    if not -(2**63) <= nanoseconds < 2**63:
        return 0, "far"
    return nanoseconds, clock


DATE = re.compile(r"(\d{1,2})([/.-])(\d{1,2})[/.-](\d{4})(?:[ T](\d{1,2}:\d{2})(:\d{2}(\.\d+)?)?)?")


def reading_of(text: str) -> str:
    """Return a remedy with the formats that read an ambiguous date or a time of day, or a blank."""
    if re.fullmatch(r"\d{1,2}:\d\d(:\d\d)?(\.\d+)?", text.strip()):
        shown = "%H:%M" + ":%S" * (text.count(":") == 2) + ".%f" * ("." in text)
        return (
            f"'{shown}' with {option('truth_time_format')} or {option('estimate_time_format')} "
            "reads times of day"
        )
    date = DATE.fullmatch(text.strip())
    if date is None:
        return ""
    first, mark, second, year = int(date[1]), date[2], int(date[3]), date[4]
    clock = f" %H:%M{':%S' if date[6] else ''}{'.%f' if date[7] else ''}" if date[5] else ""
    ways = []
    for order, day, month in (("%d{0}%m{0}%Y", first, second), ("%m{0}%d{0}%Y", second, first)):
        if 1 <= month <= 12 and 1 <= day <= 31:
            shown = order.format(mark) + clock
            ways.append(f"'{shown}' reads {year}-{month:02d}-{day:02d}")
    if not ways:
        return ""
    return (
        f"choose with {option('truth_time_format')} or {option('estimate_time_format')}: "
        f"{', '.join(ways)}"
    )


def is_rounded(text: str) -> bool:
    """Return whether a text is a number with fewer digits than its exponent, such as 2.19E+08."""
    digits = re.fullmatch(r"-?\d(?:[.,](\d*))?[eE]\+(\d+)", text)
    return digits is not None and len(digits[1] or "") < int(digits[2])


BLANK = "leave it blank where the object is absent"
"""Remedy for a number without a better one."""


def remedy_for(text: str) -> str:
    """Return a remedy for a text that is not a number."""
    with_words = re.fullmatch(r"\s*([-+]?[\d.]+)\s*([A-Za-z°µ]+)\s*", text)
    if with_words and with_words[2] in "NSEWnsew":
        sign = "-" if with_words[2] in "SWsw" else ""
        return f"write degrees north and east, {sign}{with_words[1]}"
    if with_words:
        return f"write the number alone, {with_words[1]}, and the unit in the header"
    if "," in text:
        return f"use a decimal point, or {option('decimal', ',')}"
    if "." in text:
        return f"use one decimal mark ({option('decimal')}) and no thousands separator"
    return BLANK
