"""Result of an evaluation of partitioned data, with sums in memory and tables in files."""

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
"""Tables. The last one is a folder of files ``part-*.parquet``, any other a file NAME.parquet."""

IN_PARTS = "assignments"


def name_of(table: str) -> str:
    """Return the name of a table in its folder."""
    return table if table == IN_PARTS else f"{table}.parquet"


class StoredTables:
    """Tables of one result.

    Parameters
    ----------
    folder : str
        Folder of the tables, which have the names of `name_of`.
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
        """Return all files, by their names in a folder, with slashes."""
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
        """Return a table, or its first rows, as plain Python values."""
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
        """Return the rows with the highest positive sums of some columns, first of equal ones."""
        best: list[tuple[float, Json]] = []
        with self._opened(table) as files:
            for batch in _batches(files):
                columns = [_doubles(batch[name]) for name in parts]
                cost: Floats = sum(columns, np.zeros(len(batch)))
                # A later row replaces a known row only if it costs more than the cheapest one.
                threshold = best[-1][0] if best and len(best) == count else 0.0
                dear = np.flatnonzero(cost > threshold)
                dear = dear[np.argsort(-cost[dear], kind="stable")[:count]]
                rows = [batch.slice(row, 1).to_pylist()[0] for row in dear.tolist()]
                best += zip(cost[dear].tolist(), rows, strict=True)
                best = sorted(best, key=lambda entry: -entry[0])[:count]
        return [row for _, row in best]

    @contextmanager
    def _opened(self, table: str) -> "Iterator[list[pq.ParquetFile]]":
        """Yield the list of the open files of a table.

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
    """Return a column without missing values, not by functions that would import pandas."""
    values: Floats = np.frombuffer(column.buffers()[1], np.float64)
    return values[column.offset : column.offset + len(column)]


def _batches(files: "Iterable[pq.ParquetFile]") -> "Iterator[pa.RecordBatch]":
    """Yield batches of rows."""
    return (batch for file in files for batch in file.iter_batches())


MAX_RECORDS = 100_000
"""Largest number of steps, or of switches, for which the JSON document has records.

If there are more, the document only names the table."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PartitionedResult(Evaluation):
    """One evaluation of data larger than memory, with ids in the tables instead of `labels`.

    Parameters
    ----------
    tables : StoredTables
        Tables of the result.
    tracking : dict
        Numbers of the summary that follow from sums.
    followed : (k,) float array
        Share of followed states of each true object, NaN without a state that counts.
    """

    tables: StoredTables
    tracking: Json
    followed: Floats

    @cached_property
    def summarised(self) -> Summary:
        """Numbers of tracking that follow from sums; other numbers are missing."""
        counts = self.tracked_shares.counts(self.followed)
        return Summary(numbers={**self.tracking, **counts}, per_truth={}, per_estimate={})

    @property
    def is_unique(self) -> None:
        """None, because it is unknown for data in parts."""
        return None

    def _of_tracks(self, name: str) -> Columns:
        return self.tables.columns(name)

    def first_switches(self, count: int) -> tuple[Columns, int]:
        """Return the first rows of the table of switches, at most `count`, and their number."""
        return self.tables.columns("switches", count), self.tables.rows("switches")

    def costliest_tracks(self, kind: str, count: int) -> list[Json]:
        """Return rows of the costliest objects, for ``"missed"``, or estimates, for ``"false"``."""
        table = "per_truth" if kind == "missed" else "per_estimate"
        return self.tables.costliest(table, ("localisation", kind, "switch"), count)

    def _worst_tracks(self, kind: str, count: int) -> list[str]:
        return [row["id"] for row in self.costliest_tracks(kind, count)]

    def _per_step(self) -> Columns:
        beside = self.split is not None or self.nees is not None
        return self._of_tracks("per_step") if beside else super()._per_step()

    def _records(self) -> Json:
        """Return names of the tables in the result folder, and the short records."""
        fields: Json = {"tables": {name: name_of(name) for name in STORED_TABLES}}
        if len(self.labels.times) <= MAX_RECORDS:
            fields["per_step"] = records(self.table("per_step"))
        if self.tables.rows("switches") <= MAX_RECORDS:
            fields["switches"] = records(self.table("switches"))
        return fields

    def frame(self, name: str) -> "pd.DataFrame":  # noqa: D102  (as of Evaluation)
        in_file = name in STORED_TABLES and name != "per_step"
        return self.tables.frame(name) if in_file else super().frame(name)
