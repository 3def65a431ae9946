"""Evaluation of data larger than memory: from two paths to a result."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.progress import Status, Stopwatch
from tgospa_eval.distances.base import check_columns
from tgospa_eval.engines import Engine, PersistentPool, Processes
from tgospa_eval.errors import InputError
from tgospa_eval.evaluation.axis import Axis, check_left
from tgospa_eval.evaluation.diagnosis import (
    alignment_notices,
    axis_notices,
    default_notice,
    diagnose,
    explained,
    unit_notices,
)
from tgospa_eval.evaluation.ignoring import Ignoring
from tgospa_eval.evaluation.memory import Share
from tgospa_eval.evaluation.prepare import digest_of_evaluated, fit, recorded_settings
from tgospa_eval.evaluation.prove import make_result, nested_timings
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import ROLES, Reading
from tgospa_eval.formats.headers import ask
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.reading import check_heights, heights_notice, left_out_heights
from tgospa_eval.partitioned.files import changed_file, files_of, stored
from tgospa_eval.partitioned.run import Evaluated, Stages, evaluate_parts, scan_parts
from tgospa_eval.partitioned.scan import BlockPlan, Scanned, clock_of, find_steps, fitted
from tgospa_eval.partitioned.shards import IGNORED_TRUTH
from tgospa_eval.partitioned.sides import PartsSide, open_side, side_roles
from tgospa_eval.partitioned.tables import write_tables
from tgospa_eval.partitioned.tasks import Run, run_tasks
from tgospa_eval.problem.metric_family import check_underflow
from tgospa_eval.problem.solution import Solution
from tgospa_eval.quoting import listed
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import SPLIT_PARTS, Json, Labels, input_record
from tgospa_eval.results.summary import mean, ratio, root
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.tracks.alignment import Alignment
from tgospa_eval.tracks.coverage import digest_of_sums, judge
from tgospa_eval.tracks.trajectories import Trajectories

SMALL_DATA, BEFORE_WORKERS = 100 * 10**6, 2.0
"""Limit in bytes of small data, and seconds of work before workers start. If all files together are
smaller than SMALL_DATA, this process works for BEFORE_WORKERS seconds first, because starting
workers takes a second. With larger files, workers start at once, so that this process does not need
the memory of a worker."""

ROWS_SUMMED = 1 << 18
"""Number of assigned pairs that are added up at once."""

ROUNDED = 1e-9
"""Largest followed share of a track that counts as 0. It exceeds 0 because weights are rounded."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SideSummary(Reading):
    """Facts about a side after all its rows were read. Its `trajectories` have times and no rows.

    Rows *take part* if no option leaves them out, for example as duplicates or by their class.

    Parameters
    ----------
    at_steps : int
        Number of rows that take part and are at a step.
    sums : list of tuple of int
        Result of `tracks.coverage.row_sums` for each block, from its rows that take part.
    """

    at_steps: int
    sums: list[tuple[int, ...]]

    @classmethod
    def of(cls, side: PartsSide, blocks: Sequence[Json]) -> "SideSummary":
        """Summarise a side from the facts that `scan` wrote for all its blocks (`READ`).

        Raises
        ------
        InputError
            All rows have the same position, so the positions seem to be unknown.
        """
        left_out = Counter(side.steps.left_out)
        for block in blocks:
            left_out.update(block["left_out"])
        idle = {tuple(block["idle"]) for block in blocks if block["idle"] is not None}
        if len(idle) == 1 and (names := next(iter(idle))):
            raise InputError(
                f"{side.path}: {listed(names)}: the same in all rows, as if the position "
                "is unknown; name the columns of positions, "
                f"{ask(side.options.option, ['x=HEADER'])}"
            )
        repaired = {tuple(one.items()): one for block in blocks for one in block["warnings"]}
        return cls(
            trajectories=Trajectories.of_times(side.times, side.columns, side.clock),
            rows=side.steps.rows,
            format=side.format,
            missing=side.roles.missing,
            headers=side.roles.named,
            units=side.roles.units,
            left_out=dict(left_out),
            named=tuple(side.steps.classes),
            at_steps=sum(block["at_steps"] for block in blocks),
            sums=[tuple(block["sums"]) for block in blocks],
            warnings=tuple(Notice(**one).about(side.path) for one in repaired.values()),
        )

    @property
    def taken(self) -> int:
        """Number of rows that take part."""
        return sum(one[0] for one in self.sums)

    @property
    def off(self) -> int:
        """Number of rows that take part and are not at a step."""
        return self.taken - self.at_steps

    def has_class(self, name: str) -> bool:
        """Return True if a row of the side has this requested class."""
        return name in self.named


