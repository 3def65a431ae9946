"""Time to make the HTML report, against the evaluation that it shows and an import of plotly."""

import importlib.util
import subprocess
import sys
import time
from typing import Any

from scenes import Scene
from yardsticks import CUTOFF, ORDER, SWITCH_PENALTY

from tgospa_eval import evaluate
from tgospa_eval.show.html import page

PART = "page"
CASES = (Scene(200, 1_000, 900.0),)
SMALL = (Scene(20, 100, 280.0),)
ROUNDS = 3
SHARE, IMPORTS, BYTES = 0.5, 5.0, 3e6
"""At most so much of the evaluation or so many imports, whichever is more; and so large."""


def measure(scene: Scene) -> dict[str, Any]:
    """Best of some interleaved runs, in seconds; no time for plotly where it is not installed."""
    truth, estimate = scene.arrays(0)
    seconds: dict[str, list[float]] = {"evaluation": [], "page": [], "plotly": []}
    size = 0
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        result = evaluate(truth, estimate, CUTOFF, ORDER, SWITCH_PENALTY)
        middle = time.perf_counter()
        size = len(page(result).encode())
        seconds["evaluation"].append(middle - begin)
        seconds["page"].append(time.perf_counter() - middle)
        if importlib.util.find_spec("plotly"):
            begin = time.perf_counter()
            subprocess.run([sys.executable, "-c", "import plotly.graph_objects"], check=True)
            seconds["plotly"].append(time.perf_counter() - begin)
    return {name: min(found) if found else None for name, found in seconds.items()} | {
        "bytes": size
    }
