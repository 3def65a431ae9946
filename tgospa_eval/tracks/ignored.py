"""States that are not judged: marks on the rows of truth and estimate."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Mask
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.text import option, quoted
from tgospa_eval.tracks.trajectories import Trajectories

IGNORED, EXCUSED = "ignored", "excused"
"""Columns of truth and estimate that say what is not judged."""

MARKED, OWN_MARKS = "marked", "marked-estimates"
MARKS: Mapping[str, str] = {MARKED: IGNORED, OWN_MARKS: EXCUSED}
"""Of truth and estimate the rule of ``--ignore`` that asks for its marks, and their column."""

NOT_JUDGED = "\0not judged"
"""The attribute of what is not judged, whatever says so: of truths ignored, of estimates excused.
No column of a file has such a name."""

AWAY = "\0time to the nearer state"
"""The attribute of states in gaps, in seconds or the unit of the stamps; 0 of others."""


MEANINGS: Mapping[object, bool] = {
    **dict.fromkeys((0.0, "0", "false", "no", ""), False),
    **dict.fromkeys((1.0, "1", "true", "yes"), True),
}
"""What a mark may be; blank is not marked."""


def marks_of(side: Trajectories, name: str) -> Mask:
    """Which rows (R,) are marked in an attribute; none without it.

    Raises
    ------
    InputError
        A value is neither yes nor no.
    """
    given = side.attributes.get(name)
    if given is None:
        return np.zeros(len(side.step), bool)
    if given.dtype.kind == "f":
        meant = [MEANINGS.get(value) for value in np.nan_to_num(given).tolist()]
    else:
        meant = [MEANINGS.get(text.strip().lower()) for text in given.tolist()]
    found, odd = (np.array([mark is kind for mark in meant], bool) for kind in (True, None))
    if odd.any():
        row = int(np.argmax(odd))
        raise InputError(
            f'column "{name}": id {quoted(side.ids[side.track[row]])} at '
            f"t = {side.shown[side.step[row]]} is {quoted(str(given[row]))}; must be 0 or 1, false "
            "or true"
        )
    return found


def marked(side: Trajectories, rows: Mask) -> Trajectories:
    """With these rows not judged, beside those that are not."""
    if not rows.any():
        return side
    marks = (marks_of(side, NOT_JUDGED) | rows).astype(np.float64)
    return replace(side, attributes={**side.attributes, NOT_JUDGED: marks})


def refuse_own_marks(rules: Iterable[object], verb: str) -> None:
    """Refuse marks of estimates where these are judged against others.

    Raises
    ------
    ConfigError
        They are among the rules.
    """
    if OWN_MARKS in rules:
        raise ConfigError(
            f"{option('ignore', OWN_MARKS)}: {verb} does not take marks of estimates, for a "
            "tracker would say itself what it is not judged by; mark the truth "
            f"({option('ignore', MARKED)}) or give {option('ignore_regions')}"
        )
