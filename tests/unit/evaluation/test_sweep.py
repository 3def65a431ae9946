"""Sweeps of a parameter: every point is a separate evaluation, however it was found."""

import json
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from answer import Invoke, Write
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import ORDERS, pairs_of_sets, scene

from tgospa_eval import Certified, ConfigError, Sinkhorn, Sweep, evaluate, sweep
from tgospa_eval.cli.evaluate.sweep import parse_sweep
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import as_distance
from tgospa_eval.evaluation import sweep as sensitivity
from tgospa_eval.evaluation.prepare import MeasuredSides, NearPairs, fit, measure
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import ReadOptions
from tgospa_eval.formats.objects import read_object
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.states import ONE, States
from tgospa_eval.solvers.warm_start import SavedSolution, make_warm_start, save_solution

Pair = tuple[str, str]

VALUES = {
    "cutoff": [0.4, 0.8, 1.1, 1.6, 3.0],
    "switch_penalty": [0.0, 0.1, 0.5, 1.5, 1e200],
    "order": [1.0, 1.5, 2.5],
}
PARTS = ("localisation", "missed", "false", "switch")


def same_as_separate(
    found: Sweep, truth: np.ndarray, estimate: np.ndarray, **others: float
) -> None:
    """Values to 1e-9, and each certified by itself; the parts may differ where optima tie."""
    for point in found.points:
        alone = evaluate(truth, estimate, **(others | {found.parameter: point.value}))
        assert alone.certified
        assert point.certified
        assert point.total == pytest.approx(alone.total, rel=2e-9, abs=1e-12)
        assert point.lower_bound <= point.tgospa
        assert sum(getattr(point, part) for part in PARTS) == pytest.approx(point.total)


@given(pairs_of_sets(), st.sampled_from(sorted(VALUES)), ORDERS)
@settings(max_examples=examples(30))
def test_points_are_separate_evaluations(
    sides: tuple[np.ndarray, np.ndarray], name: str, order: float
) -> None:
    others = {"cutoff": 1.0, "order": order, "switch_penalty": 0.5}
    del others[name]
    with patch.multiple(
        sensitivity, EASY_WORK=-1, EASY_ITERATIONS=-1
    ):  # neighbours are asked, always
        found = sweep(*sides, **others, **{name: VALUES[name]})
    same_as_separate(found, *sides, **others)


@pytest.mark.parametrize("name", ["cutoff", "switch_penalty"])
@pytest.mark.parametrize("side", [12.0, 40.0])
def test_crowded_points_are_separate_evaluations(name: str, side: float) -> None:
    truth, estimate = scene(7, 10, 12, 30, side=side)
    others = {"cutoff": 6.0, "switch_penalty": 3.0}
    del others[name]
    with patch.multiple(sensitivity, EASY_WORK=-1, EASY_ITERATIONS=-1):
        found = sweep(truth, estimate, **others, **{name: np.linspace(1.0, 9.0, 9)})
    same_as_separate(found, truth, estimate, **others)


def test_by_hand() -> None:
    # p = 1: errors 1, 1, 3; with c = 2 the last is a miss and a false target, c/2 each, and going
    # out of the track costs half of gamma less than a change: the track is held, which is free
    truth = np.zeros((3, 1, 1))
    estimate = np.array([1.0, 1.0, 3.0]).reshape(3, 1, 1)
    found = sweep(truth, estimate, cutoff=[4, 2, 3], order=1, switch_penalty=1)
    assert [(p.value, p.total) for p in found.points] == [(2, 4), (3, 5), (4, 5)]
    assert [(p.missed_count, p.false_count) for p in found.points] == [(1, 1), (1, 1), (0, 0)]
    assert found.unchanged("missed_count", "false_count") == (0, 1)
    assert found.unchanged("switch_count") == (0, 2)
    assert list(found.table())[:3] == ["cutoff", "tgospa", "lower_bound"]
    assert found.table()["total"].tolist() == [4, 5, 5]
    assert "order" in found.settings
    assert "cutoff" not in found.settings


# --- what neighbours say --------------------------------------------------------------------------


def measured(
    truth: np.ndarray, estimate: np.ndarray, cutoff: float
) -> tuple[MeasuredSides, NearPairs]:
    request = EvaluationRequest(
        parameters=Parameters(cutoff=cutoff, order=2, switch_penalty=0.0),
        distance=as_distance("euclidean"),
        solver=Certified(),
    )
    sides = [read_object(side, ReadOptions(), "side").trajectories for side in (truth, estimate)]
    return measure(fit(*sides, request), request, cutoff=cutoff, stopwatch=Stopwatch())


def solved(states: States) -> tuple[SavedSolution, float]:
    """What is kept, and the lower bound in units of c^p."""
    solution = Certified(jobs=1)(states, Stopwatch())
    prices = solution.prices.copy()
    bounds, weights, _ = certify(states, solution)
    return save_solution(states, weights, prices), bounds.lower


