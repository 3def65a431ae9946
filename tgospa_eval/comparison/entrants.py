"""Estimates that are compared: what is needed of their evaluations, and how long each run is."""

import io
import pickle
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.progress import Progress, Stopwatch
from tgospa_eval.distances import DISTANCES
from tgospa_eval.errors import ConfigError, SolverError, TgospaError
from tgospa_eval.evaluation.evaluate import evaluate_fitted, solve
from tgospa_eval.evaluation.other_metrics import Others
from tgospa_eval.evaluation.prepare import Prepared, fit
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.problem.gospa import (
    Changes,
    changes_since_last_step,
    changes_since_last_stored,
    partners,
    per_step_gospa,
)
from tgospa_eval.problem.problem import Floats
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.reports.records import (
    RULES,
    CostParts,
    EstimateRecord,
    Memory,
    PerStepRecord,
    Rule,
    RuleRecord,
    RunCosts,
    Seconds,
)
from tgospa_eval.results.records import PARTS, Json, Time
from tgospa_eval.results.result import Result
from tgospa_eval.results.summary import Summary
from tgospa_eval.solvers import Solver
from tgospa_eval.tracks.alignment import Times
from tgospa_eval.tracks.trajectories import Trajectories


@dataclass(frozen=True, kw_only=True, eq=False)
class Against:
    """Per-step GOSPA of one pair; values in state units, costs in state units to the power p.

    Parameters
    ----------
    gospa : (T,) float array
        GOSPA of each step, to the power p.
    parts : dict
        Its costs over all steps: localisation, missed, false.
    changes : dict of Changes
        Changes into each step, by rule.
    values : dict of (T,) float arrays
        GOSPA of each step, ``gospa``, and what the tools print for it, by rule.
    differing : (T,) bool array
        Steps whose assignment is not that of TGOSPA.
    """

    gospa: Floats
    parts: dict[str, float]
    changes: dict[str, Changes]
    values: dict[str, Floats]
    differing: NDArray[np.bool_]


def against(result: Result) -> Against:
    """Evaluate each step by itself, on the problem of a result."""
    states, problem = result.proof.states, result.proof.states.problem
    parameters, scale = result.proof.parameters, result.scale
    p = parameters.order
    switch = 2 * scale * parameters.switch_price  # gamma^p, where that is a double
    found = per_step_gospa(problem)
    gospa = scale * found.total
    track = partners(problem, found.entries)
    changes = {
        "stone_soup": changes_since_last_stored(problem, track),
        "mathworks": changes_since_last_step(problem, track),
    }
    value = gospa ** (1 / p)
    paid = {name: switch * count.total for name, count in changes.items()}
    used = states.entry[(states.entry >= 0) & (result.proof.weights > 0)]
    changed = np.setxor1d(used, found.entries)
    differing = np.zeros(problem.steps, bool)
    differing[problem.entry_step[changed]] = True
    return Against(
        gospa=gospa,
        parts={name: scale * float(getattr(found, name).sum()) for name in PARTS[:3]},
        changes=changes,
        values={
            "gospa": value,
            "stone_soup": np.hypot(value, paid["stone_soup"] ** (1 / p)),
            "mathworks": (gospa + paid["mathworks"]) ** (1 / p),
        },
        differing=differing,
    )


def against_document(found: Against, order: float) -> PerStepRecord:
    """The sums over all steps, for the JSON document."""
    return {
        "total": float(found.gospa.sum()),
        "localisation": found.parts["localisation"],
        "missed": found.parts["missed"],
        "false": found.parts["false"],
        "steps_differing": int(found.differing.sum()),
        "stone_soup": _rule_record(found, "stone_soup", order),
        "mathworks": _rule_record(found, "mathworks", order),
    }


def _rule_record(found: Against, rule: Rule, order: float) -> RuleRecord:
    return {
        "switches": float(found.changes[rule].total.sum()),
        "halves": float(found.changes[rule].half.sum()),
        "total": float((found.values[rule] ** order).sum()),
        "mean": float(found.values[rule].mean()) if len(found.gospa) else 0.0,
    }


