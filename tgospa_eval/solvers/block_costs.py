"""Costs of assignments and displayed bounds, block by block; and a limit for switch prices.

A *block* is a part of the problem that can be solved by itself (`problem.states`). This module has
the cost of a proposed assignment in each block, and a limit above which larger switch prices do not
change the optimum. The second half has the bounds that are displayed while solvers work. Other
words and letters: `solvers`.
"""

from functools import cached_property

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.progress import Progress
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.states import ONE, States, assigned, changes, repair, spare

SETTLED_FROM = 1000.0
"""Switch price below which the rounding error of a weight costs less than 1e-9, so that `settle`
does nothing."""


def price_cap(states: States) -> Floats:
    """Return a cap for the switch prices of each block, (B,).

    Let L be the number of steps of the block, and g its largest gain. From the price (L - 1) g on,
    no switch saves cost. So the optimum is the same for all larger prices
    (docs/theory/reductions.md, "Switch price cap"). The cap 2 L g is above this price. Solvers
    replace larger prices by it, because the tolerances of HiGHS and others are absolute, and huge
    prices would cause errors.
    """
    largest: Floats = np.maximum.reduceat(states.gain, states.block_first[:-1])
    return 2.0 * (states.block_end - states.block_begin + 1) * largest


def settle(states: States, blocks: Mask, weights: Floats) -> None:
    """Average the weights of each pair over time, in blocks with all switch prices above the cap.

    In these blocks an optimum has no switches. But a solver may return weights that change by, for
    example, 1e-12 from one step to the next, which costs much if the switch price is huge. The
    averages are feasible, too: at each step, the averages of an object or of a track sum to at most
    1.
    """
    switch_price = states.problem.switch_price_at
    if switch_price.max() < SETTLED_FROM or not blocks.any():
        return
    spans = zip(states.block_begin.tolist(), states.block_end.tolist(), strict=True)
    smallest = np.array([switch_price[a + 1 : b + 1].min(initial=np.inf) for a, b in spans])
    steady = blocks & (smallest > price_cap(states)) & np.isfinite(smallest)
    if not steady.any():
        return
    length = (states.end - states.begin + 1).astype(np.float64)
    pair, pairs = states.pair, len(states.pair_row)
    mean = sum_by(pair, weights * length, pairs) / sum_by(pair, length, pairs)
    np.copyto(weights, mean[pair], where=states.states_of(steady))


def unassigned_costs(states: States) -> Floats:
    """Return the cost of each block with all its objects and tracks unassigned, (B,)."""
    blocks = len(states.block_begin)
    costs = zip(states.track_blocks, states.problem.unassigned_costs, strict=True)
    truths, estimates = (sum_by(of + 1, cost, blocks + 1)[1:] for of, cost in costs)
    return truths + estimates


def block_costs(states: States, weights: Floats) -> Floats:
    """Return the cost of a proposed assignment in each block, (B,).

    With the weights W of a step and W' of the next one, the cost is the sum over all steps of
    ``sum W D + A (1 - row sums) + B (1 - column sums) + lambda |W' - W|``
    (docs/theory/notation.md). The assignment is made feasible first. Objects and tracks without a
    near pair are left out.
    """
    return feasible_costs(states, repair(states, weights))


def feasible_costs(states: States, whole: Ints) -> Floats:
    """Return `block_costs` of a feasible assignment `whole` (S,), in units of 1/`ONE`."""
    problem, blocks = states.problem, len(states.block_begin)
    of_state = states.block
    used, entry, weight = assigned(states, whole)
    total = sum_by(of_state[used], weight / ONE * problem.cost[entry], blocks)
    changed, amount = changes(states, whole)
    paid = problem.switch_price_at[states.begin[changed]] * amount
    total += sum_by(of_state[changed], paid, blocks)
    for side, blocks_of in zip(problem.sides, states.track_blocks, strict=True):
        at = blocks_of[side.track]
        price = spare(side, entry, weight) / ONE * side.price
        total += sum_by(at[at >= 0], price[at >= 0], blocks)
    return total


def better(states: States, first: Floats, second: Floats) -> Floats:
    """Return in each block the cheaper of two proposed assignments."""
    wins = block_costs(states, second) < block_costs(states, first)
    return np.where(states.states_of(wins), second, first)


# -------------------------------------------------------------------------------------------------
# Bounds that are displayed during the work. They are not those of the result, which
# `problem.certificate.certify` computes.
#
# Blocks are solved in batches of neighbouring blocks. Until a batch begins, its lower bound is 0,
# and its upper bound is the cost with nothing assigned.

BlockBrackets = tuple[Mask, Floats, Floats, Floats]
"""Mask of the blocks with bounds; then, for all blocks, the width between the bounds, the cost of
the assignment, and the cost with nothing assigned."""

FINEST = 1e-12
"""Smallest relative gap in the display of progress."""

SUM_MARGIN = 1e-12
"""Part of the cost of leaving all unassigned by which displayed bounds are widened. It is larger
than the rounding of sums in solvers."""


