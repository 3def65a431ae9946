"""The reduced problem: what can be assigned, from when to when, and what competes for it.

A *state* is a pair of trajectories over a stretch of steps on which its assignment can be taken
constant: one step with a gain, or a maximal run of steps without (docs/theory, "Run merging").
Their number grows with the gains, not with pairs x steps. Blocks (connected components of the pair
graph, each in its own window of time) share nothing and are contiguous in every array.

A *slot* is a stretch of steps of one node (a trajectory) on which the states that compete for it
do not change; the assignment over a slot may sum to at most 1.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.compiled import kernels
from tgospa_eval.errors import check_size
from tgospa_eval.problem import Floats, Ints, Problem, sum_parts

PART = 1 << 19
"""States that are looked at together where arrays as long as all states would be too much."""


CACHE = 1 << 16
"""States whose slots are made together: what is written in no order stays in the cache."""


def parts(size: int) -> Iterator[slice]:
    """Slices of PART elements each that cover `size`."""
    return (slice(low, min(low + PART, size)) for low in range(0, size, PART))


def divided(group: Ints, pair_first: Ints, size: int) -> list[int]:
    """Pairs at which to divide so that no group is, in parts of some `size` states; first and end.

    `group` (P,) is that of each pair: its row or its block; those of one group are neighbours.
    """
    if 0 < pair_first[-1] <= size:
        return [0, len(group)]
    opens = np.flatnonzero(np.diff(group, prepend=-1))  # first pair of each group
    part = pair_first[opens] // size
    return [*opens[np.diff(part, prepend=-1) > 0].tolist(), len(group)]


def changed(pair_first: Ints, weight: Ints) -> NDArray[np.bool_]:
    """Whether the weight of each state differs from that of the state before of its pair."""
    differs = np.zeros(len(weight), bool)
    np.not_equal(weight[1:], weight[:-1], out=differs[1:])
    differs[pair_first[:-1]] = False
    return differs


@dataclass(frozen=True, kw_only=True)
class Slots:
    """The capacity constraints on one side, rows or columns.

    Nodes with one pair have none: the bound of the other side implies it. A state covers the slots
    from its own first to the one before the first of the next state of its pair.

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
        """The slot after the last of each state, (S,)."""
        end = np.empty_like(self.begin)
        end[:-1] = self.begin[1:]
        end[self.pair_first[1:] - 1] = self.first[self.pair_node + 1]
        return end

    def sums(self, weight: Ints) -> Ints:
        """Exact sum of the integer weights (S,) of the states over each slot, (K,)."""
        change = np.zeros(len(self.step) + 1, np.int64)
        # All pairs of a node open at its first slot and close after its last.
        for state, slot, sign in (
            (self.pair_first[:-1], self.first[self.pair_node], 1),
            (self.pair_first[1:] - 1, self.first[self.pair_node + 1], -1),
        ):
            used = np.flatnonzero(weight[state] != 0)
            np.add.at(change, slot[used].astype(np.intp), sign * weight[state[used]])
        differs = changed(self.pair_first, weight)
        for part in parts(len(weight)):
            state = np.flatnonzero(differs[part]) + part.start
            rise = weight[state] - weight[state - 1]
            np.add.at(change, self.begin[state].astype(np.intp), rise)
        return np.cumsum(change[:-1], out=change[:-1])

    def running(self, price: Floats) -> tuple[Floats, Ints]:
        """The unit in which each node's prices are counted, and running sums of all, (K + 1,).

        Prices become integers for it, of as many bits as the sum of their node allows: differences
        of running sums are exact then, even where the sum over all nodes overflows, and a small sum
        never loses its digits to large prices far away.
        """
        size = sum_parts(np.abs(price), self.first)
        unit = np.ldexp(1.0, np.frexp(np.maximum(size, 1e-270))[1] - 62)
        running = np.zeros(len(price) + 1, np.int64)
        for part in parts(len(price)):
            first = np.minimum(np.maximum(self.first, part.start), part.stop)
            count = first[1:] - first[:-1]
            running[1:][part] = np.rint(price[part] / np.repeat(unit, count))
        return unit, np.cumsum(running, out=running)

    def totals(self, price: Floats, chosen: Ints | None = None) -> Floats:
        """Sum of the prices (K,) over the slots of each state, or of the chosen ones."""
        return self.spans(self.running(price), chosen)

    def spans(self, running: tuple[Floats, Ints], chosen: Ints | None = None) -> Floats:
        """`totals` where the running sums are known."""
        unit, sums = running
        begin, end = self.begin, self.end
        total = np.repeat(unit[self.pair_node], np.diff(self.pair_first))
        if chosen is not None:
            begin, end, total = begin[chosen], end[chosen], total[chosen]
        for part in parts(len(total)):
            total[part] *= sums[end[part]] - sums[begin[part]]
        return total


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
    transposed: NDArray[np.bool_]

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

    def forget(self) -> None:
        """Give up what is kept only because it is used again and again while solving."""
        vars(self).pop("rows", None)

    @cached_property
    def rows(self) -> Slots:
        """Constraints of the rows."""
        return _slots(
            self.begin,
            self.pair_first,
            self.pair_row,
            self.nodes,
            self.problem.steps,
            group=self.pair_row,
        )

    @property
    def gain(self) -> Floats:
        """Gain of each state, 0 for a run, (S,)."""
        return self.gains(slice(None))

    def gains(self, chosen: Ints | slice) -> Floats:
        """The gain of some states."""
        entry = self.entry[chosen]
        gain = np.zeros(len(entry))
        gains = np.flatnonzero(entry >= 0)
        gain[gains] = self.problem.gains(entry[gains])
        return gain

    def cuts(self, size: int) -> list[tuple[int, int]]:
        """Ranges of blocks, for `between`, each but the last with at least `size` states."""
        blocks = len(self.block_begin)
        first = self.pair_first[np.searchsorted(self.pair_block, np.arange(blocks + 1))]
        cuts, low = [], 0
        while low < blocks:
            high = min(int(np.searchsorted(first, first[low] + size)), blocks)
            cuts.append((low, high))
            low = high
        return cuts

    def between(self, low: int, high: int) -> tuple["States", slice, slice]:
        """The blocks from `low` to before `high` as a problem of their own; copies little.

        Returns
        -------
        states : States
            On the same `problem`.
        state, slot : slice
            Where its states and its column slots are here.
        """
        if (low, high) == (0, len(self.block_begin)):
            return self, slice(0, len(self.begin)), slice(0, len(self.columns.step))
        pairs = slice(*np.searchsorted(self.pair_block, (low, high)))
        nodes = slice(*np.searchsorted(self.node_block, (low, high)))
        state = slice(*self.pair_first[[pairs.start, pairs.stop]])
        pair_first = self.pair_first[pairs.start : pairs.stop + 1] - np.int32(state.start)
        slot = slice(*self.columns.first[[nodes.start, nodes.stop]])
        pair_column = self.pair_column[pairs] - np.int32(nodes.start)
        states = States(
            problem=self.problem,
            pair_row=self.pair_row[pairs] - np.int32(nodes.start),
            pair_column=pair_column,
            pair_block=self.pair_block[pairs] - np.int32(low),
            pair_first=pair_first,
            pair_truth=self.pair_truth[pairs],
            pair_estimate=self.pair_estimate[pairs],
            begin=self.begin[state],
            entry=self.entry[state],
            columns=Slots(
                first=self.columns.first[nodes.start : nodes.stop + 1] - np.int32(slot.start),
                step=self.columns.step[slot],
                begin=self.columns.begin[state] - np.int32(slot.start),
                pair_first=pair_first,
                pair_node=pair_column,
            ),
            node_block=self.node_block[nodes] - np.int32(low),
            block_begin=self.block_begin[low:high],
            block_end=self.block_end[low:high],
            transposed=self.transposed[low:high],
        )
        return states, state, slot


