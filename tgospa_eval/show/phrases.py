"""Words and numbers that all documents of `compare` share."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

from tgospa_eval.common.interval import Interval, places
from tgospa_eval.common.words import counted, sizes_in_words
from tgospa_eval.results.numbers import members_in_words
from tgospa_eval.results.records import Columns, Json

PART_HEADS = ("local.", "missed", "false", "switch")
"""Of the parts of the cost, as heads of narrow columns."""

Rule = Literal["stone_soup", "mathworks"]

RULES: dict[Rule, str] = {"stone_soup": "Stone Soup", "mathworks": "MathWorks"}
"""How others charge switches after per-step GOSPA."""

EXACT = 1e-9
"""Relative errors below count as none, and differ from machine to machine."""

TO_RANK = "to rank estimates: tgospa-eval compare TRUTH A B"
TO_STUDY = "to compare solvers on one: tgospa-eval compare TRUTH A"
"""What to type for what a page is not."""

SPLIT_NOTE = (
    "split, not proven: localisation, missed, false and switch are those of the assignment that "
    "was found; the brackets hold for TGOSPA and the total"
)


def or_dash(value: float | None, form: str) -> str:
    """A number, or a dash."""
    return "-" if value is None else f"{value:{form}}"


def error_of(value: float | None) -> str:
    """A relative error, in powers of ten."""
    if value is None:
        return "-"
    return f"<{EXACT:g}" if value < EXACT else f"{value:.1e}"


def columns(
    rows: Sequence[Mapping[str, object]], names: Iterable[str], before: str = ""
) -> Columns:
    """Entries of rows as columns, with something before their names."""
    return {f"{before}{name}": [row[name] for row in rows] for name in names}


def unit_of(parameters: Mapping[str, Any]) -> str:
    """The unit behind a number, if there is one."""
    unit = parameters.get("unit")
    return f" {unit}" if unit else ""


def size_of(sizes: Mapping[str, int]) -> str:
    """How large a problem is."""
    return (
        f"{sizes_in_words(sizes)}; {counted(sizes['states'], 'reduced state')} in "
        f"{counted(sizes['components'], 'component')}"
    )


LETTERS = {"cutoff": "c", "order": "p", "switch_penalty": "gamma", "rho": "rho"}
"""What parameters of the metric are called."""


def parameters_of(parameters: Mapping[str, Any], end: str = ", ") -> str:
    """Parameters of the metric, those that there are, and the distance."""
    unit = unit_of(parameters)
    known = ", ".join(
        f"{letter} = {parameters[name]:g}{unit if name in ('cutoff', 'switch_penalty') else ''}"
        for name, letter in LETTERS.items()
        if name in parameters
    )
    return f"{known}{members_in_words(parameters)}{end}{parameters['distance']}"


# -------------------------------------------------------------------------------------------------
# A proven order in words: places, who is best, what verdicts mean.

ORDERS = {"less": "proven", "equal": "equal", "not separated": "open"}
"""Verdicts as the tables have them."""

PROOFS = {
    "less": "proven: the upper bound of the one is below the lower bound of the other",
    "equal": "equal: the same data, or proven to differ by less than 1e-9 of the value",
    "not separated": "open: the bounds of both overlap",
}
"""What the verdicts mean."""


MOST_NAMED = 8
"""Names in a sentence; a table has all of them."""


def first_names(groups: Sequence[Sequence[str]]) -> str:
    """The first names with commas, those of a group with ``=``, and how many more there are."""
    left, texts = MOST_NAMED, list[str]()
    for group in groups:
        if left > 0:
            texts.append(" = ".join(group[:left]))
        left -= len(group)
    return ", ".join(texts) + (f" and {-left:,} more, all in the table" if left < 0 else "")


def order_in_words(value: str, entries: Sequence[Json], pairs: Sequence[Json]) -> str:
    """A sentence.

    Parameters
    ----------
    value : str
        By which they are ordered.
    entries : sequence of dict
        In the order of the values: each has a ``name``, and the best and the worst ``place``.
    pairs : sequence of dict
        Names of the ``first`` and the ``second``, in this order, and the ``verdict``: what is
        proven of the two.
    """
    names = [entry["name"] for entry in entries]
    verdicts = {(pair["first"], pair["second"]): pair["verdict"] for pair in pairs}
    groups = [list(names[:1])]
    for pair in itertools.pairwise(names):
        if verdicts[pair] == "equal":
            groups[-1].append(pair[1])
        else:
            groups.append([pair[1]])
    proven = {
        **dict.fromkeys(itertools.combinations(names, 2), "less"),
        **{pair: "equal" for group in groups for pair in itertools.combinations(group, 2)},
    }
    if verdicts == proven and len(groups) == 1:
        return f"Proven to be equal on these files by {value}: {first_names(groups)}"
    if verdicts == proven:
        return f"Proven order of these files by {value}, best first: {first_names(groups)}"
    best = best_of([entry["place"] for entry in entries])
    if best:
        return (
            f"Proven best by {value}: {first_names([[names[k] for k in best]])}; the order of "
            "the others is not proven throughout"
        )
    tied = [[entry["name"]] for entry in entries if entry["place"][0] == 1]
    return f"None is proven best by {value}: it may be any of {first_names(tied)}"


def best_of(ranks: Sequence[Sequence[int]]) -> list[int]:
    """Which are proven to be better than all others, or equal to such."""
    best = [k for k, place in enumerate(ranks) if tuple(place) == (1, 1)]
    return best if len(best) < len(ranks) else []


def best_cells(
    columns: Mapping[int, Sequence[Interval]], rivals: Iterable[Sequence[int]]
) -> frozenset[tuple[int, int]]:
    """Row and column of the values that are proven to be the least of those they compete with.

    Parameters
    ----------
    columns : mapping of int to sequence of Interval
        Of each column that is compared, the values of all rows.
    rivals : iterable of sequences of int
        Rows that compete with each other.
    """
    return frozenset(
        (rows[k], column)
        for rows in rivals
        for column, values in columns.items()
        for k in best_of(places([values[row] for row in rows]))
    )


def equal_names(pairs: Iterable[Json]) -> set[str]:
    """Names that share a place, for they are proven to be equal."""
    equal = [pair for pair in pairs if pair["verdict"] == "equal"]
    return {pair[name] for pair in equal for name in ("first", "second")}


def place_in_words(best: int, worst: int, *, shared: bool = False) -> str:
    """The range of places that are possible, or the only one, with = if it is shared."""
    if best < worst:
        return f"{best}-{worst}"
    return f"{best}=" if shared else f"{best}"
