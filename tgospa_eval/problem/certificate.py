"""Proof: bounds of the optimum from the proposal of a solver, and the split of the cost.

A solver proposes an assignment and prices of the column slots. This module first makes the
assignment *feasible*: all sums of weights that must be at most 1 are. Its cost is the upper bound.
For this check to be exact, weights are integer multiples of 1/ONE. The lower bound comes from the
prices (docs/theory/certificate.md). Both bounds are rounded outward (same page, "Rounding"), and
the compiled kernels and NumPy give the same results. This module imports no solver: the proof must
not depend on the code that made the proposal.

`problem.states` defines state, slot and block, and the letters of array sizes. The letters of
formulas are those of docs/theory/notation.md. A *row of the truth* is one state of a true object.

A solver can also solve a block at a smaller cutoff. Let V(C) be the optimum of the block at C =
c^p. A missed target costs A C and a false target B C, with A + B = 1. Let step k have m_k true
objects and n_k estimates of the block, and let at most nu_k of its near pairs be assigned together.
Then

    V(C) >= V(s C) + (1 - s) C sum_k (A (m_k - nu_k) + B (n_k - nu_k)),   0 < s < 1.

The proof splits the cost min(d^p, C) of each pair into min(d^p, s C) and the rest (same page,
"Cutoffs far above the errors").
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
        """List the prices of all rows of the truth in a block, then of the estimate."""
        prices: list[float] = []
        for (of_row, price), order in zip(self.sides, self.order, strict=True):
            low, high = np.searchsorted(of_row, (block, block + 1), sorter=order)
            prices += price[order[low:high]].tolist()
        return prices

    def sums(self, blocks: slice, pairs: Floats) -> list[list[float]]:
        """Return ``A (m - g) + B (n - g)`` for each block, as a list of terms, rounded down.

        A block has m rows of the truth with the price A, and n rows of the estimate with the price
        B. If g pairs are assigned, this is the price of all other rows. All blocks must have the
        same A and B (the attribute `alike` is not None). If A = B, the list of a block has one
        term. If not, it has two: for the truth and for the estimate.

        Parameters
        ----------
        blocks : slice
            The blocks.
        pairs : float array
            Number g of pairs of each of these blocks.
        """
        first, second = self.alike or (0.0, 0.0)
        truths, estimates = (count[blocks] - pairs for count in self.counts)
        if first == second:
            return [[part] for part in down(first * (truths + estimates)).tolist()]
        parts = down(first * truths), down(second * estimates)
        return [list(of) for of in zip(*(part.tolist() for part in parts), strict=True)]


def unpaired_prices(states: States) -> tuple[float, float]:
    """Return the cost of the true objects, and that of the estimates, that are in no block.

    Both costs are rounded down.
    """
    totals = [0.0, 0.0]
    for k, (side, blocks) in enumerate(zip(states.problem.sides, states.track_blocks, strict=True)):
        if (unpaired := blocks < 0).any():
            price = side.price[unpaired[side.track]]
            totals[k] = float(lower_sums(price, np.array([0, len(price)]))[0])
    return totals[0], totals[1]


ROUNDOFF = 2.0**-53
"""Largest relative error of one rounded operation."""

HALF_WORD = 1 << 31
"""Divisor that splits an integer price into quotient and remainder. Each is summed separately,
because sums of whole prices could overflow."""

TERMS_TOGETHER = 64
"""Number of terms of a cost in one group. Terms of a group are added with rounding. The sums of the
groups are then added exactly."""

LARGEST_PRICE = 1e100
"""Largest price that a proof uses; larger prices count as 0."""


def certify(
    states: States, solution: Solution, *, consume: bool = False
) -> tuple[Bounds, Ints, Breakdown]:
    """Prove ``sum A + sum B - Z(v) <= optimum <= cost of W`` from proposed weights W and prices v.

    A and B are the prices of unassigned objects and estimates. Z(v) is the sum of all prices v >=
    0, plus the value of the best path of each row with the gains G - v. Both bounds are summed in
    forms in which no digits cancel (docs/theory/certificate.md).

    Parameters
    ----------
    states : States
        The solved problem.
    solution : Solution
        Proposed weights and prices.
    consume : bool
        Whether the memory of the proposed weights may be overwritten by the assignment.

    Returns
    -------
    Bounds
        Lower and upper bound, in units of c^p.
    weights : (S,) int array
        The feasible assignment, in units of 1/ONE.
    Breakdown
        Cost of the assignment by step. The upper bound is its `total`, rounded outward.

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
        Lower bound of the cost of each block. It includes the cost of the block's objects at all
        steps, also outside the window of the block.
    Breakdown
        Cost of the assignment.
    """
    weights = feasible(states, solution.weights if consume else solution.weights.copy())
    lower = lower_bounds(states, solution.prices, solution.reduced)
    return weights, lower, break_down(states, weights)


def feasible(states: States, proposed: Floats) -> Ints:
    """Return a feasible assignment near the proposed one, (S,), in units of 1/ONE.

    The result overwrites the memory of `proposed`, if possible.
    """
    given = np.require(proposed, np.float64, ["C", "W"])
    weights = given.view(np.int64)
    for low, high in states.cuts(PART):
        part, state, _ = states.between(low, high)
        whole_weights(given[state], weights[state])
        make_feasible(part, weights[state])
    return weights


def lower_cost(problem: Problem, bound: float) -> float:
    """Return ``(L - s) / (1 + delta)``, a lower bound of exact costs.

    L, the argument `bound`, is a lower bound of the computed costs. Two errors make these differ
    from exact ones (docs/theory/certificate.md, "Rounding"):

    - All costs and switch prices have a relative error of at most delta = `cost_error`. The total
      is a sum of these with weights >= 0, so its relative error is not larger.
    - The total can be too large by s = `cost_slack`.
    """
    lower = (bound * (1 - 4 * ROUNDOFF) - problem.cost_slack) / (1 + problem.cost_error)
    return max(lower * (1 - 4 * ROUNDOFF), 0.0)


def upper_cost(problem: Problem, breakdown: Breakdown) -> float:
    """Return ``U (1 + 72 u) / (1 - delta)``, an upper bound of exact costs.

    U is the total of the breakdown, and u is `ROUNDOFF`. The factor 1 + 72 u covers rounding: 3 u
    for each term of U, 63 u for adding `TERMS_TOGETHER` = 64 terms, and 6 u for the operations in
    this function. The divisor covers the relative error of the costs, which is at most delta =
    `cost_error` (`lower_cost`).
    """
    return breakdown.total * (1 + (TERMS_TOGETHER + 8) * ROUNDOFF) / (1 - problem.cost_error)


def lower_bounds(states: States, prices: Floats, reduced: tuple[Reduced, ...] = ()) -> Floats:
    """Return a lower bound of the cost of each block, (B,), from proposed prices.

    The blocks in `reduced` were solved at one or more smaller cutoffs (`reduce_cutoff`). For such a
    block, `prices` are not used: its bound is the largest that these solutions prove.
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
    """Return lower bounds of blocks from prices v >= 0.

    For each row and step, the *best pair* has the largest gain minus price, if that is positive.
    sum_best is a sum over the best pairs of all rows and steps. Let best_i be the value of the best
    path of row i, if the gain minus price of the best pair is subtracted at each step
    (`relative_gains`). Then the bound is

        L = (sum A + sum B - sum_best (A + B)) + sum_best D - sum_i best_i - (sum v - sum_best v)

    No digits cancel: each parenthesis is an exact sum, or a difference of integers
    (docs/theory/certificate.md).

    `states` has consecutive blocks of the whole problem, from block `low` on. `objects` has the
    prices of the whole problem.
    """
    columns, problem = states.columns, states.problem
    running = columns.running(prices)
    left = np.ones(len(prices), np.int32)  # becomes 1 minus the number of best pairs in each slot
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
    """Return the terms that some rows contribute to a lower bound, for each node.

    The best pair of each row and step (`_bounds_of_prices`) is *put aside*: its cost and price are
    counted separately. For each of these pairs, `left` decreases by 1 at the column slot of the
    pair. `running` has the running sums of the prices, from `Slots.running`.

    Returns
    -------
    best : (nodes,) float array
        Upper bounds of the values of the best paths, without what is put aside.
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
    """Return the cost of the best pair of each row and step, or 0 if there is no such pair.

    For each best pair, `left` decreases by 1 at the column slot of the pair, if it has one.
    """
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
    """Return ``-sum (left v)`` over the slots of each node, rounded down.

    The prices v come from `running`; `left` is 1 minus the number of best pairs in each slot. The
    result has two summands for each node, because a single sum of integers could overflow.
    """
    if kernels:
        prices: Floats = kernels.idle_prices(*running, left, first)
        return prices
    unit, whole = running[0], np.diff(running[1])
    halves = whole & (HALF_WORD - 1), whole // HALF_WORD
    low, high = (np.diff(np.append(0, np.cumsum(half * left))[first]) for half in halves)
    return np.stack((-up(unit * low), -up(unit * HALF_WORD * high)))


def of_whole(states: States, part: Reduced, inner: Floats) -> Floats:
    """Return lower bounds of the blocks, (B,), from bounds at a smaller cutoff.

    They follow from the inequality in the docstring of this module: the bounds `inner` take the
    place of V(s C). The result is 0 for blocks that are not in `part`.
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
    """Return, for each block at a smaller cutoff, the block of the whole that contains it."""
    truth = np.empty(len(inner.block_begin), np.int64)
    truth[inner.pair_block] = inner.pair_truth
    return states.track_blocks[0][truth]


