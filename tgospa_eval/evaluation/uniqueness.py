"""Proof, by the prices of a result, that its assignment of near pairs is the only best one.

Let the prices be optimal. Then each row of a best assignment has a path that is best at these
prices, or a mixture of such paths. Also, a best assignment fills every slot with a price above 0,
by complementary slackness. A slot is a stretch of steps of an estimate. Rows that compete for an
estimate have several best paths, so prices do not always decide.

Conclusions decide more. If one state of a row is certain, the slot that it fills is closed to all
other rows. If only one state remains for a slot with a price above 0, this state is certain
(docs/how-to/gradient.md).

At some steps a pair has no gain, for example while neither object nor track exists. Assignments
there are often not unique, but they change no part of the cost. These steps are tested only on
request.
"""

import itertools

import numpy as np

from tgospa_eval.common.arrays import Floats, Mask
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.paths import turns
from tgospa_eval.problem.states import ONE, States
from tgospa_eval.results.records import PairProof

NO_TIE = 1e-9
"""A path with a loss below this, in units of c^p, may be a best one because of rounding."""

SHARE = 100.0
"""Largest loss of a path in any best assignment, as a multiple of the gap.

A path with a larger loss has the weight 0 in every best assignment. In a vertex of the linear
programme, weights above 0 are at least 1/18, and would cost more than the gap."""

ROUNDS = 50
"""Largest number of rounds of conclusions; a round takes as long as two searches for paths."""


def is_unique(proof: PairProof, gap: float, *, everywhere: bool = False) -> bool:
    """Return whether the assignment is shown to be the only best one.

    Parameters
    ----------
    proof : PairProof
        Assignment and prices.
    gap : float
        Relative gap that counts as exact.
    everywhere : bool
        Whether pairs without gain are tested too. They decide at which step a switch counts.
    """
    states, bounds = proof.states, proof.bounds
    if not bounds.met(gap) or proof.reduced:
        return False
    reach = max(NO_TIE, SHARE * (bounds.upper - bounds.lower))
    used, assigned = proof.weights > 0, proof.weights == ONE
    if not np.array_equal(used, assigned):
        return False  # weights between 0 and 1: a mixture of several best paths
    if not len(used):
        return True
    rows = _Rows(states, proof.prices, reach)
    for _ in range(ROUNDS):
        if not rows.draw_conclusions():
            return False
        open_ = rows.open(used, everywhere=everywhere)
        if not open_.any():
            return True
        if not rows.survey(open_):
            return False
    return False


class _Rows:
    """States that may be on best paths of their rows; conclusions exclude some of them.

    Parameters
    ----------
    states : States
        The problem.
    prices : (K,) float array
        Prices of the column slots.
    reach : float
        Largest loss with which a path counts as a best one.
    """

    def __init__(self, states: States, prices: Floats, reach: float) -> None:
        self.states, self.reach = states, reach
        slots, rows = states.columns, states.rows
        self.value = states.gain - slots.totals(prices)
        self.priced = prices > reach
        self.row = states.pair_row[states.pair]
        single = rows.first[states.pair_row] == rows.first[states.pair_row + 1]
        # A row with a single pair has no slots: no other pair of this row competes with it.
        self.is_single = np.repeat(single, np.diff(states.pair_first))
        self.near, self.needed = _marks(states, self.value, prices, reach)
        self.certain = np.zeros(len(states.begin), bool)
        self.closed = np.zeros(len(states.begin), bool)

    def open(self, used: Mask, *, everywhere: bool) -> Mask:
        """Return a mask of rows, (nodes,), whose best path is not known yet.

        `used` is the mask of assigned states. By default, only states with near pairs matter.
        """
        unsure = (self.near != used) | (self.near & ~self.certain)
        if not everywhere:
            unsure &= self.states.entry >= 0
        rows = np.zeros(self.states.nodes, bool)
        rows[self.row[unsure]] = True
        return rows

    def draw_conclusions(self) -> bool:
        """Draw conclusions until there are no new ones; return False if they contradict.

        All rivals of a certain state are excluded. A state is certain if it is the only remaining
        one for a slot with a price above 0.
        """
        columns, rows = self.states.columns, self.states.rows
        while True:
            at = np.where(self.is_single, 0, rows.begin)
            count = np.append(rows.sums(self.near.astype(np.int64)), 1)[at]
            fresh = self.near & self.needed & (self.is_single | (count == 1))
            must = self.priced & (columns.sums(self.near.astype(np.int64)) == 1)
            fresh = (fresh | (self.near & columns.touching(must))) & ~self.certain
            if not fresh.any():
                return True
            self.certain |= fresh
            for slots in (columns, rows):
                load = slots.sums(self.certain.astype(np.int64))
                if load.max(initial=0) > 1:
                    return False  # a contradiction, as rounded prices are not optimal
                self.closed |= slots.touching(load > 0) & ~self.certain
            self.near &= ~self.closed

    def survey(self, wanted: Mask) -> bool:
        """Search for best paths again, after conclusions; return whether anything changes.

        `wanted` (nodes,) is a mask of the rows that are searched.
        """
        part, own = self.states.of_pairs(np.flatnonzero(wanted[self.states.pair_row]))
        value = np.where(self.closed[own], -np.inf, self.value[own]) + self.certain[own]
        loss, without = path_losses(part, value)
        near, needed = self.near[own] & (loss <= self.reach), without > self.reach
        fewer = bool((near != self.near[own]).any() or (needed & ~self.needed[own]).any())
        self.near[own] = near
        self.needed[own] |= needed
        return fewer


