"""Time of the command in a new process, against importing what it needs and nothing else."""

import compileall
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

from machine import HERE
from scale import COMMAND, write
from scenes import Scene

PART = "startup"
RUNS = 15
QUICKSTART = HERE.parents[1] / "sample_data" / "quickstart"
ARGUMENTS = [str(QUICKSTART / name) for name in ("truth.csv", "estimate.csv")] + [
    *("-c", "10", "-g", "5", "--quiet")
]

GATED = Scene(20, 50, 60.0)
"""20 targets, 24 estimates, 50 steps."""

PROBE = """
import importlib.metadata, sys
sys.argv[0] = "tgospa-eval"
from tgospa_eval.cli import main
try:
    main()
except SystemExit:
    pass
known = set(importlib.metadata.packages_distributions()) - {"tgospa_eval"}
print(*sorted(name for name in known & set(sys.modules) if not name.startswith("_")))
"""


def measure() -> dict[str, Any]:
    """Medians over interleaved runs, in seconds."""
    with tempfile.TemporaryDirectory() as folder:
        return _measure(gate(Path(folder)))


def gate(folder: Path) -> list[str]:
    """Arguments of a gate on a scene that is written to the folder, with its baseline."""
    sides = [folder / name for name in ("truth.csv", "estimate.csv")]
    for path, states in zip(sides, GATED.arrays(0), strict=True):
        write(path, states)
    arguments = ["gate", *map(str, sides), "--baseline", str(folder / "baseline.json"), "-q"]
    made = [COMMAND, *arguments, "-c", "10", "-g", "5", "--update-baseline"]
    subprocess.run(made, stdout=subprocess.DEVNULL, check=True)
    return arguments


def _measure(gating: list[str]) -> dict[str, Any]:
    # As pip does; an editable install is else compiled at the first run, or at each one where
    # PYTHONDONTWRITEBYTECODE is set.
    compileall.compile_dir(HERE.parents[1] / "tgospa_eval", quiet=1)
    needs, gate_needs = libraries(ARGUMENTS), libraries(gating)
    reporting = [*gating, "--junit", str(Path(gating[1]).with_name("junit.xml")), "--github"]
    commands = {
        "evaluate": [COMMAND, *ARGUMENTS],
        "imports": [sys.executable, "-c", f"import {', '.join(needs)}"],
        "gate": [COMMAND, *gating],
        "gate_reports": [COMMAND, *reporting],
        "gate_imports": [sys.executable, "-c", f"import {', '.join(gate_needs)}"],
        "help": [COMMAND, "--help"],
        "python": [sys.executable, "-c", "pass"],
    }
    seconds: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(RUNS):
        for name, command in commands.items():
            begin = time.perf_counter()
            subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
            seconds[name].append(time.perf_counter() - begin)
    medians = {name: median(values) for name, values in seconds.items()}
    rows = _rows(Path(ARGUMENTS[0]))
    return {"needs": needs, "gate_needs": gate_needs, "rows": rows, **medians}


def libraries(arguments: list[str]) -> list[str]:
    """Libraries that are loaded at the end of the command."""
    done = subprocess.run(
        [sys.executable, "-c", PROBE, *arguments], capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()[-1].split()


def _rows(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines()) - 1
