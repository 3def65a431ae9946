"""Tasks that write one output each.

When work begins again after an interruption, a task is skipped if its output exists.
"""

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
from tgospa_eval.quoting import option

REMOVED = ".removed-"
"""Prefix of the names of folders that are being removed."""


Task = Callable[[str], None]
"""Function that receives a path, and writes its output (a file or a folder) to this path. It must
be picklable."""

Run = Callable[[Mapping[str, Task]], None]
"""Function that does tasks in any order. Its argument is a mapping from the path of each output to
its task. A task is skipped if its output exists."""


def do_task(job: tuple[str, Task]) -> tuple[str, bool]:
    """Do a task; return the path of its output, and False.

    False means that the process of the task did not die (see `_lost`).
    """
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
    """Do the tasks whose output does not exist.

    Parameters
    ----------
    tasks : mapping of str to Task
        Tasks by the paths of their outputs. Tasks begin in this order. An output must appear at its
        path only when it is complete: tasks write it by `writing` or `writing_folder`.
    engine : PersistentPool, optional
        Pool that does the tasks. This process works first, for as many seconds as the `patience` of
        the pool. Then the pool does the rest. By default, this process does all tasks.
    done : callable
        Function that receives the path of each output as soon as it exists.

    Raises
    ------
    SolverError
        A process died during a task, most likely from lack of memory.
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
                f"a process died during {os.path.basename(output)}, most likely from lack of "
                f"memory; choose a smaller {option('memory')}, or fewer processes with "
                f"{option('jobs')}"
            )
        done(output)


@contextmanager
def removing(work: Path, but: str = "") -> Iterator[None]:
    """Remove the folders in a folder of work, except the one named `but`.

    The folders are renamed before the body of the ``with`` runs, and removed after it. Without the
    new names, a folder that is only partly removed after an interruption would look like finished
    work.

    Raises
    ------
    OSError
        A folder cannot be moved.
    """
    aside = Path(tempfile.mkdtemp(prefix=REMOVED, dir=work))
    for path in work.iterdir():
        if path.is_dir() and path.name != but and not path.name.startswith(REMOVED):
            os.replace(path, aside / path.name)
    yield
    for path in work.glob(f"{REMOVED}*"):
        shutil.rmtree(path, ignore_errors=True)
