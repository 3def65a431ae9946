"""Sets of trajectories in MAT files, as the published MATLAB code of the metric has them.

A structure with ``tVec`` (n,), the first step of each trajectory, from 1 on; ``iVec`` (n,), their
lengths; ``xState`` (d, T, n), the states by step, of which those within a trajectory count. NaN
among these is a hole, in which the target is absent. A cell may have one in each element: the runs
of a Monte Carlo study.
"""

import math
import os
import re
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.words import counted, install, more
from tgospa_eval.errors import ConfigError, InputError, TgospaError
from tgospa_eval.formats.columns.headers import find_roles
from tgospa_eval.formats.guess import file_of
from tgospa_eval.formats.loading import TABLE, check_memory, unreadable
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows, number_ids, rows_by_components
from tgospa_eval.text import listed, quoted
from tgospa_eval.tracks.trajectories import Ints, column_names

Fields = dict[str, NDArray[np.generic]]
"""Fields of a structure; of what is no array of real numbers an array of objects."""

Room = Callable[[int, str], None]
"""Raises if there is none for so many bytes, of what."""


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


# -------------------------------------------------------------------------------------------------
# Version 5 (-v6, -v7), by the published description of the format: SciPy's reader ends the process
# (segmentation fault) with one damaged file in fifty, and unpacks whatever a file claims.

MAT_5 = b"MATLAB 5.0 MAT-file"
"""How files begin."""

TEXT_HEADER = 128
MATRIX, DEFLATED = 14, 15
"""Types of elements: an array, and one that is compressed."""

NUMBER_TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8", "i8", "u8")
ELEMENT_TYPES = dict(zip((1, 2, 3, 4, 5, 6, 7, 9, 12, 13), NUMBER_TYPES, strict=True))
"""Types of elements that hold numbers."""

CELL_ARRAY, STRUCTURE = 1, 2
NUMERIC = range(6, 16)
"""Classes of arrays."""

COMPLEX = 0x800
"""Flag of an array."""

BEGIN_BYTES = 1 << 12
"""Bytes of a variable that mostly have its class, its name and those of its fields."""

INFLATED_BYTES = 1 << 24
"""Bytes that are unpacked at a time."""


def _variables(data: bytes, room: Room) -> Iterator[tuple[str, Variable]]:
    """Variables one by one; what is compressed is unpacked as far as it is needed."""
    room(len(data), "arrays")
    order = "<" if data[126:128] == b"IM" else ">"
    at = TEXT_HEADER
    while at < len(data):
        kind, begin, end, after = _tag(data, at, order)
        if kind == DEFLATED:
            head, whole = _inflated(data[begin:end], room)
            at = end
        else:
            head = data[begin - 8 : end]
            whole = partial(bytes, head)
            at = after
        try:
            name, cells, fields = _begin(head, order)
        except (ValueError, struct.error):
            name, cells, fields = _begin(whole(), order)

        def read(place: int, whole: Callable[[], bytes] = whole) -> Fields:
            return _structure(whole(), order, place)

        yield name, Variable(cells, fields, read)


def _inflated(data: bytes, room: Room) -> tuple[bytes, Callable[[], bytes]]:
    """The first bytes of what is compressed, and what gives all; `room` raises if there is none."""
    inflate = zlib.decompressobj()
    head = inflate.decompress(data, BEGIN_BYTES)

    @cache
    def whole() -> bytes:
        found = bytearray(head)
        while inflate.unconsumed_tail:
            found += inflate.decompress(inflate.unconsumed_tail, INFLATED_BYTES)
            room(len(found), "arrays")
        return bytes(found)

    return head, whole


def _tag(data: bytes, at: int, order: str, *, cut: bool = False) -> tuple[int, int, int, int]:
    """Type, begin and end of an element, and where the next one is.

    ValueError if the data end before the element does, unless they are `cut`.
    """
    (kind,) = struct.unpack_from(f"{order}I", data, at)
    if kind >> 16:  # a small one: type, size and content in eight bytes
        kind, begin, end, after = kind & 0xFFFF, at + 4, at + 4 + (kind >> 16), at + 8
        early = not end <= after <= len(data)
    else:
        (size,) = struct.unpack_from(f"{order}I", data, at + 4)
        begin, end, after = at + 8, at + 8 + size, at + 8 + size + -size % 8
        early = end > len(data)
    if early and not cut:
        raise ValueError("it ends early")
    return kind, begin, end, after


