"""What a batch says of the values of a label: a proven order, and beside it a statistical one.

Compared are jobs that differ in that label alone, and of these only such as all its values have
(`batches.pairing`). The proven order is that of brackets of the combined value on these files. The
statistical one is about other truths like these: what it counts are truths, for jobs of one
truth are not independent of each other, or the jobs where there is one truth alone.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.campaign.grouping import ESTIMATE_DIGEST, pair_numbers, truths
from tgospa_eval.campaign.ranking import about_covariances
from tgospa_eval.campaign.row import LABEL, covariances_of
from tgospa_eval.common.interval import EQUAL, Interval, places, second_less_first, verdict
from tgospa_eval.common.words import counted, natural
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.reports.batch import Places, Ranking
from tgospa_eval.results.consistency import NEES
from tgospa_eval.results.records import Json
from tgospa_eval.tracks.judged import DIGESTS, JUDGE_ALIKE, incomparable, judged_of

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


# -------------------------------------------------------------------------------------------------
# Proven and statistical orders of the values of a label.


MOST_COMPARED = 100
"""Values of a label that are compared: all pairs of them are."""

TOTAL_ENDS = ["total_lower", "total_upper"]
"""Columns of the bracket of a total."""

NOTHING = Interval(lower=0.0, upper=0.0)
"""The difference of what is the same."""

Parameters = Mapping[str, float | str]


def rankings(
    having: "pd.DataFrame", label: str, parameters: Sequence[str], names: Iterable[str]
) -> Iterator[Ranking | str]:
    """A ranking for each set of parameters, or a sentence that says why there is none; warnings.

    Parameters
    ----------
    having : DataFrame
        Rows of a store that have a value.
    label : str
        What is compared.
    parameters : sequence of str
        Columns of parameters that differ.
    names : iterable of str
        All values of the label, also of rows that have none.
    """
    if not parameters:
        yield from _ranking(having, label, {}, names)
        return
    for _, part in having.groupby(list(parameters)):
        yield from _ranking(part, label, {name: part[name].iloc[0] for name in parameters}, names)


def _ranking(
    part: "pd.DataFrame", label: str, parameters: Parameters, all_names: Iterable[str]
) -> Iterator[Ranking | str]:
    column = LABEL + label
    part = part.assign(_pair=pair_numbers(part, [label]), _truth=truths(part))
    # Two with the same labels and truth: a manifest has changed, the older one is of the past.
    part = part.sort_values("finished", kind="stable")
    part = part.drop_duplicates([column, "_pair"], keep="last")
    names = sorted(part[column].unique(), key=natural)
    if len(names) < 2:
        yield f"{label} has one value alone: there is nothing to rank"
        return
    if len(names) > MOST_COMPARED:
        yield f"{label} has {len(names):,} values: at most {MOST_COMPARED} are ranked"
        return
    common = part[part.groupby("_pair")["_pair"].transform("size") == len(names)]
    if not len(common):
        yield f"no truth is evaluated with all values of {label}: they are not ranked"
        return
    kinds = common.groupby("_pair")[list(DIGESTS)].nunique().max(axis=1)
    if (kinds > 1).any():
        jobs = common[common["_pair"] == kinds.index[kinds > 1][0]]
        wrong = incomparable({row[column]: judged_of(row) for row in jobs.to_dict("records")})
        yield f"{label} is not ranked: {jobs['truth'].iloc[0]}: {wrong}; {JUDGE_ALIKE}"
        return
    names, lower, upper = _side_by_side(common, column, names)
    entries, comparisons = _orders(common, column, names, (lower, upper))
    count = lower.shape[1]
    yield Ranking(
        label=label,
        entries=entries,
        comparisons=comparisons,
        jobs=len(common) // len(names),
        all_jobs=int(part["_pair"].nunique()),
        pairs=count,
        truths=common["_truth"].nunique(),
        permutations=permutations_of(count),
        seed=PERMUTATION_SEED,
        parameters=parameters,
        left_out=tuple(sorted(set(all_names) - set(names), key=natural)),
    )
    yield from _opposed(common, column, names)
    items: list[Json] = []
    for name in names:
        costs, nees = covariances_of(common[common[column] == name])
        items.append({"name": name, **costs, NEES: nees and nees.record()})
    yield from map(str, about_covariances(items))


def _opposed(common: "pd.DataFrame", column: str, names: Sequence[str]) -> Iterator[str]:
    """A warning where each job counts the same, as in `compare`, and the order is another one."""
    if common["judged.steps"].nunique() < 2:
        return
    shares = common["total_upper"] / common["judged.steps"].clip(lower=1)
    means = shares.groupby(common[column]).mean()
    pairs = [
        (first, second)
        for first, second in itertools.combinations(names, 2)
        if means[second] < means[first] * (1 - EQUAL)
    ]
    if pairs:
        (first, second), *others = pairs
        more = f", and {counted(len(others), 'more pair')} are so" if others else ""
        yield (
            f"warning: {first} is before {second} by combined, in which long jobs count more, but "
            f"has the larger mean of costs per step, in which each job counts the same{more}"
        )


def _side_by_side(
    common: "pd.DataFrame", column: str, names: Sequence[str]
) -> tuple[list[str], Floats, Floats]:
    """Names, best first, and bounds of their totals of each truth, or of each job of one truth.

    They are in an order that no name of a sequence or run has a part in.
    """
    truth = common.groupby("_pair")["_truth"].first()
    costs = common.set_index(["_pair", column]).sort_index()[TOTAL_ENDS].unstack(column)
    if truth.nunique() > 1:
        costs = costs.groupby(truth).sum()
    lower, upper = (costs[side][list(names)].to_numpy(float).T for side in TOTAL_ENDS)
    pairs = np.lexsort(np.concatenate([np.sort(lower, axis=0), np.sort(upper, axis=0)]))
    lower, upper = lower[:, pairs], upper[:, pairs]
    best = np.lexsort((lower.sum(axis=1), upper.sum(axis=1)))
    return [names[k] for k in best], lower[best], upper[best]


def _orders(
    common: "pd.DataFrame", column: str, names: Sequence[str], totals: tuple[Floats, Floats]
) -> tuple[list[Json], list[Json]]:
    """A row for each that is compared, and for each pair of them, as the JSON of a batch has them.

    Parameters
    ----------
    common : DataFrame
        Jobs that all have.
    column : str
        What is compared.
    names : sequence of str
        Best first.
    totals : pair of array, shape (names, pairs)
        Bounds of the totals.
    """
    size, order = len(names), float(common["order"].iloc[0])
    steps = common.groupby(column)["judged.steps"].sum().loc[list(names)].to_numpy(float)
    values, per_step = (_combined(totals, order, divisor) for divisor in (1.0, steps))
    compared = list(itertools.combinations(range(size), 2))
    data = _digests(common, column, names)
    same = np.array([bool(data[a]) and data[a] == data[b] for a, b in compared])
    comparisons: list[Json] = []
    for (a, b), alike in zip(compared, same, strict=True):
        difference = NOTHING if alike else second_less_first(values[a], values[b])
        comparisons.append(
            {
                "first": names[a],
                "second": names[b],
                "verdict": "equal" if alike else verdict(values[a], values[b]),
                "difference": [difference.lower, difference.upper],
                **dict.fromkeys(("lower", "upper", "p_value", "p_holm", "significant")),
            }
        )
    equal = {
        frozenset(pair)
        for pair, row in zip(compared, comparisons, strict=True)
        if row["verdict"] == "equal"
    }
    proven = places(values, lambda *pair: frozenset(pair) in equal)
    sure: list[Any] = [None] * size
    inferred: list[Any] = sure
    if totals[0].shape[1] >= LEAST_PAIRS:
        sure = np.stack(intervals(*totals, order), axis=1).tolist()
        inferred = _inferred(comparisons, np.array(compared).T, same, totals, order)
    entries = [
        {
            "name": name,
            "place": place,
            "combined": value.upper,
            "combined_lower": value.lower,
            "per_step": each.upper,
            "per_step_lower": each.lower,
            "confidence": ends,
            "statistical_place": statistical,
        }
        for name, place, value, each, ends, statistical in zip(
            names, proven, values, per_step, sure, inferred, strict=True
        )
    ]
    return entries, comparisons


def _combined(totals: tuple[Floats, Floats], order: float, per: Floats | float) -> list[Interval]:
    """Brackets of the roots of the sums, divided by something before."""
    lower, upper = (((side.sum(axis=1) / per) ** (1 / order)).tolist() for side in totals)
    return [Interval(lower=low, upper=high) for low, high in zip(lower, upper, strict=True)]


def _digests(common: "pd.DataFrame", column: str, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Of the data of each: those with the same have equal values, whatever the brackets are."""
    if ESTIMATE_DIGEST not in common:
        return [()] * len(names)
    known = common.sort_values("_pair").dropna(subset=ESTIMATE_DIGEST)
    found = {name: tuple(group) for name, group in known.groupby(column)[ESTIMATE_DIGEST]}
    return [found.get(name, ()) for name in names]


