"""Structures and cells of MAT files: version 5 (-v6, -v7), and 7.3, which is HDF5 and needs h5py.

Version 5 is read here, by the published description of the format: SciPy's reader ends the process
(segmentation fault) with one damaged file in some hundred, and unpacks whatever a file claims.
"""

import math
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError, InputError, TgospaError
from tgospa_eval.formats.room import TABLE, check_room

Fields = dict[str, NDArray[np.generic]]
"""Fields of a structure; of what is no array of real numbers an array of objects."""

MAT_5, MAT_73 = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"
"""How files begin."""

TEXT_HEADER = 128
MATRIX, DEFLATED = 14, 15
"""Types of elements: an array, and one that is compressed."""

ELEMENT_TYPES = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
"""Types of elements that hold numbers."""

CELL_ARRAY, STRUCTURE = 1, 2
NUMERIC = range(6, 16)
"""Classes of arrays."""

COMPLEX = 0x800
"""Flag of an array."""

EMPTY = "MATLAB_empty"
"""Attribute of HDF5."""

BEGIN_BYTES = 1 << 12
"""Bytes of a variable that mostly have its class, its name and those of its fields."""

INFLATED_BYTES = 1 << 24
"""Bytes that are unpacked at a time."""

NO_NUMBERS = np.empty(1, dtype=object)

DAMAGES = (ValueError, struct.error, IndexError, KeyError, OverflowError, zlib.error)
"""In what reading a damaged file ends."""


class Variable(NamedTuple):
    """A variable of a file.

    Parameters
    ----------
    cells : int, optional
        How many elements a cell has; None is no cell.
    fields : frozenset of str
        Names of the fields of a structure; of a cell those of its first element that is not empty.
    read : callable
        Gives the fields of the structure, or of the element at a place, from 0 on; none of what is
        no single structure.
    """

    cells: int | None
    fields: frozenset[str]
    read: Callable[[int], Fields]


@contextmanager
def variables(path: str, data: bytes, limit: float | None) -> Iterator[dict[str, Variable]]:
    """Variables of a file by name, to be read while the context lasts.

    Parameters
    ----------
    path : str
        The file, for messages.
    data : bytes
        Its content.
    limit : float, optional
        GB that it may take, see `formats.room.check_room`.

    Raises
    ------
    InputError
        It is no MAT file of these versions, damaged, or too large.
    ConfigError
        h5py is not installed, and the file needs it.
    """
    if data.startswith(MAT_73):
        with _of_version_73(path, data, limit) as found:
            yield found
        return
    if not data.startswith(MAT_5):
        raise InputError(f"{path}: no MAT file of version 5 or 7.3; save with -v7 in MATLAB")

    def room(size: int) -> None:
        check_room(path, TABLE * size, len(data), limit, f"arrays of {size:,} bytes")

    room(len(data))
    order = "<" if data[126:128] == b"IM" else ">"
    try:
        yield dict(_variables(data, order, room))
    except TgospaError:
        raise
    except DAMAGES as error:
        raise _damaged(path, error) from None


class _Element(NamedTuple):
    """A piece of a file: its type, where its content is, and where the next one begins."""

    kind: int
    begin: int
    end: int
    next: int


def _tag(data: bytes, at: int, order: str) -> _Element:
    """The element that begins there, of which the data may have the beginning alone."""
    word = struct.unpack_from(f"{order}I", data, at)[0]
    if word >> 16:  # a small one: type, size and content in eight bytes
        return _Element(word & 0xFFFF, at + 4, at + 4 + (word >> 16), at + 8)
    size = struct.unpack_from(f"{order}I", data, at + 4)[0]
    return _Element(word, at + 8, at + 8 + size, at + 8 + size + -size % 8)


def _element(data: bytes, at: int, order: str) -> _Element:
    """The element that begins there; ValueError if the data end before it does."""
    found = _tag(data, at, order)
    is_small = found.begin == at + 4
    if found.end > len(data) or (is_small and not found.end <= found.next <= len(data)):
        raise ValueError("it ends early")
    return found


