"""Files of one side that is read in parts: their list, their digests, and the rows of their pieces.

A *piece* is a part of a file that one task reads. In a Parquet file it is some row groups, and in a
text (a CSV file) a range of bytes.
"""

import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote

import numpy as np

from tgospa_eval.common.arrays import in_batches
from tgospa_eval.common.documents import TEXT, checked
from tgospa_eval.common.files import CHUNK, STDIN, named
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import natural
from tgospa_eval.common.writing import writing
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.arrow import arrow_rows, check_types, readable
from tgospa_eval.formats.guess import GUESSED_FROM, guess, is_table_folder
from tgospa_eval.formats.loading import PACKED_FROM, check_parquet, is_packed, plain_name, unpacking
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.roles import Roles, find_roles
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text.lines import HEADER_BYTES, check_text, decode
from tgospa_eval.formats.text.table import header_of, read_table, with_decimal
from tgospa_eval.partitioned.tasks import Run, removing
from tgospa_eval.quoting import listed, visible

if TYPE_CHECKING:
    import pyarrow as pa


PARQUET_SUFFIXES, CSV_SUFFIXES = (".parquet", ".pq"), (".csv", ".tsv")
"""Suffixes of the names of Parquet and of CSV files. A suffix of compression, such as .gz, can
follow."""

HIDDEN = ("_", ".")
"""First characters of the names of files and folders that are not data, such as _SUCCESS."""

NOT_IN_PARTS = "only Parquet and CSV are read in parts"


@dataclass(frozen=True)
class File:
    """A file of a side.

    Parameters
    ----------
    path : str
        Name of the file in messages.
    place : str
        Absolute path, which workers in any folder can use.
    keys : tuple of pairs of str
        Key and value of each folder named ``key=value`` that contains the file.
    """

    path: str
    place: str
    keys: tuple[tuple[str, str], ...] = ()


