"""Evaluation of one job in a worker process: from its files to a row, for a batch or a gate."""

import hashlib
import json
import os
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from tgospa_eval._version import __version__
from tgospa_eval.api.notices import about_run
from tgospa_eval.api.options import Request, names_file
from tgospa_eval.campaign.pairs import Job
from tgospa_eval.campaign.row import Row, row_to_judge, stored_slices
from tgospa_eval.campaign.store import stored_steps
from tgospa_eval.common.config import SettingsFile
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.machine import fault_of
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.engines import Processes, spread
from tgospa_eval.errors import InputError, SolverError, TgospaError
from tgospa_eval.formats.guess import file_of, files_at
from tgospa_eval.proof import PROOF_FOLDER
from tgospa_eval.quoting import as_unicode, option
from tgospa_eval.results.evaluation import RESULT_SCHEMA, Evaluation

SMALL = 1 << 20
"""Number of bytes of a file that are read at once for its digest; the rest is read in blocks."""

NOT_WRITTEN = "not_written"
"""Column with the reason why a result folder could not be written. The next run tries again."""

UNSEEN = "unseen"
"""Field of a row with the path of a file that a worker did not see. The main process reports it."""

NAMING_FILES = ("covariance", "inner_cov", "step_weights", "ignore_regions", "region")
"""Options that can name a file, in the order in which their files enter the key of a row."""


Work = Callable[[], Evaluation]
Run = Callable[[Work, Stopwatch], Evaluation]
"""Function that calls the work of a job. The command line gives a function that also shows progress
and handles Ctrl-C."""


@dataclass(frozen=True, kw_only=True)
class JobTask:
    """Job with all data that a worker needs.

    Parameters
    ----------
    job : Job
        Paths and labels.
    options : Request
        Options of the batch and of the job.
    key : str
        Key of the row: `key_of`, or for a gate the name of the pair.
    folder : str, optional
        Result folder of the job.
    proof : bool
        Whether to write the proof folder.
    per_step : bool
        Whether to store the costs of the steps of the job.
    base : str
        With a cluster: the folder to which paths are relative. Otherwise blank.
    store : str
        Path of a file in the store of the batch. A worker that does not see this file does not
        share the file system.
    settings_file : SettingsFile, optional
        Configuration file that set options of the batch.
    for_gate : bool
        Whether the job is for a gate.
    page : bool
        Whether a gate makes an HTML page of the job.
    quiet, verbose : bool
        Whether a gate prints fewer lines or more lines for the user.
    """

    job: Job
    options: Request
    key: str = ""
    folder: str | None = None
    proof: bool = False
    per_step: bool = False
    base: str = ""
    store: str = ""
    settings_file: SettingsFile | None = None
    for_gate: bool = False
    page: bool = False
    quiet: bool = True
    verbose: bool = False

    @property
    def is_written(self) -> bool:
        """True if the result folder, and the proof in it, exist or are not requested."""
        parts = (PROOF_FOLDER,) if self.proof else ()
        return self.folder is None or Path(self.folder, *parts).is_dir()


def key_of(
    job: Job, given: str, files: Iterable[str], digest: Callable[[str], bytes] | None = None
) -> str:
    """Return the key of the row of a job: a digest of all that determines the row.

    These are the content of the files, the labels, the options, and the version of the schema.

    Parameters
    ----------
    job : Job
        Paths and labels.
    given : str
        Options of the job, as `given_text` returns them.
    files : iterable of str
        Files that are read.
    digest : callable, optional
        Function that returns the digest of a file; by default `digest_of`. With a cache, it reads a
        file that many jobs have only once.
    """
    sha = hashlib.sha256(given.encode())
    sha.update(json.dumps(dict(job.labels), sort_keys=True).encode())
    sha.update(job.digest.encode())
    for path in files:
        file = file_of(path)
        sha.update((digest or digest_of)(file))
        # The path of a MAT file can end with the name of a variable in it.
        sha.update(path[len(file) :].encode("utf-8", "surrogateescape"))
    return sha.hexdigest()


def digest_of(path: str) -> bytes:
    """Return a digest of the bytes of a file, or of the files of a folder.

    A file that cannot be read counts as empty here; the job reports it.
    """
    files = files_at(path)
    if files != [path]:
        return b"".join(Path(name).name.encode() + digest_of(name) for name in files)
    with suppress(OSError), open(path, "rb", buffering=0) as file:
        start = file.read(SMALL)
        more = hashlib.file_digest(file, "sha256").digest() if len(start) == SMALL else b""
        return hashlib.sha256(start).digest() + more
    return b""


