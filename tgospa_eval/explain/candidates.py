"""Repairs that may save cost, and their estimated savings.

A saving is estimated as if the rest of the assignment remained the same. The estimated savings only
decide which repairs are tried; `explain` then proves the savings. Costs are in units of c^p. Sizes
of arrays, such as (S,), are explained in `problem.states`.
"""

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
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
# Edits of the rows of an estimate. They do not depend on the metric.

NO_PARTNER = -1
"""Value instead of a row or track, for a row without a partner."""


class AssignedStretch(NamedTuple):
    """Assignment of a true object to an estimate from step `begin` to step `end`, inclusive.

    It includes steps at which one of the two does not exist, because the linear programme also
    assigns them.
    """

    truth: int
    estimate: int
    begin: int
    end: int


class Track:
    """Lookup of the rows of truth or estimate: all rows of a track, or its row at a given step."""

    def __init__(self, side: Objects, steps: int) -> None:
        self.side, self.steps = side, steps
        self.order = np.argsort(side.track, kind="stable")
        self.first = np.searchsorted(side.track[self.order], np.arange(side.count + 1))
        self._key = side.step.astype(np.int64) * side.count + side.track

    def rows(self, track: int) -> Ints:
        """Return the rows of a track, in order of time."""
        return self.order[self.first[track] : self.first[track + 1]]

    def find(self, track: Ints, step: Ints) -> Ints:
        """Return the row of each track at its element of `step`; `NO_PARTNER` if it has none."""
        if not len(self._key):
            return np.full(len(track), NO_PARTNER)
        key = step.astype(np.int64) * self.side.count + track
        at = np.minimum(np.searchsorted(self._key, key), len(self._key) - 1)
        there = (self._key[at] == key) & (track >= 0) & (step >= 0) & (step < self.steps)
        return np.where(there, at, NO_PARTNER)


