"""Stages of a partitioned evaluation: scan, find components, shuffle, solve, add up.

The tracks of all blocks get global numbers. Each component of tracks is put into a shard. The
"shuffle" sorts the near pairs of all blocks by shard. The docstring of the package `partitioned`
explains these words.
"""

import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask, in_batches
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import natural
from tgospa_eval.engines import PersistentPool
from tgospa_eval.evaluation.memory import Share
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import ROLES
from tgospa_eval.partitioned.scan import BESIDE, READ, BlockPlan, Scanned, constants, scan
from tgospa_eval.partitioned.shards import (
    IGNORED_TRUTH,
    PARTS_OF_TRACKS,
    PartialSums,
    solve_shard,
    sort_entries,
)
from tgospa_eval.partitioned.tables import existing_files, looked_up, sums_beside
from tgospa_eval.partitioned.tasks import Task, run_tasks
from tgospa_eval.problem.certificate import lower_cost, upper_cost
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.paths import down
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.solution import Bounds, Breakdown, PerTrack, Unjudged
from tgospa_eval.problem.states import connected_components
from tgospa_eval.results.consistency import NeesSums
from tgospa_eval.results.records import Arrays, Costs, Json
from tgospa_eval.solvers.certified import Certified

FEW = 1 << 19
"""Number of ids, or of pairs, that are merged at once. It is large because each merge is a pass
over all tracks."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracks:
    """All tracks of one side.

    Parameters
    ----------
    ids : (k,) array of str
        Ids of the k tracks, in the order of their global numbers. The numbers are the same as if
        all rows were read from one file.
    rows, evaluated : (k,) int arrays
        For each track: number of its rows that are at a step, and how many of these are evaluated.
    numbers : list of Path
        For each block, the file with the global numbers of its tracks.
    """

    ids: NDArray[np.str_]
    rows: Ints
    evaluated: Ints
    numbers: list[Path]


def number_tracks(blocks: Sequence[Scanned], side: int) -> Tracks:
    """Give global numbers to the tracks of a side (0 or 1), in natural order of their ids.

    For each block, the global numbers of its tracks are written into the folder of the block.
    """
    role, ids = ROLES[side], np.zeros(0, "U1")
    for some in in_batches((block.read(f"{role}_ids") for block in blocks), len, FEW):
        ids = np.unique(np.concatenate([ids, *some]))
    order = _natural_order(ids)
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    rows, unjudged = np.zeros((2, len(ids)), np.int64)
    numbers = [block.folder / f"{role}_numbers.npy" for block in blocks]
    for block, path in zip(blocks, numbers, strict=True):
        number = rank[np.searchsorted(ids, block.read(f"{role}_ids"))]
        rows[number] += block.read(f"{role}_rows")
        unjudged[number] += block.read(f"{role}_unjudged_rows")
        np.save(path, number)
    return Tracks(ids=ids[order], rows=rows, evaluated=rows - unjudged, numbers=numbers)


def _natural_order(ids: NDArray[np.str_]) -> Ints:
    """Return the indices that sort distinct ids in natural order (2 before 10)."""
    try:
        numbers = ids.astype(np.int64)
    except (ValueError, OverflowError):
        numbers = np.zeros(0, np.int64)
    if len(numbers) and (numbers >= 0).all() and (numbers.astype(np.str_) == ids).all():
        return np.argsort(numbers)
    texts = ids.tolist()
    return np.array(sorted(range(len(texts)), key=lambda k: natural(texts[k])), np.int64)


def make_shards(
    blocks: Sequence[Scanned], truths: Tracks, estimates: Tracks, size: int
) -> tuple[Ints, Ints, dict[str, int]]:
    """Put components, in the order of their first truths, into shards of about `size` entries.

    Returns
    -------
    of_truth : (m,) int array
        Shard of each truth, -1 for truths without a near pair.
    entries : (N,) int array
        Number of entries (near pairs at a step) of each shard.
    sizes : dict of str to int
        Three numbers of the whole problem, by their names in a result: pairs of tracks that are
        near at some step, entries, and components.
    """
    m, n = len(truths.ids), len(estimates.ids)
    several = [_in_several(side) for side in (truths, estimates)]
    root: Ints = np.arange(m + n, dtype=np.int32)
    by_truth = np.zeros(m, np.int64)
    once, often = 0, np.zeros(0, np.int64)
    near = _near_tracks(blocks, truths, estimates)
    for batch in in_batches(near, lambda pairs: len(pairs[0]), FEW):
        truth, estimate, entries = (np.concatenate(column) for column in zip(*batch, strict=True))
        by_truth += np.bincount(truth, entries, minlength=m).astype(np.int64)
        # `root` has, for each track, the first track of its component in all batches so far.
        root = connected_components(root[truth], root[estimate + m], m + n)[root]
        again = several[0][truth] & several[1][estimate]
        once += len(again) - int(np.count_nonzero(again))
        key = truth[again].astype(np.int64) * max(n, 1) + estimate[again]
        often = np.unique(np.concatenate((often, key)))
    paired = np.flatnonzero(by_truth)
    _, component = np.unique(root[paired], return_inverse=True)  # roots are the first truths
    entries = np.bincount(component, by_truth[paired]).astype(np.int64)
    group = (np.cumsum(entries) - entries) // size
    _, shard = np.unique(group, return_inverse=True)
    of_truth = np.full(m, -1, np.int32)
    of_truth[paired] = shard.astype(np.int32)[component]
    per_shard = np.bincount(shard, entries).astype(np.int64)
    sizes = {
        "candidate_pairs": once + len(often),
        "pair_steps": int(per_shard.sum()),
        "components": len(entries),
    }
    return of_truth, per_shard, sizes


def _in_several(side: Tracks) -> Mask:
    """Return a mask of the tracks that are in several blocks.

    A pair can be near in several blocks only if both of its tracks are in this mask.
    """
    count = np.zeros(len(side.ids), np.int32)
    for path in side.numbers:
        count[np.load(path)] += 1
    return count > 1


def _near_tracks(
    blocks: Sequence[Scanned], truths: Tracks, estimates: Tracks
) -> Iterator[tuple[Ints, Ints, Ints]]:
    """Yield three arrays for each block, with an element for each of its pairs of tracks.

    The arrays are the global numbers of the truths, those of the estimates, and the numbers of
    entries.
    """
    for block, *paths in zip(blocks, truths.numbers, estimates.numbers, strict=True):
        pairs, numbers = block.read("pairs"), [np.load(path) for path in paths]
        yield numbers[0][pairs["truth"]], numbers[1][pairs["estimate"]], pairs["entries"]


# -------------------------------------------------------------------------------------------------
# Progress of the stages.

OUTWARD = 1e-12
"""Relative amount by which displayed bounds are widened. It exceeds the rounding errors of the sums
from which they are computed."""


SHOWN_FROM = 0.01
"""Share of the work that must be done before the remaining time is shown."""


class Stages:
    """Runner of the tasks of each stage. It reports progress, remaining time, and bounds so far.

    The reports go to the stopwatch and its `progress`.

    Parameters
    ----------
    stopwatch : Stopwatch
        Stopwatch of the work.
    engine : PersistentPool, optional
        Pool of processes that do tasks; by default this process does them.
    """

    def __init__(self, stopwatch: Stopwatch, engine: PersistentPool | None = None) -> None:
        self.stopwatch, self.engine = stopwatch, engine
        self._outer = stopwatch.stage
        self._name = ""
        self._work: dict[str, float] = {}
        self._before = self._done = self._begin = 0.0
        self._left: set[str] = set()
        self._prices = (0.0, 0.0)
        self._proven: dict[str, tuple[float, float]] = {}

    def run(
        self,
        name: str,
        tasks: Mapping[str, Task],
        amounts: Sequence[float] | None = None,
        sums_of: Callable[[str], PartialSums | None] = lambda output: None,  # noqa: ARG005
    ) -> None:
        """Do the tasks of a stage.

        Parameters
        ----------
        name : str
            Words for the work of the stage, such as ``"solving"``.
        tasks : mapping of str to Task
            Tasks by the paths of their outputs. Tasks begin in this order. A task is skipped if its
            output exists.
        amounts : sequence of float, optional
            Work of each task: its number of entries. By default all tasks have the same work.
        sums_of : callable
            Function that receives the path of the output of a finished task. It returns the proven
            sums in this output, or None if there are none.
        """
        amounts = amounts or [1.0] * len(tasks)
        if self.engine is not None and len(tasks) > 1 and max(amounts) > HEAVY:
            self.engine.patience = 0.0
        self._work, self._left = dict(zip(tasks, amounts, strict=True)), set(tasks)
        there = [task for task in tasks if os.path.exists(task)]
        self._before = self._done = sum(self._work[task] for task in there)
        self._left.difference_update(there)
        self._name, self._begin = name, time.monotonic()
        self.stopwatch.progress.share, self.stopwatch.progress.left = 0.0, None
        self._show()
        run_tasks(tasks, self.engine, lambda output: self._ended(output, sums_of(output)))

    def end_workers(self) -> None:
        """End the workers. This process gets their memory, and does all further tasks."""
        if self.engine is not None:
            self.engine.close()
            self.engine = None

    def end(self) -> None:
        """Report that all stages have ended."""
        self.stopwatch.stage, self.stopwatch.progress.left = self._outer, None

    def _ended(self, task: str, sums: PartialSums | None) -> None:
        """Record that a task is done. If it has proven sums, update the displayed bounds."""
        if task in self._left:
            self._left.remove(task)
            self._done += self._work[task]
        if sums is not None:
            self.prove(sums, task)
        self._show()

    def expect(self, parameters: Parameters, objects: tuple[int, int]) -> None:
        """Set the first upper bound, the cost of leaving all objects unassigned.

        Parameters
        ----------
        parameters : Parameters
            Parameters of the metric.
        objects : pair of int
            Number of evaluated states of the truth at all steps, and that of the estimate.
        """
        self._prices = parameters.unassigned_prices
        self._proven = {"": (0.0, self._unassigned(*objects))}
        self.stopwatch.progress.scale = parameters.root
        self._bracket()

    def _unassigned(self, truths: float, estimates: float) -> float:
        return self._prices[0] * truths + self._prices[1] * estimates

    def prove(self, share: PartialSums, name: str) -> None:
        """Record the proven sums of some components, and update the displayed bounds.

        In the displayed upper bound, all objects of components without recorded sums count as
        unassigned.

        Parameters
        ----------
        share : PartialSums
            Proven sums of these components.
        name : str
            Name of the sums. Earlier sums of the same name are replaced.
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
        if fresh > SHOWN_FROM * whole:
            seconds = time.monotonic() - self._begin
            progress.left = seconds / fresh * (whole - self._done)


