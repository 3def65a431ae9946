"""Bounds of the per-step GOSPA cost of a few steps, to estimate the saving by a change of the data.

A pair of a true object and an estimate with the distance d has the gain 1 - (d / c)^p, where c is
the cutoff and p the order. In units of c^p, a step with m true objects and n estimates has the cost

    (m + n) / 2 - G

(docs/theory/metric.md, "Identities"). G is the largest sum of gains of pairs, where each object and
each estimate is in at most one pair. The sum of the largest gain of each true object is an upper
bound of G. The sum of the largest gain of each estimate is another one. A greedy choice of pairs
gives a lower bound of G. The best assignment is computed only if these bounds are not sufficient
for a decision.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated, places_of
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance, near_pairs
from tgospa_eval.distances.pair_search import near_points, rows_at
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.gospa import assign_pairs
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.tracks.trajectories import Trajectories

Objects = tuple[Ints, Ints]
"""Step of each true state, and step of each estimate, sorted, int32."""

Rows = tuple[Ints, Ints]
"""Indices of the true state and of the estimate of each pair, (N,) each, sorted, int32."""


def largest_gains(objects: Objects, rows: Rows, gain: Floats, steps: int) -> Floats:
    """Return an upper bound of the gain of each step, (T,).

    It is the sum of the largest gains of all true states or of all estimates, whichever is smaller.
    """
    if kernels is not None:
        gains: Floats = kernels.largest_gains(*objects, *rows, gain, steps)
        return gains
    sums = []
    for step, numbers in zip(objects, rows, strict=True):
        best = np.zeros(len(step))
        np.maximum.at(best, numbers, gain)
        sums.append(np.bincount(step, best, minlength=steps))
    return np.minimum(*sums)


def pair_off(objects: Objects, rows: Rows, gain: Floats, steps: int) -> tuple[Floats, Ints]:
    """Choose disjoint pairs greedily by their gain, in rounds.

    A round chooses each pair that has the largest gain for both of its states, among the pairs
    whose states are not chosen yet. Of equal pairs the first one is chosen.

    Returns
    -------
    gain : (T,) float array
        Sum of the gains of the chosen pairs at each step.
    turn : (N,) int32 array
        Round in which each pair is chosen, from 1 on; 0 for any other pair.
    """
    if kernels is not None:
        pairs: tuple[Floats, Ints]
        pairs = kernels.pair_off(objects[0], len(objects[1]), *rows, gain, steps)
        return pairs
    left = np.argsort(-gain, kind="stable")
    turn = np.zeros(len(left), np.int32)
    first = [np.empty(len(step), np.int64) for step in objects]
    is_taken = [np.zeros(len(step), bool) for step in objects]
    while len(left):
        place = np.arange(len(left))
        is_best = np.ones(len(left), bool)
        of = [numbers[left] for numbers in rows]
        for mine, numbers in zip(first, of, strict=True):
            mine[numbers[::-1]] = place[::-1]  # of equal indices, the value written last stays
            is_best &= mine[numbers] == place
        turn[left[is_best]] = turn.max() + 1
        for flags, numbers in zip(is_taken, of, strict=True):
            flags[numbers[is_best]] = True
        left = left[~(is_taken[0][of[0]] | is_taken[1][of[1]])]
    taken = ranked(turn, gain)
    step = objects[0][rows[0][taken]]
    total = np.bincount(step, gain[taken], minlength=steps)
    # If there are no pairs, `bincount` returns integers.
    return np.asarray(total, np.float64), turn


def ranked(turn: Ints, gain: Floats) -> Ints:
    """Return the indices of the chosen pairs, sorted by round and then by falling gain."""
    taken = places_of(turn)
    return taken[np.lexsort((-gain[taken], turn[taken]))]


# -------------------------------------------------------------------------------------------------
# Sampled steps, and the rows of truth or estimate at these steps.

SAMPLE = 100
"""Largest number of examined steps."""

FIRST_STEPS = 25
"""Number of steps that are examined first."""

SAMPLE_ROWS, MORE_ROWS = 20_000, 100_000
"""Largest number of examined rows of truth or estimate, and a larger limit for few steps.

