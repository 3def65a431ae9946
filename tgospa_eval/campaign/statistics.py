"""What is inferred from several jobs: intervals and tests of what other truths like these cost.

What counts are truths, for jobs of one truth are not independent of each other, or the jobs where
there is one truth alone.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.campaign.grouping import truths
from tgospa_eval.common.arrays import Floats

if TYPE_CHECKING:
    import pandas as pd

PERMUTATIONS = 9999
"""Flips that are drawn, where all are not fewer."""

PERMUTATION_SEED = 1
"""The same batch has the same tables."""

CONFIDENCE = 0.95
"""Level of the intervals; tests are significant below what is left of 1."""

LEAST_PAIRS = 6
"""With fewer no two-sided p value can be below 0.05: the least is 2 / 2^n."""

TIE = 1e-14
"""Of the sum of all differences, of either sign: sums that differ by less are equal."""

NUMBERS_AT_ONCE = 4_000_000
"""Numbers that are flipped at once."""

TOTAL_ENDS = ["total_lower", "total_upper"]
"""Columns of the bracket of a total."""


def intervals(lower: Floats, upper: Floats, order: Floats | float) -> tuple[Floats, Floats]:
    """Intervals of combined values: Student's t of their logarithm, by the jackknife.

    Parameters
    ----------
    lower, upper : array, shape (rows, n)
        Bounds of totals; n is at least 2.
    order : float or array, shape (rows, 1)
        The order p.

    Returns
    -------
    tuple of array, shape (rows,)
        Lower and upper ends.
    """
    # Sorted, so that the order of the totals changes no bit.
    place = np.lexsort((upper, lower))
    lower, upper = (np.take_along_axis(side, place, axis=1) for side in (lower, upper))
    least, most = (
        (side.sum(axis=1, keepdims=True) ** (1 / order))[:, 0] for side in (lower, upper)
    )
    margin = margins(without_each(lower, order), without_each(upper, order))
    # No totals deviate by more than one alone that is not 0: the bound where brackets are wide.
    size = lower.shape[1]
    ratio = np.full(len(least), student(size) * np.sqrt(size / (size - 1)))
    np.divide(margin, least, out=ratio, where=margin < ratio * least)
    return least * np.exp(-ratio), most * np.exp(ratio)


def without_each(totals: Floats, order: Floats | float) -> Floats:
    """Combined values of all totals but one, brought to the number of all.

    Parameters
    ----------
    totals : array, shape (rows, n)
        Costs; n is at least 2.
    order : float or array, shape (rows, 1)
        The order p.

    Returns
    -------
    array, shape (rows, n)
    """
    size = totals.shape[1]
    others = np.maximum(totals.sum(axis=1, keepdims=True) - totals, 0.0)
    found: Floats = (others * (size / (size - 1))) ** (1 / order)
    return found


def margins(lower: Floats, upper: Floats) -> Floats:
    """Half widths of intervals of values, by Student's t and the jackknife.

    Parameters
    ----------
    lower, upper : array, shape (..., n)
        Bounds of each value without one pair.

    Returns
    -------
    array, shape (...)
        The largest for any values between the bounds.
    """
    size = lower.shape[-1]
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    apart = middle - middle.mean(axis=-1, keepdims=True)
    norm = np.linalg.norm(apart, axis=-1) + np.linalg.norm(half, axis=-1)
    found: Floats = student(size) * np.sqrt((size - 1) / size) * norm
    return found


def student(pairs: int) -> float:
    """Quantile of Student's t, two-sided, of so many pairs."""
    from scipy.special import stdtrit  # here: slow to import

    return float(stdtrit(pairs - 1, (1 + CONFIDENCE) / 2))


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
    flips, every = permutations_of(size), 1 << size if size < PERMUTATIONS.bit_length() else 0
    at_most, rng = np.zeros(len(sides), np.int64), np.random.default_rng(PERMUTATION_SEED)
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
    return PERMUTATIONS if pairs >= PERMUTATIONS.bit_length() else 1 << pairs


def holm(p_values: Floats, weights: Floats | None = None) -> Floats:
    """P values adjusted for their number (Holm 1979), with weights if some, in the order given."""
    shares = np.ones(len(p_values)) if weights is None else weights
    order = np.argsort(p_values / shares, kind="stable")
    left = np.cumsum(shares[order][::-1])[::-1]
    adjusted = np.maximum.accumulate(p_values[order] / shares[order] * left)
    found = np.empty(len(p_values))
    found[order] = np.minimum(1.0, adjusted)
    return found


def confidence(
    having: "pd.DataFrame", groups: "pd.Series[int]", orders: "pd.Series[float]"
) -> "pd.DataFrame":
    """Intervals of the combined values of groups, NaN for those that are too small.

    Parameters
    ----------
    having : DataFrame
        Rows of a store that have a value.
    groups : Series of int
        The group of each row, by the index of the rows.
    orders : Series of float
        The order p of each group.

    Returns
    -------
    DataFrame
        A row for each group: ``confidence_lower``, ``confidence_upper``.
    """
    import pandas as pd

    frame = having[TOTAL_ENDS].assign(_group=groups, _truth=truths(having))
    several = frame.groupby("_group")["_truth"].transform("nunique") > 1
    frame["_unit"] = frame["_truth"].where(several, np.arange(len(frame)).astype(str))
    sums = frame.groupby(["_group", "_unit"])[TOTAL_ENDS].sum()
    found = np.full((2, len(orders)), np.nan)
    numbers, begins, counts = np.unique(
        sums.index.get_level_values("_group"), return_index=True, return_counts=True
    )
    # Those of one size are worked out together.
    for size in np.unique(counts[counts >= LEAST_PAIRS]):
        of_size = np.flatnonzero(counts == size)
        units = begins[of_size][:, None] + np.arange(size)
        lower, upper = (sums[end].to_numpy(float)[units] for end in TOTAL_ENDS)
        groups_of = numbers[of_size]
        order = np.asarray(orders.loc[groups_of], np.float64)[:, None]
        found[:, groups_of] = intervals(lower, upper, order)
    names = ["confidence_lower", "confidence_upper"]
    return pd.DataFrame(found.T, columns=names, index=orders.index)