def evaluate_partitioned(
    paths: tuple[str, str],
    reading: tuple[ReadOptions, ReadOptions],
    request_of: Callable[[tuple[str, ...]], EvaluationRequest],
    *,
    work: Path,
    share: Share,
    engine: Engine | None = None,
    kept: bool = True,
    stopwatch: Stopwatch,
    check: Callable[[tuple[SideSummary, ...], tuple[str, str]], None] | None = None,
) -> PartitionedResult:
    """Evaluate two sides block by block and component by component.

    Parameters
    ----------
    paths : pair of str
        Truth and estimate: folders of Parquet or CSV files, or single files.
    reading : pair of ReadOptions
        Options for reading them.
    request_of : callable
        Function that makes the options of the evaluation from the names of the state columns.
    work : Path
        Folder for intermediate results and for the tables of the result. After an interruption, the
        same evaluation continues from the results in this folder.
    share : Share
        Number of processes, and memory of each process.
    engine : Engine, optional
        Engine of the worker processes; by default this process does the work.
    kept : bool
        Whether the folder `work` is kept after the run. If it is not kept, the table of assigned
        pairs is written without rows, because the full table is as long as the data.
    stopwatch : Stopwatch
        Stopwatch for the time of each stage.
    check : callable, optional
        Function that checks the facts about both sides (first argument) of these paths (second
        argument). It is called after all rows were read and before anything is solved, and can
        raise errors.

    Raises
    ------
    TgospaError
        The data are wrong, or an option needs all data at once.
    """
    rows = share.rows
    files = [file for path in paths for file in stored(path)]
    pool: AbstractContextManager[PersistentPool | None] = nullcontext()
    if engine is not None:
        small = sum(stat.st_size for _, stat in files) < SMALL_DATA
        here = isinstance(engine, Processes) and small
        pool = PersistentPool(engine, share.jobs, BEFORE_WORKERS if here else 0.0)
    with pool as workers:
        run: Run = partial(run_tasks, engine=workers)
        with stopwatch.span("read"):
            changed = changed_file(files, work, run) if kept else None
            if changed is not None:
                stopwatch.notify(f"{changed}: has changed since the last run; starting again")
            reading, about = _with_heights(reading, paths, request_of)
            truth, estimate = (
                open_side(path, options, role, work=work / "sides", rows_together=rows, run=run)
                for path, options, role in zip(paths, reading, ROLES, strict=True)
            )
            sides = truth, estimate
            clocks = clock_of(truth), clock_of(estimate)
            check_columns(*clocks, paths)
            request = request_of(truth.columns)
            if request.ignoring is not None:
                request, sides, absent = _marking(request, request.ignoring, sides)
                for text in absent:
                    stopwatch.notify(f"{paths[0]}: {text}")
            axis, grid, plan = find_steps(sides, clocks, request, paths)

        diagnosed = [*about, *(diagnose_middle(plan, grid) if len(plan.times) else ())]
        for notice in diagnosed:
            if not notice.code:
                stopwatch.notify(str(notice))
        stages = Stages(stopwatch, workers)
        read, blocks = scan_parts(plan, work, share, stages)
        known = tuple(
            SideSummary.of(side, [block[number] for block in read])
            for number, side in enumerate(sides)
        )
        if check is not None:
            check(known, paths)
        evaluated = evaluate_parts(plan, blocks, work, share, stages)
        if not share.tables:
            stages.end_workers()
            run = run_tasks
        with stopwatch.span("report"):
            result = _result(
                known, axis, grid, plan, evaluated, blocks, stopwatch, work, run, assignments=kept
            )
            notices = list(_notices(known, axis, grid, plan, blocks))
            for notice in notices:
                if not notice.code:
                    stopwatch.notify(str(notice))
    return replace(
        result,
        notices=tuple(one.sentence for one in (*diagnosed, *notices) if not one.code),
        warnings=(
            *(notice for notice in (*diagnosed, *notices) if notice.code),
            *(notice for one in known for notice in one.warnings),
            *result.warnings,
        ),
        timings=nested_timings(stopwatch),
        files={"truth": paths[0], "estimate": paths[1]},
    )


