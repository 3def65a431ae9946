"""Derivatives against differences: of the base distances, and of whole evaluations."""

import numpy as np
import pandas as pd
import pytest
from strategies import scene as crowd

from tgospa_eval import ConfigError, Result, Trajectories, evaluate
from tgospa_eval.distances import (
    DISTANCES,
    CloudWasserstein,
    Distance,
    GaussianWasserstein,
    Mahalanobis,
    Norm,
    Reduction,
)
from tgospa_eval.evaluation import uniqueness as gradient_module

RNG = np.random.default_rng(0)
POINTS = RNG.normal(size=(2, 3, 40))
BOXES = np.abs(RNG.normal(5, 1, (4, 100)))
PLACES = np.array([RNG.uniform(-89, 89, 60), RNG.uniform(-180, 180, 60)])
SCALED = {"scale": (1, 2, 0.5), "period": (2.0, np.inf, 1.5)}
COVARIANCE = np.cov(RNG.normal(size=(3, 30)))


@pytest.mark.parametrize(
    ("distance", "a", "b"),
    [
        *((Norm(name="norm", power=p, **SCALED), *POINTS) for p in (1.0, 2.0, np.inf)),
        (Norm(name="norm", power=2.0), *POINTS[:, :1]),
        (Mahalanobis(covariance=COVARIANCE, scale=(1, 3, 2)), *POINTS),
        (DISTANCES["iou"], BOXES, BOXES + RNG.normal(0, 0.5, BOXES.shape)),
        (DISTANCES["iou"], BOXES, BOXES + 20),
        (DISTANCES["haversine"], PLACES, PLACES + RNG.normal(0, 0.5, PLACES.shape)),
    ],
)
def test_slopes_of_distances(distance: Distance, a: np.ndarray, b: np.ndarray) -> None:
    slopes = distance.slopes_between(a, b)
    assert np.array_equal(distance.slopes_between(a, a), np.zeros_like(a)) or b.shape[0] == 4
    for k in range(len(b)):
        by = np.zeros_like(b)
        by[k] = 1e-6
        higher, lower = (distance.between(zip(a, side, strict=True)) for side in (b + by, b - by))
        difference = (higher - lower) / 2e-6
        assert slopes[k] == pytest.approx(difference, rel=1e-6, abs=1e-8 * np.abs(slopes).max())


def scene(distance: str) -> tuple[np.ndarray, np.ndarray]:
    """Tracks with gaps, of which two are swapped for a while."""
    rng = np.random.default_rng(3)
    size = 4 if distance == "iou" else 2
    truth = rng.uniform(0, 20, (1, 4, size)) + np.cumsum(rng.normal(0, 0.5, (9, 4, size)), axis=0)
    estimate = truth + rng.normal(0, 0.3, truth.shape)
    estimate[4:, [0, 1]] = estimate[4:, [1, 0]]
    estimate[3:5, 2] = np.nan
    truth[:2, 3] = np.nan
    return np.abs(truth), np.abs(estimate)


@pytest.mark.parametrize("order", [1, 1.5, 2])
@pytest.mark.parametrize("distance", ["euclidean", "manhattan", "chebyshev", "haversine", "iou"])
@pytest.mark.parametrize("family", [{}, {"rho": 0.3, "step_weights": np.linspace(1, 3, 9)}])
def test_derivatives_are_differences(
    distance: str, order: float, family: dict[str, object]
) -> None:
    truth, estimate = scene(distance)
    cutoff = {"iou": 0.9, "haversine": 3e5}.get(distance, 3.0)
    gamma = 0.4 * cutoff

    def total(moved: np.ndarray = estimate, c: float = cutoff, g: float = gamma) -> float:
        return evaluate(truth, moved, c, order, g, distance=distance, **family).total

    result = evaluate(truth, estimate, cutoff, order, gamma, distance=distance, **family)
    gradient = result.gradient()
    assert gradient.unique
    scale = np.abs(gradient.total).max()
    for step, track, column in [(0, 0, 0), (3, 1, 1), (5, 2, 1)]:
        by = np.zeros_like(estimate)
        by[step, track, column] = 1e-6
        difference = (total(estimate + by) - total(estimate - by)) / 2e-6
        assert gradient.array[step, track, column] == pytest.approx(difference, abs=1e-4 * scale)
    h = 1e-6 * cutoff
    by_cutoff = (total(c=cutoff + h) - total(c=cutoff - h)) / (2 * h)
    by_penalty = (total(g=gamma + h) - total(g=gamma - h)) / (2 * h)
    assert gradient.cutoff == pytest.approx(by_cutoff, rel=1e-5)
    assert gradient.switch_penalty == pytest.approx(by_penalty, rel=1e-5)
    assert gradient.root * gradient.total == pytest.approx(gradient.tgospa)
    assert gradient.root == pytest.approx(result.tgospa / (order * result.total))


