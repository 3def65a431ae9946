"""What a user gives of a side, as `Trajectories`; names of distances and solvers as records."""

import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Set
from operator import index
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeGuard, cast

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.words import more
from tgospa_eval.distances import DISTANCES, Distance
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.objects import (
    ArrayLike,
    TimedArray,
    array_of,
    is_timed_array,
    numbers_of,
    of_array,
    of_mapping,
    of_timed_array,
)
from tgospa_eval.formats import Reading, ReadOptions
from tgospa_eval.formats.arrays import all_compared, array_rows, components, meant, spread_columns
from tgospa_eval.formats.columns.headers import find_roles
from tgospa_eval.formats.rows import Rows
from tgospa_eval.solvers import Solver, solver_class
from tgospa_eval.text import quoted
from tgospa_eval.tracks.step_weights import WeightsByTime, repeated
from tgospa_eval.tracks.trajectories import Trajectories, column_names

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.evaluation.request import EvaluationRequest
    from tgospa_eval.tracks.clouds import Cloud


# -------------------------------------------------------------------------------------------------
# Tracks and ground-truth paths of Stone Soup, by their attributes, as Trajectories.


class TrackLike(Protocol):
    """A track or a ground-truth path of Stone Soup.

    Its states have ``timestamp``, ``state_vector`` or ``mean``, and perhaps ``covar``.
    """

    @property
    def id(self) -> object:
        """What it is called."""

    @property
    def states(self) -> Sequence[Any]:
        """Its states, in order."""


Components: TypeAlias = "Sequence[int] | Sequence[Sequence[int]]"
"""Of state vectors those to compare; for both sides, or a pair of such."""


