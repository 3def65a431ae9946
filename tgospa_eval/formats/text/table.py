"""CSV tables: ``id,t,x[,y[,z]]`` and other columns, one row per object and step.

Parsed here and not by pandas, for exact floats, exact integers, messages that name the line, and a
start without importing pandas. What the compiled loop leaves is split here: text without quotes in
one call a piece, after the delimiters of every line were counted; the rest by the csv module.
"""

import csv
import io
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.roles import Roles, find_roles
from tgospa_eval.formats.fields import is_number
from tgospa_eval.formats.guess import COMMENTS, foreign
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text.scan import (
    Block,
    beginning,
    check_text,
    chunks,
    convert,
    decode,
    gather,
    plain_id,
    scanned,
    with_comments,
)
from tgospa_eval.tracks.trajectories import Ints

DELIMITERS = ",;\t"

DECIMAL = r"[+-]?\d*[.,]\d+([eE][+-]?\d+)?"
GROUPED_NUMBER = r"[+-]?[1-9]\d{0,2}[.,]\d{3}"
"""Numbers whose mark may be one between thousands."""

BLANKS = " "
"""Delimiter of tables whose columns are separated by any number of blanks."""

ROWS_OF_BLOCK = 1 << 13
"""Rows of a block from the csv module."""

QUOTED_OR_BLANKS = re.compile(r'"[^"\n]*"|[ \t]+')
QUOTED_OR_ODD = re.compile(r'["\x0b\x0c\x1c-\x1f]')
OUTER_BLANKS = re.compile(r"^[ \t]+|[ \t]+$", re.MULTILINE)
COMMENT = re.compile(rf"^[ \t]*(?:{'|'.join(map(re.escape, COMMENTS))})(?:[ \t].*)?$", re.MULTILINE)
"""A line of a table by blanks that is a comment: no id is a mark alone."""

FEWEST = 3
"""Columns of a table by blanks: id, t and x."""


