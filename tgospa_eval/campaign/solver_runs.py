"""One problem through several solvers: do they agree, how near are they, what do they cost."""

import itertools
import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.campaign import SCHEMA
from tgospa_eval.common.interval import Interval, excess, narrowest, overlap, shortfall
from tgospa_eval.common.machine import fault_of
from tgospa_eval.common.progress import Limit, Progress, Stopwatch
from tgospa_eval.distances import DISTANCES
from tgospa_eval.errors import ConfigError, TgospaError
from tgospa_eval.evaluation.evaluate import evaluate_fitted, solve
from tgospa_eval.evaluation.pair import PairEvaluation
from tgospa_eval.evaluation.prepare import Prepared, fit
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.problem.compiled import KERNEL
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.results.records import PARTS, Json
from tgospa_eval.solvers import Solver
from tgospa_eval.solvers.entropic import entropic_trace
from tgospa_eval.tracks.trajectories import Trajectories

RUN = (
    *("name", "solver", "epsilon", "status", "finished", "counts", "history"),
    *("tgospa", "lower_bound", "total", "total_lower", "error", "lower_error", *PARTS),
    *("iterations", "seconds", "memory", "entropic"),
)
"""What a run has; all but the first five are None, or empty, of one that failed."""

STATUS_FILE, RESET_FILE = Path("/proc/self/status"), Path("/proc/self/clear_refs")
"""Of Linux: what memory this process has, and what begins its peak anew."""

EXACT_STATES = 15_000
"""Where the referee takes about a minute: states of one component.

Measured on one core, scenes of `dense`: 2,990 states 2.3 s, 8,099 states 11 s, 15,994 states 57 s,
18,951 states 39 s; the time grows with about the square. Of several components the squares add up.
"""


def called(solver: str, epsilon: float | None) -> str:
    """Solver and temperature, in as many digits as it takes to differ from others."""
    if epsilon is None:
        return solver
    short = f"{epsilon:g}"
    return f"{solver} {short if float(short) == epsilon else repr(float(epsilon))}"


def name_of(solver: Solver) -> str:
    """Name and temperature of a solver."""
    return called(solver.name, solver.epsilon)


def _run(solver: Solver, status: str, **found: object) -> Json:
    """A run, as far as it is known."""
    about = {"name": name_of(solver), "solver": solver.name, "epsilon": solver.epsilon}
    nothing = {"finished": False, "counts": {}, "history": []}
    return {**dict.fromkeys(RUN), **about, **nothing, "status": status, **found}


def failed(solver: Solver, error: BaseException) -> Json:
    """What is left of a run whose solver raised."""
    reason = str(error) if isinstance(error, TgospaError) else fault_of(error)
    return _run(solver, f"failed: {reason}")


Run = tuple[Json, PairEvaluation | None]
"""The record of a run, and what came of it; None where it failed."""


def run_here(prepared: Prepared, solver: Solver, progress: Progress | None = None) -> Run:
    """Solve and prove; `progress` gets how far that is."""
    stopwatch = Stopwatch()
    stopwatch.progress = progress or stopwatch.progress
    before = memory("VmRSS")
    with suppress(OSError):
        RESET_FILE.write_text("5", encoding="ascii")
    result = solve(prepared, solver, stopwatch)
    peak = memory("VmHWM")
    stages = {name: seconds for name, seconds in result.timings["solve"].items() if seconds}
    lower, upper = result.total_bounds
    seconds = {"solve": sum(stages.values()), "certify": result.timings["certify"]}
    made = _run(
        solver,
        str(result.solver["status"]),
        finished=bool(result.solver["finished"]),
        tgospa=result.tgospa,
        lower_bound=result.lower_bound,
        total=upper,
        total_lower=lower,
        counts=result.counts,
        iterations=result.solver["iterations"],
        seconds=seconds | {"stages": stages},
        memory=before and peak and {"before": before, "peak": peak},
        history=list(result.solver["history"]),
        entropic=_entropic(prepared, solver, stopwatch.progress),
        **{name: getattr(result, name) for name in PARTS},
    )
    return made, result


def _entropic(prepared: Prepared, solver: Solver, progress: Progress) -> Json | None:
    """The value of the regularised problem of a temperature, in units of the total."""
    if solver.epsilon is None:
        return None
    limit = Limit.of(getattr(solver, "time_limit", None), progress)
    scale, problem_units = prepared.parameters.scale, ("primal", "dual", "cost")
    trace = entropic_trace(prepared.states, solver.epsilon, limit.late)
    history = [look | {name: scale * look[name] for name in problem_units} for look in trace]
    if not history:
        return None
    last = {name: history[-1][name] for name in ("sweep", "violation", *problem_units)}
    return {**last, "error": None, "cost_error": None, "history": history}


def memory(field: str) -> int | None:
    """Bytes of this process, as Linux counts them: VmRSS now, VmHWM at most; else None."""
    try:
        lines = STATUS_FILE.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    found = next((line for line in lines if line.startswith(f"{field}:")), None)
    return None if found is None else 1024 * int(found.split()[1])


def warm_up(solvers: Iterable[Solver]) -> None:
    """Import what solvers need: a first call takes longer than those that follow."""
    rng = np.random.default_rng(0)
    truth, estimate = (Trajectories.from_array(rng.random((4, 3, 1))) for _ in range(2))
    for solver in solvers:
        if solver.proves:
            import tgospa_eval.solvers.restricted_lp  # noqa: F401  HiGHS, which small scenes do without
        request = EvaluationRequest(
            parameters=Parameters(cutoff=1.0, order=1.0, switch_penalty=0.3),
            distance=DISTANCES.ours("euclidean"),
            solver=solver,
        )
        with suppress(Exception):  # what fails here fails again where it is recorded
            evaluate_fitted(fit(truth, estimate, request), request, stopwatch=Stopwatch())


