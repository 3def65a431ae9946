"""Worked examples with known values: one-dimensional states, NaN where nothing exists.

GOSPA and T-GOSPA values were computed by the authors' published MATLAB and Python code and by an
LP of our own; T1 to T9 are derived by hand.
"""

import numpy as np
import pytest
from by_hand import N, tracks

from tgospa_eval import evaluate

pytestmark = pytest.mark.usefixtures("proven")  # every value has a proof

PARTS = ("localisation", "missed", "false", "switch")


def none(steps: int) -> np.ndarray:
    return np.zeros((steps, 0, 1))


def span(value: float, first: int, last: int, steps: int = 5) -> list[float]:
    return [value if first <= k <= last else N for k in range(1, steps + 1)]


REPOSITORY = {
    1: (tracks(span(1, 1, 5)), tracks(span(2, 1, 5))),
    2: (tracks(span(1, 1, 5)), tracks(span(2, 1, 4))),
    3: (tracks(span(1, 1, 5)), tracks(span(1.1, 1, 3), span(1.1, 4, 5))),
    4: (
        tracks(span(1, 1, 5), span(2.2, 1, 3), span(2.2, 4, 5)),
        tracks(span(1.1, 1, 3), span(1.1, 4, 5), span(2.1, 1, 5)),
    ),
    5: (tracks([1] * 4, [2.2] * 4), tracks([2, 2, 1.2, 1.2], [1.2, 1.2, 2, 2])),
    6: (
        tracks([1] * 4, [2.2] * 4),
        tracks([2] * 4, span(1.2, 1, 2, 4), span(1.2, 3, 4, 4)),
    ),
    7: (tracks([0.5] * 5, [2, 2, N, 2, 2]), tracks([1.5] * 5, [0.0] * 5)),
    8: (tracks([0.5] * 5, [2.0] * 5), none(5)),
}
SETTINGS = [(5, 1, 1), (5, 2, 1), (5, 1, 10), (2, 2, 3)]
TABLE = {
    1: [[5, 0, 0, 0], [5, 0, 0, 0], [5, 0, 0, 0], [5, 0, 0, 0]],
    2: [[4, 2.5, 0, 0], [4, 12.5, 0, 0], [4, 2.5, 0, 0], [4, 2, 0, 0]],
    3: [[0.5, 0, 0, 1], [0.05, 0, 0, 1], [0.3, 5, 5, 0], [0.03, 4, 4, 0]],
    4: [[1, 0, 0, 2], [0.1, 0, 0, 2], [11, 0, 0, 0], [2.48, 4, 4, 0]],
    5: [[1.6, 0, 0, 2], [0.32, 0, 0, 2], [4.8, 0, 0, 0], [4.16, 0, 0, 0]],
    6: [[1.6, 0, 0, 1], [0.32, 0, 0, 1], [1.2, 5, 5, 0], [0.24, 4, 4, 0]],
    7: [[4.5, 0, 2.5, 0], [2.25, 0, 12.5, 0], [4.5, 0, 2.5, 0], [2.25, 0, 2, 0]],
    8: [[0, 25, 0, 0], [0, 125, 0, 0], [0, 25, 0, 0], [0, 20, 0, 0]],
}
VALUES = {
    1: [5, 2.2360680, 5, 2.2360680],
    2: [6.5, 4.0620192, 6.5, 2.4494897],
    3: [1.5, 1.0246951, 10.3, 2.8337255],
    4: [3, 1.4491377, 11, 3.2372828],
    5: [3.6, 1.5231546, 4.8, 2.0396078],
    6: [2.6, 1.1489125, 11.2, 2.8705400],
    7: [7, 3.8405729, 7, 2.0615528],
    8: [25, 11.1803399, 25, 4.4721360],
}


