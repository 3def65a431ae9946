"""What there is to do: jobs from the options of a batch, less those that are done."""

import functools
import os
from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import click
import numpy as np

from tgospa_eval.batches import jobs
from tgospa_eval.batches.jobs import Job, Plan
from tgospa_eval.batches.per_step import STORED_CURVE, STORED_STEPS
from tgospa_eval.batches.store import SETTINGS_FILE
from tgospa_eval.cli.batch.files import folder_of
from tgospa_eval.cli.batch.worker import (
    NOT_WRITTEN,
    Task,
    digest_of,
    files_of,
    given_text,
    key_of,
)
from tgospa_eval.cli.shared.options import KNOWN
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.shared.typed import typed_options
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions, Values
from tgospa_eval.common.figures import parsed_whole
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.engines.cluster import Cluster
from tgospa_eval.engines.processes import Processes
from tgospa_eval.engines.spread import Engine
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats import runs_inside
from tgospa_eval.formats.guess import file_of, files_at
from tgospa_eval.formats.options import parse_moments

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.reports.curves import BandKind


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
    paths: tuple[str, ...], batch: BatchOptions, options: EvaluationOptions, output: str | None
) -> Plan:
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


def check_missing(plan: Plan, batch: BatchOptions) -> None:
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
        elif job.frames:
            first, last = job.frames
            chosen = replace(shared, steps=f"{first}:{last}")
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
            settings_file=output.config,
        )


def left_over(tasks: list[Task], before: "pd.DataFrame", *, retry_failed: bool) -> Iterator[Task]:
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


def size_of(task: Task) -> int:
    """Bytes of both files: the largest jobs come first, so that none is left at the end alone."""
    paths = (file_of(path) for path in (task.job.truth, task.job.estimate))
    return sum(os.path.getsize(file) for path in paths for file in files_at(path))
