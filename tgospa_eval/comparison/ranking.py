"""Several estimates of one truth: proven order, and what the differences are made of.

With several runs of each (Monte Carlo) costs are averaged over the runs, and roots are taken last:
``tgospa`` is (mean total)^(1/p), its normalised form (mean of total / T)^(1/p), for p = 2 the root
of the mean square over runs. Averages of brackets bracket the averages. Ranked is the normalised
form, in which each run counts the same however long it is; where runs differ in length the order of
the mean totals may be another, and `opposed` marks it.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval._version import __version__
from tgospa_eval.common.interval import Interval
from tgospa_eval.comparison import SCHEMA
from tgospa_eval.comparison.against import Against, against, against_document, differences
from tgospa_eval.comparison.brackets import EQUAL, equal, less, places
from tgospa_eval.comparison.runs import bracket_of, costs_of
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.records import (
    RULES,
    Costs,
    EstimateRecord,
    Metric,
    PairRecord,
    PerStepRecord,
    RankingRecord,
    RuleRecord,
)
from tgospa_eval.results.records import PARTS, Columns, FileRecord, Part, Time
from tgospa_eval.results.result import Result

StepCosts = tuple[list[Time], dict[str, list[float]]]
"""Times, and costs of the steps by estimate."""

RANKED = "normalised.tgospa"
"""The field of an estimate by which estimates are ranked."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What is kept of the evaluation of one estimate in one run.

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
    input, against : dict, and Against or None
        Rows and digests; per-step GOSPA.
    """

    bracket: Interval
    parts: Costs
    counts: dict[str, float]
    steps: dict[str, Floats]
    moments: NDArray[Any]
    times: list[Time]
    occupied: NDArray[np.bool_]
    finished: bool
    status: str
    input: Mapping[str, FileRecord]
    against: Against | None = None


def outcome(result: Result, moments: NDArray[Any], *, per_step: bool) -> Outcome:
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


def document(
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
    """
    order = parameters["order"]
    steps = durations(entrants)
    per_step = [[o.bracket.scaled(1 / t) for o, t in zip(e.outcomes, steps, strict=True)]
                for e in entrants]  # fmt: skip
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
    return {
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
        "per_step_gospa": _mean_per_step(found) if found else None,
    }


def _mean_per_step(found: Sequence[PerStepRecord]) -> PerStepRecord:
    return {
        "total": float(np.mean([item["total"] for item in found])),
        "localisation": float(np.mean([item["localisation"] for item in found])),
        "missed": float(np.mean([item["missed"] for item in found])),
        "false": float(np.mean([item["false"] for item in found])),
        "steps_differing": float(np.mean([item["steps_differing"] for item in found])),
        "stone_soup": _mean_rule([item["stone_soup"] for item in found]),
        "mathworks": _mean_rule([item["mathworks"] for item in found]),
    }


def _mean_rule(found: Sequence[RuleRecord]) -> RuleRecord:
    return {
        "switches": float(np.mean([item["switches"] for item in found])),
        "halves": float(np.mean([item["halves"] for item in found])),
        "total": float(np.mean([item["total"] for item in found])),
        "mean": float(np.mean([item["mean"] for item in found])),
    }


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
    steps = [_signs(*_joined(b, a)) for a, b in pairs]

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
            own, other = _joined(item, first)
            table["run"] += [run + 1] * len(own.times)
            table["t"] += own.times
            table["estimate"] += [entrant.name] * len(own.times)
            for name in PARTS:
                table[name] += own.costs[name].tolist()
                table[f"difference_{name}"] += (own.costs[name] - other.costs[name]).tolist()
            table["total"] += own.total.tolist()
            table["difference"] += (own.total - other.total).tolist()
            for rule in extra:
                table[rule] += own.costs[rule].tolist()
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
            costs[np.searchsorted(moments, item.moments)] = sum(item.steps.values())
            runs.append(costs)
        if len({len(costs) for costs in runs}) > 1:
            return [], {}
        found[entrant.name] = np.mean(runs, axis=0).tolist()
    same = all(other == times[0] for other in times)
    return (times[0] if same else [*range(1, len(times[0]) + 1)]), found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Joined:
    """Costs by name on the steps of two outcomes; 0 at those that one has not."""

    times: list[Time]
    costs: dict[str, Floats]

    @property
    def total(self) -> Floats:
        total: Floats = sum((self.costs[name] for name in PARTS), np.zeros(len(self.times)))
        return total


def _joined(first: Outcome, second: Outcome) -> tuple[_Joined, _Joined]:
    """Costs of both on the steps of either."""
    moments = np.union1d(first.moments, second.moments)
    times: dict[int, Time] = {}
    for item in (second, first):
        times |= zip(np.searchsorted(moments, item.moments).tolist(), item.times, strict=True)
    shown = [times[k] for k in range(len(moments))]
    own, other = (_spread(item, moments) for item in (first, second))
    return _Joined(times=shown, costs=own), _Joined(times=shown, costs=other)


def _spread(item: Outcome, moments: NDArray[Any]) -> dict[str, Floats]:
    """Costs by name, and the values of other rules, at these steps."""
    at = np.searchsorted(moments, item.moments)
    found: dict[str, Floats] = {}
    for name, values in (item.steps | (item.against.values if item.against else {})).items():
        found[name] = np.zeros(len(moments))
        found[name][at] = values
    return found


def _signs(own: _Joined, other: _Joined) -> Floats:
    """Whether each step costs less (-1), the same but for rounding (0), or more (1)."""
    small = np.abs(own.total - other.total) <= EQUAL * np.maximum(own.total, other.total)
    return np.where(small, 0.0, np.sign(own.total - other.total))


def _mean(brackets: Sequence[Interval]) -> Interval:
    return Interval(
        lower=float(np.mean([bracket.lower for bracket in brackets])),
        upper=float(np.mean([bracket.upper for bracket in brackets])),
    )