@pytest.mark.skipif(kernels is None, reason="without kernels offers are not used")
def test_nothing_is_solved_where_the_assignment_does_not_change() -> None:
    # One crowded component. Where c is larger than all errors of the assignment only the price of
    # a miss depends on it.
    truth, estimate = scene(1, 8, 8, 25, side=15.0, noise=0.3)
    found = [Parameters(cutoff=c, switch_penalty=5.0) for c in (20.0, 25.0, 30.0)]
    both, pairs = measured(truth, estimate, 30.0)
    low, middle, high = (sensitivity.merge_runs(both.problem(pairs, p)) for p in found)
    shares = sensitivity._shares(*found, "cutoff")
    warm_start = make_warm_start(middle, (solved(low)[0], solved(high)[0]), shares)
    cold, warm = (Certified(jobs=1)(middle, Stopwatch(), start) for start in (None, warm_start))
    assert cold.iterations > 0
    assert warm.iterations == 0
    assert certify(middle, warm)[0].met(1e-9)


def test_sinkhorn_has_a_bracket_at_each_point() -> None:
    truth, estimate = scene(2, 6, 6, 10, side=8.0)
    found = sweep(truth, estimate, cutoff=[2, 5], solver=Sinkhorn(epsilon=0.1))
    for point in found.points:
        exact = evaluate(truth, estimate, point.value).total
        assert point.lower_bound**2 <= exact * (1 + 1e-9)
        assert point.total >= exact * (1 - 1e-9)
        assert point.finished


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"cutoff": 5.0}, "sequences here: none"),
        ({"cutoff": [5.0], "order": [1, 2]}, "sequences here: cutoff and order"),
        ({"cutoff": []}, "no value"),
        ({"cutoff": [5.0, 5.0]}, "cutoff 5 is given twice"),
        ({"order": [0.5, 1.0]}, "order is 0.5"),
    ],
)
def test_wrong_values_in_python(options: dict, part: str) -> None:
    with pytest.raises(ConfigError, match=part):
        sweep(np.zeros((1, 1, 1)), np.zeros((1, 1, 1)), **options)


# --- command line ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "name", "values"),
    [
        ("cutoff=2:50:3", "cutoff", [2, 26, 50]),
        ("cutoff=0.1:0.5:5", "cutoff", [0.1, 0.2, 0.3, 0.4, 0.5]),
        ("switch-penalty=1:100:3:log", "switch_penalty", [1, 10, 100]),
        ("order=2,1", "order", [2, 1]),
        ("c=2:4:3", "cutoff", [2, 3, 4]),
        ("p=2,1", "order", [2, 1]),
        ("gamma=1,5", "switch_penalty", [1, 5]),
    ],
)
def test_values_of_a_sweep(text: str, name: str, values: list[float]) -> None:
    assert parse_sweep((text,)) == (name, values)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--sweep", "cut=1:2:3"], "must be NAME=FROM:TO:COUNT"),
        (["--sweep", "cutoff"], "must be NAME="),
        (["--sweep", "cutoff=1:2"], "must be NAME="),
        (["--sweep", "cutoff=1:2:3:lin"], "must be NAME="),
        (["--sweep", "cutoff=1:2:x"], "COUNT must be a whole number"),
        (["--sweep", "cutoff=1:2:1"], "COUNT must be a whole number"),
        (["--sweep", "cutoff=1:2:9999999999"], "COUNT must be a whole number"),
        (["--sweep", "cutoff=2:1:3"], "FROM must be less than TO"),
        (["--sweep", "switch-penalty=0:1:3:log"], "more than 0"),
        (["--sweep", "cutoff=1,a"], '"a" is not a number'),
        (["--sweep", "cutoff=inf"], '"inf" is not a number'),
        (["--sweep", "cutoff=-1:2:3"], "cutoff is -1"),
        (["--sweep", "cutoff=5,5"], "cutoff 5 is given twice"),
        (["--sweep", "cutoff=1,2", "--sweep", "order=1,2"], "only one parameter can be swept"),
        (["--sweep", "cutoff=1,2", "--by", "class"], "choose one class by --class"),
        (["--sweep", "cutoff=1,2", "-o", "x", "--components", "false"], "--components is not for"),
        (["--sweep", "cutoff=1,2", "-o", "x", "--plane", "x,y"], "--plane is not for"),
        (["--sweep", "cutoff=1,2", "-o", "x", "--pictures", "gif"], 'pictures "gif": must be'),
    ],
)
def test_wrong_sweeps(invoke: Invoke, quickstart: Pair, arguments: list[str], part: str) -> None:
    answer = invoke(*quickstart, *arguments)
    assert (answer.status, answer.out) == (2, "")
    assert part in answer.err
    assert len(answer.err.splitlines()) == 1


