"""Jumps: scenes and runs far above the usual spread of their seeds, found even with few seeds.

The permutation test of `groups` makes no assumption about scatter. With few runs, this test
therefore shows little: with six runs, its smallest p value is 1/64. A jump is recognised by its
size instead. Before sizes are compared, costs are replaced by their logarithms. The missed share of
a run is the share of the ground-truth states that it misses. Missed shares are replaced by the
arcsine of their square root. Three assumptions are needed:

- The transformed values scatter equally from night to night, in all runs of a scene.
- Their distribution is about normal.
- Their scatter is similar in all scenes.

The variance of a scene is estimated from its own runs, and moderated by the other scenes (Smyth
2004): the median of their variances counts as much as `PRIOR` values of the scene. The p value is
that of Student's t. Its degrees of freedom are those of the scene plus those of the other scenes,
which are at most `PRIOR`. Student's t allows for heavy tails, and for scenes that scatter more.

A *night* is an earlier evaluation whose values the baseline keeps. If the baseline has several
nights, the jump of a run must also be larger than all rises within the baseline. Such a rise is
that of one night above the other nights of the same run. tests/support/nights.py measures the error
with simulated trackers.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.results.consistency import chi_square

FALSE_ALARMS = 0.0015
"""Probability that one gate finds a false jump, under the assumptions of this module.

Simulated trackers did not exceed this probability. The scatter of their scenes is 0.12 to 0.34.
"""

OF_SCENES = 0.75
"""Share of `FALSE_ALARMS` for jumps of scenes; the rest is for jumps of single runs.

The share of runs is smaller, because dead runs are found separately.
"""

PRIOR = 10.0
"""Largest number of degrees of freedom of the other scenes in the variance of a scene."""

MIN_SCATTER = 0.05
"""Smallest standard deviation of logarithms that is assumed.

Without this minimum, a small change of a deterministic tracker would be a jump.
"""

SMALLEST = 0.01
"""Number that is added to each value before its logarithm is taken, because values can be 0.

The number is a share of the mean of the scene.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rises:
    """Rises of the new runs of a scene above their limits.

    A rise is a difference of logarithms (of costs) or of arcsines (of missed shares). Such
    differences scatter about equally in all runs of a scene.

    Parameters
    ----------
    rises : array, shape (m,)
        Rise of each of the m runs.
    size : array, shape (m,)
        Variance of each rise, in units of the variance of one value.
    of_mean : float
        Variance of the mean of the rises, in the same units.
    outside : bool array, shape (m,)
        Whether the run is above all runs and nights of the baseline.
    squares : float
        Sum of squared deviations in the baseline.
    freedom : float
        Degrees of freedom of `squares`.
    min_scatter : float
        Smallest standard deviation that is assumed for a single value.
    ever : float
        Largest rise of a night of the baseline above the other nights of the same run. The rise is
        divided by the root of its variance, in the units of `size`.
    """

    rises: Floats
    size: Floats
    of_mean: float
    outside: NDArray[np.bool_]
    squares: float
    freedom: float
    min_scatter: float
    ever: float

    @classmethod
    def of_costs(cls, now: Floats, allowed: Sequence[Floats], *, paired: bool) -> "Rises | None":
        """Return the rises of the costs of new runs above their limits; None if all costs are 0.

        `allowed` has the limits that follow from each run of the baseline, one for each night.
        """
        everything = np.concatenate([now, *allowed])
        if not everything.any():
            return None
        floor = SMALLEST * float(everything.mean())
        nights = [np.log(night + floor) for night in allowed]
        return cls._of(np.log(now + floor), nights, paired, MIN_SCATTER)

    @classmethod
    def of_missed(cls, now: Floats, old: Sequence[Floats], states: float, *, paired: bool) -> Self:
        """Return the rises of the missed shares of new runs above those of the baseline.

        `old` has the missed shares of each run of the baseline, by night. `states` is the mean
        number of ground-truth states of a run.
        """
        now, *nights = (np.arcsin(np.sqrt(np.clip(share, 0, 1))) for share in (now, *old))
        return cls._of(now, nights, paired, 0.5 / math.sqrt(states))

    @classmethod
    def _of(cls, now: Floats, nights: Sequence[Floats], paired: bool, min_scatter: float) -> Self:
        means = np.array([night.mean() for night in nights])
        if paired:
            squares = sum(float(((night - night.mean()) ** 2).sum()) for night in nights)
            freedom = sum(len(night) - 1 for night in nights)
            size = np.array([1 + 1 / len(night) for night in nights])
            of_mean = float(size.mean()) / len(now)
        else:
            squares, freedom = float(((means - means.mean()) ** 2).sum()), len(means) - 1
            means, size = np.full(len(now), means.mean()), np.full(len(now), 1 + 1 / len(means))
            of_mean = 1 / len(now) + size[0] - 1
        several = [(night, len(night)) for night in nights if len(night) > 1]
        # The rise above the mean of the other nights is n / (n - 1) times the rise above the mean
        # of all n nights. The variance of the former is also n / (n - 1), in units of the variance
        # of a value.
        above = (float((night.max() - night.mean()) * (n / (n - 1)) ** 0.5) for night, n in several)
        return cls(
            rises=now - means,
            size=size,
            of_mean=of_mean,
            outside=now > max(night.max() for night in nights),
            squares=squares,
            freedom=freedom,
            min_scatter=min_scatter,
            ever=max(above, default=0.0),
        )

    def scatter(self) -> tuple[float, float]:
        """Return the sum of squared deviations of old and new runs, and its degrees of freedom."""
        squares = float(((self.rises - self.rises.mean()) ** 2 / self.size).sum())
        return self.squares + squares, self.freedom + len(self.rises) - 1

    def without(self, place: int) -> "Rises":
        """Return the rises of all runs but one, for a scatter without the run that is tested."""
        kept = np.arange(len(self.rises)) != place
        return replace(self, rises=self.rises[kept], size=self.size[kept])


