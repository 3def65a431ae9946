"""Costs of steps beside the rows of a batch: asked for at once, later, and after a kill."""

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Invoke

import tgospa_eval
from tgospa_eval import ConfigError
from tgospa_eval.results.records import PARTS

PATTERNS = ("--truth", "gt.csv", "--estimate", "out/{tracker}/{run}.csv", "-c", "10")
RUNS = 3
KINDS = ("step", "cumulative", "growing")


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
        [(name, kind) for name in "ab" for kind in KINDS], 6
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
    assert "done before" not in batch(invoke, "--per-step", "--curve").err
    assert "6 jobs of 6 done before" in batch(invoke, "--per-step").err
    # What is done once more for its folder keeps its steps, and its curve.
    assert "done before" not in batch(invoke, "--reports").err
    answer = batch(invoke, "--per-step", "--curve", "--format", "json")
    assert "6 jobs of 6 done before" in answer.err
    curves = json.loads(answer.out)["curves"]
    assert [(item["by"]["tracker"], item["curve"]) for item in curves] == [
        (name, kind) for name in "ab" for kind in KINDS
    ]
    assert curves[0]["points"][1]["runs"] == RUNS
    assert pd.read_csv("r/curve.csv")["runs"].tolist() == [RUNS] * 36


def test_steps_without_their_job_do_not_count(invoke: Invoke, runs: Path) -> None:
    """A kill between the two parts, and a row of an older run."""
    batch(invoke, "--per-step")
    for path in Path("r/jobs").glob("*.parquet"):
        path.unlink()
    batch(invoke, "--per-step")
    steps = pd.concat(map(pd.read_parquet, Path("r/per_step").glob("*.parquet")))
    assert len(steps) == 2 * len(stored()) == 4 * RUNS * 6
    assert pd.read_csv("r/curve.csv")["runs"].tolist() == [RUNS] * 24


def test_lost_steps_are_told(invoke: Invoke, runs: Path) -> None:
    batch(invoke, "--per-step")
    shutil.rmtree("r/per_step")
    for by in ("tracker", "tracker,run"):
        told = invoke("batch", "report", "r", "-o", "q", "--by", by, "--band", "interval").out
        assert "not available: the stored steps of" in told
        assert "no steps are stored" not in told
    assert not Path("q/curve.csv").exists()


def test_files_of_others_in_the_store_stay(invoke: Invoke, runs: Path) -> None:
    batch(invoke)
    Path("r/curve.csv").write_text("mine", encoding="utf-8")
    answer = batch(invoke, "--per-step")
    assert answer.status == 0
    assert "curve.csv in it was not written by an earlier run" in answer.err
    assert Path("r/curve.csv").read_text(encoding="utf-8") == "mine"
    assert invoke("batch", "report", "r", "-o", "r").status == 2
    assert invoke("batch", "report", "r", "-o", "q", "--by", "run").status == 0
    assert os.listdir("r/per_step")
    assert set(pd.read_csv("q/curve.csv")["run"]) == set(range(RUNS))


def test_a_curve_that_nobody_stores_is_refused(invoke: Invoke, runs: Path) -> None:
    answer = batch(invoke, "--curve")
    assert answer.status == 2
    assert "--curve needs --per-step or --reports" in answer.err
    assert not Path("r").exists()


def scenes(count: int) -> Iterator[tuple[str, str]]:
    """Truth and estimate of runs with random first and last steps, and false alarms anywhere."""
    rng = np.random.default_rng(5)
    for _ in range(count):
        first, size = rng.integers(3, 12), rng.integers(1, 9)
        truth = [(k, t, 60.0 * k) for k in range(2) for t in range(first, first + size)]
        seen = [row for row in truth if rng.random() < 0.8]
        found = [((k + (t > first + 3)) % 2, t, x + rng.normal()) for k, t, x in seen]
        found += [(9, t, 900.0) for t in range(25) if rng.random() < 0.1]
        yield tuple(  # type: ignore[misc]
            "id,t,x\n" + "".join(f"{k},{t},{x!r}\n" for k, t, x in rows)
            for rows in (truth, found or [(9, 0, 900.0)])
        )


