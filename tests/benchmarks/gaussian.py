"""Near pairs of normal laws against those of their means, through the same search."""

import time

import numpy as np

from tgospa_eval import Trajectories
from tgospa_eval.distances import DISTANCES, near_pairs

PART = "gaussian"
CASES = {
    "50 x 50 x 400, all near": (50, 400, 10.0),
    "1000 x 1000 x 1000, few near": (1000, 1000, 1000.0),
}
"""Objects of a side, steps, side of the square; about a million near pairs."""

SMALL = tuple(CASES)[:1]

CUTOFF = 20.0
ROUNDS = 7
TARGET = 3.0
"""Times what the Euclidean distances take."""


def measure(case: str) -> dict[str, float]:
    """Seconds of the processor for the pairs by either distance, best of rounds in turn."""
    objects, steps, area = CASES[case]
    rng = np.random.default_rng(1)
    sides = []
    for _ in range(2):
        factors = rng.normal(0, 0.1, (steps, objects, 2, 2))
        sides.append(
            Trajectories.from_array(
                rng.uniform(0, area, (steps, objects, 2)),
                covariance=factors @ factors.transpose(0, 1, 3, 2),
            )
        )
    seconds = {"euclidean": float("inf"), "gaussian-wasserstein": float("inf")}
    pairs = 0
    for _ in range(ROUNDS):
        for name in seconds:
            begin = time.process_time()
            pairs = len(near_pairs(*sides, CUTOFF, DISTANCES[name]).distance)
            seconds[name] = min(seconds[name], time.process_time() - begin)
    return {**seconds, "pairs": pairs}
