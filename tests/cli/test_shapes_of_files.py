"""Files as people have them: lines around the header, columns of each object, folders, JSON."""

import io
import json
import os
import shlex
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Invoke

from tgospa_eval import InputError, evaluate
from tgospa_eval.formats import ReadOptions, read
from tgospa_eval.formats.guess import folder_format

STEPS = range(5)
SHIFT = (0.3, 0.4)
TOTAL = 10 * 0.25
"""Of two objects for five steps, each off by `SHIFT`."""


def states(side: str) -> list[tuple[str, int, float, float]]:
    """Id, step and place of two objects."""
    dx, dy = SHIFT if side == "est" else (0, 0)
    return [(k, t, 10 * int(k) + t + dx, 5 + dy) for t in STEPS for k in "12"]


def write(name: str, text: str) -> None:
    Path(name).parent.mkdir(exist_ok=True)
    Path(name).write_text(text, encoding="utf-8")


def both(form: str, text: Callable[[str], str]) -> tuple[str, str]:
    """The two files, whose names and texts follow from the side."""
    for side in ("gt", "est"):
        write(form.format(side), text(side))
    return form.format("gt"), form.format("est")


def total(answer: Any) -> float:
    assert answer.status == 0, answer.err
    return float(answer.out.split()[2].rstrip(",")) ** 2


def csv_of(header: str, row: str, above: str = "", below: str = "") -> Callable[[str], str]:
    """Text of a CSV file, whose rows are formatted with k, t, x and y."""

    def text(side: str) -> str:
        rows = (row.format(k=k, t=t, x=x, y=y) for k, t, x, y in states(side))
        return "\n".join((*filter(None, (above, header, below)), *rows, ""))

    return text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        pytest.param(
            csv_of(
                "LABEL,TRACK_ID,POSITION_X,POSITION_Y,FRAME",
                "ID,{k},{x},{y},{t}",
                below="Label,Track ID,X,Y,Frame\nLabel,Track ID,X,Y,Frame\n,,(micron),(micron),",
            ),
            "3 lines of units or names below the header passed over",
            id="TrackMate",
        ),
        pytest.param(
            csv_of("id,name,t,x,y", "{k},NA,{t},{x},{y}", below=" , , ,m,m"),
            "1 line of units or names below the header passed over",
            id="units below",
        ),
        pytest.param(
            csv_of("id;t;x;y", "{k};{t};{x};{y}", above="sep=;"),
            "1 line above the header passed over",
            id="Excel's separator",
        ),
        pytest.param(
            csv_of("id,t,x,y", "{k},{t},{x},{y}", above="Export of Monday, at noon"),
            "1 line above the header passed over",
            id="title",
        ),
        pytest.param(
            csv_of(",id,t,x,y", "{t},{k},{t},{x},{y}"),
            "columns not used: column 1 (blank header)",
            id="index of pandas",
        ),
        pytest.param(
            csv_of("id,t,x,y,,", "{k},{t},{x},{y},,"),
            "columns not used: column 5 (blank header), column 6 (blank header)",
            id="commas at the ends",
        ),
        pytest.param(
            csv_of(",frame,id,x,y", "{t},{t},{k},{x},{y}", below=",-,-,m,m"),
            "1 line of units or names below the header passed over",
            id="blank units",
        ),
        pytest.param(csv_of("%time,field.id,field.x,field.y", "{t},{k},{x},{y}"), "", id="rosbag"),
        pytest.param(csv_of("ID,T [frame],East (m),North <m>", "{k},{t},{x},{y}"), "", id="units"),
        pytest.param(csv_of("id,t,X (µm),Y [micron]", "{k},{t},{x},{y}"), "", id="microns"),
    ],
)
def test_lines_around_the_header(invoke: Invoke, text: Callable[[str], str], said: str) -> None:
    answer = invoke(*both("{}.csv", text), "-c", "5", "-g", "2")
    assert total(answer) == pytest.approx(TOTAL, rel=1e-4)
    assert said in answer.err


