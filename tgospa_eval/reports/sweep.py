"""The document of a sweep of a parameter as a table. Computes nothing that is not in it."""

from collections.abc import Iterator
from typing import Any

from tgospa_eval.common.figures import number
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.reports.files import csv_text
from tgospa_eval.reports.tables import Document, Table, as_latex, as_markdown, as_text
from tgospa_eval.results.records import COUNTED_PARTS, Columns, json_text

Json = dict[str, Any]

LETTERS = {"cutoff": "c", "order": "p", "switch_penalty": "gamma"}


def render(document: Json, format: str, table: Columns) -> str:
    """What ``--format`` prints; `table` are the points as columns."""
    if format == "json":
        return json_text(document)
    if format == "csv":
        return csv_text(table)
    page = sweep_document(document)
    return {"table": as_text, "markdown": as_markdown, "latex": as_latex}[format](page)


def sweep_document(document: Json) -> Document:
    """A row for each value."""
    letter = LETTERS[document["parameter"]]
    exact = document["certified"]
    lower = () if exact else ("lower bound",)
    return Document(
        title=_title(document),
        lines=[_parameters(document), "costs, and in brackets how many of each:"],
        tables=[
            Table(
                head=(letter, *lower, "TGOSPA", "localisation", *COUNTED_PARTS),
                rows=[
                    (
                        number(point["value"]),
                        *(() if exact else (number(point["lower_bound"]),)),
                        number(point["tgospa"]),
                        number(point["localisation"], 5),
                        *(
                            f"{number(point[part], 5)} ({number(point['counts'][part])})"
                            for part in COUNTED_PARTS
                        ),
                    )
                    for point in document["points"]
                ],
            )
        ],
        notes=list(_notes(document)),
        warnings=[str(Notice(**record)) for record in document["warnings"]],
    )


def quantity(value: float, document: Json) -> str:
    """A value of the parameter, with the unit if it has one."""
    unit = document["parameters"]["unit"] if document["parameter"] != "order" else None
    return number(value) + (f" {unit}" if unit else "")


def _title(document: Json) -> str:
    points = document["points"]
    word, letter = document["parameter"].replace("_", " "), LETTERS[document["parameter"]]
    first, last = (quantity(points[k]["value"], document) for k in (0, -1))
    over = f"at {letter} = {first}"
    if len(points) > 1:
        over = f"at {len(points)} values of the {word} from {letter} = {first} to {last}"
    wide = [point for point in points if not point["certified"]]
    if not wide:
        return f"TGOSPA {over}, all proven exact"
    gap = max(point["relative_gap"] for point in wide)
    return (
        f"TGOSPA {over}: {len(points) - len(wide)} exact, {len(wide)} between proven bounds (the "
        f"totals differ by up to {number(100 * gap, 2)}%)"
    )


def _parameters(document: Json) -> str:
    used, sizes = document["parameters"], document["sizes"]
    fixed = ", ".join(
        f"{letter} = {used[name]:g}"
        + (f" {used['unit']}" if used["unit"] and name != "order" else "")
        for name, letter in LETTERS.items()
        if name in used
    )
    return (
        f"{fixed}; {used['distance']}; {counted(sizes['truth'], 'truth')}, "
        f"{counted(sizes['estimates'], 'estimate')}, "
        f"{counted(sizes['steps'], 'step')}"
    )


def _notes(document: Json) -> Iterator[str]:
    """Where the counts do not depend on the parameter; of the best assignments only."""
    letter, points = LETTERS[document["parameter"]], document["points"]
    if len(points) < 2 or not document["certified"]:
        return
    for key, names in (("missed_false", COUNTED_PARTS[:2]), ("switch", COUNTED_PARTS[2:])):
        words = " and ".join("switches" if name == "switch" else name for name in names)
        span = document["unchanged"][key]
        if span is None:
            yield f"{words}: the counts differ between all neighbouring values"
            continue
        begin = next(point for point in points if point["value"] == span["from"])
        counts = " and ".join(number(begin["counts"][name]) for name in names)
        low, high = (quantity(span[end], document) for end in ("from", "to"))
        yield (f"{words}: {counts} at all {span['points']} values from {letter} = {low} to {high}")
