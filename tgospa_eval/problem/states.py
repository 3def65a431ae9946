"""The reduced problem: states that can be assigned, and the slots for which they compete.

A *state* is a pair of trajectories over an interval of steps: one step with a gain, or a *run*. A
run is a longest possible sequence of steps without a gain. While a state lasts, the assignment of
its pair can be assumed constant (docs/theory/reductions.md, "Run merging"). Because of runs, the
number of states grows with the number of gains, not with the number of pairs times that of steps.

A *block* is a connected component of the graph of pairs, in its own window of time. No trajectory
is in two blocks. The elements of a block are next to each other in every array.

Several states of a trajectory can *compete*: their weights at a step sum to at most 1. A *slot* is
an interval of steps on which the same states of a trajectory compete. Weights are stored as
integers in units of 1/`ONE`, so that their sums are exact. `merge_runs` makes the states of a
problem.

Sizes of arrays are written with these letters: S states, P pairs, K slots, B blocks, T steps, and R
rows of the truth or of the estimate. Other letters are those of docs/theory/notation.md.
"""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated, places_of
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import check_size
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.problem import Objects, Problem, sum_parts

PART = 1 << 19
"""Approximate number of states that are processed at once, so that temporary arrays are small."""

CROWD, FULL_SUM = 4000, 1 << 61
"""Limits of sums of weights. A sum over at most CROWD pairs of a node fits into 64 bits, because a
weight is less than 2^50. If a node has more pairs, a sum above FULL_SUM is replaced by FULL_SUM."""


def exact_running(value: Floats, first: Ints, *, floor: bool = False) -> tuple[Floats, Ints]:
    """Return a unit for each part of the K values, and integer running sums of value / unit.

    Part i begins at first[i]. Its unit is 2^(e - 62), where 2^e is larger than the sum of |value|
    in the part. Each value is rounded to an integer number of units. The running sums (K + 1,) are
    sums of these integers. The difference of two of them in the same part is exact, even if the sum
    over all parts overflows. Each part has its own unit, so that small values keep their digits if
    another part has large values. With `floor`, no value is rounded up (docs/theory/certificate.md,
    "Rounding").
    """
    size = sum_parts(np.abs(value), first)
    unit = np.ldexp(1.0, np.frexp(np.maximum(size, 1e-270))[1] - 62)
    if kernels:
        sums: Ints = kernels.whole_sums(value, first, unit, floor)
        return unit, sums
    rounded = np.floor if floor else np.rint
    whole = rounded(value / np.repeat(unit, np.diff(first))).astype(np.int64)
    return unit, np.concatenate(([0], np.cumsum(whole)))


def changed(pair_first: Ints, weight: Ints | Floats) -> Mask:
    """Return a mask of the states at which the weight of their pair changes.

    The weight of a state is compared with that of the state before it in the same pair. The first
    state of a pair is never marked.
    """
    differs = np.zeros(len(weight), bool)
    np.not_equal(weight[1:], weight[:-1], out=differs[1:])
    differs[pair_first[:-1]] = False
    return differs


