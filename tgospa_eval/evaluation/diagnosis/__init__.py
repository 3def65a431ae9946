"""Warnings about truth and estimate before anything is solved: clocks, units, axes.

A warning changes no number. A suspected fault of the clock, the units, the axes or the origin is
corrected as a trial. There is a warning if the correction at least halves the per-step GOSPA cost.
In a trial of the clock, objects that are missed or false before and after the correction do not
count.

Other warnings need no trial: pairs that are near only by chance, values that cannot be intended,
timestamps that nearly match or do not match, outages of the estimate, and gaps of the truth.

`default_notice` says whether default parameters suit the data.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.arrays import Floats, concatenated, median, stretches
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, in_both, number, plain
from tgospa_eval.distances import Distance
from tgospa_eval.distances.pair_search import plain_norm, rows_at
from tgospa_eval.errors import TgospaError
from tgospa_eval.evaluation.axis import Axis, between_rows, near_in_outages, truth_gaps
from tgospa_eval.evaluation.diagnosis.clock import clock_warnings, rounded_up
from tgospa_eval.evaluation.diagnosis.costs import FIRST_STEPS, Sample
from tgospa_eval.evaluation.diagnosis.states import side_warnings, state_warnings
from tgospa_eval.formats.headers import ANGLES, BOX, LENGTHS
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.quoting import option
from tgospa_eval.tracks.alignment import Alignment, TimeMatching
from tgospa_eval.tracks.conversion import iso
from tgospa_eval.tracks.trajectories import PLACES, Trajectories

if TYPE_CHECKING:
    from tgospa_eval.evaluation.prepare import AlignedPair
    from tgospa_eval.evaluation.request import EvaluationRequest
    from tgospa_eval.formats import Reading


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # extreme states overflow
def diagnose(
    sides: "AlignedPair", request: "EvaluationRequest", *, sound: bool = False
) -> list[Notice]:
    """Return all warnings about truth and estimate.

    Parameters
    ----------
    sides : AlignedPair
        Truth and estimate.
    request : EvaluationRequest
        Request for these sides.
    sound : bool
        Whether the clock and the states are known to have no fault, so no trial is needed.
    """
    aligned, parameters = sides.alignment, request.parameters
    if aligned.reports is not None:  # reports are compared with the truth at their own timestamps
        for (truth, reports), _ in itertools.islice(aligned.reports.blocks(), 1):
            aligned = replace(aligned, truth=truth, estimate=reports)
    pair, distance = (aligned.truth, aligned.estimate), sides.distance.lower_bound
    sample = None if sound else Sample(pair, parameters, distance, FIRST_STEPS)
    read, on_clock = sides.read, sides.alignment.reports
    if on_clock is not None:  # a report may hold at several steps
        read = read[0], on_clock.estimate.chosen(np.unique(on_clock.row))
    warnings = side_warnings(read)
    clock = clock_warnings(sides, request, sample)
    warnings += clock
    if sample is not None and not any(
        notice.code in ("clock-shift", "stamps-near") for notice in clock
    ):
        frames = [str(request.recorded.get(f"{role}_crs", "")) for role in ("truth", "estimate")]
        warnings += state_warnings(sample, frames, sides.headers)
    warnings += step_warnings(sides, request.time_matching)
    warnings += silence_warnings(sides, request)
    if request.step_weights is not None:
        weights = request.step_weights.on(sides.alignment.truth)[0]
        steps = f"{np.count_nonzero(weights == 0):,} of {counted(len(weights), 'step')}"
        text = f"{steps} have the weight 0: their states are left out"
        warnings += [] if weights.all() else [Notice(text=text)]
    return warnings + gap_warnings(sides, request)


def axis_notices(axis: "Axis", matching: TimeMatching) -> Iterator[Notice]:
    """Yield notices about how both sides were brought to their steps.

    The notices count interpolated states, reports on a common clock, and states that are not used.
    """
    if axis.made is not None:
        side, (between, own, unused) = axis.made
        gap = matching.gaps[0]
        other = "truth" if side == "estimate" else "estimate"
        where = f"the timestamps of the {other}"
        if matching.resample is not None:
            where = f"{counted(len(axis.horizon.times), 'step')} of the common clock"
        rest = f", {unused:,} at other timestamps are not compared"
        yield Notice(
            text=f"{side} at {where}: {counted(between, 'state')} interpolated in gaps of at most "
            f"{gap.text}, {own:,} as read"
            f"{rest if unused else ''}"
        )
    if axis.reports is not None:
        clock, steps = axis.reports, counted(len(axis.horizon.times), "step")
        used, reports = len(np.unique(clock.row)), len(clock.estimate.step)
        which = (
            option("period")
            if clock.declared
            else f"the {clock.source}; {option('period')} declares it"
        )
        off = f"; {reports - used:,} count at no step" if used < reports else ""
        single = f" ({clock.single:,} alone)" if clock.single else ""
        yield Notice(
            text="each report of the estimate counts at steps within the period of the tracker, "
            f"{number(clock.period)} ({which}); its error is that at the time of the report: "
            f"{counted(used, 'report')}{single} at {steps} of the common clock{off}"
        )
    if matching.steps is not None:
        first, second = axis.left_out
        yield Notice(
            text=f"{counted(len(axis.horizon.times), 'step')} declared; {counted(first, 'row')} "
            f"of the truth and {second:,} of the estimate are at other times and left out"
        )


def step_warnings(sides: "AlignedPair", matching: TimeMatching) -> list[Notice]:
    """Warn of declared steps that seem wrong by one.

    There is a warning if two conditions are true. All rows outside of the declared steps are at one
    time: one step before the first declared step, or one step after the last one. The declared step
    at the other end has no row.
    """
    if matching.steps is None or not any(sides.axis.left_out):
        return []
    ticks = sides.axis.horizon.times
    every = ticks[1] - ticks[0] if len(ticks) > 1 else 1
    there = np.unique(np.concatenate([one.times[np.unique(one.step)] for one in sides.given]))
    outside = there[~np.isin(there, ticks)]
    for empty, missed, move in ((-1, ticks[0] - every, -every), (0, ticks[-1] + every, every)):
        if outside.tolist() == [missed] and ticks[empty] not in there:
            name, clock = option("steps", matching.steps.text), sides.axis.horizon.clock
            first, last, gone, free = (
                t if clock == "number" else iso(int(t), clock)
                for t in (ticks[0] + move, ticks[-1] + move, missed, ticks[empty])
            )
            return [
                Notice(
                    code="steps-moved",
                    text=f"{name}: rows at {gone} are left out, and no row is at {free}; arrays "
                    "in Python and NumPy files count steps from 0, MAT files from 1",
                    remedy=f"{option('steps', f'{first}:{last}')} includes all rows",
                )
            ]
    return []


def silence_warnings(sides: "AlignedPair", request: "EvaluationRequest") -> list[Notice]:
    """Warn of outages of the estimate, with their length and cost."""
    outages, parameters, matching = sides.axis.outages, request.parameters, request.time_matching
    if outages is None:
        return []
    total, longest = float(outages.lengths.sum()), float(outages.lengths.max())
    longest_of = f", the longest {number(longest, 4)}" if len(outages.lengths) > 1 else ""
    text = (
        "the estimate has no state within c of a true object in "
        f"{counted(len(outages.lengths), 'outage')} of total length {number(total, 4)}{longest_of}"
    )
    states = f"{counted(outages.states, 'state')} of the truth"
    remedy, near = "", 0
    if matching.interpolate is None:
        with suppress(TgospaError):  # not every distance has interpolated states
            gap, near = near_in_outages(
                sides.given, outages, matching, sides.distance, parameters.cutoff
            )
    if near:
        remedy = (
            f"use {option('interpolate', 'truth')} {option('max_gap', plain(gap))}: "
            f"{counted(near, 'state')} of the estimate in outages {'is' if near == 1 else 'are'} "
            "then within c of a true object"
        )
    elif not outages.counted:
        remedy = f"leave out {option('outage', 'none')} if the tracker should report at all times"
    elif sides.alignment.common:  # without common steps, no true state would be left
        remedy = f"use {option('outage', 'none')} if the tracker reports only what it sees"
    if not outages.counted:
        text += f"; outages do not count, so {states} at these times are not evaluated"
        return [Notice(code="silences-not-charged", text=text, remedy=remedy)]
    cost = outages.states * (1 - parameters.rho) * parameters.cutoff**parameters.order
    text += f"; {states} at these times are missed, which costs {number(cost)}"
    return [Notice(code="silences", text=text, remedy=remedy)]


def gap_warnings(sides: "AlignedPair", request: "EvaluationRequest") -> list[Notice]:
    """Warn of gaps of an interpolated truth, and of estimates in them."""
    if sides.axis.made is None:
        return []
    parameters, matching = request.parameters, request.time_matching
    gaps = truth_gaps(sides.given[0], sides.axis, matching, sides.distance, parameters.cutoff)
    if gaps is None:
        return []
    lengths, names, states = gaps
    text = (
        f"the truth has {counted(len(lengths), 'gap')} longer than "
        f"{matching.gaps[0].text}, of total length {number(float(lengths.sum()), 4)}, in the "
        f"tracks of id {_listed(names)}"
    )
    if not states:
        return [Notice(text=text)]
    if request.ignoring is not None and request.ignoring.gaps:
        near = f"{counted(states, 'estimate state')} near the straight line across a gap"
        return [Notice(text=f"{text}; by {option('ignore', 'truth-gaps')} {near} cost nothing")]
    cost = states * parameters.rho * parameters.cutoff**parameters.order
    return [
        Notice(
            code="truth-gaps",
            text=f"{text}; {counted(states, 'estimate state')} near the straight line across a gap "
            f"count as false, which costs up to {number(cost)}",
            remedy=f"{option('ignore', 'truth-gaps')} leaves these states out; if the objects move "
            f"in straight lines in the gaps, use a longer {option('max_gap')}",
        )
    ]


def _listed(names: Sequence[str]) -> str:
    """Name the first three of some ids, and how many more there are."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3:,} more" * (len(names) > 3))


