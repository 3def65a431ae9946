"""From a result to the repairs that are worth most: found, tried, proven, put into words."""

from collections.abc import Iterator, Sequence

import numpy as np

from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import counted, number
from tgospa_eval.errors import whole_number
from tgospa_eval.evaluation.axis import on_own_times, periods_of
from tgospa_eval.evaluation.prepare import Fitted, source_of
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.explain.candidates import (
    Candidate,
    StatePlaces,
    exchanged,
    extended,
    filled,
    moved,
    of_rows,
    shifted,
    split_up,
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
    sides, asked = source_of(result)
    request = on_own_times(asked)
    stopwatch = stopwatch or Stopwatch()
    begin = stopwatch.elapsed()
    with stopwatch.span("explain"):
        proof = result.proof
        assigned = Assigned(proof.states, proof.weights, proof.prices)
        able = [
            candidate
            for candidate in _candidates(result, sides, request, assigned, TRIED * top)
            if candidate.kind not in without
        ]
        tried = sorted(able, key=lambda candidate: -candidate.saving)[: TRIED * top]
        trials = Trials(proof, assigned, sides, request).run(tried, stopwatch) if tried else []
        repairs = [_repair(result, sides.read[0].columns, *trial) for trial in trials]
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
    result: Result, sides: Fitted, request: EvaluationRequest, assigned: Assigned, most: int
) -> Iterator[Candidate]:
    """What may save something at the assignment at hand, of each kind `most` or a few more."""
    estimate = sides.alignment.estimate
    if not len(estimate.step):
        return
    places = _places(result, sides, request)
    names = (*result.labels.truths, *result.labels.estimates)
    makers = [exchanged(assigned), split_up(assigned, names), of_rows(assigned, most)]
    if len(sides.alignment.truth.step):
        if estimate.clouds is None:
            makers += [
                filled(assigned, places, most),
                extended(assigned, places, most),
            ]
        if assigned.problem.steps > 1 and request.step_weights is None:
            makers.append(shifted(assigned, places))
        makers.append(moved(assigned, places))
    for maker in makers:
        yield from (candidate for candidate in maker if candidate.saving > 0)


def _places(result: Result, sides: Fitted, request: EvaluationRequest) -> StatePlaces:
    columns = sides.read[0].columns
    periods = periods_of(sides.distance, columns)
    return StatePlaces(
        truth=sides.alignment.truth,
        estimate=sides.alignment.estimate,
        moments=sides.alignment.truth.times.astype(np.float64),
        distance=sides.distance.lower_bound,
        parameters=result.proof.parameters,
        existence=existence_of(sides.alignment.estimate) if request.probabilistic else None,
        period=np.array([periods.get(column, np.inf) for column in columns]),
    )


def _repair(
    result: Result,
    columns: tuple[str, ...],
    candidate: Candidate,
    after: Bounds,
    total: float,
) -> Repair:
    """A candidate with its names and what is proven of the cost after it."""
    edit, labels, scale = candidate.edit, result.labels, result.scale
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
    first, second = ([labels.estimates[track] for track in candidate.tracks] + 2 * [""])[:2]
    begin, end = (
        "" if k is None else str(labels.times[k]) for k in (candidate.begin, candidate.end)
    )
    span = f"t = {begin}" if begin == end else f"t = {begin} to {end}"
    kind, size = candidate.kind, abs(edit.shift)
    if kind in ("exchange", "extend"):
        problem = result.proof.states.problem
        own = problem.estimate_step[problem.estimate_track == candidate.tracks[0]]
        kind += "-after" * bool(own.max() < (candidate.begin or 0))
    parts = ", ".join(f"{name} = {number(value, 4)}" for name, value in offset.items())
    return {
        "merge": f"join estimate {second}, {span}, to estimate {first}",
        "exchange": f"exchange estimates {first} and {second} from t = {begin} on",
        "exchange-after": f"join estimate {second} from t = {begin} on to estimate {first}",
        "split": f"split estimate {first} at t = {begin}",
        "drop": f"drop estimate {first}, {span}",
        "trim": f"cut {span} off estimate {first}",
        "fill": f"fill the gap of estimate {first}, {span}",
        "extend": f"extend estimate {first} back to t = {begin}",
        "extend-after": f"extend estimate {first} to t = {end}",
        "shift": f"shift the whole estimate {counted(size, 'step')} "
        f"{'later' if edit.shift > 0 else 'earlier'}",
        "offset": f"take the offset {parts} from the whole estimate",
    }[kind]
