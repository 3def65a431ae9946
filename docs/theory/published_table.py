"""Track three videos of MOT17 with SORT and evaluate the tracks, as arXiv 2511.20239 did.

``python docs/theory/published_table.py MOT17/train`` reads ``gt/gt.txt`` and ``det/det.txt`` in
``MOT17-02-FRCNN``, ``MOT17-04-FRCNN`` and ``MOT17-09-FRCNN`` there. It prints what was published
beside what comes out here.
"""

import argparse
import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tgospa_eval import InputError, Result, TgospaError, evaluate

Floats = NDArray[np.float64]

ORDER = math.log(2) / math.log(4 / 3)
"""p, with which a distance of 3/4 costs 1/2."""

SWITCH_PENALTY = 10 ** (1 / ORDER)
"""gamma, with which a switch costs 10."""

PUBLISHED = {
    "MOT17-02": (40.15, 315.9, 6521, 12060, 1076, 42.5),
    "MOT17-04": (50.39, 290.9, 26084, 21473, 1827, 69.5),
    "MOT17-09": (20.69, 25.4, 2840, 2485, 44, 19.0),
}
"""TGOSPA, cost of localisation; boxes assigned, missed and false; switches."""

HEADER = "                      TGOSPA  localis.  assigned    missed     false  switches"

MAX_AGE, MIN_HITS, MIN_IOU = 1, 3, 0.3
"""Frames that a track lives without a detection; detections in a row that it needs before it is
reported, but in the first frames; least overlap of a track and its detection."""

STEP, SEEN = np.eye(7) + np.eye(7, k=4), np.eye(4, 7)
STEP_NOISE = np.diag([1, 1, 1, 1, 1e-2, 1e-2, 1e-4])
DETECTION_NOISE = np.diag([1, 1, 10, 10])
BIRTH = np.diag([10, 10, 10, 10, 1e4, 1e4, 1e4])
"""Constant velocity and its covariances, with the values of the authors of SORT."""


@dataclass(kw_only=True)
class Track:
    """Kalman filter on (u, v, s, r, u', v', s'): centre, area, width over height; per frame."""

    id: int
    mean: Floats
    covariance: Floats
    streak: int = 0
    unseen: int = 0

    def predict(self) -> None:
        if self.mean[2] + self.mean[6] <= 0:
            self.mean[6] = 0  # the area stays positive
        self.mean = STEP @ self.mean
        self.covariance = STEP @ self.covariance @ STEP.T + STEP_NOISE
        self.streak = 0 if self.unseen else self.streak
        self.unseen += 1

    def update(self, seen: Floats) -> None:
        gain = np.linalg.solve(
            SEEN @ self.covariance @ SEEN.T + DETECTION_NOISE, SEEN @ self.covariance
        ).T
        self.mean = self.mean + gain @ (seen - SEEN @ self.mean)
        self.covariance = self.covariance - gain @ SEEN @ self.covariance
        self.streak, self.unseen = self.streak + 1, 0

    @property
    def box(self) -> Floats:
        """Left, top, width and height."""
        u, v, s, r = self.mean[:4]
        width, height = math.sqrt(s * r), math.sqrt(s / r)
        return np.array([u - width / 2, v - height / 2, width, height])


def overlaps(detections: Floats, boxes: Floats) -> Floats:
    """IoU (N, M): common area over that of the union."""
    a, b = detections[:, None], boxes[None]
    right_bottom = np.minimum(a[..., :2] + a[..., 2:], b[..., :2] + b[..., 2:])
    sides = np.clip(right_bottom - np.maximum(a[..., :2], b[..., :2]), 0, None)
    common = sides.prod(axis=-1)
    return common / (a[..., 2:].prod(axis=-1) + b[..., 2:].prod(axis=-1) - common)