def merge_runs(problem: Problem) -> States:
    """Reduce a problem to its states.

    Valid for the LP (docs/theory): pairs that never gain are gone; components are apart; steps
    before the first and after the last gain of a component are gone; runs without gain are one
    state each, border runs included. With time-varying switch prices a run stays one state a step.

    Raises
    ------
    InputError
        There is more of something than 32-bit indices can number.
    """
    for what, count in (
        ("steps", problem.steps),
        ("trajectories", problem.truths + problem.estimates),
        ("rows of truths", len(problem.truth_step)),
        ("rows of estimates", len(problem.estimate_step)),
        ("near pairs", len(problem.cost)),
    ):
        check_size(what, count)
    pair_of, truth, estimate = _number_pairs(problem)
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
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    pair_of = rank[pair_of]
    pair_row, pair_column, pair_block = (
        part[order].astype(np.int32) for part in (row, column, block)
    )

    entry_step = problem.entry_step
    window = _windows(pair_block[pair_of], entry_step, blocks)
    runs_are_one = isinstance(problem.switch_price, float)
    pair_first, begin, entry = _split(
        pair_of, entry_step, window[0][pair_block], window[1][pair_block], single=not runs_are_one
    )
    del pair_of, entry_step  # as long as the entries
    return States(
        problem=problem,
        pair_row=pair_row,
        pair_column=pair_column,
        pair_block=pair_block,
        pair_first=pair_first,
        pair_truth=truth[order],
        pair_estimate=estimate[order],
        begin=begin,
        entry=entry,
        columns=_slots(
            begin,
            pair_first,
            pair_column,
            len(node_block),
            problem.steps,
            group=pair_block,
        ),
        node_block=node_block,
        block_begin=window[0],
        block_end=window[1],
        transposed=transposed,
    )


