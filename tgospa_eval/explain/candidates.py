"""Repairs that may save something, with what they would save if nothing else changed.

Costs are in units of c^p. What is said here only decides what is tried: `explain.explain` proves.
"""

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances import Distance
from tgospa_eval.explain.edits import (
    NO_PARTNER,
    AddedRows,
    Assigned,
    AssignedStretch,
    Edit,
    exchange,
    split,
)
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.tracks.trajectories import Trajectories
from tgospa_eval.tracks.weights import EXISTENCE

HALVES = 2
"""Halves of a switch from one estimate to another."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A repair that may be worth a trial.

    Parameters
    ----------
    kind : str
        One of `results.explanation.KINDS`.
    saving : float
        What it would save at the assignment at hand, in units of c^p.
    edit : Edit
        What it does.
    tracks : tuple of int
        The estimates that it changes; none where it changes all.
    begin, end : int, optional
        The steps that it is about.
    """

    kind: str
    saving: float
    edit: Edit
    tracks: tuple[int, ...] = ()
    begin: int | None = None
    end: int | None = None


def exchanged(assigned: Assigned) -> Iterator[Candidate]:
    """Of each change of a truth from one estimate to another the exchange, or merge, of the two."""
    steps, prices = assigned.problem.steps, assigned.problem.switch_price_at
    by_truth: dict[int, list[AssignedStretch]] = defaultdict(list)
    truths: dict[int, set[int]] = defaultdict(set)
    for stretch in assigned.stretches:
        by_truth[stretch.truth].append(stretch)
        truths[stretch.estimate].add(stretch.truth)
    seen: set[tuple[int, ...]] = set()
    for own in by_truth.values():
        for before, after in pairwise(own):
            a, b = sorted((before.estimate, after.estimate))
            whole = _together(assigned, a, b) if (a, b) not in seen else None
            seen.add((a, b))
            beside = [by_truth[i] for i in sorted(truths[a] | truths[b])]
            if whole is not None:
                named = [[a if s.estimate == b else s.estimate for s in part] for part in beside]
                saved = sum(_changes([s.estimate for s in part]) for part in beside)
                saved -= sum(map(_changes, named))
                yield replace(whole, saving=HALVES * saved * float(prices[after.begin]))
            step = _first_row(assigned, a, b, after.begin)
            if whole is None and step is not None and (a, b, step) not in seen:
                seen.add((a, b, step))
                saved = sum(_exchange_saves(part, a, b, step) for part in beside)
                yield Candidate(
                    kind="exchange",
                    saving=HALVES * saved * float(prices[after.begin]),
                    edit=exchange(a, b, after.begin, steps),
                    tracks=_in_time(assigned, a, b, step),
                    begin=step,
                )


def _together(assigned: Assigned, a: int, b: int) -> Candidate | None:
    """Two tracks as one, if they are never at the same step."""
    step = assigned.estimate.side.step
    first, second = (step[assigned.estimate.rows(track)] for track in (a, b))
    if np.isin(first, second).any():
        return None
    into, track = (a, b) if first[0] < second[0] else (b, a)
    later = step[assigned.estimate.rows(track)]
    return Candidate(
        kind="merge",
        saving=0.0,
        edit=Edit(pieces=dict.fromkeys((a, b), ((0, assigned.problem.steps - 1, into),))),
        tracks=(into, track),
        begin=int(later[0]),
        end=int(later[-1]),
    )


def _first_row(assigned: Assigned, a: int, b: int, step: int) -> int | None:
    """The first step from this one on at which one of two tracks exists."""
    found = [assigned.estimate.side.step[assigned.estimate.rows(track)] for track in (a, b)]
    later = np.concatenate([own[own >= step] for own in found])
    return int(later.min()) if len(later) else None


def _in_time(assigned: Assigned, a: int, b: int, step: int) -> tuple[int, int]:
    """The two, first the one that ends before the step, if one does."""
    last = int(assigned.estimate.side.step[assigned.estimate.rows(b)][-1])
    return (b, a) if last < step else (a, b)


