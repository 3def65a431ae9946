"""Proof: bounds of the optimum from whatever a solver left, and the split of the cost.

Plain NumPy over the whole reduced problem; knows no solver, and no solver grades its own work.
Weights become integers (multiples of 2^-50) first, so that feasibility is checked, not estimated.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.paths import regrets
from tgospa_eval.problem import Floats, Ints, sum_by, sum_parts
from tgospa_eval.slots import PART, parts
from tgospa_eval.states import States
from tgospa_eval.weights import ONE, changes, make_feasible, row_parts, whole_weights

ROUNDING = 4 * 2.0**-53
"""Rounding allowance of a bracket, as a fraction of the sum of all unassigned prices."""


@dataclass(kw_only=True)
class Solution:
    """What a solver proposes; nothing in it is trusted.

    Parameters
    ----------
    weights : (S,) float array
        Assignment of each state, between 0 and 1.
    prices : (K,) float array
        Price of each column slot.
    status : str
        One sentence for the user.
    iterations : int
        Sweeps or simplex iterations.
    finished : bool
        False if a limit or a failure stopped the solver early.
    history : tuple of dict
        Convergence, one record per check.
    disposable : bool
        Whether nobody needs the arrays any more, so that the proof may write over them; it takes
        them away then.
    """

    weights: Floats
    prices: Floats
    status: str
    iterations: int = 0
    finished: bool = True
    history: tuple[dict[str, float], ...] = field(default=())
    disposable: bool = False

    def give_up(self) -> tuple[Floats, Floats]:
        """Weights and prices, which the solution holds no longer: they are large."""
        weights, prices = self.weights, self.prices
        self.weights = self.prices = np.zeros(0)
        return weights, prices


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Proven: ``lower <= optimum <= upper``, in units of c^p.

    Parameters
    ----------
    lower, upper : float
        The bracket; `upper` is the cost of a feasible assignment.
    allowance : float
        A bracket narrower than this is met: it is rounding.
    """

    lower: float
    upper: float
    allowance: float

    @property
    def relative_gap(self) -> float:
        """(upper - lower) / upper, 0 if upper is 0."""
        return (self.upper - self.lower) / self.upper if self.upper > 0 else 0.0

    def met(self, gap: float) -> bool:
        """Whether the bracket is as narrow as `gap`, relative, or as rounding allows."""
        return self.upper - self.lower <= max(gap * self.upper, self.allowance)


