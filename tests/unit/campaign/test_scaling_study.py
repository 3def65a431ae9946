"""The scaling study: seeded, resumable, mean and spread."""

import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from answer import Invoke

from tgospa_eval import SolverError
from tgospa_eval.campaign import solver_runs
from tgospa_eval.campaign.solver_runs import spread
from tgospa_eval.campaign.store import Store, locked
from tgospa_eval.simulation import Scene, Tracker

SMALL = ("compare", "--simulate", "--targets", "3,6", "--steps", "10,20", "--runs", "3",
         "--epsilon", "0.1,0.03", "--jobs", "1", "-q")  # fmt: skip


def timeless(folder: Path) -> list[dict]:
    """Rows without what differs from run to run."""
    rows = Store(str(folder / "runs")).rows()
    return rows.drop(columns=["seconds", "seconds.prepare", "finished"]).to_dict("records")


@pytest.fixture(autouse=True)
def _no_pictures(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """They take most of the time, and are looked at in one test."""
    if request.node.name != "test_report":
        monkeypatch.setattr("tgospa_eval.show.style.available", lambda: False)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the study of all tests is kept once it is made."""
    return tmp_path_factory.mktemp("kept") / "study"


@pytest.fixture
def study(tmp_path: Path, invoke: Invoke, kept: Path) -> Path:
    """A folder of its own with that study."""
    if not kept.exists():
        assert invoke(*SMALL, "-o", str(kept)).status == 0
    return Path(shutil.copytree(kept, tmp_path / "study"))


def test_spread() -> None:
    assert spread([1.0, 3.0]) == {"mean": 2.0, "deviation": pytest.approx(2**0.5), "max": 3.0}
    assert spread([1.0])["deviation"] is None
    assert spread([])["mean"] is None


def test_killed_study_goes_on(
    study: Path, tmp_path: Path, environment: dict[str, str], invoke: Invoke
) -> None:
    """What was done stays, what was cut off is done again, and all is as without the kill."""
    killed, whole = tmp_path / "killed", study
    process = subprocess.Popen(
        [sys.executable, "-m", "tgospa_eval", *SMALL, "--runs", "500", "-o", str(killed)],
        env=environment,
        stdout=subprocess.DEVNULL,
    )
    while len(list(killed.glob("runs/jobs/part-*.parquet"))) < 3:
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = {part: part.read_bytes() for part in killed.glob("runs/jobs/part-*.parquet")}
    assert invoke(*SMALL, "-o", str(killed)).status == 0
    assert all(part.read_bytes() == content for part, content in kept.items())
    wanted = timeless(whole)
    of_whole = {row["key"]: repr(row) for row in wanted}
    of_killed = {row["key"]: repr(row) for row in timeless(killed)}
    assert {key: of_killed[key] for key in of_whole} == of_whole
    assert len(wanted) == 12 * 3
    document = json.loads((killed / "compare.json").read_text(encoding="utf-8"))
    assert [(s["targets"], s["steps"]) for s in document["sizes"]] == [
        (3, 10), (3, 20), (6, 10), (6, 20),
    ]  # fmt: skip
    # more runs are added to those that are there
    more = invoke(*SMALL, "--runs", "4", "-o", str(whole), "--format", "json")
    assert json.loads(more.out)["runs"] == 4
    assert len(timeless(whole)) == 16 * 3
    assert os.listdir(killed) == os.listdir(whole)


def test_rows_of_a_study_are_those_of_a_batch(study: Path, invoke: Invoke) -> None:
    """They can be added up and ranked: all solvers prove the same values."""
    report = invoke("batch", "report", str(study / "runs"), "--by", "solver", "--format", "json")
    ranking = json.loads(report.out)["ranking"]
    assert {item["name"] for item in ranking} == {"certified", "sinkhorn 0.1", "sinkhorn 0.03"}
    assert ranking[0]["jobs"] == 12


def test_another_setting_is_refused(tmp_path: Path, invoke: Invoke) -> None:
    folder = str(tmp_path / "study")
    small = ("compare", "--simulate", "--targets", "2", "--steps", "5", "--runs", "1", "-o", folder)
    assert invoke(*small).status == 0
    for options, name in (
        (["--seed", "1"], "seed"),
        (["-c", "5"], "parameters"),
        (["--scenario", "crossing"], "scene"),
        (["--epsilon", "0.1"], "solvers"),
    ):
        answer = invoke(*small, *options)
        assert answer.status == 2
        assert f"has a batch with other settings: options.{name} was " in answer.err
    assert "1 scene is finished, resuming" in invoke(*small).err
    assert len(timeless(tmp_path / "study")) == 5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ["--targets", "1,100000", "--steps", "1,100000"],
            "100000 targets in 100000 steps are too",
        ),
        (["--targets", "0,3"], "targets is 0: must be 1 or more"),
        (["--steps", "5,5"], "steps: a number is given twice"),
    ],
)
def test_sizes_are_checked_together(options: list[str], message: str, invoke: Invoke) -> None:
    answer = invoke("compare", "--simulate", "-q", *options)
    assert (answer.status, answer.out) == (2, "")
    assert message in answer.err


def test_scenes_are_counted_one_by_one() -> None:
    """A list of so many would not fit into memory."""
    made = solver_runs.Study(
        scene=Scene(), tracker=Tracker(), seed=0, parameters=None, distance=None, solvers=(),
        targets=(2,), steps=(5,), runs=10**12,
    )  # fmt: skip
    assert list(itertools.islice(made.wanted(), 2)) == [(2, 5, 1), (2, 5, 2)]


def test_files_of_others_are_left_as_they_are(tmp_path: Path, invoke: Invoke) -> None:
    small = ("compare", "--simulate", "--targets", "2", "--steps", "5", "--runs", "1", "-o", ".")
    (tmp_path / "report.md").write_text("mine", encoding="utf-8")
    answer = invoke(*small)
    assert (answer.status, "is not empty" in answer.err) == (2, True)
    (tmp_path / "report.md").unlink()
    assert invoke(*small).status == 0
    for left in tmp_path.iterdir():  # as if killed before the report
        if left.name != "runs":
            left.unlink()
    (tmp_path / "report.md").write_text("mine", encoding="utf-8")
    answer = invoke(*small)
    assert (answer.status, "report.md in it was not written" in answer.err) == (2, True)
    assert (tmp_path / "report.md").read_text(encoding="utf-8") == "mine"


def test_failing_and_contradicting_scenes_are_counted(
    tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of four scenes the first cannot be made, a solver fails in the second, the third is wrong."""
    kept = {"prepare": solver_runs.prepare, "run_here": solver_runs.run_here}
    scenes = iter(range(-1, 5))  # before the first two solvers are warmed up
    at, elsewhere = [0], []

    def prepare(*sides, **options):
        at[0] = next(scenes)
        if at[0] == 1:
            raise MemoryError
        return kept["prepare"](*sides, **options)

    def run_here(prepared, solver, progress):
        made = kept["run_here"](prepared, solver, progress)
        if solver.name == "sinkhorn" and at[0] == 2:
            raise SolverError("gave up")
        if solver.name == "sinkhorn" and at[0] == 3:
            return made[0], elsewhere[0]
        elsewhere.append(made[1])
        return made

    monkeypatch.setattr(solver_runs, "prepare", prepare)
    monkeypatch.setattr(solver_runs, "run_here", run_here)
    call = ("compare", "--simulate", "--targets", "2", "--steps", "5", "--runs", "4", "--epsilon",
            "0.1", "-q", "-o", str(tmp_path), "--format", "json")  # fmt: skip
    answer = invoke(*call)
    assert answer.status == 4
    document = json.loads(answer.out)
    assert document["contradictions"] == [[2, 5, 3, "certified", "sinkhorn 0.1"]]
    size = document["sizes"][0]
    assert size["left_out"] == 2
    certified, sinkhorn = size["solvers"]
    assert (certified["failed"], sinkhorn["failed"]) == (1, 2)
    assert size["normalised"]["tgospa"] > 1
    messages = [row["message"] for row in timeless(tmp_path) if row["status"] == "failed"]
    assert messages == ["failed: out of memory", "failed: out of memory", "failed: gave up"]
    again = invoke(*call)  # records of failures are records, too
    assert json.loads(again.out) == document
    assert "2 scenes left out" in " ".join(invoke(*call[:-2]).out.split())


def test_one_process_at_a_time(tmp_path: Path, invoke: Invoke) -> None:
    small = ("compare", "--simulate", "--targets", "2", "--steps", "5", "--runs", "1", "-o", ".")
    assert invoke(*small).status == 0
    with locked(tmp_path / "runs", (1, 1)):
        assert "another process uses it" in invoke(*small).err


def test_report(study: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("tgospa_eval.show.figure_tools.written", lambda *_: b"")
    folder = study
    given = ("--format", "markdown", "--pictures", "png,pdf", "--style", "paper")
    answer = invoke(*SMALL, "-o", str(folder), *given)
    report = (folder / "report.md").read_text(encoding="utf-8")
    assert answer.out in report
    pictures = {path.name for path in folder.glob("*.png")}
    assert pictures == {"error_over_epsilon.png", "scaling.png"}
    assert report.count(".png)") == 2
    assert ".pdf" not in report
    assert len([*folder.glob("*.pdf")]) == 2
    assert "Scaling study on simulated scenes" in (folder / "report.html").read_text("utf-8")
    assert set(re.findall(r"\]\((.+)\)", report)) == pictures
    assert "12 scenes of 4 sizes, 3 runs each: all brackets overlap" in report
