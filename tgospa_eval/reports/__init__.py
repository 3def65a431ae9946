"""RESULT -> words. A member is one function here, one line in `REPORTS` and a docs line."""

from tgospa_eval.reports.console import table
from tgospa_eval.reports.files import per_step_csv
from tgospa_eval.reports.markup import latex, markdown
from tgospa_eval.results.summary import Summary

REPORTS = {
    "table": table,
    "json": Summary.to_json,
    "csv": per_step_csv,
    "markdown": markdown,
    "latex": latex,
}
"""What ``--format`` prints, by name."""
