"""Rows of a piece of a file: lines of a CSV file, row groups of a Parquet file."""

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.files import CHUNK, named
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.formats.arrow import arrow_rows, check_types, readable
from tgospa_eval.formats.loading import PACKED_FROM, check_parquet, is_packed, unpacking
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.roles import Roles, find_roles
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text.lines import HEADER_BYTES, check_text, decode
from tgospa_eval.formats.text.table import header_of, read_table, with_decimal
from tgospa_eval.partitioned.input.listing import File
from tgospa_eval.text import visible

if TYPE_CHECKING:
    import pyarrow as pa


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


Moved = Callable[[str], str]
"""A message about a piece as one about the file."""


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
        moved: Moved = partial(_moved, file.path, head.content.count(b"\n"), lines_before)
        try:
            rows = read_table(file.path, head.content + content, known, "truth", given=True)
        except InputError as error:
            raise InputError(*(moved(line) for line in error.args)) from None

        def where(
            row: int, in_piece: Callable[[int], str] = rows.where, moved: Moved = moved
        ) -> str:
            return moved(in_piece(row))

        yield replace(rows, where=where), first
        first += len(rows.times.value)


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


DECODED = 1 << 17
"""Rows that are decoded together."""

BYTES_OF_COLUMN = 1 << 20
"""Bytes of a column that are read together: a row group may be larger than memory."""


def table_rows(
    file: File, begin: int, end: int, options: ReadOptions
) -> Iterator[tuple[Rows, int]]:
    """Rows of some row groups of a Parquet file, and the number of the first among them.

    Raises
    ------
    InputError
        The file is damaged, or a value is wrong; the message has its row in the file.
    """
    content, schema, roles = open_table(file, options)
    columns = [schema.names[column] for column in roles.used]
    row = sum(content.metadata.row_group(group).num_rows for group in range(begin))
    for table in _batches(file, content, range(begin, end), columns):
        where = partial(_row_of, file.path, row)
        yield arrow_rows(file.path, "Parquet", schema, table.select, options, where), row
        row += len(table)


def _row_of(path: str, first: int, row: int) -> str:
    return f"{path}, row {first + row}"


def _batches(
    file: File, content: "pa.parquet.ParquetFile", groups: range, columns: list[str]
) -> "Iterator[pa.Table]":
    """The columns of row groups, some rows at a time; those of folders that the file lacks too."""
    import pyarrow as pa

    own = [name for name in columns if name in content.schema_arrow.names]
    keys = {key: text for key, text in file.keys if key in columns and key not in own}
    with readable(file.path, "Parquet"):
        for batch in content.iter_batches(
            batch_size=DECODED, row_groups=groups, columns=own, use_threads=False
        ):
            table = pa.Table.from_batches([batch])
            for key, text in keys.items():
                code = pa.array(np.zeros(len(batch), np.int32))
                column = pa.DictionaryArray.from_arrays(code, pa.array([text]))
                table = table.append_column(key, column)
            yield table


def open_table(
    file: File, options: ReadOptions
) -> "tuple[pa.parquet.ParquetFile, pa.Schema, Roles]":
    """Open a Parquet file and understand its columns.

    Returns
    -------
    pyarrow.parquet.ParquetFile
        What it has.
    pyarrow.Schema
        Its columns, then those of the folders that it is in, if they are needed.
    Roles
        Which column is what.

    Raises
    ------
    InputError
        It is no Parquet, or lacks columns.
    ConfigError
        pyarrow is not installed.
    """
    check_parquet(begin=f"{file.path}: ")
    import pyarrow as pa  # lazy: the extra may be missing
    import pyarrow.parquet as pq

    with named(file.path, InputError):
        if not os.path.getsize(file.place):
            raise InputError(
                f"{file.path}: the file is empty; a part without objects has a schema and no rows"
            )
    with readable(file.path, "Parquet"):
        content = pq.ParquetFile(file.place, buffer_size=BYTES_OF_COLUMN, pre_buffer=False)
        schema = content.schema_arrow
    keys = [pa.field(key, pa.string()) for key, _ in file.keys if key not in schema.names]
    whole = pa.schema([*schema, *keys])
    try:
        roles = find_roles(list(schema.names), options, file.path)
        absent = {*options.attributes} - {*roles.attributes}
        if roles.klass is None and options.classes is not None:
            absent.add("class")
        if keys and absent:
            raise InputError  # they may be a folder's
        whole = schema
    except InputError:
        if not keys:
            raise
        roles = find_roles(list(whole.names), options, file.path)
    check_types(whole, roles, file.path)
    return content, whole, roles


@dataclass(frozen=True, kw_only=True)
class FilePiece:
    """What of a file is read at once: row groups, or the lines of a text that begin in some bytes.

    Parameters
    ----------
    file : File
        The file.
    begin, end : int
        Row groups, or bytes.
    text : bool
        Whether it is a text.
    """

    file: File
    begin: int
    end: int
    text: bool

    def rows(self, options: ReadOptions) -> Iterator[tuple[Rows, int]]:
        """Its rows, some at a time, and the number of the first: in a table, in a piece of text."""
        return (text_rows if self.text else table_rows)(self.file, self.begin, self.end, options)

    def where(self, row: int, options: ReadOptions) -> str:
        """Where a row is, for messages: of a table by its place there, of a text in the piece."""
        if not self.text:
            return _row_of(self.file.path, 0, row)
        for rows, first in self.rows(options):
            if row < first + len(rows.times.value):
                return rows.where(row - first)
        return self.file.path  # it has changed meanwhile
