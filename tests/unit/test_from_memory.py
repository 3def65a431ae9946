"""Monte Carlo studies from memory: the numbers of the same data in files."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

from tgospa_eval import ConfigError, InputError, batch, compare, evaluate

GIVEN: dict[str, Any] = {"cutoff": 10.0, "switch_penalty": 5.0}
RUNS, STEPS, OBJECTS = 8, 6, 2
PATTERNS = {"truth": "gt/{run}.csv", "estimate": "out/{tracker}/{run}.csv"}
OF_FILES = ["notices", "key", "truth", "estimate", "seconds", "finished"]


@pytest.fixture
def study() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Truths (runs, T, k, d), and estimates of two trackers, the second with gaps."""
    rng = np.random.default_rng(5)
    truth = np.cumsum(rng.normal(size=(RUNS, STEPS, OBJECTS, 2)), axis=1)
    near = truth + rng.normal(scale=0.5, size=truth.shape)
    far = truth + rng.normal(scale=2.0, size=truth.shape)
    far[2, 3, 1] = np.nan
    return truth, {"near": near, "far": far}


def table_of(runs: np.ndarray) -> pd.DataFrame:
    """The long form with a column of runs."""
    at = np.indices(runs.shape[:3]).reshape(3, -1)
    states = runs.reshape(-1, runs.shape[-1]).T
    table = pd.DataFrame({**dict(zip(("run", "t", "id"), at, strict=True)), "x": states[0]})
    return table.assign(y=states[1]).dropna()


def in_order(table: pd.DataFrame) -> pd.DataFrame:
    """Rows without what only files have, in one order."""
    kept = table.drop(columns=[name for name in OF_FILES if name in table])
    kept = kept.drop(columns=[name for name in kept if name.startswith("seconds")])
    return kept.sort_values(sorted(kept.columns[kept.columns.str.startswith("label.")]))


@pytest.mark.process
def test_a_batch_has_the_numbers_of_its_files(
    study: tuple[np.ndarray, dict[str, np.ndarray]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow")
    monkeypatch.chdir(tmp_path)
    truth, estimates = study
    for folder, runs in (("gt", truth), *((f"out/{k}", own) for k, own in estimates.items())):
        Path(folder).mkdir(parents=True)
        for run, table in table_of(runs).groupby("run"):
            table.drop(columns="run").to_csv(f"{folder}/{run}.csv", index=False)
    asked: dict[str, Any] = {**GIVEN, "workers": 1, "by": "tracker", "per_step": True}
    files = batch(**PATTERNS, output="store", **asked)
    tables = {name: table_of(own) for name, own in estimates.items()}
    memory = batch(table_of(truth), tables, **asked)
    assert_frame_equal(in_order(memory.rows), in_order(files.rows), check_like=True)
    assert_frame_equal(memory.groups, files.groups)
    assert memory.tables.rankings == files.tables.rankings
    for own, other in zip(memory.tables.curves, files.tables.curves, strict=True):
        assert own.table() == other.table()
    assert not list(tmp_path.glob("results*"))
    # Arrays and lists of anything else are the same runs, in order.
    lists = {"near": list(estimates["near"]), "far": [f"out/far/{k}.csv" for k in range(RUNS)]}
    mixed = batch(truth=truth, estimate=lists, output="memory", **asked)
    assert mixed.groups["total"].tolist() == pytest.approx(files.groups["total"].tolist())
    assert mixed.rows["label.run"].unique().tolist() == [str(k + 1) for k in range(RUNS)]
    assert Path("memory/report.html").is_file()
    parts = list(Path("memory/jobs").iterdir())
    again = batch(truth=truth, estimate=lists, output="memory", **asked)
    assert_frame_equal(again.rows, mixed.rows)
    assert list(Path("memory/jobs").iterdir()) == parts
    one_each = compare(truth, lists, **GIVEN)
    assert one_each.table()["total"].sum() * RUNS == pytest.approx(files.groups["total"].sum())
    assert list(one_each.table()["name"]) == ["near", "far"]


@pytest.mark.process
def test_one_truth_for_all_runs(study: tuple[np.ndarray, dict[str, np.ndarray]]) -> None:
    pytest.importorskip("pyarrow")
    truth, times = study[0][0], np.arange(STEPS) / 2
    runs = np.stack([truth + k for k in range(3)])
    done = batch((times, truth), (times, runs), workers=1, **GIVEN)
    totals = [evaluate(truth, run, **GIVEN).total for run in runs]
    assert done.rows["total"].tolist() == pytest.approx(totals)
    found = compare((times, truth), (times, runs), **GIVEN)
    assert found.table()["name"].tolist() == ["estimate"]
    assert found.table()["total"][0] == pytest.approx(np.mean(totals))
    states = np.concatenate([runs, np.zeros_like(runs)], axis=3)  # x, y, vx, vy
    moving = np.concatenate([truth, np.zeros_like(truth)], axis=2)
    chosen = batch(moving, {"a": states}, mapping=(0, 1), workers=1, **GIVEN)
    assert chosen.rows["total"].tolist() == pytest.approx(totals)
    assert compare(moving, {"a": states}, mapping=(0, 1), **GIVEN).document["runs"] == 3


def test_runs_that_do_not_fit(study: tuple[np.ndarray, dict[str, np.ndarray]]) -> None:
    truth, estimates = study
    fewer: dict[str, Any] = {**estimates, "far": estimates["far"][1:]}
    named: dict[str, Any] = {
        "near": table_of(truth),
        "far": table_of(truth).assign(run=lambda t: t["run"] + 1),
    }
    blank = table_of(truth).astype({"run": float})
    blank.loc[0, "run"] = np.nan
    for function in (batch, compare):
        with pytest.raises(InputError, match=r"^truth has 8 runs, far 7: all must have the same"):
            function(truth, fewer, **GIVEN)
        with pytest.raises(InputError, match=r"^near has 8 runs, far 7: .* except a single truth"):
            function(truth[0], fewer, **GIVEN)
        with pytest.raises(InputError, match=r'^far: near has no run "8"; all'):
            function(truth[0], named, **GIVEN)
        with pytest.raises(InputError, match=r"^near has 8 runs, far 1: "):
            function(truth[0], {**estimates, "far": truth[0]}, **GIVEN)
        with pytest.raises(InputError, match=r"^truth, column run: blank id"):
            function(blank, estimates, **GIVEN)
    with pytest.raises(ConfigError, match="data in memory: give truth and estimate"):
        batch(truth=truth, **GIVEN)
    with pytest.raises(ConfigError, match="reports needs output"):
        batch(truth, estimates, reports=True, **GIVEN)


@pytest.mark.process
def test_a_batch_without_any_value_says_why(
    study: tuple[np.ndarray, dict[str, np.ndarray]],
) -> None:
    pytest.importorskip("pyarrow")
    short = {name: own[:, 1:] for name, own in study[1].items()}
    with pytest.raises(InputError, match=r"^truth has 6 steps and estimate has 5: [^\n]*$"):
        batch(study[0], short, workers=1, **GIVEN)
