"""A window of a long component: solved by itself, and what its middle says."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import SolverError
from tgospa_eval.partitioned.long.borders import Framed, frame, load_borders
from tgospa_eval.partitioned.long.holding import WindowFindings, hold_runs
from tgospa_eval.partitioned.long.tables import (
    BUSY,
    GAIN,
    PRICE_AT,
    Table,
    WindowPiece,
    halves,
    load_pieces,
    save_parts,
)
from tgospa_eval.partitioned.shards import ENTRY, HELD, problem_of, within
from tgospa_eval.partitioned.tasks import left_until, writing
from tgospa_eval.problem.certificate import TERMS_TOGETHER, fair_prices
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import States
from tgospa_eval.problem.tgospa import Parameters
from tgospa_eval.problem.weights import ONE, repair
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import SavedSolution, WarmStart, make_warm_start

ROWS_READ = 1 << 20
"""Entries that are looked at together where they are only counted."""


def count_entries(output: str, path: str) -> None:
    """Count the entries of a file, by time, by step, truth and estimate, a stretch at a time."""
    entries = np.load(path, mmap_mode="r")
    names = ("step", "truth", "estimate")
    counted: dict[str, dict[int, int]] = {name: {} for name in names}
    for low in range(0, len(entries), ROWS_READ):
        part = np.asarray(entries[low : low + ROWS_READ])
        for name in names:
            known = counted[name]
            for number, count in zip(*(x.tolist() for x in _counts(part[name])), strict=True):
                known[number] = known.get(number, 0) + count
    with writing(output) as beside, beside.open("wb") as file:
        tables: dict[str, Any] = {
            name: np.array(sorted(known.items()), np.int64).reshape(-1, 2).T
            for name, known in counted.items()
        }
        np.savez(file, **tables)


def _counts(number: Ints) -> tuple[Ints, Ints]:
    return np.unique(number, return_counts=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class ComponentPlan:
    """What is known of a long component before it is solved.

    Parameters
    ----------
    paths : tuple of str
        Files of its entries, by time.
    file_first : (F + 1,) int array
        Entries before each file.
    step : (K,) int array
        The steps with entries.
    step_first : (K + 1,) int array
        Entries before each of them.
    estimates : (n,) int array
        Numbers of its estimates.
    truth_bounds, estimate_bounds : int arrays
        The first number of each shard, and the end.
    """

    paths: tuple[str, ...]
    file_first: Ints
    step: Ints
    step_first: Ints
    estimates: Ints
    truth_bounds: Ints
    estimate_bounds: Ints

    @property
    def window(self) -> tuple[int, int]:
        """The first and the last step with an entry."""
        return int(self.step[0]), int(self.step[-1])

    def between(self, low: int, high: int) -> tuple[tuple[str, int, int], ...]:
        """Where the entries of the steps from `low` to before `high` are: files and rows."""
        ends = self.step_first[np.searchsorted(self.step, (low, high))]
        found = []
        for path, first, last in zip(
            self.paths, self.file_first[:-1].tolist(), self.file_first[1:].tolist(), strict=True
        ):
            a, b = max(int(ends[0]), first), min(int(ends[1]), last)
            if a < b:
                found.append((path, a - first, b - first))
        return tuple(found)

    def cores(self, size: int) -> list[tuple[int, int]]:
        """Stretches of steps with about so many entries each; steps from, and to before."""
        total = int(self.step_first[-1])
        count = min(max(-(-total // size), 1), len(self.step))
        cuts = np.searchsorted(self.step_first, np.arange(count) * (total / count))
        cuts = np.unique(np.minimum(cuts, len(self.step) - 1))
        edges = [*self.step[cuts].tolist(), self.window[1] + 1]
        edges[0] = self.window[0]
        return list(itertools.pairwise(edges))

    def around(self, low: int, high: int, overlap: int, most: int) -> tuple[int, int]:
        """A stretch with so many steps more on either side, or those with at most so many entries.

        Only steps with entries count.
        """
        a, b = np.searchsorted(self.step, (low, high)).tolist()
        first, last = max(a - overlap, 0), min(b + overlap, len(self.step))
        counts = self.step_first
        first = max(first, int(np.searchsorted(counts, counts[a] - most)))
        last = min(last, max(int(np.searchsorted(counts, counts[b] + most, side="right")) - 1, b))
        return int(self.step[first]) if first < a else low, (
            int(self.step[last - 1]) + 1 if last > b else high
        )


def make_plan(
    paths: Sequence[str], counted: Sequence[str], together: int, columns_together: int
) -> ComponentPlan:
    """Put together what was counted.

    Parameters
    ----------
    paths : sequence of str
        Files of entries, by time.
    counted : sequence of str
        What `count_entries` wrote of each.
    together, columns_together : int
        Entries of a shard of truths, and of one of estimates.
    """
    sides: dict[str, list[Ints]] = {"step": [], "truth": [], "estimate": []}
    sizes = []
    for path in counted:
        with np.load(path) as found:
            for name, known in sides.items():
                known.append(found[name])
            sizes.append(int(found["step"][1].sum()))
    step, truth, estimate = (_added(known) for known in sides.values())
    return ComponentPlan(
        paths=tuple(paths),
        file_first=np.concatenate(([0], np.cumsum(sizes))),
        step=step[0],
        step_first=np.concatenate(([0], np.cumsum(step[1]))),
        estimates=estimate[0],
        truth_bounds=_bounds(*truth, together),
        estimate_bounds=_bounds(*estimate, columns_together),
    )


def _added(counted: list[Ints]) -> tuple[Ints, Ints]:
    number, count = np.concatenate(counted, axis=1)
    known, index = np.unique(number, return_inverse=True)
    sums = np.zeros(len(known), np.int64)
    np.add.at(sums, index, count)
    return known, sums


def _bounds(number: Ints, count: Ints, size: int) -> Ints:
    """First numbers of stretches of about `size` counts each, and the end."""
    before = np.cumsum(count) - count
    opens = np.flatnonzero(np.diff(before // size, prepend=-1) > 0)
    return np.append(number[opens], number[-1] + 1)


def shard_of(number: Ints, bounds: Ints) -> Ints:
    """In which stretch each number is."""
    return np.searchsorted(bounds, number, side="right") - 1


def read_entries(stretches: tuple[tuple[str, int, int], ...]) -> Table:
    """The entries of `ComponentPlan.between`."""
    found = [np.zeros(0, ENTRY)]
    for path, low, high in stretches:
        found.append(np.array(np.load(Path(path), mmap_mode="r")[low:high]))
    return np.concatenate(found)


@dataclass(frozen=True, kw_only=True, eq=False)
class Window:
    """The task to solve a window.

    Parameters
    ----------
    output : str
        The folder that is written.
    entries : tuple
        Where its entries are, as of `ComponentPlan.between`.
    around : pair of int
        The steps of the window: from, and to before.
    core : pair of int
        Those of them that the answer is for.
    parameters : Parameters
        Of the metric.
    truth_bounds, estimate_bounds : int arrays
        Shards, as of `ComponentPlan`.
    gap : float
        Relative gap that counts as exact.
    near : tuple of WindowPiece
        What is known, where the window was solved before.
    borders : tuple of str
        What `value_borders` wrote, where its pairs are worth something at its borders.
    number : int
        Which window it is in these.
    ends : pair of bool
        Whether it has the first, and the last step of the component.
    end : float, optional
        In `time.time()`: afterwards all is left unassigned.
    """

    output: str
    entries: tuple[tuple[str, int, int], ...]
    around: tuple[int, int]
    core: tuple[int, int]
    parameters: Parameters
    truth_bounds: Ints
    estimate_bounds: Ints
    gap: float
    near: tuple[WindowPiece, ...] = ()
    borders: tuple[str, ...] = ()
    number: int = 0
    ends: tuple[bool, bool] = (True, True)
    end: float | None = None


def pieces_of(windows: list[Window]) -> tuple[WindowPiece, ...]:
    """The steps that windows have the answer of."""
    return tuple(WindowPiece(folder=w.output, low=w.core[0], high=w.core[1]) for w in windows)


def solve_window(output: str, task: Window) -> None:
    """Solve a window, and write what its core says."""
    entry = read_entries(task.entries)
    solved = _solve(entry, task)
    low, high = np.searchsorted(entry["step"], task.core).tolist()
    gains = np.zeros(high - low, GAIN)
    for name in entry.dtype.names or ():
        gains[name] = entry[name][low:high]
    gains["weight"] = solved.entry_weights[low:high]
    del entry
    truth_shards, estimate_shards = len(task.truth_bounds) - 1, len(task.estimate_bounds) - 1
    with writing(output) as folder:
        folder.mkdir()
        for name, table in (("gains", gains), ("holds", solved.holds)):
            part = shard_of(table["truth"], task.truth_bounds)
            save_parts(folder, name, table, part, truth_shards)
        by_estimate = (
            ("places", solved.places),
            ("busy", _busy(gains[gains["weight"] > 0])),
            ("present", _busy(gains)),
        )
        for name, table in by_estimate:
            part = shard_of(table["estimate"], task.estimate_bounds)
            save_parts(folder, name, table, part, estimate_shards)
        np.savez(folder / "steps.npz", **_steps(gains, task))
        np.save(folder / "iterations.npy", solved.iterations)


@dataclass(frozen=True, kw_only=True, eq=False)
class _SolvedWindow:
    """An answer, with the numbers of the whole, cut to the core but for the entries."""

    entry_weights: Ints
    holds: Table
    places: Table
    iterations: int = 0


def _solve(entry: Table, task: Window) -> _SolvedWindow:
    if left_until(task.end) == 0:
        return _SolvedWindow(
            entry_weights=np.zeros(len(entry), np.int64),
            holds=np.zeros(0, HELD),
            places=np.zeros(0, PRICE_AT),
        )
    # Estimates are columns in every window: their prices are joined.
    borders = load_borders(task.borders, task.number)
    framed = frame(entry, task.around, task.parameters, borders, task.ends)
    states = merge_runs(framed.problem, transpose=False)
    warm_start = _warm_start(states, task, framed) if task.near else None
    solver = within(Certified(gap=task.gap, jobs=1), task.end)
    solution = solver(states, Stopwatch(), warm_start)
    whole = repair(states, solution.weights)
    gains = np.flatnonzero(states.entry >= 0)
    weights = np.zeros(len(framed.problem.cost), np.int64)
    weights[states.entry[gains]] = whole[gains]
    return _SolvedWindow(
        entry_weights=weights[len(framed.before) : len(framed.before) + len(entry)],
        holds=_holds(states, whole, task, framed),
        places=_places(states, solution, task, framed),
        iterations=solution.iterations,
    )


def _holds(states: States, weights: Ints, task: Window, framed: Framed) -> Table:
    """What is held without gain in the core; outside its block a pair goes on as at the border."""
    first, numbers = framed.first, framed.numbers
    pair = states.pair
    block = states.pair_block[pair]
    opens, closes = states.pair_first[:-1], states.pair_first[1:] - 1
    runs = np.flatnonzero((states.entry < 0) & (weights > 0))
    last = np.int32(states.problem.steps - 1)
    stretches = (
        (runs, states.begin[runs], states.end[runs]),
        (opens, np.zeros_like(opens), states.block_begin[block[opens]] - 1),
        (closes, states.block_end[block[closes]] + 1, np.full_like(closes, last)),
    )
    state, begin, end = (np.concatenate(part) for part in zip(*stretches, strict=True))
    begin = np.maximum(begin + first, task.core[0])
    end = np.minimum(end + first, task.core[1] - 1)
    kept = (weights[state] > 0) & (begin <= end)
    held = np.zeros(int(kept.sum()), HELD)
    held["truth"] = numbers[0][states.pair_truth[pair[state[kept]]]]
    held["estimate"] = numbers[1][states.pair_estimate[pair[state[kept]]]]
    held["begin"], held["end"] = begin[kept], end[kept]
    held["weight"] = weights[state[kept]]
    held.sort(order=["truth", "estimate", "begin"])
    return held


def _places(states: States, solution: Solution, task: Window, framed: Framed) -> Table:
    """The prices of the slots that begin in the core, at their first steps."""
    columns = states.columns
    prices = fair_prices(solution.prices)
    step = columns.step.astype(np.int64) + framed.first
    paid = np.flatnonzero((prices > 0) & (step >= task.core[0]) & (step < task.core[1]))
    number = np.zeros(states.nodes, np.int64)
    number[states.pair_column] = states.pair_estimate
    places = np.zeros(len(paid), PRICE_AT)
    places["estimate"] = framed.numbers[1][number[columns.node[paid]]]
    places["step"], places["price"] = step[paid], prices[paid]
    places.sort(order=["estimate", "step"])
    return places


def _busy(used: Table) -> Table:
    """When there is any of an estimate, by (estimate, begin); neighbours are one stretch."""
    used = used[np.lexsort((used["step"], used["estimate"]))]
    opens = np.ones(len(used), bool)
    opens[1:] = (np.diff(used["estimate"]) != 0) | (np.diff(used["step"]) > 1)
    closes = np.roll(opens, -1)
    busy = np.zeros(int(opens.sum()), BUSY)
    busy["estimate"], busy["begin"] = used["estimate"][opens], used["step"][opens]
    busy["end"] = used["step"][closes]
    return busy


def _steps(gains: Table, task: Window) -> dict[str, Any]:
    """By step of the core: cost of what is assigned, objects, and how much of them is not."""
    low, high = task.core
    numbers = np.unique(gains["truth"]), np.unique(gains["estimate"])
    problem = problem_of(gains, low, numbers, task.parameters)
    step = gains["step"] - np.int32(low)
    size = high - low
    found: dict[str, Any] = {"first": np.array(low)}
    for name, side in zip(("truth", "estimate"), problem.sides, strict=True):
        free = np.full(len(side.step), ONE)
        np.subtract.at(free, side.row, gains["weight"])
        if free.min(initial=0) < 0:
            raise SolverError(
                "an assignment to prove is none: please report this as a bug, with the two files"
            )
        found[f"{name}s"] = np.bincount(side.step, minlength=size)
        found[f"free_{name}s"] = halves(free, side.step, size)
    used = np.flatnonzero(gains["weight"])
    paid = gains["weight"][used] / ONE * gains["cost"][used]
    found["localisation"] = _sums(paid, step[used], size)
    return found


def _sums(value: Floats, step: Ints, size: int) -> Floats:
    """Sums by step, (size,), of values in order of time: exact but for few roundings."""
    opens = np.ones(len(value), bool)
    opens[1:] = np.diff(step) != 0
    place = np.arange(len(value))
    since = place - np.maximum.accumulate(np.where(opens, place, 0))
    starts = np.flatnonzero(since % TERMS_TOGETHER == 0)
    chunks = np.add.reduceat(value, starts).tolist() if len(value) else []
    first = np.searchsorted(step[starts], np.arange(size + 1)).tolist()
    return np.array([math.fsum(chunks[a:b]) for a, b in itertools.pairwise(first)], np.float64)


def _warm_start(states: States, task: Window, framed: Framed) -> WarmStart:
    """What pieces say of the window: prices, and weights that are held where they can be."""
    low, high = task.around
    first, numbers = framed.first, framed.numbers
    pieces = tuple(
        WindowPiece(folder=piece.folder, low=max(piece.low, low), high=min(piece.high, high))
        for piece in task.near
        if piece.low < high and piece.high > low
    )
    gains = load_pieces(pieces, "gains", None, GAIN)
    gains = gains[np.lexsort((gains["estimate"], gains["truth"], gains["step"]))]
    gains = np.concatenate(
        (
            _outside(framed.before, "held_before", low - 1),
            gains,
            _outside(framed.after, "held_after", high),
        )
    )
    known = WindowFindings(
        weights=np.ascontiguousarray(gains["weight"]),
        holds=_renumbered(load_pieces(pieces, "holds", None, HELD), first, numbers),
        busy=_renumbered(_busy(gains[gains["weight"] > 0]), first, numbers),
    )
    places = _renumbered(load_pieces(pieces, "places", None, PRICE_AT), first, numbers)
    none = np.zeros(0, np.int64)
    paid = SavedSolution(
        **dict.fromkeys(("truth", "estimate", "begin", "end"), none),
        weight=np.zeros(0),
        priced=places["estimate"],
        step=places["step"],
        price=places["price"],
        estimates=states.problem.estimates,
        steps=states.problem.steps,
    )
    return WarmStart(
        weights=(hold_runs(states, known) / ONE,),
        prices=make_warm_start(states, (paid,), (1.0,)).prices,
        near=True,
    )


def _outside(borders: Table, held: str, step: int) -> Table:
    gains = np.zeros(len(borders), GAIN)
    for name in ("truth", "estimate"):
        gains[name] = borders[name]
    gains["step"], gains["weight"] = step, borders[held]
    return gains


def _renumbered(table: Table, first: int, numbers: tuple[Ints, Ints]) -> Table:
    """With the tracks and steps of a window; what is not of its tracks is gone."""
    for name, known in zip(("truth", "estimate"), numbers, strict=True):
        if name in (table.dtype.names or ()):
            at = np.minimum(np.searchsorted(known, table[name]), len(known) - 1)
            table, at = (part[known[at] == table[name]] for part in (table, at))
            table[name] = at
    for name in ("step", "begin", "end"):
        if name in (table.dtype.names or ()):
            table[name] -= first
    return table
