"""From the options of a batch to its store and tables."""

import functools
import json
import os
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from tgospa_eval._version import __version__
from tgospa_eval.batch import jobs
from tgospa_eval.batch.cluster import Cluster
from tgospa_eval.batch.curves import rms_curves
from tgospa_eval.batch.engine import Engine, spread
from tgospa_eval.batch.jobs import Plan
from tgospa_eval.batch.lock import locked
from tgospa_eval.batch.pairing import labels_of
from tgospa_eval.batch.per_step import STEPS, STORED_CURVE, STORED_STEPS
from tgospa_eval.batch.processes import Processes
from tgospa_eval.batch.store import SCHEMA, SETTINGS_FILE, Row, Store
from tgospa_eval.batch.tables import check_labels, tabulated
from tgospa_eval.cli.batch.files import folder_of, is_written, write_batch
from tgospa_eval.cli.batch.worker import (
    NOT_WRITTEN,
    UNSEEN,
    Task,
    digest_of,
    evaluate_job,
    files_of,
    given_text,
    key_of,
    lost_job,
)
from tgospa_eval.cli.shared.options import KNOWN
from tgospa_eval.cli.shared.streams import emit, print_notice
from tgospa_eval.cli.shared.typed import typed_options
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions, Values
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.errors import ConfigError, ExitStatus
from tgospa_eval.evaluation.request import chosen_metrics
from tgospa_eval.reports.batch import BATCH_REPORTS
from tgospa_eval.reports.batch_records import BatchTables

if TYPE_CHECKING:
    import pandas as pd

FLUSH = 2.0
"""Seconds after which rows are written: so much work a killed process loses at most."""

MOST_HELD = 200_000
"""Steps that are kept in memory until they are written, about 30 MB."""

FAULTS_SHOWN = 10
"""Faults that are shown."""


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


def run_batch(
    ctx: click.Context,
    paths: tuple[str, ...],
    batch: BatchOptions,
    options: EvaluationOptions,
    output: OutputOptions,
) -> int:
    """Do what is not done yet, and print the table; the exit status.

    Raises
    ------
    TgospaError
        Something is wrong with options, the manifest or the store; no job is begun then.
    """
    if batch.proof and not batch.reports:
        raise ConfigError("--proof is for the folders of --reports")
    if options.curve and not (batch.per_step or batch.reports):
        raise ConfigError("--curve is for --per-step, or for the folders of --reports")
    if batch.scheduler and batch.workers:
        raise ConfigError("--scheduler has the workers that it has: --workers is for processes")
    plan = _plan(paths, batch)
    _check_missing(plan, batch)
    labels = list(dict.fromkeys(name for job in plan.jobs for name in job.labels))
    check_labels(batch.groups(labels), labels)
    store, shard = Store(str(output.output)), _shard(batch.shard)
    settings = {
        "schema": SCHEMA,
        "version": __version__,
        "options": {name: _plain(value) for name, value in options.given.items()},
        **({"with": list(chosen_metrics(options.with_))} if options.with_ else {}),
        "jobs": {"paths": list(paths), "truth": batch.truth, "estimate": batch.estimate,
                 "layout": batch.layout, "seqmap": batch.seqmap},
    }  # fmt: skip
    store.open(settings)
    if not output.quiet:
        for text in _about_defaults(options, boxes=batch.layout is not None):
            print_notice(text)
    with locked(store.folder, shard):
        tasks = list(_tasks(ctx, plan, options, batch, output))
        tasks = [task for number, task in enumerate(tasks) if number % shard[1] == shard[0] - 1]
        if shard == (1, 1):
            store.join()
        rows = store.rows()
        left = list(_left(tasks, rows, retry_failed=batch.retry_failed))
        left.sort(key=_size, reverse=True)
        if not output.quiet and len(left) < len(tasks):
            print_notice(f"{counted(len(tasks) - len(left), 'job')} of {len(tasks)} done before")
        faults = _work(left, store, batch.engine, quiet=output.quiet)
    rows = store.rows() if left else rows
    wanted = {task.key for task in tasks}
    rows = rows[rows["key"].isin(wanted)] if len(rows) else rows
    tables = _tables(store, rows, batch)
    emit(BATCH_REPORTS[output.format_](tables), output.format_)
    # Of shards more is to come; where nothing is new, the page is there.
    if shard == (1, 1) and (left or batch.by or not is_written(store)):
        write_batch(store, tables, output, lenient=True)
    told = list(_faults(rows, faults, written=batch.reports))
    for text in told:
        print_notice(text)
    if told:
        return 5
    opened = len(rows) and (rows["status"] == "open").any()
    return ExitStatus.NOT_REACHED if opened else ExitStatus.DONE


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


