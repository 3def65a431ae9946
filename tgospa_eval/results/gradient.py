"""Derivatives of the cost of a result by the estimate and by the parameters."""

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
        Derivative of ``total`` by each state of the estimate as it is evaluated, which is after
        scales, conversions and interpolation, in cost per unit of the column. Rows are in order of
        step and track. Clouds are moved as a whole.
    particles : (P, d) float array, optional
        Derivative by each particle of clouds, state by state, in the order of the file. Weights are
        kept fixed.
    first_particle : (R + 1,) int array, optional
        Index of the first particle of each state.
    cutoff, switch_penalty : float
        Derivative of ``total`` by the parameters. For gamma = 0 and p = 1 it is not a number,
        because any number of switches is best.
    root : float
        Derivative of ``tgospa`` by ``total``, ``tgospa / (p total)``; 0 where the total is 0.
    shown_unique : callable
        Callable that returns whether the best assignment is shown to be the only one.
    step, track : (R,) int arrays
        Step and track of each state.
    columns : tuple of str
        Names of the d state columns.
    labels : Labels
        Times and ids.
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

        If so, the derivatives are those of the metric, except at kinks of the base distance. False
        means that uniqueness is not shown. It is computed on access.
        """
        return self.shown_unique()

    @property
    def tgospa(self) -> Floats:
        """Derivative of ``tgospa`` by each state of the estimate, (R, d)."""
        return self.root * self.total

    @property
    def array(self) -> Floats:
        """Derivative of ``total`` as an array of states, (T, k, d), 0 without a state."""
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
