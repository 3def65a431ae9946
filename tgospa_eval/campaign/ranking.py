"""Ranking of several estimates of the same truth, with proven differences.

With several runs (Monte Carlo), costs are added over the runs, and roots are taken last. ``tgospa``
is (mean total)^(1/p): for p = 2, the root mean square over runs. The normalised value is
(sum of totals / sum of steps)^(1/p). The bounds of a sum are the sums of the bounds. All estimates
have the same runs. Therefore ``tgospa``, the normalised value and the sum of totals give the same
order of the estimates. In this module, a *record* is a part of a JSON document, as a dict.
"""

import itertools
import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.campaign import SCHEMA, statistics
from tgospa_eval.campaign.row import (
    ESTIMATE_DIGEST,
    LABEL,
    MISSED,
    about_copies,
    covariances_of,
    in_words,
    label_names,
    originals,
    pair_numbers,
    run_ids,
    same_data,
    truths,
)
from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import EQUAL, Interval, places, second_less_first, verdict
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, natural, number
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.pair import PairEvaluation
from tgospa_eval.formats.fields import TimeError
from tgospa_eval.formats.fields import places as places_of_times
from tgospa_eval.problem.gospa import (
    Switched,
    changes_since_last_step,
    changes_since_last_stored,
    partners,
    per_step_gospa,
)
from tgospa_eval.problem.states import connected_components
from tgospa_eval.quoting import option
from tgospa_eval.results.consistency import NEES, NeesSums
from tgospa_eval.results.records import (
    MEAN,
    PARTS,
    SPLIT_PARTS,
    SPREAD,
    Columns,
    Json,
    OtherMetrics,
    Time,
    frame_records,
    outward,
)
from tgospa_eval.results.saved import OF_THE_ESTIMATE, of_metric
from tgospa_eval.results.summary import SUMMARY, flat, pooled
from tgospa_eval.show.batch import Places, Ranking
from tgospa_eval.show.result_text import COMPARED
from tgospa_eval.show.table_text import RULES, Rule
from tgospa_eval.tracks.alignment import Times
from tgospa_eval.tracks.coverage import DIGESTS, OWN_MARKS, coverage_of, incomparable, judge_alike

if TYPE_CHECKING:
    import pandas as pd


def against(result: PairEvaluation) -> tuple[Json, dict[str, Floats]]:
    """Evaluate each step of a result separately, by GOSPA and by the rules of other tools.

    Returns
    -------
    record : dict
        Sums over all steps. Costs are in state units to the power p.
    values : dict of (T,) float arrays
        Values of each step, in state units. ``gospa`` is GOSPA. ``stone_soup`` and ``mathworks``
        are the values that these tools print.
    """
    states, problem = result.proof.states, result.proof.states.problem
    parameters, scale = result.proof.parameters, result.scale
    p = parameters.order
    switch = 2 * scale * parameters.switch_price  # gamma^p, but at most 2e100 c^p
    entries, localisation, missed, false = per_step_gospa(problem)
    gospa = scale * (localisation + missed + false)
    track = partners(problem, entries)
    changes: dict[Rule, Switched] = {
        "stone_soup": changes_since_last_stored(problem, track),
        "mathworks": changes_since_last_step(problem, track),
    }
    value = gospa ** (1 / p)
    paid = {name: switch * count for name, (count, _) in changes.items()}
    values: dict[str, Floats] = {
        "gospa": value,
        "stone_soup": np.hypot(value, paid["stone_soup"] ** (1 / p)),
        "mathworks": (gospa + paid["mathworks"]) ** (1 / p),
    }
    used = states.entry[(states.entry >= 0) & (result.proof.weights > 0)]
    changed = np.setxor1d(used, entries)

    def of_rule(rule: Rule) -> Json:
        return {
            "switches": float(changes[rule][0].sum()),
            "halves": float(changes[rule][1].sum()),
            "total": float((values[rule] ** p).sum()),
            "mean": float(values[rule].mean()) if len(gospa) else 0.0,
        }

    record: Json = {
        "total": float(gospa.sum()),
        "localisation": scale * float(localisation.sum()),
        "missed": scale * float(missed.sum()),
        "false": scale * float(false.sum()),
        "steps_differing": len(np.unique(problem.entry_step[changed])),
        "stone_soup": of_rule("stone_soup"),
        "mathworks": of_rule("mathworks"),
    }
    return record, values


def differences(document: Json, step: Json, steps: Sequence[int], order: float) -> Iterator[str]:
    """Yield sentences on why per-step GOSPA of an estimate differs from its TGOSPA.

    Parameters
    ----------
    document : dict
        Record of the estimate in a ranking.
    step : dict
        Records of `against`, averaged over the runs.
    steps : sequence of int
        Number of steps of each run.
    order : float
        Order p of the metric.
    """
    total = document["total"]
    own = document["counts"]["switch"]
    share = (
        f"{100 * step['total'] / total:.4g} % of the total of TGOSPA"
        if total
        else "0, as is TGOSPA"
    )
    yield (
        f"per-step GOSPA, summed, is {share}: every step has its own cheapest assignment, and "
        "changes between steps cost nothing"
    )
    count = step["steps_differing"]
    yield (
        f"at {count:.4g} of {sum(steps) / len(steps):.6g} steps the "
        "assignment of TGOSPA is not the cheapest of that step"
        if count
        else "the assignment of TGOSPA is the cheapest at every step"
    )
    for rule, name in RULES.items():
        made, halves = step[rule]["switches"], step[rule]["halves"]
        text = f"{name} counts {_count(made, 'switch')} afterwards, TGOSPA {own:.4g}"
        if made:
            text += ": it counts the changes between the cheapest assignments"
        if halves:
            text += (
                f", and {halves / 2:.4g} for {_count(halves, 'change')} from a track to none or "
                "back, as at every miss; in TGOSPA the pair stays through a miss at no cost"
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
                "are not sums of costs"
            )


