"""Comparison of solvers by their errors, time and memory.

Solvers are compared on one problem, or on simulated scenes of many sizes. A *scene* is a simulated
truth with the estimate of a simulated tracker.
"""

import itertools
import math
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.campaign import SCHEMA
from tgospa_eval.campaign.row import LABEL, Row, row_of
from tgospa_eval.campaign.store import SCHEMA as STORE_SCHEMA
from tgospa_eval.campaign.store import Store, locked
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval, excess, narrowest, overlap, shortfall
from tgospa_eval.common.machine import fault_of
from tgospa_eval.common.progress import Limit, Progress, Stopwatch
from tgospa_eval.common.words import counted
from tgospa_eval.distances import DISTANCES, Distance
from tgospa_eval.errors import ConfigError, TgospaError
from tgospa_eval.evaluation.pair import PairEvaluation
from tgospa_eval.evaluation.prepare import PreparedPair, fit, prepare
from tgospa_eval.evaluation.prove import solve, solver_settings
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.kernels import KERNEL
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.quoting import option
from tgospa_eval.results.records import PARTS, Json
from tgospa_eval.simulation import Scene, Tracker, simulate
from tgospa_eval.solvers import Solver
from tgospa_eval.solvers.sinkhorn import entropic_trace
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    import pandas as pd

RUN = (
    *("name", "solver", "epsilon", "status", "finished", "counts", "history"),
    *("tgospa", "lower_bound", "total", "total_lower", "error", "lower_error", *PARTS),
    *("iterations", "seconds", "memory", "entropic"),
)
"""Fields of the record of a run. After a failure, all but the first five are None or empty."""

STATUS_FILE, RESET_FILE = Path("/proc/self/status"), Path("/proc/self/clear_refs")
"""Files of Linux: the first shows the memory of this process, the second resets its peak."""

EXACT_STATES = 15_000
"""Number of states of one component for which the solver `exact` takes about a minute.

These are the states of rows in the linear programme (docs/theory/reductions.md), not of targets.
Times on one core, for scenes of the scenario `dense`: 2,990 states 2.3 s, 8,099 states 11 s, 15,994
states 57 s, 18,951 states 39 s. The time grows about with the square of the number of states. With
several components, the times of the components add up.
"""


def display_name(solver: str, epsilon: float | None) -> str:
    """Return the name of a solver, and its temperature in full precision if it has one."""
    if epsilon is None:
        return solver
    short = f"{epsilon:g}"
    return f"{solver} {short if float(short) == epsilon else repr(float(epsilon))}"


def name_of(solver: Solver) -> str:
    """Return the name and temperature of a solver."""
    return display_name(solver.name, solver.epsilon)


def _run(solver: Solver, status: str, **values: object) -> Json:
    """Return the record of a run; fields without a value are None or empty."""
    about = {"name": name_of(solver), "solver": solver.name, "epsilon": solver.epsilon}
    nothing = {"finished": False, "counts": {}, "history": []}
    return {**dict.fromkeys(RUN), **about, **nothing, "status": status, **values}


def failed(solver: Solver, error: BaseException) -> Json:
    """Return the record of a run that ended with this error."""
    reason = str(error) if isinstance(error, TgospaError) else fault_of(error)
    return _run(solver, f"failed: {reason}")


Run = tuple[Json, PairEvaluation | None]
"""Record of a run, and its result. The result is None if the run failed."""


def run_here(prepared: PreparedPair, solver: Solver, progress: Progress | None = None) -> Run:
    """Solve a problem and prove the result; `progress` receives the share that is done."""
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


def _entropic(prepared: PreparedPair, solver: Solver, progress: Progress) -> Json | None:
    """Return values of the problem with entropy, in units of the total; None if there is none."""
    if solver.epsilon is None:
        return None
    limit = Limit.of(getattr(solver, "time_limit", None), progress)
    scale, problem_units = prepared.parameters.scale, ("primal", "dual", "cost")
    trace = entropic_trace(prepared.states, solver.epsilon, limit.late)
    history = [record | {name: scale * record[name] for name in problem_units} for record in trace]
    if not history:
        return None
    last = {name: history[-1][name] for name in ("sweep", "violation", *problem_units)}
    return {**last, "error": None, "cost_error": None, "history": history}


