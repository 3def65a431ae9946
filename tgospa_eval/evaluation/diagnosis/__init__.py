"""What looks wrong with two sides before anything is solved: clocks, units, axes. Prints nothing.

A warning changes no number. It is raised only where undoing the fault would at least halve the
per-step GOSPA cost, of a clock at least that of common tracks, where what is near is so by chance,
or where a side cannot mean what it seems to.
"""

from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.notices import Notice, Spelling, as_option
from tgospa_eval.common.words import counted, in_both
from tgospa_eval.distances import Distance
from tgospa_eval.evaluation.diagnosis.clock import clock_warnings
from tgospa_eval.evaluation.diagnosis.costs import Sampler
from tgospa_eval.evaluation.diagnosis.sides import side_warnings
from tgospa_eval.evaluation.diagnosis.states import state_warnings
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.tracks.alignment import Alignment, TimeMatching
from tgospa_eval.tracks.trajectories import Trajectories

if TYPE_CHECKING:
    from tgospa_eval.tracks.interpolation import Interpolated


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # of states that nobody has
def diagnose(
    sides: tuple[Trajectories, Trajectories],
    aligned: Alignment,
    matching: TimeMatching,
    parameters: Parameters,
    distance: Distance,
    spell: Spelling = as_option,
) -> list[Notice]:
    """Warnings about two sides.

    Parameters
    ----------
    sides : pair of Trajectories
        Truth and estimate as read.
    aligned : Alignment
        The same, aligned.
    matching : TimeMatching
        How.
    parameters : Parameters
        Cutoff and order of the per-step GOSPA cost.
    distance : Distance
        Base distance.
    spell : callable
        How settings are written in remedies: `as_option` or `as_argument`.
    """
    sampler = Sampler((aligned.truth, aligned.estimate), parameters, distance.lower_bound)
    found = side_warnings(sides)
    clock = clock_warnings(sides, aligned, matching, sampler, spell)
    found += clock
    if not any(notice.code in ("clock-shift", "stamps-near") for notice in clock):
        found += state_warnings(sampler, spell)
    return found


def interpolation_notice(made: "Interpolated", matching: TimeMatching) -> Notice:
    """What was interpolated, and what was not used for it."""
    side = str(matching.interpolate)
    other = "truth" if side == "estimate" else "estimate"
    unused = f", {made.unused:,} at stamps that the {other} does not have are not compared"
    return Notice(
        text=f"{side} interpolated at the stamps of the {other}: "
        f"{counted(made.between, 'state')} between two that are at most {matching.max_gap:.15g} "
        f"apart, {made.own:,} as they were{unused if made.unused else ''}"
    )


def alignment_notices(
    aligned: Alignment, matching: TimeMatching, spell: Spelling = as_option
) -> list[str]:
    """What aligning two sides took: steps of both, stamps that were joined, rows left out."""
    others = aligned.union - aligned.common
    at = "what exists at the other is missed or false"
    if others > 1:
        at = f"what exists at the other {others:,} is missed or false"
    costly = matching.grid == "union" and others and aligned.common
    notices = [in_both(aligned.common, aligned.union) + (f"; {at}" * bool(costly))]
    if aligned.joined:
        pairs = counted(aligned.joined, "pair of stamps was", "pairs of stamps were")
        notices.append(
            f"{pairs} joined, at most {matching.tolerance:.15g} apart "
            f"({spell('time_tolerance', '')})"
        )
    if any(aligned.left_out):
        steps = aligned.union - len(aligned.truth.times)
        notices.append(
            f"{counted(steps, 'step')} left out ({spell('grid', matching.grid)}), with "
            f"{counted(aligned.left_out[0], 'row')} of the truth and {aligned.left_out[1]} of the "
            "estimate"
        )
    return notices
