"""Rows of a side sorted by time: runs of bounded size, from which blocks are read.

The files of a side are read once, in pieces (see `files`). The rows of some pieces are sorted by
time and written into a folder. Such sorted rows are a *run*. The rows of a block of time are next
to each other in each run.
"""

import json
import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import accumulate
from operator import itemgetter
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Ints, in_batches
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import natural
from tgospa_eval.common.writing import writing_folder
from tgospa_eval.errors import InputError
from tgospa_eval.formats.assemble import attributes_of, signed
from tgospa_eval.formats.fields import EXACT_BELOW, Times
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.roles import Roles
from tgospa_eval.formats.rows import Numbered, Rows, number_ids
from tgospa_eval.partitioned.files import File, FilePiece
from tgospa_eval.quoting import quoted
from tgospa_eval.tracks.trajectories import CLOCKS, TimeArray, Values, checked

PENDING = 1 << 22
"""Number of times that are merged at once."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Timestamps:
    """Distinct times of some rows.

    Parameters
    ----------
    value : (T,) int64 or float64 array
        Strictly increasing times, as in the files.
    count : (T,) int64 array
        Number of rows at each time.
    clock : {"number", "local", "zoned"}
        Kind of the times.
    label : (T,) array of bytes, optional
        If times are not numbers: texts of the times in UTF-8. If a time has several texts, the
        first one in the files is kept.
    source : str
        Name of the first file with any of these times.
    """

    value: TimeArray
    count: Ints
    clock: str
    label: NDArray[np.bytes_] | None
    source: str


NO_TIMESTAMPS = Timestamps(
    value=np.zeros(0, np.int64),
    count=np.zeros(0, np.int64),
    clock="number",
    label=None,
    source="",
)
"""Empty timestamps: those of no rows."""


def timestamps_of(times: Times, source: str) -> Timestamps:
    """Return the distinct times of some rows, which must be in the order of the file `source`."""
    value, label = times.value, None
    if times.text is None and (value[1:] >= value[:-1]).all():  # sorted already, as in most files
        begins = np.flatnonzero(np.append(True, value[1:] > value[:-1])[: len(value)])
        count = np.diff(np.append(begins, len(value)))
        begun = value[begins]
        return Timestamps(value=begun, count=count, clock=times.clock, label=None, source=source)
    distinct, first, count = np.unique(value, return_index=True, return_counts=True)
    if times.text is not None:
        texts = [times.text[row].strip().encode() for row in first.tolist()]
        label = np.array(texts, dtype=np.bytes_)
    distinct = cast(TimeArray, distinct)
    return Timestamps(value=distinct, count=count, clock=times.clock, label=label, source=source)


def merged_timestamps(parts: Iterable[Timestamps]) -> Timestamps:
    """Merge the times of several parts. The parts must be in the order of the files.

    Raises
    ------
    InputError
        The times are of several kinds.
    """
    whole = NO_TIMESTAMPS
    for some in in_batches(parts, lambda part: len(part.value), PENDING):
        whole = _merged([whole, *some])
    return whole


def _merged(given: Sequence[Timestamps]) -> Timestamps:
    filled = [part for part in given if len(part.value)]
    if len(filled) < 2:
        return filled[0] if filled else NO_TIMESTAMPS
    first = filled[0]
    for part in filled:
        if part.clock != first.clock:
            raise InputError(
                f"{part.source}: its times are {CLOCKS[part.clock]}, and those of {first.source} "
                f"are {CLOCKS[first.clock]}; write all times in one kind"
            )
    value = in_one_type([(part.value, part.source) for part in filled])
    count = np.concatenate([part.count for part in filled])
    order = np.argsort(value, kind="stable")
    value = value[order]
    begins = np.flatnonzero(np.append(True, value[1:] > value[:-1]))
    labels = [part.label for part in filled if part.label is not None]
    return Timestamps(
        value=value[begins],
        count=np.add.reduceat(count[order], begins),
        clock=first.clock,
        label=np.concatenate(labels)[order][begins] if labels else None,
        source=first.source,
    )


def in_one_type(parts: Sequence[tuple[TimeArray, str]]) -> TimeArray:
    """Concatenate times of several files. If a file has doubles, the result has doubles.

    `parts` has the times and the name of each file.

    Raises
    ------
    InputError
        A file has doubles, and an integer in another file is too large to be exact as a double.
    """
    if len({value.dtype for value, _ in parts}) > 1:
        for value, source in parts:
            if value.dtype.kind == "i" and len(value) and np.abs(value).max() >= EXACT_BELOW:
                raise InputError(
                    f"{source}: its integer times are too large to be compared exactly with "
                    "decimal times of other files; write all times as 64-bit integers"
                )
    return np.concatenate([value for value, _ in parts])


def merged_rows(name: str, parts: Sequence[Rows]) -> Rows:
    """Concatenate rows of several parts with the same columns; `name` is the name of the result."""
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
        attributes={
            at: joined([part.attributes[part.roles.attributes[name]] for part in parts])
            for name, at in roles.attributes.items()
            if at in parts[0].attributes
        },
    )


def joined(parts: Sequence[Values]) -> Values:
    """Concatenate the values of an attribute. If a part has texts, numbers become empty texts.

    This is right for missing values. For other numbers, `run_names` raises an error.
    """
    if any(part.dtype.kind != "f" for part in parts):
        parts = [np.full(len(p), "", object) if p.dtype.kind == "f" else p for p in parts]
    return cast(Values, np.concatenate(parts))


def with_attributes(rows: Rows) -> Rows:
    """Return the rows with the requested attributes. Attributes in `Rows.numbers` are left out."""
    rows, _ = signed(rows)
    size, columns = len(rows.times.value), rows.roles.attributes
    attributes = checked(attributes_of(rows, np.arange(size)), size)
    by_column = {columns[name]: values for name, values in attributes.items()}
    by_column = {at: values for at, values in by_column.items() if at not in rows.roles.numbers}
    return replace(rows, attributes=by_column)


def merged_names(parts: Sequence[Numbered]) -> Numbered:
    """Merge tables of names (ids or classes) of several parts.

    Return all names that occur in rows, in natural order, and, for each row, the index of its name.
    """
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


def write_runs(
    output: str, pieces: Sequence[FilePiece], options: ReadOptions, rows_together: int
) -> None:
    """Write the rows of some pieces as runs.

    Each run has at least `rows_together` rows, except the last, which has the rest. The pieces must
    be in the order of the files.
    """
    read = (
        (with_attributes(rows) if options.attributes else signed(rows)[0], first, piece)
        for piece in pieces
        for rows, first in piece.rows(options)
        if len(rows.times.value)
    )
    with writing_folder(output) as folder:
        runs = in_batches(read, lambda part: len(part[0].times.value), rows_together)
        for number, run in enumerate(runs):
            _write(folder / str(number), run)


def _write(folder: Path, run: Sequence[tuple[Rows, int, FilePiece]]) -> None:
    """Write a run and its timestamps.

    Parameters
    ----------
    folder : Path
        Folder to create.
    run : sequence of tuple
        Parts of the run. Each part has some consecutive rows, the index of the first of them
        (counted as by `FilePiece.rows`), and the piece from which they come.
    """
    parts = [rows for rows, _, _ in run]
    begins = accumulate((len(rows.times.value) for rows in parts), initial=0)
    folder.mkdir()
    timestamps = merged_timestamps(timestamps_of(part.times, part.name) for part in parts)
    rows = merged_rows(parts[0].name, parts)
    order = np.argsort(rows.times.value, kind="stable")
    columns = {"time": rows.times.value, "id": rows.ids[1].astype(np.int32), "place": None}
    if rows.classes is not None:
        columns["class"] = rows.classes[1].astype(np.int32)
    for name, column in columns.items():
        np.save(folder / f"{name}.npy", order if column is None else column[order])
    np.save(folder / "numbers.npy", np.asfortranarray(rows.numbers[order]))
    texts: dict[str, list[str] | None] = {}
    for name, at in rows.roles.attributes.items():
        if at in rows.attributes:
            values: NDArray[Any] = rows.attributes[at][order]
            texts[name] = None
            if values.dtype.kind != "f":
                table, values = number_ids(values.tolist())
                texts[name] = table.tolist()
            np.save(folder / f"attribute-{len(texts)}.npy", values)
    known = {
        "id": rows.ids[0].tolist(),
        "class": None if rows.classes is None else rows.classes[0].tolist(),
        "attributes": texts,
        "kinds": {name: sorted({_kind(part, name) for part in parts}) for name in texts},
        "clock": timestamps.clock,
        "origins": [
            (begin, first, [vars(piece.file), piece.begin, piece.end, piece.text])
            for begin, (_, first, piece) in zip(begins, run, strict=False)
        ],
    }
    (folder / "run.json").write_text(json.dumps(known), encoding="utf-8")
    np.savez(folder / "moments.npz", **{k: v for k, v in vars(timestamps).items() if v is not None})


def _kind(rows: Rows, name: str) -> str:
    """Return the kind of an attribute: "numbers", "texts", or "" if all values are missing."""
    values = rows.attributes[rows.roles.attributes[name]]
    if values.dtype.kind != "f":
        return "texts"
    return "" if np.isnan(values).all() else "numbers"


def run_names(folders: Iterable[Path], name: str) -> list[str]:
    """Check the attributes of a side, and return the classes in its runs in natural order.

    `name` is the name of the side in messages.

    Raises
    ------
    InputError
        An attribute has numbers in one part of the side and texts in another.
    """
    classes: set[str] = set()
    kinds: dict[str, set[str]] = {}
    for folder in folders:
        known = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        classes.update(known["class"] or ())
        for attribute, present in known["kinds"].items():
            kinds.setdefault(attribute, set()).update(present)
    for attribute, present in kinds.items():
        if {"numbers", "texts"} <= present:
            raise InputError(
                f"{name}, column {quoted(attribute)}: some parts have only numbers and some have "
                "texts, so equal values could be compared differently; write texts that are not "
                "numbers, or evaluate a part that fits into memory as one file"
            )
    return sorted(classes, key=natural)


def run_timestamps(folder: Path) -> Timestamps:
    """Read the timestamps of a run."""
    with np.load(folder / "moments.npz") as arrays:
        texts = {name: str(arrays[name]) for name in ("clock", "source")}
        return Timestamps(**{"label": None, **arrays, **texts})


def run_rows(
    folder: str, span: tuple[int | float, int | float], roles: Roles, options: ReadOptions
) -> Rows | None:
    """Read the rows of a run in a range of time; return None if there are none.

    Parameters
    ----------
    folder : str
        Folder of the run.
    span : pair of numbers
        First and last time of the range, as in the files.
    roles : Roles
        Roles of the columns.
    options : ReadOptions
        Options with which the files of the run were read.
    """
    path = Path(folder)

    def column(name: str) -> Ints:
        array: Ints = np.load(path / f"{name}.npy", mmap_mode="r")
        return array

    times: TimeArray = np.load(path / "time.npy", mmap_mode="r")
    low, high = span
    if times.dtype.kind == "i":  # if `low` was a double, NumPy would convert all times to doubles
        low, high = math.ceil(low), math.floor(high)
    begin = int(np.searchsorted(times, low, side="left"))
    end = int(np.searchsorted(times, high, side="right"))
    if begin >= end:
        return None
    known = json.loads((path / "run.json").read_text(encoding="utf-8"))
    origins = known["origins"]
    place = column("place")

    def where(row: int) -> str:
        at = int(place[begin + row])
        start, first, (file, *ends) = origins[bisect_right(origins, at, key=itemgetter(0)) - 1]
        low, high, text = ends
        piece = FilePiece(file=File(**file), begin=low, end=high, text=text)
        return piece.where(first + at - start, options)

    def table(texts: Sequence[str]) -> NDArray[np.object_]:
        array = np.empty(len(texts), dtype=object)
        array[:] = texts
        return array

    def numbered(name: str) -> Numbered:
        return table(known[name]), column(name)[begin:end].astype(np.int64)

    attributes: dict[int, Values] = {}
    for number, (name, texts) in enumerate(known["attributes"].items(), start=1):
        values: NDArray[Any] = np.array(column(f"attribute-{number}")[begin:end])
        attributes[roles.attributes[name]] = values if texts is None else table(texts)[values]

    return Rows(
        name=origins[0][2][0]["path"],
        roles=roles,
        ids=numbered("id"),
        times=Times(
            value=cast(TimeArray, np.array(times[begin:end])), clock=known["clock"], text=None
        ),
        numbers=np.load(path / "numbers.npy", mmap_mode="r")[begin:end],
        where=where,
        classes=None if known["class"] is None else numbered("class"),
        attributes=attributes,
    )
