"""Pairs of an ignored truth whose distance is nominally the cutoff, decided exactly.

One such pair at each step, so that the table of the steps has the decision for each.
"""

import warnings
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

import tgospa_eval
from tgospa_eval import evaluate

Pair = tuple[list[float], list[float]]

TRIPLES = ((3, 4, 5), (5, 12, 13), (8, 15, 17), (20, 21, 29), (0, 1, 1))
BOX = ["left", "top", "width", "height"]
FEW, MANY = 300, 20_000


def on_a_circle(rng: np.random.Generator, cutoff: Fraction) -> list[Fraction]:
    a, b, c = (Fraction(side) for side in TRIPLES[rng.integers(len(TRIPLES))])
    legs = [a * cutoff / c * rng.choice([-1, 1]), b * cutoff / c * rng.choice([-1, 1])]
    return legs if rng.random() < 0.5 else legs[::-1]


def on_a_diamond(rng: np.random.Generator, cutoff: Fraction) -> list[Fraction]:
    share = Fraction(int(rng.integers(0, 11)), 10)
    return [share * cutoff * rng.choice([-1, 1]), (1 - share) * cutoff * rng.choice([-1, 1])]


def on_a_square(rng: np.random.Generator, cutoff: Fraction) -> list[Fraction]:
    return [cutoff * rng.choice([-1, 1]), Fraction(int(rng.integers(-9, 10)), 10) * cutoff]


def euclidean(x: list[Fraction], y: list[Fraction]) -> Fraction:
    return sum((a - b) ** 2 for a, b in zip(x, y, strict=True))


def manhattan(x: list[Fraction], y: list[Fraction]) -> Fraction:
    return sum(abs(a - b) for a, b in zip(x, y, strict=True))


def chebyshev(x: list[Fraction], y: list[Fraction]) -> Fraction:
    return max(abs(a - b) for a, b in zip(x, y, strict=True))


def iou(x: list[Fraction], y: list[Fraction]) -> Fraction:
    sides = (
        max(min(x[k] + x[k + 2], y[k] + y[k + 2]) - max(x[k], y[k]), Fraction(0)) for k in (0, 1)
    )
    shared = next(sides) * next(sides)
    union = x[2] * x[3] + y[2] * y[3] - shared
    return 1 - shared / union


POINTS: dict[str, tuple[Callable[..., list[Fraction]], Callable[..., Fraction]]] = {
    "euclidean": (on_a_circle, euclidean),
    "manhattan": (on_a_diamond, manhattan),
    "chebyshev": (on_a_square, chebyshev),
}


def points(rng: np.random.Generator, name: str, cutoff: str, size: int) -> list[Pair]:
    """As decimals would be read: both ends are rounded once."""
    pairs = []
    for _ in range(size):
        away = POINTS[name][0](rng, Fraction(cutoff))
        digits = int(rng.integers(0, 6))
        start = [Fraction(int(v), 10**digits) for v in rng.integers(-(10**6), 10**6, 2)]
        pairs.append(
            ([float(v) for v in start], [float(u + v) for u, v in zip(start, away, strict=True)])
        )
    return pairs


def boxes(rng: np.random.Generator, size: int) -> list[Pair]:
    """Of 10 by 10 tenths, moved to the right by tenths of their width."""
    pairs = []
    for _ in range(size):
        left, top = (Fraction(int(v), 10) for v in rng.integers(0, 2000, 2))
        width, height = (Fraction(int(v), 10) for v in rng.integers(1, 300, 2))
        shift = width * int(rng.integers(0, 12)) / 10
        one = [left, top, width, height]
        pairs.append(([float(v) for v in one], [float(v) for v in (left + shift, *one[1:])]))
    return pairs


def check(pairs: list[Pair], near: list[bool], columns: list[str], **options: object) -> int:
    """The table of the steps has a false state where the pair is not near; how many there are."""
    sides = [
        pd.DataFrame(np.array(states), columns=columns).assign(t=range(len(pairs)), id=7)
        for states in zip(*pairs, strict=True)
    ]
    sides[0]["ignored"] = 1
    order = float(options.setdefault("order", 2.0))
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        result = evaluate(*sides, switch_penalty=0.0, ignore="marked", **options)
    far = ~np.array(near)
    assert (result.per_step.absorbed.to_numpy() == near).all()
    exact = np.count_nonzero(far) * Fraction(options["cutoff"]) ** int(order) / 2
    total = (Fraction(bound) ** int(order) for bound in (result.lower_bound, result.upper_bound))
    assert next(total) <= exact <= next(total)
    assert result.certified
    assert any("at the cutoff within rounding" in str(warning.message) for warning in heard)
    return int(far.sum())


def rational(states: list[float]) -> list[Fraction]:
    return list(map(Fraction, states))


