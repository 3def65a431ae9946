"""Formats of text without a header, MOTChallenge, VisDrone and KITTI: one row per object and frame.

MOTChallenge: ``frame,id,left,top,width,height[,conf[,...]]``. Column 7 is a flag in truth, 0 for
what is not to be considered, and a score in results. What follows depends on the number of fields:
class and visibility (8 or 9), or a place in space (10).

VisDrone: ``frame,id,left,top,width,height,score,class,truncation,occlusion``. In truth the score is
a flag, 0 for what is not to be considered; in results truncation and occlusion are -1. Classes are
numbers, read by their names.

KITTI: 17 fields separated by blanks, 18 with a score. The image box is given by its edges; sizes
and places in space are in metres, in the coordinates of the camera. Truth and results are read
alike.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.headers import BOX
from tgospa_eval.formats.columns.roles import find_roles
from tgospa_eval.formats.fields import Coded, attribute_of
from tgospa_eval.formats.guess import COMMENTS
from tgospa_eval.formats.guess import split as split_line
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows, numbered
from tgospa_eval.formats.text.scan import (
    Block,
    beginning,
    check_text,
    chunks,
    convert,
    decode,
    gather,
    numbers,
    plain_id,
    scanned,
    with_comments,
)
from tgospa_eval.text import quoted

Layouts = Mapping[int, tuple[str, ...]]
"""Names of the columns by the number of fields, first those that an empty file does not have."""

MOT_FIELDS = ("frame", "id", *BOX, "conf", "class", "visibility")
MOT_LAYOUTS = {width: MOT_FIELDS[:width] for width in (7, 6, 8, 9)}
MOT_LAYOUTS[10] = (*MOT_FIELDS[:7], "loc_x", "loc_y", "loc_z")
MOT_RULE = "MOTChallenge text has 6 to 10: frame,id,left,top,width,height,conf,..."
MOT_UNKNOWN = -1.0
"""Each coordinate of a place in space that is not known."""

VISDRONE_FIELDS = ("frame", "id", *BOX, "score", "class", "truncation", "occlusion")
VISDRONE_RULE = f"VisDrone tracks have 10: {','.join(VISDRONE_FIELDS)}"
CATEGORIES = (
    *("ignored regions", "pedestrian", "people", "bicycle", "car", "van", "truck"),
    *("tricycle", "awning-tricycle", "bus", "motor", "others"),
)
"""Names of the classes 0 to 11."""
NOT_EVALUATED = ("ignored regions", "others")
"""Classes that are no objects to be tracked."""
UNCLASSED = "-1"
"""Class of trackers that tell none apart."""

KITTI_FIELDS = (
    *("frame", "id", "class", "truncated", "occluded", "alpha"),
    *("left", "top", "right", "bottom"),
    *("size_height", "size_width", "size_length"),
    *("loc_x", "loc_y", "loc_z", "rotation_y", "score"),
)
KITTI_RULE = (
    "KITTI tracking labels have 17, or 18 with a score: frame track_id type truncated occluded "
    "alpha left top right bottom ..."
)
KITTI_UNKNOWN = -1000.0
IGNORED = "DontCare"


def read_motchallenge(
    path: str, data: bytes, options: ReadOptions, role: str, *, given: bool
) -> Rows:
    """The rows of a MOTChallenge file.

    Raises
    ------
    InputError
        See `formats.read`.
    """
    flagged = ("conf",) if role == "truth" else ()
    rows, texts = _read(path, data, options, MOT_LAYOUTS, MOT_RULE, flagged, given=given)
    _refuse_detections(rows)
    _leave_out_unknown(rows, MOT_UNKNOWN)
    if rows.classes is not None and list(rows.classes[0]) == ["-1"] and "class" in options.shared:
        # Results of some trackers fill the columns with -1.
        lacking = {**rows.roles.lacking, "class": f"{path}: every class is -1, not known"}
        rows = replace(rows, classes=None, roles=replace(rows.roles, lacking=lacking))
    _leave_out_flagged(rows, texts, "conf", "0 in column 7")
    return rows


def read_visdrone(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:
    """The rows of a VisDrone file.

    Raises
    ------
    InputError
        See `formats.read`; or a class is none of VisDrone.
    """
    texts_of = ("class", "score") if role == "truth" else ("class",)
    layouts = {len(VISDRONE_FIELDS): VISDRONE_FIELDS}
    rows, texts = _read(path, data, options, layouts, VISDRONE_RULE, texts_of, given=given)
    _refuse_detections(rows)
    category = _category(texts["class"], rows)
    for name in NOT_EVALUATED:
        there = np.array([text == name for text in category.distinct], bool)
        if there.any():
            number = CATEGORIES.index(name)
            rows.apart[name] = there[category.code], f"left out: {name}, class {number}"
    _leave_out_flagged(rows, texts, "score", "score 0")
    attributes, column = dict(rows.attributes), VISDRONE_FIELDS.index("class")
    if column in attributes:
        attributes[column] = attribute_of(category)
    classes = None if rows.classes is None else numbered(category)
    return replace(rows, classes=classes, attributes=attributes)


def read_kitti(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a KITTI file, the same in either role.

    Raises
    ------
    InputError
        See `formats.read`.
    """
    layouts = {width: KITTI_FIELDS[:width] for width in (17, 18)}
    rows, texts = _read(
        path, data, options, layouts, KITTI_RULE, ("class",), given=given, commas=False
    )
    kind = texts["class"]
    ignored = np.array([text == IGNORED for text in kind.distinct], bool)
    rows.apart[IGNORED] = ignored[kind.code], f"of type {IGNORED} left out"
    _leave_out_unknown(rows, KITTI_UNKNOWN)
    return rows


