"""Other members of the metric family: a problem with the steps weighted, or objects that may exist.

One solver serves all: only the numbers A, B, D and lambda of a `Problem` change.
"""

from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import freeze
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.problem import Floats, Problem

LARGEST_WEIGHT, SMALLEST_WEIGHT = 1e100, 1e-100
"""Weights beyond these would drive costs out of the range of doubles."""

NEEDS_SYMMETRY = (
    "--existence use needs --rho 0.5: with other prices of missed and false targets no proof is "
    "known that the result is a metric"
)

ROUNDED = 6 * 2.0**-53
"""Relative error of products with weights: of each number no more than four are rounded."""

SMALLEST_COST = 1e-300
"""Weighted costs below this, near the end of the doubles, count as this much."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StepWeights:
    """What each step counts: the time-weighted metric (arXiv 2110.13444).

    Parameters
    ----------
    cost : (T,) float array
        Factor >= 0 of localisation, missed and false costs at each step.
    switch : (T - 1,) float array
        Factor >= 0 of the cost of switches between each step and the next.

    Raises
    ------
    ConfigError
        A weight is negative, not finite, too large or too small, or all are zero.
    """

    cost: Floats
    switch: Floats

    def __post_init__(self) -> None:
        freeze(self)
        for weights in (self.cost, self.switch):
            fine = (weights == 0) | ((weights >= SMALLEST_WEIGHT) & (weights <= LARGEST_WEIGHT))
            if not fine.all():
                raise ConfigError(
                    f"a weight of a step is {weights[~fine][0]:g}: must be 0 or from "
                    f"{SMALLEST_WEIGHT:g} to {LARGEST_WEIGHT:g}"
                )
        if len(self.cost) and not self.cost.any():
            raise ConfigError("all weights of steps are 0: nothing would count")


def weight_steps(problem: Problem, weights: StepWeights) -> Problem:
    """``A w(k), B w(k), D w(k), lambda w'(k)``: the same problem with its steps weighted.

    Pairs at steps of weight 0 have no gain and are left out.
    """
    factor = weights.cost[problem.entry_step]
    switch: Floats = problem.switch_price * weights.switch
    same = bool(len(switch)) and bool((switch == switch[0]).all())  # runs of steps stay one state
    largest = float(weights.cost.max(initial=0.0))
    return _repriced(
        replace(
            problem,
            switch_price=float(switch[0]) if same else switch,
            cost_slack=problem.cost_slack * largest,
            rounding=problem.rounding * largest,
        ),
        problem.truth_price * weights.cost[problem.truth_step],
        problem.estimate_price * weights.cost[problem.estimate_step],
        problem.cost * factor,
    )


def weight_existence(problem: Problem, truth: Floats, estimate: Floats) -> Problem:
    """``A r, B s, D min(r, s) + |r - s| / 2``: objects that exist with a probability.

    The LP of the probabilistic metric (arXiv 2506.15148); `problem` has A = B = 1/2. Where all
    exist for certain it is the same problem, to the last bit.

    The cost of a pair is an optimal transport between two Bernoulli densities, on the states and
    "none", which is c / 2^(1/p) from every state: what both have in common, min(r, s), is moved by
    d, and |r - s| to or from "none". So a pair gains min(r, s) (1 - D) by being assigned, and pairs
    of objects that do not exist gain nothing and are left out.

    Parameters
    ----------
    problem : Problem
        With all objects certain.
    truth, estimate : (R_truth,), (R_estimate,) float arrays
        Probabilities r and s.

    Raises
    ------
    ConfigError
        Prices of missed and false targets differ: nobody has proven that a metric.
    """
    if np.any(problem.truth_price != 0.5) or np.any(problem.estimate_price != 0.5):
        raise ConfigError(NEEDS_SYMMETRY)
    if (truth == 1).all() and (estimate == 1).all():
        return problem
    first, second = truth[problem.truth_row], estimate[problem.estimate_row]
    cost = np.minimum(first, second) * problem.cost + 0.5 * np.abs(first - second)
    certain = replace(problem, distance_power=problem.cost)
    return _repriced(certain, 0.5 * truth, 0.5 * estimate, cost)


def _repriced(
    problem: Problem, truth_price: Floats, estimate_price: Floats, cost: Floats
) -> Problem:
    """With other prices and costs, and without the pairs that gain nothing any more.

    Those that gain less than rounding cost as much as being unassigned, within ROUNDED.
    """
    lifted = (problem.cost > 0) & (cost < SMALLEST_COST)
    cost = np.where(lifted, SMALLEST_COST, cost)
    most = min(len(problem.truth_step), len(problem.estimate_step))
    unassigned = truth_price[problem.truth_row] + estimate_price[problem.estimate_row]
    kept = np.flatnonzero(unassigned - cost > 0)
    return replace(
        problem,
        truth_price=truth_price,
        estimate_price=estimate_price,
        truth_row=problem.truth_row[kept],
        estimate_row=problem.estimate_row[kept],
        cost=cost[kept],
        distance_power=None if problem.distance_power is None else problem.distance_power[kept],
        cost_error=problem.cost_error + ROUNDED,
        cost_slack=problem.cost_slack + (SMALLEST_COST * most if lifted.any() else 0.0),
    )