def check_points(name: str, cutoff: str, size: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = points(rng, name, cutoff, size)
    most = Fraction(float(cutoff)) ** (2 if name == "euclidean" else 1)
    near = [POINTS[name][1](rational(x), rational(y)) < most for x, y in pairs]
    far = check(pairs, near, ["x", "y"], cutoff=float(cutoff), distance=name)
    assert 0 < far < size  # both kinds are there


def check_boxes(cutoff: float, size: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = boxes(rng, size)
    near = [iou(rational(x), rational(y)) < Fraction(cutoff) for x, y in pairs]
    far = check(pairs, near, BOX, cutoff=cutoff, distance="iou", order=1.0)
    assert 0 < far < size


@pytest.mark.parametrize("name", POINTS)
@pytest.mark.parametrize("cutoff", ["1.3", "0.1", "6.5"])
def test_points_at_the_cutoff_are_decided_exactly(name: str, cutoff: str) -> None:
    check_points(name, cutoff, FEW, 5)


@pytest.mark.parametrize("cutoff", [2 / 3, 1.0, 0.75, 1 / 3])
def test_boxes_at_the_cutoff_are_decided_exactly(cutoff: float) -> None:
    check_boxes(cutoff, FEW, 6)


@pytest.mark.slow
def test_a_hundred_thousand_pairs_at_the_cutoff() -> None:
    for seed, name in enumerate([*POINTS] * 2):
        check_points(name, str(Fraction(13 + seed, 10) + 0.0), MANY, seed)
    check_boxes(1.0, MANY, 1)


def test_a_circle_and_scales_are_decided_exactly() -> None:
    rng = np.random.default_rng(9)
    size, scale, period = FEW, 0.3, 0.7
    x = rng.integers(0, 40, size) / 10
    y = (x + np.where(rng.random(size) < 0.5, 0.1, 0.6) + 0.7 * rng.integers(0, 3, size)).round(1)
    most = Fraction(0.1 * scale)
    near = []
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        size_of = abs(Fraction(a) - Fraction(b)) % Fraction(period)
        near.append(min(size_of, Fraction(period) - size_of) * Fraction(scale) < most)
    pairs = [([a], [b]) for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    options = {"periodic": f"x={period}", "scale": f"x={scale}"}
    far = check(pairs, near, ["x"], cutoff=0.1 * scale, **options)
    assert 0 < far < size


def test_the_bounds_are_those_of_the_proof_folder(tmp_path) -> None:
    """Distances without a closed form are written so that they stay on their side."""
    truth = pd.DataFrame({"id": 1, "t": [0], "x": [0.0], "y": [0.0], "ignored": [1]})
    estimate = pd.DataFrame({"id": 7, "t": [0], "x": [0.5], "y": [1.2]})
    with pytest.warns(tgospa_eval.TgospaWarning, match="1 pair of an ignored truth"):
        result = evaluate(truth, estimate, cutoff=1.3, switch_penalty=1.0, ignore="marked")
    assert result.upper_bound == 0.0
    assert [one["code"] for one in result.to_dict()["warnings"]].count("at-cutoff") == 1
    result.proof.save(str(tmp_path / "proof"))
    assert tgospa_eval.verify(str(tmp_path / "proof"))
    rng = np.random.default_rng(3)
    truth = pd.DataFrame({"id": 1, "t": range(200), "lat": 0.0, "lon": rng.random(200) / 1e3})
    estimate = truth.assign(lat=rng.random(200) / 1e3)
    options = {"switch_penalty": 1.0, "distance": "haversine", "ignore": "marked"}
    far = evaluate(truth, estimate, cutoff=500.0, switch_penalty=1.0, distance="haversine")
    last = sorted(far.assignments.distance)
    for cutoff in last[:: len(last) // 20]:
        with pytest.warns(tgospa_eval.TgospaWarning):
            result = evaluate(
                truth.assign(ignored=1), estimate, cutoff=np.nextafter(cutoff, 1e9), **options
            )
        result.proof.save(str(tmp_path / "proof"), force=True)
        assert tgospa_eval.verify(str(tmp_path / "proof"))


def test_larger_cutoffs_never_absorb_less() -> None:
    truth = pd.DataFrame({"id": 1, "t": [0], "x": [0.1], "ignored": [1]})
    estimate = pd.DataFrame({"id": 7, "t": [0], "x": [0.4]})
    cutoffs = [0.3]
    for _ in range(6):
        cutoffs = [np.nextafter(cutoffs[0], 0), *cutoffs, np.nextafter(cutoffs[-1], 1)]
    values = []
    options = {"order": 1, "switch_penalty": 0, "ignore": "marked"}
    for cutoff in cutoffs:
        with pytest.warns(tgospa_eval.TgospaWarning):
            result = evaluate(truth, estimate, cutoff=cutoff, **options)
        values.append(result.false > 0)
    assert [a for a, b in pairwise(values) if a != b] == [True]
    exact = Fraction(0.4) - Fraction(0.1)
    assert values == [Fraction(float(cutoff)) <= exact for cutoff in cutoffs]
