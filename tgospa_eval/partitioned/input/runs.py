"""Rows of a side in order of time: runs of bounded size, each sorted, from which blocks are read.

A side whose files are not in order of time is read once. As many rows as are worked on together
are sorted by time and written as a run; a block takes its share of each run, which is one range.
"""

import json
import math
import pickle
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.headers import Roles
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Numbered, Rows, number_ids
from tgospa_eval.formats.times import EXACT_BELOW, Times
from tgospa_eval.partitioned.input.listing import File
from tgospa_eval.partitioned.input.tables import Chunk, Span, open_table, rows_of_chunks, text_rows
from tgospa_eval.partitioned.tasks import writing
from tgospa_eval.tracks.trajectories import CLOCKS, Ints, TimeArray

PENDING = 1 << 22
"""Distinct times that wait to be merged with those of other parts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Moments:
    """Distinct times of some rows.

    Parameters
    ----------
    value : (T,) int64 or float64 array
        Strictly increasing, as the files have them.
    count : (T,) int64 array
        Rows at each.
    clock : {"number", "local", "zoned"}
        What they are.
    label : (T,) array of bytes, optional
        Their texts in UTF-8, where they are no numbers; of equal times the first in the files.
    source : str
        The file that they, or the first of them, are from.
    """

    value: TimeArray
    count: Ints
    clock: str
    label: NDArray[np.bytes_] | None
    source: str


NO_MOMENTS = Moments(
    value=np.zeros(0, np.int64),
    count=np.zeros(0, np.int64),
    clock="number",
    label=None,
    source="",
)
"""Of no rows."""


def moments_of(times: Times, source: str) -> Moments:
    """The distinct times of rows that are in the order of their file."""
    value, label = times.value, None
    if times.text is None and (value[1:] >= value[:-1]).all():  # as most programs write them
        begins = np.flatnonzero(np.append(True, value[1:] > value[:-1])[: len(value)])
        count = np.diff(np.append(begins, len(value)))
        begun = value[begins]
        return Moments(value=begun, count=count, clock=times.clock, label=None, source=source)
    found, first, count = np.unique(value, return_index=True, return_counts=True)
    if times.text is not None:
        texts = [times.text[row].strip().encode() for row in first.tolist()]
        label = np.array(texts, dtype=np.bytes_)
    found = cast(TimeArray, found)
    return Moments(value=found, count=count, clock=times.clock, label=label, source=source)


def merged_moments(parts: Iterable[Moments]) -> Moments:
    """The distinct times of all parts, given in the order of the files.

    Raises
    ------
    InputError
        They are of several kinds.
    """
    whole = NO_MOMENTS
    waiting: list[Moments] = []
    size = 0
    for part in parts:
        waiting.append(part)
        size += len(part.value)
        if size > PENDING:
            whole, waiting = _merged([whole, *waiting]), []
            size = 0
    return _merged([whole, *waiting])


def _merged(given: Sequence[Moments]) -> Moments:
    filled = [part for part in given if len(part.value)]
    if len(filled) < 2:
        return filled[0] if filled else NO_MOMENTS
    first = filled[0]
    for part in filled:
        if part.clock != first.clock:
            raise InputError(
                f"{part.source}: its times are {CLOCKS[part.clock]}, and those of {first.source} "
                f"are {CLOCKS[first.clock]}; write those of all files alike"
            )
    value = in_one_type([(part.value, part.source) for part in filled])
    count = np.concatenate([part.count for part in filled])
    order = np.argsort(value, kind="stable")
    value = value[order]
    begins = np.flatnonzero(np.append(True, value[1:] > value[:-1]))
    labels = [part.label for part in filled if part.label is not None]
    return Moments(
        value=value[begins],
        count=np.add.reduceat(count[order], begins),
        clock=first.clock,
        label=np.concatenate(labels)[order][begins] if labels else None,
        source=first.source,
    )


def in_one_type(parts: Sequence[tuple[TimeArray, str]]) -> TimeArray:
    """Times of several sources, one after the other: integers, or doubles if some are.

    Raises
    ------
    InputError
        An integer beside doubles is too large for one.
    """
    if len({value.dtype for value, _ in parts}) > 1:
        for value, source in parts:
            if value.dtype.kind == "i" and len(value) and np.abs(value).max() >= EXACT_BELOW:
                raise InputError(
                    f"{source}: has integer times that are not exact beside the decimal times of "
                    "other files; write all times as 64-bit integers"
                )
    return np.concatenate([value for value, _ in parts])


def merged_rows(name: str, parts: Sequence[Rows]) -> Rows:
    """Rows of parts with the same columns, one after the other; `name` is that of the whole."""
    ends = list(accumulate(len(part.times.value) for part in parts))
    roles = parts[0].roles
    numbers = np.empty((ends[-1], len(roles.numbers)), order="F")
    for part, end in zip(parts, ends, strict=True):
        numbers[end - len(part.numbers) : end] = part.numbers

    def where(row: int) -> str:
        part = bisect_right(ends, row)
        return parts[part].where(row - (ends[part - 1] if part else 0))

    classes = [part.classes for part in parts if part.classes is not None]
    return Rows(
        name=name,
        roles=roles,
        ids=merged_names([part.ids for part in parts]),
        times=Times(
            value=in_one_type([(part.times.value, part.name) for part in parts]),
            clock=parts[0].times.clock,
            text=None,
        ),
        numbers=numbers,
        where=where,
        classes=merged_names(classes) if classes else None,
    )


def merged_names(parts: Sequence[Numbered]) -> Numbered:
    """Names in natural order, those that occur, and the number of each row's."""
    if len(parts) == 1:
        return parts[0]
    names: list[str] = []
    used = []
    for table, number in parts:
        occurs = np.flatnonzero(np.bincount(number, minlength=len(table)))
        used.append((len(table), occurs, len(names)))
        names += table[occurs].tolist()
    table, rank = number_ids(names)
    numbers = []
    for (size, occurs, begin), (_, number) in zip(used, parts, strict=True):
        places = np.zeros(size, np.int64)
        places[occurs] = rank[begin : begin + len(occurs)]
        numbers.append(places[number])
    return table, np.concatenate(numbers)


