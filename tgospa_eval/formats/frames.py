"""Readers of pandas DataFrames in long form: one row for each object and time, as in CSV files.

Tables of text may also be wide: each object has columns of its own, as in ``t,x1,y1,x2,y2`` and in
files of DeepLabCut.
"""

import csv
import datetime
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from decimal import Decimal
from functools import partial
from numbers import Real

import numpy as np
import pandas as pd
from pandas.errors import OutOfBoundsDatetime

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.words import more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.assemble import assemble
from tgospa_eval.formats.fields import (
    Coded,
    RowError,
    TimeError,
    Times,
    attribute_of,
    coded_times,
    read_times,
)
from tgospa_eval.formats.guess import COMMENTS
from tgospa_eval.formats.headers import (
    ID_MARK,
    ask,
    has_patterns,
    objects_in,
    parse_columns,
    shared_columns,
)
from tgospa_eval.formats.loading import check_text_memory
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.reading import Reading
from tgospa_eval.formats.roles import Roles, find_roles
from tgospa_eval.formats.rows import (
    Rows,
    blanks,
    name_objects,
    named_ids,
    numbered,
    without_blank,
    without_ids,
)
from tgospa_eval.formats.text.lines import check_text, decode, lines_of, numbers
from tgospa_eval.formats.text.table import header_of, split_rows
from tgospa_eval.quoting import listed, quoted
from tgospa_eval.tracks.trajectories import Values

ID_TYPES = (str, Real, Decimal, np.bool_, datetime.date, datetime.time, datetime.timedelta)
"""Types of values that can be ids and classes; NumPy's numbers and pandas' times are subtypes."""

NUMBER_TYPES = (str, Real, Decimal)
TIME_TYPES = (*NUMBER_TYPES, datetime.date)
"""Types of values that can be times. `NUMBER_TYPES` are the types of values that can be numbers."""

UNWRITTEN = (NotImplementedError, OverflowError, OutOfBoundsDatetime)
"""Errors of pandas about a timestamp that it cannot write as text."""


def from_frame(
    frame: pd.DataFrame, options: ReadOptions | None = None, name: str = "table"
) -> Reading:
    """Read a DataFrame with the columns ``id, t, x[, y[, z]]``; NaN means absent.

    Raises
    ------
    InputError
        The content is wrong (see `formats.read`). In messages, rows count from 0.
    """
    options = replace(options or ReadOptions(), option="")
    headers = [str(column) for column in frame.columns]
    try:
        roles = find_roles(headers, options, name, wide=True)
    except InputError:
        if frame.columns.nlevels > 1:
            joined = '["_".join(map(str, levels)) for levels in table.columns]'
            raise InputError(
                f"{name}: the columns have {frame.columns.nlevels} levels; join the levels, "
                f"table.columns = {joined}"
            ) from None
        levels = [str(level) for level in frame.index.names if level is not None]
        if not levels:
            raise
        find_roles([*levels, *headers], options, name)  # an error here names all missing columns
        indexed = ", ".join(map(quoted, levels))
        raise InputError(
            f"{name}: {indexed} must be a column but is in the index; call reset_index() first"
        ) from None
    if has_patterns(options):
        return assemble(table_rows(frame, options, name), options, "frame")
    return assemble(frame_rows(frame, roles, name, options.decimal), options, "frame")


def _decoded(value: object) -> object:
    """Return a text for bytes, and any other value as it is."""
    return value.decode(errors="replace") if isinstance(value, bytes) else value


