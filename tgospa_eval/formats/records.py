"""JSON: flat records in a list or on lines, and annotations of COCO with tracks. And Excel."""

import io
import json
import os
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import pandas as pd

from tgospa_eval.common.words import natural
from tgospa_eval.errors import InputError
from tgospa_eval.formats.guess import foreign
from tgospa_eval.formats.headers import BOX, Headers
from tgospa_eval.formats.loading import TABLE, check_memory, load, most_bytes, unpack, unreadable
from tgospa_eval.formats.nuscenes import is_unicode, load_json
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.text import listed, option

Record = dict[str, Any]

FRAMES = ("frame_id", "frame_index", "frame_idx", "frame_number", "frame")
"""Keys of images that number the frames of a video."""

MOST_LEVELS = 4
"""Levels of records that become columns."""


def read_json(path: str, data: bytes, options: ReadOptions, *_: str, **__: bool) -> pd.DataFrame:
    """The table of flat records, or of annotations of COCO, the same in either role.

    Raises
    ------
    InputError
        It is no such file.
    """
    document = _document(path, data, options)
    if b"\\u" in data and not is_unicode(json.dumps(document, ensure_ascii=False)):
        raise InputError(
            f"{path}: a text with half a character, \\ud800 to \\udfff; write it whole"
        )
    is_coco = isinstance(document, dict) and _are_records(document.get("annotations"))
    records = document["annotations"] if is_coco else document
    records = _by_key(records)
    if isinstance(records, dict):
        with suppress(ValueError):  # columns by name, as DataFrame.to_json writes them
            records = pd.DataFrame(records).to_dict("records")
    if not _are_records(records) or not records:
        raise InputError(f"{path}: {foreign('{')}")
    if is_coco or (records and {"image_id", "bbox"} <= records[0].keys()):
        records = _of_coco(path, records, document if is_coco else _beside(path, options), options)
    table = pd.json_normalize(_unnested(records), max_level=MOST_LEVELS)
    for name in list(table):
        values = table[name].tolist()
        if all(isinstance(v, list) and len(v) == len(values[0]) for v in values):
            parts = [f"{name}.{k}" for k in range(len(values[0]))]  # bbox.0, bbox.1, ...
            table = table.drop(columns=name).join(pd.DataFrame(values, columns=parts))
    return table.set_axis([f"record {k}" for k in range(1, len(table) + 1)], axis=0)


def _by_key(document: Any) -> Any:
    """Records of lists by frame or by object, with the key as their time or id."""
    lists = document if isinstance(document, dict) else {}
    if not lists or not all(map(_are_records, lists.values())):
        return document
    first: Record = next((record for records in lists.values() for record in records), {})
    key = "id" if Headers(list(first), {}, "", "").places("t") else "t"
    return [{key: name, **record} for name, records in lists.items() for record in records]


def _unnested(records: list[Record]) -> list[Record]:
    """Records with one list of records each, as of a frame, as the rows of these lists."""
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
    """The document in a file, or the list of records that are a line each."""
    lines = data.splitlines()
    first = next((line for line in lines if line.strip()), b"").strip()
    if not (first.startswith(b"{") and first.endswith(b"}") and len(lines) > 1):
        return load_json(path, data, options)
    records = b",\n".join(line for line in lines if line.strip())
    return load_json(path, b"[" + records + b"]", options)


def _beside(path: str, options: ReadOptions) -> Mapping[str, Any]:
    """The file of the other side, if it has the images that results are of."""
    for other in options.beside:
        if other != path and os.path.isfile(other):
            most = most_bytes(options.max_input, other)
            data = unpack(load(other, most), other, most)
            if data.lstrip().startswith(b"{"):
                document = load_json(other, data, options)
                if "images" in document:
                    found: Mapping[str, Any] = document
                    return found
    raise InputError(
        f"{path}: results of COCO, which name images by number; evaluate them against the file "
        "with the images, or write a column t"
    )


def _of_coco(
    path: str, records: list[Record], document: Mapping[str, Any], options: ReadOptions
) -> list[Record]:
    """Records with the columns of a table."""
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
            rows.append(row | {"video_id": images[place].get("video_id")})
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path}: no annotations of COCO: {type(error).__name__}: {error}; each has image_id, "
            "track_id and bbox, and each image an id"
        ) from None
    if all(row["id"] is None for row in rows) and rows:
        raise InputError(f"{path}: no record has a track_id; TGOSPA compares tracks")
    return rows


def _times(path: str, images: Mapping[Any, Record], options: ReadOptions) -> dict[Any, Any]:
    """The time of each image by its id: the number of its frame, else its id if these are in turn.

    Raises
    ------
    InputError
        There are several videos, or it is not known which image is before which.
    """
    videos = list(dict.fromkeys(str(image.get("video_id")) for image in images.values()))
    if len(videos) > 1 and options.classes is None and not options.by_class:
        raise InputError(
            f"{path}: {len(videos)} videos ({listed(videos)}), which are no one recording; "
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


def read_excel(path: str, data: bytes, options: ReadOptions, *_: str, **__: bool) -> pd.DataFrame:
    """The table of a spreadsheet, where openpyxl is installed.

    Raises
    ------
    InputError
        It is not, or the file has several tables, or is damaged.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            size = sum(member.file_size for member in packed.infolist())
        check_memory(path, TABLE * size, len(data), options.max_input, f"{size:,} bytes of Excel")
        pages = pd.read_excel(io.BytesIO(data), None, dtype=object)
    except ImportError:
        raise InputError(
            f"{path}: a spreadsheet; save it as CSV, or install openpyxl, which reads it"
        ) from None
    except InputError:
        raise
    except Exception as error:  # damage ends in any fault
        raise unreadable(path, "Excel", error) from None
    tables = {name: page for name, page in pages.items() if len(page.columns)}
    if len(tables) != 1:
        raise InputError(f"{path}: {len(tables)} tables ({listed(tables)}); save one as CSV")
    table = next(iter(tables.values()))
    headers = ["" if str(name).startswith("Unnamed: ") else name for name in table.columns]
    places = [f"line {k}" for k in range(2, len(table) + 2)]
    return table.set_axis(headers, axis=1).set_axis(places, axis=0)
