"""Jobs to answers, over any engine: in chunks, as long as one lives that can do them.

An engine opens pools; of a pool nothing is used but `submit`, and callbacks of its futures
(`engines.processes` and `engines.cluster` have them).
"""

import queue
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol, TypeVar

J = TypeVar("J")
R = TypeVar("R")

CHUNK_SECONDS = 1.0
"""Seconds after which a worker hands back what is ready, and what of its chunk is not begun."""

POLL = 1.0
"""Seconds between looks at a pool while nothing comes."""

CHUNKS_AHEAD = 4
"""Chunks for each worker into which what is left would be cut: they become smaller at the end."""


class DiedError(Exception):
    """The process that worked on it died, or each of several that tried."""


class Future(Protocol):
    """Of an engine."""

    def add_done_callback(self, function: Callable[[Any], object], /) -> object:
        """Call a function with this future when it has ended."""


class Pool(Protocol):
    """Workers that are there."""

    @property
    def died(self) -> bool:
        """Whether a worker has, so that another pool is wanted."""

    def workers(self) -> int:
        """How many jobs are worked on at once."""

    def submit(self, function: Callable[..., R], *arguments: object) -> Future:
        """Have a function called in a worker; raises `DiedError` where there is none any more."""

    def answer(self, future: Any) -> Any:
        """What came out of a future that has ended; raises `DiedError`."""

    def look(self) -> None:
        """Called every now and then while nothing comes."""


class Engine(Protocol):
    """Where jobs are done."""

    def open(self, most: int) -> AbstractContextManager[Pool]:
        """Have workers, so many at most; left by an exception it ends their work at once."""


ATTEMPTS = ((32, 2, False), (1, 1, False), (1, 1, True))
"""How jobs are tried: how many in a chunk; chunks that are with each worker, which are all tried
again if one of them dies; whether nothing else is worked on meanwhile. What was with a dying worker
is tried again with fewer beside it: one job is to blame."""


def spread(
    work: Callable[[J], R], jobs: Sequence[J], lost: Callable[[J], R], engine: Engine
) -> Generator[R, None, None]:
    """Do the jobs; answers come as they are ready.

    Jobs that were with a worker that died are tried again as `ATTEMPTS` has it; a job whose worker
    dies when it is alone is answered by `lost`.
    """
    left: Sequence[J] = jobs
    for most, ahead, alone in ATTEMPTS:
        waiting, suspects = deque(left), list[J]()
        while waiting:
            with engine.open(1 if alone else len(waiting)) as pool:
                yield from _until_one_dies(work, waiting, suspects, pool, most, ahead, alone)
        left = suspects
    yield from map(lost, left)


def some(work: Callable[[J], R], chunk: Sequence[J]) -> list[R]:
    """The answers of the first jobs of a chunk: at least one, and what is ready in a second."""
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
    most: int,
    ahead: int,
    alone: bool,
) -> Iterator[R]:
    """Answers of the jobs that wait, until a worker dies or none is left."""
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    running: dict[Any, list[J]] = {}
    broken = False
    while running or (waiting and not broken):
        workers = 1 if alone else max(1, pool.workers())
        while waiting and not broken and len(running) < ahead * workers:
            size = min(most, -(-len(waiting) // (CHUNKS_AHEAD * workers)))
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
    """The futures that have ended; one at least, or none after a while."""
    try:
        yield ended.get(timeout=POLL)
    except queue.Empty:
        pool.look()
        return
    while not ended.empty():
        yield ended.get()
