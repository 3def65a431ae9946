"""Consistency of covariances with errors: the NEES of assigned pairs, and its sums.

    NEES = e' P^-1 e,   where e is the error of an assigned state, and P its covariance.

If errors of d components are Gaussian with covariance P, NEES is chi-square distributed with d
degrees of freedom (Bar-Shalom, Li and Kirubarajan 2001, section 5.4.2). ANEES is the mean NEES
divided by d (Li, Zhao and Jilkov 2001). `NeesSums` of several evaluations, or of the parts of one,
can be added.

The band of a mean NEES is an interval: if errors fit the covariances, the mean is in it with a
given probability.
"""

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import number
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.solution import AssignedPairs
from tgospa_eval.results.records import Arrays, Columns, Json

NEES = "nees"
"""Name of the column in tables, and of the record in the JSON."""

STORED_NEES = f"{NEES}.sums"
"""Column of the sums, as text, in the store of a batch."""

ABOUT_THE_ORDER = ("overconfident", "underconfident", "order-by-covariances", "copies")
"""Codes of notices about a ranking."""

INSIDE = 0.95
"""Probability of the region that counts as inside for a pair, and of the reported band."""

EVIDENT = 0.999
"""Probability of the band outside of which a warning is raised."""

FEWEST = 10
"""Smallest number of independent values with which a warning is possible."""

BINS = 10
"""Number of bins of the histogram of ranks."""

MAX_CORRELATION = 0.999
"""Limit of the correlation of neighbouring steps, so that some independent values are left."""


def chi_square(share: float, freedom: Floats | float) -> Any:
    """Return the quantile at `share` of the chi-square distribution with `freedom` degrees."""
    from scipy.special import gammaincinv  # lazy: slow to import

    return 2 * gammaincinv(np.asarray(freedom) / 2, share)


def band(count: Floats | float, components: int, share: float = INSIDE) -> tuple[Any, Any]:
    """Return the band in which the mean of `count` independent NEES is with probability `share`."""
    freedom = np.asarray(count) * components
    low, high = (chi_square((1 + sign * share) / 2, freedom) / count for sign in (-1, 1))
    return (low, high) if np.ndim(count) else (float(low), float(high))


def band_in_words(low: float, high: float, between: str = " to ") -> str:
    """Format the ends of a band, with more digits if it is narrow."""
    digits = 3 if high > 1.02 * low else 5
    return f"{number(low, digits)}{between}{number(high, digits)}"


