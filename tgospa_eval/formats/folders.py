"""Readers of folders with a file for each object (TUM, CSV) or each frame (YOLO).

All files of a folder together are the truth or the estimate. Each reader also reads a single file.
"""

import csv
import io
import os
import re

import pandas as pd

from tgospa_eval.errors import InputError
from tgospa_eval.formats.fields import is_number
from tgospa_eval.formats.guess import COMMENTS, files_of_folder
from tgospa_eval.formats.loading import check_text_memory, unpacked_file
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.text.lines import decode
from tgospa_eval.quoting import listed

TUM_FIELDS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
YOLO_FIELDS = ("class", "cx", "cy", "width", "height")
YOLO_RULE = "a line must be class cx cy width height [confidence] id"


def read_tum(path: str, data: bytes, options: ReadOptions, *_: str, **__: bool) -> pd.DataFrame:
    """Read TUM files as one table; each has one trajectory, whose id is the name of the file.

    Raises
    ------
    InputError
        A line does not have the eight numbers of TUM.
    """
    rows, places = [], []
    for stem, place, words in _lines(path, data, options):
        if len(words) != len(TUM_FIELDS):
            raise InputError(f"{path}, {place}: must have 8 numbers: {' '.join(TUM_FIELDS)}")
        rows.append([stem, *words])
        places.append(place)
    return pd.DataFrame(rows, columns=["id", *TUM_FIELDS], index=places)


def read_tables(path: str, data: bytes, options: ReadOptions, *_: str, **__: bool) -> pd.DataFrame:
    """Read CSV files without ids as one table; each has one object, whose id is the file name.

    Raises
    ------
    InputError
        A file is not a CSV table.
    """
    tables = []
    for file in files_of_folder(path) if os.path.isdir(path) else [path]:
        name = os.path.basename(file)
        content = unpacked_file(file, options.max_input) if os.path.isdir(path) else data
        check_text_memory(file, content, options.max_input)
        try:
            table = pd.read_csv(io.BytesIO(content), sep=None, engine="python", dtype=str)
        except (ValueError, csv.Error) as error:  # pandas raises both
            raise InputError(f"{file}: not a CSV table: {' '.join(str(error).split())}") from None
        if any(column.strip().casefold() == "id" for column in table.columns):
            remedy = "remove it" if os.path.isdir(path) else "use the format csv"
            raise InputError(f"{file}: a file of one object must not have a column id; {remedy}")
        table.insert(0, "id", os.path.splitext(name)[0])
        tables.append(table.set_axis([f"{name}, line {k}" for k in range(2, len(table) + 2)]))
    return pd.concat(tables)


def read_yolo(path: str, data: bytes, options: ReadOptions, *_: str, **__: bool) -> pd.DataFrame:
    """Read YOLO files as one table.

    Each file has the boxes of one frame, and its name ends in the number of the frame. Boxes are in
    units of the size of the image.

    Raises
    ------
    InputError
        A line is not of YOLO or has no id, a name of a file does not end in the number of a frame,
        or the files are of several videos.
    """
    rows, places, names = [], [], set()
    for stem, place, words in _lines(path, data, options):
        frame = re.fullmatch(r"(.*?)(\d+)", stem)
        if frame is None:
            raise InputError(
                f"{path}, {place}: the file name must end in the frame number, as clip_7"
            )
        names.add(frame[1])
        has_id = len(words) in (6, 7) and words[-1].isdigit()
        if not has_id or not all(map(is_number, words)):
            why = "no id: these are detections; " if len(words) in (5, 6) else ""
            raise InputError(f"{path}, {place}: {why}{YOLO_RULE}")
        rows.append([words[-1], frame[2], *words[:5]])
        places.append(place)
    if len(names) > 1:
        videos = listed(sorted(names))
        raise InputError(f"{path}: frames of several videos ({videos}); use a folder for each")
    return pd.DataFrame(rows, columns=["id", "t", *YOLO_FIELDS], index=places)


def _lines(path: str, data: bytes, options: ReadOptions) -> list[tuple[str, str, list[str]]]:
    """Return, for each line with content, the name of its file, its place, and its words.

    The name has no ending. The place is the file and line, for messages. Comments are skipped.
    """
    is_folder = os.path.isdir(path)
    lines = []
    for file in files_of_folder(path) if is_folder else [path]:
        name = os.path.basename(file)
        content = unpacked_file(file, options.max_input) if is_folder else data
        check_text_memory(file, content, options.max_input)
        for k, line in enumerate(decode(content, file).split("\n"), start=1):
            if line.strip() and not line.lstrip().startswith(COMMENTS):
                place = f"{name}, line {k}" if is_folder else f"line {k}"
                lines.append((os.path.splitext(name)[0], place, line.split()))
    return lines
