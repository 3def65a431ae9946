"""Derivatives of the cost of a result by the states of the estimate and by the parameters."""

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.results.records import Labels

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Gradient:
    """Derivatives at the reported assignment, which is kept fixed (envelope theorem).

    Parameters
    ----------
    total : (R, d) float array
        Derivative of ``total`` by each of the R states of the estimate, in cost per unit of the
        column. These are the states after scales, conversions and interpolation. Rows are in order
        of step and track. For a cloud, it is the derivative by a shift of all its particles.
    particles : (P, d) float array, optional
        For clouds, the derivative by each particle, state by state, in the order of the file.
        Weights are kept fixed.
    first_particle : (R + 1,) int array, optional
        Index of the first particle of each state.
    cutoff, switch_penalty : float
        Derivative of ``total`` by this parameter. At a switch penalty of 0 and order 1, switches
        are free and their number is not determined, so the derivative by the penalty is NaN.
    root : float
        Derivative of ``tgospa`` by ``total``, ``tgospa / (p total)``; 0 where the total is 0.
    shown_unique : callable
        Function that returns the value of `unique`.
    step, track : (R,) int arrays
        Index of the step and of the track of each state.
    columns : tuple of str
        Names of the d state columns.
    labels : Labels
        Times of the steps, and ids of objects and tracks.
    """

    total: Floats
    particles: Floats | None
    first_particle: Ints | None
    cutoff: float
    switch_penalty: float
    root: float
    shown_unique: Callable[[], bool]
    step: Ints
    track: Ints
    columns: tuple[str, ...]
    labels: Labels

    def __repr__(self) -> str:
        states, size = self.total.shape
        return f"Gradient({states} states of {size} columns)"

    @cached_property
    def unique(self) -> bool:
        """True if the prices show that the best assignment of near pairs is the only one.

        If true, the derivatives are those of the metric, except at kinks of the base distance. If
        false, nothing is proven. The value is computed at the first access.
        """
        return self.shown_unique()

    @property
    def tgospa(self) -> Floats:
        """Derivative of ``tgospa`` by each state of the estimate, (R, d)."""
        return self.root * self.total

    @property
    def array(self) -> Floats:
        """Derivative of ``total`` as an array (T, k, d) of T steps, k tracks; 0 without a state."""
        states = np.zeros((len(self.labels.times), len(self.labels.estimates), self.total.shape[1]))
        states[self.step, self.track] = self.total
        return states

    @cached_property
    def table(self) -> "pd.DataFrame":
        """Table of the derivative of ``total``: ``id``, ``t`` and a column for each state column.

        Each state has a row. If the states are clouds, each particle has a row instead.
        """
        import pandas as pd  # lazy: slow to import, and not needed for the computation

        row, values = np.arange(len(self.step)), self.total
        if self.particles is not None and self.first_particle is not None:
            row, values = np.repeat(row, np.diff(self.first_particle)), self.particles
        return pd.DataFrame(
            {
                "id": [self.labels.estimates[j] for j in self.track[row].tolist()],
                "t": [self.labels.times[k] for k in self.step[row].tolist()],
                **dict(zip(self.columns, values.T, strict=True)),
            }
        )
