"""Pictures over time: stacked cost of each step, cumulative cost, NEES, windows and lanes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.text import Text

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import number
from tgospa_eval.results.records import SPREAD
from tgospa_eval.show.figure_tools import (
    boxes,
    counted,
    figure,
    legend,
    literal,
    power,
    stairs,
    titled,
)
from tgospa_eval.show.plot_data import FREE, KINDS, NONE, PlotData, SideData, binned
from tgospa_eval.show.style import (
    FALSE,
    FILLS,
    INK,
    LIGHT,
    LINES,
    MISSED,
    SOFT,
    TRACK_COLOURS,
    UNJUDGED,
    Style,
    line_looks,
)
from tgospa_eval.show.time_axis import TimeAxis

TINY = 1e-300

MARGIN = 0.8
"""Approximate width of the text left of the axes, in inches."""


def draw_costs(data: PlotData, style: Style, parts: Sequence[str]) -> Figure:
    """Draw the cost of each step as a stacked bar.

    If there are too many steps, a bar stands for several steps. It shows the costliest of them, or
    their mean for data in parts.
    """
    made, ((axis,),) = figure(style.width, style.low)
    costs = {name: np.asarray(data.document["costs"][name], float) for name in parts}
    names = dict(zip(parts, parts, strict=True))
    if SPREAD in data.document["costs"] and "localisation" in costs:
        spread = np.asarray(data.document["costs"][SPREAD], float)
        means = {"localisation": costs["localisation"] - spread, SPREAD: spread}
        costs = means | {name: cost for name, cost in costs.items() if name != "localisation"}
        names |= {"localisation": "means", SPREAD: "spreads"}
    stretch = data.document["together"]
    max_bars = style.bars if stretch == 1 else data.steps
    first, costliest = binned(sum(costs.values(), np.zeros(data.steps)), max_bars)
    begin, end = data.time.edges
    begin, end = begin[first], end[np.append(first[1:], data.steps) - 1] if data.steps else end
    base = np.zeros(len(first))
    handles = []
    # Outlines keep narrow bars visible. A bar without cost has no outline either.
    thin = min(0.8, max(0.25, 15 * style.width / max(len(first), 1)))
    for name, cost in costs.items() if data.steps else ():
        height = np.where(cost[costliest] > 0, cost[costliest], np.nan)
        places, (top, foot) = _with_gaps(begin, end, base + height, base)
        looks = {"linewidth": thin, "label": names[name], **FILLS[name]}
        handles.append(stairs(axis, top, places, baseline=foot, **looks))
        base = base + cost[costliest]
    axis.set_ylim(0, float(base.max(initial=0.0)) * 1.03 or 1.0)
    time_axis(axis, data, style)
    together = first[1] - first[0] if len(first) > 1 else 1
    if together > 1:
        axis.set_xlabel(f"{axis.get_xlabel()}; a bar is the costliest of {together:,} steps")
    if stretch > 1:
        axis.set_xlabel(f"{axis.get_xlabel()}; a bar is the mean of {stretch:,} steps")
    cost_unit = power(data.document["unit"], data.document["order"])
    axis.set_ylabel(f"cost{cost_unit}", parse_math=False)
    titled(axis, style, "Cost of each step", data.about)
    legend(made, handles, [str(bars.get_label()) for bars in handles], 5)
    return made


def draw_nees(data: PlotData, style: Style) -> Figure | None:
    """Draw the NEES of each step and its band.

    For particle clouds, a second panel has a histogram of the rank of the truth in its cloud.
    """
    nees = data.document.get("nees")
    if nees is None:
        return None
    ranks = np.array(nees["ranks"], float)
    made, axes = figure(style.width, style.low * (1 + bool(len(ranks))), rows=1 + bool(len(ranks)))
    axis = axes[0][0]
    value, low, high = (np.array(line, float) for line in nees["lines"].values())
    at, ideal = data.time.at, nees["ideal"]
    handles = [
        axis.fill_between(at, low, high, step="mid", color=LIGHT["grid"], linewidth=0),
        axis.axhline(ideal, color=SOFT, linestyle="--"),
        *axis.plot(at, value, color=LIGHT["localisation"], marker=".", markersize=3),
    ]
    highest = np.nan_to_num(np.concatenate((value, high)), nan=ideal).max(initial=ideal)
    axis.set_ylim(0, 1.05 * float(highest))
    time_axis(axis, data, style)
    axis.set_ylabel("NEES", parse_math=False)
    which = "each step" if data.document["together"] == 1 else "some steps"
    titled(axis, style, f"NEES of assigned states, mean of {which}", data.about)
    legend(made, handles, ["95 % band of a calibrated filter", f"expected: {ideal}", "NEES"], 3)
    if len(ranks):
        below = axes[1][0]
        edges = np.linspace(0, 1, ranks.shape[1] + 1)
        shares = ranks / np.maximum(ranks.mean(axis=1, keepdims=True), TINY)
        for k, (share, name) in enumerate(zip(shares, nees["columns"], strict=True)):
            below.stairs(share, edges, label=literal(name), linewidth=1.5, **line_looks(k))
        below.axhline(1, color=SOFT, linestyle="--")
        below.set_xlim(0, 1)
        below.set_ylim(0, max(2.0, 1.05 * float(shares.max())))
        below.set_xlabel("weight of the particles below the truth", parse_math=False)
        below.set_ylabel("states / expected", parse_math=False)
        above: Any = {"loc": "lower left", "bbox_to_anchor": (0, 1), "ncols": len(ranks)}
        below.legend(frameon=False, fontsize="small", **above)
    return made


def draw_cumulative(data: PlotData, style: Style, parts: Sequence[str]) -> Figure:
    """Draw the curve: for each step k, the normalised value of the steps up to k."""
    values = {name: data.document["curve"][name] for name in (*parts, "total")}
    made, axis = _draw_lines(data, style, data.time.at, values, "per step, so far")
    titled(axis, style, "Normalised cumulative cost", data.about)
    return made


def draw_windows(data: PlotData, style: Style, parts: Sequence[str]) -> Figure | None:
    """Draw the normalised value of each window, at the middle of the window."""
    windows = data.document.get("windows")
    if windows is None:
        return None
    first, last = (data.time.at[np.asarray(windows[name], int)] for name in ("first", "last"))
    values = {name: windows["lines"][name] for name in (*parts, "total")}
    made, axis = _draw_lines(data, style, (first + last) / 2, values, "per step of the window")
    titled(axis, style, f"Windows of {windows['size']}, each at its middle", data.about)
    return made


def _draw_lines(
    data: PlotData, style: Style, at: Floats, values: Mapping[str, Sequence[float]], name: str
) -> tuple[Figure, Axes]:
    """Draw lines of `values` over the times `at`; `name` is the name of the vertical axis."""
    made, ((axis,),) = figure(style.width, style.low)
    dot = {"marker": "o", "markersize": 4} if len(at) == 1 else {}  # a mark shows a single point
    width = axis.spines["left"].get_linewidth() * 1.3  # lines get thinner with the style, too
    handles = []
    for part, line in values.items():
        looks = {**LINES[part], **dot, "zorder": 2 + (part != "total") / 10, "clip_on": False}
        looks |= {"linewidth": width * (1.6 if part == "total" else 1), "label": part}
        handles += axis.plot(at, line, **looks)
    top = max(max(line, default=0.0) for line in values.values())
    axis.set_ylim(0, top * 1.05 or 1.0)
    time_axis(axis, data, style)
    unit = f" ({literal(data.document['unit'])})" if data.document["unit"] else ""
    axis.set_ylabel(f"{name}{unit}", parse_math=False)
    legend(made, handles, list(values), 5)
    return made, axis


def _with_gaps(begin: Floats, end: Floats, *values: Floats) -> tuple[Floats, list[Floats]]:
    """Return the edges and values of bars. A gap between two bars becomes a bar of value NaN."""
    gaps = np.flatnonzero(end[:-1] < begin[1:]) + 1
    places = np.append(np.insert(begin, gaps, end[gaps - 1]), end[-1:])
    return places, [np.insert(value, gaps, np.nan) for value in values]


def time_axis(axis: Axes, data: PlotData, style: Style, *, upright: bool = False) -> None:
    """Make the horizontal axis, or the vertical one if `upright`, an axis over all steps."""
    begin, end = data.time.edges
    ends = (float(begin[0]), float(end[-1])) if data.steps else (-0.5, 0.5)
    name_times(axis, data.time, ends, style.width / (2 if upright else 1), upright=upright)
    if not data.steps:
        axis.annotate("no steps", (0.5, 0.5), xycoords="axes fraction", ha="center")


def name_times(
    axis: Axes, clock: TimeAxis, ends: tuple[float, float], width: float, *, upright: bool = False
) -> None:
    """Set limits, ticks and name of a time axis; `width` is the picture's width in inches."""
    letters = float(axis.xaxis.label.get_fontsize())
    characters = (width - MARGIN) * 72 / (0.62 * letters)
    places, names, title = clock.ticks(*ends, characters) if clock.labels else ([], [], "time")
    which = axis.yaxis if upright else axis.xaxis
    (axis.set_ylim if upright else axis.set_xlim)(*ends)
    which.set_ticks(places, names, parse_math=False)
    which.set_label_text(literal(title, 60), parse_math=False)


