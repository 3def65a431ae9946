"""Saved results as what a ranking needs of evaluations. Solves nothing."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.interval import Interval
from tgospa_eval.common.notices import Notice
from tgospa_eval.comparison.entrants import Outcome
from tgospa_eval.errors import InputError
from tgospa_eval.formats.fields import floats
from tgospa_eval.formats.times import TimeError, parse_times
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.other_metrics import COMPARED
from tgospa_eval.results.numbers import outward
from tgospa_eval.results.records import PARTS, Json, OtherMetrics, Time
from tgospa_eval.results.saved import count_of, unlike
from tgospa_eval.tracks.alignment import Times

BESIDE = {"similarity": ("zero", "threshold")}
FIELDS_SHOWN = {**COMPARED, **BESIDE}
"""Names of the numbers of other metrics that a ranking shows, by metric."""

Documents = Sequence[Json]
Paths = Sequence[str]


def other_parameters(own: Json, first: Json) -> str:
    """In which parameters of the metric two results differ; blank if in none."""
    found = unlike(own["parameters"], first["parameters"])
    return "; ".join(f"{name} is {one}, there {other}" for name, one, other in found)


def other_truth(own: Json, first: Json) -> str:
    """Whether two results are of different truths, in words; blank if they are not."""
    mine, theirs = (document["input"]["truth"]["sha256"] for document in (own, first))
    return "" if mine == theirs else "the truth is another one (sha256 of ids, times, states)"


def shared_metrics(runs: Sequence[Documents]) -> tuple[list[OtherMetrics], list[Notice]]:
    """Other metrics that all results of one run have; and a notice of those that are left out.

    Those of several runs are ratios of counts over all of them, and cannot be had from the ratios
    of each.
    """
    each: list[OtherMetrics] = [document.get("with", {}) for run in runs for document in run]
    first = each[0] if len(runs) == 1 else {}
    shared = [
        name
        for name in first
        if all(name in found and found[name].keys() == first[name].keys() for found in each)
        and first[name].keys() >= {*FIELDS_SHOWN.get(name, ())}
    ]
    left_out = sorted({name for found in each for name in found} - {*shared, *BESIDE})
    notices = [
        Notice(text=f"not shown: {name}; it needs a single run, and all results of it")
        for name in left_out
    ]
    return [{name: found[name] for name in shared} for found in each[: len(runs[0])]], notices


def outcomes(documents: Documents, paths: Paths) -> list[Outcome]:
    """What a ranking needs of the results of one run, which are of the same truth.

    Raises
    ------
    InputError
        Times are of several kinds or out of order, or it is not said at which steps something
        exists.
    """
    moments = _moments(documents, paths)
    occupied = _occupied(documents, paths)
    return [
        Outcome(
            bracket=_bracket(document),
            parts={
                "localisation": document["localisation"],
                "missed": document["missed"],
                "false": document["false"],
                "switch": document["switch"],
            },
            counts=document["counts"],
            steps={name: _column(document, name) for name in PARTS},
            moments=moments[k],
            times=_times(document),
            occupied=occupied[k],
            finished=bool(document["solver"]["finished"]),
            status=document["solver"]["status"],
            input=document["input"],
        )
        for k, document in enumerate(documents)
    ]


def _bracket(document: Json) -> Interval:
    """The bounds of the total, from those of the value, rounded outward once more."""
    order = document["parameters"]["order"]
    return Interval(
        lower=outward(document["lower_bound"] ** order, -1),
        upper=outward(document["upper_bound"] ** order, 1),
    )


def _column(document: Json, name: str) -> Floats:
    return np.array([step[name] for step in document["per_step"]], float)


def _times(document: Json) -> list[Time]:
    return [step["t"] for step in document["per_step"]]


def _moments(documents: Documents, paths: Paths) -> list[Times]:
    """The steps of each as places in the order of those of all, exact whatever the numbers are."""
    times = [_times(document) for document in documents]
    if len({isinstance(t, str) for own in times for t in own}) > 1:
        raise InputError(f"{paths[0]}: has times of another kind than other results of its truth")
    try:
        keys = [_keys(own) for own in times]
    except TimeError as error:
        raise InputError(f"{paths[0]}, or a result of its truth: per_step: {error}") from None
    rank = {key: k for k, key in enumerate(sorted({key for own in keys for key in own}))}
    found = [np.array([rank[key] for key in own], np.int64) for own in keys]
    for path, ranks in zip(paths, found, strict=True):
        if np.any(np.diff(ranks) <= 0):
            raise InputError(f"{path}: per_step: times are not in order")
    return found


def _keys(times: list[Time]) -> list[int | float]:
    """Numbers in the order of the times: themselves, or nanoseconds."""
    texts = [t for t in times if isinstance(t, str)]
    if not texts:
        return [t for t in times if not isinstance(t, str)]
    found: list[int | float] = parse_times(texts, floats).value.tolist()
    return found


def _occupied(documents: Documents, paths: Paths) -> list[NDArray[np.bool_]]:
    """At which steps something exists in the truth or an estimate.

    A result has their number, T of its normalised value. At a step that costs something there is
    something; where the others are not all of one kind, that of T of them, what is perfect cannot
    be told from what is empty. But a perfect step has a truth, and so another result that is clear
    has that step, too.
    """
    found, is_clear = [], False
    for document in documents:
        costly = np.any([_column(document, name) > 0 for name in PARTS[:-1]], axis=0)
        count = count_of(document)
        is_full = count == len(costly)
        is_clear |= is_full or (count > 0 and count == np.count_nonzero(costly))
        found.append(costly | is_full)
    if not is_clear and any(document["total"] > 0 for document in documents):
        raise InputError(
            f"{paths[0]}: does not say which of its steps are empty; name the files instead"
        )
    return found if is_clear else [np.ones(len(own), bool) for own in found]
