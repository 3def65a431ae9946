"""Engines that do jobs in chunks, and try a job again if its worker dies.

An engine opens pools of workers, and jobs are submitted to a pool. With the engine `Processes`, the
workers are processes of this machine (loky, from joblib). With `Cluster`, they are the workers of
an existing Dask scheduler. `call_in_helper` uses one more process, for compiled code that can crash
on damaged data.
"""

import atexit
import logging
import math
import os
import pickle
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import cache
from types import TracebackType
from typing import Any, Protocol, Self, TypeVar

from tgospa_eval._version import __version__
from tgospa_eval.common import files
from tgospa_eval.common.machine import available_memory, cores
from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import on_surface, option, surface

J = TypeVar("J")
R = TypeVar("R")

CHUNK_SECONDS = 1.0
"""Seconds after which a worker returns the finished answers of its chunk. The other jobs of the
chunk are submitted again later."""

POLL = 1.0
"""Seconds without an answer after which a pool is checked by `Pool.poll`."""

CHUNKS_AHEAD = 4
"""Number of chunks for each worker into which the remaining jobs are divided. Therefore, chunks
become smaller towards the end."""


class DiedError(Exception):
    """Error that a job has no answer, because each worker that tried it died.

    On one machine, a pool gives a job to one worker. On a cluster, Dask tries several workers.
    """


class Future(Protocol):
    """Answer that a pool will give later."""

    def add_done_callback(self, function: Callable[[Any], object], /) -> object:
        """Set a function that is called with this future when its job has ended."""


class Pool(Protocol):
    """Pool of running workers."""

    @property
    def died(self) -> bool:
        """True if a worker has died, so that another pool is needed."""

    def workers(self) -> int:
        """Return the number of jobs that run at the same time."""

    def submit(self, function: Callable[..., R], *arguments: object) -> Future:
        """Call a function in a worker; raise `DiedError` if no worker is left."""

    def answer(self, future: Any) -> Any:
        """Return the answer of a finished future, or raise `DiedError`."""

    def poll(self) -> None:
        """Check the workers while there is no answer."""


class Engine(Protocol):
    """Source of workers, in pools."""

    def open(self, max_workers: int) -> AbstractContextManager[Pool]:
        """Yield a pool. If the block raises an exception, the pool stops its work.

        At most `max_workers` workers are started. Workers that exist already are all used.
        """


ATTEMPTS = ((32, 2, False), (1, 1, False), (1, 1, True))
"""Settings of the first, second and third attempt at a job.

Each attempt has three settings: the largest number of jobs in a chunk, the number of chunks that
each worker has at once, and whether only one job runs at a time. If a worker dies, all jobs that it
may have run get another attempt. In the last attempt, the job that kills its worker is known,
because no other job runs.
"""


def spread(
    work: Callable[[J], R], jobs: Sequence[J], lost: Callable[[J], R], engine: Engine
) -> Generator[R, None, None]:
    """Call `work` for each job in a worker, and yield the answers as they are ready.

    If a worker dies, its jobs are tried again with the settings of `ATTEMPTS`. If a job kills its
    worker even in the last attempt, `lost` gives the answer for this job.
    """
    left: Sequence[J] = jobs
    for chunk_size, ahead, separate in ATTEMPTS:
        waiting, suspects = deque(left), list[J]()
        while waiting:
            with engine.open(1 if separate else len(waiting)) as pool:
                yield from _until_one_dies(
                    work, waiting, suspects, pool, chunk_size, ahead, separate
                )
        left = suspects
    yield from map(lost, left)


def some(work: Callable[[J], R], chunk: Sequence[J]) -> list[R]:
    """Do jobs of a chunk for `CHUNK_SECONDS`, but at least one job, and return the answers."""
    until = time.monotonic() + CHUNK_SECONDS
    answers = []
    for job in chunk:
        answers.append(work(job))
        if time.monotonic() > until:
            break
    return answers


