"""Readers of JSON (flat records, annotations of COCO with tracks), of Excel, and of nuScenes.

In nuScenes, a scene is a recording, and a sample is one moment of a scene. The name of a sample is
a text, its token. Annotations are tables in a folder. Results are one JSON file, as submitted to
the tracking task. The file of results has the tokens of samples but not their times and scenes. So
times and scenes are read from the tables.
"""

import io
import json
import os
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from tgospa_eval.common.words import natural
from tgospa_eval.errors import InputError
from tgospa_eval.formats.guess import SAMPLES, foreign, is_table_folder
from tgospa_eval.formats.headers import BOX, Headers
from tgospa_eval.formats.loading import TABLE, check_memory, load, max_bytes, unpack, unreadable
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.roles import find_roles
from tgospa_eval.formats.rows import Rows, number_ids, rows_by_components
from tgospa_eval.quoting import listed, option, quoted

Record = dict[str, Any]

FRAMES = ("frame_id", "frame_index", "frame_idx", "frame_number", "frame")
"""Keys under which an image of COCO may have the number of its frame in the video."""

MARKS = ("iscrowd", "ignore")
"""Keys that mark annotations which the benchmark does not count."""

MAX_LEVELS = 4
"""Largest depth to which nested records become columns."""


def read_json(path: str, data: bytes, options: ReadOptions, *_: str, **__: bool) -> pd.DataFrame:
    """Read a table from flat records, or from annotations of COCO.

    Raises
    ------
    InputError
        The file does not have such records.
    """
    document = _document(path, data, options)
    if b"\\u" in data and not is_unicode(json.dumps(document, ensure_ascii=False)):
        raise InputError(
            f"{path}: a text with half a character, \\ud800 to \\udfff; write it whole"
        )
    is_coco = isinstance(document, dict) and _are_records(document.get("annotations"))
    records = document["annotations"] if is_coco else document
    if isinstance(records, dict):
        records = _records_in(records)
    if not _are_records(records) or not records:
        raise InputError(f"{path}: {foreign('{')}")
    if is_coco or (records and {"image_id", "bbox"} <= records[0].keys()):
        records = _of_coco(path, records, document if is_coco else _beside(path, options), options)
    table = pd.json_normalize(_unnested(records), max_level=MAX_LEVELS)
    for name in list(table):
        values = table[name].tolist()
        if all(isinstance(v, list) and len(v) == len(values[0]) for v in values):
            parts = [f"{name}.{k}" for k in range(len(values[0]))]  # bbox.0, bbox.1, ...
            table = table.drop(columns=name).join(pd.DataFrame(values, columns=parts))
    return table.set_axis([f"record {k}" for k in range(1, len(table) + 1)], axis=0)


def _records_in(document: Mapping[str, Any]) -> Any:
    """Return the records of a mapping in one of these forms; other mappings are unchanged.

    - A list of records for each frame or each object. Its key becomes the time or the id of its
      records, except if there is a single list, and its records have ids and times.
    - One list of records beside other values, such as ``{"meta": {...}, "frames": [...]}``.
    - A table as of `DataFrame.to_json`.
    """
    values = [*document.values()]
    lists = [value for value in values if value and _are_records(value)]
    by_key = all(map(_are_records, values))
    if len(lists) == 1:
        places = Headers([*next(iter(_unnested(lists[0])), {})], {}, "", "").places
        if not by_key or (places("id") and places("t")):
            return lists[0]
    if document and by_key:
        first: Record = next((record for records in values for record in records), {})
        key = "id" if Headers(list(first), {}, "", "").places("t") else "t"
        return [{key: name, **record} for name, records in document.items() for record in records]
    if _are_records(values):
        if all(isinstance(inner, dict | list) for value in values for inner in value.values()):
            return document
        if all(map(str.isdigit, document)):  # rows by number
            return values
    with suppress(ValueError, TypeError):  # columns by name
        is_split = {"columns", "data"} <= document.keys()
        parts = (document["data"], None, document["columns"]) if is_split else (document,)
        return pd.DataFrame(*parts).to_dict("records")
    return document


