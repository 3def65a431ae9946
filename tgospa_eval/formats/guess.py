"""Guess of the format of a file, from its name and its first bytes or lines."""

import math
import os
import re
from collections.abc import Iterable
from itertools import takewhile

from tgospa_eval.common.patterns import WITH_VARIABLES
from tgospa_eval.common.words import natural
from tgospa_eval.formats import FORMATS
from tgospa_eval.formats.fields import is_number
from tgospa_eval.formats.loading import plain_name

FORMAT_OF_SUFFIX = {
    ".csv": "csv",
    ".tsv": "csv",
    ".parquet": "parquet",
    ".pq": "parquet",
    ".feather": "feather",
    ".arrow": "feather",
    ".npz": "npz",
    ".npy": "npy",
    ".mat": "mat",
}
"""Format by the end of a name, for a file that does not begin with bytes of `MAGIC`."""

MAGIC = {
    b"PAR1": "parquet",
    b"ARROW1": "feather",
    b"FEA1": "feather",
    b"PK\x03\x04": "npz",
    b"\x93NUMPY": "npy",
    b"MATLAB 5.0 MAT-file": "mat",
    b"MATLAB 7.3 MAT-file": "mat",
}
"""Format by the first bytes of a file."""

GUESSED_FROM = 1 << 12

VISDRONE_CLASSES = tuple(map(str, range(1, 12)))
"""Classes of objects in VisDrone; class 0 means ignored regions."""

SAMPLES = "sample.json"
"""Table of nuScenes with the times."""
TABLES_READ = ("category.json", "instance.json", SAMPLES, "sample_annotation.json", "scene.json")
"""All tables of nuScenes that are read."""
RESULTS = r'\{(?s:.*?)"results"\s*:\s*\{'
"""Pattern of the beginning of a file of results of nuScenes; other keys may be before results."""

ARGOVERSE = (b"timestamp_ns", b"track_uuid", b"tx_m")
"""Columns by which Feather files of Argoverse 2 are recognised."""
SCHEMA_BYTES = 1 << 14
"""Number of first bytes in which names of columns (Feather) or of parts (Excel) are looked for."""

BEGINNINGS = {
    "json": r'\{\s*["}]|\[\s*[{\]]',
    "deeplabcut": r"scorer,.*\s+(individuals,.*\s+)?bodyparts,.*\s+coords,",
}
"""Pattern of the beginning of a text file by its format; the name of the file does not matter."""

VARIABLE = re.compile(WITH_VARIABLES + r"(?s:([A-Za-z]\w*(?:[{(].*)?))")
"""Pattern of a path with the name of a variable in a MAT file, or of an element of a cell."""


def file_of(path: str) -> str:
    """Return the file of a path ``FILE.mat:X`` or ``FILE.mat:Y{3}``; keep any other path."""
    named = VARIABLE.fullmatch(path) if ":" in path else None
    return named[1] if named and not os.path.lexists(path) else path


def is_table_folder(path: str) -> bool:
    """Return whether a path is a folder with the tables of nuScenes."""
    return os.path.isfile(os.path.join(path, SAMPLES))


def files_at(path: str) -> list[str]:
    """Return the files that are read for a path.

    These are the files of a folder that is read as a whole (see `folder_format`), or the file
    itself.
    """
    if not is_table_folder(path):
        return files_of_folder(path) if folder_format(path) else [path]
    return [file for name in TABLES_READ if os.path.isfile(file := os.path.join(path, name))]


def guess(path: str, data: bytes) -> str:
    """Guess the format, a key of `formats.FORMATS`; the default is a CSV table.

    If another package adds a format, it is guessed from the end of the name: run.trk is read as
    trk. A MOTChallenge line has 6 to 10 numbers, and there is no header. A VisDrone line has 10
    numbers; in all lines, the last three are class, truncation and occlusion. A KITTI line has 17
    fields separated by blanks, or 18 with a score; the third field is the type.
    """
    suffix = re.search(r"\.[^./\\]*$", plain_name(path))
    ending = suffix[0] if suffix else ""
    if ending not in FORMAT_OF_SUFFIX and ending[1:] in FORMATS.outside:
        return ending[1:]
    for magic, format in MAGIC.items():
        if data.startswith(magic):
            named = all(name in data[:SCHEMA_BYTES] for name in ARGOVERSE)
            if format == "npz" and b"[Content_Types].xml" in data[:SCHEMA_BYTES]:
                return "xlsx"
            return "argoverse" if format == "feather" and named else format
    if FORMAT_OF_SUFFIX.get(ending, "csv") != "csv":
        return FORMAT_OF_SUFFIX[ending]
    head = data[:GUESSED_FROM].decode("utf-8-sig", "replace").lstrip()
    if re.match(RESULTS, head) or (head[:1] == "[" and is_table_folder(os.path.dirname(path))):
        return "nuscenes"
    known = next((name for name, begin in BEGINNINGS.items() if re.match(begin, head)), "")
    if known or ending in FORMAT_OF_SUFFIX:
        return known or FORMAT_OF_SUFFIX[ending]
    return _guess_text(head, is_whole=len(data) <= GUESSED_FROM)


