"""Plain data for the page and pictures of a result: costs, lanes, positions and events.

- The two sides are the truth and the estimate.
- A lane is a trajectory of a side. Its rows are its states.
- Events are missed states, false states and switches. If there are very many states, some rows are
  left out, but no events.
- A run is a sequence of states of a lane at consecutive steps. All states of a run have the same
  partner, or all have none.
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
"""R states of one side, sorted by track and step. Each column is an array with R entries.

- ``track``, ``step``: indices
- ``other``: index of the partner. This is the track of the other side with the largest weight at
  this step. If "unassigned" has the largest weight, the index is `NONE` or `FREE`.
- ``error``: distance to the partner, as a fraction of the cutoff; 1 for unassigned states
- ``shared``: true if the weight of the partner is less than 1
- ``unjudged``: true for ignored or excused states
- ``state`` (R, d): the d state columns; (R, 0) if states are unknown
- ``spread`` (R, d (d + 1) / 2): lower triangles of covariances; (R, 0) for points
- ``cloud``: index of the particle cloud, or `NONE`
"""

VALUES = 800_000
"""Largest number of coordinates of both sides. If there are more, states without events are left
out."""

COARSEST = 50
"""Number of steps between drawn states. If it is reached, no more states are left out, because a
picture would show little but events."""

LEVELS = 1 << 16
"""Number of integers with which the page encodes the range of a coordinate."""

ERRORS = 1000
"""Integer with which the page encodes an error as large as the cutoff; 0 is no error."""

FARTHEST_NORTH = 88.0
"""Largest mean latitude, in degrees north or south, at which a map has equal scales."""

TIME = "t"
"""Name of the time if it is an axis of the plane."""

FARTHEST = 1e300
"""Largest coordinate in the plane. matplotlib subtracts coordinates, which must not overflow."""

FARTHEST_LEVEL = 1 << 29
"""Largest integer that encodes a coordinate: differences of two such integers fit into 32 bits."""

PARTICLES = 100_000
"""Largest number of drawn particles. If there are more, each cloud is drawn with fewer particles.
If that is not enough, clouds are drawn at fewer steps."""

MIN_PARTICLES, MAX_PARTICLES = 10, 200
"""Smallest and largest number of particles with which a cloud is drawn. If a cloud has fewer
particles, all of them are drawn."""

SHARES = 10_000
"""Integer with which the page encodes a weight of 1 of a particle."""

NONE, FREE = -1, -2
"""Values of ``other`` for states without a partner: `NONE` if the state is missed or false, `FREE`
if it is ignored or excused."""

KINDS = {"truth": "missed", "estimate": "false"}
"""For each side, the part of the cost that its unassigned states have."""

RUN = ("track", "begin", "end", "other")
"""Fields of each run: indices of its track, its first and last step, and its partner."""


def plane_columns(known: Sequence[str], requested: Sequence[str] | None) -> tuple[str, str]:
    """Return the names of the horizontal and the vertical axis of the plane.

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
    """Everything that is drawn of one side.

    Parameters
    ----------
    name : str
        Side, ``"truth"`` or ``"estimate"``.
    table : dict
        Columns with the id, costs, counts and number of steps of each track.
    run : dict
        Columns with an entry for each run, sorted by track and step. The columns are those of
        `RUN`, and possibly ``unjudged``.
    row : dict
        Drawn states, with the columns of `Rows`.
    particles : dict
        Columns with an entry for each of P drawn particles: ``row``, the index of its state in
        `row`; ``state`` (P, d), its coordinates; and ``weight``, the share of the cloud that it
        represents.
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
        """Indices of the rows that are missed or false."""
        return np.flatnonzero(self.row["other"] == NONE)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlotData:
    """Data to draw. The page uses `document` and `arrays`, pictures use `document` and the sides.

    Parameters
    ----------
    document : Json
        Data over time, and values to decode the arrays. Data over time are in groups of
        ``together`` consecutive steps:

        - ``times``: time of the first step of each group
        - ``costs``, ``counts``: means over the steps of each group
        - ``curve``: values at the last step of each group
        - ``worst``: single steps with the highest costs, if groups have several steps

        Other fields are:

        - ``stretch``: for a map, the result of `map_stretch`
        - ``spread``: scales of encoded ellipses; empty without ellipses
        - ``particles``: for each side, the number of drawn particles and of all particles
        - ``words``: displayed names of sides and parts, if they differ from the keys
    arrays : dict of str to int array
        Rows, runs, particles and ellipses of both sides, encoded as integers for the page.
    truth, estimate : SideData
        The two sides.
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
        """Coordinates of the rows of each side, by side and by name of an axis of the plane.

        The possible axes are the state columns, the centres of boxes, and the time.
        """
        return {side.name: self.places(side.row["state"], side.row["step"]) for side in self.sides}

    @property
    def sides(self) -> tuple[SideData, SideData]:
        """Truth and estimate."""
        return self.truth, self.estimate

    def places(self, state: Floats, step: Ints) -> dict[str, Floats]:
        """Return the coordinates of states (R, d) at these steps, by name of an axis."""
        columns = np.clip(state.T, -FARTHEST, FARTHEST)
        shown = with_centres(dict(zip(self.document["columns"], columns, strict=True)))
        return shown | {TIME: self.time.at[step]} if shown else {}

    def word(self, name: str) -> str:
        """Return the displayed name of a side or a part."""
        return str(self.document["words"].get(name, name))

    @property
    def steps(self) -> int:
        """Number of groups of steps; usually a group is a single step."""
        return len(self.document["times"])

    @property
    def switches(self) -> dict[str, Ints]:
        """Table of switches: an array for each column."""
        return {name: np.asarray(column) for name, column in self.document["switches"].items()}

    @cached_property
    def time(self) -> TimeAxis:
        """Time axis of the pictures."""
        return TimeAxis(times=self.document["times"], axis=self.document["axis"])


