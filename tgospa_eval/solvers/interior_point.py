"""Interior point methods for programmes whose optimum is fractional nearly everywhere.

    maximise  c w - paid r    with  A w - r + s = b,   w, r, s >= 0

The variables w are weights, s are the slacks of the constraints, and some constraints have a *rise*
r. Below, *numbers* are w, r and s. Each number has a dual. The dual of w or r is its reduced cost.
The dual of s is the dual y of its constraint.

A basis of such an optimum is degenerate thousands of times. The simplex method needs an iteration
for each degenerate variable. An interior point method needs about twenty factorisations in all.

There are many optimal duals y. Those nearest to the known duals are also best for the states
outside the programme, so y is drawn to the known duals. This perturbs b by a thousandth of the
distance. Near the end, y is drawn to its value in the iteration before instead (the proximal point
method), which does not perturb the solution.

A *round* is one call of `solve_nearest`. In a first round `exact` is False, in a last round True.

Sources: Mehrotra, "On the implementation of a primal-dual interior point method" (SIAM Journal on
Optimization 1992); Gondzio, "Multiple centrality corrections in a primal-dual method for linear
programming" (Computational Optimization and Applications 1996). The regularisation is that of
Friedlander and Orban, "A primal-dual regularized interior-point method for convex quadratic
programs" (Mathematical Programming Computation 2012).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import qdldl
from scipy import sparse

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass

START, MIN_START = 10.0, 1e-4
"""At the start, the product of each number and its dual is START times the mean product at the
given point, and at least MIN_START. The mean product at the given point is 1e-4 in a first round
and 1e-6 in a last one. With 1e-5 as MIN_START, a round takes up to a third more iterations."""

ENOUGH, END, LACK = 1e-8, 1e-17, 1e-13
"""Limits of the mean product of a number and its dual, in c^p, and of the errors of constraints.
A first round ends at ENOUGH. A last round ends at END, if all errors of constraints are at most
LACK. Until the mean product is ENOUGH, y is drawn to the known duals. With 1e-7 as ENOUGH, less is
proven, and a last round is longer."""

PULL = 1e-3
"""Stiffness with which y is drawn to other duals. With 1e-2, a first round proves less, and a last
round may take twice the iterations. 1e-4 is as good as 1e-3."""

MAX_ITERATIONS, MIN_STEP, SHORT = 50, 1e-4, 0.01
"""The method gives up after MAX_ITERATIONS (10 to 25 iterations are usual), or if the steps of
numbers and of duals are both shorter than MIN_STEP. If the mean product is at most END, a step
shorter than SHORT means that only rounding is left."""

PRIMAL_SHIFT = 1e-9
"""Number that is added to the diagonal D. Without it, systems would be singular at the end."""

CORRECTIONS, BETTER_STEP = 2, 0.02
"""Largest number of corrections of centrality after each factorisation. A correction is kept if the
sum of both step lengths increases by at least BETTER_STEP. A factorisation takes as long as ten
corrections."""

NEAR_BOUND = 0.99
"""Share that is taken of the longest step at which all numbers stay >= 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Inequalities:
    """The programme in the docstring of this module.

    Parameters
    ----------
    matrix : (m, n) sparse array
        A, by rows, in canonical form.
    full : (m,) float array
        b.
    reward : (n,) float array
        c.
    rises : (k,) int array
        The constraints that have a rise.
    paid : (k,) float array
        Price of each rise. The dual of its constraint is at most this price.
    """

    matrix: sparse.csr_array
    full: Floats
    reward: Floats
    rises: Ints
    paid: Floats


