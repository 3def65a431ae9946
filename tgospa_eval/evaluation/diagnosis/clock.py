"""Warnings about times: timestamps that nearly match, a wrong clock, or another unit of time.

The tests take little time compared to an evaluation, because they examine only the timestamps and
some evenly spread steps. An offset of the clock is searched only if these steps do not fit.

A shift is a time that is added to the timestamps of the estimate. The best shift maximises the gain
G(shift). This is the sum, over the steps of the estimate, of the gain G of the module `costs`.
Between its states, the truth moves on straight lines. A true state and an estimate that are near
each other suggest a shift, which is the difference of their times. Shifts that many such pairs
suggest are candidates, and so are whole hours. The candidates with the largest G are refined. The
best shift is reported only if its gain exceeds that of all farther shifts by several standard
errors. A shift that moves most steps out of the recording of the truth is not compared. Standard
errors are estimated from the gains of separate stretches of the recording. For targets at rest or
on a circle, many shifts are about equally good, and nothing is reported.
"""

import math
from collections.abc import Callable, Iterable
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
    FIRST_STEPS,
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
from tgospa_eval.tracks.alignment import Alignment, TimeMatching, Times, align, nearest, within
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.interpolation import interpolated, on_lines
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from fractions import Fraction

    from tgospa_eval.evaluation.prepare import AlignedPair
    from tgospa_eval.evaluation.request import EvaluationRequest


SAME = 0.01
"""Times count as equal if they differ by less than this share of the time between samples."""

TIMELINE = 300_000
"""Largest number of times at which the truth is sampled, and of sampled states."""

SEGMENTS = 2_000
"""Largest number of pairs of consecutive true states that give the typical speed and time."""

ACROSS = 5.0
"""An object continues across gaps up to this multiple of the typical time between its states."""

FINER = 16
"""Largest number of samples in the typical time between two states, for fast targets."""


class Timeline:
    """True states at any time, on straight lines between states at sampled times.

    Parameters
    ----------
    side : Trajectories
        States at the sampled times.
    timestamps : (Q,) float array
        The sampled times, increasing.
    longest : float
        Longest time between two samples across which an object continues.
    periods : dict of str to float
        Periods of columns that wrap around.
    """

    def __init__(
        self, side: Trajectories, timestamps: Floats, longest: float, periods: dict[str, float]
    ) -> None:
        self.side, self.timestamps, self.periods = side, timestamps, periods
        self.longest = longest
        order = np.argsort(side.track, kind="stable")  # rows of a track stay in order of time
        track, step = side.track[order], side.step[order]
        goes_on = (track[1:] == track[:-1]) & (step[1:] == step[:-1] + 1)
        goes_on &= timestamps[step[1:]] - timestamps[step[:-1]] <= longest
        self._next = np.full(len(order), -1)
        self._next[order[:-1][goes_on]] = order[1:][goes_on]
        self._bounds = StepRows.of(side).bounds

    @classmethod
    def of(cls, truth: Trajectories, own: Floats, cutoff: float, distance: Distance) -> "Timeline":
        """Sample the truth at regular times, so close that objects rarely move far between them.

        There are no samples if no object has two states, or if the timestamps do not increase.

        Parameters
        ----------
        truth : Trajectories
            Truth as points.
        own : (T,) float array
            Timestamps of the truth.
        cutoff : float
            Cutoff. A move between two samples is far if it is longer than half of the cutoff.
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
        """Return the true states at the times `wanted`; at least two times must be sampled."""
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
"""Largest numbers of examined rows and of examined steps of the estimate."""

PAIRS = 1_000_000
"""Approximate largest number of examined near pairs."""

CANDIDATES = 32
"""Largest number of candidate shifts."""

PROMISING = 0.4
"""A candidate is refined if its gain is at least this share of the largest gain."""

HALVINGS = 7
"""The smallest change of a shift is the time between samples, halved this many times."""

DOUBLINGS = 5
"""Number of doublings of the time between samples, which give the farthest compared shift.

