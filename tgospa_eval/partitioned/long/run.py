"""One long component: planned, solved in windows, joined, proven, repaired where it is open."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.partitioned.long.borders import value_borders
from tgospa_eval.partitioned.long.columns import add_rest, join_columns
from tgospa_eval.partitioned.long.rows import prove_rows
from tgospa_eval.partitioned.long.tables import WindowPiece, fraction
from tgospa_eval.partitioned.long.windows import (
    ComponentPlan,
    count_entries,
    make_plan,
    solve_window,
)
from tgospa_eval.partitioned.shards import PartialSums, contribute
from tgospa_eval.partitioned.tasks import Run, Task, left_until, writing_folder
from tgospa_eval.problem.paths import down
from tgospa_eval.problem.problem import Floats
from tgospa_eval.problem.tgospa import Parameters

OVERLAP = 20
"""Steps with near pairs that a window has on either side of what its answer is for."""


@dataclass(frozen=True, kw_only=True)
class Long:
    """A component to solve in windows.

    Parameters
    ----------
    entries : tuple of str
        Files of ENTRY, by time.
    parameters : Parameters
        Of the metric.
    work : str
        Folder for what lies between.
    gap : float
        Relative gap that counts as exact.
    together : int
        Entries that a task may hold.
    overlap : int
        Steps with entries on either side of a window.
    end : float, optional
        In `time.time()`: what is not solved by then is left unassigned.
    """

    entries: tuple[str, ...]
    parameters: Parameters
    work: str
    gap: float = 1e-9
    together: int = 1_000_000
    overlap: int = OVERLAP
    end: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ComponentBounds:
    """What is proven.

    Parameters
    ----------
    share : PartialSums
        What the component contributes.
    folders : tuple of str
        What it contributes, as folders of shards; all but one have an empty share.
    pieces : tuple of WindowPiece
        Whose answers it was made of.
    columns, rows : tuple of str
        What `join_columns` and `prove_rows` wrote.
    lost : (L,) float array
        Prices that nobody pays, by step.
    regret : (3, N) float array
        Of rows that could do better: by how much, first and last step.
    """

    share: PartialSums
    folders: tuple[str, ...]
    pieces: tuple[WindowPiece, ...]
    columns: tuple[str, ...]
    rows: tuple[str, ...]
    lost: Floats
    regret: Floats


OPEN_FROM = 0.1
"""A seam is open where more is lost than this share of its part of the gap allowed."""

WORST_STEPS = 1000
"""Steps that are looked at in a round beside seams: others are mostly near these."""


def repairs(
    component: Long, plan: ComponentPlan, joined: ComponentBounds, overlap: int, number: int
) -> tuple[dict[str, Task], dict[str, Task], tuple[WindowPiece, ...]]:
    """Tasks of borders, of the windows around open seams, and the pieces once these are solved.

    Parameters
    ----------
    component, plan
        What is solved.
    joined : ComponentBounds
        What is proven so far.
    overlap : int
        Of the windows of this round: four times as many steps are solved on either side of a seam.
    number : int
        Which round it is.
    """
    work = f"{component.work}/round-{number}"
    stretches = _stretches(component, plan, joined, 4 * overlap)
    borders: dict[str, Task] = {
        f"{work}/borders/{index:05d}": partial(
            value_borders,
            rows=rows,
            pieces=joined.pieces,
            number=index,
            columns=joined.columns,
            window=plan.window,
            parameters=component.parameters,
            around=stretches,
        )
        for index, rows in enumerate(joined.rows)
        if component.parameters.switch_price > 0  # else steps are apart
    }
    windows: dict[str, Task] = {}
    pieces = joined.pieces
    for index, (low, high) in enumerate(stretches):
        output = f"{work}/repairs/{index:06d}"
        windows[output] = _window(
            component,
            plan,
            (low, high),
            (low, high),
            near=tuple(p for p in joined.pieces if p.low < high and p.high > low),
            borders=tuple(borders),
            number=index,
            ends=(low <= plan.window[0], high > plan.window[1]),
        )
        pieces = _replaced(pieces, WindowPiece(folder=output, low=low, high=high))
    return borders, windows, pieces


def _window(
    component: Long,
    plan: ComponentPlan,
    around: tuple[int, int],
    core: tuple[int, int],
    **known: Any,
) -> Task:
    """The task to solve a window, with what is known of it besides."""
    return partial(
        solve_window,
        entries=plan.between(*around),
        around=around,
        core=core,
        parameters=component.parameters,
        bounds=(plan.truth_bounds, plan.estimate_bounds),
        gap=0.25 * component.gap,
        end=component.end,
        **known,
    )


def _stretches(
    component: Long, plan: ComponentPlan, joined: ComponentBounds, overlap: int
) -> tuple[tuple[int, int], ...]:
    """Stretches around seams and steps that keep the bracket open, the worst first, none twice.

    What is worth most at the borders of one depends on what is inside of its neighbours: those are
    left for another round.
    """
    share = joined.share
    seams = [piece.low for piece in joined.pieces[1:]]
    allowed = OPEN_FROM * component.gap * share.total / max(len(seams), 1)
    open_ = np.flatnonzero(joined.lost > allowed)
    worst = open_[np.argsort(-joined.lost[open_], kind="stable")[:WORST_STEPS]]
    steps = np.unique((*seams, *(worst + share.first)))
    lost = np.concatenate(([0.0], np.cumsum(joined.lost)))
    regret, begin, end = joined.regret
    around = [plan.around(step, step, overlap, component.together // 2) for step in steps.tolist()]
    left = np.array(
        [
            lost[high - share.first]
            - lost[low - share.first]
            + regret[(begin < high) & (end >= low)].sum()
            for low, high in around
        ]
    )
    chosen: list[tuple[int, int]] = []
    for index in np.argsort(-left, kind="stable").tolist():
        low, high = around[index]
        if left[index] > allowed and all(high < a or low > b for a, b in chosen):
            chosen.append((low, high))
    return tuple(sorted(chosen))


def _replaced(pieces: tuple[WindowPiece, ...], new: WindowPiece) -> tuple[WindowPiece, ...]:
    """The pieces with a new one in the place of what was there."""
    kept = [new]
    for piece in pieces:
        for low, high in (
            (piece.low, min(piece.high, new.low)),
            (max(piece.low, new.high), piece.high),
        ):
            if low < high:
                kept.append(replace(piece, low=low, high=high))
    return tuple(sorted(kept, key=lambda piece: piece.low))


REPAIR_ROUNDS = 12
"""How often open seams are solved again, each time with twice the overlap."""

LITTLE_PROGRESS, PATIENCE = 0.9, 3
"""So many rounds in turn that leave more of the bracket than this are the last."""

FAR_SWITCH = 50.0
"""Prices of half a switch above this are not met by longer windows, but by repairs."""

WINDOW_ENTRIES = 200_000
"""Entries of a window beside which no more pay: a solver takes the longer for each."""


def solve_long(
    component: Long,
    run: Run,
    proven: Callable[[PartialSums], None] = lambda share: None,  # noqa: ARG005
) -> ComponentBounds:
    """Solve a component, until its gap is met, repairs end or its time is up.

    Parameters
    ----------
    component : Long
        It; its folder of work has what is done already.
    run : Run
        Does tasks.
    proven : callable
        Takes what is proven, each time that it becomes better.
    """
    plan = plan_long(component, run)
    overlap = overlap_of(component)
    size = max(min(WINDOW_ENTRIES, component.together // 2), 1)
    windows: dict[str, Task] = {}
    pieces: list[WindowPiece] = []
    for number, core in enumerate(plan.cores(size)):
        output = f"{component.work}/windows/{number:06d}"
        around = plan.around(*core, overlap, component.together // 4)
        windows[output] = _window(component, plan, around, core)
        pieces.append(WindowPiece(folder=output, low=core[0], high=core[1]))
    run(windows)
    best = joined = prove_long(component, plan, tuple(pieces), "round-0", run)
    proven(best.share)
    stuck = rounds = 0
    for number in range(REPAIR_ROUNDS):
        if best.share.solved or stuck == PATIENCE or left_until(component.end) == 0:
            break
        borders, windows, repaired = repairs(component, plan, joined, overlap, number)
        run(borders)
        run(windows)
        joined = prove_long(component, plan, repaired, f"round-{number + 1}", run)
        before, best = best, better(best, joined, component.gap)
        proven(best.share)
        rounds = number + 1
        stuck = 0 if width(best) < LITTLE_PROGRESS * width(before) else stuck + 1
        overlap *= 2
    return _stored(best, f"{component.work}/result-{rounds}")


def better(first: ComponentBounds, second: ComponentBounds, gap: float) -> ComponentBounds:
    """The assignment of either that costs less, with the higher of both bounds."""
    (low, cost), (other_low, other_cost) = first.share.bracket, second.share.bracket
    cheaper = second if other_cost < cost else first
    prices = second if other_low > low else first
    lower, upper = max(low, other_low), min(cost, other_cost)
    share = replace(cheaper.share, lower=prices.share.lower, solved=upper - lower <= gap * upper)
    return replace(cheaper, share=share)


def width(joined: ComponentBounds) -> float:
    """Of its bracket."""
    lower, upper = joined.share.bracket
    return upper - lower


def _stored(joined: ComponentBounds, output: str) -> ComponentBounds:
    """With the share in a folder like the others."""
    if not Path(output).exists():
        with writing_folder(output) as folder:
            contribute(folder, share=joined.share)
    return replace(joined, folders=(*joined.folders, output))


def plan_long(component: Long, run: Run) -> ComponentPlan:
    """Count the entries and divide them."""
    counts: dict[str, Task] = {
        f"{component.work}/counts/{number:05d}.npz": partial(count_entries, path=path)
        for number, path in enumerate(component.entries)
    }
    run(counts)
    return make_plan(component.entries, list(counts), component.together, 2 * component.together)


def overlap_of(component: Long) -> int:
    """Steps on either side of a window: influence fades the slower, the more a switch costs."""
    price = min(component.parameters.switch_price, FAR_SWITCH)
    return max(component.overlap, math.ceil(5 + 4 * price))


def prove_long(
    component: Long, plan: ComponentPlan, pieces: tuple[WindowPiece, ...], name: str, run: Run
) -> ComponentBounds:
    """Join pieces that have all steps, and prove what they say."""
    work = f"{component.work}/{name}"
    bounds = np.searchsorted(plan.estimates, plan.estimate_bounds).tolist()
    columns: dict[str, Task] = {
        f"{work}/columns/{n:05d}": partial(
            join_columns, pieces=pieces, number=n, estimates=plan.estimates[low:high]
        )
        for n, (low, high) in enumerate(itertools.pairwise(bounds))
    }
    run(columns)
    rows: dict[str, Task] = {
        f"{work}/rows/{n:05d}": partial(
            prove_rows,
            pieces=pieces,
            number=n,
            columns=tuple(columns),
            window=plan.window,
            parameters=component.parameters,
        )
        for n in range(len(plan.truth_bounds) - 1)
    }
    run(rows)
    places = [int(np.load(f"{folder}/first.npy")[-1]) for folder in columns]
    rest: dict[str, Task] = {
        f"{work}/rest/{n:05d}": partial(
            add_rest,
            columns=folder,
            before=sum(places[:n]),
            rows=tuple(rows),
            window=plan.window,
            price=component.parameters.unassigned_prices[1],
        )
        for n, folder in enumerate(columns)
    }
    run(rest)
    return _add_up(component, plan, pieces, tuple(columns), tuple(rows), tuple(rest))


def _add_up(
    component: Long,
    plan: ComponentPlan,
    pieces: tuple[WindowPiece, ...],
    columns: tuple[str, ...],
    rows: tuple[str, ...],
    rest: tuple[str, ...],
) -> ComponentBounds:
    first, last = plan.window
    size = last - first + 1
    by_step, iterations = _steps(pieces)
    lower: list[float] = []
    regrets = [np.zeros((3, 0))]
    variation = np.zeros((2, size), np.int64)
    pairs = 0
    for folder in rows:
        with np.load(f"{folder}/sums.npz") as found:
            lower += found["lower"].tolist()
            pairs += int(found["pairs"])
            variation += found["variation"]
            regrets.append(found["regret"])
    lost = np.zeros(size)
    for folder in rest:
        with np.load(f"{folder}/sums.npz") as found:
            lower += found["lower"].tolist()
            lost += found["lost"]
    missed_price, false_price = component.parameters.unassigned_prices
    objects = [int(by_step[name].sum()) for name in ("truths", "estimates")]
    idle = np.array([missed_price, false_price]) * [count - pairs for count in objects]
    lower += down(idle).tolist()
    if math.fsum(lower) < 0:
        lower = [0.0]
    missed, false = (fraction(by_step[f"free_{name}s"]) for name in ("truth", "estimate"))
    total = fraction(variation)
    parts = {
        "localisation": by_step["localisation"],
        "missed": missed_price * missed,
        "false": false_price * false,
        "switch": component.parameters.switch_price * total,
    }
    upper = math.fsum(np.concatenate(list(parts.values())).tolist())
    share = PartialSums(
        **parts,
        first=first,
        missed_count=missed,
        false_count=false,
        switch_count=0.5 * total,
        truths=by_step["truths"],
        estimates=by_step["estimates"],
        lower=np.array(lower),
        total=upper,
        iterations=iterations,
        solved=upper - math.fsum(lower) <= component.gap * upper,
    )
    return ComponentBounds(
        share=share,
        folders=(*rows, *rest),
        pieces=pieces,
        columns=columns,
        rows=rows,
        lost=lost,
        regret=np.concatenate(regrets, axis=1),
    )


def _steps(pieces: tuple[WindowPiece, ...]) -> tuple[dict[str, NDArray[Any]], int]:
    """What windows say of each step, and the iterations of all their solvers."""
    parts: dict[str, list[NDArray[Any]]] = {}
    iterations: dict[str, int] = {}
    for piece in pieces:
        with np.load(f"{piece.folder}/steps.npz") as saved:
            found = dict(saved)
        low = int(found.pop("first"))
        iterations[piece.folder] = int(found.pop("iterations"))
        for name, values in found.items():
            parts.setdefault(name, []).append(values[..., piece.low - low : piece.high - low])
    joined = {name: np.concatenate(values, axis=-1) for name, values in parts.items()}
    return joined, sum(iterations.values())