def _inferred(
    comparisons: Sequence[Json],
    compared: Ints,
    same: NDArray[np.bool_],
    totals: tuple[Floats, Floats],
    order: float,
) -> list[Places]:
    """Fill in what is concluded of each pair; the places that follow from it.

    One is ahead only of those from which it differs significantly.
    """
    first, second = compared
    lower, upper = totals
    least, most = lower[second] - upper[first], upper[second] - lower[first]
    least[same] = most[same] = 0.0
    p_value = p_values(least, most)
    adjusted = holm(p_value)
    significant = adjusted < 1 - CONFIDENCE
    lower, upper = (without_each(side, order) for side in totals)
    margin = margins(lower[second] - upper[first], upper[second] - lower[first])
    found = np.stack([np.where(same, 0.0, margin), p_value, adjusted], axis=1).tolist()
    for row, (half, p, p_holm), differs in zip(
        comparisons, found, significant.tolist(), strict=True
    ):
        low, high = row["difference"]
        row |= {"lower": low - half, "upper": high + half, "p_value": p, "p_holm": p_holm}
        row["significant"] = differs
    size = len(lower)
    ahead, behind = (np.bincount(side[significant], minlength=size) for side in (second, first))
    return list(zip((1 + ahead).tolist(), (size - behind).tolist(), strict=True))


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
