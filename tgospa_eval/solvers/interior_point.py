"""Interior point methods for programmes of which the optimum is fractional nearly everywhere.

    maximise c w - paid r,  A w - r <= b,  w, r >= 0;    slacks s, and duals y >= 0 of A w - r <= b

A basis of such an optimum is degenerate thousands of times, and the simplex method takes an
iteration for each. Here some twenty factorisations give the weights, and once the strictly positive
ones are known, equations give them to the last digit. The best duals are far from unique: of all
that fit, states that the programme leaves out are best served by those nearest to what was known.

Mehrotra, "On the implementation of a primal-dual interior point method" (SIAM Journal on
Optimization 1992); Gondzio, "Multiple centrality corrections in a primal-dual method for linear
programming" (Computational Optimization and Applications 1996); regularised as in Friedlander and
Orban, "A primal-dual regularized interior-point method for convex quadratic programs" (Mathematical
Programming Computation 2012).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import qdldl
from scipy import sparse

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass

START, START_NEAREST = 1e-3, 1e-5
"""Products of a number and its dual at the start, for weights and for nearest duals. Weights take a
fourth more iterations from 1e-2, twice as many from 1e-4."""

END, END_NEAREST, ENOUGH = 1e-16, 1e-10, 1e-8
"""Mean products at the ends, and that which will do if numbers break down before. In c^p."""

MOST_ITERATIONS, LEAST_STEP = 50, 1e-4
"""Where numbers are given up: 10 to 30 iterations are usual."""

PRIMAL_SHIFT, DUAL_SHIFT = 1e-9, 1e-7
"""Added to the diagonals: duals of degenerate programmes are not unique, so that systems would be
singular at the end. With 1e-10 and 1e-8 they break down at products of 1e-9."""

CORRECTIONS, BETTER_STEP = 2, 0.02
"""Corrections of centrality for each factorisation, which takes as long as ten of them, and how
much longer steps have to become by one."""

NEAR_BOUND = 0.99
"""Share of the step to the nearest bound."""

REFINEMENTS, EXACT, LEAST_SCALE = 12, 1e-16, 1e-4
"""Refinements of equations, the residual that is small enough, and the least number that is taken
for the scale of its change."""

ABSENT = 1e12
"""The diagonal of what takes no part."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Inequalities:
    """The programme at the top.

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
        Its price, the largest dual there.
    """

    matrix: sparse.csr_array
    full: Floats
    reward: Floats
    rises: Ints
    paid: Floats


class _System:
    """``[D A'; A -E]``: factors by QDLDL, in one order for all diagonals D and E."""

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
        """Factor with the diagonals D and E."""
        self.upper.data[self.diagonal] = np.concatenate((first, -second))
        if self.factors is None:
            self.factors = qdldl.Solver(self.upper, upper=True)
        else:
            self.factors.update(self.upper, upper=True)

    def solve(self, first: Floats, second: Floats) -> tuple[Floats, Floats]:
        """Both parts of the solution for both parts of the right-hand side."""
        found = self.factors.solve(np.concatenate((first, second)))
        return found[: len(first)], found[len(first) :]

    def refined(
        self, first: Floats, second: Floats, diagonals: tuple[Floats | float, Floats | float]
    ) -> tuple[Floats, Floats]:
        """`solve` for other diagonals D and E than those that were factored."""
        x, y = np.zeros_like(first), np.zeros_like(second)
        for _ in range(REFINEMENTS):
            one = first - diagonals[0] * x - self.transposed @ y
            other = second - self.matrix @ x + diagonals[1] * y
            if max(np.abs(one).max(initial=0.0), np.abs(other).max(initial=0.0)) <= EXACT:
                break
            dx, dy = self.solve(one, other)
            x += dx
            y += dy
        return x, y


def solve_nearest(
    p: Inequalities, start: tuple[Floats, Floats], stiff: Floats, late: Callable[[], bool]
) -> tuple[Floats, Floats | None] | None:
    """The best w (n,), and of the best y (m,) those nearest to the start, or about so.

    ``minimise sum stiff (y - start)^2`` where complementary slackness holds. No y if numbers break
    down on the way there; nothing if they do before, or it is late.
    """
    try:
        with np.errstate(all="ignore"):  # numbers that break down are looked for
            weights, duals = _solve_nearest(p, start, stiff, late)
    except RuntimeError:  # of QDLDL: a pivot is 0
        return None
    if weights is None or not np.isfinite(weights).all():
        return None
    return weights, duals if duals is not None and np.isfinite(duals).all() else None


