"""An interior point method for linear programmes whose best weights are mostly fractions.

    maximise  c w - paid r    with  A w - r + s = b,   w, r, s >= 0

The variables w are weights, and s are the slacks of the constraints. Some constraints have a rise
r, by which they may be exceeded at a price. `solvers.restricted_lp` explains constraint, slack,
dual, reduced cost and simplex method.

Below, *numbers* are w, r and s. Each number has a dual >= 0: for w or r the reduced cost, for s the
dual y of its constraint. At the optimum the product of each number and its dual is 0. The method
starts with positive numbers and duals, and makes all products smaller together. Each iteration is a
*Newton step*: it replaces the equations by linear ones, and solves these. For this, a large matrix
is *factored* (made a product of triangular matrices), which takes most of the time.

About twenty iterations are enough. The simplex method would need thousands, because in such
programmes most of its iterations do not improve anything.

There are many optimal duals y. Those nearest to the known duals are also best for the states
outside the programme. So y is *drawn* to the known duals: distance from them costs something. How
much is the *stiffness*. This changes b by a thousandth of the distance. Near the end, y is drawn to
its value in the iteration before instead, which does not change the solution (the proximal point
method).

A *round* is one call of `solve_nearest`. In a first round `exact` is False, in a last round True.

Sources: Mehrotra, "On the implementation of a primal-dual interior point method" (SIAM Journal on
Optimization 1992); Gondzio, "Multiple centrality corrections in a primal-dual method for linear
programming" (Computational Optimization and Applications 1996). The pull on y is that of
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
"""Product of each number and its dual at the start. It is START times the mean product at the given
point, and at least MIN_START. The mean product at the given point is about 1e-4 in a first round
and 1e-6 in a last one. With 1e-5 as MIN_START, a round takes up to a third more iterations."""

ENOUGH, END, LACK = 1e-8, 1e-17, 1e-13
"""Limits at which a round ends. A first round ends when the mean product of a number and its dual
is at most ENOUGH, in c^p. A last round ends when it is at most END, and all errors of constraints
are at most LACK. Until the mean product is ENOUGH, y is drawn to the known duals. With 1e-7 as
ENOUGH, less is proven, and a last round is longer."""

PULL = 1e-3
"""Stiffness with which y is drawn to other duals. With 1e-2, a first round proves less, and a last
round may take twice the iterations. 1e-4 is as good as 1e-3."""

MAX_ITERATIONS, MIN_STEP, SHORT = 50, 1e-4, 0.01
"""Limits at which the method stops: after MAX_ITERATIONS (10 to 25 iterations are usual), or if the
steps of numbers and of duals are both shorter than MIN_STEP. It then gives up, unless the mean
product is at most ENOUGH. If the mean product is at most END, a step shorter than SHORT means that
only rounding is left."""

PRIMAL_SHIFT = 1e-9
"""Number that is added to the diagonal D of the matrix (`_System`), which would be singular at the
end without it."""

CORRECTIONS, BETTER_STEP = 2, 0.02
"""Limits of the corrections of a step. After each factorisation, at most CORRECTIONS corrections
bring the products nearer to each other. A correction is kept if the sum of both step lengths
increases by at least BETTER_STEP. A factorisation takes as long as ten corrections."""

NEAR_BOUND = 0.99
"""Part that is taken of the longest step at which all numbers stay >= 0."""


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
    rises : (R,) int array
        Indices of the constraints that have a rise.
    paid : (R,) float array
        Price of each rise. The dual of its constraint is at most this price.
    """

    matrix: sparse.csr_array
    full: Floats
    reward: Floats
    rises: Ints
    paid: Floats


class _System:
    """Linear equations with the matrix ``[D A'; A -E]``, solved by QDLDL; D and E are diagonals."""

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
        """Return both parts of the solution for both parts of a right-hand side."""
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

    `start` has the w and y to start from. The nearest optimal duals minimise
    ``sum stiff (y - start)^2``. If `exact` is True, the method goes on until only rounding is left,
    if it can. In any case the mean product is at most `ENOUGH`. The result is None if the
    computation breaks down, or if `late` returns True.
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
    """The linear equations of a Newton step at a point.

    Parameters
    ----------
    system : _System
    p : Inequalities
    x, d : (n + R + m,) float arrays
        The point: the numbers w, rises and slacks, and their duals z, own and y.
    centre, stiff : (m,) float arrays
        Values to which y is drawn, and stiffness.

    Attributes
    ----------
    mean : float
        Mean product of a number and its dual.
    lack, excess, excess_rise : (m,), (n,), (R,) float arrays
        Errors of the equations of constraints, of the duals of w, and of the duals of rises.
    product : (n + R + m,) float array
        Product of each number and its dual.
    first, second : (n,), (m,) float arrays
        The diagonals D and E of the system.
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
        """Return which part, up to 1, of both steps keeps numbers, and duals, >= 0."""
        return _step(self.x, dx), _step(self.d, dd)

    def best(self) -> tuple[Floats, Floats, float, float]:
        """Return the corrected steps of numbers and duals, and the results of `steps` for them."""
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
    """Return positive numbers and duals, all with this product.

    The difference of each number and its dual stays, with negative ones counted as 0. If some are
    far below 0, a larger product is used.
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
