"""One long component: planned, solved in windows, joined, proven, repaired where it is open."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints, stretches
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.partitioned.long.borders import value_borders
from tgospa_eval.partitioned.long.columns import add_rest, join_columns
from tgospa_eval.partitioned.long.rows import prove_rows
from tgospa_eval.partitioned.long.tables import WindowPiece, fraction
from tgospa_eval.partitioned.long.windows import count_entries, solve_window
from tgospa_eval.partitioned.shards import PartialSums, contribute
from tgospa_eval.partitioned.tasks import Run, Task, left_until, writing_folder
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.problem.paths import down

OVERLAP = 20
"""Steps with near pairs that a window has on either side of what its answer is for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Component:
    """A component to solve in windows, and what is known of it before that.

    Parameters
    ----------
    entries : sequence of (str, int, int)
        Files of ENTRY, by time, and from which row to before which.
    parameters : Parameters
        Of the metric.
    work : str
        Folder for what lies between.
    gap : float
        Relative gap that counts as exact.
    together : int
        Entries that a task may hold.
    end : float, optional
        In `time.time()`: what is not solved by then is left unassigned.
    file_first : (F + 1,) int array
        Entries before those of each file.
    step : (K,) int array
        The steps with entries.
    step_first : (K + 1,) int array
        Entries before each of them.
    estimates : (n,) int array
        Numbers of its estimates.
    truth_bounds, estimate_bounds : int arrays
        The first number of each shard, and the end.
    """

    entries: Sequence[tuple[str, int, int]]
    parameters: Parameters
    work: str
    gap: float
    together: int
    end: float | None
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
        begin, end = self.step_first[np.searchsorted(self.step, (low, high))].tolist()
        return tuple(
            (path, row + max(begin, first) - first, row + min(end, last) - first)
            for (path, row, _), (first, last) in zip(
                self.entries, itertools.pairwise(self.file_first.tolist()), strict=True
            )
            if max(begin, first) < min(end, last)
        )

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


def _added(counted: list[Ints]) -> tuple[Ints, Ints]:
    number, count = np.concatenate(counted, axis=1)
    known, index = np.unique(number, return_inverse=True)
    sums = np.zeros(len(known), np.int64)
    np.add.at(sums, index, count)
    return known, sums


