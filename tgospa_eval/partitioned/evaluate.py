"""From two paths to a result, of data that are larger than memory."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.progress import Status, Stopwatch
from tgospa_eval.common.words import counted, natural
from tgospa_eval.distances import Distance
from tgospa_eval.distances.checks import check_columns
from tgospa_eval.engines.processes import Processes, Standing
from tgospa_eval.engines.spread import Engine
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.axis import check_left
from tgospa_eval.evaluation.diagnosis import alignment_notices, axis_notices
from tgospa_eval.evaluation.evaluate import nested_timings, solver_settings
from tgospa_eval.evaluation.localisation import within_rounding
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import ROLES
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.partitioned.input.digests import changed_file
from tgospa_eval.partitioned.input.listing import stored
from tgospa_eval.partitioned.resampling import Found, Resampling, clock_of, find_steps
from tgospa_eval.partitioned.run import Evaluated, PartsPlan, evaluate_parts, rows_together
from tgospa_eval.partitioned.sample import look
from tgospa_eval.partitioned.scan import Read, Scanned
from tgospa_eval.partitioned.sides import PartsSide, open_side
from tgospa_eval.partitioned.tables import Naming, TrackSums, write_tables
from tgospa_eval.partitioned.tasks import Stages, run_tasks
from tgospa_eval.problem.compiled import KERNEL
from tgospa_eval.problem.tgospa import check_underflow
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import Costs, FileInfo, Json, Labels
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.tracks.judged import digest_of_sums, judge

SMALL_DATA, BEFORE_WORKERS = 100 * 10**6, 2.0
"""Of fewer bytes of files, so many seconds of work are done before there are workers: to begin one
takes a second. Of more it would take memory of this process as well."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Means:
    """Where an evaluation is done, and with what.

    Parameters
    ----------
    work : Path
        Folder for what is known on the way; the same evaluation goes on from what is there.
    tables : Path
        Folder for the tables of the result.
    memory : int
        Bytes, for all processes together.
    jobs : int
        How many processes share them.
    engine : Engine, optional
        Where they are; one job is done in this process.
    assignments : bool
        Whether the table of assigned pairs is wanted, which is as long as the data.
    kept : bool
        Whether what is known on the way outlives a run that is broken off.
    """

    work: Path
    tables: Path
    memory: int
    jobs: int = 1
    engine: Engine | None = None
    assignments: bool = True
    kept: bool = True

    @property
    def share(self) -> int:
        """Bytes for each process."""
        return self.memory // self.jobs

    @contextmanager
    def workers(self, data: int) -> Iterator[Engine | None]:
        """The engine with workers that stay until the end, for so many bytes of files."""
        if self.engine is None:
            yield None
            return
        here = isinstance(self.engine, Processes) and data < SMALL_DATA
        patience = BEFORE_WORKERS if here else 0.0
        with Standing(self.engine, self.jobs, patience) as engine:
            yield engine


@dataclass(frozen=True, kw_only=True)
class SideSummary:
    """What is known of a side when its rows are read.

    Parameters
    ----------
    lacking : dict of str to str
        As `PartsSide.lacking`.
    left_out : dict of str to int
        How many rows take no part, by rule.
    named : set of str
        Classes of all rows, if they were asked for.
    taken : int
        Rows that take part.
    """

    lacking: dict[str, str]
    left_out: dict[str, int]
    named: frozenset[str]
    taken: int

    def has_class(self, name: str) -> bool:
        """Whether there are rows of a class that is asked for; blocks do not know of all names."""
        return name in self.named


def evaluate_partitioned(
    paths: tuple[str, str],
    reading: tuple[ReadOptions, ReadOptions],
    request_of: Callable[[tuple[str, ...]], EvaluationRequest],
    means: Means,
    stopwatch: Stopwatch,
    check: Callable[[tuple[SideSummary, SideSummary], tuple[str, str]], None] | None = None,
) -> PartitionedResult:
    """Evaluate two sides block by block and component by component.

    Parameters
    ----------
    paths : pair of str
        Truth and estimate: folders of Parquet or CSV files, or such files.
    reading : pair of ReadOptions
        How to read them.
    request_of : callable
        What is asked, given the names of the state columns.
    means : Means
        Where, and with what.
    stopwatch : Stopwatch
        Gets the time of each stage.
    check : callable, optional
        Of what is known of both sides when their rows are read, and of the paths: raises what is
        wrong with it, before anything is solved.

    Raises
    ------
    TgospaError
        Something is wrong with the data, or asked for that needs them all at once.
    """
    data = sum(found.st_size for path in paths for _, found in stored(path))
    with means.workers(data) as engine:
        return _evaluate(
            paths, reading, request_of, replace(means, engine=engine), stopwatch, check
        )


