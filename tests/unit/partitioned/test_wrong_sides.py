"""What is wrong in a side of many parts is said in one sentence that names the file."""

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tgospa_eval import ConfigError, InputError
from tgospa_eval.formats import ReadOptions
from tgospa_eval.partitioned.sides import open_side
from tgospa_eval.partitioned.tasks import run_tasks

BASE = pd.DataFrame(
    {"id": np.tile(np.arange(5), 6), "t": np.repeat(np.arange(6), 5), "x": 1.5, "y": 2.5}
)


def read_all(folder: Path, rows_together: int = 10, **options: Any) -> int:
    """Rows of all steps, of blocks of one step each."""
    side = open_side(
        folder,
        ReadOptions(**options),
        "truth",
        work=folder.parent / "work",
        rows_together=rows_together,
        run=run_tasks,
    )
    blocks = [side.read(time, time).trajectories for time in side.times]
    side.check_ids(np.unique([name for block in blocks for name in block.ids]))
    return sum(len(block.step) for block in blocks)


def write(folder: Path, second: pd.DataFrame, ending: str) -> Path:
    """A folder with the base, of which the second half is another."""
    folder.mkdir()
    for name, part in (("a", BASE[:10]), ("b", second)):
        if ending == "parquet":
            part.to_parquet(folder / f"{name}.parquet", index=False)
        else:
            part.to_csv(folder / f"{name}.csv", index=False)
    return folder


def last(column: str, value: object) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """A change of the last row."""

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        values = [*frame[column].tolist()[:-1], value]
        if value == "abc":
            values = [str(each) for each in values]
        return frame.assign(**{column: pd.Series(values, index=frame.index)})

    return change


STAMPS = [f"2024-05-01T00:00:{k:02}" for k in range(20)]


@pytest.mark.parametrize("ending", ["parquet", "csv"])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (last("x", np.inf), '{b}, {end}, column "x": infinite'),
        (last("x", "abc"), '{b}, {end}, column "x": not a number: "abc"'),
        (last("t", None), '{b}, {end}, column "t": blank time'),
        (last("id", None), '{b}, {end}, column "id": blank id'),
        (
            lambda f: f.drop(columns="y"),
            "{b}: it is read by its columns id, t, x, but {a} by id, t, x, y",
        ),
        (
            lambda f: f.rename(columns={"id": "mmsi"}),
            "{b}: it is read by its columns mmsi, t, x, y, but",
        ),
        (lambda f: f.drop(columns="t"), "{header}: no column for t (found: id, x, y)"),
        (lambda f: f.assign(t=STAMPS), "{b}: its times are ISO times without zone, and those of"),
        (lambda f: pd.concat([f, BASE[3:5]]), '{b}, {end}: id "3" at t 0 is already in {a}, '),
        (lambda f: f.assign(z=1.0), "{b}: it is read by its columns id, t, x, y, z, but {a} by"),
    ],
)
def test_rows_and_files_are_named(
    tmp_path: Path, change: Callable[[pd.DataFrame], pd.DataFrame], message: str, ending: str
) -> None:
    second = change(BASE[10:].astype({"x": object, "id": object}).infer_objects())
    folder = write(tmp_path / "d", second, ending)
    a, b = (folder / f"{name}.{ending}" for name in "ab")
    end = len(second) - (2 if "already in" in message else 1)
    known = {
        "a": a,
        "b": b,
        "end": f"row {end}" if ending == "parquet" else f"line {end + 2}",
        "header": b if ending == "parquet" else f"{b}, line 1",
    }
    for rows_together in (3, 1000):
        with pytest.raises(InputError) as raised:
            read_all(folder, rows_together)
        assert str(raised.value).startswith(message.format(**known))


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_integers_that_are_not_exact_beside_decimals(tmp_path: Path, ending: str) -> None:
    folder = write(tmp_path / "d", BASE[10:].assign(t=np.arange(20) + 0.5), ending)
    large = BASE[:10].assign(t=2**60 + np.arange(10))
    if ending == "parquet":
        large.to_parquet(folder / "a.parquet")
    else:
        large.to_csv(folder / "a.csv", index=False)
    with pytest.raises(InputError, match=rf"a\.{ending}: its integer times are too large"):
        read_all(folder)


@pytest.mark.parametrize("rows_together", [3, 1000])
def test_damaged_and_empty_files(tmp_path: Path, rows_together: int) -> None:
    folder = write(tmp_path / "d", BASE[10:], "parquet")
    file = folder / "b.parquet"
    whole = file.read_bytes()
    wrong = {
        b"": "the file is empty; a part without objects has a schema and no rows",
        whole[:-200]: "not a readable Parquet file",
        whole[:4] + bytes(100) + whole[104:]: "not a readable Parquet file",
    }
    for content, message in wrong.items():
        file.write_bytes(content)
        with pytest.raises(InputError) as raised:
            read_all(folder, rows_together)
        assert str(raised.value).startswith(f"{file}: {message}")
    BASE[:0].to_parquet(file)
    assert read_all(folder, rows_together) == 10
    BASE[:0].to_parquet(folder / "a.parquet")
    assert read_all(folder, rows_together) == 0
    file.unlink()
    (folder / "a.parquet").unlink()
    with pytest.raises(InputError, match="no file in this folder; write Parquet or CSV"):
        read_all(folder)
    packed = gzip.compress(BASE.to_csv(index=False).encode())
    (folder / "c.csv.gz").write_bytes(packed[:-30])
    with pytest.raises(InputError, match=r"c\.csv\.gz: cannot be unpacked, it is damaged"):
        read_all(folder)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("b.csv", b"id,t,x,y\n", r"files of two formats, .*a\.parquet, .*b\.csv; write all as"),
        ("gt.txt", b"1,1,2,3,4,5,1,-1,-1,-1\n", r"gt\.txt: looks like motchallenge; only Parquet"),
        ("README.md", b"words", r"README\.md: its name is not that of a table; only"),
        ("b.npz", b"PK\x03\x04", r"b\.npz: looks like npz; only Parquet and CSV"),
        ("b.parquet.gz", gzip.compress(b"PAR1", mtime=0), "a compressed Parquet file; unpack it"),
        ("sample.json", b"[]", "a folder of nuScenes; only Parquet and CSV"),
    ],
)
def test_other_files(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    BASE.to_parquet(tmp_path / "a.parquet")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_all(tmp_path)


def test_a_range_of_another_kind_of_time(tmp_path: Path) -> None:
    folder = write(tmp_path / "d", BASE[10:], "parquet")
    with pytest.raises(ConfigError, match=r"ISO times without zone, but .* has numbers"):
        read_all(folder, time="2024-01-01:")


def test_particles_and_detections(tmp_path: Path) -> None:
    folder = write(tmp_path / "d", BASE[10:], "parquet")
    for name, part in (("a", BASE[:10]), ("b", BASE[5:])):
        part.assign(weight=0.5).to_parquet(folder / f"{name}.parquet")
    with pytest.raises(InputError, match=r"particles of clouds, which are not read"):
        read_all(folder)
    for name, part in (("a", BASE[:10:5]), ("b", BASE[10::5])):
        part.assign(id=-1).to_parquet(folder / f"{name}.parquet")
    with pytest.raises(InputError, match="every id is -1: these are detections"):
        read_all(folder)
    for name, part in (("a", BASE[:10:5]), ("b", BASE[10:].assign(id=-1)[::5])):
        part.to_parquet(folder / f"{name}.parquet")
    assert read_all(folder) == 6
