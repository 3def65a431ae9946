"""Tables and documents as plain text, Markdown, LaTeX, HTML and CSV, independent of metrics."""

import itertools
import re
import textwrap
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import zip_longest
from types import SimpleNamespace
from typing import Any, Literal, TypeVar

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval, places
from tgospa_eval.common.words import PLAIN_DECIMAL, counted, number, sizes_in_words
from tgospa_eval.quoting import clipped, ending, listed, visible
from tgospa_eval.results.records import Columns, Json, members_in_words

T = TypeVar("T")

LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    **{mark: f"\\{mark}" for mark in "&%$#_{}"},
}

LATIN = dict(zip("ΑΒΕΖΗΙΚΜΝΟΡΤΧ", "ABEZHIKMNOPTX", strict=True))
"""Greek capitals that have no command in LaTeX, and the Latin letters that look the same."""

# Regular expressions are compiled when they are used: a small evaluation needs none of them.
_NAMES = r"(?<!\w)@(?=\w)"
"""Pattern of ``@`` before a name in Markdown, by which GitHub would notify a user."""

_LINKS = r":(?=//)|(?<=www)\."
"""Pattern of a character in an address. Markdown makes the address a link if it is not escaped."""

_FORMULA = "'*[-=+@\t\r\n\uff1d\uff0b\uff0d\uff20]"
"""Pattern of texts that a spreadsheet would read as formulas, also with apostrophes before them."""

_NOT_LATIN = "[^\\0-\u024f\u0391-\u03c9\u2010-\u2027]"
"""Letters that pdflatex does not support."""

_NUMBER = r"-?[\d,]+(\.\d+)?"

_NO_XML = "[\ufffe\uffff]"
"""Characters that are not allowed in XML 1.0, not even as character references."""

_XML = '[&<>"]'


def markdown(text: str) -> str:
    """Escape a text for a paragraph, a list or a cell of Markdown."""
    text = visible(text).replace("&", "&amp;").replace("<", "&lt;")
    text = "".join(f"\\{c}" if c in "\\`*_|[]#~$" else c for c in text)
    return re.sub(_NAMES, "@&#8203;", re.sub(_LINKS, lambda match: f"\\{match[0]}", text))


def markdown_code(text: str) -> str:
    """Return a name as code of Markdown that neither notifies a user nor begins a new cell."""
    text = visible(text)
    if not text.strip() or any(mark in text for mark in "`|\\"):
        return f"<code>{''.join(map(_entity, text))}</code>"
    return f"`{text}`"


def _entity(c: str) -> str:
    return c if c.isalnum() or c in " .,;:+%-=()/'\"" else f"&#{ord(c)};"


def latex(text: str) -> str:
    """Escape a text for LaTeX. Greek letters become commands: pdflatex does not set them."""
    return "".join(
        LATEX.get(c) or (_greek(c) if "\u0370" <= c <= "\u03ff" else c) for c in visible(text)
    )


def _greek(letter: str) -> str:
    """Return the command of a Greek letter, or a Latin letter that looks the same."""
    from unicodedata import name  # lazy: few labels are Greek

    kind, _, word = name(letter, "").removeprefix("GREEK ").partition(" LETTER ")
    word = {"LAMDA": "lambda", "FINAL SIGMA": "varsigma"}.get(word, word.lower())
    if not word.isalpha():
        return letter
    if kind != "CAPITAL":
        return "o" if word == "omicron" else rf"\ensuremath{{\{word}}}"
    is_own = word in (
        "gamma",
        "delta",
        "theta",
        "lambda",
        "xi",
        "pi",
        "sigma",
        "upsilon",
        "phi",
        "psi",
        "omega",
    )
    return rf"\ensuremath{{\{word.capitalize()}}}" if is_own else LATIN.get(letter, letter)


def latex_comment(text: str) -> str:
    """Return the text as a comment of LaTeX on one line."""
    return f"% {visible(text)}"


def xml(text: str) -> str:
    """Escape a text, which can have several lines, for an element or an attribute of XML."""
    text = "\n".join(map(visible, text.split("\n")))
    text = re.sub(_NO_XML, lambda match: f"\\u{ord(match[0]):04x}", text)
    return re.sub(_XML, lambda match: f"&#{ord(match[0])};", text).replace("\n", "&#10;")


