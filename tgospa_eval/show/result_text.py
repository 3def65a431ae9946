"""A result in words: text of 80 columns, with colours on a terminal, and documents.

The text is plain ASCII except for the user's own words.
"""

import os
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.arrays import Ints, Mask
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.words import counted, number, sizes_in_words
from tgospa_eval.evaluation.pair import explanation_of
from tgospa_eval.problem.solution import Windows
from tgospa_eval.quoting import ending, option, visible
from tgospa_eval.results.consistency import NEES, band_in_words
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.explanation import NOT_ADDITIVE, Explanation, Repair
from tgospa_eval.results.records import MEAN, PARTS, SPREAD, Columns, OtherMetrics
from tgospa_eval.results.slices import Slice, Slicing, in_order
from tgospa_eval.results.summary import flat, percent
from tgospa_eval.results.summary import rows as summary_rows
from tgospa_eval.show.methods import methods
from tgospa_eval.show.table_text import (
    INDENT,
    PART_HEADS,
    WIDTH,
    WRITERS,
    Document,
    Row,
    Table,
    best_cells,
    clip,
    csv_text,
    fitted,
    parameters_of,
    table_of,
    text_lines,
    wrap,
)

if TYPE_CHECKING:
    from tgospa_eval.sensors import Pairing


# -------------------------------------------------------------------------------------------------
# Tables in addition to the parts of the cost: other metrics, covariances, slices.

PARTS_SHOWN = {
    "hota": ("HOTA", ("DetA", "AssA", "LocA")),
    "clear": ("MOTA", ("MOTP", "CLR_FN", "CLR_FP", "IDSW")),
    "identity": ("IDF1", ("IDP", "IDR")),
    "gospa": ("total", ("localisation", "missed", "false")),
}
"""Main value of each other metric, and the numbers that explain it."""

COMPARED = {
    "hota": ("HOTA", "DetA", "AssA"),
    "clear": ("MOTA", "MOTP", "IDSW"),
    "identity": ("IDF1",),
    "gospa": ("total",),
}
"""Numbers of each other metric in a table of several evaluations."""

SHORT_NAMES = {"CLR_FN": "FN", "CLR_FP": "FP", "localisation": "local.", "total": "GOSPA"}
COUNTS = {"CLR_FN", "CLR_FP", "IDSW"}
COSTS = {"total", "localisation", "missed", "false"}
LOW = {"IDSW", "total"}
"""Numbers in `COMPARED` that are better if they are lower, like TGOSPA."""


def other_table(other: OtherMetrics) -> Table:
    """Return the table of the other metrics of one evaluation, with a row for each metric."""
    rows: list[Row] = []
    for name, (main, parts) in PARTS_SHOWN.items():
        if name in other:
            beside = ", ".join(f"{_short(part)} {other_value(part, other[name])}" for part in parts)
            best = "low" if main in LOW else "high"
            rows.append((_short(main), other_value(main, other[name]), best, beside))
    return Table(head=("other metrics", "value", "best", None), rows=rows, align="lrrl")


def similarity(other: OtherMetrics) -> Iterator[str]:
    """Yield a sentence on the similarity that HOTA, MOTA and IDF1 use; none without these."""
    if "similarity" not in other:
        return
    zero, threshold = other["similarity"]["zero"], other["similarity"]["threshold"]
    matching = " and ".join(PARTS_SHOWN[name][0] for name in ("clear", "identity") if name in other)
    text = "similarity 1 - d" + ("" if zero == 1 else f" / {number(zero)}")
    if matching:
        near = number(zero * (1 - threshold))
        text += f"; for {matching} states match from {threshold:g}: d <= {near}"
    yield text


def grouped_table(
    head: tuple[str, ...],
    names: Sequence[tuple[str, ...]],
    records: Sequence[OtherMetrics],
    rivals: Sequence[Sequence[int]],
) -> Iterator[Table]:
    """Yield a table of the other metrics of several groups; none if no other metric was requested.

    Parameters
    ----------
    head : tuple of str
        Heads of the first columns, which have the names of the rows.
    names : sequence of tuple of str
        Names of each row.
    records : sequence of mappings
        Other metrics of each row.
    rivals : sequence of sequences of int
        Lists of row indices. The rows of each list are compared, and the best values are bold.
    """
    first = records[0] if records else {}
    shown = [(key, part) for key, parts in COMPARED.items() if key in first for part in parts]
    if shown:
        yield Table(
            head=(*head, *(_short(part) for _, part in shown)),
            rows=[
                (*name, *(other_value(part, record[key]) for key, part in shown))
                for name, record in zip(names, records, strict=True)
            ],
            labels=len(head),
            bold=best_cells(
                {
                    len(head) + k: _falls_short(part, [record[key][part] for record in records])
                    for k, (key, part) in enumerate(shown)
                },
                rivals,
            ),
        )


