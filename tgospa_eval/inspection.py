"""What was read, in numbers: counts, extents, overlaps. Prints nothing."""

from collections.abc import Iterator
from dataclasses import asdict

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.common.arrays import Floats, Ints, median
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.diagnosis import diagnose, explained, suggest_cutoff, unit_notices
from tgospa_eval.evaluation.diagnosis.clock import find_clock
from tgospa_eval.evaluation.diagnosis.costs import SAMPLE, occupied
from tgospa_eval.evaluation.prepare import AlignedPair
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.results.records import Json
from tgospa_eval.text import option
from tgospa_eval.tracks.alignment import Alignment
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.trajectories import Trajectories

SCHEMA = "tgospa-eval/inspect/1"

QUANTILES = (5, 25, 50, 75, 95)


def inspect(
    files: list[tuple[str, Reading]], sides: AlignedPair | None, request: EvaluationRequest
) -> Json:
    """What paths and contents of the truth, and of an estimate, hold, and how both sides fit."""
    time_matching, parameters = request.time_matching, request.parameters
    distance = request.distance if sides is None else sides.distance
    warnings = [notice.about(path) for path, reading in files for notice in _about(reading)]
    document: Json = {
        "schema": SCHEMA,
        "version": __version__,
        "truth": describe(*files[0]),
        "warnings": [],
        "parameters": {
            "cutoff": parameters.cutoff,
            "order": parameters.order,
            "distance": distance.name,
            **distance.settings(files[0][1].trajectories.columns),
            **time_matching.recorded,
            **request.recorded,
            "unit": request.unit,
        },
    }
    if len(files) > 1:
        document["estimate"] = describe(*files[1])
    if any(reading.pixels for _, reading in files):
        warnings += unit_notices(request.unit)
    if sides is not None:
        document["both"] = both = compare(sides, request)
        found = [notice for notice in diagnose(sides, request) if notice.code]
        warnings += found
        if both["nearest"] is not None and (explained(found) or distance.largest < np.inf):
            both["nearest"]["suggested"] = None  # the distances are not those of errors
    document["warnings"] = [notice.record() for notice in warnings]
    return document


def _about(reading: Reading) -> Iterator[Notice]:
    """What is wrong with one file by itself."""
    yield from reading.warnings
    count = reading.left_out.get("duplicate", 0)
    if count and not any(notice.code == "duplicates" for notice in reading.warnings):
        yield Notice(
            code="duplicates",
            text=f"{counted(count, 'row repeats', 'rows repeat')} an (id, t)",
            remedy=f"evaluate refuses them without {option('on_duplicate')}",
        )


