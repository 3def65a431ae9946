"""The normalised curve: each point is the metric of the steps up to it."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from answer import Invoke, Write
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import ORDERS, SWITCH, pairs_of_sets, scene

from tgospa_eval import Certified, ConfigError, Exact, evaluate

PARTS = ["localisation", "missed", "false", "switch"]


def same_as_separate(truth: np.ndarray, estimate: np.ndarray, **others: float) -> None:
    whole = evaluate(truth, estimate, **others, curve=True)
    curve = whole.curve
    assert len(curve) == len(truth)
    for k in range(len(truth)):
        alone = evaluate(truth[: k + 1], estimate[: k + 1], **others)
        point = curve.iloc[k]
        assert point["steps"] == k + 1
        assert point["tgospa"] == pytest.approx(alone.normalised["tgospa"], rel=2e-9, abs=1e-9)
        assert point["lower_bound"] <= point["tgospa"] <= point["upper_bound"]
        assert point["lower_bound"] == pytest.approx(point["tgospa"], rel=1e-9, abs=1e-9)
        assert point[PARTS].sum() * (k + 1) == pytest.approx(alone.total, rel=2e-9, abs=1e-9)
    assert whole.finished


@given(pairs_of_sets(most=4, most_steps=7), ORDERS, SWITCH)
@settings(max_examples=examples(8))
def test_points_are_separate_evaluations(
    sides: tuple[np.ndarray, np.ndarray], order: float, switch: float
) -> None:
    same_as_separate(*sides, cutoff=1.5, order=order, switch_penalty=switch)


@pytest.mark.parametrize("side", [12.0, 60.0])
def test_points_of_crowds_are_separate_evaluations(side: float) -> None:
    same_as_separate(*scene(5, 8, 9, 30, side=side), cutoff=5.0, switch_penalty=2.0)


def test_by_hand() -> None:
    # p = 1, c = 4, gamma = 2. Errors 1, then the track changes at step 3: up to step 2 nothing
    # but 1 + 1; later the change costs 2, and is taken when it saves more than it costs.
    truth = np.zeros((4, 1, 1))
    estimate = np.full((4, 2, 1), np.nan)
    estimate[:2, 0, 0] = 1.0
    estimate[2:, 1, 0] = 0.0
    curve = evaluate(truth, estimate, cutoff=4, order=1, switch_penalty=2, curve=True).curve
    assert curve["tgospa"].tolist() == [1, 1, 4 / 3, 1]
    assert curve["switch"].tolist() == [0, 0, 2 / 3, 1 / 2]
    assert curve["localisation"].tolist() == [1, 1, 2 / 3, 1 / 2]


def test_a_change_is_judged_by_what_is_known_by_then() -> None:
    # The estimate changes at the last step: a miss and a false target (4) are dearer than the
    # change (6) only when a second step follows. The whole takes the change, the beginning not.
    truth = np.zeros((4, 1, 1))
    estimate = np.full((4, 2, 1), np.nan)
    estimate[:2, 0, 0] = estimate[2:, 1, 0] = 0.0
    result = evaluate(truth, estimate, cutoff=4, order=1, switch_penalty=6, curve=True)
    assert result.total == 6
    assert (result.curve["tgospa"] * result.curve["steps"]).tolist() == [0, 0, 4, 6]
    assert (result.curve["missed"] * result.curve["steps"]).tolist() == [0, 0, 2, 0]


@given(st.integers(0, 1000))
@settings(max_examples=examples(8))
def test_a_time_limit_leaves_proven_brackets(seed: int) -> None:
    truth, estimate = scene(seed, 6, 7, 20, side=8.0)
    solver = Certified(time_limit=1e-9)
    curve = evaluate(truth, estimate, 5.0, 2, 2.0, solver=solver, curve=True).curve
    exact = evaluate(truth, estimate, 5.0, 2, 2.0, curve=True).curve
    assert (curve["lower_bound"] <= exact["tgospa"] * (1 + 1e-9)).all()
    assert (curve["tgospa"] >= exact["tgospa"] * (1 - 1e-9)).all()


def test_only_the_certified_solver_has_a_curve(invoke: Invoke, quickstart: tuple[str, str]) -> None:
    with pytest.raises(ConfigError, match="needs the solver certified, not exact"):
        evaluate(np.zeros((1, 1, 1)), np.zeros((1, 1, 1)), solver=Exact(), curve=True)
    answer = invoke(*quickstart, "--curve", "--solver", "sinkhorn")
    assert (answer.status, answer.out) == (2, "")
    assert "the curve needs the solver certified, not sinkhorn" in answer.err
    answer = invoke(*quickstart, "--curve", "--sweep", "cutoff=1,2")
    assert (answer.status, answer.out) == (2, "")


def test_table_json_and_file(invoke: Invoke, quickstart: tuple[str, str], tmp_path: Path) -> None:
    options = *quickstart, "-c", "10", "-g", "5", "--curve", "-q"
    answer = invoke(*options, "-o", str(tmp_path / "out"))
    assert answer.status == 0
    assert all(len(line) <= 80 for line in answer.out.splitlines())
    assert "for 56 values of t, all proven exact" in " ".join(answer.out.split())
    document = json.loads(invoke(*options, "--format", "json").out)
    assert len(document["curve"]) == 56
    assert document["curve"][-1]["tgospa"] == pytest.approx(document["normalised"]["tgospa"])
    with (tmp_path / "out" / "curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["tgospa"]) for row in rows] == [p["tgospa"] for p in document["curve"]]
    without = json.loads(invoke(*quickstart, "-q", "--format", "json").out)
    assert "curve" not in without


def test_what_is_not_exact_is_told_as_a_bound(invoke: Invoke, quickstart: tuple[str, str]) -> None:
    options = "-c", "10", "-g", "5", "--curve", "--time-limit", "1e-9"
    answer = invoke(*quickstart, *options)
    assert answer.status == 4
    assert "of them upper bounds" in " ".join(answer.out.split())
    rows = {words[0]: words[1:3] for words in map(str.split, answer.out.splitlines()) if words}
    assert rows["3"][0] == "7.0711"
    assert rows["9"] == ["<=", "6.7198"]  # exact: 6.5855
    assert "of the curve; requested: 1e-09" in answer.err


def test_curves_of_classes_add_up(invoke: Invoke, write: Write) -> None:
    truth = write("t.csv", "id,t,x,class\n1,0,0,a\n1,1,0,a\n2,0,5,b\n2,2,5,b\n")
    estimate = write("e.csv", "id,t,x,class\n1,0,1,a\n1,1,0,a\n2,0,5,b\n2,1,5,b\n")
    options = truth, estimate, "-c", "4", "-g", "2", "-p", "1", "--by", "class", "--curve", "-q"
    document = json.loads(invoke(*options, "--format", "json").out)
    # t = 0: 1; t = 1: a false b; t = 2: a missed b, halves of c
    assert [p["tgospa"] * p["steps"] for p in document["curve"]] == [1, 3, 5]


@pytest.mark.parametrize(("m", "n"), [(0, 0), (2, 0), (0, 2)])
def test_empty_sides(m: int, n: int) -> None:
    same_as_separate(np.zeros((3, m, 2)), np.zeros((3, n, 2)), cutoff=2.0, switch_penalty=1.0)
