"""The two sides of a proof as CSV tables, and the distances where a checker has no formula."""

import csv
import io
import itertools
from collections.abc import Iterable

from tgospa_eval.problem.problem import Ints, Problem
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.proof.verify_tgospa import CLOSED
from tgospa_eval.results.result import Compared

DISTANCE_TOLERANCE = 1e-9
"""Of distances that are computed again, perhaps by another version of a library; relative."""


def proof_tables(compared: Compared, problem: Problem, parameters: Parameters) -> dict[str, str]:
    """The tables of a proof folder by name.

    Parameters
    ----------
    compared : Compared
        States, ids and times.
    problem : Problem
        Rows and costs.
    parameters : Parameters
        What turns costs into distances.
    """
    labels, times = compared.labels, times_of(compared)
    ids = [_fields(names) for names in (labels.truths, labels.estimates)]
    tables = {
        f"{name}.csv": _csv(
            ("id", "t", *compared.scene.columns),
            _chosen(names, side.track),
            _chosen(times, side.step),
            *(map(repr, column) for column in states.T.tolist()),
        )
        for name, names, side, states in zip(
            ("truth", "estimate"),
            ids,
            problem.sides,
            (compared.scene.truth, compared.scene.estimate),
            strict=True,
        )
    }
    if compared.settings["distance"] not in CLOSED:
        distance = parameters.cutoff * problem.cost ** (1 / parameters.order)
        tracks = (side.track[side.row] for side in problem.sides)
        tables["distances.csv"] = _csv(
            ("truth", "estimate", "t", "distance"),
            *itertools.starmap(_chosen, zip(ids, tracks, strict=True)),
            _chosen(times, problem.entry_step),
            map(repr, distance.tolist()),
        )
    return tables


def times_of(compared: Compared) -> list[str]:
    """Each step as a text that is read back as the same number."""
    return [repr(moment) for moment in compared.moments.tolist()]


def difference(name: str, one: str, other: str, cutoff: float) -> str:
    """Where two tables differ first, in words; empty if they are the same.

    Distances are the same within DISTANCE_TOLERANCE; a pair at the cutoff may be in one table.
    """
    if name == "distances.csv":
        return _difference_of_distances(one, other, cutoff)
    for line, (a, b) in enumerate(itertools.zip_longest(one.split("\n"), other.split("\n")), 1):
        if a != b:
            return f"line {line} is {_shown(a)}, must be {_shown(b)}"
    return ""


def _shown(line: str | None) -> str:
    return repr(line) if line else "missing"


def _difference_of_distances(one: str, other: str, cutoff: float) -> str:
    """As of `difference`; a pair that is missing counts as at the cutoff."""
    found, made = (
        {
            (truth, estimate, t): float(d)
            for truth, estimate, t, d in list(csv.reader(io.StringIO(text)))[1:]
        }
        for text in (one, other)
    )
    for pair in (*made, *found):
        a, b = found.get(pair, cutoff), made.get(pair, cutoff)
        if abs(a - b) > DISTANCE_TOLERANCE * max(a, b):
            return f"{pair[0]}, {pair[1]} at t = {pair[2]} is {a!r}, must be {b!r}"
    return ""


def _fields(names: Iterable[str]) -> list[str]:
    """Texts as fields of a CSV file."""
    text = io.StringIO()
    writer = csv.writer(text)  # quotes what has a part of the end of its lines, \r\n
    fields = []
    for name in names:
        writer.writerow((name,))
        fields.append(text.getvalue().removesuffix("\r\n"))
        text.seek(0)
        text.truncate()
    return fields


def _chosen(fields: list[str], which: Ints) -> Iterable[str]:
    return map(fields.__getitem__, which.tolist())


def _csv(header: Iterable[str], *columns: Iterable[str]) -> str:
    """A table of columns of fields; many times faster than by `csv`."""
    lines = [",".join(_fields(header)), *map(",".join, zip(*columns, strict=True))]
    return "\n".join(lines) + "\n"