def frame_rows(
    frame: pd.DataFrame,
    roles: Roles,
    name: str,
    decimal: str,
    where: Callable[[int], str] | None = None,
) -> Rows:
    """Convert a DataFrame to rows; `name` begins the messages, `decimal` is the decimal mark.

    `where` returns the place of a row, for messages; by default `name` and the number of the row.

    Raises
    ------
    InputError
        A value is not a number, id or time as its column requires, or is infinite.
    """
    where = where or f"{name}, row {{}}".format
    empty = frame.iloc[:, roles.id].isna().to_numpy()
    if empty.any():  # hardly an id is blank
        empty = frame.iloc[:, roles.used].isna().all(axis=1).to_numpy()
        kept, place = np.flatnonzero(~empty), where
        roles, frame = without_blank(roles, int(empty.sum())), frame.iloc[kept]

        def where(row: int) -> str:
            return place(int(kept[row]))

    def named(column: int, wanted: str) -> Coded:
        values = frame.iloc[:, column]
        values = values.map(_decoded) if column in roles.halves else values
        with _placed(values, where):
            return _texts(values, wanted, ID_TYPES, _name)

    def attribute(column: int) -> Values:
        values = frame.iloc[:, column]
        if values.dtype.kind in "iuf":
            return values.to_numpy(dtype=np.float64, na_value=np.nan)
        return attribute_of(named(column, "a number or a text"), decimal)

    attributes = {}
    for column in roles.texts:
        with suppress(InputError) if column in roles.doubtful else nullcontext():
            attributes[column] = attribute(column)
    weight_fault = None
    states = np.empty((len(frame), len(roles.numbers)), order="F")
    for k, column in enumerate(roles.numbers):
        try:
            with _placed(frame.iloc[:, column], where):
                states[:, k] = _numbers(frame.iloc[:, column], name, decimal)
        except InputError as error:
            if column != roles.weight:
                raise
            states[:, k], weight_fault = np.nan, str(error)  # raised only if needed
    with _placed(frame.iloc[:, roles.time], where):
        try:
            times = _formed_times(frame, roles, name, decimal)
        except TimeError as error:
            why = str(error)
            with suppress(RowError):  # values of a column of dates may be of any type
                columns = [*roles.dates[:1], roles.time]
                texts = [_as_texts(frame.iloc[:, column], decimal) for column in columns]
                why = roles.dated(texts, decimal, error.row) or why
            raise TimeError(error.row, why) from None
    ids = named_ids([named(column, "an id") for column in (roles.id, *roles.more_ids)])
    blank = blanks(ids)
    if len(blank) and roles.options.on_invalid != "drop":
        header = frame.columns[roles.id]
        raise InputError(
            f"{where(int(blank[0]))}, column {quoted(header)}: blank id{more(len(blank))}; "
            f"{name_objects()}"
        )
    return Rows(
        name=name,
        roles=roles,
        ids=ids,
        times=times,
        numbers=states,
        where=where,
        classes=None if roles.klass is None else numbered(named(roles.klass, "a class")),
        attributes=attributes,
        weight_fault=weight_fault,
        excluded=without_ids(ids),
    )


def table_rows(table: object, options: ReadOptions, name: str) -> Rows:
    """Convert the table of a reader to rows.

    If the index of the table has texts, these are the places of the rows, for messages.

    Raises
    ------
    TypeError
        The table is not a DataFrame.
    InputError
        The content is wrong (see `formats.read`).
    """
    if not isinstance(table, pd.DataFrame):
        raise TypeError(f"it returned {type(table).__name__}, not a DataFrame")
    roles = find_roles(list(map(str, table.columns)), options, name, wide=True)
    if has_patterns(options):
        table = lengthened(table, parse_columns(options.columns)[0])
    places = table.index
    named = len(places) > 0 and isinstance(places[0], str)
    where = (lambda row: f"{name}, {places[row]}") if named else None
    return frame_rows(table, roles, name, options.decimal, where)


def lengthened(frame: pd.DataFrame, mapped: Mapping[str, str]) -> pd.DataFrame:
    """Reshape a wide table to one row for each object and time.

    `mapped` has patterns of headers by name. The index of the new table has the place of each row,
    for messages. If no header fits the patterns, the table is unchanged.
    """
    names = [str(name).strip() for name in frame.columns]
    objects = objects_in(names, mapped)
    if not objects:
        return frame
    if not len(frame) or not isinstance(frame.index[0], str):
        frame = frame.set_axis([f"row {k}" for k in range(len(frame))], axis=0)
    kept = frame.iloc[:, shared_columns(names, objects)]
    pieces = []
    for name, columns in objects.items():
        own = frame.iloc[:, list(columns.values())].set_axis(list(columns), axis=1)
        pieces.append(pd.concat([kept, own], axis=1))
        pieces[-1].insert(0, "id", name)
    return pd.concat(pieces)


@contextmanager
def _placed(column: pd.Series, where: Callable[[int], str]) -> Iterator[None]:
    """Add row and column to errors about a value, such as a timestamp out of range."""
    try:
        yield
    except RowError as error:
        row, message = error.row, str(error)
    except UNWRITTEN:
        for row in range(len(column)):
            try:
                str(column.iloc[row])
            except UNWRITTEN:
                break
        message = (
            "a timestamp out of range (the years 1 to 9999, in nanoseconds 1677 to 2262); write "
            "texts or numbers"
        )
    else:
        return
    raise InputError(f"{where(row)}, column {quoted(column.name)}: {message}")


