"""Makes the files beside it: python sample_data/visdrone/make.py [FOLDER]."""

import sys
from pathlib import Path

import numpy as np

from tgospa_eval.formats.text.table import CATEGORIES
from tgospa_eval.simulation import Scene, Tracker, simulate
from tgospa_eval.tracks.trajectories import Trajectories

SCENE = Scene(scenario="births", targets=9, steps=25, area=800, state="box")
TRACKER = Tracker(noise=3, detection=0.93, swaps=0.2, near=60, false_rate=0.1)
CLASSES = ("pedestrian", "car", "van", "bus", "others")
IGNORED = (620.0, 40.0, 120.0, 80.0)
"""A region in which nothing was labelled."""

SIZE = 800.0
"""Of the image; what is beyond is truncated."""


def main(folder: Path) -> None:
    """Truth and results of one sequence: objects of five classes, seen by a drone."""
    truth, estimate = simulate(SCENE, TRACKER, np.random.default_rng(4))
    rows = [(step + 1, 0, IGNORED, 0, 0, 0, 0) for step in range(SCENE.steps)]
    for step, track, box in boxes(truth):
        left, top, width, height = box
        cut = left < 0 or top < 0 or left + width > SIZE or top + height > SIZE
        others = [other for at, _, other in boxes(truth) if at == step and other[1] > top]
        hidden = max((overlap(box, other) for other in others), default=0.0)
        category = class_of(truth.ids[track])
        considered = int(CATEGORIES[category] != "others")
        grade = 0 if hidden == 0 else 1 if hidden <= 0.5 else 2
        rows.append((step + 1, int(truth.ids[track]), box, considered, category, int(cut), grade))
    write(folder / "gt.txt", sorted(rows, key=lambda row: (row[1], row[0])))
    rows = []
    for step, track, box in boxes(estimate):
        at_step = [(k, other) for at, k, other in boxes(truth) if at == step]
        near = min(at_step, key=lambda item: abs(np.subtract(item[1], box)).sum(), default=(0, box))
        category = class_of(truth.ids[near[0]])
        if CATEGORIES[category] == "others":  # which the tracker takes for cars
            category = CATEGORIES.index("car")
        rows.append((step + 1, int(estimate.ids[track]), box, 0.9, category, -1, -1))
    write(folder / "res.txt", rows)


def boxes(side: Trajectories) -> list[tuple[int, int, tuple[float, ...]]]:
    """Step, track and box of each row."""
    columns = side.step.tolist(), side.track.tolist(), map(tuple, side.state.tolist())
    return list(zip(*columns, strict=True))


def class_of(name: str) -> int:
    """Return the number of the class of an object."""
    return CATEGORIES.index(CLASSES[int(name) % len(CLASSES)])


def overlap(box: tuple[float, ...], other: tuple[float, ...]) -> float:
    """Share of a box that another one covers."""
    shared = 1.0
    for begin, size in ((0, 2), (1, 3)):
        low = max(box[begin], other[begin])
        high = min(box[begin] + box[size], other[begin] + other[size])
        shared *= max(0.0, high - low) / box[size]
    return shared


def write(path: Path, rows: list[tuple]) -> None:
    """One row for each object and frame."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = (
        ",".join(map(str, (frame, name, *(round(number) for number in box), *rest)))
        for frame, name, box, *rest in rows
    )
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
