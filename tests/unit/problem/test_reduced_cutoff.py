"""Bounds at smaller cutoffs: true for any fraction, any prices and any assignment."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from claims import reference_of
from examples import seeds
from far_scenes import FarScene, far_scene

from tgospa_eval import ConfigError, evaluate
from tgospa_eval.problem.certificate import certify, forced_cost, reduce_cutoff
from tgospa_eval.problem.metric_family import Parameters, tgospa_problem
from tgospa_eval.problem.solution import Reduced, Solution
from tgospa_eval.problem.states import ONE, States, merge_runs
from tgospa_eval.solvers.far_cutoff import fitting_scales


def states_of(scene: FarScene) -> States:
    result = evaluate(
        scene.truth, scene.estimate, scene.c, scene.p, scene.gamma, distance=scene.distance
    )
    return result.proof.states


def proposal(states: States, rng: np.random.Generator, depth: int) -> Solution:
    """Prices of any size, and as many smaller cutoffs inside one another."""
    prices = rng.exponential(10.0 ** rng.uniform(-6, 0), len(states.columns.step))
    reduced: list[Reduced] = []
    if depth and len(states.problem.cost):
        scale = 2.0 ** -float(rng.integers(0, 30))
        blocks = rng.random(len(states.block_begin)) < 0.8
        inner = reduce_cutoff(states, blocks, scale)
        solution = proposal(inner, rng, depth - 1)
        reduced.append(Reduced(states=inner, blocks=blocks, scale=scale, solution=solution))
    return Solution(
        weights=np.zeros(len(states.begin)), prices=prices, status="", reduced=tuple(reduced)
    )


@pytest.mark.parametrize("index", seeds(14, 40))
def test_no_prices_at_no_cutoffs_prove_too_much(index: int) -> None:
    scene = far_scene("tiny", 7, index)
    states, optimum = states_of(scene), reference_of(scene)
    share = optimum.upper / optimum.costs.cutoff[0]  # in units of c^p
    rng = np.random.default_rng(index)
    best = 0.0
    for _ in range(20):
        bounds, _, _ = certify(states, proposal(states, rng, depth=2))
        assert Fraction(bounds.lower) <= share
        best = max(best, bounds.lower)
    assert best > 0 or share < 1e-6


def one_step(costs: list[list[float]], truths: int, estimates: int) -> States:
    """Truths and estimates at one step, with the distances of near pairs, c = 1."""
    pairs = [(i, j) for i, row in enumerate(costs) for j, d in enumerate(row) if d < 1]
    return merge_runs(
        tgospa_problem(
            parameters=Parameters(cutoff=1.0, order=1.0, switch_penalty=1.0),
            steps=1,
            truths=truths,
            estimates=estimates,
            truth_step=np.zeros(truths, np.int32),
            truth_track=np.arange(truths, dtype=np.int32),
            estimate_step=np.zeros(estimates, np.int32),
            estimate_track=np.arange(estimates, dtype=np.int32),
            truth_row=np.array([i for i, _ in pairs], np.int32),
            estimate_row=np.array([j for _, j in pairs], np.int32),
            distance=np.array([costs[i][j] for i, j in pairs]),
        )
    )


def test_what_no_assignment_can_reach() -> None:
    # Two truths near the first estimate alone, a third near both others: by Hall's theorem one of
    # the first two is left out, and one of the other estimates: 2 objects, a half each.
    near, far = 0.1, 2.0
    states = one_step([[near, far, far], [near, far, far], [far, near, near]], 3, 3)
    chosen = np.ones(len(states.block_begin), bool)
    assert len(chosen) == 2
    assert forced_cost(states, chosen).tolist() == [0.5, 0.5]
    # A path of pairs: the greedy choice of the middle one leaves two out, the best none.
    states = one_step([[near, 0.01], [far, near]], 2, 2)
    assert forced_cost(states, np.ones(1, bool)).tolist() == [0.0]


def test_scales_are_above_what_cannot_be_avoided() -> None:
    # cheapest pairs 2^-20 and 2^-30: sixteen times the larger one, and the next power of 2
    states = one_step([[2.0**-20, 2.0], [2.0**-30, 2.0**-30]], 2, 2)
    assert fitting_scales(states).tolist() == [2.0**-15]
    assert fitting_scales(one_step([[0.01, 0.9], [0.9, 0.01]], 2, 2)).tolist() == [1.0]


def test_a_smaller_cutoff_is_the_same_problem_in_other_units() -> None:
    scene = far_scene("small", 3, 5)
    states = states_of(scene)
    scale = 2.0**-4
    inner = reduce_cutoff(states, np.ones(len(states.block_begin), bool), scale)
    smaller = replace(scene, c=scene.c * scale ** (1 / scene.p))
    other = states_of(smaller).problem
    assert inner.problem.cost == pytest.approx(other.cost, rel=1e-12)
    assert inner.problem.switch_price == pytest.approx(other.switch_price, rel=1e-12)


def test_more_pairs_than_sums_of_integers_hold() -> None:
    # 27,000 truths near one estimate: so many full weights are more than 2^64, and looked feasible
    count = 27_000
    states = one_step([[0.1]] * count, count, 1)
    for full in (13_065, 25_932, count):
        weights = np.zeros(len(states.begin))
        weights[:full] = 1.0
        prices = np.zeros(len(states.columns.step))
        bounds, whole, _ = certify(states, Solution(weights=weights, prices=prices, status=""))
        assert sum(whole.tolist()) <= ONE
        assert bounds.upper >= 0.5 * (count + 1) - 0.9 - 1e-9


def test_prices_of_the_sides_may_differ() -> None:
    # one truth at 0.9 and three estimates at 0.1 each: assigned for 0.2, the others cost 0.2
    problem = one_step([[0.2, 0.2, 0.2]], 1, 3).problem
    problem = replace(problem, truth_price=np.array([0.9]), estimate_price=np.full(3, 0.1))
    states = merge_runs(problem)
    weights = np.array([1.0, 0.0, 0.0])
    prices = np.zeros(len(states.columns.step))
    bounds, _, _ = certify(states, Solution(weights=weights, prices=prices, status=""))
    assert problem.pair_price is None
    assert bounds.lower <= 0.4 <= bounds.upper
    assert bounds.upper - bounds.lower < 1e-12


def test_large_prices_that_nobody_contests_leave_no_rounding() -> None:
    # every price of 20,000 steps is 0.3, and sums of them are 6,000: errors of 1e-6 keep digits
    truth = np.zeros((20_000, 2, 1))
    truth[:, 1] = 0.5
    states = evaluate(truth, truth + 1e-6, 1.0, 2, 0.1).proof.states
    weights = (states.pair_truth == states.pair_estimate)[states.pair].astype(float)
    prices = np.full(len(states.columns.step), 0.3)
    bounds, _, _ = certify(states, Solution(weights=weights, prices=prices, status=""))
    assert bounds.relative_gap < 1e-9
    assert bounds.upper == pytest.approx(4e-8, rel=1e-9)


def test_far_coordinates_excuse_no_bracket() -> None:
    # one pair far away has coarse last places, the others decide the value: nothing is excused
    rng = np.random.default_rng(0)
    truth = rng.integers(0, 8, (10, 6, 1)) * 2.0**-30
    estimate = rng.integers(0, 8, (10, 6, 1)) * 2.0**-30
    truth[:, 0] = estimate[:, 0] = 2.0**27
    result = evaluate(truth, estimate, 10.0, 2, 1e-9, solver="sinkhorn")
    assert not result.within_rounding
    assert result.certified == (result.relative_gap <= 1e-9)
    assert evaluate(truth, estimate, 10.0, 2, 1e-9).certified


def test_a_value_made_of_powers_that_underflow_is_refused() -> None:
    truth, estimate = np.array([[[0.0], [1.0]]]), np.array([[[1e-3], [1.001]]])
    with pytest.raises(ConfigError, match="choose a smaller cutoff or a lower order"):
        evaluate(truth, estimate, 1e29, 10, 1.0)


def test_powers_that_underflow_beside_a_value_of_0_are_no_matter() -> None:
    # the sets are equal; the other pairs are 1e-40 apart, and (1e-40)^10 is no double
    positions = np.array([[[0.0], [1e-40], [3.0]]])
    result = evaluate(positions, positions, 10.0, 10, 1.0)
    assert result.total == result.lower_bound == result.upper_bound == 0.0
    assert result.certified