def by_script(results: list[Any], stamps: list[set[int]], name: str) -> dict[str, list[float]]:
    """Curves of single results, added up by t."""
    costs = [dict(zip(r.per_step["t"], r.per_step[name], strict=True)) for r in results]
    so_far, found = [0.0] * len(results), {"step": [], "cumulative": []}
    for t in sorted({t for own in costs for t in own}):
        single = total = 0.0
        for k, own in enumerate(costs):
            so_far[k] += own.get(t, 0.0)
            single += own.get(t, 0.0)
            total += so_far[k] / max(sum(s <= t for s in stamps[k]), 1)
        found["step"].append((single / len(results)) ** 0.5)
        found["cumulative"].append((total / len(results)) ** 0.5)
    return found


def test_curves_of_a_monte_carlo_study_are_those_of_a_script(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    results, stamps = [], []
    for run, texts in enumerate(scenes(30)):
        paths = [Path(f"mc/{run:03d}/{name}.csv") for name in ("truth", "mine")]
        for path, text in zip(paths, texts, strict=True):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        metric: dict[str, Any] = {"cutoff": 10, "switch_penalty": 3, "with_": "gospa"}
        results.append(tgospa_eval.evaluate(*map(str, paths), curve=True, **metric))
        stamps.append(set(pd.read_csv(paths[0])["t"]))
    patterns = ("--truth", "mc/{run}/truth.csv", "--estimate", "mc/{run}/m{who}.csv")
    steps = (
        "--per-step",
        "--curve",
        "--with",
        "gospa",
        "--by",
        "who",
        "--pictures",
        "none",
        "--format",
        "json",
    )
    answer = invoke("batch", *patterns, "-o", "r", "--workers", "1", "-c", "10", "-g", "3", *steps)
    curves = json.loads(answer.out)["curves"]
    table = {curve["curve"]: pd.DataFrame(curve["points"]) for curve in curves}
    assert all((points["runs"] == 30).all() for points in table.values())
    for column, name in (("rms", "total"), *((part, part) for part in PARTS)):
        for kind, values in by_script(results, stamps, name).items():
            assert table[kind][column].tolist() == values
    curves = [dict(zip(r.curve["t"], r.curve["tgospa"], strict=True)) for r in results]
    values = [0.0] * len(results)
    for t, rms in zip(table["growing"]["t"], table["growing"]["rms"], strict=True):
        mean = 0.0
        for k, own in enumerate(curves):
            values[k] = own.get(t, values[k])
            mean += values[k] ** 2.0
        assert rms == (mean / len(results)) ** 0.5
    powers = sum(table["growing"][part] ** 2 for part in PARTS)
    assert powers.tolist() == pytest.approx((table["growing"]["rms"] ** 2).tolist())
    check_counts(table["step"], results)
    costs = sum(table["step"][f"gospa_{part}"] ** 2 for part in PARTS[:3])
    assert costs.tolist() == pytest.approx((table["step"]["gospa"] ** 2).tolist())
    total = sum(result.with_["gospa"]["total"] for result in results)
    assert (table["step"]["gospa"] ** 2).sum() == pytest.approx(total / len(results))
    assert (table["step"]["gospa"] <= table["step"]["rms"] * (1 + 1e-12)).all()
    for column in ("gospa_missed", "detection_rate"):
        assert table["growing"].get(column) is None


def check_counts(points: pd.DataFrame, results: list[Any]) -> None:
    """Cardinality and detection rate at each time, from files and assignments alone."""
    sides = [
        pd.concat([pd.read_csv(path) for path in sorted(Path("mc").glob(f"*/{name}.csv"))])
        for name in ("truth", "mine")
    ]
    truth, estimate = (side.groupby("t").size() for side in sides)
    assigned = pd.concat([result.assignments for result in results]).groupby("t").size()
    at = points["t"].tolist()
    for name, counts in (("truth_states", truth), ("estimate_states", estimate)):
        means = counts.reindex(at, fill_value=0) / len(results)
        assert points[name].tolist() == pytest.approx(means.tolist())
    rate = (assigned.reindex(at, fill_value=0) / truth.reindex(at)).tolist()
    assert points["detection_rate"].tolist() == pytest.approx(rate, nan_ok=True)


def test_a_store_without_counts_has_its_costs(invoke: Invoke, runs: Path) -> None:
    """One that was made before they were stored."""
    batch(invoke, "--per-step", "--pictures", "none")
    (path,) = Path("r/per_step").glob("*.parquet")
    table = pd.read_parquet(path)
    costs = ["key", "finished", "step", "t", "steps", *PARTS, "total"]
    curve = [f"curve.{name}" for name in ("tgospa", "lower_bound", "upper_bound")]
    table[costs + curve].to_parquet(path)
    answer = invoke("batch", "report", "r", "-o", "other", "-q")
    assert answer.status == 0
    old, new = pd.read_csv("other/curve.csv"), pd.read_csv("r/curve.csv")
    pd.testing.assert_frame_equal(old, new[list(old)])
    assert {*new} - {*old} == {"truth_states", "estimate_states", "detection_rate"}


def test_a_false_alarm_before_the_truth_shifts_no_run(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 25 runs eight have a false alarm at 1; 112 objects are missed at 2, and 16 at 3."""
    monkeypatch.chdir(tmp_path)
    for run in range(25):
        early = run < 8
        missed = {2: 2 if early else 5 + (run < 19), 3: 0 if early else int(run < 24)}
        found = [(k, t) for t, count in missed.items() for k in range(count, 7)]
        sides = {
            "truth": [(k, t) for t in missed for k in range(7)],
            "mine": [(9, 1)] * early + found,
        }
        for name, rows in sides.items():
            path = Path(f"mc/{run:02d}/{name}.csv")
            path.parent.mkdir(parents=True, exist_ok=True)
            text = "".join(f"{k},{t},{100 * k}\n" for k, t in rows)
            path.write_text(f"id,t,x\n{text}", encoding="utf-8")
    patterns = ("--truth", "mc/{run}/truth.csv", "--estimate", "mc/{run}/m{who}.csv")
    steps = ("-o", "r", "--workers", "1", "--per-step", "--pictures", "none", "--by", "who")
    assert invoke("batch", *patterns, "-c", "10", "-g", "0", *steps).status == 0
    table = pd.read_csv("r/curve.csv").set_index(["curve", "t"])
    assert table.loc["step", "rms"].tolist() == pytest.approx(np.sqrt([16, 224, 32]))
    assert table.loc["step", "false"].tolist() == pytest.approx([4, 0, 0])
    # From 2 on by the steps of the truth so far.
    assert table.loc["cumulative", "rms"].tolist() == pytest.approx(np.sqrt([16, 240, 136]))


def test_bands_are_chosen(invoke: Invoke, runs: Path) -> None:
    assert batch(invoke, "--per-step", "--pictures", "none").status == 0
    bands = {
        "interval": "95 % intervals",
        "bootstrap": "95 % bootstrap",
        "percentiles": "the 2.5th",
        "deviation": "plus and minus one standard",
    }
    for name, words in bands.items():
        # Nothing is done again, and the page is written anew.
        answer = batch(invoke, "--per-step", "--pictures", "none", "--band", name)
        assert "6 jobs of 6 done before" in answer.err
        assert f"Bands are {words}" in Path("r/report.html").read_text(encoding="utf-8")
        # Fewer than six runs say nothing of others.
        assert pd.read_csv("r/curve.csv")["band_low"].isna().all() == (
            name in ("interval", "bootstrap")
        )
    answer = invoke("batch", "report", "r", "--band", "deviation", "--format", "json")
    assert {curve["band"] for curve in json.loads(answer.out)["curves"]} == {"deviation"}
    assert batch(invoke, "--band", "sigma").status == 2
    with pytest.raises(ConfigError, match=r'band.*"sigma": must be one of interval, bootstrap'):
        tgospa_eval.batch("m.csv", output="s", band="sigma")  # type: ignore[arg-type]
    assert not Path("s").exists()


def test_bands_of_nothing_are_told(invoke: Invoke, runs: Path) -> None:
    answer = batch(invoke, "--band", "deviation")
    assert answer.status == 0
    assert "--band is for curves: no steps are stored; --per-step stores them" in answer.out
