"""Plain data for the page and pictures of a result: costs, lanes, positions and events.

A lane is a trajectory. Its rows are its states; if there are very many, some are left out, but no
event. A run is a longest sequence of states of a lane at consecutive steps with the same partner,
or without a partner.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from statistics import NormalDist
from typing import Any, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.transport import merged, resample_cloud
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.pair import EvaluationByClass, PairEvaluation, explanation_of
from tgospa_eval.formats.headers import BOX
from tgospa_eval.problem.solution import Windows, read_switches
from tgospa_eval.problem.states import ONE
from tgospa_eval.quoting import quoted
from tgospa_eval.results.consistency import NEES
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import COUNTED_PARTS, PARTS, SPREAD, Columns, Json, Time, costliest
from tgospa_eval.sensors import Pairing
from tgospa_eval.show.time_axis import TimeAxis, describe_times, readable
from tgospa_eval.tracks.clouds import Clouds
from tgospa_eval.tracks.covariances import size_of

Rows: TypeAlias = dict[str, NDArray[Any]]
"""R states of the truth or of the estimate (a side), sorted by track and step, as columns.

``track`` and ``step`` are numbers. ``other`` is the partner, the track of the other side with the
largest weight at this step; it is `NONE` or `FREE` if the largest weight is that of no track.
``error`` is the distance to the partner as a fraction of the cutoff, 1 for unassigned states.
``shared`` is true if the weight of the partner is less than 1. ``unjudged`` is true for ignored or
excused states. ``state`` (R, d) has d columns, none if the states are unknown. ``spread``
(R, d (d + 1) / 2) has lower triangles of covariances, (R, 0) for points. ``cloud`` is the number of
the cloud, or `NONE`.
"""

VALUES = 800_000
"""Number of coordinates of both sides above which some states are left out, but no events."""

COARSEST = 50
"""Largest distance in steps between drawn states: with more, little but events would be left."""

LEVELS = 1 << 16
"""Number of levels of a coordinate on the page."""

ERRORS = 1000
"""Number of levels of an error on the page, up to the cutoff."""

FARTHEST_NORTH = 88.0
"""Largest latitude in degrees for maps with equal scales."""

TIME = "t"
"""Name of the time as an axis of the plane."""

FARTHEST = 1e300
"""Largest coordinate in the plane, because matplotlib subtracts coordinates."""

FARTHEST_LEVEL = 1 << 29
"""Largest level on the page, so that differences of two levels fit into 32 bits."""

PARTICLES = 100_000
"""Largest number of drawn particles. If there are more, each cloud is drawn with fewer particles,
and if that is not enough, clouds are drawn at fewer steps."""

MIN_PARTICLES, MAX_PARTICLES = 10, 200
"""Least and largest number of particles drawn of a cloud; smaller clouds are drawn whole."""

SHARES = 10_000
"""Number of levels of the weight of a particle on the page."""

NONE, FREE = -1, -2
"""Partners: NONE of missed or false states, FREE of unassigned states that are not judged."""

KINDS = {"truth": "missed", "estimate": "false"}
"""Name of the cost of unassigned states of each side."""

RUN = ("track", "begin", "end", "other")
"""Fields of each run."""


def plane_columns(known: Sequence[str], requested: Sequence[str] | None) -> tuple[str, str]:
    """Return the columns of the horizontal and the vertical axis.

    Raises
    ------
    ConfigError
        `requested` names an unknown column, or not exactly two columns.
    """
    boxes = is_box(known)
    names = [*known, *(("centre x", "centre y") if boxes else ()), TIME]
    if requested is not None:
        odd = [name for name in requested if name not in names]
        if odd or len(requested) != 2 or isinstance(requested, str):
            text = requested if isinstance(requested, str) else ",".join(requested)
            raise ConfigError(f"plane {quoted(text)}: must be two of {', '.join(names)}")
        return requested[0], requested[1]
    if boxes:
        return "centre x", "centre y"
    if is_map(known):
        return "lon", "lat"
    return (known[0], known[1]) if len(known) > 1 else (TIME, known[0] if known else TIME)


@dataclass(frozen=True, kw_only=True, eq=False)
class SideData:
    """The tracks of one side.

    Parameters
    ----------
    name : str
        Side, ``"truth"`` or ``"estimate"``.
    table : dict
        Id, costs, counts and steps of each track.
    run : dict
        Runs by track and step: ``track``, ``begin``, ``end``, ``other``.
    row : dict
        States that are drawn.
    particles : dict
        Drawn particles by ``row``: ``state`` (P, d), and ``weight``, the share of the cloud that
        each particle represents.
    """

    name: str
    table: Columns
    run: dict[str, Ints]
    row: Rows
    particles: Rows

    @cached_property
    def ids(self) -> list[str]:
        """Ids of the tracks, after the name of the class if classes are evaluated separately."""
        ids, classes = self.table["id"], self.table.get("class")
        return [f"{classes[k]}: {i}" if classes else i for k, i in enumerate(ids)]

    @property
    def unassigned(self) -> Ints:
        """Rows that are missed or false."""
        return np.flatnonzero(self.row["other"] == NONE)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlotData:
    """Data to draw: the page uses the document and arrays, pictures use the document and sides.

    Parameters
    ----------
    document : Json
        Data over time are in groups of ``together`` consecutive steps, which begin at ``times``.
        ``costs`` and ``counts`` are means over each group, ``curve`` is the value at its last step.
        If groups have several steps, ``worst`` lists the single steps with the highest costs.
        ``stretch`` is the result of `map_stretch` for a map. ``spread`` has the scales of ellipses,
        if any. For each side, ``particles`` has the number of drawn particles and the number of all
        particles. ``words`` has the names of sides and parts.
    arrays : dict of str to int array
        Encoded columns of rows, runs, particles and ellipses, by name.
    truth, estimate : SideData
        The tracks.
    about : str
        Value and parameters in words.
    """

    document: Json
    arrays: dict[str, Ints]
    truth: SideData
    estimate: SideData
    about: str

    @cached_property
    def axes(self) -> dict[str, dict[str, Floats]]:
        """Values of the rows of each side in the plane: columns, centres of boxes and time."""
        return {side.name: self.places(side.row["state"], side.row["step"]) for side in self.sides}

    @property
    def sides(self) -> tuple[SideData, SideData]:
        """Truth and estimate."""
        return self.truth, self.estimate

    def places(self, state: Floats, step: Ints) -> dict[str, Floats]:
        """Return the columns in the plane for states (R, d) at these steps."""
        columns = np.clip(state.T, -FARTHEST, FARTHEST)
        shown = with_centres(dict(zip(self.document["columns"], columns, strict=True)))
        return shown | {TIME: self.time.at[step]} if shown else {}

    def word(self, name: str) -> str:
        """Return the name of a side or a part."""
        return str(self.document["words"].get(name, name))

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


_MADE: WeakKeyDictionary[Evaluation | Pairing, PlotData] = WeakKeyDictionary()


def plot_data(result: Evaluation | Pairing) -> PlotData:
    """Return the data for page and pictures, made once for each result."""
    if result not in _MADE:
        if isinstance(result, Pairing):
            _MADE[result] = _association_data(result)
        else:
            _MADE[result] = _result_data(result)
    return _MADE[result]


def _result_data(result: Evaluation) -> PlotData:
    """Return the data for the page and pictures of a result.

    Tracks of all classes are numbered one after the other, as in the tables.
    """
    whole = list(result.results.values()) if isinstance(result, EvaluationByClass) else [result]
    parts = [part for part in whole if isinstance(part, PairEvaluation)]
    columns = parts[0].proof.compared.columns if parts else ()
    stretches = len(result.labels.times) if parts else MAX_STRETCHES
    data = over_time(result, stretches) | {
        "switches": _switches(parts),
        "repairs": _repairs(result),
    }
    if result.window_bounds is not None:
        data["windows"] = _windows(result, result.window_bounds)
    return data_of_sides(
        {name: _joined(parts, name, len(columns)) for name in KINDS},
        columns,
        {name: _tracks(result, name) for name in KINDS},
        data,
        f"{result.claim}; {result.parameters_in_words(data['unit'])}",
    )


WORDS = {"truth": "A", "estimate": "B", "localisation": "distance"}
WORDS |= {"missed": "A alone", "false": "B alone"}
"""Names of sides and parts of an association."""


def _association_data(pairing: Pairing) -> PlotData:
    """Return data to draw an association: sides as truth and estimate, costs of order 1.

    Each unassociated state costs half a cutoff, and each pair its distance.
    """
    sides, steps = pairing.sides, len(pairing.first.times)
    power = getattr(pairing.distance, "power", 2.0)
    given: dict[str, tuple[Rows, Sequence[Clouds]]] = {}
    tables: dict[str, Columns] = {}
    costs: dict[str, Floats] = {"localisation": np.zeros(steps)}
    counts: dict[str, Floats] = {}
    for (name, kind), side, other, partner, distance in zip(
        KINDS.items(), sides, sides[::-1], pairing.partners, pairing.partings, strict=True
    ):
        lone, track = partner == NONE, side.track.astype(np.int64)
        rows: Rows = {"track": track, "step": side.step.astype(np.int64), "shared": lone & False}
        rows["other"] = np.where(lone, NONE, np.append(other.track, 0)[partner])
        rows["error"] = np.where(lone, 1.0, distance / pairing.cutoff)
        if name == "truth" and pairing.gates is not None:
            rows["gate"] = pairing.gates
        rows = by_track(rows, side.state, side.spread, side.clouds)
        given[name] = rows, [] if side.clouds is None else [side.clouds]
        lost = lone * pairing.cutoff / 2
        values = {"localisation": distance, "unassigned": lost, "total": distance + lost}
        values |= {"unassigned_count": lone, "steps": np.ones(len(track))}
        sums = {n: np.bincount(track, v, len(side.ids)).tolist() for n, v in values.items()}
        tables[name] = {"id": list(map(str, side.ids)), **{n: rounded(v) for n, v in sums.items()}}
        parts = {"localisation": distance, kind: lost}
        costs |= {n: np.bincount(side.step, v, steps).astype(float) for n, v in parts.items()}
        counts[kind] = np.bincount(side.step, lone, steps).astype(float)
    lines = costs | {"total": sum(costs.values(), np.zeros(steps))}
    lines = {name: np.cumsum(cost) / np.arange(1, steps + 1) for name, cost in lines.items()}
    times = readable(pairing.first.shown.tolist())
    document: Json = {"words": WORDS, "parts": list(costs), "cutoff": pairing.cutoff, "order": 1.0}
    document |= {"unit": "", "together": 1, "times": times, "axis": describe_times(times)}
    for name, each in (("costs", costs), ("counts", counts), ("curve", lines)):
        document[name] = {key: rounded(value.tolist()) for key, value in each.items()}
    document |= {"switches": _switches([]), "power": power if np.isfinite(power) else None}
    document["repairs"] = dict.fromkeys(("tracks", "from", "to", "text"), ())
    about = f"c = {pairing.cutoff:g}, {pairing.distance.name}"
    return data_of_sides(given, pairing.first.columns, tables, document, about)


def data_of_sides(
    given: Mapping[str, tuple[Rows, Sequence[Clouds]]],
    columns: Sequence[str],
    tables: Mapping[str, Columns],
    document: Json,
    about: str,
) -> PlotData:
    """Return data to draw the rows of both sides, with the clouds of each side in sequence.

    `tables` are those of the tracks, and `document` has the data over time.
    """
    rows = {name: side for name, (side, _) in given.items()}
    runs = {name: _runs(side) for name, side in rows.items()}
    stride, kept = _thinned(rows, runs)
    low, quantum = _grid([side["state"] for side in rows.values()], len(columns))
    spread = described([side["spread"] for side in rows.values()], stride)
    count = sum(len(cloud) for _, clouds in given.values() for cloud in clouds)
    every = stride * max(1, -(-count // (stride * PARTICLES // MIN_PARTICLES)))
    sides: dict[str, SideData] = {}
    arrays: dict[str, Ints] = {}

    def coded(state: Floats, axis: int) -> Ints:
        # halves, because differences may overflow
        value = np.rint((state[:, axis] / 2 - low[axis] / 2) / (quantum[axis] / 2))
        return np.clip(value, -FARTHEST_LEVEL, FARTHEST_LEVEL).astype(np.int64)

    for name, side in rows.items():
        (opens, closes), keep = runs[name], kept[name]
        run: Rows = {c: side[c][opens] for c in ("track", "other", "unjudged") if c in side}
        run |= {"begin": side["step"][opens], "end": side["step"][closes]}
        row = {column: values[keep] for column, values in side.items()}
        particles = shown_particles(row, given[name][1], every, len(columns))
        sides[name] = SideData(name=name, table=tables[name], run=run, row=row, particles=particles)
        arrays |= {f"{name}/run/{field}": run[field] for field in RUN}
        if "unjudged" in run and run["unjudged"].any():
            arrays[f"{name}/run/unjudged"] = run["unjudged"].astype(np.int64)
        arrays |= {f"{name}/row/{column}": row[column] for column in ("track", "step")}
        places = {"row": row["state"], "particles": particles["state"]}
        for axis in range(len(columns)):
            for what, state in places.items():
                arrays[f"{name}/{what}/{axis}"] = coded(state, axis)
        arrays[f"{name}/particles/row"] = particles["row"]
        arrays[f"{name}/particles/weight"] = np.rint(particles["weight"] * SHARES).astype(np.int64)
        if spread:
            entries = encoded(row["track"], row["step"], row["spread"], spread)
            arrays |= {f"{name}/spread/{key}": values for key, values in entries.items()}
        if "gate" in row:
            document["gate"] = described([row["gate"]], stride)
            document["gate"] |= {"radius": (1.0, 1.0), "power": document.pop("power")}
            entries = encoded(row["track"], row["step"], row["gate"], document["gate"])
            arrays |= {f"{name}/gate/{key}": values for key, values in entries.items()}
        if name == "truth":
            arrays["truth/row/error"] = np.rint(row["error"] * ERRORS).astype(np.int64)
    data = (
        {"words": {}, "parts": list(PARTS), "gate": {}}
        | document
        | {
            "tracks": {name: side.table for name, side in sides.items()},
            "columns": list(columns),
            "boxes": is_box(columns),
            "low": low,
            "quantum": quantum,
            "spread": spread,
            "particles": {
                name: [len(side.particles["row"]), sum(len(c.points) for c in given[name][1])]
                for name, side in sides.items()
            },
            "every": every,
            "shares": SHARES,
            "errors": ERRORS,
            "stride": stride,
            "shared": int(np.count_nonzero(rows["truth"]["shared"])),
            "rows": {name: [len(kept[name]), len(side["track"])] for name, side in rows.items()},
            "arrays": [(name, len(array)) for name, array in arrays.items()],
        }
    )
    if is_map(columns):
        latitudes = [side["state"][:, columns.index("lat")] for side in rows.values()]
        data["stretch"] = map_stretch(np.concatenate(latitudes))
    return PlotData(document=data, arrays=arrays, about=about, **sides)


def shown_particles(row: Rows, clouds: Sequence[Clouds], every: int, size: int) -> Rows:
    """Return particles of the clouds at every `every`-th step.

    Some are selected from a cloud with too many particles by systematic resampling: its total
    weight is divided into equal intervals, and the particle at the middle of each interval is
    drawn. A drawn particle has the weight of all its intervals.
    """
    particles: list[Rows] = []
    first = np.cumsum([0, *map(len, clouds)])
    chosen = np.flatnonzero((row["step"] % every == 0) & (row["cloud"] != NONE))
    chosen = chosen[:: max(1, -(-len(chosen) // (PARTICLES // MIN_PARTICLES)))]
    each = min(MAX_PARTICLES, PARTICLES // max(1, len(chosen)))
    for k in chosen.tolist():
        part = int(np.searchsorted(first, row["cloud"][k], side="right")) - 1
        points, weights = clouds[part][int(row["cloud"][k] - first[part])]
        if len(points) > each:
            points, weights = merged(resample_cloud(points, weights, each, offset=0.5))
        if len(points) > 1:  # a single particle is a point
            particles.append({"row": np.full(len(points), k), "state": points, "weight": weights})
    none: Rows = {"row": np.zeros(0, np.int64), "state": np.zeros((0, size)), "weight": np.zeros(0)}
    return {name: np.concatenate([none[name], *(one[name] for one in particles)]) for name in none}


def is_map(names: Collection[str]) -> bool:
    """Check whether states have latitude and longitude, in degrees."""
    return {"lat", "lon"} <= set(names)


def is_box(columns: Sequence[str]) -> bool:
    """Check whether states are boxes in pictures."""
    return tuple(columns[: len(BOX)]) == BOX


def with_centres(axes: dict[str, Floats]) -> dict[str, Floats]:
    """Return the columns of axes, with centres if the states are boxes."""
    if not is_box(list(axes)):
        return axes
    x, y = axes["left"] + axes["width"] / 2, axes["top"] + axes["height"] / 2
    return axes | {"centre x": x, "centre y": y}


def map_stretch(latitudes: Floats) -> float:
    """Return a degree of latitude divided by a degree of longitude, at the mean latitude."""
    mean = float(np.mean(latitudes)) if len(latitudes) else 0.0
    return 1 / math.cos(math.radians(mean)) if abs(mean) <= FARTHEST_NORTH else 1.0


def _windows(result: Evaluation, windows: Windows) -> Json:
    """Return (cost / n)^(1/p) by part and window, with n steps of the horizon in the window."""
    table, power = result.table("windows"), 1 / result.proof.parameters.order
    each = np.maximum(np.array(table["steps"]), 1)
    costs: dict[str, Floats] = {name: np.array(table[name]) for name in PARTS}
    costs["total"] = sum(costs.values(), np.zeros(len(each)))
    return {
        "size": windows.size,
        "first": windows.first.tolist(),
        "last": windows.last.tolist(),
        "tgospa": rounded(table["tgospa"]),
        "lines": {n: rounded(((cost / each) ** power).tolist()) for n, cost in costs.items()},
    }


def _joined(parts: list[PairEvaluation], name: str, size: int) -> tuple[Rows, list[Clouds]]:
    """Return the rows of one side in all parts, with all tracks numbered, and their clouds."""
    none = np.zeros(0, np.int64)
    tables: list[Rows] = [
        dict.fromkeys(("track", "step", "other", "error", "shared", "cloud", "unjudged"), none)
        | {"state": np.zeros((0, size)), "spread": np.zeros((0, 0))}
    ]
    clouds: list[Clouds] = []
    other = "estimate" if name == "truth" else "truth"
    first = {"truth": 0, "estimate": 0}
    for part in parts:
        rows = _rows(part, name, other)
        rows["other"] += np.where(rows["other"] < 0, 0, first[other])
        rows["cloud"][rows["cloud"] != NONE] += sum(map(len, clouds))
        clouds += [] if (own := _clouds(part, name)) is None else [own]
        tables.append(rows | {"track": rows["track"] + first[name]})
        first["truth"] += len(part.labels.truths)
        first["estimate"] += len(part.labels.estimates)
    wide = max(rows["spread"].shape[1] for rows in tables)
    for rows in tables:  # some parts may have points without a spread
        if rows["spread"].shape[1] != wide:
            rows["spread"] = np.zeros((len(rows["track"]), wide))
    return {name: np.concatenate([rows[name] for rows in tables]) for name in tables[0]}, clouds


def _clouds(part: PairEvaluation, name: str) -> Clouds | None:
    clouds: Clouds | None = getattr(part.proof.compared, f"{name}_clouds")
    return clouds


def _rows(result: PairEvaluation, name: str, other: str) -> Rows:
    states, problem = result.proof.states, result.proof.states.problem
    own_row: Ints = getattr(problem, f"{name}_row")
    other_row: Ints = getattr(problem, f"{other}_row")
    other_track: Ints = getattr(problem, f"{other}_track")
    step = getattr(problem, f"{name}_step").astype(np.int64)
    track = getattr(problem, f"{name}_track").astype(np.int64)

    used = np.flatnonzero((states.entry >= 0) & (result.proof.weights > 0))
    entry, weight = states.entry[used].astype(np.int64), result.proof.weights[used]
    order = np.argsort(weight, kind="stable")  # the largest weight of a row comes last and is kept
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
    unjudged = problem.sides[name == "estimate"].unjudged
    if unjudged is None:
        unjudged = np.zeros(len(step), bool)
    partner[(partner == NONE) & unjudged] = FREE

    compared = result.proof.compared
    rows: Rows = {"track": track, "step": step, "other": partner, "error": error}
    rows |= {"shared": (partner >= 0) & (best < ONE), "unjudged": unjudged}
    covariance, clouds = (getattr(compared, f"{name}_{what}") for what in ("covariance", "clouds"))
    return by_track(rows, getattr(compared, name), covariance, clouds)


def by_track(rows: Rows, state: Floats, covariance: Floats | None, clouds: Clouds | None) -> Rows:
    """Return rows with these states and their shapes, sorted by track."""
    count = len(state)
    spread = np.zeros((count, 0)) if covariance is None else covariance
    cloud = np.full(count, NONE) if clouds is None else np.arange(count)
    order = np.argsort(rows["track"], kind="stable")
    rows = rows | {"state": state, "spread": spread, "cloud": cloud}
    return {column: values[order] for column, values in rows.items()}


def _runs(side: Rows) -> tuple[Ints, Ints]:
    """Return the first and last row of each run."""
    track, step = side["track"], side["step"]
    opens = np.ones(len(track), bool)
    opens[1:] = (np.diff(track) != 0) | (np.diff(step) != 1)
    for name in {"other", "unjudged"} & side.keys():
        opens[1:] |= side[name][1:] != side[name][:-1]
    first = np.flatnonzero(opens)
    return first, np.append(first, len(track))[1:] - 1


def _thinned(
    sides: dict[str, Rows], runs: dict[str, tuple[Ints, Ints]]
) -> tuple[int, dict[str, Ints]]:
    """Return the stride (in steps) for about `VALUES` drawn coordinates, and the drawn rows."""
    stride = max(1, -(-sum(side["state"].size for side in sides.values()) // VALUES))
    while True:
        kept = {name: _shown_rows(side, *runs[name], stride) for name, side in sides.items()}
        # Steps of thinned rows are irregular, so they are stored like a coordinate.
        each = [side["state"].shape[1] + (stride > 1) for side in sides.values()]
        size = sum(n * len(rows) for n, rows in zip(each, kept.values(), strict=True))
        if size <= VALUES or stride >= COARSEST:
            return stride, kept
        stride += -(-stride // 4)


def _shown_rows(side: Rows, opens: Ints, closes: Ints, stride: int) -> Ints:
    """Return rows to draw: every `stride` steps, both ends of runs, and all unassigned states."""
    if not side["state"].shape[1]:
        return np.zeros(0, np.int64)
    keep = (side["step"] % stride == 0) | (side["other"] == NONE)
    keep[opens] = True
    keep[closes] = True
    return np.flatnonzero(keep)


def _grid(states: list[Floats], size: int) -> tuple[list[float], list[float]]:
    """Return the origin and step of the grid on which each coordinate is encoded."""
    known = np.concatenate([state for state in states if state.shape[1] == size] or [np.zeros(0)])
    if not size or not len(known):
        return [0.0] * size, [1.0] * size
    # by columns, which is ten times faster on a narrow array
    low, high = (np.array([end(column) for column in known.T]) for end in (np.min, np.max))
    quantum = (high / 2 - low / 2) / (LEVELS / 2)
    return low.tolist(), np.where(quantum > 0, quantum, 1.0).tolist()


def _tracks(result: Evaluation, side: str) -> Columns:
    """Return the table of tracks with the same column names for both sides, and the total.

    For data in parts the table has the costliest tracks.
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


