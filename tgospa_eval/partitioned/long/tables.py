"""What passes between the tasks of a long component: tables in the parts that other tasks read."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import SolverError
from tgospa_eval.partitioned.shards import ENTRY, Table, load_part
from tgospa_eval.problem.weights import ONE


def expansion(terms: list[float]) -> Floats:
    """Three numbers whose exact sum is at most that of the terms, and as near as doubles tell."""
    parts: list[float] = []
    for _ in range(2):
        parts.append(math.fsum((*terms, *(-part for part in parts))))
    rest = math.fsum((*terms, *(-part for part in parts)))
    return np.array([*parts, math.nextafter(rest, -math.inf)])


GAIN = np.dtype([*ENTRY.descr, ("weight", "<i8")])
"""A near pair and how much of it is assigned, in units of `weights.ONE`."""

PRICE_AT = np.dtype([("estimate", "<i4"), ("step", "<i4"), ("price", "<f8")])
"""A price of an estimate at a step."""

BUSY = np.dtype([("estimate", "<i4"), ("begin", "<i4"), ("end", "<i4")])
"""From when to when an estimate is assigned where it gains, both steps included."""

HALF_BITS = 25
"""Bits of the lower half of a weight: sums of as many as there can be of either are no overflow."""


@dataclass(frozen=True, kw_only=True)
class WindowPiece:
    """Steps of which one window has the answer.

    Parameters
    ----------
    folder : str
        Of the window.
    low, high : int
        The steps from `low` to before `high`.
    """

    folder: str
    low: int
    high: int

    def inside(self, begin: Ints, end: Ints) -> Mask:
        """Whether stretches of steps have one in common with it."""
        return (begin < self.high) & (end >= self.low)


def load_pieces(
    pieces: Iterable[WindowPiece], name: str, part: int | None, dtype: np.dtype[np.void]
) -> Table:
    """One part of a table, or all, of the steps of some pieces; stretches are cut to them."""
    begin, end = ("begin", "end") if "begin" in (dtype.names or ()) else ("step", "step")
    found = [np.zeros(0, dtype)]
    for piece in pieces:
        table = load_part(Path(piece.folder), name, part)
        inside = piece.inside(table[begin], table[end])
        if not inside.all():
            table = table[inside]
        if begin != end:
            np.maximum(table[begin], piece.low, out=table[begin])
            np.minimum(table[end], piece.high - 1, out=table[end])
        found.append(table)
    return np.concatenate(found)


def renumbered(table: Table, numbers: tuple[Ints, Ints], first: int = 0) -> Table:
    """With the places of its tracks among sorted numbers, and steps that are counted from `first`.

    What is of other tracks is left out.
    """
    names = table.dtype.names or ()
    for name, known in zip(("truth", "estimate"), numbers, strict=True):
        if name in names:
            at = np.minimum(np.searchsorted(known, table[name]), len(known) - 1)
            there = known[at] == table[name]
            table = table[there]
            table[name] = at[there]
    for name in {"step", "begin", "end"}.intersection(names):
        table[name] -= first
    return table


def no_assignment() -> SolverError:
    """What is to be proven is no assignment, which only a fault of this program can bring about."""
    return SolverError(
        "an assignment to prove is none: please report this as a bug, with the two files"
    )


def halves(weight: Ints, index: Ints, size: int) -> Ints:
    """Sums of the weights that share an index, in two halves, (2, size)."""
    sums = np.zeros((2, size), np.int64)
    np.add.at(sums[0], index, weight & ((1 << HALF_BITS) - 1))
    np.add.at(sums[1], index, weight >> HALF_BITS)
    return sums


def fraction(sums: Ints) -> Floats:
    """What `halves` sums up, in units of 1, rounded twice."""
    low, high = sums
    value: Floats = (high * 2.0**HALF_BITS + low) / ONE
    return value
