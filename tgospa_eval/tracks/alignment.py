"""Alignment of truth and estimate (the two sides) on one time grid.

Rules decide which timestamps of the sides are one step, and which steps count. This module is
independent of files and of the metric.

A common clock (`resample`) has regular steps. On this clock, a row of the estimate is called a
*report*. A report *holds* (is valid) for the period of the tracker: at all steps of the clock in
this time. At each of these steps, the report is compared with the truth at the time of the report,
not of the step. Reports are never interpolated (docs/how-to/time.md).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.quoting import option, quoted
from tgospa_eval.tracks.conversion import EARLIEST, SECOND, Duration, Steps
from tgospa_eval.tracks.trajectories import CLOCKS, Trajectories

GRIDS = ("union", "truth", "estimate", "common")
INTERPOLATED = ("estimate", "truth")

Times = NDArray[Any]
"""Strictly increasing times, int64 or float64."""


@dataclass(frozen=True, kw_only=True)
class TimeMatching:
    """Rules that decide which times of both sides are one step, and which steps count.

    Parameters
    ----------
    tolerance : float
        Duration >= 0 in the unit of the timestamps, or in seconds for ISO times. A timestamp of the
        truth and one of the estimate are one step if they differ by at most the tolerance, and each
        is the nearest to the other. Decimals that differ only by rounding are always one step.
    grid : {"union", "truth", "estimate", "common"}
        Steps that count: those of any side (``"union"``), of both sides (``"common"``), or of the
        named side.
    interpolate : {"estimate", "truth"}, optional
        Side that is interpolated at the timestamps of the other side, see `tracks.interpolation`.
    max_gap : float, str, or pair of these, optional
        Longest time between two states of a track for which states between them are interpolated.
        With `resample` a second value is allowed: consecutive reports of a track that are farther
        apart belong to different runs, see `tracks.interpolation.hold`.
    resample : float or str, optional
        Spacing of a common clock. Its multiples from the first to the last timestamp of the truth
        are the steps. The truth is interpolated at the steps. Reports of the estimate hold for
        their period, see `ClockReports`.
    period : float or str, optional
        Period of the reports of the estimate; by default the median interval within tracks.
    steps : Steps, optional
        Steps that the user declared. Only these count. Rows at other times are left out.
    outage : float, str, or "none", optional
        A stretch of time without an estimate near any true object is an outage if it is longer than
        this duration. The timestamps of the truth in an outage are also steps. The setting matters
        only if times of the estimate decide which steps count. By default, it is five times the
        median time between states of the estimate near a true object. ``"none"`` means that outages
        add no steps.

    Raises
    ------
    ConfigError
        A duration is negative or not finite, a name is unknown, or settings contradict each other.
    """

    tolerance: Duration | float | str = 0.0
    grid: str = "union"
    interpolate: str | None = None
    max_gap: "float | str | Sequence[float | str] | None" = None
    resample: Duration | float | str | None = None
    period: Duration | float | str | None = None
    steps: Steps | None = None
    outage: Duration | float | str | None = None

    def __post_init__(self) -> None:
        keep = partial(object.__setattr__, self)
        keep("tolerance", Duration.of(self.tolerance, "time tolerance"))
        if self.grid not in GRIDS:
            allowed = ", ".join(f'"{name}"' for name in GRIDS)
            raise ConfigError(f"grid is {quoted(self.grid)}: must be one of {allowed}")
        if self.interpolate not in (None, *INTERPOLATED):
            raise ConfigError(
                f'interpolate is {quoted(str(self.interpolate))}: must be "estimate" or "truth"'
            )
        if self.max_gap is not None:
            keep("max_gap", _gaps(self.max_gap))
        if self.resample is not None:
            keep("resample", Duration.of(self.resample, "resample"))
        if self.period is not None:
            keep("period", Duration.of(self.period, "period"))
            if not self.period:
                raise ConfigError(f"period is {self.period}: must be finite and > 0")
        if self.outage not in (None, "none"):
            keep("outage", Duration.of(self.outage, "outage"))
        self._check_together()

    def _check_together(self) -> None:
        """Check that the settings fit each other.

        Raises
        ------
        ConfigError
            A setting needs or excludes another one.
        """
        chosen = [
            chosen
            for chosen, is_given in (
                (option("interpolate", self.interpolate), self.interpolate),
                (option("resample"), self.resample is not None),
            )
            if is_given
        ]
        if chosen and self.max_gap is None:
            raise ConfigError(
                f"{chosen[0]} needs {option('max_gap', metavar='DT')}: longer gaps between two "
                "states of a trajectory are not interpolated"
            )
        if self.max_gap is not None and not chosen:
            raise ConfigError(
                f"{option('max_gap')} is for {option('interpolate')} and {option('resample')}; "
                "give one of these, or leave it out"
            )
        if len(chosen) > 1:
            raise ConfigError(
                f"{option('resample')} has a clock of its own; leave {option('interpolate')} out"
            )
        if self.period is not None and self.resample is None:
            raise ConfigError(f"{option('period')} is for {option('resample')}; leave it out")
        if self.interpolate and len(self.gaps) > 1:
            raise ConfigError(
                f"{option('max_gap', metavar='TRUTH,ESTIMATE')} is for {option('resample')}; give "
                "one value"
            )
        if self.outage is not None and not self.of_estimate:
            raise ConfigError(
                f"{option('outage')} needs {option('interpolate', 'truth')}, or "
                f"{option('grid', 'estimate')} or common; give one of these, or leave it out"
            )
        if self.steps is not None and self.resample is not None:
            raise ConfigError(
                f"{option('steps')} and {option('resample')} both say which steps count; leave "
                "one out"
            )
        if self.decided and self.grid != "union":
            raise ConfigError(f"{self.decided} says which steps count; leave {option('grid')} out")

    def check_units(self, clock: str) -> None:
        """Check that durations have no unit if the timestamps are plain numbers.

        Raises
        ------
        ConfigError
            A duration has a unit, and the unit of the times is unknown.
        """
        for name, value in (
            (option("time_tolerance"), self.tolerance),
            (option("outage"), self.outage),
            (option("period"), self.period),
            *((option("max_gap"), gap) for gap in self.gaps),
        ):
            if isinstance(value, Duration):
                value.check(clock, name)

    @property
    def gaps(self) -> tuple[Duration, ...]:
        """Longest gap that is interpolated, and longest gap between reports of a run, if given."""
        return cast("tuple[Duration, ...]", self.max_gap or ())

    @property
    def of_estimate(self) -> bool:
        """True if times of the estimate decide which steps count (outages add further steps)."""
        if self.interpolate == "truth":
            return True
        return self.grid in ("estimate", "common") and not self.decided

    @property
    def run(self) -> Duration | None:
        """Longest time between consecutive reports of one run, if given."""
        return self.gaps[1] if len(self.gaps) > 1 else None

    @property
    def decided(self) -> str:
        """Option in use that decides the steps instead of the timestamps, or a blank."""
        if self.steps is not None:
            return option("steps")
        return option("resample") if self.resample is not None else ""

    @property
    def near(self) -> float:
        """Tolerance as a number."""
        return float(self.tolerance)

    @property
    def on_own_times(self) -> "TimeMatching":
        """Rules without interpolation, for sides whose states are already at the steps."""
        return TimeMatching(tolerance=self.tolerance, grid=self.grid)

    @property
    def recorded(self) -> dict[str, object]:
        """Settings that change the number, by their JSON names."""
        record: dict[str, object] = {"grid": self.grid, "time_tolerance": self.tolerance}
        for name in ("interpolate", "resample", "period", "outage"):
            if getattr(self, name) is not None:
                record[name] = getattr(self, name)
        if self.max_gap is not None:
            record["max_gap"] = self.gaps[0] if len(self.gaps) == 1 else list(self.gaps)
        if self.steps is not None:
            record["steps"] = self.steps.text
        return record


def _gaps(given: "float | str | Sequence[float | str]") -> tuple[Duration, ...]:
    """Parse one longest gap, or two: the first for the truth, the second for the estimate.

    Raises
    ------
    ConfigError
        A gap is 0 or not a duration, or there are more than two.
    """
    each = given.split(",") if isinstance(given, str) else given
    parts = list(each) if isinstance(each, list | tuple) else [each]
    if not 1 <= len(parts) <= 2:
        raise ConfigError(f"max-gap has {len(parts)} values: must be one, or TRUTH,ESTIMATE")
    gaps = [Duration.of(part, "max-gap") for part in parts]
    for gap in gaps:
        if not gap:
            raise ConfigError(f"max-gap is {gap.text}: must be finite and > 0")
    return tuple(gaps)


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """Both sides on the steps that count, with a summary of the alignment.

    Parameters
    ----------
    truth, estimate : Trajectories
        Both sides with the same times; a joined step has the timestamp of the truth.
    union : int
        Number of steps at which any side has a timestamp, including steps that do not count.
    common : int
        Number of steps at which both sides have a timestamp, including steps that do not count.
    joined : int
        Number of pairs of different timestamps that became one step.
    farthest : float
        Largest difference within these pairs, in seconds or the unit of the timestamps.
    left_out : pair of int
        Numbers of rows of the truth and of the estimate at steps that do not count.
    reports : ClockReports, optional
        Reports behind the rows of the estimate, if it is on a common clock. Distances are then
        computed at the timestamps of the reports.
    """

    truth: Trajectories
    estimate: Trajectories
    union: int
    common: int
    joined: int
    left_out: tuple[int, int]
    reports: "ClockReports | None" = None
    farthest: float = 0.0


def align(
    truth: Trajectories,
    estimate: Trajectories,
    matching: TimeMatching | None = None,
    names: tuple[str, str] = ("truth", "estimate"),
    outage_times: Times | None = None,
) -> Alignment:
    """Put both sides on one grid; `names` are for messages.

    `outage_times` are the timestamps of the truth during outages of the estimate. These steps
    always count.

    Raises
    ------
    InputError
        The kinds of time differ, or integer and decimal timestamps cannot be compared exactly.
    """
    matching = matching or TimeMatching()
    first, second = comparable(truth, estimate, names)
    clock = truth.clock if len(truth.times) else estimate.clock
    if first.dtype == second.dtype and np.array_equal(first, second) and len(first):
        steps = len(first)
        return Alignment(
            truth=truth, estimate=estimate, union=steps, common=steps, joined=0, left_out=(0, 0)
        )
    joined, farthest = 0, 0.0
    is_rounded = first.dtype.kind == "f" or second.dtype.kind == "f"
    if (matching.near or is_rounded) and len(first) and len(second):
        own = second
        second, close = joined_to(second, first, matching.near, clock)
        joined = int(np.count_nonzero(close))
        moved = float(time_differences(own, second).max(initial=0))
        farthest = moved / (SECOND if clock != "number" else 1)
    times = _union(first, second)
    on = np.searchsorted(times, first), np.searchsorted(times, second)
    labels = None
    if clock != "number":
        labels = np.empty(len(times), dtype=object)
        for side, at in ((estimate, on[1]), (truth, on[0])):
            if side.labels is not None:
                labels[at] = side.labels
    has = np.zeros((2, len(times)), bool)
    for mine, at in zip(has, on, strict=True):
        mine[at] = True
    both = has.all(axis=0)
    chosen = {"union": has.any(axis=0), "truth": has[0], "estimate": has[1], "common": both}
    counted = chosen[matching.grid]
    if outage_times is not None:
        counted = counted | np.isin(times, outage_times)

    def on_steps(side: Trajectories, at: Ints) -> Trajectories:
        """Return the rows of the side at steps that count; `at` has the step of each timestamp."""
        step = at[side.step] if len(at) else side.step
        if counted.all():
            return replace(side, step=step, times=times, clock=clock, labels=labels)
        rows = np.flatnonzero(counted[step])
        step = (np.cumsum(counted) - 1)[step[rows]]
        kept = None if labels is None else labels[counted]
        return side.chosen(rows, step, times[counted], kept, clock)

    sides = on_steps(truth, on[0]), on_steps(estimate, on[1])
    return Alignment(
        truth=sides[0],
        estimate=sides[1],
        union=len(times),
        common=int(np.count_nonzero(both)),
        joined=joined,
        farthest=farthest,
        left_out=(len(truth.step) - len(sides[0].step), len(estimate.step) - len(sides[1].step)),
    )


def nearest(first: Times, second: Times) -> tuple[Ints, Ints, Times]:
    """Return all pairs of times that are nearest to each other; in a tie, the earlier is nearest.

    The result has three arrays with an entry for each pair: the index in `first`, the index in
    `second`, and the absolute difference (uint64 or float). `first` and `second` must not be empty.
    Each time is in at most one pair, and both indices increase. No other time is between the two
    times of a pair, because it would be nearer.
    """
    there, back = _nearest(first, second), _nearest(second, first)
    mine = np.flatnonzero(back[there] == np.arange(len(first)))
    other = there[mine]
    return mine, other, time_differences(first[mine], second[other])


def joined_to(mine: Times, theirs: Times, tolerance: float, clock: str) -> tuple[Times, Mask]:
    """Replace times of `mine` by their nearest times of `theirs`, if within the tolerance.

    Only the pairs of `nearest` are considered. Return the new times, and a mask of the pairs with
    a replaced time.
    """
    first, second, difference = nearest(mine, theirs)
    close = (difference > 0) & within(difference, tolerance, (mine, theirs), clock)
    joined = mine.astype(np.result_type(mine, theirs))
    joined[first[close]] = theirs[second[close]]
    return joined, close


def within(difference: Times, tolerance: float, sides: tuple[Times, Times], clock: str) -> Mask:
    """Return whether differences of times are within the tolerance.

    Decimals in a file are rounded to doubles, each by up to half the distance between neighbouring
    doubles. The difference of two is therefore allowed to exceed the tolerance by this distance.
    """
    if difference.dtype.kind == "u":
        bound = min(tolerance * (SECOND if clock != "number" else 1), 2.0**64)
        # Rounded before floor: in doubles 0.29 s times 1e9 is less than 290,000,000 ns.
        return np.asarray(difference <= min(math.floor(round(bound, 1)), 2**64 - 1))
    return np.asarray(difference <= tolerance + _spacing(*sides))


def comparable(
    truth: Trajectories, estimate: Trajectories, names: tuple[str, str]
) -> tuple[Times, Times]:
    """Return the times of both sides, which must be exactly comparable.

    `names` are for messages.

    Raises
    ------
    InputError
        The kinds of time differ, or integers beyond 2^53 would be compared with decimals.
    """
    if truth.clock != estimate.clock and len(truth.times) and len(estimate.times):
        remedy = "give both as ISO times or dates, or both as numbers, such as Unix seconds"
        if "local" in (truth.clock, estimate.clock):
            role, theirs = ("truth", estimate) if truth.clock == "local" else ("estimate", truth)
            zone = f"name the zone of the {role}, {option(f'{role}_time_zone', 'UTC')} or another"
            if theirs.clock == "zoned":
                remedy = zone
            elif abs(float(theirs.times[0])) >= EARLIEST:
                remedy += f"; or, if the numbers count from 1970, {zone}"
        raise InputError(
            f"{names[0]} has {CLOCKS[truth.clock]}, {names[1]} has {CLOCKS[estimate.clock]}; "
            f"times of one run must be of one kind: {remedy}"
        )
    first, second = truth.times, estimate.times
    if not len(first):
        first = second[:0]
    if not len(second):
        second = first[:0]
    if first.dtype != second.dtype:
        for times, name, other in ((first, *names), (second, *names[::-1])):
            if times.dtype.kind == "i" and not np.all(np.abs(times.astype(float)) < 2.0**53):
                raise InputError(
                    f"{name} has integer times above 2^53 and {other} decimal ones, "
                    "which cannot be compared exactly; write both as integers of one unit, "
                    "such as nanoseconds (seconds * 10^9), or both in seconds"
                )
    return first, second


def _nearest(own: Times, other: Times) -> Ints:
    """Return, for each time of `own`, the index of the nearest of `other`; in a tie the earlier."""
    after = np.searchsorted(other, own).clip(max=len(other) - 1)
    before = (after - 1).clip(min=0)
    left, right = time_differences(own, other[before]), time_differences(own, other[after])
    if left.dtype.kind == "f":  # rounding of decimals must not break a tie
        left = left - 2 * _spacing(own, other)
    return np.where(left <= right, before, after)


def time_differences(a: Times, b: Times) -> Times:
    """Return absolute differences; of integers as uint64, in which every difference fits."""
    if a.dtype.kind == b.dtype.kind == "i":
        return np.asarray(np.maximum(a, b).view(np.uint64) - np.minimum(a, b).view(np.uint64))
    with np.errstate(over="ignore"):  # an overflow to inf is right
        return np.abs(np.subtract(a, b, dtype=np.float64))


def _spacing(*sides: Times) -> float:
    """Return the distance from the largest time to the next double, without overflow."""
    largest = max(float(np.abs(side).max()) for side in sides)
    return float(np.spacing(min(largest, 2.0**1023)))


def _union(first: Times, second: Times) -> Times:
    """Return the distinct values in order, without np.union1d, whose import is slow."""
    both = np.sort(np.concatenate((first, second)), kind="stable")  # fast for two sorted parts
    fresh = np.ones(len(both), bool)
    np.not_equal(both[1:], both[:-1], out=fresh[1:])
    return both[fresh]


ROWS_TOGETHER = 1 << 20
"""Largest number of rows of the truth that `ClockReports.blocks` interpolates at a time."""

Sides = tuple[Trajectories, Trajectories]


@dataclass(frozen=True, kw_only=True, eq=False)
class ClockReports:
    """Reports of an estimate on a common clock: which report holds in which row.

    Parameters
    ----------
    estimate : Trajectories
        Estimate as it was read; its rows are the reports.
    row : (R,) int array
        Index of the report, for each of the R rows of the estimate on the clock.
    truths : (n,) object array
        Ids of all n true objects.
    truth_at : callable
        Function that receives trajectories, and returns the truth at their timestamps.
    period : float
        Time for which a report holds, in seconds or the unit of the timestamps.
    declared : bool
        Whether the user declared the period.
    source : str
        Origin of the period in words, if it was not declared.
    single : int
        Number of runs that have a single report.
    """

    estimate: Trajectories
    row: Ints
    truths: np.ndarray
    truth_at: Callable[[Trajectories], Trajectories]
    period: float
    declared: bool
    source: str
    single: int

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.truths.tolist())}

    def number(self, side: Trajectories) -> Ints:
        """Return, for each id of `side`, its index in `truths`; the side has only true objects."""
        return np.array([self._numbers[name] for name in side.ids.tolist()], np.int64)

    def blocks(self, rows: Ints | None = None) -> Iterator[tuple[Sides, Ints]]:
        """Yield truth and reports at the times of the reports, in blocks of consecutive times.

        A block has the truth and the reports as two sides, and the indices of its reports.

        Parameters
        ----------
        rows : int array, optional
            Increasing indices of the needed reports; by default all that hold at a step of the
            clock.
        """
        rows = np.unique(self.row) if rows is None else rows
        steps, at = np.unique(self.estimate.step[rows], return_inverse=True)
        together = max(ROWS_TOGETHER // max(len(self.truths), 1), 1)
        times, labels = self.estimate.times[steps], self.estimate.labels
        for begin in range(0, len(steps), together):
            part = slice(begin, begin + together)
            some = (at >= begin) & (at < begin + together)
            own = None if labels is None else labels[steps[part]]
            reports = self.estimate.chosen(rows[some], at[some] - begin, times[part], own)
            yield (self.truth_at(reports), reports), rows[some]

    def on_clock(self, pairs: tuple[Ints, Ints, Floats], sides: Sides) -> tuple[Ints, Ints, Floats]:
        """Convert pairs of true object and report to pairs of rows on the clock.

        A pair becomes a pair of rows at each step at which the report holds and the object exists.

        Parameters
        ----------
        pairs : tuple of (N,) arrays
            Index of the true object in `truths`, index of the report, and distance.
        sides : pair of Trajectories
            Both sides on the clock.

        Returns
        -------
        tuple of arrays
            Row of the truth, row of the estimate, and distance, sorted by both rows.
        """
        truth, estimate = sides
        track, report, distance = pairs
        own = np.full(max(len(self.truths), 1), -1)
        own[self.number(truth)] = np.arange(len(truth.ids))
        order = np.argsort(report, kind="stable")
        count = np.bincount(report, minlength=len(self.estimate.step))
        first = np.cumsum(count) - count
        pair = order[concatenated(first[self.row], count[self.row])]
        estimate_row = np.repeat(np.arange(len(self.row)), count[self.row])
        step = estimate.step[estimate_row].astype(np.int64)
        row, there = find_rows(truth, step, own[track[pair]])
        order = np.lexsort((estimate_row[there], row[there]))
        pair, estimate_row = pair[there][order], estimate_row[there][order]
        return row[there][order], estimate_row, distance[pair]

    def located(self, names: np.ndarray, rows: Ints) -> Sides:
        """Return pairs of a true object and a report as two sides with one step for each pair.

        The state of the object is the one at the time of the report. Times count from 0.

        Parameters
        ----------
        names : (N,) object array
            Id of the true object of each pair.
        rows : (N,) int array
            Row of the estimate on the clock of each pair.
        """
        report = self.row[rows]
        track = np.array([self._numbers[name] for name in names.tolist()], np.int64)
        state = np.empty((len(report), len(self.estimate.columns)))
        covariance: Floats | None = None
        for (truth, part), own in self.blocks(np.unique(report)):
            mine = np.flatnonzero(np.isin(report, own))
            step = part.step[np.searchsorted(own, report[mine])].astype(np.int64)
            number = np.full(len(self.truths), -1)
            number[self.number(truth)] = np.arange(len(truth.ids))
            row, _ = find_rows(truth, step, number[track[mine]])
            state[mine] = truth.state[row]
            if truth.covariance is not None:
                if covariance is None:
                    covariance = np.empty((len(report), truth.covariance.shape[1]))
                covariance[mine] = truth.covariance[row]
        steps = np.arange(len(report))
        estimate = replace(
            self.estimate.chosen(report, steps, steps, None, "number"),
            track=np.zeros(len(report), np.int64),
            ids=np.array([""], dtype=object),
            attributes={},
        )
        truth = replace(estimate, state=state, covariance=covariance, clouds=None)
        return truth, estimate


def find_rows(side: Trajectories, step: Ints, track: Ints) -> tuple[Ints, Mask]:
    """Find the row of each step and track, and a mask of existing rows; track -1 has no row."""
    if not len(side.step):
        return np.zeros(len(step), np.int64), np.zeros(len(step), bool)
    size = len(side.ids)
    keys = side.step.astype(np.int64) * size + side.track
    wanted = step * size + track
    row = np.searchsorted(keys, wanted).clip(max=len(keys) - 1)
    return row, (keys[row] == wanted) & (track >= 0)
