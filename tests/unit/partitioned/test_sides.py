"""A side in parts has the rows that one file would have."""

import pickle
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tgospa_eval import Trajectories
from tgospa_eval.formats import ReadOptions, read
from tgospa_eval.formats.loading import ZSTD
from tgospa_eval.partitioned.sides import PartsSide, open_side
from tgospa_eval.partitioned.tasks import run_tasks
from tgospa_eval.tracks.conversion import Conversion

IDS: dict[str, Callable[[int], object]] = {
    "integer": lambda k: (10 * k) % 17 - 3,
    "text": lambda k: f"v{k}",
}


def scene(rows: int = 60, ids: str = "integer", seed: int = 0) -> pd.DataFrame:
    """Distinct (id, t) in order of time."""
    rng = np.random.default_rng(seed)
    pairs = np.sort(rng.choice(12 * 14, size=rows, replace=False))
    return pd.DataFrame(
        {
            "t": pairs // 14,
            "id": [IDS[ids](k) for k in (pairs % 14).tolist()],
            "x": rng.normal(size=rows),
            "y": np.where(rng.random(rows) < 0.1, np.nan, rng.normal(size=rows)),
        }
    )


def opened(path: Path, work: Path, rows_together: int = 20, **options: Any) -> PartsSide:
    return open_side(
        path,
        ReadOptions(**options),
        "truth",
        work=work,
        rows_together=rows_together,
        run=run_tasks,
    )


def check_same(found: Trajectories, wanted: Trajectories) -> None:
    for name in ("step", "track", "state", "times", "ids", "labels"):
        one, other = getattr(found, name), getattr(wanted, name)
        if other is None:
            assert one is None, name
            continue
        assert one.dtype == other.dtype, name
        assert one.tolist() == other.tolist(), name
    assert (found.columns, found.clock) == (wanted.columns, wanted.clock)


def check_blocks(side: PartsSide, whole: Trajectories, cuts: Sequence[int] = (0, 3, 4)) -> None:
    """All blocks between these steps, and all at once."""
    assert side.times.tolist() == whole.times.tolist()
    assert side.times.dtype == whole.times.dtype
    check_same(side.read(side.times[0], side.times[-1]).trajectories, whole)
    for first, last in zip(cuts, [*cuts[1:], len(whole.times)], strict=True):
        rows = np.flatnonzero((whole.step >= first) & (whole.step < last))
        part = whole.chosen(rows, whole.step[rows] - first, whole.times[first:last])
        if whole.labels is not None:
            vars(part)["labels"] = whole.labels[first:last]
        check_same(side.read(side.times[first], side.times[last - 1]).trajectories, part)


def sorted_by_time(frame: pd.DataFrame) -> list[pd.DataFrame]:
    return [frame[k : k + 20] for k in range(0, len(frame), 20)]


def shuffled(frame: pd.DataFrame) -> list[pd.DataFrame]:
    return sorted_by_time(frame.sample(frac=1, random_state=1))


def overlapping(frame: pd.DataFrame) -> list[pd.DataFrame]:
    return [frame[:40:2], frame[1:40:2], frame[:0], frame[:39:-1]]


def by_track(frame: pd.DataFrame) -> list[pd.DataFrame]:
    return sorted_by_time(frame.sort_values(["id", "t"], key=lambda c: c.astype(str)))


def skewed(frame: pd.DataFrame) -> list[pd.DataFrame]:
    return [frame[2::-1], frame[3:55], frame[55:]]


LAYOUTS = [sorted_by_time, shuffled, overlapping, by_track, skewed]


def written(
    folder: Path, parts: Sequence[pd.DataFrame], ending: str = "parquet", **options: Any
) -> tuple[Path, Trajectories]:
    """A folder of parts, and what one file with their rows in the same order gives."""
    write = {"parquet": pd.DataFrame.to_parquet}.get(ending, pd.DataFrame.to_csv)
    whole = folder / f"whole.{ending}"
    (folder / "parts").mkdir()
    write(pd.concat(parts), whole, index=False)
    for k, part in enumerate(parts, 9):  # part-9 comes before part-10
        write(part, folder / "parts" / f"part-{k}.{ending}", index=False)
    return folder / "parts", read(whole, ReadOptions(**options)).trajectories


@pytest.mark.parametrize(
    ("layout", "ending", "ids"),
    [
        *((layout, "parquet", "integer") for layout in LAYOUTS),
        (by_track, "parquet", "text"),
        (sorted_by_time, "csv", "integer"),
        (overlapping, "csv", "text"),
        (shuffled, "csv.gz", "integer"),
    ],
)
def test_blocks_are_those_of_one_file(
    tmp_path: Path, layout: Callable[[pd.DataFrame], list[pd.DataFrame]], ending: str, ids: str
) -> None:
    parts, whole = written(tmp_path, layout(scene(ids=ids)), ending)
    for rows_together in (4, 1000):
        side = opened(parts, tmp_path / "work", rows_together)
        check_blocks(pickle.loads(pickle.dumps(side)), whole)


