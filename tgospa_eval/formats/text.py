"""What all readers of text share: bytes, places for messages, columns of texts to numbers."""

import os
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tgospa_eval.errors import InputError
from tgospa_eval.formats.assemble import Rows, number_ids
from tgospa_eval.formats.columns import Roles
from tgospa_eval.formats.times import TimeError, more, parse_times, quoted, remedy_for
from tgospa_eval.trajectories import Floats

PACKED = {
    b"\x1f\x8b": "gzip",
    b"PK\x03\x04": "zip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\0": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
}
"""How compressed files begin."""


@dataclass(frozen=True, kw_only=True)
class Places:
    """Says where something is."""

    path: str
    lines: Sequence[int]
    names: Sequence[str]

    def row(self, row: int) -> str:
        """Path and line."""
        return f"{self.path}, line {self.lines[row]}"

    def field(self, row: int, column: int) -> str:
        """Path, line and column."""
        return f'{self.row(row)}, column "{self.names[column]}"'


def load(path: str) -> bytes:
    """The bytes of a file.

    Raises
    ------
    InputError
        It cannot be read.
    """
    try:
        if _is_endless(path):
            raise InputError(f"{path}: is a device, not a file")
        return Path(path).read_bytes()
    except MemoryError:
        raise InputError(f"{path}: larger than the memory of this machine") from None
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        if os.path.isdir(path):  # Windows says "permission denied"
            raise InputError(f"{path}: is a folder, not a file") from None
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', error)}") from None


def _is_endless(path: str) -> bool:
    """Whether it is a device such as /dev/zero; a terminal ends when its user says so."""
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
    for magic, program in PACKED.items():
        if data.startswith(magic):
            raise InputError(f"{path}: compressed by {program}; unpack it first")
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


def convert(columns: list[list[str]], roles: Roles, decimal: str, places: Places) -> Rows:
    """The rows of columns of texts; all mistakes in one error.

    Raises
    ------
    InputError
        An id is blank, a text is no number or no time, or infinite.
    """
    problems: list[str] = []
    ids = [text.strip() for text in columns[roles.id]]
    if "" in ids:
        place = places.field(ids.index(""), roles.id)
        problems.append(f"{place}: blank id{more(ids.count(''))}; name the object")
    values = np.empty((len(ids), len(roles.numbers)), order="F")
    for k, column in enumerate(roles.numbers):
        values[:, k], wrong = numbers(columns[column], decimal)
        problems += [f"{places.field(row, column)}: {message}" for row, message in wrong]
    try:
        times = parse_times(columns[roles.time], lambda texts: floats(texts, decimal))
    except TimeError as error:
        problems.append(f"{places.field(error.row, roles.time)}: {error}")
    if problems:
        raise InputError("\n".join(problems))
    classes = None
    if roles.klass is not None:
        classes = number_ids([text.strip() for text in columns[roles.klass]])
    return Rows(
        name=places.path,
        roles=roles,
        ids=number_ids(ids),
        times=times,
        numbers=values,
        where=places.row,
        classes=classes,
    )


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


def floats(texts: Sequence[str], decimal: str) -> Floats:
    """The exact doubles of a whole column; ValueError unless every text is a number."""
    joined = "".join(texts)
    if "_" in joined or not joined.isascii():  # float() takes 1_000 and digits of any script
        raise ValueError
    if decimal == ",":
        if "." in joined:
            raise ValueError
        texts = [text.replace(",", ".") for text in texts]
    return np.array(list(map(float, texts)), dtype=np.float64)


def numbers(texts: Sequence[str], decimal: str) -> tuple[Floats, list[tuple[int, str]]]:
    """A column of numbers, NaN where blank; and the first row of each kind of mistake."""
    wrong: list[int] = []
    try:
        values = floats(texts, decimal)
    except ValueError:
        values = np.full(len(texts), np.nan)
        for row, text in enumerate(texts):
            try:
                values[row] = floats([text], decimal)[0]
            except ValueError:
                if text.strip():
                    wrong.append(row)
    infinite = np.flatnonzero(np.isinf(values)).tolist()
    mistakes = []
    for rows, what, remedy in (
        (wrong, "not a number", remedy_for),
        (infinite, "infinite", lambda _: "leave it blank where the object is absent"),
    ):
        if rows:
            text = texts[rows[0]]
            mistakes.append((rows[0], f"{what}: {quoted(text)}{more(len(rows))}; {remedy(text)}"))
    return values, mistakes
