"""Repairs whose saving follows from the bounds at hand, without solving anything again.

    V - S <= V' <= U',   S: the most that a repair can save, U': cost of the assignment at hand.

Where both meet V' is known (docs/theory/solvers.md, "Repairs"); most repairs save all they can.
"""

import math

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.explain.assigned import Assigned
from tgospa_eval.explain.edits import Edit
from tgospa_eval.problem.certificate import ROUNDOFF
from tgospa_eval.problem.problem import Floats, Ints, Problem
from tgospa_eval.problem.weights import ONE
from tgospa_eval.results.result import Proof


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
        self.free = []
        for side in problem.sides:
            free = np.full(len(side.step), ONE)
            np.subtract.at(free, side.row[states.entry[used]], weights[used])
            self.free.append(free)
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
        moved = np.isin(held.estimate, list(edit.pieces))
        spans = [self._spans(np.flatnonzero(~moved), None)]
        for track, pieces in edit.pieces.items():
            own = np.flatnonzero(held.estimate == track)
            spans += [self._spans(own, (piece.begin, piece.end, piece.to)) for piece in pieces]
        truth, estimate, begin, end, weight = (
            np.concatenate(column) for column in zip(*spans, strict=True)
        )
        for track in {piece.to for pieces in edit.pieces.values() for piece in pieces}:
            if _overfull(
                begin[estimate == track], end[estimate == track], weight[estimate == track]
            ):
                return None
        order = np.lexsort((begin, estimate, truth))
        truth, estimate, begin, end, weight = (
            column[order] for column in (truth, estimate, begin, end, weight)
        )
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

    def _spans(
        self, chosen: Ints, piece: tuple[int, int, int] | None
    ) -> tuple[Ints, Ints, Ints, Ints, Floats]:
        """Truth, estimate, begin, end and weight of what is held, of a piece under its new name."""
        held = self.assigned.held
        begin, end, estimate = held.begin[chosen], held.end[chosen], held.estimate[chosen]
        if piece is not None:
            begin, end = np.maximum(begin, piece[0]), np.minimum(end, piece[1])
            estimate = np.full(len(chosen), piece[2])
        some = begin <= end
        return (
            held.truth[chosen][some],
            estimate[some],
            begin[some],
            end[some],
            held.weight[chosen][some],
        )

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