def test_the_header_that_looks_like_a_comment_is_named_in_the_message(invoke: Invoke) -> None:
    row = "1{t},17{t},{k},{x},{y}"
    header = "%time,field.header.stamp,field.id,field.pose.position.x,field.pose.position.y"
    paths = both("{}.csv", csv_of(header, row))
    answer = invoke(*paths, "-c", "5", "-g", "2")
    assert '"%time" and "field.header.stamp" may both be t' in answer.err
    answer = invoke(*paths, "-c", "5", "-g", "2", "--columns", "t=field.header.stamp")
    assert total(answer) == pytest.approx(TOTAL, rel=1e-4)
    answer = invoke(*paths, "-c", "5", "-g", "2", "--columns", "t=time")
    assert total(answer) == pytest.approx(TOTAL, rel=1e-4)
    write("a.csv", "%when,who,place x,place y\n0,1,2,3\n")
    answer = invoke("inspect", "a.csv")
    assert (answer.status, "a.csv, line 1: no column for" in answer.err) == (3, True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("id,t,x,y\na,one,two,three\n", "line 2, column"),
        ("id,t,x,y\na,0,two,three\na,1,2,3\n", "line 2, column"),
        ("id,t,,x\na,0,1,2\n", "column 3 has no name"),
        ("title\nid,place,t\na,1,2\n", "line 2: no column for position"),
        ("id,t,Local_X,Local_Y\na,0,1,2\n", "--columns x=Local_X,y=Local_Y"),
        ("who,when\nid,t\n" * 9, "line 1: no column for"),
    ],
)
def test_what_is_no_line_of_units(invoke: Invoke, text: str, said: str) -> None:
    write("a.csv", text)
    answer = invoke("inspect", "a.csv")
    assert (answer.status, said in answer.err) == (3, True), answer.err


@pytest.mark.parametrize("word", ["NA", "null", "None", "N/A", "NaN", " NA ", "<NA>", '"NULL"'])
def test_words_for_missing_numbers(tmp_path: Path, word: str) -> None:
    path = str(tmp_path / "a.csv")
    write(path, f"id,t,x,y\na,0,1,2\na,1,{word},{word}\na,2,3,4\n")
    side = read(path).trajectories
    assert [side.times[k].item() for k in side.step] == [0, 2]


# --- columns of each object -----------------------------------------------------------------------


def wide(side: str, header: str, missing: str = "nan") -> str:
    rows = []
    for t in STEPS:
        places = [f"{x},{y}" for _, step, x, y in states(side) if step == t]
        if side == "est" and t == 2:
            places[1] = f"{missing},{missing}"
        rows.append(",".join((f"{t / 25:.2f}", *places)))
    return "\n".join((header, *rows, ""))


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("time,x1,y1,x2,y2", "x=x{id},y=y{id}"),
        ("time,m1.x,m1.y,m2.x,m2.y", "x=m{id}.x,y=m{id}.y"),
        ("Time,Fish 1 X (px),Fish 1 Y (px),Fish 2 X (px),Fish 2 Y (px)",
         "x=Fish {id} X (px),y=Fish {id} Y (px)"),
    ],
)  # fmt: skip
def test_a_wide_table_is_read_by_the_pattern_of_the_message(
    invoke: Invoke, header: str, columns: str
) -> None:
    paths = both("{}.csv", lambda side: wide(side, header))
    answer = invoke(*paths, "-c", "5", "-g", "2")
    assert (answer.status, answer.out) == (3, "")
    assert f"if each object has its own columns, --truth-columns '{columns}'" in answer.err
    answer = invoke(*paths, "-c", "5", "-g", "2", "--columns", columns)
    assert total(answer) == pytest.approx(9 * 0.25 + 12.5, rel=1e-4)
    tables = [pd.read_csv(path) for path in paths]
    options = {"cutoff": 5, "switch_penalty": 2}
    found = evaluate(*tables, columns=tuple(columns.split(",")), **options)
    assert found.total == pytest.approx(9 * 0.25 + 12.5)


