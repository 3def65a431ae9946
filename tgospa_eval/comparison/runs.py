"""One problem through one solver: what came out, how long it took, what memory it took."""

import io
import pickle
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import field
from typing import IO, Any, cast

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.progress import Progress
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.distances import DISTANCES
from tgospa_eval.errors import ConfigError, SolverError, TgospaError
from tgospa_eval.evaluation.evaluate import evaluate_fitted, solve
from tgospa_eval.evaluation.prepare import Prepared, fit
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.reports.records import Costs, Memory, RunCosts, Seconds
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
class Run:
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
    parts: Costs | None = None
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


def costs_of(result: Summary) -> Costs:
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


def failed(solver: Solver, error: BaseException) -> Run:
    """What is left of a run whose solver raised."""
    return Run(solver=solver.name, epsilon=solver.epsilon, status=f"failed: {reason(error)}")


def reason(error: BaseException) -> str:
    """Why something failed; what nobody expected is called an error of ours."""
    if isinstance(error, TgospaError):
        return str(error)
    if isinstance(error, MemoryError):
        return "out of memory"
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return f"{text}; this is an error of this program, please report it"


def run_here(prepared: Prepared, solver: Solver, stopwatch: Stopwatch | None = None) -> Run:
    """Solve and prove in this process."""
    result = solve(prepared, solver, stopwatch or Stopwatch())
    stages = {name: seconds for name, seconds in result.timings["solve"].items() if seconds}
    return Run(
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


def run_apart(prepared: Prepared, solver: Solver, progress: Progress | None = None) -> Run:
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
    if isinstance(found, Run):
        return found
    raise found[0](found[1])


def _listen(
    target: IO[bytes], source: IO[bytes], progress: Progress
) -> Run | tuple[type[TgospaError], str]:
    """What the process answers in the end; it is stopped where the work is."""
    stopped = False
    with io.BufferedReader(cast("io.RawIOBase", source)) as words:
        while True:
            found = pickle.load(words)
            if isinstance(found, Run) or isinstance(found[0], type):
                return cast("Run | tuple[type[TgospaError], str]", found)
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
