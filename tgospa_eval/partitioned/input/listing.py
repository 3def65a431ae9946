"""Which files a side has, in which order, what cannot be read in parts; digests of the files."""

import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from urllib.parse import unquote

from tgospa_eval.common.arrays import in_batches
from tgospa_eval.common.documents import TEXT, checked
from tgospa_eval.common.files import CHUNK, STDIN, named
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import natural
from tgospa_eval.common.writing import writing
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.guess import GUESSED_FROM, guess, is_table_folder
from tgospa_eval.formats.loading import is_packed, plain_name
from tgospa_eval.partitioned.tasks import Run, removing
from tgospa_eval.text import listed

PARQUET_ENDINGS, CSV_ENDINGS = (".parquet", ".pq"), (".csv", ".tsv")
"""Of names, without those of compressed files."""

HIDDEN = ("_", ".")
"""How names begin of what writers leave beside the data: _SUCCESS, _metadata, .crc."""

NOT_IN_PARTS = "only Parquet and CSV are read in parts"


@dataclass(frozen=True)
class File:
    """A file of a side.

    Parameters
    ----------
    path : str
        What it is called in messages.
    place : str
        Where it is, for workers in whatever folder.
    keys : tuple of pairs of str
        Names and values of the folders ``key=value`` that it is in.
    """

    path: str
    place: str
    keys: tuple[tuple[str, str], ...] = ()


def files_of(path: str) -> tuple[str, tuple[File, ...]]:
    """Format and files of a side, in natural order of their paths (part-2 before part-10).

    Raises
    ------
    InputError
        There is none, or there are some of a format that is not read in parts, or of two.
    ConfigError
        It is the standard input.
    """
    if path == STDIN:
        raise ConfigError(f"{path}: the standard input is not read in parts; name a file or folder")
    with named(path, InputError):
        if not os.path.exists(path):
            raise InputError(f"{path}: no such file or folder")
    if not os.path.isdir(path):
        return _kind(path), (File(path, os.path.abspath(path)),)
    if is_table_folder(path):
        raise InputError(f"{path}: a folder of nuScenes; {NOT_IN_PARTS}")
    found = sorted(_walk(path), key=lambda file: natural(file.path))
    kinds: dict[str, str] = {}
    for file in found:
        kinds.setdefault(_kind(file.path), file.path)
    if not found:
        raise InputError(f"{path}: no file in this folder; write Parquet or CSV files into it")
    if len(kinds) > 1:
        both = listed(sorted(os.path.relpath(each, path) for each in kinds.values()))
        raise InputError(f"{path}: files of two formats, {both}; write all as Parquet, or as CSV")
    return next(iter(kinds)), tuple(found)


def stored(path: str) -> Iterator[tuple[File, os.stat_result]]:
    """The files of a side in the order of their paths, and what the system says of each."""
    found = _walk(path) if os.path.isdir(path) else [File(path, os.path.abspath(path))]
    for file in sorted(found, key=lambda file: file.path):
        with suppress(FileNotFoundError):  # a link to nowhere: whoever reads it says so
            yield file, os.stat(file.place)


def state_of(found: os.stat_result) -> tuple[int, ...]:
    """What differs after a file was changed or replaced, where the system keeps account of it.

    A time of modification can be set back, the time of a change of status cannot. The device is
    left out: its number may be another one whenever it is mounted.
    """
    return found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino


def _walk(folder: str) -> Iterator[File]:
    """Files below a folder but for hidden ones, with the keys of the folders between."""

    def refuse(error: OSError) -> None:
        raise error

    with named(folder, InputError):
        for place, folders, names in os.walk(folder, onerror=refuse, followlinks=True):
            folders[:] = [name for name in folders if not name.startswith(HIDDEN)]
            between = os.path.relpath(place, folder).split(os.sep)
            pairs = (part.partition("=") for part in between)
            keys = tuple((key, _value(text)) for key, equals, text in pairs if equals and key)
            for name in names:
                if not name.startswith(HIDDEN):
                    path = os.path.join(place, name)
                    yield File(path, os.path.abspath(path), keys)


def _value(text: str) -> str:
    """Value of a key in the name of a folder, as Hive writes it."""
    return "" if text == "__HIVE_DEFAULT_PARTITION__" else unquote(text)