def _changes(estimates: list[int]) -> int:
    return sum(one != other for one, other in pairwise(estimates))


def _exchange_saves(stretches: list[AssignedStretch], a: int, b: int, step: int) -> int:
    """Changes of a truth at a step that there are, less those after an exchange from it on."""
    before = bisect_left(stretches, step, key=lambda stretch: stretch.begin)
    after = bisect_left(stretches, step, key=lambda stretch: stretch.end)
    if not before or after == len(stretches):
        return 0
    one, other = stretches[before - 1].estimate, stretches[after].estimate
    named = {a: b, b: a}.get(other, other)
    return int(one != other) - int(one != named)


def split_up(assigned: Assigned, names: tuple[str, ...]) -> Iterator[Candidate]:
    """Of each change of an estimate from one truth to another its split; `names` are all ids."""
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
    """A name like this one that there is not."""
    number = 2
    while f"{name}_{number}" in names:
        number += 1
    return f"{name}_{number}"


def of_rows(assigned: Assigned, most: int) -> Iterator[Candidate]:
    """Tracks to drop, and their ends to cut off, where nothing is."""
    problem, side = assigned.problem, assigned.estimate.side
    free = assigned.follows < 0
    partner = assigned.truth.find(assigned.follows, side.step)
    # What follows a truth is worth what the truth costs without it, less the pair.
    worth = -side.price
    worth[~free] = problem.truth_price[partner[~free]] - assigned.cost[~free]
    saved = -np.bincount(side.track, worth, minlength=side.count)
    for stretch in assigned.stretches:
        price = problem.switch_price_at
        saved[stretch.estimate] += float(price[stretch.begin]) if stretch.begin else 0.0
    saved[np.diff(assigned.estimate.first) == 0] = 0.0  # of which no row is left
    for track in np.argsort(-saved, kind="stable")[:most].tolist():
        if saved[track] > 0:
            yield _dropped(assigned, track, float(saved[track]))
    for track in range(side.count):
        rows = assigned.estimate.rows(track)
        used = np.flatnonzero(~free[rows])
        if not len(used):
            continue
        for cut in (rows[: used[0]], rows[used[-1] + 1 :]):
            if len(cut):
                yield _cut(assigned, track, cut)


def _dropped(assigned: Assigned, track: int, saving: float) -> Candidate:
    steps = assigned.estimate.side.step[assigned.estimate.rows(track)]
    return Candidate(
        kind="drop",
        saving=saving,
        edit=Edit(pieces={track: ()}),
        tracks=(track,),
        begin=int(steps[0]),
        end=int(steps[-1]),
    )


def _cut(assigned: Assigned, track: int, rows: Ints) -> Candidate:
    side = assigned.estimate.side
    begin, end = int(side.step[rows[0]]), int(side.step[rows[-1]])
    last = assigned.problem.steps - 1
    kept = (end + 1, last) if rows[0] == assigned.estimate.rows(track)[0] else (0, begin - 1)
    return Candidate(
        kind="trim",
        saving=float(side.price[rows].sum()),
        edit=Edit(pieces={track: ((*kept, track),)}),
        tracks=(track,),
        begin=begin,
        end=end,
    )


# -------------------------------------------------------------------------------------------------
# Repairs that make or move states: gaps filled, tracks extended, the whole estimate moved.
#
# What they would save at the assignment at hand is measured by the base distance, of Gaussians and
# clouds by one of their means that is no larger.

LONGEST_EXTENSION = 50
"""Steps by which a track is extended at most."""

BEHIND = 5
"""States from which the velocity of an extension is taken, or as many as there are."""

