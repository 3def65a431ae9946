"""MAT files: the answer of the CSV files, which variable, and what is refused."""

import gzip
import io
import json
import os
import shutil
import struct
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Run
from checkout import SAMPLES
from scipy.io import savemat
from scipy.sparse import csc_array

from tgospa_eval import ConfigError, InputError, TgospaWarning, evaluate, read_trajectories
from tgospa_eval.engines import DiedError, call_in_helper
from tgospa_eval.formats import ReadOptions, read, runs_inside

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


def test_holes_one_trajectory_none_and_many_components(tmp_path: Path) -> None:
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
    assert [notice.code for notice in reading.warnings] == ["all-components"]
    places = read(four, ReadOptions(columns=("x=x0", "y=x2"), attributes=("x1",)))
    assert places.trajectories.state[0].tolist() == [0, 12]
    assert places.trajectories.attributes["x1"][0] == 6
    assert not places.warnings


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
    assert "2 sets of trajectories (A, B); name one, such as several.mat:A" in answer.err
    savemat("none.mat", {"k": 3, "s": {"a": 1}, "two": np.array([(1,), (2,)], [("tVec", "O")])})
    answer = invoke("none.mat", "run.mat:Y", "--truth-format", "mat")
    assert answer.status == 3
    assert "X, L by step (in it: k 1 x 1, s, two)" in answer.err
    (tmp_path / "a.mat:X").write_text("id,t,x\n1,0,0\n")  # a file of that name is one
    assert read(tmp_path / "a.mat:X", format="csv").rows == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tVec": [[0.0], [2.0]]}, "trajectory 1 is from step 0 to 2; xState has the steps 1 to 3"),
        ({"iVec": [[3.0], [3.0]]}, "trajectory 2 is from step 2 to 4"),
        ({"iVec": [[3.0]]}, "2 in tVec, 1 in iVec, and xState is 2 x 3 x 2"),
        ({"iVec": [[1.5], [1.0]]}, "iVec: 1.5 of trajectory 1 is not a step"),
        ({"iVec": [[np.nan], [1.0]]}, "iVec: nan of trajectory 1"),
        ({"iVec": [[1.0], [-1.0]]}, "iVec: -1 of trajectory 2"),
        ({"tVec": np.ones((2, 2))}, "tVec: is 2 x 2; it must be a vector"),
        (
            {"xState": np.full((2, 3, 2), np.inf)},
            'trajectory 1, step 1, column "x": infinite (and 3 more)',
        ),
        ({"xState": np.ones((2, 3, 2)) * 1j}, "xState: not real numbers"),
        ({"xState": "text"}, "xState: not real numbers"),
        ({"tVec": csc_array([[1.0], [2.0]])}, "tVec: not real numbers"),
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
        (b"MATLAB 5.0 MAT-file", "it ends early"),
        (RUN.read_bytes()[:1000], "it ends early"),
        (TRUTH_73.read_bytes()[:1000], "not a readable MAT file"),
        (b"PAR1", "not a MAT file of version 5 or 7.3"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=message):
            read(path, format="mat")
    zeros = np.zeros((2, 1_000_000, 1))
    saved(path, {"tVec": 1, "iVec": 1, "xState": zeros}, do_compression=True)
    assert path.stat().st_size < 100_000
    assert (read(path).taken, read(path).rows) == (1, 1_000_000)
    with pytest.raises(
        InputError, match=r"bytes: reading it needs about .* but 0.05 GB are allowed"
    ):
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
    with pytest.raises(InputError, match="not a readable MAT file"):
        read(path)


def test_a_file_that_ends_the_process_that_reads_it(run: Run, tmp_path: Path) -> None:
    # One byte of a size, with which SciPy 1.17 reads what is not there.
    data = bytearray(RUN.read_bytes())
    data[264] = 0
    path = tmp_path / "a.mat"
    path.write_bytes(data)
    answer = run("a.mat", str(RUN), "-c", "10")
    assert (answer.status, answer.out) == (3, "")
    assert "a.mat: not a readable MAT file" in answer.err
    with pytest.raises(InputError, match="not a readable MAT file"):
        read(path)
    assert read(RUN).rows == 48


