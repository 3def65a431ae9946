"""Work in threads, its results in order."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")

AHEAD = 2
"""Results for each thread that wait to be taken, so that they take no more memory than that."""


def in_order(work: Callable[[T], R], items: Iterable[T], threads: int) -> Iterator[R]:
    """As `map`, in so many threads.

    Parameters
    ----------
    work : callable
        Called in any of the threads.
    items : iterable
        What it is called with.
    threads : int
        With 1 none is started.
    """
    if threads <= 1:
        yield from map(work, items)
        return
    from concurrent.futures import ThreadPoolExecutor  # here: most runs do without

    left = iter(items)
    with ThreadPoolExecutor(threads) as pool:
        waiting = deque(pool.submit(work, item) for item in islice(left, AHEAD * threads))
        while waiting:
            found = waiting.popleft().result()
            waiting.extend(pool.submit(work, item) for item in islice(left, 1))
            yield found
