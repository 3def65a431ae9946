"""Make truth.csv and estimate.csv: ``python sample_data/quickstart/make.py`` (NumPy, seed 7).

Five vehicles cross a square of 200 m for 60 s. The tracker locates them with 1 m noise, misses one
detection in twenty, confirms tracks late, swaps two vehicles where they cross, loses one and finds
it again under a new number, and reports a short false track.
"""

from pathlib import Path

import numpy as np

rng = np.random.default_rng(7)
steps = np.arange(1, 61)
lives = [(1, 60), (1, 60), (5, 48), (12, 60), (20, 60)]
starts = np.array([[10, 20], [10, 80], [190, 150], [60, 190], [120, 10]], float)
speeds = np.array([[3, 1], [3, -1], [-2.5, -1.5], [0.5, -2.5], [-1, 2.8]], float)

truth, estimate = [], []
for i, (birth, death) in enumerate(lives):
    for t in steps[(steps >= birth) & (steps <= death)]:
        x, y = starts[i] + speeds[i] * (t - 1) + 3 * np.sin(0.1 * t + np.array([i, 2 * i]))
        truth.append((f"car-{i + 1}", t, x, y))
        name = 101 + i
        if i in (0, 1) and t >= 31:  # swapped where they cross
            name = 102 - i
        if i == 3 and t >= 40:  # lost and found under a new number
            name = 107
        lost = (i == 3 and 36 <= t < 40) or t < birth + 2
        if not lost and rng.random() > 0.05:
            ex, ey = np.array([x, y]) + rng.normal(0, 1, 2)
            estimate.append((str(name), t, ex, ey))
estimate += [("106", t, 150 + 1.5 * (t - 25), 170 - 2 * (t - 25)) for t in range(25, 32)]

folder = Path(__file__).parent
for name, rows in (("truth", truth), ("estimate", estimate)):
    lines = [
        f"{i},{t},{x:.3f},{y:.3f}\n" for i, t, x, y in sorted(rows, key=lambda r: (r[1], r[0]))
    ]
    (folder / f"{name}.csv").write_text("id,t,x,y\n" + "".join(lines), encoding="utf-8", newline="")
