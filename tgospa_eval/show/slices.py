"""Costs split by attributes as tables: what every report shows of slices."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest

from tgospa_eval.common.words import number
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.slices import Slice, Slicing, in_order
from tgospa_eval.show.phrases import PART_HEADS
from tgospa_eval.show.rendering import INDENT, WIDTH, Row, Table, clip, text_lines
from tgospa_eval.text import visible

MOST_LISTED = 20
"""Slices of a table; of more the costliest are shown."""

LEAST_NAME = 12
"""Columns of a terminal for the name of a slice, at least."""

SLICE_HEAD = ("states", "total", "share", *PART_HEADS)


def shown_slices(slicing: Slicing) -> list[Slice]:
    """The costliest slices, in their order."""
    costliest = sorted(slicing.slices, key=lambda one: -one.total)[:MOST_LISTED]
    kept = {id(one) for one in costliest}
    return [one for one in slicing.slices if id(one) in kept]


def slices_table(slicing: Slicing) -> Table:
    """A row for each slice: states of the truth in it, costs, the share of the whole."""
    total = slicing.total
    shown = shown_slices(slicing)
    rows: list[Row] = [(one.name, *_cells(one, total)) for one in shown]
    left = len(slicing.slices) - len(shown)
    if left:
        rows.append((f"and {left} more",))
    return Table(head=(f"by {slicing.by}", *SLICE_HEAD), rows=rows)


def _cells(one: Slice, total: float) -> list[str]:
    return [
        number(one.truth_steps),
        number(one.total, 5),
        share(one.total, total),
        *(number(getattr(one, part), 4) for part in PARTS),
    ]


def group_tables(
    heads: Sequence[str], groups: Sequence[tuple[tuple[str, ...], Sequence[Slicing]]]
) -> Iterator[Table]:
    """A table for each attribute: of each slice one group below the other.

    Parameters
    ----------
    heads : sequence of str
        What tells groups apart.
    groups : sequence of tuple of str and slicings
        Of each what it is called, and its slices.
    """
    for by in dict.fromkeys(slicing.by for _, slicings in groups for slicing in slicings):
        found: dict[str, list[Row]] = {}
        for names, slicings in groups:
            for slicing in slicings:
                for one in shown_slices(slicing) if slicing.by == by else ():
                    cells = _cells(one, slicing.total)[1:]
                    found.setdefault(one.name, []).append((one.name, *names, *cells))
        yield Table(
            head=(f"by {by}", *heads, *SLICE_HEAD[1:]),
            rows=[row for name in in_order(found) for row in found[name]],
            align="l" * (1 + len(heads)) + "r" * len(SLICE_HEAD[1:]),
        )


def slices_lines(slicing: Slicing) -> Iterator[str]:
    """The same for a terminal: long names have lines of their own."""
    table = slices_table(slicing)
    by, *head = table.head
    columns = zip_longest(("slice", *head), *table.rows, fillvalue="")
    longest, *widths = (max(len(visible(cell or "")) + 2 for cell in column) for column in columns)
    room = max(LEAST_NAME, WIDTH - len(INDENT) - sum(widths))
    shown = replace(table, head=("slice", *head), widths=(min(room, longest - 2), *widths))
    yield from map(clip, (f"{INDENT}{by}", *text_lines(shown)))


def share(cost: float, total: float) -> str:
    """Of the total, in percent."""
    return f"{100 * cost / total:.1f} %" if total > 0 else "-"


def about_slices(slicings: Sequence[Slicing], *, certified: bool = True) -> Iterator[str]:
    """By whose attribute a cost is in a slice, and whether that is the only split."""
    if not slicings:
        return
    yield (
        "slices: states are those of the truth; localisation, misses and switches go by the truth "
        "at the step, of a switch at the later one, false targets by their own attribute"
    )
    if all(slicing.unique for slicing in slicings):
        yield "this split is the only one: no other assignment is as good"
    elif certified:
        yield "parts may tie: another best assignment may split the same total otherwise"
    else:
        yield "the split is that of the assignment that was found"
