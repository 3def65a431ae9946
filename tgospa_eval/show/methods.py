"""Paragraph for a paper: the metric, its parameters, the data and the proven bounds.

The keys of citations are in the BibTeX of docs/reference/cite.md.
"""

from collections.abc import Iterator
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
"""Variants of the metric: name and key of the paper, by the parameter that selects the variant."""

GRIDS = {
    "union": "at which either side has a state",
    "truth": "of the ground truth",
    "estimate": "of the estimate",
    "common": "at which both sides have states",
}

CLAUSES = {
    "interpolate": "the {} was interpolated linearly at the times of the other side",
    "resample": "steps are multiples of {}, at which the ground truth was interpolated linearly",
    "max_gap": "the longest gap between two states is {}",
    "period": "each report of the estimate is valid for {} and was compared at its own time",
    "outage": "the shortest outage of the estimate that counts is {}",
    "time_tolerance": "times at most {} apart are one step",
    "time_offset": "{} was added to the times of the estimate",
    "time_scale": "the times of the estimate were multiplied by {}",
    "unit_scale": "the states of the estimate were multiplied by {}",
    "time": "only times in {} were read",
    "class": "only rows of class {} were read",
    "region": "only states in {} were read",
    "where": "only rows with {} were read",
}
"""Clauses about options that change TGOSPA. An option without a clause is named with its value."""

SAID = ("cutoff", "order", "switch_penalty", "distance", "columns", "grid", "steps", "by", *MEMBERS)
"""Options that other parts of the paragraph describe."""

ROLES = {"truth": "ground truth", "estimate": "estimate"}


def methods(result: Evaluation) -> str:
    """Return the paragraph for a paper about this evaluation."""
    parts = _metric(result), _data(result), *_options(result), _value(result), _origin(result)
    return visible(f"{'. '.join(part[:1].upper() + part[1:] for part in parts)}.") + "\n"


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
    grid, moved = str(settings.get("grid", "union")), settings.get("interpolate")
    if moved and grid == "union":  # the side that is not interpolated gives the steps
        grid = "truth" if moved == "estimate" else "estimate"
    at = "of a chosen clock" if chosen else GRIDS[grid]
    if (moved == "truth" or grid in ("estimate", "common")) and settings.get("outage") != "none":
        at += " and of the ground truth in outages of the estimate" * (not chosen)
    states = counted(result.evaluated_on.truth_states, "state")
    ends = f", t = {evaluated_on['first']} to {evaluated_on['last']}" if sizes["steps"] else ""
    return (
        f"It was evaluated over the {counted(sizes['steps'], 'step')} {at}{ends}, with "
        f"{counted(sizes['truth'], 'object')} ({states}) "
        f"and {counted(sizes['estimates'], 'estimated trajectory', 'estimated trajectories')}"
    )


def _options(result: Evaluation) -> Iterator[str]:
    """Yield clauses on further options that change TGOSPA, and on rows that are left out."""
    from tgospa_eval.results.saved import of_metric  # lazy: it imports json

    clauses = []
    for name, value in of_metric(result.parameters).items():
        if name in SAID or value in (None, False, 0, "error", []):
            continue
        shown = ROLES.get(_shown(value), _shown(value))
        if name == "period" and isinstance([*result.labels.times, 0][0], str):
            shown += " s"
        if value != "none":
            clauses.append(CLAUSES.get(name, f"{name.replace('_', ' ')} = {{}}").format(shown))
        else:
            clauses.append(f"{name}s of the estimate do not count")
    if clauses:
        yield "; ".join(clauses)
    for side, role in ROLES.items():
        if left_out := result.input[side]["left_out"]:
            rows = ", ".join(f"{rows:,} ({rule})" for rule, rows in left_out.items())
            yield f"rows of the {role} that were left out, with the reason: {rows}"
    if result.exclusions:
        yield result.exclusions


def _shown(value: object) -> str:
    """Return the value of an option as a text of the paragraph."""
    if isinstance(value, list):
        return ", ".join(map(_shown, value))
    if isinstance(value, dict):
        return ", ".join(f"{name} {_shown(item)}" for name, item in value.items())
    if isinstance(value, float):
        return getattr(value, "text", f"{value:g}")
    return str(value)


def _value(result: Evaluation) -> str:
    costs = ", ".join(
        f"{name} {number(getattr(result, name), 6)}"
        for name in ("localisation", "missed", "false", "switch")
    )
    whose = "its costs" if result.certified else "of the best assignment found, the costs"
    return f"{result.claim} ({result.proven}); {whose} to the power p are {costs}"


def _origin(result: Evaluation) -> str:
    return (
        f"Values were computed with tgospa-eval {result.version} {_cited(TOOL)}, solver "
        f"{result.solver['name']}, which computes both bounds again from the data after solving"
    )
