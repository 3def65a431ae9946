"""Worker processes on this machine: loky, as joblib brings it."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import TracebackType
from typing import Any, Self

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.machine import available_memory, cores
from tgospa_eval.engines.cluster import Cluster
from tgospa_eval.engines.engine import DiedError, Engine, Future, Pool
from tgospa_eval.text import on_surface, surface

PARENT_CHECK = 1.0
"""Seconds between looks at whether the parent is there."""

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""What linear algebra is told before it is loaded."""


@dataclass(frozen=True)
class Processes:
    """Processes of this machine.

    Parameters
    ----------
    number : int, optional
        How many; by default as many as there are cores. Each may take its share of the memory that
        is available.
    """

    number: int | None = None

    @contextmanager
    def open(self, most: int) -> Iterator["Local"]:
        """Processes that end at once when the work is broken off."""
        from joblib.externals.loky import ProcessPoolExecutor  # lazy: slow to import

        # Of a pool that is broken off the process that looks after its locks would complain.
        os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
        _begin_trackers()
        number = max(1, min(self.number or cores(), most))
        free = available_memory()
        share = None if free is None else free // (self.number or cores())
        pool = ProcessPoolExecutor(
            max_workers=number, initializer=_begin, initargs=(share, os.getpid()), env=ONE_THREAD
        )
        try:
            yield Local(pool, number)
        except BaseException:
            pool.shutdown(wait=True, kill_workers=True)
            raise
        pool.shutdown(wait=True)


def engine_of(scheduler: str | None, number: int | None) -> Engine:
    """The workers of a scheduler, if there is one; else so many processes of this machine."""
    return Cluster(scheduler) if scheduler else Processes(number)


class Local:
    """A pool of processes; when one dies, all that is with it is lost."""

    def __init__(self, pool: Any, number: int) -> None:
        self.pool, self.number, self.died = pool, number, False

    def workers(self) -> int:
        """How many there are."""
        return self.number

    def submit(self, function: Callable[..., object], *arguments: object) -> Future:
        """Have a function called."""
        with self._told_when_dead(), uninterrupted():
            future: Future = self.pool.submit(on_surface, surface.get(), function, *arguments)
            return future

    def answer(self, future: Any) -> Any:
        """What came out."""
        with self._told_when_dead():
            return future.result()

    def look(self) -> None:
        """Nothing to see: a process that dies ends its futures."""

    @contextmanager
    def _told_when_dead(self) -> Iterator[None]:
        from joblib.externals.loky.process_executor import BrokenProcessPool

        try:
            yield
        except BrokenProcessPool:
            self.died = True
            raise DiedError from None


def _begin_trackers() -> None:
    """Have what loky begins with its first worker: Python up to 3.13 lets Ctrl-C through then."""
    if hasattr(signal, "pthread_sigmask"):
        from multiprocessing import resource_tracker

        resource_tracker.ensure_running()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C waits; processes that begin meanwhile never get any: it is for the one who asked."""
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(share: int | None, parent: int) -> None:
    """A worker keeps to its share of the memory, and does not outlive the one who asked.

    Who that is has to be told: it may be gone already.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from joblib.externals.loky import process_executor  # lazy: slow to import

    # Loky takes it for a leak when a worker has grown by 0.3 GB; large jobs do, and the limit is
    # ours to set. Where it has no such number, nothing happens.
    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize
    limit_memory(share)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def limit_memory(share: int | None) -> None:
    """Refuse this process more than so many bytes, where the system can."""
    if share is not None and sys.platform == "linux":
        import resource

        # Memory that can be written; address space would count what is only reserved.
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        if hard == resource.RLIM_INFINITY or share < hard:
            with suppress(ValueError, OSError):  # others may have set less meanwhile
                resource.setrlimit(resource.RLIMIT_DATA, (share, hard))


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK)
    os._exit(1)


# -------------------------------------------------------------------------------------------------
# Workers that stay from one list of jobs to the next: to have them anew takes a second each.


class PersistentPool:
    """An engine that opens one pool of another, and a new one where a worker of it has died.

    Used in a ``with`` statement, whose end ends the workers.

    Parameters
    ----------
    engine : Engine
        Opens the pools.
    most : int
        Workers that are wanted.
    patience : float
        Seconds of work that whoever has jobs is to do without workers: what ends sooner ends before
        workers would have begun.
    """

    def __init__(self, engine: Engine, most: int, patience: float = 0.0) -> None:
        self.engine, self.most, self.patience = engine, most, patience
        self._stack = ExitStack()
        self._pool: Pool | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    @contextmanager
    def open(self, most: int) -> Iterator[Pool]:  # noqa: ARG002  (it has the workers it has)
        """The pool that is there."""
        if self._pool is None or self._pool.died:
            self._stack.close()
            self._pool = self._stack.enter_context(self.engine.open(self.most))
        yield self._pool
