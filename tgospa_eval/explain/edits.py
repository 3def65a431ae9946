"""What a repair does to the rows of an estimate. Knows no metric."""

from collections.abc import Mapping
from dataclasses import field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.problem import Objects
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.warm_start import SavedSolution, save_solution
from tgospa_eval.tracks.conversion import iso
from tgospa_eval.tracks.coverage import AWAY, NOT_JUDGED, marks_of
from tgospa_eval.tracks.trajectories import Attributes, TimeArray, Trajectories, chosen, stacked
from tgospa_eval.tracks.weights import existence_of

NO_PARTNER = -1
"""The partner of what is assigned to nothing."""


@dataclass(frozen=True, kw_only=True)
class AssignedStretch:
    """A truth is assigned to an estimate from one step to another, inclusive.

    Where either does not exist the assignment is held, as in the programme.
    """

    truth: int
    estimate: int
    begin: int
    end: int


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
    prices : (K,) float array
        Of its column slots.

    Attributes
    ----------
    truth, estimate : Track
        Rows of both sides.
    followed, follows : (R,) int arrays
        Of each truth row the track of the estimate with most of its weight, and the other way.
    cost : (R,) float array
        Of each estimate row that follows a truth, what the pair costs.
    held : SavedSolution
        What is assigned from when to when, and what is priced.
    """

    def __init__(self, states: States, weights: Ints, prices: Floats) -> None:
        self.states, self.weights = states, weights
        self.held = save_solution(states, weights, prices)
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
    def stretches(self) -> list[AssignedStretch]:
        """Those that are assigned by more than half, by truth and time."""
        held = self.held
        most = np.flatnonzero(held.weight > 0.5)
        most = most[np.lexsort((held.begin[most], held.truth[most]))]
        found: list[AssignedStretch] = []
        for truth, estimate, begin, end in zip(
            *(part[most].tolist() for part in (held.truth, held.estimate, held.begin, held.end)),
            strict=True,
        ):
            before = found[-1] if found else None
            if before and (before.truth, before.estimate) == (truth, estimate):
                found[-1] = AssignedStretch(
                    truth=truth, estimate=estimate, begin=before.begin, end=end
                )
            else:
                found.append(AssignedStretch(truth=truth, estimate=estimate, begin=begin, end=end))
        return found


TrackPiece: TypeAlias = tuple[int, int, int]
"""The rows of a track from one step to another, inclusive, and the track that they become of."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AddedRows:
    """Rows to add.

    Parameters
    ----------
    step, track : (N,) int arrays
        Where; of one track in the order of time.
    state : (N, d) float array
        States.
    covariance : (N, d (d + 1) / 2) float array, optional
        Lower triangles, where the other rows have them.
    attributes : mapping of str to (N,) array, optional
        Those that the other rows have; missing values if it lacks one.
    """

    step: Ints
    track: Ints
    state: Floats
    covariance: Floats | None = None
    attributes: Attributes = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Edit:
    """What changes; steps and tracks are those of the estimate on the grid.

    Parameters
    ----------
    pieces : mapping of int to sequence of TrackPiece
        Of each track that changes what becomes of its rows; those in no piece are dropped.
    fresh : tuple of str
        Ids of tracks that there were not; they are numbered after the others.
    added : AddedRows, optional
        Rows to add.
    shift : int
        Steps by which every row is moved.
    offset : (d,) float array, optional
        What is taken from every state.
    """

    pieces: Mapping[int, tuple[TrackPiece, ...]] = field(default_factory=dict)
    fresh: tuple[str, ...] = ()
    added: AddedRows | None = None
    shift: int = 0
    offset: Floats | None = None

    @property
    def local(self) -> bool:
        """Whether it leaves most tracks as they are."""
        return not self.shift and self.offset is None

    def tracks(self, track: Ints, step: Ints) -> Ints:
        """The tracks of rows afterwards, -1 for those that are dropped."""
        found = track.astype(np.int64)
        for own, pieces in self.pieces.items():
            rows = np.flatnonzero(track == own)
            at, became = step[rows], np.full(len(rows), -1)
            for begin, end, to in pieces:
                became[(begin <= at) & (at <= end)] = to
            found[rows] = became
        return found