def _marks(states: States, value: Floats, prices: Floats, reach: float) -> tuple[Mask, Mask]:
    """Return two masks of states.

    The first mask has the states on a best path of their row. A state is in the second mask if no
    best path of its row is in "none" when the state begins. A path counts as best if its loss is at
    most `reach`.
    """
    if not kernels:
        loss, without = path_losses(states, value)
        return loss <= reach, without > reach
    from tgospa_eval.solvers.dual_ascent import Ascent  # lazy: only with compiled kernels

    blocks = np.ones(len(states.block_begin), bool)
    ascent = Ascent(
        states, blocks, 0.0, np.zeros(len(states.begin)), np.zeros(len(states.columns.step))
    )
    ascent.mark(prices, reach)
    return ascent.has(kernels.NEAR), ascent.has(kernels.NEEDED)


def path_losses(states: States, value: Floats) -> tuple[Floats, Floats]:
    """Return two losses of each state, compared with the best path of its row.

    The Viterbi algorithm runs forward and backward in time, as in `problem.paths.best_values`.

    Parameters
    ----------
    states : States
        Complete rows.
    value : (S,) float array
        Gains minus prices; minus infinity closes a state.

    Returns
    -------
    through : (S,) float array
        Loss of the best path that goes through the state.
    without : (S,) float array
        Loss of the best path that is in "none" when the state begins.
    """
    bounds, order, pair_of, row_of = turns(states)
    price = states.problem.switch_price_at[states.begin[order]]
    value = value[order]
    size = len(value)
    pairs, nodes = len(states.pair_row), states.nodes
    through, without = np.zeros(size), np.zeros(size)
    spans = [slice(*ends) for ends in itertools.pairwise(bounds)]

    none, current = np.zeros(nodes), np.zeros(pairs)
    for own in spans:
        pair, row = pair_of[own], row_of[own]
        reached = current[pair]
        np.maximum.at(none, row, reached - price[own])
        without[own] = none[row]
        current[pair] = np.maximum(reached, none[row] - price[own]) + value[own]
        through[own] = current[pair]
    best = none
    np.maximum.at(best, states.pair_row, current)
    best = best[row_of]

    none, current = np.zeros(nodes), np.zeros(pairs)
    for own in reversed(spans):
        pair, row = pair_of[own], row_of[own]
        through[own] += current[pair]
        without[own] += none[row]
        entered = value[own] + current[pair]
        np.maximum.at(none, row, entered - price[own])
        current[pair] = np.maximum(entered, none[row] - price[own])
    losses = np.empty((2, size))
    losses[0, order], losses[1, order] = best - through, best - without
    return losses[0], losses[1]
