"""Reading of truth and estimate: files by their format, and objects in memory by their type.

A side is the truth or the estimate. Objects in memory are tables, arrays, mappings and sets of
tracks. An array (T, k, d) has T steps, k tracks and d state columns. Weights of steps are also read
here.

A reader of a format returns all rows of a file, as `formats.rows.Rows` or as a DataFrame.
`formats.assemble` filters these rows and converts them to a `Reading`.
"""

import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import fields, replace
from operator import index
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeGuard, cast

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.files import is_regular
from tgospa_eval.common.words import more, natural
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import FORMATS
from tgospa_eval.formats.arrays import (
    all_compared,
    array_rows,
    components,
    kind_of,
    spread_columns,
)
from tgospa_eval.formats.headers import unit_of
from tgospa_eval.formats.options import ROLES, ReadOptions, one_of
from tgospa_eval.formats.reading import Reading, by_place
from tgospa_eval.formats.roles import find_roles
from tgospa_eval.formats.rows import Rows
from tgospa_eval.quoting import READER, option, quoted, spelled_for
from tgospa_eval.tracks.conversion import Conversion
from tgospa_eval.tracks.trajectories import Trajectories, as_doubles, column_names
from tgospa_eval.tracks.weights import WeightsByTime, repeated

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.formats.fields import Times
    from tgospa_eval.tracks.clouds import Cloud, Clouds
    from tgospa_eval.tracks.trajectories import TimeArray


class ArrayLike(Protocol):
    """A tensor of PyTorch or JAX, or another array that NumPy can read."""

    def __array__(self) -> "np.ndarray[Any, Any]":
        """Return the numbers as a NumPy array."""


ALL_AXES = 4
"""Number of axes of an array (runs, T, k, d)."""

TimedArray: TypeAlias = "tuple[Sequence[object] | ArrayLike, ArrayLike | Sequence[object]]"
"""Pair of times and states."""


# -------------------------------------------------------------------------------------------------
# Tracks and ground-truth paths of Stone Soup. The package is not imported: a track is recognised by
# its attributes.


class TrackLike(Protocol):
    """A track or a ground-truth path of Stone Soup.

    States have ``timestamp``, ``state_vector`` or ``mean``, and perhaps ``covar``.
    """

    @property
    def id(self) -> object:
        """Name of the track."""

    @property
    def states(self) -> Sequence[Any]:
        """States of the track, in order."""


Components: TypeAlias = "Sequence[int] | Sequence[Sequence[int]]"
"""Indices of the components of state vectors to compare.

One sequence is used for both sides. Of two sequences, the first is for the truth."""


def _rows_of_tracks(
    tracks: Iterable[Any],
    name: str,
    options: ReadOptions,
    columns: tuple[str, ...] | None,
    mapping: Sequence[int] | None,
) -> Rows:
    """Convert tracks and ground-truth paths of Stone Soup to rows.

    If a track has several states at one time, the last of these counts, as with
    ``last_timestamp_generator`` of Stone Soup. A tracker may store a predicted state and then the
    state that a measurement corrected. Then the corrected state counts.

    If covariances are not read, each state is a point. If they are read, there are two kinds of
    states:

    - If ``state_vector`` has several columns, each column is a particle. The attribute ``weight``
      has the weights.
    - Any other state is a mean with the covariance ``covar``. The covariance is NaN if ``covar`` is
      missing.

    Raises
    ------
    ConfigError
        Components are not chosen, or do not exist.
    InputError
        A state has no time, or is not numeric; an id is a duplicate; or some states have particles
        and others covariances.
    """
    import pandas as pd  # lazy: slow to import, and most files do not need it

    from tgospa_eval.formats.frames import frame_rows

    states = list(_states_of_tracks(tracks, name, options, mapping))
    size = len(states[0][2]) if states else len(mapping or (0,))
    other = next((state for state in states if len(state[2]) != size), None)
    if other is not None:
        raise InputError(
            f"{name}: id {quoted(other[0])}, t {other[1]} has {len(other[2])} components, the "
            f"first state has {size}; choose the same by mapping=(0, 2)"
        )
    names = columns if columns is not None and len(columns) == size else column_names(size)
    row = np.repeat(np.arange(len(states)), [len(points) for *_, (points, _), _ in states])
    ids = np.array([state[0] for state in states], dtype=object)[row]
    times = pd.Series([state[1] for state in states], dtype=None if states else np.int64)
    table: dict[str, Any] = {"id": ids, "t": times.take(row).array}
    spread = next((state for state in states if state[4] is not None), None)
    if len(row) > len(states):
        if spread is not None:
            raise InputError(
                f"{name}: id {quoted(spread[0])}, t {spread[1]} has a covariance, but other "
                "states have particles; give all states the same kind"
            )
        points, table["weight"] = map(np.concatenate, zip(*(s[3] for s in states), strict=True))
    else:
        points = np.array([state[2] for state in states], np.float64).reshape(-1, size)
    table |= dict(zip(names, points.T, strict=True))
    if spread is not None:
        absent = np.full((size, size), np.nan)
        matrices = np.array([absent if state[4] is None else state[4] for state in states])
        table |= spread_columns(names, matrices)
    roles = find_roles(list(table), options, name)
    return frame_rows(
        pd.DataFrame(table),
        roles,
        name,
        options.decimal,
        lambda k: f"{name}, track {quoted(ids[k])}",
    )


State: TypeAlias = "tuple[str, Any, Floats, Cloud, Floats | None]"
"""Id, time, mean, particles and covariance of a state.

A state without particles has its mean as the only particle."""


