"""Particle clouds one by one: transport, resampling, reduction. Examples were worked out otherwise:
by hand, with 60 digits, by a general linear programme, by explicit least squares.
"""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from oracles import cloud_distance

from tgospa_eval import ConfigError
from tgospa_eval.distances import (
    cloud_wasserstein,
    cross_covariance,
    reduce_cloud,
    resample_cloud,
    restrict_cloud,
    transport_plan,
)
from tgospa_eval.distances.reduction import (
    METHODS,
    Reduction,
    sliced_wasserstein,
    slot_means,
)
from tgospa_eval.distances.transport import north_west

X = np.array([(0, 0), (2, 0), (0, 3)], float)
U = np.array([0.5, 0.3, 0.2])
Y = np.array([(1, 0), (0, 2)], float)
V = np.array([0.6, 0.4])

Cloud = tuple[NDArray[np.float64], NDArray[np.float64]]


@st.composite
def clouds(draw: st.DrawFn, size: int, most: int = 6) -> Cloud:
    """Small clouds with coincident particles and particles without weight."""
    count = draw(st.integers(1, most))
    points = draw(st.lists(st.tuples(*[st.integers(-4, 4)] * size), min_size=count, max_size=count))
    weights = draw(st.lists(st.integers(0, 5), min_size=count, max_size=count).filter(any))
    return np.array(points, float) / 2, np.array(weights) / sum(weights)


# --- distance -------------------------------------------------------------------------------------


def test_distances_of_the_worked_examples() -> None:
    assert cloud_wasserstein(X, U, Y, V, order=1) == pytest.approx(1.2, rel=1e-12)
    assert cloud_wasserstein(X, U, Y, V) == pytest.approx(np.sqrt(1.6), rel=1e-12)
    point = [(1, 1)], [1]
    assert cloud_wasserstein(X, U, *point) == pytest.approx(1.61245154965971, rel=1e-13)
    assert cloud_wasserstein(X, U, *point, order=1) == pytest.approx(1.578584445398434, rel=1e-13)
    assert cloud_wasserstein(X, U, [(0.6, 0.6)], [1]) ** 2 == pytest.approx(2.28, rel=1e-13)
    line = [0, 1, 3], [0.2, 0.5, 0.3], [0.5, 2], [0.5, 0.5]
    assert cloud_wasserstein(*line, order=1) == pytest.approx(0.75, rel=1e-13)
    assert cloud_wasserstein(*line) == pytest.approx(np.sqrt(0.625), rel=1e-13)
    covariance = [[0.54, -0.42], [-0.42, 1.2]]
    for order, value in ((1, 1.5991335783), (2, 1.6345506187)):
        found = cloud_wasserstein(X, U, Y, V, order=order, covariance=covariance)
        assert found == pytest.approx(value, rel=1e-10)


def test_the_order_can_change_which_cloud_is_nearer() -> None:
    """A claim of [Danu], section 3.2, that does not hold."""
    a, b, c = ([0], [1]), ([0, 10], [0.5, 0.5]), ([6], [1])
    assert cloud_wasserstein(*a, *b, order=1) == 5 < cloud_wasserstein(*a, *c, order=1) == 6
    near, far = cloud_wasserstein(*a, *c), cloud_wasserstein(*a, *b)
    assert near == 6 < far == pytest.approx(np.sqrt(50))


def test_plan_and_cross_covariance_of_the_worked_example() -> None:
    np.testing.assert_allclose(
        transport_plan(X, U, Y, V), [[0.3, 0.2], [0.3, 0], [0, 0.2]], atol=1e-15
    )
    joint = cross_covariance(X, U, Y, V)
    np.testing.assert_allclose(joint, [[0.24, -0.48], [-0.36, 0.72]], atol=1e-14)
    np.testing.assert_allclose(
        north_west(np.full(3, 1 / 3), np.full(2, 0.5)),
        [[1 / 3, 0], [1 / 6, 1 / 6], [0, 1 / 3]],
        atol=1e-15,
    )


