"""stdout and stderr: what is written there is text, and what happens if it cannot be written.

The last line of defence: control characters are escaped here whatever was forgotten elsewhere, and
no line is a command of a CI system but those that the gate means.
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
from tgospa_eval.text import visible, visible_lines

if TYPE_CHECKING:
    from tgospa_eval.common.notices import Notice

_heard = threading.Event()


def interrupted() -> bool:
    """Return whether a Ctrl-C came in this process."""
    return _heard.is_set()


@contextmanager
def on_interrupt(take: Callable[[], bool]) -> Iterator[None]:
    """Ask `take` at each Ctrl-C; unless it takes it, KeyboardInterrupt is raised as ever.

    Where interrupts are ignored, or somebody else answers them, nothing changes.
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
    """Let the first Ctrl-C wait: what is begun is brought to its end."""
    waiting: list[int] = []

    def take() -> bool:
        waiting.append(1)
        return len(waiting) == 1

    with on_interrupt(take):
        yield


def handles_interrupts() -> bool:
    """Return whether a Ctrl-C raises KeyboardInterrupt here; not in a worker, which ignores it."""
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler


CI = ("CI", "GITHUB_ACTIONS", "TF_BUILD", "TEAMCITY_VERSION")
"""Set where stdout is a log that is searched for commands."""

NARROW_TERMINAL = 20
"""Columns of a terminal in which wrapping helps."""

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
"""Errors of the system where nothing can be written to a file that is open."""


def print_notice(text: str) -> None:
    """Print a notice, a line on stderr; a terminal gets it wrapped."""
    print_raw(_wrapped(visible(text)))


def notifier(
    *, quiet: bool, output: Callable[[str], None] = print_notice
) -> "Callable[[Notice], None]":
    """Return a function that prints notices, and warnings even where the user wants quiet."""

    def notify(notice: "Notice") -> None:
        if notice.code or not quiet:
            output(str(notice))

    return notify


def print_notices(text: str) -> None:
    """Print lines to stderr, as they are ours."""
    print_raw("\n".join(map(_wrapped, visible_lines(text).split("\n"))))


def stderr_width() -> int:
    """Return columns of the terminal that stderr is; 0 if it is none, or does not answer."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError, AttributeError):
        return 0


def _wrapped(line: str) -> str:
    """Wrap a line to the width of a terminal; one that is indented is laid out already."""
    width = stderr_width()
    if not NARROW_TERMINAL <= width < len(line) or line[0].isspace():
        return line
    import textwrap  # lazy: most lines fit, or go to a file

    return textwrap.fill(
        line, width, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False
    )


def print_raw(text: str) -> None:
    """Print to stderr what nothing has to be escaped in; that stderr is gone changes nothing."""
    with suppress(OSError, ValueError):
        click.echo(text, err=True)


def emit(text: str, format: str = "table") -> None:
    """Write a report to stdout.

    Not by click.echo, which writes UTF-8 where the user asked for ASCII and exits with 1 when the
    reader of a pipe goes away; as head does, so that is no failure of ours.

    Parameters
    ----------
    text : str
        The report.
    format : str
        Its name. Of csv a file or a program gets the texts as they are, and who looks at stdout
        sees them as ls would show them. What has colours, `colours`, is written as it is.

    Raises
    ------
    ConfigError
        It cannot be written.
    """
    if format == "json":
        # `json` does not escape these two: delete, and commands of CI systems within a line.
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
    """See that there is a stdout; the caller may have closed it.

    Raises
    ------
    ConfigError
        There is none.
    """
    if sys.stdout is None:
        raise ConfigError("stdout is closed; redirect it to a file, or to /dev/null")


def check_written(error: OSError) -> None:
    """Raise ConfigError if a text could not be written to stdout.

    Raises
    ------
    ConfigError
        Nothing could be written to stdout: `FULL` has the reasons.
    """
    if error.filename is None and error.errno in FULL:
        raise _lost(error) from None


def on_terminal() -> bool:
    """Return whether someone reads stdout; `FORCE_COLOR` also, as in the logs of CI."""
    if sys.stdout is None or os.environ.get("TERM") == "dumb":
        return False
    return sys.stdout.isatty() or bool(os.environ.get("FORCE_COLOR"))


def _is_watched() -> bool:
    """Return whether stdout is a terminal, or may be the log of a CI system."""
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
    """Let what waits for stdout go nowhere, or Python would try again at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
