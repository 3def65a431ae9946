"""``batch``: evaluates many pairs of truth and estimate, stores the results and tabulates them."""

import functools
import json
import os
import tempfile
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.api import batch_row
from tgospa_eval.api.keywords import each, with_options
from tgospa_eval.api.notices import about_defaults
from tgospa_eval.api.options import FLAGS, OF_EVALUATE, OPTION_SPECS, BatchOptions, Request, typed
from tgospa_eval.api.report import StudyReport, as_frame
from tgospa_eval.campaign import pairs
from tgospa_eval.campaign.pairs import BatchPlan, Job
from tgospa_eval.campaign.row import LABEL, OFF_STEPS, Row, job_in_words, label_names
from tgospa_eval.campaign.store import (
    REST,
    SCHEMA,
    SETTINGS_FILE,
    STORED_CURVE,
    STORED_STEPS,
    Store,
    locked,
)
from tgospa_eval.campaign.sums import check_labels, data_messages, rms_curves, tabulated
from tgospa_eval.common import patterns
from tgospa_eval.common.config import SettingsFile, settings_field
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, warn_user
from tgospa_eval.common.words import counted, parsed_whole
from tgospa_eval.common.writing import read_manifest, unchanged
from tgospa_eval.engines import Engine, engine_of, spread
from tgospa_eval.errors import ConfigError, ExitStatus, InputError
from tgospa_eval.evaluation.request import chosen_metrics
from tgospa_eval.evaluation.slicing import parse_slices
from tgospa_eval.formats import ROLES, runs_inside
from tgospa_eval.formats.guess import file_of, files_at
from tgospa_eval.formats.objects import is_path
from tgospa_eval.formats.options import parse_time_range
from tgospa_eval.quoting import as_unicode, listed, option, quoted
from tgospa_eval.results.records import Json, frame_records
from tgospa_eval.show.batch import BatchTables, batch_report, curves_columns, slices_of_groups
from tgospa_eval.show.files import BATCH, Files, folder_name, write_texts
from tgospa_eval.show.study_table import checked_columns
from tgospa_eval.show.table_text import csv_text

if TYPE_CHECKING:
    from typing import Unpack

    import pandas as pd
    from matplotlib.figure import Figure

    from tgospa_eval.api.option_types import BatchEvaluationOptions
    from tgospa_eval.api.report import Drawing
    from tgospa_eval.formats.objects import Components, Runs
    from tgospa_eval.show.batch import BandKind
    from tgospa_eval.show.chart_list import Pictures

IN_MEMORY = "in memory"
"""Text that a store keeps in place of a path, if the data were in memory."""

REPORT_FOLDER = "reports"

FAULTS_SHOWN = 10
"""Largest number of shown messages about missing or wrong files."""

DECIDING = ("steps", "resample", "grid", "interpolate")
"""Options that choose the evaluated steps. If one of them is given, the steps that a benchmark
declares are not used."""

FLUSH, SHARE = 2.0, 0.01
"""Time between two writes of rows to the store: `FLUSH` seconds, or the share `SHARE` of the time
since the start if this is longer. A killed process loses the rows since the last write."""

MAX_PENDING_STEPS = 200_000
"""Largest number of steps that are kept in memory (about 30 MB) before they are written."""

NUMBERS_OF_STATES = ("sizes.truth_states", "sizes.estimate_states")
"""Columns with the numbers of states; both are 0 if there was nothing to evaluate."""

OF_ONE = ("by", "jobs", *OF_EVALUATE)
"""Options of a single evaluation that `batch` lacks or has in another form."""

