"""Estimates of a long component: their prices in one unit each, and what is left of them."""

from pathlib import Path

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints, concatenated
from tgospa_eval.errors import SolverError
from tgospa_eval.partitioned.long.tables import (
    BUSY,
    PRICE_AT,
    WindowPiece,
    expansion,
    fraction,
    load_pieces,
    no_assignment,
)
from tgospa_eval.partitioned.shards import HELD, PARTS_OF_TRACKS, Table, contribute
from tgospa_eval.partitioned.tasks import writing_folder
from tgospa_eval.problem.certificate import idle_prices
from tgospa_eval.problem.rows import PricedPlaces
from tgospa_eval.problem.slots import exact_running
from tgospa_eval.problem.weights import ONE


def join_columns(
    output: str, pieces: tuple[WindowPiece, ...], number: int, estimates: Ints
) -> None:
    """Sort by estimate what windows say of some: prices and busy stretches.

    Parameters
    ----------
    output : str
        The folder that is written.
    pieces : tuple of WindowPiece
        All steps.
    number : int
        Which shard of estimates.
    estimates : int array
        Their numbers.
    """
    places = load_pieces(pieces, "places", number, PRICE_AT)
    places = places[np.lexsort((places["step"], places["estimate"]))]
    busy = load_pieces(pieces, "busy", number, BUSY)
    busy = busy[np.lexsort((busy["begin"], busy["estimate"]))]
    present = load_pieces(pieces, "present", number, BUSY)
    size = len(estimates)
    rows = np.zeros(size, np.int64)
    whose = np.searchsorted(estimates, present["estimate"])
    np.add.at(rows, whose, present["end"] - present["begin"] + 1)
    first = np.searchsorted(places["estimate"], _ends(estimates))
    unit, sums = exact_running(np.ascontiguousarray(places["price"]), first.astype(np.int32))
    with writing_folder(output) as folder:
        np.save(folder / "estimates.npy", estimates)
        np.save(folder / "rows.npy", rows)
        np.save(folder / "first.npy", first)
        np.save(folder / "step.npy", places["step"])
        np.save(folder / "whole.npy", sums[1:] - sums[:-1])
        np.save(folder / "unit.npy", unit[:size])
        np.save(folder / "busy_first.npy", np.searchsorted(busy["estimate"], _ends(estimates)))
        np.save(folder / "busy.npy", busy)


def _ends(numbers: Ints) -> Ints:
    return np.append(numbers, numbers[-1] + 1)


def load_columns(
    folders: tuple[str, ...], estimates: Ints, first_step: int
) -> tuple[PricedPlaces, Ints, Table]:
    """What `join_columns` knows of some estimates, sorted; steps are counted from the first.

    Returns
    -------
    places : PricedPlaces
        Their prices; estimates are numbered in the order asked for.
    index : (K,) int array
        Number of each place among those of all estimates.
    busy : table of BUSY
        Likewise numbered.
    """
    counts, steps, wholes, units, indices, busies = [], [], [], [], [], []
    before = done = 0
    for place in map(Path, folders):
        known = np.load(place / "estimates.npy")
        first = np.load(place / "first.npy")
        low, high = np.searchsorted(estimates, (known[0], known[-1] + 1)).tolist()
        mine = np.searchsorted(known, estimates[low:high])
        counts.append(first[mine + 1] - first[mine])
        index = concatenated(first[mine], counts[-1])
        steps.append(np.load(place / "step.npy", mmap_mode="r")[index] - np.int32(first_step))
        wholes.append(np.load(place / "whole.npy", mmap_mode="r")[index])
        units.append(np.load(place / "unit.npy")[mine])
        indices.append(index + before)
        first_busy = np.load(place / "busy_first.npy")
        count = first_busy[mine + 1] - first_busy[mine]
        stretches = concatenated(first_busy[mine], count)
        busy = np.array(np.load(place / "busy.npy", mmap_mode="r")[stretches])
        busy["estimate"] = np.repeat(np.arange(low, high), count)
        busies.append(busy)
        before += int(first[-1])
        done = high
    if done != len(estimates):
        raise SolverError("estimates of a component are in none of its parts: please report this")
    first = np.concatenate(([0], np.cumsum(np.concatenate(counts))))
    busy = np.concatenate(busies)
    busy["begin"] -= first_step
    busy["end"] -= first_step
    places = PricedPlaces(
        first=first.astype(np.int32),
        step=np.concatenate(steps).astype(np.int32),
        whole=np.concatenate(wholes),
        unit=np.concatenate(units),
    )
    return places, np.concatenate(indices), busy


