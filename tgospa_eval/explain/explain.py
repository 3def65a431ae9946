"""From a result to the repairs that are worth most: found, tried, proven, put into words."""

from collections.abc import Iterator, Sequence

import numpy as np

from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import number
from tgospa_eval.errors import ConfigError, whole_number
from tgospa_eval.evaluation.axis import on_own_times, periods_of
from tgospa_eval.evaluation.prepare import Source
from tgospa_eval.explain.candidates import (
    Candidate,
    StatePlaces,
    best,
    extended,
    filled,
    moved,
    of_names,
    of_rows,
    shifted,
)
from tgospa_eval.explain.edits import Assigned
from tgospa_eval.explain.trials import Trials
from tgospa_eval.problem.solution import Bounds
from tgospa_eval.results.explanation import Explanation, Repair
from tgospa_eval.results.numbers import outward
from tgospa_eval.results.records import Columns
from tgospa_eval.results.result import Result
from tgospa_eval.tracks.existence import existence_of

TOP = 10
"""Repairs that are listed, where nobody says how many."""

TRIED = 2
"""Repairs that are tried for each that is listed at most."""


def explain(
    result: Result,
    top: int = TOP,
    *,
    stopwatch: Stopwatch | None = None,
    without: Sequence[str] = (),
) -> Explanation:
    """The repairs that are proven to save most, `top` of them at most.

    Parameters
    ----------
    result : Result
        As `evaluate` returns it.
    top : int
        How many to list; up to `TRIED` times as many are tried.
    stopwatch : Stopwatch, optional
        Shows how far it is.
    without : sequence of str
        Kinds that are not tried.

    Raises
    ------
    ConfigError
        `top` is less than 1, or the result knows nothing of its data.
    """
    top = whole_number("top", top)
    source = result.source
    if not isinstance(source, Source):
        raise ConfigError("the result was not made by evaluate, and knows nothing of its data")
    stopwatch = stopwatch or Stopwatch()
    begin = stopwatch.elapsed()
    with stopwatch.span("explain"):
        sides, request = source.sides, on_own_times(source.request)
        proof = result.proof
        assigned = Assigned(proof.states, proof.weights, proof.prices)
        able = [
            candidate
            for candidate in _candidates(result, source, assigned, TRIED * top)
            if candidate.kind not in without
        ]
        tried = best(able, TRIED * top)
        trials = Trials(proof, assigned, sides, request).run(tried, stopwatch) if tried else []
        repairs = [_repair(result, source, *trial) for trial in trials]
    worth = [repair for repair in repairs if repair.saving_upper > result.gap * result.total]
    worth.sort(key=lambda repair: -float(f"{repair.saving_lower:.6g}"))  # ties keep their order
    return Explanation(
        result=result,
        repairs=tuple(worth[:top]),
        candidates=len(able),
        tried=len(trials),
        seconds=stopwatch.elapsed() - begin,
        estimate=sides.alignment.estimate,
    )


def _candidates(
    result: Result, source: Source, assigned: Assigned, most: int
) -> Iterator[Candidate]:
    """What may save something at the assignment at hand, of each kind `most` or a few more."""
    estimate = source.sides.alignment.estimate
    if not len(estimate.step):
        return
    places = _places(result, source)
    names = (*result.labels.truths, *result.labels.estimates)
    makers = [of_names(assigned, names), of_rows(assigned, most)]
    if len(source.sides.alignment.truth.step):
        if estimate.clouds is None:
            makers += [
                filled(assigned, places, most),
                extended(assigned, places, most),
            ]
        if assigned.problem.steps > 1 and source.request.step_weights is None:
            makers.append(shifted(assigned, places))
        makers.append(moved(assigned, places))
    for maker in makers:
        yield from (candidate for candidate in maker if candidate.saving > 0)