def test_gaussians_are_moved_by_their_means() -> None:
    rng = np.random.default_rng(4)
    means = rng.normal(0, 1, (2, 3, 2, 2))

    def side(states: np.ndarray, spread: float) -> Trajectories:
        return Trajectories.from_array(states, covariance=np.diag([spread, 1.0]))

    def run(moved: np.ndarray) -> object:
        return evaluate(
            side(means[0], 1.0), side(moved, 4.0), 8, 2, 1, distance=GaussianWasserstein()
        )

    gradient = run(means[1]).gradient()
    for at in np.ndindex(3, 2, 2):
        by = np.zeros_like(means[1])
        by[at] = 1e-6
        difference = (run(means[1] + by).total - run(means[1] - by).total) / 2e-6
        assert gradient.array[at] == pytest.approx(difference, abs=1e-5)


def test_where_it_is_not_unique() -> None:
    """Two estimates that are as near: either may be followed, and a state has either slope."""
    truth = np.zeros((1, 1, 1))
    tied = evaluate(truth, np.array([[[1.0], [-1.0]]]), 5, 2, 1)
    assert not tied.gradient().unique
    single = evaluate(truth, np.array([[[1.0], [-1.1]]]), 5, 2, 1)
    assert single.gradient().unique
    assert evaluate(truth, truth, 5, 2, 1).gradient().root == 0.0
    assert evaluate(truth, truth + 9, 5, 2, 1).gradient().unique  # no pair is near
    free = evaluate(truth, truth + 1, 5, 1, 0).gradient()
    assert np.isnan(free.switch_penalty)


