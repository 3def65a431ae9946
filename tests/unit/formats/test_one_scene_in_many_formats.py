"""Files of several fields hold one scene: its numbers, ids, times and classes are those of CSV."""

import csv
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import SAMPLES

from tgospa_eval import evaluate, read_trajectories
from tgospa_eval.formats import ReadOptions, read

Invoke = Callable[..., Any]
FOLDER = SAMPLES / "formats"
BY_LIBRARIES = (".mat",)
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
        (("003660002", "003660001"), ["line 3", "particles", "--on-duplicate"]),
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
