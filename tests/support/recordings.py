"""Recordings of any length, made a stretch of time after another in memory of one stretch.

``python tests/support/recordings.py DIR ais|city ROWS`` writes one as folders of Parquet files.

The number of targets is the same at every step: whoever leaves is replaced at once. A longer
recording has more steps and is in no other way different.
"""

import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.simulation import Tracker
from tgospa_eval.simulation.scenarios import encounters

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

GRAIN = 128
"""Positions are multiples of 1/128: files compress to half of what decimals take, and machines
whose sines differ in the last digit still make the same files."""

STATES_MADE_AT_ONCE = 1 << 16
"""Targets times steps of a stretch, about."""

STRETCHES_A_PART = 8
LEAST_PARTS = 4


@dataclass(frozen=True, kw_only=True)
class RecordingKind:
    """A kind of recording.

    Parameters
    ----------
    targets : int
        How many there are at every step.
    lifetimes : (int, int)
        Least and most steps of a target.
    area : float
        Side of the square, in metres.
    motion : ShippingLanes or Streets
        Where targets go: draws numbers of new targets, and has their positions at an age.
    false_speed : float
        Standard deviation of each coordinate of the velocity of false tracks, in metres a step.
    tracker : Tracker
        The errors of the estimate: noise, misses, swaps, fragmentation, false tracks.
    cutoff, switch_penalty : float
        Of the metric, that fit, in metres.
    """

    targets: int
    lifetimes: tuple[int, int]
    area: float
    motion: "ShippingLanes | Streets"
    false_speed: float
    tracker: Tracker
    cutoff: float
    switch_penalty: float


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How a recording is divided.

    Parameters
    ----------
    steps : int
        Of all of it.
    stretch : int
        Steps that are made at once.
    part : int
        Steps of a part, a multiple of those.
    """

    steps: int
    stretch: int
    part: int

    @property
    def parts(self) -> int:
        """How many there are."""
        return -(-self.steps // self.part)

    @classmethod
    def of(cls, kind: RecordingKind, rows: int) -> "Layout":
        """The least number of whole steps with so many rows of truth, in four parts at least."""
        steps = -(-rows // kind.targets)
        stretch = min(STATES_MADE_AT_ONCE // kind.targets, max(steps // (2 * LEAST_PARTS), 1))
        stretches = -(-steps // stretch)
        part = stretch * min(STRETCHES_A_PART, max(stretches // LEAST_PARTS, 1))
        return cls(steps=steps, stretch=stretch, part=part)


@dataclass(frozen=True, kw_only=True, eq=False)
class Present:
    """The targets of a stretch of time, in the order of their ids.

    Parameters
    ----------
    first : int
        Its first step, from 0.
    ids : (n,) int64 array
        Of the targets.
    alive : (B, n) bool array
        Which are there.
    positions : (B, n, 2) array
        Of no meaning where they are not.
    """

    first: int
    ids: Ints
    alive: Bools
    positions: Floats


RecordedRows = dict[str, NDArray[Any]]
"""Rows of a side, sorted by time, then id: times t from 1 on, ids, positions x and y in metres."""


def present_targets(
    kind: RecordingKind, layout: Layout, rng: np.random.Generator
) -> Iterator[Present]:
    """The targets, a stretch after another.

    Lifetimes are log-uniform. At the first step ages and lifetimes are as at any other: a target
    that is met there has a lifetime with a probability in proportion to it, and any age.
    """
    least, most = kind.lifetimes
    lives = np.arange(least, most + 1)
    odds = np.log1p(1 / lives)
    life = rng.choice(lives, kind.targets, p=odds * lives / (odds * lives).sum())
    begin = -(rng.random(kind.targets) * life).astype(np.int64)
    end = begin + life
    ids = np.arange(1, kind.targets + 1)
    drawn = kind.motion.draw(kind.targets, rng)
    odds = np.cumsum(odds / odds.sum())
    for first in range(0, layout.steps, layout.stretch):
        last = min(first + layout.stretch, layout.steps)
        fresh, added = np.sort(end[end < last]), []
        while len(fresh):  # who is born in this stretch may die in it, too
            added.append(fresh)
            life = lives[np.minimum(np.searchsorted(odds, rng.random(len(fresh))), len(lives) - 1)]
            ended = fresh + life
            end = np.append(end, ended)
            begin = np.append(begin, fresh)
            fresh = np.sort(ended[ended < last])
        count = sum(map(len, added))
        ids = np.append(ids, np.arange(ids[-1] + 1, ids[-1] + 1 + count))
        drawn = np.concatenate((drawn, kind.motion.draw(count, rng)))
        step = np.arange(first, last)[:, None]
        yield Present(
            first=first,
            ids=ids,
            alive=(step >= begin) & (step < end),
            positions=kind.motion.positions(drawn, step - begin),
        )
        left = end > last - 1
        ids, begin, end, drawn = ids[left], begin[left], end[left], drawn[left]


def truth_rows(present: Present) -> RecordedRows:
    """What is there, row by row."""
    step, column = np.nonzero(present.alive)
    x, y = rounded(present.positions[present.alive]).T
    return {"t": step + present.first + 1, "id": present.ids[column], "x": x, "y": y}


def rounded(positions: Floats) -> Floats:
    """Multiples of 1 / `GRAIN`."""
    nearest: Floats = np.round(positions * GRAIN) / GRAIN
    return nearest


# -------------------------------------------------------------------------------------------------
# Where the targets of long recordings go: ships in lanes, cars in streets.
#
# A position depends on the numbers of its target and on its age alone, so that any stretch of time
# can be made without those before it. Lengths are in metres, speeds in metres a step.


@dataclass(frozen=True, kw_only=True)
class ShippingLanes:
    """Ships on straight lanes between ports, and others that go anywhere.

    With the age k a ship is at o + u v k + w a sin(omega k + phi), w across u: o and u of a lane,
    in one of its two directions and to the right of its middle, or anywhere; v, a, omega and phi
    uniform.

    Parameters
    ----------
    area : float
        Side of the square.
    ports : int
        On a square grid of so many a side, in the middle of the fields.
    in_lanes : float
        Share of the ships on lanes; a lane is chosen as often as it is long.
    right, spread : float
        Distance from the middle of a lane: mean and standard deviation.
    speeds, sways, periods : (float, float)
        Least and most of v, a and 2 pi / omega.
    """

    area: float
    ports: int
    in_lanes: float
    right: float
    spread: float
    speeds: tuple[float, float]
    sways: tuple[float, float]
    periods: tuple[float, float]

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Numbers (count, 9) of ships: o, u, v, a, omega, phi."""
        begin, along = self._lanes()
        length = np.hypot(*along.T)
        lane = rng.choice(len(length), count, p=length / length.sum())
        heading = along[lane] / length[lane, None]
        heading *= rng.choice((-1.0, 1.0), count)[:, None]
        start = begin[lane] + along[lane] * rng.random((count, 1))
        start += _right_of(heading) * rng.normal(self.right, self.spread, (count, 1))
        free = rng.random(count) >= self.in_lanes
        anywhere = rng.uniform(0, self.area, (count, 2))
        angle = rng.uniform(0, 2 * np.pi, count)
        start[free] = anywhere[free]
        heading[free] = np.stack((np.cos(angle), np.sin(angle)), axis=-1)[free]
        rates = (
            rng.uniform(*self.speeds, count),
            rng.uniform(*self.sways, count),
            2 * np.pi / rng.uniform(*self.periods, count),
            rng.uniform(0, 2 * np.pi, count),
        )
        return np.column_stack((start, heading, *rates))

    def positions(self, drawn: Floats, age: Ints) -> Floats:
        """Positions (B, n, 2) of n ships at ages (B, n)."""
        x, y, east, north, speed, sway, turn, phase = drawn.T
        ahead = speed * age
        aside = sway * np.sin(turn * age + phase)
        return np.stack(
            (x + east * ahead + north * aside, y + north * ahead - east * aside), axis=-1
        )

    def _lanes(self) -> tuple[Floats, Floats]:
        """Begin and extent of a lane from each port to those a field further and two aside."""
        field = self.area / self.ports
        middle = field * (np.arange(self.ports) + 0.5)
        port = np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)
        ways = field * np.array([(1, 0), (0, 1), (1, 2), (2, -1)])
        begin = np.repeat(port, len(ways), axis=0)
        along = np.tile(ways, (len(port), 1))
        there = ((begin + along > 0) & (begin + along < self.area)).all(axis=1)
        return begin[there], along[there]


