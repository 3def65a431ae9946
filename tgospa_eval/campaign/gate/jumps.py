"""Jumps: scenes and runs far above the usual spread of their seeds, even with few seeds.

The exchange test assumes nothing, and so supports little with few runs: the smallest p value of
six runs is 1/64. A jump is recognised by its size, under an assumption. Costs are compared as
logarithms, and missed shares as arcsines of their roots. These are assumed to scatter from night to
night about like a normal distribution, alike in all runs of a scene and similarly in other scenes.
The variance of a scene is that of its own runs, moderated by other scenes (Smyth 2004): their
median variance counts as much as `PRIOR` values. The t quantile for the sum of both degrees of
freedom allows for heavier tails, and for scenes that scatter more than others. If the baseline has
several nights, a run can jump only if it is further off than any run of the baseline was from its
own other nights. tests/support/nights.py measures the error with simulated trackers.
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
"""Share of gates with a false jump, under the assumption. Simulated trackers whose scenes scatter
from 0.12 to 0.34 do not jump more often."""

OF_SCENES = 0.75
"""Share of `FALSE_ALARMS` for scenes. The rest is for runs: dead ones are found in another way."""

PRIOR = 10.0
"""Degrees of freedom of the scatter of other scenes, at most."""

MIN_SCATTER = 0.05
"""Smallest scatter of logarithms, so that not every change of repeatable runs is a jump."""

SMALLEST = 0.01
"""Share of the mean of a scene that is added to each value, since a value may be zero."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rises:
    """Rises of the runs of a scene above their limits, on a scale on which all scatter alike.

    Parameters
    ----------
    rises : array, shape (m,)
        Rise of each run.
    size : array, shape (m,)
        Variance of each rise, in units of the variance of one value.
    of_mean : float
        Variance of the mean of the rises, in the same unit.
    outside : bool array, shape (m,)
        Whether the run is above all runs of the baseline.
    squares, freedom : float
        Sum of squares of the baseline, and its degrees of freedom.
    min_scatter : float
        Smallest scatter that is assumed for a single value.
    ever : float
        The largest rise of a run of the baseline above its other nights, divided by the root of its
        size.
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
        """Return the rises of costs above the limits from each night of each run of the baseline.

        The result is None if all costs are zero.
        """
        everything = np.concatenate([now, *allowed])
        if not everything.any():
            return None
        floor = SMALLEST * float(everything.mean())
        nights = [np.log(night + floor) for night in allowed]
        return cls._of(np.log(now + floor), nights, paired, MIN_SCATTER)

    @classmethod
    def of_missed(cls, now: Floats, old: Sequence[Floats], states: float, *, paired: bool) -> Self:
        """Return the rises of missed shares; `states` is the mean number of ground-truth states."""
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
        # A night is n / (n - 1) times as far from the mean of the other nights as from that of all.
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
        """Return the sum of squares of the values of both sides, and its degrees of freedom."""
        squares = float(((self.rises - self.rises.mean()) ** 2 / self.size).sum())
        return self.squares + squares, self.freedom + len(self.rises) - 1

    def without(self, place: int) -> "Rises":
        """Return the rises without one run, so that the run does not hide in its own scatter."""
        kept = np.arange(len(self.rises)) != place
        return replace(self, rises=self.rises[kept], size=self.size[kept])


def jumps(scenes: Sequence[Rises | None]) -> list[tuple[float, Floats]]:
    """Return the p values of each scene and of each of its runs, adjusted for their numbers."""
    known = [one for one in scenes if one is not None]
    squares, freedom = np.array([one.scatter() for one in known]).reshape(-1, 2).T
    # The median of a chi-square variable is below its mean.
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
    """Return the one-sided p value by Student's t with the moderated variance; 1 without a rise."""
    from scipy.special import stdtr  # lazy: slow to import

    (squares, freedom), (prior, median) = scatter, beside
    if rise <= 0 or freedom + prior <= 0:
        return 1.0
    variance = max((squares + prior * median) / (freedom + prior), min_scatter**2)
    return float(stdtr(freedom + prior, -rise / np.sqrt(variance * size)))
