"""Store of a batch: a folder with settings and parts. A part is a file with rows of some jobs.

Each row is the result of a job, and the key of the row identifies the job. A part is written to a
temporary file, and then renamed. If a process is killed, the store therefore has all finished parts
and no incomplete part. A job that was run again has several rows with the same key. Of these, the
latest row with the status "done" counts. If none of them has this status, the latest row counts.
"""

import errno
import json
import os
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.campaign.row import Row, column_fault, job_in_words, known_columns, part_fault
from tgospa_eval.common import documents, files
from tgospa_eval.common.files import named
from tgospa_eval.common.words import install
from tgospa_eval.common.writing import STORE, STORE_SCHEMA, take_lock, writing
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.pair import PairEvaluation
from tgospa_eval.formats.loading import reason_of
from tgospa_eval.quoting import option, quoted
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.saved import ADD_UP, AGREE, TINY
from tgospa_eval.results.saved import SETTINGS_FILE as USED_FILE

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

STEP_FOLDER = "per_step"

STEPS = "per_step"
"""Name of the field of a row that has the steps of a job. A worker hands it to the store."""

STORED_STEPS, STORED_CURVE = "per_step.rows", "per_step.curve"
"""Columns in the row of a job: number of its stored steps, and whether they have the curve."""

COST_COLUMNS = ("total", *PARTS)
"""Columns of a step with its costs."""

CURVE_COLUMNS = ("curve.tgospa", "curve.lower_bound", "curve.upper_bound")

CURVE_PARTS = tuple(f"curve.{part}" for part in PARTS)
"""Columns with the parts of the curve.

At step k, each has one part of the cost, added up over the steps 1 to k and divided by k.
"""

GOSPA_COLUMNS = ("gospa", "gospa.localisation", "gospa.missed", "gospa.false")

STATE_COLUMNS = ("truth_states", "estimate_states", "assigned_states")

NEES_COLUMNS = ("nees.total", "nees.pairs")

OF_STEPS = {
    **dict.fromkeys(("key", "t"), documents.TEXT),
    **dict.fromkeys(("finished", "step", "steps"), documents.COUNT),
    **dict.fromkeys(COST_COLUMNS, documents.COST),
    **dict.fromkeys(CURVE_COLUMNS, documents.or_null(documents.COST)),
}
"""Columns that all steps have."""

OF_SOME_STEPS = dict.fromkeys(
    (*CURVE_PARTS, *GOSPA_COLUMNS, *STATE_COLUMNS, *NEES_COLUMNS), documents.or_null(documents.COST)
)
"""Columns that some steps have."""

NULLABLE = (*CURVE_COLUMNS, *OF_SOME_STEPS)

REST = "the same batch command does the others"
"""Remedy for a batch that is not finished, in messages."""

ANEW = "delete the file; batch then evaluates its jobs again"
"""Remedy for a damaged part, in messages."""


@contextmanager
def read_part(path: Path) -> Iterator[None]:
    """Turn errors of reading a part into errors for the user, with a remedy.

    Raises
    ------
    InputError
        The part cannot be read or is damaged.
    """
    import pyarrow as pa

    with named(str(path), InputError):
        try:
            yield
        except (ValueError, pa.ArrowException) as error:
            text = "cannot be read: " if isinstance(error, pa.ArrowException) else ""
            raise InputError(f"{path}: {text}{reason_of(error)}; {ANEW}") from None


def stored_steps(result: Evaluation, *, per_step: bool) -> Row:
    """Return the fields about steps for the row of a job.

    Without `per_step`, the fields say that no steps are stored. Stored steps have these columns:

    - the time as it was read
    - the number of steps of the horizon so far
    - costs in state units to the power p
    - the curve, as in `Result.curve`; NaN if it was not requested
    """
    if not per_step:
        return {STORED_STEPS: 0, STORED_CURVE: False}
    table, curve = result.table("per_step"), result.table("curve")
    parts = np.array([table[name] for name in PARTS], float)
    missing = np.full(parts.shape[1], np.nan)
    steps = {
        "t": list(map(str, table["t"])),
        "steps": result.evaluated_on.so_far.astype(np.int32),
        **dict(zip(PARTS, parts, strict=True)),
        "total": parts.sum(axis=0),
        **{
            name: np.array(curve[name.removeprefix("curve.")], float) if curve else missing
            for name in (*CURVE_COLUMNS, *CURVE_PARTS)
        },
        **(result.step_numbers() if isinstance(result, PairEvaluation) else {}),
    }
    return {STEPS: steps, STORED_STEPS: len(steps["t"]), STORED_CURVE: bool(curve)}


