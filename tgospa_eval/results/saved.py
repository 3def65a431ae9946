"""Strict reading of saved results from JSON, and tests whether two can be compared."""

import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Floats, Mask
from tgospa_eval.common.documents import (
    ANYTHING,
    COST,
    COUNT,
    FLAG,
    NUMBER,
    POSITIVE,
    TEXT,
    TIME,
    Closed,
    FieldKind,
    Maybe,
    fault,
    or_null,
    read_document,
)
from tgospa_eval.errors import InputError
from tgospa_eval.quoting import option
from tgospa_eval.results.consistency import NEES, NeesSums, fits_sums
from tgospa_eval.results.evaluation import BRACKET, RESULT_SCHEMA
from tgospa_eval.results.records import COUNTED_PARTS, PARTS, SPLIT_PARTS, Json
from tgospa_eval.results.slices import OLDER_NUMBERS
from tgospa_eval.results.summary import SUMMARY

# -------------------------------------------------------------------------------------------------
# Check that stored numbers fit each other, in saved results, stores of batches and baselines.
#
# A rule relates numbers: for example, a total must be the sum of its parts. Names of numbers are
# those in the JSON of a result, with a dot between levels. A rule is skipped if one of its numbers
# is missing. Tolerances allow for the rounding of sums and roots.

AGREE, ADD_UP = 1e-9, 1e-6
"""Relative tolerances: of numbers that must be equal, and of sums."""

TINY = 1e-300
"""Absolute tolerance of costs, because doubles below it have fewer digits."""

MAX_SWITCH_PRICE = 2e100
"""Largest cost of a switch in the rules, in units of c^p; higher costs count as this."""

SPLITS = (SPLIT_PARTS[:2], SPLIT_PARTS[2:])
"""Two groups of parts of localisation; each sums to localisation."""

UNLIKE_COUNTS = ("step_weights", "existence")
"""Parameters that make costs no multiples of counts."""

Rule = tuple[str, Mask, Floats, str]
"""Name of the tested number, mask of the rows in which it is right, the number that it must fit,
and words that introduce this number in a message."""


def contradiction(
    values: Mapping[str, Any], parameters: Mapping[str, Any] | None = None
) -> str | None:
    """Describe the first number that breaks a rule; None if all numbers fit.

    Parameters
    ----------
    values : mapping of str to float
        Finite numbers by name.
    parameters : mapping, optional
        Parameters of the metric, as in the JSON of a result.
    """
    parameters = parameters or {}
    names = ("cutoff", "order", "switch_penalty", "rho", "gap")
    known = {name: parameters[name] for name in names if name in parameters}
    is_plain = np.array([not any(name in parameters for name in UNLIKE_COUNTS)])
    table = {name: np.array([value], float) for name, value in (known | dict(values)).items()}
    return next((text for _, text in contradictions(table, is_plain)), None)


def contradictions(table: Mapping[str, Floats], is_plain: Mask) -> Iterator[tuple[int, str]]:
    """Yield, for each rule that is broken, the index of the first wrong row and a description.

    Parameters
    ----------
    table : mapping of str to (N,) float arrays
        Finite numbers by name, with ``cutoff``, ``order`` and ``switch_penalty``.
    is_plain : (N,) bool array
        Mask of the N rows in which costs are multiples of counts.
    """
    with np.errstate(all="ignore"):
        for name, right, other, words in _rules(table, is_plain):
            (wrong,) = np.nonzero(~right)
            if len(wrong):
                row = int(wrong[0])
                value, against = float(table[name][row]), float(other[row])
                yield row, f"{name} is {value:.15g}, but {words} {against:.15g}"


def _rules(table: Mapping[str, Floats], is_plain: Mask) -> Iterator[Rule]:
    yield from _of_bracket(table)
    yield from _of_parts(table)
    yield from _of_steps(table)
    yield from _of_counts(table, is_plain)


