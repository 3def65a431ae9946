"""Problem -> solution -> proof -> what is known of one evaluation."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar, cast

from tgospa_eval._version import __version__
from tgospa_eval.common.frozen import replace
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.progress import Status, Stopwatch
from tgospa_eval.evaluation.localisation import (
    at_cutoff,
    pair_parts,
    rounded_coordinates,
    within_rounding,
)
from tgospa_eval.evaluation.pair import PairEvaluation
from tgospa_eval.evaluation.prepare import PreparedPair
from tgospa_eval.evaluation.request import EvaluationRequest, in_words
from tgospa_eval.kernels import KERNEL
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.metric_family import Parameters, check_underflow
from tgospa_eval.problem.readout import read_unjudged
from tgospa_eval.problem.solution import Solution
from tgospa_eval.results.consistency import NEES, NeesSums
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import SPREAD, Costs, Json, PairProof
from tgospa_eval.solvers import Solver

if TYPE_CHECKING:
    from tgospa_eval.solvers.certified import Certified

E = TypeVar("E", bound=Evaluation)

GAP = 1e-9
"""Relative gap that counts as exact, for solvers that have no setting for it."""


def solve(
    prepared: PreparedPair,
    solver: Solver,
    stopwatch: Stopwatch,
    request: EvaluationRequest | None = None,
) -> PairEvaluation:
    """The second half: solution, proof, result; the problem can be solved again."""
    stopwatch.progress.begin(prepared.parameters.root)
    return prove(prepared, solver, solver(prepared.states, stopwatch), stopwatch, request)


def prove(
    prepared: PreparedPair,
    solver: Solver,
    solution: Solution,
    stopwatch: Stopwatch,
    request: EvaluationRequest | None = None,
) -> PairEvaluation:
    """What a solution proves of a problem; a disposable one loses its weights.

    The curve and windows are those that the request asks for, if there is one.
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
    traced = slid = None
    whole = (prepared.states, weights, solution.prices, cast("Certified", solver))
    known = solution.reduced, stopwatch.progress
    if request and request.curve:
        from tgospa_eval.evaluation.curve import trace  # lazy: only when it is asked for

        with stopwatch.span("curve"):
            traced = trace(*whole, *known)
    if request and request.sliding is not None:
        sliding = request.sliding
        from tgospa_eval.evaluation.curve import slide  # lazy: only when it is asked for

        with stopwatch.span("windows"):
            slid = slide(*whole, sliding.spans(prepared.moments), *known)
            slid = replace(
                slid,
                size=sliding.shown(prepared.states.problem.steps),
                every=in_words(sliding.every),
            )
    with stopwatch.span("report"):
        assigned = pair_parts(prepared, proof)
        split = {name: float(costs.sum()) for name, costs in assigned.items()} or None
        nees = None
        if prepared.estimate_covariance is not None:
            from tgospa_eval.evaluation.consistency import pair_nees  # lazy: few have covariances

            assigned[NEES], nees = pair_nees(proof, prepared.distance)
    recorded, judged = prepared.recorded()
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
        traced=traced,
        slid=slid,
        labels=prepared.labels,
        timings=nested_timings(stopwatch),
        input=recorded,
        evaluated_on=judged,
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
    """A result of one kind, in memory or of data in parts.

    `at` is how many pairs are at the cutoff; `more` are further warnings; `parts` are the other
    fields.
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
    """The record of the solver for the result; the bracket of its history as costs."""
    finished, status = solution.finished, solution.sentence
    if met != finished and (met or solver.proves):
        # The proof knows better than the solver.
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
    """The settings of a solver that change the number."""
    changing = {
        name: value for name, value in vars(solver).items() if value is not None and name != "jobs"
    }
    return {"solver": solver.name, **changing}


def nested_timings(stopwatch: Stopwatch) -> Json:
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
    return {**timings, "solve": solve, "total": stopwatch.elapsed()}
