"""Selection of the evaluated steps, with truth and estimate at them (docs/how-to/time.md)."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import Distance, Pairs, Resources
from tgospa_eval.distances.pair_search import prepared_pairs
from tgospa_eval.errors import ConfigError, InputError, NothingLeftError
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import ROLES
from tgospa_eval.quoting import option
from tgospa_eval.tracks.alignment import Alignment, TimeMatching, Times, align, comparable
from tgospa_eval.tracks.conversion import SECOND, Duration, multiples
from tgospa_eval.tracks.coverage import NOT_COUNTED, marks_of
from tgospa_eval.tracks.trajectories import CLOCKS, Trajectories

if TYPE_CHECKING:
    from tgospa_eval.tracks.alignment import ClockReports

Sides = tuple[Trajectories, Trajectories]

TURN = 360.0
"""Degrees of a full turn in longitude."""

SILENCE = 5
"""An outage is by default longer than this number of median intervals.

The intervals are those between timestamps at which an estimate is near a true object."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Outages:
    """Long times in which the estimate has no state within the cutoff of a true object.

    Parameters
    ----------
    lengths : (K,) float array
        Time with a true object in each outage, in seconds or the unit of the timestamps.
    ticks : (N,) array
        Timestamps of the truth in the outages.
    states : int
        Number of states of the truth at these timestamps.
    counted : bool
        Whether these timestamps count as steps.
    """

    lengths: Times
    ticks: Times
    states: int
    counted: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """Both sides at the requested steps, before they are aligned.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate.
    horizon : Trajectories
        Trajectories with the timestamps of the horizon, by default the truth as it was read.
    made : pair of str and tuple of int, optional
        Interpolated side, "truth" or "estimate", and the numbers of its states that were
        interpolated, unchanged, and not used.
    left_out : pair of int
        Numbers of rows of the truth, and of the estimate, that are not at declared steps.
    outages : Outages, optional
        Outages of the estimate, if times of the estimate decide which steps count.
    reports : ClockReports, optional
        Reports of the estimate, if both sides are on a common clock.
    """

    sides: Sides
    horizon: Trajectories
    made: tuple[str, tuple[int, int, int]] | None = None
    left_out: tuple[int, int] = (0, 0)
    outages: Outages | None = None
    reports: "ClockReports | None" = None


def periods_of(distance: Distance, columns: tuple[str, ...]) -> dict[str, float]:
    """Return the periods of the state columns that wrap around."""
    periods = dict(distance.settings(columns).get("periodic", {}))
    if distance.on_earth:
        periods["lon"] = TURN
    return periods


def shortest_differences(differences: Floats, periods: Sequence[float] | None) -> Floats:
    """Return differences of states (N, d), the shorter way round in columns with a period.

    `periods` has the period of each column, infinite if it has none.
    """
    if periods is None:
        return differences
    period = np.asarray(periods, np.float64)
    finite = np.isfinite(period)
    shortest = differences.copy()
    half = 0.5 * period[finite]
    shortest[:, finite] = np.remainder(shortest[:, finite] + half, period[finite]) - half
    return shortest


def on_axis(
    sides: Sides,
    matching: TimeMatching,
    distance: Distance,
    names: tuple[str, str],
    cutoff: float,
    across: str = "",
) -> Axis:
    """Return both sides at the requested steps.

    An outage of the estimate ends with an estimate within the cutoff of a true object, not with a
    false alarm. `across` is the name of the attribute that marks states of the truth in gaps. If it
    is blank, the truth has no states in gaps (see `tracks.interpolation`).

    Raises
    ------
    ConfigError, InputError
        Durations do not fit the timestamps, or a side cannot be interpolated.
    """
    matching.check_units(sides[0].clock if len(sides[0].times) else sides[1].clock)
    if sides[0].clock != sides[1].clock:
        from tgospa_eval.formats.clocks import calendar_format  # lazy: seldom needed

        for role, name, side, other in zip(ROLES, names, sides, sides[::-1], strict=True):
            form = calendar_format(side.times) if side.clock == "number" else ""
            if "%Y" in form:
                zone = f" {option(f'{role}_time_zone', 'UTC')} or another"
                raise InputError(
                    f"{name} has numbers that look like dates, the other file has "
                    f"{CLOCKS[other.clock]}: read the dates with "
                    f"{option(f'{role}_time_format', form)}{zone * (other.clock == 'zoned')}"
                )
    comparable(*sides, names)
    axis = Axis(sides=sides, horizon=sides[0])
    if matching.resample is not None:
        return _resampled(axis, matching, distance, names, across)
    if matching.interpolate:
        axis = _interpolated(axis, matching, distance, names, cutoff, across)
    if matching.steps is not None:
        from tgospa_eval.tracks.interpolation import at_ticks  # lazy: rarely needed

        ticks = _stamped(matching.steps.ticks(), axis.horizon, matching.steps.clock)
        first, second = (
            at_ticks(side, ticks, matching.near, (name, option("steps")))
            for side, name in zip(axis.sides, names, strict=True)
        )
        left_out = (
            len(axis.sides[0].step) - len(first.step),
            len(axis.sides[1].step) - len(second.step),
        )
        axis = replace(axis, sides=(first, second), horizon=ticks, left_out=left_out)
    return axis


