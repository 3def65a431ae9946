"""Repairs that may save cost, with estimated savings if the rest of the assignment stays.

Costs are in units of c^p. The estimates only decide which repairs are tried. `explain` then proves
the savings.
"""

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.evaluation.axis import periods_of
from tgospa_eval.evaluation.prepare import AlignedPair
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.problem import Objects, sum_by
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.warm_start import SavedSolution, save_solution
from tgospa_eval.tracks.conversion import iso
from tgospa_eval.tracks.coverage import AWAY, NOT_COUNTED, marks_of
from tgospa_eval.tracks.trajectories import Attributes, TimeArray, Trajectories, chosen, stacked
from tgospa_eval.tracks.weights import EXISTENCE, existence_of

# -------------------------------------------------------------------------------------------------
# Edits of the rows of an estimate, independent of the metric.

NO_PARTNER = -1
"""Partner of an unassigned row."""


class AssignedStretch(NamedTuple):
    """Assignment of a true object to an estimate from step `begin` to step `end`, inclusive.

    The assignment continues at steps at which one of the two is missing, as in the linear
    programme.
    """

    truth: int
    estimate: int
    begin: int
    end: int


class Track:
    """Rows of the truth or of the estimate, track by track in the order of time."""

    def __init__(self, side: Objects, steps: int) -> None:
        self.side, self.steps = side, steps
        self.order = np.argsort(side.track, kind="stable")
        self.first = np.searchsorted(side.track[self.order], np.arange(side.count + 1))
        self._key = side.step.astype(np.int64) * side.count + side.track

    def rows(self, track: int) -> Ints:
        """Return the rows of a track."""
        return self.order[self.first[track] : self.first[track + 1]]

    def find(self, track: Ints, step: Ints) -> Ints:
        """Return the row of each track at its step, `NO_PARTNER` if the track does not exist."""
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
        States of the problem.
    weights : (S,) int array
        A feasible assignment, in units of 1/ONE.
    prices : (K,) float array
        Prices of the column slots.

    Attributes
    ----------
    truth, estimate : Track
        Rows of both sides.
    followed, follows : (R,) int arrays
        Estimate with the largest weight for each truth row, and true object with the largest weight
        for each estimate row.
    cost : (R,) float array
        Cost of the pair of each estimate row that follows a true object.
    saved : SavedSolution
        Assignments over time, and prices.
    """

    def __init__(self, states: States, weights: Ints, prices: Floats) -> None:
        self.states, self.weights = states, weights
        self.saved = save_solution(states, weights, prices)
        problem = self.problem = states.problem
        sides = problem.sides
        self.truth, self.estimate = (Track(side, problem.steps) for side in sides)
        used = np.flatnonzero((states.entry >= 0) & (weights > 0))
        used = used[np.argsort(weights[used], kind="stable")]  # the largest comes last and is kept
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
        """Stretches with a weight above 0.5, in the order of true object and time."""
        kept = self.saved
        main = np.flatnonzero(kept.weight > 0.5)
        main = main[np.lexsort((kept.begin[main], kept.truth[main]))]
        parts: list[AssignedStretch] = []
        for truth, estimate, begin, end in zip(
            *(part[main].tolist() for part in (kept.truth, kept.estimate, kept.begin, kept.end)),
            strict=True,
        ):
            before = parts[-1] if parts else None
            if before and (before.truth, before.estimate) == (truth, estimate):
                parts[-1] = before._replace(end=end)
            else:
                parts.append(AssignedStretch(truth, estimate, begin, end))
        return parts


TrackPiece: TypeAlias = tuple[int, int, int]
"""First and last step (inclusive) of some rows of a track, and their track after the edit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AddedRows:
    """Rows to add.

    Parameters
    ----------
    step, track : (N,) int arrays
        Step and track of each row. Rows of one track are in the order of time.
    state : (N, d) float array
        State of each row.
    covariance : (N, d (d + 1) / 2) float array, optional
        Lower triangles of covariances, if the other rows have covariances.
    attributes : mapping of str to (N,) array, optional
        Attributes that the other rows have, too. An attribute that is not given has missing values.
    """

    step: Ints
    track: Ints
    state: Floats
    covariance: Floats | None = None
    attributes: Attributes = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Edit:
    """Change of an estimate; steps and tracks are those of the estimate on the grid.

    Parameters
    ----------
    pieces : mapping of int to sequence of TrackPiece
        Pieces of each track that changes. Rows outside all pieces are dropped.
    fresh : tuple of str
        Ids of new tracks, which are numbered after the existing tracks.
    added : AddedRows, optional
        Rows to add.
    shift : int
        Number of steps by which every row is moved.
    offset : (d,) float array, optional
        Offset that is subtracted from every state.
    """

    pieces: Mapping[int, tuple[TrackPiece, ...]] = field(default_factory=dict)
    fresh: tuple[str, ...] = ()
    added: AddedRows | None = None
    shift: int = 0
    offset: Floats | None = None

    @property
    def local(self) -> bool:
        """True if the edit leaves most tracks unchanged."""
        return not self.shift and self.offset is None

    def tracks(self, track: Ints, step: Ints) -> Ints:
        """Return the tracks of rows after the edit, -1 for dropped rows."""
        after = track.astype(np.int64)
        for own, pieces in self.pieces.items():
            rows = np.flatnonzero(track == own)
            at, became = step[rows], np.full(len(rows), -1)
            for begin, end, to in pieces:
                became[(begin <= at) & (at <= end)] = to
            after[rows] = became
        return after


