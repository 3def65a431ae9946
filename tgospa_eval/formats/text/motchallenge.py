"""MOTChallenge text: ``frame,id,left,top,width,height[,conf[,...]]``, no header.

Column 7 is a flag in truth, 0 for what is not to be considered, and a score in results. What
follows depends on the number of fields: class and visibility (8 or 9), or a place in space (10).
"""

from dataclasses import replace

from tgospa_eval.common.words import counted
from tgospa_eval.errors import InputError
from tgospa_eval.formats.columns.headers import BOX
from tgospa_eval.formats.fields import Coded
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.text.plain import leave_out_unknown, read_plain
from tgospa_eval.formats.text.scan import numbers
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Floats

FLAG_FIELD = 6
MOT_UNKNOWN = -1.0
"""Each coordinate of a place in space that is not known."""
NOT_CONSIDERED = "not considered"


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
    rows, texts = read_plain(path, data, options, _header, empty=7, given=given, texts=flagged)
    refuse_detections(rows)
    leave_out_unknown(rows, MOT_UNKNOWN)
    if rows.classes is not None and list(rows.classes[0]) == ["-1"] and "class" in options.shared:
        # Results of some trackers fill the columns with -1.
        lacking = {**rows.roles.lacking, "class": f"{path}: every class is -1, not known"}
        rows = replace(rows, classes=None, roles=replace(rows.roles, lacking=lacking))
    if FLAG_FIELD in texts:
        flags = flags_of(texts[FLAG_FIELD], rows, "conf")
        rows.apart[NOT_CONSIDERED] = flags == 0, "left out: 0 in column 7, not to be considered"
    return rows


def _header(fields: list[str], where: str) -> list[str]:
    """Names of the columns."""
    if not 6 <= len(fields) <= 10:
        raise InputError(
            f"{where}: {counted(len(fields), 'field')}; MOTChallenge text has 6 to 10: "
            "frame,id,left,top,width,height,conf,..."
        )
    rest = ("loc_x", "loc_y", "loc_z") if len(fields) == 10 else ("class", "visibility")
    return ["frame", "id", *BOX, "conf", *rest][: len(fields)]


def refuse_detections(rows: Rows) -> None:
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


def flags_of(texts: Coded, rows: Rows, name: str) -> Floats:
    """A column as numbers, of which 0 is for rows that are not to be considered."""
    values, wrong = numbers([text.strip() for text in texts.distinct], ".")
    if wrong:
        _, wrong = numbers([text.strip() for text in texts], ".")  # with the row, and how many
        row, message = wrong[0]
        raise InputError(f"{rows.where(row)}, column {quoted(name)}: {message}")
    return values[texts.code]
