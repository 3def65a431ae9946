"""Several estimates of one truth: proven order, and what the differences are made of.

With several runs of each (Monte Carlo) costs are averaged over the runs, and roots are taken last:
``tgospa`` is (mean total)^(1/p), its normalised form (mean of total / T)^(1/p), for p = 2 the root
of the mean square over runs. Averages of brackets bracket the averages. Ranked is the normalised
form, in which each run counts the same however long it is; where runs differ in length the order of
the mean totals may be another, and `opposed` marks it.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.common.brackets import EQUAL, equal, less, places
from tgospa_eval.common.interval import Interval
from tgospa_eval.comparison import SCHEMA
from tgospa_eval.comparison.against import against_document, differences
from tgospa_eval.comparison.entrants import Entrant, durations
from tgospa_eval.comparison.steps import joined, signs
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.other_metrics import joined as joined_metrics
from tgospa_eval.reports.records import (
    EstimateRecord,
    Metric,
    PairRecord,
    PerStepRecord,
    RankingRecord,
)
from tgospa_eval.results.records import PARTS, Part
from tgospa_eval.tracks.judged import JUDGE_ALIKE, incomparable

RANKED = "normalised.tgospa"
"""The field of an estimate by which estimates are ranked."""


def ranking_document(
    entrants: Sequence[Entrant],
    truths: Sequence[str],
    parameters: Metric,
    warnings: list[dict[str, str]],
) -> RankingRecord:
    """The JSON document, the estimates in the order of their values.

    Parameters
    ----------
    entrants : sequence of Entrant
        At least one, each with the same number of runs.
    truths : sequence of str
        The file with the truth of each run.
    parameters : Metric
        Every option that changes the number.
    warnings : list of dict
        What looks wrong with the data.

    Raises
    ------
    ConfigError
        Some are judged on another truth, or at other steps, than others.
    """
    for run, outcomes in enumerate(zip(*(item.outcomes for item in entrants), strict=True)):
        names = (f"{item.name}, {item.paths[run]}" for item in entrants)
        wrong = incomparable(dict(zip(names, (one.judged for one in outcomes), strict=True)))
        if wrong:
            raise ConfigError(f"no order: {wrong}; {JUDGE_ALIKE}")
    order = parameters["order"]
    steps = durations(entrants)
    per_step = [
        [run.bracket.scaled(1 / count) for run, count in zip(item.outcomes, steps, strict=True)]
        for item in entrants
    ]
    normal = [_mean(brackets) for brackets in per_step]
    ranked = sorted(range(len(entrants)), key=lambda k: (normal[k].upper, normal[k].lower))
    place = places(normal, lambda *pair: _verdict(entrants, normal, pair) == "equal")
    estimates = []
    for k in ranked:
        item = _entry(entrants[k], steps, order, place[k])
        if item["per_step_gospa"] is not None:
            item["differences"] = list(differences(item, item["per_step_gospa"], steps, order))
        estimates.append(item)
    return {
        "schema": SCHEMA,
        "version": __version__,
        "kind": "estimates",
        "runs": len(steps),
        "steps": steps,
        "truth": list(truths),
        "ranked_by": RANKED,
        "estimates": estimates,
        "pairs": [
            _pair(
                (entrants[a], entrants[b]),
                (normal[a], normal[b]),
                (per_step[a], per_step[b]),
                steps,
            )
            for a, b in itertools.combinations(ranked, 2)
        ],
        "parameters": parameters,
        "warnings": warnings,
    }


def _entry(
    entrant: Entrant, steps: list[int], order: float, place: tuple[int, int]
) -> EstimateRecord:
    outcomes = entrant.outcomes
    total = _mean([item.bracket for item in outcomes])
    shares = np.array(steps, float)

    def root(costs: Sequence[float]) -> float:
        return float(np.mean(np.asarray(costs) / shares) ** (1 / order))

    def mean(part: Part) -> float:
        return float(np.mean([item.parts[part] for item in outcomes]))

    found = [against_document(item.against, order) for item in outcomes if item.against is not None]
    others = [item.others for item in outcomes if item.others is not None]
    record: EstimateRecord = {
        "name": entrant.name,
        "paths": list(entrant.paths),
        "place": list(place),
        "tgospa": total.upper ** (1 / order),
        "lower_bound": total.lower ** (1 / order),
        "total": total.upper,
        "total_lower": total.lower,
        "localisation": mean("localisation"),
        "missed": mean("missed"),
        "false": mean("false"),
        "switch": mean("switch"),
        "counts": {
            name: float(np.mean([item.counts[name] for item in outcomes]))
            for name in outcomes[0].counts
        },
        "normalised": {
            "tgospa": root([item.bracket.upper for item in outcomes]),
            "lower_bound": root([item.bracket.lower for item in outcomes]),
            **{name: root([item.parts[name] for item in outcomes]) for name in PARTS},
        },
        "runs": [
            {
                "total": item.bracket.upper,
                "total_lower": item.bracket.lower,
                **item.parts,
                "status": item.status,
                "finished": item.finished,
                "input": item.input,
            }
            for item in outcomes
        ],
        "per_step_gospa": cast("PerStepRecord", _means(found)) if found else None,
    }
    if others:
        record["with"] = joined_metrics(others)
    return record


def _means(found: Sequence[Mapping[str, object]]) -> dict[str, object]:
    """The means of numbers by name, also of those in records inside."""
    means: dict[str, object] = {}
    for name, first in found[0].items():
        if isinstance(first, Mapping):
            means[name] = _means(cast("list[Mapping[str, object]]", [r[name] for r in found]))
        else:
            means[name] = float(np.mean(cast("list[float]", [r[name] for r in found])))
    return means


def _verdict(
    entrants: Sequence[Entrant], normal: Sequence[Interval], pair: tuple[int, int] = (0, 1)
) -> str:
    """What is proven of two of them: equal data have equal values, whatever the brackets are."""
    first, second = (normal[k] for k in pair)
    runs = zip(*(entrants[k].outcomes for k in pair), strict=True)
    if all(a.input["estimate"]["sha256"] == b.input["estimate"]["sha256"] for a, b in runs):
        return "equal"
    if less(first, second):
        return "less"
    return "equal" if equal(first, second) else "not separated"


def _pair(
    entrants: tuple[Entrant, Entrant],
    normal: tuple[Interval, Interval],
    runs: tuple[list[Interval], list[Interval]],
    durations: list[int],
) -> PairRecord:
    """The second less the first, which has the smaller value; costs per step, means over runs."""
    first, second = entrants
    pairs = list(zip(first.outcomes, second.outcomes, strict=True))
    change = np.array([b.upper - a.upper for a, b in zip(*runs, strict=True)])
    shares = np.array(durations, float)
    count = len(pairs)
    steps = [signs(*joined(b, a)) for a, b in pairs]

    def change_of(part: Part) -> float:
        return float(np.mean([b.parts[part] - a.parts[part] for a, b in pairs] / shares))

    totals = [_mean([item.bracket for item in entrant.outcomes]) for entrant in entrants]
    return {
        "first": first.name,
        "second": second.name,
        "verdict": _verdict(entrants, normal),
        "opposed": totals[1].upper < totals[0].upper * (1 - EQUAL),
        "per_step": {
            "total": [normal[1].lower - normal[0].upper, normal[1].upper - normal[0].lower],
            "localisation": change_of("localisation"),
            "missed": change_of("missed"),
            "false": change_of("false"),
            "switch": change_of("switch"),
        },
        "steps": {
            "better": int(sum((sign < 0).sum() for sign in steps)),
            "worse": int(sum((sign > 0).sum() for sign in steps)),
        },
        "per_run": {
            "mean": float(change.mean()),
            "standard_error": float(change.std(ddof=1) / count**0.5) if count > 1 else None,
            "first_less": sum(less(a, b) for a, b in zip(*runs, strict=True)),
            "second_less": sum(less(b, a) for a, b in zip(*runs, strict=True)),
        },
    }


def _mean(brackets: Sequence[Interval]) -> Interval:
    return Interval(
        lower=float(np.mean([bracket.lower for bracket in brackets])),
        upper=float(np.mean([bracket.upper for bracket in brackets])),
    )