@lru_cache(maxsize=64)  # most jobs of a batch have the same options
def given_text(options: Request) -> str:
    """Return, as a text, the options that change the value, and the version of the schema."""
    return json.dumps((RESULT_SCHEMA, options.given), sort_keys=True, default=str)


def files_of(job: Job, options: Request) -> tuple[str, ...]:
    """Return the paths of the files that a job reads.

    Options such as ``inner_cov`` can have a word instead of a path. It is returned like a path, and
    its digest is that of a missing file.
    """
    return (*job.files, *_named(options).values())


def _named(options: Request) -> dict[str, str]:
    """Return the values of options that can name a file; ``region`` only if it does name one."""
    values = {name: getattr(options, name) for name in NAMING_FILES}
    return {
        name: value
        for name, value in values.items()
        if value and (name != "region" or names_file(name, value))
    }


def evaluate_job(
    task: JobTask, run: Run | None = None, say: Callable[[str], None] | None = None
) -> Row:
    """Evaluate a job, and return its row.

    If a file is wrong or the solver fails, the row has the message of the error. A row for a gate
    also has the error itself, or the HTML page if requested. `say` receives each line for the user
    immediately. Without `say`, a row for a gate has these lines.
    """
    # lazy: the process that starts the workers evaluates nothing
    from tgospa_eval.api.evaluate import evaluate_sides, read_sides
    from tgospa_eval.api.resolve import resolve_request

    begin, lines = time.monotonic(), list[str]()
    say = say or lines.append

    def notify(notice: Notice) -> None:
        if notice.code or not task.quiet:
            say(str(notice))

    try:
        here = _on_this_worker(task)
        unseen = _unseen(task, here)
        if unseen is not None:
            return finished_row(task, unseen, 0.0)
        settings, stopwatch = resolve_request(here.options), Stopwatch()
        settings = replace(settings, allow_empty=not task.for_gate)
        if not task.quiet:
            stopwatch.notify = say

        def work() -> Evaluation:
            chosen = here.job.in_memory.get("mapping")
            sides = read_sides(settings, *here.job.sides, stopwatch, notify, mapping=chosen)
            return evaluate_sides(settings, sides, stopwatch, notify)

        result = run(work, stopwatch) if run else work()
        if task.for_gate:
            for text in about_run(result, settings, stopwatch, verbose=task.verbose):
                say(text)
        row = {
            **row_to_judge(result),
            **(_gate_row if task.for_gate else _stored)(result, task, here),
        }
    except TgospaError as error:
        row = {"status": "failed", "message": " ".join(error.args), "error": error}
    except Exception as error:  # a bug must not stop the other jobs
        if task.for_gate:
            raise
        row = {"status": "failed", "message": fault_of(error)}
    return finished_row(task, {**row, "lines": lines}, time.monotonic() - begin)


def _stored(result: Evaluation, task: JobTask, here: JobTask) -> Row:
    """Write the result folder, and return the columns that only a row of a store has.

    `task` has the paths of the main process, `here` those of this worker.

    Raises
    ------
    InputError
        A file changed while it was read.
    """
    result = replace(result, settings_file=task.settings_file)
    files = files_of(here.job, here.options)
    if key_of(task.job, given_text(task.options), files) != task.key:
        raise InputError("a file changed while it was read; the same command reads it again")
    return {
        **stored_steps(result, per_step=task.per_step),
        **stored_slices(result),
        **({"message": ""} if result.finished else {}),
        **_written(result, task, here.folder),
    }


def _gate_row(result: Evaluation, task: JobTask, here: JobTask) -> Row:
    """Write the proof of a pair of a gate if requested; return its HTML page if requested."""
    if here.folder is not None:
        # lazy: few gates write proofs
        from tgospa_eval.show.files import PROOF, proof_files, write_texts

        texts = proof_files(result, task.options.given)
        write_texts(texts, here.folder, PROOF, force=False, subject=option("proof"))
    if not task.page:
        return {}
    from tgospa_eval.show.html import page  # lazy: few gates make pages

    return {"page": page(result, (task.job.truth, task.job.estimate))}


