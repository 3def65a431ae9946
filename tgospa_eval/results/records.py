"""The plain records of a result: tables, labels, costs, and the parts of its JSON document."""

from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.solution import Bounds, Breakdown, PerTrack

Part: TypeAlias = Literal["localisation", "missed", "false", "switch"]
CountedPart: TypeAlias = Literal["missed", "false", "switch"]

COUNTED_PARTS: tuple[CountedPart, ...] = ("missed", "false", "switch")
PARTS: tuple[Part, ...] = ("localisation", *COUNTED_PARTS)
"""The parts of the cost, in the order of every output; those that also have a number."""

Json: TypeAlias = dict[str, Any]
"""A JSON object of plain Python values."""

Columns: TypeAlias = dict[str, list[Any]]
"""Columns by name, all of one length, of plain Python values."""

Time: TypeAlias = int | float | str
"""A step as it was read."""


@dataclass(frozen=True, kw_only=True)
class Labels:
    """What the numbers of steps and tracks are called.

    Parameters
    ----------
    times : list of int, float or str
        Each step as it was read.
    truths, estimates : list of str
        Ids.
    unit : str, optional
        Unit of states and distances.
    """

    times: list[Time]
    truths: list[str]
    estimates: list[str]
    unit: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Costs:
    """What was proven.

    Parameters
    ----------
    parameters : Parameters
        Cutoff, order, switch penalty.
    bounds : Bounds
        The bracket.
    breakdown : Breakdown
        The cost of a feasible assignment by step.
    """

    parameters: Parameters
    bounds: Bounds
    breakdown: Breakdown


OtherMetrics = Mapping[str, Mapping[str, float]]
MetricSums = Mapping[str, float | list[float]]
"""Numbers of other metrics, by metric and name; with the similarity that they compare."""


def input_record(file: Json, sha256: str, off: Mapping[str, int]) -> Json:
    """The record of the file of a side.

    Parameters
    ----------
    file : dict
        Its ``rows`` and ``format``, and rows that do not take part, ``left_out``, by the rule or
        option that left them out.
    sha256 : str
        Digest of what takes part.
    off : mapping of str to int
        Rows at steps that do not count, by option.
    """
    left_out = file["left_out"] | {name: rows for name, rows in off.items() if rows}
    found = {"rows": file["rows"], "left_out": left_out, "sha256": sha256}
    return found | ({"format": file["format"]} if "format" in file else {})


Arrays: TypeAlias = dict[str, NDArray[Any]]
"""Columns by name, all of one length, as arrays."""


def step_columns(split: Breakdown, scale: float) -> Arrays:
    """Cost of each step by kind, and of all; `scale` is c^p."""
    columns = {name: scale * getattr(split, name) for name in PARTS}
    return columns | {"total": sum(columns.values(), np.zeros(len(split.switch)))}


def track_columns(side: int, steps: Ints, costs: PerTrack, scale: float) -> Arrays:
    """What each truth (side 0) or estimate (side 1) costs; `steps` says at how many it exists."""
    kind = ("missed", "false")[side]
    return {
        "steps": steps,
        "localisation": scale * costs.localisation,
        kind: scale * costs.unassigned,
        "switch": scale * costs.switch,
        f"{kind}_count": costs.unassigned_count,
        "switch_count": costs.switch_count,
    }


def as_lists(columns: Arrays) -> Columns:
    """Columns of plain Python values."""
    return {name: column.tolist() for name, column in columns.items()}


def json_text(document: Mapping[str, object]) -> str:
    """A document as JSON: sorted keys, no NaN, full doubles."""
    import json  # lazy: the table does without

    return json.dumps(document, sort_keys=True, allow_nan=False, indent=1) + "\n"


def records(table: Columns) -> list[Json]:
    """The rows of a table."""
    return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
