"""Trajectories in the plane, with marks of missed targets, false targets and switches.

A state can have a shape around it: a box, an ellipse of its covariance, or an interval if one axis
is the time. A picture of an association (the command ``associate`` pairs the states of two sensors)
also has gates: ellipses in which the partner of a state can be. A second panel enlarges the
surroundings of the assigned pair with the largest distance. A *side* is the truth or the estimate.
"""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.show.draw_over_time import time_axis
from tgospa_eval.show.figure_tools import boxes as corners
from tgospa_eval.show.figure_tools import figure, legend, literal, titled
from tgospa_eval.show.plot_data import (
    NONE,
    TIME,
    PlotData,
    SideData,
    deviations,
    is_box,
    is_map,
    map_stretch,
    plane_columns,
    with_centres,
)
from tgospa_eval.show.style import FALSE, INK, MISSED, SOFT, TRACK_COLOURS, Style
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.trajectories import Trajectories

FEW = 30
"""Largest number of trajectories that have shapes along them. More shapes would hide each other."""

CORNERS = 48
"""Number of corners with which an ellipse is drawn."""

SPACING = 2.0
"""Distance between two shapes of a trajectory, relative to the size of the larger one."""

STEPS = 2
"""Number of steps that the enlarged part shows before its pair, and number of steps after it."""

INTERVALS = 24
"""Number of shapes along a trajectory if one axis is the time."""

WINDOW = 3.0
"""Largest distance of a state from the middle of the enlarged part, relative to the median size of
an ellipse."""

SIDES: tuple[Literal["left", "right"], ...] = ("left", "right")

FEW_DOTS = 5000
"""Largest number of particles that stay shapes in vector files; more are drawn as pixels."""

NO_ROWS = np.zeros(0, np.int64)

