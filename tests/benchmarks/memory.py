"""Peak memory of an evaluation, per gain and run, beyond that of its input. Linux only.

python memory.py TARGETS STEPS prints one measurement, from a process of its own.
"""

import contextlib
import gc
import json
import math
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scenes import FALSE_LENGTHS, Scene
from yardsticks import CUTOFF, ORDER, SWITCH_PENALTY

from tgospa_eval import Trajectories, evaluate

PART = "memory"
SPREAD = 63.0
"""Square root of the area for each target: neighbours within the cutoff are rare."""

SIZE = (10_000, 1_000)
SMALL = (500, 200)
TARGET = 60
"""Bytes per gain or run."""

LIMIT = 150.0
"""Seconds after which the process is killed."""


def measure(targets: int, steps: int) -> dict[str, Any]:
    """Measure in a fresh process."""
    try:
        done = subprocess.run(
            [sys.executable, __file__, str(targets), str(steps)],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
            timeout=LIMIT,
        )
    except subprocess.TimeoutExpired:
        return {"complete": False}
    return {"complete": True, **json.loads(done.stdout)}


def trajectories(scene: Scene, seed: int) -> tuple[Trajectories, Trajectories]:
    """Both sides, written step by step into their tables: nothing else of that size is held."""
    most = scene.targets * scene.steps
    truth = _Table(most)
    estimate = _Table(most + scene.targets // 5 * FALSE_LENGTHS[1])
    for step, (x, y) in enumerate(scene.frames(seed)):
        truth.append(step, x)
        estimate.append(step, y)
    return truth.finish(scene.targets, scene.steps), estimate.finish(scene.estimates, scene.steps)


class _Table:
    """Rows of one side; memory that is not written is not resident."""

    def __init__(self, most: int) -> None:
        self.rows = 0
        self.step = np.empty(most, np.int64)
        self.track = np.empty(most, np.int64)
        self.state = np.empty((most, 2))

    def append(self, step: int, states: np.ndarray) -> None:
        track = np.flatnonzero(~np.isnan(states[:, 0]))
        here = slice(self.rows, self.rows + len(track))
        self.step[here], self.track[here], self.state[here] = step, track, states[track]
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
    targets, steps = int(sys.argv[1]), int(sys.argv[2])
    warm = Scene(20, 20, 20.0).arrays(0)
    evaluate(*warm, CUTOFF, ORDER, SWITCH_PENALTY)
    scene = Scene(targets, steps, round(SPREAD * math.sqrt(targets)))
    truth, estimate = trajectories(scene, seed=0)
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
        "states": len(result.proof.states.pair),
        "seconds": seconds,
        "relative_gap": result.relative_gap,
    }
    print(json.dumps(values))


if __name__ == "__main__":
    main()