def _with_heights(
    reading: tuple[ReadOptions, ReadOptions],
    paths: tuple[str, str],
    request_of: Callable[[tuple[str, ...]], EvaluationRequest],
) -> tuple[tuple[ReadOptions, ReadOptions], list[Notice]]:
    """Return the options for reading, changed to read heights if both sides have heights.

    Also return notices about heights that are read or left out.

    Raises
    ------
    ConfigError
        Both sides have heights, and the distance does not support them.
    """
    heads = [
        side_roles(format, files[0], options)
        for (format, files), options in zip(map(files_of, paths), reading, strict=True)
    ]
    headers = [roles.height for roles in heads]
    each = list(zip(headers, reading, (roles.names for roles in heads), strict=True))
    if all(headers):
        columns = [roles.names[:2] for roles in heads]
        check_heights(headers, request_of(heads[0].names).distance.name, columns)
        first, second = (replace(one, heights="use") for one in reading)
        return (first, second), [Notice(text=heights_notice(*one)) for one in each]
    pairs = zip(each, paths, paths[::-1], strict=True)
    return reading, [
        left_out_heights(*one, f"{other} has none").about(path)
        for one, path, other in pairs
        if one[0]
    ]


def _marking(
    request: EvaluationRequest, ignoring: Ignoring, sides: tuple[PartsSide, PartsSide]
) -> tuple[EvaluationRequest, tuple[PartsSide, PartsSide], list[str]]:
    """Prepare both sides so that they mark ignored states when their rows are read.

    Returns
    -------
    request, sides
        The changed request and sides.
    list of str
        Notices about classes that the options ignore, but no row has.

    Raises
    ------
    ConfigError
        A side lacks a column of marks that the options name.
    """
    ignoring.check_marks([side.roles.attributes for side in sides], [side.path for side in sides])
    ignoring, absent = ignoring.spelt(sides[0].steps.classes)
    truth, estimate = (
        replace(side, marked=partial(ignoring.marked, role=role, name=side.path))
        for side, role in zip(sides, ROLES, strict=True)
    )
    if ignoring.classes:
        truth = replace(truth, options=replace(truth.options, also=ignoring.classes))
    return replace(request, ignoring=ignoring), (truth, estimate), absent