def _close(
    table: Mapping[str, Floats],
    name: str,
    other: Floats,
    words: str,
    tolerance: Floats | float = ADD_UP,
) -> Rule:
    """Return the rule that the number `name` equals `other`, up to a relative tolerance."""
    own = table[name]
    right = np.abs(own - other) <= tolerance * own + TINY
    return name, right, other, words


def _of_bracket(table: Mapping[str, Floats]) -> Iterator[Rule]:
    """Yield rules for value, bounds and relative gap, and for the total as a power of the value."""
    order = table["order"]
    rounding = AGREE * order
    for lower, value, upper in (
        ("lower_bound", "tgospa", "upper_bound"),
        ("total_lower", "total", "total_upper"),
    ):
        if lower in table and upper in table:
            yield lower, table[lower] <= table[upper], table[upper], f"{upper} is"
            upper_limit = table[value] * (1 + rounding) + TINY
            yield lower, table[lower] <= upper_limit, table[value], f"{value} is"
            yield _close(table, value, table[upper], f"{upper} is", rounding)
    powers = (("total", "tgospa"), ("total_lower", "lower_bound"), ("total_upper", "upper_bound"))
    for power, root in powers:
        if power in table and root in table:
            words = f"{root} to the power of the order is"
            yield _close(table, power, table[root] ** order, words, rounding)
    if "relative_gap" in table:
        gap, low, high = (table[name] for name in ("relative_gap", "lower_bound", "upper_bound"))
        made = np.where(high > 0, 1 - (low / np.where(high > 0, high, 1)) ** order, 0.0)
        right = np.abs(made - gap) <= rounding
        yield "relative_gap", right, made, "lower_bound and upper_bound make it"
        met = gap <= 2 * np.maximum(table.get("gap", 0 * gap), AGREE)
        right = (table["certified"] == 0) | (table["within_rounding"] == 1) | met
        yield "certified", right, gap, "relative_gap is"


def _of_parts(table: Mapping[str, Floats]) -> Iterator[Rule]:
    """Yield rules for the parts of the total and of localisation; missing parts are NaN."""
    for name, parts in (("total", PARTS), *(("localisation", split) for split in SPLITS)):
        if all(part in table for part in parts):
            made = np.sum([table[part] for part in parts], axis=0)
            made = np.where(np.isnan(made), table[name], made)
            yield _close(table, name, made, f"{', '.join(parts)} sum to")


def _of_steps(table: Mapping[str, Floats]) -> Iterator[Rule]:
    """Yield rules for the costs of the steps, and for the value per step."""
    for name in (*PARTS, "total"):
        if f"per_step.{name}" in table:
            words = f"the numbers of per_step.{name} sum to"
            yield _close(table, name, table[f"per_step.{name}"], words)
    if "judged.steps" in table:
        order, each = table["order"], table["total"] / np.maximum(table["judged.steps"], 1)
        name = "normalised.tgospa"
        # Costs are compared, not their roots, because TINY is a tolerance of costs.
        _, right, _, _ = _close({name: table[name] ** order}, name, each, "", ADD_UP * order)
        yield name, right, each ** (1 / order), "total and judged.steps make it"


def _of_counts(table: Mapping[str, Floats], is_plain: Mask) -> Iterator[Rule]:
    """Yield rules for the counts of missed targets, false targets and switches."""
    scale = table["cutoff"] ** table["order"]
    rho = table.get("rho", np.full(len(scale), 0.5))
    switch = np.minimum(table["switch_penalty"] ** table["order"], MAX_SWITCH_PRICE * scale)
    for name, price in zip(COUNTED_PARTS, (scale * (1 - rho), scale * rho, switch), strict=True):
        count = table.get(f"counts.{name}")
        if count is not None:
            cost = np.where(count == 0, 0, count * price)
            cost = np.where(is_plain | (count == 0), cost, table[name])
            yield _close(table, name, cost, f"counts.{name} makes it")


ROLES = ("truth", "estimate")

ACCURACY = ("solver", "gap", "epsilon", "time_limit")
"""Parameters that change the bracket but not the metric. Runs are allowed to differ in them."""