def _states_of_tracks(
    tracks: Iterable[Any], name: str, options: ReadOptions, mapping: Sequence[int] | None
) -> Iterator[State]:
    """Yield the states of all tracks, track by track."""
    from tgospa_eval.formats.frames import id_text

    known: set[str] = set()
    for number, path in enumerate(tracks):
        text = id_text(getattr(path, "id", number), name)
        where = f"{name}, track {quoted(text)}"
        if text in known:
            raise InputError(f"{name}: two tracks have the id {quoted(text)}")
        known.add(text)
        if not isinstance(path.states, Iterable):
            raise InputError(f"{where}: states is of the type {type(path.states).__name__}")
        by_time = {getattr(state, "timestamp", None): state for state in path.states}
        for moment, state in by_time.items():
            if moment is None:
                raise InputError(f"{where}: a state without timestamp")
            vector = getattr(state, "mean", None)
            vector = getattr(state, "state_vector", None) if vector is None else vector
            if vector is None:
                raise InputError(f"{where}: a state without state_vector")
            size = np.size(vector)
            if mapping is None and size > 1 and options.columns is None:
                raise ConfigError(
                    f"{name}: state vectors have {size} components, and do not say which are the "
                    "position; choose those to compare, mapping=(0, 2) for x and y of "
                    "(x, vx, y, vy)"
                )
            chosen = components(mapping, size, name)
            mean = numbers_of(vector, where).ravel()[chosen]
            cloud, spread = (mean[None], np.ones(1)), None
            if options.covariance and np.size(getattr(state, "state_vector", vector)) > size:
                cloud = _cloud(state, chosen, where)
            elif options.covariance and getattr(state, "covar", None) is not None:
                spread = numbers_of(state.covar, where)
                if spread.shape != (size, size):
                    raise InputError(
                        f"{where}, t {moment}: covar is {spread.shape}; must be {(size, size)}"
                    )
                spread = spread[chosen][:, chosen]
            yield text, moment, mean, cloud, spread


def _cloud(state: Any, chosen: list[int], where: str) -> "Cloud":
    """Return the N particles (N, d) of a state and their weights, which are equal by default."""
    points = numbers_of(state.state_vector, where)
    points = points.reshape(len(points), -1)[chosen].T
    weights = getattr(state, "weight", None)
    if weights is None:
        return points, np.full(len(points), 1 / len(points))
    weights = numbers_of(weights, where).ravel()
    if len(weights) != len(points):
        raise InputError(f"{where}: {len(points)} particles and {len(weights)} weights")
    return points, weights


class ArrowTable(Protocol):
    """A table of Polars, pyarrow, DuckDB and others, with columns in the Arrow interface."""

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Return the columns as an Arrow stream."""


class NamedArray(Protocol):
    """A DataArray or Dataset of xarray, whose dimensions have names and perhaps coordinates."""

    @property
    def dims(self) -> Any:
        """Names of the dimensions."""

    @property
    def coords(self) -> Mapping[Any, Any]:
        """Coordinates by name."""


TrajectoriesLike: TypeAlias = (
    "Trajectories | pd.DataFrame | ArrowTable | ArrayLike | TimedArray | "
    "Mapping[Any, ArrayLike | TimedArray] | Iterable[TrackLike] | NamedArray | str | "
    "os.PathLike[str]"
)
"""Forms of a side: Trajectories, a table with a row for each object and time, a path, an array
(T, k, d), a pair (times, array), a mapping from ids to arrays, arrays of xarray, and tracks of
Stone Soup."""


Runs: TypeAlias = "TrajectoriesLike | Sequence[Any]"
"""One side, or several runs of it, see `runs_of`. Each run is in one of the forms of a side."""


def is_path(side: object) -> TypeGuard["str | os.PathLike[str]"]:
    """Return whether a side is the path of a file."""
    return isinstance(side, (str, os.PathLike))


def check_as_long(given: Sequence[object], sides: Sequence[Reading], names: Sequence[str]) -> None:
    """Check that sides without times have the same number of steps.

    `given` has the sides as the user gave them, `sides` as they were read. `names` are for
    messages.

    Raises
    ------
    InputError
        The sides have different numbers of steps.
    """
    counted = [
        len(read.trajectories.times)
        for side, read in zip(given, sides, strict=True)
        if not is_empty(side) and len(read.trajectories.times) and _counts_steps(side)
    ]
    if len(set(counted)) > 1:
        raise InputError(
            f"{names[0]} has {counted[0]} steps and {names[1]} has {counted[1]}: arrays "
            "(T, k, d) must have the same T; fill steps without objects with NaN, or give pairs "
            "(times, array)"
        )


def filled(sides: Sequence[Reading | None], columns: tuple[str, ...] | None) -> tuple[Reading, ...]:
    """Return both sides; a side that is None becomes a reading without tracks.

    The new reading has the state columns of the other side. If both sides are None, they get as
    many state columns as `columns` has; two if `columns` is None.
    """
    given = tuple(side for side in sides if side is not None)
    if len(given) == len(sides):
        return given
    if given:
        there = given[0].trajectories
    else:
        there = Trajectories.from_array(np.zeros((0, 0, len(columns or "xy"))))
    nothing = Trajectories.of_times(there.times[:0], there.columns, there.clock)
    empty = Reading(trajectories=nothing, rows=0, format="")
    return tuple(empty if side is None else side for side in sides)


def components_of(
    given: Sequence[object], mapping: "Components | None"
) -> "list[Sequence[int] | None]":
    """Return, for each side, the indices of the components of state vectors to compare.

    Raises
    ------
    ConfigError
        The mapping is not made of indices, or all sides have columns with names.
    """
    if mapping is None:
        return [None] * len(given)
    if all(is_path(s) or isinstance(s, Trajectories) or hasattr(s, "columns") for s in given):
        raise ConfigError("mapping is for tracks and arrays; for files and tables choose columns")
    try:
        whole: list[Any] = list(mapping)
        is_pair = len(whole) == 2 and all(isinstance(side, Iterable) for side in whole)
        pair = whole if is_pair else (whole, whole)
        return [[index(item) for item in side] for side in pair]
    except TypeError:
        raise ConfigError(
            f"mapping is {mapping!r}: must be components, such as (0, 2), or a pair of such tuples"
        ) from None


def _is_tracks(side: object) -> bool:
    """Return whether a side is a track of Stone Soup, or a set of tracks."""
    if hasattr(side, "states"):
        return True
    if not isinstance(side, Collection) or isinstance(side, (str, Mapping, Trajectories)):
        return False
    return (
        len(side) > 0
        and not hasattr(side, "__array__")
        and all(hasattr(item, "states") for item in side)
    )


# -------------------------------------------------------------------------------------------------
# Arrays with named axes: DataArray and Dataset of xarray. The package is not imported; its objects
# are recognised by their attributes.

NAMED_AXES = {
    "R": ("run", "realization", "realisation", "mc", "trial"),
    "T": ("time", "t", "step", "frame", "timestamp", "scan"),
    "n": ("object", "obj", "id", "track", "target", "trajectory"),
    "N": ("particle", "sample"),
    "d": ("state", "component", "coordinate", "coord", "axis", "space", "dim", "xyz", "xy"),
}
"""Names of dimensions by the letter of an axis: R for runs, others as in `formats.arrays`.

