"""Assigned pairs and switches of all shards as tables in the order of time."""

import itertools
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.partitioned.tables import Naming, write_assignments, write_switches
from tgospa_eval.problem.problem import Ints
from tgospa_eval.problem.tgospa import Parameters

ROWS_A_PART = 1 << 23
"""Rows of a file of assigned pairs, but for those of its last step."""

ROWS_AT_ONCE = 1 << 18
"""Rows that are brought into order at once, but for those of the last step of them."""

ORDER = ("step", "truth", "estimate")


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """The task to write the assigned pairs of some steps.

    Parameters
    ----------
    output : str
        The file.
    pieces : tuple of str
        Files of assigned pairs, each by time.
    edges : (n + 1,) int array
        The steps, cut into n stretches of `ROWS_AT_ONCE`.
    names : str
        Where `Naming.save` wrote the names.
    parameters : Parameters
        Of the metric.
    """

    output: str
    pieces: tuple[str, ...]
    edges: Ints
    names: str
    parameters: Parameters


def write_part(task: Part) -> None:
    """Write the assigned pairs of some steps."""
    naming = Naming.load(task.names, task.parameters)
    write_assignments(task.output, in_order(task.pieces, task.edges), naming)


def parts_of(
    folder: str, pieces: Sequence[Path], steps: int, names: str, parameters: Parameters
) -> list[Part]:
    """The tasks to write all assigned pairs; one without rows where there are none.

    Parameters
    ----------
    folder : str
        Where to write the files.
    pieces : sequence of Path
        Files of assigned pairs, each by time.
    steps : int
        T.
    names : str
        Where `Naming.save` wrote the names.
    parameters : Parameters
        Of the metric.
    """
    paths = tuple(map(str, pieces))
    rows = _rows_by_step(paths, steps)
    parts = _edges(rows, ROWS_A_PART)
    return [
        Part(
            output=str(Path(folder, f"part-{number:05d}.parquet")),
            pieces=paths,
            edges=low + _edges(rows[low:high], ROWS_AT_ONCE),
            names=names,
            parameters=parameters,
        )
        for number, (low, high) in enumerate(itertools.pairwise(parts))
    ]


def write_all_switches(path: str, pieces: Sequence[Path], naming: Naming) -> None:
    """Write the switches of all shards in the order of time."""
    paths = tuple(map(str, pieces))
    edges = _edges(_rows_by_step(paths, len(naming.times)), ROWS_AT_ONCE)
    write_switches(path, in_order(paths, edges), naming)


def in_order(pieces: Sequence[str], edges: Ints) -> Iterator[NDArray[np.void]]:
    """The rows of all pieces by `ORDER`, those of one stretch between edges after the other."""
    opened = [np.load(piece, mmap_mode="r") for piece in pieces]
    for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        found = [rows[_first(rows, low) : _first(rows, high)] for rows in opened]
        if sum(map(len, found)):
            joined = np.concatenate(found)
            names = joined.dtype.names or ()
            keys = [joined[name] for name in reversed(ORDER) if name in names]
            yield joined[np.lexsort(keys)]


def _first(rows: NDArray[np.void], step: int) -> int:
    """The first row of this step, or of one after it; few rows are looked at."""
    return bisect_left(rows, step, key=_step)


def _step(row: Any) -> int:
    return int(row["step"])


def _rows_by_step(pieces: Sequence[str], steps: int) -> Ints:
    """How many rows there are at each step (T,)."""
    counts = np.zeros(steps, np.int64)
    for piece in pieces:
        rows = np.load(piece, mmap_mode="r")
        for first in range(0, len(rows), ROWS_AT_ONCE):
            step = rows["step"][first : first + ROWS_AT_ONCE]
            found = np.bincount(step - step[0])
            counts[step[0] : step[0] + len(found)] += found
    return counts


def _edges(rows: Ints, most: int) -> Ints:
    """Steps cut into stretches of about `most` rows: the first of each, and the end."""
    before = np.cumsum(rows) - rows
    cuts = np.flatnonzero(np.diff(before // most, prepend=-1) > 0)
    return np.append(cuts, len(rows)) if len(cuts) else np.array([0, len(rows)])