def _count(number: float, word: str) -> str:
    ending = "" if number == 1 else ("es" if word.endswith("ch") else "s")
    return f"{number:.4g} {word}{ending}"


# -------------------------------------------------------------------------------------------------
# Numbers of one estimate in one run, for a ranking.


@dataclass(frozen=True, kw_only=True, eq=False)
class RunOutcome:
    """Numbers of one estimate in one run, for a ranking.

    Parameters
    ----------
    path : str
        File of the estimate.
    run : dict
        Record for the JSON: bounds of the total, its parts, and how the solver ended.
    counts : dict
        Numbers of missed targets, false targets and switches.
    steps : dict of (T,) float arrays
        Costs of the T steps, by part. If requested, also the values of `against`, by name.
    timestamps, times : (T,) array and list
        Times of the steps as numbers, and as they were read.
    evaluated_on : mapping
        Description of the evaluated data, as in the JSON of a result.
    against : dict, optional
        Record of per-step GOSPA, from the function `against`.
    split : mapping of str to float
        Parts of the localisation cost, if the distance has parts.
    nees : NeesSums, optional
        Sums of NEES, which compare errors with covariances.
    summary : mapping of str to float
        Numbers of the summary. The names of nested numbers have dots.
    """

    path: str
    run: Json
    counts: dict[str, float]
    steps: dict[str, Floats]
    timestamps: Times
    times: list[Time]
    evaluated_on: Mapping[str, Any]
    against: Json | None = None
    split: Mapping[str, float] = field(default_factory=dict)
    nees: NeesSums | None = None
    summary: Mapping[str, float] = field(default_factory=dict)

    @property
    def numbers(self) -> Mapping[str, Any]:
        """Numbers by which copies of a run are found, by the columns of a row."""
        missed = zip(
            MISSED, (self.counts["missed"], self.evaluated_on["truth_states"]), strict=True
        )
        return {**self.run, **self.summary, **dict(missed)}


Entrants = Mapping[str, Sequence[RunOutcome]]
"""Runs of each estimate, by the name of the estimate; all estimates have the same runs."""


def outcome(path: str, result: PairEvaluation, timestamps: Times, *, per_step: bool) -> RunOutcome:
    """Return the numbers of a result that a ranking needs.

    The result itself takes much memory, and need not be kept. With `per_step`, the numbers of the
    function `against` are included.
    """
    split = result.proof.breakdown
    record, values = against(result) if per_step else (None, {})
    parts: Json = {name: getattr(result, name) for name in PARTS}
    return RunOutcome(
        path=path,
        run=_run(result.total_bounds, parts, result.solver, result.input, result.settings),
        counts=result.counts,
        steps={name: result.scale * getattr(split, name) for name in PARTS} | values,
        timestamps=timestamps,
        times=result.labels.times,
        evaluated_on=result.judged,
        against=record,
        split=result.split_parts,
        nees=result.nees,
        summary=dict(flat(result.summarised.numbers)),
    )


def _run(
    bounds: tuple[float, float],
    parts: Json,
    solver: Json,
    sides: object,
    settings: Mapping[str, object],
) -> Json:
    """Return the record of a run for the JSON document."""
    return {
        "total": bounds[1],
        "total_lower": bounds[0],
        **{name: parts[name] for name in PARTS},
        "status": solver["status"],
        "finished": bool(solver["finished"]),
        "input": sides,
        "parameters": {name: settings[name] for name in OF_THE_ESTIMATE if name in settings},
    }


def saved_outcomes(documents: Sequence[Json], paths: Sequence[str]) -> list[RunOutcome]:
    """Return the outcomes of saved results. All results are of one run, and have the same truth.

    Raises
    ------
    InputError
        The times are of several kinds or not in order.
    """
    times = [[step["t"] for step in document["per_step"]] for document in documents]
    try:
        timestamps = places_of_times(times)
    except TimeError as error:
        raise InputError(f"{paths[0]}, or a result of its truth: per_step: {error}") from None
    outcomes = []
    for document, path, own, named in zip(documents, paths, timestamps, times, strict=True):
        if np.any(np.diff(own) <= 0):
            raise InputError(f"{path}: per_step: times are not in order")
        order, steps = document["parameters"]["order"], document["per_step"]
        solver = document["solver"]
        # A document has bounds of the root. Their powers, rounded outward, bound the total.
        bounds = (
            outward(document["lower_bound"] ** order, -1),
            outward(document["upper_bound"] ** order, 1),
        )
        outcomes.append(
            RunOutcome(
                path=path,
                run=_run(bounds, document, solver, document["input"], document["parameters"]),
                counts=document["counts"],
                steps={name: np.array([step[name] for step in steps], float) for name in PARTS},
                timestamps=own,
                times=named,
                evaluated_on=document["judged"],
                split={name: document[name] for name in SPLIT_PARTS if name in document},
                nees=NeesSums.of_values(document),
                summary=dict(flat(document.get(SUMMARY, {}))),
            )
        )
    return outcomes


