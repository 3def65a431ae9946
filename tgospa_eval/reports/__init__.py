"""RESULT -> words. A member is one function here, one line in `REPORTS` and a docs line."""

from tgospa_eval.reports.console import table
from tgospa_eval.reports.files import json_text, per_step_csv
from tgospa_eval.reports.markup import latex, markdown

REPORTS = {
    "table": table,
    "json": json_text,
    "csv": per_step_csv,
    "markdown": markdown,
    "latex": latex,
}
"""What ``--format`` prints, by name."""
