"""Crowds: everybody near everybody, the best weights fractional nearly everywhere."""

import numpy as np
import pytest
from examples import seeds
from scipy import sparse
from scipy.optimize import linprog

from tgospa_eval import Certified, Result, evaluate
from tgospa_eval.kernels import kernels
from tgospa_eval.solvers import interior_point, restricted_lp
from tgospa_eval.solvers.interior_point import Inequalities, solve_nearest
from tgospa_eval.solvers.tuning import CROWDS

compiled_only = pytest.mark.skipif(not kernels, reason="sweeps are compiled only")


def crowd(seed: int, targets: int = 80, steps: int = 15) -> tuple[np.ndarray, np.ndarray]:
    """Targets that walk in a square of 15, c three times smaller, and what is seen of them."""
    rng = np.random.default_rng(seed)
    truth = rng.uniform(0, 15, (1, targets, 2)) + rng.normal(0, 1, (steps, targets, 2)).cumsum(0)
    truth = np.abs(truth) % 15
    seen = truth + rng.normal(0, 2, truth.shape)
    seen[rng.random(seen.shape[:2]) < 0.1] = np.nan
    return truth, seen


def evaluated(sides: tuple[np.ndarray, np.ndarray]) -> Result:
    return evaluate(*sides, 5.0, 2, 2.0, solver=Certified(jobs=1))


@compiled_only
@pytest.mark.parametrize("seed", range(3))
def test_both_ways_prove_the_same(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The interior point method, and the simplex method."""
    used, solve = [], restricted_lp.solve_interior

    def noting(*given: object, exact: bool) -> object:
        used.append(solve(*given, exact=exact))  # type: ignore[arg-type]
        return used[-1]

    monkeypatch.setattr(restricted_lp, "solve_interior", noting)
    result = evaluated(crowd(seed))
    assert any(used)
    monkeypatch.setattr(CROWDS, "undecided", 2.0)
    count = len(used)
    other = evaluated(crowd(seed))
    assert len(used) == count
    assert result.certified
    assert other.certified
    assert result.total == pytest.approx(other.total, rel=1e-12)
    bounds = result.proof.bounds
    assert bounds.upper - bounds.lower <= 1e-12 * bounds.upper


@compiled_only
def test_numbers_that_break_down_are_left_to_the_simplex_method(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    total = evaluated(crowd(0)).total
    monkeypatch.setattr(interior_point, "solve_nearest", lambda *_, **__: None)
    result = evaluated(crowd(0))
    assert result.certified
    assert result.total == pytest.approx(total, rel=1e-12)


def programme(seed: int) -> Inequalities:
    """Rows and columns with room for one each, and absolute values of differences, at random."""
    rng = np.random.default_rng(seed)
    size, slots, arcs = 60, 25, 30
    row, column = rng.integers(0, slots, size), slots + rng.integers(0, slots, size)
    pairs = rng.permuted(np.tile(np.arange(size), (arcs, 1)), axis=1)[:, :2]
    entry = np.concatenate((np.ones(2 * size), np.tile([1.0, -1.0], arcs)))
    at = np.concatenate((row, column, np.repeat(2 * slots + np.arange(arcs), 2)))
    of = np.concatenate((np.tile(np.arange(size), 2), pairs.ravel()))
    total = 2 * slots + arcs
    matrix = sparse.csr_array((entry, (at, of)), shape=(total, size))
    full = np.where(np.arange(total) < 2 * slots, 1.0, 0.0)
    return Inequalities(
        matrix=matrix,
        full=full,
        reward=rng.uniform(0, 1, size),
        rises=2 * slots + np.arange(arcs),
        paid=rng.uniform(0.05, 0.3, arcs),
    )


@pytest.mark.parametrize("seed", seeds(8, 20))
def test_weights_are_best_and_duals_the_nearest(seed: int) -> None:
    """Against HiGHS; of the duals also that none on the way to another optimum is nearer."""
    p = programme(seed)
    rng = np.random.default_rng(seed)
    size, arcs, total = len(p.reward), len(p.paid), len(p.full)
    near, stiff = rng.uniform(0, 0.5, total), rng.choice([0.01, 1.0], total)
    found = solve_nearest(p, (np.full(size, 0.3), near), stiff, lambda: False, exact=True)
    assert found is not None
    weights, duals = found
    rise = np.zeros((total, arcs))
    rise[p.rises, np.arange(arcs)] = -1.0
    whole = sparse.hstack([p.matrix, sparse.csr_array(rise)])
    best = linprog(np.concatenate((-p.reward, p.paid)), A_ub=whole, b_ub=p.full)
    over = p.matrix @ weights - p.full
    paid = p.paid @ np.maximum(over[p.rises], 0.0)
    assert p.reward @ weights - paid == pytest.approx(-best.fun, rel=1e-12)
    over[p.rises] = 0.0
    assert over.max() <= 1e-12

    assert duals.min() >= 0
    assert np.all(p.matrix.T @ duals >= p.reward - 1e-10)
    assert np.all(duals[p.rises] <= p.paid + 1e-10)
    assert p.full @ duals == pytest.approx(-best.fun, rel=1e-12)
    other = -best.ineqlin.marginals
    slope = 2 * stiff * (duals - near) @ (other - duals)
    assert slope >= -1e-4
