"""Reproduce what the sources of docs/theory/clouds.md claim of clouds: tables and pictures.

``python docs/theory/reproduction/clouds.py [FOLDER] [RUNS]`` writes danu.png and prossel.png to the
folder (by default this one) and prints the tables. It needs matplotlib and the extra ``clouds``.
"""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np

from tgospa_eval.distances import (
    cloud_wasserstein,
    reduce_cloud,
    resample_cloud,
    restrict_cloud,
)
from tgospa_eval.distances.reduction import sliced_wasserstein, spread_directions

mpl.use("agg")
import matplotlib.pyplot as plt

# --- crossing targets, [Danu] equations 28 and 29 with T = 1 s ------------------------------------

F = np.array([[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1.0]])
G = np.array([[0.5, 0], [1, 0], [0, 0.5], [0, 1]])
H = np.array([[1, 0, 0, 0], [0, 0, 1, 0.0]])
Q, R = G @ np.diag([1.0, 0.01]) @ G.T, 6.25 * np.eye(2)
STARTS = np.array([(-63.1, 3.8, 40, -1.8), (-35.1, 2.1, 75, -3.1)])
P0 = np.diag([6.25, 1, 6.25, 1])
PARTICLES, STEP = 2000, 14
SIZES = (50, 100, 300, 600)

Cloud = tuple[np.ndarray, np.ndarray]
WAYS: dict[str, Callable[[Cloud, int, np.random.Generator], Cloud]] = {
    "highest weights": lambda cloud, n, _: restrict_cloud(*cloud, n),
    "multinomial": lambda cloud, n, rng: resample_cloud(*cloud, n, method="multinomial", rng=rng),
    "stratified": lambda cloud, n, rng: resample_cloud(*cloud, n, method="stratified", rng=rng),
    "sliced": lambda cloud, n, _: reduce_cloud(*cloud, n),
}


def posterior(start: np.ndarray, measured: np.ndarray, rng: np.random.Generator) -> Cloud:
    """A bootstrap filter; the cloud before the last resampling."""
    points = rng.multivariate_normal(start, P0, PARTICLES)
    weights = np.full(PARTICLES, 1 / PARTICLES)
    for y in measured:
        points = points[rng.choice(PARTICLES, PARTICLES, p=weights)]
        noise = rng.standard_normal((PARTICLES, 2)) * (1.0, 0.1)
        points = points @ F.T + noise @ G.T
        apart = y - points @ H.T
        weights = np.exp(-0.5 * (apart**2).sum(axis=1) / 6.25) + 1e-300
        weights /= weights.sum()
    return points, weights


