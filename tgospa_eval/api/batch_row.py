"""Work of a worker process: one job, from its files to a row, of a store or for a gate."""

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
from tgospa_eval.results.evaluation import RESULT_SCHEMA, Evaluation
from tgospa_eval.text import as_unicode, option

SMALL = 1 << 20
"""Bytes of a file that are read at once for its digest."""

NOT_WRITTEN = "not_written"
"""Column of rows whose folder could not be written: why. The next run tries it again."""

UNSEEN = "unseen"
"""Field of a row with the file that its worker did not see, for the process that reports it."""

NAMING_FILES = ("covariance", "inner_cov", "step_weights", "ignore_regions")
"""Options that may name a file; their order is that of the digest of a job."""


Work = Callable[[], Evaluation]
Run = Callable[[Work, Stopwatch], Evaluation]
"""Runs the work of one job; the command line shows how far it is, and lets Ctrl-C stop it."""


@dataclass(frozen=True, kw_only=True)
class JobTask:
    """A job with everything that a worker needs.

    Parameters
    ----------
    job : Job
        Paths and labels.
    options : Request
        Those of the batch with those of the job.
    key : str
        Of the row.
    folder : str, optional
        Where to write the result folder of the job.
    proof : bool
        Whether with its proof.
    per_step : bool
        Whether the costs of its steps are stored.
    base, store : str
        Where relative paths begin, for a worker that was not started there, and the settings of
        the batch, which it sees if it shares its folder.
    settings_file : SettingsFile, optional
        The configuration file that set options of the batch.
    for_gate : bool
        Whether it is for a gate, whose rows have the names of pairs as keys.
    page, quiet, verbose : bool
        Of a gate, whether a page is made, and which lines there are for the user.
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
        """True if the requested folder is there."""
        parts = (PROOF_FOLDER,) if self.proof else ()
        return self.folder is None or Path(self.folder, *parts).is_dir()


def key_of(
    job: Job, given: str, files: Iterable[str], digest: Callable[[str], bytes] | None = None
) -> str:
    """Return a digest of what makes the row: its files, labels, options and the schema of a result.

    Parameters
    ----------
    job : Job
        Paths and labels.
    given : str
        Its options, as `given_text` has them.
    files : iterable of str
        What is read.
    digest : callable, optional
        That of a file; `digest_of`, or one that reads a file of many jobs once.
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
    """Return a digest of the bytes of a file, or of those of a folder that are read.

    What cannot be read counts as nothing; the job will say so.
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
    """Return the files that a job reads; a word in place of a name is a file that is not there."""
    named = (getattr(options, name) for name in NAMING_FILES)
    return (*job.files, *filter(None, named))


def evaluate_job(
    task: JobTask, run: Run | None = None, say: Callable[[str], None] | None = None
) -> Row:
    """Return the row of a job; a wrong file or a failed solver makes a row with its message.

    That of a gate has the error itself as well, its page, and the lines for the user unless `say`
    gets them at once.
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
    """Return what a store has of a result beside the row for a gate.

    Raises
    ------
    InputError
        A file changed.
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
    """Make the page of a pair of a gate, if requested; its proof is written."""
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
    """Describe a file that a worker of a cluster does not see; None if all are there."""
    if not requested.base:
        return None
    needed = [(*map(file_of, task.job.files), task.store) for task in (requested, here)]
    for path, local in zip(*needed, strict=True):
        if not os.path.exists(local):
            message = f"the worker on {socket.gethostname()} does not see {local}"
            return {"status": "failed", "message": message, UNSEEN: path}
    return None


def lost_job(task: JobTask) -> Row:
    """Return the row of a job whose process died, also when nothing else was worked on."""
    error = SolverError("its process died")
    row = {"status": "failed", "message": str(error), "error": error, "lines": ()}
    return finished_row(task, row, 0.0)


def finished_row(task: JobTask, row: Mapping[str, object], seconds: float) -> Row:
    """Add what every row has; in a store with texts as Parquet takes them."""
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
    """Write the result folder, without pictures; what the row says where that is not possible.

    A full disk, or what is in the way of a folder, takes nothing from the number.
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
"""Seconds of work before processes are started, which takes about as long."""

SHOWN = 10.0
"""Seconds between two lines of progress."""


def gate_rows(
    tasks: Sequence[JobTask], notify: Callable[[str, str], None], run: Run | None
) -> Iterator[Row]:
    """Yield rows as they are ready: of this process at first, and of several if that takes long.

    `notify` gets lines, each with the name of its job.
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
