"""The ascent where no kernel was built: the same sweeps in NumPy, messages kept as logarithms."""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.problem.problem import Floats, Ints, sum_by
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.block_costs import block_costs, unassigned_costs
from tgospa_eval.solvers.schedule import ASCENT
from tgospa_eval.solvers.trivial import dual_values, round_paths

NEGLIGIBLE_MASS = 1e-12
LONGEST_CHAIN = 2_000_000
"""States of one step that the sweeps may have; eight for each gain if that is more."""


class PlainAscent:
    """Stands in for `solvers.dual_ascent.Ascent` in `Sinkhorn`; see there.

    The working set is what has some mass, whatever threshold is asked for.
    """

    def __init__(
        self, states: States, wanted: NDArray[np.bool_], gap: float, weights: Floats, prices: Floats
    ) -> None:
        self.states, self.open, self.wanted_gap = states, wanted, gap
        self.weights, self.prices = weights, prices
        self.unassigned_cost = unassigned_costs(states)
        self.primal = np.zeros(len(self.unassigned_cost))
        self.dual = dual_values(states, self.prices)
        self.slot_block = states.node_block[states.columns.node]
        self.state_block = states.pair_block[states.pair]
        self.sweeps = Sweeps(states, np.flatnonzero(wanted))
        self.work, self.sweeping = 0, 0.0
        self.seconds = {"sweeps": 0.0, "rounding": 0.0, "bounds": 0.0}

    def keep(self, blocks: NDArray[np.bool_]) -> None:
        """Judge these blocks only; the sweeps go on with all."""
        self.open = blocks

    @property
    def gap(self) -> Floats:
        """Width of the bracket of each block, (B,)."""
        return self.dual - self.primal

    @property
    def cost(self) -> Floats:
        """Cost of the best assignment of each block, (B,)."""
        return np.maximum(self.unassigned_cost - self.primal, 0.0)

    def wide(self, gap: float | None = None) -> NDArray[np.bool_]:
        """Open blocks whose bracket is wider than the gap, by default the wanted one, relative."""
        return self.open & (self.gap > (self.wanted_gap if gap is None else gap) * self.cost)

    def stage(
        self, epsilon: float, sweeps: int, _: float, late: Callable[[], bool]
    ) -> tuple[int, float]:
        """Sweep at a temperature and judge; how many sweeps, and the last violation."""
        begin = time.perf_counter()
        done, violation = 0, np.inf
        while done < sweeps:
            violation = self.sweeps.sweep(epsilon)
            done += 1
            self.work += 2 * (len(self.sweeps.state) + len(self.sweeps.group))
            if late():
                break
        self.sweeping += time.perf_counter() - begin
        soft, prices = self.sweeps.marginals(), self.sweeps.slot_prices()
        self.sweeps.drop(NEGLIGIBLE_MASS)
        swept = time.perf_counter()
        for cut in ASCENT.thresholds:
            trial = np.where(prices > cut * epsilon, prices, 0.0)
            dual = dual_values(self.states, trial)
            wins = self.open & (dual < self.dual)
            self.dual = np.where(wins, dual, self.dual)
            np.copyto(self.prices, trial, where=wins[self.slot_block])
        judged = time.perf_counter()
        value = self.states.gain - self.states.columns.totals(self.prices)
        for trial in (soft, round_paths(self.states, value, soft)):
            primal = self.unassigned_cost - block_costs(self.states, trial)
            wins = self.open & (primal > self.primal)
            self.primal = np.where(wins, primal, self.primal)
            np.copyto(self.weights, trial, where=wins[self.state_block])
        end = time.perf_counter()
        self.seconds["sweeps"] += swept - begin
        self.seconds["bounds"] += judged - swept
        self.seconds["rounding"] += end - judged
        return done, violation


