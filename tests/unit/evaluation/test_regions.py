"""Regions in which nothing is judged: shapes, steps, shares of boxes, files and what is wrong."""

import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Invoke, Write
from hypothesis import given
from hypothesis import strategies as st

from tgospa_eval import ConfigError, InputError, evaluate
from tgospa_eval.evaluation.regions import as_regions, inside
from tgospa_eval.formats import ReadOptions
from tgospa_eval.formats.frames import from_frame

BOX = ("left", "top", "width", "height")
PLACES = ("5,5", "15,5", "5,15", "25,25", "0,0")


def points(*places: str, columns: str = "x,y") -> pd.DataFrame:
    """An object at each place, there at steps 0 and 1."""
    rows = [f"{k},{t},{place}" for k, place in enumerate(places) for t in (0, 1)]
    return pd.read_csv(io.StringIO("\n".join([f"id,t,{columns}", *rows])))


def held(regions: Any, frame: pd.DataFrame, tolerance: float = 0.0) -> list[list[int]]:
    """Ids that are inside at each of two steps."""
    side = from_frame(frame, ReadOptions(boxes="width" in frame), name="e").trajectories
    found = as_regions(regions)
    assert found is not None
    mask = inside(found, side, tolerance, "e")
    return [
        [int(side.ids[track]) for track in side.track[mask & (side.step == step)]]
        for step in (0, 1)
    ]


@pytest.mark.parametrize(
    ("text", "first", "second"),
    [
        ("left,top,width,height\n0,0,15,10\n", [0, 1, 4], [0, 1, 4]),  # edges belong to it
        ("t,left,top,width,height\n1,0,0,15,10\n,20,20,9,9\n", [3], [0, 1, 3, 4]),
        ("frame;x;y;radius\n0;5;5;10\n", [0, 1, 2, 4], []),
        ("polygon\n-1 -1; 6 -1; 6 16; -1 16\n", [0, 2, 4], [0, 2, 4]),
        ("polygon\n-1 -1; 9 -1; -1 9; -1 -1\n", [4], [4]),  # the first corner again
        ('t,polygon,x,y,radius\n,"24 24; 26 24; 25 27",,,\n1,,5,5,1\n', [3], [0, 3]),
        ("t\tleft\ttop\twidth\theight\n7\t0\t0\t9\t9\n", [], []),  # no such step
    ],
)
def test_points_in_regions(write: Write, text: str, first: list[int], second: list[int]) -> None:
    assert held(write("r.csv", text), points(*PLACES)) == [first, second]


def test_regions_of_python_and_geojson() -> None:
    square = [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]
    hole = [[4, 4], [6, 4], [6, 6], [4, 6], [4, 4]]
    table = pd.DataFrame({"t": [None, 1], "polygon": [square, "14 4; 16 4; 16 6; 14 6"]})
    assert held(table, points(*PLACES)) == [[0, 4], [0, 1, 4]]
    table = pd.DataFrame({"x": [5.0, np.nan], "y": [5, np.nan], "radius": [1, np.nan],
                          "left": [np.nan, 24], "top": [np.nan, 24], "width": [np.nan, 2],
                          "height": [np.nan, 2], "t": [1.0, np.nan]})  # fmt: skip
    assert held(table, points(*PLACES)) == [[3], [0, 3]]
    polygon = {"type": "Polygon", "coordinates": [square, hole]}
    assert held(polygon, points(*PLACES)) == [[4], [4]]
    several = {"type": "MultiPolygon", "coordinates": [[square], [[[14, 4], [16, 4], [15, 9]]]]}
    feature = {"type": "Feature", "geometry": several, "properties": {"t": 1, "name": "port"}}
    document = {"type": "FeatureCollection", "features": [feature]}
    assert held(document, points(*PLACES)) == [[], [0, 1, 4]]
    assert held({**feature, "properties": None}, points(*PLACES)) == [[0, 1, 4], [0, 1, 4]]


def test_regions_of_the_earth(write: Write) -> None:
    """A circle in metres; GeoJSON has lon, lat, the table lat lon; longitudes turn around."""
    ships = points("60,25", "60.001,25", "60.002,25", "-60,25", "60,385", columns="lat,lon")
    assert held(write("r.csv", "lat,lon,radius\n60,25,112\n"), ships)[0] == [0, 1, 4]
    ring = [[24.9, 59.9], [25.1, 59.9], [25.1, 60.0005], [24.9, 60.0005]]
    assert held({"type": "Polygon", "coordinates": [ring]}, ships)[0] == [0, 4]
    text = "; ".join(f"{lat} {lon}" for lon, lat in ring)
    assert held(write("p.csv", f"polygon\n{text}\n"), ships)[0] == [0, 4]
    wrong = [[25, 95], [26, 95], [26, 96]]
    with pytest.raises(InputError, match=r"line 2: a position is out of range; write lat lon"):
        held(write("w.csv", "lat,lon,radius\n99,25,1\n"), ships)
    with pytest.raises(InputError, match=r"feature 0: a position is out of range; write lon, lat"):
        held({"type": "Polygon", "coordinates": [wrong]}, ships)


