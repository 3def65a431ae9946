"""Shards: groups of components that are solved and proven separately, and their costs.

The package `partitioned` explains blocks of time and global numbers.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.writing import writing_folder
from tgospa_eval.problem.certificate import prove, unpaired_prices
from tgospa_eval.problem.metric_family import Parameters, ignore_states
from tgospa_eval.problem.problem import Objects, Problem
from tgospa_eval.problem.solution import Breakdown, read_assigned, read_switches, read_tracks
from tgospa_eval.problem.states import States, merge_runs
from tgospa_eval.solvers.certified import Certified

ENTRY = np.dtype(
    [("step", "<i4"), ("truth", "<i4"), ("estimate", "<i4"), ("cost", "<f8"), ("marks", "u1")]
)
"""Type of an entry, which is a near pair of states. Its fields are the global numbers of the step
and of both tracks, the cost (d / c)^p, and the bits `marks`. Before `sort_entries`, tracks have
their index in the block instead of the global number."""

IGNORED_TRUTH, EXCUSED_ESTIMATE = 1, 2
"""Bits in the `marks` of an entry: its truth is ignored, its estimate is excused (see
`metric_family.ignore_states`)."""

Table = NDArray[np.void]


@dataclass(frozen=True, kw_only=True, eq=False)
class PartialSums(Breakdown):
    """Costs and lower bound of some components.

    Arrays (L,) have an element for each of L steps, beginning at the step `first`. Only states with
    a near pair in these components are counted.

    Parameters
    ----------
    first : int
        First of the L steps.
    truths, estimates : (L,) int arrays
        Number of truths and of estimates at each step that have a near pair and are evaluated.
    lower : (N,) float array
        Summands of a proven lower bound of the cost.
    iterations : int
        Iterations of the solver.
    solved : bool
        Whether the solver finished.
    """

    first: int
    truths: Ints
    estimates: Ints
    lower: Floats
    iterations: int = 0
    solved: bool = True

    def save(self, path: Path) -> None:
        """Write the sums into a file."""
        np.savez(path, **{field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: Path) -> "PartialSums":
        """Read what `save` wrote."""
        with np.load(path) as arrays:
            values = {name: arrays[name] for name in arrays.files}
        return cls(**{k: v.item() if v.ndim == 0 else v for k, v in values.items()})

    @property
    def bracket(self) -> tuple[float, float]:
        """Lower and upper bound, not rounded outward, to show the progress."""
        return math.fsum(self.lower), self.total


PARTS_OF_TRACKS = ("localisation", "unassigned", "switch", "unassigned_count", "switch_count")
"""Names of the fields of `problem.solution.PerTrack`."""


def save_parts(folder: Path, name: str, table: Table, part: Ints, parts: int) -> None:
    """Write a table with its rows grouped by part, for `load_part`.

    `part` has the part of each row, from 0 to parts - 1. Rows of a part keep their order.
    """
    small = part.astype(np.uint16 if parts <= 1 << 16 else np.int64)  # NumPy sorts 16 bits faster
    first = np.zeros(parts + 1, np.int64)
    np.cumsum(np.bincount(part, minlength=parts), out=first[1:])
    np.save(folder / f"{name}.first.npy", first)
    np.save(folder / f"{name}.npy", table[np.argsort(small, kind="stable")])


def load_part(folder: Path, name: str, part: int | None = None) -> Table:
    """Read one part of a table that `save_parts` wrote; by default, the whole table."""
    table = np.load(folder / f"{name}.npy", mmap_mode="r")
    if part is None:
        return np.array(table)
    first = np.load(folder / f"{name}.first.npy")
    return np.array(table[first[part] : first[part + 1]])


def sort_entries(
    output: str, *, scanned: str, numbers: Sequence[str], shard_of_truth: str, shards: int
) -> None:
    """Write the entries of a block with global numbers, sorted by shard and then by time.

    Parameters
    ----------
    output : str
        Folder to write.
    scanned : str
        Folder of the block, which `scan` wrote.
    numbers : pair of str
        File with the global numbers of the block's truths, and file with those of its estimates.
    shard_of_truth : str
        File with the shard of each truth.
    shards : int
        Number of shards.
    """
    entry = np.load(Path(scanned) / "entries.npy")
    # The tracks of a block are in the order of their global numbers. For this reason, entries
    # remain sorted when the numbers are replaced.
    for name, path in zip(("truth", "estimate"), numbers, strict=True):
        entry[name] = np.load(path)[entry[name]]
    shard = np.load(shard_of_truth, mmap_mode="r")[entry["truth"]]
    with writing_folder(output) as folder:
        save_parts(folder, "entries", entry, shard, shards)


ASSIGNED_PAIR = np.dtype([*ENTRY.descr, ("weight", "<f8")])
"""Type of an assigned entry: an entry with its weight."""

SWITCHED = np.dtype(
    [("step", "<i4"), ("truth", "<i4"), ("before", "<i4"), ("after", "<i4"), ("variation", "<f8")]
)
"""Type of a switch; `problem.solution.Switches` has the same fields."""


NO_TIME = 1e-3
"""Time limit in seconds for a solver that begins after the deadline. The limit is so short that the
solver only computes simple bounds."""


def solve_shard(
    output: str,
    *,
    folders: tuple[str, ...],
    number: int,
    parameters: Parameters,
    solver: Certified,
    end: float | None = None,
) -> None:
    """Solve and prove a shard, and write its costs and tables.

    Parameters
    ----------
    output : str
        Folder to write.
    folders : tuple of str
        Folders of all blocks that `sort_entries` wrote, in order of time.
    number : int
        Index of the shard.
    parameters : Parameters
        Parameters of the metric.
    solver : Certified
        Solver with its settings.
    end : float, optional
        Deadline, as a value of `time.time()`. The solver stops at this time, and the bounds that it
        has reached are written.
    """
    entry = np.concatenate([load_part(Path(folder), "entries", number) for folder in folders])
    numbers = np.unique(entry["truth"]), np.unique(entry["estimate"])
    first = int(entry["step"].min())
    problem = problem_of(entry, first, numbers, parameters)
    del entry
    states = merge_runs(problem)
    if end is not None:  # in a cluster, clocks differ between machines, and so does the deadline
        solver = replace(solver, time_limit=max(end - time.time(), NO_TIME))
    solution = solver(states, Stopwatch())
    weights, lower, breakdown = prove(states, solution, consume=True)
    share = PartialSums(
        **vars(breakdown),
        first=first,
        truths=evaluated_at_steps(problem, 0),
        estimates=evaluated_at_steps(problem, 1),
        lower=np.concatenate((lower, unpaired_prices(states))),
        iterations=solution.iterations,
        solved=solution.finished,
    )
    tracks = [
        {
            "track": numbers[side],
            "rows": evaluated_rows(objects),
            **vars(read_tracks(states, weights, side)),
        }
        for side, objects in enumerate(problem.sides)
    ]
    with writing_folder(output) as folder:
        for name, table in tables_of(states, weights, first, numbers).items():
            np.save(folder / f"{name}.npy", table)
        for name, parts in zip(("truths", "estimates"), tracks, strict=True):
            np.savez(folder / f"{name}.npz", **parts)
        share.save(folder / "share.npz")


def evaluated_at_steps(problem: Problem, side: int) -> Ints:
    """Count the evaluated objects of a side at each step."""
    objects = problem.sides[side]
    return np.bincount(objects.step[objects.evaluated], minlength=problem.steps)


def evaluated_rows(side: Objects) -> Ints:
    """Count the evaluated rows of each track."""
    return np.bincount(side.track[side.evaluated], minlength=side.count)


def marks_of(problem: Problem, entry: Ints | slice) -> Ints:
    """Return the marks of some entries."""
    marks = np.zeros(len(problem.cost), np.uint8)[entry]
    if problem.unjudged is not None:
        ignored, excused = problem.unjudged
        marks |= IGNORED_TRUTH * ignored[problem.truth_row[entry]].astype(np.uint8)
        marks |= EXCUSED_ESTIMATE * excused[problem.estimate_row[entry]].astype(np.uint8)
    return marks


def problem_of(
    entry: Table, first: int, numbers: tuple[Ints, Ints], parameters: Parameters
) -> Problem:
    """Return the problem of some entries. States without an entry are not in the problem.

    Parameters
    ----------
    entry : array of ENTRY
        Entries sorted by (step, truth, estimate).
    first : int
        Global number of the first step of the problem, which is step 0 there.
    numbers : pair of int arrays
        Global numbers of the problem's truths and of its estimates, sorted.
    parameters : Parameters
        Parameters of the metric.
    """
    step = entry["step"] - np.int32(first)
    rows: list[Ints] = []
    sides: dict[str, Any] = {}
    marks = entry["marks"]
    any_marks = bool(marks.any())
    unjudged: list[Mask] = []
    for name, bit, known, price in zip(
        ("truth", "estimate"),
        (IGNORED_TRUTH, EXCUSED_ESTIMATE),
        numbers,
        parameters.unassigned_prices,
        strict=True,
    ):
        track = np.searchsorted(known, entry[name]).astype(np.int64)
        key = step.astype(np.int64) * len(known) + track
        if name == "truth":  # the entries of a truth at a step are next to each other
            fresh = np.diff(key, prepend=-1) != 0
            row, key = np.cumsum(fresh) - 1, key[fresh]
        else:
            key, row = np.unique(key, return_inverse=True)
        rows.append(row.astype(np.int32))
        unjudged.append(np.zeros(len(key), bool))
        if any_marks:
            unjudged[-1][row] = marks & bit != 0
        at, who = np.divmod(key, max(len(known), 1))
        sides |= {
            f"{name}_step": at.astype(np.int32),
            f"{name}_track": who.astype(np.int32),
            f"{name}_price": np.broadcast_to(price, len(key)),
        }
    problem = Problem(
        **sides,
        steps=int(step.max(initial=-1)) + 1,
        truths=len(numbers[0]),
        estimates=len(numbers[1]),
        truth_row=rows[0],
        estimate_row=rows[1],
        cost=np.ascontiguousarray(entry["cost"]),
        switch_price=parameters.switch_price,
        signed=any_marks,  # a pair with an ignored truth can be near beyond the cutoff
    )
    return ignore_states(problem, *unjudged)


def tables_of(
    states: States, weights: Ints, first: int, numbers: tuple[Ints, Ints]
) -> dict[str, Table]:
    """Return the tables of assigned pairs and of switches, by the names of their files.

    `weights` is a feasible assignment. `first` and `numbers` are those that `problem_of` received.
    The tables have global numbers of steps and tracks.
    """
    truths, estimates = numbers
    used = read_assigned(states, weights)
    assigned = np.empty(len(used.step), ASSIGNED_PAIR)
    assigned["step"] = used.step + np.int32(first)
    assigned["truth"], assigned["estimate"] = truths[used.truth], estimates[used.estimate]
    assigned["cost"], assigned["weight"] = states.problem.powers(used.entry), used.weight
    assigned["marks"] = marks_of(states.problem, used.entry)
    changed = read_switches(states, weights)
    switched = np.empty(len(changed.step), SWITCHED)
    switched["step"] = changed.step + np.int32(first)
    switched["truth"], switched["variation"] = truths[changed.truth], changed.variation
    named = np.append(estimates, -1)
    switched["before"], switched["after"] = named[changed.before], named[changed.after]
    return {"assigned": assigned, "switched": switched}
