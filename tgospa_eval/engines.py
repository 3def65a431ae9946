"""Engines that do jobs in chunks, and try jobs of dead workers again.

An engine opens pools of workers, and jobs are submitted to a pool. `Processes` are workers of this
machine (loky, from joblib). A `Cluster` has the workers of an existing Dask scheduler; errors and
output of Dask stay in this module. `call_in_helper` uses one more process, for compiled code that
damaged data may crash.
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
"""Seconds after which a worker returns its finished answers and gives back other jobs."""

POLL = 1.0
"""Seconds between checks of a pool without answers."""

CHUNKS_AHEAD = 4
"""Remaining jobs are divided into this number of chunks for each worker, so chunks shrink."""


class DiedError(Exception):
    """Error that the process of a job died, or each of several processes that tried it."""


class Future(Protocol):
    """Future of an engine."""

    def add_done_callback(self, function: Callable[[Any], object], /) -> object:
        """Call a function with this future when it has ended."""


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
        """Do regular checks while there is no answer."""


class Engine(Protocol):
    """Opener of pools that do jobs."""

    def open(self, max_workers: int) -> AbstractContextManager[Pool]:
        """Yield a pool with at most `max_workers`; an exception in the block ends its work."""


ATTEMPTS = ((32, 2, False), (1, 1, False), (1, 1, True))
"""Settings of the attempts at a job: largest number of jobs in a chunk; number of chunks that each
worker has; whether the job runs alone. If a worker dies, jobs of all its chunks are tried again in
smaller groups, to find the job that caused the death."""


def spread(
    work: Callable[[J], R], jobs: Sequence[J], lost: Callable[[J], R], engine: Engine
) -> Generator[R, None, None]:
    """Do the jobs, and yield answers as they are ready.

    Jobs of a worker that died are tried again by the rules of `ATTEMPTS`. If a worker dies while no
    other job runs, its job gets the answer of `lost`.
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
    """Return the answers of the first jobs of a chunk: at least one, for about `CHUNK_SECONDS`."""
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
    """Yield answers of waiting jobs until a worker dies or no job is left."""
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
    """Yield the finished futures: at least one, or none after a while."""
    try:
        yield ended.get(timeout=POLL)
    except queue.Empty:
        pool.poll()
        return
    while not ended.empty():
        yield ended.get()


# -------------------------------------------------------------------------------------------------
# Worker processes on this machine: loky, as joblib brings it.

PARENT_CHECK = 1.0
"""Seconds between checks that the parent process exists."""

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Settings of linear algebra libraries before they are loaded."""


class Processes:
    """Processes of this machine.

    Parameters
    ----------
    number : int, optional
        Number of processes; by default the number of cores. Each process may use its share of
        the available memory.
    """

    def __init__(self, number: int | None = None) -> None:
        self.number = number

    @contextmanager
    def open(self, max_workers: int) -> Iterator["Local"]:
        """Yield processes that end at once when the work is interrupted."""
        from joblib.externals.loky import ProcessPoolExecutor  # lazy: slow to import

        # The process that tracks the locks of a pool would complain if the pool ends early.
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
    """Return the workers of a scheduler, if an address is given, else processes of this machine."""
    return Cluster(scheduler) if scheduler else Processes(number)


class Local:
    """Pool of processes; if one dies, all jobs of the pool are lost."""

    def __init__(self, pool: Any, number: int) -> None:
        self.pool, self.number, self.died = pool, number, False

    def workers(self) -> int:
        """Return the number of processes."""
        return self.number

    def submit(self, function: Callable[..., object], *arguments: object) -> Future:
        """Have a function called."""
        with self._reported_when_dead(), uninterrupted():
            future: Future = self.pool.submit(on_surface, surface.get(), function, *arguments)
            return future

    def answer(self, future: Any) -> Any:
        """Return the answer."""
        with self._reported_when_dead():
            return future.result()

    def poll(self) -> None:
        """Do nothing: the death of a process ends its futures."""

    @contextmanager
    def _reported_when_dead(self) -> Iterator[None]:
        from joblib.externals.loky.process_executor import BrokenProcessPool

        try:
            yield
        except BrokenProcessPool:
            self.died = True
            raise DiedError from None


def _begin_trackers() -> None:
    """Begin the helper processes of loky first, as Python up to 3.13 lets Ctrl-C through then."""
    if hasattr(signal, "pthread_sigmask"):
        from multiprocessing import resource_tracker

        resource_tracker.ensure_running()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay Ctrl-C; processes that begin in the block ignore it, as their parent handles it."""
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(share: int | None, parent: int) -> None:
    """Limit a worker to its share of the memory, and end it together with its parent.

    The id of the parent is an argument, because the parent may have ended already.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from joblib.externals.loky import process_executor  # lazy: slow to import

    # Loky considers a growth by 0.3 GB a leak, but large jobs need it, and `share` limits memory.
    # If a version of loky has no such number, this has no effect.
    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize
    limit_memory(share)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def limit_memory(share: int | None) -> None:
    """Limit the memory of this process, if the system supports it."""
    if share is not None and sys.platform == "linux":
        import resource

        # This limits memory that can be written; address space includes memory only reserved.
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        if hard == resource.RLIM_INFINITY or share < hard:
            with suppress(ValueError, OSError):  # another program may have set a lower limit
                resource.setrlimit(resource.RLIMIT_DATA, (share, hard))


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK)
    os._exit(1)


# -------------------------------------------------------------------------------------------------
# Workers that are kept from one list of jobs to the next, because a start takes a second each.


class PersistentPool:
    """Engine that keeps one pool of another engine open, and replaces it after a worker has died.

    It is used in a ``with`` statement, whose end stops the workers.

    Parameters
    ----------
    engine : Engine
        Engine that opens the pools.
    max_workers : int
        Requested number of workers.
    patience : float
        Seconds of work that the caller does itself before workers start. Shorter work ends without
        workers.
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
        """End the workers; others begin when the pool is opened again."""
        self._stack.close()
        self._pool = None

    @contextmanager
    def open(self, max_workers: int) -> Iterator[Pool]:  # noqa: ARG002  (it has the workers it has)
        """Yield the open pool."""
        if self._pool is None or self._pool.died:
            self._stack.close()
            self._pool = self._stack.enter_context(self.engine.open(self.max_workers))
        yield self._pool


