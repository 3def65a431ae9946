"""Whether truths and estimates are near each other more often than by chance."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.diagnosis.costs import StepCosts
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
"""Cutoffs by which estimates are displaced on each axis, either way."""


def few_are_near(here: StepCosts, sides: tuple[Trajectories, Trajectories]) -> bool:
    """Whether there are so few disjoint near pairs that these may be chance."""
    if not len(here.taken):
        return True
    rows = sorted(len(side.step) for side in sides)
    return len(here.taken) < SOME * _most(here, sides) and rows[1] <= UNLIKE * rows[0]


def nearness_warnings(
    here: StepCosts,
    sides: tuple[Trajectories, Trajectories],
    parameters: Parameters,
    distance: Distance,
) -> list[Notice]:
    """That no truth has an estimate within the cutoff, or some by chance alone.

    Parameters
    ----------
    here : StepCosts
        Of the two sides.
    sides : pair of Trajectories
        Truth and estimate at some steps.
    parameters : Parameters
        Cutoff and order.
    distance : Distance
        Base distance of states without covariances.
    """
    rows = len(sides[0].step)
    near = np.count_nonzero(np.bincount(here.rows[0], minlength=rows))
    within = f"within c = {parameters.cutoff:g}"
    steps = counted(here.steps, "step")
    if not near:
        text = f"no truth has an estimate {within} at {steps}: all are missed, all estimates false"
    elif few_are_near(here, sides) and _is_chance(here, sides, parameters, distance):
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
    sides: tuple[Trajectories, Trajectories],
    parameters: Parameters,
    distance: Distance,
) -> bool:
    """Whether pairs save hardly more of the cost than they would by chance.

    That is what they save on average where all estimates are displaced by a few cutoffs: whatever
    belongs together is then far apart. Exchanged steps would not do, for what is at rest is where
    it was at any other step.
    """
    truth, estimate = sides
    most = _most(here, sides)
    if most < ENOUGH:
        return False
    by_chance = [
        _saved(StepCosts(truth, other, parameters, distance))
        for other in _displaced(estimate, parameters.cutoff, distance)
    ]
    mean = sum(by_chance) / max(len(by_chance), 1)
    return bool(by_chance and _saved(here) <= HARDLY * mean + LITTLE * most)


def _most(here: StepCosts, sides: tuple[Trajectories, Trajectories]) -> int:
    """Pairs that there could be."""
    counts = [np.bincount(side.step, minlength=here.steps) for side in sides]
    return int(np.minimum(*counts).sum())


def _saved(costs: StepCosts) -> float:
    """Of the cost of leaving all unassigned."""
    return float((costs.unassigned - costs.upper).sum())


def _displaced(estimate: Trajectories, cutoff: float, distance: Distance) -> Iterator[Trajectories]:
    """The estimate, displaced along both diagonals of its first two axes of position."""
    columns = estimate.columns
    if distance.name == "haversine":
        from tgospa_eval.distances.sphere import RADIUS  # here: most distances are others

        chosen, reach = [0], np.degrees(np.full((1, 1), cutoff / RADIUS))
    else:
        named = [columns.index(name) for name in ("x", "y") if name in columns]
        chosen = named or list(range(len(columns)))[:2]
        reach = distance.reach(cutoff, distance.axes(estimate, slice(None)))[chosen]
    if not np.isfinite(reach).all():
        return
    for move in MOVES:
        for signs in product((1.0, -1.0), repeat=len(chosen)):
            state = np.array(estimate.state)
            state[:, chosen] += (move * np.array(signs)[:, None] * reach).T
            yield replace(estimate, state=state)
