"""Metrics in addition to TGOSPA: HOTA, CLEAR (MOTA), Identity (IDF1) and per-step GOSPA.

The first three equal those of TrackEval in every digit. The similarity of states at a step is

    s = max(0, 1 - d / z),

where d is the distance and c the cutoff. For the distance ``iou`` of boxes z is 1, so s is the IoU.
For all other distances z is 2 c, as in TrackEval for points. For CLEAR and Identity, a pair matches
if s >= 1/2, which means an IoU of at least 1/2, or d <= c. HOTA is the mean over the thresholds
0.05, 0.10, ..., 0.95 of s. These metrics are not costs, and they have no proof.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances import Distance, Pairs, Resources
from tgospa_eval.distances.base import Sides
from tgospa_eval.distances.boxes import overlaps
from tgospa_eval.distances.pair_search import prepared_pairs, starts_of_steps
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.mot_metrics import (
    METRICS,
    SUMMED_FIELDS,
    THRESHOLD,
    SimilarPairs,
    Sums,
    combined,
    finished,
)
from tgospa_eval.evaluation.prepare import PreparedPair, pairs_at_reports
from tgospa_eval.problem.gospa import per_step_gospa
from tgospa_eval.problem.solution import evaluated_rows
from tgospa_eval.quoting import option
from tgospa_eval.results.records import OtherMetrics, PairProof
from tgospa_eval.tracks.alignment import ClockReports
from tgospa_eval.tracks.trajectories import file_order

METRIC_FIELDS = {
    "hota": ("HOTA", "DetA", "AssA", "DetRe", "DetPr", "AssRe", "AssPr", "LocA"),
    "clear": (
        *("MOTA", "MOTP", "MODA", "CLR_Re", "CLR_Pr", "CLR_TP", "CLR_FN", "CLR_FP", "IDSW"),
        *("MT", "PT", "ML", "Frag"),
    ),
    "identity": ("IDF1", "IDR", "IDP", "IDTP", "IDFN", "IDFP"),
}
"""Reported numbers of each metric, as TrackEval names them; an array is reported as its mean."""

IOU = "iou"
"""Name of the distance whose similarity equals that of TrackEval to the last bit."""

AT = "at"
"""Word in the key of a sum that has a number for each threshold, such as ``hota.at.AssA``."""

MIN_SIMILARITY = 1e-300
"""Margin of the search for boxes; with it, boxes at the distance 1 are candidates, too."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ComputedMetrics:
    """Other metrics of one evaluation, in a form in which several evaluations can be joined.

    Parameters
    ----------
    by_name : mapping
        Sums of HOTA, CLEAR and Identity, by metric.
    gospa : mapping of str to float, optional
        Sums of per-step GOSPA over the steps: total, localisation, missed, false.
    zero : float
        Distance at which the similarity is 0.
    """

    by_name: Mapping[str, Sums]
    gospa: Mapping[str, float] | None
    zero: float

    def sums(self) -> dict[str, float | list[float]]:
        """Return the sums that `of_sums` needs to join several evaluations, as plain values."""
        sums: dict[str, float | list[float]] = {}
        for name, numbers in self.by_name.items():
            for key in SUMMED_FIELDS[name]:
                value = numbers[key]
                if np.ndim(value):
                    sums[f"{name}.{AT}.{key}"] = [float(each) for each in value]
                else:
                    sums[f"{name}.{key}"] = float(value)
        return sums


def of_sums(sums: Mapping[str, Any], names: Iterable[str], zero: float) -> ComputedMetrics:
    """Return HOTA, CLEAR and Identity from their sums, so that evaluations can be joined.

    Parameters
    ----------
    sums : mapping
        Result of `ComputedMetrics.sums`; further keys are allowed.
    names : iterable of str
        Names of the metrics that are in the sums.
    zero : float
        Distance at which the similarity is 0.
    """
    by_name = {
        name: {
            key: np.asarray(sums[f"{name}.{AT}.{key}"]) if name == "hota" else sums[f"{name}.{key}"]
            for key in SUMMED_FIELDS[name]
        }
        for name in names
    }
    return ComputedMetrics(by_name=by_name, gospa=None, zero=zero)


