"""States that exist with probabilities: worked examples, plain programmes, what a metric must do.

Values of one step were computed by the authors' code of P-GOSPA and by hand, those of trajectories
by hand: only the abstract of their metric was at hand, and docs/theory/family.md says what is
inferred.
"""

from dataclasses import replace

import numpy as np
import pytest
from by_hand import N, tracks
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import dense_costs, programme
from strategies import ORDERS, SWITCH, pairs_of_sets, sets

from tgospa_eval import ConfigError, InputError, Result, Trajectories, evaluate, sweep

C = 2.0
LIKELY = st.sampled_from([0.0, 0.25, 0.6, 0.9, 1.0])


def side(states: np.ndarray, existence: object = 1.0, variance: float = 0.0) -> Trajectories:
    """Tracks (T, k, d) with probabilities that broadcast to (T, k)."""
    found = Trajectories.from_array(
        states, covariance=variance * np.eye(states.shape[2]) if variance else None
    )
    likely = np.broadcast_to(np.asarray(existence, float), states.shape[:2])
    return replace(found, attributes={"existence": likely[found.step, found.track]})


def parts(result: Result) -> list[float]:
    mismatch = result.existence_mismatch
    assert mismatch is not None
    assert result.expected_localisation is not None
    assert result.expected_localisation + mismatch == pytest.approx(result.localisation, abs=1e-12)
    return [result.expected_localisation, mismatch, result.missed, result.false, result.switch]


HERE = tracks([0])
STAYS = tracks([0, 0, 0])
EXAMPLES = [
    (side(HERE), side(HERE, 0.9), (10, 2, 1), 5**0.5, [0, 5, 0, 0, 0]),
    (side(HERE), side(tracks([3]), 0.9, 4.0), (10, 2, 1), 4.0865633, [11.7, 5, 0, 0, 0]),
    (side(HERE), side(tracks([3]), 0.6), (4, 1, 1), 2.6, [1.8, 0.8, 0, 0, 0]),
    (side(HERE), side(tracks([30]), 0.6), (4, 1, 1), 3.2, [0, 0, 2, 1.2, 0]),
    (side(HERE), side(tracks([0], [2]), [0.5, 0.9]), (4, 1, 1), 2.8, [0, 1, 0, 1.8, 0]),
    (side(HERE, 0.5), side(tracks([1]), 0.8), (4, 1, 1), 1.1, [0.5, 0.6, 0, 0, 0]),
    (side(STAYS), side(STAYS, [[0.5], [0.8], [1]]), (4, 1, 1), 1.4, [0, 1.4, 0, 0, 0]),
    (side(STAYS), side(STAYS + 1, [[0.5], [0.8], [1]]), (4, 1, 1), 3.7, [2.3, 1.4, 0, 0, 0]),
    (
        side(STAYS),
        side(tracks([0, N, N], [N, 0, 0]), 0.9),
        (4, 1, 0.5),
        1.1,
        [0, 0.6, 0, 0, 0.5],
    ),
    (side(STAYS), side(tracks([0, N, N], [N, 0, 0]), 0.9), (4, 1, 5), 4.2, [0, 0.4, 2, 1.8, 0]),
]


@pytest.mark.parametrize(("x", "y", "numbers", "value", "expected"), EXAMPLES)
def test_worked_examples(
    x: Trajectories,
    y: Trajectories,
    numbers: tuple[float, ...],
    value: float,
    expected: list[float],
) -> None:
    spread = "gaussian-wasserstein" if y.covariance is not None else "euclidean"
    result = evaluate(x, y, *numbers, distance=spread, existence="use")
    assert result.tgospa == pytest.approx(value, abs=1e-7)
    assert parts(result) == pytest.approx(expected, abs=1e-12)
    assert result.certified
    assert result.metric == "probabilistic-tgospa"
    assert result.parameters["existence"] == "use"
    if spread != "euclidean":
        assert [result.localisation_mean, result.localisation_spread] == pytest.approx([8.1, 3.6])


@st.composite
def likely_sides(draw: st.DrawFn, states: tuple[np.ndarray, ...]) -> list[np.ndarray]:
    found = []
    for each in states:
        steps, count = each.shape[:2]
        chosen = draw(st.lists(LIKELY, min_size=steps * count, max_size=steps * count))
        found.append(np.array(chosen).reshape(steps, count))
    return found


