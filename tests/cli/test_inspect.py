"""``tgospa-eval inspect``: what was read, in words and as JSON."""

import json
from pathlib import Path

import numpy as np
import pytest
from answer import Run, Write

from tgospa_eval import Trajectories
from tgospa_eval.show.draw_plane import draw_inspection
from tgospa_eval.show.style import STYLES

TRUTH = "id,t,x,y\na,0,0,0\na,1,1,0\na,4,4,0\nb,0,9,9\nb,0,8,8\nb,1,,9\nb,2,9,5\n"
ESTIMATE = "id,t,x,y\n1,0,0,1\n1,1,1,3\n1,2,9,9\n"


def test_counts(invoke: Run, write: Write) -> None:
    """By hand: b at 0 is repeated, b at 1 has no x; a is absent at 2, b at 1 (of the steps)."""
    done = invoke("inspect", write("t.csv", TRUTH), write("e.csv", ESTIMATE), "--format", "json")
    assert done.status == 0
    document = json.loads(done.out)
    assert document["schema"] == "tgospa-eval/inspect/1"
    truth = document["truth"]
    assert (truth["rows"], truth["used"], truth["trajectories"], truth["steps"]) == (7, 5, 2, 4)
    assert truth["left_out"] == {"blank": 1, "duplicate": 1}
    assert truth["holes"] == {"steps": 2, "trajectories": 2, "longest": 1}
    assert truth["length"] == {"min": 2, "median": 2.5, "max": 3}
    assert truth["time"] == {
        "kind": "number", "first": 0, "last": 4, "step": {"min": 1, "median": 1, "max": 2},
    }  # fmt: skip
    assert truth["extent"] == {"x": {"min": 0, "max": 9}, "y": {"min": 0, "max": 9}}
    both = document["both"]
    assert both["steps"] == {"union": 4, "common": 3, "joined": 0, "counted": 4}
    # a is 1 and 3 away at t = 0, 1; b at (9, 9) is hypot(9, 8) away at 0, and 4 at t = 2;
    # between them linearly, the 95th of 100 at 2.85 of 0, 1, 2, 3.
    assert both["nearest"]["quantiles"]["50"] == pytest.approx(3.5)
    assert both["nearest"]["quantiles"]["95"] == pytest.approx(0.15 * 4 + 0.85 * 145**0.5)
    assert both["nearest"]["within_cutoff"] == 0.75
    repeated, few = document["warnings"]
    assert (repeated["code"], few["code"]) == ("duplicates", "steps-unmatched")
    assert "1 row repeats an (id, t)" in repeated["text"]
    assert "only 75 %" in few["text"]
    assert done.out == json.dumps(document, sort_keys=True, indent=1) + "\n"


def test_table(invoke: Run, write: Write) -> None:
    files = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    for arguments in (files, files[:1]):
        done = invoke("inspect", *arguments)
        assert done.status == 0
        assert max(map(len, done.out.splitlines())) <= 80
        assert "  no position      1" in " ".join(done.out.splitlines()[4:5])
        assert "  repeated         1" in " ".join(done.out.splitlines()[5:6])
    assert invoke("inspect", *files, "--on-duplicate", "error").status == 3
    assert "nearer than the cutoff c = 2: 25.0 %" in invoke("inspect", *files, "-c", "2").out


def test_steps_between_large_stamps_have_no_rounding(invoke: Run, write: Write) -> None:
    rows = "".join(f"1,{1403636579.763555584 + 0.1 * k!r},0\n" for k in range(9))
    done = invoke("inspect", write("t.csv", f"id,t,x\n{rows}"))
    assert "t to next t      0.1\n" in done.out


def test_classes(invoke: Run, write: Write) -> None:
    truth = write("t.csv", "id,t,x,class\n1,0,0,car\n1,1,0,car\n2,0,5,van\n")
    estimate = write("e.csv", "id,t,x,class\n1,0,0,car\n")
    arguments = ("inspect", truth, estimate, "--by", "class")
    lines = [line.split(maxsplit=2) for line in invoke(*arguments).out.splitlines()]
    assert ["class", "car", "2 rows, 1 trajectory          1 row, 1 trajectory"] in lines
    assert ["class", "van", "1 row, 1 trajectory           none"] in lines
    document = json.loads(invoke(*arguments, "--format", "json").out)
    assert document["truth"]["classes"]["van"] == {"rows": 1, "trajectories": 1}
    assert document["parameters"]["by"] == "class"


def test_wide_cells_go_on_below(invoke: Run, write: Write) -> None:
    wide = "id,TimeStamp,lat,lon\na,5.800000000000001,-48.123456781,-122.123456781\n"
    truth = write(
        "t.csv", wide + "b,6.8,-48.123456789,-122.123456782\nb,7.8,-48.1,-122.123456789\n"
    )
    answer = invoke("inspect", truth, write("e.csv", wide), "--distance", "haversine")
    lines = answer.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "  first t          5.8                           5.8" in lines
    at = next(k for k, line in enumerate(lines) if line.startswith("lon"))
    assert lines[at : at + 2] == [
        "lon                -122.123456789 to             -122.123457",
        "                   -122.123456781",
    ]
    assert "headers            t=TimeStamp                   t=TimeStamp" in lines
    assert "both have rows at t = 5.8 only" in lines
    assert "  nearer than the cutoff c = 10 m: 100.0 %" in lines
    for number in ("1 rows", "1 steps", "1 states"):
        assert number not in answer.out