def lost_warnings(sides: "AlignedPair", matching: TimeMatching) -> Iterator[Notice]:
    """Warn of objects and estimates without a state at the steps that count."""
    if not matching.gaps and matching.grid == "union" and matching.steps is None:
        return
    moved = "truth" if matching.resample is not None else matching.interpolate
    aligned, nouns = sides.alignment, {"truth": "ground-truth object", "estimate": "estimate"}
    both = zip(nouns, sides.given, (aligned.truth, aligned.estimate), strict=True)
    for role, side, counting in both:
        there = set(counting.ids.tolist())
        is_lost = np.array([name not in there for name in side.ids.tolist()], bool)
        if not is_lost.any():
            continue
        track, begin, end, spans = between_rows(side)
        first = np.searchsorted(counting.times, side.times[begin])
        around = first < np.searchsorted(counting.times, side.times[end], "right")
        around &= track >= 0
        gaps = np.full(len(is_lost), np.inf)  # shortest gap of each track around an evaluated step
        np.minimum.at(gaps, track[around], spans[around])
        if matching.steps is not None:  # objects may be outside of declared steps
            is_lost &= gaps < np.inf
        names, gaps = side.ids[is_lost].tolist(), gaps[is_lost & (gaps < np.inf)]
        if not names:
            continue
        lone, remedy = len(names) == 1, ""
        if moved == role and len(gaps) and matching.steps is None:
            longest = ",".join((rounded_up(gaps.max()), *(gap.text for gap in matching.gaps[1:])))
            which = (
                ("it" if lone else "them") if len(gaps) == len(names) else f"{len(gaps)} of them"
            )
            remedy = f"use {option('max_gap', longest)} to evaluate {which}"
        yield Notice(
            code="not-evaluated",
            text=f"{len(names):,} of {counted(len(side.ids), nouns[role])} "
            f"{'has' if lone else 'have'} no state at a step that counts, so "
            f"{'it costs' if lone else 'they cost'} nothing: id {_listed(names)}",
            remedy=remedy,
        )