def covariances_table(
    head: tuple[str, ...], names: Sequence[tuple[str, ...]], items: Sequence[Mapping[Any, Any]]
) -> Iterator[Table]:
    """Yield a table of the NEES if all rows have a NEES.

    With some distances, localisation is the sum of a cost of means and a cost of spreads. If all
    rows have these two costs, the table shows them. `head` and `names` are those of
    `grouped_table`. An item has the NEES of a row, and possibly these costs.
    """
    records = [item.get(NEES) or {"mean": None} for item in items]
    if not records or any(record["mean"] is None for record in records):
        return
    columns = dict(zip(head, map(list, zip(*names, strict=True)), strict=True))
    for title, part in (("means", MEAN), ("spreads", SPREAD)):
        if all(item.get(part) is not None and item[part] == item[part] for item in items):
            columns[title] = [number(item[part], 5) for item in items]
    columns["NEES"] = [number(record["mean"], 4) for record in records]
    columns["ideal"] = [str(record["sums"]["components"]) for record in records]
    columns["band"] = [band_in_words(record["lower"], record["upper"], "-") for record in records]
    columns["in 95 %"] = [f"{record['inside']:.1%}" for record in records]
    columns["verdict"] = [record["verdict"] for record in records]
    yield table_of(columns, labels=len(head))


def _falls_short(part: str, values: Sequence[float]) -> list[Interval]:
    """Return a number for each value. The smallest number is the best, as `best_cells` expects it.

    If small values are better, the numbers are the values. If large values are better, the numbers
    are the differences between the largest value and the values.
    """
    worse = values if part in LOW else [max(values) - value for value in values]
    return [Interval(lower=value, upper=value) for value in worse]


def other_records(rows: Iterable[Mapping[Hashable, Any]]) -> Iterator[OtherMetrics]:
    """Yield the other metrics of each row, from its columns such as ``with.hota.HOTA``."""
    for row in rows:
        record: dict[str, dict[str, float]] = {}
        for column, value in ((str(name), value) for name, value in row.items()):
            if column.startswith("with."):
                _, metric, name = column.split(".", 2)
                record.setdefault(metric, {})[name] = value
        yield record


def direction(other: OtherMetrics) -> Iterator[str]:
    """Yield notes on `grouped_table`.

    The notes tell in which columns high values are best, and in which columns low values. They also
    describe the similarity.
    """
    shown = [part for key, parts in COMPARED.items() if key in other for part in parts]
    for end, chosen in (("high", set(shown) - LOW), ("low", LOW.intersection(shown))):
        if chosen:
            yield f"best is {end}: {', '.join(_short(part) for part in shown if part in chosen)}"
    yield from similarity(other)


def other_columns(records: Sequence[OtherMetrics]) -> Columns:
    """Return a table with a row for each record, and a column for each number of its metrics."""
    return {
        f"{key}_{name}": [record[key][name] for record in records]
        for key, record in records[0].items()
        for name in record
    }


def _short(name: str) -> str:
    return SHORT_NAMES.get(name, name)


def other_value(name: str, numbers: Mapping[str, float]) -> str:
    """Format a number of another metric."""
    value = numbers[name]
    if name in COSTS:
        return number(value, 5)
    return f"{value:,.0f}" if name in COUNTS else f"{100 * value:.2f} %"


# -------------------------------------------------------------------------------------------------
# Costs split by attributes.


MAX_LISTED = 20
"""Largest number of slices in a table. If there are more, the costliest are listed."""

SLICE_HEAD = ("states", "total", "share", *PART_HEADS, "followed", "RMSE")


def shown_slices(slicing: Slicing) -> list[Slice]:
    """Return the `MAX_LISTED` costliest slices, in the order of `slicing`."""
    costliest = sorted(slicing.slices, key=lambda one: -one.total)[:MAX_LISTED]
    kept = {id(one) for one in costliest}
    return [one for one in slicing.slices if id(one) in kept]


def slices_table(slicing: Slicing) -> Table:
    """Return a row for each slice: its ground-truth states, costs and share of the total."""
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
        percent(one.detection_rate),
        "-" if one.rmse is None else number(one.rmse, 4),
    ]


