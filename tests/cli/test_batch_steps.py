"""Costs of steps beside the rows of a batch: asked for at once, later, and after a kill."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from tgospa_eval.results.records import PARTS

Invoke = Callable[..., Any]

PATTERNS = ("--truth", "gt.csv", "--estimate", "out/{tracker}/{run}.csv", "-c", "10")
RUNS = 3


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Runs of two trackers that lose a target now and then."""
    monkeypatch.chdir(tmp_path)
    for folder in ("out/a", "out/b"):
        Path(folder).mkdir(parents=True)
    Path("gt.csv").write_text(lines(0), encoding="utf-8")
    for run in range(RUNS):
        for name, error in (("a", 1), ("b", 2)):
            Path(f"out/{name}/{run}.csv").write_text(lines(error, run), encoding="utf-8")
    return tmp_path


def lines(error: int, lost: int | None = None) -> str:
    rows = [f"{k // 3 if error else 1},{k},{k + error},0\n" for k in range(6) if k != lost]
    return "id,t,x,y\n" + "".join(rows)


def batch(invoke: Invoke, *arguments: str) -> Any:
    return invoke("batch", *PATTERNS, "-o", "r", "--workers", "1", *arguments)


def stored() -> pd.DataFrame:
    """Rows of steps that belong to a job, as docs say how to read them."""
    jobs, steps = (
        pd.concat(map(pd.read_parquet, Path("r", name).glob("*.parquet")))
        for name in ("jobs", "per_step")
    )
    return steps.astype({"key": str}).merge(jobs, on=["key", "finished"], suffixes=("", "_of_job"))


def test_steps_are_those_of_single_evaluations(invoke: Invoke, runs: Path) -> None:
    assert batch(invoke, "--per-step", "--curve").status == 0
    found = stored()
    assert len(found) == 2 * RUNS * 6
    for (tracker, run), own in found.groupby(["label.tracker", "label.run"]):
        answer = invoke(
            "gt.csv", f"out/{tracker}/{run}.csv", "-c", "10", "--curve", "--format", "json"
        )
        single = json.loads(answer.out)
        own = own.sort_values("step")
        assert own["t"].tolist() == [str(row["t"]) for row in single["per_step"]]
        for name in (*PARTS, "total"):
            assert own[name].tolist() == [row[name] for row in single["per_step"]]
        for name in ("tgospa", "lower_bound", "upper_bound"):
            assert own[f"curve.{name}"].tolist() == [row[name] for row in single["curve"]]
        assert own["steps"].tolist() == [row["steps"] for row in single["curve"]]
    table = pd.read_csv("r/curve.csv")
    assert table.groupby(["tracker", "curve"]).size().to_dict() == dict.fromkeys(
        [("a", "growing"), ("a", "step"), ("b", "growing"), ("b", "step")], 6
    )
    costs = found[(found["label.tracker"] == "a") & (found["step"] == 2)]["total"]
    single_steps = table[(table["tracker"] == "a") & (table["curve"] == "step")]
    assert single_steps["rms"].tolist()[1] == pytest.approx(costs.mean() ** 0.5)


def test_steps_that_are_asked_for_later_are_stored_and_stay(invoke: Invoke, runs: Path) -> None:
    batch(invoke)
    assert not Path("r/per_step").exists()
    assert "done before" not in batch(invoke, "--per-step").err
    assert len(stored()) == 2 * RUNS * 6
    assert stored()["curve.tgospa"].isna().all()
    assert "6 jobs of 6 done before" in batch(invoke, "--per-step").err
    assert "done before" not in batch(invoke, "--per-step", "--curve").err
    assert "6 jobs of 6 done before" in batch(invoke, "--per-step").err
    # What is done once more for its folder keeps its steps, and its curve.
    assert "done before" not in batch(invoke, "--reports").err
    answer = batch(invoke, "--per-step", "--curve", "--format", "json")
    assert "6 jobs of 6 done before" in answer.err
    curves = json.loads(answer.out)["curves"]
    assert [(item["by"]["tracker"], item["curve"]) for item in curves] == [
        ("a", "step"), ("a", "growing"), ("b", "step"), ("b", "growing")
    ]  # fmt: skip
    assert curves[0]["points"][1]["runs"] == RUNS
    assert pd.read_csv("r/curve.csv")["runs"].tolist() == [RUNS] * 24


def test_steps_without_their_job_do_not_count(invoke: Invoke, runs: Path) -> None:
    """A kill between the two parts, and a row of an older run."""
    batch(invoke, "--per-step")
    for path in Path("r/jobs").glob("*.parquet"):
        path.unlink()
    batch(invoke, "--per-step")
    steps = pd.concat(map(pd.read_parquet, Path("r/per_step").glob("*.parquet")))
    assert len(steps) == 2 * len(stored()) == 4 * RUNS * 6
    assert pd.read_csv("r/curve.csv")["runs"].tolist() == [RUNS] * 12


def test_files_of_others_in_the_store_stay(invoke: Invoke, runs: Path) -> None:
    batch(invoke)
    Path("r/curve.csv").write_text("mine", encoding="utf-8")
    answer = batch(invoke, "--per-step")
    assert answer.status == 0
    assert "curve.csv in it was not written by a run before" in answer.err
    assert Path("r/curve.csv").read_text(encoding="utf-8") == "mine"
    assert invoke("batch", "report", "r", "-o", "r").status == 2
    assert invoke("batch", "report", "r", "-o", "q", "--by", "run").status == 0
    assert os.listdir("r/per_step")
    assert set(pd.read_csv("q/curve.csv")["run"]) == set(range(RUNS))


def test_a_curve_that_nobody_stores_is_refused(invoke: Invoke, runs: Path) -> None:
    answer = batch(invoke, "--curve")
    assert answer.status == 2
    assert "--curve is for --per-step, or for the folders of --reports" in answer.err
    assert not Path("r").exists()