def _until_one_dies(
    work: Callable[[J], R],
    waiting: deque[J],
    suspects: list[J],
    pool: Pool,
    chunk_size: int,
    ahead: int,
    separate: bool,
) -> Iterator[R]:
    """Yield answers of `waiting` jobs until a worker dies or no job is left.

    Jobs that may have killed the worker are moved to `suspects`. The last three parameters are the
    settings of an attempt (`ATTEMPTS`).
    """
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    running: dict[Any, list[J]] = {}
    broken = False
    while running or (waiting and not broken):
        workers = 1 if separate else max(1, pool.workers())
        while waiting and not broken and len(running) < ahead * workers:
            size = min(chunk_size, -(-len(waiting) // (CHUNKS_AHEAD * workers)))
            chunk = [waiting.popleft() for _ in range(size)]
            try:
                future = pool.submit(some, work, chunk)
            except DiedError:
                suspects += chunk
                broken = True
            else:
                running[future] = chunk
                future.add_done_callback(ended.put)
        for future in _taken(ended, pool) if running else ():
            chunk = running.pop(future)
            try:
                answers = pool.answer(future)
            except DiedError:
                suspects += chunk
                broken = True
                continue
            waiting.extendleft(reversed(chunk[len(answers) :]))
            yield from answers


def _taken(ended: "queue.SimpleQueue[Any]", pool: Pool) -> Iterator[Any]:
    """Wait for a finished future, then yield all finished futures.

    If no future has finished after `POLL` seconds, check the pool and yield nothing.
    """
    try:
        yield ended.get(timeout=POLL)
    except queue.Empty:
        pool.poll()
        return
    while not ended.empty():
        yield ended.get()


# -------------------------------------------------------------------------------------------------
# Worker processes on this machine, by the library loky, which is a part of joblib.

PARENT_CHECK = 1.0
"""Seconds after which a worker checks again that its parent process exists."""

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of a worker, in which libraries of linear algebra use one thread."""


class Processes:
    """Engine whose workers are processes of this machine.

    Parameters
    ----------
    number : int, optional
        Number of processes; by default the number of cores. Each process can use at most the
        available memory divided by this number.
    """

    def __init__(self, number: int | None = None) -> None:
        self.number = number

    @contextmanager
    def open(self, max_workers: int) -> Iterator["Local"]:
        """Yield a pool of processes, which are killed if the block raises an exception."""
        from joblib.externals.loky import ProcessPoolExecutor  # lazy: slow to import

        # If the processes are killed, the resource tracker of Python would warn of leaked locks.
        os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
        _begin_trackers()
        number = max(1, min(self.number or cores(), max_workers))
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
    """Return a `Cluster` if the address of a scheduler is given, else `number` processes."""
    return Cluster(scheduler) if scheduler else Processes(number)


class Local:
    """Pool of processes; if one dies, all jobs of the pool are lost."""

    def __init__(self, pool: Any, number: int) -> None:
        self.pool, self.number, self.died = pool, number, False

    def workers(self) -> int:
        """Return the number of processes."""
        return self.number

    def submit(self, function: Callable[..., object], *arguments: object) -> Future:
        """Call a function in one of the processes."""
        with self._reported_when_dead(), uninterrupted():
            future: Future = self.pool.submit(on_surface, surface.get(), function, *arguments)
            return future

    def answer(self, future: Any) -> Any:
        """Return the answer of a finished future, or raise `DiedError`."""
        with self._reported_when_dead():
            return future.result()

    def poll(self) -> None:
        """Do nothing: if a process dies, all futures of the pool end, so no check is needed."""

    @contextmanager
    def _reported_when_dead(self) -> Iterator[None]:
        from joblib.externals.loky.process_executor import BrokenProcessPool

        try:
            yield
        except BrokenProcessPool:
            self.died = True
            raise DiedError from None


def _begin_trackers() -> None:
    """Start Python's resource tracker before a block of `uninterrupted`, which delays Ctrl-C.

    In Python up to 3.13, a resource tracker that starts in such a block ends the delay too early.
    """
    if hasattr(signal, "pthread_sigmask"):
        from multiprocessing import resource_tracker

        resource_tracker.ensure_running()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay Ctrl-C to the end of the block.

    Processes that are started in the block never react to Ctrl-C, because their parent handles it.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(share: int | None, parent: int) -> None:
    """Limit a new worker to `share` bytes of memory, and make it exit after its parent has ended.

    `parent` is the id of the parent process. The worker cannot ask the system for this id, because
    the parent may have ended already.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from joblib.externals.loky import process_executor  # lazy: slow to import

    # By default, loky ends a worker that has grown by 0.3 GB. Large jobs need more memory, so this
    # limit is removed, and `limit_memory` sets another one. In a version of loky without
    # _MAX_MEMORY_LEAK_SIZE, the assignment has no effect.
    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize
    limit_memory(share)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def limit_memory(share: int | None) -> None:
    """Limit the memory of this process, if the system supports it."""
    if share is not None and sys.platform == "linux":
        import resource

        # RLIMIT_DATA counts memory that can be written. RLIMIT_AS would also count reserved memory.
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        if hard == resource.RLIM_INFINITY or share < hard:
            with suppress(ValueError, OSError):  # another program may have set a lower limit
                resource.setrlimit(resource.RLIMIT_DATA, (share, hard))


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK)
    os._exit(1)


# -------------------------------------------------------------------------------------------------
# Workers that are kept for several lists of jobs, because each start of workers takes a second.


class PersistentPool:
    """Engine that keeps one pool of another engine open, and replaces it after a worker has died.

    It is used in a ``with`` statement, whose end stops the workers.

    Parameters
    ----------
    engine : Engine
        Engine that opens the pools.
    max_workers : int
        Largest number of workers in each pool.
    patience : float
        Seconds for which the caller does the work itself before it opens the pool. Therefore, short
        work needs no workers.
    """

    def __init__(self, engine: Engine, max_workers: int, patience: float = 0.0) -> None:
        self.engine, self.max_workers, self.patience = engine, max_workers, patience
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

    def close(self) -> None:
        """End the workers; `open` then starts new ones."""
        self._stack.close()
        self._pool = None

    @contextmanager
    def open(self, max_workers: int) -> Iterator[Pool]:  # noqa: ARG002
        """Yield the pool that is kept open, whatever `max_workers` is."""
        if self._pool is None or self._pool.died:
            self._stack.close()
            self._pool = self._stack.enter_context(self.engine.open(self.max_workers))
        yield self._pool


# -------------------------------------------------------------------------------------------------
# Workers of an existing Dask scheduler.
#
# Errors and log messages of Dask are handled here, so that other modules know nothing of Dask.

CONNECT = 10.0
"""Seconds in which a scheduler must answer."""


class Cluster:
    """Engine whose workers are those of a Dask scheduler.

    Parameters
    ----------
    address : str
        Address such as ``tcp://host:8786``.
    """

    def __init__(self, address: str) -> None:
        self.address = address

    @contextmanager
    def open(self, max_workers: int) -> Iterator["Remote"]:  # noqa: ARG002
        """Yield a connection to all workers of the scheduler, whatever `max_workers` is.

        At the end of the block, Dask drops the jobs that have no answer yet.

        Raises
        ------
        ConfigError
            The extra is missing, or the scheduler does not answer or is lost.
        """
        try:
            from distributed import Client
            from distributed.versions import VersionMismatchWarning
        except ModuleNotFoundError:
            raise ConfigError(
                f"{option('scheduler')} needs the extra cluster: {install('cluster')}"
            ) from None
        self._reach()
        with _silent_logs():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", VersionMismatchWarning)
                client = Client(self.address, timeout=CONNECT, set_as_default=False)
            pool = Remote(self.address, client)
            try:
                yield pool
            finally:
                pool.close()

    def _reach(self) -> None:
        """Check that the scheduler answers.

        Raises
        ------
        ConfigError
            The scheduler does not answer.
        """
        import asyncio

        from distributed.comm import connect

        async def reach() -> None:
            comm = await connect(self.address, timeout=CONNECT)
            await comm.close()

        try:
            asyncio.run(reach())  # without this check, a `Client` would print messages much later
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"{option('scheduler', self.address)}: no Dask scheduler answers: "
                f"{files.reason(error)}"
            ) from None