def add_up(
    folders: Sequence[Path],
    blocks: Sequence[Scanned],
    steps: int,
    constants: Problem,
    parameters: Parameters,
) -> tuple[Costs, tuple[Ints, Ints], tuple[Ints, Ints], int]:
    """Add up the costs of all shards, in order. Add the costs of the states that are in no shard.

    Parameters
    ----------
    folders : sequence of Path
        Folders that `solve_shard` wrote.
    blocks : sequence of Scanned
        All blocks.
    steps : int
        Number T of steps.
    constants : Problem
        Result of `scan.constants`.
    parameters : Parameters
        Parameters of the metric.

    Returns
    -------
    proof : Costs
        Bounds and breakdown, in units of c^p, like those of `certify`.
    objects : pair of (T,) int arrays
        Number of truths and number of estimates at each step.
    unjudged : pair of (T,) int arrays
        Number of ignored truths and number of excused estimates at each step.
    iterations : int
        Sum of the iterations of all shards.
    """
    counted = np.zeros((2, 2, steps), np.int64)
    for block in blocks:
        span = slice(block.first, block.first + len(block.objects[0]))
        counted[:, :, span] += block.objects, block.unjudged
    objects, unjudged = ((counts[0], counts[1]) for counts in counted)
    parts = {name: np.zeros(steps) for name in Breakdown.__annotations__ if name != "total"}
    left = counted[0] - counted[1]
    lower: list[float] = []
    upper: list[float] = []
    iterations = 0
    for path in existing_files(folders, "share.npz"):
        share = PartialSums.load(path)
        span = slice(share.first, share.first + len(share.truths))
        for name, part in parts.items():
            part[span] += getattr(share, name)
        for counts, own in zip(left, (share.truths, share.estimates), strict=True):
            counts[span] -= own
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
    costs = Costs(parameters=parameters, bounds=bounds, breakdown=breakdown)
    return costs, objects, unjudged, iterations