SPECK = 2.0
"""Area of a particle of mean weight, in square points; it is doubled in the enlarged part."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Plane:
    """Data of a picture of the plane, columns of its horizontal and vertical axis, and style."""

    data: PlotData
    across: str
    up: str
    style: Style

    @property
    def timed(self) -> bool:
        """True if one of the two columns is the time."""
        return TIME in (self.across, self.up)

    @cached_property
    def places(self) -> dict[str, Floats]:
        """Coordinates (2, R) of the R states of a side, for each side that has states."""
        return {n: np.stack([a[self.across], a[self.up]]) for n, a in self.data.axes.items() if a}

    def spanned(self, packed: Floats, radius: float) -> Floats:
        """Return the sizes (3, R) of R ellipses in the plane, as `ellipses` expects them.

        `packed` has the lower triangle of a covariance C for each ellipse. The ellipse is the
        outline of all z with z' C^-1 z = radius^2. If one axis is the time, the ellipse becomes an
        interval on the other axis. If C lacks a column of the plane, all sizes are 0.
        """
        spans, columns = np.zeros((3, len(packed))), self.data.document["columns"]
        odd = {self.across, self.up} - {*columns, TIME}  # centres of boxes are no state columns
        if odd or self.across == self.up or not packed.shape[1]:
            return spans
        index = {k: columns.index(n) for k, n in enumerate((self.across, self.up)) if n != TIME}
        for k, i in index.items():
            spans[k] = radius * deviations(packed[:, i * (i + 3) // 2])
        if not self.timed:
            i, j = max(index.values()), min(index.values())
            spans[2] = radius**2 * packed[:, i * (i + 1) // 2 + j]
        return spans

    @cached_property
    def extents(self) -> dict[str, Floats]:
        """Sizes (3, R) of the shapes around the R states of each side, 0 without a shape.

        The sizes of a box are half its width, half its height, and 0. Boxes have shapes only if the
        axes are left and top, or centre x and centre y.
        """
        data = self.data
        if not data.document["boxes"]:
            radius = data.document["spread"].get("radius", (0.0, 0.0))[not self.timed]
            return {side.name: self.spanned(side.row["spread"], radius) for side in data.sides}
        known = (self.across, self.up) in (("left", "top"), ("centre x", "centre y"))
        halves = {
            n: (a["width"] * known / 2, a["height"] * known / 2) for n, a in data.axes.items()
        }
        return {name: np.stack([*both, np.zeros(len(both[0]))]) for name, both in halves.items()}

    @cached_property
    def gates(self) -> Floats | None:
        """Sizes (3, R) of the gates around the states of the first side; None without gates."""
        gate = self.data.truth.row.get("gate")
        return None if gate is None else self.spanned(gate, 1.0)

    def around(self, side: SideData, among: Ints | None = None) -> Ints:
        """Return the rows of a side that have a shape. `among` restricts them to some rows."""
        reach = self.extents[side.name][:2].max(axis=0)
        return np.flatnonzero(reach > 0) if among is None else among[reach[among] > 0]

    def outlines(self, side: SideData, row: Ints) -> Floats:
        """Return the outlines (K, corners, 2) of the shapes around K states."""
        sizes = self.extents[side.name][:, row]
        if not self.data.document["boxes"]:
            return ellipses(self.places[side.name][:, row], sizes)
        left, top = (self.data.axes[side.name][edge][row] for edge in ("left", "top"))
        return corners(left, left + 2 * sizes[0], top, top + 2 * sizes[1])


def ellipses(middle: Floats, sizes: Floats, power: float = 2.0) -> Floats:
    """Return the outlines (K, corners, 2) of K ellipses.

    Parameters
    ----------
    middle : (2, K) float array
        Middle of each ellipse.
    sizes : (3, K) float array
        s, t and q of each ellipse. They form the matrix C = [s^2, q; q, t^2]. The ellipse is the
        outline of all z with z' C^-1 z = 1. With r = q / (s t), its points are
        (s cos u, t sin(u + arcsin r)) for 0 <= u < 2 pi.
    power : float
        Order of the norm whose unit ball is drawn, 2 for ellipses. For other norms, q must be 0,
        and both coordinates of the points are divided by the norm of (cos u, sin u).
    """
    s, t, shared = sizes[..., None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = np.nan_to_num(np.arcsin(np.clip(shared / s / t, -1, 1)))
    u = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    size = 1 if power == 2 else np.linalg.norm([np.cos(u), np.sin(u)], ord=power, axis=0)
    x = middle[0][:, None] + s * np.cos(u) / size
    return np.stack([x, middle[1][:, None] + t * np.sin(u + turn) / size], axis=2)


def surroundings(
    axis: Axes, plane: Plane, rows: dict[str, Ints], speck: float
) -> dict[str, Artist]:
    """Draw the shapes and particles of states; return entries of the legend.

    `rows` are the states of each side, and `speck` is the area of a particle of mean weight. A note
    in the corner tells how many of the shapes, and how many of the particles, are drawn.
    """
    handles: dict[str, Artist] = {}
    counts: list[str] = []
    large = plane.style.titles
    what = "interval" if plane.timed else "ellipse"
    kind, name = ("boxes", "box") if plane.data.document["boxes"] else (f"{what}s", f"95 % {what}")
    for side in plane.data.sides:
        row, word, truth = rows[side.name], plane.data.word(side.name), side.name == "truth"
        if not len(row):
            continue
        colours = np.array(TRACK_COLOURS)[side.row["track"] % len(TRACK_COLOURS)]
        looks: dict[str, Any] = {"facecolors": "none", "edgecolors": INK if truth else colours[row]}
        looks |= {"linewidths": 0.9 if large else 0.5, "zorder": 2.15 if plane.timed else 2.3}
        looks |= {"linestyles": (0, (4, 2)) if truth else "-", "label": f"{side.name}/shapes"}
        made = PolyCollection(list(plane.outlines(side, row)), **looks)
        axis.add_collection(made)
        handles[f"{name}, {word}"] = made
        counts.append(f"{word}: {len(row):,} of {len(plane.around(side)):,} {kind}")
        particles = side.particles
        at = np.flatnonzero(np.isin(particles["row"], row))
        if not len(at):
            continue
        own = particles["row"][at]
        place = plane.data.places(particles["state"][at], side.row["step"][own])
        count = np.bincount(own, minlength=len(colours))[
            own
        ]  # number of particles of the cloud; their mean weight is 1 / count
        area = speck * np.clip(particles["weight"][at] * count, 0.05, 20) * (1 if large else 0.4)
        looks = {"color": SOFT if truth else colours[own], "label": f"{side.name}/particles"}
        looks |= {"linewidths": 0, "alpha": 0.5, "zorder": 2.2, "rasterized": len(at) > FEW_DOTS}
        dots = axis.scatter(place[plane.across], place[plane.up], area, **looks)
        handles[f"particles, {word}"] = dots
        total = plane.data.document["particles"][side.name][1]
        counts[-1] += f", {len(at):,} of {total:,} particles, area by weight"
    if counts:
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1, "alpha": 0.8}
        looks = {"ha": "right", "fontsize": "x-small", "color": SOFT, "zorder": 5, "bbox": box}
        looks |= {"xycoords": "axes fraction", "textcoords": "offset points"}
        axis.annotate("; ".join(counts), (1, 0), (-2, 4), **looks)
    return handles


def rows_along(plane: Plane) -> dict[str, Ints]:
    """Return the rows of each side that get shapes, at intervals along the trajectories.

    If there are more than `FEW` trajectories, no rows get shapes.
    """
    chosen: dict[str, Ints] = {}
    for side in plane.data.sides:
        row = plane.around(side) if sum(len(s.ids) for s in plane.data.sides) <= FEW else NO_ROWS
        middle = plane.places[side.name][:, row].T if len(row) else np.zeros((0, 2))
        far = SPACING * plane.extents[side.name][:2, row].max(axis=0, initial=0.0)
        if plane.timed and len(row):
            middle = middle[:, [int(plane.up == TIME)]]
            far = np.full(len(row), np.ptp(middle) / INTERVALS)
        chosen[side.name] = row[spaced(side.row["track"][row], middle, far)]
    return chosen


def rows_enlarged(plane: Plane) -> dict[str, Ints]:
    """Return the rows of each side that the enlarged part of the picture shows.

    The rows are near the assigned pair with the largest distance. Their steps are at most n steps
    before or after the step of the pair. If an axis is the time, n is half of `INTERVALS`.
    Otherwise n is `STEPS`, or 0 if there are gates.

    The result is empty if states are boxes, if there are neither ellipses nor gates, or if there
    are fewer than three states.
    """
    data, gates = plane.data, plane.gates
    reach = {n: sizes[:2].max(axis=0) for n, sizes in plane.extents.items()}
    reach |= {} if gates is None else {"truth": gates[:2].max(axis=0)}
    side = data.estimate if gates is None and (reach["estimate"] > 0).any() else data.truth
    known = np.flatnonzero(reach[side.name] > 0)
    few = sum(len(one.row["step"]) for one in data.sides) < 3
    if data.document["boxes"] or not len(known) or few:
        return {}
    error = np.where(side.row["other"] < 0, -1.0, side.row["error"])
    middle = known[np.argmax(error[known])]
    far = WINDOW * float(np.median(reach[side.name][known]))
    near: dict[str, Ints] = {}
    steps = INTERVALS // 2 if plane.timed else STEPS if gates is None else 0
    for one in data.sides:
        distance = np.abs(plane.places[one.name] - plane.places[side.name][:, [middle]])
        distance[[name == TIME for name in (plane.across, plane.up)]] = 0
        later = np.abs(one.row["step"] - side.row["step"][middle])
        near[one.name] = np.flatnonzero((distance <= far).all(axis=0) & (later <= steps))
    return near


def pairs(plane: Plane, row: Ints) -> Floats:
    """Return lines from estimates to the truths assigned to them.

    `row` has the drawn rows of the estimate. The result (2, 3 K) has three columns for each of K
    pairs: the position of the estimate, that of the truth, and NaN as the end of the line.
    """
    truth, estimate, key = plane.data.truth.row, plane.data.estimate.row, plane.data.steps + 1
    keys = np.append(truth["track"] * key + truth["step"], NONE)
    wanted = estimate["other"][row] * key + estimate["step"][row]
    at = np.searchsorted(keys[:-1], wanted)
    row, at = row[keys[at] == wanted], at[keys[at] == wanted]
    ends = plane.places["estimate"][:, row], plane.places["truth"][:, at]
    return np.stack([*ends, np.full((2, len(at)), np.nan)], axis=2).reshape(2, -1)


def spaced(track: Ints, middle: Floats, reach: Floats) -> Ints:
    """Return rows of each track that are not too near each other.

    The first row of a track is returned. A later row is returned if its distance to the last
    returned row is larger than the `reach` of each of these two rows.
    """
    kept = []
    last = -1
    for k in range(len(track)):
        new = last < 0 or track[last] != track[k]
        if new or np.abs(middle[k] - middle[last]).max() > max(reach[last], reach[k]):
            kept.append(k)
            last = k
    return np.array(kept, np.int64)


VECTOR_POINTS = 40_000
"""Largest number of points of lines that stay lines in vector files; more are drawn as pixels."""

CROWDED = 400
"""Number of events above which marks become smaller."""

GROUPED = 1500
"""Number of events above which neighbouring events of a kind share one mark."""

CELLS = 48
"""Number of cells along each axis. In each cell, all events of a kind share one mark."""

COVERED = 0.08
"""Largest share of the picture that marks of one kind can cover. With more, they would overlap."""

MANY_TRACKS = 100
"""Number of trajectories above which lines are fainter, so that marks stand out."""

FADED = 0.35
"""Opacity of the lines in the enlarged part of the picture."""

STRETCH = 8
"""Largest factor between the lengths of two axes of the same scale. If it would be larger, the axes
have different scales."""


MARKS: dict[str, dict[str, Any]] = {
    "missed": {"marker": "x", "color": MISSED},
    "false": {"marker": "^", "color": FALSE, "markerfacecolor": "none"},
}
"""Looks of the marks of missed and false states."""

Mark = tuple[str, Floats, Floats, dict[str, Any]]
"""All marks of one kind of event: name of the kind, x coordinates, y coordinates, and looks."""


def draw_plane(data: PlotData, style: Style, columns: Sequence[str] | None = None) -> Figure:
    """Draw trajectories with missed targets, false targets and switches."""
    boxes = data.document["boxes"]
    across, up = plane_columns(data.document["columns"], columns)
    plane = Plane(data=data, across=across, up=up, style=style)
    places = plane.places
    sides = [side for side in data.sides if side.name in places]
    extent = [_extent([pair[k] for pair in places.values()]) for k in (0, 1)]
    scale = unit_scale(across, up, data.document.get("stretch", 1.0))
    if scale is not None and not 1 / STRETCH <= scale * extent[1] / extent[0] <= STRETCH:
        scale = None
    ratio = 0.62 if scale is None else scale * extent[1] / extent[0]
    max_ratio = 1.0 if style.titles else 0.6 if style.wide else 0.95
    tall = min(max(ratio, 0.45), max_ratio) * (style.width - 1.0) + 0.9
    enlarged = rows_enlarged(plane) if sides else {}
    low = 0.55 * style.width
    made, axes = figure(style.width, tall + low * bool(enlarged), 1 + bool(enlarged))
    axis = axes[0, 0]
    handles: dict[str, Artist] = {}
    many = sum(len(side.row["track"]) for side in sides) > VECTOR_POINTS
    for panel in axes[::-1, 0]:
        if scale is not None:
            panel.set_aspect(scale, adjustable="datalim")
        for side in sides:
            fade = 1.0 if panel is axis else FADED
            handles |= _lines(panel, side, places[side.name], style, data, many, fade)
    if sides:
        handles |= surroundings(axis, plane, rows_along(plane), SPECK)
    if data.document["words"]:  # an association: there are lines between partners
        line = pairs(plane, np.arange(len(data.estimate.row["step"])))
        looks: dict[str, Any] = {"color": INK, "linewidth": 0.8, "zorder": 2.8, "label": "pairs"}
        handles["pair"] = axis.plot(*line, **looks)[0]
    handles |= _events(axis, data, places, style)
    axis.autoscale_view()
    _ends(axis, plane, sides, (style.width - 1.0, tall - 0.9), extent)
    if enlarged:
        axis.get_gridspec().set_height_ratios([tall, low])
        handles |= _enlarged(axes[1, 0], plane, enlarged)
    for panel in axes[:, 0]:
        _name_axes(panel, plane)
    if boxes and up in ("top", "centre y"):
        axis.invert_yaxis()
    if not sides or not sum(len(side.row["track"]) for side in sides):
        axis.annotate("no positions", (0.5, 0.5), xycoords="axes fraction", ha="center")
    titled(axis, style, "Trajectories", data.about)
    fits = len(handles) <= 5 and sum(map(len, handles)) < 16 * style.width
    beside = 7 if style.wide else 5 if fits else -(-len(handles) // 2)
    # With an enlarged part, the legend has longer names.
    beside = min(beside, 5 if style.wide else 3) if enlarged else beside
    legend(made, list(handles.values()), list(handles), beside)
    return made


def _name_axes(axis: Axes, plane: Plane) -> None:
    """Write the names of both axes."""
    for name, which, upright in ((plane.across, axis.xaxis, False), (plane.up, axis.yaxis, True)):
        if name == TIME:
            time_axis(axis, plane.data, plane.style, upright=upright)
        else:
            which.set_label_text(_named(name, plane.data.document["unit"]), parse_math=False)


def _enlarged(axis: Axes, plane: Plane, rows: dict[str, Ints]) -> dict[str, Artist]:
    """Draw the enlarged part: states, shapes around states, and lines between assigned pairs."""
    data, place = plane.data, plane.places
    around = {side.name: plane.around(side, rows[side.name]) for side in data.sides}
    handles = surroundings(axis, plane, around, 2 * SPECK)
    size = 4.0 if plane.style.titles else 2.5
    dot: dict[str, Any] = {"linestyle": "none", "markersize": size, "markeredgewidth": size / 6}
    for side, fill, mark in zip(data.sides, ("none", INK), MARKS.values(), strict=True):
        row = rows[side.name]
        unassigned = side.row["other"][row] == NONE
        looks = dot | {"label": f"{side.name}/states", "zorder": 3, "color": INK}
        looks |= {"marker": "o", "markerfacecolor": fill}
        axis.plot(*place[side.name][:, row[~unassigned]], **looks)
        axis.plot(*place[side.name][:, row[unassigned]], **(looks | mark))
    line = pairs(plane, rows["estimate"])
    axis.plot(*line, color=INK, linewidth=0.8, zorder=2.9)
    points = [place[side.name][:, rows[side.name]].T for side in data.sides]
    points += [plane.outlines(side, around[side.name]).reshape(-1, 2) for side in data.sides]
    if plane.gates is not None:
        row, power = rows["truth"], data.document["gate"]["power"] or np.inf
        gates = ellipses(place["truth"][:, row], plane.gates[:, row], power)
        looks = {"facecolors": "none", "edgecolors": MISSED, "linestyles": ":", "linewidths": 1}
        made = PolyCollection(list(gates), label="gates", **looks)
        axis.add_collection(made)
        handles[f"gate of {data.word('truth')}"] = made
        points.append(gates.reshape(-1, 2))
    steps = np.concatenate([side.row["step"][rows[side.name]] for side in data.sides])
    begin, end = (str(data.document["times"][k]) for k in (steps.min(), steps.max()))
    span = begin if begin == end else f"{begin} to {end}"
    what = "farthest pair" if (data.truth.row["other"] >= 0).any() else "first state"
    titled(axis, plane.style, f"Around the {what}, t = {literal(span, 50)}")
    # Limits are set last, and with auto=True, so that matplotlib can widen them for equal scales.
    low, high = (end(np.concatenate([line.T, *points]), axis=0) for end in (np.nanmin, np.nanmax))
    margin = 0.05 * np.where(high > low, high - low, 1.0)
    axis.set_xlim(low[0] - margin[0], high[0] + margin[0], auto=True)
    axis.set_ylim(low[1] - margin[1], high[1] + margin[1], auto=True)
    return handles


def _extent(values: list[Floats]) -> float:
    known = np.concatenate([*values, np.zeros(0)])
    return float(np.ptp(known)) if len(known) and np.ptp(known) > 0 else 1.0


def unit_scale(across: str, up: str, stretch: float) -> float | None:
    """Return the length of a unit of the vertical axis, divided by that of the horizontal axis.

    The result is None if the axes cannot share a scale: one is the time, or only one is an angle on
    the Earth. `stretch` is the result of `map_stretch`.
    """
    if TIME in (across, up) or len({across, up} & {"lat", "lon"}) == 1:
        return None
    return {("lon", "lat"): stretch, ("lat", "lon"): 1 / stretch}.get((across, up), 1.0)


def _lines(
    axis: Axes,
    side: SideData,
    place: Floats,
    style: Style,
    data: PlotData,
    many: bool,
    fade: float,
) -> dict[str, Artist]:
    """Draw a line through consecutive states of a track, and a dot at a state without neighbours.

    Tracks of the estimate have the colours of `TRACK_COLOURS` in turn.
    """
    row, truth = side.row, side.name == "truth"
    if not len(row["track"]):
        return {}
    thin = style.settings.get("lines.linewidth", 1.3)
    separate = (np.diff(row["track"]) != 0) | (np.diff(row["step"]) > data.document["stride"])
    breaks = np.flatnonzero(separate) + 1
    single = np.zeros(len(row["track"]), bool)  # states that get a dot
    single[np.append(0, breaks)[np.diff(np.concatenate([[0], breaks, [len(single)]])) == 1]] = True
    # All tracks of a colour are one line with gaps: a thousand lines would take seconds.
    x, y = (np.insert(values, breaks, np.nan) for values in place)
    colour = np.insert(row["track"] % len(TRACK_COLOURS), breaks, -1)
    looks: dict[str, Any] = {
        "linestyle": (0, (4, 2)) if truth and not many else "-",
        "linewidth": thin * (0.7 if truth else 1.0) * (0.5 if many else 1),
        "alpha": min(1.0, (MANY_TRACKS / len(side.ids)) ** 0.5) * (0.7 if many else 1) * fade,
        "zorder": 2 if truth else 2.1,
    }
    dot: dict[str, Any] = {"marker": ".", "linestyle": "none", "markersize": 2.5 * thin}
    dot |= {"zorder": 2.1, "label": f"{side.name}/single"}
    handles: dict[str, Artist] = {}
    for turn, shade in enumerate([SOFT] if truth else TRACK_COLOURS):
        shown = truth | (colour == turn) | (colour == -1)
        both: Any = {"color": shade, "rasterized": many}
        line = axis.plot(x[shown], y[shown], label=f"{side.name}/{turn}", **both, **looks)[0]
        dots = single & (truth | (row["track"] % len(TRACK_COLOURS) == turn))
        if dots.any():
            axis.plot(*(values[dots] for values in place), **both, **dot)
        handles.setdefault(data.word(side.name), line)
    return handles


def _ends(
    axis: Axes,
    plane: Plane,
    sides: Sequence[SideData],
    inches: tuple[float, float],
    extent: Sequence[float],
) -> None:
    """Draw the ids of tracks, and arrowheads at their ends; no arrowheads if an axis is the time.

    Ids of the truth are at the first states, ids of the estimate at the last states. If there are
    many tracks, only the costliest have arrowheads and ids. Ids that would overlap are left out.
    `inches` is the size of the axes. `extent` has the range of both axes, in their units.
    """
    letters = 0.8 * float(axis.xaxis.label.get_fontsize())
    scale = 72 * np.array(inches) / extent  # points per unit
    taken: list[tuple[Floats, Floats]] = []
    for side in sides:
        place, truth = plane.places[side.name], side.name == "truth"
        ends = [np.searchsorted(side.row["track"], np.arange(len(side.ids)), at) for at in SIDES]
        cost = np.asarray(side.table["total"], float)
        known = [k for k in np.argsort(-cost, kind="stable") if ends[0][k] < ends[1][k]]
        for k in known[:NAMED]:
            first, last = ends[0][k], ends[1][k] - 1
            colour = SOFT if truth else TRACK_COLOURS[k % len(TRACK_COLOURS)]
            # The arrow has the direction of the last three steps: one step has too much noise.
            before = place[:, max(first, last - 3)]
            if not plane.timed and (before != place[:, last]).any():
                arrow = {"arrowstyle": "-|>", "color": colour, "shrinkA": 0, "shrinkB": 0}
                arrow |= {"linewidth": 0, "mutation_scale": 1.4 * letters}
                ends_at = (*place[:, last],), (*before,)
                axis.annotate("", *ends_at, arrowprops=arrow).set_in_layout(False)
            name = literal(side.ids[k], 10)
            room = np.array([0.62 * letters * len(name), letters])
            low = place[:, first if truth else last] * scale + (3, 3)
            if any((low < b).all() and (low + room > a).all() for a, b in taken):
                continue
            taken.append((low, low + room))
            looks: dict[str, Any] = {"fontsize": letters, "color": colour, "parse_math": False}
            looks |= {"xytext": (3, 3), "textcoords": "offset points", "zorder": 4}
            looks["path_effects"] = [withStroke(linewidth=1.5, foreground="white")]
            at = (*place[:, first if truth else last],)
            axis.annotate(name, at, **looks).set_in_layout(False)


def _events(
    axis: Axes, data: PlotData, places: dict[str, Floats], style: Style
) -> dict[str, Artist]:
    """Draw crosses, triangles and diamonds at missed targets, false targets and switches."""
    marks: list[Mark] = []
    for side, (name, looks) in zip(data.sides, MARKS.items(), strict=True):
        if side.name in places:
            x, y = places[side.name]
            marks.append((name, x[side.unassigned], y[side.unassigned], looks))
    if "truth" in places and len(places["truth"][0]):
        row = rows_of_switches(data)
        diamond: dict[str, Any] = {"marker": "D", "color": INK, "zorder": 4}
        if len(row) < CROWDED:
            diamond["markeredgecolor"] = "white"
        marks.append(("switch", places["truth"][0][row], places["truth"][1][row], diamond))
    count = sum(len(x) for _, x, _, _ in marks)
    if count > GROUPED:
        return _grouped(axis, data, marks, style)
    size = (5.0 if style.titles else 3.2) * max(0.35, 1 - 0.4 * math.log10(max(count / CROWDED, 1)))
    common = {"linestyle": "none", "markersize": size, "markeredgewidth": size / 6, "zorder": 3}
    common["rasterized"] = count > VECTOR_POINTS // 8
    return {
        data.word(name): axis.plot(x, y, label=name, **{**common, **looks})[0]
        for name, x, y, looks in marks
        if len(x)
    }


def _grouped(axis: Axes, data: PlotData, marks: list[Mark], style: Style) -> dict[str, Artist]:
    """Draw a mark for each kind and place; its area shows the number of events there."""
    wide = _extent([x for _, x, _, _ in marks]) / CELLS
    tall = _extent([y for _, _, y, _ in marks]) / CELLS
    groups = {name: _near(x, y, wide, tall) for name, x, y, _ in marks if len(x)}
    highest = max(int(count.max()) for _, _, count in groups.values())
    whole = ((style.width - 1.0) * 72) ** 2
    busiest = max(int(count.sum()) for _, _, count in groups.values())
    largest = min(1.1 * whole / CELLS**2, COVERED * whole * highest / busiest)
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
        area = np.maximum(largest * count / highest, largest / 40)
        made = axis.scatter(x, y, area, label=name, **looks)
        handles[f"{data.word(name)}, {count.min():,} to {count.max():,}"] = made
    return handles


def _near(x: Floats, y: Floats, wide: float, tall: float) -> tuple[Floats, Floats, Ints]:
    """Divide the plane into cells; return mean x, mean y and number of points of each used cell."""
    cells = np.stack([np.floor(x / wide), np.floor(y / tall)], axis=1)
    _, cell, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    cell = cell.reshape(-1)  # NumPy 2.0 returns it with two axes
    middle = [np.bincount(cell, weights=values) / count for values in (x, y)]
    return middle[0], middle[1], count


def rows_of_switches(data: PlotData) -> Ints:
    """Return, for each switch, the last row of its object at or before the step of the switch."""
    key = data.steps + 1
    row, switches = data.truth.row, data.switches
    wanted = switches["truth"].astype(np.int64) * key + switches["step"].astype(np.int64)
    before = np.searchsorted(row["track"] * key + row["step"], wanted, side="right") - 1
    return np.asarray(np.maximum(before, 0))


# -------------------------------------------------------------------------------------------------
# Data as read, without an evaluation: trajectories in the plane, and over time.

LOOKS = (
    {"color": SOFT, "linewidth": 2.2, "alpha": 0.55},
    {"color": FALSE, "linewidth": 0.9},
)
"""Looks of the lines of truth and estimate. Wide lines of the truth are visible under those of the
estimate."""

NAMED = 30
"""Largest number of trajectories whose ids are written.

