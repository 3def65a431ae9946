"""The line of a partitioned evaluation: scan, components, shuffle, solve, add up."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import partial
from pathlib import Path

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.engines.processes import Standing
from tgospa_eval.engines.spread import Engine
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.partitioned.add_up import EvaluationSums, add_up
from tgospa_eval.partitioned.components import Shards, Tracks, make_shards, number_tracks
from tgospa_eval.partitioned.long.component import Long
from tgospa_eval.partitioned.long.run import solve_long
from tgospa_eval.partitioned.scan import Scanned, constants, scan
from tgospa_eval.partitioned.shards import long_name, solve_shard, sort_entries
from tgospa_eval.partitioned.share import PartialSums
from tgospa_eval.partitioned.steps import BlockPlan
from tgospa_eval.partitioned.tasks import Stages, Task, run_tasks
from tgospa_eval.problem.problem import Problem
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.tracks.alignment import Times

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
    times : (T,) array
        The steps.
    request : EvaluationRequest
        What is asked.
    names : pair of str
        The sides, for messages.
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
        Called with what is known of the blocks, before anything is solved.
    """

    cut: BlockPlan
    times: Times
    request: EvaluationRequest
    names: tuple[str, str]
    columns: int
    work: Path
    memory: int
    stages: Stages = field(default_factory=lambda: Stages(Stopwatch()))
    engine: Engine | None = None
    look: Callable[[Sequence[Scanned]], None] = lambda blocks: None  # noqa: ARG005

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
        if isinstance(self.engine, Standing) and len(tasks) > 1 and max(amounts or [0]) > HEAVY:
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
        blocks = [Scanned.load(folder) for folder in scanned]
        plan.look(blocks)
        truths, estimates = (number_tracks(blocks, side) for side in (0, 1))
        shards = make_shards(blocks, truths, estimates, most_entries(plan.memory))
        folders = _shuffle(plan, scanned, blocks, (truths, estimates), shards)
    with stopwatch.span("solve/sweeps"):
        rows = int(truths.rows.sum()), int(estimates.rows.sum())
        plan.stages.expect(plan.request.parameters, rows)
        solved = _solve(plan, folders, shards)
    plan.stages.end()
    with stopwatch.span("certify"):
        fixed = constants(plan.request, plan.columns, blocks)
        whole = add_up(
            solved, blocks, len(plan.times), (truths, estimates), fixed, plan.request.parameters
        )
    return Evaluated(
        whole=whole,
        blocks=blocks,
        tracks=(truths, estimates),
        shards=shards,
        entries=int(shards.entries.sum()),
        folders=tuple(solved),
        constants=fixed,
    )


def _scan(plan: PartsPlan) -> list[Path]:
    """Blocks of whole steps with so many rows as fit; each time of a side is in one of them."""
    tasks: dict[str, Task] = {
        str(plan.work / SCANNED / f"{number:08d}"): partial(
            scan,
            piece=piece,
            times=plan.times[piece.low : piece.high],
            request=plan.request,
            names=plan.names,
        )
        for number, piece in enumerate(plan.cut.pieces(rows_together(plan.memory)))
    }
    plan.run("searching near pairs", tasks)
    return list(map(Path, tasks))


def _shuffle(
    plan: PartsPlan,
    scanned: Sequence[Path],
    blocks: Sequence[Scanned],
    tracks: tuple[Tracks, Tracks],
    shards: Shards,
) -> tuple[str, ...]:
    tasks: dict[str, Task] = {
        str(plan.work / "sorted" / folder.name): partial(
            sort_entries,
            scanned=str(folder),
            numbers=(tracks[0].numbers[k], tracks[1].numbers[k]),
            shard_of_truth=shards.of_truth[tracks[0].numbers[k]],
            long=shards.long,
        )
        for k, folder in enumerate(scanned)
        if blocks[k].near
    }
    plan.run("sorting near pairs", tasks)
    return tuple(tasks)


def _solve(plan: PartsPlan, folders: tuple[str, ...], shards: Shards) -> list[Path]:
    """Folders with what the shards contribute, those of long components last."""
    solver, parameters = plan.request.solver, plan.request.parameters
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
