"""What assignments cost block by block, and the largest switch price that matters."""

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.problem.compiled import kernels
from tgospa_eval.problem.problem import Floats, sum_by
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE, changes, repair

SETTLED_FROM = 1000.0
"""At lower switch prices, what rounding leaves of a switch costs less than 1e-9."""


def price_cap(states: States) -> Floats:
    """``2 L g`` of each block, (B,), L its steps, g its largest gain: higher prices are the same.

    From (L - 1) g on no switch pays (docs/theory/reductions.md, "Switch price cap"). LP tolerances
    are absolute, so huge prices harm.
    """
    blocks, price = len(states.block_begin), states.problem.pair_price
    most: Floats
    if kernels and price is not None:
        most = kernels.largest_gains_of_blocks(
            states.pair_first,
            states.pair_block,
            states.entry,
            states.problem.cost,
            price,
            blocks,
        )
    else:
        first = states.pair_first[np.searchsorted(states.pair_block, np.arange(blocks))]
        most = np.maximum.reduceat(states.gain, first)
    return 2.0 * (states.block_end - states.block_begin + 1) * most


def settle(states: States, blocks: NDArray[np.bool_], weights: Floats) -> None:
    """Average the weights over time for each pair of those blocks where every price was cut.

    There an optimum has no switches, and what a solver leaves of them (1e-12, say) would be charged
    at the true price. The average over time is as feasible as what it averages.
    """
    switch_price = states.problem.switch_price_at
    if switch_price.max() < SETTLED_FROM or not blocks.any():
        return
    spans = zip(states.block_begin.tolist(), states.block_end.tolist(), strict=True)
    least = np.array([switch_price[a + 1 : b + 1].min(initial=np.inf) for a, b in spans])
    held = blocks & (least > price_cap(states)) & np.isfinite(least)
    if not held.any():
        return
    length = (states.end - states.begin + 1).astype(np.float64)
    pair, pairs = states.pair, len(states.pair_row)
    mean = sum_by(pair, weights * length, pairs) / sum_by(pair, length, pairs)
    np.copyto(weights, mean[pair], where=held[states.pair_block[pair]])


def unassigned_costs(states: States) -> Floats:
    """Cost of each block if all its objects stay unassigned, (B,)."""
    total = np.zeros(len(states.block_begin))
    for block, price in zip(states.track_blocks, states.problem.unassigned_costs, strict=True):
        if kernels:
            total += kernels.block_sums(block, price, len(total))
            continue
        mine = np.flatnonzero(block >= 0)
        total += sum_by(block[mine], price[mine], len(total))
    return total


def block_costs(states: States, weights: Floats) -> Floats:
    """``sum W D + A (1 - row sums) + B (1 - column sums) + lambda |W' - W|`` of each block, (B,).

    Of a proposed assignment, once that is made feasible; objects without a pair are left out.
    """
    problem = states.problem
    whole = repair(states, weights)
    blocks = len(states.block_begin)
    of_state = np.repeat(states.pair_block, np.diff(states.pair_first))
    used = np.flatnonzero((states.entry >= 0) & (whole > 0))
    entry, block = states.entry[used], of_state[used]
    total = sum_by(block, whole[used] / ONE * problem.cost[entry], blocks)
    changed, amount = changes(states, whole)
    paid = problem.switch_price_at[states.begin[changed]] * amount
    total += sum_by(of_state[changed], paid, blocks)
    for side, blocks_of in zip(problem.sides, states.track_blocks, strict=True):
        free = np.full(len(side.track), ONE)
        np.subtract.at(free, side.row[entry], whole[used])
        at = blocks_of[side.track]
        price = free / ONE * side.price
        total += sum_by(at[at >= 0], price[at >= 0], blocks)
    return total


def better(states: States, first: Floats, second: Floats) -> Floats:
    """Block by block the better of two proposed assignments."""
    wins = block_costs(states, second) < block_costs(states, first)
    return np.where(wins[states.pair_block[states.pair]], second, first)
