"""Estimates that are compared: what is needed of their evaluations, and how long each run is."""

from collections.abc import Mapping, Sequence
from typing import Any

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
    moments, times : (T,) array and list
        The steps, as numbers and as they were read.
    judged : mapping
        What it was judged on, as `Judged.record`.
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
    judged: Mapping[str, Any]
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
        judged=result.judged,
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
    """Steps of the horizon of each run, at least 1; all entrants are judged on the same ones."""
    return [max(item.judged["steps"], 1) for item in entrants[0].outcomes]
