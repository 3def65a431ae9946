"""Prices of leaving objects unassigned, as the certificate adds them up: rounded down."""

import numpy as np

from tgospa_eval.problem.paths import down, lower_sums
from tgospa_eval.problem.problem import Floats
from tgospa_eval.problem.states import States


class UnassignedPrices:
    """Prices of leaving the objects of each block unassigned."""

    def __init__(self, states: States) -> None:
        problem = states.problem
        self.sides = []
        for side, blocks_of in zip(problem.sides, states.track_blocks, strict=True):
            self.sides.append((blocks_of[side.track], side.price))
        self.alike = problem.object_prices
        if self.alike is not None:
            blocks = len(states.block_begin)
            self.counts = [
                np.bincount(block[block >= 0], minlength=blocks) for block, _ in self.sides
            ]
        else:
            self.order = [np.argsort(block, kind="stable") for block, _ in self.sides]

    def prices(self, block: int) -> list[float]:
        """The price of each object of a block at each step."""
        found: list[float] = []
        for (of_row, price), order in zip(self.sides, self.order, strict=True):
            low, high = np.searchsorted(of_row, (block, block + 1), sorter=order)
            found += price[order[low:high]].tolist()
        return found

    def sums(self, blocks: slice, pairs: Floats) -> list[list[float]]:
        """Terms of the sum over some blocks of all prices but those of so many pairs each.

        Rounded down; for objects that are alike on either side.
        """
        first, second = self.alike or (0.0, 0.0)
        truths, estimates = (count[blocks] - pairs for count in self.counts)
        if first == second:
            return [[part] for part in down(first * (truths + estimates)).tolist()]
        parts = down(first * truths), down(second * estimates)
        return [list(of) for of in zip(*(part.tolist() for part in parts), strict=True)]


def unpaired_prices(states: States) -> tuple[float, float]:
    """Cost of the truths and of the estimates that are in no block, rounded down."""
    found = []
    for side, blocks in zip(states.problem.sides, states.track_blocks, strict=True):
        unpaired = blocks < 0
        price = side.price[unpaired[side.track]] if unpaired.any() else side.price[:0]
        found.append(float(lower_sums(price, np.array([0, len(price)]))[0]) if len(price) else 0.0)
    return found[0], found[1]
