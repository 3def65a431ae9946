"""What a metric must do, on random instances, for p = 1, 1.5, 2, 3."""

import numpy as np
import pytest
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import gospa, static_assignment
from strategies import ORDERS, SWITCH, pairs_of_sets, sets

from tgospa_eval import evaluate

pytestmark = pytest.mark.usefixtures("proven")  # every value has a proof

C = 2.0
GAMMA = st.sampled_from([0.05, 0.5, 1.0, 3.0])


def d(x: np.ndarray, y: np.ndarray, p: float, gamma: float, c: float = C) -> float:
    result = evaluate(x, y, c, p, gamma)
    assert result.certified
    return result.tgospa


def close(value: float) -> object:
    return pytest.approx(value, rel=1e-9, abs=1e-9)


@st.composite
def triples(draw: st.DrawFn) -> tuple[np.ndarray, ...]:
    steps = draw(st.integers(1, 4))
    dimension = draw(st.integers(1, 2))
    return tuple(draw(sets(steps, dimension)) for _ in range(3))


@settings(max_examples=examples(20))
@given(three=triples(), p=ORDERS, gamma=GAMMA)
def test_metric(three: tuple[np.ndarray, ...], p: float, gamma: float) -> None:
    x, y, z = three
    assert d(x, x, p, gamma) == 0.0
    assert d(x, y, p, gamma) == close(d(y, x, p, gamma))
    assert d(x, y, p, gamma) <= d(x, z, p, gamma) + d(z, y, p, gamma) + 1e-9


@settings(max_examples=examples(15))
@given(sides=pairs_of_sets(), p=ORDERS)
def test_between_gospa_and_the_static_assignment(
    sides: tuple[np.ndarray, np.ndarray], p: float
) -> None:
    free = d(*sides, p, 0.0) ** p
    assert free == close(gospa(*sides, C, p))
    assert d(*sides, p, 1e-7) ** p == pytest.approx(free, rel=1e-5, abs=1e-5)
    static = static_assignment(*sides, C, p)
    steps = len(sides[0])
    held = C * (2.0 * max(steps - 1, 1)) ** (1 / p)
    assert d(*sides, p, held) ** p == close(static)
    between = d(*sides, p, 0.7) ** p
    assert free - 1e-9 <= between <= static + 1e-9
    counts = [np.count_nonzero(~np.isnan(side).any(axis=2), axis=1) for side in sides]
    assert between >= 0.5 * C**p * np.abs(counts[0] - counts[1]).sum() - 1e-9


@settings(max_examples=examples(15))
@given(sides=pairs_of_sets(), p=ORDERS, data=st.data())
def test_monotone_and_concave(
    sides: tuple[np.ndarray, np.ndarray], p: float, data: st.DataObject
) -> None:
    low, high = sorted(data.draw(st.tuples(SWITCH, SWITCH)))
    a, b = d(*sides, p, low) ** p, d(*sides, p, high) ** p
    assert a <= b + 1e-9
    middle = (0.5 * (low**p + high**p)) ** (1 / p)
    assert d(*sides, p, middle) ** p >= 0.5 * (a + b) - 1e-8 * max(b, 1.0)
    assert d(*sides, p, 1.0, c=1.0) <= d(*sides, p, 1.0, c=2.5) + 1e-9


@settings(max_examples=examples(15))
@given(sides=pairs_of_sets(), p=ORDERS, gamma=GAMMA, seed=st.integers(0, 99))
def test_symmetries(
    sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float, seed: int
) -> None:
    x, y = sides
    value = d(x, y, p, gamma)
    rng = np.random.default_rng(seed)
    assert d(x + 3.0, y + 3.0, p, gamma) == close(value)
    assert d(
        x[:, rng.permutation(x.shape[1])], y[:, rng.permutation(y.shape[1])], p, gamma
    ) == close(value)
    assert d(x[::-1], y[::-1], p, gamma) == close(value)
    empty = rng.integers(0, len(x) + 1)
    assert d(
        np.insert(x, empty, np.nan, axis=0), np.insert(y, empty, np.nan, axis=0), p, gamma
    ) == (close(value))
    far = 1000.0
    both = d(np.hstack((x, x + far)), np.hstack((y, y + far)), p, gamma)
    assert both**p == close(2 * value**p)


@settings(max_examples=examples(20))
@given(
    sides=pairs_of_sets(),
    p=ORDERS,
    gamma=GAMMA,
    unit=st.sampled_from([1e-6, 1e-3, 111.0, 1e8]),
)
def test_units(sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float, unit: float) -> None:
    """Degrees, millimetres or anything else: the value scales with the unit."""
    x, y = sides
    value = d(x, y, p, gamma)
    assert d(x * unit, y * unit, p, gamma * unit, c=C * unit) == pytest.approx(
        value * unit, rel=1e-9, abs=1e-9 * unit
    )


