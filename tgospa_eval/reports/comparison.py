"""Documents of `compare` in the formats that are printed. Computes nothing that is not in them."""

from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.phrases import Json
from tgospa_eval.reports.ranking import estimates_columns, estimates_document, estimates_paper
from tgospa_eval.reports.solvers import solvers_columns, solvers_document
from tgospa_eval.reports.study import study_columns, study_document
from tgospa_eval.reports.tables import as_latex, as_markdown, as_text
from tgospa_eval.results.records import json_text


def render(document: Json, format: str) -> str:
    """What ``--format`` prints."""
    if format == "json":
        return json_text(document)
    page, paper, table = PAGES[document["kind"]]
    if format == "csv":
        return csv_text(table(document))
    if format == "latex":
        return as_latex(paper(document))
    return (as_text if format == "table" else as_markdown)(page(document))


PAGES = {
    "solvers": (solvers_document, solvers_document, solvers_columns),
    "estimates": (estimates_document, estimates_paper, estimates_columns),
    "study": (study_document, study_document, study_columns),
}
"""Document, page for a paper, and main table of each kind of document."""
