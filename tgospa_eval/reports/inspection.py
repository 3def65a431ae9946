"""What was read, as a table of 80 columns or as JSON."""

import json
import textwrap
from collections.abc import Iterator
from typing import Any

from tgospa_eval.notices import Notice
from tgospa_eval.reports.console import WIDTH, clip
from tgospa_eval.text import visible

Document = dict[str, Any]

NAME = 18
"""Width of the first column."""

CELL = 30
"""Width of the columns of the files."""

LEFT_OUT = {
    "blank": "no position",
    "duplicate": "repeated",
    "time": "outside --time",
    "class": "not in --class",
    "region": "outside --region",
}
"""Why rows are left out, where the JSON's word for it is not enough."""


def json_text(document: Document) -> str:
    """The document with sorted keys."""
    return json.dumps(document, sort_keys=True, indent=1, allow_nan=False) + "\n"


def table(document: Document) -> str:
    """The document in words, for someone who sees it for the first time."""
    files = [document[name] for name in ("truth", "estimate") if name in document]
    blocks = [list(_files(files))]
    if "both" in document:
        blocks.append(list(_both(document["both"], document["parameters"])))
    said = [(file["path"], text) for file in files for text in file["notices"]]
    blocks.append([line for path, text in said for line in _wrap(f"{path}: {text}")])
    warnings = (str(Notice(**record)) for record in document["warnings"])
    blocks.append([line for text in warnings for line in _wrap(text)])
    return "\n\n".join("\n".join(map(clip, block)) for block in blocks if block) + "\n"


def _files(files: list[Document]) -> Iterator[str]:
    """A row for each property, a column for each file."""
    yield _row("", [f"{name}" for name in ("truth", "estimate")[: len(files)]])
    yield _row("file", [_tail(file["path"]) for file in files])
    yield _row("format", [file["format"] for file in files])
    yield _row("rows", [str(file["rows"]) for file in files])
    for rule in dict.fromkeys(rule for file in files for rule in file["left_out"]):
        counts = [str(file["left_out"].get(rule, 0)) for file in files]
        yield _row(f"  {LEFT_OUT.get(rule, rule)}", counts)
    yield _row("trajectories", [str(file["trajectories"]) for file in files])
    yield _row("  length", [_range(file["length"], "rows") for file in files])
    yield _row("  with holes", [_holes(file["holes"]) for file in files])
    yield _row("steps", [str(file["steps"]) for file in files])
    yield _row("  objects at", [_range(file["objects"], "") for file in files])
    if any("particles" in file for file in files):
        one = {"min": 1.0, "median": 1.0, "max": 1.0}
        yield _row("  particles", [_range(file.get("particles", one), "") for file in files])
    yield _row("  first t", [_plain(file["time"]["first"]) for file in files])
    yield _row("  last t", [_plain(file["time"]["last"]) for file in files])
    second = " s" if any(file["time"]["kind"] != "number" for file in files) else ""
    yield _row("  t to next t", [_range(file["time"]["step"], second.strip()) for file in files])
    for column in files[0]["columns"]:
        yield _row(column, [_interval(file["extent"].get(column)) for file in files])
        if any("deviation" in file for file in files):
            deviations = [file.get("deviation", {}).get(column) for file in files]
            yield _row("  std", [_range(spread, "", digits=3) for spread in deviations])
    for name in dict.fromkeys(name for file in files for name in file["classes"]):
        parts = [file["classes"].get(name) for file in files]
        yield _row(f"class {name}", [_class(part) for part in parts])


def _class(part: Document | None) -> str:
    if part is None:
        return "none"
    rows = "row" if part["rows"] == 1 else "rows"
    tracks = "trajectory" if part["trajectories"] == 1 else "trajectories"
    return f"{part['rows']} {rows}, {part['trajectories']} {tracks}"


def _holes(holes: Document) -> str:
    if not holes["trajectories"]:
        return "none"
    return f"{holes['trajectories']}, {steps_of(holes['steps'])}, longest {holes['longest']}"


def _both(both: Document, parameters: Document) -> Iterator[str]:
    steps = both["steps"]
    yield f"{steps['common']} of {steps['union']} steps are in both files" + (
        f", {steps['joined']} of them joined" if steps["joined"] else ""
    )
    for side, rows in both["left_out"].items():
        if rows:
            yield f"{rows} rows of the {side} left out (--grid {parameters['grid']})"
    time = both["time"]
    yield "both have rows from " + (
        f"t = {_plain(time['first'])} to {_plain(time['last'])}, {steps_of(time['steps'])}"
        if time
        else "no common stretch of time"
    )
    for column, extent in both["extent"].items():
        yield f"  {column:<{NAME}}" + (
            f"{_interval(extent)} in both" if extent else "the ranges do not overlap"
        )
    nearest = both["nearest"]
    if nearest is None:
        yield "no step has both a truth and an estimate: no distances"
        return
    unit = f" {parameters['unit']}" if parameters["unit"] else ""
    yield ""
    yield f"distance from a truth to the nearest estimate of its step, {nearest['truths']} truths"
    quantiles = nearest["quantiles"]
    yield "  share of truths" + "".join(f"{f'{q} %':>11}" for q in quantiles)
    yield "  distance up to " + "".join(f"{_number(value):>11}" for value in quantiles.values())
    share = 100 * nearest["within_cutoff"]
    yield f"  nearer than the cutoff c = {nearest['cutoff']:g}{unit}: {share:.1f} %"


def steps_of(count: int) -> str:
    """A number of steps."""
    return f"{count} step" + ("" if count == 1 else "s")


def _row(name: str, cells: list[str]) -> str:
    return (
        f"{clip(name, NAME):<{NAME}} " + "".join(f"{cell:<{CELL - 2}}  " for cell in cells)
    ).rstrip()


def _range(spread: Document | None, unit: str, digits: int = 6) -> str:
    """Smallest to largest, and the median between them."""
    if spread is None:
        return "-"
    low, middle, high = (_number(spread[key], digits) for key in ("min", "median", "max"))
    text = low if low == high else f"{low} to {high}, median {middle}"
    return f"{text} {unit}".strip()


def _interval(extent: Document | None) -> str:
    return "-" if extent is None else f"{_number(extent['min'])} to {_number(extent['max'])}"


def _number(value: float | None, digits: int = 6) -> str:
    return "-" if value is None else f"{value:.{digits}g}"


def _plain(value: Any) -> str:
    return "-" if value is None else str(value)


def _tail(path: str) -> str:
    """The end of a path, which tells files apart."""
    return path if len(path) < CELL else "..." + path[4 - CELL :]


def _wrap(text: str) -> list[str]:
    return textwrap.wrap(visible(text), WIDTH, subsequent_indent="  ", break_on_hyphens=False)
