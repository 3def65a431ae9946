"""Formats beside CSV, boxes, filters and classes, as users meet them."""

import json
import subprocess
import sys
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Run, Write

from tgospa_eval import ConfigError, InputError, read_trajectories
from tgospa_eval.formats import Reading, ReadOptions, read
from tgospa_eval.formats.roles import find_roles
from tgospa_eval.formats.text import lines

MOT = "1,7,10,20,4,6,1,-1,-1,-1\n2,7,12,20,4,6,0,-1,-1,-1\n2,8,50,50,10,10,0.5,-1,-1,-1\n"
KITTI = (
    "0 -1 DontCare -1 -1 -10 219.5 188.5 245.5 218.5 -1000 -1000 -1000 -10 -1 -1 -1\n"
    "0 1 Car 0 0 -1.8 100 50 140 80 2.0 1.8 4.4 -4.5 1.5 13.5 -2.1\n"
    "1 2 Cyclist 0 0 -1.9 200 60 220 100 1.7 0.8 1.8 1.5 1.5 5.5 -1.7\n"
)


def states(reading: Reading) -> dict[tuple[str, Any], tuple[float, ...]]:
    side = reading.trajectories
    return {
        (side.ids[k], side.times[t].item()): tuple(state)
        for t, k, state in zip(side.step, side.track, side.state.tolist(), strict=True)
    }


# --- MOTChallenge ---------------------------------------------------------------------------------


def test_motchallenge_means_other_things_in_truth_and_results(write: Write) -> None:
    path = write("gt.txt", MOT)
    truth, results = read(path, role="truth"), read(path, role="estimate")
    assert truth.format == results.format == "motchallenge"
    assert "motchallenge" in truth.notices[0]  # guessed, so said
    assert states(truth) == {("7", 1): (12, 23), ("8", 2): (55, 55)}  # left + width / 2
    assert truth.left_out == {"not considered": 1}
    assert states(results) == {("7", 1): (12, 23), ("7", 2): (14, 23), ("8", 2): (55, 55)}
    assert results.left_out == {}
    boxes = read(path, ReadOptions(boxes=True))
    assert boxes.trajectories.columns == ("left", "top", "width", "height")
    assert states(boxes)["7", 1] == (10, 20, 4, 6)


@pytest.mark.parametrize(
    "line",
    [
        "1,7,10,20,4,6",
        "1, 7, 10, 20, 4, 6, -1",
        "1,7,10,20,4,6,1,3,0.5",
        "1.0,7.000e+00,10,20,4,6,-1,-1,-1,-1",  # numpy.savetxt
        "1 7 10 20 4 6 -1 -1 -1 -1",
        "\ufeff1,7,10,20,4,6,1\r",
    ],
)
def test_motchallenge_spellings(write: Write, line: str) -> None:
    path = write("a.txt", f"{line}\n\n".encode())
    assert states(read(path)) == {("7", 1): (12, 23)}


def test_a_format_that_is_named_may_be_empty(write: Write) -> None:
    for name in ("motchallenge", "kitti"):
        reading = read(write("a.txt", ""), role="estimate", format=name)
        assert reading.rows == 0
        assert reading.trajectories.columns == ("x", "y")
    with pytest.raises(InputError, match="empty"):
        read(write("a.txt", ""))


# --- KITTI ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "warned"),
    [
        (("--unit", "m"), True),
        (("--unit", "px"), False),
        ((), False),
        (("--unit", "m", "--columns", "x,y,z"), False),
        (("--unit", "m", "--distance", "iou"), True),
        (("--distance", "iou"), False),
    ],
)
def test_pixels_are_no_metres(
    invoke: Run, write: Write, options: tuple[str, ...], warned: bool
) -> None:
    path = write("0000.txt", KITTI)
    done = invoke(path, path, "-c", "1", "-g", "1", *options, "--format", "json")
    assert done.status == 0
    codes = [warning["code"] for warning in json.loads(done.out)["warnings"]]
    assert codes.count("unit-label") == warned
    seen = json.loads(invoke("inspect", path, *options, "--format", "json").out)
    assert [warning["code"] for warning in seen["warnings"]].count("unit-label") == warned


def test_kitti(write: Write) -> None:
    path = write("0000.txt", KITTI)
    reading = read(path)
    assert reading.format == "kitti"
    assert reading.left_out == {"DontCare": 1}
    assert states(reading) == {("1", 0): (120, 65), ("2", 1): (210, 80)}
    place = {("1", 0): (-4.5, 1.5, 13.5), ("2", 1): (1.5, 1.5, 5.5)}
    assert states(read(path, ReadOptions(columns=("x", "y", "z")))) == place
    assert states(read(path, ReadOptions(columns=("loc_x", "loc_y", "loc_z")))) == place
    assert states(read(path, ReadOptions(boxes=True)))["1", 0] == (100, 50, 40, 30)
    scored = "".join(f"{line} 0.9\n" for line in KITTI.splitlines())
    assert states(read(write("b.txt", scored))) == states(reading)


# --- boxes in tables ------------------------------------------------------------------------------