@dataclass(frozen=True, kw_only=True, eq=False)
class Slots:
    """Slots of the rows or of the columns: in each slot, weights sum to at most 1.

    A node with one pair has no slots: its constraint would only say that each weight is at most 1.
    A state covers all slots from its first slot on, up to the slot before the one at which the next
    state of its pair begins.

    Parameters
    ----------
    first : (nodes + 1,) int array
        First slot of each node; its slots follow in time.
    step : (K,) int array
        First step of each slot.
    begin : (S,) int array
        First slot of each state.
    pair_first, pair_node : (P + 1,), (P,) int arrays
        First state and node of each pair.
    """

    first: Ints
    step: Ints
    begin: Ints
    pair_first: Ints
    pair_node: Ints

    @property
    def node(self) -> Ints:
        """Node of each slot, (K,)."""
        return np.repeat(np.arange(len(self.first) - 1, dtype=np.int32), np.diff(self.first))

    @property
    def end(self) -> Ints:
        """Index of the last slot of each state, plus 1, (S,)."""
        end = np.empty_like(self.begin)
        end[:-1] = self.begin[1:]
        end[self.pair_first[1:] - 1] = self.first[self.pair_node + 1]
        return end

    def touching(self, marked: Mask, chosen: Ints | None = None) -> Mask:
        """Return a mask of the states that cover at least one slot marked in `marked` (K,).

        If `chosen` has indices of states, the mask has an element for each of these states only.
        """
        before = np.zeros(len(marked) + 1, np.int32)
        np.cumsum(marked, out=before[1:])
        begin, end = self.begin, self.end
        if chosen is not None:
            begin, end = begin[chosen], end[chosen]
        touching: Mask = before[end] > before[begin]
        return touching

    def sums(self, weight: Ints) -> Ints:
        """Return the exact sum of the integer weights (S,) of the states in each slot, (K,).

        Weights are >= 0. If a node has so many pairs that integers could overflow, sums above
        FULL_SUM are replaced by FULL_SUM.
        """
        if len(self.pair_node) > CROWD and int(np.bincount(self.pair_node).max()) > CROWD:
            sums = self._sums(weight)
            coarse = self._sums(weight >> 20)
            return np.where(coarse >= FULL_SUM >> 20, FULL_SUM, sums)
        return self._sums(weight)

    def _sums(self, weight: Ints) -> Ints:
        if kernels:
            sums: Ints = kernels.slot_sums(
                self.first, self.begin, self.pair_first, self.pair_node, weight
            )
            return sums
        return self._accumulate(weight)

    def loads(self, weight: Floats | Mask) -> Floats:
        """Return the sum of the weights of the states in each slot, (K,), in floating point.

        If `weight` is a mask of states, this is the number of its states in each slot.
        """
        weight = weight.astype(np.float64, copy=False)
        if kernels:
            sums: Floats = kernels.slot_loads(
                self.first, self.begin, self.pair_first, self.pair_node, weight
            )
            return sums
        return self._accumulate(weight)

    def _accumulate(self, weight: NDArray[Any]) -> NDArray[Any]:
        """Compute `sums` and `loads` without kernels."""
        total = np.zeros(len(self.step) + 1, weight.dtype)
        used = np.flatnonzero(weight)
        np.add.at(total, self.begin[used], weight[used])
        np.subtract.at(total, self.end[used], weight[used])
        return np.cumsum(total, out=total)[:-1]

    def running(self, price: Floats, *, floor: bool = False) -> tuple[Floats, Ints]:
        """Return `exact_running` of the prices (K,) of all slots. Each node is one part."""
        return exact_running(price, self.first, floor=floor)

    def totals(self, price: Floats, chosen: Ints | None = None, *, floor: bool = False) -> Floats:
        """Return, for each state or each chosen state, the sum of the prices (K,) of its slots."""
        return self.spans(self.running(price, floor=floor), chosen, floor=floor)

    def spans(
        self, running: tuple[Floats, Ints], chosen: Ints | None = None, *, floor: bool = False
    ) -> Floats:
        """Return `totals` from the result of `running`; with `floor`, no sum is rounded up."""
        unit, sums = running
        if kernels:
            total: Floats = kernels.spans(
                self.first, self.begin, self.pair_first, self.pair_node, unit, sums, floor
            )
            return total if chosen is None else total[chosen]
        begin, end = self.begin, self.end
        total = np.repeat(unit[self.pair_node], np.diff(self.pair_first))
        if chosen is not None:
            begin, end, total = begin[chosen], end[chosen], total[chosen]
        total *= sums[end] - sums[begin]
        return np.nextafter(total, 0.0) if floor else total


def make_slots(begin: Ints, pair_first: Ints, pair_node: Ints, nodes: int, steps: int) -> Slots:
    """Return the slots of all nodes that have several pairs.

    `begin` is the first step of each state, and `pair_node` the node of each pair.
    """
    shared = np.bincount(pair_node, minlength=nodes) > 1
    if kernels:
        first, step, slot = kernels.slots(
            kernels.in_time(begin, steps), begin, pair_first, pair_node, shared.view(np.uint8)
        )
        return Slots(first=first, step=step, begin=slot, pair_first=pair_first, pair_node=pair_node)
    in_time = np.argsort(begin, kind="stable")
    node = np.repeat(pair_node, np.diff(pair_first))[in_time]
    known = shared[node]
    order = np.flatnonzero(known)[np.argsort(node[known], kind="stable")]
    chosen, node = in_time[order], node[order]
    fresh = np.ones(len(order), bool)
    fresh[1:] = (np.diff(node) != 0) | (np.diff(begin[chosen]) != 0)
    step = begin[chosen[fresh]]
    first = np.searchsorted(node[fresh], np.arange(nodes + 1)).astype(np.int32)
    slot = np.repeat(first[pair_node], np.diff(pair_first))
    slot[chosen] = np.cumsum(fresh) - 1
    return Slots(first=first, step=step, begin=slot, pair_first=pair_first, pair_node=pair_node)


