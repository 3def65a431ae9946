"""Run a command from a process so small that the peak memory of the child is the command's own.

The peak that the system reports for a child is at least that of the process that started it.
"""

import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

UNIT = 1 if sys.platform == "darwin" else 1024
"""Bytes in a unit of ru_maxrss."""


class Run(NamedTuple):
    """Wall time, peak resident memory, exit status: None if it was killed at the limit."""

    seconds: float
    peak_bytes: int
    status: int | None


def launch(command: list[str], output: Path, limit: float) -> Run:
    """Run the command with its stdout in a file, `limit` seconds at most."""
    done = subprocess.run(
        [sys.executable, __file__, str(limit), str(output), *command],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return Run(*json.loads(done.stdout))


def main() -> None:
    """Run what the arguments say; print a `Run` as JSON."""
    limit, output, *command = sys.argv[1:]
    with Path(output).open("wb") as file:
        begin = time.perf_counter()
        try:
            status = subprocess.run(
                command, stdout=file, timeout=float(limit), check=False
            ).returncode
        except subprocess.TimeoutExpired:
            status = None
        seconds = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * UNIT
    print(json.dumps(Run(seconds, peak, status)))


if __name__ == "__main__":
    main()
