"""Bootstrap and permutation test of sums of costs; both hold for all values in brackets.

SciPy has both for any statistic; of sums, all resamples are one product of matrices, a tenth of the
time for thousands of jobs (the tests compare).

Combined values grow with each total, so the ends of a bootstrap interval come from lower and upper
totals under the same draws. The one-sided p value of a sum of differences grows with each of them,
so that of the upper ends is the largest (docs/reference/batch.md#statistics).
"""

from collections.abc import Iterator

import numpy as np

from tgospa_eval.common.interval import Interval
from tgospa_eval.problem.problem import Floats

RESAMPLES = 9999
"""Of the bootstrap; permutations of a test, where all are not fewer."""

FEW_RESAMPLES, MANY_PAIRS = 1999, 1000
"""Of the bootstrap of more pairs than these, which takes seconds."""

BOOTSTRAP_SEED = 1
"""Of bootstrap and permutations: the same batch has the same tables."""

CONFIDENCE = 0.95
"""Level of the intervals; tests are significant below what is left of 1."""

LEAST_PAIRS = 6
"""With fewer no two-sided p value can be below 0.05: the least is 2 / 2^n."""

TIE = 1e-14
"""Of the sum of all differences, of either sign: sums that differ by less are equal."""

NUMBERS_AT_ONCE = 4_000_000
"""Numbers that are resampled at once."""


def resampled_sums(totals: Floats) -> Floats:
    """Sums of n numbers drawn with replacement, of all rows the same ones.

    Parameters
    ----------
    totals : array, shape (rows, n)
        Costs; n is at least 2.

    Returns
    -------
    array, shape (rows, draws)
    """
    size = totals.shape[1]
    draws, rng = resamples_of(size), np.random.default_rng(BOOTSTRAP_SEED)
    sums = np.empty((len(totals), draws))
    for part in _portions(draws, size):
        drawn = rng.integers(0, size, (part.stop - part.start, size))
        drawn += size * np.arange(len(drawn))[:, None]
        times = np.bincount(drawn.ravel(), minlength=drawn.size).reshape(drawn.shape)
        sums[:, part] = totals @ times.T.astype(float)
    return sums


def resamples_of(pairs: int) -> int:
    """How many draws the bootstrap takes; none of too few."""
    if pairs < LEAST_PAIRS:
        return 0
    return RESAMPLES if pairs <= MANY_PAIRS else FEW_RESAMPLES


def percentiles(lower: Floats, upper: Floats) -> Interval:
    """The percentile interval of a value of which draws have bounds."""
    tail = (1 - CONFIDENCE) / 2
    return Interval(
        lower=float(np.quantile(lower, tail)), upper=float(np.quantile(upper, 1 - tail))
    )


def p_values(lower: Floats, upper: Floats) -> Floats:
    """Two-sided p values of sums of differences, under flips of their signs.

    Parameters
    ----------
    lower, upper : array, shape (tests, n)
        Bounds of the differences; n is at least 2.

    Returns
    -------
    array, shape (tests,)
        The largest for any values between the bounds.
    """
    count, size = lower.shape
    sides = np.concatenate([upper, -lower])
    observed = sides.sum(axis=1)
    # Sums that are equal in exact numbers count as equal.
    observed += TIE * np.abs(sides).sum(axis=1)
    flips, every = permutations_of(size), 1 << size if size < RESAMPLES.bit_length() else 0
    at_most, rng = np.zeros(len(sides), np.int64), np.random.default_rng(BOOTSTRAP_SEED)
    for part in _portions(flips, size):
        if every:
            numbers = np.arange(part.start, part.stop, dtype=np.uint64)
            flipped = numbers[:, None] >> np.arange(size, dtype=np.uint64) & np.uint64(1)
        else:
            shape = part.stop - part.start, -(-size // 8)
            octets = rng.integers(0, 256, shape, np.uint8)
            flipped = np.unpackbits(octets, axis=1, count=size)
        sums = (1.0 - 2.0 * flipped) @ sides.T
        at_most += np.count_nonzero(sums <= observed, axis=0)
    # The data as they are is one of the flips: drawn ones may lack it.
    less = at_most / every if every else (at_most + 1) / (flips + 1)
    both: Floats = np.minimum(1.0, 2 * np.minimum(less[:count], less[count:]))
    return both


def _portions(count: int, size: int) -> Iterator[slice]:
    """Some of so many draws of so many numbers at a time."""
    width = max(1, NUMBERS_AT_ONCE // size)
    yield from (slice(low, min(low + width, count)) for low in range(0, count, width))


def permutations_of(pairs: int) -> int:
    """How many flips are tried: all, if they are no more; none of too few."""
    if pairs < LEAST_PAIRS:
        return 0
    return RESAMPLES if pairs >= RESAMPLES.bit_length() else 1 << pairs


def holm(p_values: Floats) -> Floats:
    """P values adjusted for their number (Holm 1979), in the order given."""
    order = np.argsort(p_values)
    adjusted = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
    found = np.empty(len(p_values))
    found[order] = np.minimum(1.0, adjusted)
    return found
