"""Ties and small costs: what a linear programme says where many optima are equal."""

import numpy as np
import pytest
from oracles import tgospa_lp
from strategies import coincident, dice, lattice_walks, overlapping

from tgospa_eval import evaluate
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import States
from tgospa_eval.solvers import restricted_lp as programmes
from tgospa_eval.solvers.restricted_lp import (
    Proposal,
    make_programme,
    refine,
    solve_restricted_lp,
    suggest,
)


def states_of(sides: tuple[np.ndarray, np.ndarray], c: float, p: float, gamma: float) -> States:
    return evaluate(*sides, c, p, gamma).proof.states


def whole(states: States) -> Proposal:
    """The whole problem as one programme, from nothing."""
    size, slots = len(states.begin), len(states.columns.step)
    return solve_restricted_lp(
        states, np.arange(size), np.zeros(size), np.zeros(slots), states.problem.switch_price_at,
        None,
    )  # fmt: skip


def bracket(states: States, found: Proposal) -> tuple[float, float]:
    """Cost of what is proposed, and width of its bracket."""
    prices = np.zeros(len(states.columns.step))
    prices[found.slot] = found.prices
    weights = found.weights.copy()
    bounds, _, _ = certify(states, Solution(weights=weights, prices=prices, status=""))
    return bounds.upper, bounds.upper - bounds.lower


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("scene", "size", "c", "gamma"),
    [
        (coincident, (7, 7, 25), 10.0, 10.0),
        (lattice_walks, (7, 8, 20), 3.0, 1.0),
        (dice, (8, 7, 12), 3.0, 2.0),
    ],
)
def test_ties_are_proven(scene, size: tuple[int, int, int], c: float, gamma: float, seed: int):
    sides = scene(seed, *size)
    result = evaluate(*sides, c, 1, gamma)
    assert result.certified
    assert result.total == pytest.approx(tgospa_lp(*sides, c, 1, gamma), rel=1e-8)


def test_equal_optima_of_free_switches_do_not_depend_on_what_else_there_is() -> None:
    """Scenes side by side, as in one file and as in parts of it."""
    scenes = [dice(seed, 6, 6, 20) for seed in range(8)]
    apart = [evaluate(*sides, 3.0, 2, 0.0).assignments for sides in scenes]
    moved = [[side + 100.0 * k for side in sides] for k, sides in enumerate(scenes)]
    both = (np.concatenate(side, axis=1) for side in zip(*moved, strict=True))
    together = evaluate(*both, 3.0, 2, 0.0).assignments
    for k, own in enumerate(apart):
        mine = together[together["truth"].astype(int) // 6 == k].reset_index(drop=True)
        for name in ("t", "weight"):
            assert mine[name].tolist() == own[name].tolist()
        for name in ("truth", "estimate"):
            assert (mine[name].astype(int) - 6 * k).tolist() == own[name].astype(int).tolist()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("c", "p"), [(1e4, 2), (1e6, 2), (100.0, 5), (50.0, 10)])
def test_refined_duals_prove_small_costs(c: float, p: float, seed: int) -> None:
    """HiGHS takes 1e-9 of c^p for zero; these totals are 2e-6 to 2e-12 of it."""
    states = states_of(overlapping(seed, 6, 20), c, p, 1.0)
    plain = whole(states)
    better = refine(plain, None)
    cost, width = bracket(states, better)
    assert width <= 1e-13 * cost
    assert cost <= bracket(states, plain)[0] * (1 + 1e-12)
    assert refine(better, None).prices == pytest.approx(better.prices, rel=1e-9, abs=1e-30)


def test_refinement_is_needed() -> None:
    states = states_of(overlapping(0, 6, 20), 50.0, 10, 1.0)
    cost, width = bracket(states, whole(states))
    assert width > 1e-3 * cost


def test_an_unfinished_proposal_stays() -> None:
    states = states_of(overlapping(0, 4, 6), 10.0, 2, 1.0)
    size, slots = len(states.begin), len(states.columns.step)
    found = solve_restricted_lp(
        states, np.arange(size), np.zeros(size), np.zeros(slots), states.problem.switch_price_at,
        0.0,
    )  # fmt: skip
    assert not found.finished
    assert refine(found, None) is found


def test_weights_are_fractions() -> None:
    states = states_of(dice(2, 8, 7, 12), 3.0, 1, 2.0)
    weights = whole(states).weights
    inner = weights[(weights > 0) & (weights < 1)]
    assert len(inner)
    denominators = np.arange(1, 65)
    whole_parts = inner[:, None] * denominators
    assert (whole_parts == np.rint(whole_parts)).any(axis=1).all()


def test_prices_suggest_a_basis() -> None:
    """Started there the simplex method takes less than half of its iterations."""
    sides = lattice_walks(1, 15, 15, 60)
    result = evaluate(*sides, 3.0, 1, 1.0)
    states = result.proof.states
    size, slots = len(states.begin), len(states.columns.step)
    cold = whole(states)
    prices = np.zeros(slots)
    prices[cold.slot] = cold.prices
    rough = np.where(prices > 0, prices + np.random.default_rng(0).normal(0, 1e-3, slots), 0.0)
    rough = np.maximum(rough, 0.0)
    free, switch_price = np.arange(size), states.problem.switch_price_at
    assert suggest(make_programme(states, free, np.zeros(size), rough, switch_price))
    warm = solve_restricted_lp(states, free, np.zeros(size), rough, switch_price, None)
    assert warm.finished
    assert warm.iterations < 0.5 * cold.iterations
    assert bracket(states, warm)[0] == pytest.approx(bracket(states, cold)[0], rel=1e-9)


@pytest.mark.parametrize("scene", [coincident, lattice_walks, dice])
def test_both_methods_agree(scene, monkeypatch: pytest.MonkeyPatch) -> None:
    states = states_of(scene(0, 8, 8, 20), 4.0, 1, 2.0)
    simplex = whole(states)
    monkeypatch.setattr(programmes, "LARGE_LP", 1)
    monkeypatch.setattr(programmes, "WORK_EACH", 0)
    monkeypatch.setattr(programmes, "suggest", lambda _: None)  # or it is over too soon
    interior = whole(states)
    assert not simplex.interior
    assert interior.interior
    assert interior.finished
    cost, width = bracket(states, interior)
    assert cost == pytest.approx(bracket(states, simplex)[0], rel=1e-9)
    assert width < 1e-7 * cost