def _result(
    known: Sequence[SideSummary],
    axis: Axis,
    grid: Alignment,
    plan: BlockPlan,
    evaluated: Evaluated,
    blocks: Sequence[Scanned],
    stopwatch: Stopwatch,
    work: Path,
    run: Run,
    *,
    assignments: bool,
) -> PartitionedResult:
    """Write the tables, and return the result.

    The table of assigned pairs has rows only if `assignments` is True.
    """
    request, sides, proof = plan.request, plan.sides, evaluated.proof
    for side, numbered in zip(sides, evaluated.tracks, strict=True):
        if numbered.rows.sum() == side.steps.rows:  # rows that are left out can have other ids
            side.check_ids(numbered.ids)
    parameters, solver, bounds = request.parameters, request.solver, proof.bounds
    assert isinstance(solver, Certified)
    check_underflow(evaluated.constants, parameters, bounds.upper)
    shown = grid.truth.shown
    truths, estimates = evaluated.tracks
    unjudged = {} if evaluated.unjudged is None else vars(evaluated.unjudged)
    tables = write_tables(
        str(work / "tables"),
        {
            "times": shown.astype(np.str_) if shown.dtype == object else shown,
            "truths": truths.ids,
            "estimates": estimates.ids,
        },
        proof,
        zip((truths.rows, estimates.rows), evaluated.track_costs, strict=True),
        evaluated.folders,
        run,
        assigned=evaluated.assigned,
        further={**evaluated.beside, "step": {**unjudged, **evaluated.beside["step"]}},
        assignments=assignments,
    )
    split = {
        name: float(sums.sum())
        for name, sums in evaluated.beside["step"].items()
        if name in SPLIT_PARTS
    }
    spent = stopwatch.spans.get("solve/sweeps", 0.0)
    late = solver.time_limit is not None and spent >= solver.time_limit
    solution = Solution(
        weights=np.zeros(0),
        prices=np.zeros(0),
        status=Status.LATE if late else Status.SOLVED,
        finished=not late,
        iterations=evaluated.iterations,
    )
    rule = "grid" if request.time_matching.steps is None else "steps"
    counts, columns = evaluated.objects[0], sides[0].columns
    if evaluated.unjudged is not None:
        counts = counts - evaluated.unjudged.ignored
    switches = float(proof.breakdown.switch_count.sum())
    numbers, followed = tracking(evaluated, switches)
    counting = digest_of_sums(columns, [block.counting for block in blocks])
    return make_result(
        PartitionedResult,
        proof=proof,
        solver=solver,
        solution=solution,
        settings=parameters.recorded | recorded_settings(request.distance, request, columns),
        at=sum(block.at_cutoff for block in blocks),
        labels=Labels(times=shown.tolist(), truths=[], estimates=[], unit=request.unit),
        timings={},
        input={
            role: input_record(
                one.record,
                digest_of_sums(one.trajectories.columns, one.sums),
                {rule: one.off},
            )
            for role, one in zip(ROLES, known, strict=True)
        },
        evaluated_on=judge(
            axis.horizon,
            grid.truth,
            digest_of_evaluated(request, counting),
            states=int(counts.sum()),
            at=int(np.count_nonzero(counts)),
        ),
        split=split or None,
        nees=evaluated.nees,
        unjudged=evaluated.unjudged,
        sizes={
            "truth": len(truths.ids),
            "estimates": len(estimates.ids),
            "steps": len(plan.times),
            **evaluated.sizes,
        },
        objects=(int(evaluated.objects[0].sum()), int(evaluated.objects[1].sum())),
        tables=tables,
        tracking=numbers,
        followed=followed,
    )