def test_the_table(invoke: Invoke, quickstart: Pair) -> None:
    answer = invoke(*quickstart, "--sweep", "cutoff=10,2,5", "-g", "5", "--unit", "m", "-q")
    assert answer.status == 0
    assert answer.err == ""
    assert all(len(line) <= 80 for line in answer.out.splitlines())
    assert "TGOSPA at 3 values of the cutoff from c = 2 m to 10 m, all proven exact" in answer.out
    rows = [line.split() for line in answer.out.splitlines()]
    assert ["5", "26.8652", "284.24", "262.5", "(21)", "100", "(8)", "75", "(3)"] in rows
    assert "missed and false: 21 and 8 at all 2 values from c = 5 m to 10 m" in answer.out


def test_a_value_beside_the_sweep_is_passed_over(invoke: Invoke, quickstart: Pair) -> None:
    given = *quickstart, "--sweep", "cutoff=5,10", "-g", "5"
    alone, beside = invoke(*given), invoke(*given, "-c", "7")
    assert (alone.status, beside.status) == (0, 0)
    assert beside.out == alone.out
    assert "--cutoff 7 is ignored: --sweep gives its values" in beside.err


def test_every_format_has_the_numbers_of_separate_runs(invoke: Invoke, quickstart: Pair) -> None:
    given = (*quickstart, "--sweep", "switch-penalty=0:50:3", "-c", "10", "-q", "--format")
    document = json.loads(invoke(*given, "json").out)
    assert document["schema"] == "tgospa-eval/sweep/1"
    assert list(document) == sorted(document)
    for point in document["points"]:
        alone = invoke(*quickstart, "-c", "10", "-g", str(point["value"]), "-q", "--format", "json")
        one = json.loads(alone.out)
        for key in ("tgospa", "total", "lower_bound", "localisation", "missed", "switch"):
            assert point[key] == pytest.approx(one[key], rel=1e-9, abs=1e-9)
        assert point["counts"] == one["counts"]
        assert point["normalised"]["tgospa"] == one["normalised"]["tgospa"]
    assert document["parameters"]["cutoff"] == 10
    assert "switch_penalty" not in document["parameters"]
    assert document["input"] == one["input"]
    rows = invoke(*given, "csv").out.splitlines()
    assert rows[0].startswith("switch_penalty,tgospa,lower_bound,total")
    assert [float(row.split(",")[3]) for row in rows[1:]] == [
        point["total"] for point in document["points"]
    ]
    assert "| gamma | TGOSPA |" in invoke(*given, "markdown").out
    assert r"gamma & TGOSPA &" in invoke(*given, "latex").out


def test_defaults_that_are_not_swept_are_told(invoke: Invoke, quickstart: Pair) -> None:
    answer = invoke(*quickstart, "--sweep", "cutoff=5,10")
    assert "default switch penalty gamma = 2" in answer.err
    assert "cutoff" not in answer.err


def test_a_point_that_is_not_exact(invoke: Invoke, crowd: Pair) -> None:
    answer = invoke(*crowd, "--sweep", "cutoff=20,25", "-g", "2", "--time-limit", "1e-9", "-q")
    assert answer.status == 4
    assert "accuracy not reached at cutoff 20: solver stopped by the time limit" in answer.err
    assert "0 exact, 2 between proven" in answer.out
    assert "lower bound" in answer.out
    assert all(len(line) <= 80 for line in answer.out.splitlines())


def test_classes_of_the_settings_are_left_aside(
    invoke: Invoke, write: Write, quickstart: Pair
) -> None:
    path = write("settings.toml", 'by = "class"\ncutoff = 3\n')
    answer = invoke(*quickstart, "--config", path, "--sweep", "cutoff=5,10", "-g", "5")
    assert answer.status == 0
    assert "is ignored" in answer.err


MANIFEST = ".tgospa-eval.json"


def test_the_folder(invoke: Invoke, quickstart: Pair, tmp_path: Path) -> None:
    given = (*quickstart, "--sweep", "order=1,2,3", "-c", "10", "-g", "5", "-q", "-o")
    assert invoke(*given, "out").status == 0
    document = json.loads((tmp_path / "out" / "sweep.json").read_text())
    assert [point["value"] for point in document["points"]] == [1, 2, 3]
    assert (tmp_path / "out" / "sweep.csv").read_text().startswith("order,tgospa")
    (tmp_path / "out" / "sweep.svg").write_text("mine")
    assert invoke(*given, "out").status == 0
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == [MANIFEST, "report.html", "sweep.csv", "sweep.json", "sweep.svg"]
    result = invoke(*quickstart, "-o", "out")  # of another kind
    assert result.status == 2
    assert "is not empty" in result.err