def describe(path: str, reading: Reading) -> Json:
    """Counts and extents of one file."""
    side = reading.trajectories
    count, first, last = _lives(side)
    holes = last - first + 1 - count
    per_step = np.bincount(side.step, minlength=len(side.times))
    found: Json = {
        "path": path,
        "format": reading.format,
        "rows": reading.rows,
        "used": len(side.step),
        "left_out": dict(reading.left_out),
        "trajectories": len(side.ids),
        "steps": len(side.times),
        "columns": list(side.columns),
        "headers": dict(reading.headers),
        "time": _clock(side),
        "length": spread(count),
        "holes": {
            "steps": int(holes.sum()),
            "trajectories": int(np.count_nonzero(holes)),
            "longest": _longest_hole(side),
        },
        "classes": {
            name: {"rows": len(part.step), "trajectories": len(part.ids)}
            for name in reading.classes
            for part in (reading.of_class(name),)
        },
        "objects": spread(per_step),
        "extent": {
            name: {"min": float(values.min()), "max": float(values.max())}
            for name, values in zip(side.columns, side.state.T, strict=True)
            if len(values)
        },
        "notices": list(reading.notices),
    }
    if side.clouds is not None:
        found["particles"] = spread(side.clouds.counts)
        variances = np.diagonal(side.clouds.covariances, axis1=1, axis2=2).T
    elif side.covariance is not None:
        variances = side.covariance.T[[k * (k + 3) // 2 for k in range(len(side.columns))]]
    else:
        return found
    deviations = zip(side.columns, np.sqrt(variances), strict=True)
    found["deviation"] = {name: spread(values) for name, values in deviations}
    return found


def _lives(side: Trajectories) -> tuple[Ints, Ints, Ints]:
    """Rows of each track, and its first and last step."""
    count = np.bincount(side.track, minlength=len(side.ids))
    first = np.zeros(len(side.ids), np.int64)
    last = np.zeros(len(side.ids), np.int64)
    last[side.track] = side.step  # rows are in the order of the steps, and the last one stays
    first[side.track[::-1]] = side.step[::-1]
    return count, first, last


def _longest_hole(side: Trajectories) -> int:
    """Consecutive steps of the file at which a track is absent, though it exists around them."""
    order = np.argsort(side.track, kind="stable")
    track, step = side.track[order], side.step[order]
    same = track[1:] == track[:-1]
    return int((np.diff(step)[same] - 1).max(initial=0))


def _clock(side: Trajectories) -> Json:
    """First and last stamp as read, and the distances between stamps."""
    shown = side.shown
    unit = 1.0 if side.clock == "number" else float(SECOND)
    gaps = spread(np.diff(side.times))
    return {
        "kind": side.clock,
        "first": shown[:1].tolist()[0] if len(shown) else None,
        "last": shown[-1:].tolist()[0] if len(shown) else None,
        "step": None if gaps is None else {name: value / unit for name, value in gaps.items()},
    }


def spread(values: Floats | Ints) -> Json | None:
    """Smallest, median and largest; None of nothing."""
    if not len(values):
        return None
    return {"min": float(values.min()), "median": median(values), "max": float(values.max())}


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def compare(sides: AlignedPair, request: EvaluationRequest) -> Json:
    """What both files have in common: steps, time, another clock, space, nearest estimates."""
    aligned, parameters = sides.alignment, request.parameters
    distance = sides.distance.lower_bound
    clock = find_clock(sides.given, parameters, distance, request.recorded)
    truth, estimate = sides.read
    return {
        "steps": {
            "union": aligned.union,
            "common": aligned.common,
            "joined": aligned.joined,
            "counted": len(aligned.truth.times),
        },
        "left_out": {"truth": aligned.left_out[0], "estimate": aligned.left_out[1]},
        "time": _overlap(aligned),
        "clock": None
        if clock is None
        else {name: value for name, value in asdict(clock).items() if name != "ahead"},
        "extent": {
            name: _common_range(a, b)
            for name, a, b in zip(truth.columns, truth.state.T, estimate.state.T, strict=True)
            if len(a) and len(b)
        },
        "nearest": nearest_estimates(aligned, parameters.cutoff, sides.distance),
    }


def _common_range(a: Floats, b: Floats) -> Json | None:
    """Where both have values; None if nowhere."""
    low, high = max(a.min(), b.min()), min(a.max(), b.max())
    return {"min": float(low), "max": float(high)} if low <= high else None


def _overlap(aligned: Alignment) -> Json | None:
    """First and last step between which both files have rows; None if there is none."""
    sides = aligned.truth, aligned.estimate
    if not all(len(side.step) for side in sides):
        return None
    first = max(int(side.step[0]) for side in sides)
    last = min(int(side.step[-1]) for side in sides)
    if first > last:
        return None
    truth = aligned.truth
    shown = truth.shown.tolist()
    return {"first": shown[first], "last": shown[last], "steps": last - first + 1}


@np.errstate(over="ignore", invalid="ignore")
def nearest_estimates(aligned: Alignment, cutoff: float, distance: Distance) -> Json | None:
    """Distances from truths to the nearest estimate of their step, over steps that both have.

    At most `SAMPLE` steps and truths of a step are looked at, evenly. None if no step has both.
    """
    both = np.flatnonzero(occupied(aligned.truth) & occupied(aligned.estimate))
    if not len(both):
        return None
    found, others = [], []
    for step in both[np.arange(min(SAMPLE, len(both))) * len(both) // min(SAMPLE, len(both))]:
        a, b = (
            distance.axes(side, slice(*np.searchsorted(side.step, [step, step + 1]).tolist())).T
            for side in (aligned.truth, aligned.estimate)
        )
        whole, every = a, -(-len(a) // SAMPLE)
        a = whole[::every]
        found.append(distance.lower_bound(a[:, None], b[None, :]).min(axis=1))
        apart = distance.lower_bound(a[:, None], whole[None, :])
        apart[np.arange(len(a)), np.arange(len(a)) * every] = np.inf
        others.append(apart.min(axis=1))
    near = np.concatenate(found)
    suggestion = suggest_cutoff(near, np.concatenate(others))
    near = np.sort(near)
    at = np.array(QUANTILES) / 100 * (len(near) - 1)
    quantiles = np.interp(at, np.arange(len(near)), near).tolist()
    return {
        "cutoff": cutoff,
        "truths": len(near),
        "quantiles": {
            str(q): value if np.isfinite(value) else None
            for q, value in zip(QUANTILES, quantiles, strict=True)
        },
        "within_cutoff": float(np.count_nonzero(near < cutoff) / len(near)),
        "suggested": None
        if suggestion is None
        else {"cutoff": suggestion[0], "reason": suggestion[1]},
    }
