"""Which files a side has, in which order, and what of them cannot be read in parts."""

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from urllib.parse import unquote

from tgospa_eval.common.files import STDIN, named
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import natural
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.guess import GUESSED_FROM, guess, is_table_folder
from tgospa_eval.formats.loading import is_packed, plain_name
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.text import listed, quoted

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


def check_options(path: str, options: ReadOptions) -> None:
    """Whether a side can be read in parts with these options.

    Raises
    ------
    ConfigError
        It is the standard input, or something is asked for that needs all rows at once.
    """
    if path == STDIN:
        raise ConfigError(f"{path}: the standard input is not read in parts; name a file or folder")
    for asked, what in (
        (
            options.by_class,
            f"{options.class_for} is not for data in parts; --class takes one class",
        ),
        (
            options.attributes,
            f"column {quoted(next(iter(options.attributes), ''))} is not read of data in parts; "
            "leave out the option that asks for it, or give one file that fits into memory",
        ),
        (
            options.clouds,
            "clouds of particles are not read in parts; give one file that fits into memory, or "
            "compare means",
        ),
    ):
        if asked:
            raise ConfigError(f"{path}: {what}")


def files_of(path: str) -> tuple[str, tuple[File, ...]]:
    """Format and files of a side, in natural order of their paths (part-2 before part-10).

    Raises
    ------
    InputError
        There is none, or there are some of a format that is not read in parts, or of two.
    """
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
