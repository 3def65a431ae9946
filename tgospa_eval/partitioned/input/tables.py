"""Parquet files in parts: times of a row group, rows of a range of time, batch by batch."""

import os
import re
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.files import CHUNK, named
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.arrow import arrow_rows, check_dates, check_types, readable
from tgospa_eval.formats.columns.headers import Roles, find_roles
from tgospa_eval.formats.fields import Coded
from tgospa_eval.formats.loading import PACKED_FROM, is_packed, unpacking, unreadable
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text.scan import HEADER_BYTES, check_text, decode
from tgospa_eval.formats.text.table import header_of, read_table, with_decimal
from tgospa_eval.formats.times import TimeError, Times, coded_times
from tgospa_eval.partitioned.input.listing import File
from tgospa_eval.text import visible
from tgospa_eval.tracks.trajectories import Ints

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


DECODED = 1 << 17
"""Rows that are decoded together."""

BYTES_OF_COLUMN = 1 << 20
"""Bytes of a column that are read together: a row group may be larger than memory."""

Span = tuple[int | float, int | float]
"""The first and the last time of a range, as the files have them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ParquetTable:
    """A Parquet file, opened.

    Parameters
    ----------
    file : File
        Which.
    content : pyarrow.parquet.ParquetFile
        What it has.
    schema : pyarrow.Schema
        Its columns, then those of the folders that it is in, if they are needed.
    roles : Roles
        Which column is what.
    """

    file: File
    content: "pa.parquet.ParquetFile"
    schema: "pa.Schema"
    roles: Roles

    @property
    def groups(self) -> list[int]:
        """Rows of each row group."""
        metadata = self.content.metadata
        return [metadata.row_group(k).num_rows for k in range(metadata.num_row_groups)]

    def batches(self, group: int, columns: list[str]) -> "Iterator[pa.ParquetTable]":
        """The columns of a row group, some rows at a time.

        Raises
        ------
        InputError
            The file is damaged.
        """
        import pyarrow as pa

        own = [name for name in columns if name in self.content.schema_arrow.names]
        keys = {key: text for key, text in self.file.keys if key in columns and key not in own}
        with readable(self.file.path, "Parquet"):
            found = self.content.iter_batches(
                batch_size=DECODED, row_groups=[group], columns=own, use_threads=False
            )
            for batch in found:
                table = pa.Table.from_batches([batch])
                for key, text in keys.items():
                    code = pa.array(np.zeros(len(batch), np.int32))
                    column = pa.DictionaryArray.from_arrays(code, pa.array([text]))
                    table = table.append_column(key, column)
                yield table.select(columns)

    def times(self, group: int, options: ReadOptions) -> Iterator[Times]:
        """The times of a row group, some rows at a time."""
        header = self.schema.names[self.roles.time]
        row = sum(self.groups[:group])
        for table in self.batches(group, [header]):
            yield times_of(table, self.file.path, options.decimal, row, labelled=True)
            row += len(table)

    def chunks(
        self, group: int, options: ReadOptions, span: Span | None = None
    ) -> "Iterator[Chunk]":
        """Rows of a row group, all or those of a range of time, these without texts of times."""
        names, roles = self.schema.names, self.roles
        others = {roles.id, *roles.numbers} | ({roles.klass} if roles.klass is not None else set())
        subset = [names[column] for column in sorted({*others, roles.time})]
        header, path, row = names[roles.time], self.file.path, sum(self.groups[:group])
        for table in self.batches(group, subset):
            first, row = row, row + len(table)
            place: Ints | range = range(first, row)
            labelled = span is None
            times = times_of(
                table.select([header]), path, options.decimal, first, labelled=labelled
            )
            schema = self.schema
            if roles.time not in others:  # which are understood once
                table, schema = _with_times(table, schema, header, times)
            if span is not None:
                chosen = np.flatnonzero((times.value >= span[0]) & (times.value <= span[1]))
                if not len(chosen):
                    continue
                table, place = _taken(table, chosen), first + chosen
            yield Chunk(table=table, schema=schema, path=path, place=place, times=times)


@dataclass(frozen=True, kw_only=True, eq=False)
class Chunk:
    """Some rows of a file.

    Parameters
    ----------
    table : pyarrow.ParquetTable
        The columns in use.
    schema : pyarrow.Schema
        All columns of the file.
    path : str
        The file.
    place : sequence of int
        Which row of the file each is.
    times : Times
        Of these rows and those beside them that are not in a range of time.
    """

    table: "pa.Table"
    schema: "pa.Schema"
    path: str
    place: Ints | range
    times: Times


def rows_of_chunks(chunks: Sequence[Chunk], options: ReadOptions) -> Iterator[Rows]:
    """Their rows in order; those of files with the same schema are converted together.

    Raises
    ------
    InputError
        A value is wrong.
    """
    together: list[Chunk] = []
    for chunk in chunks:
        if together and not _is_alike(chunk, together[0]):
            yield _converted(together, options)
            together = []
        together.append(chunk)
    if together:
        yield _converted(together, options)


def _is_alike(chunk: Chunk, other: Chunk) -> bool:
    """Whether the rows of two chunks can be converted together."""
    return chunk.times.clock == other.times.clock and bool(chunk.schema.equals(other.schema))


def _converted(chunks: Sequence[Chunk], options: ReadOptions) -> Rows:
    """Rows of chunks with the same schema."""
    import pyarrow as pa

    ends = list(accumulate(len(chunk.place) for chunk in chunks))

    def where(row: int) -> str:
        at = bisect_right(ends, row)
        begin = ends[at - 1] if at else 0
        return f"{chunks[at].path}, row {chunks[at].place[row - begin]}"

    table = pa.concat_tables([chunk.table for chunk in chunks]).unify_dictionaries()
    first = chunks[0]
    rows = arrow_rows(first.path, "Parquet", first.schema, table.select, options, where)
    return replace(rows, times=replace(rows.times, clock=first.times.clock, text=None))


def open_table(file: File, options: ReadOptions) -> ParquetTable:
    """Open a Parquet file and understand its columns.

    Raises
    ------
    InputError
        It is no Parquet, or lacks columns.
    ConfigError
        pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # here: the extra may be missing
        import pyarrow.parquet as pq
    except ModuleNotFoundError:
        raise ConfigError(
            f"{file.path}: Parquet files need the extra parquet: {install('parquet')}"
        ) from None
    with named(file.path, InputError):
        if not os.path.getsize(file.place):
            raise InputError(
                f"{file.path}: the file is empty; a part without objects has a schema and no rows"
            )
    try:
        content = pq.ParquetFile(file.place, buffer_size=BYTES_OF_COLUMN, pre_buffer=False)
        schema = content.schema_arrow
    except (pa.ArrowException, OSError, ValueError) as error:
        raise unreadable(file.path, "Parquet", error) from None
    keys = [pa.field(key, pa.string()) for key, _ in file.keys if key not in schema.names]
    whole = pa.schema([*schema, *keys])
    try:
        roles = find_roles(list(schema.names), options, file.path)
        if roles.klass is None and options.classes is not None and keys:
            raise InputError  # the class may be a folder's
        whole = schema
    except InputError:
        if not keys:
            raise
        roles = find_roles(list(whole.names), options, file.path)
    check_types(whole, roles, file.path)
    return ParquetTable(file=file, content=content, schema=whole, roles=roles)


