"""The row of an evaluation: what a store keeps of a result, tables add up and a gate judges."""

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from tgospa_eval.results.consistency import STORED_NEES, NeesSums
from tgospa_eval.results.numbers import SPLIT_PARTS
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    import pandas as pd

Row = dict[str, Any]
"""Plain values by column; labels begin with ``label.``."""

LABEL = "label."
"""What the names of columns with labels begin with."""

OFF_STEPS = {role: f"input.{role}.left_out.steps" for role in ("truth", "estimate")}
"""Columns with how many rows of each side are at none of the steps that were declared."""

STORED_SLICES = "slices"
"""Column with costs that are split, as text."""


def row_of(result: Summary) -> Row:
    """The numbers of a result that tables are made of."""
    parameters = result.proof.parameters
    lower, upper = result.total_bounds
    truth, estimates = result.objects
    return {
        "tgospa": result.tgospa,
        "lower_bound": result.lower_bound,
        "upper_bound": result.upper_bound,
        "normalised.tgospa": result.normalised["tgospa"],
        "total": result.total,
        "total_lower": lower,
        "total_upper": upper,
        "certified": result.certified,
        **{name: getattr(result, name) for name in PARTS},
        **{f"counts.{name}": value for name, value in result.counts.items()},
        **{f"sizes.{name}": value for name, value in result.sizes.items()},
        **{f"judged.{name}": value for name, value in result.judged_on.row().items()},
        "sizes.truth_states": truth,
        "sizes.estimate_states": estimates,
        "cutoff": parameters.cutoff,
        "order": parameters.order,
        "switch_penalty": parameters.switch_penalty,
        "distance": str(result.parameters["distance"]),
        "parameters": json.dumps(result.parameters, sort_keys=True),
        **{f"input.{role}.sha256": side["sha256"] for role, side in result.input.items()},
        **{
            name: result.input[role]["left_out"].get("steps", 0) for role, name in OFF_STEPS.items()
        },
        **result.other_numbers,
        **result.split_parts,
        **({} if result.nees is None else result.nees.row()),
        **{f"with.{name}": value for name, value in result.sums.items()},
    }


def covariances_of(rows: "pd.DataFrame") -> tuple[dict[str, float], NeesSums | None]:
    """Sums of the parts of localisation, and of NEES, of rows that all have them."""
    parts = [name for name in SPLIT_PARTS if name in rows and rows[name].notna().all()]
    each = [NeesSums.of_row({STORED_NEES: text}) for text in rows.get(STORED_NEES, ())]
    nees = NeesSums.joined(filter(None, each)) if all(each) else None
    return {name: float(rows[name].sum()) for name in parts}, nees


def stored_slices(result: Summary) -> dict[str, str]:
    """What the row of a job has of its slices."""
    if not result.sliced:
        return {}
    return {STORED_SLICES: json.dumps([one.record() for one in result.sliced])}


def labels_of(row: Mapping[Any, Any]) -> dict[str, str]:
    """What a job is told from others by: its labels, and options of its own."""
    labels = {
        str(name).removeprefix(LABEL): str(value)
        for name, value in row.items()
        if str(name).startswith(LABEL)
    }
    own = [f"{key}={value}" for key, value in json.loads(row["options"]).items()]
    return labels | ({"options": " ".join(own)} if own else {})


def job_name(row: Mapping[Any, Any]) -> str:
    """A job in words: labels, or else its estimate, and options of its own.

    So a suite calls it whose fields are these labels.
    """
    labels = labels_of(row)
    own = labels.pop("options", "")
    return " ".join(filter(None, ("/".join(labels.values()) or str(row["estimate"]), own)))
