"""Description of the data as read: counts, extents and overlaps, as JSON and as text."""

import math
from collections.abc import Iterator
from dataclasses import asdict

import numpy as np

from tgospa_eval._version import __version__
from tgospa_eval.common.arrays import Floats, Ints, median
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted, in_both, number, plain, shortest
from tgospa_eval.distances import DISTANCES, Distance
from tgospa_eval.evaluation.diagnosis import (
    diagnose,
    explained,
    lost_warnings,
    steps_of,
    suggest_cutoff,
    unit_notices,
)
from tgospa_eval.evaluation.diagnosis.clock import find_clock
from tgospa_eval.evaluation.diagnosis.costs import SAMPLE, occupied
from tgospa_eval.evaluation.prepare import AlignedPair
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.quoting import ending, option
from tgospa_eval.results.records import Json, Time
from tgospa_eval.show.table_text import WIDTH, Table, clip, text_lines, wrap
from tgospa_eval.tracks.alignment import Alignment
from tgospa_eval.tracks.conversion import SECOND
from tgospa_eval.tracks.trajectories import Trajectories

SCHEMA = "tgospa-eval/inspect/1"

QUANTILES = (5, 25, 50, 75, 95)


def inspect(
    files: list[tuple[str, Reading]], sides: AlignedPair | None, request: EvaluationRequest
) -> Json:
    """Return the JSON document about a truth. With an estimate, it also tells how both fit.

    `files` has the path and the content of the truth, then those of the estimate. `sides` has truth
    and estimate with aligned times, or is None without an estimate.
    """
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
    warnings += unit_notices(request, [reading for _, reading in files])
    if sides is not None:
        document["both"] = both = compare(sides, request)
        every = *diagnose(sides, request), *lost_warnings(sides, time_matching)
        notices = [notice for notice in every if notice.code]
        warnings += notices
        if both["nearest"] is not None and (explained(notices) or distance.largest < np.inf):
            # No cutoff is suggested in two cases: a wrong unit or clock explains the distances,
            # which then are no localisation errors; or distances have a largest possible value,
            # such as 1 for boxes.
            both["nearest"]["suggested"] = None
    document["warnings"] = [notice.record() for notice in warnings]
    return document


def _about(reading: Reading) -> Iterator[Notice]:
    """Yield warnings about one file."""
    yield from reading.warnings
    count = reading.left_out.get("duplicate", 0)
    if count and not any(notice.code == "duplicates" for notice in reading.warnings):
        yield Notice(
            code="duplicates",
            text=f"{counted(count, 'row repeats', 'rows repeat')} an (id, t)",
            remedy=f"evaluate refuses them without {option('on_duplicate')}",
        )