def group_tables(
    heads: Sequence[str], groups: Sequence[tuple[tuple[str, ...], Sequence[Slicing]]]
) -> Iterator[Table]:
    """Yield a table for each attribute. The table has a row for each pair of a slice and a group.

    Each of the `groups` has names, and its costs split by each attribute. `heads` are the heads of
    the columns with the names.
    """
    for by in dict.fromkeys(slicing.by for _, slicings in groups for slicing in slicings):
        by_name: dict[str, list[Row]] = {}
        for names, slicings in groups:
            for slicing in slicings:
                for one in shown_slices(slicing) if slicing.by == by else ():
                    cells = _cells(one, slicing.total)[1:]
                    by_name.setdefault(one.name, []).append((one.name, *names, *cells))
        yield Table(
            head=(f"by {by}", *heads, *SLICE_HEAD[1:]),
            rows=[row for name in in_order(by_name) for row in by_name[name]],
            labels=1 + len(heads),
        )


def slices_lines(slicing: Slicing) -> Iterator[str]:
    """Yield the lines of `slices_table` for a terminal."""
    table = slices_table(slicing)
    by, *head = table.head
    yield from map(clip, (f"{INDENT}{by}", *fitted(replace(table, head=("slice", *head)))))


def share(cost: float, total: float) -> str:
    """Format a cost in percent of the total."""
    return f"{100 * cost / total:.1f} %" if total > 0 else "-"


def about_slices(slicings: Sequence[Slicing], *, certified: bool = True) -> Iterator[str]:
    """Yield notes: which attribute puts a cost into a slice, and whether the split is unique.

    A split is not unique if another assignment has the same total but other costs of slices.
    """
    if not slicings:
        return
    yield (
        "slices: states are those of the truth; false targets are sliced by their own attribute, "
        "all other costs by that of the object at the step (for a switch, the later step)"
    )
    if all(slicing.unique for slicing in slicings):
        yield "this split is unique: no other assignment has the same total"
    elif certified:
        yield "another best assignment may split the same total in another way"
    else:
        yield "the split is that of the best assignment found"


SHOWN = 5
COUNTED = {
    "missed": ("object-step without estimate", "object-steps without estimate"),
    "false": ("estimate-step without object", "estimate-steps without object"),
    "switch": ("track switch", "track switches"),
}
"""Units of the counts of parts, in singular and plural."""


SPLIT_WORDS = {
    "localisation_mean": "means",
    "localisation_spread": "spread",
    "expected_localisation": "distances",
    "existence_mismatch": "mismatch",
}
"""Displayed names of the parts into which some distances split localisation."""

WEIGHTED = ("w", "weights of the steps: a cost is multiplied by the weight of its step")

UNCERTAIN = (
    "r, s",
    "probabilities of existence of an object and of an estimate: a missed target costs r c^p/2, "
    "a false one s c^p/2; a pair costs the smaller of r and s times its error, plus the mismatch "
    "|r - s| c^p/2, which is part of localisation. Experimental: the paper does not say that "
    "switches cost the same whatever r and s are",
)


def table(result: Evaluation) -> str:
    """Return the text of a result without colours."""
    shown = ("\n".join(lines) for lines in blocks(result).values() if lines)
    return "\n\n".join(shown) + "\n"


def blocks(result: Evaluation) -> dict[str, list[str]]:
    """Return the lines of each block of the text, by name of the block; some blocks are empty."""
    makers: dict[str, Callable[[Evaluation], Iterable[str]]] = {
        "headline": _headline,
        "meaning": _meaning,
        "parts": _parts,
        "classes": _classes,
        "scale": _scale,
        "summary": _summary,
        "worst": _worst,
        "switches": _switches,
        "curve": _curve,
        "windows": _windows,
        "others": _other_metrics,
        "slices": _slices,
        "repairs": _repairs,
        "footer": _footer,
    }
    return {name: list(map(visible, make(result))) for name, make in makers.items()}


def headline(result: Evaluation) -> str:
    """Return TGOSPA and what is proven about it, in one sentence."""
    return f"{result.claim}, {result.proven}"


def _headline(result: Evaluation) -> Iterator[str]:
    yield from wrap(headline(result), "")
    yield from wrap(result.headline, "")
    yield sizes_in_words(result.sizes)