The best shift is compared with shifts around it. The farthest of them differs from it by the time
between samples, doubled this many times."""

STRETCHES = 20
"""Number of stretches of the recording whose gains give the standard errors."""

SIGNIFICANT = 4.0
"""Number of standard errors by which other shifts must be worse than the best one."""

LOCAL = 6.0
"""Largest distance of a rival from the best shift, as a multiple of the uncertainty.

A rival is a shift that is not clearly worse than the best one. If a rival is farther away, it
belongs to another maximum of the gain, and no shift is reported."""

COMPARABLE, ALIKE = 1 / 3, 1 / 2
"""A shift is a rival only if it shares enough with the best shift.

Common steps are steps inside the recording of the truth after both shifts. They must be at least
the share COMPARABLE of the steps of the best shift. At the common steps, the gain of the rival must
be at least the share ALIKE of the gain of the best shift."""

ROBUST = 16.0
"""A sharp fit counts only pairs with (d / c)^p below this multiple of the median of (d / c)^p."""

MIN_ERROR = 1 / 400
"""Smallest limit of (d / c)^p for pairs of a sharp fit, if the limit of `ROBUST` is smaller."""

ENOUGH_NEAR = 1 / 3
"""Smallest share of the possible pairs that must be near for a good fit."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Shift of the estimate, and how well it fits the truth.

    Parameters
    ----------
    shift : float
        Time that is added to the timestamps of the estimate.
    costs : StepCosts
        Costs of the examined S steps, with true states at the shifted timestamps.
    inside : (S,) bool array, optional
        Mask of the steps that are in the recording of the truth after the shift; by default all.
    sharp : float
        Sharpness: a factor of (d / c)^p, at least 1, which acts like a smaller cutoff.
    """

    shift: float
    costs: StepCosts
    inside: Mask | bool = True
    sharp: float = 1.0

    @cached_property
    def gain(self) -> Floats:
        """Sum of the gains of the pairs at each step, in units of c^p, (S,)."""
        gain = np.maximum(1 - self.sharp * self.costs.lost, 0.0)
        step = self.costs.step[self.costs.taken]
        saved = np.bincount(step, gain, minlength=self.costs.steps)
        return np.asarray(saved, np.float64)  # without pairs, bincount returns integers

    @property
    def sharpest(self) -> float:
        """Sharpness that suits the pairs (see the function `sharpest`)."""
        return sharpest(self.costs.lost)

    @cached_property
    def total(self) -> float:
        """Sum of the gains of all steps."""
        return float(self.gain.sum())

    @cached_property
    def pairs(self) -> Ints:
        """Number of pairs of each step (S,)."""
        return np.bincount(self.costs.step[self.costs.taken], minlength=self.costs.steps)

    @property
    def is_close(self) -> bool:
        """True if a large share of the possible pairs is near, at enough steps."""
        possible = self.costs.possible
        steps = np.count_nonzero(self.pairs)
        return int(self.pairs.sum()) >= max(PAIRED, ENOUGH_NEAR * possible) and bool(
            steps >= FEWEST_STEPS
        )

    def better(self, other: "Fit") -> float:
        """Return by how many standard errors the gain of this fit exceeds that of another one."""
        return significance(self.gain - other.gain)

    def excels(self, other: "Fit") -> bool:
        """Return whether this fit is clearly better than another one.

        Both are compared at their common steps, which are inside the recording of the truth after
        both shifts. This fit also excels if the common steps are only a small part of its own
        steps, or if the other fit has far less gain at the common steps.
        """
        both = self.inside & other.inside
        if (
            np.count_nonzero(both) < COMPARABLE * np.count_nonzero(self.inside)
            or other.gain[both].sum() < ALIKE * self.gain[both].sum()
        ):
            return True
        return significance((self.gain - other.gain)[both]) >= SIGNIFICANT


STARTS, ROUNDS = 6, 6
"""Numbers of shifts and of rounds in the search for an estimate that is also displaced in space.

