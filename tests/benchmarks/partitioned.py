"""Recordings in parts: against the same in memory, and how time and memory grow with the rows."""

import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import recordings
from launch import Run, launch
from scale import COMMAND

PART = "partitioned"
LIMIT = 7200.0
JOBS = 2
PARAMETERS = {"ais": ["-c", "100", "-g", "50"], "city": ["-c", "10", "-g", "5"]}
MEMORY = "4GB"
IN_MEMORY = 1_000_000
"""Rows a side up to which the evaluation in memory is timed as well."""

RUNS = 3
"""Runs of either, in turn, of which the least counts."""


@dataclass(frozen=True)
class Recording:
    """What `recordings.py` makes, of so many rows of the truth."""

    kind: str
    rows: int

    def __str__(self) -> str:
        return f"{self.kind} {self.rows:,}"


CASES = (
    *(Recording("ais", rows) for rows in (1_000_000, 3_000_000, 10_000_000)),
    *(Recording("city", rows) for rows in (1_000_000, 3_000_000)),
)
SMALL = (Recording("ais", 20_000), Recording("city", 20_000))


def measure(case: Recording) -> dict[str, Any]:
    """Seconds and the largest process of both ways; in memory with one thread and with two."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make = [sys.executable, recordings.__file__, str(folder / "data"), case.kind]
        made = _done(launch([*make, str(case.rows)], folder / "out", LIMIT))
        sides = [str(folder / "data" / side) for side in ("truth", "estimate")]
        files = [f"{side}.parquet" for side in sides]
        found: dict[str, Any] = {"simulate": made.seconds}
        tries = RUNS if case.rows <= IN_MEMORY else 1
        if case.rows <= IN_MEMORY:
            for side, file in zip(sides, files, strict=True):
                pq.write_table(pq.read_table(side), file)
        for _ in range(tries):
            runs = {"parts": (sides, JOBS), "parts_alone": (sides, 1)}
            if case.rows <= IN_MEMORY:
                runs |= {"whole": (files, JOBS), "whole_alone": (files, 1)}
            for key, (paths, jobs) in runs.items():
                command = [COMMAND, "evaluate", *paths, *PARAMETERS[case.kind]]
                command += ["--memory", MEMORY, "--jobs", str(jobs), "-q"]
                run = _done(launch(command, folder / "out", LIMIT))
                found[key] = min(run.seconds, found.get(key, math.inf))
                found[f"{key}_peak"] = run.peak_bytes
        return found


def _done(run: Run) -> Run:
    if run.status:
        raise RuntimeError(f"a command ended with {run.status}")
    return run
