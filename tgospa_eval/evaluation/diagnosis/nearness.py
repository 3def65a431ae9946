"""Whether truths and estimates are near each other more often than by chance."""

from collections.abc import Iterator

import numpy as np

from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.diagnosis.costs import StepCosts, step_costs
from tgospa_eval.evaluation.diagnosis.sample import StepRows, with_state
from tgospa_eval.problem.problem import Floats
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.tracks.trajectories import Trajectories

SOME = 0.35
"""Share of the pairs that there could be from which on chance is not asked."""

UNLIKE = 4
"""Times as many rows as the other side has: of a side with more, most are near nothing anyway."""

ENOUGH = 100
"""Pairs that there could be, without which chance is not asked."""

HARDLY = 1.5
"""Times what chance saves: wrong pairs may save a little more of it, for estimates that are
displaced leave the scene; sound ones save more than that, if their noise is below the cutoff."""

LITTLE = 0.005
"""Of the most that could be saved: some pairs are near for long, for they go the same way."""

MOVES = (3.0, 6.0)
"""Cutoffs by which estimates are displaced along a line, either way."""


def few_are_near(here: StepCosts) -> bool:
    """Whether there are so few disjoint near pairs that these may be chance."""
    if not len(here.taken):
        return True
    rows = sorted(map(len, here.objects))
    return len(here.taken) < SOME * _most(here) and rows[1] <= UNLIKE * rows[0]


def nearness_warnings(
    here: StepCosts,
    sides: tuple[StepRows, StepRows],
    parameters: Parameters,
    distance: Distance,
) -> list[Notice]:
    """That no truth has an estimate within the cutoff, or some by chance alone.

    Parameters
    ----------
    here : StepCosts
        Of the two sides.
    sides : pair of StepRows
        Truth and estimate at some steps.
    parameters : Parameters
        Cutoff and order.
    distance : Distance
        Base distance of states without covariances.
    """
    within = f"within c = {parameters.cutoff:g}"
    steps = counted(here.steps, "step")
    if not len(here.gain):
        text = f"no truth has an estimate {within} at {steps}: all are missed, all estimates false"
    elif few_are_near(here) and _is_chance(here, sides, parameters, distance):
        rows = len(here.objects[0])
        near = np.count_nonzero(np.bincount(here.rows[0], minlength=rows))
        text = (
            f"only {100 * near / rows:.2g} % of the truths have an estimate {within} at {steps}, "
            "hardly more or nearer than by chance"
        )
    else:
        return []
    return [
        Notice(
            code="nothing-near",
            text=text,
            remedy="see whether both files are of one recording, with the same units, axes and "
            "origin, or choose a larger cutoff if errors may be that large",
        )
    ]


def _is_chance(
    here: StepCosts,
    sides: tuple[StepRows, StepRows],
    parameters: Parameters,
    distance: Distance,
) -> bool:
    """Whether pairs save hardly more of the cost than they would by chance.

    That is what they save where all estimates are displaced by a few cutoffs: whatever belongs
    together is then far apart. Of several lines the one counts along which most is saved: on a road
    what is displaced across it is near nothing. Exchanged steps would not do, for what is at rest
    is where it was at any other step.
    """
    most = _most(here)
    if most < ENOUGH:
        return False
    saved = _saved(here) - LITTLE * most
    truth, estimate = (side.table for side in sides)
    still = StepRows.of(truth)
    for line in _lines((truth, estimate), parameters.cutoff, distance):
        moved = (
            StepRows.of(_displaced_by(estimate, way * move * line))
            for move in MOVES
            for way in (1, -1)
        )
        by_chance = [_saved(step_costs(still, side, parameters, distance)) for side in moved]
        if saved <= HARDLY * sum(by_chance) / len(by_chance):
            return True
    return False


def _most(here: StepCosts) -> int:
    """Pairs that there could be."""
    return int(np.minimum(*here.counts).sum())


def _saved(costs: StepCosts) -> float:
    """Of the cost of leaving all unassigned."""
    return float((costs.unassigned - costs.upper).sum())


def _lines(
    sides: tuple[Trajectories, Trajectories], cutoff: float, distance: Distance
) -> Iterator[Floats]:
    """Vectors (R or 1, d) as long as the cutoff on both or one of the first two axes of position.

    They are the diagonals, the axes, and the direction in which the truths are spread most.
    """
    truth, estimate = sides
    columns = estimate.columns
    if distance.name == "haversine":
        from tgospa_eval.distances.sphere import RADIUS  # here: most distances are others

        chosen, degrees = [0, 1], np.degrees(cutoff / RADIUS)
        shrunk = np.cos(np.radians(truth.state[:, 0])).mean().clip(0.01)
        reach = np.array([[degrees], [degrees / shrunk]])
    else:
        named = [columns.index(name) for name in ("x", "y") if name in columns]
        chosen = named or list(range(len(columns)))[:2]
        reach = distance.reach(cutoff, distance.axes(estimate, slice(None)))[chosen]
    if not np.isfinite(reach).all():
        return
    units = [(1.0, 1.0), (1.0, -1.0), (1.0, 0.0), (0.0, 1.0)] if len(chosen) > 1 else [(1.0,)]
    scaled = truth.state[:, chosen] / reach.mean(axis=1)
    centred = scaled - scaled.mean(axis=0)
    largest = float(np.abs(centred).max())
    if 0 < largest < np.inf:
        widest = np.linalg.eigh(centred.T / largest @ centred / largest)[1][:, -1]
        units.append(tuple(widest))
    for unit in units:
        line = np.zeros((reach.shape[1], len(columns)))
        line[:, chosen] = reach.T * unit
        yield line


def _displaced_by(estimate: Trajectories, by: Floats) -> Trajectories:
    return with_state(estimate, estimate.state + by)