def test_boxes_by_the_share_of_their_area(write: Write) -> None:
    """At least half, of all regions of a step together: 0 has 0.5, 1 has 0.49, 2 has 0.4 + 0.4."""
    boxes = points("0,0,10,10", "20,0,100,10", "200,0,10,10", "0,50,10,10", columns=",".join(BOX))
    text = "t,left,top,width,height\n,-9,-9,14,99\n,20,0,49,10\n,200,0,4,10\n0,206,0,4,10\n"
    assert held(write("r.csv", text), boxes) == [[0, 2, 3], [0, 3]]
    twice = "left,top,width,height\n200,0,4,10\n199,0,5,10\n"  # the same part
    assert held(write("r.csv", twice), boxes) == [[], []]
    corners = "polygon\n-1 -1; 11 -1; 11 5; -1 5\n199 -1; 204 -1; 204 11; 199 11\n"
    assert held(write("r.csv", corners), boxes)[0] == [0]
    mixed = "polygon,left,top,width,height\n199 -1; 204 -1; 204 11; 199 11,,,,\n,206,0,4,10\n"
    assert held(write("r.csv", mixed), boxes)[0] == [2]


@given(
    regions=st.lists(
        st.tuples(*[st.integers(-3, 9)] * 2, *[st.integers(1, 8)] * 2), min_size=1, max_size=5
    ),
    box=st.tuples(st.integers(0, 4), st.integers(0, 4), st.integers(1, 6), st.integers(1, 6)),
    polygons=st.booleans(),
)
def test_shares_are_those_of_pixels(
    regions: list[tuple[int, ...]], box: tuple[int, ...], polygons: bool
) -> None:
    image = np.zeros((24, 24), bool)
    for left, top, width, height in regions:
        image[top + 4 : top + height + 4, left + 4 : left + width + 4] = True
    left, top, width, height = box
    share = image[top + 4 : top + height + 4, left + 4 : left + width + 4].mean()
    table = pd.DataFrame(regions, columns=[*BOX])
    if polygons:
        corners = [[(a, b), (a + w, b), (a + w, b + h), (a, b + h)] for a, b, w, h in regions]
        table = pd.DataFrame({"polygon": corners})
    frame = points(",".join(map(str, box)), columns=",".join(BOX))
    assert held(table, frame)[0] == ([0] if share >= 0.5 else [])


def test_steps_are_joined_as_stamps_are(write: Write, invoke: Invoke) -> None:
    regions = write("r.csv", "t,x,y,radius\n0.04,5,5,1\n")
    assert held(regions, points(*PLACES)) == [[], []]
    assert held(regions, points(*PLACES), tolerance=0.05) == [[0], []]
    rows = "7,2024-01-01T00:00:00Z,0,0\n8,2024-01-01T00:00:00Z,50,50\n"
    truth = write("t.csv", "id,t,x,y\n1,2024-01-01T00:00:00.030Z,0,0\n")
    estimate = write("e.csv", f"id,t,x,y\n{rows}")
    regions = write("z.csv", "t,x,y,radius\n2024-01-01T01:00:00.010+01:00,50,50,1\n")
    asked = (truth, estimate, "-c", "5", "-g", "1", "--ignore-regions", regions)
    found = json.loads(invoke(*asked, "--time-tolerance", "50ms", "--format", "json").out)
    assert (found["counts"]["false"], found["ignored"]["excused"]) == (0, 1)
    answer = invoke(*asked)
    assert "z.csv: no state of the estimate is inside" in answer.err
    local = write("l.csv", "t,x,y,radius\n2024-01-01T00:00:00,50,50,1\n")
    answer = invoke(*asked[:-1], local)
    assert answer.status == 3
    assert "l.csv has ISO times without zone" in answer.err