# -------------------------------------------------------------------------------------------------
# Costs of the steps, side by side.


SideBySide = tuple[list[Time], dict[str, Floats], Mask]
"""Times, costs and a mask of N evaluations of one run.

There are T different times in all evaluations together. Costs are arrays (N, T) by name: each part
of the cost, ``total``, and if requested the values of the function `against`. The mask (N, T) is
true where an evaluation has the step. Elsewhere, the costs are 0.
"""


def side_by_side(entrants: Entrants) -> Iterator[SideBySide]:
    """Yield for each run the costs of its steps, for all estimates together."""
    for outcomes in zip(*entrants.values(), strict=True):
        timestamps = np.unique(np.concatenate([item.timestamps for item in outcomes]))
        there = np.zeros((len(outcomes), len(timestamps)), bool)
        costs = {name: np.zeros(there.shape) for name in outcomes[0].steps}
        named: dict[int, Time] = {}
        for k, item in enumerate(outcomes):
            at = np.searchsorted(timestamps, item.timestamps)
            there[k, at] = True
            for name, values in item.steps.items():
                costs[name][k, at] = values
            named = dict(zip(at.tolist(), item.times, strict=True)) | named
        costs["total"] = sum((costs[name] for name in PARTS), np.zeros(there.shape))
        yield [named[k] for k in range(len(timestamps))], costs, there


def steps_columns(entrants: Entrants, best: str) -> Columns:
    """Return a table with a row for each estimate, run and step: costs and differences.

    A difference is the cost minus the cost of the estimate `best`. If neither truth nor estimate
    has a state at a step, the evaluation lacks the step: its cost there is 0.
    """
    runs, leader = list(side_by_side(entrants)), list(entrants).index(best)
    rules = [name for name in ("gospa", *RULES) if name in runs[0][1]]
    heads: dict[str, str] = {
        "total": "difference",
        **{name: f"difference_{name}" for name in PARTS},
    }
    names = ("run", "t", "estimate", *PARTS, "total", *heads.values(), *rules)
    table: Columns = {name: [] for name in names}
    for (k, name), (run, steps) in itertools.product(enumerate(entrants), enumerate(runs, 1)):
        times, costs, there = steps
        rows = np.flatnonzero(there[k] | there[leader])
        table["run"] += [run] * len(rows)
        table["t"] += [times[row] for row in rows]
        table["estimate"] += [name] * len(rows)
        for cost in (*heads, *rules):
            table[cost] += costs[cost][k, rows].tolist()
        for cost, head in heads.items():
            table[head] += (costs[cost][k, rows] - costs[cost][leader, rows]).tolist()
    return table


def steps_costs(entrants: Entrants) -> tuple[list[Time], dict[str, list[float]]]:
    """Return the times, and for each estimate the cost of each step, averaged over runs.

    Both are empty if the runs differ in their number of steps. If only their times differ, the
    steps are numbered from 1, and these numbers replace the times.
    """
    each, costs, _ = zip(*side_by_side(entrants), strict=True)
    times = each[0]
    if any(len(other) != len(times) for other in each):
        return [], {}
    means = np.mean([run["total"] for run in costs], axis=0).tolist()
    same = all(other == times for other in each)
    return times if same else [*range(1, len(times) + 1)], dict(zip(entrants, means, strict=True))


# -------------------------------------------------------------------------------------------------
# The ranking.

RANKED = "normalised.tgospa"
"""Field by which estimates are ranked."""


