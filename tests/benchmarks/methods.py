"""Everything that is timed on one instance of a scene, each giving seconds and a bracket."""

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import child
import numpy as np
from scenes import Scene
from yardsticks import CUTOFF, ORDER, SWITCH_PENALTY, distance_table, gain_programme

from tgospa_eval import Certified, Exact, Sinkhorn, evaluate
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.solution import Bounds
from tgospa_eval.problem.states import merge_runs
from tgospa_eval.solvers import Solver

EXACT = 1e-9
REFEREE = 1e-6
BRACKET = 0.01
"""Relative gaps of the total that the solvers are asked for."""

COLDEST = 0.001
"""Where the ladder of temperatures ends; it stops as soon as the bracket is met."""

LP_LIMIT = 60.0
SLOW_LIMIT = 60.0
"""Seconds for the referee, for the naive programme and for the code of others."""

EXACT_MOST = 20_000
NAIVE_MOST = 60_000
"""Gains, and variables, above which those two do not end in a minute: not started."""

PUBLISHED_MOST = 1_300_000
"""Variables above which the published code is not started: these take a minute and 6 GB."""


@dataclass(frozen=True)
class Reading:
    """Seconds, and the total in units of c^p as a bracket, as wide as that for a mere timing.

    `complete` is False if what was asked for was not reached: then the seconds are a lower bound.
    `states` are those of the problem, if the method has any.
    """

    seconds: float
    lower: float = 0.0
    upper: float = sys.float_info.max
    complete: bool = True
    states: int = 0


class Instance:
    """One draw of a scene, and what is timed on it.

    Parameters
    ----------
    scene : Scene
    seed : int
    """

    published: ClassVar[Path | None] = None
    """Folder with TGOSPAMetric.py and utils.py of the authors of the metric, if there is one."""

    def __init__(self, scene: Scene, seed: int) -> None:
        self.scene, self.seed = scene, seed
        self.truth, self.estimate = scene.arrays(seed)
        self._problem: Problem | None = None
        self.methods: dict[str, Callable[[], Reading]] = {
            "certified": lambda: self._evaluate(Certified(), EXACT),
            "bracket": lambda: self._evaluate(Sinkhorn(epsilon=COLDEST, gap=BRACKET), BRACKET),
            "certified from problem": lambda: self._solve(Certified(), EXACT),
            "bracket from problem": lambda: self._solve(
                Sinkhorn(epsilon=COLDEST, gap=BRACKET), BRACKET
            ),
            "floor": self._floor,
            "lp": lambda: self._programme(presolve=True),
            "lp without presolve": lambda: self._programme(presolve=False),
            "exact": lambda: self._evaluate(Exact(time_limit=SLOW_LIMIT), REFEREE),
            "naive": lambda: self._in_child("naive"),
            "stone soup": self._stone_soup,
        }
        if self.published is not None:
            self.methods["published"] = lambda: self._in_child("published", self.published)

    def offers(self, method: str) -> bool:
        """Whether the method has a chance at this size."""
        if method == "exact":
            gains = np.count_nonzero(distance_table(self.truth, self.estimate) < CUTOFF)
            return bool(gains <= EXACT_MOST)
        most = {"naive": NAIVE_MOST, "published": PUBLISHED_MOST}
        return naive_size(self.scene) <= most.get(method, sys.maxsize)

    def problem(self) -> Problem:
        """The dimensionless problem, from the last evaluation or from one for this purpose."""
        if self._problem is None:
            self._evaluate(Certified(), EXACT)
        assert self._problem is not None
        return self._problem

    def _evaluate(self, solver: Solver, gap: float) -> Reading:
        begin = time.perf_counter()
        result = evaluate(self.truth, self.estimate, CUTOFF, ORDER, SWITCH_PENALTY, solver=solver)
        seconds = time.perf_counter() - begin
        states = result.proof.states
        self._problem = states.problem
        return replace(_reading(seconds, result.proof.bounds, gap), states=len(states.begin))

    def _solve(self, solver: Solver, gap: float) -> Reading:
        problem = self.problem()
        begin = time.perf_counter()
        states = merge_runs(problem)
        bounds, _, _ = certify(states, solver(states, Stopwatch()))
        return _reading(time.perf_counter() - begin, bounds, gap)

    def _floor(self) -> Reading:
        begin = time.perf_counter()
        distance_table(self.truth, self.estimate)
        return Reading(time.perf_counter() - begin)

    def _programme(self, *, presolve: bool) -> Reading:
        begin = time.perf_counter()
        value = gain_programme(self.truth, self.estimate, presolve=presolve, seconds=LP_LIMIT)
        return _value(time.perf_counter() - begin, value)

    def _stone_soup(self) -> Reading:
        """A lower bound: the metric without switches, which is checked."""
        reading = self._in_child("stone soup")
        if reading.complete:
            total = evaluate(self.truth, self.estimate, CUTOFF, ORDER, 0.0).total / CUTOFF**ORDER
            assert math.isclose(reading.lower, total, rel_tol=REFEREE), (reading.lower, total)
        return replace(reading, upper=sys.float_info.max)

    def _in_child(self, programme: str, *folders: Path) -> Reading:
        found = child.measure(programme, self.scene, self.seed, SLOW_LIMIT, folders)
        return _value(SLOW_LIMIT, None) if found is None else _value(found[1], found[0])


def naive_size(scene: Scene) -> int:
    """Assignment variables of the programme of the definition."""
    return (scene.targets + 1) * (scene.estimates + 1) * scene.steps


def _reading(seconds: float, bounds: Bounds, gap: float) -> Reading:
    return Reading(seconds, bounds.lower, bounds.upper, complete=bounds.met(gap))


def _value(seconds: float, value: float | None) -> Reading:
    """Reading of a programme that gives the metric and no bracket."""
    if value is None:
        return Reading(seconds, complete=False)
    total = (value / CUTOFF) ** ORDER
    return Reading(seconds, total, total)