class Assigned:
    """Assignment of a solved problem.

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
        Rows of the truth and of the estimate.
    followed, follows : (R,) int arrays
        `followed` has, for each truth row, the near estimate with the largest weight. `follows`
        has, for each estimate row, the near true object with the largest weight. Both have
        `NO_PARTNER` in rows that are not assigned.
    cost : (R,) float array
        For each estimate row that follows a true object, the cost of this pair; for others, 0.
    saved : SavedSolution
        Assignment over time, and prices.
    """

    def __init__(self, states: States, weights: Ints, prices: Floats) -> None:
        self.states, self.weights = states, weights
        self.saved = save_solution(states, weights, prices)
        problem = self.problem = states.problem
        sides = problem.sides
        self.truth, self.estimate = (Track(side, problem.steps) for side in sides)
        used = np.flatnonzero((states.entry >= 0) & (weights > 0))
        used = used[np.argsort(weights[used], kind="stable")]  # larger weights overwrite others
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
        """Stretches with a weight above 0.5, sorted by true object and time."""
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
"""Piece of a track: first and last step (inclusive), and the track of its rows after the edit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AddedRows:
    """Rows to add to an estimate.

    Parameters
    ----------
    step, track : (N,) int arrays
        Step and track of each row. Rows of one track are in the order of time.
    state : (N, d) float array
        State of each row.
    covariance : (N, d (d + 1) / 2) float array, optional
        Lower triangles of covariances, if the rows of the estimate have covariances.
    attributes : mapping of str to (N,) array, optional
        Values of some attributes of the estimate. Values of its other attributes are missing.
    """

    step: Ints
    track: Ints
    state: Floats
    covariance: Floats | None = None
    attributes: Attributes = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Edit:
    """Change of an estimate. Steps and tracks are indices in the estimate on the grid.

    Parameters
    ----------
    pieces : mapping of int to sequence of TrackPiece
        Pieces of each track that changes. Rows of these tracks outside all pieces are dropped.
    fresh : tuple of str
        Ids of new tracks. Their indices continue those of the existing tracks.
    added : AddedRows, optional
        Rows to add.
    shift : int
        Number of steps by which every row is moved: to later steps if > 0, to earlier ones if < 0.
    offset : (d,) float array, optional
        Vector that is subtracted from every state, with an element for each state column.
    """

    pieces: Mapping[int, tuple[TrackPiece, ...]] = field(default_factory=dict)
    fresh: tuple[str, ...] = ()
    added: AddedRows | None = None
    shift: int = 0
    offset: Floats | None = None

    @property
    def local(self) -> bool:
        """True if the edit changes only some tracks: it has no shift and no offset."""
        return not self.shift and self.offset is None

    def tracks(self, track: Ints, step: Ints) -> Ints:
        """Return the track of each row after the edit, -1 for dropped rows.

        `track` and `step` have the track and the step of each row before the edit.
        """
        after = track.astype(np.int64)
        for own, pieces in self.pieces.items():
            rows = np.flatnonzero(track == own)
            at, became = step[rows], np.full(len(rows), -1)
            for begin, end, to in pieces:
                became[(begin <= at) & (at <= end)] = to
            after[rows] = became
        return after


def renamed(old: SavedSolution, edit: Edit) -> tuple[Ints, Ints, Ints, Ints]:
    """Translate the assignments of a solution to the tracks after an edit.

    If the edit divides a track into pieces, each assignment of the track becomes one assignment for
    each piece that it overlaps. Return four arrays with an element for each new assignment: index
    of the old assignment in `old`, index of the track after the edit, first step, and last step.
    """
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
    """Return the estimate as read from files, without the marks that options added to rows."""
    made = NOT_COUNTED, AWAY
    kept = {name: values for name, values in estimate.attributes.items() if name not in made}
    return replace(estimate, attributes=kept)


def is_same(first: Trajectories, second: Trajectories) -> bool:
    """Return whether two sets of trajectories are equal in all data that affect the metric."""

    def arrays(side: Trajectories) -> tuple[NDArray[Any], ...]:
        around = [] if side.covariance is None else [side.covariance]
        if side.clouds is not None:
            around += [side.clouds.points, side.clouds.weights]
        marks = marks_of(side, NOT_COUNTED), existence_of(side)
        return (side.times, side.step, side.ids[side.track], side.state, *marks, *around)

    one, other = arrays(first), arrays(second)
    return len(one) == len(other) and all(map(np.array_equal, one, other))


def edited(estimate: Trajectories, edit: Edit) -> Trajectories:
    """Return the estimate after an edit; timestamps at which it has no row are left out."""
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
    clouds = estimate.clouds  # an edit never adds rows to an estimate of particle clouds
    if edit.offset is not None:
        state = state - edit.offset
        if clouds is not None:
            clouds = clouds.moved(clouds.points - edit.offset)
            state = clouds.means
    times, labels = _moved_on(estimate, edit.shift)
    # A shift to the future increases the index of the timestamp of each row. In a shift to the
    # past, new timestamps are added at the beginning instead, and the indices remain the same.
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
    """Return the timestamps of an estimate and their texts, extended for a shift by some steps.

    The extension has |shift| new timestamps: after the last one if `shift` > 0, else before the
    first. They are spaced by the median time step.
    """
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
    """Return the edit that splits a track: rows from `step` on become a new track.

    `name` is the id of the new track. `steps` and `tracks` are the numbers of steps and tracks.
    """
    return Edit(pieces={track: ((0, step - 1, track), (step, steps - 1, tracks))}, fresh=(name,))


def exchange(first: int, second: int, step: int, steps: int) -> Edit:
    """Return the edit that exchanges two tracks from a step on; `steps` is the number of steps."""
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
        Estimated saving, in units of c^p.
    edit : Edit
        Change of the estimate.
    tracks : tuple of int
        Indices of the changed tracks; empty if all tracks change.
    begin, end : int, optional
        First and last step at which the repair changes the estimate.
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
    """Return a candidate that begins at the first and ends at the last element of `steps`."""
    begin, end = int(steps[0]), int(steps[-1])
    return Candidate(kind=kind, saving=saving, edit=edit, tracks=tracks, begin=begin, end=end)


def exchanged(assigned: Assigned) -> Iterator[Candidate]:
    """Yield a repair for each switch of a true object from one track to another.

    The repair merges the two tracks if they have no step in common. If they have, it exchanges
    them from the switch on. No repair is yielded twice.
    """
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
    """Return the first step from `step` on at which track a or b has a row; None if none has."""
    steps = [assigned.estimate.side.step[assigned.estimate.rows(track)] for track in (a, b)]
    later = np.concatenate([own[own >= step] for own in steps])
    return int(later.min()) if len(later) else None


def _in_time(assigned: Assigned, a: int, b: int, step: int) -> tuple[int, int]:
    """Return two tracks, in the order (b, a) if track b ends before `step`, else (a, b)."""
    last = int(assigned.estimate.side.step[assigned.estimate.rows(b)][-1])
    return (b, a) if last < step else (a, b)


def _changes(estimates: list[int]) -> int:
    return sum(one != other for one, other in pairwise(estimates))


def _exchange_saves(stretches: list[AssignedStretch], a: int, b: int, step: int) -> int:
    """Return by how much an exchange of two tracks reduces the changes of one true object.

    The tracks are exchanged from `step` on. `stretches` are the assignments of the true object. The
    result is negative if the exchange adds a change.
    """
    before = bisect_left(stretches, step, key=lambda stretch: stretch.begin)
    after = bisect_left(stretches, step, key=lambda stretch: stretch.end)
    if not before or after == len(stretches):
        return 0
    one, other = stretches[before - 1].estimate, stretches[after].estimate
    named = {a: b, b: a}.get(other, other)
    return int(one != other) - int(one != named)


def split_up(
    assigned: Assigned, of_truth: Sequence[str], names: Sequence[str]
) -> Iterator[Candidate]:
    """Yield a split of a track at each step at which it changes to another true object.

    `of_truth` has the ids of the truth, and `names` those of the estimate. The id of the new track
    is none of them.
    """
    steps, prices = assigned.problem.steps, assigned.problem.switch_price_at
    tracks, taken = assigned.problem.estimates, {*of_truth, *names}
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
    """Return the name with a number that makes it different from all `names`."""
    number = 2
    while f"{name}_{number}" in names:
        number += 1
    return f"{name}_{number}"


def of_rows(assigned: Assigned, limit: int) -> Iterator[Candidate]:
    """Yield drops of whole tracks, at most `limit`, and removals of unassigned ends of tracks."""
    problem, side = assigned.problem, assigned.estimate.side
    free = assigned.follows < 0
    partner = assigned.truth.find(assigned.follows, side.step)
    # `worth` is the amount by which a row lowers the cost. A row that follows an object has the
    # price of the missed object minus the cost of the pair. Any other row has minus the price of a
    # false estimate.
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
# Repairs that add or move states: filling gaps, extending tracks, moving the whole estimate.
#
# Savings are estimated by the base distance. For Gaussians and clouds, they are estimated by a
# distance between the means instead, which never exceeds the base distance.

LONGEST_EXTENSION = 50
"""Largest number of steps of an extension."""

BEHIND = 5
"""Largest number of states from which the velocity of an extension is computed."""

SHIFTS = (1, 2, 3, 4, 5)
SAMPLED_PAIRS = 4000
"""Largest number of assigned pairs that are used to estimate the saving of a shift."""


class StatePlaces:
    """States of truth and estimate, and distances between them, to estimate savings.

    Attributes
    ----------
    truth, estimate : Trajectories
        Truth and estimate on the grid.
    timestamps : (T,) float array
        Timestamps of the grid, as numbers.
    distance : Distance
        Base distance; for Gaussians and clouds, a distance between the means, which is never larger
        than the base distance.
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
        """Return ``(d / c)^p`` of each state and its truth row, (N,); infinite if the row is -1."""
        there = row >= 0
        distance = self.distance(state[there], self.truth.state[row[there]])
        costs = np.full(len(row), np.inf)
        costs[there] = (distance / self.parameters.cutoff) ** self.parameters.order
        return costs

    def difference(self, first: Floats, second: Floats) -> Floats:
        """Return second minus first; in periodic columns, the difference of smallest size."""
        delta = second - first
        turns = np.rint(delta / self.period)
        return delta - np.where(turns == 0, 0.0, turns * np.where(turns == 0, 1.0, self.period))


