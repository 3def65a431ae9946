"""Prices and assignments that improve in stages of sweeps, with both bounds after each stage.

Each stage (`solvers` explains sweeps) changes the prices of the columns, rounds the masses to an
assignment, and computes both bounds. The upper bound of the gain, which the prices v prove, is
called *dual*. The gain of the assignment W is called *primal*. The width between them is
(docs/theory/certificate.md)

    Z(v) - P(W) = sum_i (best_i - own_i) + sum_r v_r (1 - load_r).

The first sum is over rows i. At the prices v, best_i is the value of the best path of row i, and
own_i is the value of its weights W. The difference is the *regret* of the row. The second sum is
over column slots r. It is not 0 if slots that have a price are not full.

These bounds only steer the solvers. `problem.certificate` computes the reported bounds again. The
other words and the letters of array sizes are in `solvers`.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated
from tgospa_eval.kernels import REGRET, kernels
from tgospa_eval.problem.problem import sum_by, sum_parts
from tgospa_eval.problem.states import States, connected_components
from tgospa_eval.solvers.block_costs import price_cap, unassigned_costs
from tgospa_eval.solvers.trivial import assign_steps
from tgospa_eval.solvers.tuning import ASCENT

LINKS_EACH, FEWEST_LINKS, MIN_THRESHOLD = 8, 100_000, 1e-3
"""Limits of the length of a chain. A *chain* (`kernels.Chain`) is the array on which sweeps work.
For each row, and each step at which the options of the row change, it has a *link* for each state
of the working set that the row can be in.