def takes_long(prepared: Prepared) -> int | None:
    """Number of states if the referee would take more than a minute or so, else None."""
    states = prepared.states
    sizes = np.bincount(
        states.pair_block, np.diff(states.pair_first), minlength=len(states.block_begin)
    )
    return int(sizes.sum()) if np.sqrt((sizes**2).sum()) > EXACT_STATES else None


def check_solvers(solvers: Sequence[Solver]) -> None:
    """No solver may be there twice with the same settings, and sinkhorn needs its sweeps.

    Raises
    ------
    ConfigError
        Two solvers have the same name, and the same temperature if they have one; or sinkhorn would
        be a linear programme, for want of compiled kernels.
    """
    if KERNEL == "numpy" and any(solver.name == "sinkhorn" for solver in solvers):
        raise ConfigError(
            "--solvers sinkhorn: without compiled kernels it is the same linear programme as "
            "certified, and no approximation to compare; choose certified,exact, or install with a "
            "C compiler at hand"
        )
    seen = list(map(name_of, solvers))
    twice = next((name for name in seen if seen.count(name) > 1), None)
    if twice is not None:
        raise ConfigError(f"{twice} is given twice")


# -------------------------------------------------------------------------------------------------
# Several solvers on one problem.


ONCE = {"read": "read", "distances": "distances", "preparation": "solve/preparation"}
"""What is done once for all solvers, and the span of the stopwatch that has its time."""


def contradictions(runs: Iterable[Json]) -> list[tuple[str, str]]:
    """Pairs of runs whose brackets do not overlap: one of their proofs is wrong."""
    proven = [(run["name"], bracket) for run in runs if (bracket := bracket_of(run))]
    return [
        (first, second)
        for (first, own), (second, other) in itertools.combinations(proven, 2)
        if not overlap(own, other)
    ]


def referee(runs: Sequence[Json]) -> Interval | None:
    """What all runs together prove of the total: nothing where they contradict each other."""
    proven = [bracket for run in runs if (bracket := bracket_of(run))]
    return narrowest(proven) if proven and not contradictions(runs) else None


def errors(run: Json, known: Interval | None) -> tuple[float | None, float | None]:
    """Proven: how far, relative, both ends of a run may at most be above and below the total."""
    bracket = bracket_of(run)
    if bracket is None or known is None:
        return None, None
    return excess(bracket.upper, known.lower), shortfall(bracket.lower, known.upper)


def entropic_error(value: float | None, known: Interval | None) -> float | None:
    """How far an entropic value may at most be from the total, relative."""
    if value is None or known is None or known.lower <= 0:
        return None
    return max(known.upper - value, value - known.lower) / known.lower


def bracket_of(run: Json) -> Interval | None:
    """What a run proves of the total; None where it failed."""
    if run["total"] is None:
        return None
    return Interval(lower=run["total_lower"], upper=run["total"])


def compare_solvers(
    prepared: Prepared,
    solvers: Sequence[Solver],
    progress: Progress | None = None,
) -> list[Run]:
    """Run all solvers, one after the other; one that fails leaves the others their results.

    Those that are not begun when the work is to stop are left out.

    Parameters
    ----------
    prepared : Prepared
        The problem; made once.
    solvers : sequence of Solver
        With their settings.
    progress : Progress, optional
        Gets which of them runs, and how far that is.
    """
    progress = progress or Progress()
    runs: list[Run] = []
    for number, solver in enumerate(solvers):
        if runs and progress.stop.is_set():
            break
        with progress.part(name_of(solver), number, len(solvers)):
            try:
                runs.append(run_here(prepared, solver, progress))
            except Exception as error:  # whatever it is, it must not cost what others have found
                runs.append((failed(solver, error), None))
    return runs


def solvers_document(
    runs: Sequence[Json],
    prepared: Prepared,
    left_out: dict[str, str],
    seconds: dict[str, float],
    warnings: list[dict[str, str]],
) -> Json:
    """The JSON document: the runs, with their errors against what all of them prove.

    Parameters
    ----------
    runs : sequence of dict
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
    known, opposed = referee(runs), contradictions(runs)
    for run in runs:
        error, run["lower_error"] = errors(run, known)
        run["error"] = error if error is not None and math.isfinite(error) else None
        if run["entropic"] is not None:
            for name, value in (("error", "dual"), ("cost_error", "cost")):
                run["entropic"][name] = entropic_error(run["entropic"][value], known)
    order = prepared.parameters.order
    return {
        "schema": SCHEMA,
        "version": __version__,
        "kind": "solvers",
        "agree": not opposed,
        "contradictions": [list(pair) for pair in opposed],
        "referee": None
        if known is None
        else {
            "lower_bound": known.lower ** (1 / order),
            "upper_bound": known.upper ** (1 / order),
            "total": {"lower": known.lower, "upper": known.upper},
        },
        "runs": list(runs),
        "left_out": left_out,
        "parameters": dict(prepared.settings),
        "sizes": {**prepared.sizes, "states": len(prepared.states.begin)},
        "input": prepared.input,
        "seconds": seconds,
        "warnings": warnings,
    }
