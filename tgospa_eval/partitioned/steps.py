"""The steps of both sides, what of either is read for a block of them, and how it comes to these.

Where sides are interpolated, a state at a step is on the line between two of its track, which may
be in other blocks, and as far away as the longest gap. So all blocks are read once for the first
and the last state of each track in them. From these each gets the last state of every track before
it, and the first after it, of those that are near enough; and how many states there will be at each
step is known before there is one, so that no block makes more than there is memory for.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.checks import check_states
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.axis import Axis, Sides, on_axis, periods_of
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.partitioned.input.runs import merged_names
from tgospa_eval.partitioned.sides import PartsSide
from tgospa_eval.partitioned.tasks import Run, writing
from tgospa_eval.problem.problem import Ints
from tgospa_eval.tracks.alignment import Alignment, Times, align
from tgospa_eval.tracks.durations import SECOND
from tgospa_eval.tracks.interpolation import (
    Forecast,
    Interpolated,
    at_ticks,
    forecast,
    found_at,
    interpolated,
)
from tgospa_eval.tracks.trajectories import TimeArray, Trajectories

Ends = tuple[float, float]
"""The first and the last of some times."""

NO_SPAN = (1, 0)
"""The ends of none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockPiece:
    """Some steps, and what is read for them.

    Parameters
    ----------
    low, high : int
        The first step, and the one after the last; there may be none.
    stretches : pair of Stamped or of Resampled
        What is read of truth and estimate.
    told : bool
        Whether what is read is to be counted: no other piece counts it.
    """

    low: int
    high: int
    stretches: tuple["Stamped | Resampled", "Stamped | Resampled"]
    told: bool = True


@dataclass(frozen=True, kw_only=True, eq=False)
class Stamped:
    """A stretch whose own stamps are steps, or not.

    Parameters
    ----------
    side : PartsSide
        The side.
    span : pair of int or float
        What is read: from one time to another.
    own, step : (k,) arrays
        Times that are steps, and which of the block.
    """

    side: PartsSide
    span: Ends
    own: Times
    step: Ints

    def read(self) -> Reading:
        """Its rows."""
        return self.side.read(*self.span)

    def at(self, found: Trajectories, times: Times) -> Trajectories:
        """Those at steps."""
        place, there = found_at(found.times, self.own)
        rows = np.flatnonzero(there[found.step])
        return found.chosen(rows, self.step[place[found.step[rows]]], times)


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnTimes:
    """The stamps of a side.

    Parameters
    ----------
    side : PartsSide
        The side.
    times : (K,) array
        Distinct, in order.
    counts : (K,) int array
        Rows at each.
    step : (K,) int array
        Which step each is, -1 for none.
    """

    side: PartsSide
    times: Times
    counts: Ints
    step: Ints