def test_what_it_does_to_the_number(write: Write, invoke: Invoke, tmp_path: Path) -> None:
    """Recorded with its digest, in the digest of what is judged, and in the proof folder."""
    truth = write("t.csv", "id,t,x,y\n" + "".join(f"1,{t},{t},0\n" for t in range(4)))
    estimate = write(
        "e.csv", "id,t,x,y\n" + "".join(f"7,{t},{t},1\n8,{t},50,50\n" for t in range(4))
    )
    regions = write("r.csv", "t,left,top,width,height,x,y,radius\n,40,40,20,20,,,\n2,,,,,0,0,9\n")
    options = ("-c", "5", "-g", "1", "--ignore-regions", regions, "--format", "json")
    folder = str(tmp_path / "r")
    answer = invoke(truth, estimate, *options, "-o", folder, "--proof", "--pictures", "none")
    found = json.loads(answer.out)
    assert found["total"] == pytest.approx(4.0)  # the excused pair at step 2 is nearer than c/2
    assert found["ignored"] == {"truth_states": 0, "absorbed": 0, "excused": 5}
    plain = json.loads(invoke(truth, estimate, *options[:4], "--format", "json").out)
    assert plain["total"] == pytest.approx(4 + 4 * 12.5)
    assert found["judged"]["truth_sha256"] != plain["judged"]["truth_sha256"]
    result = evaluate(truth, estimate, cutoff=5, switch_penalty=1,
                      ignore_regions=pd.read_csv(regions))  # fmt: skip
    assert result.total == found["total"]
    assert result.parameters["ignore_regions"] == found["parameters"]["ignore_regions"]
    verdict = invoke("verify", folder, truth, estimate)
    assert verdict.status == 3
    assert "name your copy with --ignore-regions FILE" in verdict.err
    again = ("verify", folder, truth, estimate, "--ignore-regions", regions)
    verdict = invoke(*again)
    assert verdict.status == 0, verdict.err
    assert "--ignore-regions" in verdict.out
    Path(regions).write_text("left,top,width,height\n0,0,1,1\n", encoding="utf-8")
    assert invoke(*again).status == 1


@pytest.mark.parametrize(
    "text", ["left,top,width,height\n", '{"type": "FeatureCollection", "features": []}']
)
def test_no_regions(write: Write, invoke: Invoke, text: str) -> None:
    """A sequence without ignored regions has such a file; all is judged."""
    truth, estimate = write("t.csv", "id,t,x,y\n1,0,0,0\n"), write("e.csv", "id,t,x,y\n1,0,9,0\n")
    regions = write("r.csv", text)
    given = (truth, estimate, "-c", "5", "-g", "1")
    answer = invoke(*given, "--ignore-regions", regions)
    assert answer.status == 0
    assert "r.csv: no regions" in answer.err
    plain = json.loads(invoke(*given, "--format", "json").out)
    same = json.loads(invoke(*given, "--ignore-regions", regions, "--format", "json").out)
    assert same["tgospa"] == plain["tgospa"]
    refused = invoke(*given, "--region", regions)
    assert refused.status == 3
    assert "r.csv: has no region" in refused.err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("t,left,top,width,height\n0,0,0,0,4\n", "line 2: a width of 0, a region without area"),
        ("x,y,radius\n0,0,-1\n", "line 2: a radius of -1, a region without area"),
        ("left,top,width,height\n0,0,4,x\n", 'line 2, column "height": not a number: "x"'),
        ("left,top,width,height\n0,0,4,inf\n", "line 2: a number beyond 1e+150, or not a number"),
        ("polygon\n0 0; 1e200 0; 0 1\n", "line 2: a number beyond 1e+150, or not a number"),
        ("left,top,width,height\n0,0,4,\n", "line 2: has left, top, width; a region has left,"),
        ("left,top,width,height\n0,0,4\n", "line 2: 3 fields, the header has 4"),
        ("left,top,wide,height\n0,0,4,5\n", 'line 1: column "wide" is not a column of regions'),
        ("t,t\n0,0\n", "line 1: columns are missing or duplicate"),
        ("left\n", "line 1: columns are missing or duplicate"),
        ("t,x,y\n", "line 1: columns are missing or duplicate"),
        ("polygon\n0 0; 1 1; 1 0; 0 1\n", "line 2: edges of the polygon cross or overlap"),
        ("polygon\n0 0; 4 4; 8 8\n", "line 2: a polygon without area"),
        ("polygon\n0 0; 4 4\n", "line 2: a polygon without area"),
        ("polygon\n0 0; 4; 8 8\n", 'line 2, column "polygon": "0 0; 4; 8 8"; write'),
        ("polygon\n0 0; 4 a; 8 8\n", 'line 2, column "polygon": not a number: "a"'),
        ("t,x,y,radius\nnoon,0,0,1\n", 'line 2, column "t": not a time: "noon"'),
        ("lat,lon,radius\n1,2,3\n", "line 2: lat,lon,radius is not a region for state columns x,y"),
        ('{"type": "Point", "coordinates": [0, 1]}', 'feature 0: "Point" is neither a Polygon'),
        ('{"type": "Polygon", "coordinates": [[0, 1]]}', "feature 0: the coordinates of a Polygon"),
        ('{"type": "Polygon", "coordinates": [[["0", 1]]]}', "feature 0: the coordinates of a"),
        ('{"type": "Polygon"\n"a": 1}', "line 2, column 1: not JSON"),
        ('{"a": ' + "[" * 100000, "not GeoJSON: nested too deeply"),
        ('{"type": "Feature", "properties": {"t": "x"}, "geometry": {"type": "Polygon", '
         '"coordinates": [[[0, 0], [1, 0], [0, 1]]]}}', 'feature 0, property "t": not a time'),
    ],
)  # fmt: skip
def test_wrong_regions(write: Write, invoke: Invoke, text: str, message: str) -> None:
    side = write("t.csv", "id,t,x,y\n1,0,0,0\n")
    answer = invoke(
        side, side, "-c", "5", "-g", "1", "--ignore-regions", write("r.csv", text), "-q"
    )
    assert answer.status == 3
    assert f"r.csv, {message}" in answer.err or f"r.csv: {message}" in answer.err
    assert answer.err.count("\n") == 1


