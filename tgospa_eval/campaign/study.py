"""The scaling study: solvers on synthetic scenes of many sizes, several of each.

After figures 2 and 3 of Nevelius Wernholm, Wärnsäter and Ringh: error over temperature, time and
error over the number of targets and over the number of steps. Every scene has a seed of its own,
made of the seed of the study, the size and the number of the run: what is added later leaves what
is there as it is.
"""

import json
import math
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from operator import itemgetter
from pathlib import Path
from typing import NoReturn

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.campaign import SCHEMA
from tgospa_eval.campaign.solver_runs import (
    RUN,
    compare_solvers,
    contradictions,
    errors,
    failed,
    judge_entropic,
    referee,
    spent,
    warm_up,
)
from tgospa_eval.campaign.store import locked
from tgospa_eval.common.documents import (
    ANYTHING,
    COST,
    COUNT,
    FLAG,
    NULL,
    NUMBER,
    TEXT,
    Closed,
    OrNull,
    fault,
    or_null,
    strict_json,
)
from tgospa_eval.common.files import is_missing, is_regular, named
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
from tgospa_eval.results.records import COUNTED_PARTS, PARTS, Json
from tgospa_eval.simulation import Scene, Tracker, simulate
from tgospa_eval.solvers import Solver

Key = tuple[int, int, int]
"""Targets, steps and number of a scene."""

LOG_SCHEMA = "tgospa-eval/study/3"
LOG_NAME = "runs.jsonl"

RECORD = Closed(
    {
        **dict.fromkeys(("targets", "steps", "run"), COUNT),
        "occupied": or_null(COUNT),
        "sizes": OrNull({"states": COUNT}),
        "prepare_seconds": or_null(COST),
        "runs": [Closed(dict.fromkeys(RUN, ANYTHING))],
    }
)
"""Description of a record."""

ABOUT = {**dict.fromkeys(("name", "solver", "status"), TEXT), "finished": FLAG}
FAILED = {
    **dict.fromkeys(RUN, NULL),
    **ABOUT,
    **dict.fromkeys(("epsilon", "counts", "history"), ANYTHING),
}
DONE = {
    **ABOUT,
    "epsilon": or_null(COST),
    "counts": dict.fromkeys(COUNTED_PARTS, COST),
    **dict.fromkeys(("tgospa", "lower_bound", "total", "total_lower", *PARTS), COST),
    "iterations": COUNT,
    "seconds": {"solve": COST, "certify": COST},
    "entropic": OrNull(
        {"dual": NUMBER, "cost": NUMBER, **dict.fromkeys(("error", "cost_error"), or_null(NUMBER))}
    ),
}
"""Descriptions of the runs of solvers that failed, and of others."""


def machine() -> str:
    """On what the times were measured."""
    return (
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, {KERNEL} kernels"
    )