def _bounds(number: Ints, count: Ints, size: int) -> Ints:
    """First numbers of stretches of about `size` counts each, and the end."""
    return np.append(number[stretches(count, size)[:-1]], number[-1] + 1)


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
    component: Component, joined: ComponentBounds, overlap: int, number: int
) -> tuple[dict[str, Task], dict[str, Task], tuple[WindowPiece, ...]]:
    """Tasks of borders, of the windows around open seams, and the pieces once these are solved.

    Parameters
    ----------
    component : Component
        What is solved.
    joined : ComponentBounds
        What is proven so far.
    overlap : int
        Of the windows of this round: four times as many steps are solved on either side of a seam.
    number : int
        Which round it is.
    """
    work = f"{component.work}/round-{number}"
    stretches = _stretches(component, joined, 4 * overlap)
    borders: dict[str, Task] = {
        f"{work}/borders/{index:05d}": partial(
            value_borders,
            rows=rows,
            pieces=joined.pieces,
            number=index,
            columns=joined.columns,
            window=component.window,
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
            (low, high),
            (low, high),
            near=tuple(
                replace(piece, low=max(piece.low, low), high=min(piece.high, high))
                for piece in joined.pieces
                if piece.low < high and piece.high > low
            ),
            borders=tuple(borders),
            number=index,
            ends=(low <= component.window[0], high > component.window[1]),
        )
        pieces = _replaced(pieces, WindowPiece(folder=output, low=low, high=high))
    return borders, windows, pieces


def _window(
    component: Component,
    around: tuple[int, int],
    core: tuple[int, int],
    **known: Any,
) -> Task:
    """The task to solve a window, with what is known of it besides."""
    return partial(
        solve_window,
        entries=component.between(*around),
        around=around,
        core=core,
        parameters=component.parameters,
        bounds=(component.truth_bounds, component.estimate_bounds),
        gap=0.25 * component.gap,
        end=component.end,
        **known,
    )


def _stretches(
    component: Component, joined: ComponentBounds, overlap: int
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
    around = [
        component.around(step, step, overlap, component.together // 2) for step in steps.tolist()
    ]
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
    entries: Sequence[tuple[str, int, int]],
    parameters: Parameters,
    work: str,
    run: Run,
    proven: Callable[[PartialSums], None] = lambda share: None,  # noqa: ARG005
    *,
    gap: float = 1e-9,
    together: int = 1_000_000,
    overlap: int = OVERLAP,
    end: float | None = None,
) -> ComponentBounds:
    """Solve a component, until its gap is met, repairs end or its time is up.

    Parameters
    ----------
    entries, parameters, work, gap, together, end
        As of `Component`; the folder of work has what is done already.
    run : Run
        Does tasks.
    proven : callable
        Takes what is proven, each time that it becomes better.
    overlap : int
        Steps with entries on either side of a window, at least.
    """
    component = make_component(entries, parameters, work, gap, together, end, run)
    # Influence fades the slower, the more a switch costs.
    overlap = max(overlap, math.ceil(5 + 4 * min(parameters.switch_price, FAR_SWITCH)))
    size = max(min(WINDOW_ENTRIES, component.together // 2), 1)
    windows: dict[str, Task] = {}
    pieces: list[WindowPiece] = []
    for number, core in enumerate(component.cores(size)):
        output = f"{component.work}/windows/{number:06d}"
        around = component.around(*core, overlap, component.together // 4)
        windows[output] = _window(component, around, core)
        pieces.append(WindowPiece(folder=output, low=core[0], high=core[1]))
    run(windows)
    best = joined = prove_long(component, tuple(pieces), "round-0", run)
    proven(best.share)
    stuck = rounds = 0
    for number in range(REPAIR_ROUNDS):
        if best.share.solved or stuck == PATIENCE or left_until(component.end) == 0:
            break
        borders, windows, repaired = repairs(component, joined, overlap, number)
        run(borders)
        run(windows)
        joined = prove_long(component, repaired, f"round-{number + 1}", run)
        before, best = best, better(best, joined, component.gap)
        proven(best.share)
        rounds = number + 1
        stuck = 0 if width(best) < LITTLE_PROGRESS * width(before) else stuck + 1
        overlap *= 2
    output = f"{component.work}/result-{rounds}"
    if not Path(output).exists():
        with writing_folder(output) as folder:
            contribute(folder, share=best.share)
    return replace(best, folders=(*best.folders, output))


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


def make_component(
    entries: Sequence[tuple[str, int, int]],
    parameters: Parameters,
    work: str,
    gap: float,
    together: int,
    end: float | None,
    run: Run,
) -> Component:
    """Count the entries and divide them."""
    counts: dict[str, Task] = {
        f"{work}/counts/{number:05d}.npz": partial(count_entries, path=path, low=low, high=high)
        for number, (path, low, high) in enumerate(entries)
    }
    run(counts)
    sides: dict[str, list[Ints]] = {"step": [], "truth": [], "estimate": []}
    sizes = []
    for path in counts:
        with np.load(path) as found:
            for name, known in sides.items():
                known.append(found[name])
            sizes.append(int(found["step"][1].sum()))
    step, truth, estimate = (_added(known) for known in sides.values())
    return Component(
        entries=entries,
        parameters=parameters,
        work=work,
        gap=gap,
        together=together,
        end=end,
        file_first=np.concatenate(([0], np.cumsum(sizes))),
        step=step[0],
        step_first=np.concatenate(([0], np.cumsum(step[1]))),
        estimates=estimate[0],
        truth_bounds=_bounds(*truth, together),
        estimate_bounds=_bounds(*estimate, 2 * together),
    )


def prove_long(
    component: Component, pieces: tuple[WindowPiece, ...], name: str, run: Run
) -> ComponentBounds:
    """Join pieces that have all steps, and prove what they say."""
    work = f"{component.work}/{name}"
    bounds = np.searchsorted(component.estimates, component.estimate_bounds).tolist()
    columns: dict[str, Task] = {
        f"{work}/columns/{n:05d}": partial(
            join_columns, pieces=pieces, number=n, estimates=component.estimates[low:high]
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
            window=component.window,
            parameters=component.parameters,
        )
        for n in range(len(component.truth_bounds) - 1)
    }
    run(rows)
    places = [int(np.load(f"{folder}/first.npy")[-1]) for folder in columns]
    rest: dict[str, Task] = {
        f"{work}/rest/{n:05d}": partial(
            add_rest,
            columns=folder,
            before=sum(places[:n]),
            rows=tuple(rows),
            window=component.window,
            price=component.parameters.unassigned_prices[1],
        )
        for n, folder in enumerate(columns)
    }
    run(rest)
    return _add_up(component, pieces, tuple(columns), tuple(rows), tuple(rest))


def _add_up(
    component: Component,
    pieces: tuple[WindowPiece, ...],
    columns: tuple[str, ...],
    rows: tuple[str, ...],
    rest: tuple[str, ...],
) -> ComponentBounds:
    first, last = component.window
    size = last - first + 1
    by_step, iterations = _steps(pieces)
    lower: list[float] = []
    regrets = [np.zeros((3, 0))]
    variation = np.zeros((2, size), np.int64)
    pairs = np.zeros(2, np.int64)
    for folder in rows:
        with np.load(f"{folder}/sums.npz") as found:
            lower += found["lower"].tolist()
            pairs += found["pairs"]
            variation += found["variation"]
            regrets.append(found["regret"])
    lost = np.zeros(size)
    for folder in rest:
        with np.load(f"{folder}/sums.npz") as found:
            lower += found["lower"].tolist()
            lost += found["lost"]
    missed_price, false_price = component.parameters.unassigned_prices
    objects = [int(by_step[name].sum()) for name in ("truths", "estimates")]
    idle = np.array([missed_price, false_price], np.float64) * (np.array(objects) - pairs)
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