class _Array(NamedTuple):
    """What an array begins with; functions and objects have a class alone.

    Names of fields are those of a single structure, and `rest` is where these begin.
    """

    kind: int
    real: bool = False
    sizes: tuple[int, ...] = ()
    name: str = ""
    fields: tuple[str, ...] = ()
    rest: int = 0


def _array(data: bytes, at: int, order: str, *, cut: bool = False) -> tuple[_Array, int]:
    """The first parts of an array, and where the next element is; data may be `cut` behind them."""
    kind, begin, end, following = _tag(data, at, order, cut=cut)
    if kind != MATRIX:
        raise ValueError(f"an element of type {kind}, not an array")
    if begin == end:
        return _Array(NUMERIC[0], real=True, sizes=(0, 0)), following
    _, at, _, after = _tag(data, begin, order)
    (flags,) = struct.unpack_from(f"{order}I", data, at)
    if flags & 0xFF > NUMERIC[-1]:
        return _Array(flags & 0xFF), following
    _, at, end, after = _tag(data, after, order)
    sizes = struct.unpack_from(f"{order}{(end - at) // 4}i", data, at)
    _, at, end, after = _tag(data, after, order)
    name = data[at:end].decode("ascii", "replace")
    fields: tuple[str, ...] = ()
    if flags & 0xFF == STRUCTURE and math.prod(sizes) == 1:
        _, at, _, after = _tag(data, after, order)
        (width,) = struct.unpack_from(f"{order}i", data, at)
        _, at, end, after = _tag(data, after, order)
        if width < 1 or (end - at) % width:
            raise ValueError("names of fields of odd lengths")
        texts = (data[k : k + width].partition(b"\0")[0] for k in range(at, end, width))
        fields = tuple(text.decode("ascii", "replace") for text in texts)
    return _Array(flags & 0xFF, not flags & COMPLEX, sizes, name, fields, after), following


def _begin(data: bytes, order: str) -> tuple[str, int | None, frozenset[str]]:
    """Name of a variable, elements of a cell, names of fields, from the beginning of its bytes."""
    array, _ = _array(data, 0, order, cut=True)
    if array.kind != CELL_ARRAY:
        return array.name, None, frozenset(array.fields)
    at, count = array.rest, max(math.prod(array.sizes), 0)
    for _ in range(count):
        inner, at = _array(data, at, order, cut=True)
        if math.prod(inner.sizes):
            return array.name, count, frozenset(inner.fields)
    return array.name, count, frozenset()


def _structure(data: bytes, order: str, place: int) -> Fields:
    """Fields of a structure, or of the one at a place in a cell."""
    array, _ = _array(data, 0, order)
    if array.kind == CELL_ARRAY:
        at = array.rest
        for _ in range(place):
            at = _tag(data, at, order)[3]
        array, _ = _array(data, at, order)
    at = array.rest
    found: Fields = {}
    for name in array.fields:
        found[name], at = _numbers(data, at, order)
    return found


def _numbers(data: bytes, at: int, order: str) -> tuple[NDArray[np.generic], int]:
    """An array of real numbers in the order of MATLAB, and where the next element is."""
    array, following = _array(data, at, order)
    if array.kind not in NUMERIC or not array.real:
        return np.empty(1, dtype=object), following
    if not math.prod(array.sizes):
        return np.zeros(array.sizes), following
    kind, begin, end, _ = _tag(data, array.rest, order)
    values = np.frombuffer(data[begin:end], f"{order}{ELEMENT_TYPES[kind]}")
    return np.asarray(values.reshape(array.sizes, order="F")), following


# -------------------------------------------------------------------------------------------------
# Version 7.3 is HDF5, whose dimensions are in reverse order. Only what is in this very file is
# followed: no links, no external data.

MAT_73 = b"MATLAB 7.3 MAT-file"

EMPTY = "MATLAB_empty"
"""Attribute of HDF5."""


