"""Statistics over several jobs: inference about the cost on other truths of the same kind.

The sample is the set of truths. Jobs of one truth are added up, because they are not independent of
each other. If there is only one truth, the sample is the set of its jobs. Copies of one run then
count as one job. Permutation tests exchange the values that they compare (see `Exchangeable`).
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.campaign.row import run_ids, truths
from tgospa_eval.common.arrays import Floats

if TYPE_CHECKING:
    import pandas as pd

PERMUTATIONS = 9999
"""Largest number of exchanges that a permutation test tries.

If there are more, the test tries this number of random exchanges.
"""

PERMUTATION_SEED = 1
"""Seed of the random exchanges. It is fixed, so that the same data have the same p values."""

CONFIDENCE = 0.95
"""Confidence level of intervals. A test is significant if its p value is below 1 - `CONFIDENCE`."""

MIN_PAIRS = 6
"""Smallest number of pairs for a test. With n pairs, no two-sided p value is below 2 / 2^n.

Six is the first n for which 2 / 2^n is below 0.05.
"""

TIE = 1e-12
"""Tolerance for equal sums of exchanged values, as a share of the sum of all absolute values."""

NUMBERS_AT_ONCE = 4_000_000
"""Largest number of values that are computed at the same time, to limit the memory."""

OF_INTERVALS = [f"{of}confidence_{end}" for of in ("", "per_step_") for end in ("lower", "upper")]
"""Columns with the confidence intervals of a group."""

TOTAL_ENDS = ["total_lower", "total_upper"]
"""Columns of the bracket of a total."""


def intervals(
    lower: Floats, upper: Floats, order: Floats | float, steps: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return confidence intervals of combined values; each row has its own interval.

    A combined value is the root of a sum of n totals. The jackknife estimates its standard error.
    The interval is computed for the logarithm of the value, by Student's t.

    Parameters
    ----------
    lower, upper : array, shape (rows, n)
        Bounds of the totals; n is at least 2.
    order : float or array, shape (rows, 1)
        The order p.
    steps : array, shape (n,) or (rows, n), optional
        Number of steps of each total. If given, sums of totals are divided by sums of steps: the
        intervals are those of values per step.

    Returns
    -------
    tuple of array, shape (rows,)
        Lower and upper ends.
    """
    # Totals are sorted, so that the sums do not depend on their order, not even by rounding.
    place = np.lexsort((upper, lower))
    lower, upper = (np.take_along_axis(side, place, axis=1) for side in (lower, upper))
    per: Floats | float = 1.0
    if steps is not None:
        steps = np.take_along_axis(np.broadcast_to(steps, lower.shape), place, axis=1)
        per = steps.sum(axis=1, keepdims=True)
    lower_value, upper_value = (
        ((side.sum(axis=1, keepdims=True) / per) ** (1 / order))[:, 0] for side in (lower, upper)
    )
    margin = margins(*(without_each(side, order, steps) for side in (lower, upper)))
    # The standard error of exact totals is at most value * sqrt(n / (n - 1)). Wide brackets can
    # give a larger margin. The margin is therefore limited to the one of this standard error.
    size = lower.shape[1]
    ratio = np.full(len(lower_value), student(size) * np.sqrt(size / (size - 1)))
    np.divide(margin, lower_value, out=ratio, where=margin < ratio * lower_value)
    return lower_value * np.exp(-ratio), upper_value * np.exp(ratio)


FEW_EVENTS = 10
"""Smallest number of runs with a cost above 0 for which intervals are those of the jackknife.

With fewer such runs, the jackknife cannot estimate the spread. The intervals then use the share of
these runs (`rare_intervals`). If all runs have a cost above 0, the jackknife is always used.
"""


def rare_intervals(
    lower: Floats, upper: Floats, order: float, typical: float
) -> tuple[Floats, Floats]:
    """Return confidence intervals of root mean squares, even if few runs have a cost above 0.

    With fewer than `FEW_EVENTS` such runs, the confidence interval of their share is computed
    (Clopper and Pearson 1934). There are two estimates of the cost of such a run: the mean over
    these runs, and `typical`. The lower end of the interval is multiplied by the smaller estimate,
    and the upper end by the larger one. Then the roots are taken. docs/theory/intervals.md has the
    coverage in simulations.

    Parameters
    ----------
    lower, upper : array, shape (rows, n)
        Bounds of the costs of n runs, for each row; n is at least 2.
    order : float
        The order p.
    typical : float
        Mean of all costs above 0, over all runs and times; NaN if there are none.

    Returns
    -------
    tuple of array, shape (rows,)
        Lower and upper ends; NaN if `typical` is NaN.
    """
    from scipy.special import betaincinv  # lazy: slow to import

    runs = lower.shape[1]
    low, high = intervals(lower / runs, upper / runs, order)
    count = np.count_nonzero(upper > 0, axis=1)
    few = np.flatnonzero((count < FEW_EVENTS) & (count < runs))
    if not len(few):
        return low, high
    events, tail = count[few], (1 - CONFIDENCE) / 2
    lower_share = np.where(
        events > 0, betaincinv(np.maximum(events, 1), runs - events + 1, tail), 0.0
    )
    upper_share = betaincinv(events + 1, runs - events, 1 - tail)
    own = np.where(events > 0, upper[few].sum(axis=1) / np.maximum(events, 1), typical)
    low[few] = (lower_share * np.minimum(own, typical)) ** (1 / order)
    high[few] = (upper_share * np.maximum(own, typical)) ** (1 / order)
    return low, high