SMALL = 1 << 16
"""Largest number of states of an object that `States.between` does not copy if it is called for all
blocks."""


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """All states of a problem, and the graph of its pairs.

    Nodes are trajectories that have a pair. They are numbered block by block. Each node is a row,
    which follows one path, or a column, which has prices. In most blocks, the rows are the true
    objects. In a block with a single estimate and several true objects, the estimate is the row,
    except with `transpose=False` in `merge_runs`.

    Parameters
    ----------
    problem : Problem
        The problem that was reduced.
    pair_row, pair_column, pair_block : (P,) int arrays
        Row node, column node and block of each pair.
    pair_first : (P + 1,) int array
        First state of each pair; its states follow in time.
    pair_truth, pair_estimate : (P,) int arrays
        Index of the true object and of the estimate of each pair.
    begin : (S,) int array
        First step of each state.
    entry : (S,) int array
        Entry of the problem that has the gain of the state; -1 for a run without gain.
    columns : Slots
        Slots of the columns. The slots of the rows are the property `rows`, which is computed at
        its first use.
    node_block : (nodes,) int array
        Block of each node.
    block_begin, block_end : (B,) int arrays
        First and last step of the window of each block, inclusive.
    transposed : (B,) bool array
        True where the rows are estimates.
    """

    problem: Problem
    pair_row: Ints
    pair_column: Ints
    pair_block: Ints
    pair_first: Ints
    pair_truth: Ints
    pair_estimate: Ints
    begin: Ints
    entry: Ints
    columns: Slots
    node_block: Ints
    block_begin: Ints
    block_end: Ints
    transposed: Mask

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self.node_block)

    @property
    def pair(self) -> Ints:
        """Pair of each state, (S,)."""
        return np.repeat(np.arange(len(self.pair_row), dtype=np.int32), np.diff(self.pair_first))

    @property
    def end(self) -> Ints:
        """Last step of each state, inclusive, (S,)."""
        end = np.empty_like(self.begin)
        end[:-1] = self.begin[1:] - 1
        end[self.pair_first[1:] - 1] = self.block_end[self.pair_block]
        return end

    @property
    def block(self) -> Ints:
        """Block of each state, (S,)."""
        return np.repeat(self.pair_block, np.diff(self.pair_first))

    @property
    def block_first(self) -> Ints:
        """First state of each block, and the end of the last block, (B + 1,)."""
        blocks = np.arange(len(self.block_begin) + 1)
        return self.pair_first[np.searchsorted(self.pair_block, blocks)]

    def pairs_of(self, chosen: Ints) -> Ints:
        """Return the pairs of some states."""
        return np.searchsorted(self.pair_first, chosen, side="right") - 1

    def states_of(self, blocks: Mask) -> Mask:
        """Return a mask of the states in these blocks, (S,)."""
        return np.repeat(blocks[self.pair_block], np.diff(self.pair_first))

    @property
    def pair_tracks(self) -> tuple[Ints, Ints]:
        """True object and estimate of each pair."""
        return self.pair_truth, self.pair_estimate

    def slots_of(self, blocks: Mask) -> Mask:
        """Return a mask of the column slots in these blocks, (K,)."""
        return np.repeat(blocks[self.node_block], np.diff(self.columns.first))

    @cached_property
    def track_blocks(self) -> tuple[Ints, Ints]:
        """Block of each true object, and of each estimate; -1 for those without a near pair."""
        sizes = self.problem.truths, self.problem.estimates
        blocks = np.full(sizes[0], -1, np.int64), np.full(sizes[1], -1, np.int64)
        for block, track in zip(blocks, self.pair_tracks, strict=True):
            block[track] = self.pair_block
        return blocks

    @cached_property
    def rows(self) -> Slots:
        """Slots of the rows."""
        return make_slots(
            self.begin, self.pair_first, self.pair_row, self.nodes, self.problem.steps
        )

    @property
    def gain(self) -> Floats:
        """Gain of each state, 0 for a run, (S,)."""
        return self.gains(slice(None))

    def gains(self, chosen: Ints | slice) -> Floats:
        """Return the gain of some states."""
        entry = self.entry[chosen]
        gain = np.zeros(len(entry))
        gains = places_of(entry >= 0)
        gain[gains] = self.problem.gains(entry[gains])
        return gain

    def of_pairs(self, pairs: slice | Ints) -> tuple["States", slice | Ints]:
        """Return the states of some pairs as a new object, and their indices in this object.

        If one pair of a row is chosen, all pairs of the row must be chosen. Nodes, blocks and
        column slots keep their numbers. If `pairs` is a slice, the new object shares most of its
        memory with this object.
        """
        own: slice | Ints
        if isinstance(pairs, slice):
            own = slice(*self.pair_first[[pairs.start, pairs.stop]].tolist())
            first = self.pair_first[pairs.start : pairs.stop + 1] - np.int32(own.start)
        else:
            size = np.diff(self.pair_first)[pairs]
            first = np.concatenate(([0], np.cumsum(size))).astype(np.int32)
            own = concatenated(self.pair_first[pairs], size)
        column, slots = self.pair_column[pairs], self.columns
        part = replace(
            self,
            pair_row=self.pair_row[pairs],
            pair_column=column,
            pair_block=self.pair_block[pairs],
            pair_first=first,
            pair_truth=self.pair_truth[pairs],
            pair_estimate=self.pair_estimate[pairs],
            begin=self.begin[own],
            entry=self.entry[own],
            columns=replace(slots, begin=slots.begin[own], pair_first=first, pair_node=column),
        )
        return part, own

    def cuts(self, size: int) -> list[tuple[int, int]]:
        """Divide the blocks into ranges for `between`, and return these as pairs (low, high).

        Each range except the last has at least `size` states.
        """
        blocks = len(self.block_begin)
        if 0 < len(self.begin) <= size:
            return [(0, blocks)]
        first = self.block_first
        cuts, low = [], 0
        while low < blocks:
            high = min(int(np.searchsorted(first, first[low] + size)), blocks)
            cuts.append((low, high))
            low = high
        return cuts

    def between(self, low: int, high: int) -> tuple["States", slice, slice]:
        """Return the blocks from `low` to before `high` as a new object.

        The new object shares most of its memory with this object. It computes its own property
        `rows`, which is freed together with it. If the range has all blocks, and there are at most
        SMALL states, the result is this object itself.

        Returns
        -------
        states : States
            States of the same `problem`.
        state, slot : slice
            Indices of its states and of its column slots in this object.
        """
        if (low, high) == (0, len(self.block_begin)):
            whole = self if len(self.begin) <= SMALL else replace(self)
            return whole, slice(0, len(self.begin)), slice(0, len(self.columns.step))
        pairs = slice(*np.searchsorted(self.pair_block, (low, high)))
        nodes = slice(*np.searchsorted(self.node_block, (low, high)))
        slot = slice(*self.columns.first[[nodes.start, nodes.stop]])
        part, _ = self.of_pairs(pairs)
        state = slice(*self.pair_first[[pairs.start, pairs.stop]])
        column = part.pair_column - np.int32(nodes.start)
        states = replace(
            part,
            pair_row=part.pair_row - np.int32(nodes.start),
            pair_column=column,
            pair_block=part.pair_block - np.int32(low),
            columns=replace(
                part.columns,
                first=self.columns.first[nodes.start : nodes.stop + 1] - np.int32(slot.start),
                step=self.columns.step[slot],
                begin=part.columns.begin - np.int32(slot.start),
                pair_node=column,
            ),
            node_block=self.node_block[nodes] - np.int32(low),
            block_begin=self.block_begin[low:high],
            block_end=self.block_end[low:high],
            transposed=self.transposed[low:high],
        )
        return states, state, slot