def read_table(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a CSV file, the same in either role.

    Raises
    ------
    InputError
        See `formats.read`.
    """
    check_text(data, path)
    text, whole = beginning(data, path)
    names, roles, delimiter, first, start = header_of(text, path, options)
    roles, decimal = with_decimal(text[start:], delimiter, roles, options.decimal)
    name_id = plain_id if delimiter == BLANKS else str.strip  # numpy.savetxt writes 1.000e+00
    fields = scanned(data, first, len(names), delimiter, roles, decimal)
    if fields is None:
        text = text if whole else decode(data, path)
        if delimiter == BLANKS:
            tabs, comments = rows_by_tabs(text[start:])
            text, delimiter = text[:start] + tabs, "\t"
            roles = with_comments(roles, comments)
        odd = _Oddities(path, len(names), marked=any(mark in text for mark in COMMENTS))
        fields = gather(tokenise(text, start, delimiter, first, odd), roles, decimal)
        roles = odd.settled(roles)
    return convert(fields, roles, decimal, path, names, name_id)


def header_of(text: str, path: str, options: ReadOptions) -> tuple[list[str], Roles, str, int, int]:
    """The headers, what they are, the delimiter, number and begin of the line after them.

    It is the first line with content that is no comment; one that begins like a comment is the
    header if it is understood as one.
    """
    fault, passed = None, 0
    for number, found in enumerate(re.finditer(r".*\n?", text), start=1):
        given = line = found[0].removesuffix("\n")
        start = found.end()
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
            roles = find_roles(names, options, where)
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
    plain = _unquoted(header)
    return max(
        DELIMITERS,
        key=lambda mark: (mark != decimal, plain.count(mark)) if plain.count(mark) else (False, 0),
    )


def header_by_blanks(line: str, after: str) -> str | None:
    """A line without any other delimiter with tabs in place of blanks; None where it has another.

    So numpy.savetxt writes tables, and the trajectories of robotics. A comment mark in front is
    left out if the line after has as many words: else it is a comment.
    """
    line = line.strip()
    if any(mark in _unquoted(line) for mark in ",;\t|"):
        return None
    mark = next((mark for mark in COMMENTS if line.startswith(mark)), "")
    words = _tabbed(line.removeprefix(mark).strip())
    count = words.count("\t") + 1
    fits = not mark or not after.strip() or len(after.split()) == count
    return words if count >= FEWEST and fits else None


def rows_by_tabs(text: str) -> tuple[str, int]:
    """The rows with tabs in place of blanks, comments as blank lines, and their number."""
    text, comments = COMMENT.subn("", text)
    if text.isascii() and not QUOTED_OR_ODD.search(text):  # ten times as fast
        return "\n".join(map("\t".join, map(str.split, text.split("\n")))), comments
    return _tabbed(OUTER_BLANKS.sub("", text)), comments


def _tabbed(text: str) -> str:
    return QUOTED_OR_BLANKS.sub(lambda found: found[0] if found[0][0] == '"' else "\t", text)


def _unquoted(line: str) -> str:
    """A line without what is in quotes."""
    return re.sub(r'"[^"]*"', "", line) if '"' in line else line


def with_decimal(text: str, delimiter: str, roles: Roles, asked: str) -> tuple[Roles, str]:
    """The decimal mark of the first rows, with a notice in the roles if another one was asked for.

    It is another one only if no number has the one asked for and some have that for certain: 1,250
    and 1.250 may have a mark between thousands.
    """
    columns = {roles.time, *roles.numbers} - {roles.weight}  # weights may be something else
    other = {".": ",", ",": "."}[asked]
    if other == delimiter or other not in text:
        return roles, asked
    lines: Iterable[str] = itertools.islice(io.StringIO(text), ROWS_OF_BLOCK)
    if delimiter == BLANKS:
        lines, delimiter = rows_by_tabs("".join(lines))[0].split("\n"), "\t"
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


class _Oddities:
    """Lines of other lengths, and rows that begin like comments.

    A line that begins like a comment may be a row as well, for an id may begin so: where all do.

    Parameters
    ----------
    path : str
        The file, for messages.
    width : int
        Number of columns.
    marked : bool
        Whether there are marks of comments in the file.
    """

    def __init__(self, path: str, width: int, *, marked: bool) -> None:
        self.path, self.width, self.is_marked = path, width, marked
        self.wrong: list[tuple[int, int]] = []
        self.comments: list[tuple[int, int]] = []
        self.marked: int | None = None
        self.all_marked = True

    def add(self, line: int, fields: list[str]) -> None:
        """A line of another length."""
        is_comment = fields[0].lstrip().startswith(COMMENTS)
        (self.comments if is_comment else self.wrong).append((line, len(fields)))

    def watched(self, lines: Ints, columns: Sequence[Sequence[str]]) -> Block:
        """The same rows; which of them begin like comments is noted."""
        if self.is_marked:
            begins = [text.lstrip(" \t").startswith(COMMENTS) for text in columns[0]]
            if self.marked is None and any(begins):
                self.marked = int(lines[begins.index(True)])
            self.all_marked = self.all_marked and all(begins)
        return lines, columns

    def settled(self, roles: Roles) -> Roles:
        """The roles with a notice about comments, when all rows are read.

        Raises
        ------
        InputError
            A row has the wrong length; or it may be a comment as well as a row.
        """
        wrong = self.wrong
        if self.marked is not None and self.all_marked:  # ids begin so
            wrong = sorted([*wrong, *self.comments])
        if wrong:
            line, found = wrong[0]
            raise InputError(
                f"{self.path}, line {line}: {counted(found, 'field')}, the header has "
                f"{self.width}{more(len(wrong))}; give every row one field per column"
            )
        if self.marked is None:
            return with_comments(roles, len(self.comments))
        if not self.all_marked:
            raise InputError(
                f"{self.path}, line {self.marked}: a comment, not a row, or an id that begins like "
                "one; delete such lines (ids may begin like comments if all do)"
            )
        return roles


def tokenise(
    text: str, start: int, delimiter: str, first_line: int, odd: _Oddities
) -> Iterator[Block]:
    """The rows of the table from letter `start` on; lines that are none are told to `odd`."""
    if text.find('"', start) >= 0:
        yield from _tokenise_slowly(chunks(text, start), delimiter, first_line, odd)
        return
    line, width = first_line, odd.width
    others = bytes(set(range(256)) - {ord(delimiter), ord("\n")})
    for chunk in chunks(text, start):
        count = chunk.count("\n") + 1
        marks = chunk.encode().translate(None, others) + b"\n"
        if width > 1 and marks == (delimiter.encode() * (width - 1) + b"\n") * count:
            fields = chunk.replace("\n", delimiter).split(delimiter)
            columns = [fields[k::width] for k in range(width)]
            yield odd.watched(np.arange(line, line + count), columns)
        else:
            yield from _tokenise_slowly([chunk], delimiter, line, odd)
        line += count


def _tokenise_slowly(
    parts: Iterable[str], delimiter: str, first_line: int, odd: _Oddities
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
                yield odd.watched(np.array(lines), list(zip(*rows, strict=True)))
                lines, rows = [], []
    except csv.Error as error:
        raise InputError(
            f"{odd.path}, line {begin}: {error}; close quotes, and double those inside a field"
        ) from None
    if rows:
        yield odd.watched(np.array(lines), list(zip(*rows, strict=True)))


def _lines(parts: Iterable[str]) -> Iterator[str]:
    """The lines of the parts, with their ends; no others than line feeds are left."""
    for part in parts:
        yield from io.StringIO(part + "\n", newline="\n")
