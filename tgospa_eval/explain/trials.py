"""Proof of what a repair saves: what it touches is evaluated again, the bounds of the rest stay.

    V = sum over components of V_b + sum of the prices of what is near to none,

and a repair changes few components (docs/theory/solvers.md, "Repairs").
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import near_pairs
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.prepare import Fitted, Prepared, fit, prepare
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.explain.candidates import Candidate
from tgospa_eval.explain.edits import Assigned, Edit, edited, renamed
from tgospa_eval.problem.certificate import ROUNDOFF, certify, lower_bounds, lower_cost
from tgospa_eval.problem.solution import Bounds
from tgospa_eval.results.result import Proof
from tgospa_eval.solvers.block_costs import feasible_costs
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import SavedSolution, WarmStart, make_warm_start
from tgospa_eval.tracks.trajectories import Trajectories

Masks = tuple[NDArray[np.bool_], NDArray[np.bool_]]
"""Some of the truths, and some of the estimates."""


class Trials:
    """Repairs of an evaluated estimate.

    Parameters
    ----------
    proof : Proof
        What is proven of it.
    assigned : Assigned
        Its assignment.
    sides : Fitted
        What was evaluated.
    request : EvaluationRequest
        How.
    """

    def __init__(
        self, proof: Proof, assigned: Assigned, sides: Fitted, request: EvaluationRequest
    ) -> None:
        self.assigned, self.sides, self.request = assigned, sides, request
        self.aligned, self.parameters = sides.alignment, proof.parameters
        states, self.problem = proof.states, proof.states.problem
        self.blocks = states.track_blocks
        self.lower = lower_bounds(states, proof.prices, proof.reduced)
        self.cost = feasible_costs(states, proof.weights)
        self.rounding = (len(proof.weights) + 2 * len(self.problem.cost) + 64) * ROUNDOFF
        distance = request.distance.settings(sides.read[0].columns)
        self.follows_data = sides.distance is not request.distance or "reduce" in distance

    def run(
        self, candidates: Sequence[Candidate], stopwatch: Stopwatch
    ) -> list[tuple[Candidate, Bounds, float]]:
        """What is proven of each, or of those that were tried until it was to stop.

        Bounds of the cost after the repair, and the cost of the assignment, in units of c^p.
        """
        progress = stopwatch.progress
        found = []
        for done, candidate in enumerate(candidates):
            if progress.stop.is_set():
                break
            progress.again("repairs", done / len(candidates))
            try:
                found.append((candidate, *self._trial(candidate.edit, stopwatch)))
            except ConfigError:  # the steps that counted were those of what is gone
                continue
        return found

    def _trial(self, edit: Edit, stopwatch: Stopwatch) -> tuple[Bounds, float]:
        after = edited(self.aligned.estimate, edit)
        if edit.local and len(after.times) == self.problem.steps and not self.follows_data:
            return self._of_components(edit, after, stopwatch)
        sides = fit(self.sides.read[0], after, self.request)
        return self._evaluated(sides, edit, stopwatch)

    def _of_components(
        self, edit: Edit, after: Trajectories, stopwatch: Stopwatch
    ) -> tuple[Bounds, float]:
        """The components that an edit touches are evaluated again, the others stay."""
        problem = self.problem
        touched, blocks = self._touched(edit, after)
        estimate_in = np.append(touched[1], np.ones(len(edit.fresh), bool))
        truth, estimate = (
            side.chosen(np.flatnonzero(mask[side.track]))
            for side, mask in ((self.aligned.truth, touched[0]), (after, estimate_in))
        )
        aligned = replace(self.aligned, truth=truth, estimate=estimate)
        pair = truth, estimate
        sides = replace(self.sides, given=pair, read=pair, alignment=aligned)
        bounds, total = self._evaluated(sides, edit, stopwatch)
        unpaired: list[float] = []
        for price, block, mask in zip(problem.unassigned_costs, self.blocks, touched, strict=True):
            unpaired += price[(block < 0) & ~mask].tolist()
        rest = math.fsum((*self.cost[~blocks].tolist(), *unpaired))
        least = math.fsum((*self.lower[~blocks].tolist(), *unpaired)) * (1 - self.rounding)
        return (
            replace(
                bounds,
                lower=bounds.lower + lower_cost(problem, least),
                upper=bounds.upper + rest * (1 + self.rounding) / (1 - problem.cost_error),
            ),
            total + rest,
        )

    def _touched(self, edit: Edit, after: Trajectories) -> tuple[Masks, NDArray[np.bool_]]:
        """The tracks of all components that an edit touches, and which components these are."""
        truth_in = np.zeros(self.problem.truths, bool)
        estimate_in = np.zeros(self.problem.estimates, bool)
        estimate_in[list(edit.pieces)] = True
        if edit.added is not None:
            estimate_in[edit.added.track] = True
            distance, truth = self.sides.distance, self.aligned.truth
            own = after.chosen(np.flatnonzero(estimate_in[after.track]))
            pairs = near_pairs(
                truth.seen_as(distance.kinds),
                own.seen_as(distance.kinds),
                self.parameters.cutoff,
                distance,
            )
            truth_in[truth.track[pairs.truth_row]] = True
        blocks = np.zeros(len(self.lower) + 1, bool)  # the last one: of none
        for mask, block in zip((truth_in, estimate_in), self.blocks, strict=True):
            blocks[block[mask]] = True
        blocks[-1] = False
        truth_in |= blocks[self.blocks[0]]
        estimate_in |= blocks[self.blocks[1]]
        return (truth_in, estimate_in), blocks[:-1]

    def _evaluated(self, sides: Fitted, edit: Edit, stopwatch: Stopwatch) -> tuple[Bounds, float]:
        """Both sides evaluated as any others, from the solution before the edit."""
        prepared = prepare(sides, self.request, stopwatch=stopwatch)
        solver = self.request.solver
        if isinstance(solver, Certified):
            solution = solver(prepared.states, stopwatch, self._warm_start(edit, prepared))
        else:
            solution = solver(prepared.states, stopwatch)
        bounds, _, split = certify(prepared.states, solution, consume=solution.disposable)
        return bounds, split.total

    def _warm_start(self, edit: Edit, prepared: Prepared) -> WarmStart:
        """The assignment and the prices at hand, with the names of tracks after the edit."""
        held = self.assigned.held
        run, estimate, begin, end = renamed(held, edit)
        became = edit.tracks(held.priced, held.step)
        paid = np.flatnonzero(became >= 0)
        saved = SavedSolution(
            truth=held.truth[run],
            estimate=estimate,
            begin=begin,
            end=end,
            weight=held.weight[run],
            priced=became[paid],
            step=held.step[paid],
            price=held.price[paid],
            estimates=held.estimates + len(edit.fresh),
            steps=held.steps,
        )
        before = self.aligned
        ids = before.truth.ids, [*before.estimate.ids, *edit.fresh]
        step = np.searchsorted(before.truth.times, prepared.moments).clip(0, held.steps - 1)
        truth, estimate = (
            np.array([place[name] for name in names.ids.tolist()], np.int64)
            for names, place in zip(
                prepared.sides, [{name: k for k, name in enumerate(of)} for of in ids], strict=True
            )
        )
        origin = truth, estimate, step
        return replace(make_warm_start(prepared.states, (saved,), (1.0,), origin), near=True)
