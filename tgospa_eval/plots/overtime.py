"""Pictures over time: the stacked cost of each step, and the normalised cumulative cost."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.evaluation import Summary
from tgospa_eval.plots import figure
from tgospa_eval.plots.style import FILLS, LINES, Style, legend, literal, power, styled, titled
from tgospa_eval.plots.views import View, binned, parts_of, view

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARGIN = 0.8
"""Inches beside the axes, about."""


def plot_costs(
    result: Summary, *, style: str = "screen", components: Sequence[str] | None = None
) -> "Figure":
    """Cost of each step, stacked: localisation, missed, false, switch.

    Where there are more steps than can be told apart each bar is the dearest of several, and the
    axis says of how many.

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

    The assignment is that of the whole recording, or, if the curve was asked for, that of those
    steps alone; the last value of the total is ``result.normalised["tgospa"]``. Parameters, errors
    and return value are those of `plot_costs`; the total is always drawn.
    """
    with styled(style) as made:
        return draw_cumulative(view(result), made, parts_of(components))


def draw_costs(seen: View, style: Style, parts: Sequence[str]) -> "Figure":
    """`plot_costs` of a view."""
    made, ((axis,),) = figure(style.width, style.low)
    costs = {name: np.asarray(seen.data["costs"][name], float) for name in parts}
    first, dearest = binned(sum(costs.values(), np.zeros(seen.steps)), style.bars)
    edges = np.append(first, seen.steps) - 0.5
    base = np.zeros(len(first))
    handles = []
    for name, cost in costs.items() if seen.steps else ():
        # What costs nothing has no outline either.
        height = np.where(cost[dearest] > 0, cost[dearest], np.nan)
        bars = axis.stairs(
            base + height, edges, baseline=base, fill=True, linewidth=_thin(style, len(first)),
            label=name, **FILLS[name],
        )  # fmt: skip
        handles.append(bars)
        base = base + cost[dearest]
    axis.set_ylim(0, float(base.max(initial=0.0)) * 1.03 or 1.0)
    time_axis(axis, seen, style)
    together = first[1] - first[0] if len(first) > 1 else 1
    if together > 1:
        axis.set_xlabel(f"{axis.get_xlabel()}; a bar is the dearest of {together} steps")
    cost_unit = power(seen.data["unit"], seen.data["order"])
    axis.set_ylabel(f"cost{cost_unit}", parse_math=False)
    titled(axis, style, "Cost of each step", seen.about)
    legend(made, handles, [bars.get_label() for bars in handles], 4)
    return made


def draw_cumulative(seen: View, style: Style, parts: Sequence[str]) -> "Figure":
    """`plot_cumulative` of a view."""
    made, ((axis,),) = figure(style.width, style.low)
    names = [*parts, "total"]
    x = np.arange(seen.steps)
    width = axis.spines["left"].get_linewidth() * 1.3  # of the style
    handles = [
        axis.plot(
            x, seen.data["curve"][name], linewidth=width * (1.6 if name == "total" else 1),
            **LINES[name], clip_on=False, label=name,
        )[0]
        for name in names
    ]  # fmt: skip
    top = max((max(seen.data["curve"][name], default=0.0) for name in names), default=0.0)
    axis.set_ylim(0, top * 1.05 or 1.0)
    time_axis(axis, seen, style)
    unit = f" ({literal(seen.data['unit'])})" if seen.data["unit"] else ""
    axis.set_ylabel(f"per step, so far{unit}", parse_math=False)
    titled(axis, style, "Normalised cumulative cost", seen.about)
    legend(made, handles, names, 5)
    return made


def time_axis(axis: "Axes", seen: View, style: Style, *, upright: bool = False) -> None:
    """Steps with the times as names, from edge to edge."""
    characters = (style.width - MARGIN) * 72 / (0.62 * _size(axis))
    if upright:
        axis.set_ylim(-0.5, max(seen.steps, 1) - 0.5)
        axis.set_yticks(*seen.ticks(characters / 2), parse_math=False)
        axis.set_ylabel(literal(seen.time_name, 40), parse_math=False)
        return
    axis.set_xlim(-0.5, max(seen.steps, 1) - 0.5)
    axis.set_xticks(*seen.ticks(characters), parse_math=False)
    axis.set_xlabel(literal(seen.time_name, 40), parse_math=False)
    if not seen.steps:
        axis.set_xticks([])
        axis.annotate("no steps", (0.5, 0.5), xycoords="axes fraction", ha="center")


def _size(axis: "Axes") -> float:
    """Points of the letters at the ticks."""
    return float(axis.xaxis.label.get_fontsize())


def _thin(style: Style, bars: int) -> float:
    """Outlines that leave something to see of bars that are narrow."""
    return min(0.8, max(0.25, 15 * style.width / max(bars, 1)))
