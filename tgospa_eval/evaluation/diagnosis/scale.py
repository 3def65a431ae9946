"""Whether default parameters and the unit suit the data."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from tgospa_eval.common.arrays import Floats, median
from tgospa_eval.common.notices import Notice
from tgospa_eval.distances import Distance
from tgospa_eval.distances.pair_search import plain_norm, rows_at
from tgospa_eval.formats.headers import METRES
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.text import option
from tgospa_eval.tracks.alignment import Alignment
from tgospa_eval.tracks.trajectories import Trajectories

MULTIPLE = 3
"""Of the median error: of normal errors in a plane 99.8 % are below that."""

FOLLOWED = 0.75
"""Share of truths that must have an estimate so near, for the median to be that of errors."""

LARGEST_MEDIAN = 1e300
"""Of a median: multiples are still numbers."""

LEADING = (1.0, 2.0, 5.0, 10.0)
"""Leading digits of what is suggested."""


def suggest_cutoff(near: Floats, others: Floats) -> tuple[float, str] | None:
    """A cutoff to begin with, and where it is from; None where errors are not told from misses.

    Parameters
    ----------
    near : (N,) float array
        From truths to the nearest estimate of their step.
    others : (N,) float array
        From these truths to the nearest other truth, inf where there is none.
    """
    if not len(near):
        return None
    middle, apart = (float(np.sort(values)[len(near) // 2]) for values in (near, others))
    # What belongs to a truth is nearer to it than to the next one.
    if not 0 < middle < min(apart / 2, LARGEST_MEDIAN):
        return None
    cutoff = _rounded_up(MULTIPLE * middle)
    followed = float(np.count_nonzero(near < cutoff) / len(near))
    if followed < FOLLOWED:
        return None
    reason = (
        f"{MULTIPLE} times the median distance, {middle:.3g}, rounded up; "
        f"{100 * followed:.0f} % of the truths have an estimate nearer than that"
    )
    crowded = float(np.count_nonzero(others < cutoff) / len(near))
    if crowded >= 0.005:
        reason += f", and {100 * crowded:.0f} % another truth"
    return cutoff, reason


def _rounded_up(value: float) -> float:
    """To a leading digit of `LEADING`."""
    power = math.floor(math.log10(value))
    ends = (float(f"{digit:g}e{power}") for digit in LEADING)
    return next((end for end in ends if value <= end), float(f"1e{power + 1}"))


# -------------------------------------------------------------------------------------------------
# Distances to the nearest points, by a compiled loop where the distance is plain.

SAMPLED_STEPS = 100
"""Steps, and truths of a step, whose nearest estimate is looked at for a notice."""


@np.errstate(over="ignore", invalid="ignore")
def median_nearest(truth: Trajectories, estimate: Trajectories, distance: Distance) -> float | None:
    """Median distance from a truth to the nearest estimate of its step, over up to 100 steps.

    None if no step has both. Both sides must be on the same times.
    """
    distance = distance.lower_bound
    sides = truth, estimate
    rows = [rows_at(side, np.arange(len(side.times))) for side in sides]
    both = np.flatnonzero((rows[0][1] > rows[0][0]) & (rows[1][1] > rows[1][0]))
    if not len(both):
        return None
    both = both[:: -(-len(both) // SAMPLED_STEPS)]
    mine, others = (np.ascontiguousarray(side[:, both]) for side in rows)
    norm = plain_norm(sides, distance)
    if norm is not None:
        states = (side.state for side in sides)
        return median(kernels.nearest_points(*states, mine, others, *norm, SAMPLED_STEPS))
    nearest = []
    for bounds in zip(mine.T.tolist(), others.T.tolist(), strict=True):
        a, b = (
            distance.axes(side, slice(*rows)).T for side, rows in zip(sides, bounds, strict=True)
        )
        a = a[:: -(-len(a) // SAMPLED_STEPS)]
        nearest.append(distance(a[:, None], b[None, :]).min(axis=1))
    return median(np.concatenate(nearest))


PARAMETER_NAMES = {"cutoff": "cutoff c", "switch_penalty": "switch penalty gamma"}


def default_notice(
    aligned: Alignment,
    distance: Distance,
    parameters: Parameters,
    defaults: Sequence[str],
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
        f"{option('distance', 'iou')} compares the boxes themselves; or "
        if boxes and "cutoff" in defaults
        else ""
    )
    return Notice(
        code="default-parameters" if far and not others else "",
        text=f"default {used}{scale}",
        remedy=f"{first}choose with " + " and ".join(option(name, short=True) for name in defaults),
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
            remedy=f"say {option('unit', 'px')}; of KITTI {option('columns', 'x,y,z')} compares "
            "places in metres",
        )
