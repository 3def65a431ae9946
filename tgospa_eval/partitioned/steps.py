"""The steps of both sides, what of either is read for a block of them, and how it comes to these.

Where sides are interpolated, a state at a step is on the line between two of its track, which may
be in other blocks, and as far away as the longest gap. So a block has, beside its rows, the last
state of every track before it and the first after it, of those that are near enough.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np

from tgospa_eval.common.arrays import Ints, stretches
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.writing import writing
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.axis import Axis, Sides, on_axis, periods_of
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.partitioned.input.runs import merged_names
from tgospa_eval.partitioned.sides import PartsSide
from tgospa_eval.tracks.alignment import Alignment, Times, align
from tgospa_eval.tracks.durations import SECOND
from tgospa_eval.tracks.ignored import NOT_JUDGED, marks_of
from tgospa_eval.tracks.interpolation import at_ticks, found_at, interpolated
from tgospa_eval.tracks.trajectories import TimeArray, Trajectories


@dataclass(frozen=True, kw_only=True, eq=False)
class Stamped:
    """Stamps of a side that are steps, or not.

    Parameters
    ----------
    side : PartsSide
        The side.
    span : slice
        Which of its times are read.
    step : (k,) int array
        Which step of the block each is, -1 for none.
    """

    side: PartsSide
    span: slice
    step: Ints

    def read(self) -> Reading:
        """Its rows."""
        return read_times(self.side, self.span)

    def complete(self, found: Trajectories) -> Trajectories:
        """What of the side counts for the steps: the rows themselves."""
        return found

    def at(self, found: Trajectories, times: Times) -> tuple[Trajectories, int]:
        """Those at steps, and how many they are."""
        on = self.step >= 0
        place, there = found_at(found.times, self.side.times[self.span][on])
        rows = np.flatnonzero(there[found.step])
        step = self.step[on][place[found.step[rows]]]
        return found.chosen(rows, step, times), len(rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class Resampled:
    """Stamps of a side that is interpolated at steps.

    Parameters
    ----------
    side : PartsSide
        The side.
    span : slice
        Which of its times are read.
    near : slice
        Those that are within the longest gap of the block as well.
    ticks : (k,) array
        The steps of the block and one beside them on either hand; the first and the last of all.
    request : EvaluationRequest
        What is asked.
    number : int
        0 of the truth, 1 of the estimate.
    names : pair of str
        The side and the option, for messages.
    most : int
        Rows that are read together.
    beyond : str
        Folder of the states before and after, where gaps of any length are crossed.
    """

    side: PartsSide
    span: slice
    near: slice
    ticks: Times
    request: EvaluationRequest
    number: int
    names: tuple[str, str]
    most: int
    beyond: str = ""

    def read(self) -> Reading:
        """Its rows."""
        return read_times(self.side, self.span)

    def own(self) -> Trajectories:
        """The same as they are interpolated."""
        return self._seen(self.read().trajectories)

    def nothing(self) -> Trajectories:
        """The side without rows."""
        return self._seen(read_times(self.side, slice(0)).trajectories)

    def complete(self, found: Trajectories) -> Trajectories:
        """With the states of all tracks before and after, and the ends of the whole side."""
        if self.beyond:
            before, after = (
                load_states(Path(self.beyond, f"{name}.npz"), self.nothing())
                for name in ("before", "after")
            )
        else:
            before = self._neighbours(slice(self.near.start, self.span.start), last=True)
            after = self._neighbours(slice(self.span.stop, self.near.stop), last=False)
        whole = merged([self._seen(found), before, after])
        if not len(whole.step):
            return whole
        # With the first and the last stamp they decide what is no more than rounding.
        ends = self.side.times[[0, -1]].astype(whole.times.dtype)
        times = cast(TimeArray, np.unique(np.append(whole.times, ends)))
        step = np.searchsorted(times, whole.times)[whole.step]
        return replace(whole, step=step, times=times, labels=None)

    def at(self, found: Trajectories, times: Times) -> tuple[Trajectories, int]:
        """The states at steps, on the lines between those that were read; how many were read."""
        ticks = self.ticks[_beside(self.ticks, times)] if len(times) else self.ticks
        made = interpolated(
            found,
            Trajectories.of_times(ticks, found.columns, found.clock),
            max_gap=self.gap,
            periods=periods_of(self.request.distance, found.columns),
            names=self.names,
            across=NOT_JUDGED if self.number == 0 and across_gaps(self.request) else "",
        )
        steps = Trajectories.of_times(times, found.columns, found.clock)
        own, side = (at_ticks(one, steps, 0.0, self.names) for one in (found, made.side))
        return side, len(own.step)

    def narrow(self, found: Trajectories) -> int:
        """Pairs of states of a track at most the longest gap apart, the later one in the block."""
        own = self.side.times[self.span]
        if not len(own):
            return 0
        order = np.argsort(found.track, kind="stable")  # rows are in the order of time
        track, time = found.track[order], found.times[found.step[order]]
        second = SECOND if found.clock != "number" else 1
        narrow = (track[1:] == track[:-1]) & (np.diff(time) / second <= self.gap)
        return int(np.count_nonzero(narrow & (time[1:] >= own[0]) & (time[1:] <= own[-1])))

    @property
    def gap(self) -> float:
        """The longest."""
        return float(self.request.time_matching.gaps[self.number])

    def _seen(self, found: Trajectories) -> Trajectories:
        return found.seen_as(self.request.kinds)

    def _neighbours(self, span: slice, *, last: bool) -> Trajectories:
        """The last state of each track at some stamps, or the first."""
        edges = (span.start + stretches(self.side.counts[span], self.most)).tolist()
        found = self.nothing()
        for low, high in itertools.pairwise(edges):
            part = self._seen(read_times(self.side, slice(low, high)).trajectories)
            found = outermost(merged([found, part]), last=last)
        return found


Stretch: TypeAlias = Stamped | Resampled
"""What of a side is read for a block."""


def read_times(side: PartsSide, span: slice) -> Reading:
    """The rows at some of the times of a side, which may be none."""
    times = side.times[span]
    return side.read(times[0].item(), times[-1].item()) if len(times) else side.read(1, 0)


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
        attributes={
            name: np.concatenate([part.attributes[name] for part in parts])[order]
            for name in first.attributes
        },
    )


def outermost(side: Trajectories, *, last: bool) -> Trajectories:
    """The first row of each track, or the last."""
    track = side.track[::-1] if last else side.track
    _, row = np.unique(track, return_index=True)
    rows = np.sort(len(track) - 1 - row if last else row)
    used, step = np.unique(side.step[rows], return_inverse=True)
    return side.chosen(rows, step, side.times[used])


def save_states(side: Trajectories, path: Path) -> None:
    """Write the rows of a side that `load_states` reads."""
    columns = {name: getattr(side, name) for name in ("step", "track", "state", "times")}
    columns |= {"ids": side.ids.astype(np.str_), "marks": marks_of(side, NOT_JUDGED)}
    if side.covariance is not None:
        columns["covariance"] = side.covariance
    with writing(str(path)) as beside, beside.open("wb") as file:
        np.savez(file, **columns)


def load_states(path: Path, nothing: Trajectories) -> Trajectories:
    """The rows of a side; of it without rows all else is known."""
    with np.load(path) as found:
        columns: dict[str, Any] = dict(found)
    marks = columns.pop("marks").astype(np.float64)
    ids = columns.pop("ids").astype(object)
    return replace(nothing, **columns, ids=ids, labels=None, attributes={NOT_JUDGED: marks})


def places(times: Times, first: float, last: float) -> slice:
    """Where times from one to another are, both included."""
    begin = int(np.searchsorted(times, first, side="left"))
    return slice(begin, int(np.searchsorted(times, last, side="right")))


def _beside(all_times: Times, times: Times) -> Ints:
    """The places of times among all, of those beside them, and of the first and the last.

    A stamp may be the step next to it but for rounding.
    """
    inside = places(all_times, times[0], times[-1])
    around = np.arange(max(inside.start - 1, 0), min(inside.stop + 1, len(all_times)))
    return np.unique(np.append(around, (0, len(all_times) - 1)))


SHARES = 2
"""Rows that are read and states that are made are in memory together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockPiece:
    """Some steps, and what is read for them.

    Parameters
    ----------
    low : int
        The number of the first step.
    times : (L,) array
        The steps; there may be none.
    stretches : pair of Stamped or of Resampled
        What is read of truth and estimate.
    """

    low: int
    times: Times
    stretches: tuple[Stretch, Stretch]

    def complete(self, sides: Sides) -> Sides:
        """What was read of both sides, with what it takes beside it."""
        truth, estimate = (
            stretch.complete(side) for stretch, side in zip(self.stretches, sides, strict=True)
        )
        return truth, estimate

    def ranges(self, sides: Sides, most: int) -> list[slice]:
        """Its steps in ranges that have about so many states of both sides at most.

        Of an interpolated track that is one for each step from its first stamp to its last.
        """
        size = len(self.times)
        if isinstance(self.stretches[0], Stamped) or not size:
            return [slice(0, size)]
        states = np.zeros(size + 1, np.int64)
        for side in sides:
            first, last = np.zeros((2, len(side.ids)), np.int64)
            last[side.track] = side.step  # rows are in the order of time
            first[side.track[::-1]] = side.step[::-1]
            begin = np.searchsorted(self.times, side.times[first], side="left")
            end = np.searchsorted(self.times, side.times[last], side="right")
            states += np.bincount(begin, minlength=size + 1) - np.bincount(end, minlength=size + 1)
        edges = stretches(np.cumsum(states)[:size], max(most // SHARES, 1))
        return [slice(*ends) for ends in itertools.pairwise(edges.tolist())]


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockPlan:
    """The rows of both sides along the steps.

    Parameters
    ----------
    times : (T,) array
        The steps.
    sides : pair of PartsSide
        Truth and estimate.
    step : pair of int arrays
        Which step each of their times is, -1 for none.
    request : EvaluationRequest
        What is asked.
    names : pair of str
        The sides, for messages.
    """

    times: Times
    sides: tuple[PartsSide, PartsSide]
    step: tuple[Ints, Ints]
    request: EvaluationRequest
    names: tuple[str, str]

    @property
    def resampled(self) -> bool:
        """Whether the sides are interpolated at the steps."""
        return is_resampled(self.request, self.sides[0].times)

    @cached_property
    def rows(self) -> Ints:
        """Rows of both at each step (T,), those between it and the next as well."""
        rows = np.zeros(len(self.times), np.int64)
        if len(rows):
            for side, moments in zip(self.sides, self.moments, strict=True):
                inside = places(moments, self.times[0], self.times[-1])
                at = np.searchsorted(self.times, moments[inside], side="right") - 1
                np.add.at(rows, at, side.counts[inside])
        return rows

    @cached_property
    def moments(self) -> tuple[Times, ...]:
        """Times of both, each in the order in which they and the steps are."""
        found = []
        for side, step in zip(self.sides, self.step, strict=True):
            moments = side.times.astype(np.result_type(side.times, self.times))
            moments[step >= 0] = self.times[step[step >= 0]]
            found.append(moments)
        return tuple(found)

    def pieces(self, most: int) -> Iterator[BlockPiece]:
        """All steps, and all stamps of either side, in pieces of about so many rows."""
        moments = np.unique(np.concatenate((*self.moments, self.times)))
        rows = np.zeros(len(moments), np.int64)
        for side, own in zip(self.sides, self.moments, strict=True):
            rows[np.searchsorted(moments, own)] += side.counts
        together = max(most // SHARES, 1) if self.resampled else most
        for begin, end in itertools.pairwise(stretches(rows, together).tolist()):
            yield self._between(moments[begin].item(), moments[end - 1].item(), together)

    def piece(self, low: int, high: int) -> BlockPiece:
        """What is read for these steps."""
        first, last = self.times[low].item(), self.times[high - 1].item()
        return self._between(first, last, max(int(self.rows[low:high].sum()), 1))

    def _between(self, first: float, last: float, most: int) -> BlockPiece:
        steps = places(self.times, first, last)
        times = self.times[steps]
        stretches: list[Stretch] = []
        for number, (side, moments) in enumerate(zip(self.sides, self.moments, strict=True)):
            span = places(moments, first, last)
            if not self.resampled:
                step = self.step[number][span]
                step = np.where(step >= 0, step - steps.start, -1)
                stretches.append(Stamped(side=side, span=span, step=step))
                continue
            stretches.append(
                Resampled(
                    side=side,
                    span=span,
                    near=self._near(number, first, last),
                    ticks=self.times[_beside(self.times, np.array([first, last]))],
                    request=self.request,
                    number=number,
                    names=(self.names[number], "--resample"),
                    most=most,
                )
            )
        return BlockPiece(low=steps.start, times=times, stretches=(stretches[0], stretches[1]))

    def _near(self, number: int, first: float, last: float) -> slice:
        """The times of a side that are no farther from others than its longest gap, or hardly."""
        side, moments = self.sides[number], self.moments[number]
        if not len(moments):
            return slice(0, 0)
        low, high = moments[0].item(), moments[-1].item()
        scale = SECOND if side.clock != "number" else 1
        gap = float(self.request.time_matching.gaps[number]) * scale
        reach = 1.000001 * gap + 4 * float(np.spacing(float(max(abs(low), abs(high)))))
        if moments.dtype.kind == "i":
            reach = math.ceil(reach)
        return places(moments, max(first - reach, low), min(last + reach, high))


def across_gaps(request: EvaluationRequest) -> bool:
    """Whether the truth has states across its gaps, which are not judged."""
    return request.ignoring is not None and request.ignoring.gaps


def is_resampled(request: EvaluationRequest, times: Times) -> bool:
    """Whether the sides are interpolated at the steps: those of the truth have to be some."""
    return request.time_matching.resample is not None and len(times) > 0


# -------------------------------------------------------------------------------------------------
# The steps of both sides, from their stamps alone.

STAMP = "stamp"
"""The attribute of stamps that are rows: their numbers."""


def find_steps(
    sides: tuple[PartsSide, PartsSide],
    clocks: Sides,
    request: EvaluationRequest,
    names: tuple[str, str],
) -> tuple[Axis, Alignment, BlockPlan]:
    """How the stamps of both sides came to the steps, the same aligned, and the rows along them.

    Parameters
    ----------
    sides : pair of PartsSide
        Truth and estimate.
    clocks : pair of Trajectories
        What `clock_of` makes of them.
    request : EvaluationRequest
        What is asked.
    names : pair of str
        The sides, for messages.

    Raises
    ------
    TgospaError
        There is none, or something is wrong with the data.
    """
    matching = request.time_matching
    if is_resampled(request, sides[0].times):  # no stamp is a step
        clocks = _without_rows(clocks[0]), _without_rows(clocks[1])
    axis = on_axis(clocks, matching, request.distance, names, request.parameters.cutoff)
    grid = align(*axis.sides, matching, names)
    if grid.union and not len(grid.truth.times):
        raise ConfigError(f"--grid {matching.grid}: no step is left, none of {grid.union:,} counts")
    step = _step_of(sides[0], grid.truth), _step_of(sides[1], grid.estimate)
    sides = replace(sides[0], clock=grid.truth.clock), replace(sides[1], clock=grid.truth.clock)
    plan = BlockPlan(times=grid.truth.times, sides=sides, step=step, request=request, names=names)
    return axis, grid, plan


def clock_of(side: PartsSide) -> Trajectories:
    """The stamps of a side as a track that has a row at each, and nothing else."""
    size = len(side.times)
    return Trajectories(
        step=np.arange(size, dtype=np.int32),
        track=np.zeros(size, np.int32),
        state=np.zeros((size, len(side.columns))),
        ids=np.array(["times"], dtype=object),
        times=side.times,
        columns=side.columns,
        clock=side.clock,
        labels=side.labels,
        attributes={STAMP: np.arange(size, dtype=np.float64)},
    )


def _without_rows(side: Trajectories) -> Trajectories:
    """Its stamps alone."""
    return Trajectories.of_times(side.times, side.columns, side.clock, side.labels)


def _step_of(side: PartsSide, on: Trajectories) -> Ints:
    """Which step each stamp of a side is, from what `clock_of` became."""
    step = np.full(len(side.times), -1)
    if len(on.step):
        step[on.attributes[STAMP].astype(np.int64)] = on.step
    return step
