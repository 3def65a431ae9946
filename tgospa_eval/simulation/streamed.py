"""What a tracker makes of a long recording, with a memory of the targets that are there.

The errors are those of `tgospa_eval.simulation.tracker`, in the same order.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.simulation.encounters import encounters
from tgospa_eval.simulation.recordings import (
    Layout,
    Present,
    RecordingKind,
    Rows,
    present_targets,
    rounded,
    truth_rows,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

BITS = 40
"""Of an id; the step of a stretch is above them."""


def simulate_recording(
    kind: RecordingKind, layout: Layout, rng: np.random.Generator
) -> Iterator[tuple[Rows, Rows]]:
    """Truth and estimate of a stretch of time after another.

    Every error has a stream of random numbers of its own: changing one leaves the draws of the
    others as they are.
    """
    for_targets, for_tracker, for_false = rng.spawn(3)
    tracks, false = _Tracks(kind, for_tracker), _FalseTracks(kind, for_false)
    for present in present_targets(kind, layout, for_targets):
        real = tracks.follow(present)
        made = false.rows(present.first, len(present.alive), tracks)
        yield truth_rows(present), _joined(real, made, present.first)


@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """What tracks the targets have.

    Parameters
    ----------
    track : (n,) int64 array
        Id of the track of each target.
    free : (n,) int64 array
        First step at which this track may be reported, from the first of a stretch.
    next_id : int
        Least id that no track had.
    """

    track: Ints
    free: Ints
    next_id: int


def hold_tracks(
    detected: Bools, swaps: Ints, lost: Bools, silent: int, held: Held
) -> tuple[Ints, Bools, Held]:
    """Swap and lose tracks in the order of time, at one step swaps first.

    Parameters
    ----------
    detected : (B, n) bool array
        Which targets are seen.
    swaps : (S, 3) int64 array
        Steps and two targets that exchange their tracks from there on; who is silent takes it
        along.
    lost : (B, n) bool array
        Where a track is lost if it is reported there and was free before.
    silent : int
        Steps for which the target of a lost track is; then it has a new one.
    held : Held
        Before the stretch.

    Returns
    -------
    tracks : (B, n) int64 array
        Track of each target.
    reported : (B, n) bool array
        Where it is reported.
    held : Held
        After the stretch; its steps count from the same one.
    """
    track, free, next_id = held.track.copy(), held.free.copy(), held.next_id
    reported = detected.copy()
    for column in np.flatnonzero(free > 0).tolist():
        reported[: free[column], column] = False
    tracks = np.repeat(track[None], len(detected), axis=0)
    losses = np.pad(np.argwhere(lost), ((0, 0), (0, 1)), constant_values=-1)
    events = np.concatenate((swaps, losses))
    for step, one, two in events[np.argsort(events[:, 0], kind="stable")].tolist():
        if two >= 0:
            pair = [one, two]
            track[pair], free[pair] = track[[two, one]], free[[two, one]]
            tracks[step:, pair] = track[pair]
            if max(free[one], free[two]) > step:
                for column in pair:
                    reported[step:, column] = detected[step:, column]
                    reported[step : max(free[column], step), column] = False
        elif free[one] < step:  # the first step of a track is never lost
            free[one], track[one] = step + silent, next_id
            next_id += 1
            tracks[step:, one] = track[one]
            reported[step : step + silent, one] = False
    return tracks, reported, Held(track=track, free=free, next_id=next_id)


class _Tracks:
    """The track that each living target has."""

    def __init__(self, kind: RecordingKind, rng: np.random.Generator) -> None:
        self.errors = kind.tracker
        self.noise, self.misses, self.swaps, self.losses = rng.spawn(4)
        self.next_id = 1
        self.ids = np.zeros(0, np.int64)  # of the targets of the stretch before
        self.track = np.zeros(0, np.int64)
        self.free = np.zeros(0, np.int64)  # step from which on the track is reported
        self.place = np.zeros((0, 2))  # at the last step before, NaN where they were not there

    def new_ids(self, count: int) -> Ints:
        """So many ids that no track had."""
        self.next_id += count
        return np.arange(self.next_id - count, self.next_id)

    def follow(self, present: Present) -> Rows:
        """What is reported of the targets."""
        known = np.isin(present.ids, self.ids)
        had = np.searchsorted(self.ids, present.ids[known])
        track, free = np.zeros((2, len(known)), np.int64)
        track[known], free[known] = self.track[had], self.free[had]
        track[~known] = self.new_ids(int((~known).sum()))
        free[~known] = present.first + present.alive[:, ~known].argmax(axis=0)
        before = np.full((1, len(known), 2), np.nan)
        before[0, known] = self.place[had]
        places = np.where(present.alive[..., None], present.positions, np.nan)
        swaps = self._chosen_swaps(np.concatenate((before, places)))
        detected = (self.misses.random(present.alive.shape) < self.errors.detection) & present.alive
        lost = (self.losses.random(present.alive.shape) < self.errors.fragmentation) & detected
        held = Held(track=track, free=free - present.first, next_id=self.next_id)
        tracks, reported, held = hold_tracks(detected, swaps, lost, self.errors.lost, held)
        track, free, self.next_id = held.track, held.free + present.first, held.next_id
        self.ids, self.track, self.free, self.place = present.ids, track, free, places[-1]
        step, column = np.nonzero(reported)
        place = present.positions[step, column]
        x, y = rounded(place + self.noise.normal(0, self.errors.noise, place.shape)).T
        return Rows(t=step + present.first + 1, id=tracks[step, column], x=x, y=y)

    def _chosen_swaps(self, places: Floats) -> Ints:
        """Step, and the two targets, of the swaps of a stretch; `places` begin a step before it.

        An encounter belongs to the stretch in which it begins.
        """
        if not self.errors.swaps:
            return np.zeros((0, 3), np.int64)
        found = encounters(places, self.errors.near)
        found = found[found[:, 2] > 0]
        found = found[self.swaps.random(len(found)) < self.errors.swaps]
        return np.stack((found[:, 4] - 1, found[:, 0], found[:, 1]), axis=1)


class _FalseTracks:
    """Tracks of nothing: straight lines that begin anywhere."""

    def __init__(self, kind: RecordingKind, rng: np.random.Generator) -> None:
        self.errors, self.area, self.rng = kind.tracker, kind.area, rng
        self.speed = kind.false_speed
        self.ids, self.begin, self.end = np.zeros((3, 0), np.int64)
        self.line = np.zeros((0, 4))

    def rows(self, first: int, steps: int, tracks: _Tracks) -> Rows:
        """Those of a stretch."""
        step = np.arange(first, first + steps)
        begin = np.repeat(step, self.rng.poisson(self.errors.false_rate, steps))
        count = len(begin)
        long = self.rng.integers(*self.errors.false_length, count, endpoint=True)
        start = self.rng.uniform(0, self.area, (count, 2))
        velocity = self.rng.normal(0, self.speed, (count, 2))
        self.ids = np.append(self.ids, tracks.new_ids(count))
        self.begin, self.end = np.append(self.begin, begin), np.append(self.end, begin + long)
        self.line = np.concatenate((self.line, np.column_stack((start, velocity))))
        alive = (step[:, None] >= self.begin) & (step[:, None] < self.end)
        row, column = np.nonzero(alive)
        age = (step[row] - self.begin[column])[:, None]
        x, y = rounded(self.line[column, :2] + self.line[column, 2:] * age).T
        made = Rows(t=step[row] + 1, id=self.ids[column], x=x, y=y)
        left = self.end > first + steps
        self.ids, self.begin, self.end = self.ids[left], self.begin[left], self.end[left]
        self.line = self.line[left]
        return made


def _joined(real: Rows, false: Rows, first: int) -> Rows:
    """Rows of both in a stretch, sorted by time, then id."""
    t, ids, x, y = (
        np.concatenate((getattr(real, name), getattr(false, name)))
        for name in ("t", "id", "x", "y")
    )
    order = np.argsort((t - first) << BITS | ids, kind="stable")
    return Rows(t=t[order], id=ids[order], x=x[order], y=y[order])