def test_boxes_in_csv(write: Write) -> None:
    path = write("a.csv", "id,t,left,top,width,height\na,1,10,20,4,6\n")
    reading = read(path)
    assert states(reading) == {("a", 1): (12, 23)}
    assert any("centres" in notice for notice in reading.notices)
    with_point = write("b.csv", "id,t,x,y,left,top,width,height\na,1,0,0,10,20,4,6\n")
    assert states(read(with_point)) == {("a", 1): (0, 0)}
    assert states(read(with_point, ReadOptions(boxes=True))) == {("a", 1): (10, 20, 4, 6)}
    mapped = write("c.csv", "id,t,l,u,w,h\na,1,10,20,4,6\n")
    columns = ("left=l", "top=u", "width=w", "height=h")
    assert states(read(mapped, ReadOptions(columns=columns))) == {("a", 1): (12, 23)}
    assert states(read(mapped, ReadOptions(columns=columns, boxes=True)))["a", 1][2:] == (4, 6)
    raw = ReadOptions(columns=("left", "width"))  # named: part of the state
    assert states(read(path, raw)) == {("a", 1): (10, 4)}


def test_of_boxes_the_overlap_is_proposed_before_a_cutoff(invoke: Run, write: Write) -> None:
    first = "--distance iou compares the boxes themselves; or choose with -c"
    box = "id,t,left,top,width,height\na,1,1,1,4,6\n"
    for path in (write("a.txt", MOT), write("b.csv", box)):
        assert first in invoke(path, path).err
        for chosen in (("-c", "20"), ("--distance", "iou"), ("--columns", "left,top")):
            assert first not in invoke(path, path, *chosen).err
    points = write("c.csv", "id,t,x,y\na,1,1,1\n")
    assert "overlap" not in invoke(points, points).err
    assert first not in invoke(points, points).err


def test_boxes_without_size(write: Write) -> None:
    path = write("a.csv", "id,t,left,top,width,height\na,1,1,1,4,6\na,2,1,1,0,6\n")
    with pytest.raises(InputError, match=r'a.csv, line 3, column "width": 0 .*> 0'):
        read(path, ReadOptions(boxes=True))
    assert len(states(read(path))) == 2


def test_invalid_rows_are_left_out_if_that_is_asked(write: Write, tmp_path: Path) -> None:
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    table = "id,t,left,top,width,height\na,1,1,1,4,6\nb,1,1,1,-3,6\na,2,1,1,4,6\nb,2,1,1,-4,6\n"
    csv = write("a.csv", table)
    pd.read_csv(csv).to_parquet(tmp_path / "a.parquet")
    mot = "1,1,1,1,4,6\n1,2,1,1,-3,6\n2,1,1,1,4,6\n2,2,1,1,-4,6\n"
    kitti = "".join(
        f"{t} {k} Car 0 0 -1.8 9 5 {right} 11 2.0 1.8 4.4 -4.5 1.5 13.5 -2.1\n"
        for t, k, right in ((1, 1, 13), (1, 2, 6), (2, 1, 13), (2, 2, 5))
    )
    for path, where in (
        (csv, "line 3"),
        (str(tmp_path / "a.parquet"), "row 1"),
        (write("mot.txt", mot), "line 2"),
        (write("kitti.txt", kitti), "line 2"),
    ):
        what = f'{where}, column "width": -3 is not a width of a box (and 1 more); it must be >= 0'
        with pytest.raises(InputError) as caught:
            read(path)
        assert str(caught.value) == f'{path}, {what}; to leave such rows out, use on_invalid="drop"'
        reading = read(path, ReadOptions(on_invalid="drop"))
        assert (reading.rows, reading.taken, reading.left_out) == (4, 2, {"invalid": 2})
        assert f'2 rows left out by on_invalid="drop": {what}' in reading.notices
        with pytest.raises(InputError, match=r'to leave such rows out, use on_invalid="drop"$'):
            read_trajectories(path)
        side = read_trajectories(path, on_invalid="drop")
        assert len(side.ids) == 1
        assert side.times.tolist() == [1, 2]  # steps of the file stay steps


def test_kinds_of_invalid_rows(write: Write, invoke: Run) -> None:
    rows = (
        "a,1,1,1,4,6\nb,1,1,1,0,6\nc,1,1,1,4,-6\nd,1,1e308,1,1.7e308,6\ne,1,,1,-4,6\nf,9,1,1,-4,6\n"
    )
    path = write("a.csv", "id,t,left,top,width,height\n" + rows)
    drop = ReadOptions(on_invalid="drop", time=":5")
    # What takes no part anyway is counted there.
    assert read(path, drop).left_out == {"blank": 1, "time": 1, "invalid": 2}
    assert read(path, replace(drop, boxes=True)).left_out == {"blank": 1, "time": 1, "invalid": 2}
    assert list(read(path, drop).trajectories.ids) == ["a", "b"]
    assert list(read(path, replace(drop, boxes=True)).trajectories.ids) == ["a", "d"]
    # Out of the range of a distance, in two columns.
    places = write("p.csv", "id,t,lat,lon\na,1,50,8\nb,1,95,8\nc,1,50,400\nd,1,-91,8\ne,1,,8\n")
    answer = invoke(places, places, "--distance", "haversine")
    assert answer.status == 3
    message = 'p.csv, line 3, column "lat": 95 (and 1 more) must be from -90 to 90 degrees'
    assert f"{message}; to leave such rows out, use --on-invalid drop" in answer.err
    options = ("--distance", "haversine", "--on-invalid", "drop", "--format", "json")
    answer = invoke(places, places, *options)
    document = json.loads(answer.out)
    assert document["input"]["truth"]["left_out"] == {"blank": 1, "invalid": 3}
    assert document["parameters"]["on_invalid"] == "drop"
    assert document["sizes"]["truth"] == 1
    assert "2 rows left out by --on-invalid drop: line 3" in answer.err
    # Particles of a cloud belong together.
    cloud = write("c.csv", "id,t,left,top,width,height,weight\na,1,1,1,4,6,.5\na,1,1,1,-4,6,.5\n")
    with pytest.raises(InputError, match=r'line 3, column "width": -4 .*; it must be >= 0$'):
        read(cloud, drop)
    # A file that is damaged stays an error, and so does a number that is infinite.
    for row, what in (("a,2,1,1,oops,6", "not a number"), ("a,2,1,1,inf,6", "infinite")):
        with pytest.raises(InputError, match=what):
            read(write("b.csv", f"id,t,left,top,width,height\n{row}\n"), drop)
    with pytest.raises(ConfigError, match="on_invalid"):
        ReadOptions(on_invalid="keep")