def ranking_document(
    entrants: Entrants,
    truths: Sequence[str],
    parameters: Json,
    warnings: list[dict[str, str]],
    other_metrics: Mapping[str, OtherMetrics],
) -> Json:
    """Return the JSON document of a comparison, with the best estimate first.

    Parameters
    ----------
    entrants : mapping of str to sequence of RunOutcome
        At least one estimate; all have the same number of runs.
    truths : sequence of str
        File with the truth of each run.
    parameters : dict
        Options that change the value of the metric.
    warnings : list of dict
        Warnings about the data.
    other_metrics : mapping of str to dict
        Other metrics of all runs together, by the name of the estimate.

    Raises
    ------
    ConfigError
        Estimates are evaluated on different truths, or at different steps.
    """
    for outcomes in zip(*entrants.values(), strict=True):
        both = zip(entrants, outcomes, strict=True)
        wrong = incomparable({f"{name}, {item.path}": item.evaluated_on for name, item in both})
        of_truth = [item.run["input"]["truth"]["sha256"] for item in outcomes]
        other = next((k for k, digest in enumerate(of_truth) if digest != of_truth[0]), None)
        if wrong and other is not None:
            raise ConfigError(
                f"no ranking: the ground truth of {list(entrants)[other]}, {outcomes[other].path}, "
                f"has other states, ids or times than that of {outcomes[0].path}; evaluate all "
                "estimates on the same ground truth"
            )
        if wrong:
            raise ConfigError(f"no ranking: {wrong}; {judge_alike()}")
    names, order = list(entrants), parameters["order"]
    steps = [max(item.evaluated_on["steps"], 1) for item in entrants[names[0]]]
    costs = {
        name: np.array([[item.run[name] for item in runs] for runs in entrants.values()], float)
        for name in ("total", "total_lower", *PARTS)
    }
    shares = 1 / np.array(steps, float)
    lower, upper = costs["total_lower"] * shares, costs["total"] * shares
    normal, roots = (
        _combined((costs["total_lower"], costs["total"]), power, sum(steps))
        for power in (1.0, order)
    )
    ranked = sorted(range(len(names)), key=lambda k: (normal[k].upper, normal[k].lower))
    digests = [
        [f"{item.run['input']['estimate']['sha256']} {item.run['parameters']}" for item in runs]
        for runs in entrants.values()
    ]
    equal = _same(names, digests, costs["total_lower"], costs["total"])

    verdicts, place = _proven(roots, equal)
    truth_ids = [item.run["input"]["truth"]["sha256"] for item in entrants[names[0]]]
    copied = [
        originals(zip(truth_ids, own, (item.numbers for item in runs), strict=True))
        for own, runs in zip(digests, entrants.values(), strict=True)
    ]
    bounds = costs["total_lower"][ranked], costs["total"][ranked]
    runs_ranked = [copied[k] for k in ranked]
    totals, separate = _totals(bounds, truth_ids, runs_ranked, np.array(steps, float))
    too_few = totals[0].shape[1] < statistics.MIN_PAIRS <= len(steps)
    copies = [
        notice if not too_few else replace(notice, remedy=f"{notice.remedy}; {NO_TEST}")
        for name, own in zip(names, copied, strict=True)
        for notice in about_copies(name, own)
    ]
    estimates = []
    for k in ranked:
        runs = entrants[names[k]]
        own = {name: values[k] for name, values in costs.items()}
        item = _estimate(names[k], runs, own, steps, order) | {"place": list(place[k])}
        if names[k] in other_metrics:
            item["with"] = other_metrics[names[k]]
        estimates.append(item)
    of_steps = [run["total"] for _, run, _ in side_by_side(entrants)]
    pairs: list[Json] = []
    for a, b in itertools.combinations(ranked, 2):
        difference = second_less_first(normal[a], normal[b])
        # The difference is second minus first. The first has the smaller value.
        per_step: Json = {"total": [difference.lower, difference.upper]}
        for name in PARTS:
            per_step[name] = float((costs[name][b] - costs[name][a]).sum() / sum(steps))
        change, count = upper[b] - upper[a], len(steps)
        different = len({*zip(copied[a], copied[b], strict=True)})
        # Steps whose costs differ by rounding alone are neither better nor worse.
        clear = EQUAL * np.concatenate([np.maximum(own[a], own[b]) for own in of_steps])
        more = np.concatenate([own[b] - own[a] for own in of_steps])
        pairs.append(
            {
                "first": names[a],
                "second": names[b],
                "verdict": verdicts[a, b],
                "per_step": per_step,
                **_difference((a, b) in equal, roots[a], roots[b]),
                **UNTESTED,
                "steps": {
                    "better": int((more < -clear).sum()),
                    "worse": int((more > clear).sum()),
                },
                "per_run": {
                    "mean": float(change.mean()),
                    "standard_error": (
                        float(change.std(ddof=1) / count**0.5) if different > 1 else None
                    ),
                    "first_less": int((upper[a] < lower[b]).sum()),
                    "second_less": int((upper[b] < lower[a]).sum()),
                },
            }
        )
    same = np.array([pair in equal for pair in itertools.combinations(ranked, 2)], bool)
    sure = _with_intervals(pairs, same, totals, separate, order, per_step=True)
    tested = _tested(pairs, same, totals)
    for item, ends, statistical in zip(estimates, sure, tested, strict=True):
        item |= {"confidence": ends, "statistical_place": statistical}
    own_warnings = (*copies, *about_covariances(estimates))
    warnings = [*warnings, *(notice.record() for notice in own_warnings)]
    own_settings = [run["parameters"] for item in estimates for run in item["runs"]]
    return {
        "schema": SCHEMA,
        "version": __version__,
        "kind": "estimates",
        "runs": len(steps),
        "steps": steps,
        "truth": list(truths),
        "ranked_by": RANKED,
        "estimates": estimates,
        "pairs": pairs,
        "parameters": {  # without those that differ between estimates
            name: value
            for name, value in parameters.items()
            if name not in OF_THE_ESTIMATE or all(own.get(name) == value for own in own_settings)
        },
        "warnings": warnings,
    }


