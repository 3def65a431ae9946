"""The line itself: trajectories -> near pairs -> problem -> solution -> proof -> result."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, cast

from tgospa_eval._version import __version__
from tgospa_eval.common.notices import spoken_in_python, warn_user
from tgospa_eval.common.progress import Status, Stopwatch
from tgospa_eval.distances import Distance, Effort
from tgospa_eval.evaluation.diagnosis import look
from tgospa_eval.evaluation.localisation import (
    rounded_coordinates,
    split_localisation,
    within_rounding,
)
from tgospa_eval.evaluation.prepare import Fitted, Prepared, Source, fit, prepare
from tgospa_eval.evaluation.request import (
    EvaluationRequest,
    Sliding,
    chosen_metrics,
    chosen_parameters,
    in_words,
)
from tgospa_eval.evaluation.sides import (
    StepWeightsLike,
    TrajectoriesLike,
    as_distance,
    as_sides,
    as_solver,
    as_step_weights,
    in_units_of_truth,
)
from tgospa_eval.formats.options import parse_steps
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.compiled import KERNEL
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.tgospa import Parameters, check_underflow
from tgospa_eval.results.records import FileInfo, MetricSums, OtherMetrics, SolverRecord, Timings
from tgospa_eval.results.result import Proof, Result
from tgospa_eval.solvers import Solver
from tgospa_eval.tracks.alignment import TimeMatching
from tgospa_eval.tracks.existence import EXISTENCE

if TYPE_CHECKING:
    from tgospa_eval.evaluation.sides import Components
    from tgospa_eval.evaluation.slicing import SliceBy
    from tgospa_eval.solvers.certified import Certified

GAP = 1e-9
"""Relative gap that counts as exact, for solvers that have no setting for it."""


@spoken_in_python(reads=False)
def evaluate(
    truth: "TrajectoriesLike",
    estimate: "TrajectoriesLike",
    cutoff: float | None = None,
    order: float = 2,
    switch_penalty: float | None = None,
    *,
    distance: str | Distance = "euclidean",
    solver: str | Solver = "certified",
    unit: str | None = None,
    time_tolerance: float | str = 0.0,
    grid: str = "union",
    interpolate: str | None = None,
    max_gap: "float | str | Sequence[float | str] | None" = None,
    resample: float | str | None = None,
    steps: str | None = None,
    outage: float | str | None = None,
    time_offset: float = 0.0,
    time_scale: float = 1.0,
    unit_scale: float = 1.0,
    curve: bool = False,
    window: int | str | None = None,
    every: int | str | None = None,
    with_: str | Sequence[str] = (),
    rho: float = 0.5,
    step_weights: "StepWeightsLike | None" = None,
    existence: str = "ignore",
    mapping: "Components | None" = None,
    slices: str | Sequence[str] = (),
) -> Result:
    """TGOSPA between two sets of trajectories, with proven bounds.

    Parameters
    ----------
    truth, estimate : path, Trajectories, DataFrame, array, mapping or set of tracks
        A file, or what `read_trajectories` made of one; a table of pandas, Polars or another that
        Arrow knows, in the long form ``id, t, x[, y[, z]]``; an array or tensor (T, k, d) with NaN
        for absent, or a pair ``(times, array)``; a mapping from id to an array (T, d), or to a
        pair ``(times, array)``; tracks or ground-truth paths of Stone Soup (see `mapping`).
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
    interpolate : {"estimate", "truth"}, optional
        Brings this side to the stamps of the other one: states on the straight line between two of
        a track that are at most `max_gap` apart, in the unit of the stamps, seconds for ISO times.
    max_gap : float, str, or pair of such, optional
        Needed by `interpolate` and `resample`; a pair is of truth and estimate. Durations may be
        texts with a unit where stamps are times: ``"200s"``, ``"20ms"``, ``"2min"``.
    resample : float or str, optional
        A common clock: both sides are interpolated at its multiples, from the truth's first stamp
        to its last. These are the steps, and the horizon.
    steps : str, optional
        ``"FIRST:LAST[:EVERY]"``: exactly these steps, empty ones included, and the horizon.
    outage : float or str, optional
        With the truth interpolated: where no estimate is within c of a truth for longer, the
        truth's own stamps are steps too; five of its median intervals by default, ``"none"`` says
        that it reports only what it sees.
    time_offset, time_scale, unit_scale : float
        The stamps of the estimate are multiplied by `time_scale`, then `time_offset` is added, in
        seconds for ISO times; its states, with covariances and particles, are multiplied by
        `unit_scale`, but for periodic ones.
    curve : bool
        Whether to evaluate the steps up to each step as well, for `Result.curve`.
    window : int or str, optional
        Length of sliding windows that are evaluated as well, for `Result.windows`: steps, or a time
        with a unit, such as ``"30min"``, where stamps are times.
    every : int or str, optional
        From one window to the next, alike, at most `window`; half of it by default.
    with_ : str or sequence of str
        Other metrics to evaluate beside it, for `Result.with_`: ``"hota"``, ``"clear"``,
        ``"identity"`` (these need the extra ``mot``), ``"gospa"``.
    rho : float
        0 < rho < 1: the share of c^p that a false target costs, a missed one costs the rest. Other
        than 1/2 it is the quasi-metric of arXiv 2507.13706: truth and estimate differ.
    step_weights : mapping, DataFrame, array or path, optional
        What each step counts, the time-weighted metric of arXiv 2110.13444: a mapping from time to
        weight; a table with the columns ``t, weight`` and perhaps ``switch_weight``; an array
        (T,), one for each step; or a CSV file. Costs of a step are multiplied by its weight,
        switches into it by its switch weight, which is the same by default.
    existence : {"ignore", "use"}
        Whether states exist with the probabilities of the column, or attribute, ``existence``: the
        probabilistic metric of arXiv 2506.15148, experimental (docs/theory/family.md). A side
        without it exists for certain.
    slices : str or sequence of str
        Attributes to split costs and counts by, for `Result.slices`: a column of either side, or
        ``range``, ``speed``, ``size``, ``density``, ``age``, ``region``, with edges:
        ``"visibility=0:0.5:1"``.
    mapping : sequence of int, or pair of such, optional
        Of tracks with state vectors the components to compare: ``(0, 2)`` for x and y of
        ``(x, vx, y, vy)``; a pair where truth and estimate have theirs in other places.

    Returns
    -------
    Result
        Value, bracket, decomposition, tables.

    Warns
    -----
    TgospaWarning
        Something looks wrong with the data: see `Result.warnings`.

    Raises
    ------
    ConfigError
        A parameter is out of range or a name is unknown.
    InputError
        The two sides do not fit: other columns, other kinds of time, states out of range.
    """
    stopwatch = Stopwatch()
    base = as_distance(distance)
    asked: tuple[SliceBy, ...] = ()
    columns: tuple[str, ...] = ()
    if slices:
        from tgospa_eval.evaluation.slicing import (
            columns_asked,
            parse_slices,
        )  # here: as curve

        asked = parse_slices(slices)
        columns = columns_asked(asked)
    with stopwatch.span("read"):
        if existence == "use":
            columns = (*columns, EXISTENCE)
        sides, recorded = in_units_of_truth(
            as_sides(truth, estimate, base, columns, mapping),
            base,
            time_offset,
            time_scale,
            unit_scale,
        )
    parameters, defaults = chosen_parameters(base, order, cutoff, switch_penalty, rho)
    request = EvaluationRequest(
        parameters=parameters,
        distance=base,
        solver=as_solver(solver),
        time_matching=TimeMatching(
            tolerance=time_tolerance,
            grid=grid,
            interpolate=interpolate,
            max_gap=max_gap,
            resample=resample,
            steps=parse_steps(steps),
            outage=outage,
        ),
        unit=unit,
        curve=curve,
        sliding=Sliding.asked(window, every),
        with_=chosen_metrics(with_),
        recorded=recorded,
        defaults=defaults,
        slices=asked,
        step_weights=as_step_weights(step_weights),
        existence=existence,
    )
    fitted = fit(*sides, request)
    found = look(fitted, request)
    result = evaluate_fitted(fitted, request, stopwatch=stopwatch)
    result = replace(result, warnings=(*found, *result.warnings))
    warn_user(result.warnings)
    return result


def evaluate_fitted(
    sides: Fitted,
    request: EvaluationRequest,
    *,
    files: tuple[FileInfo, FileInfo] | None = None,
    stopwatch: Stopwatch,
) -> Result:
    """`evaluate` with everything resolved.

    Parameters
    ----------
    sides : Fitted
        Truth and estimate, aligned, and their distance.
    request : EvaluationRequest
        Everything else.
    files : pair of FileInfo, optional
        The two files, for the result.
    stopwatch : Stopwatch
        Running clock with the time of reading.
    """
    prepared = prepare(sides, request, files=files, stopwatch=stopwatch)
    others: OtherMetrics = {}
    sums: MetricSums = {}
    if request.with_:
        from tgospa_eval.evaluation.other_metrics import joined, other_metrics  # here: as the curve

        effort = Effort(jobs=request.solver.jobs, stopwatch=stopwatch)
        found = other_metrics(prepared, request.with_, effort)
        others, sums = joined([found]), found.sums()
    cut = None
    if request.slices:
        from tgospa_eval.evaluation.slices import split  # here: as the curve

        with stopwatch.span("slices"):
            cut = split.cut(sides, request.slices, request.parameters.cutoff)
    result = solve(
        prepared, request.solver, stopwatch, curve=request.curve, sliding=request.sliding
    )
    result = replace(result, with_=others, sums=sums, source=Source(sides=sides, request=request))
    if cut is None:
        return result
    with stopwatch.span("slices"):
        sliced = cut.of(result)
    return replace(result, sliced=sliced, timings=nested_timings(stopwatch))


def solve(
    prepared: Prepared,
    solver: Solver,
    stopwatch: Stopwatch,
    *,
    curve: bool = False,
    sliding: Sliding | None = None,
) -> Result:
    """The second half: solution, proof, result; the problem can be solved again."""
    stopwatch.progress.begin(prepared.parameters.root)
    solution = solver(prepared.states, stopwatch)
    return prove(prepared, solver, solution, stopwatch, curve=curve, sliding=sliding)


def prove(
    prepared: Prepared,
    solver: Solver,
    solution: Solution,
    stopwatch: Stopwatch,
    *,
    curve: bool = False,
    sliding: Sliding | None = None,
) -> Result:
    """What a solution proves of a problem; a disposable one loses its weights."""
    with stopwatch.span("certify"):
        bounds, weights, breakdown = certify(prepared.states, solution, consume=solution.disposable)
    check_underflow(prepared.states.problem, prepared.parameters, bounds.upper)
    proof = Proof(
        parameters=prepared.parameters,
        states=prepared.states,
        bounds=bounds,
        weights=weights,
        breakdown=breakdown,
        prices=solution.prices,
        reduced=solution.reduced,
        compared=prepared.compared,
    )
    traced = slid = None
    whole = (prepared.states, weights, solution.prices, cast("Certified", solver))
    known = solution.reduced, stopwatch.progress
    if curve:
        from tgospa_eval.evaluation.curve import trace  # here: only when it is asked for

        with stopwatch.span("curve"):
            traced = trace(*whole, *known)
    if sliding is not None:
        from tgospa_eval.evaluation.curve import slide  # here: only when it is asked for

        with stopwatch.span("windows"):
            slid = slide(*whole, sliding.spans(prepared.moments), *known)
            slid = replace(
                slid,
                size=sliding.shown(prepared.states.problem.steps),
                every=in_words(sliding.every),
            )
    with stopwatch.span("report"):
        split = split_localisation(prepared, proof)
    gap = solver.gap if solver.proves else GAP
    return Result(
        proof=proof,
        split=split,
        traced=traced,
        slid=slid,
        labels=prepared.labels,
        gap=gap,
        settings={**prepared.settings, **solver_settings(solver)},
        solver=_solver_record(solver, solution, prepared.parameters, met=bounds.met(gap)),
        timings=nested_timings(stopwatch),
        input=prepared.input,
        judged_on=prepared.judged,
        version=__version__,
        scene=prepared.scene,
        warnings=(*within_rounding(bounds, gap), *rounded_coordinates(prepared, proof)),
    )


def _solver_record(
    solver: Solver, solution: Solution, parameters: Parameters, *, met: bool
) -> SolverRecord:
    """The record of the solver for the result; the bracket of its history as costs."""
    finished, status = solution.finished, solution.sentence
    if met != finished and (met or solver.proves):
        # The proof knows better than the solver.
        finished, status = met, str(Status.SOLVED if met else Status.NOT_SOLVED)
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


def solver_settings(solver: Solver) -> dict[str, object]:
    """The settings of a solver that change the number."""
    changing = {
        name: value for name, value in vars(solver).items() if value is not None and name != "jobs"
    }
    return {"solver": solver.name, **changing}


def nested_timings(stopwatch: Stopwatch) -> Timings:
    """Spans as a tree, with the names that are always there."""
    timings = {"read": 0.0, "distances": 0.0, "certify": 0.0, "report": 0.0}
    solve = {"preparation": 0.0, "sweeps": 0.0, "lp": 0.0}
    for name, seconds in stopwatch.spans.items():
        stage, _, part = name.partition("/")
        if part:
            solve[part] = seconds
        else:
            timings[stage] = seconds
    if stopwatch.work:
        timings["nanoseconds_per_state"] = stopwatch.nanoseconds
    return cast("Timings", {**timings, "solve": solve, "total": stopwatch.elapsed()})
