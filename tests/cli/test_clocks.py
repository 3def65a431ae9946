"""Times as people have them: dates of days and months, epochs, GPS weeks, zones, two columns."""

import json
import re
import shutil
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from answer import Invoke

from tgospa_eval import ConfigError, InputError, TgospaWarning, evaluate

UTC = ["2025-04-03T10:00:00Z", "2025-04-03T10:00:10.5Z"]
METRIC = {"cutoff": 5, "switch_penalty": 1}


def side(**columns: object) -> pd.DataFrame:
    return pd.DataFrame({"id": "002190001", "x": [0.0, 1.0], "y": 0.0, **columns})


WRITTEN = {
    "day first": (
        {"t": ["03/04/2025 12:00:00.0", "03/04/2025 12:00:10.5"]},
        {"format": "%d/%m/%Y %H:%M:%S.%f", "zone": "Europe/Copenhagen"},
    ),
    "month first": (
        {"t": ["04/03/2025 10:00:00.0", "04/03/2025 10:00:10.5"]},
        {"format": "%m/%d/%Y %H:%M:%S.%f", "zone": "UTC"},
    ),
    "with its zone": (
        {"t": ["3 Apr 2025 05:00:00.0 -0500", "3 Apr 2025 05:00:10.5 -0500"]},
        {"format": "%d %b %Y %H:%M:%S.%f %z"},
    ),
    "seconds": ({"t": [1743674400, 1743674410.5]}, {"format": "s"}),
    "milliseconds": ({"t": [1743674400000, 1743674410500]}, {"format": "ms"}),
    "nanoseconds": ({"t": [1743674400 * 10**9, 1743674410500000000]}, {"format": "ns"}),
    "guessed seconds": ({"t": [1743674400, 1743674410.5]}, {}),
    "guessed milliseconds": ({"t": [1743674400000, 1743674410500]}, {}),
    "guessed microseconds": ({"t": [1743674400 * 10**6, 1743674410500000]}, {}),
    "ISO of a zone": (
        {"t": ["2025-04-03T12:00:00", "2025-04-03 12:00:10.5"]},
        {"zone": "Europe/Copenhagen"},
    ),
    "GPS": ({"week": [2360, 2360], "tow": [381618.0, 381628.5]}, {"format": "gps"}),
    "date and time": (
        {"week": ["03-04-2025", "03-04-2025"], "tow": ["10:00:00.0", "10:00:10.5"]},
        {"format": "%d-%m-%Y %H:%M:%S.%f", "zone": "UTC"},
    ),
}


@pytest.mark.parametrize("way", ["table", "csv"])
@pytest.mark.parametrize("name", WRITTEN)
def test_times_are_those_of_utc(name: str, way: str, tmp_path: Path) -> None:
    columns, form = WRITTEN[name]
    made = side(**columns)
    options = {f"truth_time_{key}": value for key, value in form.items()}
    if "week" in columns:
        options["truth_columns"] = "t=week+tow"
    given: object = made
    if way == "csv":
        given = tmp_path / "truth.csv"
        made.to_csv(given, index=False, float_format="%.1f")
    for one, other, role in (("truth", "estimate", 0), ("estimate", "truth", 1)):
        own = {key.replace("truth", one): value for key, value in options.items()}
        pair = (given, side(t=UTC))[:: 1 - 2 * role]
        result = evaluate(*pair, **METRIC, **own)
        assert result.total == 0, (one, other)
        assert result.sizes["steps"] == 2


def test_dates_that_may_be_either_are_never_guessed() -> None:
    for text, ways in (("03/04/2025 12:00", 2), ("13/04/2025", 1), ("03.04.2025", 2)):
        with pytest.raises(InputError) as error:
            evaluate(side(t=[text, text]).head(1), side(t=UTC), **METRIC)
        assert str(error.value).count(" reads 2025-") == ways
        assert "reads 2025-04-" in str(error.value)


@pytest.mark.parametrize(
    ("times", "form", "message"),
    [
        (["2025-10-26T02:30:00"] * 2, {"zone": "Europe/Copenhagen"}, "is ambiguous or missing in"),
        (["2025-03-30T02:30:00"] * 2, {"zone": "Europe/Copenhagen"}, "is ambiguous or missing in"),
        (UTC, {"zone": "Mars"}, "unknown time zone"),
        (UTC, {"format": "fortnights"}, "must be a format such as"),
        (UTC, {"format": "%d/%m/%Y"}, "does not fit"),
        (["1", "x"], {"format": "s"}, '"x" does not fit'),
        (
            ["2025-04-03T10:00:00", "2025-04-03T10:00:10"],
            {},
            'name the zone of the truth, truth_time_zone="UTC" or another',
        ),
        ([17, 18], {}, "give both as ISO times"),
    ],
)
def test_wrong_times_get_a_message(times: list[object], form: dict[str, str], message: str) -> None:
    options = {f"truth_time_{key}": value for key, value in form.items()}
    made = side(t=times)
    made["id"] = ["a", "b"]
    with pytest.raises((ConfigError, InputError), match=message):
        evaluate(made, side(t=UTC), **METRIC, **options)


