"""The line itself: trajectories -> near pairs -> problem -> solution -> proof -> result."""

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval import __version__
from tgospa_eval.alignment import Stamps, align
from tgospa_eval.compiled import KERNEL
from tgospa_eval.covariances import pack
from tgospa_eval.distances import DISTANCES, Distance, Effort, Pairs, near_pairs
from tgospa_eval.distances.checks import check_columns, check_states
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation import Labels, Proof, Result, Scene, sizes_of
from tgospa_eval.merging import merge_runs
from tgospa_eval.problem import Floats, Parameters, Problem, tgospa_problem
from tgospa_eval.result import Solution, certify
from tgospa_eval.solvers import Solver, solver_class
from tgospa_eval.states import States
from tgospa_eval.timing import Stopwatch
from tgospa_eval.trajectories import Trajectories
from tgospa_eval.weights import ONE

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.solvers.certified import Certified

BLOCK = 1 << 16
"""Pairs whose distances are taken apart at a time."""

GAP = 1e-9
"""Relative gap that counts as exact, for solvers that have no setting for it."""


def evaluate(
    truth: "Trajectories | pd.DataFrame | Floats",
    estimate: "Trajectories | pd.DataFrame | Floats",
    cutoff: float | None = None,
    order: float = 2,
    switch_penalty: float | None = None,
    *,
    distance: str | Distance = "euclidean",
    solver: str | Solver = "certified",
    unit: str | None = None,
    time_tolerance: float = 0.0,
    grid: str = "union",
    curve: bool = False,
) -> Result:
    """TGOSPA between two sets of trajectories, with proven bounds.

    Parameters
    ----------
    truth, estimate : Trajectories, DataFrame or array
        As read by `read_trajectories`; in the long form ``id, t, x[, y[, z]]``; or (T, k, d) with
        NaN for absent.
    cutoff : float, optional
        c > 0, in the unit of the distance; 10.0 by default, 0.5 with ``"iou"``.
    order : float
        p >= 1.
    switch_penalty : float, optional
        gamma >= 0, in the unit of the distance; 2.0 by default, 0.5 with ``"iou"``.
    distance : str or Distance
        Base distance: ``"euclidean"``, ``"manhattan"``, ``"chebyshev"``, ``"haversine"``,
        ``"iou"``, ``"gaussian-wasserstein"``, ``"cloud-wasserstein"``, or a record of
        `tgospa_eval.distances` with settings: `Norm`, `Mahalanobis`, `GaussianWasserstein`,
        `CloudWasserstein`. Arrays and DataFrames are taken to have the columns that it needs:
        ``lat, lon`` or ``left, top, width, height``; of DataFrames covariances and particles are
        read if the distance looks at them.
    solver : str or solver record
        ``"certified"``, ``"exact"``, ``"sinkhorn"``, or `Certified`, `Exact`, `Sinkhorn` with
        settings.
    unit : str, optional
        Unit of the states, for printing.
    time_tolerance : float
        Stamps of the two sides that are at most so far apart are one step, where each is the
        other's nearest; in the unit of the stamps, seconds for ISO times. The step bears the stamp
        of the truth.
    grid : {"union", "truth", "estimate", "common"}
        Steps that count. Rows at other steps are left out, and counted in `Result.input`.
    curve : bool
        Whether to evaluate the steps up to each step as well, for `Result.curve`.

    Returns
    -------
    Result
        Value, bracket, decomposition, tables.

    Raises
    ------
    ConfigError
        A parameter is out of range or a name is unknown.
    InputError
        The two sides do not fit: other columns, other kinds of time, states out of range.
    """
    stopwatch = Stopwatch()
    measure = as_distance(distance)
    with stopwatch.span("read"):
        sides = [
            as_trajectories(side, name, measure)
            for side, name in ((truth, "truth"), (estimate, "estimate"))
        ]
    defaults = measure.defaults
    return evaluate_trajectories(
        *sides,
        parameters=Parameters(
            cutoff=defaults[0] if cutoff is None else cutoff,
            order=order,
            switch_penalty=defaults[1] if switch_penalty is None else switch_penalty,
        ),
        distance=measure,
        solver=as_solver(solver),
        stamps=Stamps(tolerance=time_tolerance, grid=grid),
        unit=unit,
        stopwatch=stopwatch,
        curve=curve,
    )


def evaluate_trajectories(
    truth: Trajectories,
    estimate: Trajectories,
    *,
    parameters: Parameters,
    distance: str | Distance,
    solver: Solver,
    stamps: Stamps | None = None,
    unit: str | None = None,
    settings: dict[str, Any] | None = None,
    inputs: tuple[dict[str, Any], dict[str, Any]] | None = None,
    stopwatch: Stopwatch | None = None,
    curve: bool = False,
) -> Result:
    """`evaluate` with everything resolved.

    Parameters
    ----------
    truth, estimate : Trajectories
        The two sides, each on its own times.
    parameters : Parameters
        Cutoff, order and switch penalty.
    distance : str or Distance
        Base distance.
    solver : Solver
        Record of settings.
    stamps : Stamps, optional
        Which stamps are one step, and which steps count.
    unit : str, optional
        For printing.
    settings : dict, optional
        Further options that change the number, recorded in ``parameters``.
    inputs : pair of dict, optional
        What the result says of the two files beside their digests; by default their rows.
    stopwatch : Stopwatch, optional
        Running clock with the time of reading.
    curve : bool
        Whether to evaluate the steps up to each step as well.

    Raises
    ------
    ConfigError, InputError
        As for `evaluate`.
    """
    stopwatch = stopwatch or Stopwatch()
    if curve:
        check_curve(solver)
    prepared = prepare(
        truth,
        estimate,
        parameters=parameters,
        distance=distance,
        stamps=stamps,
        unit=unit,
        settings=settings,
        inputs=inputs,
        stopwatch=stopwatch,
        jobs=getattr(solver, "jobs", None),
    )
    return solve(prepared, solver, stopwatch, curve=curve)


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