@settings(max_examples=examples(15))
@given(sides=pairs_of_sets(), p=ORDERS, gamma=GAMMA)
def test_huge_coordinates(sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float) -> None:
    x, y = (np.round(side * 16) / 16 for side in sides)  # exact after the shift
    assert d(x + 1e8, y + 1e8, p, gamma) == close(d(x, y, p, gamma))


@settings(max_examples=examples(15))
@given(sides=pairs_of_sets(most=1), p=ORDERS, gamma=GAMMA)
def test_single_pair(sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float) -> None:
    """One truth, one estimate: a sum over the steps, whatever gamma is."""
    x, y = sides
    if x.shape[1] and y.shape[1]:
        both = np.minimum(np.linalg.norm(x - y, axis=2), C)[:, 0] ** p
        one = np.isnan(x).any(axis=2) != np.isnan(y).any(axis=2)
        total = np.nansum(both) + 0.5 * C**p * one.sum()
    else:
        exist = sum(np.count_nonzero(~np.isnan(side).any(axis=2)) for side in sides)
        total = 0.5 * C**p * exist
    assert d(x, y, p, gamma) ** p == close(total)


@settings(max_examples=examples(20))
@given(x=sets(5, 2), p=ORDERS, gamma=GAMMA, error=st.sampled_from([1e-7, 1e-5]))
def test_nearly_perfect_estimates_keep_their_digits(
    x: np.ndarray, p: float, gamma: float, error: float
) -> None:
    """Errors of 1e-7 c are costs of 1e-14 beside gains of 1, and must not drown in them."""
    exist = np.count_nonzero(~np.isnan(x).any(axis=2))
    x = x + 10 * np.arange(x.shape[1])[:, None]  # far apart, so that the assignment is clear
    y = x + np.array([error * C, 0.0])
    moved = np.nansum((y - x)[..., 0] ** p)
    result = evaluate(x, y, C, p, gamma)
    assert result.total == pytest.approx(moved, rel=1e-9)
    assert result.counts == {"missed": 0.0, "false": 0.0, "switch": 0.0}
    assert result.certified
    assert result.total <= exist * (1.01 * error * C) ** p


def test_nearly_perfect_estimates_of_long_scenes_keep_their_digits() -> None:
    """Sums over many steps must not lose one miss and errors of 1e-6."""
    steps, m = 1_000, 3
    truth = np.zeros((steps, m, 2))
    truth[..., 0] = 4.0 * np.arange(m)  # in a row, all nearer than the cutoff
    estimate = truth + np.array([1e-6, 0.0])
    estimate[steps // 2, 0] = np.nan
    result = evaluate(truth, estimate, 5.0, 2, 2.0)
    assert result.certified
    assert result.total == pytest.approx(12.5 + (m * steps - 1) * 1e-12, rel=1e-10)


@pytest.mark.parametrize("solver", ["certified", "exact"])
@settings(max_examples=examples(20))
@given(
    seed=st.integers(0, 10_000),
    p=ORDERS,
    steps=st.integers(1, 12),
    apart=st.sampled_from([0.0, 1e-8, 1e-6]),
)
def test_nearly_perfect_estimates_of_coincident_truths(
    solver: str, seed: int, p: float, steps: int, apart: float
) -> None:
    """A convoy: which estimate belongs to which truth shows in costs of 1e-14 only.

    Gains 1 - 1e-14 and 1 - 2e-14 are the same to a solver; the total must be the best held
    assignment all the same, which here is one of two.
    """
    rng = np.random.default_rng(seed)
    first = rng.uniform(0, 50, (steps, 1, 2))
    x = np.concatenate((first, first + apart * C), axis=1)
    y = x + rng.normal(0, 1e-7 * C, x.shape)
    if rng.random() < 0.5:
        y = y[:, ::-1]
    distance = np.linalg.norm(x[:, :, None] - y[:, None], axis=3) ** p
    cost = distance.sum(axis=0)
    best = min(cost[0, 0] + cost[1, 1], cost[0, 1] + cost[1, 0])
    result = evaluate(x, y, C, p, 1.0, solver=solver)
    assert result.total == pytest.approx(best, rel=1e-9)
    assert result.certified


def test_certificate_keeps_its_digits_over_many_steps() -> None:
    """Sums of gains near 1 over 1,000 steps are exact to 1e-12 only; the total here is 1e-9."""
    rng = np.random.default_rng(1)
    x = rng.uniform(0, 50, (1000, 3, 2)) + 100 * np.arange(3)[:, None]
    x[:, 2] = x[:, 1] + 1.0  # a second candidate, so that there is something to prove
    y = x + rng.normal(0, 1e-7 * C, x.shape)
    result = evaluate(x, y, C, 2, 1.0)
    assert result.relative_gap < 1e-9
