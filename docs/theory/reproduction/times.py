"""Tables 1 and 2 of [Danu]: times of one distance, on weighted and on resampled particles."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from convergence import OWN, value
from crossing import WAYS, Cloud, position, scenes

from tgospa_eval.show.figure_tools import figure, label
from tgospa_eval.show.style import COLOURS, MARKERS

SIZES = (50, 100, 200, 300, 400, 500, 600)
NAMES = ("W1", "W2", OWN)
LIPSOL = {
    "highest weights": (
        (0.703, 1.766, 8.922, 23.719, 58.109, 117.984, 187.562),
        (0.734, 1.625, 7.578, 25.062, 47.734, 89.547, 192.297),
        (0.812, 1.719, 9.11, 26.547, 62.0, 109.015, 250.75),
    ),
    "multinomial": (
        (0.719, 1.438, 6.219, 17.875, 41.171, 65.859, 112.922),
        (0.672, 1.484, 5.969, 18.562, 44.203, 77.407, 138.125),
        (0.719, 1.547, 6.156, 21.485, 41.687, 78.468, 123.719),
    ),
}
"""Seconds of the source."""


def seconds(work: Callable[[], object]) -> float:
    """Of the processor."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def interior_point(a: Cloud, b: Cloud) -> None:
    """W2 by a general linear programme, as LIPSOL has it."""
    from scipy.optimize import linprog
    from scipy.sparse import identity, kron, vstack

    (x, u), (y, v) = a, b
    costs = ((x[:, None] - y) ** 2).sum(axis=2).ravel()
    rows = kron(identity(len(u)), np.ones((1, len(v))))
    columns = kron(np.ones((1, len(u))), identity(len(v)))
    solved = linprog(
        costs, A_eq=vstack([rows, columns]).tocsr(), b_eq=np.append(u, v), method="highs-ipm"
    )
    assert solved.success


def tables(runs: int, sizes: tuple[int, ...], programme_to: int, folder: Path) -> None:
    """Median milliseconds beside the source's seconds; a general solver up to a size."""
    rng = np.random.default_rng(3000)
    pairs = [
        ([side[k] for side in scene.clouds], scene.covariance)
        for scene in (scenes(seed)[0] for seed in range(runs))
        for k in (0, 1)
    ]
    measured = {
        way: {
            n: _medians([([WAYS[way](c, n, rng) for c in pair], P) for pair, P in pairs])
            for n in sizes
        }
        for way in LIPSOL
    }
    general = {
        n: np.median(
            [
                seconds(lambda p=pair, n=n: interior_point(*(_top(c, n) for c in p)))
                for pair, _ in pairs[:3]
            ]
        )
        for n in sizes
        if n <= programme_to
    }
    for number, (way, rows) in enumerate(measured.items(), 1):
        print(f"table {number}, {way}: ms here, median of {len(pairs)} [s of LIPSOL there]")
        print("     N  " + "".join(f"{name:>22}" for name in ("W1", "W2", "Mahalanobis")))
        for n, row in rows.items():
            there = [column[SIZES.index(n)] for column in LIPSOL[way]]
            cells = zip(row, there, strict=True)
            print(f"  {n:4}  " + "".join(f"{1e3 * s:11.1f} [{t:7.2f}]" for s, t in cells))
    most = {way: np.array(list(rows.values())) for way, rows in measured.items()}
    saved = 1 - most["multinomial"] / most["highest weights"]
    print("saved by resampling, mean over the three distances:")
    print("  here   " + _percents(sizes, saved.mean(axis=1)))
    there = np.array(LIPSOL["multinomial"]) / np.array(LIPSOL["highest weights"])
    chosen = [SIZES.index(n) for n in sizes]
    print("  source " + _percents(sizes, 1 - there.mean(axis=0)[chosen]))
    print(
        "W2 of the highest weights by an interior point method (HiGHS), ms: "
        + "  ".join(f"{n}: {1e3 * s:.0f}" for n, s in general.items())
    )
    _draw(measured, general, folder)


def _top(cloud: Cloud, n: int) -> Cloud:
    return position(WAYS["highest weights"](cloud, n, np.random.default_rng()))


def _medians(pairs: list[tuple[list[Cloud], np.ndarray]]) -> list[float]:
    """Of the time of one distance, in the order of `NAMES`."""
    table = [
        [seconds(lambda pair=pair, P=P, name=name: value(name, *pair, P)) for name in NAMES]
        for pair, P in pairs
    ]
    return np.median(table, axis=0).tolist()


def _percents(sizes: tuple[int, ...], shares: np.ndarray) -> str:
    return "  ".join(f"{n}: {100 * s:.0f} %" for n, s in zip(sizes, shares, strict=True))


def _draw(measured: dict, general: dict[int, float], folder: Path) -> None:
    made, axes = figure(7.4, 4.6)
    axis = axes[0, 0]
    lines = [
        (
            "LIPSOL in the source, weighted",
            dict(zip(SIZES, LIPSOL["highest weights"][1], strict=True)),
        ),
        (
            "LIPSOL in the source, resampled",
            dict(zip(SIZES, LIPSOL["multinomial"][1], strict=True)),
        ),
        ("HiGHS, interior point, weighted", general),
        ("here, weighted", {n: row[1] for n, row in measured["highest weights"].items()}),
        ("here, resampled", {n: row[1] for n, row in measured["multinomial"].items()}),
    ]
    for (name, points), colour, marker in zip(lines, COLOURS, MARKERS, strict=False):
        axis.plot(list(points), list(points.values()), color=colour, marker=marker, label=name)
    axis.set(xscale="log", yscale="log", ylim=(2e-4, 3e2))
    axis.set_xticks(SIZES, ["" if n == 500 else str(n) for n in SIZES])
    axis.minorticks_off()
    made.legend(loc="outside lower center", ncols=2, frameon=False, fontsize="small")
    label(axis, "particles of each cloud", "seconds", "Time of one W2 of positions")
    made.savefig(folder / "times.png", dpi=150)
