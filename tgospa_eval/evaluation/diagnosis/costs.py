"""Bounds of the per-step GOSPA cost of a few steps, for what a change of the data would save.

    cost = (m + n) / 2 - G,   G = max over disjoint pairs of sum 1 - (d / c)^p,   in units of c^p,

of m truths and n estimates (docs/theory/metric.md, "Identities"). The sums of the largest terms of
each truth and of each estimate bound G from above, a greedy choice from below. Assignments are
computed only where these bounds leave an answer open.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance, near_pairs
from tgospa_eval.problem.problem import Floats
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.tracks.trajectories import Ints, Trajectories

SAMPLE = 100
"""Steps that are looked at."""

FIRST_STEPS = 25
"""Steps that are looked at first."""

SAMPLE_ROWS = 20_000
"""Rows of either side at these steps, at most."""

SAMPLE_PAIRS = 200_000
"""Pairs of these steps, near or not, as long as that leaves `FEWEST_STEPS` steps."""

DENSE = 1_000_000
"""Pairs of a step, near or not, up to which an assignment is computed."""

FEWEST_STEPS = 8
"""Fewer steps give no warning of a shift."""

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
    steps : int
        How many.
    objects : pair of int arrays
        Step of each truth and of each estimate, in order.
    track : int array
        Track of each estimate.
    rows : pair of (N,) int arrays
        Truth and estimate of each near pair, in order.
    gain : (N,) float array
        What each pair saves, 1 - (d / c)^p.
    """

    steps: int
    objects: tuple[Ints, Ints]
    track: Ints
    rows: tuple[Ints, Ints]
    gain: Floats

    @cached_property
    def step(self) -> Ints:
        """Of each pair."""
        return self.objects[0][self.rows[0]]

    @cached_property
    def counts(self) -> tuple[Ints, Ints]:
        """Truths and estimates at each step (T,)."""
        truths, estimates = (np.bincount(step, minlength=self.steps) for step in self.objects)
        return truths, estimates

    @cached_property
    def unassigned(self) -> Floats:
        """The costs without any pair (T,)."""
        return np.float64(0.5) * (self.counts[0] + self.counts[1])

    @cached_property
    def lower(self) -> Floats:
        """As if each truth, or each estimate, had its largest gain (T,)."""
        sums = []
        for step, rows in zip(self.objects, self.rows, strict=True):
            best = np.zeros(len(step))
            np.maximum.at(best, rows, self.gain)
            sums.append(np.bincount(step, best, minlength=self.steps))
        return np.asarray(self.unassigned - np.minimum(*sums))

    @cached_property
    def upper(self) -> Floats:
        """Of the greedy choice (T,); most changes of the data are ruled out without it."""
        gain = np.bincount(self.step[self.taken], self.gain[self.taken], minlength=self.steps)
        return np.asarray(self.unassigned - gain)

    @cached_property
    def taken(self) -> Ints:
        """Disjoint pairs, always the largest that is left: round by round the best of both."""
        left = np.argsort(-self.gain, kind="stable")  # of equal ones the first
        taken = [left[:0]]
        first = [np.empty(len(step), np.int64) for step in self.objects]
        is_taken = [np.zeros(len(step), bool) for step in self.objects]
        while len(left):
            place = np.arange(len(left))
            is_best = np.ones(len(left), bool)
            of = [rows[left] for rows in self.rows]
            for mine, rows in zip(first, of, strict=True):
                mine[rows[::-1]] = place[::-1]  # what is written last stays
                is_best &= mine[rows] == place
            taken.append(left[is_best])
            for flags, rows in zip(is_taken, of, strict=True):
                flags[rows[is_best]] = True
            left = left[~(is_taken[0][of[0]] | is_taken[1][of[1]])]
        return np.concatenate(taken)

    def part(self, first: int, steps: int) -> "StepCosts":
        """The same of some steps that follow each other."""
        pairs, truths, estimates = (
            slice(*np.searchsorted(step, [first, first + steps]).tolist())
            for step in (self.step, *self.objects)
        )
        return StepCosts(
            steps=steps,
            objects=(self.objects[0][truths] - first, self.objects[1][estimates] - first),
            track=self.track[estimates],
            rows=(self.rows[0][pairs] - truths.start, self.rows[1][pairs] - estimates.start),
            gain=self.gain[pairs],
        )

    def only(self, kept: NDArray[np.bool_]) -> "StepCosts":
        """Without the other estimates."""
        near = kept[self.rows[1]]
        return StepCosts(
            steps=self.steps,
            objects=(self.objects[0], self.objects[1][kept]),
            track=self.track[kept],
            rows=(self.rows[0][near], (np.cumsum(kept) - 1)[self.rows[1][near]]),
            gain=self.gain[near],
        )

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
    truth: Trajectories, estimate: Trajectories, parameters: Parameters, distance: Distance
) -> StepCosts:
    """Of two sides on the same steps, by a base distance of states without covariances."""
    pairs = near_pairs(truth, estimate, parameters.cutoff, distance)
    return StepCosts(
        steps=len(truth.times),
        objects=(truth.step, estimate.step),
        track=estimate.track,
        rows=(pairs.truth_row, pairs.estimate_row),
        gain=1 - (pairs.distance / parameters.cutoff) ** parameters.order,
    )


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


