"""Pictures over time: stacked cost of each step, normalised cumulative cost, sliding windows."""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.words import number
from tgospa_eval.results.numbers import SPREAD
from tgospa_eval.show.drawing import boxes, counted, figure, legend, literal, power, stairs, titled
from tgospa_eval.show.plot_data import KINDS, DrawnSide, PlotData, binned
from tgospa_eval.show.style import COLOURS, FILLS, LIGHT, LINES, SOFT, Style
from tgospa_eval.show.time_axis import TimeAxis

TINY = 1e-300

MARGIN = 0.8
"""Inches beside the axes, about."""


def draw_costs(seen: PlotData, style: Style, parts: Sequence[str]) -> Figure:
    """Stacked bars of each step, or of the costliest of several."""
    made, ((axis,),) = figure(style.width, style.low)
    costs = {name: np.asarray(seen.document["costs"][name], float) for name in parts}
    names = dict(zip(parts, parts, strict=True))
    if SPREAD in seen.document["costs"] and "localisation" in costs:
        spread = np.asarray(seen.document["costs"][SPREAD], float)
        means = {"localisation": costs["localisation"] - spread, SPREAD: spread}
        costs = means | {name: cost for name, cost in costs.items() if name != "localisation"}
        names |= {"localisation": "means", SPREAD: "spreads"}
    stretch = seen.document["together"]
    most = style.bars if stretch == 1 else seen.steps
    first, costliest = binned(sum(costs.values(), np.zeros(seen.steps)), most)
    begin, end = seen.time.edges
    begin, end = begin[first], end[np.append(first[1:], seen.steps) - 1] if seen.steps else end
    base = np.zeros(len(first))
    handles = []
    # outlines leave something to see of bars that are narrow
    thin = min(0.8, max(0.25, 15 * style.width / max(len(first), 1)))
    for name, cost in costs.items() if seen.steps else ():
        # What costs nothing has no outline either.
        height = np.where(cost[costliest] > 0, cost[costliest], np.nan)
        places, (top, foot) = _with_gaps(begin, end, base + height, base)
        looks = {"linewidth": thin, "label": names[name], **FILLS[name]}
        handles.append(stairs(axis, top, places, baseline=foot, **looks))
        base = base + cost[costliest]
    axis.set_ylim(0, float(base.max(initial=0.0)) * 1.03 or 1.0)
    time_axis(axis, seen, style)
    together = first[1] - first[0] if len(first) > 1 else 1
    if together > 1:
        axis.set_xlabel(f"{axis.get_xlabel()}; a bar is the dearest of {together:,} steps")
    if stretch > 1:
        axis.set_xlabel(f"{axis.get_xlabel()}; a bar is the mean of {stretch:,} steps")
    cost_unit = power(seen.document["unit"], seen.document["order"])
    axis.set_ylabel(f"cost{cost_unit}", parse_math=False)
    titled(axis, style, "Cost of each step", seen.about)
    legend(made, handles, [str(bars.get_label()) for bars in handles], 5)
    return made


def draw_nees(seen: PlotData, style: Style) -> Figure | None:
    """NEES of each step with its band; below it of particles the ranks of the truth."""
    found = seen.document.get("nees")
    if found is None:
        return None
    ranks = np.array(found["ranks"], float)
    made, axes = figure(style.width, style.low * (1 + bool(len(ranks))), rows=1 + bool(len(ranks)))
    axis = axes[0][0]
    value, low, high = (np.array(line, float) for line in found["lines"].values())
    at, ideal = seen.time.at, found["ideal"]
    handles = [
        axis.fill_between(at, low, high, step="mid", color=LIGHT["grid"], linewidth=0),
        axis.axhline(ideal, color=SOFT, linestyle="--"),
        *axis.plot(at, value, color=LIGHT["localisation"], marker=".", markersize=3),
    ]
    most = np.nan_to_num(np.concatenate((value, high)), nan=ideal).max(initial=ideal)
    axis.set_ylim(0, 1.05 * float(most))
    time_axis(axis, seen, style)
    axis.set_ylabel("NEES", parse_math=False)
    which = "each step" if seen.document["together"] == 1 else "some steps"
    titled(axis, style, f"NEES of assigned states, mean of {which}", seen.about)
    legend(made, handles, ["95 % band of a calibrated filter", f"expected: {ideal}", "NEES"], 3)
    if len(ranks):
        below = axes[1][0]
        edges = np.linspace(0, 1, ranks.shape[1] + 1)
        shares = ranks / np.maximum(ranks.mean(axis=1, keepdims=True), TINY)
        for share, name, colour in zip(shares, found["columns"], itertools.cycle(COLOURS)):
            below.stairs(share, edges, color=colour, label=literal(name), linewidth=1.5)
        below.axhline(1, color=SOFT, linestyle="--")
        below.set_xlim(0, 1)
        below.set_ylim(0, max(2.0, 1.05 * float(shares.max())))
        below.set_xlabel("weight of the particles below the truth", parse_math=False)
        below.set_ylabel("states / expected", parse_math=False)
        below.legend(frameon=False, fontsize="small", ncols=len(ranks))
    return made


def draw_cumulative(seen: PlotData, style: Style, parts: Sequence[str]) -> Figure:
    """The root of the mean cost of the steps up to each."""
    values = {name: seen.document["curve"][name] for name in (*parts, "total")}
    made, axis = _draw_lines(seen, style, seen.time.at, values, "per step, so far")
    titled(axis, style, "Normalised cumulative cost", seen.about)
    return made


