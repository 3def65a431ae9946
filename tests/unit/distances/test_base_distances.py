"""Every base distance: values, axioms of a metric, near pairs against all pairs, the options."""

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from all_pairs import WAYS, assert_as_by_brute_force, go, table
from answer import Invoke, Write
from hypothesis import given
from hypothesis import strategies as st

from tgospa_eval import ConfigError, InputError, evaluate
from tgospa_eval.distances import (
    DISTANCES,
    Distance,
    Geodesic,
    Haversine,
    IoU,
    Mahalanobis,
    Norm,
    SlicedWasserstein,
    near_pairs,
)
from tgospa_eval.distances import pair_search as search

EARTH = 6371008.8
COVARIANCE = [[4.0, 1.9, 0.0], [1.9, 1.0, 0.1], [0.0, 0.1, 9.0]]


def circular(name: str) -> Norm:
    """Three components, the second on a circle of circumference 360, the third of 1."""
    power = {"euclidean": 2.0, "manhattan": 1.0, "chebyshev": math.inf}[name]
    return Norm(name=name, power=power, scale=(1.0, 0.05, 7.0), period=(math.inf, 360.0, 1.0))


METRICS: dict[str, Distance] = {
    "scaled": Norm(name="euclidean", power=2.0, scale=(0.3, 1e-3, 1e4)),
    **{f"circular {name}": circular(name) for name in ("euclidean", "manhattan", "chebyshev")},
    "mahalanobis": Mahalanobis(covariance=COVARIANCE),
    "mahalanobis, scaled": Mahalanobis(covariance=COVARIANCE, scale=(2.0, 0.5, 1.0)),
    "haversine": Haversine(),
    "geodesic": Geodesic(),
    "geodesic, heights": Geodesic(vertical_weight=2.5),
    "iou": IoU(),
    "sliced, order 1": SlicedWasserstein(order=1, directions=9),
    "max-sliced": SlicedWasserstein(maximum=True, scale=(2.0, 0.5, 1.0)),
}


# --- values ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ((0, 0), (0, 90), math.pi / 2 * EARTH),
        ((90, 17), (-90, 3), math.pi * EARTH),  # poles
        ((90, 17), (90, 120), 0),  # one point
        ((5, 180), (5, -180), 0),
        ((12, 359), (12, -1), 0),
        ((0, 179.5), (0, -179.5), math.radians(1) * EARTH),  # across the date line
        ((10, 20), (-10, -160), math.pi * EARTH),  # antipodes
        ((10, 20), (-10, -160 + 2e-6), math.pi * EARTH - math.radians(2e-6) * EARTH * 0.984807753),
        ((45, 7), (45 + 2.0**-40, 7), math.radians(2.0**-40) * EARTH),
        ((45, 7), (45, 7 + 2.0**-40), math.radians(2.0**-40) * math.sqrt(0.5) * EARTH),
        ((0, 0), (0, 1e-200), math.radians(1e-200) * EARTH),
        # Paris to London, by the spherical law of cosines.
        ((48.8566, 2.3522), (51.5074, -0.1278), 343556.534881),
    ],
)
def test_haversine(a: tuple[float, float], b: tuple[float, float], expected: float) -> None:
    for first, second in ((a, b), (b, a)):
        found = float(Haversine()(first, second))
        assert found == pytest.approx(expected, rel=1e-10, abs=0)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ((0, 0, 2, 1), (1, 0, 2, 1), 2 / 3),  # shared 1 of 3
        ((0, 0, 2, 2), (0, 0, 1, 1), 3 / 4),
        ((0, 0, 2, 2), (2, 0, 2, 2), 1),  # side by side: no pixel is added
        ((0, 0, 2, 2), (9, 9, 2, 2), 1),
        ((0, 0, 10, 20), (0, 5, 10, 20), 1 - 15 / 25),
        ((0.1, 0.2, 0.3, 0.7), (0.1, 0.2, 0.3, 0.7), 0),
        ((1e308, 0, 1, 1), (-1e308, 0, 1, 1), 1),
        ((0, 0, 1e150, 1e150), (0, 0, 1e150, 5e149), 0.5),
        ((0, 0, 1e-99, 1e-99), (0, 0, 1e-99, 5e-100), 0.5),
    ],
)
def test_iou(a: tuple[float, ...], b: tuple[float, ...], expected: float) -> None:
    assert float(IoU()(a, b)) == float(IoU()(b, a)) == pytest.approx(expected, rel=1e-15)