def _numbers(column: pd.Series, name: str, decimal: str) -> Floats:
    """Convert a column to finite numbers, NaN where blank; texts follow the rules of text files."""
    kind = column.dtype.kind
    if kind not in "iufO":
        raise InputError(
            f"{name}, column {quoted(column.name)}: {column.dtype}, not numbers; write a numeric "
            "column"
        )
    if kind == "O":
        texts = _texts(column, "a number", NUMBER_TYPES, partial(_number_text, decimal))
        values, wrong = numbers(list(texts), decimal)
        if wrong:
            raise RowError(*wrong[0])
        return values
    values = column.to_numpy(dtype=np.float64, na_value=np.nan)
    infinite = np.flatnonzero(np.isinf(values))
    if len(infinite):
        raise RowError(int(infinite[0]), f"infinite{more(len(infinite))}; use NaN if absent")
    return values


def _number_text(decimal: str, value: object) -> str:
    """Format a number, a text or a date as it would be in a text file."""
    if isinstance(value, datetime.date):
        return value.isoformat()
    if isinstance(value, (str, bool, int, np.integer)):
        return str(value)
    return str(value).replace(".", decimal)


def _other(value: object, wanted: str) -> str:
    """Return the message about a value of a type that is not supported."""
    return f"a value of type {type(value).__name__}, not {wanted}; write numbers or texts"


def _texts(
    column: pd.Series, wanted: str, types: tuple[type, ...], text: Callable[[object], str]
) -> Coded:
    """Convert a column to texts, blank where a value is missing.

    `types` are the supported types of values. `text` converts a value to text, and `wanted` says in
    messages what a value must be.
    """
    # Each distinct value is converted once, except for objects other than texts. These may not be
    # hashable, and 1 and True would be the same value.
    if column.dtype == object and pd.api.types.infer_dtype(column) != "string":
        code, values = np.arange(len(column)), column.tolist()
    else:
        code, uniques = pd.factorize(column)
        values = uniques.tolist()
    missing = pd.isna(pd.Series(values, dtype=object)).tolist()
    names = []
    for k, value in enumerate(values):
        if not (missing[k] or isinstance(value, types)):
            raise RowError(int(np.flatnonzero(code == k)[0]), _other(value, wanted))
        names.append("" if missing[k] else text(value))
    if (code < 0).any():  # -1 means a missing value
        return Coded([*names, ""], np.where(code < 0, len(names), code))
    return Coded(names, code)


def _name(value: object) -> str:
    """Return the text of an id or a class.

    7.0 becomes 7, because pandas may have converted integers to floats.
    """
    if isinstance(value, Decimal):  # up to 76 digits, for which value % 1 fails
        whole = value.is_finite() and value == value.to_integral_value()
    else:
        whole = isinstance(value, (float, np.floating)) and value.is_integer()
    return str(int(value) if whole else value).strip()  # type: ignore[call-overload]


def id_text(value: object, name: str) -> str:
    """Return the text of a single id; `name` begins the messages.

    Raises
    ------
    InputError
        The id is blank, or of a type that is not supported.
    """
    if not isinstance(value, ID_TYPES):
        raise InputError(f"{name}: an id is {_other(value, 'an id')}")
    text = _name(value)
    if not text or text in ("nan", "NaT"):
        raise InputError(f"{name}: blank id; give the object an id")
    return text


def _formed_times(frame: pd.DataFrame, roles: Roles, name: str, decimal: str) -> Times:
    """Return the times of a table, from one or two columns, by the format that the user gave."""
    column = frame.iloc[:, roles.time]
    if roles.second is None and (roles.options.form is None or not roles.options.form.format):
        times = _times(column, name, decimal)
        return times if roles.options.form is None else roles.options.form.zoned(times)
    second = None if roles.second is None else _as_texts(frame.iloc[:, roles.second], decimal)
    return read_times(_as_texts(column, decimal), decimal, roles.options.form, second, roles.digits)


def _as_texts(column: pd.Series, decimal: str) -> Coded:
    """Convert a column of numbers, dates or texts to texts."""
    if column.dtype.kind == "O":
        return _texts(column, "a time", TIME_TYPES, partial(_number_text, decimal))
    code, distinct = pd.factorize(column)
    return Coded([str(value) for value in distinct], code)