def jumps(scenes: Sequence[Rises | None]) -> list[tuple[float, Floats]]:
    """Return for each scene its p value and those of its runs.

    The p values are adjusted for the number of scenes and the number of runs.
    """
    known = [one for one in scenes if one is not None]
    squares, freedom = np.array([one.scatter() for one in known]).reshape(-1, 2).T
    # Only the median of these variances is used. Sums of squares are therefore divided by the
    # median of chi-square. The mean of chi-square, the degrees of freedom, would be too large.
    variances = np.divide(
        squares, chi_square(0.5, np.maximum(freedom, 1)), out=squares * np.nan, where=freedom > 0
    )
    runs, ever = sum(len(one.rises) for one in known), max((one.ever for one in known), default=0.0)
    p_values: list[tuple[float, Floats]] = []
    places = iter(range(len(known)))
    for one in scenes:
        if one is None:
            p_values.append((1.0, np.ones(0)))
            continue
        place = next(places)
        other_variances = np.delete(variances, place)
        prior = min(PRIOR, float(freedom.sum() - freedom[place]))
        beside = prior, float(np.nanmedian(other_variances)) if prior > 0 else 0.0
        scatter = squares[place], freedom[place]
        scene = _p_value(float(one.rises.mean()), one.of_mean, scatter, beside, one.min_scatter)
        each = np.ones(len(one.rises))
        outside = one.outside & (one.rises > ever * np.sqrt(one.size))
        for k in np.flatnonzero(outside) if len(each) > 1 else ():
            rest, size = one.without(int(k)).scatter(), float(one.size[k])
            each[k] = _p_value(float(one.rises[k]), size, rest, beside, one.min_scatter)
        count = len(known) / OF_SCENES, runs / (1 - OF_SCENES)
        p_values.append((min(count[0] * scene, 1.0), np.minimum(count[1] * each, 1.0)))
    return p_values


def _p_value(
    rise: float,
    size: float,
    scatter: tuple[float, float],
    beside: tuple[float, float],
    min_scatter: float,
) -> float:
    """Return the one-sided p value of a rise, by Student's t; 1 if the rise is not above 0.

    `size` is the variance of the rise, in units of the variance of one value. `scatter` has the sum
    of squares of the scene and its degrees of freedom. `beside` has the degrees of freedom and the
    median variance of the other scenes.
    """
    from scipy.special import stdtr  # lazy: slow to import

    (squares, freedom), (prior, median) = scatter, beside
    if rise <= 0 or freedom + prior <= 0:
        return 1.0
    variance = max((squares + prior * median) / (freedom + prior), min_scatter**2)
    return float(stdtr(freedom + prior, -rise / np.sqrt(variance * size)))