def steps_of(aligned: Alignment, matching: TimeMatching) -> dict[str, int]:
    """Return numbers of steps: of either side, of both, and that count.

    If steps are not those of the files, ``common`` is the number of steps with states of both
    sides. ``truth`` and ``estimate`` are then the numbers of steps with states of that side.
    """
    steps = {"union": aligned.union, "common": aligned.common, "counted": len(aligned.truth.times)}
    if matching.decided or matching.interpolate:
        truth, estimate = (np.unique(side.step) for side in (aligned.truth, aligned.estimate))
        steps |= {"truth": len(truth), "estimate": len(estimate)}
        steps["common"] = int(np.isin(truth, estimate).sum())
    return steps


def alignment_notices(aligned: Alignment, matching: TimeMatching) -> list[str]:
    """Describe the alignment: common steps, joined timestamps, and rows that are left out."""
    rest = aligned.union - aligned.common
    at = "at the other, objects count as missed and tracks as false"
    if rest > 1:
        at = f"at the other {rest:,}, objects count as missed and tracks as false"
    costly = matching.grid == "union" and rest and aligned.common and not matching.interpolate
    notices = [in_both(steps_of(aligned, matching)) + (f"; {at}" * bool(costly))]
    if aligned.joined:
        pairs = counted(aligned.joined, "pair of timestamps was", "pairs of timestamps were")
        how = (
            f"at most {number(aligned.farthest)} apart ({option('time_tolerance')}), with their "
            "states"
        )
        notices.append(
            f"{pairs} joined, {how if matching.near else 'which differ by rounding only'}"
        )
    if any(aligned.left_out):
        steps = aligned.union - len(aligned.truth.times)
        notices.append(
            f"{counted(steps, 'step')} left out ({option('grid', matching.grid)}), with "
            f"{counted(aligned.left_out[0], 'row')} of the truth and {aligned.left_out[1]} of the "
            "estimate"
        )
    return notices


