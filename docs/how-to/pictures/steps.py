"""The picture of time.md: ``python docs/how-to/pictures/steps.py``."""

from pathlib import Path

import matplotlib.pyplot as plt

TRUTH = list(range(31))
ESTIMATE = [t + 0.6 for t in range(0, 31, 2) if not 10 < t < 20 and t + 0.6 < 30]
OUTAGE = [t for t in TRUTH if ESTIMATE[5] < t < ESTIMATE[6]]
ROWS = {
    "truth": (TRUTH, "black"),
    "estimate": (ESTIMATE, "black"),
    "steps by default": (sorted({*TRUTH, *ESTIMATE}), "tab:blue"),
    "--interpolate truth": (sorted({*ESTIMATE, *OUTAGE}), "tab:blue"),
    "--resample 3": (list(range(0, 31, 3)), "tab:blue"),
}

figure, axes = plt.subplots(figsize=(7.2, 2.5), layout="constrained")
axes.axvspan(ESTIMATE[5], ESTIMATE[6], color="tab:red", alpha=0.12, linewidth=0)
axes.text((ESTIMATE[5] + ESTIMATE[6]) / 2, -0.75, "outage", color="tab:red", ha="center")
for k, (stamps, colour) in enumerate(ROWS.values()):
    axes.plot(stamps, [k] * len(stamps), "|", color=colour, markersize=12, markeredgewidth=1.6)
axes.set_yticks(range(len(ROWS)), list(ROWS))
axes.set_ylim(len(ROWS) - 0.4, -1.2)
axes.set_xlabel("t")
axes.tick_params(left=False)
for side in ("top", "left", "right"):
    axes.spines[side].set_visible(False)
figure.savefig(Path(__file__).with_suffix(".png"), dpi=150)