class _System:
    """Factors of ``[D A'; A -E]`` by QDLDL; D and E are diagonals that may change."""

    def __init__(self, matrix: sparse.csr_array) -> None:
        rows, columns = matrix.shape
        matrix.sort_indices()
        self.matrix, self.transposed = matrix, matrix.T.tocsr()
        count = np.diff(matrix.indptr) + 1
        first = np.concatenate((np.arange(columns + 1), columns + np.cumsum(count)))
        self.diagonal = np.concatenate((np.arange(columns), first[columns + 1 :] - 1))
        inner = np.ones(first[-1], bool)
        inner[self.diagonal] = False
        index, data = np.empty(first[-1], np.int32), np.zeros(first[-1])
        index[self.diagonal] = np.arange(columns + rows)
        index[inner], data[inner] = matrix.indices, matrix.data
        size = columns + rows
        self.upper = sparse.csc_matrix((data, index, first.astype(np.int32)), shape=(size, size))
        self.factors: Any = None

    def factor(self, first: Floats, second: Floats) -> None:
        """Factor the matrix with the diagonals D (`first`) and E (`second`)."""
        self.upper.data[self.diagonal] = np.concatenate((first, -second))
        if self.factors is None:
            self.factors = qdldl.Solver(self.upper, upper=True)
        else:
            self.factors.update(self.upper, upper=True)

    def solve(self, first: Floats, second: Floats) -> tuple[Floats, Floats]:
        """Return the solution for a right-hand side; both have two parts, as the matrix."""
        parts = self.factors.solve(np.concatenate((first, second)))
        return parts[: len(first)], parts[len(first) :]


def solve_nearest(
    p: Inequalities,
    start: tuple[Floats, Floats],
    stiff: Floats,
    late: Callable[[], bool],
    *,
    exact: bool,
) -> tuple[Floats, Floats] | None:
    """Return optimal w (n,), and optimal duals y (m,) that are nearly those nearest to the start.

    The nearest optimal duals minimise ``sum stiff (y - start)^2``. `start` has the w and y to start
    from. If `exact` is True, the solution is exact up to rounding. If not, the mean product is at
    most `ENOUGH`. The result is None if the computation breaks down, or if `late` returns True.
    """
    try:
        with np.errstate(all="ignore"):  # NaN and infinities are checked below
            solution = _iterate(_System(p.matrix), p, start, PULL * stiff, exact, late)
    except RuntimeError:  # QDLDL: a pivot is 0
        return None
    if solution is None or not all(np.isfinite(part).all() for part in solution):
        return None
    return solution[0][: len(p.reward)], solution[1][-len(p.full) :]


class _Newton:
    """Newton's equations at a point, which has w, rises and slacks, and their duals z, own and y.

    Parameters
    ----------
    system : _System
    p : Inequalities
    x, d : (n + k + m,) float arrays
        The point: numbers and their duals.
    centre, stiff : (m,) float arrays
        Values to which y is drawn, and stiffness of this pull.

    Attributes
    ----------
    mean : float
        Mean product of a number and its dual.
    """

    def __init__(
        self,
        system: _System,
        p: Inequalities,
        x: Floats,
        d: Floats,
        centre: Floats,
        stiff: Floats,
    ) -> None:
        self.system, self.rises, self.x, self.d = system, p.rises, x, d
        self.size, self.splits = len(p.reward), (len(p.reward), len(p.reward) + len(p.rises))
        (self.w, self.rise, slack), (z, self.own, self.y) = (
            np.split(x, self.splits),
            np.split(d, self.splits),
        )
        self.lack = p.full - system.matrix @ self.w - slack
        self.lack[p.rises] += self.rise
        self.lack += stiff * (self.y - centre)
        self.excess = p.reward - system.transposed @ self.y + z
        self.excess_rise = self.y[p.rises] + self.own - p.paid
        self.product = x * d
        self.mean = float(self.product.mean())
        self.first = z / self.w + PRIMAL_SHIFT
        self.second = slack / self.y + stiff
        self.second[p.rises] += self.rise / self.own

    def direction(self, change: Floats) -> tuple[Floats, Floats]:
        """Return the steps of numbers and duals that change their products by about `change`."""
        other = self.lack - change[self.splits[1] :] / self.y
        rising = change[self.splits[0] : self.splits[1]] + self.rise * self.excess_rise
        other[self.rises] += rising / self.own
        dw, dy = self.system.solve(change[: self.size] / self.w + self.excess, other)
        across = self.system.transposed @ dy - self.excess
        dd = np.concatenate((across, -dy[self.rises] - self.excess_rise, dy))
        dx = (change - self.x * dd) / self.d
        dx[: self.size] = dw
        return dx, dd

    def steps(self, dx: Floats, dd: Floats) -> tuple[float, float]:
        """Return the largest step lengths up to 1 at which numbers, and duals, stay >= 0."""
        return _step(self.x, dx), _step(self.d, dd)

    def best(self) -> tuple[Floats, Floats, float, float]:
        """Return the corrected directions of numbers and duals, and the lengths of their steps."""
        self.system.factor(self.first, self.second)
        x, d = self.x, self.d
        dx, dd = self.direction(-self.product)
        along, across = self.steps(dx, dd)
        ahead = float(((x + along * dx) * (d + across * dd)).mean())
        target = (ahead / self.mean) ** 3 * self.mean
        change = target - self.product - dx * dd
        dx, dd = self.direction(change)
        along, across = self.steps(dx, dd)
        for _ in range(CORRECTIONS):
            farther = x + min(1.08 * along + 0.08, 1.0) * dx
            farther *= d + min(1.08 * across + 0.08, 1.0) * dd
            more = np.clip(farther, 0.1 * target, 10 * target) - farther
            trial = change + np.maximum(more, -10 * target)
            better = self.direction(trial)
            lengths = self.steps(*better)
            if sum(lengths) < along + across + BETTER_STEP:
                break
            (dx, dd), (along, across), change = better, lengths, trial
        return dx, dd, along, across


