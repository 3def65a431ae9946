"""Before any solver: from what a user gives to two sides on one grid, near pairs, the problem."""

import hashlib
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.distances import DISTANCES, Distance, Effort, Pairs, near_pairs
from tgospa_eval.distances.checks import check_columns, check_states
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import ROLES
from tgospa_eval.formats.asked import BOX
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.problem import Floats, Parameters, Problem, tgospa_problem
from tgospa_eval.problem.states import States
from tgospa_eval.results.result import Scene, sizes_of
from tgospa_eval.results.summary import Labels
from tgospa_eval.solvers import Solver, solver_class
from tgospa_eval.text import quoted
from tgospa_eval.tracks.alignment import Alignment, Stamps, align
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """A problem that waits for a solver: what all solvers have in common.

    Parameters
    ----------
    parameters : Parameters
        Cutoff, order and switch penalty.
    sides : pair of Trajectories
        Truth and estimate, aligned and prepared.
    distance : Distance
        Base distance, prepared.
    states : States
        The reduced problem.
    labels : Labels
        Times and ids.
    moments : (T,) int or float array
        The times as numbers.
    settings : dict
        Every option that changes the number, but for those of the solver.
    input : dict
        Rows and digest of either side.
    scene : Scene
        Where the objects were before the distance prepared them, for pictures.
    """

    parameters: Parameters
    sides: tuple[Trajectories, Trajectories]
    distance: Distance
    states: States
    labels: Labels
    moments: NDArray[Any]
    settings: dict[str, Any]
    input: dict[str, Any]
    scene: Scene

    @property
    def sizes(self) -> dict[str, int]:
        """Numbers of trajectories, steps, near pairs, their steps, and components."""
        return sizes_of(self.states)


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """Two sides that are compared: what problems with other parameters have in common.

    Parameters
    ----------
    sides, distance, labels, moments, settings, input, scene
        As of `Prepared`, `settings` without the parameters.
    """

    sides: tuple[Trajectories, Trajectories]
    distance: Distance
    labels: Labels
    moments: NDArray[Any]
    settings: dict[str, Any]
    input: dict[str, Any]
    scene: Scene

    def problem(self, pairs: Pairs, parameters: Parameters) -> Problem:
        """The problem of pairs that include all nearer than the cutoff."""
        truth, estimate = self.sides
        return tgospa_problem(
            parameters=parameters,
            steps=len(truth.times),
            truths=len(truth.ids),
            estimates=len(estimate.ids),
            truth_step=truth.step,
            truth_track=truth.track,
            estimate_step=estimate.step,
            estimate_track=estimate.track,
            truth_row=pairs.truth_row,
            estimate_row=pairs.estimate_row,
            distance=pairs.distance,
            distance_error=self.distance.error(truth.state.shape[1]),
            last_place=self.distance.last_place(truth, estimate),
        )

    def prepared(self, states: States, parameters: Parameters) -> Prepared:
        """With the reduced problem, ready for a solver."""
        return Prepared(
            **{
                **vars(self),
                "parameters": parameters,
                "states": states,
                "settings": {**vars(parameters), **self.settings},
            }
        )


def prepare(
    truth: Trajectories,
    estimate: Trajectories,
    *,
    parameters: Parameters,
    distance: str | Distance,
    stamps: Stamps | None = None,
    unit: str | None = None,
    settings: dict[str, Any] | None = None,
    inputs: tuple[dict[str, Any], dict[str, Any]] | None = None,
    stopwatch: Stopwatch,
    jobs: int | None = None,
) -> Prepared:
    """The first half of `evaluate_trajectories`: all before the solver, in so many threads."""
    measured, pairs = measure(
        truth,
        estimate,
        cutoff=parameters.cutoff,
        distance=distance,
        stamps=stamps,
        unit=unit,
        settings=settings,
        inputs=inputs,
        stopwatch=stopwatch,
        jobs=jobs,
    )
    with stopwatch.span("solve/preparation"):
        problem = measured.problem(pairs, parameters)
        del pairs  # the distances are as long as the entries
        states = merge_runs(problem)
    return measured.prepared(states, parameters)


def measure(
    truth: Trajectories,
    estimate: Trajectories,
    *,
    cutoff: float,
    distance: str | Distance,
    stamps: Stamps | None = None,
    unit: str | None = None,
    settings: dict[str, Any] | None = None,
    inputs: tuple[dict[str, Any], dict[str, Any]] | None = None,
    stopwatch: Stopwatch,
    jobs: int | None = None,
) -> tuple[Measured, Pairs]:
    """Both sides as they are compared, and all pairs nearer than the cutoff."""
    stamps = stamps or Stamps()
    chosen = as_distance(distance)
    check_columns(truth, estimate)
    check_states(truth, estimate, chosen)
    # What is digested is what counts.
    truth, estimate = (side.seen_as(chosen.kinds) for side in (truth, estimate))
    with stopwatch.span("report"):
        told = inputs or ({"rows": len(truth.step)}, {"rows": len(estimate.step)})
        digests = digest(truth), digest(estimate)
    with stopwatch.span("distances"):
        aligned = align(truth, estimate, stamps)
        truth, estimate = aligned.truth, aligned.estimate
        scene = _scene(truth, estimate)
        chosen = chosen.fitted(truth, estimate)
        effort = Effort(jobs=jobs, stopwatch=stopwatch)
        truth, estimate, prepared = chosen.prepared(truth, estimate, effort)
        pairs = near_pairs(truth, estimate, cutoff, prepared, effort)
    measured = Measured(
        sides=(truth, estimate),
        distance=prepared,
        labels=Labels(
            times=truth.shown.tolist(),
            truths=truth.ids.tolist(),
            estimates=estimate.ids.tolist(),
            unit=unit,
        ),
        moments=truth.times,
        settings={
            "distance": chosen.name,
            **chosen.settings(truth.columns),
            "columns": list(truth.columns),
            "grid": stamps.grid,
            "time_tolerance": stamps.tolerance,
            "unit": unit,
            **(settings or {}),
        },
        input={
            name: {
                **told[side],
                "sha256": digests[side],
                "left_out": told[side].get("left_out", {})
                | ({"grid": aligned.left_out[side]} if aligned.left_out[side] else {}),
            }
            for side, name in enumerate(("truth", "estimate"))
        },
        scene=scene,
    )
    return measured, pairs


