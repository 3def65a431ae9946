"""Tasks that write one output each, are skipped where it is there, and go on after a kill."""

import os
import shutil
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from tgospa_eval.common.machine import release_freed
from tgospa_eval.engines import PersistentPool, spread
from tgospa_eval.errors import SolverError
from tgospa_eval.text import option

REMOVED = ".removed-"
"""Begins the names of folders with what is being removed."""


Task = Callable[[str], None]
"""Writes one output, a file or folder of this path; a function of a module, as it travels."""

Run = Callable[[Mapping[str, Task]], None]
"""Does tasks, given by their outputs, in any order; a task that is done is not done again."""


def do_task(job: tuple[str, Task]) -> tuple[str, bool]:
    """Do a task; return its output, and False as no process died of it."""
    output, task = job
    if not os.path.exists(output):
        task(output)
        release_freed()
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
                f"a process died of {os.path.basename(output)}, most likely for want of memory: "
                f"allow less with {option('memory')}, or fewer processes with {option('jobs')}"
            )
        done(output)


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
        if path.is_dir() and path.name != but and not path.name.startswith(REMOVED):
            os.replace(path, aside / path.name)
    yield
    for path in work.glob(f"{REMOVED}*"):
        shutil.rmtree(path, ignore_errors=True)