A search begins at each of these shifts, and has this number of rounds."""

OUTLIERS = 4.0
"""A pair is not used if its error is above this multiple of the median error."""

VARIED = 0.02
"""Smallest variation of velocities for a search for a displacement, relative to squared speeds.

With less variation, a shift in time looks the same as a displacement."""

SURE = 3.0
"""A displacement is more than noise if it exceeds this number of standard errors."""


def sharpest(lost: Floats) -> float:
    """Return a sharpness with which pairs at typical distances keep a gain (see `Fit.sharp`).

    `lost` has the value (d / c)^p of each pair.
    """
    typical = median(lost) if len(lost) else 1.0
    return 1 / min(max(ROBUST * typical, MIN_ERROR), 1.0)


def significance(values: Floats) -> float:
    """Return the sum of `values` over steps, divided by its standard error.

    The standard error is estimated from the sums of `STRETCHES` stretches of steps.
    """
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
        Truth and estimate as they were read.
    timestamps : pair of (T,) float arrays
        Timestamps of truth and estimate in the same unit, before the shift.
    parameters : Parameters
        Cutoff and order.
    distance : Distance
        Base distance that compares states without their covariances.
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
        self._fits = dict[tuple[float, float], Fit]()  # many shifts are tried several times

    def _sampled(self) -> Ints:
        """Return evenly spread steps at which the estimate has rows."""
        counts = np.bincount(self.estimate.step, minlength=len(self.estimate.times))
        there = places_of(counts)
        by_rows = int(SAMPLED * len(there) / max(int(counts.sum()), 1))
        count = min(len(there), SAMPLED_TIMES, max(by_rows, FEWEST_STEPS))
        return there[np.arange(count) * len(there) // max(count, 1)]

    @property
    def is_possible(self) -> bool:
        """True if there are enough steps, and the truth can be sampled."""
        return (
            len(self.steps) >= FEWEST_STEPS
            and all(bool(np.isfinite(own).all()) for own in self.timestamps)
            and len(self.timeline.timestamps) > 1
        )

    @cached_property
    def timeline(self) -> Timeline:
        """Truth at any time."""
        return Timeline.of(self.truth, self.timestamps[0], self.parameters.cutoff, self.distance)

    def fit(self, shift: float, sharp: float = 1.0) -> Fit:
        """Return the fit of a shift; `sharp` is its sharpness (see `Fit.sharp`)."""
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
        """Return the shift that fits best, or None if the data do not decide.

        Parameters
        ----------
        shifts : iterable of float
            Candidates in addition to those that this method finds itself.
        here : Search, optional
            Search with the timestamps as they were read. It is given if this search has them in
            another unit.

        Returns
        -------
        shift, uncertainty : float
            Time that is added to the timestamps of the estimate, and two of its standard errors.
        saving : float
            Share of the per-step GOSPA cost that the shift removes. Objects that are missed or
            false before and after the shift are left out.
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
        """Return the shift of an estimate that is also displaced in space, in the form of `offset`.

        The result is None if a displacement is not clear. The result is empty if the estimate is
        displaced, but no shift is clearly better than the shift 0.

        The error e of a pair is v s + b, where v is the velocity of the true object, s the shift
        and b the displacement. If velocities differ, least squares give s and b. The best
        displacement is also computed for the shift 0, before both shifts are compared.
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
        """Return the fit with the best shift and displacement near `shift`, or None if unclear.

        The second result is two standard errors of the best shift. The third result is True if the
        displacement is more than noise. With `moves` False, only the displacement is searched, and
        the shift stays as it is.
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
                    return None  # with one velocity, shift and displacement look the same
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
        """Return the errors of the pairs of a fit, and the velocities of the objects, (N, d) each.

        The timestamps of the estimate have the shift of the fit. Its states are those of the file,
        without a displacement.
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
        """Return the local maximum of the gain that is reached from this fit in small steps."""
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
        """Return two standard errors of the best shift, and how far the farthest rival is from it.

        Near its maximum, the gain G is a parabola, to which noise adds a straight line. The loss of
        a shift is the largest gain minus its gain. The loss divided by its standard error grows in
        proportion to the distance from the best shift. This quotient is 1 at the distance of two
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
        """Return shifts at which many estimates are near the truth.

        They are the local maxima of a histogram of shifts, in which each near pair counts by its
        gain. If an estimate has several pairs at a shift, only the nearest pair counts.
        """
        near, row = self._near_at_any_time()
        if not len(near.gain):
            return np.zeros(0)
        theirs = self.timestamps[1][self.steps][self.rows.step[row]]
        ours = self.timeline.timestamps[self.timeline.side.step]
        shift = ours[near.rows[0]] - theirs[near.rows[1]]
        low = float(shift.min())
        place = np.rint((shift - low) / self.timeline.spacing).astype(np.int64)
        size = int(place.max()) + 1
        key = near.rows[1] * np.int64(size) + place  # by estimate and shift
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
        """Return near pairs of states at any times, and the indices of the used estimates.

        They are indices in `self.rows`.
        """
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
"""If the share of steps that are in both files is smaller, the clocks are probably different."""

