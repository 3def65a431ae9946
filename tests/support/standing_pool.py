"""One pool of worker processes for all tests of a process: to begin workers takes most of a batch.

Workers are real, and go to the folder of the test for each task.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from joblib.externals.loky import ProcessPoolExecutor

from tgospa_eval import engines

WORKERS = 2


def in_folder(folder: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """In a worker: what comes out of a task of a test that runs there."""
    os.chdir(folder)
    return function(*arguments)


class StandingPool:
    """What opens the pool in place of `Processes.open`."""

    def __init__(self) -> None:
        self.pool: Any = None

    @contextmanager
    def open(self, engine: engines.Processes, most: int) -> Iterator[engines.Local]:
        number = max(1, min(engine.number or engines.cores(), most))
        if self.pool is None:
            engines._begin_trackers()
            self.pool = ProcessPoolExecutor(
                max_workers=WORKERS,
                initializer=engines._begin,
                initargs=(None, os.getpid()),
                env=engines.ONE_THREAD,
            )
        try:
            yield engines.Local(Lent(self.pool), number)
        except BaseException:
            self.close()
            raise
        if self.pool._flags.broken is not None:
            self.close()

    def close(self) -> None:
        if self.pool is not None:
            self.pool.shutdown(wait=True, kill_workers=True)
            self.pool = None


class Lent:
    """The pool for one batch."""

    def __init__(self, pool: Any) -> None:
        self.pool, self.folder = pool, os.getcwd()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return self.pool.submit(in_folder, self.folder, function, *arguments)