@given(clouds(2), clouds(2), st.sampled_from([1, 2]))
def test_distance_is_the_optimum_of_the_linear_programme(a: Cloud, b: Cloud, order: int) -> None:
    assert cloud_wasserstein(*a, *b, order=order) == pytest.approx(
        cloud_distance(a, b, order), abs=1e-6
    )


@given(clouds(1), clouds(1), st.sampled_from([1, 2]))
def test_distance_on_a_line_is_that_in_the_plane(a: Cloud, b: Cloud, order: int) -> None:
    flat = [(np.column_stack((points, 0 * points)), weights) for points, weights in (a, b)]
    assert cloud_wasserstein(*a, *b, order=order) == pytest.approx(
        cloud_wasserstein(*flat[0], *flat[1], order=order), abs=1e-7
    )


@pytest.mark.parametrize("order", [1, 2])
@given(a=clouds(2), b=clouds(2), c=clouds(2))
def test_distance_is_a_metric(a: Cloud, b: Cloud, c: Cloud, order: int) -> None:
    ab, bc, ac, ba = (
        cloud_wasserstein(*first, *second, order=order)
        for first, second in ((a, b), (b, c), (a, c), (b, a))
    )
    assert ab == pytest.approx(ba, abs=1e-7)
    assert ac <= ab + bc + 1e-7
    back = a[0][::-1], a[1][::-1]
    assert cloud_wasserstein(*a, *back, order=order) <= 1e-7


@given(clouds(3), clouds(3))
def test_bounds_and_the_identity_of_the_cross_covariance(a: Cloud, b: Cloud) -> None:
    first, second = (cloud_wasserstein(*a, *b, order=order) for order in (1, 2))
    means = [weights @ points for points, weights in (a, b)]
    apart = np.linalg.norm(means[0] - means[1])
    assert apart <= first + 1e-9
    assert first <= second + 1e-9
    covariances = [
        (points - mean).T @ ((points - mean) * weights[:, None])
        for (points, weights), mean in zip((a, b), means, strict=True)
    ]
    joint = cross_covariance(*a, *b)
    spread = np.trace(covariances[0] + covariances[1] - joint - joint.T)
    assert second**2 == pytest.approx(apart**2 + spread, abs=1e-9)


@given(clouds(2), clouds(2))
def test_plans_have_the_weights_as_sums(a: Cloud, b: Cloud) -> None:
    plan = transport_plan(*a, *b)
    assert plan.shape == (len(a[1]), len(b[1]))
    assert (plan >= 0).all()
    np.testing.assert_allclose(plan.sum(axis=1), a[1], atol=1e-12)
    np.testing.assert_allclose(plan.sum(axis=0), b[1], atol=1e-12)


@pytest.mark.parametrize("far", [0.0, 5e6])
def test_translates_and_large_coordinates(far: float) -> None:
    rng = np.random.default_rng(1)
    points, weights = rng.standard_normal((60, 2)) * 3, rng.random(60)
    weights /= weights.sum()
    moved = points + np.array([3.0, 4.0])
    assert cloud_wasserstein(points + far, weights, moved + far, weights) == pytest.approx(
        5, abs=1e-7
    )
    assert cloud_wasserstein(points + far, weights, (points + far)[::-1], weights[::-1]) <= 1e-9
    other = rng.standard_normal((40, 2)), np.full(40, 1 / 40)
    near = cloud_wasserstein(points, weights, *other)
    assert cloud_wasserstein(points + far, weights, other[0] + far, other[1]) == pytest.approx(
        near, abs=1e-7
    )