def _switches(parts: list[PairEvaluation]) -> Columns:
    """Return the table of switches with numbers of steps and tracks."""
    rows: Columns = {name: [] for name in ("step", "truth", "from", "to", "mass", "cost")}
    truths = estimates = 0
    for part in parts:
        switches = read_switches(part.proof.states, part.proof.weights)
        rows["step"] += switches.step.tolist()
        rows["truth"] += (switches.truth + truths).tolist()
        for name, track in (("from", switches.before), ("to", switches.after)):
            rows[name] += np.where(track < 0, NONE, track + estimates).tolist()
        table = part.table("switches")
        for name in ("mass", "cost"):
            rows[name] += rounded(table[name])
        truths, estimates = truths + len(part.labels.truths), estimates + len(part.labels.estimates)
    return rows


def _repairs(result: Evaluation) -> Columns:
    """Return track numbers and steps of each repair, and the repair in words."""
    explained = explanation_of(result)
    repairs = () if explained is None else explained.repairs
    times = result.labels.times if repairs else []
    step: dict[Time | None, int] = {t: k for k, t in enumerate(times)}
    return {
        "tracks": [list(repair.tracks) for repair in repairs],
        "from": [step.get(repair.begin, NONE) for repair in repairs],
        "to": [step.get(repair.end, NONE) for repair in repairs],
        "text": [repair.text for repair in repairs],
    }


