"""The numbers that people know first, of the assignment that is proven (docs/reference/summary.md).

Detection rate, errors, objects that are followed, breaks, false tracks, cardinality, SIAP. A pair
counts by its weight, which is 1 but for mixed assignments; an object is followed at a step where
the weights of its pairs sum to one half or more.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.evaluation.axis import TURN, apart
from tgospa_eval.formats.headers import BOX
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.solution import judged_rows, read_assigned
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import ComparedSides, Json, PairProof
from tgospa_eval.results.summary import Summary, finite, mean, ratio, root
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.trajectories import HEIGHT, PLACES

HALF = 0.5 - 1e-9
"""Weight from which an object is followed."""

ALIKE = 1e-6
"""Relative difference up to which two spans of time are equal."""

VELOCITY = ("vx", "vy", "vz")


@dataclass(frozen=True, kw_only=True, eq=False)
class SideRows:
    """States of a side that are judged, by track and time.

    Parameters
    ----------
    track, step : (R,) int arrays
        Whose, and when.
    time : (R,) float array
        The same in the unit of the stamps, of dates in seconds.
    tracks : int
        How many tracks there are, those without a row included.
    """

    track: Ints
    step: Ints
    time: Floats
    tracks: int

    @cached_property
    def first(self) -> Mask:
        """Whether each is the first of its track."""
        return np.append(True, self.track[1:] != self.track[:-1])[: len(self.track)]

    @cached_property
    def last(self) -> Mask:
        """Whether each is the last of its track."""
        return np.append(self.first[1:], True)[: len(self.track)]

    def per_track(self, chosen: Mask | slice = slice(None)) -> Ints:
        """How many of the chosen rows each track has."""
        return np.bincount(self.track[chosen], minlength=self.tracks)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracked:
    """Evaluations on the same steps as the summary reads them; tracks are numbered on.

    Parameters
    ----------
    truth, estimate : SideRows
        States of either side.
    at, to : (N,) int arrays
        Their rows, of each assigned pair, by truth and time.
    weight, error : (N,) float arrays
        How much of the pair is assigned, and the base distance.
    difference : (N, q) float array
        Estimate less truth by axis; those of the place are the first.
    velocity : (N, k) float array
        Of the place of the truth, NaN where it is not known.
    velocity_error : (N,) float array
        Length of the difference of the velocities of the states, NaN where they have none.
    bends : (M, 2) float array
        Squared second differences of estimate and truth, where one pair goes on for three steps
        that are equally far apart.
    axes : tuple of str
        Names of the q axes.
    """

    truth: SideRows
    estimate: SideRows
    at: Ints
    to: Ints
    weight: Floats
    error: Floats
    difference: Floats
    velocity: Floats
    velocity_error: Floats
    bends: Floats
    axes: tuple[str, ...]

    @classmethod
    @np.errstate(over="ignore", invalid="ignore")  # of states that nobody has
    def of(cls, proof: PairProof) -> "Tracked":
        """Read one evaluation."""
        compared, problem, order = proof.compared, proof.states.problem, proof.parameters.order
        pairs = read_assigned(proof.states, proof.weights)
        rows = problem.truth_row[pairs.entry], problem.estimate_row[pairs.entry]
        states = compared.truth[rows[0]], compared.estimate[rows[1]]
        if compared.held is not None:  # on a common clock a report is judged at its own time
            names = np.array(compared.labels.truths, dtype=object)
            located = compared.held.located(names[problem.sides[0].track[rows[0]]], rows[1])
            states = located[0].state, located[1].state
        judged: Sequence[Mask | slice] = (slice(None), slice(None))
        if problem.unjudged is not None:
            judged = judged_rows(proof.states, proof.weights)
        is_date = isinstance(next(iter(compared.labels.times), 0), str)
        moments = (compared.moments - compared.moments[:1]) / (SECOND if is_date else 1)
        sides, ordered, placed = [], [], []
        for side, mask, own in zip(problem.sides, judged, rows, strict=True):
            chosen = np.arange(len(side.step))[mask]
            chosen = chosen[np.lexsort((side.step[chosen], side.track[chosen]))]
            place = np.full(len(side.step), -1)
            place[chosen] = np.arange(len(chosen))
            step = side.step[chosen]
            sides.append(
                SideRows(track=side.track[chosen], step=step, time=moments[step], tracks=side.count)
            )
            ordered.append(chosen)
            placed.append(place[own])
        at, to = placed
        kept = np.flatnonzero((at >= 0) & (to >= 0))
        kept = kept[np.lexsort((to[kept], at[kept]))]
        at, to = at[kept], to[kept]
        pair = states[0][kept], states[1][kept]
        axes = Axes(compared)
        bends = np.zeros((0, 2))
        if compared.held is None:  # a report that holds for several steps does not move
            bends = axes.bends(sides[0], at, sides[1].track[to], pair)
        return cls(
            truth=sides[0],
            estimate=sides[1],
            at=at,
            to=to,
            weight=pairs.weight[kept],
            error=proof.parameters.cutoff * problem.powers(pairs.entry[kept]) ** (1 / order),
            difference=axes.between(*pair),
            velocity=axes.velocity(compared.truth[ordered[0]], sides[0])[at],
            velocity_error=axes.velocity_errors(*pair),
            bends=bends,
            axes=axes.names,
        )

    @classmethod
    def joined(cls, several: "Sequence[Tracked]") -> "Tracked":
        """Several evaluations on the same steps as one."""
        if len(several) == 1:
            return several[0]

        def joined(name: str) -> tuple[SideRows, Ints]:
            """The rows of one side, and how many rows come before those of each evaluation."""
            each: list[SideRows] = [getattr(one, name) for one in several]
            tracks = np.cumsum([0, *(rows.tracks for rows in each)])
            made = SideRows(
                track=np.concatenate(
                    [rows.track + k for rows, k in zip(each, tracks[:-1], strict=True)]
                ),
                step=np.concatenate([rows.step for rows in each]),
                time=np.concatenate([rows.time for rows in each]),
                tracks=int(tracks[-1]),
            )
            return made, np.cumsum([0, *(len(rows.track) for rows in each)])[:-1]

        def together(name: str, shift: Ints | None = None) -> Any:
            columns = [getattr(one, name) for one in several]
            shifts = shift if shift is not None else np.zeros(len(several), np.int64)
            return np.concatenate([column + k for column, k in zip(columns, shifts, strict=True)])

        (truth, before), (estimate, before_estimate) = joined("truth"), joined("estimate")
        return cls(
            truth=truth,
            estimate=estimate,
            at=together("at", before),
            to=together("to", before_estimate),
            weight=together("weight"),
            error=together("error"),
            difference=together("difference"),
            velocity=together("velocity"),
            velocity_error=together("velocity_error"),
            bends=together("bends"),
            axes=several[0].axes,
        )


class Axes:
    """The axes of states: those of the place first, on the Earth east and north in metres."""

    def __init__(self, compared: ComparedSides) -> None:
        columns = compared.columns
        self.is_box, self.on_earth = columns == BOX, set(PLACES) <= set(columns)
        place = [c for c in ("lon", "lat", HEIGHT) if c in columns] if self.on_earth else []
        place = place or [name for name in ("x", "y", "z") if name in columns] or [*columns]
        if self.is_box:
            place = [*columns[:2]]
        names = place + [name for name in columns if name not in place]
        self.places, self.chosen = len(place), [columns.index(name) for name in names]
        spoken = {"lon": "east", "lat": "north", HEIGHT: "up"} if self.on_earth else {}
        if self.is_box:
            spoken = {"left": "x", "top": "y"}
        self.names = tuple(spoken.get(name, name) for name in names)
        self.speeds = [columns.index(name) for name in VELOCITY if name in columns]
        periodic = compared.settings.get("periodic")
        periods = dict(periodic) if isinstance(periodic, dict) else {}
        periods |= {"lon": TURN} if self.on_earth else {}
        self.periods = [periods.get(name, np.inf) for name in names] if periods else None

    def between(self, first: Floats, second: Floats) -> Floats:
        """Second less first states (N, d), by axis, (N, q)."""
        difference = apart((second - first)[:, self.chosen], self.periods)
        if self.is_box:  # the place of a box is its centre
            difference[:, :2] += 0.5 * difference[:, 2:]
        if self.on_earth:
            from tgospa_eval.distances.sphere import RADIUS  # lazy: most states are others

            latitude = 0.5 * (first + second)[:, self.chosen[1]]
            difference[:, :2] *= np.radians(RADIUS)
            difference[:, 0] *= np.cos(np.radians(latitude))
        return difference

    def velocity_errors(self, first: Floats, second: Floats) -> Floats:
        """Lengths of differences of velocities (N,), NaN where the states have none."""
        if not self.speeds:
            return np.full(len(first), np.nan)
        return np.asarray(np.linalg.norm((second - first)[:, self.speeds], axis=1))

    def velocity(self, states: Floats, rows: SideRows) -> Floats:
        """Of the place of each row (R, k): that of the state, or from its neighbours in time."""
        if not self.on_earth and len(self.speeds) == self.places:
            return states[:, self.speeds]
        number = np.arange(len(states))
        before, after = number - ~rows.first, number + ~rows.last
        span = rows.time[after] - rows.time[before]
        way = self.between(states[before], states[after])[:, : self.places]
        velocity = np.full(way.shape, np.nan)
        velocity[span > 0] = way[span > 0] / span[span > 0, None]
        return velocity

    def bends(self, rows: SideRows, at: Ints, track: Ints, pair: tuple[Floats, Floats]) -> Floats:
        """Squared second differences of estimate and truth, (M, 2), as of `Tracked`."""
        on = (np.diff(at) == 1) & (np.diff(track) == 0) & (np.diff(rows.track[at]) == 0)
        span = np.diff(rows.time[at])
        alike = np.abs(np.diff(span)) <= ALIKE * np.abs(span[1:])
        start = np.flatnonzero(on[:-1] & on[1:] & alike)
        found = []
        for states in pair[::-1]:
            steps = self.between(states[:-1], states[1:])[:, : self.places]
            bend = steps[start + 1] - steps[start]
            found.append((bend * bend).sum(axis=1))
        return np.stack(found, axis=1)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # of states that nobody has
def summarise(evaluation: Evaluation, tracked: Tracked) -> Summary:
    """The summary of an evaluation, given its states and pairs."""
    horizon = evaluation.evaluated_on.each
    truth, estimate, weight = tracked.truth, tracked.estimate, tracked.weight
    whose, who = truth.track[tracked.at], estimate.track[tracked.to]
    assigned, states = float(weight.sum()), (truth.per_track(), estimate.per_track())
    followed = tuple(
        sum_by(index, weight, rows.tracks) for index, rows in ((whose, truth), (who, estimate))
    )
    share = followed[0] / states[0]
    there = states[0] > 0
    # Of each pair of tracks how long it is assigned.
    order = np.lexsort((who, whose))
    opens = np.flatnonzero(np.diff(whose[order], prepend=-1) | np.diff(who[order], prepend=-1))
    both = np.add.reduceat(weight[order], opens) if len(opens) else np.zeros(0)
    main = [np.zeros(rows.tracks) for rows in (truth, estimate)]
    np.maximum.at(main[0], whose[order[opens]], both)
    np.maximum.at(main[1], who[order[opens]], both)
    stretches = _stretches(tracked)
    false = (states[1] > 0) & (followed[1] == 0)
    steps = int(max(truth.step.max(initial=-1), estimate.step.max(initial=-1))) + 1
    ones = np.ones(len(estimate.step)), np.ones(len(truth.step))
    surplus = sum_by(estimate.step, ones[0], steps) - sum_by(truth.step, ones[1], steps)
    squares = sum_by(whose, weight * tracked.error**2, truth.tracks)
    squares_of_estimates = sum_by(who, weight * tracked.error**2, estimate.tracks)
    numbers: Json = {
        "assigned_states": assigned,
        "truth_states": len(truth.track),
        "estimate_states": len(estimate.track),
        "detection_rate": ratio(assigned, len(truth.track)),
        "precision": ratio(assigned, len(estimate.track)),
        **_errors(tracked),
        **evaluation.tracked_shares.counts(share),
        "purity": ratio(float(main[1].sum()), assigned),
        "completeness": ratio(float(main[0].sum()), len(truth.track)),
        "fragments": int(stretches.fragments.sum()),
        "longest_stretch": int(stretches.longest.max(initial=0)),
        "switches_per_truth": ratio(evaluation.counts["switch"], int(there.sum())),
        "never_tracked": int(np.isnan(stretches.delay[there]).sum()),
        "time_to_first": mean(stretches.delay[there]),
        "breaks": stretches.breaks,
        "mean_time_between_breaks": ratio(stretches.time, stretches.breaks),
        "false_tracks": int(false.sum()),
        "false_tracks_per_step": ratio(float(states[1][false].sum()), horizon),
        "false_track_length": mean(states[1][false]),
        "cardinality_error": ratio(float(surplus.sum()), horizon),
        "cardinality_mean_absolute": ratio(float(np.abs(surplus).sum()), horizon),
        "cardinality_rms": root(ratio(float((surplus**2).sum()), horizon)),
        "smoothness": _smoothness(tracked),
        "siap": _siap(tracked),
    }
    per_truth = {
        "followed": share,
        "completeness": main[0] / states[0],
        "rmse": np.sqrt(squares / followed[0]),
        "fragments": stretches.fragments,
        "longest_stretch": stretches.longest,
        "time_to_first": stretches.delay,
    }
    per_estimate = {
        "assigned": followed[1] / states[1],
        "purity": main[1] / followed[1],
        "rmse": np.sqrt(squares_of_estimates / followed[1]),
    }
    return Summary(numbers=finite(numbers), per_truth=per_truth, per_estimate=per_estimate)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stretches:
    """Followed stretches of the truths: interruptions, longest, delay of each, and all breaks.

    `time` is that of all followed states up to the next one of their truth.
    """

    fragments: Ints
    longest: Ints
    delay: Floats
    breaks: int
    time: float


def _stretches(tracked: Tracked) -> _Stretches:
    """Where truths are followed, and by whom: by the estimate with the largest weight."""
    truth, at, size = tracked.truth, tracked.at, len(tracked.truth.track)
    is_followed = sum_by(at, tracked.weight, size) >= HALF
    who = np.full(size, -1)
    last = np.lexsort((tracked.weight, at))  # the last one of a row stays
    who[at[last]] = tracked.estimate.track[tracked.to[last]]
    goes_on = np.zeros(size, bool)
    goes_on[1:] = is_followed[1:] & is_followed[:-1] & ~truth.first[1:]
    begins = is_followed & ~goes_on
    count = truth.per_track(begins)
    longest = np.zeros(truth.tracks, np.int64)
    run = np.cumsum(begins)[is_followed] - 1
    np.maximum.at(longest, truth.track[begins], np.bincount(run, minlength=int(begins.sum())))
    delay = np.full(truth.tracks, np.nan)
    first = np.flatnonzero(begins)[::-1]  # the earliest is written last
    delay[truth.track[first]] = truth.time[first]
    start = np.zeros(truth.tracks)
    start[truth.track[truth.first]] = truth.time[truth.first]
    same = goes_on.copy()
    same[1:] &= who[1:] == who[:-1]
    ends = is_followed & ~np.append(same[1:], False)[:size]
    held = is_followed & ~truth.last
    following = np.append(truth.time[1:], 0.0)[:size]
    return _Stretches(
        fragments=np.maximum(count - 1, 0),
        longest=longest,
        delay=delay - start,
        breaks=int(np.count_nonzero(ends & ~truth.last)),
        time=float((following - truth.time)[held].sum()),
    )


def _errors(tracked: Tracked) -> Json:
    """Errors of assigned states: of the base distance, by axis, along and across the track."""
    weight, error = tracked.weight, tracked.error
    total = float(weight.sum())
    if not total:
        names = ("rmse", "mean_error", "median_error", "p95_error", "rmse_by_axis")
        return dict.fromkeys((*names, "rmse_along_track", "rmse_across_track", "latency"))
    order = np.argsort(error, kind="stable")
    sums = np.cumsum(weight[order])
    quantile = [
        float(error[order[min(int(np.searchsorted(sums, q * total)), len(order) - 1)]])
        for q in (0.5, 0.95)
    ]
    by_axis = rms(weight, tracked.difference).tolist()
    return {
        "rmse": float(rms(weight, error[:, None])[0]),
        "mean_error": float(weight @ error / total),
        "median_error": quantile[0],
        "p95_error": quantile[1],
        "rmse_by_axis": dict(zip(tracked.axes, by_axis, strict=True)),
        **_along(tracked),
    }


def rms(weight: Floats, values: Floats) -> Floats:
    """Root mean squares of columns (N, q), whose squares may overflow."""
    scale = np.maximum(np.abs(values).max(axis=0, initial=0.0), np.finfo(float).tiny)
    return np.asarray(scale * np.sqrt(weight @ (values / scale) ** 2 / weight.sum()))


def _along(tracked: Tracked) -> Json:
    """Errors along and across the way of the truth, and the shift in time that fits best.

    An estimate that is late by L is L v behind a truth of velocity v: the latency is the L that
    makes the sum of squares of ``e + L v`` least, and its gain the share of the sum of squares of
    the errors e that goes by it.
    """
    speed = np.linalg.norm(tracked.velocity, axis=1)
    known = np.flatnonzero(speed > 0)
    weight, velocity = tracked.weight[known], tracked.velocity[known]
    place = tracked.difference[known, : velocity.shape[1]]
    total, way = float(weight.sum()), (place * velocity).sum(axis=1)
    if not total:
        return dict.fromkeys(("rmse_along_track", "rmse_across_track", "latency"))
    squares, along = (place * place).sum(axis=1), way / speed[known]
    across = np.maximum(squares - along * along, 0.0)
    moved, error = float(weight @ speed[known] ** 2), float(weight @ squares)
    shift = -float(weight @ way) / moved
    return {
        "rmse_along_track": float(np.sqrt(weight @ along**2 / total)),
        "rmse_across_track": float(np.sqrt(weight @ across / total))
        if velocity.shape[1] > 1
        else None,
        "latency": {"shift": shift, "gain": shift * shift * moved / error if error else 0.0},
    }


def _smoothness(tracked: Tracked) -> Json | None:
    """Root mean squares of second differences of estimates and truths; None if there are none."""
    if not len(tracked.bends):
        return None
    estimate, truth = np.sqrt(tracked.bends.mean(axis=0)).tolist()
    return {"estimate": estimate, "truth": truth}


def _siap(tracked: Tracked) -> Json:
    """Metrics of the Single Integrated Air Picture (Votruba et al. 2001), of unweighted pairs.

    An association is a stretch of states of a truth at which one estimate is assigned to it; the
    longest segment is the time of all of one estimate, as Stone Soup counts it.
    """
    truth, estimate, at, to = tracked.truth, tracked.estimate, tracked.at, tracked.to
    who = estimate.track[to]
    order = np.lexsort((at, who))
    row, track = at[order], who[order]
    on = np.zeros(len(row), bool)
    on[1:] = (np.diff(row) == 1) & (np.diff(track) == 0) & ~truth.first[row[1:]]
    begin = np.flatnonzero(~on)
    end = np.append(begin, len(row))[1:] - 1
    first, last = row[begin], row[end]
    spans = np.diff(truth.time, prepend=0.0)
    whose = truth.track[row]
    pair = np.flatnonzero((np.diff(track, prepend=-1) != 0) | (np.diff(whose, prepend=-1) != 0))
    longest = np.zeros(truth.tracks)
    if len(pair):
        np.maximum.at(longest, whose[pair], np.add.reduceat(spans[row] * on, pair))
    held = np.zeros(len(truth.track), bool)
    held[row[on]] = True
    lives = float((truth.time[truth.last] - truth.time[truth.first]).sum())
    tracked_time = float(spans[held].sum())
    distinct = [int(np.count_nonzero(np.bincount(own))) for own in (at, to)]
    needed = _needed(first, last, truth)
    changes = int(np.maximum(needed - 1, 0).sum())
    place = tracked.difference[:, : tracked.velocity.shape[1]]
    error = np.linalg.norm(place, axis=1) if place.shape[1] > 1 else np.abs(place[:, 0])
    return {
        "completeness": ratio(distinct[0], len(truth.track)),
        "ambiguity": ratio(distinct[1], distinct[0]),
        "spuriousness": ratio(len(estimate.track) - distinct[1], len(estimate.track)),
        "positional_accuracy": ratio(float(error.sum()), distinct[1]),
        "velocity_accuracy": None
        if np.isnan(tracked.velocity_error).any()
        else ratio(float(tracked.velocity_error.sum()), distinct[1]),
        "track_number_change_rate": ratio(changes, tracked_time),
        "longest_track_segment": ratio(float(longest.sum()), lives),
    }


def _needed(begin: Ints, end: Ints, truth: SideRows) -> Ints:
    """How many associations, from row to row, it takes to follow each truth as far as they go."""
    order = np.lexsort((end, begin))
    begin, end = begin[order], end[order]
    furthest = np.maximum.accumulate(end) if len(end) else end
    if (begin[1:] > furthest[:-1]).all():  # as all are but of mixed assignments
        return np.bincount(truth.track[begin], minlength=truth.tracks)
    needed = np.zeros(truth.tracks, np.int64)
    spans, k, best, covered = list(zip(begin.tolist(), end.tolist(), strict=True)), 0, -1, -1
    while k < len(spans) or best > covered:
        row = covered + 1 if best > covered else max(covered + 1, spans[k][0])
        while k < len(spans) and spans[k][0] <= row:
            best, k = max(best, spans[k][1]), k + 1
        if best > covered:  # the one that goes on longest from here
            needed[truth.track[row]] += 1
            covered = best
    return needed
