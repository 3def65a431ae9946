"""NEES of assigned pairs: values, bands, words, and what `compare` says beside an order."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Invoke

from tgospa_eval import Trajectories, evaluate
from tgospa_eval.evaluation.consistency import ranks, shortest_differences, squared
from tgospa_eval.problem.solution import AssignedPairs
from tgospa_eval.results.consistency import NeesSums, nees_sums
from tgospa_eval.tracks import covariances
from tgospa_eval.tracks.clouds import Clouds

Array = np.ndarray[Any, Any]


def random_covariances(rng: np.random.Generator, count: int, d: int) -> Array:
    half = rng.normal(size=(count, d, d))
    found: Array = half @ half.transpose(0, 2, 1) + 0.1 * np.eye(d)
    return found


@pytest.mark.parametrize("d", [1, 2, 3, 6])
def test_nees_is_the_squared_mahalanobis_distance_of_stone_soup(d: int) -> None:
    from stonesoup.measures import SquaredMahalanobis
    from stonesoup.types.state import GaussianState

    rng = np.random.default_rng(d)
    matrices, errors = random_covariances(rng, 20, d), rng.normal(size=(20, d))
    found = squared(errors.T, covariances.factor(covariances.pack(matrices)))
    measure = SquaredMahalanobis()
    for value, error, matrix in zip(found, errors, matrices, strict=True):
        estimate = GaussianState(error[:, None], matrix)
        truth = GaussianState(np.zeros((d, 1)), matrix)
        assert value == pytest.approx(float(measure(estimate, truth)), rel=1e-9)


def test_singular_covariances_have_no_nees_and_are_counted() -> None:
    truth = Trajectories.from_array(np.zeros((3, 1, 2)))
    spread = np.array([np.eye(2), np.diag([1.0, 0.0]), np.eye(2)])[:, None]
    estimate = Trajectories.from_array(np.ones((3, 1, 2)), covariance=spread)
    result = evaluate(truth, estimate, 10, 2, 5, distance="gaussian-wasserstein")
    assert result.nees is not None
    assert (result.nees.pairs, result.nees.singular, result.nees.mean) == (2, 1, 2.0)
    assert result.table("per_step")["nees"] == [2.0, None, 2.0]
    assert result.table("assignments")["nees"] == [2.0, None, 2.0]
    assert result.table("per_truth")["nees"] == [2.0]
    assert result.metrics()["nees.anees"] == 1.0


def test_covariances_as_good_as_none_are_no_numbers_of_the_json() -> None:
    truth = Trajectories.from_array(np.zeros((3, 1, 1)))
    estimate = Trajectories.from_array(np.ones((3, 1, 1)), covariance=np.array([[1e-250]]))
    result = evaluate(truth, estimate, 10, 2, 5, distance="gaussian-wasserstein")
    assert json.loads(result.to_json())["nees"]["sums"]["singular"] == 3
    assert json.loads(result.to_json())["nees"]["mean"] is None


def test_the_truth_has_errors_of_its_own() -> None:
    both = [
        Trajectories.from_array(np.full((1, 1, 1), place), covariance=np.full((1, 1, 1, 1), size))
        for place, size in ((0.0, 3.0), (2.0, 1.0))
    ]
    result = evaluate(both[0], both[1], 10, 2, 5, distance="gaussian-wasserstein")
    assert result.nees is not None
    assert result.nees.mean == pytest.approx(2**2 / (3 + 1))


def test_periodic_components_are_compared_the_shorter_way_round() -> None:
    found = shortest_differences(np.array([[350.0, 350.0], [10.0, -10.0]]), [360.0, np.inf])
    assert found.tolist() == [[-10.0, 350.0], [10.0, -10.0]]


def filter_runs(tracks: int, steps: int, noise: float, rng: np.random.Generator) -> Array:
    """NEES (steps, tracks) of Kalman filters of 2-D motion; `noise` over the one they assume."""
    move = np.array([[1.0, 1.0], [0.0, 1.0]])
    process = 0.05 * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    root, spread = np.linalg.cholesky(process), np.eye(2)
    error = rng.normal(size=(tracks, 2, 2)) * noise  # by track, axis, and place or speed
    found = np.zeros((steps, tracks))
    for step in range(steps):
        if step:
            error = error @ move.T + noise * rng.normal(size=(tracks, 2, 2)) @ root.T
            spread = move @ spread @ move.T + process
            gain = spread[:, 0] / (spread[0, 0] + 1)
            error = error - (error[..., 0] + noise * rng.normal(size=(tracks, 2)))[..., None] * gain
            spread = spread - np.outer(gain, spread[0])
        found[step] = (error[..., 0] ** 2).sum(axis=1) / spread[0, 0]
    return found


def sums_of(nees: Array) -> NeesSums:
    step, track = (each.ravel() for each in np.indices(nees.shape))
    pairs = AssignedPairs(
        step=step, truth=track, estimate=track, entry=step, weight=np.ones(nees.size)
    )
    return nees_sums(pairs, nees.ravel(), 2)


def test_a_calibrated_filter_is_consistent() -> None:
    rng = np.random.default_rng(7)
    found = [sums_of(filter_runs(10, 60, 1.0, rng)) for _ in range(200)]
    # Values of 600 dependent states; the share inside is that of some 45,000 independent ones.
    inside = sum(one.inside for one in found) / sum(one.pairs for one in found)
    assert inside == pytest.approx(0.95, abs=4 * (0.95 * 0.05 / 45_000) ** 0.5)
    consistent = sum(one.verdict == "consistent" for one in found)
    assert 180 <= consistent <= 199
    assert sum(bool(one.warnings(None)) for one in found) <= 4


@pytest.mark.parametrize(("noise", "verdict"), [(1.5, "overconfident"), (0.7, "underconfident")])
def test_other_filters_are_not(noise: float, verdict: str) -> None:
    rng = np.random.default_rng(8)
    for _ in range(20):
        found = sums_of(filter_runs(10, 60, noise, rng))
        assert found.verdict == verdict
        assert [notice.code for notice in found.warnings(None)] == [verdict]


def test_sums_of_several_runs_are_those_of_one() -> None:
    rng = np.random.default_rng(9)
    nees = filter_runs(6, 30, 1.0, rng)
    parts = NeesSums.joined([sums_of(nees[:, :2]), sums_of(nees[:, 2:])])
    assert parts is not None
    whole = sums_of(nees)
    assert parts.plain() == {name: pytest.approx(value) for name, value in whole.plain().items()}


def test_ranks_of_particles_are_flat_where_they_are_drawn_from_the_posterior() -> None:
    rng = np.random.default_rng(10)
    states, number = 2000, 50
    centre = rng.normal(size=(states, 2)) * 30
    points = (centre[:, None] + rng.normal(size=(states, number, 2))).reshape(-1, 2)
    clouds = Clouds(
        points=points,
        weights=np.full(len(points), 1 / number),
        first=np.arange(states + 1) * number,
    )
    rows, weight = np.arange(states), np.ones(states)
    flat = ranks(centre + rng.normal(size=(states, 2)), clouds, rows, weight)
    assert flat.sum(axis=1) == pytest.approx(states)
    chi = ((flat - states / 10) ** 2 / (states / 10)).sum(axis=1)
    assert (chi < 25).all()  # of 9 degrees of freedom
    wide = ranks(centre + 3 * rng.normal(size=(states, 2)), clouds, rows, weight)
    assert (wide[:, [0, 9]] > 2.5 * states / 10).all()


def test_the_parts_of_tables_add_up() -> None:
    rng = np.random.default_rng(11)
    truth = Trajectories.from_array(rng.normal(size=(20, 3, 2)) + np.arange(3)[:, None] * 40)
    estimate = Trajectories.from_array(
        truth.dense() + rng.normal(size=(20, 3, 2)), covariance=np.eye(2)
    )
    result = evaluate(truth, estimate, 10, 2, 5, distance="gaussian-wasserstein")
    for name in ("localisation_mean", "localisation_spread"):
        for table in ("per_step", "assignments", "per_truth", "per_estimate"):
            assert sum(result.table(table)[name]) == pytest.approx(getattr(result, name))
    assert "nees" not in evaluate(truth, truth, 10, 2, 5).table("per_step")


def write_filters() -> None:
    """A truth, a calibrated filter, and one with larger errors that claims a tenth of them."""
    rng = np.random.default_rng(12)
    rows: dict[str, list[str]] = {"truth": [], "right": [], "sure": []}
    for track in range(10):
        for step in range(50):
            place = np.array([100.0 * track, float(step)])
            rows["truth"].append(f"{track},{step},{place[0]},{place[1]}")
            for name, error, claimed in (("right", 1.0, 1.0), ("sure", 1.2, 0.1)):
                x, y = place + rng.normal(0, error, 2)
                rows[name].append(f"e{track},{step},{x:.6f},{y:.6f},{claimed},0,{claimed}")
    for name, lines in rows.items():
        head = "id,t,x,y" + ("" if name == "truth" else ",cov_xx,cov_xy,cov_yy")
        Path(f"{name}.csv").write_text("\n".join([head, *lines, ""]))


def test_saved_results_are_compared_with_it(invoke: Invoke) -> None:
    write_filters()
    for name in ("right", "sure"):
        invoke(
            *("truth.csv", f"{name}.csv", "-c", "10", "-g", "5", "-q", "-o", name),
            *("--distance", "gaussian-wasserstein"),
        )
    answer = invoke("compare", "right", "sure", "-q")
    assert "overconfident" in answer.out
    assert answer.out.count("NEES") > 1
    path = Path("sure/result.json")
    saved = json.loads(path.read_text())
    for name, value in [
        ("pairs", "x"), ("pairs", -1), ("total", True), ("components", 2.5), ("ranks", [[1]]),
        ("unknown", 1),
    ]:  # fmt: skip
        forged = saved | {"nees": {**saved["nees"], "sums": {**saved["nees"]["sums"], name: value}}}
        path.write_text(json.dumps(forged))
        answer = invoke("compare", "right", "sure", "-q")
        assert answer.status == 3
        assert "internal error" not in answer.err
    path.write_text(json.dumps(saved | {"localisation_mean": "much"}))
    assert "localisation_mean is" in invoke("compare", "right", "sure", "-q").err
