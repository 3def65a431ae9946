"""Steps from a prepared problem to its solution, its proof, and the result of the evaluation.

`pair_parts` divides the localisation cost into parts, such as errors of means and of spreads.
"""

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import replace
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.progress import Status, Stopwatch
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance, Pairs
from tgospa_eval.distances.base import Sides
from tgospa_eval.evaluation.pair import PairEvaluation
from tgospa_eval.evaluation.prepare import PreparedPair
from tgospa_eval.evaluation.request import EvaluationRequest, in_words
from tgospa_eval.kernels import KERNEL
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.metric_family import Parameters, check_underflow
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.solution import Bounds, Solution, read_assigned, read_unjudged
from tgospa_eval.quoting import option
from tgospa_eval.results.consistency import NEES, NeesSums
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import MEAN, SPREAD, Costs, Json, PairProof
from tgospa_eval.solvers import Solver

if TYPE_CHECKING:
    from tgospa_eval.solvers.certified import Certified


E = TypeVar("E", bound=Evaluation)

GAP = 1e-9
"""Relative gap up to which a result counts as exact, if the solver has no setting for it."""


def solve(
    prepared: PreparedPair,
    solver: Solver,
    stopwatch: Stopwatch,
    request: EvaluationRequest | None = None,
) -> PairEvaluation:
    """Solve a prepared problem and return the result; the problem can be solved again."""
    stopwatch.progress.begin(prepared.parameters.root)
    return prove(prepared, solver, solver(prepared.states, stopwatch), stopwatch, request)


def prove(
    prepared: PreparedPair,
    solver: Solver,
    solution: Solution,
    stopwatch: Stopwatch,
    request: EvaluationRequest | None = None,
) -> PairEvaluation:
    """Prove a solution, and return the result.

    If the solution is disposable, the memory of its weights is reused. The curve and the windows
    are computed if they are requested.
    """
    with stopwatch.span("certify"):
        bounds, weights, breakdown = certify(prepared.states, solution, consume=solution.disposable)
    check_underflow(prepared.states.problem, prepared.parameters, bounds.upper)
    proof = PairProof(
        parameters=prepared.parameters,
        states=prepared.states,
        bounds=bounds,
        weights=weights,
        breakdown=breakdown,
        prices=solution.prices,
        reduced=solution.reduced,
        compared=prepared.compared,
    )
    curve_bounds = window_bounds = None
    whole = (prepared.states, weights, solution.prices, cast("Certified", solver))
    known = solution.reduced, stopwatch.progress
    if request and request.curve:
        from tgospa_eval.evaluation.curve import trace  # lazy: only on request

        with stopwatch.span("curve"):
            curve_bounds = trace(*whole, *known)
    if request and request.sliding is not None:
        sliding = request.sliding
        from tgospa_eval.evaluation.curve import slide  # lazy: only on request

        with stopwatch.span("windows"):
            window_bounds = slide(*whole, sliding.spans(prepared.timestamps), *known)
            window_bounds = replace(
                window_bounds,
                size=sliding.shown(prepared.states.problem.steps),
                every=in_words(sliding.every),
            )
    with stopwatch.span("report"):
        assigned = pair_parts(prepared, proof)
        split = {name: float(costs.sum()) for name, costs in assigned.items()} or None
        nees = None
        if prepared.estimate_covariance is not None:
            from tgospa_eval.evaluation.consistency import pair_nees  # lazy: covariances are rare

            assigned[NEES], nees = pair_nees(proof, prepared.distance)
    recorded, evaluated_on = prepared.recorded()
    problem = prepared.states.problem
    return make_result(
        PairEvaluation,
        proof=proof,
        solver=solver,
        solution=solution,
        settings=prepared.settings,
        at=problem.at_cutoff,
        more=rounded_coordinates(prepared, proof),
        split=split,
        assigned=assigned,
        nees=nees,
        unjudged=read_unjudged(prepared.states, weights),
        curve_bounds=curve_bounds,
        window_bounds=window_bounds,
        labels=prepared.labels,
        timings=nested_timings(stopwatch),
        input=recorded,
        evaluated_on=evaluated_on,
        sizes=prepared.sizes,
        objects=(len(problem.truth_step), len(problem.estimate_step)),
    )


