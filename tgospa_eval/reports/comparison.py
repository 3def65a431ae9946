"""Documents of `compare` in the formats that are printed. Computes nothing that is not in them."""

from dataclasses import replace

from tgospa_eval.common.config import SettingsFile
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
    write = {"table": as_text, "markdown": as_markdown, "latex": as_latex}[format]
    page = _document(document, paper=format == "latex")
    if "settings_file" in document:
        used = str(SettingsFile(**document["settings_file"]))
        page = replace(page, warnings=[used, *page.warnings])
    return write(page)


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
