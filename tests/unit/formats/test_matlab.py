"""MAT files: the answer of the CSV files, which variable, and what is refused."""

import gzip
import io
import shutil
import struct
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import SAMPLES
from scipy.io import savemat

from tgospa_eval import evaluate
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import ReadOptions, read

Run = Callable[..., Any]
FOLDER = SAMPLES / "formats"
RUN, TRUTH_73 = FOLDER / "run.mat", FOLDER / "truth73.mat"
BOTH = {"tVec": [[1.0], [2.0]], "iVec": [[3.0], [1.0]], "xState": np.arange(12.0).reshape(2, 3, 2)}


def saved(path: Path, fields: dict[str, Any], name: str = "X", **settings: Any) -> Path:
    savemat(path, {name: fields}, **settings)
    return path


@pytest.mark.parametrize("truth", ["run.mat", "run.mat:X", "truth73.mat", "truth.csv"])
def test_the_answer_of_the_csv_files(truth: str) -> None:
    pytest.importorskip("h5py")
    scene = evaluate(str(FOLDER / "truth.csv"), str(FOLDER / "estimate.csv"), 10, 2, 5)
    result = evaluate(str(FOLDER / truth), str(RUN), 10, 2, 5)
    assert (result.total, result.lower_bound) == (scene.total, scene.lower_bound)
    assert result.counts == scene.counts
    want = read(FOLDER / "truth.csv").trajectories
    found = read(FOLDER / truth).trajectories
    for name in ("step", "track", "state", "ids", "times", "columns"):
        assert np.array_equal(getattr(found, name), getattr(want, name))
    assert found.times.dtype == np.int64


@pytest.mark.parametrize("settings", [{}, {"do_compression": True}])
@pytest.mark.parametrize("kind", ["f8", "f4", "i4", "u1"])
def test_what_counts_is_within_a_trajectory(
    tmp_path: Path, kind: str, settings: dict[str, bool]
) -> None:
    state = np.arange(12).reshape(2, 3, 2).astype(kind)
    fields = BOTH | {
        "xState": state,
        "note": "seen",
        "more": {"a": 1},
        "cells": np.array([1, "b"], object),
    }
    side = read(saved(tmp_path / "a.mat", fields, **settings)).trajectories
    rows = list(zip(side.ids[side.track], side.times[side.step], side.state.tolist(), strict=True))
    assert rows == [
        ("1", 1, [0, 6]),
        ("1", 2, [2, 8]),
        ("2", 2, [3, 9]),
        ("1", 3, [4, 10]),
    ]


def test_holes_one_trajectory_none_and_many_components(run: Run, tmp_path: Path) -> None:
    state = np.array([[1.0, np.nan, 3.0]])
    hole = read(saved(tmp_path / "a.mat", {"tVec": 1, "iVec": 3, "xState": state}))
    assert hole.left_out == {"blank": 1}
    assert hole.trajectories.state.tolist() == [[1], [3]]
    for empty in (np.zeros((2, 4, 0)), np.zeros((0, 0))):
        none = read(saved(tmp_path / "n.mat", {"tVec": [], "iVec": [], "xState": empty}))
        assert (none.rows, none.trajectories.columns) == (0, ("x", "y"))
    four = saved(tmp_path / "f.mat", BOTH | {"xState": np.arange(24.0).reshape(4, 3, 2)})
    reading = read(four)
    assert reading.trajectories.columns == ("x0", "x1", "x2", "x3")
    assert "--columns x=x0,y=x2" in " ".join(reading.notices)
    places = read(four, ReadOptions(columns=("x=x0", "y=x2"), attributes=("x1",)))
    assert places.trajectories.state[0].tolist() == [0, 12]
    assert places.trajectories.attributes["x1"][0] == 6
    assert not any("components" in notice for notice in places.notices)


