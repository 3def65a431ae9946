"""Weights of states as integers: what makes them feasible, and where they change."""

import itertools
from collections.abc import Iterator

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.problem.problem import Objects
from tgospa_eval.problem.slots import PART, Slots, changed
from tgospa_eval.problem.states import States

ONE = 2**16 * 3**6 * 5**3 * 7**2 * 11 * 13 * 17
"""The integer that stands for the weight 1: multiples of 1/2 to 1/18 are exact. Near 2^50, so that
sums of some thousand weights fit, and doubles hold each (docs/theory/certificate.md, "Repair")."""

STATES_A_STEP = 32
"""States of a part for each step that it lasts: fewer cost no more than the call of a function."""

SNAP_WHOLE = ONE * 1e-9
"""Weights this near to 0 or 1 are meant to be 0 or 1."""


def repair(states: States, weights: Floats) -> Ints:
    """A feasible assignment nearby: clipped, snapped to 0 and 1, scaled where too full."""
    whole = np.empty(len(weights), np.int64)
    whole_weights(weights, whole)
    make_feasible(states, whole)
    return whole


def whole_weights(weights: Floats, whole: Ints) -> None:
    """The weights in units of 1/ONE, clipped and snapped; both may be the same memory."""
    fixed = np.fmin(np.fmax(weights, 0.0), 1.0)  # NaN becomes 0
    fixed *= ONE
    fixed[fixed < SNAP_WHOLE] = 0
    fixed[fixed > ONE - SNAP_WHOLE] = ONE
    whole[:] = np.rint(fixed)


def make_feasible(states: States, weights: Ints) -> Ints:
    """Scale the weights where a slot is too full, in place; their sums over the column slots."""
    for part, own in row_parts(states):
        _fit(part.rows, weights[own])
    return _fit(states.columns, weights)


def _fit(slots: Slots, weights: Ints) -> Ints:
    """Scale the states of every slot whose sum exceeds ONE by that sum, in place; the new sums."""
    sums = slots.sums(weights)
    while sums.max(initial=0) > ONE:
        _scale(slots, weights, sums)
        sums = slots.sums(weights)
    return sums


def _scale(slots: Slots, weights: Ints, sums: Ints) -> None:
    full = np.zeros(len(sums) + 1, np.int32)  # how many slots before each are too full
    np.cumsum(sums > ONE, out=full[1:])
    sums = np.append(sums, 0)
    begin, end = slots.begin, slots.end
    over = np.flatnonzero((full[end] > full[begin]) & (weights > 0))
    over = over[np.argsort(begin[over], kind="stable")]
    bounds = np.stack((begin[over], end[over]), axis=1).ravel()
    fullest = np.maximum.reduceat(sums, bounds)[::2]
    # Rounded down by more than the product can be rounded up.
    factor = ONE / fullest * (1 - 2.0**-48)
    weights[over] = np.floor(weights[over] * factor)


def row_parts(states: States) -> Iterator[tuple[States, slice | Ints]]:
    """The states in parts of whole rows, about PART states each, and where they are.

    Rows do not depend on each other once prices are given. Nodes and column slots keep their
    numbers. A pass over a part takes a turn for each step: parts of long recordings are larger.
    """
    size = max(PART, STATES_A_STEP * int((states.block_end - states.block_begin).max(initial=0)))
    if 0 < len(states.begin) <= size:
        yield states, slice(None)
        return
    opens = np.flatnonzero(np.diff(states.pair_row, prepend=-1))  # first pair of each row
    part = states.pair_first[opens] // size
    bounds = [*opens[np.diff(part, prepend=-1) > 0].tolist(), len(states.pair_row)]
    yield from map(states.of_pairs, itertools.starmap(slice, itertools.pairwise(bounds)))


def assigned(states: States, weights: Ints) -> tuple[Ints, Ints, Ints]:
    """States with a near pair that is assigned, their entries, and how much of each."""
    used = np.flatnonzero((states.entry >= 0) & (weights > 0))
    return used, states.entry[used], weights[used]


def changes(states: States, weights: Ints) -> tuple[Ints, Floats]:
    """States whose weight differs from that of the state before, and by how much, as a fraction."""
    moved = np.flatnonzero(changed(states.pair_first, weights))
    return moved, np.abs(weights[moved] - weights[moved - 1]) / ONE


def spare(side: Objects, entry: Ints, weight: Ints) -> Ints:
    """What weights of entries leave of each row of a side, (R,), in units of 1/ONE.

    0 of rows that are not judged.
    """
    free = np.full(len(side.step), ONE)
    np.subtract.at(free, side.row[entry], weight)
    if side.unjudged is not None:
        free[side.unjudged] = 0
    return free
