"""Several estimates of one truth: proven order, and what the differences are made of.

With several runs of each (Monte Carlo) costs are averaged over the runs, and roots are taken last:
``tgospa`` is (mean total)^(1/p), its normalised form (mean of total / T)^(1/p), for p = 2 the root
of the mean square over runs. Averages of brackets bracket the averages. Ranked is the normalised
form, in which each run counts the same however long it is; where runs differ in length the order of
the mean totals may be another, and `opposed` marks it.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.campaign import SCHEMA
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import EQUAL, Interval, less, places, second_less_first, verdict
from tgospa_eval.common.notices import Notice
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.other_metrics import Others
from tgospa_eval.evaluation.other_metrics import joined as joined_metrics
from tgospa_eval.formats.times import TimeError
from tgospa_eval.formats.times import places as places_of_times
from tgospa_eval.problem.gospa import (
    Changes,
    changes_since_last_step,
    changes_since_last_stored,
    partners,
    per_step_gospa,
)
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.other_metrics import COMPARED
from tgospa_eval.reports.records import (
    RULES,
    CostParts,
    EstimateRecord,
    Metric,
    PairRecord,
    PerStepRecord,
    RankingRecord,
    Rule,
    RuleRecord,
)
from tgospa_eval.results.numbers import outward
from tgospa_eval.results.records import PARTS, Columns, Json, OtherMetrics, Part, Time
from tgospa_eval.results.result import Result
from tgospa_eval.results.saved import unlike
from tgospa_eval.tracks.alignment import Times
from tgospa_eval.tracks.judged import JUDGE_ALIKE, incomparable


def against(result: Result) -> tuple[PerStepRecord, dict[str, Floats]]:
    """Each step evaluated by itself, on the problem of a result.

    Returns
    -------
    tuple
        Sums over all steps, costs in state units to the power p; and, in state units, GOSPA of each
        step and what the tools print for it, by rule.
    """
    states, problem = result.proof.states, result.proof.states.problem
    parameters, scale = result.proof.parameters, result.scale
    p = parameters.order
    switch = 2 * scale * parameters.switch_price  # gamma^p, where that is a double
    found = per_step_gospa(problem)
    gospa = scale * found.total
    track = partners(problem, found.entries)
    changes: dict[Rule, Changes] = {
        "stone_soup": changes_since_last_stored(problem, track),
        "mathworks": changes_since_last_step(problem, track),
    }
    value = gospa ** (1 / p)
    paid = {name: switch * count.total for name, count in changes.items()}
    values: dict[str, Floats] = {
        "gospa": value,
        "stone_soup": np.hypot(value, paid["stone_soup"] ** (1 / p)),
        "mathworks": (gospa + paid["mathworks"]) ** (1 / p),
    }
    used = states.entry[(states.entry >= 0) & (result.proof.weights > 0)]
    changed = np.setxor1d(used, found.entries)

    def of_rule(rule: Rule) -> RuleRecord:
        return {
            "switches": float(changes[rule].total.sum()),
            "halves": float(changes[rule].half.sum()),
            "total": float((values[rule] ** p).sum()),
            "mean": float(values[rule].mean()) if len(gospa) else 0.0,
        }

    record: PerStepRecord = {
        "total": float(gospa.sum()),
        "localisation": scale * float(found.localisation.sum()),
        "missed": scale * float(found.missed.sum()),
        "false": scale * float(found.false.sum()),
        "steps_differing": len(np.unique(problem.entry_step[changed])),
        "stone_soup": of_rule("stone_soup"),
        "mathworks": of_rule("mathworks"),
    }
    return record, values


def differences(
    document: EstimateRecord, step: PerStepRecord, steps: Sequence[int], order: float
) -> Iterator[str]:
    """Why the numbers of one estimate differ, a sentence each.

    Parameters
    ----------
    document : EstimateRecord
        TGOSPA's own numbers.
    step : PerStepRecord
        Those of per-step GOSPA.
    steps : sequence of int
        Steps of each run.
    order : float
        Of the metric.
    """
    total = document["total"]
    own = document["counts"]["switch"]
    share = (
        f"{100 * step['total'] / total:.4g} % of the total of TGOSPA"
        if total
        else "0, as is TGOSPA"
    )
    yield (
        f"per-step GOSPA, summed, is {share}: every step takes its cheapest assignment, and no "
        "change from step to step costs anything"
    )
    count = step["steps_differing"]
    yield (
        f"at {count:.4g} of {sum(steps) / len(steps):.6g} steps TGOSPA "
        "found another assignment than the cheapest of that step alone"
        if count
        else "TGOSPA found the assignment of every step that is the cheapest of that step alone"
    )
    for rule, name in RULES.items():
        made, halves = step[rule]["switches"], step[rule]["halves"]
        text = f"{name} counts {_count(made, 'switch')} afterwards, TGOSPA {own:.4g}"
        if made:
            text += ": it charges what the cheapest assignments happen to need"
        if halves:
            text += (
                f", and {halves / 2:.4g} for {_count(halves, 'change')} from a track to none or "
                "back, as at every miss; TGOSPA keeps the pair through a miss at no cost"
            )
        yield text
    if step["stone_soup"] != step["mathworks"]:
        if step["stone_soup"]["switches"] != step["mathworks"]["switches"]:
            yield (
                "Stone Soup compares with the last partner it stored, however long ago, and passes "
                "over steps without estimates; MathWorks compares with the step before"
            )
        if order != 2:
            yield (
                f"Stone Soup adds switches with the exponent 2 though p = {order:g}: its values "
                "are no sums of costs"
            )


def _count(number: float, word: str) -> str:
    ending = "" if number == 1 else ("es" if word.endswith("ch") else "s")
    return f"{number:.4g} {word}{ending}"


# -------------------------------------------------------------------------------------------------
# Entrants of a ranking: what is needed of their evaluations, and how long each run is.


@dataclass(frozen=True, kw_only=True, eq=False)
class EntrantOutcome:
    """What a ranking needs of the evaluation of one estimate in one run.

    Parameters
    ----------
    bracket : Interval
        Proven bounds of the total.
    parts, counts : dict
        Costs and counts.
    steps : dict of (T,) float arrays
        Costs of each step, by part; and the values of other rules, by rule.
    moments, times : (T,) array and list
        The steps, as numbers and as they were read.
    judged : mapping
        What it was judged on, as `Judged.record`.
    finished, status : bool, str
        Whether the solver did what was asked, and how it ended.
    input, against, others : dict, and PerStepRecord and Others or None
        Rows and digests; per-step GOSPA; other metrics.
    """

    bracket: Interval
    parts: CostParts
    counts: dict[str, float]
    steps: dict[str, Floats]
    moments: Times
    times: list[Time]
    judged: Mapping[str, Any]
    finished: bool
    status: str
    input: Mapping[str, Json]
    against: PerStepRecord | None = None
    others: Others | None = None


def outcome(
    result: Result, moments: Times, *, per_step: bool, others: Others | None = None
) -> EntrantOutcome:
    """What to keep of a result, so that the problem can go."""
    split, (lower, upper) = result.proof.breakdown, result.total_bounds
    record, values = against(result) if per_step else (None, {})
    return EntrantOutcome(
        bracket=Interval(lower=lower, upper=upper),
        parts=cast("CostParts", {name: getattr(result, name) for name in PARTS}),
        counts=result.counts,
        steps={name: result.scale * getattr(split, name) for name in PARTS} | values,
        moments=moments,
        times=result.labels.times,
        judged=result.judged,
        finished=bool(result.solver["finished"]),
        status=result.solver["status"],
        input=result.input,
        against=record,
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
    outcomes : sequence of EntrantOutcome
        What came of each.
    """

    name: str
    paths: Sequence[str]
    outcomes: Sequence[EntrantOutcome]


