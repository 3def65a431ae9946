"""[Prossel], figures 4 and 5: clouds reduced to 10 particles from random starts."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from times import seconds

from tgospa_eval.distances import cloud_wasserstein, reduce_cloud
from tgospa_eval.show.figure_tools import figure, label
from tgospa_eval.show.style import COLOURS, MARKERS

SIZE, ROUNDS = 10, (1, 2, 3, 5, 8, 12, 18, 25)
ANGLES = np.pi * (np.arange(50) + 0.5) / 50
DIRECTIONS = np.vstack((np.cos(ANGLES), np.sin(ANGLES)))
"""Columns, in which the sliced distance is taken."""

FEW = 10
"""Starts for what is slow and not drawn."""

REDRAWN, POLISHED = "V = 50, drawn anew", "V = 50, one ATL step"

Floats = np.ndarray
Step = Callable[[Floats, Floats, int, np.random.Generator], Floats]
"""(cloud, positions, iterations, rng) -> positions after so many more iterations."""


def _by(**settings: object) -> Step:
    def step(points: Floats, x: Floats, iterations: int, rng: np.random.Generator) -> Floats:
        return reduce_cloud(points, None, SIZE, start=x, iterations=iterations, **settings)[0]

    return step


def _redrawn(points: Floats, x: Floats, iterations: int, rng: np.random.Generator) -> Floats:
    """Directions drawn in every iteration, as algorithm 2 prints it."""
    for _ in range(iterations):
        angle = rng.uniform(0, np.pi, 50)
        drawn = np.column_stack((np.cos(angle), np.sin(angle)))
        x = reduce_cloud(points, None, SIZE, start=x, iterations=1, directions=drawn)[0]
    return x


METHODS: dict[str, Step] = {
    "Cooper-ATL": _by(method="atl"),
    "sliced, V = 50": _by(directions=50),
    "sliced, V = 10": _by(directions=10),
    "k-means": _by(method="kmeans"),
    REDRAWN: _redrawn,
}


def shapes(rng: np.random.Generator) -> dict[str, Floats]:
    """Clouds of equal weight as in the source, the mixture with parameters of its kind."""
    parts = [
        rng.standard_normal((n, 2)) * scale + centre
        for n, scale, centre in (
            (400, (1, 0.4), (0, 0)),
            (250, 0.5, (4, 3)),
            (150, (0.3, 1), (-3, 4)),
        )
    ]
    return {
        "normal, 1000": rng.standard_normal((1000, 2)),
        "mixture, 800": np.concatenate(parts),
        "uniform, 1000": rng.random((1000, 2)),
        "normal, 200": rng.standard_normal((200, 2)),
    }


def exact(x: Floats, points: Floats) -> float:
    """W2; k-means too counts with equal weights, as in the source."""
    return cloud_wasserstein(x, None, points, None)


def sliced(x: Floats, points: Floats) -> float:
    """Root of the mean squared W2 of projections.

    All weights are equal and the sizes multiples: in each direction every particle of x takes the
    same number of neighbours.
    """
    ranked = np.sort(points @ DIRECTIONS, axis=0)
    partner = np.repeat(np.sort(x @ DIRECTIONS, axis=0), len(points) // len(x), axis=0)
    return float(np.sqrt(np.mean((ranked - partner) ** 2)))


def path(step: Step, points: Floats, start: Floats, rng: np.random.Generator) -> list[Floats]:
    """Positions after each of `ROUNDS`."""
    x, done, kept = start, 0, []
    for k in ROUNDS:
        x, done = step(points, x, k - done, rng), k
        kept.append(x)
    return kept


def reduction(restarts: int, folder: Path) -> None:
    """Tables of figure 4, its plot, and that of figure 5."""
    rng = np.random.default_rng(0)
    made, axes = figure(7.4, 9.0, 4, 2)
    for row, (name, points) in zip(axes, shapes(rng).items(), strict=True):
        starts = [points[rng.choice(len(points), SIZE, replace=False)] for _ in range(restarts)]
        ends = _compare(name, points, starts, row, rng)
        if name == "normal, 1000":
            _positions(points, ends, folder)
    handles = axes[0, 0].get_legend_handles_labels()
    made.legend(*handles, loc="outside upper center", ncols=4, frameon=False, fontsize="small")
    for axis in axes[-1]:
        axis.set_xlabel("iterations")
    made.savefig(folder / "prossel.png", dpi=150)


def _compare(
    name: str, points: Floats, starts: list[Floats], row: Floats, rng: np.random.Generator
) -> dict[str, list[Floats]]:
    """A table, a row of the plot; the final positions."""
    print(f"{name} -> {SIZE}, {len(starts)} random starts, 25 iterations")
    print(f"  {'':20} {'W2 [least, most]':>20} {'sliced W2':>20} {'trace':>7} {'ms':>7}")
    ends = {}
    for k, (method, step) in enumerate(METHODS.items()):
        first = starts[:FEW] if method == REDRAWN else starts
        paths = [path(step, points, x, rng) for x in first]
        values = [np.array([[f(x, points) for x in p] for p in paths]) for f in (sliced, exact)]
        if method != REDRAWN:
            _curves(name, method, k, values, row)
        ends[method] = [each[-1] for each in paths]
        spent = [seconds(lambda x=x, s=step: s(points, x, 25, rng)) for x in starts[:FEW]]
        _line(method, points, ends[method], f"{1e3 * np.median(spent):7.1f}")
    polished = [METHODS["Cooper-ATL"](points, x, 1, rng) for x in ends["sliced, V = 50"]]
    _line(POLISHED, points, polished, "")
    return ends


def _line(method: str, points: Floats, ends: list[Floats], milliseconds: str) -> None:
    values = [np.array([f(x, points) for x in ends]) for f in (exact, sliced)]
    cells = [f"{v.mean():.3f} [{v.min():.3f}, {v.max():.3f}]" for v in values]
    kept = np.mean([x.var(axis=0).sum() for x in ends]) / points.var(axis=0).sum()
    print(f"  {method:20} {cells[0]} {cells[1]} {100 * kept:5.0f} % {milliseconds}")


def _curves(name: str, method: str, k: int, values: list[Floats], row: Floats) -> None:
    titles = "sliced W2", "W2"
    look = {"color": COLOURS[k], "marker": MARKERS[k], "markersize": 4, "label": method}
    for axis, table, title in zip(row, values, titles, strict=True):
        axis.plot(ROUNDS, table.mean(axis=0), **look)
        axis.fill_between(
            ROUNDS, table.min(axis=0), table.max(axis=0), color=COLOURS[k], alpha=0.18, linewidth=0
        )
        label(axis, "", f"{title} to the cloud", name)


def _positions(points: Floats, ends: dict[str, list[Floats]], folder: Path) -> None:
    """The best final positions of three methods."""
    made, axes = figure(7.4, 2.9, 1, 3)
    shown = "k-means", "Cooper-ATL", "sliced, V = 50"
    for axis, method in zip(axes[0], shown, strict=True):
        best = min(ends[method], key=lambda x: exact(x, points))
        axis.plot(*points.T, ".", color="#aaaaaa", markersize=2)
        axis.plot(*best.T, "o", color=COLOURS[1], markersize=7, markeredgecolor="black")
        axis.set(aspect="equal", xlim=(-3.2, 3.2), ylim=(-3.2, 3.2))
        label(axis, "", "", f"{method}: W2 {exact(best, points):.3f}")
    made.savefig(folder / "positions.png", dpi=150)
