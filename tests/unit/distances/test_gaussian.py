"""Normal laws: the distance against exact references, the columns of covariances, the metric."""

import json
import math
import re
from decimal import Decimal, localcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from all_pairs import WAYS, go
from answer import Invoke, Write
from checkout import SAMPLES
from hypothesis import given
from hypothesis import strategies as st
from oracles import tgospa_lp

from tgospa_eval import ConfigError, InputError, Trajectories, evaluate, read_trajectories
from tgospa_eval.distances import (
    DISTANCES,
    GaussianWasserstein,
    gaussian_wasserstein,
    near_pairs,
)
from tgospa_eval.evaluation.prepare import digest
from tgospa_eval.formats import ReadOptions, read
from tgospa_eval.formats.frames import from_frame
from tgospa_eval.formats.write import csv_text
from tgospa_eval.inspection import describe
from tgospa_eval.simulation import Scene, Tracker, simulate, tracker
from tgospa_eval.tracks.alignment import TimeMatching, align
from tgospa_eval.tracks.covariances import factor, pack, project, unpack

Array = np.ndarray

SEEDS = st.integers(0, 2**32 - 1)
W2 = DISTANCES["gaussian-wasserstein"]
SAMPLE = SAMPLES / "gaussian"
ROOT = [str(SAMPLE / name) for name in ("truth.csv", "estimate.csv")]
GAUSSIAN = ("--distance", "gaussian-wasserstein")


def covariance(rng: np.random.Generator, d: int, rank: int, condition: float) -> Array:
    """A random one, its eigenvalues down to 1 / condition."""
    axes = np.linalg.qr(rng.normal(size=(d, d)))[0]
    values = np.logspace(0, -math.log10(condition), d) * (np.arange(d) < rank)
    matrix = (axes * values) @ axes.T
    return np.asarray((matrix + matrix.T) / 2)


# --- the distance ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        # W2^2 = 25 + 6 + 4 - 2 sqrt(tr C1 C2 + 2 sqrt(7 * 2.75)) with tr C1 C2 = 9
        (([0, 0], [[4, 1], [1, 2]]), ([3, 4], [[1, -0.5], [-0.5, 3]]), 5.154408487246876),
        # 100 + 3 (sqrt 2 - 1)^2
        (([0, 0, 0], 2 * np.eye(3)), ([10, 0, 0], np.eye(3)), 10.025702899336357),
        (([1], [[4]]), ([4], [[9]]), math.sqrt(10)),  # 3^2 + (2 - 3)^2
        # (1, 1)(1, 1)' and (1, -1)(1, -1)': orthogonal, 2 + 2
        (([0, 0], [[1, 1], [1, 1]]), ([0, 0], [[1, -1], [-1, 1]]), 2),
        # (1, 1) and (2, 2): B^2 = |(1, 1)|^2
        (([0, 0], [[1, 1], [1, 1]]), ([0, 0], [[4, 4], [4, 4]]), math.sqrt(2)),
        (([0, 0], None), ([3, 4], np.diag([4, 5])), math.sqrt(34)),  # 25 + 9
        # passes any tolerance, but nothing may be larger than what is left of a variance
        (([0, 0], [[1e-20, 1e-9], [1e-9, 1]]), ([0, 0], np.eye(2)), 1.0),
        (([0, 0], None), ([3, 4], None), 5),
        (([0] * 4, np.eye(4)), ([0] * 4, 4 * np.eye(4)), 2),
    ],
)
def test_values(first: Any, second: Any, expected: float) -> None:
    for one, other in ((first, second), (second, first)):
        assert gaussian_wasserstein(*one, *other) == pytest.approx(expected, rel=1e-13)


def test_nearly_equal_covariances() -> None:
    # sqrt 2 (sqrt(1 + e) - 1); the formula with traces gives 0 or NaN
    e = 2.0**-33
    found = gaussian_wasserstein([0, 0], np.eye(2), [0, 0], (1 + e) * np.eye(2))
    assert found == pytest.approx(8.231806349544e-11, rel=1e-5)


def test_headings() -> None:
    # 2 pi - 6.2 apart, standard deviations 0.2 and 0.3
    turn = 2 * math.pi
    for shift in (0, turn, -3 * turn):
        found = gaussian_wasserstein([3.1 + shift], [[0.04]], [-3.1], [[0.09]], period=turn)
        assert found == pytest.approx(0.130076113604928, rel=1e-12)
    both = gaussian_wasserstein(
        [359, 7], np.zeros((2, 2)), [2, 11], np.zeros((2, 2)), period=[360, np.inf]
    )
    assert both == pytest.approx(5)


def exact(first: Array, second: Array) -> float:
    """Bures distance of two 2 x 2 matrices, of their very doubles, in 60 digits."""
    with localcontext() as context:
        context.prec = 60
        (a, b, _, c), (d, e, _, f) = (map(Decimal, m.ravel().tolist()) for m in (first, second))
        inner = (max(a * c - b * b, Decimal(0)) * max(d * f - e * e, Decimal(0))).sqrt()
        cross = (a * d + 2 * b * e + c * f + 2 * inner).sqrt()
        return float(max(a + c + d + f - 2 * cross, Decimal(0)).sqrt())


@pytest.mark.parametrize("condition", [1.0, 1e4, 1e8, 1e12])
@pytest.mark.parametrize("other", [1.0, 1e3, 1e12])
def test_two_components_in_all_digits(condition: float, other: float) -> None:
    rng = np.random.default_rng(int(condition + other))
    scales, sides, values = [], [], []
    for _ in range(50):
        scale = np.exp(rng.normal(0, 3))
        a = scale * covariance(rng, 2, 2, condition)
        b = scale * covariance(rng, 2, 2, other)
        scales.append(scale)
        sides.append((a, b))
        values.append(exact(a, b))
    first, second = zip(*sides, strict=True)
    found = gaussian_wasserstein([0, 0], first, [0, 0], second)
    for one, value, scale in zip(found, values, scales, strict=True):
        assert one == pytest.approx(value, rel=1e-11, abs=1e-13 * scale**0.5)


