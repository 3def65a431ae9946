"""Tables of a result, written as Parquet in chunks, with one chunk in memory at a time.

Columns and order of rows are those of the CSV file of the same name
(docs/reference/result-tables.md). Arrays are in units of c^p with global numbers of tracks and
steps; this module converts them to the units and names of the user.
"""

import itertools
import mmap
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Ints, Mask, stretches
from tgospa_eval.common.files import named
from tgospa_eval.common.words import install
from tgospa_eval.common.writing import writing, writing_folder
from tgospa_eval.errors import ConfigError
from tgospa_eval.partitioned.scan import BESIDE, Scanned
from tgospa_eval.partitioned.shards import ASSIGNED_PAIR, IGNORED_TRUTH, SWITCHED
from tgospa_eval.partitioned.tasks import Run, Task, run_tasks
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.solution import AssignedPairs, PerTrack
from tgospa_eval.results.consistency import NEES, NeesSums, mean_columns, nees_sums
from tgospa_eval.results.partitioned import IN_PARTS, StoredTables, name_of
from tgospa_eval.results.records import Arrays, Costs, step_columns, track_columns

if TYPE_CHECKING:
    import pyarrow as pa


ROW_GROUP = 1 << 17
"""Number of rows of a row group; one row group is in memory while a table is written or read."""

REPEATED = ("t", "weight", "mass")
"""Columns of doubles with few distinct values, which are stored with a dictionary of the values.
Other columns of doubles are smaller and faster to write without a dictionary."""


Names: TypeAlias = Mapping[str, NDArray[Any]]
"""Names by number: ``times`` of steps as they were read, and ids of ``truths`` and ``estimates``.
Texts are not Python objects, so that the arrays can be mapped from files."""


def _write_columns(path: str, columns: Arrays) -> None:
    """Write columns that are in memory."""

    def own(rows: slice) -> Arrays:
        return {name: column[rows] for name, column in columns.items()}

    size = len(next(iter(columns.values())))
    slices = (slice(first, first + ROW_GROUP) for first in range(0, size, ROW_GROUP))
    write_table(path, own, slices, slice(0))


def write_switches(path: str, pieces: Sequence[Path], names: Names, parameters: Parameters) -> None:
    """Write the switches of all shards, sorted by time: ``switches.parquet``.

    Pieces have the type SWITCHED; an estimate of -1 means no estimate.
    """
    price = parameters.scale * parameters.switch_price

    def columns(chunk: NDArray[np.void]) -> dict[str, Any]:
        def named(track: Ints) -> "pa.Array":
            ids = np.full(len(track), "", names["estimates"].dtype)
            ids[track >= 0] = names["estimates"][track[track >= 0]]
            return _array(ids, track < 0)

        return {
            "t": names["times"][chunk["step"]],
            "truth": names["truths"][chunk["truth"]],
            "from": named(chunk["before"]),
            "to": named(chunk["after"]),
            "mass": 0.5 * chunk["variation"],
            "cost": price * chunk["variation"],
        }

    paths = tuple(map(str, pieces))
    edges = stretches(_rows_by_step(paths, len(names["times"])), ROWS_AT_ONCE)
    write_table(path, columns, in_order(paths, edges), np.zeros(0, SWITCHED))