def exact(start: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """The mean of the same posterior, by a Kalman filter."""
    mean, spread = start.copy(), P0.copy()
    for y in measured:
        mean, spread = F @ mean, F @ spread @ F.T + Q
        gain = spread @ H.T @ np.linalg.inv(H @ spread @ H.T + R)
        mean, spread = mean + gain @ (y - H @ mean), spread - gain @ H @ spread
    return mean


def scenes(runs: int) -> Iterator[tuple[list[list[Cloud]], np.ndarray]]:
    """Clouds by sensor and target, and the exact means."""
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        truth = np.array([[start] for start in STARTS])[:, 0]
        path = []
        for _ in range(STEP):
            truth = truth @ F.T + (rng.standard_normal((2, 2)) * (1.0, 0.1)) @ G.T
            path.append(truth @ H.T)
        clouds, means = [], []
        for _ in range(2):
            seen = [[place[k] + 2.5 * rng.standard_normal(2) for place in path] for k in range(2)]
            pairs = list(zip(STARTS, seen, strict=True))
            clouds.append([posterior(start, np.array(y), rng) for start, y in pairs])
            means.append([exact(start, np.array(y)) for start, y in pairs])
        yield clouds, np.array(means)


def danu(folder: Path, runs: int) -> None:
    """Distances against the exact limit, association rates, times."""
    bias = {way: {n: [] for n in SIZES} for way in WAYS}
    seconds = {way: {n: [] for n in SIZES} for way in ("highest weights", "multinomial")}
    rng = np.random.default_rng(1000)
    right = {"means": 0, "W1": 0, "W2": 0}
    for clouds, means in scenes(runs):
        flat = [[(points @ H.T, weights) for points, weights in side] for side in clouds]
        for target in range(2):
            a, b = (side[target] for side in flat)
            # Both posteriors have the same covariance: the limit is the distance of the means.
            limit = np.linalg.norm(H @ (means[0][target] - means[1][target]))
            for way, small in WAYS.items():
                for n in SIZES:
                    one, other = small(a, n, rng), small(b, n, rng)
                    begin = time.perf_counter()
                    value = cloud_wasserstein(*one, *other)
                    if way in seconds:
                        seconds[way][n].append(time.perf_counter() - begin)
                    bias[way][n].append((value - limit, limit))
        for name, distance in (
            ("means", lambda x, y: np.linalg.norm(x[1] @ x[0] - y[1] @ y[0])),
            ("W1", lambda x, y: cloud_wasserstein(*x, *y, order=1)),
            ("W2", lambda x, y: cloud_wasserstein(*x, *y)),
        ):
            small = [[resample_cloud(*cloud, 100, rng=rng) for cloud in side] for side in flat]
            table = [[distance(x, y) for y in small[1]] for x in small[0]]
            right[name] += table[0][0] + table[1][1] <= table[0][1] + table[1][0]
    print("mean of W2 / exact limit - 1, by particles kept")
    relative = {
        way: [sum(d for d, _ in row) / sum(m for _, m in row) for row in by_size.values()]
        for way, by_size in bias.items()
    }
    for way, values in relative.items():
        print(
            f"  {way:16}", "  ".join(f"{n}: {v:+.2f}" for n, v in zip(SIZES, values, strict=True))
        )
    print(f"right associations of {runs}:", ", ".join(f"{k} {v}" for k, v in right.items()))
    print("median milliseconds of W2; LIPSOL of the source: 734, 1625, 25062, 192297 weighted")
    for way, by_size in seconds.items():
        print(
            f"  {way:16}",
            "  ".join(f"{n}: {1e3 * np.median(v):.1f}" for n, v in by_size.items()),
        )
    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    for way, values in relative.items():
        axes.plot(SIZES, 100 * np.array(values), marker="o", label=way)
    axes.axhline(0, color="grey", linewidth=0.8)
    axes.set(xscale="log", xlabel="particles kept of 2,000", ylabel="bias of W2 in % of the limit")
    axes.set_xticks(SIZES, [str(n) for n in SIZES])
    axes.minorticks_off()
    axes.legend(frameon=False)
    figure.savefig(folder / "danu.png", dpi=120)


# --- reduction, [Prossel] figure 4 ----------------------------------------------------------------

SETTINGS = {
    "Cooper-ATL": {"method": "atl"},
    "sliced, V = 50": {"directions": 50},
    "sliced, V = 10": {"directions": 10},
    "k-means": {"method": "kmeans"},
}


def shapes(rng: np.random.Generator) -> dict[str, np.ndarray]:
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
    }


def prossel(folder: Path, restarts: int) -> None:
    """W2 after each iteration, by method, from random starts; k-means with equal weights."""
    rng = np.random.default_rng(0)
    rounds = (1, 2, 3, 5, 8, 12, 18, 25)
    everything = shapes(rng)
    figure, axes = plt.subplots(1, len(everything), figsize=(11, 3.6), layout="constrained")
    v = spread_directions(2, 50, rng)
    equal = np.full(10, 0.1)
    for axis, (name, points) in zip(axes, everything.items(), strict=True):
        weights = np.full(len(points), 1 / len(points))
        starts = [points[rng.choice(len(points), 10, replace=False)] for _ in range(restarts)]
        print(f"{name} -> 10 after 25 iterations, {restarts} random starts")
        for method, settings in SETTINGS.items():
            reduced = [
                [
                    reduce_cloud(points, None, 10, start=x, iterations=k, **settings)[0]
                    for x in starts
                ]
                for k in rounds
            ]
            begin = time.perf_counter()
            for x in starts:
                reduce_cloud(points, None, 10, start=x, iterations=25, **settings)
            each = (time.perf_counter() - begin) / restarts
            values = np.array(
                [[cloud_wasserstein(x, equal, points, weights) for x in row] for row in reduced]
            )
            last = np.mean(
                [sliced_wasserstein((x, equal), (points, weights), v) for x in reduced[-1]]
            )
            print(
                f"  {method:15} W2 {values[-1].mean():.3f} [{values[-1].min():.3f}, "
                f"{values[-1].max():.3f}]  sliced W2 {last:.3f}  {1e3 * each:.1f} ms"
            )
            (line,) = axis.plot(rounds, values.mean(axis=1), label=method)
            axis.fill_between(
                rounds, values.min(axis=1), values.max(axis=1), color=line.get_color(), alpha=0.12
            )
        axis.set(title=name, xlabel="iterations")
    axes[0].set_ylabel("W2 to the cloud")
    axes[0].legend(frameon=False)
    figure.savefig(folder / "prossel.png", dpi=120)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 24
    danu(target, count)
    prossel(target, count)
