"""Tables of a batch for programs: CSV and JSON."""

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from tgospa_eval.common.interval import Interval
from tgospa_eval.reports.batch_records import BatchTables, Ranking
from tgospa_eval.reports.batch_slices import slices_of_groups
from tgospa_eval.reports.curves import curves_json
from tgospa_eval.reports.files import csv_text
from tgospa_eval.results.records import json_text, records

if TYPE_CHECKING:
    import pandas as pd

STORED = "slices"
"""Column of rows with the slices of each job, as text."""

THRESHOLDS = ".at."
"""In names of columns with a list in each row: a number for each threshold of HOTA."""


def batch_csv(tables: BatchTables) -> str:
    """A row for each job."""
    return csv_text(
        {
            str(name): [value if value == value else None for value in column.tolist()]
            for name, column in tables.rows.items()
            if THRESHOLDS not in str(name) and name != STORED
        }
    )


def batch_json(tables: BatchTables) -> str:
    """Groups, rankings, comparisons, slices, curves and jobs."""
    return json_text(
        {
            "schema": "tgospa-eval/batch/1",
            "by": list(tables.by),
            "groups": _records(tables.groups),
            "ranking": [row for ranking in tables.rankings for row in _ranked(ranking)],
            "comparisons": [row for ranking in tables.rankings for row in _compared(ranking)],
            "notes": list(tables.notes),
            **({"curves": curves_json(tables.curves)} if tables.curves else {}),
            **({"slices": records(slices_of_groups(tables))} if tables.slices else {}),
            "jobs": _records(tables.rows),
        }
    )


def _ranked(ranking: Ranking) -> Iterator[dict[str, object]]:
    """A row for each that is ranked."""
    for item in ranking.entries:
        yield {
            "name": item.name,
            "parameters": dict(ranking.parameters),
            "jobs": ranking.jobs,
            "of_jobs": ranking.all_jobs,
            "place": list(item.place),
            "combined": item.combined.upper,
            "combined_lower": item.combined.lower,
            "per_step": item.per_step.upper,
            "per_step_lower": item.per_step.lower,
            "confidence": _pair(item.confidence),
            "statistical_place": item.statistical_place and list(item.statistical_place),
        }


def _compared(ranking: Ranking) -> Iterator[dict[str, object]]:
    """A row for each pair of them; nothing is concluded where there are too few pairs of jobs."""
    for pair in ranking.comparisons:
        found = pair.inference
        yield {
            "first": pair.first,
            "second": pair.second,
            "parameters": dict(ranking.parameters),
            "jobs": ranking.jobs,
            "pairs": ranking.pairs,
            "verdict": pair.verdict,
            "difference": _pair(pair.difference),
            "lower": found and found.confidence.lower,
            "upper": found and found.confidence.upper,
            "p_value": found and found.p_value,
            "p_holm": found and found.p_holm,
            "significant": found and found.significant,
            "permutations": ranking.permutations,
            "seed": ranking.seed,
        }


def _pair(bounds: Interval | None) -> list[float] | None:
    return None if bounds is None else [bounds.lower, bounds.upper]


def _records(frame: "pd.DataFrame") -> list[dict[str, object]]:
    """The rows as plain values, None for what is not there."""
    return [
        {
            str(name): _plain(str(name), value)
            for name, value in row.items()
            if THRESHOLDS in str(name) or value == value
        }
        for row in frame.to_dict("records")
    ]


def _plain(name: str, value: Any) -> Any:
    if name == STORED:
        return json.loads(value)
    return list(value) if THRESHOLDS in name else value
