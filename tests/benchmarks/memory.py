"""Peak memory of an evaluation, per gain and run, beyond that of its input. Linux only.

python memory.py AREAS TARGETS STEPS SIDE prints one measurement, from a process of its own.
"""

import contextlib
import gc
import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scenes import FALSE_LENGTHS, Scene
from yardsticks import CUTOFF, ORDER, SWITCH_PENALTY

from tgospa_eval import Trajectories, evaluate

PART = "memory"


@dataclass(frozen=True)
class Case:
    """`areas` far apart, each a square of `side` with so many `targets` for `steps`."""

    areas: int
    targets: int
    steps: int
    side: float

    def __str__(self) -> str:
        many = f"{self.areas} areas of " if self.areas > 1 else ""
        return f"{many}{self.targets:,} x {self.steps:,}, {self.side:g}"

    @property
    def arguments(self) -> list[str]:
        """As for the command line."""
        return [str(self.areas), str(self.targets), str(self.steps), f"{self.side:g}"]


CASES = (Case(81, 100, 1_000, 300.0), Case(1, 10_000, 1_000, 6_300.0))
"""Many components; and nearly all tracks in one, for they meet in turn."""

SMALL = (Case(4, 20, 100, 60.0),)
APART = 1e5
"""From one area to the next."""

TARGET = 60
"""Bytes per gain or run."""

LIMIT = 150.0
"""Seconds after which the process is killed."""


def measure(case: Case) -> dict[str, Any]:
    """Measure in a fresh process."""
    try:
        done = subprocess.run(
            [sys.executable, __file__, *case.arguments],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
            timeout=LIMIT,
        )
    except subprocess.TimeoutExpired:
        return {"complete": False}
    return {"complete": True, **json.loads(done.stdout)}


def trajectories(case: Case, seed: int) -> tuple[Trajectories, Trajectories]:
    """Both sides, written step by step into their tables: nothing else of that size is held."""
    scene = Scene(case.targets, case.steps, case.side)
    most = case.areas * case.targets * case.steps
    truth = _Table(most)
    estimate = _Table(most + case.areas * (case.targets // 5 * FALSE_LENGTHS[1]))
    frames = [scene.frames(seed + area) for area in range(case.areas)]
    for step, areas in enumerate(zip(*frames, strict=True)):
        for area, (x, y) in enumerate(areas):
            truth.append(step, x, area)
            estimate.append(step, y, area)
    return (
        truth.finish(case.areas * scene.targets, case.steps),
        estimate.finish(case.areas * scene.estimates, case.steps),
    )


class _Table:
    """Rows of one side; memory that is not written is not resident."""

    def __init__(self, most: int) -> None:
        self.rows = 0
        self.step = np.empty(most, np.int64)
        self.track = np.empty(most, np.int64)
        self.state = np.empty((most, 2))

    def append(self, step: int, states: np.ndarray, area: int) -> None:
        track = np.flatnonzero(~np.isnan(states[:, 0]))
        here = slice(self.rows, self.rows + len(track))
        self.step[here], self.track[here] = step, area * len(states) + track
        self.state[here] = states[track] + [area * APART, 0.0]
        self.rows += len(track)

    def finish(self, tracks: int, steps: int) -> Trajectories:
        return Trajectories(
            step=self.step[: self.rows],
            track=self.track[: self.rows],
            state=self.state[: self.rows],
            ids=np.array([str(k) for k in range(tracks)], dtype=object),
            times=np.arange(steps),
            columns=("x", "y"),
        )


def resident(name: str) -> int:
    """VmRSS or VmHWM of this process in bytes."""
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith(name):
            return 1024 * int(line.split()[1])
    raise RuntimeError(f"no {name} in /proc/self/status")


def main() -> None:
    """Measure the size of the arguments; print JSON."""
    areas, targets, steps, side = sys.argv[1:]
    case = Case(int(areas), int(targets), int(steps), float(side))
    warm = Scene(20, 20, 20.0).arrays(0)
    evaluate(*warm, CUTOFF, ORDER, SWITCH_PENALTY)
    truth, estimate = trajectories(case, seed=0)
    gc.collect()
    with contextlib.suppress(PermissionError):  # then the peak of generating counts as well
        Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    before = resident("VmRSS")
    begin = time.perf_counter()
    result = evaluate(truth, estimate, CUTOFF, ORDER, SWITCH_PENALTY)
    seconds = time.perf_counter() - begin
    values = {
        "peak_bytes": resident("VmHWM"),
        "input_bytes": before,
        "states": len(result.proof.states.begin),
        "components": result.sizes["components"],
        "seconds": seconds,
        "relative_gap": result.relative_gap,
    }
    print(json.dumps(values))


if __name__ == "__main__":
    main()
