"""Under a limit of memory (``ulimit -v``) a child does the work.

Compiled code that gets no memory aborts, or exits with a status of its own choosing, which might be
that of a regression; this one is left to report it.
"""

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress

from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.errors import ExitStatus

FATAL = ("SIGABRT", "SIGSEGV", "SIGBUS", "SIGILL", "SIGTRAP")
"""Ends of programs that do without their memory; other signals come from others."""

PASSED_ON = ("SIGINT", "SIGTERM", "SIGHUP")


def guarded(work: Callable[[], int], interrupted: int) -> int:
    """Do the work; its status, or 4 if it ended without one.

    Parameters
    ----------
    work : callable
        Gives the status.
    interrupted : int
        The status with which it may end of itself.
    """
    limit = _limit()
    if limit is None:
        return work()
    done, mark = os.pipe()
    passed_on = {getattr(signal, name) for name in PASSED_ON}
    signal.pthread_sigmask(signal.SIG_BLOCK, passed_on)  # until there is a child to pass them on to
    try:
        child = os.fork()
    except OSError:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, passed_on)
        return work()
    if child == 0:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, passed_on)
        os.setpgid(0, 0)  # a terminal interrupts only the parent, which passes it on
        # Each thread takes address space; without it OpenBLAS waits for ever, or interrupts us.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        status = work()
        os.write(mark, b"\n")
        return status
    os.close(mark)
    heard: list[int] = []

    def pass_on(number: int, _: object) -> None:
        heard.append(number)
        # The second Ctrl-C ends the work at once, also where compiled code answers no signal.
        os.kill(child, signal.SIGKILL if heard.count(signal.SIGINT) > 1 else number)

    for number in passed_on:
        signal.signal(number, pass_on)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, passed_on)
    finished = os.read(done, 1)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if heard.count(signal.SIGINT) > 1:
        return interrupted
    if finished or status == interrupted:
        return status
    if status < 0 and signal.Signals(-status).name not in FATAL:
        with suppress(OSError):  # of the two that have no handler
            signal.signal(-status, signal.SIG_DFL)
        os.kill(os.getpid(), -status)
    print_notice(f"out of memory: {limit >> 20} MiB are allowed (ulimit -v), which is too little")
    return ExitStatus.NOT_REACHED


def _limit() -> int | None:
    """Bytes that the process may take, if there is a limit."""
    if sys.platform == "win32":
        return None
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if soft == resource.RLIM_INFINITY else soft
