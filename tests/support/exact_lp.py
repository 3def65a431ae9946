"""The referee: the optimum of the TGOSPA linear programme in integers, without one rounding.

Coordinates, cutoff and switch penalty are doubles, hence integers in a common unit 2^-e; so their
differences, sums of squares and whole powers are integers too, and the claim that is checked is
one about the input, not about somebody's rounded costs. Where a cost is irrational (Euclidean
distance to an odd power, any other power) two integers enclose it that are at most 2 apart, in a
unit 2^200 times smaller.

The programme is that of the definition (docs/theory/metric.md), its absolute values split:

    minimise  sum_k <D(k), W(k)> + lambda sum_k <1, P(k) + M(k)>
    W(k) >= 0, (m + 1) x (n + 1), first m rows and first n columns sum to 1,
    P(k) - M(k) = W(k + 1) - W(k) on the first m rows and n columns, P, M >= 0.

Its dual has a number a_i(k) for each row, b_j(k) for each column and g_ij(k) for each change:

    maximise  sum a + sum b,  a_i(k) <= D_i0(k),  b_j(k) <= D_0j(k),  |g_ij(k)| <= lambda,
    a_i(k) + b_j(k) + g_ij(k - 1) - g_ij(k) <= D_ij(k).

Any feasible pair of solutions proves a bracket; both are checked, and their values summed, in
integers. HiGHS proposes them by iterative refinement (Gleixner, Steffy and Wolter, "Iterative
refinement for linear programming", 2016): it is given the exact reduced costs of the last dual in
units of what is wrong with the last pair, at a resolution at which doubles add without rounding,
and the answer corrects the dual. So any range of costs is solved to the last integer. Costs are
multiplied by `DIVISIBLE`, so that vertices of the dual are integers too where their determinant
divides it, and the bracket closes to nothing; `simplex` takes over where it does not.
"""

import decimal
import math
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import highspy
import numpy as np

Array = np.ndarray
Enclosure = tuple[int, int]

DIVISIBLE = math.lcm(*range(1, 13))
GUARD = 200
"""Binary digits of an irrational cost."""

SPARE = 12
"""Decimal digits beyond the point of powers that are no roots."""

RESOLUTION, CLAMP = 24, 44
"""HiGHS sees costs as multiples of 2^-24, up to 2^20: its tolerance of 1e-9 is no multiple."""

ROUNDS = 200
DENOMINATOR = 400
"""Largest denominator that a weight of a vertex is taken to have."""

SUPPORT = 1e-7
"""Weights above this are meant to be there."""

TINIEST = 40
"""Most states of pairs for which the textbook simplex is tried."""


class RefereeError(Exception):
    """The referee itself found no answer."""


# --- costs ----------------------------------------------------------------------------------------


def raised(base: Fraction | int, exponent: Fraction, bits: int) -> Enclosure:
    """Integers around base^exponent * 2^bits, base >= 0, at most 2 apart.

    They are equal where the power is an integer that roots can tell.
    """
    base = Fraction(base)
    if not base:
        return 0, 0
    if exponent.denominator == 1:
        power = base**exponent.numerator * 2**bits
        return math.floor(power), math.ceil(power)
    if exponent.denominator == 2:
        square = base**exponent.numerator * 4**bits
        low = math.isqrt(math.floor(square))
        return low, low + (low * low != square)
    # log2 of base and result, within 1 and order + 1
    size = base.numerator.bit_length() - base.denominator.bit_length()
    size = math.ceil(float(exponent) * (abs(size) + 1)) + bits
    digits = size * 31 // 100 + 2 * SPARE
    with decimal.localcontext(prec=digits) as context:
        context.Emax, context.Emin = decimal.MAX_EMAX, decimal.MIN_EMIN

        def of(number: Fraction) -> decimal.Decimal:
            return decimal.Decimal(number.numerator) / decimal.Decimal(number.denominator)

        # ln and exp are rounded correctly; with |exponent ln base| < 10^5 the relative error of the
        # power is below 10^(6 - digits).
        value = Fraction((of(exponent) * of(base).ln()).exp()) * 2**bits
    error = value / 10 ** (digits - SPARE)
    return max(math.floor(value - error), 0), math.ceil(value + error)


