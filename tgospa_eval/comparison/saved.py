"""Saved results as what a ranking needs of evaluations. Solves nothing."""

from collections.abc import Sequence

import numpy as np

from tgospa_eval.common.interval import Interval
from tgospa_eval.common.notices import Notice
from tgospa_eval.comparison.entrants import Outcome
from tgospa_eval.errors import InputError
from tgospa_eval.formats.times import TimeError
from tgospa_eval.formats.times import places as places_of_times
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.other_metrics import COMPARED
from tgospa_eval.results.numbers import outward
from tgospa_eval.results.records import PARTS, Json, OtherMetrics, Time
from tgospa_eval.results.saved import unlike
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
        Times are of several kinds or out of order.
    """
    moments = _moments(documents, paths)
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
            judged=document["judged"],
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
    """The steps of each as places in the order of those of all."""
    try:
        found = places_of_times([_times(document) for document in documents])
    except TimeError as error:
        raise InputError(f"{paths[0]}, or a result of its truth: per_step: {error}") from None
    for path, own in zip(paths, found, strict=True):
        if np.any(np.diff(own) <= 0):
            raise InputError(f"{path}: per_step: times are not in order")
    return list(found)
