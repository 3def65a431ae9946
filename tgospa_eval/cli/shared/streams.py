"""Text on stdout and stderr, errors of writing, and Ctrl-C.

Names in files can contain control characters, or commands that a CI system reads from its log. Both
are escaped here, as a last line of defence. One exception: ``gate`` prints commands for CI systems
on purpose.
"""

import errno
import os
import signal
import stat
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING

import click

from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import visible, visible_lines

if TYPE_CHECKING:
    from tgospa_eval.common.notices import Notice

_heard = threading.Event()


def interrupted() -> bool:
    """Return whether this process has received a Ctrl-C in a block of `on_interrupt`."""
    return _heard.is_set()


@contextmanager
def on_interrupt(take: Callable[[], bool]) -> Iterator[None]:
    """Call `take` at each Ctrl-C while the block runs.

    If `take` returns false, KeyboardInterrupt is raised as usual. Nothing changes if this process
    ignores Ctrl-C or has another handler for it.
    """
    if not handles_interrupts():
        yield
        return
    before = signal.getsignal(signal.SIGINT)

    def answer(number: int, frame: FrameType | None) -> None:
        _heard.set()
        if not take():
            signal.default_int_handler(number, frame)

    signal.signal(signal.SIGINT, answer)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def shielded() -> Iterator[None]:
    """Let the block run to its end in spite of a first Ctrl-C; a second one stops it.

    After the block the caller asks `interrupted`, and ends the program.
    """
    waiting: list[int] = []

    def take() -> bool:
        waiting.append(1)
        return len(waiting) == 1

    with on_interrupt(take):
        yield


def handles_interrupts() -> bool:
    """Return whether Ctrl-C raises KeyboardInterrupt here.

    It does not in worker processes, which ignore it, nor in other threads.
    """
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler


CI = ("CI", "GITHUB_ACTIONS", "TF_BUILD", "TEAMCITY_VERSION")
"""Environment variables that CI systems set. These systems search stdout for commands."""

NARROW_TERMINAL = 20
"""Smallest number of columns of a terminal for which lines are wrapped."""

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
"""Error numbers of the system for failures to write to an open file."""


def print_notice(text: str) -> None:
    """Print a notice as a line on stderr, wrapped on a terminal."""
    print_raw(_wrapped(visible(text)))


def notifier(
    *, quiet: bool, output: Callable[[str], None] = print_notice
) -> "Callable[[Notice], None]":
    """Return a function that prints a notice; with ``--quiet`` it prints only warnings."""

    def notify(notice: "Notice") -> None:
        if notice.code or not quiet:
            output(str(notice))

    return notify


def print_notices(text: str) -> None:
    """Print a text of several lines to stderr, each wrapped on a terminal."""
    print_raw("\n".join(map(_wrapped, visible_lines(text).split("\n"))))


def stderr_width() -> int:
    """Return the number of columns of the terminal at stderr; 0 without a terminal."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError, AttributeError):
        return 0


def _wrapped(line: str) -> str:
    """Wrap a line to the width of the terminal; keep an indented line as it is."""
    width = stderr_width()
    if not NARROW_TERMINAL <= width < len(line) or line[0].isspace():
        return line
    import textwrap  # lazy: few lines are too long

    return textwrap.fill(
        line, width, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False
    )


def print_raw(text: str) -> None:
    """Print a text to stderr, without escaping it. A closed stderr is no error."""
    with suppress(OSError, ValueError):
        click.echo(text, err=True)


def emit(text: str, format: str = "table") -> None:
    """Write a report to stdout.

    `click.echo` is not used, for two reasons. It writes UTF-8 even if the user wants ASCII. And it
    exits with 1 if the reader of a pipe ends early, as ``head`` does, which is not an error.

    Parameters
    ----------
    text : str
        The report.
    format : str
        Format of the report. ``"csv"`` is escaped only on a terminal and in the log of a CI system.
        ``"colours"``, a report with colours, is written as it is.

    Raises
    ------
    ConfigError
        The report cannot be written.
    """
    if format == "json":
        # The module `json` does not escape two things, so they are escaped here: the control
        # character DEL, and commands of CI systems within a line.
        text = text.replace("\x7f", "\\u007f").replace("##", "#\\u0023")
    elif format != "colours" and (format != "csv" or _is_watched()):
        text = visible_lines(text)
    check_stdout()
    encoding = sys.stdout.encoding or "ascii"
    try:
        sys.stdout.write(text.encode(encoding, "backslashreplace").decode(encoding))
        sys.stdout.flush()
    except BrokenPipeError:
        _discard()
    except OSError as error:
        raise _lost(error) from None


def check_stdout() -> None:
    """Check that stdout is open; a shell can start a program with a closed one.

    Raises
    ------
    ConfigError
        stdout is closed.
    """
    if sys.stdout is None:
        raise ConfigError("stdout is closed; redirect it to a file, or to /dev/null")


def check_written(error: OSError) -> None:
    """Check that an error of the system is not a failure to write to stdout.

    Raises
    ------
    ConfigError
        The error is a failure to write to stdout: it names no file, and its number is in `FULL`.
    """
    if error.filename is None and error.errno in FULL:
        raise _lost(error) from None


def on_terminal() -> bool:
    """Return whether a report on stdout can have colours.

    It can on a terminal, or if ``FORCE_COLOR`` is set, as for the log of a CI system.
    """
    if sys.stdout is None or os.environ.get("TERM") == "dumb":
        return False
    return sys.stdout.isatty() or bool(os.environ.get("FORCE_COLOR"))


def _is_watched() -> bool:
    """Return whether stdout is a terminal, or could be the log of a CI system."""
    if sys.stdout is None or sys.stdout.isatty():
        return True
    if not any(map(os.environ.get, CI)):
        return False
    try:
        return not stat.S_ISREG(os.fstat(sys.stdout.fileno()).st_mode)
    except (OSError, ValueError):
        return True


def _lost(error: OSError) -> ConfigError:
    _discard()
    return ConfigError(f"stdout cannot be written: {error.strerror}")


def _discard() -> None:
    """Send buffered output to nowhere; otherwise Python would try to write it again at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