def without_each(totals: Floats, order: Floats | float, steps: Floats | None = None) -> Floats:
    """Return the combined values with each total left out in turn, for the jackknife.

    The sum of the other totals is scaled to n totals. If `steps` is given, the sum is divided by
    the steps of the other totals instead.

    Parameters
    ----------
    totals : array, shape (rows, n)
        Costs; n is at least 2.
    order : float or array, shape (rows, 1)
        The order p.
    steps : array, shape (n,) or (rows, n), optional
        Number of steps of each total, for values per step.

    Returns
    -------
    array, shape (rows, n)
    """
    size = totals.shape[1]
    rest = np.maximum(totals.sum(axis=1, keepdims=True) - totals, 0.0)
    share: Floats | float = size / (size - 1)
    if steps is not None:
        share = 1 / np.maximum(steps.sum(axis=-1, keepdims=True) - steps, 1.0)
    values: Floats = (rest * share) ** (1 / order)
    return values


def margins(lower: Floats, upper: Floats) -> Floats:
    """Return half widths of confidence intervals, from jackknife values and Student's t.

    Parameters
    ----------
    lower, upper : array, shape (..., n)
        Bounds of the n jackknife values, as from `without_each`.

    Returns
    -------
    array, shape (...)
        Half width that is large enough for any values between the bounds.
    """
    size = lower.shape[-1]
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    deviation = middle - middle.mean(axis=-1, keepdims=True)
    norm = np.linalg.norm(deviation, axis=-1) + np.linalg.norm(half, axis=-1)
    widths: Floats = student(size) * np.sqrt((size - 1) / size) * norm
    return widths


def student(pairs: int) -> float:
    """Return the two-sided quantile of Student's t for `CONFIDENCE` and this number of pairs."""
    from scipy.special import stdtrit  # lazy: slow to import

    return float(stdtrit(pairs - 1, (1 + CONFIDENCE) / 2))


def p_values(lower: Floats, upper: Floats) -> Floats:
    """Return the two-sided p value of each sum of n differences, from flips of their signs.

    Parameters
    ----------
    lower, upper : array, shape (tests, n)
        Bounds of the differences; n is at least 2.

    Returns
    -------
    array, shape (tests,)
        p value that is large enough for any differences between the bounds.
    """
    sides = np.concatenate([-upper, lower]).T
    tails = exchanged_p_values([(sides, 0)], np.abs(sides).sum(axis=0))
    both: Floats = np.minimum(1.0, 2 * tails.reshape(2, -1).min(axis=0))
    return both


Exchangeable = tuple[Floats, int]
"""One stratum of a permutation test: n values for each test (n, tests), and a number m.

If m is above 0, the first m values are on the tested side, and the rest is on the other side. An
exchange puts any m values on the tested side. If m is 0, the values are differences of pairs. An
exchange flips the signs of some of them.
"""


def exchanged_p_values(strata: Sequence[Exchangeable], size: Floats | float) -> Floats:
    """Return the one-sided p value of each permutation test that a sum is too large.

    All exchanges are tried, or `PERMUTATIONS` random ones if there are more. The statistic of a
    stratum is the sum of the tested side minus the sum of the other side. The other sum is scaled
    to the same number of values. For differences of pairs, the statistic is their sum. The
    statistics of all strata are added. SciPy has this test only for one stratum, and without
    allowance for rounding.

    Parameters
    ----------
    strata : sequence of Exchangeable
        At least one stratum.
    size : float or array, shape (tests,)
        Sum of the absolute values of all numbers. Sums that differ by less than `TIE` times `size`
        count as equal.

    Returns
    -------
    array, shape (tests,)
    """
    signs = [_signs(len(values), first) for values, first in strata]
    observed = sum(row @ values for row, (values, _) in zip(signs, strata, strict=True))
    threshold = observed - TIE * size
    if math.prod(exchanges(len(values), first) for values, first in strata) <= PERMUTATIONS:
        each = (_all_exchanges(len(values), first) @ values for values, first in strata)
        sums = reduce(lambda a, b: (a[:, None] + b).reshape(-1, b.shape[1]), each)
        shares: Floats = np.count_nonzero(sums >= threshold, axis=0) / len(sums)
        return shares
    rng, above = np.random.default_rng(PERMUTATION_SEED), np.zeros(strata[0][0].shape[1])
    for draws in _portions(PERMUTATIONS, sum(map(len, signs))):
        sampled = (
            _sampled(draws, row, first, rng) @ values
            for row, (values, first) in zip(signs, strata, strict=True)
        )
        above += np.count_nonzero(sum(sampled) >= threshold, axis=0)
    # The data without any exchange count as one more exchange, because they may not be among the
    # random ones.
    sampled_shares: Floats = np.divide(above + 1, PERMUTATIONS + 1)
    return sampled_shares


