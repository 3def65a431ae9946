"""Common tracking numbers of the proven assignment (docs/reference/summary.md).

The numbers are detection rate, errors, followed objects, breaks, false tracks, cardinality and
SIAP. A pair counts by its weight, which is 1 except in mixed assignments. An object is followed at
a step if the weights of its pairs sum to one half or more.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.evaluation.axis import TURN, shortest_differences
from tgospa_eval.formats.headers import BOX
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.solution import evaluated_rows
from tgospa_eval.problem.states import ONE, assigned
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import ComparedSides, Json, PairProof
from tgospa_eval.results.summary import Summary, finite, mean, ratio, root
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.trajectories import HEIGHT, PLACES

Sums: TypeAlias = Mapping[str, Any]
"""Numbers and arrays that add up, by name."""

HALF = 0.5 - 1e-9
"""Smallest weight with which an object counts as followed, with room for rounding."""

ROUNDED = 1e-12
"""Margin for the rounding of a sum of weights, as a share of the sum of all weights."""

ALIKE = 1e-6
"""Largest relative difference of two spans of time that count as equal."""

VELOCITY = ("vx", "vy", "vz")

PAIRS_TOGETHER = 1 << 16
"""Number of pairs whose states are processed together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SideRows:
    """Evaluated states of the truth or of the estimate, sorted by track and then by time.

    Parameters
    ----------
    track, step : (R,) int arrays
        Track and step of each state.
    tracks : int
        Number of tracks, including tracks without a row.
    """

    track: Ints
    step: Ints
    tracks: int

    @cached_property
    def first(self) -> Mask:
        """Mask of the rows that are the first of their track."""
        return np.append(True, self.track[1:] != self.track[:-1])[: len(self.track)]

    @cached_property
    def last(self) -> Mask:
        """Mask of the rows that are the last of their track."""
        return np.append(self.first[1:], True)[: len(self.track)]

    def per_track(self, chosen: Mask | slice = slice(None)) -> Ints:
        """Return the number of chosen rows of each track."""
        return np.bincount(self.track[chosen], minlength=self.tracks)

    @classmethod
    def joined(cls, several: "Sequence[SideRows]") -> "tuple[SideRows, Ints]":
        """Return all tracks under new indices, and the number of rows before each part."""
        tracks, sizes = (
            np.cumsum([0, *counts])
            for counts in ([one.tracks for one in several], [len(one.track) for one in several])
        )
        track = [one.track + k for one, k in zip(several, tracks[:-1], strict=True)]
        step = [one.step for one in several]
        rows = cls(track=np.concatenate(track), step=np.concatenate(step), tracks=int(tracks[-1]))
        return rows, sizes[:-1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracked:
    """One evaluation, or several on the same steps, in the form that the summary reads.

    Parameters
    ----------
    truth, estimate : SideRows
        Evaluated states of the truth, and of the estimate.
    timestamps : (T,) float array
        Time of each step since the first one, in seconds or the unit of the timestamps.
    at, to : (N,) int arrays
        Row of the truth, and row of the estimate, of each assigned pair. Pairs are sorted by row of
        the truth.
    weight, error : (N,) float arrays
        Assigned weight and base distance of each pair.
    axes : Axes
        Axes of the states.
    sums : dict of str to float or array
        Sums over the pairs (see `Axes.sums`).
    """

    truth: SideRows
    estimate: SideRows
    timestamps: Floats
    at: Ints
    to: Ints
    weight: Floats
    error: Floats
    axes: "Axes"
    sums: Sums

    @classmethod
    @np.errstate(over="ignore", invalid="ignore")  # extreme states overflow
    def of(cls, proof: PairProof) -> "Tracked":
        """Return one evaluation in the form that the summary reads."""
        compared, problem, order = proof.compared, proof.states.problem, proof.parameters.order
        evaluated: Sequence[Mask | slice] = (slice(None), slice(None))
        if problem.unjudged is not None:
            evaluated = evaluated_rows(proof.states, proof.weights)
        sides, rows, places = [], [], []
        for side, mask in zip(problem.sides, evaluated, strict=True):
            chosen = np.arange(len(side.step), dtype=side.step.dtype)[mask]
            chosen = chosen[np.argsort(side.track[chosen], kind="stable")]  # steps stay in order
            place = np.full(len(side.step), -1, side.step.dtype)
            place[chosen] = np.arange(len(chosen), dtype=place.dtype)
            step = side.step[chosen]
            sides.append(SideRows(track=side.track[chosen], step=step, tracks=side.count))
            rows.append(chosen)
            places.append(place)
        _, entry, used = assigned(proof.states, proof.weights)
        at, to = places[0][problem.truth_row[entry]], places[1][problem.estimate_row[entry]]
        kept = np.flatnonzero((at >= 0) & (to >= 0))
        kept = kept[np.lexsort((to[kept], at[kept]))]
        at, to, entry = at[kept], to[kept], entry[kept]
        is_date = isinstance(next(iter(compared.labels.times), 0), str)
        timestamps = (compared.timestamps - compared.timestamps[:1]) / (SECOND if is_date else 1)
        weight = used[kept] / ONE
        axes = Axes(compared)
        return cls(
            truth=sides[0],
            estimate=sides[1],
            timestamps=timestamps,
            at=at,
            to=to,
            weight=weight,
            error=proof.parameters.cutoff * problem.powers(entry) ** (1 / order),
            axes=axes,
            sums=axes.sums(compared, sides, rows, timestamps, (at, to, weight)),
        )

    @classmethod
    def joined(cls, several: "Sequence[Tracked]") -> "Tracked":
        """Join several evaluations on the same steps; tracks get new indices."""
        truth, before_truth = SideRows.joined([one.truth for one in several])
        estimate, before_estimate = SideRows.joined([one.estimate for one in several])
        at = [one.at + k for one, k in zip(several, before_truth, strict=True)]
        to = [one.to + k for one, k in zip(several, before_estimate, strict=True)]
        first = several[0]
        return cls(
            truth=truth,
            estimate=estimate,
            timestamps=first.timestamps,
            at=np.concatenate(at),
            to=np.concatenate(to),
            weight=np.concatenate([one.weight for one in several]),
            error=np.concatenate([one.error for one in several]),
            axes=first.axes,
            sums={name: sum(one.sums[name] for one in several) for name in first.sums},
        )


class Axes:
    """Axes along which errors are reported; those of the position come first.

    On the Earth, the first two are east and north, in metres.
    """

    def __init__(self, compared: ComparedSides) -> None:
        columns = compared.columns
        self.is_box, self.on_earth = columns == BOX, set(PLACES) <= set(columns)
        place = [c for c in ("lon", "lat", HEIGHT) if c in columns] if self.on_earth else []
        place = place or [name for name in ("x", "y", "z") if name in columns] or [*columns]
        if self.is_box:
            place = [*columns[:2]]
        names = place + [name for name in columns if name not in place]
        self.places, self.chosen = len(place), [columns.index(name) for name in names]
        renamed = {"lon": "east", "lat": "north", HEIGHT: "up"} if self.on_earth else {}
        if self.is_box:
            renamed = {"left": "x", "top": "y"}
        self.names = tuple(renamed.get(name, name) for name in names)
        self.speeds = [columns.index(name) for name in VELOCITY if name in columns]
        periodic = compared.settings.get("periodic")
        periods = dict(periodic) if isinstance(periodic, dict) else {}
        periods |= {"lon": TURN} if self.on_earth else {}
        self.periods = [periods.get(name, np.inf) for name in names] if periods else None

    def between(self, first: Floats, second: Floats) -> Floats:
        """Return the differences ``second - first`` of states (N, d) along all q axes, (N, q)."""
        difference = shortest_differences((second - first)[:, self.chosen], self.periods)
        if self.is_box:  # the position of a box is its centre
            difference[:, :2] += 0.5 * difference[:, 2:]
        if self.on_earth:
            from tgospa_eval.distances.sphere import RADIUS  # lazy: rarely needed

            latitude = 0.5 * (first + second)[:, self.chosen[1]]
            difference[:, :2] *= np.radians(RADIUS)
            difference[:, 0] *= np.cos(np.radians(latitude))
        return difference

    def sums(
        self,
        compared: ComparedSides,
        sides: Sequence[SideRows],
        rows: Sequence[Ints],
        timestamps: Floats,
        pairs: tuple[Ints, Ints, Floats],
    ) -> Sums:
        """Return sums over the assigned pairs, computed part by part to save memory.

        Parameters
        ----------
        compared : ComparedSides
            States.
        sides : pair of SideRows
            Truth and estimate.
        rows : pair of (R,) int arrays
            Indices of the rows of each side among the states.
        timestamps : (T,) float array
            Times of the steps.
        pairs : tuple of (N,) arrays
            Row of the truth, row of the estimate, and weight of each pair, sorted by row of the
            truth.
        """
        at, to, weight = pairs
        truth, places = sides[0], self.places
        sums: dict[str, Any] = {"axes": np.zeros(len(self.names)), "bends": np.zeros(2)}
        sums |= dict.fromkeys(SUMMED, 0.0)
        for begin in range(0, len(at), PAIRS_TOGETHER):
            own = slice(begin, begin + PAIRS_TOGETHER + 2)  # second differences need two more pairs
            row, report = at[own], rows[1][to[own]]
            states = compared.truth[rows[0][row]], compared.estimate[report]
            if (
                compared.reports is not None
            ):  # on a common clock, errors are those at the time of the report
                names = np.array(compared.labels.truths, dtype=object)[truth.track[row]]
                located = compared.reports.located(names, report)
                states = located[0].state, located[1].state
            else:  # no second differences on a common clock, where a report stays for several steps
                time, who = timestamps[truth.step[row]], sides[1].track[to[own]]
                on = (np.diff(row) == 1) & (np.diff(who) == 0) & ~truth.first[row[1:]]
                span = np.diff(time)
                alike = np.abs(np.diff(span)) <= ALIKE * np.abs(span[1:])
                start = np.flatnonzero(on[:-1] & on[1:] & alike)
                steps = [self.between(s[:-1], s[1:])[:, :places] for s in states[::-1]]
                bends = (step[start + 1] - step[start] for step in steps)
                sums["bends"] += [float((bend * bend).sum()) for bend in bends]
                sums["bent"] += len(start)
            row, weights = row[:PAIRS_TOGETHER], weight[own][:PAIRS_TOGETHER]
            first, second = (side[:PAIRS_TOGETHER] for side in states)
            difference = self.between(first, second)
            sums["axes"] += weights @ difference**2
            place = difference[:, :places]
            squares = (place * place).sum(axis=1)
            sums["places"] += float(np.sqrt(squares).sum())
            sums["velocities"] += float(
                np.linalg.norm((second - first)[:, self.speeds], axis=1).sum()
            )
            velocity = self._velocity(compared.truth, rows[0], truth, timestamps, row)
            speeds = (velocity * velocity).sum(axis=1)
            known = speeds > 0
            w, way = weights[known], (place[known] * velocity[known]).sum(axis=1)
            sums["moving"] += float(w.sum())
            sums["along"] += float(w @ (way * way / speeds[known]))
            sums["way"] += float(w @ way)
            sums["speeds"] += float(w @ speeds[known])
            sums["squares"] += float(w @ squares[known])
        return sums

    def _velocity(
        self, states: Floats, rows: Ints, truth: SideRows, timestamps: Floats, at: Ints
    ) -> Floats:
        """Return velocities of some rows of the truth (N, k), NaN where they are unknown.

        Velocities in the states are used if there is one for each axis of the position. Otherwise,
        and always on the Earth, velocities follow from the positions in the rows before and after.
        """
        if not self.on_earth and len(self.speeds) == self.places:
            return states[rows[at]][:, self.speeds]
        before, after = at - ~truth.first[at], at + ~truth.last[at]
        span = timestamps[truth.step[after]] - timestamps[truth.step[before]]
        way = self.between(states[rows[before]], states[rows[after]])[:, : self.places]
        velocity = np.full(way.shape, np.nan)
        velocity[span > 0] = way[span > 0] / span[span > 0, None]
        return velocity


SUMMED = ("bent", "places", "velocities", "moving", "along", "way", "speeds", "squares")
"""Names of the sums of `Axes.sums` that are numbers, not arrays."""


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # extreme states overflow
def summarise(evaluation: Evaluation, tracked: Tracked) -> Summary:
    """Return the summary of an evaluation, given its states and pairs."""
    count = max(len(tracked.timestamps), 1)
    truth, estimate, weight = tracked.truth, tracked.estimate, tracked.weight
    whose, who = truth.track[tracked.at], estimate.track[tracked.to]
    assigned, states = float(weight.sum()), (truth.per_track(), estimate.per_track())
    followed = tuple(
        sum_by(index, weight, rows.tracks) for index, rows in ((whose, truth), (who, estimate))
    )
    share = followed[0] / states[0]
    there = states[0] > 0
    main = [np.zeros(rows.tracks) for rows in (truth, estimate)]
    *pair, together = _grouped(whose, who, weight)
    for largest, track in zip(main, pair, strict=True):
        np.maximum.at(largest, track, together)
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
        "false_tracks_per_step": ratio(float(states[1][false].sum()), count),
        "false_track_length": mean(states[1][false]),
        "cardinality_error": ratio(float(surplus.sum()), count),
        "cardinality_mean_absolute": ratio(float(np.abs(surplus).sum()), count),
        "cardinality_rms": root(ratio(float((surplus**2).sum()), count)),
        "smoothness": _smoothness(tracked.sums),
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
    """Numbers of the stretches of steps at which true objects are followed.

    Parameters
    ----------
    fragments : int array
        Number of interruptions of each object.
    longest : int array
        Number of steps of the longest stretch of each object.
    delay : float array
        Time until each object is followed for the first time, NaN if it never is.
    breaks : int
        Number of ends of stretches before the last state of the object, plus number of changes to
        another estimate inside stretches.
    time : float
        Sum of the times from each followed state to the next state of the same object.
    """

    fragments: Ints
    longest: Ints
    delay: Floats
    breaks: int
    time: float


def _stretches(tracked: Tracked) -> _Stretches:
    """Return the followed stretches; among several estimates, the largest weight decides."""
    truth, at, size = tracked.truth, tracked.at, len(tracked.truth.track)
    time = tracked.timestamps[truth.step]
    is_followed = sum_by(at, tracked.weight, size) >= HALF
    who = np.full(size, -1)
    last = slice(None) if (np.diff(at) > 0).all() else np.lexsort((tracked.weight, at))
    who[at[last]] = tracked.estimate.track[tracked.to[last]]  # the last value for a row stays
    goes_on = np.zeros(size, bool)
    goes_on[1:] = is_followed[1:] & is_followed[:-1] & ~truth.first[1:]
    begins = is_followed & ~goes_on
    count = truth.per_track(begins)
    longest = np.zeros(truth.tracks, np.int64)
    run = np.cumsum(begins)[is_followed] - 1
    np.maximum.at(longest, truth.track[begins], np.bincount(run, minlength=int(begins.sum())))
    delay = np.full(truth.tracks, np.nan)
    first = np.flatnonzero(begins)[::-1]  # the earliest value is written last, so it stays
    delay[truth.track[first]] = time[first]
    start = np.zeros(truth.tracks)
    start[truth.track[truth.first]] = time[truth.first]
    same = goes_on.copy()
    same[1:] &= who[1:] == who[:-1]
    ends = is_followed & ~np.append(same[1:], False)[:size]
    is_kept = is_followed & ~truth.last
    following = np.append(time[1:], 0.0)[:size]
    return _Stretches(
        fragments=np.maximum(count - 1, 0),
        longest=longest,
        delay=delay - start,
        breaks=int(np.count_nonzero(ends & ~truth.last)),
        time=float((following - time)[is_kept].sum()),
    )


def _grouped(whose: Ints, who: Ints, weight: Floats) -> tuple[Ints, Ints, Floats]:
    """Return the distinct pairs of tracks, and the sum of the weights of each.

    `whose` and `who` are the tracks of truth and estimate of each pair of states, sorted by row of
    the truth.
    """
    for _ in range(2):  # the first pass joins neighbours, so few pairs are left to sort
        opens = np.flatnonzero((np.diff(whose, prepend=-1) != 0) | (np.diff(who, prepend=-1) != 0))
        sums = np.add.reduceat(weight, opens) if len(opens) else np.zeros(0)
        whose, who = whose[opens], who[opens]
        order = np.lexsort((who, whose))
        whose, who, weight = whose[order], who[order], sums[order]
    return whose, who, weight


def _errors(tracked: Tracked) -> Json:
    """Return errors of assigned states, and the latency of the estimate.

    Errors are in the base distance, by axis, along the track and across the track. Let e be the
    error of a pair, and v the velocity of its true object. An estimate with the latency L is L v
    behind the object. So the latency is the L with the smallest sum of the squares of ``e + L v``.
    The gain of the latency is the share by which this sum is smaller than for L = 0.
    """
    weight, error, sums = tracked.weight, tracked.error, tracked.sums
    total = float(weight.sum())
    if not total:
        names = ("rmse", "mean_error", "median_error", "p95_error", "rmse_by_axis")
        return dict.fromkeys((*names, "rmse_along_track", "rmse_across_track", "latency"))
    shares = np.array([0.5 - ROUNDED, 0.5 + ROUNDED, 0.95]) * total
    if (weight == 1).all():
        places = np.ceil(shares).astype(np.int64) - 1
        low, high, p95 = np.partition(error, places)[places].tolist()
    else:
        order = np.argsort(error, kind="stable")
        places = np.searchsorted(np.cumsum(weight[order]), shares).clip(max=len(order) - 1)
        low, high, p95 = error[order[places]].tolist()
    scale = max(float(error.max()), np.finfo(float).tiny)  # squares may overflow
    moving, gain, latency = sums["moving"], 0.0, None
    if moving:
        shift = -sums["way"] / sums["speeds"]
        if sums["squares"]:
            gain = min(shift * shift * sums["speeds"] / sums["squares"], 1.0)
        latency = {"shift": shift, "gain": gain}
    across = max(sums["squares"] - sums["along"], 0.0)
    return {
        "rmse": scale * math.sqrt(float(weight @ (error / scale) ** 2) / total),
        "mean_error": float(weight @ error / total),
        "median_error": 0.5 * low + 0.5 * high,
        "p95_error": p95,
        "rmse_by_axis": dict(
            zip(tracked.axes.names, np.sqrt(sums["axes"] / total).tolist(), strict=True)
        ),
        "rmse_along_track": root(ratio(sums["along"], moving)),
        "rmse_across_track": root(ratio(across, moving)) if tracked.axes.places > 1 else None,
        "latency": latency,
    }


def _smoothness(sums: Sums) -> Json | None:
    """Return the root mean square second difference of positions, for truth and estimate.

    The result is None if there are no second differences.
    """
    if not sums["bent"]:
        return None
    estimate, truth = np.sqrt(sums["bends"] / sums["bent"]).tolist()
    return {"estimate": estimate, "truth": truth}


def _siap(tracked: Tracked) -> Json:
    """Compute the metrics of the Single Integrated Air Picture (Votruba et al. 2001).

    An association is a run of consecutive states of a true object to which the same estimate is
    assigned. The longest segment of an object is, as in Stone Soup, the largest total time for
    which one and the same estimate is assigned to it.
    """
    truth, estimate, at, to = tracked.truth, tracked.estimate, tracked.at, tracked.to
    time = tracked.timestamps[truth.step]
    who = estimate.track[to]
    order = np.argsort(who, kind="stable")  # pairs of a track stay sorted by row of the truth
    row, track = at[order], who[order]
    on = np.zeros(len(row), bool)
    on[1:] = (np.diff(row) == 1) & (np.diff(track) == 0) & ~truth.first[row[1:]]
    begin = np.flatnonzero(~on)
    end = np.append(begin, len(row))[1:] - 1
    first, last = row[begin], row[end]
    spans = np.diff(time, prepend=0.0)
    whose = truth.track[row]
    pair = np.flatnonzero((np.diff(track, prepend=-1) != 0) | (np.diff(whose, prepend=-1) != 0))
    longest = np.zeros(truth.tracks)
    if len(pair):
        np.maximum.at(longest, whose[pair], np.add.reduceat(spans[row] * on, pair))
    is_tracked = np.zeros(len(truth.track), bool)
    is_tracked[row[on]] = True
    lives = float((time[truth.last] - time[truth.first]).sum())
    tracked_time = float(spans[is_tracked].sum())
    distinct = [int(np.count_nonzero(np.bincount(own))) for own in (at, to)]
    needed = _needed(first, last, truth)
    changes = int(np.maximum(needed - 1, 0).sum())
    return {
        "completeness": ratio(distinct[0], len(truth.track)),
        "ambiguity": ratio(distinct[1], distinct[0]),
        "spuriousness": ratio(len(estimate.track) - distinct[1], len(estimate.track)),
        "positional_accuracy": ratio(tracked.sums["places"], distinct[1]),
        "velocity_accuracy": ratio(tracked.sums["velocities"], distinct[1])
        if tracked.axes.speeds
        else None,
        "track_number_change_rate": ratio(changes, tracked_time),
        "longest_track_segment": ratio(float(longest.sum()), lives),
    }


def _needed(begin: Ints, end: Ints, truth: SideRows) -> Ints:
    """Return the smallest number of associations that cover the followed rows of each object.

    `begin` and `end` are the first and the last row of each association.
    """
    order = np.lexsort((end, begin))
    begin, end = begin[order], end[order]
    furthest = np.maximum.accumulate(end) if len(end) else end
    if (begin[1:] > furthest[:-1]).all():  # associations overlap only in mixed assignments
        return np.bincount(truth.track[begin], minlength=truth.tracks)
    needed = np.zeros(truth.tracks, np.int64)
    spans, k, best, covered = list(zip(begin.tolist(), end.tolist(), strict=True)), 0, -1, -1
    while k < len(spans) or best > covered:
        row = covered + 1 if best > covered else max(covered + 1, spans[k][0])
        while k < len(spans) and spans[k][0] <= row:
            best, k = max(best, spans[k][1]), k + 1
        if best > covered:  # takes the association that lasts longest from this row on
            needed[truth.track[row]] += 1
            covered = best
    return needed
