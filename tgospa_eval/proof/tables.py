"""The two sides of a proof as CSV tables, and the distances where a checker has no formula."""

import csv
import io
import itertools
from collections.abc import Iterable

from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.proof.verify_tgospa import CLOSED
from tgospa_eval.results.result import Compared

TOLERANCE = 1e-9
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
    times, ids = (
        times_of(compared),
        {"truth": compared.labels.truths, "estimate": compared.labels.estimates},
    )
    tables = {}
    for name, names in ids.items():
        rows = zip(
            (names[track] for track in getattr(problem, f"{name}_track").tolist()),
            (times[step] for step in getattr(problem, f"{name}_step").tolist()),
            *getattr(compared.scene, name).T.tolist(),
            strict=True,
        )
        tables[f"{name}.csv"] = _csv(("id", "t", *compared.scene.columns), rows)
    if compared.settings["distance"] not in CLOSED:
        distance = parameters.cutoff * problem.cost ** (1 / parameters.order)
        rows = zip(
            (ids["truth"][k] for k in problem.truth_track[problem.truth_row].tolist()),
            (ids["estimate"][k] for k in problem.estimate_track[problem.estimate_row].tolist()),
            (times[step] for step in problem.entry_step.tolist()),
            distance.tolist(),
            strict=True,
        )
        tables["distances.csv"] = _csv(("truth", "estimate", "t", "distance"), rows)
    return tables


def times_of(compared: Compared) -> list[str]:
    """Each step as a text that is read back as the same number."""
    return [repr(moment) for moment in compared.moments.tolist()]


def difference(name: str, one: str, other: str) -> str:
    """Where two tables differ first, in words; empty if they are the same.

    Distances are the same within TOLERANCE; a pair near the cutoff may be in one table alone.
    """
    if name == "distances.csv":
        return _difference_of_distances(one, other)
    for line, (a, b) in enumerate(itertools.zip_longest(one.split("\n"), other.split("\n")), 1):
        if a != b:
            return f"line {line} is {_shown(a)}, must be {_shown(b)}"
    return ""


def _shown(line: str | None) -> str:
    return repr(line) if line else "missing"


def _difference_of_distances(one: str, other: str) -> str:
    """As of `difference`; a pair that is missing counts as just at the largest distance."""
    found, made = (
        {
            (truth, estimate, t): float(d)
            for truth, estimate, t, d in list(csv.reader(io.StringIO(text)))[1:]
        }
        for text in (one, other)
    )
    most = max((*found.values(), *made.values()), default=0.0)
    for pair in (*made, *found):
        a, b = found.get(pair, most), made.get(pair, most)
        if abs(a - b) > TOLERANCE * max(a, b):
            return f"{pair[0]}, {pair[1]} at t = {pair[2]} is {a!r}, must be {b!r}"
    return ""


def _csv(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
