"""From a result to what the pictures draw: the document of the HTML report, as arrays.

`reports.page_data` is the one home of what the views show; here its numbers get the shapes that
suit matplotlib. No artist, no choice of looks.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats.columns.headers import BOX
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.reports.clock import Clock, edges, placed, words
from tgospa_eval.reports.page_data import NONE, is_map
from tgospa_eval.results.records import PARTS, Json
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import quoted

TIME = "t"
"""The time as an axis of the plane."""

FARTHEST = 1e300
"""Of what is drawn: matplotlib takes differences of coordinates."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnSide:
    """The tracks of one side.

    Parameters
    ----------
    name : str
        ``"truth"`` or ``"estimate"``.
    ids : list of str
        With the class in front where classes are evaluated apart.
    table : dict
        Of each track its costs, counts and steps.
    run : dict
        Stretches of one assignment, by track and step: ``track``, ``begin``, ``end``, ``other``.
    row : dict
        States that are drawn, by track and step: ``track``, ``step``, ``other``; of the truth the
        ``error`` as a share of the cutoff.
    axes : dict
        Of these rows what the plane can show, by name.
    spread : dict
        What is around states: ``row``, and the entries of `reports.page_data` by number.
    """

    name: str
    ids: list[str]
    table: dict[str, list[Any]]
    run: dict[str, Ints]
    row: dict[str, Any]
    axes: dict[str, Floats]
    spread: dict[str, Ints]

    @property
    def unassigned(self) -> Ints:
        """Rows that are missed, or false."""
        return np.flatnonzero(self.row["other"] == NONE)


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """What all pictures of a result draw.

    Parameters
    ----------
    data : Json
        The document of the HTML report.
    truth, estimate : DrawnSide
        The tracks.
    about : str
        Value and parameters in words.
    """

    data: Json
    truth: DrawnSide
    estimate: DrawnSide
    about: str

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.data["times"])

    @property
    def switches(self) -> dict[str, Ints]:
        """Columns of the table of switches, as arrays."""
        return {name: np.asarray(column) for name, column in self.data["switches"].items()}

    @cached_property
    def labels(self) -> list[str]:
        """The times in words."""
        return words(self.data["times"])

    @cached_property
    def time(self) -> Clock:
        """The axis of time."""
        return Clock(axis=self.data["axis"], labels=self.labels)

    @cached_property
    def at(self) -> Floats:
        """Where each step is on it."""
        return placed(self.data["times"], self.data["axis"])

    @cached_property
    def edges(self) -> tuple[Floats, Floats]:
        """Where each step begins and ends on it."""
        return edges(self.at)


def view(result: Summary) -> View:
    """What the pictures of a result draw."""
    data, arrays = result.drawn
    about = f"{result.claim}; {result.parameters_in_words(data['unit'])}"
    return View(
        data=data,
        truth=_side("truth", data, arrays),
        estimate=_side("estimate", data, arrays),
        about=about,
    )


def parts_of(components: Sequence[str] | None) -> tuple[str, ...]:
    """The parts of the cost that are chosen, in their order; all where nothing is.

    Raises
    ------
    ConfigError
        A name is not one of `PARTS`, or the sequence is empty.
    """
    if components is None:
        return PARTS
    if isinstance(components, str) or not components or set(components) - set(PARTS):
        odd = components if isinstance(components, str) else ", ".join(map(str, components))
        raise ConfigError(f"components {quoted(odd)}: must be of {', '.join(PARTS)}")
    return tuple(name for name in PARTS if name in components)


def plane_columns(
    known: Sequence[str], asked: Sequence[str] | None, *, boxes: bool
) -> tuple[str, str]:
    """What is across and up.

    Raises
    ------
    ConfigError
        `asked` names an unknown column, or not exactly two.
    """
    names = [*known, *(("centre x", "centre y") if boxes else ()), TIME]
    if asked is not None:
        odd = [name for name in asked if name not in names]
        if odd or len(asked) != 2 or isinstance(asked, str):
            text = asked if isinstance(asked, str) else ",".join(asked)
            raise ConfigError(f"plane {quoted(text)}: must be two of {', '.join(names)}")
        return asked[0], asked[1]
    if boxes:
        return "centre x", "centre y"
    if is_map(known):
        return "lon", "lat"
    return (known[0], known[1]) if len(known) > 1 else (TIME, known[0] if known else TIME)


def is_box(columns: Sequence[str]) -> bool:
    """Whether states are boxes in pictures."""
    return tuple(columns[: len(BOX)]) == BOX


def binned(total: Floats, most: int) -> tuple[Ints, Ints]:
    """First steps of at most so many bins of equal length, and of each its costliest step."""
    together = max(1, -(-len(total) // most))
    first = np.arange(0, len(total), together)
    padded = np.full(len(first) * together, -1.0)
    padded[: len(total)] = total
    return first, first + padded.reshape(len(first), together).argmax(axis=1)


def _side(name: str, data: Json, arrays: dict[str, Ints]) -> DrawnSide:
    table = data["tracks"][name]
    run = {field: arrays[f"{name}/run/{field}"] for field in ("track", "begin", "end", "other")}
    row: dict[str, Any] = {field: arrays[f"{name}/row/{field}"] for field in ("track", "step")}
    key = len(data["times"]) + 1
    place = np.searchsorted(
        run["track"] * key + run["begin"], row["track"] * key + row["step"], side="right"
    )
    row["other"] = run["other"][place - 1] if len(place) else place
    if name == "truth":
        row["error"] = arrays["truth/row/error"] / data["errors"]
    spread = {
        key.rpartition("/")[2]: values
        for key, values in arrays.items()
        if key.startswith(f"{name}/spread/")
    }
    classes = table.get("class")
    return DrawnSide(
        name=name,
        ids=[f"{classes[k]}: {i}" if classes else i for k, i in enumerate(table["id"])],
        table=table,
        run=run,
        row=row,
        axes=_axes(name, data, arrays, row["step"]),
        spread=spread,
    )


def _axes(name: str, data: Json, arrays: dict[str, Ints], step: Ints) -> dict[str, Floats]:
    """The columns, the centres of boxes, and the time."""
    with np.errstate(over="ignore"):  # pictures end before the doubles do
        found: dict[str, Floats] = {
            column: np.clip(
                data["low"][k] + arrays[f"{name}/row/{k}"] * data["quantum"][k], -FARTHEST, FARTHEST
            )
            for k, column in enumerate(data["columns"])
        }
    if data["boxes"]:
        found["centre x"] = found["left"] + found["width"] / 2
        found["centre y"] = found["top"] + found["height"] / 2
    if data["columns"]:
        found[TIME] = placed(data["times"], data["axis"])[step]
    return found
