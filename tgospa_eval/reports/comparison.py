"""Documents of `compare` in the formats that are printed. Computes nothing that is not in them."""

from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.ranking import estimates_columns, estimates_document, estimates_paper
from tgospa_eval.reports.records import Comparison
from tgospa_eval.reports.solvers import solvers_columns, solvers_document
from tgospa_eval.reports.study import study_columns, study_document
from tgospa_eval.reports.tables import Document, as_latex, as_markdown, as_text
from tgospa_eval.results.records import Columns, json_text


def render(document: Comparison, format: str) -> str:
    """What ``--format`` prints."""
    if format == "json":
        return json_text(document)
    if format == "csv":
        return csv_text(_columns(document))
    if format == "latex":
        return as_latex(_document(document, paper=True))
    return (as_text if format == "table" else as_markdown)(_document(document))


def _columns(record: Comparison) -> Columns:
    """The main table."""
    if record["kind"] == "solvers":
        return solvers_columns(record)
    return estimates_columns(record) if record["kind"] == "estimates" else study_columns(record)


def _document(record: Comparison, *, paper: bool = False) -> Document:
    """What people read, or what goes into a paper."""
    if record["kind"] == "solvers":
        return solvers_document(record)
    if record["kind"] == "study":
        return study_document(record)
    return estimates_paper(record) if paper else estimates_document(record)
