"""Data in parts on a real Dask cluster: the same bytes as here, while a worker is killed."""

import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cluster import Running

from tgospa_eval.evaluation import memory
from tgospa_eval.partitioned import run
from tgospa_eval.simulation import Scene, Tracker, simulate

pytest.importorskip("distributed")

Invoke = Callable[..., Any]

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform == "win32", reason="needs signals"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of Dask, when a worker is killed
]

OPTIONS = ("truth", "estimate", "-c", "50", "-g", "25", "--memory", "400MB", "-q")


def write(folder: Path) -> None:
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
    write(tmp_path)
    monkeypatch.setattr(memory, "MAX_ROWS", 60)  # several blocks
    assert invoke(*OPTIONS, "--jobs", "1", "-o", "here").status == 0
    number_tracks = run.number_tracks
    pids = running.workers()[:1]

    def after_the_scan(*arguments: Any) -> Any:
        while pids:
            os.kill(pids.pop(), signal.SIGKILL)
        return number_tracks(*arguments)

    monkeypatch.setattr(run, "number_tracks", after_the_scan)
    answer = invoke(*OPTIONS, "--scheduler", running.address, "-o", "there")
    assert (answer.status, answer.err) == (0, "")
    assert not pids
    assert contents(tmp_path / "there") == contents(tmp_path / "here")
    assert not (tmp_path / "there" / "work").exists()
