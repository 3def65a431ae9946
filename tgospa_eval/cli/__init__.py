"""Command line: a group of verbs, each imported when it is used."""

import atexit
import gc
import io
import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress

import click

from tgospa_eval.cli.shared.streams import (
    check_stdout,
    check_written,
    interrupted,
    print_notice,
    print_notices,
)
from tgospa_eval.cli.verbs import CONFIG, cli
from tgospa_eval.common import files
from tgospa_eval.common.machine import is_of_memory
from tgospa_eval.errors import ConfigError, ExitStatus, TgospaError
from tgospa_eval.quoting import COMMAND, spelled_for

# -------------------------------------------------------------------------------------------------
# Under a limit of memory (``ulimit -v``) a child does the work.
#
# Compiled code that gets no memory aborts, or exits with any status, even that of a regression. The
# parent process is left to report the lack of memory.

FATAL = ("SIGABRT", "SIGSEGV", "SIGBUS", "SIGILL", "SIGTRAP")
"""Signals that end a program without memory; other signals have other causes."""

PASSED_ON = ("SIGINT", "SIGTERM", "SIGHUP")


def guarded(work: Callable[[], int], interrupted: int) -> int:
    """Do the work and return its status, or 4 if it ended without a status.

    Parameters
    ----------
    work : callable
        Callable that returns the status.
    interrupted : int
        Status of the work if it was interrupted.
    """
    limit = _limit()
    if limit is None:
        return work()
    done, mark = os.pipe()
    passed_on = {getattr(signal, name) for name in PASSED_ON}
    signal.pthread_sigmask(signal.SIG_BLOCK, passed_on)  # signals wait until a child exists
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
        with suppress(OSError):  # two of the signals cannot have a handler
            signal.signal(-status, signal.SIG_DFL)
        os.kill(os.getpid(), -status)
    print_notice(f"out of memory: {limit >> 20} MiB are allowed (ulimit -v), which is too little")
    return ExitStatus.NOT_REACHED


def _limit() -> int | None:
    """Return bytes that the process may take, if there is a limit."""
    if sys.platform == "win32":
        return None
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if soft == resource.RLIM_INFINITY else soft


NEW_OBJECTS = 50_000
"""Number of new objects that starts garbage collection, which finds next to nothing. Python's
default of 700 costs 3 % of the time of a small evaluation, and 4 % with pictures."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with the status of docs/reference/cli.md."""
    # Memory is freed with the process: to search all modules for cycles first takes as long as
    # a small evaluation.
    atexit.register(gc.freeze)
    if arguments is None:  # a process of its own
        gc.set_threshold(NEW_OBJECTS)
        # Matrices are small: threads of BLAS cost more time to start than a small evaluation takes.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    files.announce = print_notice

    def work() -> int:
        try:
            with spelled_for(COMMAND):
                return _run(arguments)
        except Exception as error:
            _print_internal(error)
            return ExitStatus.NOT_REACHED

    sys.exit(guarded(work, ExitStatus.INTERRUPTED) if arguments is None else work())


def _run(arguments: Sequence[str] | None) -> int:
    """Run the command line and return the exit status."""
    status: int | None
    try:
        status = _invoke(None if arguments is None else list(arguments))
        if interrupted():  # does not wait for threads that are still in compiled code
            _end_interrupted()
    except SystemExit:  # click exits with 1 where a pipe has no reader
        status = 0
    except TgospaError as error:
        print_notices(str(error))
        status = error.exit_status
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        if context is not None and context.meta.get(CONFIG):
            print_notice(str(context.meta[CONFIG]))
        text = io.StringIO()
        error.show(file=text)
        short = text.getvalue().replace(" --help-all' for help", " -h' for help")
        print_notices(short.rstrip("\n"))
        status = max(error.exit_code, ExitStatus.WRONG_OPTION)
    except (KeyboardInterrupt, click.Abort):
        print_notice("interrupted")
        _end_interrupted()  # a solver may be deep in compiled code, in its own thread
    except (OSError, MemoryError, ImportError, RuntimeError, SystemError) as error:
        status = _print_lacking(error)
    return status or 0


def _print_lacking(error: Exception) -> int:
    """Report a lack of memory, disk or threads, which is not a bug; return the status."""
    if is_of_memory(error):
        print_notice("out of memory; a smaller cutoff leaves fewer pairs")
        return ExitStatus.NOT_REACHED
    if not isinstance(error, OSError):
        raise error
    where = "" if error.filename is None else f"{error.filename}: "
    print_notice(f"{where}{files.reason(error)}")
    return ConfigError.exit_status


def _end_interrupted() -> None:
    """End at once, with what was printed."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(ExitStatus.INTERRUPTED)


def _invoke(arguments: list[str] | None) -> int | None:
    """Run the command line, and check that its output was written."""
    if sys.stderr is None:  # otherwise the next file that is opened takes its number
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    check_stdout()
    try:
        status: int | None = cli.main(
            args=arguments, prog_name="tgospa-eval", standalone_mode=False
        )
    except OSError as error:  # click prints the help and may fail
        check_written(error)
        raise
    return status


def _print_internal(error: Exception) -> None:
    """Print the traceback of a bug, and a sentence."""
    import traceback  # lazy: there should be none

    print_notices("".join(traceback.format_exception(error)).rstrip("\n"))
    print_notice(f"internal error: {type(error).__name__}: {error}; please report it")
