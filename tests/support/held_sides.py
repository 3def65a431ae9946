"""Sides that are in memory, for evaluations in parts."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tgospa_eval.engines.engine import Engine
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.evaluation.sides import as_distance
from tgospa_eval.formats import Reading
from tgospa_eval.partitioned.run import PartsPlan
from tgospa_eval.partitioned.steps import OwnTimes, Stamping
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.tracks.trajectories import Trajectories


@dataclass
class Held:
    """A side that is in memory."""

    whole: Trajectories

    def read(self, first: float, last: float) -> Reading:
        whole = self.whole
        some = (whole.times >= first) & (whole.times <= last)
        rows = np.flatnonzero(some[whole.step])
        offset = int(np.argmax(some)) if some.any() else 0
        part = whole.chosen(rows, whole.step[rows] - offset, whole.times[some])
        return Reading(trajectories=part, rows=len(rows))


def plan(
    sides: tuple[Trajectories, Trajectories],
    parameters: Parameters,
    work: Path,
    engine: Engine | None = None,
) -> PartsPlan:
    times = np.union1d(sides[0].times, sides[1].times)
    stamps = [
        OwnTimes(
            side=Held(side),
            times=side.times,
            counts=np.bincount(side.step, minlength=len(side.times)),
            step=np.searchsorted(times, side.times),
        )
        for side in sides
    ]
    return PartsPlan(
        cut=Stamping(times=times, sides=(stamps[0], stamps[1])),
        times=times,
        request=EvaluationRequest(
            parameters=parameters, distance=as_distance("euclidean"), solver=Certified(jobs=1)
        ),
        names=("truth", "estimate"),
        columns=2,
        work=work,
        memory=1 << 30,
        engine=engine,
    )
