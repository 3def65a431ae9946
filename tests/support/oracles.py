"""Independent references: slow, plain, and knowing nothing of solvers or certificates."""

import itertools

import numpy as np
from scipy import sparse
from scipy.optimize import linear_sum_assignment, linprog

from tgospa_eval.problem.problem import Problem

Array = np.ndarray


def norm(difference: Array, distance: str) -> Array:
    order = {"euclidean": 2, "manhattan": 1, "chebyshev": np.inf}[distance]
    return np.linalg.norm(difference, ord=order, axis=-1)


def dense_costs(
    truth: Array,
    estimate: Array,
    c: float,
    p: float,
    distance: str = "euclidean",
    rho: float = 0.5,
) -> Array:
    """D(k) of the definition, (T, m + 1, n + 1), in units of c^p."""
    steps, m, _ = truth.shape
    n = estimate.shape[1]
    costs = np.zeros((steps, m + 1, n + 1))
    for k in range(steps):
        x = ~np.isnan(truth[k]).any(axis=-1)
        y = ~np.isnan(estimate[k]).any(axis=-1)
        for i in range(m):
            for j in range(n):
                if x[i] and y[j]:
                    d = float(norm(truth[k, i] - estimate[k, j], distance))
                    costs[k, i, j] = min(d / c, 1.0) ** p
                elif x[i] or y[j]:
                    costs[k, i, j] = 1 - rho if x[i] else rho
        costs[k, :m, n] = (1 - rho) * x
        costs[k, m, :n] = rho * y
    return costs


def tgospa_lp(
    truth: Array,
    estimate: Array,
    c: float,
    p: float,
    gamma: float,
    distance: str = "euclidean",
    w1: Array | None = None,
    w2: Array | None = None,
    rho: float = 0.5,
) -> float:
    """Total cost (a p-th power) by the LP of the definition, with its dummy row and column.

    No reduction at all: (m + 1)(n + 1) T assignments and m n (T - 1) changes.
    """
    return programme(dense_costs(truth, estimate, c, p, distance, rho), c, p, gamma, w1, w2)


def programme(
    costs: Array,
    c: float,
    p: float,
    gamma: float,
    w1: Array | None = None,
    w2: Array | None = None,
) -> float:
    """The same of any costs D(k) (T, m + 1, n + 1), in units of c^p."""
    steps, m, n = costs.shape[0], costs.shape[1] - 1, costs.shape[2] - 1
    if not steps:
        return 0.0
    if w1 is not None:
        costs = costs * w1[:, None, None]
    price = np.full(steps - 1, 0.5 * (gamma / c) ** p)
    if w2 is not None:
        price = price * w2
    size = (m + 1) * (n + 1)
    w = np.arange(steps * size).reshape(steps, m + 1, n + 1)
    changes = steps * size + np.arange((steps - 1) * m * n).reshape(steps - 1, m, n)
    objective = np.concatenate((costs.ravel(), np.repeat(price, m * n)))
    rows, cols, vals, right = [], [], [], []
    count = 0
    for k in range(steps):
        for group in [*w[k, :m, :], *w[k, :, :n].T]:
            rows += [count] * len(group)
            cols += group.tolist()
            vals += [1.0] * len(group)
            right.append(1.0)
            count += 1
    equal = sparse.csr_array((vals, (rows, cols)), shape=(count, len(objective)))
    rows, cols, vals = [], [], []
    limits = 0
    for k, i, j in itertools.product(range(steps - 1), range(m), range(n)):
        for sign in (1.0, -1.0):
            rows += [limits] * 3
            cols += [w[k + 1, i, j], w[k, i, j], changes[k, i, j]]
            vals += [sign, -sign, -1.0]
            limits += 1
    below = sparse.csr_array((vals, (rows, cols)), shape=(limits, len(objective)))
    answer = linprog(
        objective,
        A_ub=below if limits else None,
        b_ub=np.zeros(limits) if limits else None,
        A_eq=equal if count else None,
        b_eq=right if count else None,
        bounds=(0, None),
        method="highs",
        options={"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9},
    )
    assert answer.status == 0, answer.message
    return float(answer.fun) * c**p


def gospa(truth: Array, estimate: Array, c: float, p: float, distance: str = "euclidean") -> float:
    """Sum over the steps of the GOSPA cost (alpha = 2), each by linear assignment."""
    total = 0.0
    for costs in dense_costs(truth, estimate, c, p, distance):
        d = costs[:-1, :-1]
        x, y = costs[:-1, -1] > 0, costs[-1, :-1] > 0
        gain = np.where(x[:, None] & y[None, :], 1.0 - d, 0.0)
        i, j = linear_sum_assignment(gain, maximize=True)
        total += 0.5 * (x.sum() + y.sum()) - gain[i, j].sum()
    return total * c**p


def static_assignment(truth: Array, estimate: Array, c: float, p: float) -> float:
    """Cost of the best assignment that never changes."""
    costs = dense_costs(truth, estimate, c, p)
    x, y = costs[:, :-1, -1] > 0, costs[:, -1, :-1] > 0
    gain = np.where(x[:, :, None] & y[:, None, :], 1.0 - costs[:, :-1, :-1], 0.0).sum(axis=0)
    i, j = linear_sum_assignment(gain, maximize=True)
    return (0.5 * (x.sum() + y.sum()) - gain[i, j].sum()) * c**p


def lagrangian_bound(problem: Problem, price: Array) -> float:
    """Lower bound of any prices (T, n) >= 0 of estimates, by a plain Viterbi over full steps.

    Straight from the row form: no runs, no components, no window.
    """
    gain = np.zeros((problem.steps, problem.truths, problem.estimates))
    gain[
        problem.entry_step,
        problem.truth_track[problem.truth_row],
        problem.estimate_track[problem.estimate_row],
    ] = problem.gain
    half = np.broadcast_to(problem.switch_price, max(problem.steps - 1, 0))
    bound = problem.truth_price.sum() + problem.estimate_price.sum() - price.sum()
    for i in range(problem.truths):
        value = np.concatenate(([0.0], gain[0, i] - price[0])) if problem.steps else np.zeros(1)
        for k in range(1, problem.steps):
            step = np.full((len(value), len(value)), 2.0 * half[k - 1])
            step[0, :] = step[:, 0] = half[k - 1]
            np.fill_diagonal(step, 0.0)
            reward = np.concatenate(([0.0], gain[k, i] - price[k]))
            value = (value[:, None] - step).max(axis=0) + reward
        bound -= value.max()
    return float(bound)


def cloud_distance(a: tuple[Array, Array], b: tuple[Array, Array], order: int) -> float:
    """Wasserstein distance of two clouds, points and weights, by a general linear programme."""
    costs = np.linalg.norm(a[0][:, None] - b[0][None], axis=-1) ** order
    n, m = costs.shape
    sums = np.vstack([np.kron(np.eye(n), np.ones(m)), np.kron(np.ones(n), np.eye(m))])
    found = linprog(costs.ravel(), A_eq=sums, b_eq=np.concatenate((a[1], b[1])))
    return float(max(found.fun, 0.0) ** (1 / order))