@dataclass(frozen=True, kw_only=True)
class FilePiece:
    """What of a file is read at once: row groups, or the lines of a text that begin in some bytes.

    Parameters
    ----------
    file : File
        The file.
    begin, end : int
        Row groups, or bytes.
    text : bool
        Whether it is a text.
    """

    file: File
    begin: int
    end: int
    text: bool = False

    def where(self, row: int, options: ReadOptions) -> str:
        """Where a row is, for messages: of a table by its place there, of a text in the piece."""
        if not self.text:
            return f"{self.file.path}, row {row}"
        for rows, first in text_rows(self.file, self.begin, self.end, options):
            if row < first + len(rows.times.value):
                return rows.where(row - first)
        return self.file.path  # it has changed meanwhile


@dataclass(frozen=True, kw_only=True)
class RunsTask:
    """Write the rows of some pieces as runs.

    Parameters
    ----------
    pieces : tuple of FilePiece
        In the order of the files.
    options : ReadOptions
        How to read them.
    rows : int
        Rows of a run, as soon as there are as many.
    output : str
        The folder.
    """

    pieces: tuple[FilePiece, ...]
    options: ReadOptions
    rows: int
    output: str


@dataclass(frozen=True, kw_only=True)
class RowOrigin:
    """Where consecutive rows of a run are from.

    Parameters
    ----------
    begin : int
        The first of them, as the run was before it was sorted.
    piece : FilePiece
        Where they are.
    first : int
        The place of the first: its row in a table, or in the piece of a text.
    """

    begin: int
    piece: FilePiece
    first: int


def write_runs(task: RunsTask) -> None:
    """Do a task."""
    with writing(task.output) as folder:
        folder.mkdir()
        parts: list[Chunk | Rows] = []
        origins: list[RowOrigin] = []
        moments: list[Moments] = []
        count = 0
        for part, piece, first in _parts(task):
            size = len(part.place) if isinstance(part, Chunk) else len(part.times.value)
            if not size:
                continue
            origins.append(RowOrigin(begin=count, piece=piece, first=first))
            parts.append(part)
            count += size
            if count >= task.rows:
                moments.append(_write(folder / str(len(moments)), parts, origins, task.options))
                parts, origins, count = [], [], 0
        if parts:
            moments.append(_write(folder / str(len(moments)), parts, origins, task.options))
        (folder / "moments").write_bytes(pickle.dumps(moments))


