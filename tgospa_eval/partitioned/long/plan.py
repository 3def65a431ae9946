"""How a long component is divided: windows of whole steps, shards of truths and of estimates."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.partitioned.long.tables import Table
from tgospa_eval.partitioned.share import ENTRY
from tgospa_eval.partitioned.tasks import writing
from tgospa_eval.problem.problem import Ints

ROWS_READ = 1 << 20
"""Entries that are looked at together where they are only counted."""


@dataclass(frozen=True, kw_only=True)
class Count:
    """The task to count the entries of a file by step, truth and estimate.

    Parameters
    ----------
    output : str
        The file that is written.
    entries : str
        A file of ENTRY, by time.
    """

    output: str
    entries: str


def count_entries(task: Count) -> None:
    """Count them, a stretch at a time."""
    entries = np.load(task.entries, mmap_mode="r")
    names = ("step", "truth", "estimate")
    counted: dict[str, dict[int, int]] = {name: {} for name in names}
    for low in range(0, len(entries), ROWS_READ):
        part = np.asarray(entries[low : low + ROWS_READ])
        for name in names:
            known = counted[name]
            for number, count in zip(*(x.tolist() for x in _counts(part[name])), strict=True):
                known[number] = known.get(number, 0) + count
    with writing(task.output) as path, path.open("wb") as file:
        tables: dict[str, Any] = {
            name: np.array(sorted(known.items()), np.int64).reshape(-1, 2).T
            for name, known in counted.items()
        }
        np.savez(file, **tables)


def _counts(number: Ints) -> tuple[Ints, Ints]:
    return np.unique(number, return_counts=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What is known of a long component before it is solved.

    Parameters
    ----------
    paths : tuple of str
        Files of its entries, by time.
    file_first : (F + 1,) int array
        Entries before each file.
    step : (K,) int array
        The steps with entries.
    step_first : (K + 1,) int array
        Entries before each of them.
    estimates : (n,) int array
        Numbers of its estimates.
    truth_bounds, estimate_bounds : int arrays
        The first number of each shard, and the end.
    """

    paths: tuple[str, ...]
    file_first: Ints
    step: Ints
    step_first: Ints
    estimates: Ints
    truth_bounds: Ints
    estimate_bounds: Ints

    @property
    def window(self) -> tuple[int, int]:
        """The first and the last step with an entry."""
        return int(self.step[0]), int(self.step[-1])

    def between(self, low: int, high: int) -> tuple[tuple[str, int, int], ...]:
        """Where the entries of the steps from `low` to before `high` are: files and rows."""
        ends = self.step_first[np.searchsorted(self.step, (low, high))]
        found = []
        for path, first, last in zip(
            self.paths, self.file_first[:-1].tolist(), self.file_first[1:].tolist(), strict=True
        ):
            a, b = max(int(ends[0]), first), min(int(ends[1]), last)
            if a < b:
                found.append((path, a - first, b - first))
        return tuple(found)

    def cores(self, size: int) -> list[tuple[int, int]]:
        """Stretches of steps with about so many entries each; steps from, and to before."""
        total = int(self.step_first[-1])
        count = min(max(-(-total // size), 1), len(self.step))
        cuts = np.searchsorted(self.step_first, np.arange(count) * (total / count))
        cuts = np.unique(np.minimum(cuts, len(self.step) - 1))
        edges = [*self.step[cuts].tolist(), self.window[1] + 1]
        edges[0] = self.window[0]
        return list(itertools.pairwise(edges))

    def around(self, low: int, high: int, overlap: int, most: int) -> tuple[int, int]:
        """A stretch with so many steps more on either side, or those with at most so many entries.

        Only steps with entries count.
        """
        a, b = np.searchsorted(self.step, (low, high)).tolist()
        first, last = max(a - overlap, 0), min(b + overlap, len(self.step))
        counts = self.step_first
        first = max(first, int(np.searchsorted(counts, counts[a] - most)))
        last = min(last, max(int(np.searchsorted(counts, counts[b] + most, side="right")) - 1, b))
        return int(self.step[first]) if first < a else low, (
            int(self.step[last - 1]) + 1 if last > b else high
        )


def make_plan(
    paths: Sequence[str], counted: Sequence[str], together: int, columns_together: int
) -> Plan:
    """Put together what was counted.

    Parameters
    ----------
    paths : sequence of str
        Files of entries, by time.
    counted : sequence of str
        Outputs of their `Count`.
    together, columns_together : int
        Entries of a shard of truths, and of one of estimates.
    """
    sides: dict[str, list[Ints]] = {"step": [], "truth": [], "estimate": []}
    sizes = []
    for path in counted:
        with np.load(path) as found:
            for name, known in sides.items():
                known.append(found[name])
            sizes.append(int(found["step"][1].sum()))
    step, truth, estimate = (_added(known) for known in sides.values())
    return Plan(
        paths=tuple(paths),
        file_first=np.concatenate(([0], np.cumsum(sizes))),
        step=step[0],
        step_first=np.concatenate(([0], np.cumsum(step[1]))),
        estimates=estimate[0],
        truth_bounds=_bounds(*truth, together),
        estimate_bounds=_bounds(*estimate, columns_together),
    )


def _added(counted: list[Ints]) -> tuple[Ints, Ints]:
    number, count = np.concatenate(counted, axis=1)
    known, index = np.unique(number, return_inverse=True)
    sums = np.zeros(len(known), np.int64)
    np.add.at(sums, index, count)
    return known, sums


def _bounds(number: Ints, count: Ints, size: int) -> Ints:
    """First numbers of stretches of about `size` counts each, and the end."""
    before = np.cumsum(count) - count
    opens = np.flatnonzero(np.diff(before // size, prepend=-1) > 0)
    return np.append(number[opens], number[-1] + 1)


def shard_of(number: Ints, bounds: Ints) -> Ints:
    """In which stretch each number is."""
    return np.searchsorted(bounds, number, side="right") - 1


def read_entries(stretches: tuple[tuple[str, int, int], ...]) -> Table:
    """The entries of `Plan.between`."""
    found = [np.zeros(0, ENTRY)]
    for path, low, high in stretches:
        found.append(np.array(np.load(Path(path), mmap_mode="r")[low:high]))
    return np.concatenate(found)
