"""From the options of a batch to its store and tables."""

import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from tgospa_eval._version import __version__
from tgospa_eval.batches.curves import rms_curves
from tgospa_eval.batches.lock import locked
from tgospa_eval.batches.pairing import labels_of
from tgospa_eval.batches.per_step import STEPS
from tgospa_eval.batches.store import SCHEMA, Row, Store
from tgospa_eval.batches.tables import check_labels, tabulated
from tgospa_eval.cli.batch.files import is_written, write_batch
from tgospa_eval.cli.batch.plan import (
    BatchOptions,
    check_missing,
    left_over,
    planned,
    shard_of,
    size_of,
    tasks_of,
)
from tgospa_eval.cli.batch.worker import (
    NOT_WRITTEN,
    OFF_STEPS,
    UNSEEN,
    Task,
    evaluate_job,
    lost_job,
)
from tgospa_eval.cli.shared.notices import about_defaults
from tgospa_eval.cli.shared.streams import emit, print_notice
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions
from tgospa_eval.common.config import SettingsFile, settings_field
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.engines.spread import Engine, spread
from tgospa_eval.errors import ConfigError, ExitStatus
from tgospa_eval.evaluation.request import chosen_metrics
from tgospa_eval.evaluation.slicing import parse_slices
from tgospa_eval.reports.batch import BATCH_REPORTS
from tgospa_eval.reports.batch_records import BatchTables
from tgospa_eval.reports.curves import BANDS
from tgospa_eval.text import quoted

if TYPE_CHECKING:
    import pandas as pd

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
    options: EvaluationOptions,
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
    options: EvaluationOptions,
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
