"""The ascent of the certified solver where no kernel was built: the same prices, in NumPy.

Sweeps are those of `solvers.fallback.sweeps`; what programmes ask of prices comes from Viterbi
passes over all rows at once.
"""

import itertools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.problem.paths import turns
from tgospa_eval.problem.problem import Floats, sum_by
from tgospa_eval.problem.slots import changed
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.best_paths import best_paths
from tgospa_eval.solvers.block_costs import THRESHOLDS, price_cap, unassigned_costs
from tgospa_eval.solvers.dual_ascent import BEST, LOSES, NEAR, NEEDED, REGRET, TEMPTED, Ascent
from tgospa_eval.solvers.fallback.sweeps import NEGLIGIBLE, Sweeps
from tgospa_eval.solvers.rounding import round_paths

HARDLY = 1e-6

MOST = 16
"""Sweeps of a stage: they take longer here beside the programmes that follow them."""


class NumpyAscent(Ascent):
    """`Ascent` without kernels. Gains are as they are, so that very small costs lose digits."""

    def __init__(
        self,
        states: States,
        wanted: NDArray[np.bool_],
        gap: float,
        weights: Floats,
        prices: Floats,
    ) -> None:
        self.states, self.wanted_gap = states, gap
        self.weights, self.prices = weights, prices
        self.switch_price = np.minimum(
            states.problem.switch_price_at, price_cap(states)[wanted].max()
        )
        self.gain, self.pair = states.gain, states.pair
        self.turn = turns(states)
        self.flags = np.zeros(len(self.gain), np.uint8)
        self.best, self.own = np.zeros(states.nodes), np.zeros(states.nodes)
        self.work, self.sweeping = 0, 0.0
        self.seconds = {"sweeps": 0.0, "rounding": 0.0, "bounds": 0.0}
        self.keep(wanted)
        self.unassigned_cost = unassigned_costs(states)
        self.taken_off = np.zeros(len(self.unassigned_cost))
        self.soft = np.zeros(len(prices))
        self.sweeps: Sweeps | None = None
        self.dual = self.survey(self.prices, 0.0)
        self.primal = np.where(wanted, -np.inf, 0.0)
        self._try_paths(self.gain)

    def keep(self, blocks: NDArray[np.bool_]) -> None:
        """Go on with these blocks only."""
        self.open = blocks
        self.rows = np.unique(self.states.pair_row).astype(np.int32)
        self.rows = self.rows[blocks[self.states.node_block[self.rows]]]

    def look(self, prices: Floats) -> Floats:
        """Bound of each block at the prices, (B,)."""
        self._forward(self.gain - self.states.columns.totals(prices))
        return self._bounds(prices)

    def survey(self, prices: Floats, reach: float) -> Floats:
        """`look`, with `flags` of every state and the value of the best assignment of each row."""
        states = self.states
        value = self.gain - states.columns.totals(prices)
        slack, none = self._backward(value, *self._forward(value))
        self.own = self._own(value, self.weights)
        self.flags[:] = 0
        for flag, where in (
            (NEAR, slack <= reach),
            (NEEDED, none > reach),
            (LOSES, slack > REGRET),
            (TEMPTED, slack <= HARDLY),
            (BEST, best_paths(states, prices) > 0),
        ):
            self.flags[where] |= flag
        return self._bounds(prices)

    def _forward(self, value: Floats) -> tuple[Floats, Floats]:
        """Best value up to each state, and of "none" when it begins; `best` of each row."""
        states, switch_price = self.states, self.switch_price
        forward, none = np.empty(len(value)), np.empty(len(value))
        unassigned_value, current = np.zeros(states.nodes), np.zeros(len(states.pair_row))
        for low, high in itertools.pairwise(self.turn.bounds):
            state, pair, row = (
                part[low:high] for part in (self.turn.order, self.turn.pair, self.turn.row)
            )
            price = switch_price[states.begin[state]]
            reached = current[pair]
            np.maximum.at(unassigned_value, row, reached - price)
            none[state] = unassigned_value[row]
            current[pair] = forward[state] = (
                np.maximum(reached, unassigned_value[row] - price) + value[state]
            )
        np.maximum.at(unassigned_value, states.pair_row, current)
        self.best = unassigned_value
        return forward, none

    def _backward(self, value: Floats, forward: Floats, none: Floats) -> tuple[Floats, Floats]:
        """Slack of each state, and of being in no state when it begins; see `row_backward`."""
        states, switch_price = self.states, self.switch_price
        behind = np.zeros(len(value))
        unassigned_value = np.zeros(states.nodes)
        for low, high in reversed(list(itertools.pairwise(self.turn.bounds))):
            state, pair, row = (
                part[low:high] for part in (self.turn.order, self.turn.pair, self.turn.row)
            )
            price = switch_price[states.begin[state]]
            none[state] = self.best[row] - (none[state] + unassigned_value[row])
            after = value[state] + behind[state]
            np.maximum.at(unassigned_value, row, after - price)
            goes_on = np.flatnonzero(state > states.pair_first[pair])
            behind[state[goes_on] - 1] = np.maximum(after, unassigned_value[row] - price)[goes_on]
        slack = self.best[states.pair_row[self.pair]] - (forward + behind)
        return slack, none

    def _own(self, value: Floats, weights: NDArray[Any]) -> Floats:
        """Value of an assignment in each row, less its changes, (nodes,)."""
        states = self.states
        row = states.pair_row[self.pair]
        own = sum_by(row, weights * value, states.nodes)
        moved = np.flatnonzero(changed(states.pair_first, weights))
        paid = self.switch_price[states.begin[moved]] * np.abs(weights[moved] - weights[moved - 1])
        own -= sum_by(row[moved], paid, states.nodes)
        return own

    def _values(self, weights: NDArray[Any]) -> Floats:
        self.own = self._own(self.gain, weights)
        return self._sum_own()

    def losses(self, _: Floats) -> Floats:
        """Nothing is known of the steps: all of them lose the same."""
        steps = self.states.problem.steps
        lost: Floats = np.full(steps, max(float(self.gap[self.open].sum()), 1e-300) / steps)
        return lost

    def stage(
        self,
        epsilon: float,
        sweeps: int,
        _: float,
        late: Callable[[], bool],
        calm: float = 0.0,
    ) -> tuple[int, float]:
        """Sweep at a temperature and judge; the working set is what has some mass."""
        begin = time.perf_counter()
        if self.sweeps is None:
            self.sweeps = Sweeps(self.states, np.flatnonzero(self.open))
        done, violation = 0, np.inf
        while done < min(sweeps, MOST) and violation >= calm and not (done and late()):
            violation = self.sweeps.sweep(epsilon)
            done += 1
            self.work += 2 * (len(self.sweeps.state) + len(self.sweeps.group))
        self.sweeping += time.perf_counter() - begin
        preference = self.sweeps.marginals()
        self.soft = self.sweeps.slot_prices()
        self.sweeps.drop(NEGLIGIBLE)
        swept = time.perf_counter()
        for cut in THRESHOLDS:
            self.try_prices(np.where(self.soft > cut * epsilon, self.soft, 0.0))
            if not self.wide(self.wanted_gap).any():
                break
        judged = time.perf_counter()
        self._try_paths(preference)
        self.seconds["sweeps"] += swept - begin
        self.seconds["bounds"] += judged - swept
        self.seconds["rounding"] += time.perf_counter() - judged
        return done, violation

    def _try_paths(self, preference: Floats) -> None:
        """WarmStart the best paths at the best prices, made feasible."""
        value = self.gain - self.states.columns.totals(self.prices)
        self.try_weights(round_paths(self.states, value, preference))
