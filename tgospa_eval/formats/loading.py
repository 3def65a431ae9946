"""Unpacked bytes of a file, and checks that there is enough memory for its content.

A small file may unpack to any size, so the needed memory is estimated before the content is read.
"""

import io
import math
import os
import stat
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any, BinaryIO

from tgospa_eval.common.files import CHUNK, SETTINGS, STDIN, named, read_bytes
from tgospa_eval.common.machine import available_memory
from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.quoting import option

GIGABYTE = 1e9
DEFAULT_GIGABYTES = 4.0
"""Default limit in GB of the memory for a file that is much smaller than its content.

It is enough for some 20 million rows of four columns."""

UNPACKED = 300
"""Ratio of needed memory to file size above which `DEFAULT_GIGABYTES` is the default limit.

Recordings have ratios from 5 to 100."""

TABLE, TEXT = 6, 3
"""Memory in bytes that reading takes for each byte of a table of doubles, and of a text.

Measured with 10 million rows: 4.2 (npz), 4.7 (Parquet) and 2.9 (CSV)."""


def more_memory() -> str:
    """Return the last part of messages about files that need too much memory."""
    return f"; allow more with {option('max_input', metavar='GB')}, or any size with 0"


MODEST = 1e8
"""Memory in bytes that every machine is assumed to have.

If reading needs no more, the available memory is not looked up, as this takes longer than reading a
small file."""


def check_memory(path: str, size: float, file: int, limit: float | None, what: str) -> None:
    """Check that there is enough memory for the content of a file.

    Parameters
    ----------
    path : str
        Path of the file, for the message.
    size : float
        Memory in bytes that reading takes.
    file : int
        Size of the file in bytes.
    limit : float, optional
        Allowed memory in GB; 0 means no limit. The default is the available memory, but at most
        `DEFAULT_GIGABYTES` if reading takes more than `UNPACKED` times the size of the file.
    what : str
        Content of the file, for the message.

    Raises
    ------
    InputError
        Reading takes more memory than is allowed or available.
    """
    if limit == 0:
        return
    limits = []
    if limit is not None:
        limits.append((limit, "allowed"))
    else:
        free = available_memory() if size > MODEST else None
        if free is not None:
            limits.append((free / GIGABYTE, "available"))
        if size > UNPACKED * file:
            limits.append((DEFAULT_GIGABYTES, "allowed"))
    allowed, kind = min(limits, default=(math.inf, ""))
    if size > allowed * GIGABYTE:
        needed = size / GIGABYTE
        raise InputError(
            f"{path}: {what}: reading it needs about {needed:.2g} GB, but {allowed:.2g} GB are "
            f"{kind}{more_memory()}"
        )


def check_text_memory(path: str, data: bytes, limit: float | None) -> None:
    """Check with `check_memory` that there is enough memory for the fields of a text."""
    size = len(data)
    check_memory(path, TEXT * size, size, limit, f"{size:,} bytes of text")


def max_bytes(limit: float | None, path: str) -> int:
    """Return the largest allowed size of a file in bytes.

    `limit` is the size in GB; 0 means no limit. The default is the available memory, but not less
    than `DEFAULT_GIGABYTES`. For a small file the available memory is not looked up.
    """
    if limit == 0:
        return sys.maxsize - 1
    if limit is not None:
        return int(limit * GIGABYTE)
    allowed = int(DEFAULT_GIGABYTES * GIGABYTE)
    with suppress(OSError, ValueError):  # reported when the file is read
        status = os.stat(path)
        if stat.S_ISREG(status.st_mode) and status.st_size <= MODEST:
            return allowed
    return max(allowed, available_memory() or 0)


ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
"""Module for zstd: that of the standard library, or its backport for older versions of Python."""

GZIP_MAGIC, ZSTD_MAGIC = b"\x1f\x8b", b"\x28\xb5\x2f\xfd"
"""First bytes of compressed files that are unpacked here."""

PACKED_SUFFIXES = (".gz", ".gzip", ".zst", ".zstd")

PACKED_FROM = 8
"""Number of first bytes that are read to see how a file is compressed."""


def is_packed(data: bytes) -> bool:
    """Return whether a file is compressed in a way that `unpack` supports."""
    return data.startswith((GZIP_MAGIC, ZSTD_MAGIC))


def unpack(data: bytes, path: str, max_size: int = SETTINGS) -> bytes:
    """Return the content of a file, unpacked if it is compressed.

    Parameters
    ----------
    data, path
        Bytes and path of the file.
    max_size : int
        Largest size of the unpacked content in bytes; a small file can unpack to any size.

    Raises
    ------
    InputError
        The file is damaged, or its content is larger than `max_size`.
    ConfigError
        The package that unpacks the file is missing.
    """
    if not is_packed(data):
        return data
    pieces, size = [], 0
    with _content(io.BytesIO(data), path) as stream:
        while piece := stream.read(CHUNK):
            size += len(piece)
            if size > max_size:
                raise InputError(
                    f"{path}: {len(data):,} bytes that unpack to more than {max_size / 1e9:.2g} GB"
                    f"{more_memory()}"
                )
            pieces.append(piece)
    return b"".join(pieces)


