"""Long recordings: what grows with them, and pieces of them that are solved apart."""

import numpy as np
import pytest
from fallback import without_kernels
from strategies import scene

import tgospa_eval.solvers.certified as certified_module
import tgospa_eval.solvers.exact as exact_module
import tgospa_eval.solvers.lp_rounds as whole_lp_module
import tgospa_eval.solvers.restricted_lp as restricted_lp_module
from tgospa_eval import Certified, Exact, Sinkhorn, evaluate
from tgospa_eval.common.progress import Status, Stopwatch
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.certificate import certify
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.block_costs import price_cap
from tgospa_eval.solvers.dual_ascent import Ascent
from tgospa_eval.solvers.lp_rounds import extract, groups, windows
from tgospa_eval.solvers.restricted_lp import solve_restricted_lp
from tgospa_eval.solvers.tuning import PROGRAMMES, WINDOWS

compiled_only = pytest.mark.skipif(kernels is None, reason="no compiled kernels here")


def states_of(seed: int = 1, m: int = 8, steps: int = 60, side: float = 10.0) -> States:
    truth, estimate = scene(seed, m, m, steps, side=side, noise=1.0)
    return evaluate(truth, estimate, 5.0, 2, 2.0).proof.states


def ascent_of(states: States) -> Ascent:
    """After one cold stage, far from the optimum."""
    wanted = states.block_begin < states.block_end
    weights, prices = np.zeros(len(states.begin)), np.zeros(len(states.columns.step))
    ascent = Ascent(states, wanted, 1e-9, weights, prices)
    ascent.stage(0.05, 8, 1.0, lambda: False)
    return ascent


@compiled_only
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_piece_asks_the_same_as_the_whole(seed: int) -> None:
    states = states_of(seed)
    ascent = ascent_of(states)
    ascent.mark(ascent.prices, 0.2)
    begin = states.begin
    for low, high in ((0, 9), (20, 30), (50, 60)):
        free = np.flatnonzero(ascent.has(kernels.NEAR) & (begin >= low) & (states.end < high))
        given = ascent.weights, ascent.prices
        whole = solve_restricted_lp(states, free, *given, ascent.switch_price, None)
        piece, state, own, slot = extract(states, free)
        assert len(state) < len(begin)
        assert np.array_equal(state[own], free)
        part = solve_restricted_lp(
            piece, own, given[0][state], given[1][slot], ascent.switch_price, None
        )
        assert np.array_equal(slot[part.slot], whole.slot)
        np.testing.assert_allclose(part.weights, whole.weights, atol=1e-12)
        np.testing.assert_allclose(part.prices, whole.prices, atol=1e-12)


@compiled_only
def test_losses_by_step_are_the_width_of_the_bracket() -> None:
    ascent = ascent_of(states_of())
    lost = ascent.losses(ascent.prices)
    assert lost.min() >= 0
    assert lost.sum() == pytest.approx(ascent.gap[ascent.open].sum(), rel=1e-10)


@compiled_only
def test_losses_of_fractions_too() -> None:
    states = states_of(5, m=12, side=8.0)
    ascent = ascent_of(states)
    ascent.weights *= 0.5
    ascent.primal = ascent.brackets.values(ascent.weights)
    lost = ascent.losses(ascent.prices)
    assert lost.sum() == pytest.approx(ascent.gap[ascent.open].sum(), rel=1e-10)


