"""What people read of results; by format what ``--format`` prints."""

from collections.abc import Callable

from tgospa_eval.reports.rendering import WRITERS, csv_text
from tgospa_eval.reports.result_text import document, table
from tgospa_eval.results.evaluation import Evaluation

REPORTS: dict[str, Callable[[Evaluation], str]] = {
    "table": table,
    "json": Evaluation.to_json,
    "csv": lambda result: csv_text(result.table("per_step")),
    "markdown": lambda result: WRITERS["markdown"](document(result)),
    "latex": lambda result: WRITERS["latex"](document(result)),
}
"""Of a result, by format; a member needs a line in the docs."""