def test_invalid_rows_in_every_verb(write: Write, invoke: Run, tmp_path: Path) -> None:
    head = "id,t,left,top,width,height\n"
    for run in "12":
        write(f"t{run}.csv", f"{head}a,1,1,1,4,6\na,2,1,1,4,6\n")
        write(f"e{run}.csv", f"{head}a,1,1,1,4,6\na,2,1,1,4,6\nb,1,9,9,-4,6\n")
    asked = ("-c", "10", "-g", "5", "--on-invalid", "drop", "--format", "json", "-q")
    patterns = ("--truth", "t{run}.csv", "--estimate", "e{run}.csv", "-o", "r", "--workers", "1")
    groups = json.loads(invoke("batch", *patterns, *asked).out)["groups"]
    assert [(group["jobs"], group["total"]) for group in groups] == [(1, 0), (1, 0)]
    pair = ("t1.csv", "e1.csv")
    found = json.loads(invoke("compare", *pair, "e2.csv", *asked).out)["estimates"]
    assert [entry["total"] for entry in found] == [0, 0]
    assert invoke("gate", *pair, "--max", "total=0", *asked).status == 0
    assert invoke("gate", *pair, "--max", "total=0", "-c", "10", "-g", "5").status == 3
    assert invoke("explain", *pair, *asked).status == 0
    seen = json.loads(invoke("inspect", *pair, *asked[4:-1]).out)
    assert seen["estimate"]["left_out"] == {"invalid": 1}
    # In parts, and with a proof.
    assert invoke(*pair, *asked, "-o", "whole", "--proof", "--pictures", "none").status == 0
    proof = json.loads((tmp_path / "whole/proof/proof.json").read_text())
    assert proof["options"]["on_invalid"] == "drop"
    assert invoke("verify", "whole", *pair).status == 0
    for side, name in (("gt", "t1.csv"), ("out", "e1.csv")):
        (tmp_path / side).mkdir()
        (tmp_path / name).rename(tmp_path / side / "part.csv")
    answer = invoke("gt", "out", *asked[:-1], "-o", "parts", "--memory", "1GB")
    document = json.loads(answer.out)
    assert (document["total"], document["input"]["estimate"]["left_out"]) == (0, {"invalid": 1})
    assert "1 row left out by --on-invalid drop" in answer.err


# --- refused --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "format_", "parts"),
    [
        ("1,1,2,3,4,5,1\n1,2,2,oops,4,5,1\n", None, [', line 2, column "top": ', '"oops"']),
        ("1,1,2,3,4,5,1\n1,2,2,3,4\n", None, [", line 2: 5 fields, line 1 has 7"]),
        ("1,1,2,3\n", "motchallenge", [", line 1: 4 fields", "6 to 10"]),
        ("1,1,2,3,4,5,yes\n", "motchallenge", [', line 1, column "conf": ', '"yes"']),
        ("1,1,2,3,4,inf,1\n", "motchallenge", [', line 1, column "height": infinite']),
        ("x,1,2,3,4,5,1\n", "motchallenge", [', line 1, column "frame": not a time: "x"']),
        ("0 1 Car 0\n", "kitti", [", line 1: 4 fields", "17, or 18"]),
        (KITTI.replace("140", "oops"), None, [', line 2, column "right": ', '"oops"']),
        (MOT + "1,7,1,1,1,1,1,-1,-1,-1\n", None, [", line 4: ", "line 1", "on_duplicate"]),
        ("1,-1,2,3,4,5,0.3\n1,-1,2,3,4,5,1\n", None, [", line 1: ", "-1", "detections"]),
        (
            "1,1,2,3,4,5\n",
            "csv",
            [
                ", line 1: the numbers 1, 1, 2, 3, 4, 5",
                "columns in the order of the file",
                "truth_format",
            ],
        ),
        (b"\x00\x01", "motchallenge", ["binary"]),
        (b"PAR1 and no more", None, ["not a readable Parquet file"]),
        (b"", "parquet", ["empty"]),
    ],
)
def test_refused(write: Write, content: str | bytes, format_: str | None, parts: list[str]) -> None:
    path = write("a.txt", content)
    if "Parquet" in parts[0] or format_ == "parquet":
        pytest.importorskip("pyarrow")
    with pytest.raises(InputError) as caught:
        read(path, format=format_)
    (message,) = str(caught.value).split("\n")
    assert message.startswith(path)
    for part in parts:
        assert part in message


