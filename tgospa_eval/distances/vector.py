"""Norms of the difference of two points."""

from dataclasses import dataclass

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
        size = np.abs(a - b)
        if self.power == 1.0:
            return np.asarray(size.sum(axis=-1))
        if self.power == np.inf or size.shape[-1] == 1:
            return np.asarray(size.max(axis=-1))
        distance = np.hypot(size[..., 0], size[..., 1])
        for axis in range(2, size.shape[-1]):
            distance = np.hypot(distance, size[..., axis])
        return np.asarray(distance)