def test_a_wide_table_beside_a_long_one(invoke: Invoke) -> None:
    write("gt.csv", csv_of("id,t,x,y", "{k},{t},{x},{y}")("gt"))
    write("est.csv", "t,x1,y1,x2,y2\n" + "".join(f"{t},{10 + t},5,{20 + t},5\n" for t in STEPS))
    for columns in (("--estimate-columns", "x{id},y{id}"), ("--columns", "x{id},y{id}")):
        assert total(invoke("gt.csv", "est.csv", "-c", "5", "-g", "2", *columns)) == 0
    answer = invoke("gt.csv", "est.csv", "--estimate-columns", "id=t,x=x{id},y=y{id}")
    assert (answer.status, "ids are named by {id} in headers" in answer.err) == (2, True)
    write("bad.csv", "t,x1,y1,x2,y2\n0,1,2,3,4\n1,1,2,3\n")
    answer = invoke("inspect", "bad.csv", "--columns", "x{id},y{id}")
    assert "bad.csv, line 3: 4 fields, the header has 5" in answer.err
    write("bad.csv", "t,x1,y1,x2,y2\n0,1,2,3,4\n1,1,2,far,4\n")
    answer = invoke("inspect", "bad.csv", "--columns", "x{id},y{id}")
    assert 'bad.csv, line 3, column "x": not a number: "far"' in answer.err


def test_deeplabcut(invoke: Invoke) -> None:
    def text(side: str, parts: str = "nose,nose,nose,nose") -> str:
        rows = wide(side, "", missing="")
        levels = ("scorer,net,net,net,net", "individuals,m1,m1,m2,m2", f"bodyparts,{parts}")
        return "\n".join((*levels, "coords,x,y,x,y", rows.strip(), ""))

    paths = both("{}.csv", text)
    answer = invoke(*paths, "-c", "5", "-g", "2")
    assert total(answer) == pytest.approx(9 * 0.25 + 12.5, rel=1e-4)
    paths = both("{}.csv", lambda side: text(side, "nose,nose,tail,tail"))
    answer = invoke(*paths, "-c", "5", "-g", "2")
    assert (answer.status, "several body parts (nose, tail)" in answer.err) == (3, True)


# --- folders --------------------------------------------------------------------------------------


def test_a_folder_of_tum_has_an_object_a_file(invoke: Invoke) -> None:
    for side in ("gt", "est"):
        for name in "12":
            lines = [f"{t}.5 {x} {y} 0 0 0 0.6 0.8" for k, t, x, y in states(side) if k == name]
            head = "# timestamp tx ty tz qx qy qz qw\n" * (side == "gt")
            write(f"{side}/robot{name}.txt", head + "\n".join(lines) + "\n")
    for options in ((), ("--memory", "1GB")):
        answer = invoke("gt", "est", "-c", "5", "-g", "2", *options)
        assert total(answer) == pytest.approx(TOTAL, rel=1e-4)
        assert "gt: read as tum" in answer.err
    answer = invoke("gt/robot1.txt", "est/robot1.txt", "-c", "5", "-g", "2")
    assert total(answer) == pytest.approx(TOTAL / 2, rel=1e-4)
    write("est/robot2.txt", "# run 7\n" * 20 + "9 far 0 0 0 0 0 1\n")
    answer = invoke("gt", "est", "-c", "5", "-g", "2")
    assert 'est, robot2.txt, line 21, column "x": not a number: "far"' in answer.err
    write("est/other.csv", "id,t,x,y\n")  # then it is not known what is meant
    assert "est: is a folder, not a file" in invoke("gt", "est").err


