"""Boxes and 2-sigma ellipses along trajectories in the plane."""

from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.palette import TRACK_COLOURS
from tgospa_eval.plots.style import INK, Style
from tgospa_eval.plots.views import TIME, Side, View
from tgospa_eval.problem.problem import Floats, Ints

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

SIGMAS = 2
FEW = 30
"""Trajectories up to which shapes do not hide one another."""

CORNERS = 48
"""Of an ellipse."""

APART = 2.0
"""Distance of two shapes of a trajectory, in sizes of the first."""


def outlines(axis: "Axes", seen: View, across: str, up: str, style: Style) -> "dict[str, Artist]":
    """Draw them where the two columns show them; returns entries of a legend."""
    boxes = seen.data["boxes"]
    if len(seen.truth.ids) + len(seen.estimate.ids) > FEW:
        return {}
    if boxes and (across, up) not in (("left", "top"), ("centre x", "centre y")):
        return {}
    if not boxes and (not seen.data["spread"] or across == up or TIME in (across, up)):
        return {}
    from matplotlib.collections import PolyCollection

    handles: dict[str, Artist] = {}
    for side in (seen.truth, seen.estimate):
        row, shapes = _boxes(side) if boxes else ellipses(seen, side, across, up)
        if not len(row):
            continue
        reach = (shapes.max(axis=1) / 2 - shapes.min(axis=1) / 2).max(axis=1)
        middle = np.stack([side.axes[across][row], side.axes[up][row]], axis=1)
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


def ellipses(seen: View, side: Side, across: str, up: str) -> tuple[Ints, Floats]:
    """Rows that are drawn with a spread, and outlines (K, CORNERS, 2), of those that have any.

    Of two components with deviations s, t and correlation r the n-sigma outline is
    (n s cos u, n t sin(u + arcsin r)), 0 <= u < 2 pi; `reports.spreads` says how these are encoded.
    """
    how, names = seen.data["spread"], seen.data["columns"]
    if "row" not in side.spread:
        return np.zeros(0, np.int64), np.zeros((0, CORNERS, 2))
    chosen = [names.index(name) for name in (across, up)]

    def deviation(k: int) -> Floats:
        level = side.spread[str(k * (k + 3) // 2)]
        deviation = how["largest"][k] * np.exp(-level / how["fine"])
        return np.asarray(np.where(level >= how["faint"], 0.0, deviation), float)

    s, t = (deviation(k) for k in chosen)
    i, j = max(chosen), min(chosen)
    turn = side.spread[str(i * (i + 1) // 2 + j)] / how["angle"]
    there = np.flatnonzero((s > 0) | (t > 0))
    row = side.spread["row"][there]
    u = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    x = side.axes[across][row, None] + SIGMAS * s[there, None] * np.cos(u)
    y = side.axes[up][row, None] + SIGMAS * t[there, None] * np.sin(u + turn[there, None])
    return row, np.stack([x, y], axis=2)


def _boxes(side: Side) -> tuple[Ints, Floats]:
    """All rows, and corners (R, 4, 2)."""
    left, top, width, height = (side.axes[name] for name in ("left", "top", "width", "height"))
    x = np.stack([left, left + width, left + width, left], axis=1)
    y = np.stack([top, top, top + height, top + height], axis=1)
    return np.arange(len(left)), np.stack([x, y], axis=2)


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
