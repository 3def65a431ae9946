"""Rounds of linear programmes that choose the weights which sweeps leave undecided.

Sweeps give prices and an assignment that are nearly the best. The best paths of most rows are then
known. A programme (`solvers.restricted_lp`) chooses the weights of the remaining states together.
These states are found in each round as follows:

- A state is *near* if it has a weight, or a slack up to the reach of the round. As a rule, the
  reach grows from round to round.
- Near states that share a slot, or follow each other in one pair, are in one *component*.
- A component is *undecided* if the width between the bounds arises in it (`Ascent.undecided`). Only
  the states of undecided components are *free*; all others keep their weights.

A programme does not show that its weights are the best of the whole problem. The bounds show this,
because they are computed on all states. In a *crowd* very many states stay undecided, and the best
weights are mostly fractions. There an interior point method replaces the simplex method.

Without compiled kernels, each block is one linear programme, solved by HiGHS. Sweeps in NumPy would
take longer, and prove less. Other words and letters: `solvers`.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, Mask, concatenated
from tgospa_eval.common.progress import Limit, Status, StoppedError
from tgospa_eval.kernels import kernels
from tgospa_eval.problem.states import ONE, States, make_slots, repair
from tgospa_eval.solvers.batches import Answer, BlockBatch
from tgospa_eval.solvers.block_costs import better, price_cap, share_of_digits
from tgospa_eval.solvers.dual_ascent import Ascent
from tgospa_eval.solvers.trivial import best_paths
from tgospa_eval.solvers.tuning import CROWDS, PROGRAMMES, WINDOWS

if TYPE_CHECKING:
    from tgospa_eval.solvers.restricted_lp import Proposal


def extract(states: States, free: Ints) -> tuple[States, Ints, Ints, Ints]:
    """Return the part of a problem around some free states; `free` must be sorted.

    Returns
    -------
    states : States
        The part. It has all pairs that share a row or a column with a free state. Its steps begin
        one step before the first free state, and end one step after the last.
    state : (S',) int array
        Index in the whole problem of each state of the part.
    free : (F,) int array
        Indices of the free states in the part.
    slot : (K',) int array
        Index in the whole problem of each column slot of the part. In a column without free states,
        the slots of the part and these indices have no meaning.
    """
    pair = states.pairs_of(free)
    touched = np.zeros(states.nodes, bool)
    touched[states.pair_row[pair]] = touched[states.pair_column[pair]] = True
    pairs = np.flatnonzero(touched[states.pair_row] | touched[states.pair_column])
    before = int(states.begin[free].min()) - 1
    after = int(_ends(states, free, pair).max()) + 1
    home = states.pair_block[pairs]
    opens = np.maximum(before, states.block_begin[home])
    ranges = states.pair_first[pairs], states.pair_first[pairs + 1]
    low = np.maximum(_last_until(states.begin, *ranges, opens), ranges[0])
    high = np.maximum(_last_until(states.begin, *ranges, np.full(len(pairs), after)), low) + 1
    first = np.concatenate(([0], np.cumsum(high - low))).astype(np.int32)
    state = concatenated(low, high - low)
    begin = states.begin[state]
    begin[first[:-1]] = np.maximum(begin[first[:-1]], opens)

    nodes = np.unique(np.concatenate((states.pair_row[pairs], states.pair_column[pairs])))
    blocks = np.unique(home)
    row, column, block = (
        np.searchsorted(known, what).astype(np.int32)
        for known, what in (
            (nodes, states.pair_row[pairs]),
            (nodes, states.pair_column[pairs]),
            (blocks, home),
        )
    )
    columns = make_slots(begin, first, column, len(nodes), states.problem.steps)
    piece = States(
        problem=states.problem,
        pair_row=row,
        pair_column=column,
        pair_block=block,
        pair_first=first,
        pair_truth=states.pair_truth[pairs],
        pair_estimate=states.pair_estimate[pairs],
        begin=begin,
        entry=states.entry[state],
        columns=columns,
        node_block=np.searchsorted(blocks, states.node_block[nodes]).astype(np.int32),
        block_begin=np.maximum(states.block_begin[blocks], before),
        block_end=np.minimum(states.block_end[blocks], after),
        transposed=states.transposed[blocks],
    )
    # In a column with free states, the part has the same slots as the whole problem.
    place = states.columns.first
    opens = np.maximum(before, states.block_begin[states.node_block[nodes]])
    base = _last_until(states.columns.step, place[nodes], place[nodes + 1], opens)
    at = concatenated(base, np.diff(columns.first))
    slot = np.clip(at, 0, max(len(states.columns.step) - 1, 0))
    return piece, state, np.searchsorted(state, free), slot


def _ends(states: States, chosen: Ints, pair: Ints) -> Ints:
    """Return the last step of each chosen state; `pair` has their pairs."""
    following = np.minimum(chosen + 1, len(states.begin) - 1)
    goes_on = chosen + 1 < states.pair_first[pair + 1]
    return np.where(goes_on, states.begin[following] - 1, states.block_end[states.pair_block[pair]])


def _last_until(step: Ints, low: Ints, high: Ints, until: Ints) -> Ints:
    """Return the last index with a step <= `until` in each range from `low` to `high` - 1.

    Steps must increase in each range. The result is `low` - 1 if all steps of a range are later.
    """
    low, high = low.astype(np.int64), high.astype(np.int64)
    while True:
        going = np.flatnonzero(low < high)
        if not len(going):
            return low - 1
        middle = (low[going] + high[going]) // 2
        right = step[middle] <= until[going]
        low[going] = np.where(right, middle + 1, low[going])
        high[going] = np.where(right, high[going], middle)


T = TypeVar("T")
Solved = tuple[Ints, Ints, "Proposal"]
"""Answer of a programme: indices in the whole problem of its free states and of its column slots
with a price, and the proposal for them."""


class Programmes:
    """Linear programmes that improve the best weights and prices so far, which an `Ascent` keeps.

    Attributes
    ----------
    iterations, seconds : int, float
        Iterations of HiGHS, and time of all programmes so far.
    crowd : bool
        True if the problem is a crowd, so that the simplex method would take too long.
    unit : float
        Unit of costs and reaches, in c^p: less than 1 if the gaps are small.
    tempted : (S,) bool array
        States that have had hardly any slack at the prices of some programme. They count as near.
    """

    def __init__(self, ascent: Ascent, batch: BlockBatch) -> None:
        self.ascent, self.batch = ascent, batch
        self.tried = batch.wanted | batch.quickly
        self.tempted = np.zeros(len(ascent.states.begin), bool)
        self.interior, self.crowd, self.unit = False, False, 1.0
        self.iterations, self.seconds = 0, 0.0

    def report_progress(self) -> None:
        """Report the current bounds."""
        ascent, tried = self.ascent, self.tried
        width, cost = ascent.gap, ascent.cost
        share = share_of_digits(width[ascent.open].sum(), cost[tried].sum(), ascent.wanted_gap)
        self.batch.progress.update(tried, width, cost, ascent.unassigned_cost, share)

    def run(self, rounds: tuple[float, ...], max_states: int | None = None) -> None:
        """Run a round of programmes for each reach in `rounds`, until the gaps are closed.

        Components of more than `max_states` states are left out. If very many states are not
        decided, programmes are solved in windows (`_run_windows`).
        """
        ascent = self.ascent
        begin, stuck = time.perf_counter(), 0.0
        for reach in rounds:
            if self._done():
                break
            if reach == stuck:
                continue
            if self.crowd and max_states is not None:
                break
            if max_states is not None and reach > PROGRAMMES.afar and not self._nearly():
                break
            near = self._near(reach)
            if max_states is not None and self._crowded(near):
                near = self._near(PROGRAMMES.crowded * reach)
            if np.count_nonzero(near) > WINDOWS.undecided:
                self._run_windows(near, reach, max_states, len(near))
                continue
            before = ascent.open_gap
            if not self._solve_undecided(near, reach, max_states):
                break
            wide = max(PROGRAMMES.stuck * before, PROGRAMMES.stuck_gap * ascent.open_cost)
            if max_states is None and ascent.open_gap > wide:
                stuck = reach
        self.seconds += time.perf_counter() - begin

    def run_nearby(self, reach: float) -> None:
        """Solve programmes in windows, if a problem is large and few of its states are undecided.

        In other problems nothing is done, because sweeps of all states are faster.
        """
        size = len(self.tempted)
        if size < WINDOWS.large or self._done():
            return
        begin = time.perf_counter()
        near = self._near(reach)
        self._run_windows(near, reach, None, int(WINDOWS.share * size))
        self.seconds += time.perf_counter() - begin

    def run_crowd(self) -> None:
        """Run the interior point method in rounds, for a crowd.

        A round also includes states that may save cost at the prices of earlier rounds. After a
        round that hardly helped, the reach is doubled.
        """
        ascent, begin, wider = self.ascent, time.perf_counter(), 1.0
        shares: Floats = ascent.masses.astype(np.float64)
        while not self._done() and wider <= CROWDS.widest:
            gap = ascent.open_gap
            near = self._near(wider * self.close_reach())
            free, component = ascent.undecided(near)
            self._solve(groups(ascent.states, free, component, None), shares)
            ascent.keep(ascent.wide(PROGRAMMES.met))
            shares = ascent.weights
            if ascent.open_gap >= CROWDS.helped * gap:
                wider *= 2
        ascent.keep(ascent.wide())
        self.seconds += time.perf_counter() - begin

    def close_reach(self) -> float:
        """Return a reach at which few states are near, for a crowd.

        It is `CROWDS.reach`, halved down to `CROWDS.min_reach` while row slots have more than
        `CROWDS.each` near states on average.
        """
        reach, loads = CROWDS.reach, self.ascent.states.rows.loads
        while reach > CROWDS.min_reach and loads(self._near(reach)).mean() > CROWDS.each:
            reach *= 0.5
        return reach

    def _done(self) -> bool:
        return self.batch.limit.late() or not bool(self.ascent.open.any())

    def _run_windows(self, near: Mask, reach: float, max_states: int | None, room: int) -> None:
        """Solve programmes in windows around the steps that keep gaps open; the windows grow.

        A window has a step at which a part of the width between the bounds arises
        (`Ascent.losses`), and the steps around it. Only near states in a window can become free.
        Components of more than `max_states` states are left out. The work ends before the windows
        have more than `room` states.
        """
        ascent = self.ascent
        span, first_reach = WINDOWS.span, reach
        while not self._done():
            before = ascent.open_gap
            if span >= ascent.states.problem.steps:
                self._solve_undecided(near, reach, max_states)
                return
            spared = WINDOWS.spared * ascent.wanted_gap * ascent.open_cost
            around = ascent.within(near, windows(ascent.losses(ascent.prices), spared, span))
            if np.count_nonzero(around) > room:
                return
            self._solve_undecided(around, reach, max_states)
            if ascent.open_gap > WINDOWS.shrink * before:
                if max_states is not None:
                    return
                # States outside the reach may be better now, or the window may be too short.
                if reach < WINDOWS.farther:
                    reach = WINDOWS.farther
                else:
                    span, reach = span * WINDOWS.widen, first_reach
            near = self._near(reach)

    def _nearly(self) -> bool:
        """Return whether the open gap is a tiny share of the cost of the open blocks."""
        return self.ascent.open_gap < PROGRAMMES.nearly * self.ascent.open_cost

    def _crowded(self, near: Mask) -> bool:
        """Return whether an undecided component of the near states is large."""
        if np.count_nonzero(near) <= PROGRAMMES.crowd:
            return False
        _, component = self.ascent.undecided(near)
        return bool(np.bincount(component).max(initial=0) > PROGRAMMES.crowd)

    def _near(self, reach: float) -> Mask:
        """Return a mask of the states that a programme may have to decide, (S,); set `unit`.

        The slack is compared with `reach` times `unit`. The unit becomes smaller with the gap. A
        small reach is enough then: a path that is worse than the best one by much more than the gap
        has hardly any weight.
        """
        _, power = np.frexp(PROGRAMMES.sure * self.ascent.open_gap)
        self.unit = 1.0 if np.isinf(reach) else min(1.0, float(np.ldexp(1.0, power)))
        self.ascent.mark(self.ascent.prices, self.unit * reach)
        return self.ascent.near(self.tempted)

    def _solve_undecided(self, near: Mask, reach: float, max_states: int | None) -> bool:
        """Solve the undecided components of the near states; return False if all are too large."""
        states = self.ascent.states
        free, component = self.ascent.undecided(near)
        if not len(free) and np.isinf(reach):  # only rounding may keep the gap open
            free = np.flatnonzero(states.states_of(self.ascent.open))
            component = states.pair_block[states.pair[free]]
        parts = groups(states, free, component, max_states)
        if parts:
            self._solve(parts)
            self.ascent.keep(self.ascent.wide())
        # If no near state is undecided, states beyond the reach keep the gap open.
        return bool(parts) or not len(free)

    def _solve(self, parts: list[Ints], shares: Floats | None = None) -> None:
        """Solve the programme of each group of states, and propose its weights and prices.

        If `shares` (S,) are given, the interior point method solves large groups, and starts from
        these weights. Prices are refined if their error may be as large as the open gap
        (`PROGRAMMES.tolerance`).
        """
        ascent, solved = self.ascent, []
        for group in parts:
            left = self.batch.limit.left()
            if left is not None and left <= PROGRAMMES.build * len(group):
                break
            crowd = shares is not None and len(group) >= CROWDS.min_states
            try:
                answer = self._solve_group(group, len(parts) == 1, shares if crowd else None)
            except StoppedError:
                break
            if answer is not None:
                solved.append(answer)
        if not solved:
            return
        self._propose(solved)
        self.report_progress()
        wide = ascent.wide()
        size = sum(len(free) for free, _, _ in solved)
        if wide.any() and ascent.gap[wide].sum() <= PROGRAMMES.tolerance * self.unit * size:
            with suppress(StoppedError):
                self._propose(self._in_thread(lambda: self._refined(solved), size))
                self.report_progress()

    def _solve_group(self, free: Ints, whole: bool, shares: Floats | None) -> Solved | None:
        """Solve the programme of one group of free states.

        If `whole` is False, there are other groups too, and the programme is built from the part of
        the problem around this group (`extract`).
        """
        # lazy: HiGHS is slow to import
        from tgospa_eval.solvers.restricted_lp import solve_interior, solve_restricted_lp

        ascent, left = self.ascent, self.batch.limit.left()
        if left is not None:
            left = max(left - PROGRAMMES.build * len(free), 0.0)
        states, own, given, slots = ascent.states, free, (ascent.weights, ascent.prices), None
        if not whole:
            states, state, own, slots = extract(states, free)
            given = given[0][state], given[1][slots]
        switch_price = ascent.switch_price

        def solve() -> "Proposal | None":
            if shares is not None:
                exact = ascent.open_gap < CROWDS.nearly * ascent.open_cost
                start = shares[free]
                return solve_interior(states, own, *given, switch_price, left, start, exact=exact)
            return solve_restricted_lp(
                states, own, *given, switch_price, left, unit=self.unit, interior=self.interior
            )

        proposal = self._in_thread(solve, len(free))
        if proposal is None:
            return None
        self.interior = proposal.interior
        self.crowd |= proposal.interior
        self.iterations += proposal.iterations
        return free, proposal.slot if slots is None else slots[proposal.slot], proposal

    def _refined(self, solved: list[Solved]) -> list[Solved]:
        """Return the proposals after `refine` has improved their prices."""
        from tgospa_eval.solvers.restricted_lp import refine  # lazy: HiGHS is slow to import

        left = self.batch.limit.left
        return [(free, slot, refine(proposal, left())) for free, slot, proposal in solved]

    def _in_thread(self, work: Callable[[], T], size: int) -> T:
        """Run `work` in a thread that can be abandoned, because HiGHS cannot be stopped.

        Work on few states (`size`) takes hardly any time and needs no thread.

        Raises
        ------
        StoppedError
            The run was interrupted, or its time was over, before the work ended.
        """
        return self.batch.limit.progress.in_thread(work) if size > PROGRAMMES.quick else work()

    def _propose(self, solved: list[Solved]) -> None:
        """Try the proposed weights and prices, and mixtures of new and old prices.

        A mixture may prove more than either, because the bound is a concave function of the prices.
        """
        ascent = self.ascent
        weights, prices = ascent.weights.copy(), ascent.prices.copy()
        for free, slot, proposal in solved:
            weights[free], prices[slot] = proposal.weights, proposal.prices
        wide = ascent.open_gap
        self._propose_weights(np.concatenate([free for free, _, _ in solved]), weights)
        slot = np.concatenate([slot for _, slot, _ in solved])
        proposed, before = prices[slot], ascent.prices[slot]
        if len(solved) > 1:
            self._try_best(solved, prices)
        ascent.try_prices(prices)
        if ascent.open_gap <= PROGRAMMES.met * ascent.open_cost:
            return
        ascent.mark(prices, 0.0)
        self.tempted |= ascent.has(kernels.TEMPTED)
        if len(solved) > 1 and ascent.open_gap < 0.5 * wide:
            return
        for share in (0.5, 0.2):
            prices[slot] = share * proposed + (1 - share) * before
            ascent.try_prices(prices)
        prices[:] = ascent.prices
        prices[~ascent.full()] = 0.0
        ascent.try_prices(prices)

    def _propose_weights(self, free: Ints, proposed: Floats) -> None:
        """Make the weights `proposed` (S,) feasible, and try them; only those of `free` are new."""
        states, weights, snap = self.ascent.states, proposed[free], PROGRAMMES.snap
        proposed[free] = np.where(weights < snap, 0.0, np.where(weights > 1 - snap, 1.0, weights))
        if any(
            slots.loads(proposed).max(initial=0.0) > 1 + PROGRAMMES.overfull
            for slots in (states.rows, states.columns)
        ):
            proposed = repair(states, proposed) / ONE
        self.ascent.try_weights(proposed)

    def _try_best(self, solved: list[Solved], prices: Floats) -> None:
        """Try new prices in the groups in which they lose no more than the old prices."""
        ascent = self.ascent
        states, prices = ascent.states, prices.copy()
        change = ascent.losses(prices)
        change -= ascent.losses(ascent.prices)
        change = np.concatenate(([0.0], np.cumsum(change)))
        for free, slot, _ in solved:
            begin = states.begin[free].min()
            end = states.begin[free].max() + PROGRAMMES.after
            if change[min(end, len(change) - 1)] > change[begin]:
                prices[slot] = ascent.prices[slot]
        ascent.try_prices(prices)


def groups(states: States, free: Ints, component: Ints, max_states: int | None) -> list[Ints]:
    """Divide the free states among programmes; components near in time share a programme.

    Components of more than `max_states` states are left out.
    """
    _, number, size = np.unique(component, return_inverse=True, return_counts=True)
    if max_states is not None and size.max(initial=0) > max_states:
        kept = size[number] <= max_states
        free = free[kept]
        _, number, size = np.unique(number[kept], return_inverse=True, return_counts=True)
    if len(free) <= PROGRAMMES.group:
        return [free] if len(free) else []
    begin = np.full(len(size), np.iinfo(np.int32).max)
    np.minimum.at(begin, number, states.begin[free])
    in_time = np.argsort(begin, kind="stable")
    group = np.empty(len(size), np.int64)
    group[in_time] = (np.cumsum(size[in_time]) - 1) // PROGRAMMES.group
    of_state = group[number]
    order = np.argsort(of_state, kind="stable")  # in each group the states stay in order
    return np.split(free[order], np.flatnonzero(np.diff(of_state[order])) + 1)


def windows(lost: Floats, allowed: float, span: int) -> Mask:
    """Return a mask of the steps with losses, and of `span` steps before and after each, (T,).

    The smallest losses are left out, as long as they sum to at most `allowed`.
    """
    order = np.argsort(lost)
    bad = order[np.cumsum(lost[order]) > allowed]
    change = np.zeros(len(lost) + 1, np.int32)
    np.add.at(change, np.maximum(bad - span, 0), 1)
    np.subtract.at(change, np.minimum(bad + span + 1, len(lost)), 1)
    around: Mask = np.cumsum(change[:-1]) > 0
    return around


INTERIOR = 25_000
"""Number of states above which `solve_whole` uses the interior point method first.

The simplex method needs a good start, and without prices there is none. 47,000 states took 82 s by
the interior point method, and more than 190 s by the simplex method. 11,000 states took the same
time by both methods."""


def solve_whole(batch: BlockBatch) -> Answer:
    """Solve each block of a batch by HiGHS.

    If a block is not solved to the end, its answer is the cheaper of two assignments: the weights
    so far, and the best paths, made feasible.
    """
    begin = time.perf_counter()
    iterations, unsolved = 0, []
    for number in np.flatnonzero(batch.wanted).tolist():
        states, state, slot = batch.states.between(number, number + 1)
        proposal = None if batch.limit.late() else _programme(states, batch.limit)
        if proposal is not None:
            iterations += proposal.iterations
            batch.prices[slot][proposal.slot] = proposal.prices
            batch.weights[state] = proposal.weights
        if proposal is None or not proposal.finished:
            paths = best_paths(states, batch.prices[slot])
            batch.weights[state] = better(states, batch.weights[state], paths)
            unsolved.append(number)
    late = batch.limit.status if batch.limit.late() else Status.HIGHS_FAILED
    return Answer(
        iterations=iterations,
        status=late if unsolved else Status.SOLVED,
        open=np.array(unsolved, np.int64),
        left=np.flatnonzero(batch.wanted),
        seconds={"lp": time.perf_counter() - begin},
    )


def _programme(states: States, limit: Limit) -> "Proposal | None":
    """Solve one block by HiGHS; return None if the run is stopped before the end."""
    from tgospa_eval.solvers.restricted_lp import solve_restricted_lp  # lazy: HiGHS is slow

    size = len(states.begin)
    work = partial(
        solve_restricted_lp,
        states,
        np.arange(size),
        np.zeros(size),
        np.zeros(len(states.columns.step)),
        np.minimum(states.problem.switch_price_at, price_cap(states)[0]),
        limit.left(),
        interior=size > INTERIOR,
    )
    try:
        return limit.progress.in_thread(work)
    except StoppedError:
        return None
