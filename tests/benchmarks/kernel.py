"""Speed of the sweeps, as every result tells it."""

from scenes import Scene
from yardsticks import CUTOFF, ORDER, SWITCH_PENALTY

from tgospa_eval import evaluate

PART = "kernel"
CASES = (Scene(50, 100, 20.0), Scene(200, 200, 300.0), Scene(50, 100, 20.0, noise=2.0))
SMALL = CASES[:1]
ROUNDS = 5
TARGET = 7.0
"""Nanoseconds per state and half sweep."""


def measure(scene: Scene) -> dict[str, float]:
    """Nanoseconds per state and half sweep of the first draw, best of some runs."""
    truth, estimate = scene.arrays(0)
    found = [
        evaluate(truth, estimate, CUTOFF, ORDER, SWITCH_PENALTY).timings for _ in range(ROUNDS)
    ]
    return {"nanoseconds": min(timings["nanoseconds_per_state"] for timings in found)}