In a picture of a result, this limit holds for each side separately."""

PRESENCE = "trajectory"
"""Name of the vertical axis in the panel over time. Each trajectory is a line in this panel."""


def draw_inspection(
    subject: tuple[Sequence[tuple[str, Trajectories]], str],
    style: Style,
) -> Figure:
    """Draw two panels: one with trajectories in the plane, one with their times as lines.

    `subject` has a sequence, and the unit of the states. The sequence has the name and the
    trajectories of the truth, and possibly of an estimate. If the style is narrow, one panel is
    above the other.
    """
    sides, unit = subject
    columns = sides[0][1].columns
    boxes, stretch = is_box(columns), 1.0
    across, up = plane_columns(columns, None)
    if is_map(columns):
        latitudes = [side.state[:, columns.index("lat")] for _, side in sides]
        stretch = map_stretch(np.concatenate(latitudes))
    timed = [side for _, side in sides if len(side.times)]
    first = min(timed, key=lambda side: side.times[0], default=sides[0][1])
    beside = 1 + style.wide
    made, panels = figure(style.width, 2.9 * style.low / beside, 3 - beside, beside)
    plane, presence = panels.flat
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


def _name(axis: Axes, across: str, up: str) -> None:
    axis.xaxis.set_label_text(across, parse_math=False)
    axis.yaxis.set_label_text(up, parse_math=False)
    for spine in ("left", "bottom"):
        axis.spines[spine].set_color(INK)
