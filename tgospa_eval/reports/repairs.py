"""Repairs of an estimate as rows of tables. Computes nothing that is not in them."""

import textwrap
from collections.abc import Iterator, Sequence

from tgospa_eval.common.figures import number
from tgospa_eval.common.words import counted
from tgospa_eval.reports.tables import INDENT, WIDTH, Table
from tgospa_eval.results.repairs import NOT_ADDITIVE, Repair, Repairs
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import visible

REPAIR_HEAD = ("", "repair", "saves", "share", "TGOSPA then")
LEAST_WORDS = 20
"""Columns of a repair in words, at least."""

RepairRow = tuple[str, str, str, str, str]
"""Rank, words, what it saves, the share of that, and the metric then."""


def repair_table(result: Summary, found: Repairs, *, folded: bool = False) -> Table:
    """A row for each repair; folded words have as many lines as they need beside the numbers."""
    rows: list[RepairRow] = repair_rows(result, found)
    widths: tuple[int, ...] = ()
    if folded:
        rows = list(_folded(rows))
        cells = [list(map(visible, row)) for row in (REPAIR_HEAD, *rows)]
        rank, words, *numbers = (max(map(len, column)) for column in zip(*cells, strict=True))
        widths = (rank + 2, words, *(width + 2 for width in numbers))
    return Table(head=REPAIR_HEAD, rows=rows, align="llrrr", widths=widths)


def repair_rows(result: Summary, found: Repairs) -> list[RepairRow]:
    """The cells of each repair."""
    return [
        (
            str(rank),
            repair.text,
            saving_in_words(result, repair),
            result.share(max(repair.saving_lower, 0.0)),
            number(repair.tgospa),
        )
        for rank, repair in enumerate(found.repairs, 1)
    ]


def saving_in_words(result: Summary, repair: Repair) -> str:
    """What a repair saves of the total: a number, or the proven range where that is wide."""
    lower, upper = max(repair.saving_lower, 0.0), repair.saving_upper
    if upper - lower <= 2 * result.gap * result.total:
        return number(repair.saving_upper)
    return f"{number(lower, 4)} to {number(upper, 4)}"


def repair_notes(found: Repairs) -> Iterator[str]:
    """How the savings are known, and that they are not additive."""
    several = counted(found.tried, "repair")
    if not found.repairs:
        yield f"no repair is known to save anything ({several} tried)"
        return
    yield f"each alone, from proven bounds before and after; {several} tried"
    yield NOT_ADDITIVE


def _folded(rows: Sequence[RepairRow]) -> Iterator[RepairRow]:
    shown = [tuple(map(visible, row)) for row in (REPAIR_HEAD, *rows)]
    beside = sum(max(len(row[k]) for row in shown) + 2 for k in (2, 3, 4))
    wide = max(WIDTH - len(INDENT) - len(str(len(rows))) - 2 - beside, LEAST_WORDS)
    for row in rows:
        first, *more = textwrap.wrap(visible(row[1]), wide) or [""]
        yield row[0], first, *row[2:]
        yield from (("", line, "", "", "") for line in more)