def rows_of_tracks(
    tracks: Iterable[Any],
    name: str,
    options: ReadOptions,
    columns: tuple[str, ...] | None,
    mapping: Sequence[int] | None,
) -> Rows:
    """Tracks and ground-truth paths of Stone Soup as rows of a table, by their attributes.

    Of several states at one time the last counts, as of ``last_timestamp_generator`` there: an
    update after its prediction. Where covariances are read these are ``covar``, NaN where there is
    none, or the particles that are the columns of ``state_vector``, with their ``weight``.

    Raises
    ------
    ConfigError
        Components are not chosen, or not there.
    InputError
        A state has no time, or is not of numbers; an id is there twice, or some states have
        particles and others covariances.
    """
    import pandas as pd  # here, as below: files do without

    from tgospa_eval.formats.frames import frame_rows

    states = list(_states_of_tracks(tracks, name, options, mapping))
    size = len(states[0][2]) if states else len(mapping or (0,))
    other = next((state for state in states if len(state[2]) != size), None)
    if other is not None:
        raise InputError(
            f"{name}: id {quoted(other[0])}, t {other[1]} has {len(other[2])} components, the "
            f"first state {size}; choose the same by mapping=(0, 2)"
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
                f"{name}: id {quoted(spread[0])}, t {spread[1]} has a covariance, other states "
                "have particles; all have the one or the other"
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
"""Id, time, mean, particles and covariance; one particle where there are none."""


def _states_of_tracks(
    tracks: Iterable[Any], name: str, options: ReadOptions, mapping: Sequence[int] | None
) -> Iterator[State]:
    """States track by track."""
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
            cloud, spread = (mean[None], np.ones(1)), getattr(state, "covar", None)
            if options.covariance and np.size(getattr(state, "state_vector", vector)) > size:
                cloud, spread = _cloud(state, chosen, where), None
            elif not options.covariance or spread is None:
                spread = None
            else:
                spread = numbers_of(spread, where)
                if spread.shape != (size, size):
                    raise InputError(
                        f"{where}, t {moment}: covar is {spread.shape}; must be {(size, size)}"
                    )
                spread = spread[chosen][:, chosen]
            yield text, moment, mean, cloud, spread


def _cloud(state: Any, chosen: list[int], where: str) -> "Cloud":
    """Particles of a state (N, d) and their weights; one where it is a point."""
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
    """A table of Polars, pyarrow, DuckDB and others: it hands out its columns by Arrow."""

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Columns as an Arrow stream."""


TrajectoriesLike: TypeAlias = (
    "Trajectories | pd.DataFrame | ArrowTable | ArrayLike | TimedArray | "
    "Mapping[Any, ArrayLike | TimedArray] | Iterable[TrackLike] | str | os.PathLike[str]"
)
"""What a side may be: Trajectories, a table in the long form, a path, an array (T, k, d) or such
with its times, arrays by id, tracks of Stone Soup."""


def is_path(side: object) -> TypeGuard["str | os.PathLike[str]"]:
    """Whether it is the path of a file."""
    return isinstance(side, (str, os.PathLike))


def check_as_long(given: Sequence[object], sides: Sequence[Reading], names: Sequence[str]) -> None:
    """Whether sides that only count their steps have as many; `names` are for messages.

    Raises
    ------
    InputError
        They do not.
    """
    counted = [
        len(read.trajectories.times)
        for side, read in zip(given, sides, strict=True)
        if not is_empty(side) and len(read.trajectories.times) and _counts_steps(side)
    ]
    if len(set(counted)) > 1:
        raise InputError(
            f"{names[0]} has {counted[0]} steps and {names[1]} {counted[1]}: arrays "
            "(T, k, d) have the same T; rows of NaN mean that nothing exists at a step, and a pair "
            "(times, array) says when the steps are"
        )


def filled(sides: Sequence[Reading | None], distance: Distance) -> tuple[Reading, ...]:
    """Sides without any track have the columns of the other."""
    found = tuple(side for side in sides if side is not None)
    if len(found) == len(sides):
        return found
    if found:
        there = found[0].trajectories
    else:
        there = Trajectories.from_array(np.zeros((0, 0, len(distance.columns or "xy"))))
    nothing = Trajectories.of_times(there.times[:0], there.columns, there.clock)
    empty = Reading(trajectories=nothing, rows=0, format="")
    return tuple(empty if side is None else side for side in sides)


def components_of(
    given: Sequence[object], mapping: "Components | None"
) -> "list[Sequence[int] | None]":
    """Of state vectors those to compare, of each side.

    Raises
    ------
    ConfigError
        They are no components, or no side has state vectors.
    """
    if mapping is None:
        return [None] * len(given)
    if all(is_path(s) or isinstance(s, Trajectories) or hasattr(s, "columns") for s in given):
        raise ConfigError("mapping is for tracks and arrays; of files and tables choose columns")
    try:
        whole: list[Any] = list(mapping)
        is_pair = len(whole) == 2 and all(isinstance(side, Iterable) for side in whole)
        pair = whole if is_pair else (whole, whole)
        return [[index(item) for item in side] for side in pair]
    except TypeError:
        raise ConfigError(
            f"mapping is {mapping!r}: must be components of both sides, (0, 2), or a pair of such"
        ) from None


def _is_tracks(side: object) -> bool:
    """Whether it is a set of tracks of Stone Soup, or one of them."""
    if hasattr(side, "states"):
        return True
    if not isinstance(side, Collection) or isinstance(side, (str, Mapping, Trajectories)):
        return False
    return (
        len(side) > 0
        and not hasattr(side, "__array__")
        and all(hasattr(item, "states") for item in side)
    )


def is_empty(side: object) -> bool:
    """Whether it has no track, and so no columns either."""
    kinds = (Mapping, Set, list, tuple)
    return isinstance(side, kinds) and not len(side)


def _counts_steps(side: object) -> bool:
    """Whether its times are only numbers of steps."""
    if isinstance(side, Mapping):
        is_timed = any(isinstance(value, tuple) for value in side.values())
        return not (is_timed or (is_variables(side) and any(meant(k)[0] == "t" for k in side)))
    return hasattr(side, "__array__") and as_frame(side, "") is None


def is_variables(side: object) -> bool:
    """Whether it is a mapping from names to arrays by step and track."""
    return isinstance(side, Mapping) and any(
        isinstance(key, str) and meant(key)[0] in ("x", "particles") and np.ndim(value) > 2
        for key, value in side.items()
        if hasattr(value, "ndim")
    )


def has_rows(side: object) -> bool:
    """Whether it is read row by row, as a table."""
    return _is_tracks(side) or is_variables(side)


def rows_of(
    side: object,
    name: str,
    options: ReadOptions,
    columns: tuple[str, ...] | None,
    mapping: "Sequence[int] | None",
) -> Rows | None:
    """Tracks of Stone Soup and arrays as rows of a table; None of what is neither.

    `name` begins the messages; `columns` are what the distance prescribes, if it does.

    Raises
    ------
    ConfigError, InputError
        It is wrong.
    """
    if _is_tracks(side):
        tracks = [side] if hasattr(side, "states") else cast("Iterable[TrackLike]", side)
        return rows_of_tracks(tracks, name, options, columns, mapping)
    if is_timed_array(side):
        times, states = cast("tuple[Any, Any]", side)
        side = {"t": list(times), "x": states}
    elif hasattr(side, "__array__"):
        side = {"x": side}
    elif not is_variables(side):
        return None
    arrays = {k: array_of(v, f"{name}, {k}") for k, v in cast("Mapping[str, Any]", side).items()}
    return array_rows(name, arrays, options, names=columns, chosen=mapping)


def of_object(
    side: TrajectoriesLike,
    name: str,
    request: "EvaluationRequest",
    mapping: "Sequence[int] | None" = None,
) -> Reading:
    """What is read as a whole: Trajectories, arrays and mappings from id to array.

    `name` begins the messages; the request may prescribe the state columns.

    Raises
    ------
    ConfigError, InputError
        It is of no accepted type, or wrong.
    """
    columns = request.distance.columns
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
            "(pandas, Polars or another that Arrow knows), an array (T, k, d) or a pair of times "
            "and such, a mapping from id to array, a set of tracks with states, or a path"
        )
    is_chosen = mapping is not None or made.columns == columns or len(made.columns) <= 3
    warnings = () if is_chosen else (all_compared(made.columns),)
    return Reading(trajectories=made, rows=len(made.step), format="", warnings=warnings)


def _picked(side: Any, mapping: Sequence[int], name: str) -> Any:
    """Some components of arrays, of pairs with times, or of such by id."""
    if isinstance(side, Mapping):
        return {key: _picked(value, mapping, name) for key, value in side.items()}
    if isinstance(side, tuple) and len(side) == 2:
        return side[0], _picked(side[1], mapping, name)
    array = array_of(side, name)
    return array[..., components(mapping, array.shape[-1] if array.ndim else 0, name)]


def as_frame(side: object, name: str) -> "pd.DataFrame | None":
    """A table of pandas as it is, another one by Arrow; None of what is no table."""
    if hasattr(side, "iloc") and hasattr(side, "columns"):
        return cast("pd.DataFrame", side)
    if not hasattr(side, "__arrow_c_stream__"):
        return None
    try:
        import pyarrow as pa  # here: the extra may be missing, and pandas does without
    except ModuleNotFoundError:
        raise ConfigError(
            f"{name}: tables that are not of pandas need the extra parquet: "
            "pip install 'tgospa-eval[parquet]'"
        ) from None
    try:
        frame: pd.DataFrame = pa.table(side).to_pandas()
    except (pa.ArrowException, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: no table that pandas can hold: {error}") from None
    return frame


def as_solver(solver: str | Solver) -> Solver:
    """A record of settings, of a name that with the default ones."""
    if isinstance(solver, str):
        return solver_class(solver)()
    if isinstance(solver, type) or not isinstance(solver, Solver):
        raise ConfigError(f"solver is {solver!r}: must be a name or a record such as Certified()")
    return solver


def as_distance(distance: str | Distance | None) -> Distance:
    """A record of settings, of a name that with the default ones; euclidean if none is chosen."""
    if isinstance(distance, Distance):
        return distance
    return DISTANCES.ours("euclidean") if distance is None else DISTANCES.chosen(distance)


# -------------------------------------------------------------------------------------------------
# What a Python user gives as weights of steps, as `WeightsByTime`.

StepWeightsLike: TypeAlias = (
    "Mapping[object, float] | pd.Series[float] | pd.DataFrame | ArrowTable | Floats | str | "
    "os.PathLike[str]"
)
"""Time to weight, a table ``t, weight[, switch_weight]``, an array (T,), a path."""

GIVEN = "step_weights"


def as_step_weights(given: "StepWeightsLike | None", decimal: str = ".") -> WeightsByTime | None:
    """Any accepted form of the weights of steps; `decimal` is the mark in a file.

    Raises
    ------
    ConfigError
        It is of no accepted type.
    InputError
        A time or a weight is none, or a time is there twice.
    """
    if given is None:
        return None
    if is_path(given):
        from tgospa_eval.formats.text.small import read_step_weights

        return read_step_weights(os.fspath(given), decimal)
    import pandas as pd  # here: files do without

    if isinstance(given, pd.Series):  # by its index, as a mapping
        given = dict(given.items())
    frame = as_frame(given, GIVEN)
    if frame is None and isinstance(given, Mapping):
        frame = pd.DataFrame({"t": list(given.keys()), "weight": list(given.values())})
    if frame is None and isinstance(given, (np.ndarray, list, tuple)):
        if np.ndim(given) != 1:
            raise InputError(
                f"{GIVEN}: an array of shape {np.shape(given)}; one weight a step, (T,)"
            )
        frame = pd.DataFrame({"t": np.arange(len(given)), "weight": given})
    if frame is None:
        raise ConfigError(
            f"{GIVEN} is of the type {type(given).__name__}: must be a mapping from time to "
            "weight, a table with the columns t and weight, an array (T,) or a path"
        )
    return _of_frame(frame)


def _of_frame(frame: "pd.DataFrame") -> WeightsByTime:
    """A table ``t, weight[, switch_weight]``."""
    from tgospa_eval.formats.frames import frame_times

    columns = {str(name): frame[name] for name in frame.columns}
    missing = [name for name in ("t", "weight") if name not in columns]
    if missing:
        raise InputError(f"{GIVEN}: no column {missing[0]}; it has t, weight and switch_weight")
    times = frame_times(columns["t"], GIVEN)
    again = repeated(times.value)
    if again is not None:
        row, _, count = again
        shown = columns["t"].iloc[row]
        raise InputError(f"{GIVEN}, row {row}: t = {shown} is there twice{more(count)}")
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