A chain may have LINKS_EACH links for each state of the problem, or FEWEST_LINKS if that is more. If
it would be longer, the threshold of the working set (`Ascent.stage`) is halved. Below
MIN_THRESHOLD, a chain may have any length."""

SWEPT_AT_ONCE = 100_000
"""Number of links times sweeps between two looks at the clock: about a millisecond of work."""

PRICE_ROUNDING = 8 * 2.0**-53
"""Rounding error of a sum of prices along a path, as a fraction of the sum of all prices. The
kernels keep each sum in two doubles, and sum only what differs from the path that is always at
"none". So this error does not grow with the length of a recording."""


class Ascent:
    """Prices, assignments and both bounds of some blocks on the way to the optimum.

    From each gain, the gain of the cheapest pair of the same row and step is subtracted. So small
    costs keep their digits. For this reason, gains and values have no meaning outside this class.
    Costs and widths between bounds have one.

    Parameters
    ----------
    states : States
        The blocks.
    wanted : (B,) bool array
        Blocks that take part at first; `keep` excludes blocks later.
    gap : float
        Relative gap at which no further weights and prices are tried.
    weights, prices : (S,), (K,) float arrays
        Arrays for the best assignment and the best prices. Only the wanted blocks are changed. In
        these blocks, weights must be zeros at first, and `prices` has the initial prices.

    Attributes
    ----------
    soft : (K,) float array
        Prices of the sweeps.
    masses : (S,) float array
        Mass of each state at the end of the last stage.
    dual, primal : (B,), (B,) float arrays
        Both bounds of the gain of each block.
    unassigned_cost : (B,) float array
        Cost of leaving all objects and tracks unassigned.
    flags : (S,) uint8 array
        Bits that the last `mark` set for each state: NEAR (the slack is at most the reach), NEEDED
        (being at "none" when the state begins would cost the row more than the reach), LOSES (the
        slack is more than rounding), BEST (the state is on the best path of its row) and TEMPTED
        (there is hardly any slack).
    work : int
        Number of states, including "none", summed over all half sweeps.
    sweeping : float
        Seconds of sweeps.
    seconds : dict
        Seconds by kind of work.
    open : (B,) bool array
        Blocks that still take part.
    """

    def __init__(
        self, states: States, wanted: Mask, gap: float, weights: Floats, prices: Floats
    ) -> None:
        self.states, self.wanted_gap = states, gap
        self.weights, self.prices = weights, prices
        blocks = len(states.block_begin)
        # LP tolerances are absolute, so huge prices harm: see `price_cap`.
        self.switch_price = np.minimum(
            states.problem.switch_price_at, price_cap(states)[wanted].max()
        )
        price = states.problem.weight(slice(None))  # one number for all entries, or one for each
        both = (price, None) if isinstance(price, float) else (0.0, price)
        self.layout = kernels.Layout(states, self.switch_price, *both)
        self.work, self.sweeping = 0, 0.0
        self.seconds = {"sweeps": 0.0, "rounding": 0.0, "bounds": 0.0}

        self.open = wanted
        self.layout.keep(wanted.view(np.uint8))
        self.brackets = kernels.Brackets(self.layout, weights, prices, PRICE_ROUNDING)
        self.flags: NDArray[np.uint8] = self.brackets.flags
        self.best, self.own = self.brackets.best, self.brackets.own
        self.dual, self.primal = self.brackets.dual, self.brackets.primal
        self.unassigned_cost = unassigned_costs(states)
        taken_off = sum_parts(self.layout.offset, self.layout.group_first)
        self.base_cost = self.brackets.most
        self.base_cost[:] = self.unassigned_cost - sum_by(states.node_block, taken_off, blocks)
        self.soft = np.zeros(len(prices))
        self.masses = np.zeros(len(weights), np.float32)
        self.mark(prices, 0.0)
        self.dual[:] = self.brackets.bound(prices)
        self.primal[wanted] = -np.inf
        self.brackets.round(0)

    def keep(self, blocks: Mask) -> None:
        """Continue with these blocks only."""
        if blocks.tobytes() == self.open.tobytes():
            return
        self.open = blocks
        self.layout.keep(blocks.view(np.uint8))

    @property
    def gap(self) -> Floats:
        """Width between the bounds of each block, (B,)."""
        gap: Floats = self.dual - self.primal
        return gap

    @property
    def cost(self) -> Floats:
        """Cost of the best assignment of each block, (B,)."""
        cost: Floats = np.maximum(self.base_cost - self.primal, 0.0)
        return cost

    @property
    def open_dual(self) -> float:
        """Sum of `dual` over the open blocks."""
        return float(self.brackets.open_dual)

    @property
    def open_gap(self) -> float:
        """Sum of the widths between the bounds of the open blocks."""
        return float(self.brackets.open_gap)

    @property
    def open_cost(self) -> float:
        """Sum of the costs of the best assignments of the open blocks."""
        return float(self.brackets.open_cost)

    @property
    def undecidedness(self) -> float:
        """Mean of 1 - m over all states, weighted by m, the `masses` of the last stage."""
        total = float(self.masses.sum(dtype=np.float64))
        return 1.0 - float(np.square(self.masses).sum(dtype=np.float64)) / max(total, 1.0)

    @property
    def located_cost(self) -> float:
        """Mean cost of the pairs with a weight above 1/2; 1 if there are none."""
        entry = self.states.entry[self.weights > 0.5]
        costs = self.states.problem.cost[entry[entry >= 0]]
        return float(costs.mean()) if len(costs) else 1.0

    def wide(self, gap: float | None = None) -> Mask:
        """Return the open blocks with a relative gap above `gap`, by default the wanted gap."""
        wide: Mask = self.brackets.wide(self.wanted_gap if gap is None else gap)
        return wide

    def mark(self, prices: Floats, reach: float) -> None:
        """Set the `flags` of all states, and `best` and `own` of all rows, at the given prices.

        NEAR states have a slack of at most `reach`.
        """
        self.brackets.mark(prices, reach)

    def has(self, flag: int) -> Mask:
        """Return for each state whether the last `mark` set this flag, (S,)."""
        return (self.flags & flag) > 0

    def try_prices(self, prices: Floats) -> None:
        """Keep the prices in the open blocks in which they lower `dual`."""
        self.brackets.try_prices(prices)

    def try_weights(self, weights: Floats) -> None:
        """Keep the feasible weights in the open blocks in which they raise `primal`."""
        self.brackets.try_weights(weights)

    def try_steps(self) -> None:
        """Try the prices and the assignment that are best if switches are free."""
        weights, prices = np.zeros(len(self.weights)), np.zeros(len(self.prices))
        assign_steps(self.states, self.open, weights, prices)
        self.try_prices(prices)
        self.try_weights(weights)

    def stage(
        self,
        epsilon: float,
        sweeps: int,
        threshold: float,
        late: Callable[[], bool],
        calm: float = 0.0,
    ) -> tuple[int, float]:
        """Sweep at the temperature `epsilon`, and then try the new weights and prices.

        The working set has the states with a slack up to `threshold`, and the states with a weight.
        After a sweep, the mass in a column slot and its unused part should sum to 1. The
        *violation* of the slot is how far the sum is from 1. Sweeps end early if the largest
        violation is less than `calm`.

        Returns
        -------
        sweeps : int
            Number of sweeps.
        violation : float
            Largest violation in the last sweep.
        """
        begin = time.perf_counter()
        chain = self._chain(threshold)
        chain.heat(epsilon)
        hot = time.perf_counter()
        done, violation = 0, np.inf
        while done < sweeps:
            at_once = min(1 + SWEPT_AT_ONCE // max(chain.links, 1), sweeps - done)
            more, violation = chain.sweep(at_once, calm)
            done += more
            if violation < calm or late():
                break
        self.work += 2 * done * (chain.links + chain.nodes)
        self.sweeping += time.perf_counter() - hot
        self.masses[:] = 0.0
        chain.write_masses(self.masses, self.flags)
        chain.cool(epsilon)
        chain.write_prices(self.soft)
        del chain  # the chain is the largest array
        rounded = time.perf_counter()
        self.brackets.round(2)
        checked = time.perf_counter()
        for share in ASCENT.thresholds:
            if not self.brackets.try_above(self.soft, share * epsilon, self.wanted_gap):
                break
        else:
            self._thin_out()
        end = time.perf_counter()
        self.seconds["sweeps"] += rounded - begin
        self.seconds["rounding"] += checked - rounded
        self.seconds["bounds"] += end - checked
        return done, float(violation)

    def _thin_out(self) -> None:
        """If a width is mostly rounding, try the price 0 in slots with at most one NEAR state.

        No states compete for such a slot, so a larger price would prove no more. But sums of large
        prices lose digits.
        """
        if self.brackets.only_rounding(self.wanted_gap):
            self.mark(self.prices, float(self.prices.max()))
            rivals = self.states.columns.loads(self.has(kernels.NEAR))
            self.try_prices(np.where(rivals > 1, self.prices, 0.0))

    def _chain(self, threshold: float) -> Any:
        """Return the chain of the working set, or of a smaller one if it is too long."""
        max_links = max(LINKS_EACH * len(self.states.begin), FEWEST_LINKS)
        while True:
            self.brackets.choose(self.soft, threshold)
            chain = kernels.Chain(self.layout, self.brackets.chosen, self.soft, max_links)
            if chain.links <= max_links:
                return chain
            if threshold < MIN_THRESHOLD:  # many equal slacks: the set does not become smaller
                max_links = chain.links
            threshold *= 0.5

    def full(self) -> Mask:
        """Return whether each column slot is full in the best assignment, (K,)."""
        return self.states.columns.loads(self.weights) > 1 - 1e-9

    def near(self, also: Mask) -> Mask:
        """Return a mask of the states that a programme may have to decide, (S,); first call `mark`.

        These are the NEAR states, the states with a weight, and those of the mask `also`, except
        decided states. A state is *decided* if it has the weight 1, is NEEDED, and no other of
        these states belongs to its row at its steps.
        """
        rows = self.states.rows
        near = self.has(kernels.NEAR)
        near |= self.weights > 0
        near |= also
        near &= self.states.states_of(self.open)
        decided = ~rows.touching(rows.loads(near) > 1)
        decided &= self.weights > 1 - 1e-9
        decided &= self.has(kernels.NEEDED)
        near &= ~decided
        return near

    def within(self, near: Mask, steps: Mask) -> Mask:
        """Return a mask of the near states that exist at one or more of the `steps` (T,)."""
        count = np.concatenate(([0], np.cumsum(steps)))
        lasting = near.copy()
        lasting &= count[self.states.end + 1] > count[self.states.begin]
        return lasting

    def losses(self, prices: Floats) -> Floats:
        """Divide the width between the bounds of the open blocks among the steps, (T,).

        The width is that of the best weights and the given prices. The price of a slot that is not
        full counts at the first step of the slot. The regret of a row is split: each part counts at
        the first step after which the row cannot avoid it.
        """
        s = self.states
        lost = np.zeros(s.problem.steps + 1)
        self.brackets.regrets(prices, lost)
        idle = prices * np.maximum(1.0 - s.columns.loads(self.weights), 0.0)
        idle *= s.slots_of(self.open)
        lost += sum_by(s.columns.step, idle, len(lost))
        return lost[:-1]

    def undecided(self, near: Mask) -> tuple[Ints, Ints]:
        """Return the states of undecided components, and the component of each state.

        Here a *component* is a set of near states that are connected. Two states are connected if
        they share a slot or follow each other in one pair. A *seed* is a state at which the width
        between the bounds arises (`_seeds`). A component with a seed is *undecided*.
        """
        free = np.flatnonzero(near)
        component = self._components(free)
        wanted = np.zeros(int(component.max(initial=0)) + 1, bool)
        wanted[component[self._seeds(free)]] = True
        wanted = wanted[component]
        return free[wanted], component[wanted]

    def _seeds(self, free: Ints) -> Mask:
        """Return a mask of the free states that are seeds.

        A state is a seed if it covers a column slot that has a price but is not full. In a row with
        regret it is also a seed in three cases: it has a weight and LOSES; its weight differs from
        that of a neighbour in its pair; or it is BEST and its weight is below 1.
        """
        s = self.states
        regret = np.zeros(s.nodes, bool)
        rows = self.layout.rows
        regret[rows] = (self.best - self.own)[rows] > REGRET
        weights, flags = self.weights[free], self.flags[free]
        pair = s.pairs_of(free)
        seed: Mask = (weights > 0) & (flags & kernels.LOSES > 0)
        for near, inside in (
            (free - 1, free > s.pair_first[pair]),
            (free + 1, free + 1 < s.pair_first[pair + 1]),
        ):
            seed |= inside & (weights != self.weights[np.where(inside, near, 0)])
        seed |= (flags & kernels.BEST > 0) & (weights < 1)
        seed &= regret[s.pair_row[pair]]
        seed |= s.columns.touching((self.prices > REGRET) & ~self.full(), free)
        return seed

    def _components(self, free: Ints) -> Ints:
        """Return the index of the component of each free state (`undecided`)."""
        s = self.states
        pair = s.pairs_of(free)
        size = len(free)
        joined = np.flatnonzero((np.diff(free) == 1) & (np.diff(pair) == 0))
        nodes = size
        one: list[Ints] = [joined]
        other: list[Ints] = [joined + 1]
        for slots in (s.rows, s.columns):
            begin = slots.begin[free]
            length = slots.end[free] - begin
            one.append(np.repeat(np.arange(size), length))
            other.append(nodes + concatenated(begin, length))
            nodes += len(slots.step)
        component = connected_components(np.concatenate(one), np.concatenate(other), nodes)
        return component[:size]