def files_of(path: str) -> tuple[str, tuple[File, ...]]:
    """Return the format of a side, and its files in natural order (part-2 before part-10).

    Raises
    ------
    InputError
        There is no file, the format of a file is not read in parts, or the formats differ.
    ConfigError
        The path is that of the standard input.
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
    files = sorted(_walk(path), key=lambda file: natural(file.path))
    kinds: dict[str, str] = {}
    for file in files:
        kinds.setdefault(_kind(file.path), file.path)
    if not files:
        raise InputError(f"{path}: no file in this folder; write Parquet or CSV files into it")
    if len(kinds) > 1:
        both = listed(sorted(os.path.relpath(each, path) for each in kinds.values()))
        raise InputError(f"{path}: files of two formats, {both}; write all as Parquet, or as CSV")
    return next(iter(kinds)), tuple(files)


def stored(path: str) -> Iterator[tuple[File, os.stat_result]]:
    """Yield the files of a side in the order of their paths, with the `os.stat` of each."""
    files = _walk(path) if os.path.isdir(path) else [File(path, os.path.abspath(path))]
    for file in sorted(files, key=lambda file: file.path):
        with suppress(FileNotFoundError):  # a broken link: reading it raises an error later
            yield file, os.stat(file.place)


def state_of(stat: os.stat_result) -> tuple[int, ...]:
    """Return the size, two times and the inode number of a file, to see if it has changed.

    The times are those of the last modification and of the last status change. A program can set
    back the first, but not the second. The number of the device is left out, because it can change
    with each mount.
    """
    return stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino


def _walk(folder: str) -> Iterator[File]:
    """Yield all files in a folder and its subfolders, except hidden ones."""

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
    """Decode the value of a key in the name of a folder, as written by Hive."""
    return "" if text == "__HIVE_DEFAULT_PARTITION__" else unquote(text)


def _kind(path: str) -> str:
    """Return the format of a file: ``"parquet"`` or ``"csv"``.

    Raises
    ------
    InputError
        The file has another format.
    """
    with named(path, InputError), open(path, "rb") as file:
        head = file.read(GUESSED_FROM)
    if head.startswith(b"PAR1"):
        return "parquet"
    match = re.search(r"\.[^./\\]*$", plain_name(path))
    suffix = match[0] if match else ""
    if suffix in PARQUET_SUFFIXES:
        if is_packed(head):
            raise InputError(
                f"{path}: a compressed Parquet file; unpack it, or compress its columns"
            )
        return "parquet"
    looks = "csv" if is_packed(head) or suffix in CSV_SUFFIXES else guess(path, head)
    if looks == "csv" and suffix in (*CSV_SUFFIXES, ".txt", ""):
        return "csv"
    what = "its name is not that of a table" if looks == "csv" else f"looks like {looks}"
    raise InputError(f"{path}: {what}; {NOT_IN_PARTS}: take it out, or convert it")


TOGETHER = 1 << 26
"""Largest number of bytes for which one task computes digests."""

CONTENT = "content"
"""Name of the subfolder of the folder of work that has the digests of all files of both sides."""

Stretch = tuple[File, int, int]
"""A range of bytes of a file: the file, the first byte, and the end."""


def changed_file(files: Sequence[tuple[File, os.stat_result]], work: Path, run: Run) -> str | None:
    """Empty the folder of work if the content of a file has changed since the results were made.

    A changed file can have the same size and times as before. For this reason, all files are read
    and compared by their digests, whenever the work begins or continues.

    Parameters
    ----------
    files : sequence of pairs
        Files of both sides with their status, from `stored`.
    work : Path
        Folder of the work.
    run : callable
        Function that does tasks, like `partitioned.tasks.run_tasks`.

    Returns
    -------
    str or None
        A file that has changed; None if no file has changed.

    Raises
    ------
    InputError
        A file cannot be read.
    """
    kept = work / CONTENT / "digests.json"
    kept.parent.mkdir(parents=True, exist_ok=True)
    fresh = tempfile.mkdtemp(dir=kept.parent)  # new, so that all digests are computed again
    batches = in_batches(_stretches(files), lambda stretch: stretch[2] - stretch[1], TOGETHER)
    stretches = {
        os.path.join(fresh, str(number)): tuple(some) for number, some in enumerate(batches)
    }
    run({output: partial(write_digests, stretches=some) for output, some in stretches.items()})
    now: dict[str, list[str]] = {}
    for output, some in stretches.items():
        digests = json.loads(Path(output).read_bytes())
        for (file, _, _), digest in zip(some, digests, strict=True):
            now.setdefault(file.path, []).append(digest)
    shutil.rmtree(fresh, ignore_errors=True)
    before = now
    if kept.exists():
        try:
            before = checked(kept.read_bytes(), {...: [TEXT]})
        except ValueError:  # the machine stopped before the file was written
            before = {}
    changed = [path for path in {**before, **now} if before.get(path) != now.get(path)]
    if changed:
        with removing(work, but=CONTENT):  # the old digests stay until all results are removed
            pass
    if changed or not kept.exists():
        with writing(str(kept)) as beside:
            beside.write_text(json.dumps(now), encoding="utf-8")
    return next(iter(changed), None)


def write_digests(output: str, stretches: Sequence[Stretch]) -> None:
    """Write the SHA-256 digest of each range of bytes in `stretches` to the file `output`.

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
    """Yield all bytes of all files in order, in ranges of at most `TOGETHER` bytes."""
    for file, stat in files:
        for begin in range(0, max(stat.st_size, 1), TOGETHER):
            yield file, begin, min(begin + TOGETHER, stat.st_size)


def read_head(file: File, options: ReadOptions) -> tuple[bytes, Roles, str, bool]:
    """Read the header of a CSV file.

    Returns
    -------
    head : bytes
        The bytes up to the end of the header.
    roles : Roles
        Roles of the columns.
    decimal : str
        Decimal mark of the numbers in the file.
    packed : bool
        Whether the file is compressed.

    Raises
    ------
    InputError
        The file is not a table, or lacks columns.
    """
    path = file.path
    with named(path, InputError), open(file.place, "rb") as source:
        packed = is_packed(source.read(PACKED_FROM))
    with unpacking(file.place, path) as stream:
        data = stream.read(HEADER_BYTES)
        data += stream.readline() if data else b""
    check_text(data, path)
    if b"\r" in data and b"\n" not in data:
        raise InputError(
            f"{path}: lines end in carriage returns alone, and such a file is not read in parts; "
            "save it with line feeds"
        )
    text = decode(data, path)
    _, roles, delimiter, first, start = header_of(text, path, options)
    roles, decimal = with_decimal(text[start:], delimiter, roles, options.decimal)
    begin = 0
    for _ in range(first - 1):
        begin = data.find(b"\n", begin) + 1 or len(data)
    content = data[:begin]
    if not content.endswith(b"\n"):
        content += b"\n"  # the file has only a header
    return content, roles, decimal, packed


