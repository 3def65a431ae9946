"""What a user gives of a side, as `Trajectories`; names of distances and solvers as records."""

import os
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from operator import index
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeGuard, cast

import numpy as np

from tgospa_eval.common.words import more
from tgospa_eval.distances import DISTANCES, Distance
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.objects import (
    ArrayLike,
    TimedArray,
    from_rows,
    is_timed_array,
    numbers_of,
    of_array,
    of_mapping,
    of_timed_array,
    times_of,
)
from tgospa_eval.formats import Reading
from tgospa_eval.problem.problem import Floats
from tgospa_eval.solvers import Solver, solver_class
from tgospa_eval.text import quoted
from tgospa_eval.tracks.step_weights import WeightsByTime, repeated
from tgospa_eval.tracks.trajectories import Trajectories

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


def of_tracks(
    tracks: Iterable[Any],
    name: str,
    columns: tuple[str, ...] | None,
    mapping: Sequence[int] | None,
    kinds: tuple[str, ...],
) -> Trajectories:
    """Tracks and ground-truth paths of Stone Soup, by their attributes.

    Of several states at one time the last counts, as of ``last_timestamp_generator`` there: an
    update after its prediction. What `kinds` names of ``"gaussian"`` and ``"cloud"`` is read:
    ``covar``, or the particles that are the columns of ``state_vector``, with their ``weight``.

    Raises
    ------
    ConfigError
        Components are not chosen, or not there.
    InputError
        A state has no time, or is not of numbers; an id is there twice.
    """
    ids, track, times, states, covariances, clouds = [], [], [], [], [], []
    for number, path in enumerate(tracks):
        ids.append(getattr(path, "id", number))
        where = f"{name}, track {quoted(ids[-1])}"
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
            chosen = _components(mapping, np.size(vector), name)
            track.append(number)
            times.append(moment)
            states.append(numbers_of(vector, where).ravel()[chosen])
            if "cloud" in kinds:
                clouds.append(_cloud(state, chosen, where))
            spread = getattr(state, "covar", None) if "gaussian" in kinds else None
            if spread is not None:
                covariances.append(numbers_of(spread, where)[np.ix_(chosen, chosen)])
    if covariances and len(covariances) < len(states):
        raise InputError(f"{name}: some states have a covariance and others not; all or none")
    spreads: Floats | list[Cloud] | None = np.array(covariances) if covariances else None
    if any(len(points) > 1 for points, _ in clouds):
        spreads = clouds
    size = len(states[0]) if states else len(mapping or (0,))
    return from_rows(
        name,
        ids,
        (np.arange(len(track)), np.array(track, np.int64)),
        np.array(states, np.float64).reshape(-1, size),
        times_of(times, name),
        columns,
        spreads,
    )


def _cloud(state: Any, chosen: list[int], where: str) -> "Cloud":
    """Particles of a state (N, d) and their weights; one where it is a point."""
    points = numbers_of(state.state_vector, where)
    points = points.reshape(len(points), -1)[chosen].T
    weights = getattr(state, "weight", None)
    if weights is None:
        return points, np.full(len(points), 1 / len(points))
    weights = numbers_of(weights, where).ravel()
    if len(weights) != len(points) or not (weights >= 0).all() or not weights.sum() > 0:
        raise InputError(
            f"{where}: {len(points)} particles and {len(weights)} weights; one for each, >= 0 and "
            "not all 0"
        )
    return points, weights / weights.sum()


def _components(mapping: Sequence[int] | None, size: int, name: str) -> list[int]:
    """Which components of state vectors of a size are compared."""
    if mapping is None:
        if size == 1:
            return [0]
        raise ConfigError(
            f"{name}: state vectors have {size} components, and do not say which are the position; "
            "choose those to compare, mapping=(0, 2) for x and y of (x, vx, y, vy)"
        )
    chosen = list(mapping)
    if not chosen or len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(size)):
        raise ConfigError(
            f"mapping is {tuple(mapping)}: must be different components of the state vectors of "
            f"{name}, from 0 to {size - 1}"
        )
    return chosen


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
    return isinstance(side, str | os.PathLike)


def check_as_long(given: Sequence[object], sides: Sequence[Reading]) -> None:
    """Whether sides that only count their steps have as many.

    Raises
    ------
    InputError
        They do not.
    """
    counted = [
        len(read.trajectories.times)
        for side, read in zip(given, sides, strict=True)
        if not is_empty(side) and _counts_steps(side)
    ]
    if len(set(counted)) > 1:
        raise InputError(
            f"truth has {counted[0]} steps and estimate {counted[1]}: arrays "
            "(T, k, d) have the same T; rows of NaN mean that nothing exists at a step, and a pair "
            "(times, array) says when the steps are"
        )


def filled(sides: Sequence[Reading | None], distance: Distance) -> tuple[Reading, ...]:
    """Sides without any track have the columns of the other."""
    there = next((side.trajectories for side in sides if side is not None), None)
    if there is None:
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
        return [None, None]
    if not any(map(_is_tracks, given)):
        raise ConfigError("mapping is for tracks with state vectors, as those of Stone Soup")
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
        return not any(isinstance(value, tuple) for value in side.values())
    return hasattr(side, "__array__") and as_frame(side, "") is None


def of_object(
    side: TrajectoriesLike,
    name: str,
    request: "EvaluationRequest",
    mapping: "Sequence[int] | None" = None,
) -> Trajectories:
    """What is neither file nor table, as Trajectories.

    `name` begins the messages; the request may prescribe the state columns, and want covariances
    or particles.

    Raises
    ------
    ConfigError, InputError
        It is of no accepted type, or wrong.
    """
    columns = request.distance.columns
    if isinstance(side, Trajectories):
        return side
    if hasattr(side, "__array__"):
        return of_array(side, name, columns)
    if is_timed_array(side):
        return of_timed_array(cast("tuple[object, ...]", side), name, columns)
    if isinstance(side, Mapping):
        return of_mapping(side, name, columns)
    if _is_tracks(side):
        tracks = [side] if hasattr(side, "states") else cast("Iterable[TrackLike]", side)
        return of_tracks(tracks, name, columns, mapping, request.kinds)
    lazy = "call its collect() first; it " if type(side).__name__ == "LazyFrame" else ""
    raise ConfigError(
        f"{name} is of the type {type(side).__name__}: {lazy}must be Trajectories, a DataFrame "
        "(pandas, Polars or another that Arrow knows), an array (T, k, d) or a pair of times and "
        "such, a mapping from id to array, a set of tracks with states, or a path"
    )


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


def as_distance(distance: str | Distance) -> Distance:
    """A record of settings, of a name that with the default ones."""
    if isinstance(distance, Distance):
        return distance
    if not isinstance(distance, str) or distance not in DISTANCES:
        raise ConfigError(f"no distance {quoted(distance)}; there are {', '.join(DISTANCES)}")
    return DISTANCES[distance]


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