def differences(
    document: EstimateRecord, step: PerStepRecord, steps: Sequence[int], order: float
) -> Iterator[str]:
    """Why the numbers of one estimate differ, a sentence each.

    Parameters
    ----------
    document : EstimateRecord
        TGOSPA's own numbers.
    step : PerStepRecord
        Those of per-step GOSPA.
    steps : sequence of int
        Steps of each run.
    order : float
        Of the metric.
    """
    total = document["total"]
    own = document["counts"]["switch"]
    share = (
        f"{100 * step['total'] / total:.4g} % of the total of TGOSPA"
        if total
        else "0, as is TGOSPA"
    )
    yield (
        f"per-step GOSPA, summed, is {share}: every step takes its cheapest assignment, and no "
        "change from step to step costs anything"
    )
    count = step["steps_differing"]
    yield (
        f"at {count:.4g} of {sum(steps) / len(steps):.6g} steps TGOSPA "
        "found another assignment than the cheapest of that step alone"
        if count
        else "TGOSPA found the assignment of every step that is the cheapest of that step alone"
    )
    for rule, name in RULES.items():
        made, halves = step[rule]["switches"], step[rule]["halves"]
        text = f"{name} counts {_count(made, 'switch')} afterwards, TGOSPA {own:.4g}"
        if made:
            text += ": it charges what the cheapest assignments happen to need"
        if halves:
            text += (
                f", and {halves / 2:.4g} for {_count(halves, 'change')} from a track to none or "
                "back, as at every miss; TGOSPA keeps the pair through a miss at no cost"
            )
        yield text
    if step["stone_soup"] != step["mathworks"]:
        if step["stone_soup"]["switches"] != step["mathworks"]["switches"]:
            yield (
                "Stone Soup compares with the last partner it stored, however long ago, and passes "
                "over steps without estimates; MathWorks compares with the step before"
            )
        if order != 2:
            yield (
                f"Stone Soup adds switches with the exponent 2 though p = {order:g}: its values "
                "are no sums of costs"
            )


def _count(number: float, word: str) -> str:
    ending = "" if number == 1 else ("es" if word.endswith("ch") else "s")
    return f"{number:.4g} {word}{ending}"


# -------------------------------------------------------------------------------------------------
# One problem through one solver: what came out, how long it took, what memory it took.

NO_COSTS: RunCosts = {"localisation": None, "missed": None, "false": None, "switch": None}
"""Of a run that failed."""

OWN_GROUP: dict[str, Any] = {} if sys.platform == "win32" else {"process_group": 0}
"""Ctrl-C reaches the one who asked, who stops the process."""

EXACT_STATES = 15_000
"""Where the referee takes about a minute: states of one component.

Measured on one core, scenes of `dense`: 2,990 states 2.3 s, 8,099 states 11 s, 15,994 states 57 s,
18,951 states 39 s; the time grows with about the square. Of several components the squares add up.
"""


@dataclass(frozen=True, kw_only=True)
class SolvedRun:
    """What a solver made of a problem; costs are in state units to the power p.

    Parameters
    ----------
    solver : str
        Its name.
    epsilon : float, optional
        Its temperature, if it has one.
    bracket : Interval, optional
        Proven bounds of the total; None if the solver failed, and then there is only a status.
    tgospa, lower_bound : float, optional
        The same bounds as values.
    parts, counts : dict
        Costs and counts of the feasible assignment; None and nothing if the solver failed.
    status : str
        How the solver ended.
    finished : bool
        Whether it did what was asked.
    iterations : int, optional
        Sweeps, or iterations of an interior point or simplex method.
    seconds : dict, optional
        ``solve`` and ``certify``; and ``stages``, the parts of solving.
    memory : dict, optional
        Bytes of the process: ``before`` solving, and at the ``peak`` until the proof was done.
    history : list of dict
        Convergence: sweep, epsilon, violation, lower and upper bound of the total.
    """

    solver: str
    epsilon: float | None
    status: str
    bracket: Interval | None = None
    tgospa: float | None = None
    lower_bound: float | None = None
    parts: CostParts | None = None
    counts: dict[str, float] = field(default_factory=dict)
    finished: bool = False
    iterations: int | None = None
    seconds: Seconds | None = None
    memory: Memory | None = None
    history: Sequence[dict[str, float]] = ()

    @property
    def name(self) -> str:
        """Solver and temperature."""
        return called(self.solver, self.epsilon)


