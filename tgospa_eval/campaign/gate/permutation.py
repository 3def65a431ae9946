"""Whether runs with other seeds support that a sum has grown beyond a limit.

Runs are stratified: a stratum is one scene, and its runs differ in their seed alone. Under the
hypothesis that the tracker is just as the limit allows, old and new values of a seed can be
exchanged: the sign of their difference can be flipped (Fisher 1935, section 21). Where the seeds
are others than before, all runs of a stratum can be exchanged (Pitman 1937). The statistic is the
sum over all strata of what is above the limit, as a share of the mean of the stratum: noise grows
with the cost of a scene, and the dearest scene is not to drown the others. No exchange changes
these means.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass

DRAWS = 9999
"""Exchanges that are drawn, where all are not fewer."""

SEED = 1
"""The same runs have the same p value."""

AT_ONCE = 4_000_000
"""Numbers that are exchanged at once."""

TIE = 1e-12
"""Of the sum of all sizes: sums that differ by less are equal."""

POWER = 0.8
"""Probability with which the noticeable change is noticed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stratum:
    """Runs of one scene.

    Parameters
    ----------
    allowed : array, shape (n,)
        Of each run of the baseline the largest value that keeps the limit.
    now : array, shape (m,)
        Values of this run; paired with `allowed` if there are as many and `paired`.
    paired : bool
        Whether the runs have the same seeds, in this order.
    """

    allowed: Floats
    now: Floats
    paired: bool

    def relative(self) -> "Stratum":
        """The same in shares of the mean of all runs."""
        mean = float(np.concatenate([self.now, self.allowed]).mean()) or 1.0
        return replace(self, now=self.now / mean, allowed=self.allowed / mean)

    @property
    def excess(self) -> float:
        """What the sum of this run is above the limit."""
        return float(self.now.sum() - len(self.now) * self.allowed.mean())

    @property
    def exchanges(self) -> int:
        """How many exchanges there are."""
        if self.paired:
            return 1 << len(self.now)
        return math.comb(len(self.now) + len(self.allowed), len(self.now))

    @property
    def variance(self) -> float:
        """Estimated variance of the excess."""
        if self.paired:
            return len(self.now) * float(np.var(self.now - self.allowed, ddof=1))
        # Pooled: a side may be of one run.
        squares = sum(float(((side - side.mean()) ** 2).sum()) for side in (self.now, self.allowed))
        count = len(self.now)
        return squares / self.freedom * count * (1 + count / len(self.allowed))

    @property
    def freedom(self) -> int:
        """Degrees of freedom of `variance`."""
        return len(self.now) - 1 if self.paired else len(self.now) + len(self.allowed) - 2

    def all_exchanged(self) -> Floats:
        """The excess under every exchange, that of the data first."""
        if self.paired:
            signs = itertools.product((1.0, -1.0), repeat=len(self.now))
            return np.array(list(signs)) @ (self.now - self.allowed)
        every = np.concatenate([self.now, self.allowed])
        which = np.array(list(itertools.combinations(range(len(every)), len(self.now))))
        return self._excess_of(every[which].sum(axis=1), every)

    def exchanged(self, draws: int, rng: np.random.Generator) -> Floats:
        """The excess under so many random exchanges."""
        if self.paired:
            signs = rng.integers(0, 2, (draws, len(self.now))) * 2.0 - 1.0
            return signs @ (self.now - self.allowed)
        every = np.concatenate([self.now, self.allowed])
        mixed = rng.permuted(np.broadcast_to(every, (draws, len(every))), axis=1)
        return self._excess_of(mixed[:, : len(self.now)].sum(axis=1), every)

    def _excess_of(self, sums: Floats, every: Floats) -> Floats:
        """The excess where the runs of now have these sums."""
        rest = every.sum() - sums
        found: Floats = sums - rest * (len(self.now) / len(self.allowed))
        return found


def p_value(strata: Sequence[Stratum]) -> float:
    """One-sided p value that the sum is above its limit; exact where it can be.

    Parameters
    ----------
    strata : sequence of Stratum
        At least one; all together.
    """
    strata = [one.relative() for one in strata]
    observed = sum(one.excess for one in strata)
    size = sum(float(np.abs(one.now).sum() + np.abs(one.allowed).sum()) for one in strata)
    if math.prod(one.exchanges for one in strata) <= DRAWS:
        sums = np.zeros(1)
        for one in strata:
            sums = np.add.outer(sums, one.all_exchanged()).ravel()
        return float(np.mean(sums >= observed - TIE * size))
    rng, above = np.random.default_rng(SEED), 0
    portion = max(1, AT_ONCE // sum(len(one.now) + len(one.allowed) for one in strata))
    for done in range(0, DRAWS, portion):
        draws = min(portion, DRAWS - done)
        sums = np.sum([one.exchanged(draws, rng) for one in strata], axis=0)
        above += int(np.count_nonzero(sums >= observed - TIE * size))
    # The data as they are is one of the exchanges.
    return float((above + 1) / (DRAWS + 1))


def fewest(confidence: float, *, paired: bool = True) -> int:
    """Runs below which no test can support anything: exchanges are too few."""
    least = 1 / (1 - confidence) - 1e-9
    runs = 1
    while (1 << runs if paired else math.comb(2 * runs, runs)) < least:
        runs += 1
    return runs


def noticeable(strata: Sequence[Stratum], confidence: float, *, needed: int = 1) -> float:
    """Share by which all runs have to be above the limit to be noticed, about.

    With probability `POWER`, by Student's t with the scatter of these runs; where they are just as
    many as needed, each of them has to be above. Infinite for fewer, or without scatter.
    """
    strata = [one.relative() for one in strata]
    freedom = sum(one.freedom for one in strata if one.freedom > 0)
    size = sum(len(one.now) * float(one.allowed.mean()) for one in strata)
    runs = sum(len(one.now) for one in strata)
    if freedom == 0 or size <= 0 or runs < needed:
        return math.inf
    from scipy.special import ndtri, stdtrit  # here: slow to import

    deviation = math.sqrt(sum(one.variance for one in strata if one.freedom > 0))
    share = float(stdtrit(freedom, confidence) + stdtrit(freedom, POWER)) * deviation
    if runs == needed:
        share = max(share, float(ndtri(POWER ** (1 / runs))) * deviation * math.sqrt(runs))
    return share / size