@contextmanager
def _silent_logs() -> Iterator[None]:
    """Silence Dask in the block; this module reports a lost connection itself, in one line."""
    logs = [logging.getLogger(name) for name in logging.root.manager.loggerDict if _is_dask(name)]
    before = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for log, level in zip(logs, before, strict=True):
            log.setLevel(level)


def _is_dask(name: str) -> bool:
    return name.partition(".")[0] == "distributed"


class Remote:
    """Pool with the workers of a scheduler; Dask moves the jobs of a dead worker to another one."""

    def __init__(self, address: str, client: Any) -> None:
        self.address, self.client = address, client
        self._threads, self._counted = 0, -math.inf
        self._is_reported = self.died = False

    def workers(self) -> int:
        """Return the number of threads of all workers. It is updated at most once a second."""
        if time.monotonic() - self._counted > POLL:
            with self._lost_reported():
                self._threads = sum(self.client.nthreads().values())
            self._counted = time.monotonic()
        return self._threads

    def submit(self, function: Callable[..., object], *arguments: object) -> Future:
        """Call a function in a worker.

        Function and arguments are sent as bytes, which only the worker unpickles.
        """
        with self._lost_reported():
            content = pickle.dumps((on_surface, (surface.get(), function, *arguments)))
            # With pure=True, Dask would run a job only once even if it is submitted again.
            future: Future = self.client.submit(call_checked, content, __version__, pure=False)
            return future

    def answer(self, future: Any) -> Any:
        """Return the answer of a finished future.

        Raises
        ------
        DiedError
            All workers that tried the job died.
        ConfigError
            The connection to the scheduler is lost. Or workers lack the package, or have another
            version of it.
        """
        from distributed import KilledWorker

        try:
            with self._lost_reported():
                return future.result()
        except KilledWorker:
            self.died = True
            raise DiedError from None
        except ImportError as error:
            raise self._lacking(error) from None
        except RuntimeError as error:  # the scheduler itself may lack a package
            if isinstance(error.__cause__, ImportError):
                raise self._lacking(error.__cause__) from None
            raise

    def poll(self) -> None:
        """Tell the user if the scheduler has no workers, but only once."""
        if not self.workers() and not self._is_reported:
            self._is_reported = True
            files.announce(f"waiting for workers of {self.address}")

    def _lacking(self, error: ImportError) -> ConfigError:
        return ConfigError(
            f"{option('scheduler', self.address)}: {error}; install tgospa-eval {__version__} "
            "and its dependencies on the scheduler and its workers"
        )

    @contextmanager
    def _lost_reported(self) -> Iterator[None]:
        """Raise one kind of `ConfigError` for all errors of a lost connection in the block."""
        from concurrent.futures import CancelledError

        try:
            yield
        except (OSError, CancelledError):
            raise ConfigError(
                f"{option('scheduler', self.address)}: the connection was lost; stored results "
                "are kept, and the same command continues from them"
            ) from None

    def close(self) -> None:
        """Close the connection; Dask then drops the jobs that have no answer yet."""
        with suppress(OSError, RuntimeError):
            self.client.close()