def _on_this_worker(task: JobTask) -> JobTask:
    """Return the task with its relative paths joined to its base folder, for a cluster."""
    if not task.base:
        return task

    def local(path: str) -> str:
        return os.path.join(task.base, path)

    job = replace(task.job, truth=local(task.job.truth), estimate=local(task.job.estimate))
    named = _named(task.options)
    paths: Any = {name: local(path) for name, path in named.items() if path != "global"}
    options = replace(task.options, **paths)
    return replace(
        task,
        job=job,
        options=options,
        folder=task.folder and local(task.folder),
        store=local(task.store),
    )


def _unseen(requested: JobTask, here: JobTask) -> Row | None:
    """Return the row of a job with a file that this worker does not see; None if it sees all.

    `requested` has the paths of the main process, `here` those of this worker.
    """
    if not requested.base:
        return None
    needed = [(*map(file_of, task.job.files), task.store) for task in (requested, here)]
    for path, local in zip(*needed, strict=True):
        if not os.path.exists(local):
            message = f"the worker on {socket.gethostname()} does not see {local}"
            return {"status": "failed", "message": message, UNSEEN: path}
    return None


def lost_job(task: JobTask) -> Row:
    """Return the row of a job whose process died while it did only this job."""
    error = SolverError("its process died")
    row = {"status": "failed", "message": str(error), "error": error, "lines": ()}
    return finished_row(task, row, 0.0)


def finished_row(task: JobTask, row: Mapping[str, object], seconds: float) -> Row:
    """Add the columns that every row has, such as the key and the labels.

    A row for a store has only values that Parquet supports.
    """
    whole = {
        "key": task.key,
        **{f"label.{name}": value for name, value in task.job.labels.items()},
        "truth": task.job.truth,
        "estimate": task.job.estimate,
        "options": json.dumps(dict(task.job.options), sort_keys=True),
        **row,
        "seconds": seconds,
        "finished": time.time_ns(),
        "version": __version__,
    }
    if task.for_gate:
        return whole
    return {
        key: as_unicode(value) if isinstance(value, str) else value
        for key, value in whole.items()
        if key not in ("error", "lines")
    }


def _written(result: Evaluation, task: JobTask, folder: str | None) -> Row:
    """Write the result folder without pictures; if that fails, return a column with the reason.

    The row keeps its value even if the disk is full or the folder cannot be made.
    """
    if folder is None:
        return {}
    from tgospa_eval.show.files import RESULT, result_texts, write_texts

    try:
        Path(folder).parent.mkdir(parents=True, exist_ok=True)
        result = replace(result, files={"truth": task.job.truth, "estimate": task.job.estimate})
        texts = result_texts(result, (task.job.truth, task.job.estimate))
        if task.proof:
            from tgospa_eval.show.files import proof_files

            files = proof_files(result, task.options.given)
            texts |= {f"{PROOF_FOLDER}/{name}": text for name, text in files.items()}
        write_texts(texts, folder, RESULT, force=False)
    except TgospaError as error:
        return {NOT_WRITTEN: " ".join(error.args)}
    except OSError as error:
        return {NOT_WRITTEN: fault_of(error)}
    return {}


# -------------------------------------------------------------------------------------------------
# Rows for a gate, evaluated in this process or in several.

PATIENCE = 2.0
"""Seconds of work in this process before more processes start. Their start takes about as long."""

SHOWN = 10.0
"""Number of seconds between two lines of progress."""


def gate_rows(
    tasks: Sequence[JobTask], notify: Callable[[str, str], None], run: Run | None
) -> Iterator[Row]:
    """Evaluate tasks, and yield each row when it is ready; several processes share long work.

    `notify` receives the name of a job and a line about it. Lines about all jobs have an empty
    name.
    """
    begin = shown = time.monotonic()
    done = 0
    for task in tasks:
        if done and len(tasks) - done > 1 and time.monotonic() - begin > PATIENCE:
            break
        yield evaluate_job(task, run, partial(notify, task.job.name))
        done += 1
    rest = [replace(task, options=replace(task.options, jobs=1)) for task in tasks[done:]]
    engine = Processes(tasks[0].options.jobs if tasks else None)
    for row in spread(evaluate_job, rest, lost_job, engine) if rest else ():
        yield row
        done += 1
        now = time.monotonic()
        if not tasks[0].quiet and now - shown > SHOWN:
            left = (now - begin) / done * (len(tasks) - done)
            shown = now
            notify("", f"{done} of {len(tasks)} pairs, about {left:.0f} s left")
