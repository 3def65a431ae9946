"""Pictures of `compare`: errors, times and convergence of solvers; takes its documents."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from tgospa_eval.plots import COLOURS, MARKERS, figure, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Document = dict[str, Any]

FLOOR = 1e-12
"""Errors below are rounding; they are drawn here."""

AT_FLOOR = f"errors below {FLOOR:g} are drawn at {FLOOR:g}"


def solver_pictures(document: Document) -> "dict[str, Figure]":
    """By file name, those pictures that have something to show."""
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
    label(axis, "temperature ε, fraction of $c^p$", "relative error of the total, at most",
          "Error of sinkhorn by temperature")  # fmt: skip
    axis.legend(frameon=False)
    return made


def time_over_error(document: Document) -> "Figure":
    """What an accuracy costs: solving and proof."""
    made, ((axis,),) = figure(5.2, 3.6)
    runs = document["runs"]
    solvers = list(dict.fromkeys(run["solver"] for run in runs))
    for k, name in enumerate(solvers):
        own = [run for run in runs if run["solver"] == name]
        x = [floored(run["error"]) for run in own]
        y = [run["seconds"]["solve"] + run["seconds"]["certify"] for run in own]
        axis.plot(x, y, MARKERS[k], color=COLOURS[k], label=name, clip_on=False, zorder=3)
        if name == "sinkhorn":
            for run, a, b in zip(own, x, y, strict=True):
                axis.annotate(
                    f"ε = {run['epsilon']:g}", (a, b), xytext=(6, 4),
                    textcoords="offset points", fontsize="small", color="#555555",
                )  # fmt: skip
    axis.set_yscale("log")
    error_axis(axis, vertical=False)
    label(axis, "relative error of the total, at most", "seconds, solving and proof",
          "Time and error")  # fmt: skip
    axis.legend(frameon=False)
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
    label(axis, "sweeps", "relative error of the total, at most",
          "Convergence: upper bound (solid), lower bound (dashed)")  # fmt: skip
    axis.legend(frameon=False, fontsize="small")
    return made


def error_axis(axis: "Axes", *, vertical: bool = True) -> None:
    """A logarithmic axis of errors that says what stands at its end."""
    (axis.set_yscale if vertical else axis.set_xscale)("log")
    low, high = axis.get_ylim() if vertical else axis.get_xlim()
    at_floor = low <= 10 * FLOOR
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
    return [run for run in document["runs"] if run["epsilon"] is not None]
