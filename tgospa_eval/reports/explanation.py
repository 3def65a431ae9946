"""An explanation as a table. Computes nothing that is not in it."""

import textwrap
from collections.abc import Iterator, Sequence

from tgospa_eval.common.figures import number
from tgospa_eval.common.words import counted, sizes_in_words
from tgospa_eval.reports.console import WORST, headline, part_rows
from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.phrases import parameters_of
from tgospa_eval.reports.records import Metric
from tgospa_eval.reports.tables import (
    INDENT,
    WIDTH,
    Document,
    Table,
    as_latex,
    as_markdown,
    as_text,
)
from tgospa_eval.results.explanation import NOT_ADDITIVE, Explanation, Repair
from tgospa_eval.text import visible

REPAIR_HEAD = ("", "repair", "saves", "share", "TGOSPA then")
LEAST_WORDS = 20
"""Columns of a repair in words, at least."""


def render(found: Explanation, format: str) -> str:
    """What ``--format`` prints."""
    if format == "json":
        return found.to_json()
    if format == "csv":
        return csv_text(found.columns())
    rows = repair_rows(found)
    page = _document(found, list(_folded(rows)) if format == "table" else rows)
    return {"table": as_text, "markdown": as_markdown, "latex": as_latex}[format](page)


def repair_rows(found: Explanation) -> list[tuple[str, str, str, str, str]]:
    """Of each repair its rank, words, what it saves, the share of that, and the metric then."""
    result = found.result
    return [
        (
            str(rank),
            repair.text,
            saving_in_words(found, repair),
            result.share(max(repair.saving_lower, 0.0)),
            number(repair.tgospa),
        )
        for rank, repair in enumerate(found.repairs, 1)
    ]


def saving_in_words(found: Explanation, repair: Repair) -> str:
    """What a repair saves of the total: a number, or the proven range where that is wide."""
    lower, upper = max(repair.saving_lower, 0.0), repair.saving_upper
    if upper - lower <= 2 * found.result.gap * found.result.total:
        return number(repair.saving_upper)
    return f"{number(lower, 4)} to {number(upper, 4)}"


def _document(found: Explanation, rows: Sequence[tuple[str, ...]]) -> Document:
    result = found.result
    return Document(
        title=headline(result),
        lines=[
            parameters_of(_metric(found)),
            sizes_in_words(result.sizes),
            "total " + number(result.total) + ": " + ", ".join(_parts(found)),
            *_worst(found),
        ],
        tables=[Table(head=REPAIR_HEAD, rows=rows, align="llrrr")] if rows else [],
        notes=list(_notes(found)),
        warnings=list(map(str, result.warnings)),
    )


def _metric(found: Explanation) -> Metric:
    used = found.result.parameters
    return {name: used[name] for name in Metric.__annotations__ if name in used}  # type: ignore[return-value]


def _parts(found: Explanation) -> Iterator[str]:
    for name, _, share, _, _ in part_rows(found.result):
        yield f"{name} {share}"


def _worst(found: Explanation) -> Iterator[str]:
    """What costs most."""
    worst = found.result.worst()
    for kind, words in WORST.items():
        if worst[kind]:
            yield f"{words}: {', '.join(map(str, worst[kind]))}"


def _notes(found: Explanation) -> Iterator[str]:
    several = counted(found.tried, "repair")
    if not found.repairs:
        yield f"no repair is known to save anything ({several} tried)"
        return
    yield f"each alone, from proven bounds before and after; {several} tried"
    yield NOT_ADDITIVE


def _folded(rows: Sequence[tuple[str, ...]]) -> Iterator[tuple[str, ...]]:
    """Rows of which the words have as many lines as they need beside the numbers."""
    shown = [tuple(map(visible, row)) for row in (REPAIR_HEAD, *rows)]
    beside = sum(max(len(row[k]) for row in shown) + 2 for k in (2, 3, 4))
    wide = max(WIDTH - len(INDENT) - len(str(len(rows))) - 2 - beside, LEAST_WORDS)
    for row in rows:
        first, *more = textwrap.wrap(visible(row[1]), wide) or [""]
        yield row[0], first, *row[2:]
        yield from (("", line, "", "", "") for line in more)