NEUTRAL = ("unit", "decimal")
"""Parameters that change neither bracket nor metric, but only files and output."""

LARGEST_RESULT = 1 << 32
"""Largest accepted size of a saved result in bytes."""

RESULT_FILE = "result.json"
"""Name of the file of the result in the folder that ``-o`` names."""

FAMILY = RESULT_SCHEMA.rpartition("/")[0] + "/"
MADE_BY = f"a saved result is the {RESULT_FILE} of -o, or what --format json prints"


def of_metric(parameters: Mapping[str, object]) -> dict[str, object]:
    """Return the parameters that change the metric, without `ACCURACY` and `NEUTRAL`."""
    return {n: value for n, value in parameters.items() if n not in (*ACCURACY, *NEUTRAL)}


OF_THE_ESTIMATE = (
    *("estimate_crs", "estimate_scale", "time_offset", "time_scale", "unit_scale", "period"),
)
"""Parameters that convert an estimate. Estimates are allowed to differ in them."""


def unlike(
    own: Mapping[str, object], other: Mapping[str, object]
) -> Iterator[tuple[str, str, str]]:
    """Yield each parameter of the metric that differs: its name, and both values as JSON.

    The unit differs only if both have one.
    """

    def shown(parameters: Mapping[str, object], name: str) -> str:
        there = name in parameters
        return json.dumps(parameters[name], ensure_ascii=False) if there else "not set"

    units = ["unit"] if own.get("unit") and other.get("unit") else []
    for name in sorted([*of_metric({**own, **other}), *units]):
        if own.get(name) != other.get(name):
            yield name, shown(own, name), shown(other, name)


