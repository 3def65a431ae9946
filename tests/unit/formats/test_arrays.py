"""Arrays (T, k, d) in npy and npz files: the answer of CSV, and what is wrong with some."""

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Run, Write

from tgospa_eval import InputError, Trajectories
from tgospa_eval.formats import ReadOptions, read


def npy(array: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def npz(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def states(seed: int, size: int = 2) -> Any:
    rng = np.random.default_rng(seed)
    found = 9 * rng.random((1, 3, size)) + rng.normal(size=(8, 3, size))
    found[rng.random((8, 3)) < 0.2] = np.nan
    found[3] = np.nan  # a step without objects remains one
    return found


def same(found: Trajectories, want: Trajectories) -> None:
    for name in ("step", "track", "state", "ids", "times"):
        assert np.array_equal(getattr(found, name), getattr(want, name)), name
    assert found.columns == want.columns


@pytest.mark.parametrize("kind", ["<f8", ">f8", "f4", "fortran"])
def test_the_answer_of_the_csv_file(invoke: Run, write: Write, kind: str) -> None:
    asked, found, want = ("-c", "5", "-g", "2", "--format", "csv"), [], []
    for seed, name in enumerate("ab"):
        array = states(seed)
        array = np.asfortranarray(array) if kind == "fortran" else array.astype(kind)
        found.append(write(f"{name}.npy", npy(array)))
        side = Trajectories.from_array(np.asarray(array, np.float64))
        same(read(found[-1]).trajectories, side)
        rows = (
            f"{k},{t},{x!r},{y!r}\n"
            for t, step in enumerate(array.astype(float).tolist())
            for k, (x, y) in enumerate(step)
        )
        want.append(write(f"{name}.csv", "id,t,x,y\n" + "".join(rows)))
    answers = invoke(*found, *asked), invoke(*want, *asked)
    assert answers[0].status == 0
    assert answers[0].out == answers[1].out
    assert "read as npy" in answers[0].err


def test_ids_times_and_columns_beside_it(write: Write) -> None:
    array = np.arange(12.0).reshape(2, 2, 3)
    times = np.array(["2024-01-01T00:00:00", "2024-01-01T00:00:01"], "datetime64[ns]")
    data = npz(anything=array, t=times, ids=["b", "a"], columns=["vx", "y", "x"])
    side = read(write("a.npz", data)).trajectories
    assert (side.ids.tolist(), side.columns, side.clock) == (["a", "b"], ("x", "y"), "local")
    assert side.state[:, 0].tolist() == [5, 2, 11, 8]  # a before b
    side = read(write("a", data), ReadOptions(columns=("vx",), attributes=("y",))).trajectories
    assert (side.state[:, 0].tolist(), side.attributes["y"].tolist()) == (
        [3, 0, 9, 6],
        [4, 1, 10, 7],
    )
    side = read(write("a.npz", npz(s=array, times=[5, 7], columns=["p", "q", "r"]))).trajectories
    assert (side.columns, side.times.tolist()) == (("p", "q", "r"), [5, 7])
    four = write("b.npy", npy(states(0, 4)))
    assert read(four).trajectories.columns == ("x0", "x1", "x2", "x3")
    boxes = read(write("c.npy", npy(np.ones((1, 1, 4)))), ReadOptions(boxes=True)).trajectories
    assert boxes.columns == ("left", "top", "width", "height")
    empty = read(write("d.npy", npy(np.zeros((4, 0, 2)))))
    assert (empty.rows, empty.trajectories.columns) == (0, ("x", "y"))


SQUARE = np.zeros((2, 2, 2))
HUGE = npy(SQUARE).replace(b"(2, 2, 2)", b"(2, 2,99)")


def header(*shape: int, kind: str = "<f8") -> bytes:
    """An npy file without a number."""
    buffer = io.BytesIO()
    about = {"descr": kind, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(buffer, about)
    return buffer.getvalue()


def zipped(name: str, content: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(name, content)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.npy", b"", "is empty"),
        ("a.npy", npy(np.zeros((2, 2))), r"shape \(2, 2\); states have the axes \(T, k, d\)"),
        ("a.npy", npy(SQUARE)[:-1], "63 bytes instead of 64"),
        ("a.npy", HUGE, "64 bytes instead of 3,168"),
        ("a.npy", npy(SQUARE)[:40], "not a readable npy file"),
        ("a.npy", b"\x93NUMPY\x09\x00" + bytes(99), "not a readable npy file"),
        ("a.npy", npy(np.full((1, 1, 1), None)), "Python objects"),
        (
            "a.npy",
            npy(SQUARE.astype(complex)),
            "states of type complex128; it must be of real numbers",
        ),
        ("a.npy", npy(SQUARE[:, :, :0]), "states 2 x 2 x 0: states have no coordinates"),
        ("a.npy", npy(SQUARE + np.inf), 'trajectory 0, step 0, column "x": infinite'),
        ("a.npy", header(10**18, 0, 2), "not a readable npy file: array is too big"),
        ("a.npy", header(10**9, 0, 2 * 10**9, kind="|b1"), "0 x 2000000000: too large for memory"),
        ("a.npy", header(3, kind="|V0"), "not a readable npy file: itemsize cannot be zero"),
        ("a.npy", header(0, 2, 10**11), "states 0 x 2 x 100000000000: reading it needs about"),
        ("a.npz", zipped("x.npy", header(0, 10**11)), "x 0 x 100000000000: reading it needs about"),
        (
            "a.npz",
            zipped("x.npy", b"no array"),
            'not a readable npz file: "x" in it is not an array',
        ),
        (
            "a.npz",
            zipped("xl/sheet1.xml", b"<x/>"),
            '"xl/sheet1.xml" in it is not an array; .* as CSV',
        ),
        ("a.npz", b"id,t,x,y\n1,2,3,4\n", "a readable npz file; numpy.savez writes one"),
        ("a.npz", npz(a=SQUARE, b=SQUARE), "a 2 x 2 x 2, b 2 x 2 x 2: none is named as states"),
        (
            "a.npz",
            npz(a=SQUARE, weight=[1]),
            "weight 1, a 2 x 2 x 2: sizes do not match; weight is T x n x N",
        ),
        ("a.npz", npz(a=SQUARE, t=[1]), "a 2 x 2 x 2, T = 1: sizes do not match; a is T x n x d"),
        ("a.npz", npz(a=SQUARE, columns=["x", "x"]), "x, x: a name is a duplicate"),
        ("a.npz", npz(a=SQUARE, columns=["x", "t"]), "a column of the states is named t"),
        ("a.npz", npz(a=SQUARE, ids=["a", "a"]), 'id "a" at t 0 is already in'),
        ("a.npz", npz(a=SQUARE, t=[0, np.nan]), "not a finite time|blank time"),
    ],
)
def test_what_is_wrong(write: Write, name: str, data: bytes, message: str) -> None:
    path = write(name, data)
    with pytest.raises(InputError, match=message):
        read(path)


@pytest.mark.parametrize("shape", [(10**11, 0, 2), (0, 10**11, 2), (10**6, 10**6, 0, 2)])
def test_what_is_empty_takes_no_room(write: Write, shape: tuple[int, ...]) -> None:
    name = "x" if len(shape) == 3 else "particles"
    assert read(write("a.npz", zipped(f"{name}.npy", header(*shape)))).rows == 0


def test_room(write: Write) -> None:
    path = write("a.npy", npy(np.zeros((100, 100, 2))))
    with pytest.raises(InputError, match="states 100 x 100 x 2: reading it needs about"):
        read(path, ReadOptions(max_input=0.001))
    assert Path(path).stat().st_size < 1_000_000
