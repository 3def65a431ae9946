"""Warnings about times of two sides: timestamps that miss each other, other clocks, other units.

The tests take little time compared to an evaluation, because they examine the timestamps and some
steps at even spacing. The offset of the clock is searched only if these steps do not fit.

The clock of the estimate is off by the shift of its timestamps that fits the truth best,

    G(shift) = sum over steps of the estimate of  max over disjoint pairs of  sum 1 - (d / c)^p,

where d is the distance of a pair, c the cutoff and p the order. The truth moves on straight lines
between its states. Candidates are the differences in time of states that are near each other; G
selects and refines them. A shift is reported only if every other shift with similar coverage fits
clearly worse, compared to the variation between stretches of the recording. So targets at rest, or
on a circle, lead to no report.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated, median, places_of
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, number, plain, shortest
from tgospa_eval.distances import Distance, Norm
from tgospa_eval.evaluation.axis import periods_of
from tgospa_eval.evaluation.diagnosis.costs import (
    FEWEST_STEPS,
    NOTABLE_COST,
    PAIRED,
    Sample,
    StepCosts,
    StepRows,
    step_costs,
    with_state,
)
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.quoting import option
from tgospa_eval.tracks.alignment import Alignment, TimeMatching, Times, nearest, within
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.interpolation import interpolated, on_lines
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from fractions import Fraction

    from tgospa_eval.evaluation.prepare import AlignedPair
    from tgospa_eval.evaluation.request import EvaluationRequest


SAME = 0.01
"""Share of the time between samples of the truth below which times count as equal."""

TIMELINE = 300_000
"""Largest number of states and sampled times of the truth, including interpolated states."""

SEGMENTS = 2_000
"""Number of pairs of consecutive states of the truth for typical speed and time."""

ACROSS = 5.0
"""Multiple of the typical time between two states across which a track continues."""

FINER = 16
"""Largest number of samples in the typical time between two states of a target that moves far."""


class Timeline:
    """True states at any time, on straight lines between sampled states.

    Parameters
    ----------
    side : Trajectories
        States at the sampled times.
    timestamps : (Q,) float array
        Sampled times, increasing.
    longest : float
        Longest time between two samples across which tracks continue.
    periods : dict of str to float
        Periods of columns that wrap around.
    """

    def __init__(
        self, side: Trajectories, timestamps: Floats, longest: float, periods: dict[str, float]
    ) -> None:
        self.side, self.timestamps, self.periods = side, timestamps, periods
        order = np.argsort(side.track, kind="stable")  # rows are sorted by time
        track, step = side.track[order], side.step[order]
        goes_on = (track[1:] == track[:-1]) & (step[1:] == step[:-1] + 1)
        goes_on &= timestamps[step[1:]] - timestamps[step[:-1]] <= longest
        self._next = np.full(len(order), -1)
        self._next[order[:-1][goes_on]] = order[1:][goes_on]
        self._bounds = StepRows.of(side).bounds

    @classmethod
    def of(cls, truth: Trajectories, own: Floats, cutoff: float, distance: Distance) -> "Timeline":
        """Sample the truth at regular times, so close that few states move far between two.

        There are no samples if no track has two states, or if the timestamps do not increase.

        Parameters
        ----------
        truth : Trajectories
            Truth as points.
        own : (T,) float array
            Timestamps of the truth.
        cutoff : float
            Distance that counts as far.
        distance : Distance
            Base distance.
        """
        time, speed = _typical_motion(truth, own, distance)
        long = float(own[-1] - own[0]) if len(own) and (np.diff(own) > 0).all() else 0.0
        none = np.zeros(0, np.intp)
        if not 0 < time < np.inf or not long:
            return cls(truth.chosen(none, none, own[:0]), own[:0], 0, {})
        far = 2 * speed * time / cutoff
        parts = min(far, FINER) if far > 1 else 1.0
        rows = max(len(truth.step), long / time) * parts
        spacing = time / parts * max(1.0, rows / TIMELINE)
        timestamps = own[0] + spacing * np.arange(int(long / spacing * (1 + 1e-9)) + 1)
        periods = periods_of(distance, truth.columns)
        truth = replace(truth, times=own, clock="number", labels=None)
        at_times, _ = interpolated(
            truth,
            truth.chosen(none, none, timestamps),
            max_gap=ACROSS * time,
            tolerance=SAME * spacing,
            periods=periods,
        )
        return cls(at_times, timestamps, ACROSS * time, periods)

    def at(self, wanted: Floats) -> StepRows:
        """Return the states at some times; at least two times must be sampled."""
        k = np.searchsorted(self.timestamps, wanted, side="right") - 1
        k = k.clip(0, len(self.timestamps) - 2)
        share = (wanted - self.timestamps[k]) / (self.timestamps[k + 1] - self.timestamps[k])
        is_next = share >= 1 - SAME
        k, share = k + is_next, share - is_next
        begin, end = self._bounds[:, k]
        count = np.where((share > -SAME) & (share < 1), end - begin, 0)
        row, step = concatenated(begin, count), np.arange(len(k)).repeat(count)
        share, after = share.repeat(count), self._next[row]
        there = places_of((after >= 0) | (np.abs(share) < SAME))
        row, share, after = row[there], share[there], after[there]
        state = on_lines(self.side, row, np.where(after < 0, row, after), share, self.periods)
        rows_of_side = self.side.chosen(row, step[there], np.arange(len(k)))
        return StepRows.of(with_state(rows_of_side, state))

    @property
    def spacing(self) -> float:
        """Time between the first two samples."""
        return float(self.timestamps[1] - self.timestamps[0])


def _typical_motion(truth: Trajectories, own: Floats, distance: Distance) -> tuple[float, float]:
    """Return the median time between two states of an object, and the median speed."""
    order = np.argsort(truth.track, kind="stable")
    row = places_of(np.diff(truth.track[order]) == 0)
    row = row[:: -(-len(row) // SEGMENTS) or 1]
    if not len(row):
        return 0.0, 0.0
    before, after = order[row], order[row + 1]
    time = own[truth.step[after]] - own[truth.step[before]]
    return median(time), median(distance(truth.state[before], truth.state[after]) / time)


SAMPLED, SAMPLED_TIMES = 600, 300
"""Largest number of examined rows of the estimate; largest number of examined steps."""

PAIRS = 1_000_000
"""Number of examined near pairs."""

CANDIDATES = 32
"""Largest number of candidate shifts."""

PROMISING = 0.4
"""A shift is refined if its gain is at least this share of the largest gain."""

HALVINGS = 7
"""The smallest difference of shifts is the time between samples, halved this number of times."""

DOUBLINGS = 5
"""Shifts are compared around the best one up to the time between samples, doubled this often."""

STRETCHES = 20
"""Number of stretches of the recording whose gains are compared."""

SIGNIFICANT = 4.0
"""Number of standard errors by which any other shift must be worse."""

LOCAL = 6.0
"""If a rival is this multiple of the uncertainty away, it is another maximum: no report."""

COMPARABLE, ALIKE = 1 / 3, 1 / 2
"""Share of the steps of the best shift that a rival must have; share of the gain at these steps."""

ROBUST = 16.0
"""A sharp fit counts pairs only up to this multiple of the median (d / c)^p."""

MIN_ERROR = 1 / 400
"""Smallest (d / c)^p that counts; smaller errors are raised to it."""

ENOUGH_NEAR = 1 / 3
"""Share of the possible pairs that must be near."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Quality of a shift of the estimate.

    Parameters
    ----------
    shift : float
        Time that is added to the timestamps of the estimate.
    costs : StepCosts
        Costs of the true states at these times, and of the estimates.
    inside : (S,) bool array, optional
        Steps that are within the recording of the truth after the shift; all by default.
    sharp : float
        Factor of (d / c)^p, at least 1, which acts like a smaller cutoff.
    """

    shift: float
    costs: StepCosts
    inside: Mask | bool = True
    sharp: float = 1.0

    @cached_property
    def gain(self) -> Floats:
        """Saving of the pairs at each step, in units of c^p (S,)."""
        gain = np.maximum(1 - self.sharp * self.costs.lost, 0.0)
        step = self.costs.step[self.costs.taken]
        saved = np.bincount(step, gain, minlength=self.costs.steps)
        return np.asarray(saved, np.float64)  # integers without pairs

    @property
    def sharpest(self) -> float:
        """`sharpest` of the pairs."""
        return sharpest(self.costs.lost)

    @cached_property
    def total(self) -> float:
        """Sum of the gain."""
        return float(self.gain.sum())

    @cached_property
    def pairs(self) -> Ints:
        """Number of pairs of each step (S,)."""
        return np.bincount(self.costs.step[self.costs.taken], minlength=self.costs.steps)

    @property
    def is_close(self) -> bool:
        """True if a large share of the possible pairs is near."""
        possible = self.costs.possible
        steps = np.count_nonzero(self.pairs)
        return int(self.pairs.sum()) >= max(PAIRED, ENOUGH_NEAR * possible) and bool(
            steps >= FEWEST_STEPS
        )

    def better(self, other: "Fit") -> float:
        """Return the number of standard errors by which this fit is better than another one."""
        return significance(self.gain - other.gain)

    def excels(self, other: "Fit") -> bool:
        """Return whether this fit is better than another one where both are within the truth.

        It also is better if the other fit has too few such steps, or a far smaller gain there.
        """
        both = self.inside & other.inside
        if (
            np.count_nonzero(both) < COMPARABLE * np.count_nonzero(self.inside)
            or other.gain[both].sum() < ALIKE * self.gain[both].sum()
        ):
            return True
        return significance((self.gain - other.gain)[both]) >= SIGNIFICANT


STARTS, ROUNDS = 6, 6
"""Number of shifts from which a displacement is searched; number of rounds of least squares."""

OUTLIERS = 4.0
"""Multiple of the median error beyond which a pair is not used."""

VARIED = 0.02
"""Smallest usable variation of velocities, as a share of the squared speeds."""

SURE = 3.0
"""Number of standard errors by which a displacement must differ from 0."""


def sharpest(lost: Floats) -> float:
    """Return the sharpness with which pairs at typical distances keep a gain (see `Fit.sharp`)."""
    typical = median(lost) if len(lost) else 1.0
    return 1 / min(max(ROBUST * typical, MIN_ERROR), 1.0)


def significance(values: Floats) -> float:
    """Return the sum over steps, in standard errors estimated from sums of stretches."""
    count = min(STRETCHES, len(values))
    if not count:
        return 0.0
    sums = np.add.reduceat(values, np.arange(count) * len(values) // count)
    total = float(sums.sum())
    spread = float(np.square(sums - total / count).sum()) * count / max(count - 1, 1)
    if spread > 1e-24 * total * total:
        return total / float(np.sqrt(spread))
    return float(np.sign(total)) * np.inf if total else 0.0


class Search:
    """Search for the shift of the estimate that fits best.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate as read.
    timestamps : pair of (T,) float arrays
        Timestamps of both on one clock, as far as it is known.
    parameters : Parameters
        Cutoff and order.
    distance : Distance
        Base distance of states without covariances.
    """

    def __init__(
        self,
        sides: tuple[Trajectories, Trajectories],
        timestamps: tuple[Floats, Floats],
        parameters: Parameters,
        distance: Distance,
    ) -> None:
        self.truth, self.estimate = (side.reduced_to(()) for side in sides)
        self.timestamps, self.parameters, self.distance = timestamps, parameters, distance
        self.steps = self._sampled()
        self.rows = StepRows.of(self.estimate, self.steps)
        self._fits = dict[tuple[float, float], Fit]()  # most shifts are tried several times

    def _sampled(self) -> Ints:
        """Return steps of the estimate that have rows, evenly spread."""
        counts = np.bincount(self.estimate.step, minlength=len(self.estimate.times))
        there = places_of(counts)
        by_rows = int(SAMPLED * len(there) / max(int(counts.sum()), 1))
        count = min(len(there), SAMPLED_TIMES, max(by_rows, FEWEST_STEPS))
        return there[np.arange(count) * len(there) // max(count, 1)]

    @property
    def is_possible(self) -> bool:
        """True if the amount of data is sufficient."""
        return (
            len(self.steps) >= FEWEST_STEPS
            and all(bool(np.isfinite(own).all()) for own in self.timestamps)
            and len(self.timeline.timestamps) > 1
        )

    @cached_property
    def timeline(self) -> Timeline:
        """Timeline of the truth."""
        return Timeline.of(self.truth, self.timestamps[0], self.parameters.cutoff, self.distance)

    def fit(self, shift: float, sharp: float = 1.0) -> Fit:
        """Return the fit of a shift; `sharp` acts like a smaller cutoff."""
        if (fitted := self._fits.get((shift, sharp))) is None:
            if sharp != 1:
                fitted = replace(self.fit(shift), sharp=sharp)
            else:
                wanted = self.timestamps[1][self.steps] + shift
                fitted = Fit(
                    shift,
                    step_costs(self.timeline.at(wanted), self.rows, self.parameters, self.distance),
                    inside=(wanted >= self.timestamps[0][0]) & (wanted <= self.timestamps[0][-1]),
                )
            self._fits[shift, sharp] = fitted
        return fitted

    def offset(
        self, shifts: Iterable[float], here: "Search | None" = None
    ) -> tuple[float, float, float] | None:
        """Return the shift that fits best, or None where the data do not decide.

        Parameters
        ----------
        shifts : iterable of float
            Additional candidates.
        here : Search, optional
            Search with the present clock of the estimate, if it differs from the clock here.

        Returns
        -------
        shift, uncertainty : float
            Time that is added to the timestamps of the estimate, and two of its standard errors.
        saving : float
            Share of the per-step GOSPA cost that the shift removes. Objects that are missed or
            false with both clocks are left out.
        """
        tried = [self.fit(shift) for shift in (0.0, *shifts, *self._candidates())]
        moved = self._beside_displacement(tried) if here is None else None
        if moved is not None:
            return moved or None
        best = max(tried, key=lambda one: one.total)
        best = self._finer(best, self.fit)
        if not best.is_close:
            return None
        sharp = best.sharpest

        def fit(shift: float) -> Fit:
            return self.fit(shift, sharp)

        tried = [fit(one.shift) for one in (*tried, best)]
        best_total = max(one.total for one in tried)
        tried += [self._finer(one, fit) for one in tried if one.total >= PROMISING * best_total]
        best = max(tried, key=lambda one: one.total)
        now = (here or self).fit(0.0, sharp)
        if best.better(now) < SIGNIFICANT:
            return None
        uncertainty, reach = self._spread(best, tried, fit)
        if not reach <= max(LOCAL * uncertainty, self.timeline.spacing) < np.inf:
            return None
        first, last = (here or self).fit(0.0), self.fit(best.shift)
        pairs = float(np.maximum(first.pairs, last.pairs).sum())
        cost = pairs - first.total
        if cost < NOTABLE_COST * pairs:
            return None
        return best.shift, uncertainty, 1 - max(pairs - last.total, 0.0) / cost

    def _beside_displacement(
        self, tried: list[Fit]
    ) -> tuple[float, float, float] | tuple[()] | None:
        """Return the shift of a displaced estimate, in the form of `offset`; None if it is unclear.

        The result is empty if the estimate is displaced and no shift fits better than none.

        Errors of pairs are e = v s + b with velocities v of the true objects. If velocities differ,
        least squares give the shift s and the displacement b. The comparison without a shift uses
        the displacement that fits best without it.
        """
        if not isinstance(self.distance, Norm) or self.timeline.periods:
            return None
        starts = sorted(tried[1:], key=lambda one: -one.total)[:STARTS]
        now = self._displaced(0.0, moves=False)
        displaced = [one for one in (self._displaced(start.shift) for start in starts) if one]
        if not displaced:
            return None
        best, uncertainty, is_sure = max(displaced, key=lambda one: one[0].total)
        if not is_sure or not best.is_close:
            return None
        sharp, before = best.sharpest, self.fit(0.0) if now is None else now[0]
        last, first = replace(best, sharp=sharp), replace(before, sharp=sharp)
        pairs = float(np.maximum(before.pairs, best.pairs).sum())
        cost = pairs - before.total
        is_none = abs(best.shift) <= uncertainty
        if is_none or last.better(first) < SIGNIFICANT or cost < NOTABLE_COST * pairs:
            return ()
        return best.shift, uncertainty, 1 - max(pairs - best.total, 0.0) / cost

    def _displaced(self, shift: float, *, moves: bool = True) -> tuple[Fit, float, bool] | None:
        """Return the best fit near a shift, with a displacement; None if it is unclear.

        The other values are two standard errors of the shift, and whether the displacement is more
        than noise.
        """
        offset, sure, uncertainty = np.zeros(len(self.estimate.columns)), False, 0.0
        for _ in range(ROUNDS):
            fit = self._fit_displaced(shift, offset)
            if len(fit.costs.taken) < PAIRED:
                return None
            errors, speeds = self._errors(fit)
            if len(errors) < PAIRED:
                return None
            centred = errors - np.median(errors, axis=0)
            far = np.linalg.norm(centred, axis=1)
            kept = far <= OUTLIERS * median(far)
            errors, speeds = errors[kept], speeds[kept]
            mean, speed = errors.mean(axis=0), speeds.mean(axis=0)
            change = 0.0
            if moves:
                varied = speeds - speed
                power = float(np.square(varied).sum())
                if not power > VARIED * float(np.square(speeds).sum()):
                    return None  # all move alike: shift and displacement cannot be separated
                change = float((varied * (errors - mean)).sum()) / power
                left = errors - mean - change * varied
                noise = float(np.square(left).sum()) / max(left.size - left.shape[1] - 1, 1)
                uncertainty = 2 * float(np.sqrt(noise / power))
                spread = np.sqrt(noise / len(errors) + np.square(speed) * noise / power)
                sure = bool((np.abs(mean - change * speed) > SURE * spread).any())
            offset, shift = mean - change * speed, shift + change
        smallest = self.timeline.spacing / 2**HALVINGS
        fit = self._fit_displaced(shift, offset)
        return fit, max(uncertainty, smallest), sure

    def _fit_displaced(self, shift: float, offset: Floats) -> Fit:
        """Return the fit of a shift, with the estimate moved back by an offset."""
        side = with_state(self.estimate, self.estimate.state - offset)
        rows = StepRows(side=side, bounds=self.rows.bounds)
        wanted = self.timestamps[1][self.steps] + shift
        costs = step_costs(self.timeline.at(wanted), rows, self.parameters, self.distance)
        return Fit(shift, costs)

    def _errors(self, fit: Fit) -> tuple[Floats, Floats]:
        """Return the errors of pairs, and the velocities of their objects (N, d).

        Estimates have the shift in time of the fit, and their states as they were read.
        """
        wanted = self.timestamps[1][self.steps] + fit.shift
        half = self.timeline.spacing / 2
        at, before, after = (self.timeline.at(wanted + by) for by in (0.0, -half, half))
        taken = fit.costs.taken
        truth, estimate = (rows[taken] for rows in fit.costs.rows)
        size = len(at.side.ids) + 1
        number = {name: k for k, name in enumerate(at.side.ids.tolist())}

        def keys(rows: StepRows) -> Ints:
            ids = [number.get(name, size - 1) for name in rows.side.ids.tolist()]
            track = np.array(ids, np.int64)[rows.track]
            return np.asarray(rows.step.astype(np.int64) * size + track)

        key = keys(at)[truth]
        states, there = [], np.ones(len(key), bool)
        for rows in (before, after):
            own = keys(rows)
            if not len(own):
                return np.zeros((0, 1)), np.zeros((0, 1))
            place = np.searchsorted(own, key).clip(max=len(own) - 1)
            there &= own[place] == key
            states.append(rows.table.state[place])
        speeds = (states[1] - states[0]) / (2 * half)
        errors = self.estimate.state[self.rows.row[estimate]] - at.table.state[truth]
        return errors[there], speeds[there]

    def _finer(self, best: Fit, fit: Callable[[float], Fit]) -> Fit:
        """Return the local maximum reached by climbing from this fit."""
        step = self.timeline.spacing
        while step >= self.timeline.spacing / 2**HALVINGS:
            near = (fit(best.shift + sign * step) for sign in (1, -1))
            moved = max(near, key=lambda one: one.total)
            if moved.total > best.total and moved.shift != best.shift:
                best = moved
            else:
                step /= 2
        return best

    def _spread(
        self, best: Fit, tried: list[Fit], fit: Callable[[float], Fit]
    ) -> tuple[float, float]:
        """Return two standard errors of the shift, and the distance of the farthest rival.

        Near its maximum, G is a parabola plus a line from noise. Consider the loss by a shift from
        the best one, in standard errors of this loss. It grows with the shift, and is 1 at two
        standard errors of the best shift.
        """
        widths = self.timeline.spacing * 2.0 ** np.arange(-HALVINGS, DOUBLINGS + 1)
        uncertainty = float(widths[0])
        reach = max(
            (abs(one.shift - best.shift) for one in tried if not best.excels(one)), default=0.0
        )
        for sign in (1, -1):
            around = [fit(best.shift + sign * float(width)) for width in widths]
            losses = [best.better(one) for one in around]
            first = max((k + 1 for k, loss in enumerate(losses) if loss < 1), default=0)
            if first == len(widths):
                return np.inf, np.inf
            if first:
                uncertainty = max(
                    uncertainty,
                    float(widths[first]) / max(losses[first], 1.0),
                    float(widths[first - 1]) if np.isinf(losses[first]) else 0.0,
                )
            reach = max(
                reach, *(abs(one.shift - best.shift) * (not best.excels(one)) for one in around)
            )
        return uncertainty, reach

    def _candidates(self) -> Floats:
        """Return shifts at which many estimates are near the truth: local maxima of their gains."""
        near, row = self._near_at_any_time()
        if not len(near.gain):
            return np.zeros(0)
        theirs = self.timestamps[1][self.steps][self.rows.step[row]]
        ours = self.timeline.timestamps[self.timeline.side.step]
        shift = ours[near.rows[0]] - theirs[near.rows[1]]
        low = float(shift.min())
        place = np.rint((shift - low) / self.timeline.spacing).astype(np.int64)
        size = int(place.max()) + 1
        key = near.rows[1] * np.int64(size) + place  # only the nearest true state of each estimate
        order = np.argsort(key, kind="stable")
        first = places_of(np.diff(key[order], prepend=-1))
        largest = np.maximum.reduceat(near.gain[order], first)
        places, at = np.unique(key[order[first]] % size, return_inverse=True)
        score = np.bincount(at, largest)
        before = np.where(np.diff(places, prepend=-2) == 1, np.roll(score, 1), 0.0)
        after = np.where(np.diff(places, append=size + 1) == 1, np.roll(score, -1), 0.0)
        peaks = places_of((score > before) & (score >= after))
        peaks = peaks[np.argsort(-score[peaks], kind="stable")][:CANDIDATES]
        return np.asarray(low + self.timeline.spacing * places[peaks])

    def _near_at_any_time(self) -> tuple[StepCosts, Ints]:
        """Return pairs of sampled rows that are near at any times, and these rows."""
        side, size = self.timeline.side, len(self.rows.row)
        truths = StepRows(side=side, bounds=np.array([[0], [len(side.step)]]))

        def near(chosen: Ints) -> StepCosts:
            rows = self.rows.row[chosen]
            some = self.estimate.chosen(
                rows, np.zeros(len(rows), np.int32), self.estimate.times[:1]
            )
            estimates = StepRows(side=some, bounds=np.array([[0], [len(rows)]]))
            return step_costs(truths, estimates, self.parameters, self.distance)

        few = np.arange(0, size, -(-size // STRETCHES))
        each = max(len(near(few).gain) / len(few), 1.0)
        count = min(size, max(STRETCHES, int(PAIRS / each)))
        chosen = np.arange(count) * size // count
        return near(chosen), chosen


COMMON_SHARE = 0.9
"""If the share of common steps is smaller, the clocks are probably wrong."""

NEARLY = 0.01
"""Timestamps that differ by less than this share of the median step are probably the same."""

POWERS = {-3: "milliseconds", -6: "microseconds", -9: "nanoseconds"}
"""Units of timestamps other than seconds, by the power of ten that converts them to seconds."""

WORTH = 0.5
"""Share of the cost that another clock must save to cause a warning."""

SUSPICIOUS = 3.0
"""A fit better by this number of standard errors, one step earlier or later, starts a search."""

MOVES = np.array([[1], [-1]])
"""Steps by which the estimate is moved for this test."""

PREFERRED = 2.0
"""Equal timestamps or a whole hour are preferred within this multiple of the uncertainty."""

MINUTE = 60
"""Seconds that `PREFERRED` times the uncertainty may not reach if an offset is rounded to hours."""

HOURS = 14
"""Largest difference of time zones in hours."""

RATES = 3.0
"""Largest ratio of the rates of two files that differ only in the unit of time."""


def clock_warnings(
    sides: "AlignedPair", request: "EvaluationRequest", sample: Sample | None
) -> list[Notice]:
    """Warn of times of two sides that look wrong; without a sample, clocks are taken as sound."""
    warnings = [_few_common(sides, request.time_matching)]
    clock = None
    if sample is not None and not _looks_sound(sample):
        clock = find_clock(sides.given, sample.parameters, sample.distance, request.recorded)
    if clock is not None and clock.saving >= WORTH:
        warnings.append(_clock_warning(clock, sides.given[0].clock))
    elif unit := _unit_of_time(sides.given):
        return [unit]
    else:
        times = sides.read[0].times, sides.read[1].times
        warnings.append(_near_misses(times, sides.alignment, request.time_matching))
    return [notice for notice in warnings if notice]


def _unit_of_time(sides: "tuple[Trajectories, Trajectories]") -> Notice | None:
    """Warn of timestamps that overlap in time only after scaling by a power of ten."""
    truth, estimate = (side.times for side in sides)
    if sides[0].clock != "number" or not len(truth) or not len(estimate):
        return None
    first, last = float(truth[0]), float(truth[-1])
    begin, end = float(estimate[0]), float(estimate[-1])
    if begin <= last and first <= end:
        return None
    for power in (*POWERS, *(-power for power in POWERS)):
        low, high = (moment * 10.0**power for moment in (begin, end))
        shared = min(last, high) - max(first, low)
        if first > 0 and shared >= 0.5 * min(last - first, high - low) > 0:
            scale = float(f"1e{power}")
            return Notice(
                code="clock-shift",
                text="the files have no time in common; with the timestamps of the estimate "
                f"multiplied by {plain(scale)}, both files cover the same time",
                remedy=option("time_scale", plain(scale)),
            )
    return None


def _few_common(sides: "AlignedPair", matching: TimeMatching) -> Notice | None:
    aligned, outages = sides.alignment, sides.axis.outages
    steps = len(aligned.truth.times)
    meaning = "at other steps objects count as missed and tracks as false"
    if matching.grid == "common":  # timestamps of the lower rate may all be of the higher rate
        steps, meaning = min(len(side.times) for side in sides.read), "other steps are left out"
    if outages is not None and outages.counted:  # outages have their own warning
        steps -= len(outages.ticks)
    if not steps or aligned.common >= COMMON_SHARE * steps:
        return None
    share = f"{100 * aligned.common / steps:.0f} %"
    return Notice(
        code="steps-unmatched",
        text=f"only {share} of the steps are in both files; {meaning}",
        remedy=f"if the clocks differ, see {option('time_tolerance')}, {option('time_offset')} and "
        f"{option('resample')}",
    )


def _near_misses(
    times: tuple[Times, Times], aligned: Alignment, matching: TimeMatching
) -> Notice | None:
    """Warn of timestamps that differ by less than 1 % of the median step."""
    if aligned.common == aligned.union or not all(map(len, times)):
        return None
    steps = [step for step in map(median_step, times) if step is not None]
    if not steps:
        return None
    clock = aligned.truth.clock
    _, _, distance = nearest(*times)
    is_close = (distance < NEARLY * min(steps)) & ~within(distance, matching.near, times, clock)
    close = distance[is_close & (distance > 0)]
    if not len(close):
        return None
    unit = SECOND if clock != "number" else 1
    wide = float(close.max())
    if close.dtype.kind == "f":  # `within` allows for the rounding of timestamps
        wide = max(wide - max(float(np.spacing(np.abs(side).max())) for side in times), 0.5 * wide)
    named = rounded_up(wide / unit)
    pairs = counted(len(close), "pair of timestamps is", "pairs of timestamps are")
    unshared = aligned.union - aligned.common
    left = unshared - 2 * len(close)
    are_left = counted(left, "timestamp remains", "timestamps remain")
    rest = f"; then {are_left} in one file only" if left > 0 else ""
    return Notice(
        code="stamps-near",
        text=f"{pairs} nearly the same, at most {named} apart (the median step is "
        f"{_step_text(min(steps), clock, *times)}); "
        f"{counted(unshared, 'timestamp is', 'timestamps are')} in one file only",
        remedy=f"{option('time_tolerance', float(named))} makes each pair one step{rest}",
    )


def median_step(times: Times) -> float | None:
    """Return the median distance of consecutive times, in the unit in which they are stored."""
    if len(times) < 2:
        return None
    return median(np.diff(times.astype(np.float64) if times.dtype.kind == "f" else times))


def _step_text(step: float, clock: str, *times: Times) -> str:
    """Format a step between timestamps, in their unit or in seconds, without their rounding."""
    floats = [side for side in times if side.dtype.kind == "f"]
    noise = 2 * max((float(np.spacing(np.abs(side).max())) for side in floats), default=0.0)
    return number(shortest(step if clock == "number" else step / SECOND, noise))


def rounded_up(value: float) -> str:
    """Round up to two digits, but ignore the last digit of a double."""
    from decimal import ROUND_CEILING, Context

    rounded = Context(prec=2, rounding=ROUND_CEILING).create_decimal(f"{value:.15g}")
    return f"{float(rounded):.15g}"


@dataclass(frozen=True, kw_only=True)
class ClockError:
    """Offset and factor that convert the timestamps of the estimate to those of the truth.

    Parameters
    ----------
    time_scale, time_offset : float
        Factor of the timestamps, and offset that is added after the multiplication. The offset is
        in the unit of the timestamps, or in seconds for ISO times.
    ahead : float
        Time by which the estimate is ahead, if only the offset is wrong; else 0.
    uncertainty : float
        Two standard errors of the offset.
    saving : float
        Share of the per-step GOSPA cost that is saved. Objects that are missed or false with both
        clocks are left out.
    steps : int
        Number of examined steps.
    """

    time_scale: float
    time_offset: float
    ahead: float
    uncertainty: float
    saving: float
    steps: int


def _looks_sound(sample: Sample) -> bool:
    """Return whether a few common steps fit, and a move by one step fits no better."""
    here = Fit(0.0, sample.here)
    if not here.is_close:
        return False
    estimate, (truth, _), count = sample.sides[1], sample.rows, len(sample.steps)
    moved = (sample.steps + MOVES).clip(0, len(estimate.times) - 1)
    truths = StepRows(side=truth.side, bounds=np.tile(truth.bounds, len(MOVES)))
    estimates = StepRows.of(estimate, moved.ravel())
    both = step_costs(truths, estimates, sample.parameters, sample.distance)
    split = int(both.step[both.taken].searchsorted(count))
    sharp = max(here.sharpest, *map(sharpest, np.split(both.lost, [split])))
    here, shifted = (Fit(0.0, costs, sharp=sharp) for costs in (sample.here, both))
    gains = shifted.gain.reshape(len(MOVES), count)
    return all(significance(gain - here.gain) <= SUSPICIOUS for gain in gains)


def find_clock(
    sides: tuple[Trajectories, Trajectories],
    parameters: Parameters,
    distance: Distance,
    given: Mapping[str, object],
) -> ClockError | None:
    """Return another clock of the estimate that fits better than all other clocks, or None.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate as read.
    parameters, distance
        Cutoff and order; base distance of states without covariances.
    given : mapping of str to object
        Values of `time_scale` and `time_offset` with which the estimate was read.
    """
    from fractions import Fraction  # lazy: slow to import, and most clocks agree

    truth, estimate = sides
    steps = [median_step(side.times) or 0.0 for side in sides]
    if not all(steps):
        return None
    own = _since(truth.times, Fraction(1), Fraction(truth.times[0].item()))
    plain: Search | None = None
    for power in (0, *POWERS, *(-power for power in POWERS)):
        factor = Fraction(10) ** power
        if power and not 1 / RATES <= steps[1] * float(factor) / steps[0] <= RATES:
            continue
        theirs = _since(estimate.times, factor, Fraction(truth.times[0].item()))
        search = Search(sides, (own, theirs), parameters, distance)
        if not search.is_possible:
            return None
        unit = 1 if truth.clock == "number" else SECOND
        ends = own[0] - theirs[0], own[-1] - theirs[-1]
        zones = (3600.0 * unit * hours for hours in range(-HOURS, HOURS + 1) if hours)
        offset = search.offset((*ends, *zones), plain)
        if offset is not None:
            return _clock(search, *offset, factor, given)
        plain = plain or search
    return None


def _since(times: Times, factor: "Fraction", begin: "Fraction") -> Floats:
    """Return scaled times since a begin, exact until they are rounded to doubles."""
    from fractions import Fraction  # lazy: slow to import, and most clocks agree

    first = times[0].item()
    if times.dtype.kind == "i":
        whole = times.astype(np.int64).view(np.uint64)
        elapsed = np.asarray(whole - whole[0], np.float64)
    else:
        elapsed = np.asarray(times - times[0], np.float64)
    return elapsed * float(factor) + float(Fraction(first) * factor - begin)


def _clock(
    search: Search,
    shift: float,
    uncertainty: float,
    saving: float,
    factor: "Fraction",
    given: Mapping[str, object],
) -> ClockError:
    """Return the offset in its simplest form among those that fit equally well."""
    from fractions import Fraction  # lazy: slow to import, and most clocks agree

    unit = 1 if search.truth.clock == "number" else SECOND
    hour, near = 3600 * unit, PREFERRED * uncertainty
    hours = round(shift / hour)
    if 0 < abs(hours) <= HOURS and abs(hours * hour - shift) <= near < MINUTE * unit:
        offset = Fraction(hours * hour)
    else:
        offset = _equal_timestamps(search, shift, uncertainty, factor) or Fraction(
            _rounded(shift, uncertainty)
        )
    uncertainty += abs(float(offset) - shift)
    scaled, added = (
        Fraction(repr(given.get(name, neutral)))
        for name, neutral in (("time_scale", 1.0), ("time_offset", 0.0))
    )
    return ClockError(
        time_scale=float(f"{float(scaled * factor):.12g}"),
        time_offset=float(f"{float(added * factor + offset / unit):.12g}"),
        ahead=-float(f"{float(offset / unit):.12g}") if factor == 1 else 0.0,
        uncertainty=float(f"{uncertainty / unit:.2g}"),
        saving=saving,
        steps=len(search.steps),
    )


def _equal_timestamps(
    search: Search, shift: float, uncertainty: float, factor: "Fraction"
) -> "Fraction | None":
    """Return the offset that makes timestamps equal, if there is one within the uncertainty."""
    from fractions import Fraction  # lazy: slow to import, and most clocks agree

    own, theirs = search.timestamps[0], search.timestamps[1][search.steps] + shift
    after = np.searchsorted(own, theirs).clip(1, len(own) - 1)
    at = after - (theirs - own[after - 1] <= own[after] - theirs)
    differences = own[at] - theirs
    k = int(np.argsort(differences, kind="stable")[len(differences) // 2])
    step = median_step(own) or 0.0
    same = np.abs(differences - differences[k]) <= NEARLY * step
    if abs(differences[k]) > PREFERRED * uncertainty or np.count_nonzero(same) < COMMON_SHARE * len(
        differences
    ):
        return None
    first, second = search.truth.times[at[k]], search.estimate.times[search.steps[k]]
    return Fraction(first.item()) - factor * Fraction(second.item())


def _rounded(value: float, noise: float) -> float:
    """Round off digits far below the noise."""
    digits = math.ceil(-math.log10(noise / 2))
    return round(value, digits)


def _clock_warning(clock: ClockError, kind: str) -> Notice:
    cures = [] if clock.time_scale == 1 else [option("time_scale", plain(clock.time_scale))]
    if clock.time_offset:
        cures.append(option("time_offset", plain(clock.time_offset)))
    return Notice(
        code="clock-shift",
        text=f"the clock of the estimate seems to {_clock_text(clock, kind)}. With a corrected "
        f"clock, the per-step GOSPA cost of {counted(clock.steps, 'step')} falls by "
        f"{min(100 * clock.saving, 99):.0f} % (without targets that are missed or false before "
        "and after the correction)",
        remedy=f"write both files by one clock, or use {' '.join(cures)}. Do not correct the "
        "latency of a tracker, because it is an error that should count. A constant error of "
        "position along the direction of travel looks like a wrong clock, too",
    )


def _clock_text(clock: ClockError, kind: str) -> str:
    if clock.ahead:
        way = "ahead" if clock.ahead > 0 else "behind"
        name = "" if kind == "number" else " s"
        return f"be {abs(clock.ahead):.10g}{name} {way} (+/- {clock.uncertainty:g}{name})"
    power = round(math.log10(clock.time_scale))
    small, times = POWERS[-abs(power)], f"{10 ** abs(power):,} times"
    if power < 0:
        return f"run {times} as fast as that of the truth, like {small} next to seconds"
    return f"run {times} slower than that of the truth, like seconds next to {small}"
