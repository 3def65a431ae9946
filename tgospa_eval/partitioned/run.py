"""The line of a partitioned evaluation: scan, components, shuffle, solve, add up."""

import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import partial
from pathlib import Path

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.engines.engine import Engine
from tgospa_eval.engines.processes import PersistentPool
from tgospa_eval.partitioned.components import Shards, Tracks, make_shards, number_tracks
from tgospa_eval.partitioned.long.run import Long, solve_long
from tgospa_eval.partitioned.scan import READ, Scanned, constants, scan
from tgospa_eval.partitioned.shards import (
    PARTS_OF_TRACKS,
    PartialSums,
    long_name,
    solve_shard,
    sort_entries,
)
from tgospa_eval.partitioned.steps import BlockPlan
from tgospa_eval.partitioned.tasks import Task, run_tasks
from tgospa_eval.problem.certificate import lower_cost, upper_cost
from tgospa_eval.problem.paths import down
from tgospa_eval.problem.problem import Floats, Ints, Problem
from tgospa_eval.problem.solution import Bounds, Breakdown
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.results.records import Json
from tgospa_eval.solvers.certified import Certified

# -------------------------------------------------------------------------------------------------
# What the stages of a partitioned evaluation say of themselves while they go on.

OUTWARD = 1e-12
"""Relative, by which bounds that are shown are wider: sums of sums are off by less."""


TOLD_FROM = 0.01
"""Of the work has to be done before anyone says how long the rest takes."""


class Stages:
    """The stage, how much of it is done, the time that is left, and what is proven so far.

    Who watches reads it from the stopwatch and its `progress`.

    Parameters
    ----------
    stopwatch : Stopwatch
        Of the work.
    """

    def __init__(self, stopwatch: Stopwatch) -> None:
        self.stopwatch = stopwatch
        self._outer = stopwatch.stage
        self._name = ""
        self._work: dict[str, float] = {}
        self._before = self._done = self._begin = 0.0
        self._left: set[str] = set()
        self._prices = (0.0, 0.0)
        self._proven: dict[str, tuple[float, float]] = {}

    def stage(self, name: str, tasks: Mapping[str, float]) -> None:
        """Begin a stage, which ends the one before.

        Parameters
        ----------
        name : str
            What is done, in a word: ``"solving"``.
        tasks : mapping of str to float
            Outputs of its tasks, and how much work each is in any unit. What is there already is
            known to be done.
        """
        self._name, self._work, self._left = name, dict(tasks), set(tasks)
        there = [task for task in tasks if os.path.exists(task)]
        self._before = self._done = sum(tasks[task] for task in there)
        self._left.difference_update(there)
        self._begin = time.monotonic()
        self.stopwatch.progress.share, self.stopwatch.progress.left = 0.0, None
        self._show()

    def end(self) -> None:
        """All stages are done."""
        self.stopwatch.stage, self.stopwatch.progress.left = self._outer, None

    def done(self, task: str, share: PartialSums | None = None) -> None:
        """A task has ended, or was found done.

        Parameters
        ----------
        task : str
            Its output.
        share : PartialSums, optional
            What it proves.
        """
        if task in self._left:
            self._left.remove(task)
            self._done += self._work[task]
        if share is not None:
            self.prove(share, task)
        self._show()

    def expect(self, parameters: Parameters, objects: tuple[int, int]) -> None:
        """Say what would be paid if nothing were assigned, before shares come.

        Parameters
        ----------
        parameters : Parameters
            Of the metric.
        objects : pair of int
            All states of truth and of estimate.
        """
        self._prices = parameters.unassigned_prices
        self._proven = {"": (0.0, self._unassigned(*objects))}
        self.stopwatch.progress.scale = parameters.root
        self._bracket()

    def _unassigned(self, truths: float, estimates: float) -> float:
        return self._prices[0] * truths + self._prices[1] * estimates

    def prove(self, share: PartialSums, name: str) -> None:
        """Below, shares that are known; above, them and all other objects unassigned.

        Parameters
        ----------
        share : PartialSums
            What is proven.
        name : str
            Of what: it takes the place of what was proven of it before.
        """
        free = self._unassigned(float(share.truths.sum()), float(share.estimates.sum()))
        self._proven[name] = share.bracket[0], share.total - free
        self._bracket()

    def _bracket(self) -> None:
        lower, upper = map(math.fsum, zip(*self._proven.values(), strict=True))
        self.stopwatch.progress.prove(lower * (1 - OUTWARD), upper * (1 + OUTWARD))

    def _show(self) -> None:
        progress, whole = self.stopwatch.progress, sum(self._work.values())
        count = len(self._work)
        done = f", {count - len(self._left):,} of {count:,}" if count else ""
        self.stopwatch.stage = self._name + done
        if not whole > 0:
            return
        progress.done(self._done / whole)
        fresh = self._done - self._before
        if fresh > TOLD_FROM * whole:
            seconds = time.monotonic() - self._begin
            progress.left = seconds / fresh * (whole - self._done)


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluationSums:
    """The whole evaluation, in units of c^p.

    Parameters
    ----------
    bounds, breakdown : Bounds, Breakdown
        As `certify` gives them.
    objects : pair of (T,) int arrays
        Truths and estimates at each step.
    tracks : pair of dict of str to (k,) float array
        What each truth and estimate contributes, by the names of `problem.readout.PerTrack`.
    iterations : int
        Of all shards.
    """

    bounds: Bounds
    breakdown: Breakdown
    objects: tuple[Ints, Ints]
    tracks: tuple[dict[str, Floats], dict[str, Floats]]
    iterations: int


