"""Near pairs against all pairs of every step, on scenes that are hard for a search."""

import subprocess
import sys

import numpy as np
import pytest
from all_pairs import WAYS, assert_as_by_brute_force, go, table

from tgospa_eval.distances import DISTANCES, near_pairs
from tgospa_eval.distances import pair_search as points
from tgospa_eval.distances.vector import Norm
from tgospa_eval.evaluation.diagnosis import median_nearest
from tgospa_eval.kernels import kernels

NORMS = ("euclidean", "manhattan", "chebyshev")


def places(kind: str, count: int, size: int, rng: np.random.Generator) -> np.ndarray:
    """Points for the cutoff 5."""
    spread = rng.uniform(0, 40, (count, size))
    if kind == "lattice":  # many distances are exactly the cutoff, many coordinates are equal
        return np.round(spread / 5) * 5 + rng.choice([0.0, 3.0, 4.0], (count, size))
    if kind == "one place":
        return np.full((count, size), 7.25)
    if kind == "two places":
        return np.where(rng.random((count, 1)) < 0.5, 0.0, np.full(size, 6.0))
    if kind == "vertical":
        spread[:, 0] = 3.0
    if kind == "diagonal":
        spread = spread[:, :1] + rng.normal(0, 0.1, (count, size))
    if kind == "far away":
        spread += 1e8
    if kind == "negative":
        spread -= 1e8 / 3
    if kind == "huge":
        spread *= 1e300
        spread[: count // 2] = spread[0]
    if kind == "overflow":
        spread = rng.choice([-1.7e308, 0.0, 1.7e308], (count, size))
    if kind == "outlier":
        spread[: count // 8] = 1e300
    if kind == "tiny":
        spread[: count // 2] *= 1e-290
    return spread


KINDS = ["plain", "lattice", "one place", "two places", "vertical", "diagonal", "far away"]
KINDS += ["negative", "huge", "overflow", "outlier", "tiny"]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", KINDS)
def test_near_pairs(kind: str, way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    go(way, monkeypatch)
    rng = np.random.default_rng([KINDS.index(kind), len(way)])
    for size in (1, 2, 3, 4):
        count = int(rng.integers(20, 40))
        steps = rng.integers(0, 4, (2, count)) * 2 + [[0], [1]] * rng.integers(0, 2, count)
        truth, estimate = (table(step, places(kind, count, size, rng), 9) for step in steps)
        for norm in NORMS:
            assert_as_by_brute_force(truth, estimate, 5.0, DISTANCES[norm])
        for cutoff in (1e-3, 1e300):
            assert_as_by_brute_force(truth, estimate, cutoff, DISTANCES["manhattan"])


@pytest.mark.parametrize("order", ["as drawn", "by row"])
def test_many_at_a_step(order: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Enough rows for cells along two axes without any other patch."""
    go("search", monkeypatch)
    rng = np.random.default_rng(3)
    state = rng.uniform(0, 60, (2, 700, 2))
    if order == "by row":
        state = np.sort(state, axis=1)
    truth, estimate = (table(np.repeat([0, 3], 350), part, 5) for part in state)
    assert_as_by_brute_force(truth, estimate, 5.0, DISTANCES["euclidean"])


@pytest.mark.parametrize("counts", [(0, 0), (0, 5), (5, 0)])
@pytest.mark.parametrize("steps", [5, 0])
def test_an_empty_side(counts: tuple[int, int], steps: int) -> None:
    sides = [
        table(np.arange(count if steps else 0), np.zeros((count if steps else 0, 2)), steps)
        for count in counts
    ]
    pairs = near_pairs(*sides, 5.0, DISTANCES["euclidean"])
    assert len(pairs.truth_row) == len(pairs.estimate_row) == len(pairs.distance) == 0
    assert median_nearest(*sides, DISTANCES["euclidean"]) is None


@pytest.mark.parametrize("name", NORMS)
def test_norms(name: str) -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 6, 1, 5))
    order = {"euclidean": 2, "manhattan": 1, "chebyshev": np.inf}[name]
    expected = np.linalg.norm(a - b.swapaxes(0, 1), ord=order, axis=-1)
    assert np.allclose(DISTANCES[name](a, b.swapaxes(0, 1)), expected, rtol=1e-14)


def test_median_of_the_nearest() -> None:
    truth = table(np.array([0, 0, 1, 3]), np.array([[0.0], [10.0], [0.0], [0.0]]), 4)
    estimate = table(np.array([0, 0, 2, 3]), np.array([[1.0], [13.0], [0.0], [7.0]]), 4)
    assert median_nearest(truth, estimate, DISTANCES["euclidean"]) == 3.0


@pytest.mark.process
def test_a_sparse_scene_does_without_scipy() -> None:
    code = (
        "import sys, numpy as np; from tgospa_eval.tracks.trajectories import Trajectories;"
        "from tgospa_eval.distances import DISTANCES, near_pairs;"
        "x = Trajectories.from_array(np.random.default_rng(0).uniform(0, 300, (5, 400, 2)));"
        "print(len(near_pairs(x, x, 5.0, DISTANCES['euclidean']).distance) > 0,"
        "      'scipy' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["True", "False"]


@pytest.mark.skipif(kernels is None, reason="no compiled kernels here")
@pytest.mark.parametrize("kind", KINDS)
def test_points_without_a_search(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pairs and the distances of a search, bit by bit, and those of each nearest estimate."""
    rng = np.random.default_rng(KINDS.index(kind))
    for size, norm in enumerate((*NORMS, "euclidean"), 1):
        scale = tuple(rng.uniform(0.5, 2, size)) if size % 2 else None
        distance = Norm(name=norm, power=DISTANCES[norm].power, scale=scale)
        steps = rng.integers(0, 4, (2, 60))
        sides = tuple(table(step, places(kind, 60, size, rng), 5) for step in steps)
        every = np.arange(5)
        rows = tuple(points.rows_at(side, every) for side in sides)
        found = points.near_points(sides, rows, 5.0, distance)
        with monkeypatch.context() as patch:
            patch.setattr(points, "kernels", None)
            searched = near_pairs(*sides, 5.0, distance)
        for name in ("truth_row", "estimate_row", "distance"):
            assert getattr(found, name).tobytes() == getattr(searched, name).tobytes()
        near = median_nearest(*sides, distance)
        with monkeypatch.context() as patch:
            patch.setattr(points, "kernels", None)
            assert near == median_nearest(*sides, distance)
            assert points.near_points(sides, rows, 5.0, distance) is None
    monkeypatch.setattr(points, "MAX_PAIRS", -1)
    assert points.near_points(sides, rows, 5.0, distance) is None
