"""Messages about rows that repeat an (id, t)."""

from collections.abc import Iterator

import numpy as np

from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import more
from tgospa_eval.formats.columns.headers import fraction, one_stamp
from tgospa_eval.formats.rows import Rows
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Ints

PARTICLES_HINT = "particles of one object need a column weight"

NO_TRACKS = "-1: these are detections, and TGOSPA compares tracks"

NEARLY_ALL = 0.9
"""Share of rows from which one id is that of nearly all."""


def only_detections(name: str) -> str:
    """Message for a file whose only id is -1."""
    return f"{name}: every id is {NO_TRACKS}; give a single track another id"


def refusal(taken: Ints, again: Ints, key: Ints, rows: Rows, format: str) -> str:
    """Message for the repeated row that comes first in the file.

    Parameters
    ----------
    taken : int array
        Rows that take part, in the order of their keys.
    again : int array
        Places in `taken` before each row that repeats the one before.
    key : (R,) int array
        Of all rows, by id and time.
    rows, format
        The file, and how it was read.
    """
    second = taken[again + 1]
    k = int(np.argmin(second))
    row = int(second[k])
    first = int(taken[np.searchsorted(key[taken], key[row])])
    where, roles = rows.where, rows.roles
    message = (
        f"{where(row)}: id {rows.called(row)} at t {rows.moment(row)} was given before, "
        f"{where(first)}{more(len(again))}; "
    )
    cause = _cause(taken, again, rows)
    if cause:
        return message + cause
    remedy = "--on-duplicate first or last"
    if format == "frame":
        remedy = f"drop_duplicates({[roles.headers[roles.id], roles.headers[roles.time]]!r})"
    return f"{message}one row per object and step, or {remedy}; {PARTICLES_HINT}"


def most_repeat(taken: Ints, again: Ints, rows: Rows, which: str) -> Iterator[Notice]:
    """A warning if most rows are left out; arguments as of `refusal`."""
    if 2 * len(again) > len(taken):
        yield Notice(
            code="duplicates",
            text=f"{len(again):,} of {len(taken):,} rows repeat an (id, t), and the {which} one "
            "was taken: the number says little about the tracker",
            remedy=_cause(taken, again, rows)
            or "name the columns of ids and times, --columns id=HEADER,t=HEADER",
        )


def _cause(taken: Ints, again: Ints, rows: Rows) -> str:
    """Why rows may repeat an (id, t), with a remedy; blank if it is not known."""
    time = rows.roles.headers[rows.roles.time]
    rest = next(filter(fraction, rows.roles.unused), None)
    if rest and not fraction(time):
        return f"it seems that {one_stamp(time, rest)}"
    counts = np.bincount(rows.ids[1][taken])
    name, header = rows.ids[0][int(counts.argmax())], rows.roles.headers[rows.roles.id]
    if counts.max() < NEARLY_ALL * len(taken):
        return ""
    share = "every id is" if counts.max() == len(taken) else "nearly every id is"
    if name == "-1":
        return f"{share} {NO_TRACKS}"
    if 2 * len(again) <= len(taken):
        return ""
    return (
        f"{share} {quoted(name)}, as of detections, and TGOSPA compares tracks; if another column "
        f"than {quoted(header)} has the ids, name it, --columns id=HEADER; "
        f"{PARTICLES_HINT}"
    )
