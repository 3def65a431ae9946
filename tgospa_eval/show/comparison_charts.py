"""Pictures of `compare`: errors, times and convergence of solvers; takes its documents."""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from tgospa_eval.common.words import number
from tgospa_eval.results.records import COUNTED_PARTS, PARTS, Json, Time
from tgospa_eval.results.sweep import Point, Sweep
from tgospa_eval.show.figures import COLOURS, MARKERS, Draw, figure, label
from tgospa_eval.show.overtime import name_times
from tgospa_eval.show.palette import LIGHT
from tgospa_eval.show.time_axis import TimeAxis, moments

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


FLOOR = 1e-9
"""Errors below count as none; they are drawn here."""

SIZES = ("targets", "steps")

SPENT, ERROR = "seconds, solving and proof", "relative error, at most"
TEMPERATURE = "temperature ε, fraction of $c^p$"
AT_FLOOR = f"errors below {FLOOR:g} are drawn at {FLOOR:g}"


def solver_pictures(document: Json) -> Draw:
    """By file name, those pictures that have something to show; none if there is no true value."""
    if document["referee"] is None:
        return {}
    draw = {"time_over_error": partial(time_over_error, document)}
    runs = _temperatures(document)
    if len(runs) > 1 and _seen(
        value
        for run in runs
        for value in (run["error"], run["lower_error"], (run["entropic"] or {}).get("error"))
    ):
        draw["error_over_epsilon"] = partial(error_over_epsilon, document)
    if any(len(run["history"]) > 1 for run in document["runs"]):
        draw["convergence"] = partial(convergence, document)
    return draw


def _seen(errors: Iterable[float | None]) -> bool:
    """Whether one of them is more than none."""
    return any(error is not None and error > FLOOR for error in errors)


def error_over_epsilon(document: Json) -> "Figure":
    """How far the bounds of `sinkhorn` are from what all runs prove, by temperature."""
    made, ((axis,),) = figure(5.2, 3.6)
    runs = sorted(_temperatures(document), key=_epsilon)
    x = [*map(_epsilon, runs)]
    lines = {
        "upper bound (TGOSPA)": [floored(run["error"]) for run in runs],
        "lower bound": [floored(run["lower_error"]) for run in runs],
        "entropic value": [floored((run["entropic"] or {}).get("error")) for run in runs],
        "its cost, without entropy": [
            floored((run["entropic"] or {}).get("cost_error")) for run in runs
        ],
    }
    for k, (title, y) in enumerate(lines.items()):
        axis.plot(x, y, f"-{MARKERS[k]}", color=COLOURS[k], label=title, clip_on=False, zorder=3)
    _ticks(axis, x)
    error_axis(axis)
    label(axis, TEMPERATURE, ERROR, "Error of sinkhorn by temperature")
    axis.legend(frameon=False)
    return made


def time_over_error(document: Json) -> "Figure":
    """What an accuracy costs: solving and proof; bars of the time where nobody errs."""
    runs = [run for run in document["runs"] if run["seconds"] is not None]
    if not _seen(run["error"] for run in runs):
        return _times(runs)
    made, ((axis,),) = figure(6.2, 3.6)
    solvers = list(dict.fromkeys(run["solver"] for run in runs))
    for k, run in enumerate(runs):
        looks = {"ms": 7, "alpha": 0.8, "clip_on": False, "zorder": 3, "label": run["name"]}
        looks["color"] = COLOURS[solvers.index(run["solver"])]
        axis.plot([floored(run["error"])], [_spent(run)], MARKERS[k % len(MARKERS)], **looks)
    seconds_axis(axis.yaxis)
    error_axis(axis, vertical=False)
    label(axis, ERROR, SPENT, "Time and error")
    made.legend(*axis.get_legend_handles_labels(), loc="outside right upper", frameon=False)
    return made


