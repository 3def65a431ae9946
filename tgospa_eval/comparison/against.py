"""TGOSPA beside per-step GOSPA, plain and with switches charged afterwards.

Two tools charge switches so; their rules are those of `problem.gospa`, their sums are
Stone Soup     (GOSPA_k^2 + gamma^2 n_k^(2/p))^(1/2), the exponent 2 whatever p is
MathWorks      (GOSPA_k^p + gamma^p n_k)^(1/p)
with n_k changes into step k.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.gospa import (
    Changes,
    changes_since_last_step,
    changes_since_last_stored,
    partners,
    per_step_gospa,
)
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.records import RULES, EstimateRecord, PerStepRecord, Rule, RuleRecord
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.result import Result


@dataclass(frozen=True, kw_only=True, eq=False)
class Against:
    """Per-step GOSPA of one pair; values in state units, costs in state units to the power p.

    Parameters
    ----------
    gospa : (T,) float array
        GOSPA of each step, to the power p.
    parts : dict
        Its costs over all steps: localisation, missed, false.
    changes : dict of Changes
        Changes into each step, by rule.
    values : dict of (T,) float arrays
        GOSPA of each step, ``gospa``, and what the tools print for it, by rule.
    differing : (T,) bool array
        Steps whose assignment is not that of TGOSPA.
    """

    gospa: Floats
    parts: dict[str, float]
    changes: dict[str, Changes]
    values: dict[str, Floats]
    differing: NDArray[np.bool_]


def against(result: Result) -> Against:
    """Evaluate each step by itself, on the problem of a result."""
    states, problem = result.proof.states, result.proof.states.problem
    parameters, scale = result.proof.parameters, result.scale
    p = parameters.order
    switch = 2 * scale * parameters.switch_price  # gamma^p, where that is a double
    found = per_step_gospa(problem)
    gospa = scale * found.total
    track = partners(problem, found.entries)
    changes = {
        "stone_soup": changes_since_last_stored(problem, track),
        "mathworks": changes_since_last_step(problem, track),
    }
    value = gospa ** (1 / p)
    paid = {name: switch * count.total for name, count in changes.items()}
    used = states.entry[(states.entry >= 0) & (result.proof.weights > 0)]
    changed = np.setxor1d(used, found.entries)
    differing = np.zeros(problem.steps, bool)
    differing[problem.entry_step[changed]] = True
    return Against(
        gospa=gospa,
        parts={name: scale * float(getattr(found, name).sum()) for name in PARTS[:3]},
        changes=changes,
        values={
            "gospa": value,
            "stone_soup": np.hypot(value, paid["stone_soup"] ** (1 / p)),
            "mathworks": (gospa + paid["mathworks"]) ** (1 / p),
        },
        differing=differing,
    )


def against_document(found: Against, order: float) -> PerStepRecord:
    """The sums over all steps, for the JSON document."""
    return {
        "total": float(found.gospa.sum()),
        "localisation": found.parts["localisation"],
        "missed": found.parts["missed"],
        "false": found.parts["false"],
        "steps_differing": int(found.differing.sum()),
        "stone_soup": _rule_record(found, "stone_soup", order),
        "mathworks": _rule_record(found, "mathworks", order),
    }


def _rule_record(found: Against, rule: Rule, order: float) -> RuleRecord:
    return {
        "switches": float(found.changes[rule].total.sum()),
        "halves": float(found.changes[rule].half.sum()),
        "total": float((found.values[rule] ** order).sum()),
        "mean": float(found.values[rule].mean()) if len(found.gospa) else 0.0,
    }


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
