"""The normalised curve: proven costs of the steps 1..k for each k (docs/theory/solvers.md).

A solution of the whole brackets every beginning. The beginnings of components whose bracket stays
open are solved as copies at steps of their own, many in one problem that starts from the solution
of the whole, and proven as any result is.
"""

import itertools
import time
from dataclasses import replace
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import concatenated
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Progress
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.problem.certificate import ROUNDOFF, fair_prices, lower_bounds, prove
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.prefixes import bound_prefixes, whole_prices
from tgospa_eval.problem.problem import Floats, Ints, Problem, sum_by
from tgospa_eval.problem.solution import Curve, Reduced
from tgospa_eval.problem.states import States
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import Origin, SavedSolution, make_warm_start, save_solution

SIZE = 1 << 18
"""Near pairs of the beginnings that are solved together."""


def trace(
    states: States,
    weights: Ints,
    prices: Floats,
    solver: Certified,
    reduced: tuple[Reduced, ...] = (),
    progress: Progress | None = None,
) -> Curve:
    """The curve of a solved problem; its last point is what the solution proves of the whole.

    Parameters
    ----------
    states : States
        The whole.
    weights : (S,) int array
        A feasible assignment, in units of 1/ONE.
    prices : (K,) float array
        Prices of its column slots, 0 or more.
    solver : Certified
        What solves beginnings, and to which gap; its time limit is that of all of them together.
    reduced : tuple of Reduced
        What is known of the whole at smaller cutoffs.
    progress : Progress, optional
        Gets the share that is done; what is not begun when it is to stop stays open.
    """
    progress = progress or Progress()
    begin, prices = time.monotonic(), fair_prices(prices)
    found = bound_prefixes(states, weights, prices)
    cells, parts = found.cells, found.parts
    least, error = found.lower.copy(), found.error.copy()
    unpaired_costs = _unpaired(states)
    ends = cells.first[1:] - 1
    least[ends] = np.maximum(least[ends], _whole_blocks(states, prices, reduced))
    whole = save_solution(states, weights, prices)

    cost = parts.sum(axis=0)
    open_ = cost + error - least > solver.gap * cost
    open_[ends] = False  # a whole block: the solver has had its chance
    wide = np.flatnonzero(open_)
    wide = wide[np.argsort(-cells.step[wide], kind="stable")]
    copies = _Copies(states)
    groups = copies.groups(cells.block[wide], cells.step[wide])
    for done, chosen in enumerate(groups):
        at = wide[chosen]
        if progress.stop.is_set():
            break
        progress.again("the curve", done / len(groups))
        if solver.time_limit is not None:
            left = begin + solver.time_limit - time.monotonic()
            if left <= 0:
                break
            solver = replace(solver, time_limit=left)
            begin = time.monotonic()
        stopwatch = Stopwatch()
        stopwatch.progress = progress.silent()
        better, lower, uncertain = copies.solve(
            cells.block[at], cells.step[at], whole, solver, stopwatch
        )
        wins = better.sum(axis=0) < cost[at]
        parts[:, at[wins]] = better[:, wins]
        error[at[wins]] = uncertain[wins]
        least[at] = np.maximum(least[at], lower)

    problem = states.problem
    shown = np.array([cells.totals(part, problem.steps)[0] for part in parts])
    shown[1:3] += unpaired_costs
    # Of objects that are near to none: sums of so many prices.
    rows = len(problem.truth_step) + len(problem.estimate_step)
    unsure = (
        0.0
        if unpaired_costs.max(initial=0.0) < 2.0**31 and whole_prices(problem)
        else rows * ROUNDOFF
    )
    few = 8 * ROUNDOFF
    upper, off = cells.totals(parts.sum(axis=0) + error, problem.steps)
    upper = (
        (upper + off + unpaired_costs.sum(axis=0)) * (1 + few + unsure) / (1 - problem.cost_error)
    )
    lower, off = cells.totals(least, problem.steps)
    lower = (lower - off + unpaired_costs.sum(axis=0)) * (1 - few - unsure) - problem.cost_slack
    lower *= 1 - few - problem.cost_error
    share = np.cumsum(sum_by(problem.truth_step, problem.truth_price, problem.steps))
    share += np.cumsum(sum_by(problem.estimate_step, problem.estimate_price, problem.steps))
    return Curve(
        lower=np.clip(lower, 0.0, upper),
        upper=upper,
        parts=shown,
        rounding=problem.rounding * share / max(float(share[-1:].sum()), 1e-300),
    )


def _unpaired(states: States) -> Floats:
    """Cost, up to each step, of the truths and estimates that are near to none, (2, T)."""
    problem = states.problem
    total = np.zeros((2, problem.steps))
    for own, side in zip(total, problem.sides, strict=True):
        price = side.price.copy()
        price[side.row] = 0.0
        own[:] = sum_by(side.step, price, problem.steps)
    return np.cumsum(total, axis=1)


def _whole_blocks(states: States, prices: Floats, reduced: tuple[Reduced, ...]) -> Floats:
    """Lower bound of each whole block, (B,), of objects and steps with a near pair only."""
    problem, blocks = states.problem, len(states.block_begin)
    lower = lower_bounds(states, prices, reduced)
    unpaired = np.zeros(blocks)
    for side, blocks_of in zip(problem.sides, states.track_blocks, strict=True):
        block = blocks_of[side.track]
        price = side.price.copy()
        price[side.row] = 0.0
        unpaired += sum_by(block[block >= 0], price[block >= 0], blocks)
    exact = whole_prices(problem)
    error = (lower + unpaired) * (2 if exact else 2 + len(problem.truth_price)) * ROUNDOFF
    return lower - unpaired - error


