"""Who follows whom: the assignment of a result row by row, and as stretches of steps."""

from functools import cached_property

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.problem import Floats, Ints, Objects
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE

NO_PARTNER = -1
"""The partner of what is assigned to nothing."""


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """A truth is assigned to an estimate from one step to another, inclusive.

    Where either does not exist the assignment is held, as in the programme.
    """

    truth: int
    estimate: int
    begin: int
    end: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """Pairs over stretches of steps, with their weights, sorted by (truth, begin).

    Parameters
    ----------
    truth, estimate, begin, end : (N,) int arrays
        What is assigned from when to when; what is held at the begin or the end of what decides
        goes on to that of the recording.
    weight : (N,) float array
        How much, 0 to 1.
    """

    truth: Ints
    estimate: Ints
    begin: Ints
    end: Ints
    weight: Floats


class Track:
    """Rows of one side track by track, in the order of time."""

    def __init__(self, side: Objects, steps: int) -> None:
        self.side, self.steps = side, steps
        self.order = np.argsort(side.track, kind="stable")
        self.first = np.searchsorted(side.track[self.order], np.arange(side.count + 1))
        self._key = side.step.astype(np.int64) * side.count + side.track

    def rows(self, track: int) -> Ints:
        """Rows of a track."""
        return self.order[self.first[track] : self.first[track + 1]]

    def find(self, track: Ints, step: Ints) -> Ints:
        """The row of each track at each step, `NO_PARTNER` where it does not exist."""
        if not len(self._key):
            return np.full(len(track), NO_PARTNER)
        key = step.astype(np.int64) * self.side.count + track
        at = np.minimum(np.searchsorted(self._key, key), len(self._key) - 1)
        there = (self._key[at] == key) & (track >= 0) & (step >= 0) & (step < self.steps)
        return np.where(there, at, NO_PARTNER)


class Assigned:
    """The assignment of a solved problem.

    Parameters
    ----------
    states : States
        The problem.
    weights : (S,) int array
        A feasible assignment, in units of 1/ONE.

    Attributes
    ----------
    truth, estimate : Track
        Rows of both sides.
    followed, follows : (R,) int arrays
        Of each truth row the track of the estimate with most of its weight, and the other way.
    cost : (R,) float array
        Of each estimate row that follows a truth, what the pair costs.
    """

    def __init__(self, states: States, weights: Ints) -> None:
        self.states, self.weights = states, weights
        problem = self.problem = states.problem
        sides = problem.sides
        self.truth, self.estimate = (Track(side, problem.steps) for side in sides)
        used = np.flatnonzero((states.entry >= 0) & (weights > 0))
        used = used[np.argsort(weights[used], kind="stable")]  # the largest comes last and stays
        entry = states.entry[used].astype(np.int64)
        i, j = problem.truth_row[entry], problem.estimate_row[entry]
        self.followed = np.full(len(problem.truth_step), NO_PARTNER)
        self.follows = np.full(len(problem.estimate_step), NO_PARTNER)
        self.cost = np.zeros(len(problem.estimate_step))
        self.followed[i] = problem.estimate_track[j]
        self.follows[j] = problem.truth_track[i]
        self.cost[j] = problem.cost[entry]

    @cached_property
    def held(self) -> Held:
        """What is assigned, states of a pair that follow each other joined."""
        states = self.states
        used = np.flatnonzero(self.weights)
        pair = states.pair[used]
        block = states.pair_block[pair]
        begin, end = states.begin[used].astype(np.int64), states.end[used].astype(np.int64)
        begin = np.where(begin == states.block_begin[block], 0, begin)
        end = np.where(end == states.block_end[block], states.problem.steps - 1, end)
        weight = self.weights[used]
        opens = np.ones(len(used), bool)
        opens[1:] = (
            (pair[1:] != pair[:-1]) | (begin[1:] != end[:-1] + 1) | (weight[1:] != weight[:-1])
        )
        first = np.flatnonzero(opens)
        last = np.append(first[1:], len(used)) - 1 if len(used) else first
        truth, estimate = states.pair_truth[pair[first]], states.pair_estimate[pair[first]]
        order = np.lexsort((begin[first], truth))
        return Held(
            truth=truth[order].astype(np.int64),
            estimate=estimate[order].astype(np.int64),
            begin=begin[first][order],
            end=end[last][order],
            weight=weight[first][order] / ONE,
        )

    @cached_property
    def stretches(self) -> list[Stretch]:
        """Those that are assigned by more than half, by truth and time."""
        held = self.held
        most = np.flatnonzero(held.weight > 0.5)
        found: list[Stretch] = []
        for truth, estimate, begin, end in zip(
            *(part[most].tolist() for part in (held.truth, held.estimate, held.begin, held.end)),
            strict=True,
        ):
            before = found[-1] if found else None
            if before and (before.truth, before.estimate) == (truth, estimate):
                found[-1] = Stretch(truth=truth, estimate=estimate, begin=before.begin, end=end)
            else:
                found.append(Stretch(truth=truth, estimate=estimate, begin=begin, end=end))
        return found