class Log:
    """The records of a study that are there, and the file to which more are added.

    Parameters
    ----------
    folder : str
        Where it is, or shall be.
    settings : dict
        What the records depend on.

    Attributes
    ----------
    known : dict
        Records by targets, steps and number of the run.

    Raises
    ------
    ConfigError
        The file is of another study, or no file of ours, or damaged, or cannot be read or written.
    """

    def __init__(self, folder: str, settings: Json) -> None:
        self.path = Path(folder) / LOG_NAME
        self.known: dict[Key, Json] = {}
        header = {
            "schema": LOG_SCHEMA,
            "version": __version__,
            "machine": machine(),
            "settings": settings,
        }
        with named(str(self.path), ConfigError, "cannot be opened"):
            there = not is_missing(str(self.path))
            if there and not is_regular(str(self.path)):
                self._refuse()
            content = self.path.read_bytes() if there else b""
        whole, solvers = content.rfind(b"\n") + 1, len(settings["solvers"])
        first = json.dumps(header, sort_keys=True)
        if not whole and not first.encode().startswith(content):  # not even its begin
            self._refuse()
        for number, line in enumerate(content[:whole].splitlines(), start=1):
            try:
                document = strict_json(line)
                wrong = None if number == 1 else record_fault(document, solvers)
            except ValueError as error:
                document, wrong = None, str(error)
            if number == 1:
                self._check(json.loads(first), document)
                continue
            if wrong:
                raise ConfigError(
                    f"{self.path}, line {number}: no record of this study: {wrong}; remove the "
                    "line, or name another folder"
                )
            self.known[document["targets"], document["steps"], document["run"]] = document
        if whole < len(content):  # killed in the middle of a line
            os.truncate(self.path, whole)
        if not whole:
            self.keep(header)

    def keep(self, record: Mapping[str, object]) -> None:
        """Add a record; it is on the disk when this returns."""
        line = json.dumps(record, sort_keys=True, allow_nan=False) + "\n"
        with (
            named(str(self.path), ConfigError, "cannot be written"),
            self.path.open("ab") as file,
        ):
            file.write(line.encode())
            file.flush()
            os.fsync(file.fileno())

    def _refuse(self) -> NoReturn:
        raise ConfigError(f"{self.path}: not the file of a study; name another folder")

    def _check(self, own: Json, header: object) -> None:
        """The settings must be the same."""
        if not isinstance(header, dict) or header.get("schema") != LOG_SCHEMA:
            self._refuse()
        mine, other = _flat(own), _flat(header)
        for name in [*mine, *other]:
            if mine.get(name) != other.get(name):
                raise ConfigError(
                    f"{self.path}: is of a study with another {name.removeprefix('settings.')} "
                    f"({other.get(name)}, now {mine.get(name)}); name another folder"
                )


@contextmanager
def opened(folder: str, settings: Json) -> Iterator[Log]:
    """The log of a study, for one process at a time; arguments and errors as of `Log`."""
    with named(os.path.join(folder, LOG_NAME), ConfigError, "cannot be opened"):
        os.makedirs(folder, exist_ok=True)
    with locked(Path(folder), (0, 1)):
        yield Log(folder, settings)


def record_fault(document: object, solvers: int) -> str | None:
    """The first field of a record of so many solvers that is missing or wrong; None if none."""
    wrong = fault(document, RECORD)
    if wrong or not isinstance(document, dict):
        return wrong
    runs = document["runs"]
    if len(runs) != solvers:
        return f"runs has {len(runs)} items; expected {solvers}"
    kinds = (FAILED if run["total"] is None else DONE for run in runs)
    each = enumerate(zip(runs, kinds, strict=True))
    return next(filter(None, (fault(run, kind, f"runs[{k}]") for k, (run, kind) in each)), None)


def _flat(document: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    """Values by dotted names."""
    found: dict[str, object] = {}
    for name, value in document.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{name}.")
        else:
            found[prefix + name] = value
    return found


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
    known: dict[Key, Json],
    keep: Callable[[Json], None],
    notify: Callable[[str, float], None] = lambda text, share: None,  # noqa: ARG005
) -> list[Json]:
    """The records of all scenes that are wanted; those that are not known are made.

    Parameters
    ----------
    study : Study
        What is wanted.
    known : dict
        Records by targets, steps and number.
    keep : callable
        Gets every new record at once.
    notify : callable
        Gets what is next, and the share that is done.
    """
    if any(key not in known for key in study.wanted()):
        warm_up(study.solvers)
    count = len(study.sizes) * study.runs
    records = []
    for done, key in enumerate(study.wanted()):
        if key not in known:
            targets, steps, run = key
            size = f"{counted(targets, 'target')}, {counted(steps, 'step')}"
            notify(f"{size}, run {run} ({done} of {count})", done / count)
            known[key] = measure(study, *key)
            keep(known[key])
        records.append(known[key])
    return records