def times_of(table: "pa.Table", path: str, decimal: str, first: int, *, labelled: bool) -> Times:
    """The times of a table with that column alone; their texts only if they are to be `labelled`.

    `first` is the row of the file that the table begins at.

    Raises
    ------
    InputError
        One is no time.
    """
    import pyarrow as pa

    from tgospa_eval.formats.frames import frame_times  # here: pandas is slow to import

    def where(row: int) -> str:
        return f"{path}, row {first + row}"

    column = table.column(0)
    plain = pa.types.is_int64(column.type) or pa.types.is_float64(column.type)
    if plain and not column.null_count and np.isfinite(value := column.to_numpy()).all():
        return Times(value=value + 0, clock="number", text=None)  # as `frame_times`, quicker
    try:
        if pa.types.is_timestamp(column.type) and not column.null_count:
            with suppress(pa.ArrowInvalid):  # too far, which is told below
                return _of_timestamps(column, labelled=labelled)
        table.validate(full=True)
        if pa.types.is_string(column.type) and not column.null_count:
            with suppress(TimeError):  # with a row of all, which is told below
                return _of_texts(column, decimal)
        check_dates(table, where)
        frame = table.to_pandas(ignore_metadata=True)
    except InputError:
        raise
    except (pa.ArrowException, OSError, ValueError, TypeError, OverflowError) as error:
        raise unreadable(path, "Parquet", error) from None
    return frame_times(frame.iloc[:, 0], path, decimal, where)


def _of_timestamps(column: "pa.ChunkedArray", *, labelled: bool) -> Times:
    """Timestamps as `frame_times` has them, of which each distinct one alone is written out.

    Raises
    ------
    pyarrow.ArrowInvalid
        One is beyond 64-bit nanoseconds.
    """
    import pyarrow as pa

    zone = column.type.tz
    value = column.cast(pa.timestamp("ns", zone)).cast(pa.int64()).to_numpy()
    text = None
    if labelled:
        _, first, code = np.unique(value, return_index=True, return_inverse=True)
        timestamps = column.take(pa.array(first)).to_pandas()
        text = Coded([stamp.isoformat() for stamp in timestamps], code)
    return Times(value=value, clock="zoned" if zone else "local", text=text)


def _of_texts(column: "pa.ChunkedArray", decimal: str) -> Times:
    """Texts as `frame_times` has them, of which each distinct one alone is looked at.

    Raises
    ------
    TimeError
        One is no time.
    """
    coded = column.combine_chunks().dictionary_encode()
    texts = Coded(coded.dictionary.to_pylist(), coded.indices.to_numpy())
    return coded_times(texts, decimal)


def _with_times(
    table: "pa.Table", schema: "pa.Schema", header: str, times: Times
) -> "tuple[pa.ParquetTable, pa.Schema]":
    """A table and its schema with times that are numbers."""
    import pyarrow as pa

    column = pa.array(times.value)
    if column.type == schema.field(header).type:
        return table, schema
    field = pa.field(header, column.type)
    at = table.column_names.index(header)
    return table.set_column(at, field, column), schema.set(schema.names.index(header), field)


def _taken(table: "pa.Table", chosen: Ints) -> "pa.Table":
    """Some rows of a table, without a copy where they are together."""
    first, last = int(chosen[0]), int(chosen[-1])
    if last - first + 1 == len(chosen):
        return table.slice(first, len(chosen))
    return table.take(chosen)
