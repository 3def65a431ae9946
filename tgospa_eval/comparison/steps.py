"""Costs of estimates step by step, and their differences."""

from collections.abc import Sequence

import numpy as np

from tgospa_eval.common.brackets import EQUAL
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.comparison.entrants import Entrant, Outcome
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.records import RULES
from tgospa_eval.results.records import PARTS, Columns, Time
from tgospa_eval.tracks.alignment import Times

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
            own, other = joined(item, first)
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
class Joined:
    """Costs by name on the steps of two outcomes; 0 at those that one has not."""

    times: list[Time]
    costs: dict[str, Floats]

    @property
    def total(self) -> Floats:
        """Cost of each step."""
        total: Floats = sum((self.costs[name] for name in PARTS), np.zeros(len(self.times)))
        return total


def joined(first: Outcome, second: Outcome) -> tuple[Joined, Joined]:
    """Costs of both on the steps of either."""
    moments = np.union1d(first.moments, second.moments)
    times: dict[int, Time] = {}
    for item in (second, first):
        times |= zip(np.searchsorted(moments, item.moments).tolist(), item.times, strict=True)
    shown = [times[k] for k in range(len(moments))]
    own, other = (_spread(item, moments) for item in (first, second))
    return Joined(times=shown, costs=own), Joined(times=shown, costs=other)


def _spread(item: Outcome, moments: Times) -> dict[str, Floats]:
    """Costs by name, and the values of other rules, at these steps."""
    at = np.searchsorted(moments, item.moments)
    found: dict[str, Floats] = {}
    for name, values in (item.steps | (item.against.values if item.against else {})).items():
        found[name] = np.zeros(len(moments))
        found[name][at] = values
    return found


def signs(own: Joined, other: Joined) -> Floats:
    """Whether each step costs less (-1), the same but for rounding (0), or more (1)."""
    small = np.abs(own.total - other.total) <= EQUAL * np.maximum(own.total, other.total)
    return np.where(small, 0.0, np.sign(own.total - other.total))