def test_equally_many_of_equal_weight_need_no_transport(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((2, 30, 2))
    with_pot = cloud_wasserstein(np.concatenate((a, a)), None, b, None)  # merged: still equal
    monkeypatch.setitem(sys.modules, "ot", None)
    assert cloud_wasserstein(a, None, b, None) == pytest.approx(with_pot, rel=1e-12)
    assert cloud_wasserstein(a[:1], None, b, None) > 0
    with pytest.raises(
        ConfigError, match=r'extra clouds: .* -m pip install "tgospa-eval\[clouds\]"'
    ):
        cloud_wasserstein(a[:20], None, b, None)


def test_weights_are_normalised_with_a_warning() -> None:
    with pytest.warns(UserWarning, match="first cloud: the weights sum to 7, not 1: normalised"):
        assert cloud_wasserstein(X, 7 * U, Y, V, order=1) == pytest.approx(1.2)
    assert cloud_wasserstein(X, U * (1 + 9e-4), Y, V, order=1) == pytest.approx(1.2)


def test_warnings_are_for_the_line_that_calls() -> None:
    for call in (
        lambda: cloud_wasserstein(X, 7 * U, Y, V),
        lambda: transport_plan(X, 7 * U, Y, V),
        lambda: cross_covariance(X, 7 * U, Y, V),
        lambda: reduce_cloud(X, 7 * U, 2),
        lambda: restrict_cloud(X, 7 * U, 2),
        lambda: resample_cloud(X, 7 * U, 2),
    ):
        with pytest.warns(UserWarning, match="the weights sum to 7") as found:
            call()
        assert found[0].filename == __file__


@pytest.mark.parametrize("size", [1, 2, 3])
def test_the_same_cloud_written_otherwise(size: int) -> None:
    """Another order, other sums, particles in parts: rounding of weights is no distance."""
    rng = np.random.default_rng(11)
    for count in (3, 20, 100):
        points, weights = rng.normal(0, 30, (count, size)), rng.random(count)
        weights /= weights.sum()
        turned = rng.permutation(count)
        for other in (
            (points[turned], weights[turned]),
            (points, weights / 3 / (weights / 3).sum()),
            (np.repeat(points, 3, axis=0), np.repeat(weights / 3, 3)),
        ):
            for options in ({}, {"order": 1}, {"covariance": 2 + np.eye(size)}):
                assert cloud_wasserstein(points, weights, *other, **options) <= 1e-9


@pytest.mark.parametrize(
    ("points", "weights", "message"),
    [
        (X, [0.5, -0.1, 0.6], r"first cloud: a weight is negative \(-0.1\)"),
        (X, [0.5, np.nan, 0.5], "first cloud: a weight is NaN or blank"),
        (X, [0.5, np.inf, 0.5], r"a weight is infinite \(inf\)"),
        (X, [0, 0, 0], "all weights are zero; weights must be finite, >= 0 and not all zero"),
        (X, [0.5, 0.5], r"weights have the shape \(2,\): must be \(3,\), one per point"),
        ([(0, 0), (np.nan, 1)], [0.5, 0.5], "particle 1 is not finite; leave it out"),
        (np.zeros((0, 2)), [], r"points have the shape \(0, 2\): must be \(N, d\), not empty"),
        ([1, 1], [1], r"must be \(2,\), one per point; a single point is \[\[x, y\]\]"),
        (np.zeros((1, 3)), [1], "first cloud has 3 components, the second has 2"),
        ("abc", [1], "points and weights must be arrays of numbers"),
    ],
)
def test_wrong_clouds(points: object, weights: object, message: str) -> None:
    for function in (cloud_wasserstein, transport_plan, cross_covariance):
        with pytest.raises(ConfigError, match=message):
            function(points, weights, Y, V)


def test_wrong_orders_and_covariances() -> None:
    for order in (0, 3, 1.5, "2", True):
        with pytest.raises(ConfigError, match=r"cloud-order is .*: must be 1 or 2"):
            cloud_wasserstein(X, U, Y, V, order=order)
    with pytest.raises(ConfigError, match="not positive definite"):
        cloud_wasserstein(X, U, Y, V, covariance=[[1, 1], [1, 1]])
    with pytest.raises(ConfigError, match="covariance is 1 x 1: must be 2 x 2"):
        cloud_wasserstein(X, U, Y, V, covariance=[[1]])


def test_clouds_that_are_too_large() -> None:
    many = np.random.default_rng(0).random((4001, 2))
    for function in (cloud_wasserstein, transport_plan):
        with pytest.raises(
            ConfigError, match=r"clouds of 4001 and 4001 particles: more than 4000 "
        ):
            function(many, None, -many, None)
    assert cloud_wasserstein(many, None, Y, V) > 0
    assert cloud_wasserstein(many[:, :1], None, -many[:, :1], None) > 0
    assert len(reduce_cloud(many, None, 3, method="atl", iterations=1)[0]) == 3
    assert cloud_wasserstein(many, None, [(0, 0)], [1]) > 0


# --- resampling -----------------------------------------------------------------------------------


def test_systematic_example() -> None:
    points, weights = resample_cloud([0, 1, 2, 3], [0.1, 0.2, 0.3, 0.4], 4, offset=0.5)
    assert points[:, 0].tolist() == [1, 2, 3, 3]
    assert weights.tolist() == [0.25] * 4


def test_a_particle_is_taken_where_the_sum_exceeds_u() -> None:
    """At u = 0.5 exactly it is the second of two halves; the first where its weight is zero."""
    assert resample_cloud([1, 2], [0.5, 0.5], 1, offset=0.5)[0].item() == 2
    assert resample_cloud([1, 2, 3], [0, 0.5, 0.5], 1, offset=0.0)[0].item() == 2
    weights = np.full(10, 0.1)  # whose sum is less than 1
    for u in (1 - 2**-53, 1):
        last = resample_cloud(np.arange(10), weights, 1, method="multinomial", offset=u)
        assert last[0].item() == 9


@pytest.mark.parametrize("method", ["systematic", "stratified", "multinomial"])
def test_resampling_is_seeded_and_unbiased(method: str) -> None:
    draws = [
        resample_cloud(X, U, 50, method=method, rng=np.random.default_rng(3))[0] for _ in range(2)
    ]
    assert np.array_equal(*draws)
    by_seed = resample_cloud(X, U, 50, method=method, rng=3)[0]
    assert np.array_equal(by_seed, draws[0])
    rng = np.random.default_rng(4)
    means = [resample_cloud(X, U, 20, method=method, rng=rng)[0].mean(axis=0) for _ in range(400)]
    np.testing.assert_allclose(np.mean(means, axis=0), U @ X, atol=0.06)


def test_highest_weights() -> None:
    points, weights = restrict_cloud([1, 2, 3, 4], [0.2, 0.3, 0.3, 0.2], 3)
    assert points[:, 0].tolist() == [2, 3, 1]
    np.testing.assert_allclose(weights, [0.375, 0.375, 0.25])
    assert restrict_cloud([1, 2], [0.4, 0.6], 5)[0][:, 0].tolist() == [1, 2]


def test_wrong_resampling() -> None:
    with pytest.raises(ConfigError, match=r"rng is 'x': must be a numpy.random.Generator or a se"):
        resample_cloud(X, U, 2, rng="x")
    with pytest.raises(ConfigError, match='method is "best": must be one of systematic, strat'):
        resample_cloud(X, U, 2, method="best")
    for size in (0, 1.5, True):
        with pytest.raises(ConfigError, match="must be a whole number, 1 or more"):
            resample_cloud(X, U, size)
        with pytest.raises(ConfigError, match="must be a whole number, 1 or more"):
            restrict_cloud(X, U, size)
    for offset in (1.1, -0.1, np.nan, [0.1, 0.2]):
        with pytest.raises(ConfigError, match=r"offset must be .* in \[0, 1\]|offset is nan"):
            resample_cloud(X, U, 3, offset=offset)


# --- reduction ------------------------------------------------------------------------------------


def test_slot_means_of_the_worked_example() -> None:
    found = slot_means(np.array([3.0, 0, 7, 1]), np.array([0.3, 0.4, 0.2, 0.1]), 2)
    np.testing.assert_allclose(found, [0.2, 4.6], rtol=1e-14)
    points, weights = reduce_cloud([0, 1, 3, 7], [0.4, 0.1, 0.3, 0.2], 2, iterations=1)
    np.testing.assert_allclose(points[:, 0], [0.2, 4.6], rtol=1e-14)
    assert weights.tolist() == [0.5, 0.5]


def test_one_step_of_the_worked_examples() -> None:
    corners, start = [(0, 0), (4, 0), (0, 2), (4, 2)], [(1, 0), (3, 1)]
    once = {"start": start, "iterations": 1}
    points, weights = reduce_cloud(corners, None, 2, directions=np.eye(2), **once)
    np.testing.assert_allclose(points, [(0, 0), (4, 2)], atol=1e-14)
    assert cloud_wasserstein(points, weights, corners, None) == pytest.approx(np.sqrt(2))
    v = [(1, 0), (0.6, 0.8), (0, 1)]
    points, _ = reduce_cloud(corners, None, 2, directions=v, **once)
    np.testing.assert_allclose(points, [(0.24, 0.32), (3.76, 1.68)], atol=1e-14)
    points, _ = reduce_cloud(corners, None, 2, directions=v, method="recursive", **once)
    expected = [(0.24693364858874, 0.31604354465297), (3.75543077, 1.67720802)]
    np.testing.assert_allclose(points, expected, atol=1e-8)


@given(clouds(2, most=12), st.integers(1, 4), st.sampled_from(METHODS[:4]))
def test_reduction_keeps_the_mean(cloud: Cloud, size: int, method: str) -> None:
    points, weights = reduce_cloud(*cloud, size, method=method)
    assert weights.sum() == pytest.approx(1)
    if method == "recursive" and size < len(cloud[0]):  # pulls to the start, less in every sweep
        assert np.abs(weights @ points - cloud[1] @ cloud[0]).max() < 1e-6
    else:
        np.testing.assert_allclose(weights @ points, cloud[1] @ cloud[0], atol=1e-12)


def test_steps_never_increase_the_sliced_distance() -> None:
    rng = np.random.default_rng(5)
    cloud = rng.standard_normal((300, 2)), np.full(300, 1 / 300)
    angle = np.pi * (np.arange(32) + 0.5) / 32
    v = np.column_stack((np.cos(angle), np.sin(angle)))
    values = [
        sliced_wasserstein(Reduction(size=10, iterations=k)(cloud), cloud, v) for k in range(1, 20)
    ]
    assert (np.diff(values) <= 1e-12).all()


def test_one_step_is_the_explicit_least_squares() -> None:
    rng = np.random.default_rng(6)
    points, start = rng.standard_normal((40, 3)), rng.standard_normal((5, 3))
    v = rng.standard_normal((7, 3))
    rows, right = [], []
    for each in v:
        slots = slot_means(points @ each, np.full(40, 1 / 40), 5)
        for i, rank in enumerate(np.argsort(np.argsort(start @ each))):
            row = np.zeros((5, 3))
            row[i] = each
            rows.append(row.ravel())
            right.append(slots[rank])
    explicit = np.linalg.lstsq(np.array(rows), np.array(right))[0].reshape(5, 3)
    found, _ = reduce_cloud(points, None, 5, directions=v, start=start, iterations=1)
    np.testing.assert_allclose(found, explicit, atol=1e-12)


def test_methods_compare_as_they_should() -> None:
    """Transport and location in turn comes nearest, then the sliced method; chance last."""
    rng = np.random.default_rng(7)
    cloud = rng.standard_normal((400, 2)), np.full(400, 1 / 400)
    value = {
        method: cloud_wasserstein(*reduce_cloud(*cloud, 10, method=method), *cloud)
        for method in METHODS
    }
    assert value["atl"] < value["sliced"] < min(value["multinomial"], value["top"])
    assert value["recursive"] == pytest.approx(value["sliced"], rel=0.02)
    polished = cloud_wasserstein(*reduce_cloud(*cloud, 10, polish=1), *cloud)
    assert value["atl"] < polished < value["sliced"]
    restarted = cloud_wasserstein(*reduce_cloud(*cloud, 10, restarts=8), *cloud)
    assert restarted <= value["sliced"]


@pytest.mark.parametrize("method", METHODS)
def test_small_clouds_are_returned_and_seeds_count(method: str) -> None:
    points, weights = reduce_cloud(X, U, 3, method=method)
    assert np.array_equal(points, X)
    assert np.array_equal(weights, U)
    rng = np.random.default_rng(8)
    cloud = rng.standard_normal((50, 3)), None
    once, again = (reduce_cloud(*cloud, 5, method=method, seed=9)[0] for _ in range(2))
    assert np.array_equal(once, again)


@pytest.mark.parametrize("method", METHODS)
def test_equal_clouds_are_reduced_alike(method: str) -> None:
    rng = np.random.default_rng(12)
    points, weights = rng.standard_normal((60, 2)), rng.dirichlet(np.ones(60))
    turned = rng.permutation(60)
    once = reduce_cloud(points, weights, 7, method=method)
    again = reduce_cloud(points[turned], weights[turned], 7, method=method)
    for one, other in zip(once, again, strict=True):
        np.testing.assert_array_equal(one, other)


def test_few_distinct_particles_are_all_kept() -> None:
    """A resampled cloud of 3 places: nothing is lost with 4."""
    places = np.array([(0, 0), (4, 0), (0, 4)], float)
    points, weights = reduce_cloud(places[[0, 1, 1, 2, 2, 2]], None, 4)
    assert points.tolist() == [[0, 0], [0, 4], [4, 0]]
    np.testing.assert_allclose(weights, [1 / 6, 1 / 2, 1 / 3], rtol=1e-14)


def test_large_coordinates_keep_their_digits() -> None:
    rng = np.random.default_rng(10)
    points = rng.standard_normal((100, 2))
    near, far = (reduce_cloud(points + shift, None, 5)[0] - shift for shift in (0, 5e6))
    np.testing.assert_allclose(near, far, atol=1e-7)


@pytest.mark.parametrize(
    ("given_settings", "message"),
    [
        ({"method": "best"}, 'reduce-method is "best": must be one of sliced, recursive, atl'),
        ({"iterations": 0}, "iterations is 0: must be a whole number, 1 or more"),
        ({"restarts": 0}, "restarts is 0: must be a whole number, 1 or more"),
        ({"polish": -1}, "polish is -1: must be a whole number, 0 or more"),
        ({"seed": 0.5}, "seed is 0.5: must be a whole number, 0 or more"),
        ({"directions": 1}, "1 directions do not span 2 dimensions; give at least 2"),
        ({"directions": [(1, 0), (2, 0)]}, "2 directions do not span 2 dimensions"),
        ({"directions": [1, 2, 3]}, r"directions have the shape \(3,\): must be \(V, 2\), finite"),
        ({"start": [(0, 0)]}, r"start has the shape \(1, 2\): must be \(2, 2\), finite"),
    ],
)
def test_wrong_reductions(given_settings: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        reduce_cloud(X, U, 2, **given_settings)


@pytest.mark.parametrize("method", ["sliced", "recursive", "atl", "kmeans"])
def test_the_history_of_a_reduction(method: str) -> None:
    """The distance to the cloud before each iteration, from positions after fewer iterations."""
    rng = np.random.default_rng(5)
    points = rng.normal(size=(80, 2)) + rng.choice([-3, 3], (80, 1))
    weights = rng.dirichlet(np.ones(80))
    made = {"method": method, **({"directions": 6} if method in ("sliced", "recursive") else {})}
    angles = np.pi * (np.arange(6) + 0.5) / 6

    def apart(x: np.ndarray, mass: np.ndarray) -> float:
        if method == "kmeans":
            nearest = ((points[:, None] - x) ** 2).sum(axis=2).min(axis=1)
            return float(np.sqrt(weights @ nearest))
        if method == "atl":
            return cloud_wasserstein(x, mass, points, weights)
        lines = np.column_stack((np.cos(angles), np.sin(angles)))
        each = [cloud_wasserstein(x @ v, mass, points @ v, weights) ** 2 for v in lines]
        return float(np.sqrt(np.mean(each)))

    after = [Reduction(size=7, iterations=k, **made)((points, weights)) for k in range(1, 7)]
    (x, _), history = Reduction(size=7, iterations=6, **made).trace((points, weights))
    assert np.array_equal(x, after[-1][0])
    costs = [apart(*each) for each in after[: len(history) - 1]]
    assert history[1:] == pytest.approx(costs, rel=1e-9)
    assert len(history) == 6 or np.array_equal(after[len(history) - 2][0], x)  # they stay
    if method != "recursive":  # no iteration makes these larger
        assert (np.diff(history) <= 1e-12).all()
    assert history[-1] < 0.9 * history[0]
    assert Reduction(size=7, method="top").trace((points, weights))[1] == []
