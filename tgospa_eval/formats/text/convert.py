"""What all readers of text share: bytes, places for messages, columns of texts to numbers."""

import os
import stat
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from tgospa_eval.common.files import SETTINGS, STDIN, named, read_bytes
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.attributes import attribute_of
from tgospa_eval.formats.columns.roles import Roles
from tgospa_eval.formats.fields import Coded, floats
from tgospa_eval.formats.rows import Numbered, Rows, number_ids
from tgospa_eval.formats.times import TimeError, Times, parse_times, remedy_for
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Floats, Ints

LETTERS_TOGETHER = 1 << 17
"""Letters of text that are turned into fields at a time."""

COMPRESSED = {
    b"PK\x03\x04": "zip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\0": "xz",
}
"""How compressed files begin that are not unpacked here; `formats.unpack` unpacks others."""


@dataclass(frozen=True, kw_only=True)
class Places:
    """Where something is, for messages."""

    path: str
    lines: Ints | range
    names: Sequence[str]

    def row(self, row: int) -> str:
        """Path and line."""
        return f"{self.path}, line {self.lines[row]}"

    def field(self, row: int, column: int) -> str:
        """Path, line and column."""
        return f"{self.row(row)}, column {quoted(self.names[column])}"


def load(path: str, most: int = SETTINGS) -> bytes:
    """The bytes of a file, at most so many.

    Raises
    ------
    InputError
        It cannot be read.
    """
    with named(path, InputError):
        try:
            endless = _is_endless(path)
        except FileNotFoundError:
            raise InputError(f"{path}: no such file") from None
        if endless:
            raise InputError(f"{path}: is a device, not a file")
    try:
        if most == SETTINGS:
            return read_bytes(path, InputError)
        return read_bytes(path, InputError, most, "allow more with --max-input GB, or any with 0")
    except MemoryError:
        raise InputError(f"{path}: larger than the memory of this machine") from None


def _is_endless(path: str) -> bool:
    """Whether it is a device such as /dev/zero; a terminal ends when its user ends it."""
    if path == STDIN:
        return False
    mode = os.stat(path).st_mode
    if stat.S_ISBLK(mode):
        return True
    if not stat.S_ISCHR(mode):
        return False
    with open(path, "rb", buffering=0) as device:
        return not device.isatty()