def step_table(rows: Sequence[Row]) -> "pa.Table | None":
    """Return one table with the steps of all jobs, job by job; None without steps."""
    import pyarrow as pa

    having = [row for row in rows if row.get(STORED_STEPS)]
    if not having:
        return None
    lengths = [row[STORED_STEPS] for row in having]
    which = np.repeat(np.arange(len(having), dtype=np.int32), lengths)
    columns: dict[str, Any] = {
        "key": pa.DictionaryArray.from_arrays(which, [row["key"] for row in having]),
        "finished": np.repeat(np.array([row["finished"] for row in having]), lengths),
        "step": np.concatenate([np.arange(1, size + 1, dtype=np.int32) for size in lengths]),
        "t": pa.array([t for row in having for t in row[STEPS]["t"]], pa.string()),
    }
    for name in dict.fromkeys(name for row in having for name in row[STEPS] if name != "t"):
        each = zip((row[STEPS].get(name) for row in having), lengths, strict=True)
        values = [np.full(size, np.nan) if own is None else own for own, size in each]
        columns[name] = pa.array(np.concatenate(values), from_pandas=name in NULLABLE)
    return pa.table(columns)


def read_steps(folder: Path, rows: "pd.DataFrame") -> "pd.DataFrame | None":
    """Read the steps of the jobs of these rows; None without steps.

    Returns
    -------
    DataFrame
        A row for each step, with the columns ``job`` (index of the row of the job), ``steps``
        (number of steps of the horizon up to this step), ``t`` as read, `COST_COLUMNS`, and
        `CURVE_COLUMNS` (NaN if not requested). Columns of `OF_SOME_STEPS` are included where they
        exist.

    Raises
    ------
    InputError
        A part is damaged.
    """
    import pandas as pd
    import pyarrow.parquet as pq

    if STORED_STEPS not in rows:
        return None
    wanted = rows[rows[STORED_STEPS] > 0]
    known = pd.Series(wanted.index, index=pd.MultiIndex.from_frame(wanted[["key", "finished"]]))
    parts = []
    for path in sorted(folder.glob("part-*.parquet")):
        with read_part(path), pq.ParquetFile(path) as file:
            read = file.read()
            some = {k: kind for k, kind in OF_SOME_STEPS.items() if k in read.column_names}
            wrong = column_fault(read, OF_STEPS | some)
            if wrong:
                raise ValueError(wrong)
            table = read.select([*OF_STEPS, *some]).to_pandas()
            # Each job is looked up once, at its first step.
            first = table["step"] == 1
            if not (first | (table["step"] == table["step"].shift(fill_value=0) + 1)).all():
                raise ValueError("the steps of a job are not in order of time")
        jobs = known.reindex(
            pd.MultiIndex.from_frame(table.loc[first, ["key", "finished"]].astype({"key": str}))
        )
        table["job"] = jobs.to_numpy()[np.cumsum(first.to_numpy()) - 1]
        kept = table[table["job"].notna()]
        if len(kept):
            parts.append(kept.astype({"job": np.int64}).drop(columns=["key", "finished", "step"]))
    if not parts:
        return None if wanted.empty else pd.DataFrame({"job": np.zeros(0, np.int64)})
    steps: pd.DataFrame = pd.concat(parts, ignore_index=True)
    for job, wrong in _contradictions(steps, wanted):
        name = quoted(job_in_words(rows.loc[job]))
        raise InputError(f"{folder}: the steps of {name}: {wrong}; {ANEW}")
    return steps


def _contradictions(steps: "pd.DataFrame", rows: "pd.DataFrame") -> Iterator[tuple[Any, str]]:
    """Yield each job with contradictory steps, or with steps that do not fit its row, and why."""
    with np.errstate(over="ignore"):
        sums = steps.groupby("job")[list(COST_COLUMNS)].sum()
    for name in COST_COLUMNS:
        own = rows.loc[sums.index, name]
        differs = (sums[name] - own).abs() > ADD_UP * own + TINY
        for job in sums.index[differs]:
            yield job, f"{name} sums to {sums[name][job]:.15g}, but the job has {own[job]:.15g}"
    order = rows["order"].reindex(steps["job"]).to_numpy()
    value, lower, upper = (steps[name].to_numpy(float) for name in CURVE_COLUMNS)
    with np.errstate(over="ignore"):
        is_wrong = ~((lower <= value * (1 + AGREE)) & (value <= upper * (1 + AGREE)))
        is_wrong |= np.isinf(upper**order)
    for row in np.flatnonzero(is_wrong & ~(np.isnan(value) & np.isnan(lower) & np.isnan(upper))):
        names = ", ".join(CURVE_COLUMNS)
        yield steps["job"][row], f"{names} are {value[row]:g}, {lower[row]:g}, {upper[row]:g}"


# -------------------------------------------------------------------------------------------------
# The folder of a store.


