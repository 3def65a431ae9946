"""Feather files: the same answer as from CSV, and what small ones may unpack to."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from answer import Run
from checkout import SAMPLES

from tgospa_eval import InputError
from tgospa_eval.formats import ReadOptions, read

pa = pytest.importorskip("pyarrow")
feather = pytest.importorskip("pyarrow.feather")


@pytest.mark.parametrize("compression", ["lz4", "zstd", "uncompressed"])
def test_the_answer_of_the_csv_file(invoke: Run, tmp_path: Path, compression: str) -> None:
    paths = {}
    for role in ("truth", "estimate"):
        paths[role] = SAMPLES / "quickstart" / f"{role}.csv"
        table = pd.read_csv(paths[role], dtype={"id": str}).assign(**{"class": "car"})
        table["class"] = table["class"].astype("category")
        table.to_feather(f"{role}.feather", compression=compression, chunksize=50)
        found, want = (read(path).trajectories for path in (f"{role}.feather", paths[role]))
        for name in ("step", "track", "state", "ids", "times"):
            assert np.array_equal(getattr(found, name), getattr(want, name))
    read_class = read("truth.feather", ReadOptions(by_class=True, attributes=("class",)))
    assert (read_class.format, read_class.classes) == ("feather", ("car",))
    assert set(read_class.trajectories.attributes["class"]) == {"car"}
    asked = ("-c", "10", "-g", "5", "--format", "csv")
    want = invoke(str(paths["truth"]), str(paths["estimate"]), *asked)
    found = invoke("truth.feather", "estimate.feather", *asked)
    assert found.status == want.status == 0
    assert found.out == want.out
    assert "read as feather" in found.err


def test_what_it_unpacks_to_is_known_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = 1_000_000
    zeros = pa.array(np.zeros(rows, np.int64))
    bomb = pa.table({"id": zeros, "t": zeros, "x": zeros})
    feather.write_feather(bomb, "bomb.feather", compression="zstd", chunksize=rows)
    assert Path("bomb.feather").stat().st_size < 100_000
    with pytest.raises(InputError, match=r"1,000,000 rows of 3 columns: .*0.14 GB"):
        read("bomb.feather", ReadOptions(max_input=0.1))
    nulls = pa.nulls(10**9)  # of no bytes at all
    feather.write_feather(pa.table({"id": nulls, "t": nulls, "x": nulls}), "none.feather")
    with pytest.raises(InputError, match=r"1,000,000,000 rows.*but 4 GB are allowed"):
        read("none.feather")


def test_no_feather(
    write: Callable[[str, str | bytes], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for data, message in (
        (b"", "empty"),
        (b"FEA1" + bytes(60), "version 1"),
        (b"ARROW1\0\0" + b"\xff" * 60, "not a readable Feather file"),
        (b"id,t,x\n1,0,0\n", "not a readable Feather file"),
    ):
        with pytest.raises(InputError, match=message):
            read(write("a.feather", data))
    table = pa.table({"id": ["a"], "t": [0], "wxyz": [1.0]})
    feather.write_feather(table, "name.feather")
    damaged = Path("name.feather").read_bytes().replace(b"wxyz", b"w\xffyz")
    with pytest.raises(InputError, match="not a readable Feather file: a text that is not UTF-8"):
        read(write("a.feather", damaged))