@dataclass(frozen=True, kw_only=True, eq=False)
class NeesSums:
    """Sums over assigned pairs, from which all numbers about NEES follow.

    Parameters
    ----------
    components : int
        Number d of components of the states.
    pairs : float
        Number of assigned pairs with a NEES, counted by their weights.
    singular : float
        Number of assigned pairs without a NEES, because the covariance is singular or missing.
    total, squares : float
        Sum of NEES, and sum of its squares.
    inside : float
        Number of pairs inside the region of 95 %.
    neighbours, products, ends : float
        Two NEES are neighbours if they belong to the same object and estimate at consecutive steps.
        `neighbours` is the number of pairs of neighbours. For each such pair, the product of both
        NEES is added to `products`, and their sum to `ends`.
    ranks : (d, 10) tuple of tuple of float
        For clouds: for each component, the number of true states in each tenth of the distribution
        of the particles.
    """

    components: int
    pairs: float = 0.0
    singular: float = 0.0
    total: float = 0.0
    squares: float = 0.0
    inside: float = 0.0
    neighbours: float = 0.0
    products: float = 0.0
    ends: float = 0.0
    ranks: tuple[tuple[float, ...], ...] = ()

    def __str__(self) -> str:
        return f"NEES {self.in_words}"

    def plain(self) -> dict[str, Any]:
        """Return the sums as plain values; `NeesSums(**values)` restores them."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def row(self) -> dict[str, Any]:
        """Return the sums as columns of a row of a store; `of_row` restores them."""
        import json  # lazy: small evaluations do not need it

        record = {f"{NEES}.{name}": value for name, value in self.record().items()}
        return {NEES: record.pop(f"{NEES}.mean"), **record, STORED_NEES: json.dumps(self.plain())}

    @classmethod
    def of_row(cls, row: Mapping[Any, Any]) -> "NeesSums | None":
        """Return the sums in a row of a store, or None if the row has no sums."""
        import json

        text = row.get(STORED_NEES)
        return cls(**json.loads(text)) if isinstance(text, str) else None

    @classmethod
    def of_values(cls, values: Json) -> "NeesSums | None":
        """Return the sums in a JSON document, or None if it has no record of NEES."""
        return cls(**values[NEES]["sums"]) if values.get(NEES) else None

    @classmethod
    def joined(cls, several: Iterable["NeesSums"]) -> "NeesSums | None":
        """Add the sums of evaluations with the same number of components; None without any sums."""
        each = [one.plain() for one in several]
        if not each:
            return None
        joined: dict[str, Any] = {"components": max(one["components"] for one in each)}
        ranks = [np.array(one["ranks"]) for one in each if one["ranks"]]
        if ranks:
            joined["ranks"] = tuple(map(tuple, np.sum(ranks, axis=0).tolist()))
        for name in each[0].keys() - {"components", "ranks"}:
            joined[name] = float(sum(one[name] for one in each))
        return cls(**joined)

    @property
    def mean(self) -> float:
        """Mean NEES, which is d for a calibrated filter."""
        return self.total / self.pairs

    @property
    def independent(self) -> float:
        """Number of independent values whose mean varies as much as that of all N pairs.

        It is ``N (1 - r) / (1 + r)`` with the correlation r of neighbouring steps, because errors
        of a filter last for several steps.
        """
        if not self.pairs:
            return 0.0
        variance = self.squares / self.pairs - self.mean**2
        if not self.neighbours or variance <= 0:
            return self.pairs
        centred = self.products - self.mean * self.ends + self.neighbours * self.mean**2
        r = min(max(centred / self.neighbours / variance, 0.0), MAX_CORRELATION)
        return max(self.pairs * (1 - r) / (1 + r), 1.0)

    @property
    def verdict(self) -> str:
        """Verdict in words: ``"consistent"`` if the mean is in its band.

        Above the band it is ``"overconfident"``, below ``"underconfident"``.
        """
        if not self.pairs:
            return "no assigned state has a covariance"
        low, high = band(self.independent, self.components)
        if low <= self.mean <= high:
            return "consistent"
        return "overconfident" if self.mean > high else "underconfident"

    def record(self) -> Json:
        """Return the record for the JSON: the numbers, and the sums that `joined` needs."""
        low, high = band(self.independent, self.components) if self.pairs else (None, None)
        return {
            "mean": self.mean if self.pairs else None,
            "anees": self.mean / self.components if self.pairs else None,
            "lower": low,
            "upper": high,
            "independent_pairs": self.independent,
            "inside": self.inside / self.pairs if self.pairs else None,
            "verdict": self.verdict,
            "sums": self.plain(),
        }

    def numbers(self) -> dict[str, float]:
        """Return the numbers by name for logs and rules of a gate; empty if no pair has a NEES."""
        if not self.pairs:
            return {}
        share = self.inside / self.pairs
        return {
            NEES: self.mean,
            f"{NEES}.anees": self.mean / self.components,
            f"{NEES}.inside": share,
        }

    @property
    def in_words(self) -> str:
        """Mean, its expected value and the verdict, in words."""
        if not self.pairs:
            return f"none: {self.verdict}"
        low, high = band(self.independent, self.components)
        share = f"{100 * self.inside / self.pairs:.1f} %"
        return (
            f"{number(self.mean, 4)} where {self.components} is expected "
            f"({band_in_words(low, high)}), {share} of states inside the "
            f"{100 * INSIDE:g} % region: {self.verdict}"
        )

    def warnings(self, spread: float | None) -> tuple[Notice, ...]:
        """Warn if the mean is far from its expected value.

        `spread` is the part of the cost by differences of covariances, or None.
        """
        if self.independent < FEWEST or not self.total:  # equal files have errors of 0
            return ()
        low, high = band(self.independent, self.components, EVIDENT)
        if low <= self.mean <= high:
            return ()
        size = "small" if self.mean > high else "large"
        caveat = "" if spread is None else "; smaller covariances cost less even if they are wrong"
        return (
            Notice(
                code=self.verdict,
                text=f"covariances are too {size} for the errors: NEES {self.in_words}",
                remedy=f"compare NEES in addition to the value{caveat}",
            ),
        )


def fits_sums(record: Json) -> bool:
    """Check that the numbers of a record of `NeesSums.record` follow from its sums."""
    sums = NeesSums(**record["sums"])
    try:
        own = sums.record()
        shape = np.shape(sums.ranks)
    except (ArithmeticError, ValueError):  # ValueError: ranks of several lengths
        return False
    return shape in ((0,), (sums.components, BINS)) and all(
        record[name] == own[name] for name in ("mean", "anees", "inside")
    )


def nees_sums(
    pairs: AssignedPairs, nees: Floats, components: int, ranks: Floats | None = None
) -> NeesSums:
    """Sum over N assigned pairs; `nees` (N,) is NaN if a covariance is singular or missing."""
    known = ~np.isnan(nees)
    weight, values = pairs.weight[known], nees[known]
    order = np.lexsort((pairs.step[known], pairs.estimate[known], pairs.truth[known]))
    step, truth, estimate = (
        column[known][order] for column in (pairs.step, pairs.truth, pairs.estimate)
    )
    next_to = (np.diff(step) == 1) & (np.diff(truth) == 0) & (np.diff(estimate) == 0)
    first, second = values[order][:-1][next_to], values[order][1:][next_to]
    return NeesSums(
        components=components,
        pairs=float(weight.sum()),
        singular=float(pairs.weight[~known].sum()),
        total=float(weight @ values),
        squares=float(weight @ values**2),
        inside=float(weight @ (values <= chi_square(INSIDE, components))),
        neighbours=float(len(first)),
        products=float(first @ second),
        ends=float(first.sum() + second.sum()),
        ranks=() if ranks is None else tuple(map(tuple, ranks.tolist())),
    )


def mean_nees(index: Ints, weight: Floats, nees: Floats, components: int, size: int) -> Columns:
    """Return the mean NEES and its band for each group of assigned pairs.

    `index` has the group of each pair, from 0 to `size` - 1. The numbers of a group without a pair
    are None. The band assumes that errors in a group are independent, such as those of different
    tracks at one step.
    """
    known = ~np.isnan(nees)
    count = sum_by(index[known], weight[known], size)
    total = sum_by(index[known], (weight * nees)[known], size)
    means = mean_columns(count, total, components)
    return {name: or_none(column) for name, column in means.items()}


def mean_columns(count: Floats, total: Floats, components: int) -> Arrays:
    """Return the mean NEES and its band for each group of pairs; NaN for a group without a pair.

    `count` has the number of pairs of each group, and `total` the sum of their NEES.
    """
    columns, some = np.full((3, len(count)), np.nan), count > 0
    columns[:, some] = total[some] / count[some], *band(count[some], components)
    return dict(zip((NEES, f"{NEES}_lower", f"{NEES}_upper"), columns, strict=True))


def or_none(values: Floats) -> list[float | None]:
    """Return an array as a list of numbers, with None in place of NaN."""
    return [None if value != value else value for value in values.tolist()]