Moved = Callable[[str], str]
"""Function that turns a message about a piece into a message about the file."""


def text_rows(file: File, begin: int, end: int, options: ReadOptions) -> Iterator[tuple[Rows, int]]:
    """Yield the rows of a range of bytes in chunks, each with the index of its first row.

    A line belongs to the range in which it begins. Indices count the rows of the range from 0.
    Exception: a compressed file is read as a whole, in chunks of about `end` bytes of unpacked
    text.

    Raises
    ------
    InputError
        A row is wrong; the message has its line number in the file.
    """
    head, _, decimal, packed = read_head(file, options)
    known = replace(options, decimal=decimal)
    pieces = _unpacked(file, head, end) if packed else _lines_between(file, head, begin, end)
    first = 0
    for content, lines_before in pieces:
        moved: Moved = partial(_moved, file.path, head.count(b"\n"), lines_before)
        try:
            rows = read_table(file.path, head + content, known, "truth", given=True)
        except InputError as error:
            raise InputError(*(moved(line) for line in error.args)) from None

        def where(
            row: int, in_piece: Callable[[int], str] = rows.where, moved: Moved = moved
        ) -> str:
            return moved(in_piece(row))

        yield replace(rows, where=where), first
        first += len(rows.times.value)


def _moved(path: str, header: int, lines_before: Callable[[], int], message: str) -> str:
    """Replace the line number in a message by the line number in the whole file.

    The message is about a text made of the header (`header` lines) and a later part of the file.
    `lines_before` returns the number of lines between the header and this part.
    """

    def line(match: re.Match[str]) -> str:
        number = int(match[2])
        return f"{match[1]}{number if number <= header else number + lines_before()}"

    return re.sub(rf"({re.escape(visible(path))}, line )(\d+)", line, message)


NumberedLines = tuple[bytes, Callable[[], int]]
"""Some lines of a file, and a function that counts the lines between the header and the first of
them."""


def _lines_between(file: File, head: bytes, begin: int, end: int) -> Iterator[NumberedLines]:
    """Yield the lines that begin in a range of bytes of a file, all at once."""
    start = max(begin, len(head))
    with named(file.path, InputError), open(file.place, "rb") as source:
        if start > len(head):
            source.seek(start - 1)
            start += len(source.readline()) - 1
        source.seek(start)
        content = source.read(end - start) if start < end else b""
        if content and not content.endswith(b"\n"):
            content += source.readline()
    if content:
        yield content, cache(partial(_lines, file, len(head), start))


def _lines(file: File, begin: int, end: int) -> int:
    """Return the number of line ends in a range of bytes of a file."""
    count = 0
    with named(file.path, InputError), open(file.place, "rb") as source:
        source.seek(begin)
        while begin < end and (content := source.read(min(CHUNK, end - begin))):
            count += content.count(b"\n")
            begin += len(content)
    return count


def _unpacked(file: File, head: bytes, size: int) -> Iterator[NumberedLines]:
    """Yield all lines of a compressed file, about `size` bytes at a time."""
    before = 0
    with unpacking(file.place, file.path) as stream:
        stream.read(len(head))
        while content := stream.read(size):
            content += stream.readline()
            yield content, partial(int, before)
            before += content.count(b"\n")


def size_of(file: File) -> int:
    """Return the stored size of a file in bytes."""
    with named(file.path, InputError):
        return os.path.getsize(file.place)


DECODED = 1 << 17
"""Number of rows that are decoded at once."""

BYTES_OF_COLUMN = 1 << 20
"""Number of bytes of a column that are read at once. The limit is needed because a row group can be
larger than memory."""


def table_rows(
    file: File, begin: int, end: int, options: ReadOptions
) -> Iterator[tuple[Rows, int]]:
    """Yield the rows of some row groups of a Parquet file in chunks, each with its first index.

    The first index is that of the first row of the chunk among all rows of the file.

    Raises
    ------
    InputError
        The file is damaged, or a value is wrong; the message has its row number in the file.
    """
    content, schema, roles = open_table(file, options)
    columns = [schema.names[column] for column in roles.used]
    row = sum(content.metadata.row_group(group).num_rows for group in range(begin))
    for table in _batches(file, content, range(begin, end), columns):
        where = partial(_row_of, file.path, row)
        yield arrow_rows(file.path, "Parquet", schema, table.select, options, where), row
        row += len(table)