def frame_times(
    column: pd.Series, name: str, decimal: str = ".", where: Callable[[int], str] | None = None
) -> Times:
    """Read a column of times; for `name`, `decimal` and `where` see `frame_rows`.

    Raises
    ------
    InputError
        A value is not a time.
    """
    with _placed(column, where or f"{name}, row {{}}".format):
        return _times(column, name, decimal)


def _times(column: pd.Series, name: str, decimal: str) -> Times:
    """Read a column of numbers, timestamps or texts as times."""
    missing = np.flatnonzero(column.isna())
    if len(missing):
        raise TimeError(
            int(missing[0]), f"blank time{more(len(missing))}; write a number or a time"
        )
    kind = column.dtype.kind
    if kind in "iu":
        if len(column) and column.max() > np.iinfo(np.int64).max:
            raise TimeError(int(column.argmax()), "a time beyond 64 bits; write smaller numbers")
        return Times(value=np.asarray(column, dtype=np.int64), clock="number", text=None)
    if kind == "f":
        value = np.asarray(column, dtype=np.float64)
        odd = np.flatnonzero(~np.isfinite(value))
        if len(odd):
            raise TimeError(int(odd[0]), "not a finite time; write a number")
        return Times(value=np.asarray(value + 0.0), clock="number", text=None)
    if kind not in "MO":
        raise InputError(
            f"{name}, column {quoted(column.name)}: {column.dtype}, not times; write numbers, "
            "timestamps or ISO texts"
        )
    texts = _texts(column, "a time", TIME_TYPES, partial(_number_text, decimal))
    return coded_times(texts, decimal)


LEVELS = ("scorer", "individuals", "bodyparts", "coords")
"""First field of each line of the header of DeepLabCut."""


def read_wide(path: str, data: bytes, options: ReadOptions, *_: str, **__: bool) -> pd.DataFrame:
    """Read a wide table from a CSV file; its columns are named by pattern.

    Raises
    ------
    InputError
        The header does not fit the pattern, or a row has another number of fields.
    """
    text = _text(path, data, options)
    names, _roles, delimiter, first, start = header_of(text, path, options, wide=True)
    return _table(path, split_rows(lines_of(text, start), delimiter), first, names)


def read_deeplabcut(
    path: str, data: bytes, options: ReadOptions, *_: str, **__: bool
) -> pd.DataFrame:
    """Read the table of a CSV file of DeepLabCut; columns get names like ``mouse.nose.x``.

    Raises
    ------
    InputError
        The file is not of DeepLabCut, or has several body parts.
    """
    rows = list(csv.reader(_text(path, data, options).split("\n")))
    levels = {row[0]: row[1:] for row in rows[: len(LEVELS)] if row and row[0] in LEVELS}
    if not {"bodyparts", "coords"} <= levels.keys():
        raise InputError(
            f"{path}: not a file of DeepLabCut, whose first lines are {', '.join(LEVELS)}"
        )
    begin = len(levels)
    levels.pop("scorer", None)
    names = ["frame", *map(".".join, zip(*levels.values(), strict=False))]
    table = _table(path, rows[begin:], begin + 1, names)
    if options.columns is not None:
        return table
    parts = list(dict.fromkeys(levels["bodyparts"]))
    has_animals = "individuals" in levels
    each = f"{ID_MARK}.{parts[0]}" if has_animals else ID_MARK
    mapped = {"x": f"{each}.x", "y": f"{each}.y"}
    if len(parts) > 1:
        what = "one of each animal" if has_animals else "each as an object"
        remedy = ask(options.option, [f"{name}={header}" for name, header in mapped.items()])
        raise InputError(
            f"{path}: several body parts ({listed(parts)}); to read {what}, use {remedy}"
        )
    return lengthened(table, mapped)


def _text(path: str, data: bytes, options: ReadOptions) -> str:
    check_text_memory(path, data, options.max_input)
    check_text(data, path)
    return decode(data, path)


def _table(path: str, rows: Iterable[list[str]], first: int, names: Sequence[str]) -> pd.DataFrame:
    """Return rows as a table whose index has the line of each row, for messages.

    The first row is on line `first`. Blank lines and comments are skipped.
    """
    kept, places = [], []
    for line, row in enumerate(rows, start=first):
        is_blank = not any(map(str.strip, row))
        if len(row) == len(names) and not is_blank:
            kept.append(row)
            places.append(f"line {line}")
        elif not is_blank and not row[0].lstrip().startswith(COMMENTS):
            raise InputError(f"{path}, line {line}: {len(row)} fields, the header has {len(names)}")
    return pd.DataFrame(kept, columns=list(names), index=places)
