"""nuScenes: annotations as the tables of a folder, results as the JSON of a tracking submission.

Results name samples by tokens; when these were, and of which scene, is in the tables alone.
"""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tgospa_eval.errors import InputError
from tgospa_eval.formats.guess import SAMPLES, is_table_folder
from tgospa_eval.formats.loading import check_memory, load, most_bytes
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.roles import find_roles
from tgospa_eval.formats.rows import Rows, number_ids, rows_by_components
from tgospa_eval.text import quoted

JSON_BYTES = 6
"""Bytes that a byte of JSON takes as objects of Python: 5.2, measured."""

Record = dict[str, Any]


Samples = Mapping[str, tuple[int, str]]
"""When samples were, in microseconds since 1970, and the name of their scene, by token."""


def read_samples(folder: str, options: ReadOptions) -> Samples:
    """The samples of a folder of tables.

    Raises
    ------
    InputError
        A table is missing, or no such table.
    """
    names: dict[str, str] = {}
    if os.path.isfile(os.path.join(folder, "scene.json")):
        names = {row["token"]: row["name"] for row in table(folder, "scene", options, "name")}
    path = os.path.join(folder, SAMPLES)
    found: dict[str, tuple[int, str]] = {}
    for k, row in enumerate(table(folder, "sample", options, "scene_token"), start=1):
        stamp = row.get("timestamp")
        if isinstance(stamp, bool) or not isinstance(stamp, int) or abs(stamp) >= 2**63:
            raise InputError(
                f"{path}, row {k}: timestamp is {quoted(stamp)}; it must be whole microseconds"
            )
        scene: str = row["scene_token"]
        found[row["token"]] = stamp, names.get(scene, scene)
    return found


def table(folder: str, name: str, options: ReadOptions, *texts: str) -> Sequence[Record]:
    """The records of a table; each has a token and these texts.

    Raises
    ------
    InputError
        The file is missing, or no such table.
    """
    path = os.path.join(folder, f"{name}.json")
    rows = load_json(path, load(path, most_bytes(options.max_input, path)), options)
    if not isinstance(rows, list):
        raise InputError(f"{path}: no table of nuScenes, which is a list of records")
    for k, row in enumerate(rows, start=1):
        for key in ("token", *texts):
            text = row.get(key) if isinstance(row, dict) else None
            if not isinstance(text, str) or not is_unicode(text):
                raise InputError(f"{path}, row {k}: no text {quoted(key)} in the record")
    return rows


def is_unicode(text: str) -> bool:
    """Whether a text can be written: JSON may have halves of characters."""
    return text.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in text)


