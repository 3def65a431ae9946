"""Which paths are data that are read in parts: folders of tables, and files beyond the memory."""

import csv
import itertools
import os
import re
from collections.abc import Iterator, Sequence
from typing import TypeAlias

from tgospa_eval.api.request import Request
from tgospa_eval.common.files import STDIN
from tgospa_eval.common.machine import machine_memory
from tgospa_eval.formats.guess import is_table_folder
from tgospa_eval.formats.loading import TABLE, TEXT

PARQUET, TEXTS = (".parquet", ".pq"), (".csv", ".tsv")
LEFT_BEHIND = ("_", ".")
"""How names begin of what writers of datasets leave beside the data."""

FITS_ANYWHERE = 10**6
"""Bytes of files that fit anywhere."""

COLUMNS_READ = 6
"""Columns of a Parquet file that are read, about."""

TIP = 1 << 16
"""Bytes at the begin and the end of a file that tell its header and times."""

TIME_HEADERS = ("t", "time", "timestamp", "frame", "step")

Moment: TypeAlias = tuple[int, float, str]
"""A time as it compares."""


def memory_of(asked: int | None) -> int | None:
    """Bytes that an evaluation may take; None where nobody knows."""
    if asked is not None:
        return asked
    whole = machine_memory()
    return None if whole is None else whole // 2


def parts_in_words(paths: tuple[str, str], options: Request) -> str | None:
    """Why these two are read in parts, for messages; None if they are read at once."""
    folders = [path for path in paths if os.path.isdir(path)]
    if folders:
        texts = options.columns, options.truth_columns, options.estimate_columns
        columns = ",".join(text for text in texts if text)
        fine = all(is_recording(path, columns) for path in folders)
        if fine:
            return f"{folders[0]} is a folder of tables"
        said = options.memory is not None and not any(map(is_table_folder, folders))
        return f"{folders[0]} is a folder, and --memory is given" if said else None
    if options.max_input is not None:  # which allows to read it at once
        return None
    for path in paths:
        needed = _needed(path)
        memory = memory_of(options.memory) if needed else None
        if memory is not None and needed > memory:
            return (
                f"{path} takes some {needed / 1e9:.3g} GB to read, and the memory for it is "
                f"{memory / 1e9:.3g} GB (--memory)"
            )
    return None


def is_recording(folder: str, columns: str) -> bool:
    """Whether the tables of a folder are one recording, and not one each.

    Parquet files are; CSV files if there are several with one header, one after the other in time.
    """
    if is_table_folder(folder):
        return False
    files = list(_files(folder))
    if not files:
        return False
    if all(name.endswith(PARQUET) for name in files):
        return True
    return (
        len(files) > 1 and all(name.endswith(TEXTS) for name in files) and _in_turn(files, columns)
    )


def _files(folder: str) -> Iterator[str]:
    """Files below a folder, but for hidden ones."""
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith(LEFT_BEHIND))
        yield from (os.path.join(place, name) for name in names if name[:1] not in LEFT_BEHIND)


def _in_turn(files: Sequence[str], columns: str) -> bool:
    """Whether CSV files have one header, and times of which each has its own stretch."""
    first: list[str] = []
    spans: list[tuple[Moment, Moment]] = []
    for path in files:
        try:
            header, span = _header_and_span(path, columns)
        except (OSError, ValueError, LookupError, csv.Error):
            return False
        first = first or header
        if header != first:
            return False
        spans += [] if span is None else [span]
    return all(one[1] < other[0] for one, other in itertools.pairwise(sorted(spans)))


def _header_and_span(path: str, columns: str) -> tuple[list[str], tuple[Moment, Moment] | None]:
    """The header of a CSV file, and the times of its first and last row; None without rows.

    Raises
    ------
    ValueError, LookupError
        There is no header, or no column of time, or a row is too short.
    """
    with open(path, "rb") as file:
        begin = file.read(TIP)
        file.seek(max(os.path.getsize(path) - TIP, 0))
        end = file.read()
    head = begin.decode("utf-8-sig").splitlines()
    last = [line for line in end.decode("utf-8", "replace").splitlines() if line.strip()]
    if not head:
        raise ValueError("no header")
    delimiter = max(",;\t", key=head[0].count)
    header = [name.strip() for name in next(csv.reader([head[0]], delimiter=delimiter))]
    asked = re.findall(r"(?:^|,)\s*t=([^,]*)", columns)
    at = header.index(
        next(filter(lambda name: name in asked or name.lower() in TIME_HEADERS, header), "")
    )
    rows = [line for line in head[1:2] if line.strip()]
    if not rows:
        return header, None
    ends = [
        _moment(next(csv.reader([line], delimiter=delimiter))[at]) for line in (rows[0], last[-1])
    ]
    return header, (min(ends), max(ends))


def _moment(text: str) -> Moment:
    """A time as it compares: a number, or the text of an ISO time after all numbers."""
    try:
        return 0, float(text.strip().replace(",", ".")), ""
    except ValueError:
        return 1, 0.0, text.strip()


def _needed(path: str) -> float:
    """Bytes that reading a file takes, where that is easily seen; 0 of what has no parts."""
    if path == STDIN or not os.path.isfile(path):
        return 0.0
    size = os.path.getsize(path)
    if size < FITS_ANYWHERE:
        return 0.0
    if re.search(r"\.(csv|tsv)$", path.lower()):
        return float(TEXT * size)
    if not path.lower().endswith(PARQUET):
        return 0.0
    try:
        import pyarrow.parquet as pq  # here: for large files only

        metadata = pq.read_metadata(path)
    except (ModuleNotFoundError, OSError, ValueError):
        return 0.0  # who reads it says what is wrong
    return float(TABLE * 8 * metadata.num_rows * min(metadata.num_columns, COLUMNS_READ))