class Sweeps:
    """Messages over the chain of steps of the open blocks.

    A run is a chain of one state a step here. The longest runs are left out where the chain would
    grow beyond some states for each gain; the bracket does not depend on that.
    """

    def __init__(self, states: States, left: Ints) -> None:
        self.states = states
        state, step = _chain(states, left)
        order = np.lexsort((states.pair[state], step))  # pairs are sorted by row
        self.state, self.step = state[order], step[order]

        # A column that a single pair has needs no price: its slot range is empty.
        slots = states.columns
        shared = slots.end[self.state] > slots.begin[self.state]
        column = states.pair_column[states.pair[self.state]]
        key = np.where(shared, self.step.astype(np.int64) * states.nodes + column, -1)
        keys, self.priced = np.unique(key, return_inverse=True)
        self.price = np.zeros(len(keys))
        self.free = int(keys[0] == -1)  # number 0 stands for "no price"
        key_step, key_column = np.divmod(keys[self.free :], states.nodes)
        slot_key = slots.node * states.problem.steps + slots.step
        sought = key_column * states.problem.steps + key_step
        self.slot = np.searchsorted(slot_key, sought, side="right") - 1
        self.steps = np.unique(self.step)
        ends = np.append(self.steps, self.steps[-1] + 1)
        self.priced_at = np.searchsorted(keys, ends * states.nodes)
        self._link()

    def _link(self) -> None:
        """Neighbours and groups of the states at hand; messages start anew."""
        states = self.states
        pair = states.pair[self.state]
        size = len(pair)
        by_pair = np.lexsort((self.step, pair))
        joined = (np.diff(pair[by_pair]) == 0) & (np.diff(self.step[by_pair]) == 1)
        self.previous = np.full(size, -1)
        self.next = np.full(size, -1)
        self.previous[by_pair[1:][joined]] = by_pair[:-1][joined]
        self.next[by_pair[:-1][joined]] = by_pair[1:][joined]
        self.first = self.step == states.block_begin[states.pair_block[pair]]
        self.last = self.step == states.block_end[states.pair_block[pair]]
        self.gain = states.gain[self.state]
        self.row = states.pair_row[pair]
        fresh = np.ones(size, bool)
        fresh[1:] = (np.diff(self.row) != 0) | (np.diff(self.step) != 0)
        self.group = np.flatnonzero(fresh)
        self.group_of = np.cumsum(fresh) - 1
        self.at = np.searchsorted(self.step, np.append(self.steps, self.steps[-1] + 1))
        self.group_at = np.searchsorted(self.group, self.at)
        self.forward = np.zeros(size)
        self.backward = np.zeros(size)
        self.mass = np.zeros(size)
        self.none_forward = np.zeros(len(self.group))
        self.none_backward = np.zeros(len(self.group))
        self.fresh = True

    def drop(self, least: float) -> None:
        """Leave out the states whose mass is below `least`: colder, they have even less."""
        keep = self.mass >= least
        if np.count_nonzero(keep) < 0.8 * len(keep):
            self.state, self.step, self.priced = (
                self.state[keep],
                self.step[keep],
                self.priced[keep],
            )
            self._link()

    def sweep(self, epsilon: float) -> float:
        """Once forward and once backward; the largest column violation met on the way."""
        switch_price = self.states.problem.switch_price_at / epsilon
        if self.fresh:
            self._pass(epsilon, switch_price, reverse=True, update=False)
            self.fresh = False
        violation = self._pass(epsilon, switch_price, reverse=False, update=True)
        return max(violation, self._pass(epsilon, switch_price, reverse=True, update=True))

    def _pass(self, epsilon: float, switch_price: Floats, *, reverse: bool, update: bool) -> float:
        """One direction: renew its messages step by step, and the prices if asked.

        ``log A' = log((1 - q^2) a + q A_0')``, ``log A_0' = log(a_0 + q S')``, see the kernels.
        """
        ahead, behind = (self.backward, self.forward) if reverse else (self.forward, self.backward)
        none_ahead, none_behind = (
            (self.none_backward, self.none_forward)
            if reverse
            else (self.none_forward, self.none_backward)
        )
        source = self.next if reverse else self.previous
        starts = self.last if reverse else self.first
        unassigned_value = np.zeros(self.states.nodes)
        violation = 0.0
        order = range(len(self.steps))
        for k in reversed(order) if reverse else order:
            part = slice(self.at[k], self.at[k + 1])
            if part.start == part.stop:
                continue
            groups = slice(self.group_at[k], self.group_at[k + 1])
            rows = self.row[self.group[groups]]
            offsets = self.group[groups] - part.start
            group = self.group_of[part] - groups.start
            step = int(self.steps[k])
            paid = switch_price[step + 1] if reverse else switch_price[step]

            # Arrive: from the same pair (not through being unassigned), or from that.
            came = ahead[source[part]]
            came = np.where(source[part] >= 0, came + _log_stay(paid), -np.inf)
            arrive = np.logaddexp(came, unassigned_value[self.row[part]] - paid)
            arrive = np.where(starts[part], 0.0, arrive)
            none = unassigned_value[rows]
            weight = (self.gain[part] - self.price[self.priced[part]]) / epsilon
            ahead[part] = arrive + weight
            none_ahead[groups] = none

            if update:
                # `ahead` has the weight of this step, `behind` of the other direction as well
                # only in what follows: both are messages up to this step, one with its weight.
                through = ahead[part] + behind[part] - weight
                share = (
                    through - _log_sum(through, none + none_behind[groups], offsets, group)[group]
                )
                self.mass[part] = np.exp(share)
                change = self._reprice(k, part, share, epsilon)
                violation = max(violation, change)
                weight = (self.gain[part] - self.price[self.priced[part]]) / epsilon
                ahead[part] = arrive + weight
            leave = switch_price[step] if reverse else switch_price[step + 1]
            unassigned_value[rows] = np.logaddexp(
                none, _log_sum(ahead[part], None, offsets, group) - leave
            )
        return violation

    def _reprice(self, k: int, part: slice, share: Floats, epsilon: float) -> float:
        """New prices of the columns of step k, u = 1 / (1 + mass / u); the violation before."""
        low, high = self.priced_at[k], self.priced_at[k + 1]
        if low == high:
            return 0.0
        inside = self.priced[part] >= low
        mass = sum_by(self.priced[part][inside] - low, np.exp(share[inside]), high - low)
        old = self.price[low:high]
        with np.errstate(divide="ignore"):
            self.price[low:high] = epsilon * np.logaddexp(0.0, np.log(mass) + old / epsilon)
        return float(np.abs(mass + np.exp(-old / epsilon) - 1.0).max())

    def marginals(self) -> Floats:
        """Weight of every state: the least over its steps (what covers a run, covers it whole)."""
        weights = np.ones(len(self.states.pair))
        np.minimum.at(weights, self.state, self.mass)
        covered = np.bincount(self.state, minlength=len(weights))
        whole = covered == self.states.end - self.states.begin + 1
        return np.where(whole, weights, 0.0)

    def slot_prices(self) -> Floats:
        """Price of every column slot: the sum over its steps."""
        return sum_by(self.slot, self.price[self.free :], len(self.states.columns.node))


