"""Dual ascent on the compiled kernels: entropic sweeps on working sets, both bounds after each.

After Nevelius Wernholm, Wärnsäter and Ringh, "Fast computation of the TGOSPA metric for multiple
target tracking via unbalanced optimal transport", with one path per row (docs/theory, "Sinkhorn").
Bounds here steer the solvers; those that are reported are made anew by `tgospa_eval.result`.
"""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.compiled import kernels
from tgospa_eval.problem import Floats, Ints, sum_by
from tgospa_eval.solvers.kernels import THRESHOLDS, alone_costs, is_wide, price_cap
from tgospa_eval.states import Slots, States, connected_components

NEAR, NEEDED, LOSES, BEST, TEMPTED = 1, 2, 4, 8, 16
"""Flags of a survey: slack within the reach; being in no state instead costs more than the reach;
slack that is more than rounding; on the best path that was found; slack below 1e-6."""

REGRET = 1e-11
"""What a row could gain by leaving its path that is rounding: sums round to 1e-12."""


class Ascent:
    """Prices, assignments and both bounds of some blocks on the way to the optimum.

    Parameters
    ----------
    states : States
        The blocks.
    wanted : (B,) bool array
        Those that take part until `keep` leaves more out.
    gap : float
        Relative gap at which no further candidates are tried.

    Attributes
    ----------
    soft : (K,) float array
        Prices of the sweeps.
    prices, bound : (K,), (B,) float arrays
        The best prices so far, and what they prove that a block can gain at most.
    weights, worth : (S,), (B,) float arrays
        The best assignment so far, and what it gains.
    alone : (B,) float array
        Cost of leaving all unassigned.
    flags : (S,) uint8 array
        What the last survey says of each state: NEAR, NEEDED, LOSES, BEST, TEMPTED.
    work, sweeping : int, float
        States, those of being in none included, times half sweeps; the seconds that they took.
    seconds : dict
        Time by kind of work.
    """

    def __init__(self, states: States, wanted: NDArray[np.bool_], gap: float) -> None:
        self.states, self.wanted_gap = states, gap
        size, nodes, slots = len(states.begin), states.nodes, len(states.columns.step)
        cap = float(price_cap(states)[wanted].max())
        self.crossing = np.minimum(states.problem.crossing_price, cap)
        self.gain = states.gain
        self.slot_end = states.columns.end
        self.slot_block = states.node_block[states.columns.node]
        self.state_block = states.pair_block[states.pair]
        self.window_end = states.block_end[states.node_block]
        self.order, self.row_first = states.row_order
        self.flags = np.zeros(size, np.uint8)
        self.best, self.own = np.zeros(nodes), np.zeros(nodes)
        self.work, self.sweeping = 0, 0.0
        self.seconds = {"sweeps": 0.0, "rounding": 0.0, "bounds": 0.0}

        self.keep(wanted)
        self.soft, self.prices = np.zeros(slots), np.zeros(slots)
        self.weights = np.zeros(size)
        self.bound = self.survey(self.prices, 0.0)
        self._majority(self._on_best_path(), self.weights)
        self.worth = self.value_of(self.weights)
        self.alone = alone_costs(states)

    def keep(self, blocks: NDArray[np.bool_]) -> None:
        """Go on with these blocks only."""
        self.open = blocks
        nodes = np.flatnonzero(blocks[self.states.node_block])
        is_row = self.row_first[nodes + 1] > self.row_first[nodes]
        self.rows = nodes[is_row].astype(np.int32)
        self.columns = nodes[~is_row].astype(np.int32)

    @property
    def gap(self) -> Floats:
        """Width of the bracket of each block, (B,)."""
        return self.bound - self.worth

    def wide(self, gap: float) -> NDArray[np.bool_]:
        """Open blocks whose bracket is wider than `gap`, relative, and than rounding allows."""
        return self.open & is_wide(self.bound, self.worth, self.alone, gap)

    def look(self, prices: Floats) -> Floats:
        """Bound of each block at the prices, (B,)."""
        s = self.states
        kernels.survey(
            self.columns, s.columns.first, self.rows, self.row_first, self.order, s.begin,
            s.columns.begin, self.slot_end, self.crossing, self.gain, prices, self.best,
        )  # fmt: skip
        return self._bounds(prices)

    def survey(self, prices: Floats, reach: float) -> Floats:
        """`look`, with `flags` of every state and the value of the best assignment of each row."""
        s = self.states
        kernels.survey(
            self.columns, s.columns.first, self.rows, self.row_first, self.order, s.begin,
            s.columns.begin, self.slot_end, self.crossing, self.gain, prices, self.best,
            self.weights, reach, self.own, self.flags,
        )  # fmt: skip
        return self._bounds(prices)

    def _bounds(self, prices: Floats) -> Floats:
        blocks = len(self.states.block_begin)
        return sum_by(self.states.node_block[self.rows], self.best[self.rows], blocks) + sum_by(
            self.slot_block, prices, blocks
        )

    def has(self, flag: int) -> NDArray[np.bool_]:
        """Which states bear a flag since the last survey, (S,)."""
        return (self.flags & flag) > 0

    def _on_best_path(self) -> Floats:
        return self.has(BEST).astype(np.float64)

    def value_of(self, weights: Floats) -> Floats:
        """Gain of a feasible assignment in each block, (B,)."""
        s = self.states
        kernels.own_values(
            self.rows, self.row_first, s.begin, self.crossing, self.gain, weights, self.own
        )
        return sum_by(s.node_block[self.rows], self.own[self.rows], len(s.block_begin))

    def offer_prices(self, prices: Floats) -> None:
        """Take the prices in the open blocks where they prove more."""
        bound = self.look(prices)
        wins = self.open & (bound < self.bound)
        self.bound = np.where(wins, bound, self.bound)
        self.prices = np.where(wins[self.slot_block], prices, self.prices)

    def offer_weights(self, weights: Floats) -> None:
        """Take the feasible assignment in the open blocks where it gains more."""
        worth = self.value_of(weights)
        wins = self.open & (worth > self.worth)
        self.worth = np.where(wins, worth, self.worth)
        self.weights = np.where(wins[self.state_block], weights, self.weights)

    def stage(
        self, epsilon: float, sweeps: int, threshold: float, late: Callable[[], bool]
    ) -> float:
        """Sweep at a temperature and judge; the largest violation of a column at the end.

        The working set are the states with slack up to `threshold`, and those in use.
        """
        begin = time.perf_counter()
        self.survey(self.soft, threshold)
        s = self.states
        shares = self._on_best_path()
        chosen = np.zeros(len(s.begin), np.uint8)
        kernels.working_set(
            self.rows, self.row_first, self.order, s.begin, s.columns.begin, self.slot_end,
            self.weights, self.soft, self.flags, chosen,
        )  # fmt: skip
        chain = kernels.Chain(
            self.rows, self.columns, self.row_first, self.order, s.begin, self.window_end,
            s.columns.first, s.columns.step, s.columns.begin, self.slot_end,
            chosen, self.gain, self.soft, self.crossing,
        )  # fmt: skip
        chain.heat(epsilon)
        hot = time.perf_counter()
        violation = np.inf
        for _ in range(sweeps):
            violation = chain.sweep(1)
            self.work += 2 * (chain.links + chain.nodes)
            if late():
                break
        self.sweeping += time.perf_counter() - hot
        chain.write_marginals(shares)
        chain.cool(epsilon)
        chain.write_prices(self.soft)
        rounded = time.perf_counter()
        self.offer_weights(self.round(shares))
        judged = time.perf_counter()
        for cut in THRESHOLDS:
            self.offer_prices(np.where(self.soft > cut * epsilon, self.soft, 0.0))
            if not self.wide(self.wanted_gap).any():
                break
        end = time.perf_counter()
        self.seconds["sweeps"] += rounded - begin
        self.seconds["rounding"] += judged - rounded
        self.seconds["bounds"] += end - judged
        return float(violation)

    def round(self, shares: Floats) -> Floats:
        """Majorities of the shares as paths, each then re-optimised given the others."""
        s = self.states
        weights = np.zeros(len(shares))
        load = self._majority(shares, weights)
        for _ in range(2):
            changed = kernels.improve(
                self.rows, self.row_first, self.order, s.begin, s.columns.begin, self.slot_end,
                self.crossing, self.gain, load, weights,
            )  # fmt: skip
            if not changed:
                break
        return weights

    def full(self) -> NDArray[np.bool_]:
        """Whether the best assignment uses each column slot up, (K,)."""
        used = np.flatnonzero(self.weights)
        return _cover(self.states.columns, used, self.weights[used]) > 1 - 1e-9

    def undecided(self, also: NDArray[np.bool_]) -> Ints:
        """States that a programme has to decide for the bracket to close, after a survey.

        Near are the states within its reach, those in use and those in `also`. Where a row
        has one of them only, and cannot well do without, it is decided. What is left falls apart
        into components through shared slots and transitions; wanted are those with a seed: by the
        identity of the gap a row with regret, or a price on a column that is not full.
        """
        s = self.states
        near = (self.has(NEAR) | (self.weights > 0) | also) & self.open[self.state_block]
        crowd = np.concatenate(([0], np.cumsum(_cover(s.rows, np.flatnonzero(near)) > 1)))
        alone = crowd[s.rows.end] == crowd[s.rows.begin]
        decided = (self.weights > 1 - 1e-9) & alone & self.has(NEEDED)
        free = np.flatnonzero(near & ~decided)
        return free[self._seeded(free)]

    def _seeded(self, free: Ints) -> NDArray[np.bool_]:
        """Which of the free states are in a component with a seed."""
        s = self.states
        regret = np.zeros(s.nodes, bool)
        regret[self.rows] = (self.best - self.own)[self.rows] > REGRET
        changes = np.zeros(len(self.weights), bool)
        changes[1:] = np.diff(self.weights) != 0
        changes[:-1] |= changes[1:]
        seed = ((self.weights > 0) & self.has(LOSES)) | changes
        seed |= self.has(BEST) & (self.weights < 1)
        seed &= np.repeat(regret[s.pair_row], np.diff(s.pair_first))
        lost = np.concatenate(([0], np.cumsum((self.prices > REGRET) & ~self.full())))
        seed |= lost[self.slot_end] > lost[s.columns.begin]

        size = len(free)
        number = np.zeros(len(seed), np.int32)
        number[free] = np.arange(size)
        joined = free[:-1][np.diff(free) == 1]
        joined = joined[s.begin[joined + 1] > s.begin[joined]]  # of one pair
        one, other, nodes = [number[joined]], [number[joined + 1]], size
        for slots in (s.rows, s.columns):
            begin = slots.begin[free]
            length = slots.end[free] - begin
            offset = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
            one.append(np.repeat(np.arange(size), length))
            other.append(nodes + np.repeat(begin, length) + offset)
            nodes += len(slots.step)
        component = connected_components(np.concatenate(one), np.concatenate(other), nodes)[:size]
        wanted = np.zeros(nodes, bool)
        wanted[component[seed[free]]] = True
        return wanted[component]

    def _majority(self, shares: Floats, weights: Floats) -> Ints:
        """Write feasible weights 0 and 1; what uses each column slot."""
        s = self.states
        load = np.zeros(len(s.columns.step), np.int32)
        kernels.majority(
            self.rows, self.row_first, self.order, s.begin, self.window_end, s.columns.begin,
            self.slot_end, shares, weights, load,
        )  # fmt: skip
        return load


def _cover(slots: Slots, chosen: Ints, weight: Floats | None = None) -> Floats:
    """Sum of the weights of the chosen states (their number by default) over each slot, (K,)."""
    size = len(slots.step) + 1
    change = np.bincount(slots.begin[chosen], weight, size)
    change = change - np.bincount(slots.end[chosen], weight, size)
    return np.cumsum(change, dtype=np.float64)[:-1]