def _guess_text(head: str, *, is_whole: bool) -> str:
    """Guess the format of a table from its first lines."""
    every = re.split(r"[\r\n]+", head)
    comments = list(takewhile(_is_comment, every))
    # If all first lines are comments, the file is a table or empty.
    lines = [line for line in every if not _is_comment(line)] or every
    line = lines[0]
    fields = split(line)
    for name, fits in (("tum", is_tum), ("yolo", is_yolo)):
        if line.strip() and all(map(fits, filter(str.strip, lines[:LINES_TRIED]))):
            return name
    if any(len(split(comment.lstrip(" \t#%/"))) == len(fields) for comment in comments):
        return "csv"  # a comment is the header
    if 6 <= len(fields) <= 10 and all(map(is_number, fields)):
        whole = lines if is_whole else lines[:-1] or lines
        whole = [line for line in whole if line.strip()]
        if _is_visdrone(whole):
            return "visdrone"
        return "motchallenge" if _is_motchallenge(whole) else "csv"
    words = line.split()
    if len(words) in (17, 18) and not is_number(words[2]):
        return "kitti"
    return "csv"


def folder_format(path: str) -> str:
    """Return the format of a folder that is the truth or the estimate as a whole.

    Such a folder has one of these contents: the tables of nuScenes, files of TUM, CSV files without
    ids, or files of YOLO. A file of TUM has eight numbers in each line. A file of TUM and a CSV
    file without ids have one trajectory each. A file of YOLO has the boxes of one frame. The result
    is blank for any other path.
    """
    if is_table_folder(path) or not os.path.isdir(path):
        return "nuscenes" if os.path.isdir(path) else ""
    kinds = {"" for name in os.listdir(path) if os.path.splitext(name)[1] in FORMAT_OF_SUFFIX}
    if kinds:
        tables = [file for file in files_of_folder(path) if file.endswith(TABLES)]
        tabular = len(tables) == len(os.listdir(path))
        return PER_OBJECT if tabular and all(map(_is_of_one_object, tables[:FILES_TRIED])) else ""
    for file in files_of_folder(path)[:FILES_TRIED]:
        lines = filter(str.strip, _beginning(file).splitlines()[:LINES_TRIED])
        rows = [line for line in lines if not _is_comment(line)]
        if rows:
            other = "yolo" if all(map(is_yolo, rows)) else ""
            kinds.add("tum" if all(map(is_tum, rows)) else other)
        if "" in kinds or len(kinds) > 1:
            return ""
    return next(iter(kinds), "")


FILES_TRIED, LINES_TRIED = 100, 20
"""Numbers of files, and of lines in each, from which the format of a folder is guessed."""


def files_of_folder(path: str) -> list[str]:
    """Return the text files in a folder, in the natural order of their names."""
    try:
        names = os.listdir(path)
    except OSError:
        return []
    kept = (name for name in names if name.endswith(TEXTS) and name not in ASIDE)
    return [os.path.join(path, name) for name in sorted(kept, key=natural)]


PER_OBJECT = "csv-per-object"
TABLES = (".csv", ".tsv")
TEXTS, ASIDE = (".txt", ".tum", *TABLES), ("classes.txt", "labels.txt", "README.txt")
"""Ends of the names of the files that are read in a folder, and names of the files to skip."""