def call_checked(content: bytes, version: str) -> Any:
    """Unpickle a function and its arguments in a worker, and call it.

    Raises
    ------
    ConfigError
        The worker has another version of this package than `version`.
    """
    if version != __version__:
        raise ConfigError(
            f"the worker on {socket.gethostname()} has tgospa-eval {__version__}, this process "
            f"has {version}: install the same version"
        )
    function, arguments = pickle.loads(content)
    return function(*arguments)


# -------------------------------------------------------------------------------------------------
# A helper process for compiled code that can crash on damaged data. A crash ends only the helper.
#
# The helper starts at the first call, and ends when this process ends.

SERVE = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from tgospa_eval.engines import serve; serve()"
)

_lock = threading.Lock()


def call_in_helper(function: Callable[..., Any], *arguments: object) -> Any:
    """Call a function of a module in the helper process.

    Raises
    ------
    OSError
        No process can be started.
    DiedError
        The process ended; the message has its exit status.
    Exception
        The function raised this error.
    """
    with _lock:
        is_done, result = _answer(
            _started(os.getpid()), (on_surface, (surface.get(), function, *arguments))
        )
    if not is_done:
        raise result
    return result


@cache
def _started(parent: int) -> Any:  # noqa: ARG001
    """Start the helper process at the first call, and return it.

    `parent` is the id of the calling process. It is the key of the cache, because a forked process
    must not use the helper of its parent.

    Raises
    ------
    OSError
        No process can be started, or it ended at its start.
    """
    with uninterrupted():
        process: Any = subprocess.Popen(
            [sys.executable, "-c", SERVE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | ONE_THREAD,
        )
    atexit.register(process.__exit__, None, None, None)
    try:
        _answer(process, sys.path)
    except DiedError as error:
        raise OSError(f"it ended at its start, with {error}") from None
    return process


def _answer(process: Any, message: object) -> Any:
    """Send a message to the helper process, and return the answer.

    Raises
    ------
    DiedError
        The process ended.
    """
    try:
        pickle.dump(message, process.stdin, pickle.HIGHEST_PROTOCOL)
        process.stdin.flush()
        return pickle.load(process.stdout)
    except BaseException as error:  # also Ctrl-C: otherwise the next call would read this answer
        _started.cache_clear()
        process.kill()
        process.communicate()
        if isinstance(error, OSError | EOFError | pickle.UnpicklingError):
            raise DiedError(f"status {process.returncode}") from None
        raise


def serve() -> None:
    """Read calls from standard input and write answers to standard output, until input ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # text that a library prints goes to stderr, not between the answers
    result: tuple[bool, object] = True, None
    while True:
        pickle.dump(result, answers, pickle.HIGHEST_PROTOCOL)
        answers.flush()
        try:
            function, arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            result = True, function(*arguments)
        except Exception as error:
            result = False, error