def about_covariances(estimates: Sequence[Json]) -> Iterator[Notice]:
    """Yield notices on a ranking whose distance uses covariances.

    `estimates` has the records of the estimates, best first.
    """
    for item in estimates:
        if item.get(NEES):
            for notice in NeesSums(**item[NEES]["sums"]).warnings(item.get(SPREAD)):
                yield notice.about(item["name"])
    if len(estimates) < 2 or not all(MEAN in item for item in estimates):
        return
    first, best = estimates[0], min(estimates, key=lambda item: float(item[MEAN]))
    if best[MEAN] < first[MEAN] * (1 - EQUAL):
        costs = (number(item[MEAN], 4) for item in (best, first))
        yield Notice(
            code="order-by-covariances",
            text=f"{best['name']} has smaller errors of means than {first['name']}, cost "
            f"{' against '.join(costs)}: covariances decide this order",
            remedy=f"compare means and NEES as well, or {option('distance', 'euclidean')}",
        )


def _estimate(
    name: str, runs: Sequence[RunOutcome], costs: dict[str, Floats], steps: list[int], order: float
) -> Json:
    """Return the record of one estimate: means over its runs, with roots taken last."""
    means = {part: float(values.mean()) for part, values in costs.items()}
    roots = {
        part: float((values.sum() / sum(steps)) ** (1 / order)) for part, values in costs.items()
    }
    step = _means([run.against for run in runs if run.against is not None])
    item: Json = {
        "name": name,
        "paths": [run.path for run in runs],
        "tgospa": means["total"] ** (1 / order),
        "lower_bound": means["total_lower"] ** (1 / order),
        **means,
        "counts": _means([run.counts for run in runs]),
        "normalised": {
            "tgospa": roots["total"],
            "lower_bound": roots["total_lower"],
            **{part: roots[part] for part in PARTS},
        },
        "runs": [run.run for run in runs],
        "per_step_gospa": step,
    }
    if all(run.split.keys() == runs[0].split.keys() for run in runs):
        item |= _means([dict(run.split) for run in runs]) or {}
    summaries = [run.summary for run in runs]
    item[SUMMARY] = pooled(
        {
            key: np.array([own.get(key, np.nan) for own in summaries])
            for key in dict.fromkeys(name for own in summaries for name in own)
        }
    )
    nees = [run.nees for run in runs if run.nees is not None]
    if len(nees) == len(runs):
        joined = NeesSums.joined(nees)
        item[NEES] = joined and joined.record()
    if step is not None:
        item["differences"] = list(differences(item, step, steps, order))
    return item


def _means(records: Sequence[Json]) -> Json | None:
    """Return the mean of each number, also in nested records; None if there are no records."""
    if not records:
        return None
    means: Json = {}
    for name, first in records[0].items():
        each = [record[name] for record in records]
        means[name] = _means(each) if isinstance(first, dict) else float(np.mean(each))
    return means


# -------------------------------------------------------------------------------------------------
# Other metrics of saved results.

BESIDE = {"similarity": ("zero", "threshold")}
FIELDS_SHOWN = {**COMPARED, **BESIDE}
"""Names of the numbers that a ranking shows, for each of the other metrics."""


def shared_metrics(runs: Sequence[Sequence[Json]]) -> tuple[list[OtherMetrics], list[Notice]]:
    """Return for each estimate the other metrics that all results have, and notices.

    `runs` has for each run the result of each estimate. The notices name metrics that are left out.
    With several runs, all metrics are left out. Their ratios would need the counts of all runs, but
    results do not have these counts.
    """
    each: list[OtherMetrics] = [document.get("with", {}) for run in runs for document in run]
    first = each[0] if len(runs) == 1 else {}
    shared = [
        name
        for name in first
        if all(name in metrics and metrics[name].keys() == first[name].keys() for metrics in each)
        and first[name].keys() >= {*FIELDS_SHOWN.get(name, ())}
    ]
    left_out = sorted({name for metrics in each for name in metrics} - {*shared, *BESIDE})
    notices = [
        Notice(text=f"not shown: {name}; shown only for a single run, if all results have it")
        for name in left_out
    ]
    return [{name: metrics[name] for name in shared} for metrics in each[: len(runs[0])]], notices


# -------------------------------------------------------------------------------------------------
# Ranking of a batch by one label, such as the tracker: a proven and a statistical order.
#
# A ranking uses jobs that differ only in this label. Each value of the label must have such a job.
# The proven order is about the files of these jobs: it compares brackets of combined values. The
# statistical order is an inference about other truths of the same kind (`statistics`).


MAX_COMPARED = 100
"""Largest number of values of a label that are ranked: each value is compared with all others."""

NOTHING = Interval(lower=0.0, upper=0.0)
"""Difference of two estimates with the same data."""

Parameters = Mapping[str, float | str]


def rankings(
    having: "pd.DataFrame", label: str, parameters: Sequence[str], names: Iterable[str]
) -> Iterator[Ranking | str]:
    """Yield warnings, and for each set of parameters a ranking or the reason why there is none.

    Parameters
    ----------
    having : DataFrame
        Rows of a store that have a value.
    label : str
        Label whose values are compared.
    parameters : sequence of str
        Columns of the parameters in which jobs differ.
    names : iterable of str
        All values of the label, also those for which all jobs failed.
    """
    if not parameters:
        yield from _ranking(having, label, {}, names)
        return
    for _, part in having.groupby(list(parameters)):
        yield from _ranking(part, label, {name: part[name].iloc[0] for name in parameters}, names)


