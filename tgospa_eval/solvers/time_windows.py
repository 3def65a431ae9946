"""Windows in time: a long component in pieces that overlap, and their answers joined.

    core |---------|---------|---------|
         |------------|                  a window: its core, and some steps to either side
              |---------------|

Of each window the weights and prices of its core are kept. Whatever is joined bounds the optimum,
for any prices >= 0 do, and any feasible weights (docs/theory/windows-in-time.md); how well it fits
at the seams is measured afterwards, on the whole component.
"""

import itertools
import time
from dataclasses import replace

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.progress import Limit
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.slots import Slots
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE, repair
from tgospa_eval.solvers.tuning import TIME_WINDOWS

FULLER = 1e-15
"""Sums of weights that exceed 1 by more are scaled."""

SOME_ROOM = 1e-9
"""Less room than this is none."""

BEFORE_SEAMS = 0.9
"""Share of the work, and of the time, that windows are of a block."""

UNKNOWN = -1.0
"""The weight of a state that no window has answered for."""


TimeWindow = tuple[int, int, int, int]
"""Steps that are solved together, ends are the step after the last: of the core, which is kept, and
of all."""


def divisible_blocks(states: States) -> Ints:
    """The blocks that are solved in windows: very large ones with rows that compete, over time.

    With switch prices that vary a run is several states, with large ones windows do not know
    enough, and gains that may be negative are for other purposes: such problems are solved whole.
    """
    problem = states.problem
    price = problem.switch_price
    allowed = isinstance(price, float) and 0 < price <= TIME_WINDOWS.highest_price
    if problem.signed or not allowed:
        return np.zeros(0, np.int64)
    if len(states.begin) < TIME_WINDOWS.least:
        return np.zeros(0, np.int64)
    steps = states.block_end - states.block_begin + 1
    long = steps >= TIME_WINDOWS.steps
    large = np.diff(states.block_first) >= TIME_WINDOWS.least
    slots = sum_by(states.node_block, np.diff(states.columns.first), len(steps))
    return np.flatnonzero(large & long & ~states.transposed & (slots > 0))