def with_outages(
    axis: Axis, matching: TimeMatching, distance: Distance, names: tuple[str, str], cutoff: float
) -> Axis:
    """Add the outages of the estimate, if times of the estimate decide which steps count.

    Nothing is added if the truth is interpolated, because outages were found before.
    """
    if not matching.of_estimate or axis.outages is not None or matching.interpolate == "truth":
        return axis
    first, second = axis.sides
    _, near = _near(first, second, matching, distance, cutoff)
    near_times = np.unique(second.times[second.step[near.estimate_row]])
    return replace(axis, outages=_find_outages(first, second, near_times, matching, names))


def _resampled(
    axis: Axis, matching: TimeMatching, distance: Distance, names: tuple[str, str], across: str
) -> Axis:
    """Return both sides on a common clock, at the multiples of `matching.resample`.

    The truth is interpolated at these steps. Each report of the estimate holds for its period.
    """
    truth = axis.horizon
    assert isinstance(matching.resample, Duration)
    tick_times = truth.times[:0]
    if len(truth.times):
        ends = truth.times[[0, -1]].tolist()
        tick_times = multiples(ends[0], ends[1], matching.resample, truth.clock)
        if not len(tick_times):
            raise ConfigError(
                f"{option('resample', matching.resample.text)}: no multiple of it is between the "
                f"first time of {names[0]} ({truth.shown[0]}) and its last time "
                f"({truth.shown[-1]}); use a smaller step"
            )
    ticks = _stamped(tick_times, truth, truth.clock)
    make = partial(
        _made,
        truth,
        gap=matching.gaps[0],
        matching=matching,
        distance=distance,
        names=(names[0], option("resample")),
        across=across,
    )
    (moved, made), estimate, reports = make(ticks), axis.sides[1], None
    if len(estimate.step) and len(ticks.times):
        from tgospa_eval.tracks.interpolation import hold  # lazy: rarely needed

        def truth_at(side: Trajectories) -> Trajectories:
            return replace_times(make(side)[0], side)

        named = names[1], option("resample")
        estimate, reports = hold(truth, estimate, ticks, matching, truth_at, named)
    return Axis(
        sides=(replace_times(moved, ticks), replace_times(estimate, ticks)),
        horizon=ticks,
        made=("truth", made),
        reports=reports,
    )


def replace_times(side: Trajectories, ticks: Trajectories) -> Trajectories:
    """Return the side as it is, or with the timestamps of `ticks` if it has no rows."""
    if len(side.step) or not len(ticks.times):
        return side
    return replace(side, times=ticks.times, clock=ticks.clock, labels=ticks.labels)


def _interpolated(
    axis: Axis,
    matching: TimeMatching,
    distance: Distance,
    names: tuple[str, str],
    cutoff: float,
    across: str,
) -> Axis:
    """Return both sides after one is interpolated at the timestamps of the other.

    If outages of the estimate count, an interpolated truth keeps its own timestamps in the outages.
    """
    which = ("truth", "estimate").index(str(matching.interpolate))
    side, other = axis.sides[which], axis.sides[1 - which]
    make = partial(
        _made,
        side,
        gap=matching.gaps[0],
        matching=matching,
        distance=distance,
        names=(names[which], names[1 - which]),
    )
    (moved, made), outages = make(other), None
    if which == 0:
        pair, near = _near(moved, other, matching, distance, cutoff)
        near_times = np.unique(pair.estimate.times[pair.estimate.step[near.estimate_row]])
        outages = _find_outages(side, other, near_times, matching, names)
        silent = outages.ticks if outages is not None and outages.counted else other.times[:0]
        if len(silent):
            other = _stamped(np.union1d(other.times, silent), other, other.clock, side)
        if len(silent) or across:
            moved, made = make(other, across=across)
    sides = (moved, axis.sides[1]) if which == 0 else (axis.sides[0], moved)
    return replace(axis, sides=sides, made=(str(matching.interpolate), made), outages=outages)