def meaning(result: Evaluation) -> list[tuple[str, str]]:
    """Return pairs of a name and an explanation: the parameters, and other terms of this result."""
    parameters = result.proof.parameters
    p = parameters.order
    price = _power(parameters.switch_penalty, p)
    cutoff = result.quantity(parameters.cutoff)
    gamma = result.quantity(parameters.switch_penalty)
    return [
        (
            "c",
            f"{cutoff}, cutoff: the largest error of a pair; {_unassigned(result)}",
        ),
        (
            "p",
            f"{p:g}, order: costs are errors to the power p, TGOSPA is the p-th root "
            "of their total",
        ),
        (
            "gamma",
            f"{gamma}, switch penalty: changing to another track costs "
            f"gamma^p = {price}; a change to or from no track costs half",
        ),
        *((WEIGHTED,) if "step_weights" in result.parameters else ()),
        *((UNCERTAIN,) if result.probabilistic else ()),
        *((("ignored", result.exclusions),) if result.exclusions else ()),
    ]


def _unassigned(result: Evaluation) -> str:
    """Return a sentence on the cost of a missed and of a false target."""
    rho = result.proof.parameters.rho
    if rho == 0.5:
        return f"a missed or a false target costs c^p/2 = {number(result.scale / 2)}"
    missed, false = (number(result.scale * price) for price in (1 - rho, rho))
    return (
        f"a missed target costs (1 - rho) c^p = {missed}, a false one rho c^p = {false}, with "
        f"rho = {rho:g}"
    )


def _meaning(result: Evaluation) -> Iterator[str]:
    for name, words in meaning(result):
        yield from wrap(f"  {name:<5} = {words}", " " * 10)


def _power(value: float, order: float) -> str:
    try:
        return number(float(value**order))
    except OverflowError:
        return "more than 1e308"