def _ranking(
    part: "pd.DataFrame", label: str, parameters: Parameters, all_names: Iterable[str]
) -> Iterator[Ranking | str]:
    column = LABEL + label
    if any(OWN_MARKS in json.loads(text).get("ignore", ()) for text in part["parameters"].unique()):
        yield (
            f"{label} is not ranked: its estimates themselves mark states that are not evaluated "
            f"({option('ignore', OWN_MARKS)})"
        )
        return
    part = part.assign(_pair=pair_numbers(part, [label]), _truth=truths(part))
    # After a change of the manifest, two jobs can have the same labels and truth: the newer counts.
    part = part.sort_values("finished", kind="stable")
    part = part.drop_duplicates([column, "_pair"], keep="last")
    names = sorted(part[column].unique(), key=natural)
    if len(names) < 2:
        if {*all_names} <= {*names}:
            yield f"{label} has only one value: nothing to rank"
        else:
            own = " and ".join(f"{name} {in_words(value)}" for name, value in parameters.items())
            own = f" with {own}" if own else ""
            yield f"{label} is not ranked: only {names[0]} has values{own}"
        return
    if len(names) > MAX_COMPARED:
        yield f"{label} has {len(names):,} values: at most {MAX_COMPARED} are ranked"
        return
    is_common = part.groupby("_pair")["_pair"].transform("size") == len(names)
    common, of_labels = part[is_common], pair_numbers(part, [label], truth=False)
    differing = of_labels[part.groupby(of_labels)["_truth"].transform("nunique") > 1]
    if len(common) and len(differing):
        same = frame_records(part[of_labels == differing.iloc[0]].drop_duplicates("_truth"))
        having = " and ".join(f"{row['truth']} of {row[column]}" for row in same[:2])
        yield (
            f"warning: {counted(differing.nunique(), 'job')} of each {label} cannot be compared, "
            f"as the truth is not the same: {having}"
        )
    if not len(common) and len(differing):
        yield f"{label} is not ranked: no truth has a job for each value of {label}"
        return
    if not len(common):
        rest = [name for name in label_names(part) if name != label]
        first = part[part[column] == names[0]].iloc[0]
        known = set(part.loc[part["_pair"] == first["_pair"], column])
        own = " ".join(f"{name}={first[LABEL + name]}" for name in rest)
        yield (
            f"{label} is not ranked: no {' and '.join(rest) or 'job'} has a job for each value of "
            f"{label}; {names[0]} has {own}, "
            f"but {next(k for k in names if k not in known)} does not"
        )
        return
    kinds = common.groupby("_pair")[list(DIGESTS)].nunique().max(axis=1)
    if (kinds > 1).any():
        jobs = common[common["_pair"] == kinds.index[kinds > 1][0]]
        wrong = incomparable({row[column]: coverage_of(row) for row in frame_records(jobs)})
        yield f"{label} is not ranked: {jobs['truth'].iloc[0]}: {wrong}; {judge_alike()}"
        return
    names, totals, separate = _side_by_side(common, column, names)
    entries, comparisons = _orders(common, column, names, totals, separate)
    count = totals[0].shape[1]
    yield Ranking(
        label=label,
        entries=entries,
        comparisons=comparisons,
        jobs=len(common) // len(names),
        all_jobs=int(of_labels.nunique()),
        pairs=count,
        truths=common["_truth"].nunique(),
        permutations=statistics.permutations_of(count),
        seed=statistics.PERMUTATION_SEED,
        order=float(common["order"].iloc[0]),
        parameters=parameters,
        left_out=tuple(sorted(set(all_names) - set(names), key=natural)),
    )
    items: list[Json] = []
    for name in names:
        costs, nees = covariances_of(common[common[column] == name])
        items.append({"name": name, **costs, NEES: nees and nees.record()})
    yield from map(str, about_covariances(items))


NO_TEST = "a test needs different runs of both, or several truths"

Totals = tuple[Floats, Floats, Floats]
"""Lower bounds of totals, upper bounds of totals, and numbers of steps, by unit (see `_units`).

The bounds have the shape (names, units), and the numbers of steps have the shape (units,).
"""


def _side_by_side(
    common: "pd.DataFrame", column: str, names: Sequence[str]
) -> tuple[list[str], Totals, list[Totals]]:
    """Return the names, best first, and the results of `_totals`."""
    truth = common.groupby("_pair")["_truth"].first()
    costs = common.set_index(["_pair", column]).sort_index()[statistics.TOTAL_ENDS].unstack(column)
    lower, upper = (costs[side][list(names)].to_numpy(float).T for side in statistics.TOTAL_ENDS)
    steps = common.groupby("_pair")["judged.steps"].first().clip(lower=1).to_numpy(float)
    runs = common.assign(_run=run_ids(common)).set_index(["_pair", column])["_run"].unstack(column)
    copied = runs[list(names)].to_numpy().T.tolist()
    (lower, upper, steps), separate = _totals((lower, upper), truth.tolist(), copied, steps)
    best = np.lexsort((lower.sum(axis=1), upper.sum(axis=1)))
    totals = lower[best], upper[best], steps
    return [names[k] for k in best], totals, [separate[k] for k in best]