def _iterate(
    system: _System,
    p: Inequalities,
    start: tuple[Floats, Floats],
    stiff: Floats,
    exact: bool,
    late: Callable[[], bool],
) -> tuple[Floats, Floats] | None:
    """Return the numbers and their duals at the optimum; None if it is not reached."""
    w, y = start
    slack = p.full - p.matrix @ w
    rise = np.maximum(-slack[p.rises], 0.0)
    slack[p.rises] += rise
    duals = system.transposed @ y - p.reward, p.paid - y[p.rises], y
    x, d = np.concatenate((w, rise, slack)), np.concatenate(duals)
    known = float((np.maximum(x, 0.0) * np.maximum(d, 0.0)).mean())
    x, d = _central(x, d, max(START * known, MIN_START))
    for _ in range(MAX_ITERATIONS):
        newton = _Newton(system, p, x, d, y, stiff)
        if newton.mean <= ENOUGH and not exact:
            return x, d
        if newton.mean <= END and np.abs(newton.lack).max() <= LACK:
            return x, d
        if late():
            return None
        dx, dd, along, across = newton.best()
        if not max(along, across) > MIN_STEP:  # also if it is NaN
            break
        if newton.mean <= END and min(along, across) < SHORT:
            break
        x = x + (along if along == 1 else NEAR_BOUND * along) * dx
        d = d + (across if across == 1 else NEAR_BOUND * across) * dd
        if newton.mean <= ENOUGH:
            y = d[-len(y) :]
    return (x, d) if newton.mean <= ENOUGH else None


def _central(x: Floats, d: Floats, product: float) -> tuple[Floats, Floats]:
    """Return positive numbers and duals with this product, and with the same differences as before.

    Negative numbers and duals count as 0 in the differences. If some are far below 0, a larger
    product is used.
    """
    wrong = np.maximum(-x, 0.0) + np.maximum(-d, 0.0)
    product = max(product, float(np.square(wrong).mean()))
    difference = np.maximum(x, 0.0) - np.maximum(d, 0.0)
    larger = 0.5 * (np.abs(difference) + np.sqrt(difference * difference + 4 * product))
    smaller = product / larger
    first = difference > 0
    return np.where(first, larger, smaller), np.where(first, smaller, larger)


def _step(x: Floats, dx: Floats) -> float:
    return 1.0 / max(1.0, -float((dx / x).min()))
