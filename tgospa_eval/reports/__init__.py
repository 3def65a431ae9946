"""What people read of results; by format what ``--format`` prints."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from tgospa_eval.reports.result_text import document, table
from tgospa_eval.reports.tables import WRITERS, Document, csv_text
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    from tgospa_eval.results.explanation import Explanation
    from tgospa_eval.results.sweep import Sweep

REPORTS: dict[str, Callable[[Summary], str]] = {
    "table": table,
    "json": Summary.to_json,
    "csv": lambda result: csv_text(result.table("per_step")),
    "markdown": lambda result: WRITERS["markdown"](document(result)),
    "latex": lambda result: WRITERS["latex"](document(result)),
}
"""Of a result, by format; a member needs a line in the docs."""


def rendered(found: "Explanation | Sweep", format: str, document: Document) -> str:
    """What ``--format`` prints of repairs or of a sweep, of which this is the document."""
    if format == "json":
        return found.to_json()
    return csv_text(found.columns()) if format == "csv" else WRITERS[format](document)