The second limit is used if the first one allows fewer than `FEWEST_STEPS` steps. So few steps never
suffice to call the clocks of both files equal. Then `clock` would search for a shift of the times,
which takes longer than to examine more rows."""

SAMPLE_PAIRS = 200_000
"""Largest number of examined pairs, near or not, if there are more than `FEWEST_STEPS` steps."""

FEWEST_STEPS = 8
"""Smallest number of steps for a warning that the times of the estimate are shifted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StepRows:
    """Rows of truth or estimate at some steps. These steps have the new indices 0, 1, 2, ...

    Parameters
    ----------
    side : Trajectories
        Truth or estimate, with all rows.
    bounds : (2, T) int array
        First row of each of the T steps, and the row after its last one.
    """

    side: Trajectories
    bounds: Ints

    @classmethod
    def of(cls, side: Trajectories, steps: Ints | None = None) -> "StepRows":
        """Return the rows at some steps, by default at all steps."""
        if steps is not None:
            return cls(side=side, bounds=rows_at(side, steps))
        rows = cls(side=side, bounds=rows_at(side, np.arange(len(side.times))))
        vars(rows)["table"] = side.reduced_to(())
        return rows

    @cached_property
    def counts(self) -> Ints:
        """Number of rows of each step (T,)."""
        return np.asarray(self.bounds[1] - self.bounds[0])

    @cached_property
    def step(self) -> Ints:
        """New index of the step of each row."""
        return np.arange(len(self.counts), dtype=np.int32).repeat(self.counts)

    @cached_property
    def row(self) -> Ints:
        """Index of each row among all rows of the side."""
        return concatenated(self.bounds[0], self.counts)

    @cached_property
    def track(self) -> Ints:
        """Index of the track of each row."""
        return self.side.track[self.row]

    @cached_property
    def table(self) -> Trajectories:
        """The rows at these steps, as points."""
        return self.side.reduced_to(()).chosen(self.row, self.step, np.arange(len(self.counts)))


def affordable(sides: tuple[Trajectories, Trajectories]) -> int:
    """Return how many steps can be examined in short time."""
    objects = [len(side.step) / max(len(side.times), 1) for side in sides]
    by_pairs = max(FEWEST_STEPS, int(SAMPLE_PAIRS / max(objects[0] * objects[1], 1)))
    by_rows, more = (int(rows / max(*objects, 1)) for rows in (SAMPLE_ROWS, MORE_ROWS))
    return min(SAMPLE, by_pairs, max(by_rows, min(more, FEWEST_STEPS)))