# -------------------------------------------------------------------------------------------------
# Workers of the cluster of an existing Dask scheduler.
#
# Errors and output of Dask stay in this module.

CONNECT = 10.0
"""Seconds in which a scheduler must answer."""


class Cluster:
    """Workers of a Dask scheduler.

    Parameters
    ----------
    address : str
        Address such as ``tcp://host:8786``.
    """

    def __init__(self, address: str) -> None:
        self.address = address

    @contextmanager
    def open(self, max_workers: int) -> Iterator["Remote"]:  # noqa: ARG002  (it has the workers it has)
        """Yield a connection; running work is cancelled on an interruption.

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
            asyncio.run(reach())  # a client without scheduler would print messages long after
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"{option('scheduler', self.address)}: no Dask scheduler answers: "
                f"{files.reason(error)}"
            ) from None


@contextmanager
def _silent_logs() -> Iterator[None]:
    """Silence the messages of Dask about lost connections, which are reported in one line."""
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
    """Connection to the workers; Dask itself moves the jobs of a dead worker to another one."""

    def __init__(self, address: str, client: Any) -> None:
        self.address, self.client = address, client
        self._threads, self._counted = 0, -math.inf
        self._is_reported = self.died = False

    def workers(self) -> int:
        """Return the number of threads of all workers, as known at most a second ago."""
        if time.monotonic() - self._counted > POLL:
            with self._lost_reported():
                self._threads = sum(self.client.nthreads().values())
            self._counted = time.monotonic()
        return self._threads

    def submit(self, function: Callable[..., object], *arguments: object) -> Future:
        """Call a function; the scheduler only sees bytes."""
        with self._lost_reported():
            content = pickle.dumps((on_surface, (surface.get(), function, *arguments)))
            # Not pure: a job may be submitted twice.
            future: Future = self.client.submit(call_checked, content, __version__, pure=False)
            return future

    def answer(self, future: Any) -> Any:
        """Return the answer.

        Raises
        ------
        DiedError
            All workers that tried the job died.
        ConfigError
            The scheduler is lost, or workers have another version or lack the package.
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
        except RuntimeError as error:  # the scheduler may fail while it passes the answer on
            if isinstance(error.__cause__, ImportError):
                raise self._lacking(error.__cause__) from None
            raise

    def poll(self) -> None:
        """Report once that there are no workers."""
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
        """Raise all errors of a lost connection as one error."""
        from concurrent.futures import CancelledError

        try:
            yield
        except (OSError, CancelledError):
            raise ConfigError(
                f"{option('scheduler', self.address)}: the connection was lost; stored results "
                "are kept, and the same command continues from them"
            ) from None

    def close(self) -> None:
        """Leave the cluster; jobs that have not begun are dropped."""
        with suppress(OSError, RuntimeError):
            self.client.close()


def call_checked(content: bytes, version: str) -> Any:
    """Call a function in a worker.

    Raises
    ------
    ConfigError
        The worker has another version of this package.
    """
    if version != __version__:
        raise ConfigError(
            f"the worker on {socket.gethostname()} has tgospa-eval {__version__}, this process "
            f"has {version}: install the same version"
        )
    function, arguments = pickle.loads(content)
    return function(*arguments)


# -------------------------------------------------------------------------------------------------
# A helper process for compiled code that damaged data may crash, so that only the helper ends.
#
# It starts with the first call, and ends with this process.

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
        The process ended; the message has its status.
    Exception
        Any error of the function.
    """
    with _lock:
        is_done, result = _answer(
            _started(os.getpid()), (on_surface, (surface.get(), function, *arguments))
        )
    if not is_done:
        raise result
    return result


@cache
def _started(parent: int) -> Any:  # noqa: ARG001  (a forked process has no helper)
    """Start the process."""
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
    """Return the answer of the process."""
    try:
        pickle.dump(message, process.stdin, pickle.HIGHEST_PROTOCOL)
        process.stdin.flush()
        return pickle.load(process.stdout)
    except BaseException as error:  # also on Ctrl-C: nobody waits for later answers
        _started.cache_clear()
        process.kill()
        process.communicate()
        if isinstance(error, OSError | EOFError | pickle.UnpicklingError):
            raise DiedError(f"status {process.returncode}") from None
        raise


def serve() -> None:
    """Answer calls until the calling process ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # text that a library prints goes to stderr
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
