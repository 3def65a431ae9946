"""`evaluate` of folders of tables, and of files beyond the memory that it may take."""

import csv
import gc
import json
import os
import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from answer import Invoke
from partitioned import write_sides

from tgospa_eval import ConfigError, SolverError, evaluate
from tgospa_eval.api import in_parts
from tgospa_eval.api.options import Request
from tgospa_eval.campaign.store import locked
from tgospa_eval.cli.evaluate import partitioned
from tgospa_eval.cli.evaluate.partitioned import work_folder
from tgospa_eval.cli.shared.click_builder import OutputOptions, Size
from tgospa_eval.evaluation import memory
from tgospa_eval.partitioned import run, sides
from tgospa_eval.simulation import Scene, Tracker, simulate

METRIC = ("-c", "100", "-g", "50", "--jobs", "1")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of several files a side, as folders and as one file each."""
    folder = tmp_path_factory.mktemp("recording")
    tracker = Tracker(noise=10.0, detection=0.9, swaps=0.2, near=50, false_rate=0.05)
    scene = Scene(scenario="crossing", targets=12, steps=90)
    write_sides(simulate(scene, tracker, np.random.default_rng(1)), folder)
    return folder


def numbers(document: dict[str, Any]) -> dict[str, Any]:
    """Of a result all that does not depend on how it was read."""
    left_out = ("timings", "files", "tables", "solver", "notices")
    return {name: value for name, value in document.items() if name not in left_out}


def test_folders_are_evaluated_as_the_file_that_they_are_parts_of(
    invoke: Invoke, recording: Path, tmp_path: Path
) -> None:
    one = tmp_path / "one"
    files = str(recording / "truth.parquet"), str(recording / "estimate.parquet")
    folders = str(recording / "truth"), str(recording / "estimate")
    assert invoke(*files, *METRIC, "-o", str(one), "--pictures", "none").status == 0
    answer = invoke(*folders, *METRIC, "-o", str(one), "--memory", "400MB", "--pictures", "png")
    assert (answer.status, answer.out[:9]) == (0, "TGOSPA = ")
    assert "truth is a folder of tables: the data are read in parts" in answer.err
    assert "wrote 8 files and 2 pictures" in answer.err
    assert "removed 5 of an earlier run" in answer.err
    there = {path.relative_to(one).as_posix() for path in one.rglob("*") if path.is_file()}
    assert there == {
        *(".tgospa-eval.json", "result.json", "timings.csv", "report.html"),
        *("costs.png", "cumulative.png", "assignments/part-00000.parquet"),
        *(f"{name}.parquet" for name in ("per_step", "per_truth", "per_estimate", "switches")),
    }
    document = json.loads((one / "result.json").read_text())
    tables = {name: pq.read_table(one / path) for name, path in document["tables"].items()}
    plain = json.loads(invoke(*files, *METRIC, "--format", "json", "-q").out)
    for name, value in numbers(plain).items():
        if name != "summary":  # sums tell some of its numbers
            is_sum = name == "total"
            assert document[name] == (pytest.approx(value, rel=1e-12) if is_sum else value)
    assert tables["switches"].num_rows == len(plain["switches"]) > 10
    assert tables["assignments"].num_rows > 500
    answer = invoke(*folders, *METRIC, "-q", "--format", "csv")
    assert [row["t"] for row in csv.DictReader(answer.out.splitlines())] == [
        str(step["t"]) for step in plain["per_step"]
    ]
    result = evaluate(*folders, 100, 2, 50, memory="400MB", jobs=1)
    assert (result.total, result.lower_bound) == (document["total"], document["lower_bound"])
    again = evaluate(*folders, 100, 2, 50, memory="400MB", jobs=2)
    assert numbers(again.to_dict()) == numbers(result.to_dict())
    del again
    assert result.to_json()
    assert len(result.frame("assignments")) == tables["assignments"].num_rows
    kept = result.tables.folder
    assert Path(kept).is_dir()
    del result
    gc.collect()
    assert not Path(kept).exists()
    printed, same = (
        [block for block in blocks if not block.startswith("  followed")]  # sums tell less of it
        for blocks in (invoke(*side, *METRIC, "-q").out.split("\n\n") for side in (folders, files))
    )
    assert printed[:-1] == same[:-1]  # but for the seconds


@pytest.mark.parametrize("grid", ["truth", "estimate", "common"])
def test_what_is_left_out_does_not_depend_on_blocks(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, grid: str
) -> None:
    rng = np.random.default_rng(5)
    for side, every in (("truth", 3), ("estimate", 2)):
        (tmp_path / side).mkdir()
        t = np.repeat(np.arange(0, 20, every), 4)
        names = {"id": np.tile(["a", "b", "-1", "c"], len(t) // 4), "t": t}
        places = {"x": rng.normal(0, 9, len(t)).round(2), "y": np.where(t % 7 == 1, np.nan, 1.0)}
        table = pa.table({**names, **places, "class": np.tile(["car", "van"], len(t) // 2)})
        pq.write_table(table, tmp_path / side / "part.parquet")
    asked = (*METRIC, "--grid", grid, "--class", "car", "--format", "json", "-q")
    if grid != "truth":
        answer = invoke(*(str(tmp_path / side) for side in ("truth", "estimate")), *asked)
        remedy = "--outage none if the tracker reports only"
        assert (answer.status, remedy in answer.err) == (2, True)
        asked += ("--outage", "none")
    sides = str(tmp_path / "truth"), str(tmp_path / "estimate")
    found = []
    for rows in (1, 10, 10**6):
        monkeypatch.setattr(memory, "MAX_ROWS", rows)
        found.append(json.loads(invoke(*sides, *asked, "--jobs", "1").out))
    files = [f"{side}/part.parquet" for side in sides]
    whole = json.loads(invoke(*files, *asked).out)
    for document in found:
        assert document["input"] == found[0]["input"]
        assert document["total"] == found[0]["total"]
        for role in ("truth", "estimate"):
            mine, plain = document["input"][role], whole["input"][role]
            assert mine["left_out"] == plain["left_out"]
            assert mine["rows"] == plain["rows"]
    assert found[0]["total"] == pytest.approx(whole["total"], rel=1e-12)


def test_compressed_texts_in_any_order_with_times_that_are_texts(
    invoke: Invoke, recording: Path, tmp_path: Path
) -> None:
    table = pq.read_table(recording / "truth.parquet").to_pandas()
    table["t"] = [f"2026-01-01T00:{t // 60:02}:{t % 60:02}Z" for t in table["t"]]
    table.to_csv(tmp_path / "truth.csv", index=False)
    (tmp_path / "truth").mkdir()
    for k in range(4):
        table[k::4][::-1].to_csv(tmp_path / "truth" / f"{k}.csv.gz", index=False)
    folder, file = str(tmp_path / "truth"), str(tmp_path / "truth.csv")
    answer = invoke(folder, file, *METRIC, "--memory", "400MB", "-o", str(tmp_path / "out"))
    assert "TGOSPA = 0, exact" in answer.out
    assert "truth is a folder, and --memory is given: the data are read in parts" in answer.err
    shown = pq.read_table(tmp_path / "out" / "per_step.parquet")["t"].to_pylist()
    assert shown == sorted(set(table["t"]))


@pytest.fixture
def drifting(tmp_path: Path) -> Callable[[bool], tuple[tuple[str, str], tuple[str, str]]]:
    """Ships at irregular times that pass the date line: as files, and as folders of CSV files."""

    def written(iso: bool) -> tuple[tuple[str, str], tuple[str, str]]:
        rng = np.random.default_rng(3)
        for name, share in (("truth", 0.4), ("estimate", 0.3)):
            tick, ship = np.nonzero(rng.random((60, 5)) < share)
            t = tick + rng.choice([0, 0, 0.25, 0.5], len(tick))
            lon = 179.97 + 0.01 * ship + 0.002 * t + rng.normal(0, 1e-4, len(t))
            table = pd.DataFrame({"id": [f"v{k}" for k in ship], "t": t, "lat": 50 + 0.01 * ship})
            table["lon"] = (lon + 180) % 360 - 180
            if iso:
                clock = pd.Timestamp("2026-05-01T08:00:00Z") + pd.to_timedelta(t, unit="s")
                table["t"] = clock.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
            table.to_csv(tmp_path / f"{name}.csv", index=False)
            (tmp_path / name).mkdir(exist_ok=True)
            for k in range(3):
                table[k::3][::-1].to_csv(tmp_path / name / f"{k}.csv", index=False)
        files = str(tmp_path / "truth.csv"), str(tmp_path / "estimate.csv")
        return files, (str(tmp_path / "truth"), str(tmp_path / "estimate"))

    return written


SHIPS = ("-c", "300", "-g", "100", "--distance", "haversine", "--jobs", "1", "--memory", "400MB")


@pytest.mark.parametrize(
    ("rows", "iso", "options"),
    [
        (6, False, ("--steps", "-5:50:2.5")),
        (40, True, ("--steps", "2026-05-01T08:00:10Z:2026-05-01T08:01:20Z:2s")),
    ],
)
def test_steps_that_are_declared_are_those_of_one_file(
    invoke: Invoke,
    drifting: Callable[[bool], tuple[tuple[str, str], tuple[str, str]]],
    monkeypatch: pytest.MonkeyPatch,
    rows: int,
    iso: bool,
    options: tuple[str, ...],
) -> None:
    files, folders = drifting(iso)
    monkeypatch.setattr(memory, "MAX_ROWS", rows)
    plain = invoke(*files, *SHIPS[:-2], *options, "--format", "json")
    parts = invoke(*folders, *SHIPS, *options, "--format", "json")
    one, other = json.loads(plain.out), json.loads(parts.out)
    for name in ("judged", "input", "parameters", "sizes"):
        assert other[name] == one[name], name
    assert other["total"] == pytest.approx(one["total"], rel=1e-12)
    assert other["lower_bound"] <= one["upper_bound"]
    assert one["lower_bound"] <= other["upper_bound"]
    for mine, plain_step in zip(other["per_step"], one["per_step"], strict=True):
        assert mine.pop("t") == plain_step.pop("t")
        assert mine == pytest.approx(plain_step, rel=1e-9, abs=1e-9)
    said, expected = (
        [line for line in answer.err.splitlines() if " steps declared; " in line]
        for answer in (parts, plain)
    )
    assert said == expected != []


def test_results_in_parts_and_of_one_file_are_comparable(
    invoke: Invoke, recording: Path, tmp_path: Path
) -> None:
    for name, ending in (("one", ".parquet"), ("parts", "")):
        sides = (str(recording / f"{side}{ending}") for side in ("truth", "estimate"))
        assert invoke(*sides, *METRIC, "--grid", "truth", "-q", "-o", name).status == 0
    answer = invoke("compare", "one/result.json", "parts/result.json", "-q", "--format", "json")
    assert (answer.status, answer.err) == (0, "")
    assert json.loads(answer.out)["pairs"][0]["verdict"] == "equal"


def test_reading_that_was_broken_off_goes_on(
    tmp_path: Path,
    drifting: Callable[[bool], tuple[tuple[str, str], tuple[str, str]]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, folders = drifting(False)
    options = Request(
        cutoff=300.0, distance="haversine", steps="0:50:0.5", jobs=1, memory=4 * 10**8
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(memory, "MAX_ROWS", 40)
    work = run.scan
    done: list[str] = []

    def broken_off(output: str, **more: Any) -> None:
        if len(done) == 2:
            raise KeyboardInterrupt
        work(output, **more)
        done.append(output)

    monkeypatch.setattr(run, "scan", broken_off)
    with pytest.raises(KeyboardInterrupt):
        partitioned.evaluate_parts(folders, options, OutputOptions(output="out"), "so")
    monkeypatch.setattr(run, "scan", work)
    assert len(done) == 2
    assert all(Path(output).exists() for output in done)
    other = replace(options, steps="0:50:0.25")
    with pytest.raises(ConfigError, match="steps was "):
        partitioned.evaluate_parts(folders, other, OutputOptions(output="out"), "so")
    documents = []
    for where in (tmp_path / "out", tmp_path / "fresh"):
        output = OutputOptions(output=str(where))
        partitioned.evaluate_parts(folders, options, output, "so")
        documents.append(json.loads((where / "result.json").read_text()))
        monkeypatch.undo()
    assert numbers(documents[0]) == numbers(documents[1])


def test_what_needs_all_data_is_refused_by_name(
    invoke: Invoke, recording: Path, tmp_path: Path
) -> None:
    folders = str(recording / "truth"), str(recording / "estimate")
    for options in (
        *(["--curve"], ["--window", "5"], ["--slice", "class"], ["--with", "gospa"], ["--explain"]),
        *(["--by", "class"], ["--step-weights", "w.csv"], ["--existence", "use"]),
        *(
            ["--preprocess", "motchallenge"],
            ["--interpolate", "truth"],
            ["--resample", "1", "--max-gap", "2"],
            ["--time-tolerance", "0.1"],
            ["--sweep", "c=1,2"],
        ),
        *(["--solver", "sinkhorn"], ["--proof", "-o", "none"]),
        *(["--distance", "cloud-wasserstein"], ["--plane", "x,y", "-o", "none"]),
    ):
        answer = invoke(*folders, *METRIC, *options)
        assert (answer.status, answer.out) == (2, ""), options
        assert f"{options[0]} " in answer.err
        assert "is not supported for data in parts (" in answer.err
        assert len(answer.err.splitlines()) == 1
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "switches.parquet").touch()
    assert "mine: is not empty" in invoke(*folders, "-o", "mine").err
    with pytest.raises(ConfigError, match=r"^curve is not supported for data in parts"):
        evaluate(*folders, curve=True)
    with pytest.raises(ConfigError, match="4 apples' is not a size"):
        evaluate(*folders, memory="4 apples")
    files = str(recording / "truth.parquet"), str(recording / "estimate.parquet")
    with pytest.raises(ConfigError, match="scheduler is for data in parts"):
        evaluate(*files, scheduler="tcp://x:1")
    assert "--scheduler is for data" in invoke(*files, "--scheduler", "tcp://x:1").err


def test_filters_that_leave_nothing_are_wrong_as_of_one_file(
    invoke: Invoke, recording: Path, tmp_path: Path
) -> None:
    for name in ("truth", "estimate"):
        table = pq.read_table(recording / f"{name}.parquet").slice(0, 40)
        table = table.append_column("class", pa.array(["car"] * len(table)))
        pq.write_table(table, tmp_path / f"{name}.parquet")
        (tmp_path / name).mkdir()
        pq.write_table(table, tmp_path / name / "0.parquet")
    for status, options in (
        (2, ("--class", "cra")),
        (2, ("--class", "car,cra")),
        (2, ("--truth-class", "cra")),
        (2, ("--time", "1000:")),
        (2, ("--region", "x=1e7:2e7")),
        (2, ("--steps", "0.5:9.5:1")),
        (3, ("--columns", "x,y=foo")),
    ):
        plain = invoke("truth.parquet", "estimate.parquet", *METRIC, *options, "-q")
        answer = invoke("truth", "estimate", *METRIC, *options, "-q")
        assert (plain.status, answer.status, answer.out) == (status, status, ""), options
        expected = plain.err.replace(".parquet", "").splitlines()
        found = answer.err.replace("/0.parquet", "").splitlines()
        assert found == expected, options


def test_classes_that_are_at_other_times_are_there(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "MAX_ROWS", 4)
    for name in ("truth", "estimate"):
        rows = [f"{k},{t},{k}0,0,{'car' if t < 3 else 'van'}\n" for t in range(6) for k in "12"]
        (tmp_path / name).mkdir()
        for path, own in (
            (f"{name}.csv", rows),
            (f"{name}/0.csv", rows[:6]),
            (f"{name}/1.csv", rows[6:]),
        ):
            (tmp_path / path).write_text("id,t,x,y,class\n" + "".join(own), encoding="utf-8")
    asked = (*METRIC, "--time", "4:5", "--format", "json")
    for classes in (("--truth-class", "car"), ("--class", "car,van")):
        plain = invoke("truth.csv", "estimate.csv", *asked, *classes)
        answer = invoke("truth", "estimate", *asked, *classes, "--memory", "1GB")
        assert (answer.status, plain.status) == (0, 0), answer.err
        one, other = json.loads(plain.out), json.loads(answer.out)
        assert (other["total"], other["input"]) == (one["total"], one["input"])


ISO = tuple(f"2026-05-01T08:00:0{k}Z" for k in "123")


@pytest.mark.parametrize(
    ("empty", "times"),
    [("truth", ("1", "2", "3")), ("truth", ISO), ("estimate", ISO), ("truth, estimate", ISO)],
)
def test_sides_without_rows_are_as_of_one_file(
    invoke: Invoke, tmp_path: Path, empty: str, times: tuple[str, ...]
) -> None:
    for name in ("truth", "estimate"):
        rows = [] if name in empty else [f"{k},{time},{k}0,0\n" for time in times for k in "12"]
        (tmp_path / name).mkdir()
        for path in (tmp_path / f"{name}.csv", tmp_path / name / "0.csv"):
            path.write_text("id,t,x,y\n" + "".join(rows), encoding="utf-8")
    shown = (*METRIC, "--format", "json")
    plain = invoke("truth.csv", "estimate.csv", *shown)
    answer = invoke("truth", "estimate", *shown, "--memory", "1GB")
    assert (answer.status, plain.status) == (0, 0), answer.err
    one, other = json.loads(plain.out), json.loads(answer.out)
    for name in ("total", "judged", "input", "sizes", "per_step"):
        assert other[name] == one[name], name


def test_which_folders_and_files_are_read_in_parts(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = Request(memory=10**9)
    truth, estimate = (str(recording / f"{name}.parquet") for name in ("truth", "estimate"))
    assert in_parts.parts_in_words((truth, estimate), options) is None
    why = in_parts.parts_in_words((truth, estimate), Request(memory=1000))
    assert why is not None
    assert why.startswith(f"{truth} and {estimate} need about 180MB of memory, more than ")
    allowed = Request(memory=1000, max_input=1.0)
    assert in_parts.parts_in_words((truth, estimate), allowed) is None
    text = str(tmp_path / "gt.txt")
    Path(text).write_text("1,1,0,0,1,1,1,-1,-1,-1\n")
    with pytest.raises(ConfigError, match=r'only CSV and Parquet .*: allow memory="180MB"'):
        in_parts.parts_in_words((text, estimate), Request(memory=1000))

    def folder(name: str, *tables: str) -> str:
        (tmp_path / name).mkdir()
        for k, table in enumerate(tables):
            (tmp_path / name / f"{k}.csv").write_text(table)
        return str(tmp_path / name)

    by_time = folder("a", "id,t,x\n1,0,0\n1,1,0\n", "id,t,x\n", "id,t,x\n2,2,0\n1,3,0\n")
    assert in_parts.is_recording(by_time, "")
    iso = folder("b", "id;when\n1;2026-01-01T00:00:00\n", "id;when\n1;2026-01-02T00:00:00\n")
    assert in_parts.is_recording(iso, "x, t=when")
    assert not in_parts.is_recording(iso, "x")
    for name, *tables in (
        ("c", "id,t,x\n1,0,0\n1,1,0\n", "id,t,x\n2,1,0\n1,3,0\n"),  # both have step 1
        ("d", "id,t,x\n1,0,0\n", "id,t,y\n2,2,0\n"),
        ("e", "id,t,x\n1,0,0\n"),
        ("f",),
    ):
        path = folder(name, *tables)
        assert not in_parts.is_recording(path, ""), name
        assert in_parts.parts_in_words((path, truth), options) is not None


def test_a_clock_that_is_ahead_is_seen_in_the_middle(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tgospa_eval.partitioned.evaluate.DIAGNOSED_ROWS", 400)
    scene = Scene(targets=6, steps=120)
    truth, estimate = simulate(scene, Tracker(noise=0.5), np.random.default_rng(0))
    late = replace(estimate, times=estimate.times + 4)
    for number, side in enumerate((estimate, late)):
        (tmp_path / str(number)).mkdir()
        folders = write_sides((truth, side), tmp_path / str(number))
        told = invoke(*folders, "-c", "6", "-g", "2", "--jobs", "1").err
        said = "from step 46 to 79: the clock of the estimate seems to be 4 ahead"
        assert (said in told) == (side is late)


def test_warnings_about_defaults_times_and_units_in_parts(invoke: Invoke, tmp_path: Path) -> None:
    stamps = [20260301120058 + k for k in (0, 1, 42, 43)]
    for side, y in (("t", 0), ("e", 50)):
        (tmp_path / side).mkdir()
        table = pd.DataFrame({"id": 1, "t": stamps, "x_m": range(4), "y_m": y})
        table.to_parquet(tmp_path / side / "a.parquet")
    folders = str(tmp_path / "t"), str(tmp_path / "e")
    options = ("--memory", "1GB", "--jobs", "1", "--unit", "km", "--format", "json")
    answer = invoke(*folders, *options)
    codes = [one["code"] for one in json.loads(answer.out)["warnings"]]
    assert {"default-parameters", "calendar-numbers", "unit-label"} <= {*codes}
    assert invoke(*folders, *options[:-2]).err.count("the unit is called km") == 1
    assert codes.count("calendar-numbers") == 2
    table.rename(columns={"x_m": "x_km"}).to_parquet(tmp_path / "e" / "a.parquet")
    answer = invoke(*folders, "--memory", "1GB", "--jobs", "1")
    assert (answer.status, "use --estimate-scale x=1000" in answer.err) == (2, True)


def test_hemispheres_are_signs_in_parts(invoke: Invoke, tmp_path: Path) -> None:
    for side, sign in (("t", 1), ("e", -1)):
        (tmp_path / side).mkdir()
        table = pd.DataFrame({"id": 1, "t": range(4), "lat": 48.0 * sign, "lon": 11.0 * sign})
        table = table.assign(lat_ns="S", lon_ew=["W", "", "W", "W"])
        table.loc[1, ["lat", "lon"]] = None
        table.iloc[:2].to_parquet(tmp_path / side / "a.parquet")
        table.iloc[2:].to_parquet(tmp_path / side / "b.parquet")
    folders = str(tmp_path / "t"), str(tmp_path / "e")
    options = ("--memory", "1GB", "--jobs", "1", "--distance", "haversine", *METRIC)
    assert "TGOSPA = 0," in invoke(*folders, *options).out


def test_wrong_data_leave_no_work(invoke: Invoke, recording: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad"
    bad.mkdir()
    (bad / "part.parquet").write_bytes(b"PAR1 and no more")
    answer = invoke(str(recording / "truth"), str(bad), *METRIC, "-o", str(tmp_path / "out"), "-q")
    assert answer.status == 3
    assert "bad/part.parquet: not a readable Parquet file" in answer.err.replace("\\", "/")
    assert not (tmp_path / "out" / "work").exists()


def test_interrupted_work_is_kept_and_gone_on_with(
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    paths = str(recording / "truth"), str(recording / "estimate")
    options = Request(cutoff=100.0, switch_penalty=50.0, jobs=1, memory=10**9)
    folder = tmp_path / "out"
    output = OutputOptions(output=str(folder), format_="json")
    solve = partitioned.evaluate_in_parts

    def broken_off(*arguments: Any, **more: Any) -> None:
        solve(*arguments, **more)
        shutil.rmtree(folder / "work" / "tables")
        raise KeyboardInterrupt

    monkeypatch.setattr(partitioned, "evaluate_in_parts", broken_off)
    with pytest.raises(KeyboardInterrupt):
        partitioned.evaluate_parts(paths, options, output, "so")
    said = capsys.readouterr().err
    assert f"finished parts are kept in {folder / 'work'}; the same command resumes" in said
    assert "proven so far: " in said
    assert " <= TGOSPA <= " in said
    assert [path.name for path in folder.iterdir()] == ["work"]
    monkeypatch.setattr(partitioned, "evaluate_in_parts", solve)
    other = Request(cutoff=90.0, switch_penalty=50.0, jobs=1, memory=10**9)
    with pytest.raises(
        Exception, match=r"cutoff was 100.0, is 90.0; name another folder, or --force"
    ):
        partitioned.evaluate_parts(paths, other, output, "so")
    with (
        locked(folder / "work", (0, 1)),
        pytest.raises(ConfigError, match='out": another process uses it'),
    ):
        partitioned.evaluate_parts(paths, options, output, "so")
    monkeypatch.setattr(run, "solve_shard", pytest.fail)  # nothing is left to solve
    assert partitioned.evaluate_parts(paths, options, output, "so")
    assert not (folder / "work").exists()
    said = capsys.readouterr()
    assert f"resuming with {folder / 'work'}" in said.err
    assert json.loads(said.out)["certified"]


@pytest.mark.parametrize(
    ("change", "ending"),
    [
        ("in place", "csv"),
        ("in place, unseen", "parquet"),
        ("behind a link", "csv"),
        ("a copy", "parquet"),
    ],
)
def test_a_killed_run_is_begun_anew_where_a_file_was_replaced(
    invoke: Invoke,
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ending: str,
    change: str,
) -> None:
    """Of equal size and with equal time of modification, on systems that know more or not."""

    def write(table: pa.Table, path: Path) -> None:
        if ending == "csv":
            table.to_pandas().to_csv(path, index=False, float_format="%012.3f")
        else:
            pq.write_table(
                table, path, compression="none", use_dictionary=False, write_statistics=False
            )

    changed = tmp_path / "far" / f"1.{ending}"
    for side in ("truth", "estimate"):
        table = pq.read_table(recording / f"{side}.parquet")
        (tmp_path / side).mkdir()
        write(table.filter(pc.less(table["t"], 50)), tmp_path / side / f"0.{ending}")
        later = table.filter(pc.greater_equal(table["t"], 50))
        write(later, tmp_path / side / f"1.{ending}")
    changed.parent.mkdir()
    (tmp_path / "estimate" / changed.name).rename(changed)
    if change == "behind a link":
        (tmp_path / "estimate" / "link").symlink_to(changed.parent)
    else:
        changed = changed.rename(tmp_path / "estimate" / changed.name)
    if change == "in place, unseen":
        for user in (partitioned, sides):
            monkeypatch.setattr(user, "state_of", lambda s: (s.st_size, s.st_mtime_ns))
    asked = ("truth", "estimate", *METRIC, "--memory", "400MB", "--format", "json")

    def killed(output: str, **more: Any) -> None:
        raise SolverError("a process died")

    with monkeypatch.context() as patch:
        patch.setattr(run, "solve_shard", killed)
        assert invoke(*asked, "-o", "out").status == 4
    before, found = changed.read_bytes(), changed.stat()
    if change == "a copy":
        shutil.copy2(changed, tmp_path / "copy")
        os.replace(tmp_path / "copy", changed)
    else:
        x = later["x"].to_numpy().copy()
        x[7] += 50.0
        write(later.set_column(later.column_names.index("x"), "x", pa.array(x)), changed)
    os.utime(changed, ns=(found.st_atime_ns, found.st_mtime_ns))
    assert len(changed.read_bytes()) == len(before)
    assert (changed.read_bytes() == before) == (change == "a copy")
    answer = invoke(*asked, "-o", "out")
    fresh = invoke(*asked, "-q")
    assert numbers(json.loads(answer.out)) == numbers(json.loads(fresh.out))
    assert ("resuming with" in answer.err) == (change == "in place, unseen")
    assert "starting again" in answer.err
    if change == "in place, unseen":
        name = f"estimate/1.{ending}: has changed since the last run; starting again"
        assert name in answer.err.replace("\\", "/")


@pytest.mark.parametrize("most", range(0, 12, 2))
def test_what_is_half_removed_does_not_pass_for_done(
    most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Broken off after so many calls of the system, all of the old work is known, or none."""
    output = OutputOptions(output=str(tmp_path), quiet=True)
    names = {"scan", "shards", "sides"}
    with suppress(KeyboardInterrupt), work_folder(output, {"cutoff": 1}) as folder:
        for name in names:
            (folder / name).mkdir()
            (folder / name / "old").touch()
        raise KeyboardInterrupt
    calls = iter(range(most))

    def breaking(function: Callable[..., Any]) -> Callable[..., Any]:
        def broken(*arguments: Any, **options: Any) -> Any:
            if next(calls, None) is None:
                raise KeyboardInterrupt
            return function(*arguments, **options)

        return broken

    with monkeypatch.context() as patch:
        for name in ("replace", "unlink", "rmdir"):
            patch.setattr(os, name, breaking(getattr(os, name)))
        with suppress(KeyboardInterrupt), work_folder(output, {"cutoff": 1}):
            pass  # done, and so removed
    with suppress(ConfigError), work_folder(output, {"cutoff": 2}) as folder:
        assert not [path for path in folder.rglob("old") if ".removed" not in str(path)]
    with work_folder(output, {"cutoff": 1}) as folder:
        there = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
        assert there <= names | {"run.json"}
        for name in there & names:
            assert (folder / name / "old").exists()
    assert not (tmp_path / "work").exists()


