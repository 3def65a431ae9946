"""Proposals of solvers, proven bounds, and tables that describe an assignment.

Sizes of arrays, such as (S,), are explained in `problem.states`.
"""

from collections.abc import Sequence
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.progress import Status
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.states import ONE, States, assigned, changes, spare


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """Proposal of a solver, which the certificate does not trust.

    Parameters
    ----------
    weights : (S,) float array
        Assignment of each state, between 0 and 1.
    prices : (K,) float array
        Price of each column slot.
    status : Status
        Reason why the solver stopped. The user sees it.
    detail : str
        Details of the status.
    unsolved : pair of int, optional
        Number of components that are not solved, and number of components to solve.
    iterations : int
        Number of iterations: sweeps over the problem, or steps of the simplex method.
    finished : bool
        False if a limit or a failure stopped the solver early.
    history : tuple of dict
        Convergence over time: some numbers for each time at which the solver checked its bounds.
    disposable : bool
        Whether code that receives the solution is allowed to overwrite its weights.
    missing : (B,) bool array
        Mask of the blocks that may be unsolved.
    reduced : tuple of Reduced
        Solutions of some blocks at a smaller cutoff. Their prices prove better bounds.
    """

    weights: Floats
    prices: Floats
    status: Status
    detail: str = ""
    unsolved: tuple[int, int] | None = None
    iterations: int = 0
    finished: bool = True
    history: tuple[dict[str, float], ...] = field(default=())
    disposable: bool = False
    missing: Mask = field(default_factory=lambda: np.zeros(0, bool))
    reduced: "tuple[Reduced, ...]" = ()

    @property
    def sentence(self) -> str:
        """Status as text, with its details and the number of unsolved components."""
        text = f"{self.status} ({self.detail})" if self.detail else str(self.status)
        if self.unsolved is None:
            return text
        return f"{text} ({self.unsolved[0]} of {self.unsolved[1]} components)"


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduced:
    """Some blocks of a problem at a smaller cutoff, and a solution at that cutoff.

    Parameters
    ----------
    states : States
        The problem of these blocks at the smaller cutoff, from `certificate.reduce_cutoff`.
    blocks : (B,) bool array
        Mask of these blocks in the whole problem.
    scale : float
        The value of c^p at the smaller cutoff, divided by that of the whole problem. It is a power
        of 2.
    solution : Solution
        Solution of `states`.
    """

    states: States
    blocks: Mask
    scale: float
    solution: Solution


