"""From a problem to its states: pairs, components, windows, runs, slots."""

from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Ints, concatenated
from tgospa_eval.errors import check_size
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.problem import Problem
from tgospa_eval.problem.slots import make_slots
from tgospa_eval.problem.states import States, connected_components


def merge_runs(problem: Problem, *, transpose: bool = True) -> States:
    """Reduce a problem to its states, with the same optimum (docs/theory/reductions.md).

    Pairs that never gain are gone; components are apart; steps before the first and after the last
    gain of a component are gone; runs without gain are one state each, border runs included. With
    time-varying switch prices a run stays one state a step.

    Parameters
    ----------
    problem : Problem
        What is reduced.
    transpose : bool
        Whether the rows of blocks with a single estimate are estimates; else rows are truths.

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
    entry_step = problem.entry_step
    pair_of, graph = _pair_graph(problem, entry_step, transpose)
    pair_first, begin, entry = split_pairs(
        pair_of,
        entry_step,
        *(graph[end][graph["pair_block"]] for end in ("block_begin", "block_end")),
        single=not isinstance(problem.switch_price, float),
    )
    del pair_of, entry_step  # as long as the entries
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
"""Fields of `States` that do not depend on runs; pairs are sorted by (row, column)."""


def _pair_graph(problem: Problem, entry_step: Ints, transpose: bool) -> tuple[Ints, dict[str, Any]]:
    """Pair of each entry, and the fields `GRAPH`."""
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


def split_pairs(
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
