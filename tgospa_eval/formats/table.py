"""CSV tables: ``id,t,x[,y[,z]]`` and other columns, one row per object and step.

Parsed here and not by pandas, for exact floats, exact integers, messages that name the line, and a
start without importing pandas; only large regular files take the quick way of
`tgospa_eval.formats.bulk`. Files without quotes, the common case, are split in one call after the
delimiters of every line were counted; others go through the csv module.
"""

import csv
import io
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.errors import InputError
from tgospa_eval.formats import Reading, ReadOptions
from tgospa_eval.formats.assemble import assemble, number_ids
from tgospa_eval.formats.bulk import SIZE, is_regular, read_bulk
from tgospa_eval.formats.columns import Roles, find_roles
from tgospa_eval.formats.times import TimeError, Times, more, parse_times, quoted, remedy_for
from tgospa_eval.trajectories import Floats, Ints

DELIMITERS = ",;\t"

HEAD = 1 << 16
"""Bytes in which the header of a large file is looked for."""


def read_table(path: str, options: ReadOptions) -> Reading:
    """Read a CSV file.

    Raises
    ------
    InputError
        See `tgospa_eval.formats.read`.
    """
    data = _load(path)
    # A large ASCII file needs no decoding unless it takes the careful way.
    large = len(data) >= SIZE
    whole = not (large and data.isascii() and b"\n" in data[:HEAD])
    header, first, _ = _header(_decode(data if whole else data[:HEAD], path), path)
    delimiter = _delimiter(header, options.decimal)
    names = [name.strip() for name in next(csv.reader([header], delimiter=delimiter))]
    roles = find_roles(names, options.columns, f"{path}, line {first - 1}")
    lines: Sequence[int]
    table = None
    if large:
        table = read_bulk(path, data, first, delimiter, len(names), roles, options.decimal)
    if table is not None:
        lines = range(first, first + len(table[2]))
    else:
        text = _decode(data, path)
        columns, lines = _tokenise(
            text[_header(text, path)[2] :], delimiter, len(names), path, first
        )
        places = _Places(path=path, lines=lines, names=names)
        table = _convert(columns, roles, options.decimal, places)
    ids, times, state = table
    trajectories, notices, left_out = assemble(
        ids=ids,
        times=times,
        state=state,
        names=roles.names,
        on_duplicate=options.on_duplicate,
        where=_Places(path=path, lines=lines, names=names).row,
    )
    if roles.unused:
        notices.insert(0, f"columns not used: {', '.join(roles.unused)}")
    return Reading(
        trajectories=trajectories, rows=len(state), notices=tuple(notices), left_out=left_out
    )


@dataclass(frozen=True, kw_only=True)
class _Places:
    """Says where something is."""

    path: str
    lines: Sequence[int]
    names: Sequence[str]

    def row(self, row: int) -> str:
        return f"{self.path}, line {self.lines[row]}"

    def field(self, row: int, column: int) -> str:
        return f'{self.row(row)}, column "{self.names[column]}"'


def _convert(
    columns: list[list[str]], roles: Roles, decimal: str, places: _Places
) -> tuple[tuple[NDArray[np.object_], Ints], Times, Floats]:
    """Ids with the number of each row's, times and states; all mistakes in one error."""
    problems: list[str] = []
    ids = [text.strip() for text in columns[roles.id]]
    if "" in ids:
        place = places.field(ids.index(""), roles.id)
        problems.append(f"{place}: blank id{more(ids.count(''))}; name the object")
    state = np.empty((len(ids), len(roles.state)))
    for k, column in enumerate(roles.state):
        state[:, k], wrong = _numbers(columns[column], decimal)
        problems += [f"{places.field(row, column)}: {message}" for row, message in wrong]
    try:
        times = parse_times(columns[roles.time], lambda texts: _floats(texts, decimal))
    except TimeError as error:
        problems.append(f"{places.field(error.row, roles.time)}: {error}")
    if problems:
        raise InputError("\n".join(problems))
    return number_ids(ids), times, state


def _load(path: str) -> bytes:
    """The bytes of a file that can be text."""
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        if os.path.isdir(path):  # Windows says "permission denied"
            raise InputError(f"{path}: is a folder, not a file") from None
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', error)}") from None
    if not data:
        raise InputError(f"{path}: the file is empty; a set without objects is a header alone")
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(f"{path}, line 1: UTF-16 text; save the file as UTF-8")
    if 0 in data:
        line = data.count(b"\n", 0, data.index(0)) + 1
        raise InputError(f"{path}, line {line}: binary data, not text; a CSV file is needed")
    return data


def _decode(data: bytes, path: str) -> str:
    """The text, with one kind of line end."""
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


def _tokenise(
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


def _floats(texts: Sequence[str], decimal: str) -> Floats:
    """The exact doubles of a whole column; ValueError unless every text is a number."""
    joined = "".join(texts)
    if "_" in joined or not joined.isascii():  # float() takes 1_000 and digits of any script
        raise ValueError
    if decimal == ",":
        if "." in joined:
            raise ValueError
        texts = [text.replace(",", ".") for text in texts]
    return np.array(list(map(float, texts)), dtype=np.float64)


def _numbers(texts: Sequence[str], decimal: str) -> tuple[Floats, list[tuple[int, str]]]:
    """A column of numbers, NaN where blank; and the first row of each kind of mistake."""
    wrong: list[int] = []
    try:
        values = _floats(texts, decimal)
    except ValueError:
        values = np.full(len(texts), np.nan)
        for row, text in enumerate(texts):
            try:
                values[row] = _floats([text], decimal)[0]
            except ValueError:
                if text.strip():
                    wrong.append(row)
    infinite = np.flatnonzero(np.isinf(values)).tolist()
    mistakes = []
    for rows, what, remedy in (
        (wrong, "not a number", remedy_for),
        (infinite, "infinite", lambda _: "leave it blank where the object is absent"),
    ):
        if rows:
            text = texts[rows[0]]
            mistakes.append((rows[0], f"{what}: {quoted(text)}{more(len(rows))}; {remedy(text)}"))
    return values, mistakes
