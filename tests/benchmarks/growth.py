"""How the time grows with targets and with steps, all methods on the same scenes."""

import math
from collections.abc import Callable
from pathlib import Path

from grid import Scene, measure, stored
from store import Store

EACH = 20.0
"""Area for each target: 20 in a square of 20."""

METHODS = {
    "certified": "certified",
    "bracket": "1 % bracket",
    "lp without presolve": "LP by HiGHS",
    "exact": "CVXPY, Clarabel",
    "naive": "the definition in CVXPY",
}


def scene(targets: int, steps: int) -> Scene:
    """As dense as 20 targets in a square of 20."""
    return Scene(targets, steps, round(math.sqrt(EACH * targets), 1))


TARGETS = tuple(scene(targets, 100) for targets in (5, 10, 20, 50, 100, 200))
STEPS = tuple(scene(20, steps) for steps in (25, 50, 100, 200, 400, 800))
CROWDS = tuple(Scene(100, steps, 20.0, noise=2.0) for steps in (5, 10, 20, 50, 100))
SERIES = {"targets, 100 steps": TARGETS, "steps, 20 targets": STEPS, "steps of a crowd": CROWDS}
SMALL = {"targets, 100 steps": TARGETS[:2]}


def run(
    series: dict[str, tuple[Scene, ...]], store: Store, deadline: float, say: Callable[[str], None]
) -> None:
    """Measure the first draw of each scene."""
    for scenes in series.values():
        measure(scenes, 1, store, deadline, say, METHODS)


def picture(series: dict[str, tuple[Scene, ...]], store: Store, path: Path) -> None:
    """Seconds over targets and over steps, in logarithms; open marks were stopped."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 3.4), layout="constrained")
    axes = figure.subplots(1, len(series), sharey=True, squeeze=False)[0]
    for axis, (name, scenes) in zip(axes, series.items(), strict=True):
        for number, (method, label) in enumerate(METHODS.items()):
            found = [
                (s.targets if name.startswith("targets") else s.steps, reading)
                for s in scenes
                if (reading := stored(s, 0, method, store)) is not None
            ]
            colour = f"C{number}"
            axis.plot(
                [x for x, _ in found], [r.seconds for _, r in found], colour, lw=1, label=label
            )
            for x, reading in found:
                face = colour if reading.complete else "white"
                axis.plot([x], [reading.seconds], "o", color=colour, mfc=face, ms=4)
        axis.set(xscale="log", yscale="log", xlabel=name)
        axis.grid(visible=True, which="major", alpha=0.3)
    axes[0].set_ylabel("seconds")
    axes[0].legend(fontsize=7)
    figure.savefig(path, dpi=110)