def _places(result: Result, source: Source) -> StatePlaces:
    sides = source.sides
    columns = sides.read[0].columns
    periods = periods_of(sides.distance, columns)
    return StatePlaces(
        truth=sides.alignment.truth,
        estimate=sides.alignment.estimate,
        moments=sides.alignment.truth.times.astype(np.float64),
        distance=sides.distance.lower_bound,
        parameters=result.proof.parameters,
        existence=existence_of(sides.alignment.estimate) if source.request.probabilistic else None,
        period=np.array([periods.get(column, np.inf) for column in columns]),
    )


def _repair(
    result: Result, source: Source, candidate: Candidate, after: Bounds, total: float
) -> Repair:
    """A candidate with its names and what is proven of the cost after it."""
    edit, labels, scale = candidate.edit, result.labels, result.scale
    columns = source.sides.read[0].columns
    before = result.proof.bounds
    begin, end = (None if k is None else labels.times[k] for k in (candidate.begin, candidate.end))
    rows: Columns = {}
    if edit.added is not None:
        rows = {"t": [labels.times[k] for k in edit.added.step.tolist()]}
        rows |= dict(zip(columns, edit.added.state.T.tolist(), strict=True))
    offset = {} if edit.offset is None else dict(zip(columns, edit.offset.tolist(), strict=True))
    return Repair(
        kind=candidate.kind,
        text=in_words(candidate, result, offset),
        estimates=tuple(labels.estimates[track] for track in candidate.tracks),
        tracks=candidate.tracks,
        begin=begin,
        end=end,
        shift=edit.shift,
        offset=offset,
        rows=rows,
        total=scale * total,
        tgospa=result.proof.parameters.root(total),
        lower_bound=result.outward_root(after.lower, -1),
        upper_bound=result.outward_root(after.upper, 1),
        saving_lower=_outward(scale * (before.lower - after.upper), -1),
        saving_upper=_outward(scale * (before.upper - after.lower), 1),
        edit=edit,
    )


def _outward(value: float, sign: int) -> float:
    """Down (-1) or up (1) by more than its product and its difference are off by."""
    return outward(value, sign if value > 0 else -sign) if value else 0.0


def in_words(candidate: Candidate, result: Result, offset: dict[str, float]) -> str:
    """What a repair does."""
    labels, edit = result.labels, candidate.edit
    ids = [labels.estimates[track] for track in candidate.tracks]
    begin, end = (
        "" if k is None else str(labels.times[k]) for k in (candidate.begin, candidate.end)
    )
    span = f"t = {begin}" if begin == end else f"t = {begin} to {end}"
    if candidate.kind == "merge":
        return f"join estimate {ids[1]}, {span}, to estimate {ids[0]}"
    if candidate.kind == "exchange":
        if _last(candidate, result) < (candidate.begin or 0):
            return f"join estimate {ids[1]} from t = {begin} on to estimate {ids[0]}"
        return f"exchange estimates {ids[0]} and {ids[1]} from t = {begin} on"
    if candidate.kind == "split":
        return f"split estimate {ids[0]} at t = {begin}"
    if candidate.kind == "drop":
        return f"drop estimate {ids[0]}, {span}"
    if candidate.kind == "trim":
        return f"cut {span} off estimate {ids[0]}"
    if candidate.kind == "fill":
        return f"fill the gap of estimate {ids[0]}, {span}"
    if candidate.kind == "extend":
        onward = _last(candidate, result) < (candidate.begin or 0)
        return f"extend estimate {ids[0]} {f'to t = {end}' if onward else f'back to t = {begin}'}"
    if candidate.kind == "shift":
        size, when = abs(edit.shift), "later" if edit.shift > 0 else "earlier"
        return f"shift the whole estimate {size} {'step' if size == 1 else 'steps'} {when}"
    parts = ", ".join(f"{name} = {number(value, 4)}" for name, value in offset.items())
    return f"take the offset {parts} from the whole estimate"


def _last(candidate: Candidate, result: Result) -> int:
    """The last step of the first of its tracks."""
    problem = result.proof.states.problem
    return int(problem.estimate_step[problem.estimate_track == candidate.tracks[0]].max())
