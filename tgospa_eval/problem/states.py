"""The reduced problem: what can be assigned, from when to when, and what competes for it.

A *state* is a pair of trajectories over a stretch of steps on which its assignment can be taken
constant: one step with a gain, or a maximal run of steps without (docs/theory/reductions.md, "Run
merging"). Their number grows with the gains, not with pairs x steps. Blocks (connected components
of the pair graph, each in its own window of time) share nothing and are contiguous in every array.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated, places_of
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.slots import Slots, make_slots

SMALL = 1 << 16
"""States of a problem that keeps its `rows`, whoever asked for them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """All states of a problem, with the graph that joins them.

    Nodes are trajectories that have a pair, numbered block by block. One side of a block is its
    rows (one path each), the other its columns (priced); rows are the truths unless the block has
    a single estimate and several truths.

    Parameters
    ----------
    problem : Problem
        What was reduced.
    pair_row, pair_column, pair_block : (P,) int arrays
        Row node, column node and block of each pair.
    pair_first : (P + 1,) int array
        First state of each pair; its states follow in time.
    pair_truth, pair_estimate : (P,) int arrays
        Tracks.
    begin : (S,) int array
        First step of each state.
    entry : (S,) int array
        Entry of the problem that a gain comes from, -1 for a run without gain.
    columns : Slots
        Constraints of the columns; `rows` are made when they are asked for.
    node_block : (nodes,) int array
        Block of each node.
    block_begin, block_end : (B,) int arrays
        Window of each block, inclusive.
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
        """First state of each block, and the end, (B + 1,)."""
        blocks = np.arange(len(self.block_begin) + 1)
        return self.pair_first[np.searchsorted(self.pair_block, blocks)]

    def pairs_of(self, chosen: Ints) -> Ints:
        """Pairs of some states."""
        return np.searchsorted(self.pair_first, chosen, side="right") - 1

    def states_of(self, blocks: Mask) -> Mask:
        """Whether the block of each state is one of these, (S,)."""
        return np.repeat(blocks[self.pair_block], np.diff(self.pair_first))

    @property
    def pair_tracks(self) -> tuple[Ints, Ints]:
        """Truth and estimate of each pair."""
        return self.pair_truth, self.pair_estimate

    def slots_of(self, blocks: Mask) -> Mask:
        """Whether the block of each column slot is one of these, (K,)."""
        return np.repeat(blocks[self.node_block], np.diff(self.columns.first))

    @cached_property
    def track_blocks(self) -> tuple[Ints, Ints]:
        """Block of each truth, and of each estimate, -1 for those without a near pair."""
        sizes = self.problem.truths, self.problem.estimates
        blocks = np.full(sizes[0], -1, np.int64), np.full(sizes[1], -1, np.int64)
        for block, track in zip(blocks, self.pair_tracks, strict=True):
            block[track] = self.pair_block
        return blocks

    @cached_property
    def rows(self) -> Slots:
        """Constraints of the rows."""
        return make_slots(
            self.begin, self.pair_first, self.pair_row, self.nodes, self.problem.steps
        )

    @property
    def gain(self) -> Floats:
        """Gain of each state, 0 for a run, (S,)."""
        return self.gains(slice(None))

    def gains(self, chosen: Ints | slice) -> Floats:
        """The gain of some states."""
        entry = self.entry[chosen]
        gain = np.zeros(len(entry))
        gains = places_of(entry >= 0)
        gain[gains] = self.problem.gains(entry[gains])
        return gain

    def of_pairs(self, pairs: slice | Ints) -> tuple["States", slice | Ints]:
        """Some pairs, of whole rows, and which states they are; of a slice copies little.

        Nodes, blocks and column slots keep their numbers.
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
        """Ranges of blocks, for `between`, each but the last with at least `size` states."""
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
        """The blocks from `low` to before `high` as a problem of their own; copies little.

        Its `rows` live as long as it does: the whole does not keep them, unless it is small.

        Returns
        -------
        states : States
            On the same `problem`.
        state, slot : slice
            Where its states and its column slots are here.
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
    """Smallest node of the component of each node, of a graph with the edges (a, b)."""
    if kernels:
        found: Ints = kernels.components(
            a.astype(np.int32, copy=False), b.astype(np.int32, copy=False), nodes
        )
        return found
    from scipy.sparse import coo_array  # lazy: importing it takes longer than most evaluations
    from scipy.sparse.csgraph import connected_components as labelled

    _, label = labelled(coo_array((np.ones(len(a), bool), (a, b)), shape=(nodes, nodes)), False)
    smallest: Ints = np.unique(label, return_index=True)[1]
    return smallest[label]