class BracketProgress:
    """Sum of the bounds of all batches; called from several threads.

    Parameters
    ----------
    states : States
        The problem.
    cuts : list of pair of int
        Range of the blocks of each batch.
    progress : Progress
        Receiver of the share that is done and of the bounds.
    """

    def __init__(self, states: States, cuts: list[tuple[int, int]], progress: Progress) -> None:
        self.states, self.cuts, self.progress = states, cuts, progress
        self.shares, self.lower, self.upper = np.zeros((3, len(cuts)))
        self.begun = np.zeros(len(cuts), bool)

    @cached_property
    def unassigned(self) -> Floats:
        """Cost of each batch with all its objects and tracks unassigned."""
        costs = unassigned_costs(self.states)
        return np.array([costs[slice(*span)].sum() for span in self.cuts])

    @cached_property
    def unassigned_total(self) -> float:
        """Cost of the whole problem with nothing assigned."""
        return float(sum(side.price.sum() for side in self.states.problem.sides))

    def update(self, number: int, share: float, lower: float, upper: float) -> None:
        """Report the finished share of a batch, and bounds of its cost minus `unassigned`."""
        self.shares[number], self.lower[number], self.upper[number] = share, lower, upper
        self.begun[number] = True
        if not self.progress.due:
            return
        lower = float(np.where(self.begun, self.lower, -self.unassigned).sum())
        self.progress.prove(
            self.unassigned_total * (1 - SUM_MARGIN) + lower,
            self.unassigned_total * (1 + SUM_MARGIN) + float(self.upper.sum()),
        )
        self.progress.done(float(self._sizes @ self.shares))

    def advance(self, number: int, share: float) -> None:
        """Report the share of a batch that is done, before there are bounds."""
        self.shares[number] = share
        if self.progress.due:
            self.progress.done(float(self._sizes @ self.shares))

    @cached_property
    def _sizes(self) -> Floats:
        """Share of each batch in all states."""
        first = self.states.block_first[[0, *(high for _, high in self.cuts)]]
        sizes: Floats = np.diff(first) / max(len(self.states.begin), 1)
        return sizes


class BatchProgress:
    """Progress of one batch, and its bounds.

    Parameters
    ----------
    whole : BracketProgress
        Progress of all batches.
    number : int
        Number of this batch.
    states, weights : States, (S,) float array
        Blocks of the batch, and their weights.
    quickly : (B,) bool array
        Blocks that are solved only if this takes hardly any time.
    """

    def __init__(
        self,
        whole: BracketProgress,
        number: int,
        states: States,
        weights: Floats,
        quickly: Mask,
    ) -> None:
        self.whole, self.number = whole, number
        self.states, self.weights, self.quickly = states, weights, quickly
        self.known: BlockBrackets | None = None

    def update(
        self,
        blocks: Mask,
        width: Floats,
        cost: Floats,
        unassigned: Floats,
        share: float,
    ) -> None:
        """Report the share that is done, and bounds of some blocks.

        `blocks` (B,) marks the blocks with new bounds. `width` (B,) is the width between the
        bounds, `cost` (B,) the cost of the assignment, and `unassigned` (B,) the cost if nothing is
        assigned. The other blocks are those of `quickly`, whose lower bound is 0, and trivial ones,
        whose weights are the best.
        """
        self.known = blocks, np.maximum(width, 0.0), cost, unassigned
        if self.whole.progress.due:
            self._pass_on(self.known, share)

    def advance(self, share: float) -> None:
        """Report the share that is done, before there are bounds."""
        self.whole.advance(self.number, share)

    def finish(self) -> None:
        """Report that the batch is done."""
        none = np.zeros(len(self.quickly))
        unassigned = unassigned_costs(self.states) if self.quickly.any() else none
        self._pass_on(self.known or (none > 0, none, none, unassigned), 1.0)

    def _pass_on(self, known: BlockBrackets, share: float) -> None:
        blocks, width, cost, unassigned = known
        gained = -_gains(self.states, self.weights)
        upper = np.where(blocks, cost - unassigned, gained)
        rest = np.where(self.quickly, -unassigned, gained)
        lower = np.where(blocks, cost - width - unassigned, rest)
        self.whole.update(self.number, share, float(lower.sum()), float(upper.sum()))


def _gains(states: States, weights: Floats) -> Floats:
    """Return the gain of proposed weights in each block, minus the switch costs, (B,)."""
    block, blocks = states.block, len(states.block_begin)
    arc = np.flatnonzero(states.pair[1:] == states.pair[:-1]) + 1
    paid = states.problem.switch_price_at[states.begin[arc]] * np.abs(np.diff(weights)[arc - 1])
    return sum_by(block, weights * states.gain, blocks) - sum_by(block[arc], paid, blocks)


def share_of_digits(width: float, cost: float, gap: float) -> float:
    """Return how far a width between bounds has come, from 0 to 1, on a logarithmic scale.

    It is 0 if the width is as large as the cost, and 1 if it is at most `gap` times the cost.
    """
    if width <= gap * cost:
        return 1.0
    if not 0.0 < width < cost or gap >= 1.0:
        return 0.0
    return min(float(np.log(width / cost) / np.log(max(gap, FINEST))), 1.0)
