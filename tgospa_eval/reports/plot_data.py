"""From a result to what page and pictures draw: costs, lanes, positions, events. Plain data.

A lane is a trajectory; its runs are stretches of steps on which it exists and is assigned to one
other, or to none. Rows are its states, thinned where there are very many, but never an event.
"""

import math
from collections.abc import Collection, Sequence
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.formats.columns.headers import BOX
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.problem.readout import read_switches
from tgospa_eval.problem.solution import Windows
from tgospa_eval.problem.weights import ONE
from tgospa_eval.reports.time_axis import TimeAxis, moments, readable
from tgospa_eval.results.by_class import ByClass
from tgospa_eval.results.consistency import NEES
from tgospa_eval.results.numbers import SPREAD, costliest
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import COUNTED_PARTS, PARTS, Columns, Json, Time
from tgospa_eval.results.result import Result
from tgospa_eval.results.summary import Summary
from tgospa_eval.tracks.covariances import size_of

Rows: TypeAlias = dict[str, NDArray[Any]]
"""States of one side, by track and step: columns ``track``, ``step``, ``other``, ``error`` ....

``other`` is the track of the other side to which the largest part of it is assigned, or `NONE`, and
``shared`` whether that is a part only; ``error`` the distance to it as a fraction of the cutoff, 1
where it is unassigned; ``state`` (R, d), with d = 0 where the states are unknown; ``spread``
(R, d (d + 1) / 2) lower triangles of covariances, (R, 0) of points.
"""

VALUES = 800_000
"""Coordinates that are drawn; beyond, tracks are thinned."""

COARSEST = 50
"""Steps between positions from which on thinning saves little: what is left are events."""

LEVELS = 1 << 16
"""Steps into which the extent of a coordinate is divided."""

ERRORS = 1000
"""Steps into which the cutoff is divided."""

FARTHEST_NORTH = 88.0
"""Degrees of latitude up to which maps have equal scales."""

TIME = "t"
"""The time as an axis of the plane."""

FARTHEST = 1e300
"""Of what is drawn in the plane: matplotlib takes differences of coordinates."""

NONE = -1

KINDS = {"truth": "missed", "estimate": "false"}
"""What a track of either side costs where it is unassigned."""