def renamed(old: SavedSolution, edit: Edit) -> tuple[Ints, Ints, Ints, Ints]:
    """Return assigned stretches after an edit: old number, new estimate, begin and end."""
    still = np.flatnonzero(~np.isin(old.estimate, list(edit.pieces)))
    parts = [(still, old.estimate[still], old.begin[still], old.end[still])]
    for track, pieces in edit.pieces.items():
        own = np.flatnonzero(old.estimate == track)
        for first, last, to in pieces:
            begin, end = np.maximum(old.begin[own], first), np.minimum(old.end[own], last)
            some = np.flatnonzero(begin <= end)
            parts.append((own[some], np.full(len(some), to), begin[some], end[some]))
    which, estimate, begin, end = (np.concatenate(part) for part in zip(*parts, strict=True))
    return which, estimate, begin, end


def as_read(estimate: Trajectories) -> Trajectories:
    """Return the estimate as read from files, without marks made by options."""
    made = NOT_COUNTED, AWAY
    kept = {name: values for name, values in estimate.attributes.items() if name not in made}
    return replace(estimate, attributes=kept)


def is_same(first: Trajectories, second: Trajectories) -> bool:
    """Check that two sides on the same grid agree in all data that affect the metric."""

    def arrays(side: Trajectories) -> tuple[NDArray[Any], ...]:
        around = [] if side.covariance is None else [side.covariance]
        if side.clouds is not None:
            around += [side.clouds.points, side.clouds.weights]
        marks = marks_of(side, NOT_COUNTED), existence_of(side)
        return (side.times, side.step, side.ids[side.track], side.state, *marks, *around)

    one, other = arrays(first), arrays(second)
    return len(one) == len(other) and all(map(np.array_equal, one, other))


