"""Pictures of several evaluations: documents of `compare`, sweeps, batches and gates.

A *sweep* is an evaluation at several values of a parameter. A *sweep of the solver* is an iteration
of the solver `sinkhorn`.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.words import number
from tgospa_eval.results.consistency import NEES, NeesSums
from tgospa_eval.results.records import COUNTED_PARTS, PARTS, Columns, Json, Time
from tgospa_eval.results.sweep import SweepEvaluation
from tgospa_eval.show.batch import CURVE_KINDS, LINE_NAMES, BatchTables, RmsCurve, on_one_axis
from tgospa_eval.show.draw_over_time import bars, name_times
from tgospa_eval.show.figure_tools import figure, label, legend, literal, power, titled
from tgospa_eval.show.style import (
    COLOURS,
    FILLS,
    INK,
    LIGHT,
    MARKERS,
    SOFT,
    TRACK_COLOURS,
    Style,
    heat_shades,
    line_looks,
)
from tgospa_eval.show.time_axis import ROOM, TimeAxis

TALL = 1.4
"""Height of most pictures here, relative to that of a picture over time."""

FLOOR = 1e-9
"""Errors up to this value count as zero. They are drawn at this value."""

SIZES = ("targets", "steps")

SPENT, ERROR = "seconds, solving and proof", "relative error, upper bound"
TEMPERATURE = "temperature ε, fraction of $c^p$"
AT_FLOOR = f"errors below {FLOOR:g} are drawn at {FLOOR:g}"


def _has_errors(*errors: Iterable[float | None]) -> bool:
    """Check whether any error is larger than `FLOOR`."""
    return any(error is not None and error > FLOOR for each in errors for error in each)


def draw_errors(document: Json, style: Style) -> Figure | None:
    """Draw the errors of `sinkhorn` over its temperature.

    There are lines for both bounds, for the value with entropy, and for the same value without its
    entropy. Errors are differences to the narrowest bounds that all runs together prove.
    """
    runs = [run for run in document["runs"] if run["epsilon"] is not None and run["seconds"]]
    runs.sort(key=_epsilon)
    entropic = [run["entropic"] or {} for run in runs]
    lines = {
        "upper bound (TGOSPA)": [run["error"] for run in runs],
        "lower bound": [run["lower_error"] for run in runs],
        "entropic value": [each.get("error") for each in entropic],
        "its cost, without entropy": [each.get("cost_error") for each in entropic],
    }
    if document["referee"] is None or len(runs) < 2 or not _has_errors(*list(lines.values())[:3]):
        return None
    means = {name: [{"mean": error, "deviation": None} for error in lines[name]] for name in lines}
    return _by_temperature({name: (runs, means[name]) for name in means}, style)


def _by_temperature(
    lines: Mapping[str, tuple[Sequence[Json], Sequence[Json]]], style: Style, where: str = ""
) -> Figure:
    """Draw a line for each name: the errors of its runs over their temperatures.

    The title ends with `where`.
    """
    made, ((axis,),) = figure(style.width, TALL * style.low)
    for k, (name, (runs, errors)) in enumerate(lines.items()):
        _line(axis, [*map(_epsilon, runs)], errors, k, name, FLOOR, style)
    _ticks(axis, [*map(_epsilon, runs)])
    error_axis(axis)
    label(axis, TEMPERATURE, ERROR, "")
    titled(axis, style, f"Error of sinkhorn by temperature{where}")
    _legend(made, axis, 2)
    return made


def draw_time_over_error(document: Json, style: Style) -> Figure | None:
    """Draw a mark for each run, at its error (horizontal) and its time (vertical).

    If all errors are below `FLOOR`, bars of the times are drawn instead.
    """
    if document["referee"] is None:
        return None
    runs = [run for run in document["runs"] if run["seconds"] is not None]
    if not _has_errors(run["error"] for run in runs):
        made, ((axis,),) = figure(style.width, (0.3 + 0.1 * len(runs)) * style.low)
        spent = np.array([_spent(run) for run in runs])
        bars(axis, [run["name"] for run in runs], {"localisation": spent}, letters=30)
        label(axis, f"{SPENT}; all errors are below {FLOOR:g}", "", "")
        titled(axis, style, "Time")
        return made
    made, ((axis,),) = figure(style.width, TALL * style.low)
    solvers = list(dict.fromkeys(run["solver"] for run in runs))
    for k, run in enumerate(runs):
        looks: dict[str, Any] = {"alpha": 0.8, "clip_on": False, "zorder": 3, "label": run["name"]}
        looks |= {"color": COLOURS[solvers.index(run["solver"])], "ms": 1.7 * style.mark}
        axis.plot([floored(run["error"])], [_spent(run)], MARKERS[k % len(MARKERS)], **looks)
    seconds_axis(axis.yaxis)
    error_axis(axis, vertical=False)
    label(axis, ERROR, SPENT, "")
    titled(axis, style, "Time and error")
    _legend(made, axis, 2)
    return made


def _spent(run: Json) -> float:
    return float(run["seconds"]["solve"] + run["seconds"]["certify"])


def _epsilon(run: Json) -> float:
    return run["epsilon"] or 0.0


def draw_convergence(document: Json, style: Style) -> Figure | None:
    """Draw the errors of both bounds over the number of sweeps of the solver, for each run.

    Errors are differences to the narrowest bounds that all runs together prove.
    """
    runs = [run for run in document["runs"] if run["history"]]
    if document["referee"] is None or all(len(run["history"]) < 2 for run in runs):
        return None
    made, ((axis,),) = figure(style.width, TALL * style.low)
    referee = document["referee"]["total"]
    for k, run in enumerate(runs):
        history = run["history"]
        sweeps = [check["sweep"] for check in history]
        above = [_relative(check["upper"] - referee["lower"], referee) for check in history]
        below = [_relative(referee["upper"] - check["lower"], referee) for check in history]
        looks = line_looks(k, marked=True) | {"ms": style.mark}
        title = run["name"] if run["epsilon"] is None else f"ε = {run['epsilon']:g}"
        axis.plot(sweeps, above, label=title, **looks)
        axis.plot(sweeps, below, mfc="white", **looks)
    error_axis(axis)
    label(axis, "sweeps; upper bound filled, lower bound hollow", ERROR, "")
    titled(axis, style, "Convergence")
    _legend(made, axis, 4)
    return made


def _legend(made: Figure, axis: Axes, columns: int) -> None:
    """Draw a legend above the axes, with all labels of these axes."""
    handles, names = axis.get_legend_handles_labels()
    legend(made, handles, names, columns)


def error_axis(axis: Axes, *, vertical: bool = True) -> None:
    """Make an axis of errors logarithmic, with ticks at powers of ten.

    If the axis begins at `FLOOR`, a note explains it.
    """
    which = axis.yaxis if vertical else axis.xaxis
    (axis.set_yscale if vertical else axis.set_xscale)("log")
    low, high = axis.get_ylim() if vertical else axis.get_xlim()
    at_floor = low <= 3 * FLOOR
    # The limits are powers of ten. With other limits, there may be no power of ten between them.
    low, high = (10.0 ** end(math.log10(at)) for end, at in ((math.floor, low), (math.ceil, high)))
    limits = (FLOOR if at_floor else low, max(high, low * 100))
    (axis.set_ylim if vertical else axis.set_xlim)(*limits)
    which.set_major_locator(LogLocator(numticks=10))
    which.set_major_formatter(LogFormatterSciNotation())
    which.set_minor_formatter(NullFormatter())
    if at_floor:
        looks: Any = {"fontsize": "x-small", "color": LIGHT["soft"]}
        looks |= {"xycoords": "axes fraction", "textcoords": "offset points"}
        below = -4.6 * float(axis.xaxis.label.get_fontsize())
        axis.annotate(AT_FLOOR, (0, 0), xytext=(0, below), **looks)


def seconds_axis(which: Axis) -> None:
    """Make the vertical axis of times logarithmic, with plain numbers: 0.2, not 2 * 10^-1."""
    which.axes.set_yscale("log")
    low, high = which.get_view_interval()
    subs = (1, 2, 5) if high < 300 * low else (1,)
    which.set_major_locator(LogLocator(subs=subs, numticks=12))
    which.set_major_formatter(lambda value, _: number(value, 3) if value >= 1e-4 else f"{value:g}")
    which.set_minor_formatter(NullFormatter())


def floored(error: float | None) -> float:
    """Return the error, but at least `FLOOR`; NaN for a missing error."""
    return float("nan") if error is None else max(error, FLOOR)


def _relative(difference: float, referee: Json) -> float:
    return max(difference / referee["upper"], FLOOR) if referee["upper"] > 0 else FLOOR


# -------------------------------------------------------------------------------------------------
# Pictures of a scaling study.


def _solved(document: Json) -> bool:
    """Check whether at least one run of a scaling study succeeded and has a time."""
    runs = (run for size in document["sizes"] for run in size["solvers"])
    return any(run["seconds"]["mean"] is not None for run in runs)


def draw_study_errors(document: Json, style: Style) -> Figure | None:
    """Draw errors over temperature, with lines for each number of targets.

    Only scenes (simulated recordings) with the largest number of steps are drawn.
    """
    runs = [s for size in document["sizes"] for s in size["solvers"] if s["epsilon"] is not None]
    errors = (run[name]["max"] for run in runs for name in ("error", "entropic_error"))
    several = len(runs) > len(document["sizes"])
    if not (_solved(document) and several and _has_errors(errors)):
        return None
    longest = max(size["steps"] for size in document["sizes"])
    sizes = [size for size in document["sizes"] if size["steps"] == longest]
    lines = {}
    for size in sorted(sizes, key=itemgetter("targets")):
        runs = sorted((run for run in size["solvers"] if run["epsilon"] is not None), key=_epsilon)
        for name, error in (("", "error"), (", entropic value", "entropic_error")):
            lines[f"m = {size['targets']:,}{name}"] = runs, [run[error] for run in runs]
    return _by_temperature(lines, style, f", T = {longest:,}")


def draw_scaling(document: Json, style: Style) -> Figure | None:
    """Draw time and error over the number of targets, and over the number of steps.

    Panels over the number of targets show the scenes (simulated recordings) with the most steps.
    Panels over the number of steps show the scenes with the most targets.
    """
    sizes = document["sizes"]
    if len(sizes) < 2 or not _solved(document):
        return None
    largest = {name: max(size[name] for size in sizes) for name in SIZES}
    rows = []
    for varied, fixed in zip(SIZES, SIZES[::-1], strict=True):
        chosen = [size for size in sizes if size[fixed] == largest[fixed]]
        if len(chosen) > 1:
            rows.append((varied, fixed, sorted(chosen, key=itemgetter(varied))))
    # Panels of errors are drawn only if there are errors above `FLOOR`.
    with_errors = any(
        _has_errors(run["error"]["max"] for size in chosen for run in size["solvers"])
        for _, _, chosen in rows
    )
    columns = 2 if with_errors else 1
    made, axes = figure(style.width, (TALL * len(rows) + 0.1) * style.low, len(rows), columns)
    for panels, (varied, fixed, chosen) in zip(axes, rows, strict=True):
        name = "targets m" if varied == "targets" else "time steps T"
        where = f"{'T' if fixed == 'steps' else 'm'} = {largest[fixed]:,}"
        left = panels[0]
        for k, run in enumerate(chosen[0]["solvers"]):
            runs = [size["solvers"][k] for size in chosen]
            x = [size[varied] for size in chosen]
            _line(left, x, [item["seconds"] for item in runs], k, run["name"], 1e-9, style)
        if left.lines:
            seconds_axis(left.yaxis)
        label(left, name, SPENT, f"Time, {where}")
        if with_errors:
            exact = _errors(panels[1], varied, chosen, style)
            below = f"\n{', '.join(exact)}: below {FLOOR:g}" if exact else ""
            label(panels[1], name, ERROR, f"Error, {where}{below}")
        for axis in panels:
            x = [size[varied] for size in chosen]
            _ticks(axis, x, ",")
            axis.set_xlim(x[0] / (x[-1] / x[0]) ** 0.05, x[-1] * (x[-1] / x[0]) ** 0.05)
    if not with_errors:
        title = f"{axes[0, 0].get_title(loc='left')}; all errors are below {FLOOR:g}"
        axes[0, 0].set_title(title, fontsize="medium", loc="left")
    _legend(made, axes[0, 0], 3 * columns)
    return made


def _errors(axis: Axes, varied: str, chosen: Sequence[Json], style: Style) -> list[str]:
    """Draw the errors of each solver over the number of targets or steps (`varied`).

    Return the names of solvers whose errors are all zero. `chosen` has the drawn sizes.
    """
    exact = []
    for k, run in enumerate(chosen[0]["solvers"]):
        errors = [size["solvers"][k]["error"] for size in chosen]
        if _has_errors(error["max"] for error in errors):
            _line(axis, [size[varied] for size in chosen], errors, k, run["name"], FLOOR, style)
        elif any(error["max"] is not None for error in errors):
            exact.append(run["name"])
    if axis.lines:
        error_axis(axis)
    else:
        axis.set_yticks([])
    return exact


def _ticks(axis: Axes, x: Sequence[float], form: str = "g") -> None:
    """Make the horizontal axis logarithmic, with ticks only at these values."""
    axis.set_xscale("log")
    axis.set_xticks(x, [f"{value:{form}}" for value in x], minor=False)
    axis.set_xticks([], minor=True)


def _line(
    axis: Axes,
    x: Sequence[float],
    values: Sequence[Json],
    k: int,
    name: str,
    floor: float,
    style: Style,
) -> None:
    """Draw the k-th line, through means, with a band of one standard deviation above and below.

    Line and band do not go below `floor`. If all runs failed, a value has no mean and is left out.
    """
    kept = [
        (at, max(value["mean"], floor), value["deviation"] or 0.0)
        for at, value in zip(x, values, strict=True)
        if value["mean"] is not None
    ]
    if not kept:
        return
    x, mean, spread = map(list, zip(*kept, strict=True))
    low = [max(m - s, floor, m / 10) for m, s in zip(mean, spread, strict=True)]
    high = [m + s for m, s in zip(mean, spread, strict=True)]
    looks = line_looks(k, marked=True) | {"ms": style.mark, "label": name, "clip_on": False}
    axis.fill_between(x, low, high, color=looks["color"], alpha=0.15, linewidth=0)
    axis.plot(x, mean, **looks)


# -------------------------------------------------------------------------------------------------
# Picture of several estimates of one ground truth.


def draw_cumulative(
    costs_of_steps: tuple[Sequence[Time], Mapping[str, Sequence[float]]], style: Style
) -> Figure | None:
    """Draw the sum of the costs up to each step, a line for each estimate.

    `costs_of_steps` has the times of the steps and, for each estimate by its name, the cost of each
    step.
    """
    times, series = costs_of_steps
    if not any(series.values()):
        return None
    made, ((axis,),) = figure(style.width, TALL * style.low + 0.04 * style.mark * len(series))
    lines, names = [], []  # not set as labels: a legend hides labels that begin with _
    time = TimeAxis.of(times)
    begin, end = time.edges
    for k, (name, costs) in enumerate(series.items()):
        total = list(itertools.accumulate(costs))
        lines += axis.plot(time.at, total, clip_on=False, **line_looks(k, marked=len(total) == 1))
        names.append(f"{literal(name, 30)}: {number(total[-1])}")
    axis.set_ylim(0, None)
    label(axis, "", "cost of all steps so far", "")
    titled(axis, style, "Cumulative cost")
    name_times(axis, time, (begin[0], end[-1]), style.width)
    legend(made, lines, names, 1)
    return made


# -------------------------------------------------------------------------------------------------
# Picture of a sweep: TGOSPA, costs and counts over the values of a parameter.

AXIS_NAMES = {
    "cutoff": "cutoff $c$",
    "order": "order $p$",
    "switch_penalty": r"switch penalty $\gamma$",
    "rho": r"share of false targets $\rho$",
}
LOGARITHMIC = 0.25
"""Part of the range of an axis, from its low end. If it has half of the values, the axis is
logarithmic."""


def draw_sweep(sweep: SweepEvaluation, style: Style) -> Figure:
    """Draw eight panels over the parameter: four parts of the cost, TGOSPA, and three counts.

    A grey band marks the range of the parameter over which the counts of missed and false targets
    are constant.
    """
    table: Columns = sweep.columns()
    x = [point.value for point in sweep.points]
    rows = 2 if style.wide else 4  # one column of a journal has room for two panels
    made, axes = figure(style.width, 0.75 * rows * style.low, rows, 8 // rows)
    panels = {name: name for name in PARTS} | {"TGOSPA": "tgospa"}
    panels |= {f"number, {name}": f"{name}_count" for name in COUNTED_PARTS}
    for k, (axis, (title, name)) in enumerate(zip(axes.flat, panels.items(), strict=True)):
        at = k % len(PARTS)
        looks: dict[str, Any] = {"marker": MARKERS[at], "ms": style.mark, "clip_on": False}
        looks["color"] = INK if name == "tgospa" else LIGHT[PARTS[at]]
        axis.plot(x, table[name], "-", **looks)
        if name == "tgospa" and not sweep.certified:
            lower, upper = table["lower_bound"], table[name]
            axis.fill_between(x, lower, upper, color=INK, alpha=0.15, linewidth=0)
        label(axis, "", "" if k else "cost", title)
    band = sweep.unchanged("missed_count", "false_count")
    # Values with evenly spaced logarithms would crowd at the left of a linear axis.
    low, middle, high = x[0], sorted(x)[len(x) // 2], x[-1]
    crowded = len(x) > 2 and low > 0 and middle - low < LOGARITHMIC * (high - low)
    for axis in axes.flat:
        if band is not None:
            axis.axvspan(
                *(x[k] for k in band), color=LIGHT["grid"], alpha=0.6, zorder=0, linewidth=0
            )
        if crowded:
            _ticks(axis, (x[0], x[len(x) // 2], x[-1]), ".3g")
        axis.set_ylim(0, None)
    made.supxlabel(
        AXIS_NAMES[sweep.parameter]
        + (f" ({literal(sweep.unit)})".replace("$", r"\$") if sweep.unit else "")
        + (
            "; grey: the numbers of missed and false targets do not change"
            if band is not None
            else ""
        ),
        fontsize="medium",
    )
    return made


# -------------------------------------------------------------------------------------------------
# Pictures of a batch (table of jobs, parts of the costs, curves over time), and of a gate.

MAX_BARS = 40

PANEL = 0.62
"""Height of a panel if there are several, relative to the height of a single panel."""

MAX_BELOW = 4
"""Largest number of panels below each other. If there are more, they are in two columns."""

ROW = 0.21
"""Height of a row of text in inches."""


def draw_runs(
    scenes: Mapping[str, tuple[Sequence[float], Sequence[float]]], style: Style
) -> Figure:
    """Draw the totals of the runs of a gate, and the totals of the runs of its baseline.

    The runs of a scene differ only in their seed. For each scene, `scenes` has the totals of the
    baseline's runs, and the totals of the current runs. They are shown relative to the mean of the
    baseline. If there are many scenes, only those with the largest changes of the mean are drawn.
    """

    def change(name: str) -> float:
        old, now = (float(np.mean(totals)) for totals in scenes[name])
        return -abs(now / old - 1)

    names = sorted(scenes, key=change)[:MAX_BARS]
    made, axes = figure(style.width, 1.0 + 1.5 * ROW * len(names))
    axis = axes[0, 0]
    for row, name in enumerate(names):
        old, now = (np.array(totals) / np.mean(scenes[name][0]) for totals in scenes[name])
        looks: dict[str, Any] = {"linestyle": "", "ms": 4, "clip_on": False}
        marks = [
            axis.plot(old, np.full(len(old), row + 0.35), "o", mfc="white", color=SOFT, **looks)[0],
            axis.plot(now, np.full(len(now), row + 0.65), "o", color=COLOURS[0], **looks)[0],
        ]
    axis.axvline(1.0, color=INK, linewidth=0.8)
    axis.set_ylim(len(names), 0)
    _names(axis, names, upright=True)
    axis.set_xlabel("total, as a share of the mean of the baseline's runs")
    legend(made, marks, ["runs of the baseline", "current runs"], 2)
    return made


def draw_curves(tables: BatchTables, style: Style, *, parts: bool = False) -> Figure | None:
    """Draw the curves of all groups over time with their bands, a panel for each kind of curve.

    If `parts`, the parts of the cost are drawn instead of the total. Then each part has a row of
    panels, and each kind of curve has a column.
    """
    unit = tables.unit
    lines: Sequence[str] = PARTS if parts else ("total",)
    curves = [(track, curve) for track, curve in tables.plotted_curves if lines[0] in curve.rms]
    if not curves:
        return None
    kinds = [kind for kind in CURVE_KINDS if any(curve.kind == kind for _, curve in curves)]
    if parts:
        made, axes = figure(style.width, PANEL * style.low * len(lines), len(lines), len(kinds))
        for axis, kind in zip(axes[0], kinds, strict=True):
            about = CURVE_KINDS[kind].replace(" up to", "\nup to" if len(kinds) > 2 else " up to")
            axis.set_title(about, fontsize="medium", loc="left")
    else:
        made, axes = figure(style.width, style.low * len(kinds), len(kinds))
        axes = axes.T
        counts = {count for _, curve in curves for count in curve.runs}
        runs = " to ".join(map("{:,}".format, sorted({min(counts), max(counts)})))
        titled(axes[0, 0], style, f"Root mean square over the runs ({runs} at each time)")
    clock, places, ends = on_one_axis([curve for _, curve in curves])
    lines_by_group: dict[str, Artist] = {}
    for (row, column), axis in np.ndenumerate(axes):
        name, kind = lines[row], kinds[column]
        top = 0.0
        for (track, curve), at in zip(curves, places, strict=True):
            if curve.kind == kind:
                group = literal(curve.name or "all jobs")
                lines_by_group[group] = _draw_line(axis, at, curve, name, track)
                top = max(top, curve.top(name))
        axis.set_ylim(0, ROOM * top or 1.0)
        name_times(axis, clock, ends, style.width / (len(kinds) if parts else 1))
        about = LINE_NAMES[name].removeprefix("RMS ").replace(" error", "\nerror")
        about += "" if parts else f"\n{CURVE_KINDS[kind]}"
        if not (parts and column):
            axis.set_ylabel(f"{about} ({literal(unit)})" if unit else about, parse_math=False)
        if parts and row + 1 < len(lines):
            axis.set_xlabel("")
    legend(made, list(lines_by_group.values()), list(lines_by_group), 4 if style.wide else 3)
    return made


def draw_over_time(tables: BatchTables, style: Style) -> Figure | None:
    """Draw the curves of kind ``step``: costs per step, number of states, detection rate and NEES.

    Each of these quantities has a panel, with a line for each group.
    """
    curves = [(track, curve) for track, curve in tables.plotted_curves if curve.kind == "step"]
    lines = [
        name
        for name in LINE_NAMES
        if any(name in curve.rms or name in curve.means for _, curve in curves)
    ]
    if not curves:
        return None
    across = 2 if len(lines) > MAX_BELOW else 1
    down = -(-len(lines) // across)
    made, axes = figure(style.width, PANEL * style.low * down, down, across)
    clock, places, ends = on_one_axis([curve for _, curve in curves])
    lines_by_group: dict[str, Artist] = {}
    for k, axis in enumerate(axes.T.flat):
        if k >= len(lines):
            axis.set_visible(False)
            continue
        name, top = lines[k], 0.0
        for (track, curve), at in zip(curves, places, strict=True):
            if name in curve.rms or name in curve.means:
                group = literal(curve.name or "all jobs")
                lines_by_group[group] = _draw_line(axis, at, curve, name, track)
                top = max(top, curve.top(name))
            if name == "estimate_states" and name in curve.means:
                truth = curve.means["truth_states"]
                looks: dict[str, Any] = {"color": INK, "linewidth": 0.8, "zorder": 1}
                lines_by_group["truth"] = axis.plot(at, truth, **looks)[0]
                top = max(top, *truth)
        if name == NEES:  # a horizontal line at the mean NEES of correct covariances
            rows = map(NeesSums.of_row, tables.rows.to_dict("records"))
            components = next(sums.components for sums in rows if sums is not None)
            axis.axhline(components, color=INK, linewidth=0.8, zorder=1)
            top = max(top, components)
        axis.set_ylim(0, ROOM * top or 1.0)
        name_times(axis, clock, ends, style.width / across)
        about = LINE_NAMES[name].removesuffix(" error")
        has_unit = tables.unit and name not in ("estimate_states", "detection_rate", NEES)
        about += f" ({literal(tables.unit)})" if has_unit else ""
        axis.set_title(about, fontsize="medium", loc="left", parse_math=False)
        if (k + 1) % down and k + 1 < len(lines):
            axis.set_xlabel("")
    legend(made, list(lines_by_group.values()), list(lines_by_group), 4 if style.titles else 3)
    return made


def draw_curve_parts(tables: BatchTables, style: Style) -> Figure | None:
    """Draw the curves of the parts of the cost."""
    return draw_curves(tables, style, parts=True)


def _draw_line(axis: Axes, at: Floats, curve: RmsCurve, name: str, track: int) -> Artist:
    """Draw a line of a curve and its band. `track` is the index of the colour of the line."""
    looks = line_looks(track, marked=len(at) == 1)
    looks["color"] = colour = TRACK_COLOURS[track % len(TRACK_COLOURS)]
    if name in curve.bands:
        low, high = (np.array(end, float) for end in curve.bands[name])
        axis.fill_between(at, low, high, color=colour, alpha=0.16, linewidth=0)
    return axis.plot(at, curve.values(name), clip_on=False, **looks)[0]


def draw_parts(tables: BatchTables, style: Style) -> Figure | None:
    """Draw the cost per step of each group as stacked bars."""
    shown = [(group["name"] or "all jobs", group["costs"]) for group in tables.shown_groups]
    shown = shown[:MAX_BARS]
    if not shown:
        return None
    orders = tables.rows["order"].dropna().unique()
    unit = power(tables.unit, orders[0]) if len(orders) == 1 else ""
    made, ((axis,),) = figure(style.width, 1.1 + ROW * 1.5 * len(shown))
    costs = {str(name): np.array([parts[name] for _, parts in shown], float) for name in PARTS}
    bars(axis, [name for name, _ in shown], costs, letters=30)
    axis.set_xlabel(f"cost per step{unit}", parse_math=False)
    titled(axis, style, "Parts of the cost")
    legend(made, [Patch(**FILLS[name]) for name in PARTS], list(PARTS), 4)
    return made


def draw_heat(tables: BatchTables, style: Style) -> Figure | None:
    """Draw the table of jobs as coloured cells, with the value per step in each cell.

    If the table has many rows, each row becomes a column of the picture, and no numbers are shown.
    """
    heat, unit = tables.heat, tables.unit
    if heat is None or heat["ends"] is None:
        return None

    def value(cell: Json | None) -> float:
        if cell is None or cell["value"] is None:
            return np.nan
        return float(cell["level"] if heat["scales"] > 1 else cell["value"].upper)

    values = np.array([[value(cell) for cell in row] for row in heat["cells"]])
    if heat["squares"]:
        values = values.T
    high = ROW * len(values) * (2 if heat["squares"] else 1)
    made, ((axis,),) = figure(style.width, 1.3 + high)
    axis.grid(visible=False)
    colours = ListedColormap(heat_shades(LIGHT))
    mesh = axis.pcolormesh(np.ma.masked_invalid(values), cmap=colours, rasterized=heat["squares"])
    what = f"TGOSPA per step ({literal(unit)})" if unit else "TGOSPA per step"
    bar = made.colorbar(mesh, ticks=[] if heat["scales"] > 1 else None)
    own = ", from the smallest to the largest of the same parameters" if heat["scales"] > 1 else ""
    bar.set_label(what + own, parse_math=False)
    axis.set_ylim(len(values), 0)
    if heat["squares"]:
        _names(axis, heat["columns"], upright=True)
        axis.set_xlabel(f"{literal(heat['down'], 40)}, in order", parse_math=False)
    else:
        _names(axis, heat["columns"], upright=False)
        _names(axis, heat["rows"], upright=True)
        _numbers(axis, heat)
    for side in axis.spines.values():
        side.set_visible(False)
    titled(axis, style, f"{literal(heat['down'])} by {literal(heat['across'])}")
    return made


def _numbers(axis: Axes, heat: Json) -> None:
    """Write the value in each cell, in bold if it is proven to be the best of its row."""
    for k, row in enumerate(heat["cells"]):
        for column, cell in enumerate(row):
            if cell is None:
                continue
            weight = "bold" if cell["best"] else "normal"
            axis.text(
                column + 0.5, k + 0.5, cell["text"], ha="center", va="center", fontsize="small",
                fontweight=weight, color=LIGHT["ink"] if cell["value"] else SOFT,
            )  # fmt: skip


def _names(axis: Axes, names: Sequence[str], *, upright: bool) -> None:
    """Write names at the vertical axis if `upright`, else at the horizontal axis."""
    which = axis.yaxis if upright else axis.xaxis
    places = np.arange(len(names)) + 0.5
    which.set_ticks(places, [literal(name, 30) for name in names], parse_math=False)
    which.set_tick_params(length=0)
