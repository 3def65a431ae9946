"""How often distances associate the clouds of two sensors rightly."""

from pathlib import Path

import numpy as np
import tracker
from convergence import OWN, value
from crossing import PLACE, STEPS, WAYS, Cloud, Floats, moments, position, scenes, truths
from scipy.optimize import linear_sum_assignment

from tgospa_eval.show.figure_tools import figure, label
from tgospa_eval.show.style import COLOURS, MARKERS

KEPT = 100
"""Particles, as the source proposes."""

OF_TARGET = 10.0
"""Metres from a target within which a track is its own."""

CUTOFFS = {"positions": 15.0, "states": 10.0}
"""Beyond which tracks stay alone, in metres and in standard deviations."""

DISTANCES = {
    "means": ("means", "all"),
    "Mahalanobis of means": ("mean states", "all"),
    "W1, highest weights": ("W1", "highest weights"),
    "W2, highest weights": ("W2", "highest weights"),
    "Mahalanobis, highest weights": (OWN, "highest weights"),
    "W1, resampled": ("W1", "multinomial"),
    "W2, resampled": ("W2", "multinomial"),
    "Mahalanobis, resampled": (OWN, "multinomial"),
}
"""(i) to (viii) of the source, and the plain Mahalanobis distance."""


def compared(name: str, a: Cloud, b: Cloud) -> float:
    """A distance of clouds; Mahalanobis ones with the mean covariance of the pair."""
    if name == "mean states":
        (m, P), (k, R) = moments(a), moments(b)
        return float(np.sqrt((m - k) @ np.linalg.solve((P + R) / 2, m - k)))
    return value(name, a, b, np.eye(4))


def costs(sides: list[list[Cloud]], rng: np.random.Generator) -> dict[str, Floats]:
    """Tables (m, n) of all distances; each cloud is drawn once."""
    drawn = {
        way: [[WAYS[way](c, KEPT, rng) for c in side] for side in sides]
        for way in ("highest weights", "multinomial")
    }
    drawn["all"] = sides
    return {
        title: np.array([[compared(name, a, b) for b in drawn[way][1]] for a in drawn[way][0]])
        for title, (name, way) in DISTANCES.items()
    }


def known(runs: int, steps: tuple[int, ...], meet: int | None) -> dict[str, float]:
    """Shares of right associations where every sensor has a cloud of every target."""
    rng = np.random.default_rng(4000)
    right = {name: [] for name in DISTANCES}
    for scene in (each for seed in range(runs) for each in scenes(seed, meet)):
        if scene.step in steps:
            for name, table in costs(scene.clouds, rng).items():
                right[name].append(table[0, 0] + table[1, 1] < table[0, 1] + table[1, 0])
    return {name: float(np.mean(answers)) for name, answers in right.items()} | {
        "orders differ": sum(
            np.not_equal(right[f"W1, {way}"], right[f"W2, {way}"]).sum()
            for way in ("highest weights", "resampled")
        )
    }


def owners(tracks: list[Cloud], states: Floats) -> Floats:
    """Of each track its target, -1 for a false one."""
    if not tracks:
        return np.zeros(0, int)
    means = np.array([moments(position(cloud))[0] for cloud in tracks])
    apart = np.linalg.norm(means[:, None] - states[:, PLACE], axis=2)
    return np.where(apart.min(axis=1) < OF_TARGET, apart.argmin(axis=1), -1)


def pairs(table: Floats, cutoff: float) -> list[tuple[int, int]]:
    """The association of smallest sum, where staying alone costs half a cutoff."""
    i, j = linear_sum_assignment(np.minimum(table - cutoff, 0.0))
    return [(a, b) for a, b in zip(i, j, strict=True) if table[a, b] < cutoff]


def cluttered(runs: int) -> tuple[dict[str, float], dict[str, int]]:
    """From trackers that miss targets and report false ones: right shares, wrong pairs."""
    count = dict.fromkeys(("steps", "found", "both", "false"), 0)
    right = dict.fromkeys(DISTANCES, 0)
    wrong = dict.fromkeys(DISTANCES, 0)
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        path = truths(rng)
        sensors = [tracker.tracks(tracker.scans(path, rng), rng) for _ in (0, 1)]
        for step in STEPS:
            sides = [each[step] for each in sensors]
            own = [owners(side, path[step]) for side in sides]
            seen = [set(each[each >= 0].tolist()) for each in own]
            count["steps"] += 1
            count["found"] += len(seen[0]) + len(seen[1])
            count["both"] += len(seen[0] & seen[1])
            count["false"] += sum(int((each < 0).sum()) for each in own)
            if not all(sides):
                continue
            for name, table in costs(sides, rng).items():
                cutoff = CUTOFFS["states" if "Mahalanobis" in name else "positions"]
                chosen = [(own[0][a], own[1][b]) for a, b in pairs(table, cutoff)]
                right[name] += len({a for a, b in chosen if a == b >= 0})
                wrong[name] += sum(a != b or a < 0 for a, b in chosen)
    print(
        f"tracker with clutter: {100 * count['found'] / count['steps'] / 4:.0f} % of the targets "
        f"have a track, {count['false'] / count['steps'] / 2:.2f} false tracks per sensor and step"
    )
    return {name: n / max(count["both"], 1) for name, n in right.items()}, wrong


def rates(runs: int, clutter_runs: int, folder: Path) -> None:
    """Three cases, side by side."""
    shares, wrong = cluttered(clutter_runs)
    found = {
        "A, as in the source": known(runs, STEPS, None),
        "B, paths meet": known(2 * runs, STEPS[1:], STEPS[1]),
        "C, misses and clutter": shares,
    }
    trials = 2 * runs
    print(f"right associations in %, {KEPT} particles kept; A: as in the source, {trials} trials;")
    print(
        f"B: paths meet at step {STEPS[1]}, {trials} trials; C: clutter, {2 * clutter_runs} trials"
    )
    print(f"  {'':28}" + "".join(f"{case[0]:>7}" for case in found) + "   wrong pairs of C")
    for name in DISTANCES:
        cells = "".join(f"{100 * each[name]:7.1f}" for each in found.values())
        print(f"  {name:28}{cells}{wrong[name]:7}")
    differ = [int(each["orders differ"]) for each in list(found.values())[:2]]
    print(f"  W1 and W2 decide differently: {differ[0]} times in A, {differ[1]} in B")
    _draw(found, folder)


def _draw(found: dict[str, dict[str, float]], folder: Path) -> None:
    made, axes = figure(7.4, 4.4)
    axis = axes[0, 0]
    places = np.arange(len(DISTANCES))[::-1]
    for k, (case, shares) in enumerate(found.items()):
        values = [100 * shares[name] for name in DISTANCES]
        axis.plot(
            values, places + 0.3 * (1 - k), MARKERS[k], color=COLOURS[k], markersize=7, label=case
        )
    axis.set_yticks(places, list(DISTANCES))
    made.legend(loc="outside lower center", ncols=3, frameon=False, fontsize="small")
    label(axis, "right associations in %", "", "Association of the clouds of two sensors")
    made.savefig(folder / "rates.png", dpi=150)
