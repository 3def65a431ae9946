"""Which columns of a file are places, where several may be: as people's files have them."""

import os
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from answer import Invoke

from tgospa_eval import TgospaWarning, batch, evaluate

Rows = Iterable[Iterable[object]]


def write(name: str, header: str, rows: Rows, mark: str = ",") -> None:
    lines = [header, *(mark.join(map(str, row)) for row in rows)]
    Path(name).write_text("\n".join(filter(None, lines)) + "\n", encoding="utf-8")


def boxes(shift: tuple[float, float] = (0, 0), size: tuple[float, float] = (20, 40)) -> Rows:
    """Two objects 800 px apart, six frames."""
    for frame in range(6):
        for name, left in ((1, 100), (2, 900)):
            yield frame, name, left + 5 * frame + shift[0], 50 + shift[1], *size


def value(answer: Any) -> float:
    assert answer.status == 0, answer.err
    return float(answer.out.split()[2].rstrip(",").replace(",", ""))


@pytest.mark.parametrize("unknown", [-1, 0, ""])
@pytest.mark.parametrize("columns", [("x", "y", "z"), ("pos_x", "pos_y")])
def test_a_place_that_no_row_knows_is_not_taken(
    invoke: Invoke, unknown: object, columns: tuple[str, ...]
) -> None:
    header = f"frame,id,bb_left,bb_top,bb_width,bb_height,conf,{','.join(columns)}"
    for name, shift in (("gt.csv", (0, 0)), ("res.csv", (6, 8))):
        rows = [(*row, 1, *[unknown] * len(columns)) for row in boxes(shift)]
        write(name, header, rows)
    answer = invoke("gt.csv", "res.csv", "-c", "50", "-g", "10")
    assert value(answer) == pytest.approx((12 * 100) ** 0.5, rel=1e-5)
    assert "the same in all rows, so not a position: centres of boxes are compared" in answer.err
    invoke("gt.csv", "res.csv", "-c", "50", "-g", "10", "-o", "done", "--pictures", "none")
    assert "so not a position: centres of boxes" in Path("done/report.html").read_text(
        encoding="utf-8"
    )
    tables = [pd.read_csv(name) for name in ("gt.csv", "res.csv")]
    assert evaluate(*tables, cutoff=50, switch_penalty=10).total == pytest.approx(1200)


def kitti(*, image: bool, place: bool = True, shift: float = 0.0) -> Rows:
    for frame in range(6):
        for name, x in ((1, 2.0), (2, 12.0)):
            edges = (10 * x, 50, 10 * x + 20, 90) if image else (-1, -1, -1, -1)
            where = (x + 0.1 * frame + 0.3 * shift, 1.7, 20 + 0.4 * shift)
            own = where if place else (-1000, -1000, -1000)
            yield frame, name, "Pedestrian", 0, 0, -10, *edges, 1.8, 0.6, 0.8, *own, 0.1


@pytest.mark.parametrize("image", [True, False])
def test_both_sides_are_compared_by_a_place_that_both_know(invoke: Invoke, image: bool) -> None:
    write("truth.txt", "", kitti(image=image), " ")
    write("est.txt", "", kitti(image=False, shift=1.0), " ")
    for pair in (("truth.txt", "est.txt"), ("est.txt", "truth.txt")):
        answer = invoke(*pair, "-c", "2", "-g", "1")
        assert value(answer) == pytest.approx((12 * 0.25) ** 0.5, rel=1e-5)
        assert "so not a position: x, y, z are compared" in answer.err
        assert ("x, y, z are compared, as in the other file" in answer.err) == image
    answer = invoke("truth.txt", "est.txt", "--distance", "iou")
    assert answer.status == 3
    assert "0 is not a width of a box" in answer.err
    assert "and no row is valid" in answer.err
    assert "drop" not in answer.err


def test_boxes_of_minus_1_beside_a_place_in_space(invoke: Invoke) -> None:
    for name, shift in (("gt", 0), ("res", 0.5)):
        rows = [(t, k, *[-1] * 4, 1, 9 * k + shift, t, 0) for t in (1, 2) for k in (1, 2)]
        write(f"{name}.txt", "", rows)
    answer = invoke("gt.txt", "res.txt", "-c", "5", "-g", "1")
    assert "res.txt: left, width, top, height: the same in all rows" in answer.err
    assert value(answer) == pytest.approx(1)
    assert value(invoke("gt.txt", "res.txt", "-c", "5", "-g", "1", "--columns", "x,y,z")) == 1
    for more in (("--columns", "x,y"), ("--distance", "iou")):
        answer = invoke("gt.txt", "res.txt", "-c", "0.5", "-g", "0.1", *more)
        assert "-1 is not a width of a box" in answer.err
    write("none.txt", "", [(t, 1, *[-1] * 4, 1, *[-1] * 3) for t in (1, 2)])
    answer = invoke("gt.txt", "none.txt", "-c", "5", "-g", "1")
    assert 'none.txt, line 1, column "width": -1 is not a width of a box' in answer.err


