"""The real command on large CSV files: wall time, peak memory, stages."""

import json
import sysconfig
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from launch import launch
from scenes import Floats, Scene
from yardsticks import CUTOFF, SWITCH_PENALTY

PART = "scale"
CASES = (
    Scene(1_000, 1_000, 2000.0),
    Scene(10_000, 100, 6300.0),
    Scene(20, 20_000, 60.0),
)
SMALL = (Scene(100, 100, 630.0), Scene(20, 1_000, 60.0))

LIMIT = 120.0
"""Seconds after which the command is killed."""

COMMAND = str(Path(sysconfig.get_path("scripts")) / "tgospa-eval")


def measure(scene: Scene) -> dict[str, float | bool]:
    """Write the scene as CSV, run the command on it, read its JSON."""
    with tempfile.TemporaryDirectory() as folder:
        sides = [Path(folder) / name for name in ("truth.csv", "estimate.csv")]
        rows = [write(path, states) for path, states in zip(sides, scene.arrays(0), strict=True)]
        output = Path(folder) / "result.json"
        options = ["-c", f"{CUTOFF:g}", "-g", f"{SWITCH_PENALTY:g}", "--format", "json", "-q"]
        run = launch([COMMAND, *map(str, sides), *options], output, LIMIT)
        values: dict[str, float | bool] = {
            "rows": sum(rows),
            "bytes": sum(path.stat().st_size for path in sides),
            "seconds": run.seconds,
            "peak_bytes": run.peak_bytes,
            "complete": run.status is not None,
        }
        if run.status is None:
            return values
        if run.status != 0:
            raise RuntimeError(f"tgospa-eval left with status {run.status} on {scene}")
        result = json.loads(output.read_text(encoding="utf-8"))
    timings = result["timings"]
    return values | {
        "read": timings["read"],
        "solve": sum(timings["solve"].values()),
        "certify": timings["certify"],
        "relative_gap": result["relative_gap"],
        "pair_steps": result["sizes"]["pair_steps"],
    }


def write(path: Path, states: Floats) -> int:
    """Long form, in time order, as a recorder would; the number of rows."""
    step, track = np.nonzero(~np.isnan(states[:, :, 0]))
    x, y = states[step, track].round(3).T
    pd.DataFrame({"id": track, "t": step, "x": x, "y": y}).to_csv(path, index=False)
    return len(step)