def add_rest(
    output: str,
    *,
    columns: str,
    before: int,
    rows: tuple[str, ...],
    window: tuple[int, int],
    price: float,
) -> None:
    """Add up what rows leave of the prices of some estimates, and check sums.

    Written are terms of the lower bound for prices that nobody pays, and where these are, by step.

    Parameters
    ----------
    output : str
        The folder that is written.
    columns : str
        What `join_columns` wrote of them.
    before : int
        Places of the estimates before these.
    rows : tuple of str
        What `prove_rows` wrote of all truths.
    window : pair of int
        First and last step of the component.
    price : float
        Of a step at which an estimate is unassigned.
    """
    place = Path(columns)
    first = np.load(place / "first.npy")
    whole, unit = np.load(place / "whole.npy"), np.load(place / "unit.npy")
    left = np.ones(len(whole), np.int32)
    for folder in map(Path, rows):
        index = np.load(folder / "aside.npy", mmap_mode="r")
        low, high = np.searchsorted(index, (before, before + len(whole)))
        own = index[low:high] - before
        left[own] -= np.load(folder / "asides.npy", mmap_mode="r")[low:high]
    sums = np.zeros(len(whole) + 1, np.int64)
    np.cumsum(whole, out=sums[1:])
    terms = idle_prices((unit, sums), left, first.astype(np.int32))
    estimates = np.load(place / "estimates.npy")
    held = _held(rows, estimates)
    step = np.load(place / "step.npy")
    owner = np.repeat(estimates, np.diff(first))
    lost = whole * np.repeat(unit, np.diff(first)) * (1 - _loads(held, owner, step) / ONE)
    size = window[1] - window[0] + 1
    steps = np.load(place / "rows.npy")
    free = steps - _assigned(rows, estimates)
    nothing = np.zeros(len(estimates))
    tracks = {
        "track": estimates,
        "rows": steps,
        **dict.fromkeys(PARTS_OF_TRACKS, nothing),
        "unassigned": price * free,
        "unassigned_count": free,
    }
    with writing_folder(output) as folder:
        np.savez(
            folder / "sums.npz",
            lower=expansion(terms.ravel().tolist()),
            lost=np.bincount(step - window[0], lost, minlength=size),
        )
        contribute(folder, estimates=tracks)


def _assigned(rows: tuple[str, ...], estimates: Ints) -> Floats:
    """At how many steps with a near pair each estimate is assigned."""
    sums = np.zeros((2, len(estimates)), np.int64)
    for folder in map(Path, rows):
        track = np.load(folder / "columns.npy")
        low, high = np.searchsorted(track, (estimates[0], estimates[-1] + 1))
        at = np.searchsorted(estimates, track[low:high])
        sums[:, at] += np.load(folder / "assigned_columns.npy")[:, low:high]
    return fraction(sums)


def _held(rows: tuple[str, ...], estimates: Ints) -> Table:
    """All assignments of some estimates by (estimate, begin)."""
    found = [np.zeros(0, HELD)]
    for folder in map(Path, rows):
        held = np.load(folder / "by_estimate.npy", mmap_mode="r")
        whose = np.load(folder / "by_estimate.key.npy")
        low, high = np.searchsorted(whose, (estimates[0], estimates[-1] + 1))
        found.append(np.array(held[low:high]))
    held = np.concatenate(found)
    return held[np.lexsort((held["begin"], held["estimate"]))]


def _loads(held: Table, estimate: Ints, step: Ints) -> Floats:
    """How much of estimates is assigned at steps, in units of 1/ONE; checks that it is at most ONE.

    Raises
    ------
    SolverError
        It is more at any step, which only a fault of this program can bring about.
    """
    whose = np.concatenate((held["estimate"], held["estimate"])).astype(np.int64) << 32
    moment = whose + np.concatenate((held["begin"], held["end"].astype(np.int64) + 1))
    change = np.concatenate((held["weight"], -held["weight"]))
    # What ends comes before what begins at the same step.
    order = np.lexsort((change > 0, moment))
    load = np.cumsum(change[order])
    if load.max(initial=0) > ONE:
        raise no_assignment()
    sought = (estimate.astype(np.int64) << 32) + step
    at = np.searchsorted(moment[order], sought, side="right")
    return np.concatenate(([0], load))[at]