def evenly(steps: Ints, sides: tuple[Trajectories, Trajectories], limit: int = SAMPLE) -> Ints:
    """Return evenly spread steps out of `steps`, as many as can be examined in short time.

    The result has at most `limit` steps.
    """
    count = max(1, min(len(steps), affordable(sides), limit))
    return steps[np.arange(count) * len(steps) // count] if len(steps) else steps


def with_state(side: Trajectories, state: Floats) -> Trajectories:
    """Return the side with the states replaced; infinite numbers become the largest double."""
    largest = np.finfo(np.float64).max
    return replace(side, state=np.clip(state, -largest, largest, order="C"))


def occupied(side: Trajectories) -> Mask:
    """Return a mask of the steps at which a side has rows (T,)."""
    return np.bincount(side.step, minlength=len(side.times)) > 0


DENSE = 1_000_000
"""Largest number of pairs of a step, near or not, for which an assignment is computed."""

PAIRED = 12
"""Smallest number of pairs for a warning that the positions or times are shifted."""

FEWEST_TRACKS = 3
"""Number of objects that must agree on a displacement smaller than the cutoff.

With fewer objects, the displacement may be an error of their tracks."""

NOTABLE_COST = 1e-3
"""Smallest cost that can cause a warning of a fault, as a share of the cost without pairs."""

CHEAPER = 2 / 3
"""Share of the steps with a cost. A change must lower the cost of at least this share of them.

A fault of the whole file, such as a shift, has costs at most steps, a late start only at a few."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StepCosts:
    """Bounds of the per-step GOSPA costs, in units of c^p.

    Parameters
    ----------
    counts : pair of (T,) int arrays
        Numbers of true states and estimates at each step.
    objects : pair of int32 arrays
        Step of each true state, and step of each estimate, sorted.
    rows : pair of (N,) int32 arrays
        Indices of the true state and of the estimate of each near pair, sorted.
    gain : (N,) float array
        Gain of each near pair, 1 - (d / c)^p.
    """

    counts: tuple[Ints, Ints]
    objects: tuple[Ints, Ints]
    rows: tuple[Ints, Ints]
    gain: Floats

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.counts[0])

    @property
    def possible(self) -> int:
        """Largest number of disjoint pairs at all steps, near or not."""
        return int(np.minimum(*self.counts).sum())

    @cached_property
    def step(self) -> Ints:
        """Step of each near pair."""
        return self.objects[0][self.rows[0]]

    @cached_property
    def unassigned(self) -> Floats:
        """Cost of each step if no pair is assigned, (T,)."""
        return np.float64(0.5) * (self.counts[0] + self.counts[1])

    @cached_property
    def lower(self) -> Floats:
        """Lower bound of the cost of each step, from `largest_gains`, (T,)."""
        saved = largest_gains(self.objects, self.rows, self.gain, self.steps)
        return np.asarray(self.unassigned - saved)

    @cached_property
    def upper(self) -> Floats:
        """Upper bound of the cost of each step, from the greedy choice of pairs, (T,)."""
        return np.asarray(self.unassigned - self._greedy[0])

    @cached_property
    def taken(self) -> Ints:
        """Indices of the pairs of the greedy choice, increasing."""
        return places_of(self._greedy[1])

    @cached_property
    def lost(self) -> Floats:
        """Value (d / c)^p of each pair of the greedy choice, which is 1 minus its gain."""
        return np.asarray(1 - self.gain[self.taken])

    @cached_property
    def ranked(self) -> Ints:
        """Indices of the pairs of the greedy choice, in the order in which they are chosen."""
        return ranked(self._greedy[1], self.gain)

    @cached_property
    def _greedy(self) -> tuple[Floats, Ints]:
        return pair_off(self.objects, self.rows, self.gain, self.steps)

    def settle(self) -> None:
        """Replace both bounds by the cost of the best assignment, except at very large steps."""
        for step in np.flatnonzero(self.lower < self.upper).tolist():
            pairs = slice(*np.searchsorted(self.step, [step, step + 1]).tolist())
            truth, estimate = (rows[pairs] for rows in self.rows)
            if len(np.unique(truth)) * len(np.unique(estimate)) > DENSE:
                continue
            gain = self.gain[pairs]
            best = gain[assign_pairs(truth, estimate, -gain, 0.0)].sum()
            self.lower[step] = self.upper[step] = self.unassigned[step] - best


def step_costs(
    truth: StepRows, estimate: StepRows, parameters: Parameters, distance: Distance
) -> StepCosts:
    """Return the costs of truth and estimate at their steps; the distance compares points."""
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


class Sample:
    """Some steps at which truth and estimate have rows, and the costs of these steps.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate on one grid.
    parameters : Parameters
        Cutoff and order.
    distance : Distance
        Base distance that compares states without their covariances.
    max_steps : int
        Largest number of these steps.
    """

    def __init__(
        self,
        sides: tuple[Trajectories, Trajectories],
        parameters: Parameters,
        distance: Distance,
        max_steps: int = SAMPLE,
    ) -> None:
        self.sides, self.parameters, self.distance = sides, parameters, distance
        self.columns = sides[0].columns
        self.steps = evenly(places_of(occupied(sides[0]) & occupied(sides[1])), sides, max_steps)
        self.rows = StepRows.of(sides[0], self.steps), StepRows.of(sides[1], self.steps)
        self.here = step_costs(*self.rows, parameters, distance)

    @property
    def larger(self) -> "Sample":
        """Sample of the same data with up to `SAMPLE` steps."""
        return Sample(self.sides, self.parameters, self.distance)

    @property
    def truth(self) -> Trajectories:
        """Truth at the steps of the sample, as points."""
        return self.rows[0].table

    @property
    def estimate(self) -> Trajectories:
        """Estimate at the steps of the sample, as points."""
        return self.rows[1].table

    def costs(self, changed: Trajectories, place: int = 1) -> StepCosts:
        """Return the costs after a change of the estimate, or of the truth if `place` is 0.

        The changed side has these steps.
        """
        sides = [self.truth, self.estimate]
        sides[place] = changed
        truth, estimate = map(StepRows.of, sides)
        return step_costs(truth, estimate, self.parameters, self.distance)

    @cached_property
    def is_bad(self) -> bool:
        """True if the greedy choice saves less than half of the cost without pairs."""
        return bool(2 * self.here.upper.sum() > self.here.unassigned.sum())


def saving(here: StepCosts, there: StepCosts, fewest: int = FEWEST_STEPS) -> float:
    """Return the share of the costs `here` that a change saves, if this is clear, else 0.

    `there` are the costs after the change. The saving is clear if it is at least half of the cost,
    and if enough steps become cheaper. Enough is at least the share `CHEAPER` of the steps with
    costs, and at least half of `fewest`. An object that the change leaves out counts as an object
    without a pair, so leaving it out saves nothing.
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
    """Describe the share of the cost that a change saves; above 99 % as "99 % or more"."""
    return (
        f"the per-step GOSPA cost of {counted(steps, 'step')} falls by "
        f"{min(100 * share, 99):.0f} % or more"
    )
