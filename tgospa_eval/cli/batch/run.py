"""From the options of a batch to its store and tables."""

import functools
import json
import os
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import click
import numpy as np

from tgospa_eval import plots
from tgospa_eval._version import __version__
from tgospa_eval.api.notices import about_defaults
from tgospa_eval.api.request import Request, Values
from tgospa_eval.batches import jobs
from tgospa_eval.batches.curves import rms_curves
from tgospa_eval.batches.jobs import BatchPlan, Job
from tgospa_eval.batches.pairing import labels_of
from tgospa_eval.batches.per_step import STEPS, STORED_CURVE, STORED_STEPS
from tgospa_eval.batches.store import SCHEMA, SETTINGS_FILE, Row, Store, locked
from tgospa_eval.batches.tables import check_labels, tabulated
from tgospa_eval.cli.batch.worker import (
    NOT_WRITTEN,
    OFF_STEPS,
    UNSEEN,
    JobTask,
    digest_of,
    evaluate_job,
    files_of,
    given_text,
    key_of,
    lost_job,
)
from tgospa_eval.cli.shared.options import KNOWN, typed_options
from tgospa_eval.cli.shared.streams import emit, print_notice
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.cli.shared.writing import wanted_pictures, write_output
from tgospa_eval.common.config import SettingsFile, settings_field
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.manifest import read_manifest, unchanged
from tgospa_eval.common.words import counted, parsed_whole
from tgospa_eval.engines.cluster import Cluster
from tgospa_eval.engines.processes import Processes
from tgospa_eval.engines.spread import Engine, spread
from tgospa_eval.errors import ConfigError, ExitStatus
from tgospa_eval.evaluation.request import chosen_metrics
from tgospa_eval.evaluation.slicing import parse_slices
from tgospa_eval.formats import runs_inside
from tgospa_eval.formats.guess import file_of, files_at
from tgospa_eval.formats.options import parse_moments
from tgospa_eval.reports.batch import BATCH_REPORTS, slices_of_groups
from tgospa_eval.reports.batch_records import BatchTables
from tgospa_eval.reports.batch_view import BatchView
from tgospa_eval.reports.curves import BANDS, curves_csv
from tgospa_eval.reports.files import BATCH, Files, csv_text
from tgospa_eval.reports.proofs import folder_name
from tgospa_eval.text import as_unicode, quoted

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.reports.curves import BandKind


REPORT_FOLDER = "reports"


def folder_of(store: str, labels: Mapping[str, str], options: Mapping[str, str]) -> str:
    """Where the result folder of a job is, of labels and options of its own."""
    parts = [folder_name(as_unicode(value)) for value in labels.values()]
    parts += [f"{key}={folder_name(value)}" for key, value in options.items()]
    return os.path.join(store, REPORT_FOLDER, *parts)


