"""Solvers compared on one estimate, as a document and as a table."""

from collections.abc import Iterator
from typing import Literal

from tgospa_eval.common.notices import Notice
from tgospa_eval.reports.phrases import (
    TO_RANK,
    columns,
    error_of,
    or_dash,
    parameters_of,
    size_of,
    unit_of,
)
from tgospa_eval.reports.records import Seconds, SolverRun, SolversRecord
from tgospa_eval.reports.tables import Document, Table
from tgospa_eval.results.records import PARTS, Columns

MEMORY: tuple[Literal["before", "peak"], ...] = ("before", "peak")


def solvers_document(document: SolversRecord) -> Document:
    """One problem through several solvers."""
    runs = document["runs"]
    return Document(
        kind=f"Comparison of solvers; {TO_RANK}",
        title=_agreement(document),
        lines=[size_of(document["sizes"]), parameters_of(document["parameters"])],
        tables=[
            Table(
                head=("run", "TGOSPA", "lower bound", "error", "bound's error", "iterations"),
                rows=[
                    (
                        run["name"],
                        or_dash(run["tgospa"], ".9g"),
                        or_dash(run["lower_bound"], ".9g"),
                        error_of(run["error"]),
                        error_of(run["lower_error"]),
                        or_dash(run["iterations"], "d"),
                    )
                    for run in runs
                ],
            ),
            Table(
                head=("seconds", "all", "prepare", "sweeps", "programme", "rest", "proof", "MB"),
                rows=[
                    (
                        run["name"],
                        *(or_dash(s, ".4f") for s in _split(run["seconds"])),
                        _memory(run),
                    )
                    for run in runs
                ],
            ),
        ],
        notes=list(_solver_notes(document)),
        warnings=[str(Notice(**record)) for record in document["warnings"]],
    )


def solvers_columns(document: SolversRecord) -> Columns:
    """A row for each run, plain numbers."""
    runs = document["runs"]
    names = (
        *("name", "solver", "epsilon", "tgospa", "lower_bound", "total", "total_lower", "error"),
        *("lower_error", *PARTS, "iterations", "status", "finished"),
    )
    table = columns(runs, names)
    split = [_split(run["seconds"]) for run in runs]
    for k, name in enumerate(("all", "prepare", "sweeps", "programme", "rest", "proof")):
        table[f"{name}_seconds"] = [row[k] for row in split]
    for name in MEMORY:
        table[f"{name}_bytes"] = [run["memory"] and run["memory"][name] for run in runs]
    return table


def _agreement(document: SolversRecord) -> str:
    referee, unit = document["referee"], unit_of(document["parameters"])
    if not document["agree"]:
        pairs = "; ".join(f"{a} and {b}" for a, b in document["contradictions"])
        return (
            f"The brackets of {pairs} do not overlap: one of these proofs is wrong. This is an "
            "error of this program or of its arithmetic, not of your data; please report it"
        )
    if referee is None:
        return "No solver has an answer"
    count = sum(run["total"] is not None for run in document["runs"])
    which = "Both" if count == 2 else f"All {count}"
    subject = "The bracket" if count == 1 else f"{which} brackets overlap; together they"
    verb = "says" if count == 1 else "say"
    low, high = f"{referee['lower_bound']:.9g}", f"{referee['upper_bound']:.9g}"
    if low == high:
        return f"{subject} {verb}: TGOSPA = {high}{unit}"
    return f"{subject} {verb}: TGOSPA is between {low} and {high}{unit}"


def _solver_notes(document: SolversRecord) -> Iterator[str]:
    once = document["seconds"]
    yield "once for all: " + ", ".join(f"{name} {value:.4f}" for name, value in once.items())
    for run in document["runs"]:
        if run["status"] != "solved":
            yield f"{run['name']}: {run['status']}"
    for name, reason in document["left_out"].items():
        yield f"{name} left out: {reason}"


def _split(seconds: Seconds | None) -> tuple[float | None, ...]:
    """Solving and proof together, and what they consist of."""
    if seconds is None:
        return (None,) * 6
    stages = seconds["stages"]
    named = [
        stages.get("preparation", 0.0) + stages.get("build", 0.0),
        stages.get("sweeps", 0.0),
        stages.get("lp", 0.0),
    ]
    rest = max(seconds["solve"] - sum(named), 0.0)
    return seconds["solve"] + seconds["certify"], *named, rest, seconds["certify"]


def _memory(run: SolverRun) -> str:
    memory = run["memory"]
    return "-" if memory is None else f"{(memory['peak'] - memory['before']) / 1e6:.1f}"
