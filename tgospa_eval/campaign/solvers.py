"""One problem through several solvers: do they agree, how near are they, what do they cost."""

import io
import math
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import field
from functools import cached_property, partial
from typing import IO, Any, cast

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.campaign import SCHEMA
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval, excess, narrowest, overlap, shortfall
from tgospa_eval.common.progress import Progress, Stopwatch
from tgospa_eval.distances import DISTANCES
from tgospa_eval.errors import ConfigError, SolverError, TgospaError
from tgospa_eval.evaluation.evaluate import evaluate_fitted, solve
from tgospa_eval.evaluation.prepare import Prepared, fit
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.reports.records import (
    CostParts,
    Memory,
    Metric,
    RunCosts,
    Seconds,
    SolverRun,
    SolversRecord,
)
from tgospa_eval.results.summary import Summary
from tgospa_eval.solvers import Solver
from tgospa_eval.tracks.trajectories import Trajectories

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
        [sys.executable, "-P", "-m", "tgospa_eval.campaign.worker"],
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


# -------------------------------------------------------------------------------------------------
# Several solvers on one problem.


ONCE = {"read": "read", "distances": "distances", "preparation": "solve/preparation"}
"""What is done once for all solvers, and the span of the stopwatch that has its time."""


@dataclass(frozen=True, kw_only=True)
class SolverComparison:
    """Runs of several solvers on one problem.

    Parameters
    ----------
    runs : sequence of SolvedRun
        At least one.
    """

    runs: Sequence[SolvedRun]

    @property
    def contradictions(self) -> list[tuple[SolvedRun, SolvedRun]]:
        """Pairs of runs whose brackets do not overlap: one of their proofs is wrong."""
        return [
            (first, second)
            for k, first in enumerate(self.runs)
            for second in self.runs[k + 1 :]
            if first.bracket and second.bracket and not overlap(first.bracket, second.bracket)
        ]

    @cached_property
    def referee(self) -> Interval | None:
        """What all runs together prove of the total: nothing where they contradict each other."""
        proven = [run.bracket for run in self.runs if run.bracket is not None]
        return narrowest(proven) if proven and not self.contradictions else None

    def error(self, run: SolvedRun) -> float | None:
        """Proven: the run's total is at most so much, relative, above the true one."""
        if self.referee is None or run.bracket is None:
            return None
        return excess(run.bracket.upper, self.referee.lower)

    def lower_error(self, run: SolvedRun) -> float | None:
        """Proven: the run's lower bound of the total is at most so much, relative, below it."""
        if self.referee is None or run.bracket is None:
            return None
        return shortfall(run.bracket.lower, self.referee.upper)


def compare_solvers(
    prepared: Prepared,
    solvers: Sequence[Solver],
    run: Callable[[Prepared, Solver], SolvedRun] | None = None,
    progress: Progress | None = None,
) -> SolverComparison:
    """Run all solvers, one after the other; one that fails leaves the others their results.

    Those that are not begun when the work is to stop are left out.

    Parameters
    ----------
    prepared : Prepared
        The problem; made once.
    solvers : sequence of Solver
        With their settings.
    run : callable, optional
        `run_here`, or else `run_apart`.
    progress : Progress, optional
        Gets which of them runs, and how far that is.
    """
    progress = progress or Progress()
    run = run or partial(run_apart, progress=progress)
    runs: list[SolvedRun] = []
    for number, solver in enumerate(solvers):
        if runs and progress.stop.is_set():
            break
        with progress.part(name_of(solver), number, len(solvers)):
            try:
                runs.append(run(prepared, solver))
            except Exception as error:  # whatever it is, it must not cost what others have found
                runs.append(failed(solver, error))
    return SolverComparison(runs=tuple(runs))


def solvers_document(
    comparison: SolverComparison,
    prepared: Prepared,
    left_out: dict[str, str],
    seconds: dict[str, float],
    warnings: list[dict[str, str]],
) -> SolversRecord:
    """The JSON document.

    Parameters
    ----------
    comparison : SolverComparison
        What was found.
    prepared : Prepared
        The problem.
    left_out : dict
        Solvers that did not run, and why.
    seconds : dict
        What was done once for all, and how long it took.
    warnings : list of dict
        What looks wrong with the data.
    """
    referee = comparison.referee
    order = prepared.parameters.order
    return {
        "schema": SCHEMA,
        "version": __version__,
        "kind": "solvers",
        "agree": not comparison.contradictions,
        "contradictions": [[a.name, b.name] for a, b in comparison.contradictions],
        "referee": None
        if referee is None
        else {
            "lower_bound": referee.lower ** (1 / order),
            "upper_bound": referee.upper ** (1 / order),
            "total": {"lower": referee.lower, "upper": referee.upper},
        },
        "runs": [run_document(comparison, run) for run in comparison.runs],
        "left_out": left_out,
        "parameters": cast("Metric", prepared.settings),
        "sizes": {**prepared.sizes, "states": len(prepared.states.begin)},
        "input": prepared.input,
        "seconds": seconds,
        "warnings": warnings,
    }


def run_document(comparison: SolverComparison, run: SolvedRun) -> SolverRun:
    """One run, with its errors against what all of them prove."""
    error, bracket = comparison.error(run), run.bracket
    return {
        "name": run.name,
        "solver": run.solver,
        "epsilon": run.epsilon,
        "tgospa": run.tgospa,
        "lower_bound": run.lower_bound,
        "total": None if bracket is None else bracket.upper,
        "total_lower": None if bracket is None else bracket.lower,
        "error": error if error is not None and math.isfinite(error) else None,
        "lower_error": comparison.lower_error(run),
        **(run.parts or NO_COSTS),
        "counts": run.counts,
        "status": run.status,
        "finished": run.finished,
        "iterations": run.iterations,
        "seconds": run.seconds,
        "memory": run.memory,
        "history": list(run.history),
    }