def _evaluate(
    paths: tuple[str, str],
    reading: tuple[ReadOptions, ReadOptions],
    request_of: Callable[[tuple[str, ...]], EvaluationRequest],
    means: Means,
    stopwatch: Stopwatch,
    check: Callable[[tuple[SideSummary, SideSummary], tuple[str, str]], None] | None,
) -> PartitionedResult:
    run = partial(run_tasks, engine=means.engine)
    with stopwatch.span("read"):
        if means.kept:
            files = [found for path in paths for found in stored(path)]
            changed = changed_file(files, means.work, run)
            if changed is not None:
                stopwatch.notify(f"{changed}: has another content than before: all is begun anew")
        truth, estimate = (
            open_side(
                path,
                options,
                role,
                work=means.work / "sides",
                rows_together=rows_together(means.share),
                run=run,
            )
            for path, options, role in zip(paths, reading, ROLES, strict=True)
        )
        sides = truth, estimate
        clocks = clock_of(truth), clock_of(estimate)
        check_columns(*clocks, paths)
        request = request_of(truth.columns)
        _check_request(request)
        most = rows_together(means.share)
        steps = find_steps(sides, clocks, request, paths, most, means.work, run)

    def checked(blocks: Sequence[Scanned]) -> None:
        if check is not None:
            check((_known(truth, 0, blocks), _known(estimate, 1, blocks)), paths)

    plan = PartsPlan(
        cut=steps.cut,
        times=steps.grid.truth.times,
        request=request,
        names=paths,
        columns=len(truth.columns),
        work=means.work,
        memory=means.share,
        stages=Stages(stopwatch),
        engine=means.engine,
        look=checked,
    )
    looked = look(plan, steps.grid) if len(plan.times) else []
    for notice in looked:
        if not notice.code:
            stopwatch.notify(str(notice))
    found = evaluate_parts(plan, stopwatch)
    with stopwatch.span("report"):
        result = _result(sides, steps, plan, found, means)
        warnings = (*(notice for notice in looked if notice.code), *result.warnings)
        for notice in _said(sides, steps, plan, found):
            stopwatch.notify(str(notice))
    return replace(
        result,
        warnings=warnings,
        timings=nested_timings(stopwatch),
        files={"truth": paths[0], "estimate": paths[1]},
    )


def _known(side: PartsSide, number: int, blocks: Sequence[Scanned]) -> SideSummary:
    read = [block.read[number] for block in blocks]
    return SideSummary(
        lacking=side.lacking,
        left_out=_left_out(side, read),
        named=frozenset(name for block in read for name in block.named),
        taken=sum(one.sums[0] for one in read),
    )


def _check_request(request: EvaluationRequest) -> None:
    """Whether an evaluation in parts has what is asked for.

    Raises
    ------
    ConfigError
        It needs all data at once.
    """
    if type(request.distance).fitted is not Distance.fitted:
        raise ConfigError(
            f"--distance {request.distance.name} takes settings from all data at once, which are "
            "not in memory: evaluate a part, or choose a distance without such settings"
        )
    if not isinstance(request.solver, Certified):
        raise ConfigError(
            f"--solver {request.solver.name} solves what is in memory; data in parts are for the "
            "solver certified"
        )


