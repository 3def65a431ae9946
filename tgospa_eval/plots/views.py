"""From a result to what the pictures draw, which is what the HTML report draws.

`reports.page_data` is the one home of what the views show; here it gets the names that pictures
use. No artist, no choice of looks.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats.columns.headers import BOX
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.reports.clock import Clock, edges, placed, words
from tgospa_eval.reports.page_data import DrawnSide, Rows, is_map
from tgospa_eval.results.records import PARTS, Json
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import quoted

TIME = "t"
"""The time as an axis of the plane."""

FARTHEST = 1e300
"""Of what is drawn: matplotlib takes differences of coordinates."""


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

    @cached_property
    def axes(self) -> dict[str, dict[str, Floats]]:
        """Of the rows of each side what the plane can show: columns, centres of boxes, the time."""
        return {side.name: self._axes(side.row) for side in (self.truth, self.estimate)}

    def _axes(self, row: Rows) -> dict[str, Floats]:
        columns = np.clip(row["state"].T, -FARTHEST, FARTHEST)
        found = with_centres(dict(zip(self.data["columns"], columns, strict=True)))
        return found | {TIME: self.at[row["step"]]} if found else {}

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
    data, _, sides = result.drawn
    about = f"{result.claim}; {result.parameters_in_words(data['unit'])}"
    return View(data=data, truth=sides["truth"], estimate=sides["estimate"], about=about)


def with_centres(axes: dict[str, Floats]) -> dict[str, Floats]:
    """State columns by name, of boxes with their centres."""
    if not is_box(list(axes)):
        return axes
    x, y = axes["left"] + axes["width"] / 2, axes["top"] + axes["height"] / 2
    return axes | {"centre x": x, "centre y": y}


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
