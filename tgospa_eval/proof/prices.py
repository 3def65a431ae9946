"""From the prices of the solver to prices of using an estimate at a step, as whole numbers.

A checker that knows no reduction needs one kind of price: v_j(k) >= 0 of the estimate j at the step
k, at the cutoff of the user. Three things differ in a `Solution`.

- A price of a slot is paid once, by whoever holds the estimate in it. It is put on the first step
  of the slot: within a slot nothing gains, so nobody enters between two of its steps.
- Blocks of a single estimate and several truths have the estimate as their row, and no prices.
  Those that make the other form tight follow from its value function: let V_k(i) be the most that
  the estimate can gain after the step k if it is with the truth i then, V_k(0) if with none. Then
  v(k) = V_{k-1}(0) - V_k(0), and at the first gain max(V_k(0), max_i G_i + V_k(i)) - V_k(0).
  Proof: G_i(k) + V_k(i) <= V_{k-1}(i), so with a_i(k) = V_k(i) - V_k(0), |a_i| <= L, each truth
  gains at most the sum of G_i(k) - v(k) + a_i(k) - a_i(k-1) <= 0; and the prices sum to the
  optimum.
- Blocks at a smaller cutoff price s: with the prices v' there and the vertex cover (y, z) of
  `problem.reduced`, v = s v' + (1 - s) z. Proof: a gain is G <= s G' + (1 - s) (y + z), so each
  truth gains at most what it does there, and (1 - s) y.
"""

import itertools
import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.problem.certificate import fair_prices, lower_bounds, of_whole
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.problem.reduced import vertex_cover
from tgospa_eval.problem.solution import Reduced
from tgospa_eval.problem.states import States

Prices = Counter[tuple[int, int]]
"""Price by estimate and step, in units of 2^-bits c^p."""

SPARE_BITS = 55
"""All that is cut off prices together is 2^-SPARE_BITS of the lower bound: it leaves half of the
rounding that the bound allows for."""


def price_bits(states: States, lower: float) -> int:
    """Binary digits that prices need to prove a lower bound, in units of c^p."""
    many = len(states.begin) + len(states.columns.step)
    return SPARE_BITS + max(math.frexp(many / lower)[1] if lower > 0 else 0, 0)


def estimate_prices(
    states: States, prices: Floats, reduced: tuple[Reduced, ...], bits: int
) -> Prices:
    """Prices that prove what the certificate has proven, in units of 2^-bits c^p."""
    blocks = len(states.block_begin)
    part_of = np.full(blocks, -1)
    best = np.full(blocks, -np.inf)
    for number, part in enumerate(reduced):
        inner = lower_bounds(part.states, part.solution.prices, part.solution.reduced)
        bound = np.where(part.blocks, of_whole(states, part, inner), -np.inf)
        part_of[bound > best] = number
        best = np.maximum(best, bound)
    found = _of_slots(states, prices, part_of < 0, bits)
    for block in np.flatnonzero(states.transposed & (part_of < 0)).tolist():
        found.update(_of_single_estimate(states, block, bits))
    home = states.track_blocks[1]
    for number, part in enumerate(reduced):
        chosen = part_of == number
        below = bits + int(np.log2(part.scale))  # a power of 2
        inner_prices = (
            estimate_prices(part.states, part.solution.prices, part.solution.reduced, below)
            if below > 0
            else Counter()
        )
        rest = (1 << bits) - (1 << max(below, 0))
        for row in np.flatnonzero(vertex_cover(states, chosen)[1]).tolist():
            place = states.problem.estimate_track[row], states.problem.estimate_step[row]
            inner_prices[int(place[0]), int(place[1])] += rest
        found.update({place: v for place, v in inner_prices.items() if chosen[home[place[0]]]})
    return found


def _of_slots(states: States, prices: Floats, chosen: NDArray[np.bool_], bits: int) -> Prices:
    """Prices of slots at their first steps, as the certificate uses them."""
    columns = states.columns
    unit, running = columns.running(fair_prices(prices))
    whole = np.diff(running)
    estimate = np.zeros(states.nodes, np.int64)
    estimate[states.pair_column] = states.pair_estimate
    node = columns.node
    used = np.flatnonzero((whole > 0) & (chosen & ~states.transposed)[states.node_block[node]])
    exponent = np.frexp(unit[node[used]])[1] - 1 + bits
    return Counter(
        {
            (track, step): value << shift if shift >= 0 else value >> -shift
            for track, step, value, shift in zip(
                estimate[node[used]].tolist(),
                columns.step[used].tolist(),
                whole[used].tolist(),
                exponent.tolist(),
                strict=True,
            )
        }
    )


def _of_single_estimate(states: States, block: int, bits: int) -> Prices:
    """Prices of the estimate of a block that has no other, from its value function."""
    problem = states.problem
    pairs = slice(*np.searchsorted(states.pair_block, (block, block + 1)).tolist())
    entry: Ints = states.entry[slice(*states.pair_first[[pairs.start, pairs.stop]].tolist())]
    entry = entry[entry >= 0]
    entry = entry[np.argsort(-problem.entry_step[entry], kind="stable")]
    steps = problem.entry_step[entry].tolist()
    truths = problem.truth_track[problem.truth_row[entry]].tolist()
    gains = [(1 << bits) - _whole(cost, bits) for cost in problem.cost[entry].tolist()]
    change = _whole(float(np.max(problem.switch_price, initial=0.0)), bits)
    estimate = int(states.pair_estimate[pairs.start])
    found: Prices = Counter()
    value: dict[int, int] = {}  # V of each truth, where it is more than that of none less `change`
    unassigned = 0
    for step, group in itertools.groupby(zip(steps, truths, gains, strict=True), lambda at: at[0]):
        best = unassigned
        for _, truth, gain in group:
            value[truth] = gain + max(value.get(truth, 0), unassigned - change)
            best = max(best, value[truth] - change)
        if step == steps[-1]:  # the first gain: whoever is there before is so at no cost
            best = max(best, *value.values())
        found[estimate, step] = best - unassigned
        unassigned = best
    return found


def _whole(value: float, bits: int) -> int:
    """A double in units of 2^-bits, rounded down."""
    numerator, denominator = value.as_integer_ratio()
    return (numerator << bits) // denominator