def _plan(paths: tuple[str, ...], batch: BatchOptions) -> Plan:
    """The jobs that the arguments name in one of three ways."""
    if batch.layout:
        if len(paths) != 2:
            raise ConfigError(f"--layout {batch.layout} takes two folders, GT TRACKERS")
        sequences = jobs.read_sequences(batch.seqmap) if batch.seqmap else ()
        return jobs.of_layout(batch.layout, *paths, sequences)
    if batch.truth and batch.estimate and not paths:
        return jobs.of_patterns(batch.truth, batch.estimate)
    if len(paths) == 1 and not (batch.truth or batch.estimate):
        keys = [name.replace("-", "_") for name, flag in KNOWN.items() if not flag]
        return jobs.of_manifest(paths[0], {*keys, *(key.replace("_", "-") for key in keys)})
    raise ConfigError(
        "name the jobs by --truth PATTERN --estimate PATTERN, by a manifest, or by --layout NAME "
        "GT TRACKERS"
    )


def _check_missing(plan: Plan, batch: BatchOptions) -> None:
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


def _about_defaults(options: EvaluationOptions, *, boxes: bool) -> Iterator[str]:
    """What nobody chose, once for all jobs, in the words that a single evaluation has for it."""
    from tgospa_eval.distances import DISTANCES  # here: the command line does without

    if boxes and options.distance == "euclidean" and not options.columns:
        yield "boxes are compared by their centres (x, y); overlap: --distance iou"
    given = {"cutoff": options.cutoff, "switch-penalty": options.switch_penalty}
    values = zip(given, DISTANCES[options.distance].defaults, strict=True)
    used = {name: value for name, value in values if given[name] is None}
    if used:
        shown = " and ".join(
            f"{letter} = {used[name]:g}"
            for name, letter in (("cutoff", "c"), ("switch-penalty", "gamma"))
            if name in used
        )
        yield f"default {shown}; choose with {' and '.join(f'--{name}' for name in used)}"


def _shard(text: str | None) -> tuple[int, int]:
    """Number and count of the shards.

    Raises
    ------
    ConfigError
        It is no K/N.
    """
    try:
        number, count = map(int, (text or "1/1").split("/"))
    except ValueError:
        number = count = 0
    if not 1 <= number <= count:
        raise ConfigError(f"--shard {text}: must be K/N with 1 <= K <= N, such as 3/16")
    return number, count


def _tasks(
    ctx: click.Context,
    plan: Plan,
    options: EvaluationOptions,
    batch: BatchOptions,
    output: OutputOptions,
) -> Iterator[Task]:
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
        folder = None
        if batch.reports:
            folder = folder_of(str(output.output), job.labels, job.options)
        yield Task(
            job=job,
            options=chosen,
            key=key_of(job, given, files_of(job, chosen), digest),
            folder=folder,
            proof=batch.proof,
            per_step=batch.per_step,
            base=base,
            store=os.path.join(str(output.output), SETTINGS_FILE),
        )


def _left(tasks: list[Task], before: "pd.DataFrame", *, retry_failed: bool) -> Iterator[Task]:
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


def _size(task: Task) -> int:
    """Bytes of both files: the largest jobs come first, so that none is left at the end alone."""
    return sum(os.path.getsize(path) for path in (task.job.truth, task.job.estimate))


def _work(tasks: list[Task], store: Store, engine: Engine, *, quiet: bool) -> list[Row]:
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
    tables = replace(tables, curves=tuple(rms_curves(rows, store.steps(rows), by)))
    # Without --by nobody asked what there is to compare.
    return tables if asked else replace(tables, notes=())


def _name(row: Mapping[Any, Any]) -> str:
    """A job in words: labels, and options of its own."""
    labels = [str(value) for name, value in row.items() if str(name).startswith("label.")]
    own = [f"{key}={value}" for key, value in json.loads(row["options"]).items()]
    return " ".join(("/".join(labels) or str(row["estimate"]), *own))


def _plain(value: Any) -> Any:
    """As JSON gives it back."""
    return list(value) if isinstance(value, tuple) else value
