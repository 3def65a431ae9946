"""Fields of text files: which texts are numbers, columns that store each text once, and times."""

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
    """Convert texts to the nearest doubles; raise ValueError if a text is not a number."""
    joined = "".join(texts)
    if "_" in joined or not joined.isascii():  # float() accepts 1_000 and digits of any script
        raise ValueError
    if decimal == ",":
        if "." in joined:
            raise ValueError
        texts = [text.replace(",", ".") for text in texts]
    return np.array(list(map(float, texts)), dtype=np.float64)


def is_number(text: str, decimal: str = ".") -> bool:
    """Return whether a text is a number, with this decimal mark if it has one."""
    if "_" in text or not text.isascii() or (decimal == "," and "." in text):  # see `floats`
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
        Index in `distinct` of the text of each row.
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
    """Convert a column to numbers, NaN where blank; keep all texts if some are not numbers."""
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
"""Number below which every integer is a double."""

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, kw_only=True, eq=False)
class Times:
    """Times of all rows.

    Parameters
    ----------
    value : (R,) int64 or float64 array
        Time of each row: a number as given, or nanoseconds since 1970.
    clock : {"number", "local", "zoned"}
        Kind of the times: numbers, ISO times without a zone, or ISO times with a zone.
    text : list of str, optional
        Texts of ISO times; None for numbers.
    """

    value: TimeArray
    clock: str
    text: Sequence[str] | None


class Form(Protocol):
    """Interface of `formats.clocks.TimeForm`, the way in which times are written."""

    @property
    def format(self) -> str:
        """Format of the times; blank for numbers and ISO times."""

    def read(self, column: Coded) -> Times | None:
        """Read the times of a column by the format; return None if there is no format."""

    def zoned(self, times: Times) -> Times:
        """Convert times without a zone to UTC, if the user gave their zone."""


class RowError(ValueError):
    """Error in row `row`; the message says what is wrong and how to correct it."""

    def __init__(self, row: int, message: str) -> None:
        super().__init__(message)
        self.row = row


class TimeError(RowError):
    """Error about a value that is not a valid time."""


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
        A text is blank, infinite or not a time. Or it is of another kind than the first text, or an
        integer that a double cannot represent.
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
    return Times(value=value + 0.0, clock="number", text=None)  # -0.0 + 0.0 is 0.0


def coded_times(column: Coded, decimal: str) -> Times:
    """Parse the times of a column; each distinct text is parsed once.

    Raises
    ------
    TimeError
        A time is wrong, see `parse_times`; the error is about the first wrong row.
    """

    def to_floats(texts: Sequence[str]) -> Floats:
        return floats(texts, decimal)

    try:
        times = parse_times(column.distinct, to_floats)
    except TimeError:
        return parse_times(list(column), to_floats)  # this error names the row
    text = None if times.text is None else column
    return Times(value=times.value[column.code], clock=times.clock, text=text)