def test_a_folder_of_yolo_has_a_frame_a_file(invoke: Invoke) -> None:
    for side, shift in (("gt", 0), ("res", 0.01)):
        for t in STEPS:
            lines = [f"0 {0.2 * k + 0.01 * t + shift:.4f} 0.3000 0.05 0.1 {k}" for k in (1, 2)]
            write(f"{side}/clip_{t}.txt", "\n".join(lines) + "\n")
    answer = invoke(".", "..")
    assert ".: is a folder, not a file; in it: gt, res" in answer.err
    write("gt/classes.txt", "car\n")
    write("gt/clip_9.txt", "")
    answer = invoke("gt", "res", "--distance", "iou", "-c", "0.5", "-g", "0.5")
    overlap = 1 - 0.04 / 0.06
    assert total(answer) == pytest.approx(10 * overlap**2, rel=1e-4)
    answer = invoke("gt", "res", "-c", "0.1", "-g", "0.05")
    assert total(answer) == pytest.approx(10 * 0.01**2, rel=1e-4)
    for text, said in (
        ("0 0.2 0.3 0.05 0.1 0.87\n", "no id: these are detections"),
        ("0 0.2 0.3 0.05 0.1\n", "no id: these are detections"),
    ):
        write("res/clip_3.txt", text)
        answer = invoke("gt", "res", "-c", "0.1", "-g", "0.05")
        assert (answer.status, said in answer.err) == (3, True)
        assert "res, clip_3.txt, line 1: " in answer.err
    write("res/clip_3.txt", "0 0.2 0.3 0.05 0.1 0.87 1\n")
    write("res/other_3.txt", "0 0.2 0.3 0.05 0.1 0.87 1\n")
    answer = invoke("gt", "res", "-c", "0.1", "-g", "0.05")
    assert "res: frames of several videos (clip_, other_); use a folder for each" in answer.err


def test_a_folder_of_tables_without_ids_has_an_object_a_file(invoke: Invoke) -> None:
    for side in ("gt", "est"):
        for name in "12":
            rows = [f"{t};{x};{y}" for k, t, x, y in states(side) if k == name]
            write(f"{side}/ship {name}.csv", "\n".join(("time;x;y", *rows, "")))
    answer = invoke("gt", "est", "-c", "5", "-g", "2")
    assert total(answer) == pytest.approx(TOTAL, rel=1e-4)
    assert "gt: read as csv-per-object" in answer.err
    assert evaluate("gt", "est", cutoff=5, switch_penalty=2).total == pytest.approx(TOTAL)
    write("est/ship 2.csv", "time;x;y\n0;far;1\n")
    answer = invoke("gt", "est", "-c", "5", "-g", "2")
    assert 'est, ship 2.csv, line 2, column "x": not a number: "far"' in answer.err
    write("est/ship 2.csv", "time;name;x;y\n0;7;1;1\n")  # a name may be an id
    assert "est: is a folder, not a file" in invoke("gt", "est").err
    write("est.csv", "ID,time,x,y\n1,0,1,1\n")
    answer = invoke("gt", "est.csv", "--estimate-format", "csv-per-object")
    text = "est.csv: a file of one object must not have a column id; use the format csv"
    assert (answer.status, answer.err.strip()) == (3, text)
    os.mkfifo("gt/pipe.csv")  # which nobody waits for
    assert folder_format("gt") == ""


# --- JSON and Excel -------------------------------------------------------------------------------


def records(side: str) -> list[dict[str, object]]:
    return [
        {"frame": t, "tracker_id": k, "class_name": "car", "at": {"x": x, "y": y}}
        | {"x_min": x - 1, "y_min": y - 1, "x_max": x + 1, "y_max": y + 1}
        for k, t, x, y in states(side)
    ]


JSON = {
    "lines": lambda side: "\n".join(map(json.dumps, records(side))),
    "indented": lambda side: json.dumps(records(side), indent=4),
    "by column": lambda side: pd.DataFrame(records(side)).drop(columns="at").to_json(),
}


@pytest.mark.parametrize("text", JSON.values(), ids=JSON)
def test_flat_records(invoke: Invoke, text: Callable[[str], str]) -> None:
    paths = both("{}.json", text)
    answer = invoke(*paths, "-c", "5", "-g", "2")
    assert total(answer) == pytest.approx(TOTAL, rel=1e-4)
    if "at" in text("gt"):
        answer = invoke(*paths, "-c", "5", "-g", "2", "--columns", "x=at.x,y=at.y")
    assert total(answer) == pytest.approx(TOTAL, rel=1e-4)


def by_frame(side: str, key: str) -> list[dict[str, Any]]:
    """A record for each step, with those of the objects in a list."""
    return [
        {"frame": t, key: [{"id": k, "x": x, "y": y} for k, s, x, y in states(side) if s == t]}
        for t in STEPS
    ]