def _made(
    side: Trajectories,
    other: Trajectories,
    gap: Duration,
    matching: TimeMatching,
    distance: Distance,
    names: tuple[str, str],
    across: str = "",
) -> tuple[Trajectories, tuple[int, int, int]]:
    from tgospa_eval.tracks.interpolation import interpolated  # lazy: rarely needed

    return interpolated(
        side.reduced_to(("gaussian", *distance.kinds)),  # NEES needs the covariances
        other,
        max_gap=float(gap),
        tolerance=matching.near,
        periods=periods_of(distance, side.columns),
        names=names,
        across=across,
    )


def _near(
    truth: Trajectories,
    estimate: Trajectories,
    matching: TimeMatching,
    distance: Distance,
    cutoff: float,
) -> tuple[Alignment, Pairs]:
    """Return both sides on all steps of truth or estimate, and their pairs within the cutoff."""
    pair = align(truth, estimate.reduced_to(distance.kinds), TimeMatching(tolerance=matching.near))
    resources = Resources(jobs=1, stopwatch=Stopwatch())
    distance = distance.fitted((pair.truth, pair.estimate))
    sides, prepared = distance.prepared((pair.truth, pair.estimate), resources)
    return pair, prepared_pairs(sides, cutoff, prepared, resources)


def _find_outages(
    truth: Trajectories,
    estimate: Trajectories,
    near_times: Times,
    matching: TimeMatching,
    names: tuple[str, str],
) -> Outages | None:
    """Return the outages of the estimate, or None if there are none.

    `near_times` are the timestamps at which an estimate is near a true object. The first and the
    last timestamp of the truth, and those of `near_times` between them, divide time into intervals.
    The length of an interval is the time in it with a true object. An outage is an interval that is
    longer than `TimeMatching.outage`. If this option is not a duration, the limit is `SILENCE`
    times the median time between consecutive `near_times`.
    """
    own, ticks = comparable(truth, estimate, names)
    if not len(own) or not len(ticks):
        return None
    ticks = np.unique(ticks[np.isin(estimate.times, near_times)])
    second = SECOND if truth.clock != "number" else 1
    ends = np.concatenate((own[:1], ticks[(ticks > own[0]) & (ticks < own[-1])], own[-1:]))
    _, begin, end, spans = between_rows(truth)
    inside = spans <= _longest_gap(spans, matching)
    objects = np.bincount(begin[inside], minlength=len(own))
    objects -= np.bincount(end[inside], minlength=len(own))
    without = np.diff(own) / second * (np.cumsum(objects)[:-1] == 0)
    without = np.interp(ends - own[0], own - own[0], np.append(0, np.cumsum(without)))
    lengths = np.diff(ends) / second - np.diff(without)
    intervals = np.diff(ticks) / second
    longest = SILENCE * float(np.median(intervals)) if len(intervals) else 0.0
    if isinstance(matching.outage, Duration):
        longest = float(matching.outage)
    silent = lengths > longest
    if not silent.any():
        return None
    # A timestamp of the truth between two intervals belongs to the earlier one.
    place = np.searchsorted(ends, own, side="left") - 1
    inside = silent[place.clip(0, len(silent) - 1)] & ~np.isin(own, ticks)
    return Outages(
        lengths=lengths[silent],
        ticks=own[inside],
        states=int(np.count_nonzero(inside[truth.step])),
        counted=matching.outage != "none",
    )


def between_rows(truth: Trajectories) -> tuple[Ints, Ints, Ints, Floats]:
    """Return intervals between consecutive rows of an object: track, both steps, and length.

    All objects with a single row together count as one object, with track -1.
    """
    is_single = np.bincount(truth.track)[truth.track] == 1
    track = np.where(is_single, -1, truth.track)
    order = np.argsort(track, kind="stable")
    track, step = track[order], truth.step[order]
    spans = np.diff(truth.times[step]) / (SECOND if truth.clock != "number" else 1)
    same = (track[1:] == track[:-1]) & (spans > 0)
    return track[1:][same], step[:-1][same], step[1:][same], spans[same]


def _longest_gap(spans: Floats, matching: TimeMatching) -> float:
    """Return the longest interval between two rows across which an object exists."""
    if matching.interpolate == "truth":
        return float(matching.gaps[0])
    return SILENCE * float(np.median(spans)) if len(spans) else 0.0