def connected_components(a: Ints, b: Ints, nodes: int) -> Ints:
    """Return, for each node, the smallest node of its component in the graph with edges (a, b)."""
    if kernels:
        first: Ints = kernels.components(
            a.astype(np.int32, copy=False), b.astype(np.int32, copy=False), nodes
        )
        return first
    from scipy.sparse import coo_array  # lazy: importing it takes longer than most evaluations
    from scipy.sparse.csgraph import connected_components as labelled

    _, label = labelled(coo_array((np.ones(len(a), bool), (a, b)), shape=(nodes, nodes)), False)
    smallest: Ints = np.unique(label, return_index=True)[1]
    return smallest[label]


ONE = 2**16 * 3**6 * 5**3 * 7**2 * 11 * 13 * 17
"""Integer that means the weight 1. It is divisible by 2, 3, ..., 18, so that multiples of 1/2, 1/3,
..., 1/18 are exact weights. It is less than 2^50, so that sums of some thousand weights fit into 64
bits, and a double represents each weight exactly (docs/theory/certificate.md, "Repair")."""

STATES_A_STEP = 32
"""Smallest mean number of states per step in a part (see `row_parts`). With fewer states per step,
calling functions for each step takes longer than their work."""

SNAP_WHOLE = ONE * 1e-9
"""Snapping distance of weights, in units of 1/ONE. A weight nearer to 0 or 1 than this is set to 0
or 1."""


