"""A stretch of a side that is interpolated, between states that may be in other blocks."""

import pickle
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.evaluation.axis import periods_of
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.partitioned.input.merging import merged_names
from tgospa_eval.partitioned.stretches import Ends, Readable
from tgospa_eval.tracks.alignment import Times
from tgospa_eval.tracks.durations import SECOND
from tgospa_eval.tracks.interpolation import Forecast, at_ticks, forecast, interpolated
from tgospa_eval.tracks.trajectories import TimeArray, Trajectories


@dataclass(frozen=True, kw_only=True, eq=False)
class Resampled:
    """A stretch of a side that is interpolated.

    Parameters
    ----------
    side : Readable
        The side.
    span : pair of int or float
        What is read: from one time to another.
    ticks : (k,) array
        The steps in it and one beside them on either hand; the first and the last of all.
    ends : pair of int or float, optional
        First and last stamp of the side, if it has any: with those of the steps they decide what
        is no more than rounding.
    request : EvaluationRequest
        What is asked.
    number : int
        0 of the truth, 1 of the estimate.
    names : pair of str
        The side and the option, for messages.
    around : tuple of str
        Files of the states before and after.
    """

    side: Readable
    span: tuple[float, float]
    ticks: Times
    ends: Ends | None
    request: EvaluationRequest
    number: int
    names: tuple[str, str]
    around: tuple[str, ...] = ()

    def read(self) -> Reading:
        """Its rows."""
        return self.side.read(*self.span)

    def at(self, found: Trajectories, times: Times) -> Trajectories:
        """The states at steps, on the lines between those that were read."""
        own = self._seen(found)
        before, *after = (pickle.loads(Path(path).read_bytes()) for path in self.around)
        made = interpolated(
            self._framed(merged([before, own, *after])),
            self._grid(own),
            max_gap=self.gap,
            periods=periods_of(self.request.distance, own.columns),
            names=self.names,
        )
        steps = Trajectories.of_times(times, own.columns, own.clock)
        return at_ticks(made.side, steps, 0.0, self.names)

    @property
    def gap(self) -> float:
        """The longest."""
        return float(self.request.time_matching.gaps[self.number])

    def forecast(self, found: Trajectories) -> Forecast:
        """How many states there would be at each of the ticks."""
        seen = self._seen(found)
        return forecast(self._framed(seen), self._grid(seen), max_gap=self.gap, names=self.names)

    def near(self, found: Trajectories, moment: float) -> Trajectories:
        """Those states that are no farther from a moment than the longest gap, or hardly."""
        scale = SECOND if found.clock != "number" else 1
        largest = max(map(abs, self.ends or (0.0,)))
        room = 1.000001 * self.gap * scale + 4 * float(np.spacing(float(largest)))
        apart = np.abs(found.times.astype(np.float64) - moment)
        return some(found, np.flatnonzero((apart <= room)[found.step]))

    def _seen(self, found: Trajectories) -> Trajectories:
        return found.seen_as(self.request.distance.kinds)

    def _grid(self, like: Trajectories) -> Trajectories:
        return Trajectories.of_times(self.ticks, like.columns, like.clock)

    def _framed(self, side: Trajectories) -> Trajectories:
        """With the first and the last stamp of the whole side."""
        if self.ends is None or not len(side.step):
            return side
        ends = np.asarray(self.ends, side.times.dtype)
        times = cast(TimeArray, np.unique(np.append(side.times, ends)))
        step = np.searchsorted(times, side.times)[side.step]
        return replace(side, step=step, times=times, labels=None)


def merged(parts: Sequence[Trajectories]) -> Trajectories:
    """Rows of several as one, of which no two have an (id, t)."""
    parts = [part for part in parts if len(part.step)] or list(parts[:1])
    first = parts[0]
    if len(parts) == 1:
        return first
    times = np.unique(np.concatenate([part.times for part in parts]))
    ids, track = merged_names([(part.ids, part.track) for part in parts])
    step = np.concatenate([np.searchsorted(times, part.times)[part.step] for part in parts])
    order = np.lexsort((track, step))
    covariances = [part.covariance for part in parts if part.covariance is not None]
    return replace(
        first,
        step=step[order],
        track=track[order],
        state=np.concatenate([part.state for part in parts])[order],
        ids=ids,
        times=times,
        labels=None,
        covariance=np.concatenate(covariances)[order] if covariances else None,
    )


def some(side: Trajectories, rows: NDArray[np.integer]) -> Trajectories:
    """Some of the rows, in order, without stamps that have none."""
    used, step = np.unique(side.step[rows], return_inverse=True)
    return side.chosen(rows, step, side.times[used])


def outermost(side: Trajectories, *, last: bool) -> Trajectories:
    """The first row of each track, or the last."""
    track = side.track[::-1] if last else side.track
    _, row = np.unique(track, return_index=True)
    return some(side, np.sort(len(track) - 1 - row if last else row))