def other_metrics(
    prepared: PreparedPair,
    names: Sequence[str],
    resources: Resources,
    proof: PairProof | None = None,
) -> ComputedMetrics:
    """Return other metrics of truth and estimate, on the same data as TGOSPA.

    HOTA, CLEAR and Identity leave out states that are not evaluated (`problem.solution`).

    Parameters
    ----------
    prepared : PreparedPair
        Prepared problem; its filters, grid and joined timestamps apply to these metrics as well.
    names : sequence of str
        Names from `evaluation.request.OTHER_METRICS`.
    resources : Resources
        Settings of the search for pairs, and the stopwatch.
    proof : PairProof, optional
        Proof whose assignment shows which estimates follow ignored objects.
    """
    cutoff = prepared.parameters.cutoff
    largest = prepared.distance.largest
    zero = largest if largest < np.inf else 2 * cutoff
    requested = [name for name in names if name in METRIC_FIELDS]
    by_name = {}
    with resources.stopwatch.span("other_metrics"):
        if requested:
            sides = prepared.sides
            if proof is not None and prepared.states.problem.unjudged is not None:
                kept = evaluated_rows(proof.states, proof.weights)
                first, second = (
                    side.chosen(np.flatnonzero(rows))
                    for side, rows in zip(sides, kept, strict=True)
                )
                sides = first, second
            if prepared.reports is not None and prepared.states.problem.unjudged is not None:
                raise ConfigError(
                    f"{option('with_')} hota, clear and identity cannot be combined with both "
                    f"{option('resample')} and {option('ignore')}; leave one out"
                )
            pairs = _similar_pairs(sides, prepared.distance, zero, resources, prepared.reports)
            by_name = {name: METRICS[name](pairs) for name in requested}
        gospa = _gospa(prepared) if "gospa" in names else None
    return ComputedMetrics(by_name=by_name, gospa=gospa, zero=zero)


def joined(several: Sequence[ComputedMetrics]) -> OtherMetrics:
    """Return the record of the other metrics of one evaluation, or of several together.

    Several evaluations are joined as TrackEval joins sequences: counts of matches are summed over
    all evaluations, and ratios follow from these sums. Costs of GOSPA are means over evaluations.
    """
    first = several[0]
    record: dict[str, dict[str, float]] = {}
    for name in first.by_name:
        each = [other.by_name[name] for other in several]
        every = finished(name, each[0] if len(each) == 1 else combined(name, each))
        if name == "clear" and len(each) == 1 and not every["CLR_TP"] + every["CLR_FN"]:
            every |= {"MOTA": 0.0, "MODA": 0.0}  # TrackEval leaves them at 0 without truth
        record[name] = {key: _plain(every[key]) for key in METRIC_FIELDS[name]}
    if first.gospa is not None:
        costs = [other.gospa for other in several if other.gospa is not None]
        record["gospa"] = {
            key: float(np.mean([cost[key] for cost in costs])) for key in first.gospa
        }
    if first.by_name:
        record["similarity"] = {"zero": first.zero, "threshold": THRESHOLD}
    return record


def _plain(value: Any) -> float:
    """Return a Python number: an int for a whole number, and the mean of an array."""
    mean = np.mean(value) if np.ndim(value) else value
    return int(mean) if float(mean).is_integer() and not np.ndim(value) else float(mean)


def _gospa(prepared: PreparedPair) -> dict[str, float]:
    problem, parameters = prepared.states.problem, prepared.parameters
    scale = parameters.scale
    _, localisation, missed, false = per_step_gospa(problem)
    parts = {"localisation": localisation, "missed": missed, "false": false}
    return {
        "total": scale * float((localisation + missed + false).sum()),
        **{name: scale * float(part.sum()) for name, part in parts.items()},
    }


def _similar_pairs(
    sides: Sides,
    distance: Distance,
    zero: float,
    resources: Resources,
    reports: ClockReports | None,
) -> SimilarPairs:
    """Return all pairs with a similarity above 0; tracks without a row do not count.

    States of a step are in the order of the files, because this order decides between equal sums.
    """
    boxes = distance.name == IOU and reports is None

    def search(sides: Sides) -> Pairs:
        return prepared_pairs(
            sides, zero, distance, resources, margin=MIN_SIMILARITY if boxes else 0.0
        )

    near = search(sides) if reports is None else pairs_at_reports(reports, sides, search)
    rows = near.truth_row, near.estimate_row
    starts, place, track, lengths = [], [], [], []
    for side, row in zip(sides, rows, strict=True):
        start, order = starts_of_steps(side), file_order(side.step, side.attributes)
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order))
        _, number, count = np.unique(side.track, return_inverse=True, return_counts=True)
        starts.append(start)
        place.append(rank[row] - start[side.step[row]])
        track.append(number[row])
        lengths.append(count)
    if boxes:
        similarity = overlaps(*(side.state[row] for side, row in zip(sides, rows, strict=True)))
    else:
        similarity = 1 - near.distance / zero
    step = sides[0].step[rows[0]]
    order = np.lexsort((*place[::-1], step))
    order = order[similarity[order] > 0]
    return SimilarPairs(
        step=step[order],
        place=np.array(place)[:, order],
        track=np.array(track)[:, order],
        similarity=similarity[order],
        sizes=np.array([np.diff(start) for start in starts]),
        lengths=(lengths[0], lengths[1]),
    )