def load_json(path: str, data: bytes, options: ReadOptions) -> Any:
    """The document in a file.

    Raises
    ------
    InputError
        It is no JSON, or too large.
    """
    size = len(data)
    check_memory(path, JSON_BYTES * size, size, options.max_input, f"{size:,} bytes of JSON")
    if not data:
        raise InputError(
            f'{path}: the file is empty; results without objects are {{"results": {{}}}}'
        )
    try:
        return json.loads(data)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise InputError(f"{path}, {place}: no readable JSON: {error.msg}") from None
    except (UnicodeDecodeError, RecursionError, ValueError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise InputError(f"{path}: no readable JSON: {reason}") from None


TRACKED = {
    "vehicle.bicycle": "bicycle",
    "vehicle.bus.bendy": "bus",
    "vehicle.bus.rigid": "bus",
    "vehicle.car": "car",
    "vehicle.motorcycle": "motorcycle",
    "human.pedestrian.adult": "pedestrian",
    "human.pedestrian.child": "pedestrian",
    "human.pedestrian.construction_worker": "pedestrian",
    "human.pedestrian.police_officer": "pedestrian",
    "vehicle.trailer": "trailer",
    "vehicle.truck": "truck",
}
"""Class of the tracking task for each category that takes part in it."""

PLACE = ("x", "y", "z")
NUMERIC_COLUMNS = (*PLACE, "size_width", "size_length", "size_height", "score")
NUSCENES_COLUMNS = ("id", "t", "class", *NUMERIC_COLUMNS)

LARGEST_PLACE = 1e300

NO_POINTS = "without a lidar or radar point left out, as by the rules of nuScenes"
NOT_TRACKED = "of categories that are not tracked left out"
NO_OBJECT = "for samples without an object, which are steps all the same"


class _Object(NamedTuple):
    """What is said of an object in a sample; nothing where a sample has none."""

    sample: str
    number: int = 0
    id: str = ""
    klass: str = ""
    numbers: tuple[float, ...] = (np.nan,) * len(NUMERIC_COLUMNS)
    apart: str = ""


def read_nuscenes(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a folder of tables, or of results in JSON, the same in either role.

    Raises
    ------
    InputError
        A table is missing or damaged, or an object is not as the format has it.
    """
    if os.path.isdir(path):
        samples = read_samples(path, options)
        found = list(_annotations(path, samples, options))
    else:
        results = _results(path, data, options)
        folder = _folder_for(path, options)
        samples = read_samples(folder, options)
        found = list(_tracks(path, results, samples, os.path.join(folder, SAMPLES)))
    return _rows(path, found, samples, options)


def _folder_for(path: str, options: ReadOptions) -> str:
    """The folder with the tables: the other side, or where either file is."""
    places = [*options.beside, *(os.path.dirname(other) or "." for other in options.beside)]
    for folder in (*places, os.path.dirname(path) or "."):
        if is_table_folder(folder):
            return folder
    raise InputError(
        f"{path}: names samples by tokens, whose times are in the tables of nuScenes: evaluate it "
        f"against their folder (v1.0-...), or put {SAMPLES} and scene.json beside it"
    )


def _results(path: str, data: bytes, options: ReadOptions) -> Mapping[str, Any]:
    """Objects by sample."""
    document = load_json(path, data, options)
    results = document.get("results") if isinstance(document, dict) else None
    folder = os.path.dirname(path) or "."
    if isinstance(document, list) and is_table_folder(folder):
        raise InputError(f"{path}: one of the tables of nuScenes; name their folder, {folder}")
    if not isinstance(results, dict):
        raise InputError(
            f'{path}: no results of nuScenes; they are {{"meta": ..., "results": {{sample token: '
            "[objects]}}"
        )
    return results


def _tracks(
    path: str, results: Mapping[str, Any], samples: Samples, table_path: str
) -> Iterator[_Object]:
    """Objects of results, and samples that have none."""
    scenes: dict[str, set[str]] = {}
    found: list[_Object] = []
    for token, objects in results.items():
        if token not in samples:
            raise InputError(
                f"{path}: sample {quoted(token)} is not in {table_path}; the tables must be of "
                "the version that was tracked"
            )
        if not isinstance(objects, list):
            raise InputError(f"{path}, sample {quoted(token)}: no list of objects")
        if not objects:
            found.append(_Object(token, apart=NO_OBJECT))
        scene = samples[token][1]
        for k, item in enumerate(objects, start=1):
            try:
                if not isinstance(item, dict):
                    raise TypeError("no object with keys")
                if "tracking_id" not in item and "detection_name" in item:
                    raise ValueError("a detection; TGOSPA compares tracks, with a tracking_id")
                name, klass = _text(item, "tracking_id"), _text(item, "tracking_name")
                numbers = tuple(_numbers(item))
            except (ValueError, TypeError) as error:
                place = _Object(token, k)
                raise InputError(f"{_where(path, place)}: {error}") from None
            scenes.setdefault(name, set()).add(scene)
            found.append(_Object(token, k, name, klass, numbers))
    for item in found:  # an id is one track in each scene
        several = len(scenes.get(item.id, ())) > 1
        yield item._replace(id=f"{samples[item.sample][1]}/{item.id}") if several else item


def _annotations(path: str, samples: Samples, options: ReadOptions) -> Iterator[_Object]:
    """Objects of the tables, and samples that have none."""
    categories = {row["token"]: row["name"] for row in table(path, "category", options, "name")}
    kinds = {
        row["token"]: categories.get(row["category_token"], "")
        for row in table(path, "instance", options, "category_token")
    }
    empty = dict.fromkeys(samples)
    tracked = set(TRACKED.values())
    rows = table(path, "sample_annotation", options, "sample_token", "instance_token")
    for k, item in enumerate(rows, start=1):
        sample, name = item["sample_token"], item["instance_token"]
        try:
            if sample not in samples:
                raise ValueError(f"sample {quoted(sample)} is not in {os.path.join(path, SAMPLES)}")
            if name not in kinds:
                raise ValueError(f"instance {quoted(name)} is not in instance.json")
            numbers = tuple(_numbers(item))
        except ValueError as error:
            raise InputError(f"{_where(path, _Object(sample, k))}: {error}") from None
        empty.pop(sample, None)
        klass = TRACKED.get(kinds[name], kinds[name])
        apart = "" if klass in tracked else NOT_TRACKED
        if not apart and item.get("num_lidar_pts") == item.get("num_radar_pts") == 0:
            apart = NO_POINTS
        yield _Object(sample, k, name, klass, numbers, apart)
    for sample in empty:
        yield _Object(sample, apart=NO_OBJECT)


def _where(path: str, item: _Object) -> str:
    """Where an object is, for messages."""
    if os.path.isdir(path):
        return f"{os.path.join(path, 'sample_annotation.json')}, row {item.number}"
    return f"{path}, sample {quoted(item.sample)}, object {item.number}"


def _fault(item: Mapping[str, Any], key: str, rule: str) -> ValueError:
    """What is wrong with a value, and what it must be."""
    there = f"{key} is {quoted(item[key])}" if key in item else f"no {key}"
    return ValueError(f"{there}; it must {rule}")


def _text(item: Mapping[str, Any], key: str) -> str:
    """An id or a class, which some write as a number."""
    value = item.get(key)
    if type(value) not in (str, int) or not str(value).strip() or not is_unicode(str(value)):
        raise _fault(item, key, "be a text")
    return str(value).strip()


def _numbers(item: Mapping[str, Any]) -> Iterator[float]:
    """Place, size and score; NaN where a size or a score is not said."""
    unknown = {"translation": None, "size": [np.nan] * 3}
    for key, value in unknown.items():
        values = item.get(key, value)
        if type(values) is not list or len(values) != 3:
            raise _fault(item, key, "be three numbers")
        yield from _finite(item, key, values)
    yield from _finite(item, "tracking_score", [item.get("tracking_score", np.nan)])


def _finite(item: Mapping[str, Any], key: str, values: list[Any]) -> list[float]:
    """The same numbers; NaN is one, of what is not known."""
    for value in values:
        if type(value) not in (float, int) or abs(value) > LARGEST_PLACE:
            raise _fault(item, key, "have finite numbers")
    return values


def _rows(path: str, found: Sequence[_Object], samples: Samples, options: ReadOptions) -> Rows:
    """The rows of objects, in the order of the file."""
    asked = options
    if options.columns is None and not options.boxes:
        asked = replace(options, columns=PLACE[:2])
    roles = replace(find_roles(NUSCENES_COLUMNS, asked, path, fixed=True), unused=())
    # Of a sample without an object: names that are there already, so that none is new.
    named = [item for item in found if item.apart is not NO_OBJECT]
    first = named[0] if named else _Object("")
    values = np.array([item.numbers for item in found]).reshape(-1, len(NUMERIC_COLUMNS))
    classes = number_ids([item.klass or first.klass for item in found])
    rules = {"no object": NO_OBJECT, "not tracked": NOT_TRACKED, "no points": NO_POINTS}
    return rows_by_components(
        lambda column: np.asarray(values[:, column - 3]),
        [samples[item.sample][0] for item in found],
        roles,
        name=path,
        ids=number_ids([item.id or first.id for item in found]),
        where=lambda row: _where(path, found[row]),
        classes=None if roles.klass is None else classes,
        apart={
            rule: (np.array([item.apart == text for item in found], bool), text)
            for rule, text in rules.items()
        },
    )