def called(solver: str, epsilon: float | None) -> str:
    """Solver and temperature, in as many digits as it takes to differ from others."""
    if epsilon is None:
        return solver
    short = f"{epsilon:g}"
    return f"{solver} {short if float(short) == epsilon else repr(float(epsilon))}"


def name_of(solver: Solver) -> str:
    """Name and temperature of a solver."""
    return called(solver.name, solver.epsilon)


def costs_of(result: Summary) -> CostParts:
    """The parts of the cost of a result."""
    return {
        "localisation": result.localisation,
        "missed": result.missed,
        "false": result.false,
        "switch": result.switch,
    }


def bracket_of(result: Summary) -> Interval:
    """The proven bounds of the total, as costs."""
    lower, upper = result.total_bounds
    return Interval(lower=lower, upper=upper)


def failed(solver: Solver, error: BaseException) -> SolvedRun:
    """What is left of a run whose solver raised."""
    return SolvedRun(solver=solver.name, epsilon=solver.epsilon, status=f"failed: {reason(error)}")


def reason(error: BaseException) -> str:
    """Why something failed; what nobody expected is called an error of ours."""
    if isinstance(error, TgospaError):
        return str(error)
    if isinstance(error, MemoryError):
        return "out of memory"
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return f"{text}; this is an error of this program, please report it"


def run_here(prepared: Prepared, solver: Solver, stopwatch: Stopwatch | None = None) -> SolvedRun:
    """Solve and prove in this process."""
    result = solve(prepared, solver, stopwatch or Stopwatch())
    stages = {name: seconds for name, seconds in result.timings["solve"].items() if seconds}
    return SolvedRun(
        solver=solver.name,
        epsilon=solver.epsilon,
        bracket=bracket_of(result),
        tgospa=result.tgospa,
        lower_bound=result.lower_bound,
        parts=costs_of(result),
        counts=result.counts,
        status=result.solver["status"],
        finished=bool(result.solver["finished"]),
        iterations=result.solver["iterations"],
        seconds={
            "solve": sum(stages.values()),
            "certify": result.timings["certify"],
            "stages": stages,
        },
        history=result.solver["history"],
    )


def run_apart(prepared: Prepared, solver: Solver, progress: Progress | None = None) -> SolvedRun:
    """The same in a process of its own, which also measures the memory that it takes.

    Raises
    ------
    SolverError
        The process died, for want of memory perhaps.
    TgospaError
        As for `run_here`.
    """
    import os

    message = pickle.dumps((prepared, solver), protocol=pickle.HIGHEST_PROTOCOL)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "tgospa_eval.comparison.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=environment,
        cwd=os.path.dirname(__file__),  # the working folder may be gone, and Python would not start
        bufsize=0,  # so that nothing is left to write when stdin is closed
        **OWN_GROUP,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            _write_all(process.stdin, message)
            del message
            found = _listen(process.stdin, process.stdout, progress or Progress())
        except (OSError, EOFError, pickle.UnpicklingError):  # it died, or in mid-answer
            raise SolverError(
                "its process ended without an answer; out of memory perhaps"
            ) from None
        finally:
            process.kill()  # it has answered, or nobody waits for it
    if isinstance(found, SolvedRun):
        return found
    raise found[0](found[1])


def _listen(
    target: IO[bytes], source: IO[bytes], progress: Progress
) -> SolvedRun | tuple[type[TgospaError], str]:
    """What the process answers in the end; it is stopped where the work is."""
    stopped = False
    with io.BufferedReader(cast("io.RawIOBase", source)) as words:
        while True:
            found = pickle.load(words)
            if isinstance(found, SolvedRun) or isinstance(found[0], type):
                return cast("SolvedRun | tuple[type[TgospaError], str]", found)
            share, progress.bracket = found
            progress.done(share)
            if progress.stop.is_set() and not stopped:
                stopped = True
                target.write(b"s")


