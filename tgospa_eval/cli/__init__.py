"""Command line ``tgospa-eval``: its entry point, and the exit status of errors."""

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
# If memory is limited (``ulimit -v``), a child process does the work.
#
# Compiled code that gets no memory can abort, or exit with any status. Status 1 would even mean a
# regression. In all these cases, the parent process reports a lack of memory.

FATAL = ("SIGABRT", "SIGSEGV", "SIGBUS", "SIGILL", "SIGTRAP")
"""Signals that can end a process because it lacks memory; other signals have other causes."""

PASSED_ON = ("SIGINT", "SIGTERM", "SIGHUP")


def guarded(work: Callable[[], int], interrupted: int) -> int:
    """Do the work and return its exit status; 4 if a lack of memory ended it.

    Parameters
    ----------
    work : callable
        Function that does the work and returns the exit status.
    interrupted : int
        Exit status if the user interrupts the work.
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
        os.setpgid(0, 0)  # Ctrl-C reaches only the parent, which passes it on
        # Each thread takes address space. If there is too little, OpenBLAS hangs or sends SIGINT.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        status = work()
        os.write(mark, b"\n")
        return status
    os.close(mark)
    heard: list[int] = []

    def pass_on(number: int, _: object) -> None:
        heard.append(number)
        # The second Ctrl-C kills the child, because compiled code may not react to the first one.
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
        with suppress(OSError):  # SIGKILL and SIGSTOP cannot have a handler
            signal.signal(-status, signal.SIG_DFL)
        os.kill(os.getpid(), -status)
    print_notice(f"out of memory: {limit >> 20} MiB are allowed (ulimit -v), which is too little")
    return ExitStatus.NOT_REACHED


def _limit() -> int | None:
    """Return the limit of memory of this process in bytes; None if there is none."""
    if sys.platform == "win32":
        return None
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if soft == resource.RLIM_INFINITY else soft


NEW_OBJECTS = 50_000
"""Number of new objects after which Python searches for garbage. An evaluation makes almost no
garbage. With Python's default of 700, the searches take 3 % of the time of a small evaluation, and
4 % with pictures."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line, and exit with a status that docs/reference/cli.md describes.

    `arguments` are by default those of the process.
    """
    # At exit, Python would search all modules for garbage. That takes as long as a small evaluation
    # and is of no use, because the memory of the process is freed anyway.
    atexit.register(gc.freeze)
    if arguments is None:  # the process is the command, not a program of the user
        gc.set_threshold(NEW_OBJECTS)
        # Matrices are small, and the start of BLAS threads takes longer than a small evaluation.
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
        if interrupted():  # end without waiting for threads that are still in compiled code
            _end_interrupted()
    except SystemExit:  # click exits with 1 if nobody reads a pipe, which is no error
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
        _end_interrupted()  # end without waiting for a thread of a solver
    except (OSError, MemoryError, ImportError, RuntimeError, SystemError) as error:
        status = _print_lacking(error)
    return status or 0


def _print_lacking(error: Exception) -> int:
    """Report a lack of memory, of space on a disk or of threads, and return the exit status.

    Any other error is raised again, because it is a bug.
    """
    if is_of_memory(error):
        print_notice("out of memory; a smaller cutoff leaves fewer pairs")
        return ExitStatus.NOT_REACHED
    if not isinstance(error, OSError):
        raise error
    where = "" if error.filename is None else f"{error.filename}: "
    print_notice(f"{where}{files.reason(error)}")
    return ConfigError.exit_status


def _end_interrupted() -> None:
    """End the process at once. What was printed before is still written."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(ExitStatus.INTERRUPTED)


def _invoke(arguments: list[str] | None) -> int | None:
    """Run the command line, and check that its output was written."""
    if sys.stderr is None:  # otherwise the next opened file would get number 2
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    check_stdout()
    try:
        status: int | None = cli.main(
            args=arguments, prog_name="tgospa-eval", standalone_mode=False
        )
    except OSError as error:  # for example if click cannot write the help
        check_written(error)
        raise
    return status


def _print_internal(error: Exception) -> None:
    """Print the traceback of a bug, and ask the user to report it."""
    import traceback  # lazy: only for bugs

    print_notices("".join(traceback.format_exception(error)).rstrip("\n"))
    print_notice(f"internal error: {type(error).__name__}: {error}; please report it")
