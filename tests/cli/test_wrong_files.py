"""What users hand in by mistake, and what they are told: one message, no number."""

import bz2
from pathlib import Path

import pytest
from answer import Run, Write

TABLE = "id,t,x,y,class\n1,0,0,0,car\n1,1,0,0,car\n"
MOT = "1,1,10,20,30,40,1,-1,-1,-1\n2,1,10,20,30,40,1,-1,-1,-1\n"
KITTI = "0 1 Car 0 0 -1.8 100 50 140 80 2.0 1.8 4.4 {} {} {} -2.1\n"


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (["--class", "van"], ["--class", '"van"', 'there are "car"']),
        (["--time", "5:9"], ["--time", "no row is left"]),
        (["--class", "car", "--region", "x=5:"], ["--class and --region", "no row is left"]),
    ],
)
def test_a_selection_of_nothing_is_no_perfect_score(
    invoke: Run, write: Write, options: list[str], parts: list[str]
) -> None:
    path = write("t.csv", TABLE)
    answer = invoke(path, path, *options)
    assert (answer.status, answer.out) == (2, "")
    assert len(answer.err.splitlines()) == 1
    for part in parts:
        assert part in answer.err


def test_no_common_step_is_no_perfect_score(invoke: Run, write: Write) -> None:
    files = write("t.csv", TABLE), write("e.csv", "id,t,x,y\n1,7,0,0\n")
    answer = invoke(*files, "--grid", "common", "--outage", "none")
    assert (answer.status, answer.out) == (2, "")
    assert "none of 3 steps is left" in answer.err
    answer = invoke(*files, "--grid", "common", "--format", "json")
    assert '"missed": 0.0' not in answer.out  # the estimate is silent all the time
    assert invoke(*files).status == 0
    assert invoke(write("n.csv", "id,t,x\n"), write("m.csv", "id,t,x\n")).status == 0


def test_one_side_without_rows_is_said(invoke: Run, write: Write) -> None:
    files = write("t.csv", TABLE), write("e.csv", TABLE.replace("car", "van"))
    answer = invoke(*files, "--class", "car", "-q")
    assert answer.status == 0
    answer = invoke(*files, "--class", "car")
    assert "warning: no row of the estimate is evaluated" in answer.err


@pytest.mark.parametrize("format_", ["motchallenge", "kitti"])
def test_places_that_are_not_known_are_absent(invoke: Run, write: Write, format_: str) -> None:
    unknown = MOT if format_ == "motchallenge" else KITTI.format(-1000, -1000, -1000)
    known = MOT[:-9] + "3,4,5\n" if format_ == "motchallenge" else KITTI.format(3, 4, 5) + unknown
    columns = ("--columns", "x,y,z")
    answer = invoke(*[write("u.txt", unknown)] * 2, *columns)
    assert (answer.status, answer.out) == (3, "")
    assert "u.txt: no row has a place in space" in answer.err
    if format_ == "kitti":
        known = known.replace("\n0 1", "\n1 1")
    answer = invoke(*[write("k.txt", known)] * 2, *columns, "-c", "2")
    assert "1 row without a place in space" in answer.err
    assert "localisation             0" in answer.out


@pytest.mark.parametrize(
    ("name", "content", "options", "parts"),
    [
        ("flag.txt", MOT.replace("40,1", "40,yes"), [], ["line 1", "instead of a", "format"]),
        ("commas.txt", KITTI.format(1, 2, 3).replace(" ", ","), [], ["instead of a", "format"]),
        ("t.csv.bz2", bz2.compress(TABLE.encode()), [], ["bzip2", "unpack"]),
        ("t.csv", TABLE.encode("utf-32"), [], ["UTF-32", "UTF-8"]),
        ("/dev/zero", None, [], ["/dev/zero: is a device"]),
        ("mot.txt", MOT.replace("30,40", "-30,40"), [], ["line 1", '"width"', "-30", ">= 0"]),
        ("t.csv", "ID,Id,t,x\n1,1,0,0\n", [], ['"ID" and "Id"', "--truth-columns id=ID"]),
        ("t.csv", "id,t,x,y\n", ["--columns", "z"], ["no column for z", "-columns z=HEADER"]),
        ("mot.txt", MOT, ["--class", "1"], ["rows of this length have none"]),
        (
            "t.csv", "id,t,x,y\n1,0,0,0\n1,1,0,363\n",
            ["--distance", "haversine", "--columns", "lat=x,lon=y"],
            ["line 3", '"lon"', "363 must be from -360 to 360 degrees"],
        ),
    ],
)  # fmt: skip
def test_refused(
    invoke: Run,
    write: Write,
    name: str,
    content: str | bytes | None,
    options: list[str],
    parts: list[str],
) -> None:
    path = name if content is None else write(name, content)
    answer = invoke(path, path, *options)
    assert (answer.status, answer.out) == (3, "")
    for part in (name, *parts):
        assert part in answer.err


def test_a_comma_behind_the_last_field(invoke: Run, write: Write) -> None:
    path = write("mot.txt", MOT.replace("\n", ",\n"))
    assert invoke(path, path).status == 0


def test_two_folders_of_parts_that_overlap(
    invoke: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for side in ("a", "b"):
        Path(side).mkdir()
        for part, times in (("1", (0, 2)), ("2", (1, 3))):
            rows = "".join(f"{part},{t},{t},{t}\n" for t in times)
            Path(side, f"{part}.csv").write_text(f"id,t,x,y\n{rows}")
    whole = "if each folder is one recording: tgospa-eval a b --memory 4GB"
    assert invoke("a", "b").err.splitlines()[-1] == whole
    assert invoke(*whole.split()[-4:]).status == 0


def test_folders_of_sequences(invoke: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("A-1", "A-2"):
        for path in (f"gt/{name}/gt/gt.txt", f"gt/{name}/det/det.txt", f"res/{name}.txt"):
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            Path(path).write_text(MOT)
    one = "type: tgospa-eval gt/A-1/gt/gt.txt res/A-1.txt"
    many = (
        "for all 2: tgospa-eval batch --truth 'gt/{name}/gt/gt.txt' --estimate 'res/{name}.txt' "
        "-o results"
    )
    suite = '[[pair]] with truth = "gt/{name}/gt/gt.txt" and estimate = "res/{name}.txt"'
    for paths in (("gt", "res"), ("gt/*/gt/*.txt", "res/*.txt"), (".", "res/")):
        answer = invoke(*paths)
        assert (answer.status, answer.out) == (3, "")
        for part in (one, many, suite):
            assert part in answer.err
    first, said = invoke("gt/A-1", "res/A-1.txt").err.splitlines()
    assert (first, said) == ("gt/A-1: is a folder, not a file; in it: gt/gt.txt", one)
    assert "type: tgospa-eval gt/A-2/gt/gt.txt res/A-2.txt" in invoke("gt", "res/A-2.txt").err
    for k in range(10):
        Path(f"gt/{k}.txt").write_text(MOT)
        Path(f"res/{k}.txt").write_text(MOT)
    assert "for all 10: tgospa-eval batch --truth 'gt/{name}.txt'" in invoke("gt", "res").err
    monkeypatch.chdir("res")
    answer = invoke("*.csv", "A-1.txt")
    assert (
        "*.csv: no file matches this pattern; this folder has 0.txt, 1.txt, 2.txt and" in answer.err
    )
    assert "for one of them: tgospa-eval inspect 0.txt" in invoke("inspect", ".").err
