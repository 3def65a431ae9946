"""Parquet files in parts: times of a row group, rows of a range of time, batch by batch."""

import os
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.files import named
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.arrow import arrow_rows, check_dates, check_types, damaged
from tgospa_eval.formats.columns.roles import Roles, find_roles
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.times import Times
from tgospa_eval.partitioned.input.listing import File
from tgospa_eval.tracks.trajectories import Ints

if TYPE_CHECKING:
    import pyarrow as pa

DECODED = 1 << 17
"""Rows that are decoded together."""

BYTES_OF_COLUMN = 1 << 20
"""Bytes of a column that are read together: a row group may be larger than memory."""

Span = tuple[int | float, int | float]
"""The first and the last time of a range, as the files have them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
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

    def batches(self, group: int, columns: list[str]) -> "Iterator[pa.Table]":
        """The columns of a row group, some rows at a time.

        Raises
        ------
        InputError
            The file is damaged.
        """
        import pyarrow as pa

        own = [name for name in columns if name in self.content.schema_arrow.names]
        keys = {key: text for key, text in self.file.keys if key in columns and key not in own}
        try:
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
        except (pa.ArrowException, OSError, ValueError, TypeError) as error:
            raise damaged(self.file.path, "Parquet", error) from None

    def times(self, group: int, options: ReadOptions) -> Iterator[Times]:
        """The times of a row group, some rows at a time."""
        header = self.schema.names[self.roles.time]
        row = sum(self.groups[:group])
        for table in self.batches(group, [header]):
            yield times_of(table, self.file.path, options.decimal, row)
            row += len(table)

    def chunks(
        self, group: int, options: ReadOptions, span: Span | None = None
    ) -> "Iterator[Chunk]":
        """Rows of a row group, all or those of a range of time."""
        names, roles = self.schema.names, self.roles
        used = {roles.id, roles.time, *roles.numbers}
        used |= set() if roles.klass is None else {roles.klass}
        subset = [names[column] for column in sorted(used)]
        path, row = self.file.path, sum(self.groups[:group])
        for table in self.batches(group, subset):
            first, row = row, row + len(table)
            place: Ints | range = range(first, row)
            if span is not None:
                column = table.select([names[roles.time]])
                times = times_of(column, path, options.decimal, first)
                chosen = np.flatnonzero((times.value >= span[0]) & (times.value <= span[1]))
                if not len(chosen):
                    continue
                table, place = _taken(table, chosen), first + chosen
            yield Chunk(table=table, schema=self.schema, path=path, place=place)


@dataclass(frozen=True, kw_only=True, eq=False)
class Chunk:
    """Some rows of a file.

    Parameters
    ----------
    table : pyarrow.Table
        The columns in use.
    schema : pyarrow.Schema
        All columns of the file.
    path : str
        The file.
    place : sequence of int
        Which row of the file each is.
    """

    table: "pa.Table"
    schema: "pa.Schema"
    path: str
    place: Ints | range


def rows_of_chunks(chunks: Sequence[Chunk], options: ReadOptions) -> Iterator[Rows]:
    """Their rows in order; those of files with the same schema are converted together.

    Raises
    ------
    InputError
        A value is wrong.
    """
    together: list[Chunk] = []
    for chunk in chunks:
        if together and not chunk.schema.equals(together[0].schema):
            yield _converted(together, options)
            together = []
        together.append(chunk)
    if together:
        yield _converted(together, options)


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
    return arrow_rows(first.path, "Parquet", first.schema, table.select, options, where)


def open_table(file: File, options: ReadOptions) -> Table:
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
        raise damaged(file.path, "Parquet", error) from None
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
    return Table(file=file, content=content, schema=whole, roles=roles)


def times_of(table: "pa.Table", path: str, decimal: str, first: int) -> Times:
    """The times of a table with that column alone; `first` is the row of the file it begins at.

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
        check_dates(table, where)
        frame = table.to_pandas(ignore_metadata=True)
    except InputError:
        raise
    except (pa.ArrowException, OSError, ValueError, TypeError, OverflowError) as error:
        raise damaged(path, "Parquet", error) from None
    return frame_times(frame.iloc[:, 0], path, decimal, where)


def _taken(table: "pa.Table", chosen: Ints) -> "pa.Table":
    """Some rows of a table, without a copy where they are together."""
    first, last = int(chosen[0]), int(chosen[-1])
    if last - first + 1 == len(chosen):
        return table.slice(first, len(chosen))
    return table.take(chosen)