Notify = Callable[[str], object]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Batch(StudyReport):
    """Result of `batch`; ``print`` shows the table of ``tgospa-eval batch``.

    Parameters
    ----------
    tables : BatchTables
        Rows of jobs, sums of groups, and the ranking of the groups.
    faults : tuple of str
        Errors of jobs, one line each.
    store : Store
        The store with the rows of jobs.
    page : bool
        Whether the HTML page must be written: jobs are new, an option changes the page, or there is
        no unchanged page. A shard writes no page.
    notices : tuple of str
        Further messages for the user.
    status : int
        Exit status of the command.
    """

    tables: BatchTables
    faults: tuple[str, ...]
    store: Store
    page: bool
    notices: tuple[str, ...]
    status: int

    @property
    def rows(self) -> "pd.DataFrame":
        """A row for each job, with its labels, value, bounds and parts."""
        return self.tables.rows

    @property
    def warnings(self) -> tuple[str, ...]:
        """A line for each kind of warning about the data, and each warning about the ranking."""
        return tuple(text for text in self.notices if text.startswith("warning: "))

    @property
    def groups(self) -> "pd.DataFrame":
        """A row for each group, with the sums of its costs."""
        return self.tables.groups

    def __str__(self) -> str:
        return self.rendered("table").rstrip("\n")

    __repr__ = __str__

    @property
    def comparisons(self) -> "pd.DataFrame":
        """A row for each pair of trackers: which is proven better, and a test of the difference."""
        import pandas as pd  # lazy: slow to import

        rankings = self.tables.rankings
        return pd.DataFrame(
            {**one.parameters, **pair} for one in rankings for pair in one.comparisons
        )

    @property
    def curves(self) -> "pd.DataFrame":
        """A row for each group, kind of curve and time, as in ``curve.csv``.

        The table is empty if the store has no steps; `per_step` stores them.
        """
        return as_frame(curves_columns(self.tables.curves))

    @property
    def plot_data(self) -> BatchTables:
        """Data of the pictures."""
        return self.tables

    @property
    def kind(self) -> str:
        """``"batch"``."""
        return "batch"

    def table(self) -> "pd.DataFrame":
        """Return a row for each group: the table `groups`."""
        return self.groups

    def rendered(self, format: str, columns: Iterable[str] = ()) -> str:
        """Return the report in a format that ``--format`` accepts, with these columns."""
        return batch_report(replace(self.tables, columns=checked_columns(columns)), format)

    def plot_parts(self, **options: "Unpack[Drawing]") -> "Figure":
        """Plot the cost per step of each group, stacked by its parts."""
        return self._plot("parts", **options)

    def plot_heat(self, **options: "Unpack[Drawing]") -> "Figure":
        """Plot the value per step of each job as a coloured cell in a grid of two labels."""
        return self._plot("heat", **options)

    def plot_curve(self, **options: "Unpack[Drawing]") -> "Figure":
        """Plot a curve with a band for each group: RMS-TGOSPA over time."""
        return self._plot("curve", **options)

    def plot_curve_parts(self, **options: "Unpack[Drawing]") -> "Figure":
        """Plot the parts of RMS-TGOSPA over time, such as localisation and missed targets."""
        return self._plot("curve-parts", **options)

    def plot_over_time(self, **options: "Unpack[Drawing]") -> "Figure":
        """Plot RMS-TGOSPA, its parts, GOSPA, cardinality, detection rate and NEES over time."""
        return self._plot("over-time", **options)