def test_empty_files(invoke: Run, write: Write) -> None:
    empty = write("e.csv", "id,t,x,y\n")
    for arguments in ((empty,), (empty, empty), (write("t.csv", TRUTH), empty)):
        for format_ in ("table", "json"):
            assert invoke("inspect", *arguments, "--format", format_).status == 0


def rows(step: float, shift: float, tracks: int, steps: int = 40) -> str:
    """Tracks beside each other, `step` apart, and all of them off by `shift`."""
    lines = [f"{k},{t},{t},{k * step + shift:g}\n" for t in range(steps) for k in range(tracks)]
    return "id,t,x,y\n" + "".join(lines)


def test_a_cutoff_is_suggested_with_its_reason(invoke: Run, write: Write) -> None:
    """By hand: every error is 0.3, three times that 0.9, which becomes 1."""
    truth = write("t.csv", rows(100, 0, 4))
    near = "3 times the median distance (0.3), rounded up; 100 % of the ground-truth states have"
    done = invoke("inspect", truth, write("e.csv", rows(100, 0.3, 4)), "--unit", "m")
    lines = " ".join(done.out.split())
    assert f"suggested cutoff c = 1 m: {near} an estimate nearer than this" in lines
    assert max(map(len, done.out.splitlines())) <= 80
    crowd = write("t.csv", rows(0.8, 0, 4)), write("e.csv", rows(0.8, 0.3, 4))
    document = json.loads(invoke("inspect", *crowd, "--format", "json").out)
    suggested = document["both"]["nearest"]["suggested"]
    assert suggested["cutoff"] == 1
    assert suggested["reason"].endswith("and 100 % have another true object nearer than this")
    half = write("t.csv", rows(100, 0, 4)), write("e.csv", rows(100, 0.3, 2))
    found = json.loads(invoke("inspect", *half, "--format", "json").out)["both"]["nearest"]
    assert found["suggested"] is None  # half of the truths have no estimate at all
    same = json.loads(invoke("inspect", truth, truth, "--format", "json").out)
    assert same["both"]["nearest"]["suggested"] is None


def test_the_picture_of_what_was_read(invoke: Run, write: Write, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    iso = "id,t,x\na$b$,2024-01-01T00:00:00Z,0\na$b$,2024-01-01T00:00:02Z,1\n"
    empty = write("n.csv", "id,t,x\n")
    for name, files in (
        ("plane.png", (write("t.csv", TRUTH), write("e.csv", ESTIMATE))),
        ("iso.svg", (write("i.csv", iso), empty)),
        ("one.pdf", (empty,)),
    ):
        target = tmp_path / name
        done = invoke("inspect", *files, "--plot", str(target))
        assert done.status == 0, done.err
        assert f"picture in {target}" in done.err
        first = target.read_bytes()
        assert first[:4] in (b"\x89PNG", b"<?xm", b"%PDF")
        invoke("inspect", *files, "--plot", str(target), "-q")
        assert target.read_bytes() == first
    for path, what in (
        ("seen.jpg", "must end in .png, .svg, .pdf"),
        ("no/seen.png", "there is no such folder"),
    ):
        refused = invoke("inspect", write("t.csv", TRUTH), "--plot", str(tmp_path / path))
        assert (refused.status, refused.out) == (2, "")
        assert what in refused.err


def test_lines_break_where_a_track_has_a_hole() -> None:
    """By hand: TRUTH without its second row b at 0; a is absent at 2, b at 1."""
    pytest.importorskip("matplotlib")
    states = np.full((4, 2, 2), np.nan)
    states[[0, 1, 3], 0] = [[0, 0], [1, 0], [4, 4]]
    states[[0, 2], 1] = [[9, 9], [9, 5]]
    made = draw_inspection(([("t.csv", Trajectories.from_array(states))], ""), STYLES["screen"])
    plane, presence = made.axes
    wanted = [0, 1, np.nan, 4, np.nan, 9, np.nan, 9]
    np.testing.assert_array_equal(plane.lines[0].get_xdata(), wanted)
    at = [0, 1, np.nan, 3, np.nan, 0, np.nan, 2]
    np.testing.assert_array_equal(presence.lines[0].get_xdata(), at)
    assert [label.get_text() for label in presence.get_yticklabels()] == ["0", "1"]


def test_a_map_has_equal_scales() -> None:
    """At 60 degrees a degree of longitude is half as long as one of latitude."""
    pytest.importorskip("matplotlib")
    states = np.array([[[59.0, 10.0]], [[61.0, 12.0]]])
    side = Trajectories.from_array(states, ("lat", "lon"))
    plane = draw_inspection(([("t.csv", side)], ""), STYLES["screen"]).axes[0]
    assert plane.get_aspect() == pytest.approx(2)


def test_settings_of_other_verbs_do_not_disturb(invoke: Run, write: Write) -> None:
    files = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    ours = write("ours.toml", 'cutoff = 2\nsolver = "exact"\nformat = "markdown"\n')
    answer = invoke("inspect", *files, "--config", ours)
    assert "c = 2:" in answer.out
    assert f"settings from {ours}: cutoff = 2\n" in answer.err
    write("tgospa-eval.toml", "cutof = 2\n")
    assert "unknown key" in invoke("inspect", *files).err