def _in_chunks(terms: Floats) -> list[float]:
    """Return the sums of groups of TERMS_TOGETHER terms."""
    sums: list[float] = np.add.reduceat(terms, np.arange(0, len(terms), TERMS_TOGETHER)).tolist()
    return sums


def break_down(states: States, weights: Ints) -> Breakdown:
    """Return the cost of a feasible assignment W by cause and step.

    The costs are ``W D`` for localisation, ``A (1 - row sums of W)`` for missed targets,
    ``B (1 - column sums of W)`` for false targets, and ``lambda |change of W|`` for switches
    (docs/theory/metric.md, "Decomposition"). Sums and differences of weights are exact.
    """
    if not kernels:
        costs, terms = _break_down(states, weights)
        return _breakdown(costs, states.problem.switch_price_at[:-1], terms)
    sizes = len(states.pair_row), *(len(side.step) for side in states.problem.sides)
    bounds = [np.array([0, size], np.int32) for size in (*sizes, states.problem.steps)]
    return next(break_down_parts(states, weights, bounds))


def break_down_parts(states: States, weights: Ints, bounds: Sequence[Ints]) -> Iterator[Breakdown]:
    """Yield the breakdown of each part of a problem, computed by the kernels.

    The parts follow each other in time. `bounds` has four arrays (parts + 1,): index of the first
    pair, first truth row, first estimate row and first step of each part. The last element of each
    array is the end of the last part.
    """
    costs, terms = kernels.break_down(states, weights, ONE, bounds)
    steps = bounds[-1].tolist()
    price = states.problem.switch_price_at[:-1]
    for own, low, high in zip(terms, steps[:-1], steps[1:], strict=True):
        yield _breakdown(costs[:, low:high], price[low:high], own)


