"""Count how often 95 % bands of a curve cover where few runs have a cost at a time.

``python docs/theory/rare_events.py`` draws studies of n runs with 50 times, at each of which a run
has a cost with a probability, p = 2, and prints for each law of that cost the share of times at
which the band has the true value, and in parentheses that of the interval by the jackknife alone.
"""

import argparse
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.campaign.statistics import intervals, rare_intervals

Floats = NDArray[np.float64]

SIZES, CHANCES, TIMES = (20, 60, 200), (0.01, 0.02, 0.1, 0.5), 50

LAWS: dict[str, tuple[Callable[[np.random.Generator, tuple[int, int]], Floats], float]] = {
    "always the same": (lambda _, size: np.full(size, 4.0), 4.0),
    "a half or a whole": (lambda rng, size: rng.choice([2.0, 4.0], size), 3.0),
    "exponential": (lambda rng, size: rng.exponential(1, size), 1.0),
    "lognormal, sigma 1": (lambda rng, size: rng.lognormal(0, 1, size), np.exp(0.5)),
}
"""What one event costs, and its mean."""


def coverage(law: str, size: int, chance: float, studies: int) -> tuple[float, float]:
    """Shares of times whose band, and whose interval by the jackknife, has the true value."""
    draw, mean = LAWS[law]
    rng, inside = np.random.default_rng(1), np.zeros(2)
    for _ in range(studies):
        costs = draw(rng, (TIMES, size)) * (rng.random((TIMES, size)) < chance)
        usual = costs[costs > 0].mean() if costs.any() else np.nan
        for k, (low, high) in enumerate(
            (rare_intervals(costs, costs, 2, usual), intervals(costs / size, costs / size, 2))
        ):
            inside[k] += ((low**2 <= chance * mean) & (chance * mean <= high**2)).mean()
    first, second = (inside / studies).tolist()
    return first, second


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=200)
    studies = parser.parse_args().studies
    for law in LAWS:
        print(f"\ncost of an event: {law}")
        print("    n" + "".join(f"{100 * chance:>14g} %" for chance in CHANCES))
        for size in SIZES:
            shares = (coverage(law, size, chance, studies) for chance in CHANCES)
            print(f"{size:>5}" + "".join(f"{a:>9.3f} ({b:.2f})" for a, b in shares))


if __name__ == "__main__":
    main()