def costs_of(x: np.ndarray, y: np.ndarray, r: np.ndarray, s: np.ndarray, p: float) -> np.ndarray:
    """D(k) of the definition with its dummy row and column, in units of c^p."""
    r, s = (np.where(np.isnan(own).any(axis=2), 0, q) for own, q in ((x, r), (y, s)))
    costs = np.zeros((len(x), r.shape[1] + 1, s.shape[1] + 1))
    first, second = r[:, :, None], s[:, None, :]
    base = dense_costs(np.nan_to_num(x), np.nan_to_num(y), C, p)[:, :-1, :-1]
    costs[:, :-1, :-1] = np.minimum(first, second) * base + np.abs(first - second) / 2
    costs[:, :-1, -1], costs[:, -1, :-1] = r / 2, s / 2
    return costs


@settings(max_examples=examples(8))
@given(sides=pairs_of_sets(), p=ORDERS, gamma=SWITCH, weighted=st.booleans(), data=st.data())
def test_against_programmes_of_the_definition(
    sides: tuple[np.ndarray, np.ndarray],
    p: float,
    gamma: float,
    weighted: bool,
    data: st.DataObject,
) -> None:
    likely = data.draw(likely_sides(sides))
    steps = len(sides[0])
    weights = np.array([0.5, 1.0, 3.0, 0.1, 2.0, 1.0, 1.0, 1.0])[:steps] if weighted else None
    given_sides = [side(x, q) for x, q in zip(sides, likely, strict=True)]
    result = evaluate(
        *given_sides, C, p, gamma, existence="use", step_weights=weights, curve=True,
        window=2, slices="existence=0:0.5:1",
    )  # fmt: skip
    costs = costs_of(*sides, *likely, p)
    expected = programme(costs, C, p, gamma, weights, None if weights is None else weights[1:])
    assert result.certified
    assert result.total == pytest.approx(expected, rel=1e-7, abs=1e-7)
    assert sum(parts(result)) == pytest.approx(result.total, rel=1e-12, abs=1e-12)
    assert sum(result.per_step.total) == pytest.approx(result.total, rel=1e-12, abs=1e-12)
    (slicing,) = result.slicings
    assert sum(one.total for one in slicing.slices) == pytest.approx(
        result.total, rel=1e-12, abs=1e-12
    )
    half = steps // 2 + 1
    before = programme(
        costs[:half], C, p, gamma, *(None if weights is None else w for w in (weights, 0))
    ) if weights is None else None  # fmt: skip
    if before is not None:
        at = result.curve.iloc[half - 1]
        assert at.tgospa**p * at.steps == pytest.approx(before, rel=1e-6, abs=1e-6)


@settings(max_examples=examples(10))
@given(sides=pairs_of_sets(), p=ORDERS, gamma=SWITCH, share=st.sampled_from([0.3, 0.8, 1.0]))
def test_reductions(
    sides: tuple[np.ndarray, np.ndarray], p: float, gamma: float, share: float
) -> None:
    """All certain: the plain metric, bit by bit. All r = s = a: a times that of gamma / a^(1/p)."""
    alike = [side(x, share) for x in sides]
    found = evaluate(*alike, C, p, gamma, existence="use")
    plain = evaluate(*sides, C, p, gamma / share ** (1 / p))
    assert found.total == pytest.approx(share * plain.total, rel=1e-9, abs=1e-9)
    assert found.existence_mismatch == 0
    if share == 1.0:
        numbers = ("total", "tgospa", "lower_bound", "upper_bound", "missed", "false", "switch")
        assert all(getattr(found, name) == getattr(plain, name) for name in numbers)
        assert np.array_equal(found.proof.weights, plain.proof.weights)
        assert np.array_equal(found.proof.prices, plain.proof.prices)


@settings(max_examples=examples(10))
@given(three=st.integers(1, 4).flatmap(lambda steps: st.tuples(*[sets(steps, 1)] * 3)), p=ORDERS,
       gamma=st.sampled_from([0.05, 0.5, 3.0]), data=st.data())  # fmt: skip
def test_metric(three: tuple[np.ndarray, ...], p: float, gamma: float, data: st.DataObject) -> None:
    likely = data.draw(likely_sides(three))
    x, y, z = (side(states, q) for states, q in zip(three, likely, strict=True))

    def d(a: Trajectories, b: Trajectories) -> float:
        return evaluate(a, b, C, p, gamma, existence="use").tgospa

    assert d(x, x) == 0.0
    assert d(x, y) == pytest.approx(d(y, x), rel=1e-9, abs=1e-9)
    assert d(x, y) <= d(x, z) + d(z, y) + 1e-9
    # What exists with probability 0 is not there.
    rows = np.flatnonzero(x.attributes["existence"] > 0)
    assert d(x, x.chosen(rows, x.step[rows], x.times)) == 0.0


