"""Disjoint pairs of truths and estimates at some steps: compiled loops, and the same in NumPy."""

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import places_of
from tgospa_eval.problem.compiled import kernels
from tgospa_eval.problem.problem import Floats
from tgospa_eval.tracks.trajectories import Ints

Objects = tuple[Ints, Ints]
"""Step of each truth and of each estimate, in order, int32."""

Rows = tuple[Ints, Ints]
"""Truth and estimate of each pair (N,), in order, int32."""

Flags = NDArray[np.bool_]


def largest_gains(objects: Objects, rows: Rows, gain: Floats, steps: int) -> Floats:
    """As if each truth, or each estimate, had its largest gain: the less of both (T,)."""
    if kernels is not None:
        found: Floats = kernels.largest_gains(*objects, *rows, gain, steps)
        return found
    sums = []
    for step, numbers in zip(objects, rows, strict=True):
        best = np.zeros(len(step))
        np.maximum.at(best, numbers, gain)
        sums.append(np.bincount(step, best, minlength=steps))
    return np.minimum(*sums)


def pair_off(objects: Objects, rows: Rows, gain: Floats, steps: int) -> tuple[Floats, Ints]:
    """Disjoint pairs, always the largest that is left: round by round the best of both.

    Of equal ones it is the first.

    Returns
    -------
    gain : (T,) float array
        That of the pairs which are chosen.
    turn : (N,) int32 array
        Round in which each pair is chosen, from 1 on; 0 of others.
    """
    if kernels is not None:
        found: tuple[Floats, Ints]
        found = kernels.pair_off(objects[0], len(objects[1]), *rows, gain, steps)
        return found
    left = np.argsort(-gain, kind="stable")
    turn = np.zeros(len(left), np.int32)
    first = [np.empty(len(step), np.int64) for step in objects]
    is_taken = [np.zeros(len(step), bool) for step in objects]
    while len(left):
        place = np.arange(len(left))
        is_best = np.ones(len(left), bool)
        of = [numbers[left] for numbers in rows]
        for mine, numbers in zip(first, of, strict=True):
            mine[numbers[::-1]] = place[::-1]  # what is written last stays
            is_best &= mine[numbers] == place
        turn[left[is_best]] = turn.max() + 1
        for flags, numbers in zip(is_taken, of, strict=True):
            flags[numbers[is_best]] = True
        left = left[~(is_taken[0][of[0]] | is_taken[1][of[1]])]
    taken = ranked(turn, gain)
    step = objects[0][rows[0][taken]]
    total = np.bincount(step, gain[taken], minlength=steps)  # integers where there is none
    return np.asarray(total, np.float64), turn


def ranked(turn: Ints, gain: Floats) -> Ints:
    """The pairs that are chosen, round by round, and in each by falling gain."""
    taken = places_of(turn)
    return taken[np.lexsort((-gain[taken], turn[taken]))]