@pytest.mark.parametrize("column", range(4))
@pytest.mark.parametrize("example", TABLE)
def test_repository_examples(example: int, column: int) -> None:
    result = evaluate(*REPOSITORY[example], *SETTINGS[column])
    assert result.tgospa == pytest.approx(VALUES[example][column], abs=1e-7)
    assert [getattr(result, part) for part in PARTS] == pytest.approx(TABLE[example][column])
    assert result.certified


@pytest.mark.parametrize(
    ("x", "y", "c", "p", "value", "parts"),
    [
        ([0, 10], [1, 30], 5, 2, 5.0990195, [1, 12.5, 12.5]),
        ([0, 10], [1, 30], 5, 1, 6, [1, 2.5, 2.5]),
        ([0, 4], [2, 100], 3, 2, 3.6055513, [4, 4.5, 4.5]),
    ],
)
def test_gospa(x, y, c: float, p: float, value: float, parts: list[float]) -> None:
    result = evaluate(np.array([x], float)[..., None], np.array([y], float)[..., None], c, p, 1)
    assert result.tgospa == pytest.approx(value, abs=1e-7)
    assert [result.localisation, result.missed, result.false] == pytest.approx(parts)


def test_gospa_in_the_plane() -> None:
    x = np.array([[[0, 0], [0, 3]]], float)
    y = np.array([[[1, 1], [4, 7]]], float)
    result = evaluate(x, y, 10, 1, 1)
    assert result.tgospa == pytest.approx(7.0710678, abs=1e-7)
    assert result.localisation == result.total


# name: truth, estimate, c, p, gamma, total, costs by part (None where optima tie)
CASES = {
    "T1 any gamma": ([[0, 0, 0]], [[1, 1, N]], 5, 2, 7, 14.5, [2, 12.5, 0, 0]),
    "T2 hole": ([[0, N, 0]], [[0, 0, 0]], 4, 1, 1, 2, [0, 0, 2, 0]),
    "T2 hole in both": ([[0, N, 0]], [[0, N, 0]], 4, 1, 1, 0, [0, 0, 0, 0]),
    "T3 fragment 1": ([[0, 0, 0]], [[0, 0, N], [N, N, 0]], 4, 1, 1, 1, [0, 0, 0, 1]),
    "T3 fragment 3": ([[0, 0, 0]], [[0, 0, N], [N, N, 0]], 4, 1, 3, 3, [0, 0, 0, 3]),
    "T3 fragment 5": ([[0, 0, 0]], [[0, 0, N], [N, N, 0]], 4, 1, 5, 4, [0, 2, 2, 0]),
    "T3 exchanged": ([[0, 0, N], [N, N, 0]], [[0, 0, 0]], 4, 1, 1, 1, [0, 0, 0, 1]),
    "T3 gap": ([[0, 0, 0]], [[0, N, N], [N, N, 0]], 4, 1, 1, 3, [0, 2, 0, 1]),
    "T3 a track just ends": ([[0, 0, 0]], [[0, 0, N]], 4, 1, 1, 2, [0, 2, 0, 0]),
    "T4 beyond c": ([[0]], [[7]], 5, 2, 1, 25, [0, 12.5, 12.5, 0]),
    "T4 exactly c": ([[0]], [[5]], 5, 2, 1, 25, [0, 12.5, 12.5, 0]),
    "T5 capacity 1": ([[0, N, 0], [N, 0, N]], [[0, 0, 0]], 4, 1, 1, 2, [0, 0, 0, 2]),
    "T5 capacity 3": ([[0, N, 0], [N, 0, N]], [[0, 0, 0]], 4, 1, 3, 4, [0, 2, 2, 0]),
    "T6": ([[0, 50], [10, 0]], [[0, 0], [10, N]], 4, 1, 1, 3.5, [0, 2, 0, 1.5]),
    "T7 swap": ([[0] * 3, [10] * 3], [[0, 0, 10], [10, 10, 0]], 5, 2, 1, 2, [0, 0, 0, 2]),
    "T7 swap 2": ([[0] * 3, [10] * 3], [[0, 0, 10], [10, 10, 0]], 5, 1, 2, 4, [0, 0, 0, 4]),
    "T7 swap 20": ([[0] * 3, [10] * 3], [[0, 0, 10], [10, 10, 0]], 5, 1, 20, 10, [0, 5, 5, 0]),
    "T8 tie": ([[0, 0, 0]], [[0, 0, N], [N, N, 0]], 4, 1, 4, 4, None),
    "crossing": ([[0] * 3, [1] * 3], [[0.4, 0.6, 0.4], [0.6, 0.4, 0.6]], 5, 1, 1, 2.8, None),
    "both switch": ([[0, 0], [10, 10]], [[1, 11], [11, 1]], 5, 1, 2, 8, [4, 0, 0, 4]),
    "miss, not switch": ([[0, 0, 0]], [[0, N, 0], [N, 100, N]], 5, 1, 2, 5, [0, 2.5, 2.5, 0]),
}