@with_options(*OF_ONE)
def batch(
    *paths: "Runs | Mapping[str, Any]",
    output: "str | os.PathLike[str] | None" = None,
    truth: "Runs | None" = None,
    estimate: "Runs | Mapping[str, Any] | None" = None,
    mapping: "Components | None" = None,
    layout: str | None = None,
    seqmap: "str | os.PathLike[str] | None" = None,
    by: str | Iterable[str] = (),
    workers: int | None = None,
    scheduler: str | None = None,
    allow_missing: bool = False,
    retry_failed: bool = False,
    reports: bool = False,
    proof: bool = False,
    per_step: bool = False,
    curve: bool = False,
    with_: str | Iterable[str] = (),
    slices: str | Iterable[str] = (),
    mean_of_roots: bool = False,
    band: "BandKind | None" = None,
    over: str | None = None,
    force: bool = False,
    **options: "Unpack[BatchEvaluationOptions]",
) -> Batch:
    """Evaluate many pairs of truth and estimate, as ``tgospa-eval batch`` does.

    Jobs that are stored in `output` are not evaluated again.

    Parameters
    ----------
    *paths : str or path
        The path of a manifest. With `layout`: the folder of the truth, and the folder of the
        trackers. For data in memory: the truth, and the estimate.
    output : str or path, optional
        Folder of the store. Without it, rows are only returned.
    truth, estimate : str, or data in memory, optional
        Patterns with fields, such as ``"gt/{run}.csv"``, or data in memory. They are given instead
        of `paths`. The data of several runs are one of the following:

        - a list with the data of each run, as for `evaluate`
        - an array (runs, T, k, d) with T steps, k trajectories and d state columns
        - a pair of times and such an array
        - a table with a column ``run``

        For the truth, the data of a single run are also accepted; they are then the truth of all
        runs. For the estimate, a mapping from the name of a tracker to its runs is also accepted.
        Jobs of data in memory have the labels ``tracker`` and ``run``.
    mapping : sequence of int, or pair of such, optional
        Indices of the state components to compare, for data in memory, as in `evaluate`.
    layout : {"motchallenge", "kitti"}, optional
        Layout of the folders of the truth and of the trackers.
    seqmap : str or path, optional
        File that lists the sequences to evaluate; needs `layout`.
    by : str or iterable of str
        Labels that define the groups; by default the first label. The rows of a group are added up.
    workers : int, optional
        Number of processes; by default the number of cores.
    scheduler : str, optional
        Address of a Dask cluster that evaluates the jobs instead of local processes.
    allow_missing, retry_failed, reports, proof, per_step, curve, mean_of_roots, force : bool
        Options of ``tgospa-eval batch`` with the same names.
    band : {"interval", "bootstrap", "percentiles", "deviation"}, optional
        Kind of the bands around the curves over time. These curves need `per_step`.
    over : {"start", "stamps"}, optional
        Time axis of the curves: time since the start of each run, or timestamps.
    with_, slices : str or iterable of str
        Other metrics and slices, as in `evaluate`.

    Options of evaluations must be texts or numbers, because the store keeps them. Objects such as
    distances, matrices and tables are refused.

    Returns
    -------
    Batch
        The rows of the jobs and the sums of the groups, as the DataFrames `Batch.rows` and
        `Batch.groups`.

    Warns
    -----
    TgospaWarning
        Data look wrong; files are missing although `allow_missing` is true; or the HTML page cannot
        be written.

    Raises
    ------
    ConfigError, InputError
        - Before any job is started: an option or the manifest is wrong, or files are missing.
        - During the jobs: a worker of `scheduler` does not see a file.
        - After the jobs: all of them failed. Only data in memory raise this error.
    """
    given = dict(locals())  # in the first line, so that these are only the parameters
    chosen = {OPTION_SPECS[name].key: value for name, value in options.items() if value is not None}
    evaluation = {
        **typed(chosen, "batch"),
        "summed": True,
        "curve": curve,
        "with_": ",".join(each(with_)) or None,
        "slices": each(slices),
    }
    messages, plan = list[str](), None
    sides: tuple[Any, Any] = (truth, estimate)
    if truth is None and estimate is None and len(paths) == 2 and not all(map(is_path, paths)):
        sides, paths = (paths[0], paths[1]), ()
    if not all(side is None or is_path(side) for side in sides):
        if paths or layout or any(side is None for side in sides):
            raise ConfigError("data in memory: give truth and estimate, and nothing else")
        plan = pairs.of_memory(*sides, mapping)
    elif mapping is not None:
        raise ConfigError(f"{option('mapping')} is for tracks and arrays in memory")
    if output is None and reports:
        raise ConfigError(
            f"{option('reports')} needs {option('output')}, the folder to write them to"
        )
    given |= {
        **{
            role: os.fspath(side) if is_path(side) else None if side is None else IN_MEMORY
            for role, side in zip(ROLES, sides, strict=True)
        },
        "evaluation": Request.of(evaluation),
        "seqmap": None if seqmap is None else os.fspath(seqmap),
        "by": each(by),
        "quiet": True,
    }
    names = tuple(os.fspath(path) for path in paths if is_path(path))
    with (
        tempfile.TemporaryDirectory()
        if output is None
        else nullcontext(os.fspath(output)) as target
    ):
        options_ = BatchOptions.of({**given, "output": target})
        done = evaluate_batch(names, options_, messages.append, plan)
    if plan and (done.rows["status"] == "failed").all():
        raise InputError(*dict.fromkeys(done.rows["message"]))
    if done.page and output is not None:
        try:
            write_texts(batch_files(done.store, done.tables, target), target, BATCH, force=force)
        except ConfigError as error:  # the batch did not fail: all rows are stored
            messages.append(f"the page was not written: {error}")
    messages += (text.removeprefix("warning: ") for text in done.warnings)
    warn_user([Notice(text=text) for text in messages])
    return done