@dataclass(frozen=True, kw_only=True, eq=False)
class _Listed:
    """Entries or objects of the problem, those of a block together and in order of time.

    Parameters
    ----------
    which : (L,) int array
        The entries or rows.
    key : (L,) int array
        ``block * steps + step`` of each.
    steps : int
        T.
    """

    which: Ints
    key: Ints
    steps: int

    @classmethod
    def of(cls, which: Ints, block: Ints, step: Ints, steps: int) -> "_Listed":
        key = block.astype(np.int64) * steps + step
        order = np.argsort(key, kind="stable")
        return cls(which=which[order], key=key[order], steps=steps)

    def spans(self, block: Ints, end: Ints) -> tuple[Ints, Ints]:
        """First of each block, and how many there are up to a step."""
        low = np.searchsorted(self.key, block * np.int64(self.steps))
        return low, np.searchsorted(self.key, block * np.int64(self.steps) + end, "right") - low


class _Copies:
    """Beginnings of blocks as problems of their own."""

    def __init__(self, states: States) -> None:
        self.states = states
        problem, steps = states.problem, states.problem.steps
        gains = np.flatnonzero(states.entry >= 0)
        entry = states.entry[gains].astype(np.int64)
        block = states.pair_block[states.pair[gains]]
        order = np.argsort(entry)
        entry, block = entry[order], block[order]
        self.entries = _Listed.of(entry, block, problem.entry_step[entry], steps)
        self.sides: list[tuple[_Listed, Ints, _Listed, Ints]] = []
        for side, pair_track in zip(problem.sides, states.pair_tracks, strict=True):
            some, at = np.unique(side.row[entry].astype(np.int64), return_index=True)
            objects = _Listed.of(some, block[at], side.step[some], steps)
            place = np.zeros(len(side.step), np.int64)
            place[objects.which] = np.arange(len(some))
            track, at = np.unique(pair_track, return_index=True)
            order = np.argsort(states.pair_block[at], kind="stable")
            number = np.zeros(side.count, np.int64)
            number[track[order]] = np.arange(len(track))
            members = _Listed(which=track[order], key=states.pair_block[at][order], steps=1)
            self.sides.append((objects, place, members, number))

    def groups(self, block: Ints, end: Ints) -> list[slice]:
        """Neighbours of which each but the last have SIZE entries, or are a single one."""
        size = np.cumsum(self.entries.spans(block, end)[1])
        bounds = [0]
        while bounds[-1] < len(block):
            done = size[bounds[-1] - 1] if bounds[-1] else 0
            bounds.append(max(int(np.searchsorted(size, done + SIZE)), bounds[-1] + 1))
        return [slice(a, b) for a, b in itertools.pairwise(bounds)]

    def solve(
        self, block: Ints, end: Ints, whole: SavedSolution, solver: Certified, stopwatch: Stopwatch
    ) -> tuple[Floats, Floats, Floats]:
        """Cost by kind (4, N), lower bound (N,), and error of the cost, of these beginnings."""
        problem, origin, first = self._cut(block, end)
        states = merge_runs(problem)
        warm_start = replace(make_warm_start(states, (whole,), (1.0,), origin), near=True)
        solution = solver(states, stopwatch, warm_start)
        _, lower, split = prove(states, solution, consume=True)
        parts = np.array(
            [
                np.add.reduceat(kind, first)
                for kind in (split.localisation, split.missed, split.false, split.switch)
            ]
        )
        copy = np.searchsorted(first, states.block_begin, side="right") - 1
        bound = sum_by(copy, lower, len(block))
        # A sum of the steps of a copy, and of its blocks.
        cost = parts.sum(axis=0)
        length = np.diff(first, append=problem.steps)
        terms = int(np.bincount(states.begin, minlength=1).max())
        error = cost * (length + 2 * terms + 16) * ROUNDOFF
        return parts, bound * (1 - len(states.block_begin) * ROUNDOFF), error

    def _cut(self, block: Ints, end: Ints) -> tuple[Problem, Origin, Ints]:
        """The problem of the copies, where it comes from, and the first step of each copy."""
        problem, begin = self.states.problem, self.states.block_begin[block].astype(np.int64)
        length = end - begin + 1
        first = np.cumsum(length) - length
        step = concatenated(begin, length)
        taken, copy = _ranges(*self.entries.spans(block, end))
        entry = self.entries.which[taken]
        sides: dict[str, Any] = {}
        tracks = []
        for name, side, (objects, place, members, number) in zip(
            ("truth", "estimate"), problem.sides, self.sides, strict=True
        ):
            low, count = members.spans(block, 0 * block)
            member, _ = _ranges(low, count)
            tracks.append(members.which[member])
            sides[f"{name}s"] = len(member)
            fresh = np.cumsum(count) - count - low
            low, count = objects.spans(block, end)
            at, of = _ranges(low, count)
            row = objects.which[at]
            sides[f"{name}_track"] = number[side.track[row]] + fresh[of]
            sides[f"{name}_step"] = side.step[row] + (first - begin)[of]
            sides[f"{name}_price"] = side.price[row]
            shift = np.cumsum(count) - count - low
            sides[f"{name}_row"] = (place[side.row[entry]] + shift[copy]).astype(np.int32)
        price = problem.switch_price
        whole = Problem(
            steps=len(step),
            cost=problem.cost[entry],
            switch_price=price if isinstance(price, float) else price[step[1:] - 1],
            **sides,
        )
        origin = Origin(
            truth=tracks[0],
            estimate=tracks[1],
            step=step,
            estimates=problem.estimates,
            steps=problem.steps,
        )
        return whole, origin, first


def _ranges(low: Ints, count: Ints) -> tuple[Ints, Ints]:
    """The numbers of each range, one range after the other, and whose each is."""
    return concatenated(low, count), np.repeat(np.arange(len(low)), count)