def test_a_place_that_stands_still_is_one(invoke: Invoke) -> None:
    """A single object that does not move, without another place, is no doubt."""
    write("a.csv", "id,t,x,y", [(1, t, 3, 4) for t in range(5)])
    write("c.csv", "id,t,x,y", [(1, t, 3, 4 + t % 2) for t in range(5)])
    answer = invoke("a.csv", "c.csv", "-c", "5", "-g", "1")
    assert value(answer) == pytest.approx(2**0.5, rel=1e-5)
    assert "the same in all rows" not in answer.err
    write("b.csv", "id,t,x,y", [(k, t, -1, -1) for t in range(5) for k in (1, 2)])
    answer = invoke("b.csv", "b.csv", "-c", "1", "-g", "1")
    assert "warning: b.csv: x, y: the same in all rows, as if the position is unknown" in answer.err


@pytest.mark.parametrize("mark", [-1, -999, -9999, 9999, -32768, 99999])
@pytest.mark.parametrize("header", ["id,t,x,y", "id,t,Pos X,Pos Y"])
def test_a_mark_in_some_rows_is_no_place(invoke: Invoke, mark: int, header: str) -> None:
    rows = [(k, t, 50 + 10 * k + t, 70 + 2 * t) for t in range(6) for k in range(4)]
    at = "x" if header.endswith("x,y") else '"Pos X"'
    columns = ("--columns", "x=Pos X,y=Pos Y") if '"' in at else ()
    options = "-c", "5", "-g", "1", *columns
    write("a.csv", header, rows)
    marked = [(k, t, *([mark] * 2 if (k + t) % 3 == 0 else (x, y))) for k, t, x, y in rows]
    marked += [(5, t, mark, mark) for t in range(6)]
    write("b.csv", header, marked)
    answer = invoke("a.csv", "b.csv", *options)
    way = f"{at} != {mark}"
    assert f"warning: b.csv: 14 rows are at {mark},{mark}, far from" in answer.err
    assert f"--estimate-where '{way}' leaves them out" in answer.err
    answer = invoke("a.csv", "b.csv", *options, "--estimate-where", way)
    assert "0 false" in answer.out.replace("\n", " ")
    assert "far from" not in answer.err


@pytest.mark.parametrize(
    "place",
    [
        lambda k, t: (t * (k - 2), t * (3 - k)),  # all begin at the origin
        lambda k, t: (t + k, t + k),  # all move along one line
        lambda k, t: (0, 0) if t < 9 else (t - 8, k),  # parked at the origin
        lambda k, t: (0, 0) if k == 0 else (t - 9, k),  # the sensor itself
        lambda k, t: (0, 0) if k == 0 and 9 < t < 13 else (45 + k + t / 9, 3),  # a kick-off
        lambda k, t: (10, 10) if t % 6 < 2 else (60 + t % 6, 70 + k),  # the place of a new start
        lambda k, t: (5, 5) if t // 5 % 2 else (20, 30 + k),  # two places in turn
        lambda k, t: (-1, -1) if k == 0 and t < 3 else (t * k - 90, k),  # one of many places
    ],
)
def test_places_at_the_origin_are_no_marks(invoke: Invoke, place: Any) -> None:
    write("a.csv", "id,t,x,y", [(k, t, *place(k, t)) for t in range(18) for k in range(4)])
    assert "unknown position" not in invoke("a.csv", "a.csv", "-c", "5", "-g", "1").err


def test_no_fix_is_no_place(invoke: Invoke) -> None:
    rows = [(1, t, *((0, 0) if t in (3, 4) else (48 + t / 1e5, 11))) for t in range(9)]
    write("a.csv", "id,t,lat,lon", rows)
    told = invoke("a.csv", "a.csv", "-c", "5", "-g", "1", "--distance", "haversine").err
    assert "a.csv: 2 rows are at 0,0, far from" in told


