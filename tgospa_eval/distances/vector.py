"""Norms of the difference of two points."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Norm:
    """The Minkowski norm of the difference: a metric on points, whatever the order p of TGOSPA.

    Parameters
    ----------
    name : str
        As on the command line.
    power : {1.0, 2.0, inf}
        Manhattan, Euclidean, Chebyshev.
    """

    name: str
    power: float

    def __call__(self, a: Floats, b: Floats) -> Floats:
        """Distance along the last axis of `a` and `b`, which broadcast, without overflow."""
        return self.length(np.moveaxis(np.abs(a - b), -1, 0))

    def length(self, sizes: Iterable[Floats]) -> Floats:
        """Length of the vectors whose components have these absolute values, axis by axis."""
        if self.power == 1.0:
            return reduce(np.add, sizes)
        if self.power == np.inf:
            return reduce(np.maximum, sizes)
        return reduce(np.hypot, sizes)
