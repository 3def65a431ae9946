"""What a side has and where: its times, the rows at each, and the units that blocks are read of."""

import pickle
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.headers import Roles
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.partitioned.input.listing import File
from tgospa_eval.partitioned.input.runs import (
    FilePiece,
    Moments,
    RunsTask,
    merged_moments,
    moments_of,
    write_runs,
)
from tgospa_eval.partitioned.input.tables import ParquetTable, open_table, read_head, size_of
from tgospa_eval.partitioned.tasks import Run, writing
from tgospa_eval.text import listed
from tgospa_eval.tracks.trajectories import Floats, Ints, TimeArray

TIMES_TOGETHER = 1 << 24
"""Rows whose times are one task."""

REREAD = 4
"""Times that each row may be decoded, on average, before the side is sorted into runs instead."""


BYTES_OF_LINE = 32
"""Of a text, about: less, and there are more runs; more, and they are larger."""

LEAST_TEXT, MOST_TEXT = 1 << 12, 1 << 26
"""Bytes of text that are read at once."""

PACKED_TO = 8
"""Times its size to which a compressed text unpacks, about."""


@dataclass(frozen=True, kw_only=True)
class Unit:
    """What blocks are read of: a row group, or a run.

    Parameters
    ----------
    low, high : int or float
        Its first and its last time, as the files have them.
    rows : int
        Its rows.
    piece : FilePiece, optional
        The row group; else it is a run.
    folder : str
        Of the run.
    """

    low: int | float
    high: int | float
    rows: int
    piece: FilePiece | None = None
    folder: str = ""


@dataclass(frozen=True, kw_only=True)
class TimesTask:
    """Write the distinct times of some row groups of a file.

    Parameters
    ----------
    file : File
        Which.
    begin, end : int
        Row groups.
    options : ReadOptions
        How to read it.
    output : str
        The file to write.
    """

    file: File
    begin: int
    end: int
    options: ReadOptions
    output: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Index:
    """What a side has and where.

    Parameters
    ----------
    units : list of Unit
        In the order of the files.
    moments : Moments
        All times.
    roles : Roles
        Of the columns of the first file.
    """

    units: list[Unit]
    moments: Moments
    roles: Roles


def write_times(task: TimesTask) -> None:
    """Do a task."""
    table = open_table(task.file, task.options)
    path = task.file.path
    found = [
        merged_moments(moments_of(times, path) for times in table.times(group, task.options))
        for group in range(task.begin, task.end)
    ]
    with writing(task.output) as beside:
        beside.write_bytes(pickle.dumps(found))


@dataclass(frozen=True, kw_only=True)
class IndexSource:
    """What an index is made of.

    Parameters
    ----------
    files : sequence of File
        In order.
    options : ReadOptions
        How to read them.
    store : Path
        The folder of the index.
    rows_together : int
        Rows of the blocks that will be read, about.
    """

    files: Sequence[File]
    options: ReadOptions
    store: Path
    rows_together: int


def index_tables(source: IndexSource, run: Run[Any]) -> Index:
    """The index of Parquet files, which are sorted into runs if blocks would read them too often.

    Raises
    ------
    InputError
        A file is damaged, or has other columns than the first.
    """
    options = source.options
    tasks: list[TimesTask] = []
    first = open_table(source.files[0], options)
    for number, file in enumerate(source.files):
        table = open_table(file, options)
        check_alike(table.roles, first.roles, file, first.file)
        tasks += _tasks_of(table, options, str(source.store / "times" / f"{number:06}"))
    run(write_times, tasks)
    units: list[Unit] = []
    whole = merged_moments(_gathered(tasks, units))
    if _decoded(units, whole, source.rows_together) <= REREAD * whole.count.sum():
        return Index(units=units, moments=whole, roles=first.roles)
    pieces = [(unit.piece, unit.rows) for unit in units if unit.piece is not None]
    return _sorted(pieces, first.roles, source, run)