def _totals(
    bounds: tuple[Floats, Floats],
    truth: Sequence[str],
    runs: Sequence[Sequence[object]],
    steps: Floats,
) -> tuple[Totals, list[Totals]]:
    """Return the totals of all names by common units, and of each name by its own units."""
    separate = [
        _per_unit((bounds[0][[k]], bounds[1][[k]]), _units(truth, [own]), steps)
        for k, own in enumerate(runs)
    ]
    return _per_unit(bounds, _units(truth, runs), steps), separate


def _units(truth: Sequence[str], runs: Sequence[Sequence[object]]) -> Ints:
    """Return the index of the unit of each job. The units are the sample of the statistics.

    With several truths, a unit is a truth with all its jobs. With one truth, each job is a unit.
    Exception: jobs that are copies in an estimate are one unit. For each estimate, `runs` has a
    value for each job, which is the same for copies.
    """
    _, unit = np.unique(truth, return_inverse=True)
    if unit.any():
        return unit
    texts = [f"{k} {run}" for k, own in enumerate(runs) for run in own]
    _, data = np.unique(texts, return_inverse=True)
    jobs, size = np.tile(np.arange(len(unit)), len(runs)), len(unit)
    parts = connected_components(jobs, size + data, size + len(data))
    return np.unique(parts[:size], return_inverse=True)[1]


def _per_unit(totals: tuple[Floats, Floats], unit: Ints, steps: Floats) -> Totals:
    """Add totals (names, jobs) and steps (jobs,) over the jobs of each unit.

    Units are sorted by these sums. Their order therefore does not depend on the names of sequences
    or runs.
    """
    lower, upper = totals
    rows = np.concatenate([lower, upper, steps[None]])
    sums = np.zeros((unit.max() + 1, len(rows)))
    np.add.at(sums, unit, rows.T)
    lower, upper, (steps,) = np.split(sums.T, [len(lower), 2 * len(lower)])
    keys = np.concatenate([steps[None], np.sort(lower, axis=0), np.sort(upper, axis=0)])
    pairs = np.lexsort(keys)
    return lower[:, pairs], upper[:, pairs], steps[pairs]


def _orders(
    common: "pd.DataFrame",
    column: str,
    names: Sequence[str],
    totals: Totals,
    separate: Sequence[Totals],
) -> tuple[list[Json], list[Json]]:
    """Return a record of each estimate, and of each pair of estimates, for the JSON of a batch.

    `common` has the jobs that exist for all estimates. `names` are sorted, best first. `totals` and
    `separate` are those of `_totals`.
    """
    size, order = len(names), float(common["order"].iloc[0])
    sums = common.groupby(column)[["judged.steps", *PARTS]].sum().loc[list(names)]
    steps = sums["judged.steps"].to_numpy(float)
    parts = (sums[list(PARTS)].div(np.maximum(steps, 1.0), axis=0) ** (1 / order)).to_dict(
        "records"
    )
    values, per_step = (_combined(totals[:2], order, divisor) for divisor in (1.0, steps))
    equal = _same(names, *_data(common, column, names))
    verdicts, proven = _proven(values, equal)
    comparisons: list[Json] = []
    for a, b in itertools.combinations(range(size), 2):
        comparisons.append(
            {
                "first": names[a],
                "second": names[b],
                "verdict": verdicts[a, b],
                **_difference((a, b) in equal, values[a], values[b]),
                **_difference((a, b) in equal, per_step[a], per_step[b], "per_step_"),
                **UNTESTED,
            }
        )
    same = np.array([pair in equal for pair in itertools.combinations(range(size), 2)], bool)
    sure = _with_intervals(comparisons, same, totals, separate, order)
    of_steps = _with_intervals(
        comparisons, same, totals, separate, order, "per_step_", per_step=True
    )
    inferred = _tested(comparisons, same, totals)
    entries = [
        {
            "name": name,
            "place": place,
            "combined": value.upper,
            "combined_lower": value.lower,
            "per_step": each.upper,
            "per_step_lower": each.lower,
            **own,
            "confidence": ends,
            "per_step_confidence": of_step,
            "statistical_place": statistical,
        }
        for name, place, value, each, own, ends, of_step, statistical in zip(
            names, proven, values, per_step, parts, sure, of_steps, inferred, strict=True
        )
    ]
    return entries, comparisons


def _proven(
    values: Sequence[Interval], same: Collection[tuple[int, int]]
) -> tuple[dict[tuple[int, int], str], list[Places]]:
    """Return the verdict on each pair of values, and the place of each value.

    Pairs are pairs of indices. Those in `same` have the same data.
    """
    verdicts: dict[tuple[int, int], str] = {
        pair: "equal" if pair in same else verdict(*(values[k] for k in pair))
        for pair in itertools.permutations(range(len(values)), 2)
    }
    return verdicts, places(values, lambda *pair: verdicts[pair] == "equal")


def _combined(totals: tuple[Floats, Floats], order: float, per: Floats | float) -> list[Interval]:
    """Sum the totals of each name, divide the sums by `per`, and return brackets of their roots."""
    lower, upper = (((side.sum(axis=1) / per) ** (1 / order)).tolist() for side in totals)
    return [Interval(lower=low, upper=high) for low, high in zip(lower, upper, strict=True)]