_MADE: WeakKeyDictionary[Evaluation | Pairing, PlotData] = WeakKeyDictionary()


def plot_data(result: Evaluation | Pairing) -> PlotData:
    """Return the data for the page and pictures of a result; the first call computes them."""
    if result not in _MADE:
        if isinstance(result, Pairing):
            _MADE[result] = _association_data(result)
        else:
            _MADE[result] = _result_data(result)
    return _MADE[result]


def _result_data(result: Evaluation) -> PlotData:
    """Return the data for the page and pictures of a result.

    If classes are evaluated separately, indices of tracks continue from class to class.
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
"""Displayed names of sides and parts on pictures of an association."""


def _association_data(pairing: Pairing) -> PlotData:
    """Return data to draw an association as if it were an evaluation.

    The first side is drawn as the truth, the second as the estimate. Costs have order 1: half a
    cutoff for each unassociated state, and the distance for each pair.
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
    """Return data to draw, from the rows and clouds of each side.

    Parameters
    ----------
    given : mapping of str to pair
        Rows of each side, and a list of its clouds. ``cloud`` of a row is an index in the joined
        list.
    columns : sequence of str
        State columns.
    tables : mapping of str to columns
        Table of the tracks of each side.
    document : dict
        Data over time, as in `PlotData`.
    about : str
        Value and parameters in words.
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
        # State, origin and step are halved first: the difference could overflow otherwise.
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
    """Return the particles to draw. Clouds of `row` are drawn only at every `every`-th step.

    From a cloud with too many particles, some are selected by systematic resampling. The weights of
    the particles are put on a line one after the other, and the line is divided into equal
    intervals. A particle is drawn if it is at the middle of an interval. Its weight becomes the sum
    of these intervals. `size` is the number of state columns.
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
        if len(points) > 1:  # a single particle is drawn as a point anyway
            particles.append({"row": np.full(len(points), k), "state": points, "weight": weights})
    none: Rows = {"row": np.zeros(0, np.int64), "state": np.zeros((0, size)), "weight": np.zeros(0)}
    return {name: np.concatenate([none[name], *(one[name] for one in particles)]) for name in none}


def is_map(names: Collection[str]) -> bool:
    """Check whether the names include latitude and longitude, which are in degrees."""
    return {"lat", "lon"} <= set(names)


def is_box(columns: Sequence[str]) -> bool:
    """Check whether states with these columns are drawn as boxes."""
    return tuple(columns[: len(BOX)]) == BOX


