"""The value of the regularised problem against other ways to the same number."""

import itertools

import numpy as np
import pytest

from tgospa_eval import Certified, Trajectories
from tgospa_eval.api.evaluate import evaluate_pair
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import DISTANCES
from tgospa_eval.evaluation.prepare import PreparedPair, fit, prepare
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.solvers.sinkhorn import Trace, entropic_trace, gains

pytestmark = pytest.mark.skipif(not kernels, reason="sweeps need the compiled kernels")


def prepared(x: np.ndarray, y: np.ndarray, **parameters: float) -> PreparedPair:
    """Tracks (T, m, d) and (T, n, d)."""
    request = EvaluationRequest(
        parameters=Parameters(**parameters), distance=DISTANCES["euclidean"], solver=Certified()
    )
    sides = fit(Trajectories.from_array(x), Trajectories.from_array(y), request)
    return prepare(sides, request, stopwatch=Stopwatch())


def trace(problem: PreparedPair, epsilon: float) -> Trace:
    return entropic_trace(problem.states, epsilon, lambda: False)


def by_paths(x: np.ndarray, y: np.ndarray, epsilon: float, c: float, p: float, g: float) -> float:
    """Every path of every truth spelt out, by an interior point method for entropy."""
    import cvxpy as cp

    (steps, m, _), n = x.shape, y.shape[1]
    cost = np.minimum(np.linalg.norm(x[:, :, None] - y[:, None], axis=3), c) ** p / c**p
    half = (g / c) ** p / 2
    paths = np.array(list(itertools.product(range(n + 1), repeat=steps)))  # n is none
    changes = (paths[:, 1:] != paths[:, :-1]) * (1 + ((paths[:, 1:] < n) & (paths[:, :-1] < n)))
    gain = np.pad(1 - cost, ((0, 0), (0, 0), (0, 1)))
    value = sum(gain[k][:, paths[:, k]] for k in range(steps)) - half * changes.sum(axis=1)
    theta, sigma = cp.Variable((m, len(paths))), cp.Variable((n, steps))
    loads = [
        cp.sum(theta[:, paths[:, k] == j]) + sigma[j, k] == 1
        for j in range(n)
        for k in range(steps)
    ]
    entropy = cp.sum(cp.entr(theta)) + cp.sum(cp.entr(sigma)) + cp.sum(sigma)
    problem = cp.Problem(
        cp.Maximize(cp.sum(cp.multiply(value, theta)) + epsilon * entropy),
        [cp.sum(theta, axis=1) == 1, *loads],
    )
    problem.solve(solver="CLARABEL", tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    return steps * (m + n) / 2 - problem.value


@pytest.mark.parametrize(
    ("m", "n", "steps", "epsilon", "p"),
    [(2, 2, 1, 0.3, 1), (2, 2, 3, 0.1, 1), (3, 2, 3, 0.03, 2), (2, 3, 2, 0.05, 2)],
)
def test_against_all_paths(m: int, n: int, steps: int, epsilon: float, p: float) -> None:
    rng = np.random.default_rng([m, n, steps])
    x, y = rng.uniform(0, 3, (steps, m, 2)), rng.uniform(0, 3, (steps, n, 2))
    problem = prepared(x, y, cutoff=5.0, order=p, switch_penalty=1.5)
    expected = by_paths(x, y, epsilon, 5.0, p, 1.5)
    last = trace(problem, epsilon)[-1]
    assert last["dual"] == pytest.approx(expected, rel=1e-6)
    assert last["primal"] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("epsilon", [0.5, 0.05, 0.002])
def test_one_pair_in_closed_form(epsilon: float) -> None:
    """Four paths of two steps, and nobody competes."""
    x, y = np.zeros((2, 1, 1)), np.array([[[1.0]], [[2.0]]])
    problem = prepared(x, y, cutoff=4.0, order=1.0, switch_penalty=2.0)
    first, second, half = 0.75, 0.5, 0.25
    values = np.array([0.0, first + second, first - half, second - half])
    masses = np.exp((values - values.max()) / epsilon)
    expected = 2 - values.max() - epsilon * np.log(masses.sum())
    (last,) = trace(problem, epsilon)[-1:]
    for name in ("primal", "dual"):
        assert last[name] == pytest.approx(expected, rel=1e-12)
    assert last["cost"] == pytest.approx(2 - masses @ values / masses.sum(), rel=1e-12)


def test_it_goes_to_the_total() -> None:
    """As the temperature falls the value and its cost approach the exact total; cost from above."""
    rng = np.random.default_rng(4)
    x = np.cumsum(rng.normal(size=(12, 4, 2)), axis=0)
    y = x[:, [1, 0, 3, 2]] + 0.3 * rng.normal(size=x.shape)
    x[3:5, 1] = x[8:, 2] = np.nan
    problem = prepared(x, y, cutoff=2.0, order=2.0, switch_penalty=2.0)
    request = EvaluationRequest(
        parameters=problem.parameters, distance=DISTANCES["euclidean"], solver=Certified()
    )
    sides = fit(Trajectories.from_array(x), Trajectories.from_array(y), request)
    total = evaluate_pair(sides, request, Stopwatch()).total / problem.parameters.scale
    far = []
    for epsilon in (0.1, 0.03, 0.01, 0.002):
        history = trace(problem, epsilon)
        last = history[-1]
        assert last["cost"] >= total * (1 - 1e-4)
        far.append((abs(last["dual"] - total), abs(last["cost"] - total)))
        own = [look["dual"] for look in history if look["epsilon"] == epsilon]
        assert (np.diff(own) >= -1e-3 * total).all()  # over-relaxed, and all but monotone
    assert (np.diff(far, axis=0) < 0).all()
    assert far[-1][0] < 0.02 * total
    assert far[-1][1] < 1e-3 * total


def test_the_dual_is_a_bound_at_any_prices() -> None:
    rng = np.random.default_rng(6)
    x, y = rng.uniform(0, 3, (2, 5, 3, 2))
    problem = prepared(x, y, cutoff=4.0, order=1.0, switch_penalty=1.0)
    best = 3 * 5 - trace(problem, 0.1)[-1]["dual"]
    for _ in range(20):
        prices = rng.exponential(0.5, len(problem.states.columns.step))
        assert gains(problem.states, prices, 0.1)[1] >= best - 1e-9