# -------------------------------------------------------------------------------------------------
# The jobs that the options of a batch name, and the evaluation of those that are not done yet.


def grouped(by: Sequence[str], known: Collection[str]) -> list[str]:
    """Return the labels that ``--by`` names, each once.

    A text with commas names several labels. Only if the whole text is one of the `known` labels, it
    names this label.
    """
    names = [
        name
        for text in by
        if text
        for name in ([text] if text in known else map(str.strip, text.split(",")))
    ]
    return list(dict.fromkeys(names))


def evaluate_batch(
    paths: tuple[str, ...], batch: BatchOptions, notify: Notify, plan: BatchPlan | None = None
) -> Batch:
    """Evaluate the jobs that are not stored yet, and return the result of all jobs.

    The jobs are those of `plan`, or by default those that `paths` and the options name.

    Raises
    ------
    TgospaError
        - Before any job is started: an option, the manifest or the store is wrong.
        - During the jobs: a worker does not see a file that this machine sees.
    """
    options, tell = batch.evaluation, (lambda _: None) if batch.quiet else notify
    _check_options(batch)
    plan = planned(paths, batch) if plan is None else plan
    for text in plan.notices:
        tell(text)
    _check_missing(plan, batch, notify)
    labels = list(dict.fromkeys(name for job in plan.jobs for name in job.labels))
    check_labels(grouped(batch.by, labels), labels)
    store, (number, count) = Store(batch.output), shard_of(batch.shard)
    store.open(_record(paths, batch))
    if not batch.quiet:
        for text in about_defaults(options, boxes=batch.layout is not None):
            notify(text)
    with locked(store.folder, (number, count)):
        tasks = list(tasks_of(plan, batch))
        store.expect(task.key for task in tasks)
        tasks = tasks[number - 1 :: count]
        rows = store.rows()
        left = list(_left_over(tasks, rows, retry_failed=batch.retry_failed))
        left.sort(key=_size, reverse=True)
        if len(left) < len(tasks):
            tell(f"{counted(len(tasks) - len(left), 'job')} of {len(tasks)} done before")
        failed = _work(left, store, engine_of(batch.scheduler, batch.workers), tell)
    rows = store.rows() if left else rows
    rows = rows[rows["key"].isin({task.key for task in tasks})] if len(rows) else rows
    tables = tables_of(store, rows, batch)
    done = rows[rows["status"] != "failed"] if len(rows) else rows
    nothing = int((done[list(NUMBERS_OF_STATES)] == 0).all(axis=1).sum()) if len(done) else 0
    faults = list(_faults(rows, failed, written=batch.reports))
    about_data = {*data_messages(rows)}
    notices = [note for note in tables.notes if note in about_data or note.startswith("warning: ")]
    notices += _left_out(done)
    if nothing and nothing == len(done):
        faults.append(f"no row is left to evaluate in any of {counted(nothing, 'job')}")
    elif nothing and not faults:
        notices.append(
            f"no row is left to evaluate in {nothing} of {counted(len(done), 'job')}: total 0"
        )
    listed = read_manifest(store.folder, BATCH.name) or ()
    names = {name for name, *_ in listed}
    has_page = bool(listed) and unchanged(store.folder, listed) == names
    opened = len(rows) and (rows["status"] == "open").any()
    return Batch(
        tables=tables,
        faults=tuple(faults),
        store=store,
        page=count == 1 and bool(left or batch.by or batch.band or batch.over or not has_page),
        notices=tuple(notices),
        status=5 if faults else ExitStatus.NOT_REACHED if opened else ExitStatus.DONE,
    )


