"""Which steps are looked at, and the rows of a side that they have."""

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.points import rows_at
from tgospa_eval.problem.problem import Floats
from tgospa_eval.tracks.trajectories import Ints, Trajectories

SAMPLE = 100
"""Steps that are looked at."""

FIRST_STEPS = 25
"""Steps that are looked at first."""

SAMPLE_ROWS = 20_000
"""Rows of either side at these steps, at most."""

SAMPLE_PAIRS = 200_000
"""Pairs of these steps, near or not, as long as that leaves `FEWEST_STEPS` steps."""

FEWEST_STEPS = 8
"""Fewer steps give no warning of a shift."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StepRows:
    """The rows of a side at some steps, which are then 0, 1, 2, ...

    Parameters
    ----------
    side : Trajectories
        All of its rows.
    bounds : (2, T) int array
        First row and end of the rows of each step.
    """

    side: Trajectories
    bounds: Ints

    @classmethod
    def of(cls, side: Trajectories, steps: Ints | None = None) -> "StepRows":
        """Those at some steps; by default at all."""
        if steps is not None:
            return cls(side=side, bounds=rows_at(side, steps))
        found = cls(side=side, bounds=rows_at(side, np.arange(len(side.times))))
        vars(found)["table"] = side.seen_as(())
        return found

    @cached_property
    def counts(self) -> Ints:
        """Of rows of each step (T,)."""
        return np.asarray(self.bounds[1] - self.bounds[0])

    @cached_property
    def step(self) -> Ints:
        """Of each row."""
        return np.arange(len(self.counts), dtype=np.int32).repeat(self.counts)

    @cached_property
    def row(self) -> Ints:
        """Number of each among all of the side."""
        return concatenated(self.bounds[0], self.counts)

    @cached_property
    def track(self) -> Ints:
        """Of each row."""
        return self.side.track[self.row]

    @cached_property
    def table(self) -> Trajectories:
        """They alone, as points."""
        return self.side.seen_as(()).chosen(self.row, self.step, np.arange(len(self.counts)))


def affordable(sides: tuple[Trajectories, Trajectories]) -> int:
    """How many steps may be looked at."""
    objects = [len(side.step) / max(len(side.times), 1) for side in sides]
    by_pairs = max(FEWEST_STEPS, int(SAMPLE_PAIRS / max(objects[0] * objects[1], 1)))
    return min(SAMPLE, by_pairs, int(SAMPLE_ROWS / max(*objects, 1)))


def evenly(steps: Ints, sides: tuple[Trajectories, Trajectories], most: int = SAMPLE) -> Ints:
    """As many of the steps as may be looked at, evenly spread."""
    count = max(1, min(len(steps), affordable(sides), most))
    return steps[np.arange(count) * len(steps) // count] if len(steps) else steps


def with_state(side: Trajectories, state: Floats) -> Trajectories:
    """With other states; what is beyond the largest double is there."""
    most = np.finfo(np.float64).max
    return replace(side, state=np.clip(state, -most, most))


def occupied(side: Trajectories) -> NDArray[np.bool_]:
    """Steps at which it has rows (T,)."""
    return np.bincount(side.step, minlength=len(side.times)) > 0