# --- Parquet --------------------------------------------------------------------------------------


@pytest.mark.parametrize("field", ['"{}"', "{}"], ids=["quoted", "plain"])
def test_a_header_too_long_for_a_field(write: Write, field: str) -> None:
    path = write("t.csv", f"id,t,x,{field.format('y' * 200_000)}\n1,0,0,0\n")
    with pytest.raises(InputError, match=r"t\.csv, line 1: field larger .* must be the header"):
        read(path)


class Counting(str):
    """A header that counts how often it is compared."""

    count = 0
    __hash__ = str.__hash__

    def __eq__(self, other: object) -> bool:
        Counting.count += 1
        return str(self) == str(other)

    def strip(self, *_: Any) -> "Counting":
        return self

    def casefold(self) -> "Counting":
        return self


def test_many_columns_are_looked_at_once_each() -> None:
    header = [Counting(name) for name in ("id", "t", "x", "y", *(f"c{k}" for k in range(2000)))]
    roles = find_roles(header, ReadOptions(), "t.csv")
    assert (roles.id, roles.time, len(roles.unused)) == (0, 1, 2000)
    assert Counting.count < 10 * len(header)  # not of each with each


def test_parquet_is_read_like_csv(write: Write, tmp_path: Path, quickstart: Any) -> None:
    pytest.importorskip("pyarrow")
    import pandas as pd

    path = str(tmp_path / "truth.parquet")
    frame = pd.read_csv(quickstart[0]).assign(note="unused")
    frame.to_parquet(path)
    reading = read(path)
    assert reading.format == "parquet"
    assert "columns not used: note" in reading.notices
    assert states(reading) == states(read(quickstart[0]))
    frame.rename(columns={"t": "timestamp"}).assign(frame=0).to_parquet(path)
    reading = read(path)
    assert 't is read from "timestamp", not from "frame"' in reading.notices[1]
    assert states(reading) == states(read(quickstart[0]))
    frame.loc[3, "x"] = np.inf
    frame.to_parquet(path)
    with pytest.raises(InputError, match=r'truth.parquet, row 3, column "x": infinite'):
        read(path)
    frame.assign(x="no").to_parquet(path)
    with pytest.raises(InputError, match=r'truth.parquet, row 0, column "x": not a number: "no"'):
        read(path)