def test_leap_seconds_of_gps() -> None:
    """At the end of 2016 UTC fell one more second behind; in 1980 there was none."""
    for week, second, text in (
        (0, 0, "1980-01-06T00:00:00Z"),
        (1930, 16, "2016-12-31T23:59:59Z"),
        (1930, 18, "2017-01-01T00:00:00Z"),
    ):
        made = pd.DataFrame({"id": 1, "week": [week], "tow": [second], "x": 0.0})
        other = pd.DataFrame({"id": 1, "t": [text], "x": 0.0})
        options = {"truth_columns": "t=week+tow", "truth_time_format": "gps"}
        assert evaluate(made, other, **METRIC, **options).total == 0, text


@pytest.mark.parametrize("way", ["table", "csv", "parquet"])
@pytest.mark.parametrize(
    ("names", "parts"),
    [
        (("stamp.secs", "stamp.nsecs"), ([1743674400, 1743674410], [0, 500000000])),
        (("sec", "usec"), ([1743674400, 1743674410], [0, 500000])),
        (("sec", "msec"), ([1743674400, 1743674410], [0, 500])),
        (("first", "second"), ([1743674400, 1743674410], [0, 500000000])),
    ],
)
def test_seconds_and_their_fraction_are_one_time(
    names: tuple[str, str], parts: tuple[list[int], list[int]], way: str, tmp_path: Path
) -> None:
    made = side(**dict(zip(names, parts, strict=True)))
    given: object = made
    if way == "csv":
        given = tmp_path / "truth.csv"
        made.to_csv(given, index=False)
    elif way == "parquet":
        given = tmp_path / "truth.parquet"
        made.to_parquet(given)
    mapped = {"truth_columns": f"t={'+'.join(names)}"}
    for other in (UTC, [1743674400, 1743674410.5], [1743674400 * 10**9, 1743674410500000000]):
        result = evaluate(given, side(t=other), **METRIC, **mapped)
        assert (result.total, result.judged["steps"]) == (0, 2)


def test_seconds_of_a_simulation_and_fractions_of_no_second() -> None:
    mapped = {"truth_columns": "t=sec+nsec"}
    truth = side(sec=[0, 1], nsec=[100000000, 5])
    assert evaluate(truth, side(t=[0.1, 1.000000005]), **METRIC, **mapped).total == 0
    for columns in ({"sec": [1, 2], "nsec": [0, 10**9]}, {"sec": [20250403] * 2, "nsec": ["", 1]}):
        with pytest.raises(InputError):
            evaluate(side(**columns), side(t=[1, 2]), **METRIC, **mapped)
    two = side(date=[20250403] * 2, time=[100000000, 235959999])
    with pytest.raises(InputError, match='"20250403 235959999" is not a second and its fraction'):
        evaluate(two, side(t=[1, 2]), **METRIC, truth_columns="t=date+time")


def night(count: int = 20, *, form: str = "number", switch: bool = False, skip: int = 0) -> str:
    """Two objects from ten seconds before midnight on, in order of time."""
    lines = ["id,t,x,y"]
    for k in range(skip, count):
        second = (86_390 + k) % 86_400
        clock = f"{second // 3600:02}:{second // 60 % 60:02}:{second % 60:02}"
        t = {"number": second, "ms": second * 1000, "text": clock}[form]
        lines += [f"{3 - i if switch and k >= 12 else i},{t},{k},{10 * i}" for i in (1, 2)]
    return "\n".join([*lines, ""])


