"""Bootstrap and permutation test of sums of costs, by SciPy; both hold for all values in brackets.

Combined values grow with each total, so the ends of a bootstrap interval come from lower and upper
totals under the same draws. The one-sided p value of a sum of differences grows with each of them,
so that of the upper ends is the largest (docs/reference/batch.md#statistics).
"""

import numpy as np
from numpy.typing import NDArray

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
    from scipy.stats import bootstrap

    size = totals.shape[1]

    def sums(drawn: NDArray[np.int64], axis: int) -> Floats:
        """Sums of all rows from how often each column is drawn, shape (rows, draws)."""
        del axis  # the last
        places = drawn + size * np.arange(len(drawn))[:, None]
        times = np.bincount(places.ravel(), minlength=drawn.size).reshape(drawn.shape)
        sums_of: Floats = totals @ times.T.astype(float)
        return sums_of

    made = bootstrap(
        (np.arange(size),),
        sums,
        n_resamples=resamples_of(size),
        batch=max(1, NUMBERS_AT_ONCE // size),
        vectorized=True,
        method="percentile",
        random_state=np.random.default_rng(BOOTSTRAP_SEED),
    )
    return np.asarray(made.bootstrap_distribution, float)


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
    from scipy.stats import permutation_test

    count, size = lower.shape
    sides = np.concatenate([upper, -lower])
    found = []
    width = max(1, NUMBERS_AT_ONCE // RESAMPLES)
    for begin in range(0, len(sides), width):
        part = sides[begin : begin + width].T
        # Signs are permuted, not differences: one set of them does for all tests.
        made = permutation_test(
            (np.ones(size),),
            lambda signs, axis, part=part: signs @ part,  # noqa: ARG005
            permutation_type="samples",
            n_resamples=RESAMPLES,
            batch=max(1, NUMBERS_AT_ONCE // size),
            vectorized=True,
            alternative="less",
            axis=-1,
            random_state=np.random.default_rng(BOOTSTRAP_SEED),
        )
        found.append(np.asarray(made.pvalue, float))
    less = np.concatenate(found)
    both: Floats = np.minimum(1.0, 2 * np.minimum(less[:count], less[count:]))
    return both


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