def _read(
    path: str,
    data: bytes,
    options: ReadOptions,
    layouts: Layouts,
    rule: str,
    texts: tuple[str, ...],
    *,
    given: bool,
    commas: bool = True,
) -> tuple[Rows, dict[str, Coded]]:
    """The rows, and some columns as texts by name.

    Parameters
    ----------
    path, data
        The file.
    options : ReadOptions
        Decimal marks are points whatever the options are.
    layouts, rule
        Names of the columns, and what is said where the number of fields is none of these.
    texts : tuple of str
        Names of the columns to be returned as texts, as far as they are there.
    given : bool
        Whether the user named the format: then a file without content is an empty set. There is
        no other way to write one without a header.
    commas : bool
        Whether fields may be separated by commas instead of blanks.

    Raises
    ------
    InputError
        The text is wrong.
    """
    blank = given and not data.strip()
    if not blank:
        check_text(data, path)
    text, whole = ("", True) if blank else beginning(data, path)
    first, line = _first_line(text)
    if not line and not whole:
        text, whole = decode(data, path), True
        first, line = _first_line(text)
    if not line and not given:
        raise InputError(f"{path}: blank lines only; name the format if the set is empty")
    split = split_line if commas else str.split
    place = f"{path}, line {first}"
    count = len(split(line)) if line else next(iter(layouts))
    if count not in layouts:
        raise InputError(f"{place}: {counted(count, 'field')}; {rule}")
    names = layouts[count]
    roles = replace(find_roles(names, options, place, fixed=True), unused=())
    wanted = {name: names.index(name) for name in texts if name in names}
    fields = None
    delimiter = "," if commas and "," in line else " "
    if first == 1 and data.isascii() and not (commas and delimiter == " " and b"," in data):
        columns = tuple(wanted.values())
        fields = scanned(data, 1, len(names), delimiter, roles, texts=columns, quotes=False)
    if fields is None:
        comments: list[int] = []
        blocks = _blocks(
            text if whole else decode(data, path), split, len(names), path, first, comments
        )
        fields = gather(blocks, roles, ".", tuple(wanted.values()))
        roles = with_comments(roles, len(comments))
    rows = convert(fields, roles, ".", path, names, plain_id)
    return rows, {name: fields.coded[column] for name, column in wanted.items()}