@pytest.mark.parametrize("solver", ["certified", "exact"])
@pytest.mark.parametrize("name", CASES)
def test_extra_examples(name: str, solver: str) -> None:
    truth, estimate, c, p, gamma, total, parts = CASES[name]
    result = evaluate(tracks(*truth), tracks(*estimate), c, p, gamma, solver=solver)
    assert result.total == pytest.approx(total, rel=1e-7)
    if parts is not None:
        found = [getattr(result, part) for part in PARTS]
        assert found == pytest.approx(parts, abs=1e-6)
        # half a switch costs gamma^p / 2, so gamma counts them as well
        assert result.counts["switch"] == pytest.approx(parts[3] / gamma**p, abs=1e-6)


def test_empty_against_empty() -> None:
    result = evaluate(none(3), none(3))
    assert (result.tgospa, result.lower_bound, result.relative_gap) == (0.0, 0.0, 0.0)
    assert result.certified


# Traps of the reductions: each of these is wrong in a solver that cuts too much.


def test_border_prefix_saves_half_a_switch() -> None:
    """Being assigned from the first step on is free, also before the first gain of the pair."""
    truth = tracks([0, 0, 0, 0])
    estimate = tracks([50, 0, N, N], [N, N, 0, 0])
    result = evaluate(truth, estimate, 2, 1, 0.5)
    assert result.total == pytest.approx(1 + 1 + 0.5)
    assert result.counts == {"missed": 1.0, "false": 1.0, "switch": 1.0}


def test_prefix_that_blocks_another_truth() -> None:
    """Both truths want the estimate, one at each end: half a switch for each change of hands."""
    truth = tracks([0, 0, 50, 50], [50, 50, 0, 0])
    estimate = tracks([0, 0, 0, 0])
    result = evaluate(truth, estimate, 4, 1, 1)
    assert result.counts["switch"] == pytest.approx(1.0)
    assert result.total == pytest.approx(4 * 2 + 1)


def test_gap_window() -> None:
    """Near one track at first and near another at last: a whole switch, though windows differ."""
    truth = tracks([0, 0])
    estimate = tracks([0, 9], [9, 0])
    result = evaluate(truth, estimate, 4, 1, 1)
    assert result.total == pytest.approx(2 * 2 + 1)
    assert result.counts["switch"] == pytest.approx(1.0)


def test_free_switches_are_counted_sparingly() -> None:
    """With gamma = 0 a pair is still held through a hole, not released and taken again."""
    held = evaluate(tracks([0, N, 0]), tracks([0, 0, 0]), 4, 1, 0)
    assert held.counts == {"missed": 0.0, "false": 1.0, "switch": 0.0}
    swapped = evaluate(tracks([0, 0], [9, 9]), tracks([0, 9], [9, 0]), 4, 1, 0)
    assert swapped.counts["switch"] == 2.0
    assert swapped.switch == 0.0
