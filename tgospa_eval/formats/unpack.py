"""Compressed files of any format: gzip and zstd, unpacked up to what is allowed."""

import io
import sys
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import BinaryIO

from tgospa_eval.common.files import CHUNK, SETTINGS, named
from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError, InputError

ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
"""Of the standard library, or the same for older versions."""

PACKED_ENDINGS = (".gz", ".gzip", ".zst", ".zstd")


PACKED_FROM = 8
"""Bytes that tell how a file is compressed."""


def is_packed(data: bytes) -> bool:
    """Whether a file is compressed in a way that is unpacked here."""
    return data.startswith(tuple(OPENERS))


def unpack(data: bytes, path: str, most: int = SETTINGS) -> bytes:
    """The content of a file, of at most so many bytes if it is compressed.

    Parameters
    ----------
    data, path
        The file.
    most : int
        Bytes that a compressed file may have unpacked: a small one can have any number.

    Raises
    ------
    InputError
        It is damaged, or unpacks to more.
    ConfigError
        The package that unpacks it is missing.
    """
    opened = next((opener for magic, opener in OPENERS.items() if data.startswith(magic)), None)
    if opened is None:
        return data
    pieces, size = [], 0
    stream, faults = opened(io.BytesIO(data), path)
    try:
        while piece := stream.read(CHUNK):
            size += len(piece)
            if size > most:
                raise InputError(
                    f"{path}: {len(data):,} bytes that unpack to more than {most / 1e9:.2g} GB; if "
                    "it is meant, allow more with --max-input GB, or any with 0"
                )
            pieces.append(piece)
    except faults as error:
        raise damaged(path, error) from None
    return b"".join(pieces)


@contextmanager
def unpacking(place: str, path: str) -> Iterator[BinaryIO]:
    """The content of a file, unpacked while it is read if it is compressed.

    Parameters
    ----------
    place : str
        Where the file is.
    path : str
        What it is called in messages.

    Raises
    ------
    InputError
        It cannot be read, or is damaged.
    ConfigError
        The package that unpacks it is missing.
    """
    with named(path, InputError), open(place, "rb") as file:
        head = file.read(PACKED_FROM)
        file.seek(0)
        opened = next((opener for magic, opener in OPENERS.items() if head.startswith(magic)), None)
        if opened is None:
            yield file
            return
        stream, faults = opened(file, path)
        try:
            yield stream
        except faults as error:
            raise damaged(path, error) from None


def damaged(path: str, error: Exception) -> InputError:
    """Message about a compressed file that cannot be unpacked."""
    why = (str(error).splitlines() or [type(error).__name__])[0]
    return InputError(f"{path}: cannot be unpacked, it is damaged: {why}")


def plain_name(path: str) -> str:
    """The path without the ending of a compressed file, in lower case."""
    name = path.casefold()
    ending = next((ending for ending in PACKED_ENDINGS if name.endswith(ending)), "")
    return name.removesuffix(ending)


Opened = tuple[BinaryIO, tuple[type[Exception], ...]]
"""What reads the content, and the faults of a damaged file."""


def _gzip(source: BinaryIO, path: str) -> Opened:  # noqa: ARG001
    import gzip  # here, as below: few files need it

    return gzip.GzipFile(fileobj=source), (OSError, EOFError, zlib.error)  # type: ignore[return-value]


def _zstd(source: BinaryIO, path: str) -> Opened:
    try:
        library = import_module(ZSTD)
    except ModuleNotFoundError:
        raise ConfigError(f"{path}: zstd needs the extra zstd: {install('zstd')}") from None
    return library.ZstdFile(source), (library.ZstdError, EOFError)


OPENERS: dict[bytes, Callable[[BinaryIO, str], Opened]] = {
    b"\x1f\x8b": _gzip,
    b"\x28\xb5\x2f\xfd": _zstd,
}
"""How compressed files begin, and what opens them."""