def _solve_nearest(
    p: Inequalities, start: tuple[Floats, Floats], stiff: Floats, late: Callable[[], bool]
) -> tuple[Floats | None, Floats | None]:
    found = _iterate(_System(p.matrix), p, start, START, late)
    if found is None:
        return None, None
    x, d = found
    size, arcs = len(p.reward), len(p.paid)
    positive = x > d
    used, rise, idle = positive[:size], positive[size : size + arcs], positive[size + arcs :]
    y = np.zeros(len(p.full))
    y[p.rises[rise]] = p.paid[rise]
    free = ~idle
    free[p.rises[rise]] = False
    tight = np.flatnonzero(free)
    part = p.matrix[tight]

    weights = np.zeros(size)
    chosen = np.flatnonzero(used)
    system = _System(part[:, chosen].tocsr())
    scale = np.maximum(x[chosen], LEAST_SCALE) ** -2.0
    system.factor(scale, np.full(len(tight), PRIMAL_SHIFT))
    lack = p.full[tight] - system.matrix @ x[chosen]
    weights[chosen] = x[chosen] + system.refined(np.zeros(len(chosen)), lack, (scale, 0.0))[0]
    np.maximum(weights, 0.0, out=weights)

    kept = free[p.rises]
    rest = Inequalities(
        matrix=part,
        full=np.zeros(len(tight)),
        reward=p.reward - p.matrix.T @ y,
        rises=np.searchsorted(tight, p.rises[kept]),
        paid=p.paid[kept],
    )
    system, near = _System(part), (np.zeros(size), start[1][tight])
    nearest = _iterate(system, rest, near, START_NEAREST, late, stiff=stiff[tight], free=used)
    if nearest is None:
        return weights, None
    duals = nearest[1][-len(tight) :]
    scale = np.maximum(duals, LEAST_SCALE) ** -2.0
    system.factor(np.where(used, PRIMAL_SHIFT, ABSENT), scale)
    wrong = np.where(used, system.transposed @ duals - rest.reward, 0.0)
    zero = np.zeros(len(tight))
    y[tight] = duals - system.refined(wrong, zero, (np.where(used, 0.0, ABSENT), scale))[1]
    return weights, np.maximum(y, 0.0)