def test_mahalanobis() -> None:
    a, b = np.random.default_rng(1).normal(size=(2, 7, 3))
    scale = np.array([2.0, 0.5, 1.0])
    v = (a - b) * scale  # scaled first: the covariance is in state units
    expected = np.sqrt(np.einsum("ri,ij,rj->r", v, np.linalg.inv(COVARIANCE), v))
    assert np.allclose(METRICS["mahalanobis, scaled"](a, b), expected, rtol=1e-12)


@pytest.mark.parametrize("name", ["euclidean", "manhattan", "chebyshev"])
def test_circles_and_scales(name: str) -> None:
    # 350 and 5 degrees are 15 apart, 3.25 and 17.5 turns a quarter of one: times 0.05 and 7.
    found = circular(name)((4.0, 350.0, 3.25), (3.0, 5.0 - 720, 17.5))
    parts = np.array([1.0, 0.75, 1.75])
    expected = {"euclidean": math.hypot(*parts), "manhattan": 3.5, "chebyshev": 1.75}[name]
    assert float(found) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ((0, 0), (0, 1), math.pi * 6378137 / 180),  # along the equator
        ((0, 0), (90, 17), 10001965.729312724),  # a quarter of a meridian, 10,001,965.7293 m
        ((5, 180), (5, -180), 0),
        ((90, 17), (90, 120), 0),
        # Flinders Peak to Buninyong, on GRS 80, which differs from WGS 84 by 0.1 mm in the axis.
        ((-37.951033416, 144.424867889), (-37.652821139, 143.926495528), 54972.271),
        ((0, 0, 100), (0, 0, 140), 100),
        ((0, 0, 0), (0, 1, 40), math.hypot(math.pi * 6378137 / 180, 100)),
    ],
)
def test_geodesic(a: tuple[float, ...], b: tuple[float, ...], expected: float) -> None:
    """Heights count two and a half times."""
    found = float(Geodesic(vertical_weight=2.5)(a, b))
    assert found == pytest.approx(expected, abs=1e-3 if expected == 54972.271 else 1e-6)


def test_slopes_of_geodesics_are_differences() -> None:
    rng = np.random.default_rng(3)
    a = np.array([rng.uniform(-80, 80, 50), rng.uniform(-180, 180, 50), rng.uniform(0, 9e3, 50)])
    b = a + np.array([[0.1], [0.1], [500.0]]) * rng.normal(size=(3, 50))
    for size in (2, 3):
        distance = Geodesic(vertical_weight=2.0)
        found = distance.slopes_between(a[:size], b[:size])
        for axis, step in enumerate((1e-5, 1e-5, 1.0)[:size]):
            shift = step * np.eye(size)[axis][:, None]
            ends = (distance(a[:size].T, (b[:size] + s * shift).T) for s in (-1, 1))
            low, high = ends
            assert found[axis] == pytest.approx((high - low) / (2 * step), rel=1e-3, abs=1e-2)
        assert not distance.slopes_between(a[:size], a[:size]).any()


# --- axioms ---------------------------------------------------------------------------------------


def states(name: str, rng: np.random.Generator, count: int, spread: float) -> np.ndarray:
    """States for a distance, some of them equal and some at the seams."""
    if name == "geodesic, heights":
        heights = np.round(rng.normal(0, 1e3 * spread, (count, 1)), 1)
        return np.concatenate((states("geodesic", rng, count, spread), heights), axis=1)
    if name in ("haversine", "geodesic"):
        found = rng.normal(0, spread, (count, 2)) * [1, 4] + rng.choice([-90, 0, 90, 45], (1, 2))
        found[:, 0] = np.clip(found[:, 0], -90, 90)
        return np.clip(found + rng.choice([0, 180, -180], (count, 1)) * [0, 1], -360, 360)
    if name == "iou":
        place = np.round(rng.uniform(0, spread, (count, 2)))
        return np.concatenate((place, np.round(rng.uniform(1, 9, (count, 2)))), axis=1)
    return np.round(rng.normal(0, spread, (count, 3)), rng.integers(0, 5))