def _variables(
    data: bytes, order: str, room: Callable[[int], None]
) -> Iterator[tuple[str, Variable]]:
    """Variables one by one; what is compressed is unpacked as far as it is needed."""
    at = TEXT_HEADER
    while at < len(data):
        element = _element(data, at, order)
        at = element.end if element.kind == DEFLATED else element.next
        begin = element.begin - (0 if element.kind == DEFLATED else 8)
        content = _Content(data[begin : element.end], room, packed=element.kind == DEFLATED)
        name, cells, fields = content.understood(order)

        def read(place: int, content: _Content = content) -> Fields:
            return _structure(content.whole(), order, place)

        yield name, Variable(cells, fields, read)


class _Content:
    """The bytes of a variable, of a compressed one as many as were asked for.

    Parameters
    ----------
    data : bytes
        As in the file.
    room : callable
        Raises if there is none for so many bytes.
    packed : bool
        Whether they are compressed.
    """

    def __init__(self, data: bytes, room: Callable[[int], None], *, packed: bool) -> None:
        self._room = room
        self._inflate = zlib.decompressobj()
        self._data = self._inflate.decompress(data, BEGIN_BYTES) if packed else data

    def understood(self, order: str) -> tuple[str, int | None, frozenset[str]]:
        """What `_begin` finds, from no more bytes than it takes."""
        while True:
            try:
                return _begin(self._data, order)
            except (ValueError, struct.error):
                if not self._inflate.unconsumed_tail:
                    raise
            self._unpack(INFLATED_BYTES)

    def whole(self) -> bytes:
        """All of them."""
        while self._inflate.unconsumed_tail:
            self._unpack(max(INFLATED_BYTES, len(self._data)))
        return self._data

    def _unpack(self, size: int) -> None:
        self._data += self._inflate.decompress(self._inflate.unconsumed_tail, size)
        self._room(len(self._data))


class _Array(NamedTuple):
    """What an array begins with; functions and objects have a class alone."""

    kind: int
    real: bool
    sizes: tuple[int, ...]
    name: str
    rest: int


def _array(data: bytes, begin: int, order: str) -> _Array:
    """The first parts of an array: flags, dimensions, name."""
    flags = _element(data, begin, order)
    word = struct.unpack_from(f"{order}I", data, flags.begin)[0]
    if word & 0xFF > NUMERIC[-1]:
        return _Array(word & 0xFF, False, (), "", flags.next)
    sizes = _element(data, flags.next, order)
    count = (sizes.end - sizes.begin) // 4
    name = _element(data, sizes.next, order)
    return _Array(
        word & 0xFF,
        not word & COMPLEX,
        struct.unpack_from(f"{order}{count}i", data, sizes.begin),
        data[name.begin : name.end].decode("ascii", "replace"),
        name.next,
    )


def _begin(data: bytes, order: str) -> tuple[str, int | None, frozenset[str]]:
    """Name of a variable, elements of a cell, names of fields, from the beginning of its bytes."""
    array = _array(data, _inside(_tag(data, 0, order)), order)
    if array.kind != CELL_ARRAY:
        return array.name, None, frozenset(_fields_of(data, array, order)[0])
    at, count = array.rest, max(math.prod(array.sizes), 0)
    for _ in range(count):
        element = _tag(data, at, order)
        at = element.next
        if element.end > _inside(element):  # not empty in few bytes
            inner = _array(data, element.begin, order)
            if math.prod(inner.sizes):
                return array.name, count, frozenset(_fields_of(data, inner, order)[0])
    return array.name, count, frozenset()


def _inside(element: _Element) -> int:
    """Where the parts of an array begin."""
    if element.kind != MATRIX:
        raise ValueError(f"an element of type {element.kind}, not an array")
    return element.begin


def _fields_of(data: bytes, array: _Array, order: str) -> tuple[list[str], int]:
    """Names of the fields of a structure, and where they begin; none of several in an array."""
    if array.kind != STRUCTURE or math.prod(array.sizes) != 1:
        return [], array.rest
    size = _element(data, array.rest, order)
    width = struct.unpack_from(f"{order}i", data, size.begin)[0]
    names = _element(data, size.next, order)
    text = data[names.begin : names.end]
    if width < 1 or len(text) % width:
        raise ValueError("names of fields of odd lengths")
    starts = range(0, len(text), width)
    found = (text[k : k + width].partition(b"\0")[0] for k in starts)
    return [name.decode("ascii", "replace") for name in found], names.next