@compiled_only
def test_windows_and_groups_give_the_same_number(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, estimate = scene(3, 12, 12, 400, side=25.0, noise=1.0)
    plain = evaluate(truth, estimate, 5.0, 2, 2.0)
    sizes = []

    def noting(states: States, free: np.ndarray, *rest: object, **told: object) -> object:
        sizes.append(len(free))
        return solve_restricted_lp(states, free, *rest, **told)  # type: ignore[arg-type]

    monkeypatch.setattr(restricted_lp_module, "solve_restricted_lp", noting)
    small = {"group": 100, "early_states": 400}, {"undecided": 100, "large": 500}
    for settings, values in zip((PROGRAMMES, WINDOWS), small, strict=True):
        for name, value in values.items():
            monkeypatch.setattr(settings, name, value)
    parted = evaluate(truth, estimate, 5.0, 2, 2.0, solver=Certified(jobs=1))
    assert plain.solver["status"] == parted.solver["status"] == "solved"
    assert parted.proof.bounds.upper == pytest.approx(plain.proof.bounds.upper, rel=1e-9)
    assert len(sizes) > 5, sizes
    assert np.median(sizes) < 1000


def test_groups_are_whole_components_in_time() -> None:
    states = states_of()
    free = np.arange(len(states.begin))
    component = states.begin // 3
    found = groups(states, free, component, None)
    assert np.array_equal(np.sort(np.concatenate(found)), free)
    largest = np.bincount(component).max()
    assert len(found) == 1 or max(map(len, found)) <= PROGRAMMES.group + largest
    assert all(np.all(np.diff(group) > 0) for group in found)
    assert groups(states, free, component, 0) == []


def test_windows_leave_out_what_is_allowed() -> None:
    lost = np.zeros(100)
    lost[[10, 50, 51]] = 1.0, 0.01, 0.02
    assert np.flatnonzero(windows(lost, 0.03, 2)).tolist() == [8, 9, 10, 11, 12]
    assert not windows(lost, 2.0, 2).any()


@compiled_only
def test_bounds_keep_their_digits_over_many_steps() -> None:
    """Width of a bracket at optimal prices: rounding, however long the recording is."""
    steps = 20_000
    rng = np.random.default_rng(0)
    truth = np.zeros((steps, 2, 1)) + np.array([0.0, 3.0])[:, None]
    estimate = truth + rng.normal(0, 0.5, truth.shape)
    estimate[rng.random((steps, 2)) < 0.3] = np.nan
    result = evaluate(truth, estimate, 5.0, 2, 0.5, solver=Certified(jobs=1))
    states = result.proof.states
    solution = Certified(jobs=1)(states, Stopwatch())
    wanted = np.ones(len(states.block_begin), bool)
    ascent = Ascent(
        states, wanted, 0.0, np.zeros(len(states.begin)), np.zeros(len(states.columns.step))
    )
    ascent.weights[:], ascent.prices[:] = solution.weights, solution.prices
    ascent.primal[:] = ascent.brackets.values(ascent.weights)
    ascent.mark(ascent.prices, 0.0)
    ascent.dual[:] = ascent.brackets.bound(ascent.prices)
    assert ascent.losses(ascent.prices).sum() <= 1e-12 * ascent.cost.sum()
    assert ascent.gap.sum() <= 1e-12 * ascent.cost.sum()
    assert price_cap(states).max() > 0
    assert certify(states, solution)[0].relative_gap < 1e-9


def test_exact_does_not_begin_what_it_cannot_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: States) -> None:
        raise AssertionError

    monkeypatch.setattr(exact_module, "_build", refuse)
    truth, estimate = scene(1, 8, 8, 20, side=8.0)
    result = evaluate(truth, estimate, 5.0, 2, 2.0, solver=Exact(time_limit=1e-3))
    assert result.solver["status"].startswith(Status.LATE)
    assert not result.solver["finished"]
    assert 0 <= result.proof.bounds.lower <= result.proof.bounds.upper


def test_without_kernels_large_programmes_begin_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, estimate = scene(2, 14, 14, 35, side=10.0, noise=1.0)
    expected = evaluate(truth, estimate, 5.0, 2, 2.0)
    without_kernels(monkeypatch)
    monkeypatch.setattr(certified_module, "kernels", None)
    monkeypatch.setattr(whole_lp_module, "INTERIOR", 50)
    result = evaluate(truth, estimate, 5.0, 2, 2.0, solver=Certified(jobs=1))
    assert result.solver["status"] == "solved"
    assert result.proof.bounds.upper == pytest.approx(expected.proof.bounds.upper, rel=1e-9)


@pytest.mark.parametrize("solver", [Certified(), Sinkhorn(epsilon=1e-5)])
@pytest.mark.parametrize("penalty", [0.0, 1e-12, 1.0, 1e100])
@pytest.mark.parametrize(("cutoff", "order"), [(1e80, 2.9), (3.0, 10.0), (1e5, 2.0)])
def test_extremes_raise_no_warning(
    solver: Certified | Sinkhorn, penalty: float, cutoff: float, order: float
) -> None:
    for steps in (1, 12):
        truth, estimate = scene(1, 4, 4, steps, side=4.0)
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            result = evaluate(truth, estimate, cutoff, order, penalty, solver=solver)
        assert result.proof.bounds.lower <= result.proof.bounds.upper


@compiled_only
def test_a_bracket_that_is_open_up_to_a_gap_of_one_says_so() -> None:
    """Errors of 1e-5, a cutoff of 100: the total is nearly 0, and a stopped run knows no more."""
    rng = np.random.default_rng(0)
    truth = rng.uniform(0, 3, (40, 8, 2))
    estimate = np.stack([states[rng.permutation(8)] for states in truth])
    estimate += rng.normal(0, 1e-5, truth.shape)
    exact = evaluate(truth, estimate, 100.0, 2, 1e-5)
    stopped = evaluate(truth, estimate, 100.0, 2, 1e-5, solver="sinkhorn", time_limit=1e-9)
    assert exact.total < 1e-6
    assert stopped.lower_bound <= exact.upper_bound
    assert stopped.relative_gap == pytest.approx(1)
    assert not stopped.certified
    assert stopped.proven == "proven; the total may be close to 0"
    assert stopped.claim.startswith("TGOSPA is between ")
    assert stopped.proven in stopped.to_html()