def with_centres(axes: dict[str, Floats]) -> dict[str, Floats]:
    """Return these columns. For boxes, add the coordinates of the centres."""
    if not is_box(list(axes)):
        return axes
    x, y = axes["left"] + axes["width"] / 2, axes["top"] + axes["height"] / 2
    return axes | {"centre x": x, "centre y": y}


def map_stretch(latitudes: Floats) -> float:
    """Return the length of a degree of latitude, divided by that of a degree of longitude.

    The lengths are measured at the mean of the latitudes. Near a pole, the result is 1.
    """
    mean = float(np.mean(latitudes)) if len(latitudes) else 0.0
    return 1 / math.cos(math.radians(mean)) if abs(mean) <= FARTHEST_NORTH else 1.0


def _windows(result: Evaluation, windows: Windows) -> Json:
    """Return the data about windows: size, first and last steps, TGOSPA, and a line for each part.

    A line has the normalised value of the part in each window.
    """
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
    """Join the rows and clouds of one side of several results.

    Each of the `parts` is the result of a class. Indices of tracks and clouds continue from part to
    part. `size` is the number of state columns.
    """
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
    for rows in tables:  # rows of parts without covariances get zeros
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
    order = np.argsort(weight, kind="stable")  # the largest weight of a row overwrites the others
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
    """Return the rows sorted by track, with columns for their states, covariances and clouds."""
    count = len(state)
    spread = np.zeros((count, 0)) if covariance is None else covariance
    cloud = np.full(count, NONE) if clouds is None else np.arange(count)
    order = np.argsort(rows["track"], kind="stable")
    rows = rows | {"state": state, "spread": spread, "cloud": cloud}
    return {column: values[order] for column, values in rows.items()}


