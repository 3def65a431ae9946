"""The certificate against its own definition in rational numbers, and its exact sums."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from examples import seeds
from strategies import scene

from tgospa_eval import evaluate
from tgospa_eval.problem import certificate
from tgospa_eval.problem import states as states_module
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.paths import best_values
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import ONE, Slots, States, merge_runs
from tgospa_eval.solvers.trivial import best_paths, paths


def instance(seed: int) -> States:
    """Groups far apart, each in its own window: crowds, lone pairs, one row or one column."""
    rng = np.random.default_rng(seed)
    steps = int(rng.choice([1, 2, 7, 15]))
    sides: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for group, (m, n) in enumerate(rng.choice([1, 2, 4], (3, 2)).tolist()):
        noise = rng.choice([1e-7, 0.5, 1.0])
        pair = scene(seed + group, m, n, steps, side=rng.choice([3.0, 8.0]), noise=noise)
        begin, end = np.sort(rng.integers(0, steps + 1, 2))
        for side, array in zip(sides, pair, strict=True):
            array[:begin] = np.nan
            array[end:] = np.nan
            side.append(array + 1000.0 * group)
    truth, estimate = (np.concatenate(side, axis=1) for side in sides)
    gamma = float(rng.choice([0.0, 0.5, 2.0, 1000.0]))
    problem = evaluate(truth, estimate, 2.0, float(rng.choice([1, 2])), gamma).proof.states.problem
    if seed % 3 == 1 and steps > 1:
        problem = replace(problem, switch_price=rng.exponential(0.3, steps - 1))
    if seed % 3 == 2:
        problem = replace(
            problem,
            truth_price=problem.truth_price * rng.uniform(1, 2, len(problem.truth_price)),
            estimate_price=problem.estimate_price * rng.uniform(1, 2, len(problem.estimate_price)),
        )
    return merge_runs(problem)


def solutions(states: States, seed: int) -> list[Solution]:
    rng = np.random.default_rng(seed)
    size, slots = len(states.begin), len(states.columns.step)
    prices = np.where(rng.random(slots) < 0.4, rng.exponential(0.3, slots), 0.0)
    weights = best_paths(states, prices)
    return [
        Solution(weights=w, prices=v, status="")
        for w, v in (
            (weights, prices),
            (weights, np.zeros(slots)),
            (rng.random(size), prices),
            (np.where(rng.random(size) < 0.2, np.nan, 2.0 * weights), -prices),
        )
    ]


def fractions(values: np.ndarray) -> list[Fraction]:
    return [Fraction(value) for value in values.tolist()]


def exact_totals(slots: Slots, price: list[Fraction]) -> list[Fraction]:
    return [
        sum(price[a:b], Fraction(0))
        for a, b in zip(slots.begin.tolist(), slots.end.tolist(), strict=True)
    ]


def exact_bests(states: States, value: list[Fraction]) -> list[Fraction]:
    """Best path of each node by comparing every state with all that end before it."""
    switch_price = fractions(states.problem.switch_price_at)
    row = states.pair_row[states.pair].tolist()
    end, begin = states.end.tolist(), states.begin.tolist()
    reached: dict[int, Fraction] = {}
    for s in sorted(range(len(row)), key=begin.__getitem__):
        if s in states.pair_first[:-1]:
            reached[s] = value[s]
            continue
        unassigned_value = max(
            (
                reached[r] - switch_price[end[r] + 1]
                for r in reached
                if row[r] == row[s] and end[r] < begin[s]
            ),
            default=Fraction(0),
        )
        reached[s] = value[s] + max(
            reached[s - 1], max(unassigned_value, Fraction(0)) - switch_price[begin[s]]
        )
    best = [Fraction(0)] * states.nodes
    last = set((states.pair_first[1:] - 1).tolist())
    for s, total in reached.items():
        left = total if s in last else total - switch_price[end[s] + 1]
        best[row[s]] = max(best[row[s]], left)
    return best


def exact_bounds(
    states: States, whole: np.ndarray, prices: np.ndarray
) -> tuple[Fraction, Fraction]:
    """Lower bound as docs/theory defines it, without offsets, and upper bound."""
    problem = states.problem
    weights = [Fraction(w, ONE) for w in whole.tolist()]
    price, switch_price = fractions(prices), fractions(problem.switch_price_at)
    free = [fractions(problem.truth_price), fractions(problem.estimate_price)]
    upper = sum(free[0], Fraction(0)) + sum(free[1], Fraction(0))
    value = [-total for total in exact_totals(states.columns, price)]
    opens = set(states.pair_first[:-1].tolist())
    for s, entry in enumerate(states.entry.tolist()):
        if entry >= 0:
            a = free[0][problem.truth_row[entry]] + free[1][problem.estimate_row[entry]]
            gain = a - Fraction(float(problem.cost[entry]))
            value[s] += gain
            upper -= gain * weights[s]
        if s not in opens:
            upper += switch_price[states.begin[s]] * abs(weights[s] - weights[s - 1])
    # Each block by itself: no part of the cost is less than 0.
    blocks = len(states.block_begin)
    lower = [Fraction(0)] * (blocks + 1)
    for side, track, pairs in (
        (free[0], problem.truth_track, states.pair_truth),
        (free[1], problem.estimate_track, states.pair_estimate),
    ):
        home = dict(zip(pairs.tolist(), states.pair_block.tolist(), strict=True))
        for cost, number in zip(side, track.tolist(), strict=True):
            lower[home.get(number, blocks)] += cost
    for best, block in zip(exact_bests(states, value), states.node_block.tolist(), strict=True):
        lower[block] -= best
    node = states.columns.node.tolist()
    for paid, number in zip(price, node, strict=True):
        lower[states.node_block[number]] -= paid
    return sum((max(part, Fraction(0)) for part in lower), Fraction(0)), upper


@pytest.mark.parametrize("seed", seeds(14, 40))
def test_bounds_are_those_of_the_definition(seed: int) -> None:
    states = instance(seed)
    for solution in solutions(states, seed):
        bounds, whole, _ = certify(states, solution)
        lower, upper = exact_bounds(states, whole, np.maximum(solution.prices, 0.0))
        rounding = 1e-14 * (states.problem.truth_price.sum() + states.problem.estimate_price.sum())
        assert upper <= Fraction(bounds.upper) <= upper * (1 + Fraction(1e-13))
        assert lower - Fraction(rounding) <= Fraction(bounds.lower) <= lower


@pytest.mark.parametrize("seed", seeds(5, 12))
def test_parts_change_nothing(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    states = instance(seed)
    for solution in solutions(states, seed):
        whole, weights, split = certify(states, solution)
        with monkeypatch.context() as patch:
            for module in (states_module, certificate):
                patch.setattr(module, "PART", 16)
            bounds, again, steps = certify(states, solution)
        assert np.array_equal(weights, again)
        assert bounds.upper == pytest.approx(whole.upper, rel=1e-14)
        assert bounds.lower == pytest.approx(whole.lower, rel=1e-14, abs=1e-13)
        assert steps.localisation == pytest.approx(split.localisation, rel=1e-14)


@pytest.mark.parametrize("seed", seeds(5, 12))
def test_a_solution_that_is_used_up_proves_the_same(seed: int) -> None:
    states = instance(seed)
    for solution in solutions(states, seed):
        kept = solution.weights.copy(), solution.prices.copy()
        bounds, weights, _ = certify(states, solution)
        assert np.array_equal(solution.weights, kept[0], equal_nan=True)
        assert np.array_equal(solution.prices, kept[1], equal_nan=True)
        used, again, _ = certify(states, solution, consume=True)
        assert bounds == used
        assert np.array_equal(weights, again)
        assert np.shares_memory(again, solution.weights)
        assert np.array_equal(solution.prices, kept[1], equal_nan=True)


@pytest.mark.parametrize("seed", seeds(5, 12))
def test_a_best_path_is_worth_the_best_value(seed: int) -> None:
    states = instance(seed)
    rng = np.random.default_rng(seed)
    value = rng.normal(0.1, 0.5, len(states.begin))
    weights = paths(states, value)
    begin, row = states.begin, states.pair_row[states.pair]
    change = np.diff(weights, prepend=0.0)
    change[states.pair_first[:-1]] = 0.0
    own = weights * value - states.problem.switch_price_at[begin] * np.abs(change)
    reached = np.bincount(row, own, minlength=states.nodes)
    assert reached == pytest.approx(best_values(states, value), abs=1e-12)


@pytest.mark.parametrize("seed", seeds(5, 12))
def test_sums_and_totals_of_slots(seed: int) -> None:
    states = instance(seed)
    rng = np.random.default_rng(seed)
    for slots in (states.rows, states.columns):
        weight = rng.integers(0, ONE, len(slots.begin)) * rng.integers(0, 2, len(slots.begin))
        sums = np.zeros(len(slots.step), object)
        for s, (a, b) in enumerate(zip(slots.begin.tolist(), slots.end.tolist(), strict=True)):
            sums[a:b] += int(weight[s])
        assert slots.sums(weight).tolist() == sums.tolist()

        node = slots.node
        for scale in (1.0, 1e-200, 1e80, np.where(node % 2, 1e-9, 1e9)):
            price = rng.exponential(1.0, len(slots.step)) * scale
            price *= rng.integers(0, 2, len(price))
            largest = np.zeros(states.nodes)
            np.add.at(largest, node, price)
            allowed = np.maximum(largest[slots.pair_node][states.pair] * 2.0**-52, 1e-305)
            exact = exact_totals(slots, fractions(price))
            for found, total, slack in zip(slots.totals(price), exact, allowed, strict=True):
                assert abs(Fraction(float(found)) - total) <= slack
            chosen = np.flatnonzero(rng.random(len(slots.begin)) < 0.3)
            assert np.array_equal(slots.totals(price, chosen), slots.totals(price)[chosen])


def test_prices_of_any_size() -> None:
    states = instance(0)
    weights = np.zeros(len(states.begin))
    for price in (1e90, 1e300, np.inf, -np.inf, np.nan, -1e300):
        prices = np.full(len(states.columns.step), price)
        bounds, _, _ = certify(states, Solution(weights=weights, prices=prices, status=""))
        assert 0.0 <= bounds.lower <= bounds.upper