def _times(runs: Sequence[Json]) -> "Figure":
    made, ((axis,),) = figure(6.2, 0.9 + 0.3 * len(runs))
    place, spent = range(len(runs)), [_spent(run) for run in runs]
    axis.barh(place, spent, 0.6, color=COLOURS[0])
    for at, seconds in zip(place, spent, strict=True):
        axis.annotate(
            f" {seconds:.3g}", (seconds, at), va="center", fontsize="small", annotation_clip=False
        )
    axis.set_yticks(place, [run["name"] for run in runs])
    axis.tick_params(axis="y", length=0)
    axis.grid(visible=False, axis="y")
    axis.set_ylim(len(runs) - 0.4, -0.6)
    axis.set_xlim(0, max(spent, default=0.0) * 1.1 or 1.0)
    label(axis, SPENT, "", f"Time; all errors are below {FLOOR:g}")
    return made


def _spent(run: Json) -> float:
    seconds = run["seconds"]
    return 0.0 if seconds is None else seconds["solve"] + seconds["certify"]


def _epsilon(run: Json) -> float:
    return run["epsilon"] or 0.0


def convergence(document: Json) -> "Figure":
    """Bounds of `sinkhorn` while it sweeps, against what all runs prove."""
    made, ((axis,),) = figure(5.2, 3.6)
    assert document["referee"] is not None
    referee = document["referee"]["total"]
    runs = [run for run in document["runs"] if run["history"]]
    for k, run in enumerate(runs):
        sweeps = [check["sweep"] for check in run["history"]]
        above = [_relative(check["upper"] - referee["lower"], referee) for check in run["history"]]
        below = [_relative(referee["upper"] - check["lower"], referee) for check in run["history"]]
        colour = COLOURS[k % len(COLOURS)]
        title = run["name"] if run["epsilon"] is None else f"ε = {run['epsilon']:g}"
        axis.plot(sweeps, above, "-", marker=MARKERS[k % 7], ms=4, color=colour, label=title)
        axis.plot(sweeps, below, "--", marker=MARKERS[k % 7], ms=4, color=colour, mfc="white")
    error_axis(axis)
    label(axis, "sweeps", ERROR, "Convergence: upper bound (solid), lower bound (dashed)")
    axis.legend(frameon=False, fontsize="small")
    return made


def error_axis(axis: "Axes", *, vertical: bool = True) -> None:
    """A logarithmic axis of errors, by powers of ten, that says what stands at its end."""
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

    which = axis.yaxis if vertical else axis.xaxis
    (axis.set_yscale if vertical else axis.set_xscale)("log")
    low, high = axis.get_ylim() if vertical else axis.get_xlim()
    at_floor = low <= 3 * FLOOR
    # from one power of ten to another, for there may be none in between
    low, high = (10.0 ** end(math.log10(at)) for end, at in ((math.floor, low), (math.ceil, high)))
    limits = (FLOOR if at_floor else low, max(high, low * 100))
    (axis.set_ylim if vertical else axis.set_xlim)(*limits)
    which.set_major_locator(LogLocator(numticks=10))
    which.set_major_formatter(LogFormatterSciNotation())
    which.set_minor_formatter(NullFormatter())
    if at_floor:
        looks: Any = {"fontsize": "x-small", "color": LIGHT["soft"]}
        looks |= {"xycoords": "axes fraction", "textcoords": "offset points"}
        axis.annotate(AT_FLOOR, (0, 0), xytext=(0, -44), **looks)


def seconds_axis(which: "Axis") -> None:
    """A logarithmic upright axis of times, written out: 0.2 and not 2 times a power of ten."""
    from matplotlib.ticker import LogLocator, NullFormatter

    which.axes.set_yscale("log")
    low, high = which.get_view_interval()
    subs = (1, 2, 5) if high < 300 * low else (1,)
    which.set_major_locator(LogLocator(subs=subs, numticks=12))
    which.set_major_formatter(lambda value, _: number(value, 3) if value >= 1e-4 else f"{value:g}")
    which.set_minor_formatter(NullFormatter())


def floored(error: float | None) -> float:
    """An error that has a logarithm; none is not a number and leaves a hole."""
    return float("nan") if error is None else max(error, FLOOR)


def _relative(difference: float, referee: Json) -> float:
    return max(difference / referee["upper"], FLOOR) if referee["upper"] > 0 else FLOOR


def _temperatures(document: Json) -> Sequence[Json]:
    return [
        run for run in document["runs"] if run["epsilon"] is not None and run["seconds"] is not None
    ]