@pytest.mark.parametrize("form", ["number", "ms", "text"])
def test_times_of_day_go_over_midnight(form: str, invoke: Invoke, tmp_path: Path) -> None:
    """The tracks are exchanged once, two seconds after midnight: which was two switches."""
    paths = [str(tmp_path / name) for name in ("truth.csv", "estimate.csv")]
    for path, switch in zip(paths, (False, True), strict=True):
        Path(path).write_text(night(form=form, switch=switch))
    asked = [*paths, "-c", "5", "-g", "1", "--format", "json"]
    if form == "text":
        asked += [f"--{role}-time-format=%H:%M:%S" for role in ("truth", "estimate")]
    answer = invoke(*asked)
    assert json.loads(answer.out)["total"] == pytest.approx(4)
    noon = "43200000" if form == "ms" else "43200"
    assert f"line 22: the time of day jumps back, as at midnight; --day-begins {noon}" in answer.err
    answer = invoke(*asked, "--day-begins", noon)
    document = json.loads(answer.out)
    assert document["total"] == pytest.approx(2)
    assert document["parameters"]["day_begins"] == float(noon)
    assert "midnight" not in answer.err
    Path(paths[1]).write_text(night(form=form, skip=12))  # a tracker that starts after midnight
    document = json.loads(invoke(*asked, "--day-begins", noon).out)
    assert (document["counts"]["missed"], document["counts"]["false"]) == (24, 0)


@pytest.mark.parametrize("date", ["2026-03-0{}", "0{}/03/2026"])
def test_times_of_day_beside_dates(date: str, invoke: Invoke, tmp_path: Path) -> None:
    rows = [f"1,{date.format(1 + k)},12:00:{10 * k:02},{10 * k},0\n" for k in range(2)]
    path = tmp_path / "a.csv"
    path.write_text("".join(["id,date,time,x,y\n", *rows]))
    answer = invoke(str(path), str(path), "-c", "5", "-g", "1")
    text = 'a time of day: "12:00:00"; --truth-columns t=date+time reads it with its date'
    assert text in answer.err
    form = () if "-" in date else ("--truth-time-format", "%d/%m/%Y %H:%M:%S")
    assert ("'%d/%m/%Y %H:%M:%S' reads 2026-03-01" in answer.err) == bool(form)
    form += tuple(item.replace("truth", "estimate") for item in form)
    answer = invoke(str(path), str(path), "-c", "5", "-g", "1", "--columns", "t=date+time", *form)
    assert (answer.status, "2 steps" in answer.out) == (0, True), answer.err
    table = pd.read_csv(path)
    with pytest.raises(InputError, match=r"columns=\('t=date\+time',\) reads it with its date"):
        evaluate(table, table, cutoff=5, switch_penalty=1)
    with pytest.raises(InputError, match="give the format"):
        evaluate(path, table.assign(date=[[1], [2]]), 5, 2, 1, truth_columns=("t=date+time",))


def test_what_is_no_time_of_day(invoke: Invoke, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for rows in (  # unsorted, a day of two objects one after the other, dates
        ["1,1,0", "1,80000,0", "1,2,0", "1,80001,1"],
        ["1,10,0", "1,40000,1", "1,86000,2", "2,10,0", "2,40000,1", "2,86000,2"],
        ["1,2025-04-03T23:59:59,0", "1,2025-04-03T00:00:00,1"],
    ):
        path.write_text("\n".join(["id,t,x", *rows, ""]))
        answer = invoke(str(path), str(path))
        assert (answer.status, "midnight" in answer.err) == (0, False)
    answer = invoke(str(path), str(path), "--day-begins", "43200")
    assert answer.status == 0  # of one day: harmless
    path.write_text("id,t,x\n1,10,0\n1,90000,1\n")
    answer = invoke(str(path), str(path), "--day-begins", "43200")
    assert answer.status == 3
    assert "--day-begins 43200 is for times of day, below 86,400, but some times are" in answer.err


@pytest.mark.parametrize("frames", [range(12), [0.5, 3.25, 40.0]])
def test_frames_are_no_times_of_day(
    frames: Sequence[float], invoke: Invoke, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["id,frame,x", *(f"1,{k},{k}" for k in frames), ""]))
    answer = invoke(str(path), str(path), "--day-begins", "3")
    assert "a.csv: --day-begins 3 makes the recording longer; leave it out" in answer.err
    assert "recording" not in invoke(str(path), str(path), "--day-begins", "43200").err


