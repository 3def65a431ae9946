"""What others do: linear programmes as one writes them down, their code, and the floor below all.

Independent of the solvers of tgospa-eval.
"""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import linprog

Floats = NDArray[np.float64]

CUTOFF, ORDER, SWITCH_PENALTY = 5.0, 2.0, 2.0
SWITCH_PRICE = 0.5 * (SWITCH_PENALTY / CUTOFF) ** ORDER
"""Price of half a switch, in units of c^p."""

TIME_LIMIT = 1


def distance_table(truth: Floats, estimate: Floats) -> Floats:
    """All distances (T, m, n) at once, NaN where one is absent: the floor."""
    return np.linalg.norm(truth[:, :, None] - estimate[:, None], axis=-1)


def gain_programme(
    truth: Floats, estimate: Floats, *, presolve: bool, seconds: float
) -> float | None:
    """The metric by the linear programme in gain form, nothing merged, by SciPy's dual simplex.

    maximise sum_k <G(k), W(k)> - lambda sum_k |W(k+1) - W(k)| over W >= 0 with row and column sums
    of at most 1, for all pairs that gain at some step, in units of c^p. The metric is (unassigned
    prices - maximum)^(1/p). All of HiGHS at SciPy's defaults but for `presolve`; None when it took
    longer than `seconds`.
    """
    distance = distance_table(truth, estimate)
    table = 1.0 - np.minimum(np.nan_to_num(distance / CUTOFF, nan=1.0), 1.0) ** ORDER
    row, column = np.nonzero((table > 0).any(axis=0))
    gain = table[:, row, column]
    steps, pairs = gain.shape

    moves = (steps - 1) * pairs
    ones = np.ones(moves)
    step = sparse.diags_array([-ones, ones], offsets=[0, pairs], shape=(moves, steps * pairs))
    size = sparse.eye_array(moves)
    every = sparse.eye_array(steps)
    member = sparse.vstack(
        [sparse.csr_array((np.ones(pairs), (side, np.arange(pairs)))) for side in (row, column)]
    )
    capacity = sparse.kron(every, member)
    answer = linprog(
        np.concatenate((-gain.ravel(), np.full(moves, SWITCH_PRICE))),
        A_ub=sparse.block_array([[step, -size], [-step, -size], [capacity, None]], format="csc"),
        b_ub=np.concatenate((np.zeros(2 * moves), np.ones(capacity.shape[0]))),
        method="highs-ds",
        options={"presolve": presolve, "time_limit": seconds},
    )
    if answer.status == TIME_LIMIT:
        return None
    if answer.status != 0:
        raise RuntimeError(f"linprog failed: {answer.message}")
    return _root(0.5 * (_present(truth).sum() + _present(estimate).sum()) + answer.fun)


def naive_programme(truth: Floats, estimate: Floats) -> float:
    """The metric by the linear programme of the definition in CVXPY, solved by Clarabel.

    minimise sum_k <D(k), W(k)> + lambda sum_k |W(k+1) - W(k)| over W(k) >= 0 of size (m+1) x (n+1)
    whose first m rows and first n columns each sum to 1, in units of c^p.
    """
    import cvxpy as cp  # lazy: it takes a second, and only this function needs it

    steps, m, n = len(truth), truth.shape[1], estimate.shape[1]
    x, y = _present(truth), _present(estimate)
    near = np.minimum(np.nan_to_num(distance_table(truth, estimate) / CUTOFF, nan=1.0), 1.0)
    cost = np.zeros((steps, m + 1, n + 1))
    both = x[:, :, None] & y[:, None, :]
    either = x[:, :, None] | y[:, None, :]
    cost[:, :m, :n] = np.where(both, near**ORDER, 0.5 * either)
    cost[:, :m, n] = 0.5 * x
    cost[:, m, :n] = 0.5 * y

    index = np.arange((m + 1) * (n + 1)).reshape(m + 1, n + 1)
    pairs = index[:m, :n].ravel()
    rows = np.zeros((index.size, m))
    columns = np.zeros((index.size, n))
    rows[index[:m], np.arange(m)[:, None]] = 1.0
    columns[index[:, :n], np.arange(n)] = 1.0
    weight = cp.Variable((steps, index.size), nonneg=True)
    switches = cp.sum(cp.abs(weight[1:, pairs] - weight[:-1, pairs]))
    total = cp.sum(cp.multiply(cost.reshape(steps, -1), weight)) + SWITCH_PRICE * switches
    problem = cp.Problem(
        cp.Minimize(total),
        [weight @ sparse.csc_array(rows) == 1.0, weight @ sparse.csc_array(columns) == 1.0],
    )
    problem.solve(solver=cp.CLARABEL)
    if problem.status != cp.OPTIMAL:
        raise RuntimeError(f"Clarabel: {problem.status}")
    return _root(float(problem.value))


def published_code(truth: Floats, estimate: Floats) -> Callable[[], float]:
    """The metric by the Python code of its authors, which must be importable: ready to run.

    It gives `numpy.arange` arrays of one number, which NumPy 2.4 and later refuse: here it may.
    """
    import TGOSPAMetric
    from utils import Trajectory

    def arange(*numbers: Any, **step: Any) -> Any:
        return np.arange(*map(np.squeeze, numbers), **step)

    def tracks(states: Floats) -> Any:
        present = _present(states)
        first, behind = present.argmax(axis=0), len(present) - present[::-1].argmax(axis=0)
        return Trajectory(np.moveaxis(states, 2, 0), first + 1, behind - first)

    TGOSPAMetric.np = SimpleNamespace(**{**vars(np), "arange": arange})
    sides = tracks(truth), tracks(estimate)
    return lambda: TGOSPAMetric.LPTrajMetric_Cluster(*sides, CUTOFF, ORDER, SWITCH_PENALTY)[0]


def stone_soup_gospa(truth: Floats, estimate: Floats) -> Callable[[], float]:
    """GOSPA of each step by Stone Soup, as the root of the sum of their powers: ready to run.

    It pays no switches: this is the metric for a switch penalty of zero.
    """
    from stonesoup.metricgenerator.ospametric import GOSPAMetric
    from stonesoup.types.state import State
    from stonesoup.types.track import Track

    clock = [datetime(2000, 1, 1, tzinfo=UTC) + timedelta(seconds=k) for k in range(len(truth))]

    def track(states: Floats) -> Track:
        present = np.flatnonzero(_present(states))
        return Track([State(states[k], timestamp=clock[k]) for k in present])

    metric = GOSPAMetric(p=ORDER, c=CUTOFF)
    sides = [[track(column) for column in np.moveaxis(side, 1, 0)] for side in (estimate, truth)]

    def run() -> float:
        states = (part for side in sides for part in metric.extract_states(side, return_ids=True))
        found = metric.compute_over_time(*states).value
        return float(sum(step.value["distance"] ** ORDER for step in found) ** (1 / ORDER))

    return run


def _present(states: Floats) -> NDArray[np.bool_]:
    """Whether each object exists at each step, (T, k)."""
    return np.asarray(~np.isnan(states).any(axis=-1))


def _root(cost: float) -> float:
    """The metric, from a total in units of c^p."""
    return CUTOFF * max(float(cost), 0.0) ** (1 / ORDER)