# --- study ----------------------------------------------------------------------------------------


def study_pictures(document: Json) -> Draw:
    """By file name, those pictures that have something to show."""
    sizes = document["sizes"]
    draw: dict[str, Callable[[], Figure]] = {}
    temperatures = [s for s in sizes[0]["solvers"] if s["epsilon"] is not None]
    if not any(s["seconds"]["mean"] is not None for size in sizes for s in size["solvers"]):
        return {}  # all failed, or all contradict each other
    errors = (
        s[name]["max"]
        for size in sizes
        for s in size["solvers"]
        if s["epsilon"] is not None
        for name in ("error", "entropic_error")
    )
    if len(temperatures) > 1 and _seen(errors):
        draw["error_over_epsilon"] = partial(study_errors, document)
    if len(sizes) > 1:
        draw["scaling"] = partial(scaling, document)
    return draw


def study_errors(document: Json) -> "Figure":
    """Error over temperature, a line for each number of targets, at the largest number of steps."""
    made, ((axis,),) = figure(5.2, 3.6)
    longest = max(size["steps"] for size in document["sizes"])
    sizes = [size for size in document["sizes"] if size["steps"] == longest]
    sizes.sort(key=itemgetter("targets"))
    for k, size in enumerate(sizes):
        runs = sorted((run for run in size["solvers"] if run["epsilon"] is not None), key=_epsilon)
        x = [*map(_epsilon, runs)]
        name = f"m = {size['targets']:,}"
        _line(axis, x, [run["error"] for run in runs], k, name, FLOOR)
        values = [run["entropic_error"] for run in runs]
        _line(axis, x, values, k, f"{name}, entropic value", FLOOR, "--")
    _ticks(axis, x)
    error_axis(axis)
    label(axis, TEMPERATURE, ERROR, f"Error of sinkhorn by temperature, T = {longest:,}")
    if axis.lines:
        axis.legend(frameon=False)
    return made


def scaling(document: Json) -> "Figure":
    """Time and error over targets at the most steps, and over steps at the most targets."""
    sizes = document["sizes"]
    most = {name: max(size[name] for size in sizes) for name in SIZES}
    rows = []
    for varied, fixed in zip(SIZES, SIZES[::-1], strict=True):
        chosen = [size for size in sizes if size[fixed] == most[fixed]]
        if len(chosen) > 1:
            rows.append((varied, fixed, sorted(chosen, key=itemgetter(varied))))
    # A panel of errors is drawn where there are some.
    with_errors = any(
        _seen(run["error"]["max"] for size in chosen for run in size["solvers"])
        for _, _, chosen in rows
    )
    columns = 2 if with_errors else 1
    made, axes = figure(4.5 * columns + 1.0 * (columns == 1), 3.3 * len(rows), len(rows), columns)
    for panels, (varied, fixed, chosen) in zip(axes, rows, strict=True):
        name = "targets m" if varied == "targets" else "time steps T"
        where = f"{'T' if fixed == 'steps' else 'm'} = {most[fixed]:,}"
        left = panels[0]
        for k, run in enumerate(chosen[0]["solvers"]):
            runs = [size["solvers"][k] for size in chosen]
            x = [size[varied] for size in chosen]
            _line(left, x, [item["seconds"] for item in runs], k, run["name"], 1e-9)
        if left.lines:
            seconds_axis(left.yaxis)
        label(left, name, SPENT, f"Time, {where}")
        if with_errors:
            exact = _errors(panels[1], varied, chosen)
            below = f"\n{', '.join(exact)}: below {FLOOR:g}" if exact else ""
            label(panels[1], name, ERROR, f"Error, {where}{below}")
        for axis in panels:
            x = [size[varied] for size in chosen]
            _ticks(axis, x, ",")
            axis.set_xlim(x[0] / (x[-1] / x[0]) ** 0.05, x[-1] * (x[-1] / x[0]) ** 0.05)
    if not with_errors:
        title = f"{axes[0, 0].get_title(loc='left')}; all errors are below {FLOOR:g}"
        axes[0, 0].set_title(title, fontsize="medium", loc="left")
    handles, names = axes[0, 0].get_legend_handles_labels()
    if names:
        beside = min(len(names), 3 * columns)
        made.legend(handles, names, loc="outside upper center", ncols=beside, frameon=False)
    return made


