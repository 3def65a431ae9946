"""What a side has and where: its times, the rows at each, and the runs that blocks are read of."""

import json
from collections.abc import Iterator, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.roles import Roles
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.partitioned.input.listing import File
from tgospa_eval.partitioned.input.runs import (
    Moments,
    merged_moments,
    run_moments,
    write_runs,
)
from tgospa_eval.partitioned.input.tables import FilePiece, open_table, read_head, size_of
from tgospa_eval.partitioned.tasks import Run, Task, writing
from tgospa_eval.text import listed
from tgospa_eval.tracks.trajectories import Floats, Ints, TimeArray

BYTES_OF_LINE = 32
"""Of a text, about: less, and there are more runs; more, and they are larger."""

LEAST_TEXT, MOST_TEXT = 1 << 12, 1 << 26
"""Bytes of text that are read at once."""

PACKED_TO = 8
"""Times its size to which a compressed text unpacks, about."""


def side_roles(format: str, file: File, options: ReadOptions) -> Roles:
    """Which column is what in a file.

    Raises
    ------
    InputError
        It is damaged, or lacks columns.
    """
    return read_head(file, options).roles if format == "csv" else open_table(file, options)[2]


def index_side(
    format: str,
    files: Sequence[File],
    options: ReadOptions,
    *,
    store: Path,
    rows_together: int,
    name: str,
    run: Run,
) -> None:
    """Sort the rows of all files into runs, and write which steps there are.

    Parameters
    ----------
    format : {"csv", "parquet"}
        Of the files.
    files : sequence of File
        In order.
    options : ReadOptions
        How to read them.
    store : Path
        The folder of the index.
    rows_together : int
        Rows of the blocks that will be read, about.
    name : str
        Of the side, for messages.
    run : callable
        Does tasks, as `partitioned.tasks.run_tasks`.

    Raises
    ------
    InputError
        A row is wrong, a file is damaged, or has other columns than the first.
    ConfigError
        Times cannot be converted, or are of another kind than --time.
    """
    pieces = (text_pieces if format == "csv" else table_pieces)(files, options, rows_together)
    tasks: dict[str, Task] = {}
    waiting: list[FilePiece] = []
    rows = 0
    for number, (piece, count) in enumerate(pieces, 1):
        waiting.append(piece)
        rows += count
        if rows >= rows_together or number == len(pieces):
            tasks[str(store / "runs" / f"{len(tasks):06}")] = partial(
                write_runs, pieces=tuple(waiting), options=options, rows_together=rows_together
            )
            waiting, rows = [], 0
    run(tasks)
    runs = [
        folder
        for output in tasks
        for folder in sorted(Path(output).iterdir(), key=lambda path: int(path.name))
    ]
    ends: list[tuple[int | float, int | float]] = []

    def gathered() -> Iterator[Moments]:
        for folder in runs:
            found = run_moments(folder)
            ends.append((found.value[0].item(), found.value[-1].item()))
            yield found

    moments = merged_moments(gathered())
    with writing(str(store / "steps")) as folder:
        folder.mkdir()
        known = {
            "runs": [str(run.relative_to(store)) for run in runs],
            "ends": ends,
            "clock": moments.clock,
            "rows": int(moments.count.sum()),
            **_save_steps(moments, options, folder, name),
        }
        (folder / "index.json").write_text(json.dumps(known), encoding="utf-8")


def table_pieces(
    files: Sequence[File],
    options: ReadOptions,
    rows_together: int,  # noqa: ARG001  (as `text_pieces`)
) -> list[tuple[FilePiece, int]]:
    """The row groups of Parquet files that have rows, and how many."""
    pieces = []
    first = side_roles("parquet", files[0], options)
    for file in files:
        content, _, roles = open_table(file, options)
        check_alike(roles, first, file, files[0])
        for group in range(content.metadata.num_row_groups):
            if rows := content.metadata.row_group(group).num_rows:
                piece = FilePiece(file=file, begin=group, end=group + 1, text=False)
                pieces.append((piece, rows))
    return pieces


def text_pieces(
    files: Sequence[File], options: ReadOptions, rows_together: int
) -> list[tuple[FilePiece, int]]:
    """Stretches of CSV files, and about how many rows each has."""
    size = min(max(rows_together * BYTES_OF_LINE, LEAST_TEXT), MOST_TEXT)
    pieces = []
    first = side_roles("csv", files[0], options)
    for file in files:
        head = read_head(file, options)
        check_alike(head.roles, first, file, files[0])
        whole = size_of(file)
        if head.packed:
            piece = FilePiece(file=file, begin=0, end=size, text=True)
            pieces.append((piece, PACKED_TO * whole // BYTES_OF_LINE))
            continue
        for begin in range(0, whole, size):
            end = min(begin + size, whole)
            piece = FilePiece(file=file, begin=begin, end=end, text=True)
            pieces.append((piece, (end - begin) // BYTES_OF_LINE))
    return pieces


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
    clock : {"number", "local", "zoned"}
        What the times are.
    rows : int
        Rows of all files.
    outside : int
        How many of them --time leaves out.
    runs : list of str
        Folders of the rows.
    ends : (N, 2) array
        First and last time of each, as the files have them.
    """

    raw: TimeArray
    times: TimeArray
    counts: Ints
    labels: NDArray[np.bytes_] | None
    texts: NDArray[np.bytes_] | None
    converted: bool
    clock: str
    rows: int
    outside: int
    runs: list[str]
    ends: Floats | Ints

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


def _save_steps(
    moments: Moments, options: ReadOptions, folder: Path, name: str
) -> dict[str, int | bool]:
    """Write the steps of a side into a folder; what else is to be known of them."""
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
    for key, array in kept.items():
        np.save(folder / f"{key}.npy", array)
    return {"outside": int(moments.count[~inside].sum()), "converted": times is not moments.value}


@lru_cache(maxsize=4)
def steps_of(store: str) -> SideSteps:
    """What `index_side` wrote; arrays stay in their files."""
    folder = Path(store, "steps")
    known = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    known["runs"] = [str(Path(store, run)) for run in known["runs"]]
    known["ends"] = np.array(known["ends"]).reshape(-1, 2)
    paths = {key: folder / f"{key}.npy" for key in ("raw", "times", "counts", "labels", "texts")}
    arrays: dict[str, Any] = {
        key: np.load(path, mmap_mode="r") if path.exists() else None for key, path in paths.items()
    }
    return SideSteps(**known, **arrays)
