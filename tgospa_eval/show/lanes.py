"""Swim-lanes: who followed whom. A lane for each truth, below them estimates with false steps."""

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.text import Text

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.show.drawing import boxes, figure, legend, literal, stairs, titled
from tgospa_eval.show.overtime import MARGIN, time_axis
from tgospa_eval.show.plot_data import FREE, NONE, DrawnSide, PlotData
from tgospa_eval.show.style import (
    FALSE,
    FILLS,
    INK,
    MISSED,
    NOT_JUDGED,
    SOFT,
    TRACK_COLOURS,
    Style,
)

VECTOR_SHAPES = 4000
"""Shapes of a kind that are drawn as such in vector files; more become dots."""

MOST_NAMES = 400
"""Most names inside the lanes."""

HALF = 0.4
"""Half the height of a bar; lanes are 1 apart."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lanes:
    """Which tracks of a side have a lane, and where.

    Parameters
    ----------
    side : DrawnSide
        The tracks.
    tracks : (L,) int array
        Those with a lane of their own, from above.
    others : (K,) int array
        Those that share the last lane.
    first : int
        Place of the first lane; the words stand above it.
    """

    side: DrawnSide
    tracks: Ints
    others: Ints
    first: int

    @property
    def end(self) -> int:
        """Place below the last lane."""
        return self.first + len(self.tracks) + bool(len(self.others))

    @property
    def title(self) -> str:
        """The words above."""
        count = len(self.tracks) + len(self.others)
        word = self.side.name + ("" if count == 1 else "s")
        return f"{count:,} {word}" + ("" if self.side.name == "truth" else " with false steps")

    def place(self, track: Ints) -> Floats:
        """Where lanes are; not a number for tracks without one of their own."""
        places = np.full(len(self.side.ids), np.nan)
        places[self.tracks] = self.first + np.arange(len(self.tracks))
        return places[track]


def draw_lanes(seen: PlotData, style: Style) -> Figure:
    """A lane for each truth, and lanes of false tracks below."""
    truths = arranged(seen.truth, np.arange(len(seen.truth.ids)), style.lanes, 1)
    wrong = np.flatnonzero(np.asarray(seen.estimate.table["unassigned_count"], float) > 0)
    estimates = arranged(seen.estimate, wrong, style.lanes // 2, truths.end + 1)
    count = max(estimates.end, 3)
    tall = (0.2 if count < 50 else 0.15) * (1.0 if style.titles else 0.62)
    made, ((axis,),) = figure(style.width, 0.85 * (style.low / 2.9) ** 0.5 + tall * count)
    axis.grid(visible=False, axis="y")
    axis.set_ylim(count - 0.3, -0.5)
    letters = min(72 * tall * 0.62, axis.xaxis.label.get_fontsize())
    columns = min(max(seen.steps, 1), style.bars)
    # the least that is seen
    pixel = (
        (seen.time.edges[1][-1] - seen.time.edges[0][0] if seen.steps else 1) / _room(style) * 0.8
    )
    if seen.steps > columns:
        _shares(axis, truths, seen, columns, MISSED)
        _shares(axis, estimates, seen, columns, FALSE)
    handles = _bars(axis, truths, seen, style, pixel=pixel, whole=seen.steps <= columns)
    handles |= _bars(axis, estimates, seen, style, pixel=pixel, whole=seen.steps <= columns)
    _errors(axis, truths, seen, columns)
    for lanes in (truths, estimates):
        _others(axis, lanes, seen, columns)
        _names(axis, lanes, seen, letters, _room(style))
        if lanes.side.name == "truth" or len(lanes.tracks):
            words: Any = {"fontsize": letters, "fontweight": "bold", "color": SOFT, "va": "center"}
            at, of = (0.004, lanes.first - 0.95), ("axes fraction", "data")
            axis.annotate(lanes.title, at, xycoords=of, **words)
    handles |= _switches(axis, truths, seen, style, columns)
    _ids(axis, (truths, estimates), letters)
    time_axis(axis, seen, style)
    titled(axis, style, "Who followed whom", seen.about)
    legend(made, list(handles.values()), list(handles), 4 if style.titles else 2)
    return made


def arranged(side: DrawnSide, tracks: Ints, most: int, first: int) -> Lanes:
    """Lanes in the order of the files; of too many the costliest."""
    if len(tracks) <= most:
        return Lanes(side=side, tracks=tracks, others=tracks[:0], first=first)
    cost = np.asarray(side.table["total"], float)[tracks]
    order = np.argsort(-cost, kind="stable")
    return Lanes(
        side=side,
        tracks=np.sort(tracks[order[: most - 1]]),
        others=np.sort(tracks[order[most - 1 :]]),
        first=first,
    )


def _put(axis: Axes, corners: Floats, name: str, **looks: Any) -> PolyCollection:
    """One collection; what is too much for a vector file becomes dots there."""
    polygons: Any = corners  # as an array: ten times as fast as a list
    made = PolyCollection(polygons, label=name, **looks)
    made.set_rasterized(len(corners) > VECTOR_SHAPES)
    made.set_in_layout(False)  # it lies inside the axes, and to find that out takes long
    axis.add_collection(made, autolim=False)
    return made


def _bars(
    axis: Axes, lanes: Lanes, seen: PlotData, style: Style, *, pixel: float, whole: bool
) -> dict[str, Artist]:
    """Stretches that are assigned, and as frames those that are not; returns entries of a legend.

    Where there are more steps than can be distinguished, `whole` is false, and those that are not
    are shown by `_shares`.
    """
    run, truth = lanes.side.run, lanes.side.name == "truth"
    place = place_of = lanes.place(run["track"])
    begin, end = seen.time.edges[0][run["begin"]], seen.time.edges[1][run["end"]]
    held = ~np.isnan(place) & (run["other"] >= 0)
    half = HALF if truth else 0.14
    track = run["other"] if truth else run["track"]
    thin = 0.6 if style.titles else 0.3
    handles: dict[str, Artist] = {}
    if held.any():
        corners = boxes(begin[held], end[held], place[held] - half, place[held] + half)
        colours = np.array(TRACK_COLOURS)[track[held] % len(TRACK_COLOURS)]
        looks = {"edgecolors": SOFT if whole else "none", "linewidths": thin / 2}
        bars = _put(axis, corners, f"{lanes.side.name}/assigned", facecolors=colours, **looks)
        if truth:
            handles["assigned, foot: error / c"] = bars
    kind = "missed" if truth else "false"
    unassigned = ~np.isnan(place) & (run["other"] == NONE)
    if whole and unassigned.any():
        begin, end, place = begin[unassigned], end[unassigned], place[unassigned]
        short = np.maximum(pixel - (end - begin), 0) / 2
        corners = boxes(begin - short, end + short, place - 0.3, place + 0.3)
        name = f"{lanes.side.name}/{kind}"
        handles[kind] = _put(axis, corners, name, linewidths=thin, **FILLS[kind])
    elif unassigned.any():
        handles[f"share of steps {kind}"] = Patch(facecolor=MISSED if truth else FALSE)
    free = np.isfinite(place_of) & run.get("unjudged", run["other"] == FREE).astype(bool)
    if free.any():
        edges = seen.time.edges[0][run["begin"][free]], seen.time.edges[1][run["end"][free]]
        corners = boxes(*edges, place_of[free] - half, place_of[free] + half)
        name = f"{lanes.side.name}/not judged"
        handles["not judged"] = _put(axis, corners, name, linewidths=0, zorder=2.3, **NOT_JUDGED)
    return handles


def _room(style: Style) -> float:
    """Points across the lanes, about."""
    return (style.width - MARGIN) * 72


def _columns(step: Ints, columns: int, steps: int) -> Ints:
    """Of each step the column in which it is drawn."""
    return step * columns // max(steps, 1)


def _column_edges(seen: PlotData, columns: int) -> tuple[Floats, Floats]:
    """Where each column begins and ends."""
    first = -(-np.arange(columns + 1) * seen.steps // columns)
    begin, end = seen.time.edges
    return begin[first[:-1]], end[first[1:] - 1]


def _unassigned(lanes: Lanes, chosen: Floats) -> tuple[Ints, Ints]:
    """Lane and step of all that is unassigned, of lanes that are a number."""
    run = lanes.side.run
    kept = np.flatnonzero((run["other"] == NONE) & ~np.isnan(chosen))
    length = run["end"][kept] - run["begin"][kept] + 1
    first = np.repeat(run["begin"][kept] - np.cumsum(length) + length, length)
    return np.repeat(chosen[kept], length).astype(np.int64), first + np.arange(length.sum())


def _shares(axis: Axes, lanes: Lanes, seen: PlotData, columns: int, colour: str) -> None:
    """What hangs from the top of a lane: the share of the steps of a column that are wrong."""
    lane, step = _unassigned(lanes, lanes.place(lanes.side.run["track"]))
    if not len(lane):
        return
    cells = lane * columns + _columns(step, columns, seen.steps)
    cell, count = np.unique(cells, return_counts=True)
    wide = seen.steps / columns
    tall = np.clip(count / wide, 0.2, 1.0) * 2 * HALF
    begin, end = _column_edges(seen, columns)
    left, right, top = begin[cell % columns], end[cell % columns], cell // columns - HALF
    looks = {"facecolors": colour, "edgecolors": colour, "linewidths": 0.1, "zorder": 2.2}
    _put(axis, boxes(left, right, top, top + tall), f"{lanes.side.name}/share", **looks)


def _errors(axis: Axes, lanes: Lanes, seen: PlotData, columns: int) -> None:
    """Error as a share of the cutoff: a darker foot of the bar, the largest of each column."""
    row = lanes.side.row
    place = lanes.place(row["track"])
    kept = np.flatnonzero((row["other"] >= 0) & ~np.isnan(place))
    if not len(kept):
        return
    column = _columns(row["step"][kept], columns, seen.steps)
    cell, back = np.unique(place[kept].astype(np.int64) * columns + column, return_inverse=True)
    tall = np.zeros(len(cell))
    np.maximum.at(tall, back, row["error"][kept] * 2 * HALF)
    begin, end = _column_edges(seen, columns)
    left, right, low = begin[cell % columns], end[cell % columns], cell // columns + HALF
    # As one outline for each cell, which is a fraction of a bar.
    looks = {"facecolors": "black", "alpha": 0.25, "linewidths": 0}
    _put(axis, boxes(left, right, low - tall, low), "truth/error", **looks)


def _others(axis: Axes, lanes: Lanes, seen: PlotData, columns: int) -> None:
    """The last lane: how many of the tracks without a lane of their own are wrong, as a height."""
    if not len(lanes.others):
        return
    chosen = np.full(len(lanes.side.ids), np.nan)
    chosen[lanes.others] = 0
    _, step = _unassigned(lanes, chosen[lanes.side.run["track"]])
    count = np.bincount(_columns(step, columns, seen.steps), minlength=columns).astype(float)
    most = count.max(initial=0.0) or 1.0
    begin, end = _column_edges(seen, columns)
    low = lanes.end - 1 + HALF
    # What is wrong at all is seen.
    height = np.where(count > 0, np.maximum(count / most, 0.15), 0.0) * 2 * HALF
    name, colour = lanes.side.name, MISSED if lanes.side.name == "truth" else FALSE
    top, places = low - height, np.append(begin, end[-1])
    looks = {"facecolor": colour, "linewidth": 0, "label": f"{name}/others"}
    stairs(axis, top, places, baseline=low, **looks)


def _seen_switches(place: Floats, switches: dict[str, Ints], columns: int, steps: int) -> Ints:
    """One of those that would lie on each other in a column of a lane: the largest, the first."""
    if steps <= columns:
        return np.arange(len(place))
    cell = place.astype(np.int64) * columns + _columns(switches["step"], columns, steps)
    order = np.lexsort((switches["step"], -switches["mass"], cell))
    return np.sort(order[np.unique(cell[order], return_index=True)[1]])


def _switches(
    axis: Axes, truths: Lanes, seen: PlotData, style: Style, columns: int
) -> dict[str, Artist]:
    """Triangles at the top of the lanes; small ones for parts of a switch."""
    switches = seen.switches
    if not len(switches["step"]):
        return {}
    place = truths.place(switches["truth"])
    place = np.where(np.isnan(place), truths.end - 1, place)
    many = len(place) > 400
    size = (22.0 if style.titles else 9.0) * (0.5 if many else 1.0)
    looks: dict[str, Any] = {"marker": "v", "color": INK, "edgecolors": "white", "zorder": 4}
    looks |= {"linewidths": 0 if many else 0.3, "clip_on": False}
    kept = _seen_switches(place, switches, columns, seen.steps)
    place, sizes = place[kept], np.where(switches["mass"][kept] >= 0.99, size, size / 2)
    x = seen.time.edges[0][switches["step"][kept]]
    looks["rasterized"] = len(place) > VECTOR_SHAPES
    marks = axis.scatter(x, place - HALF, sizes, label="switch", **looks)
    return {"switch (small: half of one)" if (switches["mass"] < 0.99).any() else "switch": marks}


def _names(axis: Axes, lanes: Lanes, seen: PlotData, letters: float, room: float) -> None:
    """Ids of the other side inside stretches where there is room, the longest first."""
    if letters < 4 or not seen.steps:
        return
    run, truth = lanes.side.run, lanes.side.name == "truth"
    other = seen.estimate if truth else seen.truth
    place = lanes.place(run["track"])
    (begin, end), point = seen.time.edges, (seen.time.edges[1][-1] - seen.time.edges[0][0]) / room
    wide = (end[run["end"]] - begin[run["begin"]]) / point
    held = np.flatnonzero((run["other"] >= 0) & ~np.isnan(place) & (wide > letters))
    looks: dict[str, Any] = {"va": "center_baseline", "color": "white" if truth else INK}
    looks |= {"fontsize": letters, "parse_math": False, "zorder": 3}
    looks["backgroundcolor"] = "none" if truth else "white"
    for k in held[np.argsort(-wide[held], kind="stable")][:MOST_NAMES]:
        name = literal(other.ids[run["other"][k]], 16)
        if len(name) * 0.66 * letters + 3 > wide[k]:
            continue
        text = Text(begin[run["begin"][k]] + 2 * point, place[k], name, **looks)
        text.set_in_layout(False)
        if not truth:
            text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.4})
        axis.add_artist(text)


def _ids(axis: Axes, groups: tuple[Lanes, ...], letters: float) -> None:
    """Names of the lanes."""
    places: list[float] = []
    names: list[str] = []
    for lanes in groups:
        places += list(range(lanes.first, lanes.end))
        names += [literal(lanes.side.ids[track], 14) for track in lanes.tracks]
        names += [f"{len(lanes.others):,} others"] if len(lanes.others) else []
    axis.set_yticks(places, names, fontsize=letters, parse_math=False)
    axis.tick_params(axis="y", length=0)
