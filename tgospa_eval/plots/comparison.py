"""Pictures of `compare`: errors, times and convergence of solvers; takes its documents."""

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from tgospa_eval.plots import COLOURS, MARKERS, figure, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Document = dict[str, Any]

FLOOR = 1e-9
"""Errors below count as none; they are drawn here."""

AT_FLOOR = f"errors below {FLOOR:g} are drawn at {FLOOR:g}"


def solver_pictures(document: Document) -> "dict[str, Figure]":
    """By file name, those pictures that have something to show; none if there is no true value."""
    if document["referee"] is None:
        return {}
    made = {"time_over_error": time_over_error(document)}
    if len(_temperatures(document)) > 1:
        made["error_over_epsilon"] = error_over_epsilon(document)
    if any(run["history"] for run in document["runs"]):
        made["convergence"] = convergence(document)
    return made


def error_over_epsilon(document: Document) -> "Figure":
    """How far the bounds of `sinkhorn` are from what all runs prove, by temperature."""
    made, ((axis,),) = figure(5.2, 3.6)
    runs = sorted(_temperatures(document), key=lambda run: run["epsilon"])
    x = [run["epsilon"] for run in runs]
    for k, (name, title) in enumerate(
        (("error", "upper bound (TGOSPA)"), ("lower_error", "lower bound"))
    ):
        y = [floored(run[name]) for run in runs]
        axis.plot(x, y, f"-{MARKERS[k]}", color=COLOURS[k], label=title, clip_on=False, zorder=3)
    axis.set_xscale("log")
    error_axis(axis)
    axis.set_xticks(x, [f"{value:g}" for value in x], minor=False)
    axis.set_xticks([], minor=True)
    label(axis, "temperature ε, fraction of $c^p$", "relative error, at most",
          "Error of sinkhorn by temperature")  # fmt: skip
    axis.legend(frameon=False)
    return made


def time_over_error(document: Document) -> "Figure":
    """What an accuracy costs: solving and proof."""
    made, ((axis,),) = figure(6.2, 3.6)
    runs = [run for run in document["runs"] if run["seconds"] is not None]
    solvers = list(dict.fromkeys(run["solver"] for run in runs))
    for k, run in enumerate(runs):
        spent = run["seconds"]["solve"] + run["seconds"]["certify"]
        axis.plot(
            [floored(run["error"])], [spent], MARKERS[k % len(MARKERS)], ms=7,
            color=COLOURS[solvers.index(run["solver"])], label=run["name"], clip_on=False, zorder=3,
        )  # fmt: skip
    axis.set_yscale("log")
    error_axis(axis, vertical=False)
    label(axis, "relative error, at most", "seconds, solving and proof",
          "Time and error")  # fmt: skip
    made.legend(*axis.get_legend_handles_labels(), loc="outside right upper", frameon=False)
    return made


def convergence(document: Document) -> "Figure":
    """Bounds of `sinkhorn` while it sweeps, against what all runs prove."""
    made, ((axis,),) = figure(5.2, 3.6)
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
    label(axis, "sweeps", "relative error, at most",
          "Convergence: upper bound (solid), lower bound (dashed)")  # fmt: skip
    axis.legend(frameon=False, fontsize="small")
    return made


def error_axis(axis: "Axes", *, vertical: bool = True) -> None:
    """A logarithmic axis of errors that says what stands at its end."""
    (axis.set_yscale if vertical else axis.set_xscale)("log")
    low, high = axis.get_ylim() if vertical else axis.get_xlim()
    at_floor = low <= 3 * FLOOR
    limits = (FLOOR if at_floor else low, max(high, low * 100))
    (axis.set_ylim if vertical else axis.set_xlim)(*limits)
    if at_floor:
        axis.annotate(
            AT_FLOOR, (0, 0), xytext=(0, -44), xycoords="axes fraction",
            textcoords="offset points", fontsize="x-small", color="#555555",
        )  # fmt: skip


def floored(error: float | None) -> float:
    """An error that has a logarithm; none is not a number and leaves a hole."""
    return float("nan") if error is None else max(error, FLOOR)


def _relative(difference: float, referee: dict[str, float]) -> float:
    return max(difference / referee["upper"], FLOOR) if referee["upper"] > 0 else FLOOR


def _temperatures(document: Document) -> Sequence[Document]:
    return [
        run for run in document["runs"] if run["epsilon"] is not None and run["seconds"] is not None
    ]


# --- study ----------------------------------------------------------------------------------------


def study_pictures(document: Document) -> "dict[str, Figure]":
    """By file name, those pictures that have something to show."""
    sizes = document["sizes"]
    made = {}
    temperatures = [s for s in sizes[0]["solvers"] if s["epsilon"] is not None]
    if not any(s["seconds"]["mean"] is not None for size in sizes for s in size["solvers"]):
        return {}  # all failed, or all contradict each other
    if len(temperatures) > 1:
        made["error_over_epsilon"] = study_errors(document)
    if len(sizes) > 1:
        made["scaling"] = scaling(document)
    return made


