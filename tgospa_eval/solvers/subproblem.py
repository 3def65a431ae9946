"""Pieces of a problem: the states of some components, and what they touch, in their span of time.

A programme on a piece costs what the piece costs, however long the recording is.
"""

import numpy as np

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.problem import Ints
from tgospa_eval.problem.slots import make_slots
from tgospa_eval.problem.states import States


@dataclass(frozen=True, kw_only=True, eq=False)
class Subproblem:
    """Part of a problem that is a problem itself, as far as its free states are concerned.

    Parameters
    ----------
    states : States
        The rows and columns that the free states touch, with all that they could be in from the
        step before the first free state to the step after the last. Column slots of other nodes
        mean nothing.
    state : (S',) int array
        Where its states are in the whole.
    free : (F,) int array
        Its free states.
    slot : (K',) int array
        Where the column slots of the free states are in the whole; of others anywhere.
    """

    states: States
    state: Ints
    free: Ints
    slot: Ints


def cut_out(states: States, free: Ints) -> Subproblem:
    """The piece of some states, which come in order."""
    pair = np.searchsorted(states.pair_first, free, side="right") - 1
    touched = np.zeros(states.nodes, bool)
    touched[states.pair_row[pair]] = touched[states.pair_column[pair]] = True
    pairs = np.flatnonzero(touched[states.pair_row] | touched[states.pair_column])
    before = int(states.begin[free].min()) - 1
    after = int(_ends(states, free, pair).max()) + 1
    home = states.pair_block[pairs]
    opens = np.maximum(before, states.block_begin[home])
    ranges = states.pair_first[pairs], states.pair_first[pairs + 1]
    low = np.maximum(_last_until(states.begin, *ranges, opens), ranges[0])
    high = np.maximum(_last_until(states.begin, *ranges, np.full(len(pairs), after)), low) + 1
    state, first = _joined(low, high)
    begin = states.begin[state]
    begin[first[:-1]] = np.maximum(begin[first[:-1]], opens)

    nodes = np.unique(np.concatenate((states.pair_row[pairs], states.pair_column[pairs])))
    blocks = np.unique(home)
    row, column, block = (
        np.searchsorted(known, what).astype(np.int32)
        for known, what in (
            (nodes, states.pair_row[pairs]),
            (nodes, states.pair_column[pairs]),
            (blocks, home),
        )
    )
    columns = make_slots(begin, first, column, len(nodes), states.problem.steps, group=block)
    piece = States(
        problem=states.problem,
        pair_row=row,
        pair_column=column,
        pair_block=block,
        pair_first=first,
        pair_truth=states.pair_truth[pairs],
        pair_estimate=states.pair_estimate[pairs],
        begin=begin,
        entry=states.entry[state],
        columns=columns,
        node_block=np.searchsorted(blocks, states.node_block[nodes]).astype(np.int32),
        block_begin=np.maximum(states.block_begin[blocks], before),
        block_end=np.minimum(states.block_end[blocks], after),
        transposed=states.transposed[blocks],
    )
    # The slots of a touched node are those of the whole from the one at `before` on.
    place = states.columns.first
    opens = np.maximum(before, states.block_begin[states.node_block[nodes]])
    base = _last_until(states.columns.step, place[nodes], place[nodes + 1], opens)
    at = concatenated(base, np.diff(columns.first))
    slot = np.clip(at, 0, max(len(states.columns.step) - 1, 0))
    return Subproblem(states=piece, state=state, free=np.searchsorted(state, free), slot=slot)


def _ends(states: States, chosen: Ints, pair: Ints) -> Ints:
    """Last step of each of the chosen states of these pairs."""
    following = np.minimum(chosen + 1, len(states.begin) - 1)
    goes_on = chosen + 1 < states.pair_first[pair + 1]
    return np.where(goes_on, states.begin[following] - 1, states.block_end[states.pair_block[pair]])


def _last_until(step: Ints, low: Ints, high: Ints, until: Ints) -> Ints:
    """The last place of each range from `low` to before `high` with a step of at most `until`.

    `low` - 1 where there is none. Steps rise in each range; all are searched by halves at once.
    """
    low, high = low.astype(np.int64), high.astype(np.int64)
    while True:
        going = np.flatnonzero(low < high)
        if not len(going):
            return low - 1
        middle = (low[going] + high[going]) // 2
        right = step[middle] <= until[going]
        low[going] = np.where(right, middle + 1, low[going])
        high[going] = np.where(right, high[going], middle)


def _joined(low: Ints, high: Ints) -> tuple[Ints, Ints]:
    """All numbers of the ranges, one range after the other, and where each range begins."""
    first = np.zeros(len(low) + 1, np.int32)
    np.cumsum(high - low, out=first[1:])
    return concatenated(low, high - low), first
