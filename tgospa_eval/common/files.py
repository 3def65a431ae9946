"""Reading files of users: each error of the system becomes a message of one sentence."""

import os
import stat
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import TextIO

from tgospa_eval.errors import TgospaError

SETTINGS = 1 << 26
"""Largest number of bytes of a settings file."""

STDIN = "<stdin>"
"""Path that means the standard input. A user can name a real file of this name as ./<stdin>."""

CHUNK = 1 << 24
"""Bytes that are read at once if the length is unknown."""

PIPE_PATIENCE = 2.0
"""Seconds before the user is told that the program waits for a pipe or a terminal."""


def _silent(text: str) -> None:
    """Print nothing: the default, as a library should not print."""


announce: Callable[[str], None] = _silent
"""Function that receives notices about waiting. The command line sets one that prints them."""


@contextmanager
def named(where: str, kind: type[TgospaError], what: str = "cannot be read") -> Iterator[None]:
    """Turn errors of the file system in the block into `kind`; `where` begins the message."""
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        if isinstance(error, TgospaError):
            raise
        raise kind(f"{where}: {what}: {reason(error)}") from None


def reason(error: Exception) -> str:
    """Return the message of the system about an error, but not the error number and the path."""
    if isinstance(error, FileNotFoundError) and not os.path.isabs(error.filename or ""):
        try:
            os.getcwd()
        except OSError:
            return "the working folder was removed; change to one that is there"
    return getattr(error, "strerror", None) or str(error)


@contextmanager
def patience(path: str, what: str) -> Iterator[None]:
    """Announce that the program waits for a pipe or a terminal, if the block takes long.

    The message has `what` before the path: "data from", for example.
    """
    timer = threading.Timer(PIPE_PATIENCE, lambda: announce(f"waiting for {what} {path}"))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def read_bytes(
    path: str, kind: type[TgospaError], max_bytes: int = SETTINGS, remedy: str = "name another file"
) -> bytes:
    """Read the content of a file of at most `max_bytes`.

    Raises
    ------
    kind
        The file cannot be read, is a folder, or is larger than the limit.
    """
    with named(path, kind):
        if path == STDIN:
            return _of_stdin(kind, max_bytes, remedy)
        status = os.stat(path)
        if stat.S_ISDIR(status.st_mode):  # on Windows, an error would say "permission denied"
            raise kind(f"{path}: is a folder, not a file")
        size, content = status.st_size, b""
        if not stat.S_ISREG(status.st_mode):
            content = b"".join(_pieces(path, path, max_bytes))
            size = len(content)
        elif size <= max_bytes:
            with open(path, "rb", buffering=0) as file:
                content = file.readall()
    if size > max_bytes:
        raise kind(f"{path}: larger than {max_bytes >> 20} MiB; {remedy}")
    return content


def _of_stdin(kind: type[TgospaError], max_bytes: int, remedy: str) -> bytes:
    """Read the standard input at the first call, and return the same content at later calls."""
    if sys.stdin is None:
        raise kind(f"{STDIN}: there is none, it is closed; name a file")
    kept = _kept(sys.stdin)
    if not kept:
        kept.append(b"".join(_pieces(STDIN, os.dup(sys.stdin.fileno()), max_bytes)))
    content = kept[0]
    if len(content) > max_bytes:
        raise kind(f"{STDIN}: larger than {max_bytes >> 20} MiB; {remedy}")
    return content


@lru_cache(maxsize=1)
def _kept(stream: TextIO) -> list[bytes]:  # noqa: ARG001
    """Return the list that keeps the content of a stream, always the same list for a stream."""
    return []


def _pieces(path: str, source: str | int, max_bytes: int) -> Iterator[bytes]:
    """Yield the content of a pipe or a device; stop at its end, or soon after `max_bytes`."""
    with patience(path, "data from"):
        file = open(source, "rb", buffering=0)  # noqa: SIM115
        piece = file.read(CHUNK)
    with file:
        while piece and max_bytes >= 0:
            yield piece
            max_bytes -= len(piece)
            piece = file.read(CHUNK)


def is_regular(path: str) -> bool:
    """Return whether a path is a regular file, not a folder, pipe, socket or device."""
    return stat.S_ISREG(os.stat(path).st_mode)


def is_missing(path: str) -> bool:
    """Return whether a file is surely missing. If it cannot be examined, it counts as existing."""
    try:
        os.stat(path)
    except FileNotFoundError:
        return True
    except (OSError, ValueError):
        return False
    return False