NEARLY = 0.01
"""Timestamps that differ by less than this share of the median step are probably the same."""

SCATTER = 0.2
"""Timestamps scatter around equal times if one in ten is equal or on either side of equality.

Equal means here up to this share of the largest difference. A constant delay does not scatter."""

POWERS = {-3: "milliseconds", -6: "microseconds", -9: "nanoseconds"}
"""Units of timestamps, by the power of ten that converts them to seconds."""

WORTH = 0.5
"""Smallest share of the cost that another clock must save to cause a warning."""

SUSPICIOUS = 3.0
"""If a move by one step fits better by this number of standard errors, a search begins."""

MOVES = np.array([[1], [-1]])
"""Numbers of steps by which the estimate is moved for the test of `SUSPICIOUS`."""

PREFERRED = 2.0
"""Largest difference of a simpler offset from the best shift, as a multiple of the uncertainty.

An offset is simpler if it is a whole number of hours, or makes timestamps equal. Such an offset is
preferred. If states are compared at equal timestamps only, an offset that makes timestamps equal is
preferred if it differs by up to half a step."""

MINUTE = 60
"""Limit in seconds for the uncertainty of an offset that is rounded to whole hours.

`PREFERRED` times the uncertainty must be below this limit."""

HOURS = 14
"""Largest offset, in hours, that may be a difference of time zones."""

LONGEST = 100
"""Largest ratio of the lengths of two recordings that differ only in the unit of time."""

RATES = 3.0
"""Largest ratio of the rates of truth and estimate, if they differ only in the unit of time."""


def clock_warnings(
    sides: "AlignedPair", request: "EvaluationRequest", sample: Sample | None
) -> list[Notice]:
    """Return warnings about times that look wrong; without a sample, no other clock is searched."""
    warnings = [_few_common(sides, request.time_matching)]
    near, tolerance = _near_misses(sides.read, sides.alignment, request.time_matching)
    clock = None
    if sample is not None:
        joined = sample
        if tolerance:  # a shift is not searched if joined timestamps suffice
            both = align(*sides.read, TimeMatching(tolerance=tolerance))
            pair = both.truth, both.estimate
            joined = Sample(pair, sample.parameters, sample.distance, FIRST_STEPS)
        if not _looks_sound(joined):
            clock = find_clock(sides.given, sample.parameters, sample.distance, request)
    if clock is not None and clock.saving >= WORTH:
        if sides.in_parts and ("interpolate", "truth") in clock.cures:
            clock = replace(clock, cures=())
        warnings.append(_clock_warning(clock, sides.given[0].clock))
    elif unit := _unit_of_time(sides.given):
        return [unit]
    else:
        warnings.append(near)
    return [notice for notice in warnings if notice]


