"""Batches and data in parts on a real Dask cluster: the same numbers, and what losses cost."""

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from answer import Invoke
from browser import PATIENCE
from cluster import Running, cluster
from faults import FATAL, double, slow

from tgospa_eval import engines
from tgospa_eval.campaign.store import Store
from tgospa_eval.common import files
from tgospa_eval.evaluation import memory
from tgospa_eval.partitioned import run as partitioned
from tgospa_eval.simulation import Scene, Tracker, simulate

pytest.importorskip("distributed")


pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform == "win32", reason="needs signals"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of Dask, when a scheduler is killed
]

PATTERNS = ("--truth", "gt/{run}.csv", "--estimate", "out/{run}.csv", "-c", "10", "-q")
RUNS = 24


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A Dask cluster of two workers; without work it takes a sixth of a core, so it ends here."""
    with cluster(tmp_path_factory.mktemp("cluster")) as found:
        yield found


@pytest.fixture
def runs(tmp_path: Path) -> None:
    """Runs with different numbers."""
    for run in range(RUNS):
        for name, error in (("gt", 0), ("out", run / 16)):
            rows = "".join(f"1,{k},{k + error},{run}\n" for k in range(5))
            (tmp_path / name).mkdir(exist_ok=True)
            (tmp_path / name / f"{run}.csv").write_text(f"id,t,x,y\n{rows}", encoding="utf-8")


def after_first_rows(monkeypatch: pytest.MonkeyPatch, act: Callable[[], object]) -> None:
    """Do something once when rows are stored, of each answer as it comes."""
    add, acts = Store.add, [act]

    def added(store: Store, rows: Any) -> None:
        add(store, rows)
        if rows and acts:
            acts.pop()()

    monkeypatch.setattr(Store, "add", added)
    monkeypatch.setattr("tgospa_eval.api.batch.FLUSH", 0.0)


def numbers(folder: str) -> pd.DataFrame:
    """What is stored of each run, without what is other each time; nothing is doubled."""
    rows = pd.concat(pd.read_parquet(path) for path in Path(folder, "jobs").glob("*.parquet"))
    assert len(rows) == rows["key"].nunique()
    return rows.drop(columns=["seconds", "finished"]).sort_values("key", ignore_index=True)


def test_same_numbers_while_a_worker_is_killed(
    running: Running, invoke: Invoke, runs: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert invoke("batch", *PATTERNS, "-o", "here", "--workers", "1").status == 0
    pid = running.workers()[0]
    after_first_rows(monkeypatch, lambda: os.kill(pid, signal.SIGKILL))
    answer = invoke("batch", *PATTERNS, "-o", "there", "--scheduler", running.address)
    assert (answer.status, answer.err) == (0, "")
    assert pid not in running.workers()
    pd.testing.assert_frame_equal(numbers("there"), numbers("here"), check_exact=True)
    assert len(numbers("there")) == RUNS


def test_one_job_that_kills_its_workers_is_to_blame(
    running: Running, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(engines, "ATTEMPTS", (engines.ATTEMPTS[0], engines.ATTEMPTS[-1]))
    jobs = [FATAL, 1, 2, 3]
    answers = engines.spread(double, jobs, lambda job: -job, engines.Cluster(running.address))
    assert sorted(answers) == [-FATAL, 2, 4, 6]


def test_what_is_broken_off_is_cancelled(running: Running) -> None:
    answers = engines.spread(slow, range(1000), abs, engines.Cluster(running.address))
    next(answers)
    assert running.tasks() > 1
    answers.close()
    until = time.monotonic() + PATIENCE
    while running.tasks():
        assert time.monotonic() < until
        time.sleep(0.05)


def test_workers_with_another_version(
    running: Running, invoke: Invoke, runs: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engines, "__version__", "9.9")
    answer = invoke("batch", *PATTERNS, "-o", "r", "--scheduler", running.address)
    assert (answer.status, answer.out) == (2, "")
    assert "this process has 9.9: install the same" in answer.err


def test_workers_that_do_not_see_the_files(
    running: Running, invoke: Invoke, runs: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr("tgospa_eval.api.batch.os.getcwd", lambda: str(tmp_path / "gt"))
        answer = invoke("batch", *PATTERNS, "-o", "r", "--scheduler", running.address)
    assert (answer.status, answer.out, answer.err.count("\n")) == (2, "", 1)
    assert f"does not see {tmp_path}/gt/gt/" in answer.err
    assert list(Path("r/jobs").iterdir()) == []  # nothing to retry


def test_a_scheduler_that_is_lost(
    running: Running, invoke: Invoke, runs: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "c").mkdir()
    alone = cluster(tmp_path / "c", workers=1, nanny=False)
    with alone as found, monkeypatch.context() as patched:
        after_first_rows(patched, lambda: os.kill(found.scheduler.pid, signal.SIGKILL))
        answer = invoke("batch", *PATTERNS, "-o", "r", "--scheduler", found.address)
        assert (answer.status, answer.out) == (2, "")
        assert answer.err == (
            f"--scheduler {found.address}: the connection was lost; stored results "
            "are kept, and the same command continues from them\n"
        )
    assert 0 < len(numbers("r")) < RUNS
    monkeypatch.setattr(engines, "CONNECT", 0.3)
    again = invoke("batch", *PATTERNS, "-o", "r", "--scheduler", found.address)
    assert again.status == 2
    assert again.err.startswith(f"--scheduler {found.address}: no Dask scheduler answers")
    another = ("--scheduler", running.address)
    assert invoke("batch", *PATTERNS, "-o", "r", *another).status == 0
    assert len(numbers("r")) == RUNS


def test_a_cluster_without_workers_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: list[dict[str, int]] = [{}, {}, {"a": 3, "b": 1}]

    class Client:
        def nthreads(self) -> dict[str, int]:
            return counts.pop(0)

    told: list[str] = []
    monkeypatch.setattr(files, "announce", told.append)
    monkeypatch.setattr(engines, "POLL", -1.0)
    pool = engines.Remote("tcp://host:1", Client())
    pool.poll()
    pool.poll()
    assert told == ["waiting for workers of tcp://host:1"]
    assert pool.workers() == 4


def test_wrong_use(invoke: Invoke, runs: None) -> None:
    scheduler = ("--scheduler", "nonsense")
    answer = invoke("batch", *PATTERNS, "-o", "r", *scheduler)
    assert answer.status == 2
    assert "--scheduler nonsense: no Dask scheduler answers: missing port number" in answer.err
    answer = invoke("batch", *PATTERNS, "-o", "r", *scheduler, "--workers", "3")
    assert answer.status == 2
    assert "leave out --workers" in answer.err


# --- data in parts --------------------------------------------------------------------------------

OPTIONS = ("truth", "estimate", "-c", "50", "-g", "25", "--memory", "400MB", "-q")


def write_parts(folder: Path) -> None:
    """Both sides in three files each."""
    sides = simulate(
        Scene(scenario="crossing", targets=6, steps=40),
        Tracker(noise=5.0, detection=0.9, swaps=0.2, near=30, false_rate=0.05),
        np.random.default_rng(1),
    )
    for name, side in zip(("truth", "estimate"), sides, strict=True):
        (folder / name).mkdir()
        state = {"x": side.state[:, 0], "y": side.state[:, 1]}
        table = pa.table({"id": side.ids[side.track].astype(str), "t": side.step, **state})
        third = len(table) // 3 + 1
        for k in range(3):
            pq.write_table(table.slice(k * third, third), folder / name / f"{k}.parquet")


def contents(folder: Path) -> dict[str, object]:
    """The tables, byte by byte, and the document without its times."""
    found: dict[str, object] = {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*.parquet"))
    }
    document = json.loads((folder / "result.json").read_text("utf-8"))
    return found | {name: value for name, value in document.items() if name != "timings"}


def test_same_bytes_in_a_folder_named_from_here_while_a_worker_is_killed(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, running: Running
) -> None:
    write_parts(tmp_path)
    monkeypatch.setattr(memory, "MAX_ROWS", 60)  # several blocks
    assert invoke(*OPTIONS, "--jobs", "1", "-o", "here").status == 0
    number_tracks = partitioned.number_tracks
    pids = running.workers()[:1]

    def after_the_scan(*arguments: Any) -> Any:
        while pids:
            os.kill(pids.pop(), signal.SIGKILL)
        return number_tracks(*arguments)

    monkeypatch.setattr(partitioned, "number_tracks", after_the_scan)
    answer = invoke(*OPTIONS, "--scheduler", running.address, "-o", "there")
    assert (answer.status, answer.err) == (0, "")
    assert not pids
    assert contents(tmp_path / "there") == contents(tmp_path / "here")
    assert not (tmp_path / "there" / "work").exists()
