"""Where truths are between their states."""

from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import concatenated, median, places_of
from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.axis import periods_of
from tgospa_eval.evaluation.diagnosis.sample import StepRows, with_state
from tgospa_eval.problem.problem import Floats
from tgospa_eval.tracks.interpolation import interpolated, on_lines
from tgospa_eval.tracks.trajectories import Trajectories

SAME = 0.01
"""Of the time between moments of the truth: what is closer to one of them is there."""

TIMELINE = 300_000
"""States and moments of the truth that are looked at, those on lines included."""

SEGMENTS = 2_000
"""Pairs of consecutive states of a truth of which the usual speed is taken."""

ACROSS = 5.0
"""Times the usual time between two states of a truth, across which it is taken to go on."""

FINER = 16
"""Parts into which that time is divided at most, for targets that move far in it."""


class Timeline:
    """Truths at any moment, on straight lines between their states.

    Parameters
    ----------
    side : Trajectories
        States at some moments.
    moments : (Q,) float array
        Those, increasing.
    longest : float
        Time between two moments across which tracks go on.
    periods : dict of str to float
        Of columns that wrap around.
    """

    def __init__(
        self, side: Trajectories, moments: Floats, longest: float, periods: dict[str, float]
    ) -> None:
        self.side, self.moments, self.periods = side, moments, periods
        order = np.argsort(side.track, kind="stable")  # rows are in the order of time
        track, step = side.track[order], side.step[order]
        goes_on = (track[1:] == track[:-1]) & (step[1:] == step[:-1] + 1)
        goes_on &= moments[step[1:]] - moments[step[:-1]] <= longest
        self._next = np.full(len(order), -1)
        self._next[order[:-1][goes_on]] = order[1:][goes_on]
        self._bounds = StepRows.of(side).bounds

    @classmethod
    def of(cls, truth: Trajectories, own: Floats, cutoff: float, distance: Distance) -> "Timeline":
        """At regular moments, so close that few truths move far between them; none of no motion.

        Parameters
        ----------
        truth : Trajectories
            Points.
        own : (T,) float array
            Its stamps.
        cutoff : float
            What is far.
        distance : Distance
            Base distance.
        """
        time, speed = _usual(truth, own, distance)
        long = float(own[-1] - own[0]) if len(own) and (np.diff(own) > 0).all() else 0.0
        none = np.zeros(0, np.intp)
        if not 0 < time < np.inf or not long:
            return cls(truth.chosen(none, none, own[:0]), own[:0], 0, {})
        far = 2 * speed * time / cutoff
        parts = min(far, FINER) if far > 1 else 1.0
        rows = max(len(truth.step), long / time) * parts
        apart = time / parts * max(1.0, rows / TIMELINE)
        moments = own[0] + apart * np.arange(int(long / apart * (1 + 1e-9)) + 1)
        periods = periods_of(distance, truth.columns)
        truth = replace(truth, times=own, clock="number", labels=None)
        made = interpolated(
            truth,
            truth.chosen(none, none, moments),
            max_gap=ACROSS * time,
            tolerance=SAME * apart,
            periods=periods,
        )
        return cls(made.side, moments, ACROSS * time, periods)

    def at(self, wanted: Floats) -> StepRows:
        """Those at some moments, of which there are two at least."""
        k = np.searchsorted(self.moments, wanted, side="right") - 1
        k = k.clip(0, len(self.moments) - 2)
        share = (wanted - self.moments[k]) / (self.moments[k + 1] - self.moments[k])
        is_next = share >= 1 - SAME
        k, share = k + is_next, share - is_next
        begin, end = self._bounds[:, k]
        count = np.where((share > -SAME) & (share < 1), end - begin, 0)
        row, step = concatenated(begin, count), np.arange(len(k)).repeat(count)
        share, after = share.repeat(count), self._next[row]
        there = places_of((after >= 0) | (np.abs(share) < SAME))
        row, share, after = row[there], share[there], after[there]
        state = on_lines(self.side, row, np.where(after < 0, row, after), share, self.periods)
        found = self.side.chosen(row, step[there], np.arange(len(k)))
        return StepRows.of(with_state(found, state))

    @property
    def apart(self) -> float:
        """Time between the first two moments."""
        return float(self.moments[1] - self.moments[0])


def _usual(truth: Trajectories, own: Floats, distance: Distance) -> tuple[float, float]:
    """Median time between two states of a truth, and median speed."""
    order = np.argsort(truth.track, kind="stable")
    row = places_of(np.diff(truth.track[order]) == 0)
    row = row[:: -(-len(row) // SEGMENTS) or 1]
    if not len(row):
        return 0.0, 0.0
    before, after = order[row], order[row + 1]
    time = own[truth.step[after]] - own[truth.step[before]]
    return median(time), median(distance(truth.state[before], truth.state[after]) / time)
