"""What a result claims, judged by the exact optimum: no tolerance, no rounding."""

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from exact_lp import TINIEST, Optimum, optimum
from far_scenes import FarScene

from tgospa_eval import Certified, ConfigError, Result, evaluate
from tgospa_eval.solvers import Solver

GAP = Fraction(1, 10**9)
"""A number called exact is within this fraction of the optimum, as costs."""

LIMIT = 600.0
"""Seconds for one scene, many times what any of the tests takes on an idle machine."""

NARROW = 1e-24
"""Width of the reference where it is not zero: instances that are not tiny."""

SLACK = 2.0**-46
"""Of the largest coordinate: a metric of that size may come from the last places of the input."""


@dataclass(frozen=True)
class Judgement:
    """Every fault is one that is certain, whatever the width of the reference.

    Parameters
    ----------
    certified, within_rounding : bool
        As the result says.
    off : float
        Relative difference of its value and the optimum, as costs; 0 if it may be none.
    above, below : float
        How far its lower bound is above, and its upper bound is below, the optimum, relative.
    gap : float
        Of its own bracket.
    excused : bool
        Whether a wide bracket may be called exact: the value is of the size of the last places of
        the coordinates.
    """

    certified: bool
    within_rounding: bool
    off: float
    above: float
    below: float
    gap: float
    excused: bool

    @property
    def wrong(self) -> bool:
        """Called exact, and off by more than `GAP`."""
        return self.certified and not self.excused and self.off > GAP

    @property
    def faults(self) -> list[str]:
        """In words."""
        found = []
        if self.wrong:
            found.append(f"called exact, but off by {self.off:.3g}")
        if self.above:
            found.append(f"the lower bound is above the optimum by {self.above:.3g}")
        if self.below:
            found.append(f"the upper bound is below the optimum by {self.below:.3g}")
        if self.certified and self.gap > GAP and not self.excused:
            found.append(f"called exact with a relative gap of {self.gap:.3g}")
        if self.within_rounding and not self.excused:
            found.append("excused by rounding, but the data determine the value")
        return found


def totals(result: Result) -> tuple[Fraction, Fraction]:
    """The proven bounds in units of c^p: the doubles that the result holds."""
    bounds = result.proof.bounds
    return Fraction(bounds.lower), Fraction(bounds.upper)


def judge(result: Result, scene: FarScene, reference: Optimum) -> Judgement:
    """The bounds as costs and the printed metric values, each against the optimum."""
    costs = reference.costs
    lower, upper = totals(result)
    lows = costs.of_share(lower)[0], costs.of_metric(result.lower_bound)[0]
    highs = costs.of_share(upper)[1], costs.of_metric(result.upper_bound)[1]
    value = costs.of_share(upper)
    within = bool(getattr(result, "within_rounding", False))
    return Judgement(
        certified=result.certified,
        within_rounding=within,
        off=max(
            _beyond(value[0], reference.upper, reference.upper),
            _beyond(reference.lower, value[1], reference.lower),
        ),
        above=max(_beyond(low, reference.upper, reference.upper) for low in lows),
        below=max(_beyond(reference.lower, high, reference.lower) for high in highs),
        gap=_number((upper - lower) / upper) if upper > 0 else 0.0,
        excused=within and result.upper_bound <= rounding_of(scene),
    )


def may_be_refused(reference: Optimum) -> bool:
    """Whether some cost is so far below c^p that it may be no double in its units, or no whole one.

    Such input may be refused with a message, instead of being computed in a safe form.
    """
    costs = reference.costs
    numbers = {int(low) for low in costs.low.ravel()} | {costs.switch[0]}
    smallest = min((number for number in numbers if number > 0), default=costs.cutoff[0])
    return costs.cutoff[1] > smallest << 900


def rounding_of(scene: FarScene) -> float:
    """The largest metric value that the last places of the coordinates can make."""
    pairs = min(scene.truth.shape[1], scene.estimate.shape[1]) * len(scene.truth)
    coordinates = np.concatenate([np.ravel(s) for s in (scene.truth, scene.estimate)])
    largest = float(np.nanmax(np.abs(coordinates), initial=0.0))
    return SLACK * largest * pairs ** (1 / scene.p)


def _beyond(value: Fraction | int, limit: Fraction | int, unit: Fraction | int) -> float:
    """How far the value is above the limit, in units; 0 if it is not."""
    if value <= limit:
        return 0.0
    return _number(Fraction(value - limit) / Fraction(unit)) if unit else math.inf


def _number(share: Fraction) -> float:
    """As a double; above zero it stays there."""
    try:
        return float(share) or math.ulp(0.0) * (share > 0)
    except OverflowError:
        return math.inf


def claim(scene: FarScene, solver: Solver | None = None) -> Result:
    """What is said of the scene; by default the certified solver says it."""
    return evaluate(
        scene.truth,
        scene.estimate,
        scene.c,
        scene.p,
        scene.gamma,
        distance=scene.distance,
        solver=solver or Certified(time_limit=LIMIT, jobs=1),
    )


def judged(scene: FarScene, solver: Solver | None = None) -> Judgement | None:
    """The judgement; None where the scene is refused, and may be."""
    reference = reference_of(scene)
    try:
        result = claim(scene, solver)
    except ConfigError:
        if may_be_refused(reference):
            return None
        raise
    return judge(result, scene, reference)


def reference_of(scene: FarScene) -> Optimum:
    """The optimum: exact for instances of few states, else to `NARROW`."""
    states = scene.truth.shape[0] * scene.truth.shape[1] * scene.estimate.shape[1]
    width = 0.0 if states <= TINIEST else NARROW
    return optimum(
        scene.truth, scene.estimate, scene.c, scene.p, scene.gamma, scene.distance, width
    )