ALL_BYTES = 2**31 - 1
"""Number of bytes of the lock file that a process locks on Windows if it does all jobs.

A process that does one shard locks one byte.
"""

NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK)
"""Errors of file systems without locks, such as Lustre without the option flock."""


@contextmanager
def locked(folder: Path, shard: tuple[int, int], said: Path | None = None) -> Iterator[None]:
    """Lock the jobs of a shard; other processes can work on other shards at the same time.

    The operating system releases the locks when the process ends, even if it is killed.

    Parameters
    ----------
    folder : Path
        Folder of the lock files.
    shard : pair of int
        Index of the shard, from 0, and number of shards.
    said : Path, optional
        Folder to show in messages; by default `folder`.

    Raises
    ------
    ConfigError
        Another process works on the same jobs, or the folder cannot be written.
    """
    with ExitStack() as stack:
        try:
            _take(stack, folder, shard)
        except (BlockingIOError, PermissionError):
            raise ConfigError(
                f"{option('output', said or folder, short=True)}: another process uses it; wait, "
                "or name another folder"
            ) from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
            files.announce(
                f"{option('output', said or folder, short=True)}: the file system has no locks; "
                "let no other process use this folder meanwhile"
            )
        yield


def _take(stack: ExitStack, folder: Path, shard: tuple[int, int]) -> None:
    """Take the locks of the folder and of the shard.

    On POSIX, shards share the lock of the folder, and each locks a file of its own. On Windows,
    each shard locks a byte of the same file.
    """
    number, count = shard

    def opened(name: str) -> Any:
        with files.named(option("output", folder, short=True), ConfigError, "cannot be written"):
            # Also opened for reading: NFS gives shared locks only on files that can be read.
            return stack.enter_context((folder / name).open("a+"))

    byte = (count * (count - 1) // 2 + number) % ALL_BYTES
    at, size = (0, ALL_BYTES) if count == 1 else (byte, 1)
    if take_lock(opened(".lock"), shared=count > 1, at=at, size=size):
        take_lock(opened(f".lock-{number}-of-{count}"))


SCHEMA, SETTINGS_FILE = STORE_SCHEMA, STORE
SETTINGS = {
    "version": documents.TEXT,
    "options": {...: documents.ANYTHING},
    "with": documents.Maybe([documents.TEXT]),
    "slices": documents.Maybe([documents.TEXT]),
    "jobs": {
        "paths": [documents.TEXT],
        **dict.fromkeys(
            ("truth", "estimate", "layout", "seqmap"), documents.or_null(documents.TEXT)
        ),
    },
    "settings_file": USED_FILE,
    "expected": documents.Maybe(documents.COUNT),
    "keys": documents.Maybe([documents.TEXT]),
}
"""Fields of the settings of a store, and the kinds of their values."""
PART_FOLDER = "jobs"
KEPT = 16
"""Number of characters of the key of a job that the settings keep."""


def is_store(path: str | None) -> bool:
    """Return whether a path is the folder of a batch."""
    return path is not None and os.path.isfile(os.path.join(path, SETTINGS_FILE))


class Store:
    """Folder with the results of a batch.

    Parameters
    ----------
    folder : str
        Path of the folder.
    """

    def __init__(self, folder: str) -> None:
        self.folder = Path(folder)
        try:
            import pyarrow  # noqa: F401  (checks that the extra is installed)
        except ModuleNotFoundError:
            raise ConfigError(
                f"a store of rows needs the extra parquet: {install('parquet')}"
            ) from None

    def open(self, settings: Mapping[str, Any]) -> None:
        """Begin a store, or continue a store with the same settings.

        Raises
        ------
        ConfigError
            The folder has other files, or is a store with other settings.
        """
        path = self.folder / SETTINGS_FILE
        with named(option("output", self.folder, short=True), ConfigError, "cannot be written"):
            self.folder.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                if any(not name.startswith(".") for name in os.listdir(self.folder)):
                    raise ConfigError(
                        f"{option('output', self.folder, short=True)}: is not empty and not a "
                        "batch; name another folder"
                    )
                # Shards can begin at the same time. They write the same file, which is compared
                # with the settings of each shard.
                self._write_settings(settings)
            (self.folder / PART_FOLDER).mkdir(exist_ok=True)
        old, new = self.settings(), {**settings}
        for one in (old, new):
            one |= {f"options.{name}": value for name, value in one.pop("options").items()}
        differing = [
            f"{key} was {json.dumps(old.get(key))}, is {json.dumps(new.get(key))}"
            for key in sorted({*old, *new} - {"version", "settings_file", "expected", "keys"})
            if old.get(key) != new.get(key)
        ]
        if differing:
            raise ConfigError(
                f"{option('output', self.folder, short=True)}: has a batch with other settings: "
                f"{'; '.join(differing)}; name another folder"
            )

    def _write_settings(self, settings: Mapping[str, Any]) -> None:
        where = option("output", self.folder, short=True)
        with writing(self.folder / SETTINGS_FILE, where) as beside:
            text = json.dumps(settings, indent=1, sort_keys=True)
            beside.write_text(text + "\n", encoding="utf-8")

    def expect(self, keys: Iterable[str]) -> None:
        """Keep the keys of the jobs of the batch; rows of other jobs no longer count."""
        own = sorted(key[:KEPT] for key in keys)
        old = self.settings()
        if old.get("keys") != own:
            self._write_settings({**old, "expected": len(own), "keys": own})

    def unfinished(self, done: int) -> str:
        """Return a sentence if not all jobs of the batch are done, else a blank text."""
        expected = self.settings().get("expected", 0)
        return f"{done:,} of {expected:,} jobs are done" if done < expected else ""

    def settings(self) -> dict[str, Any]:
        """Return the settings of the evaluation.

        Raises
        ------
        InputError
            The folder is not a batch.
        """
        path = self.folder / SETTINGS_FILE
        if self.folder.is_dir() and not path.exists():
            raise InputError(f"{self.folder}: is not a batch: {SETTINGS_FILE} is missing")
        return documents.read_document(
            str(path), SCHEMA, SETTINGS, remedy="run batch again, to a new folder"
        )

    def rows(self) -> "pd.DataFrame":
        """Return one row for each job, sorted by labels.

        The row is the latest row of the job with the status "done", or its latest row if no row has
        this status.

        Raises
        ------
        InputError
            A part is damaged.
        """
        import pandas as pd
        import pyarrow as pa
        import pyarrow.parquet as pq

        tables = []
        for path in sorted((self.folder / PART_FOLDER).glob("part-*.parquet")):
            # Files are opened one by one: pyarrow would take longer to search for a dataset.
            with read_part(path), pq.ParquetFile(path) as file:
                part = file.read().replace_schema_metadata()
                wrong = part_fault(part)
                if wrong:
                    raise ValueError(wrong)
            tables.append(part.select(list(known_columns(part))))
        none = pd.DataFrame(columns=["key", "status"])
        if not tables:
            return none
        # Tables can differ in their columns: parts with only failed jobs lack some.
        with read_part(self.folder / PART_FOLDER):
            table = pa.concat_tables(tables, promote_options="permissive")
        labels = [name for name in table.column_names if name.startswith("label.")]
        # If a file was changed, the job has another key. Its older row then no longer counts.
        same = [*labels, "truth", "estimate", "options"]
        latest: pd.DataFrame = table.select(["key", "status", "finished", *same]).to_pandas()
        if (keys := self.settings().get("keys")) is not None:
            latest = latest[latest["key"].str[:KEPT].isin(keys)]
        if latest.empty:
            return none
        latest["_done"] = latest["status"] == "done"
        latest = latest.sort_values(["_done", "finished"], kind="stable")
        latest = latest.drop_duplicates("key", keep="last").sort_values("finished", kind="stable")
        latest = latest.drop_duplicates(same, keep="last")
        kept = latest.sort_values(labels or "key", kind="stable").index
        # Few columns were enough to select rows. All columns are converted only for these rows.
        rows: pd.DataFrame = table.take(kept.to_numpy()).to_pandas()
        return rows

    def add(self, rows: Sequence[Row]) -> None:
        """Store some rows as one part.

        Raises
        ------
        ConfigError
            The part cannot be written.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        if not rows:
            return
        # The name is unique, and sorts after all earlier names.
        name = f"part-{time.time_ns():020d}-{uuid.uuid4().hex[:8]}.parquet"
        steps = step_table(rows)
        # Steps are written first, so that no known job lacks its steps.
        if steps is not None:
            self._write(STEP_FOLDER, name, lambda path: pq.write_table(steps, path))
        names = dict.fromkeys(name for row in rows for name in row if name != STEPS)
        table = pa.table({name: pa.array([row.get(name) for row in rows]) for name in names})
        self._write(PART_FOLDER, name, lambda path: pq.write_table(table, path))

    def _write(self, folder: str, name: str, write: Callable[[Path], None]) -> None:
        """Write a part to a temporary file, and rename it."""
        path = self.folder / folder / name
        where = option("output", self.folder, short=True)
        with named(where, ConfigError, "cannot be written"), writing(path, where) as beside:
            write(beside)

    def steps(self, rows: "pd.DataFrame") -> "pd.DataFrame | None":
        """Read the steps of the jobs of these rows; None without steps.

        Raises
        ------
        InputError
            A part is damaged.
        """
        return read_steps(self.folder / STEP_FOLDER, rows)