def solve(
    prepared: Prepared, solver: Solver, stopwatch: Stopwatch, *, curve: bool = False
) -> Result:
    """The second half: solution, proof, result; the problem can be solved again."""
    return prove(prepared, solver, solver(prepared.states, stopwatch), stopwatch, curve=curve)


def check_curve(solver: Solver) -> None:
    """Only the certified solver solves the steps up to each step.

    Raises
    ------
    ConfigError
        It is another one.
    """
    if solver.name != "certified":
        raise ConfigError(f"the curve needs the solver certified, not {solver.name}")


def prove(
    prepared: Prepared,
    solver: Solver,
    solution: Solution,
    stopwatch: Stopwatch,
    *,
    curve: bool = False,
) -> Result:
    """What a solution proves of a problem; the solution may be used up."""
    prices = solution.prices.copy() if curve else None
    with stopwatch.span("certify"):
        bounds, weights, breakdown = certify(prepared.states, solution)
    proof = Proof(
        parameters=prepared.parameters,
        states=prepared.states,
        bounds=bounds,
        weights=weights,
        breakdown=breakdown,
    )
    traced = None
    if prices is not None:
        from tgospa_eval.curve import trace  # here: only when it is asked for

        with stopwatch.span("curve"):
            traced = trace(prepared.states, weights, prices, cast("Certified", solver))
    truth, estimate = prepared.sides
    with stopwatch.span("report"):
        split = _split(truth, estimate, prepared.distance, proof)
    gap = getattr(solver, "gap", GAP) if solver.name == "certified" else GAP
    return Result(
        proof=proof,
        split=split,
        traced=traced,
        labels=prepared.labels,
        gap=gap,
        settings={**prepared.settings, **solver_settings(solver)},
        solver=_solver_record(solver, solution, prepared.parameters, met=bounds.met(gap)),
        timings=_nested(stopwatch),
        input=prepared.input,
        version=__version__,
        scene=prepared.scene,
    )


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
    with np.errstate(over="ignore", invalid="ignore"):  # no picture needs those
        return pack(side.clouds.covariances).T


def _split(
    truth: Trajectories, estimate: Trajectories, distance: Distance, proof: Proof
) -> tuple[float, float] | None:
    """Cost of localisation by means and by spreads, if the cost is a square and has such parts."""
    if proof.parameters.order != 2:
        return None
    states, problem = proof.states, proof.states.problem
    used = np.flatnonzero((states.entry >= 0) & (proof.weights > 0))
    sums = [0.0, 0.0]
    for begin in range(0, len(used) or 1, BLOCK):
        state = used[begin : begin + BLOCK]
        entry = states.entry[state]
        pairs = Pairs(
            truth_row=problem.truth_row[entry],
            estimate_row=problem.estimate_row[entry],
            distance=proof.parameters.cutoff * np.sqrt(problem.cost[entry]),
        )
        parts = distance.parts(pairs, truth, estimate)
        if parts is None:
            return None
        for k, part in enumerate(parts):
            sums[k] += float((proof.weights[state] / ONE) @ (part * part))
    return sums[0], sums[1]


def _solver_record(
    solver: Solver, solution: Solution, parameters: Parameters, *, met: bool
) -> dict[str, Any]:
    """What the result says of the solver; the bracket of its history as costs."""
    finished, status = solution.finished, solution.status
    if met != finished and (met or solver.name == "certified"):
        # The proof knows better than the solver.
        finished, status = met, "solved" if met else "not solved"
    scale = parameters.cutoff**parameters.order
    return {
        "name": solver.name,
        "status": status,
        "finished": finished,
        "iterations": solution.iterations,
        "kernel": KERNEL,
        "history": [
            {**check, "lower": scale * check["lower"], "upper": scale * check["upper"]}
            for check in solution.history
        ],
    }


def as_trajectories(
    side: "Trajectories | pd.DataFrame | Floats",
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
    if hasattr(side, "columns") and hasattr(side, "iloc"):
        from tgospa_eval.formats import ReadOptions
        from tgospa_eval.formats.frames import from_frame

        kinds = () if distance is None else distance.kinds
        options = ReadOptions(columns=columns, covariance=bool(kinds), clouds="cloud" in kinds)
        return from_frame(side, options, name=name).warn()
    raise ConfigError(
        f"{name} is a {type(side).__name__}: must be Trajectories, a DataFrame or an array"
    )


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


def solver_settings(solver: Solver) -> dict[str, Any]:
    """The settings of a solver that change the number."""
    changing = {
        name: value for name, value in vars(solver).items() if value is not None and name != "jobs"
    }
    return {"solver": solver.name, **changing}


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
        raise ConfigError(f'no distance "{distance}"; there are {", ".join(DISTANCES)}')
    return DISTANCES[distance]


def _nested(stopwatch: Stopwatch) -> dict[str, Any]:
    """Spans as a tree, with the names that are always there."""
    timings: dict[str, Any] = {"read": 0.0, "distances": 0.0, "certify": 0.0, "report": 0.0}
    solve = {"preparation": 0.0, "sweeps": 0.0, "lp": 0.0}
    for name, seconds in stopwatch.spans.items():
        stage, _, part = name.partition("/")
        if part:
            solve[part] = seconds
        else:
            timings[stage] = seconds
    if stopwatch.work:
        timings["nanoseconds_per_state"] = stopwatch.nanoseconds
    return {**timings, "solve": solve, "total": stopwatch.elapsed()}
