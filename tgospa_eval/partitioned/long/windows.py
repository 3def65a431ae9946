"""A window of a long component: solved by itself, and what its middle says."""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np

from tgospa_eval.common.arrays import Ints
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.partitioned.long.borders import frame, load_borders
from tgospa_eval.partitioned.long.holding import hold_runs
from tgospa_eval.partitioned.long.tables import (
    BUSY,
    GAIN,
    PRICE_AT,
    WindowPiece,
    halves,
    load_pieces,
    no_assignment,
    renumbered,
)
from tgospa_eval.partitioned.shards import (
    ENTRY,
    EXCUSED_ESTIMATE,
    HELD,
    Table,
    problem_of,
    save_parts,
    within,
)
from tgospa_eval.partitioned.tasks import left_until, writing, writing_folder
from tgospa_eval.problem.certificate import fair_prices
from tgospa_eval.problem.merging import merge_runs
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.solution import Solution
from tgospa_eval.problem.states import States
from tgospa_eval.problem.weights import ONE, repair, spare
from tgospa_eval.solvers.certified import Certified
from tgospa_eval.solvers.warm_start import SavedSolution, WarmStart, make_warm_start


def count_entries(output: str, path: str, low: int, high: int) -> None:
    """Count the entries of some rows of a file, by time, by step, truth and estimate."""
    entries = np.load(path, mmap_mode="r")[low:high]
    counted: dict[str, Any] = {
        name: np.stack(np.unique(entries[name], return_counts=True))
        for name in ("step", "truth", "estimate")
    }
    with writing(output) as beside, beside.open("wb") as file:
        np.savez(file, **counted)


def shard_of(number: Ints, bounds: Ints) -> Ints:
    """In which stretch each number is."""
    return np.searchsorted(bounds, number, side="right") - 1


def read_entries(stretches: tuple[tuple[str, int, int], ...]) -> Table:
    """The entries of `Component.between`."""
    found = [np.zeros(0, ENTRY)]
    for path, low, high in stretches:
        found.append(np.array(np.load(Path(path), mmap_mode="r")[low:high]))
    return np.concatenate(found)


