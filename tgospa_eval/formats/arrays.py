"""Arrays of NumPy (T, k, d), NaN where an object is absent: npy files, and npz with one."""

import io
import struct
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.headers import BOX, find_roles
from tgospa_eval.formats.frames import frame_rows
from tgospa_eval.formats.loading import TABLE, check_memory, unreadable
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.tracks.trajectories import column_names

AXES = 3
AXIS_ARRAYS = (("t", "times"), ("id", "ids"), ("columns",))
"""Names of the arrays that may be beside the states, by the axis that they name."""

STATE_NAMES = {"x", "lat", "left"}
"""Columns by which states are found, as in tables."""

Array = NDArray[np.generic]


def read_npy(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of an npy file, the same in either role; ids and times count from 0.

    Raises
    ------
    InputError
        The file is no npy, or its array has not three axes; or see `formats.read`.
    """
    if not data:
        raise InputError(f"{path}: the file is empty; a set without objects has shape (T, 0, d)")
    states = _array(path, data)
    if states.ndim != AXES:
        raise InputError(
            f"{path}: an array of shape {states.shape}; states have the axes (T, k, d), with NaN "
            "where an object is absent"
        )
    return array_rows(path, {"states": states}, len(data), options)


def _array(path: str, data: bytes) -> Array:
    """The array of an npy file, which has as many bytes as its header says."""
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_2_0
        if version == (1, 0):
            read = np.lib.format.read_array_header_1_0
        shape, in_columns, kind = read(stream)
    except Exception as error:  # a header is parsed as Python: damage ends in any fault
        raise unreadable(path, "npy", error) from None
    size, there = prod(shape) * kind.itemsize, len(data) - stream.tell()
    if kind.hasobject or size != there or min(shape, default=1) < 0:
        what = "Python objects" if kind.hasobject else f"{there:,} bytes where {size:,} should be"
        raise InputError(f"{path}: no readable npy file: {what}")
    values = np.frombuffer(data, kind, offset=stream.tell())
    return values.reshape(shape, order="F" if in_columns else "C")


def array_rows(path: str, arrays: Mapping[str, Array], file: int, options: ReadOptions) -> Rows:
    """The rows of an array (T, k, d), with ids, times and names of columns beside it.

    Raises
    ------
    InputError
        There are several, arrays of other names, or of other lengths.
    """
    import pandas as pd

    deep = [name for name, array in arrays.items() if array.ndim == AXES]
    known = [name for names in AXIS_ARRAYS for name in names]
    others = [name for name in arrays if name not in (*deep[:1], *known)]
    if others:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(
            f"{path}: arrays {shapes}; beside one array of states (T, k, d) may be t (T,), "
            "ids (k,) and columns (d,)"
        )
    states = arrays[deep[0]]
    steps, objects, size = states.shape
    if not size:
        raise InputError(f"{path}: states of shape {states.shape}; the last axis has coordinates")
    if states.dtype.kind not in "iuf":
        raise InputError(f"{path}: states of type {states.dtype}; they must be numbers")
    what = f"states of shape {states.shape}"
    check_memory(path, TABLE * 8 * steps * objects * (size + 2), file, options.max_input, what)
    beside: list[Array | None] = []
    for names, length in zip(AXIS_ARRAYS, states.shape, strict=True):
        name = next((name for name in names if name in arrays), None)
        beside.append(None if name is None else arrays[name])
        if name is not None and arrays[name].shape != (length,):
            raise InputError(
                f"{path}: {name} has the shape {arrays[name].shape}, the states need ({length},)"
            )
    times, ids, columns = beside
    if columns is None:
        is_box = options.boxes and size == len(BOX)
        columns = np.array(BOX if is_box else column_names(size))
    headers = [str(name).strip() for name in columns]
    taken = {"id", "t"} & set(headers)
    if taken:
        raise InputError(f"{path}: a column of the states is named {min(taken)}; name it otherwise")
    table: dict[str, Array] = {
        "id": np.tile(np.arange(objects) if ids is None else ids, steps),
        "t": np.repeat(np.arange(steps) if times is None else times, objects),
    }
    flat = states.reshape(steps * objects, size).astype(np.float64)
    table |= {name: flat[:, k] for k, name in enumerate(headers)}
    if len(table) < size + 2:
        raise InputError(f"{path}: columns {', '.join(headers)}: a name is there twice; rename one")
    if options.columns is None and not options.boxes and not STATE_NAMES & set(headers):
        options = replace(options, columns=tuple(headers))  # states of other names all the same
    roles = find_roles(list(table), options, path)
    return frame_rows(pd.DataFrame(table), roles, path, options.decimal)


def read_npz(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of an npz file, the same in either role.

    Arrays ``id, t, weight, x, y, ...`` of one length, as the columns of a CSV file; or only ``x``
    with the shape (P, d): then its columns are x, y, z, from four on x0, x1, ... Or an array
    (T, k, d), see `formats.arrays`.

    Raises
    ------
    InputError
        The file is no npz, or see `formats.read`. Rows count from 0.
    """
    import pandas as pd

    if not data:
        raise InputError(f"{path}: the file is empty; a set without objects has empty arrays")
    size = _unpacked(data)
    check_memory(path, TABLE * size, len(data), options.max_input, f"arrays of {size:,} bytes")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except Exception as error:  # damaged archives end in errors of many kinds
        raise unreadable(path, "npz", error) from None
    if any(array.ndim == AXES for array in arrays.values()):
        return array_rows(path, arrays, len(data), options)
    columns: dict[str, Any] = {}
    for name, array in arrays.items():
        if name == "x" and array.ndim == 2:
            columns |= dict(zip(column_names(array.shape[1]), array.T, strict=True))
        else:
            columns[name] = array
    rows = {len(array) if array.ndim == 1 else -1 for array in columns.values()}
    if len(rows) != 1 or -1 in rows:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(
            f"{path}: arrays {shapes or 'missing'}; they must be columns of one length, "
            "x may be (P, d)"
        )
    if options.columns is None and "x0" in columns and "x" not in columns:
        numbered = (name for name in columns if name[:1] == "x" and name[1:].isdigit())
        options = replace(options, columns=tuple(numbered))
    roles = find_roles(list(columns), options, path)
    return frame_rows(pd.DataFrame(columns), roles, path, options.decimal)


def _unpacked(data: bytes) -> int:
    """Bytes of the arrays, by the directory of the archive; if there is none, reading it fails."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return sum(member.file_size for member in archive.infolist())
    except (zipfile.BadZipFile, ValueError, NotImplementedError, struct.error):
        return 0
