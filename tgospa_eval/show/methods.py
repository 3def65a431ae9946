"""Paragraph for a paper: the metric, its parameters, the data and the proven bounds.

Keys of citations are those of the BibTeX in docs/reference/cite.md.
"""

from typing import cast

from tgospa_eval.common.words import counted, number
from tgospa_eval.quoting import visible
from tgospa_eval.results.evaluation import Evaluation

TOOL, METRIC = "tgospa-eval", "garciafernandez2020metric"

MEMBERS = {
    "rho": ("a share rho of c^p for false targets", "garciafernandez2025quasi"),
    "step_weights": ("weights of the steps", "garciafernandez2021timeweighted"),
    "existence": ("probabilities of existence", "xia2025probabilistic"),
}
"""Variants of the metric by the parameter that selects them: description, and key of the paper."""

GRIDS = {
    "union": "at which either side has a state",
    "truth": "of the ground truth",
    "estimate": "of the estimate",
    "common": "at which both sides have states",
}


def methods(result: Evaluation) -> str:
    """Return the paragraph for a paper about this evaluation."""
    left_out = [result.exclusions.capitalize()] if result.exclusions else []
    parts = _metric(result), _data(result), *left_out, _value(result), _origin(result)
    return visible(f"{'. '.join(parts)}.") + "\n"


def _cited(*keys: str) -> str:
    return f"[{'; '.join(f'@{key}' for key in keys)}]"


def _metric(result: Evaluation) -> str:
    settings = result.parameters
    members = [about for name, about in MEMBERS.items() if settings.get(name, 0.5) != 0.5]
    family = f", with {' and '.join(f'{text} {_cited(key)}' for text, key in members)}"
    columns = ", ".join(cast("list[str]", settings["columns"]))
    return (
        "The estimate was compared with the ground truth by the trajectory generalised optimal "
        f"sub-pattern assignment (TGOSPA) metric {_cited(METRIC)}{family * bool(members)}, with "
        f"{result.parameters_in_words(result.labels.unit)}, and the "
        f"{settings['distance']} distance of the states ({columns})"
        + ", separately for each class, and the costs were added"
        * (settings.get("by") == "class")
    )


def _data(result: Evaluation) -> str:
    evaluated_on, sizes, settings = result.judged, result.sizes, result.parameters
    chosen = "steps" in settings or "resample" in settings
    grid = "of a chosen clock" if chosen else GRIDS[str(settings.get("grid", "union"))]
    states = counted(result.evaluated_on.truth_states, "state")
    ends = f", t = {evaluated_on['first']} to {evaluated_on['last']}" if sizes["steps"] else ""
    return (
        f"It was evaluated over the {counted(sizes['steps'], 'step')} {grid}{ends}, with "
        f"{counted(sizes['truth'], 'object')} ({states}) "
        f"and {counted(sizes['estimates'], 'estimated trajectory', 'estimated trajectories')}"
    )


def _value(result: Evaluation) -> str:
    costs = ", ".join(
        f"{name} {number(getattr(result, name), 6)}"
        for name in ("localisation", "missed", "false", "switch")
    )
    return f"{result.claim} ({result.proven}); its costs to the power p are {costs}"


def _origin(result: Evaluation) -> str:
    return (
        f"Values were computed with tgospa-eval {result.version} {_cited(TOOL)}, solver "
        f"{result.solver['name']}, which computes both bounds again from the data after solving"
    )
