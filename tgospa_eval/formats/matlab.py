"""Sets of trajectories in MAT files, in the form of the published MATLAB code and in other forms.

The published code has a structure for n trajectories, T steps and d components:

- ``tVec`` (n,) is the first step of each trajectory, counted from 1.
- ``iVec`` (n,) is its length in steps.
- ``xState`` (d, T, n) has the states by step. Only states from the first to the last step of a
  trajectory count. Among these, NaN means that the target is absent.

A set of trajectories may also consist of arrays as in `formats.arrays`, which are fields of a
structure or variables of the file. In toolboxes of random finite sets, a set consists of two cells
with an element for each step k: ``X{k}`` (d, n_k) has the states of n_k objects, and ``L{k}`` has
a label for each object: one or more numbers. Finally, each element of a cell or a structure array
may be a whole set, such as one run of a Monte Carlo study.
"""

import io
import os
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, cached_property, partial
from importlib.util import find_spec
from math import prod
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Ints
from tgospa_eval.common.files import reason
from tgospa_eval.common.words import counted, install, more
from tgospa_eval.engines import DiedError, call_in_helper, limit_memory
from tgospa_eval.errors import ConfigError, InputError, TgospaError
from tgospa_eval.formats.arrays import MATLAB, NAMES, array_rows, kind_of, sized
from tgospa_eval.formats.guess import file_of
from tgospa_eval.formats.loading import (
    GIGABYTE,
    TABLE,
    check_memory,
    max_memory,
    more_memory,
    unreadable,
)
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.quoting import listed, quoted

Structure: TypeAlias = "dict[str, Value]"
Value: TypeAlias = "Structure | list[Callable[[], Value]] | NDArray[Any] | None"
"""Fields of a structure, elements of a cell, or real numbers; None for anything else."""

Variables = dict[str, tuple[tuple[int, ...], Callable[[], Value]]]
"""Variables of a file by name, each with the sizes of its axes and a callable that reads its value.

The sizes are empty if the variable is not an array."""

Room = Callable[[int, str], None]
"""Callable that receives a size in bytes and words for a message.

It raises an error if there is not enough memory."""


# -------------------------------------------------------------------------------------------------
# Files of version 5, which MATLAB saves with -v6 and -v7. One damaged file in fifty makes SciPy end
# the process, so all files are read in a helper process. SciPy also unpacks as much as a file
# claims to contain. So compressed data are unpacked here, with a check of the memory.

MAT_5 = b"MATLAB 5.0 MAT-file"
"""First bytes of a file of version 5."""

TEXT_HEADER = 128
DEFLATED = 15
"""Number of the type of a compressed element."""

NUMERIC = (
    "single",
    "double",
    "logical",
    *(f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)),
)
"""Classes of MATLAB for arrays of numbers."""

CELL_BYTES = 8
"""Smallest number of bytes of an element of a cell."""

INFLATED_BYTES = 1 << 24
"""Number of bytes that are unpacked at a time."""


def _variables(data: bytes, room: Room) -> Variables:
    """Return the variables of a file; a compressed variable is unpacked when it is used."""
    from scipy.io import whosmat

    room(len(data), "arrays")
    order = "<" if data[126:128] == b"IM" else ">"
    header, at = data[:TEXT_HEADER], TEXT_HEADER
    variables: Variables = {}
    if len(data) < at:
        raise ValueError("it ends early")
    while at < len(data):
        kind, size = struct.unpack_from(f"{order}2I", data, at)
        element, at = data[at : at + 8 + size], at + 8 + size
        if at > len(data):
            raise ValueError("it ends early")
        for name, sizes, class_ in whosmat(_file(header, element)):
            is_array = class_ in NUMERIC
            is_read = is_array or class_ in ("cell", "struct")
            cells = 0 if is_array else prod(sizes)
            read = partial(_read, header, element, kind == DEFLATED, name, cells, room)
            variables[name] = (tuple(sizes) if is_array else ()), read if is_read else lambda: None
    return variables


