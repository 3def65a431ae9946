"""Files of several fields hold one scene: its numbers, ids, times and classes are those of CSV."""

import csv
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Invoke
from checkout import SAMPLES

from tgospa_eval import InputError, evaluate, read_trajectories
from tgospa_eval.formats import ReadOptions, read

FOLDER = SAMPLES / "formats"
BY_LIBRARIES = (".mat", ".feather")
"""Files whose bytes depend on the versions of libraries."""


def plain(name: str) -> list[dict[str, str]]:
    """Rows of the CSV file of the scene."""
    with (FOLDER / f"{name}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def same_scene(result: Any, scene: Any) -> None:
    """The same number, parts, counts and steps as of the CSV files."""
    for name in ("total", "lower_bound", "localisation", "missed", "false", "switch", "counts"):
        assert getattr(result, name) == getattr(scene, name)
    assert result.per_step["total"].tolist() == scene.per_step["total"].tolist()


@pytest.fixture(scope="module")
def scene() -> Any:
    return evaluate(str(FOLDER / "truth.csv"), str(FOLDER / "estimate.csv"), 10, 2, 5)


def test_the_script_makes_the_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for library in ("h5py", "pyarrow"):
        pytest.importorskip(library)
    monkeypatch.setattr(sys, "argv", ["make.py", str(tmp_path)])
    runpy.run_path(str(FOLDER / "make.py"), run_name="__main__")
    made = {path.relative_to(tmp_path) for path in tmp_path.rglob("*.*") if path.is_file()}
    kept = {path.relative_to(FOLDER) for path in FOLDER.rglob("*.*") if path.is_file()}
    assert made == {path for path in kept if path.suffix not in (".py", ".pyc")}
    for path in made:
        if path.suffix in BY_LIBRARIES:
            made, kept = (read(folder / path).trajectories for folder in (tmp_path, FOLDER))
            assert np.array_equal(made.state, kept.state)
        else:
            assert (tmp_path / path).read_bytes() == (FOLDER / path).read_bytes()


@pytest.mark.parametrize(
    ("truth", "estimate", "metres"),
    [("ais", "vessel_tracks", 50), ("adsb", "aircraft_tracks", 500)],
)
def test_ships_and_aircraft(truth: str, estimate: str, metres: int, scene: Any) -> None:
    files = [str(FOLDER / f"{name}.csv") for name in (truth, estimate)]
    settings = {"cutoff": 10 * metres, "switch_penalty": 5 * metres, "distance": "haversine"}
    result = evaluate(*files, **settings)
    # The projection bends a plane of 10 or 100 km a little.
    assert result.tgospa / metres == pytest.approx(scene.tgospa, rel=2e-3)
    assert result.counts == scene.counts
    side = read_trajectories(files[0])
    rows = plain("truth")
    ids = {"ais": "00366{:04}", "adsb": "00a{:03x}"}[truth]
    assert side.ids.tolist() == [ids.format(k) for k in (1, 2, 3, 4)]
    times = {"ais": "2024-06-01T12:{:02}:00", "adsb": "{}"}[truth]
    seconds = {"ais": 1, "adsb": 10}[truth]
    begin = {"ais": 0, "adsb": 1_717_243_200}[truth]
    assert [str(time) for time in side.shown] == [
        times.format(begin + seconds * step) for step in sorted({int(row["t"]) for row in rows})
    ]
    assert read(files[0]).left_out == {{"ais": "no place", "adsb": "blank"}[truth]: 1}


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (("28.507614", "128.5"), ["line 2", '"lat"', "128.5 must be from -90 to 90 degrees"]),
        (("28.507614", "91.0"), ["line 2", '"lat"', "91 must be"]),
        (("-94.153537", "361"), ["line 2", '"lon"', "from -360 to 360"]),
        (("2024-06-01T12:01:00", "2024-06-01T12:01:00Z"), ["mixed kinds of time"]),
        (("2024-06-01T12:01:00", "01/06/2024 12:01"), ["line 2", "BaseDateTime", "not a time"]),
        (("003660001", ""), ["line 2", "MMSI", "blank id"]),
        (("003660002", "003660001"), ["line 3", "particles", "on-duplicate"]),
        (("28.507614", "28.5N"), ["line 2", "LAT", "not a number"]),
    ],
)
def test_broken_ais(invoke: Invoke, tmp_path: Path, change: tuple[str, str], parts: list[str]):
    path = tmp_path / "a.csv"
    path.write_text((FOLDER / "ais.csv").read_text().replace(*change, 1))
    answer = invoke(str(path), str(FOLDER / "vessel_tracks.csv"), "--distance", "haversine")
    assert (answer.status, answer.out) == (3, "")
    for part in parts:
        assert part in answer.err