def _check_options(batch: BatchOptions) -> None:
    """Check that the options of a batch do not contradict each other.

    Raises
    ------
    ConfigError
        Options contradict each other, or an option has no effect without another one.
    """
    options = batch.evaluation
    if batch.proof and not batch.reports:
        raise ConfigError(
            f"{option('proof')} needs {option('reports')}, whose folders hold the proofs"
        )
    if options.curve and not (batch.per_step or batch.reports):
        raise ConfigError(f"{option('curve')} needs {option('per_step')} or {option('reports')}")
    for name, about in BatchOptions.settings().items():
        value, known = getattr(batch, name), about.choices
        if known and value not in (None, *known):
            raise ConfigError(f"{option(name)} {quoted(value)}: must be one of {', '.join(known)}")
    parse_slices(options.slices)
    if batch.scheduler and batch.workers:
        raise ConfigError(
            f"{option('scheduler')} has its own workers: leave out {option('workers')}, which is "
            "for this machine"
        )


def _record(paths: tuple[str, ...], batch: BatchOptions) -> Json:
    """Return the JSON document with the options of a batch that its store keeps."""
    options = batch.evaluation
    return {
        "schema": SCHEMA,
        "version": __version__,
        "options": {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in options.given.items()
        },
        **({"with": list(chosen_metrics(options.with_))} if options.with_ else {}),
        **({"slices": list(options.slices)} if options.slices else {}),
        "jobs": {
            "paths": list(paths),
            **{name: getattr(batch, name) for name in ("truth", "estimate", "layout", "seqmap")},
        },
        **settings_field(batch.config),
    }


def planned(paths: tuple[str, ...], batch: BatchOptions) -> BatchPlan:
    """Return the jobs that a layout, two patterns or a manifest names.

    Raises
    ------
    ConfigError
        Not exactly one of these three is given, or the one that is given is wrong.
    """
    options, output = batch.evaluation, batch.output
    if batch.layout:
        if len(paths) != 2:
            raise ConfigError(f"{option('layout', batch.layout)} takes two folders, GT TRACKERS")
        sequences = pairs.read_sequences(batch.seqmap) if batch.seqmap else ()
        plan = pairs.of_layout(batch.layout, *paths, sequences, output)
        if any(name in options.given for name in DECIDING):
            return plan
        plan = pairs.with_frames(plan, batch.layout, paths[0], batch.seqmap)
        return replace(plan, jobs=tuple(_within(job, options.time) for job in plan.jobs))
    if batch.truth and batch.estimate and not paths:
        inside = functools.cache(functools.partial(runs_inside, max_input=options.max_input))
        return pairs.of_patterns(batch.truth, batch.estimate, output=output, inside=inside)
    if len(paths) == 1 and not (batch.truth or batch.estimate):
        keys = {key for key, is_flag in FLAGS.items() if not is_flag}
        return pairs.of_manifest(paths[0], keys | {key.replace("-", "_") for key in keys})
    raise ConfigError(
        f"name the jobs by patterns such as {option('truth', 'gt/{run}.csv')} and "
        f"{option('estimate', 'out/{run}.csv')}, by a manifest, or by "
        f"{option('layout', metavar='NAME')} and the folders of the truth and of the trackers"
    )


