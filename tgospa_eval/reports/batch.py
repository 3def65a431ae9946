"""Tables of a batch as text, Markdown, LaTeX, CSV and JSON."""

import json
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from tgospa_eval.common.figures import number
from tgospa_eval.common.words import counted
from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.other_metrics import direction, grouped_table, other_records
from tgospa_eval.reports.tables import Document, Table, as_latex, as_markdown, as_text
from tgospa_eval.results.records import PARTS, json_text

if TYPE_CHECKING:
    import pandas as pd

NARROW = 1e-9
"""Relative width of a bracket below which one number is shown."""

THRESHOLDS = ".at."
"""In names of columns with a list in each row: a number for each threshold of HOTA."""


def document(rows: "pd.DataFrame", table: "pd.DataFrame", by: Sequence[str]) -> Document:
    """The table by groups, with what it is."""
    failed = int((rows["status"] == "failed").sum()) if len(rows) else 0
    heads = [name for name in table.columns if name in by or name in _PARAMETERS]
    return Document(
        title=f"{counted(len(rows), 'job')}, {failed} failed",
        lines=[],
        tables=[
            Table(
                head=(*heads, "jobs", "combined", "per step", "RMS"),
                rows=[
                    (
                        *(str(row[name]) for name in heads),
                        str(row["jobs"]),
                        *(_between(row, name) for name in ("combined", "per_step", "rms")),
                    )
                    for _, row in table.iterrows()
                ],
                align="l" * len(heads) + "rrrr",
            ),
            Table(
                head=(*heads, "total", "local.", "missed", "false", "switch"),
                rows=[
                    (
                        *(str(row[name]) for name in heads),
                        number(row["total"], 5),
                        *(number(row[name], 5) for name in PARTS),
                    )
                    for _, row in table.iterrows()
                ],
                align="l" * len(heads) + "rrrrr",
            ),
            *_others(table, heads),
        ]
        if len(table)
        else [],
        notes=[
            "combined: (sum of the totals)^(1/p); per step: (that sum / steps)^(1/p); RMS: (mean "
            "of the totals)^(1/p), as of Monte Carlo runs; no mean of roots is taken",
            *_preprocessed(rows),
            *_about_others(table),
        ],
    )


def _others(table: "pd.DataFrame", heads: Sequence[str]) -> Iterator[Table]:
    """Other metrics of the groups, where they were asked for."""
    names = [tuple(str(row[name]) for name in heads) for _, row in table.iterrows()]
    yield from grouped_table(tuple(heads), names, list(other_records(table.to_dict("records"))))


def _preprocessed(rows: "pd.DataFrame") -> Iterator[str]:
    """What was left out before anything was counted."""
    texts = rows["parameters"].dropna().unique() if "parameters" in rows else ()
    for name in sorted({str(json.loads(text).get("preprocess") or "") for text in texts} - {""}):
        yield f"boxes were left out by --preprocess {name} before all metrics"


def _about_others(table: "pd.DataFrame") -> Iterator[str]:
    found = next(other_records(table.to_dict("records")), {})
    if found:
        yield "other metrics are joined as TrackEval joins sequences: counts over all jobs of a row"
        yield from direction(found)


_PARAMETERS = ("distance", "cutoff", "order", "switch_penalty")


def _between(row: "pd.Series[float]", name: str) -> str:
    """A value, or its bracket where that is wide."""
    lower, upper = float(row[f"{name}_lower"]), float(row[f"{name}_upper"])
    if upper - lower <= NARROW * upper:
        return number(float(row[name]))
    return f"{number(lower)} to {number(upper)}"


def _csv(rows: "pd.DataFrame", table: "pd.DataFrame", by: Sequence[str]) -> str:
    del table, by
    return csv_text(
        {
            str(name): [value if value == value else None for value in column.tolist()]
            for name, column in rows.items()
            if THRESHOLDS not in str(name)
        }
    )


def _json(rows: "pd.DataFrame", table: "pd.DataFrame", by: Sequence[str]) -> str:
    return json_text(
        {
            "schema": "tgospa-eval/batch/1",
            "by": list(by),
            "groups": _records(table),
            "jobs": _records(rows),
        }
    )


def _records(frame: "pd.DataFrame") -> list[dict[str, object]]:
    """The rows as plain values, None for what is not there."""
    return [
        {
            str(name): list(value) if THRESHOLDS in str(name) else value
            for name, value in row.items()
            if THRESHOLDS in str(name) or value == value
        }
        for row in frame.to_dict("records")
    ]


def _as(write: Callable[[Document], str]) -> "Report":
    return lambda rows, table, by: write(document(rows, table, by))


Report = Callable[["pd.DataFrame", "pd.DataFrame", Sequence[str]], str]

BATCH_REPORTS: dict[str, Report] = {
    "table": _as(as_text),
    "json": _json,
    "csv": _csv,
    "markdown": _as(as_markdown),
    "latex": _as(as_latex),
}