def repair(states: States, weights: Floats) -> Ints:
    """Return a feasible assignment near the given weights (S,), in units of 1/ONE.

    Weights are clipped to the range from 0 to 1, and set to 0 or 1 if they are very near. Then they
    are scaled down in slots whose sum is too large.
    """
    whole = np.empty(len(weights), np.int64)
    whole_weights(weights, whole)
    make_feasible(states, whole)
    return whole


def whole_weights(weights: Floats, whole: Ints) -> None:
    """Write weights to `whole`, in units of 1/ONE.

    Weights are clipped to the range from 0 to 1, and set to 0 or 1 if they are very near. The two
    arrays are allowed to share their memory.
    """
    fixed = np.fmin(np.fmax(weights, 0.0), 1.0)  # NaN becomes 0
    fixed *= ONE
    fixed[fixed < SNAP_WHOLE] = 0
    fixed[fixed > ONE - SNAP_WHOLE] = ONE
    whole[:] = np.rint(fixed)


def make_feasible(states: States, weights: Ints) -> Ints:
    """Scale down the weights in slots with a sum above ONE, in place.

    Return the new sums of the column slots, (K,).
    """
    for part, own in row_parts(states):
        _fit(part.rows, weights[own])
    return _fit(states.columns, weights)


def _fit(slots: Slots, weights: Ints) -> Ints:
    """Scale down the weights in slots with a sum above ONE, in place; return the new sums.

    Each weight is divided by the largest sum of the slots that its state covers. This is repeated
    until no sum is above ONE. Weights are in units of 1/ONE.
    """
    sums = slots.sums(weights)
    while sums.max(initial=0) > ONE:
        _scale(slots, weights, sums)
        sums = slots.sums(weights)
    return sums


def _scale(slots: Slots, weights: Ints, sums: Ints) -> None:
    full = np.zeros(len(sums) + 1, np.int32)  # number of earlier slots with a sum above ONE
    np.cumsum(sums > ONE, out=full[1:])
    sums = np.append(sums, 0)
    begin, end = slots.begin, slots.end
    over = np.flatnonzero((full[end] > full[begin]) & (weights > 0))
    over = over[np.argsort(begin[over], kind="stable")]
    bounds = np.stack((begin[over], end[over]), axis=1).ravel()
    fullest = np.maximum.reduceat(sums, bounds)[::2]
    # The factor is reduced by more than the rounding error of the product.
    factor = ONE / fullest * (1 - 2.0**-48)
    weights[over] = np.floor(weights[over] * factor)


def row_parts(states: States) -> Iterator[tuple[States, slice | Ints]]:
    """Yield parts of the states, and the indices of the states of each part.

    A part has about PART states. A row is never divided between parts. At given prices, rows do not
    depend on each other, so parts can be processed one by one. Nodes and column slots keep their
    numbers. If blocks have many steps, parts are larger, because every step of a part takes some
    time, even with few states.
    """
    size = max(PART, STATES_A_STEP * int((states.block_end - states.block_begin).max(initial=0)))
    if 0 < len(states.begin) <= size:
        yield states, slice(None)
        return
    opens = np.flatnonzero(np.diff(states.pair_row, prepend=-1))  # first pair of each row
    part = states.pair_first[opens] // size
    bounds = [*opens[np.diff(part, prepend=-1) > 0].tolist(), len(states.pair_row)]
    yield from map(states.of_pairs, itertools.starmap(slice, itertools.pairwise(bounds)))


