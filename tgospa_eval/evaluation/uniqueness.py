"""Proof by the prices of a result that its assignment of near pairs is the only best one.

At best prices v, every best assignment is a mixture of paths that are best for their rows. It also
fills every slot (steps of an estimate) with v > 0, by complementary slackness. Rows that compete
for an estimate are indifferent at these prices, so prices alone do not decide the path of each row.
But a certain state of one row decides states of other rows: the slot that it fills is closed to
them. If one state remains for a slot with v > 0, it fills the slot (docs/how-to/gradient.md).

Assignments at steps without gain, as between two tracks while neither exists, are often not unique.
They change no part of the cost, and are tested only at the steps of switches.
"""

import itertools

import numpy as np

from tgospa_eval.common.arrays import Floats, Mask
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.paths import turns
from tgospa_eval.problem.states import ONE, States
from tgospa_eval.results.records import PairProof

NO_TIE = 1e-9
"""Loss in units of c^p below which a path may be a best one, because of rounding."""

SHARE = 100.0
"""Largest loss of a path in any best assignment, as a multiple of the gap.

Paths with larger losses have weight 0, because weights of vertices are multiples of 1/2 to 1/18."""

ROUNDS = 50
"""Largest number of rounds of conclusions; a round takes as long as two searches for best paths."""


def is_unique(proof: PairProof, gap: float, *, everywhere: bool = False) -> bool:
    """Return whether the assignment is shown to be the only best one.

    Parameters
    ----------
    proof : PairProof
        Assignment and prices.
    gap : float
        Relative gap that counts as exact.
    everywhere : bool
        Whether steps without gain are tested too; they decide at which step a switch is counted.
    """
    states, bounds = proof.states, proof.bounds
    if not bounds.met(gap) or proof.reduced:
        return False
    reach = max(NO_TIE, SHARE * (bounds.upper - bounds.lower))
    used, assigned = proof.weights > 0, proof.weights == ONE
    if not np.array_equal(used, assigned):
        return False  # the best path is a mixture
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
    """Candidates for the best paths of the rows; each conclusion removes some of them.

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
        # Rows with a single pair have no slots, so the pair has no neighbours of the same row.
        self.is_single = np.repeat(single, np.diff(states.pair_first))
        self.near, self.needed = _marks(states, self.value, prices, reach)
        self.certain = np.zeros(len(states.begin), bool)
        self.closed = np.zeros(len(states.begin), bool)

    def open(self, used: Mask, *, everywhere: bool) -> Mask:
        """Return rows without known best paths, for near pairs or everywhere, (nodes,)."""
        unsure = (self.near != used) | (self.near & ~self.certain)
        if not everywhere:
            unsure &= self.states.entry >= 0
        rows = np.zeros(self.states.nodes, bool)
        rows[self.row[unsure]] = True
        return rows

    def draw_conclusions(self) -> bool:
        """Close rivals of certain states, and fill priced slots; return whether both succeed."""
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
                    return False  # rounded prices are not optimal
                self.closed |= slots.touching(load > 0) & ~self.certain
            self.near &= ~self.closed

    def survey(self, wanted: Mask) -> bool:
        """Search the best paths of some rows (nodes,) again; return whether fewer remain."""
        part, own = self.states.of_pairs(np.flatnonzero(wanted[self.states.pair_row]))
        value = np.where(self.closed[own], -np.inf, self.value[own]) + self.certain[own]
        loss, without = path_losses(part, value)
        near, needed = self.near[own] & (loss <= self.reach), without > self.reach
        fewer = bool((near != self.near[own]).any() or (needed & ~self.needed[own]).any())
        self.near[own] = near
        self.needed[own] |= needed
        return fewer


def _marks(states: States, value: Floats, prices: Floats, reach: float) -> tuple[Mask, Mask]:
    """Return masks of states: of those on a best path, and of those that begin without "none".

    A path is a best one if its loss is at most `reach`. When a state of the second mask begins, no
    best path is in "none".
    """
    if not kernels:
        loss, without = path_losses(states, value)
        return loss <= reach, without > reach
    from tgospa_eval.solvers.dual_ascent import Ascent  # lazy: like the solvers

    blocks = np.ones(len(states.block_begin), bool)
    ascent = Ascent(
        states, blocks, 0.0, np.zeros(len(states.begin)), np.zeros(len(states.columns.step))
    )
    ascent.mark(prices, reach)
    return ascent.has(kernels.NEAR), ascent.has(kernels.NEEDED)


def path_losses(states: States, value: Floats) -> tuple[Floats, Floats]:
    """Return the loss of the best path of each row with a restriction, compared to its best path.

    The search uses Viterbi forward and backward in time, like `problem.paths.best_values`.

    Parameters
    ----------
    states : States
        Complete rows.
    value : (S,) float array
        Gains minus prices; minus infinity closes a state.

    Returns
    -------
    through : (S,) float array
        Loss of a path through each state.
    without : (S,) float array
        Loss of a path that is in "none" when the state begins.
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
