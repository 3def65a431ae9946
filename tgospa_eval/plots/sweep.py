"""Picture of a sweep of a parameter: value, costs and counts over it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from tgospa_eval.common.palette import LIGHT
from tgospa_eval.plots import MARKERS, figure, label
from tgospa_eval.results.records import COUNTED_PARTS, PARTS
from tgospa_eval.results.sweep import Point, Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

AXIS_NAMES = {
    "cutoff": "cutoff $c$",
    "order": "order $p$",
    "switch_penalty": r"switch penalty $\gamma$",
    "rho": r"price of false targets $\rho$",
}
LOGARITHMIC = 0.25
"""An axis is logarithmic if half of its values lie in so much of it."""


def sweep_figure(found: Sweep) -> "Figure":
    """Small multiples: the value and the four costs above, counts below the costs.

    A grey band is where the counts of missed and false targets do not change.
    """
    points = found.points
    x = [point.value for point in points]
    made, axes = figure(11.0, 4.6, rows=2, columns=4)
    for axis, name in zip(axes[0], PARTS, strict=True):
        _sweep_line(axis, x, [getattr(point, name) for point in points], PARTS.index(name))
        label(axis, "", "cost" if name == PARTS[0] else "", name)
    _value(axes[1, 0], x, points)
    for axis, name in zip(axes[1, 1:], COUNTED_PARTS, strict=True):
        _sweep_line(axis, x, [getattr(point, f"{name}_count") for point in points], PARTS.index(name))
        label(axis, "", "", f"number, {name}")
    band = found.unchanged("missed_count", "false_count")
    for axis in axes.flat:
        if band is not None:
            axis.axvspan(*(x[k] for k in band), color="#eeeeee", zorder=0, linewidth=0)
        if _crowded(x):
            axis.set_xscale("log")
            ends = x[0], x[len(x) // 2], x[-1]
            axis.set_xticks(ends, [f"{value:.3g}" for value in ends], minor=False)
            axis.set_xticks([], minor=True)
        axis.set_ylim(0, None)
    made.supxlabel(
        AXIS_NAMES[found.parameter]
        + (f" ({plain(found.unit)})" if found.unit else "")
        + ("; grey: missed and false do not change in number" if band is not None else ""),
        fontsize="medium",
    )
    return made


def plain(text: str) -> str:
    """A text of the user's without formulas."""
    return "".join(c if c.isprintable() else "?" for c in text).replace("$", r"\$")


def _value(axis: "Axes", x: list[float], points: Sequence[Point]) -> None:
    """TGOSPA; its bracket where it is seen."""
    upper = [point.tgospa for point in points]
    lower = [point.lower_bound for point in points]
    axis.plot(x, upper, "-", marker="o", ms=4, color="#000000", clip_on=False)
    if not all(point.certified for point in points):
        axis.fill_between(x, lower, upper, color="#000000", alpha=0.15, linewidth=0)
    label(axis, "", "", "TGOSPA")


def _sweep_line(axis: "Axes", x: list[float], y: list[float], k: int) -> None:
    axis.plot(x, y, "-", marker=MARKERS[k], ms=4, color=LIGHT[PARTS[k]], clip_on=False)


def _crowded(x: list[float]) -> bool:
    """Whether values crowd at the low end, as evenly spaced logarithms do."""
    middle = sorted(x)[len(x) // 2]
    return len(x) > 2 and x[0] > 0 and middle - x[0] < LOGARITHMIC * (x[-1] - x[0])