def _chain(states: States, left: Ints) -> tuple[Ints, Ints]:
    """State and step of every link, the longest runs left out where they are too many."""
    chosen = np.flatnonzero(np.isin(states.pair_block, left)[states.pair])
    length = states.end[chosen] - states.begin[chosen] + 1
    order = np.argsort(length, kind="stable")
    room = max(LONGEST_CHAIN, 8 * len(states.problem.cost))
    chosen = np.sort(chosen[order[np.cumsum(length[order]) <= room]])
    length = states.end[chosen] - states.begin[chosen] + 1
    state = np.repeat(chosen, length)
    return state, concatenated(states.begin[chosen], length)


def _log_sum(value: Floats, other: Floats | None, offsets: Ints, group: Ints) -> Floats:
    """Log of the sum of exp over each group, and of `other` with it."""
    top = np.maximum.reduceat(value, offsets)
    if other is not None:
        top = np.maximum(top, other)
    total = np.add.reduceat(np.exp(value - top[group]), offsets)
    if other is not None:
        total = total + np.exp(other - top)
    return np.asarray(top + np.log(total))


def _log_stay(paid: float) -> float:
    """Log of 1 - q^2, q = exp(-paid): staying, beside leaving and coming back at one transition."""
    return float(np.log(-np.expm1(-2.0 * paid))) if paid > 0 else -np.inf
