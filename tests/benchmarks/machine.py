"""What was measured, and on what."""

import hashlib
import json
import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

import numpy as np
import scipy

import tgospa_eval

HERE = Path(__file__).parent
PACKAGE = Path(tgospa_eval.__file__).parent
SHOWING = ("__main__.py", "report.py", "tables.py")
"""Modules here that only show; a change in them leaves measurements valid."""

REFEREE = ("exact_lp.py", "claims.py", "far_scenes.py")
"""Modules of the tests that measure as well."""


def describe() -> dict[str, str]:
    """The machine and the versions."""
    return {
        "CPU": _processor(),
        "cores": str(os.cpu_count()),
        "system": platform.system(),
        "Python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "HiGHS": f"{version('highspy')} in tgospa-eval, SciPy has its own",
        "tgospa-eval": tgospa_eval.__version__,
    }


def fingerprint() -> str:
    """Changes with the machine, the versions, the package (compiled parts too) and what measures.

    Only measurements with the same fingerprint are comparable.
    """
    sha = hashlib.sha256(json.dumps(describe(), sort_keys=True).encode())
    sources = [path for path in PACKAGE.rglob("*") if path.is_file()]
    sources += [path for path in HERE.glob("*.py") if path.name not in SHOWING]
    sources += [HERE.parent / "support" / name for name in REFEREE]
    for path in sorted(sources):
        if "__pycache__" not in path.parts:
            sha.update(path.name.encode() + path.read_bytes())
    return sha.hexdigest()[:16]


def commit() -> str:
    """The commit of the checkout, with a plus if files differ from it; empty outside git."""
    git = subprocess.run(
        ["git", "describe", "--always", "--dirty=+", "--exclude=*"],
        cwd=HERE,
        capture_output=True,
        text=True,
        check=False,
    )
    return git.stdout.strip()


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