NESTED = {
    "a list a frame": lambda side: json.dumps(by_frame(side, "objects")),
    "a list beside other values": lambda side: json.dumps(
        {"meta": {"fps": 10}, "frames": by_frame(side, "tracks")}
    ),
    "lists in one list": lambda side: json.dumps({"all": by_frame(side, "tracks")}),
    "lines": lambda side: "\n".join(map(json.dumps, by_frame(side, "tracks"))),
    "by frame": lambda side: json.dumps({r["frame"]: r["all"] for r in by_frame(side, "all")}),
    "by object": lambda side: json.dumps(
        {k: [{"t": t, "x": x, "y": y} for n, t, x, y in states(side) if n == k] for k in "12"}
    ),
    "a list an object": lambda side: json.dumps(
        [
            {"id": k, "at": [{"t": t, "x": x, "y": y} for n, t, x, y in states(side) if n == k]}
            for k in "12"
        ]
    ),
}


for orient in ("split", "index", "table"):
    NESTED[orient] = lambda side, orient=orient: pd.DataFrame(
        states(side), columns=["id", "t", "x", "y"]
    ).to_json(orient=orient)


@pytest.mark.parametrize("text", NESTED.values(), ids=NESTED)
def test_nested_records(invoke: Invoke, text: Callable[[str], str]) -> None:
    answer = invoke(*both("{}.json", text), "-c", "5", "-g", "2")
    assert total(answer) == pytest.approx(TOTAL, rel=1e-4)


@pytest.mark.parametrize(
    "by_key",
    [
        {"0": [{"id": 1, "x": 0, "y": 0}], "1": [], "2": []},
        {"a": [{"t": 0, "x": 0, "y": 0}], "b": []},
        {"7": [{"t": 0, "x": 0, "y": 0, "past": [{"x": 1}]}]},
        {"a": [{"t": 0, "x": 0, "y": 0, "past": [{"x": 1}]}], "b": []},
        {"all": [{"t": 0, "at": [{"track_id": 1, "x": 0, "y": 0}]}], "none": []},
    ],
)
def test_a_single_list_in_a_mapping(invoke: Invoke, by_key: dict[str, Any]) -> None:
    Path("truth.json").write_text(json.dumps(by_key))
    answer = invoke("truth.json", "truth.json", "-c", "5", "-g", "2")
    assert total(answer) == 0
    assert "1 object-step" in answer.out.replace("\n", " ")


def test_boxes_in_lists_are_corners_or_sizes(invoke: Invoke) -> None:
    def text(side: str) -> str:
        return json.dumps(
            [
                {"frame": t, "track_id": k, "bbox": [x, y, x + 2, y + 2]}
                for k, t, x, y in states(side)
            ]
        )

    paths = both("{}.json", text)
    answer = invoke(*paths, "-c", "5", "-g", "2")
    corners = "left=bbox.0,top=bbox.1,right=bbox.2,bottom=bbox.3"
    assert f"--truth-columns {corners} if it has two corners" in answer.err
    answer = invoke(*paths, "-c", "5", "-g", "2", "--columns", corners)
    assert total(answer) == pytest.approx(TOTAL, rel=1e-4)


def coco(side: str, **image: Any) -> dict[str, Any]:
    images = [
        {"id": 10 * t + 3, "file_name": f"{t}.jpg"}
        | {key: value(t) for key, value in image.items()}
        for t in STEPS
    ]
    annotations = [
        {"id": n, "image_id": 10 * t + 3, "track_id": k, "bbox": [x - 1, y - 1, 2, 2]}
        for n, (k, t, x, y) in enumerate(states(side))
    ]
    return {"images": images, "annotations": annotations, "categories": []}


def test_marks_of_coco(invoke: Invoke) -> None:
    truth = coco("gt", frame_id=lambda t: t)
    for k, one in enumerate(truth["annotations"]):
        one |= {"iscrowd": k % 2, "ignore": 0}
    write("t.json", json.dumps(truth))
    answer = invoke("t.json", "t.json", "-c", "5", "-g", "2", "--truth-where", "iscrowd == 0")
    rows = len(truth["annotations"]) // 2
    assert f"t.json: {rows} rows left out by --truth-where" in answer.err