def memory(field: str) -> int | None:
    """Return the memory of this process in bytes: now (VmRSS) or at its peak (VmHWM).

    None on systems other than Linux.
    """
    try:
        lines = STATUS_FILE.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    line_of_field = next((line for line in lines if line.startswith(f"{field}:")), None)
    return None if line_of_field is None else 1024 * int(line_of_field.split()[1])


def warm_up(solvers: Iterable[Solver]) -> None:
    """Solve a small problem with each solver, because the first call of a solver takes longer."""
    rng = np.random.default_rng(0)
    truth, estimate = (Trajectories.from_array(rng.random((4, 3, 1))) for _ in range(2))
    for solver in solvers:
        if solver.proves:
            # This import loads HiGHS. The small problem does not load it.
            import tgospa_eval.solvers.restricted_lp  # noqa: F401
        request = EvaluationRequest(
            parameters=Parameters(cutoff=1.0, order=1.0, switch_penalty=0.3),
            distance=DISTANCES.ours("euclidean"),
            solver=solver,
        )
        with suppress(Exception):  # the run of the solver will record the error
            pair = fit(truth, estimate, request)
            solve(prepare(pair, request, stopwatch=Stopwatch()), solver, Stopwatch(), request)


def takes_long(prepared: PreparedPair) -> int | None:
    """Return the number of states if `exact` takes more than about a minute, else None."""
    states = prepared.states
    sizes = np.bincount(
        states.pair_block, np.diff(states.pair_first), minlength=len(states.block_begin)
    )
    return int(sizes.sum()) if np.sqrt((sizes**2).sum()) > EXACT_STATES else None


def check_solvers(solvers: Sequence[Solver]) -> None:
    """Check that solvers are different, and that sinkhorn has compiled kernels.

    Raises
    ------
    ConfigError
        Two solvers have the same name and temperature, or sinkhorn has no compiled kernels and
        would solve a linear programme.
    """
    if KERNEL == "numpy" and any(solver.name == "sinkhorn" for solver in solvers):
        raise ConfigError(
            f"{option('solvers', 'sinkhorn')}: without compiled kernels it solves the same linear "
            "programme as certified, not an approximation; choose certified,exact, or "
            "install with a C compiler"
        )
    names = list(map(name_of, solvers))
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ConfigError(f"{twice} is given twice")


# -------------------------------------------------------------------------------------------------
# Several solvers on one problem.


ONCE = {"read": "read", "distances": "distances", "preparation": "solve/preparation"}
"""Work that is done once for all solvers, and its span in the stopwatch."""


def contradictions(runs: Iterable[Json]) -> list[tuple[str, str]]:
    """Return pairs of runs whose brackets do not overlap, so that one of the proofs is wrong."""
    proven = [(run["name"], bracket) for run in runs if (bracket := bracket_of(run))]
    return [
        (first, second)
        for (first, own), (second, other) in itertools.combinations(proven, 2)
        if not overlap(own, other)
    ]


def referee(runs: Sequence[Json]) -> Interval | None:
    """Return the referee: the intersection of the brackets of all runs.

    None if no run has a bracket, or if two brackets do not overlap.
    """
    proven = [bracket for run in runs if (bracket := bracket_of(run))]
    return narrowest(proven) if proven and not contradictions(runs) else None


def errors(run: Json, known: Interval | None) -> tuple[float | None, float | None]:
    """Return the largest possible relative errors of the upper and the lower bound of a run.

    `known` is the bracket that contains the exact total.
    """
    bracket = bracket_of(run)
    if bracket is None or known is None:
        return None, None
    return excess(bracket.upper, known.lower), shortfall(bracket.lower, known.upper)


def entropic_error(value: float | None, known: Interval | None) -> float | None:
    """Return the largest possible relative error of a value of the problem with entropy.

    `known` is the bracket that contains the exact total.
    """
    if value is None or known is None or known.lower <= 0:
        return None
    return max(known.upper - value, value - known.lower) / known.lower


def bracket_of(run: Json) -> Interval | None:
    """Return the bracket that a run proves for the total; None if the run failed."""
    if run["total"] is None:
        return None
    return Interval(lower=run["total_lower"], upper=run["total"])