def _within(job: Job, time: str | None) -> Job:
    """Return the job, limited to its frames within the range of ``--time``.

    Raises
    ------
    ConfigError
        ``--time`` is not a range of frame numbers.
    """
    period = parse_time_range(time)
    if job.frames is None or period is None:
        return job
    frames = np.arange(job.frames[0], job.frames[1] + 1)
    frames = frames[period.inside(frames, "number", job.truth)]
    return replace(job, frames=(int(frames[0]), int(frames[-1])) if len(frames) else None)


def _check_missing(plan: BatchPlan, batch: BatchOptions, notify: Notify) -> None:
    """Report the missing files of a plan; without ``--allow-missing``, they are an error.

    Raises
    ------
    ConfigError
        Files are missing without ``--allow-missing``, or there are no jobs.
    """
    lines = [*plan.faults[:FAULTS_SHOWN]]
    if len(plan.faults) > FAULTS_SHOWN:
        lines.append(f"and {len(plan.faults) - FAULTS_SHOWN} more")
    if plan.faults and not batch.allow_missing:
        some = (
            f"; {option('seqmap', metavar='FILE')} evaluates only the sequences in that file"
            if batch.layout
            else ""
        )
        raise ConfigError(
            *lines,
            f"nothing was evaluated; {option('allow_missing')} evaluates the other jobs{some}",
        )
    for text in lines:
        notify(text)
    if not plan.jobs:
        raise ConfigError("no jobs to evaluate")


def shard_of(text: str | None) -> tuple[int, int]:
    """Return the two numbers of the text K/N: shard K, counted from 1, of N shards.

    Raises
    ------
    ConfigError
        The text is not K/N.
    """
    first, slash, last = (text or "1/1").partition("/")
    number, count = (parsed_whole(part) or 0 for part in (first, last))
    if not slash or not 1 <= number <= count:
        raise ConfigError(f"{option('shard', text)}: must be K/N with 1 <= K <= N, such as 3/16")
    return number, count


def tasks_of(plan: BatchPlan, batch: BatchOptions) -> Iterator[batch_row.JobTask]:
    """Yield the task of each job: the job with its options and the key of its row."""
    shared = replace(batch.evaluation, jobs=1)
    base = os.getcwd() if batch.scheduler else ""
    digest = functools.cache(batch_row.digest_of)
    for job in plan.jobs:
        chosen = shared
        if job.options:
            own = typed(job.options, f"job {job.title}")
            chosen = replace(shared, **own)
        elif job.frames:
            first, last = job.frames
            chosen = replace(shared, steps=f"{first}:{last}")
        if isinstance(chosen.ignore_regions, str):
            try:
                path = patterns.fill(chosen.ignore_regions, job.labels)
            except KeyError as error:
                raise ConfigError(
                    f"{option('ignore_regions')} {quoted(chosen.ignore_regions)}: jobs have no "
                    f"label {quoted(error.args[0])}; their labels are {listed(job.labels)}"
                ) from None
            chosen = replace(chosen, ignore_regions=path)
        folder = folder_of(batch.output, job.labels, job.options) if batch.reports else None
        yield batch_row.JobTask(
            job=job,
            options=chosen,
            key=batch_row.key_of(
                job, batch_row.given_text(chosen), batch_row.files_of(job, chosen), digest
            ),
            folder=folder,
            proof=batch.proof,
            per_step=batch.per_step,
            base=base,
            store=os.path.join(batch.output, SETTINGS_FILE),
            settings_file=batch.config,
        )