def test_a_folder_of_others_is_left_alone(invoke: Invoke, recording: Path, tmp_path: Path) -> None:
    kept = tmp_path / "out" / "work" / "thesis.txt"
    kept.parent.mkdir(parents=True)
    kept.write_text("precious")
    folders = str(recording / "truth"), str(recording / "estimate")
    answer = invoke(*folders, *METRIC, "-o", str(tmp_path / "out"), "--force", "-q")
    assert answer.status == 2
    assert "it has a folder work that this program did not make" in answer.err
    assert kept.read_text() == "precious"


def test_what_is_not_solved_in_time_is_bracketed(
    invoke: Invoke, recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders = str(recording / "truth"), str(recording / "estimate")
    exact = json.loads(invoke(*folders, *METRIC, "--format", "json", "-q").out)
    asked = (*METRIC, "--format", "json", "--time-limit", "1e-9", "-o", str(tmp_path / "out"))
    answer = invoke(*folders, *asked)
    assert answer.status == 4
    assert "accuracy not reached: solver stopped by the time limit" in answer.err
    found = json.loads(answer.out)
    assert found["lower_bound"] < exact["tgospa"] < found["upper_bound"]
    assert not found["certified"]
    assert not (tmp_path / "out" / "work").exists()


def test_a_component_that_does_not_fit_is_refused_with_the_memory_that_it_takes(
    invoke: Invoke, recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the message proposes works, in the same folder."""
    monkeypatch.setattr(memory, "SHARD_ENTRIES", 10)
    monkeypatch.setattr(memory, "BYTES_AN_ENTRY", 10**6)
    folders = str(recording / "truth"), str(recording / "estimate")
    asked = (*folders, *METRIC, "-o", str(tmp_path / "out"), "-q")
    answer = invoke(*asked, "--memory", "400MB")
    assert answer.status == 2
    proposed = re.search(r"set (--memory \S+), choose", answer.err)
    assert proposed
    assert "\n" not in answer.err.strip()
    again = invoke(*asked, *proposed[1].split(), "--jobs", "3")  # of which one has to do
    assert again.status == 0, again.err


def test_a_limit_below_what_is_needed_is_refused_with_what_works(
    invoke: Invoke, recording: Path, tmp_path: Path
) -> None:
    folders = str(recording / "truth"), str(recording / "estimate")
    for asked in (METRIC, (*METRIC, "-o", str(tmp_path / "out"), "--jobs", "2")):
        answer = invoke(*folders, *asked, "--memory", "100MB", "-q")
        assert (answer.status, answer.out) == (2, "")
        proposed = re.fullmatch(
            r"data in parts need at least .*: set (--memory \d+MB)\n", answer.err
        )
        assert proposed
        assert not (tmp_path / "out" / "work").exists()
        assert invoke(*folders, *asked, *proposed[1].split(), "-q").status == 0


def test_files_whose_near_pairs_take_more_are_read_in_parts(
    invoke: Invoke, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = str(recording / "truth.parquet"), str(recording / "estimate.parquet")
    asked = (*METRIC, "--memory", "400MB", "--format", "json")
    plain = json.loads(invoke(*files, *asked).out)
    monkeypatch.setattr(memory, "BYTES_COMPARED", (40, 10**6))
    answer = invoke(*files, *asked)
    assert re.search(r"[\d,]+ near pairs of objects need about .* more than --memory", answer.err)
    assert "the data are read in parts" in answer.err
    document = json.loads(answer.out)
    assert document["total"] == pytest.approx(plain["total"], rel=1e-12)
    result = evaluate(*files, 100, 2, 50, memory="400MB")
    assert result.total == document["total"]
    sides = [pq.read_table(file).to_pandas() for file in files]
    with pytest.raises(ConfigError, match="near pairs of objects need about"):
        evaluate(*sides, 100, 2, 50, memory="400MB")


@pytest.mark.parametrize("format", ["csv", "parquet"])
@pytest.mark.parametrize("drawn", [False, True])
def test_shares_add_up_to_the_limit(format: str, drawn: bool) -> None:
    jobs = []
    for limit in range(250 * memory.MB, 4000 * memory.MB, 50 * memory.MB):
        share = memory.Share.of(limit, 4, [format], pictures=drawn, cluster=False)
        others = 0 if share.jobs == 1 else memory.base("worker", [format])
        helpers = memory.HELPERS if share.jobs > 1 else 0
        taken = memory.base("main", [format]) + helpers + share.jobs * (others + share.data)
        assert limit - share.jobs < taken <= limit
        jobs.append(share.jobs)
        assert share.fits_component(share.entries, masked=True)
        largest = int(share.single / share.entry)
        assert share.fits_component(largest, masked=False) == (share.jobs == 1)
    assert jobs == sorted(jobs)
    assert {jobs[0], jobs[-1]} == {1, 4}


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("4GB", 4 * 10**9),
        ("500 mb", 5 * 10**8),
        ("1.5", 15 * 10**8),
        ("2GiB", 2**31),
        (3, 3 * 10**9),
    ],
)
def test_sizes_of_memory(text: object, size: int) -> None:
    assert Size().convert(text, None, None) == size


@pytest.mark.parametrize("text", ["", "GB", "4 apples", "-1GB", "1MB", "1e3GB", "nan", True])
def test_what_is_no_size(text: object) -> None:
    with pytest.raises(click.BadParameter, match=r"is not a size; write 4GB|less than 100MB"):
        Size().convert(text, None, None)