def test_the_process_that_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    def dies(*arguments: object) -> None:
        raise DiedError("status 1")

    with monkeypatch.context() as patch:
        patch.setattr("tgospa_eval.formats.matlab.call_in_helper", dies)
        with pytest.raises(InputError, match=r"reading it failed \(status 1\): it is"):
            read(RUN)
    with pytest.raises(DiedError):
        call_in_helper(os._exit, 0)
    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", "/none")
        with pytest.raises(ConfigError, match=r"cannot be started here \(No such .*as CSV$"):
            read(RUN)
    assert read(RUN).rows == 48


@pytest.mark.skipif(sys.platform != "linux", reason="no limit of memory")
def test_no_room_for_what_is_only_claimed(tmp_path: Path) -> None:
    # A text without a letter, which SciPy fills with as many blanks as it claims to have.
    path = saved(tmp_path / "a.mat", BOTH | {"note": np.array([""])})
    data = path.read_bytes()
    at = data.index(struct.pack("<4i", 4, 0, 5, 8)) + 16
    path.write_bytes(data[:at] + struct.pack("<2i", 2**30, 1) + data[at + 8 :])
    with pytest.raises(InputError, match=r"reading it takes more than .* allow more with max_in"):
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
        with pytest.raises(InputError, match=r"X.xState: not real numbers"):
            read(path)


def study(path: Path, version: str, runs: int = 3, **more: Any) -> Path:
    """The truth X of a study and a cell Y of its runs, whose errors in x are 1, 2, ..."""
    moved = [BOTH | {"xState": BOTH["xState"] + [[[k + 1.0]], [[0.0]]]} for k in range(runs)]
    if version != "7.3":
        cell = np.empty((1, runs), object)
        cell[0, :] = moved
        savemat(path, {"X": BOTH, "Y": cell, **more}, do_compression=version == "7")
        return path
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        cell = file.create_dataset("Y", (runs, 1), h5py.ref_dtype)
        for name, fields in [("X", BOTH), *((f"#refs#/{k}", run) for k, run in enumerate(moved))]:
            for field, values in fields.items():
                file[f"{name}/{field}"] = np.asarray(values).T
        for k in range(runs):
            cell[k, 0] = file[f"#refs#/{k}"].ref
    path.write_bytes(TRUTH_73.read_bytes()[:512] + path.read_bytes()[512:])
    return path


@pytest.mark.parametrize("version", ["6", "7", "7.3"])
def test_cells_of_runs(invoke: Run, tmp_path: Path, version: str) -> None:
    study(tmp_path / "s.mat", version)
    for number in (1, 2, 3):
        answer = invoke("s.mat:X", f"s.mat:Y{{{number}}}", "-c", "10", "--format", "json")
        assert json.loads(answer.out)["total"] == pytest.approx(4 * number**2)
        side = read_trajectories(f"s.mat:Y{{{number}}}")
        assert side.state[0].tolist() == [number, 6]
    for pair, message in (
        (
            "s.mat s.mat",
            "s.mat: Y has 3 runs; choose one, s.mat:Y{1}, or all in a batch, s.mat:Y{run}",
        ),
        ("s.mat s.mat:Y", "s.mat:Y: Y has 3 runs; choose one, s.mat:Y{1}"),
        ("s.mat s.mat:Y{4}", "s.mat:Y{4}: Y has 3 runs, Y{1} to Y{3}"),
        ("s.mat s.mat:Y{0}", "s.mat:Y{0}: Y has 3 runs, Y{1} to Y{3}"),
        (
            "s.mat s.mat:Y(a)",
            's.mat:Y(a): no set of trajectories "Y(a)" (there are: X, Y{1} to Y{3})',
        ),
        ("s.mat:X{1} s.mat:Y{1}", "s.mat:X{1}: X has no runs; s.mat:X reads it"),
    ):
        answer = invoke(*pair.split(), "-c", "10")
        assert (answer.status, answer.out) == (3, "")
        assert message in answer.err
    study(tmp_path / "one.mat", version, runs=1)
    assert read("one.mat", role="estimate").trajectories.state[0, 0] == 1.0
    assert (
        "variable Y{1} of X, Y{1}; one.mat:X reads another"
        in read("one.mat", role="estimate").notices
    )


