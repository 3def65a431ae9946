"""Tables beside the parts of the cost: other metrics, covariances, slices. Computes nothing."""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any

from tgospa_eval.common.interval import Interval
from tgospa_eval.common.words import number
from tgospa_eval.results.consistency import NEES, band_in_words
from tgospa_eval.results.numbers import MEAN, SPREAD
from tgospa_eval.results.records import PARTS, Columns, OtherMetrics
from tgospa_eval.results.slices import Slice, Slicing, in_order
from tgospa_eval.show.phrases import PART_HEADS, best_cells
from tgospa_eval.show.rendering import INDENT, WIDTH, Row, Table, clip, table_of, text_lines
from tgospa_eval.text import visible

PARTS_SHOWN = {
    "hota": ("HOTA", ("DetA", "AssA", "LocA")),
    "clear": ("MOTA", ("MOTP", "CLR_FN", "CLR_FP", "IDSW")),
    "identity": ("IDF1", ("IDP", "IDR")),
    "gospa": ("total", ("localisation", "missed", "false")),
}
"""Of each metric the value, and what stands beside it."""

COMPARED = {
    "hota": ("HOTA", "DetA", "AssA"),
    "clear": ("MOTA", "MOTP", "IDSW"),
    "identity": ("IDF1",),
    "gospa": ("total",),
}
"""What a ranking shows of each."""

SHORT_NAMES = {"CLR_FN": "FN", "CLR_FP": "FP", "localisation": "local.", "total": "GOSPA"}
COUNTS = {"CLR_FN", "CLR_FP", "IDSW"}
COSTS = {"total", "localisation", "missed", "false"}
LOW = {"IDSW", "total"}
"""Of what is shown in a ranking: the lower the better, as TGOSPA; all else is the other way."""


def other_table(found: OtherMetrics) -> Table:
    """A row for each metric of one evaluation."""
    rows: list[Row] = []
    for name, (main, parts) in PARTS_SHOWN.items():
        if name in found:
            beside = ", ".join(f"{_short(part)} {_value(part, found[name])}" for part in parts)
            best = "low" if main in LOW else "high"
            rows.append((_short(main), _value(main, found[name]), best, beside))
    return Table(head=("other metrics", "value", "best", None), rows=rows, align="lrrl")


def similarity(found: OtherMetrics) -> Iterator[str]:
    """What HOTA, MOTA and IDF1 compare, a sentence if there is one of them."""
    if "similarity" not in found:
        return
    zero, threshold = found["similarity"]["zero"], found["similarity"]["threshold"]
    matching = " and ".join(PARTS_SHOWN[name][0] for name in ("clear", "identity") if name in found)
    text = "similarity 1 - d" + ("" if zero == 1 else f" / {number(zero)}")
    if matching:
        near = number(zero * (1 - threshold))
        text += f"; for {matching} states match from {threshold:g}: d <= {near}"
    yield text


def grouped_table(
    head: tuple[str, ...],
    names: Sequence[tuple[str, ...]],
    found: Sequence[OtherMetrics],
    rivals: Sequence[Sequence[int]],
) -> Iterator[Table]:
    """A row for each of several records, with the names of each before it, if there are any.

    Of rows that are `rivals` the best values stand out.
    """
    first = found[0] if found else {}
    shown = [(key, part) for key, parts in COMPARED.items() if key in first for part in parts]
    if shown:
        yield Table(
            head=(*head, *(_short(part) for _, part in shown)),
            rows=[
                (*name, *(_value(part, record[key]) for key, part in shown))
                for name, record in zip(names, found, strict=True)
            ],
            labels=len(head),
            bold=best_cells(
                {
                    len(head) + k: _falls_short(part, [record[key][part] for record in found])
                    for k, (key, part) in enumerate(shown)
                },
                rivals,
            ),
        )


def covariances_table(
    head: tuple[str, ...], names: Sequence[tuple[str, ...]], items: Sequence[Mapping[Any, Any]]
) -> Iterator[Table]:
    """Whether covariances say how large errors are, and what they cost; if all say so.

    Items have the costs of means and of spreads, and the record of NEES.
    """
    found = [item.get(NEES) or {"mean": None} for item in items]
    if not found or any(record["mean"] is None for record in found):
        return
    columns = dict(zip(head, map(list, zip(*names, strict=True)), strict=True))
    for title, part in (("means", MEAN), ("spreads", SPREAD)):
        if all(item.get(part) is not None and item[part] == item[part] for item in items):
            columns[title] = [number(item[part], 5) for item in items]
    columns["NEES"] = [number(record["mean"], 4) for record in found]
    columns["ideal"] = [str(record["sums"]["components"]) for record in found]
    columns["band"] = [band_in_words(record["lower"], record["upper"], "-") for record in found]
    columns["in 95 %"] = [f"{record['inside']:.1%}" for record in found]
    columns["verdict"] = [record["verdict"] for record in found]
    yield table_of(columns, labels=len(head))


def _falls_short(part: str, values: Sequence[float]) -> list[Interval]:
    """The least for the best: the values, or how far they are below the largest."""
    worse = values if part in LOW else [max(values) - value for value in values]
    return [Interval(lower=value, upper=value) for value in worse]


def other_records(rows: Iterable[Mapping[Hashable, Any]]) -> Iterator[OtherMetrics]:
    """Other metrics of rows with columns such as ``with.hota.HOTA``."""
    for row in rows:
        record: dict[str, dict[str, float]] = {}
        for column, value in ((str(name), value) for name, value in row.items()):
            if column.startswith("with."):
                _, metric, name = column.split(".", 2)
                record.setdefault(metric, {})[name] = value
        yield record


def direction(found: OtherMetrics) -> Iterator[str]:
    """Which of the columns of a ranking are the better the higher, and what they compare."""
    shown = [part for key, parts in COMPARED.items() if key in found for part in parts]
    for end, chosen in (("high", set(shown) - LOW), ("low", LOW.intersection(shown))):
        if chosen:
            yield f"best is {end}: {', '.join(_short(part) for part in shown if part in chosen)}"
    yield from similarity(found)


def other_columns(found: Sequence[OtherMetrics]) -> Columns:
    """Every number, a column each."""
    return {
        f"{key}_{name}": [record[key][name] for record in found]
        for key, record in found[0].items()
        for name in record
    }


def _short(name: str) -> str:
    return SHORT_NAMES.get(name, name)


def _value(name: str, numbers: Mapping[str, float]) -> str:
    value = numbers[name]
    if name in COSTS:
        return number(value, 5)
    return f"{value:,.0f}" if name in COUNTS else f"{100 * value:.2f} %"


# -------------------------------------------------------------------------------------------------
# Costs split by attributes.


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
            labels=1 + len(heads),
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
