"""CSV tables: ``id,t,x[,y[,z]]`` and other columns, one row per object and step.

Parsed here and not by pandas, for exact floats, exact integers, messages that name the line, and a
start without importing pandas; only large regular files take the quick way of
`formats.text.bulk`. Text without quotes, the common case, is split in one call a piece after
the delimiters of every line were counted; other text goes through the csv module.
"""

import csv
import io
import itertools
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from tgospa_eval.common.words import counted
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.known import known_roles
from tgospa_eval.formats.columns.roles import Roles
from tgospa_eval.formats.fields import is_number
from tgospa_eval.formats.guess import COMMENTS, foreign
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text import bulk
from tgospa_eval.formats.text.by_blanks import header_by_blanks, rows_by_tabs, unquoted
from tgospa_eval.formats.text.comments import Oddities, with_comments
from tgospa_eval.formats.text.convert import (
    Block,
    check_text,
    chunks,
    convert,
    decode,
    gather,
)
from tgospa_eval.formats.text.scan import scanned

DELIMITERS = ",;\t"

DECIMAL = r"[+-]?\d*[.,]\d+([eE][+-]?\d+)?"
GROUPED_NUMBER = r"[+-]?[1-9]\d{0,2}[.,]\d{3}"
"""Numbers whose mark may be one between thousands."""

HEADER_BYTES = 1 << 16
"""Bytes in which the header of a large file is looked for."""

BLANKS = " "
"""Delimiter of tables whose columns are separated by any number of blanks."""

ROWS_OF_BLOCK = 1 << 13
"""Rows of a block from the csv module."""