def _runs(side: Rows) -> tuple[Ints, Ints]:
    """Return the indices of the first and the last row of each run."""
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
    """Return the number of steps between drawn states, and the drawn rows of each side.

    The number is increased until at most `VALUES` coordinates are left, or until it reaches
    `COARSEST`.
    """
    stride = max(1, -(-sum(side["state"].size for side in sides.values()) // VALUES))
    while True:
        kept = {name: _shown_rows(side, *runs[name], stride) for name, side in sides.items()}
        # If rows are left out, the steps of the drawn rows are irregular. These steps are stored,
        # too, like one more coordinate.
        each = [side["state"].shape[1] + (stride > 1) for side in sides.values()]
        size = sum(n * len(rows) for n, rows in zip(each, kept.values(), strict=True))
        if size <= VALUES or stride >= COARSEST:
            return stride, kept
        stride += -(-stride // 4)


def _shown_rows(side: Rows, opens: Ints, closes: Ints, stride: int) -> Ints:
    """Return rows to draw: at every `stride`-th step, ends of runs, and missed or false states."""
    if not side["state"].shape[1]:
        return np.zeros(0, np.int64)
    keep = (side["step"] % stride == 0) | (side["other"] == NONE)
    keep[opens] = True
    keep[closes] = True
    return np.flatnonzero(keep)


def _grid(states: list[Floats], size: int) -> tuple[list[float], list[float]]:
    """Return the origin and the step of the grid to which each coordinate is rounded."""
    known = np.concatenate([state for state in states if state.shape[1] == size] or [np.zeros(0)])
    if not size or not len(known):
        return [0.0] * size, [1.0] * size
    # Each column is reduced separately. If columns are few, `min(axis=0)` takes ten times as long.
    low, high = (np.array([end(column) for column in known.T]) for end in (np.min, np.max))
    quantum = (high / 2 - low / 2) / (LEVELS / 2)
    return low.tolist(), np.where(quantum > 0, quantum, 1.0).tolist()


def _tracks(result: Evaluation, side: str) -> Columns:
    """Return the table of the tracks of a side, with column names that do not depend on the side.

    For data in parts, the table has only the costliest tracks.
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
    """Return the table of switches, with indices of steps and tracks."""
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
    """Return a table of repairs: indices of the tracks, first and last step, and text of each."""
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
# Covariances, encoded as integers, called levels; and data over time.

NUMBERS = 150_000
"""Largest number of encoded entries of covariances. If there are more, covariances are encoded at
fewer steps."""

FINE = 50
"""Number of levels for a factor of e in the standard deviation. From one level to the next, the
standard deviation changes by 2 %."""

INSIDE = 0.95
"""Share of a normal distribution that is inside the drawn ellipse or interval around a state."""

RADIUS = (NormalDist().inv_cdf((1 + INSIDE) / 2), math.sqrt(-2 * math.log(1 - INSIDE)))
"""Half the length of the interval, and the radius of the ellipse, in standard deviations."""

FAINT = 1000
"""Largest level. It encodes standard deviations that are 0, or invisible next to the largest."""

ANGLE = 64
"""Number of levels in a radian. A correlation is encoded as an angle, its arcsine."""


def described(spreads: list[Floats], stride: int) -> Json:
    """Return what the page needs to decode covariances; empty without covariances.

    `spreads` has arrays of lower triangles like the column ``spread`` of `Rows`. `stride` is the
    number of steps between drawn states.
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
    """Encode covariances of rows that are sorted by track; `how` is the result of `described`.

    Only some rows are encoded: at every ``stride``-th step, and at both ends of each track. In the
    result, ``row`` has the indices of these rows. Each other array has the levels of one entry of
    the lower triangle. Its name is the index of the entry.
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
    """Encode K lower triangles (K, d (d + 1) / 2); return an array of K levels for each entry.

    A variance becomes the logarithm of the standard deviation, relative to the `largest` of its
    column. A covariance of two columns becomes the arcsine of the correlation.
    """
    rows, columns = np.tril_indices(size_of(spread.shape[1]))
    diagonal = rows == columns
    deviation = deviations(spread[:, diagonal])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        size = -FINE * np.log(deviation / largest)
        correlation = np.clip(spread / deviation[:, rows] / deviation[:, columns], -1, 1)
        level = np.where(diagonal, size[:, rows], ANGLE * np.arcsin(correlation))
    # If a standard deviation is 0, the logarithm and the correlation are not finite.
    level = np.where(np.isfinite(level), level, np.where(diagonal, FAINT, 0))
    return list(np.rint(np.minimum(level, FAINT)).astype(np.int64).T)


def deviations(variances: Floats) -> Floats:
    """Return square roots of variances, 0 for negative variances and for those that overflowed."""
    return np.sqrt(np.where(np.isfinite(variances), np.maximum(variances, 0.0), 0.0))


MAX_STRETCHES = 600
"""Largest number of groups of steps on pictures of data in parts."""

SHOWN_ROWS = 20
"""Largest number of steps, and of tracks, that are listed for data in parts."""


def curves(result: Evaluation) -> dict[str, list[float]]:
    """Return the normalised cumulative cost at each step, for each part and ``total``.

    At step k, let C be the cost of the steps up to k, and n the number of steps of the horizon up
    to k. The value is (C / n)^(1/p). The last value of ``total`` is `normalised`.

    If the curve was requested, C is from an evaluation of the steps 1..k. Otherwise C is from the
    assignment of the whole recording. Then ``total`` is an upper bound of the curve.
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
    with np.errstate(over="ignore", invalid="ignore"):  # the factor overflows for tiny values
        factor = 10.0 ** (6 - np.floor(np.log10(size)))
        rounded = np.rint(exact * factor) / factor
    shortest: list[float] = np.where(np.isfinite(rounded), rounded, exact).tolist()
    return shortest


def binned(total: Floats, max_bins: int) -> tuple[Ints, Ints]:
    """Divide the steps into at most `max_bins` groups of equal length; the last can be shorter.

    Return the index of the first step and of the costliest step of each group.
    """
    together = max(1, -(-len(total) // max_bins))
    first = np.arange(0, len(total), together)
    padded = np.full(len(first) * together, -1.0)
    padded[: len(total)] = total
    return first, first + padded.reshape(len(first), together).argmax(axis=1)


def _consistency(result: Evaluation, table: Columns, first: Ints) -> Json:
    """Return the NEES and its band at the first step of each group, and a histogram of ranks."""
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
    """Return the data over time, as in `PlotData`, for at most `stretches` groups of steps."""
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