def tracking(evaluated: Evaluated, switches: float) -> tuple[Json, Floats]:
    """Return numbers for the summary, and the followed share of the steps of each truth.

    The numbers are those that follow from sums over assigned pairs and over tracks. `switches` is
    the number of switches.
    """
    parameters = evaluated.proof.parameters
    cutoff, power = parameters.cutoff, 1 / parameters.order
    total, first, second, whole = 0.0, 0.0, 0.0, True
    for piece in evaluated.assigned:
        rows = np.load(piece, mmap_mode="r")
        for begin in range(0, len(rows), ROWS_SUMMED):
            own = rows[begin : begin + ROWS_SUMMED]
            own = own[own["marks"] & IGNORED_TRUTH == 0]
            weight, error = own["weight"], cutoff * own["cost"] ** power
            total, whole = total + float(weight.sum()), whole and bool((weight == 1).all())
            first, second = first + float(weight @ error), second + float(weight @ error**2)
    states = [tracks.evaluated for tracks in evaluated.tracks]
    count = max(len(evaluated.objects[0]), 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        followed = [
            (own - costs.unassigned_count) / own
            for own, costs in zip(states, evaluated.track_costs, strict=True)
        ]
    false = (states[1] > 0) & (followed[1] <= ROUNDED)
    truths, estimates = (
        int(states[0].sum()),
        total + float(evaluated.track_costs[1].unassigned_count.sum()),
    )
    numbers: Json = {
        "assigned_states": total,
        "truth_states": truths,
        "estimate_states": round(estimates),
        "detection_rate": ratio(total, truths),
        "precision": ratio(total, estimates),
        "rmse": root(ratio(second, total)),
        "mean_error": ratio(first, total),
        "switches_per_truth": ratio(switches, int(np.count_nonzero(states[0]))),
        "false_tracks": int(np.count_nonzero(false)),
        "false_tracks_per_step": ratio(float(states[1][false].sum()), count),
        "false_track_length": mean(states[1][false].astype(np.float64)),
    }
    if evaluated.unjudged is None:
        surplus = evaluated.objects[1] - evaluated.objects[0]
        numbers |= {
            "cardinality_error": ratio(float(surplus.sum()), count),
            "cardinality_mean_absolute": ratio(float(np.abs(surplus).sum()), count),
            "cardinality_rms": root(ratio(float((surplus**2).sum()), count)),
        }
    if whole:
        numbers["siap"] = {
            "completeness": ratio(total, truths),
            "ambiguity": ratio(total, total),
            "spuriousness": ratio(estimates - total, estimates),
        }
    return numbers, followed[0]


def _notices(
    known: Sequence[SideSummary],
    axis: Axis,
    grid: Alignment,
    plan: BlockPlan,
    blocks: Sequence[Scanned],
) -> Iterator[Notice]:
    """Yield the notices about rows and times that need the counts of all blocks."""
    matching = plan.request.time_matching
    for side, one in zip(plan.sides, known, strict=True):
        for text in side.said(one.left_out):
            yield Notice(text=f"{side.path}: {text}")
    off = known[0].off, known[1].off
    if any(off) and matching.steps is None:
        yield Notice(text=alignment_notices(replace(grid, left_out=off), matching)[-1])
    if plan.request.ignoring is not None:
        ignored, excused = (
            any(block.unjudged[number].any() for block in blocks) for number in (0, 1)
        )
        for text in plan.request.ignoring.messages(ignored=ignored, excused=excused):
            yield Notice(text=text)
    check_left(matching, sum(one.at_steps for one in known), off)
    yield from unit_notices(plan.request, known)
    yield from axis_notices(replace(axis, left_out=off), matching)


DIAGNOSED_ROWS = 50_000
"""Approximate number of rows of both sides together that are searched for faults. The search takes
a tenth of a second."""


def diagnose_middle(plan: BlockPlan, grid: Alignment) -> list[Notice]:
    """Return notices about the matching of times, and warnings about rows that look wrong.

    Only rows in the middle of the recording are searched for faults.

    Parameters
    ----------
    plan : BlockPlan
        Steps and times of the evaluation.
    grid : Alignment
        Alignment of the times of both sides, from `find_steps`.
    """
    request, names = plan.request, plan.names
    # `left_out` of `grid` has numbers of times. Messages need numbers of rows, which are not known
    # yet.
    steps = replace(grid, left_out=(0, 0))
    notices = [Notice(text=text) for text in alignment_notices(steps, request.time_matching)]
    first, last = middle(plan.rows, DIAGNOSED_ROWS)
    piece = plan.piece(first, last + 1)
    readings = piece.read()
    truth, estimate = (reading.trajectories for reading in readings)
    if request.time_matching.decided:
        sides, _ = fitted(piece, (truth, estimate), request, names)
    else:  # match the original times, because they can show faults of clocks
        sides = fit(truth, estimate, request, names)
    warnings = diagnose(replace(sides, headers=readings[1].headers, in_parts=True), request)
    if request.defaults:
        on = sides.alignment, sides.distance, request.parameters, request.defaults
        default = default_notice(*on, is_explained=explained(warnings))
        warnings = [*warnings, *([default] if default.code else [])]
    shown = grid.truth.shown
    return notices + [
        notice.about(f"from step {shown[first]} to {shown[last]}") for notice in warnings
    ]


def middle(rows: Ints, size: int) -> tuple[int, int]:
    """Return the first and the last step of a middle part with about `size` rows.

    `rows` has the number of rows of each step. The part is in the middle of the rows, not of the
    steps.
    """
    after = np.cumsum(rows)
    half = int(after[-1]) // 2
    first = int(np.searchsorted(after, half - size // 2, side="right"))
    last = int(np.searchsorted(after, half + size // 2, side="left"))
    return min(first, len(rows) - 1), min(max(first, last), len(rows) - 1)