@pytest.mark.parametrize("digits", [8, 12, 14, 17])
@pytest.mark.parametrize("zone", ["", "Z"])
@pytest.mark.parametrize("way", [1, -1])
def test_dates_as_numbers_beside_dates(
    digits: int, zone: str, way: int, invoke: Invoke, tmp_path: Path
) -> None:
    stamps = [f"2026-03-0{k}T23:59:55.123" for k in (1, 2, 3)]
    length = {8: 10, 12: 16, 14: 19, 17: 23}[digits]
    stamps = [stamp[:length] + zone * (digits > 8) for stamp in stamps]
    numbers = ["".join(filter(str.isdigit, stamp)) for stamp in stamps]
    paths = [tmp_path / name for name in ("numbers.csv", "dates.csv")]
    for path, times in zip(paths, (numbers, stamps), strict=True):
        path.write_text("\n".join(["id,t,x", *(f"1,{t},0" for t in times), ""]))
    files = [str(path) for path in paths[::way]]
    answer = invoke(*files)
    assert answer.status == 3
    named = re.search(r"read the dates with (--[^\n]*?)( or another)?\n", answer.err)
    assert named is not None, answer.err
    assert "3 of 3 steps" in invoke(*files, *named[1].split()).err
    assert f"times such as {numbers[0]} look" in invoke(str(paths[0]), str(paths[0])).err


def test_an_image_is_no_number_with_its_unit(invoke: Invoke, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("id,frame,x\n1,000000.jpg,0\n")
    answer = invoke(str(path), str(path))
    assert '"000000.jpg"; write a number or' in answer.err


def test_decimals_that_differ_by_rounding_are_one_step(invoke: Invoke, tmp_path: Path) -> None:
    paths = []
    for name, times in (("a", [k / 10 for k in range(20)]), ("b", [k * 0.1 for k in range(20)])):
        paths.append(str(tmp_path / f"{name}.csv"))
        rows = [f"1,{t!r},{k}" for k, t in enumerate(times)]
        Path(paths[-1]).write_text("\n".join(["id,t,x", *rows, ""]))
    answer = invoke(*paths, "--format", "json")
    assert json.loads(answer.out)["total"] == 0
    assert "20 of 20 steps are in both files" in answer.err
    assert "7 pairs of timestamps were joined, which differ by rounding only" in answer.err
    folders = []
    for path in map(Path, paths):
        folders.append(str(tmp_path / path.stem))
        Path(folders[-1]).mkdir()
        shutil.copy(path, folders[-1])
    in_parts = invoke(*folders, "--memory", "1GB", "--format", "json")
    assert json.loads(in_parts.out)["total"] == 0
    Path(paths[1]).write_text(Path(paths[1]).read_text().replace("0.2,", "0.20000001,"))
    assert "1 pair of timestamps is nearly the same" in invoke(*paths).err


def test_steps_that_count_from_another_number_are_told() -> None:
    truth = np.zeros((4, 1, 2)) + np.arange(4)[:, None, None]
    with pytest.warns(
        TgospaWarning, match=r'steps="1:4": rows at 0 are left out.* steps="0:3" includes all rows'
    ):
        evaluate(truth, truth + 0.1, **METRIC, steps="1:4")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for steps in ("0:3", "1:2", "0:9"):
            evaluate(truth, truth + 0.1, **METRIC, steps=steps)


@pytest.mark.parametrize(
    ("stamps", "form"),
    [
        (["20260301120058", "20260301120059", "20260301120100"], "%Y%m%d%H%M%S"),
        (["20260301120058.5", "20260301120059.5", "20260301120100.5"], "%Y%m%d%H%M%S.%f"),
        (["20260227", "20260228", "20260301"], "%Y%m%d"),
        (["20260227", "20260228", "20260229"], ""),  # no such day
        ([f"12{k // 60:02}{k % 60:02}" for k in range(58, 130, 6)], "%H%M%S"),
        ([f"12{k // 60:02}{k % 60:02}.5" for k in range(58, 130, 6)], "%H%M%S.%f"),
        ([f"{k // 60}{k % 60:02}" for k in range(58, 130, 6)], ""),  # or frames
        (["58", "59", "60"], ""),
        (["0", "50", "100", "150"], ""),
        (["1743674400000", "1743674410500", "1743674411000"], ""),
    ],
)
def test_dates_that_are_numbers(invoke: Invoke, stamps: list[str], form: str) -> None:
    Path("d.csv").write_text("id,t,x\n" + "".join(f"a,{t},0\n" for t in stamps), encoding="utf-8")
    ways = [f"--{side}-time-format {form}" for side in ("truth", "estimate")]
    answer = invoke("d.csv", "d.csv", "--format", "json")
    assert all((way in answer.err) is bool(form) for way in ways), answer.err
    if form:
        answer = invoke("d.csv", "d.csv", *" ".join(ways).split(), "--format", "json")
        assert (answer.status, "look like dates" in answer.err) == (0, False)
        assert json.loads(answer.out)["counts"]["missed"] == 0
