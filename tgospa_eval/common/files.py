"""Files of users: errors of the system as one sentence."""

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
"""Bytes that no file of settings has."""

STDIN = "<stdin>"
"""What the standard input is called; a file of this name is ./<stdin>."""

CHUNK = 1 << 24
"""Bytes that are read at a time where the length is not known."""

PIPE_PATIENCE = 2.0
"""Seconds before a notice that a pipe or a terminal is waited for."""


def _silent(text: str) -> None:
    """A library prints nothing."""


announce: Callable[[str], None] = _silent
"""What to do with a notice of what is waited for; the command line prints it."""


@contextmanager
def named(where: str, kind: type[TgospaError], what: str = "cannot be read") -> Iterator[None]:
    """Raise faults of the file system as `kind`, with `where` at the begin of the message."""
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        if isinstance(error, TgospaError):
            raise
        raise kind(f"{where}: {what}: {reason(error)}") from None


def reason(error: Exception) -> str:
    """The message of the system, without its numbers."""
    if isinstance(error, FileNotFoundError) and not os.path.isabs(error.filename or ""):
        try:
            os.getcwd()
        except OSError:
            return "the working folder was removed; change to one that is there"
    return getattr(error, "strerror", None) or str(error)


@contextmanager
def patience(path: str, what: str) -> Iterator[None]:
    """Announce what is waited for, where a pipe or a terminal keeps us waiting."""
    timer = threading.Timer(PIPE_PATIENCE, lambda: announce(f"waiting for {what} {path}"))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def read_bytes(
    path: str, kind: type[TgospaError], most: int = SETTINGS, remedy: str = "name another file"
) -> bytes:
    """The content of a file, of at most so many bytes.

    Raises
    ------
    kind
        The file cannot be read, is a folder, or is larger.
    """
    with named(path, kind):
        if path == STDIN:
            return _of_stdin(kind, most, remedy)
        found = os.stat(path)
        if stat.S_ISDIR(found.st_mode):  # Windows says "permission denied"
            raise kind(f"{path}: is a folder, not a file")
        size, content = found.st_size, b""
        if not stat.S_ISREG(found.st_mode):
            content = b"".join(_pieces(path, path, most))
            size = len(content)
        elif size <= most:
            with open(path, "rb", buffering=0) as file:  # all at once needs no buffer
                content = file.readall()
    if size > most:
        raise kind(f"{path}: larger than {most >> 20} MiB; {remedy}")
    return content


def _of_stdin(kind: type[TgospaError], most: int, remedy: str) -> bytes:
    """What comes from the standard input, which ends once: it is kept for whoever asks again."""
    if sys.stdin is None:
        raise kind(f"{STDIN}: there is none, it is closed; name a file")
    kept = _kept(sys.stdin)
    if not kept:
        kept.append(b"".join(_pieces(STDIN, os.dup(sys.stdin.fileno()), most)))
    content = kept[0]
    if len(content) > most:
        raise kind(f"{STDIN}: larger than {most >> 20} MiB; {remedy}")
    return content


@lru_cache(maxsize=1)
def _kept(stream: TextIO) -> list[bytes]:  # noqa: ARG001
    """What came from a stream, once it did."""
    return []


def _pieces(path: str, source: str | int, most: int) -> Iterator[bytes]:
    """What comes from a pipe or a device, up to its end or a little more than the most."""
    with patience(path, "data from"):
        file = open(source, "rb", buffering=0)  # noqa: SIM115
        piece = file.read(CHUNK)
    with file:
        while piece and most >= 0:
            yield piece
            most -= len(piece)
            piece = file.read(CHUNK)


def is_regular(path: str) -> bool:
    """Whether it is a file with content of its own: no folder, pipe, socket or device."""
    return stat.S_ISREG(os.stat(path).st_mode)


def is_missing(path: str) -> bool:
    """Whether there is none; one that cannot be looked at may be there."""
    try:
        os.stat(path)
    except FileNotFoundError:
        return True
    except (OSError, ValueError):
        return False
    return False