@dataclass(frozen=True, kw_only=True)
class Streets:
    """Cars in a square grid of streets, which turn at crossings.

    A car keeps its speed; at each crossing it goes straight on with probability 1/2, else left or
    right. It keeps to the right of the street. At the sides of the square it is reflected.

    Parameters
    ----------
    blocks : int
        Between streets, on each side of the square.
    block : float
        Distance of the streets.
    right : float
        Distance from the middle of the street.
    speeds : (float, float)
        Least and most, each as likely as any between.
    most : int
        Largest age.
    """

    blocks: int
    block: float
    right: float
    speeds: tuple[float, float]
    most: int

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Numbers (count, P): speed, way since the crossing before, then crossings and headings."""
        legs = int(self.most * self.speeds[1] / self.block) + 2
        turn = rng.choice((-1, 0, 0, 1), (count, legs))
        turn[:, 0] = rng.integers(4, size=count)
        heading = np.cumsum(turn, axis=1) % 4
        ways = np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])[heading]
        crossing = rng.integers(self.blocks + 1, size=(count, 1, 2)) + np.cumsum(ways, axis=1)
        crossing -= ways
        speed = rng.uniform(*self.speeds, count)
        since = rng.uniform(0, self.block, count)
        return np.column_stack(
            (speed, since, crossing.reshape(count, 2 * legs), ways.reshape(count, 2 * legs))
        )

    def positions(self, drawn: Floats, age: Ints) -> Floats:
        """Positions (B, n, 2) of n cars at ages (B, n)."""
        legs = (drawn.shape[1] - 2) // 4
        corners, ways = drawn[:, 2:].reshape(len(drawn), 2, legs, 2).swapaxes(0, 1)
        way = drawn[:, 1] + drawn[:, 0] * np.clip(age, 0, self.most)
        leg = (way / self.block).astype(np.int64)
        car = np.arange(len(drawn))
        heading = ways[car, leg]
        middle = self.block * corners[car, leg] + heading * (way - self.block * leg)[..., None]
        area = self.block * self.blocks
        place = middle + self.right * _right_of(heading)
        reflected: Floats = area - np.abs(place % (2 * area) - area)
        return reflected


def _right_of(heading: Floats) -> Floats:
    """The direction to the right."""
    return np.stack((heading[..., 1], -heading[..., 0]), axis=-1)


# -------------------------------------------------------------------------------------------------
# The kinds of long recordings, by name.

AIS = RecordingKind(
    targets=2000,
    lifetimes=(50, 300),
    area=400e3,
    motion=ShippingLanes(
        area=400e3,
        ports=8,
        in_lanes=0.8,
        right=500.0,
        spread=60.0,
        speeds=(30.0, 120.0),
        sways=(0.0, 60.0),
        periods=(60.0, 240.0),
    ),
    false_speed=75.0,
    tracker=Tracker(
        noise=10.0,
        detection=0.95,
        swaps=0.25,
        near=50.0,
        fragmentation=0.002,
        false_rate=6.0,
    ),
    cutoff=100.0,
    switch_penalty=50.0,
)

CITY = RecordingKind(
    targets=500,
    lifetimes=(200, 400),
    area=1000.0,
    motion=Streets(blocks=10, block=100.0, right=3.0, speeds=(3.0, 12.0), most=400),
    false_speed=7.5,
    tracker=Tracker(
        noise=1.0,
        detection=0.93,
        swaps=0.1,
        near=5.0,
        fragmentation=0.01,
        false_rate=2.0,
    ),
    cutoff=10.0,
    switch_penalty=5.0,
)

RECORDINGS = {"ais": AIS, "city": CITY}


# -------------------------------------------------------------------------------------------------
# What a tracker makes of a long recording, with a memory of the targets that are there.
#
# The errors are those of `tgospa_eval.simulation.tracker`, in the same order.


BITS = 40
"""Of an id; the step of a stretch is above them."""


def simulate_recording(
    kind: RecordingKind, layout: Layout, rng: np.random.Generator
) -> Iterator[tuple[RecordedRows, RecordedRows]]:
    """Truth and estimate of a stretch of time after another.

    Every error has a stream of random numbers of its own: changing one leaves the draws of the
    others as they are.
    """
    for_targets, for_tracker, for_false = rng.spawn(3)
    tracks, false = _SimulatedTracks(kind, for_tracker), _FalseTracks(kind, for_false)
    for present in present_targets(kind, layout, for_targets):
        real = tracks.follow(present)
        made = false.rows(present.first, len(present.alive), tracks)
        yield truth_rows(present), _joined(real, made, present.first)


Held = tuple[Ints, Ints, int]
"""Of each target the id of its track and the first step at which that may be reported, from the
first of a stretch; and the least id that no track had."""


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
    track, free, next_id = held[0].copy(), held[1].copy(), held[2]
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
    return tracks, reported, (track, free, next_id)


class _SimulatedTracks:
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

    def follow(self, present: Present) -> RecordedRows:
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
        held = track, free - present.first, self.next_id
        tracks, reported, held = hold_tracks(detected, swaps, lost, self.errors.lost, held)
        self.track, free, self.next_id = held
        self.ids, self.free, self.place = present.ids, free + present.first, places[-1]
        step, column = np.nonzero(reported)
        place = present.positions[step, column]
        x, y = rounded(place + self.noise.normal(0, self.errors.noise, place.shape)).T
        return {"t": step + present.first + 1, "id": tracks[step, column], "x": x, "y": y}

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

    def rows(self, first: int, steps: int, tracks: _SimulatedTracks) -> RecordedRows:
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
        made = {"t": step[row] + 1, "id": self.ids[column], "x": x, "y": y}
        left = self.end > first + steps
        self.ids, self.begin, self.end = self.ids[left], self.begin[left], self.end[left]
        self.line = self.line[left]
        return made


def _joined(real: RecordedRows, false: RecordedRows, first: int) -> RecordedRows:
    """Rows of both in a stretch, sorted by time, then id."""
    both = {name: np.concatenate((real[name], false[name])) for name in real}
    order = np.argsort((both["t"] - first) << BITS | both["id"], kind="stable")
    return {name: values[order] for name, values in both.items()}


SIDES = ("truth", "estimate")
"""Folders of the parts."""


def write_recording(folder: Path, kind: RecordingKind, rows: int, seed: int = 0) -> None:
    """Write the parts of both sides, which are not there, in memory of one stretch."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    layout = Layout.of(kind, rows)
    schema = pa.schema(
        [("t", pa.int64()), ("id", pa.int64()), ("x", pa.float64()), ("y", pa.float64())]
    )
    for side in SIDES:
        (folder / side).mkdir(parents=True)
    stretches = simulate_recording(kind, layout, np.random.default_rng(seed))
    for part in range(layout.parts):
        with ExitStack() as files:
            writers = [
                files.enter_context(
                    pq.ParquetWriter(
                        folder / side / f"part-{part:05d}.parquet",
                        schema,
                        compression="zstd",
                        compression_level=1,
                        # Times and ids are few in a row group, states are all different.
                        use_dictionary=["t", "id"],
                    )
                )
                for side in SIDES
            ]
            for _, sides in zip(range(layout.part // layout.stretch), stretches, strict=False):
                for writer, made in zip(writers, sides, strict=True):
                    table = pa.table(made, schema)
                    writer.write_table(table, row_group_size=max(len(table), 1))


if __name__ == "__main__":
    write_recording(Path(sys.argv[1]), RECORDINGS[sys.argv[2]], int(sys.argv[3]))
