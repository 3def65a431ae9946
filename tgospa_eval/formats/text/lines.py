"""Conversion of lines of text to columns, in two ways with equal results.

The compiled loop (`scanned`) reads plain text in one pass over the bytes. It rounds numbers
correctly, and creates no Python object for each field. `blocks_of` and `gather` read other text,
and report mistakes with their lines. The reader of a format gives `blocks_of` a function that
splits lines into fields.
"""

import csv
import io
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.machine import compiled
from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.fields import (
    MISSING,
    Coded,
    TimeError,
    attribute_of,
    floats,
    is_number,
    is_rounded,
    read_times,
    remedy_for,
)
from tgospa_eval.formats.guess import COMMENTS
from tgospa_eval.formats.roles import Roles
from tgospa_eval.formats.rows import (
    Rows,
    blanks,
    name_objects,
    named_ids,
    numbered,
    without_blank,
    without_ids,
)
from tgospa_eval.quoting import option, quoted

scanner: Any = compiled("tgospa_eval.formats.text._scan")
"""The compiled module, or None. Without it, reading large files takes some ten times as long."""

AS_NUMBER, AS_TEXT = 1, 2
"""Types as which a column is read. Their sum means both."""

BLANKS = " "
"""Delimiter that means any number of blanks."""

ROWS_OF_BLOCK = 1 << 13
"""Number of rows in a block."""

LETTERS_TOGETHER = 1 << 17
"""Number of letters that are split into lines at a time."""

LARGE_BYTES = 4_000_000
"""Size in bytes from which a file is large.

A large file is decoded as a whole only if the compiled loop cannot read it."""

HEADER_BYTES = 1 << 16
"""Number of first bytes in which the header of a large file is looked for."""

COMPRESSED = {
    b"PK\x03\x04": "zip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\0": "xz",
}
"""First bytes of compressed files that `formats.loading` does not unpack."""

Block = tuple[Ints, Sequence[Sequence[str]]]
"""Some rows of a file: the number of the line of each row, and the texts of each column."""


Wrong = dict[str, tuple[int, str, int]]
"""For each kind of mistake in a column: the first wrong row, its text, and the number of rows."""


def check_text(data: bytes, path: str) -> None:
    """Check that the bytes can be text.

    Raises
    ------
    InputError
        The file is empty, compressed, binary, UTF-16 or UTF-32.
    """
    if not data:
        formats = dict.fromkeys(option(name) for name in ("truth_format", "estimate_format"))
        raise InputError(
            f"{path}: the file is empty; if there are no objects, write the header alone; only "
            "MOTChallenge, VisDrone and KITTI text may be empty, if the format is named "
            f"({', '.join(formats)})"
        )
    for magic, program in COMPRESSED.items():
        if data.startswith(magic):
            raise InputError(f"{path}: compressed by {program}; unpack it, or use gzip or zstd")
    if data[:4] in (b"\xff\xfe\0\0", b"\0\0\xfe\xff"):
        raise InputError(f"{path}, line 1: UTF-32 text; save the file as UTF-8")
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(f"{path}, line 1: UTF-16 text; save the file as UTF-8")
    if 0 in data:
        line = data.count(b"\n", 0, data.index(0)) + 1
        raise InputError(
            f"{path}, line {line}: binary data, not text; a CSV, Parquet, MOTChallenge or KITTI "
            "file is needed"
        )


