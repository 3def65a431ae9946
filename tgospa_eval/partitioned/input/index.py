"""What a side has and where: its times, the rows at each, and the units that blocks are read of."""

import pickle
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.roles import Roles
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.partitioned.input.listing import File
from tgospa_eval.partitioned.input.merging import Moments, merged_moments, moments_of
from tgospa_eval.partitioned.input.runs import Piece, RunsTask, write_runs
from tgospa_eval.partitioned.input.tables import Table, open_table
from tgospa_eval.partitioned.tasks import Run, writing
from tgospa_eval.text import listed

TIMES_TOGETHER = 1 << 24
"""Rows whose times are one task."""

REREAD = 4
"""Times that each row may be decoded, on average, before the side is sorted into runs instead."""


@dataclass(frozen=True, kw_only=True)
class Unit:
    """What blocks are read of: a row group, or a run.

    Parameters
    ----------
    low, high : int or float
        Its first and its last time, as the files have them.
    rows : int
        Its rows.
    piece : Piece, optional
        The row group; else it is a run.
    folder : str
        Of the run.
    """

    low: int | float
    high: int | float
    rows: int
    piece: Piece | None = None
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
    moments : Moments, optional
        All times; None if there is no row at all.
    roles : Roles
        Of the columns of the first file.
    """

    units: list[Unit]
    moments: Moments | None
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


def index_tables(
    files: Sequence[File], options: ReadOptions, store: Path, rows_together: int, run: Run[Any]
) -> Index:
    """The index of Parquet files, which are sorted into runs if blocks would read them too often.

    Raises
    ------
    InputError
        A file is damaged, or has other columns than the first.
    """
    tasks: list[TimesTask] = []
    first = open_table(files[0], options)
    for number, file in enumerate(files):
        table = open_table(file, options)
        check_alike(table, first)
        tasks += _tasks_of(table, options, str(store / "times" / f"{number:06}"))
    run(write_times, tasks)
    units: list[Unit] = []
    whole = merged_moments(_gathered(tasks, units))
    index = Index(units=units, moments=whole, roles=first.roles)
    if whole is None or _decoded(units, whole, rows_together) <= REREAD * whole.count.sum():
        return index
    pieces = [(unit.piece, unit.rows) for unit in units if unit.piece is not None]
    return index_pieces(pieces, first.roles, options, store, rows_together, run)


def _tasks_of(table: Table, options: ReadOptions, output: str) -> Iterator[TimesTask]:
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
            if moments is not None and len(moments.value):
                piece = Piece(file=task.file, begin=group, end=group + 1)
                units.append(_unit(moments, piece=piece))
                yield moments


def _unit(moments: Moments, piece: Piece | None = None, folder: str = "") -> Unit:
    return Unit(
        low=moments.value[0].item(),
        high=moments.value[-1].item(),
        rows=int(moments.count.sum()),
        piece=piece,
        folder=folder,
    )


def _decoded(units: Sequence[Unit], whole: Moments, rows_together: int) -> int:
    """Rows that are decoded if blocks of so many rows are read from these units."""
    block = (np.cumsum(whole.count) - 1) // rows_together
    first = block[np.searchsorted(whole.value, [unit.low for unit in units])]
    last = block[np.searchsorted(whole.value, [unit.high for unit in units])]
    return int(((last - first + 1) * [unit.rows for unit in units]).sum())


def index_pieces(
    pieces: Sequence[tuple[Piece, int]],
    roles: Roles,
    options: ReadOptions,
    store: Path,
    rows_together: int,
    run: Run[Any],
) -> Index:
    """The index of pieces, with their rows or an estimate of them, after they became runs."""
    tasks: list[RunsTask] = []
    waiting: list[Piece] = []
    rows = 0
    for piece, count in pieces:
        waiting.append(piece)
        rows += count
        if rows >= rows_together or piece is pieces[-1][0]:
            tasks.append(
                RunsTask(
                    pieces=tuple(waiting),
                    options=options,
                    rows=rows_together,
                    output=str(store / "runs" / f"{len(tasks):06}"),
                )
            )
            waiting, rows = [], 0
    run(write_runs, tasks)
    units: list[Unit] = []

    def gathered() -> Iterator[Moments]:
        for task in tasks:
            found = pickle.loads(Path(task.output, "moments").read_bytes())
            for k, moments in enumerate(found):
                if len(moments.value):
                    units.append(_unit(moments, folder=str(Path(task.output, str(k)))))
                    yield moments

    return Index(units=units, moments=merged_moments(gathered()), roles=roles)


def check_alike(table: Table, first: Table) -> None:
    """Whether a file has the columns of the first.

    Raises
    ------
    InputError
        It has others.
    """
    mine, others = ({*columns_in_use(each.roles)} for each in (table, first))
    if mine == others:
        return
    lacking, beside = sorted(others - mine), sorted(mine - others)
    what = " and ".join(
        [f"lacks column {listed(lacking)}"] * bool(lacking)
        + [f"is read by column {listed(beside)}"] * bool(beside)
    )
    raise InputError(
        f"{table.file.path}: {what}, other than {first.file.path}; write the same columns into all "
        "files, or name those to be read with --columns"
    )


def columns_in_use(roles: Roles) -> list[str]:
    """Headers of ids, times, classes and numbers, in this order."""
    columns = [roles.id, roles.time, *([] if roles.klass is None else [roles.klass])]
    return [roles.headers[column] for column in (*columns, *roles.numbers)]
