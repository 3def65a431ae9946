"""Conversion of a side (truth or estimate) to other timestamps.

States are interpolated on straight lines, or each state holds (stays valid) for a period.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated, median
from tgospa_eval.common.words import number
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import option
from tgospa_eval.tracks.alignment import (
    ClockReports,
    TimeMatching,
    Times,
    comparable,
    joined_to,
    time_differences,
    within,
)
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.coverage import AWAY, marks_of
from tgospa_eval.tracks.trajectories import Trajectories, chosen

HALF_TURN = 180.0
"""Largest longitude."""


RUN = 1.5
"""Largest time between consecutive reports of a run, in periods, unless the user sets it."""

SLACK = 1e-9
"""The time in which a report holds is shifted back by this share of a period. A step at its end
then belongs to the next report, despite rounding."""


def interpolated(
    side: Trajectories,
    other: Trajectories,
    *,
    max_gap: float,
    tolerance: float = 0.0,
    periods: dict[str, float] | None = None,
    names: tuple[str, str] = ("estimate", "truth"),
    across: str = "",
) -> tuple[Trajectories, tuple[int, int, int]]:
    """Interpolate a side at the times of the other side.

    If the side has no rows or the other side has no times, the side is returned unchanged.

    A state at a timestamp of the other side stays unchanged. Between two consecutive states of a
    track that are at most `max_gap` apart, states and covariances are on the straight line.
    Attributes are those of the state that is nearer in time; in a tie, those of the earlier state.
    A track is not extended beyond its first and its last state.

    Parameters
    ----------
    side, other : Trajectories
        Side to interpolate, and side with the timestamps.
    max_gap : float
        Longest gap, in the unit of the timestamps, or in seconds for ISO times.
    tolerance : float
        Two timestamps, one of each side, count as equal if they differ by at most the tolerance,
        and each is the nearest to the other.
    periods : dict of str to float, optional
        Period of each column that wraps around, such as an angle. These columns are interpolated
        along the shorter way.
    names : pair of str
        Names of both sides, for messages.
    across : str
        Name of an attribute, or a blank. With a name, longer gaps are interpolated, too: their new
        states are marked in this attribute, and get the attribute `tracks.coverage.AWAY`. With a
        blank, longer gaps get no states.

    Returns
    -------
    side : Trajectories
        The side at these timestamps.
    counts : tuple of int
        Number of new states in gaps of at most `max_gap`, number of states that were kept, and
        number of states that were left out because the other side lacks their timestamp.

    Raises
    ------
    ConfigError
        States are clouds of particles.
    InputError
        The timestamps cannot be compared.
    """
    mine, theirs = comparable(side, other, names)
    rows = len(side.step)
    if not rows or not len(theirs):
        return side, (0, rows, 0)
    if side.clouds is not None:
        raise ConfigError(
            f"{option('interpolate')}: {names[0]} has clouds of particles, which are not "
            f"interpolated; leave it out, or compare means with another {option('distance')}"
        )
    mine, _ = joined_to(mine, theirs, tolerance, side.clock)
    at, there = find_times(mine, theirs)
    own = np.flatnonzero(there[side.step])
    before, after, step, share, wide = _between(side, mine, theirs, max_gap, across=bool(across))
    nearer = np.where(share <= 0.5, before, after)
    source = np.concatenate((own, nearer))
    steps = np.concatenate((at[side.step[own]], step))
    order = np.lexsort((side.track[source], steps))
    state = np.concatenate((side.state[own], on_lines(side, before, after, share, periods or {})))
    covariance = side.covariance
    if covariance is not None:
        mixed = _mixed(covariance[before], covariance[after], share)
        covariance = np.concatenate((covariance[own], mixed))[order]
    attributes = chosen(side.attributes, source[order])
    if across:
        marks, away = marks_of(side, across)[source], np.zeros(len(order))
        marks[len(own) :] |= wide
        away[len(own) :] = wide * np.minimum(share, 1 - share) * _duration(side, before, after)
        attributes |= {across: marks[order].astype(np.float64), AWAY: away[order]}
    filled = replace(
        side,
        step=steps[order],
        track=side.track[source[order]],
        state=state[order],
        covariance=covariance,
        attributes=attributes,
        times=theirs,
        labels=other.labels,
    )
    between = len(step) - int(np.count_nonzero(wide))
    return filled.chosen(np.arange(len(order))), (between, len(own), rows - len(own))


def at_ticks(
    side: Trajectories, ticks: Trajectories, tolerance: float, names: tuple[str, str]
) -> Trajectories:
    """Return the rows of a side whose times are times of `ticks` within the tolerance.

    Raises
    ------
    InputError
        The timestamps cannot be compared.
    """
    at, there = match_times(side, ticks, tolerance, names)
    rows = np.flatnonzero(there[side.step])
    return side.chosen(rows, at[side.step[rows]], ticks.times, ticks.labels, ticks.clock)


def match_times(
    side: Trajectories, other: Trajectories, tolerance: float, names: tuple[str, str]
) -> tuple[Ints, Mask]:
    """Find each time of a side among those of another side, within the tolerance.

    Return the indices of the times in the other side, and a mask of the times that exist there.

    Raises
    ------
    InputError
        The timestamps cannot be compared.
    """
    mine, theirs = comparable(side, other, names)
    if len(mine) and len(theirs):
        mine, _ = joined_to(mine, theirs, tolerance, side.clock)
    return find_times(mine, theirs)


def find_times(mine: Times, theirs: Times) -> tuple[Ints, Mask]:
    """Return the index of each time in `theirs`, and a mask of the times that exist there."""
    if not len(theirs):
        return np.zeros(len(mine), np.int64), np.zeros(len(mine), bool)
    at = np.searchsorted(theirs, mine).clip(max=len(theirs) - 1)
    return at, theirs[at] == mine


def _between(
    side: Trajectories, mine: Times, theirs: Times, max_gap: float, *, across: bool
) -> tuple[Ints, Ints, Ints, Floats, Mask]:
    """Return the new rows between consecutive states of a track.

    Gaps longer than `max_gap` get new rows only with `across`. The result has five arrays with an
    element for each new row: the row before the gap, the row after the gap, the step of the new
    row, its time as a share of the gap, and True if the gap is longer than `max_gap`.
    """
    order = np.argsort(side.track, kind="stable")  # rows are in the order of time
    track, time = side.track[order], mine[side.step[order]]
    gap = time_differences(time[1:], time[:-1])
    narrow = within(gap, max_gap, (mine, theirs), side.clock)
    first = np.flatnonzero((track[1:] == track[:-1]) & (narrow | across))
    begin = np.searchsorted(theirs, time[first], side="right")
    count = np.searchsorted(theirs, time[first + 1], side="left") - begin
    step = concatenated(begin, count)
    wide = np.repeat(~narrow[first], count)
    first, gap = np.repeat(first, count), np.repeat(gap[first], count)
    share = time_differences(theirs[step], time[first]).astype(np.float64) / gap.astype(np.float64)
    return order[first], order[first + 1], step, share, wide


def _duration(side: Trajectories, before: Ints, after: Ints) -> Floats:
    """Return the time between pairs of rows, in seconds or the unit of the times."""
    difference = side.times[side.step[after]] - side.times[side.step[before]]
    return difference / (1 if side.clock == "number" else SECOND)


def on_lines(
    side: Trajectories, before: Ints, after: Ints, share: Floats, periods: dict[str, float]
) -> Floats:
    """Interpolate N states between the rows `before` and `after`, at `share` (0 to 1) of the way.

    `periods` has the period of each column that wraps around.
    """
    first, second = side.state[before], side.state[after]
    states = _mixed(first, second, share)
    for k, column in enumerate(side.columns):
        period = periods.get(column)
        if period is None:
            continue
        way = second[:, k] - first[:, k]
        way -= period * np.round(way / period)
        states[:, k] = first[:, k] + share * way
        if column == "lon":  # longitudes stay within half a turn
            beyond = np.abs(states[:, k]) > HALF_TURN
            states[beyond, k] -= np.copysign(2 * HALF_TURN, states[beyond, k])
    return states


def _mixed(first: Floats, second: Floats, share: Floats) -> Floats:
    """Interpolate linearly, without overflow."""
    share = share[:, None]
    return np.asarray((1 - share) * first + share * second)


def hold(
    truth: Trajectories,
    estimate: Trajectories,
    ticks: Trajectories,
    matching: TimeMatching,
    truth_at: Callable[[Trajectories], Trajectories],
    names: tuple[str, str],
) -> tuple[Trajectories, ClockReports]:
    """Put the estimate on a common clock, where each report holds for its period.

    A *report* is a row of the estimate. It *holds* (is valid) also for some time before and after
    its own timestamp. A *run* is a sequence of reports of a track without a long gap. Inside a run,
    a report holds half of the time to the report before it, and half of the time to the next one.
    At both ends of a run, reports hold for half a period, but at most half of the time to the
    neighbouring run of the track. In total, n regular reports hold for n periods.

    Parameters
    ----------
    truth, estimate : Trajectories
        Both sides as they were read.
    ticks : Trajectories
        Steps of the clock.
    matching : TimeMatching
        Rules with the spacing of the clock, the longest gap inside a run, and the period, if
        declared.
    truth_at : callable
        Function that receives trajectories, and returns the truth at their timestamps.
    names : pair of str
        Name of the estimate, and of the option that declares the clock, for messages.

    Raises
    ------
    ConfigError
        The clock is slower than the reports: a report could hold at no step.
    InputError
        The timestamps cannot be compared.
    """
    mine, theirs = comparable(estimate, ticks, names)
    second = SECOND if estimate.clock != "number" else 1
    origin = mine[0]
    own, clock = ((times - origin) / second for times in (mine, theirs))
    order = np.argsort(estimate.track, kind="stable")  # rows are in the order of time
    track, time = estimate.track[order], own[estimate.step[order]]
    same, gap = track[1:] == track[:-1], np.diff(time)
    step = float(matching.resample or 0.0)
    period = float(matching.period or (median(gap[same]) if same.any() else step))
    if step > period * (1 + SLACK):
        shown = number(period, 6)
        raise ConfigError(
            f"{option('resample', f'{step:g}')}: longer than the period of {names[0]}, {shown}, "
            f"so a report could fall between two steps; give at most {shown}, or "
            f"{option('period')} if the period is really longer"
        )
    limit = float(matching.run) if matching.run else RUN * period
    joined = same & (gap <= limit * (1 + SLACK))
    half = np.where(joined, gap / 2, np.where(same, np.minimum(gap, period) / 2, period / 2))
    middle = time[:-1] + half
    after = np.append(middle, time[-1:] + period / 2)
    before = np.append(time[:1] - period / 2, np.where(joined, middle, time[1:] - half))
    begin, end = (np.searchsorted(clock, ends - SLACK * period) for ends in (before, after))
    count = end - begin
    steps, row = concatenated(begin, count), np.repeat(order, count)
    order = np.lexsort((estimate.track[row], steps))
    linked = np.zeros(len(time), bool)
    linked[1:] |= joined
    linked[:-1] |= joined
    reports = ClockReports(
        estimate=estimate,
        row=row[order],
        truths=truth.ids,
        truth_at=truth_at,
        period=period,
        declared=bool(matching.period),
        source="median interval"
        if same.any()
        else "step of the clock, as no track has two reports",
        single=int(np.count_nonzero(~linked)),
    )
    side = estimate.chosen(row[order], steps[order], ticks.times, ticks.labels, ticks.clock)
    return side, reports