def _breakdown(costs: Iterable[Floats], price: Floats, terms: list[float]) -> Breakdown:
    """Return the breakdown of a part.

    `costs` has six arrays by step: localisation, missed and false cost, missed and false count, and
    the sum of all changes of weights. `price` is the price of half a switch into each step. The sum
    of `terms` is the total cost.
    """
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
    """Return `costs` and `terms` for `_breakdown`, computed without kernels."""
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
"""Largest switch price at a smaller cutoff, which replaces higher prices. This does not change the
optimum."""


def reduce_cutoff(states: States, blocks: Mask, scale: float) -> States:
    """Return some blocks as a separate problem at a smaller cutoff.

    Its costs are in units of ``scale c^p``, where `scale` < 1 is a power of 2. Rows and
    trajectories keep their indices. All true objects must have the same price A, and all estimates
    the same price B (`Problem.object_prices`).
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
    """Return ``sum_k (A (m_k - nu_k) + B (n_k - nu_k))`` for each block in the mask, (B,).

    The docstring of this module explains the letters. The result is in units of c^p, and 0 for
    blocks outside the mask. nu_k is the size of the vertex cover of the near pairs of step k: a
    smallest one has as many rows as a largest matching has pairs (König's theorem). With a larger
    cover, the result would be smaller, and still a valid lower bound.
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
        if not float(2 * first).is_integer():  # the product may be rounded
            forced = np.maximum(down(forced), 0.0)
    else:
        free = (np.maximum(of - covered, 0) for of in objects)
        forced = down(first * next(free)) + down(second * next(free))
        forced = np.maximum(down(forced), 0.0)
    return np.where(blocks, forced, 0.0)


def vertex_cover(states: States, blocks: Mask) -> tuple[Mask, Mask]:
    """Return a smallest vertex cover of the near pairs of some blocks.

    A vertex cover is a set of rows of the truth and of the estimate that has at least one of the
    two rows of each near pair. The result is a mask of the truth and a mask of the estimate. It
    comes from a largest *matching*: a set of near pairs without a common row. If a check shows that
    a near pair is not covered, all rows are returned instead.
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
    # Follow alternating paths from all unmatched truth rows: along any pair to an estimate row, and
    # along a matched pair back to a truth row.
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