def _unnested(records: list[Record]) -> list[Record]:
    """Flatten records that contain a list of records, such as frames that contain objects.

    Other records are unchanged.
    """
    lists = {name for record in records for name, value in record.items() if _are_records(value)}
    if len(lists) != 1:
        return records
    (name,) = lists
    return [
        {key: value for key, value in record.items() if key != name} | inner
        for record in records
        for inner in record.get(name) or ()
    ]


def _are_records(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(item, dict) for item in value)


def _document(path: str, data: bytes, options: ReadOptions) -> Any:
    """Parse a JSON document; a file with one record in each line is read as a list of records."""
    lines = data.splitlines()
    first = next((line for line in lines if line.strip()), b"").strip()
    if not (first.startswith(b"{") and first.endswith(b"}") and len(lines) > 1):
        return load_json(path, data, options)
    records = b",\n".join(line for line in lines if line.strip())
    return load_json(path, b"[" + records + b"]", options)


def _beside(path: str, options: ReadOptions) -> Mapping[str, Any]:
    """Return the document with the images of COCO results, from another file of the evaluation."""
    for other in options.beside:
        if other != path and os.path.isfile(other):
            limit = max_bytes(options.max_input, other)
            data = unpack(load(other, limit), other, limit)
            if data.lstrip().startswith(b"{"):
                document = load_json(other, data, options)
                if "images" in document:
                    images: Mapping[str, Any] = document
                    return images
    raise InputError(
        f"{path}: results of COCO, which name images by number; evaluate them against the file "
        "with the images, or write a column t"
    )


def _of_coco(
    path: str, records: list[Record], document: Mapping[str, Any], options: ReadOptions
) -> list[Record]:
    """Convert annotations or results of COCO to records of a table; `document` has the images."""
    try:
        images = {image["id"]: image for image in document["images"]}
        times = _times(path, images, options)
        names = {item["id"]: item["name"] for item in document.get("categories") or ()}
        rows = []
        for record in records:
            inner = record.get("attributes")
            track = record.get("track_id", record.get("instance_id"))
            if track is None and isinstance(inner, dict):
                track = inner.get("track_id")
            box = dict(zip(BOX, record["bbox"], strict=True))
            category = record.get("category_id")
            place = record["image_id"]
            row: Record = {"id": track, "t": times[place], **box}
            row |= {"class": names.get(category, category), "score": record.get("score")}
            row["video_id"] = images[place].get("video_id")
            rows.append(row | {key: record[key] for key in MARKS if key in record})
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path}: not annotations of COCO: {type(error).__name__}: {error}; each has image_id, "
            "track_id and bbox, and each image an id"
        ) from None
    if all(row["id"] is None for row in rows) and rows:
        raise InputError(f"{path}: no record has a track_id; TGOSPA compares tracks")
    return rows


def _times(path: str, images: Mapping[Any, Record], options: ReadOptions) -> dict[Any, Any]:
    """Return the time of each image, by the id of the image.

    The time is the number of the frame. If images have no such number, the time is their id, and
    the ids must be in the order of the file names.

    Raises
    ------
    InputError
        The images are of several videos, and rows are neither filtered nor separated by class. Or
        the order of the images is unknown.
    """
    videos = list(dict.fromkeys(str(image.get("video_id")) for image in images.values()))
    if len(videos) > 1 and options.classes is None and not options.by_class:
        raise InputError(
            f"{path}: {len(videos)} videos ({listed(videos)}), which are not one recording; "
            f"{option('columns', 'class=video_id')} {option('class_', metavar='VIDEO')} reads "
            "one, or write a file for each"
        )
    for key in FRAMES:
        if all(key in image for image in images.values()):
            return {name: image[key] for name, image in images.items()}
    ids = sorted(images)
    if ids != sorted(ids, key=lambda name: natural(str(images[name].get("file_name", "")))):
        raise InputError(
            f"{path}: images without number of frame, whose ids are not in the order of their "
            f"names; give each image a {FRAMES[0]}"
        )
    return {key: key for key in ids}