def decode(data: bytes, path: str) -> str:
    """Decode a text, and convert all line ends to line feeds."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}, line {line}: not UTF-8 (byte 0x{data[error.start]:02x}); save it as UTF-8"
        ) from None
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    return text


def beginning(data: bytes, path: str) -> tuple[str, bool]:
    """Return the text of a file, and whether it is complete.

    For a large ASCII file, only the first lines are returned.
    """
    if len(data) < LARGE_BYTES or not data.isascii():
        return decode(data, path), True
    end = data.rfind(b"\n", 0, HEADER_BYTES) + 1
    return decode(data[:end] if end else data, path), not end


@dataclass(frozen=True, kw_only=True, eq=False)
class Fields:
    """Texts and numbers of the columns of a file that are used.

    Parameters
    ----------
    lines : (R,) int array or range
        Number of the line of each row.
    coded : dict of int to Coded
        Texts, by column.
    values : (R, n) float array
        Numbers of the n columns `Roles.numbers`, NaN where blank.
    mistakes : sequence of tuple
        Column, first row and message of each kind of mistake in a column: not a number, infinite.
    """

    lines: Ints | range
    coded: dict[int, Coded]
    values: Floats
    mistakes: Sequence[tuple[int, int, str]] = ()


def text_columns(roles: Roles, texts: Sequence[int] = ()) -> tuple[int, ...]:
    """Return the columns to read as texts: ids, times, classes, `Roles.texts`, and `texts`."""
    klass = () if roles.klass is None else (roles.klass,)
    second = () if roles.second is None else (roles.second,)
    return tuple(dict.fromkeys((roles.id, roles.time, *second, *texts, *klass, *roles.texts)))


def scanned(
    data: bytes,
    first: int,
    width: int,
    delimiter: str,
    roles: Roles,
    decimal: str = ".",
    texts: Sequence[int] = (),
    *,
    quotes: bool = True,
) -> Fields | None:
    """Read the columns of plain UTF-8 text with the compiled loop; return None for other text.

    Rows begin on line `first`. Text is plain if all rows have `width` fields, and all numbers are
    finite or blank. Plain text also has no comments, no blank lines, no line ends or quotes inside
    fields, and no carriage return without a line feed.
    """
    if scanner is None or delimiter == decimal:
        return None
    if b"\r" in data and data.count(b"\r") != data.count(b"\r\n"):
        return None
    start = 0
    for _ in range(first - 1):
        start = data.find(b"\n", start) + 1
        if not start:
            return None
    wanted = text_columns(roles, texts)
    kinds = np.zeros(width, np.uint8)
    kinds[list(roles.numbers)] |= AS_NUMBER
    kinds[list(wanted)] |= AS_TEXT
    fields = scanner.scan(data, start, delimiter, decimal, kinds, quotes)
    if fields is None:
        return None
    values, codes, distinct = fields
    if list(roles.numbers) != sorted(roles.numbers):
        values = values[np.searchsorted(np.sort(roles.numbers), roles.numbers)]
    return Fields(
        lines=range(first, first + values.shape[1]),
        coded={column: Coded(distinct[k], codes[k]) for k, column in enumerate(sorted(wanted))},
        values=values.T,
    )


def lines_of(text: str, start: int = 0) -> Iterator[str]:
    """Yield the lines of the text from `start` on, with line feeds at their ends.

    The text is copied in parts of some 10^5 letters. A copy of the whole text would take four times
    the memory of the text.
    """
    stop = len(text.rstrip("\n"))
    while start < stop:
        end = text.find("\n", start + LETTERS_TOGETHER, stop)
        end = stop if end < 0 else end
        yield from io.StringIO(text[start:end] + "\n", newline="\n")
        start = end + 1


class Comments:
    """Counter of the lines of comments among the rows."""

    def __init__(self) -> None:
        self.count = 0

    def noted(self, roles: Roles) -> Roles:
        """Return the roles with a notice about the comments, if there are any."""
        if not self.count:
            return roles
        notice = f"{counted(self.count, 'line')} of comments passed over"
        return replace(roles, passed=(*roles.passed, notice))


def blocks_of(
    lines: Iterator[str],
    split: Callable[[Iterable[str]], Iterator[list[str]]],
    width: int,
    line: int,
    path: str,
    rule: str,
    comments: Comments,
    *,
    delimiter: str = BLANKS,
    quotes: bool = False,
) -> Iterator[Block]:
    """Yield rows in blocks; blank lines and comments are skipped.

    A line that begins like a comment, but has all fields of a row, is an error. An exception is a
    file in which all rows begin like comments: these rows are read.

    Parameters
    ----------
    lines : iterator of str
        Lines with their ends.
    split : callable
        Callable that receives lines and yields the fields of each row.
    width : int
        Number of fields of a row.
    line : int
        Number of the line of the first row.
    path, rule : str
        Path of the file, and the rule for the number of fields, for messages.
    comments : Comments
        Counter of the comments.
    delimiter : str
        Delimiter of `split`, if it splits lines at one delimiter only: lines without quotes and
        comments are then split all at once, in half the time. Otherwise `BLANKS`: all lines are
        split by `split`.
    quotes : bool
        Whether the text has quotes, so that fields can have line ends.

    Raises
    ------
    InputError
        A row has the wrong number of fields or wrong quotes, or it is not clear whether it is a
        comment.
    """
    marked, are_marked = 0, True
    fault = None
    rows = split(lines)
    while fault is None:
        several = [] if quotes else list(itertools.islice(lines, ROWS_OF_BLOCK))
        columns = _plain_columns(several, delimiter, width)
        at = np.arange(line, line + len(several))
        if columns:
            line += len(several)
        else:
            block: list[list[str]] = []
            try:
                block.extend(itertools.islice(rows, ROWS_OF_BLOCK) if quotes else split(several))
            except csv.Error as error:
                fault = error
            if fault is None and not block:
                return
            within = [sum(field.count("\n") for field in fields) for fields in block if quotes]
            after = line + np.arange(1, len(block) + 1) + (np.cumsum(within) if quotes else 0)
            at, line = np.append(line, after)[:-1], int(np.append(line, after)[-1])
            has_all = np.fromiter(map(len, block), int, len(block)) == width
            for k in np.flatnonzero(~has_all).tolist():
                begin = "".join(block[k][:1]).lstrip()
                if begin.startswith(COMMENTS):
                    comments.count += 1
                elif any(map(str.strip, block[k])):
                    count = counted(len(block[k]), "field")
                    raise InputError(f"{path}, line {at[k]}: {count}, {rule}")
            at = at[has_all]
            columns = list(zip(*itertools.compress(block, has_all.tolist()), strict=True))
        if columns:
            texts = dict.fromkeys(columns[0])  # most texts repeat
            begins = [text for text in texts if text.lstrip(" \t").startswith(COMMENTS)]
            marked = marked or (int(at[columns[0].index(begins[0])]) if begins else 0)
            are_marked = are_marked and len(begins) == len(texts)
            if marked and not are_marked:
                raise InputError(
                    f"{path}, line {marked}: begins like a comment, but has the fields of a row; "
                    "delete the line (ids may begin so only if all ids do)"
                )
            yield at, columns
    raise InputError(f"{path}, line {line}: {fault}; close quotes, and double those inside a field")


def _plain_columns(several: list[str], delimiter: str, width: int) -> list[Sequence[str]]:
    """Split lines into columns at once; return an empty list if they are not plain.

    All lines must have `width` fields, and no delimiter may be followed by a blank.
    """
    text = "".join(several)
    row = delimiter * (width - 1) + "\n"
    deleted = bytes(set(range(256)) - set(row.encode()))
    has_rows = text.encode().translate(None, deleted) == row.encode() * len(several)
    if not text or delimiter == BLANKS or not has_rows or f"{delimiter} " in text:
        return []
    fields = text.removesuffix("\n").replace("\n", delimiter).split(delimiter)
    return [fields[k::width] for k in range(width)]


def gather(
    blocks: Iterable[Block], roles: Roles, decimal: str, texts: Sequence[int] = ()
) -> Fields:
    """Convert blocks to columns; `texts` are further columns to return as texts.

    Each block is converted before the next one is read. So the texts of numbers are not kept, and
    each distinct text of other columns is kept once.
    """
    wanted = text_columns(roles, texts)
    numbering: dict[int, dict[str, int]] = {column: {} for column in wanted}
    codes: dict[int, list[Ints]] = {column: [np.zeros(0, np.int64)] for column in wanted}
    read: dict[int, list[Floats]] = {column: [np.zeros(0)] for column in roles.numbers}
    wrong: dict[int, Wrong] = {column: {} for column in roles.numbers}
    lines: list[Ints] = [np.zeros(0, np.int64)]
    count = 0
    for numbers_of_lines, columns in blocks:
        lines.append(numbers_of_lines)
        for column, known in numbering.items():
            for text in dict.fromkeys(columns[column]):  # most texts repeat
                known.setdefault(text, len(known))
            code = map(known.__getitem__, columns[column])
            codes[column].append(np.fromiter(code, np.int64, len(columns[column])))
        for column, blocks_of in read.items():
            blocks_of.append(_values(columns[column], decimal, count, wrong[column]))
        count += len(numbers_of_lines)
    coded = {
        column: Coded(list(known), np.concatenate(codes.pop(column)))
        for column, known in numbering.items()
    }
    whole = np.concatenate(lines)
    values = np.empty((len(whole), len(roles.numbers)), order="F")
    for k, column in enumerate(roles.numbers):
        values[:, k] = np.concatenate(read.pop(column))
    mistakes = [(column, *each) for column in roles.numbers for each in _mistakes(wrong[column])]
    return Fields(lines=whole, coded=coded, values=values, mistakes=mistakes)


def _values(texts: Sequence[str], decimal: str, row: int, wrong: Wrong) -> Floats:
    """Convert texts to numbers, NaN where blank; add mistakes to `wrong`.

    The first text is in the row `row`.
    """

    def note(what: str, k: int) -> None:
        first, text, count = wrong.get(what, (row + k, texts[k], 0))
        wrong[what] = first, text, count + 1

    try:
        values = floats(texts, decimal)
    except ValueError:
        texts = ["nan" if text.strip() in MISSING else text for text in texts]
        values = np.full(len(texts), np.nan)
        for k, text in enumerate(texts):
            if is_number(text, decimal):
                values[k] = floats([text], decimal)[0]
            else:
                note("not a number", k)
    for k in np.flatnonzero(np.isinf(values)).tolist():
        note("infinite", k)
    return values


def _mistakes(wrong: Wrong) -> Iterator[tuple[int, str]]:
    """Yield the first row of each kind of mistake, and its message."""
    for what in ("not a number", "infinite"):
        if what in wrong:
            row, text, count = wrong[what]
            remedy = remedy_for(text if what == "not a number" else "")
            yield row, f"{what}: {quoted(text)}{more(count)}; {remedy}"


def numbers(texts: Sequence[str], decimal: str) -> tuple[Floats, list[tuple[int, str]]]:
    """Convert a column to numbers, NaN where blank.

    Also return the first row and the message of each kind of mistake.
    """
    wrong: Wrong = {}
    return _values(texts, decimal, 0, wrong), list(_mistakes(wrong))


def _without_blank_rows(fields: Fields, roles: Roles) -> tuple[Fields, Roles]:
    """Leave out rows without any value, such as ``,,,`` of spreadsheets, with a notice."""
    columns = [fields.coded[roles.id], *fields.coded.values()]
    # Ids come first: they are rarely blank, so the loop usually ends at once.
    empty = np.ones(len(fields.values), bool)
    empty[[row for _, row, _ in fields.mistakes]] = False
    for texts in columns:
        empty &= np.array([not text.strip() for text in texts.distinct], bool)[texts.code]
        if not empty.any():
            return fields, roles
    empty &= np.isnan(fields.values).all(axis=1)
    kept = np.flatnonzero(~empty)
    coded = {}
    for column, texts in fields.coded.items():
        used, code = np.unique(texts.code[kept], return_inverse=True)
        coded[column] = Coded([texts.distinct[k] for k in used.tolist()], code)
    mistakes = [(column, int((kept < row).sum()), text) for column, row, text in fields.mistakes]
    lines, values = np.asarray(fields.lines)[kept], fields.values[kept]
    fields = Fields(lines=lines, coded=coded, values=values, mistakes=mistakes)
    return fields, without_blank(roles, len(empty) - len(kept))


def convert(
    fields: Fields,
    roles: Roles,
    decimal: str,
    path: str,
    names: Sequence[str],
    name_id: Callable[[str], str] = str.strip,
) -> Rows:
    """Convert the fields of a file to rows; a single error reports all mistakes.

    Parameters
    ----------
    fields : Fields
        Columns of the file.
    roles : Roles
        Roles of the columns.
    decimal : str
        Decimal mark.
    path, names
        Path of the file and names of its columns, for messages.
    name_id : callable
        Callable that converts the text of an id to its name.

    Raises
    ------
    InputError
        An id is blank, a text is not a number or not a time, or a number is infinite.
    """

    def where(row: int) -> str:
        return f"{path}, line {lines[row]}"

    fields, roles = _without_blank_rows(fields, roles)
    coded, lines = fields.coded, fields.lines
    problems: list[str] = []
    of_weights: list[str] = []  # raised only if weights are needed
    ids = named_ids([coded[column] for column in (roles.id, *roles.more_ids)], name_id)
    blank = blanks(ids)
    if len(blank) and roles.options.on_invalid != "drop":
        place = f"{where(int(blank[0]))}, column {quoted(names[roles.id])}"
        problems.append(f"{place}: blank id{more(len(blank))}; {name_objects()}")
    for column, row, message in fields.mistakes:
        wrong = of_weights if column == roles.weight else problems
        wrong.append(f"{where(row)}, column {quoted(names[column])}: {message}")
    try:
        second = None if roles.second is None else coded[roles.second]
        times = read_times(coded[roles.time], decimal, roles.options.form, second, roles.digits)
    except TimeError as error:
        texts = [coded[column] for column in (*roles.dates[:1], roles.time)]
        why = roles.dated(texts, decimal, error.row)
        place = f"{where(error.row)}, column {quoted(names[roles.time])}"
        problems.append(f"{place}: {why or error}")
    if problems:
        raise InputError(*problems)
    return Rows(
        name=path,
        roles=roles,
        ids=ids,
        times=times,
        numbers=fields.values,
        where=where,
        classes=None if roles.klass is None else numbered(coded[roles.klass]),
        attributes={column: attribute_of(coded[column], decimal) for column in roles.texts},
        weight_fault="\n".join(of_weights) or None,
        excluded=without_ids(ids),
    )


def plain_id(text: str) -> str:
    """Convert ids such as 3.0 and 3.000e+00 to 3, as numeric programs write integers in this way.

    NaN becomes blank. Other ids are unchanged.
    """
    text = text.strip()
    if text.isdigit() or "_" in text or not text.isascii() or is_rounded(text):
        return text
    from decimal import Decimal  # lazy: slow to import, and few ids are written like 3.0

    try:
        if not math.isfinite(float(text)):
            return "" if math.isnan(float(text)) else text  # NaN is not an id
        value = Decimal(text)  # float() would make 9007199254740993.0 and ...992.0 equal
        return str(int(value)) if value == value.to_integral_value() else text
    except (ValueError, ArithmeticError):
        return text