def _first_line(text: str) -> tuple[int, str]:
    """The first line that is not blank, and its number."""
    number = 1
    for chunk in chunks(text):
        for line in chunk.split("\n"):
            if line.strip() and not line.lstrip().startswith(COMMENTS):
                return number, line
            number += 1
    return 1, ""


def _blocks(
    text: str,
    split: Callable[[str], list[str]],
    width: int,
    path: str,
    first: int,
    comments: list[int],
) -> Iterator[Block]:
    """The lines that are not blank; all must have as many fields as the first.

    Those of comments are noted: no frame begins so.
    """
    number = 0
    wrong: list[tuple[int, int]] = []
    for chunk in chunks(text):
        lines: list[int] = []
        rows: list[list[str]] = []
        for line in chunk.split("\n"):
            number += 1
            if line.lstrip().startswith(COMMENTS):
                comments.append(number)
            elif line.strip():
                fields = split(line)
                if len(fields) == width:
                    lines.append(number)
                    rows.append(fields)
                else:
                    wrong.append((number, len(fields)))
        if rows:
            yield np.array(lines), list(zip(*rows, strict=True))
    if wrong:
        line_number, found = wrong[0]
        raise InputError(
            f"{path}, line {line_number}: {counted(found, 'field')}, "
            f"line {first} has {width}{more(len(wrong))}; give every row as many"
        )


def _refuse_detections(rows: Rows) -> None:
    """Refuse boxes of which none has an id.

    Raises
    ------
    InputError
        So it is.
    """
    if list(rows.ids[0]) == ["-1"]:
        raise InputError(
            f"{rows.where(0)}: every id is -1: these are detections; TGOSPA compares tracks"
        )


def _leave_out_flagged(rows: Rows, texts: Mapping[str, Coded], name: str, flag: str) -> None:
    """Set rows apart whose number in a column is 0, if it is among the texts."""
    if name not in texts:
        return
    column = texts[name]
    values, wrong = numbers([text.strip() for text in column.distinct], ".")
    if wrong:
        _, wrong = numbers([text.strip() for text in column], ".")  # with the row, and how many
        row, message = wrong[0]
        raise InputError(f"{rows.where(row)}, column {quoted(name)}: {message}")
    apart = values[column.code] == 0
    rows.apart["not considered"] = apart, f"left out: {flag}, not to be considered"


def _leave_out_unknown(rows: Rows, unknown: float) -> None:
    """Set rows apart whose place in space is not known, if the states are places.

    Raises
    ------
    InputError
        None is known.
    """
    place = [
        k
        for k, mix in enumerate(rows.roles.state)
        if len(mix) == 1 and rows.roles.headers[mix[0][0]].startswith("loc_")
    ]
    if not place:
        return
    state = rows.roles.mixed(rows.numbers, rows.roles.state)[:, place]
    apart = np.asarray((state == unknown).all(axis=1), bool)
    if len(apart) and apart.all():
        raise InputError(
            f"{rows.name}: no row has a place in space, all are {unknown:g}; without --columns the "
            "centres of the boxes are compared, with --distance iou the boxes"
        )
    rows.apart["no place"] = apart, f"without a place in space ({unknown:g}): absent at that step"


def _category(texts: Coded, rows: Rows) -> Coded:
    """The names of classes that are numbers; blank where no class is known.

    Raises
    ------
    InputError
        One is no class.
    """
    known = {str(number): name for number, name in enumerate(CATEGORIES)} | {UNCLASSED: ""}
    names = [known.get(plain_id(text)) for text in texts.distinct]
    wrong = np.array([name is None for name in names], bool)
    if wrong.any():
        at = np.flatnonzero(wrong[texts.code])
        row = int(at[0])
        raise InputError(
            f'{rows.where(row)}, column "class": {quoted(texts[row].strip())} is no class of '
            f"VisDrone{more(len(at))}; these are 0 to {len(CATEGORIES) - 1}, or -1 for none"
        )
    return Coded([name or "" for name in names], texts.code)
