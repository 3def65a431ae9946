"""Whether default parameters and the unit suit the data."""

import math
from collections.abc import Iterator, Sequence

from tgospa_eval.common.notices import Notice, Spelling, as_option
from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.diagnosis.points import median_nearest
from tgospa_eval.formats.columns.headers import METRES
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.tracks.alignment import Alignment

PARAMETER_NAMES = {"cutoff": "cutoff c", "switch_penalty": "switch penalty gamma"}


def default_notice(
    aligned: Alignment,
    distance: Distance,
    parameters: Parameters,
    defaults: Sequence[str],
    spell: Spelling = as_option,
    *,
    others: bool = False,
    boxes: bool = False,
) -> Notice:
    """One line about the defaults in use, with the scale of the data beside it.

    It is a warning where the default cutoff is below the median distance to the nearest estimate.

    Parameters
    ----------
    aligned : Alignment
        Both sides.
    distance : Distance
        Base distance.
    parameters : Parameters
        In use.
    defaults : sequence of str
        Which of cutoff and switch_penalty nobody chose.
    spell : callable
        How settings are written.
    others : bool
        Whether another warning explains the distances.
    boxes : bool
        Whether boxes are compared by their centres, for which no cutoff suits all sizes.
    """
    used = " and ".join(
        f"{PARAMETER_NAMES[name]} = {getattr(parameters, name):g}" for name in defaults
    )
    nearest = median_nearest(aligned.truth, aligned.estimate, distance)
    known = nearest is not None and math.isfinite(nearest)
    scale = "" if not known else f"; the median nearest estimate is {nearest:.3g} away"
    far = nearest is not None and nearest >= parameters.cutoff and "cutoff" in defaults
    first = (
        "--distance iou compares the boxes themselves; or "
        if boxes and "cutoff" in defaults
        else ""
    )
    return Notice(
        code="default-parameters" if far and not others else "",
        text=f"default {used}{scale}",
        remedy=f"{first}choose with " + " and ".join(spell(name, "") for name in defaults),
    )


def explained(found: Sequence[Notice]) -> bool:
    """Whether a warning explains why states are far from each other."""
    return any(notice.code != "nothing-near" for notice in found)


def unit_notices(unit: str | None) -> Iterator[Notice]:
    """A warning where the unit of states in pixels is given as another one."""
    if (unit or "").casefold() in METRES:
        yield Notice(
            code="unit-label",
            text=f"the unit is called {unit}, and centres of boxes of MOTChallenge and KITTI are "
            "in pixels, and so are c and gamma",
            remedy="say --unit px; of KITTI --columns x,y,z compares places in metres",
        )
