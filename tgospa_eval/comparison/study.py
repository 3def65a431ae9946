"""The scaling study: solvers on made-up scenes of many sizes, several of each.

After figures 2 and 3 of Nevelius Wernholm, Wärnsäter and Ringh: error over temperature, time and
error over the number of targets and over the number of steps. Every scene has a seed of its own,
made of the seed of the study, the size and the number of the run: what is added later leaves what
is there as it is.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from tgospa_eval import __version__
from tgospa_eval.comparison import SCHEMA
from tgospa_eval.comparison.brackets import Bracket, overlap
from tgospa_eval.comparison.runs import PARTS, Run, run_here, warm_up
from tgospa_eval.comparison.solvers import Comparison, compare_solvers
from tgospa_eval.distances import Distance
from tgospa_eval.errors import ConfigError
from tgospa_eval.pipeline import prepare, solver_settings
from tgospa_eval.problem import Parameters
from tgospa_eval.simulation import Scene, Tracker, simulate
from tgospa_eval.solvers import Solver
from tgospa_eval.timing import Stopwatch

Document = dict[str, Any]
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
            for size in sizes:
                if size < 1:
                    raise ConfigError(f"{name} is {size}: must be 1 or more")
                replace(self.scene, **{name: size})

    @property
    def sizes(self) -> list[Size]:
        """Targets and steps of each size."""
        return [(targets, steps) for targets in self.targets for steps in self.steps]

    @property
    def settings(self) -> Document:
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
            "solvers": [solver_settings(s) | {"jobs": getattr(s, "jobs", 1)} for s in self.solvers],
        }

    def wanted(self) -> Iterator[tuple[int, int, int]]:
        """Targets, steps and number of each scene: every size once before any a second time."""
        for run in range(1, self.runs + 1):
            for targets, steps in self.sizes:
                yield targets, steps, run


def carry_out(
    study: Study,
    known: dict[tuple[int, int, int], Document],
    keep: Callable[[Document], None],
    say: Callable[[str], None] = lambda _: None,
) -> list[Document]:
    """The records of all scenes that are wanted; those that are not known are made.

    Parameters
    ----------
    study : Study
        What is wanted.
    known : dict
        Records by targets, steps and number.
    keep : callable
        Gets every new record at once.
    say : callable
        Told what is next.
    """
    wanted = list(study.wanted())
    if any(key not in known for key in wanted):
        for solver in study.solvers:
            warm_up(solver)
    records = []
    for done, key in enumerate(wanted):
        if key not in known:
            targets, steps, run = key
            say(f"{targets} targets, {steps} steps, run {run} ({done} of {len(wanted)})")
            known[key] = measure(study, *key)
            keep(known[key])
        records.append(known[key])
    return records


def measure(study: Study, targets: int, steps: int, run: int) -> Document:
    """One scene through all solvers."""
    rng = np.random.default_rng([study.seed, targets, steps, run])
    sides = simulate(replace(study.scene, targets=targets, steps=steps), study.tracker, rng)
    stopwatch = Stopwatch()
    prepared = prepare(
        *sides, parameters=study.parameters, distance=study.distance, stopwatch=stopwatch
    )
    found = compare_solvers(prepared, study.solvers, run_here)
    problem = prepared.states.problem
    occupied = len(np.union1d(problem.truth_step, problem.estimate_step))
    return {
        "targets": targets,
        "steps": steps,
        "run": run,
        "occupied": max(occupied, 1),
        "sizes": {**prepared.sizes, "states": len(prepared.states.begin)},
        "prepare_seconds": sum(
            stopwatch.spans[name] for name in ("distances", "solve/preparation")
        ),
        "runs": [
            {
                "name": made.name,
                "solver": made.solver,
                "epsilon": made.epsilon,
                "lower": made.bracket.lower,
                "upper": made.bracket.upper,
                "allowance": made.bracket.allowance,
                **made.parts,
                "iterations": made.iterations,
                "finished": made.finished,
                "status": made.status,
                "seconds": made.seconds["solve"] + made.seconds["certify"],
            }
            for made in found.runs
        ],
    }


def document(study: Study, records: Sequence[Document], machine: str) -> Document:
    """The JSON document: mean and spread of each size and solver."""
    return {
        "schema": SCHEMA,
        "version": __version__,
        "kind": "study",
        **study.settings,
        "machine": machine,
        "runs": study.runs,
        "sizes": [
            _size(
                [r for r in records if (r["targets"], r["steps"]) == size],
                study.parameters.order,
            )
            for size in study.sizes
        ],
        "contradictions": [
            [r["targets"], r["steps"], r["run"], a["name"], b["name"]]
            for r in records
            for k, a in enumerate(r["runs"])
            for b in r["runs"][k + 1 :]
            if not overlap(_bracket(a), _bracket(b))
        ],
    }


def _size(records: Sequence[Document], order: float) -> Document:
    """All scenes of one size."""
    best = [min(record["runs"], key=lambda made: made["upper"]) for record in records]
    shares = np.array([record["occupied"] for record in records], float)

    def root(name: str) -> float:
        costs = np.array([made[name] for made in best])
        return float(np.mean(costs / shares) ** (1 / order))

    return {
        "targets": records[0]["targets"],
        "steps": records[0]["steps"],
        "states": spread([record["sizes"]["states"] for record in records]),
        "prepare_seconds": spread([record["prepare_seconds"] for record in records]),
        "normalised": {"tgospa": root("upper"), **{name: root(name) for name in PARTS}},
        "solvers": [_solver(records, k) for k in range(len(records[0]["runs"]))],
    }


def _solver(records: Sequence[Document], k: int) -> Document:
    """One solver on all scenes of one size; errors against what all solvers prove of a scene."""
    errors, lower_errors = [], []
    for record in records:
        runs = [_run(made) for made in record["runs"]]
        comparison = Comparison(runs=runs)
        errors.append(comparison.error(runs[k]))
        lower_errors.append(comparison.lower_error(runs[k]))
    made = [record["runs"][k] for record in records]
    return {
        "name": made[0]["name"],
        "solver": made[0]["solver"],
        "epsilon": made[0]["epsilon"],
        "seconds": spread([run["seconds"] for run in made]),
        "error": spread([error for error in errors if math.isfinite(error)]),
        "lower_error": spread(lower_errors),
        "iterations": spread([run["iterations"] for run in made]),
        "unfinished": sum(not run["finished"] for run in made),
    }


def spread(values: Sequence[float]) -> Document:
    """Mean, standard deviation (divisor n - 1) and largest; null where there is none."""
    if not len(values):
        return {"mean": None, "deviation": None, "max": None}
    numbers = np.asarray(values, float)
    return {
        "mean": float(numbers.mean()),
        "deviation": float(numbers.std(ddof=1)) if len(numbers) > 1 else None,
        "max": float(numbers.max()),
    }


def _bracket(made: Document) -> Bracket:
    return Bracket(lower=made["lower"], upper=made["upper"], allowance=made["allowance"])


def _run(made: Document) -> Run:
    return Run(
        solver=made["solver"], epsilon=made["epsilon"], bracket=_bracket(made),
        tgospa=math.nan, lower_bound=math.nan, parts={}, counts={}, status=made["status"],
        finished=made["finished"], iterations=made["iterations"], seconds={},
    )  # fmt: skip