def sort(detections: Floats) -> list[tuple[int, int, Floats]]:
    """Frame, id and box of what is reported for rows (frame, left, top, width, height).

    A. Bewley, Z. Ge, L. Ott, F. Ramos, B. Upcroft, "Simple online and realtime tracking", 2016.
    """
    tracks: list[Track] = []
    reported, born = [], 0
    for frame in range(1, int(detections[:, 0].max()) + 1):
        boxes = detections[detections[:, 0] == frame, 1:]
        width, height = boxes[:, 2], boxes[:, 3]
        seen = np.column_stack((boxes[:, :2] + boxes[:, 2:] / 2, width * height, width / height))
        for track in tracks:
            track.predict()
        tracks = [track for track in tracks if (track.mean[2:4] > 0).all()]
        iou = overlaps(boxes, np.array([track.box for track in tracks]).reshape(-1, 4))
        pairs = np.transpose(linear_sum_assignment(iou, maximize=True)).tolist()
        matched = {i: tracks[j] for i, j in pairs if iou[i, j] >= MIN_IOU}
        for i, state in enumerate(seen):
            if i in matched:
                matched[i].update(state)
            else:
                born += 1
                mean = np.concatenate((state, np.zeros(3)))
                tracks.append(Track(id=born, mean=mean, covariance=BIRTH))
        reported += [
            (frame, track.id, track.box)
            for track in tracks
            if track.unseen == 0 and (track.streak >= MIN_HITS or frame <= MIN_HITS)
        ]
        tracks = [track for track in tracks if track.unseen <= MAX_AGE]
    return reported


def write_tracks(detections: Path, path: Path) -> None:
    """From a file of detections to one of results, both as of MOTChallenge."""
    try:
        rows = np.loadtxt(detections, delimiter=",", ndmin=2)[:, [0, 2, 3, 4, 5]]
    except (ValueError, IndexError) as error:
        raise InputError(f"{detections}: no detections of MOTChallenge: {error}") from error
    with path.open("w", encoding="utf-8") as file:
        for frame, number, box in sort(rows):
            file.write(f"{frame},{number},{','.join(f'{x:.2f}' for x in box)},1,-1,-1,-1\n")


def line(name: str, source: str, values: tuple[float, ...]) -> str:
    tgospa, localisation, *counts, switches = values
    numbers = "".join(f"{count:10,.0f}" for count in counts)
    return f"{name:9} {source:9} {tgospa:8.2f}{localisation:10.1f}{numbers}{switches:10.1f}"


def values_of(result: Result) -> tuple[float, ...]:
    """In the order of `PUBLISHED`."""
    missed, false, switches = (result.counts[name] for name in ("missed", "false", "switch"))
    assigned = int(result.per_truth["steps"].sum()) - missed
    return result.tgospa, result.localisation, assigned, missed, false, switches


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, prog="published_table.py")
    parser.add_argument("folder", type=Path, help="the folder train of MOT17")
    parser.add_argument("--order", type=float, default=ORDER, metavar="P")
    parser.add_argument("--switch-penalty", type=float, default=SWITCH_PENALTY, metavar="GAMMA")
    parser.add_argument("--output", type=Path, help="folder for the tracks, as MOT17-02.txt")
    return parser.parse_args()


def run(given: argparse.Namespace, output: Path) -> None:
    files = {
        name: [given.folder / f"{name}-FRCNN" / part for part in ("gt/gt.txt", "det/det.txt")]
        for name in PUBLISHED
    }
    for path in [path for pair in files.values() for path in pair if not path.is_file()]:
        raise InputError(f"{path} is missing: needed is the folder train of MOT17, as published")
    print(f"d = 1 - IoU, c = 1, p = {given.order!r}, gamma = {given.switch_penalty!r}\n\n{HEADER}")
    output.mkdir(parents=True, exist_ok=True)
    for name, (truth, detections) in files.items():
        tracks = output / f"{name}.txt"
        write_tracks(detections, tracks)
        result = evaluate(truth, tracks, 1.0, given.order, given.switch_penalty, distance="iou")
        print(line(name, "published", PUBLISHED[name]))
        print(line("", "here", values_of(result)))
        print(f"{'':10}proven: {result.lower_bound!r} <= TGOSPA <= {result.upper_bound!r}")
        print(
            f"{'':10}total {result.total:.4f}, localisation {result.localisation:.4f}", flush=True
        )


def main() -> None:
    given = arguments()
    try:
        with tempfile.TemporaryDirectory() as folder:
            run(given, given.output or Path(folder))
    except TgospaError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_status)


if __name__ == "__main__":
    main()