def write_table(
    path: str, columns_of: Callable[[Any], dict[str, Any]], chunks: Iterable[Any], none: Any
) -> None:
    """Write a table in row groups under a temporary name, and rename it.

    Row groups have `ROW_GROUP` rows, so the bytes of the file do not depend on sizes of chunks.

    Parameters
    ----------
    path : str
        Path of the file; its folder is created if needed.
    columns_of : callable
        Function that returns the columns of a chunk by name.
    chunks : iterable
        Rows in order, in chunks of any size.
    none
        A chunk without rows, which defines the columns.

    Raises
    ------
    ConfigError
        The file cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    def batch(chunk: Any) -> "pa.RecordBatch":
        columns = columns_of(chunk).items()
        return pa.RecordBatch.from_pydict(
            {
                k: _array(v, v != v if v.dtype.kind == "f" else None)  # NaN becomes blank
                if isinstance(v, np.ndarray)
                else v
                for k, v in columns
            }
        )

    schema = batch(none).schema
    with (
        named(path, ConfigError, "cannot be written"),
        writing(path) as beside,
        pq.ParquetWriter(
            beside,
            schema,
            compression="zstd",
            use_dictionary=[
                field.name
                for field in schema
                if field.name in REPEATED or not pa.types.is_floating(field.type)
            ],
        ) as writer,
    ):
        for group in _row_groups(map(batch, chunks), schema):
            writer.write_table(group, ROW_GROUP)


def _row_groups(chunks: "Iterable[pa.RecordBatch]", schema: "pa.Schema") -> "Iterator[pa.Table]":
    """Yield the rows in tables of `ROW_GROUP` rows; the last table has the rest."""
    import pyarrow as pa

    pending, rows = list[pa.RecordBatch](), 0
    for chunk in chunks:
        pending.append(chunk)
        rows += len(chunk)
        if rows < ROW_GROUP:
            continue
        table = pa.Table.from_batches(pending, schema)
        whole = rows - rows % ROW_GROUP
        for first in range(0, whole, ROW_GROUP):
            yield table.slice(first, ROW_GROUP).combine_chunks()
        pending, rows = table.slice(whole).combine_chunks().to_batches(), rows - whole
    if rows:
        yield pa.Table.from_batches(pending, schema).combine_chunks()


def _array(names: NDArray[Any], absent: Mask | None = None) -> "pa.Array":
    """Return names as an Arrow array.

    It is built from buffers, because `pyarrow.array` imports pandas: 45 MB in each process.
    """
    import pyarrow as pa

    kind, values = pa.string(), [np.ascontiguousarray(names)]
    if names.dtype.kind in "iuf":
        kind = pa.from_numpy_dtype(names.dtype)
    else:
        coded = np.char.encode(names.astype(np.str_), "utf-8").astype(np.bytes_)  # even if empty
        length = np.char.str_len(coded)
        letters = coded.view(np.uint8).reshape(len(coded), coded.itemsize)
        values = [
            np.append(0, np.cumsum(length)).astype(np.int32),
            letters[np.arange(coded.itemsize) < length[:, None]],
        ]
    known = None if absent is None else np.packbits(~absent, bitorder="little")
    buffers = [None if each is None else pa.py_buffer(each) for each in (known, *values)]
    return pa.Array.from_buffers(kind, len(names), buffers)


# -------------------------------------------------------------------------------------------------
# Assigned pairs and switches of all shards as tables sorted by time.

ROWS_A_PART = 1 << 23
"""Number of rows of a file of assigned pairs; rows of its last step may exceed this number."""

ROWS_AT_ONCE = 1 << 15
"""Number of rows that are sorted at once; rows of the last step may exceed this number."""

ORDER = ("step", "truth", "estimate")


def write_part(
    output: str,
    pieces: Sequence[str],
    edges: Ints,
    names: str,
    parameters: Parameters,
    *,
    masked: bool,
) -> None:
    """Write the assigned pairs of some steps: ``assignments/part-*.parquet``.

    Parameters
    ----------
    output : str
        Path of the file.
    pieces : sequence of str
        Files of ASSIGNED_PAIR, each sorted by time.
    edges : (n + 1,) int array
        Edges of n ranges of steps with about `ROWS_AT_ONCE` rows each.
    names : str
        Folder of the names, each in a file NAME.npy.
    parameters : Parameters
        Parameters of the metric.
    masked : bool
        Whether there are ignored states.
    """
    times, *ids = (
        np.load(Path(names, f"{name}.npy"), mmap_mode="r")
        for name in ("times", "truths", "estimates")
    )
    truths, estimates = map(_array, ids)  # once for all chunks, which is three times faster

    def columns(chunk: NDArray[np.void]) -> dict[str, Any]:
        weight, cost = chunk["weight"], chunk["cost"]
        ignored = (chunk["marks"] & IGNORED_TRUTH).astype(np.int64)
        return {
            "t": times[chunk["step"]],
            "truth": truths.take(_array(chunk["truth"])),
            "estimate": estimates.take(_array(chunk["estimate"])),
            "weight": weight,
            "distance": parameters.cutoff * cost ** (1 / parameters.order),
            "cost": parameters.scale * (cost * (1 - ignored)) * weight,
            **({"ignored": ignored} if masked else {}),
            **{name: chunk[name] for name in _further(kind)},
        }

    kind = np.load(pieces[0], mmap_mode="r").dtype if pieces else ASSIGNED_PAIR
    write_table(output, columns, in_order(pieces, edges), np.zeros(0, kind))


def in_order(pieces: Sequence[str], edges: Ints) -> Iterator[NDArray[np.void]]:
    """Yield the rows of all pieces sorted by `ORDER`, one stretch between edges at a time."""
    opened = [np.load(piece, mmap_mode="r") for piece in pieces]
    for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        parts = [rows[_first(rows, low) : _first(rows, high)] for rows in opened]
        if sum(map(len, parts)):
            joined = np.concatenate(parts)
            names = joined.dtype.names or ()
            keys = [joined[name] for name in reversed(ORDER) if name in names]
            yield joined[np.lexsort(keys)]
        for rows in opened:  # pages read from mapped files would count as memory
            if hasattr(rows.base, "madvise"):
                rows.base.madvise(mmap.MADV_DONTNEED)


def _further(kind: np.dtype[Any]) -> tuple[str, ...]:
    """Return the columns in addition to those of ASSIGNED_PAIR."""
    return (kind.names or ())[len(ASSIGNED_PAIR.names or ()) :]


def looked_up(block: Scanned, numbers: Sequence[Ints], pieces: Sequence[str]) -> NDArray[np.void]:
    """Return the assigned pairs of a range of steps, with the values that `scan` wrote for them.

    Parameters
    ----------
    block : Scanned
        The range of steps.
    numbers : pair of int arrays
        Global numbers of its truths and of its estimates, sorted.
    pieces : sequence of str
        Files of ASSIGNED_PAIR, each sorted by time.
    """
    steps = np.array([block.first, block.first + len(block.objects[0])])
    rows = next(in_order(pieces, steps), np.zeros(0, ASSIGNED_PAIR))
    entry, width = np.load(block.folder / "entries.npy"), len(numbers[1])
    pair, place = np.unique(
        entry["truth"].astype(np.int64) * width + entry["estimate"], return_inverse=True
    )
    truth, estimate = map(np.searchsorted, numbers, (rows["truth"], rows["estimate"]))
    own, size = np.searchsorted(pair, truth * width + estimate), np.int64(len(pair))
    position = np.searchsorted(entry["step"] * size + place, rows["step"] * size + own)
    with np.load(block.folder / BESIDE) as beside:
        names = [(name, "<f8") for name in beside]
        made = np.empty(len(rows), [*ASSIGNED_PAIR.descr, *names])
        made[[*(ASSIGNED_PAIR.names or ())]] = rows
        for name, _ in names:
            made[name] = beside[name][position] * (1.0 if name == NEES else rows["weight"])
    return made


def sums_beside(
    pieces: Iterable[NDArray[np.void]], sizes: Sequence[int], components: int
) -> tuple[dict[str, Arrays], NeesSums | None]:
    """Add up further values of assigned pairs and their NEES: by step, by truth, by estimate.

    Parameters
    ----------
    pieces : iterable
        Outputs of `looked_up`, sorted by time.
    sizes : sequence of int
        Numbers of steps, truths and estimates.
    components : int
        Number d of components of a state.
    """
    by: dict[str, Arrays] = {index: {} for index in ORDER}
    nees: list[NeesSums] = []
    last = np.zeros(0, ASSIGNED_PAIR)
    for rows in pieces:
        weight, step = rows["weight"], rows["step"]
        values = {name: rows[name] for name in _further(rows.dtype)}
        if NEES in values:
            known = ~np.isnan(values[NEES])
            values |= {NEES: np.where(known, weight * values[NEES], 0.0), "count": weight * known}
            seam = np.concatenate((last, rows[step == step[:1]])) if len(last) else rows[:0]
            across, own = (
                nees_sums(AssignedPairs.of(some), some[NEES], components)
                for some in (each[each["marks"] & IGNORED_TRUTH == 0] for each in (seam, rows))
            )
            between = {name: getattr(across, name) for name in ("neighbours", "products", "ends")}
            nees += [own, NeesSums(components=components, **between)]
            last = rows[step == step[-1:]]
        for (index, sums), size in zip(by.items(), sizes, strict=True):
            for name, value in values.items():
                sums[name] = sums.get(name, 0.0) + np.bincount(rows[index], value, size)
    for sums in by.values() if nees else ():
        sums |= mean_columns(sums.pop("count"), sums.pop(NEES), components)
    return by, NeesSums.joined(nees)


def _first(rows: NDArray[np.void], step: int) -> int:
    """Return the first row of this step or of a later step, by bisection."""
    return bisect_left(rows, step, key=_step)


def _step(row: Any) -> int:
    return int(row["step"])


def _rows_by_step(pieces: Sequence[str], steps: int) -> Ints:
    """Count the rows at each step (T,)."""
    counts = np.zeros(steps, np.int64)
    for piece in pieces:
        rows = np.load(piece, mmap_mode="r")
        for first in range(0, len(rows), ROWS_AT_ONCE):
            step = rows["step"][first : first + ROWS_AT_ONCE]
            added = np.bincount(step - step[0])
            counts[step[0] : step[0] + len(added)] += added
    return counts


def existing_files(folders: Iterable[Path], name: str) -> list[Path]:
    """Return the files with this name in the folders."""
    return [folder / name for folder in folders if (folder / name).exists()]


# -------------------------------------------------------------------------------------------------
# Results of the shards as the tables of a result.


def write_tables(
    folder: str,
    names: Names,
    proof: Costs,
    tracks: Iterable[tuple[Ints, PerTrack]],
    shards: Sequence[Path],
    run: Run = run_tasks,
    *,
    assigned: Sequence[Path],
    further: Mapping[str, Arrays],
    assignments: bool = True,
) -> StoredTables:
    """Write the tables that do not exist yet.

    Parameters
    ----------
    folder : str
        Folder of the tables; a folder `names` is made next to it.
    names : Names
        Times and ids.
    proof : Costs
        Costs of the whole evaluation.
    tracks : pair of pairs
        Number of steps and costs of each track: a pair for truths, and a pair for estimates.
    shards : sequence of Path
        Folders with ``switched.npy``, each sorted by time.
    run : callable
        Function that does tasks.
    assigned : sequence of Path
        Files of assigned pairs, each sorted by time.
    further : mapping
        Further columns of steps, truths and estimates, by the names of `ORDER`.
    assignments : bool
        Whether to fill the table of assigned pairs, which is as long as the data. If not, the
        table has no rows.

    Raises
    ------
    ConfigError
        A table cannot be written, or pyarrow is not installed.
    """
    if find_spec("pyarrow") is None:
        raise ConfigError(
            f"tables of partitioned data need the extra parquet: {install('parquet')}"
        )
    place, parameters = Path(folder), proof.parameters
    beside = place.parent / "names"
    if not beside.exists():
        with writing_folder(str(beside)) as made:
            for name, array in names.items():
                np.save(made / f"{name}.npy", array)

    def missing(table: str) -> str | None:
        path = place / name_of(table)
        return None if path.exists() else str(path)

    if path := missing("per_step"):
        costs = step_columns(proof.breakdown, parameters.scale)
        _write_columns(path, {"t": names["times"]} | costs | further["step"])
    for side, (table, ids, (steps, parts)) in enumerate(
        zip(("per_truth", "per_estimate"), ("truths", "estimates"), tracks, strict=True)
    ):
        if path := missing(table):
            columns = track_columns(side, steps, parts, parameters.scale)
            _write_columns(path, {"id": names[ids]} | columns | further[ORDER[1 + side]])
    if path := missing("switches"):
        write_switches(path, existing_files(shards, "switched.npy"), names, parameters)
    pieces = tuple(map(str, assigned)) if assignments else ()
    rows = _rows_by_step(pieces, len(names["times"]))
    tasks: dict[str, Task] = {
        str(place / name_of(IN_PARTS) / f"part-{number:05d}.parquet"): partial(
            write_part,
            pieces=pieces,
            edges=low + stretches(rows[low:high], ROWS_AT_ONCE),
            names=str(beside),
            parameters=parameters,
            masked="ignored" in further["step"],
        )
        for number, (low, high) in enumerate(
            list(itertools.pairwise(stretches(rows, ROWS_A_PART))) or [(0, 0)]
        )
    }
    run(tasks)
    return StoredTables(folder)
