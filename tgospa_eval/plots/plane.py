"""Trajectories in the plane, with what was missed, false and switched where it happened."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.palette import TRACK_COLOURS
from tgospa_eval.errors import ConfigError
from tgospa_eval.plots import boxes as corners
from tgospa_eval.plots import figure
from tgospa_eval.plots.overtime import time_axis
from tgospa_eval.plots.style import FALSE, INK, MISSED, SOFT, Style, legend, literal, styled, titled
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.reports.plot_data import (
    TIME,
    DrawnSide,
    PlotData,
    deviations,
    is_box,
    is_map,
    map_stretch,
    with_centres,
)
from tgospa_eval.text import quoted
from tgospa_eval.tracks.durations import SECOND
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


SIGMAS = 2
FEW = 30
"""Trajectories up to which shapes do not hide one another."""

CORNERS = 48
"""Of an ellipse."""

APART = 2.0
"""Distance of two shapes of a trajectory, in sizes of the first."""


def outlines(
    axis: "Axes", seen: PlotData, across: str, up: str, style: Style
) -> "dict[str, Artist]":
    """Draw them where the two columns show them; returns entries of a legend."""
    boxes = seen.document["boxes"]
    if len(seen.truth.ids) + len(seen.estimate.ids) > FEW:
        return {}
    if boxes and (across, up) not in (("left", "top"), ("centre x", "centre y")):
        return {}
    if not boxes and (not seen.document["spread"] or across == up or TIME in (across, up)):
        return {}
    from matplotlib.collections import PolyCollection

    handles: dict[str, Artist] = {}
    for side in (seen.truth, seen.estimate):
        axes = seen.axes[side.name]
        row, shapes = _boxes(axes) if boxes else ellipses(seen, side, across, up)
        if not len(row):
            continue
        reach = (shapes.max(axis=1) / 2 - shapes.min(axis=1) / 2).max(axis=1)
        middle = np.stack([axes[across][row], axes[up][row]], axis=1)
        kept = spaced(side.row["track"][row], middle, APART * reach)
        truth = side.name == "truth"
        colours = np.array(TRACK_COLOURS)[side.row["track"][row[kept]] % len(TRACK_COLOURS)]
        looks: dict[str, Any] = {"facecolors": "none", "edgecolors": INK if truth else colours}
        looks |= {"linewidths": 0.9 if style.titles else 0.5, "zorder": 2.3}
        looks["linestyles"] = (0, (4, 2)) if truth else "-"
        made = PolyCollection(list(shapes[kept]), label=f"{side.name}/shapes", **looks)
        axis.add_collection(made)
        what = "box" if boxes else f"{SIGMAS}-sigma"
        handles[f"{what}, {side.name}"] = made
    return handles


def ellipses(seen: PlotData, side: DrawnSide, across: str, up: str) -> tuple[Ints, Floats]:
    """Rows with a spread, and outlines (K, CORNERS, 2) of these.

    Of two components with deviations s, t and correlation r the n-sigma outline is
    (n s cos u, n t sin(u + arcsin r)), 0 <= u < 2 pi.
    """
    spread, axes = side.row["spread"], seen.axes[side.name]
    if not spread.shape[1]:
        return np.zeros(0, np.int64), np.zeros((0, CORNERS, 2))
    chosen = [seen.document["columns"].index(name) for name in (across, up)]
    s, t = (deviations(spread[:, k * (k + 3) // 2]) for k in chosen)
    i, j = max(chosen), min(chosen)
    row = np.flatnonzero((s > 0) | (t > 0))
    s, t, shared = s[row, None], t[row, None], spread[row, i * (i + 1) // 2 + j, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = np.nan_to_num(np.arcsin(np.clip(shared / s / t, -1, 1)))
    u = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    x = axes[across][row, None] + SIGMAS * s * np.cos(u)
    y = axes[up][row, None] + SIGMAS * t * np.sin(u + turn)
    return row, np.stack([x, y], axis=2)


def _boxes(axes: dict[str, Floats]) -> tuple[Ints, Floats]:
    """All rows, and corners (R, 4, 2)."""
    left, top, width, height = (axes[name] for name in ("left", "top", "width", "height"))
    return np.arange(len(left)), corners(left, left + width, top, top + height)


def spaced(track: Ints, middle: Floats, reach: Floats) -> Ints:
    """The first of each track, and each next one that is beyond the reach of the last."""
    kept = []
    last = -1
    for k in range(len(track)):
        new = last < 0 or track[last] != track[k]
        if new or np.abs(middle[k] - middle[last]).max() > max(reach[last], reach[k]):
            kept.append(k)
            last = k
    return np.array(kept, np.int64)


VECTOR_POINTS = 40_000
"""Points that are drawn as lines and marks in vector files; more become dots."""

CROWDED = 400
"""Events from which on marks become smaller."""

GROUPED = 1500
"""Events from which on a mark stands for all of a kind that are near to each other."""

CELLS = 48
"""Places for such marks beside each other."""

COVERED = 0.08
"""Share of the picture that marks of one kind cover at most, so that they remain marks."""

MANY_TRACKS = 100
"""Trajectories from which on lines are thinner and fainter, so that marks stand out."""

STRETCH = 8
"""How much longer one axis may be for both to have one scale."""


Mark = tuple[str, Floats, Floats, dict[str, Any]]
"""Kind of event, places, looks."""


def draw_plane(seen: PlotData, style: Style, columns: Sequence[str] | None = None) -> "Figure":
    """Trajectories with misses, false targets and switches."""
    boxes = seen.document["boxes"]
    across, up = plane_columns(seen.document["columns"], columns, boxes=boxes)
    sides = [side for side in (seen.truth, seen.estimate) if seen.axes[side.name]]
    places = {name: (axes[across], axes[up]) for name, axes in seen.axes.items() if axes}
    extent = [_extent([pair[k] for pair in places.values()]) for k in (0, 1)]
    scale = unit_scale(across, up, seen.document.get("stretch", 1.0))
    if scale is not None and not 1 / STRETCH <= scale * extent[1] / extent[0] <= STRETCH:
        scale = None
    ratio = 0.62 if scale is None else scale * extent[1] / extent[0]
    tall = min(max(ratio, 0.45), 1.0 if style.titles else 0.95) * (style.width - 1.0) + 0.9
    made, ((axis,),) = figure(style.width, tall)
    if scale is not None:
        axis.set_aspect(scale, adjustable="datalim")
    handles: dict[str, Artist] = {}
    many = sum(len(side.row["track"]) for side in sides) > VECTOR_POINTS
    for side in sides:
        handles |= _lines(axis, side, places[side.name], style, seen, many=many)
    handles |= outlines(axis, seen, across, up, style)
    handles |= _events(axis, seen, places, style)
    axis.autoscale_view()
    for name, which, upright in ((across, axis.xaxis, False), (up, axis.yaxis, True)):
        if name == TIME:
            time_axis(axis, seen, style, upright=upright)
        else:
            which.set_label_text(_named(name, seen.document["unit"]), parse_math=False)
    if boxes and up in ("top", "centre y"):
        axis.invert_yaxis()
    if not sides or not sum(len(side.row["track"]) for side in sides):
        axis.annotate("no positions", (0.5, 0.5), xycoords="axes fraction", ha="center")
    titled(axis, style, "In the plane", seen.about)
    beside = 7 if style.titles else 5 if len(handles) <= 5 else -(-len(handles) // 2)
    legend(made, list(handles.values()), list(handles), beside)
    return made


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


def _extent(values: list[Floats]) -> float:
    known = np.concatenate([*values, np.zeros(0)])
    return float(np.ptp(known)) if len(known) and np.ptp(known) > 0 else 1.0


def unit_scale(across: str, up: str, stretch: float) -> float | None:
    """Length of a unit upwards by that of one across, where both are places in one unit.

    `stretch` is that of a degree of latitude by one of longitude.
    """
    if TIME in (across, up) or len({across, up} & {"lat", "lon"}) == 1:
        return None
    return {("lon", "lat"): stretch, ("lat", "lon"): 1 / stretch}.get((across, up), 1.0)


def _lines(
    axis: "Axes",
    side: DrawnSide,
    place: tuple[Floats, Floats],
    style: Style,
    seen: PlotData,
    *,
    many: bool,
) -> "dict[str, Artist]":
    """A line for each stretch of steps, those of estimates in turn in several colours."""
    row, truth = side.row, side.name == "truth"
    if not len(row["track"]):
        return {}
    thin = style.settings.get("lines.linewidth", 1.3)
    apart = (np.diff(row["track"]) != 0) | (np.diff(row["step"]) > seen.document["stride"])
    breaks = np.flatnonzero(apart) + 1
    single = np.zeros(len(row["track"]), bool)  # a stretch of one state is no line
    single[np.append(0, breaks)[np.diff(np.concatenate([[0], breaks, [len(single)]])) == 1]] = True
    # One line with holes for each colour: a thousand artists take seconds.
    x, y = (np.insert(values, breaks, np.nan) for values in place)
    colour = np.insert(row["track"] % len(TRACK_COLOURS), breaks, -1)
    looks: dict[str, Any] = {
        "linestyle": (0, (4, 2)) if truth and not many else "-",
        "linewidth": thin * (0.7 if truth else 1.0) * (0.5 if many else 1),
        "alpha": min(1.0, (MANY_TRACKS / len(side.ids)) ** 0.5) * (0.7 if many else 1),
        "zorder": 2 if truth else 2.1,
    }
    dot: dict[str, Any] = {"marker": ".", "linestyle": "none", "markersize": 2.5 * thin}
    dot |= {"zorder": 2.1, "label": f"{side.name}/single"}
    handles: dict[str, Artist] = {}
    for turn, shade in enumerate([SOFT] if truth else TRACK_COLOURS):
        drawn = truth | (colour == turn) | (colour == -1)
        both: Any = {"color": shade, "rasterized": many}
        line = axis.plot(x[drawn], y[drawn], label=f"{side.name}/{turn}", **both, **looks)[0]
        dots = single & (truth | (row["track"] % len(TRACK_COLOURS) == turn))
        if dots.any():
            axis.plot(*(values[dots] for values in place), **both, **dot)
        handles.setdefault(side.name, line)
    return handles


def _events(
    axis: "Axes", seen: PlotData, places: dict[str, tuple[Floats, Floats]], style: Style
) -> "dict[str, Artist]":
    """Crosses, triangles and diamonds where something is wrong."""
    marks: list[Mark] = []
    for side, name, looks in (
        (seen.truth, "missed", {"marker": "x", "color": MISSED}),
        (seen.estimate, "false", {"marker": "^", "color": FALSE, "markerfacecolor": "none"}),
    ):
        if side.name in places:
            x, y = places[side.name]
            marks.append((name, x[side.unassigned], y[side.unassigned], looks))
    if "truth" in places and len(places["truth"][0]):
        row = rows_of_switches(seen)
        diamond: dict[str, Any] = {"marker": "D", "color": INK, "zorder": 4}
        if len(row) < CROWDED:
            diamond["markeredgecolor"] = "white"
        marks.append(("switch", places["truth"][0][row], places["truth"][1][row], diamond))
    count = sum(len(x) for _, x, _, _ in marks)
    if count > GROUPED:
        return _grouped(axis, marks, style)
    size = (5.0 if style.titles else 3.2) * max(0.35, 1 - 0.4 * math.log10(max(count / CROWDED, 1)))
    common = {"linestyle": "none", "markersize": size, "markeredgewidth": size / 6, "zorder": 3}
    common["rasterized"] = count > VECTOR_POINTS // 8
    return {
        name: axis.plot(x, y, label=name, **{**common, **looks})[0]
        for name, x, y, looks in marks
        if len(x)
    }


def _grouped(axis: "Axes", marks: list[Mark], style: Style) -> "dict[str, Artist]":
    """A mark for each kind and place, whose area is the number of events there."""
    wide = _extent([x for _, x, _, _ in marks]) / CELLS
    tall = _extent([y for _, _, y, _ in marks]) / CELLS
    groups = {name: _near(x, y, wide, tall) for name, x, y, _ in marks if len(x)}
    most = max(int(count.max()) for _, _, count in groups.values())
    whole = ((style.width - 1.0) * 72) ** 2
    busiest = max(int(count.sum()) for _, _, count in groups.values())
    largest = min(1.1 * whole / CELLS**2, COVERED * whole * most / busiest)
    handles: dict[str, Artist] = {}
    for name, _, _, looks in marks:
        if name not in groups:
            continue
        x, y, count = groups[name]
        looks = {"marker": looks["marker"], "zorder": looks.get("zorder", 3), "alpha": 0.8} | (
            {"facecolors": "none", "edgecolors": looks["color"]}
            if "markerfacecolor" in looks
            else {"color": looks["color"]}
        )
        looks |= {"linewidths": 0.7, "rasterized": len(x) > VECTOR_POINTS // 8}
        area = np.maximum(largest * count / most, largest / 40)
        made = axis.scatter(x, y, area, label=name, **looks)
        handles[f"{name}, {count.min():,} to {count.max():,}"] = made
    return handles


def _near(x: Floats, y: Floats, wide: float, tall: float) -> tuple[Floats, Floats, Ints]:
    """Middles and numbers of the points in each cell of a grid."""
    cells = np.stack([np.floor(x / wide), np.floor(y / tall)], axis=1)
    _, cell, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    cell = cell.reshape(-1)  # only NumPy 2.0 gives it two axes
    middle = [np.bincount(cell, weights=values) / count for values in (x, y)]
    return middle[0], middle[1], count


def rows_of_switches(seen: PlotData) -> Ints:
    """The row of the truth at which each switch is, or the last one before it."""
    key = seen.steps + 1
    row, switches = seen.truth.row, seen.switches
    wanted = switches["truth"].astype(np.int64) * key + switches["step"].astype(np.int64)
    found = np.searchsorted(row["track"] * key + row["step"], wanted, side="right") - 1
    return np.asarray(np.maximum(found, 0))


# -------------------------------------------------------------------------------------------------
# What was read, before anything is compared: the plane, and who is there when.

LOOKS = (
    {"color": SOFT, "linewidth": 2.2, "alpha": 0.55},
    {"color": FALSE, "linewidth": 0.9},
)
"""Of truth and estimate: what is above lets what is below be seen."""

NAMED = 30
"""Most trajectories that are named beside their lines."""

INCHES_ACROSS, INCHES_UP = 9.0, 4.2
"""Of the picture."""

PRESENCE = "trajectory"
"""What is up where the time is across."""


def plot_inspection(
    sides: Sequence[tuple[str, Trajectories]], *, unit: str = "", style: str = "screen"
) -> "Figure":
    """Trajectories in the plane, and a line for each over the times at which it has states.

    Parameters
    ----------
    sides : sequence of (str, Trajectories)
        Name and content of the truth, and of an estimate.
    unit : str
        Of the states.
    style : {"screen", "paper"}
        As of other pictures.

    Raises
    ------
    ConfigError
        matplotlib is not installed.
    """
    columns = sides[0][1].columns
    boxes, stretch = is_box(columns), 1.0
    across, up = plane_columns(columns, None, boxes=boxes)
    if is_map(columns):
        latitudes = [side.state[:, columns.index("lat")] for _, side in sides]
        stretch = map_stretch(np.concatenate(latitudes))
    timed = [side for _, side in sides if len(side.times)]
    first = min(timed, key=lambda side: side.times[0], default=sides[0][1])
    with styled(style):
        made, ((plane, presence),) = figure(INCHES_ACROSS, INCHES_UP, 1, 2)
        handles: dict[str, Artist] = {}
        below = 0
        for (name, side), looks in zip(sides, LOOKS, strict=False):
            order = np.argsort(side.track, kind="stable")
            track, step = side.track[order], side.step[order]
            breaks = np.flatnonzero((np.diff(track) != 0) | (np.diff(step) > 1)) + 1
            seconds = side.clock != "number" and len(side.times)
            times = (side.times - first.times[0]) / SECOND if seconds else side.times
            axes = with_centres(dict(zip(columns, side.state[order].T, strict=True)))
            axes[TIME] = np.asarray(times[step], float)
            axes[PRESENCE] = np.asarray(below + track, float)
            x, y, t, place = (
                np.insert(axes[key], breaks, np.nan) for key in (across, up, TIME, PRESENCE)
            )
            handles[literal(name)] = plane.plot(x, y, marker=".", markersize=2, **looks)[0]
            presence.plot(t, place, marker="|", markersize=3, **looks)
            below += len(side.ids)
        dated = timed and timed[0].clock != "number"
        _name(plane, _named(across, unit), _named(up, unit))
        _name(presence, f"s since {literal(str(first.shown[0]))}" if dated else TIME, PRESENCE)
        presence.invert_yaxis()
        if below <= NAMED:
            ids = [literal(str(name)) for _, side in sides for name in side.ids.tolist()]
            presence.set_yticks(range(below), ids, parse_math=False)
        scale = unit_scale(across, up, stretch)
        if scale is not None:
            plane.set_aspect(scale, adjustable="datalim")
        if boxes:
            plane.invert_yaxis()
        legend(made, list(handles.values()), list(handles), 2)
        return made


def _named(column: str, unit: str) -> str:
    inside = f" ({literal(unit)})" if unit and column not in ("lat", "lon", TIME) else ""
    return literal(column) + inside


def _name(axis: "Axes", across: str, up: str) -> None:
    axis.xaxis.set_label_text(across, parse_math=False)
    axis.yaxis.set_label_text(up, parse_math=False)
    for spine in ("left", "bottom"):
        axis.spines[spine].set_color(INK)