def index_texts(source: IndexSource, run: Run[Any]) -> Index:
    """The index of CSV files, whose rows are read once and sorted into runs.

    Raises
    ------
    InputError
        A row is wrong, or a file has other columns than the first.
    """
    size = min(max(source.rows_together * BYTES_OF_LINE, LEAST_TEXT), MOST_TEXT)
    first = read_head(source.files[0], source.options)
    pieces: list[tuple[FilePiece, int]] = []
    for file in source.files:
        head = read_head(file, source.options)
        check_alike(head.roles, first.roles, file, source.files[0])
        whole = size_of(file)
        if head.packed:
            piece = FilePiece(file=file, begin=0, end=size, text=True)
            pieces.append((piece, PACKED_TO * whole // BYTES_OF_LINE))
            continue
        for begin in range(0, whole, size):
            end = min(begin + size, whole)
            piece = FilePiece(file=file, begin=begin, end=end, text=True)
            pieces.append((piece, (end - begin) // BYTES_OF_LINE))
    return _sorted(pieces, first.roles, source, run)


def _tasks_of(table: ParquetTable, options: ReadOptions, output: str) -> Iterator[TimesTask]:
    """Tasks for the row groups of a file, several in each."""
    groups = table.groups
    begin = together = 0
    for group, count in enumerate(groups):
        together += count
        if together >= TIMES_TOGETHER or group == len(groups) - 1:
            yield TimesTask(
                file=table.file,
                begin=begin,
                end=group + 1,
                options=options,
                output=f"{output}-{begin:06}",
            )
            begin, together = group + 1, 0


def _gathered(tasks: Sequence[TimesTask], units: list[Unit]) -> Iterator[Moments]:
    """The times of all row groups that have some, and a unit for each."""
    for task in tasks:
        found = pickle.loads(Path(task.output).read_bytes())
        for group, moments in zip(range(task.begin, task.end), found, strict=True):
            if len(moments.value):
                piece = FilePiece(file=task.file, begin=group, end=group + 1)
                units.append(_unit(moments, piece=piece))
                yield moments


def _unit(moments: Moments, piece: FilePiece | None = None, folder: str = "") -> Unit:
    return Unit(
        low=moments.value[0].item(),
        high=moments.value[-1].item(),
        rows=int(moments.count.sum()),
        piece=piece,
        folder=folder,
    )


def _decoded(units: Sequence[Unit], whole: Moments, rows_together: int) -> int:
    """Rows that are decoded if blocks of so many rows are read from these units."""
    if not units:
        return 0
    block = (np.cumsum(whole.count) - 1) // rows_together
    first = block[np.searchsorted(whole.value, [unit.low for unit in units])]
    last = block[np.searchsorted(whole.value, [unit.high for unit in units])]
    return int(((last - first + 1) * [unit.rows for unit in units]).sum())


def _sorted(
    pieces: Sequence[tuple[FilePiece, int]], roles: Roles, source: IndexSource, run: Run[Any]
) -> Index:
    """The index of pieces, with their rows or an estimate of them, after they became runs."""
    tasks: list[RunsTask] = []
    waiting: list[FilePiece] = []
    rows = 0
    for number, (piece, count) in enumerate(pieces, 1):
        waiting.append(piece)
        rows += count
        if rows >= source.rows_together or number == len(pieces):
            tasks.append(
                RunsTask(
                    pieces=tuple(waiting),
                    options=source.options,
                    rows=source.rows_together,
                    output=str(source.store / "runs" / f"{len(tasks):06}"),
                )
            )
            waiting, rows = [], 0
    run(write_runs, tasks)
    units: list[Unit] = []

    def gathered() -> Iterator[Moments]:
        for task in tasks:
            found = pickle.loads(Path(task.output, "moments").read_bytes())
            for k, moments in enumerate(found):
                units.append(_unit(moments, folder=str(Path(task.output, str(k)))))
                yield moments

    return Index(moments=merged_moments(gathered()), units=units, roles=roles)


def check_alike(roles: Roles, first: Roles, file: File, first_file: File) -> None:
    """Whether a file has the columns of the first.

    Raises
    ------
    InputError
        It has others.
    """
    if columns_in_use(roles) == columns_in_use(first):
        return
    raise InputError(
        f"{file.path}: read by its columns {listed(columns_in_use(roles))}, and "
        f"{first_file.path} by {listed(columns_in_use(first))}; write the same into all files, or "
        "name them with --columns"
    )


def columns_in_use(roles: Roles) -> list[str]:
    """Headers of ids, times, classes and numbers, in an order that is not that of the file."""
    columns = [roles.id, roles.time, *([] if roles.klass is None else [roles.klass])]
    return [roles.headers[column] for column in (*columns, *roles.numbers)]


# -------------------------------------------------------------------------------------------------
# The index of a side, stored: its steps, and the units that blocks are read of.


@dataclass(frozen=True, kw_only=True, eq=False)
class SideSteps:
    """Steps of a side within the range of time that is asked for, and what they are read of.

    Parameters
    ----------
    raw, times : (T,) int64 or float64 arrays
        Distinct times as the files have them, and on the clock of the evaluation.
    counts : (T,) int64 array
        Rows at each.
    labels : (T,) array of bytes, optional
        Times as they are shown, in UTF-8, where they are no numbers.
    texts : (T,) array of bytes, optional
        Likewise as they were read, if they are shown otherwise.
    converted : bool
        Whether `times` are others than `raw`.
    units : list of Unit
        In the order of the files.
    lows, highs : (U,) arrays
        First and last time of each.
    roles : Roles
        Of the columns of the first file.
    """

    raw: TimeArray
    times: TimeArray
    counts: Ints
    labels: NDArray[np.bytes_] | None
    texts: NDArray[np.bytes_] | None
    converted: bool
    units: list[Unit]
    lows: Floats | Ints
    highs: Floats | Ints
    roles: Roles

    @property
    def shown(self) -> "Texts | TimeArray":
        """Times as they are shown."""
        return self.times if self.labels is None else Texts(self.labels)

    def read_as(self, time: float) -> str | float:
        """What the files have for a time."""
        at = int(np.searchsorted(self.times, time))
        texts = self.labels if self.texts is None else self.texts
        if texts is not None:
            return Texts(texts)[at]
        found: float = self.raw[at].item()
        return found


class Texts(Sequence[str]):
    """Texts in UTF-8, which are read where they are looked at."""

    def __init__(self, content: NDArray[np.bytes_]) -> None:
        self.content = content

    def __len__(self) -> int:
        return len(self.content)

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> "Texts": ...
    def __getitem__(self, place: int | slice) -> "str | Texts":
        if isinstance(place, slice):
            return Texts(self.content[place])
        text: bytes = self.content[place]
        return text.decode()


def store_steps(index: Index, options: ReadOptions, store: Path, name: str) -> int:
    """Write the steps of a side into a folder; the answer is how many rows --time leaves out.

    Raises
    ------
    ConfigError
        Times cannot be converted, or are of another kind than --time.
    """
    moments = index.moments
    labels = None
    if moments.label is not None:
        labels = np.empty(len(moments.label), dtype=object)
        labels[:] = list(Texts(moments.label))
    times, shown = options.conversion.times(moments.value, moments.clock, labels, name)
    inside = np.ones(len(times), bool)
    if options.moments is not None:
        inside = options.moments.inside(times, moments.clock, name)
    kept: dict[str, NDArray[np.generic]] = {
        "raw": moments.value[inside],
        "times": times[inside],
        "counts": moments.count[inside],
    }
    if shown is not None and moments.label is not None:
        texts = [text.encode() for text in shown[inside].tolist()]
        kept["labels"] = np.array(texts, dtype=np.bytes_)
        if times is not moments.value:
            kept["texts"] = moments.label[inside]
    store.mkdir(parents=True, exist_ok=True)
    for key, array in kept.items():
        np.save(store / f"{key}.npy", array)
    (store / "units").write_bytes(
        pickle.dumps((index.units, index.roles, times is not moments.value))
    )
    return int(moments.count[~inside].sum())


@lru_cache(maxsize=4)
def steps_of(store: str) -> SideSteps:
    """What `store_steps` wrote; arrays stay in their files."""
    folder = Path(store)
    units, roles, converted = pickle.loads((folder / "units").read_bytes())
    arrays = {
        key: np.load(folder / f"{key}.npy", mmap_mode="r") for key in ("raw", "times", "counts")
    }

    def texts(key: str) -> NDArray[np.bytes_] | None:
        path = folder / f"{key}.npy"
        found: NDArray[np.bytes_] | None = np.load(path, mmap_mode="r") if path.exists() else None
        return found

    return SideSteps(
        **arrays,
        labels=texts("labels"),
        texts=texts("texts"),
        converted=converted,
        units=units,
        lows=np.array([unit.low for unit in units]),
        highs=np.array([unit.high for unit in units]),
        roles=roles,
    )
