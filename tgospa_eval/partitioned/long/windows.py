"""A window of a long component: solved by itself, and what its middle says."""

import itertools
import math
from typing import Any

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import SolverError
from tgospa_eval.partitioned.long.borders import Framed, frame, load_borders
from tgospa_eval.partitioned.long.holding import Known, hold_runs
from tgospa_eval.partitioned.long.plan import read_entries, shard_of
from tgospa_eval.partitioned.long.tables import (
    BUSY,
    GAIN,
    PRICE_AT,
    Piece,
    Table,
    halves,
    load_pieces,
    save_parts,
)
from tgospa_eval.partitioned.shards import problem_of, within
from tgospa_eval.partitioned.share import HELD
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Window:
    """The task to solve a window.

    Parameters
    ----------
    output : str
        The folder that is written.
    entries : tuple
        Where its entries are, as of `Plan.between`.
    around : pair of int
        The steps of the window: from, and to before.
    core : pair of int
        Those of them that the answer is for.
    parameters : Parameters
        Of the metric.
    truth_bounds, estimate_bounds : int arrays
        Shards, as of `Plan`.
    gap : float
        Relative gap that counts as exact.
    near : tuple of Piece
        What is known, where the window was solved before.
    borders : tuple of str
        Outputs of `Borders`, where its pairs are worth something at its borders.
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
    near: tuple[Piece, ...] = ()
    borders: tuple[str, ...] = ()
    number: int = 0
    ends: tuple[bool, bool] = (True, True)
    end: float | None = None


def pieces_of(windows: list[Window]) -> tuple[Piece, ...]:
    """The steps that windows have the answer of."""
    return tuple(Piece(folder=w.output, low=w.core[0], high=w.core[1]) for w in windows)


def solve_window(task: Window) -> None:
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
    with writing(task.output) as folder:
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
        with (folder / "steps.npz").open("wb") as file:
            np.savez(file, **_steps(gains, task))
        counted = [solved.iterations, solved.states, solved.finished]
        np.save(folder / "counts.npy", np.array(counted, np.int64))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Solved:
    """An answer, with the numbers of the whole, cut to the core but for the entries."""

    entry_weights: Ints
    holds: Table
    places: Table
    iterations: int = 0
    states: int = 0
    finished: bool = True


def _solve(entry: Table, task: Window) -> _Solved:
    if left_until(task.end) == 0:
        return _Solved(
            entry_weights=np.zeros(len(entry), np.int64),
            holds=np.zeros(0, HELD),
            places=np.zeros(0, PRICE_AT),
            finished=False,
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
    return _Solved(
        entry_weights=weights[len(framed.before) : len(framed.before) + len(entry)],
        holds=_holds(states, whole, task, framed),
        places=_places(states, solution, task, framed),
        iterations=solution.iterations,
        states=len(states.begin),
        finished=solution.finished,
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
        Piece(folder=piece.folder, low=max(piece.low, low), high=min(piece.high, high))
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
    known = Known(
        weights=np.ascontiguousarray(gains["weight"]),
        holds=_renumbered(load_pieces(pieces, "holds", None, HELD), first, numbers),
        busy=_renumbered(_busy(gains[gains["weight"] > 0]), first, numbers),
    )
    places = _renumbered(load_pieces(pieces, "places", None, PRICE_AT), first, numbers)
    places = places[np.lexsort((places["step"], places["estimate"]))]
    none = np.zeros(0, np.int64)
    paid = SavedSolution(
        begin=none,
        end=none,
        weight=np.zeros(0),
        slot=places["estimate"].astype(np.int64) * states.problem.steps + places["step"],
        price=places["price"],
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