@pytest.mark.parametrize("name", METRICS)
@given(seed=st.integers(0, 2**32 - 1), spread=st.sampled_from([1e-6, 0.1, 3.0, 60.0, 1e4]))
def test_it_is_a_metric(name: str, seed: int, spread: float) -> None:
    distance = METRICS[name]
    rng = np.random.default_rng(seed)
    x = states(name, rng, 8, spread)
    d = distance(x[:, None], x[None])
    assert np.all(np.diag(d) == 0)
    assert np.array_equal(d, d.T)
    assert np.all(d >= 0)
    # Rounding of the distances, and of coordinates that are large beside them.
    allowed = 1e-12 * d[:, None] + 1e-13 * (1 + np.abs(x).max()) * (name != "iou") + 1e-15
    allowed += 1e-7 * name.startswith("geodesic")  # metres
    assert np.all(d[:, None] <= d[:, :, None] + d.T[None] + allowed)


# --- near pairs -----------------------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", METRICS)
def test_near_pairs(name: str, way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    go(way, monkeypatch)
    distance = METRICS[name]
    rng = np.random.default_rng([list(METRICS).index(name), len(way)])
    for spread in (1e-6, 3.0, 60.0, 1e4):
        step = np.sort(rng.integers(0, 4, (2, 30)), axis=1)
        truth, estimate = (table(own, states(name, rng, 30, spread), 4) for own in step)
        every = np.sort(distance(truth.state[:, None], estimate.state[None]), axis=None)
        positive = every[every > 0]
        # Cutoffs at which a pair is exactly, and just within.
        edges = positive[[0, len(positive) // 20, -1]] if len(positive) else []
        cutoffs = {*edges, *np.nextafter(edges, np.inf), 0.5, 1.0}
        assert_as_by_brute_force(truth, estimate, sorted(cutoffs), distance)


@pytest.mark.parametrize("kind", ["far", "outlier", "overflow", "tiny"])
def test_near_pairs_of_odd_sizes(kind: str) -> None:
    rng = np.random.default_rng(5)
    x = rng.uniform(0, 30, (2, 90, 3))
    cutoff = 3.0
    if kind == "far":
        x = x * 1e-3 + 1e8
        cutoff = 1e-3
    if kind == "outlier":
        x[:, ::7] = 1e300
    if kind == "overflow":
        x[:, ::3] = rng.choice([-1.7e308, 1.7e308], x[:, ::3].shape)
    if kind == "tiny":
        x, cutoff = x * 1e-140, 3e-140
    truth, estimate = (table(np.repeat(np.arange(3), 30), side, 3) for side in x)
    for name in METRICS:
        huge = kind in ("outlier", "overflow") and "sliced" in name  # of particles an error
        if name != "iou" and not huge and not isinstance(METRICS[name], Geodesic | Haversine):
            assert_as_by_brute_force(truth, estimate, cutoff, METRICS[name])


def boxes(rng: np.random.Generator, count: int, spread: float) -> np.ndarray:
    """Boxes on a coarse grid: equal, touching and nested ones, of sizes up to `spread`."""
    size = np.ceil(spread ** rng.uniform(0, 1, (count, 2)) * rng.choice([1, 8], (count, 1)))
    size[rng.random(count) < 0.5] = rng.choice([1.0, 4.0])
    place = np.round(rng.uniform(0, 12, (count, 2)))
    place[rng.random(count) < 0.2] *= np.round(spread)
    return np.concatenate((place, size), axis=1)


CUTOFFS = st.sampled_from([1e-9, 0.1, 0.5, 0.75, 0.9, 0.999, 1 - 1e-12, 1.0, 1.5])


@pytest.mark.parametrize("way", WAYS)
@given(
    seed=st.integers(0, 2**32 - 1),
    spread=st.sampled_from([1.0, 3.0, 300.0, 1e7, 1e60]),
    unit=st.sampled_from([1.0, 0.1, 1e-40, 1e80]),
    cutoff=CUTOFFS,
    edge=st.sampled_from([None, 0.0, 1.0]),
)
def test_near_boxes_of_all_sizes(
    way: str, seed: int, spread: float, unit: float, cutoff: float, edge: float | None
) -> None:
    rng = np.random.default_rng(seed)
    truth, estimate = (
        table(rng.integers(0, 2, 25), unit * boxes(rng, 25, spread), 2) for _ in range(2)
    )
    if edge is not None:  # exactly the distance of a pair, or just above
        every = IoU()(truth.state[:, None], estimate.state[None])
        cutoff = float(np.nextafter(max(rng.choice(every.ravel()), 1e-9), edge * 9))
    with pytest.MonkeyPatch.context() as patch:
        go(way, patch)
        assert_as_by_brute_force(truth, estimate, cutoff, IoU())


@pytest.mark.parametrize("way", WAYS)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.integers(1, 4),
    apart=st.sampled_from([0.5, 1e-2, 1e-5, 1.1e-6]),
    place=st.sampled_from([0.0, 1e3, 1e9, 1e15, 1e290]),
    cutoff=st.sampled_from([1e-6, 0.5, 3.0, 1e4]),
    scaled=st.booleans(),
)
def test_near_points_of_correlated_columns(
    way: str, seed: int, size: int, apart: float, place: float, cutoff: float, scaled: bool
) -> None:
    rng = np.random.default_rng(seed)
    factor = np.tril(rng.normal(size=(size, size)))  # a correlation matrix with small pivots
    factor[np.diag_indices(size)] = rng.choice([1.0, apart], size)
    factor /= np.sqrt(np.square(factor).sum(axis=1))[:, None]
    deviation = 10.0 ** rng.uniform(-3, 3, size)
    scale = tuple(10.0 ** rng.uniform(-2, 2, size)) if scaled else None
    factor = deviation[:, None] * factor
    try:
        distance = Mahalanobis(covariance=factor @ factor.T, scale=scale)
    except ConfigError:  # by rounding
        return
    x = place + rng.normal(0, 3 * cutoff, (25, 1)) * deviation
    # Half of them at the cutoff, but for rounding.
    turn = rng.normal(size=(25, size))
    turn *= cutoff / np.sqrt(np.square(turn).sum(axis=1))[:, None]
    turn[::2] *= rng.uniform(0, 2, (13, 1))
    y = (x + turn @ factor.T) / np.asarray(scale or 1.0)
    x = x / np.asarray(scale or 1.0)
    x[rng.random(25) < 0.1] *= -1e8
    y[rng.random(25) < 0.1] = 1.7e308
    truth, estimate = (table(np.zeros(25, int), side, 1) for side in (x, y))
    with pytest.MonkeyPatch.context() as patch:
        go(way, patch)
        assert_as_by_brute_force(truth, estimate, cutoff, distance)


@pytest.fixture
def compared(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many candidates were compared, each time that some were."""
    found: list[int] = []
    plain = search._compared

    def counted(truth: Any, estimate: Any, candidates: Any, reach: Any) -> Any:
        found.append(int(candidates[2].sum()))
        return plain(truth, estimate, candidates, reach)

    monkeypatch.setattr(search, "_compared", counted)
    return found


@pytest.mark.parametrize("name", ["mahalanobis", "haversine", "geodesic", "iou", "circle"])
def test_candidates_do_not_grow_with_all_pairs(name: str, compared: list[int]) -> None:
    """Four times the objects at the same density: about four times the candidates."""
    circle = Norm(name="euclidean", power=2.0, period=(math.inf, 100.0, math.inf))
    totals = []
    for count in (1000, 4000):
        rng = np.random.default_rng(count)
        side = math.sqrt(count)
        place = rng.uniform(0, side, (2, count, 2))
        if name in ("haversine", "geodesic"):
            x, cutoff = place * 1e-3 + [50, 179.98], 300.0  # spacing of some 100 m, date line
        elif name == "iou":
            x, cutoff = np.concatenate((place, rng.uniform(0.5, 2, place.shape)), axis=2), 0.5
        else:
            extra = rng.uniform(0, 1, (2, count, 1))
            x, cutoff = np.concatenate((place, extra), axis=2), 1.0
        truth, estimate = (table(np.zeros(count, int), part, 1) for part in x)
        near_pairs(truth, estimate, cutoff, METRICS.get(name, circle))
        totals.append(compared[-1])
    assert totals[1] < 6 * totals[0]
    assert totals[1] < 0.05 * 4000**2


ALIKE = Mahalanobis(covariance=[[1.0, 1 - 1e-8], [1 - 1e-8, 1.0]])


@pytest.mark.parametrize(
    "kind", ["a giant", "giants of all shapes", "all sizes", "correlation", "far away", "outliers"]
)
def test_candidates_of_unequal_states(
    kind: str, compared: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is hard: a few large boxes among small ones, columns that are nearly the same."""
    monkeypatch.setattr(search, "_tree", None)  # sorting alone
    count = 8000
    rng = np.random.default_rng(1)
    side = math.sqrt(count) * 8
    if kind in ("correlation", "far away", "outliers"):
        distance: Distance = ALIKE
        cutoff = 3.0
        x = rng.uniform(0, 7, (count, 1)) + rng.normal(0, 0.1, (count, 2))
        y = x + rng.normal(0, 1, (count, 1)) + rng.normal(0, 1e-5, (count, 2))
        if kind == "far away":
            x, y = x + 1e9, y + 1e9
        if kind == "outliers":
            x[:3] = [[1e15, 1e15], [-1e15, 1e15], [1e308, -1e308]]
            y[2:5] = 1e300
    else:
        distance, cutoff = IoU(), 0.5
        x = rng.uniform(0, side, (count, 4))
        x[:, 2:] = 3.0
        if kind == "all sizes":
            x[:, 2:] *= 100 ** rng.random((count, 2)) ** 4
        y = x + rng.normal(0, 0.2, x.shape) * [1, 1, 0, 0]
        if kind == "a giant":
            y[0] = 0, 0, side, side
        if kind == "giants of all shapes":
            x[:3] = y[:3] = [[0, 0, side, 3], [0, 0, 3, side], [0, 0, side, side]]
    near = near_pairs(*(table(np.zeros(count, int), of, 1) for of in (x, y)), cutoff, distance)
    assert len(near.distance) > 0.5 * count
    assert sum(compared) < search.MANY_CANDIDATES * 2 * count  # of 4000 * 2 * count


# --- options and arguments ------------------------------------------------------------------------

HEADER = "id,t,x,y,theta,lat,lon,left,top,width,height\n"
TRUTH = HEADER + "a,1,0,0,0.1,5,180,0,0,2,1\n"
ESTIMATE = HEADER + "b,1,0.3,0.4,6.2,5,-180,1,0,2,1\n"


@pytest.fixture
def pair(write: Write) -> tuple[str, str]:
    write("c.csv", "0.25,0\n0,0.25\n")
    return write("t.csv", TRUTH), write("e.csv", ESTIMATE)


@pytest.mark.parametrize(
    ("arguments", "expected", "recorded"),
    [
        (["--distance", "haversine"], 0.0, {"columns": ["lat", "lon"]}),
        (["--distance", "geodesic"], 0.0, {"columns": ["lat", "lon"]}),
        (["--distance", "iou", "-c", "1"], 2 / 3, {"columns": ["left", "top", "width", "height"]}),
        (
            ["--distance", "mahalanobis", "--covariance", "c.csv"],
            1.0,
            {"covariance": [[0.25, 0.0], [0.0, 0.25]]},
        ),
        (
            ["--distance", "mahalanobis", "--covariance", "c.csv", "--scale", "x=2,y=2"],
            2.0,
            {"scale": {"x": 2.0, "y": 2.0}},
        ),
        (
            ["--columns", "theta", "--periodic", "theta"],
            0.1 + 2 * math.pi - 6.2,
            {"periodic": {"theta": 2 * math.pi}},
        ),
        (
            ["--columns", "theta", "--periodic", "theta=2", "--scale", "theta=10"],
            1.0,  # 6.1 = 3 * 2 + 0.1, ten times
            {"periodic": {"theta": 2.0}, "scale": {"theta": 10.0}},
        ),
        (
            ["--scale", "x=10", "--scale", "y=0", "--scale", "y=1"],
            None,
            {},
        ),
    ],
)
def test_options(
    invoke: Invoke,
    pair: tuple[str, str],
    arguments: list[str],
    expected: float | None,
    recorded: dict[str, Any],
) -> None:
    status, out, _ = invoke(*pair, *arguments, "--format", "json")
    if expected is None:
        assert status == 2
        return
    assert status == 0
    document = json.loads(out)
    assert document["tgospa"] == pytest.approx(expected, abs=1e-12)
    assert document["parameters"].items() >= recorded.items()


def test_defaults_of_boxes(invoke: Invoke, pair: tuple[str, str]) -> None:
    _, out, err = invoke(*pair, "--distance", "iou", "--format", "json")
    assert "default cutoff c = 0.5 and switch penalty gamma = 0.5;" in err
    assert "median distance to the nearest estimate is 0.667" in err
    parameters = json.loads(out)["parameters"]
    assert (parameters["cutoff"], parameters["switch_penalty"]) == (0.5, 0.5)
    _, out, err = invoke(*pair, "--distance", "iou", "-c", "2", "--format", "json")
    assert "every pair of a step is a possible match" in err
    assert "default switch penalty gamma = 0.5" in err
    assert json.loads(out)["parameters"]["cutoff"] == 2


def test_a_settings_file_names_circles(invoke: Invoke, write: Write, pair: tuple[str, str]) -> None:
    write("tgospa-eval.toml", 'columns = "x,theta"\nperiodic = "theta=2"\nscale = ["theta=3"]\n')
    _, out, _ = invoke(*pair, "--format", "json")
    parameters = json.loads(out)["parameters"]
    assert parameters["periodic"] == {"theta": 2.0}
    assert parameters["scale"] == {"x": 1.0, "theta": 3.0}


@pytest.mark.parametrize(
    ("arguments", "status", "parts"),
    [
        (["--distance", "mahalanobis"], 2, ["needs --covariance FILE"]),
        (["--covariance", "c.csv"], 2, ["--covariance", "mahalanobis", "euclidean"]),
        (["--distance", "iou", "--scale", "left=2"], 2, ["--scale", "not for iou"]),
        (["--distance", "haversine", "--periodic", "lon=360"], 2, ["--periodic", "haversine"]),
        (["--periodic", "theta"], 2, ["--periodic", '"theta"', "x,y", "--columns"]),
        (["--periodic", "x=-1"], 2, ["--periodic", '"x=-1"', "> 0"]),
        (["--periodic", "x=1e200"], 2, ["period", "1e+200"]),
        (["--scale", "x"], 2, ["--scale", '"x"', "name=number"]),
        (["--scale", "x=nan"], 2, ["--scale", '"x=nan"']),
        (["--scale", "x=1,x=2"], 2, ["--scale", '"x"', "twice"]),
        (["--distance", "iou", "--columns", "x,z"], 2, ['"z"', "left, top, width, height"]),
        (["--distance", "haversine", "--columns", "lon,lat"], 3, ["t.csv", "lat,lon"]),
        (["--distance", "geodesic", "--columns", "lon,lat"], 3, ["t.csv", "lat,lon,alt"]),
        (["--distance", "haversine", "--vertical-weight", "2"], 2, ["--vertical-weight is for"]),
        (["--distance", "geodesic", "--vertical-weight", "0"], 2, ["vertical weight is 0"]),
        (
            ["--distance", "haversine", "--columns", "lat=lon,lon=lat"],
            3,
            ["t.csv", "line 2", '"lat"', "180", "-90 to 90"],
        ),
        (
            ["--distance", "iou", "--columns", "left,top,width=x,height"],
            3,
            ["t.csv", "line 2", '"width"', "0 is not a width", "> 0"],
        ),
    ],
)
def test_what_does_not_fit(
    invoke: Invoke, pair: tuple[str, str], arguments: list[str], status: int, parts: list[str]
) -> None:
    answer = invoke(*pair, *arguments)
    assert (answer.status, answer.out) == (status, "")
    for part in parts:
        assert part in answer.err


@pytest.mark.parametrize(
    ("content", "status", "parts"),
    [
        ("", 3, ["empty"]),
        ("x,y\n1,0\n0,1\n", 3, ["line 1", "2 fields in a file of 3 rows", "without header"]),
        ("1,x\n0,1\n", 3, ["line 1, column 2", '"x"']),
        ("1,2\n3,9\n", 3, ["not symmetric", "2 in row 1, column 2"]),
        ("1,1\n1,1\n", 3, ["not positive definite"]),
        ("1,2\n2,1\n", 3, ["not positive definite"]),
        ("-1,0\n0,1\n", 3, ["diagonal"]),
        ("1,nan\nnan,1\n", 3, ["finite"]),
        (b"\xff\x00\xfe", 3, ["not text"]),
        ("1\n", 2, ["2 state columns (x,y)", "covariance is for 1"]),
    ],
)
def test_covariance_files(
    invoke: Invoke,
    write: Write,
    pair: tuple[str, str],
    content: str | bytes,
    status: int,
    parts: list[str],
) -> None:
    write("m.csv", content)
    answer = invoke(*pair, "--distance", "mahalanobis", "--covariance", "m.csv")
    assert (answer.status, answer.out) == (status, "")
    for part in parts:
        assert part in answer.err


def test_missing_covariance_file(invoke: Invoke, pair: tuple[str, str]) -> None:
    for path, part in (("none.csv", "no such file"), (".", "is a folder")):
        answer = invoke(*pair, "--distance", "mahalanobis", "--covariance", path)
        assert answer.status == 3
        assert part in answer.err


def test_plain_degrees_name_the_distance_for_metres(invoke: Invoke, write: Write) -> None:
    path = write("t.csv", "id,t,lat,lon\na,1,2,3\n")
    assert "--distance haversine" in invoke(path, path).err
    assert "plain numbers" not in invoke(path, path, "--distance", "haversine").err


def test_decimal_comma_in_a_covariance(invoke: Invoke, write: Write) -> None:
    write("m.csv", "0,25;0\n0;0,25\n")
    truth = write("t.csv", "id;t;x;y\na;1;0;0\n")
    estimate = write("e.csv", "id;t;x;y\na;1;0,3;0,4\n")
    answer = invoke(
        truth, estimate, "--decimal", ",", "--distance", "mahalanobis", "--covariance", "m.csv",
        "--format", "json",
    )  # fmt: skip
    assert json.loads(answer.out)["tgospa"] == pytest.approx(1.0)


def test_python() -> None:
    import pandas as pd

    boxes = np.array([[[0.0, 0, 2, 1]], [[0, 0, 2, 1]]])
    moved = boxes + np.array([1, 0, 0, 0])
    result = evaluate(boxes, moved, distance="iou", cutoff=1)
    assert result.total == pytest.approx(2 * 4 / 9)
    assert evaluate(boxes, moved, distance="iou").parameters["cutoff"] == 0.5
    assert evaluate(boxes, moved).parameters["cutoff"] == 10.0
    frame = pd.DataFrame({"id": ["a"], "t": [0], "x": [1], "lat": [0.0], "lon": [0.0]})
    assert evaluate(frame, frame.assign(lon=1e-5), distance="haversine").total == pytest.approx(
        math.radians(1e-5) ** 2 * EARTH**2
    )
    points = np.zeros((2, 1, 2))
    with pytest.raises(ConfigError, match="needs covariance"):
        evaluate(points, points, distance="mahalanobis")
    assert evaluate(points, points + 1, distance="mahalanobis", covariance=np.eye(2)).total == 4
    with pytest.raises(ConfigError, match="scale is for 3"):
        evaluate(points, points, distance=METRICS["scaled"])
    with pytest.raises(InputError, match="needs the state columns lat,lon"):
        evaluate(boxes, boxes, distance="haversine")
    with pytest.raises(InputError, match="height is -1"):
        evaluate(boxes, boxes * [1, 1, 1, -1], distance="iou")


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Norm(name="x", power=3.0),
        lambda: Norm(name="euclidean", power=2.0, scale=(0.0,)),
        lambda: Norm(name="euclidean", power=2.0, period="2"),
        lambda: Norm(name="euclidean", power=2.0, period=("a",)),
        lambda: Mahalanobis(covariance=[[1, 2, 3]]),
        lambda: Mahalanobis(covariance="text"),
        lambda: Mahalanobis(covariance=[[1, 2], [2, 1]]),
        lambda: Mahalanobis(covariance=[[math.inf]]),
    ],
)
def test_records_check_their_settings(wrong: Callable[[], Distance]) -> None:
    with pytest.raises(ConfigError):
        wrong()


def test_named_records() -> None:
    assert DISTANCES["iou"] == IoU()
    assert Mahalanobis(covariance=np.eye(2)) == Mahalanobis(covariance=[[1, 0], [0, 1]])
