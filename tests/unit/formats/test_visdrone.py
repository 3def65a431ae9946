"""VisDrone tracks: what tells them apart, what is left out, and the answer of the same CSV."""

import json

import pandas as pd
import pytest
from answer import Run, Write
from checkout import SAMPLES

from tgospa_eval import InputError
from tgospa_eval.formats import ReadOptions, read
from tgospa_eval.formats.text import lines
from tgospa_eval.formats.text.table import CATEGORIES, VISDRONE_FIELDS

FOLDER = SAMPLES / "visdrone"
TRUTH, RESULT = str(FOLDER / "gt.txt"), str(FOLDER / "res.txt")
GT = (
    "1,0,593,43,174,190,0,0,0,0\n"
    "1,1,10,20,4,6,1,4,0,1\n"
    "2,1,12,20,4,6,1,4,1,2\n"
    "1,2,50,50,9,9,1,11,0,0\n"
    "2,2,60,50,9,9,0,1,0,0\n"
)


@pytest.mark.parametrize("size", [lines.LARGE_BYTES, 0])
def test_classes_grades_and_what_is_left_out(
    write: Write, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(lines, "LARGE_BYTES", size)
    names = ("class", "truncation", "occlusion", "score")
    found = read(write("a.txt", GT), ReadOptions(by_class=True, attributes=names))
    side = found.trajectories
    assert (found.format, found.classes, side.ids.tolist()) == ("visdrone", ("car",), ["1"])
    assert found.left_out == {"ignored regions": 1, "others": 1, "not considered": 1}
    assert {name: values.tolist() for name, values in side.attributes.items()} == {
        "class": ["car", "car"],
        "truncation": [0, 1],
        "occlusion": [1, 2],
        "score": [1, 1],
    }
    only = read(write("a.txt", GT), ReadOptions(attributes=("class",)))  # asked for as such alone
    assert only.trajectories.attributes["class"].tolist() == ["car", "car"]
    assert read(write("a.txt", GT), role="estimate").left_out == {"ignored regions": 1, "others": 1}


@pytest.mark.parametrize(
    ("line", "format_"),
    [
        ("1,7,10,20,4,6,0.9,4,-1,-1", "visdrone"),
        ("1 7 10 20 4 6 1 4 0 2", "visdrone"),
        ("1,7,10,20,4,6,1,4,0,2\n" * 400, "visdrone"),  # cut off in the middle of a line
        ("1,7,10,20,4,6,0,0,0,0\n" * 400, "visdrone"),  # sorted by id: regions come first
        ("1,7,10,20,4,6,0.9,0,0,0", "motchallenge"),
        ("1,7,10,20,4,6,1,-1,-1,-1", "motchallenge"),
        ("1,7,10,20,4,6,1,0,-1,-1", "motchallenge"),
        ("1,7,10,20,4,6,1,12,0,0", "motchallenge"),
        ("1,7,10,20,4,6,1,4.5,1,2", "motchallenge"),  # a place in space
        ("1,7,10,20,4,6,1,4,0,2\n2,7,10,20,4,6,1,4,0,3", "motchallenge"),
        ("1,7,10,20,4,6,1,4,1", "motchallenge"),
        ("1,0,10,20,4,6,1,1,1\n2,0,10,20,4,6,1,1,1", "motchallenge"),  # DanceTrack
        ("1, 0, 10, 20, 4, 6, 1, 1, 1.0", "motchallenge"),  # SportsMOT
    ],
)
def test_which_it_is(write: Write, line: str, format_: str) -> None:
    assert read(write("gt.txt", line), ReadOptions(on_duplicate="first")).format == format_


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GT + "3,1,0,0,1,1,1,12,0,0\n", 'line 6, column "class": "12" is not a class of VisDrone;'),
        (GT + "3,1,0,0,1,1,x,4,0,0\n", 'line 6, column "score": not a number: "x"'),
        ("1,1,0,0,1,1,1,4,0\n", "9 fields; VisDrone tracks have 10"),
        ("1,-1,0,0,1,1,1,4,0,0\n", "every id is -1"),
    ],
)
def test_what_is_wrong(write: Write, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(write("a.txt", text), format="visdrone")
    assert read(write("a.txt", ""), format="visdrone").rows == 0


def test_the_answer_of_the_csv_file(invoke: Run) -> None:
    paths = []
    for name, path in (("gt", TRUTH), ("res", RESULT)):
        table = pd.read_csv(path, header=None, names=VISDRONE_FIELDS)
        table["class"] = [CATEGORIES[number] for number in table["class"]]
        table = table[~table["class"].isin(["ignored regions", "others"])]
        table.to_csv(f"{name}.csv", index=False)
        paths.append(f"{name}.csv")
    asked = ("-c", "50", "-g", "25", "--slice", "occlusion", "--class", "car,van,bus")
    for more in ((), ("--by", "class"), ("--distance", "iou", "-c", "0.5", "-g", "0.5")):
        want, found = (
            json.loads(invoke(*files, *asked, *more, "--format", "json").out)
            for files in (paths, [TRUTH, RESULT])
        )
        assert found["tgospa"] == want["tgospa"] > 0
        for part in ("localisation", "missed", "false", "switch", "slices"):
            assert found[part] == want[part]
        classes = [
            {name: part["total"] for name, part in side.get("by_class", {}).items()}
            for side in (want, found)
        ]
        assert classes[0] == classes[1]
    seen = json.loads(invoke("inspect", TRUTH, "--format", "json").out)
    assert seen["truth"]["format"] == "visdrone"
