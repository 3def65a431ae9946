"""Jobs over processes. The only module that knows an engine: loky, as joblib brings it.

Only `submit` is used of it, and `as_completed` of its own futures.
"""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from tgospa_eval.common.cores import cores

J = TypeVar("J")
R = TypeVar("R")

PARENT_CHECK = 1.0
"""Seconds between looks at whether the parent is there."""

AHEAD = 2
"""Jobs that wait for each worker: more are lost with one that dies."""


def spread(
    work: Callable[[J], R], jobs: Sequence[J], workers: int | None, lost: Callable[[J], R]
) -> Iterator[R]:
    """Do the jobs in processes; answers come as they are ready.

    A process that dies costs the jobs that were with it a second try, each in a process of its own;
    what kills that as well is answered by `lost`.
    """
    from joblib.externals.loky import ProcessPoolExecutor, as_completed  # here: slow to import
    from joblib.externals.loky.process_executor import BrokenProcessPool

    count = min(workers or cores(), len(jobs)) or 1
    waiting, suspects = list(reversed(jobs)), []
    while waiting:
        with _pool(ProcessPoolExecutor, count) as pool:
            running: dict[Any, J] = {}
            broken = False
            while (waiting or running) and not broken:
                try:
                    while waiting and len(running) < AHEAD * count:
                        with _uninterrupted():
                            running[pool.submit(work, waiting[-1])] = waiting[-1]
                        waiting.pop()
                except BrokenProcessPool:
                    broken = True
                for future in as_completed(list(running)):
                    job = running.pop(future)
                    try:
                        yield future.result()
                    except BrokenProcessPool:
                        suspects.append(job)
                        broken = True
                    if not broken:
                        break
    for job in suspects:
        with _pool(ProcessPoolExecutor, 1) as pool:
            try:
                with _uninterrupted():
                    answer = pool.submit(work, job)
                yield answer.result()
            except BrokenProcessPool:
                yield lost(job)


@contextmanager
def _pool(kind: Any, workers: int) -> Iterator[Any]:
    """Processes that end at once when the work is broken off."""
    # Of a pool that is broken off the process that looks after its locks would complain.
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
    pool = kind(max_workers=workers, initializer=_quiet)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=True, kill_workers=True)
        raise
    pool.shutdown(wait=True)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C waits; processes that begin meanwhile never get any: it is for the one who asked."""
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _quiet() -> None:
    """A worker uses one thread, and does not outlive the one who asked."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
    threading.Thread(target=_watch, args=(os.getppid(),), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK)
    os._exit(1)
