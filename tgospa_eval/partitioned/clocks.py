"""The steps of both sides, from their stamps alone."""

from pathlib import Path
from typing import Any

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.axis import Axis, Sides, on_axis
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.partitioned.resampling import resample
from tgospa_eval.partitioned.sides import Side
from tgospa_eval.partitioned.stretches import Cut, OwnTimes, Stamping
from tgospa_eval.partitioned.tasks import Run
from tgospa_eval.tracks.alignment import Alignment, align
from tgospa_eval.tracks.trajectories import Trajectories

STAMP = "stamp"
"""The attribute of stamps that are rows: their numbers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """The steps.

    Parameters
    ----------
    axis : Axis
        How the stamps of both sides came to them.
    grid : Alignment
        The same, aligned.
    cut : Cut
        The rows of both sides along them.
    """

    axis: Axis
    grid: Alignment
    cut: Cut


def find_steps(
    sides: tuple[Side, Side],
    clocks: Sides,
    request: EvaluationRequest,
    names: tuple[str, str],
    most: int,
    work: Path,
    run: Run[Any],
) -> Found:
    """The steps that are asked for.

    Parameters
    ----------
    sides : pair of Side
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
    axis = on_axis(clocks, matching, request.distance, names)
    grid = align(*axis.sides, matching, names)
    if grid.union and not len(grid.truth.times):
        raise ConfigError(f"--grid {matching.grid}: no step is left, none of {grid.union:,} counts")
    own = (_own_times(sides[0], grid.truth), _own_times(sides[1], grid.estimate))
    stamping = Stamping(times=grid.truth.times, sides=own)
    cut: Cut = stamping
    if resampled:
        cut = resample(stamping, request, names, most, work, run)
    return Found(axis=axis, grid=grid, cut=cut)


def clock_of(side: Side) -> Trajectories:
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


def _own_times(side: Side, on: Trajectories) -> OwnTimes:
    """The stamps of a side, and which are steps, from what `_clock_of` became."""
    step = np.full(len(side.times), -1)
    if len(on.step):
        step[on.attributes[STAMP].astype(np.int64)] = on.step
    return OwnTimes(side=side, times=side.times, counts=side.counts, step=step)