def scaled(values: Array, exponent: int) -> Array:
    """Doubles times 2^exponent as integers, None for NaN."""

    def one(value: float) -> int | None:
        if math.isnan(value):
            return None
        numerator, denominator = value.as_integer_ratio()
        return numerator * (2**exponent // denominator)

    values = np.asarray(values, float)
    found = np.empty(values.shape, object)
    found.ravel()[:] = [one(value) for value in values.ravel().tolist()]
    return found


def exponent_of(*values: Array) -> int:
    """Smallest e >= 0 for which all values times 2^e are integers."""
    numbers = np.concatenate([np.ravel(np.asarray(value, float)) for value in values])
    numbers = np.unique(numbers[np.isfinite(numbers)]).tolist()
    return max([x.as_integer_ratio()[1].bit_length() - 1 for x in numbers], default=0)


@dataclass(frozen=True, eq=False)
class Costs:
    """Costs D(k) of the definition and lambda, as integers that enclose them, in one unit.

    The unit is 2^(-exponent * order - bits) / DIVISIBLE: not always a rational number, which does
    not matter, for all costs, and the cutoff, have it.

    Parameters
    ----------
    low, high : (T, m + 1, n + 1) object arrays of int
    switch : pair of int
        gamma^p / 2.
    cutoff : pair of int
        c^p.
    """

    low: Array
    high: Array
    switch: Enclosure
    cutoff: Enclosure
    order: Fraction
    exponent: int
    bits: int

    def of_share(self, share: float) -> Enclosure:
        """Around `share` times c^p."""
        low, high = (Fraction(share) * power for power in self.cutoff)
        return math.floor(low), math.ceil(high)

    def of_metric(self, value: float) -> Enclosure:
        """Around the p-th power of a value in the units of the states."""
        low, high = raised(Fraction(value) * 2**self.exponent, self.order, self.bits)
        return DIVISIBLE * low, DIVISIBLE * high


def costs_of(
    truth: Array,
    estimate: Array,
    c: float,
    p: float,
    gamma: float,
    distance: str = "euclidean",
) -> Costs:
    """The costs of trajectories (T, m, d) and (T, n, d), NaN where they do not exist."""
    steps, m, dimension = truth.shape
    n = estimate.shape[1]
    order = Fraction(p)
    exponent = exponent_of(truth, estimate, np.array([c, gamma]))
    euclidean = distance == "euclidean" and dimension > 1
    rational = order.denominator == 1 and (not euclidean or order % 2 == 0)
    bits = 1 + (0 if rational else GUARD)  # 1: halves of powers are integers
    cutoff, penalty = scaled(np.array([c, gamma]), exponent).tolist()
    whole = raised(cutoff, order, bits)
    x, y = scaled(truth, exponent), scaled(estimate, exponent)
    there = [(side != None).all(axis=2) for side in (x, y)]  # noqa: E711  elementwise
    table = [np.zeros((steps, m + 1, n + 1), object) for _ in range(2)]
    reach = cutoff**2 if euclidean else cutoff
    power = order / 2 if euclidean else order
    for k in range(steps):
        for side, full in enumerate(whole):
            # One of the two exists: half the cutoff price, whatever the other is.
            half = full // 2 if side == 0 else -(-full // 2)
            ours = np.append(there[0][k], False)[:, None]
            theirs = np.append(there[1][k], False)[None, :]
            table[side][k][ours ^ theirs] = half
        for i in np.flatnonzero(there[0][k]):
            for j in np.flatnonzero(there[1][k]):
                sizes = [abs(a - b) for a, b in zip(x[k, i], y[k, j], strict=True)]
                if euclidean:
                    base = sum(size * size for size in sizes)
                else:
                    base = max(sizes) if distance == "chebyshev" else sum(sizes)
                pair = whole if base >= reach else raised(base, power, bits)
                table[0][k, i, j], table[1][k, i, j] = pair
    price = raised(penalty, order, bits)
    return Costs(
        low=table[0] * DIVISIBLE,
        high=table[1] * DIVISIBLE,
        switch=(DIVISIBLE * price[0] // 2, -(-DIVISIBLE * price[1] // 2)),
        cutoff=(DIVISIBLE * whole[0], DIVISIBLE * whole[1]),
        order=order,
        exponent=exponent,
        bits=bits,
    )


# --- proofs ---------------------------------------------------------------------------------------


def assignment_cost(costs: Costs, weights: Array, whole: int) -> int:
    """Value of W = weights / whole, weights (T, m, n) integers, in units of 1 / whole.

    Raises
    ------
    RefereeError
        It is not feasible.
    """
    rows, columns = whole - weights.sum(axis=2), whole - weights.sum(axis=1)
    if any((part < 0).any() for part in (weights, rows, columns)):
        raise RefereeError("the assignment is not feasible")
    m, n = weights.shape[1:]
    total = (costs.high[:, :m, :n] * weights).sum()
    total += (costs.high[:, :m, n] * rows).sum() + (costs.high[:, m, :n] * columns).sum()
    return int(total + costs.switch[1] * abs(weights[1:] - weights[:-1]).sum())


def dual_bound(costs: Costs, b: Array, g: Array) -> int:
    """Value of the dual of any b (T, n) and g (T - 1, m, n), made feasible, with the best a."""
    _, m, n = sizes(costs)
    b = np.minimum(b, costs.low[:, m, :n])
    a = costs.low[:, :m, n]
    if n:
        a = np.minimum(a, (reduced(costs, b, g)).min(axis=2))
    return int(a.sum() + b.sum())


def reduced(costs: Costs, b: Array, g: Array) -> Array:
    """D_ij(k) - b_j(k) - g_ij(k - 1) + g_ij(k) of feasible g, (T, m, n)."""
    _, m, n = sizes(costs)
    left = costs.low[:, :m, :n] - b[:, None, :]
    g = np.maximum(np.minimum(g, costs.switch[0]), -costs.switch[0])
    left[1:] -= g
    left[:-1] += g
    return left


# --- solution -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Optimum:
    """lower <= optimum <= upper, in the unit of the costs; equal where it is known exactly."""

    costs: Costs
    lower: Fraction
    upper: Fraction

    @property
    def exact(self) -> bool:
        """Whether there is no doubt at all."""
        return self.lower == self.upper

    @property
    def width(self) -> float:
        """Relative."""
        return float((self.upper - self.lower) / self.upper) if self.upper else 0.0

    @property
    def metric(self) -> float:
        """The metric as a double, for messages and for nothing else."""
        share = self.upper / self.costs.cutoff[0]
        base = Fraction(self.costs.cutoff[0], DIVISIBLE * 2**self.costs.bits)
        with decimal.localcontext(prec=60) as context:
            context.Emax, context.Emin = decimal.MAX_EMAX, decimal.MIN_EMIN
            total = share * base
            if not total:
                return 0.0
            value = decimal.Decimal(total.numerator) / decimal.Decimal(total.denominator)
            order = decimal.Decimal(self.costs.order.numerator) / self.costs.order.denominator
            return float((value.ln() / order).exp() / decimal.Decimal(2) ** self.costs.exponent)


@lru_cache(maxsize=32)
def matrix(steps: int, m: int, n: int) -> tuple[Array, Array, Array, int]:
    """Constraints by columns: starts, rows, values; and the number of rows.

    Columns: W (T, m, n), its last column (T, m), its last row (T, n), P, M (T - 1, m, n). Rows: the
    sums of rows (T, m), of columns (T, n), then W(k + 1) - W(k) - P(k) + M(k) = 0.
    """
    w = np.arange(steps * m * n).reshape(steps, m, n)
    rows = np.arange(steps * m).reshape(steps, m)
    columns = rows.size + np.arange(steps * n).reshape(steps, n)
    moves = rows.size + columns.size + np.arange(max(steps - 1, 0) * m * n).reshape(-1, m, n)
    first = w.size + np.arange(rows.size + columns.size + 2 * moves.size)
    parts = (
        (np.broadcast_to(rows[:, :, None], w.shape), w, 1.0),
        (np.broadcast_to(columns[:, None, :], w.shape), w, 1.0),
        (moves, w[1:], 1.0),
        (moves, w[:-1], -1.0),
        (np.arange(rows.size + columns.size), first[: rows.size + columns.size], 1.0),
        (moves, first[rows.size + columns.size :][: moves.size], -1.0),
        (moves, first[rows.size + columns.size :][moves.size :], 1.0),
    )
    row = np.concatenate([part[0].ravel() for part in parts])
    column = np.concatenate([part[1].ravel() for part in parts])
    value = np.concatenate([np.full(part[0].size, part[2]) for part in parts])
    order = np.lexsort((row, column))
    start = np.searchsorted(column[order], np.arange(w.size + first.size + 1))
    count = rows.size + columns.size + moves.size
    return start, row[order].astype(np.int32), value[order], count


class _Programme:
    """HiGHS with the constraints of one instance, to be solved for one objective after another."""

    def __init__(self, steps: int, m: int, n: int) -> None:
        start, row, value, count = matrix(steps, m, n)
        lp = highspy.HighsLp()
        lp.num_col_, lp.num_row_ = self.size, _ = len(start) - 1, count
        lp.col_cost_ = np.zeros(self.size)
        lp.col_lower_, lp.col_upper_ = np.zeros(self.size), np.full(self.size, np.inf)
        right = (np.arange(count) < steps * (m + n)).astype(float)
        lp.row_lower_, lp.row_upper_ = right, right
        lp.a_matrix_.format_ = highspy.MatrixFormat.kColwise
        lp.a_matrix_.start_, lp.a_matrix_.index_, lp.a_matrix_.value_ = start, row, value
        self.highs = highspy.Highs()
        for option, setting in (
            ("output_flag", False),
            ("presolve", "off"),
            ("solver", "simplex"),
            ("parallel", "off"),
            ("primal_feasibility_tolerance", 1e-9),
            ("dual_feasibility_tolerance", 1e-9),
        ):
            self.highs.setOptionValue(option, setting)
        self.highs.passModel(lp)
        self.every = np.arange(self.size, dtype=np.int32)

    def solve(self, objective: Array) -> tuple[Array, Array]:
        """Optimal columns and duals of the rows."""
        self.highs.changeColsCost(self.size, self.every, objective)
        self.highs.run()
        if self.highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            self.highs.clearSolver()
            self.highs.setOptionValue("simplex_strategy", 1)
            self.highs.run()
        answer = self.highs.getSolution()
        if not (answer.value_valid and answer.dual_valid):
            raise RefereeError(f"HiGHS: {self.highs.getModelStatus()}")
        self.highs.setOptionValue("simplex_strategy", 4)  # primal: the basis stays feasible
        return np.array(answer.col_value), np.array(answer.row_dual)


class _Dual:
    """Numbers a, b and g of the dual, integers, not yet feasible."""

    def __init__(self, costs: Costs) -> None:
        steps, m, n = sizes(costs)
        self.costs = costs
        self.a, self.b = np.zeros((steps, m), object), np.zeros((steps, n), object)
        self.g = np.zeros((steps - 1, m, n), object)

    def rest(self) -> Array:
        """Exact reduced costs of the columns of `matrix`."""
        low, price = self.costs.low, self.costs.switch[0]
        pairs = low[:, :-1, :-1] - self.a[:, :, None] - self.b[:, None, :]
        pairs[1:] -= self.g
        pairs[:-1] += self.g
        parts = (
            pairs,
            low[:, :-1, -1] - self.a,
            low[:, -1, :-1] - self.b,
            price + self.g,
            price - self.g,
        )
        return np.concatenate([part.ravel() for part in parts])

    def correct(self, step: Array) -> None:
        """Add to all."""
        a, b, g = np.split(step, np.cumsum([self.a.size, self.b.size]))
        self.a = self.a + a.reshape(self.a.shape)
        self.b = self.b + b.reshape(self.b.shape)
        self.g = self.g + g.reshape(self.g.shape)


def sizes(costs: Costs) -> tuple[int, int, int]:
    """T, m, n."""
    steps, m, n = costs.low.shape
    return steps, m - 1, n - 1


def solve(costs: Costs, width: Fraction = Fraction(0)) -> Optimum:
    """Bracket of the optimum, of relative width at most `width`, beside that of the costs.

    Parameters
    ----------
    costs : Costs
    width : Fraction
        0: until primal and dual value are equal.

    Raises
    ------
    RefereeError
        The bracket stayed wider.
    """
    steps, m, n = sizes(costs)
    if not (steps and m and n):
        alone = (Fraction(int(table.sum())) for table in (costs.low, costs.high))
        return Optimum(costs, *alone)
    programme, dual = _Programme(steps, m, n), _Dual(costs)
    # Lower costs than the true ones are not worth solving more precisely than they are known.
    blur = int((costs.high - costs.low).sum()) + _blur_of_switches(costs)
    rest, level = dual.rest(), _first_level(costs)
    found = Optimum(costs, Fraction(0), Fraction(int(costs.high.sum())))
    for _ in range(ROUNDS):
        shift = max(level.bit_length() - RESOLUTION, 0)
        seen = np.clip(rest >> shift, -(2**CLAMP), 2**CLAMP).astype(np.int64)
        columns, duals = programme.solve(seen * 2.0**-RESOLUTION)
        step = np.rint(duals * 2.0**RESOLUTION).astype(np.int64).astype(object)
        dual.correct(step << shift)
        value = _value(costs, columns[: steps * m * n].reshape(steps, m, n))
        bound = Fraction(dual_bound(costs, dual.b, dual.g))
        found = Optimum(costs, max(found.lower, bound), min(found.upper, value))
        rest = dual.rest()
        level = max(int(-rest.min()), int(rest[columns > SUPPORT].max(initial=0)))
        if found.upper - found.lower <= max(width * found.upper, blur):
            return found
        if not level:  # nothing is wrong with the floats, only with weights that are no fractions
            break
    if not blur and steps * m * n <= TINIEST:
        return Optimum(costs, *[simplex(costs)] * 2)
    raise RefereeError(f"a bracket of {found.width:.3g} is left open")


def _first_level(costs: Costs) -> int:
    """The largest cost below that of leaving both unassigned: what the answer is likely made of."""
    pairs = costs.high[:, :-1, :-1]
    return int(pairs[pairs < costs.cutoff[0] // 2].max(initial=0)) or costs.cutoff[0]


def _blur_of_switches(costs: Costs) -> int:
    """What the enclosure of lambda leaves unknown, at most."""
    steps, m, n = sizes(costs)
    return (costs.switch[1] - costs.switch[0]) * (steps - 1) * m * n


def _value(costs: Costs, columns: Array) -> Fraction:
    """Exact cost of the feasible assignment that the floats mean."""
    broken = np.flatnonzero((columns > 1e-9) & (columns < 1 - 1e-9))
    meant = {
        at: Fraction(value).limit_denominator(DENOMINATOR)
        for at, value in zip(broken.tolist(), columns.ravel()[broken].tolist(), strict=True)
    }
    whole = math.lcm(*(value.denominator for value in meant.values())) if meant else 1
    if whole > 2**60:
        whole, meant = 2**60, {}
    weights = np.rint(columns).astype(np.int64).astype(object) * whole
    for at in broken.tolist():
        value = meant.get(at, Fraction(float(columns.ravel()[at])))
        weights.ravel()[at] = math.floor(value * whole)
    for axis in (2, 1):
        over = np.maximum(weights.sum(axis=axis, keepdims=True) - whole, 0)
        for place in zip(*np.nonzero(over), strict=True):
            line = tuple(slice(None) if d == axis else p for d, p in enumerate(place))
            at = int(np.argmax(weights[line]))
            weights[line][at] -= over[place]
    return Fraction(assignment_cost(costs, weights, whole), whole)


def simplex(costs: Costs) -> Fraction:
    """The optimum by the simplex method of textbooks in rational numbers, with Bland's rule.

    Shares nothing with `solve` but the costs and the matrix; for the tiniest instances.
    """
    steps, m, n = sizes(costs)
    start, row, value, count = matrix(steps, m, n)
    size = len(start) - 1
    tableau = [[Fraction(0)] * size for _ in range(count)]
    for column in range(size):
        for at in range(start[column], start[column + 1]):
            tableau[row[at]][column] = Fraction(int(value[at]))
    changes = (count - steps * (m + n)) * 2
    objective = [
        Fraction(x)
        for x in (
            *costs.low[:, :m, :n].ravel(),
            *costs.low[:, :m, n].ravel(),
            *costs.low[:, m, :n].ravel(),
            *[costs.switch[0]] * changes,
        )
    ]
    # The last column and row of W, and P, are a feasible basis: nothing is assigned.
    basis = [steps * m * n + r for r in range(count)]
    for r in range(steps * (m + n), count):
        tableau[r] = [-x for x in tableau[r]]
    right = [Fraction(int(r < steps * (m + n))) for r in range(count)]
    return _pivot(tableau, right, basis, objective)


def _pivot(
    tableau: list[list[Fraction]],
    right: list[Fraction],
    basis: list[int],
    objective: list[Fraction],
) -> Fraction:
    """Primal simplex from a feasible basis of unit columns."""
    cost, total = list(objective), Fraction(0)
    for r, column in enumerate(basis):
        factor = cost[column]
        if factor:
            cost = [x - factor * y for x, y in zip(cost, tableau[r], strict=True)]
            total += factor * right[r]
    while True:
        enter = next((j for j, x in enumerate(cost) if x < 0), None)
        if enter is None:
            return total
        ratios = [
            (right[r] / line[enter], basis[r], r)
            for r, line in enumerate(tableau)
            if line[enter] > 0
        ]
        _, _, leave = min(ratios)
        pivot = tableau[leave][enter]
        tableau[leave] = [x / pivot for x in tableau[leave]]
        right[leave] /= pivot
        for r, line in enumerate(tableau):
            factor = line[enter]
            if r != leave and factor:
                tableau[r] = [
                    x - factor * y if y else x for x, y in zip(line, tableau[leave], strict=True)
                ]
                right[r] -= factor * right[leave]
        factor = cost[enter]
        cost = [x - factor * y if y else x for x, y in zip(cost, tableau[leave], strict=True)]
        total += factor * right[leave]
        basis[leave] = enter


def optimum(
    truth: Array,
    estimate: Array,
    c: float,
    p: float,
    gamma: float,
    distance: str = "euclidean",
    width: float = 0.0,
) -> Optimum:
    """The optimum of the input, in a bracket of that relative width or as narrow as it can be."""
    return solve(costs_of(truth, estimate, c, p, gamma, distance), Fraction(width))
