"""Other members of the metric family: worked examples, and plain programmes with their own numbers.

Quasi-metric: values of the authors' MATLAB code (LPTrajQMetric) and by hand. Time-weighted: by
hand, and the scenario of the authors' Python file (c = 5, p = 1, gamma = 10, forgetting 0.995).
"""

import numpy as np
import pandas as pd
import pytest
from by_hand import N, tracks
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import tgospa_lp
from proven import proving
from strategies import ORDERS, SWITCH, pairs_of_sets, sets

from tgospa_eval import ConfigError, evaluate, sweep

X = tracks([0, 0, 0])
RHO = st.sampled_from([0.001, 0.2, 0.3, 0.5, 0.7, 0.95])

QUASI = [
    (tracks([1] * 5), tracks([2] * 4 + [N]), (5, 1, 1), 0.7, 5.5, 1.5, 0),
    (tracks([1] * 5), tracks([2] * 4 + [N]), (5, 1, 1), 0.3, 7.5, 3.5, 0),
    (tracks([0.5] * 5, [2, 2, N, 2, 2]), tracks([1.5] * 5, [0] * 5), (5, 1, 1), 0.7, 8, 0, 3.5),
    (tracks([0.5] * 5, [2, 2, N, 2, 2]), tracks([1.5] * 5, [0] * 5), (5, 1, 1), 0.3, 6, 0, 1.5),
    (X, tracks([1, 1, N]), (5, 2, 1), 0.3, 4.4158804, 17.5, 0),
    (tracks([1, 1, N]), X, (5, 2, 1), 0.3, 3.0822070, 0, 7.5),
    (tracks([0]), tracks([7]), (5, 2, 1), 0.3, 5, 17.5, 7.5),
    (tracks([0], [10], [20]), tracks([1]), (5, 2, 1), 0.3, 6, 35, 0),
    (tracks([0], [10], [20]), tracks([1]), (5, 2, 1), 0.7, 4, 15, 0),
]


@pytest.mark.parametrize(("x", "y", "numbers", "rho", "value", "missed", "false"), QUASI)
def test_quasi_metric(
    x: np.ndarray,
    y: np.ndarray,
    numbers: tuple[float, ...],
    rho: float,
    value: float,
    missed: float,
    false: float,
) -> None:
    result = proving(evaluate)(x, y, *numbers, rho=rho)
    assert result.tgospa == pytest.approx(value, abs=1e-7)
    assert (result.missed, result.false) == pytest.approx((missed, false))
    assert result.certified
    assert result.metric == "quasi-tgospa"
    assert result.parameters["rho"] == rho


@settings(max_examples=examples(20))
@given(sides=pairs_of_sets(), p=ORDERS, rho=RHO, false=st.sampled_from([0.5, 5, 50]))
def test_similarity(
    sides: tuple[np.ndarray, np.ndarray], p: float, rho: float, false: float
) -> None:
    """S = 2 / (1 + exp(d / beta)) of the value per step d, by a formula of its own."""
    result = evaluate(*sides, 2.0, p, 1.0, rho=rho)
    beta = 2.0 * (rho * false) ** (1 / p) / np.log((2 - 0.1) / 0.1)
    found = result.similarity(false)
    assert found.beta == pytest.approx(beta, rel=1e-12)
    expected = 2 / (1 + np.exp(min(result.normalised["tgospa"] / beta, 700)))
    assert found.score == pytest.approx(expected, rel=1e-9)
    assert 0 <= found.lower_bound <= found.score <= found.upper_bound <= 1
    assert found.upper_bound - found.lower_bound <= 1e-8
    assert evaluate(sides[0], sides[0], 2.0, p, 1.0, rho=rho).similarity(false).score == 1


def test_similarity_of_the_calibration() -> None:
    """The authors' numbers: c = 10, p = 2, 50 false targets score 0.1."""
    nothing, many = np.zeros((1, 0, 1)), np.arange(50.0).reshape(1, 50, 1)
    found = evaluate(nothing, many, 10, 2, 1).similarity(50)
    assert found.beta == pytest.approx(16.981164, abs=1e-6)
    assert found.score == pytest.approx(0.1, abs=1e-12)
    ten = evaluate(np.zeros((1, 1, 1)), np.full((1, 1, 1), 50.0), 10, 2, 1)  # d = 10
    assert ten.similarity(50).score == pytest.approx(0.71378, abs=1e-5)
    with pytest.raises(ConfigError, match="give the number of false targets"):
        ten.similarity()
    with pytest.raises(ConfigError, match="a score needs the number of false targets"):
        evaluate(many, many, 10, 2, 1, similarity=50).similarity(score=0.2)
    with pytest.raises(ConfigError, match="needs steps that all count the same"):
        evaluate(many, many, 10, 2, 1, step_weights=[1.0]).similarity(50)
    for wrong in ((0,), (np.inf,), (5, 1.0)):
        with pytest.raises(ConfigError, match="must be > 0"):
            ten.similarity(*wrong)