# -------------------------------------------------------------------------------------------------
# Ellipses, and data over time, thinned if there are many steps.

NUMBERS = 150_000
"""Largest number of encoded elements of covariances; if there are more, steps are left out."""

FINE = 50
"""Levels of a standard deviation are logarithmic: FINE levels are a factor of e, a level 2 %."""

INSIDE = 0.95
"""Share of a normal distribution inside the drawn shape around a state."""

RADIUS = (NormalDist().inv_cdf((1 + INSIDE) / 2), math.sqrt(-2 * math.log(1 - INSIDE)))
"""Roots of the quantiles of the chi-square distribution with one and two degrees of freedom."""

FAINT = 1000
"""Level of the smallest standard deviations, such as 0: invisible next to the largest."""

ANGLE = 64
"""Levels of an angle for each radian."""


def described(spreads: list[Floats], stride: int) -> Json:
    """Return the scales of the encoded covariances of both sides; empty without ellipses.

    Parameters
    ----------
    spreads : list of (R, d (d + 1) / 2) float arrays
        Lower triangles; (R, 0) for points.
    stride : int
        Stride between encoded positions.
    """
    around = [spread for spread in spreads if spread.size]
    if not around:
        return {}
    rows, columns = np.tril_indices(size_of(around[0].shape[1]))
    largest = np.max([deviations(s[:, rows == columns]).max(axis=0) for s in around], axis=0)
    size = sum(spread.size for spread in around) // stride
    return {
        "stride": stride * max(1, -(-size // NUMBERS)),
        "largest": largest.tolist(),
        "radius": RADIUS,
        "states": sum(map(len, around)),
        "fine": FINE,
        "faint": FAINT,
        "angle": ANGLE,
    }


def encoded(track: Ints, step: Ints, spread: Floats, how: Json) -> dict[str, Ints]:
    """Return the encoded rows, sorted by track, and the levels of each entry, by name.

    Rows are encoded every `how["stride"]` steps, and at the begin and the end of each track.
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
    """Return lower triangles (K, d (d + 1) / 2) as integers, an array for each entry."""
    rows, columns = np.tril_indices(size_of(spread.shape[1]))
    diagonal = rows == columns
    deviation = deviations(spread[:, diagonal])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        size = -FINE * np.log(deviation / largest)
        correlation = np.clip(spread / deviation[:, rows] / deviation[:, columns], -1, 1)
        level = np.where(diagonal, size[:, rows], ANGLE * np.arcsin(correlation))
    # A deviation of 0 has neither a logarithm nor a correlation.
    level = np.where(np.isfinite(level), level, np.where(diagonal, FAINT, 0))
    return list(np.rint(np.minimum(level, FAINT)).astype(np.int64).T)


def deviations(variances: Floats) -> Floats:
    """Return square roots of variances, 0 for variances that overflowed."""
    return np.sqrt(np.where(np.isfinite(variances), np.maximum(variances, 0.0), 0.0))


MAX_STRETCHES = 600
"""Largest number of drawn groups of steps for data in parts."""

SHOWN_ROWS = 20
"""Largest number of listed steps and tracks for data in parts."""


def curves(result: Evaluation) -> dict[str, list[float]]:
    """Return the normalised cumulative cost: the root of the mean cost up to each step.

    The value at step k is (sum_{l <= k} cost(l) / n(k))^(1/p), where n(k) is the number of steps of
    the horizon up to k. The last value of ``total`` is `normalised`. If the curve was requested, an
    evaluation of the steps 1..k gives the costs. Otherwise they are those of the assignment of the
    whole recording, an upper bound of the metric of the steps 1..k.
    """
    split, steps = result.proof.breakdown, np.maximum(result.evaluated_on.so_far, 1)
    if result.curve_bounds is not None:
        parts = dict(zip(PARTS, result.curve_bounds.parts, strict=True))
    else:
        parts = {name: np.cumsum(getattr(split, name)) for name in PARTS}
    parts["total"] = sum(parts.values(), np.zeros(len(steps)))
    parameters = result.proof.parameters
    return {
        name: (parameters.cutoff * (cost / steps) ** (1 / parameters.order)).tolist()
        for name, cost in parts.items()
    }


def rounded(values: list[float]) -> list[float]:
    """Round to seven digits, more than any page shows."""
    exact = np.array(values, float)
    size = np.where(exact == 0, 1.0, np.abs(exact))
    with np.errstate(over="ignore", invalid="ignore"):  # numbers may be too small or too large
        factor = 10.0 ** (6 - np.floor(np.log10(size)))
        rounded = np.rint(exact * factor) / factor
    shortest: list[float] = np.where(np.isfinite(rounded), rounded, exact).tolist()
    return shortest


def binned(total: Floats, max_bins: int) -> tuple[Ints, Ints]:
    """Return the first and costliest step of each of at most `max_bins` bins of equal length."""
    together = max(1, -(-len(total) // max_bins))
    first = np.arange(0, len(total), together)
    padded = np.full(len(first) * together, -1.0)
    padded[: len(total)] = total
    return first, first + padded.reshape(len(first), together).argmax(axis=1)


def _consistency(result: Evaluation, table: Columns, first: Ints) -> Json:
    """Return the NEES and its band at the first step of each group, and ranks of particles."""
    assert result.nees is not None
    names = ("nees", "nees_lower", "nees_upper")
    return {
        "lines": {name: [table[name][k] for k in first.tolist()] for name in names},
        "ideal": result.nees.components,
        "words": result.nees.in_words,
        "ranks": result.nees.ranks,
        "columns": result.settings["columns"],
    }


def over_time(result: Evaluation, stretches: int) -> Json:
    """Return means over at most `stretches` groups of steps, and the curve at their ends."""
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
        "axis": describe_times(times),
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
