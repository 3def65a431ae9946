"""Peak memory of all processes of an evaluation against its --memory. Linux only."""

import itertools
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import pyarrow.csv
import pyarrow.parquet as pq
import recordings
from partitioned import PARAMETERS, Recording
from scale import COMMAND

PART = "limits"
CASES = (Recording("ais", 1_000_000), Recording("city", 300_000))
SMALL = (Recording("ais", 20_000),)
LIMITS = ("100MB", "200MB", "400MB", "1GB", "4GB")
INPUTS = tuple(itertools.product(("csv", "parquet"), ("files", "folders"), ("", "-o")))
JOBS = 2
PAUSE = 0.02
"""Seconds from one look at the processes to the next."""


def measure(case: Recording) -> dict[str, Any]:
    """Peaks in bytes, or what a limit is refused with, by format, layout, output and limit."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kind = recordings.RECORDINGS[case.kind]
        recordings.write_recording(folder / "parquet", kind, case.rows)
        for side in ("truth", "estimate"):
            (folder / "csv" / side).mkdir(parents=True)
            for path in (folder / "parquet" / side).iterdir():
                part = folder / "csv" / side / f"{path.stem}.csv"
                pyarrow.csv.write_csv(pq.read_table(path), part)
            whole = pq.read_table(folder / "parquet" / side)
            pq.write_table(whole, folder / f"{side}.parquet")
            pyarrow.csv.write_csv(whole, folder / f"{side}.csv")
        found = {}
        for (format, layout, output), limit in itertools.product(INPUTS, LIMITS):
            sides = [
                folder / f"{side}.{format}" if layout == "files" else folder / format / side
                for side in ("truth", "estimate")
            ]
            command = [COMMAND, "evaluate", *map(str, sides), *PARAMETERS[case.kind], "-q"]
            command += ["--memory", limit, "--jobs", str(JOBS)]
            command += ["-o", str(folder / "out"), "--force"] if output else []
            found[" ".join((format, layout, output, limit))] = peak_of(command)
        return found


def peak_of(command: list[str]) -> int | str:
    """Peak of the memory of a command and all that it starts, or its message if it is refused."""
    peak = 0
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        while process.poll() is None:
            peak = max(peak, taken(process.pid))
            time.sleep(PAUSE)
        said = process.stderr.read() if process.stderr else ""
    if process.returncode not in (0, 2):
        raise RuntimeError(f"{command}: {said}")
    return peak if process.returncode == 0 else said.strip()


def taken(pid: int) -> int:
    """Bytes of a process and its descendants; what they share counts once."""
    shared, private, left = [0], 0, [pid]
    while left:
        process = Path("/proc") / str(left.pop())
        try:
            for task in (process / "task").iterdir():
                left += map(int, (task / "children").read_text().split())
            lines = (process / "smaps_rollup").read_text().splitlines()[1:]
        except OSError:
            continue  # it has ended
        kilobytes = {name: int(size.split()[0]) for name, size in (x.split(":") for x in lines)}
        own = kilobytes["Private_Clean"] + kilobytes["Private_Dirty"]
        private += 1024 * own
        shared.append(1024 * (kilobytes["Rss"] - own))
    return private + max(shared)
