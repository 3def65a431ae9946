"""Rows of a worker: whatever happens to a job is one, and says what."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tgospa_eval.api import evaluate
from tgospa_eval.api.batch_row import (
    NOT_WRITTEN,
    UNSEEN,
    JobTask,
    evaluate_job,
    files_of,
    given_text,
    key_of,
)
from tgospa_eval.api.options import Request
from tgospa_eval.campaign.pairs import Job


@pytest.fixture
def task(tmp_path: Path, quickstart: tuple[str, str]) -> JobTask:
    """A job in a folder of its own."""
    for name, path in zip(("t.csv", "e.csv"), quickstart, strict=True):
        shutil.copy(path, tmp_path / name)
    return asked(tmp_path, cutoff=10.0, switch_penalty=5.0, jobs=1)


def asked(folder: Path, **options: Any) -> JobTask:
    """Of the files of the folder."""
    job = Job(labels={"run": "1"}, truth=str(folder / "t.csv"), estimate=str(folder / "e.csv"))
    chosen = Request(**options)
    key = key_of(job, given_text(chosen), files_of(job, chosen))
    return JobTask(job=job, options=chosen, key=key)


@pytest.mark.parametrize("name", ["t.csv", "e.csv"])
def test_a_file_that_cannot_be_read(task: JobTask, tmp_path: Path, name: str) -> None:
    (tmp_path / name).unlink()
    row = evaluate_job(task)
    assert row["status"] == "failed"
    assert row["message"].startswith(f"{tmp_path / name}: ")
    (tmp_path / name).mkdir()
    assert "folder" in evaluate_job(task)["message"]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (
            ZeroDivisionError("x"),
            "ZeroDivisionError: x; this is an error of this program, please report it",
        ),
        (MemoryError(), "out of memory"),
        (RuntimeError("can't start new thread"), "out of memory"),
    ],
)
def test_a_fault(
    task: JobTask, monkeypatch: pytest.MonkeyPatch, fault: Exception, message: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise fault

    monkeypatch.setattr(evaluate, "read_sides", fail)
    row = evaluate_job(task)
    assert (row["status"], row["message"], row["key"]) == ("failed", message, task.key)


def test_a_file_that_changes_meanwhile(task: JobTask, tmp_path: Path) -> None:
    path = tmp_path / "e.csv"
    path.write_text(path.read_text(encoding="utf-8") + "new,1,0,0\n", encoding="utf-8")
    row = evaluate_job(task)
    assert row["status"] == "failed"
    assert "changed while it was read" in row["message"]
    assert "total" not in row


def test_a_changed_covariance_is_another_key(tmp_path: Path, task: JobTask) -> None:
    matrix = tmp_path / "S.csv"
    keys = set()
    for number in (1, 2):
        matrix.write_text(f"{number},0\n0,1\n", encoding="utf-8")
        keys.add(asked(tmp_path, distance="mahalanobis", covariance=str(matrix)).key)
    assert len(keys) == 2


def test_a_worker_elsewhere_reads_paths_from_where_it_was_asked(
    tmp_path: Path, task: JobTask, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "S.csv").write_text("4,0\n0,1\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    here = replace(
        asked(Path(), distance="mahalanobis", covariance="S.csv", cutoff=3.0), folder="reports/1"
    )
    row = evaluate_job(here)
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    there = evaluate_job(replace(here, base=str(tmp_path)))
    for name in ("seconds", "finished"):
        row.pop(name)
        there.pop(name)
    assert there == row
    assert row["status"] == "done"
    assert (tmp_path / "reports/1/result.json").exists()
    assert list(Path().iterdir()) == []
    blind = evaluate_job(replace(here, base=str(tmp_path / "other")))
    assert blind["status"] == "failed"
    assert str(tmp_path / "other") in blind["message"]
    assert blind[UNSEEN] == here.job.truth


def test_a_folder_of_a_report_that_cannot_be_made(task: JobTask, tmp_path: Path) -> None:
    (tmp_path / "reports").touch()
    row = evaluate_job(replace(task, folder=str(tmp_path / "reports" / "1")))
    assert row["status"] == "done"  # the number is there
    assert row[NOT_WRITTEN].startswith(str(tmp_path / "reports"))
    assert "bug" not in row[NOT_WRITTEN]