def test_wrong_uses(write: Write, invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    boxes = write("b.csv", "id,t,left,top,width,height\n1,0,0,0,9,9\n")
    circle = write("r.csv", "x,y,radius\n0,0,1\n")
    answer = invoke(boxes, boxes, "--distance", "iou", "--ignore-regions", circle, "-q")
    assert (answer.status, "a circle holds points, and the states are boxes" in answer.err) == (
        3,
        1,
    )
    line = write("x.csv", "id,t,x\n1,0,0\n")
    answer = invoke(line, line, "-c", "1", "-g", "1", "--ignore-regions", circle, "-q")
    assert "regions need state columns x,y, lat,lon or left,top,width,height" in answer.err
    point = write("p.csv", "id,t,x,y\n1,0,0,0\n")
    asked = (point, point, "-c", "1", "-g", "1", "-q", "--ignore-regions")
    answer = invoke(*asked, circle, "--existence", "use")
    assert (answer.status, "--existence use cannot be combined with" in answer.err) == (2, True)
    assert invoke(*asked, "none.csv").status == 3
    with pytest.raises(ConfigError, match="ignore_regions is of the type int"):
        evaluate(point, point, ignore_regions=3)
    monkeypatch.setitem(sys.modules, "shapely", None)
    assert invoke(*asked, circle).status == 0
    answer = invoke(*asked, write("r.csv", "polygon\n0 0; 4 0; 0 4\n"))
    assert answer.status == 2
    assert 'pip install "tgospa-eval[regions]"' in answer.err


def test_each_job_of_a_batch_may_have_its_own(write: Write, invoke: Invoke, tmp_path: Path) -> None:
    for run, place in enumerate((50, 70)):
        (tmp_path / str(run)).mkdir()
        write(f"{run}/t.csv", "id,t,x,y\n1,0,0,0\n1,1,0,0\n")
        write(f"{run}/by-a.csv", f"id,t,x,y\n7,0,0,0\n7,1,0,0\n8,0,{place},0\n")
        write(f"{run}/r.csv", f"x,y,radius\n{place},0,{run + 1}\n")
    asked = ("batch", "--truth", str(tmp_path / "{run}/t.csv"), "--estimate",
             str(tmp_path / "{run}/by-{tracker}.csv"), "-c", "5", "-g", "1", "--by", "tracker",
             "--format", "json")  # fmt: skip
    regions = ("--ignore-regions", str(tmp_path / "{run}/r.csv"), "-o", str(tmp_path / "s"))
    answer = invoke(*asked, *regions)
    assert answer.status == 0, answer.err
    document = json.loads(answer.out)
    assert [job["total"] for job in document["jobs"]] == [0.0, 0.0]
    assert [group["jobs"] for group in document["groups"]] == [2]  # though their regions differ
    write("1/r.csv", "x,y,radius\n0,99,1\n")  # what is done is done again where a file changed
    document = json.loads(invoke(*asked, *regions).out)
    assert [job["total"] for job in document["jobs"]] == [0.0, 12.5]
    wrong = invoke(*asked, "--ignore-regions", "{sequence}.csv", "-o", str(tmp_path / "w"))
    assert wrong.status == 2
    assert 'jobs have no label "sequence"; their labels are run, tracker' in wrong.err
