"""Makes the files beside it: python sample_data/batch/make.py [FOLDER]."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from tgospa_eval.formats.write import WRITERS
from tgospa_eval.simulation import Scene, Tracker, simulate

SEQUENCES = {
    "SIM-01": Scene(scenario="dense", targets=8, steps=50, area=600, state="box"),
    "SIM-02": Scene(scenario="births", targets=16, steps=40, area=600, state="box"),
    "SIM-03": Scene(scenario="crossing", targets=6, steps=50, area=600, state="box"),
}

WALKERS = Tracker(noise=2.5, near=40, merges=0.3, swaps=0.3, detection=0.93, fragmentation=0.01)
"""Who are near each other hide one another: one box for both, or swapped ones."""

TRACKERS = {
    "careful": replace(WALKERS, confirmation=3, false_rate=0.03),
    "eager": replace(WALKERS, noise=2.6, false_rate=0.15, false_length=(1, 4)),
}
"""The one reports a track from its third box on, the other at once, and more that is not there."""

RUNS = range(1, 9)
VEHICLES = Scene(scenario="manoeuvring", targets=4, steps=25, area=200)
SETTINGS = {
    "confirm-1": Tracker(noise=1, near=10, confirmation=1, false_rate=0.3, false_length=(1, 5)),
    "confirm-4": Tracker(noise=1, near=10, confirmation=4, false_rate=0.04),
}


def main(folder: Path) -> None:
    """Benchmark and Monte Carlo study, below a folder."""
    for seed, (sequence, scene) in enumerate(SEQUENCES.items(), start=1):
        for name, tracker in TRACKERS.items():
            sides = simulate(scene, tracker, np.random.default_rng(seed))
            files = f"gt/{sequence}/gt/gt.txt", f"trackers/{name}/data/{sequence}.txt"
            write(folder / "mot", "motchallenge", sides, files)
    for run in RUNS:
        for name, tracker in SETTINGS.items():
            sides = simulate(VEHICLES, tracker, np.random.default_rng(run))
            write(folder / "montecarlo", "csv", sides, (f"{run}/truth.csv", f"{run}/{name}.csv"))


def write(folder: Path, form: str, sides: tuple, files: tuple[str, str]) -> None:
    """Truth and estimate; the truth of a seed is the same for all trackers."""
    for side, role, file in zip(sides, ("truth", "estimate"), files, strict=True):
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(WRITERS[form](side, role), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