def fit(
    truth: Trajectories,
    estimate: Trajectories,
    distance: Distance,
    stamps: Stamps,
    names: tuple[str, str] = ("truth", "estimate"),
) -> tuple[Distance, Alignment]:
    """The distance with what it takes from the data, and both sides on the same steps.

    Raises
    ------
    ConfigError, InputError
        Columns, states or times do not fit each other or the distance; `names` are for messages.
    """
    check_columns(truth, estimate, names)
    check_states(truth, estimate, distance, names)
    aligned = align(truth, estimate, stamps, names)
    if aligned.union and not len(aligned.truth.times):
        raise ConfigError(
            f"--grid {stamps.grid}: no step is left, none of {aligned.union:,} counts; if the "
            "clocks differ, see --time-tolerance"
        )
    return distance.fitted(aligned.truth, aligned.estimate), aligned


def _scene(truth: Trajectories, estimate: Trajectories) -> Scene:
    """What pictures show: states as they were read, not as a distance scales or whitens them."""
    return Scene(
        columns=truth.columns,
        truth=truth.state,
        estimate=estimate.state,
        truth_covariance=_second_moments(truth),
        estimate_covariance=_second_moments(estimate),
    )


def _second_moments(side: Trajectories) -> Floats | None:
    """Lower triangles of what is around each state, if anything is."""
    if side.clouds is None:
        return side.covariance
    from tgospa_eval.tracks.covariances import pack  # here: points do without

    with np.errstate(over="ignore", invalid="ignore"):  # no picture needs those
        return pack(side.clouds.covariances).T


def digest(side: Trajectories) -> str:
    """SHA-256 of what takes part: columns, ids, times, rows, states, covariances or particles."""
    sha = hashlib.sha256()
    for texts in (side.columns, side.ids.tolist()):
        sha.update(repr(list(texts)).encode())
    arrays = [_whole(side.times)[side.step], side.track, side.state]
    arrays += side.beside
    for array in arrays:
        kind = "<i8" if array.dtype.kind == "i" else "<f8"
        sha.update(kind.encode())
        sha.update(np.ascontiguousarray(array, dtype=kind).data)
    return sha.hexdigest()


def _whole(times: NDArray[Any]) -> NDArray[Any]:
    """Times as integers where all are whole: the stamps 0 and 0.0 are the same."""
    if times.dtype.kind != "f" or not np.all((np.floor(times) == times) & (abs(times) < 2.0**63)):
        return times
    return times.astype(np.int64)


def as_sides(
    truth: TrajectoriesLike, estimate: TrajectoriesLike, distance: Distance
) -> tuple[Trajectories, Trajectories]:
    """Both sides as Trajectories.

    Raises
    ------
    ConfigError, InputError
        A side is of another type, or wrong; arrays have different numbers of steps.
    """
    if isinstance(truth, np.ndarray) and isinstance(estimate, np.ndarray):
        steps = truth.shape[:1], estimate.shape[:1]
        if truth.ndim == estimate.ndim == 3 and steps[0] != steps[1]:
            raise InputError(
                f"truth has {steps[0][0]} steps and estimate {steps[1][0]}: arrays (T, k, d) have "
                "the same T; rows of NaN mean that nothing exists at a step"
            )
    return as_trajectories(truth, "truth", distance), as_trajectories(
        estimate, "estimate", distance
    )


def as_trajectories(
    side: TrajectoriesLike,
    name: str,
    distance: Distance | None = None,
) -> Trajectories:
    """Any accepted form of one side as Trajectories.

    `name` begins the messages; the distance may prescribe the state columns of tables and arrays,
    and want their covariances or particles.
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
        )
    frame = _as_frame(side, name)
    if frame is not None:
        from tgospa_eval.formats import ReadOptions
        from tgospa_eval.formats.frames import from_frame

        options = ReadOptions(columns=columns, covariance=bool(kinds), clouds="cloud" in kinds)
        return from_frame(frame, options, name=name).warn()
    lazy = "call its collect() first; it " if type(side).__name__ == "LazyFrame" else ""
    raise ConfigError(
        f"{name} is of the type {type(side).__name__}: {lazy}must be Trajectories, a DataFrame "
        "(pandas, Polars or another that Arrow knows), an array (T, k, d) or a path"
    )


def _as_frame(side: Any, name: str) -> "pd.DataFrame | None":
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
    if isinstance(solver, type) or not callable(solver) or not hasattr(solver, "name"):
        raise ConfigError(f"solver is {solver!r}: must be a name or a record such as Certified()")
    return solver


def as_distance(distance: str | Distance) -> Distance:
    """A record of settings, of a name that with the default ones."""
    if isinstance(distance, Distance):
        return distance
    if not isinstance(distance, str) or distance not in DISTANCES:
        raise ConfigError(f"no distance {quoted(distance)}; there are {', '.join(DISTANCES)}")
    return DISTANCES[distance]