def _parts(task: RunsTask) -> Iterator[tuple[Chunk | Rows, FilePiece, int]]:
    """What the pieces have, and the piece and the place in it that each part begins at."""
    for piece in task.pieces:
        if piece.text:
            for rows, first in text_rows(piece.file, piece.begin, piece.end, task.options):
                yield rows, piece, first
            continue
        table = open_table(piece.file, task.options)
        for group in range(piece.begin, piece.end):
            for chunk in table.chunks(group, task.options):
                yield chunk, piece, int(chunk.place[0])


def _write(
    folder: Path, given: Sequence[Chunk | Rows], origins: Sequence[RowOrigin], options: ReadOptions
) -> Moments:
    """Write a run, and say which times it has."""
    folder.mkdir()
    chunks = [part for part in given if isinstance(part, Chunk)]
    parts = [part for part in given if isinstance(part, Rows)]  # one of both is empty
    parts += rows_of_chunks(chunks, options)
    found = merged_moments(
        moments_of(part.times, part.path if isinstance(part, Chunk) else part.name)
        for part in given
    )
    rows = merged_rows(parts[0].name, parts)
    order = np.argsort(rows.times.value, kind="stable")
    columns = {"time": rows.times.value, "id": rows.ids[1].astype(np.int32), "place": None}
    if rows.classes is not None:
        columns["class"] = rows.classes[1].astype(np.int32)
    for name, column in columns.items():
        np.save(folder / f"{name}.npy", order if column is None else column[order])
    np.save(folder / "numbers.npy", np.asfortranarray(rows.numbers[order]))
    names = {"id": rows.ids[0].tolist()}
    if rows.classes is not None:
        names["class"] = rows.classes[0].tolist()
    (folder / "names.json").write_text(json.dumps(names), encoding="utf-8")
    (folder / "origins").write_bytes(pickle.dumps((list(origins), found.clock)))
    return found


def run_rows(folder: str, span: Span, roles: Roles, options: ReadOptions) -> Rows | None:
    """Rows of a run in a range of time, or None of none.

    Parameters
    ----------
    folder : str
        The run.
    span : pair of numbers
        The first and the last time.
    roles : Roles
        Of the columns.
    options : ReadOptions
        How its files were read.
    """
    path = Path(folder)

    def column(name: str) -> Ints:
        found: Ints = np.load(path / f"{name}.npy", mmap_mode="r")
        return found

    times: TimeArray = np.load(path / "time.npy", mmap_mode="r")
    low, high = span
    if times.dtype.kind == "i":  # numbers of another type would have all times converted
        low, high = math.ceil(low), math.floor(high)
    begin = int(np.searchsorted(times, low, side="left"))
    end = int(np.searchsorted(times, high, side="right"))
    if begin >= end:
        return None
    origins: list[RowOrigin]
    origins, clock = pickle.loads((path / "origins").read_bytes())
    names = json.loads((path / "names.json").read_text(encoding="utf-8"))
    place = column("place")

    def where(row: int) -> str:
        at = int(place[begin + row])
        origin = origins[bisect_right(origins, at, key=lambda origin: origin.begin) - 1]
        return origin.piece.where(origin.first + at - origin.begin, options)

    def numbered(name: str) -> Numbered:
        table = np.empty(len(names[name]), dtype=object)
        table[:] = names[name]
        return table, column(name)[begin:end].astype(np.int64)

    return Rows(
        name=origins[0].piece.file.path,
        roles=roles,
        ids=numbered("id"),
        times=Times(value=cast(TimeArray, np.array(times[begin:end])), clock=clock, text=None),
        numbers=np.load(path / "numbers.npy", mmap_mode="r")[begin:end],
        where=where,
        classes=numbered("class") if "class" in names else None,
    )