def _read(
    header: bytes, element: bytes, is_deflated: bool, name: str, cells: int, room: Room
) -> Value:
    """Read a variable, after a check that its bytes are enough for its elements.

    `cells` is the number of elements of a cell or structure array, as the file states it. Without
    the check, SciPy would create all elements that a damaged file claims to have.
    """
    from scipy.io import loadmat

    if is_deflated:
        element = _inflated(element[8:], room)
    if CELL_BYTES * cells > len(element):
        raise ValueError("it ends early")
    return _value(loadmat(_file(header, element), variable_names=[name]).get(name))


def _file(header: bytes, element: bytes) -> Any:
    """Return an open MAT file, in memory, with one variable."""
    return io.BytesIO(header + element)


def _inflated(data: bytes, room: Room) -> bytes:
    """Inflate compressed data, as far as there is memory."""
    inflate, content = zlib.decompressobj(), bytearray()
    while data:
        content += inflate.decompress(data, INFLATED_BYTES)
        data = inflate.unconsumed_tail
        room(len(content), "arrays")
    return bytes(content)


def _value(item: Any) -> Value:
    """Convert a value that SciPy has read."""
    if type(item) is not np.ndarray:  # sparse matrices, objects, functions
        return None
    if item.dtype.names is not None:
        each: list[Callable[[], Value]] = [
            partial(_fields, element) for element in item.ravel(order="F")
        ]
        return each[0]() if len(each) == 1 else each
    if item.dtype.kind == "O":
        return [partial(_value, element) for element in item.ravel(order="F")]
    return item if item.dtype.kind in "iuf" else None


def _fields(element: Any) -> Value:
    """Convert a structure, or an element of a structure array."""
    return {name: _value(element[name]) for name in element.dtype.names}


# -------------------------------------------------------------------------------------------------
# Version 7.3 is HDF5, whose dimensions are in reverse order. Links and external data are not
# followed.

MAT_73 = b"MATLAB 7.3 MAT-file"

EMPTY, CLASS = "MATLAB_empty", "MATLAB_class"
"""Names of two attributes in HDF5: the mark of an empty array, and the MATLAB class of a value."""


def _elements(fields: Structure, group: Any) -> Value:
    """Return a structure, or the elements of a structure array if all fields are lists."""
    lists = {
        name: own
        for name, own in fields.items()
        if isinstance(own, list) and CLASS not in group[name].attrs
    }
    if not lists or len(lists) < len(fields):
        return fields

    def element(k: int) -> Value:
        return {name: own[k]() for name, own in lists.items()}

    return [partial(element, k) for k in range(min(map(len, lists.values())))]


@contextmanager
def _variables_of_hdf5(path: str, data: bytes, room: Room) -> Iterator[Variables]:
    """Open a file of version 7.3 and yield its variables by name."""
    try:
        import h5py  # lazy: the extra may be missing, and other formats do not need it
    except ModuleNotFoundError:
        raise ConfigError(
            f"{path}: MAT files of version 7.3 need the extra matlab: {install('matlab')}; or save "
            "with -v7 in MATLAB"
        ) from None
    # HDF5 receives bytes, as reading a Python file object sometimes ends the process.
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_fapl_core(backing_store=False)
    access.set_file_image(data)
    image = os.fsencode(os.path.join(path, "image"))  # it cannot exist, as path is a file

    def is_here(group: Any, name: str) -> bool:
        return isinstance(group.get(name, getlink=True), h5py.HardLink)

    def within(group: Any, name: str) -> Value:
        """Read a structure, a cell or numbers of a group; return None for links."""
        return value(group[name], name) if is_here(group, name) else None

    def sizes(name: str) -> tuple[int, ...]:
        item: Any = file[name] if is_here(file, name) else None
        is_array = isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf"
        return tuple(item.shape[::-1]) if is_array else ()

    def value(item: Any, name: str) -> Value:
        if isinstance(item, h5py.Group):
            return _elements({field: within(item, field) for field in sorted(item)}, item)
        if not isinstance(item, h5py.Dataset) or item.external or item.is_virtual:
            return None
        is_cell = h5py.check_ref_dtype(item.dtype) is h5py.Reference
        room(item.nbytes, name)
        values = np.asarray(item[()]).T
        if item.attrs.get(EMPTY):  # the stored values are the sizes of the empty array
            sizes = [int(size) for size in values.ravel()]
            if 0 not in sizes:
                raise ValueError(f"{name} is marked empty, but is not")
            return np.zeros(sizes)
        if is_cell:
            elements = map(file.__getitem__, values.ravel(order="F"))
            return [partial(value, element, name) for element in elements]
        return values

    with h5py.File(h5py.h5f.open(image, h5py.h5f.ACC_RDONLY, access)) as file:
        names = [name for name in file if not name.startswith("#")]
        yield {name: (sizes(name), partial(within, file, name)) for name in names}


