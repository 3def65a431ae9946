"""Result of an evaluation of data in parts: sums are in memory, tables in files."""

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.files import reason
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import Columns, Json, records
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq


STORED_TABLES = ("per_step", "per_truth", "per_estimate", "switches", "assignments")
"""Names of the tables. The last is a folder of files ``part-*.parquet``, the others are files
NAME.parquet."""

IN_PARTS = "assignments"


def name_of(table: str) -> str:
    """Return the name of the file or folder of a table."""
    return table if table == IN_PARTS else f"{table}.parquet"


class StoredTables:
    """Tables of one result in files.

    Parameters
    ----------
    folder : str
        Folder of the tables.
    """

    def __init__(self, folder: str) -> None:
        self.folder = folder

    def files(self, table: str) -> list[Path]:
        """Return the files of a table, in order.

        Raises
        ------
        InputError
            The files do not exist any more.
        """
        path = Path(self.folder, name_of(table))
        if path.is_dir():
            return sorted(path.glob("part-*.parquet"))
        if not path.is_file():
            raise InputError(
                f"{path}: no longer exists: the tables of this result are files, which were "
                "moved or removed; evaluate again"
            )
        return [path]

    def names(self) -> dict[str, Path]:
        """Return the path of every file, by its path relative to the folder, with slashes."""
        return {
            path.relative_to(self.folder).as_posix(): path
            for table in STORED_TABLES
            for path in self.files(table)
        }

    def rows(self, table: str) -> int:
        """Return the number of rows of a table."""
        with self._opened(table) as files:
            return sum(file.metadata.num_rows for file in files)

    def columns(self, table: str, limit: int | None = None) -> Columns:
        """Return a table, or its first `limit` rows, as plain Python values."""
        import pyarrow as pa

        parts: list[pa.RecordBatch] = []
        with self._opened(table) as files:
            schema = files[0].schema_arrow if files else pa.schema([])
            for batch in _batches(files):
                parts.append(batch)
                if limit is not None and sum(map(len, parts)) >= limit:
                    break
        made: Columns = pa.Table.from_batches(parts, schema)[:limit].to_pydict()
        return made

    def frame(self, table: str) -> "pd.DataFrame":
        """Return a table as a DataFrame."""
        import pyarrow as pa

        with self._opened(table) as files:
            made: pd.DataFrame = pa.concat_tables([file.read() for file in files]).to_pandas()
        return made

    def costliest(self, table: str, parts: Sequence[str], count: int) -> list[Json]:
        """Return up to `count` rows with the largest positive sums of the columns `parts`.

        The largest is first. Rows with equal sums keep their order in the table.
        """
        best: list[tuple[float, Json]] = []
        with self._opened(table) as files:
            for batch in _batches(files):
                columns = [_doubles(batch[name]) for name in parts]
                cost: Floats = sum(columns, np.zeros(len(batch)))
                # A row can replace one of the best rows only if it costs more than the cheapest.
                threshold = best[-1][0] if best and len(best) == count else 0.0
                dear = np.flatnonzero(cost > threshold)
                dear = dear[np.argsort(-cost[dear], kind="stable")[:count]]
                rows = [batch.slice(row, 1).to_pylist()[0] for row in dear.tolist()]
                best += zip(cost[dear].tolist(), rows, strict=True)
                best = sorted(best, key=lambda entry: -entry[0])[:count]
        return [row for _, row in best]

    @contextmanager
    def _opened(self, table: str) -> "Iterator[list[pq.ParquetFile]]":
        """Open all files of a table, and yield their list.

        Raises
        ------
        InputError
            A file is missing or damaged.
        """
        import pyarrow.parquet as pq

        files: list[pq.ParquetFile] = []
        try:
            files += [pq.ParquetFile(path) for path in self.files(table)]
            yield files
        except (OSError, ValueError) as error:
            if isinstance(error, InputError):
                raise
            where = os.path.join(self.folder, name_of(table))
            raise InputError(f"{where}: cannot be read: {reason(error)}") from None
        finally:
            for file in files:
                file.close()


def _doubles(column: "pa.DoubleArray") -> Floats:
    """Return a column without missing values as an array, without functions that import pandas."""
    values: Floats = np.frombuffer(column.buffers()[1], np.float64)
    return values[column.offset : column.offset + len(column)]


def _batches(files: "Iterable[pq.ParquetFile]") -> "Iterator[pa.RecordBatch]":
    """Yield the rows of all files in batches."""
    return (batch for file in files for batch in file.iter_batches())


MAX_RECORDS = 100_000
"""Largest number of rows of a table that is written into the JSON document.

The document only names larger tables."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PartitionedResult(Evaluation):
    """Result of an evaluation of data larger than memory.

    Ids are in the tables, not in `labels`.

    Parameters
    ----------
    tables : StoredTables
        Tables of the result.
    tracking : dict
        Numbers of the summary that can be computed by sums over the parts.
    followed : (k,) float array
        Share of followed states of each of the k true objects; NaN for an object of which no state
        counts.
    """

    tables: StoredTables
    tracking: Json
    followed: Floats

    @cached_property
    def summarised(self) -> Summary:
        """Summary with the numbers that can be computed by sums over the parts."""
        counts = self.tracked_shares.counts(self.followed)
        return Summary(numbers={**self.tracking, **counts}, per_truth={}, per_estimate={})

    @property
    def is_unique(self) -> None:
        """None: for data in parts it is unknown whether the assignment is unique."""
        return None

    def _of_tracks(self, name: str) -> Columns:
        return self.tables.columns(name)

    def first_switches(self, count: int) -> tuple[Columns, int]:
        """Return the first `count` rows of the table of switches, and the number of all rows."""
        return self.tables.columns("switches", count), self.tables.rows("switches")

    def costliest_tracks(self, kind: str, count: int) -> list[Json]:
        """Return rows of the costliest true objects (``"missed"``) or estimates (``"false"``)."""
        table = "per_truth" if kind == "missed" else "per_estimate"
        return self.tables.costliest(table, ("localisation", kind, "switch"), count)

    def _worst_tracks(self, kind: str, count: int) -> list[str]:
        return [row["id"] for row in self.costliest_tracks(kind, count)]

    def _per_step(self) -> Columns:
        beside = self.split is not None or self.nees is not None
        return self._of_tracks("per_step") if beside else super()._per_step()

    def _records(self) -> Json:
        """Return the names of the tables in the result folder, and records of short tables."""
        fields: Json = {"tables": {name: name_of(name) for name in STORED_TABLES}}
        if len(self.labels.times) <= MAX_RECORDS:
            fields["per_step"] = records(self.table("per_step"))
        if self.tables.rows("switches") <= MAX_RECORDS:
            fields["switches"] = records(self.table("switches"))
        return fields

    def frame(self, name: str) -> "pd.DataFrame":  # noqa: D102  (as of Evaluation)
        in_file = name in STORED_TABLES and name != "per_step"
        return self.tables.frame(name) if in_file else super().frame(name)