def _errors(axis: "Axes", varied: str, chosen: Sequence[Json]) -> list[str]:
    """Lines of the errors of those that have any; returns the names of the others."""
    exact = []
    for k, run in enumerate(chosen[0]["solvers"]):
        errors = [size["solvers"][k]["error"] for size in chosen]
        if _seen(error["max"] for error in errors):
            _line(axis, [size[varied] for size in chosen], errors, k, run["name"], FLOOR)
        elif any(error["max"] is not None for error in errors):
            exact.append(run["name"])
    if axis.lines:
        error_axis(axis)
    else:
        axis.set_yticks([])
    return exact


def _ticks(axis: "Axes", x: Sequence[float], form: str = "g") -> None:
    """A logarithmic axis that names these values, and no others."""
    axis.set_xscale("log")
    axis.set_xticks(x, [f"{value:{form}}" for value in x], minor=False)
    axis.set_xticks([], minor=True)


def _line(
    axis: "Axes",
    x: Sequence[float],
    values: Sequence[Json],
    k: int,
    name: str,
    least: float,
    line: str = "-",
) -> None:
    """Means with a band of one standard deviation, at least `least`; nothing where all failed."""
    kept = [
        (at, max(value["mean"], least), value["deviation"] or 0.0)
        for at, value in zip(x, values, strict=True)
        if value["mean"] is not None
    ]
    if not kept:
        return
    x, mean, spread = map(list, zip(*kept, strict=True))
    low = [max(m - s, least, m / 10) for m, s in zip(mean, spread, strict=True)]
    high = [m + s for m, s in zip(mean, spread, strict=True)]
    colour = COLOURS[k % len(COLOURS)]
    axis.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    axis.plot(x, mean, line, marker=MARKERS[k % len(MARKERS)], ms=5, color=colour, label=name)


# --- estimates ------------------------------------------------------------------------------------


def estimate_pictures(series: Mapping[str, Sequence[float]], times: Sequence[Time]) -> Draw:
    """By file name: where the estimates part. `series` holds the costs of the steps by name."""
    return {"cumulative": partial(cumulative, series, times)} if any(series.values()) else {}


def cumulative(series: Mapping[str, Sequence[float]], times: Sequence[Time]) -> "Figure":
    """Cost up to each step, a line for each estimate."""
    made, ((axis,),) = figure(6.2, 3.3 + 0.2 * len(series))
    lines, names = [], []  # kept here: names that begin with _ are hidden from a legend
    time = TimeAxis(times=times, axis=moments(times))
    begin, end = time.edges
    for k, (name, costs) in enumerate(series.items()):
        total = list(itertools.accumulate(costs))
        colour, dashes = COLOURS[k % len(COLOURS)], ("-", "--", ":", "-.")[k // len(COLOURS) % 4]
        dot = "o" if len(total) == 1 else ""
        lines += axis.plot(time.at, total, dashes + dot, color=colour, clip_on=False)
        names.append(f"{_literal(name)}: {number(total[-1])}")
    axis.set_ylim(0, None)
    label(axis, "", "cost of all steps so far", "Where the estimates part")
    name_times(axis, time, (begin[0], end[-1]), 6.2)
    made.legend(lines, names, loc="outside upper left", frameon=False)
    return made


def _literal(name: str) -> str:
    """A name of the user's, short and without formulas."""
    name = plain(name)
    return name if len(name) <= 30 else "..." + name[-27:]


# -------------------------------------------------------------------------------------------------
# Picture of a sweep of a parameter: value, costs and counts over it.

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
        _sweep_line(
            axis, x, [getattr(point, f"{name}_count") for point in points], PARTS.index(name)
        )
        label(axis, "", "", f"number, {name}")
    band = found.unchanged("missed_count", "false_count")
    for axis in axes.flat:
        if band is not None:
            axis.axvspan(*(x[k] for k in band), color="#eeeeee", zorder=0, linewidth=0)
        if _crowded(x):
            _ticks(axis, (x[0], x[len(x) // 2], x[-1]), ".3g")
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
