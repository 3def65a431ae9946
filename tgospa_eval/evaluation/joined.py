"""Many small pairs as one problem, one after the other in time, with the numbers of each by itself.

Nothing joins two of them: no step, no object, no component. Search, reduction, trivial components
and certificate take all at once; a pair with components that need a solver is solved by itself.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import replace
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import Resources
from tgospa_eval.distances.pair_search import plain_norm, prepared_pairs
from tgospa_eval.distances.vector import Norm
from tgospa_eval.evaluation.prepare import AlignedPair
from tgospa_eval.evaluation.prove import LARGE
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.certificate import (
    break_down_parts,
    feasible,
    lower_bounds,
    lower_cost,
    upper_cost,
)
from tgospa_eval.problem.metric_family import tgospa_problem
from tgospa_eval.problem.paths import lower_sums
from tgospa_eval.problem.solution import Bounds
from tgospa_eval.problem.states import States, merge_runs
from tgospa_eval.results.records import Costs
from tgospa_eval.solvers.block_costs import SETTLED_FROM, price_cap
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.dual_ascent import Ascent
from tgospa_eval.solvers.far_cutoff import fitting_scales
from tgospa_eval.solvers.trivial import solve_steps
from tgospa_eval.tracks.trajectories import Trajectories


def can_be_joined(request: EvaluationRequest) -> bool:
    """Whether pairs of such a request can be evaluated together: the plain metric of points."""
    solver, distance = request.solver, request.distance
    return (
        bool(kernels)
        and isinstance(solver, Certified)
        and solver.time_limit is None
        and isinstance(distance, Norm)
        and distance.period is None
        and request.parameters.switch_price < SETTLED_FROM
        and not (request.curve or request.sliding or request.with_ or request.nees)
        and not (request.slices or request.step_weights or request.probabilistic)
        and request.ignoring is None
    )


def joined_costs(pairs: Sequence[AlignedPair], request: EvaluationRequest) -> list[Costs | None]:
    """Bounds and breakdown of each pair, those of an evaluation by itself to the last bit.

    None of a pair that has to be evaluated by itself: it is of another distance, or has costs that
    need another cutoff, or is not solved by what all are solved by.

    Parameters
    ----------
    pairs : sequence of AlignedPair
        What is evaluated.
    request : EvaluationRequest
        What is asked of them, of which `can_be_joined` is true.
    """
    alike = [k for k, pair in enumerate(pairs) if _is_like(pair, pairs[0])]
    costs: list[Costs | None] = [None] * len(pairs)
    if alike:
        joined = _Joined([pairs[k] for k in alike], request)
        for k, own in zip(alike, joined.costs(), strict=True):
            costs[k] = own
    return costs


def _is_like(pair: AlignedPair, first: AlignedPair) -> bool:
    """Whether a pair has points and the distance of the first, and coordinates of all digits."""
    sides = pair.alignment.truth, pair.alignment.estimate
    return (
        pair.alignment.held is None
        and pair.distance == first.distance
        and pair.alignment.truth.columns == first.alignment.truth.columns
        and plain_norm(sides, pair.distance) is not None
        and all(abs(side.state).max(initial=0.0) < LARGE for side in sides)
    )


class _Joined:
    """Pairs one after the other in time.

    Attributes
    ----------
    steps, tracks, rows : arrays
        First step (N + 1,), and of either side first track and row of each pair, and the end.
    """

    def __init__(self, pairs: Sequence[AlignedPair], request: EvaluationRequest) -> None:
        self.parameters, self.solver = request.parameters, replace(request.solver, jobs=1)
        both = [(pair.alignment.truth, pair.alignment.estimate) for pair in pairs]
        self.steps = _ends(len(truth.times) for truth, _ in both)
        self.tracks: list[Ints] = []
        self.rows: list[Ints] = []
        sides = []
        for side in zip(*both, strict=True):
            self.tracks.append(_ends(len(one.ids) for one in side))
            self.rows.append(_ends(len(one.step) for one in side))
            sides.append(self._one_side(side))
        distance = pairs[0].distance
        effort = Resources(jobs=1)
        seen, distance = distance.prepared((sides[0], sides[1]), effort)
        near = prepared_pairs(seen, self.parameters.cutoff, distance, effort)
        truth, estimate = seen
        problem = tgospa_problem(
            parameters=self.parameters,
            steps=len(truth.times),
            truths=len(truth.ids),
            estimates=len(estimate.ids),
            truth_step=truth.step,
            truth_track=truth.track,
            estimate_step=estimate.step,
            estimate_track=estimate.track,
            truth_row=near.truth_row,
            estimate_row=near.estimate_row,
            distance=near.distance,
            distance_error=distance.error(truth.state.shape[1]),
        )
        self.states = states = merge_runs(problem)
        parts = np.arange(len(pairs) + 1)
        of_pair = np.searchsorted(self.tracks[0], states.pair_truth, side="right") - 1
        self.pairs = np.searchsorted(of_pair, parts).astype(np.int32)
        self.home = np.zeros(len(states.block_begin), np.int64)
        self.home[states.pair_block] = of_pair
        self.blocks = np.searchsorted(self.home, parts).tolist()
        self.entries = np.searchsorted(problem.entry_step, self.steps)

    def _one_side(self, sides: Sequence[Trajectories]) -> Trajectories:
        k = len(self.rows) - 1
        sizes = np.diff(self.rows[k])
        return Trajectories(
            step=np.concatenate([one.step for one in sides]) + np.repeat(self.steps[:-1], sizes),
            track=np.concatenate([one.track for one in sides])
            + np.repeat(self.tracks[k][:-1], sizes),
            state=np.concatenate([one.state for one in sides]),
            ids=np.arange(self.tracks[k][-1]),
            times=np.arange(self.steps[-1]),
            columns=sides[0].columns,
        )

    def costs(self) -> Iterator[Costs | None]:
        """Of each pair; None of those that have to be evaluated by themselves."""
        states, problem = self.states, self.states.problem
        weights, prices, alone = self._solve()
        if problem.cost_slack:  # of powers near the smallest double
            alone[:] = True
        whole = feasible(states, weights)
        lower = lower_bounds(states, prices).tolist()
        parts = break_down_parts(states, whole, (self.pairs, *self.rows, self.steps))
        blocks, unpaired = itertools.pairwise(self.blocks), zip(*self._unpaired(), strict=True)
        for split, left, (low, high), skipped in zip(parts, unpaired, blocks, alone, strict=True):
            bounds = Bounds(
                lower=lower_cost(problem, math.fsum((*lower[low:high], *left))),
                upper=upper_cost(problem, split),
            )
            proven = not skipped and bounds.lower <= bounds.upper and bounds.met(self.solver.gap)
            costs = Costs(parameters=self.parameters, bounds=bounds, breakdown=split)
            yield costs if proven else None

    def _solve(self) -> tuple[Floats, Floats, Mask]:
        """Weights (S,) and prices (K,), and which pairs have to be evaluated by themselves."""
        states, price = self.states, self.parameters.switch_price
        weights, prices = np.zeros(len(states.begin)), np.zeros(len(states.columns.step))
        alone, most = np.zeros(len(self.pairs) - 1, bool), np.zeros(len(self.pairs) - 1)
        wanted = np.zeros(len(self.home), bool)
        if not len(wanted):
            return weights, prices, alone
        alone[self.home[fitting_scales(states) < 1]] = True
        wanted[solve_steps(states, weights, prices)] = True
        np.maximum.at(most, self.home[wanted], price_cap(states)[wanted])
        alone |= (most > 0) & (most < price)
        wanted &= ~alone[self.home]
        if wanted.any():
            with np.errstate(under="ignore"):
                ascent = Ascent(states, wanted, self.solver.gap, weights, prices)
            for k in np.unique(self.home[ascent.wide()]).tolist():
                part, state, slot = self._part(k)
                solution = self.solver(part, Stopwatch())
                weights[state], prices[slot] = solution.weights, solution.prices
                alone[k] = bool(solution.reduced) or not solution.finished
        return weights, prices, alone

    def _part(self, k: int) -> tuple[States, slice, slice]:
        """The problem of one pair, as of itself, and where its states and column slots are."""
        problem = self.states.problem
        part, state, slot = self.states.between(*self.blocks[k : k + 2])
        step, last = self.steps[k : k + 2].tolist()
        (truth, truths), (estimate, estimates) = (of[k : k + 2].tolist() for of in self.tracks)
        (row, rows), (other, others) = (of[k : k + 2].tolist() for of in self.rows)
        entry, entries = self.entries[k : k + 2].tolist()
        own = replace(
            problem,
            steps=last - step,
            truths=truths - truth,
            estimates=estimates - estimate,
            truth_step=problem.truth_step[row:rows] - np.int32(step),
            truth_track=problem.truth_track[row:rows] - np.int32(truth),
            truth_price=problem.truth_price[row:rows],
            estimate_step=problem.estimate_step[other:others] - np.int32(step),
            estimate_track=problem.estimate_track[other:others] - np.int32(estimate),
            estimate_price=problem.estimate_price[other:others],
            truth_row=problem.truth_row[entry:entries] - np.int32(row),
            estimate_row=problem.estimate_row[entry:entries] - np.int32(other),
            cost=problem.cost[entry:entries],
        )
        states = replace(
            part,
            problem=own,
            pair_truth=part.pair_truth - np.int32(truth),
            pair_estimate=part.pair_estimate - np.int32(estimate),
            begin=part.begin - np.int32(step),
            entry=np.where(part.entry >= 0, part.entry - np.int32(entry), part.entry),
            columns=replace(part.columns, step=part.columns.step - np.int32(step)),
            block_begin=part.block_begin - np.int32(step),
            block_end=part.block_end - np.int32(step),
        )
        return states, state, slot

    def _unpaired(self) -> list[list[float]]:
        """Of either side the cost of the objects of each pair that are in no component."""
        costs = []
        sides = zip(self.states.problem.sides, self.states.track_blocks, self.rows, strict=True)
        for side, blocks, rows in sides:
            is_unpaired = blocks[side.track] < 0
            first = np.concatenate(([0], np.cumsum(is_unpaired)))[rows]
            costs.append(lower_sums(side.price[is_unpaired], first).tolist())
        return costs


def _ends(sizes: Iterable[int]) -> Ints:
    """Where each part begins, and the end."""
    return np.concatenate(([0], np.cumsum([*sizes]))).astype(np.int32)