RUN = ("track", "begin", "end", "other")
"""What there is of each stretch of one assignment."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnSide:
    """The tracks of one side.

    Parameters
    ----------
    name : str
        ``"truth"`` or ``"estimate"``.
    table : dict
        Of each track its id, costs, counts and steps.
    run : dict
        Stretches of one assignment, by track and step: ``track``, ``begin``, ``end``, ``other``.
    row : dict
        The states that are drawn.
    """

    name: str
    table: Columns
    run: dict[str, Ints]
    row: Rows

    @cached_property
    def ids(self) -> list[str]:
        """With the class in front where classes are evaluated apart."""
        ids, classes = self.table["id"], self.table.get("class")
        return [f"{classes[k]}: {i}" if classes else i for k, i in enumerate(ids)]

    @property
    def unassigned(self) -> Ints:
        """Rows that are missed, or false."""
        return np.flatnonzero(self.row["other"] == NONE)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlotData:
    """What is drawn: the page takes the document and the arrays, pictures that and the sides.

    Parameters
    ----------
    document : Json
        Each of its ``times`` begins a stretch of ``together`` steps, of which ``costs`` and
        ``counts`` are means, and ``curve`` is that of its last step; where these are several,
        ``worst`` has the costliest steps. ``stretch`` is that of a map. ``spread`` says how the
        numbers of ellipses are to be read; it is empty where there are none.
    arrays : dict of str to int array
        Whole numbers by name, as long as the data.
    truth, estimate : DrawnSide
        The tracks.
    about : str
        Value and parameters in words.
    """

    document: Json
    arrays: dict[str, Ints]
    truth: DrawnSide
    estimate: DrawnSide
    about: str

    @cached_property
    def axes(self) -> dict[str, dict[str, Floats]]:
        """Of the rows of each side what the plane can show: columns, centres of boxes, the time."""
        return {side.name: self._axes(side.row) for side in (self.truth, self.estimate)}

    def _axes(self, row: Rows) -> dict[str, Floats]:
        columns = np.clip(row["state"].T, -FARTHEST, FARTHEST)
        found = with_centres(dict(zip(self.document["columns"], columns, strict=True)))
        return found | {TIME: self.time.at[row["step"]]} if found else {}

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.document["times"])

    @property
    def switches(self) -> dict[str, Ints]:
        """Columns of the table of switches, as arrays."""
        return {name: np.asarray(column) for name, column in self.document["switches"].items()}

    @cached_property
    def time(self) -> TimeAxis:
        """The axis of time."""
        return TimeAxis(times=self.document["times"], axis=self.document["axis"])


def plot_data(result: Summary) -> PlotData:
    """What page and pictures of a result draw.

    Numbers of tracks count those of all classes one after the other, as the tables do.
    """
    whole = list(result.results.values()) if isinstance(result, ByClass) else [result]
    parts = [part for part in whole if isinstance(part, Result)]
    columns = parts[0].proof.compared.columns if parts else ()
    rows = {name: _joined(parts, name, len(columns)) for name in KINDS}
    runs = {name: _runs(side) for name, side in rows.items()}
    stride, kept = _thinned(rows, runs)
    low, quantum = _grid([side["state"] for side in rows.values()], len(columns))
    spread = described([side["spread"] for side in rows.values()], stride)
    sides: dict[str, DrawnSide] = {}
    arrays: dict[str, Ints] = {}
    for name, side in rows.items():
        (opens, closes), keep = runs[name], kept[name]
        run = {column: side[column][opens] for column in ("track", "other")}
        run |= {"begin": side["step"][opens], "end": side["step"][closes]}
        row = {column: values[keep] for column, values in side.items()}
        table = _tracks(result, name)
        sides[name] = DrawnSide(name=name, table=table, run=run, row=row)
        arrays |= {f"{name}/run/{field}": run[field] for field in RUN}
        arrays |= {f"{name}/row/{column}": row[column] for column in ("track", "step")}
        for axis in range(len(columns)):
            # halves, for the difference of two large numbers may overflow
            offset = row["state"][:, axis] / 2 - low[axis] / 2
            value = np.rint(offset / (quantum[axis] / 2))
            arrays[f"{name}/row/{axis}"] = value.astype(np.int64)
        if spread:
            entries = encoded(row["track"], row["step"], row["spread"], spread)
            arrays |= {f"{name}/spread/{key}": values for key, values in entries.items()}
        if name == "truth":
            arrays["truth/row/error"] = np.rint(row["error"] * ERRORS).astype(np.int64)
    stretches = len(result.labels.times) if parts else MOST_STRETCHES
    data = over_time(result, stretches) | {
        "tracks": {name: side.table for name, side in sides.items()},
        "switches": _switches(parts),
        "repairs": _repairs(result),
        "columns": list(columns),
        "boxes": is_box(columns),
        "low": low,
        "quantum": quantum,
        "spread": spread,
        "errors": ERRORS,
        "stride": stride,
        "shared": int(np.count_nonzero(rows["truth"]["shared"])),
        "rows": {name: [len(kept[name]), len(side["track"])] for name, side in rows.items()},
        "arrays": [(name, len(array)) for name, array in arrays.items()],
    }
    if is_map(columns):
        latitudes = [side["state"][:, columns.index("lat")] for side in rows.values()]
        data["stretch"] = map_stretch(np.concatenate(latitudes))
    if result.slid is not None:
        data["windows"] = _windows(result, result.slid)
    about = f"{result.claim}; {result.parameters_in_words(data['unit'])}"
    return PlotData(document=data, arrays=arrays, about=about, **sides)


def is_map(names: Collection[str]) -> bool:
    """Whether states have latitude and longitude, in degrees."""
    return {"lat", "lon"} <= set(names)


def is_box(columns: Sequence[str]) -> bool:
    """Whether states are boxes in pictures."""
    return tuple(columns[: len(BOX)]) == BOX


def with_centres(axes: dict[str, Floats]) -> dict[str, Floats]:
    """State columns by name, of boxes with their centres."""
    if not is_box(list(axes)):
        return axes
    x, y = axes["left"] + axes["width"] / 2, axes["top"] + axes["height"] / 2
    return axes | {"centre x": x, "centre y": y}


def map_stretch(latitudes: Floats) -> float:
    """How many times longer a degree of latitude is than one of longitude, at the mean latitude."""
    mean = float(np.mean(latitudes)) if len(latitudes) else 0.0
    return 1 / math.cos(math.radians(mean)) if abs(mean) <= FARTHEST_NORTH else 1.0


def _windows(result: Summary, slid: Windows) -> Json:
    """Of each window (cost / n) ^ (1/p) of each part, n its steps of the horizon."""
    table, power = result.table("windows"), 1 / result.proof.parameters.order
    each = np.maximum(np.array(table["steps"]), 1)
    costs: dict[str, Floats] = {name: np.array(table[name]) for name in PARTS}
    costs["total"] = sum(costs.values(), np.zeros(len(each)))
    return {
        "size": slid.size,
        "first": slid.first.tolist(),
        "last": slid.last.tolist(),
        "tgospa": rounded(table["tgospa"]),
        "lines": {n: rounded(((cost / each) ** power).tolist()) for n, cost in costs.items()},
    }


def _joined(parts: list[Result], name: str, size: int) -> Rows:
    """One side of all parts, tracks numbered through."""
    none = np.zeros(0, np.int64)
    found: list[Rows] = [
        dict.fromkeys(("track", "step", "other", "error", "shared"), none)
        | {"state": np.zeros((0, size)), "spread": np.zeros((0, 0))}
    ]
    other = "estimate" if name == "truth" else "truth"
    first = {"truth": 0, "estimate": 0}
    for part in parts:
        rows = _rows(part, name, other)
        rows["other"] = np.where(rows["other"] == NONE, NONE, rows["other"] + first[other])
        found.append(rows | {"track": rows["track"] + first[name]})
        first["truth"] += len(part.labels.truths)
        first["estimate"] += len(part.labels.estimates)
    wide = max(rows["spread"].shape[1] for rows in found)
    for rows in found:  # of some parts the states may be points, which have no spread
        if rows["spread"].shape[1] != wide:
            rows["spread"] = np.zeros((len(rows["track"]), wide))
    return {column: np.concatenate([rows[column] for rows in found]) for column in found[0]}


def _rows(result: Result, name: str, other: str) -> Rows:
    states, problem = result.proof.states, result.proof.states.problem
    own_row: Ints = getattr(problem, f"{name}_row")
    other_row: Ints = getattr(problem, f"{other}_row")
    other_track: Ints = getattr(problem, f"{other}_track")
    step = getattr(problem, f"{name}_step").astype(np.int64)
    track = getattr(problem, f"{name}_track").astype(np.int64)

    used = np.flatnonzero((states.entry >= 0) & (result.proof.weights > 0))
    entry, weight = states.entry[used].astype(np.int64), result.proof.weights[used]
    order = np.argsort(weight, kind="stable")  # the largest of a row comes last and stays
    entry, weight = entry[order], weight[order]
    partner = np.full(len(step), NONE, np.int64)
    error, best, free = np.ones(len(step)), np.zeros(len(step), np.int64), np.full(len(step), ONE)
    row = own_row[entry]
    partner[row] = other_track[other_row[entry]]
    error[row] = problem.powers(entry) ** (1 / result.proof.parameters.order)
    best[row] = weight
    np.subtract.at(free, row, weight)
    partner[free > best] = NONE
    error[partner == NONE] = 1.0

    state = getattr(result.proof.compared, name)
    spread = getattr(result.proof.compared, f"{name}_covariance")
    spread = np.zeros((len(step), 0)) if spread is None else spread
    by_track = np.argsort(track, kind="stable")
    rows: Rows = {"track": track, "step": step, "other": partner, "error": error}
    rows |= {"shared": (partner != NONE) & (best < ONE), "state": state, "spread": spread}
    return {column: values[by_track] for column, values in rows.items()}


def _runs(side: Rows) -> tuple[Ints, Ints]:
    """First and last row of each run."""
    track, step, other = side["track"], side["step"], side["other"]
    opens = np.ones(len(track), bool)
    opens[1:] = (np.diff(track) != 0) | (np.diff(step) != 1) | (np.diff(other) != 0)
    first = np.flatnonzero(opens)
    return first, np.append(first, len(track))[1:] - 1


def _thinned(
    sides: dict[str, Rows], runs: dict[str, tuple[Ints, Ints]]
) -> tuple[int, dict[str, Ints]]:
    """Stride with which hardly more than `VALUES` coordinates are drawn, and the rows by side."""
    stride = max(1, -(-sum(side["state"].size for side in sides.values()) // VALUES))
    while True:
        kept = {name: _drawn(side, *runs[name], stride) for name, side in sides.items()}
        # The steps of rows that are thinned are no longer regular, and cost like a coordinate.
        each = [side["state"].shape[1] + (stride > 1) for side in sides.values()]
        size = sum(n * len(rows) for n, rows in zip(each, kept.values(), strict=True))
        if size <= VALUES or stride >= COARSEST:
            return stride, kept
        stride += -(-stride // 4)


def _drawn(side: Rows, opens: Ints, closes: Ints, stride: int) -> Ints:
    """Rows that are drawn: every so many steps, ends of runs, and all that is unassigned."""
    if not side["state"].shape[1]:
        return np.zeros(0, np.int64)
    keep = (side["step"] % stride == 0) | (side["other"] == NONE)
    keep[opens] = True
    keep[closes] = True
    return np.flatnonzero(keep)


def _grid(states: list[Floats], size: int) -> tuple[list[float], list[float]]:
    """Origin and step of the grid on which each coordinate is encoded."""
    known = np.concatenate([state for state in states if state.shape[1] == size] or [np.zeros(0)])
    if not size or not len(known):
        return [0.0] * size, [1.0] * size
    # one after the other: along the first axis of what has few columns it takes ten times as long
    low, high = (np.array([end(column) for column in known.T]) for end in (np.min, np.max))
    quantum = (high / 2 - low / 2) / (LEVELS / 2)
    return low.tolist(), np.where(quantum > 0, quantum, 1.0).tolist()


def _tracks(result: Summary, side: str) -> Columns:
    """The columns of a table of tracks by the same names for both sides, with the total.

    Of data in parts the costliest tracks.
    """
    kind = KINDS[side]
    if isinstance(result, PartitionedResult):
        rows = result.costliest_tracks(kind, SHOWN_ROWS)
        parts = ("localisation", kind, "switch", f"{kind}_count", "switch_count")
        table = {column: [row[column] for row in rows] for column in ("id", "steps", *parts)}
    else:
        table = result.table(f"per_{side}")
    total = np.sum([table[name] for name in ("localisation", kind, "switch")], axis=0)
    names = {"localisation": "localisation", "unassigned": kind, "switch": "switch"}
    return (
        {"id": list(map(str, table["id"])), "steps": table["steps"]}
        | ({"class": table["class"]} if "class" in table else {})
        | {name: rounded(table[column]) for name, column in names.items()}
        | {
            "total": rounded(total.tolist()),
            "unassigned_count": rounded(table[f"{kind}_count"]),
            "switch_count": rounded(table["switch_count"]),
        }
    )


def _switches(parts: list[Result]) -> Columns:
    """The table of switches with numbers of steps and tracks."""
    rows: Columns = {name: [] for name in ("step", "truth", "from", "to", "mass", "cost")}
    truths = estimates = 0
    for part in parts:
        found = read_switches(part.proof.states, part.proof.weights)
        rows["step"] += found.step.tolist()
        rows["truth"] += (found.truth + truths).tolist()
        for name, track in (("from", found.before), ("to", found.after)):
            rows[name] += np.where(track < 0, NONE, track + estimates).tolist()
        table = part.table("switches")
        for name in ("mass", "cost"):
            rows[name] += rounded(table[name])
        truths, estimates = truths + len(part.labels.truths), estimates + len(part.labels.estimates)
    return rows


def _repairs(result: Summary) -> Columns:
    """Of each repair the numbers of its tracks, its steps, and itself in words."""
    repairs = () if result.explained is None else result.explained.repairs
    times = result.labels.times if repairs else []
    step: dict[Time | None, int] = {t: k for k, t in enumerate(times)}
    return {
        "tracks": [list(repair.tracks) for repair in repairs],
        "from": [step.get(repair.begin, NONE) for repair in repairs],
        "to": [step.get(repair.end, NONE) for repair in repairs],
        "text": [repair.text for repair in repairs],
    }


# -------------------------------------------------------------------------------------------------
# Ellipses, and what is drawn over time; of many steps, thinned.

NUMBERS = 150_000
"""Numbers of covariances that are encoded; beyond, those of every so many steps."""

FINE = 50
"""Levels of a deviation for a factor of e: 2 % each."""

FAINT = 1000
"""The level of what is not seen beside the largest deviation, as 0."""

ANGLE = 64
"""Levels of an angle for a radian."""


def described(spreads: list[Floats], stride: int) -> Json:
    """How the numbers of both sides are to be read; nothing where there are no ellipses.

    Parameters
    ----------
    spreads : list of (R, d (d + 1) / 2) float arrays
        Lower triangles; (R, 0) of points.
    stride : int
        Steps from one encoded position to the next.
    """
    around = [spread for spread in spreads if spread.size]
    if not around or size_of(around[0].shape[1]) < 2:
        return {}
    rows, columns = np.tril_indices(size_of(around[0].shape[1]))
    largest = np.max([deviations(s[:, rows == columns]).max(axis=0) for s in around], axis=0)
    size = sum(spread.size for spread in around) // stride
    return {
        "stride": stride * max(1, -(-size // NUMBERS)),
        "largest": largest.tolist(),
        "fine": FINE,
        "faint": FAINT,
        "angle": ANGLE,
    }


def encoded(track: Ints, step: Ints, spread: Floats, how: Json) -> dict[str, Ints]:
    """Arrays by name: which of these rows, sorted by track, are encoded, and each of the entries.

    Those of every so many steps, and the first and the last of each track.
    """
    if not spread.size:
        return {}
    keep = step % how["stride"] == 0
    ends = np.flatnonzero(np.diff(track, prepend=-1, append=-1))
    keep[ends[:-1]] = True
    keep[ends[1:] - 1] = True
    row = np.flatnonzero(keep)
    entries = levels(spread[row], how["largest"])
    return {"row": row} | {str(entry): level for entry, level in enumerate(entries)}


def levels(spread: Floats, largest: list[float]) -> list[Ints]:
    """Lower triangles (K, d (d + 1) / 2) as whole numbers, one array for each of its entries."""
    rows, columns = np.tril_indices(size_of(spread.shape[1]))
    diagonal = rows == columns
    deviation = deviations(spread[:, diagonal])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        size = -FINE * np.log(deviation / largest)
        correlation = np.clip(spread / deviation[:, rows] / deviation[:, columns], -1, 1)
        level = np.where(diagonal, size[:, rows], ANGLE * np.arcsin(correlation))
    # No logarithm or correlation of what has no deviation.
    level = np.where(np.isfinite(level), level, np.where(diagonal, FAINT, 0))
    return list(np.rint(np.minimum(level, FAINT)).astype(np.int64).T)


def deviations(variances: Floats) -> Floats:
    """Roots of what is a variance; of what overflowed there is no picture."""
    return np.sqrt(np.where(np.isfinite(variances), np.maximum(variances, 0.0), 0.0))


MOST_STRETCHES = 600
"""Stretches of steps that are drawn of data in parts."""

SHOWN_ROWS = 20
"""Steps and tracks of data in parts that are listed."""


def curves(result: Summary) -> dict[str, list[float]]:
    """Normalised cumulative cost: at step k the root of the mean cost of the steps up to it.

    (sum_{l <= k} cost(l) / n(k)) ^ (1/p), n(k) the number of steps of the horizon up to k; the
    last value of ``total`` is `normalised`. Where the curve was asked for, costs are
    those of the steps 1..k; else of the assignment of the whole recording, which bound the metric
    of the steps 1..k from above.
    """
    split, steps = result.proof.breakdown, np.maximum(result.judged_on.so_far, 1)
    if result.traced is not None:
        parts = dict(zip(PARTS, result.traced.parts, strict=True))
    else:
        parts = {name: np.cumsum(getattr(split, name)) for name in PARTS}
    parts["total"] = sum(parts.values(), np.zeros(len(steps)))
    parameters = result.proof.parameters
    return {
        name: (parameters.cutoff * (cost / steps) ** (1 / parameters.order)).tolist()
        for name, cost in parts.items()
    }


def rounded(values: list[float]) -> list[float]:
    """Seven digits, which is more than is shown."""
    exact = np.array(values, float)
    size = np.where(exact == 0, 1.0, np.abs(exact))
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are hardly any
        factor = 10.0 ** (6 - np.floor(np.log10(size)))
        rounded = np.rint(exact * factor) / factor
    shortest: list[float] = np.where(np.isfinite(rounded), rounded, exact).tolist()
    return shortest


def binned(total: Floats, most: int) -> tuple[Ints, Ints]:
    """First steps of at most so many bins of equal length, and of each its costliest step."""
    together = max(1, -(-len(total) // most))
    first = np.arange(0, len(total), together)
    padded = np.full(len(first) * together, -1.0)
    padded[: len(total)] = total
    return first, first + padded.reshape(len(first), together).argmax(axis=1)


def _consistency(result: Summary, table: Columns, first: Ints) -> Json:
    """NEES of the first step of each stretch, whose band is its own, and ranks of particles."""
    assert result.nees is not None
    names = ("nees", "nees_lower", "nees_upper")
    return {
        "lines": {name: [table[name][k] for k in first.tolist()] for name in names},
        "ideal": result.nees.components,
        "words": result.nees.in_words,
        "ranks": result.nees.ranks,
        "columns": result.settings["columns"],
    }


def over_time(result: Summary, stretches: int) -> Json:
    """What is drawn over time, of at most so many stretches of steps: means, the curve at ends."""
    steps = len(result.labels.times)
    together = max(1, -(-steps // max(stretches, 1)))
    first = np.arange(0, steps, together)
    last = np.minimum(first + together, steps) - 1
    times = readable([result.labels.times[k] for k in first.tolist()])
    breakdown, parameters = result.proof.breakdown, result.proof.parameters

    def mean(values: Floats) -> list[float]:
        sums = np.add.reduceat(values, first) if steps else values
        return rounded((sums / (last - first + 1)).tolist())

    costs = {name: result.scale * getattr(breakdown, name) for name in PARTS}
    counts = {name: getattr(breakdown, f"{name}_count") for name in COUNTED_PARTS}
    total = sum(costs.values(), np.zeros(steps))
    split = {} if result.split is None and result.nees is None else result.table("per_step")
    spread = {SPREAD: mean(np.array(split[SPREAD], float))} if SPREAD in split else {}
    worst = costliest(list(range(steps)), total, SHOWN_ROWS) if together > 1 else []
    return {
        "together": together,
        "worst": {
            "t": readable([result.labels.times[k] for k in worst]),
            "costs": {name: rounded(cost[worst].tolist()) for name, cost in costs.items()},
            "counts": {name: count[worst].tolist() for name, count in counts.items()},
        },
        "times": times,
        "axis": moments(times),
        "costs": {name: mean(cost) for name, cost in costs.items()} | spread,
        **({"nees": _consistency(result, split, first)} if NEES in split else {}),
        "counts": {name: mean(count) for name, count in counts.items()},
        "curve": {
            name: rounded([values[k] for k in last.tolist()])
            for name, values in curves(result).items()
        },
        "cutoff": parameters.cutoff,
        "order": parameters.order,
        "unit": result.labels.unit or "",
    }