def compare_solvers(
    prepared: PreparedPair,
    solvers: Sequence[Solver],
    progress: Progress | None = None,
) -> list[Run]:
    """Run all solvers, one after the other; a failed solver does not affect the other results.

    If the work is stopped, solvers that have not begun are not in the result.

    Parameters
    ----------
    prepared : PreparedPair
        Problem for all solvers.
    solvers : sequence of Solver
        Solvers with their settings.
    progress : Progress, optional
        Receives the name of the current solver, and the share that is done.
    """
    progress = progress or Progress()
    runs: list[Run] = []
    for number, solver in enumerate(solvers):
        if runs and progress.stop.is_set():
            break
        with progress.part(name_of(solver), number, len(solvers)):
            try:
                runs.append(run_here(prepared, solver, progress))
            except Exception as error:  # so that other results are not lost
                runs.append((failed(solver, error), None))
    return runs


def solvers_document(
    runs: Sequence[Json],
    prepared: PreparedPair,
    left_out: dict[str, str],
    seconds: dict[str, float],
    warnings: list[dict[str, str]],
) -> Json:
    """Return the JSON document of the runs, with their errors relative to the referee.

    Parameters
    ----------
    runs : sequence of dict
        Records of the runs.
    prepared : PreparedPair
        Problem that was solved.
    left_out : dict
        Reason for each solver that did not run.
    seconds : dict
        Times of work that was done once for all solvers.
    warnings : list of dict
        Warnings about the data.
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
        "input": prepared.recorded()[0],
        "seconds": seconds,
        "warnings": warnings,
    }


# -------------------------------------------------------------------------------------------------
# The scaling study: solvers on synthetic scenes of many sizes, with several scenes of each size.
#
# The study follows figures 2 and 3 of Nevelius Wernholm, Wärnsäter and Ringh. They show the error
# as a function of the temperature, and time and error as functions of the number of targets and of
# the number of steps. The seed of a scene depends only on the seed of the study, the size and the
# number of the run. New scenes therefore do not change existing ones.

Key = tuple[int, int, int]
"""Number of targets, number of steps, and run number of a scene."""

Scenes = dict[Key, list[Row]]
"""Rows of each scene, one per solver."""

Keep = Callable[[Sequence[Row]], object]
"""Callable that receives the rows of a new scene, to store them."""

STORE_FOLDER = "runs"
"""Folder of the store of rows, in the folder of a study."""

OF_SCENE = ("targets", "steps", "run")
"""Labels of a scene."""


def machine() -> str:
    """Describe the machine on which the times were measured."""
    return (
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, {KERNEL} kernels"
    )


@contextmanager
def opened(folder: str, study: "Study") -> Iterator[tuple[Scenes, Keep]]:
    """Yield the scenes that are stored in a folder, and a function that stores a new scene.

    Raises
    ------
    ConfigError, InputError
        The store belongs to another study, is in use, is damaged, or cannot be written.
    """
    store = Store(os.path.join(folder, STORE_FOLDER))
    nothing = dict.fromkeys(("truth", "estimate", "layout", "seqmap"))
    options = {**study.settings, "machine": machine()}
    store.open(
        {
            "schema": STORE_SCHEMA,
            "version": __version__,
            "options": options,
            "jobs": {"paths": [], **nothing},
        }
    )
    with locked(store.folder, (1, 1)):
        rows: dict[str, Row] = {str(row["key"]): row for row in _plain(store.rows())}
        scenes: Scenes = {}
        for row in rows.values():
            targets, steps, run = (int(row[LABEL + name]) for name in OF_SCENE)
            keys = [key_of((targets, steps, run), solver) for solver in study.solvers]
            if rows.keys() >= {*keys}:
                scenes[targets, steps, run] = [rows[key] for key in keys]
        yield scenes, store.add


def _plain(rows: "pd.DataFrame") -> Iterator[Row]:
    """Yield rows with None for missing values."""
    for row in rows.to_dict("records"):
        yield {str(name): value if value == value else None for name, value in row.items()}


def key_of(scene: Key, solver: Solver) -> str:
    """Return the key of a row in the store of a study."""
    return "/".join((*map(str, scene), name_of(solver)))


Size = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class Study:
    """Settings of a scaling study: its scenes and its solvers.

    Parameters
    ----------
    scene : Scene
        Scenario and area of all scenes. Its numbers of targets and steps are replaced by those of
        each size.
    tracker : Tracker
        Errors of the simulated tracker.
    seed : int
        Seed of the whole study.
    parameters : Parameters
        Parameters of the metric.
    distance : Distance
        Distance between states.
    solvers : sequence of Solver
        Solvers with their settings.
    targets, steps : sequence of int
        Numbers of targets and of steps. Every combination is a size.
    runs : int
        Number of scenes of each size.
    """

    scene: Scene
    tracker: Tracker
    seed: int
    parameters: Parameters
    distance: Distance
    solvers: Sequence[Solver]
    targets: Sequence[int]
    steps: Sequence[int]
    runs: int

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise ConfigError(f"runs is {self.runs}: must be 1 or more")
        for name in ("targets", "steps"):
            sizes = getattr(self, name)
            if len(set(sizes)) < len(sizes):
                raise ConfigError(f"{name}: a number is given twice")
            smallest = min(sizes)
            if smallest < 1:
                raise ConfigError(f"{name} is {smallest}: must be 1 or more")
        for targets, steps in self.sizes:
            replace(self.scene, targets=targets, steps=steps)  # checks both numbers together

    @property
    def sizes(self) -> list[Size]:
        """Targets and steps of each size."""
        return [(targets, steps) for targets in self.targets for steps in self.steps]

    @property
    def settings(self) -> Json:
        """Everything that determines a row, except the size and the run number of its scene."""
        scene = asdict(self.scene)
        return {
            "scene": {name: scene[name] for name in ("scenario", "area", "state")},
            "tracker": asdict(self.tracker) | {"false_length": list(self.tracker.false_length)},
            "seed": self.seed,
            "parameters": {
                **asdict(self.parameters),
                "distance": self.distance.name,
                **self.distance.settings(("x", "y")),
            },
            "solvers": [solver_settings(s) | {"jobs": s.jobs} for s in self.solvers],
        }

    def wanted(self) -> Iterator[Key]:
        """Yield the key of each scene: all sizes of run 1, then all sizes of run 2, and so on."""
        for run in range(1, self.runs + 1):
            for targets, steps in self.sizes:
                yield targets, steps, run


def carry_out(
    study: Study,
    known: Scenes,
    keep: Keep = lambda _: None,
    notify: Callable[[str, float], None] = lambda text, share: None,  # noqa: ARG005
) -> list[list[Row]]:
    """Measure the scenes of a study that are not known, and return the rows of all its scenes.

    Parameters
    ----------
    study : Study
        Requested scenes and solvers.
    known : dict
        Rows of the known scenes. Rows of new scenes are added.
    keep : callable
        Callable that receives the rows of each new scene as soon as it is measured.
    notify : callable
        Callable that receives a text about the next scene, and the share that is done.
    """
    if any(key not in known for key in study.wanted()):
        warm_up(study.solvers)
    count = len(study.sizes) * study.runs
    scenes = []
    for done, key in enumerate(study.wanted()):
        if key not in known:
            targets, steps, run = key
            size = f"{counted(targets, 'target')}, {counted(steps, 'step')}"
            notify(f"{size}, run {run} ({done} of {count})", done / count)
            known[key] = measure(study, key)
            keep(known[key])
        scenes.append(known[key])
    return scenes


def measure(study: Study, scene: Key) -> list[Row]:
    """Run all solvers on one scene; a failure becomes a row, and does not stop the study."""
    targets, steps, _ = scene
    rng = np.random.default_rng([study.seed, *scene])
    stopwatch = Stopwatch()
    request = EvaluationRequest(
        parameters=study.parameters, distance=study.distance, solver=study.solvers[0]
    )
    about: Row = {}
    try:
        sides = simulate(replace(study.scene, targets=targets, steps=steps), study.tracker, rng)
        prepared = prepare(fit(*sides, request), request, stopwatch=stopwatch)
    except Exception as error:  # so that other scenes are still measured
        runs: list[Run] = [(failed(solver, error), None) for solver in study.solvers]
    else:
        about["sizes.states"] = len(prepared.states.begin)
        spans = (stopwatch.spans[name] for name in ("distances", "solve/preparation"))
        about["seconds.prepare"] = sum(spans)
        runs = compare_solvers(prepared, study.solvers)
    rows = []
    for solver, (made, result) in zip(study.solvers, runs, strict=True):
        spent, entropic = made["seconds"] or {}, made["entropic"] or {}
        row = {
            "key": key_of(scene, solver),
            **{LABEL + name: str(value) for name, value in zip(OF_SCENE, scene, strict=True)},
            LABEL + "solver": made["name"],
            "truth": f"seed {study.seed}: " + "/".join(map(str, scene)),
            "estimate": "",
            "options": "{}",
            **({} if result is None else row_of(result)),
            **about,
            "iterations": made["iterations"],
            "entropic.dual": entropic.get("dual"),
            "entropic.cost": entropic.get("cost"),
            "warnings": "[]",
            "status": "failed" if result is None else "done" if made["finished"] else "open",
            "message": made["status"],
            "seconds": spent.get("solve", 0.0) + spent.get("certify", 0.0),
            "finished": time.time_ns(),
            "version": __version__,
        }
        rows.append(row)
    return rows


def study_document(study: Study, scenes: Sequence[Sequence[Row]], machine: str) -> Json:
    """Return the JSON document, with mean and spread for each size and solver."""
    by_size: dict[str, list[list[Json]]] = {f"{m}/{steps}": [] for m, steps in study.sizes}
    opposed = []
    for rows in scenes:
        runs = [_as_run(row) for row in rows]
        targets, steps, run = (rows[0][LABEL + name] for name in OF_SCENE)
        by_size[f"{targets}/{steps}"].append(runs)
        opposed += [(int(targets), int(steps), int(run), *pair) for pair in contradictions(runs)]
    sizes = zip(study.sizes, by_size.values(), strict=True)
    return {
        "schema": SCHEMA,
        "version": __version__,
        "kind": "study",
        **study.settings,
        "machine": machine,
        "runs": study.runs,
        "sizes": [_size(size, of_size, study) for size, of_size in sizes],
        "contradictions": opposed,
    }


def _as_run(row: Row) -> Json:
    """Return a row with the field names of a run."""
    has = row["status"] != "failed"
    return {**row, "name": row[LABEL + "solver"], "total": row["total_upper"] if has else None}


def _size(size: Size, scenes: Sequence[Sequence[Json]], study: Study) -> Json:
    """Return the record of a size; means leave out scenes with contradictory brackets."""
    sound = [runs for runs in scenes if not contradictions(runs)]
    best = [
        min(answered, key=itemgetter("total"))
        for runs in sound
        if (answered := [run for run in runs if run["total"] is not None])
    ]
    costs: dict[str, str] = {"tgospa": "total", **{name: name for name in PARTS}}
    normalised = {
        name: float(
            np.mean([run[cost] / (run["judged.steps"] or 1) for run in best])
            ** (1 / study.parameters.order)
        )
        if best
        else None
        for name, cost in costs.items()
    }
    return {
        "targets": size[0],
        "steps": size[1],
        "left_out": len(scenes) - len(best),
        "states": spread(runs[0].get("sizes.states") for runs in scenes),
        "prepare_seconds": spread(runs[0].get("seconds.prepare") for runs in scenes),
        "normalised": normalised,
        "solvers": [_solver(one, scenes, sound, k) for k, one in enumerate(study.solvers)],
    }


def _solver(
    solver: Solver, scenes: Sequence[Sequence[Json]], sound: Sequence[Sequence[Json]], k: int
) -> Json:
    """Return the record of one solver and size, with errors relative to the referee."""
    every = [runs[k] for runs in scenes]
    known = [(runs[k], referee(runs)) for runs in sound if runs[k]["total"] is not None]
    ends = [errors(run, total) for run, total in known]
    above = [error for error, _ in ends if error is not None]
    return {
        "name": name_of(solver),
        "solver": solver.name,
        "epsilon": solver.epsilon,
        "seconds": spread(run["seconds"] for run, _ in known),
        "error": spread(error for error in above if math.isfinite(error)),
        "infinite_errors": sum(map(math.isinf, above)),
        "lower_error": spread(below for _, below in ends),
        "entropic_error": spread(entropic_error(run["entropic.dual"], own) for run, own in known),
        "entropic_cost_error": spread(
            entropic_error(run["entropic.cost"], own) for run, own in known
        ),
        "iterations": spread(run["iterations"] for run, _ in known),
        "failed": sum(run["status"] == "failed" for run in every),
        "unfinished": sum(run["status"] == "open" for run in every),
    }


def spread(values: Iterable[float | None]) -> Json:
    """Return mean, standard deviation (divisor n - 1) and largest of the known values."""
    numbers = np.array([value for value in values if value is not None], float)
    return {
        "mean": float(numbers.mean()) if len(numbers) else None,
        "deviation": float(numbers.std(ddof=1)) if len(numbers) > 1 else None,
        "max": float(numbers.max()) if len(numbers) else None,
    }