@pytest.mark.parametrize("numpy", [False, True])
def test_crowds_have_one_best_assignment(numpy: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows that compete are indifferent at the prices; conclusions from one to the other decide."""
    if numpy:
        monkeypatch.setattr(gradient_module, "kernels", None)
    for seed in range(6):
        truth, estimate = crowd(seed, 6, 7, 12, side=8.0, noise=1.0)
        result = evaluate(truth, estimate, 4, 2, 1)
        gradient = result.gradient()
        assert gradient.unique
        # No kink: the differences to both sides are the same, and the derivative.
        way = np.random.default_rng(seed).normal(size=estimate.shape)
        h = 1e-5
        both = [evaluate(truth, estimate + sign * h * way, 4, 2, 1).total for sign in (1, -1)]
        slope = np.nansum(gradient.array * way)
        assert (both[0] - result.total) / h == pytest.approx(slope, abs=2e-2)
        assert (result.total - both[1]) / h == pytest.approx(slope, abs=2e-2)
        # A second copy of an estimate that is followed may be followed as well.
        followed = int(result.assignments["estimate"].iloc[0])
        twice = np.concatenate((estimate, estimate[:, [followed]]), axis=1)
        assert not evaluate(truth, twice, 4, 2, 1).gradient().unique


def test_losses_of_paths_are_those_of_the_kernels() -> None:
    truth, estimate = crowd(1, 6, 7, 15, side=10.0, noise=1.0)
    proof = evaluate(truth, estimate, 4, 2, 1).proof
    value = proof.states.gain - proof.states.columns.totals(proof.prices)
    through, without = gradient_module.path_losses(proof.states, value)
    assert min(through.min(), without.min()) > -1e-12
    for reach in (1e-9, 0.01, 0.3):
        near, needed = gradient_module._marks(proof.states, value, proof.prices, reach)
        assert np.array_equal(near, through <= reach)
        assert np.array_equal(needed, without > reach)


def test_table() -> None:
    truth = pd.DataFrame({"id": ["a", "a"], "t": [1.5, 2.5], "x": [0.0, 0.0]})
    estimate = truth.assign(id="b", x=[1.0, 3.0])
    table = evaluate(truth, estimate, 10, 2, 1).gradient().table
    assert table.to_dict("list") == {"id": ["b", "b"], "t": [1.5, 2.5], "x": [2.0, 6.0]}


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("inner", ["euclidean", "mahalanobis"])
def test_clouds_are_moved_particle_by_particle(order: int, inner: str) -> None:
    pytest.importorskip("ot")
    rng = np.random.default_rng(5)
    sides = [
        pd.DataFrame(
            {
                "id": np.repeat([1, 2, 1, 2], 5),
                "t": np.repeat([0, 0, 1, 1], 5),
                "x": np.repeat([0, 9, 0, 9], 5) + rng.normal(size=20),
                "y": rng.normal(size=20),
                "weight": rng.dirichlet(np.ones(5), 4).ravel(),
            }
        )
        for _ in range(2)
    ]
    covariance = {"covariance": [[2.0, 0.5], [0.5, 1.0]]} if inner == "mahalanobis" else {}
    distance = CloudWasserstein(order=order, inner=inner, scale=(1.0, 2.0), **covariance)

    def run(moved: pd.DataFrame) -> Result:
        return evaluate(sides[0], moved, 8, 1.5, 1, distance=distance)

    gradient = run(sides[1]).gradient()
    table = gradient.table
    assert table["id"].tolist() == sides[1]["id"].astype(str).tolist()
    for row in range(0, 20, 5):
        for column in ("x", "y"):
            both = []
            for sign in (1, -1):
                moved = sides[1].copy()
                moved.loc[row, column] += sign * 1e-6
                both.append(run(moved).total)
            difference = (both[0] - both[1]) / 2e-6
            assert table[column][row] == pytest.approx(difference, abs=1e-5)
    whole = np.add.reduceat(gradient.particles, gradient.first_particle[:-1])
    assert gradient.total == pytest.approx(whole)


def test_clouds_that_data_change_have_none() -> None:
    rows = {"id": [1, 1], "t": [0, 0], "x": [0.0, 1.0], "weight": [0.5, 0.5]}
    pytest.importorskip("ot")
    for distance, message in (
        (
            CloudWasserstein(reduction=Reduction(size=1)),
            "no derivative is known for reduced clouds",
        ),
        (CloudWasserstein(inner="mahalanobis"), "is taken from the data"),
    ):
        result = evaluate(pd.DataFrame(rows), pd.DataFrame(rows), 5, 2, 1, distance=distance)
        with pytest.raises(ConfigError, match=message):
            result.gradient()


def test_states_are_those_that_are_evaluated() -> None:
    """In the unit of the truth: a scaled estimate has the gradient of its scaled states."""
    truth = np.cumsum(np.full((6, 2, 2), 30.0), axis=0)
    table = pd.DataFrame({"id": 1, "t": range(6), "x": 30.0 + 30 * np.arange(6), "y": 31.0})
    scaled = table.assign(x=table["x"] / 1000, y=table["y"] / 1000)
    metric = {"cutoff": 300.0, "switch_penalty": 10.0}
    plain = evaluate(truth, table, **metric).gradient()
    other = evaluate(truth, scaled, **metric, unit_scale=1000).gradient()
    assert np.abs(plain.total).max() > 1
    assert other.total == pytest.approx(plain.total)