@dataclass(frozen=True, kw_only=True, eq=False)
class Breakdown:
    """Where the cost of a feasible assignment comes from, in units of c^p.

    Parameters
    ----------
    localisation, missed, false, switch : (T,) float arrays
        Cost at each step; a switch between two steps is booked at the later one.
    missed_count, false_count, switch_count : (T,) float arrays
        Unassigned existing objects, and half the total variation of the assignment.
    """

    localisation: Floats
    missed: Floats
    false: Floats
    switch: Floats
    missed_count: Floats
    false_count: Floats
    switch_count: Floats

    @property
    def total(self) -> float:
        """The whole cost."""
        return float((self.localisation + self.missed + self.false + self.switch).sum())


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Costs of the steps up to each of the T steps, in units of c^p.

    Parameters
    ----------
    lower, upper : (T,) float arrays
        Proven bounds.
    parts : (4, T) float array
        Localisation, missed, false and switch cost of the assignment that `upper` is the cost of.
    allowance : (T,) float array
        A bracket narrower than this is met: it is rounding.
    """

    lower: Floats
    upper: Floats
    parts: Floats
    allowance: Floats

    def met(self, gap: float) -> NDArray[np.bool_]:
        """Where the bracket is as narrow as `gap`, relative, or as rounding allows, (T,)."""
        met: NDArray[np.bool_] = self.upper - self.lower <= np.maximum(
            gap * self.upper, self.allowance
        )
        return met


def certify(states: States, solution: Solution) -> tuple[Bounds, Ints, Breakdown]:
    """Prove bounds from a proposed assignment and proposed prices.

    The upper bound U is the cost of the repaired assignment, summed in cost form. The lower bound
    is L = max(0, U - sum_i (best_i - own_i) - sum_s v_s (1 - load_s)): the Lagrangian bound of any
    prices v >= 0, in a form that does not cancel (docs/theory, "Certificate").

    Parameters
    ----------
    states : States
        What was solved.
    solution : Solution
        What is proposed.

    Returns
    -------
    Bounds
        In units of c^p.
    weights : (S,) int array
        The feasible assignment, in units of 1/ONE.
    Breakdown
        Its cost by step; sums to the upper bound.
    """
    weights, lost, breakdown = prove(states, solution)
    upper = breakdown.total
    problem = states.problem
    lower = min(max(upper - lost.sum(), 0.0), upper)
    allowance = ROUNDING * float(problem.truth_price.sum() + problem.estimate_price.sum())
    return Bounds(lower=float(lower), upper=upper, allowance=allowance), weights, breakdown


def prove(states: States, solution: Solution) -> tuple[Ints, Floats, Breakdown]:
    """What `certify` adds up, node by node.

    Returns
    -------
    weights : (S,) int array
        The feasible assignment, in units of 1/ONE.
    lost : (nodes,) float array
        What each row could gain at the prices, and what each column loses by idle slots.
    Breakdown
        Cost of the assignment.
    """
    given, prices = (
        solution.give_up()
        if solution.disposable
        else (solution.weights.copy(), solution.prices.copy())
    )
    given = np.require(given, np.float64, ["C", "W"])
    prices = np.require(prices, np.float64, ["C", "W"])
    weights = given.view(np.int64)
    lost = np.zeros(states.nodes)
    for low, high in states.cuts(PART):
        part, state, slot = states.between(low, high)
        node = slice(*np.searchsorted(states.node_block, (low, high)))
        whole_weights(given[state], weights[state])
        lost[node] = _regrets(part, weights[state], prices[slot])
    lost += sum_parts(prices, states.columns.first)
    del prices
    return weights, lost, break_down(states, weights)


def _regrets(states: States, weights: Ints, prices: Floats) -> Floats:
    """Make the weights feasible and the prices fair, in place; what each row loses by then.

    The prices become what is lost by leaving their slots idle.
    """
    loads = make_feasible(states, weights)
    np.fmax(prices, 0.0, out=prices)  # NaN becomes 0
    prices[prices > 1e100] = 0.0
    running = states.columns.running(prices)
    for part in parts(len(prices)):
        prices[part] *= (ONE - loads[part]) / ONE
    del loads
    regret = np.zeros(states.nodes)
    for rows, own in row_parts(states):
        value = rows.columns.spans(running)
        np.negative(value, out=value)
        regret += regrets(rows, value, weights[own])
    return regret


def break_down(states: States, weights: Ints) -> Breakdown:
    """Split the cost of a feasible assignment by step and kind; sums are exact in the weights."""
    problem, steps = states.problem, states.problem.steps

    localisation = np.zeros(steps)

    def unassigned(name: str) -> tuple[Floats, Floats]:
        """Cost and number of one side's unassigned objects at each step; one side at a time."""
        row, step, price = (getattr(problem, f"{name}_{of}") for of in ("row", "step", "price"))
        free = np.full(len(step), ONE)
        for part in parts(len(weights)):
            used = np.flatnonzero((weights[part] != 0) & (states.entry[part] >= 0))
            entry, whole = states.entry[part][used].astype(np.intp), weights[part][used]
            np.subtract.at(free, row[entry].astype(np.intp), whole)
            if name == "truth":
                paid = whole / ONE * problem.cost[entry]
                np.add(localisation, sum_by(states.begin[part][used], paid, steps), localisation)
        cost, count = np.zeros(steps), np.zeros(steps)
        for part in parts(len(free)):
            left = np.flatnonzero(free[part])
            at, share = step[part][left].astype(np.intp), free[part][left] / ONE
            np.add.at(count, at, share)
            np.add.at(cost, at, share * price[part][left])
        return cost, count

    missed, false = unassigned("truth"), unassigned("estimate")
    moved, amount = changes(states, weights)
    variation = sum_by(states.begin[moved], amount, steps)
    return Breakdown(
        localisation=localisation,
        missed=missed[0],
        false=false[0],
        switch=variation * problem.crossing_price[:-1],
        missed_count=missed[1],
        false_count=false[1],
        switch_count=0.5 * variation,
    )
