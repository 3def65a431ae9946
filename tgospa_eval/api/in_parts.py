"""Evaluation of data in parts: of folders of tables, and of files that do not fit into memory.

This module decides whether data are read in parts, refuses options that need all data at once, and
starts the evaluation.
"""

import csv
import itertools
import os
import re
import shutil
import tempfile
import weakref
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from tgospa_eval.api.options import DEFAULTS, OPTION_SPECS, Request, is_coverage
from tgospa_eval.api.reading import check_sides
from tgospa_eval.api.resolve import ResolvedRequest
from tgospa_eval.api.result import ResultInParts
from tgospa_eval.common.files import STDIN
from tgospa_eval.common.frozen import recast
from tgospa_eval.common.machine import cores, machine_memory
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import as_distance
from tgospa_eval.errors import ConfigError, InputError, MemoryTooSmallError
from tgospa_eval.evaluation.memory import Share, bytes_in_memory, format_of, size_text
from tgospa_eval.formats.fields import floats, parse_times
from tgospa_eval.formats.guess import FORMAT_OF_SUFFIX, folder_format, is_table_folder
from tgospa_eval.formats.headers import Headers
from tgospa_eval.formats.objects import is_path
from tgospa_eval.quoting import option
from tgospa_eval.results.consistency import NEES

if TYPE_CHECKING:
    from tgospa_eval.results.partitioned import PartitionedResult

FITS_ANYWHERE = 10**6
"""Number of bytes. Smaller files are read at once if the user gives no limit of memory."""

IN_PARTS = ("csv", "parquet")
"""Formats of files that can be read in parts."""

TIP = 1 << 16
"""Number of bytes that are read at each end of a file, to get its header and its times."""

UNKNOWN_MEMORY = 2 * 10**9
"""Default limit of memory if the memory of the machine is unknown."""

Moment: TypeAlias = tuple[str, float]
"""Kind of a time (``"number"``, ``"local"`` or ``"zoned"``), and the value of the time."""


def memory_of(limit: int | None) -> int | None:
    """Return the limit, by default half of the memory of the machine; None if both are unknown."""
    if limit is not None:
        return limit
    whole = machine_memory()
    return None if whole is None else whole // 2


def parts_in_words(
    paths: tuple[str, str], options: Request, *, pictures: bool = False
) -> str | None:
    """Return the reason to read truth and estimate in parts; None if they are read at once.

    `pictures` says whether pictures are made, which takes memory, too.

    Raises
    ------
    MemoryTooSmallError
        The files need more memory than the user allows, and their format cannot be read in parts.
    """
    folders = [path for path in paths if os.path.isdir(path)]
    if folders:
        texts = options.columns, options.truth_columns, options.estimate_columns
        columns = ",".join(text for text in texts if text)
        fine = all(is_recording(path, columns) for path in folders)
        if fine:
            return f"{folders[0]} is a folder of tables"
        said = options.memory is not None and not any(map(folder_format, folders))
        return f"{folders[0]} is a folder, and {option('memory')} is given" if said else None
    if options.max_input is not None:  # the user wants the files to be read at once
        return None
    files = [path for path in paths if path != STDIN and os.path.isfile(path)]
    small = sum(map(os.path.getsize, files)) < FITS_ANYWHERE
    if not files or (small and options.memory is None):
        return None
    limit = memory_of(options.memory)
    needed = bytes_in_memory(files, pictures=pictures)
    if limit is None or needed <= limit:
        return None
    size, given = size_text(needed), option("memory", size_text(limit))
    if can_be_divided(paths):
        return f"{' and '.join(paths)} need about {size} of memory, more than {given} allows"
    if options.memory is None:
        return None  # read at once: the reader raises an error if memory is too small
    raise MemoryTooSmallError(
        f"{' and '.join(paths)} need about {size} of memory, more than {given} allows; only CSV "
        f"and Parquet files are read in parts: allow {option('memory', size)}"
    )


def can_be_divided(sides: tuple[object, object]) -> bool:
    """Return whether truth and estimate are files of formats that can be read in parts."""
    return all(
        is_path(side) and os.path.isfile(side) and format_of(os.fspath(side)) in IN_PARTS
        for side in sides
    )


def check_parts(options: Request, why: str, further: Iterable[tuple[str, str]] = ()) -> None:
    """Check that no option needs all data in memory.

    Parameters
    ----------
    options : Request
        The options.
    why : str
        Why the data are read in parts, for the message.
    further : iterable of pair of str
        More options that need all data in memory and are in use, but are not in `options`. Each
        option is a pair: its name, and advice what to do instead.

    Raises
    ------
    ConfigError
        An option that needs all data in memory is given.
    """
    requested = [
        (option(name), about.parts)
        for name, about in OPTION_SPECS.items()
        if about.parts and getattr(options, name) not in (DEFAULTS[name], NEES)
    ]
    requested += ((option(name), advice) for name, advice in further)
    if is_coverage(options.region):
        requested.append((option("region"), "name ranges of columns, such as x=-50:50"))
    if options.distance is not None and "cloud" in as_distance(options.distance).kinds:
        requested.append(
            (
                option("distance", options.distance),
                f"compare means, by another {option('distance')}",
            )
        )
    for setting, advice in requested[:1]:
        raise ConfigError(f"{setting} is not supported for data in parts ({why}); {advice}")


def jobs_of(options: Request) -> int:
    """Return the number of local processes; it is 1 if a cluster does the work."""
    return 1 if options.scheduler else options.jobs or cores()