def saving_of_tracks(here: StepCosts, there: StepCosts) -> float:
    """The same where most of the cost is of what is missed or false either way, and left out.

    Only tracks that are there at both moments are compared, whichever were missed at one of them:
    both are of one table, whose tracks have the same numbers.
    What they cost, in units of c^p, is how many more pairs there are here or there than the gain: a
    pair that is near either here or there only, costs one where it is not. Half of the pairs that
    there could be must be near there: of another recording, fewer are.
    """
    mine, others = (side.objects[1] * np.int64(2**32) + side.track for side in (here, there))
    here, there = here.only(_are_among(mine, others)), there.only(_are_among(others, mine))
    highest = float((there.unassigned - there.lower).sum())
    if 2 * highest <= len(here.taken) + float((here.unassigned - here.upper).sum()):
        return 0.0
    if 2 * len(there.taken) < np.minimum(*there.counts).sum():
        return 0.0
    found = [np.bincount(side.step[side.taken], minlength=side.steps) for side in (here, there)]
    pairs = np.maximum(*found)
    here.settle()
    there.settle()
    costs = [pairs - (side.unassigned - side.upper) for side in (here, there)]
    total, left = (float(cost.sum()) for cost in costs)
    tracks = np.unique(there.track[there.rows[1][there.taken]])
    if (
        len(tracks) < FEWEST_TRACKS
        or pairs.sum() < PAIRED
        or total < NOTABLE_COST * pairs.sum()
        or 2 * left > total
    ):
        return 0.0
    busy = np.count_nonzero(pairs)
    cheaper = np.count_nonzero(costs[1] < costs[0])
    return 1 - max(left, 0.0) / total if cheaper >= max(CHEAPER * busy, FEWEST_STEPS) else 0.0


def _are_among(numbers: Ints, others: Ints) -> NDArray[np.bool_]:
    """Which of some numbers are among others, which are sorted."""
    after = np.searchsorted(others, numbers, side="right")
    return np.asarray(after > np.searchsorted(others, numbers))


def falls(share: float, steps: int) -> str:
    """How far the cost falls by a change; not by all of it, which no bounds prove."""
    return (
        f"the per-step GOSPA cost of {counted(steps, 'step')} falls by "
        f"{min(100 * share, 99):.0f} % or more"
    )


def affordable(sides: tuple[Trajectories, Trajectories]) -> int:
    """How many steps may be looked at."""
    objects = [len(side.step) / max(len(side.times), 1) for side in sides]
    by_pairs = max(FEWEST_STEPS, int(SAMPLE_PAIRS / max(objects[0] * objects[1], 1)))
    return min(SAMPLE, by_pairs, int(SAMPLE_ROWS / max(*objects, 1)))


def evenly(steps: Ints, sides: tuple[Trajectories, Trajectories], most: int = SAMPLE) -> Ints:
    """As many of the steps as may be looked at, evenly spread."""
    count = max(1, min(len(steps), affordable(sides), most))
    return steps[np.arange(count) * len(steps) // count] if len(steps) else steps


def at_steps(side: Trajectories, steps: Ints) -> Trajectories:
    """The rows at these steps as points; the steps are then 0, 1, 2, ..."""
    steps = steps.astype(side.step.dtype)  # else all of the others are converted
    begin = np.searchsorted(side.step, steps)
    count = np.searchsorted(side.step, steps + 1) - begin
    order = np.arange(len(steps))
    return side.seen_as(()).chosen(concatenated(begin, count), np.repeat(order, count), order)


def with_state(side: Trajectories, state: Floats) -> Trajectories:
    """With other states; what is beyond the largest double is there."""
    most = np.finfo(np.float64).max
    return replace(side, state=np.clip(state, -most, most))


def occupied(side: Trajectories) -> NDArray[np.bool_]:
    """Steps at which it has rows (T,)."""
    return np.bincount(side.step, minlength=len(side.times)) > 0
