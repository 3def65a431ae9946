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
    """Return the numbers begin[i], begin[i] + 1, ... of each range, as many as its count."""
    end = count.cumsum()
    numbers: Ints = (begin - end + count).repeat(count)
    numbers += np.arange(len(numbers))
    return numbers


def stretches(count: Ints, size: int) -> Ints:
    """Return where to cut items of so many things into stretches of about `size`, and the end."""
    before = np.cumsum(count) - count
    begins: Ints = np.append(np.flatnonzero(np.diff(before // size, prepend=-1)), len(count))
    return begins


def in_batches(items: Iterable[T], size: Callable[[T], int], batch_size: int) -> Iterator[list[T]]:
    """Yield the items in lists of at least `batch_size` together, except for the last.

    It is one list, emptied before more is put in: no two batches are in memory together.
    """
    batch: list[T] = []
    total = 0
    for item in items:
        batch.append(item)
        total += size(item)
        if total >= batch_size:
            yield batch
            batch.clear()
            total = 0
    if batch:
        yield batch


def places_of(flags: NDArray[np.generic]) -> NDArray[np.intp]:
    """Return `np.flatnonzero` of an array of one axis; one call is fast for small ones."""
    return flags.nonzero()[0]


def index_type(size: int) -> type[np.integer]:
    """Return the type of positions among so many: 32 bits if that is enough."""
    return np.int32 if size < 2**31 else np.int64


def median(values: NDArray[np.number]) -> float:
    """Return the median without np.median, which imports numpy.ma, slower than all else."""
    ordered = np.sort(values)
    return float(0.5 * ordered[(len(ordered) - 1) // 2] + 0.5 * ordered[len(ordered) // 2])


def freeze(record: object) -> None:
    """Put views that cannot be written to in the place of the arrays of a new frozen record."""
    for name, value in list(vars(record).items()):
        if isinstance(value, np.ndarray):
            frozen = value.view()
            frozen.setflags(write=False)
            object.__setattr__(record, name, frozen)