# -------------------------------------------------------------------------------------------------
# The costliest steps, truths and estimates. Each has a bar, in which the parts of its cost are
# stacked.

THICK = 0.36
"""Half the height of a bar. The distance between the middles of two bars is 1."""


def draw_worst(data: PlotData, style: Style, parts: Sequence[str]) -> Figure:
    """Draw bars of the costliest steps, true objects and estimates."""
    shared = data.time.shared
    lists = {
        "steps": _costliest(
            data.document["costs"], [t[len(shared) :] for t in data.time.labels], style.worst, parts
        ),
        "truths": _costliest(_costs(data.truth), data.truth.ids, style.worst, parts),
        "estimates": _costliest(_costs(data.estimate), data.estimate.ids, style.worst, parts),
    }
    beside = style.wide  # one column of a journal is too narrow for three panels
    if beside:
        made, (axes,) = figure(style.width, 0.9 + 0.26 * style.worst, columns=3)
    else:
        rows = [max(len(names), 4) + 1.5 for names, _ in lists.values()]
        made, columns = figure(style.width, 0.55 + 0.13 * sum(rows), rows=3)
        axes = columns[:, 0]
        axes[0].get_gridspec().set_height_ratios(rows)
    for axis, (title, (names, costs)) in zip(axes, lists.items(), strict=True):
        bars(axis, names, costs, style.worst if beside else 4, room=1.22 if beside else 1.1)
        label = f"{title} {literal(shared)}…" if shared and title == "steps" else title
        axis.set_ylabel(label, fontweight="bold", parse_math=False)
    unit = power(data.document["unit"], data.document["order"])
    axes[len(axes) // 2 if beside else -1].set_xlabel(f"cost{unit}", parse_math=False)
    if style.titles:
        titled(axes[0], style, "Worst")
        titled(axes[-1], style, "", data.about)
    legend(made, [Patch(**FILLS[name]) for name in parts], list(parts), 4)
    return made


def _costs(side: SideData) -> dict[str, list[float]]:
    """Return the costs of the tracks of a side, by part."""
    table = side.table
    return {
        "localisation": table["localisation"],
        KINDS[side.name]: table["unassigned"],
        "switch": table["switch"],
    }


def _costliest(
    costs: Mapping[str, Sequence[float]], names: Sequence[str], count: int, parts: Sequence[str]
) -> tuple[list[str], dict[str, Floats]]:
    """Return names and costs of the `count` costliest items, without items of cost zero."""
    chosen = {name: np.asarray(costs[name], float) for name in parts if name in costs}
    total = sum(chosen.values(), np.zeros(len(names)))
    order = [k for k in np.argsort(-total, kind="stable")[:count] if total[k] > 0]
    return [names[k] for k in order], {name: cost[order] for name, cost in chosen.items()}


def bars(
    axis: Axes,
    names: Sequence[str],
    costs: Mapping[str, Floats],
    rows: int = 0,
    letters: int = 20,
    room: float = 1.1,
) -> None:
    """Draw horizontal stacked bars, the first at the top, each with its sum written next to it.

    There is room for at least `rows` bars. Names are shortened to `letters` characters. The axis is
    `room` times as long as the longest bar.
    """
    place, end = np.arange(len(names), dtype=float), np.zeros(len(names))
    for part, cost in costs.items():
        kept = cost > 0
        if kept.any():
            corners = boxes(end[kept], (end + cost)[kept], place[kept] - THICK, place[kept] + THICK)
            # One shape for all bars is quick, because its pattern is drawn only once.
            path = Path.make_compound_path_from_polys(corners)
            axis.add_artist(PathPatch(path, linewidth=0.5, label=part, **FILLS[part]))
        end = end + cost
    for at, total in zip(place, end, strict=True):
        axis.text(total, at, f" {number(total, 4)}", va="center", fontsize="small")
    axis.set_ylim(max(rows, len(names), 1) - 0.4, -0.6)
    axis.set_xlim(0, float(end.max(initial=0.0)) * room or 1.0)
    axis.grid(visible=False, axis="y")
    axis.tick_params(axis="y", length=0)
    axis.locator_params(axis="x", nbins=4)
    counted(axis.xaxis)
    axis.set_yticks(place, [literal(name, letters) for name in names], parse_math=False)
    if not names:
        axis.annotate("none", (0.5, 0.5), xycoords="axes fraction", ha="center", va="center")
        axis.set_xticks([])


# -------------------------------------------------------------------------------------------------
# Lanes: a row over time for each object of the truth, and below them one for each track of the
# estimate with false steps. A run is a sequence of consecutive steps at which a track has the same
# partner. A column of a lane stands for some consecutive steps.

VECTOR_SHAPES = 4000
"""Largest number of shapes of a kind that stay shapes in vector files; more are drawn as pixels."""

MAX_NAMES = 400
"""Largest number of ids that are written inside the lanes of a side."""

HALF = 0.4
"""Half the height of a bar. The distance between the middles of two lanes is 1."""

MANY = 40
"""Largest number of tracks of a side that all have lanes. If there are more, tracks without
unassigned steps and switches share the last lane."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lanes:
    """Positions of the lanes of a side, the truth or the estimate, from top to bottom.

    Parameters
    ----------
    side : SideData
        The side.
    tracks : (L,) int array
        Indices of the tracks with a lane of their own, from top to bottom.
    hidden : (K,) int array
        Indices of the tracks that share the last lane.
    first : int
        Vertical position of the first lane. The title of the lanes is above this position.
    quiet : int
        Number of tracks in the last lane that have neither unassigned steps nor switches.
    """

    side: SideData
    tracks: Ints
    hidden: Ints
    first: int
    quiet: int = 0

    @property
    def end(self) -> int:
        """Position below the last lane."""
        return self.first + len(self.tracks) + bool(len(self.hidden))

    @property
    def title(self) -> str:
        """Title above the lanes."""
        count = len(self.tracks) + len(self.hidden)
        noun = "object" if self.side.name == "truth" else "estimate"
        word = noun + ("" if count == 1 else "s")
        quiet = f", {self.quiet:,} of them without miss or switch" if self.quiet else ""
        return f"{count:,} {word}" + (quiet if self.side.name == "truth" else " with false steps")

    def place(self, track: Ints) -> Floats:
        """Return the vertical positions of tracks; NaN for tracks without a lane of their own."""
        places = np.full(len(self.side.ids), np.nan)
        places[self.tracks] = self.first + np.arange(len(self.tracks))
        return places[track]


def draw_lanes(data: PlotData, style: Style) -> Figure:
    """Draw a lane for each truth, and below them the lanes of estimates with false steps."""
    truths = arranged(data.truth, np.arange(len(data.truth.ids)), style.lanes, 1)
    wrong = np.flatnonzero(np.asarray(data.estimate.table["unassigned_count"], float) > 0)
    estimates = arranged(data.estimate, wrong, style.lanes // 2, truths.end + 1)
    count = max(estimates.end, 3)
    tall = (0.2 if count < 50 else 0.15) * (1.0 if style.titles else 0.62)
    made, ((axis,),) = figure(style.width, 0.85 * (style.low / 2.9) ** 0.5 + tall * count)
    axis.grid(visible=False, axis="y")
    axis.set_ylim(count - 0.3, -0.5)
    letters = min(72 * tall * 0.62, axis.xaxis.label.get_fontsize())
    columns = min(max(data.steps, 1), style.bars)
    # Smallest visible width of a bar, in units of the time axis.
    pixel = (
        (data.time.edges[1][-1] - data.time.edges[0][0] if data.steps else 1) / _room(style) * 0.8
    )
    if data.steps > columns:
        _shares(axis, truths, data, columns, MISSED)
        _shares(axis, estimates, data, columns, FALSE)
    handles = _bars(axis, truths, data, style, pixel=pixel, whole=data.steps <= columns)
    handles |= _bars(axis, estimates, data, style, pixel=pixel, whole=data.steps <= columns)
    _errors(axis, truths, data, columns)
    for lanes in (truths, estimates):
        _draw_hidden(axis, lanes, data, columns)
        _names(axis, lanes, data, letters, _room(style))
        if lanes.side.name == "truth" or len(lanes.tracks):
            words: Any = {"fontsize": letters, "fontweight": "bold", "color": SOFT, "va": "center"}
            at, of = (0.004, lanes.first - 0.95), ("axes fraction", "data")
            axis.annotate(lanes.title, at, xycoords=of, **words)
    handles |= _switches(axis, truths, data, style, columns)
    _ids(axis, (truths, estimates), letters)
    time_axis(axis, data, style)
    titled(axis, style, "Estimates of each object", data.about)
    legend(made, list(handles.values()), list(handles), 4 if style.wide else 2)
    return made


def arranged(side: SideData, tracks: Ints, max_lanes: int, first: int) -> Lanes:
    """Choose which tracks have their own lanes, and return at most `max_lanes` lanes.

    If there are too many tracks, tracks with unassigned steps or switches are chosen first, by
    falling cost, then further tracks by falling cost. If there are more than `MANY` tracks, no
    further tracks are chosen, except if no track has unassigned steps or switches. Tracks that are
    not chosen share the last lane. The chosen lanes are in the order of the file.
    """
    if len(tracks) <= min(max_lanes, MANY):
        return Lanes(side=side, tracks=tracks, hidden=tracks[:0], first=first)
    table = side.table
    events: Floats = np.add(table["unassigned_count"], table["switch"], dtype=float)[tracks]
    cost = np.asarray(table["total"], float)[tracks]
    order = np.lexsort((-cost, events == 0))
    eventful = int(np.count_nonzero(events))
    shown = eventful if len(tracks) > MANY and eventful else len(tracks)
    shown = shown if len(tracks) == shown <= max_lanes else min(shown, max_lanes - 1)
    own, hidden = np.sort(tracks[order[:shown]]), np.sort(tracks[order[shown:]])
    quiet = len(tracks) - max(eventful, shown)
    return Lanes(side=side, tracks=own, hidden=hidden, first=first, quiet=quiet)


def _put(axis: Axes, corners: Floats, name: str, **looks: Any) -> PolyCollection:
    """Add shapes to the axes, drawn as pixels if they are too many for a vector file."""
    polygons: Any = corners  # as an array, because a list takes ten times as long
    made = PolyCollection(polygons, label=name, **looks)
    made.set_rasterized(len(corners) > VECTOR_SHAPES)
    made.set_in_layout(False)  # shapes are inside the axes, and it is slow to check this
    axis.add_collection(made, autolim=False)
    return made


def _bars(
    axis: Axes, lanes: Lanes, data: PlotData, style: Style, *, pixel: float, whole: bool
) -> dict[str, Artist]:
    """Draw assigned runs as bars and unassigned runs as frames, and return entries of the legend.

    Frames are at least `pixel` wide. If there are too many steps to distinguish them, `whole` is
    false. Then no frames are drawn, because `_shares` draws the unassigned steps.
    """
    run, truth = lanes.side.run, lanes.side.name == "truth"
    place = place_of = lanes.place(run["track"])
    begin, end = data.time.edges[0][run["begin"]], data.time.edges[1][run["end"]]
    paired = ~np.isnan(place) & (run["other"] >= 0)
    half = HALF if truth else 0.14
    track = run["other"] if truth else run["track"]
    thin = 0.6 if style.titles else 0.3
    handles: dict[str, Artist] = {}
    if paired.any():
        corners = boxes(begin[paired], end[paired], place[paired] - half, place[paired] + half)
        colours = np.array(TRACK_COLOURS)[track[paired] % len(TRACK_COLOURS)]
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
        edges = data.time.edges[0][run["begin"][free]], data.time.edges[1][run["end"][free]]
        corners = boxes(*edges, place_of[free] - half, place_of[free] + half)
        name = f"{lanes.side.name}/not judged"
        handles["not judged"] = _put(axis, corners, name, linewidths=0, zorder=2.3, **UNJUDGED)
    return handles


def _room(style: Style) -> float:
    """Return the approximate width of the lanes in points (1/72 inch)."""
    return (style.width - MARGIN) * 72


def _columns(step: Ints, columns: int, steps: int) -> Ints:
    """Return the index of the column in which each step is drawn."""
    return step * columns // max(steps, 1)


def _column_edges(data: PlotData, columns: int) -> tuple[Floats, Floats]:
    """Return the positions of begin and end of each column on the time axis."""
    first = -(-np.arange(columns + 1) * data.steps // columns)
    begin, end = data.time.edges
    return begin[first[:-1]], end[first[1:] - 1]


def _unassigned(lanes: Lanes, chosen: Floats) -> tuple[Ints, Ints]:
    """Return the lane and the step of each missed or false state.

    `chosen` has the lane of each run. It is NaN for runs that are left out.
    """
    run = lanes.side.run
    kept = np.flatnonzero((run["other"] == NONE) & ~np.isnan(chosen))
    length = run["end"][kept] - run["begin"][kept] + 1
    first = np.repeat(run["begin"][kept] - np.cumsum(length) + length, length)
    return np.repeat(chosen[kept], length).astype(np.int64), first + np.arange(length.sum())


def _shares(axis: Axes, lanes: Lanes, data: PlotData, columns: int, colour: str) -> None:
    """Draw the share of unassigned steps in each column of a lane, as a box from the top down."""
    lane, step = _unassigned(lanes, lanes.place(lanes.side.run["track"]))
    if not len(lane):
        return
    cells = lane * columns + _columns(step, columns, data.steps)
    cell, count = np.unique(cells, return_counts=True)
    wide = data.steps / columns
    tall = np.clip(count / wide, 0.2, 1.0) * 2 * HALF
    begin, end = _column_edges(data, columns)
    left, right, top = begin[cell % columns], end[cell % columns], cell // columns - HALF
    looks = {"facecolors": colour, "edgecolors": colour, "linewidths": 0.1, "zorder": 2.2}
    _put(axis, boxes(left, right, top, top + tall), f"{lanes.side.name}/share", **looks)


def _errors(axis: Axes, lanes: Lanes, data: PlotData, columns: int) -> None:
    """Darken the lower part of the bars: in each column, the largest error as a fraction of c."""
    row = lanes.side.row
    place = lanes.place(row["track"])
    kept = np.flatnonzero((row["other"] >= 0) & ~np.isnan(place))
    if not len(kept):
        return
    column = _columns(row["step"][kept], columns, data.steps)
    cell, back = np.unique(place[kept].astype(np.int64) * columns + column, return_inverse=True)
    tall = np.zeros(len(cell))
    np.maximum.at(tall, back, row["error"][kept] * 2 * HALF)
    begin, end = _column_edges(data, columns)
    left, right, low = begin[cell % columns], end[cell % columns], cell // columns + HALF
    # Boxes have no outlines, because several of them can be on one bar.
    looks = {"facecolors": "black", "alpha": 0.25, "linewidths": 0}
    _put(axis, boxes(left, right, low - tall, low), "truth/error", **looks)


def _draw_hidden(axis: Axes, lanes: Lanes, data: PlotData, columns: int) -> None:
    """Draw the number of unassigned states of each column in the shared lane, as heights."""
    if not len(lanes.hidden):
        return
    chosen = np.full(len(lanes.side.ids), np.nan)
    chosen[lanes.hidden] = 0
    _, step = _unassigned(lanes, chosen[lanes.side.run["track"]])
    count = np.bincount(_columns(step, columns, data.steps), minlength=columns).astype(float)
    highest = count.max(initial=0.0) or 1.0
    begin, end = _column_edges(data, columns)
    low = lanes.end - 1 + HALF
    # A minimum height keeps small numbers visible.
    height = np.where(count > 0, np.maximum(count / highest, 0.15), 0.0) * 2 * HALF
    name, colour = lanes.side.name, MISSED if lanes.side.name == "truth" else FALSE
    top, places = low - height, np.append(begin, end[-1])
    looks = {"facecolor": colour, "linewidth": 0, "label": f"{name}/others"}
    stairs(axis, top, places, baseline=low, **looks)


def _shown_switches(place: Floats, switches: dict[str, Ints], columns: int, steps: int) -> Ints:
    """Return the indices of the switches to draw.

    If there are more steps than columns, only the largest switch in each column of a lane is drawn.
    If several are equally large, only the first of them is drawn.
    """
    if steps <= columns:
        return np.arange(len(place))
    cell = place.astype(np.int64) * columns + _columns(switches["step"], columns, steps)
    order = np.lexsort((switches["step"], -switches["mass"], cell))
    return np.sort(order[np.unique(cell[order], return_index=True)[1]])


def _switches(
    axis: Axes, truths: Lanes, data: PlotData, style: Style, columns: int
) -> dict[str, Artist]:
    """Draw switches as triangles at the top of the lanes, small ones for fractions of a switch."""
    switches = data.switches
    if not len(switches["step"]):
        return {}
    place = truths.place(switches["truth"])
    place = np.where(np.isnan(place), truths.end - 1, place)
    many = len(place) > 400
    size = (22.0 if style.titles else 9.0) * (0.5 if many else 1.0)
    looks: dict[str, Any] = {"marker": "v", "color": INK, "edgecolors": "white", "zorder": 4}
    looks |= {"linewidths": 0 if many else 0.3, "clip_on": False}
    kept = _shown_switches(place, switches, columns, data.steps)
    place, sizes = place[kept], np.where(switches["mass"][kept] >= 0.99, size, size / 2)
    x = data.time.edges[0][switches["step"][kept]]
    looks["rasterized"] = len(place) > VECTOR_SHAPES
    marks = axis.scatter(x, place - HALF, sizes, label="switch", **looks)
    return {"switch (small: half a switch)" if (switches["mass"] < 0.99).any() else "switch": marks}


def _names(axis: Axes, lanes: Lanes, data: PlotData, letters: float, room: float) -> None:
    """Write the id of the partner into bars that have enough room, at most `MAX_NAMES` ids."""
    if letters < 4 or not data.steps:
        return
    run, truth = lanes.side.run, lanes.side.name == "truth"
    other = data.estimate if truth else data.truth
    place = lanes.place(run["track"])
    (begin, end), point = data.time.edges, (data.time.edges[1][-1] - data.time.edges[0][0]) / room
    wide = (end[run["end"]] - begin[run["begin"]]) / point
    assigned = np.flatnonzero((run["other"] >= 0) & ~np.isnan(place) & (wide > letters))
    looks: dict[str, Any] = {"va": "center_baseline", "color": "white" if truth else INK}
    looks |= {"fontsize": letters, "parse_math": False, "zorder": 3}
    looks["backgroundcolor"] = "none" if truth else "white"
    for k in assigned[np.argsort(-wide[assigned], kind="stable")][:MAX_NAMES]:
        name = literal(other.ids[run["other"][k]], 16)
        if len(name) * 0.66 * letters + 3 > wide[k]:
            continue
        text = Text(begin[run["begin"][k]] + 2 * point, place[k], name, **looks)
        text.set_in_layout(False)
        if not truth:
            text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.4})
        axis.add_artist(text)


def _ids(axis: Axes, groups: tuple[Lanes, ...], letters: float) -> None:
    """Write ids of tracks next to the lanes; at a shared lane, write the number of its tracks."""
    places: list[float] = []
    names: list[str] = []
    for lanes in groups:
        places += list(range(lanes.first, lanes.end))
        names += [literal(lanes.side.ids[track], 14) for track in lanes.tracks]
        word = "quiet" if lanes.quiet == len(lanes.hidden) else "others"
        names += [f"{len(lanes.hidden):,} {word}"] if len(lanes.hidden) else []
    axis.set_yticks(places, names, fontsize=letters, parse_math=False)
    axis.tick_params(axis="y", length=0)
