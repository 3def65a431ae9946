"""Best values of the rows up to each step, from above: one pass of Viterbi, forward in time.

Values are relative to the cheapest pair of each row and step, as in `problem.paths`.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.paths import down, up
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.problem.states import States


@dataclass(frozen=True, kw_only=True, eq=False)
class Offsets:
    """The cheapest entry of each row and step that has one, and gains relative to it.

    Parameters
    ----------
    step, row : (G,) int arrays
        Step, and row as a node; sorted.
    entry : (G,) int array
        The cheapest entry.
    loss : (G,) float array
        What all lose that are in another state or in none: lower bounds of the gain of the entry.
    relative : (S,) float array
        Gain of each state less that, an upper bound; 0 of runs.
    """

    step: Ints
    row: Ints
    entry: Ints
    loss: Floats
    relative: Floats


def offsets(states: States) -> Offsets:
    """Of all states."""
    problem, pair = states.problem, states.pair
    gaining = np.flatnonzero(states.entry >= 0)
    row = states.pair_row[pair[gaining]].astype(np.int64)
    key = states.begin[gaining] * np.int64(states.nodes) + row
    order = np.argsort(key, kind="stable")
    gaining, key = gaining[order], key[order]
    opens = np.flatnonzero(np.diff(key, prepend=-1))
    at = np.repeat(np.arange(len(opens)), np.diff(opens, append=len(key)))
    entry = states.entry[gaining].astype(np.intp)
    cost = problem.cost[entry]
    least = np.minimum.reduceat(cost, opens) if len(opens) else cost
    least_at = np.flatnonzero(cost == least[at])
    cheapest = entry[least_at[np.flatnonzero(np.diff(at[least_at], prepend=-1))]]
    gain = up(least[at] - cost)
    bases = [side.price[side.row] for side in problem.sides]
    for base in bases:
        gain = up(gain + up(base[entry] - base[cheapest][at]))
    of_cheapest = [base[cheapest] for base in bases]
    loss = np.maximum(down(down(of_cheapest[0] + of_cheapest[1]) - least), 0.0)
    relative = np.zeros(len(pair))
    relative[gaining] = gain
    step, node = np.divmod(key[opens], states.nodes)
    return Offsets(step=step, row=node, entry=cheapest, loss=loss, relative=relative)


@dataclass(frozen=True, kw_only=True, eq=False)
class Moves:
    """What happens to rows, in order of time: states begin, prices are paid, offsets are lost.

    Rows and pairs are those that `Moves.of` was given, numbered in order; times are any numbers
    from 0 on.

    Parameters
    ----------
    rows : (R,) int array
        The nodes.
    first : (R,) int array
        First pair of each row.
    row : (P,) int array
        Row of each pair.
    begins, begin_pair, gains, relative, switch_price : arrays
        Where the states of each time begin in the others, and of each state that begins its pair,
        whether it has a gain, its relative gain, and what entering or leaving costs.
    charges, charge_pair, charge : arrays
        The same of prices that pairs pay.
    losses, loss_row, loss : arrays
        The same of offsets.
    """

    rows: Ints
    first: Ints
    row: Ints
    begins: Ints
    begin_pair: Ints
    gains: NDArray[np.bool_]
    relative: Floats
    switch_price: Floats
    charges: Ints
    charge_pair: Ints
    charge: Floats
    losses: Ints
    loss_row: Ints
    loss: Floats

    @classmethod
    def of(
        cls, states: States, found: Offsets, prices: Floats, since: Ints | None = None
    ) -> "Moves":
        """Of all states at prices (K,).

        Times are steps less `since` (T,), where that is given; what is before time 0 is left out.
        """
        steps = states.problem.steps
        time_of = np.arange(steps) - (np.zeros(steps, np.int64) if since is None else since)
        times = int(time_of.max(initial=-1)) + 1
        edges = np.arange(times + 1)
        rows, first, row = np.unique(states.pair_row, return_index=True, return_inverse=True)
        pair = states.pair

        time = time_of[states.begin]
        order = np.argsort(time, kind="stable")
        order = order[np.searchsorted(time[order], 0) :]
        begins = np.searchsorted(time[order], edges)

        slots = states.columns
        costly = np.flatnonzero(prices > 0)
        of_slot = np.full(len(prices) + 1, len(costly))
        of_slot[:-1] = np.searchsorted(costly, np.arange(len(prices)))
        low, high = of_slot[slots.begin], of_slot[slots.end]
        slot = costly[concatenated(low, high - low)]
        charged = np.repeat(pair, high - low)
        paid_at = time_of[slots.step[slot]]
        by_time = np.argsort(paid_at, kind="stable")
        by_time = by_time[np.searchsorted(paid_at[by_time], 0) :]

        lost_at = time_of[found.step]
        by_loss = np.argsort(lost_at, kind="stable")
        by_loss = by_loss[np.searchsorted(lost_at[by_loss], 0) :]
        return cls(
            rows=rows,
            first=first,
            row=row,
            begins=begins,
            begin_pair=pair[order],
            gains=states.entry[order] >= 0,
            relative=found.relative[order],
            switch_price=states.problem.switch_price_at[states.begin[order]],
            charges=np.searchsorted(paid_at[by_time], edges),
            charge_pair=charged[by_time],
            charge=prices[slot[by_time]],
            losses=np.searchsorted(lost_at[by_loss], edges),
            loss_row=np.searchsorted(rows, found.row[by_loss]),
            loss=found.loss[by_loss],
        )

    @property
    def times(self) -> int:
        """How many there are."""
        return len(self.begins) - 1


def forward(
    moves: Moves, unassigned: Floats, reached: Floats, others: Floats | None = None
) -> Iterator[Floats]:
    """Upper bound of the best value of each row (R,), after each time; updates what it is given.

    A run without gain may be left only where its next state begins.

    Parameters
    ----------
    moves : Moves
        What happens.
    unassigned, reached : (R,), (P,) float arrays
        Best value of each row at "none" before, and that of each pair.
    others : (R,) float array, optional
        Best value of each row in states to which nothing happens.
    """
    for time in range(moves.times):
        own = slice(moves.begins[time], moves.begins[time + 1])
        lost = slice(moves.losses[time], moves.losses[time + 1])
        paid = slice(moves.charges[time], moves.charges[time + 1])
        at = moves.begin_pair[own]
        if len(at):
            row = moves.row[at]
            price = moves.switch_price[own]
            before = reached[at]
            np.maximum.at(unassigned, row, up(before - price))
            reached[at] = np.maximum(before, up(unassigned[row] - price))
        if lost.stop > lost.start:
            lose = np.zeros(len(unassigned))
            lose[moves.loss_row[lost]] = moves.loss[lost]
            spare = lose[moves.row]
            spare[at[moves.gains[own]]] = 0.0
            np.copyto(reached, up(reached - spare), where=spare > 0)
            np.copyto(unassigned, up(unassigned - lose), where=lose > 0)
            if others is not None:
                np.copyto(others, up(others - lose), where=lose > 0)
        if len(at):
            reached[at] = up(reached[at] + moves.relative[own])
        if paid.stop > paid.start:  # a pair has one slot that begins here
            charging = moves.charge_pair[paid]
            reached[charging] = up(reached[charging] - moves.charge[paid])
        best = np.maximum(unassigned, np.maximum.reduceat(reached, moves.first))
        yield best if others is None else np.maximum(best, others)