def add_up(
    folders: Sequence[Path],
    blocks: Sequence[Scanned],
    steps: int,
    tracks: tuple[Tracks, Tracks],
    constants: Problem,
    parameters: Parameters,
) -> EvaluationSums:
    """Add up all shards, in order, and the objects that are in none.

    Parameters
    ----------
    folders : sequence of Path
        What `solve_shard` wrote.
    blocks : sequence of Scanned
        All blocks.
    steps : int
        T.
    tracks : pair of Tracks
        Those of truth and estimate.
    constants : Problem
        Has errors and rounding of the whole.
    parameters : Parameters
        Of the metric.
    """
    objects = np.zeros(steps, np.int64), np.zeros(steps, np.int64)
    for block in blocks:
        for counts, found in zip(objects, block.objects, strict=True):
            counts[block.first : block.first + len(found)] += found
    parts = {name: np.zeros(steps) for name in Breakdown.__annotations__ if name != "total"}
    left = [counts.copy() for counts in objects]
    lower: list[float] = []
    upper: list[float] = []
    iterations = 0
    for path in _of(folders, "share.npz"):
        share = PartialSums.load(path)
        span = slice(share.first, share.first + len(share.truths))
        for name, part in parts.items():
            part[span] += getattr(share, name)
        for counts, found in zip(left, (share.truths, share.estimates), strict=True):
            counts[span] -= found
        lower += share.lower.tolist()
        upper.append(share.total)
        iterations += share.iterations
    for name, counts, price in zip(
        ("missed", "false"), left, parameters.unassigned_prices, strict=True
    ):
        parts[name] += price * counts
        parts[f"{name}_count"] += counts
        rest = float(price * counts.sum())
        upper.append(rest)
        lower.append(float(down(np.array([rest]))[0]) if rest else 0.0)
    breakdown = Breakdown(**parts, total=math.fsum(upper))
    bounds = Bounds(
        lower=lower_cost(constants, math.fsum(lower)),
        upper=upper_cost(constants, breakdown),
        rounding=constants.rounding,
    )
    names = ("truths", "estimates")
    both = [
        _tracks(folders, name, side, price)
        for name, side, price in zip(names, tracks, parameters.unassigned_prices, strict=True)
    ]
    return EvaluationSums(
        bounds=bounds,
        breakdown=breakdown,
        objects=objects,
        tracks=(both[0], both[1]),
        iterations=iterations,
    )


def _of(folders: Sequence[Path], name: str) -> list[Path]:
    """The files of this name, of the folders that have one."""
    return [folder / name for folder in folders if (folder / name).exists()]