@pytest.mark.parametrize("large", [1, 10**3, 10**6, 10**10])
def test_more_components_in_all_digits(large: int) -> None:
    """Of integers, so that a turned block matrix is exact; its blocks have closed forms.

    With R = turn / 3 orthogonal, turn C turn' = 9 R C R', and B is 3 times that of the blocks.
    """
    turn = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]])
    rng = np.random.default_rng(large)
    for _ in range(20):
        vector = rng.integers(1, 9, 2)
        one = large * np.outer(vector, vector) + np.eye(2, dtype=int)
        two = rng.integers(1, 9) * np.eye(2, dtype=int) + np.outer(*[rng.integers(-3, 4, 2)] * 2)
        ends = rng.integers(0, 9, 2)
        blocks = [np.zeros((3, 3), int) for _ in range(2)]
        for block, top, end in zip(blocks, (one, two), ends, strict=True):
            block[:2, :2], block[2, 2] = top, end
        a, b = (turn @ block @ turn.T for block in blocks)
        expected = 3 * math.hypot(
            exact(one.astype(float), two.astype(float)), math.sqrt(ends[0]) - math.sqrt(ends[1])
        )
        zero = np.zeros(3)
        assert gaussian_wasserstein(zero, a, zero, b) == pytest.approx(expected, rel=1e-11)
        twice = np.kron(np.eye(2, dtype=int), a), np.kron(np.eye(2, dtype=int), b)
        found = gaussian_wasserstein(np.zeros(6), twice[0], np.zeros(6), twice[1])
        assert found == pytest.approx(math.sqrt(2) * expected, rel=1e-11)


@pytest.mark.parametrize("d", [2, 3, 4, 6])
def test_lines(d: int) -> None:
    """Rank one: B^2 = |v|^2 + |w|^2 - 2 |v.w| of v v' and w w'; of v v' and D, v'Dv in the root."""
    rng = np.random.default_rng(d)
    zero = np.zeros(d)
    for _ in range(30):
        v, w = rng.normal(size=(2, d))
        full = covariance(rng, d, d, 100.0)
        lines = gaussian_wasserstein(zero, np.outer(v, v), zero, np.outer(w, w))
        assert lines == pytest.approx(math.sqrt(v @ v + w @ w - 2 * abs(v @ w)), rel=1e-11)
        mixed = gaussian_wasserstein(zero, np.outer(v, v), zero, full)
        expected = v @ v + np.trace(full) - 2 * math.sqrt(v @ full @ v)
        assert mixed == pytest.approx(math.sqrt(expected), rel=1e-11)


@pytest.mark.parametrize("d", [2, 3, 4, 6])
def test_singular_covariances_of_any_rank(d: int) -> None:
    """A A' of fewer columns than rows, rounded: B^2 = |A|^2 + |F|^2 - 2 sum of s of F'A.

    The sum of squares loses no digits here, since B is as large as A and F.
    """
    rng = np.random.default_rng(d)
    zero, sides, values = np.zeros(d), [], []
    for _ in range(100):
        size = 10.0 ** rng.uniform(-2, 2, (d, 1))
        factors = [size * rng.normal(size=(d, int(rng.integers(1, d + 1)))) for _ in range(2)]
        a, b = factors[0] / np.linalg.norm(factors[0]), 3 * factors[1] / np.linalg.norm(factors[1])
        cross = np.linalg.svd(b.T @ a, compute_uv=False).sum()
        values.append(math.sqrt(1 + 9 - 2 * cross))
        sides.append((a @ a.T, b @ b.T))
    first, second = zip(*sides, strict=True)
    assert gaussian_wasserstein(zero, first, zero, second) == pytest.approx(values, rel=1e-11)


@given(seed=SEEDS, d=st.integers(1, 6), periodic=st.booleans())
def test_the_distance_is_the_same_both_ways_to_the_bit(seed: int, d: int, periodic: bool) -> None:
    rng = np.random.default_rng(seed)
    count = 40
    means = rng.normal(size=(2, count, d)) * 10.0 ** rng.integers(-3, 4)
    laws = np.array(
        [
            [covariance(rng, d, int(rng.integers(0, d + 1)), 1e6) for _ in range(count)]
            for _ in range(2)
        ]
    )
    some = rng.random(count) < 0.2
    laws[1][some] = laws[0][some]  # of equal ones as well
    period = 7.0 if periodic else None
    one = gaussian_wasserstein(means[0], laws[0], means[1], laws[1], period=period)
    other = gaussian_wasserstein(means[1], laws[1], means[0], laws[0], period=period)
    np.testing.assert_array_equal(one, other)
    alone = [
        gaussian_wasserstein(means[1][k], laws[1][k], means[0][k], laws[0][k], period=period)
        for k in range(3)
    ]
    np.testing.assert_array_equal(one[:3], alone)  # whatever is beside it


def test_equal_laws_are_at_distance_0() -> None:
    rng = np.random.default_rng(1)
    for d in (1, 2, 3, 5):
        for condition in (1.0, 1e6, 1e12):
            matrix = covariance(rng, d, d, condition)
            assert gaussian_wasserstein(np.ones(d), matrix, np.ones(d), matrix) == 0


def test_moved_laws_are_apart_by_what_they_were_moved() -> None:
    rng = np.random.default_rng(5)
    for d in (1, 2, 3, 4):
        matrix = covariance(rng, d, max(d - 1, 1), 1e6)
        v = rng.normal(size=d)
        found = gaussian_wasserstein(np.zeros(d), matrix, v, matrix)
        assert found == pytest.approx(np.linalg.norm(v), rel=1e-14)


def test_arguments_broadcast() -> None:
    rng = np.random.default_rng(2)
    for d in (1, 2, 3):
        means = rng.normal(size=(4, 1, d)), rng.normal(size=(5, d))
        matrices = np.array([covariance(rng, d, d, 10.0) for _ in range(5)])
        table = gaussian_wasserstein(means[0], None, means[1], matrices)
        assert table.shape == (4, 5)
        one = gaussian_wasserstein(means[0][2, 0], np.zeros((d, d)), means[1][3], matrices[3])
        assert one.shape == ()
        assert one == table[2, 3]
        trace = np.trace(matrices, axis1=1, axis2=2)
        expected = np.sqrt(((means[0] - means[1]) ** 2).sum(axis=-1) + trace)
        assert np.allclose(table, expected, rtol=1e-13)


def test_one_component_and_no_laws() -> None:
    for one in (1, [1]):
        assert gaussian_wasserstein(one, 4, [4] if one == [1] else 4, 9) == pytest.approx(10**0.5)
    for d in (1, 2, 3):
        none = np.zeros((0, d)), np.zeros((0, d, d))
        assert gaussian_wasserstein(*none, *none).shape == (0,)
        assert gaussian_wasserstein(*none, np.zeros((4, 1, d)), np.eye(d)).shape == (4, 0)