def _kind(path: str) -> str:
    """``"parquet"`` or ``"csv"``.

    Raises
    ------
    InputError
        It is something else.
    """
    with named(path, InputError), open(path, "rb") as file:
        head = file.read(GUESSED_FROM)
    if head.startswith(b"PAR1"):
        return "parquet"
    found = re.search(r"\.[^./\\]*$", plain_name(path))
    ending = found[0] if found else ""
    if ending in PARQUET_ENDINGS:
        if is_packed(head):
            raise InputError(
                f"{path}: a compressed Parquet file; unpack it, or compress its columns"
            )
        return "parquet"
    looks = "csv" if is_packed(head) or ending in CSV_ENDINGS else guess(path, head)
    if looks == "csv" and ending in (*CSV_ENDINGS, ".txt", ""):
        return "csv"
    what = "is no table by its name" if looks == "csv" else f"looks like {looks}"
    raise InputError(f"{path}: {what}; {NOT_IN_PARTS}: take it out, or convert it")


TOGETHER = 1 << 26
"""Bytes of files that are one task."""

CONTENT = "content"
"""In the folder of work, that of the digests of the files that it is derived from."""

Stretch = tuple[File, int, int]
"""Bytes of a file, from one to another."""


def changed_file(files: Sequence[tuple[File, os.stat_result]], work: Path, run: Run) -> str | None:
    """Empty a folder of work that was derived from files with another content.

    A file that was changed may have the size and the times of the old one. So all are read, when
    the work is begun and whenever it is gone on with.

    Parameters
    ----------
    files : sequence of pairs
        Those of both sides, as `listing.stored` finds them.
    work : Path
        The folder.
    run : callable
        Does tasks, as `partitioned.tasks.run_tasks`.

    Returns
    -------
    str or None
        The first that has changed, if the work has to be begun anew.

    Raises
    ------
    InputError
        A file cannot be read.
    """
    kept = work / CONTENT / "digests.json"
    kept.parent.mkdir(parents=True, exist_ok=True)
    fresh = tempfile.mkdtemp(dir=kept.parent)  # what was found before says nothing of now
    batches = in_batches(_stretches(files), lambda stretch: stretch[2] - stretch[1], TOGETHER)
    stretches = {
        os.path.join(fresh, str(number)): tuple(some) for number, some in enumerate(batches)
    }
    run({output: partial(write_digests, stretches=some) for output, some in stretches.items()})
    now: dict[str, list[str]] = {}
    for output, some in stretches.items():
        found = json.loads(Path(output).read_bytes())
        for (file, _, _), digest in zip(some, found, strict=True):
            now.setdefault(file.path, []).append(digest)
    shutil.rmtree(fresh, ignore_errors=True)
    before = now
    if kept.exists():
        try:
            before = checked(kept.read_bytes(), {...: [TEXT]})
        except ValueError:  # the machine has stopped before it was written
            before = {}
    changed = [path for path in {**before, **now} if before.get(path) != now.get(path)]
    if changed:
        with removing(work, but=CONTENT):  # the old digests go last
            pass
    if changed or not kept.exists():
        with writing(str(kept)) as beside:
            beside.write_text(json.dumps(now), encoding="utf-8")
    return next(iter(changed), None)


def write_digests(output: str, stretches: Sequence[Stretch]) -> None:
    """Write the digests of stretches of files.

    Raises
    ------
    InputError
        A file cannot be read.
    """
    digests = []
    for file, begin, end in stretches:
        sha = hashlib.sha256()
        with named(file.path, InputError), open(file.place, "rb", buffering=0) as source:
            source.seek(begin)
            while begin < end and (content := source.read(min(CHUNK, end - begin))):
                sha.update(content)
                begin += len(content)
        digests.append(sha.hexdigest())
    with writing(output) as beside:
        beside.write_text(json.dumps(digests), encoding="utf-8")


def _stretches(files: Iterable[tuple[File, os.stat_result]]) -> Iterator[Stretch]:
    """The bytes of all files in order, no more than so many together."""
    for file, found in files:
        for begin in range(0, max(found.st_size, 1), TOGETHER):
            yield file, begin, min(begin + TOGETHER, found.st_size)