def _write_all(target: IO[bytes], message: bytes) -> None:
    """Write to a pipe without a buffer, which may take less than all at once."""
    rest = memoryview(message)
    while rest:
        rest = rest[target.write(rest) :]


def warm_up(solver: Solver) -> None:
    """Import what the solver needs: a first call takes longer than those that follow."""
    if solver.proves:
        import tgospa_eval.solvers.restricted_lp  # noqa: F401  HiGHS, which small scenes do without
    rng = np.random.default_rng(0)
    truth, estimate = (Trajectories.from_array(rng.random((4, 3, 1))) for _ in range(2))
    request = EvaluationRequest(
        parameters=Parameters(cutoff=1.0, order=1.0, switch_penalty=0.3),
        distance=DISTANCES["euclidean"],
        solver=solver,
    )
    evaluate_fitted(fit(truth, estimate, request), request, stopwatch=Stopwatch())


def takes_long(prepared: Prepared) -> int | None:
    """Number of states if the referee would take more than a minute or so, else None."""
    states = prepared.states
    sizes = np.bincount(
        states.pair_block, np.diff(states.pair_first), minlength=len(states.block_begin)
    )
    return int(sizes.sum()) if np.sqrt((sizes**2).sum()) > EXACT_STATES else None


def check_solvers(solvers: Sequence[Solver]) -> None:
    """No solver may be there twice with the same settings.

    Raises
    ------
    ConfigError
        Two solvers have the same name, and the same temperature if they have one.
    """
    seen = list(map(name_of, solvers))
    twice = next((name for name in seen if seen.count(name) > 1), None)
    if twice is not None:
        raise ConfigError(f"{twice} is given twice")


@dataclass(frozen=True, kw_only=True, eq=False)
class EntrantOutcome:
    """What a ranking needs of the evaluation of one estimate in one run.

    Parameters
    ----------
    bracket : Interval
        Proven bounds of the total.
    parts, counts : dict
        Costs and counts.
    steps : dict of (T,) float arrays
        Costs of each step, by part.
    moments, times : (T,) array and list
        The steps, as numbers and as they were read.
    judged : mapping
        What it was judged on, as `Judged.record`.
    finished, status : bool, str
        Whether the solver did what was asked, and how it ended.
    input, against, others : dict, and Against and Others or None
        Rows and digests; per-step GOSPA; other metrics.
    """

    bracket: Interval
    parts: CostParts
    counts: dict[str, float]
    steps: dict[str, Floats]
    moments: Times
    times: list[Time]
    judged: Mapping[str, Any]
    finished: bool
    status: str
    input: Mapping[str, Json]
    against: Against | None = None
    others: Others | None = None


def outcome(
    result: Result, moments: Times, *, per_step: bool, others: Others | None = None
) -> EntrantOutcome:
    """What to keep of a result, so that the problem can go."""
    split = result.proof.breakdown
    return EntrantOutcome(
        bracket=bracket_of(result),
        parts=costs_of(result),
        counts=result.counts,
        steps={name: result.scale * getattr(split, name) for name in PARTS},
        moments=moments,
        times=result.labels.times,
        judged=result.judged,
        finished=bool(result.solver["finished"]),
        status=result.solver["status"],
        input=result.input,
        against=against(result) if per_step else None,
        others=others,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Entrant:
    """One tracker.

    Parameters
    ----------
    name : str
        What it is called.
    paths : sequence of str
        Its file in each run.
    outcomes : sequence of EntrantOutcome
        What came of each.
    """

    name: str
    paths: Sequence[str]
    outcomes: Sequence[EntrantOutcome]


def durations(entrants: Sequence[Entrant]) -> list[int]:
    """Steps of the horizon of each run, at least 1; all entrants are judged on the same ones."""
    return [max(item.judged["steps"], 1) for item in entrants[0].outcomes]