def make_result(
    kind: type[E],
    *,
    proof: Costs,
    solver: Solver,
    solution: Solution,
    settings: Mapping[str, Any],
    at: int,
    more: Iterable[Notice] = (),
    split: dict[str, float] | None,
    nees: NeesSums | None,
    **parts: Any,
) -> E:
    """Make a result of the class `kind`, for data in memory or data in parts.

    `at` is the number of pairs at the cutoff (see `at_cutoff`). `more` are further warnings, and
    `parts` are further fields of the result.
    """
    gap = solver.gap if solver.proves else GAP
    return kind(
        proof=proof,
        split=split,
        nees=nees,
        gap=gap,
        settings={**settings, **solver_settings(solver)},
        solver=solver_record(solver, solution, proof.parameters, met=proof.bounds.met(gap)),
        version=__version__,
        warnings=(
            *within_rounding(proof.bounds, gap),
            *at_cutoff(at),
            *more,
            *(() if nees is None else nees.warnings(spread=(split or {}).get(SPREAD))),
        ),
        **parts,
    )


def solver_record(solver: Solver, solution: Solution, parameters: Parameters, *, met: bool) -> Json:
    """Return the record of the solver in a result; `met` says if the gap is reached.

    The history of the solver has brackets, which are converted from units of c^p to costs.
    """
    finished, status = solution.finished, solution.sentence
    if met != finished and (met or solver.proves):
        # The bounds of the proof decide, not the status of the solver.
        finished, status = met, str(Status.SOLVED if met else Status.NOT_SOLVED)
    scale = parameters.scale
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
    """Return the settings of a solver that change the number."""
    changing = {
        name: value for name, value in vars(solver).items() if value is not None and name != "jobs"
    }
    return {"solver": solver.name, **changing}


def nested_timings(stopwatch: Stopwatch) -> Json:
    """Return seconds by stage, with the parts of ``solve`` in a dict; a missing stage has 0."""
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
    return {**timings, "solve": solve, "total": stopwatch.elapsed()}


LARGE = 1e7
"""Coordinates smaller than this keep nine decimals as doubles."""

ROUNDED_DIGIT = 2e-10
"""Relative error of a total, caused by rounded decimals, above which there is a warning."""


def within_rounding(bounds: Bounds, gap: float) -> tuple[Notice, ...]:
    """Warn if the value is so small that rounding of the distances alone could cause it."""
    if not bounds.within_rounding(gap):
        return ()
    return (
        Notice(
            code="within-rounding",
            text="the value is so small that rounding of distances alone could cause it; only its "
            "bounds are known",
            remedy="use coordinates with a nearby origin, which keep more digits",
        ),
    )


def at_cutoff(pairs: int) -> tuple[Notice, ...]:
    """Warn if ignored objects have estimates at a distance that equals the cutoff."""
    if not pairs:
        return ()
    of = "an ignored truth and an estimate"
    return (
        Notice(
            code="at-cutoff",
            text=f"{counted(pairs, f'pair of {of} is', f'pairs of {of} are')} at the cutoff "
            "within rounding, so the last digits of the states decide: a nearer estimate costs "
            "nothing, any other estimate is false",
            remedy=f"with a slightly larger {option('cutoff')} these estimates cost nothing; with "
            "a slightly smaller one they are false",
        ),
    )


