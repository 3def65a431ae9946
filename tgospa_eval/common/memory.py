"""How much memory there is, and which errors come from having none."""

import os
from contextlib import suppress

MEMINFO = "/proc/meminfo"
CONTAINER = "/sys/fs/cgroup/memory.max"

NO_MEMORY = (
    "annot allocate memory",
    "failed to map segment",
    "bad_alloc",
    "start new thread",
    "without exception set",
)
"""Messages of systems, loaders of libraries and Python where there is none left."""


def available_memory() -> int | None:
    """Bytes of memory that are available, as Linux counts them."""
    with suppress(OSError, ValueError), open(MEMINFO, encoding="ascii") as file:
        for line in file:
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    return None


def machine_memory() -> int | None:
    """Bytes of memory of the machine, or of the container that this runs in if that has less."""
    found = []
    with suppress(OSError, ValueError, AttributeError):
        found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with suppress(OSError, ValueError), open(CONTAINER, encoding="ascii") as file:
        found.append(int(file.read()))  # or max, which is no number
    return min(found, default=None)


def is_of_memory(error: BaseException | None) -> bool:
    """Whether an error, or one behind it, is for want of memory, as libraries need some as well."""
    while error is not None:
        if isinstance(error, MemoryError) or any(text in str(error) for text in NO_MEMORY):
            return True
        error = error.__cause__ or error.__context__
    return False
