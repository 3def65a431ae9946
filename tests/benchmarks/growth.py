"""How the time grows with targets and with steps, all methods on the same scenes."""

import math
from collections.abc import Callable
from pathlib import Path

from grid import measure, stored
from methods import SLOW_LIMIT, Reading
from scenes import Scene
from store import Store

EACH = 20.0
"""Area for each target: 20 in a square of 20."""

METHODS = {
    "certified": "certified",
    "bracket": "1 % bracket",
    "lp without presolve": "LP by HiGHS",
    "exact": "CVXPY, Clarabel",
    "naive": "the definition in CVXPY",
    "published": "published Python code",
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


def known(scene: Scene, method: str, store: Store) -> Reading | None:
    """What was measured; None of a referee that saw at once that its time would not do."""
    found = stored(scene, 0, method, store)
    declined = found is not None and method == "exact" and not found.complete
    return None if declined and found.seconds < SLOW_LIMIT / 2 else found


def picture(series: dict[str, tuple[Scene, ...]], store: Store, path: Path) -> None:
    """Seconds over targets and over steps, in logarithms; open marks did not reach their end."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 4.0), layout="constrained")
    axes = figure.subplots(1, len(series), sharey=True, squeeze=False)[0]
    for axis, (name, scenes) in zip(axes, series.items(), strict=True):
        sizes = [s.targets if name.startswith("targets") else s.steps for s in scenes]
        for number, (method, label) in enumerate(METHODS.items()):
            readings = [known(s, method, store) for s in scenes]
            found = [(x, r) for x, r in zip(sizes, readings, strict=True) if r is not None]
            colour = f"C{number}"
            seconds = [r.seconds for _, r in found]
            axis.plot([x for x, _ in found], seconds, colour, lw=1, label=label)
            for x, reading in found:
                face = colour if reading.complete else "white"
                axis.plot([x], [reading.seconds], "o", color=colour, mfc=face, ms=4)
        axis.set(xscale="log", yscale="log", xlabel=name)
        axis.set_xticks(sizes, [str(size) for size in sizes])
        axis.minorticks_off()
        axis.grid(visible=True, which="major", alpha=0.3)
    axes[0].set_ylabel("seconds")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    figure.savefig(path, dpi=120)