def durations(entrants: Sequence[Entrant]) -> list[int]:
    """Steps of the horizon of each run, at least 1; all entrants are judged on the same ones."""
    return [max(item.judged["steps"], 1) for item in entrants[0].outcomes]


# -------------------------------------------------------------------------------------------------
# The ranking.


StepCosts = tuple[list[Time], dict[str, list[float]]]
"""Times, and costs of the steps by estimate."""


def steps_columns(entrants: Sequence[Entrant], best: str) -> Columns:
    """Costs of each step, run, and estimate, and the differences to the best estimate's.

    A step that an estimate's evaluation has not, because nothing is there, costs nothing.
    """
    extra = [] if entrants[0].outcomes[0].against is None else ["gospa", *RULES]
    differences = ["difference", *(f"difference_{name}" for name in PARTS)]
    names = ["run", "t", "estimate", *PARTS, "total", *differences, *extra]
    table: Columns = {name: [] for name in names}
    leader = next(entrant for entrant in entrants if entrant.name == best)
    for entrant in entrants:
        for run, (item, first) in enumerate(zip(entrant.outcomes, leader.outcomes, strict=True)):
            times, own, other = joined(item, first)
            table["run"] += [run + 1] * len(times)
            table["t"] += times
            table["estimate"] += [entrant.name] * len(times)
            for name in ("total", *PARTS):
                table[name] += own[name].tolist()
                head = "difference" if name == "total" else f"difference_{name}"
                table[head] += (own[name] - other[name]).tolist()
            for rule in extra:
                table[rule] += own[rule].tolist()
    return table


