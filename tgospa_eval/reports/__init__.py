"""RESULT -> words. A member is one function here, one line in `REPORTS` and a docs line."""

from tgospa_eval.reports.console import table
from tgospa_eval.results.summary import Summary

# Those of other formats are imported when they are asked for.


def per_step_csv(result: Summary) -> str:
    """The table of costs by step."""
    from tgospa_eval.reports.files import csv_text

    return csv_text(result.table("per_step"))


def markdown(result: Summary) -> str:
    """A small table for pull requests."""
    from tgospa_eval.reports.markup import markdown as made

    return made(result)


def latex(result: Summary) -> str:
    """A small table for papers."""
    from tgospa_eval.reports.markup import latex as made

    return made(result)


REPORTS = {
    "table": table,
    "json": Summary.to_json,
    "csv": per_step_csv,
    "markdown": markdown,
    "latex": latex,
}
"""What ``--format`` prints, by name."""