def test_only_latitude_91_with_longitude_181_is_unknown(write: Callable[..., str]) -> None:
    path = write("a.csv", "MMSI,t,lat,lon\n1,0,91,181\n1,1,90,181\n1,2,91,180\n1,3,0,181\n")
    assert read(path).left_out == {"no place": 1}
    assert read(path, ReadOptions(columns=("x=lon", "y=lat"))).left_out == {}


@pytest.mark.parametrize("format_", [None, "argoverse"])
def test_argoverse(scene: Any, invoke: Invoke, format_: str | None) -> None:
    pytest.importorskip("pyarrow")
    files = [str(FOLDER / f"{name}.feather") for name in ("annotations", "argoverse_tracks")]
    assert evaluate(*files, 10, 2, 5).total == scene.total
    given = ["--truth-format", format_, "--estimate-format", format_] if format_ else []
    asked = ("-c", "10", "-g", "5", "--format", "csv", *given)
    answer = invoke(*files, *asked)
    plainly = invoke(str(FOLDER / "truth.csv"), str(FOLDER / "estimate.csv"), *asked[:6])
    start, step = 315_967_376_959_702_000, 99_999_951
    rows = [line.split(",") for line in answer.out.splitlines()[1:]]
    want = [line.split(",") for line in plainly.out.splitlines()[1:]]
    assert [row[0] for row in rows] == [str(start + step * int(row[0])) for row in want]
    assert [row[1:] for row in rows] == [row[1:] for row in want]
    options = ReadOptions(by_class=True, attributes=("num_interior_pts",))
    reading = read(files[0], options, format=format_)
    assert (reading.format, reading.trajectories.columns) == ("argoverse", ("x", "y"))
    assert reading.headers["x"] == "tx_m"
    assert reading.classes == ("BOX_TRUCK", "PEDESTRIAN", "REGULAR_VEHICLE")
    assert set(reading.trajectories.attributes["num_interior_pts"]) == {12}
    assert all(len(name) == 36 for name in reading.trajectories.ids)
    space = read(files[1], ReadOptions(columns=("x", "y", "z"))).trajectories
    assert set(space.state[:, 2]) == {0.6}
    turned = read(files[1], ReadOptions(columns=("y", "x"))).trajectories
    assert np.array_equal(turned.state, space.state[:, 1::-1])
    answer = invoke(files[0], files[1], *asked[:4], "--region", "x=0:1", "-q")
    assert answer.status == 2
    mixed = invoke(str(FOLDER / "annotations.feather"), str(FOLDER / "estimate.csv"))
    assert (mixed.status, "0 of 24 steps" in mixed.err) == (0, True)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tx_m": None}, "tx_m"),
        ({"track_uuid": None}, "track_uuid"),
        ({"timestamp_ns": 2.5}, "at t 2.5"),
        ({"tx_m": "far"}, "not a number"),
        ({"ty_m": np.inf}, "infinite"),
    ],
)
def test_broken_argoverse(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    path = tmp_path / "annotations.feather"
    frame = pd.read_feather(FOLDER / "annotations.feather")
    for name, value in change.items():
        frame = frame.drop(columns=name) if value is None else frame.assign(**{name: value})
    frame.to_feather(path)
    with pytest.raises(InputError, match=message):
        read(path, format="argoverse")