SHIFTS = (1, 2, 3, 4, 5)
SAMPLED_PAIRS = 4000
"""Assigned pairs that are looked at for a shift."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StatePlaces:
    """Where everything is, for estimates of what repairs save.

    Parameters
    ----------
    truth, estimate : Trajectories
        On the grid.
    moments : (T,) float array
        Its stamps, as numbers.
    distance : Distance
        One that compares states without covariances.
    parameters : Parameters
        The cutoff, and the order.
    period : (d,) float array
        Of each column, infinite where it is not periodic.
    existence : (R,) float array, optional
        Probability of each estimate row, where these count.
    """

    truth: Trajectories
    estimate: Trajectories
    moments: Floats
    distance: Distance
    parameters: Parameters
    period: Floats
    existence: Floats | None = None

    def costs(self, state: Floats, row: Ints) -> Floats:
        """``(d / c)^p`` of states and truths (N,), infinite where there is no truth."""
        there = row >= 0
        apart = self.distance(state[there], self.truth.state[row[there]])
        found = np.full(len(row), np.inf)
        found[there] = (apart / self.parameters.cutoff) ** self.parameters.order
        return found

    def apart(self, first: Floats, second: Floats) -> Floats:
        """The difference of states, the shorter way round where a column is periodic."""
        delta = second - first
        turns = np.rint(delta / self.period)
        return delta - np.where(turns == 0, 0.0, turns * np.where(turns == 0, 1.0, self.period))


def filled(assigned: Assigned, places: StatePlaces, most: int) -> Iterator[Candidate]:
    """Gaps of tracks, filled on straight lines between their ends."""
    tracks, side = assigned.estimate, assigned.estimate.side
    left, right = tracks.order[:-1], tracks.order[1:]
    size = side.step[right].astype(np.int64) - side.step[left] - 1
    gap = np.flatnonzero((side.track[left] == side.track[right]) & (size > 0))
    left, right, size = left[gap], right[gap], size[gap]
    which = np.repeat(np.arange(len(gap)), size)
    step = concatenated(side.step[left].astype(np.int64) + 1, size)
    a, b = left[which], right[which]
    begin, end = (places.moments[side.step[row]] for row in (a, b))
    share = ((places.moments[step] - begin) / (end - begin))[:, None]
    states = places.estimate.state
    state = states[a] + share * places.apart(states[a], states[b])
    truth = np.where(assigned.follows[left] >= 0, assigned.follows[left], assigned.follows[right])
    saved = _added_saves(assigned, places, state, (truth[which], step), side.price[a])
    saving = sum_by(which, saved, len(gap))
    first = np.cumsum(size) - size
    for k in np.argsort(-saving, kind="stable")[:most].tolist():
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
    """New rows of a track; what is beside states is on the line between two of its rows (N,).

    `share` (N, 1) is how far from the first to the second.
    """
    order = np.argsort(step)
    first, second = ends

    def between(values: Floats | None) -> Floats | None:
        if values is None:
            return None
        table = values.reshape(len(values), -1)
        found = table[first] + share * (table[second] - table[first])
        return found[order].reshape(-1, *values.shape[1:])

    likely, track = between(places.existence), int(places.estimate.track[first[0]])
    rows = AddedRows(
        step=step[order],
        track=np.full(len(step), track),
        state=state[order],
        covariance=between(places.estimate.covariance),
        attributes={} if likely is None else {EXISTENCE: likely},
    )
    return Candidate(
        kind=kind,
        saving=saving,
        edit=Edit(added=rows),
        tracks=(track,),
        begin=int(step.min()),
        end=int(step.max()),
    )


def _added_saves(
    assigned: Assigned, places: StatePlaces, state: Floats, wanted: tuple[Ints, Ints], price: Floats
) -> Floats:
    """What new states save (N,), each of which is to follow a truth at a step."""
    row = assigned.truth.find(*wanted)
    row = np.where((row >= 0) & (assigned.followed[row] < 0), row, NO_PARTNER)
    alone = assigned.problem.truth_price
    missed = alone[row] if len(alone) else np.zeros(len(row))
    cost = np.minimum(places.costs(state, row), 1.0) * (missed + price)
    return np.where(row >= 0, missed - cost, -price)


def extended(assigned: Assigned, places: StatePlaces, most: int) -> Iterator[Candidate]:
    """Tracks that go on at either end, at constant velocity, while the truth is missed."""
    tracks, side = assigned.estimate, assigned.estimate.side
    there = np.flatnonzero(np.diff(tracks.first) > 0)
    first, last = tracks.first[there], tracks.first[there + 1] - 1
    states, moments = places.estimate.state, places.moments
    ahead = np.arange(1, LONGEST_EXTENSION + 1)
    for sign, edge, behind in (
        (1, last, np.maximum(first, last - BEHIND + 1)),
        (-1, first, np.minimum(last, first + BEHIND - 1)),
    ):
        row, far = tracks.order[edge], tracks.order[behind]
        truth = assigned.follows[row]
        own = np.flatnonzero(truth >= 0)
        row, far, truth = row[own], far[own], truth[own]
        now = moments[side.step[row]]
        past = now - moments[side.step[far]]
        away = places.apart(states[far], states[row])
        speed = away / np.where(past == 0, 1.0, past)[:, None]
        step = side.step[row].astype(np.int64)[:, None] + sign * ahead
        inside = (step >= 0) & (step < len(moments))
        at = np.where(inside, step, 0)
        state = states[row][:, None] + (moments[at] - now[:, None])[..., None] * speed[:, None]
        wanted = np.repeat(truth, LONGEST_EXTENSION), np.where(inside, step, -1).ravel()
        price = np.repeat(side.price[row], LONGEST_EXTENSION)
        flat = state.reshape(-1, states.shape[1])
        saved = _added_saves(assigned, places, flat, wanted, price).reshape(step.shape)
        sums = np.cumsum(saved, axis=1)
        size = np.argmax(sums, axis=1) + 1
        for k in np.argsort(-sums.max(axis=1, initial=0.0), kind="stable")[:most].tolist():
            n = int(size[k])
            ends = 2 * (np.full(n, row[k]),)
            gain, none = float(sums[k, n - 1]), np.zeros((n, 1))
            yield _with_rows("extend", gain, places, step[k, :n], state[k, :n], ends, none)


def shifted(assigned: Assigned, places: StatePlaces) -> Iterator[Candidate]:
    """The whole estimate some steps earlier or later: the shift that would save most."""
    side, problem = assigned.estimate.side, assigned.problem
    row = np.flatnonzero(assigned.follows >= 0)
    row = row[:: -(-len(row) // SAMPLED_PAIRS) or 1]
    truth, step = assigned.follows[row], side.step[row].astype(np.int64)
    here = problem.truth_price[assigned.truth.find(truth, step)] + side.price[row]
    now = float((here - assigned.cost[row]).sum())
    scale = np.count_nonzero(assigned.follows >= 0) / max(len(row), 1)
    found = []
    for shift in (sign * size for size in SHIFTS for sign in (-1, 1)):
        there = assigned.truth.find(truth, step + shift)
        cost = np.minimum(places.costs(places.estimate.state[row], there), 1.0)
        found.append((float(((1.0 - cost) * here).sum()) - now, shift))
    saving, shift = max(found)
    yield Candidate(kind="shift", saving=saving * scale, edit=Edit(shift=shift))


def moved(assigned: Assigned, places: StatePlaces) -> Iterator[Candidate]:
    """The whole estimate without the median difference to what it follows."""
    side, problem = assigned.estimate.side, assigned.problem
    row = np.flatnonzero(assigned.follows >= 0)
    if not len(row):
        return
    there = assigned.truth.find(assigned.follows[row], side.step[row])
    states = places.estimate.state
    offset = np.median(places.apart(places.truth.state[there], states[row]), axis=0)
    cost = np.minimum(places.costs(states[row] - offset, there), 1.0)
    both = problem.truth_price[there] + side.price[row]
    saving = float((assigned.cost[row] - cost * both).sum())
    yield Candidate(kind="offset", saving=saving, edit=Edit(offset=offset))
