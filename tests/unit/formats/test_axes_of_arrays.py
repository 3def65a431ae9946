"""States, covariances and particles as arrays: MAT, npz and in memory, whatever their axes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from tgospa_eval import InputError, TgospaWarning, Trajectories, evaluate, read_trajectories
from tgospa_eval.formats import ReadOptions, read

STEPS, TRACKS = 5, 3
RNG = np.random.default_rng(4)
STATES = RNG.normal(size=(STEPS, TRACKS, 2))
ROOTS = RNG.normal(size=(STEPS, TRACKS, 2, 2))
SPREADS = ROOTS @ ROOTS.swapaxes(2, 3)
CLOUDS = RNG.normal(size=(STEPS, TRACKS, 7, 2))
WEIGHTS = RNG.dirichlet(np.ones(7), (STEPS, TRACKS))
BESIDE = {"t": np.arange(10.0, 10.0 + STEPS), "id": np.arange(4.0, 4.0 + TRACKS)}
NUMPY = {"x": "Tnd", "P": "Tndd", "particles": "TnNd", "weights": "TnN"}
EACH = {"x": STATES, "P": SPREADS, "particles": CLOUDS, "weights": WEIGHTS}


def turned(array: np.ndarray, kind: str, axes: str) -> np.ndarray:
    """An array of the axes of NumPy with others."""
    marked = iter("DE")  # the two d of a covariance, of which either may be first
    letters = [next(marked) if letter == "d" else letter for letter in NUMPY[kind]]
    marked = iter("DE")
    wanted = [next(marked) if letter == "d" else letter for letter in axes]
    return array.transpose([letters.index(letter) for letter in wanted])


def written(path: Path, fields: dict[str, Any], way: str) -> str:
    """A structure Y, variables of a file, or one of HDF5."""
    if way == "7.3":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in fields.items():
                file[f"Y/{name}"] = np.atleast_2d(values).T
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    else:
        savemat(path, {"Y": fields} if way == "structure" else fields)
    return str(path)


@pytest.mark.parametrize("way", ["structure", "variables", "7.3"])
@pytest.mark.parametrize(
    "axes", [("dTn", "ddTn"), ("dnT", "ddnT"), ("Tnd", "Tndd"), ("Tnd", "ddnT")]
)
def test_axes_are_told_by_the_sizes(tmp_path: Path, axes: tuple[str, str], way: str) -> None:
    fields = {k: turned(EACH[k], k, a) for k, a in zip(("x", "P"), axes, strict=True)}
    side = read_trajectories(written(tmp_path / "a.mat", fields | BESIDE, way))
    want = Trajectories.from_array(STATES, covariance=SPREADS)
    assert np.array_equal(side.state, want.state)
    assert np.array_equal(side.covariance, want.covariance)
    assert (side.ids.tolist(), side.times.tolist()) == (["4", "5", "6"], [10, 11, 12, 13, 14])


@pytest.mark.parametrize("axes", [("dNTn", "NTn"), ("dNnT", "NnT"), ("TnNd", "TnN"), ("", "TnN")])
def test_particles(tmp_path: Path, axes: tuple[str, str]) -> None:
    named = "particles" if axes[0] else "particles_NndT"
    fields = {
        named: turned(CLOUDS, "particles", axes[0] or "NndT"),
        "weights": turned(WEIGHTS, "weights", axes[1]),
    }
    path = written(tmp_path / "a.mat", fields | BESIDE, "structure")
    side = read_trajectories(path, clouds=True)
    assert side.clouds is not None
    assert np.array_equal(side.clouds.points, CLOUDS.reshape(-1, 2))
    assert np.array_equal(side.clouds.weights, WEIGHTS.ravel())
    same = {"particles": CLOUDS, "weights": WEIGHTS, "t": BESIDE["t"], "id": [4, 5, 6]}
    np.savez(tmp_path / "a.npz", **same)
    given = {"cutoff": 5.0, "distance": "cloud-wasserstein"}
    pytest.importorskip("ot")
    for other in (same, tmp_path / "a.npz"):
        assert evaluate(other, path, **given).tgospa == 0


def test_the_published_structure_with_covariances(tmp_path: Path) -> None:
    state, spread = turned(STATES, "x", "dTn"), turned(SPREADS, "P", "ddTn")
    fields = {"tVec": [[1], [2], [1]], "iVec": [[5], [2], [1]], "xState": state, "P": spread}
    side = read_trajectories(written(tmp_path / "a.mat", fields | {"note": [1, 2]}, "structure"))
    there = np.array([[1, 0, 1], [1, 1, 0], [1, 1, 0], [1, 0, 0], [1, 0, 0]], bool)
    assert np.array_equal(side.state, STATES[there])
    want = Trajectories.from_array(
        np.where(there[:, :, None], STATES, np.nan), covariance=SPREADS
    ).covariance
    assert np.array_equal(side.covariance, want)
    assert "variables not used: note 1 x 2" in read(tmp_path / "a.mat").notices


SQUARE = {"x_dTn": STATES[:3].transpose(2, 0, 1), "P": SPREADS[:3].transpose(2, 3, 0, 1)}


def changed(spread: Any) -> dict[str, Any]:
    """With the covariance of one state."""
    spreads = SPREADS.copy()
    spreads[2, 1] = spread
    return {"x": STATES, "P": spreads, **BESIDE}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (SQUARE, "P may be d x d x T x n or d x d x n x T; name it P_ddTn or P_ddnT"),
        ({"x": STATES[:3]}, "d x n x T or T x n x d; name it x_dTn or x_dnT or x_Tnd, or save t"),
        ({"x": STATES[:3].T, "id": [1, 2, 3]}, "name it x_dTn or x_dnT or x_Tnd|"),
        ({"x": STATES.T, "P": SPREADS.T}, "name it x_dTn or x_dnT, or save t and id with it"),
        (
            {"x": STATES, "t": np.arange(9)},
            "x 5 x 3 x 2, T = 9: sizes do not match; x is d x T x n or",
        ),
        (
            {"x": STATES[:, 0], "t": BESIDE["t"]},
            "x 5 x 2, T = 5: sizes do not match",
        ),  # one track, or d = 1
        ({"x": STATES, "states": STATES, **BESIDE}, "x and states mean the same; leave one out"),
        ({"x": STATES, "t": np.ones((2, 2))}, "t 2 x 2; it must be a vector"),
        (changed(np.nan), 'trajectory 2, step 3 (id "5", t 12): no covariance'),
        (changed([[1, np.nan], [np.nan, 1]]), "cov_xy is blank and other entries"),
        (changed([[1, 0.5], [0.4, 1]]), "not symmetric: cov_xy is given as 0.5 and as 0.4"),
        (changed([[1, 2], [2, 1]]), "not positive semi-definite (eigenvalues -1, 3)"),
        (changed([[-1, 0], [0, 1]]), "negative variance -1"),
        (changed(np.inf), 'column "cov_x_x": infinite'),
        ({"particles": CLOUDS, "weights": -WEIGHTS, **BESIDE}, "particle of id"),
        (
            {"particles": CLOUDS, "weights": 0 * WEIGHTS, **BESIDE},
            'weights of id "4", t 10 are zero',
        ),
        ({"particles": CLOUDS, "weights": WEIGHTS[..., 1:], **BESIDE}, "sizes do not match"),
    ],
)
def test_what_is_refused(tmp_path: Path, fields: dict[str, Any], message: str) -> None:
    path = written(tmp_path / "a.mat", fields, "structure")
    with pytest.raises(InputError) as caught:
        read(path, ReadOptions(covariance=True, clouds=True))
    assert message in f"{caught.value}|"
    if not {"x_dTn", "states"} & fields.keys() and "t" in fields and "do not" not in message:
        with pytest.raises(InputError, match="estimate"):  # the same in memory
            evaluate(STATES, fields, distance="gaussian-wasserstein", mixed="moments")


def test_what_is_not_missing(tmp_path: Path) -> None:
    absent = changed(np.nan)
    absent["x"] = STATES.copy()
    absent["x"][2, 1] = np.nan
    path = written(tmp_path / "a.mat", absent, "variables")
    assert len(read_trajectories(path).state) == STEPS * TRACKS - 1
    zero = read(
        written(tmp_path / "b.mat", changed(np.nan), "structure"),
        ReadOptions(covariance=True, missing_covariance="zero"),
    )
    assert zero.trajectories.covariance is not None
    assert (zero.trajectories.covariance[7] == 0).all()
    equal = {
        "x_dTn": SQUARE["x_dTn"],
        "P": np.broadcast_to(np.eye(2)[:, :, None, None], (2, 2, 3, 3)),
    }
    assert read(written(tmp_path / "c.mat", equal, "structure")).rows == 9  # either way the same
    uneven = read(
        written(tmp_path / "d.mat", {"particles": CLOUDS, "weights": 2 * WEIGHTS, **BESIDE}, "7.3"),
        ReadOptions(clouds=True),
    )
    assert "15 clouds have weights that do not sum to 1" in " ".join(uneven.notices)


def test_variables_that_are_there(tmp_path: Path) -> None:
    path = written(
        tmp_path / "a.mat", {"Z": STATES, "t": BESIDE["t"], "id": [1, 2, 3], "k": 1}, "variables"
    )
    assert np.array_equal(read_trajectories(f"{path}:Z").state, STATES.reshape(-1, 2))
    assert "variables not used: k 1 x 1" in read(f"{path}:Z").notices
    with pytest.raises(InputError, match=r'"A" \(there are: none; in it: Z 5 x 3 x 2, t 1 x 5, id'):
        read(f"{path}:A")


def test_positions_of_arrays_with_velocities() -> None:
    four = RNG.normal(size=(STEPS, TRACKS, 4))
    places = evaluate(four[..., [0, 2]], STATES, cutoff=5.0).total
    by_id = {str(k): four[:, k] for k in range(TRACKS)}
    for side in (four, (range(STEPS), four), {"x": four}, by_id):
        assert evaluate(side, STATES, cutoff=5.0, mapping=((0, 2), (0, 1))).total == places
    columns = {"truth_columns": ("x=x0", "y=x2"), "estimate_columns": ("x", "y")}
    assert evaluate(four, STATES, cutoff=5.0, **columns).total == places
    with pytest.warns(TgospaWarning, match=r"all 4 components of the states.*mapping=\(0, 2\)"):
        evaluate(four, four, cutoff=5.0)
    spread = np.broadcast_to(np.diag([1.0, 9, 4, 9]), (STEPS, TRACKS, 4, 4))
    given = {"cutoff": 9.0, "distance": "gaussian-wasserstein", "mapping": (0, 2)}
    found = evaluate(four, {"x": four, "covariance": spread}, **given)
    assert found.total == pytest.approx(5 * STEPS * TRACKS)


def test_nothing_and_repetitions_in_memory() -> None:
    nothing = {"x": STATES[:, :0], "P": SPREADS[:, :0]}
    assert evaluate(STATES, nothing, cutoff=5.0).counts["missed"] == STEPS * TRACKS
    twice = {"x": STATES, "id": ["a", "b", "a"]}
    with pytest.raises(InputError, match=r'"a" at t 0 is already in.*on_duplicate="first" or'):
        evaluate(STATES, twice, cutoff=5.0)
    assert evaluate(STATES, twice, cutoff=5.0, on_duplicate="first").sizes["estimates"] == 2
