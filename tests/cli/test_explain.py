"""``tgospa-eval explain``: what it promises is what evaluating a file edited by hand gives."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Run, Write
from checkout import SAMPLES

Row = tuple[str, int, float, float]

METRIC = ("-c", "10", "-g", "5", "-q")
QUICKSTART = [str(SAMPLES / "quickstart" / name) for name in ("truth.csv", "estimate.csv")]


def save(path: Path, rows: list[Row]) -> str:
    lines = ["id,t,x,y", *(",".join((name, *map(repr, rest))) for name, *rest in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str, list[Row]]:
    """One scene in which every kind of repair saves something."""
    folder = tmp_path_factory.mktemp("scene")
    truth, rows = [], []
    for name in range(7):
        truth += [(f"t{name}", t, 7.0 * t, 100.0 * name + 2.0 * t * (name % 2)) for t in range(30)]
    for name, t, x, y in truth:
        number = int(name[1])
        if number == 0:  # fragmented, and false at the end
            rows.append((("a", "b")[t >= 12], t, x, y))
        if number in (1, 2):  # exchanged from 10 on
            rows.append((("c", "d")[(number == 1) != (t >= 10)], t, x, y))
        if number == 3 and not 14 <= t < 17:
            rows.append(("e", t, x, y))
        if number == 4 and 4 <= t < 26:
            rows.append(("f", t, x, y))
        if number in (5, 6) and (t < 15) == (number == 5):  # one track for two objects
            rows.append(("g", t, x, y))
    truth = [
        row for row in truth if row[0] not in ("t5", "t6") or (row[1] < 15) == (row[0] == "t5")
    ]
    truth = [row for row in truth if row[0] != "t0" or row[1] < 27]
    rows += [("ghost", t, -500.0 - t, 0.0) for t in range(5, 9)]
    rows = [(name, t + 1, x + 0.5, y - 0.25) for name, t, x, y in rows]  # late, and off
    return save(folder / "truth.csv", truth), save(folder / "estimate.csv", rows), rows


def filled(rows: list[Row], name: str, begin: int, end: int) -> list[Row]:
    """The steps of a gap on a straight line."""
    (t0, x0, y0), (t1, x1, y1) = (
        next(rest for own, *rest in rows if own == name and rest[0] == t)
        for t in (begin - 1, end + 1)
    )
    return [
        (name, t, *(a + (t - t0) / (t1 - t0) * (b - a) for a, b in ((x0, x1), (y0, y1))))
        for t in range(begin, end + 1)
    ]


def by_hand(rows: list[Row], repair: dict[str, Any]) -> list[Row]:
    """The rows of a file after a repair, as its text says, by no code of the package."""
    ids, begin, end = repair["estimates"], repair["from"], repair["to"]
    match repair["kind"]:
        case "merge":
            return [(ids[0] if name == ids[1] else name, *rest) for name, *rest in rows]
        case "exchange":
            other = dict(zip(ids, reversed(ids), strict=True))
            return [(other.get(n, n) if t >= begin else n, t, x, y) for n, t, x, y in rows]
        case "split":
            return [(f"{n}_2" if n in ids and t >= begin else n, t, x, y) for n, t, x, y in rows]
        case "drop":
            return [row for row in rows if row[0] not in ids]
        case "trim":
            return [row for row in rows if row[0] not in ids or not begin <= row[1] <= end]
        case "fill":
            return rows + filled(rows, ids[0], begin, end)
        case "extend":
            states = zip(*(repair["rows"][key] for key in "txy"), strict=True)
            return rows + [(ids[0], *state) for state in states]
        case "shift":
            return [(name, t + repair["shift"], x, y) for name, t, x, y in rows]
        case "offset":
            dx, dy = repair["offset"]["x"], repair["offset"]["y"]
            return [(name, t, x - dx, y - dy) for name, t, x, y in rows]
    raise AssertionError(repair["kind"])


def test_files_edited_by_hand_save_what_is_promised(
    invoke: Run, tmp_path: Path, files: tuple[str, str, list[Row]]
) -> None:
    truth, estimate, rows = files
    done = invoke("explain", truth, estimate, *METRIC, "--top", "20", "--format", "json")
    assert done.status == 0
    document = json.loads(done.out)
    before = json.loads(invoke(truth, estimate, *METRIC, "--format", "json").out)
    assert (document["total"], document["tgospa"]) == (before["total"], before["tgospa"])
    of_kind = {repair["kind"]: repair for repair in reversed(document["repairs"])}
    assert set(of_kind) == {
        "merge", "exchange", "split", "drop", "trim", "fill", "extend", "shift", "offset",
    }  # fmt: skip
    for kind, repair in of_kind.items():
        edited = save(tmp_path / f"{kind}.csv", by_hand(rows, repair))
        after = json.loads(invoke(truth, edited, *METRIC, "--format", "json").out)
        assert after["total"] == pytest.approx(repair["total"], rel=1e-12), kind
        saved, slack = before["total"] - after["total"], 1e-12 * before["total"]
        assert repair["saving"]["lower"] - slack <= saved <= repair["saving"]["upper"] + slack, kind


def test_an_extension_goes_on_at_the_velocity_of_five_states(
    invoke: Run, files: tuple[str, str, list[Row]]
) -> None:
    truth, estimate, rows = files
    done = invoke("explain", truth, estimate, *METRIC, "--top", "20", "--format", "json")
    found = [r for r in json.loads(done.out)["repairs"] if r["kind"] == "extend"]
    repair = next(r for r in found if r["estimates"] == ["f"] and r["from"] > 20)
    *_, a, _, _, _, b = sorted((row for row in rows if row[0] == "f"), key=lambda row: row[1])
    ahead = np.array(repair["rows"]["t"]) - b[1]
    assert repair["rows"]["x"] == pytest.approx(b[2] + ahead * (b[2] - a[2]) / 4)
    assert repair["rows"]["y"] == pytest.approx(b[3] + ahead * (b[3] - a[3]) / 4)


def test_a_track_that_is_split_keeps_its_name(invoke: Run, tmp_path: Path) -> None:
    for name, tracks in (("t", "AB"), ("e", "E")):
        rows = [
            f"{one},{t},{t},{50 * (one == 'B' or (one == 'E' and t > 9))}"
            for one in tracks
            for t in range(20)
        ]
        (tmp_path / f"{name}.csv").write_text("\n".join(["id,t,x,y", *rows]))
    files = [str(tmp_path / f"{name}.csv") for name in ("t", "e", "repaired")]
    assert invoke("explain", *files[:2], "-c", "10", "-g", "8", "--apply", "1", "-o", files[2])
    assert {row["id"] for row in csv.DictReader(Path(files[2]).read_text().splitlines())} == {
        "E",
        "E_2",
    }


def test_the_repaired_file_is_written_whole_or_not_at_all(invoke: Run, tmp_path: Path) -> None:
    target = tmp_path / "repaired.csv"
    written = invoke(
        "explain", *QUICKSTART, *METRIC[:-1], "--apply", "2", "-o", str(target), "--format", "csv"
    )
    assert f"wrote {target}: the estimate with repair 2" in written.err
    rows = list(csv.DictReader(written.out.splitlines()))
    assert [row["rank"] for row in rows] == [str(k) for k in range(1, 11)]
    after = json.loads(invoke(QUICKSTART[0], str(target), *METRIC, "--format", "json").out)
    assert after["total"] == pytest.approx(float(rows[1]["total"]), rel=1e-12)
    assert target.read_text().splitlines()[0] == "id,t,x,y"

    before = target.read_bytes()
    refused = invoke("explain", *QUICKSTART, *METRIC, "-o", str(target))
    assert (refused.status, target.read_bytes()) == (2, before)
    for options, said in (
        (("--apply", "99", "-o", str(tmp_path / "no.csv")), "--apply 99: repair 99: there are"),
        (("-o", str(tmp_path / "no.txt")), "must end in .csv"),
        (("-o", QUICKSTART[1], "--force"), "is also read or written by this command"),
        (("--apply", "2"), "--apply needs -o FILE"),
        (("--by", "class"), "choose one class by --class NAME"),
        (("--preprocess", "motchallenge"), "what it leaves out changes with the repair"),
        (("--top", "0"), "--top"),
    ):
        done = invoke("explain", *QUICKSTART, *METRIC, *options)
        assert done.status == 2
        assert said in done.err
    assert list(tmp_path.iterdir()) == [target]


def test_the_table_has_80_columns_and_says_that_savings_do_not_add_up(invoke: Run) -> None:
    done = invoke("explain", *QUICKSTART, *METRIC)
    lines = done.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "savings do not add up" in done.out
    assert any(line.split()[:4] == ["1", "drop", "estimate", "107,"] for line in lines)
    markdown = invoke("explain", *QUICKSTART, *METRIC, "--format", "markdown").out
    assert "| drop estimate 107, t = 14 to 21 | 400 |" in markdown


def test_filters_leave_out_what_they_would_undo(
    invoke: Run, tmp_path: Path, files: tuple[str, str, list[Row]]
) -> None:
    truth, estimate, _ = files
    filters = ("--time", "0:31", "--region", "y=-100:650")
    done = invoke("explain", truth, estimate, *METRIC, *filters, "--top", "20", "--format", "json")
    repairs = json.loads(done.out)["repairs"]
    assert not {"shift", "extend", "offset"} & {repair["kind"] for repair in repairs}
    target = str(tmp_path / "repaired.csv")
    invoke("explain", truth, estimate, *METRIC, *filters, "-o", target)
    after = json.loads(invoke(truth, target, *METRIC, *filters, "--format", "json").out)
    assert after["total"] == pytest.approx(repairs[0]["total"], rel=1e-12)


def test_a_side_without_objects(invoke: Run, write: Write) -> None:
    """All estimates are false: dropping each saves what it costs."""
    header = "id,t,x\n"
    empty, estimate = write("empty.csv", header), write("e.csv", f"{header}a,0,1\na,1,1\nb,0,5\n")
    options = ("-c", "2", "-g", "1", "-q", "--format", "json")
    found = json.loads(invoke("explain", empty, estimate, *options).out)
    saved = [(repair["kind"], repair["saving"]["lower"]) for repair in found["repairs"]]
    assert saved == [("drop", pytest.approx(4)), ("drop", pytest.approx(2))]
    for other in (empty, estimate):
        answer = invoke("explain", other, empty, *options)
        assert answer.status == 0
        assert json.loads(answer.out)["repairs"] == []


def test_evaluate_shows_the_same_repairs_beside(invoke: Run, tmp_path: Path) -> None:
    """In the table, in the JSON, as files, and on the page; what it took counts as time."""
    alone = json.loads(invoke("explain", *QUICKSTART, *METRIC, "--format", "json").out)
    done = invoke(*QUICKSTART, *METRIC, "--explain", "-o", "out")
    assert done.status == 0
    assert max(map(len, done.out.splitlines())) <= 80
    assert "  1   drop estimate 107, t = 14 to 21                 400  22.1 %" in done.out
    assert "savings do not add up" in done.out
    folder = tmp_path / "out"
    saved, result = (
        json.loads((folder / name).read_text()) for name in ("explanation.json", "result.json")
    )
    assert saved["schema"] == "tgospa-eval/explanation/1"
    for document in (saved, result["explanation"]):
        assert [r["text"] for r in document["repairs"]] == [r["text"] for r in alone["repairs"]]
        assert [r["total"] for r in document["repairs"]] == [r["total"] for r in alone["repairs"]]
        assert document["additive"] is False
    assert result["timings"]["total"] > result["timings"]["explain"] > 0
    rows = list(csv.DictReader((folder / "explanation.csv").read_text().splitlines()))
    assert [row["repair"] for row in rows] == [r["text"] for r in alone["repairs"]]
    page = (folder / "report.html").read_text()
    assert '<a href="#repair=1">1. <bdi>drop estimate 107, t = 14 to 21</bdi></a>' in page
    assert "Savings do not add up" in page
    assert invoke(*QUICKSTART, *METRIC, "-o", "out").status == 0
    assert not (folder / "explanation.json").exists()  # of the run before
    assert "Best repairs" not in (folder / "report.html").read_text()
    for form, row in (
        ("markdown", "| 1 | drop estimate 107, t = 14 to 21 | 400 | 22.1 % | 37.5398 |"),
        ("latex", r"1 & drop estimate 107, t = 14 to 21 & 400 & 22.1 \% & 37.5398"),
    ):
        assert row in invoke(*QUICKSTART, *METRIC, "--explain", "--format", form).out
    right = invoke(QUICKSTART[0], QUICKSTART[0], *METRIC, "--explain")
    assert "no repair is proven to save anything (0 repairs tried)" in right.out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--sweep", "c=1,2"), "--explain is not supported with --sweep"),
        (("--by", "class"), "choose one class by --class NAME"),
        (("--distance", "iou", "--preprocess", "motchallenge"), "depends on the repair"),
    ],
)
def test_evaluate_explains_what_the_verb_does(
    invoke: Run, options: tuple[str, ...], said: str
) -> None:
    done = invoke(*QUICKSTART, "--explain", *options)
    assert (done.status, done.out) == (2, "")
    assert said in done.err