def solve_window(
    output: str,
    *,
    entries: tuple[tuple[str, int, int], ...],
    around: tuple[int, int],
    core: tuple[int, int],
    parameters: Parameters,
    bounds: tuple[Ints, Ints],
    gap: float,
    near: tuple[WindowPiece, ...] = (),
    borders: tuple[str, ...] = (),
    number: int = 0,
    ends: tuple[bool, bool] = (True, True),
    end: float | None = None,
) -> None:
    """Solve a window, and write what its core says.

    Parameters
    ----------
    output : str
        The folder that is written.
    entries : tuple
        Where its entries are, as of `Component.between`.
    around : pair of int
        The steps of the window: from, and to before.
    core : pair of int
        Those of them that the answer is for.
    parameters : Parameters
        Of the metric.
    bounds : pair of int arrays
        Shards of truths and of estimates, as of `Component`.
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
    entry = read_entries(entries)
    entry_weights = np.zeros(len(entry), np.int64)
    holds, places, iterations = np.zeros(0, HELD), np.zeros(0, PRICE_AT), 0
    if left_until(end) != 0:
        known = load_borders(borders, number)
        before, after = (known[:0] if is_end else known for is_end in ends)
        problem, first, numbers = frame(entry, before, after, around, parameters)
        # Estimates are columns in every window: their prices are joined.
        states = merge_runs(problem, transpose=False)
        warm_start = None
        if near:
            sides = before, after
            warm_start = _warm_start(states, near, sides, around, first, numbers)
        solution = within(Certified(gap=gap, jobs=1), end)(states, Stopwatch(), warm_start)
        weights = repair(states, solution.weights)
        of_gain = np.flatnonzero(states.entry >= 0)
        of_entry = np.zeros(len(problem.cost), np.int64)
        of_entry[states.entry[of_gain]] = weights[of_gain]
        entry_weights = of_entry[len(before) : len(before) + len(entry)]
        holds = _holds(states, weights, core, first, numbers)
        places = _places(states, solution, core, first, numbers[1])
        iterations = solution.iterations
    inside = slice(*np.searchsorted(entry["step"], core).tolist())
    gains = np.zeros(len(entry[inside]), GAIN)
    for name in ENTRY.names or ():
        gains[name] = entry[name][inside]
    gains["weight"] = entry_weights[inside]
    del entry
    by_track = (
        ("gains", gains, "truth"),
        ("holds", holds, "truth"),
        ("places", places, "estimate"),
        ("busy", _busy(gains[gains["weight"] > 0]), "estimate"),
        ("present", _busy(gains[gains["marks"] & EXCUSED_ESTIMATE == 0]), "estimate"),
    )
    with writing_folder(output) as folder:
        for name, table, track in by_track:
            of_shard = bounds[0] if track == "truth" else bounds[1]
            part = shard_of(table[track], of_shard)
            save_parts(folder, name, table, part, len(of_shard) - 1)
        np.savez(folder / "steps.npz", iterations=iterations, **_steps(gains, core, parameters))


def _holds(
    states: States, weights: Ints, core: tuple[int, int], first: int, numbers: tuple[Ints, Ints]
) -> Table:
    """What is held without gain in the core; outside its block a pair goes on as at the border."""
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
    begin = np.maximum(begin + first, core[0])
    end = np.minimum(end + first, core[1] - 1)
    kept = (weights[state] > 0) & (begin <= end)
    held = np.zeros(int(kept.sum()), HELD)
    held["truth"] = numbers[0][states.pair_truth[pair[state[kept]]]]
    held["estimate"] = numbers[1][states.pair_estimate[pair[state[kept]]]]
    held["begin"], held["end"] = begin[kept], end[kept]
    held["weight"] = weights[state[kept]]
    held.sort(order=["truth", "estimate", "begin"])
    return held


def _places(
    states: States, solution: Solution, core: tuple[int, int], first: int, estimates: Ints
) -> Table:
    """The prices of the slots that begin in the core, at their first steps."""
    columns = states.columns
    prices = fair_prices(solution.prices)
    step = columns.step.astype(np.int64) + first
    paid = np.flatnonzero((prices > 0) & (step >= core[0]) & (step < core[1]))
    number = np.zeros(states.nodes, np.int64)
    number[states.pair_column] = states.pair_estimate
    places = np.zeros(len(paid), PRICE_AT)
    places["estimate"] = estimates[number[columns.node[paid]]]
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


def _steps(gains: Table, core: tuple[int, int], parameters: Parameters) -> dict[str, Any]:
    """By step of the core: cost of what is assigned, judged objects, how much of them is not."""
    low, high = core
    size = high - low
    numbers = np.unique(gains["truth"]), np.unique(gains["estimate"])
    problem = problem_of(gains, low, numbers, parameters)
    found: dict[str, Any] = {"first": low}
    for name, side in zip(("truth", "estimate"), problem.sides, strict=True):
        free = spare(side, np.arange(len(gains)), gains["weight"])
        if free.min(initial=0) < 0:
            raise no_assignment()
        found[f"{name}s"] = np.bincount(side.step[side.judged], minlength=size)
        found[f"free_{name}s"] = halves(free, side.step, size)
    paid = (gains["weight"] / ONE * problem.cost).tolist()
    edges = np.searchsorted(gains["step"], np.arange(low, high + 1)).tolist()
    found["localisation"] = np.array([math.fsum(paid[a:b]) for a, b in itertools.pairwise(edges)])
    return found


def _warm_start(
    states: States,
    near: tuple[WindowPiece, ...],
    borders: tuple[Table, Table],
    around: tuple[int, int],
    first: int,
    numbers: tuple[Ints, Ints],
) -> WarmStart:
    """What pieces say of the window: prices, and weights that are held where they can be."""
    low, high = around
    gains = load_pieces(near, "gains", None, GAIN)
    gains = gains[np.lexsort((gains["estimate"], gains["truth"], gains["step"]))]
    gains = np.concatenate(
        (
            _outside(borders[0], "held_before", low - 1),
            gains,
            _outside(borders[1], "held_after", high),
        )
    )
    weights = hold_runs(
        states,
        np.ascontiguousarray(gains["weight"]),
        renumbered(load_pieces(near, "holds", None, HELD), numbers, first),
        renumbered(_busy(gains[gains["weight"] > 0]), numbers, first),
    )
    places = renumbered(load_pieces(near, "places", None, PRICE_AT), numbers, first)
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
        weights=(weights / ONE,),
        prices=make_warm_start(states, (paid,), (1.0,)).prices,
        near=True,
    )


def _outside(borders: Table, held: str, step: int) -> Table:
    gains = np.zeros(len(borders), GAIN)
    for name in ("truth", "estimate"):
        gains[name] = borders[name]
    gains["step"], gains["weight"] = step, borders[held]
    return gains
