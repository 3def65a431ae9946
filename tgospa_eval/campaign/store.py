"""The store of a batch: settings once, and a row for each job in parts that appear whole.

A part is written beside and renamed, so whoever is killed leaves all that was finished before, and
nothing half. Of several rows with one key the last that is done counts.
"""

import errno
import importlib
import json
import os
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.campaign.row import Row
from tgospa_eval.common import files
from tgospa_eval.common.files import named, reason
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.manifest import STORE, STORE_SCHEMA
from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

STEP_FOLDER = "per_step"

STEPS = "per_step"
"""Where the row of a job has a `JobSteps` on its way from a worker to the store."""

STORED_STEPS, STORED_CURVE = "per_step.rows", "per_step.curve"
"""Columns of the row of a job: how many rows of steps it has, and whether with the curve."""

COST_COLUMNS = ("total", *PARTS)
"""Columns of costs."""

CURVE_COLUMNS = ("tgospa", "lower_bound", "upper_bound")


@dataclass(frozen=True, kw_only=True, eq=False)
class JobSteps:
    """Of one job, T steps.

    Parameters
    ----------
    times : list of str
        Steps as they were read.
    steps : (T,) int array
        How many of the horizon are no later than each.
    parts : (4, T) float array
        Localisation, missed, false and switch cost, in state units to the power p.
    curve : (3, T) float array, optional
        Value of the steps up to each by themselves, and its bounds, as in `Result.curve`.
    """

    times: list[str]
    steps: Ints
    parts: Floats
    curve: Floats | None = None

    @classmethod
    def of(cls, result: Summary) -> "JobSteps":
        """Those of a result."""
        table, curve = result.table("per_step"), result.table("curve")
        return cls(
            times=list(map(str, table["t"])),
            steps=result.judged_on.so_far.astype(np.int32),
            parts=np.array([table[name] for name in PARTS]),
            curve=np.array([curve[name] for name in CURVE_COLUMNS]) if curve else None,
        )

    def __len__(self) -> int:
        return len(self.times)

    @property
    def stored(self) -> dict[str, object]:
        """What the row of the job says of it."""
        return {STORED_STEPS: len(self), STORED_CURVE: self.curve is not None}


def step_table(rows: Sequence[Mapping[str, Any]]) -> "pa.Table | None":
    """The steps of all jobs that have some, one job below the other."""
    import pyarrow as pa

    having = [(row, row[STEPS]) for row in rows if len(row.get(STEPS) or ())]
    if not having:
        return None
    lengths = [len(steps) for _, steps in having]
    which = np.repeat(np.arange(len(having), dtype=np.int32), lengths)
    parts = np.concatenate([steps.parts for _, steps in having], axis=1)
    curves = [
        np.full((3, len(steps)), np.nan) if steps.curve is None else steps.curve
        for _, steps in having
    ]
    curve = np.concatenate(curves, axis=1)
    columns: dict[str, Any] = {
        "key": pa.DictionaryArray.from_arrays(which, [row["key"] for row, _ in having]),
        "finished": np.repeat(np.array([row["finished"] for row, _ in having]), lengths),
        "step": np.concatenate([np.arange(1, size + 1, dtype=np.int32) for size in lengths]),
        "t": pa.array([t for _, steps in having for t in steps.times], pa.string()),
        "steps": np.concatenate([one.steps for _, one in having]),
        **dict(zip(PARTS, parts, strict=True)),
        "total": parts.sum(axis=0),
        **{
            f"curve.{name}": pa.array(values, from_pandas=True)
            for name, values in zip(CURVE_COLUMNS, curve, strict=True)
        },
    }
    return pa.table(columns)


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredSteps:
    """Steps of several jobs, N in all.

    Parameters
    ----------
    job : (N,) int array
        Whose each is: the number of its row.
    steps : (N,) int array
        How many of the horizon are no later.
    times : (N,) array of str
        As read.
    costs : (5, N) float array
        The whole, and its parts.
    curve : (3, N) float array
        As of `JobSteps`; NaN where it was not asked for.
    """

    job: Ints
    steps: Ints
    times: "np.ndarray[Any, Any]"
    costs: Floats
    curve: Floats


def read_steps(folder: Path, rows: "pd.DataFrame") -> StoredSteps | None:
    """The steps of the jobs of these rows; None if none has any.

    Raises
    ------
    InputError
        A part is damaged.
    """
    parts = list(_parts(folder, rows))
    if not parts:
        return None
    joined = {name: np.concatenate([np.asarray(part[name]) for part in parts]) for name in parts[0]}
    return StoredSteps(
        job=joined["job"],
        steps=joined["steps"],
        times=joined["t"],
        costs=np.array([joined[name] for name in COST_COLUMNS]),
        curve=np.array([joined[f"curve.{name}"] for name in CURVE_COLUMNS]),
    )


