"""Warnings about one side alone: nothing in it, no tracks in it, ids in two spellings."""

import numpy as np

from tgospa_eval.common.notices import Notice
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Trajectories

SIDES = ("truth", "estimate")
EMPTY_OTHER_SIDE = ("all estimates are false", "all truths are missed")


def side_warnings(sides: tuple[Trajectories, Trajectories]) -> list[Notice]:
    """What a side cannot mean to be."""
    found = []
    for name, meaning, side in zip(SIDES, EMPTY_OTHER_SIDE, sides, strict=True):
        if not len(side.step):
            found.append(
                Notice(
                    code="empty-side",
                    text=f"no row of the {name} takes part: {meaning}",
                    remedy=f"see that this is the right file, and what filters leave of the {name}",
                )
            )
        elif len(side.step) == len(side.ids) > 2 and np.count_nonzero(np.diff(side.step)) > 1:
            found.append(
                Notice(
                    code="single-rows",
                    text=f"every id of the {name} has one row: these are detections, no tracks, "
                    "and each costs half a switch or more at each end",
                    remedy="an id must be the same at all steps of a track",
                )
            )
        found += _spellings(name, side)
    return found


def _spellings(name: str, side: Trajectories) -> list[Notice]:
    """Ids that are one number, and different texts: 7 and 7.0."""
    whole = {text for text in side.ids.tolist() if text.isdigit()}
    for text in side.ids.tolist() if whole else ():
        number, point, zeros = text.partition(".")
        if point and zeros and not zeros.strip("0") and number in whole:
            return [
                Notice(
                    code="id-types",
                    text=f"ids {quoted(number)} and {quoted(text)} of the {name} are one number in "
                    "two spellings, and two trajectories",
                    remedy="write ids alike",
                )
            ]
    return []
