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

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.evaluate import GAP
from tgospa_eval.evaluation.prepare import Fitted, fit, measure, prepare
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.explain.candidates import Candidate, Copy, joined, size_of
from tgospa_eval.explain.edits import Assigned, Edit, edited, renamed
from tgospa_eval.problem.certificate import (
    ROUNDOFF,
    certify,
    lower_bounds,
    lower_cost,
    prove,
)
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.problem import Floats, Ints, Problem
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE, changes, spare
from tgospa_eval.results.result import Proof
from tgospa_eval.solvers import Solver
from tgospa_eval.solvers.block_costs import feasible_costs
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import SavedSolution, make_warm_start
from tgospa_eval.tracks.attributes import chosen, stacked
from tgospa_eval.tracks.trajectories import Trajectories


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What is proven of the cost after a repair, in units of c^p.

    Parameters
    ----------
    lower, upper : float
        The bracket.
    total : float
        The cost of the assignment that was found.
    """

    lower: float
    upper: float
    total: float


class Direct:
    """Bounds of a solved problem after an edit.

    Parameters
    ----------
    proof : Proof
        What is proven before.
    assigned : Assigned
        Its assignment.
    gap : float
        Relative gap at which a bracket is met.
    """

    def __init__(self, proof: Proof, assigned: Assigned, gap: float) -> None:
        self.bounds, self.gap, self.assigned = proof.bounds, gap, assigned
        problem = self.problem = assigned.problem
        states, weights = assigned.states, assigned.weights
        used = np.flatnonzero((states.entry >= 0) & (weights > 0))
        self.free = [spare(side, states.entry[used], weights[used]) for side in problem.sides]
        self.unpaid = [
            free / ONE * side.price for free, side in zip(self.free, problem.sides, strict=True)
        ]
        split = proof.breakdown
        self.parts = [float(part.sum()) for part in (split.localisation, split.missed, split.false)]
        self.switch = float(split.switch.sum())
        self.rounding = (len(weights) + 2 * len(problem.cost) + 64) * ROUNDOFF

    def trial(self, edit: Edit, near: Problem | None, number: int) -> Trial | None:
        """What follows for an edit, whose rows are a track of `near`; None if too little."""
        if edit.added is not None:
            return None if near is None else self._added(edit, near, number)
        track = edit.tracks(self.problem.estimate_track, self.problem.estimate_step)
        if (track < 0).any():
            return self._dropped(track)
        return self._renamed(edit)

    def _trial(self, parts: list[float], most: float) -> Trial | None:
        """From what the assignment costs, and from what can be saved at most."""
        total = math.fsum(parts)
        upper = total * (1 + self.rounding) / (1 - self.problem.cost_error)
        before, error = self.bounds.lower, self.problem.cost_error + self.rounding
        lower = max(before - most - error * (abs(most) + before), 0.0)
        if upper - lower > self.gap * upper:
            return None
        return Trial(lower=min(lower, upper), upper=upper, total=total)

    def _dropped(self, track: Ints) -> Trial | None:
        """Without rows that nothing is assigned to: a solution may leave them unassigned before."""
        gone = track < 0
        if (self.free[1][gone] < ONE).any() or (track != self.problem.estimate_track)[~gone].any():
            return None
        location, missed, _ = self.parts
        false = float(self.unpaid[1][~gone].sum())
        most = float(self.problem.estimate_price[gone].sum())
        return self._trial([location, missed, false, self.switch], most)

    def _renamed(self, edit: Edit) -> Trial | None:
        """With other names: what is held costs the same but for its switches."""
        price = self.problem.switch_price_at
        kept = {piece.to for pieces in edit.pieces.values() for piece in pieces}
        if len(kept) < len(edit.pieces):
            most = self._of_turns(sorted(edit.pieces))
        else:  # at a step where a name changes all that it holds may have to switch
            cuts = [max(p.begin for p in pieces) for pieces in edit.pieces.values()]
            most = sum(2 * float(price[cut]) for cut in cuts)
        switch = self._switches(edit)
        return None if switch is None else self._trial([*self.parts, switch], most)

    def _of_turns(self, tracks: list[int]) -> float:
        """What those who take turns can save as one: a switch of what it holds at each turn."""
        rows = np.concatenate([self.assigned.estimate.rows(track) for track in tracks])
        rows = np.sort(rows)  # in the order of time
        name, step = self.problem.estimate_track[rows], self.problem.estimate_step[rows]
        turns = step[1:][name[1:] != name[:-1]]
        return 2 * float(self.problem.switch_price_at[turns].sum())

    def _switches(self, edit: Edit) -> float | None:
        """Cost of the switches of what is held, under its new names; None if it does not fit."""
        held, price = self.assigned.held, self.problem.switch_price_at
        last = self.problem.steps - 1
        which, estimate, begin, end = renamed(held, edit, np.arange(len(held.truth)))
        truth, weight = held.truth[which], held.weight[which]
        for track in {piece.to for pieces in edit.pieces.values() for piece in pieces}:
            if _overfull(
                begin[estimate == track], end[estimate == track], weight[estimate == track]
            ):
                return None
        order = np.lexsort((begin, estimate, truth))
        truth, estimate, weight = truth[order], estimate[order], weight[order]
        begin, end = begin[order], end[order]
        joins = np.zeros(len(order), bool)
        joins[1:] = (
            (truth[1:] == truth[:-1])
            & (estimate[1:] == estimate[:-1])
            & (begin[1:] == end[:-1] + 1)
        )
        before = np.where(joins, np.roll(weight, 1), 0.0)
        rises = np.where(begin > 0, np.abs(weight - before), 0.0) * price[begin]
        closes = (end < last) & ~np.append(joins[1:], False)
        falls = np.where(closes, weight, 0.0) * price[np.minimum(end + 1, last)]
        return float(rises.sum() + falls.sum())

    def _added(self, edit: Edit, near: Problem, number: int) -> Trial | None:
        """With more rows: without one a truth may be missed that it located, and no more."""
        problem, held = self.problem, self.assigned.held
        rows = np.flatnonzero(near.estimate_track == number)
        entries = np.flatnonzero(near.estimate_track[near.estimate_row] == number)
        truth_row, at = near.truth_row[entries], near.estimate_row[entries]
        saved = problem.truth_price[truth_row] - near.cost[entries]
        most = -near.estimate_price.copy()
        np.maximum.at(most, at, saved)
        assert edit.added is not None
        track = int(edit.added.track[0])
        own = np.flatnonzero((held.estimate == track) & (held.weight == 1.0))
        where = near.estimate_step[at]
        fits = np.zeros(len(entries), bool)
        for k in own.tolist():
            fits |= (
                (problem.truth_track[truth_row] == held.truth[k])
                & (where >= held.begin[k])
                & (where <= held.end[k])
            )
        fits &= self.free[0][truth_row] == ONE
        missed = np.ones(len(problem.truth_step), bool)
        missed[truth_row[fits]] = False
        alone = np.setdiff1d(rows, at[fits])
        location, _, false = self.parts
        return self._trial(
            [
                location,
                float(near.cost[entries[fits]].sum()),
                float(self.unpaid[0][missed].sum()),
                false,
                float(near.estimate_price[alone].sum()),
                self.switch,
            ],
            float(most[rows].sum()),
        )


def _overfull(begin: Ints, end: Ints, weight: Floats) -> bool:
    """Whether spans of weights are more than 1 together at some step."""
    moment = np.concatenate((2 * begin + 1, 2 * end + 2))
    change = np.concatenate((weight, -weight))
    order = np.argsort(moment, kind="stable")
    steps = np.flatnonzero(np.diff(moment[order], append=-1))
    return bool((np.cumsum(change[order])[steps] > 1).any())


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
        weights = self.proof.weights
        return feasible_costs(self.states, weights), _most_terms(self.states, weights)

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
        for group in _groups({k: size_of(copy, self.problem) for k, copy in copies.items()}):
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
        problem, saved = joined(copies, self.problem, self.assigned.held)
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


def _groups(sizes: dict[int, int]) -> Iterator[list[int]]:
    """Neighbours that are COPIES_TOGETHER in size, or a single one."""
    group: list[int] = []
    for k, size in sizes.items():
        if group and sum(sizes[other] for other in group) + size > COPIES_TOGETHER:
            yield group
            group = []
        group.append(k)
    if group:
        yield group


def _most_terms(states: States, weights: Ints) -> int:
    """How many terms the cost of a feasible assignment has in a block at most."""
    block = states.pair_block[states.pair]
    used = np.flatnonzero((states.entry >= 0) & (weights > 0))
    of_terms = [block[used], block[changes(states, weights)[0]]]
    for side, blocks_of in zip(states.problem.sides, states.track_blocks, strict=True):
        at = blocks_of[side.track[spare(side, states.entry[used], weights[used]) > 0]]
        of_terms.append(at[at >= 0])
    return int(np.bincount(np.concatenate(of_terms)).max(initial=0)) + 8