def test_limits_of_acceptance_belong_to_it() -> None:
    # 5000 v v' - 5 w w' of v = (1, 2) and w = (2, -1), over sqrt 5: least / largest = -0.001
    matrix = np.array([[996, 2002], [2002, 3999]]) / 5000
    with pytest.warns(UserWarning, match=r"by up to 0\.001 of"):
        found = gaussian_wasserstein([0, 0], matrix, [0, 0], None)
    assert found == pytest.approx(1, rel=1e-11)  # v v'
    apart = gaussian_wasserstein([0, 0], [[2, 1], [0.999999, 2]], [0, 0], None)  # by a millionth
    assert apart == pytest.approx(2)
    for beyond in (0.999998, 1.000002):
        with pytest.raises(InputError, match="not symmetric"):
            gaussian_wasserstein([0, 0], [[2, 1], [beyond, 2]], [0, 0], None)


@pytest.mark.parametrize(
    ("arguments", "kind", "message"),
    [
        (([0, 0], np.eye(2), [0, 0, 0], np.eye(3)), InputError, "shapes (2,) and (3,)"),
        ((0.0, None, [0.0], None), InputError, "must be (..., d)"),
        (([0, 0], 4.0, [0, 0], None), InputError, "must be (..., 2, 2)"),
        (([0], [[1j]], [0], None), InputError, "covariance must be an array of real numbers"),
        (([], None, [], None), InputError, "no components"),
        (([0, 0], np.eye(3), [0, 0], None), InputError, "must be (..., 2, 2)"),
        (([0, math.nan], None, [0, 0], None), InputError, "mean: a number is not finite"),
        (([0], [[math.inf]], [0], None), InputError, "covariance: a number is not finite"),
        (([0], [["a"]], [0], None), InputError, "array of real numbers"),
        (([0], [[-1]], [0], None), InputError, "covariance: negative variance -1"),
        (([0], [[1e200]], [0], None), InputError, "above 1e+150"),
        (([0, 0], [[1, 2], [2, 1]], [0, 0], None), InputError, "(eigenvalues -1, 3)"),
        (([0, 0], [[2, 1], [1.001, 2]], [0, 0], None), InputError, "not symmetric: 1.001"),
        (
            ([0, 0], np.array([np.eye(2), -np.eye(2)]), [0, 0], None),
            InputError,
            "covariance (1,): negative variance",
        ),
        ((np.zeros((2, 1)), None, np.zeros((3, 1)), None), InputError, "do not broadcast"),
    ],
)
def test_wrong_arguments(arguments: Any, kind: type, message: str) -> None:
    with pytest.raises(kind, match=re.escape(message)):
        gaussian_wasserstein(*arguments)


def test_wrong_periods() -> None:
    with pytest.raises(InputError, match="one number per component"):
        gaussian_wasserstein([0, 0], None, [0, 0], None, period=[1, 2, 3])
    with pytest.raises(ConfigError, match="period is 0"):
        gaussian_wasserstein([0], None, [0], None, period=0)
    with pytest.raises(InputError, match="but there are 3"):
        W2([1, 2, 3], [1, 2, 3])


def test_nearly_covariances_are_mended_with_a_warning() -> None:
    matrix = np.array([[1, 1.0005], [1.0005, 1]])  # eigenvalues -0.0005 and 2.0005
    with pytest.warns(UserWarning, match=r"1 covariance is not quite .* by up to 0.00025"):
        found = gaussian_wasserstein([0, 0], matrix, [0, 0], np.eye(2))
    # 2.0005 e e' with e = (1, 1) / sqrt 2: B^2 = 2.0005 + 2 - 2 sqrt(2.0005)
    assert found == pytest.approx(math.sqrt(4.0005 - 2 * math.sqrt(2.0005)), rel=1e-11)


