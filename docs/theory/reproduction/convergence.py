"""Distances of clouds of the same target against their exact limits, [Danu] figures 4 and 5.

Both sensors have the same covariance, so that the posteriors of a target are translates: W1 and W2
of positions have the limit ``|H (m1 - m2)|``, the Mahalanobis distance of whole states
``sqrt((m1 - m2)' P^-1 (m1 - m2))``.
"""

from pathlib import Path

import numpy as np
from crossing import PLACE, WAYS, Cloud, Floats, Scene, moments, position, scenes

from tgospa_eval.distances import cloud_wasserstein
from tgospa_eval.show.figure_tools import figure, label
from tgospa_eval.show.style import COLOURS, MARKERS

OWN, TRUE = "Mahalanobis, own P", "Mahalanobis, true P"
ROWS = {
    "means": ("highest weights", "multinomial"),
    "W1": ("highest weights", "multinomial"),
    "W2": tuple(WAYS),
    OWN: ("highest weights", "multinomial", "sliced"),
    TRUE: ("highest weights", "multinomial", "sliced"),
}
"""Ways to fewer particles, by distance."""


def value(name: str, a: Cloud, b: Cloud, truth: Floats) -> float:
    """A distance of two clouds of states; `truth` is the exact covariance."""
    if name == OWN:
        own = (moments(a)[1] + moments(b)[1]) / 2
        return cloud_wasserstein(*a, *b, covariance=own)
    if name == TRUE:
        return cloud_wasserstein(*a, *b, covariance=truth)
    if name == "Mahalanobis, positions":
        part = truth[np.ix_(PLACE, PLACE)]
        return cloud_wasserstein(*position(a), *position(b), covariance=part)
    a, b = position(a), position(b)
    if name == "means":
        return float(np.linalg.norm(moments(a)[0] - moments(b)[0]))
    return cloud_wasserstein(*a, *b, order=1 if name == "W1" else 2)


def limit(name: str, scene: Scene, target: int) -> float:
    """What it is of the exact posteriors."""
    apart = scene.means[0, target] - scene.means[1, target]
    if name in (OWN, TRUE):
        return float(np.sqrt(apart @ np.linalg.solve(scene.covariance, apart)))
    return float(np.linalg.norm(apart[PLACE]))


def bias(runs: int, sizes: tuple[int, ...], folder: Path) -> None:
    """Mean and root mean square of distance - limit, relative to the mean limit."""
    rng = np.random.default_rng(1000)
    errors: dict[tuple[str, str], list[list[float]]] = {}
    limits: dict[str, list[float]] = {name: [] for name in ROWS}
    for scene in (each for seed in range(runs) for each in scenes(seed)):
        for target in (0, 1):
            pair = [side[target] for side in scene.clouds]
            reduced = {n: [WAYS["sliced"](cloud, n, rng) for cloud in pair] for n in sizes}
            for name, ways in ROWS.items():
                exact = limit(name, scene, target)
                limits[name].append(exact)
                for way in ways:
                    found = []
                    for n in sizes:
                        drawn = (WAYS[way](cloud, n, rng) for cloud in pair)
                        a, b = reduced[n] if way == "sliced" else drawn
                        found.append(value(name, a, b, scene.covariance) - exact)
                    errors.setdefault((name, way), []).append(found)
    print(f"bias and root mean square error over the mean limit, {4 * runs} pairs; particles kept")
    print(" " * 40 + "".join(f"{n:>14}" for n in sizes))
    relative = {}
    for (name, way), table in errors.items():
        scaled = np.array(table) / np.mean(limits[name])
        relative[name, way] = scaled.mean(axis=0)
        cells = zip(relative[name, way], np.sqrt((scaled**2).mean(axis=0)), strict=True)
        print(f"  {name:20}  {way:16}" + "".join(f"{b:+9.2f}/{e:.2f}" for b, e in cells))
    means = {name: np.mean(limits[name]) for name in ("W2", OWN)}
    print(f"  mean limit: positions {means['W2']:.2f} m, Mahalanobis {means[OWN]:.2f}")
    _draw(relative, sizes, folder)


def _draw(relative: dict[tuple[str, str], Floats], sizes: tuple[int, ...], folder: Path) -> None:
    made, axes = figure(7.4, 3.8, 1, 2)
    looks = dict(zip(WAYS, zip(COLOURS, MARKERS, strict=False), strict=False))
    shown = (("W1", "--"), ("W2", "-")), ((TRUE, "--"), (OWN, "-"))
    titles = "positions: W2 (lines), W1 (dashed)", "states: own P (lines), true P (dashed)"
    for axis, kinds, title in zip(axes[0], shown, titles, strict=True):
        for (name, way), values in relative.items():
            if name in dict(kinds):
                colour, marker = looks[way]
                dashes = dict(kinds)[name]
                axis.plot(
                    sizes, 100 * values, dashes, color=colour, marker=marker, markersize=5,
                    label=way if dashes == "-" else None,
                )  # fmt: skip
        axis.set(xscale="log", yscale="log", ylim=(2, 600))
        axis.set_xticks(sizes, [str(n) for n in sizes])
        ticks = (2, 5, 10, 20, 50, 100, 200, 500)
        axis.set_yticks(ticks, [str(tick) for tick in ticks])
        axis.minorticks_off()
        axis.legend(frameon=False, fontsize="small", loc="upper right")
        label(axis, "particles kept of 2,000", "bias in % of the exact limit", title)
    made.savefig(folder / "convergence.png", dpi=150)


def steadiness(pairs: int, draws: int, largest: int) -> None:
    """What drawing again changes, and how far a distance is from where it goes."""
    names = ("W2", OWN, TRUE, "Mahalanobis, positions")
    sizes = (100, 300, largest)
    rng = np.random.default_rng(2000)
    spread = {name: [] for name in names}
    level = {name: [] for name in names}
    for seed in range(pairs):
        scene = scenes(seed)[0]
        for name in names:
            drawn = []
            for n in sizes:
                few = draws if n < largest else max(2, draws // 5)
                again = []
                for _ in range(few):
                    a, b = (WAYS["multinomial"](side[0], n, rng) for side in scene.clouds)
                    again.append(value(name, a, b, scene.covariance))
                drawn.append((np.mean(again), np.std(again, ddof=1)))
            spread[name].append([deviation / mean for mean, deviation in drawn[:2]])
            level[name].append([drawn[k][0] / drawn[2][0] - 1 for k in (0, 1)])
    print(f"multinomial draws again: {pairs} pairs, {draws} draws; at 100 and 300 particles")
    for name in names:
        s, m = (100 * np.mean(table[name], axis=0) for table in (spread, level))
        print(
            f"  {name:22}  deviation {s[0]:4.1f} % {s[1]:4.1f} %   "
            f"mean above that of {largest}: {m[0]:+5.1f} % {m[1]:+5.1f} %"
        )