def filled(assigned: Assigned, places: StatePlaces, limit: int) -> Iterator[Candidate]:
    """Yield at most `limit` repairs, each of which fills a gap in a track.

    The new states are on a straight line between the states before and after the gap.
    """
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
    """Return the candidate that adds N rows to a track.

    `step` and `state` have the step and the state of each new row. Its covariance and its
    probability of existence are interpolated between two existing rows of the track. `ends` has two
    arrays (N,): the indices of the first rows, and those of the second rows. `share` (N, 1) is the
    weight of the second row.
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
    """Return the estimated saving of each of N new states.

    `wanted` has two arrays (N,): the true object that each new state is meant to follow, and the
    step of the state. A new state is false if this object does not exist at the step, or is already
    followed. Then the saving is -`price`, where `price` has the cost of each false state.
    """
    row = assigned.truth.find(*wanted)
    row = np.where((row >= 0) & (assigned.followed[row] < 0), row, NO_PARTNER)
    price_of_row = assigned.problem.truth_price
    missed = price_of_row[row] if len(price_of_row) else np.zeros(len(row))
    cost = np.minimum(places.costs(state, row), 1.0) * (missed + price)
    return np.where(row >= 0, missed - cost, -price)


def extended(assigned: Assigned, places: StatePlaces, limit: int) -> Iterator[Candidate]:
    """Yield extensions of tracks at constant velocity, to follow targets that are missed.

    There are at most `limit` extensions forward in time, and as many backward.
    """
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

    The number of steps is one of `SHIFTS`, in either direction.
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
    """Yield the repair that subtracts an offset from all states.

    The offset is the median difference between estimates and the objects that they follow.
    """
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
