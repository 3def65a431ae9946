"""Small tables for papers and pull requests: Markdown and LaTeX."""

from dataclasses import replace

from tgospa_eval.common.words import number
from tgospa_eval.reports import tables as escape
from tgospa_eval.reports.console import (
    SPLIT_WORDS,
    headline,
    repair_notes,
    repair_table,
    similarity_in_words,
)
from tgospa_eval.reports.other_metrics import other_table, similarity
from tgospa_eval.reports.slices import about_slices, slices_table
from tgospa_eval.reports.tables import Row, Table, latex_lines, markdown_lines
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import Summary


def _table(result: Summary) -> Table:
    costs: dict[str, float] = {name: getattr(result, name) for name in PARTS}
    if result.split is not None:
        parts = {f"of which {SPLIT_WORDS[name]}": part for name, part in result.split.items()}
        costs = {"localisation": costs.pop("localisation"), **parts, **costs}
    rows: list[Row] = []
    for name, cost in costs.items():
        count = number(result.counts[name]) if name in result.counts else ""
        share = f"{100 * cost / result.total:.1f}" if result.total > 0 else ""
        rows.append((name, number(cost), share, count))
    rows.append(("total", number(result.total), "100" if result.total > 0 else "", ""))
    return Table(head=("cost", None, "share %", "count"), rows=rows)


def _others(result: Summary) -> list[Table]:
    others = [other_table(result.with_)] if result.with_ else []
    found = result.explained
    repairs = [repair_table(result, found)] if found is not None and found.repairs else []
    return [*others, *map(slices_table, result.sliced), *repairs]


def _notes(result: Summary) -> list[str]:
    slices = about_slices(result.sliced, certified=result.certified)
    found = result.explained
    repairs = () if found is None else repair_notes(found)
    scored = () if result.calibration is None else (f"similarity {similarity_in_words(result)}",)
    return [*scored, *similarity(result.with_), *slices, *repairs]


def _title(result: Summary) -> tuple[str, str]:
    parameters = f"({result.parameters_in_words()})"
    return headline(result), parameters


def markdown(result: Summary) -> str:
    """A Markdown table with the headline above it."""
    title, parameters = _title(result)
    warnings = [f"> {escape.markdown(text)}" for text in result.told]
    tables = ["\n".join(markdown_lines(table)) for table in (_table(result), *_others(result))]
    words = [*map(escape.markdown, _notes(result)), *warnings]
    return "\n\n".join([f"**{escape.markdown(title)}** {parameters}", *tables, *words]) + "\n"


def latex(result: Summary) -> str:
    """A booktabs table with a comment that says how the number was proven."""
    notes = (*result.told, *_notes(result))
    words = map(escape.latex_comment, [" ".join(_title(result)), *notes])
    table, head = _table(result), ("cost", None, "share (%)", "count")
    last, rows = len(table.rows), [*table.rows, ("TGOSPA", number(result.tgospa))]
    table = replace(table, head=head, rows=rows, ruled=(last - 1, last))
    lines = [line for each in (table, *_others(result)) for line in latex_lines(each)]
    return "\n".join([*words, *lines]) + "\n"