def renamed(held: SavedSolution, edit: Edit) -> tuple[Ints, Ints, Ints, Ints]:
    """What becomes of the runs: which each was, its estimate afterwards, begin and end."""
    still = np.flatnonzero(~np.isin(held.estimate, list(edit.pieces)))
    found = [(still, held.estimate[still], held.begin[still], held.end[still])]
    for track, pieces in edit.pieces.items():
        own = np.flatnonzero(held.estimate == track)
        for first, last, to in pieces:
            begin, end = np.maximum(held.begin[own], first), np.minimum(held.end[own], last)
            some = np.flatnonzero(begin <= end)
            found.append((own[some], np.full(len(some), to), begin[some], end[some]))
    which, estimate, begin, end = (np.concatenate(part) for part in zip(*found, strict=True))
    return which, estimate, begin, end


def as_read(estimate: Trajectories) -> Trajectories:
    """The estimate with what files say of it, without marks that options made."""
    made = NOT_JUDGED, AWAY
    kept = {name: values for name, values in estimate.attributes.items() if name not in made}
    return replace(estimate, attributes=kept)


def is_same(first: Trajectories, second: Trajectories) -> bool:
    """Whether all that changes a number is the same of two sides on the same grid."""

    def arrays(side: Trajectories) -> tuple[NDArray[Any], ...]:
        around = [] if side.covariance is None else [side.covariance]
        if side.clouds is not None:
            around += [side.clouds.points, side.clouds.weights]
        marks = marks_of(side, NOT_JUDGED), existence_of(side)
        return (side.times, side.step, side.ids[side.track], side.state, *marks, *around)

    one, other = arrays(first), arrays(second)
    return len(one) == len(other) and all(map(np.array_equal, one, other))


def edited(estimate: Trajectories, edit: Edit) -> Trajectories:
    """The estimate after an edit: rows of the grid, and the stamps at which it has some."""
    track = edit.tracks(estimate.track, estimate.step)
    kept = np.flatnonzero(track >= 0)
    track, step = track[kept], estimate.step[kept].astype(np.int64)
    state = estimate.state[kept]
    covariance = None if estimate.covariance is None else estimate.covariance[kept]
    attributes = chosen(estimate.attributes, kept)
    added = edit.added
    if added is not None:
        track = np.concatenate((track, added.track))
        step = np.concatenate((step, added.step))
        state = np.concatenate((state, added.state))
        if covariance is not None and added.covariance is not None:
            covariance = np.concatenate((covariance, added.covariance))
        attributes = stacked(attributes, added.attributes, len(added.step))
    order = np.lexsort((track, step))
    clouds = estimate.clouds  # of which no row is ever added
    if edit.offset is not None:
        state = state - edit.offset
        if clouds is not None:
            clouds = clouds.moved(clouds.points - edit.offset)
            state = clouds.means
    times, labels = _moved_on(estimate, edit.shift)
    # A shift to the past puts stamps before the others, and those keep their numbers.
    step = step[order] + max(edit.shift, 0)
    gone = np.bincount(step, minlength=len(times)) == 0
    step, times = (np.cumsum(~gone) - 1)[step], times[~gone]
    return Trajectories(
        step=step,
        track=track[order],
        state=state[order],
        ids=np.array([*estimate.ids.tolist(), *edit.fresh], dtype=object),
        times=times,
        columns=estimate.columns,
        clock=estimate.clock,
        labels=None if labels is None else labels[~gone],
        covariance=None if covariance is None else covariance[order],
        clouds=None if clouds is None else clouds.chosen(kept[order]),
        attributes=chosen(attributes, order),
    )


def _moved_on(estimate: Trajectories, shift: int) -> tuple[TimeArray, NDArray[np.object_] | None]:
    """The stamps that a shift needs, and as they are written: they go on by the median step."""
    times, labels = estimate.times, estimate.labels
    if not shift:
        return times, labels
    apart = np.sort(np.diff(times))
    median = apart[len(apart) // 2].item() if len(apart) else 1
    more = np.arange(1, abs(shift) + 1) * median
    fresh = (times[-1] + more if shift > 0 else times[0] - more[::-1]).astype(times.dtype)
    if labels is not None:
        texts = np.array([iso(stamp, estimate.clock) for stamp in fresh.tolist()], dtype=object)
        labels = np.concatenate((labels, texts) if shift > 0 else (texts, labels))
    return np.concatenate((times, fresh) if shift > 0 else (fresh, times)), labels


def split(track: int, step: int, steps: int, tracks: int, name: str) -> Edit:
    """What a track has from a step on as a track of its own, with a new name."""
    return Edit(pieces={track: ((0, step - 1, track), (step, steps - 1, tracks))}, fresh=(name,))


def exchange(first: int, second: int, step: int, steps: int) -> Edit:
    """The tracks of two names exchanged from a step on."""
    return Edit(
        pieces={
            a: ((0, step - 1, a), (step, steps - 1, b))
            for a, b in ((first, second), (second, first))
        }
    )
