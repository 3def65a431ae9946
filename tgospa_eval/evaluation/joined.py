"""Many small evaluations, solved together as one problem, with separate results.

A pair here is the truth and the estimate of one evaluation. The steps of all pairs are placed one
behind the other on one time axis, so two pairs share no step, object or component. Four things are
done for all pairs at once: the search, the reduction, the solution of trivial components, and the
certificate. A pair with components that need a solver is solved separately. Words and shapes such
as (S,) are those of `tgospa_eval.solvers`.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated, places_of
from tgospa_eval.common.frozen import replace
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import Resources
from tgospa_eval.distances.pair_search import prepared_pairs
from tgospa_eval.distances.vector import Norm
from tgospa_eval.evaluation.diagnosis.clock import (
    MIN_ERROR,
    MOVES,
    ROBUST,
    STRETCHES,
    SUSPICIOUS,
)
from tgospa_eval.evaluation.diagnosis.costs import (
    FEWEST_STEPS,
    FIRST_STEPS,
    PAIRED,
    SAMPLE_PAIRS,
    SAMPLE_ROWS,
    StepCosts,
    StepRows,
    occupied,
    step_costs,
)
from tgospa_eval.evaluation.diagnosis.states import FITTED, SOME
from tgospa_eval.evaluation.prepare import AlignedPair, NearPairs
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
from tgospa_eval.problem.paths import lower_sums
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.solution import Bounds
from tgospa_eval.problem.states import States, merge_runs
from tgospa_eval.results.records import Costs
from tgospa_eval.solvers.block_costs import SETTLED_FROM, price_cap
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.dual_ascent import Ascent
from tgospa_eval.solvers.far_cutoff import fitting_scales
from tgospa_eval.solvers.trivial import solve_steps
from tgospa_eval.tracks.trajectories import Trajectories

SURELY = 1.001
"""Factor by which limits of `diagnose` are stricter here, because sums round differently."""


def can_be_joined(request: EvaluationRequest) -> bool:
    """Return whether this request allows evaluating pairs together.

    The request must be for the plain metric of points, without further results.
    """
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


def is_like(pair: AlignedPair, first: AlignedPair) -> bool:
    """Return whether a pair can be evaluated together with the pair `first`.

    Both must have the same distance and columns. The states of the pair must be points with
    coordinates below `LARGE`.
    """
    sides = pair.alignment.truth, pair.alignment.estimate
    return (
        pair.alignment.reports is None
        and pair.distance == first.distance
        and sides[0].columns == first.alignment.truth.columns
        and all(side.kind == "point" and side.state.flags.c_contiguous for side in sides)
        and all(abs(side.state).max(initial=0.0) < LARGE for side in sides)
    )


class JoinedPairs:
    """Pairs of truth and estimate as one problem, with their steps behind each other in time.

    Parameters
    ----------
    pairs : sequence of AlignedPair
        The N pairs to evaluate; `is_like` is true for each pair and the first one.
    request : EvaluationRequest
        Request for which `can_be_joined` is true.

    Attributes
    ----------
    steps : (N + 1,) int array
        First step of each pair, and the number of all steps.
    tracks, rows : lists of two (N + 1,) int arrays
        First track and first row of each pair, and the number of all, for truth and estimate.
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
        self.distance, self.sides = pairs[0].distance, (sides[0], sides[1])

    def reduced(self) -> States:
        """Return the reduced problem of all pairs, and store where each pair is in it."""
        resources = Resources(jobs=1)
        prepared, distance = self.distance.prepared(self.sides, resources)
        near = prepared_pairs(prepared, self.parameters.cutoff, distance, resources)
        problem = NearPairs(sides=prepared, distance=distance, pairs=near).problem(self.parameters)
        states = merge_runs(problem)
        parts = np.arange(len(self.steps))
        of_pair = np.searchsorted(self.tracks[0], states.pair_truth, side="right") - 1
        self.pairs = np.searchsorted(of_pair, parts).astype(np.int32)
        self.home = np.zeros(len(states.block_begin), np.int64)
        self.home[states.pair_block] = of_pair
        self.blocks = np.searchsorted(self.home, parts).tolist()
        self.entries = np.searchsorted(problem.entry_step, self.steps)
        return states

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

    def sound(self) -> Mask:
        """Return a mask of the pairs in which `diagnose` would surely see nothing wrong.

        The first tests of `diagnose` run here for all pairs at once, at the steps that `diagnose`
        would use. A pair close to a limit is not marked. All pairs without a mark need `diagnose`.
        """
        sides, count = self.sides, len(self.steps) - 1
        both = places_of(occupied(sides[0]) & occupied(sides[1]))
        bounds = np.searchsorted(both, self.steps)
        size = np.minimum(np.diff(bounds), FIRST_STEPS)
        pair = np.arange(count).repeat(size)
        place = concatenated(np.zeros(count, int), size)
        steps = both[bounds[pair] + place * np.diff(bounds)[pair] // size[pair]]
        looked_at = StepRows.of(sides[0], steps), StepRows.of(sides[1], steps)
        here = step_costs(*looked_at, self.parameters, self.distance)
        objects = [np.diff(rows) / np.diff(self.steps) for rows in self.rows]
        affordable = (objects[0] * objects[1] * FIRST_STEPS <= SAMPLE_PAIRS) & (
            np.maximum(*objects) * FIRST_STEPS <= SAMPLE_ROWS
        )

        def sums(value: Floats | Ints | Mask) -> Floats:
            return sum_by(pair, value.astype(np.float64), count)

        at = here.step[here.taken]
        each = np.bincount(at, minlength=len(steps))
        taken, has_pairs, possible = sums(each), sums(each > 0), sums(np.minimum(*here.counts))
        sound: Mask = affordable & (has_pairs >= FEWEST_STEPS)
        sound &= taken >= np.maximum(np.maximum(PAIRED, FITTED), SURELY * SOME * possible)
        sound &= 2 * SURELY * sums(here.upper) <= sums(here.unassigned)
        sound &= ~self._displaced(here, looked_at, pair[at])
        return sound & ~self._moved(here, looked_at[0], steps, pair)

    def _displaced(self, here: StepCosts, looked_at: tuple[StepRows, StepRows], pair: Ints) -> Mask:
        """Return a mask of pairs in which one displacement may explain most of the distances.

        `pair` has the index of the evaluation of each two states that are assigned to each other.
        """
        first, second = (
            side.side.state[side.row[rows[here.taken]]]
            for side, rows in zip(looked_at, here.rows, strict=True)
        )
        differences, count = first - second, len(self.steps) - 1
        number = np.maximum(np.bincount(pair, minlength=count), 1)
        around, whole = np.zeros(count), np.zeros(count)
        for column in differences.T:
            mean = sum_by(pair, column, count) / number
            around += sum_by(pair, np.square(column - mean[pair]), count)
            whole += sum_by(pair, np.square(column), count)
        displaced: Mask = 2 * around <= SURELY * whole
        return displaced

    def _moved(self, here: StepCosts, truth: StepRows, steps: Ints, pair: Ints) -> Mask:
        """Return a mask of pairs whose estimate may fit better one step earlier or later."""
        count, ways = len(self.steps) - 1, len(MOVES)
        moved = (steps + MOVES).clip(self.steps[pair], self.steps[pair + 1] - 1)
        truths = StepRows(side=truth.side, bounds=np.tile(truth.bounds, ways))
        estimates = StepRows.of(self.sides[1], moved.ravel())
        there = step_costs(truths, estimates, self.parameters, self.distance)
        own, lost = (here.step[here.taken], there.step[there.taken]), (here.lost, there.lost)
        size = max(len(steps), 1)
        typical = [_medians(here.lost, pair[own[0]], count)]
        for way in range(ways):
            of_way = own[1] // size == way
            typical.append(_medians(there.lost[of_way], pair[own[1][of_way] % size], count))
        sharp = 1 / np.minimum(np.maximum(ROBUST * np.min(typical, axis=0), MIN_ERROR), 1.0)
        gains = [
            sum_by(at, np.maximum(1 - sharp[pair[at % size]] * values, 0.0), ends)
            for at, values, ends in zip(own, lost, (len(steps), ways * len(steps)), strict=True)
        ]
        better = np.zeros(count, bool)
        for gain in gains[1].reshape(ways, len(steps)):
            better |= _significances(gain - gains[0], pair, count) > SUSPICIOUS / SURELY
        return better

    def costs(self) -> Iterator[Costs | None]:
        """Yield the costs of each pair, equal to those of a separate evaluation to the last bit.

        None means that the pair must be evaluated separately, for one of two reasons. The joint
        methods do not solve it, or its cutoff is so far above its errors that the solver must use a
        smaller cutoff (docs/theory/solvers.md, "Cutoffs that fit").
        """
        self.states = states = self.reduced()
        problem = states.problem
        weights, prices, lone = self._solve()
        if problem.cost_slack:  # powers near the smallest double are not exact
            lone[:] = True
        whole = feasible(states, weights)
        lower = lower_bounds(states, prices).tolist()
        parts = break_down_parts(states, whole, (self.pairs, *self.rows, self.steps))
        blocks, unpaired = itertools.pairwise(self.blocks), zip(*self._unpaired(), strict=True)
        for split, left, (low, high), skipped in zip(parts, unpaired, blocks, lone, strict=True):
            bounds = Bounds(
                lower=lower_cost(problem, math.fsum((*lower[low:high], *left))),
                upper=upper_cost(problem, split),
            )
            proven = not skipped and bounds.lower <= bounds.upper and bounds.met(self.solver.gap)
            costs = Costs(parameters=self.parameters, bounds=bounds, breakdown=split)
            yield costs if proven else None

    def _solve(self) -> tuple[Floats, Floats, Mask]:
        """Return the weights of states, the prices of column slots, and a mask of pairs.

        The mask has the pairs that must be evaluated separately.
        """
        states, price = self.states, self.parameters.switch_price
        weights, prices = np.zeros(len(states.begin)), np.zeros(len(states.columns.step))
        separate, highest = np.zeros(len(self.pairs) - 1, bool), np.zeros(len(self.pairs) - 1)
        wanted = np.zeros(len(self.home), bool)
        if not len(wanted):
            return weights, prices, separate
        separate[self.home[fitting_scales(states) < 1]] = True
        wanted[solve_steps(states, weights, prices)] = True
        np.maximum.at(highest, self.home[wanted], price_cap(states)[wanted])
        separate |= (highest > 0) & (highest < price)
        wanted &= ~separate[self.home]
        if wanted.any():
            with np.errstate(under="ignore"):
                ascent = Ascent(states, wanted, self.solver.gap, weights, prices)
            for k in np.unique(self.home[ascent.wide()]).tolist():
                part, state, slot = self._part(k)
                solution = self.solver(part, Stopwatch())
                weights[state], prices[slot] = solution.weights, solution.prices
                separate[k] = bool(solution.reduced) or not solution.finished
        return weights, prices, separate

    def _part(self, k: int) -> tuple[States, slice, slice]:
        """Return the problem of pair k, and the slices of its states and column slots."""
        problem = self.states.problem
        part, state, slot = self.states.between(*self.blocks[k : k + 2])
        step, last = self.steps[k : k + 2].tolist()
        (truth, truths), (estimate, estimates) = (of[k : k + 2].tolist() for of in self.tracks)
        (row, rows), (other, other_end) = (of[k : k + 2].tolist() for of in self.rows)
        entry, entries = self.entries[k : k + 2].tolist()
        own = replace(
            problem,
            steps=last - step,
            truths=truths - truth,
            estimates=estimates - estimate,
            truth_step=problem.truth_step[row:rows] - np.int32(step),
            truth_track=problem.truth_track[row:rows] - np.int32(truth),
            truth_price=problem.truth_price[row:rows],
            estimate_step=problem.estimate_step[other:other_end] - np.int32(step),
            estimate_track=problem.estimate_track[other:other_end] - np.int32(estimate),
            estimate_price=problem.estimate_price[other:other_end],
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
        """Return the costs of objects, and of tracks, that are in no component.

        These are two lists, each with one value for each pair.
        """
        costs = []
        sides = zip(self.states.problem.sides, self.states.track_blocks, self.rows, strict=True)
        for side, blocks, rows in sides:
            is_unpaired = blocks[side.track] < 0
            first = np.concatenate(([0], np.cumsum(is_unpaired)))[rows]
            costs.append(lower_sums(side.price[is_unpaired], first).tolist())
        return costs


def _medians(values: Floats, group: Ints, count: int) -> Floats:
    """Return the median of the values of each group; 1 for an empty group."""
    order = np.lexsort((values, group))
    first = np.searchsorted(group[order], np.arange(count + 1))
    size, ordered = np.diff(first), np.append(values[order], 1.0)
    low, high = (np.where(size > 0, first[:-1] + k // 2, -1) for k in (size - 1, size))
    return 0.5 * ordered[low] + 0.5 * ordered[high]


def _significances(values: Floats, group: Ints, count: int) -> Floats:
    """Return `diagnosis.clock.significance` of the values of each group; `group` is sorted."""
    size = np.bincount(group, minlength=count)
    parts = np.minimum(size, STRETCHES)
    of = np.arange(count).repeat(parts)
    place = concatenated(np.zeros(count, int), parts)
    starts = (np.cumsum(size) - size)[of] + place * size[of] // parts[of]
    sums = np.add.reduceat(values, starts) if len(of) else values
    total = sum_by(of, sums, count)
    parts = np.maximum(parts, 1)
    spread = sum_by(of, np.square(sums - (total / parts)[of]), count)
    spread *= parts / np.maximum(parts - 1, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        known = total / np.sqrt(spread)
    return np.where(spread > 1e-24 * total * total, known, np.where(total > 0, np.inf, 0.0))


def _ends(sizes: Iterable[int]) -> Ints:
    """Return the index at which each part begins, and the sum of all sizes."""
    return np.concatenate(([0], np.cumsum([*sizes]))).astype(np.int32)
