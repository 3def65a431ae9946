"""Structures of MAT files: version 5 (-v6, -v7), and 7.3, which is HDF5 and needs h5py.

Version 5 is read here, by the published description of the format: SciPy's reader ends the process
(segmentation fault) with one damaged file in some hundred, and unpacks whatever a file claims.
"""

import math
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.words import install
from tgospa_eval.errors import ConfigError, InputError
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

STRUCTURE = 2
NUMERIC = range(6, 16)
"""Classes of arrays."""

COMPLEX = 0x800
"""Flag of an array."""

BEGIN_BYTES = 1 << 12
"""Bytes of a variable that have its class and name."""

INFLATED_BYTES = 1 << 24
"""Bytes that are unpacked at a time."""

NO_NUMBERS = np.empty(1, dtype=object)

DAMAGES = (ValueError, struct.error, IndexError, KeyError, OverflowError, zlib.error)
"""In what reading a damaged file ends."""


def structures(path: str, data: bytes, limit: float | None) -> dict[str, Fields]:
    """Variables of a file by name, with the fields of those that are one structure.

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
        return _of_version_73(path, data, limit)
    if not data.startswith(MAT_5):
        raise InputError(f"{path}: no MAT file of version 5 or 7.3; save with -v7 in MATLAB")

    def room(size: int) -> None:
        check_room(path, TABLE * size, len(data), limit, f"arrays of {size:,} bytes")

    room(len(data))
    order = "<" if data[126:128] == b"IM" else ">"
    try:
        return dict(_variables(data, order, room))
    except DAMAGES as error:
        raise _damaged(path, error) from None


class _Element(NamedTuple):
    """A piece of a file: its type, where its content is, and where the next one begins."""

    kind: int
    begin: int
    end: int
    next: int


def _element(data: bytes, at: int, order: str) -> _Element:
    """The element that begins there; ValueError if the data end before it does."""
    word = struct.unpack_from(f"{order}I", data, at)[0]
    if word >> 16:  # a small one: type, size and content in eight bytes
        found = _Element(word & 0xFFFF, at + 4, at + 4 + (word >> 16), at + 8)
        whole = found.end <= found.next <= len(data)
    else:
        size = struct.unpack_from(f"{order}I", data, at + 4)[0]
        found = _Element(word, at + 8, at + 8 + size, at + 8 + size + -size % 8)
        whole = found.end <= len(data)
    if not whole:
        raise ValueError("it ends early")
    return found


def _variables(
    data: bytes, order: str, room: Callable[[int], None]
) -> Iterator[tuple[str, Fields]]:
    """Variables one by one; those that are no structures are not unpacked."""
    at = TEXT_HEADER
    while at < len(data):
        element = _element(data, at, order)
        at = element.end if element.kind == DEFLATED else element.next
        if element.kind == DEFLATED:
            inflate = zlib.decompressobj()
            part = inflate.decompress(data[element.begin : element.end], BEGIN_BYTES)
            kind, name = _begin(part, order)
            pieces = [part]
            while kind == STRUCTURE and inflate.unconsumed_tail:
                pieces.append(inflate.decompress(inflate.unconsumed_tail, INFLATED_BYTES))
                room(sum(map(len, pieces)))
            part = b"".join(pieces)
        else:
            part = data[element.begin - 8 : element.end]
            kind, name = _begin(part, order)
        yield name, _structure(part, order) if kind == STRUCTURE else {}


class _Array(NamedTuple):
    """What an array begins with."""

    kind: int
    real: bool
    sizes: tuple[int, ...]
    name: str
    rest: int


def _array(data: bytes, begin: int, order: str) -> _Array:
    """The first parts of an array: flags, dimensions, name."""
    flags = _element(data, begin, order)
    word = struct.unpack_from(f"{order}I", data, flags.begin)[0]
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


def _begin(data: bytes, order: str) -> tuple[int, str]:
    """Class and name of a variable; no class where there are others than of version 5."""
    kind = struct.unpack_from(f"{order}I", data)[0]
    if kind != MATRIX:
        raise ValueError(f"an element of type {kind}, not an array")
    flags = _element(data, 8, order)
    word = struct.unpack_from(f"{order}I", data, flags.begin)[0] & 0xFF
    if word > NUMERIC[-1]:  # functions and objects, which have no dimensions
        return word, ""
    array = _array(data, 8, order)
    return array.kind, array.name


def _structure(data: bytes, order: str) -> Fields:
    """Fields of a structure; of several in an array none."""
    array = _array(data, 8, order)
    if math.prod(array.sizes) != 1:
        return {}
    size = _element(data, array.rest, order)
    width = struct.unpack_from(f"{order}i", data, size.begin)[0]
    names = _element(data, size.next, order)
    text = data[names.begin : names.end]
    if width < 1 or len(text) % width:
        raise ValueError("names of fields of odd lengths")
    found: Fields = {}
    at = names.next
    for k in range(0, len(text), width):
        field = _element(data, at, order)
        name = text[k : k + width].partition(b"\0")[0].decode("ascii", "replace")
        found[name] = _numbers(data, field, order)
        at = field.next
    return found


def _numbers(data: bytes, field: _Element, order: str) -> NDArray[np.generic]:
    """An array of real numbers in the order of MATLAB."""
    if field.kind != MATRIX:
        raise ValueError(f"an element of type {field.kind}, not an array")
    if field.begin == field.end:
        return np.zeros((0, 0))
    array = _array(data, field.begin, order)
    if array.kind not in NUMERIC or not array.real:
        return NO_NUMBERS
    if not math.prod(array.sizes):
        return np.zeros(array.sizes)
    real = _element(data, array.rest, order)
    values = np.frombuffer(data[real.begin : real.end], f"{order}{ELEMENT_TYPES[real.kind]}")
    return np.asarray(values.reshape(array.sizes, order="F"))


def _of_version_73(path: str, data: bytes, limit: float | None) -> dict[str, Fields]:
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
        with h5py.File(h5py.h5f.open(name, h5py.h5f.ACC_RDONLY, access)) as file:
            return {
                name: _fields(path, file, name, len(data), limit)
                for name in file
                if not name.startswith("#")
            }
    except (InputError, MemoryError):
        raise
    except Exception as error:  # damaged files end in errors of many kinds
        raise _damaged(path, error) from None


def _fields(path: str, parent: Any, name: str, file: int, limit: float | None) -> Fields:
    """Fields of a variable, if it is a structure; only what is in this very file is followed."""
    import h5py

    if not isinstance(parent.get(name, getlink=True), h5py.HardLink):
        return {}
    group = parent[name]
    if not isinstance(group, h5py.Group):
        return {}
    found: Fields = {}
    for field in group:
        if not isinstance(group.get(field, getlink=True), h5py.HardLink):
            continue
        data = group[field]
        if not isinstance(data, h5py.Dataset) or data.external or data.is_virtual:
            continue
        check_room(path, TABLE * data.nbytes, file, limit, f"{field} of {data.nbytes:,} bytes")
        values = np.asarray(data[()]).T
        if data.attrs.get("MATLAB_empty", 0):  # which has its dimensions for values
            sizes = [int(size) for size in values.ravel()]
            if 0 not in sizes:
                raise ValueError(f"{field} is called empty, and is not")
            values = np.zeros(sizes)
        found[field] = values
    return found


def _damaged(path: str, error: Exception) -> InputError:
    reason = (str(error).splitlines() or [type(error).__name__])[0]
    return InputError(f"{path}: no readable MAT file: {reason}")