def check_text(data: bytes, path: str) -> None:
    """Whether the bytes can be text.

    Raises
    ------
    InputError
        There are none, or they are binary or UTF-16.
    """
    if not data:
        raise InputError(
            f"{path}: the file is empty; a set without objects is a header alone, or text of "
            "MOTChallenge or KITTI whose format is named (--truth-format, --estimate-format)"
        )
    for magic, program in COMPRESSED.items():
        if data.startswith(magic):
            raise InputError(f"{path}: compressed by {program}; unpack it, or use gzip or zstd")
    if data[:4] in (b"\xff\xfe\0\0", b"\0\0\xfe\xff"):
        raise InputError(f"{path}, line 1: UTF-32 text; save the file as UTF-8")
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(f"{path}, line 1: UTF-16 text; save the file as UTF-8")
    if 0 in data:
        line = data.count(b"\n", 0, data.index(0)) + 1
        raise InputError(
            f"{path}, line {line}: binary data, not text; a CSV, Parquet, MOTChallenge or KITTI "
            "file is needed"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Block:
    """Some rows of a file, all fields as texts.

    Parameters
    ----------
    lines : (R,) int array
        Line of each row.
    columns : sequence of sequences of str
        The fields, column by column.
    """

    lines: Ints
    columns: Sequence[Sequence[str]]


def chunks(text: str, start: int = 0) -> Iterator[str]:
    """The text from `start` on in whole lines, some 10^5 letters at a time."""
    stop = len(text.rstrip("\n"))
    while start < stop:
        end = text.find("\n", start + LETTERS_TOGETHER, stop)
        end = stop if end < 0 else end
        yield text[start:end]
        start = end + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Fields:
    """The columns of a file that are used.

    Parameters
    ----------
    lines : (R,) int array or range
        Line of each row.
    coded : dict of int to Coded
        Texts, by column.
    values : (R, n) float array
        The columns `Roles.numbers`, NaN where blank.
    mistakes : sequence of tuple
        Column and row of what is no number, and the message.
    """

    lines: Ints | range
    coded: dict[int, Coded]
    values: Floats
    mistakes: Sequence[tuple[int, int, str]] = ()


def text_columns(roles: Roles, texts: Sequence[int] = ()) -> tuple[int, ...]:
    """Columns that are read as texts: ids, times, classes, attributes, and those asked for."""
    klass = () if roles.klass is None else (roles.klass,)
    return tuple(dict.fromkeys((roles.id, roles.time, *texts, *klass, *roles.texts)))


def gather(
    blocks: Iterable[Block], roles: Roles, decimal: str, texts: Sequence[int] = ()
) -> Fields:
    """The columns of blocks of texts; `texts` are more columns to be returned as such.

    A block is turned into numbers before the next one is asked for: texts of numbers are not held,
    of others each distinct one.
    """
    coders = {column: _Coder() for column in text_columns(roles, texts)}
    readers = {column: Numbers(decimal) for column in roles.numbers}
    lines: list[Ints] = [np.zeros(0, np.int64)]
    for block in blocks:
        lines.append(block.lines)
        for column, coder in coders.items():
            coder.add(block.columns[column])
        for column, reader in readers.items():
            reader.add(block.columns[column])
    coded = {column: coder.coded() for column, coder in coders.items()}
    del coders
    numbers = np.concatenate(lines)
    values = np.empty((len(numbers), len(roles.numbers)), order="F")
    mistakes: list[tuple[int, int, str]] = []
    for k, column in enumerate(roles.numbers):
        reader = readers.pop(column)
        values[:, k] = reader.values()
        mistakes += [(column, row, message) for row, message in reader.mistakes]
    return Fields(lines=numbers, coded=coded, values=values, mistakes=mistakes)


def convert(
    fields: Fields,
    roles: Roles,
    decimal: str,
    path: str,
    names: Sequence[str],
    *,
    name_id: Callable[[str], str] = str.strip,
) -> tuple[Rows, Places]:
    """The rows of the fields of a file, and where they are; all mistakes in one error.

    Parameters
    ----------
    fields : Fields
        The columns.
    roles : Roles
        Which column is what.
    decimal : str
        Decimal mark.
    path, names
        The file and its columns, for messages.
    name_id : callable
        Text of an id to its name.

    Raises
    ------
    InputError
        An id is blank, a text is no number or no time, or infinite.
    """
    coded = fields.coded
    places = Places(path=path, lines=fields.lines, names=names)
    problems: list[str] = []
    of_weights: list[str] = []  # a column of this name may be something else
    ids = numbered(coded[roles.id], name_id)
    blank = blanks(ids)
    if len(blank):
        place = places.field(int(blank[0]), roles.id)
        problems.append(f"{place}: blank id{more(len(blank))}; name the object")
    for column, row, message in fields.mistakes:
        wrong = of_weights if column == roles.weight else problems
        wrong.append(f"{places.field(row, column)}: {message}")
    try:
        times = coded_times(coded[roles.time], decimal)
    except TimeError as error:
        problems.append(f"{places.field(error.row, roles.time)}: {error}")
    if problems:
        raise InputError(*problems)
    rows = Rows(
        name=path,
        roles=roles,
        ids=ids,
        times=times,
        numbers=fields.values,
        where=places.row,
        classes=None if roles.klass is None else numbered(coded[roles.klass]),
        attributes={column: attribute_of(coded[column], decimal) for column in roles.texts},
        weight_fault="\n".join(of_weights) or None,
    )
    return rows, places


class _Coder:
    """A column of texts, block by block."""

    def __init__(self) -> None:
        self.seen: dict[str, int] = {}
        self.blocks: list[Ints] = [np.zeros(0, np.int64)]

    def add(self, texts: Sequence[str]) -> None:
        seen = self.seen
        for text in dict.fromkeys(texts):  # most are repeated
            seen.setdefault(text, len(seen))
        self.blocks.append(np.fromiter(map(seen.__getitem__, texts), np.int64, len(texts)))

    def coded(self) -> Coded:
        code, self.blocks = np.concatenate(self.blocks), []
        return Coded(list(self.seen), code)


def numbered(column: Coded, name: Callable[[str], str] = str.strip) -> Numbered:
    """Distinct names in natural order, and the number of each row's."""
    table, number = number_ids([name(text) for text in column.distinct])
    return table, number[column.code]


def blanks(column: Numbered) -> Ints:
    """Rows without a name."""
    table, number = column
    names = table.tolist()  # a list is searched ten times as fast
    return np.flatnonzero(number == names.index("")) if "" in names else number[:0]


def coded_times(column: Coded, decimal: str) -> Times:
    """Times of a column, each distinct text parsed once.

    Raises
    ------
    TimeError
        As `formats.times.parse_times`, of the first row that is wrong.
    """

    def to_floats(texts: Sequence[str]) -> Floats:
        return floats(texts, decimal)

    try:
        times = parse_times(column.distinct, to_floats)
    except TimeError:
        return parse_times(list(column), to_floats)  # its error has the row, and their number
    text = None if times.text is None else column
    return Times(value=times.value[column.code], clock=times.clock, text=text)


def decode(data: bytes, path: str) -> str:
    """The text, with one kind of line end."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}, line {line}: not UTF-8 (byte 0x{data[error.start]:02x}); save it as UTF-8"
        ) from None
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    return text


class Numbers:
    """A column of numbers, NaN where blank, block by block; and the mistakes in it."""

    def __init__(self, decimal: str) -> None:
        self.decimal = decimal
        self.blocks: list[Floats] = [np.zeros(0)]
        self.rows = 0
        self.wrong: dict[str, tuple[int, str, int]] = {}

    def add(self, texts: Sequence[str]) -> None:
        """The next rows."""
        try:
            values = floats(texts, self.decimal)
        except ValueError:
            values = np.full(len(texts), np.nan)
            for row, text in enumerate(texts):
                try:
                    values[row] = floats([text], self.decimal)[0]
                except ValueError:
                    if text.strip():
                        self._count("not a number", row, text)
        for row in np.flatnonzero(np.isinf(values)).tolist():
            self._count("infinite", row, texts[row])
        self.blocks.append(values)
        self.rows += len(values)

    def _count(self, what: str, row: int, text: str) -> None:
        first, text, count = self.wrong.get(what, (self.rows + row, text, 0))
        self.wrong[what] = first, text, count + 1

    def values(self) -> Floats:
        """All rows."""
        return np.concatenate(self.blocks)

    @property
    def mistakes(self) -> Iterator[tuple[int, str]]:
        """The first row of each kind of mistake, and its message."""
        for what in ("not a number", "infinite"):
            if what in self.wrong:
                row, text, count = self.wrong[what]
                remedy = remedy_for(text if what == "not a number" else "")
                yield row, f"{what}: {quoted(text)}{more(count)}; {remedy}"


def numbers(texts: Sequence[str], decimal: str) -> tuple[Floats, list[tuple[int, str]]]:
    """A column of numbers, NaN where blank; and the first row of each kind of mistake."""
    column = Numbers(decimal)
    column.add(texts)
    return column.values(), list(column.mistakes)