@dataclass(frozen=True, kw_only=True)
class Bounds(Interval):
    """Proven bounds ``lower <= optimum <= upper``, in units of c^p, rounded outward.

    Parameters
    ----------
    lower, upper : float
        The two bounds; `upper` is the cost of a feasible assignment.
    rounding : float
        Cost that rounding of the last digits of the states can cause. If `upper` is not larger, the
        whole cost may be an effect of rounding.
    """

    rounding: float = 0.0

    @property
    def relative_gap(self) -> float:
        """Relative gap (upper - lower) / upper; 0 if upper is 0."""
        return (self.upper - self.lower) / self.upper if self.upper > 0 else 0.0

    def within_rounding(self, gap: float) -> bool:
        """Return True if the relative gap exceeds `gap`, and `upper` is at most `rounding`."""
        return self.upper - self.lower > gap * self.upper and self.upper <= self.rounding

    def met(self, gap: float) -> bool:
        """Return True if the relative gap is at most `gap`, or `upper` is at most `rounding`."""
        return self.upper - self.lower <= gap * self.upper or self.upper <= self.rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Breakdown:
    """Cost of a feasible assignment by cause, in units of c^p.

    Parameters
    ----------
    localisation, missed, false, switch : (T,) float arrays
        Cost at each step. The cost of a switch between two steps belongs to the later step.
    missed_count, false_count, switch_count : (T,) float arrays
        Numbers of missed targets, of false targets and of switches at each step. The number of
        switches is half the total variation of the weights.
    total : float
        The whole cost, summed from single terms (not from the rounded costs of the steps).
    """

    localisation: Floats
    missed: Floats
    false: Floats
    switch: Floats
    missed_count: Floats
    false_count: Floats
    switch_count: Floats
    total: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Brackets:
    """Costs of N intervals of steps, in units of c^p. Each interval is evaluated separately.

    The intervals are those of a curve (from step 1 to each step) or sliding windows.

    Parameters
    ----------
    lower, upper : (N,) float arrays
        Proven bounds.
    parts : (4, N) float array
        Localisation, missed, false and switch cost of the assignment with the cost `upper`.
    rounding : (N,) float array
        The value of `Bounds.rounding` for each interval.
    """

    lower: Floats
    upper: Floats
    parts: Floats
    rounding: Floats

    def met(self, gap: float) -> Mask:
        """Return `Bounds.met` for each interval, (N,)."""
        narrow = self.upper - self.lower <= gap * self.upper
        met: Mask = narrow | (self.upper <= self.rounding)
        return met


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows(Brackets):
    """Costs of sliding windows.

    Parameters
    ----------
    first, last : (N,) int arrays
        First and last step of each window.
    size, every : str
        Length of a window, and time from one window to the next, in words. Blank if not yet known.
        The time between the last two windows can be shorter.
    """

    first: Ints
    last: Ints
    size: str = ""
    every: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class AssignedPairs:
    """Assigned near pairs, sorted by (step, truth).

    Parameters
    ----------
    step, truth, estimate, entry : (N,) int arrays
        For each pair: index of the step, of the true object, of the estimate, and of the entry in
        the problem.
    weight : (N,) float array
        Weight of each pair.
    """

    step: Ints
    truth: Ints
    estimate: Ints
    entry: Ints
    weight: Floats

    @classmethod
    def of(cls, rows: NDArray[np.void]) -> "AssignedPairs":
        """Build the pairs from an array with the fields step, truth, estimate and weight.

        `entry` becomes the index in this array.
        """
        columns = {name: rows[name] for name in ("step", "truth", "estimate", "weight")}
        return cls(**columns, entry=np.arange(len(rows)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Unjudged:
    """Numbers of states that are not evaluated, at each step: arrays (T,).

    Parameters
    ----------
    ignored, excused : int arrays
        Number of ignored objects, and number of excused estimates.
    absorbed : float array
        Sum of the weights with which estimates follow ignored objects.
    """

    ignored: Ints
    excused: Ints
    absorbed: Floats

    @classmethod
    def joined(cls, several: "Sequence[Unjudged]") -> "Unjudged | None":
        """Add up the numbers of evaluations with the same steps; None if `several` is empty."""
        if not several:
            return None
        return cls(**{name: sum(vars(one)[name] for one in several) for name in vars(several[0])})

    @property
    def totals(self) -> dict[str, float]:
        """Totals over all steps, by their names in JSON."""
        return {
            "truth_states": int(self.ignored.sum()),
            "absorbed": float(self.absorbed.sum()),
            "excused": int(self.excused.sum()),
        }


def read_unjudged(states: States, weights: Ints) -> Unjudged | None:
    """Return the numbers of states that are not evaluated, from a feasible assignment (S,).

    The result is None if the problem has no masks of ignored objects and excused estimates.
    """
    problem = states.problem
    if problem.unjudged is None:
        return None
    used, entry, weight = assigned(states, weights)
    ignored, excused = (
        np.bincount(side.step[mask], minlength=problem.steps)
        for side, mask in zip(problem.sides, problem.unjudged, strict=True)
    )
    absorbed = problem.unjudged[0][problem.truth_row[entry]]
    at = states.begin[used[absorbed]]
    return Unjudged(
        ignored=ignored,
        excused=excused,
        absorbed=sum_by(at, weight[absorbed] / ONE, problem.steps),
    )


def evaluated_rows(states: States, weights: Ints) -> tuple[Mask, Mask]:
    """Return masks of the truth rows and the estimate rows that count in other metrics.

    These rows do not count in other metrics:

    - ignored objects;
    - estimates that follow an ignored object with a weight of at least 1/2;
    - excused estimates that do not follow an evaluated object with a weight of at least 1/2.

    `weights` is the feasible assignment (S,), in units of 1/ONE.
    """
    problem = states.problem
    truths, estimates = problem.sides
    assert truths.unjudged is not None
    assert estimates.unjudged is not None
    _, entry, weight = assigned(states, weights)
    ignored = truths.unjudged[truths.row[entry]]
    follows, matches = (
        2 * sum_by(estimates.row[entry[of]], weight[of].astype(float), len(estimates.step)) >= ONE
        for of in (ignored, ~ignored)
    )
    return ~truths.unjudged, ~follows & (matches | ~estimates.unjudged)


def read_assigned(states: States, weights: Ints) -> AssignedPairs:
    """Return the assigned near pairs of a feasible assignment (S,), in units of 1/ONE."""
    used, entry, weight = assigned(states, weights)
    order = np.argsort(entry, kind="stable")  # by step, truth, estimate
    used, pair = used[order], states.pair[used[order]]
    return AssignedPairs(
        step=states.begin[used],
        truth=states.pair_truth[pair],
        estimate=states.pair_estimate[pair],
        entry=entry[order],
        weight=weight[order] / ONE,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Switches:
    """Changes of the assignment of each true object, sorted by (step, truth).

    Parameters
    ----------
    step, truth : (N,) int arrays
        Step and true object of each change.
    before, after : (N,) int arrays
        Estimate with the largest decrease of its weight, and estimate with the largest increase; -1
        if there is no such estimate.
    variation : (N,) float array
        Total variation of the weights, which is twice the number of switches.
    """

    step: Ints
    truth: Ints
    before: Ints
    after: Ints
    variation: Floats


def read_switches(states: States, weights: Ints) -> Switches:
    """Return the switches of a feasible assignment (S,), in units of 1/ONE."""
    state, amount = changes(states, weights)
    rises = weights[state] > weights[state - 1]
    pair = states.pair[state]
    step, truth = states.begin[state], states.pair_truth[pair]
    order = np.lexsort((-amount, truth, step))
    opens = np.ones(len(order), bool)
    opens[1:] = (np.diff(step[order]) != 0) | (np.diff(truth[order]) != 0)
    first = np.flatnonzero(opens)

    def largest(chosen: Mask) -> Ints:
        """Return, for each (step, truth), the estimate with the largest of the chosen changes.

        It is -1 for a (step, truth) without a chosen change.
        """
        place = np.where(chosen[order], np.arange(len(order)), len(order))
        track = np.append(states.pair_estimate[pair[order]], -1)
        estimates: Ints = track[np.minimum.reduceat(place, first)]
        return estimates

    return Switches(
        step=step[order[first]],
        truth=truth[order[first]],
        before=largest(~rises),
        after=largest(rises),
        variation=np.add.reduceat(amount[order], first),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class PerTrack:
    """Costs and counts of each of k true objects, or of k estimates.

    Parameters
    ----------
    localisation, unassigned, switch : (k,) float arrays
        Costs in units of c^p: of localisation errors, of missed steps (for an estimate: of false
        steps), and of switches.
    unassigned_count, switch_count : (k,) float arrays
        Number of missed steps (for an estimate: of false steps), and number of switches.
    """

    localisation: Floats
    unassigned: Floats
    switch: Floats
    unassigned_count: Floats
    switch_count: Floats


def read_tracks(states: States, weights: Ints, side: int) -> PerTrack:
    """Return costs and counts of the true objects (side 0) or of the estimates (side 1).

    `weights` is a feasible assignment (S,), in units of 1/ONE.
    """
    problem = states.problem
    objects, pair_track = problem.sides[side], states.pair_tracks[side]
    used, entry, weight = assigned(states, weights)
    free = spare(objects, entry, weight)
    changed, amount = changes(states, weights)

    def total(index: Ints, value: Floats) -> Floats:
        return sum_by(index, value, objects.count)

    at = pair_track[states.pair[changed]]
    return PerTrack(
        localisation=total(pair_track[states.pair[used]], weight / ONE * problem.cost[entry]),
        unassigned=total(objects.track, free / ONE * objects.price),
        switch=total(at, amount * problem.switch_price_at[states.begin[changed]]),
        unassigned_count=total(objects.track, free / ONE),
        switch_count=0.5 * total(at, amount),
    )
