"""The steps of both sides, and what of either is read for a block of them."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from tgospa_eval.common.arrays import Ints, stretches
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.axis import Axis, Sides, on_axis
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.partitioned.sides import PartsSide
from tgospa_eval.text import option
from tgospa_eval.tracks.alignment import Alignment, Times, align
from tgospa_eval.tracks.interpolation import found_at
from tgospa_eval.tracks.trajectories import Trajectories


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

    def at(self, found: Trajectories, times: Times) -> tuple[Trajectories, int]:
        """Those at steps, and how many they are."""
        on = self.step >= 0
        place, there = found_at(found.times, self.side.times[self.span][on])
        rows = np.flatnonzero(there[found.step])
        step = self.step[on][place[found.step[rows]]]
        return found.chosen(rows, step, times), len(rows)


def read_times(side: PartsSide, span: slice) -> Reading:
    """The rows at some of the times of a side, which may be none."""
    times = side.times[span]
    return side.read(times[0].item(), times[-1].item()) if len(times) else side.read(1, 0)


def places(times: Times, first: float, last: float) -> slice:
    """Where times from one to another are, both included."""
    begin = int(np.searchsorted(times, first, side="left"))
    return slice(begin, int(np.searchsorted(times, last, side="right")))


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockPiece:
    """Some steps, and what is read for them.

    Parameters
    ----------
    low : int
        The number of the first step.
    times : (L,) array
        The steps; there may be none.
    stretches : pair of Stamped
        What is read of truth and estimate.
    """

    low: int
    times: Times
    stretches: tuple[Stamped, Stamped]


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
        for begin, end in itertools.pairwise(stretches(rows, most).tolist()):
            yield self._between(moments[begin].item(), moments[end - 1].item())

    def piece(self, low: int, high: int) -> BlockPiece:
        """What is read for these steps."""
        return self._between(self.times[low].item(), self.times[high - 1].item())

    def _between(self, first: float, last: float) -> BlockPiece:
        steps = places(self.times, first, last)
        truth, estimate = (
            Stamped(
                side=side,
                span=(span := places(moments, first, last)),
                step=np.where(step[span] >= 0, step[span] - steps.start, -1),
            )
            for side, moments, step in zip(self.sides, self.moments, self.step, strict=True)
        )
        times = self.times[steps]
        return BlockPiece(low=steps.start, times=times, stretches=(truth, estimate))


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
    axis = on_axis(clocks, matching, request.distance, names, request.parameters.cutoff)
    if matching.of_estimate and matching.outage != "none":
        raise ConfigError(
            f"{option('grid', matching.grid)}: what a tracker misses while it is silent is not "
            f"known for data in parts; {option('grid', 'truth')}, or {option('outage', 'none')} "
            "if it reports only what it sees"
        )
    grid = align(*axis.sides, matching, names)
    if matching.of_estimate:
        axis = replace(axis, horizon=grid.truth)
    if grid.union and not len(grid.truth.times):
        raise ConfigError(
            f"{option('grid', matching.grid)}: no step is left, none of {grid.union:,} counts"
        )
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


def _step_of(side: PartsSide, on: Trajectories) -> Ints:
    """Which step each stamp of a side is, from what `clock_of` became."""
    step = np.full(len(side.times), -1)
    if len(on.step):
        step[on.attributes[STAMP].astype(np.int64)] = on.step
    return step
