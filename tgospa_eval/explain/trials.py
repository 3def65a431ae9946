"""Proof of what a repair saves: what it touches is solved again, the bounds of the rest stay.

    V = sum over components of V_b + sum of the prices of what is near to none,

and a repair changes few components (docs/theory/solvers.md, "Repairs"). Those of many repairs are
solved together, as copies at steps of their own, from the assignment and the prices at hand.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.evaluate import GAP
from tgospa_eval.evaluation.prepare import Fitted, fit, measure, prepare
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.explain.assigned import Assigned
from tgospa_eval.explain.candidates import Candidate
from tgospa_eval.explain.copies import Copy, Original, joined, priced
from tgospa_eval.explain.direct import Direct, Trial
from tgospa_eval.explain.edits import Edit, edited
from tgospa_eval.problem.certificate import (
    ROUNDOFF,
    certify,
    lower_bounds,
    lower_cost,
    prove,
)
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.problem import Floats, Ints, Problem, sum_by
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE, changes
from tgospa_eval.results.result import Proof
from tgospa_eval.solvers import Solver
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import SavedSolution, make_warm_start
from tgospa_eval.tracks.attributes import chosen, stacked
from tgospa_eval.tracks.trajectories import Trajectories

COPIES_TOGETHER = 1 << 18
"""Rows and entries of the copies that are solved together."""


def solved(solver: Solver, states: States, saved: SavedSolution, stopwatch: Stopwatch) -> Solution:
    """A solution, by a solver that can from one that is near."""
    if not isinstance(solver, Certified):
        return solver(states, stopwatch)
    warm_start = make_warm_start(states, (saved,), (1.0,))
    return solver(states, stopwatch, replace(warm_start, near=True))


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
        self.proof, self.assigned = proof, assigned
        self.sides, self.request = sides, request
        self.states, self.problem = proof.states, proof.states.problem
        self.blocks = self.states.track_blocks
        gap = request.solver.gap if request.solver.proves else GAP
        self.direct = Direct(proof, assigned, gap)
        estimate = sides.alignment.estimate
        self.present = np.bincount(estimate.step, minlength=self.problem.steps)
        self.steady = self._steady()

    @cached_property
    def lower(self) -> Floats:
        """Lower bound of each component."""
        return lower_bounds(self.states, self.proof.prices, self.proof.reduced)

    @cached_property
    def cost(self) -> tuple[Floats, int]:
        """Cost of each component, and how many terms it has at most."""
        return _block_costs(self.states, self.proof.weights)

    @cached_property
    def original(self) -> Original:
        """What copies are made of."""
        return Original(
            problem=self.problem,
            held=self.assigned.held,
            priced=priced(self.states, self.proof.prices),
        )

    def _steady(self) -> bool:
        """Whether an estimate on the grid at the same steps is measured in the same way."""
        sides, matching = self.sides, self.request.time_matching
        distance = self.request.distance.settings(sides.read[0].columns)
        if sides.distance is not self.request.distance or "reduce" in distance:
            return False  # the distance is made of the data
        if not matching.near:
            return True
        again = fit(sides.read[0], sides.alignment.estimate, self.request).alignment
        return np.array_equal(again.truth.times, sides.alignment.truth.times)

    def local(self, edit: Edit) -> bool:
        """Whether an edit changes some components alone, and not the grid."""
        if not (edit.local and self.steady):
            return False
        matching, estimate = self.request.time_matching, self.sides.alignment.estimate
        kept = edit.tracks(estimate.track, estimate.step) >= 0
        present = np.bincount(estimate.step[kept], minlength=self.problem.steps)
        if edit.added is not None:
            present[edit.added.step] += 1
        gone, new = (
            np.any((self.present > 0) & (present == 0)),
            np.any((self.present == 0) & (present > 0)),
        )
        if matching.near:
            return not gone and not new
        plain = matching.grid in ("union", "truth") and isinstance(self.problem.switch_price, float)
        return plain or not gone

    def run(
        self, candidates: Sequence[Candidate], stopwatch: Stopwatch
    ) -> list[tuple[Candidate, Trial]]:
        """What is proven of each, or of those that were tried until it was to stop."""
        progress = stopwatch.progress
        found: dict[int, Trial] = {}
        local = [k for k, candidate in enumerate(candidates) if self.local(candidate.edit)]
        edits = [candidates[k].edit for k in local]
        near = self._near(edits, stopwatch)
        copies: dict[int, Copy] = {}
        for number, (k, edit) in enumerate(zip(local, edits, strict=True)):
            known = self.direct.trial(edit, near, number)
            if known is None:
                copies[k] = self._copy(edit, near, number)
            else:
                found[k] = known
        done = len(found)
        for group in _groups(copies):
            progress.again("repairs", done / max(len(candidates), 1))
            parts = [copies[k] for k in group]
            found |= zip(group, self._solve(parts, stopwatch), strict=True)
            done += len(group)
        for k in sorted(set(range(len(candidates))) - set(local)):
            if progress.stop.is_set():
                break
            progress.again("repairs", done / len(candidates))
            trial = self._whole(candidates[k].edit, stopwatch)
            found |= {} if trial is None else {k: trial}
            done += 1
        return [(candidates[k], found[k]) for k in sorted(found)]

    def _whole(self, edit: Edit, stopwatch: Stopwatch) -> Trial | None:
        """The repaired estimate evaluated as any other; None if no step counts then."""
        estimate = edited(self.sides.alignment.estimate, edit)
        try:
            sides = fit(self.sides.read[0], estimate, self.request)
            prepared = prepare(sides, self.request, stopwatch=stopwatch)
        except ConfigError:  # the steps that counted were those of what is gone
            return None
        solution = self.request.solver(prepared.states, stopwatch)
        bounds, _, split = certify(prepared.states, solution, consume=solution.disposable)
        return Trial(lower=bounds.lower, upper=bounds.upper, total=split.total)

    def _near(self, edits: list[Edit], stopwatch: Stopwatch) -> Problem | None:
        """The rows that edits add, each edit a track, with all truths."""
        added = _together(self.sides.alignment.estimate, edits)
        if added is None:
            return None
        sides = replace(self.sides, alignment=replace(self.sides.alignment, estimate=added))
        cutoff = self.request.parameters.cutoff
        measured, pairs = measure(sides, self.request, cutoff=cutoff, stopwatch=stopwatch)
        return measured.problem(pairs, self.request.parameters)

    def _copy(self, edit: Edit, near: Problem | None, number: int) -> Copy:
        """One of them; of the `near` problem those rows count that are tracks of this number."""
        problem = self.problem
        blocks = np.zeros(len(self.states.block_begin) + 1, bool)  # the last one: of none
        truth_in, changed = np.zeros(problem.truths, bool), np.zeros(problem.estimates, bool)
        changed[list(edit.pieces)] = True
        rows, entries = np.zeros(0, np.int64), np.zeros(0, np.int64)
        if near is not None and edit.added is not None:
            changed[edit.added.track] = True
            rows = np.flatnonzero(near.estimate_track == number)
            entries = np.flatnonzero(near.estimate_track[near.estimate_row] == number)
            truth_in[problem.truth_track[near.truth_row[entries]]] = True
        for mine, of in zip((truth_in, changed), self.blocks, strict=True):
            blocks[of[mine]] = True
        blocks[-1] = False
        truth_in |= blocks[self.blocks[0]]
        estimate_in = changed | blocks[self.blocks[1]]
        estimate_in = np.append(estimate_in, np.ones(len(edit.fresh), bool))
        return Copy(
            original=self.original,
            edit=edit,
            blocks=blocks[:-1],
            truth_in=truth_in,
            estimate_in=estimate_in,
            near=near,
            rows=rows,
            entries=entries,
        )

    def _solve(self, copies: list[Copy], stopwatch: Stopwatch) -> Iterator[Trial]:
        """Some of them in one problem."""
        problem, saved = joined(copies, self.problem)
        states = merge_runs(problem)
        solution = solved(self.request.solver, states, saved, stopwatch)
        _, lower, split = prove(states, solution, consume=solution.disposable)
        steps = self.problem.steps
        first = np.arange(len(copies)) * steps
        cost = np.zeros(len(copies))
        for part in (split.localisation, split.missed, split.false, split.switch):
            cost += np.add.reduceat(part, first)
        of_copy = states.block_begin // steps
        terms = int(np.bincount(states.begin, minlength=1).max(initial=0))
        error = (steps + 2 * terms + 16) * ROUNDOFF
        alone: list[list[float]] = [[] for _ in copies]
        for side, blocks in zip(problem.sides, states.track_blocks, strict=True):
            row = np.flatnonzero(blocks[side.track] < 0)
            for copy, price in zip(
                (side.step[row] // steps).tolist(), side.price[row], strict=True
            ):
                alone[copy].append(float(price))
        block_costs, most = self.cost
        for k, copy in enumerate(copies):
            kept, beside = ~copy.blocks, list(self._beside(copy))
            least = [*lower[of_copy == k].tolist(), *alone[k], *self.lower[kept].tolist(), *beside]
            whole = math.fsum((float(cost[k]), *block_costs[kept].tolist(), *beside))
            widened = whole * (1 + error + most * ROUNDOFF)
            yield Trial(
                lower=lower_cost(problem, math.fsum(least)),
                upper=widened / (1 - problem.cost_error),
                total=whole,
            )

    def _beside(self, copy: Copy) -> Iterator[float]:
        """Prices of the tracks that are near to none, and that a copy does not have."""
        prices, estimates = self.problem.unassigned_costs, self.problem.estimates
        mine = copy.truth_in, copy.estimate_in[:estimates]
        for price, block, touched in zip(prices, self.blocks, mine, strict=True):
            yield from price[(block < 0) & ~touched].tolist()


def _together(estimate: Trajectories, edits: list[Edit]) -> Trajectories | None:
    """The rows that edits add, on the grid, each edit a track."""
    adding = [(k, edit.added) for k, edit in enumerate(edits) if edit.added is not None]
    if not adding:
        return None
    step = np.concatenate([rows.step for _, rows in adding])
    track = np.concatenate([np.full(len(rows.step), k) for k, rows in adding])
    order = np.lexsort((track, step))
    parts = [(rows.attributes, len(rows.step)) for _, rows in adding]
    spreads = [rows.covariance for _, rows in adding if rows.covariance is not None]
    return Trajectories(
        step=step[order],
        track=track[order],
        state=np.concatenate([rows.state for _, rows in adding])[order],
        ids=np.array([str(k) for k in range(len(edits))], dtype=object),
        times=estimate.times,
        columns=estimate.columns,
        clock=estimate.clock,
        labels=estimate.labels,
        covariance=np.concatenate(spreads)[order] if spreads else None,
        attributes=chosen(stacked(estimate.attributes, parts), order),
    )


def _groups(copies: dict[int, Copy]) -> Iterator[list[int]]:
    """Neighbours that are COPIES_TOGETHER in size, or a single one."""
    group: list[int] = []
    for k, copy in copies.items():
        if group and sum(copies[other].size for other in group) + copy.size > COPIES_TOGETHER:
            yield group
            group = []
        group.append(k)
    if group:
        yield group


def _block_costs(states: States, weights: Ints) -> tuple[Floats, int]:
    """Cost of a feasible assignment in each block, (B,), and how many terms each has at most."""
    problem, blocks = states.problem, len(states.block_begin)
    block = states.pair_block[states.pair]
    used = np.flatnonzero((states.entry >= 0) & (weights > 0))
    entry, terms = states.entry[used], np.bincount(block[used], minlength=blocks)
    total = sum_by(block[used], weights[used] / ONE * problem.cost[entry], blocks)
    moved, amount = changes(states, weights)
    total += sum_by(block[moved], problem.switch_price_at[states.begin[moved]] * amount, blocks)
    terms = terms + np.bincount(block[moved], minlength=blocks)
    for side, blocks_of in zip(problem.sides, states.track_blocks, strict=True):
        free = np.full(len(side.track), ONE)
        np.subtract.at(free, side.row[entry], weights[used])
        at = blocks_of[side.track]
        mine = (at >= 0) & (free > 0)
        total += sum_by(at[mine], free[mine] / ONE * side.price[mine], blocks)
        terms = terms + np.bincount(at[mine], minlength=blocks)
    return total, int(terms.max(initial=0)) + 8