def workflow_data(text: str) -> str:
    """Escape a text of several lines as the message of a command of GitHub workflows."""
    text = "\n".join(map(visible, text.split("\n")))
    return text.replace("%", "%25").replace("\n", "%0A")


def workflow_property(text: str) -> str:
    """Escape a text as a property of a command of GitHub workflows, such as a file."""
    return workflow_data(visible(text)).replace(":", "%3A").replace(",", "%2C")


def csv_cell(value: object) -> object:
    """Return a value for a CSV table, with an apostrophe before a text that looks like a formula.

    A formula that already has apostrophes before it gets one more. Therefore different texts stay
    different. A program that reads the table can remove one apostrophe before each formula. Numbers
    do not change.
    """
    if (
        isinstance(value, str)
        and re.match(_FORMULA, value)
        and not re.fullmatch(PLAIN_DECIMAL, value)
    ):
        return f"'{value}"
    return value


WIDTH = 80
"""Width of texts for a terminal in characters."""

INDENT = "  "
MIN_NAME_WIDTH, MAX_NAME_WIDTH = 12, 44
"""Limits of the width of the first column in a table that is too wide. If necessary, texts in this
column are shortened to `MIN_NAME_WIDTH` characters. If different texts would then look the same, up
to `MAX_NAME_WIDTH` characters are kept."""

MIN_WORDS = 20
"""Smallest width of a column whose texts are wrapped."""

MAX_SMALL = 9
"""Largest number of columns of a LaTeX table in the size ``small``. Wider tables have the size
``footnotesize``."""

DASHES = {"l": "---", "r": "---:"}
"""Line below the head of a column in Markdown, by its alignment: left or right."""

