"""CSV tables: ``id,t,x[,y[,z]]`` and other columns, one row per object and step.

Parsed here and not by pandas, for exact floats, exact integers, messages that name the line, and a
start without importing pandas; only large regular files take the quick way of
`tgospa_eval.formats.bulk`. Files without quotes, the common case, are split in one call after the
delimiters of every line were counted; others go through the csv module.
"""

import csv
import io
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from tgospa_eval.errors import InputError
from tgospa_eval.formats.assemble import Rows
from tgospa_eval.formats.bulk import SIZE, is_regular, read_bulk
from tgospa_eval.formats.columns import find_roles
from tgospa_eval.formats.text import Places, check_text, convert, decode
from tgospa_eval.formats.times import more

if TYPE_CHECKING:
    from tgospa_eval.formats import ReadOptions

DELIMITERS = ",;\t"

HEAD = 1 << 16
"""Bytes in which the header of a large file is looked for."""


def read_table(path: str, data: bytes, options: "ReadOptions", role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a CSV file, the same in either role.

    Raises
    ------
    InputError
        See `tgospa_eval.formats.read`.
    """
    check_text(data, path)
    # A large ASCII file needs no decoding unless it takes the careful way.
    large = len(data) >= SIZE
    whole = not (large and data.isascii() and b"\n" in data[:HEAD])
    header, first, _ = _header(decode(data if whole else data[:HEAD], path), path)
    delimiter = _delimiter(header, options.decimal)
    names = [name.strip() for name in next(csv.reader([header], delimiter=delimiter))]
    roles = find_roles(names, options, f"{path}, line {first - 1}")
    if large:
        rows = read_bulk(path, data, first, delimiter, len(names), roles, options.decimal)
        if rows is not None:
            return rows
    text = decode(data, path)
    body = text[_header(text, path)[2] :]
    columns, lines = tokenise(body, delimiter, len(names), path, first)
    return convert(columns, roles, options.decimal, Places(path=path, lines=lines, names=names))


def _header(text: str, path: str) -> tuple[str, int, int]:
    """First line with content, the number of the line after it, and where that begins."""
    line, start = 1, 0
    while start < len(text):
        stop = text.find("\n", start)
        stop = len(text) if stop < 0 else stop
        if text[start:stop].strip():
            return text[start:stop], line + 1, stop + 1
        line, start = line + 1, stop + 1
    raise InputError(f"{path}: blank lines only; a set without objects is a header alone")


def _delimiter(header: str, decimal: str) -> str:
    """The most frequent delimiter outside quotes; the decimal mark only if there is no other."""
    plain = re.sub(r'"[^"]*"', "", header)
    return max(
        DELIMITERS,
        key=lambda mark: (mark != decimal, plain.count(mark)) if plain.count(mark) else (False, 0),
    )


def tokenise(
    body: str, delimiter: str, width: int, path: str, first_line: int
) -> tuple[list[list[str]], Sequence[int]]:
    """The columns of the table, and the line of every row."""
    body = body.rstrip("\n")
    if not body:
        return [[] for _ in range(width)], []
    blank = width == 1 and "\n\n" in body
    if '"' not in body and not blank and is_regular(body.encode(), 0, delimiter, width):
        fields = body.replace("\n", delimiter).split(delimiter)
        return [fields[k::width] for k in range(width)], range(
            first_line, first_line + len(fields) // width
        )
    return _tokenise_slowly(body, delimiter, width, path, first_line)


def _tokenise_slowly(
    body: str, delimiter: str, width: int, path: str, first_line: int
) -> tuple[list[list[str]], list[int]]:
    """Quotes, blank lines and rows of the wrong length, through the csv module."""
    rows: list[list[str]] = []
    lines: list[int] = []
    wrong: list[tuple[int, int]] = []
    begin = first_line
    reader = csv.reader(io.StringIO(body, newline=""), delimiter=delimiter, strict=True)
    try:
        for row in reader:
            if row and (len(row) > 1 or row[0].strip()):
                if len(row) == width:
                    rows.append(row)
                    lines.append(begin)
                else:
                    wrong.append((begin, len(row)))
            begin = first_line + reader.line_num
    except csv.Error as error:
        raise InputError(
            f"{path}, line {begin}: {error}; close quotes, and double those inside a field"
        ) from None
    if wrong:
        line, found = wrong[0]
        raise InputError(
            f"{path}, line {line}: {found} {'field' if found == 1 else 'fields'}, "
            f"the header has {width}{more(len(wrong))}; give every row one field per column"
        )
    return [[row[k] for row in rows] for k in range(width)], lines