def _unit_of_time(sides: "tuple[Trajectories, Trajectories]") -> Notice | None:
    """Warn if truth and estimate overlap in time only after scaling by a power of ten."""
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
        shorter, longer = sorted((last - first, high - low))
        if first > 0 and shared >= 0.5 * shorter > 0 and longer <= LONGEST * shorter:
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
    if matching.grid == "common":  # the slower side may have all its steps in common
        steps, meaning = min(len(side.times) for side in sides.read), "other steps are left out"
    if outages is not None and outages.counted:  # outages have their own warning
        steps -= len(outages.ticks)
    if not steps or aligned.common >= COMMON_SHARE * steps:
        return None
    share = f"{100 * aligned.common / steps:.0f} %"
    way = ""
    if sides.same_header and 2 * aligned.common < steps:
        way = f"{sides.same_header} reads both times from columns of one name; "
    return Notice(
        code="steps-unmatched",
        text=f"only {share} of the steps are in both files; {meaning}",
        remedy=f"{way}if the clocks differ, see {option('time_tolerance')}, "
        f"{option('time_offset')} and {option('resample')}",
    )


def _near_misses(
    sides: tuple[Trajectories, Trajectories], aligned: Alignment, matching: TimeMatching
) -> tuple[Notice | None, float]:
    """Warn of timestamps that nearly match, but are not equal.

    They match within 1 % of the median step; or, if they scatter around equal times, within a third
    of the smallest step. The second result is the tolerance that joins nearly all of them, or 0.
    """
    times = sides[0].times, sides[1].times
    steps = [step for step in map(median_step, times) if step is not None]
    if aligned.common == aligned.union or not all(map(len, times)) or not steps:
        return None, 0.0
    clock = aligned.truth.clock
    unit = SECOND if clock != "number" else 1
    mine, other, distance = nearest(*times)
    limit, enough = NEARLY * min(steps) / unit, COMMON_SHARE * min(map(len, times))
    third = min(float(np.diff(side).min()) for side in times if len(side) > 1) / 3 / unit
    near = within(distance, third, times, clock)
    late = np.where(times[0][mine] < times[1][other], 1.0, -1.0) * distance
    late = np.sort(late[near])
    if len(late) >= max(enough, FEWEST_STEPS):
        ends = late[len(late) // 10], late[-1 - len(late) // 10]
        wide = SCATTER * max(abs(late[0]), abs(late[-1]))
        limit = max(limit, third) if ends[0] <= wide and ends[1] >= -wide else limit
    missed = (distance > 0) & ~within(distance, matching.near, times, clock)
    close = distance[missed & within(distance, limit, times, clock)]
    if not len(close):
        return None, 0.0
    wide = float(close.max())
    if close.dtype.kind == "f":  # a tolerance already allows for rounding of numbers
        wide = max(wide - max(float(np.spacing(np.abs(side).max())) for side in times), 0.5 * wide)
    named = rounded_up(wide / unit)
    close = distance[missed & within(distance, float(named), times, clock)]
    pairs = counted(len(close), "pair of timestamps is", "pairs of timestamps are")
    unshared = aligned.union - aligned.common
    left = unshared - 2 * len(close)
    are_left = counted(left, "timestamp remains", "timestamps remain")
    rest = f"; then {are_left} in one file only" if left > 0 else ""
    suffices = np.count_nonzero(within(distance, float(named), times, clock)) >= enough
    notice = Notice(
        code="stamps-near",
        text=f"{pairs} nearly the same, at most {named} apart (the median step is "
        f"{_step_text(min(steps), clock, *times)}); "
        f"{counted(unshared, 'timestamp is', 'timestamps are')} in one file only",
        remedy=f"{option('time_tolerance', float(named))} makes each pair one step{rest}",
    )
    return notice, float(named) if suffices else 0.0


def median_step(times: Times) -> float | None:
    """Return the median difference of consecutive times, in the unit in which they are stored."""
    if len(times) < 2:
        return None
    return median(np.diff(times.astype(np.float64) if times.dtype.kind == "f" else times))


def _step_text(step: float, clock: str, *times: Times) -> str:
    """Format a step between timestamps, without digits that come from rounding of `times`.

    The unit is that of the timestamps, or seconds.
    """
    floats = [side for side in times if side.dtype.kind == "f"]
    noise = 2 * max((float(np.spacing(np.abs(side).max())) for side in floats), default=0.0)
    return number(shortest(step if clock == "number" else step / SECOND, noise))


def rounded_up(value: float) -> str:
    """Round up to two digits, after removing rounding errors by rounding to 15 digits."""
    from decimal import ROUND_CEILING, Context

    rounded = Context(prec=2, rounding=ROUND_CEILING).create_decimal(f"{value:.15g}")
    return f"{float(rounded):.15g}"


@dataclass(frozen=True, kw_only=True)
class ClockError:
    """Correction of the clock of the estimate, which gives the clock of the truth.

    Parameters
    ----------
    time_scale, time_offset : float
        Factor of the timestamps, and offset that is added after the multiplication. The offset is
        in the unit of the timestamps, or in seconds for ISO times.
    cures : tuple of (str, object)
        Options with which timestamps become equal, or with which the truth is interpolated.
    ahead : float
        Time by which the clock of the estimate is ahead; 0 if the unit of time is also wrong.
    uncertainty : float
        Two standard errors of the offset.
    saving : float
        Share of the per-step GOSPA cost that the correction saves. Objects that are missed or false
        before and after the correction are left out.
    steps : int
        Number of examined steps.
    """

    time_scale: float
    time_offset: float
    cures: tuple[tuple[str, object], ...]
    ahead: float
    uncertainty: float
    saving: float
    steps: int


def _looks_sound(sample: Sample) -> bool:
    """Return whether the steps of the sample fit, and fit no better after a move by one step."""
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
    request: "EvaluationRequest",
) -> ClockError | None:
    """Return a correction of the clock of the estimate if it fits clearly best, or None.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate as they were read.
    parameters, distance
        Cutoff and order, and the base distance, which compares states without covariances.
    request : EvaluationRequest
        Options of the evaluation. The estimate was read with its `time_scale` and `time_offset`.
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
            return _clock(search, *offset, factor, request, (plain or search).fit(0.0))
        plain = plain or search
    return None


def _since(times: Times, factor: "Fraction", begin: "Fraction") -> Floats:
    """Return the times, multiplied by `factor`, minus `begin`, with little rounding."""
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
    request: "EvaluationRequest",
    now: Fit,
) -> ClockError:
    """Return the correction with the simplest offset among those that fit equally well.

    A whole number of hours comes first, then an offset that makes different timestamps equal, then
    the best shift, rounded by its uncertainty.
    """
    from fractions import Fraction  # lazy: slow to import, and most clocks agree

    unit = 1 if search.truth.clock == "number" else SECOND
    hour, near = 3600 * unit, PREFERRED * uncertainty
    hours = round(shift / hour)
    matching = request.time_matching
    moves = matching.interpolate is not None or matching.resample is not None
    step = median_step(search.timestamps[0]) or 0.0
    equal = _equal_timestamps(search, shift, near if moves else max(near, step / 2), factor)
    if 0 < abs(hours) <= HOURS and abs(hours * hour - shift) <= near < MINUTE * unit:
        offset = Fraction(hours * hour)
    elif equal is not None and (equal[0] or factor != 1):
        offset = equal[0]
    else:
        offset = Fraction(_rounded(shift, uncertainty))
    uncertainty += abs(float(offset) - shift)
    scaled, added = (
        Fraction(repr(request.recorded.get(name, neutral)))
        for name, neutral in (("time_scale", 1.0), ("time_offset", 0.0))
    )
    exact = added * factor + offset / unit
    time_scale, time_offset = float(f"{float(scaled * factor):.12g}"), float(f"{float(exact):.12g}")
    if abs(time_offset - exact) * unit > NEARLY * NEARLY * step:
        time_offset = float(exact)
    cures: list[tuple[str, object]] = [("time_scale", plain(time_scale))] * (time_scale != 1)
    cures += [("time_offset", plain(time_offset))] * bool(time_offset)
    if equal is not None and not moves:
        tolerance = equal[1] + unit * abs(float(time_offset - exact))
        if tolerance > 4 * float(np.spacing(float(np.abs(search.truth.times[[0, -1]]).max()))):
            # rounded up, because not all steps are examined
            wide = 10.0 ** math.ceil(math.log10(tolerance / unit))
            cures.append(("time_tolerance", plain(wide)))
    elif not moves:
        gap = rounded_up(search.timeline.longest / unit)
        cures += [("interpolate", "truth"), ("max_gap", gap)]
    works = search.fit(float(offset)).total > now.total and (moves or equal is None or equal[0])
    works = works and (moves or equal is not None or matching.grid == "union")
    return ClockError(
        time_scale=time_scale,
        time_offset=time_offset,
        cures=tuple(cures) if works or factor != 1 else (),
        ahead=-float(f"{float(offset / unit):.12g}") if factor == 1 else 0.0,
        uncertainty=float(f"{uncertainty / unit:.2g}"),
        saving=saving,
        steps=len(search.steps),
    )


def _equal_timestamps(
    search: Search, shift: float, far: float, factor: "Fraction"
) -> "tuple[Fraction, float] | None":
    """Return an offset that makes most timestamps equal, if one is nearer than `far` to `shift`.

    The second result is the largest difference that remains between these timestamps. The offset 0
    is preferred.
    """
    from fractions import Fraction  # lazy: slow to import, and most clocks agree

    own, theirs = search.timestamps[0], search.timestamps[1][search.steps]
    step = median_step(own) or 0.0
    for start in (0.0, shift):
        moved = theirs + start
        after = np.searchsorted(own, moved).clip(1, len(own) - 1)
        at = after - (moved - own[after - 1] <= own[after] - moved)
        differences = own[at] - moved
        k = int(np.argsort(differences, kind="stable")[len(differences) // 2])
        distance = np.abs(differences - (differences[k] if start else 0.0))
        same = distance <= NEARLY * step
        move = abs(differences[k]) if start else abs(shift)
        if move <= far and np.count_nonzero(same) >= COMMON_SHARE * len(same):
            first, second = search.truth.times[at[k]], search.estimate.times[search.steps[k]]
            offset = Fraction(first.item()) - factor * Fraction(second.item())
            return (offset if start else Fraction(0)), float(distance[same].max())
    return None


def _rounded(value: float, noise: float) -> float:
    """Round to a power of ten that is at most half of the noise, and above a twentieth of it."""
    digits = math.ceil(-math.log10(noise / 2))
    return round(value, digits)


def _clock_warning(clock: ClockError, kind: str) -> Notice:
    cures = " ".join(option(name, value) for name, value in clock.cures)
    return Notice(
        code="clock-shift",
        text=f"the clock of the estimate seems to {_clock_text(clock, kind)}. With a corrected "
        f"clock, the per-step GOSPA cost of {counted(clock.steps, 'step')} falls by "
        f"{min(100 * clock.saving, 99):.0f} % (without targets that are missed or false before "
        "and after the correction)",
        remedy=f"write both files by one clock{f', or use {cures}' * bool(cures)}. Do not correct "
        "the latency of a tracker, because it is an error that should count. A constant error of "
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
