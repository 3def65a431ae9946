"""The one table of a study, as `batch` and `compare` print it."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from answer import Invoke
from checkout import ROOT

from tgospa_eval import evaluate

STUDY = ROOT / "sample_data" / "batch" / "montecarlo"
TRUTH, ESTIMATE = f"{STUDY}/{{run}}/truth.csv", f"{STUDY}/{{run}}/confirm-{{confirm}}.csv"
METRIC = ("-c", "10", "-g", "5", "--unit", "m", "-q")
ASKED = "jobs,tgospa,interval,loc,missed,false,switch,place,p,detection,rmse,hota"


def batch(invoke: Invoke, *more: str) -> str:
    """What a batch of the study prints."""
    call = ("batch", "--truth", TRUTH, "--estimate", ESTIMATE, *METRIC, "--by", "confirm")
    return invoke(*call, "-o", "store", *more).out


def compare(invoke: Invoke, *more: str) -> str:
    return invoke("compare", TRUTH, ESTIMATE, *METRIC, *more).out


def first_table(markdown: str) -> list[list[str]]:
    """Its cells, without what tells rows apart."""
    lines = markdown[markdown.index("\n|") :].strip().split("\n\n")[0].splitlines()
    return [[cell.strip(" *") for cell in line.split("|")[2:-1]] for line in lines]


def test_both_verbs_print_the_same_table(invoke: Invoke) -> None:
    asked = ("--with", "hota", "--columns-of-table", ASKED, "--format", "markdown")
    table = first_table(batch(invoke, *asked))
    assert first_table(compare(invoke, *asked)) == table
    head, _, best, other = table
    assert head[1:4] == ["RMS-TGOSPA", "95 % interval", "local."]
    document = json.loads(compare(invoke, "--format", "json"))
    ranking = json.loads(batch(invoke, "--with", "hota", "--format", "json"))
    first, second = document["estimates"]
    assert best[1] == f"{first['normalised']['tgospa']:.4f}"
    for item, entry in zip(document["estimates"], ranking["ranking"], strict=True):
        share = entry["per_step"] / entry["combined"]
        ends = [end * share for end in entry["confidence"]]
        assert item["confidence"] == pytest.approx(ends, rel=1e-12)
        assert list(item["statistical_place"]) == entry["statistical_place"]
        for part in ("localisation", "missed", "false", "switch"):
            assert item["normalised"][part] == pytest.approx(entry[part], rel=1e-12)
    pair, theirs = document["pairs"][0], ranking["comparisons"][0]
    assert pair["p_holm"] == theirs["p_holm"]
    assert pair["lower"] == pytest.approx(theirs["lower"] * share, rel=1e-9)
    assert other[8] == f"{pair['p_holm']:.2g}"
    assert second["normalised"]["tgospa"] - first["normalised"]["tgospa"] == pytest.approx(
        pair["difference"][0]
    )


def write_run(folder: str, run: int, steps: int, errors: dict[str, float]) -> None:
    """A truth that rests, and estimates at these distances."""
    Path(folder, str(run)).mkdir(parents=True)
    for name, error in {"truth": 0.0, **errors}.items():
        rows = "".join(f"1,{t},{error!r},0\n" for t in range(steps))
        Path(folder, str(run), f"{name}.csv").write_text(f"id,t,x,y\n{rows}", encoding="utf-8")


def test_intervals_are_of_the_value_and_not_of_how_long_runs_are(invoke: Invoke) -> None:
    for run in range(8):
        write_run("mc", run, 5 << run, {"A": 1.0, "B": 1.25})
    files = ("mc/{run}/truth.csv", "mc/{run}/{who}.csv")
    asked = ("-c", "10", "-q", "--format", "json")
    first, second = json.loads(invoke("compare", *files, *asked).out)["estimates"]
    assert first["confidence"] == pytest.approx([1.0, 1.0])
    assert second["confidence"] == pytest.approx([1.25, 1.25])
    job = ("batch", "--truth", files[0], "--estimate", files[1], "-o", "r", "--by", "who")
    document = json.loads(invoke(*job, *asked).out)
    assert document["ranking"][1]["per_step_confidence"] == pytest.approx([1.25, 1.25])
    assert document["groups"][0]["per_step_confidence_upper"] == pytest.approx(1.0)
    assert document["groups"][0]["confidence_upper"] > 1.5 * document["groups"][0]["combined"]
    (pair,) = document["comparisons"]
    ends = [pair[f"per_step_{name}"] for name in ("lower", "upper")]
    assert ends == pytest.approx([0.25, 0.25])


def test_what_is_the_same_but_for_roundings_is_marked_alike(invoke: Invoke) -> None:
    """The same errors in another order of the runs; a column twice is one."""
    for run in range(7):
        write_run("mc", run, 9, {"A": 0.1 + 0.3 * run, "B": 0.1 + 0.3 * (6 - run)})
    asked = ("--columns-of-table", "tgospa,tgospa,interval,rmse,mean_error,detection")
    files = ("mc/{run}/truth.csv", "mc/{run}/{who}.csv")
    table = invoke("compare", *files, "-c", "10", "-q", *asked, "--format", "markdown").out
    rows = [line for line in table.splitlines() if line.startswith(("| A", "| B"))]
    assert len(rows) >= 2
    assert "**" not in "".join(rows[:2])


def test_a_run_without_pairs_takes_no_number_from_the_others(invoke: Invoke) -> None:
    for run in range(3):
        write_run("mc", run, 9, {"A": 1.0 if run else 500.0, "B": 2.0})
    files = ("mc/{run}/truth.csv", "mc/{run}/{who}.csv")
    document = json.loads(invoke("compare", *files, "-c", "10", "-q", "--format", "json").out)
    summary = {item["name"]: item["summary"] for item in document["estimates"]}
    assert summary["A"]["summary.rmse"] == pytest.approx(1.0)
    assert summary["A"]["summary.detection_rate"] == pytest.approx(2 / 3)


def test_one_estimate_has_an_interval_and_the_page_the_columns(invoke: Invoke) -> None:
    for run in range(7):
        write_run("mc", run, 9, {"A": 1.0 + run})
    files = ("mc/{run}/truth.csv", "mc/{run}/A.csv")
    asked = ("--columns-of-table", "tgospa,interval,detection", "-o", "out")
    table = invoke("compare", *files, "-c", "10", "-q", *asked, "--format", "markdown").out
    assert re.search(r"\| A \| 4\.\d+ \| \d\.\d+ to \d\.\d+ \| 100\.0 % \|", table)
    assert ">detection<" in Path("out/report.html").read_text(encoding="utf-8")


def summaries(confirm: int) -> list[dict[str, Any]]:
    """The summary of each run, evaluated by itself."""
    return [
        evaluate(
            run / "truth.csv", run / f"confirm-{confirm}.csv", cutoff=10, switch_penalty=5
        ).summary
        for run in sorted(STUDY.iterdir())
    ]


@pytest.mark.filterwarnings("ignore::tgospa_eval.TgospaWarning")
def test_numbers_of_the_summary_are_those_of_all_states(invoke: Invoke) -> None:
    document = json.loads(compare(invoke, "--format", "json"))
    for item in document["estimates"]:
        runs = summaries(int(item["name"][-1]))
        assigned = sum(run["assigned_states"] for run in runs)
        rate = assigned / sum(run["truth_states"] for run in runs)
        square = sum(run["rmse"] ** 2 * run["assigned_states"] for run in runs) / assigned
        assert item["summary"]["summary.detection_rate"] == pytest.approx(rate, rel=1e-12)
        assert item["summary"]["summary.rmse"] == pytest.approx(square**0.5, rel=1e-12)
        false = sum(run["false_tracks"] for run in runs) / len(runs)
        assert item["summary"]["summary.false_tracks"] == pytest.approx(false)


def test_a_column_that_is_not_there(invoke: Invoke) -> None:
    wrong = ("--columns-of-table", "tgospa,rsme")
    for answer in (
        invoke("compare", TRUTH, ESTIMATE, *METRIC, *wrong),
        invoke("batch", "--truth", TRUTH, "--estimate", ESTIMATE, *METRIC, "-o", "s", *wrong),
    ):
        assert answer.status == 2
        assert '--columns-of-table "rsme": there is no such column; there are jobs, ' in answer.err
        assert answer.out == ""
    assert not Path("s").exists()
    answer = invoke("compare", TRUTH, ESTIMATE, *METRIC, "--columns-of-table", "mota")
    assert answer.status == 2
    assert "--columns-of-table mota: is missing; --with clear adds it" in answer.err


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="TeX is not installed")
@pytest.mark.process
@pytest.mark.parametrize("form", ["latex", "siunitx"])
def test_latex_sets_all_tables(invoke: Invoke, form: str) -> None:
    """Also names of trackers that are Greek, or commands."""
    for run in sorted(STUDY.iterdir())[:2]:
        for k, name in ((1, "β_σ"), (4, "50%&$x")):
            target = Path("runs", name, f"{run.name}.csv")
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(run / f"confirm-{k}.csv", target)
        shutil.copy(run / "truth.csv", f"{run.name}.csv")
    call = ("{run}.csv", "runs/{tracker}/{run}.csv", *METRIC, "--with", "hota,gospa")
    made = invoke("compare", *call, "--against", "per-step-gospa", "--format", form).out
    assert made.count(r"\begin{tabular}") == 5
    assert r"(c = 10 m, p = 2, \ensuremath{\gamma} = 5 m, euclidean)" in made
    packages = r"\usepackage{booktabs,siunitx}\usepackage[T1]{fontenc}"
    text = (
        rf"\documentclass[twocolumn]{{article}}{packages}\begin{{document}}{made}\end{{document}}"
    )
    Path("a.tex").write_text(text, encoding="utf-8")
    done = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "a.tex"],
        capture_output=True,
        text=True,
        errors="replace",
    )
    if "siunitx.sty' not found" in done.stdout:
        pytest.skip("the package siunitx is not installed")
    assert done.returncode == 0, done.stdout[-2000:]