def test_all_runs_of_a_cell_in_a_batch(invoke: Run, tmp_path: Path) -> None:
    study(tmp_path / "s.mat", "7", runs=11)
    asked = ("batch", "-c", "20", "-o", "r", "--workers", "1", "--format", "json", "-q")
    answer = invoke(*asked, "--truth", "s.mat:X", "--estimate", "s.mat:Y{run}")
    groups = json.loads(answer.out)["groups"]
    assert [(group["run"], group["total"]) for group in groups] == [
        (str(k), pytest.approx(4 * k**2)) for k in range(1, 12)
    ]
    # A job is known by the file and its variable: a new file is evaluated again.
    study(tmp_path / "s.mat", "7", runs=12)
    again = invoke(*asked[:-1], "--truth", "s.mat:X", "--estimate", "s.mat:Y{run}")
    assert len(json.loads(again.out)["groups"]) == 12
    assert "done before" not in again.err


def test_patterns_and_manifests_with_variables(invoke: Run, tmp_path: Path) -> None:
    for name in "ab":
        study(tmp_path / f"{name}.mat", "7", runs=2)
    asked = ("batch", "-c", "20", "--workers", "1", "--format", "json", "-q")
    pattern = ("--truth", "{study}.mat:Y{run}", "--estimate", "{study}.mat:Y{{run}}")
    groups = json.loads(invoke(*asked, *pattern, "-o", "r", "--by", "study,run").out)["groups"]
    labels = [(group["study"], group["run"], group["total"]) for group in groups]
    assert labels == [("a", "1", 0), ("a", "2", 0), ("b", "1", 0), ("b", "2", 0)]
    (tmp_path / "m.csv").write_text(
        "truth,estimate,run\na.mat,a.mat:Y{2},1\na.mat:X,b.mat:Y{1},2\nc.mat,a.mat:Y{1},3\n"
    )
    answer = invoke(*asked, "m.csv", "-o", "m")
    assert (answer.status, "line 4: c.mat does not exist" in answer.err) == (2, True)
    answer = invoke(*asked, "m.csv", "-o", "m", "--allow-missing", "--by", "run")
    totals = [group["total"] for group in json.loads(answer.out)["groups"]]
    assert totals == pytest.approx([16, 4])
    for truth, estimate, message in (
        ("a.mat:X{run}", "a.mat:Y{run}", "a.mat:Y{1}: ground truth a.mat:X{1} does not exist"),
        ("a.mat:X", "a.mat:Z{run}", "a.mat:Z{run}: no variable of a file matches"),
        ("a.mat:X", "d.mat:Y{run}", "d.mat:Y{run}: no variable of a file matches"),
    ):
        answer = invoke(*asked, "--truth", truth, "--estimate", estimate, "-o", "n")
        assert (answer.status, message in answer.err) == (2, True)
    answer = invoke(
        "compare", "a.mat:X", "a.mat:Y{2}", "b.mat:Y{1}", "-c", "20", "--format", "json"
    )
    found = json.loads(answer.out)["estimates"]
    assert sorted(entry["total"] for entry in found) == pytest.approx([4, 16])
    (tmp_path / "suite.toml").write_text(
        'max = ["total=10"]\n[[pair]]\ntruth = "a.mat:X"\nestimate = "a.mat:Y{run}"\n'
    )
    answer = invoke("gate", "--suite", "suite.toml", "-c", "20", "--format", "json")
    pairs = json.loads(answer.out)["pairs"]
    assert [(pair["name"], pair["verdict"]) for pair in pairs] == [("1", "pass"), ("2", "fail")]


def test_no_variable_is_both_sides_unless_both_name_it(invoke: Run, tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"X": BOTH, "Y": np.ones((2, 3)), "k": "text"})
    both = "a.mat: both paths mean its variable X; it has X, Y, k; name both"
    for pair in (("a.mat", "a.mat"), ("a.mat:X", "a.mat"), ("./a.mat", "a.mat:X")):
        for verb in ("evaluate", "explain", "inspect", "gate", "compare", "associate"):
            answer = invoke(verb, *pair, "-c", "10", *(["--max", "total=1"] * (verb == "gate")))
            assert (
                verb,
                answer.status,
                "both paths mean its variable X" in answer.err,
            ) == (
                verb,
                3,
                True,
            )
        with pytest.raises(InputError, match="both paths mean its variable X"):
            evaluate(*pair, 10)
    assert both in invoke("a.mat", "a.mat").err
    assert invoke("a.mat:X", "a.mat:X", "-c", "10").status == 0
    shutil.copy(RUN, "run.mat")
    with pytest.raises(InputError, match=r"name both, run.mat:Y run.mat:X$"):
        evaluate("run.mat:Y", "run.mat", 10)
    # Of another file it is read, and what is passed over is said.
    reading = read("a.mat", role="estimate")
    assert (
        "variable X; Y is no structure with the fields tVec, iVec, xState, or x, t, id, or cells "
        "X, L by step" in reading.notices
    )


