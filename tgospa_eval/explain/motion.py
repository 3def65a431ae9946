"""Repairs that make or move states: gaps filled, tracks extended, the whole estimate moved.

What they would save at the assignment at hand is measured by the base distance, of Gaussians and
clouds by one of their means that is no larger.
"""

from collections.abc import Iterator

import numpy as np

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances import Distance
from tgospa_eval.explain import edits
from tgospa_eval.explain.assigned import NO_PARTNER, Assigned
from tgospa_eval.explain.candidates import Candidate
from tgospa_eval.explain.edits import Edit, Rows
from tgospa_eval.problem.problem import Floats, Ints, sum_by
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.tracks.attributes import chosen
from tgospa_eval.tracks.existence import EXISTENCE
from tgospa_eval.tracks.trajectories import Trajectories

LONGEST_EXTENSION = 50
"""Steps by which a track is extended at most."""

BEHIND = 5
"""States from which the velocity of an extension is taken, or as many as there are."""

SHIFTS = (1, 2, 3, 4, 5)
SAMPLED_PAIRS = 4000
"""Assigned pairs that are looked at for a shift."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
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


def filled(assigned: Assigned, places: Places, most: int) -> Iterator[Candidate]:
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
        spread = places.estimate.covariance
        covariance = None
        if spread is not None:
            covariance = spread[a[rows]] + share[rows] * (spread[b[rows]] - spread[a[rows]])
        likely = places.existence
        if likely is not None:
            likely = likely[a[rows]] + share[rows, 0] * (likely[b[rows]] - likely[a[rows]])
        made = Rows(
            step=step[rows],
            track=np.full(len(step[rows]), side.track[left[k]]),
            state=state[rows],
            covariance=covariance,
            attributes=_certainty(likely),
        )
        yield _with_rows("fill", float(saving[k]), made)


def _certainty(existence: Floats | None) -> dict[str, Floats]:
    """The attribute of rows that exist with a probability."""
    return {} if existence is None else {EXISTENCE: existence}


def _with_rows(kind: str, saving: float, made: Rows) -> Candidate:
    order = np.argsort(made.step)
    rows = Rows(
        step=made.step[order],
        track=made.track,
        state=made.state[order],
        covariance=None if made.covariance is None else made.covariance[order],
        attributes=chosen(made.attributes, order),
    )
    return Candidate(
        kind=kind,
        saving=saving,
        edit=edits.add(rows),
        tracks=(int(made.track[0]),),
        begin=int(made.step.min()),
        end=int(made.step.max()),
    )


def _added_saves(
    assigned: Assigned, places: Places, state: Floats, wanted: tuple[Ints, Ints], price: Floats
) -> Floats:
    """What new states save (N,), each of which is to follow a truth at a step."""
    row = assigned.truth.find(*wanted)
    row = np.where((row >= 0) & (assigned.followed[row] < 0), row, NO_PARTNER)
    alone = assigned.problem.truth_price
    missed = alone[row] if len(alone) else np.zeros(len(row))
    cost = np.minimum(places.costs(state, row), 1.0) * (missed + price)
    return np.where(row >= 0, missed - cost, -price)


def extended(assigned: Assigned, places: Places, most: int) -> Iterator[Candidate]:
    """Tracks that go on at either end, at constant velocity, while the truth is missed."""
    tracks, side = assigned.estimate, assigned.estimate.side
    there = np.flatnonzero(np.diff(tracks.first) > 0)
    first, last = tracks.first[there], tracks.first[there + 1] - 1
    states, moments = places.estimate.state, places.moments
    ahead = np.arange(1, LONGEST_EXTENSION + 1)
    found: list[tuple[float, int, Ints, Floats, int]] = []
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
            gain = float(sums[k, n - 1])
            found.append((gain, int(side.track[row[k]]), step[k, :n], state[k, :n], int(row[k])))
    spread = places.estimate.covariance
    for saving, track, added, made, source in found:
        covariance = None if spread is None else np.repeat(spread[source][None], len(added), axis=0)
        likely = places.existence
        rows = Rows(
            step=added,
            track=np.full(len(added), track),
            state=made,
            covariance=covariance,
            attributes=_certainty(None if likely is None else np.full(len(added), likely[source])),
        )
        yield _with_rows("extend", saving, rows)


def shifted(assigned: Assigned, places: Places) -> Iterator[Candidate]:
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


def moved(assigned: Assigned, places: Places) -> Iterator[Candidate]:
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
