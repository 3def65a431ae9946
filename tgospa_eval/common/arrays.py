"""Helpers for arrays: ranges, batches, a median, and records with read-only arrays."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
Floats = NDArray[np.float64]
Ints = NDArray[np.integer]
Mask = NDArray[np.bool_]


def concatenated(begin: Ints, count: Ints) -> Ints:
    """Return the joined ranges begin[i], begin[i] + 1, ... of count[i] integers, for each i."""
    end = count.cumsum()
    numbers: Ints = (begin - end + count).repeat(count)
    numbers += np.arange(len(numbers))
    return numbers


def stretches(count: Ints, size: int) -> Ints:
    """Split items into consecutive groups in which the sum of `count` is about `size`.

    The result has the index of the first item of each group, and at the end the number of items.
    """
    before = np.cumsum(count) - count
    begins: Ints = np.append(np.flatnonzero(np.diff(before // size, prepend=-1)), len(count))
    return begins


def in_batches(items: Iterable[T], size: Callable[[T], int], batch_size: int) -> Iterator[list[T]]:
    """Yield the items in lists with a total size of at least `batch_size`; the last can be smaller.

    To save memory, all batches are the same list object, which is emptied and filled again.
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
    """Return `np.flatnonzero` of an array with one axis, with less overhead for small arrays."""
    return flags.nonzero()[0]


def index_type(size: int) -> type[np.integer]:
    """Return the integer type for indices of an array of this size: 32 bits if they are enough."""
    return np.int32 if size < 2**31 else np.int64


def median(values: NDArray[np.number]) -> float:
    """Return the median. np.median is not used, because it imports numpy.ma, which is slow."""
    ordered = np.sort(values)
    return float(0.5 * ordered[(len(ordered) - 1) // 2] + 0.5 * ordered[len(ordered) // 2])


def freeze(record: object) -> None:
    """Replace the arrays of a new frozen record by read-only views."""
    for name, value in list(vars(record).items()):
        if isinstance(value, np.ndarray):
            frozen = value.view()
            frozen.setflags(write=False)
            object.__setattr__(record, name, frozen)
