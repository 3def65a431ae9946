"""What reading a file will take, known before it is read: small files may unpack to anything."""

import math
import os
import stat
import sys
from contextlib import suppress

from tgospa_eval.common.machine import available_memory
from tgospa_eval.errors import InputError

GIGABYTE = 1e9
DEFAULT_GIGABYTES = 4.0
"""GB that reading a far smaller file may take: some 20 million rows of four columns."""

UNPACKED = 300
"""Times its own size that reading a file may take beyond that; recordings take 5 to 100 times."""

TABLE, TEXT = 6, 3
"""Bytes that reading takes for each byte of a table of doubles, and of a text. Measured at 10
million rows: 4.2 (npz), 4.7 (Parquet) and 2.9 (CSV)."""

MODEST = 1e8
"""Bytes that are there on any machine: to ask takes longer than to read a small file."""


def check_room(path: str, size: float, file: int, limit: float | None, what: str) -> None:
    """Whether there is room for what a file unpacks to.

    Parameters
    ----------
    path : str
        The file, for the message.
    size : float
        Bytes that reading takes.
    file : int
        Bytes of the file.
    limit : float, optional
        GB that it may take, 0 for any; by default what is available, but no more than
        `DEFAULT_GIGABYTES` where that is `UNPACKED` times the file and more.
    what : str
        What is in the file.

    Raises
    ------
    InputError
        There is not.
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
    most, kind = min(limits, default=(math.inf, ""))
    if size > most * GIGABYTE:
        needed = size / GIGABYTE
        raise InputError(
            f"{path}: {what}: reading it takes some {needed:.2g} GB, {kind} are {most:.2g} GB; if "
            "it is meant, allow more with --max-input GB, or any with 0"
        )


def most_bytes(limit: float | None, path: str) -> int:
    """Bytes that a file itself may have; what is available matters to the largest alone."""
    if limit == 0:
        return sys.maxsize - 1
    if limit is not None:
        return int(limit * GIGABYTE)
    most = int(DEFAULT_GIGABYTES * GIGABYTE)
    with suppress(OSError, ValueError):  # whoever reads it will say so
        found = os.stat(path)
        if stat.S_ISREG(found.st_mode) and found.st_size <= MODEST:
            return most
    return max(most, available_memory() or 0)


def most_unpacked(limit: float | None, file: int) -> int:
    """Bytes to which a compressed file of so many may unpack: texts shrink to a tenth."""
    if limit == 0:
        return sys.maxsize
    if limit is not None:
        return int(limit * GIGABYTE / TEXT)
    most = max(DEFAULT_GIGABYTES * GIGABYTE, UNPACKED * file)
    return int(min(most, available_memory() or most) / TEXT)
