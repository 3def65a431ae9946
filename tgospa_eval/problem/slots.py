"""Slots: stretches of steps of a node on which the states that compete for it do not change.

The assignment over a slot may sum to at most 1.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.problem import sum_parts

PART = 1 << 19
"""States that are looked at together where arrays as long as all states would be too much."""

CROWD, FULL_SUM = 4000, 1 << 61
"""More pairs of a node than this may sum to more than FULL_SUM, where weights are below 2^50."""


def exact_running(value: Floats, first: Ints, *, floor: bool = False) -> tuple[Floats, Ints]:
    """``unit = 2^(e - 62)`` of each part, 2^e > sum |value|; sums of value / unit, (K + 1,).

    Part i begins at first[i]. Differences of the sums of integers are exact, even where the sum
    over all parts overflows, and a small sum never loses its digits to large values far away. With
    `floor` values never become larger (docs/theory/certificate.md, "Rounding").
    """
    size = sum_parts(np.abs(value), first)
    unit = np.ldexp(1.0, np.frexp(np.maximum(size, 1e-270))[1] - 62)
    if kernels:
        sums: Ints = kernels.whole_sums(value, first, unit, floor)
        return unit, sums
    rounded = np.floor if floor else np.rint
    whole = rounded(value / np.repeat(unit, np.diff(first))).astype(np.int64)
    return unit, np.concatenate(([0], np.cumsum(whole)))


def changed(pair_first: Ints, weight: Ints | Floats) -> Mask:
    """Whether the weight of each state differs from that of the state before of its pair."""
    differs = np.zeros(len(weight), bool)
    np.not_equal(weight[1:], weight[:-1], out=differs[1:])
    differs[pair_first[:-1]] = False
    return differs


@dataclass(frozen=True, kw_only=True, eq=False)
class Slots:
    """The capacity constraints on one side, rows or columns.

    Nodes with one pair have none: the bound of the other side implies it. A state covers the slots
    from its own first to the one before the first of the next state of its pair.

    Parameters
    ----------
    first : (nodes + 1,) int array
        First slot of each node; its slots follow in time.
    step : (K,) int array
        First step of each slot.
    begin : (S,) int array
        First slot of each state.
    pair_first, pair_node : (P + 1,), (P,) int arrays
        First state and node of each pair.
    """

    first: Ints
    step: Ints
    begin: Ints
    pair_first: Ints
    pair_node: Ints

    @property
    def node(self) -> Ints:
        """Node of each slot, (K,)."""
        return np.repeat(np.arange(len(self.first) - 1, dtype=np.int32), np.diff(self.first))

    @property
    def end(self) -> Ints:
        """The slot after the last of each state, (S,)."""
        end = np.empty_like(self.begin)
        end[:-1] = self.begin[1:]
        end[self.pair_first[1:] - 1] = self.first[self.pair_node + 1]
        return end

    def touching(self, marked: Mask, chosen: Ints | None = None) -> Mask:
        """Which states, or which of the chosen ones, cover a slot that is marked (K,)."""
        before = np.zeros(len(marked) + 1, np.int32)
        np.cumsum(marked, out=before[1:])
        begin, end = self.begin, self.end
        if chosen is not None:
            begin, end = begin[chosen], end[chosen]
        touching: Mask = before[end] > before[begin]
        return touching

    def sums(self, weight: Ints) -> Ints:
        """Exact sum of the integer weights (S,) of the states over each slot, (K,).

        Weights are >= 0. Sums of nodes with so many pairs that integers could overflow are right
        up to FULL_SUM, and FULL_SUM above that.
        """
        if len(self.pair_node) > CROWD and int(np.bincount(self.pair_node).max()) > CROWD:
            sums = self._sums(weight)
            coarse = self._sums(weight >> 20)
            return np.where(coarse >= FULL_SUM >> 20, FULL_SUM, sums)
        return self._sums(weight)

    def _sums(self, weight: Ints) -> Ints:
        if kernels:
            found: Ints = kernels.slot_sums(
                self.first, self.begin, self.pair_first, self.pair_node, weight
            )
            return found
        return self._accumulate(weight)

    def loads(self, weight: Floats | Mask) -> Floats:
        """`sums` of weights that need not be whole; of booleans, how many are true."""
        weight = weight.astype(np.float64, copy=False)
        if kernels:
            found: Floats = kernels.slot_loads(
                self.first, self.begin, self.pair_first, self.pair_node, weight
            )
            return found
        return self._accumulate(weight)

    def _accumulate(self, weight: NDArray[Any]) -> NDArray[Any]:
        """`sums` and `loads` without kernels."""
        total = np.zeros(len(self.step) + 1, weight.dtype)
        used = np.flatnonzero(weight)
        np.add.at(total, self.begin[used], weight[used])
        np.subtract.at(total, self.end[used], weight[used])
        return np.cumsum(total, out=total)[:-1]

    def running(self, price: Floats, *, floor: bool = False) -> tuple[Floats, Ints]:
        """`exact_running` of prices (K,), node by node."""
        return exact_running(price, self.first, floor=floor)

    def totals(self, price: Floats, chosen: Ints | None = None, *, floor: bool = False) -> Floats:
        """Sum of the prices (K,) over the slots of each state, or of the chosen ones."""
        return self.spans(self.running(price, floor=floor), chosen, floor=floor)

    def spans(
        self, running: tuple[Floats, Ints], chosen: Ints | None = None, *, floor: bool = False
    ) -> Floats:
        """`totals` where the running sums are known; with `floor` no sum is too large."""
        unit, sums = running
        if kernels:
            total: Floats = kernels.spans(
                self.first, self.begin, self.pair_first, self.pair_node, unit, sums, floor
            )
            return total if chosen is None else total[chosen]
        begin, end = self.begin, self.end
        total = np.repeat(unit[self.pair_node], np.diff(self.pair_first))
        if chosen is not None:
            begin, end, total = begin[chosen], end[chosen], total[chosen]
        total *= sums[end] - sums[begin]
        return np.nextafter(total, 0.0) if floor else total


def make_slots(begin: Ints, pair_first: Ints, pair_node: Ints, nodes: int, steps: int) -> Slots:
    """The slots of the nodes that several pairs share; `pair_node` is the node of each pair."""
    shared = np.bincount(pair_node, minlength=nodes) > 1
    if kernels:
        first, step, slot = kernels.slots(
            kernels.in_time(begin, steps), begin, pair_first, pair_node, shared.view(np.uint8)
        )
        return Slots(first=first, step=step, begin=slot, pair_first=pair_first, pair_node=pair_node)
    in_time = np.argsort(begin, kind="stable")
    node = np.repeat(pair_node, np.diff(pair_first))[in_time]
    known = shared[node]
    order = np.flatnonzero(known)[np.argsort(node[known], kind="stable")]
    chosen, node = in_time[order], node[order]
    fresh = np.ones(len(order), bool)
    fresh[1:] = (np.diff(node) != 0) | (np.diff(begin[chosen]) != 0)
    step = begin[chosen[fresh]]
    first = np.searchsorted(node[fresh], np.arange(nodes + 1)).astype(np.int32)
    slot = np.repeat(first[pair_node], np.diff(pair_first))
    slot[chosen] = np.cumsum(fresh) - 1
    return Slots(first=first, step=step, begin=slot, pair_first=pair_first, pair_node=pair_node)
