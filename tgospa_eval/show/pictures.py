"""The pictures of a result folder: which, in what formats, as files."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import PARTS
from tgospa_eval.sensors.association import Pairing
from tgospa_eval.show.figures import FILES, available, files_of, pictures
from tgospa_eval.show.files import ASSOCIATION, RESULT, probe_folder, result_texts, write_texts
from tgospa_eval.show.lanes import draw_lanes
from tgospa_eval.show.overtime import (
    draw_costs,
    draw_cumulative,
    draw_nees,
    draw_windows,
    draw_worst,
)
from tgospa_eval.show.plane import draw_plane, plane_columns
from tgospa_eval.show.plot_data import is_box, plot_data
from tgospa_eval.show.rendering import csv_text
from tgospa_eval.show.style import STYLES, Style, styled
from tgospa_eval.text import quoted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN = ("costs", "lanes", "plane", "cumulative", "worst")
OVER_TIME = ("costs", "cumulative", "nees")
"""Those of data in parts, of which no tracks are drawn."""


ABSENT = {
    "windows": "there are no windows: evaluate with window=, the steps of each",
    "nees": "there is no NEES: evaluate with with_='nees', and states that have covariances",
}
"""Why there is no such picture."""


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """What pictures of a result are wanted, checked.

    Parameters
    ----------
    formats : tuple of str
        Of `FILES`; none draws nothing.
    style : str
        Of `STYLES`.
    components : tuple of str, optional
        Parts of the cost; all by default.
    columns : pair of str, optional
        What is across and up in the plane.

    Raises
    ------
    ConfigError
        A format, the style or a component has an unknown name.
    """

    formats: tuple[str, ...] = ("png",)
    style: str = "screen"
    components: tuple[str, ...] | None = None
    columns: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        odd = [name for name in self.formats if name not in FILES]
        if odd:
            raise ConfigError(f"pictures {quoted(odd[0])}: must be of {', '.join(FILES)}, or none")
        if self.style not in STYLES:
            raise ConfigError(f"style {quoted(self.style)}: must be one of {', '.join(STYLES)}")
        parts_of(self.components)

    @property
    def names(self) -> tuple[str, ...]:
        """The files of `result_pictures`."""
        return tuple(f"{name}.{kind}" for name in (*DRAWN, "nees") for kind in self.formats)

    def check(self, known: Sequence[str]) -> None:
        """See that the plane can be drawn of these state columns, before any work is done.

        Raises
        ------
        ConfigError
            `columns` names one that the states do not have.
        """
        plane_columns(known, self.columns, boxes=is_box(known))


def result_pictures(
    result: Evaluation,
    wanted: Pictures,
    notify: Callable[[str, float], None] = lambda name, share: None,  # noqa: ARG005
) -> dict[str, bytes]:
    """Files by name: costs, lanes, plane, cumulative and worst, each in all formats.

    And NEES, where there is any, and windows, where they were asked for. `notify` takes the name of
    each before it is drawn, and the share that is done.
    """
    if not wanted.formats:
        return {}
    with styled(wanted.style) as style:
        draw = _pictures(result, style, wanted.components, wanted.columns)
        if isinstance(result, PartitionedResult):
            draw = {name: draw[name] for name in OVER_TIME if name in draw}
        return files_of(draw, wanted.formats, style.dots, notify)


def plot(
    result: Evaluation,
    name: str,
    *,
    style: str = "screen",
    components: Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
) -> "Figure":
    """One of them, as `plot_costs` and its like return it.

    Raises
    ------
    ConfigError
        A name is unknown, matplotlib is not installed, or there is no such picture.
    """
    with styled(style) as made:
        draw = _pictures(result, made, components, columns)
        if name not in draw:
            raise ConfigError(ABSENT[name])
        return draw[name]()


def _pictures(
    result: Evaluation,
    style: Style,
    components: Sequence[str] | None,
    columns: Sequence[str] | None,
) -> "dict[str, Callable[[], Figure]]":
    """By name what makes each."""
    seen = plot_data(result)
    parts = parts_of(components)
    found: dict[str, Callable[[], Figure]] = {
        "costs": lambda: draw_costs(seen, style, parts),
        "lanes": lambda: draw_lanes(seen, style),
        "plane": lambda: draw_plane(seen, style, columns),
        "cumulative": lambda: draw_cumulative(seen, style, parts),
        "worst": lambda: draw_worst(seen, style, parts),
    }
    if "nees" in seen.document:
        found["nees"] = lambda: draw_nees(seen, style)
    if result.slid is not None:
        found["windows"] = lambda: draw_windows(seen, style, parts)
    return found


def save(result: Evaluation | Pairing, folder: "str | os.PathLike[str]", *, force: bool) -> None:
    """`Result.save`: the result folder, with what the extras that are installed can draw."""
    path, kind = os.fspath(folder), RESULT if isinstance(result, Evaluation) else ASSOCIATION
    try:
        probe_folder(path, kind, force=force, option="folder")
        if isinstance(result, Pairing):
            files = association_files(result)
        else:
            files = {**result_texts(result)}
            files |= result_pictures(result, Pictures()) if available() else {}
        write_texts(files, path, kind, force=force, option="folder")
    except ConfigError as error:
        raise ConfigError(str(error).replace("--force", "force=True")) from None


def association_plane(
    found: Pairing, *, style: str = "screen", columns: Sequence[str] | None = None
) -> "Figure":
    """`Association.plot_plane`."""
    with styled(style) as made:
        return draw_plane(plot_data(found), made, columns)


def association_files(
    found: Pairing, names: tuple[str, str] = ("A", "B")
) -> dict[str, str | bytes | Path]:
    """Page, table and, with the extra, picture of an association, by name."""
    from tgospa_eval.show.html import association_page  # lazy: jinja2 is slow to import

    files: dict[str, str | bytes | Path] = {"report.html": association_page(found, names)}
    files["associations.csv"] = csv_text(found.associations_table())
    return files | (pictures({"plane": lambda: association_plane(found)}) if available() else {})


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


def names_in(text: str) -> tuple[str, ...]:
    """The names of a list with commas."""
    return tuple(part.strip() for part in text.split(","))
