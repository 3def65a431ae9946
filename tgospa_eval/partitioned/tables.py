"""Tables of a result, written as Parquet in chunks, with one chunk in memory at a time.

A table has the same columns, and rows in the same order, as the CSV file of the same name
(docs/reference/result-tables.md). This module makes tables from the arrays that `shards` wrote.
In the arrays, costs are in units of c^p, and tracks and steps are given by their indices in the
whole data. In the tables, costs are in the user's units, and tracks and steps are given by the ids
and times of the user.
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
"""Number of rows of a row group. Writers and readers have one row group in memory at a time."""

REPEATED = ("t", "weight", "mass")
"""Names of columns of doubles that have few distinct values. Parquet stores them with a dictionary
of these values. Other columns of doubles are smaller, and faster to write, without a dictionary."""


Names: TypeAlias = Mapping[str, NDArray[Any]]
"""Names of steps and tracks: ``times`` has the displayed time of each step, and ``truths`` and
``estimates`` have the id of each track. Arrays of texts have a NumPy text type, not Python objects,
so that they can be memory maps of files."""


def _write_columns(path: str, columns: Arrays) -> None:
    """Write a table from columns that are in memory."""

    def own(rows: slice) -> Arrays:
        return {name: column[rows] for name, column in columns.items()}

    size = len(next(iter(columns.values())))
    slices = (slice(first, first + ROW_GROUP) for first in range(0, size, ROW_GROUP))
    write_table(path, own, slices, slice(0))


def write_switches(path: str, pieces: Sequence[Path], names: Names, parameters: Parameters) -> None:
    """Write the switches of all shards, sorted by time: ``switches.parquet``.

    `pieces` are files with arrays of type SWITCHED, in which -1 means "no estimate".
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
    """Write a table under a temporary name, and rename it at the end.

    All row groups except the last have `ROW_GROUP` rows. As a result, the bytes of the file do not
    depend on the sizes of the chunks.

    Parameters
    ----------
    path : str
        Path of the file; its folder is created if needed.
    columns_of : callable
        Function that receives a chunk and returns its columns by name.
    chunks : iterable
        Chunks of any size, in order. A chunk is any object that `columns_of` accepts.
    none
        A chunk without rows, from which the names and types of the columns are taken.

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
                k: _array(v, v != v if v.dtype.kind == "f" else None)  # NaN becomes a missing value
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
    """Yield the rows of all chunks as tables of `ROW_GROUP` rows; the last table has the rest."""
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
    """Return texts or numbers as an Arrow array, with missing values where `absent` is True.

    The array is built from buffers. `pyarrow.array` is not used, because it imports pandas, which
    takes 45 MB in each process.
    """
    import pyarrow as pa

    kind, values = pa.string(), [np.ascontiguousarray(names)]
    if names.dtype.kind in "iuf":
        kind = pa.from_numpy_dtype(names.dtype)
    else:
        # `astype` ensures that the type is bytes, also if there are no names.
        coded = np.char.encode(names.astype(np.str_), "utf-8").astype(np.bytes_)
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
# Assigned pairs of all shards as one table sorted by time, in several files.

ROWS_A_PART = 1 << 23
"""Approximate number of rows of a file of assigned pairs. All rows of a step are in one file."""

ROWS_AT_ONCE = 1 << 15
"""Approximate number of rows that are sorted at once. All rows of a step are sorted together."""

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
    """Write the assigned pairs of some steps into one file ``assignments/part-*.parquet``.

    Parameters
    ----------
    output : str
        Path of the file.
    pieces : sequence of str
        Files of ASSIGNED_PAIR, each sorted by time.
    edges : (n + 1,) int array
        First step of each of n ranges of steps, and the end of the last range. Each range has about
        `ROWS_AT_ONCE` rows.
    names : str
        Folder with the arrays of `Names`, in files such as ``truths.npy``.
    parameters : Parameters
        Parameters of the metric.
    masked : bool
        Whether the table has a column ``ignored``, because there are ignored or excused states.
    """
    times, *ids = (
        np.load(Path(names, f"{name}.npy"), mmap_mode="r")
        for name in ("times", "truths", "estimates")
    )
    truths, estimates = map(_array, ids)  # once for all chunks: three times faster than for each

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
    """Yield the rows of all pieces sorted by `ORDER`, one range of steps at a time.

    `pieces` are files with arrays sorted by time. `edges` has the first step of each range, and the
    end of the last range. Ranges without rows are left out.
    """
    opened = [np.load(piece, mmap_mode="r") for piece in pieces]
    for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        parts = [rows[_first(rows, low) : _first(rows, high)] for rows in opened]
        if sum(map(len, parts)):
            joined = np.concatenate(parts)
            names = joined.dtype.names or ()
            keys = [joined[name] for name in reversed(ORDER) if name in names]
            yield joined[np.lexsort(keys)]
        for rows in opened:  # free the pages read so far, which count as memory of the process
            if hasattr(rows.base, "madvise"):
                rows.base.madvise(mmap.MADV_DONTNEED)


def _further(kind: np.dtype[Any]) -> tuple[str, ...]:
    """Return the names of the fields that a type has in addition to those of ASSIGNED_PAIR."""
    return (kind.names or ())[len(ASSIGNED_PAIR.names or ()) :]


def looked_up(block: Scanned, numbers: Sequence[Ints], pieces: Sequence[str]) -> NDArray[np.void]:
    """Return the assigned pairs of a block, with their further values (see `scan.BESIDE`).

    All further values except NEES are multiplied by the weights of the pairs.

    Parameters
    ----------
    block : Scanned
        The block of time.
    numbers : pair of int arrays
        Global numbers of the truths and of the estimates in the block, sorted.
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
    """Add up the further values of assigned pairs for each step, each truth and each estimate.

    Parameters
    ----------
    pieces : iterable
        Results of `looked_up` for all blocks, in order of time.
    sizes : sequence of int
        Numbers of steps, truths and estimates.
    components : int
        Number of state columns.

    Returns
    -------
    dict of dict of arrays
        For each name in `ORDER` (step, truth, estimate), the columns of sums by their names.
    NeesSums or None
        Sums of NEES over all pairs; None if the pairs have no NEES.
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
    """Return the index of the first row that is not before `step`."""
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
    """Return the file with this name in each of the folders that has one."""
    return [folder / name for folder in folders if (folder / name).exists()]


# -------------------------------------------------------------------------------------------------
# All tables of a result, from the results of the shards.


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
        Folder of the tables. A folder ``names`` is made next to it.
    names : Names
        Times and ids.
    proof : Costs
        Costs of the whole evaluation.
    tracks : pair of pairs
        For truths and for estimates: the number of rows of each track, and the costs of each track.
    shards : sequence of Path
        Folders that `solve_shard` wrote, with switches sorted by time.
    run : callable
        Function that does tasks.
    assigned : sequence of Path
        Files of assigned pairs, each sorted by time.
    further : mapping
        Further columns of the tables of steps, truths and estimates, by the names in `ORDER`.
    assignments : bool
        Whether to write the rows of the table of assigned pairs. If False, this table has only a
        header. If True, it is about as large as the data.

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