def part_rows(result: Evaluation) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield the name, cost, share and count of each part, and the unit of the count."""
    for name in PARTS:
        cost = getattr(result, name)
        count = number(result.counts[name]) if name in result.counts else ""
        note = COUNTED[name][count != "1"] if name in COUNTED else ""
        yield name, number(cost), result.share(cost), count, note


def part_table(result: Evaluation, before: str = "of which ") -> Table:
    """Return the table of the four parts and their sum.

    If localisation is split, its parts have rows, too, whose names begin with `before`.
    """
    total = result.total
    rows: list[Row] = [row[:4] for row in part_rows(result)]
    rows[1:1] = [
        (f"{before}{SPLIT_WORDS[name]}", number(part), result.share(part), "")
        for name, part in (result.split or {}).items()
    ]
    rows.append(("total", number(total), result.share(total), ""))
    return Table(head=("part", "cost", "share", "count"), rows=rows)


def _parts(result: Evaluation) -> Iterator[str]:
    table = part_table(result, "  ")
    notes = {name: f"  {note}" for name, *_, note in part_rows(result)}
    notes["total"] = (
        "  = TGOSPA^p" if result.certified else "  = upper bound^p: the optimum may cost less"
    )
    rows = [(*row, notes.get(str(row[0]), "")) for row in table.rows]
    yield from text_lines(replace(table, rows=rows, align="lrrrl", widths=(14, 12, 9, 10, 0)))


def document(result: Evaluation) -> Document:
    """Return the report for Markdown and LaTeX: parts, summary, and all requested additions."""
    parts, repairs = part_table(result), explanation_of(result)
    last = len(parts.rows)
    tgospa = number(result.tgospa)
    if not result.certified:
        tgospa = f"{number(result.lower_bound)} to {tgospa}"
    rows = [
        *parts.rows[:-1],
        ("total", _total(result), *parts.rows[-1][2:]),
        ("TGOSPA", tgospa, "", ""),
    ]
    tables = [replace(parts, rows=rows, ruled=(last - 1, last))]
    numbers = [
        (name.removeprefix("summary.").replace(".", " ").replace("_", " "), number(value, 4))
        for name, value in flat(result.summarised.numbers)
    ]
    tables.append(Table(head=("summary", "value"), rows=numbers))
    tables += [other_table(result.with_)] if result.with_ else []
    tables += map(slices_table, result.slicings)
    tables += [repair_table(result, repairs)] if repairs is not None and repairs.repairs else []
    scored = () if result.calibration is None else (f"similarity {similarity_in_words(result)}",)
    return Document(
        title=headline(result),
        lines=[result.headline, result.parameters_in_words()],
        tables=tables,
        notes=[
            *filter(None, ["; ".join(f"{name} {value}" for name, value, _ in _each(result))]),
            *filter(None, [result.exclusions]),
            *scored,
            *(() if result.nees is None else (f"NEES {result.nees.in_words}",)),
            *similarity(result.with_),
            *about_slices(result.slicings, certified=result.certified),
            *(() if repairs is None else repair_notes(repairs)),
        ],
        warnings=result.messages,
    )


REPORTS: dict[str, Callable[[Evaluation], str]] = {
    "table": table,
    "json": Evaluation.to_json,
    "csv": lambda result: csv_text(result.table("per_step")),
    "markdown": lambda result: WRITERS["markdown"](document(result)),
    "latex": lambda result: WRITERS["latex"](document(result)),
    "siunitx": lambda result: WRITERS["siunitx"](document(result)),
    "methods": methods,
}
"""Function that writes a result, for each value of ``--format``."""


def class_table(result: Evaluation) -> Table | None:
    """Return a table with a row for each class; None if classes are not evaluated separately."""
    columns = result.table("per_class")
    rows = [
        (name or "(blank)", *(number(value, 5) for value in values))
        for name, *values in zip(*columns.values(), strict=True)
    ]
    head = ("class", f"TGOSPA{'' if result.certified else ' <='}", "total", *PART_HEADS)
    return Table(head=head, rows=rows, widths=(15, *[10] * 6)) if columns else None


def _classes(result: Evaluation) -> Iterator[str]:
    table = class_table(result)
    yield from map(clip, text_lines(table) if table else ())


def _each(result: Evaluation) -> Iterator[tuple[str, str, str]]:
    """Yield TGOSPA per step, and TGOSPA per object and step: name, value, divisor of the total."""
    evaluated_on = result.evaluated_on
    if evaluated_on.steps:
        steps = counted(evaluated_on.steps, "step") + _of_truth(result)
        yield "per step", result.each_in_words("tgospa"), steps
        if "per_object" in result.normalised:
            states = counted(evaluated_on.truth_states, "state")
            yield (
                "per object and step",
                result.each_in_words("per_object"),
                f"{states} of the truth",
            )


def _of_truth(result: Evaluation) -> str:
    """Return " of the truth" if the divisor of the total is not the number of evaluated steps."""
    chosen = {"steps", "resample"} & result.parameters.keys()
    differ = result.evaluated_on.steps != result.sizes["steps"]
    return " of the truth" if differ and not chosen else ""


def _scale(result: Evaluation) -> Iterator[str]:
    for name, value, by in _each(result):
        yield from wrap(f"  {name:<19}  {value}  (total / {by})^(1/p)", " " * 23)
    if result.nees is not None:
        yield from wrap(f"  NEES                 {result.nees.in_words}", " " * 23)
    if result.calibration is not None:
        yield f"  similarity           {similarity_in_words(result)}"


def _summary(result: Evaluation) -> Iterator[str]:
    """Yield the lines of the summary."""
    for name, words in summary_of(result):
        yield from wrap(f"  {name:<13}  {words}", " " * 17)


def summary_of(result: Evaluation) -> Iterator[tuple[str, str]]:
    """Yield the rows of the summary: a name, and numbers on tracking in words."""
    quantity = partial(result.quantity, digits=4)
    is_length = result.parameters["distance"] not in ("iou", "mahalanobis")
    # The distances "iou" and "mahalanobis" do not have the unit of the states.
    place = quantity if is_length else partial(number, digits=4)
    dates = isinstance(next(iter(result.labels.times), 0), str)

    def time(value: float) -> str:
        return number(value, 4) + " s" * dates

    return summary_rows(result.summarised.numbers, quantity, place, time)


def similarity_in_words(result: Evaluation) -> str:
    """Return the score of similarity, and for comparison the score of some false targets."""
    score = result.similarity()
    bracket = "" if result.certified else f" to {score.upper_bound:.4f}"
    return (
        f"{score.score:.4f}{bracket}, from 0 to 1; {score.false_targets:g} false targets a step "
        "score "
        f"{score.score_of_false_targets:g}"
    )


def _curve(result: Evaluation) -> Iterator[str]:
    """Yield the normalised curve at a few steps, including the last."""
    table, bounds = result.table("curve"), result.curve_bounds
    if bounds is None or not table["t"]:
        return
    met, size = bounds.met(result.gap), len(table["t"])
    title = f"TGOSPA per step of the steps up to t, for {size} values of t, {_known(met)}"
    yield from wrap(f"{title}; other columns are costs per step", " " * 10)
    count = min(size, 2 * SHOWN)
    shown = np.unique(np.linspace(0, size - 1, count).round().astype(int)).tolist()
    rows = _rooted(table, shown, met, [str(table["t"][k]) for k in shown])
    first = min(max(13, *(len(visible(row[0])) for row in rows)), 19)
    each = 13 if first == 13 else 11  # a wide first column leaves less room
    head, widths = ("up to t", "TGOSPA", *PARTS), (first, 13, 13, each, each, each)
    yield from text_lines(Table(head=head, rows=rows, align="r" * 6, widths=widths))


def _windows(result: Evaluation) -> Iterator[str]:
    """Yield a sentence on all windows, then a table of the worst windows."""
    table, windows = result.table("windows"), result.window_bounds
    if windows is None or not table["t_first"]:
        return
    met, size = windows.met(result.gap), len(table["t_first"])
    known = _known(met) if size > 1 else "proven exact" if met.all() else "an upper bound"
    every = f", one every {windows.every}" if size > 1 else ""
    value = np.array(table["tgospa"])
    middle = f"median {number(float(np.median(value)), 5)}, " if size > SHOWN else ""
    title = f"TGOSPA of {counted(size, 'window')} of {windows.size}{every}: {middle}{known}"
    note = "; windows do not add up; the worst that do not overlap:" if size > 1 else ""
    yield from wrap(f"{title}{note}", " " * 10)
    worst = _disjoint(windows, np.argsort(-value, kind="stable"))
    names = [f"{table['t_first'][k]} to {table['t_last'][k]}" for k in worst]
    rows = _rooted(table, worst, met, names)
    head, widths = ("from t to t", "TGOSPA", *PARTS), (20, 12, 13, 11, 11, 11)
    yield from text_lines(Table(head=head, rows=rows, align="r" * 6, widths=widths))


def _known(met: Mask) -> str:
    """Return "all proven exact", or a text with the number of values that are upper bounds."""
    return "all proven exact" if met.all() else f"{np.count_nonzero(~met)} of them upper bounds"


def _rooted(
    table: Columns, chosen: list[int], met: Mask, names: list[str]
) -> list[tuple[str, ...]]:
    """Return rows of cells: a name, TGOSPA (after "<=" if it is only an upper bound), the parts.

    `chosen` are indices of rows of `table`, and `names` are the names of these rows.
    """
    return [
        (
            name,
            ("" if met[k] else "<= ") + number(table["tgospa"][k], 5),
            *(number(table[part][k], 5) for part in PARTS),
        )
        for k, name in zip(chosen, names, strict=True)
    ]


def _disjoint(spans: Windows, order: Ints) -> list[int]:
    """Return the indices of the first `SHOWN` windows in this order that share no step."""
    kept: list[int] = []
    for k in order.tolist():
        if all(spans.last[k] < spans.first[j] or spans.first[k] > spans.last[j] for j in kept):
            kept.append(k)
        if len(kept) == SHOWN:
            break
    return kept


def _other_metrics(result: Evaluation) -> Iterator[str]:
    if not result.with_:
        return
    yield from map(clip, text_lines(other_table(result.with_)))
    for text in similarity(result.with_):
        yield from wrap(f"  {text}", "  ")


def _slices(result: Evaluation) -> Iterator[str]:
    for slicing in result.slicings:
        yield from slices_lines(slicing)
        yield ""
    for text in about_slices(result.slicings, certified=result.certified):
        yield from wrap(f"  {text}", "  ")


def _repairs(result: Evaluation) -> Iterator[str]:
    """Yield a table of the repairs with the largest savings, and notes; none if not requested."""
    explanation = explanation_of(result)
    if explanation is None:
        return
    if explanation.repairs:
        yield from text_lines(repair_table(result, explanation))
    yield from (line for note in repair_notes(explanation) for line in wrap(f"  {note}", "  "))


WORST = {"steps": "worst steps", "truth": "worst objects", "estimates": "worst estimates"}


def _worst(result: Evaluation) -> list[str]:
    """Return the names of the worst steps, objects and estimates, on as many lines as needed."""
    worst = result.worst(SHOWN)
    rows = [
        (f"{WORST[kind]:<15}", "  ".join(clip(str(name), WIDTH - 19) for name in worst[kind]))
        for kind in WORST
        if worst[kind]
    ]
    return text_lines(Table(head=rows[0], rows=rows[1:], align="ll", wrapped=(1,))) if rows else []


def _switches(result: Evaluation) -> Iterator[str]:
    """Yield a table of the first switches."""
    switches, count = result.first_switches(SHOWN)
    if not count:
        return
    times = [visible(str(t)) for t in switches["t"]]
    room = WIDTH - 6 - max(27, *map(len, times))  # width of the second column without the colon
    rows = []
    for k, time in enumerate(times):
        ends = (switches[key][k] for key in ("from", "to"))
        names = [switches["truth"][k], *("none" if end is None else end for end in ends)]
        truth, before, after = (ending(visible(str(name)), room) for name in names)
        mass = switches["mass"][k]
        half = "" if mass == 1 else f"  ({number(mass, 3)} of a switch)"
        rows.append((time, f"{truth}: {before} -> {after}{half}"))
    if count > SHOWN:
        rows.append(
            (
                "",
                f"and {count - SHOWN} more ({option('format', 'json')}, or "
                f"{option('output', metavar='DIR', short=True)})",
            )
        )
    head = (f"{'switches':<17}{'t':>10}", "object: from -> to")
    yield from text_lines(Table(head=head, rows=rows, align="rl", wrapped=(1,)))


def _footer(result: Evaluation) -> Iterator[str]:
    solve = result.timings["solve"]
    spent = {
        "read": result.timings["read"],
        "distances": result.timings["distances"],
        "solve": sum(solve.values()),
        "certify": result.timings["certify"],
    }
    parts = "  ".join(f"{name} {seconds:.3f}" for name, seconds in spent.items())
    yield clip(f"  solver           {result.solver['name']}: {result.solver['status']}")
    yield clip(f"  seconds          {parts}")


# -------------------------------------------------------------------------------------------------
# Repairs of an estimate, and the report of `explain`.


def repair_table(result: Evaluation, explanation: Explanation) -> Table:
    """Return a table with a row for each repair."""
    repairs = explanation.repairs
    columns = {
        "": [str(rank) for rank in range(1, len(repairs) + 1)],
        "repair": [repair.text for repair in repairs],
        "saves": [_saving(result, repair) for repair in repairs],
        "share": [result.share(max(repair.saving_lower, 0.0)) for repair in repairs],
        f"TGOSPA {'then' if result.certified else 'at most'}": [
            number(repair.tgospa) for repair in repairs
        ],
    }
    return table_of(columns, align="llrrr", wrapped=(1,))


def _saving(result: Evaluation, repair: Repair) -> str:
    """Format the saving of a repair: a number, or the proven range if it is wide."""
    lower, upper = max(repair.saving_lower, 0.0), repair.saving_upper
    if upper - lower <= 2 * result.gap * result.total:
        return number(repair.saving_upper)
    return f"{number(lower, 4)} to {number(upper, 4)}"


def repair_notes(explanation: Explanation) -> Iterator[str]:
    """Yield notes: the savings are proven, and do not add up."""
    several = counted(explanation.tried, "repair")
    if not explanation.repairs:
        yield f"no repair is proven to save anything ({several} tried)"
        return
    yield f"each saving is for that repair alone, from proven bounds; {several} tried"
    yield NOT_ADDITIVE


def _total(result: Evaluation) -> str:
    """Format the total, or its bounds if it is not exact."""
    total, (lower, _) = number(result.total), result.total_bounds
    return total if result.certified else f"{number(lower)} to {total}"


def explanation_document(explanation: Explanation) -> Document:
    """Return the report of `explain`: the largest costs, and the repairs."""
    result = explanation.result
    parts = ", ".join(f"{name} {share}" for name, _, share, _, _ in part_rows(result))
    worst = result.worst()
    return Document(
        title=headline(result),
        lines=[
            parameters_of(result.parameters),
            sizes_in_words(result.sizes),
            f"total {_total(result)}{'' if result.certified else ', at the upper end'}: {parts}",
            *(
                f"{words}: {', '.join(map(str, worst[kind]))}"
                for kind, words in WORST.items()
                if worst[kind]
            ),
        ],
        tables=[repair_table(result, explanation)] if explanation.repairs else [],
        notes=list(repair_notes(explanation)),
        warnings=result.messages,
    )


# -------------------------------------------------------------------------------------------------
# The text of `table` with colours for a terminal.

BOLD, DIM, GREEN, YELLOW = "1", "2", "32", "33"
PART_LOOKS = {"localisation": "34", "missed": "31", "false": "35", "switch": YELLOW}
"""Codes of the colours of the parts in escape sequences of a terminal."""


def report(result: Evaluation) -> str:
    """Return the text of a result with colours, unless the variable `NO_COLOR` is set."""
    shown = (_styled(result, name, lines) for name, lines in blocks(result).items())
    return "\n\n".join("\n".join(lines) for lines in shown if lines) + "\n"


def _looking(text: str, *codes: str) -> str:
    if not text or not codes or os.environ.get("NO_COLOR"):
        return text
    return f"\x1b[{';'.join(codes)}m{text}\x1b[0m"


def _styled(result: Evaluation, name: str, lines: list[str]) -> list[str]:
    """Add colours to the lines of the block `name`; most blocks have no colours."""
    if name == "headline":
        *claim, sizes = lines
        colour = GREEN if result.certified else YELLOW
        return [*(_looking(line, BOLD, colour) for line in claim), sizes]
    if name == "parts":
        return [_part(result, line) for line in lines]
    return [_looking(line, DIM) for line in lines] if name in ("meaning", "footer") else lines


def _part(result: Evaluation, line: str) -> str:
    name = line.split()[0]
    if name not in PART_LOOKS:
        return _looking(line, BOLD) if name == "total" else line
    weight = () if getattr(result, name) else (DIM,)
    before, after = line.split(name, 1)
    return before + _looking(name, *weight, PART_LOOKS[name]) + _looking(after, *weight)


# -------------------------------------------------------------------------------------------------
# Texts of the commands `associate` and `reduce`.


Spread = dict[str, float]
"""Summary of several numbers: ``min``, ``median`` and ``max``."""

ROWS = 40
"""Default of the largest number of printed rows of a table."""

ROUNDING = 1e-9
"""Largest shift of a mean that counts as a rounding error. It is a fraction of the distance between
the cloud and its reduction."""


def association_text(
    pairing: "Pairing", *, rows: bool = True, limit: int = ROWS, rest: str | None = None
) -> str:
    """Return the text of an association: counts and sum. If `rows`, a table of the pairs follows.

    The table has at most `limit` rows. If there are more, `rest` tells the user where all rows are.
    """
    count, (rest_a, rest_b) = int(pairing.chosen.sum()), pairing.unassigned
    lines = [
        f"{count} associated, {rest_a} of A and {rest_b} of B unassociated, in "
        f"{counted(len(pairing.first.times), 'step')}",
        f"sum {pairing.total:.6g}: distances, plus {pairing.cutoff / 2:g} for each unassociated "
        "state\n",
    ]
    if rows:
        table = list(zip(*pairing.associations_table().values(), strict=True))
        lines += _aligned(("t", "A", "B", "distance", "of means"), table, limit, rest)
    return "\n".join(lines) + "\n"


def reduction_text(counts: Mapping[str, int], change: Mapping[str, Spread | None]) -> str:
    """Return the text about a reduction of clouds.

    `counts` has the numbers of clouds and particles. For each kind of change, `change` has a
    summary over all clouds. Both are fields of the JSON document.
    """
    shown = {
        "Wasserstein distance to the cloud": change["wasserstein"],
        "sliced Wasserstein distance": change["sliced_wasserstein"],
        "shift of the mean": change["mean_shift"],
    }
    rows = [(name, value["median"], value["max"]) for name, value in shown.items() if value]
    lines = [
        f"{counted(counts['clouds'], 'cloud')}, {counted(counts['particles'], 'particle')} -> "
        f"{counts['kept']}\n"
    ]
    if len(rows) > 1 and rows[-1][2] <= ROUNDING * rows[-2][2]:
        lines += [*_aligned(("", "median", "largest"), rows[:-1]), "means kept"]
    else:
        lines += _aligned(("", "median", "largest"), rows)
    kept = change["trace_kept"]
    if kept:
        lines.append(
            f"kept of the trace of the covariance: {100 * kept['median']:.4g} %, at least "
            f"{100 * kept['min']:.4g} %"
        )
    return "\n".join(lines) + "\n"


def _aligned(
    head: Sequence[str],
    rows: Sequence[Sequence[object]],
    limit: int = ROWS,
    rest: str | None = None,
) -> list[str]:
    """Return the lines of a table with the first `limit` rows.

    If there are more, a last line tells their number, and that `rest` has all rows.
    """
    table = Table(head=head, rows=[list(map(_cell, row)) for row in rows[:limit]])
    lines = text_lines(table, "") if rows else []
    if len(rows) > limit:
        where = rest or option("format", "csv")
        lines.append(f"and {len(rows) - limit} more; all of them: {where}")
    return lines


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