FORGETTING = (1 / 7, 2 / 7, 4 / 7)
EARLY = tracks([0, N, N], [N, 0, 0])
LATE = tracks([0, 0, N], [N, N, 0])
WEIGHTED = [
    (X, tracks([1, 1, N]), (5, 2, 1), (1, 2, 4), None, 7.2801099),
    (X, EARLY, (4, 1, 1), (1, 2, 4), None, 2),
    (X, LATE, (4, 1, 1), (1, 2, 4), None, 4),
    (X, EARLY, (4, 1, 1), FORGETTING, None, 2 / 7),
    (X, LATE, (4, 1, 1), FORGETTING, None, 4 / 7),
    (tracks([N, 7, 7]), np.zeros((3, 0, 1)), (2, 1, 1), (1, 10, 100), None, 110),
    (
        tracks([0] * 4),
        tracks([50, 0, N, N], [N, N, 0, 50]),
        (2, 1, 0.5),
        (1, 10, 100, 1000),
        (1, 1, 1, 1),
        2002.5,
    ),
    (X, tracks([1, 1, N]), (5, 2, 1), (1, 2, 0), None, 3**0.5),  # the last step does not count
]


@pytest.mark.parametrize(("x", "y", "numbers", "cost", "switch", "value"), WEIGHTED)
def test_time_weighted(
    x: np.ndarray,
    y: np.ndarray,
    numbers: tuple[float, ...],
    cost: tuple[float, ...],
    switch: tuple[float, ...] | None,
    value: float,
) -> None:
    weights = pd.DataFrame({"t": np.arange(len(cost)), "weight": cost})
    if switch is not None:
        weights["switch_weight"] = switch
    result = evaluate(x, y, *numbers, step_weights=weights)
    assert result.tgospa == pytest.approx(value, abs=1e-7)
    assert result.certified
    assert result.metric == "time-weighted-tgospa"


def test_distances_are_those_of_the_states_whatever_a_step_counts() -> None:
    series = pd.Series([100.0, 10.0, 1.0], index=[2, 1, 0])  # by its index, in any order
    assert evaluate(X, tracks([1, 2, 3]), 5, 2, 1, step_weights=series).total == 1 + 40 + 900
    result = evaluate(X, tracks([1, 2, 3]), 5, 2, 1, step_weights=[1.0, 10.0, 100.0])
    assert result.assignments.distance.tolist() == pytest.approx([1, 2, 3])
    assert result.assignments.cost.tolist() == pytest.approx([1, 40, 900])


@settings(max_examples=examples(30))
@given(sides=pairs_of_sets(), p=ORDERS, gamma=SWITCH, rho=RHO, data=st.data())
def test_against_programmes_of_the_definition(
    sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float, rho: float, data: st.DataObject
) -> None:
    steps = len(sides[0])
    each = st.lists(st.sampled_from([0.0, 0.1, 1.0, 3.0]), min_size=steps, max_size=steps)
    w1 = np.array(data.draw(each))
    w1[data.draw(st.integers(0, steps - 1))] = 1.0  # not all may be zero
    w2 = np.array(data.draw(each))
    result = evaluate(
        *sides,
        2.0,
        p,
        gamma,
        rho=rho,
        step_weights=pd.DataFrame({"t": np.arange(steps), "weight": w1, "switch_weight": w2}),
    )
    expected = tgospa_lp(*sides, 2.0, p, gamma, w1=w1, w2=w2[1:], rho=rho)
    assert result.certified
    assert result.total == pytest.approx(expected, rel=1e-7, abs=1e-7)
    parts = (result.localisation, result.missed, result.false, result.switch)
    assert sum(parts) == pytest.approx(result.total, rel=1e-12, abs=1e-12)
    referee = evaluate(*sides, 2.0, p, gamma, rho=rho, step_weights=w1, solver="exact")
    assert referee.total == pytest.approx(
        evaluate(*sides, 2.0, p, gamma, rho=rho, step_weights=w1).total, rel=1e-6, abs=1e-6
    )


@settings(max_examples=examples(20))
@given(sides=pairs_of_sets(), p=ORDERS, gamma=SWITCH, rho=RHO)
def test_one_solution_serves_every_rho(
    sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float, rho: float
) -> None:
    """d_rho^p = d^p + (1/2 - rho) c^p (N_X - N_Y), and exchanged sides exchange the prices."""
    plain, quasi = evaluate(*sides, 2.0, p, gamma), evaluate(*sides, 2.0, p, gamma, rho=rho)
    truths, estimates = plain.objects
    expected = plain.total + (0.5 - rho) * 2.0**p * (truths - estimates)
    assert quasi.total == pytest.approx(expected, rel=1e-9, abs=1e-9)
    exchanged = evaluate(*sides[::-1], 2.0, p, gamma, rho=1 - rho)
    assert exchanged.total == pytest.approx(quasi.total, rel=1e-9, abs=1e-9)
    swept = sweep(*sides, 2.0, p, gamma, rho=[rho, 0.5] if rho != 0.5 else [rho])
    assert {point.value: point.total for point in swept.points}[rho] == pytest.approx(
        quasi.total, rel=1e-9, abs=1e-9
    )