def _parts(folder: Path, rows: "pd.DataFrame") -> Iterator[dict[str, Any]]:
    import pandas as pd
    import pyarrow.parquet as pq

    if STORED_STEPS not in rows:
        return
    wanted = rows[rows[STORED_STEPS] > 0]
    known = pd.Series(wanted.index, index=pd.MultiIndex.from_frame(wanted[["key", "finished"]]))
    columns = ["key", "finished", "step", "t", "steps", *COST_COLUMNS]
    columns += [f"curve.{name}" for name in CURVE_COLUMNS]
    for path in sorted(folder.glob("part-*.parquet")):
        with named(str(path), InputError):
            table = pq.read_table(path, columns=columns).to_pandas()
        # A job is looked up once, where it begins.
        first = table["step"] == 1
        jobs = known.reindex(
            pd.MultiIndex.from_frame(table.loc[first, ["key", "finished"]].astype({"key": str}))
        )
        table["job"] = jobs.to_numpy()[np.cumsum(first.to_numpy()) - 1]
        kept = table[table["job"].notna()].astype({"job": np.int64})
        if len(kept):
            yield {name: kept[name].to_numpy() for name in kept.columns if name != "key"}


# -------------------------------------------------------------------------------------------------
# The folder of a store.


ALL_BYTES = 2**31 - 1
"""Bytes of a lock file that are locked on Windows for all shards; each shard has one byte."""

NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK)
"""Errors of file systems that have none, such as Lustre without the option flock."""


@contextmanager
def locked(folder: Path, shard: tuple[int, int], said: Path | None = None) -> Iterator[None]:
    """Keep other processes from the same jobs; those of other shards may work meanwhile.

    The system gives the locks back when a process ends, however it does.

    Parameters
    ----------
    folder : Path
        Where the lock is.
    shard : pair of int
        Number of the shard, from 0, and how many there are.
    said : Path, optional
        What the user has named, where that is another.

    Raises
    ------
    ConfigError
        A process is at work on them, or the folder cannot be written.
    """
    with ExitStack() as stack:
        try:
            _take(stack, folder, shard)
        except (BlockingIOError, PermissionError):
            raise ConfigError(
                f"-o {said or folder}: another process is at work on it; wait, or name another"
            ) from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
            files.announce(
                f"-o {said or folder}: no locks there; let nothing else work on it meanwhile"
            )
        yield