Row = Sequence[str | None]
"""Cells of a row as text. None is an empty cell. In Markdown and LaTeX, it is written without
blanks."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """Table whose cells are texts, for all formats.

    Parameters
    ----------
    head : sequence of str
        Names of the columns.
    rows : sequence of rows
        Rows of cells. A row can have fewer cells than there are columns.
    align : str
        A letter for each column: ``l`` (left) or ``r`` (right). By default, it is ``l`` for the
        columns of `labels`, and ``r`` for the others.
    labels : int
        Number of columns with the names of the rows. These are the first columns.
    widths : sequence of int
        Widths of the columns in plain text, including the blanks between columns. By default,
        columns are as wide as their cells.
    bold, underlined : frozenset of (int, int)
        Cells, given by the indices of row and column. Those with the best values are bold in
        Markdown, LaTeX and HTML. Those with the second best values are underlined in LaTeX.
    ruled : tuple of int
        Indices of the rows that have a line above them in LaTeX.
    wrapped : collection of int
        Indices of columns that can be wrapped in plain text. A cell continues on further lines if
        the table would be too wide, or if the cell is too wide for its entry in `widths`.
    caption : str
        Caption in LaTeX. A table with a caption is a float.
    is_wide : bool
        Whether the float spans both columns of a page.
    """

    head: Row
    rows: Sequence[Row]
    align: str = ""
    labels: int = 1
    widths: Sequence[int] = ()
    bold: frozenset[tuple[int, int]] = frozenset()
    underlined: frozenset[tuple[int, int]] = frozenset()
    ruled: tuple[int, ...] = ()
    wrapped: Collection[int] = ()
    caption: str = ""
    is_wide: bool = False

    @property
    def sides(self) -> str:
        """Letters of `align`, or its default."""
        return self.align or ("l" * self.labels).ljust(len(self.head), "r")


def table_of(columns: Mapping[str, Sequence[str]], **looks: Any) -> Table:
    """Return a table from its columns by name; `looks` are other fields of `Table`."""
    rows = list(zip(*columns.values(), strict=True))
    return Table(head=tuple(columns), rows=rows, **looks)


@dataclass(frozen=True, kw_only=True)
class Document:
    """Content of a report, for all formats.

    Parameters
    ----------
    title : str
        Main answer in a sentence.
    lines : sequence of str
        Sentences about the data and settings, below the title.
    tables : sequence of Table
        Tables of the report.
    warnings : sequence of str
        Sources of settings, and warnings. The plain text lacks them, because they are printed on
        stderr.
    notes : sequence of str
        Sentences below the tables.
    kind : str
        Sentence on the kind of the report, and commands for other reports.
    """

    title: str
    lines: Sequence[str]
    tables: Sequence[Table]
    notes: Sequence[str] = ()
    kind: str = ""
    warnings: Sequence[str] = ()


def as_text(document: Document) -> str:
    """Return the text of a report for a terminal, in 80 columns."""
    blocks = [wrap(document.kind, "")] if document.kind else []
    blocks.append(
        [*wrap(document.title, ""), *(part for line in document.lines for part in wrap(line))]
    )
    blocks += [fitted(table) for table in document.tables]
    blocks.append([part for line in document.notes for part in wrap(line)])
    return "\n\n".join("\n".join(map(clip, block)) for block in blocks if block) + "\n"


def as_markdown(document: Document) -> str:
    """Return the Markdown of a report, for a pull request or a notebook."""
    blocks = [markdown(document.kind)] if document.kind else []
    blocks += [f"**{markdown(document.title)}**", *map(markdown, document.lines)]
    blocks += ["\n".join(markdown_lines(table, " ")) for table in document.tables]
    blocks += [f"> {markdown(line)}" for line in document.warnings]
    if document.notes:
        blocks.append("\n".join(f"- {markdown(line)}" for line in document.notes))
    return "\n\n".join(blocks) + "\n"


def as_latex(document: Document, *, aligned: bool = False) -> str:
    """Return the tables of a report for the LaTeX package booktabs; all other text is in comments.

    If `aligned`, the package siunitx aligns the digits of numbers.
    """
    words = [document.title, *document.warnings, *document.lines, *document.notes]
    lines = list(map(latex_comment, [document.kind, *words] if document.kind else words))
    tables = ["\n".join(latex_lines(table, aligned=aligned)) for table in document.tables]
    odd = sorted({*re.findall(_NOT_LATIN, "".join(tables))})
    if odd:
        lines.insert(0, latex_comment(f"{' '.join(odd)}: pdflatex stops; lualatex sets them"))
    return "\n\n".join(["\n".join([*lines, *tables[:1]]), *tables[1:]]) + "\n"


def as_html(document: Document) -> str:
    """Return the HTML of a report, for a cell of a notebook."""
    tables = "".join(line for table in document.tables for line in _html_lines(table))
    above, below = (
        "".join(f'<div style="opacity:.75;font-size:.92em">{xml(line)}</div>' for line in lines)
        for lines in ((*document.warnings, *document.lines), document.notes)
    )
    return f'<div style="line-height:1.5"><b>{xml(document.title)}</b>{above}{tables}{below}</div>'


def _html_lines(table: Table) -> Iterator[str]:
    """Yield the lines of a table in HTML."""
    yield '<table style="margin:.5em 0;color:inherit;font-size:inherit;border-spacing:.8em 0">'
    for k, row in enumerate(_cells(table, xml, "<b>{}</b>")):
        kind = "td" if k else "th"
        yield "<tr>"
        for cell, side in zip(row, table.sides, strict=True):
            align = {"l": "left", "r": "right"}[side]
            yield f'<{kind} style="text-align:{align};white-space:nowrap">{cell or ""}</{kind}>'
        yield "</tr>"
    yield "</table>"


WRITERS: Mapping[str, Callable[[Document], str]] = {
    "table": as_text,
    "markdown": as_markdown,
    "latex": as_latex,
    "siunitx": partial(as_latex, aligned=True),
    "html": as_html,
}
"""Function that writes a `Document`, by format. HTML is only for notebooks."""


def rendered(
    format: str,
    subject: T,
    document: Callable[[T], Document],
    json: Callable[[T], str],
    columns: Callable[[T], Columns],
) -> str:
    """Return a subject as text in the format of ``--format``.

    Parameters
    ----------
    format : str
        Key of `WRITERS`, or ``"json"`` or ``"csv"``.
    subject : object
        Object to write, such as a batch.
    document, json, columns : callable
        Functions of the subject that return its `Document`, its JSON and its table for CSV.
    """
    if format == "json":
        return json(subject)
    return csv_text(columns(subject)) if format == "csv" else WRITERS[format](document(subject))


def csv_text(table: Columns) -> str:
    """Return a table as CSV. None becomes an empty field, and numbers have all their digits.

    Texts are changed by `csv_cell`.
    """
    import csv  # lazy: few commands print CSV

    lines: list[str] = []
    # With the line end CR LF, the writer quotes fields with CR or LF. `write` replaces CR LF at the
    # end of each line by LF.
    target = SimpleNamespace(write=lambda line: lines.append(f"{line[:-2]}\n"))
    writer = csv.writer(target, lineterminator="\r\n")
    writer.writerow(map(csv_cell, table))
    writer.writerows(zip(*map(_csv_column, table.values()), strict=True))
    return "".join(lines)


def _csv_column(column: Sequence[object]) -> Sequence[object]:
    """Return a column with `csv_cell` applied to its texts, only once to each different text."""
    if not any(issubclass(kind, str) for kind in set(map(type, column))):
        return column
    cells = {text: csv_cell(text) for text in set(column) if isinstance(text, str)}
    return [cells[value] if isinstance(value, str) else value for value in column]


def text_lines(table: Table, indent: str = INDENT) -> list[str]:
    """Return the lines of a table in plain text.

    Columns are as wide as `Table.widths` says, or as their widest cell. If the first cell of a row
    is longer than its column, it is on a line by itself, above the other cells.
    """
    rows = [[visible(cell or "") for cell in row] for row in (table.head, *table.rows)]
    widths, between = table.widths, ""
    if not widths:
        widths, between = _widths(rows), "  "
        over = len(indent) + sum(widths) + 2 * len(widths) - 2 - WIDTH
        for k in table.wrapped if over > 0 else ():
            room = max(widths[k] - over, MIN_WORDS)
            widths[k] = max(len(line) for row in rows for line in wrap(row[k], "", room))
    signs = ["<" if side == "l" else ">" for side in table.sides]
    forms = [f"{sign}{width}" for sign, width in zip(signs, widths, strict=True)]
    lines: list[str] = []
    for row in rows:
        own_line = len(row[0]) > widths[0]
        lines += [f"{indent}{row[0]}"] if own_line else []
        cells = [
            wrap(cell, "", widths[k] - 2 + len(between)) if k in table.wrapped else [cell]
            for k, cell in enumerate(["", *row[1:]] if own_line else row)
        ]
        for line in zip_longest(*cells, fillvalue=""):
            lines.append(f"{indent}{between.join(map(format, line, forms))}".rstrip())
    return lines


def markdown_lines(
    table: Table, blank: str = "", escape: Callable[[str], str] = markdown
) -> list[str]:
    """Return the lines of a table in Markdown.

    `blank` is put around the dashes below the head, and `escape` is applied to each cell.
    """
    rows = [
        "|" + "".join(" |" if cell is None else f" {cell} |" for cell in row)
        for row in _cells(table, escape, "**{}**")
    ]
    dashes = "|".join(f"{blank}{DASHES[side]}{blank}" for side in table.sides)
    return [rows[0], f"|{dashes}|", *rows[1:]]


def latex_lines(table: Table, *, aligned: bool = False) -> Iterator[str]:
    """Yield the lines of a table in LaTeX; `aligned` is that of `as_latex`."""
    sides, bold = list(table.sides), r"\textbf{{{}}}"
    numeric = [
        k for k, side in enumerate(sides) if aligned and side == "r" and _is_numeric(table, k)
    ]
    for k in numeric:
        numbers = [str(row[k]).replace(",", "").partition(".") for row in table.rows if row[k]]
        whole, part = (max(len(text[at]) for text in numbers) for at in (0, 2))
        sides[k] = f"S[table-format={whole}.{part},detect-weight]"
    kind = "table*" if table.is_wide else "table"
    if table.caption:
        yield from (rf"\begin{{{kind}}}", r"\centering", rf"\caption{{{latex(table.caption)}}}")
        size = "footnotesize" if len(sides) > MAX_SMALL else "small"
        yield rf"\{size}\setlength{{\tabcolsep}}{{3pt}}"
    yield rf"\begin{{tabular}}{{{''.join(sides)}}}"
    yield r"\toprule"
    for k, cells in enumerate(_cells(table, latex, bold, r"\underline{{{}}}"), start=-1):
        for column in numeric:
            cell = cells[column] or ""
            own = table.rows[k][column] if k >= 0 else None
            cells[column] = f"{{{cell}}}" if own is None else _of_siunitx(own, cell)
        if k in table.ruled:
            yield r"\midrule"
        row = " &".join("" if cell is None else f" {cell}" for cell in cells)[1:]
        # LaTeX would read a bracket or a star at the beginning as an option of the row before.
        yield f"{'{}' if row.startswith(('[', '*')) else ''}{row} \\\\"
        if k < 0:
            yield r"\midrule"
    yield r"\bottomrule"
    yield r"\end{tabular}"
    if table.caption:
        yield rf"\end{{{kind}}}"


def _is_numeric(table: Table, column: int) -> bool:
    """Check whether all cells of a column are numbers or empty."""
    cells = [row[column] for row in table.rows if len(row) > column and row[column]]
    return bool(cells) and all(re.fullmatch(_NUMBER, str(cell)) for cell in cells)


def _of_siunitx(text: str, cell: str) -> str:
    """Return a number for a column of siunitx; `cell` is the same number for other columns."""
    plain = text.replace(",", "")
    if cell.startswith(r"\textbf"):
        return rf"\bfseries {plain}"
    return rf"{{\underline{{{plain}}}}}" if cell.startswith(r"\underline") else plain


def _cells(
    table: Table, escape: Callable[[str], str], bold: str, underlined: str = "{}"
) -> Iterator[list[str | None]]:
    """Yield the head and the rows with escaped cells, all of the same length.

    `bold` and `underlined` are format strings for the best and the second best cells.
    """
    looks = dict.fromkeys(table.underlined, underlined) | dict.fromkeys(table.bold, bold)
    for k, row in enumerate((table.head, *table.rows), start=-1):
        forms = (looks.get((k, at), "{}") for at in range(len(row)))
        cells = [cell and form.format(escape(cell)) for cell, form in zip(row, forms, strict=True)]
        yield cells + [None] * (len(table.head) - len(row))


def clip(line: str, width: int = WIDTH) -> str:
    """Shorten a line to the width of a terminal."""
    return clipped(line, width)


def wrap(text: str, indent: str = INDENT, width: int = WIDTH) -> list[str]:
    """Split a text into lines at blanks, with `indent` before each line except the first.

    Invisible characters are escaped. Words are not split at hyphens, which ids can have.
    """
    shown = visible(text)
    return textwrap.wrap(shown, width, subsequent_indent=indent, break_on_hyphens=False) or [""]


def _widths(rows: Sequence[Sequence[str]]) -> list[int]:
    return [max(map(len, column)) for column in zip(*rows, strict=True)]


def fitted(table: Table) -> list[str]:
    """Return the lines of a table in plain text that are not wider than a terminal.

    If the table is too wide, texts of the first column are shortened, but stay different. Columns
    that still do not fit are in further tables below. Each of these repeats the first column. It
    also repeats the other columns with names of rows if they take at most half of the line.

    A table with given widths or wrapped columns is written by `text_lines`, which does not limit
    its width.
    """
    if table.widths or table.wrapped:
        return text_lines(table)
    empty = [""] * len(table.head)
    rows = [
        [visible(cell or "") for cell in [*row, *empty[len(row) :]]]
        for row in (table.head, *table.rows)
    ]
    widths = _widths(rows)
    first = _first_width([row[0] for row in rows], sum(widths[1:]) + 2 * (len(widths) - 1))
    lines: list[str] = []
    room = WIDTH - len(INDENT) - first
    labels = range(1, len(table.sides) - len(table.sides.lstrip("l")))
    taken = sum(2 + widths[k] for k in labels)
    groups = _that_fit(widths, room)
    if labels and len(groups) > 1 and first + taken <= WIDTH // 2:
        other_widths = [widths[0], *widths[labels.stop :]]
        groups = [
            [*labels, *(k + labels.stop - 1 for k in group)]
            for group in _that_fit(other_widths, room - taken)
        ]
    for columns in groups:
        spacing = {k: "  " if table.sides[k] == "l" else "" for k in columns}
        head, *body = [
            [_short(row[0], first), *(spacing[k] + row[k] for k in columns)] for row in rows
        ]
        wide = (first, *(widths[k] + 2 for k in columns))
        align = "".join(table.sides[k] for k in (0, *columns))
        lines += ["", *text_lines(Table(head=head, rows=body, widths=wide, align=align))]
    return lines[1:]


def _first_width(texts: list[str], other_widths: int) -> int:
    """Return the width of the first column, which is the room beside the other columns.

    If there is too little room, it is the smallest width at which different texts stay different,
    but at most `MAX_NAME_WIDTH`. The column is never wider than its longest text.
    """
    longest = max(map(len, texts))
    left = WIDTH - len(INDENT) - other_widths
    width = min(MIN_NAME_WIDTH, longest)
    different = len(set(texts))
    while width < longest and len({_short(text, width) for text in texts}) < different:
        width += 1
    return min(longest, max(left, min(width, MAX_NAME_WIDTH)))


def _that_fit(widths: list[int], room: int) -> list[list[int]]:
    """Divide the columns after the first into groups that fit into `room`.

    A column that is wider than `room` is a group by itself.
    """
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
    """Shorten a text by `ending`. In "vs NAME", only the name is shortened."""
    begin = "vs " if text.startswith("vs ") else ""
    return begin + ending(text[len(begin) :], width - len(begin))


# -------------------------------------------------------------------------------------------------
# Words and numbers that all documents of `compare` use.

PART_HEADS = ("local.", "missed", "false", "switch")
"""Heads of columns for the parts of the cost, short enough for narrow columns."""

Rule = Literal["stone_soup", "mathworks"]

RULES: dict[Rule, str] = {"stone_soup": "Stone Soup", "mathworks": "MathWorks"}
"""For each rule of counting switches after per-step GOSPA: the name of the program that uses it."""

EXACT = 1e-9
"""Relative errors below this are not shown as numbers, because they depend on the machine."""

TO_RANK = "to rank estimates: tgospa-eval compare TRUTH A B"
TO_STUDY = "to compare solvers on one: tgospa-eval compare TRUTH A"
"""Commands for other comparisons, as texts."""

SPLIT_NOTE = (
    "split, not proven: localisation, missed, false and switch are those of the best assignment "
    "found; the bounds are those of TGOSPA and the total"
)


def or_dash(value: float | None, form: str) -> str:
    """Format a number, or write a dash for None."""
    return "-" if value is None else f"{value:{form}}"


def between(low: float, high: float, form: str = ",.6g") -> str:
    """Format an interval: one number if both ends look the same, otherwise both."""
    texts = [f"{end:{form}}" for end in (low, high)]
    return texts[1] if texts[0] == texts[1] else " to ".join(texts)


def error_of(value: float | None) -> str:
    """Format a relative error like 1.2e-05; a dash for None."""
    if value is None:
        return "-"
    return f"<{EXACT:g}" if value < EXACT else f"{value:.1e}"


def columns(
    rows: Sequence[Mapping[str, object]], names: Iterable[str], before: str = ""
) -> Columns:
    """Return the entries `names` of all rows as columns. `before` is added to the column names."""
    return {f"{before}{name}": [row[name] for row in rows] for name in names}


def unit_of(parameters: Mapping[str, Any]) -> str:
    """Return the unit with a blank before it, or an empty text."""
    unit = parameters.get("unit")
    return f" {unit}" if unit else ""


def size_of(sizes: Mapping[str, int]) -> str:
    """Format the size of the problem that a solver gets."""
    return (
        f"{sizes_in_words(sizes)}; {counted(sizes['states'], 'reduced state')} in "
        f"{counted(sizes['components'], 'component')}"
    )


LETTERS = {"cutoff": "c", "order": "p", "switch_penalty": "gamma", "rho": "rho"}
"""Letters of the parameters of the metric."""


def parameters_of(parameters: Mapping[str, Any], end: str = ", ") -> str:
    """Format the given parameters of the metric and the distance, with `end` between them."""
    unit = unit_of(parameters)
    known = ", ".join(
        f"{letter} = {parameters[name]:g}{unit if name in ('cutoff', 'switch_penalty') else ''}"
        for name, letter in LETTERS.items()
        if name in parameters
    )
    return end.join(
        filter(None, [f"{known}{members_in_words(parameters)}", parameters.get("distance", "")])
    )


def about_periods(settings: Iterable[tuple[str, Sequence[Json]]]) -> Iterator[str]:
    """Yield a sentence on the time for which an estimate stays valid (`period`).

    `settings` has pairs of the name of a tracker or group and the settings of its runs. Only runs
    with a common clock have a period.
    """
    texts = []
    for name, runs in settings:
        own = [run["period"] for run in runs if isinstance(run.get("period"), int | float)]
        ends = dict.fromkeys(number(end(own)) for end in (min, max) if own)
        texts += [f"{name} {' to '.join(ends)}"] * bool(ends)
    if texts:
        yield f"period of the reports on the common clock: {listed(texts, MAX_NAMED)}"


# -------------------------------------------------------------------------------------------------
# A proven order in words. A verdict says which order of two values is proven.

ORDERS = {"less": "proven", "equal": "equal", "not separated": "open"}
"""Displayed name of each verdict in tables."""

PROOFS = {
    "less": "proven: the upper bound of one is below the lower bound of the other",
    "equal": "equal: the same data, or proven to differ by less than 1e-9 of the value",
    "not separated": "open: the bounds of both overlap",
}
"""Explanation of each verdict."""


MAX_NAMED = 8
"""Largest number of names in a sentence. A table has all names."""


def first_names(groups: Sequence[Sequence[str]]) -> str:
    """Return the first `MAX_NAMED` names, and the number of the rest.

    The names of a group have equal values. Names in a group are joined by ``=``, and groups are
    joined by commas.
    """
    left, texts = MAX_NAMED, list[str]()
    for group in groups:
        if left > 0:
            texts.append(" = ".join(group[:left]))
        left -= len(group)
    return ", ".join(texts) + (f" and {-left:,} more, all in the table" if left < 0 else "")


def order_in_words(value: str, entries: Sequence[Json], pairs: Sequence[Json]) -> str:
    """Return a sentence on the proven order of all entries, or on the best one.

    Parameters
    ----------
    value : str
        Name of the value that orders the entries.
    entries : sequence of dict
        Entries in the order of the values: each has a ``name`` and its best and worst ``place``.
    pairs : sequence of dict
        All pairs of entries: the names ``first`` and ``second`` in the order of the entries, and
        the proven ``verdict``.
    """
    names = [entry["name"] for entry in entries]
    verdicts = {(pair["first"], pair["second"]): pair["verdict"] for pair in pairs}
    groups = [list(names[:1])]
    for pair in itertools.pairwise(names):
        if verdicts[pair] == "equal":
            groups[-1].append(pair[1])
        else:
            groups.append([pair[1]])
    proven = {
        **dict.fromkeys(itertools.combinations(names, 2), "less"),
        **{pair: "equal" for group in groups for pair in itertools.combinations(group, 2)},
    }
    if verdicts == proven and len(groups) == 1:
        return f"Proven to be equal on these files by {value}: {first_names(groups)}"
    if verdicts == proven:
        return f"Proven order of these files by {value}, best first: {first_names(groups)}"
    best = best_of([entry["place"] for entry in entries])
    if best:
        return (
            f"Proven best by {value}: {first_names([[names[k] for k in best]])}; the order of the "
            "others is not fully proven"
        )
    tied = [[entry["name"]] for entry in entries if entry["place"][0] == 1]
    return f"None is proven best by {value}: it may be any of {first_names(tied)}"


def best_of(ranks: Sequence[Sequence[int]], place: int = 1) -> list[int]:
    """Return the indices of the entries that are proven to have this place. Entries can share it.

    If all entries share the place, the list is empty, because none is better than the others.
    """
    best = [k for k, own in enumerate(ranks) if tuple(own) == (place, place)]
    return best if len(best) < len(ranks) else []


def best_cells(
    columns: Mapping[int, Sequence[Interval]], rivals: Iterable[Sequence[int]], place: int = 1
) -> frozenset[tuple[int, int]]:
    """Return the cells, as indices of row and column, whose values are proven to have this place.

    Parameters
    ----------
    columns : mapping of int to sequence of Interval
        Values of all rows for each column, by the index of the column. The smallest is the best.
    rivals : iterable of sequences of int
        Groups of row indices. Values are compared within each group.
    place : int
        The place, 1 for the best values.
    """
    return frozenset(
        (rows[k], column)
        for rows in rivals
        for column, values in columns.items()
        for k in best_of(places([values[row] for row in rows]), place)
    )


def equal_names(pairs: Iterable[Json]) -> set[str]:
    """Return the names whose values are proven to be equal to the value of another name."""
    equal = [pair for pair in pairs if pair["verdict"] == "equal"]
    return {pair[name] for pair in equal for name in ("first", "second")}


def place_in_words(best: int, worst: int, *, shared: bool = False) -> str:
    """Format possible places: "2-4", or "2" if only one is possible, or "2=" if it is shared."""
    if best < worst:
        return f"{best}-{worst}"
    return f"{best}=" if shared else f"{best}"