def test_boxes_in_place_of_points_are_told(invoke: Invoke) -> None:
    write("gt.csv", "id,t,x,y", [(k, f, x, y) for f, k, x, y, *_ in boxes()])
    write("res.csv", "frame,id,left,top,width,height,x,y", [(*row, -1, -1) for row in boxes()])
    answer = invoke("gt.csv", "res.csv", "-c", "50", "-g", "10")
    assert "warning: res.csv: its positions are unknown, so centres of its boxes" in answer.err
    assert "warning: gt.csv" not in answer.err


def test_no_estimate_decides_what_another_is_compared_with(invoke: Invoke) -> None:
    """A truth that is read once for several estimates is read for each by its own place."""
    header = "frame,id,left,top,width,height,x,y"
    places = [(k + 0.1 * f, 2 * k) for f, k, *_ in boxes()]
    for name, shift, known in (("gt", 0, places), ("a", 3, [(-1, -1)] * 12), ("b", 3, places)):
        rows = zip(boxes((shift, 0)), known, strict=True)
        write(f"{name}.csv", header, [(*box, *place) for box, place in rows])
    answer = invoke("compare", "gt.csv", "a.csv", "b.csv", "-c", "9", "-g", "1", "--format", "json")
    assert "b.csv, has other states, ids or times than that of a.csv" in answer.err
    assert not answer.out
    alone = [value(invoke("gt.csv", f"{name}.csv", "-c", "9", "-g", "1")) for name in "ab"]
    assert alone == [pytest.approx((12 * 9) ** 0.5, rel=1e-5), 0]


@pytest.mark.process
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_a_pipe_is_not_read_a_second_time(invoke: Invoke) -> None:
    header = "frame,id,left,top,width,height,x,y"
    write("gt.csv", header, [(*row, k, k) for k, row in enumerate(boxes())])
    write("res.csv", header, [(*row, -1, -1) for row in boxes()])
    os.mkfifo("pipe.csv")
    writer = threading.Thread(
        target=lambda: Path("pipe.csv").write_bytes(Path("gt.csv").read_bytes())
    )
    writer.start()
    answer = invoke("pipe.csv", "res.csv", "-c", "9", "-g", "1")
    writer.join()
    assert "warning: res.csv: its positions are unknown, so centres of its boxes" in answer.err


def test_a_mapping_goes_before_headers(invoke: Invoke) -> None:
    write("gt.csv", "frame,id,left,top,width,height", boxes())
    write("res.csv", "frame,id,x,y,w,h", boxes((3, 4)))
    doubtful = invoke("gt.csv", "res.csv", "-c", "50", "-g", "10")
    assert "x, y next to w, h may be the corner or the centre of boxes" in doubtful.err
    corner = "left=x,top=y,width=w,height=h"
    assert f"use --estimate-columns {corner} if they are the corner" in doubtful.err
    answer = invoke("gt.csv", "res.csv", "-c", "50", "-g", "10", "--estimate-columns", corner)
    assert value(answer) == pytest.approx((12 * 25) ** 0.5, rel=1e-5)
    assert "beside w, h" not in answer.err
    truth, table = pd.read_csv("gt.csv"), pd.read_csv("res.csv")
    names = dict(item.split("=")[::-1] for item in corner.split(","))
    given: dict[str, Any] = {"cutoff": 50, "switch_penalty": 10}
    assert evaluate(truth, table.rename(columns=names), **given).total == pytest.approx(300)
    chosen = tuple(corner.split(","))
    assert evaluate(truth, table, **given, estimate_columns=chosen).total == pytest.approx(300)
    with pytest.warns(TgospaWarning, match="corner or the centre"):
        evaluate(truth, table, **given)


PLACED = {
    "corners": lambda k, t: (300 * k + 5 * t, 200 + 2 * t, 300 * k + 5 * t + 20, 240 + 2 * t),
    "widths": lambda k, t: (300 * k + 5 * t, 200 + 2 * t, 20, 40),
    "close": lambda k, t: (20 * k + t / 2, 10 * k + t, 120 + 20 * k + t, 100 + 20 * k + 2 * t),
    "deep": lambda k, t: (50 + 100 * k, 50 + 60 * k + 2 * t, 80 + 90 * k, 160 + 60 * k + 2 * t),
    "alone": lambda k, t: (5 + 2 * t + 900 * (k > 0), 5 + 2 * t, 80 + 2 * t, 160 + 2 * t),
}


