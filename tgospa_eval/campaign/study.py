"""The scaling study: solvers on synthetic scenes of many sizes, several of each.

After figures 2 and 3 of Nevelius Wernholm, Wärnsäter and Ringh: error over temperature, time and
error over the number of targets and over the number of steps. Every scene has a seed of its own,
made of the seed of the study, the size and the number of the run: what is added later leaves what
is there as it is.
"""

import math
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.campaign import SCHEMA
from tgospa_eval.campaign.row import LABEL, Row, row_of
from tgospa_eval.campaign.solver_runs import (
    Run,
    compare_solvers,
    contradictions,
    entropic_error,
    errors,
    failed,
    name_of,
    referee,
    warm_up,
)
from tgospa_eval.campaign.store import SCHEMA as STORE_SCHEMA
from tgospa_eval.campaign.store import Store, locked
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.evaluate import solver_settings
from tgospa_eval.evaluation.prepare import fit, prepare
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.problem.compiled import KERNEL
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.results.records import PARTS, Json
from tgospa_eval.simulation import Scene, Tracker, simulate
from tgospa_eval.solvers import Solver

if TYPE_CHECKING:
    import pandas as pd

Key = tuple[int, int, int]
"""Targets, steps and number of a scene."""

Scenes = dict[Key, list[Row]]
"""The rows of scenes, one for each solver."""

Keep = Callable[[Sequence[Row]], object]
"""Gets the rows of a scene."""

STORE_FOLDER = "runs"
"""The store of the rows, in the folder of a study."""

OF_SCENE = ("targets", "steps", "run")
"""Labels of a scene."""


def machine() -> str:
    """On what the times were measured."""
    return (
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, {KERNEL} kernels"
    )


@contextmanager
def opened(folder: str, study: "Study") -> Iterator[tuple[Scenes, Keep]]:
    """The scenes that are stored below a folder, and what stores those of one more.

    Raises
    ------
    ConfigError, InputError
        The store is of another study, or at work, or damaged, or cannot be written.
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
    """Rows with None for what is not there."""
    for row in rows.to_dict("records"):
        yield {str(name): value if value == value else None for name, value in row.items()}


def key_of(scene: Key, solver: Solver) -> str:
    """The key of a row, in a store of one study."""
    return "/".join((*map(str, scene), name_of(solver)))


Size = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class Study:
    """What is to be done.

    Parameters
    ----------
    scene : Scene
        Scenario and area; targets and steps are those of the sizes.
    tracker : Tracker
        Its errors.
    seed : int
        Of the whole study.
    parameters : Parameters
        Of the metric.
    distance : Distance
        Between states.
    solvers : sequence of Solver
        With their settings.
    targets, steps : sequence of int
        All of the one with all of the other.
    runs : int
        Scenes of each size.
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
            least = min(sizes)
            if least < 1:
                raise ConfigError(f"{name} is {least}: must be 1 or more")
        for targets, steps in self.sizes:
            replace(self.scene, targets=targets, steps=steps)  # which checks both together

    @property
    def sizes(self) -> list[Size]:
        """Targets and steps of each size."""
        return [(targets, steps) for targets in self.targets for steps in self.steps]

    @property
    def settings(self) -> Json:
        """Everything that a record depends on, but for its own size and number."""
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
        """Targets, steps and number of each scene: every size once before any a second time."""
        for run in range(1, self.runs + 1):
            for targets, steps in self.sizes:
                yield targets, steps, run


def carry_out(
    study: Study,
    known: Scenes,
    keep: Keep = lambda _: None,
    notify: Callable[[str, float], None] = lambda text, share: None,  # noqa: ARG005
) -> list[list[Row]]:
    """The rows of all scenes that are wanted; those that are not known are made.

    Parameters
    ----------
    study : Study
        What is wanted.
    known : dict
        Rows by targets, steps and number.
    keep : callable
        Gets the rows of every new scene at once.
    notify : callable
        Gets what is next, and the share that is done.
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
    """One scene through all solvers; what fails is a row, and does not stop the study."""
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
    except Exception as error:  # whatever it is: the other scenes are to be done
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
    """The JSON document: mean and spread of each size and solver."""
    by_size: dict[str, list[list[Json]]] = {f"{m}/{steps}": [] for m, steps in study.sizes}
    opposed = []
    for rows in scenes:
        runs = [_run(row) for row in rows]
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
        "sizes": [_size(size, found, study) for size, found in sizes],
        "contradictions": opposed,
    }


def _run(row: Row) -> Json:
    """A row by the names of a run of a solver."""
    has = row["status"] != "failed"
    return {**row, "name": row[LABEL + "solver"], "total": row["total_upper"] if has else None}


def _size(size: Size, scenes: Sequence[Sequence[Json]], study: Study) -> Json:
    """All scenes of one size; those whose brackets contradict each other have no part in means."""
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
    """One solver on all scenes of one size; errors against what all solvers prove of a scene."""
    every = [runs[k] for runs in scenes]
    known = [(runs[k], referee(runs)) for runs in sound if runs[k]["total"] is not None]
    found = [errors(run, total) for run, total in known]
    above = [error for error, _ in found if error is not None]
    return {
        "name": name_of(solver),
        "solver": solver.name,
        "epsilon": solver.epsilon,
        "seconds": spread(run["seconds"] for run, _ in known),
        "error": spread(error for error in above if math.isfinite(error)),
        "infinite_errors": sum(map(math.isinf, above)),
        "lower_error": spread(below for _, below in found),
        "entropic_error": spread(entropic_error(run["entropic.dual"], own) for run, own in known),
        "entropic_cost_error": spread(
            entropic_error(run["entropic.cost"], own) for run, own in known
        ),
        "iterations": spread(run["iterations"] for run, _ in known),
        "failed": sum(run["status"] == "failed" for run in every),
        "unfinished": sum(run["status"] == "open" for run in every),
    }


def spread(values: Iterable[float | None]) -> Json:
    """Mean, standard deviation (divisor n - 1) and largest of those that are there."""
    numbers = np.array([value for value in values if value is not None], float)
    return {
        "mean": float(numbers.mean()) if len(numbers) else None,
        "deviation": float(numbers.std(ddof=1)) if len(numbers) > 1 else None,
        "max": float(numbers.max()) if len(numbers) else None,
    }
