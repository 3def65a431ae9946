"""The reduced problem: what can be assigned, from when to when, and what competes for it.

A *state* is a pair of trajectories over a stretch of steps on which its assignment can be taken
constant: one step with a gain, or a maximal run of steps without (docs/theory, "Run merging").
Their number grows with the gains, not with pairs x steps. Blocks (connected components of the pair
graph, each in its own window of time) share nothing and are contiguous in every array.

A *slot* is a stretch of steps of one node (a trajectory) on which the states that compete for it
do not change; the assignment over a slot may sum to at most 1.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.problem import Floats, Ints, Problem


@dataclass(frozen=True, kw_only=True)
class Slots:
    """The capacity constraints on one side, rows or columns.

    Nodes with one pair have none: the bound of the other side implies it.

    Parameters
    ----------
    node, step : (K,) int arrays
        Node and first step of each slot, sorted.
    begin, end : (S,) int arrays
        The slots that each state covers, half-open.
    """

    node: Ints
    step: Ints
    begin: Ints
    end: Ints

    def sums(self, weight: Ints) -> Ints:
        """Exact sum of the integer weights (S,) of the states over each slot, (K,)."""
        change = np.zeros(len(self.node) + 1, np.int64)
        np.add.at(change, self.begin, weight)
        np.subtract.at(change, self.end, weight)
        return np.cumsum(change[:-1])

    def totals(self, price: Floats) -> Floats:
        """Sum of the prices (K,) over the slots of each state, (S,)."""
        single = self.end - self.begin == 1
        total = np.zeros(len(self.begin))
        total[single] = price[self.begin[single]]
        many = np.flatnonzero(~single & (self.end > self.begin))
        if len(many):
            # Within one node, so that a small sum never loses its digits to distant large prices.
            order = many[np.argsort(self.begin[many], kind="stable")]
            bounds = np.stack((self.begin[order], self.end[order]), axis=1).ravel()
            total[order] = np.add.reduceat(np.append(price, 0.0), bounds)[::2]
        return total


@dataclass(frozen=True, kw_only=True)
class Block:
    """Where one component lies in the arrays of `States`; all ranges half-open."""

    pairs: slice
    states: slice
    rows: slice
    columns: slice
    row_slots: slice
    column_slots: slice
    window: tuple[int, int]


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
    pair, begin, end : (S,) int arrays
        Pair of each state, first and last step (inclusive).
    entry : (S,) int array
        Entry of the problem that a gain comes from, -1 for a run without gain.
    rows, columns : Slots
        Constraints of either side.
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
    pair: Ints
    begin: Ints
    end: Ints
    entry: Ints
    gain: Floats
    rows: Slots
    columns: Slots
    node_block: Ints
    block_begin: Ints
    block_end: Ints
    transposed: NDArray[np.bool_]

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self.node_block)

    def blocks(self, wanted: Ints | None = None) -> list[Block]:
        """The blocks of the given numbers, all by default."""
        count = len(self.block_begin)
        every = np.arange(count + 1)
        pairs = np.searchsorted(self.pair_block, every)
        nodes = np.searchsorted(self.node_block, every)
        # Within a block row nodes come before column nodes.
        is_column = np.zeros(self.nodes, bool)
        is_column[self.pair_column] = True
        middle = nodes[:-1] + np.bincount(self.node_block[~is_column], minlength=count)
        row_slots = np.searchsorted(self.rows.node, nodes)
        column_slots = np.searchsorted(self.columns.node, nodes)
        states = self.pair_first[pairs]
        return [
            Block(
                pairs=slice(pairs[b], pairs[b + 1]),
                states=slice(states[b], states[b + 1]),
                rows=slice(nodes[b], middle[b]),
                columns=slice(middle[b], nodes[b + 1]),
                row_slots=slice(row_slots[b], row_slots[b + 1]),
                column_slots=slice(column_slots[b], column_slots[b + 1]),
                window=(int(self.block_begin[b]), int(self.block_end[b])),
            )
            for b in (range(count) if wanted is None else wanted.tolist())
        ]


def merge_runs(problem: Problem) -> States:
    """Reduce a problem to its states.

    Valid for the LP (docs/theory): pairs that never gain are gone; components are apart; steps
    before the first and after the last gain of a component are gone; runs without gain are one
    state each, border runs included. With time-varying switch prices a run stays one state a step.
    """
    track = problem.truth_track[problem.truth_row].astype(np.int64)
    track *= problem.estimates
    track += problem.estimate_track[problem.estimate_row]
    pair_key, pair_of = np.unique(track, return_inverse=True)
    truth, estimate = np.divmod(pair_key, max(problem.estimates, 1))
    component = connected_components(
        truth, estimate + problem.truths, problem.truths + problem.estimates
    )
    _, block = np.unique(component[truth], return_inverse=True)
    blocks = int(block.max()) + 1 if len(block) else 0

    single_estimate = _distinct(block, estimate, blocks) == 1
    transposed = single_estimate & (_distinct(block, truth, blocks) > 1)
    flip = transposed[block]
    row = np.where(flip, estimate + problem.truths, truth)
    column = np.where(flip, truth, estimate + problem.truths)
    node_block, (row, column) = _number_nodes(row, column, block)

    order = np.lexsort((column, row))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    pair_of = rank[pair_of]
    row, column, block = row[order], column[order], block[order]

    entry_step = problem.entry_step
    window = np.zeros((2, blocks), np.int64)
    window[0] = problem.steps
    np.minimum.at(window[0], block[pair_of], entry_step)
    np.maximum.at(window[1], block[pair_of], entry_step)
    pair, begin, end, entry = _split(problem, pair_of, window[0][block], window[1][block])

    gain = np.zeros(len(pair))
    gain[entry >= 0] = problem.gain[entry[entry >= 0]]
    return States(
        problem=problem,
        pair_row=row,
        pair_column=column,
        pair_block=block,
        pair_first=np.searchsorted(pair, np.arange(len(pair_key) + 1)),
        pair_truth=truth[order],
        pair_estimate=estimate[order],
        pair=pair,
        begin=begin,
        end=end,
        entry=entry,
        gain=gain,
        rows=_slots(row, pair, begin, end, problem.steps, len(node_block)),
        columns=_slots(column, pair, begin, end, problem.steps, len(node_block)),
        node_block=node_block,
        block_begin=window[0],
        block_end=window[1],
        transposed=transposed,
    )


def connected_components(a: Ints, b: Ints, nodes: int) -> Ints:
    """Smallest node of the component of each node, of a graph with the edges (a, b).

    Hooking and pointer jumping. SciPy has the same, but importing it costs more than most
    evaluations take.
    """
    root = np.arange(nodes)
    while True:
        low = np.minimum(root[a], root[b])
        high = np.maximum(root[a], root[b])
        apart = low < high
        if not apart.any():
            return root
        np.minimum.at(root, high[apart], low[apart])
        while True:
            jumped = root[root]
            if np.array_equal(jumped, root):
                break
            root = jumped


def _distinct(block: Ints, node: Ints, blocks: int) -> Ints:
    """Number of distinct nodes in each block."""
    if not len(node):
        return np.zeros(blocks, np.int64)
    _, first = np.unique(node, return_index=True)
    return np.bincount(block[first], minlength=blocks)


def _number_nodes(row: Ints, column: Ints, block: Ints) -> tuple[Ints, tuple[Ints, Ints]]:
    """Number the nodes block by block, rows first; block of each node, and the renamed pairs."""
    row_ids, row_at, row_of = np.unique(row, return_index=True, return_inverse=True)
    col_ids, col_at, col_of = np.unique(column, return_index=True, return_inverse=True)
    node_block = np.concatenate((block[row_at], block[col_at]))
    side = np.repeat((0, 1), (len(row_ids), len(col_ids)))
    order = np.lexsort((side, node_block))
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    return node_block[order], (number[row_of], number[len(row_ids) + col_of])


def _split(problem: Problem, pair_of: Ints, first: Ints, last: Ints) -> tuple[Ints, ...]:
    """Pair, begin, end and entry of every state, sorted by (pair, begin).

    `pair_of` is the pair of each entry; `first` and `last` the window of each pair.
    """
    order = np.argsort(pair_of, kind="stable")
    pair, step = pair_of[order], problem.entry_step[order].astype(np.int64)
    opens = np.ones(len(pair), bool)
    opens[1:] = pair[1:] != pair[:-1]
    closes = np.roll(opens, -1)
    before = np.where(opens, first[pair], np.roll(step, 1) + 1)  # first step of the run before
    tail = np.flatnonzero(closes & (step < last[pair]))
    head = np.flatnonzero(before < step)
    run_pair = np.concatenate((pair[head], pair[tail]))
    run_begin = np.concatenate((before[head], step[tail] + 1))
    run_end = np.concatenate((step[head] - 1, last[pair[tail]]))
    if not isinstance(problem.switch_price, float):
        length = run_end - run_begin + 1
        offset = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        run_pair = np.repeat(run_pair, length)
        run_begin = run_end = np.repeat(run_begin, length) + offset
    pair = np.concatenate((pair, run_pair))
    begin = np.concatenate((step, run_begin))
    end = np.concatenate((step, run_end))
    entry = np.concatenate((order, np.full(len(run_pair), -1)))
    order = np.lexsort((begin, pair))
    return pair[order], begin[order], end[order], entry[order]


def _slots(node: Ints, pair: Ints, begin: Ints, end: Ints, steps: int, nodes: int) -> Slots:
    """The slots of the nodes that several pairs share; `node` is that of each pair."""
    shared = (np.bincount(node, minlength=nodes) > 1)[node][pair]
    of_state = node[pair[shared]]
    key = of_state * steps + begin[shared]
    slots = np.unique(key)
    slot_begin = np.zeros(len(pair), np.int64)
    slot_end = np.zeros(len(pair), np.int64)
    slot_begin[shared] = np.searchsorted(slots, key)
    slot_end[shared] = np.searchsorted(slots, of_state * steps + end[shared], side="right")
    slot_node, slot_step = np.divmod(slots, max(steps, 1))
    return Slots(node=slot_node, step=slot_step, begin=slot_begin, end=slot_end)
