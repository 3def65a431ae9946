"""Batches that are killed at random moments: nothing lost, nothing doubled, nothing mixed."""

import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from answer import Invoke
from browser import PATIENCE

if sys.platform == "win32":
    pytest.skip("needs signals", allow_module_level=True)


PATTERNS = ("--truth", "gt/{run}.csv", "--estimate", "out/{run}.csv", "-c", "10", "-q")

SCRIPT = (
    "import sys\n"
    "from tgospa_eval.cli import main\n"
    "from tgospa_eval import engines\n"
    "from tgospa_eval.api import batch as run\n"
    "engines.ATTEMPTS = [(1, *rest) for _, *rest in engines.ATTEMPTS]\n"
    "run.FLUSH = 0.02\n"
    "main(sys.argv[1:])\n"
)
"""The command, with parts as often as they come."""


@pytest.fixture(params=[20])
def runs(tmp_path: Path, request: pytest.FixtureRequest) -> int:
    """Runs whose total is five times the square of their number over 16."""
    count = int(request.param)
    for run in range(count):
        for name, error in (("gt", 0), ("out", run / 16)):
            rows = "".join(f"1,{k},{k + error},{run}\n" for k in range(5))
            (tmp_path / name).mkdir(exist_ok=True)
            (tmp_path / name / f"{run}.csv").write_text(f"id,t,x,y\n{rows}", encoding="utf-8")
    return count


def begin(folder: Path, env: dict[str, str]) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, "batch", *PATTERNS, "-o", "r", "--workers", "1"],
        cwd=folder, env=env, start_new_session=True, text=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def stored(folder: Path) -> pd.DataFrame:
    """Every row of every part."""
    while True:
        try:
            parts = [pd.read_parquet(path) for path in (folder / "r/jobs").glob("part-*.parquet")]
        except FileNotFoundError:  # joined meanwhile
            continue
        rows = pd.concat(parts) if parts else pd.DataFrame(columns=["key", "finished"])
        return rows.drop_duplicates(["key", "finished"])


def wait_for(condition: Callable[[], bool]) -> None:
    until = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.03)


def children(process: int) -> list[int]:
    """The worker processes of a batch."""
    found = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii").split()
    return [
        int(pid) for pid in found if b"LokyProcess" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]


def check(folder: Path, count: int) -> None:
    """Each run is there once, with its own number."""
    rows = stored(folder)
    assert len(rows) == rows["key"].nunique() == count
    assert (rows["status"] == "done").all()
    errors = rows["label.run"].astype(int) / 16
    assert rows["total"].tolist() == pytest.approx((5 * errors.clip(upper=10) ** 2).tolist())


@pytest.mark.parametrize(
    ("kills", "runs"), [(1, 60), pytest.param(20, 1200, marks=pytest.mark.slow)], indirect=["runs"]
)
def test_kills_at_random_moments(
    tmp_path: Path, runs: int, unmeasured: dict[str, str], invoke: Invoke, kills: int
) -> None:
    """Of the command with all that it began; each time a little more is stored."""
    rng = random.Random(kills)
    known: set[str] = set()
    for _ in range(kills):
        process = begin(tmp_path, unmeasured)
        more = rng.randrange(1, 6)
        wait_for(lambda: len(stored(tmp_path)) > len(known) + more)  # noqa: B023
        time.sleep(rng.random() * 0.05)
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        rows = stored(tmp_path)
        assert rows["key"].is_unique
        assert known <= set(rows["key"])
        known = set(rows["key"])
    assert invoke("batch", *PATTERNS, "-o", "r", "--workers", "1").status == 0
    check(tmp_path, runs)


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_a_second_process_is_refused_and_a_worker_is_killed(
    tmp_path: Path, runs: int, unmeasured: dict[str, str], invoke: Invoke
) -> None:
    process = begin(tmp_path, unmeasured)
    wait_for(lambda: len(stored(tmp_path)) > 0)
    os.kill(process.pid, signal.SIGSTOP)  # it is at work for as long as it takes to see
    try:
        answer = invoke("batch", *PATTERNS, "-o", "r")
        assert (answer.status, answer.out) == (2, "")
        assert "another process uses it" in answer.err
        assert "with other settings" in invoke("batch", *PATTERNS, "-g", "3", "-o", "r").err
        os.kill(children(process.pid)[0], signal.SIGKILL)
    finally:
        os.kill(process.pid, signal.SIGCONT)
    _, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, err) == (0, "")
    check(tmp_path, runs)


def test_no_room_for_a_part(
    tmp_path: Path, runs: int, unmeasured: dict[str, str], invoke: Invoke
) -> None:
    """A limit of the length of files stands for a disk that is full."""
    most = 4096  # settings and locks are shorter, a part of 50 columns is longer
    process = subprocess.run(
        [sys.executable, "-c", "import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
         + SCRIPT, "batch", *PATTERNS, "-o", "r", "--workers", "1"],
        cwd=tmp_path, env=unmeasured, capture_output=True, text=True, timeout=PATIENCE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)), check=False,
    )  # fmt: skip
    assert process.returncode == 2
    assert process.stderr.startswith("-o r: cannot be written: ")
    assert process.stderr.endswith("File too large\n")
    assert list((tmp_path / "r" / "jobs").iterdir()) == []
    assert invoke("batch", *PATTERNS, "-o", "r", "--workers", "1").status == 0
    check(tmp_path, runs)