# -------------------------------------------------------------------------------------------------
# Choosing the variables.

TRAJECTORY_FIELDS = ("tVec", "iVec", "xState")
NO_SET = "no structure with the fields tVec, iVec, xState, or x, t, id, or cells X, L by step"

VARIABLES = {"truth": ("X", "truth"), "estimate": ("Y", "est", "estimate")}
"""Names of the set to read if a file has several sets, by role; the first that exists is used.

The names are those of the published code and of toolboxes."""

STATES, LABELS = "X", ("L", "track_list")
"""Names of the cells with the states and the labels of each step."""


def read_mat(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """Read the rows of a MAT file; `role` decides which of several variables is read.

    Raises
    ------
    InputError
        The file is not a MAT file, or it is not clear which set of trajectories to read. Or truth
        and estimate would be the same set of one file; this is allowed only if both paths name it.
    ConfigError
        The file needs h5py, which is not installed.
    """
    paths, files = options.beside, tuple(map(file_of, options.beside))
    is_one = len(files) == 2 and len({*map(os.path.realpath, files)}) == 1 and {*paths} & {*files}
    sides = tuple(zip(paths, files, options.roles, strict=True)) if is_one else ()
    is_named = file_of(f"{path}:X") == path  # whether FILE:X would name a variable
    name, fields, about = _in_helper(_choose, path, data, options.max_input, role, sides, is_named)
    rows = _rows(f"{path}, {name}", fields, options, len(data))
    return replace(rows, name=path, roles=replace(rows.roles, passed=(*rows.roles.passed, *about)))


def names_of_runs(path: str, data: bytes, limit: float | None) -> list[str]:
    """Return the names of all sets of trajectories: ``X``, or ``Y{1}``, ``Y{2}``, ... for a cell.

    Raises
    ------
    InputError, ConfigError
        The file cannot be read, see `read_mat`.
    """
    names: list[str] = _in_helper(_names, path, data, limit)
    return names


def _in_helper(work: Callable[..., Any], path: str, data: bytes, *more: object) -> Any:
    """Call `work` in a helper process, and return its result.

    A damaged file can end the process that reads it. `work` receives the path, the path without the
    name of a variable, the bytes of the file, and `more`.

    Raises
    ------
    InputError
        The file is damaged, too large, or not a MAT file of version 5 or 7.3.
    ConfigError
        The file needs h5py, which is not installed; or a process cannot be started.
    """
    if not data:
        raise InputError(f"{path}: the file is empty; a set without objects has empty arrays")
    if not data.startswith((MAT_5, MAT_73)):
        raise InputError(f"{path}: not a MAT file of version 5 or 7.3; save with -v7 in MATLAB")
    if data.startswith(MAT_73) and find_spec("h5py") is None:
        raise ConfigError(
            f"{path}: MAT files of version 7.3 need the extra matlab: {install('matlab')}; or save "
            "with -v7 in MATLAB"
        )
    try:
        return call_in_helper(work, path, file_of(path), data, *more)
    except DiedError as error:
        why = f"reading it failed ({error}): it is damaged, or memory is short"
        raise InputError(f"{path}: not a readable MAT file: {why}") from None
    except OSError as error:
        raise ConfigError(
            f"{path}: MAT files are read in a separate process, which cannot be started here "
            f"({reason(error)}); save the tracks as CSV"
        ) from None


# -------------------------------------------------------------------------------------------------
# Functions that run in the helper process.

ITSELF = GIGABYTE / 4
"""Memory in bytes that the helper process needs without the data."""

MAX_INFLATED = 1032
"""Largest possible ratio of unpacked to compressed size."""


def _choose(
    path: str,
    file: str,
    data: bytes,
    limit: float | None,
    role: str,
    sides: tuple[tuple[str, str, str], ...],
    is_named: bool,
) -> tuple[str, Structure, list[str]]:
    """Choose the set to read; return its name, its fields, and notices.

    Fields that are not arrays are None. `sides` is for `_Sets.check_sides`.
    """
    with _sets(path, file, data, limit) as sets:
        name = sets.chosen(path, file, role)
        sets.check_sides(sides)
        fields: Structure = {
            field: value if isinstance(value, np.ndarray) else None
            for field, value in sets.fields(name).items()
        }
        return name, fields, [*sets.notices(path, name, role, is_named=is_named)]


def _names(path: str, file: str, data: bytes, limit: float | None) -> list[str]:
    """Return the names of the sets, with one name for each element of a cell."""
    with _sets(path, file, data, limit) as sets:
        return [
            run
            for name, count in sets.there.items()
            for run in ([_run(name, k + 1) for k in range(count)] if count else [name])
        ]


@contextmanager
def _sets(path: str, file: str, data: bytes, limit: float | None) -> "Iterator[_Sets]":
    """Open a file and yield its sets of trajectories.

    Raises
    ------
    InputError
        The file is damaged, or too large.
    """

    def room(size: int, what: str) -> None:
        check_memory(path, TABLE * size, len(data), limit, f"{what} of {size:,} bytes")

    max_bytes = max_memory(len(data), limit)
    if data.startswith(MAT_5):  # damaged data may claim any size
        max_bytes = min(max_bytes, TABLE * MAX_INFLATED * len(data))
    limit_memory(int(max_bytes + ITSELF))
    try:
        if data.startswith(MAT_73):
            with _variables_of_hdf5(path, data, room) as variables:
                yield _Sets(file, variables)
        else:
            yield _Sets(file, _variables(data, room))
    except TgospaError:
        raise
    except MemoryError:
        raise InputError(
            f"{path}: reading it takes more than {max_bytes / GIGABYTE:.2g} GB{more_memory()}"
        ) from None
    except Exception as error:  # damaged files raise errors of many kinds
        raise unreadable(path, "MAT", error) from None


def _run(name: str, place: int) -> str:
    """Return the name of an element of a cell, in the notation of MATLAB."""
    return f"{name}{{{place}}}"


def _is_set(value: Value) -> bool:
    """Return whether a value is a set of trajectories, or an array of states with three axes."""
    if not isinstance(value, dict):
        return isinstance(value, np.ndarray) and value.ndim > 2
    if isinstance(value.get(STATES), list):
        return True
    sizes = {name: array.shape for name, array in value.items() if isinstance(array, np.ndarray)}
    return value.keys() >= {*TRAJECTORY_FIELDS} or bool(_states(sizes))


def _size(value: Value) -> int:
    return value.size if isinstance(value, np.ndarray) else 0


def _by_step(fields: Structure, name: str) -> Structure:
    """Convert the cells with the states and labels of each step to arrays by step and track.

    Raises
    ------
    InputError
        States of a step are not d x n, a state has no label, or two states have the same label.
    """
    cells = {key: value for key, value in fields.items() if isinstance(value, list)}
    steps = [read() for read in cells[STATES]]
    known = {key: [read() for read in cells[key]] for key in LABELS if key in cells}
    named = [key for key, own in known.items() if any(map(_size, own))]
    tracks: dict[str, int] = {}
    rows: list[tuple[int, NDArray[np.int64], NDArray[Any]]] = []
    for k, state in enumerate(steps):
        if state is None or (isinstance(state, np.ndarray) and not state.size):
            continue
        where = f"{_run(f'{name}.{STATES}', k + 1)}"
        if not isinstance(state, np.ndarray) or state.ndim != 2:
            raise InputError(f"{where}: must be a numeric array d x n, a column for each object")
        own = known[named[0]][k] if named and k < len(known[named[0]]) else None
        count = state.shape[1]
        if not isinstance(own, np.ndarray) or not own.size or own.size % count:
            raise InputError(
                f"{where}: {counted(count, 'state')} without labels; {' or '.join(LABELS)} "
                "must say for each state which track it belongs to"
            )
        labels = own.T if own.shape[-1] == count else own.reshape(count, -1)
        ids = ["-".join(f"{part:g}" for part in label) for label in labels.tolist()]
        if len(set(ids)) < count:
            raise InputError(f"{where}: two states have the same label in {named[0]}")
        at = np.array([tracks.setdefault(text, len(tracks)) for text in ids], np.int64)
        rows.append((k, at, state))
    sizes = {len(state) for *_, state in rows} or {2}
    if len(sizes) > 1:
        raise InputError(
            f"{name}.{STATES}: different numbers of components: {listed(sorted(map(str, sizes)))}"
        )
    made = np.full((*sizes, len(steps), len(tracks)), np.nan)
    for k, at, state in rows:
        made[:, k, at] = state
    return {"xState_dTn": made, "id": np.array([*tracks], dtype=np.str_)}


def _states(sizes: dict[str, tuple[int, ...]]) -> list[str]:
    """Return the names of variables that have states by step.

    These variables have a name of states or particles (`arrays.NAMES`). If no variable has times,
    they also need three or more axes. `sizes` has the sizes of all variables.
    """
    kinds = {name: kind_of(name)[0] for name in sizes}
    named = [name for name, kind in kinds.items() if kind in ("x", "particles")]
    return [name for name in named if len(sizes[name]) > 2 or "t" in kinds.values()]


class _Sets:
    """Sets of trajectories of a file: structures, elements of cells, and arrays.

    `file` is the path of the file, without the name of a variable.
    """

    def __init__(self, file: str, variables: Variables) -> None:
        self.file, self.variables = file, variables
        self.value = cache(lambda name: variables[name][1]())
        self.arrays = {name: sizes for name, (sizes, _) in variables.items() if sizes}

    @cached_property
    def there(self) -> dict[str, int]:
        """Number of elements of each cell that has sets; 0 for a variable that is itself a set."""
        counts = {name: self._count(name) for name in self.variables if name not in self.arrays}
        sets = {name: count for name, count in counts.items() if count is not None}
        return sets or dict.fromkeys(_states(self.arrays)[:1], 0)

    def _count(self, name: str) -> int | None:
        """Return the number of elements of a cell that has sets; 0 for a set, None for others."""
        if name in self.arrays:
            is_timed = any(kind_of(k)[0] == "t" for k in self.arrays)
            return 0 if is_timed or len(self.arrays[name]) > 2 else None
        value = self.value(name) if name in self.variables else None
        if isinstance(value, list):
            return len(value) if any(_is_set(read()) for read in value) else None
        return 0 if _is_set(value) else None

    def fields(self, name: str) -> Structure:
        """Return the fields of the set ``X`` or ``Y{3}``.

        If the set is an array, its fields are this array and variables that belong to it, such as
        times.

        Raises
        ------
        InputError
            An element of a cell is not a set of trajectories.
        """
        if name in self.arrays:
            known = kind_of(name)[0] in ("x", "particles")
            beside = [k for k in self.arrays if kind_of(k)[0] in (NAMES if known else ("t", "id"))]
            own = {name if known else "x": self.value(name)}
            return own | {k: self.value(k) for k in beside if k != name}
        variable, _, place = name.partition("{")
        value = self.value(variable)
        if isinstance(value, list):
            value = value[int(place[:-1]) - 1]()
        if isinstance(value, np.ndarray) and _is_set(value):
            timed = {k: self.value(k) for k in self.arrays if kind_of(k)[0] == "t"}
            return timed | {variable if kind_of(variable)[0] else "x": value}
        if not isinstance(value, dict) or not _is_set(value):
            raise InputError(f"{self.file}: {name} is {NO_SET}")
        return _by_step(value, name) if isinstance(value.get(STATES), list) else value

    def chosen(self, path: str, file: str, role: str) -> str:
        """Return the name of the set to read, ``X`` or ``Y{3}``.

        The path may name it; otherwise the role decides, see `VARIABLES`.

        Raises
        ------
        InputError
            The file has no set of this name, or several sets of which none is in `VARIABLES`.
        """
        key = path[len(file) + 1 :]
        if not key:
            if not self.there:
                inside = f"in it: {self._all()}" if self.variables else "nothing else is in it"
                raise InputError(
                    f"{path}: {NO_SET} ({inside}); save one: tVec are the first steps, iVec the "
                    "lengths, xState the states (d, T, n)"
                )
            default = next((k for k in VARIABLES[role] if k in self.there), VARIABLES[role][0])
            key = next(iter(self.there)) if len(self.there) == 1 else default
            if key not in self.there:
                raise InputError(
                    f"{path}: {len(self.there)} sets of trajectories ({self._listed()}); name "
                    f"one, such as {path}:{self._firsts()[0]}"
                )
        parts = re.fullmatch(r"(\w+)(?:[{(]([0-9]+)[)}])?", key)
        name, place = parts.groups() if parts else (key, None)
        count = self._count(name)
        if count is None:
            there = self._listed() or f"none; in it: {self._all()}"
            raise InputError(f"{path}: no set of trajectories {quoted(key)} (there are: {there})")
        if not count and place is None:
            return name
        if not count:
            raise InputError(f"{path}: {name} has no runs; {self.file}:{name} reads it")
        if place is None and count > 1:
            raise InputError(
                f"{path}: {name} has {counted(count, 'run')}; choose one, "
                f"{self.file}:{_run(name, 1)}, or all in a batch, {self.file}:{name}{{run}}"
            )
        if not 1 <= int(place or 1) <= count:
            span = f"{_run(name, 1)} to {_run(name, count)}"
            raise InputError(f"{path}: {name} has {counted(count, 'run')}, {span}")
        return _run(name, int(place or 1))

    def check_sides(self, sides: tuple[tuple[str, str, str], ...]) -> None:
        """Check that truth and estimate are different variables, if they are in this file.

        `sides` has the path, file and role of both. It is empty if truth and estimate are in two
        files, or if both paths name a variable. Then no check is needed.

        Raises
        ------
        InputError
            Truth and estimate are the same variable.
        """
        if not sides:
            return
        try:
            name, other = (self.chosen(*side) for side in sides)
        except InputError:
            return  # the error is reported when the side is read
        if name == other:
            rest = [run for run in self._firsts() if run != name] or [name]
            raise InputError(
                f"{self.file}: both paths mean its variable {name}; it has "
                f"{listed(self.variables)}; name both, {self.file}:{name} {self.file}:{rest[0]}"
            )

    def notices(self, path: str, name: str, role: str, *, is_named: bool) -> Iterator[str]:
        """Yield notices about unused variables.

        If the path names no variable, another notice says which one was chosen. This notice is
        yielded only if there are several sets, or if the usual variable is not a set.
        """
        default = VARIABLES[role][0]
        if name in self.arrays:
            used = {name, *self.fields(name)}
            unused = [sized(k, self.arrays.get(k, ())) for k in self.variables if k not in used]
            if unused:
                yield f"variables not used: {listed(unused)}"
        if path != self.file:
            return
        if len(self.there) > 1:
            other = next(run for run in self._firsts() if run != name)
            way = f"; {path}:{other} reads another" if is_named else ""
            yield f"variable {name} of {self._listed()}{way}"
        elif default in self.variables and default not in self.there:
            yield f"variable {name}; {default} is {NO_SET}"

    def _firsts(self) -> list[str]:
        """Return a name for each variable with sets; a cell is named by its first element."""
        return [_run(name, 1) if count else name for name, count in self.there.items()]

    def _all(self) -> str:
        """Return a list of all variables, with the sizes of arrays, for messages."""
        return listed([sized(name, self.arrays.get(name, ())) for name in self.variables])

    def _listed(self) -> str:
        """Return a list of the sets, with the first and last element of cells, for messages."""
        ends = zip(self._firsts(), self.there.items(), strict=True)
        return listed(
            f"{first} to {_run(name, count)}" if count > 1 else first
            for first, (name, count) in ends
        )


def _rows(name: str, fields: Structure, options: ReadOptions, file: int) -> Rows:
    """Return a row for each trajectory and step; `name` begins the messages."""
    arrays = {}
    for field, values in fields.items():
        if isinstance(values, np.ndarray):
            arrays[field] = values
        elif field in TRAJECTORY_FIELDS or kind_of(field)[0]:
            raise InputError(
                f"{name}.{field}: not real numbers; it must be a numeric array of one structure"
            )
    if not fields.keys() >= {*TRAJECTORY_FIELDS}:
        return array_rows(name, arrays, options, file=file, axes=MATLAB)
    start, length = (_whole(f"{name}.{field}", arrays.pop(field)) for field in ("tVec", "iVec"))
    state = arrays.pop("xState")
    if state.dtype.kind not in "iuf":
        raise InputError(f"{name}.xState: not real numbers; it must be a numeric array")
    shape = state.shape
    if not state.size and not len(start):
        state = np.zeros((state.shape[0] or 2, 0, 0))
    if state.ndim == 2:  # MATLAB drops a last dimension of size 1
        state = state[:, :, None]
    if state.ndim != 3 or not len(start) == len(length) == state.shape[2]:
        raise InputError(
            f"{name}: {len(start)} in tVec, {len(length)} in iVec, and "
            f"{sized('xState is', shape)}; it must be d x T x n for n trajectories"
        )
    last = start + length - 1
    wrong = np.flatnonzero((length > 0) & ((start < 1) | (last > state.shape[1])))
    if len(wrong):
        k = int(wrong[0])
        raise InputError(
            f"{name}: trajectory {k + 1} is from step {start[k]} to {last[k]}{more(len(wrong))}; "
            f"xState has the steps 1 to {state.shape[1]}"
        )
    step = np.arange(1, state.shape[1] + 1)[:, None]
    there = (step >= start) & (step < start + length)
    empty = ~there.any(axis=1, keepdims=True)  # a step without states stays a step
    there[:, :1] |= empty
    arrays["xState_dTn"] = np.where(empty, np.nan, state)
    return array_rows(name, arrays, options, file=file, axes=MATLAB, there=there)


def _whole(name: str, values: NDArray[np.generic]) -> Ints:
    """Convert first steps or lengths to integers."""
    numbers = values.astype(np.float64).ravel()
    if values.size and max(values.shape, default=1) != values.size:
        shape = " x ".join(map(str, values.shape))
        raise InputError(f"{name}: is {shape}; it must be a vector")
    wrong = np.flatnonzero(~((np.abs(numbers) < 2**31) & (numbers == np.rint(numbers))))
    if len(wrong) or (numbers < 0).any():
        k = int(wrong[0]) if len(wrong) else int(np.argmin(numbers))
        raise InputError(
            f"{name}: {numbers[k]:g} of trajectory {k + 1} is not a step; it must be a whole number"
        )
    return numbers.astype(np.int64)