@given(seed=SEEDS, d=st.integers(2, 5), exponent=st.floats(-12, -3))
def test_nearest_covariance(seed: int, d: int, exponent: float) -> None:
    """Never NaN, near its matrix, and its factors give it back."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(d, d)))[0]
    values = np.append(np.sort(rng.exponential(size=d - 1)), -0.0)
    values[-1] = -(10.0**exponent) * values.max()
    matrix = (axes * values) @ axes.T
    mended, ratio = project(pack(np.array([matrix + matrix.T]) / 2))
    largest = values.max()
    assert ratio[0] == pytest.approx(values[-1] / largest, abs=2e-14 * d)
    lower = unpack(factor(mended), lower=True)[0]
    # Rounding of what the leading components leave is that of the matrix, times their condition.
    rounding = 1e-13 * d * largest * (largest / values[:-1].min())
    assert np.abs(lower @ lower.T - unpack(mended)[0]).max() <= rounding
    assert np.abs(lower @ lower.T - matrix).max() <= 10.0**exponent * largest + rounding


# --- a metric -------------------------------------------------------------------------------------


def laws(rng: np.random.Generator, count: int, d: int, spread: float) -> Array:
    """Means and packed factors (count, d (d + 3) / 2), of any rank, some equal."""
    found, matrices = np.zeros((count, d * (d + 3) // 2)), np.zeros((count, d, d))
    for row, matrix in zip(found, matrices, strict=True):
        rank = int(rng.integers(0, d + 1))
        matrix[:] = spread**2 * covariance(rng, d, rank, 10.0 ** rng.integers(0, 10))
        row[:d] = np.round(rng.normal(0, spread, d), rng.integers(0, 5))
    found[:, d:] = factor(project(pack(matrices))[0]).T
    found[-1] = found[0]
    return found


@pytest.mark.parametrize("periodic", [False, True])
@given(seed=SEEDS, d=st.integers(1, 4), spread=st.sampled_from([1e-6, 0.1, 3.0, 1e4]))
def test_it_is_a_metric(periodic: bool, seed: int, d: int, spread: float) -> None:
    distance = GaussianWasserstein(
        period=(2.0,) + (math.inf,) * (d - 1) if periodic else None,
        scale=(3.0,) + (1.0,) * (d - 1) if periodic else None,
    )
    x = laws(np.random.default_rng(seed), 7, d, spread)
    table = distance(x[:, None], x[None])
    assert np.isfinite(table).all()
    assert np.all(np.diag(table) == 0)
    assert np.all(table >= distance._means(x[:, None, :d], x[None, :, :d]))
    allowed = 1e-13 * (spread + np.abs(x).max()) * 10
    assert np.all(np.abs(table - table.T) <= (0 if d <= 2 else allowed))
    assert np.all(table[:, None] <= table[:, :, None] + table.T[None] + allowed)
    if periodic:
        x[:, 0] += 2.0
        assert np.all(np.abs(distance(x[:, None], x[None]) - table) <= 10 * allowed)


@given(seed=SEEDS, p=st.sampled_from([1.0, 2.0, 3.0]))
def test_tgospa_of_laws_is_a_metric(seed: int, p: float) -> None:
    rng = np.random.default_rng(seed)
    sets = []
    for _ in range(3):
        count = int(rng.integers(0, 3))
        states = rng.uniform(0, 4, (3, count, 2))
        states[rng.random((3, count)) < 0.3] = np.nan
        factors = rng.normal(size=(3, count, 2, int(rng.integers(1, 3))))
        matrices = factors @ factors.transpose(0, 1, 3, 2)
        sets.append(Trajectories.from_array(states, covariance=matrices))

    def value(one: Trajectories, other: Trajectories) -> float:
        return evaluate(one, other, 3.0, p, 1.0, distance=W2).tgospa

    a, b, c = sets
    assert value(a, a) == 0
    assert value(a, b) == pytest.approx(value(b, a), rel=1e-9, abs=1e-12)
    assert value(a, c) <= value(a, b) + value(b, c) + 1e-9


# --- near pairs -----------------------------------------------------------------------------------


def table(rng: np.random.Generator, count: int, d: int, spread: float) -> Trajectories:
    """Laws at 4 steps, each row a track of its own."""
    rows = laws(rng, count, d, spread)
    lower = unpack(np.ascontiguousarray(rows[:, d:].T), lower=True)
    return Trajectories(
        step=np.sort(rng.integers(0, 4, count)),
        track=np.arange(count),
        state=rows[:, :d],
        ids=np.array([str(k) for k in range(count)], dtype=object),
        times=np.arange(4),
        columns=tuple(f"x{k}" for k in range(d)),
        covariance=pack(lower @ lower.transpose(0, 2, 1)).T,
    )


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("d", [1, 2, 3])
def test_near_pairs(d: int, way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    go(way, monkeypatch)
    rng = np.random.default_rng([d, len(way)])
    period = (5.0, *[math.inf] * (d - 1))
    for distance in (W2, GaussianWasserstein(period=period, scale=(0.5,) * d)):
        for spread in (1e-6, 3.0, 1e4):
            sides = [table(rng, 18, d, spread) for _ in range(2)]
            axes = [distance.axes(side, slice(None)).T for side in sides]
            every = distance(axes[0][:, None], axes[1][None])
            together = sides[0].step[:, None] == sides[1].step[None]
            for cutoff in {spread, np.median(every), every.max()} - {0.0}:
                i, j = np.nonzero((every < cutoff) & together)
                pairs = near_pairs(*sides, float(cutoff), distance)
                assert np.array_equal(pairs.truth_row, i)
                assert np.array_equal(pairs.estimate_row, j)
                assert np.allclose(pairs.distance, every[i, j], rtol=1e-12, atol=1e-14 * spread)


def test_points_are_compared_as_by_euclid() -> None:
    x = np.random.default_rng(1).normal(size=(2, 3, 4, 2))
    sides = [Trajectories.from_array(side) for side in x]
    a, b = (near_pairs(*sides, 2.0, DISTANCES[n]) for n in ("euclidean", "gaussian-wasserstein"))
    assert np.array_equal(a.distance, b.distance)


# --- the metric over files ------------------------------------------------------------------------


def test_against_the_plain_programme(write: Write, invoke: Invoke) -> None:
    """Diagonal covariances: B^2 is the sum of (s - t)^2, so laws are points (x, y, s_x, s_y)."""
    rng = np.random.default_rng(7)
    texts, arrays = [], []
    for count in (3, 4):
        states = np.round(rng.uniform(0, 4, (5, count, 4)), 3)
        states[rng.random((5, count)) < 0.2] = np.nan
        rows = [
            f"{i},{k},{x},{y},{s},{r}"
            for k, step in enumerate(states.tolist())
            for i, (x, y, s, r) in enumerate(step)
            if not math.isnan(x)
        ]
        texts.append("\n".join(["id,t,x,y,std_x,std_y", *rows]) + "\n")
        arrays.append(states)
    files = write("t.csv", texts[0]), write("e.csv", texts[1])
    expected = tgospa_lp(*arrays, 3.0, 2.0, 1.5)
    for solver in ("certified", "exact"):
        done = invoke(
            *files, *GAUSSIAN, *("-c", "3", "-g", "1.5", "--solver", solver), "--format", "json"
        )
        document = json.loads(done.out)
        assert document["total"] == pytest.approx(expected, rel=1e-6)
    assert document["certified"]


def test_by_hand(write: Write, invoke: Invoke) -> None:
    """One truth, C = diag(4, 1); at t = 2 another track takes over.

    t = 1: means 1 apart, C equal: 1. t = 2: means equal, diag(4, 1) to diag(1, 4): (2 - 1)^2 +
    (1 - 2)^2 = 2. Half of gamma^2 = 4 for each half of the switch: 4. A false track at (9, 9):
    c^2 / 2 = 12.5, and total 19.5.
    """
    truth = write("t.csv", "id,t,x,y,cov_xx,cov_yy\na,1,0,0,4,1\na,2,1,0,4,1\n")
    estimate = write(
        "e.csv",
        "id,t,x,y,cov_xx,cov_xy,cov_yy\n7,1,1,0,4,0,1\n8,2,1,0,1,0,4\n9,2,9,9,1,0,1\n",
    )
    done = invoke(truth, estimate, *GAUSSIAN, "-c", "5", "-g", "2", "--format", "json")
    document = json.loads(done.out)
    found = [document[name] for name in ("localisation", "missed", "false", "switch", "total")]
    assert found == pytest.approx([3, 0, 12.5, 4, 19.5], rel=1e-12)
    assert document["localisation_mean"] == pytest.approx(1, rel=1e-12)
    assert document["localisation_spread"] == pytest.approx(2, rel=1e-12)
    parameters = document["parameters"]
    assert parameters["distance"] == "gaussian-wasserstein"
    assert (parameters["fix_cov"], parameters["missing_cov"]) == (False, "error")
    assert "no column cov_xy: taken as 0" in done.err
    table = invoke(truth, estimate, *GAUSSIAN, "-c", "5", "-g", "2", "-q").out
    assert re.search(r"means +1 +5.1 %\n +spread +2 +10.3 %", table)
    first = json.loads(
        invoke(truth, estimate, *GAUSSIAN, "-c", "5", "-g", "2", "-p", "1", "--format", "json").out
    )
    assert "localisation_mean" not in first
    assert first["localisation"] == pytest.approx(1 + math.sqrt(2), rel=1e-12)


def test_parts_add_up_by_class(write: Write, invoke: Invoke) -> None:
    header = "id,t,class,x,y,cov_xx,cov_yy\n"
    truth = write("t.csv", header + "a,1,car,0,0,0,0\nb,1,van,9,9,4,4\n")
    estimate = write("e.csv", header + "1,1,car,1,0,4,0\n2,1,van,9,7,4,1\n")
    files = truth, estimate, *GAUSSIAN, "-c", "5", "-g", "2", "-q"
    whole, parts = (
        json.loads(invoke(*files, *more, "--format", "json").out)
        for more in ((), ("--by", "class"))
    )
    for name, value in (("localisation_mean", 1 + 4), ("localisation_spread", 4 + 1)):
        assert whole[name] == parts[name] == pytest.approx(value, rel=1e-12)
    assert parts["by_class"]["van"]["localisation_mean"] == pytest.approx(4, rel=1e-12)


def test_other_distances_do_not_look_at_covariances(invoke: Invoke) -> None:
    done = invoke(*ROOT, "-c", "15", "-g", "7", "--format", "json")
    assert done.err.count("gaussian-wasserstein compares covariances") == 1
    document = json.loads(done.out)
    assert "localisation_mean" not in document
    assert "fix_cov" not in document["parameters"]
    sides = [read_trajectories(path) for path in ROOT]
    result = evaluate(*sides, 15, 2, 7)
    assert result.total == document["total"]
    assert result.input["estimate"]["sha256"] == document["input"]["estimate"]["sha256"]
    without = [read_trajectories(path, covariance=False) for path in ROOT]
    assert without[1].covariance is None
    assert evaluate(*without, 15, 2, 7).input == result.input


# --- columns --------------------------------------------------------------------------------------

MATRIX = np.array([[4.0, 1.0, -0.5], [1.0, 2.0, 0.25], [-0.5, 0.25, 3.0]])
STD = np.sqrt(np.diag(MATRIX))
RHO = MATRIX / STD / STD[:, None]

HEADERS = {
    "letters": ("x,y,vx", "cov_xx,cov_xy,cov_yy,cov_x_vx,cov_y_vx,cov_vx_vx", "cov"),
    "other order": ("x,y,vx", "cov_vx_vx,cov_vx_y,cov_vx_x,cov_yy,COV_YX,cov_x_x", "vc"),
    "both of a pair": ("x,y,vx", "cov_xx,cov_xy,cov_yx,cov_yy,cov_x_vx,cov_y_vx,cov_vx_vx", "2"),
    "deviations": ("x,y,vx", "std_x,std_y,std_vx,rho_yx,rho_x_vx,rho_y_vx", "std"),
    "P": ("x,y,vx", "Pxx,Pxy,P_yy,P_x_vx,P_y_vx,P_vx_vx", "cov"),
    "variances": ("x,y,vx", "var_x,cov_xy,var_y,cov_x_vx,cov_y_vx,var_vx", "cov"),
    "sigma": ("x,y,vx", "sigma_x,sigma_y,sigma_vx,rho_yx,rho_x_vx,rho_y_vx", "std"),
}
VALUES = {
    "cov": [4, 1, 2, -0.5, 0.25, 3],
    "vc": [3, 0.25, -0.5, 2, 1, 4],
    "2": [4, 1, 1 + 1e-9, 2, -0.5, 0.25, 3],
    "std": [*STD.tolist(), RHO[0, 1], RHO[0, 2], RHO[1, 2]],
}


@pytest.mark.parametrize("kind", HEADERS)
def test_spellings(kind: str, write: Write) -> None:
    states, header, values = HEADERS[kind]
    row = ",".join(map(repr, map(float, VALUES[values])))
    path = write("a.csv", f"id,t,{states},{header}\n1,1,0,0,0,{row}\n")
    found = read_trajectories(path, columns=("x", "y", "vx"))
    assert found.covariance is not None
    assert np.allclose(unpack(found.covariance.T)[0], MATRIX, rtol=1e-9)
    part = read_trajectories(path, columns=("vx", "x"))
    assert part.covariance is not None
    assert np.allclose(part.covariance, [[3, -0.5, 4]], rtol=1e-9)


@pytest.mark.parametrize(
    ("header", "columns", "found", "said"),
    [
        ("P11,P12,P22", None, [4, 1, 2], "covariances are read from P11, P12, P22"),
        ("P_1_1,P_2_1,P_2_2", None, [4, 1, 2], "covariances are read from P_1_1, P_2_1, P_2_2"),
        ("var_x,s,var_y", None, [4, 0, 2], "covariances are read from var_x, var_y"),
        ("sigma_x,s,sigma_y", None, [16, 0, 4], "standard deviations are read from sigma_x, sig"),
        (
            "P11,P13,P33",
            None,
            None,
            "columns are covariances, map them with columns=('cov_xx=HEADER'",
        ),
        ("P11,P12,P22", ("y", "x"), None, "no columns of covariances"),  # of which is P11?
        ("P11,P12,P22", ("x",), None, "no columns of covariances"),
        ("p_1,pos_a_b,variant", None, None, "(cov_xx, cov_xy, cov_yy): its states are points"),
    ],
)
def test_other_spellings_are_said(
    header: str, columns: tuple[str, ...] | None, found: list[float] | None, said: str, write: Write
) -> None:
    path = write("a.csv", f"id,t,x,y,{header}\n1,1,0,0,4,1,2\n")
    reading = read(path, ReadOptions(covariance=True, columns=columns))
    assert said in " ".join(reading.notices)
    spread = reading.trajectories.covariance
    assert (None if spread is None else spread[0].tolist()) == found


def test_headers_are_mapped(write: Write) -> None:
    path = write("a.csv", "id,t,px,py,P11,P12,P22\n1,1,0,0,4,1,2\n")
    columns = ("x=px", "y=py", "cov_xx=P11", "cov_xy=P12", "cov_yy=P22")
    found = read_trajectories(path, columns=columns)
    assert found.columns == ("x", "y")
    assert found.covariance is not None
    assert found.covariance.tolist() == [[4, 1, 2]]
    with pytest.raises(InputError, match=r'no header "P21" for cov_xy'):
        read_trajectories(path, columns=(*columns[:3], "cov_xy=P21", columns[4]))
    points = write("b.csv", "id,t,px,py\n1,1,0,0\n")
    assert read_trajectories(points, columns=columns).covariance is None
    named = read_trajectories(write("c.csv", "id,t,cov_xx\n1,1,5\n"), columns=("cov_xx",))
    assert named.state.tolist() == [[5]]


@pytest.mark.parametrize(
    ("header", "columns", "expected"),
    [
        ("px,py,cov_px_px,cov_px_py,cov_py_py", "x=px,y=py", [4, 1, 2]),
        ("px,py,cov_xx,cov_xy,cov_yy", "x=px,y=py", [4, 1, 2]),
        ("PX,PY,cov_px_px,cov_py_px,cov_py_py", "x=PX,y=PY", [4, 1, 2]),
        ("x,y,cov_xx,cov_xy,cov_yy", "x=y,y=x", [2, 1, 4]),
        ("a,vx,cov_vx_vx,cov_xx,cov_yy", "x=vx", [4]),
    ],
)
def test_covariances_of_mapped_states(
    header: str, columns: str, expected: list[float], write: Write
) -> None:
    """By the headers of the states, or by what these are called."""
    path = write("a.csv", f"id,t,{header}\n1,1,0,0,4,1,2\n")
    found = read_trajectories(path, columns=tuple(columns.split(",")))
    assert found.covariance is not None
    assert found.covariance.tolist() == [expected]


def test_covariances_of_other_columns_are_not_taken(write: Write, invoke: Invoke) -> None:
    """x is mapped to a velocity, and cov_xx is that of the place, whose header is x."""
    path = write("a.csv", "id,t,x,vx,cov_xx\n1,1,0,0,4\n")
    assert read_trajectories(path, columns=("x=vx",)).covariance is None
    assert read_trajectories(path, columns=("x",)).covariance.tolist() == [[4]]
    done = invoke(path, path, *GAUSSIAN, "--columns", "x,cov_xx=P11")
    assert done.status == 3
    assert 'no header "P11" for cov_xx' in done.err
    assert invoke(path, path, *GAUSSIAN, "--columns", "cov_xx").status == 0  # a state column


def test_both_kinds_of_columns(write: Write) -> None:
    path = write("a.csv", "id,t,x,std_x,cov_xx\n1,1,0,7,4\n")
    reading = read(path, ReadOptions(covariance=True))
    assert reading.trajectories.covariance is not None
    assert reading.trajectories.covariance.tolist() == [[4]]
    assert reading.notices == ("columns not used: std_x",)


GOOD = "b,1,5,5,1,0,1\n"
HEADER = "id,t,x,y,cov_xx,cov_xy,cov_yy\n"
PAIR = "id,t,x,y,cov_xx,cov_xy,cov_yx,cov_yy\n"
DEVIATIONS = "id,t,x,y,std_x,std_y,rho_xy\n"
FOUR = '{path}, line 3 (id "4", t 9): '

REFUSED = {
    "not positive": (
        HEADER + GOOD + "4,9,0,0,1,2,2\n",
        FOUR + "covariance not positive semi-definite (eigenvalues -0.561553, 3.56155); "
        "correct it or use --fix-cov",
    ),
    "several": (
        HEADER + GOOD + "4,9,0,0,0,1,3\n5,9,0,0,1,2,1\n",
        FOUR + "covariance not positive semi-definite (eigenvalues -0.302776, 3.30278) "
        "(and 1 more); correct it or use --fix-cov",
    ),
    "negative variance": (
        HEADER + GOOD + "4,9,0,0,-1e-9,0,2\n",
        FOUR + "negative variance -1e-09; correct it or use --fix-cov",
    ),
    "blank": (
        HEADER + GOOD + "4,9,0,0,,,NaN\n",
        FOUR + "no covariance; add it, or --missing-cov zero makes such states points",
    ),
    "partly blank": (
        HEADER + GOOD + "4,9,0,0,1,,2\n",
        FOUR + "cov_xy is blank and other entries of the covariance are not; fill it, or leave "
        "all blank and use --missing-cov zero",
    ),
    "not symmetric": (
        PAIR + "b,1,5,5,1,0.5,0.5000001,1\n4,9,0,0,2,1,1.001,2\n",
        FOUR + "covariance not symmetric: cov_xy is given as 1 and as 1.001; correct one, or "
        "leave it out",
    ),
    "infinite": (
        HEADER + GOOD + "4,9,0,0,inf,0,2\n",
        '{path}, line 3, column "cov_xx": infinite: "inf"; leave it blank where the object is '
        "absent",
    ),
    "no number": (
        HEADER + GOOD + "4,9,0,0,1,0,two\n",
        '{path}, line 3, column "cov_yy": not a number: "two"; leave it blank where the object '
        "is absent",
    ),
    "too large": (
        HEADER + GOOD + "4,9,0,0,1e200,0,2\n",
        FOUR + "covariance above 1e+150; use another unit",
    ),
    "no diagonal": (
        "id,t,x,y,cov_xx,cov_xy\n",
        "{path}, line 1: no column cov_yy, but other covariance columns; add it, map it with "
        "--columns cov_yy=HEADER, or choose state columns with --columns",
    ),
    "no deviation": (
        "id,t,x,y,std_x\n",
        "{path}, line 1: no column std_y, but other covariance columns; add it, map it with "
        "--columns std_y=HEADER, or choose state columns with --columns",
    ),
    "negative deviation": (
        DEVIATIONS + GOOD + "4,9,0,0,-1,2,0\n",
        FOUR + "std_x is -1; it must be from 0 to 1e+75",
    ),
    "no correlation": (
        DEVIATIONS + GOOD.replace("0,1\n", "1,0\n") + "4,9,0,0,1,2,-1.5\n",
        FOUR + "rho_xy is -1.5; it must be from -1 to 1; correct it or use --fix-cov",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_refused(kind: str, write: Write, invoke: Invoke) -> None:
    text, message = REFUSED[kind]
    truth, estimate = write("t.csv", "id,t,x,y\na,1,0,0\n"), write("e.csv", text)
    done = invoke(truth, estimate, *GAUSSIAN)
    assert (done.status, done.out) == (3, "")
    assert done.err == message.format(path=estimate) + "\n"


@pytest.mark.parametrize(
    ("rows", "option", "notice", "expected"),
    [
        # nearest to [[1, 2], [2, 1]]: 3 e e' with e = (1, 1) / sqrt 2
        ("4,9,0,0,1,2,1\n", "--fix-cov", "1 covariance was replaced by the nearest", [1.5] * 3),
        ("4,9,0,0,-1,0,2\n", "--fix-cov", "1 covariance was replaced by the nearest", [0, 0, 2]),
        ("4,9,0,0,-1,0,-2\n", "--fix-cov", "1 covariance was replaced by the nearest", [0, 0, 0]),
        ("4,9,0,0,0,0,0\n", "--fix-cov", "", [0, 0, 0]),
        ("4,9,0,0,,,\n", "--missing-cov=zero", "1 state has no covariance: compared", [0, 0, 0]),
        # three digits of a line; its positive eigenvalue alone
        (
            "4,9,0,0,0.333,0.667,1.334\n",
            "--quiet",
            "",
            [0.333320057560, 0.666840019193, 1.334079966424],
        ),
        ("4,9,0,0,0,0,0\n", "--quiet", "", [0, 0, 0]),
        ("4,9,0,0,0.01,0.03,0.09\n", "--quiet", "", [0.01, 0.03, 0.09]),
    ],
)
def test_taken(
    rows: str, option: str, notice: str, expected: list[float], write: Write, invoke: Invoke
) -> None:
    truth = write("t.csv", "id,t,x,y\na,9,0,0\n")
    estimate = write("e.csv", HEADER + GOOD.replace("5,5", "500,500") + rows)
    done = invoke(truth, estimate, *GAUSSIAN, "-g", "1", option, "--format", "json")
    assert done.status == 0
    assert notice in done.err
    document = json.loads(done.out)
    # Against a point the cost of a covariance is its trace.
    assert document["localisation_spread"] == pytest.approx(expected[0] + expected[2], rel=1e-8)
    options = ReadOptions(covariance=True, fix_covariance=True, missing_covariance="zero")
    found = read(estimate, options).trajectories.covariance
    assert found is not None
    assert found[1] == pytest.approx(expected, rel=1e-8, abs=1e-12)


def test_correlations_beyond_1_are_mended(write: Write, invoke: Invoke) -> None:
    """[[4, 3], [3, 1]]: trace 5 and det -5, so the larger eigenvalue is (5 + 45^0.5) / 2."""
    truth = write("t.csv", "id,t,x,y\n4,9,0,0\n")
    estimate = write("e.csv", DEVIATIONS + "4,9,0,0,2,1,1.5\n")
    done = invoke(truth, estimate, *GAUSSIAN, "-g", "1", "--fix-cov", "--format", "json")
    assert "1 covariance was replaced by the nearest" in done.err
    assert json.loads(done.out)["total"] == pytest.approx((5 + 45**0.5) / 2, rel=1e-11)


def test_python_warns_of_what_is_clamped(write: Write) -> None:
    path = write("e.csv", HEADER + "4,9,0,0,1,1.0005,1\n")
    with pytest.warns(UserWarning, match=r'1 covariance is not quite .*line 2 \(id "4", t 9\)'):
        found = read_trajectories(path)
    pd = pytest.importorskip("pandas")
    with pytest.warns(UserWarning, match=r'by up to 0.00025 .*estimate, row 0 \(id "4", t 9\)'):
        evaluate(found, pd.read_csv(path), 5.0, distance="gaussian-wasserstein")
    with pytest.warns(UserWarning, match=r"not quite .*covariance of id .0., t 0"):
        Trajectories.from_array(np.zeros((1, 1, 2)), covariance=[[1, 1.0005], [1.0005, 1]])


def test_clamped_covariances_are_counted(write: Write, invoke: Invoke) -> None:
    """Three digits of v v', of which some are indefinite: a warning with number and worst."""
    rng = np.random.default_rng(3)
    lines = []
    for k in range(50):
        x, y = rng.uniform(0.5, 2, 2)
        lines.append(f"{k},1,{100 * k},0,{x * x:.3f},{x * y:.3f},{y * y:.3f}\n")
    path = write("e.csv", HEADER + "".join(lines))
    done = invoke(path, path, *GAUSSIAN, "-g", "1")
    assert done.status == 0
    (said,) = {line for line in done.err.splitlines() if "not quite" in line}
    count = int(re.search(r"^warning: .*: (\d+) covariances are not quite", said)[1])
    assert 10 < count < 40
    assert re.search(r'by up to 0.000\d+ of the largest .*line \d+ \(id "\d+", t 1\)', said)
    assert done.out.startswith("TGOSPA = 0,")


