"""Ignored truths and excused estimates, against the linear programme of the definition."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
from claims import totals
from exact_lp import Costs, costs_of, solve
from strategies import scene

import tgospa_eval
from tgospa_eval import Result, evaluate, sweep

SCENES, MORE = 25, 1125
SHARES = (0.0, 0.3, 0.7, 1.0)
NARROW = Fraction(1, 10**18)


class Masked:
    """A random scene on a grid of eighths, so that costs are integers, with random marks."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        m, n, steps = rng.integers(1, 5), rng.integers(1, 5), rng.integers(1, 9)
        truth, estimate = scene(seed, m, n, steps, side=4.0)
        self.truth, self.estimate = np.round(truth * 8) / 8, np.round(estimate * 8) / 8
        self.c, self.p = float(rng.choice([1, 2, 3])), float(rng.choice([1, 2, 2, 3]))
        self.gamma = float(rng.choice([0, 0.5, 1, 2]))
        self.ignored = rng.random((steps, self.truth.shape[1])) < rng.choice(SHARES)
        self.excused = rng.random((steps, self.estimate.shape[1])) < rng.choice(SHARES)
        self.distance = str(rng.choice(["euclidean", "manhattan", "chebyshev"]))

    def evaluate(self, **options: object) -> Result:
        """With both sides as tables."""
        return evaluate(
            table(self.truth, ignored=self.ignored),
            table(self.estimate, excused=self.excused),
            cutoff=self.c,
            order=self.p,
            switch_penalty=self.gamma,
            distance=self.distance,
            **{"ignore": "marked,marked-estimates", **options},
        )

    def costs(self) -> Costs:
        """``A = w c^p / 2, B = (1 - e) c^p / 2, D = min(w d^p, A + B)`` in integers."""
        given = costs_of(self.truth, self.estimate, self.c, self.p, self.gamma, self.distance)
        tables = []
        for costs, whole in ((given.low, given.cutoff[0]), (given.high, given.cutoff[1])):
            found = costs.copy()
            missed = np.where(self.ignored, 0, costs[:, :-1, -1])
            false = np.where(self.excused, 0, costs[:, -1, :-1])
            there = (costs[:, :-1, -1] > 0)[:, :, None] & (costs[:, -1, :-1] > 0)[:, None, :]
            near = there & (costs[:, :-1, :-1] < whole)
            neutral = missed[:, :, None] + false[:, None, :]
            error = np.where(self.ignored[:, :, None], 0, costs[:, :-1, :-1])
            found[:, :-1, :-1] = np.where(near, np.minimum(error, neutral), neutral)
            found[:, :-1, -1], found[:, -1, :-1] = missed, false
            tables.append(found)
        return replace(given, low=tables[0], high=tables[1])


def table(states: np.ndarray, **marks: np.ndarray) -> pd.DataFrame:
    step, track = np.nonzero(~np.isnan(states).any(axis=-1))
    columns = {"id": track, "t": step, "x": states[step, track, 0], "y": states[step, track, 1]}
    return pd.DataFrame(columns | {name: mark[step, track] for name, mark in marks.items()})


def check(seed: int, folder: str) -> None:
    """Bounds around the optimum in integers, counts, and both ends again from the proof folder."""
    masked = Masked(seed)
    result = masked.evaluate()
    reference = solve(masked.costs(), NARROW)
    low, high = (bound / reference.costs.cutoff[0] for bound in (reference.lower, reference.upper))
    lower, upper = totals(result)
    assert lower <= high
    assert low <= upper
    assert result.certified
    assert result.total == pytest.approx(
        sum(getattr(result, part) for part in ("localisation", "missed", "false", "switch")),
        abs=1e-12,
    )
    there = [~np.isnan(side).any(axis=-1) for side in (masked.truth, masked.estimate)]
    marks = masked.ignored & there[0], masked.excused & there[1]
    if not (marks[0].any() or marks[1].any()):
        assert result.ignored is None
        assert result.metric == "tgospa"
        return
    assert result.metric == "masked-tgospa"
    assert result.ignored is not None
    assert result.ignored["truth_states"] == marks[0].sum()
    assert result.ignored["excused"] == marks[1].sum()
    half = masked.c**masked.p / 2
    assert result.missed == pytest.approx(half * result.counts["missed"], abs=1e-12)
    assert result.false == pytest.approx(half * result.counts["false"], abs=1e-12)
    result.proof.save(folder, force=True)
    assert tgospa_eval.verify(folder)


