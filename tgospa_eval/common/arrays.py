"""Helpers for arrays: ranges, batches, a median, records whose arrays cannot be written to."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
Floats = NDArray[np.float64]
Ints = NDArray[np.integer]
Mask = NDArray[np.bool_]


def concatenated(begin: Ints, count: Ints) -> Ints:
    """The numbers begin[i], begin[i] + 1, ... of each range, as many as its count."""
    end = count.cumsum()
    numbers: Ints = (begin - end + count).repeat(count)
    numbers += np.arange(len(numbers))
    return numbers


def stretches(count: Ints, most: int) -> Ints:
    """Where to cut a list of so many things each into stretches of about `most`, and its end."""
    before = np.cumsum(count) - count
    begins: Ints = np.append(np.flatnonzero(np.diff(before // most, prepend=-1)), len(count))
    return begins


def in_batches(items: Iterable[T], size: Callable[[T], int], most: int) -> Iterator[list[T]]:
    """The items in lists that each have at least `most` together, but for the last.

    It is one list, emptied before more is put in: no two batches are in memory together.
    """
    batch: list[T] = []
    total = 0
    for item in items:
        batch.append(item)
        total += size(item)
        if total >= most:
            yield batch
            batch.clear()
            total = 0
    if batch:
        yield batch


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
