"""Tables of nuScenes: lists of records in files of JSON, which name one another by tokens."""

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import InputError
from tgospa_eval.formats.guess import SAMPLES
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.room import check_room, most_bytes
from tgospa_eval.formats.text.convert import load
from tgospa_eval.text import quoted

JSON_BYTES = 6
"""Bytes that a byte of JSON takes as objects of Python: 5.2, measured."""

Record = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Samples:
    """When samples were, and in which scene.

    Parameters
    ----------
    path : str
        Their table, for messages.
    time : dict of str to int
        Microseconds since 1970, by token.
    scene : dict of str to str
        Name of the scene, by token.
    """

    path: str
    time: Mapping[str, int]
    scene: Mapping[str, str]


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
    time: dict[str, int] = {}
    scene: dict[str, str] = {}
    for k, row in enumerate(table(folder, "sample", options, "scene_token"), start=1):
        stamp = row.get("timestamp")
        if isinstance(stamp, bool) or not isinstance(stamp, int) or abs(stamp) >= 2**63:
            raise InputError(
                f"{path}, row {k}: timestamp is {quoted(stamp)}; it must be whole microseconds"
            )
        time[row["token"]] = stamp
        name: str = row["scene_token"]
        scene[row["token"]] = names.get(name, name)
    return Samples(path=path, time=time, scene=scene)


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
    check_room(path, JSON_BYTES * size, size, options.max_input, f"{size:,} bytes of JSON")
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
