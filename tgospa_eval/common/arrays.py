"""Helpers for arrays: ranges of numbers, a median, records whose arrays cannot be written to."""

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.integer]


def concatenated(begin: Ints, count: Ints) -> Ints:
    """The numbers begin[i], begin[i] + 1, ... of each range, as many as its count."""
    first = np.cumsum(count) - count
    numbers: Ints = np.arange(int(count.sum())) + np.repeat(begin - first, count)
    return numbers


def places_of(flags: NDArray[np.generic]) -> NDArray[np.intp]:
    """`np.flatnonzero` of an array of one axis, in a single call: in small ones the calls count."""
    return flags.nonzero()[0]


def index_type(size: int) -> type[np.integer]:
    """Of positions among so many: 32 bits where that is enough."""
    return np.int32 if size < 2**31 else np.int64


def median(values: NDArray[np.number]) -> float:
    """Without np.median, which imports numpy.ma, slower than all else."""
    ordered = np.sort(values)
    return float(0.5 * ordered[(len(ordered) - 1) // 2] + 0.5 * ordered[len(ordered) // 2])


def freeze(record: object) -> None:
    """Put views that cannot be written to in the place of the arrays of a new frozen record."""
    for name, value in list(vars(record).items()):
        if isinstance(value, np.ndarray):
            frozen = value.view()
            frozen.setflags(write=False)
            object.__setattr__(record, name, frozen)
