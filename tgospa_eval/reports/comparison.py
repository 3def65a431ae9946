"""Documents of `compare` as pages and as tables. Computes nothing that is not in the document."""

import json
from collections.abc import Iterator
from typing import Any

from tgospa_eval.evaluation import Table
from tgospa_eval.reports.sheets import Page, Sheet, as_csv, as_latex, as_markdown, as_text

Document = dict[str, Any]

PARTS = ("localisation", "missed", "false", "switch")


def json_text(document: Document) -> str:
    """The document with sorted keys; no NaN."""
    return json.dumps(document, sort_keys=True, indent=1, allow_nan=False) + "\n"


def render(document: Document, format: str) -> str:
    """What ``--format`` prints."""
    if format == "json":
        return json_text(document)
    page, table = PAGES[document["kind"]]
    if format == "csv":
        return as_csv(table(document))
    return {"table": as_text, "markdown": as_markdown, "latex": as_latex}[format](page(document))


# --- solvers --------------------------------------------------------------------------------------


def solvers_page(document: Document) -> Page:
    """One problem through several solvers."""
    runs = document["runs"]
    return Page(
        title=_agreement(document),
        lines=[_size(document["sizes"]), _parameters(document["parameters"])],
        sheets=[
            Sheet(
                head=("run", "TGOSPA", "lower bound", "error", "bound's error", "iterations"),
                rows=[
                    (
                        run["name"],
                        f"{run['tgospa']:.9g}",
                        f"{run['lower_bound']:.9g}",
                        _error(run["error"]),
                        _error(run["lower_error"]),
                        str(run["iterations"]),
                    )
                    for run in runs
                ],
            ),
            Sheet(
                head=("seconds", "all", "prepare", "sweeps", "programme", "rest", "proof", "MB"),
                rows=[
                    (run["name"], *(f"{s:.4f}" for s in _split(run["seconds"])), _memory(run))
                    for run in runs
                ],
            ),
        ],
        remarks=list(_solver_remarks(document)),
    )


def solvers_table(document: Document) -> Table:
    """A row for each run, plain numbers."""
    runs = document["runs"]
    names = (
        "name", "solver", "epsilon", "tgospa", "lower_bound", "total", "total_lower", "error",
        "lower_error", *PARTS, "iterations", "status", "finished",
    )  # fmt: skip
    table: Table = {name: [run[name] for run in runs] for name in names}
    split = [_split(run["seconds"]) for run in runs]
    for k, name in enumerate(("all", "prepare", "sweeps", "programme", "rest", "proof")):
        table[f"{name}_seconds"] = [row[k] for row in split]
    for name in ("before", "peak"):
        table[f"{name}_bytes"] = [(run["memory"] or {}).get(name) for run in runs]
    return table


def _agreement(document: Document) -> str:
    referee, unit = document["referee"], _unit(document["parameters"])
    if not document["agree"]:
        pairs = "; ".join(f"{a} and {b}" for a, b in document["contradictions"])
        return (
            f"The brackets of {pairs} do not overlap: one of these proofs is wrong. This is an "
            "error of this program or of its arithmetic, not of your data; please report it"
        )
    count = len(document["runs"])
    told = "The bracket" if count == 1 else f"All {count} brackets overlap; together they"
    verb = "says" if count == 1 else "say"
    low, high = (f"{referee[name]:.9g}" for name in ("lower_bound", "upper_bound"))
    if low == high:
        return f"{told} {verb}: TGOSPA = {high}{unit}"
    return f"{told} {verb}: TGOSPA is between {low} and {high}{unit}"


def _solver_remarks(document: Document) -> Iterator[str]:
    once = document["seconds"]
    yield "once for all: " + ", ".join(f"{name} {value:.4f}" for name, value in once.items())
    for run in document["runs"]:
        if run["status"] != "solved":
            yield f"{run['name']}: {run['status']}"
    for name, reason in document["left_out"].items():
        yield f"{name} left out: {reason}"


def _split(seconds: Document) -> tuple[float, ...]:
    """Solving and proof together, and what they consist of."""
    stages = seconds["stages"]
    named = [
        stages.get("preparation", 0.0) + stages.get("build", 0.0),
        stages.get("sweeps", 0.0),
        stages.get("lp", 0.0),
    ]
    rest = max(seconds["solve"] - sum(named), 0.0)
    return seconds["solve"] + seconds["certify"], *named, rest, seconds["certify"]


def _memory(run: Document) -> str:
    memory = run["memory"]
    return "-" if memory is None else f"{(memory['peak'] - memory['before']) / 1e6:.1f}"


# --- words ----------------------------------------------------------------------------------------


def _error(value: float | None) -> str:
    if value is None:
        return "-"
    return "0" if value == 0 else f"{value:.1e}"


def _unit(parameters: Document) -> str:
    return f" {parameters['unit']}" if parameters["unit"] else ""


def _size(sizes: Document) -> str:
    return (
        f"{_count(sizes['truth'], 'truth')}, {_count(sizes['estimates'], 'estimate')}, "
        f"{_count(sizes['steps'], 'step')}; {_count(sizes['states'], 'reduced state')} in "
        f"{_count(sizes['components'], 'component')}"
    )


def _parameters(parameters: Document) -> str:
    unit = _unit(parameters)
    return (
        f"c = {parameters['cutoff']:g}{unit}, p = {parameters['order']:g}, "
        f"gamma = {parameters['switch_penalty']:g}{unit}, {parameters['distance']}"
    )


def _count(number: int, word: str) -> str:
    return f"{number:,} {word}" + ("" if number == 1 else "s")


PAGES = {"solvers": (solvers_page, solvers_table)}
"""Page and main table of each kind of document."""