def study_errors(document: Document) -> "Figure":
    """Error over temperature, a line for each number of targets, at the largest number of steps."""
    made, ((axis,),) = figure(5.2, 3.6)
    longest = max(size["steps"] for size in document["sizes"])
    sizes = sorted(
        (size for size in document["sizes"] if size["steps"] == longest),
        key=lambda size: size["targets"],
    )
    for k, size in enumerate(sizes):
        runs = sorted(
            (run for run in size["solvers"] if run["epsilon"] is not None),
            key=lambda run: run["epsilon"],
        )
        x = [run["epsilon"] for run in runs]
        _line(axis, x, [run["error"] for run in runs], k, f"m = {size['targets']}", FLOOR)
    axis.set_xscale("log")
    axis.set_xticks(x, [f"{value:g}" for value in x], minor=False)
    axis.set_xticks([], minor=True)
    error_axis(axis)
    label(axis, "temperature ε, fraction of $c^p$", "relative error, at most",
          f"Error of sinkhorn by temperature, T = {longest}")  # fmt: skip
    if axis.lines:
        axis.legend(frameon=False)
    return made


def scaling(document: Document) -> "Figure":
    """Time and error over targets at the most steps, and over steps at the most targets."""
    sizes = document["sizes"]
    most = {name: max(size[name] for size in sizes) for name in ("targets", "steps")}
    rows = [
        (varied, fixed)
        for varied, fixed in (("targets", "steps"), ("steps", "targets"))
        if len({size[varied] for size in sizes}) > 1
    ]
    made, axes = figure(9.0, 3.3 * len(rows), rows=len(rows), columns=2)
    letters = {"targets": "m", "steps": "T"}
    for (left, right), (varied, fixed) in zip(axes, rows, strict=True):
        chosen = sorted(
            (size for size in sizes if size[fixed] == most[fixed]), key=lambda size: size[varied]
        )
        x = [size[varied] for size in chosen]
        exact = []
        for k, run in enumerate(chosen[0]["solvers"]):
            runs = [size["solvers"][k] for size in chosen]
            _line(left, x, [item["seconds"] for item in runs], k, run["name"], 1e-9)
            errors = [item["error"] for item in runs]
            largest = [item["max"] for item in errors if item["max"] is not None]
            if largest and max(largest) < FLOOR:  # named instead of drawn
                exact.append(run["name"])
            else:
                _line(right, x, errors, k, run["name"], FLOOR)
        left.set_xscale("log")
        if left.lines:
            left.set_yscale("log")
        right.set_xscale("log")
        error_axis(right)
        if exact:
            right.annotate(
                f"{', '.join(exact)}: below {FLOOR:g}", (0.02, 0.03),
                xycoords="axes fraction", fontsize="small", color="#555555",
            )  # fmt: skip
        where = f"{letters[fixed]} = {most[fixed]}"
        name = f"{varied} {letters[varied]}" if varied == "targets" else f"time {varied} T"
        label(left, name, "seconds, solving and proof", f"Time, {where}")
        label(right, name, "relative error, at most", f"Error, {where}")
        for axis in (left, right):
            axis.set_xticks(x, [f"{value}" for value in x], minor=False)
            axis.set_xticks([], minor=True)
    handles, names = axes[0, 0].get_legend_handles_labels()
    columns = len(names) if len(names) <= 5 else -(-len(names) // 2)
    if names:
        made.legend(handles, names, loc="outside upper center", ncols=columns, frameon=False)
    return made


def _line(
    axis: "Axes", x: Sequence[float], values: Sequence[Document], k: int, name: str, least: float
) -> None:
    """Means with a band of one standard deviation, at least `least`; nothing where all failed."""
    kept = [(at, value) for at, value in zip(x, values, strict=True) if value["mean"] is not None]
    x, values = [at for at, _ in kept], [value for _, value in kept]
    if not kept:
        return
    mean = [max(value["mean"], least) for value in values]
    spread = [value["deviation"] or 0.0 for value in values]
    low = [max(m - s, least, m / 10) for m, s in zip(mean, spread, strict=True)]
    high = [m + s for m, s in zip(mean, spread, strict=True)]
    colour = COLOURS[k % len(COLOURS)]
    axis.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    axis.plot(x, mean, "-", marker=MARKERS[k % len(MARKERS)], ms=5, color=colour, label=name)


# --- estimates ------------------------------------------------------------------------------------


def estimate_pictures(series: "dict[str, Sequence[float]]") -> "dict[str, Figure]":
    """By file name: where the estimates part. `series` holds the costs of the steps by name."""
    return {"cumulative": cumulative(series)} if any(series.values()) else {}


def cumulative(series: "dict[str, Sequence[float]]") -> "Figure":
    """Cost up to each step, a line for each estimate."""
    made, ((axis,),) = figure(6.2, 3.6)
    lines, names = [], []  # kept here: names that begin with _ are hidden from a legend
    for k, (name, costs) in enumerate(series.items()):
        total = list(itertools.accumulate(costs))
        steps = range(1, len(total) + 1)
        colour, dashes = COLOURS[k % len(COLOURS)], ("-", "--", ":", "-.")[k // len(COLOURS) % 4]
        lines += axis.plot(steps, total, dashes, color=colour)
        names.append(f"{_literal(name)}: {total[-1]:.6g}")
    axis.set_xlim(0, None)
    axis.set_ylim(0, None)
    label(axis, "step", "cost of all steps so far", "Where the estimates part")
    made.legend(lines, names, loc="outside right upper", frameon=False)
    return made


def _literal(name: str) -> str:
    """A name of the user's, short and without formulas."""
    name = "".join(c if c.isprintable() else "?" for c in name).replace("$", r"\$")
    return name if len(name) <= 30 else "..." + name[-27:]
