"""Proof: bounds of the optimum from the proposal of a solver, and the split of the cost.

Everything works on the whole reduced problem, in compiled kernels or equivalently in NumPy.
This module imports no solver, so that no solver grades its own work.
Weights become integers (multiples of 1/ONE) first, so that feasibility is checked, not estimated.
Both bounds are rounded outward (docs/theory/certificate.md, "Rounding").

Blocks (connected parts of the problem) may be solved at a smaller cutoff. Let V(C) be the optimum
at C = c^p. At step k there are m_k true objects and n_k estimates, and nu_k is the size of a
largest matching of near pairs. Then

    V(C) >= V(s C) + (1 - s) C sum_k (A (m_k - nu_k) + B (n_k - nu_k)),   0 < s < 1,

where a missed target costs A C and a false target B C, with A + B = 1. The reason is that every
cost is a sum, min(d^p, C) = min(d^p, s C) + rest (docs/theory/certificate.md, "Cutoffs far above
the errors").
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, places_of
from tgospa_eval.errors import SolverError
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.paths import best_values, down, lower_sums, relative_gains, row_steps, up
from tgospa_eval.problem.problem import Problem, sum_by, sum_parts
from tgospa_eval.problem.solution import Bounds, Breakdown, Reduced, Solution
from tgospa_eval.problem.states import (
    ONE,
    PART,
    Slots,
    States,
    assigned,
    changes,
    make_feasible,
    merge_runs,
    row_parts,
    spare,
    whole_weights,
)


class UnassignedPrices:
    """Prices of leaving the true objects and estimates of each block unassigned."""

    def __init__(self, states: States) -> None:
        problem = states.problem
        self.sides = []
        for side, blocks_of in zip(problem.sides, states.track_blocks, strict=True):
            self.sides.append((blocks_of[side.track], side.price))
        self.alike = problem.object_prices
        if self.alike is not None:
            blocks = len(states.block_begin)
            self.counts = [
                np.bincount(block[block >= 0], minlength=blocks) for block, _ in self.sides
            ]
        else:
            self.order = [np.argsort(block, kind="stable") for block, _ in self.sides]

    def prices(self, block: int) -> list[float]:
        """Return the price of each true object and estimate of a block at each step."""
        prices: list[float] = []
        for (of_row, price), order in zip(self.sides, self.order, strict=True):
            low, high = np.searchsorted(of_row, (block, block + 1), sorter=order)
            prices += price[order[low:high]].tolist()
        return prices

    def sums(self, blocks: slice, pairs: Floats) -> list[list[float]]:
        """Return ``A (m - g) + B (n - g)`` for each block, as terms that are rounded down.

        This is the price of leaving all of a block unassigned except g pairs. The block has m
        states of true objects, with the price A each, and n states of estimates, with the price B
        each (`alike`, which must not be None). If A = B there is one term, otherwise there is one
        for the truth and one for the estimate.

        Parameters
        ----------
        blocks : slice
            Which blocks.
        pairs : float array
            The number g of each of these blocks.
        """
        first, second = self.alike or (0.0, 0.0)
        truths, estimates = (count[blocks] - pairs for count in self.counts)
        if first == second:
            return [[part] for part in down(first * (truths + estimates)).tolist()]
        parts = down(first * truths), down(second * estimates)
        return [list(of) for of in zip(*(part.tolist() for part in parts), strict=True)]


def unpaired_prices(states: States) -> tuple[float, float]:
    """Return the cost of true objects and of estimates outside all blocks, rounded down."""
    totals = [0.0, 0.0]
    for k, (side, blocks) in enumerate(zip(states.problem.sides, states.track_blocks, strict=True)):
        if (unpaired := blocks < 0).any():
            price = side.price[unpaired[side.track]]
            totals[k] = float(lower_sums(price, np.array([0, len(price)]))[0])
    return totals[0], totals[1]


ROUNDOFF = 2.0**-53
"""Largest relative error of one rounded operation."""

HALF_WORD = 1 << 31
"""Base at which integer prices are split into two halves, whose sums do not overflow."""

TERMS_TOGETHER = 64
"""Number of terms of a cost that are added with rounding; their sums are added exactly."""

LARGEST_PRICE = 1e100
"""Largest price that a proof uses; larger prices count as 0."""


def certify(
    states: States, solution: Solution, *, consume: bool = False
) -> tuple[Bounds, Ints, Breakdown]:
    """Prove ``sum A + sum B - Z(v) <= optimum <= cost of W`` from proposed weights W and prices v.

    A and B are the prices of unassigned objects and estimates. For any v >= 0,
    ``Z(v) = sum v + sum over rows of the best path at the gains G - v``. Both bounds are summed in
    forms in which no digits cancel (docs/theory/certificate.md).

    Parameters
    ----------
    states : States
        The solved problem.
    solution : Solution
        Proposed weights and prices.
    consume : bool
        Whether the assignment may overwrite the memory of the proposed weights.

    Returns
    -------
    Bounds
        Lower and upper bound, in units of c^p.
    weights : (S,) int array
        The feasible assignment, in units of 1/ONE.
    Breakdown
        Cost of the assignment by step. Its sum is the upper bound before this is rounded outward.

    Raises
    ------
    SolverError
        The bounds contradict each other, which only a fault of this program can cause.
    """
    weights, lower, breakdown = prove(states, solution, consume=consume)
    problem = states.problem
    upper = upper_cost(problem, breakdown)
    bound = lower_cost(problem, math.fsum((*lower.tolist(), *unpaired_prices(states))))
    if bound > upper:
        raise SolverError(
            f"the proof contradicts itself, lower bound {bound!r} and upper bound {upper!r} in "
            "units of c^p: please report this as a bug, with the two files"
        )
    return Bounds(lower=bound, upper=upper, rounding=problem.rounding), weights, breakdown


def prove(
    states: States, solution: Solution, *, consume: bool = False
) -> tuple[Ints, Floats, Breakdown]:
    """Compute the parts that `certify` adds up, block by block.

    Returns
    -------
    weights : (S,) int array
        The feasible assignment, in units of 1/ONE.
    lower : (B,) float array
        Lower bound of the cost of each block, including its objects at steps outside its window.
    Breakdown
        Cost of the assignment.
    """
    weights = feasible(states, solution.weights if consume else solution.weights.copy())
    lower = lower_bounds(states, solution.prices, solution.reduced)
    return weights, lower, break_down(states, weights)


def feasible(states: States, proposed: Floats) -> Ints:
    """Return a feasible assignment (S,), in units of 1/ONE, in the memory of the proposed one."""
    given = np.require(proposed, np.float64, ["C", "W"])
    weights = given.view(np.int64)
    for low, high in states.cuts(PART):
        part, state, _ = states.between(low, high)
        whole_weights(given[state], weights[state])
        make_feasible(part, weights[state])
    return weights


def lower_cost(problem: Problem, bound: float) -> float:
    """Return ``L / (1 + delta)``: a lower bound for exact costs, from L for computed costs.

    The relative error of all costs and switch prices is at most delta = `cost_error`. The optimum
    is a minimum of their sums with weights >= 0 (docs/theory/certificate.md, "Rounding").
    """
    lower = (bound * (1 - 4 * ROUNDOFF) - problem.cost_slack) / (1 + problem.cost_error)
    return max(lower * (1 - 4 * ROUNDOFF), 0.0)


def upper_cost(problem: Problem, breakdown: Breakdown) -> float:
    """Return ``U (1 + 72 u) / (1 - delta)``: an upper bound for exact costs, from the total U.

    The factor 1 + 72 u (u = `ROUNDOFF`) covers the rounding of U. Each term is off by at most 3 u,
    and adding `TERMS_TOGETHER` = 64 terms by at most 63 u more. The other 6 u are for the
    operations here. The divisor covers the error of the costs, at most delta = `cost_error`
    (see `lower_cost`).
    """
    return breakdown.total * (1 + (TERMS_TOGETHER + 8) * ROUNDOFF) / (1 - problem.cost_error)


def lower_bounds(states: States, prices: Floats, reduced: tuple[Reduced, ...] = ()) -> Floats:
    """Return a lower bound of the cost of the objects of each block, (B,), from prices >= 0.

    If a block was solved at smaller cutoffs (`reduce_cutoff`), the best bound from those counts.
    """
    blocks = len(states.block_begin)
    lower = np.zeros(blocks)
    direct = np.ones(blocks, bool)
    for part in reduced:
        direct &= ~part.blocks
        inner = lower_bounds(part.states, part.solution.prices, part.solution.reduced)
        np.maximum(lower, of_whole(states, part, inner), out=lower)
    objects = UnassignedPrices(states)
    prices = fair_prices(prices)
    for low, high in states.cuts(PART):
        if direct[low:high].any():
            part_states, _, slot = states.between(low, high)
            bound = _bounds_of_prices(part_states, prices[slot], objects, low)
            np.maximum(lower[low:high], bound, out=lower[low:high], where=direct[low:high])
    return lower


def fair_prices(prices: Floats) -> Floats:
    """Return prices that are valid in a proof: at least 0, and 0 for NaN and huge prices."""
    return np.where(prices <= LARGEST_PRICE, np.fmax(prices, 0.0), 0.0)  # NaN becomes 0


def _bounds_of_prices(
    states: States, prices: Floats, objects: UnassignedPrices, low: int
) -> Floats:
    """Return lower bounds of blocks from prices v >= 0, as in docs/theory/certificate.md.

        L = (sum A + sum B - sum_best (A + B)) + sum_best D - sum_i best_i - (sum v - sum_best v)

    Here ``best`` is the best pair of each row and step, and best_i the value of the best path of
    row i at the `relative_gains`. No digits cancel, because the parentheses are exact sums or
    differences of integers.
    """
    columns, problem = states.columns, states.problem
    running = columns.running(prices)
    left = np.ones(len(prices), np.int32)  # minus 1 for each pair that is put aside
    terms = np.zeros((states.nodes, 4))
    groups = np.zeros(states.nodes)
    taken: list[Ints] = []
    for rows, _ in row_parts(states):
        best, aside, pairs, entry = row_terms(rows, running, left)
        terms[:, 1] -= best
        terms[:, 2] += aside
        groups += pairs
        if objects.alike is None:
            taken.append(entry)
    terms[:, 0], terms[:, 3] = idle_prices(running, left, columns.first)
    blocks = len(states.block_begin)
    first = np.searchsorted(states.node_block, np.arange(blocks + 1)).tolist()
    if objects.alike is not None:
        of_blocks = sum_by(states.node_block, groups, blocks)
        constant = objects.sums(slice(low, low + blocks), of_blocks)
    else:
        constant = [objects.prices(low + block) for block in range(blocks)]
        entry = np.concatenate(taken)
        block = states.track_blocks[0][problem.truth_track[problem.truth_row[entry]]]
        for side in problem.sides:
            price = -side.price[side.row[entry]]
            for number, value in zip(block.tolist(), price.tolist(), strict=True):
                constant[number].append(value)
    sums_of = [
        math.fsum((*part, *terms[a:b].ravel().tolist()))
        for part, a, b in zip(constant, first[:-1], first[1:], strict=True)
    ]
    return np.maximum(down(np.array(sums_of)), 0.0)


def row_terms(
    rows: States, running: tuple[Floats, Ints], left: Ints
) -> tuple[Floats, Floats, Floats, Ints]:
    """Return the terms of some rows in a lower bound, by node, at prices from `Slots.running`.

    The best pair of each row and step is put aside, to be counted separately. `left` decreases by 1
    at the slot of this pair.

    Returns
    -------
    best : (nodes,) float array
        Upper bounds of the values of the best paths, relative to the pairs that are put aside.
    aside : (nodes,) float array
        Lower bounds of the cost of the pairs that are put aside.
    pairs : (nodes,) float array
        Number of the pairs that are put aside.
    entry : int array
        Entries of the pairs that are put aside.
    """
    steps = row_steps(rows)
    price = rows.columns.spans(running)
    runs = places_of(rows.entry < 0)
    price[runs] = np.nextafter(price[runs], 0.0)
    relative, offset, best = relative_gains(rows, steps, price)
    values = best_values(rows, relative, steps, offset)
    aside = lower_sums(_put_aside(rows, steps, best, left), steps.first)
    has_best = best >= 0
    pairs = sum_parts(has_best.astype(np.float64), steps.first)
    return values, aside, pairs, rows.entry[best[has_best]]


def _put_aside(rows: States, steps: Slots, best: Ints, left: Ints) -> Floats:
    """Return the cost of the best pair of each row and step, or 0; lower `left` at its slot."""
    columns = rows.columns
    if kernels:
        cost: Floats = kernels.put_aside(
            best,
            steps.begin,
            rows.entry,
            rows.problem.cost,
            columns.first,
            columns.begin,
            columns.pair_first,
            columns.pair_node,
            left,
        )
        return cost
    has_best = best >= 0
    state = best[has_best]
    paid = np.zeros(len(has_best))
    paid[has_best] = rows.problem.cost[rows.entry[state]]
    slot, end = columns.begin[state], columns.end[state]
    np.subtract.at(left, slot[end > slot], 1)
    return paid


def idle_prices(running: tuple[Floats, Ints], left: Ints, first: Ints) -> Floats:
    """Return ``-sum (left v)`` of each node, rounded up, in two halves that do not overflow."""
    if kernels:
        prices: Floats = kernels.idle_prices(*running, left, first)
        return prices
    unit, whole = running[0], np.diff(running[1])
    halves = whole & (HALF_WORD - 1), whole // HALF_WORD
    low, high = (np.diff(np.append(0, np.cumsum(half * left))[first]) for half in halves)
    return np.stack((-up(unit * low), -up(unit * HALF_WORD * high)))


def of_whole(states: States, part: Reduced, inner: Floats) -> Floats:
    """Return bounds at C, (B,), from the bounds `inner` at s C: V(s C) + (1 - s) forced.

    See `reduce_cutoff`. The bound is 0 for blocks that are not in `part`.
    """
    blocks, scale = len(states.block_begin), part.scale
    home = home_blocks(states, part.states)
    terms: list[list[float]] = [[] for _ in range(blocks)]
    for block, bound in zip(home.tolist(), (scale * inner).tolist(), strict=True):
        terms[block].append(bound)
    for side, *homes in zip(
        states.problem.sides, states.track_blocks, part.states.track_blocks, strict=True
    ):
        outer, own_block = (blocks_of[side.track] for blocks_of in homes)
        unpaired = (own_block < 0) & (outer >= 0)
        price = scale * side.price[unpaired][:1]
        count = np.bincount(outer[unpaired], minlength=blocks)
        for block in np.flatnonzero(count).tolist():
            terms[block].append(math.nextafter(float(price[0]) * int(count[block]), 0.0))
    forced = forced_cost(states, part.blocks)
    lower = np.array(
        [
            math.fsum((*own, fixed, -scale * fixed))
            for own, fixed in zip(terms, forced.tolist(), strict=True)
        ]
    )
    return np.where(part.blocks, np.maximum(down(lower), 0.0), 0.0)


def home_blocks(states: States, inner: States) -> Ints:
    """Return the block of the whole that contains each block at a smaller cutoff."""
    truth = np.empty(len(inner.block_begin), np.int64)
    truth[inner.pair_block] = inner.pair_truth
    return states.track_blocks[0][truth]


def _in_chunks(terms: Floats) -> list[float]:
    """Return sums of TERMS_TOGETHER terms each."""
    sums: list[float] = np.add.reduceat(terms, np.arange(0, len(terms), TERMS_TOGETHER)).tolist()
    return sums


def break_down(states: States, weights: Ints) -> Breakdown:
    """Return ``W D``, ``A (1 - row sums)``, ``B (1 - column sums)``, ``lambda |W' - W|`` by step.

    They are the localisation, missed, false and switch cost of a feasible assignment W
    (docs/theory/metric.md, "Decomposition"), exact in W.
    """
    if not kernels:
        costs, terms = _break_down(states, weights)
        return _breakdown(costs, states.problem.switch_price_at[:-1], terms)
    sizes = len(states.pair_row), *(len(side.step) for side in states.problem.sides)
    bounds = [np.array([0, size], np.int32) for size in (*sizes, states.problem.steps)]
    return next(break_down_parts(states, weights, bounds))


def break_down_parts(states: States, weights: Ints, bounds: Sequence[Ints]) -> Iterator[Breakdown]:
    """Break down parts of a problem that follow each other in time, by the kernels.

    `bounds` has four arrays (parts + 1,): first pair, first truth row, first estimate row and first
    step of each part. The last element of each array is the end of the last part.
    """
    costs, terms = kernels.break_down(states, weights, ONE, bounds)
    steps = bounds[-1].tolist()
    price = states.problem.switch_price_at[:-1]
    for own, low, high in zip(terms, steps[:-1], steps[1:], strict=True):
        yield _breakdown(costs[:, low:high], price[low:high], own)


def _breakdown(costs: Iterable[Floats], price: Floats, terms: list[float]) -> Breakdown:
    """Return the breakdown of a part from costs, counts and variation by step, and total terms."""
    localisation, missed, false, missed_count, false_count, variation = costs
    return Breakdown(
        localisation=localisation,
        missed=missed,
        false=false,
        switch=variation * price,
        missed_count=missed_count,
        false_count=false_count,
        switch_count=0.5 * variation,
        total=math.fsum(terms),
    )


def _break_down(states: States, weights: Ints) -> tuple[list[Floats], list[float]]:
    """Return costs, counts and variation by step, and partial sums of the total."""
    problem, steps = states.problem, states.problem.steps
    used, entry, whole = assigned(states, weights)
    paid = whole / ONE * problem.cost[entry]
    terms, costs, counts = _in_chunks(paid), [sum_by(states.begin[used], paid, steps)], []
    for side in problem.sides:
        free = spare(side, entry, whole)
        left = np.flatnonzero(free)
        share = free[left] / ONE
        lost = share * side.price[left]
        terms += _in_chunks(lost)
        costs.append(sum_by(side.step[left], lost, steps))
        counts.append(sum_by(side.step[left], share, steps))
    moved, amount = changes(states, weights)
    step = states.begin[moved]
    terms += _in_chunks(problem.switch_price_at[step] * amount)
    return [*costs, *counts, sum_by(step, amount, steps)], terms


LARGEST_SWITCH_PRICE = 1e100
"""Largest switch price; higher ones are lowered to it, which does not change the optimum."""


def reduce_cutoff(states: States, blocks: Mask, scale: float) -> States:
    """Return some blocks as a problem with the unit of costs c^p times `scale`, a power of 2.

    Rows and tracks keep their numbers. All true objects must have the same price, and all estimates
    must have the same price (`Problem.object_prices`).
    """
    problem = states.problem
    entry = _entries(states, blocks)
    entry = entry[problem.cost[entry] < scale * (problem.pair_price or 0.0)]
    return merge_runs(
        replace(
            problem,
            truth_row=problem.truth_row[entry],
            estimate_row=problem.estimate_row[entry],
            cost=problem.cost[entry] / scale,
            distance_power=None,
            switch_price=np.minimum(problem.switch_price / scale, LARGEST_SWITCH_PRICE),
            cost_error=0.0,
            cost_slack=0.0,
            rounding=0.0,
        )
    )


def _entries(states: States, blocks: Mask) -> Ints:
    """Return the entries of some blocks, in order."""
    return np.sort(states.entry[states.states_of(blocks) & (states.entry >= 0)])


def forced_cost(states: States, blocks: Mask) -> Floats:
    """Return ``C sum_k (A (m_k - nu_k) + B (n_k - nu_k))`` of each of these blocks, (B,).

    nu_k is at most the size of any vertex cover of the near pairs. The size of a smallest cover is
    exactly nu_k (König).
    """
    problem = states.problem
    count = len(states.block_begin)
    cover = vertex_cover(states, blocks)
    covered = np.zeros(count, np.int64)
    objects = []
    for side, blocks_of, mine in zip(problem.sides, states.track_blocks, cover, strict=True):
        block = blocks_of[side.track]
        objects.append(np.bincount(block[block >= 0], minlength=count))
        covered += np.bincount(block[(block >= 0) & mine], minlength=count)
    first, second = problem.object_prices or (0.0, 0.0)
    if first == second:
        forced = first * np.maximum(objects[0] + objects[1] - 2 * covered, 0)
    else:
        free = (np.maximum(of - covered, 0) for of in objects)
        forced = down(first * next(free)) + down(second * next(free))
        forced = np.maximum(down(forced), 0.0)
    return np.where(blocks, forced, 0.0)


def vertex_cover(states: States, blocks: Mask) -> tuple[Mask, Mask]:
    """Return masks of truth rows and of estimate rows that cover the near pairs of some blocks.

    These rows come from a largest matching and are the fewest possible. It is checked that they
    cover all near pairs.
    """
    problem = states.problem
    entry = _entries(states, blocks)
    truth = problem.truth_row[entry].astype(np.int64)
    estimate = problem.estimate_row[entry].astype(np.int64)
    cover = _cover(truth, estimate, len(problem.truth_step), len(problem.estimate_step))
    if not np.all(cover[0][truth] | cover[1][estimate]):
        return np.ones_like(cover[0]), np.ones_like(cover[1])
    return cover


def _cover(truth: Ints, estimate: Ints, truths: int, estimates: int) -> tuple[Mask, Mask]:
    """Return a smallest vertex cover of a bipartite graph by König's theorem, as two masks."""
    from scipy import sparse  # lazy: slow to import and rarely needed
    from scipy.sparse.csgraph import maximum_bipartite_matching

    row, column = truth.astype(np.int32), estimate.astype(np.int32)  # SciPy before 1.15 needs int32
    graph = sparse.csr_array(
        (np.ones(len(truth), np.int8), (row, column)), shape=(truths, estimates)
    )
    partner = maximum_bipartite_matching(graph, perm_type="column")
    # Follow alternating paths from unmatched truth rows: any pair forward, a matched pair back.
    reached = partner < 0
    paired = np.full(estimates, -1)
    paired[partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    visited = np.zeros(estimates, bool)
    while True:
        fresh = np.unique(estimate[reached[truth] & ~visited[estimate]])
        if not len(fresh):
            return ~reached, visited
        visited[fresh] = True
        back = paired[fresh]
        reached[back[back >= 0]] = True
