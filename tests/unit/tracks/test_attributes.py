"""Columns beside the state: read on request, in every way, taken along by what edits rows."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tgospa_eval import ConfigError, InputError, Trajectories, read_trajectories
from tgospa_eval.explain.candidates import AddedRows, Edit, edited
from tgospa_eval.formats import ReadOptions, read
from tgospa_eval.formats.frames import from_frame
from tgospa_eval.formats.text import lines
from tgospa_eval.formats.write import csv_text, npz_bytes, parquet_bytes
from tgospa_eval.tracks.alignment import TimeMatching, align
from tgospa_eval.tracks.trajectories import Attributes

TABLE = pd.DataFrame(
    {
        "id": ["b", "a", "b", "a", "c"],
        "t": [1, 0, 0, 1, 2],
        "x": [1.0, 2.0, 3.0, 4.0, np.nan],
        "seen": [0.25, np.nan, 1.0, 0.5, 0.0],
        "sensor": ["radar", "lidar", "", "radar", "radar"],
        "class": ["car", "van", "car", "van", "van"],
    }
)
ASKED = ("seen", "sensor", "class", "id", "t", "x", "nowhere")
# In the order of (t, id); the last row has no state.
SEEN = {
    "seen": [np.nan, 1.0, 0.5, 0.25],
    "sensor": ["lidar", "", "radar", "radar"],
    "class": ["van", "car", "van", "car"],
    "id": ["a", "b", "a", "b"],
    "t": [0.0, 0.0, 1.0, 1.0],
    "x": [2.0, 3.0, 4.0, 1.0],
}


def plain(attributes: Attributes) -> dict[str, list[object]]:
    return {name: values.tolist() for name, values in attributes.items()}


def same(found: Attributes, wanted: dict[str, list]) -> None:
    assert set(found) == set(wanted)
    for name, values in wanted.items():
        np.testing.assert_array_equal(found[name], np.array(values, found[name].dtype), name)


WAYS = {
    "compiled": ("a.csv", lambda frame: frame.to_csv(index=False).encode()),
    "careful": ("a.csv", lambda frame: frame.to_csv(index=False, quoting=1).encode()),
    "bulk": ("a.csv", lambda frame: frame.to_csv(index=False).encode()),
    "commas": ("a.csv", lambda frame: frame.to_csv(index=False, sep=";", decimal=",").encode()),
    "parquet": ("a.parquet", lambda frame: frame.to_parquet(index=False)),
}


@pytest.mark.parametrize("way", WAYS)
def test_every_way_of_reading_has_them(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, write = WAYS[way]
    path = tmp_path / name
    path.write_bytes(write(TABLE))
    if way == "bulk":
        monkeypatch.setattr(lines, "scanner", None)
        monkeypatch.setattr(lines, "LARGE_BYTES", 0)
    options = ReadOptions(attributes=ASKED, by_class=way == "careful")
    reading = read(path, options)
    same(reading.trajectories.attributes, SEEN)
    assert reading.trajectories.offered == tuple(TABLE)
    assert not [text for text in reading.notices if "not used" in text]
    without = read_trajectories(path)
    assert (without.attributes, without.offered) == ({}, ())
    same(from_frame(TABLE, ReadOptions(attributes=ASKED)).trajectories.attributes, SEEN)


def test_challenge_formats_by_their_names(tmp_path: Path) -> None:
    mot = tmp_path / "gt.txt"
    mot.write_text("1,1,0,0,2,2,1,1,0.5\n1,2,0,0,2,2,0,1,0.5\n2,1,0,0,2,2,1,7,-1\n")
    asked = ("visibility", "class", "conf", "width")
    found = read_trajectories(mot, attributes=asked)
    assert plain(found.attributes) == {
        "visibility": [0.5, -1.0],
        "class": [1.0, 7.0],
        "conf": [1.0, 1.0],
        "width": [2.0, 2.0],
    }
    kitti = tmp_path / "labels.txt"
    kitti.write_text("0 3 Car 0.25 2 -10 0 0 4 4 1 1 1 1 1 5 0\n0 4 DontCare -1 -1 -10 0 0 4 4 " +
                     "-1 -1 -1 -1000 -1000 -1000 -10\n")  # fmt: skip
    found = read_trajectories(kitti, attributes=("occluded", "truncated", "class"))
    assert plain(found.attributes) == {"occluded": [2.0], "truncated": [0.25], "class": ["Car"]}


def test_rows_that_are_selected_joined_and_edited_keep_theirs() -> None:
    options = ReadOptions(attributes=("seen", "sensor"), by_class=True)
    whole = from_frame(TABLE, options)
    side = whole.trajectories
    assert plain(whole.of_class("car").attributes)["sensor"] == ["", "radar"]
    other = Trajectories.from_array(np.zeros((1, 1, 1)), ("x",))
    for grid, seen in (("union", [np.nan, 1, 0.5, 0.25]), ("estimate", [np.nan, 1])):
        same(
            {"seen": align(side, other, TimeMatching(grid=grid)).truth.attributes["seen"]},
            {"seen": seen},
        )
    # Track b becomes a track of its own from step 1 on; rows are added, one with an attribute.
    edit = Edit(pieces={1: ((0, 0, 1), (1, 1, 2))}, fresh=("d",))
    assert plain(edited(side, edit).attributes)["sensor"] == side.attributes["sensor"].tolist()
    state, at = np.zeros((2, 1)), np.array([2, 0])
    rows = AddedRows(
        step=at, track=np.array([0, 2]), state=state, attributes={"seen": np.arange(2.0)}
    )
    same(
        edited(side, Edit(fresh=("d",), added=rows)).attributes,
        {"seen": [np.nan, 1, 1, 0.5, 0.25, 0], "sensor": ["lidar", "", "", "radar", "radar", ""]},
    )
    assert plain(edited(side, Edit(pieces={0: ()})).attributes)["seen"] == [1.0, 0.25]


@pytest.mark.parametrize(
    ("ending", "write"),
    [("csv", lambda side: csv_text(side).encode()), ("npz", npz_bytes), ("parquet", parquet_bytes)],
)
def test_what_is_written_is_read_again(
    ending: str, write: Callable[[Trajectories], bytes], tmp_path: Path
) -> None:
    options = ReadOptions(attributes=("seen", "sensor", "x"))
    side = from_frame(TABLE, options).trajectories
    path = tmp_path / f"a.{ending}"
    path.write_bytes(write(side))
    same(read(path, options).trajectories.attributes, plain(side.attributes))


def test_given_by_hand_and_refused() -> None:
    rows = {"step": [0, 1], "track": [0, 0], "state": np.zeros((2, 1))}
    given = {**rows, "ids": np.array(["a"]), "times": np.arange(2), "columns": ("x",)}
    made = Trajectories(
        **given, attributes={"seen": [1, 0], "of": [None, "radar"], "day": [True] * 2}
    )
    assert plain(made.attributes) == {"seen": [1.0, 0.0], "of": ["", "radar"], "day": ["True"] * 2}
    with pytest.raises(ValueError, match="read-only"):
        made.attributes["seen"][0] = 2.0
    with pytest.raises(InputError, match=r'"seen" has the shape \(3,\): must be \(2,\)'):
        Trajectories(**given, attributes={"seen": [1, 2, 3]})
    with pytest.raises(ConfigError, match="attributes is 'seen'"):
        ReadOptions(attributes="seen")
    nested = pd.DataFrame({"id": ["a"], "t": [0], "x": [0.0], "seen": [[1, 2]]})
    with pytest.raises(InputError, match='row 0, column "seen": a value of type list'):
        from_frame(nested, ReadOptions(attributes=("seen",)))