def edited(estimate: Trajectories, edit: Edit) -> Trajectories:
    """Return the estimate after an edit, with the timestamps of the grid at which it has rows."""
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
    clouds = estimate.clouds  # no rows are added to clouds
    if edit.offset is not None:
        state = state - edit.offset
        if clouds is not None:
            clouds = clouds.moved(clouds.points - edit.offset)
            state = clouds.means
    times, labels = _moved_on(estimate, edit.shift)
    # A shift to the past adds timestamps at the beginning, and rows keep their step numbers.
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
    """Return timestamps extended for a shift by the median time step, and their texts."""
    times, labels = estimate.times, estimate.labels
    if not shift:
        return times, labels
    spacing = np.sort(np.diff(times))
    median = spacing[len(spacing) // 2].item() if len(spacing) else 1
    more = np.arange(1, abs(shift) + 1) * median
    fresh = (times[-1] + more if shift > 0 else times[0] - more[::-1]).astype(times.dtype)
    if labels is not None:
        texts = np.array([iso(stamp, estimate.clock) for stamp in fresh.tolist()], dtype=object)
        labels = np.concatenate((labels, texts) if shift > 0 else (texts, labels))
    return np.concatenate((times, fresh) if shift > 0 else (fresh, times)), labels


def split(track: int, step: int, steps: int, tracks: int, name: str) -> Edit:
    """Return the edit that splits a track at a step; the rest becomes a track with a new name."""
    return Edit(pieces={track: ((0, step - 1, track), (step, steps - 1, tracks))}, fresh=(name,))


def exchange(first: int, second: int, step: int, steps: int) -> Edit:
    """Return the edit that exchanges two tracks from a step on."""
    return Edit(
        pieces={
            a: ((0, step - 1, a), (step, steps - 1, b))
            for a, b in ((first, second), (second, first))
        }
    )


HALVES = 2
"""Number of half switches in a switch from one estimate to another."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A repair that may be worth a trial.

    Parameters
    ----------
    kind : str
        Kind of the repair, one of `results.explanation.KINDS`.
    saving : float
        Estimated saving for the current assignment, in units of c^p.
    edit : Edit
        Edit of the estimate.
    tracks : tuple of int
        Numbers of the changed estimates; empty if all change.
    begin, end : int, optional
        First and last step of the repair.
    """

    kind: str
    saving: float
    edit: Edit
    tracks: tuple[int, ...] = ()
    begin: int | None = None
    end: int | None = None


def of_steps(
    kind: str, saving: float, edit: Edit, tracks: tuple[int, ...], steps: Ints
) -> Candidate:
    """Return a candidate for a track between the first and the last of these steps."""
    begin, end = int(steps[0]), int(steps[-1])
    return Candidate(kind=kind, saving=saving, edit=edit, tracks=tracks, begin=begin, end=end)


def exchanged(assigned: Assigned) -> Iterator[Candidate]:
    """Yield the exchange or merge of two estimates at each switch of a true object between them."""
    steps, prices = assigned.problem.steps, assigned.problem.switch_price_at
    by_truth: dict[int, list[AssignedStretch]] = defaultdict(list)
    truths: dict[int, set[int]] = defaultdict(set)
    for stretch in assigned.stretches:
        by_truth[stretch.truth].append(stretch)
        truths[stretch.estimate].add(stretch.truth)
    tried: set[tuple[int, ...]] = set()
    for own in by_truth.values():
        for before, after in pairwise(own):
            a, b = sorted((before.estimate, after.estimate))
            whole = _together(assigned, a, b) if (a, b) not in tried else None
            tried.add((a, b))
            beside = [by_truth[i] for i in sorted(truths[a] | truths[b])]
            if whole is not None:
                named = [[a if s.estimate == b else s.estimate for s in part] for part in beside]
                saved = sum(_changes([s.estimate for s in part]) for part in beside)
                saved -= sum(map(_changes, named))
                yield replace(whole, saving=HALVES * saved * float(prices[after.begin]))
            step = _first_row(assigned, a, b, after.begin)
            if whole is None and step is not None and (a, b, step) not in tried:
                tried.add((a, b, step))
                saved = sum(_exchange_saves(part, a, b, step) for part in beside)
                yield Candidate(
                    kind="exchange",
                    saving=HALVES * saved * float(prices[after.begin]),
                    edit=exchange(a, b, after.begin, steps),
                    tracks=_in_time(assigned, a, b, step),
                    begin=step,
                )


def _together(assigned: Assigned, a: int, b: int) -> Candidate | None:
    """Return the merge of two tracks; None if they have a step in common."""
    step = assigned.estimate.side.step
    first, second = (step[assigned.estimate.rows(track)] for track in (a, b))
    if np.isin(first, second).any():
        return None
    into, track = (a, b) if first[0] < second[0] else (b, a)
    edit = Edit(pieces=dict.fromkeys((a, b), ((0, assigned.problem.steps - 1, into),)))
    return of_steps("merge", 0.0, edit, (into, track), step[assigned.estimate.rows(track)])


def _first_row(assigned: Assigned, a: int, b: int, step: int) -> int | None:
    """Return the first step, not before `step`, at which one of two tracks exists."""
    steps = [assigned.estimate.side.step[assigned.estimate.rows(track)] for track in (a, b)]
    later = np.concatenate([own[own >= step] for own in steps])
    return int(later.min()) if len(later) else None


def _in_time(assigned: Assigned, a: int, b: int, step: int) -> tuple[int, int]:
    """Return two tracks in order: first the track that ends before the step, if one does."""
    last = int(assigned.estimate.side.step[assigned.estimate.rows(b)][-1])
    return (b, a) if last < step else (a, b)


def _changes(estimates: list[int]) -> int:
    return sum(one != other for one, other in pairwise(estimates))


def _exchange_saves(stretches: list[AssignedStretch], a: int, b: int, step: int) -> int:
    """Return the number of changes of a true object that an exchange from a step on saves."""
    before = bisect_left(stretches, step, key=lambda stretch: stretch.begin)
    after = bisect_left(stretches, step, key=lambda stretch: stretch.end)
    if not before or after == len(stretches):
        return 0
    one, other = stretches[before - 1].estimate, stretches[after].estimate
    named = {a: b, b: a}.get(other, other)
    return int(one != other) - int(one != named)


def split_up(assigned: Assigned, names: tuple[str, ...]) -> Iterator[Candidate]:
    """Yield the split of an estimate at each change of its true object; `names` are all ids."""
    steps, prices = assigned.problem.steps, assigned.problem.switch_price_at
    tracks, taken = assigned.problem.estimates, set(names)
    truths: dict[int, list[AssignedStretch]] = defaultdict(list)
    estimates: dict[int, list[AssignedStretch]] = defaultdict(list)
    for stretch in assigned.stretches:
        truths[stretch.truth].append(stretch)
        estimates[stretch.estimate].append(stretch)
    for track, own in estimates.items():
        own.sort(key=lambda stretch: stretch.begin)
        for before, after in pairwise(own):
            if before.truth == after.truth:
                continue
            halves = int(truths[before.truth][-1] is before) + int(truths[after.truth][0] is after)
            rows = assigned.estimate.side.step[assigned.estimate.rows(track)]
            step = int(rows[np.searchsorted(rows, after.begin)])
            yield Candidate(
                kind="split",
                saving=halves * float(prices[after.begin]),
                edit=split(track, after.begin, steps, tracks, _other_name(names[track], taken)),
                tracks=(track,),
                begin=step,
            )


def _other_name(name: str, names: set[str]) -> str:
    """Return this name with an unused number."""
    number = 2
    while f"{name}_{number}" in names:
        number += 1
    return f"{name}_{number}"


def of_rows(assigned: Assigned, limit: int) -> Iterator[Candidate]:
    """Yield tracks to drop, and unassigned ends of tracks to cut off."""
    problem, side = assigned.problem, assigned.estimate.side
    free = assigned.follows < 0
    partner = assigned.truth.find(assigned.follows, side.step)
    # A state that follows a true object saves the cost of a miss minus the cost of the pair.
    worth = -side.price
    worth[~free] = problem.truth_price[partner[~free]] - assigned.cost[~free]
    saved = -np.bincount(side.track, worth, minlength=side.count)
    for stretch in assigned.stretches:
        price = problem.switch_price_at
        saved[stretch.estimate] += float(price[stretch.begin]) if stretch.begin else 0.0
    saved[np.diff(assigned.estimate.first) == 0] = 0.0  # tracks without rows
    for track in np.argsort(-saved, kind="stable")[:limit].tolist():
        if saved[track] > 0:
            steps, edit = side.step[assigned.estimate.rows(track)], Edit(pieces={track: ()})
            yield of_steps("drop", float(saved[track]), edit, (track,), steps)
    for track in range(side.count):
        rows = assigned.estimate.rows(track)
        used = np.flatnonzero(~free[rows])
        if not len(used):
            continue
        for ends in (rows[: used[0]], rows[used[-1] + 1 :]):
            if len(ends):
                yield _without_rows(assigned, track, ends)


def _without_rows(assigned: Assigned, track: int, rows: Ints) -> Candidate:
    side = assigned.estimate.side
    begin, end = int(side.step[rows[0]]), int(side.step[rows[-1]])
    last = assigned.problem.steps - 1
    kept = (end + 1, last) if rows[0] == assigned.estimate.rows(track)[0] else (0, begin - 1)
    edit, saving = Edit(pieces={track: ((*kept, track),)}), float(side.price[rows].sum())
    return of_steps("trim", saving, edit, (track,), side.step[rows])


# -------------------------------------------------------------------------------------------------
# Repairs that add or move states: gaps filled, tracks extended, the whole estimate moved.
#
# Savings for the current assignment are measured by the base distance. For Gaussians and clouds, a
# distance between the means is used, which is not larger.

LONGEST_EXTENSION = 50
"""Largest number of steps of an extension."""

BEHIND = 5
"""Largest number of states for the velocity of an extension."""

SHIFTS = (1, 2, 3, 4, 5)
SAMPLED_PAIRS = 4000
"""Largest number of assigned pairs that are used to estimate the saving of a shift."""


class StatePlaces:
    """Places of all states, for estimates of the savings of repairs.

    Attributes
    ----------
    truth, estimate : Trajectories
        Both sides on the grid.
    timestamps : (T,) float array
        Timestamps of the grid, as numbers.
    distance : Distance
        Distance between states without covariances.
    parameters : Parameters
        Cutoff and order.
    period : (d,) float array
        Period of each column, infinite if it is not periodic.
    existence : (R,) float array, optional
        Existence probability of each estimate row, if these probabilities count.
    """

    def __init__(self, sides: AlignedPair, parameters: Parameters, *, probabilistic: bool) -> None:
        self.truth, self.estimate = sides.alignment.truth, sides.alignment.estimate
        self.timestamps = self.truth.times.astype(np.float64)
        self.distance, self.parameters = sides.distance.lower_bound, parameters
        periods = periods_of(sides.distance, columns := sides.read[0].columns)
        self.period = np.array([periods.get(column, np.inf) for column in columns])
        self.existence = existence_of(self.estimate) if probabilistic else None

    def costs(self, state: Floats, row: Ints) -> Floats:
        """Return ``(d / c)^p`` of states and truth rows (N,), infinite for negative rows."""
        there = row >= 0
        distance = self.distance(state[there], self.truth.state[row[there]])
        costs = np.full(len(row), np.inf)
        costs[there] = (distance / self.parameters.cutoff) ** self.parameters.order
        return costs

    def difference(self, first: Floats, second: Floats) -> Floats:
        """Return the difference of states, by the shorter way for periodic columns."""
        delta = second - first
        turns = np.rint(delta / self.period)
        return delta - np.where(turns == 0, 0.0, turns * np.where(turns == 0, 1.0, self.period))


def filled(assigned: Assigned, places: StatePlaces, limit: int) -> Iterator[Candidate]:
    """Yield the filling of each gap of a track on a straight line between its ends."""
    tracks, side = assigned.estimate, assigned.estimate.side
    left, right = tracks.order[:-1], tracks.order[1:]
    size = side.step[right].astype(np.int64) - side.step[left] - 1
    gap = np.flatnonzero((side.track[left] == side.track[right]) & (size > 0))
    left, right, size = left[gap], right[gap], size[gap]
    which = np.repeat(np.arange(len(gap)), size)
    step = concatenated(side.step[left].astype(np.int64) + 1, size)
    a, b = left[which], right[which]
    begin, end = (places.timestamps[side.step[row]] for row in (a, b))
    share = ((places.timestamps[step] - begin) / (end - begin))[:, None]
    states = places.estimate.state
    state = states[a] + share * places.difference(states[a], states[b])
    truth = np.where(assigned.follows[left] >= 0, assigned.follows[left], assigned.follows[right])
    saved = _added_saves(assigned, places, state, (truth[which], step), side.price[a])
    saving = sum_by(which, saved, len(gap))
    first = np.cumsum(size) - size
    for k in np.argsort(-saving, kind="stable")[:limit].tolist():
        rows = slice(int(first[k]), int(first[k] + size[k]))
        ends = a[rows], b[rows]
        gain = float(saving[k])
        yield _with_rows("fill", gain, places, step[rows], state[rows], ends, share[rows])


def _with_rows(
    kind: str,
    saving: float,
    places: StatePlaces,
    step: Ints,
    state: Floats,
    ends: tuple[Ints, Ints],
    share: Floats,
) -> Candidate:
    """Return the candidate that adds rows to a track.

    Values other than states are interpolated between the two rows in `ends`, each (N,): `share`
    (N, 1) is 0 at the first row and 1 at the second.
    """
    order = np.argsort(step)
    first, second = ends

    def between(values: Floats | None) -> Floats | None:
        if values is None:
            return None
        table = values.reshape(len(values), -1)
        added = table[first] + share * (table[second] - table[first])
        return added[order].reshape(-1, *values.shape[1:])

    likely, track = between(places.existence), int(places.estimate.track[first[0]])
    rows = AddedRows(
        step=step[order],
        track=np.full(len(step), track),
        state=state[order],
        covariance=between(places.estimate.covariance),
        attributes={} if likely is None else {EXISTENCE: likely},
    )
    return of_steps(kind, saving, Edit(added=rows), (track,), rows.step)


def _added_saves(
    assigned: Assigned, places: StatePlaces, state: Floats, wanted: tuple[Ints, Ints], price: Floats
) -> Floats:
    """Return estimated savings (N,) of new states; `wanted` has their true objects and steps."""
    row = assigned.truth.find(*wanted)
    row = np.where((row >= 0) & (assigned.followed[row] < 0), row, NO_PARTNER)
    price_of_row = assigned.problem.truth_price
    missed = price_of_row[row] if len(price_of_row) else np.zeros(len(row))
    cost = np.minimum(places.costs(state, row), 1.0) * (missed + price)
    return np.where(row >= 0, missed - cost, -price)


def extended(assigned: Assigned, places: StatePlaces, limit: int) -> Iterator[Candidate]:
    """Yield extensions of tracks at either end, at constant velocity, over missed targets."""
    tracks, side = assigned.estimate, assigned.estimate.side
    there = np.flatnonzero(np.diff(tracks.first) > 0)
    first, last = tracks.first[there], tracks.first[there + 1] - 1
    states, timestamps = places.estimate.state, places.timestamps
    ahead = np.arange(1, LONGEST_EXTENSION + 1)
    for sign, edge, behind in (
        (1, last, np.maximum(first, last - BEHIND + 1)),
        (-1, first, np.minimum(last, first + BEHIND - 1)),
    ):
        row, far = tracks.order[edge], tracks.order[behind]
        truth = assigned.follows[row]
        own = np.flatnonzero(truth >= 0)
        row, far, truth = row[own], far[own], truth[own]
        now = timestamps[side.step[row]]
        past = now - timestamps[side.step[far]]
        away = places.difference(states[far], states[row])
        speed = away / np.where(past == 0, 1.0, past)[:, None]
        step = side.step[row].astype(np.int64)[:, None] + sign * ahead
        inside = (step >= 0) & (step < len(timestamps))
        at = np.where(inside, step, 0)
        state = states[row][:, None] + (timestamps[at] - now[:, None])[..., None] * speed[:, None]
        wanted = np.repeat(truth, LONGEST_EXTENSION), np.where(inside, step, -1).ravel()
        price = np.repeat(side.price[row], LONGEST_EXTENSION)
        flat = state.reshape(-1, states.shape[1])
        saved = _added_saves(assigned, places, flat, wanted, price).reshape(step.shape)
        sums = np.cumsum(saved, axis=1)
        size = np.argmax(sums, axis=1) + 1
        for k in np.argsort(-sums.max(axis=1, initial=0.0), kind="stable")[:limit].tolist():
            n = int(size[k])
            ends = 2 * (np.full(n, row[k]),)
            gain, none = float(sums[k, n - 1]), np.zeros((n, 1))
            yield _with_rows("extend", gain, places, step[k, :n], state[k, :n], ends, none)


def shifted(assigned: Assigned, places: StatePlaces) -> Iterator[Candidate]:
    """Yield the shift of the whole estimate with the largest estimated saving.

    Shifts are by one of `SHIFTS` steps, in either direction.
    """
    side, problem = assigned.estimate.side, assigned.problem
    row = np.flatnonzero(assigned.follows >= 0)
    row = row[:: -(-len(row) // SAMPLED_PAIRS) or 1]
    truth, step = assigned.follows[row], side.step[row].astype(np.int64)
    here = problem.truth_price[assigned.truth.find(truth, step)] + side.price[row]
    now = float((here - assigned.cost[row]).sum())
    scale = np.count_nonzero(assigned.follows >= 0) / max(len(row), 1)
    shifts = []
    for shift in (sign * size for size in SHIFTS for sign in (-1, 1)):
        there = assigned.truth.find(truth, step + shift)
        cost = np.minimum(places.costs(places.estimate.state[row], there), 1.0)
        shifts.append((float(((1.0 - cost) * here).sum()) - now, shift))
    saving, shift = max(shifts)
    yield Candidate(kind="shift", saving=saving * scale, edit=Edit(shift=shift))


def moved(assigned: Assigned, places: StatePlaces) -> Iterator[Candidate]:
    """Yield the removal of the median difference between estimates and the objects they follow."""
    side, problem = assigned.estimate.side, assigned.problem
    row = np.flatnonzero(assigned.follows >= 0)
    if not len(row):
        return
    there = assigned.truth.find(assigned.follows[row], side.step[row])
    states = places.estimate.state
    offset = np.median(places.difference(places.truth.state[there], states[row]), axis=0)
    cost = np.minimum(places.costs(states[row] - offset, there), 1.0)
    both = problem.truth_price[there] + side.price[row]
    saving = float((assigned.cost[row] - cost * both).sum())
    yield Candidate(kind="offset", saving=saving, edit=Edit(offset=offset))
