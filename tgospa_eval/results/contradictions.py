"""The one check of stored numbers: of saved results, rows of stores, and baselines alike.

Names are those of the document of a result, with a dot between levels. A rule whose numbers are
not all there is passed over. Tolerances are those of sums and roots of doubles.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Floats, Mask
from tgospa_eval.results.numbers import SPLIT_PARTS
from tgospa_eval.results.records import COUNTED_PARTS, PARTS

AGREE, ADD_UP = 1e-9, 1e-6
"""Relative tolerances of values that are the same, and of what was summed."""

TINY = 1e-300
"""Costs below this lose their digits."""

MAX_SWITCH_PRICE = 2e100
"""Units of c^p that a switch costs at most."""

SPLITS = (SPLIT_PARTS[:2], SPLIT_PARTS[2:])
"""Parts of localisation that sum to it."""

UNLIKE_COUNTS = ("step_weights", "existence")
"""Parameters with which costs are no multiples of counts."""

Rule = tuple[str, Mask, Floats, str]
"""The number that is judged, where it is right, what it is held against, and what that is."""


def contradiction(
    values: Mapping[str, Any], parameters: Mapping[str, Any] | None = None
) -> str | None:
    """The first number that does not fit the others, in words; None if all fit.

    Parameters
    ----------
    values : mapping of str to float
        Finite numbers by name.
    parameters : mapping, optional
        Of the metric, as a result has them.
    """
    parameters = parameters or {}
    names = ("cutoff", "order", "switch_penalty", "rho", "gap")
    known = {name: parameters[name] for name in names if name in parameters}
    is_plain = np.array([not any(name in parameters for name in UNLIKE_COUNTS)])
    table = {name: np.array([value], float) for name, value in (known | dict(values)).items()}
    return next((text for _, text in contradictions(table, is_plain)), None)


def contradictions(table: Mapping[str, Floats], is_plain: Mask) -> Iterator[tuple[int, str]]:
    """The first row that breaks each rule, and how.

    Parameters
    ----------
    table : mapping of str to (N,) float arrays
        Finite numbers by name, with ``cutoff``, ``order`` and ``switch_penalty``.
    is_plain : (N,) bool array
        Whether costs are multiples of counts.
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
    """A number that is finite must be another one, up to a relative tolerance."""
    own = table[name]
    right = np.abs(own - other) <= tolerance * own + TINY
    return name, right, other, words


def _of_bracket(table: Mapping[str, Floats]) -> Iterator[Rule]:
    """The bounds, the value between them, and its power, the total."""
    order = table["order"]
    rounding = AGREE * order
    for lower, value, upper in (
        ("lower_bound", "tgospa", "upper_bound"),
        ("total_lower", "total", "total_upper"),
    ):
        if lower in table and upper in table:
            yield lower, table[lower] <= table[upper], table[upper], f"{upper} is"
            most = table[value] * (1 + rounding) + TINY
            yield lower, table[lower] <= most, table[value], f"{value} is"
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
    """The parts of the total, and those of localisation, NaN where there are none."""
    for name, parts in (("total", PARTS), *(("localisation", split) for split in SPLITS)):
        if all(part in table for part in parts):
            made = np.sum([table[part] for part in parts], axis=0)
            made = np.where(np.isnan(made), table[name], made)
            yield _close(table, name, made, f"{', '.join(parts)} sum to")


def _of_steps(table: Mapping[str, Floats]) -> Iterator[Rule]:
    """The costs of the steps, and the value of one."""
    for name in (*PARTS, "total"):
        if f"per_step.{name}" in table:
            words = f"the numbers of per_step.{name} sum to"
            yield _close(table, name, table[f"per_step.{name}"], words)
    if "judged.steps" in table:
        order, each = table["order"], table["total"] / np.maximum(table["judged.steps"], 1)
        name = "normalised.tgospa"
        # Of powers, which have no digits less where they are small.
        _, right, _, _ = _close({name: table[name] ** order}, name, each, "", ADD_UP * order)
        yield name, right, each ** (1 / order), "total and judged.steps make it"


def _of_counts(table: Mapping[str, Floats], is_plain: Mask) -> Iterator[Rule]:
    """The numbers of misses, false targets and switches."""
    scale = table["cutoff"] ** table["order"]
    rho = table.get("rho", np.full(len(scale), 0.5))
    switch = np.minimum(table["switch_penalty"] ** table["order"], MAX_SWITCH_PRICE * scale)
    for name, price in zip(COUNTED_PARTS, (scale * (1 - rho), scale * rho, switch), strict=True):
        count = table.get(f"counts.{name}")
        if count is not None:
            cost = np.where(count == 0, 0, count * price)
            cost = np.where(is_plain | (count == 0), cost, table[name])
            yield _close(table, name, cost, f"counts.{name} makes it")