def evaluate_in_parts(
    paths: tuple[str, str],
    options: Request,
    resolved: ResolvedRequest,
    work: Path,
    stopwatch: Stopwatch,
    *,
    kept: bool,
    pictures: bool = False,
) -> "PartitionedResult":
    """Evaluate data in parts.

    Parameters
    ----------
    paths : pair of str
        Truth and estimate.
    options, resolved : Request, ResolvedRequest
        Options that `check_parts` has accepted, and the answer of `resolve_request` for them.
    work : Path
        Folder for intermediate data and the tables of the result.
    stopwatch : Stopwatch
        Running clock.
    kept : bool
        Whether the folder `work` is kept after the run. If not, the table of assigned pairs is not
        written.
    pictures : bool
        Whether pictures are made of the result.

    Raises
    ------
    TgospaError
        An option or the data are wrong.
    """
    from tgospa_eval.engines import engine_of  # lazy: few evaluations are in parts
    from tgospa_eval.partitioned.evaluate import evaluate_partitioned
    from tgospa_eval.partitioned.files import files_of

    cluster = options.scheduler is not None
    share = Share.of(
        memory_of(options.memory) or UNKNOWN_MEMORY,
        jobs_of(options),
        [files_of(path)[0] for path in paths],
        pictures=pictures,
        cluster=cluster,
    )
    result = evaluate_partitioned(
        paths,
        resolved.each,
        resolved.request,
        work=work,
        share=share,
        engine=engine_of(options.scheduler, share.jobs) if cluster or share.jobs > 1 else None,
        kept=kept,
        stopwatch=stopwatch,
        check=partial(check_sides, resolved),
    )
    return replace(result, calibration=resolved.similarity, tracked_shares=resolved.tracked_shares)


def in_parts_if_large(
    truth: object,
    estimate: object,
    options: Request,
    resolved: ResolvedRequest,
    stopwatch: Stopwatch,
    why: str | None = None,
) -> ResultInParts | None:
    """Evaluate folders of tables, or files that do not fit into memory; return None for other data.

    Tables of the result are in a temporary folder, which is removed when the result is deleted.
    `why` is the reason to read in parts, if it is known. If it is None, the paths and the sizes of
    the files decide.

    Raises
    ------
    ConfigError
        An option needs all data at once, but the data are read in parts; or an option is only for
        data in parts, but the data are read at once.
    """
    if is_path(truth) and is_path(estimate):
        paths = os.fspath(truth), os.fspath(estimate)
        why = why or parts_in_words(paths, options)
    if why is None:
        if options.scheduler is not None:
            raise ConfigError("scheduler is for data in parts: folders of tables")
        return None
    check_parts(options, why)
    folder = tempfile.mkdtemp(prefix="tgospa-eval-")
    try:
        result = evaluate_in_parts(paths, options, resolved, Path(folder), stopwatch, kept=True)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(result.tables, shutil.rmtree, folder, ignore_errors=True)
    return recast(result, ResultInParts)


def is_recording(folder: str, columns: str) -> bool:
    """Return whether the tables of a folder are parts of one recording.

    A folder of Parquet files is always one recording. A folder of CSV files is one recording if it
    has several files with the same header, and their ranges of time do not overlap. A folder of
    nuScenes is no recording in parts. `columns` is the text of the options for columns, which can
    name the header of ``t``.
    """
    if is_table_folder(folder):
        return False
    from tgospa_eval.partitioned.files import stored  # lazy: most evaluations are of files

    files = [file.path for file, _ in stored(folder)]
    formats = {FORMAT_OF_SUFFIX.get(os.path.splitext(name)[1]) for name in files}
    if formats == {"parquet"}:
        return True
    return (
        len(files) > 1
        and formats == {"csv"}
        and _in_turn(files, re.findall(r"(?:^|,)\s*t=([^,]*)", columns))
    )


def _in_turn(files: Sequence[str], time_headers: Sequence[str]) -> bool:
    """Return whether CSV files have the same header, and ranges of time that do not overlap.

    `time_headers` are headers that the user maps to ``t``.
    """
    headers, spans = set(), []
    if not all(map(os.path.isfile, files)):  # opening a named pipe can block
        return False
    for path in files:
        try:
            header, span = _header_and_span(path, time_headers)
        except (OSError, ValueError, LookupError, InputError, csv.Error):
            return False
        headers.add(header)
        spans += [] if span is None else [span]
    ends = itertools.pairwise(sorted(spans))
    return len(headers) == 1 and all(one[1] < other[0] for one, other in ends)


def _header_and_span(
    path: str, time_headers: Sequence[str]
) -> tuple[tuple[str, ...], tuple[Moment, Moment] | None]:
    """Return the header of a CSV file, and the times of its first and last row, the smaller first.

    Without rows, None takes the place of the times.

    Raises
    ------
    ValueError, LookupError, InputError
        The header or the column of time is missing, or a row is too short or lacks a time.
    """
    with open(path, "rb") as file:
        begin = file.read(TIP)
        file.seek(max(os.path.getsize(path) - TIP, 0))
        end = file.read()
    head = begin.decode("utf-8-sig").splitlines()
    last = [line for line in end.decode("utf-8", "replace").splitlines() if line.strip()]
    rows = [*head[:1], *([head[1], last[-1]] if head[1:2] and head[1].strip() else [])]
    delimiter = max(",;\t", key=rows[0].count)
    fields = list(csv.reader(rows, delimiter=delimiter))
    header = tuple(name.strip() for name in fields[0])
    known = [header.index(name) for name in time_headers if name in header]
    at = known[0] if known else Headers(header, {}, "", path).find("t")
    if at is None:
        raise LookupError
    texts = [row[at].replace(",", ".") for row in fields[1:]]
    if not texts:
        return header, None
    times = parse_times(texts, lambda texts: floats(texts, "."))
    low, high = sorted(times.value.tolist())
    return header, ((times.clock, low), (times.clock, high))