def test_rows_without_a_part_are_not_looked_at(write: Write) -> None:
    bad = "1,2,1\n"
    text = HEADER + GOOD + f"4,9,,,{bad}" + f"5,7,0,0,{bad}" + f"b,1,3,3,{bad}"
    options = ReadOptions(covariance=True, time=":5", on_duplicate="first")
    found = read(write("e.csv", text), options).trajectories
    assert found.covariance is not None
    assert found.covariance.tolist() == [[1, 0, 1]]


def test_notices_about_points(write: Write, invoke: Invoke) -> None:
    points, law = write("t.csv", "id,t,x,y\na,1,0,0\n"), write("e.csv", HEADER + GOOD)
    said = invoke(points, law, *GAUSSIAN).err
    assert "t.csv: no columns of covariances (cov_xx, cov_xy, cov_yy): its states are poi" in said
    assert "smaller covariances of the estimate always cost less" in said
    assert "smaller" not in invoke(law, points, *GAUSSIAN).err
    assert "gaussian-wasserstein equals the euclidean" in invoke(points, points, *GAUSSIAN).err
    assert "covariances" not in invoke(law, law, *GAUSSIAN, "-q").err


def test_options_of_other_distances(write: Write, invoke: Invoke) -> None:
    path = write("e.csv", HEADER + GOOD)
    for option in ("--fix-cov", "--missing-cov=zero"):
        done = invoke(path, path, option)
        assert done.status == 2
        assert "is for gaussian-wasserstein" in done.err
    done = invoke(path, path, *GAUSSIAN, "--covariance", path)
    assert (done.status, "not for gaussian-wasserstein" in done.err) == (2, True)