def _absorbed(pieces: Sequence[Path], steps: int) -> Floats:
    """Return, for each step, the sum of the weights of the pairs with an ignored truth, (T,)."""
    absorbed = np.zeros(steps)
    for piece in pieces:
        rows = np.load(piece, mmap_mode="r")
        at = np.flatnonzero(rows["marks"] & IGNORED_TRUTH)
        absorbed += np.bincount(rows["step"][at], rows["weight"][at], steps)
    return absorbed


def _track_costs(folders: Sequence[Path], name: str, tracks: Tracks, price: float) -> PerTrack:
    """Return the costs of each track of a side, from the folders of all shards.

    Rows without a near pair are in no shard. They are added here, at `price` each.
    """
    costs = {part: np.zeros(len(tracks.ids)) for part in PARTS_OF_TRACKS}
    rest = tracks.evaluated.copy()
    for path in existing_files(folders, f"{name}.npz"):
        with np.load(path) as shard:
            track = shard["track"]
            for part, values in costs.items():
                values[track] += shard[part]
            rest[track] -= shard["rows"]
    costs["unassigned"] += price * rest
    costs["unassigned_count"] += rest
    return PerTrack(**costs)


SCANNED = "scan"
"""Subfolder of the folder of work, for the results of `scan`."""

HEAVY = 50_000
"""Largest number of entries of a small task. If a stage has several tasks, and one of them is
larger, workers start at once."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluated:
    """Costs and counts of all shards together.

    Parameters
    ----------
    proof : Costs
        Bounds and breakdown, in units of c^p.
    objects : pair of (T,) int arrays
        Number of truths and number of estimates at each step.
    unjudged : Unjudged, optional
        Numbers of truths and estimates that are not evaluated, if there are any.
    tracks : pair of Tracks
        Tracks of truth and of estimate.
    track_costs : pair of PerTrack
        Costs of each of these tracks.
    sizes : dict of str to int
        Result of `make_shards`: numbers of near pairs, of entries and of components.
    folders : list of Path
        Folder of each shard, with the table of its switches.
    assigned : list of Path
        Files of assigned pairs.
    beside : dict of dict of arrays
        Sums of further values of assigned pairs (parts of distances, NEES), from `sums_beside`.
    nees : NeesSums, optional
        Sums of NEES, which show whether covariances match the errors.
    iterations : int
        Sum of the solver's iterations of all shards.
    constants : Problem
        Result of `scan.constants`.
    """

    proof: Costs
    objects: tuple[Ints, Ints]
    unjudged: Unjudged | None
    tracks: tuple[Tracks, Tracks]
    track_costs: tuple[PerTrack, ...]
    sizes: dict[str, int]
    folders: list[Path]
    assigned: list[Path]
    beside: dict[str, Arrays]
    nees: NeesSums | None
    iterations: int
    constants: Problem


def scan_parts(
    plan: BlockPlan, work: Path, share: Share, stages: Stages
) -> tuple[list[list[Json]], list[Scanned]]:
    """Read all blocks, and search their near pairs.

    All rows with the same time or the same step are in one block.

    Parameters
    ----------
    plan : BlockPlan
        Steps and times, divided into blocks.
    work : Path
        Folder of work. Results of tasks that are already in it are not computed again.
    share : Share
        Memory of each worker.
    stages : Stages
        Runner of the tasks.

    Returns
    -------
    read : list of pairs of dict
        Content of the file `READ` of each block: for each side, facts about the rows that were
        read.
    blocks : list of Scanned
        Facts about each block.

    Raises
    ------
    TgospaError
        The data are wrong, or a process died.
    """
    with stages.stopwatch.span("distances"):
        tasks: dict[str, Task] = {
            str(work / SCANNED / f"{number:08d}"): partial(
                scan, piece=piece, request=plan.request, names=plan.names
            )
            for number, piece in enumerate(plan.pieces(share.rows))
        }
        stages.run("searching near pairs", tasks)
    with stages.stopwatch.span("solve/preparation"):
        folders = [*map(Path, tasks)]
        read = [json.loads((folder / READ).read_text(encoding="utf-8")) for folder in folders]
        return read, [Scanned.load(folder) for folder in folders]


def evaluate_parts(
    plan: BlockPlan, blocks: Sequence[Scanned], work: Path, share: Share, stages: Stages
) -> Evaluated:
    """Solve the whole problem from the near pairs that `scan_parts` wrote.

    The near pairs are divided into shards, each shard is solved, and the costs are added up.

    Raises
    ------
    TgospaError
        A process died.
    """
    parameters, span = plan.request.parameters, stages.stopwatch.span
    with span("solve/preparation"):
        truths, estimates = (number_tracks(blocks, side) for side in (0, 1))
        of_truth, entries, pair_counts = make_shards(blocks, truths, estimates, share.entries)
        largest = int(entries.max(initial=0))
        if not share.fits_component(largest, masked=plan.request.ignoring is not None):
            stages.end_workers()
        folders = _shuffle(work, blocks, (truths, estimates), of_truth, len(entries), stages)
    with span("solve/sweeps"):
        stages.expect(parameters, (int(truths.evaluated.sum()), int(estimates.evaluated.sum())))
        solved = _solve(plan.request, work, folders, entries, stages)
    stages.end()
    with span("certify"):
        sizes, assigned = (len(plan.times), len(truths.ids), len(estimates.ids)), []
        assigned += existing_files(solved, "assigned.npy")
        pieces = _beside(work, blocks, (truths, estimates), assigned)
        beside, nees = sums_beside(pieces, sizes, len(plan.sides[0].columns))
        fixed = constants(plan.request, plan.sides[0].columns, blocks)
        proof, objects, (ignored, excused), iterations = add_up(
            solved, blocks, len(plan.times), fixed, parameters
        )
        unjudged = None
        if ignored.any() or excused.any():
            absorbed = _absorbed(assigned, len(plan.times))
            unjudged = Unjudged(ignored=ignored, excused=excused, absorbed=absorbed)
        track_costs = tuple(
            _track_costs(solved, name, tracks, price)
            for name, tracks, price in zip(
                ("truths", "estimates"),
                (truths, estimates),
                parameters.unassigned_prices,
                strict=True,
            )
        )
    return Evaluated(
        proof=proof,
        objects=objects,
        unjudged=unjudged,
        tracks=(truths, estimates),
        track_costs=track_costs,
        sizes=pair_counts,
        folders=solved,
        assigned=assigned,
        beside=beside,
        nees=nees,
        iterations=iterations,
        constants=fixed,
    )


def _shuffle(
    work: Path,
    blocks: Sequence[Scanned],
    tracks: tuple[Tracks, Tracks],
    of_truth: Ints,
    shards: int,
    stages: Stages,
) -> tuple[str, ...]:
    if blocks:
        np.save(work / SCANNED / "shard_of_truth.npy", of_truth)
    tasks: dict[str, Task] = {
        str(work / "sorted" / f"{k:08d}"): partial(
            sort_entries,
            scanned=str(block.folder),
            numbers=[str(side.numbers[k]) for side in tracks],
            shard_of_truth=str(work / SCANNED / "shard_of_truth.npy"),
            shards=shards,
        )
        for k, block in enumerate(blocks)
        if block.near
    }
    stages.run("sorting near pairs", tasks)
    return tuple(tasks)


def _beside(
    work: Path, blocks: Sequence[Scanned], numbers: Sequence[Tracks], assigned: list[Path]
) -> Iterator[NDArray[np.void]]:
    """Yield, for each block, its assigned pairs with their further values (see `scan.BESIDE`).

    The pairs with these values are also written into a new file for each block. The paths of the
    new files replace those in the list `assigned`. If no block has further values, nothing is
    yielded, and `assigned` does not change.
    """
    if not any((block.folder / BESIDE).exists() for block in blocks):
        return
    pieces, folder = [*map(str, assigned)], work / "assigned"
    assigned.clear()
    folder.mkdir(exist_ok=True)
    for k, block in enumerate(blocks):
        rows = looked_up(block, [np.load(side.numbers[k]) for side in numbers], pieces)
        assigned.append(folder / f"{k:08d}.npy")
        np.save(assigned[-1], rows)
        yield rows


def _solve(
    request: EvaluationRequest,
    work: Path,
    folders: tuple[str, ...],
    entries: Ints,
    stages: Stages,
) -> list[Path]:
    """Solve all shards, and return their folders."""
    solver, parameters = request.solver, request.parameters
    assert isinstance(solver, Certified)
    end = None if solver.time_limit is None else time.time() + solver.time_limit
    solved = [work / "shards" / f"{number:06d}" for number in range(len(entries))]
    largest = np.argsort(-entries, kind="stable").tolist()
    tasks: dict[str, Task] = {
        str(solved[k]): partial(
            solve_shard,
            folders=folders,
            number=k,
            parameters=parameters,
            solver=solver,
            end=end,
        )
        for k in largest
    }
    stages.run(
        "solving",
        tasks,
        entries[largest].astype(float).tolist(),
        lambda output: PartialSums.load(Path(output) / "share.npz"),
    )
    return solved