def _result(
    sides: tuple[PartsSide, PartsSide],
    steps: Found,
    plan: PartsPlan,
    found: Evaluated,
    means: Means,
) -> PartitionedResult:
    """The result, its tables written."""
    request, whole = plan.request, found.whole
    for side, numbered in zip(sides, found.tracks, strict=True):
        if numbered.rows.sum() == side.rows:  # else filters may have left out the other ids
            side.check_ids(numbered.ids)
    parameters, solver = request.parameters, request.solver
    assert isinstance(solver, Certified)
    check_underflow(found.constants, parameters, whole.bounds.upper)
    shown = steps.grid.truth.shown
    truths, estimates = found.tracks
    naming = Naming(times=shown, truths=truths.ids, estimates=estimates.ids, parameters=parameters)
    tables = write_tables(
        str(means.tables),
        naming,
        whole.breakdown,
        (
            TrackSums(rows=truths.rows, parts=whole.tracks[0]),
            TrackSums(rows=estimates.rows, parts=whole.tracks[1]),
        ),
        found.folders,
        partial(run_tasks, engine=means.engine),
        assignments=means.assignments,
    )
    met = whole.bounds.met(solver.gap)
    spent = plan.stages.stopwatch.spans.get("solve/sweeps", 0.0)
    late = solver.time_limit is not None and spent >= solver.time_limit
    record: Json = {
        "name": solver.name,
        "status": str(Status.SOLVED if met else Status.LATE if late else Status.NOT_SOLVED),
        "finished": met,
        "iterations": whole.iterations,
        "kernel": KERNEL,
        "history": [],
    }
    read = [_input(sides[k], k, plan, found) for k in (0, 1)]
    counts = whole.objects[0]
    return PartitionedResult(
        proof=Costs(parameters=parameters, bounds=whole.bounds, breakdown=whole.breakdown),
        labels=Labels(times=shown.tolist(), truths=[], estimates=[], unit=request.unit),
        gap=solver.gap,
        settings={
            **parameters.recorded,
            "distance": request.distance.name,
            **request.distance.settings(sides[0].columns),
            "columns": list(sides[0].columns),
            **request.time_matching.recorded,
            "unit": request.unit,
            **request.recorded,
            **solver_settings(solver),
        },
        solver=record,
        timings={"read": 0, "distances": 0, "solve": {}, "certify": 0, "report": 0, "total": 0},
        input={role: one for role, (one, _) in zip(ROLES, read, strict=True)},
        judged_on=judge(
            steps.axis.horizon,
            steps.grid.truth,
            digest_of_sums(sides[0].columns, [block.judged for block in found.blocks]),
            states=int(counts.sum()),
            at=int(np.count_nonzero(counts)),
        ),
        version=__version__,
        warnings=(
            *(notice for _, notices in read for notice in notices),
            *within_rounding(whole.bounds, solver.gap),
        ),
        sizes={
            "truth": len(truths.ids),
            "estimates": len(estimates.ids),
            "steps": len(plan.times),
            "candidate_pairs": found.shards.pairs,
            "pair_steps": found.entries,
            "components": found.shards.components,
        },
        objects=(int(counts.sum()), int(whole.objects[1].sum())),
        tables=tables,
    )


def _input(
    side: PartsSide, number: int, plan: PartsPlan, found: Evaluated
) -> tuple[Json, list[Notice]]:
    """The record of a side, and what was repaired in it."""
    blocks = [block.read[number] for block in found.blocks]
    info = FileInfo(rows=side.rows, format=side.format, left_out=_left_out(side, blocks))
    digest = digest_of_sums(side.columns, [block.sums for block in blocks])
    warnings = {tuple(one.items()): Notice(**one) for block in blocks for one in block.warnings}
    rule = "grid" if plan.request.time_matching.steps is None else "steps"
    record = info.record(digest, {rule: _off(plan, found, number)})
    return record, [notice.about(plan.names[number]) for notice in warnings.values()]


def _off(plan: PartsPlan, found: Evaluated, number: int) -> int:
    """Rows of a side that are left out because their stamps are no steps."""
    if isinstance(plan.cut, Resampling):
        return 0
    return sum(block.read[number].off for block in found.blocks)


def _left_out(side: PartsSide, blocks: Sequence[Read]) -> dict[str, int]:
    """Rows that take no part, by rule."""
    left_out = dict(side.left_out)
    for block in blocks:
        for rule, count in block.left_out.items():
            left_out[rule] = left_out.get(rule, 0) + count
    return left_out


def _said(
    sides: tuple[PartsSide, PartsSide], steps: Found, plan: PartsPlan, found: Evaluated
) -> Iterator[Notice]:
    """What the user should know of the two sides."""
    for number, side in enumerate(sides):
        blocks = [block.read[number] for block in found.blocks]
        classes = sorted({name for block in blocks for name in block.named}, key=natural)
        for text in side.said(_left_out(side, blocks), classes):
            yield Notice(text=f"{plan.names[number]}: {text}")
    axis, matching = steps.axis, plan.request.time_matching
    made = axis.made
    if isinstance(plan.cut, Resampling):
        made = tuple(
            (name, one.of(old.side))
            for (name, old), one in zip(axis.made, plan.cut.made, strict=True)
        )
        if gaps := plan.cut.made[0].gaps:
            yield Notice(
                text=f"the truth has {counted(gaps, 'gap')} longer than {matching.gaps[0]:.15g}: "
                "what the estimate reports in them is false (its cost is not worked out of data "
                "in parts)"
            )
    off = (_off(plan, found, 0), _off(plan, found, 1))
    if any(off) and matching.steps is None:
        yield Notice(text=alignment_notices(replace(steps.grid, left_out=off), matching)[-1])
    axis = replace(axis, made=made, left_out=off)
    if not any(block.read[number].sums[0] for block in found.blocks for number in (0, 1)):
        check_left(axis, matching)
    yield from axis_notices(axis, matching)
