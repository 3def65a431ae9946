"""The page of a batch and its pictures: what they show, where they are written."""

import os
import re
from html import unescape
from pathlib import Path
from urllib.parse import unquote

import pytest
from answer import Invoke
from pages import NASTY
from runs import PATTERNS, write_runs

BATCH = ("batch", *PATTERNS, "-o", "r", "--workers", "1", "--unit", "m")
RUNS = 3


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Some runs of two trackers: the error of tracker b is twice that of tracker a; b/2 fails."""
    monkeypatch.chdir(tmp_path)
    write_runs(RUNS)
    Path("out/b/2.csv").write_text("id,t\n1,2\n", encoding="utf-8")
    return tmp_path


def words(path: str) -> str:
    """What a page says, without its style."""
    text = re.sub("<style>.*?</style>", "", Path(path).read_text(encoding="utf-8"), flags=re.S)
    return " ".join(unescape(re.sub("<[^>]*>", " ", text)).split())


def test_the_page_says_who_is_best_and_what_failed(invoke: Invoke, runs: Path) -> None:
    assert invoke(*BATCH, "--reports", "--per-step").status == 5
    text = words("r/report.html")
    assert "a: RMS-TGOSPA 1 m 6 jobs all exact 1 failed" in text
    assert "Proven order of these files by RMS-TGOSPA, best first: a, b" in text
    assert "Values are over 2 of 3 jobs: those for which all entries have a value" in text
    assert "run a b 0 1.000 2.000 1 1.000 2.000 2 1.000 failed" in text
    assert "b/2 out/b/2.csv, line 1: no column for position" in text
    assert "switch a 3 1 m" in text  # jobs, per step
    assert "b 2 of 3 2 m" in text
    assert "No curves: they need" in text  # without pictures
    assert "2 to 3 runs at each time." in text
    html = Path("r/report.html").read_text(encoding="utf-8")
    assert "<script" not in html
    assert "default-src 'none'" in html
    links = {unquote(link) for link in re.findall('href="([^#"]*)"', html)}
    assert links == {f"reports/{name}/report.html" for name in ("a/0", "a/1", "a/2", "b/0", "b/1")}
    assert all(Path("r", link).is_file() for link in links)


def test_a_report_is_written_where_it_is_asked_for(invoke: Invoke, runs: Path) -> None:
    invoke(*BATCH, "--reports")
    assert invoke("batch", "report", "r").status == 0
    assert sorted(os.listdir()) == ["gt", "out", "r"]
    answer = invoke("batch", "report", "r", "--by", "run", "-o", "deep/page")
    assert answer.status == 0
    assert "wrote 1 file to deep/page/; open deep/page/report.html" in answer.err
    html = Path("deep/page/report.html").read_text(encoding="utf-8")
    links = {unquote(link) for link in re.findall('href="([^#"]*)"', html)}
    assert all(Path("deep/page", link).is_file() for link in links)
    assert "../../r/reports/a/0/report.html" in links
    # The page of a run is made anew, also by the report.
    assert invoke("batch", "report", "r", "--by", "run", "-o", "r").status == 0
    assert "tracker by run" in words("r/report.html")
    assert invoke("batch", "report", "r", "-o", ".").status == 2


def test_a_shard_leaves_the_page_to_the_report(invoke: Invoke, runs: Path) -> None:
    invoke(*BATCH, "--shard", "1/2")
    assert not Path("r/report.html").exists()
    invoke(*BATCH, "--shard", "2/2")
    invoke("batch", "report", "r", "-o", "r")
    assert "6 jobs" in words("r/report.html")


def test_pictures(invoke: Invoke, runs: Path) -> None:
    answer = invoke(*BATCH, "--per-step", "--pictures", "svg", "--style", "paper")
    assert "wrote 2 files and 5 pictures to r/" in answer.err
    for name in ("parts", "heat", "curve", "curve-parts"):
        assert Path(f"r/{name}.svg").read_bytes().startswith(b"<?xml")
    answer = invoke("batch", "report", "r", "-o", "r", "--pictures", "none")
    assert "removed 5 of an earlier run" in answer.err
    assert invoke("batch", "report", "r", "-o", "r", "--pictures", "bmp").status == 2


def test_without_pictures_the_rest_is_written(
    invoke: Invoke, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    invoke(*BATCH, "--per-step")
    monkeypatch.setattr("tgospa_eval.show.style.available", lambda: False)
    answer = invoke("batch", "report", "r", "-o", "q", "--pictures", "png")
    assert answer.status == 0
    assert "no pictures: they need the extra plot: " in answer.err
    assert "tgospa-eval[plot]" in answer.err
    assert {name for name in os.listdir("q") if name[0] != "."} == {"curve.csv", "report.html"}


def test_names_do_not_become_markup(invoke: Invoke, runs: Path) -> None:
    rows = "".join(
        f'gt/0.csv,out/{name}/0.csv,{name},"{label.replace(chr(34), chr(34) * 2)}"\n'
        for label in NASTY
        for name in ("a", "b")
    )
    Path("m.csv").write_text(f"truth,estimate,who,note\n{rows}", encoding="utf-8")
    pictures = ("--pictures", "png")
    answer = invoke(
        "batch", "m.csv", "-o", "r", "--by", "note", "--unit", "<b>$x$", "-c", "10", *pictures
    )
    assert answer.status == 0
    html = Path("r/report.html").read_text(encoding="utf-8")
    assert "<script" not in html
    assert "<b>$x$" not in html
    assert html.count('<td class="rank">1=</td>') == len(NASTY)
    for name in NASTY:
        assert name in unescape(html)
    assert Path("r/heat.png").stat().st_size > 0


def test_parameters_are_shown_apart(invoke: Invoke, runs: Path) -> None:
    rows = "".join(
        f"gt/{run}.csv,out/{who}/{run}.csv,{who},{run},{cutoff},{unit}\n"
        for run in range(2)
        for who in ("a", "b")
        for cutoff, unit in ((1.5, "m"), (10, "m"), (10, "km"))
    )
    Path("m.csv").write_text(f"truth,estimate,who,run,cutoff,unit\n{rows}", encoding="utf-8")
    assert invoke("batch", "m.csv", "-o", "r", "--workers", "1").status == 0
    text = words("r/report.html")
    assert text.startswith("\u2068TGOSPA of a batch\u2069")
    assert "Jobs have 3 different sets of parameters" in text
    lost = text[text.index("Jobs with the highest cost") :]
    assert "switch cutoff 1.5, unit m b/0/cutoff=1.5/unit=m" in lost
    assert lost.count("/cutoff=10/unit=km") == lost.count("/cutoff=1.5/unit=m") == 3
    assert "Jobs are listed for each set of parameters" in lost
    made = text[text.index("Parts of the cost") : text.index("Jobs with the highest cost")]
    assert "from the smallest to the largest of the same parameters" in made
    widths = re.findall(
        'class="swatch localisation" style="width:([0-9.]+)%',
        Path("r/report.html").read_text(encoding="utf-8"),
    )
    assert widths.count("100.00") == 2  # of the other nothing is localisation


def test_brackets_that_overlap_name_nobody_the_best(
    invoke: Invoke, crowd: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    truth, estimate = crowd
    lines = Path(estimate).read_text(encoding="utf-8").splitlines(keepends=True)
    Path("b.csv").write_text("".join(lines[:-1]), encoding="utf-8")
    rows = f"{truth},{estimate},a\n{truth},b.csv,b\n"
    Path("m.csv").write_text(f"truth,estimate,who\n{rows}", encoding="utf-8")
    limit = ("-c", "25", "--time-limit", "1e-6")
    answer = invoke("batch", "m.csv", "-o", "r", "--workers", "1", *limit, "--by", "who")
    assert answer.status == 4
    text = words("r/report.html")
    assert text.startswith("\u2068who: none of 2 is proven best\u2069")
    assert "2 not exact" in text
    assert "of the best assignments found" in text