def _take(stack: ExitStack, folder: Path, shard: tuple[int, int]) -> None:
    """Take the locks; those of POSIX may be shared, those of Windows are of ranges of bytes."""
    number, count = shard

    def opened(name: str) -> Any:
        with files.named(f"-o {folder}", ConfigError, "cannot be written"):
            return stack.enter_context((folder / name).open("a+"))  # NFS shares what can be read

    whole = opened(".lock")
    try:
        fcntl: Any = importlib.import_module("fcntl")
    except ModuleNotFoundError:  # on Windows
        windows: Any = importlib.import_module("msvcrt")
        whole.seek(0 if count == 1 else (count * (count - 1) // 2 + number) % ALL_BYTES)
        windows.locking(whole.fileno(), windows.LK_NBLCK, ALL_BYTES if count == 1 else 1)
        return
    own = opened(f".lock-{number}-of-{count}")
    fcntl.flock(whole, (fcntl.LOCK_SH if count > 1 else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    fcntl.flock(own, fcntl.LOCK_EX | fcntl.LOCK_NB)


SCHEMA, SETTINGS_FILE = STORE_SCHEMA, STORE
PART_FOLDER = "jobs"

MANY_PARTS = 64
"""Parts of which one is made: to open each takes longer than to read the rows of a hundred."""

TRIES = 3
"""Times that parts are listed anew when somebody joins them meanwhile."""


class Store:
    """A folder of results.

    Parameters
    ----------
    folder : str
        Where.
    """

    def __init__(self, folder: str) -> None:
        self.folder = Path(folder)
        try:
            import pyarrow  # noqa: F401  (here: the extra may be missing)
        except ModuleNotFoundError:
            raise ConfigError(f"batch needs the extra parquet: {install('parquet')}") from None

    def open(self, settings: Mapping[str, Any]) -> None:
        """Begin, or go on with the same settings.

        Raises
        ------
        ConfigError
            The folder has other files, or is a store with other settings.
        """
        path = self.folder / SETTINGS_FILE
        with named(f"-o {self.folder}", ConfigError, "cannot be written"):
            self.folder.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                if any(not name.startswith(".") for name in os.listdir(self.folder)):
                    raise ConfigError(
                        f"-o {self.folder}: is not empty, and no batch; name another folder"
                    )
                # Several shards may begin at once: all write the same, and who is later looks.
                beside = self.folder / f".{SETTINGS_FILE}-{uuid.uuid4().hex}"
                beside.write_text(
                    json.dumps(settings, indent=1, sort_keys=True) + "\n", encoding="utf-8"
                )
                os.replace(beside, path)
            (self.folder / PART_FOLDER).mkdir(exist_ok=True)
        old = self.settings()
        differing = [
            f"{key} was {json.dumps(old.get(key))}, is {json.dumps(settings.get(key))}"
            for key in sorted({*old, *settings} - {"version", "settings_file"})
            if old.get(key) != settings.get(key)
        ]
        if differing:
            raise ConfigError(
                f"-o {self.folder}: holds a batch with other settings: {'; '.join(differing)}; "
                "name another folder"
            )

    def settings(self) -> dict[str, Any]:
        """What was evaluated, and how.

        Raises
        ------
        InputError
            The folder holds no batch.
        """
        path = self.folder / SETTINGS_FILE
        if self.folder.is_dir() and not path.exists():
            raise InputError(f"{self.folder}: holds no batch: {SETTINGS_FILE} is missing")
        with named(str(path), InputError):
            settings: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            if settings.get("schema") != SCHEMA:
                raise InputError(
                    f"{path}: its schema is not {SCHEMA}: another version made it; make it anew "
                    "with batch"
                )
        return settings

    def rows(self) -> "pd.DataFrame":
        """One row for each job, done before failed and the last of these, in the order of labels.

        Raises
        ------
        InputError
            A part is damaged.
        """
        import pandas as pd

        table = None
        for _ in range(TRIES):
            with suppress(FileNotFoundError):  # joined since they were listed
                table = self._read(self._parts())
                break
        if table is None:
            return pd.DataFrame(columns=["key", "status"])
        labels = [name for name in table.column_names if name.startswith("label.")]
        # A file that changed since has another key: its older row is one of the past.
        same = [*labels, "truth", "estimate", "options"]
        found: pd.DataFrame = table.select(["key", "status", "finished", *same]).to_pandas()
        found["_done"] = found["status"] == "done"
        found = found.sort_values(["_done", "finished"], kind="stable")
        found = found.drop_duplicates("key", keep="last").sort_values("finished", kind="stable")
        found = found.drop_duplicates(same, keep="last")
        kept = found.sort_values(labels or "key", kind="stable").index
        # All columns, which are many, are taken once.
        rows: pd.DataFrame = table.take(kept.to_numpy()).to_pandas()
        return rows

    def join(self) -> None:
        """Make one part of many, and take away what was half written when a process was killed.

        For who is sure that nobody else writes meanwhile.

        Raises
        ------
        InputError, ConfigError
            A part is damaged, or the new one cannot be written.
        """
        import pyarrow.parquet as pq

        for left in self.folder.glob("*/part-*.new"):
            left.unlink(missing_ok=True)
        paths = self._parts()
        if len(paths) <= MANY_PARTS:
            return
        table = self._read(paths)
        # A row that is there twice, if this is broken off now, is one row to all who read it.
        self._write(PART_FOLDER, _part_name(), lambda path: pq.write_table(table, path))
        for path in paths:
            with suppress(OSError):  # somebody reads it, on Windows
                path.unlink()

    def _parts(self) -> list[Path]:
        return sorted((self.folder / PART_FOLDER).glob("part-*.parquet"))

    def _read(self, paths: Sequence[Path]) -> Any:
        """An Arrow table of some parts, None of none."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        tables = []
        for path in paths:
            try:
                # Of one file, without the search for a dataset, which takes longer than reading.
                with pq.ParquetFile(path) as file:
                    tables.append(file.read().replace_schema_metadata())
            except FileNotFoundError:
                raise
            except (OSError, ValueError) as error:
                raise InputError(f"{path}: cannot be read: {reason(error)}") from None
        # Parts of failed jobs alone lack columns.
        return pa.concat_tables(tables, promote_options="permissive") if tables else None

    def add(self, rows: Sequence[Row]) -> None:
        """Store some rows, whole.

        Raises
        ------
        ConfigError
            They cannot be written.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        if not rows:
            return
        name = _part_name()
        steps = step_table(rows)
        # First, so that no job is known whose steps are not there.
        if steps is not None:
            self._write(STEP_FOLDER, name, lambda path: pq.write_table(steps, path))
        names = dict.fromkeys(name for row in rows for name in row if name != STEPS)
        table = pa.table({name: pa.array([row.get(name) for row in rows]) for name in names})
        self._write(PART_FOLDER, name, lambda path: pq.write_table(table, path))

    def _write(self, folder: str, name: str, write: Callable[[Path], None]) -> None:
        """Write a part beside its place, and rename it."""
        path = self.folder / folder / name
        with named(f"-o {self.folder}", ConfigError, "cannot be written"):
            path.parent.mkdir(exist_ok=True)
            beside = path.with_suffix(".new")
            try:
                write(beside)
                os.replace(beside, path)
            finally:
                beside.unlink(missing_ok=True)

    def steps(self, rows: "pd.DataFrame") -> StoredSteps | None:
        """The steps of the jobs of these rows; None if none has any.

        Raises
        ------
        InputError
            A part is damaged.
        """
        return read_steps(self.folder / STEP_FOLDER, rows)


def _part_name() -> str:
    """A name that no other has, later than all before."""
    return f"part-{time.time_ns():020d}-{uuid.uuid4().hex[:8]}.parquet"
