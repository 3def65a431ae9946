"""VisDrone tracks: ``frame,id,left,top,width,height,score,class,truncation,occlusion``, no header.

Truth and results have the same ten columns. In truth the score is a flag, 0 for what is not to be
considered; in results truncation and occlusion are -1. Classes are numbers, read by their names.
"""

from dataclasses import replace

import numpy as np

from tgospa_eval.common.words import counted, more
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.headers import BOX
from tgospa_eval.formats.fields import Coded, attribute_of
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows, numbered
from tgospa_eval.formats.text.motchallenge import flags_of, refuse_detections
from tgospa_eval.formats.text.plain import read_plain
from tgospa_eval.formats.text.scan import plain_id
from tgospa_eval.text import quoted

VISDRONE_FIELDS = ("frame", "id", *BOX, "score", "class", "truncation", "occlusion")
SCORE_FIELD, CATEGORY_FIELD = VISDRONE_FIELDS.index("score"), VISDRONE_FIELDS.index("class")

CATEGORIES = (
    *("ignored regions", "pedestrian", "people", "bicycle", "car", "van", "truck"),
    *("tricycle", "awning-tricycle", "bus", "motor", "others"),
)
"""Names of the classes 0 to 11."""

NOT_EVALUATED = ("ignored regions", "others")
"""Classes that are no objects to be tracked."""

UNCLASSED = "-1"
"""Class of trackers that tell none apart."""


def read_visdrone(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:
    """The rows of a VisDrone file.

    Raises
    ------
    InputError
        See `formats.read`; or a class is none of VisDrone.
    """
    flagged = ("score",) if role == "truth" else ()
    wanted = ("class", *flagged)
    rows, texts = read_plain(path, data, options, _header, empty=10, given=given, texts=wanted)
    refuse_detections(rows)
    category = _named(texts[CATEGORY_FIELD], rows)
    for name in NOT_EVALUATED:
        there = np.array([text == name for text in category.distinct], bool)
        if there.any():
            number = CATEGORIES.index(name)
            rows.apart[name] = there[category.code], f"left out: {name}, class {number}"
    if SCORE_FIELD in texts:
        flags = flags_of(texts[SCORE_FIELD], rows, "score")
        rows.apart["not considered"] = flags == 0, "left out: score 0, not to be considered"
    attributes = dict(rows.attributes)
    if CATEGORY_FIELD in attributes:
        attributes[CATEGORY_FIELD] = attribute_of(category)
    classes = None if rows.classes is None else numbered(category)
    return replace(rows, classes=classes, attributes=attributes)


def _header(fields: list[str], where: str) -> list[str]:
    """Names of the columns."""
    if len(fields) != len(VISDRONE_FIELDS):
        raise InputError(
            f"{where}: {counted(len(fields), 'field')}; VisDrone tracks have 10: "
            f"{','.join(VISDRONE_FIELDS)}"
        )
    return list(VISDRONE_FIELDS)


def _named(texts: Coded, rows: Rows) -> Coded:
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
