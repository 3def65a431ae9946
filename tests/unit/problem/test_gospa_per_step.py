"""Per-step GOSPA, and the switches that two tools charge afterwards.

Some of its rows are in docs/reference/other-metrics.md. Its per-step values follow from the rule:
GOSPA of each step by hand (all errors are 0 or 1, or all distances beyond the cutoff), changes
counted by hand, and Stone Soup's (GOSPA^2 + (SP n^(1/p))^2)^(1/2).
"""

import pytest
from by_hand import N, tracks
from hypothesis import given
from hypothesis import strategies as st
from oracles import gospa
from strategies import ORDERS, pairs_of_sets, scene

from tgospa_eval import evaluate
from tgospa_eval.campaign.ranking import against, differences
from tgospa_eval.problem import gospa as per_step

SWAP = ([[0] * 3, [10] * 3], [[0, 0, 10], [10, 10, 0]])
FRAGMENT = ([[0, 0, 0]], [[0, 0, N], [N, N, 0]])
NEAR = ([[0] * 3, [1] * 3], [[0.4, 0.6, 0.4], [0.6, 0.4, 0.6]])
# truth, estimate, p, SP, Stone Soup's values, MathWorks' values
CASES = {
    "swap": (*SWAP, 1, 2, [0, 0, 4], [0, 0, 4]),
    "swap, p 2": (*SWAP, 2, 2, [0, 0, 8**0.5], [0, 0, 8**0.5]),
    "fragment": (*FRAGMENT, 1, 2, [0, 0, 2], [0, 0, 2]),
    # both truths begin to be stored, or to exist, when they are assigned: nothing to compare with
    "exchanged": (FRAGMENT[1], FRAGMENT[0], 1, 2, [0, 0, 0], [0, 0, 0]),
    # a step without estimates is passed over; MathWorks compares with it, half a switch each way
    "gap": ([[0, 0, 0]], [[0, N, 0]], 1, 2, [0, 2.5, 0], [0, 3.5, 1]),
    "gap, far false": (
        [[0, 0, 0]], [[0, N, 0], [N, 100, N]], 1, 2, [0, 26**0.5, 1], [0, 6, 1],
    ),
    "errors": ([[0, 0], [10, 10]], [[1, 11], [11, 1]], 1, 2, [2, 20**0.5], [2, 6]),
    "crossing": (*NEAR, 1, 1, [0.8, (0.64 + 4) ** 0.5, (0.64 + 4) ** 0.5], [0.8, 2.8, 2.8]),
    # absent at step 2: the stored partner is compared at step 3, the step before is not there
    "hole": ([[0, N, 0]], [[0, 0, N], [N, N, 0]], 1, 2, [0, 2.5, 2], [0, 2.5, 0]),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_rules(name: str) -> None:
    truth, estimate, p, penalty, stone_soup, mathworks = CASES[name]
    _, found = against(evaluate(tracks(*truth), tracks(*estimate), 5, p, penalty))
    assert found["stone_soup"] == pytest.approx(stone_soup)
    assert found["mathworks"] == pytest.approx(mathworks)


@given(pairs_of_sets(most=4), ORDERS)
def test_sum_is_tgospa_without_switch_penalty(sets: tuple, order: float) -> None:
    truth, estimate = sets
    result = evaluate(truth, estimate, 2.0, order, 0.0)
    total = sum(per_step.per_step_gospa(result.proof.states.problem)[1:])
    assert total.sum() * 2.0**order == pytest.approx(result.total, rel=1e-9, abs=1e-12)
    assert total.sum() * 2.0**order == pytest.approx(
        gospa(truth, estimate, 2.0, order), rel=1e-9, abs=1e-12
    )


@given(st.integers(0, 2**32 - 1))
def test_sparse_assignment_is_as_good(seed: int) -> None:
    truth, estimate = scene(seed, 12, 14, 4, side=6)
    problem = evaluate(truth, estimate, 2.0, 2, 0.0).proof.states.problem
    dense = per_step.per_step_gospa(problem)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(per_step, "DENSE_MATRIX", 0)
        patch.setattr(per_step, "SPARSE_RATIO", 0)
        sparse = per_step.per_step_gospa(problem)
    assert sum(sparse[1:]) == pytest.approx(sum(dense[1:]))


def test_small_costs_keep_their_digits() -> None:
    """Costs of 1e-20 c^p would be lost in gains near 1; by hand, 1e-20 + 4e-20 against 9e-20."""
    result = evaluate(tracks([0], [1e-10]), tracks([1e-10], [3e-10]), 1, 2, 0)
    localisation = per_step.per_step_gospa(result.proof.states.problem)[1]
    assert localisation.sum() == pytest.approx(5e-20, rel=1e-6)


def test_differences_are_told() -> None:
    result = evaluate(tracks(*NEAR[0]), tracks(*NEAR[1]), 5, 1, 1)
    found = against(result)[0]
    document = {"total": result.total, "counts": result.counts}
    told = " ".join(differences(document, found, [3], 1))
    # 2.4 of 2.8; steps 2 and 3 would be crossed, or step 1 and 3 kept crossed: one of them differs
    assert found["total"] == pytest.approx(2.4)
    assert "is 85.71 % of the total" in told
    assert "Stone Soup counts 4 switches afterwards, TGOSPA 0" in told
    assert "exponent 2 though p = 1" in told