@pytest.mark.parametrize("kind", PLACED)
def test_corners_in_a_format_of_widths_are_told(invoke: Invoke, kind: str) -> None:
    rows = [(t, k, *PLACED[kind](k, t), 1) for t in range(1, 9) for k in range(4)]
    for name, by in (("gt.txt", 0), ("res.txt", 3)):
        moved = [
            (t, k, x + by, y, x2 + by * (kind == "corners"), *z) for t, k, x, y, x2, *z in rows
        ]
        Path(name).write_text("".join(",".join(map(str, row)) + "\n" for row in moved))
    metric = ("-c", "50", "-g", "10")
    told = invoke("gt.txt", "res.txt", *metric, "--estimate-format", "motchallenge").err
    names = "t,id,left,top,right,bottom"
    remedy = f"--estimate-columns {names} reads them so; leave --estimate-format out"
    assert (remedy in told) == (kind == "corners")
    if kind == "corners":
        answer = invoke("gt.txt", "res.txt", *metric, "--columns", names)
        assert value(answer) == pytest.approx((32 * 9) ** 0.5, rel=1e-5)


def test_x_and_y_beside_the_other_corner_are_in_doubt(invoke: Invoke) -> None:
    for name, by in (("gt.csv", 0), ("res.csv", 20)):
        rows = [(f, k, x, y, x + w + by, y + h + by) for f, k, x, y, w, h in boxes()]
        write(name, "frame,id,x,y,x2,y2", rows)
    metric = ("-c", "50", "-g", "10")
    corner = "left=x,top=y,right=x2,bottom=y2"
    doubtful = invoke("gt.csv", "res.csv", *metric)
    assert f"use --estimate-columns {corner} if they are the corner" in doubtful.err
    both = ("--truth-columns", corner, "--estimate-columns", corner)
    answer = invoke("gt.csv", "res.csv", *metric, *both)
    assert value(answer) == pytest.approx((12 * 200) ** 0.5, rel=1e-5)
    iou = ("gt.csv", "res.csv", "-c", "0.9", "-g", "0.1", "--distance", "iou")
    assert "map them with --truth-columns left=x,top=y\n" in invoke(*iou).err
    assert invoke(*iou, "--columns", "left=x,top=y").status == 0


def test_boxes_by_centre_and_size_or_by_two_corners(invoke: Invoke) -> None:
    write("gt.csv", "frame,id,left,top,width,height", boxes())
    centres = [(f, k, x + w / 2, y + h / 2, w, h) for f, k, x, y, w, h in boxes((3, 4))]
    corners = [(f, k, x, y, x + w, y + h) for f, k, x, y, w, h in boxes((3, 4))]
    for name, header, rows in (
        ("centre.csv", "frame,id,cx,cy,w,h", centres),
        ("named.csv", "frame,id,x,y,w,h", centres),
        ("corners.csv", "frame,id,x1,y1,x2,y2", corners),
        ("minmax.csv", "frame,id,bbox_x1,bbox_y1,bbox_x2,bbox_y2", corners),
    ):
        write(name, header, rows)
        options = ["--estimate-columns", "x=x,y=y,width=w,height=h"] if name == "named.csv" else []
        answer = invoke("gt.csv", name, "-c", "50", "-g", "10", *options)
        assert value(answer) == pytest.approx((12 * 25) ** 0.5, rel=1e-5), name
        overlap = 17 * 36 / (2 * 800 - 17 * 36)
        answer = invoke("gt.csv", name, "--distance", "iou", "-c", "1", "-g", "1", *options)
        assert value(answer) == pytest.approx((12 * (1 - overlap) ** 2) ** 0.5, rel=1e-5), name
    answer = invoke("gt.csv", "named.csv", "--distance", "iou")
    assert answer.status == 3
    assert "no column for left" in answer.err
    wrong = [(f, k, x2, y2, x1, y1) for f, k, x1, y1, x2, y2 in corners]
    write("wrong.csv", "frame,id,x1,y1,x2,y2", wrong)
    assert "-20 is not a width of a box" in invoke("gt.csv", "wrong.csv").err


def test_ids_of_tracks_and_centres_go_before_names_and_corners(invoke: Invoke) -> None:
    header = "frame_number,x1,y1,x2,y2,cx,cy,instance_name,tracking_id"
    for name, shift in (("gt.csv", (0, 0)), ("res.csv", (3, 4))):
        rows = [
            (f, x, y, x + w, y + h, x + w / 2, y + h / 2, "mouse", k if shift[0] == 0 else 3 - k)
            for f, k, x, y, w, h in boxes(shift)
        ]
        write(name, header, rows)
    answer = invoke("gt.csv", "res.csv", "-c", "20", "-g", "5")
    assert value(answer) == pytest.approx((12 * 25) ** 0.5, rel=1e-5)


