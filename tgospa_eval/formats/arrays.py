"""Arrays by step and track, in npy, npz and MAT files or in memory.

States are NaN where an object is absent. A file may have variables of these kinds: states ``x``,
their covariances ``P``, particles and their weights, times, and ids. Each axis has a letter: T
steps, n tracks, d coordinates, N particles. An array with the axes ``Tnd`` has the shape (T, n, d).
"""

import io
import struct
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from math import prod
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Mask
from tgospa_eval.common.notices import Notice
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.headers import BOX
from tgospa_eval.formats.loading import TABLE, check_memory, unreadable
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.roles import find_roles
from tgospa_eval.formats.rows import Rows
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.tracks.trajectories import as_doubles, column_names

AXES = 3

LARGEST_ARRAY = 2**63
"""Smallest size in bytes of an array that NumPy refuses.

For this size, NumPy counts an axis of size 0 like an axis of size 1."""

NAMES = {
    "x": ("x", "xState", "states"),
    "P": ("P", "covariance"),
    "particles": ("particles",),
    "weights": ("weights", "weight", "w"),
    "t": ("t", "times"),
    "id": ("id", "ids"),
    "columns": ("columns",),
}
"""Names of the variables of each kind, the usual name first."""

NUMPY = {"x": ("Tnd",), "P": ("Tndd",), "particles": ("TnNd",), "weights": ("TnN",)}
MATLAB = {
    "x": ("dTn", "dnT", "Tnd"),
    "P": ("ddTn", "ddnT", "Tndd"),
    "particles": ("dNTn", "dNnT", "TnNd"),
    "weights": ("NTn", "NnT", "TnN"),
}
"""Possible axes of each kind of variable in MAT files. A name such as x_dTn says the axes."""

STATE_NAMES = {"x", "lat", "left"}
"""Names that the first coordinate of the states has in tables.

If no coordinate has such a name, all coordinates are read as states."""

Array: TypeAlias = NDArray[np.generic]
Variables: TypeAlias = Mapping[str, Array]


NAPARI = (
    "; rows of tracks (id, t, y, x, as of napari) are written as CSV by pandas.DataFrame(array, "
    'columns=["id", "t", "y", "x"]).to_csv(FILE, index=False)'
)
"""Remedy for an array of napari, which is a table and not an array by step and track."""