def _data(
    common: "pd.DataFrame", column: str, names: Sequence[str]
) -> tuple[list[list[str]], Floats, Floats]:
    """Return digests of estimates, and lower and upper bounds of totals, for each name and job.

    All names have the same order of jobs.
    """
    table = common.set_index(["_pair", column]).sort_index()
    sides = [
        table[end].unstack(column)[list(names)].to_numpy(float).T for end in statistics.TOTAL_ENDS
    ]
    if ESTIMATE_DIGEST not in table:
        return [[""] * sides[0].shape[1]] * len(names), sides[0], sides[1]
    # A job can have options of its own, which change the value. Digests include the parameters.
    options = {
        text: json.dumps(of_metric(json.loads(text)), sort_keys=True)
        for text in table["parameters"].unique()
    }
    data = table[ESTIMATE_DIGEST] + " " + table["parameters"].map(options)
    return data.fillna("").unstack(column)[list(names)].to_numpy().T.tolist(), sides[0], sides[1]


def _same(
    names: Sequence[str], digests: Sequence[Sequence[str]], lower: Floats, upper: Floats
) -> set[tuple[int, int]]:
    """Return the names with the same data, as pairs of indices: both (a, b) and (b, a)."""
    brackets = [
        [Interval(lower=low, upper=high) for low, high in zip(*ends, strict=True)]
        for ends in zip(lower.tolist(), upper.tolist(), strict=True)
    ]
    pairs = itertools.combinations(range(len(names)), 2)
    same = [
        (a, b)
        for a, b in pairs
        if same_data((names[a], names[b]), (digests[a], digests[b]), (brackets[a], brackets[b]))
    ]
    return {*same, *((b, a) for a, b in same)}


UNTESTED: Json = dict.fromkeys(("p_value", "p_holm", "significant"))
"""Test results of a pair with too few truths."""


def _difference(same: bool, first: Interval, second: Interval, before: str = "") -> Json:
    """Return fields with the bracket of second minus first, and with its confidence interval.

    The interval is None until `_with_intervals` sets it. The names of the fields begin with
    `before`.
    """
    difference = NOTHING if same else second_less_first(first, second)
    bracket = [difference.lower, difference.upper]
    return {f"{before}difference": bracket, f"{before}lower": None, f"{before}upper": None}


def _with_intervals(
    comparisons: Sequence[Json],
    same: Mask,
    totals: Totals,
    separate: Sequence[Totals],
    order: float,
    before: str = "",
    *,
    per_step: bool = False,
) -> list[Any]:
    """Set the confidence intervals of all differences, and return the intervals of the values.

    With too few truths nothing is set. The interval of a value with too few truths is None.

    Parameters
    ----------
    comparisons : sequence of dict
        Records of all pairs, with the fields of `_difference`.
    same : array, shape (comparisons,)
        Whether both names of a pair have the same data.
    totals, separate : Totals and sequence of Totals
        Totals of the names, best first, by common units and by own units.
    order : float
        Order p of the metric.
    before : str
        Prefix of the names of the fields, as in `_difference`.
    per_step : bool
        Whether values are per step instead of combined.
    """
    sure: list[Any] = []
    for lower, upper, steps in separate:
        per, enough = steps if per_step else None, lower.shape[1] >= statistics.MIN_PAIRS
        ends = statistics.intervals(lower, upper, order, per) if enough else ()
        sure.append(np.ravel(ends).tolist() or None)
    lower, upper, steps = totals
    per = steps if per_step else None
    if lower.shape[1] < statistics.MIN_PAIRS:
        return sure
    first, second = np.triu_indices(len(lower), 1)
    lower, upper = (statistics.without_each(side, order, per) for side in (lower, upper))
    margin = statistics.margins(lower[second] - upper[first], upper[second] - lower[first])
    for row, half in zip(comparisons, np.where(same, 0.0, margin).tolist(), strict=True):
        low, high = row[f"{before}difference"]
        row |= {f"{before}lower": low - half, f"{before}upper": high + half}
    return sure


def _tested(comparisons: Sequence[Json], same: Mask, totals: Totals) -> list[Any]:
    """Set the test results of all pairs, and return the statistical place of each name.

    A name is ahead only of names from which it differs significantly. With too few truths nothing
    is set, and places are None. The arguments are those of `_with_intervals`.
    """
    lower, upper, _ = totals
    size = len(lower)
    if lower.shape[1] < statistics.MIN_PAIRS:
        return [None] * size
    if not comparisons:
        return [(1, 1)] * size
    first, second = np.triu_indices(size, 1)
    lowest, highest = lower[second] - upper[first], upper[second] - lower[first]
    lowest[same] = highest[same] = 0.0
    p_value = statistics.p_values(lowest, highest)
    adjusted = statistics.holm(p_value)
    significant = adjusted < 1 - statistics.CONFIDENCE
    for row, *values in zip(
        comparisons, p_value.tolist(), adjusted.tolist(), significant.tolist(), strict=True
    ):
        row |= dict(zip(UNTESTED, values, strict=True))
    ahead, behind = (np.bincount(side[significant], minlength=size) for side in (second, first))
    return list(zip((1 + ahead).tolist(), (size - behind).tolist(), strict=True))
