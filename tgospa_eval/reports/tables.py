"""Tables with words around them, as plain text, Markdown or LaTeX. Knows no metric."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tgospa_eval.reports.console import WIDTH, clip
from tgospa_eval.reports.escape import latex, latex_comment, markdown
from tgospa_eval.text import visible

INDENT = "  "
LEAST, MOST = 12, 44
"""Columns that the first cell keeps in a terminal, however wide the others are, and that it takes
to differ from others."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """One table; the first column is text, the others numbers that are formatted already.

    Parameters
    ----------
    head : sequence of str
        Names of the columns.
    rows : sequence of sequences of str
        As many cells each.
    bold : frozenset of (int, int)
        Cells, by row and column, that stand out in Markdown and LaTeX.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    bold: frozenset[tuple[int, int]] = frozenset()


@dataclass(frozen=True, kw_only=True)
class Document:
    """What a report consists of: what it is, one sentence, lines about the problem, tables, notes.

    Parameters
    ----------
    title : str
        The answer, in a sentence.
    lines : sequence of str
        What was compared.
    tables : sequence of Table
        Tables.
    warnings : sequence of str
        What looks wrong with the data; on a terminal it is on stderr already.
    notes : sequence of str
        Sentences below.
    kind : str
        What this is, and how to get what it is not.
    """

    title: str
    lines: Sequence[str]
    tables: Sequence[Table]
    notes: Sequence[str] = ()
    kind: str = ""
    warnings: Sequence[str] = ()


def as_text(document: Document) -> str:
    """For a terminal, 80 columns."""
    blocks = [_wrap(document.kind, "")] if document.kind else []
    blocks.append(
        [*_wrap(document.title, ""), *(part for line in document.lines for part in _wrap(line))]
    )
    blocks += [_text_table(table) for table in document.tables]
    blocks.append([part for line in document.notes for part in _wrap(line)])
    return "\n\n".join("\n".join(map(clip, block)) for block in blocks if block) + "\n"


def as_markdown(document: Document) -> str:
    """For a pull request or a lab book."""
    blocks = [markdown(document.kind)] if document.kind else []
    blocks += [f"**{markdown(document.title)}**", *map(markdown, document.lines)]
    for table in document.tables:
        lines = [_pipes(map(markdown, table.head))]
        lines.append(_pipes(["---", *["---:"] * (len(table.head) - 1)]))
        for k, row in enumerate(table.rows):
            cells = map(markdown, row)
            bold = [(k, at) in table.bold and bool(cell) for at, cell in enumerate(row)]
            lines.append(_pipes(f"**{c}**" if b else c for c, b in zip(cells, bold, strict=True)))
        blocks.append("\n".join(lines))
    blocks += [f"> {markdown(line)}" for line in document.warnings]
    if document.notes:
        blocks.append("\n".join(f"- {markdown(line)}" for line in document.notes))
    return "\n\n".join(blocks) + "\n"


def as_latex(document: Document) -> str:
    """Tables of the package booktabs; the words are comments."""
    words = [
        *filter(None, [document.kind]),
        document.title,
        *document.warnings,
        *document.lines,
        *document.notes,
    ]
    blocks = ["\n".join(map(latex_comment, words))]
    for table in document.tables:
        lines = [rf"\begin{{tabular}}{{l{'r' * (len(table.head) - 1)}}}", r"\toprule"]
        lines += [_ampersands(map(latex, table.head)), r"\midrule"]
        for k, row in enumerate(table.rows):
            cells = map(latex, row)
            bold = [(k, at) in table.bold for at in range(len(row))]
            lines.append(
                _ampersands(
                    rf"\textbf{{{c}}}" if b else c for c, b in zip(cells, bold, strict=True)
                )
            )
        blocks.append("\n".join([*lines, r"\bottomrule", r"\end{tabular}"]))
    return "\n".join(blocks) + "\n"


def _wrap(text: str, indent: str = INDENT) -> list[str]:
    return textwrap.wrap(visible(text), WIDTH, subsequent_indent=indent) or [""]


def _pipes(cells: Any) -> str:
    return f"| {' | '.join(cells)} |"


def _ampersands(cells: Any) -> str:
    row = " & ".join(cells)
    # After the end of a row LaTeX takes a bracket or a star for a setting of that.
    return f"{'{}' if row.startswith(('[', '*')) else ''}{row} \\\\"


def _text_table(table: Table) -> list[str]:
    """Columns as wide as they need.

    The first gives way if a line is too long, as far as its texts remain different; what has no
    place even then goes on below, with the first column again.
    """
    rows = [[visible(cell) for cell in row] for row in (table.head, *table.rows)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(table.head))]
    first = _first_width([row[0] for row in rows], sum(widths[1:]) + 2 * (len(widths) - 1))
    lines: list[str] = []
    for columns in _that_fit(widths, WIDTH - len(INDENT) - first):
        lines += [""] if lines else []
        lines += [
            (
                INDENT
                + _short(row[0], first).ljust(first)
                + "".join(f"  {row[k]:>{widths[k]}}" for k in columns)
            ).rstrip()
            for row in rows
        ]
    return lines


def _first_width(texts: list[str], others: int) -> int:
    """Columns for the first cells beside others: all they need, or what is left, or enough."""
    longest = max(map(len, texts))
    left = WIDTH - len(INDENT) - others
    least = min(LEAST, longest)
    different = len(set(texts))
    while least < longest and len({_short(text, least) for text in texts}) < different:
        least += 1
    return min(longest, max(left, min(least, MOST)))


def _that_fit(widths: list[int], room: int) -> list[list[int]]:
    """The columns after the first in groups that fit; one that is too wide is a group."""
    groups: list[list[int]] = [[]]
    used = 0
    for k, width in enumerate(widths[1:], start=1):
        if groups[-1] and used + 2 + width > room:
            groups.append([])
            used = 0
        groups[-1].append(k)
        used += 2 + width
    return groups


def _short(text: str, width: int) -> str:
    """The end of a name that is too long: paths differ there. A heading "vs NAME" keeps its vs."""
    if len(text) <= width:
        return text
    begin = "vs " if text.startswith("vs ") else ""
    return f"{begin}..." + text[len(text) - width + len(begin) + 3 :]