def crowd(seed: int = 3) -> tuple[Trajectories, Trajectories, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, 12, (1, 5, 2)) + np.cumsum(rng.normal(0, 0.4, (14, 5, 2)), axis=0)
    y = x[:, ::-1] + rng.normal(0, 0.4, x.shape)
    y[4:6, 0] = y[9:, 2] = np.nan
    s = rng.uniform(0.2, 1, y.shape[:2])
    return side(x), side(y, s), y


def test_distances_of_pairs_are_those_of_the_states() -> None:
    x, y, _ = crowd()
    result = evaluate(x, y, 4.0, 2, 1.0, existence="use")
    table = result.assignments
    assert len(table) > 40
    for row in table.itertuples():
        k = int(row.t)
        a = x.dense()[k, int(row.truth)]
        b = y.dense()[k, int(row.estimate)]
        assert row.distance == pytest.approx(np.linalg.norm(a - b), rel=1e-9)


def test_repairs_and_slopes_are_those_of_the_metric() -> None:
    """Each repair saves what a full evaluation finds; states that are added have probabilities."""
    x, y, states = crowd()
    settings_ = {"cutoff": 4.0, "order": 2, "switch_penalty": 1.0, "existence": "use"}
    before = evaluate(x, y, **settings_)
    found = before.explain(12)
    assert {"fill", "extend"} <= {repair.kind for repair in found.repairs}
    for rank, repair in enumerate(found.repairs, 1):
        after = evaluate(x, found.repaired(rank), **settings_)
        assert after.total == pytest.approx(repair.total, rel=1e-9)
        saved, slack = before.total - after.total, 1e-9 * before.total
        assert repair.saving_lower - slack <= saved <= repair.saving_upper + slack
    slope = before.gradient()
    size = 1e-6
    for k in (0, 7, 20):
        moved = states.copy()
        moved[y.step[k], y.track[k], 0] += size
        other = replace(y, state=Trajectories.from_array(moved).state)
        change = (evaluate(x, other, **settings_).total - before.total) / size
        assert slope.total[k, 0] == pytest.approx(change, abs=1e-4)
    wider = evaluate(x, y, **{**settings_, "cutoff": 4.0 + size})
    assert slope.cutoff == pytest.approx((wider.total - before.total) / size, rel=1e-4)


def test_sweeps_solve_the_same_problems() -> None:
    x, y, _ = crowd()
    referee = evaluate(x, y, 4.0, 2, 1.0, existence="use", solver="exact")
    assert referee.total == pytest.approx(
        evaluate(x, y, 4.0, 2, 1.0, existence="use").total, rel=1e-6
    )
    for name, values in (("cutoff", [2.0, 4.0]), ("switch_penalty", [0.5, 2.0]), ("order", [1, 2])):
        own = {"cutoff": 4.0, "order": 2, "switch_penalty": 1.0}
        swept = sweep(x, y, **{**own, name: values}, existence="use")
        for point in swept.points:
            single = evaluate(x, y, **{**own, name: point.value}, existence="use")
            assert point.total == pytest.approx(single.total, rel=1e-9)
    with pytest.raises(ConfigError, match="existence"):
        sweep(x, y, 4.0, 2, 1.0, rho=[0.2, 0.8], existence="use")


def test_wrong_probabilities() -> None:
    wrong = {1.5: "at t = 0 is 1.5 .and 2 more.; must be a number from 0", N: "is blank", -1: "-1"}
    for value, words in wrong.items():
        with pytest.raises(InputError, match=words):
            evaluate(side(STAYS), side(STAYS, value), existence="use")
    named = side(STAYS)
    texts = replace(named, attributes={"existence": np.array(["likely", "0.5", "1"], object)})
    with pytest.raises(InputError, match='column "existence": id "0" at t = 0 is "likely"; must'):
        evaluate(named, texts, existence="use")
    with pytest.raises(ConfigError, match="neither truth nor estimate has a column existence"):
        evaluate(STAYS, STAYS, existence="use")
    with pytest.raises(ConfigError, match="no proof is known that the result is a metric"):
        evaluate(named, named, existence="use", rho=0.3)
    with pytest.raises(ConfigError, match="must be one of ignore, use"):
        evaluate(named, named, existence="yes")
    with pytest.raises(ConfigError, match="cannot hold probabilities"):
        evaluate(named, side(STAYS, 0.5), existence="use").proof.save("nowhere")
