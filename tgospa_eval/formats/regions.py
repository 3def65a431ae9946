"""Regions from a CSV file, a table or GeoJSON."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.errors import InputError
from tgospa_eval.formats.fields import floats, is_number
from tgospa_eval.formats.headers import FIRST_ALIASES
from tgospa_eval.formats.loading import load, unpack
from tgospa_eval.formats.text.lines import decode
from tgospa_eval.formats.text.small import rows_of
from tgospa_eval.formats.times import TimeError, parse_times
from tgospa_eval.text import listed, quoted
from tgospa_eval.tracks.regions import GEOJSON, POLYGON, SHAPES, Regions, Shape

NEEDED = "; or ".join(",".join(columns) for columns in SHAPES.values())
"""Columns of a region."""

KNOWN = {name for columns in SHAPES.values() for name in columns}


def read_regions(path: str, decimal: str = ".") -> Regions:
    """Regions of a CSV file, delimited by comma, semicolon or tab, or of a GeoJSON document.

    Raises
    ------
    InputError
        The file is missing, has other columns, or a region is wrong.
    """
    data = unpack(load(path), path)
    if not data.strip():
        raise InputError(f"{path}: the file is empty; regions need a header with {NEEDED}")
    if data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"{":
        try:
            return of_geojson(json.loads(decode(data, path)), path)
        except json.JSONDecodeError as error:
            place = f"{path}, line {error.lineno}, column {error.colno}"
            raise InputError(f"{place}: no JSON: {error.msg}") from None
        except RecursionError:
            raise InputError(f"{path}: no GeoJSON: lists in lists without end") from None
    lines, rows = rows_of(data, path, decimal, even=True)
    return of_rows(rows[0], rows[1:], [f"{path}, line {line}" for line in lines], decimal, path)


def of_rows(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    places: Sequence[str],
    decimal: str,
    name: str,
) -> Regions:
    """Regions of the rows of a table; `places` are those of the header and of each row.

    Raises
    ------
    InputError
        A column is unknown, or a region is wrong.
    """
    names = [text.strip().lower() for text in header]
    time = next((text for text in names if text in FIRST_ALIASES["t"]), "")
    unknown = [text for text in names if text not in {*KNOWN, time}]
    whole = any({*columns} <= {*names} for columns in SHAPES.values())
    if unknown or len({*names}) < len(names) or not whole:
        what = "columns are missing or double"
        if unknown:
            what = f"column {quoted(unknown[0])} is none of regions"
        raise InputError(f"{places[0]}: {what}; they have t, if they are of one step, and {NEEDED}")
    shapes, moments = [], []
    for place, row in zip(places[1:], rows, strict=True):
        cells = {key: text.strip() for key, text in zip(names, row, strict=True)}
        moments.append(cells.pop(time, ""))
        given = {key: text for key, text in cells.items() if text}
        kind = next((kind for kind, columns in SHAPES.items() if {*columns} == {*given}), None)
        if kind is None:
            has = listed(given) or "nothing"
            raise InputError(f"{place}: has {has}; a region has {NEEDED}")
        if kind == POLYGON:
            corners = [corner.split() for corner in given[kind].strip(" ;").split(";")]
            if any(len(corner) != 2 for corner in corners):
                raise InputError(
                    f"{place}, column {quoted(kind)}: {quoted(given[kind])}; write its corners as "
                    "x y; x y; x y"
                )
            columns, texts = [kind] * 2 * len(corners), [text for pair in corners for text in pair]
        else:
            columns, texts = list(SHAPES[kind]), [given[key] for key in SHAPES[kind]]
        for key, text in zip(columns, texts, strict=True):
            if not is_number(text, decimal):
                raise InputError(f"{place}, column {quoted(key)}: not a number: {quoted(text)}")
        numbers = floats(texts, decimal)
        ring = numbers.reshape(-1, 2) if kind == POLYGON else numbers
        shapes.append(Shape(kind=kind, rings=(ring,), where=place))
    of_time = f", column {quoted(time)}"
    return _regions(shapes, moments, lambda row: f"{places[1 + row]}{of_time}", decimal, name)


def of_geojson(document: Any, name: str) -> Regions:
    """Regions of a FeatureCollection, a Feature or a geometry; the property t is their step.

    Raises
    ------
    InputError
        It has other geometries than polygons, or one is wrong.
    """
    if not isinstance(document, Mapping):
        raise InputError(f"{name}: no GeoJSON; a FeatureCollection of polygons is")
    kind = document.get("type")
    features = document.get("features") if kind == "FeatureCollection" else [document]
    shapes, moments, places = [], [], []
    for k, feature in enumerate(features if isinstance(features, list) else [features]):
        where = f"{name}, feature {k}"
        whole = isinstance(feature, Mapping) and feature.get("type") == "Feature"
        geometry, known = (
            (feature.get("geometry"), feature.get("properties")) if whole else (feature, None)
        )
        moment = known.get("t") if isinstance(known, Mapping) else None
        for rings in _polygons(geometry, where):
            shapes.append(Shape(kind=GEOJSON, rings=rings, where=where))
            moments.append("" if moment is None else str(moment))
            places.append(f'{where}, property "t"')
    return _regions(shapes, moments, places.__getitem__, ".", name)


def _polygons(geometry: Any, where: str) -> list[tuple[Floats, ...]]:
    """The rings of each polygon of a geometry; of positions the first two numbers."""
    kind = geometry.get("type") if isinstance(geometry, Mapping) else None
    if kind not in ("Polygon", "MultiPolygon"):
        raise InputError(f"{where}: {quoted(kind)} is no Polygon and no MultiPolygon")
    try:
        given = geometry["coordinates"]
        return [
            tuple(np.array([(_plain(x), _plain(y)) for x, y, *_ in ring]) for ring in (*rings,))
            for rings in ([given] if kind == "Polygon" else given)
            if rings[0][2]  # an edge of three corners or more
        ]
    except (LookupError, TypeError, ValueError, OverflowError):
        raise InputError(
            f"{where}: the coordinates of a {kind} are lists of rings of positions, such as "
            "[[[0, 0], [4, 0], [4, 3], [0, 0]]]"
        ) from None


def _plain(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError
    return float(value)


def _regions(
    shapes: Sequence[Shape],
    moments: Sequence[str],
    where: Callable[[int], str],
    decimal: str,
    name: str,
) -> Regions:
    """With the times of those that have any."""
    timed = [k for k, moment in enumerate(moments) if moment.strip()]
    try:
        times = parse_times([moments[k] for k in timed], lambda texts: floats(texts, decimal))
    except TimeError as error:
        raise InputError(f"{where(timed[error.row])}: {error}") from None
    found = list(shapes)
    for k, moment in zip(timed, times.value.tolist(), strict=True):
        found[k] = replace(found[k], moment=moment)
    return Regions(shapes=tuple(found), clock=times.clock, name=name)