@pytest.mark.parametrize(("formats", "files"), [("none", []), ("svg,png", ["png", "svg"])])
def test_pictures_of_the_folder(
    invoke: Invoke, quickstart: Pair, tmp_path: Path, formats: str, files: list[str]
) -> None:
    pytest.importorskip("matplotlib")
    given = (*quickstart, "--sweep", "order=1,2", "-c", "10", "-g", "5", "-q", "-o", "out")
    assert invoke(*given, "--pictures", formats).status == 0
    found = {path.name for path in (tmp_path / "out").iterdir()}
    pictures = {f"sweep.{kind}" for kind in files}
    assert found == {MANIFEST, "report.html", "sweep.json", "sweep.csv", *pictures}
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<h1><bdi>TGOSPA at 2 values of the order" in page
    assert ("data:image/svg+xml" in page) is bool(files)


# --- picture --------------------------------------------------------------------------------------


def test_what_the_picture_shows() -> None:
    pytest.importorskip("matplotlib")
    from tgospa_eval.show.chart_list import pictures, plot

    truth, estimate = scene(2, 3, 4, 12, side=10.0)
    found = sweep(truth, estimate, cutoff=[1, 2, 4, 8, 16], switch_penalty=2, unit="$m")
    axes = plot(found, "sweep", "sweep").axes
    assert [axis.get_title(loc="left") for axis in axes[:4]] == list(PARTS)
    shown = {axis.get_title(loc="left"): axis.get_lines()[0].get_ydata() for axis in axes}
    for part in PARTS:
        assert list(shown[part]) == [getattr(point, part) for point in found.points]
    for part in PARTS[1:]:
        assert list(shown[f"number, {part}"]) == [
            getattr(point, f"{part}_count") for point in found.points
        ]
    assert list(shown["TGOSPA"]) == [point.tgospa for point in found.points]
    assert all(axis.get_xscale() == "log" for axis in axes)
    first, second = (pictures("sweep", found) for _ in range(2))
    assert first == second
    assert first["sweep.png"].startswith(b"\x89PNG")


@given(
    pairs_of_sets(most=4),
    st.sampled_from(["cutoff", "switch_penalty"]),
    ORDERS,
    st.tuples(st.floats(0.3, 3), st.floats(0.01, 2), st.floats(0.05, 0.95)),
)
@settings(max_examples=examples(40))
def test_prices_between_neighbours_prove_the_chord(
    sides: tuple[np.ndarray, np.ndarray], name: str, order: float, at: tuple[float, float, float]
) -> None:
    low, width, share = at
    values = low, low + share * width, low + width
    others = {"cutoff": 1.2, "order": order, "switch_penalty": 0.4}
    a, m, b = (Parameters(**(others | {name: value})) for value in values)
    both, pairs = measured(*sides, max(a.cutoff, b.cutoff))
    states = [sensitivity.merge_runs(both.problem(pairs, p)) for p in (a, m, b)]
    (kept_a, lower_a), (kept_b, lower_b) = solved(states[0]), solved(states[2])
    shares = sensitivity._shares(a, m, b, name)
    warm_start = make_warm_start(states[1], (kept_a, kept_b), shares)
    solution = Certified(jobs=1)(states[1], Stopwatch())
    solution = replace(solution, prices=warm_start.prices)
    proven = certify(states[1], solution)[0]
    # shares are of costs in units of the c^p of the middle
    alone = 1e-9
    assert proven.lower >= shares[0] * lower_a + shares[1] * lower_b - alone
    for weights in warm_start.weights:
        assert (
            certify(states[1], replace(solution, weights=weights))[0].upper >= proven.lower - alone
        )


def test_what_is_kept_gives_a_solution_back() -> None:
    truth, estimate = scene(3, 6, 7, 20, side=10.0)
    both, pairs = measured(truth, estimate, 5.0)
    states = sensitivity.merge_runs(both.problem(pairs, Parameters(cutoff=5.0, switch_penalty=2.0)))
    solution = Certified(jobs=1)(states, Stopwatch())
    prices = solution.prices.copy()
    _, weights, _ = certify(states, solution)
    kept = save_solution(states, weights, prices)
    again = make_warm_start(states, (kept,), (1.0,))
    assert np.array_equal(again.weights[0], weights / ONE)
    assert np.allclose(again.prices, prices, atol=1e-12)  # running sums lose the last digits


def test_points_in_between() -> None:
    order = list(sensitivity._bisected(6))
    assert [k for k, _ in order][:2] == [0, 5]
    assert sorted(k for k, _ in order) == list(range(6))
    done = set()
    for k, neighbours in order:
        assert set(neighbours) <= done
        assert not neighbours or neighbours[0] < k < neighbours[1]
        done.add(k)
    assert list(sensitivity._bisected(1)) == [(0, ())]
