"""An explanation as a table. Computes nothing that is not in it."""

from collections.abc import Iterator

from tgospa_eval.common.words import number, sizes_in_words
from tgospa_eval.reports.console import WORST, headline, part_rows, repair_notes, repair_table
from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.phrases import parameters_of
from tgospa_eval.reports.tables import Document, as_latex, as_markdown, as_text
from tgospa_eval.results.explanation import Explanation


def render(found: Explanation, format: str) -> str:
    """What ``--format`` prints."""
    if format == "json":
        return found.to_json()
    if format == "csv":
        return csv_text(found.columns())
    page = _document(found, folded=format == "table")
    return {"table": as_text, "markdown": as_markdown, "latex": as_latex}[format](page)


def _document(found: Explanation, *, folded: bool) -> Document:
    result = found.result
    return Document(
        title=headline(result),
        lines=[
            parameters_of(result.parameters),
            sizes_in_words(result.sizes),
            "total " + number(result.total) + ": " + ", ".join(_repair_parts(found)),
            *_worst(found),
        ],
        tables=[repair_table(result, found, folded=folded)] if found.repairs else [],
        notes=list(repair_notes(found)),
        warnings=result.told,
    )


def _repair_parts(found: Explanation) -> Iterator[str]:
    for name, _, share, _, _ in part_rows(found.result):
        yield f"{name} {share}"


def _worst(found: Explanation) -> Iterator[str]:
    """What costs most."""
    worst = found.result.worst()
    for kind, words in WORST.items():
        if worst[kind]:
            yield f"{words}: {', '.join(map(str, worst[kind]))}"