@contextmanager
def unpacking(path: str, name: str) -> Iterator[BinaryIO]:
    """Open a file; a compressed file is unpacked while it is read.

    Parameters
    ----------
    path : str
        Path of the file.
    name : str
        Name of the file in messages.

    Raises
    ------
    InputError
        The file cannot be read, or is damaged.
    ConfigError
        The package that unpacks the file is missing.
    """
    with named(name, InputError), open(path, "rb") as file, _content(file, name) as stream:
        yield stream


@contextmanager
def _content(file: BinaryIO, path: str) -> Iterator[BinaryIO]:
    """Unpack an open file while it is read."""
    head = file.read(PACKED_FROM)
    file.seek(0)
    stream: Any = file
    faults: tuple[type[Exception], ...] = ()
    if head.startswith(GZIP_MAGIC):
        import gzip  # lazy: few files are compressed

        stream, faults = gzip.GzipFile(fileobj=file), (OSError, EOFError, zlib.error)
    elif head.startswith(ZSTD_MAGIC):
        try:
            library = import_module(ZSTD)
        except ModuleNotFoundError:
            raise ConfigError(f"{path}: zstd needs the extra zstd: {install('zstd')}") from None
        stream, faults = library.ZstdFile(file), (library.ZstdError, EOFError)
    try:
        yield stream
    except faults as error:
        why = reason_of(error)
        raise InputError(f"{path}: cannot be unpacked, it is damaged: {why}") from None


def unreadable(path: str, kind: str, error: Exception) -> InputError:
    """Return the error about a damaged file."""
    return InputError(f"{path}: not a readable {kind} file: {reason_of(error)}")


def reason_of(error: Exception) -> str:
    """Return the first line of the message of an error."""
    if isinstance(error, UnicodeDecodeError):
        return "a text that is not UTF-8; the file is damaged"
    return (str(error).splitlines() or [type(error).__name__])[0]


def plain_name(path: str) -> str:
    """Return the path without the ending of a compressed file, in lower case."""
    name = path.casefold()
    ending = next((ending for ending in PACKED_SUFFIXES if name.endswith(ending)), "")
    return name.removesuffix(ending)


def load(path: str, max_size: int = SETTINGS) -> bytes:
    """Read the bytes of a file, at most `max_size`.

    Raises
    ------
    InputError
        The file cannot be read, or is larger.
    """
    with named(path, InputError):
        try:
            endless = _is_endless(path)
        except FileNotFoundError:
            raise InputError(f"{path}: no such file") from None
        if endless:
            raise InputError(f"{path}: is a device, not a file")
    try:
        if max_size == SETTINGS:
            return read_bytes(path, InputError)
        return read_bytes(
            path,
            InputError,
            max_size,
            f"allow more with {option('max_input', metavar='GB')}, or any with 0",
        )
    except MemoryError:
        raise InputError(f"{path}: larger than the memory of this machine") from None


def _is_endless(path: str) -> bool:
    """Return whether a path is a device that may never end, such as /dev/zero.

    A terminal is not one, as the user can end the input.
    """
    if path == STDIN:
        return False
    mode = os.stat(path).st_mode
    if stat.S_ISBLK(mode):
        return True
    if not stat.S_ISCHR(mode):
        return False
    with open(path, "rb", buffering=0) as device:
        return not device.isatty()


def unpacked_file(path: str, max_input: float | None) -> bytes:
    """Return the bytes of a file, unpacked if it is compressed.

    `max_input` is the memory in GB that reading may take (see `check_memory`). Reading a text takes
    `TEXT` times its size. So the unpacked content may have at most 1 / `TEXT` of this memory.
    """
    data = load(path, max_bytes(max_input, path))
    if not is_packed(data):
        return data
    return unpack(data, path, int(max_memory(len(data), max_input) / TEXT))


def max_memory(file: int, limit: float | None) -> float:
    """Return the memory in bytes that reading a file may take; for `limit` see `check_memory`."""
    if limit is not None:
        return limit * GIGABYTE or sys.maxsize / 2
    allowed = max(DEFAULT_GIGABYTES * GIGABYTE, UNPACKED * file)
    return min(allowed, available_memory() or allowed)


def check_parquet(kind: str = "Parquet", begin: str = "") -> None:
    """Check that pyarrow is installed.

    Raises
    ------
    ConfigError
        pyarrow is not installed.
    """
    try:
        import pyarrow.parquet  # noqa: F401  (lazy: the extra may be missing)
    except ModuleNotFoundError:
        raise ConfigError(
            f"{begin}{kind} files need the extra parquet: {install('parquet')}"
        ) from None
