"""What a user gives of a side, as `Trajectories`; names of distances and solvers as records."""

import os
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from operator import index
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, cast

import numpy as np

from tgospa_eval.distances import DISTANCES, Distance
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.objects import (
    ArrayLike,
    TimedArray,
    empty_like,
    is_timed_array,
    of_array,
    of_mapping,
    of_timed_array,
)
from tgospa_eval.evaluation.stone_soup import Components, TrackLike, of_tracks
from tgospa_eval.formats import ROLES
from tgospa_eval.formats.columns.headers import BOX
from tgospa_eval.solvers import Solver, solver_class
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    import pandas as pd


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


def as_sides(
    truth: TrajectoriesLike,
    estimate: TrajectoriesLike,
    distance: Distance,
    attributes: tuple[str, ...] = (),
    mapping: "Components | None" = None,
) -> tuple[Trajectories, Trajectories]:
    """Both sides as Trajectories, with those attributes that they have.

    Raises
    ------
    ConfigError, InputError
        A side is of no accepted type, or wrong; both count steps, and not as many.
    """
    given = {"truth": truth, "estimate": estimate}
    chosen = _of_each_side(mapping)
    if mapping is not None and not any(_is_tracks(side) for side in given.values()):
        raise ConfigError("mapping is for tracks with state vectors, as those of Stone Soup")
    found: dict[str, Trajectories] = {}
    counted: dict[str, int] = {}
    paths = tuple(os.fsdecode(s) for s in given.values() if isinstance(s, (str, os.PathLike)))
    for name, side in given.items():
        if not _is_empty(side):
            found[name], counts = _as_side(side, name, distance, attributes, chosen[name], paths)
            if counts:
                counted[name] = len(found[name].times)
    if len(set(counted.values())) > 1:
        raise InputError(
            f"truth has {counted['truth']} steps and estimate {counted['estimate']}: arrays "
            "(T, k, d) have the same T; rows of NaN mean that nothing exists at a step, and a pair "
            "(times, array) says when the steps are"
        )
    if not found:
        found["truth"] = Trajectories.from_array(np.zeros((0, 0, len(distance.columns or "xy"))))
    for name, other in (("truth", "estimate"), ("estimate", "truth")):
        if name not in found:
            found[name] = empty_like(found[other])
    return found["truth"], found["estimate"]


def _of_each_side(mapping: "Components | None") -> "dict[str, Sequence[int] | None]":
    """The components of truth and estimate."""
    if mapping is None:
        return {"truth": None, "estimate": None}
    try:
        pair = [[index(item) for item in side] for side in mapping]  # type: ignore[union-attr]
        if len(pair) != 2:
            raise TypeError
    except TypeError:
        try:
            pair = [[index(item) for item in mapping]] * 2  # type: ignore[arg-type]
        except TypeError:
            raise ConfigError(
                f"mapping is {mapping!r}: must be components of both sides, (0, 2), or a pair of "
                "such"
            ) from None
    return dict(zip(("truth", "estimate"), pair, strict=True))


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


def _is_empty(side: object) -> bool:
    """Whether it has no track, and so no columns either."""
    kinds = (Mapping, Set, list, tuple)
    return isinstance(side, kinds) and not len(side)


def as_trajectories(
    side: TrajectoriesLike,
    name: str,
    distance: Distance | None = None,
    attributes: tuple[str, ...] = (),
) -> Trajectories:
    """Any accepted form of one side as Trajectories.

    `name` begins the messages; the distance may prescribe the state columns of tables and arrays,
    and want their covariances or particles. `attributes` are further columns to read.
    """
    return _as_side(side, name, distance, attributes, None)[0]


def _as_side(
    side: TrajectoriesLike,
    name: str,
    distance: Distance | None,
    attributes: tuple[str, ...],
    mapping: "Sequence[int] | None",
    beside: tuple[str, ...] = (),
) -> tuple[Trajectories, bool]:
    """A side as Trajectories, and whether its times are only numbers of steps."""
    columns = None if distance is None else distance.columns
    kinds = () if distance is None else distance.kinds
    if isinstance(side, Trajectories):
        return side, False
    if isinstance(side, (str, os.PathLike)):
        from tgospa_eval.formats import read_trajectories

        return read_trajectories(
            side,
            role=name if name in ROLES else "truth",
            columns=None if columns == BOX else columns,
            boxes=columns == BOX,
            covariance=bool(kinds),
            clouds="cloud" in kinds,
            attributes=attributes,
            beside=beside,
        ), False
    frame = as_frame(side, name)
    if frame is not None:
        from tgospa_eval.formats import ReadOptions
        from tgospa_eval.formats.frames import from_frame

        options = ReadOptions(
            columns=columns,
            covariance=bool(kinds),
            clouds="cloud" in kinds,
            attributes=attributes,
        )
        return from_frame(frame, options, name=name).warn(), False
    if hasattr(side, "__array__"):
        return of_array(side, name, columns), True
    if is_timed_array(side):
        return of_timed_array(cast("tuple[object, ...]", side), name, columns), False
    if isinstance(side, Mapping):
        return of_mapping(side, name, columns)
    if _is_tracks(side):
        tracks = [side] if hasattr(side, "states") else cast("Iterable[TrackLike]", side)
        return of_tracks(tracks, name, columns, mapping, kinds), False
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
