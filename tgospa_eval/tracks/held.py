"""Reports of an estimate on a common clock: each holds for the tracker's period.

A report is judged against the truth at the time of the report, and the clock only samples which
reports hold: nothing that was not reported is made (docs/how-to/which-steps-count.md).
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.tracks.trajectories import Trajectories

ROWS_TOGETHER = 1 << 20
"""Rows of the truth that are interpolated at a time."""

Sides = tuple[Trajectories, Trajectories]


@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """Which report each row of an estimate on the clock is.

    Parameters
    ----------
    reports : Trajectories
        The estimate as it was read.
    row : (R,) int array
        Of each row on the clock the row of `reports`.
    truths : (n,) object array
        Ids of the whole truth.
    truth_at : callable
        The truth at the stamps of a side.
    period : float
        For how long a report holds, in seconds or the unit of the stamps.
    declared : bool
        Whether the user named it.
    source : str
        What it was taken from, where nobody did.
    alone : int
        Reports whose track has no other one near in time.
    """

    reports: Trajectories
    row: Ints
    truths: np.ndarray
    truth_at: Callable[[Trajectories], Trajectories]
    period: float
    declared: bool
    source: str
    alone: int

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.truths.tolist())}

    def number(self, side: Trajectories) -> Ints:
        """Numbers of the truths of a side among all."""
        return np.array([self._numbers[name] for name in side.ids.tolist()], np.int64)

    def blocks(self, rows: Ints | None = None) -> Iterator[tuple[Sides, Ints]]:
        """Truth and reports at the stamps of reports, some stamps together, and the reports.

        Parameters
        ----------
        rows : int array, optional
            The reports that are needed, in order; by default all that hold somewhere.
        """
        rows = np.unique(self.row) if rows is None else rows
        steps, at = np.unique(self.reports.step[rows], return_inverse=True)
        together = max(ROWS_TOGETHER // max(len(self.truths), 1), 1)
        times, labels = self.reports.times[steps], self.reports.labels
        for begin in range(0, len(steps), together):
            part = slice(begin, begin + together)
            some = (at >= begin) & (at < begin + together)
            own = None if labels is None else labels[steps[part]]
            reports = self.reports.chosen(rows[some], at[some] - begin, times[part], own)
            yield (self.truth_at(reports), reports), rows[some]

    def on_clock(self, found: tuple[Ints, Ints, Floats], sides: Sides) -> tuple[Ints, Ints, Floats]:
        """Pairs of truths and reports as pairs of rows on the clock, where both are.

        Parameters
        ----------
        found : tuple of (N,) arrays
            Number of the truth, row of the report, distance.
        sides : pair of Trajectories
            Both on the clock.

        Returns
        -------
        tuple of arrays
            Rows of truth and estimate, in order, and distances.
        """
        truth, estimate = sides
        track, report, distance = found
        own = np.full(max(len(self.truths), 1), -1)
        own[self.number(truth)] = np.arange(len(truth.ids))
        order = np.argsort(report, kind="stable")
        count = np.bincount(report, minlength=len(self.reports.step))
        first = np.cumsum(count) - count
        pair = order[concatenated(first[self.row], count[self.row])]
        estimate_row = np.repeat(np.arange(len(self.row)), count[self.row])
        step = estimate.step[estimate_row].astype(np.int64)
        row, there = find_rows(truth, step, own[track[pair]])
        order = np.lexsort((estimate_row[there], row[there]))
        pair, estimate_row = pair[there][order], estimate_row[there][order]
        return row[there][order], estimate_row, distance[pair]

    def located(self, names: np.ndarray, rows: Ints) -> Sides:
        """Pairs of truths and rows on the clock as two sides with a row each, as they are judged.

        Parameters
        ----------
        names : (N,) object array
            Ids of the truths.
        rows : (N,) int array
            Rows of the estimate on the clock.
        """
        report = self.row[rows]
        track = np.array([self._numbers[name] for name in names.tolist()], np.int64)
        state = np.empty((len(report), len(self.reports.columns)))
        covariance: Floats | None = None
        for (truth, part), own in self.blocks(np.unique(report)):
            mine = np.flatnonzero(np.isin(report, own))
            step = part.step[np.searchsorted(own, report[mine])].astype(np.int64)
            number = np.full(len(self.truths), -1)
            number[self.number(truth)] = np.arange(len(truth.ids))
            row, _ = find_rows(truth, step, number[track[mine]])
            state[mine] = truth.state[row]
            if truth.covariance is not None:
                if covariance is None:
                    covariance = np.empty((len(report), truth.covariance.shape[1]))
                covariance[mine] = truth.covariance[row]
        steps = np.arange(len(report))
        estimate = replace(
            self.reports.chosen(report, steps, steps, None, "number"),
            track=np.zeros(len(report), np.int64),
            ids=np.array([""], dtype=object),
            attributes={},
        )
        truth = replace(estimate, state=state, covariance=covariance, clouds=None)
        return truth, estimate


def find_rows(side: Trajectories, step: Ints, track: Ints) -> tuple[Ints, Mask]:
    """Rows of a side by step and track, and where there is one; no track is -1."""
    if not len(side.step):
        return np.zeros(len(step), np.int64), np.zeros(len(step), bool)
    size = len(side.ids)
    keys = side.step.astype(np.int64) * size + side.track
    wanted = step * size + track
    row = np.searchsorted(keys, wanted).clip(max=len(keys) - 1)
    return row, (keys[row] == wanted) & (track >= 0)
