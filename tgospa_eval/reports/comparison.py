"""Documents of `compare` in the formats that are printed. Computes nothing that is not in them."""

import json

from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.phrases import Document
from tgospa_eval.reports.ranking import estimates_page, estimates_paper, estimates_table
from tgospa_eval.reports.sheets import as_latex, as_markdown, as_text
from tgospa_eval.reports.solvers import solvers_page, solvers_table
from tgospa_eval.reports.study import study_page, study_table


def json_text(document: Document) -> str:
    """The document with sorted keys; no NaN."""
    return json.dumps(document, sort_keys=True, indent=1, allow_nan=False) + "\n"


def render(document: Document, format: str) -> str:
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
    "solvers": (solvers_page, solvers_page, solvers_table),
    "estimates": (estimates_page, estimates_paper, estimates_table),
    "study": (study_page, study_page, study_table),
}
"""Page, page for a paper, and main table of each kind of document."""
