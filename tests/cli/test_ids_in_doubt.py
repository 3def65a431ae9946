"""Ids and columns without headers, as people's files have them."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Invoke

from tgospa_eval import TgospaWarning, evaluate, read_trajectories

METRIC = ("-c", "20", "-g", "5")


def total(answer: Any) -> float:
    assert answer.status == 0, answer.err
    return float(answer.out.split()[2].rstrip(",").replace(",", "")) ** 2


def write(name: str, lines: list[str]) -> str:
    Path(name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return name


def clusters(*, apart: bool) -> list[str]:
    """Two clusters with a track 1 each, at other times or at the same."""
    rows = ["Nr,CID,TID,x,y,frame"]
    for cluster in (1, 2):
        for k in range(4):
            frame = k + (4 * cluster if apart else 0)
            rows.append(f"{len(rows)},{cluster},1,{50 * cluster + k},10,{frame}")
    return rows


def test_ids_that_are_numbered_anew(invoke: Invoke) -> None:
    truth = write("truth.csv", clusters(apart=True))
    rows = [
        f"{a},{t},{float(x) + 0.5},{y}" for _, a, _, x, y, t in map(_split, clusters(apart=1)[1:])
    ]
    linked = write("linked.csv", ["id,t,x,y", *rows])
    answer = invoke(truth, linked, *METRIC)
    assert 'ids of "TID" repeat in several values of "CID"' in answer.err
    remedy = ("--truth-columns", "id=CID+TID")
    assert " ".join(remedy) in answer.err
    assert total(invoke(truth, linked, *METRIC, *remedy)) == pytest.approx(8 * 0.25, rel=1e-4)
    with pytest.warns(TgospaWarning, match="if ids restart in each"):
        evaluate(pd.read_csv(truth), linked, cutoff=20, switch_penalty=5)
    table = evaluate(
        pd.read_csv(truth), linked, cutoff=20, switch_penalty=5, truth_columns=("id=CID+TID",)
    ).frame("per_truth")
    assert sorted(table["id"]) == ["1/1", "2/1"]
    at_once = write("at_once.csv", clusters(apart=False))
    answer = invoke(at_once, at_once, *METRIC)
    assert answer.status == 3
    assert 'ids restart in each "CID": --truth-columns id=CID+TID evaluates' in answer.err
    assert total(invoke(at_once, at_once, *METRIC, "--columns", "id=CID+TID")) == 0
    answer = invoke(at_once, at_once, *METRIC, "--columns", "class=CID", "--by", "class")
    assert total(answer) == 0
    assert "2 ground-truth objects" in answer.out
    answer = invoke(at_once, at_once, *METRIC, "--columns", "id=CID+TRK")
    assert 'no header "TRK" for id' in answer.err
    assert "--truth-columns id=CID+HEADER" in answer.err
    pd.read_csv(truth).to_parquet("truth.parquet")
    of_parquet = total(invoke("truth.parquet", linked, *METRIC, *remedy))
    assert of_parquet == pytest.approx(8 * 0.25, rel=1e-4)


def _split(line: str) -> list[str]:
    return line.split(",")


@pytest.mark.parametrize("none", ["-1", ""])
def test_rows_of_no_track(invoke: Invoke, none: str) -> None:
    truth = write(
        "truth.csv", ["id,t,x,y", *(f"{k},{t},{9 * k},{t}" for t in range(6) for k in (1, 2))]
    )
    rows = [f"{k if t or k == 1 else none},{t},{9 * k},{t}" for t in range(6) for k in (1, 2)]
    estimate = write("estimate.csv", ["track,t,x,y", *rows])
    answer = invoke(truth, estimate, *METRIC)
    if none:
        assert "id -1 of 1 row counts as one track" in answer.err
        assert total(answer) == pytest.approx(25, rel=1e-4)  # a switch
        return
    assert (
        answer.status,
        "blank id; give it an id, or leave such rows out with --on-invalid drop" in answer.err,
    ) == (
        3,
        True,
    )
    answer = invoke(truth, estimate, *METRIC, "--on-invalid", "drop")
    assert "1 row without an id left out, by --on-invalid drop" in answer.err
    assert total(answer) == pytest.approx(200, rel=1e-4)
    table = pd.read_csv(estimate)
    given = {"cutoff": 20, "switch_penalty": 5, "on_invalid": "drop"}
    assert evaluate(truth, table, **given).total == pytest.approx(200, rel=1e-4)


def test_blank_rows_of_spreadsheets(invoke: Invoke) -> None:
    lines = ["id,t,x,y", "1,0,2,3", ",,,", "1,1,2,4", ",,,"]
    path = write("blank.csv", lines)
    assert "blank.csv: 2 blank rows passed over" in invoke(path, path, *METRIC).err
    answer = evaluate(path, pd.read_csv(path), cutoff=20, switch_penalty=5)
    assert answer.total == 0
    assert "estimate: 2 blank rows passed over" in answer.notices
    answer = invoke(path, write("wrong.csv", [*lines, ",,3,4", ",5,,"]), *METRIC)
    assert 'line 6, column "id": blank id (and 1 more)' in answer.err
    wide = write("wide.csv", ["t,x1,y1", "0,2,3", ",,", "1,2,4"])
    answer = invoke(path, wide, *METRIC, "--estimate-columns", "x=x{id},y=y{id}")
    assert total(answer) == 0


def test_an_id_that_is_nan_names_nothing(invoke: Invoke) -> None:
    lines = [f"{t},{k},9,{t},50,40,1,-1,-1,-1" for t in range(1, 4) for k in (1, "nan")]
    path = write("mot.txt", lines)
    answer = invoke(path, path, *METRIC)
    assert answer.status == 3
    assert 'line 2, column "id": blank id (and 2 more)' in answer.err
    answer = invoke(path, path, *METRIC, "--on-invalid", "drop")
    assert total(answer) == 0
    assert "1 ground-truth object, 1 estimate, 3 steps" in answer.out


def test_ids_of_rows(invoke: Invoke) -> None:
    rows = [f"{10 * t + k},{k},{t},{9 * k},{t}" for t in range(6) for k in (1, 2)]
    truth = write("truth.csv", ["id,t,x,y", *(row.split(",", 1)[1] for row in rows)])
    spots = write("spots.csv", ["ID,TRACK_ID,FRAME,POSITION_X,POSITION_Y", *rows])
    answer = invoke(truth, spots, *METRIC)
    assert 'every id of "ID" has a single row' in answer.err
    remedy = ("--estimate-columns", "id=TRACK_ID")
    assert " ".join(remedy) in answer.err
    assert total(invoke(truth, spots, *METRIC, *remedy)) == 0


@pytest.mark.parametrize("other", ["track_id", "tracker_id", "track", "object_id"])
@pytest.mark.parametrize("ids", ["rows", "pieces", "tracks", "none"])
def test_an_id_beside_another_id(invoke: Invoke, other: str, ids: str) -> None:
    rows = [(t, k) for t in range(6) for k in ((1, 2) if t in (1, 2) else (2, 1))]
    truth = write("truth.csv", ["id,t,x,y", *(f"{k},{t},{50 * k + t},0" for t, k in rows)])
    number = [
        {"rows": n % 2, "pieces": t // 2 * 2 + k, "tracks": k, "none": 0}[ids]
        for n, (t, k) in enumerate(rows)
    ]
    lines = [f"{t},{n},{k + 10},{50 * k + t},0" for n, (t, k) in zip(number, rows, strict=True)]
    estimate = write("estimate.csv", [f"t,id,{other},x,y", *lines])
    answer = invoke(truth, estimate, *METRIC)
    remedy = f"--estimate-columns id={other}"
    text = f'ids of "id" may number rows: "{other}" has other tracks; {remedy}'
    if ids == "none":
        assert f'{remedy} reads the ids of "{other}"' in answer.err
    else:
        notice = f'id is read from "id", not from "{other}"; {remedy} reads that'
        assert (notice in answer.err) == (ids != "tracks")
        assert (text in answer.err) == (total(answer) > 0) == (ids != "tracks")
    answer = invoke(truth, estimate, *METRIC, *remedy.split())
    assert (total(answer), "may number" in answer.err) == (0, False)
    if ids == "rows":
        table = pd.read_csv(estimate).assign(**{"class": [[1]] * len(rows)})
        with pytest.warns(TgospaWarning, match="may number rows"):
            evaluate(truth, table, cutoff=20, switch_penalty=5)
        table[other] = [[1]] * len(rows)
        assert evaluate(truth, table, cutoff=20, switch_penalty=5).total > 0


NUMBERS = {
    "obsmat": ("{t}e0 {k}e0 {x} 0 {y} 1.5 0 0.1", "t,id,x,-,y"),
    "speeds": ("{t} {k} {x} {y} 1.5 0.1", "t,id,x,y"),
    "four": ("{t}.0\t{k}.0\t{x}\t{y}", "t,id,x,y"),
    "commas": ("{k},{t},{x},{y},0.7,0.7", "id,t,x,y"),
    "city": ("1 {k} {t} {x} {y} 50 40 -1 -1", "camera,id,t,left,top,width,height"),
}


@pytest.mark.parametrize("shape", NUMBERS)
def test_columns_without_headers_are_named_by_place(invoke: Invoke, shape: str) -> None:
    line, names = NUMBERS[shape]
    truth, estimate = (
        write(
            name,
            [line.format(t=t, k=k, x=9 * k + shift, y=t + shift) for t in range(6) for k in (1, 2)],
        )
        for name, shift in (("truth.txt", 0), ("estimate.txt", 0.5))
    )
    answer = invoke(truth, estimate, *METRIC)
    assert answer.status == 3, answer.out
    assert "instead of a header" in answer.err
    assert "name the columns in the order of the file with --truth-columns" in answer.err
    answer = invoke(truth, estimate, *METRIC, "--columns", names)
    assert total(answer) == pytest.approx(12 * 0.5, rel=1e-4)
    assert np.isclose(
        evaluate(truth, estimate, 20, 2, 5, columns=tuple(names.split(","))).total, 12 * 0.5
    )
    with_header = write("header.csv", ["id,t,x,y", "1,0,9,0"])
    assert invoke(with_header, estimate, *METRIC, "--estimate-columns", names).status == 0


def test_boxes_without_headers_stay_motchallenge(invoke: Invoke) -> None:
    for k, tail in enumerate(("", ",1", ",0.9,-1,-1,-1", ",1,1,0.5", ",31.7")):
        lines = [f"{t},{k},{9 * k},{t},50.5,40{tail}" for t in range(1, 4) for k in (1, 2)]
        answer = invoke(write(f"{k}.txt", lines), f"{k}.txt", *METRIC)
        assert "read as motchallenge" in answer.err
        assert total(answer) == 0


def anew(column: str, shift: float = 0.0) -> list[str]:
    """Ids that are the same in two groups, which are named in a column."""
    rows = [
        f"{group},{t},{k},{1000 * n + 100 * k + t + shift},{5 * k}"
        for n, group in enumerate(("a", "b"))
        for t in range(4)
        for k in (1, 2)
    ]
    return [f"{column},frame,track,x,y", *rows]


@pytest.mark.parametrize("column", ["scene", "run", "episode", "gameId", "class", "category"])
def test_ids_of_any_group(invoke: Invoke, column: str) -> None:
    truth, estimate = write("gt.csv", anew(column)), write("est.csv", anew(column, 0.5))
    answer = invoke(truth, estimate, *METRIC)
    remedy = f"id={column}+track"
    assert f"--truth-columns {remedy} evaluates all as one scene" in answer.err
    answer = invoke(truth, estimate, *METRIC, "--columns", remedy)
    assert total(answer) == pytest.approx(16 * 0.25, rel=1e-4)
    by = () if column == "class" else ("--columns", f"class={column}")
    answer = invoke(truth, estimate, *METRIC, "--by", "class", *by)
    assert total(answer) == pytest.approx(16 * 0.25, rel=1e-4)


@pytest.mark.parametrize("name", ["-1", "None", "nan", "0", "N/A"])
def test_rows_of_no_track_that_repeat(invoke: Invoke, name: str) -> None:
    rows = [f"{t},{k},{100 * k + t},5" for t in range(4) for k in (1, 2)]
    none = [f"2,{name},{x},900" for x in (700, 800)]
    truth = write("gt.csv", ["frame,id,x,y", *rows])
    estimate = write("est.csv", ["frame,id,x,y", *rows, *none])
    answer = invoke(truth, estimate, *METRIC)
    assert (answer.status, f"--estimate-where 'id != {name}' leaves" in answer.err) == (3, True)
    assert total(invoke(truth, estimate, *METRIC, "--estimate-where", f"id != {name}")) == 0


@pytest.mark.parametrize("separator", [",", " "])
def test_ids_that_a_spreadsheet_rounded(invoke: Invoke, separator: str) -> None:
    rows = [f"2.19E+08,{t},{t},{k}" for k in (0, 50) for t in range(k, k + 3)]
    path = write("ships.csv", [line.replace(",", separator) for line in ("mmsi,t,x,y", *rows)])
    text = 'id "2.19E+08" has lost digits, as in spreadsheets, so several objects may share it'
    assert f"{text}; write all digits of the ids" in invoke(path, path, *METRIC).err
    at_once = [*rows, "2.19E+08,1,900,0"]
    path = write("ships.csv", [line.replace(",", separator) for line in ("mmsi,t,x,y", *at_once)])
    answer = invoke(path, path, *METRIC)
    assert (answer.status, text in answer.err, "duplicate first" in answer.err) == (3, True, False)
    exact = write("exact.csv", ["id,t,x,y", "1.000e+03,0,0,0", "4E1234,0,9,0", "1e5,0,5,0"])
    assert "lost digits" not in invoke(exact, exact, *METRIC).err


@pytest.mark.parametrize("form", ["csv", "visdrone"])
def test_detections_with_classes(invoke: Invoke, form: str) -> None:
    rows = [f"{t},0,{60 * k},{t},50,40,1,{k},0,0" for t in range(1, 9) for k in (1, 4)]
    header = ["frame,id,left,top,width,height,conf,class,v,w"] if form == "csv" else []
    path = write("a.csv", header + rows)
    answer = invoke(path, path, *METRIC, "--truth-format", form, "--estimate-format", form)
    assert answer.status == 3
    assert 'nearly every id is "0", as in detections, but TGOSPA compares tracks' in answer.err
    assert "class+id" not in answer.err


def test_ids_before_frames(invoke: Invoke) -> None:
    def lines(shift: int) -> list[str]:
        return [
            f"{k},{t},{300 * k + 4 * t + shift},{20 * k},40,80,1,-1,-1,-1"
            for t in range(1, 9)
            for k in (1, 2, 3)
        ]

    truth, estimate = write("gt.txt", lines(0)), write("res.txt", lines(3))
    answer = invoke(truth, estimate, *METRIC)
    remedy = "id,t,left,top,width,height,-,-,-,-"
    assert f"--truth-columns {remedy} reads them so" in answer.err
    answer = invoke(truth, estimate, *METRIC, "--columns", remedy)
    assert total(answer) == pytest.approx(24 * 9, rel=1e-4)
    assert "exchanged" not in answer.err


@pytest.mark.parametrize("header", ["", "a b x y"])
def test_times_before_ids(invoke: Invoke, header: str) -> None:
    rows = [f"{t} {k} {20 * k + t} {5 * k}" for t in range(6) for k in (1, 2)]
    path = write("rows.txt", [*([header] if header else []), *rows])
    if not header:
        answer = invoke("inspect", path)
        assert "order of the file with --columns t,id,x,y (" in answer.err
        swapped = write("swapped.txt", ["{1} {0} {2} {3}".format(*row.split()) for row in rows])
        assert "order of the file with --columns id,t,x,y (" in invoke("inspect", swapped).err
    wrong, right = ("id=a,t=b", "id=b,t=a") if header else ("id,t,x,y", "t,id,x,y")
    answer = invoke(path, path, *METRIC, "--columns", wrong)
    assert f"may be swapped; --truth-columns {right} reads them so" in answer.err
    answer = invoke(path, path, *METRIC, "--columns", right)
    assert (total(answer), "swapped" in answer.err) == (0, False)
    assert "6 steps" in answer.out
    with pytest.warns(TgospaWarning, match="may be swapped"):
        read_trajectories(path, columns=tuple(wrong.split(",")))


@pytest.mark.parametrize(
    ("header", "row", "said"),
    [
        ("t,id,x,y", "1 sec,a,2,3", "write the number alone, 1, and the unit in the header"),
        ("1;1;10;20;30;40", "2;1;10;20;30;40", "or separate the fields by blanks and name the f"),
        ("1,1,Car," + 14 * "0,", "", "or separate the fields by blanks and name the format"),
        ("1,1,1.5,20", "", "or name the format (--truth-format"),
        ("t,id,x,y", "1s,a,2,3", "write the number alone, 1, and the unit in the header"),
        ("t;id;x;y", "1;a;1,234.5;3", '"1,234.5"; write it without thousands separators'),
        ("t;id;x;y", "1;a;1.000.000,5;3", "write it without thousands separators"),
        ("t;id;x;y", "1;a;1 000,5;3", "write it without thousands separators"),
        ("t,id,x,y", "1,a,−5,3", "; write -5"),
        ("t,id,x,y", "1,a,0x10,3", "; write 16"),
        ("t,id,x,y", "1,a,4D-1,3", "; write 4e-1"),
        ("t,id,x,y", "1,a,1_000,3", "; write 1000"),
        ("t,id,lat,lon", "1,a,55.1N,12.5E", "write decimal degrees north and east, 55.1"),
        ("t,id,lat,lon", "1,a,55.1S,12.5W", "write decimal degrees north and east, -55.1"),
        ("t;id;lat;lon", "1;a;48°00'36\"S;12.5", "write decimal degrees north and east, -48.01"),
        ("t,id,lat,lon", "1,a,N 48°30.6',12.5", "write decimal degrees north and east, 48.51"),
        ("t,id,lat,lon", "1,a,48 30 36,12.5", "write decimal degrees north and east, 48.51"),
        ("t,id,lat,lon", "1,a,\u0664\u0668.\u0661,12.5", "write the digits 0 to 9"),
        ("t,id,lat,lon", "\u0664,a,48.1,12.5", "write the digits 0 to 9"),
        ("t,id,x", "1,a,1.2.3", "use one decimal mark (--decimal) and no thousands separator"),
        ("t,id,x,y", "23:59:58,a,2,3", "'%H:%M:%S' with --truth-time-format"),
        ("gameId,playId,nflId,t,x,y", "7,1,99,1,2,3", "--columns id=nflId"),
    ],
)
def test_one_sentence_that_helps(invoke: Invoke, header: str, row: str, said: str) -> None:
    answer = invoke("inspect", write("a.csv", [header, row]))
    assert (answer.status, said in answer.err) == (3, True), answer.err
