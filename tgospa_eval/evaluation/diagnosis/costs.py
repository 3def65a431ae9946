"""Bounds of the per-step GOSPA cost of a few steps, for what a change of the data would save.

    cost = (m + n) / 2 - G,   G = max over disjoint pairs of sum 1 - (d / c)^p,   in units of c^p,

of m truths and n estimates (docs/theory/metric.md, "Identities"). The sums of the largest terms of
each truth and of each estimate bound G from above, a greedy choice from below. Assignments are
computed only where these bounds leave an answer open.
"""

from functools import cached_property

import numpy as np

from tgospa_eval.common.arrays import places_of
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance, near_pairs
from tgospa_eval.distances.points import near_points
from tgospa_eval.evaluation.diagnosis.pairing import (
    largest_gains,
    pair_off,
    ranked,
)
from tgospa_eval.evaluation.diagnosis.sample import FEWEST_STEPS, StepRows
from tgospa_eval.problem.problem import Floats
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.tracks.trajectories import Ints, Trajectories

DENSE = 1_000_000
"""Pairs of a step, near or not, up to which an assignment is computed."""

PAIRED = 12
"""Fewer pairs give no warning of a shift for their sake."""

FEWEST_TRACKS = 3
"""Tracks that must agree on a fault that is smaller than the cutoff: that of one may be its own
error."""

NOTABLE_COST = 1e-3
"""Of the cost of leaving all unassigned: less makes no warning, but about rounding."""

CHEAPER = 2 / 3
"""Share of the steps that a change must improve: a late start makes one step costly, not most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StepCosts:
    """Bounds of the per-step GOSPA costs, in units of c^p.

    Parameters
    ----------
    counts : pair of (T,) int arrays
        Truths and estimates at each step.
    objects : pair of int32 arrays
        Step of each truth and of each estimate, in order.
    rows : pair of (N,) int32 arrays
        Truth and estimate of each near pair, in order.
    gain : (N,) float array
        What each pair saves, 1 - (d / c)^p.
    """

    counts: tuple[Ints, Ints]
    objects: tuple[Ints, Ints]
    rows: tuple[Ints, Ints]
    gain: Floats

    @property
    def steps(self) -> int:
        """How many."""
        return len(self.counts[0])

    @cached_property
    def step(self) -> Ints:
        """Of each pair."""
        return self.objects[0][self.rows[0]]

    @cached_property
    def unassigned(self) -> Floats:
        """The costs without any pair (T,)."""
        return np.float64(0.5) * (self.counts[0] + self.counts[1])

    @cached_property
    def lower(self) -> Floats:
        """As if each truth, or each estimate, had its largest gain (T,)."""
        most = largest_gains(self.objects, self.rows, self.gain, self.steps)
        return np.asarray(self.unassigned - most)

    @cached_property
    def upper(self) -> Floats:
        """Of the greedy choice (T,)."""
        return np.asarray(self.unassigned - self._greedy[0])

    @cached_property
    def taken(self) -> Ints:
        """Pairs of the greedy choice, in order."""
        return places_of(self._greedy[1])

    @property
    def ranked(self) -> Ints:
        """The same in the order in which they are chosen."""
        return ranked(self._greedy[1], self.gain)

    @cached_property
    def _greedy(self) -> tuple[Floats, Ints]:
        return pair_off(self.objects, self.rows, self.gain, self.steps)

    def settle(self) -> None:
        """Make the bounds equal by assignments, but for steps too large for a dense one."""
        from scipy.optimize import linear_sum_assignment  # here: slow to import, hardly ever needed

        for step in np.flatnonzero(self.lower < self.upper).tolist():
            pairs = slice(*np.searchsorted(self.step, [step, step + 1]).tolist())
            axes = [np.unique(rows[pairs], return_inverse=True)[1] for rows in self.rows]
            shape = [int(axis.max()) + 1 for axis in axes]
            if shape[0] * shape[1] > DENSE:
                continue
            gain = np.zeros(shape)
            gain[axes[0], axes[1]] = self.gain[pairs]
            best = gain[linear_sum_assignment(gain, maximize=True)].sum()
            self.lower[step] = self.upper[step] = self.unassigned[step] - best


def step_costs(
    truth: StepRows, estimate: StepRows, parameters: Parameters, distance: Distance
) -> StepCosts:
    """Of as many steps of two sides, by a base distance of states without covariances."""
    cutoff = parameters.cutoff
    pairs = near_points(
        (truth.side, estimate.side), (truth.bounds, estimate.bounds), cutoff, distance
    ) or near_pairs(truth.table, estimate.table, cutoff, distance)
    return StepCosts(
        counts=(truth.counts, estimate.counts),
        objects=(truth.step, estimate.step),
        rows=(pairs.truth_row, pairs.estimate_row),
        gain=1 - (pairs.distance / cutoff) ** parameters.order,
    )


class Sampler:
    """What two sides cost at steps that are asked for.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate on one grid.
    parameters : Parameters
        Cutoff and order.
    distance : Distance
        Base distance of states without covariances.
    """

    def __init__(
        self, sides: tuple[Trajectories, Trajectories], parameters: Parameters, distance: Distance
    ) -> None:
        self.sides, self.parameters, self.distance = sides, parameters, distance
        self._last: tuple[bytes, StepCosts] | None = None

    def costs(self, steps: Ints, *, keep: bool = False) -> StepCosts:
        """At these steps; what is kept is for who asks for the same steps next, and not changed."""
        key, last = steps.tobytes(), self._last
        self._last = None
        if last is not None and last[0] == key:
            return last[1]
        truth, estimate = (StepRows.of(side, steps) for side in self.sides)
        found = step_costs(truth, estimate, self.parameters, self.distance)
        if keep:
            self._last = key, found
        return found


def saving(here: StepCosts, there: StepCosts, fewest: int = FEWEST_STEPS) -> float:
    """Share of the cost here that goes away there; 0 unless it is at least a half of most steps.

    `fewest` is the number of steps, of which half must become cheaper. Objects that are not looked
    at there are taken to cost what objects without counterpart do: to look away saves nothing.
    """
    unseen = max(0.0, float(here.unassigned.sum() - there.unassigned.sum()))
    if 2 * (there.lower.sum() + unseen) > here.upper.sum():
        return 0.0
    if 2 * (there.upper.sum() + unseen) > here.lower.sum():
        here.settle()
        there.settle()
    saved = 1 - (float(there.upper.sum()) + unseen) / max(float(here.lower.sum()), 1e-300)
    busy = np.count_nonzero((here.upper > 0) | (there.upper > 0))
    cheaper = np.count_nonzero(there.upper < here.upper)
    return saved if saved >= 0.5 and cheaper >= max(CHEAPER * busy, fewest / 2) else 0.0


def falls(share: float, steps: int) -> str:
    """How far the cost falls by a change; not by all of it, which no bounds prove."""
    return (
        f"the per-step GOSPA cost of {counted(steps, 'step')} falls by "
        f"{min(100 * share, 99):.0f} % or more"
    )
