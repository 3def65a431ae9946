"""CSV files in parts: cut at line ends, or unpacked as they are read."""

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial

from tgospa_eval.common.files import CHUNK, named
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.roles import Roles
from tgospa_eval.formats.loading import PACKED_FROM, is_packed, unpacking
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text.scan import HEADER_BYTES, check_text, decode
from tgospa_eval.formats.text.table import header_of, read_table, with_decimal
from tgospa_eval.partitioned.input.listing import File
from tgospa_eval.text import visible


@dataclass(frozen=True, kw_only=True, eq=False)
class Head:
    """The begin of a CSV file.

    Parameters
    ----------
    content : bytes
        Up to the end of the header.
    roles : Roles
        Which column is what.
    decimal : str
        Decimal mark of its numbers.
    packed : bool
        Whether the file is compressed.
    """

    content: bytes
    roles: Roles
    decimal: str
    packed: bool


def read_head(file: File, options: ReadOptions) -> Head:
    """Understand the begin of a CSV file.

    Raises
    ------
    InputError
        It is no table, or lacks columns.
    """
    path = file.path
    with named(path, InputError), open(file.place, "rb") as source:
        packed = is_packed(source.read(PACKED_FROM))
    with unpacking(file.place, path) as stream:
        data = stream.read(HEADER_BYTES)
        data += stream.readline() if data else b""
    check_text(data, path)
    if b"\r" in data and b"\n" not in data:
        raise InputError(
            f"{path}: lines end in carriage returns alone, and such a file is not read in parts; "
            "save it with line feeds"
        )
    text = decode(data, path)
    _, roles, delimiter, first, start = header_of(text, path, options)
    roles, decimal = with_decimal(text[start:], delimiter, roles, options.decimal)
    begin = 0
    for _ in range(first - 1):
        begin = data.find(b"\n", begin) + 1 or len(data)
    content = data[:begin]
    if not content.endswith(b"\n"):
        content += b"\n"  # a header alone
    return Head(content=content, roles=roles, decimal=decimal, packed=packed)


def text_rows(file: File, begin: int, end: int, options: ReadOptions) -> Iterator[tuple[Rows, int]]:
    """Rows of the lines that begin between two bytes, and the number of the first among them.

    A compressed file is read whole, so many bytes at a time.

    Raises
    ------
    InputError
        A row is wrong; the message has its line in the file.
    """
    head = read_head(file, options)
    known = replace(options, decimal=head.decimal)
    pieces = _unpacked(file, head, end) if head.packed else _cut(file, head, begin, end)
    first = 0
    for content, lines_before in pieces:
        moved = partial(_moved, file.path, head.content.count(b"\n"), lines_before)
        try:
            rows = read_table(file.path, head.content + content, known, "truth", given=True)
        except InputError as error:
            raise InputError(*(moved(line) for line in error.args)) from None
        yield replace(rows, where=_Where(rows.where, moved)), first
        first += len(rows.times.value)


@dataclass(frozen=True)
class _Where:
    """Where a row is in the whole file."""

    in_piece: Callable[[int], str]
    moved: Callable[[str], str]

    def __call__(self, row: int) -> str:
        return self.moved(self.in_piece(row))


def _moved(path: str, header: int, lines_before: Callable[[], int], message: str) -> str:
    """A message with the line in the file in place of that in the piece."""

    def line(found: re.Match[str]) -> str:
        number = int(found[2])
        return f"{found[1]}{number if number <= header else number + lines_before()}"

    return re.sub(rf"({re.escape(visible(path))}, line )(\d+)", line, message)


Cut = tuple[bytes, Callable[[], int]]
"""Lines, and how many are between the header and them."""


def _cut(file: File, head: Head, begin: int, end: int) -> Iterator[Cut]:
    """The lines that begin between two bytes of a file."""
    start = max(begin, len(head.content))
    with named(file.path, InputError), open(file.place, "rb") as source:
        if start > len(head.content):
            source.seek(start - 1)
            start += len(source.readline()) - 1
        source.seek(start)
        content = source.read(end - start) if start < end else b""
        if content and not content.endswith(b"\n"):
            content += source.readline()
    if content:
        yield content, cache(partial(_lines, file, len(head.content), start))


def _lines(file: File, begin: int, end: int) -> int:
    """Lines between two bytes of a file."""
    count = 0
    with named(file.path, InputError), open(file.place, "rb") as source:
        source.seek(begin)
        while begin < end and (content := source.read(min(CHUNK, end - begin))):
            count += content.count(b"\n")
            begin += len(content)
    return count


def _unpacked(file: File, head: Head, size: int) -> Iterator[Cut]:
    """All lines of a compressed file, so many bytes at a time."""
    before = 0
    with unpacking(file.place, file.path) as stream:
        stream.read(len(head.content))
        while content := stream.read(size):
            content += stream.readline()
            yield content, partial(int, before)
            before += content.count(b"\n")


def size_of(file: File) -> int:
    """Bytes of a file as it is stored."""
    with named(file.path, InputError):
        return os.path.getsize(file.place)