def test_a_batch_says_what_evaluate_warns_of(invoke: Invoke) -> None:
    rows = [(1, t, 5 * t, 0) for t in range(40)]
    write("truth.csv", "id,t,x,y", rows)
    for tracker, shift in (("late", 1), ("same", 0)):
        Path(tracker).mkdir()
        for run in (1, 2):
            write(f"{tracker}/{run}.csv", "id,t,x,y", [(1, t + shift, x, y) for _, t, x, y in rows])
    patterns = ("--truth", "truth.csv", "--estimate", "{tracker}/{run}.csv")
    answer = invoke("batch", *patterns, "-c", "20", "-g", "1", "--by", "tracker", "-o", "done")
    text = " ".join(answer.out.split())
    assert (
        "warning: tracker=late run=1 and 1 more of 4 jobs: the clock of the estimate seems" in text
    )
    assert (
        "warning: tracker=same run=1 and 1 more of 4 jobs: the estimate has exactly the states"
        in text
    )
    page = Path("done/report.html").read_text(encoding="utf-8")
    assert (
        "<strong>Warning:</strong> <bdi>tracker=late run=1 and 1 more of 4 jobs: the clock" in page
    )
    with pytest.warns(TgospaWarning, match="tracker=late run=1 and 1 more"):
        done = batch(truth="truth.csv", estimate="{tracker}/{run}.csv", output="again", cutoff=20.0)
    assert sum("copies of one another" in one for one in done.warnings) == 2
    assert len(done.warnings) == 4


def test_labels_are_in_every_part_of_a_table(invoke: Invoke) -> None:
    write("truth.csv", "id,t,x,y", [(1, t, 5 * t, 0) for t in range(8)])
    for k in range(6):
        write(f"{k}.csv", "id,t,x,y", [(1, t, 5 * t + 1, k / 10) for t in range(8)])
    jobs = [
        ("B", k, "truth.csv", f"{k}.csv", c, g) for k in range(6) for c in (5, 9) for g in (1, 2)
    ]
    write("jobs.csv", "filter,run,truth,estimate,cutoff,switch_penalty", jobs)
    answer = invoke("batch", "jobs.csv", "--by", "filter", "-o", "done")
    heads = [line.split() for line in answer.out.splitlines() if line.startswith("  filter")]
    assert len(heads) == 4
    assert all(head[:3] == ["filter", "cutoff", "switch_penalty"] for head in heads)


def test_a_proof_that_is_removed_is_told(invoke: Invoke) -> None:
    write("truth.csv", "id,t,x,y", [(1, t, 5 * t, 0) for t in range(8)])
    write("estimate.csv", "id,t,x,y", [(1, t, 5 * t + 1, 0) for t in range(8)])
    command = ("truth.csv", "estimate.csv", "-c", "9", "-g", "1", "-q", "-o", "done")
    command += ("--pictures", "none")
    assert invoke(*command, "--proof").err == ""
    assert "done/proof of an earlier run is removed" in invoke(*command).err
    assert invoke(*command).err == ""


def test_data_in_parts_have_the_same_places(invoke: Invoke) -> None:
    """Placeholders are refused and mapped boxes taken; heights of both sides are compared."""
    for side, shift in (("gt", 0), ("est", 3)):
        Path(side).mkdir()
        rows = [
            f"{t},{k},{100 * k + t + shift},{50 * k},40,80,-1,-1,-1"
            for t in range(9)
            for k in (1, 2)
        ]
        header = "frame,id,bb_left,bb_top,bb_width,bb_height,x,y,z"
        Path(side, "1.csv").write_text("\n".join((header, *rows, "")))
    parts = ("gt", "est", "-c", "50", "-g", "10", "--memory", "1GB")
    answer = invoke(*parts)
    assert (answer.status, "x, y, z: the same in all rows" in answer.err) == (3, True)
    boxes = "left=bb_left,top=bb_top,width=bb_width,height=bb_height"
    answer = invoke(*parts, "--columns", boxes)
    assert float(answer.out.split()[2].rstrip(",")) ** 2 == pytest.approx(18 * 9, rel=1e-4)
    for side, height in (("gt", 100), ("est", 130)):
        rows = [f"{t},1,55,12,{height}" for t in range(9)]
        Path(side, "1.csv").write_text("\n".join(("frame,id,lat,lon,alt", *rows, "")))
    answer = invoke(*parts, "--distance", "geodesic")
    assert float(answer.out.split()[2].rstrip(",")) == pytest.approx(90, rel=1e-4)
    assert "heights are compared (alt)" in answer.err
    answer = invoke(*parts, "--distance", "haversine")
    assert (answer.status, "both files have heights" in answer.err) == (2, True)
