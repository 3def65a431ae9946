"""What a user gives of a side, as `Trajectories`; names of distances and solvers as records."""

import os
from typing import TYPE_CHECKING, Protocol, TypeAlias, cast

import numpy as np

from tgospa_eval.distances import DISTANCES, Distance
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import ROLES
from tgospa_eval.formats.columns.asked import BOX
from tgospa_eval.problem.problem import Floats
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
    "Trajectories | pd.DataFrame | ArrowTable | Floats | str | os.PathLike[str]"
)
"""What a side may be: Trajectories, a table in the long form, an array (T, k, d), a path."""


def as_sides(
    truth: TrajectoriesLike,
    estimate: TrajectoriesLike,
    distance: Distance,
    attributes: tuple[str, ...] = (),
) -> tuple[Trajectories, Trajectories]:
    """Both sides as Trajectories, with those attributes that they have.

    Raises
    ------
    ConfigError, InputError
        A side is of no accepted type, or wrong; arrays have different numbers of steps.
    """
    if isinstance(truth, np.ndarray) and isinstance(estimate, np.ndarray):
        steps = truth.shape[:1], estimate.shape[:1]
        if truth.ndim == estimate.ndim == 3 and steps[0] != steps[1]:
            raise InputError(
                f"truth has {steps[0][0]} steps and estimate {steps[1][0]}: arrays (T, k, d) have "
                "the same T; rows of NaN mean that nothing exists at a step"
            )
    return (
        as_trajectories(truth, "truth", distance, attributes),
        as_trajectories(estimate, "estimate", distance, attributes),
    )


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
    columns = None if distance is None else distance.columns
    if isinstance(side, Trajectories):
        return side
    if isinstance(side, np.ndarray):
        fits = columns is not None and side.ndim == 3 and side.shape[2] == len(columns)
        return Trajectories.from_array(side, columns if fits else None)
    kinds = () if distance is None else distance.kinds
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
        )
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
        return from_frame(frame, options, name=name).warn()
    lazy = "call its collect() first; it " if type(side).__name__ == "LazyFrame" else ""
    raise ConfigError(
        f"{name} is of the type {type(side).__name__}: {lazy}must be Trajectories, a DataFrame "
        "(pandas, Polars or another that Arrow knows), an array (T, k, d) or a path"
    )


def as_frame(side: object, name: str) -> "pd.DataFrame | None":
    """A table of pandas as it is, another one by Arrow; None of what is no table."""
    if hasattr(side, "columns") and hasattr(side, "iloc"):
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
