"""What pairs hold through runs without gain, once it is known how much of each gain is assigned.

A run of a pair is held with u, at most what is assigned at the gains next to it, where at each of
its steps
- the window of that step holds at least u of it, or
- nothing gains on its row and its column, from the last step of the first kind to the next.

No sum exceeds 1 then (docs/theory/windows-in-time.md, "Components larger than memory").
"""

import numpy as np

from tgospa_eval.common.arrays import Ints
from tgospa_eval.partitioned.long.tables import BUSY
from tgospa_eval.partitioned.shards import Table
from tgospa_eval.problem.states import States


def hold_runs(states: States, of_entry: Ints, holds: Table, busy: Table) -> Ints:
    """Weights of all states, (S,), of those with a gain as they are.

    Parameters
    ----------
    states : States
        Some rows; all others have the numbers of their tracks and steps.
    of_entry : (N,) int array
        What is assigned of each entry.
    holds : table of HELD
        What windows hold without gain; of a pair, no step is held twice.
    busy : table of BUSY
        When the estimates gain, by (estimate, begin), from whatever row.
    """
    weights = np.zeros(len(states.begin), np.int64)
    gains = np.flatnonzero(states.entry >= 0)
    weights[gains] = of_entry[states.entry[gains]]
    pair = states.pair
    runs, most = _ends(states, weights, pair)
    begin, end, pair = states.begin[runs].astype(np.int64), states.end[runs], pair[runs]
    used = gains[weights[gains] > 0]
    rows = np.empty(len(used), BUSY)
    rows["estimate"] = states.pair_row[states.pair[used]]
    rows["begin"] = rows["end"] = states.begin[used]
    rows.sort(order=("estimate", "begin"))

    def meets_gain(run: Ints, begin: Ints, end: Ints) -> Ints:
        """Those of the runs on whose row or column something gains from begin to end."""
        tracks = states.pair_estimate[pair[run]], states.pair_row[pair[run]]
        idle = np.ones(len(run), bool)
        for table, track in zip((busy, rows), tracks, strict=True):
            idle &= _idle(table, track, begin, end, states.problem.steps)
        return run[~idle]

    least, gaps = _held_by_windows(states, holds, runs)
    held = np.minimum(least, most)
    held[meets_gain(*gaps)] = 0
    free = np.flatnonzero(held < most)
    taken = np.isin(free, meets_gain(free, begin[free], end[free]))
    held[free] = np.where(taken, held[free], most[free])
    weights[runs] = held
    return weights


def _ends(states: States, weights: Ints, pair: Ints) -> tuple[Ints, Ints]:
    """The runs next to gains in use, and the least that is assigned at their ends."""
    runs = np.flatnonzero(states.entry < 0)
    before, after = runs - 1, np.minimum(runs + 1, len(weights) - 1)
    top = np.iinfo(np.int64).max
    first = states.pair_first[pair[runs]] == runs
    last = states.pair_first[pair[runs] + 1] - 1 == runs
    most = np.minimum(np.where(first, top, weights[before]), np.where(last, top, weights[after]))
    used = (most > 0) & (most < top)
    return runs[used], most[used]


def _held_by_windows(
    states: States, holds: Table, runs: Ints
) -> tuple[Ints, tuple[Ints, Ints, Ints]]:
    """The least that windows hold of each run at any of its steps, and the gaps between these.

    A gap is a run, counted among the chosen ones, its first step and its last.
    """
    steps = states.problem.steps
    width = max(states.problem.estimates, 1)
    pairs = states.pair_truth.astype(np.int64) * width + states.pair_estimate
    order = np.argsort(pairs, kind="stable")
    sought = holds["truth"].astype(np.int64) * width + holds["estimate"]
    at = np.minimum(np.searchsorted(pairs, sought, sorter=order), len(pairs) - 1)
    pair = order[at]
    block = states.pair_block[pair]
    begin = np.maximum(holds["begin"], states.block_begin[block]).astype(np.int64)
    end = np.minimum(holds["end"], states.block_end[block]).astype(np.int64)
    known = (pairs[pair] == sought) & (begin <= end)
    pair, begin, end = pair[known], begin[known], end[known]
    keys = states.pair.astype(np.int64) * steps + states.begin
    state = np.searchsorted(keys, pair * np.int64(steps) + begin, side="right") - 1
    run = np.minimum(np.searchsorted(runs, state), max(len(runs) - 1, 0))
    chosen = np.flatnonzero(runs[run] == state) if len(runs) else np.zeros(0, np.int64)
    run, begin, end = run[chosen], begin[chosen], end[chosen]
    least = np.full(len(runs), np.iinfo(np.int64).max)
    np.minimum.at(least, run, holds["weight"][known][chosen])

    every = np.arange(len(runs))
    whose = np.concatenate((every, run, every))
    opens = np.concatenate((states.begin[runs] - 1, begin, states.end[runs] + 1))
    closes = np.concatenate((states.begin[runs] - 1, end, states.end[runs] + 1))
    order = np.lexsort((opens, whose))
    whose, opens, closes = whose[order], opens[order], closes[order]
    gap = np.flatnonzero((whose[1:] == whose[:-1]) & (opens[1:] > closes[:-1] + 1))
    return least, (whose[gap], closes[gap] + 1, opens[gap + 1] - 1)


def _idle(busy: Table, track: Ints, begin: Ints, end: Ints, steps: int) -> np.ndarray:
    """Whether nothing of the track is busy from begin to end; the table is by (track, begin)."""
    offset = track.astype(np.int64) * steps
    whose = busy["estimate"].astype(np.int64) * steps
    begun = np.searchsorted(whose + busy["begin"], offset + end, side="right")
    ended = np.searchsorted(whose + busy["end"], offset + begin)
    idle: np.ndarray = begun == ended
    return idle