def _left_over(
    tasks: Iterable[batch_row.JobTask], before: "pd.DataFrame", *, retry_failed: bool
) -> Iterator[batch_row.JobTask]:
    """Yield the tasks that are not done, and tasks that lack requested steps, curves or folders.

    A repeated task also requests the steps and the curve that its row in `before` has, because the
    new row replaces this row.
    """
    numbers = ["sizes.steps", STORED_STEPS, STORED_CURVE]
    known = before.reindex(columns=["key", "status", batch_row.NOT_WRITTEN, *numbers])
    known[numbers] = known[numbers].astype(float).fillna(0.0)
    known[batch_row.NOT_WRITTEN] = known[batch_row.NOT_WRITTEN].notna()
    rows = {row["key"]: row for row in known.to_dict("records")}
    for task in tasks:
        row = rows.get(task.key)
        if row is None or (retry_failed and row["status"] == "failed"):
            yield task
        elif row["status"] != "failed":
            has_steps, has_curve = row[STORED_STEPS] > 0, bool(row[STORED_CURVE])
            wanted = task.per_step and row["sizes.steps"] > 0
            missing = wanted and not (has_steps and (has_curve or not task.options.curve))
            written = task.folder is None or (task.is_written and not row[batch_row.NOT_WRITTEN])
            if missing or not written:
                options = replace(task.options, curve=task.options.curve or has_curve)
                yield replace(task, options=options, per_step=task.per_step or has_steps)


def _size(task: batch_row.JobTask) -> int:
    """Return the size of both files of a task, in bytes.

    Tasks with large files are started first, so that the last process does not end much later than
    the others.
    """
    paths = map(file_of, task.job.files)
    return sum(os.path.getsize(file) for path in paths for file in files_at(path))


def _work(tasks: list[batch_row.JobTask], store: Store, engine: Engine, tell: Notify) -> list[Row]:
    """Do the tasks. Store their rows from time to time, and at the end or after an interruption.

    Returns
    -------
    list of Row
        Rows of jobs that failed.

    Raises
    ------
    ConfigError
        A worker does not see a file that this machine sees.
    """
    pending: list[Row] = []
    faults: list[Row] = []
    begin = flushed = shown = time.monotonic()
    steps = 0
    rows = spread(batch_row.evaluate_job, tasks, batch_row.lost_job, engine)
    try:
        for done, row in enumerate(rows, 1):
            if os.path.exists(row.pop(batch_row.UNSEEN, "")):
                raise ConfigError(
                    f"{option('scheduler')}: {row['message']}: all workers must reach the files "
                    "under the same paths, on a shared file system; finished jobs are kept, and "
                    "the same command resumes"
                )
            pending.append(row)
            if row["status"] == "failed":
                faults.append(row)
            steps += row.get(STORED_STEPS, 0)
            now = time.monotonic()
            if now - flushed > max(FLUSH, SHARE * (now - begin)) or steps > MAX_PENDING_STEPS:
                store.add(pending)
                pending, flushed, steps = [], now, 0
            if now - shown > FLUSH:
                shown, rate = now, done / (now - begin)
                tell(
                    f"{done} of {len(tasks)} jobs, {len(faults)} failed, {rate:.3g} a second, "
                    f"{(len(tasks) - done) / rate:.0f} s left"
                )
    finally:
        rows.close()  # after an error or an interruption, this ends the work of all processes
        store.add(pending)
    return faults


def _faults(rows: "pd.DataFrame", faults: Sequence[Row], *, written: bool) -> Iterator[str]:
    """Yield a line for each job that failed, and for each result folder that was not written.

    Parameters
    ----------
    rows : DataFrame
        Stored rows of the jobs.
    faults : sequence of Row
        Rows of jobs that failed in this run. If such a job has an older row with a value, the store
        keeps that row.
    written : bool
        Whether result folders were requested.
    """
    if not len(rows):
        return
    wrong: Sequence[Mapping[Any, Any]] = frame_records(rows[rows["status"] == "failed"])
    known = {row["key"] for row in wrong}
    for row in (*wrong, *(row for row in faults if row["key"] not in known)):
        yield f"{job_in_words(row)}: {row['message']}"
    if written and batch_row.NOT_WRITTEN in rows:
        for row in frame_records(rows[rows[batch_row.NOT_WRITTEN].notna()]):
            yield f"{job_in_words(row)}: {row[batch_row.NOT_WRITTEN]}"


