"""Pictures over time: stacked cost of each step, normalised cumulative cost, sliding windows."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.plots import figure, stairs
from tgospa_eval.plots.style import FILLS, LINES, Style, legend, literal, power, styled, titled
from tgospa_eval.plots.views import View, binned, parts_of, view
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.clock import Clock
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARGIN = 0.8
"""Inches beside the axes, about."""


def plot_costs(
    result: Summary, *, style: str = "screen", components: Sequence[str] | None = None
) -> "Figure":
    """Cost of each step, stacked: localisation, missed, false, switch.

    Where there are more steps than can be distinguished each bar is the costliest of several, and
    the axis says of how many.

    Parameters
    ----------
    result : Result
        What to draw.
    style : {"screen", "paper"}
        With a title; or small, for one column of a journal.
    components : sequence of str, optional
        Parts of the cost that are drawn, of ``"localisation"``, ``"missed"``, ``"false"``,
        ``"switch"``; all by default.

    Returns
    -------
    matplotlib.figure.Figure
        Belongs to no window.

    Raises
    ------
    ConfigError
        A name is unknown, or matplotlib is not installed.
    """
    with styled(style) as made:
        return draw_costs(view(result), made, parts_of(components))


def plot_cumulative(
    result: Summary, *, style: str = "screen", components: Sequence[str] | None = None
) -> "Figure":
    """Normalised cumulative cost: at each step the root of the mean cost of the steps up to it.

    The assignment is that of the whole recording, unless the curve was asked for; the last value of
    the total is ``result.normalised["tgospa"]``. Parameters, errors and return value are those of
    `plot_costs`; the total is always drawn.
    """
    with styled(style) as made:
        return draw_cumulative(view(result), made, parts_of(components))


def draw_costs(seen: View, style: Style, parts: Sequence[str]) -> "Figure":
    """`plot_costs` of a view."""
    made, ((axis,),) = figure(style.width, style.low)
    costs = {name: np.asarray(seen.data["costs"][name], float) for name in parts}
    stretch = seen.data.get("together", 1)
    most = style.bars if stretch == 1 else seen.steps
    first, costliest = binned(sum(costs.values(), np.zeros(seen.steps)), most)
    begin, end = seen.edges
    begin, end = begin[first], end[np.append(first[1:], seen.steps) - 1] if seen.steps else end
    base = np.zeros(len(first))
    handles = []
    # outlines leave something to see of bars that are narrow
    thin = min(0.8, max(0.25, 15 * style.width / max(len(first), 1)))
    for name, cost in costs.items() if seen.steps else ():
        # What costs nothing has no outline either.
        height = np.where(cost[costliest] > 0, cost[costliest], np.nan)
        places, (top, foot) = _with_gaps(begin, end, base + height, base)
        looks = {"linewidth": thin, "label": name, **FILLS[name]}
        handles.append(stairs(axis, top, places, baseline=foot, **looks))
        base = base + cost[costliest]
    axis.set_ylim(0, float(base.max(initial=0.0)) * 1.03 or 1.0)
    time_axis(axis, seen, style)
    together = first[1] - first[0] if len(first) > 1 else 1
    if together > 1:
        axis.set_xlabel(f"{axis.get_xlabel()}; a bar is the dearest of {together:,} steps")
    if stretch > 1:
        axis.set_xlabel(f"{axis.get_xlabel()}; a bar is the mean of {stretch:,} steps")
    cost_unit = power(seen.data["unit"], seen.data["order"])
    axis.set_ylabel(f"cost{cost_unit}", parse_math=False)
    titled(axis, style, "Cost of each step", seen.about)
    legend(made, handles, [str(bars.get_label()) for bars in handles], 4)
    return made


def plot_windows(
    result: Summary, *, style: str = "screen", components: Sequence[str] | None = None
) -> "Figure":
    """Sliding windows: at the middle of each the root of its mean cost, as `Result.windows` has it.

    Parameters, errors and return value are those of `plot_costs`; the total is always drawn.

    Raises
    ------
    ConfigError
        Windows were not asked for.
    """
    if result.slid is None:
        raise ConfigError("there are no windows: evaluate with window=, the steps of each")
    with styled(style) as made:
        return draw_windows(view(result), made, parts_of(components))


def draw_cumulative(seen: View, style: Style, parts: Sequence[str]) -> "Figure":
    """`plot_cumulative` of a view."""
    lines = _Lines(at=seen.at, values=seen.data["curve"], axis="per step, so far")
    return _draw_lines(seen, style, parts, lines, "Normalised cumulative cost")


def draw_windows(seen: View, style: Style, parts: Sequence[str]) -> "Figure":
    """`plot_windows` of a view."""
    found = seen.data["windows"]
    ends = (seen.at[np.asarray(found[name], int)] for name in ("first", "last"))
    lines = _Lines(
        at=sum(ends, np.zeros(len(found["first"]))) / 2,
        values=found["lines"],
        axis="per step of the window",
    )
    title = f"Windows of {found['size']}, each at its middle"
    return _draw_lines(seen, style, parts, lines, title)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lines:
    """Values of the parts and the total at times, and what the axis is called."""

    at: Floats
    values: dict[str, list[float]]
    axis: str


def _draw_lines(
    seen: View, style: Style, parts: Sequence[str], lines: _Lines, title: str
) -> "Figure":
    """A line for each part and for the total."""
    made, ((axis,),) = figure(style.width, style.low)
    names = [*parts, "total"]
    dot = {"marker": "o", "markersize": 4} if len(lines.at) == 1 else {}  # one point is no line
    width = axis.spines["left"].get_linewidth() * 1.3  # of the style
    handles = []
    for name in names:
        looks = {**LINES[name], **dot, "zorder": 2 + (name != "total") / 10, "clip_on": False}
        looks |= {"linewidth": width * (1.6 if name == "total" else 1), "label": name}
        handles += axis.plot(lines.at, lines.values[name], **looks)
    top = max((max(lines.values[name], default=0.0) for name in names), default=0.0)
    axis.set_ylim(0, top * 1.05 or 1.0)
    time_axis(axis, seen, style)
    unit = f" ({literal(seen.data['unit'])})" if seen.data["unit"] else ""
    axis.set_ylabel(f"{lines.axis}{unit}", parse_math=False)
    titled(axis, style, title, seen.about)
    legend(made, handles, names, 5)
    return made


def _with_gaps(begin: Floats, end: Floats, *values: Floats) -> tuple[Floats, list[Floats]]:
    """Edges of bars one after the other, and their values, with holes where there is nothing."""
    gaps = np.flatnonzero(end[:-1] < begin[1:]) + 1
    places = np.append(np.insert(begin, gaps, end[gaps - 1]), end[-1:])
    return places, [np.insert(value, gaps, np.nan) for value in values]


def time_axis(axis: "Axes", seen: View, style: Style, *, upright: bool = False) -> None:
    """From the first step to the last, with the times as names."""
    begin, end = seen.edges
    ends = (float(begin[0]), float(end[-1])) if seen.steps else (-0.5, 0.5)
    name_times(axis, seen.time, ends, style.width / (2 if upright else 1), upright=upright)
    if not seen.steps:
        axis.annotate("no steps", (0.5, 0.5), xycoords="axes fraction", ha="center")


def name_times(
    axis: "Axes", clock: Clock, ends: tuple[float, float], width: float, *, upright: bool = False
) -> None:
    """Ends, ticks and name of an axis of time in a picture of so many inches."""
    letters = float(axis.xaxis.label.get_fontsize())
    characters = (width - MARGIN) * 72 / (0.62 * letters)
    places, names, title = clock.ticks(*ends, characters) if clock.labels else ([], [], "time")
    which = axis.yaxis if upright else axis.xaxis
    (axis.set_ylim if upright else axis.set_xlim)(*ends)
    which.set_ticks(places, names, parse_math=False)
    which.set_label_text(literal(title, 60), parse_math=False)