MULTIPLE = 3
"""A suggested cutoff is this multiple of the median error.

Of normally distributed errors in a plane, 99.8 % are smaller."""

FOLLOWED = 0.75
"""Smallest share of true states that must have an estimate nearer than a suggested cutoff."""

LARGEST_MEDIAN = 1e300
"""Largest median for which a cutoff is suggested, because multiples of it must be finite."""

LEADING = (1.0, 2.0, 5.0, 10.0)
"""Leading digits of suggested cutoffs."""


def suggest_cutoff(near: Floats, next_truths: Floats) -> tuple[float, str] | None:
    """Return a suggested cutoff and its reason, or None if errors look the same as misses.

    Parameters
    ----------
    near : (N,) float array
        Distance of each true state to the nearest estimate of its step.
    next_truths : (N,) float array
        Distance of each of these states to the nearest other object, inf if there is none.
    """
    if not len(near):
        return None
    middle, spacing = median(near), median(next_truths)
    # Errors look the same as misses if they are not below half of the distance between objects.
    if not 0 < middle < min(spacing / 2, LARGEST_MEDIAN):
        return None
    cutoff = _rounded_up(MULTIPLE * middle)
    followed = float(np.count_nonzero(near < cutoff) / len(near))
    if followed < FOLLOWED:
        return None
    reason = (
        f"{MULTIPLE} times the median distance ({middle:.3g}), rounded up; "
        f"{100 * followed:.0f} % of the ground-truth states have an estimate nearer than this"
    )
    crowded = float(np.count_nonzero(next_truths < cutoff) / len(near))
    if crowded >= 0.005:
        reason += f", and {100 * crowded:.0f} % have another true object nearer than this"
    return cutoff, reason


def _rounded_up(value: float) -> float:
    """Round up to a number of `LEADING` times a power of ten."""
    power = math.floor(math.log10(value))
    ends = (float(f"{digit:g}e{power}") for digit in LEADING)
    return next((end for end in ends if value <= end), float(f"1e{power + 1}"))


# -------------------------------------------------------------------------------------------------
# Distances to the nearest estimates, by a compiled loop if the distance is a plain norm.

SAMPLED_STEPS = 100
"""Largest number of steps, and of true states at each, for which the nearest is searched."""

PAIRS_AT_ONCE = 1 << 13
"""Number of pairs whose distances are computed together, so that they stay in the cache."""