def _left_out(done: "pd.DataFrame") -> Iterator[str]:
    """Yield a message if data were left out because their times are not declared steps."""
    counts = done.reindex(columns=list(OFF_STEPS.values())).fillna(0).astype(int)
    some = frame_records(done[(counts > 0).any(axis=1)])
    if some:
        of_truth, of_estimate = counts.sum()
        rest = f" and {counted(len(some) - 1, 'more job')}" if len(some) > 1 else ""
        yield (
            f"{job_in_words(some[0])}{rest}: {counted(of_truth, 'row')} of the truth and "
            f"{of_estimate:,} of the estimate are left out: their times are not declared steps"
        )


def tables_of(store: Store, rows: "pd.DataFrame", batch: BatchOptions) -> BatchTables:
    """Return the tables of the groups by ``--by``, or by the first label, and the stored curves."""
    requested = grouped(batch.by, label_names(rows))
    by = requested or label_names(rows)[:1]
    tables = tabulated(rows, by, roots=batch.mean_of_roots)
    steps = store.steps(rows)
    curves, curve_notes = rms_curves(rows, steps, by, batch.band or "interval", batch.over)
    if (batch.band or batch.over) and steps is None:
        curved = option("band" if batch.band else "over")
        curve_notes.append(
            f"{curved} is for curves: no steps are stored; {option('per_step')} stores them"
        )
    # Only with --by, the user requests a ranking and is told why there is none.
    settings, unfinished = store.settings(), store.unfinished(len(rows))
    used = settings.get("settings_file")
    notes = (
        *([f"warning: {unfinished}; {REST}"] if unfinished and batch.shard is None else ()),
        *data_messages(rows),
        *(note for note in tables.notes if requested or note.startswith("warning: ")),
        *curve_notes,
        *([str(SettingsFile(**used))] if used else ()),
    )
    return replace(tables, curves=tuple(curves), notes=notes, settings=settings)


# -------------------------------------------------------------------------------------------------
# The files that a batch writes: its HTML page, pictures and tables.


def folder_of(store: str, labels: Mapping[str, str], options: Mapping[str, str]) -> str:
    """Return the path of the result folder of a job in a store: its labels, then its options."""
    parts = [folder_name(as_unicode(value)) for value in labels.values()]
    parts += [f"{key}={folder_name(value)}" for key, value in options.items()]
    return os.path.join(store, REPORT_FOLDER, *parts)


def batch_files(
    store: Store,
    tables: BatchTables,
    target: str,
    wanted: "Pictures | None" = None,
    notify: Callable[[str, float], None] = lambda name, share: None,  # noqa: ARG005
) -> Files:
    """Return the content of each file of the report, by file name.

    Parameters
    ----------
    store : Store
        Store with the settings and the reports of jobs.
    tables : BatchTables
        Tables to show.
    target : str
        Folder to which the files will be written.
    wanted : Pictures, optional
        Requested pictures.
    notify : callable
        Function that receives the name of the next file, and the finished share of the work.
    """
    from tgospa_eval.show.html import batch_page  # lazy: shards write no page

    def link(row: Mapping[Any, Any]) -> str:
        """Return the link from the page to the report of a job; an empty text without report."""
        labels = {name: str(row[LABEL + name]) for name in label_names(tables.rows)}
        folder = folder_of(str(store.folder), labels, json.loads(str(row["options"])))
        report = Path(folder, "report.html")
        if not report.is_file():
            return ""
        return quote(os.fsencode(Path(os.path.relpath(report, target)).as_posix()))

    tables = replace(tables, link=link)
    notify("report.html", 0.0)
    files: dict[str, str | bytes] = {"report.html": batch_page(tables, draws=wanted is not None)}
    if tables.curves:
        files["curve.csv"] = csv_text(curves_columns(tables.curves))
    if tables.slices:
        files["slices.csv"] = csv_text(slices_of_groups(tables))
    if wanted is None:
        return files
    from tgospa_eval.show.chart_list import pictures  # lazy: slow to import

    return files | pictures("batch", tables, wanted, notify)
