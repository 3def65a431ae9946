"""What looks wrong with the times of two sides: notices and warnings. Prints nothing.

The warnings cost little beside an evaluation: they look at the stamps, and at some steps that are
sampled evenly, of which bounds settle all but suspicious cases.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.alignment import SECOND, Alignment, Stamps, nearest, within
from tgospa_eval.distances import Distance, near_pairs
from tgospa_eval.problem import Floats, Parameters
from tgospa_eval.trajectories import Ints, Trajectories

FEW = 0.9
"""Share of common steps below which something is probably wrong with the clocks."""

NEARLY = 0.01
"""Of the median step: unmatched stamps that are closer are probably meant to be the same."""

SAMPLE = 100
"""Steps that are looked at for a shift, and for the nearest estimates."""

ROWS = 20_000
"""Rows of either side at these steps, at most."""

DENSE = 1_000_000
"""Pairs of a step, near or not, up to which an assignment is computed."""

FEWEST = 8
"""Steps without which nothing is said about a shift."""

CHEAPER = 2 / 3
"""Share of the steps that a shift must improve: a late start makes one step dear, not most."""


@dataclass(frozen=True, kw_only=True)
class Shift:
    """That the estimate fits much better when its states are moved by one step.

    Parameters
    ----------
    late : bool
        Whether the estimate comes a step too late, rather than too early.
    saving : float
        Share of the per-step GOSPA cost that goes away, at least one half.
    steps : int
        Steps that were looked at.
    """

    late: bool
    saving: float
    steps: int


def remarks(
    sides: tuple[Trajectories, Trajectories],
    aligned: Alignment,
    stamps: Stamps,
    parameters: Parameters,
    distance: Distance,
) -> tuple[list[str], list[str]]:
    """Notices and warnings about the times of the two sides, a sentence each.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate as read.
    aligned : Alignment
        The same, aligned.
    stamps : Stamps
        How.
    parameters : Parameters
        Cutoff and order of the per-step GOSPA cost.
    distance : Distance
        Base distance.
    """
    notices = [f"{aligned.common} of {aligned.union} steps are in both files"]
    if aligned.joined:
        one = "pair of stamps was" if aligned.joined == 1 else "pairs of stamps were"
        notices.append(
            f"{aligned.joined} {one} joined, at most {stamps.tolerance:.15g} apart "
            "(--time-tolerance)"
        )
    if any(aligned.left_out):
        steps = aligned.union - len(aligned.truth.times)
        notices.append(
            f"{steps} {'step' if steps == 1 else 'steps'} left out (--grid {stamps.grid}), with "
            f"{aligned.left_out[0]} rows of the truth and {aligned.left_out[1]} of the estimate"
        )
    near = _near_misses((sides[0].times, sides[1].times), aligned, stamps)
    # Where stamps miss each other by little, the next step is the same moment: no shift.
    shift = None if near else _shift_warning(aligned, parameters, distance.rough)
    return notices, [text for text in (_few_common(aligned), near, shift) if text]


def _few_common(aligned: Alignment) -> str | None:
    steps = len(aligned.truth.times)
    if not steps or aligned.common >= FEW * steps:
        return None
    share = f"{100 * aligned.common / steps:.0f} %"
    return (
        f"only {share} of the steps are in both files, and what exists at another is missed or "
        "false; if the clocks differ, see --time-tolerance and --grid"
    )


def _near_misses(
    times: tuple[NDArray[Any], NDArray[Any]], aligned: Alignment, stamps: Stamps
) -> str | None:
    """Stamps that are not the same, and closer than 1 % of the median step."""
    if aligned.common == aligned.union or not all(map(len, times)):
        return None
    steps = [step for step in map(median_step, times) if step is not None]
    if not steps:
        return None
    clock = aligned.truth.clock
    apart = nearest(*times).apart
    is_close = (apart < NEARLY * min(steps)) & ~within(apart, stamps.tolerance, times, clock)
    close = apart[is_close & (apart > 0)]
    if not len(close):
        return None
    unit = SECOND if clock != "number" else 1
    most = float(close.max())
    if close.dtype.kind == "f":  # `within` allows for the rounding of the stamps
        most = max(most - max(float(np.spacing(np.abs(side).max())) for side in times), 0.5 * most)
    named = _rounded_up(most / unit)
    pairs = "pair of stamps is" if len(close) == 1 else "pairs of stamps are"
    alone = aligned.union - aligned.common
    return (
        f"{len(close)} {pairs} nearly the same, of {alone} stamps that one file only has, at most "
        f"{named} apart where the median step is {min(steps) / unit:.6g}; --time-tolerance {named} "
        "makes each pair one step"
    )


def median_step(times: NDArray[Any]) -> float | None:
    """Median distance of consecutive times, in the unit in which they are held."""
    if len(times) < 2:
        return None
    return median(np.diff(times.astype(np.float64) if times.dtype.kind == "f" else times))


def median(values: NDArray[Any]) -> float:
    """Without np.median, which imports numpy.ma, slower than all else."""
    ordered = np.sort(values)
    return float(0.5 * ordered[(len(ordered) - 1) // 2] + 0.5 * ordered[len(ordered) // 2])


def _rounded_up(value: float) -> str:
    """Two digits, not below the value but for the last digit of a double."""
    from decimal import ROUND_CEILING, Context

    rounded = Context(prec=2, rounding=ROUND_CEILING).create_decimal(f"{value:.15g}")
    return f"{float(rounded):.15g}"


def _shift_warning(aligned: Alignment, parameters: Parameters, distance: Distance) -> str | None:
    shift = find_shift(aligned, parameters, distance)
    if shift is None:
        return None
    way, cure = ("late", "earlier") if shift.late else ("early", "later")
    step = median_step(aligned.truth.times)
    unit = SECOND if aligned.truth.clock != "number" else 1
    size = "" if step is None else f" ({step / unit:.6g})"
    return (
        f"the estimate seems {way} by a step{size} or more: with its states one step {cure} the "
        f"per-step GOSPA cost of {shift.steps} steps falls by {100 * shift.saving:.0f} % or more; "
        "check from where the two files count their steps, and what moment a stamp means"
    )


def find_shift(aligned: Alignment, parameters: Parameters, distance: Distance) -> Shift | None:
    """Whether moving the estimate by one step at least halves the per-step GOSPA cost.

    The cost of a step is (n + m) / 2 - G in units of c^p, with n truths, m estimates, and G the
    largest sum of 1 - (d / c)^p over disjoint pairs. The sums of the largest terms of each truth
    and of each estimate bound G from above, the pairs that a greedy choice takes from below.
    Assignments are computed only where these bounds leave the answer open.
    """
    times = len(aligned.truth.times)
    rows = max(len(aligned.truth.step), len(aligned.estimate.step), 1)
    inside = times - 2  # each of these has a step before and one after
    count = min(SAMPLE, inside, ROWS * times // rows)
    if count < FEWEST:
        return None
    steps = 1 + np.arange(count) * inside // count
    truth = _at(aligned.truth, steps)
    here = _Costs(truth, _at(aligned.estimate, steps), parameters, distance)
    if not here.upper.any():
        return None
    for move in (1, -1):
        there = _Costs(truth, _at(aligned.estimate, steps + move), parameters, distance)
        if 2 * there.lower.sum() > here.upper.sum():
            continue
        if 2 * there.upper.sum() > here.lower.sum():
            here.settle()
            there.settle()
        saving = 1 - float(there.upper.sum() / max(here.lower.sum(), 1e-300))
        busy = np.count_nonzero((here.upper > 0) | (there.upper > 0))
        cheaper = np.count_nonzero(there.upper < here.upper)
        if saving >= 0.5 and cheaper >= max(CHEAPER * busy, FEWEST / 2):
            return Shift(late=move > 0, saving=saving, steps=count)
    return None


def _at(side: Trajectories, steps: Ints) -> Trajectories:
    """The rows at these steps, which are then 0, 1, 2, ..."""
    begin = np.searchsorted(side.step, steps)
    count = np.searchsorted(side.step, steps, side="right") - begin
    rows = np.arange(count.sum()) + np.repeat(begin - (np.cumsum(count) - count), count)
    order = np.arange(len(steps))
    return side.chosen(rows, np.repeat(order, count), order)


class _Costs:
    """Bounds of the per-step GOSPA costs, `lower` and `upper` (T,), in units of c^p."""

    def __init__(
        self,
        truth: Trajectories,
        estimate: Trajectories,
        parameters: Parameters,
        distance: Distance,
    ) -> None:
        pairs = near_pairs(truth, estimate, parameters.cutoff, distance)
        self.steps = len(truth.times)
        self.step = truth.step[pairs.truth_row]
        self.rows = pairs.truth_row, pairs.estimate_row
        self.gain = 1 - (pairs.distance / parameters.cutoff) ** parameters.order
        objects = np.concatenate((truth.step, estimate.step))
        self.alone = np.bincount(objects, minlength=self.steps) * np.float64(0.5)
        # From the largest down, equal ones as they come; stable in every row below.
        self.order = np.argsort(-self.gain, kind="stable")
        most = [self._sums(self._first(rows, self.order)) for rows in self.rows]
        self.lower = self.alone - np.minimum(*most)
        self.upper = self.alone - self._sums(self._greedy())

    def _sums(self, chosen: Ints) -> Floats:
        sums = np.bincount(self.step[chosen], self.gain[chosen], minlength=self.steps)
        return np.asarray(sums, np.float64)

    def _first(self, rows: Ints, pairs: Ints) -> Ints:
        """The first of these pairs for each row."""
        by_row = pairs[np.argsort(rows[pairs], kind="stable")]
        return by_row[np.flatnonzero(np.diff(rows[by_row], prepend=-1))]

    def _greedy(self) -> Ints:
        """Disjoint pairs, always the largest that is left: round by round the best of both."""
        left, taken = self.order, [self.order[:0]]
        is_taken = [np.zeros(int(rows.max(initial=-1)) + 1, bool) for rows in self.rows]
        while len(left):
            best = [np.zeros(len(self.gain), bool) for _ in self.rows]
            for mine, rows in zip(best, self.rows, strict=True):
                mine[self._first(rows, left)] = True
            both = left[best[0][left] & best[1][left]]
            taken.append(both)
            for flags, rows in zip(is_taken, self.rows, strict=True):
                flags[rows[both]] = True
            left = left[~(is_taken[0][self.rows[0][left]] | is_taken[1][self.rows[1][left]])]
        return np.concatenate(taken)

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
            self.lower[step] = self.upper[step] = self.alone[step] - best