def parquet(path: Path, **columns: Any) -> Path:
    """A Parquet file of two rows, with some columns in place of plain ones."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    plain = {"id": ["a", "b"], "t": [0, 1], "x": [1.0, 2.0], "class": ["car", "van"]}
    pq.write_table(pa.table(plain | columns), path)
    return path


def test_integers_in_parquet_are_texts_without_a_point(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    large = 2**53 + 1
    for column, names in (
        (pa.array([large, None], pa.int64()), ("", str(large))),
        (pa.array([7, 8], pa.int64()), ("7", "8")),
        (pa.array([7.0, None]), ("", "7")),
        (pa.array(["7", "01"]), ("01", "7")),
        (pa.array([7, None]).dictionary_encode(), ("", "7")),
    ):
        path = parquet(tmp_path / "a.parquet", **{"class": column})
        assert read(path, ReadOptions(by_class=True)).classes == names
        if not column.null_count:
            assert tuple(read(parquet(path, id=column)).trajectories.ids) == names


@pytest.mark.parametrize("header", ["id", "t", "x", "class"])
def test_values_that_are_no_field_of_a_table(tmp_path: Path, header: str) -> None:
    pa, pd = pytest.importorskip("pyarrow"), pytest.importorskip("pandas")
    from tgospa_eval.formats.frames import from_frame

    for values, type_ in (
        ([[1, 2], [3]], pa.list_(pa.int64())),
        ([[1, 2], [3, 4]], pa.list_(pa.int64(), 2)),
        ([{"a": 1}, {"a": 2}], pa.struct([("a", pa.int64())])),
        ([[("a", 1)], [("b,", 2)]], pa.map_(pa.string(), pa.int64())),
        ([b"1", b"2"], pa.binary()),
    ):
        path = parquet(tmp_path / "a.parquet", **{header: pa.array(values, type_)})
        with pytest.raises(InputError) as caught:
            read(path, ReadOptions(by_class=True))
        message = str(caught.value)
        assert f'{path}, column "{header}": {str(type_)[:4]}' in message
        assert "decimal=" not in message
        plain = {"id": ["a", "b"], "t": [0, 1], "x": [1.0, 2.0], "class": ["car", "van"]}
        frame = pd.DataFrame(plain | {header: pd.Series(values, dtype=object)})
        kind = type(values[0]).__name__
        with pytest.raises(InputError, match=rf'table, row 0, column "{header}": .*type {kind}'):
            from_frame(frame, ReadOptions(by_class=True))


@pytest.mark.parametrize("header", ["id", "t", "class"])
def test_times_beyond_what_can_be_written_out(tmp_path: Path, header: str) -> None:
    pa, pd = pytest.importorskip("pyarrow"), pytest.importorskip("pandas")
    from tgospa_eval.formats.frames import from_frame

    year_10000 = 253_402_300_800
    microseconds = year_10000 * 10**6
    for column in (
        pa.array([0, microseconds], pa.timestamp("us", "Europe/Berlin")),
        pa.array([0, microseconds - 1], pa.timestamp("us", "Europe/Berlin")),  # the same there
        pa.array([0, year_10000], pa.timestamp("s", "UTC")),
        pa.array([0, -year_10000], pa.timestamp("s", "UTC")).dictionary_encode(),
        pa.array([0, 2**63 - 1], pa.timestamp("ns", "+05:00")),
        pa.array([0, year_10000 // 86_400], pa.date32()),
        pa.array([0, -year_10000 * 1000], pa.date64()).dictionary_encode(),
    ):
        path = parquet(tmp_path / "a.parquet", **{header: column})
        with pytest.raises(InputError) as caught:
            read(path, ReadOptions(by_class=True))
        assert str(caught.value).startswith(f'{path}, row 1, column "{header}": a ')
        assert "out of range" in str(caught.value)
    moments = pd.Series([0, year_10000], dtype="datetime64[s]").dt.tz_localize("UTC")
    moments = moments.dt.tz_convert("Europe/Berlin")
    frame = pd.DataFrame({"id": ["a", "b"], "t": [0, 1], "x": [1.0, 2.0], "class": ["a", "b"]})
    with pytest.raises(InputError, match=f'table, row 1, column "{header}": a timestamp out of'):
        from_frame(frame.assign(**{header: moments}), ReadOptions(by_class=True))


def test_decimals_of_any_size_are_ids(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    values = [Decimal(10) ** 60, Decimal("2.50")]
    path = parquet(tmp_path / "a.parquet", id=pa.array(values, pa.decimal256(76, 2)))
    assert set(read(path).trajectories.ids) == {"1" + "0" * 60, "2.50"}


@pytest.mark.parametrize("header", ["t", "x"])
def test_texts_are_numbers_by_one_rule(tmp_path: Path, write: Write, header: str) -> None:
    for text, decimal, right in (
        ("1_0", ".", False),
        ("\u0661", ".", False),
        ("0x1", ".", False),
        ("1,5", ".", False),
        (" 1.5e0", ".", True),
        ("1,5", ",", True),
        ("1.5", ",", False),
    ):
        path = parquet(tmp_path / "a.parquet", **{header: [text, text]})
        row = {"id": "a", "t": "0", "x": "1", header: text}
        other = f"b;0;1{decimal}5"  # else the numbers of a table may tell of another mark
        table = write("a.csv", f"{';'.join(row)}\n{';'.join(row.values())}\n{other}\n")
        found = []
        for name in (path, Path(table)):
            try:
                read(name, ReadOptions(decimal=decimal))
                found.append("")
            except InputError as error:
                found.append(str(error).split('"')[2].split(" (and")[0])
        assert found[0] == found[1], text
        assert (not found[0]) == right, text


def test_times_beyond_nanoseconds_and_damaged_texts(tmp_path: Path, write: Write) -> None:
    pa = pytest.importorskip("pyarrow")
    path = parquet(tmp_path / "a.parquet", t=pa.array([10**11, 2], pa.timestamp("s")))
    with pytest.raises(InputError, match='row 0, column "t": a time beyond 64-bit nanoseconds'):
        read(path)
    with pytest.raises(InputError, match='line 2, column "t": a time beyond 64-bit nanoseconds'):
        read(write("a.csv", "id,t,x\na,5138-11-16T09:46:40,1\n"))
    raw = pa.array([b"\x8b", b"b"])
    wrong = pa.StringArray.from_buffers(2, *raw.buffers()[1:])
    with pytest.raises(InputError, match="not a readable Parquet file: ") as caught:
        read(parquet(path, id=wrong))
    assert "codec" not in str(caught.value)


def test_parquet_without_the_extra(write: Write, environment: dict[str, str]) -> None:
    code = (
        "import sys; sys.modules['pyarrow'] = None\n"
        f"from tgospa_eval.cli import main; main([{write('a.parquet', b'PAR1')!r}] * 2)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 2
    assert f'{sys.executable} -m pip install "tgospa-eval[parquet]"' in done.stderr
    assert "Traceback" not in done.stderr


# --- filters --------------------------------------------------------------------------------------

CLASSES = "id,t,x,class,v\na,1,0,car,1\na,2,1,car,2\nb,2,5,bus,3\nc,3,9,,\n"


@pytest.fixture(params=["compiled", "small", "large"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files are parsed in three ways, which must not show."""
    if request.param != "compiled":
        monkeypatch.setattr(lines, "scanner", None)
    if request.param == "large":
        monkeypatch.setattr(lines, "LARGE_BYTES", 0)


@pytest.mark.usefixtures("way")
@pytest.mark.parametrize(
    ("options", "kept", "left_out"),
    [
        ({"time": "2:"}, "abc", {"time": 1}),
        ({"time": ":1"}, "a", {"time": 3}),
        ({"time": "1.5:2.5"}, "ab", {"time": 2}),
        ({"classes": ("car", "bus")}, "ab", {"class": 1}),
        ({"classes": ("truck",)}, "", {"class": 4}),
        ({"region": "x=1:5"}, "ab", {"region": 2}),
        ({"region": "x=:5,v=2:"}, "ab", {"region": 2}),
        ({"time": ":2", "classes": ("car",), "region": "x=1:"}, "a", None),
    ],
)
def test_filters(
    write: Write, options: dict[str, Any], kept: str, left_out: dict[str, int] | None
) -> None:
    reading = read(write("a.csv", CLASSES), ReadOptions(**options))
    assert "".join(reading.trajectories.ids) == kept
    assert reading.left_out == (left_out or {"time": 1, "class": 1, "region": 1})
    for option, count in reading.left_out.items():
        assert any(f"{count} row" in n and f"by {option}" in n for n in reading.notices)