def read_table(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a CSV file, the same in either role.

    Raises
    ------
    InputError
        See `formats.read`.
    """
    check_text(data, path)
    # A large ASCII file needs no decoding unless it takes the careful way.
    large = len(data) >= bulk.BULK_BYTES
    whole = not (large and data.isascii() and b"\n" in data[:HEADER_BYTES])
    text = decode(data if whole else data[:HEADER_BYTES], path)
    names, roles, delimiter, first, start = header_of(text, path, options)
    by_blanks = delimiter == BLANKS
    if by_blanks:
        text = text if whole else decode(data, path)
        tabs, comments = rows_by_tabs(text[start:])
        text, whole, delimiter = text[:start] + tabs, True, "\t"
        data, roles = text.encode(), with_comments(roles, comments)
        del tabs
    rows = text[start:]
    if large:  # what is cut off in the middle of a number may look like another one
        rows = rows[: rows.rfind("\n") + 1]
    roles, decimal = with_decimal(rows, delimiter, roles, options.decimal)
    del rows
    layout = bulk.Layout(path=path, first=first, delimiter=delimiter, width=len(names))
    name_id: Callable[[str], str] = str.strip
    if by_blanks:
        from tgospa_eval.formats.text.plain import plain_id  # here: slow to import

        name_id = plain_id  # numpy.savetxt writes 1.000e+00
    fields = None
    if text.isascii():  # letters and bytes are at the same places
        plain = text.encode() if whole else data.replace(b"\r\n", b"\n")
        fields = scanned(plain, start, layout, roles, decimal)
        del plain
    if fields is None and large:
        found = bulk.read_bulk(data, layout, roles, decimal, name_id=name_id)
        if found is not None:
            return found[0]
    if fields is None:
        text = text if whole else decode(data, path)
        odd = Oddities(path, len(names))
        blocks = tokenise(text, start, delimiter, first, odd)
        if any(mark in text for mark in COMMENTS):
            blocks = odd.watched(blocks)
        fields = gather(blocks, roles, decimal)
        roles = odd.settled(roles)
    return convert(fields, roles, decimal, path, names, name_id=name_id)[0]


def header_of(text: str, path: str, options: ReadOptions) -> tuple[list[str], Roles, str, int, int]:
    """The headers, what they are, the delimiter, number and begin of the line after them.

    It is the first line with content that is no comment; one that begins like a comment is the
    header if it is understood as one.
    """
    fault, passed = None, 0
    for number, given, start in _lines_of(text):
        line = given
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        delimiter = _delimiter(line, options.decimal)
        stop = text.find("\n", start)
        after = text[start : stop if stop >= 0 else None].replace('"', "")
        spaced = header_by_blanks(line, after)
        if spaced is not None:
            line, delimiter = spaced, "\t"
        sample = after.split(None if spaced else delimiter)
        try:
            reader = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
            names = [name.strip() for name in next(reader)]
            roles = known_roles(names, options, where, sample)
        except (InputError, csv.Error) as error:
            fault = fault or _explained(error, given, where)
            if not given.lstrip().startswith(COMMENTS):
                raise _explained(error, given, where) from None
            if spaced and all(map(is_number, sample)) and isinstance(error, InputError) and sample:
                raise  # numbers below it: no other line is the header
            passed += 1
            continue
        if passed:
            notice = f"{counted(passed, 'line')} of comments above the header passed over"
            roles = replace(roles, passed=(*roles.passed, notice))
        return names, roles, BLANKS if spaced else delimiter, number + 1, start
    blank = InputError(f"{path}: blank lines only; a set without objects is a header alone")
    raise fault or blank


def _lines_of(text: str) -> Iterator[tuple[int, str, int]]:
    """Number and text of each line, and where the next one begins."""
    number, start = 0, 0
    while start < len(text):
        stop = text.find("\n", start)
        stop = len(text) if stop < 0 else stop
        number, line, start = number + 1, text[start:stop], stop + 1
        yield number, line, start


def _explained(error: InputError | csv.Error, line: str, where: str) -> InputError:
    """Why a line is no header, by what it looks like if it is not one with other names."""
    other = foreign(line)
    if other:
        return InputError(f"{where}: {other}")
    if isinstance(error, InputError):
        return error
    return InputError(f"{where}: {error}; it must be the header, id,t,x,y")  # a field too long


def _delimiter(header: str, decimal: str) -> str:
    """The most frequent delimiter outside quotes; the decimal mark only if there is no other."""
    plain = unquoted(header)
    return max(
        DELIMITERS,
        key=lambda mark: (mark != decimal, plain.count(mark)) if plain.count(mark) else (False, 0),
    )


def with_decimal(text: str, delimiter: str, roles: Roles, asked: str) -> tuple[Roles, str]:
    """The decimal mark of the first rows, with a notice in the roles if another one was asked for.

    It is another one only if no number has the one asked for and some have that for certain: 1,250
    and 1.250 may have a mark between thousands.
    """
    columns = {roles.time, *roles.numbers} - {roles.weight}  # weights may be something else
    other = {".": ",", ",": "."}[asked]
    if other == delimiter or other not in text:
        return roles, asked
    lines = itertools.islice(io.StringIO(text), ROWS_OF_BLOCK)
    certain = False
    with suppress(csv.Error):  # an error when all rows are read
        for row in csv.reader(lines, delimiter=delimiter, skipinitialspace=True):
            for field in (row[k].strip() for k in columns if k < len(row)):
                if re.fullmatch(DECIMAL, field):
                    if asked in field:
                        return roles, asked
                    certain |= not re.fullmatch(GROUPED_NUMBER, field)
    if not certain:
        return roles, asked
    notice = f"read with a decimal {'comma' if other == ',' else 'point'}, as its numbers have it"
    return replace(roles, passed=(*roles.passed, notice)), other


def tokenise(
    text: str, start: int, delimiter: str, first_line: int, odd: Oddities
) -> Iterator[Block]:
    """The rows of the table from letter `start` on; lines that are none are told to `odd`."""
    if text.find('"', start) >= 0:
        yield from _tokenise_slowly(chunks(text, start), delimiter, first_line, odd)
        return
    line, width = first_line, odd.width
    for chunk in chunks(text, start):
        if width > 1 and bulk.is_regular(chunk.encode(), 0, delimiter, width):
            fields = chunk.replace("\n", delimiter).split(delimiter)
            yield Block(
                lines=np.arange(line, line + len(fields) // width),
                columns=[fields[k::width] for k in range(width)],
            )
        else:
            yield from _tokenise_slowly([chunk], delimiter, line, odd)
        line += chunk.count("\n") + 1


def _tokenise_slowly(
    parts: Iterable[str], delimiter: str, first_line: int, odd: Oddities
) -> Iterator[Block]:
    """Quotes, blank lines and rows of the wrong length, through the csv module."""
    lines: list[int] = []
    rows: list[list[str]] = []
    begin = first_line
    reader = csv.reader(_lines(parts), delimiter=delimiter, strict=True, skipinitialspace=True)
    try:
        for row in reader:
            if row and (len(row) > 1 or row[0].strip()):
                if len(row) == odd.width:
                    rows.append(row)
                    lines.append(begin)
                else:
                    odd.add(begin, row)
            begin = first_line + reader.line_num
            if len(rows) == ROWS_OF_BLOCK:
                yield Block(lines=np.array(lines), columns=list(zip(*rows, strict=True)))
                lines, rows = [], []
    except csv.Error as error:
        raise InputError(
            f"{odd.path}, line {begin}: {error}; close quotes, and double those inside a field"
        ) from None
    if rows:
        yield Block(lines=np.array(lines), columns=list(zip(*rows, strict=True)))


def _lines(parts: Iterable[str]) -> Iterator[str]:
    """The lines of the parts, with their ends; no others than line feeds are left."""
    for part in parts:
        yield from io.StringIO(part + "\n", newline="\n")