def _structure(data: bytes, order: str, place: int) -> Fields:
    """Fields of a structure, or of the one at a place in a cell."""
    array = _array(data, _inside(_element(data, 0, order)), order)
    if array.kind == CELL_ARRAY:
        at = array.rest
        for _ in range(place):
            at = _element(data, at, order).next
        element = _element(data, at, order)
        if _inside(element) == element.end:
            return {}
        array = _array(data, element.begin, order)
    names, at = _fields_of(data, array, order)
    found: Fields = {}
    for name in names:
        field = _element(data, at, order)
        found[name] = _numbers(data, field, order)
        at = field.next
    return found


def _numbers(data: bytes, field: _Element, order: str) -> NDArray[np.generic]:
    """An array of real numbers in the order of MATLAB."""
    if _inside(field) == field.end:
        return np.zeros((0, 0))
    array = _array(data, field.begin, order)
    if array.kind not in NUMERIC or not array.real:
        return NO_NUMBERS
    if not math.prod(array.sizes):
        return np.zeros(array.sizes)
    real = _element(data, array.rest, order)
    values = np.frombuffer(data[real.begin : real.end], f"{order}{ELEMENT_TYPES[real.kind]}")
    return np.asarray(values.reshape(array.sizes, order="F"))


@contextmanager
def _of_version_73(path: str, data: bytes, limit: float | None) -> Iterator[dict[str, Variable]]:
    """The same of HDF5, whose dimensions are in reverse order."""
    try:
        import h5py  # here: the extra may be missing, and other formats do without
    except ModuleNotFoundError:
        raise ConfigError(
            f"{path}: MAT files of version 7.3 need the extra matlab: {install('matlab')}; or save "
            "with -v7 in MATLAB"
        ) from None
    try:
        # The bytes themselves: a file object of Python that HDF5 calls ends the process at times.
        access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
        access.set_fapl_core(backing_store=False)
        access.set_file_image(data)
        name = os.fsencode(os.path.join(path, "image"))  # must be no file, and none is below one

        def room(size: int, what: str) -> None:
            check_room(path, TABLE * size, len(data), limit, f"{what} of {size:,} bytes")

        with h5py.File(h5py.h5f.open(name, h5py.h5f.ACC_RDONLY, access)) as file:
            names = [name for name in file if not name.startswith("#")]
            yield {name: _of_group(_held(file, name), room, name) for name in names}
    except (TgospaError, MemoryError):
        raise
    except Exception as error:  # damaged files end in errors of many kinds
        raise _damaged(path, error) from None


Room = Callable[[int, str], None]
"""Raises if there is none for so many bytes, of what."""


def _held(group: Any, name: str) -> Any:
    """What a group has by a name; nothing of what is not in this very file."""
    import h5py

    return group[name] if isinstance(group.get(name, getlink=True), h5py.HardLink) else None


def _of_group(item: Any, room: Room, name: str) -> Variable:
    """A variable of HDF5: a group is a structure, references are the elements of a cell."""
    import h5py

    is_cell = isinstance(item, h5py.Dataset) and h5py.check_ref_dtype(item.dtype) is h5py.Reference
    if not is_cell or item.external or item.is_virtual:
        return Variable(None, _names(item), lambda _: _fields(item, room))
    room(item.nbytes, name)
    elements = np.asarray(item[()]).T.ravel(order="F")
    filled = (
        element for element in map(item.file.__getitem__, elements) if not element.attrs.get(EMPTY)
    )
    names = _names(next(filled, None))
    return Variable(len(elements), names, lambda at: _fields(item.file[elements[at]], room))


def _names(item: Any) -> frozenset[str]:
    """Names of the fields of a structure, which is a group."""
    import h5py

    return frozenset(item) if isinstance(item, h5py.Group) else frozenset()


def _fields(group: Any, room: Room) -> Fields:
    """Fields of a structure; only what is in this very file is followed."""
    import h5py

    found: Fields = {}
    for field in sorted(_names(group)):
        data = _held(group, field)
        if not isinstance(data, h5py.Dataset) or data.external or data.is_virtual:
            continue
        room(data.nbytes, field)
        values = np.asarray(data[()]).T
        if data.attrs.get(EMPTY):  # which has its dimensions for values
            sizes = [int(size) for size in values.ravel()]
            if 0 not in sizes:
                raise ValueError(f"{field} is called empty, and is not")
            values = np.zeros(sizes)
        found[field] = values
    return found


def _damaged(path: str, error: Exception) -> InputError:
    reason = (str(error).splitlines() or [type(error).__name__])[0]
    return InputError(f"{path}: no readable MAT file: {reason}")
