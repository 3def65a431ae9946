"""Count how often 95 % intervals of a batch cover, beside intervals of other methods.

``python docs/theory/interval_coverage.py`` draws studies of n truths whose totals are of a known
law, p = 2, and prints for each method the share of studies whose interval has the true value, and
behind it the median width of the intervals, in that value.
"""

import argparse
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from tgospa_eval.campaign.statistics import (
    CONFIDENCE,
    MIN_PAIRS,
    intervals,
    margins,
    student,
    without_each,
)

Floats = NDArray[np.float64]
Ends = tuple[Floats, Floats]
Law = Callable[[np.random.Generator, tuple[int, int]], Floats]

TAILS = np.array([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])

SIZES = (6, 20, 50)

STUDIES, DRAWS, TOGETHER = 4000, 800, 200
"""Of each law and number of truths; of the bootstrap; studies that share their draws."""

BETTER = 0.8
"""Of two trackers the second has totals that are larger by this divisor."""

LAWS: dict[str, tuple[Law, float]] = {
    "lognormal, sigma 0.5": (lambda rng, size: rng.lognormal(0, 0.5, size), np.exp(0.125)),
    "lognormal, sigma 1": (lambda rng, size: rng.lognormal(0, 1, size), np.exp(0.5)),
    "exponential": (lambda rng, size: rng.exponential(1, size), 1.0),
    "normal, sigma 1/4 of the mean": (
        lambda rng, size: np.maximum(rng.normal(1, 0.25, size), 0),
        1.0,
    ),
}
"""How totals are distributed, and their mean."""


def errors(squares: Floats, means: Floats, size: int) -> Floats:
    """Standard errors of means, from means of squares."""
    found: Floats = np.sqrt(np.maximum(squares - means**2, 0) / (size - 1))
    return found


def student_on_totals(totals: Floats) -> Ends:
    mean, size = totals.mean(axis=1), totals.shape[1]
    half = student(size) * errors((totals**2).mean(axis=1), mean, size)
    return np.sqrt(np.maximum(mean - half, 0)), np.sqrt(mean + half)


def ends_at(values: Floats, levels: Floats) -> Ends:
    """Quantiles of each row, at levels of its own."""
    places = np.clip(np.rint(levels * (values.shape[1] + 1)).astype(int) - 1, 0, DRAWS - 1)
    low, high = np.take_along_axis(np.sort(values, axis=1), places.T, axis=1).T
    return low, high


def bootstrapped(totals: Floats, weights: Floats) -> dict[str, Ends]:
    """Of the mean of totals, then the root."""
    size, mean = totals.shape[1], totals.mean(axis=1)
    means, own = totals @ weights.T, errors((totals**2).mean(axis=1), mean, size)
    error = errors(totals**2 @ weights.T, means, size)
    apart = means - mean[:, None]
    flat = error <= 1e-9 * own[:, None]  # a draw of one truth n times
    ratio = np.where(flat, np.sign(apart) * 1e9, apart / np.where(flat, 1.0, error))
    low, high = mean - np.quantile(ratio, TAILS[::-1], axis=1) * own
    found = {"bootstrap-t": (low, high)}
    below = np.clip((apart < 0).mean(axis=1), 1 / (DRAWS + 1), DRAWS / (DRAWS + 1))
    influence = totals - mean[:, None]
    skewed = (influence**3).sum(axis=1) / (6 * (influence**2).sum(axis=1) ** 1.5)
    moved = ndtri(below) + ndtri(TAILS)[:, None]
    found["BCa"] = ends_at(means, ndtr(ndtri(below) + moved / (1 - skewed * moved)))
    found["percentile"] = ends_at(means, np.tile(TAILS[:, None], len(totals)))
    return {name: (np.sqrt(np.maximum(a, 0)), np.sqrt(b)) for name, (a, b) in found.items()}


def of_combined(rng: np.random.Generator, law: Law, shape: tuple[int, int]) -> dict[str, Ends]:
    """Of the root of the mean, by method."""
    totals = law(rng, shape)
    low, high = intervals(totals, totals, 2.0)
    found = {"here": (low / shape[1] ** 0.5, high / shape[1] ** 0.5)}
    found["Student's t"] = student_on_totals(totals)
    return found | bootstrapped(totals, drawn(rng, shape[1]))


def of_difference(rng: np.random.Generator, law: Law, shape: tuple[int, int]) -> dict[str, Ends]:
    """Of the difference of two roots of means, by method; what is hard is so for both trackers."""
    hard, size = law(rng, shape), shape[1]
    first, second = (hard * rng.lognormal(-0.045, 0.3, shape) / divisor for divisor in (1, BETTER))
    without = without_each(second, 2.0) - without_each(first, 2.0)
    apart = np.sqrt(second.mean(axis=1)) - np.sqrt(first.mean(axis=1))
    half = margins(without, without) / size**0.5
    weights = drawn(rng, size)
    values = np.sqrt(second @ weights.T) - np.sqrt(first @ weights.T)
    percentile = ends_at(values, np.tile(TAILS[:, None], len(first)))
    return {"here": (apart - half, apart + half), "percentile": percentile}


def drawn(rng: np.random.Generator, size: int) -> Floats:
    """Weights of truths that are drawn with replacement, a row for each draw."""
    return rng.multinomial(size, np.full(size, 1 / size), DRAWS) / size


def table(
    name: str,
    of: Callable[[np.random.Generator, Law, tuple[int, int]], dict[str, Ends]],
    given: argparse.Namespace,
) -> None:
    for law, (draw, mean) in LAWS.items():
        rng = np.random.default_rng(1)
        true = mean**0.5 if of is of_combined else (mean / BETTER) ** 0.5 - mean**0.5
        print(f"{name}, totals {law}")
        for size in given.sizes:
            parts = [of(rng, draw, (TOGETHER, size)) for _ in range(given.studies // TOGETHER)]
            if size == given.sizes[0]:
                print("".join([f"{'n':>5}", *(f"{method:>16}" for method in parts[0])]))
            cells = []
            for method in parts[0]:
                low, high = np.concatenate([part[method] for part in parts], axis=1)
                covered = np.mean((low <= true) & (true <= high))
                width = np.median(high - low) / mean**0.5
                shown = f"{width:.2f}" if width < 100 else "-"
                cells.append(f"{covered:>9.3f} {f'({shown})':>6}")
            print(f"{size:5}{''.join(cells)}", flush=True)
        print()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, prog="interval_coverage.py")
    parser.add_argument("--studies", type=int, default=STUDIES, metavar="N")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, metavar="n")
    given = parser.parse_args()
    print(f"{given.studies:,} studies, {DRAWS} draws; the batch has none below {MIN_PAIRS}\n")
    table("combined", of_combined, given)
    table("difference", of_difference, given)


if __name__ == "__main__":
    main()