def near_in_outages(
    sides: Sides, outages: Outages, matching: TimeMatching, distance: Distance, cutoff: float
) -> tuple[float, int]:
    """Count estimate states in outages that are near the interpolated truth.

    Returns
    -------
    gap : float
        Longest gap across which the truth is interpolated.
    states : int
        Number of these states.
    """
    truth, estimate = sides
    gap = float(f"{_longest_gap(between_rows(truth)[-1], matching):.2g}")
    names = "truth", "estimate"
    moved, _ = _made(truth, estimate, Duration.of(gap, "max-gap"), matching, distance, names)
    pair, near = _near(moved, estimate, matching, distance, cutoff)
    rows = np.unique(near.estimate_row)
    place = np.searchsorted(truth.times, pair.estimate.times[pair.estimate.step[rows]])
    around = truth.times[place.clip(1) - 1], truth.times[place.clip(max=len(truth.times) - 1)]
    silent = np.isin(around, outages.ticks).all(axis=0)
    return gap, int(np.count_nonzero(silent))


def _stamped(
    times: Times, like: Trajectories, clock: str, labelled: Trajectories | None = None
) -> Trajectories:
    """Return trajectories without rows at these times.

    Times that are not plain numbers get the texts that they have in `like` or `labelled`. If they
    are in neither, their texts are in ISO 8601.
    """
    labels = None
    if clock != "number":
        from tgospa_eval.tracks.conversion import iso  # lazy: rarely needed

        labels = np.empty(len(times), dtype=object)
        known = {
            stamp: text
            for side in (like, labelled)
            if side is not None and side.labels is not None
            for stamp, text in zip(side.times.tolist(), side.labels, strict=True)
        }
        labels[:] = [known.get(stamp) or iso(stamp, clock) for stamp in times.tolist()]
    return Trajectories.of_times(times, like.columns, clock, labels)


def check_left(matching: TimeMatching, kept: int, left_out: tuple[int, int]) -> None:
    """Check that some rows are at declared steps, if steps are declared.

    `kept` is the number of these rows. `left_out` has the numbers of all other rows of both sides.

    Raises
    ------
    NothingLeftError
        All rows are at other times.
    """
    if matching.steps is not None and not kept and any(left_out):
        raise NothingLeftError(
            f"{option('steps', matching.steps.text)}: no row of either file is at one of these "
            f"steps; all {sum(left_out):,} are at other times"
        )


def on_own_times(request: EvaluationRequest) -> EvaluationRequest:
    """Return the request for sides that are already at their steps."""
    return replace(request, time_matching=request.time_matching.on_own_times)


def truth_gaps(
    truth: Trajectories, axis: Axis, matching: TimeMatching, distance: Distance, cutoff: float
) -> tuple[Times, list[str], int] | None:
    """Return the gaps of an interpolated truth, and the number of estimate states in them.

    The result is None if the truth is not interpolated, or has no gap.

    Parameters
    ----------
    truth : Trajectories
        Truth as it was read.
    axis : Axis
        Both sides at their steps.
    matching, distance, cutoff
        Settings with which the sides are compared.

    Returns
    -------
    lengths : (K,) array
        Length of each gap, in seconds or the unit of the timestamps.
    ids : list of str
        Names of the objects with gaps.
    states : int
        Number of estimate states within the cutoff of the straight line across a gap.
    """
    if matching.interpolate != "truth" and matching.resample is None:
        return None
    track, _, _, intervals = between_rows(truth)
    wide = (track >= 0) & (intervals > float(matching.gaps[0]))
    if not wide.any():
        return None
    narrow, estimate = axis.sides
    if axis.reports is not None:  # reports are compared with the truth at their own timestamps
        narrow = estimate = axis.reports.estimate
    line, _ = _made(
        truth, narrow, matching.gaps[0], matching, distance, ("truth", "estimate"), NOT_COUNTED
    )
    rows = np.flatnonzero(marks_of(line, NOT_COUNTED))
    states = 0
    if len(rows) and len(estimate.step):
        line = line.chosen(rows, line.step[rows], line.times)
        _, near = _near(line, estimate, matching, distance, cutoff)
        near_rows = np.unique(near.estimate_row)
        states = len(near_rows)
        if axis.reports is not None:
            states = int(np.count_nonzero(np.isin(axis.reports.row, near_rows)))
    names = sorted({str(truth.ids[i]) for i in track[wide].tolist()})
    return intervals[wide], names, states
