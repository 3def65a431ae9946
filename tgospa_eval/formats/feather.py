"""Feather tables, the files of Arrow IPC, with the columns of the CSV files; needs pyarrow."""

import struct
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.room import TABLE, check_room
from tgospa_eval.formats.rows import Rows

if TYPE_CHECKING:
    import pyarrow as pa

FIRST_VERSION = b"FEA1"
PREAMBLE = 8
"""Bytes before the messages: ARROW1 and two of zero."""

HEADERS = {"record batch": (), "dictionary": (1,)}
"""Where in the header of a message the lengths of its arrays are."""


def read_feather(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a Feather file, the same in either role; only the columns in use are read.

    Raises
    ------
    InputError
        The file is no Feather, or see `formats.read`. Rows count from 0.
    ConfigError
        pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # here: the extra may be missing, and other formats do without
        from pyarrow import ipc
    except ModuleNotFoundError:
        raise ConfigError(
            f"{path}: Feather files need the extra parquet: {install('parquet')}"
        ) from None
    from tgospa_eval.formats.arrow import arrow_rows, damaged

    if not data:
        raise InputError(
            f"{path}: the file is empty; a set without objects has a schema and no rows"
        )
    if data.startswith(FIRST_VERSION):
        raise InputError(f"{path}: Feather of version 1; write version 2, the default since 2020")
    # The messages in their order, not by the footer: what was measured is what is read.
    content = pa.py_buffer(data)[PREAMBLE:]
    try:
        schema = ipc.open_stream(content).schema
    except (pa.ArrowException, OSError, ValueError) as error:
        raise damaged(path, "Feather", error) from None

    def read(subset: Sequence[str]) -> "pa.Table":
        rows, unpacked = _lengths(content)
        what = f"{rows:,} rows of {len(subset)} columns, {unpacked:,} bytes"
        size = TABLE * max(8 * rows * len(subset), unpacked)
        check_room(path, size, len(data), options.max_input, what)
        wanted = ipc.IpcReadOptions(included_fields=[schema.names.index(name) for name in subset])
        return ipc.open_stream(content, options=wanted).read_all()

    return arrow_rows(path, "Feather", schema, read, options)


def _lengths(content: "pa.Buffer") -> tuple[int, int]:
    """Rows of all batches, and the bytes to which their arrays unpack, before any does.

    By the columnar format of Arrow: a message is a flatbuffer and a body; a compressed array of
    the body begins with its length.
    """
    from pyarrow import ipc

    rows = unpacked = 0
    for message in _all(ipc.MessageReader.open_stream(content)):
        if message.type not in HEADERS:
            continue
        try:
            batch = _Table.root(message.metadata.to_pybytes()).table(2)
            for field in HEADERS[message.type]:
                batch = batch.table(field)
            rows += batch.integer(0)
            body = memoryview(message.body) if message.body is not None else b""
            packed = batch.at(3) is not None
            for offset, length in batch.pairs(2):
                size = struct.unpack_from("<q", body, offset)[0] if packed and length else -1
                unpacked += length if size < 0 else size
        except (struct.error, ValueError):
            raise OSError("a damaged message") from None
    return rows, unpacked


def _all(messages: "pa.ipc.MessageReader") -> "Iterator[pa.ipc.Message]":
    """The messages up to their end."""
    while True:
        try:
            yield messages.read_next_message()
        except StopIteration:
            return


class _Table:
    """A table of a flatbuffer: its fields are where a table of offsets says, or missing."""

    def __init__(self, data: bytes, begin: int) -> None:
        self.data = data
        self.begin = begin

    @classmethod
    def root(cls, data: bytes) -> "_Table":
        """The outermost."""
        return cls(data, struct.unpack_from("<I", data)[0])

    def at(self, field: int) -> int | None:
        """Where a field is."""
        offsets = self.begin - struct.unpack_from("<i", self.data, self.begin)[0]
        if 4 + 2 * field >= struct.unpack_from("<H", self.data, offsets)[0]:
            return None
        offset: int = struct.unpack_from("<H", self.data, offsets + 4 + 2 * field)[0]
        return self.begin + offset if offset else None

    def integer(self, field: int) -> int:
        """A number of 64 bits, 0 where it is missing."""
        at = self.at(field)
        return 0 if at is None else int(struct.unpack_from("<q", self.data, at)[0])

    def _target(self, field: int) -> int:
        at = self.at(field)
        if at is None:
            raise ValueError
        return at + int(struct.unpack_from("<I", self.data, at)[0])

    def table(self, field: int) -> "_Table":
        """A table inside; ValueError where it is missing."""
        return _Table(self.data, self._target(field))

    def pairs(self, field: int) -> "Iterator[tuple[int, int]]":
        """A vector of pairs of numbers of 64 bits."""
        begin = self._target(field)
        count = struct.unpack_from("<I", self.data, begin)[0]
        for k in range(count):
            first, second = struct.unpack_from("<qq", self.data, begin + 4 + 16 * k)
            yield first, second
