"""The referee of tests/support against values by hand, and against two other solvers."""

from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from claims import judge, reference_of
from exact_lp import DIVISIBLE, RefereeError, assignment_cost, costs_of, optimum, raised, simplex
from far_scenes import RANDOM, WALKS, far_scene
from oracles import tgospa_lp
from strategies import scene

NONE = np.zeros((3, 0, 1))


def tracks(*rows: list[float]) -> np.ndarray:
    return np.array(rows, float).T[..., None]


@pytest.mark.parametrize(
    ("base", "exponent", "bits", "low"),
    [
        (Fraction(3, 2), Fraction(2), 2, 9),
        (2, Fraction(1, 2), 4, 22),  # 16 sqrt(2) = 22.6
        (Fraction(9, 4), Fraction(3, 2), 3, 27),
        (2, Fraction(29, 10), 10, 7643),  # 2^12.9 = 7643.41
        (0, Fraction(29, 10), 10, 0),
        (1, Fraction(29, 10), 10, 1023),  # not known to be whole
    ],
)
def test_powers_are_enclosed(base: Fraction | int, exponent: Fraction, bits: int, low: int) -> None:
    found = raised(base, exponent, bits)
    assert found[0] == low
    assert found[1] - low in ((0, 1) if exponent.denominator < 3 else (0, 1, 2))
    if not found[1] - low:
        assert Fraction(low, 2**bits) ** 2 == Fraction(base) ** (2 * exponent)


def test_powers_of_huge_and_tiny_numbers() -> None:
    for base in (10**400, Fraction(1, 10**400)):
        low, high = raised(base, Fraction(1.7), 6000)
        assert 0 < low < high
        assert Fraction(high - low, low) < Fraction(1, 10**60)


# T9: weights of the optimum are halves; the swap of far cutoffs; nothing on one side.
FRACTIONAL = tracks([3, 2, 2], [2, 3, 0], [1, 0, 1]), tracks([3, 1, 1], [1, 2, 2], [0, 1, 2])
SWAP = tracks([0, 0], [1, 1]), tracks([0, 1], [1, 0])


@pytest.mark.parametrize(
    ("sides", "c", "p", "gamma", "total"),
    [
        (FRACTIONAL, 2, 1, 0.25, 7.4375),
        (FRACTIONAL, 2, 1, 0.5, 7.875),
        (FRACTIONAL, 2, 1, 2, 9),
        (SWAP, 2**60, 2, 2**-60, 2 * Fraction(1, 2**120)),
        (SWAP, 2**60, 10, 2, 2),  # two errors of 1 are less than the switch
        (SWAP, 2**60, 3, 0, 0),
        ((tracks([0, 0, 0]), NONE), 4, 2, 1, 24),
        ((NONE, NONE), 4, 2, 1, 0),
    ],
)
def test_values_by_hand(
    sides: tuple[np.ndarray, np.ndarray], c: float, p: int, gamma: float, total: Fraction | float
) -> None:
    found = optimum(*sides, float(c), float(p), float(gamma))
    assert found.exact
    unit = DIVISIBLE * 2 ** (found.costs.bits + found.costs.exponent * p)
    assert found.upper == Fraction(total) * unit
    assert found.metric == pytest.approx(float(total) ** (1 / p), rel=1e-14)


def test_what_is_not_feasible_has_no_cost() -> None:
    costs = costs_of(*SWAP, 4.0, 2.0, 1.0)
    weights = np.ones((2, 2, 2), object)
    with pytest.raises(RefereeError, match="not feasible"):
        assignment_cost(costs, weights, 1)
    with pytest.raises(RefereeError, match="not feasible"):
        assignment_cost(costs, -weights, 1)
    assert assignment_cost(costs, weights, 2) > 0


@pytest.mark.parametrize("index", range(30))
def test_the_textbook_simplex_agrees_to_the_last_integer(index: int) -> None:
    """It shares the costs and the matrix, and no float."""
    instance = far_scene("tiny", 7, index)
    truth, estimate = instance.truth[:2], instance.estimate[:2]
    found = optimum(truth, estimate, instance.c, instance.p, instance.gamma, instance.distance)
    value = simplex(found.costs)
    if found.costs.low is not found.costs.high and (found.costs.low == found.costs.high).all():
        assert found.lower == found.upper == value
    else:  # it solves the programme of the lower costs
        assert value <= found.upper
        assert found.upper - value <= Fraction(1, 10**50) * found.upper


@pytest.mark.parametrize("distance", ["euclidean", "manhattan", "chebyshev"])
@pytest.mark.parametrize("p", [1.0, 1.5, 2.0, 3.0, 2.9])
def test_the_programme_of_the_definition_in_floats_agrees(p: float, distance: str) -> None:
    """Where the cutoff is near the errors floats are good enough."""
    for seed in range(3):
        truth, estimate = scene(seed, 3, 4, 8, side=4.0)
        found = optimum(truth, estimate, 2.0, p, 0.7, distance, 1e-24)
        expected = tgospa_lp(truth, estimate, 2.0, p, 0.7, distance)
        assert found.width < 1e-24
        assert found.metric**p == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("family", [*RANDOM, *(name for name in WALKS if "24x" not in name)])
def test_brackets_close(family: str) -> None:
    """Whatever the range of the costs is: here from 10^-60 to 10^290 of each other."""
    for index in range(4 if family in RANDOM else 1):
        given = far_scene(family, 1, index)
        found = optimum(
            given.truth, given.estimate, given.c, given.p, given.gamma, given.distance, 1e-24
        )
        assert found.lower <= found.upper
        assert found.width < 1e-24


@pytest.mark.parametrize("family", RANDOM)
def test_the_judge_sees_a_last_place(family: str) -> None:
    """Bounds rounded outward are sound; moved inward by one place more they are not."""
    for index in range(15):
        given = far_scene(family, 3, index)
        reference = reference_of(given)
        if not reference.lower:
            continue
        share = float(reference.upper / reference.costs.cutoff[0])
        if not 1e-290 < share < 1e290:
            continue
        less, more = [
            (np.nextafter(share, end), np.nextafter(reference.metric, end)) for end in (0, np.inf)
        ]
        assert judge(said(less, more), given, reference).faults == []
        wrong = judge(said((more[0], less[1]), more), given, reference).faults
        assert len(wrong) == 1
        assert "lower bound is above" in wrong[0]
        wrong = judge(said(less, (more[0], less[1])), given, reference).faults
        assert len(wrong) == 1
        assert "upper bound is below" in wrong[0]
        wrong = judge(said(less, (1.01 * share, more[1])), given, reference).faults
        assert [fault[:12] for fault in wrong] == ["called exact"] * 2
        wrong = judge(said(less, more, within_rounding=True), given, reference).faults
        assert wrong == ["excused by rounding, but the data determine the value"]


def said(lower: tuple[float, float], upper: tuple[float, float], **more: bool) -> Any:
    """A certified result with bounds of the total in units of c^p, and of the metric."""
    bounds = SimpleNamespace(lower=float(lower[0]), upper=float(upper[0]))
    return SimpleNamespace(
        proof=SimpleNamespace(bounds=bounds),
        lower_bound=float(lower[1]),
        upper_bound=float(upper[1]),
        certified=True,
        **more,
    )