@pytest.mark.usefixtures("way")
@pytest.mark.parametrize(
    "names", [["01", "1", "1.0", "1e22", "1e+22"], ['"07"', "7", "car"], ["1", "nan", "True"]]
)
def test_names_of_classes_are_texts(write: Write, names: list[str]) -> None:
    rows = "".join(f"{k},{k},0,{name}\n" for k, name in enumerate(names))
    path = write("a.csv", f"id,t,x,class\n{rows}")
    reading = read(path, ReadOptions(by_class=True))
    bare = [name.strip('"') for name in names]
    assert sorted(reading.classes) == sorted(bare)
    assert reading.klass is not None
    assert [reading.classes[k] for k in reading.klass] == bare
    assert read(path, ReadOptions(classes=(bare[1],))).left_out == {"class": len(names) - 1}


@pytest.mark.usefixtures("way")
def test_a_row_without_its_last_text(write: Write) -> None:
    path = write("a.csv", "id,t,x,class\na,1,0,1\na,2,0\n")
    with pytest.raises(InputError, match="line 3: 3 fields, the header has 4"):
        read(path, ReadOptions(by_class=True))


@pytest.mark.usefixtures("way")
def test_ids_without_header_are_exact_integers(write: Write) -> None:
    ids = ["-9007199254740993", "-9007199254740992", "9007199254740993.0", "9007199254740992.0"]
    ids += ["3.000e+00", "0.99999999999999999999999", "+5", "-1", "007", "1e400", "1_0"]
    path = write("a.txt", "".join(f"1,{text},1,2,3,4,1\n" for text in ids))
    kept = ["3", "0.99999999999999999999999", "5", "-1", "007", "1e400", "1_0"]
    want = [*ids[:2], "9007199254740993", "9007199254740992", *kept]
    assert sorted(read(path).trajectories.ids) == sorted(want)


def test_ranges_of_time_are_exact_and_understand_iso(write: Write) -> None:
    stamps = [2**60 + k for k in range(4)]
    path = write("a.csv", "id,t,x\n" + "".join(f"a,{t},0\n" for t in stamps))
    kept = read(path, ReadOptions(time=f"{stamps[1]}:{stamps[2]}")).trajectories.times
    assert kept.tolist() == stamps[1:3]
    iso = write("b.csv", "id,t,x\n" + "".join(f"a,2024-01-01T10:0{k}:00,0\n" for k in range(4)))
    span = "2024-01-01T10:01:00:2024-01-01T10:02"
    assert len(read(iso, ReadOptions(time=span)).trajectories.times) == 2
    with pytest.raises(ConfigError, match="ISO times without zone"):
        read(iso, ReadOptions(time="1:2"))


