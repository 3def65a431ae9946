"""Inference from several jobs: intervals and tests of the cost on other truths like these.

The sample consists of truths, as jobs of one truth are not independent of each other. If there is
only one truth, the sample consists of its jobs.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.campaign.row import truths
from tgospa_eval.common.arrays import Floats

if TYPE_CHECKING:
    import pandas as pd

PERMUTATIONS = 9999
"""Number of random exchanges, used where the number of all exchanges is larger."""

PERMUTATION_SEED = 1
"""Fixed seed, so that the same data have the same p values."""

CONFIDENCE = 0.95
"""Level of the intervals; tests are significant below 1 minus this level."""

MIN_PAIRS = 6
"""Smallest number n of pairs for two-sided p values below 0.05: the smallest p value is 2 / 2^n."""

TIE = 1e-12
"""Tolerance relative to the sum of all sizes: sums that differ by less are equal."""

NUMBERS_AT_ONCE = 4_000_000
"""Numbers in one portion of random exchanges, which bounds the memory."""

OF_INTERVALS = [f"{of}confidence_{end}" for of in ("", "per_step_") for end in ("lower", "upper")]
"""Columns of the intervals of groups."""

TOTAL_ENDS = ["total_lower", "total_upper"]
"""Columns of the bracket of a total."""


def intervals(
    lower: Floats, upper: Floats, order: Floats | float, steps: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return intervals of combined values, by Student's t of their logarithm and the jackknife.

    Parameters
    ----------
    lower, upper : array, shape (rows, n)
        Bounds of totals; n is at least 2.
    order : float or array, shape (rows, 1)
        The order p.
    steps : array, shape (n,) or (rows, n), optional
        Steps of each total. If given, the intervals are those of values per step (ratios of sums).

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
    # The deviation is largest if only one total is above 0; this limits intervals of wide brackets.
    size = lower.shape[1]
    ratio = np.full(len(lower_value), student(size) * np.sqrt(size / (size - 1)))
    np.divide(margin, lower_value, out=ratio, where=margin < ratio * lower_value)
    return lower_value * np.exp(-ratio), upper_value * np.exp(ratio)


FEW_EVENTS = 10
"""If fewer runs than this have a cost, intervals use the share of these runs, not the jackknife.

The jackknife cannot estimate the spread of so few costs. If all runs have a cost, it is used.
"""


def rare_intervals(
    lower: Floats, upper: Floats, order: float, typical: float
) -> tuple[Floats, Floats]:
    """Return intervals of root mean squares, even if few runs have a cost above 0.

    With fewer than `FEW_EVENTS` such runs, the interval of their share is computed (Clopper and
    Pearson 1934). Its lower end is multiplied by the smaller of two costs: the mean of these runs,
    and `typical`. Its upper end is multiplied by the larger of the two. Coverage by simulation:
    docs/theory/intervals.md.

    Parameters
    ----------
    lower, upper : array, shape (rows, n)
        Bounds of costs; n is at least 2.
    order : float
        The order p.
    typical : float
        Mean of all costs above 0 at all times; NaN if no run has a cost.

    Returns
    -------
    tuple of array, shape (rows,)
        Lower and upper ends; NaN where the cost per run is not known.
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
    """Return the combined values without each total, scaled to the number of totals, or per step.

    Parameters
    ----------
    totals : array, shape (rows, n)
        Costs; n is at least 2.
    order : float or array, shape (rows, 1)
        The order p.
    steps : array, shape (n,) or (rows, n), optional
        Steps of each total, for values per step.

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
    """Return half widths of intervals of values, by Student's t and the jackknife.

    Parameters
    ----------
    lower, upper : array, shape (..., n)
        Bounds of each value without one pair.

    Returns
    -------
    array, shape (...)
        Largest half width for any values between the bounds.
    """
    size = lower.shape[-1]
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    deviation = middle - middle.mean(axis=-1, keepdims=True)
    norm = np.linalg.norm(deviation, axis=-1) + np.linalg.norm(half, axis=-1)
    widths: Floats = student(size) * np.sqrt((size - 1) / size) * norm
    return widths


def student(pairs: int) -> float:
    """Return the two-sided quantile of Student's t for this number of pairs."""
    from scipy.special import stdtrit  # lazy: slow to import

    return float(stdtrit(pairs - 1, (1 + CONFIDENCE) / 2))


def p_values(lower: Floats, upper: Floats) -> Floats:
    """Return two-sided p values of sums of differences, under flips of their signs.

    Parameters
    ----------
    lower, upper : array, shape (tests, n)
        Bounds of the differences; n is at least 2.

    Returns
    -------
    array, shape (tests,)
        Largest p value for any differences between the bounds.
    """
    sides = np.concatenate([-upper, lower]).T
    tails = exchanged_p_values([(sides, 0)], np.abs(sides).sum(axis=0))
    both: Floats = np.minimum(1.0, 2 * tails.reshape(2, -1).min(axis=0))
    return both


Exchangeable = tuple[Floats, int]
"""Values (n, tests) that can be exchanged with each other, and the number of first values that are
on the side whose sum is tested; 0 for differences of pairs, whose signs can be flipped."""


def exchanged_p_values(strata: Sequence[Exchangeable], size: Floats | float) -> Floats:
    """Return one-sided p values of too large sums, under all exchanges or many random ones.

    The statistic is the sum of the first side minus the sum of the other side, scaled to the same
    number of values. Strata are added up. SciPy has this test for one stratum, and without
    allowance for rounding.

    Parameters
    ----------
    strata : sequence of Exchangeable
        At least one stratum.
    size : float or array, shape (tests,)
        Sum of the sizes of all numbers. Sums that differ by less than `TIE` times `size` are equal.

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
    # The data as they are count as one exchange, as random exchanges may not include it.
    sampled_shares: Floats = np.divide(above + 1, PERMUTATIONS + 1)
    return sampled_shares


def exchanges(count: int, first: int) -> int:
    """Return the number of exchanges of `count` values."""
    return math.comb(count, first) if first else 1 << count


def _signs(count: int, first: int) -> Floats:
    """Return the factor of each value in the statistic of the data."""
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
    """Yield the numbers of draws per portion, for draws of `size` numbers each."""
    width = max(1, NUMBERS_AT_ONCE // size)
    yield from (min(width, count - done) for done in range(0, count, width))


def permutations_of(pairs: int) -> int:
    """Return the number of flips that a test uses; 0 with too few pairs."""
    return 0 if pairs < MIN_PAIRS else min(1 << pairs, PERMUTATIONS)


def holm(p_values: Floats, weights: Floats | None = None) -> Floats:
    """Return p values adjusted for their number (Holm 1979), in the given order.

    `weights` are optional.
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
    """Return intervals of the combined values of groups, NaN for groups that are too small.

    Parameters
    ----------
    having : DataFrame
        Rows of a store with a value.
    groups : Series of int
        The group of each row, by the index of the rows.
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
    frame["_unit"] = frame["_truth"].where(several, np.arange(len(frame)).astype(str))
    frame["_steps"] = having["judged.steps"].clip(lower=1)
    sums = frame.groupby(["_group", "_unit"])[[*TOTAL_ENDS, "_steps"]].sum()
    ends = np.full((4, len(orders)), np.nan)
    numbers, begins, counts = np.unique(
        sums.index.get_level_values("_group"), return_index=True, return_counts=True
    )
    # Groups of one size are computed together.
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
