"""Tasks that write one output each, are skipped where it is there, and go on after a kill."""

import errno
import os
import shutil
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from tgospa_eval.engines.engine import spread
from tgospa_eval.engines.processes import PersistentPool
from tgospa_eval.errors import ConfigError, SolverError

UNFINISHED = ".unfinished"
"""Ends the names of outputs that are being written."""

REMOVED = ".removed-"
"""Begins the names of folders with what is being removed."""


Task = Callable[[str], None]
"""Writes one output, a file or folder of this path; a function of a module, as it travels."""

Run = Callable[[Mapping[str, Task]], None]
"""Does tasks, by their outputs, in no order; those that are done are not done again."""


def do_task(job: tuple[str, Task]) -> tuple[str, bool]:
    """Do one; its output, and that no process died of it."""
    output, task = job
    if not os.path.exists(output):
        task(output)
    return output, False


def _lost(job: tuple[str, Task]) -> tuple[str, bool]:
    return job[0], True


def run_tasks(
    tasks: Mapping[str, Task],
    engine: PersistentPool | None = None,
    done: Callable[[str], None] = lambda output: None,  # noqa: ARG005
) -> None:
    """Do the tasks whose output is not there.

    Parameters
    ----------
    tasks : mapping of str to Task
        By their outputs, which they write by `writing`, in the order in which to begin.
    engine : PersistentPool, optional
        Where, once its patience is over; in this process by default.
    done : callable
        Called with the output of each task when it is there.

    Raises
    ------
    SolverError
        A process died of a task, most likely for want of memory.
    """
    left = deque[tuple[str, Task]]()
    for output, task in tasks.items():
        if not os.path.exists(output):
            left.append((output, task))
        else:
            done(output)
    while left and (engine is None or engine.patience > 0):
        begin = time.monotonic()
        output, _ = do_task(left.popleft())
        if engine is not None:
            engine.patience -= time.monotonic() - begin
        done(output)
    if engine is None:
        return
    for output, lost in spread(do_task, left, _lost, engine):
        if lost:
            raise SolverError(
                f"a process died of {os.path.basename(output)}, most likely for want of "
                "memory: allow less with --memory, or fewer processes with --jobs"
            )
        done(output)


@contextmanager
def writing(output: str) -> Iterator[Path]:
    """Where to write an output, a file or a folder, that has its name once it is whole.

    Raises
    ------
    ConfigError
        The disk is full.
    """
    target = Path(output)
    target.parent.mkdir(parents=True, exist_ok=True)
    # Another process may work on the same after a network was silent for long.
    beside = target.with_name(f"{target.name}.{os.getpid()}{UNFINISHED}")
    try:
        yield beside
        try:
            os.replace(beside, target)
        except OSError:
            if not target.is_dir():  # else another process has finished the same folder meanwhile
                raise
    except OSError as error:
        # NumPy has no number of the system for it, and counts what it could not write.
        if error.errno == errno.ENOSPC or (error.errno is None and "requested" in str(error)):
            raise ConfigError(
                f"{target.parent}: cannot be written: no space left on the disk"
            ) from None
        raise
    finally:
        _remove(beside)


@contextmanager
def writing_folder(output: str) -> Iterator[Path]:
    """As `writing`, of a folder, which is made."""
    with writing(output) as folder:
        folder.mkdir()
        yield folder


@contextmanager
def removing(work: Path, but: str = "") -> Iterator[None]:
    """Remove the folders in a folder of work, but for one of this name.

    All lose their names first, then comes what is to be done meanwhile: however this is broken
    off, nothing that is half there passes for done.

    Raises
    ------
    OSError
        Something cannot be moved.
    """
    aside = Path(tempfile.mkdtemp(prefix=REMOVED, dir=work))
    for path in work.iterdir():
        if path.is_dir() and path.name != but and not path.name.startswith("."):
            os.replace(path, aside / path.name)
    yield
    for path in work.glob(f"{REMOVED}*"):
        shutil.rmtree(path, ignore_errors=True)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