def steps_costs(entrants: Sequence[Entrant]) -> StepCosts:
    """Times, and the cost of each step by estimate, mean over runs.

    None where the runs differ in length; of runs with other times each the numbers of the steps.
    """
    found: dict[str, list[float]] = {}
    times: list[list[Time]] = []
    for entrant in entrants:
        runs = []
        for run, item in enumerate(entrant.outcomes):
            rivals = [other.outcomes[run] for other in entrants]
            named = {m: t for o in rivals for m, t in zip(o.moments.tolist(), o.times, strict=True)}
            moments = np.array(sorted(named), item.moments.dtype)
            times.append([named[m] for m in moments.tolist()])
            costs = np.zeros(len(moments))
            costs[np.searchsorted(moments, item.moments)] = sum(item.steps[name] for name in PARTS)
            runs.append(costs)
        if len({len(costs) for costs in runs}) > 1:
            return [], {}
        found[entrant.name] = np.mean(runs, axis=0).tolist()
    same = all(other == times[0] for other in times)
    return (times[0] if same else [*range(1, len(times[0]) + 1)]), found


Costs = dict[str, Floats]
"""Of steps, by part, in ``total``, and by rule."""


def joined(first: EntrantOutcome, second: EntrantOutcome) -> tuple[list[Time], Costs, Costs]:
    """Times, and costs of both on the steps of either; 0 at those that one has not."""
    moments = np.union1d(first.moments, second.moments)
    times: dict[int, Time] = {}
    for item in (second, first):
        times |= zip(np.searchsorted(moments, item.moments).tolist(), item.times, strict=True)

    def spread(item: EntrantOutcome) -> Costs:
        at = np.searchsorted(moments, item.moments)
        costs = {name: np.zeros(len(moments)) for name in item.steps}
        for name, values in item.steps.items():
            costs[name][at] = values
        return costs | {"total": sum((costs[name] for name in PARTS), np.zeros(len(moments)))}

    return [times[k] for k in range(len(moments))], spread(first), spread(second)


def signs(own: Floats, other: Floats) -> Floats:
    """Whether each step costs less (-1), the same but for rounding (0), or more (1)."""
    small = np.abs(own - other) <= EQUAL * np.maximum(own, other)
    return np.where(small, 0.0, np.sign(own - other))


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

    found = [item.against for item in outcomes if item.against is not None]
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
    runs = zip(*(entrants[k].outcomes for k in pair), strict=True)
    same = all(a.input["estimate"]["sha256"] == b.input["estimate"]["sha256"] for a, b in runs)
    return "equal" if same else verdict(*(normal[k] for k in pair))


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
    count, difference = len(pairs), second_less_first(*normal)
    costs = [joined(b, a)[1:] for a, b in pairs]
    steps = [signs(own["total"], other["total"]) for own, other in costs]

    def change_of(part: Part) -> float:
        return float(np.mean([b.parts[part] - a.parts[part] for a, b in pairs] / shares))

    totals = [_mean([item.bracket for item in entrant.outcomes]) for entrant in entrants]
    return {
        "first": first.name,
        "second": second.name,
        "verdict": _verdict(entrants, normal),
        "opposed": totals[1].upper < totals[0].upper * (1 - EQUAL),
        "per_step": {
            "total": [difference.lower, difference.upper],
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


# -------------------------------------------------------------------------------------------------
# Saved results as what a ranking needs of evaluations. Solves nothing.

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


def outcomes(documents: Documents, paths: Paths) -> list[EntrantOutcome]:
    """What a ranking needs of the results of one run, which are of the same truth.

    Raises
    ------
    InputError
        Times are of several kinds or out of order.
    """
    moments = _moments(documents, paths)
    return [
        EntrantOutcome(
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