def measure(study: Study, targets: int, steps: int, run: int) -> Json:
    """One scene through all solvers; what fails is recorded, and does not stop the study."""
    rng = np.random.default_rng([study.seed, targets, steps, run])
    stopwatch = Stopwatch()
    request = EvaluationRequest(
        parameters=study.parameters, distance=study.distance, solver=study.solvers[0]
    )
    record: Json = {**dict.fromkeys(RECORD), "targets": targets, "steps": steps, "run": run}
    try:
        sides = simulate(replace(study.scene, targets=targets, steps=steps), study.tracker, rng)
        prepared = prepare(fit(*sides, request), request, stopwatch=stopwatch)
    except Exception as error:  # whatever it is: the other scenes are to be done
        record["runs"] = [failed(solver, error) for solver in study.solvers]
        return record
    problem = prepared.states.problem
    record["occupied"] = max(len(np.union1d(problem.truth_step, problem.estimate_step)), 1)
    record["sizes"] = {**prepared.sizes, "states": len(prepared.states.begin)}
    record["prepare_seconds"] = sum(
        stopwatch.spans[name] for name in ("distances", "solve/preparation")
    )
    found = compare_solvers(prepared, study.solvers)
    for made in found:
        made |= {"history": [], "memory": None}
        if made["entropic"] is not None:
            judge_entropic(made, referee(found))
            del made["entropic"]["history"]
    record["runs"] = found
    return record


def study_document(study: Study, records: Sequence[Json], machine: str) -> Json:
    """The JSON document: mean and spread of each size and solver."""
    by_size: dict[Size, list[Json]] = {size: [] for size in study.sizes}
    for record in records:
        by_size[record["targets"], record["steps"]].append(record)
    return {
        "schema": SCHEMA,
        "version": __version__,
        "kind": "study",
        **study.settings,
        "machine": machine,
        "runs": study.runs,
        "sizes": [_size(size, scenes, study) for size, scenes in by_size.items()],
        "contradictions": [
            (record["targets"], record["steps"], record["run"], *pair)
            for scenes in by_size.values()
            for record in scenes
            for pair in contradictions(record["runs"])
        ],
    }


def _size(size: Size, scenes: Sequence[Json], study: Study) -> Json:
    """All scenes of one size; those whose brackets contradict each other have no part in means."""
    sound = [record for record in scenes if not contradictions(record["runs"])]
    best = [
        (min(answered, key=itemgetter("total")), record["occupied"] or 1)
        for record in sound
        if (answered := [run for run in record["runs"] if run["total"] is not None])
    ]
    order = study.parameters.order
    costs: dict[str, str] = {"tgospa": "total", **{name: name for name in PARTS}}
    normalised = {
        name: float(np.mean([run[cost] / steps for run, steps in best]) ** (1 / order))
        if best
        else None
        for name, cost in costs.items()
    }
    return {
        "targets": size[0],
        "steps": size[1],
        "left_out": len(scenes) - len(best),
        "states": spread(record["sizes"] and record["sizes"]["states"] for record in scenes),
        "prepare_seconds": spread(record["prepare_seconds"] for record in scenes),
        "normalised": normalised,
        "solvers": [_solver(scenes, sound, k) for k in range(len(study.solvers))],
    }


def _solver(scenes: Sequence[Json], sound: Sequence[Json], k: int) -> Json:
    """One solver on all scenes of one size; errors against what all solvers prove of a scene."""
    every = [record["runs"][k] for record in scenes]
    made = [run for record in sound if (run := record["runs"][k])["total"] is not None]
    found = [errors(record["runs"][k], referee(record["runs"])) for record in sound]
    above = [error for error, _ in found if error is not None]
    entropic = [run["entropic"] for run in made if run["entropic"] is not None]
    return {
        "name": every[0]["name"],
        "solver": every[0]["solver"],
        "epsilon": every[0]["epsilon"],
        "seconds": spread(map(spent, made)),
        "error": spread(error for error in above if math.isfinite(error)),
        "infinite_errors": sum(map(math.isinf, above)),
        "lower_error": spread(below for _, below in found),
        "entropic_error": spread(value["error"] for value in entropic),
        "entropic_cost_error": spread(value["cost_error"] for value in entropic),
        "iterations": spread(run["iterations"] for run in made),
        "failed": sum(run["total"] is None for run in every),
        "unfinished": sum(not run["finished"] and run["total"] is not None for run in every),
    }


def spread(values: Iterable[float | None]) -> Json:
    """Mean, standard deviation (divisor n - 1) and largest of those that are there."""
    numbers = np.array([value for value in values if value is not None], float)
    return {
        "mean": float(numbers.mean()) if len(numbers) else None,
        "deviation": float(numbers.std(ddof=1)) if len(numbers) > 1 else None,
        "max": float(numbers.max()) if len(numbers) else None,
    }
