"""Work for processes of batches, some of it fatal."""

import os
import signal
import time
from pathlib import Path

FATAL = 13
"""The job that kills whoever does it."""

FATAL_ONCE = 7
"""The job that kills only the first who does it."""


def double(job: int) -> int:
    """Twice the job."""
    if job == FATAL or (job == FATAL_ONCE and not Path("once").exists()):
        Path("once").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * job


def slow(job: int) -> int:
    """A process that does it."""
    time.sleep(0.02)
    return os.getpid()


def greedy(gigabytes: int) -> str:
    """Whether so much memory is there."""
    try:
        return f"had {len(bytearray(gigabytes << 30)) >> 30} GiB"
    except MemoryError:
        return "had no memory"