def describe(path: str, reading: Reading) -> Json:
    """Return counts and extents of one file."""
    side = reading.trajectories
    count, first, last = _lives(side)
    holes = last - first + 1 - count
    per_step = np.bincount(side.step, minlength=len(side.times))
    facts: Json = {
        "path": path,
        "format": reading.format,
        "rows": reading.rows,
        "used": len(side.step),
        "left_out": dict(reading.left_out),
        "trajectories": len(side.ids),
        "steps": len(side.times),
        "columns": list(side.columns),
        "headers": {
            name: header for name, header in reading.headers.items() if header.casefold() != name
        },
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
        facts["particles"] = spread(side.clouds.counts)
        variances = np.diagonal(side.clouds.covariances, axis1=1, axis2=2).T
    elif side.covariance is not None:
        variances = side.covariance.T[[k * (k + 3) // 2 for k in range(len(side.columns))]]
    else:
        return facts
    deviations = zip(side.columns, np.sqrt(variances), strict=True)
    facts["deviation"] = {name: spread(values) for name, values in deviations}
    return facts


def _lives(side: Trajectories) -> tuple[Ints, Ints, Ints]:
    """Return three arrays with an entry for each track: number of rows, first and last step."""
    count = np.bincount(side.track, minlength=len(side.ids))
    first = np.zeros(len(side.ids), np.int64)
    last = np.zeros(len(side.ids), np.int64)
    last[side.track] = side.step  # rows are sorted by step: the last row of a track wins
    first[side.track[::-1]] = side.step[::-1]
    return count, first, last


def _longest_hole(side: Trajectories) -> int:
    """Return the largest number of consecutive steps that are missing inside a track."""
    order = np.argsort(side.track, kind="stable")
    track, step = side.track[order], side.step[order]
    same = track[1:] == track[:-1]
    return int((np.diff(step)[same] - 1).max(initial=0))


def _clock(side: Trajectories) -> Json:
    """Return the first and last timestamp as read, and the gaps between timestamps."""
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
    """Return the smallest, median and largest value, or None without values."""
    if not len(values):
        return None
    return {"min": float(values.min()), "median": median(values), "max": float(values.max())}


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def compare(sides: AlignedPair, request: EvaluationRequest) -> Json:
    """Return a comparison of both files: steps, time, clock, space, nearest estimates."""
    aligned, parameters = sides.alignment, request.parameters
    distance = sides.distance.lower_bound
    clock = find_clock(sides.given, parameters, distance, request)
    truth, estimate = sides.read
    return {
        "steps": {
            **steps_of(aligned, request.time_matching),
            "joined": aligned.joined,
        },
        "left_out": {"truth": aligned.left_out[0], "estimate": aligned.left_out[1]},
        "time": _overlap(aligned),
        "clock": None
        if clock is None
        else {k: value for k, value in asdict(clock).items() if k not in ("ahead", "cures")},
        "extent": {
            name: _common_range(a, b)
            for name, a, b in zip(truth.columns, truth.state.T, estimate.state.T, strict=True)
            if len(a) and len(b)
        },
        "nearest": nearest_estimates(aligned, parameters.cutoff, sides.distance),
    }


def _common_range(a: Floats, b: Floats) -> Json | None:
    """Return the range that both sets of values cover, or None if there is none."""
    low, high = max(a.min(), b.min()), min(a.max(), b.max())
    return {"min": float(low), "max": float(high)} if low <= high else None


def _overlap(aligned: Alignment) -> Json | None:
    """Return the time range that both files cover: first and last time, and number of steps.

    If they do not overlap in time, the result is None.
    """
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
    """Return quantiles of distances from true states to the nearest estimate at the same step.

    Only steps with rows of both sides are used; without such steps, the result is None. At most
    `SAMPLE` evenly spaced steps are examined, with at most `SAMPLE` true states at each.
    """
    both = np.flatnonzero(occupied(aligned.truth) & occupied(aligned.estimate))
    if not len(both):
        return None
    nearest, next_truths = [], []
    for step in both[np.arange(min(SAMPLE, len(both))) * len(both) // min(SAMPLE, len(both))]:
        a, b = (
            distance.axes(side, slice(*np.searchsorted(side.step, [step, step + 1]).tolist())).T
            for side in (aligned.truth, aligned.estimate)
        )
        whole, every = a, -(-len(a) // SAMPLE)
        a = whole[::every]
        nearest.append(distance.lower_bound(a[:, None], b[None, :]).min(axis=1))
        distances = distance.lower_bound(a[:, None], whole[None, :])
        distances[np.arange(len(a)), np.arange(len(a)) * every] = np.inf
        next_truths.append(distances.min(axis=1))
    near = np.concatenate(nearest)
    suggestion = suggest_cutoff(near, np.concatenate(next_truths))
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


# -------------------------------------------------------------------------------------------------
# The data as read, as a table of 80 columns or as JSON.

Extent = dict[str, float]
"""Smallest value ``min``, largest value ``max``, and possibly the ``median``."""

Row = tuple[str, list[str]]


NAME_WIDTH = 18
"""Width of the first column."""

CELL = 28
"""Smallest width of the column of a file. Two such columns fit beside the first column."""


def table(document: Json) -> str:
    """Return the document of `inspect` as text."""
    files = [document["truth"], *([document["estimate"]] if "estimate" in document else [])]
    blocks = [_columns(list(_files(files)))]
    if "both" in document:
        warned = any(warning["code"] == "clock-shift" for warning in document["warnings"])
        blocks.append(list(_both(document["both"], document["parameters"], warned=warned)))
    lines = [(file["path"], text) for file in files for text in file["notices"]]
    blocks.append([line for path, text in lines for line in wrap(f"{path}: {text}")])
    warnings = (str(Notice(**record)) for record in document["warnings"])
    blocks.append([line for text in warnings for line in wrap(text)])
    return "\n\n".join("\n".join(map(clip, block)) for block in blocks if block) + "\n"


def _columns(rows: list[Row]) -> list[str]:
    """Return rows as lines. A cell that is too wide for its column continues on the next line."""
    count = len(rows[0][1])
    room = WIDTH - NAME_WIDTH - 1 - 2 * (count - 1)
    widths = [max(CELL, *(len(cells[k]) for _, cells in rows)) for k in range(count)]
    if sum(widths) > room:
        widths = [room] if count == 1 else [CELL] * count
    head, *lines = [(clip(name, NAME_WIDTH), *cells) for name, cells in rows]
    wide = (NAME_WIDTH + 1, *(width + 2 for width in widths))
    table = Table(head=head, rows=lines, align="l" * len(wide), widths=wide, wrapped=(1, 2))
    return text_lines(table, "")


def _files(files: list[Json]) -> Iterator[Row]:
    """Yield a row for each property, with a cell for each file."""
    yield "", ["truth", "estimate"][: len(files)]
    yield "file", [ending(file["path"], CELL) for file in files]
    yield "format", [file["format"] for file in files]
    if any(file["headers"] for file in files):
        named = [(f"{k}={clip(v, CELL)}" for k, v in file["headers"].items()) for file in files]
        yield "headers", [", ".join(names) or "-" for names in named]
    yield "rows", [f"{file['rows']:,}" for file in files]
    reasons = {  # names of rules in the JSON, and clearer words for them
        "blank": "no position",
        "duplicate": "repeated",
        "time": f"outside {option('time')}",
        "class": f"not in {option('class_')}",
        "region": f"outside {option('region')}",
    }
    for rule in dict.fromkeys(rule for file in files for rule in file["left_out"]):
        counts = [f"{file['left_out'].get(rule, 0):,}" for file in files]
        yield f"  {reasons.get(rule, rule)}", counts
    yield "trajectories", [f"{file['trajectories']:,}" for file in files]
    yield "  length", [_range(file["length"], "row", "rows") for file in files]
    yield "  with holes", [_holes(file["holes"]) for file in files]
    yield "steps", [f"{file['steps']:,}" for file in files]
    yield "  objects at", [_range(file["objects"]) for file in files]
    if any("particles" in file for file in files):
        one = {"min": 1.0, "median": 1.0, "max": 1.0}
        yield "  particles", [_range(file.get("particles", one)) for file in files]
    yield "  first t", [_moment(file["time"]["first"]) for file in files]
    yield "  last t", [_moment(file["time"]["last"]) for file in files]
    second = "s" if any(file["time"]["kind"] != "number" for file in files) else ""
    yield "  t to next t", [_steps(file["time"], second) for file in files]
    for column in files[0]["columns"]:
        yield column, [_interval(file["extent"].get(column)) for file in files]
        if any("deviation" in file for file in files):
            deviations = [file.get("deviation", {}).get(column) for file in files]
            yield "  std", [_range(spread, digits=3) for spread in deviations]
    for name in dict.fromkeys(name for file in files for name in file["classes"]):
        yield f"class {name}", [_class(file["classes"].get(name)) for file in files]


def _class(part: dict[str, int] | None) -> str:
    if part is None:
        return "none"
    tracks = counted(part["trajectories"], "trajectory", "trajectories")
    return f"{counted(part['rows'], 'row')}, {tracks}"


def _holes(holes: dict[str, int]) -> str:
    if not holes["trajectories"]:
        return "none"
    return f"{holes['trajectories']}, {counted(holes['steps'], 'step')}, longest {holes['longest']}"


def _both(both: Json, parameters: dict[str, object], *, warned: bool) -> Iterator[str]:
    """Yield lines on how the files fit. If `warned`, leave out the line on different clocks."""
    steps = both["steps"]
    yield in_both(steps) + (f", {steps['joined']} of them joined" if steps["joined"] else "")
    for side, rows in both["left_out"].items():
        if rows:
            yield (
                f"{counted(rows, 'row')} of the {side} left out "
                f"({option('grid', parameters['grid'])})"
            )
    yield from wrap(_stretch(both["time"]))
    if both["clock"] is not None and not warned:
        yield from wrap(f"  {_shown_clock(both['clock'])}")
    for column, extent in both["extent"].items():
        yield f"  {clip(column, NAME_WIDTH):<{NAME_WIDTH}}" + (
            f"{_interval(extent)} in both" if extent else "no overlap"
        )
    nearest = both["nearest"]
    if nearest is None:
        yield "no step has both an object and an estimate: no distances"
        return
    distance = DISTANCES.get(str(parameters["distance"]))
    unit = parameters["unit"] or ("m" if distance is not None and distance.on_earth else "")
    states = counted(nearest["truths"], "state")
    yield ""
    yield f"distance from a ground-truth state to its nearest estimate, {states}"
    quantiles = nearest["quantiles"]
    head = ("share of states", *(f"{q} %" for q in quantiles))
    row = ("distance up to", *map(_number, quantiles.values()))
    yield from text_lines(Table(head=head, rows=[row], widths=(15, *[11] * len(quantiles))))
    share = 100 * nearest["within_cutoff"]
    cutoff = f"{nearest['cutoff']:g} {unit}".strip()
    yield f"  nearer than the cutoff c = {cutoff}: {share:.1f} %"
    if nearest["suggested"] is not None:
        value = f"{nearest['suggested']['cutoff']:g} {unit}".strip()
        text = f"  suggested cutoff c = {value}: {nearest['suggested']['reason']}"
        yield from wrap(text)


def _stretch(time: Json | None) -> str:
    """Return a text on the time that both files cover."""
    if time is None:
        return "the files have no time in common"
    if time["steps"] == 1:
        return f"both have rows at t = {_moment(time['first'])} only"
    ends = f"{_moment(time['first'])} to {_moment(time['last'])}"
    return f"both have rows from t = {ends}, {counted(time['steps'], 'step')}"


def _shown_clock(clock: Json) -> str:
    """Describe a scale and an offset that would make the timestamps of the estimate fit better."""
    values = {name: clock[name] for name in ("time_scale", "time_offset")}
    settings = " ".join(
        option(name, plain(value))
        for (name, value), neutral in zip(values.items(), (1, 0), strict=True)
        if value != neutral
    )
    return (
        f"timestamps of the estimate fit better with {settings} (+/- {clock['uncertainty']:g}), "
        f"and {counted(clock['steps'], 'step')} cost {100 * clock['saving']:.0f} % less"
    )


def _range(spread: Extent | None, one: str = "", many: str = "", digits: int = 6) -> str:
    """Format a range and its median with a noun or unit: `one` for the value 1, else `many`."""
    if spread is None:
        return "-"
    low, middle, high = (_number(spread[key], digits) for key in ("min", "median", "max"))
    text = low if low == high else f"{low} to {high}, median {middle}"
    return f"{text} {one if text == '1' else many}".strip()


def _steps(time: Json, unit: str) -> str:
    """Format the range of the gaps between steps, without rounding errors of the timestamps."""
    ends = [t for t in (time["first"], time["last"]) if isinstance(t, float)]
    noise = 2 * math.ulp(max(map(abs, ends), default=0.0))
    spread = time["step"]
    return _range(spread and {k: shortest(v, noise) for k, v in spread.items()}, unit, unit)


def _interval(extent: Extent | None) -> str:
    """Format the ends of an interval, with enough digits to show that they differ."""
    if extent is None:
        return "-"
    low, high = extent["min"], extent["max"]
    size, wide = max(abs(low), abs(high)), high - low
    digits = 6 if low < high else 9
    if 0 < wide < size and wide / size > 0:
        digits = min(max(6, 4 - math.floor(math.log10(wide / size))), 15)
    ends = _number(low, digits), _number(high, digits)
    return ends[0] if low == high else " to ".join(ends)


def _number(value: float | None, digits: int = 6) -> str:
    return "-" if value is None else number(value, digits)


def _moment(value: Time | None) -> str:
    """Format a time without the rounding errors of decimals: 5.8, not 5.800000000000001."""
    if not isinstance(value, float):
        return "-" if value is None else str(value)
    exact, short = repr(value), f"{value:.14g}"
    return short if len(short) < len(exact) - 3 else exact