def assigned(states: States, weights: Ints) -> tuple[Ints, Ints, Ints]:
    """Return the states that have a gain and a positive weight, their entries and their weights."""
    used = np.flatnonzero((states.entry >= 0) & (weights > 0))
    return used, states.entry[used], weights[used]


def changes(states: States, weights: Ints) -> tuple[Ints, Floats]:
    """Return the states at which the weight of their pair changes, and the size of each change.

    A change is the absolute difference from the weight of the state before in the same pair,
    divided by ONE.
    """
    moved = np.flatnonzero(changed(states.pair_first, weights))
    return moved, np.abs(weights[moved] - weights[moved - 1]) / ONE


def spare(side: Objects, entry: Ints, weight: Ints) -> Ints:
    """Return the unassigned weight of each row of the truth or of the estimate, (R,).

    It is in units of 1/ONE. It is 0 for ignored and excused rows. `entry` has the assigned entries,
    and `weight` their weights.
    """
    free = np.full(len(side.step), ONE)
    np.subtract.at(free, side.row[entry], weight)
    if side.unjudged is not None:
        free[side.unjudged] = 0
    return free


def merge_runs(problem: Problem, *, transpose: bool = True) -> States:
    """Reduce a problem to its states, with the same optimum (docs/theory/reductions.md).

    Pairs that never gain are left out, and each component becomes a block. The window of a block
    begins at its first gain and ends at its last gain; other steps are left out. Each pair of the
    block has states for the whole window, also before its own first gain and after its own last
    gain. A run of steps without gain is one state. Exception: if switch prices differ between
    steps, each step of a run is one state.

    Parameters
    ----------
    problem : Problem
        The problem to reduce.
    transpose : bool
        If True, the estimate is the row in a block with one estimate and several true objects. If
        False, all rows are true objects.

    Raises
    ------
    InputError
        The number of steps, trajectories, rows or near pairs exceeds 32-bit indices.
    """
    for what, count in (
        ("steps", problem.steps),
        ("trajectories", problem.truths + problem.estimates),
        ("rows of truths", len(problem.truth_step)),
        ("rows of estimates", len(problem.estimate_step)),
        ("near pairs", len(problem.cost)),
    ):
        check_size(what, count)
    entry_step = problem.entry_step
    pair_of, graph = _pair_graph(problem, entry_step, transpose)
    pair_first, begin, entry = split_pairs(
        pair_of,
        entry_step,
        *(graph[end][graph["pair_block"]] for end in ("block_begin", "block_end")),
        single=not isinstance(problem.switch_price, float),
    )
    del pair_of, entry_step  # frees memory: both are as long as the entries
    columns = make_slots(
        begin, pair_first, graph["pair_column"], len(graph["node_block"]), problem.steps
    )
    return States(
        problem=problem, pair_first=pair_first, begin=begin, entry=entry, columns=columns, **graph
    )


GRAPH = (
    *("pair_row", "pair_column", "pair_block", "pair_truth", "pair_estimate"),
    *("node_block", "block_begin", "block_end", "transposed"),
)
"""Names of the fields of `States` that describe pairs and blocks, and do not depend on runs. Pairs
are sorted by (row, column)."""