# --- other forms of the same ----------------------------------------------------------------------


def test_all_ways_of_reading_agree(write: Write, tmp_path: Path) -> None:
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    frame = pd.read_csv(ROOT[1])
    frame.to_parquet(tmp_path / "e.parquet")
    asked = ReadOptions(covariance=True)
    sides = [
        read(ROOT[1], asked).trajectories,
        read(str(tmp_path / "e.parquet"), asked).trajectories,
        from_frame(frame, asked).trajectories,
        read_trajectories(write("again.csv", csv_text(read_trajectories(ROOT[1])))),
    ]
    assert len({digest(side) for side in sides}) == 1
    truth = read_trajectories(ROOT[0])
    values = {
        evaluate(truth, side, 15, 2, 7, distance="gaussian-wasserstein").tgospa
        for side in (*sides, frame)
    }
    assert len(values) == 1
    bad = frame.assign(cov_xx=-1.0)
    with pytest.raises(
        InputError, match=r'estimate, row 0 \(id "101", t 1\): negative variance -1'
    ):
        evaluate(truth, bad, 15, distance="gaussian-wasserstein")


def test_large_files(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    from tgospa_eval.formats.text import lines

    monkeypatch.setattr(lines, "scanner", None)
    careful = read_trajectories(ROOT[1])
    monkeypatch.setattr(lines, "LARGE_BYTES", 1)
    assert digest(read_trajectories(ROOT[1])) == digest(careful)


def test_trajectories_carry_covariances() -> None:
    rng = np.random.default_rng(4)
    states = rng.normal(size=(3, 2, 2))
    states[1, 0] = np.nan
    matrices = np.array([covariance(rng, 2, 2, 10.0) for _ in range(6)]).reshape(3, 2, 2, 2)
    side = Trajectories.from_array(states, covariance=matrices)
    kept = [matrices[k, i] for k in range(3) for i in range(2) if (k, i) != (1, 0)]
    assert np.array_equal(side.covariance, pack(np.array(kept)).T)
    with pytest.raises(ValueError, match="read-only"):
        side.covariance[0, 0] = 1
    other = Trajectories.from_array(states + 1)
    moved = Trajectories(**{**vars(other), "times": np.array([1, 2, 9])})
    aligned = align(side, moved, TimeMatching(grid="estimate")).truth
    assert np.array_equal(aligned.covariance, side.covariance[2:])
    assert digest(side) != digest(Trajectories.from_array(states))
    one = Trajectories.from_array(states, covariance=np.eye(2))
    assert np.array_equal(one.covariance, np.tile([1, 0, 1], (5, 1)))


@pytest.mark.parametrize(
    ("matrices", "message"),
    [
        (np.eye(3), "does not fit states (1, 1, 2)"),
        (-np.eye(2), 'covariance of id "0", t 0: negative variance'),
        (np.full((2, 2), np.inf), 'covariance of id "0", t 0: not finite'),
    ],
)
def test_wrong_covariances_of_arrays(matrices: Array, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        Trajectories.from_array(np.zeros((1, 1, 2)), covariance=matrices)


def test_wrong_shape_of_covariances() -> None:
    side = Trajectories.from_array(np.zeros((1, 1, 2)))
    with pytest.raises(InputError, match=re.escape("use (R, d, d) or (R, d (d + 1) / 2)")):
        Trajectories(**{**vars(side), "covariance": np.zeros((1, 4))})


def test_of_class_and_inspection(write: Write, invoke: Invoke) -> None:
    path = write(
        "e.csv", "id,t,class,x,std_x\na,1,car,0,1\nb,1,van,5,2\nb,2,van,6,3\nc,2,car,9,4\n"
    )
    reading = read(path, ReadOptions(covariance=True, by_class=True))
    assert reading.of_class("van").covariance.tolist() == [[4], [9]]
    assert describe("", reading)["deviation"] == {"x": {"min": 1, "median": 2.5, "max": 4}}
    done = invoke("inspect", path, path, *GAUSSIAN)
    assert re.search(r"^  std +1 to 4, median 2.5 ", done.out, re.M)
    assert "  std  " not in invoke("inspect", path, path).out


# --- made-up scenes -------------------------------------------------------------------------------


@given(seed=SEEDS, noise=st.sampled_from([1e-9, 0.3, 2.0, 1e5]))
def test_made_up_covariances_are_such(seed: int, noise: float) -> None:
    scene = Scene(scenario="births", state="gaussian", targets=3, steps=20)
    made = Tracker(noise=noise, detection=0.9, fragmentation=0.1, latency=1, false_rate=0.2)
    truth, estimate = simulate(scene, made, np.random.default_rng(seed))
    assert truth.covariance is None
    values = np.linalg.eigvalsh(unpack(estimate.covariance.T)) / noise**2
    assert (values[:, 0] > 0.2).all()
    farthest = np.linalg.norm(estimate.state, axis=1).max() + 20 * noise  # where it was, at most
    assert (values[:, 1] < 1.01 * (0.5 + farthest / scene.area) ** 2).all()


def test_made_up_errors_have_their_covariances() -> None:
    """Whitened errors are N(0, I)."""
    rng = np.random.default_rng(6)
    place = rng.uniform(0, 100, (400, 50, 2))
    found = tracker.add_noise_of_a_radar(place, 3.0, 100.0, rng)
    lower = factor(np.ascontiguousarray(found[..., 2:].reshape(-1, 3).T))
    error = (found[..., :2] - place).reshape(-1, 2)
    white = np.linalg.solve(unpack(lower, lower=True), error[..., None])[..., 0]
    assert np.abs(white.mean(axis=0)).max() < 0.03
    assert np.abs(white.T @ white / len(white) - np.eye(2)).max() < 0.04


def test_gaussian_scenes_of_the_command_line(invoke: Invoke, tmp_path: Path) -> None:
    done = invoke("simulate", "here", "--state", "gaussian", "--noise", "2")
    command = done.out.splitlines()[-1].split()
    assert "--distance gaussian-wasserstein" in " ".join(command)
    again = invoke(*command[1:], "--format", "json")
    document = json.loads(again.out)
    assert document["localisation_spread"] > 0
    # Errors were drawn from the covariances: both parts have one expectation.
    assert 0.6 < document["localisation_mean"] / document["localisation_spread"] < 1.5
    refused = invoke("simulate", "there", "--state", "gaussian", "--format", "kitti")
    assert (refused.status, "files hold boxes" in refused.err) == (2, True)


def test_sample_data(invoke: Invoke) -> None:
    done = invoke(*ROOT, *GAUSSIAN, "-c", "15", "-g", "7", "--format", "json")
    document = json.loads(done.out)
    assert document["certified"]
    parts = document["localisation_mean"] + document["localisation_spread"]
    assert parts == pytest.approx(document["localisation"], rel=1e-12)
    referee = invoke(
        *ROOT, *GAUSSIAN, "-c", "15", "-g", "7", "--format", "json", "--solver", "exact"
    )
    assert document["total"] == pytest.approx(json.loads(referee.out)["total"], rel=1e-6)