def test_odd_cells(tmp_path: Path) -> None:
    empty, odd = np.zeros((0, 0)), {"a": 1}
    cell = np.empty((2, 2), object)
    cell[:] = [[empty, BOTH], [BOTH, odd]]  # by columns: empty, a run, a run, another structure
    more = {"texts": np.array(["a", "b"], object), "none": np.empty((0, 0), object)}
    savemat(tmp_path / "a.mat", {"Y": cell, **more})
    path = str(tmp_path / "a.mat")
    assert read(f"{path}:Y{{2}}").rows == read(f"{path}:Y{{3}}").rows == 4
    for number in (1, 4):
        with pytest.raises(InputError, match=rf"Y\{{{number}\}} is no structure with the fields"):
            read(f"{path}:Y{{{number}}}")
    for name in ("texts", "none{1}"):
        with pytest.raises(InputError, match=r"there are: Y\{1\} to Y\{4\}"):
            read(f"{path}:{name}")
    # A count that the file does not have.
    data = (tmp_path / "a.mat").read_bytes()
    at = data.index(struct.pack("<2i", 2, 2))
    (tmp_path / "a.mat").write_bytes(data[:at] + struct.pack("<2i", 2, 2**30) + data[at + 8 :])
    with pytest.raises(InputError, match="not a readable MAT file"):
        runs_inside(path)
    with pytest.raises(InputError, match="not a readable MAT file"):
        read(f"{path}:Y{{999999}}")


def test_without_h5py(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ConfigError, match=r"need the extra matlab: .*tgospa-eval\[matlab\]"):
        read(TRUTH_73)
    buffer = io.BytesIO()
    savemat(buffer, {"X": BOTH})
    (tmp_path / "a.mat").write_bytes(buffer.getvalue())
    assert read(tmp_path / "a.mat").rows == 4


def test_steps_are_the_second_dimension(tmp_path: Path) -> None:
    """Also those at which nothing is, as of arrays: per step divides by all."""
    sides = np.full((2, 2, 10, 1), np.nan)
    sides[0, :, 2:7], sides[1, :, 2:8] = 0, 1
    for name, state in zip("XY", sides, strict=True):
        length = int((~np.isnan(state[0])).sum())
        saved(tmp_path / f"{name}.mat", {"tVec": 3, "iVec": length, "xState": np.nan_to_num(state)})
    options = {"cutoff": 10.0, "switch_penalty": 2.0}
    found = evaluate(tmp_path / "X.mat", tmp_path / "Y.mat", **options)
    arrays = evaluate(*sides.transpose(0, 2, 3, 1), **options)
    assert found.judged["steps"] == arrays.judged["steps"] == 10
    assert found.normalised["tgospa"] == arrays.normalised["tgospa"] == pytest.approx(6**0.5)


def structures(path: Path, version: str, runs: list[dict[str, Any]]) -> Path:
    """The truth X and a structure array Y."""
    if version != "7.3":
        array = np.empty((1, len(runs)), [(name, "O") for name in runs[0]])
        for k, run in enumerate(runs):
            array[0, k] = tuple(np.asarray(values, float) for values in run.values())
        savemat(path, {"X": BOTH, "Y": array}, do_compression=version == "7")
        return path
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in BOTH.items():
            file[f"X/{name}"] = np.asarray(values).T
            field = file.create_dataset(f"Y/{name}", (len(runs), 1), h5py.ref_dtype)
            for k, run in enumerate(runs):
                file[f"#refs#/{name}{k}"] = np.asarray(run[name]).T
                field[k, 0] = file[f"#refs#/{name}{k}"].ref
    path.write_bytes(TRUTH_73.read_bytes()[:512] + path.read_bytes()[512:])
    return path


@pytest.mark.parametrize("version", ["6", "7", "7.3"])
def test_structure_arrays_are_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: str
) -> None:
    monkeypatch.chdir(tmp_path)
    moved = [BOTH | {"xState": BOTH["xState"] + [[[k + 1.0]], [[0.0]]]} for k in range(3)]
    path = structures(tmp_path / "s.mat", version, moved)
    assert runs_inside(str(path)) == ["X", "Y{1}", "Y{2}", "Y{3}"]
    for k in (1, 2, 3):
        assert evaluate("s.mat:X", f"s.mat:Y({k})", 10).total == pytest.approx(4 * k**2)
        assert read(f"s.mat:Y{{{k}}}").trajectories.state[0].tolist() == [k, 6]


