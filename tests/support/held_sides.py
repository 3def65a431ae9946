"""Sides that are in memory, for evaluations in parts."""

from dataclasses import dataclass

import numpy as np

from tgospa_eval.distances import as_distance
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.partitioned.scan import BlockPlan
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.tracks.trajectories import TimeArray, Trajectories


@dataclass
class Held:
    """A side that is in memory."""

    whole: Trajectories

    @property
    def times(self) -> TimeArray:
        return self.whole.times

    @property
    def columns(self) -> tuple[str, ...]:
        return self.whole.columns

    @property
    def counts(self) -> np.ndarray:
        return np.bincount(self.whole.step, minlength=len(self.whole.times))

    def read(self, first: float, last: float) -> Reading:
        whole = self.whole
        some = (whole.times >= first) & (whole.times <= last)
        rows = np.flatnonzero(some[whole.step])
        offset = int(np.argmax(some)) if some.any() else 0
        part = whole.chosen(rows, whole.step[rows] - offset, whole.times[some])
        return Reading(trajectories=part, rows=len(rows))


def plan(sides: tuple[Trajectories, Trajectories], parameters: Parameters) -> BlockPlan:
    times = np.union1d(sides[0].times, sides[1].times)
    return BlockPlan(
        times=times,
        sides=(Held(sides[0]), Held(sides[1])),
        step=tuple(np.searchsorted(times, side.times) for side in sides),
        request=EvaluationRequest(
            parameters=parameters, distance=as_distance("euclidean"), solver=Certified(jobs=1)
        ),
        names=("truth", "estimate"),
    )