@dataclass(frozen=True, kw_only=True, eq=False)
class Stamping:
    """Sides whose own stamps are steps, or not.

    Parameters
    ----------
    times : (T,) array
        The steps.
    sides : pair of OwnTimes
        Of truth and estimate.
    """

    times: Times
    sides: tuple[OwnTimes, OwnTimes]

    @cached_property
    def rows(self) -> Ints:
        """Rows of both at each step (T,), those between it and the next as well."""
        rows = np.zeros(len(self.times), np.int64)
        if len(rows):
            for side, moments in zip(self.sides, self.moments, strict=True):
                begin, end = places(moments, self.times[0], self.times[-1])
                at = np.searchsorted(self.times, moments[begin:end], side="right") - 1
                np.add.at(rows, at, side.counts[begin:end])
        return rows

    @cached_property
    def moments(self) -> tuple[Times, ...]:
        """Times of both, each in the order in which they and the steps are."""
        found = []
        for side in self.sides:
            on = side.step >= 0
            moments = side.times.astype(np.result_type(side.times, self.times))
            moments[on] = self.times[side.step[on]]
            found.append(moments)
        return tuple(found)

    def pieces(self, most: int) -> Iterator[BlockPiece]:
        """All steps, and all stamps of either side, in pieces of about so many rows."""
        for begin, end in self.spans(most):
            yield self._between(begin, end)

    def spans(self, most: int) -> Iterator[Ends]:
        """The first and the last moment of each piece."""
        moments = np.unique(np.concatenate((*self.moments, self.times)))
        rows = np.zeros(len(moments), np.int64)
        for side, own in zip(self.sides, self.moments, strict=True):
            rows[np.searchsorted(moments, own)] += side.counts
        before = np.cumsum(rows) - rows
        cuts = np.flatnonzero(np.diff(before // most, prepend=-1))
        for begin, end in itertools.pairwise([*cuts.tolist(), len(moments)]):
            yield moments[begin].item(), moments[end - 1].item()

    def piece(self, low: int, high: int) -> BlockPiece:
        """What is read for these steps."""
        return self._between(self.times[low].item(), self.times[high - 1].item())

    def _between(self, first: float, last: float) -> BlockPiece:
        low, high = places(self.times, first, last)
        stretches = []
        for side, moments in zip(self.sides, self.moments, strict=True):
            begin, end = places(moments, first, last)
            own, step = side.times[begin:end], side.step[begin:end]
            stretches.append(
                Stamped(
                    side=side.side,
                    span=(own[0].item(), own[-1].item()) if len(own) else NO_SPAN,
                    own=own[step >= 0],
                    step=step[step >= 0] - low,
                )
            )
        return BlockPiece(low=low, high=high, stretches=(stretches[0], stretches[1]))


def places(times: Times, first: float, last: float) -> tuple[int, int]:
    """Where times from one to another are, both included."""
    begin = int(np.searchsorted(times, first, side="left"))
    return begin, int(np.searchsorted(times, last, side="right"))


# -------------------------------------------------------------------------------------------------
# Sides that are interpolated at the steps.


@dataclass(frozen=True, kw_only=True, eq=False)
class Resampled:
    """A stretch of a side that is interpolated.

    Parameters
    ----------
    side : PartsSide
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

    side: PartsSide
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
        before, *after = map(_load, self.around)
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


NEIGHBOURS = "neighbours"
"""In the folder of work, that of states that others lie between."""

NO_ROWS = np.zeros(0, np.int64)

SHARES = 2
"""Rows that are read and states that are made are in memory together."""


def find_edges(
    output: str,
    stretches: tuple[Resampled, Resampled],
    request: EvaluationRequest,
    names: tuple[str, str],
) -> None:
    """Find the first and last states of tracks in a block, and count.

    Parameters
    ----------
    output : str
        The folder that is written.
    stretches : pair of Resampled
        Truth and estimate.
    request : EvaluationRequest
        What is asked.
    names : pair of str
        The sides, for messages.

    Raises
    ------
    TgospaError
        Something is wrong with the data.
    """
    truth, estimate = (stretch.read().trajectories for stretch in stretches)
    check_states(truth, estimate, request.distance, names)
    with writing(output) as folder:
        folder.mkdir()
        for number, side in enumerate((truth, estimate)):
            found = stretches[number].forecast(side)
            seen = side.seen_as(request.distance.kinds)
            for last in (False, True):
                name = f"{number}-{'last' if last else 'first'}.npz"
                _save(folder / name, outermost(seen, last=last))
            np.savez(folder / f"{number}.npz", rows=len(side.step), **vars(found))


@dataclass(frozen=True, kw_only=True, eq=False)
class Made:
    """What interpolation makes of a side.

    Parameters
    ----------
    own, between : (T,) int arrays
        States at each step, as of `Forecast`.
    unused : int
        States at other stamps.
    gaps : int
        Pairs of consecutive states of a track that are too far apart.
    """

    own: Ints
    between: Ints
    unused: int
    gaps: int

    def of(self, side: Trajectories) -> Interpolated:
        """The same of a side whose rows are not in memory."""
        return Interpolated(
            side=side,
            between=int(self.between.sum()),
            own=int(self.own.sum()),
            unused=self.unused,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Resampling:
    """Sides that are interpolated at the steps.

    Parameters
    ----------
    times : (T,) array
        The steps.
    blocks : list of BlockPiece
        What is read together, for these steps.
    made : pair of Made
        How much there is of truth and estimate.
    """

    times: Times
    blocks: list[BlockPiece]
    made: tuple[Made, Made]

    @property
    def rows(self) -> Ints:
        """States of both at each step (T,)."""
        first, second = (made.own + made.between for made in self.made)
        return np.asarray(first + second)

    def pieces(self, most: int) -> Iterator[BlockPiece]:
        """All steps in pieces of about so many states; a block that is read may be several."""
        rows, most = self.rows, max(most // SHARES, 1)
        for block in self.blocks:
            own = rows[block.low : block.high]
            before = np.cumsum(own) - own
            cuts = np.flatnonzero(np.diff(before // most)) + 1
            edges = [block.low, *(block.low + cuts).tolist(), block.high]
            for low, high in itertools.pairwise(edges):
                yield replace(block, low=low, high=high, told=low == block.low)

    def piece(self, low: int, high: int) -> BlockPiece:
        """What is read for steps from `low` on, up to `high` or the end of a block."""
        block = next(block for block in self.blocks if block.low <= low < block.high)
        return replace(block, low=low, high=min(high, block.high))


def resample(
    stamping: Stamping,
    request: EvaluationRequest,
    names: tuple[str, str],
    most: int,
    work: Path,
    run: Run,
) -> Resampling:
    """See what there will be at the steps, and what is needed for it.

    Parameters
    ----------
    stamping : Stamping
        The steps, and the stamps of both sides.
    request : EvaluationRequest
        What is asked.
    names : pair of str
        The sides, for messages.
    most : int
        Rows that are read together, about.
    work : Path
        The folder of what is known on the way.
    run : callable
        Does tasks.

    Raises
    ------
    TgospaError
        Something is wrong with the data.
    """
    times = stamping.times
    spans = list(stamping.spans(max(most // SHARES, 1)))
    folders = [work / NEIGHBOURS / f"{number:06d}" for number in range(len(spans))]
    stretches = []
    for folder, span in zip(folders, spans, strict=True):
        truth, estimate = (
            _stretch(side, times, span, request, role, names[role], folder)
            for role, side in enumerate(stamping.sides)
        )
        stretches.append((truth, estimate))
    run(
        {
            str(folder): partial(find_edges, stretches=both, request=request, names=names)
            for folder, both in zip(folders, stretches, strict=True)
        }
    )
    made = [
        _carried(folders, [both[role] for both in stretches], role, times, spans) for role in (0, 1)
    ]
    ends = (places(times, *span) for span in spans)
    blocks = [
        BlockPiece(low=low, high=high, stretches=both)
        for (low, high), both in zip(ends, stretches, strict=True)
    ]
    return Resampling(times=times, blocks=blocks, made=(made[0], made[1]))


def _stretch(
    side: OwnTimes,
    times: Times,
    span: Ends,
    request: EvaluationRequest,
    role: int,
    name: str,
    folder: Path,
) -> Resampled:
    """What of a side is between two moments."""
    own = side.times[slice(*places(side.times, *span))]
    return Resampled(
        side=side.side,
        span=(own[0].item(), own[-1].item()) if len(own) else NO_SPAN,
        ticks=_ticks(times, *span)[0],
        ends=(side.times[0].item(), side.times[-1].item()) if len(side.times) else None,
        request=request,
        number=role,
        names=(name, "--resample"),
        around=tuple(f"{folder}-{role}-{where}.npz" for where in ("before", "after")),
    )


def _ticks(times: Times, first: float, last: float) -> tuple[Times, Ints]:
    """Steps from one time to another, those beside them, the first and the last; and their places.

    A stamp may be the step next to it but for rounding.
    """
    low, high = places(times, first, last)
    inside = np.arange(max(low - 1, 0), min(high + 1, len(times)))
    place = np.unique(np.append(inside, (0, len(times) - 1)))
    return times[place], place


def _carried(
    folders: Sequence[Path],
    stretches: Sequence[Resampled],
    role: int,
    times: Times,
    spans: Sequence[Ends],
) -> Made:
    """Write what is before and after each block, and count what will be at the steps."""
    own, between = np.zeros(len(times), np.int64), np.zeros(len(times), np.int64)
    rows = narrow = 0
    ids: list[NDArray[np.str_]] = []
    held: Trajectories | None = None
    for folder, stretch, span in zip(folders, stretches, spans, strict=True):
        first, last = (_load(folder / f"{role}-{name}.npz") for name in ("first", "last"))
        with np.load(folder / f"{role}.npz") as found:
            place = _ticks(times, *span)[1]
            own[place] += found["own"]
            between[place] += found["between"]
            narrow += int(found["narrow"])
            rows += int(found["rows"])
        ids = [np.unique(np.concatenate([*ids, first.ids.astype(np.str_)]))]
        held = some(first, NO_ROWS) if held is None else stretch.near(held, span[0])
        _save(stretch.around[0], held)
        both = merged([held, first])
        if len(held.step) and len(first.step):
            ticks, place = _ticks(times, both.times[0].item(), both.times[-1].item())
            across = replace(stretch, ticks=ticks).forecast(both)
            between[place] += across.between
            narrow += across.narrow
        held = outermost(merged([held, last]), last=True)
    held = None
    for folder, stretch, span in zip(folders[::-1], stretches[::-1], spans[::-1], strict=True):
        first = _load(folder / f"{role}-first.npz")
        held = some(first, NO_ROWS) if held is None else stretch.near(held, span[1])
        _save(stretch.around[1], held)
        held = outermost(merged([first, held]), last=False)
    tracks = len(ids[0]) if ids else 0
    return Made(own=own, between=between, unused=rows - int(own.sum()), gaps=rows - tracks - narrow)


def _load(path: str | Path) -> Trajectories:
    with np.load(path) as found:
        known: dict[str, Any] = dict(found)
    columns, clock = tuple(known["columns"].tolist()), str(known["clock"])
    ids = known["ids"].astype(object)
    return Trajectories(**known | {"ids": ids, "columns": columns, "clock": clock})


def _save(path: str | Path, side: Trajectories) -> None:
    """Write rows without labels and attributes."""
    known = {name: getattr(side, name) for name in ("step", "track", "state", "times", "clock")}
    if side.covariance is not None:
        known["covariance"] = side.covariance
    with writing(str(path)) as beside, beside.open("wb") as file:
        np.savez(file, **known, columns=np.array(side.columns), ids=side.ids.astype(np.str_))


# -------------------------------------------------------------------------------------------------
# The steps of both sides, from their stamps alone.

STAMP = "stamp"
"""The attribute of stamps that are rows: their numbers."""


BlockPlan: TypeAlias = Stamping | Resampling
"""The rows of both sides along the steps."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """The steps.

    Parameters
    ----------
    axis : Axis
        How the stamps of both sides came to them.
    grid : Alignment
        The same, aligned.
    cut : BlockPlan
        The rows of both sides along them.
    """

    axis: Axis
    grid: Alignment
    cut: BlockPlan


def find_steps(
    sides: tuple[PartsSide, PartsSide],
    clocks: Sides,
    request: EvaluationRequest,
    names: tuple[str, str],
    most: int,
    work: Path,
    run: Run,
) -> Found:
    """The steps that are asked for.

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
    most : int
        Rows that are read together, about.
    work : Path
        The folder of what is known on the way.
    run : callable
        Does tasks.

    Raises
    ------
    TgospaError
        There is none, or something is wrong with the data.
    """
    matching = request.time_matching
    resampled = matching.resample is not None and len(clocks[0].times) > 0
    if resampled:  # no stamp is a step
        clocks = _without_rows(clocks[0]), _without_rows(clocks[1])
    axis = on_axis(clocks, matching, request.distance, names, request.parameters.cutoff)
    grid = align(*axis.sides, matching, names)
    if grid.union and not len(grid.truth.times):
        raise ConfigError(f"--grid {matching.grid}: no step is left, none of {grid.union:,} counts")
    own = (_own_times(sides[0], grid.truth), _own_times(sides[1], grid.estimate))
    stamping = Stamping(times=grid.truth.times, sides=own)
    cut: BlockPlan = stamping
    if resampled:
        cut = resample(stamping, request, names, most, work, run)
    return Found(axis=axis, grid=grid, cut=cut)


def clock_of(side: PartsSide) -> Trajectories:
    """The stamps of a side as a track that has a row at each, and nothing else."""
    size = len(side.times)
    labels = None
    if side.clock != "number":
        labels = np.empty(size, dtype=object)
        labels[:] = list(side.shown)
    return Trajectories(
        step=np.arange(size, dtype=np.int32),
        track=np.zeros(size, np.int32),
        state=np.zeros((size, len(side.columns))),
        ids=np.array(["times"], dtype=object),
        times=side.times,
        columns=side.columns,
        clock=side.clock,
        labels=labels,
        attributes={STAMP: np.arange(size, dtype=np.float64)},
    )


def _without_rows(side: Trajectories) -> Trajectories:
    """Its stamps alone."""
    return Trajectories.of_times(side.times, side.columns, side.clock, side.labels)


def _own_times(side: PartsSide, on: Trajectories) -> OwnTimes:
    """The stamps of a side, and which are steps, from what `clock_of` became."""
    step = np.full(len(side.times), -1)
    if len(on.step):
        step[on.attributes[STAMP].astype(np.int64)] = on.step
    return OwnTimes(side=side, times=side.times, counts=side.counts, step=step)