Names in the plural and names that end in a number are also known, such as ``tracks`` and
``time_0``."""

ARRAY_OF_AXES = {"Tdn": "x", "Tddn": "P", "NTdn": "particles"}
"""Kind of a variable by the letters of its axes. They are sorted, capital letters first."""


def _axis_of(dim: object, name: str) -> str:
    """Return the letter of an axis, as in `NAMED_AXES`, for the name of a dimension.

    Raises
    ------
    InputError
        The name of the dimension is unknown.
    """
    word = str(dim).lower().rstrip("_0123456789")
    for letter, words in NAMED_AXES.items():
        if word in words or word.removesuffix("s") in words:
            return letter
    known = ", ".join(words[0] for words in NAMED_AXES.values())
    raise InputError(f"{name}: unknown dimension {quoted(str(dim))}; known names are {known}")


def _has_named_axes(side: object) -> bool:
    return all(hasattr(side, attribute) for attribute in ("dims", "coords", "isel"))


def with_units(made: Reading, side: Any) -> Reading:
    """Return the reading `made` with the units that the attributes of an xarray object give.

    For any other `side` the reading is returned unchanged.
    """
    if not _has_named_axes(side):
        return made
    variables = getattr(side, "data_vars", {"": side}).items()
    given = {
        str(key): unit_of(f"in {getattr(one, 'attrs', {}).get('units', '')}")
        for key, one in variables
    }
    known = {key: unit for key, unit in given.items() if unit}
    whole = next(iter(known.values())) if len(known) == 1 else ""
    units = {name: known.get(name, whole) for name in made.trajectories.columns}
    return replace(made, units={name: unit for name, unit in units.items() if unit})


def with_plain_axes(side: Any, name: str) -> Any:
    """Convert arrays with named axes to arrays by step and track; return any other side unchanged.

    A DataArray has states. In a Dataset, the dimensions of a variable show whether it has states,
    covariances or particles. A variable without an axis of components has weights if its name says
    so. If not, it has one coordinate of the states.

    Raises
    ------
    InputError
        An axis has an unknown name, no axis is time, or an axis has runs.
    """
    if not _has_named_axes(side):
        return side
    axes = {dim: _axis_of(dim, name) for dim in side.dims}
    if "T" not in axes.values() or "R" in axes.values():
        what = "no time" if "T" not in axes.values() else "only compare and batch accept runs"
        raise InputError(f"{name}: dimensions {', '.join(map(str, axes))}: {what}")
    arrays: dict[str, Any] = {}
    columns: dict[str, Any] = {}
    has_objects = "n" in axes.values()
    for key, variable in getattr(side, "data_vars", {"x": side}).items():
        letters = "".join(axes[dim] for dim in variable.dims)
        values = np.asarray(variable.values)
        if "T" not in letters or has_objects is not ("n" in letters):
            continue
        if not has_objects:
            values, letters = values[..., None], f"{letters}n"
        values = values.transpose(
            sorted(range(len(letters)), key=lambda k: "TnNd".index(letters[k]))
        )
        kind = ARRAY_OF_AXES.get("".join(sorted(letters)), "")
        if not kind and kind_of(str(key))[0] == "weights":
            kind = "weights"
        if kind in arrays:
            raise InputError(
                f"{name}: {key} and another variable have the same dimensions; choose one"
            )
        if kind or values.dtype.kind in "iuf":
            (arrays if kind else columns)[kind or str(key)] = values
    if columns and not arrays.keys() & {"x", "particles"}:
        axes_of_one = max(values.ndim for values in columns.values())
        columns = {key: values for key, values in columns.items() if values.ndim == axes_of_one}
        kind = "x" if axes_of_one == ALL_AXES - 2 else "particles"
        arrays |= {kind: np.stack([*columns.values()], axis=-1), "columns": np.array([*columns])}
    for dim, letter in axes.items():
        kind = {"T": "t", "n": "id", "d": "columns"}.get(letter, "")
        there = np.asarray(side.coords[dim].values) if kind and dim in side.coords else None
        if there is not None and (kind != "columns" or there.dtype.kind in "UO"):
            arrays.setdefault(kind, there)
    return arrays


def runs_of(side: object, name: str) -> "list[tuple[str, Any]] | None":
    """Return name and side of each run of a Monte Carlo study; None if there are no runs.

    A name is blank if the runs have no names. These objects have runs:

    - a list or tuple of sides
    - an array (runs, T, k, d), or a pair of times and such an array
    - an array of xarray with the dimension ``run``
    - a table with the column ``run``; its runs are sorted by the values of this column

    Raises
    ------
    InputError
        The column ``run`` has a blank.
    """
    if _has_named_axes(side):
        named_axes = cast("Any", side)
        dim = next((dim for dim in named_axes.dims if _axis_of(dim, name) == "R"), None)
        names = named_axes.coords[dim].values if dim in named_axes.coords else None
        return dim and [
            ("" if names is None else str(names[k]), named_axes.isel({dim: k}))
            for k in range(named_axes.sizes[dim])
        ]
    frame = as_frame(side, name)
    if frame is not None:
        if "run" not in frame:
            return None
        from tgospa_eval.formats.frames import id_text  # lazy: pandas is slow to import

        parts = frame.groupby("run", sort=False, dropna=False)
        named = [(id_text(run, f"{name}, column run"), part) for run, part in parts]
        return sorted(named, key=lambda run: natural(run[0]))
    runs: Any = ()
    if is_timed_array(side):
        if getattr(side[1], "ndim", 0) == ALL_AXES:
            runs = [(side[0], array) for array in array_of(side[1], name)]
    elif hasattr(side, "__array__"):
        runs = array_of(side, name) if getattr(side, "ndim", 0) == ALL_AXES else ()
    elif isinstance(side, (list, tuple)) and not _is_tracks(side):
        runs = side
    return [("", run) for run in runs] or None


def is_empty(side: object) -> bool:
    """Return whether a side is an empty collection, which has neither tracks nor columns."""
    kinds = (Mapping, Set, list, tuple)
    return isinstance(side, kinds) and not len(side)


def _counts_steps(side: object) -> bool:
    """Return whether a side has no times, so that its steps are numbered."""
    if isinstance(side, Mapping):
        is_timed = any(isinstance(value, tuple) for value in side.values())
        return not (is_timed or (is_variables(side) and any(kind_of(k)[0] == "t" for k in side)))
    return hasattr(side, "__array__") and as_frame(side, "") is None


def is_variables(side: object) -> bool:
    """Return whether a side is a mapping from names to arrays by step and track, as in npz."""
    return isinstance(side, Mapping) and any(
        isinstance(key, str) and kind_of(key)[0] in ("x", "particles") and np.ndim(value) > 2
        for key, value in side.items()
        if hasattr(value, "ndim")
    )


def read_object(
    side: TrajectoriesLike,
    options: ReadOptions,
    name: str,
    columns: tuple[str, ...] | None = None,
    mapping: "Sequence[int] | None" = None,
) -> Reading:
    """Read an object in memory.

    Tables, tracks and mappings as in `is_variables` are converted to rows, because filters select
    rows. Arrays are converted to rows only if an option in use needs rows
    (`ReadOptions.of_tables`). All other objects are converted to Trajectories directly. `name`
    begins the messages. `columns` are the state columns that the distance prescribes.

    Raises
    ------
    ConfigError, InputError
        The object is of another type, its content is wrong, or it does not support an option.
    """
    frame = as_frame(side, name)
    if frame is not None:
        from tgospa_eval.formats.frames import from_frame  # lazy: pandas is slow to import

        return by_place(lambda how: replace(from_frame(frame, how, name=name), format=""), options)
    rows = None
    if _is_tracks(side):
        tracks = [side] if hasattr(side, "states") else cast("Iterable[TrackLike]", side)
        rows = _rows_of_tracks(tracks, name, options, columns, mapping)
    elif not isinstance(side, Trajectories) and (is_variables(side) or options.of_tables):
        rows = _rows_of_arrays(side, name, options, columns, mapping)
    if rows is not None:
        from tgospa_eval.formats.assemble import assemble

        return assemble(rows, options, "")
    if options.of_tables:
        raise ConfigError(
            f"{option(options.of_tables)} is for files and tables, and {name} is neither: choose "
            "its rows and columns before"
        )
    if isinstance(side, Trajectories):
        return Reading(trajectories=side, rows=len(side.step), format="")
    given: Any = side if mapping is None else _picked(side, mapping, name)
    if is_timed_array(given):
        made = of_timed_array(given, name, columns)
    elif hasattr(given, "__array__"):
        made = of_array(given, name, columns)
    elif isinstance(given, Mapping):
        made = of_mapping(given, name, columns)
    else:
        lazy = "call its collect() first; it " if type(side).__name__ == "LazyFrame" else ""
        raise ConfigError(
            f"{name} is of the type {type(side).__name__}: {lazy}must be Trajectories, a DataFrame "
            "(pandas, Polars or another that Arrow knows), an array (T, k, d) or a pair "
            "(times, array), a mapping from id to array, a set of tracks with states, or a path"
        )
    is_chosen = mapping is not None or made.columns == columns or len(made.columns) <= 3
    warnings = () if is_chosen else (all_compared(made.columns),)
    return Reading(trajectories=made, rows=len(made.step), format="", warnings=warnings)


def has_rows(side: object, options: ReadOptions) -> bool:
    """Return whether a side is converted to rows, see `read_object`; files always are."""
    if isinstance(side, Trajectories):
        return False
    is_table = is_path(side) or as_frame(side, "") is not None
    return is_table or _is_tracks(side) or is_variables(side) or bool(options.of_tables)


def _rows_of_arrays(
    side: Any,
    name: str,
    options: ReadOptions,
    columns: tuple[str, ...] | None,
    mapping: "Sequence[int] | None",
) -> Rows | None:
    """Convert arrays to rows; return None for any other object."""
    if is_timed_array(side):
        side = {"t": list(side[0]), "x": side[1]}
    elif hasattr(side, "__array__"):
        side = {"x": side}
    elif not is_variables(side):
        return None
    arrays = {key: array_of(value, f"{name}, {key}") for key, value in side.items()}
    return array_rows(name, arrays, options, names=columns, chosen=mapping)


def _picked(side: Any, mapping: Sequence[int], name: str) -> Any:
    """Select components in an array, in a pair of times and array, or in a mapping to these."""
    if isinstance(side, Mapping):
        return {key: _picked(value, mapping, name) for key, value in side.items()}
    if isinstance(side, tuple) and len(side) == 2:
        return side[0], _picked(side[1], mapping, name)
    array = array_of(side, name)
    return array[..., components(mapping, array.shape[-1] if array.ndim else 0, name)]


def as_frame(side: object, name: str) -> "pd.DataFrame | None":
    """Return a table as a DataFrame, or None for any other object.

    Tables that are not of pandas are converted by Arrow.
    """
    if hasattr(side, "iloc") and hasattr(side, "columns"):
        return cast("pd.DataFrame", side)
    if not hasattr(side, "__arrow_c_stream__"):
        return None
    try:
        import pyarrow as pa  # lazy: the extra may be missing, and pandas does not need it
    except ModuleNotFoundError:
        raise ConfigError(
            f"{name}: tables that are not of pandas need the extra parquet: "
            "pip install 'tgospa-eval[parquet]'"
        ) from None
    try:
        frame: pd.DataFrame = pa.table(side).to_pandas()
    except (pa.ArrowException, TypeError, ValueError, OverflowError) as error:
        kind = type(side).__name__
        raise InputError(f"{name}: a {kind} cannot be read as a table ({error})") from None
    return frame


# -------------------------------------------------------------------------------------------------
# Arrays with or without times, and mappings from ids to these.


def array_of(value: object, name: str) -> "np.ndarray[Any, Any]":
    """Convert to a NumPy array; a tensor is detached from its gradient and moved to the CPU.

    Raises
    ------
    InputError
        NumPy cannot read the object.
    """
    if isinstance(value, np.ndarray):
        return value
    tensor: Any = value
    for method in ("detach", "cpu"):
        tensor = getattr(tensor, method)() if hasattr(tensor, method) else tensor
    try:
        return np.asarray(tensor)
    except (TypeError, ValueError, RuntimeError) as error:
        text = " ".join(str(error).split())
        raise InputError(f"{name}: not an array that NumPy can read: {text}") from None


def of_array(side: object, name: str, columns: tuple[str, ...] | None) -> Trajectories:
    """Build trajectories from an array (T, k, d)."""
    states = array_of(side, name)
    fits = columns is not None and states.ndim == 3 and states.shape[2] == len(columns)
    try:
        return Trajectories.from_array(states, columns if fits else None)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def of_timed_array(
    side: tuple[object, ...], name: str, columns: tuple[str, ...] | None
) -> Trajectories:
    """Build trajectories from times and an array (T, k, d)."""
    made = of_array(side[1], name, columns)
    times = times_of(side[0], name)
    if len(times.value) != len(made.times):
        raise InputError(
            f"{name}: {len(times.value)} times and {len(made.times)} steps of the array (T, k, d); "
            "give one time for each step"
        )
    if (np.diff(times.value) <= 0).any():
        raise InputError(f"{name}: times must increase strictly")
    return _timed(made, times)


def is_timed_array(side: object) -> TypeGuard[tuple[Any, Any]]:
    """Return whether a side is a pair of times and states."""
    return isinstance(side, tuple) and len(side) == 2 and hasattr(side[1], "__array__")


def of_mapping(
    tracks: Mapping[object, object], name: str, columns: tuple[str, ...] | None
) -> Trajectories:
    """Build trajectories from tracks by id: arrays (T, d), or pairs of times and array.

    Raises
    ------
    InputError
        Shapes do not fit, some tracks have times and others do not, or an id is a duplicate.
    """
    timed = {isinstance(value, tuple) for value in tracks.values()}
    if len(timed) > 1:
        raise InputError(
            f"{name}: some tracks are pairs of times and states, others are not; write all alike"
        )
    timestamps: list[object] = []
    states: list[Floats] = []
    for key, value in tracks.items():
        where = f"{name}, track {quoted(key)}"
        if not isinstance(value, tuple):
            states.append(_states(value, where))
            continue
        if len(value) != 2:
            raise InputError(f"{where}: a tuple of {len(value)}; it must be (times, states)")
        states.append(_states(value[1], where))
        own = _listed(value[0], where)
        if len(own) != len(states[-1]):
            raise InputError(f"{where}: {len(own)} times and {len(states[-1])} states")
        timestamps += own
    first = states[0]
    for key, array in zip(tracks, states, strict=True):
        if array.shape[1] != first.shape[1] or (timed == {False} and len(array) != len(first)):
            raise InputError(
                f"{name}: track {quoted(next(iter(tracks)))} has the shape {first.shape}, track "
                f"{quoted(key)} {array.shape}: arrays (T, d) have the same d and, unless they are "
                "pairs of times and states, the same T; NaN where a track is absent"
            )
    steps = np.tile(np.arange(len(first)), len(states))
    times = times_of(timestamps if timed == {True} else steps, name)
    track = np.repeat(np.arange(len(states)), [len(array) for array in states])
    at = np.arange(len(track)), track
    return from_rows(name, list(tracks), at, np.concatenate(states), times, columns)


def from_rows(
    name: str,
    ids: Sequence[object],
    at: tuple[Ints, Ints],
    states: Floats,
    times: "Times",
    columns: tuple[str, ...] | None,
    covariance: Floats | None = None,
    clouds: "Clouds | None" = None,
) -> Trajectories:
    """Build trajectories from rows in any order; a row with NaN is left out, but its step remains.

    Parameters
    ----------
    name : str
        Beginning of messages.
    ids : sequence of k objects
        Ids of the tracks: texts, numbers and similar values.
    at : pair of (R,) int arrays
        For each of the R rows, the index of its time in `times`, and of its track in `ids`.
    states : (R, d) array
        States.
    times : Times
        Times of the rows. Two of them can be equal.
    columns : tuple of str, optional
        Names of the d columns; ignored if their number is not d.
    covariance, clouds : (R, d, d) array, Clouds, optional
        Covariances of the states, or their particles.

    Raises
    ------
    InputError
        A state is infinite, an id is not valid or a duplicate, or an id has two rows at one time.
    """
    from tgospa_eval.formats.frames import id_text  # lazy: pandas is slow to import
    from tgospa_eval.formats.rows import number_ids

    table, number = number_ids([id_text(value, name) for value in ids])
    if len(table) < len(ids):
        twice = next(text for k, text in enumerate(table) if (number == k).sum() > 1)
        raise InputError(f"{name}: two tracks have the id {quoted(twice)}")
    timestamps, of_stamp = np.unique(times.value, return_inverse=True)
    step, track = of_stamp[at[0]], number[at[1]]
    order = np.lexsort((track, step))
    again = np.flatnonzero((np.diff(step[order]) == 0) & (np.diff(track[order]) == 0))
    if len(again):
        row = order[again[0]]
        stamp = at[0][row]
        moment = times.value[stamp] if times.text is None else times.text[stamp]
        raise InputError(f"{name}: id {quoted(table[track[row]])} is a duplicate at t = {moment}")
    if np.isinf(states).any():
        row = int(np.flatnonzero(np.isinf(states).any(axis=1))[0])
        raise InputError(
            f"{name}, track {quoted(table[track[row]])}: infinite state; NaN means absent"
        )
    kept = order[~np.isnan(states[order]).any(axis=1)]
    size = states.shape[1]
    made = Trajectories(
        step=step[kept],
        track=track[kept],
        state=states[kept],
        ids=table,
        times=np.arange(len(timestamps)),
        columns=columns if columns is not None and len(columns) == size else column_names(size),
        covariance=None if covariance is None else covariance[kept],
        clouds=None if clouds is None else clouds.chosen(kept),
    )
    return _timed(made, times)


def _timed(made: Trajectories, times: "Times") -> Trajectories:
    """Replace the times of trajectories by `times`; equal times become one step."""
    labels = None
    timestamps, step = np.unique(times.value, return_inverse=True)
    if times.text is not None:
        labels = np.empty(len(timestamps), dtype=object)
        labels[step[::-1]] = np.array(times.text, dtype=object)[::-1]
    return replace(made, times=cast("TimeArray", timestamps), clock=times.clock, labels=labels)


def _listed(timestamps: object, where: str) -> Sequence[Any]:
    """Return the times as a sequence."""
    if isinstance(timestamps, (list, tuple)):
        return timestamps
    if hasattr(timestamps, "tolist") and not hasattr(timestamps, "dtype"):
        return list(timestamps.tolist())
    array = array_of(timestamps, f"{where}: times")
    if array.ndim != 1:
        raise InputError(f"{where}: times of shape {array.shape}; must be (T,)")
    return list(array)


def times_of(values: object, name: str) -> "Times":
    """Convert numbers, datetimes or ISO texts to times.

    Raises
    ------
    InputError
        A value is not a time, or values are of several kinds.
    """
    import pandas as pd  # lazy: arrays and files do not need it

    from tgospa_eval.formats.frames import frame_times

    given = values if isinstance(values, (list, tuple)) else array_of(values, f"{name}: times")
    if np.ndim(given) != 1:
        raise InputError(f"{name}: times of shape {np.shape(given)}; must be (T,)")
    kind = None if len(given) else np.int64
    return frame_times(pd.Series(given, name="t", dtype=kind), name)


def _states(value: object, where: str) -> Floats:
    """Convert the states of one track to an array (T, d)."""
    array = array_of(value, where)
    if array.ndim != 2 or not array.shape[1]:
        hint = "; a table is a DataFrame, pandas.DataFrame(...)" if array.ndim == 1 else ""
        raise InputError(f"{where}: shape {array.shape}; states have the axes (T, d){hint}")
    return numbers_of(array, where)


def numbers_of(value: object, where: str) -> Floats:
    """Convert numbers to doubles.

    Raises
    ------
    InputError
        A value is not a number.
    """
    try:
        return as_doubles(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: a state holds numbers: {error}") from None


# -------------------------------------------------------------------------------------------------
# Conversion of weights of steps to `WeightsByTime`.

StepWeightsLike: TypeAlias = (
    "Mapping[Any, float] | pd.Series[float] | pd.DataFrame | ArrowTable | Floats | str | "
    "os.PathLike[str]"
)
"""Mapping from time to weight, table ``t, weight[, switch_weight]``, array (T,) or path."""

GIVEN = "step_weights"


def as_step_weights(given: "StepWeightsLike | None", decimal: str = ".") -> WeightsByTime | None:
    """Convert weights of steps in any supported form; `decimal` is the decimal mark in a file.

    Raises
    ------
    ConfigError
        The weights are of an unsupported type.
    InputError
        A time or a weight is not valid, or a time is a duplicate.
    """
    if given is None:
        return None
    if is_path(given):
        from tgospa_eval.formats.text.small import read_step_weights

        return read_step_weights(os.fspath(given), decimal)
    import pandas as pd  # lazy: files do not need it

    if isinstance(given, pd.Series):  # its index has the times
        given = dict(given.items())
    frame = as_frame(given, GIVEN)
    if frame is None and isinstance(given, Mapping):
        frame = pd.DataFrame({"t": list(given.keys()), "weight": list(given.values())})
    if frame is None and isinstance(given, (np.ndarray, list, tuple)):
        if np.ndim(given) != 1:
            raise InputError(
                f"{GIVEN}: an array of shape {np.shape(given)}; it must be (T,), one weight per "
                "step"
            )
        frame = pd.DataFrame({"t": np.arange(len(given)), "weight": given})
    if frame is None:
        raise ConfigError(
            f"{GIVEN} is of the type {type(given).__name__}: must be a mapping from time to "
            "weight, a table with the columns t and weight, an array (T,) or a path"
        )
    return _of_frame(frame)


def _of_frame(frame: "pd.DataFrame") -> WeightsByTime:
    """Convert a table ``t, weight[, switch_weight]`` to weights of steps."""
    from tgospa_eval.formats.frames import frame_times

    columns = {str(name): frame[name] for name in frame.columns}
    missing = [name for name in ("t", "weight") if name not in columns]
    if missing:
        raise InputError(
            f"{GIVEN}: no column {missing[0]}; needed are t and weight, optional is switch_weight"
        )
    times = frame_times(columns["t"], GIVEN)
    again = repeated(times.value)
    if again is not None:
        row, _, count = again
        shown = columns["t"].iloc[row]
        raise InputError(f"{GIVEN}, row {row}: t = {shown} is a duplicate{more(count)}")
    cost = _weights(columns["weight"], "weight")
    switch = _weights(columns.get("switch_weight", columns["weight"]), "switch_weight")
    return WeightsByTime(times=times.value, cost=cost, switch=switch, clock=times.clock, name=GIVEN)


def _weights(column: "pd.Series", header: str) -> Floats:
    try:
        values = column.to_numpy(dtype=np.float64, na_value=np.nan)
    except (TypeError, ValueError):
        raise InputError(f'{GIVEN}, column "{header}": not numbers') from None
    odd = np.flatnonzero(~((values >= 0) & np.isfinite(values)))
    if len(odd):
        raise InputError(
            f'{GIVEN}, row {odd[0]}, column "{header}": {values[odd[0]]:g}{more(len(odd))}; '
            "write a finite number >= 0, 0 for a step that does not count"
        )
    return values


def read(
    side: "TrajectoriesLike | Reading",
    options: ReadOptions | None = None,
    role: str = "truth",
    format: str | None = None,
    name: str | None = None,
    *,
    columns: tuple[str, ...] | None = None,
    mapping: Sequence[int] | None = None,
) -> Reading:
    """Read a side from a file or an object, with its notices.

    Parameters
    ----------
    side : path, Trajectories, DataFrame, array, mapping, set of tracks, or Reading
        The side; a `Reading` is returned as it is.
    options : ReadOptions, optional
        Options of reading, and filters of rows.
    role : {"truth", "estimate"}
        Role of the side. In some formats it decides what a column means or which set is read.
    format : str, optional
        Format of a file, a key of `FORMATS`; by default guessed from name and content.
    name : str, optional
        Name of an object in messages; by default its role.
    columns : tuple of str, optional
        State columns that the distance prescribes, for an object in memory.
    mapping : sequence of int, optional
        Indices of the components to compare, for tracks with state vectors and for arrays.

    Raises
    ------
    InputError
        The side is missing, unreadable or wrong; the message names line and column.
    ConfigError
        An option is not allowed or not supported for such a side, or the package that reads the
        format is missing.
    """
    options = options or ReadOptions()
    if isinstance(side, Reading):
        return side
    if is_path(side):
        return _read_file(side, options, role, format)
    return read_object(side, options, name or role, columns, mapping)


def _read_file(
    path: str | os.PathLike[str], options: ReadOptions, role: str, format: str | None
) -> Reading:
    """Read a file with the reader of its format."""
    from tgospa_eval.formats.assemble import assemble
    from tgospa_eval.formats.guess import file_of, folder_format, guess
    from tgospa_eval.formats.headers import has_patterns
    from tgospa_eval.formats.loading import unpacked_file
    from tgospa_eval.formats.rows import Rows

    one_of("role", role, ROLES)
    reader = None if format is None else FORMATS.chosen(format)
    try:
        name = os.fsdecode(path)
    except TypeError:
        tables = "; evaluate takes DataFrames themselves" if hasattr(path, "columns") else ""
        kind = type(path).__name__
        raise ConfigError(f"path is of the type {kind}: must be a path{tables}") from None
    file = file_of(name)
    kind = folder_format(file)
    is_folder = kind != "" and format in (None, kind)

    def load_content() -> bytes:
        return b"" if is_folder else unpacked_file(file, options.max_input)

    data = load_content()
    chosen = format or (kind if is_folder else guess(file, data))
    if format is None and chosen in WITHOUT_HEADER and "t" in options.placed:
        chosen = "csv"  # the user named its columns in order
    if chosen == "csv" and has_patterns(options):
        chosen, reader = "wide", None
    if reader is None:
        reader = FORMATS.ours(chosen) if chosen in FORMATS.own else FORMATS[chosen]
    contents = [data]  # freed before rows are assembled, and read again if needed
    del data

    def read_by(options: ReadOptions) -> Reading:
        content = contents.pop() if contents else load_content()
        if not os.path.exists(file) or not is_regular(file):
            contents.append(content)  # a pipe can be read only once
        with FORMATS.blamed(chosen, InputError, f"{name}: "):
            rows = reader(name, content, options, role, given=format is not None)
            if not isinstance(rows, Rows):
                from tgospa_eval.formats.frames import table_rows  # lazy: pandas is slow to import

                rows = table_rows(rows, options, name)
        del content
        made: Reading = assemble(rows, options, chosen)
        return made

    reading = by_place(read_by, options)
    if format is None and chosen not in ("csv", "wide"):
        notice = (
            f"read as {chosen}, by its name and content; to change this, use "
            f"{option(f'{role}_format')}"
        )
        reading = replace(reading, notices=(notice, *reading.notices))
    return reading


WITHOUT_HEADER = ("motchallenge", "visdrone", "kitti", "tum", "yolo")
"""Text formats that have no header and are guessed from the numbers in their lines."""


def runs_inside(path: str, max_input: float | None = None) -> list[str]:
    """Return the names of the sets of trajectories in a MAT file: ``X``, ``Y{1}``, ``Y{2}``, ...

    Parameters
    ----------
    path : str
        Path of the file.
    max_input : float, optional
        Option of `formats.ReadOptions`.

    Raises
    ------
    InputError
        The file is not a readable MAT file.
    ConfigError
        The package that reads the file is missing.
    """
    from tgospa_eval.formats.loading import unpacked_file
    from tgospa_eval.formats.matlab import names_of_runs

    return names_of_runs(path, unpacked_file(path, max_input), max_input)


@spelled_for(READER)
def read_trajectories(
    path: str | os.PathLike[str],
    *,
    role: str = "truth",
    format: str | None = None,
    columns: tuple[str, ...] | None = None,
    decimal: str = ".",
    on_duplicate: str = "error",
    on_invalid: str = "error",
    boxes: bool = False,
    time: str | None = None,
    classes: tuple[str, ...] | None = None,
    region: str | None = None,
    covariance: bool = True,
    fix_covariance: bool = False,
    missing_covariance: str = "error",
    clouds: bool = False,
    attributes: tuple[str, ...] = (),
    time_offset: float = 0.0,
    time_scale: float = 1.0,
    unit_scale: float = 1.0,
    max_input: float | None = None,
    beside: tuple[str, ...] = (),
) -> Trajectories:
    """Read a file of trajectories: CSV ``id,t,x[,y[,z]]``, Parquet, MOTChallenge and others.

    Rows with the same id and time are particles of one cloud if there is a column ``weight``.
    Covariances that are nearly positive semi-definite are corrected with a warning.

    Parameters
    ----------
    path : path
        The file.
    role : {"truth", "estimate"}
        Role of the file. Column 7 of MOTChallenge is a flag in the truth and a score in results.
    format : str, optional
        One of ``formats.FORMATS``, as for ``--truth-format``; by default it is guessed by name and
        content.
    covariance : bool
        Whether to read covariances from columns ``cov_xx, cov_xy, cov_yy`` or ``std_x, std_y,
        rho_xy``. The distance decides whether they are compared.
    attributes : tuple of str
        Names of further columns to read into `Trajectories.attributes`, if the file has them.
    time_offset, time_scale, unit_scale : float
        Timestamps are multiplied by `time_scale`, then `time_offset` is added. ISO times have an
        offset in seconds and no scale. State columns, covariances and particles are multiplied by
        `unit_scale`. `time` and `region` are in the new units.
    columns, decimal, on_duplicate, on_invalid, boxes, time, classes, region
        Options of `formats.ReadOptions`.
    fix_covariance, missing_covariance, clouds, max_input, beside
        Options of `formats.ReadOptions`.

    Raises
    ------
    InputError
        The file is missing, unreadable or wrong; the message names line and column.
    ConfigError
        An option is not allowed, or the package that reads the format is missing.
    """
    given = locals().copy()  # fields of `ReadOptions` have the same names
    names = [each.name for each in fields(ReadOptions) if each.name in given]
    options = ReadOptions(
        **{name: given[name] for name in names},
        conversion=Conversion(
            time_offset=time_offset, time_scale=time_scale, unit_scale=unit_scale
        ),
    )
    return _read_file(path, options, role, format).warn()