def test_coco(invoke: Invoke) -> None:
    both("{}.json", lambda side: json.dumps(coco(side, frame_id=lambda t: t)))
    write("res.json", json.dumps(coco("est")["annotations"]))
    for estimate in ("est.json", "res.json"):
        answer = invoke("gt.json", estimate, "-c", "5", "-g", "2")
        assert total(answer) == pytest.approx(TOTAL, rel=1e-4)
    assert "evaluate them against the file with the images" in invoke("inspect", "res.json").err
    both("{}.json", lambda side: json.dumps(coco(side)))
    assert total(invoke("gt.json", "est.json", "-c", "5")) == pytest.approx(TOTAL, rel=1e-4)


@pytest.mark.parametrize(
    ("document", "said"),
    [
        (coco("gt", video_id=lambda t: t % 2), "2 videos (0, 1), which are not one recording"),
        (coco("gt", file_name=lambda t: f"{9 - t}.jpg"), "not in the order of their names"),
        ({"images": [], "annotations": [{"id": 1}]}, "not annotations of COCO: KeyError"),
        ({"type": "FeatureCollection", "features": []}, "JSON, not a table"),
        ([{"id": 1, "frame": 0, "bbox": [1, 2, 3, 4]}], "no column for position"),
        ([{"id": "\ud800", "t": 0, "x": 1}], "a text with half a character"),
        ([{"id": 1, "t": 0, "x": 1}, 7], "JSON, not a table"),
        ({"tracks": {"1": {"0": [2, 3]}}}, 'a list of records, such as [{"id": 1, "t": 0,'),
        ({"1": {"0": [2, 3]}, "2": {"0": {"x": 2}}}, "JSON, not a table"),
        (
            [{"id": 1, "t": 0, "x": [1, 2]}, {"id": 1, "t": 1, "x": 2}],
            'record 1, column "x": a value',
        ),
    ],
)
def test_documents_that_are_no_tracks(invoke: Invoke, document: object, said: str) -> None:
    write("a.json", json.dumps(document))
    answer = invoke("inspect", "a.json")
    assert (answer.status, said in answer.err) == (3, True), answer.err
    assert len(answer.err.splitlines()) == 1


def test_wrong_json_is_named_by_its_line(invoke: Invoke) -> None:
    write("a.jsonl", '{"id": 1, "t": 0, "x": 2}\n{"id": 1,\n')
    assert "a.jsonl, line 2, column" in invoke("inspect", "a.jsonl").err


def test_a_spreadsheet(monkeypatch: pytest.MonkeyPatch, invoke: Invoke) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as file:
        file.writestr("[Content_Types].xml", "<Types/>")
    Path("a.xlsx").write_bytes(packed.getvalue())
    frames = {"one": pd.DataFrame({"id": ["a", "a"], "t": [0, 1], "x": [1.0, None]})}
    calls: list[Any] = []

    def read_excel(*_: Any, **__: Any) -> Any:
        if isinstance(calls[0], Exception):
            raise calls[0]
        return calls[0]

    monkeypatch.setattr(pd, "read_excel", read_excel)
    calls[:] = [ImportError("openpyxl")]
    answer = invoke("inspect", "a.xlsx")
    message = "a.xlsx: a spreadsheet; save it as CSV, or install openpyxl, which reads it\n"
    assert (answer.status, answer.err) == (3, message)
    calls[:] = [frames]
    assert read("a.xlsx").rows == 2
    calls[:] = [frames | {"two": frames["one"]}]
    assert "2 tables (one, two); save one as CSV" in invoke("inspect", "a.xlsx").err