def exchanges(count: int, first: int) -> int:
    """Return the number of exchanges of `count` values, of which `first` are on the tested side."""
    return math.comb(count, first) if first else 1 << count


def _signs(count: int, first: int) -> Floats:
    """Return the factor with which each value enters the statistic, before any exchange."""
    other = -first / (count - first) if first else 1.0
    return np.concatenate([np.ones(first), np.full(count - first, other)])


def _all_exchanges(count: int, first: int) -> Floats:
    """Return the factors of the values under every exchange, one row per exchange."""
    if not first:
        numbers = np.arange(1 << count)[:, None] >> np.arange(count)
        return np.where(numbers & 1, -1.0, 1.0)
    which = np.array(list(itertools.combinations(range(count), first)))
    rows = np.tile(_signs(count, first)[-1], (len(which), count))
    np.put_along_axis(rows, which, 1.0, axis=1)
    return rows


def _sampled(draws: int, signs: Floats, first: int, rng: np.random.Generator) -> Floats:
    """Return the factors of the values under random exchanges, one row per draw."""
    count = len(signs)
    if first == 1:
        rows = np.full((draws, count), signs[-1])
        rows[np.arange(draws), rng.integers(0, count, draws)] = 1.0
        return rows
    if first:
        return rng.permuted(np.broadcast_to(signs, (draws, count)), axis=1)
    octets = rng.integers(0, 256, (draws, -(-count // 8)), np.uint8)
    return np.where(np.unpackbits(octets, axis=1, count=count), -1.0, 1.0)


def _portions(count: int, size: int) -> Iterator[int]:
    """Split `count` draws of `size` numbers into portions, and yield the draws in each portion."""
    width = max(1, NUMBERS_AT_ONCE // size)
    yield from (min(width, count - done) for done in range(0, count, width))


def permutations_of(pairs: int) -> int:
    """Return the number of exchanges that a test of these pairs tries; 0 with too few pairs."""
    return 0 if pairs < MIN_PAIRS else min(1 << pairs, PERMUTATIONS)


def holm(p_values: Floats, weights: Floats | None = None) -> Floats:
    """Return p values adjusted for the number of tests (Holm 1979), in the given order.

    A test with a larger weight is adjusted less. Without `weights`, all tests have the same weight.
    """
    shares = np.ones(len(p_values)) if weights is None else weights
    order = np.argsort(p_values / shares, kind="stable")
    left = np.cumsum(shares[order][::-1])[::-1]
    adjusted = np.maximum.accumulate(p_values[order] / shares[order] * left)
    result = np.empty(len(p_values))
    result[order] = np.minimum(1.0, adjusted)
    return result


def confidence(
    having: "pd.DataFrame", groups: "pd.Series[int]", orders: "pd.Series[float]"
) -> "pd.DataFrame":
    """Return the confidence intervals of each group; NaN for groups with too few truths.

    Parameters
    ----------
    having : DataFrame
        Rows of a store that have a value.
    groups : Series of int
        Index of the group of each row.
    orders : Series of float
        The order p of each group.

    Returns
    -------
    DataFrame
        One row per group: ``confidence_lower``, ``confidence_upper`` of the combined value, and
        ``per_step_confidence_lower``, ``per_step_confidence_upper`` of the value per step.
    """
    import pandas as pd

    frame = having[TOTAL_ENDS].assign(_group=groups, _truth=truths(having))
    several = frame.groupby("_group")["_truth"].transform("nunique") > 1
    frame["_unit"] = frame["_truth"].where(several, run_ids(having))
    frame["_steps"] = having["judged.steps"].clip(lower=1)
    sums = frame.groupby(["_group", "_unit"])[[*TOTAL_ENDS, "_steps"]].sum()
    ends = np.full((4, len(orders)), np.nan)
    numbers, begins, counts = np.unique(
        sums.index.get_level_values("_group"), return_index=True, return_counts=True
    )
    # Groups with the same number of truths are computed together.
    for size in np.unique(counts[counts >= MIN_PAIRS]):
        of_size = np.flatnonzero(counts == size)
        units = begins[of_size][:, None] + np.arange(size)
        lower, upper, steps = (
            sums[name].to_numpy(float)[units] for name in (*TOTAL_ENDS, "_steps")
        )
        groups_of = numbers[of_size]
        order = np.asarray(orders.loc[groups_of], np.float64)[:, None]
        ends[:2, groups_of] = intervals(lower, upper, order)
        ends[2:, groups_of] = intervals(lower, upper, order, steps)
    return pd.DataFrame(ends.T, columns=OF_INTERVALS, index=orders.index)
