"""Estimates that are compared: what is needed of their evaluations, and how long each run is."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.comparison.against import Against, against
from tgospa_eval.comparison.runs import bracket_of, costs_of
from tgospa_eval.evaluation.other_metrics import Others
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.records import Costs
from tgospa_eval.results.records import PARTS, FileRecord, Time
from tgospa_eval.results.result import Result
from tgospa_eval.tracks.alignment import Times


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What a ranking needs of the evaluation of one estimate in one run.

    Parameters
    ----------
    bracket : Interval
        Proven bounds of the total.
    parts, counts : dict
        Costs and counts.
    steps : dict of (T,) float arrays
        Costs of each step, by part.
    moments, times, occupied : (T,) array, list and bool array
        The steps, as numbers and as they were read, and whether something exists there.
    finished, status : bool, str
        Whether the solver did what was asked, and how it ended.
    input, against, others : dict, and Against and Others or None
        Rows and digests; per-step GOSPA; other metrics.
    """

    bracket: Interval
    parts: Costs
    counts: dict[str, float]
    steps: dict[str, Floats]
    moments: Times
    times: list[Time]
    occupied: NDArray[np.bool_]
    finished: bool
    status: str
    input: Mapping[str, FileRecord]
    against: Against | None = None
    others: Others | None = None


def outcome(
    result: Result, moments: Times, *, per_step: bool, others: Others | None = None
) -> Outcome:
    """What to keep of a result, so that the problem can go."""
    split = result.proof.breakdown
    return Outcome(
        bracket=bracket_of(result),
        parts=costs_of(result),
        counts=result.counts,
        steps={name: result.scale * getattr(split, name) for name in PARTS},
        moments=moments,
        times=result.labels.times,
        occupied=result.occupied,
        finished=bool(result.solver["finished"]),
        status=result.solver["status"],
        input=result.input,
        against=against(result) if per_step else None,
        others=others,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Entrant:
    """One tracker.

    Parameters
    ----------
    name : str
        What it is called.
    paths : sequence of str
        Its file in each run.
    outcomes : sequence of Outcome
        What came of each.
    """

    name: str
    paths: Sequence[str]
    outcomes: Sequence[Outcome]


def durations(entrants: Sequence[Entrant]) -> list[int]:
    """Steps of each run at which something exists, in the truth or in any estimate; at least 1."""
    found = []
    for run in zip(*(entrant.outcomes for entrant in entrants), strict=True):
        moments = [item.moments[item.occupied] for item in run]
        found.append(max(len(np.unique(np.concatenate(moments))), 1))
    return found
