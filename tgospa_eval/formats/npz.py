"""NumPy archives with an array for each column: the quick form of large particle clouds."""

import io
import struct
import zipfile
from typing import Any

import numpy as np

from tgospa_eval.errors import InputError
from tgospa_eval.formats.arrays import array_rows, is_array
from tgospa_eval.formats.columns.roles import find_roles
from tgospa_eval.formats.frames import frame_rows
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.room import TABLE, check_room
from tgospa_eval.formats.rows import Rows


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
    check_room(path, TABLE * size, len(data), options.max_input, f"arrays of {size:,} bytes")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except Exception as error:  # damaged archives end in errors of many kinds
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path}: no readable npz file: {reason}") from None
    if is_array(arrays):
        return array_rows(path, arrays, len(data), options)
    columns: dict[str, Any] = {}
    for name, array in arrays.items():
        if name == "x" and array.ndim == 2:
            size = array.shape[1]
            names = "xyz"[:size] if size <= 3 else [f"x{k}" for k in range(size)]
            columns |= dict(zip(names, array.T, strict=True))
        else:
            columns[name] = array
    rows = {len(array) if array.ndim == 1 else -1 for array in columns.values()}
    if len(rows) != 1 or -1 in rows:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(
            f"{path}: arrays {shapes or 'missing'}; they must be columns of one length, "
            "x may be (P, d)"
        )
    asked = options
    if options.columns is None and "x0" in columns and "x" not in columns:
        from dataclasses import replace

        asked = replace(options, columns=tuple(name for name in columns if _is_numbered(name)))
    roles = find_roles(list(columns), asked, path)
    return frame_rows(pd.DataFrame(columns), roles, path, options.decimal)


def _unpacked(data: bytes) -> int:
    """Bytes of the arrays, by the directory of the archive; if there is none, reading it fails."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return sum(member.file_size for member in archive.infolist())
    except (zipfile.BadZipFile, ValueError, NotImplementedError, struct.error):
        return 0


def _is_numbered(name: str) -> bool:
    return name[:1] == "x" and name[1:].isdigit()
