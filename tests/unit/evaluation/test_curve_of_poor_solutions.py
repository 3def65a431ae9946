"""The curve of a solution that is not the best."""

from dataclasses import replace
from functools import partialmethod
from typing import Any

import numpy as np
import pytest
from strategies import scene

from tgospa_eval import Certified, evaluate
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.evaluation.curve import SeparateStretches, SuffixSolver, trace
from tgospa_eval.problem.prefixes import Cells
from tgospa_eval.problem.states import merge_runs, repair


def test_the_last_point_is_the_solution_however_bad() -> None:
    truth, estimate = scene(4, 4, 5, 20, side=6.0)
    states = evaluate(truth, estimate, 3.0, 2, 1.0).proof.states
    nothing = np.zeros(len(states.begin), np.int64)
    curve = trace(states, nothing, np.zeros(len(states.columns.step)), Certified())
    free = states.problem.truth_price.sum() + states.problem.estimate_price.sum()
    assert curve.upper[-1] == pytest.approx(free, rel=1e-12)
    assert curve.lower[-1] < free
    assert curve.met(1e-9)[:-1].all()
    for k in (0, 9, 18):
        alone = evaluate(truth[: k + 1], estimate[: k + 1], 3.0, 2, 1.0).proof.bounds
        assert curve.upper[k] == pytest.approx(alone.upper, rel=2e-9)
        assert curve.lower[k] <= alone.upper


def test_a_part_that_falls_to_nothing_is_not_negative() -> None:
    # a root of -3e-17 would be no number
    values = np.append(np.random.default_rng(0).exponential(1, (50, 4)), np.zeros((50, 1)), axis=1)
    cells = Cells(first=np.array([0, 5]), begin=np.array([0]))
    assert np.cumsum(np.diff(values, prepend=0.0), axis=1).min() < 0
    for value in values:
        assert cells.totals(value, 5)[0] == pytest.approx(value, abs=1e-15)
        assert cells.totals(value, 5)[0].min() >= 0


@pytest.mark.parametrize("varies", [False, True])
def test_endings_prove_what_whole_beginnings_do(
    varies: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth, estimate = scene(2, 5, 6, 40, side=12.0, noise=1.0)
    problem = evaluate(truth, estimate, 4.0, 2, 1.5).proof.states.problem
    if varies:
        price = np.random.default_rng(0).uniform(0.02, 0.3, problem.steps - 1)
        problem = replace(problem, switch_price=price)
    states = merge_runs(problem)
    solution = Certified()(states, Stopwatch())
    weights = repair(states, solution.weights)
    asked: list[tuple[type, int]] = []
    for kind in (SuffixSolver, SeparateStretches):

        def solve(self: Any, *given: Any, kind: type, true: Any) -> Any:
            asked.append((kind, len(self.joint.block if kind is SeparateStretches else given[0])))
            return true(self, *given)

        monkeypatch.setattr(kind, "solve", partialmethod(solve, kind=kind, true=kind.solve))
    few = trace(states, weights, solution.prices, Certified())
    assert sum(count for kind, count in asked if kind is SuffixSolver) > 5
    asked.clear()
    monkeypatch.setattr("tgospa_eval.evaluation.curve.SPAN", 1000)
    whole = trace(states, weights, solution.prices, Certified())
    assert {kind for kind, _ in asked} == {SeparateStretches}
    assert few.met(1e-9).all()
    assert whole.met(1e-9).all()
    assert (few.lower <= whole.upper).all()
    assert (whole.lower <= few.upper).all()
