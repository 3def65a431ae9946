"""Batches as users meet them: a folder of runs to a table, again after faults."""

import csv
import json
import math
import os
import re
import shutil
import sys
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pandas as pd
import pytest
from answer import Invoke
from checkout import SAMPLES
from runs import PATTERNS, write_runs

RUNS = 4


@pytest.fixture(params=[RUNS])
def runs(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Some runs of two trackers: the error of tracker b is twice that of tracker a."""
    monkeypatch.chdir(tmp_path)
    write_runs(request.param)
    return tmp_path


few = pytest.mark.parametrize("runs", [2], indirect=True)
"""Where each job writes a folder."""


def batch(invoke: Invoke, *arguments: str) -> Any:
    """A batch of these runs to the folder r."""
    return invoke("batch", *PATTERNS, "-o", "r", "--workers", "1", *arguments)


def test_a_folder_of_runs(invoke: Invoke, runs: Path) -> None:
    answer = batch(invoke, "--by", "tracker", "--format", "json", "--workers", "2")
    assert answer.status == 0
    document = json.loads(answer.out)
    # Five steps with an error of 1 or 2 in each of four runs: totals of 20 and 80.
    groups = document["groups"]
    assert [(group["tracker"], group["jobs"]) for group in groups] == [("a", RUNS), ("b", RUNS)]
    assert [group["total"] for group in groups] == pytest.approx([20.0, 80.0])
    assert document["groups"][0]["combined"] == pytest.approx(20**0.5)
    assert document["groups"][0]["rms"] == pytest.approx(5**0.5)
    assert document["groups"][0]["per_step"] == pytest.approx(1.0)
    parts = list(Path("r/jobs").iterdir())
    again = batch(invoke, "--by", "tracker", "--format", "json")
    assert again.out == answer.out
    assert f"{2 * RUNS} jobs of {2 * RUNS} done before" in again.err
    assert list(Path("r/jobs").iterdir()) == parts
    report = invoke("batch", "report", "r", "--by", "run")
    assert report.status == 0
    assert report.out.startswith("8 jobs, 0 failed\n")


def test_slices_are_added_up(invoke: Invoke, runs: Path) -> None:
    asked = ("--slice", "t=0:2:9", "--slice", "id", "--by", "tracker")
    answer = batch(invoke, *asked, "--format", "json")
    document = json.loads(answer.out)
    for group in document["groups"]:
        for by in ("t=0:2:9", "id"):
            own = [
                row
                for row in document["slices"]
                if (row["by"], row["tracker"]) == (by, group["tracker"])
            ]
            for name in ("total", "localisation", "missed", "false", "switch"):
                assert sum(row[name] for row in own) == pytest.approx(group[name], rel=1e-12)
    # Of each run two of five steps are before t = 2, with an error of 1 or 2.
    first = [row for row in document["slices"] if row["slice"] == "0 to 2"]
    assert [row["total"] for row in first] == pytest.approx([2 * RUNS, 8 * RUNS])
    assert document["jobs"][0]["slices"][0]["by"] == "t=0:2:9"
    with open("r/slices.csv", encoding="utf-8", newline="") as file:
        assert [row["slice"] for row in csv.DictReader(file)] == [
            row["slice"] for row in document["slices"]
        ]
    page = Path("r/report.html").read_text(encoding="utf-8")
    assert "Split by attributes" in page
    shown = invoke("batch", "report", "r", "--by", "tracker").out
    assert re.search(r"^  by t=0:2:9  tracker +total", shown, re.M)
    assert "slices" not in invoke("batch", "report", "r", "--format", "csv").out.splitlines()[0]
    other = batch(invoke, "--slice", "id")
    assert other.status == 2
    assert "slices was" in other.err
    assert invoke("batch", *PATTERNS, "-o", "s", "--slice", "x=2:1").status == 2
    assert not Path("s").exists()


def test_a_changed_file_is_evaluated_again(invoke: Invoke, runs: Path) -> None:
    batch(invoke)
    path = Path("out/a/0.csv")
    path.write_text(
        path.read_text(encoding="utf-8").replace("1,0,1,0", "1,0,4,0"), encoding="utf-8"
    )
    answer = batch(invoke, "--by", "tracker", "--format", "json")
    assert "7 jobs of 8 done before" in answer.err
    assert json.loads(answer.out)["groups"][0]["total"] == pytest.approx(35.0)
    assert invoke("batch", "report", "r").out.startswith("8 jobs, 0 failed")


@few
@pytest.mark.parametrize("option", ["region", "ignore-regions"])
def test_a_changed_file_of_an_option_counts(invoke: Invoke, runs: Path, option: str) -> None:
    Path("regions.csv").write_text("left,top,width,height\n-900,-900,1800,1800\n")
    first = batch(invoke, f"--{option}", "regions.csv", "--format", "csv")
    Path("regions.csv").write_text("left,top,width,height\n-900,-900,902.5,1800\n")
    second = batch(invoke, f"--{option}", "regions.csv", "--format", "csv")
    assert (first.status, second.status) == (0, 0)
    assert "done before" not in second.err
    assert first.out != second.out


def test_faults_are_rows(invoke: Invoke, runs: Path) -> None:
    Path("out/b/2.csv").write_text("id,t\n1,2\n", encoding="utf-8")
    Path("out/a/3.csv").unlink()
    answer = batch(invoke)
    assert (answer.status, answer.out) == (2, "")
    assert "gt/3.csv: there is no estimate out/a/3.csv" in answer.err
    assert not Path("r").exists()
    answer = batch(invoke, "--allow-missing")
    assert answer.status == 5
    assert answer.out.startswith("7 jobs, 1 failed")
    assert "tracker=b run=2: out/b/2.csv, line 1: no column for position" in answer.err
    Path("out/b/2.csv").write_text(
        Path("out/b/1.csv").read_text(encoding="utf-8"), encoding="utf-8"
    )
    answer = batch(invoke, "--allow-missing")
    assert answer.status == 0
    assert "6 jobs of 7 done before" in answer.err


@few
def test_a_tracker_of_which_all_jobs_fail(invoke: Invoke, runs: Path) -> None:
    for file in Path("out/b").iterdir():
        file.write_text("hello\n", encoding="utf-8")
    answer = batch(invoke, "--by", "tracker")
    assert answer.status == 5
    assert re.search(r"^  b  +-  +-  +-  +-  +-  +-$", answer.out, re.MULTILINE)
    assert "nan" not in answer.out + Path("r/report.html").read_text(encoding="utf-8")


def test_notices_about_files_are_told_once(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for k in (1, 2, 3):
        Path(f"t{k}.csv").write_text("id;t;x\na;1;0,5\na;2;1,5\n" + "b;2;\n" * k, encoding="utf-8")
        Path(f"e{k}.csv").write_text("id,t,x\n7,1,0\n7,2,1\n", encoding="utf-8")
    given = ("batch", "--truth", "t{run}.csv", "--estimate", "e{run}.csv", "-o", "out", "-c", "9")
    answer = invoke(*given, "--on-duplicate", "first", "--workers", "1")
    told = "run=1 and 2 more of 3 jobs: truth: read with a decimal comma, as its numbers have it"
    for text in (answer.err, Path("out/report.html").read_text(encoding="utf-8")):
        assert text.count(told) == 1
        assert "truth: 1 row with a blank or NaN position: absent at that step" in text
    assert told in json.loads(invoke("batch", "report", "out", "--format", "json").out)["notes"]
    for part in (tmp_path / "out" / "jobs").glob("*.parquet"):  # an older store has no notices
        pd.read_parquet(part).drop(columns="notices").to_parquet(part)
    answer = invoke("batch", "report", "out")
    assert (answer.status, "decimal comma" in answer.out) == (0, False)


def test_other_settings_are_refused(invoke: Invoke, runs: Path) -> None:
    batch(invoke)
    answer = batch(invoke, "-g", "3")
    assert answer.status == 2
    assert "has a batch with other settings: options.switch_penalty was null, is 3.0" in answer.err
    Path("r/batch.json").write_text("{", encoding="utf-8")
    broken = batch(invoke)
    assert (broken.status, "; run batch again, to a new folder\n" in broken.err) == (3, True)


def test_manifest_with_options_and_reports_with_proofs(invoke: Invoke, runs: Path) -> None:
    Path("m.csv").write_text(
        "truth,estimate,who,cutoff\ngt/0.csv,out/a/0.csv,a,10\ngt/0.csv,out/b/0.csv,b,1.5\n",
        encoding="utf-8",
    )
    answer = invoke(
        "batch", "m.csv", "--workers", "1", "-o", "r", "--reports", "--proof", "--format", "json"
    )
    assert answer.status == 0
    assert [group["cutoff"] for group in json.loads(answer.out)["groups"]] == [10.0, 1.5]
    assert invoke("verify", "r/reports/b/cutoff=1.5", "gt/0.csv", "out/b/0.csv").status == 0
    Path("out/b/0.csv").write_text("id,t\n1,2\n", encoding="utf-8")
    assert (
        "b cutoff=1.5: out/b/0.csv, line 1: "
        in invoke("batch", "m.csv", "--workers", "1", "-o", "r2", "-q").err
    )


def test_labels_with_commas_and_names_of_columns(invoke: Invoke, runs: Path) -> None:
    names = ["step", "rms", "curve", "t", "label.t", "runs", "by whom, and when"]
    rows = [
        ",".join((f"gt/0.csv,out/{name}/0.csv", *(f"{name}-{k}" for k in range(len(names)))))
        for name in ("a", "b")
    ]
    head = ",".join(("truth,estimate", *names[:-1], f'"{names[-1]}"'))
    Path("m.csv").write_text("\n".join((head, *rows)), encoding="utf-8")
    by = [option for name in names[-1:] for option in ("--by", name)]
    by += ["--by", ",".join(names[:-1])]
    answer = invoke("batch", "m.csv", "-o", "r", "--per-step", *by, "--workers", "1")
    assert answer.status == 0, answer.err
    with open("r/curve.csv", encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    heads = [names[-1], "label.step", "label.rms", "label.curve", "label.t", "label.label.t",
             "label.runs", "curve", "step", "t", "runs", "rms"]  # fmt: skip
    assert list(table[0])[: len(heads)] == heads
    shown = (names[-1], "label.step", "step", "rms")
    assert [table[4][name] for name in shown] == ["a-6", "a-0", "5", "1.0"]
    assert [table[10][name] for name in shown] == ["b-6", "b-0", "1", "2.0"]
    unknown = invoke("batch", "report", "r", "--by", "step", "--by", "by whom")
    assert (unknown.status, "--by by whom: no such label; there are " in unknown.err) == (2, True)


def test_shards_make_one_store(invoke: Invoke, runs: Path) -> None:
    counts = [batch(invoke, "--shard", f"{k}/3").out.split()[0] for k in (1, 2)]
    assert counts == ["3", "3"]
    part = invoke("batch", "report", "r", "--format", "json").out
    assert json.loads(part)["expected"] == 8
    assert "warning: 6 of 8 jobs are done; the same batch command does the others" in part
    assert invoke("batch", "report", "r").out.startswith("6 of 8 jobs, 0 failed")
    made = invoke("gate", "r", "--baseline", "b.json", "--update-baseline")
    assert (made.status, Path("b.json").exists()) == (3, False)
    shutil.copytree("r", "same")
    told = invoke("gate", "same", "r").err
    assert all(f"warning: {name}: 6 of 8 jobs are done" in told for name in ("same", "r"))
    assert batch(invoke, "--shard", "3/3").out.split()[0] == "2"
    assert invoke("batch", "report", "r").out.startswith("8 jobs, 0 failed")
    for path in Path("out").rglob("*.csv"):  # a new build of the trackers
        path.write_text(path.read_text(encoding="utf-8") + "9,0,500,500\n", encoding="utf-8")
    assert batch(invoke, "--shard", "1/3").status == 0
    half = invoke("batch", "report", "r", "--format", "json").out
    assert "warning: 3 of 8 jobs are done" in half
    assert len(json.loads(half)["jobs"]) == 3
    made = invoke("gate", "r", "--baseline", "b.json", "--update-baseline")
    assert (made.status, Path("b.json").exists()) == (3, False)
    for text in ("4/3", "1", "1/\uff13", "1/1_0"):
        assert "must be K/N" in batch(invoke, "--shard", text).err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("batch", "-o", "r"),
            "name the jobs by patterns such as --truth gt/{run}.csv and --estimate",
        ),
        (("batch", "m.csv"), "name the folder of the results with -o DIR"),
        (("batch", "--layout", "kitti", "a", "-o", "r"), "takes two folders, GT TRACKERS"),
        (("batch", "report"), "takes one folder: that of -o DIR"),
        (("batch", "report", "r", "-c", "3"), "--cutoff is only for evaluating; batch report"),
    ],
)
def test_wrong_usage(invoke: Invoke, arguments: tuple[str, ...], message: str) -> None:
    answer = invoke(*arguments)
    assert answer.status == 2
    assert message in answer.err


def test_what_is_wrong_is_said_before_any_work(invoke: Invoke, runs: Path) -> None:
    for more, message in (
        (("--proof",), "--proof needs --reports, whose folders hold"),
        (("--by", "colour"), "--by colour: no such label; there are tracker, run"),
        (("--by", "class"), "there are tracker, run; --slice class splits costs by class"),
    ):
        answer = batch(invoke, *more)
        assert (answer.status, answer.out) == (2, "")
        assert message in answer.err
        assert not Path("r").exists()


@few
def test_reports_that_are_asked_for_later_are_written(invoke: Invoke, runs: Path) -> None:
    batch(invoke)
    for more, folder in (((), "r/reports/a/0"), (("--proof",), "r/reports/a/0/proof")):
        answer = batch(invoke, "--reports", *more)
        assert answer.status == 0
        assert answer.out.startswith("4 jobs, 0 failed")
        assert Path(folder).is_dir()
    assert "4 jobs of 4 done before" in batch(invoke, "--reports", "--proof").err


@few
def test_a_report_that_cannot_be_written_is_told_and_tried_again(
    invoke: Invoke, runs: Path
) -> None:
    batch(invoke)
    Path("r/reports/a").mkdir(parents=True)
    Path("r/reports/a/1").touch()
    Path("r/jobs/part-1.new").touch()  # of a process that was killed
    answer = batch(invoke, "--reports")
    assert answer.status == 5
    assert answer.out.startswith("4 jobs, 0 failed")  # the value is there as before
    assert "\ntracker=a run=1: --output r/reports/a/1: is a file; name a folder\n" in answer.err
    assert "4 jobs of 4 done before" in batch(invoke).err  # without folders nothing is wrong
    Path("r/reports/a/1").unlink()
    answer = batch(invoke, "--reports")
    assert (answer.status, "3 jobs of 4 done before" in answer.err) == (0, True)
    assert Path("r/reports/a/1/result.json").is_file()
    assert "4 jobs of 4 done before" in batch(invoke, "--reports").err


@few
@pytest.mark.skipif(sys.platform != "linux", reason="names are bytes on Linux")
def test_names_that_are_no_text(invoke: Invoke, runs: Path) -> None:
    os.rename("out/a", b"out/\xff")
    answer = batch(invoke, "--by", "tracker", "--reports")
    assert answer.status == 0
    assert r"Proven order of these files by RMS-TGOSPA, best first: \udcff, b" in answer.out
    address = re.search(r'href="(reports/[^"]*udcff/0/[^"]*)"', Path("r/report.html").read_text())
    assert address is not None
    assert Path("r", unquote(address[1])).is_file()


def test_names_of_folders_stay_in_the_store(invoke: Invoke, runs: Path) -> None:
    Path("m.csv").write_text(
        "truth,estimate,who,cutoff\ngt/0.csv,out/a/0.csv,..,10\ngt/0.csv,out/a/0.csv,..,2\n",
        encoding="utf-8",
    )
    assert invoke("batch", "m.csv", "--workers", "1", "-o", "r", "--reports").status == 0
    found = [path.relative_to("r/reports") for path in Path("r/reports").rglob("result.json")]
    assert len(found) == 2
    assert {path.name for path in Path().iterdir()} == {"gt", "out", "m.csv", "r"}


def test_sample_benchmark_ranks_two_trackers_without_options(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folders = [str(SAMPLES / "batch" / "mot" / name) for name in ("gt", "trackers")]
    layout = ("batch", "--layout", "motchallenge")
    answer = invoke(*layout, *folders, "-o", "r", "--format", "json")
    assert answer.status == 0
    totals = {group["tracker"]: group["total"] for group in json.loads(answer.out)["groups"]}
    assert totals["careful"] < totals["eager"]
    assert (
        "boxes are compared by their centres (x, y); --distance iou compares their overlap"
        in answer.err
    )
    assert "default c = 10 and gamma = 2; choose with --cutoff and --switch-penalty" in answer.err
    each = invoke("batch", "report", "r", "--by", "sequence,tracker", "--format", "json").out
    found = {(g["sequence"], g["tracker"]): g["total"] for g in json.loads(each)["groups"]}
    assert found["SIM-02", "eager"] < found["SIM-02", "careful"]
    answer = invoke(*folders)
    assert answer.status == 3
    assert f"for all: tgospa-eval {' '.join((*layout, *folders))} -o results" in answer.err
    answer = invoke(*layout, *map(os.path.dirname, folders), "-o", "other")
    assert (answer.status, Path("other").exists()) == (2, False)
    assert f"name {folders[0]}\n" in answer.err


WITH = ("--with", "hota,clear,identity,gospa")
ONE_OF_THREE = "id,t,x\n7,1,0\n7,2,0\n8,3,0.46\n9,4,100\n"
"""With c = 1 the similarities to a truth at 0 are 1, 1, 0.77, and 0 at the fourth step."""


@pytest.fixture
def sequences(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """Two sequences of a tracker: 4 states with a switch and a miss, and 2 without a fault."""
    monkeypatch.chdir(tmp_path)
    head = "id,t,x\n"
    for name, truth, estimate in (
        ("s1", f"{head}1,1,0\n1,2,0\n1,3,0\n1,4,0\n", ONE_OF_THREE),
        ("s2", f"{head}1,1,0\n1,2,0\n", f"{head}1,1,0\n1,2,0\n"),
    ):
        Path(name).mkdir()
        Path(name, "t.csv").write_text(truth, encoding="utf-8")
        Path(name, "by-a.csv").write_text(estimate, encoding="utf-8")
    patterns = ("--truth", "{sequence}/t.csv", "--estimate", "{sequence}/by-{tracker}.csv")
    return ("batch", *patterns, "-c", "1", "-p", "1", "-g", "1", "-o", "r", "--workers", "1")


def test_other_metrics_are_combined_by_their_counts(
    invoke: Invoke, sequences: tuple[str, ...]
) -> None:
    """MOTA = 1 - 3/6, IDF1 = 2 * 4 / 12, and HOTA of the sums at each threshold.

    Up to 0.75 of s1 three states match, DetA = (3 + 2) / (5 + 2), AssA = (3 * 5/12 + 2 * 1) / 5;
    from 0.80 on two, DetA = 4 / 8, AssA = (2 * 1/2 + 2 * 1) / 4.
    """
    answer = invoke(*sequences, *WITH, "--by", "tracker", "--format", "json")
    assert answer.status == 0, answer.err
    (group,) = json.loads(answer.out)["groups"]
    assert (group["with.clear.MOTA"], group["with.clear.IDSW"]) == (0.5, 1)
    assert group["with.clear.MOTP"] == pytest.approx((2.77 + 2) / 5)
    assert group["with.identity.IDF1"] == pytest.approx(8 / 12)
    near, far = math.sqrt(5 / 7 * 3.25 / 5), math.sqrt(4 / 8 * 3 / 4)
    assert group["with.hota.HOTA"] == pytest.approx((15 * near + 4 * far) / 19)
    assert group["with.gospa.total"] == pytest.approx(1.46)
    table = invoke("batch", "report", "r", "--by", "tracker").out
    assert "  a        " in table
    assert "best is high: HOTA, DetA, AssA, MOTA, MOTP, IDF1" in table
    assert re.search(r" GOSPA\n  a +.* 0\.73\n", table)  # the mean of two runs, as in compare
    page = Path("r/report.html").read_text(encoding="utf-8")
    assert "<td>50.00 %</td>" in page[page.index("Other metrics") :]
    assert len(invoke("batch", "report", "r", "--format", "csv").out.splitlines()) == 3
    assert "has a batch with other settings: with was" in invoke(*sequences).err
    refused = invoke(*sequences, "--with", "motq")
    assert (refused.status, "must be of hota" in refused.err) == (2, True)


def test_rows_have_the_metrics_of_single_evaluations(invoke: Invoke, tmp_path: Path) -> None:
    folders = [str(SAMPLES / "batch" / "mot" / name) for name in ("gt", "trackers")]
    boxes = ("--distance", "iou", "--preprocess", "motchallenge", *WITH, "--format", "json")
    answer = invoke(
        "batch", "--layout", "motchallenge", *folders, "-o", str(tmp_path / "r"), *boxes
    )
    job = json.loads(answer.out)["jobs"][2]
    single = json.loads(invoke(job["truth"], job["estimate"], *boxes).out)
    assert json.loads(job["parameters"]) == single["parameters"]
    assert single["parameters"]["preprocess"] == "motchallenge"
    assert job["total"] == single["total"]
    for metric, found in single["with"].items():
        for name, value in found.items():
            assert job[f"with.{metric}.{name}"] == value
    report = invoke("batch", "report", str(tmp_path / "r"))
    assert "by --preprocess motchallenge boxes were left out" in report.out


def test_trackers_are_ranked_and_what_is_missing_is_told(invoke: Invoke, runs: Path) -> None:
    for run in range(RUNS, 7):
        for name in ("gt", "out/a", "out/b"):
            text = Path(name, "0.csv").read_text(encoding="utf-8").replace(",0\n", f",{run}\n")
            Path(name, f"{run}.csv").write_text(text, encoding="utf-8")
    Path("out/b/3.csv").write_text("id,t\n1,2\n", encoding="utf-8")
    answer = batch(invoke, "--by", "tracker", "--format", "json", "--mean-of-roots")
    assert answer.status == 5
    document = json.loads(answer.out)
    assert [(g["jobs"], g["expected"]) for g in document["groups"]] == [(7, 7), (6, 7)]
    assert [g["mean_of_roots"] for g in document["groups"]] == pytest.approx([5**0.5, 20**0.5])
    # Totals of 5 and 20 in each of six runs that both have; of 64 flips two are as far out.
    first, second = document["ranking"]
    assert (first["name"], first["place"], first["jobs"], first["of_jobs"]) == ("a", [1, 1], 6, 7)
    assert (first["combined"], second["combined"]) == pytest.approx((30**0.5, 120**0.5))
    (pair,) = document["comparisons"]
    assert (pair["verdict"], pair["pairs"], pair["permutations"]) == ("less", 6, 64)
    assert (pair["p_value"], pair["significant"]) == (2 / 64, True)
    assert (pair["lower"], pair["upper"]) == pytest.approx((30**0.5, 30**0.5))
    text = invoke("batch", "report", "r").out
    assert "6 of 7" in text
    assert "Statistical order, 6 pairs: a is significantly better than all others" in text
    assert max(map(len, text.splitlines())) <= 80
    # Runs have truths of their own: nobody compares them, unless asked to.
    note = "run is not ranked: no truth has a job for each value of run"
    assert note in invoke("batch", "report", "r", "--by", "run").out
    by_both = json.loads(invoke("batch", "report", "r", "--by", "tracker,run,tracker", "--format",
                                "json").out)  # fmt: skip
    assert (by_both["by"], len(by_both["groups"])) == (["tracker", "run"], 14)
    assert by_both["ranking"] == document["ranking"]


def test_what_is_no_estimate_is_passed_over(invoke: Invoke, runs: Path) -> None:
    os.rename("out", "data")
    os.rename("gt", "data/gt")
    shutil.copytree("data/a", "data/.c")
    truth, estimate = "data/gt/{run}.csv", "data/{tracker}/{run}.csv"
    asked = ("--truth", truth, "--estimate", estimate, "-c", "10", "--workers", "1", "--per-step")
    store = ("batch", *asked, "-o", "data/study", "--by", "tracker", "--format", "json")
    assert invoke(*store).status == 0
    assert Path("data/study/curve.csv").exists()
    pair = ("data/gt/0.csv", "data/a/0.csv", "-c", "10")
    assert invoke("evaluate", *pair, "-o", "data/old", "-q").status == 0
    assert Path("data/old/per_step.csv").exists()
    answers = [invoke(*store)]
    elsewhere = invoke("batch", *asked, "-o", "r", "--by", "tracker", "--format", "json")
    for answer in (*answers, elsewhere):
        assert [group["tracker"] for group in json.loads(answer.out)["groups"]] == ["a", "b"]
    assert f"{2 * RUNS} jobs of {2 * RUNS} done before" in answers[0].err
    compare = ("compare", truth, estimate, "-c", "10", "--format", "json", "-o", "data/out")
    assert invoke(*compare).status == 0
    answers.append(invoke(*compare))
    found = json.loads(answers[-1].out)["estimates"]
    assert sorted(item["name"] for item in found) == ["a", "b"]
    suite = f'max = "tgospa=99"\n[[pair]]\ntruth = "{truth}"\nestimate = "{estimate}"\n'
    Path("suite.toml").write_text(suite, encoding="utf-8")
    answers.append(invoke("gate", "--suite", "suite.toml", "-c", "10", "--format", "json"))
    names = [pair["name"] for pair in json.loads(answers[-1].out)["pairs"]]
    assert names == [f"{tracker}/{run}" for tracker in "ab" for run in range(RUNS)]
    for answer in answers:
        assert answer.status == 0
        told = answer.err.replace("\\", "/").splitlines()
        for text in (
            f"data/.c/0.csv and {RUNS - 1} more files: skipped (hidden by a dot); to "
            "evaluate them, write data/.{tracker}/{run}.csv",
            f"data/gt/0.csv and {RUNS - 1} more files: skipped (the truth itself); to "
            "evaluate them, write data/gt/{run}.csv",
            ": skipped (in a folder of results); to evaluate them, name their folder",
        ):
            assert sum(line.endswith(text) for line in told) == 1, told
        assert sum("skipped (" in line for line in told) == 3


def test_what_is_named_is_evaluated(invoke: Invoke, runs: Path) -> None:
    """Behind a dot, a truth, in a folder of results; a file of the user beside results is his."""
    os.rename("out/b", "out/.b")
    assert invoke("evaluate", "gt/0.csv", "gt/0.csv", "-o", "out/a", "--force", "-q").status == 0
    Path("gt/batch.json").write_text('{"schema": "other"}', encoding="utf-8")
    for truth, estimate, names in (
        ("gt/{run}.csv", "out/.{tracker}/{run}.csv", ["b"]),
        ("gt/{run}.csv", "out/{tracker}/{run}.csv", ["a"]),
        ("gt/0.csv", "{tracker}/1.csv", ["gt"]),
        ("gt/{tracker}.csv", "gt/{tracker}.csv", ["0", "1", "2", "3"]),
    ):
        shutil.rmtree("r", ignore_errors=True)
        patterns = ("--truth", truth, "--estimate", estimate, "-c", "10", "--workers", "1")
        answer = invoke("batch", *patterns, "-o", "r", "--by", "tracker", "--format", "json")
        assert answer.status == 0, answer.err
        assert [group["tracker"] for group in json.loads(answer.out)["groups"]] == names
    hidden = ("--truth", "gt/{run}.csv", "--estimate", "{folder}/b/{run}.csv")
    os.rename("out", ".out")
    os.rename(".out/.b", ".out/b")
    answer = invoke("batch", *hidden, "-c", "10", "-o", "s")
    assert answer.status == 2
    assert "no file matches" in answer.err
    assert "to evaluate them, write .{folder}/b/{run}.csv" in answer.err
