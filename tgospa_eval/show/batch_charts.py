"""Pictures of a batch: values side by side, what costs are made of, curves over steps."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.results.records import PARTS, Json, Part
from tgospa_eval.show.batch import BatchTables
from tgospa_eval.show.curves import CURVE_KINDS, LINE_NAMES, RmsCurve, on_one_axis
from tgospa_eval.show.figures import figure, files_of
from tgospa_eval.show.overtime import name_times
from tgospa_eval.show.palette import LIGHT, TRACK_COLOURS, heat_shades
from tgospa_eval.show.style import FILLS, SOFT, Style, legend, literal, power, styled, titled
from tgospa_eval.show.time_axis import ROOM

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tgospa_eval.show.pictures import Pictures

DASHES_OF_LINES = ("-", "--", ":", "-.")
MOST_BARS = 40

PANEL = 0.62
"""Height of one of many panels, of one that is alone."""

ROW = 0.21
"""Inches of a row with letters."""


def draw_curves(
    curves: Sequence[tuple[int, RmsCurve]], style: Style, unit: str, *, parts: bool = False
) -> "Figure":
    """RMS-TGOSPA of runs over time, with bands; a panel for each kind.

    Parameters
    ----------
    curves : sequence of (int, RmsCurve)
        At least one, with the number of the colour of each.
    style : Style
        Sizes.
    unit : str
        Of the values.
    parts : bool
        Whether to draw the parts instead, one below the other, the kinds side by side.
    """
    lines: Sequence[str] = PARTS if parts else ("total",)
    curves = [(track, curve) for track, curve in curves if lines[0] in curve.rms]
    kinds = [kind for kind in CURVE_KINDS if any(curve.kind == kind for _, curve in curves)]
    if parts:
        made, axes = figure(style.width, PANEL * style.low * len(lines), len(lines), len(kinds))
        for axis, kind in zip(axes[0], kinds, strict=True):
            axis.set_title(CURVE_KINDS[kind], fontsize="medium", loc="left")
    else:
        made, axes = figure(style.width, style.low * len(kinds), len(kinds))
        axes = axes.T
        titled(axes[0, 0], style, "Root mean square over the runs")
    clock, places, ends = on_one_axis([curve for _, curve in curves])
    drawn: dict[str, Artist] = {}
    for (row, column), axis in np.ndenumerate(axes):
        name, kind = lines[row], kinds[column]
        top = 0.0
        for (track, curve), at in zip(curves, places, strict=True):
            if curve.kind == kind:
                group = literal(curve.name or "all jobs")
                drawn[group] = _draw_line(axis, at, curve, name, track)
                top = max(top, curve.top(name))
        axis.set_ylim(0, ROOM * top or 1.0)
        name_times(axis, clock, ends, style.width / (len(kinds) if parts else 1))
        about = LINE_NAMES[name].removeprefix("RMS ").replace(" error", "\nerror")
        about += "" if parts else f"\n{CURVE_KINDS[kind]}"
        if not (parts and column):
            axis.set_ylabel(f"{about} ({literal(unit)})" if unit else about, parse_math=False)
        if parts and row + 1 < len(lines):
            axis.set_xlabel("")
    legend(made, list(drawn.values()), list(drawn), 4 if style.titles else 3)
    return made


def _draw_line(axis: "Axes", at: Floats, curve: RmsCurve, name: str, track: int) -> "Artist":
    """A line with its band."""
    colour = TRACK_COLOURS[track % len(TRACK_COLOURS)]
    if name in curve.bands:
        axis.fill_between(at, *curve.bands[name], color=colour, alpha=0.16, linewidth=0)
    looks: dict[str, Any] = {
        "color": colour,
        "linestyle": DASHES_OF_LINES[track % len(DASHES_OF_LINES)],
    }
    looks |= {"marker": "o"} if len(at) == 1 else {}
    return axis.plot(at, curve.rms[name], clip_on=False, **looks)[0]


def draw_parts(groups: Mapping[str, Mapping[Part, float]], style: Style, about: str) -> "Figure":
    """Cost per step of each group, stacked.

    Parameters
    ----------
    groups : mapping of str to mapping
        The parts of the cost per step by group, the first on top.
    style : Style
        Sizes.
    about : str
        What is along the bars.
    """
    shown = list(groups.items())[:MOST_BARS]
    made, ((axis,),) = figure(style.width, 1.1 + ROW * 1.5 * len(shown))
    places = np.arange(len(shown))
    left = np.zeros(len(shown))
    bars = []
    for name in PARTS:
        sizes = np.array([parts[name] for _, parts in shown])
        bars.append(axis.barh(places, sizes, 0.62, left=left, **FILLS[name]))
        left += sizes
    _names(axis, [name for name, _ in shown], upright=True)
    axis.grid(visible=False, axis="y")
    axis.set_xlabel(about, parse_math=False)
    titled(axis, style, "What the cost is made of")
    legend(made, bars, list(PARTS), 4)
    return made


def draw_heat(heat: Json, style: Style, unit: str) -> "Figure":
    """Value per step of each cell; of many rows those lie across, without numbers.

    Parameters
    ----------
    heat : dict
        As of `show.batch.heat_of`; at least one cell has a value.
    style : Style
        Sizes.
    unit : str
        Of the values.
    """
    from matplotlib.colors import ListedColormap

    def value(cell: Json | None) -> float:
        if cell is None or cell["value"] is None:
            return np.nan
        return float(cell["level"] if heat["scales"] > 1 else cell["value"].upper)

    values = np.array([[value(cell) for cell in row] for row in heat["cells"]])
    if heat["squares"]:
        values = values.T
    high = ROW * len(values) * (2 if heat["squares"] else 1)
    made, ((axis,),) = figure(style.width, 1.3 + high)
    axis.grid(visible=False)
    colours = ListedColormap(heat_shades(LIGHT))
    seen = axis.pcolormesh(np.ma.masked_invalid(values), cmap=colours, rasterized=heat["squares"])
    what = f"TGOSPA per step ({literal(unit)})" if unit else "TGOSPA per step"
    bar = made.colorbar(seen, ticks=[] if heat["scales"] > 1 else None)
    own = ", least to largest of the same parameters" if heat["scales"] > 1 else ""
    bar.set_label(what + own, parse_math=False)
    axis.set_ylim(len(values), 0)
    if heat["squares"]:
        _names(axis, heat["columns"], upright=True, shift=0.5)
        axis.set_xlabel(f"{literal(heat['down'], 40)}, in order", parse_math=False)
    else:
        _names(axis, heat["columns"], upright=False, shift=0.5)
        _names(axis, heat["rows"], upright=True, shift=0.5)
        _numbers(axis, heat)
    for side in axis.spines.values():
        side.set_visible(False)
    titled(axis, style, f"{literal(heat['down'])} by {literal(heat['across'])}")
    return made


def _numbers(axis: "Axes", heat: Json) -> None:
    """The value in each cell, bold where it is proven to be the best of its row."""
    for k, row in enumerate(heat["cells"]):
        for column, cell in enumerate(row):
            if cell is None:
                continue
            weight = "bold" if cell["best"] else "normal"
            axis.text(
                column + 0.5, k + 0.5, cell["text"], ha="center", va="center", fontsize="small",
                fontweight=weight, color=LIGHT["ink"] if cell["value"] else SOFT,
            )  # fmt: skip


def _names(axis: "Axes", names: Sequence[str], *, upright: bool, shift: float = 0.0) -> None:
    """Names of rows, the first on top, or of columns."""
    which = axis.yaxis if upright else axis.xaxis
    places = np.arange(len(names)) + shift
    which.set_ticks(places, [literal(name, 30) for name in names], parse_math=False)
    which.set_tick_params(length=0)
    if upright and not shift:
        axis.set_ylim(len(names) - 0.5, -0.5)


def batch_pictures(
    tables: BatchTables, wanted: "Pictures", notify: Callable[[str, float], None]
) -> dict[str, bytes]:
    """Files by name, those that have something to show, each in all formats.

    `notify` takes the name of each before it is drawn, and the share that is done.
    """
    with styled(wanted.style) as style:
        draw: dict[str, Callable[[], Figure]] = {}
        if tables.shown_groups:
            orders = tables.rows["order"].dropna().unique()
            unit = power(tables.unit, orders[0]) if len(orders) == 1 else ""
            costs = {group["name"] or "all jobs": group["costs"] for group in tables.shown_groups}
            draw["parts"] = lambda: draw_parts(costs, style, f"cost per step{unit}")
        heat, curves = tables.heat, tables.drawn_curves
        if heat is not None and heat["ends"] is not None:
            draw["heat"] = lambda: draw_heat(heat, style, tables.unit)
        if curves:
            draw["curve"] = lambda: draw_curves(curves, style, tables.unit)
            draw["curve-parts"] = lambda: draw_curves(curves, style, tables.unit, parts=True)
        return files_of(draw, wanted.formats, style.dots, notify)