def _tracks(folders: Sequence[Path], name: str, tracks: Tracks, price: float) -> dict[str, Floats]:
    """What each track contributes; the rows of those in shards that have no near pair as well."""
    found = {part: np.zeros(len(tracks.ids)) for part in PARTS_OF_TRACKS}
    rest = tracks.rows.copy()
    for path in _of(folders, f"{name}.npz"):
        with np.load(path) as shard:
            track = shard["track"]
            for part, values in found.items():
                values[track] += shard[part]
            rest[track] -= shard["rows"]
    found["unassigned"] += price * rest
    found["unassigned_count"] += rest
    return found


BYTES_A_ROW, BYTES_AN_ENTRY = 600, 300
"""Memory that a worker needs for each row of a block, and for each entry of a shard: measured."""

SCANNED = "scan"
"""In the folder of work, that of the blocks that were read."""

HEAVY = 50_000
"""Work of a task, in entries, for which workers are begun at once where there are more tasks."""

MOST_ROWS, MOST_ENTRIES = 4_000_000, 30_000_000
"""No more than this together, however much memory there is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PartsPlan:
    """What is evaluated, and with what.

    Parameters
    ----------
    cut : BlockPlan
        Both sides along the steps.
    columns : int
        Components of a state.
    work : Path
        The folder of what is known on the way.
    memory : int
        Bytes for each worker.
    stages : Stages
        What whoever watches is told.
    engine : Engine, optional
        Where tasks are done; in this process by default.
    look : callable
        Called with what `scan` says of the rows that were read, before anything is solved.
    """

    cut: BlockPlan
    columns: int
    work: Path
    memory: int
    stages: Stages = field(default_factory=lambda: Stages(Stopwatch()))
    engine: Engine | None = None
    look: Callable[[list[list[Json]]], None] = lambda read: None  # noqa: ARG005

    def run(
        self,
        name: str,
        tasks: Mapping[str, Task],
        amounts: Sequence[float] | None = None,
        share_of: Callable[[str], PartialSums | None] = lambda output: None,  # noqa: ARG005
    ) -> None:
        """Do the tasks of a stage.

        Parameters
        ----------
        name : str
            What is done in it, in a word.
        tasks : mapping of str to Task
            By their outputs, in the order in which to begin.
        amounts : sequence of float, optional
            How much work each is, in entries.
        share_of : callable
            What is proven by one that is done, from its output.
        """
        each = amounts or [1.0] * len(tasks)
        if (
            isinstance(self.engine, PersistentPool)
            and len(tasks) > 1
            and max(amounts or [0]) > HEAVY
        ):
            self.engine.patience = 0.0
        self.stages.stage(name, dict(zip(tasks, each, strict=True)))
        run_tasks(tasks, self.engine, lambda output: self.stages.done(output, share_of(output)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluated:
    """What came out.

    Parameters
    ----------
    whole : EvaluationSums
        Bounds, breakdown, what each track contributes.
    read : list of pairs of dict
        What `scan` says of the rows of each block, of either side.
    blocks : list of Scanned
        What is known of the blocks.
    tracks : pair of Tracks
        Those of truth and estimate.
    shards : Shards
        How components were solved.
    entries : int
        Near pairs.
    folders : tuple of Path
        One for each shard, with the tables of its assignment.
    constants : Problem
        Has errors and rounding of the whole.
    """

    whole: EvaluationSums
    read: list[list[Json]]
    blocks: list[Scanned]
    tracks: tuple[Tracks, Tracks]
    shards: Shards
    entries: int
    folders: tuple[Path, ...]
    constants: Problem


def rows_together(memory: int) -> int:
    """Rows of a block for a worker with so many bytes."""
    return max(min(MOST_ROWS, memory // BYTES_A_ROW), 1)


def most_entries(memory: int) -> int:
    """Entries that a worker with so many bytes can hold."""
    return max(min(MOST_ENTRIES, memory // BYTES_AN_ENTRY), 1)


def evaluate_parts(plan: PartsPlan, stopwatch: Stopwatch | None = None) -> Evaluated:
    """Evaluate; goes on from what is in the folder of work.

    Raises
    ------
    TgospaError
        Something is wrong with the data, or a process died.
    """
    stopwatch = stopwatch or Stopwatch()
    with stopwatch.span("distances"):
        scanned = _scan(plan)
    with stopwatch.span("solve/preparation"):
        read = [json.loads((folder / READ).read_text(encoding="utf-8")) for folder in scanned]
        plan.look(read)
        ranges = (path for folder in scanned for path in sorted(folder.iterdir()) if path.is_dir())
        blocks = [Scanned.load(folder) for folder in ranges]
        truths, estimates = (number_tracks(blocks, side) for side in (0, 1))
        shards = make_shards(blocks, truths, estimates, most_entries(plan.memory))
        folders = _shuffle(plan, blocks, (truths, estimates), shards)
    with stopwatch.span("solve/sweeps"):
        rows = int(truths.rows.sum()), int(estimates.rows.sum())
        plan.stages.expect(plan.cut.request.parameters, rows)
        solved = _solve(plan, folders, shards)
    plan.stages.end()
    with stopwatch.span("certify"):
        fixed = constants(plan.cut.request, plan.columns, blocks)
        whole = add_up(
            solved,
            blocks,
            len(plan.cut.times),
            (truths, estimates),
            fixed,
            plan.cut.request.parameters,
        )
    return Evaluated(
        whole=whole,
        read=read,
        blocks=blocks,
        tracks=(truths, estimates),
        shards=shards,
        entries=int(shards.entries.sum()),
        folders=tuple(solved),
        constants=fixed,
    )


def _scan(plan: PartsPlan) -> list[Path]:
    """Blocks of whole steps with so many rows as fit; each time of a side is in one of them."""
    most = rows_together(plan.memory)
    tasks: dict[str, Task] = {
        str(plan.work / SCANNED / f"{number:08d}"): partial(
            scan, piece=piece, request=plan.cut.request, names=plan.cut.names, most=most
        )
        for number, piece in enumerate(plan.cut.pieces(most))
    }
    plan.run("searching near pairs", tasks)
    return list(map(Path, tasks))


def _shuffle(
    plan: PartsPlan,
    blocks: Sequence[Scanned],
    tracks: tuple[Tracks, Tracks],
    shards: Shards,
) -> tuple[str, ...]:
    tasks: dict[str, Task] = {
        str(plan.work / "sorted" / f"{k:08d}"): partial(
            sort_entries,
            scanned=str(block.folder),
            numbers=(tracks[0].numbers[k], tracks[1].numbers[k]),
            shard_of_truth=shards.of_truth[tracks[0].numbers[k]],
            long=shards.long,
        )
        for k, block in enumerate(blocks)
        if block.near
    }
    plan.run("sorting near pairs", tasks)
    return tuple(tasks)


def _solve(plan: PartsPlan, folders: tuple[str, ...], shards: Shards) -> list[Path]:
    """Folders with what the shards contribute, those of long components last."""
    solver, parameters = plan.cut.request.solver, plan.cut.request.parameters
    assert isinstance(solver, Certified)
    end = None if solver.time_limit is None else time.time() + solver.time_limit
    short = np.flatnonzero(~shards.long)
    found = [plan.work / "shards" / f"{number:06d}" for number in short.tolist()]
    largest = np.argsort(-shards.entries[short], kind="stable").tolist()
    tasks: dict[str, Task] = {
        str(found[k]): partial(
            solve_shard,
            folders=folders,
            number=int(short[k]),
            parameters=parameters,
            solver=solver,
            end=end,
        )
        for k in largest
    }
    plan.run(
        "solving",
        tasks,
        shards.entries[short[largest]].astype(float).tolist(),
        lambda output: PartialSums.load(Path(output) / "share.npz"),
    )
    for number in np.flatnonzero(shards.long).tolist():
        component = Long(
            entries=tuple(str(Path(folder) / long_name(number)) for folder in folders),
            parameters=parameters,
            work=str(plan.work / "long" / f"{number:06d}"),
            gap=solver.gap,
            together=most_entries(plan.memory),
            end=end,
        )
        run = partial(plan.run, "solving a long component")
        joined = solve_long(component, run, partial(plan.stages.prove, name=component.work))
        found += map(Path, joined.folders)
    return found
