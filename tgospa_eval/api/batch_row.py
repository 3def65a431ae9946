"""Work of a worker process: one job, from its files to a row of a store or of a gate."""

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
from tgospa_eval.api.options import Request
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
"""Largest size of a file that is read at once for its digest."""

NOT_WRITTEN = "not_written"
"""Column with the reason why a folder could not be written; the next run tries again."""

UNSEEN = "unseen"
"""Field of a row with a file that its worker did not see, for the report of the main process."""

NAMING_FILES = ("covariance", "inner_cov", "step_weights", "ignore_regions")
"""Options that may name a file, in the order of the digest of a job."""


Work = Callable[[], Evaluation]
Run = Callable[[Work, Stopwatch], Evaluation]
"""Function that runs the work of a job; the command line adds progress and Ctrl-C."""


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
        Key of the row.
    folder : str, optional
        Result folder of the job.
    proof : bool
        Whether to write the proof.
    per_step : bool
        Whether to store the costs of its steps.
    base : str
        Folder to which paths are relative.
    store : str
        Settings file of the batch. Only a worker that shares the file system sees it.
    settings_file : SettingsFile, optional
        Configuration file that set options of the batch.
    for_gate : bool
        Whether the job is for a gate. The key of its row is then the name of the pair.
    page, quiet, verbose : bool
        Whether a gate makes a page of the job, and which lines it prints.
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
        """True if the requested folder exists."""
        parts = (PROOF_FOLDER,) if self.proof else ()
        return self.folder is None or Path(self.folder, *parts).is_dir()


def key_of(
    job: Job, given: str, files: Iterable[str], digest: Callable[[str], bytes] | None = None
) -> str:
    """Return a digest of files, labels, options and schema, which determine the row.

    Parameters
    ----------
    job : Job
        Paths and labels.
    given : str
        Options of the job, from `given_text`.
    files : iterable of str
        Files that are read.
    digest : callable, optional
        Callable that returns the digest of a file. By default `digest_of`; another callable can
        read a file of many jobs only once.
    """
    sha = hashlib.sha256(given.encode())
    sha.update(json.dumps(dict(job.labels), sort_keys=True).encode())
    sha.update(job.digest.encode())
    for path in files:
        file = file_of(path)
        sha.update((digest or digest_of)(file))
        sha.update(path[len(file) :].encode("utf-8", "surrogateescape"))  # the variable in the file
    return sha.hexdigest()


def digest_of(path: str) -> bytes:
    """Return a digest of the bytes of a file, or of the files of a folder.

    Unreadable files count as empty; the job reports them.
    """
    files = files_at(path)
    if files != [path]:
        return b"".join(Path(name).name.encode() + digest_of(name) for name in files)
    with suppress(OSError), open(path, "rb", buffering=0) as file:
        start = file.read(SMALL)
        more = hashlib.file_digest(file, "sha256").digest() if len(start) == SMALL else b""
        return hashlib.sha256(start).digest() + more
    return b""


@lru_cache(maxsize=64)  # most jobs of a batch have the same
def given_text(options: Request) -> str:
    """Return the options that change the number, and the schema of a result."""
    return json.dumps((RESULT_SCHEMA, options.given), sort_keys=True, default=str)


def files_of(job: Job, options: Request) -> tuple[str, ...]:
    """Return the files that a job reads; a word instead of a path counts as a missing file."""
    named = (getattr(options, name) for name in NAMING_FILES)
    return (*job.files, *filter(None, named))


def evaluate_job(
    task: JobTask, run: Run | None = None, say: Callable[[str], None] | None = None
) -> Row:
    """Return the row of a job; a wrong file or a failed solver makes a row with its message.

    The row of a gate also has the error and the page. If there is no `say` that receives the lines
    for the user at once, the row has these lines, too.
    """
    from tgospa_eval.api.evaluate import evaluate_sides, read_sides  # lazy: the parent does without
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
    except Exception as error:  # a fault of ours must not stop the other jobs
        if task.for_gate:
            raise
        row = {"status": "failed", "message": fault_of(error)}
    return finished_row(task, {**row, "lines": lines}, time.monotonic() - begin)


def _stored(result: Evaluation, task: JobTask, here: JobTask) -> Row:
    """Return the additional columns of a stored row.

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
    """Make the page of a pair of a gate, if requested, and write its proof."""
    if here.folder is not None:
        from tgospa_eval.show.files import PROOF, proof_files, write_texts  # lazy: few ask for it

        texts = proof_files(result, task.options.given)
        write_texts(texts, here.folder, PROOF, force=False, subject=option("proof"))
    if not task.page:
        return {}
    from tgospa_eval.show.html import page  # lazy: for folders only

    return {"page": page(result, (task.job.truth, task.job.estimate))}


def _on_this_worker(task: JobTask) -> JobTask:
    """Return the task with paths of this worker."""
    if not task.base:
        return task

    def local(path: str) -> str:
        return os.path.join(task.base, path)

    job = replace(task.job, truth=local(task.job.truth), estimate=local(task.job.estimate))
    named = {name: getattr(task.options, name) for name in NAMING_FILES}
    paths: Any = {name: local(path) for name, path in named.items() if path and path != "global"}
    options = replace(task.options, **paths)
    return replace(
        task,
        job=job,
        options=options,
        folder=task.folder and local(task.folder),
        store=local(task.store),
    )


def _unseen(requested: JobTask, here: JobTask) -> Row | None:
    """Describe a file that a worker of a cluster does not see; None if it sees all."""
    if not requested.base:
        return None
    needed = [(*map(file_of, task.job.files), task.store) for task in (requested, here)]
    for path, local in zip(*needed, strict=True):
        if not os.path.exists(local):
            message = f"the worker on {socket.gethostname()} does not see {local}"
            return {"status": "failed", "message": message, UNSEEN: path}
    return None


def lost_job(task: JobTask) -> Row:
    """Return the row of a job whose process died although no other job was running."""
    error = SolverError("its process died")
    row = {"status": "failed", "message": str(error), "error": error, "lines": ()}
    return finished_row(task, row, 0.0)


def finished_row(task: JobTask, row: Mapping[str, object], seconds: float) -> Row:
    """Add the columns of every row; a store gets texts that Parquet supports."""
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
    """Write the result folder without pictures; return columns with the reason if that fails.

    A full disk or an obstacle to the folder does not change the number.
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
# Rows for a gate, from this process or from several.

PATIENCE = 2.0
"""Seconds of work before processes are started. Starting them takes about as long."""

SHOWN = 10.0
"""Seconds between two lines of progress."""


def gate_rows(
    tasks: Sequence[JobTask], notify: Callable[[str, str], None], run: Run | None
) -> Iterator[Row]:
    """Yield rows as they are ready; several processes share work that takes long.

    `notify` receives the name of a job, or a blank, and a line about it.
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