class _Newton:
    """Newton's equations at a point: w, rises and slacks, and their duals z, own and y.

    Parameters
    ----------
    system : _System
    p : Inequalities
    x, d : (n + k + m,) float arrays
        The point.
    bounded : bool array
        What of it is not free.
    centre : tuple of (m,) float arrays, optional
        Where duals are drawn to, and how stiff.

    Attributes
    ----------
    mean : float
        Product of a number and its dual.
    """

    def __init__(
        self,
        system: _System,
        p: Inequalities,
        x: Floats,
        d: Floats,
        bounded: Mask,
        centre: tuple[Floats, Floats] | None,
    ) -> None:
        self.system, self.rises, self.x, self.d, self.bounded = system, p.rises, x, d, bounded
        self.size, self.cut = len(p.reward), (len(p.reward), len(p.reward) + len(p.rises))
        (w, self.rise, slack), (z, self.own, self.y) = np.split(x, self.cut), np.split(d, self.cut)
        self.lack = p.full - system.matrix @ w - slack
        self.lack[p.rises] += self.rise
        if centre is not None:
            self.lack += centre[1] * (self.y - centre[0])
        self.excess = p.reward - system.transposed @ self.y + z
        self.excess_rise = self.y[p.rises] + self.own - p.paid
        self.product = x * d
        self.mean = float(self.product.sum()) / np.count_nonzero(bounded)
        self.divisor = np.where(bounded, d, 1.0)
        self.weight = np.where(bounded[: self.size], w, 1.0)
        ratio = x / self.divisor
        self.first = z / self.weight + PRIMAL_SHIFT
        self.second = ratio[self.cut[1] :] + (DUAL_SHIFT if centre is None else centre[1])
        self.second[p.rises] += ratio[self.cut[0] : self.cut[1]]

    def direction(self, change: Floats) -> tuple[Floats, Floats]:
        """Steps of both after which products have changed so, to first order."""
        other = self.lack - change[self.cut[1] :] / self.y
        rising = change[self.cut[0] : self.cut[1]] + self.rise * self.excess_rise
        other[self.rises] += rising / self.own
        dw, dy = self.system.solve(change[: self.size] / self.weight + self.excess, other)
        across = self.system.transposed @ dy - self.excess
        dd = np.concatenate((across, -dy[self.rises] - self.excess_rise, dy)) * self.bounded
        dx = (change - self.x * dd) / self.divisor
        dx[: self.size] = dw
        return dx, dd

    def steps(self, dx: Floats, dd: Floats) -> tuple[float, float]:
        """The largest steps up to 1 after which nothing is negative."""
        some = self.bounded
        return _step(self.x[some], dx[some]), _step(self.d[some], dd[some])

    def best(self) -> tuple[Floats, Floats, float, float]:
        """Directions of both, predicted and corrected, and their steps."""
        self.system.factor(self.first, self.second)
        x, d, bounded = self.x, self.d, self.bounded
        dx, dd = self.direction(-self.product)
        along, across = self.steps(dx, dd)
        ahead = float(((x + along * dx) * (d + across * dd)).sum()) / np.count_nonzero(bounded)
        target = (ahead / self.mean) ** 3 * self.mean
        change = (target - self.product - dx * dd) * bounded
        dx, dd = self.direction(change)
        along, across = self.steps(dx, dd)
        for _ in range(CORRECTIONS):
            farther = x + min(1.08 * along + 0.08, 1.0) * dx
            farther *= d + min(1.08 * across + 0.08, 1.0) * dd
            more = np.clip(farther, 0.1 * target, 10 * target) - farther
            trial = (change + np.maximum(more, -10 * target)) * bounded
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
    product: float,
    late: Callable[[], bool],
    *,
    stiff: Floats | None = None,
    free: Mask | None = None,
) -> tuple[Floats, Floats] | None:
    """w, rises and slacks, and their duals at the end; None if that is not reached.

    With `stiff` duals are drawn to those of the start. Columns that are `free` have no bound.
    """
    size, (w, y) = len(p.reward), start
    slack = p.full - p.matrix @ w
    rise = np.maximum(-slack[p.rises], 0.0)
    slack[p.rises] += rise
    if stiff is not None:
        slack[:] = 0.0
    duals = system.transposed @ y - p.reward, p.paid - y[p.rises], y
    x, d = _central(np.concatenate((w, rise, slack)), np.concatenate(duals), product)
    bounded = np.ones(len(x), bool)
    if free is not None:
        bounded[:size] = ~free
        x[~bounded] = d[~bounded] = 0.0
    centre = None if stiff is None else (y, stiff)
    for _ in range(MOST_ITERATIONS):
        newton = _Newton(system, p, x, d, bounded, centre)
        if newton.mean <= (END if stiff is None else END_NEAREST):
            return x, d
        if late():
            return None
        dx, dd, along, across = newton.best()
        if not max(along, across) > LEAST_STEP:  # NaN too
            return (x, d) if newton.mean <= ENOUGH else None
        x = x + (along if along == 1 else NEAR_BOUND * along) * dx
        d = d + (across if across == 1 else NEAR_BOUND * across) * dd
    return None


def _central(x: Floats, d: Floats, product: float) -> tuple[Floats, Floats]:
    """Positive numbers with that product, or a larger one for wrong signs; differences stay."""
    wrong = np.maximum(-x, 0.0) + np.maximum(-d, 0.0)
    product = max(product, float(np.square(wrong).mean()))
    difference = np.maximum(x, 0.0) - np.maximum(d, 0.0)
    larger = 0.5 * (np.abs(difference) + np.sqrt(difference * difference + 4 * product))
    smaller = product / larger
    first = difference > 0
    return np.where(first, larger, smaller), np.where(first, smaller, larger)


def _step(x: Floats, dx: Floats) -> float:
    return float(np.where(dx < 0, -x / dx, 1.0).min(initial=1.0))
