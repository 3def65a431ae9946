"""Many small evaluations: a batch against a loop, and going on when all is done."""

import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from typing import Any

import pandas as pd
from launch import launch
from scale import COMMAND, write
from scenes import Scene

PART = "batch"
PARAMETERS = ["-c", "10", "-g", "5", "-q"]
DRAWN = 100
"""Scenes that are drawn; the other pairs are copies, which no process knows of."""

LOOPED = 10
"""Runs of the loop that are timed before the batch, and as many after it."""

WORKERS = 2
LIMIT = 3600.0


@dataclass(frozen=True)
class Case:
    """So many pairs of files of a scene."""

    pairs: int
    scene: Scene

    def __str__(self) -> str:
        return f"{self.pairs} of {self.scene}"


CASES = (Case(2000, Scene(5, 56, 60.0)), Case(2000, Scene(10, 50, 100.0)))
SMALL = (Case(20, Scene(5, 56, 60.0)),)


def measure(case: Case) -> dict[str, Any]:
    """Seconds of one pair in the loop, of the batch, of its jobs alone, and of going on."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write(folder, case)
        patterns = [str(folder / "{run}" / f"{side}.csv") for side in ("truth", "estimate")]
        command = [COMMAND, "batch", "--truth", patterns[0], "--estimate", patterns[1]]
        command += ["-o", str(folder / "r"), "--workers", str(WORKERS), *PARAMETERS]
        output = folder / "out"
        before = _looped(folder, 0)
        batch = launch(command, output, LIMIT)
        after = _looped(folder, LOOPED)
        again = launch(command, output, LIMIT)
        if batch.status or again.status:
            raise RuntimeError(f"a batch ended with {batch.status}, then {again.status}")
        rows = pd.concat(map(pd.read_parquet, (folder / "r" / "jobs").glob("*.parquet")))
        return {
            "loop": mean((before, after)),
            "batch": batch.seconds,
            "jobs": float(rows["seconds"].sum()),
            "again": again.seconds,
            "peak": again.peak_bytes,
        }


def _write(folder: Path, case: Case) -> None:
    for run in range(case.pairs):
        here = folder / f"{run:05d}"
        if run >= DRAWN:
            shutil.copytree(folder / f"{run % DRAWN:05d}", here)
            continue
        here.mkdir()
        for side, states in zip(("truth", "estimate"), case.scene.arrays(run), strict=True):
            write(here / f"{side}.csv", states)


def _looped(folder: Path, first: int) -> float:
    """Seconds of one command."""
    begin = time.perf_counter()
    for run in range(first, first + LOOPED):
        files = [str(folder / f"{run:05d}" / f"{side}.csv") for side in ("truth", "estimate")]
        subprocess.run([COMMAND, *files, *PARAMETERS], stdout=subprocess.DEVNULL, check=True)
    return (time.perf_counter() - begin) / LOOPED