def test_random_scenes_have_the_optimum_of_the_definition(tmp_path) -> None:
    for seed in range(SCENES):
        check(seed, str(tmp_path / "proof"))


@pytest.mark.slow
def test_a_thousand_random_scenes(tmp_path) -> None:
    for seed in range(SCENES, SCENES + MORE):
        check(seed, str(tmp_path / "proof"))


@pytest.mark.parametrize("solver", ["exact", "sinkhorn"])
def test_other_solvers_have_brackets_around_it(solver: str) -> None:
    for seed in range(6):
        masked = Masked(seed)
        result, certified = masked.evaluate(solver=solver), masked.evaluate()
        assert result.lower_bound <= certified.upper_bound
        assert certified.lower_bound <= result.upper_bound


def test_without_marks_every_bit_is_that_of_the_metric() -> None:
    for seed in range(12):
        masked = Masked(seed)
        masked.ignored[:], masked.excused[:] = False, False
        result, plain = masked.evaluate(), masked.evaluate(ignore=())
        assert result.proof.bounds == plain.proof.bounds
        for name in ("per_step", "assignments", "per_truth", "per_estimate", "switches"):
            assert result.table(name) == plain.table(name)


def test_what_follows_ignored_truths_is_free_and_one_estimate_alone() -> None:
    truth = pd.DataFrame({"id": 1, "t": [0, 1, 2], "x": 0.0, "ignored": [0, 1, 1]})
    one = pd.DataFrame({"id": 7, "t": [0, 1, 2], "x": 0.5})
    two = pd.concat([one, one.assign(id=8)])
    options = {"cutoff": 2.0, "order": 1.0, "switch_penalty": 0.5, "ignore": "marked"}
    assert evaluate(truth, one, **options).total == 0.5
    result = evaluate(truth, two, **options)
    assert result.total == 0.5 + 3 * 1.0  # the second is false throughout
    assert result.ignored == {"truth_states": 2, "absorbed": 2.0, "excused": 0}
    assert result.judged["truth_states"] == 1
    excused = two.assign(excused=(two.id == 8) & (two.t > 0))
    assert (
        evaluate(truth, excused, **options).total == result.total
    )  # nobody excuses itself unasked
    result = evaluate(truth, excused, **{**options, "ignore": "marked,marked-estimates"})
    assert result.total == 0.5 + 1.0
    assert result.table("assignments")["ignored"] == [0, 1, 1]


def test_an_excused_estimate_far_from_a_judged_truth_is_better_unassigned() -> None:
    """``d^p`` against ``c^p / 2`` (docs/theory/family.md)."""
    truth = pd.DataFrame({"id": 1, "t": [0], "x": 0.0})
    options = {"cutoff": 2.0, "order": 1.0, "switch_penalty": 0.5, "ignore": "marked-estimates"}
    for place, total in ((0.75, 0.75), (1.25, 1.0)):
        estimate = pd.DataFrame({"id": 7, "t": [0], "x": place, "excused": True})
        assert evaluate(truth, estimate, **options).total == total


@pytest.mark.parametrize("name", ["cutoff", "order", "switch_penalty", "rho"])
def test_each_point_of_a_sweep_is_an_evaluation(name: str) -> None:
    """With excuses rho changes which pairs gain, so it is solved at each value."""
    values = {"cutoff": [1.0, 2.5, 3.0], "order": [1, 2, 3], "switch_penalty": [0, 1, 2]}
    for seed in range(3):
        masked = Masked(seed)
        sides = (
            table(masked.truth, ignored=masked.ignored),
            table(masked.estimate, excused=masked.excused),
        )
        options = {"cutoff": masked.c, "order": masked.p, "switch_penalty": masked.gamma}
        options |= {"ignore": "marked,marked-estimates"}
        given = values.get(name, [0.2, 0.5, 0.9])
        swept = sweep(*sides, **{**options, name: given})
        for value, point in zip(given, swept.points, strict=True):
            assert point.certified
            total = evaluate(*sides, **{**options, name: value}).total
            assert point.total == pytest.approx(total, rel=1e-9, abs=1e-12)