@pytest.mark.parametrize(
    ("cell", "is_known"),
    [
        ('<c r="C2"><f>A2+1</f><v></v></c>', False),
        ('<c r="C2" s="1"><f>A2+1</f><v/></c>', False),
        ('<c r="C2"><f ca="1">A2+1</f></c>', False),
        ('<c r="C2"><f>A2+1</f><v>3</v></c>', True),
        ('<c r="C2" t="str"><f>A2</f><v></v></c>', True),  # a blank text
        ('<c r="B2" s="1"/><c r="C2"><v>3</v></c>', True),
    ],
)
def test_formulas_of_a_spreadsheet(
    monkeypatch: pytest.MonkeyPatch, invoke: Invoke, cell: str, is_known: bool
) -> None:
    with zipfile.ZipFile("a.xlsx", "w") as file:
        file.writestr("[Content_Types].xml", "<Types/>")
        file.writestr("xl/worksheets/sheet1.xml", f"<sheetData><row>{cell}</row></sheetData>")
    table = pd.DataFrame({"id": ["a"], "t": [0], "x": [None]})
    monkeypatch.setattr(pd, "read_excel", lambda *_, **__: {"one": table})
    answer = invoke("inspect", "a.xlsx")
    message = "a.xlsx, cell C2: a formula without its value"
    assert (answer.status == 3, message in answer.err) == (not is_known, not is_known)


def test_tracks_of_napari(invoke: Invoke) -> None:
    write("gt.csv", csv_of("ID,T,Y,X", "{k},{t},{y},{x}")("gt"))
    write("est.csv", csv_of("ID,T,Y,X", "{k},{t},{y},{x}")("est"))
    assert total(invoke("gt.csv", "est.csv", "-c", "5", "-g", "2")) == pytest.approx(2.5, rel=1e-4)
    np.save("a.npy", np.zeros((6, 4)))
    with pytest.raises(InputError, match=r'columns=\["id", "t", "y", "x"\]'):
        read("a.npy", ReadOptions())


def vis(*, hidden: str = "", mark: str = "0,1") -> str:
    """Return a table of one object that `hidden` hides at a third of the steps."""
    off, on = mark.split(",")
    place = ("{t},{t}", hidden or "{t},{t}")
    rows = [
        f"1,{t},{off if t % 3 == 0 else on},{place[t % 3 == 0].format(t=t + 5)}" for t in range(9)
    ]
    return "\n".join(("id,frame,HEADER,x,y", *rows)) + "\n"


PARKED = "".join(f"2,{t},0,9,4\n" for t in range(9))


@pytest.mark.parametrize(
    ("header", "truth", "estimate", "way"),
    [
        ("visibility", vis(), vis(hidden="0,0"), "--estimate-where 'visibility > 0'"),
        (
            "visible",
            vis(),
            vis(hidden="-1,-1", mark="False,True"),
            "--estimate-where 'visible == True'",
        ),
        ("vis", vis(), vis(hidden="0,0"), "--estimate-where 'vis > 0'"),
        ("visibility", vis(), vis(), ""),  # hidden objects with known positions
        ("visibility", f"{vis()}{PARKED}", f"{vis()}{PARKED}", ""),  # one is always hidden
        ("conf", vis(), vis(), "--ignore conf=0"),
        ("iscrowd", vis(mark="1,0"), vis(mark="0,0"), "--ignore 'iscrowd>0'"),
        ("ignore", vis(mark="True,False"), vis(mark="False,False"), "--ignore ignore=True"),
        ("ignored", vis(mark="1,0"), vis(mark="0,0"), "--ignore marked"),
        ("ignored", vis(mark="0.5,0"), vis(mark="0,0"), "--ignore 'ignored>0'"),
        ("ignore", vis(mark="0,0"), vis(mark="1,0"), "--estimate-where 'ignore == 0'"),
    ],
)
def test_flags_of_rows_that_may_not_count(
    invoke: Invoke, header: str, truth: str, estimate: str, way: str
) -> None:
    for name, table in (("t.csv", truth), ("e.csv", estimate)):
        write(name, table.replace("HEADER", header))
    answer = invoke("t.csv", "e.csv", "-c", "5", "-g", "2", "--format", "json")
    assert ("them out" in answer.err or "at no cost" in answer.err) is bool(way), answer.err
    assert way in answer.err
    if way:
        done = invoke("t.csv", "e.csv", "-c", "5", "-g", "2", "--format", "json", *shlex.split(way))
        if "where" in way:
            assert f"3 rows left out by {way.split()[0]}" in done.err
        else:
            found = json.loads(done.out)
            counts = found["ignored"]
            assert (counts["truth_states"], counts["absorbed"], found["tgospa"]) == (3, 3, 0)
