"""What costs most: steps, truths and estimates, as bars that say why."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.figures import number
from tgospa_eval.plots import boxes, counted, figure
from tgospa_eval.plots.style import FILLS, Style, legend, literal, power, styled, titled
from tgospa_eval.plots.views import Side, View, parts_of, view
from tgospa_eval.problem.problem import Floats
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

THICK = 0.36
"""Half the height of a bar; bars are 1 apart."""

UNASSIGNED = {"truth": "missed", "estimate": "false"}
"""What a track costs where it is unassigned."""


def plot_worst(
    result: Summary, *, style: str = "screen", components: Sequence[str] | None = None
) -> "Figure":
    """The costliest steps, truths and estimates, and what they cost.

    Parameters, errors and return value are those of `plot_costs`; only `components` count.
    """
    with styled(style) as made:
        return draw_worst(view(result), made, parts_of(components))


def draw_worst(seen: View, style: Style, parts: Sequence[str]) -> "Figure":
    """`plot_worst` of a view."""
    from matplotlib.patches import Patch

    shared = seen.time.shared
    lists = {
        "steps": _costliest(
            seen.data["costs"], [t[len(shared) :] for t in seen.labels], style.worst, parts
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
        _bars(axis, names, costs, style.worst if beside else max(len(names), 4), beside=beside)
        label = f"{title} {literal(shared)}…" if shared and title == "steps" else title
        axis.set_ylabel(label, fontweight="bold", parse_math=False)
    unit = power(seen.data["unit"], seen.data["order"])
    axes[len(axes) // 2 if beside else -1].set_xlabel(f"cost{unit}", parse_math=False)
    if style.titles:
        titled(axes[0], style, "Worst")
        titled(axes[-1], style, "", seen.about)
    legend(made, [Patch(**FILLS[name]) for name in parts], list(parts), 4)
    return made


def _costs(side: Side) -> dict[str, list[float]]:
    """Costs of tracks by the names of the parts."""
    table = side.table
    return {
        "localisation": table["localisation"],
        UNASSIGNED[side.name]: table["unassigned"],
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


def _bars(
    axis: "Axes", names: list[str], costs: dict[str, Floats], rows: int, *, beside: bool
) -> None:
    """Stacked bars, costliest above, with the sum at the end of each; room for so many."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    place, end = np.arange(len(names), dtype=float), np.zeros(len(names))
    for part, cost in costs.items():
        kept = cost > 0
        if kept.any():
            bars = boxes(end[kept], (end + cost)[kept], place[kept] - THICK, place[kept] + THICK)
            # One artist for all: of each bar the hatches are made anew.
            path = Path.make_compound_path_from_polys(bars)
            axis.add_artist(PathPatch(path, linewidth=0.5, label=part, **FILLS[part]))
        end = end + cost
    for at, total in zip(place, end, strict=True):
        axis.text(total, at, f" {number(total, 4)}", va="center", fontsize="small")
    axis.set_ylim(max(rows, 1) - 0.4, -0.6)
    axis.set_xlim(0, float(end.max(initial=0.0)) * (1.22 if beside else 1.1) or 1.0)
    axis.grid(visible=False, axis="y")
    axis.tick_params(axis="y", length=0)
    axis.locator_params(axis="x", nbins=4)
    counted(axis.xaxis)
    axis.set_yticks(place, [literal(name, 20) for name in names], parse_math=False)
    if not names:
        axis.annotate("none", (0.5, 0.5), xycoords="axes fraction", ha="center", va="center")
        axis.set_xticks([])