def test_a_sweep_at_cutoffs_far_above_the_errors() -> None:
    """Bounds at smaller cutoffs hold for one rho only."""
    rng = np.random.default_rng(5)
    truth = rng.uniform(0, 20, (1, 6, 2)) + np.cumsum(rng.normal(0, 0.5, (12, 6, 2)), axis=0)
    estimate = truth[:, ::-1] + rng.normal(0, 1e-3, truth.shape)
    estimate[3:6, 0] = np.nan
    swept = sweep(truth, estimate, 1e5, 2, 1, rho=[0.1, 0.5, 0.9])
    for point in swept.points:
        single = evaluate(truth, estimate, 1e5, 2, 1, rho=point.value)
        assert single.proof.reduced
        assert point.certified
        assert (point.total, point.lower_bound) == (single.total, single.lower_bound)


@pytest.mark.parametrize("rho", [0.2, 0.7])
@pytest.mark.parametrize("weights", [None, np.linspace(0.5, 2, 12)])
def test_cutoffs_far_above_the_errors(rho: float, weights: np.ndarray | None) -> None:
    rng = np.random.default_rng(5)
    truth = rng.uniform(0, 20, (1, 6, 2)) + np.cumsum(rng.normal(0, 0.5, (12, 6, 2)), axis=0)
    estimate = truth[:, ::-1] + rng.normal(0, 1e-3, truth.shape)
    for cutoff in (1e2, 1e5):
        result = evaluate(truth, estimate, cutoff, 2, 1, rho=rho, step_weights=weights)
        plain = evaluate(truth, estimate, 1.0, 2, 1, rho=rho, step_weights=weights)
        assert result.certified
        assert result.total == pytest.approx(plain.total, rel=1e-9)


def test_scenario_of_the_authors() -> None:
    """Two targets, 800 steps, errors of 3: names exchanged at 250, or at 650; one lost at 550."""
    steps, f = 800, 0.995
    weight = (1 - f) / (1 - f**steps) * f ** np.arange(steps - 1, -1, -1)
    truth = np.zeros((steps, 2, 1))
    truth[:, 1] = 1000.0
    estimates = [truth + 3.0 for _ in range(4)]
    for k, step in ((1, 250), (2, 650)):
        estimates[k][step - 1 :] = estimates[k][step - 1 :, ::-1].copy()
    estimates[3][549:, 1] += 500.0
    values = (6, 6.0064660886, 6.0480185846, 7.4580793624)
    means = (6, 6.025, 6.025, 6.6275)
    for estimate, value, mean in zip(estimates, values, means, strict=True):
        result = evaluate(truth, estimate, 5, 1, 10, step_weights=weight)
        assert result.tgospa == pytest.approx(value, abs=1e-9)
        plain = evaluate(truth, estimate, 5, 1, 10)
        assert plain.total / steps == pytest.approx(mean, abs=1e-12)
    parts = (result.localisation, result.missed, result.false, result.switch)
    assert parts == pytest.approx((3.8128809564, 1.8225992030, 1.8225992030, 0), abs=1e-9)


@settings(max_examples=examples(8))
@given(three=st.integers(1, 4).flatmap(lambda steps: st.tuples(*[sets(steps, 1)] * 3)), p=ORDERS,
       gamma=SWITCH, rho=RHO, data=st.data())  # fmt: skip
def test_axioms_with_weights_and_prices(
    three: tuple[np.ndarray, ...], p: float, gamma: float, rho: float, data: st.DataObject
) -> None:
    """Directed triangle; exchanged sides; reversed time; all weights times a."""
    x, y, z = three
    steps = len(x)
    each = st.lists(st.sampled_from([0.1, 1.0, 3.0]), min_size=steps, max_size=steps)
    w1, w2 = (np.array(data.draw(each)) for _ in range(2))

    def d(a: np.ndarray, b: np.ndarray, share: float = rho, w: tuple = (w1, w2)) -> float:
        table = pd.DataFrame({"t": np.arange(steps), "weight": w[0], "switch_weight": w[1]})
        result = evaluate(a, b, 2.0, p, gamma, rho=share, step_weights=table)
        assert result.certified
        return result.tgospa

    assert d(x, x) == 0.0
    value = d(x, y)
    assert value <= d(x, z) + d(z, y) + 1e-9
    assert d(y, x, 1 - rho) == pytest.approx(value, rel=1e-9, abs=1e-9)
    turned = w1[::-1], np.append(1.0, w2[1:][::-1])
    assert d(x[::-1], y[::-1], w=turned) == pytest.approx(value, rel=1e-9, abs=1e-9)
    assert d(x, y, w=(2.5 * w1, 2.5 * w2)) ** p == pytest.approx(2.5 * value**p, rel=1e-9, abs=1e-9)
    if rho == 0.5:
        ones = np.ones(steps)
        plain = evaluate(x, y, 2.0, p, gamma).tgospa
        assert d(x, y, w=(ones, ones)) == pytest.approx(plain, rel=1e-12, abs=1e-12)