NO_VALUE = re.compile(
    rb'<c r="(\w+)"(?:(?! t=)[^>])*>\s*<f\b(?:[^>]*/>|[^<]*</f>)\s*(?:<v\s*/>|<v></v>)?\s*</c>'
)
"""Pattern of a cell with a formula whose value no program has stored."""


def read_excel(path: str, data: bytes, options: ReadOptions, *_: str, **__: bool) -> pd.DataFrame:
    """Read the table of a spreadsheet, if openpyxl is installed.

    Raises
    ------
    InputError
        openpyxl is not installed, or the file has several tables or is damaged.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            size = sum(member.file_size for member in packed.infolist())
            members = [name for name in packed.namelist() if name.startswith("xl/worksheets/")]
            check_memory(
                path, TABLE * size, len(data), options.max_input, f"{size:,} bytes of Excel"
            )
            unknown = next(filter(None, (NO_VALUE.search(packed.read(n)) for n in members)), None)
        if unknown:
            raise InputError(
                f"{path}, cell {unknown[1].decode()}: a formula without its value; open the file "
                "in a spreadsheet program and save it, or write values"
            )
        pages = pd.read_excel(io.BytesIO(data), None, dtype=object)
    except ImportError:
        raise InputError(
            f"{path}: a spreadsheet; save it as CSV, or install openpyxl, which reads it"
        ) from None
    except InputError:
        raise
    except Exception as error:  # damaged files raise errors of many kinds
        raise unreadable(path, "Excel", error) from None
    tables = {name: page for name, page in pages.items() if len(page.columns)}
    if len(tables) != 1:
        raise InputError(f"{path}: {len(tables)} tables ({listed(tables)}); save one as CSV")
    table = next(iter(tables.values()))
    headers = ["" if str(name).startswith("Unnamed: ") else name for name in table.columns]
    places = [f"line {k}" for k in range(2, len(table) + 2)]
    return table.set_axis(headers, axis=1).set_axis(places, axis=0)


JSON_BYTES = 6
"""Memory in bytes for each byte of JSON as Python objects; measured: 5.2."""

Samples = Mapping[str, tuple[int, str]]
"""Time in microseconds since 1970, and name of the scene, of each sample; by its token."""


def read_samples(folder: str, options: ReadOptions) -> Samples:
    """Read the samples from the tables of nuScenes in a folder.

    Raises
    ------
    InputError
        The table of samples is missing, or a table is not valid.
    """
    names: dict[str, str] = {}
    if os.path.isfile(os.path.join(folder, "scene.json")):
        names = {row["token"]: row["name"] for row in table(folder, "scene", options, "name")}
    path = os.path.join(folder, SAMPLES)
    samples: dict[str, tuple[int, str]] = {}
    for k, row in enumerate(table(folder, "sample", options, "scene_token"), start=1):
        stamp = row.get("timestamp")
        if isinstance(stamp, bool) or not isinstance(stamp, int) or abs(stamp) >= 2**63:
            raise InputError(
                f"{path}, row {k}: timestamp is {quoted(stamp)}; it must be whole microseconds"
            )
        scene: str = row["scene_token"]
        samples[row["token"]] = stamp, names.get(scene, scene)
    return samples


def table(folder: str, name: str, options: ReadOptions, *texts: str) -> Sequence[Record]:
    """Return the records of a table, after a check of each record.

    A record must have a token, and a text under each of the keys `texts`.

    Raises
    ------
    InputError
        The file is missing, is no list of records, or a record lacks its token or a text.
    """
    path = os.path.join(folder, f"{name}.json")
    rows = load_json(path, load(path, max_bytes(options.max_input, path)), options)
    if not isinstance(rows, list):
        raise InputError(f"{path}: not a table of nuScenes, which is a list of records")
    for k, row in enumerate(rows, start=1):
        for key in ("token", *texts):
            text = row.get(key) if isinstance(row, dict) else None
            if not isinstance(text, str) or not is_unicode(text):
                raise InputError(f"{path}, row {k}: no text {quoted(key)} in the record")
    return rows


def is_unicode(text: str) -> bool:
    """Return whether a text can be encoded.

    JSON texts may have halves of characters (surrogates), which cannot be encoded.
    """
    return text.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in text)


def load_json(path: str, data: bytes, options: ReadOptions) -> Any:
    """Parse the JSON document in a file.

    Raises
    ------
    InputError
        The file is not JSON, or too large.
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
        raise InputError(f"{path}, {place}: not readable JSON: {error.msg}") from None
    except (UnicodeDecodeError, RecursionError, ValueError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise InputError(f"{path}: not readable JSON: {reason}") from None


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
"""Class in the tracking task by category of nuScenes; other categories are not tracked."""

PLACE = ("x", "y", "z")
NUMERIC_COLUMNS = (*PLACE, "size_width", "size_length", "size_height", "score")
NUSCENES_COLUMNS = ("id", "t", "class", *NUMERIC_COLUMNS)

LARGEST_PLACE = 1e300

NO_POINTS = "without a lidar or radar point left out, as by the rules of nuScenes"
NOT_TRACKED = "of categories that are not tracked left out"
NO_OBJECT = "for samples without an object, which also count as steps"


class _Object(NamedTuple):
    """One object in a sample, or a sample without objects, which has no id and no numbers.

    `number` is the position of the object in its list or table, from 1. `reason` says why the row
    is left out; it is blank if the row is used.
    """

    sample: str
    number: int = 0
    id: str = ""
    klass: str = ""
    numbers: tuple[float, ...] = (np.nan,) * len(NUMERIC_COLUMNS)
    reason: str = ""


def read_nuscenes(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """Read the rows of a folder of tables, or of results in JSON; `role` has no effect.

    Raises
    ------
    InputError
        A table is missing or damaged, or an object does not follow the format.
    """
    if os.path.isdir(path):
        samples = read_samples(path, options)
        objects = list(_annotations(path, samples, options))
    else:
        results = _results(path, data, options)
        folder = _folder_for(path, options)
        samples = read_samples(folder, options)
        objects = list(_tracks(path, results, samples, os.path.join(folder, SAMPLES)))
    return _rows(path, objects, samples, options)


def _folder_for(path: str, options: ReadOptions) -> str:
    """Return the folder with the tables for a file of results.

    It is another path of the evaluation, or the folder in which a file of the evaluation is.
    """
    places = [*options.beside, *(os.path.dirname(other) or "." for other in options.beside)]
    for folder in (*places, os.path.dirname(path) or "."):
        if is_table_folder(folder):
            return folder
    raise InputError(
        f"{path}: names samples by tokens, whose times are in the tables of nuScenes: evaluate it "
        f"against their folder (v1.0-...), or put {SAMPLES} and scene.json next to it"
    )


def _results(path: str, data: bytes, options: ReadOptions) -> Mapping[str, Any]:
    """Return the objects of a file of results, by the token of the sample."""
    document = load_json(path, data, options)
    results = document.get("results") if isinstance(document, dict) else None
    folder = os.path.dirname(path) or "."
    if isinstance(document, list) and is_table_folder(folder):
        raise InputError(f"{path}: one of the tables of nuScenes; name their folder, {folder}")
    if not isinstance(results, dict):
        raise InputError(
            f'{path}: not results of nuScenes; they are {{"meta": ..., "results": {{sample token: '
            "[objects]}}"
        )
    return results


def _tracks(
    path: str, results: Mapping[str, Any], samples: Samples, table_path: str
) -> Iterator[_Object]:
    """Yield the objects of results, and an item for each sample without objects."""
    scenes: dict[str, set[str]] = {}
    tracked: list[_Object] = []
    for token, objects in results.items():
        if token not in samples:
            raise InputError(
                f"{path}: sample {quoted(token)} is not in {table_path}; the tables must be of "
                "the version that was tracked"
            )
        if not isinstance(objects, list):
            raise InputError(f"{path}, sample {quoted(token)}: not a list of objects")
        if not objects:
            tracked.append(_Object(token, reason=NO_OBJECT))
        scene = samples[token][1]
        for k, item in enumerate(objects, start=1):
            try:
                if not isinstance(item, dict):
                    raise TypeError("not an object with keys")
                if "tracking_id" not in item and "detection_name" in item:
                    raise ValueError("a detection; TGOSPA compares tracks, with a tracking_id")
                name, klass = _text(item, "tracking_id"), _text(item, "tracking_name")
                numbers = tuple(_numbers(item))
            except (ValueError, TypeError) as error:
                place = _Object(token, k)
                raise InputError(f"{_where(path, place)}: {error}") from None
            scenes.setdefault(name, set()).add(scene)
            tracked.append(_Object(token, k, name, klass, numbers))
    for item in tracked:  # an id that is in two scenes means two tracks
        several = len(scenes.get(item.id, ())) > 1
        yield item._replace(id=f"{samples[item.sample][1]}/{item.id}") if several else item


def _annotations(path: str, samples: Samples, options: ReadOptions) -> Iterator[_Object]:
    """Yield the objects of the tables, and an item for each sample without objects."""
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
        reason = "" if klass in tracked else NOT_TRACKED
        if not reason and item.get("num_lidar_pts") == item.get("num_radar_pts") == 0:
            reason = NO_POINTS
        yield _Object(sample, k, name, klass, numbers, reason)
    for sample in empty:
        yield _Object(sample, reason=NO_OBJECT)


def _where(path: str, item: _Object) -> str:
    """Return the place of an object in the file, for messages."""
    if os.path.isdir(path):
        return f"{os.path.join(path, 'sample_annotation.json')}, row {item.number}"
    return f"{path}, sample {quoted(item.sample)}, object {item.number}"


def _fault(item: Mapping[str, Any], key: str, rule: str) -> ValueError:
    """Return the error that a value is missing or does not follow a rule."""
    there = f"{key} is {quoted(item[key])}" if key in item else f"no {key}"
    return ValueError(f"{there}; it must {rule}")


def _text(item: Mapping[str, Any], key: str) -> str:
    """Convert an id or a class to a text; some programs write numbers."""
    value = item.get(key)
    if type(value) not in (str, int) or not str(value).strip() or not is_unicode(str(value)):
        raise _fault(item, key, "be a text")
    return str(value).strip()


def _numbers(item: Mapping[str, Any]) -> Iterator[float]:
    """Yield position, size and score of an object; a missing size or score is NaN."""
    unknown = {"translation": None, "size": [np.nan] * 3}
    for key, value in unknown.items():
        values = item.get(key, value)
        if type(values) is not list or len(values) != 3:
            raise _fault(item, key, "be three numbers")
        yield from _finite(item, key, values)
    yield from _finite(item, "tracking_score", [item.get("tracking_score", np.nan)])


def _finite(item: Mapping[str, Any], key: str, values: list[Any]) -> list[float]:
    """Return numbers after a check that they are finite or NaN; NaN means unknown."""
    for value in values:
        if type(value) not in (float, int) or abs(value) > LARGEST_PLACE:
            raise _fault(item, key, "have finite numbers")
    return values


def _rows(path: str, objects: Sequence[_Object], samples: Samples, options: ReadOptions) -> Rows:
    """Return the rows of objects, in the order of the file."""
    reading = options
    if options.columns is None and not options.boxes:
        reading = replace(options, columns=PLACE[:2])
    roles = replace(find_roles(NUSCENES_COLUMNS, reading, path, fixed=True), unused=())
    # The row of a sample without objects gets an id that exists already, so it adds no track.
    named = [item for item in objects if item.reason is not NO_OBJECT]
    first = named[0] if named else _Object("")
    values = np.array([item.numbers for item in objects]).reshape(-1, len(NUMERIC_COLUMNS))
    classes = number_ids([item.klass or first.klass for item in objects])
    rules = {"no object": NO_OBJECT, "not tracked": NOT_TRACKED, "no points": NO_POINTS}
    return rows_by_components(
        lambda column: np.asarray(values[:, column - 3]),
        [samples[item.sample][0] for item in objects],
        roles,
        name=path,
        ids=number_ids([item.id or first.id for item in objects]),
        where=lambda row: _where(path, objects[row]),
        classes=None if roles.klass is None else classes,
        excluded={
            rule: (np.array([item.reason == text for item in objects], bool), text)
            for rule, text in rules.items()
        },
    )