def rounded_coordinates(prepared: PreparedPair, proof: PairProof) -> tuple[Notice, ...]:
    """Warn if rounded decimals of large coordinates leave less than ten digits of the total.

    Let u be the spacing of doubles at the largest coordinate. A rounded decimal has the standard
    error u / sqrt(12), and the difference of two decimals has the standard error u / sqrt(6). The
    error of the cost d^p of a pair is p d^(p - 1) times the error of its distance d. Errors of
    pairs are independent, so their squares add up.

    If u is 1 or more, integers may also have been rounded, and states may only seem to be equal.
    """
    largest = max(np.abs(side.state).max(initial=0.0) for side in prepared.sides)
    sides = prepared.truth, prepared.estimate
    spacing, cutoff, order = math.ulp(largest), proof.parameters.cutoff, proof.parameters.order
    what = "finer digits of coordinates are lost"
    if spacing < max(1, ROUNDED_DIGIT * cutoff):
        if largest < LARGE or all((states % 1 == 0).all() for states in sides):
            return ()
        states = proof.states
        used = np.flatnonzero((states.entry >= 0) & (proof.weights > 0))
        slope = order * states.problem.cost[states.entry[used]] ** (1 - 1 / order)
        error = float(np.linalg.norm(slope)) * spacing / math.sqrt(6) / cutoff
        total = proof.breakdown.total
        if not ROUNDED_DIGIT * total < error < total:  # bounds show larger errors
            return ()
        digit = math.ceil(-math.log10(error / total))
        what = f"digit {digit} of the total may come from rounding"
    return (
        Notice(
            code="rounded-coordinates",
            text=f"floating-point numbers near the largest coordinate, {largest:.3g}, are "
            f"{spacing:.2g} apart: {what}",
            remedy="use coordinates with a nearby origin, which keep more digits",
        ),
    )


BLOCK = 1 << 16
"""Number of pairs whose distances are split at once."""


def pair_parts(prepared: PreparedPair, proof: PairProof) -> dict[str, Floats]:
    """Return the parts of the cost of each assigned pair, by name, (N,) each.

    The parts of a pair sum to its cost. The result is empty if costs have no parts.
    """
    if prepared.existence is None and type(prepared.distance).parts is Distance.parts:
        return {}
    problem, scale = proof.states.problem, proof.parameters.scale
    pairs = read_assigned(proof.states, proof.weights)
    entry, weight = pairs.entry, pairs.weight
    sides, reports = prepared.sides, prepared.reports
    own = problem.truth_row[entry], problem.estimate_row[entry]
    if reports is not None and type(prepared.distance).parts is not Distance.parts:
        sides = reports.located(sides[0].ids[sides[0].track[own[0]]], own[1])
        own = np.arange(len(entry)), np.arange(len(entry))
    measure, parameters = prepared.distance, proof.parameters
    parts = parts_of_distances(sides, measure, parameters, problem, entry, own)
    costs = {name: weight * part for name, part in parts.items()}
    if prepared.existence is None:
        return costs
    if not costs:
        expected = weight * problem.share(entry) * problem.powers(entry)
        costs = {"expected_localisation": scale * expected}
    return {**costs, "existence_mismatch": scale * weight * problem.mismatch(entry)}


def parts_of_distances(
    sides: Sides,
    distance: Distance,
    parameters: Parameters,
    problem: Problem,
    entries: Ints,
    rows: tuple[Ints, Ints],
) -> dict[str, Floats]:
    """Return the costs of pairs by their means and by their spreads, for the weight 1.

    `entries` are the indices of the pairs in the problem, and `rows` have their rows of the truth
    and of the estimate. The result is empty if p is not 2, or if the distance has no parts.
    """
    if parameters.order != 2 or type(distance).parts is Distance.parts:
        return {}
    costs = np.zeros((2, len(entries)))
    for begin in range(0, len(entries) or 1, BLOCK):
        part = slice(begin, begin + BLOCK)
        entry = entries[part]
        pairs = Pairs(
            truth_row=rows[0][part],
            estimate_row=rows[1][part],
            distance=parameters.cutoff * np.sqrt(problem.powers(entry)),
        )
        parts = distance.parts(pairs, sides)
        if parts is None:
            return {}
        costs[:, part] = problem.share(entry) * np.square(parts)
    return dict(zip((MEAN, SPREAD), costs, strict=True))
