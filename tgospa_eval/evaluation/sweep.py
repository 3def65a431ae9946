"""TGOSPA over a range of one parameter, to see whether a conclusion depends on its value.

A *point* is the evaluation at one value. Near pairs are searched once, for the largest cutoff. The
points at both ends of the range are solved first, then the middle between two solved points, and so
on. A middle point starts from the solutions of the two points around it (`solvers.warm_start`).
Each point has its own proof.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.pair import PairEvaluation
from tgospa_eval.evaluation.prepare import AlignedPair, MeasuredSides, NearPairs, fit, measure
from tgospa_eval.evaluation.prove import prove, solver_settings
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import States, merge_runs
from tgospa_eval.quoting import option
from tgospa_eval.results.records import PARTS, Json
from tgospa_eval.results.sweep import Point, SweepEvaluation
from tgospa_eval.solvers import Solver
from tgospa_eval.solvers.warm_start import SavedSolution, make_warm_start, save_solution

CONCAVE = ("cutoff", "switch_penalty")
"""Parameters for which prices interpolated between two solved points are a useful start."""

EASY_WORK, EASY_ITERATIONS = 10, 300
"""Largest work of an easy solution: half sweeps of the solver over all states, and iterations.

A solution that was easy without a warm start is not kept as a start of other points."""


def in_order(name: str, values: Sequence[float], rest: dict[str, float]) -> tuple[Parameters, ...]:
    """Return the parameters of all points, sorted by the value of the parameter `name`.

    `rest` has the other parameters.

    Raises
    ------
    ConfigError
        There is no value, a value is a duplicate, or a value is out of its range.
    """
    if not values:
        raise ConfigError(f"no value of the {name.replace('_', ' ')}: name at least one")
    parameters = [Parameters(**{**rest, name: value}) for value in values]
    ordered = tuple(sorted(parameters, key=lambda made: _value(made, name)))
    for a, b in pairwise(ordered):
        if a == b:
            raise ConfigError(f"{name.replace('_', ' ')} {_value(a, name):g} is given twice")
    return ordered


def _check_steps(
    sides: AlignedPair, request: EvaluationRequest, parameter: str, parameters: Sequence[Parameters]
) -> None:
    """Check that all points have the same steps.

    The steps can depend on a swept cutoff, because an outage of the estimate ends with a near pair.
    """
    matching = request.time_matching
    if parameter != "cutoff" or not matching.of_estimate:
        return
    first, last = (
        fit(*sides.given, replace(request, parameters=point)).axis.horizon.times
        for point in (parameters[0], parameters[-1])
    )
    if not np.array_equal(first, last):
        raise ConfigError(
            "the steps that count depend on the cutoff, because objects are missed in outages of "
            f"the estimate; use a common clock ({option('resample')})"
        )


def sweep_fitted(
    sides: AlignedPair,
    request: EvaluationRequest,
    parameter: str,
    parameters: Sequence[Parameters],
    *,
    files: Sequence[Json] | None = None,
    stopwatch: Stopwatch,
) -> SweepEvaluation:
    """Evaluate all points of a sweep.

    Parameters
    ----------
    sides : AlignedPair
        Truth and estimate, aligned, and their distance.
    request : EvaluationRequest
        Request, whose own parameters are not used.
    parameter : str
        Name of the swept parameter.
    parameters : sequence of Parameters
        Parameters of each point, in the order of `in_order`.
    files, stopwatch
        Arguments of `api.evaluate.evaluate_pair`.

    Raises
    ------
    ConfigError
        The steps that count depend on the cutoff.
    """
    _check_steps(sides, request, parameter, parameters)
    widest = max(point.cutoff for point in parameters)
    measured, near = measure(sides, request, cutoff=widest, files=files, stopwatch=stopwatch)
    line = _Line(measured, near, tuple(parameters), parameter, request.solver, stopwatch)
    points = line.points()
    rest = {k: v for k, v in parameters[0].recorded.items() if k != parameter}
    left, right = measured.sides
    return SweepEvaluation(
        parameter=parameter,
        points=points,
        settings={**rest, **measured.settings, **solver_settings(request.solver)},
        sizes={"truth": len(left.ids), "estimates": len(right.ids), "steps": len(left.times)},
        input=measured.recorded()[0],
        timings=_timings(stopwatch),
        version=__version__,
    )


class _Line:
    """Solver of the points: first those at both ends, then the middle between two solved points."""

    def __init__(
        self,
        measured: MeasuredSides,
        near: NearPairs,
        parameters: tuple[Parameters, ...],
        name: str,
        solver: Solver,
        stopwatch: Stopwatch,
    ) -> None:
        self.measured, self.near, self.name = measured, near, name
        self.parameters, self.solver, self.stopwatch = parameters, solver, stopwatch
        self.states: States | None = None
        self.solution: Solution | None = None

    def points(self) -> tuple[Point, ...]:
        """Solve the points, and return them in order of their values."""
        solution: dict[int, Point] = {}
        saved: dict[int, SavedSolution | None] = {}
        progress, count = self.stopwatch.progress, len(self.parameters)
        for done, (k, neighbours) in enumerate(_bisected(count)):
            if solution and progress.stop.is_set():
                break
            value = f"{self.name.replace('_', ' ')} {_value(self.parameters[k], self.name):g}"
            with progress.part(value, done, count):
                solution[k], saved[k] = self._solve(k, neighbours, [saved[at] for at in neighbours])
        return tuple(solution[k] for k in sorted(solution))

    def _solve(
        self, k: int, neighbours: tuple[int, ...], saved: list[SavedSolution | None]
    ) -> tuple[Point, SavedSolution | None]:
        """Return point k, and its solution if other points should start from it.

        `neighbours` are the indices of the two solved points around it, and `saved` has their
        solutions.
        """
        parameters, solver, stopwatch = self.parameters[k], self.solver, self.stopwatch
        with stopwatch.span("solve/preparation"):
            prepared = self.measured.prepared(self._reduced(parameters), parameters)
        states = prepared.states
        stopwatch.progress.begin(parameters.root)
        if self.name == "rho" and self.near.unjudged is None:
            # One solution serves all values of rho, except if it has bounds at smaller cutoffs.
            if self.solution is None or self.solution.reduced:
                self.solution = replace(solver(states, stopwatch), disposable=False)
            return _point(prove(prepared, solver, self.solution, stopwatch), self.name), None
        if not (kernels and solver.proves and self.name in CONCAVE):
            result = prove(prepared, solver, solver(states, stopwatch), stopwatch)
            return _point(result, self.name), None
        warm_start = None
        beside = tuple(part for part in saved if part is not None)
        if len(beside) == 2:
            with stopwatch.span("solve/preparation"):
                low, high = (self.parameters[at] for at in neighbours)
                warm_start = make_warm_start(
                    states, beside, _shares(low, parameters, high, self.name)
                )
        before = stopwatch.work
        solution = solver(states, stopwatch, warm_start)
        work = stopwatch.work - before
        hard = (
            work > EASY_WORK * len(states.begin)
            or solution.iterations > EASY_ITERATIONS
            or warm_start is not None
        )
        result = prove(prepared, solver, solution, stopwatch)
        mine = save_solution(states, result.proof.weights, solution.prices) if hard else None
        return _point(result, self.name), mine

    def _reduced(self, parameters: Parameters) -> States:
        """Return the reduced problem of a point.

        If only the switch penalty or rho changes, the reduction of the point before is used again.
        One exception: if some states are not evaluated, a change of rho needs a new reduction,
        because rho then changes which pairs have a gain.
        """
        problem = self.measured.problem(self.near, parameters)
        unchanged = self.name == "switch_penalty" or (
            self.name == "rho" and self.near.unjudged is None
        )
        if self.states is not None and unchanged:
            return replace(self.states, problem=problem)
        self.states = merge_runs(problem)
        return self.states


def _bisected(count: int) -> Iterator[tuple[int, tuple[int, ...]]]:
    """Yield the index of each point, and the indices of the two solved points around it.

    The points at both ends come first. They have no solved points around them.
    """
    yield 0, ()
    if count > 1:
        yield count - 1, ()
    spans = [(0, count - 1)]
    while spans:
        low, high = spans.pop()
        if high - low > 1:
            middle = (low + high) // 2
            yield middle, (low, high)
            spans += [(middle, high), (low, middle)]


def _shares(low: Parameters, here: Parameters, high: Parameters, name: str) -> tuple[float, float]:
    """Return two factors with which prices at `low` and `high` add up to prices at `here`.

    Prices in state units to the power p are interpolated linearly in c^p, or in gamma^p. The
    factors also convert each price from the unit c^p of its own point.
    """
    if name == "cutoff":
        a, b = ((side.cutoff / here.cutoff) ** here.order for side in (low, high))
        at, scales = (1.0 - a) / (b - a), (a, b)
    else:
        a, b = low.switch_price, high.switch_price
        at = (here.switch_price - a) / (b - a) if b > a else 0.5
        scales = 1.0, 1.0
    return (1.0 - at) * scales[0], at * scales[1]


def _value(parameters: Parameters, name: str) -> float:
    value: float = getattr(parameters, name)
    return value


def _point(result: PairEvaluation, name: str) -> Point:
    numbers = ("tgospa", "lower_bound", "total", "relative_gap", "certified", *PARTS)
    values = {number: getattr(result, number) for number in numbers}
    values |= {f"{part}_count": count for part, count in result.counts.items()}
    return Point(
        value=_value(result.proof.parameters, name),
        normalised=result.normalised["tgospa"],
        status=result.solver["status"],
        finished=bool(result.solver["finished"]),
        **values,
    )


def _timings(stopwatch: Stopwatch) -> dict[str, float]:
    """Return the seconds of each stage, summed over all points."""
    timings = {"read": 0.0, "distances": 0.0, "solve": 0.0, "certify": 0.0, "report": 0.0}
    for name, seconds in stopwatch.spans.items():
        timings[name.partition("/")[0]] += seconds
    return {**timings, "total": stopwatch.elapsed()}