def saved_result(path: str) -> str | None:
    """Return the path of the JSON file of a result; None if there is no result.

    `path` is the file or its folder.
    """
    if os.path.isdir(path):
        path = os.path.join(path, RESULT_FILE)
    if not os.path.isfile(path):  # a pipe cannot be read twice
        return None
    with suppress(OSError), open(path, "rb") as file:  # `read_result` reports such errors
        begin = file.read(64)
        is_object = begin.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{"
        if is_object and f'"{FAMILY}'.encode() in begin + file.read():
            return path
    return None


EVALUATED_ON: dict[str, FieldKind] = {
    "steps": COUNT,
    "steps_sha256": TEXT,
    "truth_states": COUNT,
    "truth_steps": COUNT,
    "truth_sha256": TEXT,
}
"""Schema of the record ``judged``: the data on which values are evaluated."""

PARAMETERS: dict[str, Any] = {
    "cutoff": POSITIVE,
    "order": FieldKind("a finite number >= 1", lambda value: NUMBER.fits(value) and value >= 1),
    "switch_penalty": COST,
    "distance": TEXT,
    "solver": TEXT,
    "rho": Maybe(COST),
    **{name: Maybe(COST) for name in ("gap", "epsilon", "time_limit")},
}
"""Schema of the parameters whose values are used. Other parameters are only compared."""

NOTICE = Closed({"code": TEXT, "text": TEXT, "remedy": TEXT})

NEES_SUMS = Closed(
    {"components": FieldKind("a whole number > 0", lambda value: COUNT.fits(value) and value > 0)}
    | {one.name: COST for one in fields(NeesSums) if one.name not in ("components", "ranks")}
    | {"ranks": [[COST]]}
)
NEES_RECORD = {**dict.fromkeys(("mean", "anees", "inside"), or_null(COST)), "sums": NEES_SUMS}

SLICING = {
    "by": TEXT,
    "unique": FLAG,
    "slices": [{"slice": TEXT, "total": COST, **dict.fromkeys(OLDER_NUMBERS, COST)}],
}

SETTINGS_FILE = Maybe(Closed({"path": TEXT, "named": FLAG, "options": {...: ANYTHING}}))


def _is_summary(value: Any) -> bool:
    """Check a value of the summary: number, flag, null, list of numbers, or dict of these."""
    if isinstance(value, dict):
        return all(map(_is_summary, value.values()))
    if value is None or isinstance(value, bool):
        return True
    return all(map(NUMBER.fits, value if isinstance(value, list) else [value]))


SUMMARY_RECORD = FieldKind(
    "numbers by name", lambda value: isinstance(value, dict) and _is_summary(value)
)

RESULT = {
    **dict.fromkeys((*BRACKET[:5], *PARTS), COST),
    **dict.fromkeys(("certified", "within_rounding"), FLAG),
    "version": TEXT,
    "counts": dict.fromkeys(COUNTED_PARTS, COST),
    "normalised": {"tgospa": COST},
    "parameters": PARAMETERS,
    "judged": EVALUATED_ON,
    "solver": {"status": TEXT, "finished": FLAG},
    "input": {role: {"sha256": TEXT} for role in ROLES},
    "files": dict.fromkeys(ROLES, or_null(TEXT)),
    "per_step": [{"t": TIME, **dict.fromkeys((*PARTS, "total"), COST)}],
    "warnings": [NOTICE],
    **dict.fromkeys(SPLIT_PARTS, Maybe(COST)),
    NEES: Maybe(NEES_RECORD),
    "slices": Maybe([SLICING]),
    SUMMARY: Maybe(SUMMARY_RECORD),
    "with": Maybe({...: {...: NUMBER}}),
}
"""Schema of the fields of a result that are used; ``by_class`` has these fields for each class."""


def read_result(path: str) -> Json:
    """Return the JSON document of a saved result.

    Raises
    ------
    InputError
        The file is not a result, was changed by hand, or has no numbers by step because data in
        parts had too many steps.
    """
    document = read_document(path, RESULT_SCHEMA, {}, remedy=MADE_BY, size=LARGEST_RESULT)
    if "per_step" not in document and "tables" in document:
        raise InputError(
            f"{path}: a result of data in parts with too many steps to rank; evaluate a part of "
            f"the recording with {option('time')}"
        )
    wrong = result_fault(document)
    if wrong:
        raise InputError(f"{path}: {wrong}; evaluate again and save the new result")
    return document


def result_fault(document: Json) -> str | None:
    """Describe the first missing, wrong or contradictory field of a result; None if all fit."""
    wrong = fault(document, RESULT) or fault(document, {"by_class": Maybe({...: RESULT})})
    if wrong:
        return wrong
    names = (*BRACKET, "within_rounding", *PARTS, *(n for n in SPLIT_PARTS if n in document))
    values = {name: document[name] for name in names}
    values |= {f"counts.{name}": document["counts"][name] for name in COUNTED_PARTS}
    values |= {"normalised.tgospa": document["normalised"]["tgospa"]}
    values |= {"judged.steps": document["judged"]["steps"]}
    values |= {
        f"per_step.{name}": added(step[name] for step in document["per_step"])
        for name in (*PARTS, "total")
    }
    wrong = contradiction(values, document["parameters"])
    wrong = wrong or slices_fault(document.get("slices", ()), document)
    if not wrong and NEES in document and not fits_sums(document[NEES]):
        wrong = f"{NEES} does not follow from its sums"
    parts = document.get("by_class", {}).items()
    faults = (
        own and f"by_class.{name}: {own}" for name, part in parts if (own := result_fault(part))
    )
    return wrong or next(faults, None)


def added(values: Iterable[float]) -> float:
    """Sum floats; return infinity if the sum overflows, where `math.fsum` raises an error."""
    return sum(map(float, values))


def slices_fault(slicings: Iterable[Json], whole: Mapping[Any, Any]) -> str | None:
    """Describe the first part of the cost that is not the sum over its slices; None if all are."""
    for number, one in enumerate(slicings):
        for part in PARTS:
            total = added(row[part] for row in one["slices"])
            if not math.isclose(total, whole[part], rel_tol=ADD_UP, abs_tol=TINY):
                return (
                    f"slices[{number}] has {part} costs that sum to {total:.15g}, but {part} is "
                    f"{whole[part]:.15g}"
                )
    return None
