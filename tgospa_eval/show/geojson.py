"""A result as GeoJSON (RFC 7946): tracks, misses, false targets, errors and switches on a map."""

import itertools
import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.pair import EvaluationByClass, PairEvaluation
from tgospa_eval.problem.solution import read_assigned, read_switches, read_tracks
from tgospa_eval.problem.states import ONE, assigned, spare
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import Json
from tgospa_eval.text import option
from tgospa_eval.tracks.places import EARTH, on_earth

ROLES = ("truth", "estimate")
UNASSIGNED = ("missed", "false")


def geojson(result: Evaluation) -> str:
    """All features as a text; their property ``kind`` says what each is.

    Raises
    ------
    ConfigError
        The states are not on the Earth, or it is of data in parts.
    """
    made: list[Json] = []
    parts = result.results if isinstance(result, EvaluationByClass) else {"": result}
    for name, part in parts.items():
        if not isinstance(part, PairEvaluation):
            raise ConfigError(
                f"{option('geojson')}: data in parts have no states at hand; evaluate a part"
            )
        places = _places(part)
        found = [*_tracks(part, places), *_unassigned(part, places), *_pairs(part, places)]
        for feature in (*found, *_switches(part, places)):
            if isinstance(result, EvaluationByClass):
                feature["properties"]["class"] = name
            made.append(feature)
    document = {"type": "FeatureCollection", "features": made}
    return json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"


def _places(result: PairEvaluation) -> tuple[list[list[float]], list[list[float]]]:
    """Longitude, latitude and perhaps height of each row of truth and estimate."""
    compared = result.proof.compared
    states = compared.truth, compared.estimate
    columns = compared.columns
    if columns != EARTH[: len(columns)]:
        origin: Any = compared.settings.get("origin")
        if origin is None or "truth_crs" not in compared.settings:
            raise ConfigError(
                f"{option('geojson')} needs places on the Earth, and the states are "
                f"{','.join(columns)}: {option('truth_crs')}, {option('estimate_crs')} and "
                f"{option('origin')} say where they are"
            )
        states = on_earth(states[0], origin), on_earth(states[1], origin)
    first, second = (
        np.column_stack((np.mod(side[:, 1] + 180, 360) - 180, side[:, 0], side[:, 2:])).tolist()
        for side in states
    )
    return first, second


def _feature(kind: str, places: list[list[float]], **properties: object) -> Json:
    """A point, or a line of several places; lines that cross the date line are parted there."""
    if len(places) == 1:
        shape: Json = {"type": "Point", "coordinates": places[0]}
    else:
        parts = _parted(places)
        shape = {"type": "LineString", "coordinates": parts[0]}
        if len(parts) > 1:
            shape = {"type": "MultiLineString", "coordinates": parts}
    return {"type": "Feature", "geometry": shape, "properties": {"kind": kind, **properties}}


def _parted(places: list[list[float]]) -> list[list[list[float]]]:
    parts = [[places[0]]]
    for before, after in itertools.pairwise(places):
        if abs(after[0] - before[0]) > 180.0:
            parts.append([])
        parts[-1].append(after)
    return [part if len(part) > 1 else part * 2 for part in parts]


def _tracks(result: PairEvaluation, places: tuple[list[list[float]], ...]) -> Iterator[Json]:
    """Each trajectory as a line, with what it costs."""
    states, weights = result.proof.states, result.proof.weights
    labels, times = (result.labels.truths, result.labels.estimates), result.labels.times
    for of, (side, names) in enumerate(zip(states.problem.sides, labels, strict=True)):
        costs = read_tracks(states, weights, of)
        total = result.scale * (costs.localisation + costs.unassigned + costs.switch)
        order = np.argsort(side.track, kind="stable")
        first = np.searchsorted(side.track[order], np.arange(side.count + 1))
        for track, name in enumerate(names):
            rows = order[first[track] : first[track + 1]].tolist()
            if rows:
                yield _feature(
                    ROLES[of],
                    [places[of][row] for row in rows],
                    id=name,
                    first=times[side.step[rows[0]]],
                    last=times[side.step[rows[-1]]],
                    states=len(rows),
                    cost=float(total[track]),
                )


def _unassigned(result: PairEvaluation, places: tuple[list[list[float]], ...]) -> Iterator[Json]:
    """Each state that is missed, or false."""
    proof = result.proof
    _, entry, weight = assigned(proof.states, proof.weights)
    labels = result.labels.truths, result.labels.estimates
    for of, (side, names) in enumerate(zip(proof.states.problem.sides, labels, strict=True)):
        free = spare(side, entry, weight) / ONE
        for row in np.flatnonzero(free * side.price).tolist():
            yield _feature(
                UNASSIGNED[of],
                [places[of][row]],
                id=names[side.track[row]],
                t=result.labels.times[side.step[row]],
                cost=float(result.scale * side.price[row] * free[row]),
            )


def _pairs(result: PairEvaluation, places: tuple[list[list[float]], ...]) -> Iterator[Json]:
    """The error of each assigned pair, a line from the truth to the estimate."""
    problem = result.proof.states.problem
    entry = read_assigned(result.proof.states, result.proof.weights).entry
    table = result.table("assignments")
    rows = zip(
        *(table[name] for name in ("truth", "estimate", "t", "distance", "cost")), strict=True
    )
    for at, (truth, estimate, t, distance, cost) in zip(entry.tolist(), rows, strict=True):
        ends = places[0][problem.truth_row[at]], places[1][problem.estimate_row[at]]
        yield _feature(
            "error", list(ends), truth=truth, estimate=estimate, t=t, distance=distance, cost=cost
        )


def _switches(result: PairEvaluation, places: tuple[list[list[float]], ...]) -> Iterator[Json]:
    """Each switch, where its truth is, or was last."""
    truths = result.proof.states.problem.sides[0]
    found = read_switches(result.proof.states, result.proof.weights)
    key = truths.track.astype(np.int64) * (len(result.labels.times) + 1) + truths.step
    order = np.argsort(key)
    wanted = found.truth.astype(np.int64) * (len(result.labels.times) + 1) + found.step
    row = order[np.maximum(np.searchsorted(key[order], wanted, side="right") - 1, 0)]
    table = result.table("switches")
    for at, k in zip(row.tolist(), range(len(table["t"])), strict=True):
        own: Mapping[str, Any] = {name: column[k] for name, column in table.items()}
        yield _feature("switch", [places[0][at]], **own)
