"""KITTI tracking labels: 17 fields separated by blanks, 18 with a score, no header.

The image box is given by its edges; sizes and places in space are in metres, in the coordinates of
the camera. Truth and results are read alike.
"""

import numpy as np

from tgospa_eval.common.words import counted
from tgospa_eval.errors import InputError
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text.plain import leave_out_unknown, read_plain

FIELDS = (
    *("frame", "id", "class", "truncated", "occluded", "alpha"),
    *("left", "top", "right", "bottom"),
    *("size_height", "size_width", "size_length"),
    *("loc_x", "loc_y", "loc_z", "rotation_y", "score"),
)
TYPE_FIELD = FIELDS.index("class")
IGNORED = "DontCare"

KITTI_UNKNOWN = -1000.0
"""Each coordinate of a place in space that is not known."""


def read_kitti(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:  # noqa: ARG001
    """The rows of a KITTI file, the same in either role.

    Raises
    ------
    InputError
        See `formats.read`.
    """
    rows, texts = read_plain(
        path, data, options, _header, empty=17, given=given, texts=("class",), commas=False
    )
    kind = texts[TYPE_FIELD]
    ignored = np.array([text == IGNORED for text in kind.distinct], bool)
    rows.apart[IGNORED] = ignored[kind.code], f"of type {IGNORED} left out"
    leave_out_unknown(rows, KITTI_UNKNOWN)
    return rows


def _header(fields: list[str], where: str) -> list[str]:
    """Names of the columns."""
    if len(fields) not in (len(FIELDS) - 1, len(FIELDS)):
        raise InputError(
            f"{where}: {counted(len(fields), 'field')}; KITTI tracking labels have 17, or 18 "
            "with a score: frame track_id type truncated occluded alpha left top right bottom ..."
        )
    return list(FIELDS[: len(fields)])
