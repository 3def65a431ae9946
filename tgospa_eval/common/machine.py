"""Properties of this machine: compiled extension modules, cores, memory, threads."""

import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from contextvars import copy_context
from importlib import import_module
from itertools import islice
from typing import Any, TypeVar

from tgospa_eval.common.files import reason


def compiled(name: str) -> Any:
    """Import a compiled extension module; return None if it is missing or disabled.

    Without the module, callers use slower code. ``TGOSPA_EVAL_KERNEL=numpy`` disables all compiled
    modules.
    """
    if os.environ.get("TGOSPA_EVAL_KERNEL") == "numpy":
        return None
    try:
        return import_module(name)
    except ImportError:
        return None


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


# -------------------------------------------------------------------------------------------------
# Memory: its size, and the errors that mean a lack of it.

MEMINFO = "/proc/meminfo"
CONTAINER = "/sys/fs/cgroup/memory.max"

NO_MEMORY = (
    "annot allocate memory",
    "failed to map segment",
    "bad_alloc",
    "start new thread",
    "without exception set",
)
"""Parts of messages by which systems, library loaders and Python report a lack of memory."""


def available_memory() -> int | None:
    """Return the number of available bytes of memory; None if the system is not Linux."""
    with suppress(OSError, ValueError), open(MEMINFO, encoding="ascii") as file:
        for line in file:
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    return None


def machine_memory() -> int | None:
    """Return the bytes of memory of the machine, or of its container if the container has less."""
    sizes = []
    with suppress(OSError, ValueError, AttributeError):
        sizes.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with suppress(OSError, ValueError), open(CONTAINER, encoding="ascii") as file:
        sizes.append(int(file.read()))  # ValueError for "max", which means no limit
    return min(sizes, default=None)


def release_freed() -> None:
    """Give freed memory back to the system. By default, the C library and Arrow keep it."""
    import ctypes  # lazy: only data in parts need it

    if "pyarrow" in sys.modules:
        sys.modules["pyarrow"].default_memory_pool().release_unused()
    with suppress(OSError, AttributeError, TypeError):  # only glibc has `malloc_trim`
        ctypes.CDLL(None).malloc_trim(0)


def is_of_memory(error: BaseException | None) -> bool:
    """Return whether an error, or an error that caused it, means a lack of memory."""
    while error is not None:
        if isinstance(error, MemoryError) or any(text in str(error) for text in NO_MEMORY):
            return True
        error = error.__cause__ or error.__context__
    return False


def fault_of(error: BaseException) -> str:
    """Return a message about an error that no code handles."""
    if is_of_memory(error):
        return "out of memory"
    if isinstance(error, OSError):
        return f"{error.filename or 'writing'}: {reason(error)}"
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return f"{text}; this is an error of this program, please report it"


# -------------------------------------------------------------------------------------------------
# Work in threads, with answers in order.

T = TypeVar("T")
R = TypeVar("R")

AHEAD = 2
"""Number of calls for each thread that are submitted ahead. It is small, because results that wait
need memory."""


def in_order(work: Callable[[T], R], items: Iterable[T], threads: int) -> Iterator[R]:
    """Call a function for each item in threads, and yield the answers in the order of the items.

    Parameters
    ----------
    work : callable
        Function that receives an item; it is called in any of the threads.
    items : iterable
        Items.
    threads : int
        Number of threads. If it is 1, no thread is started.
    """
    if threads <= 1:
        yield from map(work, items)
        return
    from concurrent.futures import ThreadPoolExecutor  # lazy: most runs need no threads

    left = iter(items)
    with ThreadPoolExecutor(threads) as pool:
        waiting = deque(
            pool.submit(copy_context().run, work, item) for item in islice(left, AHEAD * threads)
        )
        while waiting:
            answer = waiting.popleft().result()
            waiting.extend(pool.submit(copy_context().run, work, item) for item in islice(left, 1))
            yield answer