class Division:
    """One block in windows, and the answers of these as they come; windows may be in threads.

    Parameters
    ----------
    states : States
        The block.

    Attributes
    ----------
    windows : list of TimeWindow
        Of whole steps, with about as many gains each.
    weights, prices : (S,), (K,) float arrays
        What is joined so far.
    done : int
        How many windows that is.
    """

    def __init__(self, states: States) -> None:
        self.states, self.done = states, 0
        self.weights = np.full(len(states.begin), UNKNOWN)
        self.prices = np.zeros(len(states.columns.step))
        problem = states.problem
        gains = np.flatnonzero(states.entry >= 0).astype(np.int32)
        state = np.full(len(problem.cost), -1, np.int32)
        state[states.entry[gains]] = gains
        self._entry = np.flatnonzero(state >= 0).astype(np.int32)
        self._state = state[self._entry]
        self._step = problem.truth_step[problem.truth_row[self._entry]]
        self._end = states.end
        self.windows = self._windows()

    def _windows(self) -> list[TimeWindow]:
        begin, end = int(self.states.block_begin[0]), int(self.states.block_end[0]) + 1
        price = float(np.max(self.states.problem.switch_price, initial=0.0))
        overlap = TIME_WINDOWS.overlap + int(TIME_WINDOWS.fading * price)
        count = len(self.weights) // TIME_WINDOWS.size
        count = max(min(count, (end - begin) // TIME_WINDOWS.shortest), 1)
        at = len(self._step) * np.arange(1, count) // count
        seams = [begin, *np.unique(self._step[at]).tolist(), end]
        return [
            (low, high, max(low - overlap, begin), min(high + overlap, end))
            for low, high in itertools.pairwise(seams)
            if low < high
        ]

    def cut(self, window: TimeWindow) -> States:
        """The window as a problem of its own, of which the first step is 0."""
        problem, (first, stop) = self.states.problem, window[2:]
        steps = first, stop
        own = slice(*np.searchsorted(self._step, steps).tolist())
        truths = slice(*np.searchsorted(problem.truth_step, steps).tolist())
        estimates = slice(*np.searchsorted(problem.estimate_step, steps).tolist())
        entry = self._entry[own]
        piece = replace(
            problem,
            steps=stop - first,
            truth_step=problem.truth_step[truths] - first,
            truth_track=problem.truth_track[truths],
            truth_price=problem.truth_price[truths],
            estimate_step=problem.estimate_step[estimates] - first,
            estimate_track=problem.estimate_track[estimates],
            estimate_price=problem.estimate_price[estimates],
            truth_row=problem.truth_row[entry] - truths.start,
            estimate_row=problem.estimate_row[entry] - estimates.start,
            cost=problem.cost[entry],
            distance_power=None,
            pair_share=None,
            unjudged=None,
        )
        # Columns are estimates, as in the block: each may need its prices.
        return merge_runs(piece, transpose=False)

    def take(self, window: TimeWindow, piece: States, weights: Floats, prices: Floats) -> None:
        """Keep what was found for the core of a window.

        A state is kept that lies in the core, and the price of a slot that begins there.
        """
        whole, (low, high, first, _) = self.states, window
        home = self._homes(first, piece)
        begin = whole.begin[home]
        inside = begin >= low
        inside &= self._end[home] < high
        self.weights[home[inside]] = weights[inside]
        slot = piece.columns.begin
        shared = np.diff(piece.columns.first)[piece.pair_column] > 0
        priced = np.repeat(shared, np.diff(piece.pair_first))
        priced &= (begin == piece.begin + first) & (begin >= low) & (begin < high)
        self.prices[whole.columns.begin[home[priced]]] = prices[slot[priced]]
        self.done += 1

    def _homes(self, first: int, piece: States) -> Ints:
        """Where each state of a window is in the block; of a run cut off, the run."""
        start = int(np.searchsorted(self._step, first))
        home = np.empty(len(piece.begin), np.int32)
        run = piece.entry < 0
        gains = np.flatnonzero(~run)
        home[gains] = self._state[start + piece.entry[gains]]
        opens = np.zeros(len(home), bool)
        opens[piece.pair_first[:-1]] = True
        leading = np.flatnonzero(run & opens)
        other = np.flatnonzero(run & ~opens)
        home[other] = home[other - 1] + 1
        home[leading] = home[leading + 1] - 1
        return home

    def join(self) -> Floats:
        """Weights of all states, feasible: runs that no window holds whole are filled in.

        A run between two gains costs nothing at the lesser weight of both, and frees most room
        there; at the ends of the block it costs nothing at the weight of its gain.
        """
        states, weights = self.states, self.weights
        run = np.flatnonzero(states.entry < 0)
        first = np.zeros(len(weights) + 1, bool)
        first[states.pair_first] = True
        around = np.maximum(weights, 0.0)
        before = np.where(first[run], np.inf, around[run - 1])
        after = np.where(first[run + 1], np.inf, around[np.minimum(run + 1, len(around) - 1)])
        most = np.minimum(before, after)
        known = weights[run] >= 0
        joined: Floats = around
        joined[run] = np.where(known, np.minimum(weights[run], most), most)
        seams = run[~known & (most > 0)]
        _make_room(states, joined, seams)
        if any(_too_full(slots, joined).any() for slots in (states.rows, states.columns)):
            joined = repair(states, joined) / ONE
        return joined


class TimeShares:
    """The time for windows in equal shares: what one does not need is for those that come later.

    So a time limit that is too short leaves all of them half solved, and not some unsolved.

    Parameters
    ----------
    limit : Limit
        For everything.
    threads : int
        How many work at once.

    Attributes
    ----------
    waiting : int
        Windows that have not begun.
    """

    def __init__(self, limit: Limit, threads: int) -> None:
        self.limit = replace(limit, progress=limit.progress.silent())
        left = limit.left()
        self.until = None if left is None else time.monotonic() + BEFORE_SEAMS * left
        self.threads, self.waiting = threads, 0

    def take(self) -> Limit:
        """Until when the next of those that wait may go on."""
        waiting = max(self.waiting, 1)
        self.waiting -= 1
        if self.until is None:
            return self.limit
        now = time.monotonic()
        share = max(self.until - now, 0.0) * min(self.threads, waiting) / waiting
        return replace(self.limit, deadline=now + share)


def _too_full(slots: Slots, weights: Floats) -> Mask:
    return slots.loads(weights) > 1 + FULLER


def _make_room(states: States, weights: Floats, runs: Ints) -> None:
    """Lessen the weights of those runs where a slot is too full, in place; the shortest stay."""
    wanted = weights[runs]
    weights[runs] = 0.0
    possible = np.ones(len(runs), bool)
    for slots in (states.rows, states.columns):
        possible &= ~slots.touching(slots.loads(weights) > 1 - SOME_ROOM, runs)
    runs, wanted = runs[possible], wanted[possible]
    weights[runs] = wanted
    clash = np.zeros(len(runs), bool)
    for slots in (states.rows, states.columns):
        clash |= slots.touching(_too_full(slots, weights), runs)
    runs, wanted = runs[clash], wanted[clash]
    weights[runs] = 0.0
    room = [
        (1.0 - slots.loads(weights), slots.begin[runs], slots.end[runs])
        for slots in (states.rows, states.columns)
        if len(runs)
    ]
    length = states.end[runs] - states.begin[runs]
    for k in np.argsort(length, kind="stable").tolist():
        spans = [own[begin[k] : end[k]] for own, begin, end in room]
        held = max(min(wanted[k], *(float(span.min(initial=1.0)) for span in spans)), 0.0)
        weights[runs[k]] = held
        for span in spans:
            span -= held