def test_cells_of_arrays_are_runs(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    truth = np.cumsum(rng.normal(size=(2, 7, 3)), axis=1)  # d x T x n
    cell = np.empty((3, 1), object)
    for k in range(3):
        cell[k, 0] = truth + k
    beside = {"X": {"x": truth, "t": np.arange(1, 8)}, "t": np.arange(1, 8)}
    savemat(tmp_path / "a.mat", {**beside, "Y": cell})
    path = str(tmp_path / "a.mat")
    assert runs_inside(path) == ["X", "Y{1}", "Y{2}", "Y{3}"]
    total = evaluate(f"{path}:X", f"{path}:Y{{3}}", 10).total
    assert total == pytest.approx(7 * 3 * 8)
    savemat(tmp_path / "b.mat", {"X": BOTH, "Y": cell})
    with pytest.raises(InputError, match="d x n x T or T x n x d; name it x_dTn or x_dnT"):
        read(f"{tmp_path}/b.mat:Y{{3}}")
    savemat(tmp_path / "b.mat", {"X": BOTH, "x_dTn": cell})
    assert len(read(f"{tmp_path}/b.mat:x_dTn{{3}}").trajectories.times) == 7


def cells(values: list[Any]) -> Any:
    made = np.empty((len(values), 1), object)
    made[:, 0] = [np.asarray(value, float) for value in values]
    return made


def test_cells_by_step_of_toolboxes(tmp_path: Path) -> None:
    """As the RFS toolbox of Vo saves them: states x, vx, y, vy, and labels of two rows."""
    truth = [
        [[0, 5], [1, 0], [0, 9], [0, 1]],
        [[1], [1], [0], [0]],
        np.zeros((4, 0)),
        [[3], [1], [0], [0]],
    ]
    estimate = [
        np.zeros((0, 0)),
        [[1.5], [1], [0], [0]],
        [[2], [1], [0], [0]],
        [[3, 8], [1, 0], [0, 8], [0, 0]],
    ]
    labels = [[], [[2], [1]], [[2], [1]], [[2, 4], [1, 1]]]
    tracks = [[[1, 2]], [[1]], [], [[1]]]
    known = {"K": 4, "N": [2, 1, 0, 1], "L": cells([[]] * 4), "track_list": cells(tracks)}
    scene = {
        "truth": known | {"X": cells(truth)},
        "est": {"X": cells(estimate), "N": [0, 1, 1, 2], "L": cells(labels)},
        "meas": {"K": 4, "Z": cells(truth)},
    }
    path = str(tmp_path / "vo.mat")
    savemat(path, scene)
    columns: Any = {"columns": ("x=x0", "y=x2")}
    found = read_trajectories(f"{path}:est", **columns)
    assert (list(found.ids), len(found.times)) == (["2-1", "4-1"], 4)
    assert found.state.tolist() == [[1.5, 0], [2, 0], [3, 0], [8, 8]]
    assert list(read_trajectories(f"{path}:truth", **columns).ids) == ["1", "2"]
    with pytest.warns(TgospaWarning, match="all 4 components"):
        evaluate(path, path, 10)
    # One object at 0, 1, 3 against 1.5, 2, 3 at the steps 2, 3, 4; one object, one false state.
    result = evaluate(path, path, 2.0, 2, 1.0, **columns)
    assert result.counts["missed"] == 2
    assert result.counts["false"] == 2
    assert result.localisation == pytest.approx(0.25)
    for change, message in (
        ({"L": None}, r"X\{2\}: 1 state without labels; L or track_list must say for each"),
        ({"L": cells([[], [[2]], [[2]], [[2]]])}, r"X\{4\}: 2 states without labels"),
        (
            {"L": cells([[], [[2]], [[2]], [[2, 2]]])},
            r"X\{4\}: two states have the same label in",
        ),
        (
            {"X": cells([[], np.ones((1, 1)), np.ones((2, 1)), []])},
            "different numbers of components: 1, 2",
        ),
    ):
        changed = {k: v for k, v in (scene["est"] | change).items() if v is not None}
        savemat(path, {"truth": scene["truth"], "est": changed})
        with pytest.raises(InputError, match=message):
            evaluate(path, path, 2.0, **columns)
