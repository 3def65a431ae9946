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
from tgospa_eval.campaign.row import LABEL
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import EQUAL, Interval, places, second_less_first, verdict
from tgospa_eval.common.words import counted, natural
from tgospa_eval.problem.problem import Floats
from tgospa_eval.reports.batch_records import (
    Comparison,
    Inference,
    Places,
    Ranked,
    Ranking,
    Verdict,
)
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


def holm(p_values: Floats) -> Floats:
    """P values adjusted for their number (Holm 1979), in the order given."""
    order = np.argsort(p_values)
    adjusted = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Paired:
    """What is compared; rows are names, columns are truths, or jobs of one truth.

    Parameters
    ----------
    names : list of str
        Best first.
    lower, upper : array, shape (names, pairs)
        Bounds of totals.
    steps : array, shape (names,)
        Steps of the horizon, of all.
    data : list of tuple of str
        Digests of the estimates, if they are known.
    order : float
        Of all.
    """

    names: list[str]
    lower: Floats
    upper: Floats
    steps: Floats
    data: list[tuple[str, ...]]
    order: float

    def combined(self, per: Floats | float = 1.0) -> list[Interval]:
        """Brackets of the roots of the sums, divided by something before."""
        ends = ((side.sum(axis=1) / per) ** (1 / self.order) for side in (self.lower, self.upper))
        return _between(*ends)

    def same(self, first: int, second: int) -> bool:
        """Whether two have the same data, and so the same values, whatever the brackets are."""
        return bool(self.data[first]) and self.data[first] == self.data[second]

    def verdict(self, values: Sequence[Interval], first: int, second: int) -> Verdict:
        """What is proven of two."""
        if self.same(first, second):
            return "equal"
        return verdict(values[first], values[second])

    def difference(self, values: Sequence[Interval], first: int, second: int) -> Interval:
        """Bracket of the second value less the first."""
        if self.same(first, second):
            return NOTHING
        return second_less_first(values[first], values[second])


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
    paired = _paired(common, column, names)
    count = paired.lower.shape[1]
    enough = count >= LEAST_PAIRS
    entries, comparisons = _entries(paired, enough=enough)
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
    yield from _opposed(common, column, paired.names)


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


def _paired(common: "pd.DataFrame", column: str, names: Sequence[str]) -> _Paired:
    """The totals side by side, in an order that no name of a sequence or run has a part in."""
    table = common.set_index(["_pair", column]).sort_index()
    truth = common.groupby("_pair")["_truth"].first()
    costs = table[TOTAL_ENDS].unstack(column)
    if truth.nunique() > 1:
        costs = costs.groupby(truth).sum()
    lower, upper = (costs[side][list(names)].to_numpy(float).T for side in TOTAL_ENDS)
    pairs = np.lexsort(np.concatenate([np.sort(lower, axis=0), np.sort(upper, axis=0)]))
    lower, upper = lower[:, pairs], upper[:, pairs]
    ends = zip(upper.sum(axis=1), lower.sum(axis=1), strict=True)
    best = [k for _, k in sorted((end, k) for k, end in enumerate(ends))]
    names = [names[k] for k in best]
    steps = table["judged.steps"].groupby(level=column).sum()
    digests = table[ESTIMATE_DIGEST].unstack(column) if ESTIMATE_DIGEST in table else None
    return _Paired(
        names=names,
        lower=lower[best],
        upper=upper[best],
        steps=steps[names].to_numpy(float),
        data=[() if digests is None else tuple(digests[name].dropna()) for name in names],
        order=float(common["order"].iloc[0]),
    )


def _entries(paired: _Paired, *, enough: bool) -> tuple[tuple[Ranked, ...], tuple[Comparison, ...]]:
    """Those that are compared, and all pairs of them."""
    values, per_step = paired.combined(), paired.combined(paired.steps)
    proven = places(values, lambda *pair: paired.verdict(values, *pair) == "equal")
    found = list(itertools.combinations(range(len(values)), 2))
    own = _between(*intervals(paired.lower, paired.upper, paired.order)) if enough else None
    inferences = _inferences(paired, found, values) if enough else [None] * len(found)
    statistical = _statistical(found, inferences, len(values)) if enough else None
    return tuple(
        Ranked(
            name=name,
            place=proven[k],
            combined=values[k],
            per_step=per_step[k],
            confidence=own[k] if own else None,
            statistical_place=statistical[k] if statistical else None,
        )
        for k, name in enumerate(paired.names)
    ), tuple(
        Comparison(
            first=paired.names[a],
            second=paired.names[b],
            verdict=paired.verdict(values, a, b),
            difference=paired.difference(values, a, b),
            inference=inference,
        )
        for (a, b), inference in zip(found, inferences, strict=True)
    )


def _between(lower: Floats, upper: Floats) -> list[Interval]:
    """One for each pair of ends."""
    ends = zip(lower.tolist(), upper.tolist(), strict=True)
    return [Interval(lower=low, upper=high) for low, high in ends]


def _inferences(
    paired: _Paired, found: Sequence[tuple[int, int]], values: Sequence[Interval]
) -> list[Inference]:
    """What is concluded of each pair."""
    first, second = (list(side) for side in zip(*found, strict=True))
    least = paired.lower[second] - paired.upper[first]
    most = paired.upper[second] - paired.lower[first]
    same = [paired.same(a, b) for a, b in found]
    least[same] = most[same] = 0.0
    p_value = p_values(least, most)
    lower, upper = (without_each(side, paired.order) for side in (paired.lower, paired.upper))
    inferences = []
    for (a, b), p, adjusted in zip(found, p_value, holm(p_value), strict=True):
        least_without, most_without = lower[b] - upper[a], upper[b] - lower[a]
        margin = 0.0 if paired.same(a, b) else float(margins(least_without, most_without))
        difference = paired.difference(values, a, b)
        inferences.append(
            Inference(
                confidence=Interval(
                    lower=difference.lower - margin, upper=difference.upper + margin
                ),
                p_value=float(p),
                p_holm=float(adjusted),
                significant=bool(adjusted < 1 - CONFIDENCE),
            )
        )
    return inferences


def _statistical(
    found: Sequence[tuple[int, int]], inferences: Sequence[Inference | None], count: int
) -> list[Places]:
    """Best and worst place: one is ahead only of those from which it differs significantly."""
    ahead, behind = [0] * count, [0] * count
    for (a, b), inference in zip(found, inferences, strict=True):
        if inference is not None and inference.significant:
            ahead[b] += 1
            behind[a] += 1
    return [(1 + ahead[k], count - behind[k]) for k in range(count)]


def confidence(
    having: "pd.DataFrame", groups: "pd.Series[int]", orders: "pd.Series[float]"
) -> dict[str, NDArray[Any]]:
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
    dict of array, shape (groups,)
        ``confidence_lower``, ``confidence_upper``.
    """
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
    return {"confidence_lower": found[0], "confidence_upper": found[1]}