def read_npy(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """Read the rows of an npy file.

    Ids and times count from 0. `role` has no effect.

    Raises
    ------
    InputError
        The file is not npy, its array does not have three axes, or its content is wrong (see
        `formats.read`).
    """
    if not data:
        raise InputError(f"{path}: the file is empty; a set without objects has shape (T, 0, d)")
    states = _array(path, data)
    if states.ndim != AXES:
        raise InputError(
            f"{path}: an array of shape {states.shape}; states have the axes (T, k, d), with NaN "
            "where an object is absent" + (NAPARI if states.ndim == 2 else "")
        )
    return array_rows(path, {"states": states}, options, file=len(data))


def _array(path: str, data: bytes) -> Array:
    """Return the array of an npy file, after a check that the file has the size in its header."""
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_2_0
        if version == (1, 0):
            read = np.lib.format.read_array_header_1_0
        shape, in_columns, kind = read(stream)
    except Exception as error:  # a damaged header may raise any error: it is parsed as Python
        raise unreadable(path, "npy", error) from None
    size, there = prod(shape) * kind.itemsize, len(data) - stream.tell()
    if kind.hasobject or size != there or min(shape, default=1) < 0:
        what = "it has Python objects" if kind.hasobject else f"{there:,} bytes instead of {size:,}"
        raise InputError(f"{path}: not a readable npy file: {what}")
    try:
        values = np.frombuffer(data, kind, offset=stream.tell())
        return values.reshape(shape, order="F" if in_columns else "C")
    except ValueError as error:  # a type without bytes, or huge axes and one of size 0
        raise unreadable(path, "npy", error) from None


def kind_of(name: str) -> tuple[str, str]:
    """Return the kind of a variable (a key of `NAMES`) and the axes in its name, or blanks."""
    base, _, axes = name.rpartition("_")
    for kind, names in NAMES.items():
        if name in names:
            return kind, ""
        if base in names and kind in NUMPY and sorted(axes) == sorted(NUMPY[kind][0]):
            return kind, axes
    return "", ""


def has_states(names: Mapping[str, Any]) -> bool:
    """Return whether one of these names is a name of states or particles."""
    return any(kind_of(name)[0] in ("x", "particles") for name in names)


def sized(name: str, shape: tuple[int, ...]) -> str:
    """Return the name of a variable and its size, for messages."""
    return f"{name} {' x '.join(map(str, shape))}".rstrip()


def array_rows(
    path: str,
    arrays: Variables,
    options: ReadOptions,
    *,
    file: int | None = None,
    axes: Mapping[str, tuple[str, ...]] = NUMPY,
    there: Mask | None = None,
    names: tuple[str, ...] | None = None,
    chosen: Sequence[int] | None = None,
) -> Rows:
    """Return the rows of states or particles, with their covariances, weights, times and ids.

    Parameters
    ----------
    path : str
        Beginning of messages.
    arrays : mapping of str to array
        Variables by name, see `NAMES`. If no name means states or particles, the only array with
        three axes has the states.
    options : ReadOptions
        Options of reading.
    file : int, optional
        Size of the file in bytes, for the check of memory, if the arrays are from a file.
    axes : mapping of str to tuple of str
        Possible axes of each kind of variable. With `MATLAB`, steps and tracks count from 1.
    there : (T, n) bool array, optional
        True where a state exists; by default where it has no NaN.
    names : tuple of str, optional
        Names of the d coordinates; ignored if their number is not d.
    chosen : sequence of int, optional
        Indices of the coordinates to compare; by default all.

    Raises
    ------
    InputError
        Sizes do not fit each other, or fit in several ways; or the content is wrong (see
        `formats.read`).
    """
    import pandas as pd  # lazy: slow to import

    from tgospa_eval.formats.frames import frame_rows

    kinds, unused = _sorted(path, arrays)
    labels = {kind: sized(name, array.shape) for kind, (name, array) in kinds.items()}
    lengths = {"T": "t", "n": "id", "d": "columns"}
    known = {axis: kinds[kind][1].size for axis, kind in lengths.items() if kind in kinds}
    tables = _oriented(path, {k: v for k, v in kinds.items() if k in axes}, known, axes)
    what = "particles" if "particles" in tables else "x"
    tables = _chosen(tables, chosen, path)
    *shape, size = (tables[what].shape[k] for k in (0, 1, -1))
    if not size:
        raise InputError(f"{path}: {labels[what]}: states have no coordinates")
    first = int(axes is MATLAB)
    if there is None:  # an empty array may have huge axes
        there = np.ones(shape if tables[what].size else (0, 0), bool)
    step, track = at = np.nonzero(there)
    each = tables[what].shape[2] if what == "particles" else 1
    if file is not None:
        about = " and ".join(labels[kind] for kind in tables)
        width = size + (size * size + 2 if "P" in tables else 2)
        count = max(len(step) * each, 1)  # names of columns also need memory
        check_memory(path, TABLE * 8 * count * width, file, options.max_input, about)
    names = _columns(path, kinds, size, options, names)
    table: dict[str, Any] = {}
    for kind, place in (("id", track), ("t", step)):
        if kind in kinds:
            values = kinds[kind][1].ravel()
            values = (_whole(values) if first else values)[place]
        else:
            values = place + first
        table[kind] = np.repeat(values, each)
    points = tables[what][at]
    if what == "particles":
        table["weight"] = _weights(points, tables["weights"][at] if "weights" in tables else None)
    table |= dict(zip(names, points.reshape(-1, size).T, strict=True))
    if what == "x" and "P" in tables:
        table |= spread_columns(names, tables["P"][at])
    warnings: tuple[Notice, ...] = ()
    if options.columns is None and not options.boxes and not STATE_NAMES & set(names):
        options = replace(options, columns=names)  # all coordinates are states
        if "columns" not in kinds and chosen is None:
            warnings = (all_compared(names),)
    roles = find_roles(list(table), options, path)
    unused += [labels[k] for k in {"particles": ("x", "P"), "x": ("weights",)}[what] if k in labels]
    if unused:
        roles = replace(roles, passed=(*roles.passed, f"variables not used: {listed(unused)}"))

    def where(row: int) -> str:
        at = row // each
        return f"{path}, trajectory {track[at] + first}, step {step[at] + first}"

    rows = frame_rows(pd.DataFrame(table), roles, path, options.decimal, where)
    return replace(rows, warnings=warnings)


def _columns(
    path: str,
    kinds: dict[str, tuple[str, Array]],
    size: int,
    options: ReadOptions,
    names: tuple[str, ...] | None,
) -> tuple[str, ...]:
    """Return the names of the coordinates."""
    if "columns" in kinds:
        names = tuple(str(name).strip() for name in kinds["columns"][1].ravel())
    elif names is None or len(names) != size:
        names = BOX if options.boxes and size == len(BOX) else column_names(size)
    taken = {"id", "t", "weight"} & set(names)
    if taken:
        raise InputError(f"{path}: a column of the states is named {min(taken)}; rename it")
    if len(set(names)) < size:
        raise InputError(f"{path}: columns {', '.join(names)}: a name is a duplicate; rename one")
    return names


def _weights(points: Floats, given: Floats | None) -> Any:
    """Return the weights of particles as a flat array; by default equal weights.

    `points` (R, N, d) has N particles for each of R states; `given` (R, N) has their weights.
    """
    if given is None:
        there = ~np.isnan(points).any(axis=2)
        given = there / np.maximum(there.sum(axis=1, keepdims=True), 1)
    return given.ravel()


def _chosen(
    tables: dict[str, Floats], chosen: Sequence[int] | None, path: str
) -> dict[str, Floats]:
    """Select the chosen coordinates of the arrays."""
    parts = dict(tables)
    for kind in tables.keys() - {"weights"} if chosen is not None else ():
        places = components(chosen, tables[kind].shape[-1], path)
        parts[kind] = tables[kind][..., places]
        parts[kind] = parts[kind][..., places, :] if kind == "P" else parts[kind]
    return parts


def components(chosen: Sequence[int] | None, size: int, name: str) -> list[int]:
    """Return the indices of the components of states to compare: the chosen ones, or all.

    Raises
    ------
    ConfigError
        The states do not have these components, or one is a duplicate.
    """
    numbers = list(range(size) if chosen is None else chosen)
    if not numbers or len(set(numbers)) < len(numbers) or not set(numbers) <= set(range(size)):
        raise ConfigError(
            f"mapping is {tuple(numbers)}: must be different components of the states of {name}, "
            f"from 0 to {size - 1}"
        )
    return numbers


def spread_columns(names: tuple[str, ...], matrices: Floats) -> dict[str, Any]:
    """Return covariances (R, d, d) as columns of a table that `formats.spread` can read."""
    return {
        f"cov_{one}_{other}": matrices[:, i, j]
        for i, one in enumerate(names)
        for j, other in enumerate(names)
    }


def all_compared(names: tuple[str, ...]) -> Notice:
    """Return the warning that all components are compared, and some may be velocities."""
    return Notice(
        code="all-components",
        text=f"all {len(names)} components of the states, {names[0]} to {names[-1]}, are compared",
        remedy=f"if some are velocities, choose the positions, "
        f"{option('columns', f'x={names[0]},y={names[2]}')} (in Python also mapping=(0, 2))",
    )


def _sorted(path: str, arrays: Variables) -> tuple[dict[str, tuple[str, Array]], list[str]]:
    """Return name and array of each used variable by its kind, and a list of unused variables.

    The list has names and sizes, for messages.
    """
    kinds: dict[str, tuple[str, Array]] = {}
    unused = []
    for name, array in arrays.items():
        kind, _ = kind_of(name)
        if kind in kinds:
            raise InputError(f"{path}: {kinds[kind][0]} and {name} mean the same; leave one out")
        if kind:
            kinds[kind] = name, array
        else:
            unused.append(name)
    deep = [name for name in unused if arrays[name].ndim == AXES]
    if not has_states(arrays):
        if len(deep) != 1:
            shapes = ", ".join(sized(name, array.shape) for name, array in arrays.items())
            raise InputError(
                f"{path}: {shapes}: none is named as states; name the states x, or particles"
            )
        kinds["x"] = deep[0], arrays[deep[0]]
        unused.remove(deep[0])
    for kind, (name, array) in kinds.items():
        if 8 * prod(max(size, 1) for size in array.shape) >= LARGEST_ARRAY:
            raise InputError(f"{path}: {sized(name, array.shape)}: too large for memory")
        if kind in NUMPY and array.dtype.kind not in "iuf":
            raise InputError(f"{path}: {name} of type {array.dtype}; it must be of real numbers")
        if kind not in NUMPY and max(array.shape, default=1) != array.size:
            raise InputError(f"{path}: {sized(name, array.shape)}; it must be a vector")
    return kinds, [sized(name, arrays[name].shape) for name in unused]


def _oriented(
    path: str,
    kinds: dict[str, tuple[str, Array]],
    known: dict[str, int],
    axes: Mapping[str, tuple[str, ...]],
) -> dict[str, Floats]:
    """Transpose the arrays so that they have the axes of `NUMPY`.

    The axes of each array are those that fit the sizes of all arrays. `known` has the sizes of axes
    that follow from times, ids and names of columns. `axes` has the possible axes of each kind.

    Raises
    ------
    InputError
        No order of axes fits, or several fit and give different arrays.
    """
    ways = {kind: kind_of(name)[1] for kind, (name, _) in kinds.items()}
    allowed = {kind: (way,) if way else axes[kind] for kind, way in ways.items()}
    fits = []
    for chosen in product(*allowed.values()):
        sizes = dict(known)
        if all(
            _fits(array.shape, way, sizes, drop=axes is MATLAB and (way[-1] != "d" or "n" in known))
            for (_, array), way in zip(kinds.values(), chosen, strict=True)
        ):
            fits.append(dict(zip(kinds, chosen, strict=True)))
    shapes = ", ".join(
        [sized(name, array.shape) for name, array in kinds.values()]
        + [f"{axis} = {size}" for axis, size in known.items()]
    )
    if not fits:
        rules = "; ".join(
            f"{kinds[kind][0]} is {' or '.join(map(_spelt, way))}" for kind, way in allowed.items()
        )
        raise InputError(
            f"{path}: {shapes}: sizes do not match; {rules}, for T steps, n tracks, d coordinates "
            "and N particles; give another order of axes in the name, x_dTn"
        )
    made = [
        {kind: _turned(array, way[kind], kind) for kind, (_, array) in kinds.items()}
        for way in fits
    ]
    for other in made[1:]:
        for kind, array in other.items():
            if not np.array_equal(array, made[0][kind], equal_nan=True):
                orders, base = dict.fromkeys(way[kind] for way in fits), NAMES[kind][0]
                savable = kind != "P" and array.shape != made[0][kind].shape and len(known) < 2
                raise InputError(
                    f"{path}: {shapes}: {kinds[kind][0]} may be {' or '.join(map(_spelt, orders))};"
                    f" name it {' or '.join(f'{base}_{one}' for one in orders)}"
                    f"{', or save t and id with it' if savable else ''}"
                )
    return made[0]


def _fits(shape: tuple[int, ...], way: str, sizes: dict[str, int], *, drop: bool) -> bool:
    """Return whether an array can have the axes `way`, and add their sizes to `sizes`.

    With `drop`, the array may lack last axes, as MATLAB drops last axes of size 1.
    """
    if drop:
        shape += (1,) * (len(way) - len(shape))
    return len(shape) == len(way) and all(
        sizes.setdefault(axis, size) == size for axis, size in zip(way, shape, strict=True)
    )


def _turned(array: Array, way: str, kind: str) -> Floats:
    """Transpose an array from the axes `way` to the axes of `NUMPY`."""
    array = array.reshape(array.shape + (1,) * (len(way) - array.ndim))
    left, order = list(way), []
    for axis in NUMPY[kind][0]:
        order.append(left.index(axis))
        left[order[-1]] = ""
    return as_doubles(array.transpose(order))


def _spelt(way: str) -> str:
    return " x ".join(way)


def _whole(times: Array) -> Array:
    """Convert doubles that are whole numbers to integers, as MATLAB has only doubles."""
    if times.dtype.kind == "f" and (np.abs(times) < 2**53).all() and (times % 1 == 0).all():
        return times.astype(np.int64)
    return times


def read_npz(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """Read the rows of an npz file; `role` has no effect.

    The file has arrays ``id, t, weight, x, y, ...`` of one length, like the columns of a CSV file.
    ``x`` may also be an array (P, d) of P rows and d columns. These columns are named x, y, z; if
    d > 3, they are named x0, x1, ... Instead, the file may have arrays by step and track.

    Raises
    ------
    InputError
        The file is not npz, or its content is wrong (see `formats.read`). In messages, rows count
        from 0.
    """
    import pandas as pd

    from tgospa_eval.formats.frames import frame_rows

    if not data:
        raise InputError(f"{path}: the file is empty; a set without objects has empty arrays")
    size = _unpacked(data)
    check_memory(path, TABLE * size, len(data), options.max_input, f"arrays of {size:,} bytes")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except Exception as error:  # damaged archives raise errors of many kinds
        if "allow_pickle" in str(error):  # NumPy takes any other content for Python objects
            raise InputError(f"{path}: not a readable npz file; numpy.savez writes one") from None
        raise unreadable(path, "npz", error) from None
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):  # NumPy opens any zip file
            raise InputError(
                f"{path}: not a readable npz file: {quoted(name)} in it is not an array; write "
                "arrays with numpy.savez, and tables, such as those of a spreadsheet, as CSV"
            )
    if any(array.ndim >= AXES for array in arrays.values()):
        return array_rows(path, arrays, options, file=len(data))
    columns: dict[str, Any] = {}
    for name, array in arrays.items():
        if name == "x" and array.ndim == 2:
            size = 8 * TABLE * array.shape[1]
            check_memory(path, size, len(data), options.max_input, sized(name, array.shape))
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
    """Return the size of the unpacked arrays in bytes; 0 if the archive cannot be read.

    The directory of the archive has the size, so that nothing is unpacked.
    """
    import zipfile  # lazy: slow to import

    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return sum(member.file_size for member in archive.infolist())
    except (zipfile.BadZipFile, ValueError, NotImplementedError, struct.error):
        return 0
