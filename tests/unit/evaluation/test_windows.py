"""Sliding windows: each is the metric of its steps alone."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Invoke, Write
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import ORDERS, SWITCH, pairs_of_sets, scene

from tgospa_eval import Certified, ConfigError, Exact, evaluate
from tgospa_eval.evaluation.curve import SeparateStretches
from tgospa_eval.evaluation.request import Sliding

PARTS = ["localisation", "missed", "false", "switch"]


def spans(steps: int, window: int, every: int) -> list[tuple[int, int]]:
    """First step of each window, and the one after its last."""
    size = min(window, steps)
    first = list(range(0, steps - size + 1, every))
    if first[-1] + size < steps:
        first.append(steps - size)
    return [(k, k + size) for k in first]


def same_as_separate(
    truth: np.ndarray, estimate: np.ndarray, window: int, every: int, **others: Any
) -> None:
    """Against evaluations of the steps of each window, which are cut out here."""
    order, weights = others["order"], others.get("step_weights")
    whole = evaluate(truth, estimate, **others, window=window, every=every)
    table, expected = whole.windows, spans(len(truth), window, every)
    assert table["t_first"].tolist() == [low for low, _ in expected]
    assert table["t_last"].tolist() == [high - 1 for _, high in expected]
    for k, (low, high) in enumerate(expected):
        own = slice(low, high)
        if weights is not None:
            others["step_weights"] = weights[own]
        alone = evaluate(truth[own], estimate[own], **others)
        found = table.iloc[k]
        cost = found["tgospa"] ** order
        assert cost == pytest.approx(alone.total, rel=2e-9, abs=1e-12)
        assert found["lower_bound"] <= found["tgospa"] <= found["upper_bound"]
        assert found["lower_bound"] <= alone.upper_bound
        assert alone.lower_bound <= found["upper_bound"]
        assert found[PARTS].sum() == pytest.approx(cost, rel=1e-12, abs=1e-12)
        assert found["normalised"] == pytest.approx(alone.normalised["tgospa"], rel=2e-9, abs=1e-9)
        assert found["steps"] == high - low
    assert whole.finished


@given(
    pairs_of_sets(most=4, most_steps=9),
    ORDERS,
    SWITCH,
    st.sampled_from([0.5, 0.5, 0.3]),
    st.integers(1, 10),
    st.data(),
)
@settings(max_examples=examples(20))
def test_windows_are_separate_evaluations(
    sides: tuple[np.ndarray, np.ndarray],
    order: float,
    switch: float,
    rho: float,
    window: int,
    data: st.DataObject,
) -> None:
    every = data.draw(st.integers(1, window))
    others: dict[str, Any] = {"cutoff": 1.5, "order": order, "switch_penalty": switch, "rho": rho}
    if data.draw(st.booleans()):
        seed = data.draw(st.integers(0, 99))
        others["step_weights"] = np.random.default_rng(seed).choice([0.5, 1.0, 3.0], len(sides[0]))
    same_as_separate(*sides, window, every, **others)


@pytest.mark.parametrize("side", [12.0, 60.0])
def test_windows_of_crowds_are_separate_evaluations(side: float) -> None:
    sides = scene(5, 8, 9, 30, side=side)
    same_as_separate(*sides, 9, 4, cutoff=5.0, order=2, switch_penalty=2.0)


def test_by_hand() -> None:
    # p = 1, c = 4, gamma = 6: to change the track at step 2 costs 6, the whole does so. In windows
    # of one step nothing changes; of two, with 1 step on either side, missed and false cost 4.
    truth = np.zeros((4, 1, 1))
    estimate = np.full((4, 2, 1), np.nan)
    estimate[:2, 0, 0] = estimate[2:, 1, 0] = 0.0
    given = {"cutoff": 4, "order": 1, "switch_penalty": 6}
    assert evaluate(truth, estimate, **given, window=4).windows["tgospa"].tolist() == [6]
    two = evaluate(truth, estimate, **given, window=2, every=1).windows
    assert two["tgospa"].tolist() == [0, 4, 0]
    assert two["normalised"].tolist() == [0, 2, 0]
    assert two["missed"].tolist() == two["false"].tolist() == [0, 2, 0]
    assert evaluate(truth, estimate, **given, window=1).windows["tgospa"].tolist() == [0] * 4


def test_the_last_window_ends_with_the_last_step() -> None:
    assert [part.tolist() for part in Sliding(size=4, every=3).spans(np.arange(9))] == [
        [0, 3, 5],
        [3, 6, 8],
    ]
    assert [part.tolist() for part in Sliding(size=4, every=3).spans(np.arange(10))] == [
        [0, 3, 6],
        [3, 6, 9],
    ]
    assert [part.tolist() for part in Sliding(size=4, every=3).spans(np.arange(2))] == [[0], [1]]
    assert [part.tolist() for part in Sliding(size=4, every=3).spans(np.arange(0))] == [[], []]
    assert Sliding.of_options(5, None) == Sliding(size=5, every=2)
    assert Sliding.of_options(1, None) == Sliding(size=1, every=1)
    assert Sliding.of_options(None, None) is None


@pytest.mark.parametrize(
    ("window", "every", "message"),
    [
        (0, None, "window is 0: must be a whole number of steps, 1 or more"),
        (2.5, None, "window is 2.5: must be a whole number"),
        (True, None, "window is True"),
        (3, 0, "every is 0: must be a whole number"),
        (3, 4, "every is 4 steps: must be at most the 3 steps of a window"),
        (None, 4, "every needs window"),
        (
            "2.5",
            None,
            'window is "2.5": must be a whole number of steps, 1 or more, or a time with',
        ),
        ("0min", None, 'window is "0min": must be'),
        ("3 days", None, 'window is "3 days": must be a number, or one with a unit'),
        ("30min", 4, "window is 30min and every is 4 steps: give both in steps, or both as times"),
        ("30min", "1h", "every is 1h: must be at most the 30min of a window"),
        ("30min", None, "window 30min: the times are plain numbers, .*; give a number of steps"),
    ],
)
def test_wrong_windows_are_refused(window: Any, every: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        evaluate(np.zeros((2, 1, 1)), np.zeros((2, 1, 1)), window=window, every=every)


def test_windows_of_time_are_separate_evaluations(tmp_path: Path, invoke: Invoke) -> None:
    # Scans come every 2 to 7 s, and none for 50 s: a window of time has as many as there are.
    rng = np.random.default_rng(5)
    seconds = np.cumsum(rng.integers(2, 8, 60))
    seconds[30:] += 50
    stamps = pd.Timestamp("2026-05-01T10:00:00") + pd.to_timedelta(seconds, unit="s")
    sides = []
    for noise in (0.0, 1.0):
        rows = pd.DataFrame(
            [
                (k, t, 9.0 * k, s / 5)
                for s, t in zip(seconds, stamps, strict=True)
                for k in range(3)
            ],
            columns=["id", "t", "x", "y"],
        )
        rows["x"] += noise * rng.normal(size=len(rows))
        sides.append(rows[rng.random(len(rows)) > 0.1 * noise])
    options = {"cutoff": 5, "order": 1, "switch_penalty": 2}
    whole = evaluate(*sides, **options, window="30s", every="10s")
    table = whole.windows
    begin = stamps[0] + pd.to_timedelta(np.arange(0, seconds[-1] - seconds[0] - 29, 10), unit="s")
    spans = [(low, low + pd.Timedelta("30s")) for low in begin]
    spans.append((stamps[-1] - pd.Timedelta("29.999999999s"), stamps[-1] + pd.Timedelta("1ns")))
    expected = []
    for low, high in spans:
        parts = [side[(side["t"] >= low) & (side["t"] < high)] for side in sides]
        if len(parts[0]):
            expected.append(evaluate(*parts, **options))
    assert len(expected) < len(spans)  # in the silence is no window
    alone = [(one.labels.times[0], one.labels.times[-1], one.tgospa) for one in expected]
    alone = list(dict.fromkeys(alone))
    assert table["t_first"].tolist() == [first for first, _, _ in alone]
    assert table["t_last"].tolist() == [last for _, last, _ in alone]
    assert table["tgospa"].tolist() == pytest.approx([value for _, _, value in alone], rel=1e-9)
    for name, side in zip(("truth", "estimate"), sides, strict=True):
        side.to_csv(tmp_path / f"{name}.csv", index=False)
    files = [str(tmp_path / f"{name}.csv") for name in ("truth", "estimate")]
    shown = invoke(*files, "-c", "5", "-p", "1", "-g", "2", "--window", "2min").out
    assert "windows of 2min, one every 1min" in " ".join(shown.split())


def test_a_window_may_be_asked_for_of_any_length() -> None:
    still = np.zeros((2, 1, 1))
    for every in (None, 10**29):
        assert len(evaluate(still, still, window=10**30, every=every).windows) == 1


def test_few_stretches_are_solved_and_each_once(monkeypatch: pytest.MonkeyPatch) -> None:
    # 3 of 4 pairs live within a window or two; the last pair changes its track in the middle.
    truth, estimate = np.full((2, 60, 4, 1), np.nan)
    for pair, (low, high) in enumerate(((0, 5), (20, 25), (40, 45), (0, 60))):
        truth[low:high, pair] = estimate[low:high, pair] = 100.0 * pair
    estimate[30:, 3] = np.nan
    estimate = np.concatenate((estimate, np.full((60, 1, 1), np.nan)), axis=1)
    estimate[30:, 4] = 300.0
    asked: list[int] = []
    made, solve = SeparateStretches.__init__, SeparateStretches.solve

    def counted(self: SeparateStretches, *given: Any) -> None:
        asked.append(len(given[2]))
        made(self, *given)

    monkeypatch.setattr(SeparateStretches, "__init__", counted)
    solved: list[int] = []
    monkeypatch.setattr(
        SeparateStretches,
        "solve",
        lambda self, *given: (solved.append(len(given)), solve(self, *given))[1],
    )
    options = {"cutoff": 4.0, "order": 1, "switch_penalty": 6.0}
    result = evaluate(truth, estimate, **options, window=10, every=10)
    assert result.finished
    assert asked == [6]  # of the last pair alone
    assert not solved  # no window has a change of its track inside
    result = evaluate(truth, estimate, **options, window=10, every=1)
    # Each stretch of the last pair, and what 51 windows have of the three others, but the whole.
    assert result.finished
    assert asked[1:] == [51 + 4 + 8 + 8]
    assert result.windows["tgospa"].max() == 6.0


@given(st.integers(0, 1000))
@settings(max_examples=examples(8))
def test_a_time_limit_leaves_proven_brackets(seed: int) -> None:
    truth, estimate = scene(seed, 6, 7, 20, side=8.0)
    solver = Certified(time_limit=1e-9)
    few = evaluate(truth, estimate, 5.0, 2, 2.0, solver=solver, window=6).windows
    exact = evaluate(truth, estimate, 5.0, 2, 2.0, window=6).windows
    assert (few["lower_bound"] <= exact["tgospa"] * (1 + 1e-9)).all()
    assert (few["tgospa"] >= exact["tgospa"] * (1 - 1e-9)).all()


def test_only_the_certified_solver_has_windows(invoke: Invoke, quickstart: tuple[str, str]) -> None:
    with pytest.raises(ConfigError, match="windows need the solver certified, not exact"):
        evaluate(np.zeros((1, 1, 1)), np.zeros((1, 1, 1)), solver=Exact(), window=1)
    for options, message in (
        (("--window", "5", "--solver", "sinkhorn"), "windows need the solver certified"),
        (("--window", "5", "--sweep", "cutoff=1,2"), "--sweep and --window: leave one"),
        (("--every", "5"), "every needs window"),
    ):
        answer = invoke(*quickstart, *options)
        assert (answer.status, answer.out) == (2, "")
        assert message in answer.err


def test_table_json_files_and_pictures(
    invoke: Invoke, quickstart: tuple[str, str], tmp_path: Path
) -> None:
    options = *quickstart, "-c", "10", "-g", "5", "--window", "12", "--every", "4", "-q"
    out = tmp_path / "out"
    answer = invoke(*options, "-o", str(out))
    assert answer.status == 0
    assert all(len(line) <= 80 for line in answer.out.splitlines())
    assert "TGOSPA of 12 windows of 12 steps, one every 4 steps" in answer.out
    document = json.loads(invoke(*options, "--format", "json").out)
    assert [row["t_first"] for row in document["windows"]][:3] == [3, 7, 11]
    with (out / "windows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["tgospa"]) for row in rows] == [w["tgospa"] for w in document["windows"]]
    assert list(rows[0])[:3] == ["t_first", "t_last", "steps"]
    assert '<canvas id="windows"' in (out / "report.html").read_text(encoding="utf-8")
    # What another run left there is taken away, and what is not of a run is not written over.
    assert invoke(*quickstart, "-q", "-o", str(out)).status == 0
    assert not list(out.glob("windows*"))
    assert '<canvas id="windows"' not in (out / "report.html").read_text(encoding="utf-8")
    for name in ("windows.csv", "windows.svg"):
        (out / name).write_text("mine")
        answer = invoke(*options, "-o", str(out), "--pictures", "svg")
        assert answer.status == 2
        assert f"{name} in it was not written by an earlier run" in answer.err
        assert (out / name).read_text() == "mine"
        (out / name).unlink()
    assert "windows" not in json.loads(invoke(*quickstart, "-q", "--format", "json").out)


def test_what_is_not_exact_is_told_as_a_bound(
    invoke: Invoke, write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    sides = scene(2, 6, 7, 20, side=8.0)
    names = ("t.csv", "e.csv")
    files = [
        write(
            name,
            "id,t,x,y\n"
            + "".join(
                f"{i},{k},{x:.3f},{y:.3f}\n"
                for k, row in enumerate(side)
                for i, (x, y) in enumerate(row)
                if np.isfinite(x)
            ),
        )
        for name, side in zip(names, sides, strict=True)
    ]
    monkeypatch.setattr(SeparateStretches, "solve", lambda self, *_: self.of_whole())
    answer = invoke(*files, "-c", "5", "-g", "2", "--window", "6")
    assert answer.status == 4
    assert "4 of them upper bounds" in " ".join(answer.out.split())
    assert " <= " in answer.out
    assert "accuracy not reached at 4 windows; requested: 1e-09" in answer.err


def test_windows_of_classes_add_up(invoke: Invoke, write: Write) -> None:
    truth = write("t.csv", "id,t,x,class\n1,0,0,a\n1,1,0,a\n2,0,5,b\n2,2,5,b\n")
    estimate = write("e.csv", "id,t,x,class\n1,0,1,a\n1,1,0,a\n2,0,5,b\n2,1,5,b\n")
    options = "-c", "4", "-g", "2", "-p", "1", "--by", "class", "--window", "2", "--every", "1"
    document = json.loads(invoke(truth, estimate, *options, "-q", "--format", "json").out)
    # t = 0: 1; t = 1: a false b; t = 2: a missed b, halves of c
    assert [row["tgospa"] for row in document["windows"]] == [3, 4]


@pytest.mark.parametrize(("m", "n"), [(0, 0), (2, 0), (0, 2)])
def test_empty_sides(m: int, n: int) -> None:
    sides = np.zeros((3, m, 2)), np.zeros((3, n, 2))
    same_as_separate(*sides, 2, 1, cutoff=2.0, order=2, switch_penalty=1.0)


def test_the_picture_needs_windows() -> None:
    result = evaluate(np.zeros((4, 1, 2)), np.full((4, 1, 2), 3.0), cutoff=5.0, window=2)
    (axis,) = result.plot_windows(components=["switch"]).axes
    assert [line.get_xdata().tolist() for line in axis.lines] == [[0.5, 1.5, 2.5]] * 2
    assert axis.lines[1].get_ydata() == pytest.approx([18**0.5] * 3, abs=1e-5)
    with pytest.raises(ConfigError, match="there are no windows"):
        evaluate(np.zeros((3, 1, 2)), np.zeros((3, 1, 2))).plot_windows()


def test_the_page_of_no_window(invoke: Invoke, write: Write) -> None:
    for name in ("t.csv", "e.csv"):
        write(name, "id,t,x\n")
    answer = invoke("t.csv", "e.csv", "-c", "3", "-g", "1", "--window", "3", "-q", "-o", "out")
    assert answer.status == 0, answer.err
    assert "the largest is 0" in Path("out/report.html").read_text(encoding="utf-8")