def test_which_variable(invoke: Run, tmp_path: Path) -> None:
    shutil.copy(RUN, tmp_path / "run.mat")
    assert invoke("run.mat", "run.mat", "-c", "10", "-g", "5").status == 0
    (tmp_path / "run.mat.gz").write_bytes(gzip.compress(RUN.read_bytes()))
    plainly = read("run.mat:Y").trajectories
    assert np.array_equal(read("run.mat.gz:Y").trajectories.state, plainly.state)
    assert "variable X of X, Y; run.mat.gz:Y reads another" in read("run.mat.gz").notices
    answer = invoke("run.mat:X", "run.mat:Z")
    assert (answer.status, answer.out) == (3, "")
    assert 'run.mat:Z: no set of trajectories "Z" (there are: X, Y)' in answer.err
    savemat("several.mat", {"A": BOTH, "B": BOTH, "k": 3})
    answer = invoke("several.mat", "several.mat:B")
    assert answer.status == 3
    assert "2 sets of trajectories (A, B); say which, several.mat:A" in answer.err
    savemat("none.mat", {"k": 3, "s": {"a": 1}, "two": np.array([(1,), (2,)], [("tVec", "O")])})
    answer = invoke("none.mat", "run.mat:Y", "--truth-format", "mat")
    assert answer.status == 3
    assert "tVec, iVec, xState (in it: k, s, two)" in answer.err
    (tmp_path / "a.mat:X").write_text("id,t,x\n1,0,0\n")  # a file of that name is one
    assert read(tmp_path / "a.mat:X", format="csv").rows == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tVec": [[0.0], [2.0]]}, "trajectory 1 is from step 0 to 2; xState has the steps 1 to 3"),
        ({"iVec": [[3.0], [3.0]]}, "trajectory 2 is from step 2 to 4"),
        ({"iVec": [[3.0]]}, "2 in tVec, 1 in iVec, and xState is 2 x 3 x 2"),
        ({"iVec": [[1.5], [1.0]]}, "iVec: 1.5 of trajectory 1 is no step"),
        ({"iVec": [[np.nan], [1.0]]}, "iVec: nan of trajectory 1"),
        ({"iVec": [[1.0], [-1.0]]}, "iVec: -1 of trajectory 2"),
        ({"tVec": np.ones((2, 2))}, "tVec: is 2 x 2; it must be a vector"),
        ({"xState": np.full((2, 3, 2), np.inf)}, "trajectory 1, step 1: infinite (and 3 more)"),
        ({"xState": np.ones((2, 3, 2)) * 1j}, "xState: no real numbers"),
        ({"xState": "text"}, "xState: no real numbers"),
        ({"xState": np.ones((2, 3))}, "xState is 2 x 3"),
    ],
)
def test_refused(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        read(saved(tmp_path / "a.mat", BOTH | change))
    assert message in str(caught.value)


def test_damaged_files_and_what_small_ones_unpack_to(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    for content, message in (
        (b"", "the file is empty"),
        (b"MATLAB 5.0 MAT-file", "no structure"),
        (RUN.read_bytes()[:1000], "it ends early"),
        (TRUTH_73.read_bytes()[:1000], "no readable MAT file"),
        (b"PAR1", "no MAT file of version 5 or 7.3"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=message):
            read(path, format="mat")
    zeros = np.zeros((2, 1_000_000, 1))
    saved(path, {"tVec": 1, "iVec": 1, "xState": zeros}, do_compression=True)
    assert path.stat().st_size < 100_000
    assert read(path).rows == 1
    with pytest.raises(InputError, match=r"bytes: reading it takes some .* allowed are 0.05 GB"):
        read(path, ReadOptions(max_input=0.05))
    # What is no structure is not unpacked at all.
    savemat(path, {"X": BOTH, "large": zeros}, do_compression=True)
    assert read(path, ReadOptions(max_input=0.01)).rows == 4


def test_an_array_that_claims_more_than_it_has(tmp_path: Path) -> None:
    data = RUN.read_bytes()
    at = data.index(struct.pack("<3i", 2, 12, 4))
    for sizes in ((2**31 - 1,) * 3, (2, 12, 5), (-2, -12, 4), (2, 12, 0)):
        path = tmp_path / "a.mat"
        path.write_bytes(data[:at] + struct.pack("<3i", *sizes) + data[at + 12 :])
        with pytest.raises(InputError):
            read(path)
    inner = zlib.compress(data[128 : 128 + 8])  # compressed, and cut
    path.write_bytes(data[:128] + struct.pack("<II", 15, len(inner)) + inner)
    with pytest.raises(InputError, match="no readable MAT file"):
        read(path)


def test_hdf5_follows_no_links_out_of_the_file(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    head = TRUTH_73.read_bytes()[:512]
    path, other = tmp_path / "a.mat", tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["secret"] = np.ones((1, 3, 2))
    for link in (
        lambda group: group.__setitem__("xState", h5py.ExternalLink(str(other), "secret")),
        lambda group: group.create_dataset(
            "xState", (1, 3, 2), "f8", external=[(str(other), 0, 48)]
        ),
        lambda group: group.__setitem__("xState", h5py.SoftLink("/X/tVec")),
    ):
        with h5py.File(path, "w", userblock_size=512) as file:
            group = file.create_group("X")
            group["tVec"], group["iVec"] = [[1.0]], [[3.0]]
            link(group)
        path.write_bytes(head + path.read_bytes()[512:])
        with pytest.raises(InputError, match="no structure with the fields"):
            read(path)


def test_without_h5py(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ConfigError, match=r"need the extra matlab: .*tgospa-eval\[matlab\]"):
        read(TRUTH_73)
    buffer = io.BytesIO()
    savemat(buffer, {"X": BOTH})
    (tmp_path / "a.mat").write_bytes(buffer.getvalue())
    assert read(tmp_path / "a.mat").rows == 4