def _pair_graph(problem: Problem, entry_step: Ints, transpose: bool) -> tuple[Ints, dict[str, Any]]:
    """Return the pair of each entry, and the fields `GRAPH`."""
    truth: Ints = problem.truth_track[problem.truth_row].astype(np.int32, copy=False)
    estimate: Ints = problem.estimate_track[problem.estimate_row].astype(np.int32, copy=False)
    if kernels:
        pair_of, *graph = kernels.merge_pairs(
            truth, estimate, entry_step, problem.truths, problem.estimates, transpose
        )
        return pair_of, dict(zip(GRAPH, graph, strict=True))
    width = max(problem.estimates, 1)
    key, pair_of = np.unique(truth * np.int64(width) + estimate, return_inverse=True)
    truth, estimate = (part.astype(np.int32) for part in np.divmod(key, width))
    component = connected_components(
        truth, estimate + problem.truths, problem.truths + problem.estimates
    )
    _, block = np.unique(component[truth], return_inverse=True)
    blocks = int(block.max()) + 1 if len(block) else 0

    tracks, rivals = (
        np.bincount(block[np.unique(side, return_index=True)[1]], minlength=blocks)
        for side in (truth, estimate)
    )
    transposed = (rivals == 1) & (tracks > 1) & transpose
    flip = transposed[block]
    row = np.where(flip, estimate + problem.truths, truth)
    column = np.where(flip, truth, estimate + problem.truths)
    node_block, (row, column) = _number_nodes(row, column, block)

    order = np.lexsort((column, row))
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    pair_of = rank[pair_of]
    pair_row, pair_column, pair_block = (
        part[order].astype(np.int32) for part in (row, column, block)
    )
    window = _windows(pair_block[pair_of], entry_step, blocks)
    graph = pair_row, pair_column, pair_block, truth[order], estimate[order], node_block, *window
    return pair_of, dict(zip(GRAPH, (*graph, transposed), strict=True))


def _number_nodes(row: Ints, column: Ints, block: Ints) -> tuple[Ints, tuple[Ints, Ints]]:
    """Renumber nodes block by block, rows before columns.

    Return the block of each node, and the new row and column of each pair.
    """
    row_ids, row_at, row_of = np.unique(row, return_index=True, return_inverse=True)
    col_ids, col_at, col_of = np.unique(column, return_index=True, return_inverse=True)
    node_block = np.concatenate((block[row_at], block[col_at]))
    side = np.repeat((0, 1), (len(row_ids), len(col_ids)))
    order = np.lexsort((side, node_block))
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    return node_block[order].astype(np.int32), (number[row_of], number[len(row_ids) + col_of])


def _windows(block: Ints, step: Ints, blocks: int) -> Ints:
    """Return the first and last step with a gain of each block, (2, B).

    `block` and `step` are the block and step of each entry, in order of time.
    """
    window = np.zeros((2, blocks), np.int32)
    # If an index occurs several times, NumPy keeps the value that is written last: the last step
    # of the block, or the first step if the arrays are reversed.
    window[1][block] = step
    window[0][block[::-1]] = step[::-1]
    return window


def split_pairs(
    pair_of: Ints, step: Ints, first: Ints, last: Ints, *, single: bool
) -> tuple[Ints, Ints, Ints]:
    """Split pairs into states: return the first state of each pair, and two arrays (S,).

    The two arrays are the first step and the entry of each state, sorted by (pair, first step).
    `pair_of` and `step` are the pair and step of each entry, in order of time. `first` and `last`
    are the first and last step of the window of each pair. With `single`, each step of a run
    without gain is one state.
    """
    if kernels:
        split: tuple[Ints, Ints, Ints] = kernels.split(pair_of, step, first, last, single)
        return split
    order = np.argsort(pair_of, kind="stable")
    pair, step = pair_of[order], step[order]
    opens = np.ones(len(pair), bool)
    opens[1:] = pair[1:] != pair[:-1]
    closes = np.roll(opens, -1)
    before = np.where(opens, first[pair], np.roll(step, 1) + 1)  # begin of the run before a gain
    tail = np.flatnonzero(closes & (step < last[pair]))
    head = np.flatnonzero(before < step)
    run_pair = np.concatenate((pair[head], pair[tail]))
    run_begin = np.concatenate((before[head], step[tail] + 1))
    run_end = np.concatenate((step[head] - 1, last[pair[tail]]))
    if single:
        length = run_end.astype(np.int64) - run_begin + 1
        check_size("states", len(pair) + int(length.sum()))
        run_pair = np.repeat(run_pair, length)
        run_begin = concatenated(run_begin, length)
    pair = np.concatenate((pair, run_pair))
    begin = np.concatenate((step, run_begin))
    entry = np.concatenate((order, np.full(len(run_pair), -1)))
    order = np.lexsort((begin, pair))
    pair_first = np.searchsorted(pair[order], np.arange(len(first) + 1))
    return (
        pair_first.astype(np.int32),
        begin[order].astype(np.int32),
        entry[order].astype(np.int32),
    )