def read_times(
    column: Coded,
    decimal: str,
    form: Form | None = None,
    second: Coded | None = None,
    digits: int = 0,
) -> Times:
    """Read times from one column, or from two columns that are parts of one time.

    `form` is the format and zone of the times, if the user gave them. `second` is the second
    column. `digits` is the number of decimal places, if the second column has fractions of a second
    and its header says the unit. In other cases `digits` is 0.

    Raises
    ------
    TimeError
        A time is wrong, see `parse_times`, or a text does not fit the format.
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
    """Parse times such as 12 500: whole seconds, a blank, and their fraction as an integer.

    `digits` is the number of decimal places of the fraction, or 0 if it is not known. If the whole
    seconds are as large as seconds since 1970, the result has times in UTC. Return None if a text
    does not have this form.

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
    """Return, for each series of times, the ranks of its times among the times of all series.

    Equal times have the same rank. Numbers are compared exactly.

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
    """Parse ISO-8601 times; each distinct text is parsed once."""
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
            if with_unit := WITH_UNIT.fullmatch(text):
                remedy = unit_in_header(with_unit[1])
            remedy += f"; {remedy_for(text)}" if re.search(r",|[^\D0-9]", text) else ""
        raise TimeError(wrong[0], f"{what}{more(len(wrong))}; {remedy}")
    clock = known[texts[0]][1]
    for row, text in enumerate(texts):
        if known[text][1] != clock:
            raise TimeError(
                row, f"mixed kinds of time: {quoted(texts[0])} and {quoted(text)}; use one format"
            )
    value = np.array([known[text][0] for text in texts], np.int64)
    return Times(value=value, clock=clock, text=texts)


def _parse(text: str, to_floats: Callable[[Sequence[str]], Floats]) -> tuple[int, str]:
    """Return a time in nanoseconds since 1970, and the kind of the text.

    Kinds are ``local`` and ``zoned`` (see `Times`), ``number``, ``far`` for a time that does not
    fit 64 bits, and ``none`` for other texts. Only the first two have a time; others have 0.
    """
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
    """Return a remedy for a text that is a time of day, or a date such as 1/2/2020.

    The remedy has the formats that would read the text. It is blank for other texts.
    """
    if re.fullmatch(r"\d{1,2}:\d\d(:\d\d)?(\.\d+)?", text.strip()):
        shown = "%H:%M" + ":%S" * (text.count(":") == 2) + ".%f" * ("." in text)
        return (
            f"give the format '{shown}' with {option('truth_time_format')} or "
            f"{option('estimate_time_format')}"
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
"""Remedy for a text that should be a number, if no better remedy is known."""


WITH_UNIT = re.compile(r"\s*([-+]?[\d.]*\d)\s*([A-Za-z°µ]+)\s*")
THOUSANDS = re.compile(r"\s*[-+]?\d{1,3}([.,' \xa0\u202f])\d{3}(?:\1\d{3})*([.,]\d+)?\s*")
DEGREES = re.compile(r"\s*[NSEWnsew]?\s*[-+]?(\d{1,9}(\.\d+)?[°ºd:'′’\"″”\s]*){1,3}[NSEWnsew]?\s*")
"""Patterns of a number with its unit, with separators of thousands, and of degrees with minutes."""


def unit_in_header(number: str) -> str:
    """Return the remedy for a number with its unit."""
    return f"write the number alone, {number}, and the unit in the header"


def remedy_for(text: str) -> str:
    """Return a remedy for a text that is not a number."""
    with_words = WITH_UNIT.fullmatch(text)
    rewritten = text.strip().replace("−", "-").replace("_", "")
    rewritten = re.sub("(?<=[0-9.])[dD](?=[-+0-9])", "e", rewritten)
    if re.fullmatch("[-+]?0[xX][0-9a-fA-F]+", rewritten):
        rewritten = str(int(rewritten, 16))
    if rewritten != text.strip() and is_number(rewritten):
        return f"write {rewritten}"
    if THOUSANDS.fullmatch(text) and not re.fullmatch(r"\s*[-+]?\d+[.,]\d+\s*", text):
        return "write it without thousands separators"
    if re.search(r"[^\D0-9]", text):
        return "write the digits 0 to 9"
    if DEGREES.fullmatch(text) and re.search("[°ºNSEWnsew]|\\d .*\\d ", text):
        parts = map(float, re.findall(r"\d+\.?\d*", text))
        degrees = sum(part / 60**k for k, part in enumerate(parts))
        sign = "-" if re.search("[-SWsw]", text) else ""
        return f"write decimal degrees north and east, {sign}{degrees:.10g}"
    if with_words:
        return unit_in_header(with_words[1])
    if "," in text and text.count(",") == 1:
        return f"use a decimal point, or {option('decimal', ',')}"
    if "." in text or "," in text:
        return f"use one decimal mark ({option('decimal')}) and no thousands separator"
    return BLANK