def _is_of_one_object(path: str) -> bool:
    """Return whether the header of a table has times and positions, and nothing like an id."""
    from tgospa_eval.formats.headers import HINTS, Headers  # lazy: only folders need it

    lines = (line for line in _beginning(path).splitlines() if line.strip())
    fields = re.split(r"[,;\t]", next(lines, ""))
    headers = Headers([field.strip(' "') for field in fields], {}, "", path)
    places = all(headers.places(name) for name in "xy") or all(map(headers.places, ("lat", "lon")))
    has_ids = any(re.search(HINTS["id"], name, re.IGNORECASE) for name in headers.names)
    return places and bool(headers.places("t")) and not has_ids


def _beginning(path: str) -> str:
    if not os.path.isfile(path):  # reading a named pipe would block
        return ""
    try:
        with open(path, "rb") as file:
            return file.read(GUESSED_FROM).decode("utf-8-sig", "replace")
    except OSError:
        return ""


def is_tum(line: str) -> bool:
    """Return whether a line is a time, a position and a quaternion of length 1."""
    words = line.split()
    if len(words) != 8 or not all(map(is_number, words)):
        return False
    return abs(sum(float(word) ** 2 for word in words[4:]) - 1) < 0.01


def is_yolo(line: str) -> bool:
    """Return whether a line is of YOLO: a class, a box, and perhaps a score and an id.

    The box is in units of the size of the image, from 0 to 1.
    """
    words = line.split()
    if not 5 <= len(words) <= 7 or not all(map(is_number, words)) or not words[0].isdigit():
        return False
    has_parts = all("." in word for word in words[1:3])
    return has_parts and all(0 <= float(word) <= 1 for word in words[1:5])


def split(line: str) -> list[str]:
    """Split a line at its commas, or at blanks if it has no comma; a last comma is ignored."""
    line = line.strip().removesuffix(",")
    return [field.strip() for field in line.split(",")] if "," in line else line.split()


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _is_visdrone(lines: Iterable[str]) -> bool:
    """Return whether all lines have ten fields that end in class, truncation and occlusion."""
    return all(
        len(fields) == 10
        and (fields[8:] == ["-1", "-1"] or (fields[8] in "01" and fields[9] in "012"))
        and fields[7] in (*VISDRONE_CLASSES, "0" if fields[6] == "0" else "")
        for fields in map(split, lines)
    )


MIN_BOX = 2.0
"""Smallest width and height of a box in pixels.

Smaller numbers are taken for speeds, or for sizes in metres."""


def _is_motchallenge(lines: Iterable[str]) -> bool:
    """Return whether lines are of MOTChallenge.

    Each of these must be true for more than half of the lines:

    - Frame and id are integers.
    - The box is in pixels.
    - Columns 7 and 8 are a flag and a class, if there are 8 or 9 columns.

    The reader reports mistakes in single lines.
    """
    numbers = (row for row in map(split, lines) if all(map(is_number, row)))
    rows = [row for row in ([*map(float, row)] for row in numbers) if all(map(math.isfinite, row))]
    if any(len(row) < MOT_SHORTEST for row in rows):
        return True  # the reader of MOTChallenge reports the mistake
    whole = sum(row[0] == int(row[0]) and row[1] == int(row[1]) for row in rows)
    sized = sum(min(map(abs, row[4:6])) >= MIN_BOX or row[4:6] == [-1, -1] for row in rows)
    flagged = sum(
        len(row) not in (8, 9)
        or (row[6] <= 1 and row[7] == int(row[7]) and all(-1 <= one <= 1 for one in row[8:]))
        for row in rows
    )
    return not rows or 2 * min(whole, sized, flagged) > len(rows)


MOT_SHORTEST = 6


COMMENTS = ("#", "%", "//")


def foreign(line: str) -> str:
    """Return what a first line seems to be instead of a header, with a remedy; blank if unknown.

    Call this only for a line that is not understood as a header, because a header can begin with
    the same marks.
    """
    line = line.strip()
    if line.startswith(COMMENTS):
        return "a comment where the header should be; begin the file with id,t,x,y"
    if line[:1] in ("{", "["):
        return (
            "JSON, not a table; write a CSV file, or JSON with a list of records, "
            'such as [{"id": 1, "t": 0, "x": 2.5, "y": 4}]'
        )
    if line.startswith("<"):
        return "XML or HTML, not a table; write a CSV file with the header id,t,x,y"
    if any(other in line for other in ",;\t"):
        return ""
    if line.count("|") > 1:
        return "columns separated by vertical bars; write commas instead"
    return ""