def write_batch(store: Store, tables: BatchTables, output: OutputOptions, *, lenient: bool) -> None:
    """Write the files of a batch to the folder of ``-o``.

    Parameters
    ----------
    store : Store
        Has the settings, and the reports of jobs.
    tables : BatchTables
        What is shown.
    output : OutputOptions
        Where to write, and what to print.
    lenient : bool
        Whether files of others there are told and no error: the rows are stored in any case.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    if output.output is None or not len(tables.rows):
        return
    wanted = wanted_pictures(output)
    if wanted is not None and not plots.available():
        wanted = None
        if not output.quiet:
            print_notice(plots.MISSING)
    view = BatchView(
        tables=tables,
        settings=store.settings(),
        link=_link(store, output.output, tables.rows),
    )

    def make(notify: Callable[[str, float], None]) -> Files:
        from tgospa_eval.reports.batch_page import batch_page  # here: only where it is written

        notify("report.html", 0.0)
        files: dict[str, str | bytes] = {"report.html": batch_page(view)}
        if tables.curves:
            files["curve.csv"] = curves_csv(tables.curves)
        if tables.slices:
            files["slices.csv"] = csv_text(slices_of_groups(tables))
        if wanted is None:
            return files
        from tgospa_eval.plots.batch import batch_pictures  # here: it draws

        return files | batch_pictures(view, wanted, notify)

    try:
        write_output(output, BATCH, make)
    except ConfigError as error:
        if not lenient:
            raise
        print_notice(f"the page is not written: {error}")


def is_written(store: Store) -> bool:
    """Whether the folder of a store has its page and pictures."""
    listed = read_manifest(store.folder, BATCH.name) or ()
    return bool(listed) and unchanged(store.folder, listed) == {entry.name for entry in listed}


def _link(store: Store, target: str, rows: "pd.DataFrame") -> "Callable[[pd.Series[Any]], str]":
    """Where the report of a job is, seen from the folder of the page; nothing if there is none."""
    names = [name.removeprefix("label.") for name in rows.columns if name.startswith("label.")]

    def link(row: "pd.Series[Any]") -> str:
        labels = {name: str(row[f"label.{name}"]) for name in names}
        folder = folder_of(str(store.folder), labels, json.loads(str(row["options"])))
        found = Path(folder, "report.html")
        if not found.is_file():
            return ""
        return quote(os.fsencode(Path(os.path.relpath(found, target)).as_posix()))

    return link


# -------------------------------------------------------------------------------------------------
# What there is to do: jobs from the options of a batch, less those that are done.

FAULTS_SHOWN = 10
"""Faults that are shown."""


DECIDING = ("steps", "resample", "grid", "interpolate")
"""Options that say which steps count, in place of what a benchmark declares."""


@dataclass(frozen=True, kw_only=True)
class BatchOptions(Values):
    """What there is to do, and how to spread and tabulate it."""

    truth: str | None = None
    estimate: str | None = None
    layout: str | None = None
    seqmap: str | None = None
    allow_missing: bool = False
    retry_failed: bool = False
    shard: str | None = None
    workers: int | None = None
    scheduler: str | None = None
    reports: bool = False
    proof: bool = False
    per_step: bool = False
    by: tuple[str, ...] = ()
    mean_of_roots: bool = False
    band: "BandKind | None" = None
    max_input: float | None = None

    def groups(self, known: Collection[str]) -> list[str]:
        """The labels of --by, each once; a text that is the name of one is that, commas and all."""
        names = [
            name
            for text in self.by
            if text
            for name in ([text] if text in known else map(str.strip, text.split(",")))
        ]
        return list(dict.fromkeys(names))

    @property
    def engine(self) -> Engine:
        """Where the jobs are done."""
        return Cluster(self.scheduler) if self.scheduler else Processes(self.workers)


def planned(
    paths: tuple[str, ...], batch: BatchOptions, options: Request, output: str | None
) -> BatchPlan:
    """The jobs that the arguments name in one of three ways."""
    if batch.layout:
        if len(paths) != 2:
            raise ConfigError(f"--layout {batch.layout} takes two folders, GT TRACKERS")
        sequences = jobs.read_sequences(batch.seqmap) if batch.seqmap else ()
        plan = jobs.of_layout(batch.layout, *paths, sequences, output)
        if any(name in options.given for name in DECIDING):
            return plan
        plan = jobs.with_frames(plan, batch.layout, paths[0], batch.seqmap)
        return replace(plan, jobs=tuple(_within(job, options.time) for job in plan.jobs))
    if batch.truth and batch.estimate and not paths:
        inside = functools.cache(functools.partial(runs_inside, max_input=batch.max_input))
        return jobs.of_patterns(batch.truth, batch.estimate, output=output, inside=inside)
    if len(paths) == 1 and not (batch.truth or batch.estimate):
        keys = [name.replace("-", "_") for name, flag in KNOWN.items() if not flag]
        return jobs.of_manifest(paths[0], {*keys, *(key.replace("_", "-") for key in keys)})
    raise ConfigError(
        "name the jobs by --truth PATTERN --estimate PATTERN, by a manifest, or by --layout NAME "
        "GT TRACKERS"
    )


def _within(job: Job, time: str | None) -> Job:
    """With those of its frames that are within --time.

    Raises
    ------
    ConfigError
        The range of time is none of frames.
    """
    moments = parse_moments(time)
    if job.frames is None or moments is None:
        return job
    frames = np.arange(job.frames[0], job.frames[1] + 1)
    frames = frames[moments.inside(frames, "number", job.truth)]
    return replace(job, frames=(int(frames[0]), int(frames[-1])) if len(frames) else None)


def check_missing(plan: BatchPlan, batch: BatchOptions) -> None:
    """List what is missing; without --allow-missing nothing is begun.

    Raises
    ------
    ConfigError
        Something is missing, or everything.
    """
    lines = [*plan.faults[:FAULTS_SHOWN]]
    if len(plan.faults) > FAULTS_SHOWN:
        lines.append(f"and {len(plan.faults) - FAULTS_SHOWN} more")
    if plan.faults and not batch.allow_missing:
        some = "; --seqmap FILE takes the sequences in that file alone" if batch.layout else ""
        raise ConfigError(
            *lines, f"nothing is begun; --allow-missing goes on with the others{some}"
        )
    for text in lines:
        print_notice(text)
    if not plan.jobs:
        raise ConfigError("there is no job")


def shard_of(text: str | None) -> tuple[int, int]:
    """Number and count of the shards.

    Raises
    ------
    ConfigError
        It is no K/N.
    """
    first, slash, last = (text or "1/1").partition("/")
    number, count = (parsed_whole(part) or 0 for part in (first, last))
    if not slash or not 1 <= number <= count:
        raise ConfigError(f"--shard {text}: must be K/N with 1 <= K <= N, such as 3/16")
    return number, count


def tasks_of(
    ctx: click.Context,
    plan: BatchPlan,
    options: Request,
    batch: BatchOptions,
    output: OutputOptions,
) -> Iterator[JobTask]:
    """The jobs with their own options and their keys; what they share is there once."""
    shared = replace(options, jobs=1)
    of_all = given_text(shared)
    base = os.getcwd() if batch.scheduler else ""
    digest = functools.cache(digest_of)
    for job in plan.jobs:
        chosen, given = shared, of_all
        if job.options:
            own = typed_options(ctx, dict(job.options), f"job {job.name}")
            chosen = replace(shared, **own)  # type: ignore[arg-type]
            given = given_text(chosen)
        elif job.frames:
            first, last = job.frames
            chosen = replace(shared, steps=f"{first}:{last}")
            given = given_text(chosen)
        folder = None
        if batch.reports:
            folder = folder_of(str(output.output), job.labels, job.options)
        yield JobTask(
            job=job,
            options=chosen,
            key=key_of(job, given, files_of(job, chosen), digest),
            folder=folder,
            proof=batch.proof,
            per_step=batch.per_step,
            base=base,
            store=os.path.join(str(output.output), SETTINGS_FILE),
            settings_file=output.config,
        )


def left_over(
    tasks: list[JobTask], before: "pd.DataFrame", *, retry_failed: bool
) -> Iterator[JobTask]:
    """What is not done, and what lacks something that is asked for beside its row."""
    numbers = ["sizes.steps", STORED_STEPS, STORED_CURVE]
    found = before.reindex(columns=["key", "status", NOT_WRITTEN, *numbers])
    found[numbers] = found[numbers].astype(float).fillna(0.0)
    found[NOT_WRITTEN] = found[NOT_WRITTEN].notna()
    rows = {row["key"]: row for row in found.to_dict("records")}
    for task in tasks:
        row = rows.get(task.key)
        if row is None or (retry_failed and row["status"] == "failed"):
            yield task
        elif row["status"] != "failed":
            written = task.folder is None or (task.is_written and not row[NOT_WRITTEN])
            if not (written and task.has_steps(row)):
                yield task.keeping(row)


def size_of(task: JobTask) -> int:
    """Bytes of both files: the largest jobs come first, so that none is left at the end alone."""
    paths = (file_of(path) for path in (task.job.truth, task.job.estimate))
    return sum(os.path.getsize(file) for path in paths for file in files_at(path))


FLUSH = 2.0
"""Seconds after which rows are written: so much work a killed process loses at most."""

MOST_HELD = 200_000
"""Steps that are kept in memory until they are written, about 30 MB."""


@dataclass(frozen=True, kw_only=True)
class Worked:
    """What came of the jobs.

    Parameters
    ----------
    store : Store
        Where it is stored.
    rows : DataFrame
        Of all jobs that were asked for, also of those that were done before.
    faults : sequence of Row
        Those of this run that failed.
    new : bool
        Whether there was something to do.
    tables : BatchTables
        Sums and order.
    """

    store: Store
    rows: "pd.DataFrame"
    faults: Sequence[Row]
    new: bool
    tables: BatchTables


def run_batch(
    ctx: click.Context,
    paths: tuple[str, ...],
    batch: BatchOptions,
    options: Request,
    output: OutputOptions,
) -> int:
    """Do what is not done yet, and print the table; the exit status.

    Raises
    ------
    TgospaError
        Something is wrong with options, the manifest or the store; no job is begun then.
    """
    worked = work_batch(ctx, paths, batch, options, output)
    emit(BATCH_REPORTS[output.format_](worked.tables), output.format_)
    told, status = finish_batch(worked, batch, output)
    for text in told:
        print_notice(text)
    return status


def work_batch(
    ctx: click.Context,
    paths: tuple[str, ...],
    batch: BatchOptions,
    options: Request,
    output: OutputOptions,
) -> Worked:
    """Do what is not done yet.

    Raises
    ------
    TgospaError
        Something is wrong with options, the manifest or the store; no job is begun then.
    """
    if batch.proof and not batch.reports:
        raise ConfigError("--proof is for the folders of --reports")
    if options.curve and not (batch.per_step or batch.reports):
        raise ConfigError("--curve is for --per-step, or for the folders of --reports")
    if batch.band not in (None, *BANDS):
        raise ConfigError(f"--band {quoted(batch.band)}: must be one of {', '.join(BANDS)}")
    parse_slices(options.slices)
    if batch.scheduler and batch.workers:
        raise ConfigError("--scheduler has the workers that it has: --workers is for processes")
    plan = planned(paths, batch, options, output.output)
    for text in () if output.quiet else plan.notices:
        print_notice(text)
    check_missing(plan, batch)
    labels = list(dict.fromkeys(name for job in plan.jobs for name in job.labels))
    check_labels(batch.groups(labels), labels)
    store, shard = Store(str(output.output)), shard_of(batch.shard)
    settings = {
        "schema": SCHEMA,
        "version": __version__,
        "options": {name: _plain(value) for name, value in options.given.items()},
        **({"with": list(chosen_metrics(options.with_))} if options.with_ else {}),
        **({"slices": list(options.slices)} if options.slices else {}),
        "jobs": {"paths": list(paths), "truth": batch.truth, "estimate": batch.estimate,
                 "layout": batch.layout, "seqmap": batch.seqmap},
        **settings_field(output.config),
    }  # fmt: skip
    store.open(settings)
    if not output.quiet:
        for text in about_defaults(options, boxes=batch.layout is not None):
            print_notice(text)
    with locked(store.folder, shard):
        tasks = list(tasks_of(ctx, plan, options, batch, output))
        tasks = [task for number, task in enumerate(tasks) if number % shard[1] == shard[0] - 1]
        if shard == (1, 1):
            store.join()
        rows = store.rows()
        left = list(left_over(tasks, rows, retry_failed=batch.retry_failed))
        left.sort(key=size_of, reverse=True)
        if not output.quiet and len(left) < len(tasks):
            print_notice(f"{counted(len(tasks) - len(left), 'job')} of {len(tasks)} done before")
        faults = _work(left, store, batch.engine, quiet=output.quiet)
    rows = store.rows() if left else rows
    wanted = {task.key for task in tasks}
    rows = rows[rows["key"].isin(wanted)] if len(rows) else rows
    tables = _tables(store, rows, batch)
    return Worked(store=store, rows=rows, faults=faults, new=bool(left), tables=tables)


NUMBERS_OF_STATES = ("sizes.truth_states", "sizes.estimate_states")
"""Columns that are 0 in an evaluation of nothing."""


def finish_batch(
    worked: Worked, batch: BatchOptions, output: OutputOptions
) -> tuple[list[str], int]:
    """Write the page and the curves; what is wrong with jobs, and the exit status."""
    rows = worked.rows
    # Of shards more is to come; where nothing is new, the page is there.
    whole = shard_of(batch.shard) == (1, 1)
    if whole and (worked.new or batch.by or batch.band or not is_written(worked.store)):
        write_batch(worked.store, worked.tables, output, lenient=True)
    told = list(_faults(rows, worked.faults, written=batch.reports))
    done = rows[rows["status"] != "failed"] if len(rows) else rows
    for text in () if output.quiet else _left_out(done):
        print_notice(text)
    nothing = int((done[list(NUMBERS_OF_STATES)] == 0).all(axis=1).sum()) if len(done) else 0
    if nothing == len(done) and nothing:
        told.append(f"no row is left to evaluate in any of {counted(nothing, 'job')}")
    if told:
        return told, 5
    if nothing and not output.quiet:
        print_notice(
            f"no row is left to evaluate in {nothing} of {counted(len(done), 'job')}: a total of 0"
        )
    opened = len(rows) and (rows["status"] == "open").any()
    return told, ExitStatus.NOT_REACHED if opened else ExitStatus.DONE


def _left_out(done: "pd.DataFrame") -> Iterator[str]:
    """How many rows are at none of the steps that were declared, if any are."""
    counts = done.reindex(columns=list(OFF_STEPS.values())).fillna(0).astype(int)
    some = done[(counts > 0).any(axis=1)].to_dict("records")
    if some:
        of_truth, of_estimate = counts.sum()
        others = f" and {counted(len(some) - 1, 'more job')}" if len(some) > 1 else ""
        yield (
            f"{_name(some[0])}{others}: {counted(of_truth, 'row')} of the truth and "
            f"{of_estimate:,} of the estimate at other times than the declared steps are left out"
        )


def _faults(rows: "pd.DataFrame", faults: Sequence[Row], *, written: bool) -> Iterator[str]:
    """What is wrong, a line for each job: no value, or what was asked for beside it is not there.

    Parameters
    ----------
    rows : DataFrame
        What is stored of the jobs.
    faults : sequence of Row
        Those of this run that failed: a row that was done before stays so.
    written : bool
        Whether folders were asked for.
    """
    if not len(rows):
        return
    wrong: Sequence[Mapping[Any, Any]] = rows[rows["status"] == "failed"].to_dict("records")
    known = {row["key"] for row in wrong}
    for row in (*wrong, *(row for row in faults if row["key"] not in known)):
        yield f"{_name(row)}: {row['message']}"
    if written and NOT_WRITTEN in rows:
        for row in rows[rows[NOT_WRITTEN].notna()].to_dict("records"):
            yield f"{_name(row)}: {row[NOT_WRITTEN]}"


def report_batch(folder: str, batch: BatchOptions, output: OutputOptions) -> None:
    """Print the table of what is stored, and write its files to the folder of -o.

    Raises
    ------
    InputError
        The folder holds no batch.
    ConfigError
        The files cannot be written.
    """
    store = Store(folder)
    store.settings()
    tables = _tables(store, store.rows(), batch)
    emit(BATCH_REPORTS[output.format_](tables), output.format_)
    write_batch(store, tables, output, lenient=False)


def _work(tasks: list[JobTask], store: Store, engine: Engine, *, quiet: bool) -> list[Row]:
    """Do the jobs, and store their rows every now and then, also when interrupted.

    Returns
    -------
    list of Row
        Those that failed.

    Raises
    ------
    ConfigError
        A worker does not see a file that is there.
    """
    pending: list[Row] = []
    faults: list[Row] = []
    begin = flushed = shown = time.monotonic()
    held = 0
    rows = spread(evaluate_job, tasks, lost_job, engine)
    try:
        for done, row in enumerate(rows, 1):
            if os.path.exists(row.pop(UNSEEN, "")):
                raise ConfigError(
                    f"--scheduler: {row['message']}: workers read and write files by themselves, "
                    "under the same paths on a file system that all share; what is stored stays, "
                    "and the same command goes on from there"
                )
            pending.append(row)
            if row["status"] == "failed":
                faults.append(row)
            held += len(row.get(STEPS) or ())
            now = time.monotonic()
            if now - flushed > FLUSH or held > MOST_HELD:
                store.add(pending)
                pending, flushed, held = [], now, 0
            if not quiet and now - shown > FLUSH:
                shown = now
                print_notice(_progress(done, len(tasks), len(faults), now - begin))
    finally:
        rows.close()  # nothing is worked on when nobody takes its answer
        store.add(pending)
    return faults


def _progress(done: int, count: int, failed: int, seconds: float) -> str:
    rate = done / seconds
    return (
        f"{done} of {count} jobs, {failed} failed, {rate:.3g} a second, "
        f"{(count - done) / rate:.0f} s left"
    )


def _tables(store: Store, rows: "pd.DataFrame", batch: BatchOptions) -> BatchTables:
    """Of the labels of --by, or the first; with the curves of what is stored."""
    asked = batch.groups(labels_of(rows))
    by = asked or labels_of(rows)[:1]
    tables = tabulated(rows, by, roots=batch.mean_of_roots)
    steps = store.steps(rows)
    curves, told = rms_curves(rows, steps, by, batch.band or "interval")
    if batch.band and steps is None:
        told.append("--band is for curves: no steps are stored; --per-step stores them")
    # Without --by nobody asked what there is to compare.
    used = store.settings().get("settings_file")
    notes = (
        *(tables.notes if asked else ()),
        *told,
        *([str(SettingsFile(**used))] if used else ()),
    )
    return replace(tables, curves=tuple(curves), notes=notes)


def _name(row: Mapping[Any, Any]) -> str:
    """A job in words: labels, and options of its own."""
    labels = [str(value) for name, value in row.items() if str(name).startswith("label.")]
    own = [f"{key}={value}" for key, value in json.loads(row["options"]).items()]
    return " ".join(("/".join(labels) or str(row["estimate"]), *own))


def _plain(value: Any) -> Any:
    """As JSON gives it back."""
    return list(value) if isinstance(value, tuple) else value
