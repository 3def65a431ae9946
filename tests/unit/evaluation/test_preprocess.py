"""What benchmarks leave out: as TrackEval does it, by hand, and in marks."""

import io
import json
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Invoke, Write
from trackeval.metrics import CLEAR, HOTA, Identity

from tgospa_eval import evaluate
from tgospa_eval.evaluation.other_metrics import METRIC_FIELDS

QUIET = {"PRINT_CONFIG": False}
BOXES = ("--distance", "iou", "-c", "0.5", "-g", "0.5")
WITH = ("--with", "hota,clear,identity")
STEPS = 30


def kitti_row(step: int, name: int, kind: str, hidden: str, box: np.ndarray) -> str:
    edges = " ".join(f"{value:.2f}" for value in (*box[:2], *(box[:2] + box[2:])))
    return f"{step} {name} {kind} {hidden} -10 {edges} 1 1 1 0 0 0 0\n"


def kitti_scene(seed: int) -> tuple[str, str]:
    """Labels and results of a street: all that the rules look at, some of it at their limits.

    Cars, vans, people who sit, hidden and cut objects, small reports, and reports in regions.
    """
    rng = np.random.default_rng(seed)
    kinds = ("Car", "Car", "Van", "Pedestrian", "Person", "Pedestrian", "Cyclist", "Truck")
    places = rng.uniform(0, 600, (12, 2))
    sizes = rng.uniform((15, 20), (70, 60), (12, 2))
    speed = rng.normal(0, 4, (12, 2))
    regions = rng.uniform((0, 0, 60, 40), (500, 500, 150, 90), (3, 4)).round()
    truth, results = "", ""
    for step in range(STEPS):
        for region in regions[: 1 + step % 3]:
            truth += kitti_row(step, -1, "DontCare", "-1 -1", region)
        for left in (700, 750):  # one report is half in each of these
            truth += kitti_row(step, -1, "DontCare", "-1 -1", np.array([left, 0, 50, 60]))
        halves = np.array([728, 5, 44, 40])
        results += kitti_row(step, 300, ("Car", "Pedestrian")[step % 2], "-1 -1", halves)
        places = places + speed
        for k, (place, size) in enumerate(zip(places, sizes, strict=True)):
            kind = kinds[k % len(kinds)]
            if rng.random() < 0.9:
                hidden = f"{rng.choice([0, 0, 0, 1, 2])} {rng.choice([0, 0, 1, 2, 3])}"
                truth += kitti_row(step, k, kind, hidden, np.append(place, size))
            if rng.random() < 0.8:
                box = np.append(place, size) + rng.normal(0, 0.12 * size.min(), 4)
                box[2:] = box[2:].clip(min=9)
                if rng.random() < 0.2:
                    box[3] = 25  # as high as KITTI's least
                said = {"Van": "Car", "Person": "Pedestrian"}.get(kind, kind)
                results += kitti_row(step, 40 * (step // 11) + k, said, "-1 -1", box)
        for k, region in enumerate(regions):  # a half, a bit more, and all of it inside
            box = np.array([region[0] - 20 + 10 * k, region[1], 40, rng.integers(22, 30)])
            results += kitti_row(step, 200 + k, ("Car", "Pedestrian")[step % 2], "-1 -1", box)
    return truth, results


def metrics_of(sequence: Any) -> dict[str, dict[str, Any]]:
    with redirect_stdout(io.StringIO()):
        metrics = {"hota": HOTA(), "clear": CLEAR(QUIET), "identity": Identity(QUIET)}
        return {name: metric.eval_sequence(sequence) for name, metric in metrics.items()}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["car", "pedestrian"])
def test_kitti_is_that_of_trackeval_in_every_digit(
    write: Write, invoke: Invoke, tmp_path: Path, seed: int, kind: str
) -> None:
    truth, results = kitti_scene(seed)
    for folder in ("gt/label_02", "out/t/data"):
        (tmp_path / folder).mkdir(parents=True)
    paths = write("gt/label_02/s.txt", truth), write("out/t/data/s.txt", results)
    write("gt/evaluate_tracking.seqmap.training", f"s empty 000000 {STEPS:06d}\n")
    with redirect_stdout(io.StringIO()):
        from trackeval.datasets import Kitti2DBox

        data = Kitti2DBox({"GT_FOLDER": str(tmp_path / "gt"), **QUIET,
                           "TRACKERS_FOLDER": str(tmp_path / "out")})  # fmt: skip
        sequence = data.get_preprocessed_seq_data(data.get_raw_seq_data("t", "s"), kind)
    expected = metrics_of(sequence)
    answer = invoke(*paths, *BOXES, *WITH, "--preprocess", "kitti", "--class", kind,
                    "--format", "json", "-q")  # fmt: skip
    assert answer.status == 0, answer.err
    found = json.loads(answer.out)
    for metric, name in (("hota", "HOTA"), ("clear", "MOTA"), ("identity", "IDF1")):
        assert found["with"][metric][name] == np.mean(expected[metric][name])
    for metric, names in METRIC_FIELDS.items():
        for name in names:  # what is the mean of overlaps rounds its edges otherwise
            value = np.mean(expected[metric][name])
            assert found["with"][metric][name] == pytest.approx(value, rel=1e-12), name
    assert found["input"]["truth"]["left_out"]["preprocess"] > 0
    assert found["input"]["estimate"]["left_out"]["preprocess"] > 0
    assert found["parameters"]["preprocess"] == "kitti"
    again = invoke(*paths, *BOXES, *WITH, "--preprocess", "kitti:delete", "--class", kind,
                   "--format", "json", "-q")  # fmt: skip
    assert json.loads(again.out)["parameters"] == found["parameters"]


KITTI = [
    ("Car", "0 0", (0, 0, 60, 40), (0, 0, 60, 40)),  # found
    ("Van", "0 0", (200, 0, 60, 40), (200, 0, 60, 40)),  # on a van
    ("Car", "0 3", (400, 0, 60, 40), (400, 0, 60, 40)),  # on a car that is not to be seen
    ("Car", "1 0", (600, 0, 60, 40), None),  # a car at the edge, not found
    ("Car", "0 0", (800, 0, 60, 40), (800, 99, 60, 20)),  # not found, and a small report
    ("DontCare", "-1 -1", (0, 200, 100, 100), (10, 210, 60, 40)),  # in a region
    ("Cyclist", "0 0", (300, 200, 60, 40), (300, 200, 60, 40)),  # another class: false
]


def test_kitti_in_marks(write: Write, invoke: Invoke, tmp_path: Path) -> None:
    truth, results = "", ""
    for k, (kind, hidden, box, found) in enumerate(KITTI):
        name = -1 if kind == "DontCare" else k
        truth += kitti_row(0, name, kind, hidden, np.array(box, float))
        if found is not None:
            results += kitti_row(0, k, "Car", "-1 -1", np.array(found, float))
    paths = write("gt.txt", truth), write("res.txt", results)
    asked = (*paths, *BOXES, "--class", "car", "--format", "json", "-q", "--preprocess")
    delete, ignore = (json.loads(invoke(*asked, rule).out) for rule in ("kitti", "kitti:ignore"))
    for document in (delete, ignore):
        assert document["counts"] == {"missed": 1, "false": 1, "switch": 0}
    assert "ignored" not in delete
    assert ignore["ignored"] == {"truth_states": 3, "absorbed": 2, "excused": 2}
    assert ignore["metric"].startswith("masked-")
    assert ignore["parameters"]["preprocess"] == "kitti:ignore"
    assert ignore["judged"]["truth_states"] == delete["judged"]["truth_states"] == 2
    folder = str(tmp_path / "r")
    assert invoke(*asked, "kitti:ignore", "-o", folder, "--proof", "--pictures", "none").status == 0
    verdict = invoke("verify", folder, *paths)
    assert (verdict.status, "--preprocess 'kitti:ignore'" in verdict.out) == (0, True)


MOT = "1,1,0,0,20,40,1,1,1\n1,2,100,0,20,40,0,12,1\n1,3,200,0,20,40,0,1,1\n1,4,300,0,20,40,0,3,1\n"
MOT_RESULTS = "".join(f"1,{k},{100 * (k - 1)},0,20,40,1,-1,-1,-1\n" for k in (1, 2, 3, 4))
"""On a pedestrian, a reflection, a pedestrian with the flag 0, and a car."""


def test_motchallenge_in_marks(write: Write, invoke: Invoke) -> None:
    """As of MOT17: what is on a reflection costs nothing; what is on a car is false."""
    asked = (write("gt.txt", MOT), write("res.txt", MOT_RESULTS), *BOXES, "--format", "json")
    for rule, ignored in (
        ("motchallenge:delete", None),
        ("motchallenge:ignore", {"truth_states": 1, "absorbed": 1, "excused": 0}),
    ):
        answer = invoke(*asked, "--preprocess", rule)
        document = json.loads(answer.out)
        assert document["counts"] == {"missed": 0, "false": 2, "switch": 0}
        assert document.get("ignored") == ignored
        assert "estimate-format" not in answer.err.split("res.txt")[0]


def test_motchallenge_without_objects(write: Write, invoke: Invoke) -> None:
    """An empty truth has no distractors, and no column that lacks."""
    named = ("--truth-format", "motchallenge", "--format", "json")
    asked = (write("gt.txt", ""), write("res.txt", MOT_RESULTS), *BOXES, *named)
    for rule in ("motchallenge:delete", "motchallenge:ignore"):
        answer = invoke(*asked, "--preprocess", rule)
        assert answer.status == 0, answer.err
        assert json.loads(answer.out)["counts"] == {"missed": 0, "false": 4, "switch": 0}


VISDRONE = """\
1,0,0,0,100,100,0,0,0,0
1,1,10,10,40,40,1,4,0,0
1,2,80,200,40,40,1,4,0,0
1,3,300,300,40,40,0,11,0,0
1,4,95,0,10,10,1,4,0,0
1,5,94,40,10,10,1,4,0,0
"""
VISDRONE_RESULTS = """\
1,7,20,20,40,40,0.9,4,-1,-1
1,8,80,200,40,40,0.9,4,-1,-1
1,9,310,300,40,40,0.9,4,-1,-1
1,10,400,400,40,40,0.9,4,-1,-1
"""
"""7 is in the ignored region, 9 on others; of the truths 1, 4 and 5 are half inside, or more."""


@pytest.mark.parametrize("how", ["delete", "ignore"])
def test_regions_of_visdrone(write: Write, invoke: Invoke, how: str) -> None:
    paths = write("gt.txt", VISDRONE), write("res.txt", VISDRONE_RESULTS)
    asked = (*paths, *BOXES, "--format", "json")
    document = json.loads(invoke(*asked, "--preprocess", f"visdrone:{how}").out)
    assert document["counts"] == {"missed": 0, "false": 1, "switch": 0}
    if how == "delete":
        assert document["input"]["truth"]["left_out"]["preprocess"] == 3
        assert document["input"]["estimate"]["left_out"]["preprocess"] == 2
        split = json.loads(invoke(*asked, "--preprocess", "visdrone", "--by", "class").out)
        assert split["total"] == document["total"]
        (warning,) = json.loads(invoke(*asked, "--with", "clear").out)["warnings"]
        assert warning["code"] == "benchmark-rules"
        assert warning["remedy"].startswith("--preprocess visdrone ")
    else:
        assert document["ignored"] == {"truth_states": 3, "absorbed": 0, "excused": 2}


def by_counting_pixels(rows: np.ndarray, truth: np.ndarray) -> int:
    """Rows whose pixels are to less than a half in ignored regions and others: an image for each.

    A box l, w has the pixels l + 1 to l + w, and a region those from l on, rounded and from 1 on.
    """
    left = 0
    for frame in np.unique(rows[:, 0]):
        image = np.zeros((500, 500), bool)
        here = (truth[:, 0] == frame) & np.isin(truth[:, 7], (0, 11))
        for x, y, width, height in np.maximum(np.floor(truth[here, 2:6] + 0.5), 1).astype(int):
            image[y : y + height + 1, x : x + width + 1] = True
        there = (rows[:, 0] == frame) & ~np.isin(rows[:, 7], (0, 11))
        for x, y, width, height in np.maximum(np.floor(rows[there, 2:6] + 0.5), 1).astype(int):
            left += image[y + 1 : y + height + 1, x + 1 : x + width + 1].mean() < 0.5
    return left


def test_visdrone_counts_pixels(write: Write) -> None:
    rng = np.random.default_rng(3)
    texts, tables = [], []
    for side in (0, 1):
        classes = rng.choice([0, 11, 4, 4, 4], 400) if side == 0 else np.full(400, 4)
        boxes = np.column_stack((rng.uniform(-5, 360, (400, 2)), rng.uniform(4, 90, (400, 2))))
        boxes = boxes.round(side)
        considered = ~np.isin(classes, (0, 11))
        of_row = (np.arange(400) // 40, np.arange(400), boxes, considered, classes)
        table = np.column_stack((*of_row, np.zeros((400, 2))))
        tables.append(table)
        texts.append("".join(",".join(f"{v:g}" for v in row) + "\n" for row in table))
    result = evaluate(write("gt.txt", texts[0]), write("res.txt", texts[1]), distance="iou",
                      preprocess="visdrone", truth_format="visdrone",
                      estimate_format="visdrone")  # fmt: skip
    assert result.objects == tuple(by_counting_pixels(table, tables[0]) for table in tables)


def test_regions_of_uadetrac_are_given(write: Write, invoke: Invoke) -> None:
    regions = write("r.csv", "left,top,width,height\n0,0,100,100\n300,300,40,40\n")
    head = "id,t,left,top,width,height\n"
    truth = write("t.csv", f"{head}1,1,10,10,40,40\n2,1,80,200,40,40\n4,1,95,0,10,10\n")
    estimate = write("e.csv", f"{head}7,1,20,20,40,40\n8,1,80,200,40,40\n9,1,400,400,9,9\n")
    asked = (truth, estimate, *BOXES, "--format", "json", "--ignore-regions", regions)
    for rule in ("uadetrac:delete", "uadetrac:ignore"):
        document = json.loads(invoke(*asked, "--preprocess", rule).out)
        assert document["counts"] == {"missed": 0, "false": 1, "switch": 0}
    answer = invoke(*asked[:-2], "--preprocess", "uadetrac")
    assert answer.status == 2
    assert "--preprocess uadetrac: needs the regions of the sequence" in answer.err
    result = evaluate(truth, estimate, distance="iou", preprocess="uadetrac",
                      ignore_regions=regions)  # fmt: skip
    assert result.counts["false"] == 1


@pytest.mark.parametrize(
    ("rule", "words", "message"),
    [
        ("kitti", (), "is for one class; use --class car or --class pedestrian"),
        ("kitti", ("--class", "Van"), 'is for one class, not for "Van"'),
        ("kitti", ("--class", "Car,Van"), 'is for one class, not for "Car,Van"'),
        ("kitti:ignore", ("--class", "car", "--by", "class"), "leave out --by class"),
        ("visdrone", (), "read as kitti; only files of visdrone say what is not evaluated"),
        ("motchallenge:ignore", (), "read as kitti; only files of motchallenge say"),
        ("kitti:ignore", ("--class", "car", "--existence", "use"),
         "--existence use cannot be combined with"),
        ("kitti:drop", (), "'kitti:drop' is not one of"),
    ],
)  # fmt: skip
def test_wrong_uses(
    write: Write, invoke: Invoke, rule: str, words: tuple[str, ...], message: str
) -> None:
    row = kitti_row(0, 1, "Car", "0 0", np.array([0.0, 0, 60, 40]))
    path = write("gt.txt", row)
    answer = invoke(path, path, *BOXES, "--preprocess", rule, *words, "-q")
    assert answer.status == 2
    assert message in answer.err
    if rule == "kitti" and not words:
        answer = invoke(path, path, "-c", "1", "-g", "1", "--preprocess", rule, "--class", "car")
        assert "--preprocess kitti: needs boxes; choose --distance iou" in answer.err
