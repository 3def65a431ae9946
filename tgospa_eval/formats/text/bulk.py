"""Large and regular files of text through the C parser of pandas.

A quick way only: whatever is not plainly right (a quote inside a field, blank lines, a row too
short, a text that is no number) is left to the reader of the format, which reports what is wrong
and where.
"""

import io
import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.files import STDIN
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.formats.attributes import attribute_of
from tgospa_eval.formats.columns.roles import Roles
from tgospa_eval.formats.fields import Coded, is_number
from tgospa_eval.formats.guess import COMMENTS
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text.convert import blanks, coded_times, numbered
from tgospa_eval.formats.times import EXACT_BELOW, TimeError, Times

if TYPE_CHECKING:
    import pandas as pd

Columns = dict[int, "pd.Series"]
"""Of a table, by number."""

BULK_BYTES = 4_000_000
"""Bytes from which importing pandas pays."""

CHECKED = 1 << 12
"""Bytes by which a file is known to hold what was read."""

BYTES_TOGETHER = 1 << 24
"""Bytes that are looked at together."""

COMMENTED = rb"\n[ \t]*\"?[ \t]*(?:#|%|//)"
"""A row that begins like a comment; a slow search, for files with such letters."""

ODD_BLANKS = (b"\t", b"\v", b"\f", b"\x1c", b"\x1d", b"\x1e", b"\x1f")


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How the rows of a file are laid out.

    Parameters
    ----------
    path : str
        The file: pandas reads it twice as fast from there as from memory.
    first : int
        Line of the first row.
    delimiter : str
        Between fields.
    width : int
        Number of columns.
    header : bool
        Tables may quote their fields. Rows without a header have no quotes, and blanks around
        fields mean nothing.
    on_disk : bool
        The file is what is read, not its unpacked content.
    """

    path: str
    first: int
    delimiter: str
    width: int
    header: bool = True
    on_disk: bool = True


class IrregularError(Exception):
    """The file is not plainly right; its reader reports what is wrong, if anything."""


def read_bulk(
    data: bytes,
    layout: Layout,
    roles: Roles,
    decimal: str,
    *,
    texts: Sequence[int] = (),
    name_id: Callable[[str], str] = str.strip,
) -> tuple[Rows, dict[int, Coded]] | None:
    """The rows of the file, or None if it is irregular.

    Parameters
    ----------
    data : bytes
        Its content.
    layout : Layout
        How its rows are laid out.
    roles : Roles
        Which column is what.
    decimal : str
        Decimal mark.
    texts : sequence of int
        Columns to be returned as texts.
    name_id : callable
        Text of an id to its name.
    """
    klass = () if roles.klass is None else (roles.klass,)
    text_columns = tuple(dict.fromkeys((*texts, *klass, *roles.texts)))
    used = [roles.id, roles.time, *roles.numbers, *text_columns]
    if len(set(used)) < len(used):
        return None
    layout = replace(layout, on_disk=_is_on_disk(layout.path, data))
    try:
        start = _first_byte(data, layout)
        if not _is_plain(data, start, layout):
            return None
        columns = _columns(data, start, layout, roles, decimal, text_columns)
        coded = {column: _coded(columns.pop(column)) for column in text_columns}
        if _in_doubt(columns, coded, layout, roles) and not is_regular(
            data, start, layout.delimiter, layout.width
        ):
            return None
        times = _times(columns.pop(roles.time), decimal)
        ids = numbered(_coded(columns.pop(roles.id)), name_id)
    except IrregularError:
        return None
    numbers = np.empty((len(times.value), len(roles.numbers)), order="F")
    for k, column in enumerate(roles.numbers):
        numbers[:, k] = columns.pop(column).to_numpy()
    if np.isinf(numbers).any() or len(blanks(ids)):
        return None
    answer = Rows(
        name=layout.path,
        roles=roles,
        ids=ids,
        times=times,
        numbers=numbers,
        where=lambda row: f"{layout.path}, line {layout.first + row}",
        classes=None if roles.klass is None else numbered(coded[roles.klass]),
        attributes={column: attribute_of(coded[column], decimal) for column in roles.texts},
    )
    return answer, {column: coded[column] for column in texts}


def _is_on_disk(path: str, data: bytes) -> bool:
    """Whether a file has this very content: not a pipe, nor what it was unpacked from."""
    if path == STDIN or not Path(path).is_file():
        return False
    with open(path, "rb") as file:
        return os.fstat(file.fileno()).st_size == len(data) and data.startswith(file.read(CHECKED))


def _first_byte(data: bytes, layout: Layout) -> int:
    """Where the first row begins."""
    start = 0
    for _ in range(layout.first - 1):
        start = data.find(b"\n", start) + 1
    if (layout.first > 1 and start == 0) or start == len(data):  # only a header
        raise IrregularError
    return start


def _columns(
    data: bytes, start: int, layout: Layout, roles: Roles, decimal: str, text_columns: Sequence[int]
) -> Columns:
    """All rows, with numbered columns: ids as integers where these are their very texts."""
    stop = data.find(b"\n", start)
    first_row = data[start : stop if stop >= 0 else len(data)]
    # pandas drops one empty field too many in the first row.
    if first_row.count(layout.delimiter.encode()) != layout.width - 1:
        raise IrregularError
    kinds: dict[int, type | str] = dict.fromkeys(text_columns, object)
    kinds |= dict.fromkeys(roles.numbers, "float64")
    moment = first_row.decode("utf-8", "replace").split(layout.delimiter)[roles.time]
    if not is_number(moment.strip().strip('"'), decimal):
        kinds[roles.time] = object
    columns = None
    if roles.id == 0:
        with suppress(IrregularError):
            columns = _parse(data, layout, kinds | {roles.id: "int64"}, roles, decimal)
        if columns is not None and not _are_plain_integers(
            data, start, columns[0], layout.delimiter
        ):
            columns = None
    if columns is None:
        columns = _parse(data, layout, kinds | {roles.id: object}, roles, decimal)
    if len(columns[roles.time]) != data.count(b"\n", start) + (not data.endswith(b"\n")):
        raise IrregularError
    if roles.time not in kinds and columns[roles.time].dtype not in (np.int64, np.float64):
        raise IrregularError
    return columns


def _in_doubt(columns: Columns, coded: dict[int, Coded], layout: Layout, roles: Roles) -> bool:
    """Whether a row may have had too many or too few fields: as the delimiters show.

    With all columns in use a row that is too long makes the parser fail, and one that is too short
    has no last field: NaN in a number, "" in a text; ids and times that are blank are refused.
    """
    return (
        not layout.header
        or len(columns) + len(coded) < layout.width
        or any(columns[column].isna().any() for column in roles.numbers)
        or any("" in column.distinct for column in coded.values())
    )


def is_regular(data: bytes, start: int, delimiter: str, width: int) -> bool:
    """Whether every line from byte `start` on has `width` fields; no quotes around delimiters."""
    row = delimiter.encode() * (width - 1) + b"\n"
    others = bytes(set(range(256)) - {ord(delimiter), ord("\n")})
    for view in _blocks(data, start):
        marks = view.tobytes().translate(None, others)
        if len(view) and view[-1] != ord("\n"):
            marks += b"\n"
        if marks != row * (len(marks) // width):
            return False
    return True


def _blocks(data: bytes, start: int) -> Iterator[NDArray[np.uint8]]:
    """The bytes from `start` on in whole lines."""
    while start < len(data):
        stop = data.find(b"\n", start + BYTES_TOGETHER) + 1 or len(data)
        yield np.frombuffer(data, np.uint8, stop - start, start)
        start = stop


def _is_plain(data: bytes, start: int, layout: Layout) -> bool:
    """Whether pandas and the careful way split lines and fields alike."""
    if b"\r" in data and data.count(b"\r") != data.count(b"\r\n"):
        return False
    # pandas takes True for 1. (One letter first: that search is ten times as fast.)
    for letter, word in ((b"u", b"rue"), (b"U", b"RUE"), (b"l", b"alse"), (b"L", b"ALSE")):
        if letter in data and word in data:
            return False
    if layout.header:
        commented = any(mark.encode() in data for mark in COMMENTS)
        if commented and re.compile(COMMENTED).search(data, start - 1):
            return False
        if b'"' not in data:
            return True
        if any(line.count(b'"') % 2 for line in data[:start].split(b"\n")):
            return False
        return data.find(b'"', start) < 0 or _is_plainly_quoted(data, start, layout.delimiter)
    return b'"' not in data and _is_plainly_separated(data, layout.delimiter)


def _is_plainly_quoted(data: bytes, start: int, delimiter: str) -> bool:
    """Whether quotes are around whole fields only, without delimiters, line ends or quotes inside.

    Without them the file would be the same table.
    """
    for view in _blocks(data, start):
        at = np.flatnonzero((view == ord('"')) | (view == ord(delimiter)) | (view == ord("\n")))
        marks = view[at]
        quotes = np.flatnonzero(marks == ord('"'))
        if len(quotes) % 2:
            return False
        opening, closing = quotes[::2], quotes[1::2]
        if (closing != opening + 1).any():
            return False
        ended = np.append(view, np.uint8(ord("\n")))
        before, after = ended[at[opening] - 1], ended[at[closing] + 1]  # [-1] is a line end
        if not ((before == ord(delimiter)) | (before == ord("\n"))).all():
            return False
        if not ((after == ord(delimiter)) | (after == ord("\n")) | (after == ord("\r"))).all():
            return False
    return True


def _is_plainly_separated(data: bytes, delimiter: str) -> bool:
    """Whether lines without a header are split by their delimiter only, and end in no other."""
    if not data.isascii() or any(blank in data for blank in ODD_BLANKS):
        return False
    if delimiter == " " and (
        b"," in data or b"  " in data or b"\n " in data or data.startswith(b" ")
    ):
        return False
    return not (
        any(mark + end in data for mark in (b",", b" ") for end in (b"\n", b"\r"))
        or data.endswith((b",", b" "))
    )


def _are_plain_integers(data: bytes, start: int, column: "pd.Series", delimiter: str) -> bool:
    """Whether the integers read are the very texts of the first fields: not 007, not 1.0."""
    values = column.to_numpy()
    row = 0
    for view in _blocks(data, start):
        ends = np.flatnonzero(view == ord("\n"))
        begins = np.append(0, ends + 1)
        begins = begins[begins < len(view)]
        value = values[row : row + len(begins)]
        row += len(begins)
        if len(value) != len(begins) or value.min() < 0:
            return False
        digits = np.searchsorted(10 ** np.arange(1, 19), value, side="right") + 1
        ends = begins + digits
        if ends[-1] >= len(view) or not (view[ends] == ord(delimiter)).all():
            return False
        for place in range(digits.max()):
            text = view[begins[digits > place] + place]
            if not ((text >= ord("0")) & (text <= ord("9"))).all():
                return False
    return row == len(values)


def _parse(
    data: bytes, layout: Layout, kinds: dict[int, type | str], roles: Roles, decimal: str
) -> Columns:
    """The table with numbered columns."""
    import pandas as pd  # here: small files do without it

    is_exact = tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1)  # whatever is asked for
    used = {roles.time, *kinds}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            frame: pd.DataFrame = pd.read_csv(  # type: ignore[call-overload]
                layout.path if layout.on_disk else io.BytesIO(data),
                skiprows=layout.first - 1,
                sep=layout.delimiter,
                decimal=decimal,
                header=None,
                names=list(range(layout.width)),
                index_col=False,
                # Only where it is needed: it costs as much as the parsing.
                usecols=sorted(used) if len(used) < layout.width else None,
                dtype=kinds,
                keep_default_na=False,
                na_values={column: ["", "nan", "NaN"] for column in roles.numbers},
                encoding="utf-8",
                compression=None,
                engine="c",
                float_precision=None if is_exact else "round_trip",
            )
    except (ValueError, OverflowError, Warning):  # so are ParserError and UnicodeDecodeError
        raise IrregularError from None
    return {int(str(name)): column for name, column in frame.items()}


def _coded(column: "pd.Series") -> Coded:
    """The column as texts, of which none may be missing."""
    import pandas as pd

    code, found = pd.factorize(column)
    if (code < 0).any():
        raise IrregularError
    return Coded([str(text) for text in found], code)


def _times(column: "pd.Series", decimal: str) -> Times:
    """Times of a column of texts or numbers."""
    if column.dtype == object:
        try:
            return coded_times(_coded(column), decimal)
        except TimeError:
            raise IrregularError from None
    value = column.to_numpy()
    if value.dtype == np.float64:
        if not (np.abs(value) < EXACT_BELOW).all():
            raise IrregularError
        value = value + 0.0  # -0.0 is the same step as 0.0
    return Times(value=value, clock="number", text=None)