@contextmanager
def _variables_of_hdf5(path: str, data: bytes, room: Room) -> Iterator[dict[str, Variable]]:
    """Variables by name, to be read while the context lasts."""
    try:
        import h5py  # here: the extra may be missing, and other formats do without
    except ModuleNotFoundError:
        raise ConfigError(
            f"{path}: MAT files of version 7.3 need the extra matlab: {install('matlab')}; or save "
            "with -v7 in MATLAB"
        ) from None
    # The bytes themselves: a file object of Python that HDF5 calls ends the process at times.
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_fapl_core(backing_store=False)
    access.set_file_image(data)
    image = os.fsencode(os.path.join(path, "image"))  # must be no file, and none is below one

    def held(group: Any, name: str) -> Any:
        is_here = isinstance(group.get(name, getlink=True), h5py.HardLink)
        return group[name] if is_here else None

    def names_in(item: Any) -> frozenset[str]:
        return frozenset(item) if isinstance(item, h5py.Group) else frozenset()

    def is_data(item: Any) -> bool:
        return isinstance(item, h5py.Dataset) and not (item.external or item.is_virtual)

    def fields(group: Any) -> Fields:
        found: Fields = {}
        for field in sorted(names_in(group)):
            data = held(group, field)
            if not is_data(data):
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

    def variable(name: str) -> Variable:
        """A group is a structure, references are the elements of a cell."""
        item = held(file, name)
        if not is_data(item) or h5py.check_ref_dtype(item.dtype) is not h5py.Reference:
            return Variable(None, names_in(item), lambda _: fields(item))
        room(item.nbytes, name)
        elements = np.asarray(item[()]).T.ravel(order="F")
        filled = (each for each in map(file.__getitem__, elements) if not each.attrs.get(EMPTY))
        return Variable(
            len(elements), names_in(next(filled, None)), lambda at: fields(file[elements[at]])
        )

    with h5py.File(h5py.h5f.open(image, h5py.h5f.ACC_RDONLY, access)) as file:
        yield {name: variable(name) for name in file if not name.startswith("#")}


# -------------------------------------------------------------------------------------------------
# Which of the variables are meant.

TRAJECTORY_FIELDS = ("tVec", "iVec", "xState")
NO_SET = "no structure with the fields tVec, iVec, xState"

VARIABLES = {"truth": "X", "estimate": "Y"}
"""What the published code calls its arguments: the one to take where a file has several."""