def _number_pairs(problem: Problem) -> tuple[Ints, Ints, Ints]:
    """Pair of each entry, in any order; truth and estimate of each pair."""
    truth = problem.truth_track[problem.truth_row].astype(np.int32, copy=False)
    estimate = problem.estimate_track[problem.estimate_row].astype(np.int32, copy=False)
    if kernels:
        found: tuple[Ints, Ints, Ints] = kernels.number_pairs(
            truth, estimate, problem.truths, problem.estimates
        )
        return found
    width = max(problem.estimates, 1)
    key, pair_of = np.unique(truth * np.int64(width) + estimate, return_inverse=True)
    truth, estimate = np.divmod(key, width)
    return pair_of, truth.astype(np.int32), estimate.astype(np.int32)


def connected_components(a: Ints, b: Ints, nodes: int) -> Ints:
    """Smallest node of the component of each node, of a graph with the edges (a, b).

    Without kernels: hooking and pointer jumping. SciPy has the same, but importing it costs more
    than most evaluations take.
    """
    if kernels:
        found: Ints = kernels.components(
            a.astype(np.int32, copy=False), b.astype(np.int32, copy=False), nodes
        )
        return found
    root: Ints = np.arange(nodes)
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
    return node_block[order].astype(np.int32), (number[row_of], number[len(row_ids) + col_of])


def _windows(block: Ints, step: Ints, blocks: int) -> Ints:
    """First and last step with a gain of each block, (2, B); `block` is that of each entry."""
    window = np.zeros((2, blocks), np.int32)
    # Entries come in order of time: the last assignment to a place wins.
    window[1][block] = step
    window[0][block[::-1]] = step[::-1]
    return window


def _split(
    pair_of: Ints, step: Ints, first: Ints, last: Ints, *, single: bool
) -> tuple[Ints, Ints, Ints]:
    """First state of every pair, begin and entry of every state, sorted by (pair, begin).

    `pair_of`, `step` are those of each entry, in order of time; `first` and `last` the window of
    each pair. With `single` a run is one state for each step.
    """
    if kernels:
        found: tuple[Ints, Ints, Ints] = kernels.split(pair_of, step, first, last, single)
        return found
    order = np.argsort(pair_of, kind="stable")
    pair, step = pair_of[order], step[order]
    opens = np.ones(len(pair), bool)
    opens[1:] = pair[1:] != pair[:-1]
    closes = np.roll(opens, -1)
    before = np.where(opens, first[pair], np.roll(step, 1) + 1)  # first step of the run before
    tail = np.flatnonzero(closes & (step < last[pair]))
    head = np.flatnonzero(before < step)
    run_pair = np.concatenate((pair[head], pair[tail]))
    run_begin = np.concatenate((before[head], step[tail] + 1))
    run_end = np.concatenate((step[head] - 1, last[pair[tail]]))
    if single:
        length = run_end.astype(np.int64) - run_begin + 1
        check_size("states", len(pair) + int(length.sum()))
        offset = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        run_pair = np.repeat(run_pair, length)
        run_begin = np.repeat(run_begin, length) + offset
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


def _in_time(begin: Ints, steps: int) -> Ints:
    """The states by (begin, number)."""
    if kernels:
        found: Ints = kernels.in_time(begin, steps)
        return found
    return np.argsort(begin, kind="stable")


def _slots(
    begin: Ints, pair_first: Ints, pair_node: Ints, nodes: int, steps: int, group: Ints
) -> Slots:
    """The slots of the nodes that several pairs share; `pair_node` is the node of each pair.

    They are made for some groups of pairs at a time: rows or blocks, which share no node, and of
    which later ones have nodes with larger numbers.
    """
    bounds = divided(group, pair_first, max(CACHE, steps))
    if len(bounds) == 2:
        first, step, slot = _slots_of_part(begin, pair_first, pair_node, nodes, steps)
        return Slots(first=first, step=step, begin=slot, pair_first=pair_first, pair_node=pair_node)
    first = np.zeros(nodes + 1, np.int32)
    slot = np.empty(len(begin), np.int32)
    made: list[Ints] = [np.zeros(0, np.int32)]
    done = 0
    for low, high in itertools.pairwise(bounds):
        own = slice(pair_first[low], pair_first[high])
        node = pair_node[low:high]
        least, size = int(node.min()), int(np.ptp(node)) + 1
        place, fresh, at = _slots_of_part(
            begin[own], pair_first[low : high + 1] - pair_first[low], node - least, size, steps
        )
        first[least + 1 : least + 1 + size] = np.diff(place)
        slot[own] = at
        slot[own] += done
        made.append(fresh)
        done += len(fresh)
    np.cumsum(first, out=first)
    return Slots(
        first=first,
        step=np.concatenate(made),
        begin=slot,
        pair_first=pair_first,
        pair_node=pair_node,
    )


def _slots_of_part(
    begin: Ints, pair_first: Ints, pair_node: Ints, nodes: int, steps: int
) -> tuple[Ints, Ints, Ints]:
    """First slot of each node, step of each slot, first slot of each state."""
    in_time = _in_time(begin, steps)
    shared = np.bincount(pair_node, minlength=nodes) > 1
    if kernels:
        found: tuple[Ints, Ints, Ints] = kernels.slots(
            in_time, begin, pair_first, pair_node, shared.view(np.uint8)
        )
        return found
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
    return first, step, slot