@pytest.mark.parametrize(
    "options",
    [
        *({"time": text} for text in ("", ":", "5", "a:b", "3:1", "2024-01-01T10:30", "1:2:3")),
        *({"region": text} for text in ("", "x", "x=", "x=1", "x=:", "x=2:1", "x=1:2,x=1:2")),
        {"classes": ("",)},
    ],
    ids=str,
)
def test_filters_that_mean_nothing(options: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        ReadOptions(**options)


def test_filter_by_a_column_that_is_not_there(invoke: Run, write: Write) -> None:
    path = write("a.csv", "id,t,x\na,1,0\n")
    for arguments, parts in (
        (["--class", "car"], ["no column class", "--class"]),
        (["--by", "class"], ["no column class", "--by class"]),
        (["--region", "v=0:"], ['no column "v"', "--region"]),
    ):
        status, out, err = invoke(path, path, *arguments)
        assert (status, out) == (3, "")
        for part in (f"{path}, line 1: ", *parts):
            assert part in err


ODD = "TrackId,id,when,x,y\n7,99,0,0,1\n7,98,1,1,1\n"
STANDARD = "id,t,x,y\na,0,0,0\na,1,1,0\n"


def test_columns_per_file(invoke: Run, write: Write) -> None:
    truth, estimate = write("t.csv", STANDARD), write("e.csv", ODD)
    for options in (
        ["--columns", "id=TrackID,t=when"],
        ["--estimate-columns", "id=TrackId,t=when"],
        [
            "--columns",
            "x,y,id=nowhere",
            "--estimate-columns",
            "id=TrackId,t=when",
            "--truth-columns",
            "id=id",
        ],
        ["--estimate-columns", "id=TrackId,t=when,x,y"],
    ):
        done = invoke(truth, estimate, *options, "--format", "json")
        assert json.loads(done.out)["total"] == pytest.approx(2), done.err
        assert done.status == 0
    named = invoke(truth, estimate, "--columns", "t=when,id=TrackNr").err
    for path in (truth, estimate):
        assert f'{path}, line 1: no header "TrackNr" for id' in named
    assert "did you mean --estimate-columns t=when,id=TrackId?" in named
    said = invoke(truth, estimate, "--columns", "id=TrackID,t=when").err
    assert f'{truth}: id is read from column "id": there is no header as named by --columns' in said
    # A header that this file must have.
    done = invoke(truth, estimate, "--estimate-columns", "t=when", "--truth-columns", "id=TrackId")
    assert (done.status, len(done.err.splitlines())) == (3, 1)


def test_columns_of_one_sensor(invoke: Run, write: Write) -> None:
    files = write("a.csv", STANDARD), write("b.csv", ODD)
    assert "--b-columns t=when" in invoke("associate", *files, "-c", "5").err
    done = invoke("associate", *files, "-c", "5", "--b-columns", "id=TrackId,t=when")
    assert "2 associated, 0 of A and 0 of B unassociated, in 2 steps" in done.out


def test_faults_of_both_files_are_told(invoke: Run, write: Write) -> None:
    wrong = write("t.csv", "trk,clock,px,py\na,0,0,0\n"), write("e.csv", "id,t,x,y\na,0,0,o\n")
    done = invoke(*wrong)
    assert done.status == 3
    first, second = done.err.splitlines()
    assert first.endswith("map them with --truth-columns id=trk,t=clock,x=px,y=py")
    assert second.startswith(f'{wrong[1]}, line 2, column "y"')
    assert invoke("inspect", wrong[0]).err.endswith(
        "map them with --columns id=trk,t=clock,x=px,y=py\n"
    )


def test_what_is_left_out_is_recorded(invoke: Run, write: Write) -> None:
    path = write("a.csv", CLASSES)
    arguments = ["--class", "car,bus", "--region", "x=1:", "--time", "2:", "--format", "json"]
    document = json.loads(invoke(path, path, *arguments).out)
    wanted = {"class": ["car", "bus"], "region": "x=1:", "time": "2:"}
    assert wanted.items() <= document["parameters"].items()
    assert document["input"]["truth"]["left_out"] == {"time": 1, "class": 1}
    assert document["input"]["truth"]["rows"] == 4


CLASSED = "id,t,x,class\na,1,0,car\nb,1,50,bus\n"


def test_a_filter_by_class_holds_where_there_are_classes(invoke: Run, write: Write) -> None:
    truth, estimate = write("t.csv", CLASSED), write("e.csv", "id,t,x\n1,1,0\n2,1,50\n")
    done = invoke(truth, estimate, "--class", "car", "--format", "json")
    document = json.loads(done.out)
    assert (document["sizes"]["truth"], document["sizes"]["estimates"]) == (1, 2)
    assert f"{estimate}: no column class, so --class leaves out none of its rows" in done.err
    assert invoke(truth, estimate, "--by", "class").status == 3
    done = invoke(truth, truth, "--class", "car", "--estimate-class", "bus", "--format", "json")
    document = json.loads(done.out)
    assert document["parameters"]["class"] == ["car"]
    assert document["parameters"]["estimate_class"] == ["bus"]
    assert document["counts"]["missed"] == document["counts"]["false"] == 1
    done = invoke(truth, estimate, "--estimate-class", "car")
    assert (done.status, "no column class" in done.err) == (3, True)
    done = invoke(truth, truth, "--truth-class", "van")
    assert (done.status, f'--truth-class "van": no row of {truth}' in done.err) == (2, True)


@pytest.mark.parametrize(
    ("truth", "estimate", "missed", "said"),
    [
        ("Car", "CAR", 0, 'e.csv: class "CAR" is read as "Car"'),
        ("1", "1.0", 0, 'e.csv: class "1.0" is read as "1"'),
        ("1", "01", 0, 'e.csv: class "01" is read as "1"'),
        ("car", "vehicle.car", 1, "its classes vehicle.car are not in the truth, which has car"),
    ],
)
def test_by_class_knows_the_spellings_that_class_knows(
    invoke: Run, write: Write, truth: str, estimate: str, missed: int, said: str
) -> None:
    sides = [write(f"{k}.csv", f"id,t,x,class\na,1,0,{name}\n") for k, name in
             (("t", truth), ("e", estimate))]  # fmt: skip
    answer = invoke(*sides, "--by", "class", "--format", "json")
    assert json.loads(answer.out)["counts"]["missed"] == missed
    assert said in answer.err
    if not missed:
        one = json.loads(invoke(*sides, "--class", truth, "--format", "json").out)
        assert one["counts"]["missed"] == 0


def test_classes_that_only_one_side_has(invoke: Run, write: Write) -> None:
    truth = write("t.csv", "id,t,x,class\na,1,0,Car\nb,1,50,Bus\n")
    estimate = write("e.csv", "id,t,x,class\na,1,0,Car\nc,1,9,car\nb,1,50,van\n")
    answer = invoke(truth, estimate, "--by", "class", "--format", "json")
    assert json.loads(answer.out)["counts"]["missed"] == 1
    assert 'class "car" is not the same class as "Car"' in answer.err
    assert "no car, van in the truth, and no Bus here" in answer.err


def test_classes_in_upper_and_lower_case(invoke: Run, write: Write, tmp_path: Path) -> None:
    truth = write("t.csv", "id,t,x,class\na,1,0,Car\nb,1,50,Van\n")
    estimate = write("e.csv", "id,t,x,class\na,1,0,CAR\nb,1,50,bus\n")
    for asked in ("car", "Car", "cAR"):
        answer = invoke(truth, estimate, "--class", asked, "--format", "json")
        document = json.loads(answer.out)
        assert (document["sizes"]["truth"], document["sizes"]["estimates"]) == (1, 1)
        assert document["total"] == 0
        assert f'{estimate}: class "CAR" is read as "{asked}"' in answer.err
        assert (f'{truth}: class "Car" is read as' in answer.err) == (asked != "Car")
    # Two classes that differ in this alone are two.
    both = write("b.csv", "id,t,x,class\na,1,0,Car\nb,1,50,car\nc,1,99,bus\n")
    reading = read(both, ReadOptions(classes=("car",)))
    assert list(reading.trajectories.ids) == ["b"]
    assert 'class "car" does not include "Car"' in reading.notices
    reading = read(both, ReadOptions(classes=("car", "Car", "BUS")))
    assert list(reading.trajectories.ids) == ["a", "b", "c"]
    assert 'class "bus" is read as "BUS"' in reading.notices
    assert not any("another" in notice for notice in reading.notices)
    answer = invoke(both, both, "--class", "CAR")
    assert answer.status == 2
    assert '--class "CAR": there is "Car" and "car"; write it as in the files' in answer.err
    # Blocks of data in parts do not know all classes: there a name is as it is written.
    pytest.importorskip("pyarrow")
    for side, path in (("gt", truth), ("out", estimate)):
        (tmp_path / side).mkdir()
        Path(path).rename(tmp_path / side / "part.csv")
    answer = invoke("gt", "out", "--class", "car", "-o", "parts", "--memory", "1GB")
    assert answer.status == 2
    assert '--class "car": there is "CAR" and "Car"; write it as in the files' in answer.err


def test_results_whose_classes_are_not_known(write: Write) -> None:
    path = write("r.txt", "1,7,10,20,4,6,1,-1,-1\n")
    reading = read(path, ReadOptions(classes=("1",), shared=("class",)), role="estimate")
    assert len(reading.trajectories.step) == 1
    assert "class" in reading.missing


# --- by class -------------------------------------------------------------------------------------


def test_by_class_adds_up(invoke: Run, write: Write, tmp_path: Path) -> None:
    # c = 10, p = 2: a car at 0.5 costs 0.25; a bus that has a van on it, and a van that has a bus,
    # cost 50 each, which they would not without --by.
    truth = write("t.csv", "id,t,x,class\na,1,0,car\nb,1,50,bus\n")
    estimate = write("e.csv", "id,t,x,class\n1,1,0.5,car\n2,1,50,van\n")
    arguments = [truth, estimate, "-c", "10", "--by", "class"]
    document = json.loads(invoke(*arguments, "--format", "json").out)
    classes = document["by_class"]
    assert {name: part["total"] for name, part in classes.items()} == pytest.approx(
        {"bus": 50, "car": 0.25, "van": 50}
    )
    assert document["total"] == pytest.approx(100.25)
    for key in ("total", "localisation", "missed", "false", "switch"):
        assert document[key] == pytest.approx(sum(part[key] for part in classes.values()))
    for key in ("lower_bound", "upper_bound"):
        assert document[key] ** 2 == pytest.approx(sum(p[key] ** 2 for p in classes.values()))
    assert document["counts"] == {"missed": 1, "false": 1, "switch": 0}
    assert document["per_step"][0]["total"] == pytest.approx(100.25)
    assert document["sizes"]["truth"] == 2
    assert document["parameters"]["by"] == "class"
    status, out, _ = invoke(*arguments, "-o", str(tmp_path / "out"))
    assert status == 0
    assert [line.split()[0] for line in out.splitlines() if " 7.0711 " in line] == ["bus", "van"]
    per_class = (tmp_path / "out" / "per_class.csv").read_text()
    assert per_class.startswith("class,tgospa,total,")
    for format_ in ("csv", "markdown", "latex"):
        assert invoke(*arguments, "--format", format_).status == 0


@pytest.mark.usefixtures("way")
def test_rows_without_a_class_are_said(write: Write) -> None:
    path = write("a.csv", "id,t,x,class\na,1,0,car\nb,1,1,\nb,2,2, \nc,3,,\n")
    reading = read(path, ReadOptions(by_class=True))
    assert reading.classes == ("", "car")
    assert '2 rows have no class: evaluated as a class named ""' in reading.notices
    assert not any("no class" in notice for notice in read(path).notices)


def test_by_class_of_nothing(invoke: Run, write: Write) -> None:
    path = write("t.csv", "id,t,x,class\n")
    assert json.loads(invoke(path, path, "--by", "class", "--format", "json").out)["total"] == 0


def test_classes_whose_spelling_leaves_open_which_is_meant(invoke: Run, write: Write) -> None:
    """What one file makes ambiguous is so for both: half of a pair would be left out."""
    both = write("both.csv", "id,t,x,class\n1,1,0,Car\n2,1,50,car\n")
    one = write("one.csv", "id,t,x,class\n1,1,0,Car\n")
    for name in ("CAR", "car"):
        answer = invoke(both, one, "--class", name, "-c", "10", "-g", "5")
        assert (answer.status, answer.out) == (2, "")
        assert f'--class "{name}": there is "Car" and "car"; write it as in the files' in answer.err
    assert invoke(both, one, "--class", "Car", "-c", "10", "-g", "5").status == 0