def read_mat(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a MAT file; the role chooses among several variables.

    Raises
    ------
    InputError
        The file is no MAT file, or has no set of trajectories, or several; or both sides would be
        the same one, and nobody asked for that.
    ConfigError
        h5py is not installed, and the file needs it.
    """
    with _sets(path, data, options.max_input) as sets:
        name = sets.chosen(path, role)
        sets.check_sides(options.beside, options.roles)
        fields, about = sets.fields(name), list(sets.notices(path, name, role))
    return _rows(path, f"{path}, {name}", fields, about, options)


def names_of_runs(path: str, data: bytes, limit: float | None) -> list[str]:
    """Names of all sets of trajectories of a file: ``X``, and of a cell ``Y{1}``, ``Y{2}``, ...

    Raises
    ------
    InputError, ConfigError
        As of `read_mat`.
    """
    with _sets(path, data, limit) as sets:
        found = []
        for name, count in sets.there.items():
            if count:
                sets.fields(_run(name, count))  # a damaged file may claim any count
            found += [name] if count is None else [_run(name, k + 1) for k in range(count)]
        return found


@contextmanager
def _sets(path: str, data: bytes, limit: float | None) -> "Iterator[_Sets]":
    """The sets of trajectories of a file, to be read while the context lasts.

    Raises
    ------
    InputError
        It is no MAT file of these versions, damaged, or too large.
    ConfigError
        h5py is not installed, and the file needs it.
    """
    if not data:
        raise InputError(f"{path}: the file is empty; a set without objects has empty arrays")
    if not data.startswith((MAT_5, MAT_73)):
        raise InputError(f"{path}: no MAT file of version 5 or 7.3; save with -v7 in MATLAB")

    def room(size: int, what: str) -> None:
        check_memory(path, TABLE * size, len(data), limit, f"{what} of {size:,} bytes")

    try:
        if data.startswith(MAT_73):
            with _variables_of_hdf5(path, data, room) as found:
                yield _Sets(file_of(path), found)
        else:
            yield _Sets(file_of(path), dict(_variables(data, room)))
    except (TgospaError, MemoryError):
        raise
    except Exception as error:  # damaged files end in errors of many kinds
        raise unreadable(path, "MAT", error) from None


def _run(name: str, place: int) -> str:
    """An element of a cell, as MATLAB writes it."""
    return f"{name}{{{place}}}"


class _Sets:
    """The sets of trajectories of a file: structures, and elements of cells.

    Parameters
    ----------
    file : str
        Path of the file itself.
    found : mapping of str to Variable
        What is in it.
    """

    def __init__(self, file: str, found: Mapping[str, Variable]) -> None:
        self.file, self.found = file, found
        self.there = {
            name: variable.cells
            for name, variable in found.items()
            if variable.fields >= set(TRAJECTORY_FIELDS)
        }

    def fields(self, name: str) -> Fields:
        """Fields of ``X``, or of ``Y{3}``.

        Raises
        ------
        InputError
            An element of a cell is something else.
        """
        variable, _, place = name.partition("{")
        fields = self.found[variable].read(int(place[:-1]) - 1 if place else 0)
        if not fields.keys() >= set(TRAJECTORY_FIELDS):
            raise InputError(f"{self.file}: {name} is {NO_SET}")
        return fields

    def chosen(self, path: str, role: str) -> str:
        """What to read, ``X`` or ``Y{3}``: what the path names, else what is usual for the role.

        Raises
        ------
        InputError
            There is none of this name, or there are several and none is usual.
        """
        asked = path[len(self.file) + 1 :]
        if asked:
            return self._named(path, asked)
        if not self.there:
            inside = f"in it: {listed(self.found)}" if self.found else "nothing else is in it"
            raise InputError(
                f"{path}: {NO_SET} ({inside}); save one: tVec are the first steps, iVec the "
                "lengths, xState the states (d, T, n)"
            )
        name = next(iter(self.there)) if len(self.there) == 1 else VARIABLES[role]
        if name in self.there:
            return self._one_of(path, name)
        raise InputError(
            f"{path}: {len(self.there)} sets of trajectories ({self._listed()}); say which, "
            f"{path}:{self._runs()[0]}"
        )

    def check_sides(self, paths: tuple[str, ...], roles: tuple[str, ...]) -> None:
        """Whether both sides are one set of this file, though not both are named.

        Raises
        ------
        InputError
            They are.
        """
        files = [file_of(path) for path in paths]
        if len(files) != 2 or len({*map(os.path.realpath, files)}) > 1 or not {*paths} & {*files}:
            return
        try:
            name, other = map(self.chosen, paths, roles)
        except InputError:
            return  # which is said when that side is read
        if name == other:
            others = [run for run in self._runs() if run != name] or [name]
            raise InputError(
                f"{self.file}: both sides are its variable {name}, compared with itself; in it: "
                f"{self._listed(everything=True)}; name both, {self.file}:{name} "
                f"{self.file}:{others[0]}"
            )

    def notices(self, path: str, name: str, role: str) -> Iterator[str]:
        """What is not read, where nobody said what to read."""
        usual = VARIABLES[role]
        if path != self.file:
            return
        if len(self.there) > 1:
            other = next(run for run in self._runs() if run != name)
            is_named = file_of(f"{path}:{other}") == path  # not where it comes by a pipe
            way = f"; {path}:{other} reads another" if is_named else ""
            yield f"variable {name} of {self._listed()}{way}"
        elif usual in self.found and usual not in self.there:
            yield f"variable {name}; {usual} is {NO_SET}"

    def _named(self, path: str, asked: str) -> str:
        """What the path names."""
        found = re.fullmatch(r"(\w+)(?:\{([0-9]+)\})?", asked)
        name, place = found.groups() if found else (asked, None)
        if name not in self.there:
            there = self._listed() or "none"
            raise InputError(f"{path}: no set of trajectories {quoted(asked)} (there are: {there})")
        count = self.there[name]
        if place is None:
            return self._one_of(path, name)
        if count is None:
            raise InputError(f"{path}: {name} is no cell; {self.file}:{name} reads it")
        if not 1 <= int(place) <= count:
            raise InputError(f"{path}: {name} has {counted(count, 'run')}, {self._span(name)}")
        return _run(name, int(place))

    def _one_of(self, path: str, name: str) -> str:
        """A variable, or the only run of a cell."""
        count = self.there[name]
        if count is None:
            return name
        if count == 1:
            return _run(name, 1)
        raise InputError(
            f"{path}: {name} is a cell of {counted(count, 'run')}; choose one, "
            f"{self.file}:{_run(name, 1)}, or all in a batch, {self.file}:{name}{{run}}"
        )

    def _runs(self) -> list[str]:
        """The variables, cells by their first elements."""
        return [name if count is None else _run(name, 1) for name, count in self.there.items()]

    def _span(self, name: str) -> str:
        """A variable, a cell from its first element to its last."""
        count = self.there[name]
        ends = [name] if count is None else [_run(name, k) for k in sorted({1, count})]
        return " to ".join(ends)

    def _listed(self, *, everything: bool = False) -> str:
        """The sets; on request with what is none."""
        rest = [name for name in self.found if name not in self.there] if everything else []
        others = (f"{name} (no trajectories)" for name in rest)
        return listed([*map(self._span, self.there), *others])


def _rows(path: str, name: str, fields: Fields, about: list[str], options: ReadOptions) -> Rows:
    """A row for each trajectory and step; `name` begins the messages."""
    for field in TRAJECTORY_FIELDS:
        if fields[field].dtype.kind not in "iuf":
            raise InputError(
                f"{name}.{field}: no real numbers; it must be a numeric array of one structure"
            )
    start, length = (_whole(f"{name}.{field}", fields[field]) for field in ("tVec", "iVec"))
    state = fields["xState"]
    if not state.size and not len(start):
        state = np.zeros((state.shape[0] or 2, 0, 0))
    if state.ndim == 2:  # MATLAB drops a last dimension of 1
        state = state[:, :, None]
    if state.ndim != 3 or not len(start) == len(length) == state.shape[2]:
        shape = " x ".join(map(str, fields["xState"].shape))
        raise InputError(
            f"{name}: {len(start)} in tVec, {len(length)} in iVec, and xState is {shape}; it must "
            "be d x T x n for n trajectories"
        )
    last = start + length - 1
    wrong = np.flatnonzero((length > 0) & ((start < 1) | (last > state.shape[1])))
    if len(wrong):
        k = int(wrong[0])
        raise InputError(
            f"{name}: trajectory {k + 1} is from step {start[k]} to {last[k]}{more(len(wrong))}; "
            f"xState has the steps 1 to {state.shape[1]}"
        )
    names = column_names(len(state))
    if options.columns is None and not options.boxes and len(names) > 3:
        options = replace(options, columns=names)
        about.insert(
            0,
            f"states have {len(names)} components, {names[0]} to {names[-1]}, and all are "
            f"compared; of positions and velocities name the positions: --columns x=x0,y=x2",
        )
    roles = find_roles(["id", "t", *names], options, path, fixed=True)
    step = np.arange(1, state.shape[1] + 1)[:, None]
    track, index = np.nonzero(((step >= start) & (step < start + length)).T)
    ids, number = number_ids([str(k + 1) for k in range(len(start))])
    rows = rows_by_components(
        lambda column: np.asarray(state[column - 2, index, track], dtype=np.float64),
        index + 1,
        replace(roles, passed=(*roles.passed, *about)),
        name=path,
        ids=(ids, number[track]),
        where=lambda row: f"{name}, trajectory {track[row] + 1}, step {index[row] + 1}",
    )
    infinite = np.flatnonzero(np.isinf(rows.numbers).any(axis=1))
    if len(infinite):
        place = rows.where(int(infinite[0]))
        raise InputError(f"{place}: infinite{more(len(infinite))}; use NaN if absent")
    return rows


def _whole(name: str, values: NDArray[np.generic]) -> Ints:
    """Start steps or lengths as integers."""
    numbers = values.astype(np.float64).ravel()
    if values.size and max(values.shape, default=1) != values.size:
        shape = " x ".join(map(str, values.shape))
        raise InputError(f"{name}: is {shape}; it must be a vector")
    wrong = np.flatnonzero(~((np.abs(numbers) < 2**31) & (numbers == np.rint(numbers))))
    if len(wrong) or (numbers < 0).any():
        k = int(wrong[0]) if len(wrong) else int(np.argmin(numbers))
        raise InputError(
            f"{name}: {numbers[k]:g} of trajectory {k + 1} is no step; it must be a whole number"
        )
    return numbers.astype(np.int64)