def draw_windows(seen: PlotData, style: Style, parts: Sequence[str]) -> Figure | None:
    """The root of the mean cost of each window."""
    found = seen.document.get("windows")
    if found is None:
        return None
    first, last = (seen.time.at[np.asarray(found[name], int)] for name in ("first", "last"))
    values = {name: found["lines"][name] for name in (*parts, "total")}
    made, axis = _draw_lines(seen, style, (first + last) / 2, values, "per step of the window")
    titled(axis, style, f"Windows of {found['size']}, each at its middle", seen.about)
    return made


def _draw_lines(
    seen: PlotData, style: Style, at: Floats, values: Mapping[str, Sequence[float]], name: str
) -> tuple[Figure, Axes]:
    """A line for each part and for the total."""
    made, ((axis,),) = figure(style.width, style.low)
    dot = {"marker": "o", "markersize": 4} if len(at) == 1 else {}  # one point is no line
    width = axis.spines["left"].get_linewidth() * 1.3  # of the style
    handles = []
    for part, line in values.items():
        looks = {**LINES[part], **dot, "zorder": 2 + (part != "total") / 10, "clip_on": False}
        looks |= {"linewidth": width * (1.6 if part == "total" else 1), "label": part}
        handles += axis.plot(at, line, **looks)
    top = max(max(line, default=0.0) for line in values.values())
    axis.set_ylim(0, top * 1.05 or 1.0)
    time_axis(axis, seen, style)
    unit = f" ({literal(seen.document['unit'])})" if seen.document["unit"] else ""
    axis.set_ylabel(f"{name}{unit}", parse_math=False)
    legend(made, handles, list(values), 5)
    return made, axis


def _with_gaps(begin: Floats, end: Floats, *values: Floats) -> tuple[Floats, list[Floats]]:
    """Edges of bars one after the other, and their values, with holes where there is nothing."""
    gaps = np.flatnonzero(end[:-1] < begin[1:]) + 1
    places = np.append(np.insert(begin, gaps, end[gaps - 1]), end[-1:])
    return places, [np.insert(value, gaps, np.nan) for value in values]


def time_axis(axis: Axes, seen: PlotData, style: Style, *, upright: bool = False) -> None:
    """From the first step to the last, with the times as names."""
    begin, end = seen.time.edges
    ends = (float(begin[0]), float(end[-1])) if seen.steps else (-0.5, 0.5)
    name_times(axis, seen.time, ends, style.width / (2 if upright else 1), upright=upright)
    if not seen.steps:
        axis.annotate("no steps", (0.5, 0.5), xycoords="axes fraction", ha="center")


def name_times(
    axis: Axes, clock: TimeAxis, ends: tuple[float, float], width: float, *, upright: bool = False
) -> None:
    """Ends, ticks and name of an axis of time in a picture of so many inches."""
    letters = float(axis.xaxis.label.get_fontsize())
    characters = (width - MARGIN) * 72 / (0.62 * letters)
    places, names, title = clock.ticks(*ends, characters) if clock.labels else ([], [], "time")
    which = axis.yaxis if upright else axis.xaxis
    (axis.set_ylim if upright else axis.set_xlim)(*ends)
    which.set_ticks(places, names, parse_math=False)
    which.set_label_text(literal(title, 60), parse_math=False)


# -------------------------------------------------------------------------------------------------
# What costs most: steps, truths and estimates, as bars that say why.

THICK = 0.36
"""Half the height of a bar; bars are 1 apart."""


def draw_worst(seen: PlotData, style: Style, parts: Sequence[str]) -> Figure:
    """Bars of the costliest steps, truths and estimates."""
    shared = seen.time.shared
    lists = {
        "steps": _costliest(
            seen.document["costs"], [t[len(shared) :] for t in seen.time.labels], style.worst, parts
        ),
        "truths": _costliest(_costs(seen.truth), seen.truth.ids, style.worst, parts),
        "estimates": _costliest(_costs(seen.estimate), seen.estimate.ids, style.worst, parts),
    }
    beside = style.titles  # a column of a journal has no room for three
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
    unit = power(seen.document["unit"], seen.document["order"])
    axes[len(axes) // 2 if beside else -1].set_xlabel(f"cost{unit}", parse_math=False)
    if style.titles:
        titled(axes[0], style, "Worst")
        titled(axes[-1], style, "", seen.about)
    legend(made, [Patch(**FILLS[name]) for name in parts], list(parts), 4)
    return made


def _costs(side: DrawnSide) -> dict[str, list[float]]:
    """Costs of tracks by the names of the parts."""
    table = side.table
    return {
        "localisation": table["localisation"],
        KINDS[side.name]: table["unassigned"],
        "switch": table["switch"],
    }


def _costliest(
    costs: Mapping[str, Sequence[float]], names: Sequence[str], count: int, parts: Sequence[str]
) -> tuple[list[str], dict[str, Floats]]:
    """Names and costs of those that cost most, free ones left out."""
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
    """Stacked bars from above, with the sum at the end of each; room for so many rows and words."""
    place, end = np.arange(len(names), dtype=float), np.zeros(len(names))
    for part, cost in costs.items():
        kept = cost > 0
        if kept.any():
            corners = boxes(end[kept], (end + cost)[kept], place[kept] - THICK, place[kept] + THICK)
            # One artist for all: of each bar the hatches are made anew.
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
