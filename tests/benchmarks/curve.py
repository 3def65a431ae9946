"""Time of the normalised curve, against the single evaluation that it belongs to."""

import time
from typing import Any

from scenes import Scene
from yardsticks import CUTOFF, ORDER, SWITCH_PENALTY

from tgospa_eval import evaluate

PART = "curve"
CASES = (Scene(20, 200, 400.0), Scene(20, 200, 100.0), Scene(20, 200, 50.0), Scene(20, 200, 20.0))
SMALL = (Scene(20, 50, 100.0),)
ROUNDS = 3
MOST = 20.0
"""Single evaluations that the curve may cost."""


def measure(scene: Scene) -> dict[str, Any]:
    """Best of some interleaved runs, in seconds, and the points that are not exact."""
    truth, estimate = scene.arrays(0)
    seconds: dict[bool, list[float]] = {False: [], True: []}
    wide = 0
    for _ in range(ROUNDS):
        for curve, found in seconds.items():
            begin = time.perf_counter()
            result = evaluate(truth, estimate, CUTOFF, ORDER, SWITCH_PENALTY, curve=curve)
            found.append(time.perf_counter() - begin)
        wide = (
            0 if result.curve_bounds is None else int((~result.curve_bounds.met(result.gap)).sum())
        )
    single, both = min(seconds[False]), min(seconds[True])
    return {"evaluation": single, "curve": both - single, "wide": wide}