@pytest.mark.parametrize(
    "changes",
    [
        {"t": lambda t: t * 0.1, "id": lambda k: pd.Categorical(k.astype(str))},
        # Some files have integers alone.
        {"t": lambda t: np.where(t > 5, t, t * 0.1), "id": lambda k: k.astype(float)},
        {"t": lambda t: pd.Timestamp("2024-05-01") + pd.to_timedelta(t, "s")},
        {"t": lambda t: pd.Timestamp("2024-05-01", tz="CET") + pd.to_timedelta(t * 0.25, "s")},
        {"t": lambda t: [f"2024-05-01T00:00:{k:02}+01:00" for k in t]},
        {"t": lambda t: t.astype(str), "x": lambda x: x.round(3).astype(str)},
        {"t": lambda t: t.astype("int16"), "x": lambda x: (100 * x).astype("int32")},
    ],
)
def test_types_of_columns(tmp_path: Path, changes: dict[str, Callable[[Any], Any]]) -> None:
    frame = scene()
    for column, change in changes.items():
        frame[column] = change(frame[column])
    parts, whole = written(tmp_path, overlapping(frame))
    for rows_together in (4, 1000):
        check_blocks(opened(parts, tmp_path / "work", rows_together), whole, cuts=(0, 4))


@pytest.mark.parametrize(
    ("options", "ending"),
    [
        ({"time": "3:8"}, "parquet"),
        ({"time": "3:8", "classes": ("b",), "region": "x=-1:"}, "csv"),
        ({"time": "30:", "conversion": Conversion(time_offset=28.5, time_scale=0.5)}, "csv"),
        ({"conversion": Conversion(unit_scale=1000)}, "parquet"),
        ({"classes": ("b",), "region": "x=-1:"}, "csv"),
        ({"classes": ("b", "c"), "region": "x=-1:"}, "parquet"),
        ({"columns": ("id=klass", "x"), "on_duplicate": "first"}, "parquet"),
        ({"columns": ("id=klass", "x"), "on_duplicate": "last"}, "csv"),
        ({"covariance": True}, "parquet"),
    ],
)
def test_options(tmp_path: Path, options: dict[str, Any], ending: str) -> None:
    frame = scene().rename(columns={"klass": "class"})
    frame["klass"] = frame["class"] = np.where(frame["id"] % 2, "a", "b")
    frame["cov_xx"], frame["cov_xy"], frame["cov_yy"] = 2.0, frame["t"] / 10, 3.0
    frame.loc[frame.index % 5 == 2, "x"] = np.nan  # at all times
    parts, _ = written(tmp_path, overlapping(frame), ending)
    reading = read(tmp_path / f"whole.{ending}", ReadOptions(**options))
    side = opened(parts, tmp_path / "work", 10, **options)
    check_blocks(side, reading.trajectories, cuts=(0, 3))
    blocks = [side.read(*ends[[0, -1]]) for ends in np.array_split(side.times, 3)]
    assert sum(block.rows for block in blocks) + side.steps.left_out.get("time", 0) == len(frame)
    left_out = dict(side.steps.left_out)
    for rule, count in (item for block in blocks for item in block.left_out.items()):
        left_out[rule] = left_out.get(rule, 0) + count
    assert left_out == reading.left_out
    said = [notice for notice in reading.notices if "read as" not in notice]
    assert [*side.said(left_out)] == said


def test_keys_of_folders_are_columns_if_needed(tmp_path: Path) -> None:
    frame = scene(ids="text")
    frame = frame[frame["id"] < "v2"]
    frame["class"] = np.where(frame["t"] % 2, "a car", "b")
    for (klass, name), rows in frame.groupby(["class", "id"]):
        folder = tmp_path / "parts" / f"class={klass.replace(' ', '%20')}" / f"id={name}"
        folder.mkdir(parents=True)
        rows[["x", "y", "t"]].to_parquet(folder / "0.parquet")
        (folder / "_SUCCESS").touch()
    frame.to_parquet(tmp_path / "whole.parquet")
    for options in ({}, {"classes": ("a car",)}):
        whole = read(tmp_path / "whole.parquet", ReadOptions(**options)).trajectories
        check_blocks(opened(tmp_path / "parts", tmp_path / "work", 10, **options), whole)


@pytest.mark.parametrize("ending", ["parquet", "csv", "csv.zst"])
def test_one_file_beyond_memory(tmp_path: Path, ending: str) -> None:
    frame = many()
    path = tmp_path / f"one.{ending}"
    if ending == "parquet":
        frame.to_parquet(path, row_group_size=300)
    else:
        content = frame.to_csv(index=False).encode()
        path.write_bytes(content if ending == "csv" else import_module(ZSTD).compress(content))
    side = opened(path, tmp_path / "work", 50)
    check_blocks(side, read(path).trajectories)
    runs = list((tmp_path / "work").glob("*/runs/*/*/time.npy"))
    assert len(runs) >= 5  # none of which has many rows
    assert max(len(np.load(run)) for run in runs) < 400


def many() -> pd.DataFrame:
    rng = np.random.default_rng(5)
    pairs = rng.permutation(40 * 50)[:1500]
    return pd.DataFrame(
        {"x": rng.normal(size=1500), "id": pairs % 50, "y": 1.0, "time": pairs // 50}
    )