@np.errstate(over="ignore", invalid="ignore")
def median_nearest(truth: Trajectories, estimate: Trajectories, distance: Distance) -> float | None:
    """Return the median distance from a true state to the nearest estimate of its step.

    Not all states are used (see `SAMPLED_STEPS`). Both sides must have the same times. The result
    is None if no step has rows of both sides.
    """
    distance = distance.lower_bound
    sides = truth, estimate
    rows = [rows_at(side, np.arange(len(side.times))) for side in sides]
    both = np.flatnonzero((rows[0][1] > rows[0][0]) & (rows[1][1] > rows[1][0]))
    if not len(both):
        return None
    both = both[:: -(-len(both) // SAMPLED_STEPS)]
    mine, theirs = (np.ascontiguousarray(side[:, both]) for side in rows)
    norm = plain_norm(sides, distance)
    if norm is not None:
        states = (side.state for side in sides)
        return median(kernels.nearest_points(*states, mine, theirs, *norm, SAMPLED_STEPS))
    stride, width = -(-(mine[1] - mine[0]) // SAMPLED_STEPS), theirs[1] - theirs[0]
    truths = -(-(mine[1] - mine[0]) // stride)
    row = concatenated(0 * truths, truths) * stride.repeat(truths) + mine[0].repeat(truths)
    first, width = theirs[0].repeat(truths), width.repeat(truths)
    nearest = []
    for low, high in itertools.pairwise(stretches(width, PAIRS_AT_ONCE).tolist()):
        own = slice(low, high)
        pairs = row[own].repeat(width[own]), concatenated(first[own], width[own])
        axes = (distance.axes(side, rows) for side, rows in zip(sides, pairs, strict=True))
        value = distance.between(zip(*axes, strict=True))
        nearest.append(np.minimum.reduceat(value, width[own].cumsum() - width[own]))
    return median(np.concatenate(nearest))


PARAMETER_NAMES = {"cutoff": "cutoff c", "switch_penalty": "switch penalty gamma"}


def default_notice(
    aligned: Alignment,
    distance: Distance,
    parameters: Parameters,
    defaults: Sequence[str],
    *,
    is_explained: bool = False,
    boxes: bool = False,
) -> Notice:
    """Return a notice with the default parameters in use, and with the scale of the data.

    The notice is a warning if the default cutoff is not above the median distance to the nearest
    estimate, and no other warning explains this.

    Parameters
    ----------
    aligned : Alignment
        Both sides.
    distance : Distance
        Base distance.
    parameters : Parameters
        Parameters in use.
    defaults : sequence of str
        Parameters that have their default value: names among cutoff and switch_penalty.
    is_explained : bool
        Whether another warning explains why distances are large.
    boxes : bool
        Whether boxes are compared by their centres, for which no cutoff suits all sizes.
    """
    used = " and ".join(
        f"{PARAMETER_NAMES[name]} = {getattr(parameters, name):g}" for name in defaults
    )
    nearest = median_nearest(aligned.truth, aligned.estimate, distance)
    known = nearest is not None and math.isfinite(nearest)
    scale = "" if not known else f"; the median distance to the nearest estimate is {nearest:.3g}"
    far = nearest is not None and nearest >= parameters.cutoff and "cutoff" in defaults
    first = (
        f"{option('distance', 'iou')} compares the boxes themselves; or "
        if boxes and "cutoff" in defaults
        else ""
    )
    return Notice(
        code="default-parameters" if far and not is_explained else "",
        text=f"default {used}{scale}",
        remedy=f"{first}choose with " + " and ".join(option(name, short=True) for name in defaults),
    )


def explained(warnings: Sequence[Notice]) -> bool:
    """Return whether a warning explains why states are far from each other."""
    return any(notice.code != "nothing-near" for notice in warnings)


def unit_notices(request: "EvaluationRequest", sides: Sequence["Reading"]) -> Iterator[Notice]:
    """Yield a warning if the states are in another unit of length or angle than the user says."""
    distance, own = request.distance, ""
    angles = {"bearing", "elevation"}
    stated = {u for side in sides for name, u in side.units.items() if name not in angles}
    pixels = any(side.pixels for side in sides)
    if distance.on_earth or "origin" in request.recorded:
        own = "m"
    elif distance.columns != BOX and distance.name != "mahalanobis":
        scales = {"unit_scale", "truth_scale", "estimate_scale"} & {*request.recorded}
        if scales or distance.scale is not None:
            return
        places = sides[0].trajectories.columns == PLACES
        own = "px" if pixels else "degrees" if places and not stated else "".join(stated)
        if not own or len(stated) > 1:
            return
    label, known = (
        [units.get((name or "").casefold()) for units in (LENGTHS, ANGLES)]
        for name in (request.unit, own)
    )
    if any(size is not None for size in label) and label != known:
        kitti = f"; for KITTI, {option('columns', 'x,y,z')} compares positions in metres"
        yield Notice(
            code="unit-label",
            text=f"the unit is called {request.unit}, but "
            + (
                f"states, c and gamma are in {own}"
                if own
                else f"the distance {distance.name} has no unit"
            ),
            remedy=f"use {option('unit', own)}{kitti * pixels}"
            if own
            else f"leave {option('unit')} out",
        )
