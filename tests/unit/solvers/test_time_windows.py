"""Large components in windows of time: small scenes go through them by smaller numbers."""

from dataclasses import replace

import numpy as np
import pytest
from examples import seeds
from strategies import dice, scene

from tgospa_eval import Certified, Result, evaluate
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.solution import Bounds
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.batches import Division, divisible_blocks
from tgospa_eval.solvers.tuning import TIME_WINDOWS

pytestmark = pytest.mark.skipif(kernels is None, reason="no compiled kernels here")

Sides = tuple[np.ndarray, np.ndarray]


def divide(patch: pytest.MonkeyPatch, *, shortest: int = 5, overlap: int = 2) -> None:
    """Let every block of two rows that compete go through windows of so many steps."""
    small = {"min_states": 1, "steps": 2, "size": 1, "shortest": shortest, "overlap": overlap}
    for name, value in small.items():
        patch.setattr(TIME_WINDOWS, name, value)


def whole(sides: Sides, switch_penalty: float = 2.0, cutoff: float = 5.0) -> Result:
    return evaluate(*sides, cutoff, 2, switch_penalty)


def crossing(steps: int = 40) -> Sides:
    """Two pairs that are near each other at the ends only, where a third estimate competes."""
    x = np.arange(steps, dtype=float)
    truth = np.stack([np.stack([x, np.full(steps, y)], 1) for y in (0.0, 1.0)], 1)
    estimate = np.full((steps, 3, 2), np.nan)
    estimate[:, :2] = truth + np.array((0.1, 0.0))
    estimate[8:-8, :2] = (0.0, 500.0)
    estimate[:4, 2] = truth[:4, 0] + np.array((0.0, 0.4))
    return truth, estimate


def joined(states: States) -> Bounds:
    """What windows prove of a problem with one block before anything is repaired."""
    division = Division(states)
    for window in division.windows:
        piece = division.problem_of(window)
        found = Certified()(piece, Stopwatch())
        division.take(window, piece, found.weights, found.prices)
    proposed = replace(found, weights=division.join(), prices=division.prices)
    return certify(states, proposed)[0]


@pytest.mark.parametrize("seed", seeds(12, 24))
def test_windows_of_any_length_and_overlap_find_the_optimum(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    m, n, steps = 3 + seed % 5, 3 + seed % 4, 16 + 7 * (seed % 5)
    switch_penalty = (0.5, 2.0, 12.0)[seed % 3]
    sides = (
        dice(seed, m, n, steps)
        if seed % 4 == 3
        else scene(seed, m, n, steps, side=8.0, noise=(0.3, 1.0, 2.0)[seed % 3])
    )
    sought = whole(sides, switch_penalty)
    divide(monkeypatch, shortest=1 + seed % 9, overlap=(1, 2, 5)[seed % 3])
    found = whole(sides, switch_penalty)
    assert sought.certified
    assert found.certified
    assert found.total == pytest.approx(sought.total, rel=1e-9)
    if seed % 6 == 0:
        again = evaluate(*sides, 5.0, 2, switch_penalty, solver=Certified(jobs=1))
        assert np.array_equal(again.proof.weights, found.proof.weights)
        assert again.proof.bounds == found.proof.bounds


def test_windows_are_asked_and_cover_the_block(monkeypatch: pytest.MonkeyPatch) -> None:
    divide(monkeypatch)
    asked: list[np.ndarray] = []
    join = Division.join
    monkeypatch.setattr(Division, "join", lambda self: asked.append(join(self)) or asked[-1])
    sides = scene(3, 6, 6, 40, side=8.0)
    states = whole(sides).proof.states
    assert len(asked) == len(divisible_blocks(states)) > 0
    windows = Division(states.between(0, 1)[0]).windows
    assert len(windows) > 3
    assert [begin for begin, *_ in windows[1:]] == [end for _, end, *_ in windows[:-1]]
    assert (windows[0][0], windows[-1][1]) == (states.block_begin[0], states.block_end[0] + 1)
    assert all(first <= low - 2 and stop >= high + 2 for low, high, first, stop in windows[1:-1])


@pytest.mark.parametrize("overlap", [1, 3])
def test_what_is_held_through_whole_windows_costs_no_switch(
    overlap: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = whole(crossing())
    divide(monkeypatch, overlap=overlap)
    bounds = joined(result.proof.states)
    assert bounds.upper == pytest.approx(result.total / 25.0, rel=1e-12)


def test_a_seam_that_does_not_fit_is_repaired(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a crowd with large errors prices of neighbours do not fit each other after one step."""
    sides = scene(5, 6, 6, 30, side=6.0, noise=2.0)
    sought = whole(sides, cutoff=8.0)
    divide(monkeypatch, shortest=10, overlap=1)
    assert joined(sought.proof.states).relative_gap > 1e-4
    found = whole(sides, cutoff=8.0)
    assert found.certified
    assert found.total == pytest.approx(sought.total, rel=1e-9)


@pytest.mark.parametrize("limit", [1e-9, 0.003, 0.02])
def test_a_time_limit_leaves_a_true_bracket(limit: float, monkeypatch: pytest.MonkeyPatch) -> None:
    sides = scene(5, 6, 6, 40, side=6.0, noise=2.0)
    sought = whole(sides)
    divide(monkeypatch)
    found = evaluate(*sides, 5.0, 2, 2.0, solver=Certified(time_limit=limit))
    assert found.lower_bound <= sought.upper_bound
    assert found.upper_bound >= sought.lower_bound


def test_where_windows_do_not_fit_the_whole_is_solved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sides = scene(1, 5, 5, 30, side=8.0)
    weights = np.linspace(1.0, 2.0, 30)
    results = [
        evaluate(*sides, 5.0, 2, 2.0, step_weights=weights),
        whole(sides, switch_penalty=0.0),
        whole(sides, switch_penalty=30.0),
    ]
    divide(monkeypatch)
    for result in results:
        assert not len(divisible_blocks(result.proof.states))
