"""Options of reading a file and of selecting its rows, for all formats.

An example of a filter is ``score >= 0.5 and type != van``. Filters are parsed, and never executed
as code.
"""

import math
import operator
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import field, replace
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.arrays import Floats, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import more, parsed, parsed_whole
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.fields import TimeError, floats, is_number, parse_times
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.conversion import Conversion, Duration, Steps
from tgospa_eval.tracks.trajectories import CLOCKS, TimeArray

if TYPE_CHECKING:
    from tgospa_eval.formats.clocks import TimeForm
    from tgospa_eval.tracks.trajectories import Values


ITEM = r"""("[^"]*"|'[^']*'|[^\s"'<>=!]+)"""
ONE = re.compile(rf"\s*{ITEM}\s*([<>]=?|[!=]=)\s*{ITEM}\s*(?:\Z|(and)(?=\s))", re.IGNORECASE)
"""Pattern of one comparison, with the ``and`` behind it if another comparison follows."""

COMPARED: dict[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


Comparison = tuple[str, str, int | float | str]
"""Column, sign of comparison (a key of `COMPARED`), and value with which the column is compared.

The column is a header, or the name of a role such as ``id``. The value is a text if it was in
quotes or is not a number."""


def _fulfils(comparison: Comparison, values: "Values", at: Callable[[int], str], way: str) -> Mask:
    """Return a mask of the rows that fulfil a comparison.

    A blank fulfils no comparison with a number. In a comparison with a text, a blank counts as an
    empty text. `at` returns the place of a row, and `way` is the option, both for messages.

    Raises
    ------
    InputError
        A column of numbers is compared with a text that is not a number. Or a column is compared
        with a number, and has a text that is not a number.
    """
    column, mark, value = comparison
    compare = COMPARED[mark]
    if isinstance(value, str) and values.dtype != object:
        filled = np.flatnonzero(~np.isnan(values))
        number = parsed(value)
        if len(filled) and value and number is None:
            raise InputError(
                f"{at(int(filled[0]))}, column {quoted(column)}: "
                f"{values[filled[0]]:g} is a number, and {way} compares with a text; "
                "compare with a number"
            )
        if number is None:  # all values of the column are blank, or the text is blank
            return np.asarray(np.isnan(values) == ((mark == "==") == (value == "")))
        return np.asarray(compare(values, number))
    if isinstance(value, str):
        return np.asarray(compare(values, value), bool)
    if values.dtype == object:
        numbers = {text: parsed(str(text)) for text in dict.fromkeys(values.tolist())}
        wrong = [text for text, number in numbers.items() if number is None and text]
        if wrong:
            rows = np.flatnonzero(np.isin(values, wrong))
            remedy = f"leave it blank, or compare texts, {column} == '{value}'"
            if all(is_number(text, ",") for text in wrong):
                remedy = f"write decimal points, or use {option('decimal', ',')} for all numbers"
            raise InputError(
                f"{at(int(rows[0]))}, column {quoted(column)}: {quoted(wrong[0])} is not a "
                f"number as in {way}{more(len(rows))}; {remedy}"
            )
        values = np.array([numbers[text] for text in values.tolist()], float)
    return np.asarray(compare(values, value) & ~np.isnan(values))


@dataclass(frozen=True, kw_only=True)
class Where:
    """A filter: a row passes if it fulfils all comparisons.

    Parameters
    ----------
    option : str
        Option of the filter, such as ``--estimate-where``.
    text : str
        Filter as it was given.
    comparisons : tuple of Comparison
        The comparisons that the text means.
    """

    option: str
    text: str
    comparisons: tuple[Comparison, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns that the filter compares."""
        return tuple(column for column, _, _ in self.comparisons)

    def inside(self, values: Mapping[str, "Values"], at: Callable[[int], str]) -> Mask:
        """Return a mask of the rows that pass the filter.

        `values` has the values of each column; `at` returns the place of a row, for messages.
        """
        way = f"{self.option} {quoted(self.text)}"
        masks = (_fulfils(one, values[one[0]], at, way) for one in self.comparisons)
        return np.asarray(np.logical_and.reduce(list(masks)), bool)


def parse_where(texts: str | Iterable[str], keyword: str) -> tuple[Where, ...]:
    """Parse the filters of an option that can be given several times.

    Raises
    ------
    ConfigError
        A filter cannot be understood.
    """
    each = (texts,) if isinstance(texts, str) else texts
    return tuple(
        Where(option=keyword, text=text, comparisons=_parsed(text, keyword)) for text in each
    )


def _parsed(text: str, keyword: str) -> tuple[Comparison, ...]:
    comparisons: list[Comparison] = []
    end, is_joined = 0, True
    while is_joined:
        match = ONE.match(text, end)
        if match is None:
            raise ConfigError(
                f"{keyword} {quoted(text)}: must be COLUMN >= NUMBER or COLUMN == TEXT, with ==, "
                "!=, <, <=, > or >=; join several by and, and put names with blanks in quotes, "
                "'a b' >= 1"
            )
        (column, given), mark = (_unquoted(match[k]) for k in (1, 3)), match[2]
        whole = parsed_whole(match[3])
        number = parsed(match[3]) if whole is None else whole
        value = given if number is None else number
        if isinstance(value, str) and mark not in ("==", "!="):
            raise ConfigError(
                f"{keyword} {quoted(text)}: {quoted(value)} is not a number, and texts are "
                f"compared only by == and !=; {option('time')} is for ranges of times"
            )
        comparisons.append((column, mark, value))
        end, is_joined = match.end(), bool(match[4])
    return tuple(comparisons)


def _unquoted(text: str) -> str:
    return text[1:-1] if text[0] in "\"'" else text


@dataclass(frozen=True, kw_only=True)
class TimeRange:
    """A range of time, ends included.

    Parameters
    ----------
    low, high : int, float or None
        Ends as numbers, or as nanoseconds since 1970; None means no limit.
    clock : {"number", "local", "zoned"}
        Kind of the ends: numbers, ISO times without a zone, or ISO times with a zone.
    text : str
        Range as it was given.
    """

    low: int | float | None
    high: int | float | None
    clock: str
    text: str

    def inside(self, times: TimeArray, clock: str, where: str) -> Mask:
        """Return a mask of the times that are in the range; integers are compared exactly.

        Raises
        ------
        ConfigError
            The times are of another kind than the range.
        """
        if clock != self.clock and len(times):
            raise ConfigError(
                f"{option('time', self.text)}: {CLOCKS[self.clock]}, but {where} has "
                f"{CLOCKS[clock]}; write the range like these times"
            )
        keep = np.ones(len(times), bool)
        for end, is_low in ((self.low, True), (self.high, False)):
            if end is not None:
                if times.dtype.kind == "i":
                    end = math.ceil(end) if is_low else math.floor(end)
                keep &= times >= end if is_low else times <= end
        return keep


def parse_time_range(text: str | None) -> TimeRange | None:
    """Parse a range ``A:B`` of numbers or ISO times.

    ISO times contain colons, too. So the text is split at the colon for which both halves are
    numbers or ISO times.

    Raises
    ------
    ConfigError
        The text is not a range, its ends are of two kinds (such as a number and an ISO time), or it
        ends before it begins.
    """
    if text is None:
        return None
    ranges = []
    for halves in _splits(text, 2):
        with suppress(TimeError):
            times = parse_times([half for half in halves if half] or [""], floats)
            ends = iter(times.value.tolist())
            low, high = (next(ends) if half else None for half in halves)
            ranges.append(TimeRange(low=low, high=high, clock=times.clock, text=text))
    if len(ranges) != 1:
        raise ConfigError(
            f"{option('time')} {quoted(text)}: must be A:B, two numbers or two ISO times, of "
            "which one may be blank"
        )
    low, high = ranges[0].low, ranges[0].high
    if low is not None and high is not None and low > high:
        raise ConfigError(f"{option('time')} {quoted(text)}: ends before it begins")
    return ranges[0]


def parse_steps(text: str | None, within: TimeRange | None = None) -> Steps | None:
    """Parse steps ``FIRST:LAST[:EVERY]``.

    ISO times contain colons, too. So the text is split at the colons for which all parts can be
    parsed. If `within` is given, only the steps in this range are returned.

    Raises
    ------
    ConfigError
        The text does not declare steps, its ends are of two kinds (such as a number and an ISO
        time), it ends before it begins, or no step is within the range.
    """
    if text is None:
        return None
    declared: list[Steps] = []
    for given in (*_splits(text, 2), *_splits(text, 3)):
        with suppress(TimeError, ConfigError):
            times = parse_times(given[:2], floats)
            every = Duration.of(given[2], option("steps")) if given[2:] else None
            low, high = times.value.tolist()
            declared.append(Steps(first=low, last=high, every=every, clock=times.clock, text=text))
    if len(declared) != 1:
        raise ConfigError(
            f"{option('steps')} {quoted(text)}: must be FIRST:LAST or FIRST:LAST:EVERY, "
            "such as 0:99 or 0:10:100ms; FIRST and LAST are two numbers or two ISO times, EVERY is "
            "the time between steps"
        )
    if declared[0].first > declared[0].last:
        raise ConfigError(f"{option('steps')} {quoted(text)}: ends before it begins")
    if within is None:
        return declared[0]
    ticks = declared[0].ticks()
    ticks = ticks[within.inside(ticks, declared[0].clock, option("steps", text))]
    if not len(ticks):
        raise ConfigError(
            f"{option('time', within.text)}: is beyond all steps of {option('steps', text)}"
        )
    return replace(declared[0], first=ticks[0].item(), last=ticks[-1].item())


def _splits(text: str, count: int) -> Iterator[list[str]]:
    """Yield all ways to split a text at its colons into `count` parts, which may have colons."""
    pieces = text.split(":")
    for at in combinations(range(1, len(pieces)), count - 1):
        yield [":".join(pieces[a:b]).strip() for a, b in pairwise((0, *at, len(pieces)))]


def class_named(name: str, there: Collection[str]) -> str | None:
    """Return the class with this name.

    If there is none, return the class with a similar name (see `is_alike`). If no class or several
    classes have a similar name, return None.
    """
    alike = [other for other in there if is_alike(name, other)]
    return name if name in alike else alike[0] if len(alike) == 1 else None


def is_alike(name: str, other: str) -> bool:
    """Return whether two names are equal except for case, or are one number, as 1 and 1.0."""
    return name.casefold() == other.casefold() or parsed(name) == parsed(other) is not None


def parse_region(text: str | None) -> dict[str, tuple[float, float]]:
    """Parse ranges such as ``x=-50:50,y=0:``; return both ends by column. A blank end is infinite.

    Raises
    ------
    ConfigError
        A range cannot be understood.
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
                f"{option('region')} {quoted(item)}: must be NAME=LOW:HIGH, each name once, LOW "
                "<= HIGH, of which one may be blank"
            ) from None
        ranges[name] = (float(low), float(high))
    return ranges


ROLES = ("truth", "estimate")
"""Roles of the two files of an evaluation."""


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options of reading a file, and of selecting its rows.

    Parameters
    ----------
    columns : tuple of str, optional
        State columns in order; an item ``"name=header"`` maps a name to a header (``"id=trk"``,
        ``"t=clock"``, ``"x=px"``). The default is x, y, z as far as the file has them, otherwise
        lat, lon, otherwise the centres of boxes.
    decimal : {".", ","}
        Decimal mark.
    on_duplicate : {"error", "first", "last"}
        What to do with rows that repeat an id and time: raise an error, or use the first or last.
    on_invalid : {"error", "drop"}
        What to do with a row without an id, or with an invalid state: a box without a size, or a
        position that the distance does not allow.
    boxes : bool
        Whether the states are boxes: left, top, width, height.
    form : TimeForm, optional
        Format and zone of the times, if they are not numbers or ISO times, or lack a zone.
    day_begins : float, optional
        Time of day at which a day begins; earlier times are on the next day.
    time : str, optional
        Range ``"A:B"`` of the steps to read, ends included; either end may be blank.
    classes : tuple of str, optional
        Classes of the rows to read.
    also : tuple of str
        Further classes of the rows to read, if `classes` is given.
    kept : tuple of str
        Names of rules of the format that are not applied. Such a rule leaves out no rows, see
        `Rows.excluded`.
    regions : bool
        Whether to read also the boxes that mark ignored regions instead of objects, see
        `Reading.regions`.
    region : str, optional
        Ranges of the rows to read, ``"x=-50:50,y=0:100"``, ends included; either end may be blank.
    where : tuple of Where
        Filters that rows must pass.
    by_class : bool
        Whether to read the class of each row, see `Reading.klass`.
    class_for : str
        Option that sets `by_class`, for messages; by default ``by``.
    covariance : bool
        Whether to read covariances, if the file has columns of them.
    fix_covariance : bool
        Whether to replace an invalid covariance by the nearest valid matrix.
    missing_covariance : {"error", "zero"}
        Meaning of a blank covariance, if the file has columns of covariances: an error or a point.
    clouds : bool
        Whether rows with a weight are particles even if no id and time is repeated. This has no
        effect on a file from which covariances are read.
    fault : callable, optional
        Callable that receives the names of the state columns and the states (d, R): d columns and R
        rows. It returns None, or three things about a column with values that are out of range: a
        mask of these rows, the name of the column, and a message about the first of them.
    attributes : tuple of str
        Further columns to read, if the file has them; see `Trajectories.attributes`.
    numbered : bool
        Whether to add the attribute `ROW`: the position of each row in the file.
    conversion : Conversion
        Conversion of the timestamps and states of the file; `time` and `region` are in the new
        units.
    max_input : float, optional
        Memory in GB that reading may take; 0 means no limit. The default is the available memory,
        and at most 4 GB for a file that is much smaller than its content.
    shared : tuple of str
        Names in `columns` that were mapped for several files. ``"class"`` is among them if a filter
        by class was given for several files. If a file lacks the header of such a name, the usual
        headers are tried. If a file has no classes, all its rows pass the filter by class.
    placed : tuple of str
        Names of the columns of a table without a header, in order.
    hidden : tuple of str
        Headers of columns in which all positions are unknown. Such a column is part of the state
        only if the user maps it.
    heights : {"", "tell", "use"}
        Use of a column of heights or elevations that the user did not name. ``"use"`` makes it part
        of the state, ``"tell"`` only returns its header (`Reading.height`), and ``""`` ignores it.
        Positions on the Earth have heights, and positions by range and bearing have elevations.
    axes : tuple of str
        Directions of x, y and z, such as north, east, down; empty if no option states them.
    beside : tuple of str
        Paths of all files of the evaluation, as one may have data that another needs.
    roles : tuple of str
        Roles of the files of `beside`.
    option : str
        Option that sets `columns`, for messages; blank for a DataFrame.
    of_tables : str
        Name of an option in use that needs a table with rows and headers; blank if there is none.

    Raises
    ------
    ConfigError
        A value is not allowed.
    """

    columns: tuple[str, ...] | None = None
    decimal: str = "."
    on_duplicate: str = "error"
    on_invalid: str = "error"
    boxes: bool = False
    form: "TimeForm | None" = None
    day_begins: float | None = None
    time: str | None = None
    classes: tuple[str, ...] | None = None
    also: tuple[str, ...] = ()
    kept: tuple[str, ...] = ()
    regions: bool = False
    region: str | None = None
    where: tuple[Where, ...] = ()
    by_class: bool = False
    class_for: str = ""
    covariance: bool = False
    fix_covariance: bool = False
    missing_covariance: str = "error"
    clouds: bool = False
    fault: Callable[[tuple[str, ...], Floats], tuple[Mask, str, str] | None] | None = None
    attributes: tuple[str, ...] = ()
    numbered: bool = False
    conversion: Conversion = field(default_factory=Conversion)
    max_input: float | None = None
    shared: tuple[str, ...] = ()
    placed: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    heights: str = ""
    axes: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    roles: tuple[str, ...] = ROLES
    option: str = "columns"
    of_tables: str = ""

    def __post_init__(self) -> None:
        for name in ("columns", "classes", "attributes"):
            if isinstance(getattr(self, name), str):
                raise ConfigError(f"{name} is {getattr(self, name)!r}: must be a tuple of names")
        for name, allowed in (
            ("decimal", (".", ",")),
            ("on_duplicate", ("error", "first", "last")),
            ("on_invalid", ("error", "drop")),
            ("missing_covariance", ("error", "zero")),
        ):
            one_of(name, getattr(self, name), allowed)
        if self.classes is not None and not all(name.strip() for name in self.classes):
            raise ConfigError(
                f"class: a name is blank; name classes, {option('class_', 'car,van')}"
            )
        parse_time_range(self.time)
        parse_region(self.region)

    def with_paths(self, paths: tuple[str, ...], roles: tuple[str, ...]) -> "ReadOptions":
        """Return these options with new `beside` and `roles`; values are not checked again."""
        same = object.__new__(ReadOptions)
        vars(same).update(vars(self), beside=paths, roles=roles)
        return same

    @property
    def time_range(self) -> TimeRange | None:
        """Range of time, parsed from `time`."""
        return parse_time_range(self.time)

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Range of each column, parsed from `region`."""
        return parse_region(self.region)

    def filters(self) -> Iterator[tuple[str, str | float | list[str]]]:
        """Yield name and value of each option in use that selects or separates rows.

        These are the filters, `day_begins` and ``by``.
        """
        for name, value in (("time", self.time), ("class", self.classes), ("region", self.region)):
            if value is not None:
                yield name, list(value) if isinstance(value, tuple) else value
        if self.day_begins is not None:
            yield "day_begins", self.day_begins
        if self.where:
            yield "where", [one.text for one in self.where]
        if self.by_class:
            yield "by", "class"

    def covariances(self) -> Iterator[tuple[str, bool | str]]:
        """Yield name and value of the options of covariances, if covariances are read."""
        if self.covariance:
            yield "fix_cov", self.fix_covariance
            yield "missing_cov", self.missing_covariance


def one_of(name: str, value: object, allowed: tuple[str, ...]) -> None:
    """Check that a value is allowed.

    Raises
    ------
    ConfigError
        The value is not one of `allowed`.
    """
    if value not in allowed:
        options = ", ".join(f'"{item}"' for item in allowed)
        raise ConfigError(f"{name} is {quoted(value)}: must be one of {options}")
