"""Ranges of whole numbers, one after the other."""

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.integer]


def concatenated(begin: Ints, count: Ints) -> Ints:
    """The numbers begin[i], begin[i] + 1, ... of each range, as many as its count."""
    first = np.cumsum(count) - count
    numbers: Ints = np.arange(int(count.sum())) + np.repeat(begin - first, count)
    return numbers