def _row_of(path: str, first: int, row: int) -> str:
    return f"{path}, row {first + row}"


def _batches(
    file: File, content: "pa.parquet.ParquetFile", groups: range, columns: list[str]
) -> "Iterator[pa.Table]":
    """Yield columns of row groups, some rows at a time.

    If the file lacks a column and one of its folders is named ``column=value``, all rows of the
    column have this value.
    """
    import pyarrow as pa

    own = [name for name in columns if name in content.schema_arrow.names]
    keys = {key: text for key, text in file.keys if key in columns and key not in own}
    with readable(file.path, "Parquet"):
        for batch in content.iter_batches(
            batch_size=DECODED, row_groups=groups, columns=own, use_threads=False
        ):
            table = pa.Table.from_batches([batch])
            for key, text in keys.items():
                code = pa.array(np.zeros(len(batch), np.int32))
                column = pa.DictionaryArray.from_arrays(code, pa.array([text]))
                table = table.append_column(key, column)
            yield table


def open_table(
    file: File, options: ReadOptions
) -> "tuple[pa.parquet.ParquetFile, pa.Schema, Roles]":
    """Open a Parquet file, and determine the roles of its columns.

    Returns
    -------
    pyarrow.parquet.ParquetFile
        The open file.
    pyarrow.Schema
        Columns of the file. If a needed column is missing, the keys of the folders that contain the
        file are added as columns.
    Roles
        Roles of the columns.

    Raises
    ------
    InputError
        The file is not a Parquet file, or lacks columns.
    ConfigError
        pyarrow is not installed.
    """
    check_parquet(begin=f"{file.path}: ")
    import pyarrow as pa  # lazy: pyarrow is optional
    import pyarrow.parquet as pq

    with named(file.path, InputError):
        if not os.path.getsize(file.place):
            raise InputError(
                f"{file.path}: the file is empty; a part without objects has a schema and no rows"
            )
    with readable(file.path, "Parquet"):
        content = pq.ParquetFile(file.place, buffer_size=BYTES_OF_COLUMN, pre_buffer=False)
        schema = content.schema_arrow
    keys = [pa.field(key, pa.string()) for key, _ in file.keys if key not in schema.names]
    whole = pa.schema([*schema, *keys])
    try:
        roles = find_roles(list(schema.names), options, file.path)
        absent = {*options.attributes} - {*roles.attributes}
        if roles.klass is None and options.classes is not None:
            absent.add("class")
        if keys and absent:
            raise InputError  # try again with the keys of folders
        whole = schema
    except InputError:
        if not keys:
            raise
        roles = find_roles(list(whole.names), options, file.path)
    check_types(whole, roles, file.path)
    return content, whole, roles


@dataclass(frozen=True, kw_only=True)
class FilePiece:
    """A piece of a file: row groups, or the lines that begin in a range of bytes.

    Parameters
    ----------
    file : File
        The file.
    begin, end : int
        Index of the first row group or byte of the piece, and the index after the last one. For a
        compressed text, the piece is the whole file, and `end` is the number of bytes of unpacked
        text to read at a time.
    text : bool
        Whether the file is a text.
    """

    file: File
    begin: int
    end: int
    text: bool

    def rows(self, options: ReadOptions) -> Iterator[tuple[Rows, int]]:
        """Yield the rows of the piece in chunks, each with the index of its first row.

        In a Parquet file, indices count all rows of the file; in a text, the rows of this piece.
        """
        return (text_rows if self.text else table_rows)(self.file, self.begin, self.end, options)

    def where(self, row: int, options: ReadOptions) -> str:
        """Return the place of a row for messages: file, and row or line.

        `row` is the index of the row, counted as by `rows`.
        """
        if not self.text:
            return _row_of(self.file.path, 0, row)
        for rows, first in self.rows(options):
            if row < first + len(rows.times.value):
                return rows.where(row - first)
        return self.file.path  # the row is missing: the file was changed meanwhile
