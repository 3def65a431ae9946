"""Both sides interpolated at the steps, block by block.

A state at a step is on the line between two of its track, which may be in other blocks, and as far
away as the longest gap. So all blocks are read once for the first and the last state of each track
in them. From these each gets the last state of every track before it, and the first after it, of
those that are near enough; and how many states there will be at each step is known before there
is one, so that no block makes more than there is memory for.
"""

import itertools
import pickle
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances.checks import check_states
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.partitioned.between import Resampled, merged, outermost, some
from tgospa_eval.partitioned.stretches import (
    NO_SPAN,
    Ends,
    OwnTimes,
    Piece,
    Stamping,
    places,
)
from tgospa_eval.partitioned.tasks import Run, writing
from tgospa_eval.problem.problem import Ints
from tgospa_eval.tracks.alignment import Times
from tgospa_eval.tracks.interpolation import (
    Interpolated,
)
from tgospa_eval.tracks.trajectories import Trajectories

NEIGHBOURS = "neighbours"
"""In the folder of work, that of states that others lie between."""

NO_ROWS = np.zeros(0, np.int64)

SHARES = 2
"""Rows that are read and states that are made are in memory together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Edges:
    """The task to find the first and last states of tracks in a block, and to count.

    Parameters
    ----------
    output : str
        The folder that is written.
    stretches : pair of Resampled
        Truth and estimate.
    request : EvaluationRequest
        What is asked.
    names : pair of str
        The sides, for messages.
    """

    output: str
    stretches: tuple[Resampled, Resampled]
    request: EvaluationRequest
    names: tuple[str, str]


def find_edges(task: Edges) -> None:
    """Do a task.

    Raises
    ------
    TgospaError
        Something is wrong with the data.
    """
    truth, estimate = (stretch.read().trajectories for stretch in task.stretches)
    check_states(truth, estimate, task.request.distance, task.names)
    with writing(task.output) as folder:
        folder.mkdir()
        for number, side in enumerate((truth, estimate)):
            found = task.stretches[number].forecast(side)
            seen = side.seen_as(task.request.distance.kinds)
            for last in (False, True):
                path = folder / f"{number}-{'last' if last else 'first'}"
                path.write_bytes(pickle.dumps(outermost(seen, last=last)))
            with (folder / f"{number}.npz").open("wb") as file:
                np.savez(file, rows=len(side.step), **vars(found))


@dataclass(frozen=True, kw_only=True, eq=False)
class Made:
    """What interpolation makes of a side.

    Parameters
    ----------
    own, between : (T,) int arrays
        States at each step, as of `Forecast`.
    unused : int
        States at other stamps.
    gaps : int
        Pairs of consecutive states of a track that are too far apart.
    """

    own: Ints
    between: Ints
    unused: int
    gaps: int

    def of(self, side: Trajectories) -> Interpolated:
        """The same of a side whose rows are not in memory."""
        return Interpolated(
            side=side,
            between=int(self.between.sum()),
            own=int(self.own.sum()),
            unused=self.unused,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Resampling:
    """Sides that are interpolated at the steps.

    Parameters
    ----------
    times : (T,) array
        The steps.
    blocks : list of Piece
        What is read together, for these steps.
    made : pair of Made
        How much there is of truth and estimate.
    """

    times: Times
    blocks: list[Piece]
    made: tuple[Made, Made]

    @property
    def rows(self) -> Ints:
        """States of both at each step (T,)."""
        first, second = (made.own + made.between for made in self.made)
        return np.asarray(first + second)

    def pieces(self, most: int) -> Iterator[Piece]:
        """All steps in pieces of about so many states; a block that is read may be several."""
        rows, most = self.rows, max(most // SHARES, 1)
        for block in self.blocks:
            own = rows[block.low : block.high]
            before = np.cumsum(own) - own
            cuts = np.flatnonzero(np.diff(before // most)) + 1
            edges = [block.low, *(block.low + cuts).tolist(), block.high]
            for low, high in itertools.pairwise(edges):
                yield replace(block, low=low, high=high, told=low == block.low)

    def piece(self, low: int, high: int) -> Piece:
        """What is read for steps from `low` on, up to `high` or the end of a block."""
        block = next(block for block in self.blocks if block.low <= low < block.high)
        return replace(block, low=low, high=min(high, block.high))


def resample(
    stamping: Stamping,
    request: EvaluationRequest,
    names: tuple[str, str],
    most: int,
    work: Path,
    run: Run[Any],
) -> Resampling:
    """See what there will be at the steps, and what is needed for it.

    Parameters
    ----------
    stamping : Stamping
        The steps, and the stamps of both sides.
    request : EvaluationRequest
        What is asked.
    names : pair of str
        The sides, for messages.
    most : int
        Rows that are read together, about.
    work : Path
        The folder of what is known on the way.
    run : callable
        Does tasks.

    Raises
    ------
    TgospaError
        Something is wrong with the data.
    """
    folder, times = work / NEIGHBOURS, stamping.times
    spans = list(stamping.spans(max(most // SHARES, 1)))
    pieces = []
    for number, (first, last) in enumerate(spans):
        low, high = places(times, first, last)
        stretches = [
            _stretch(
                side, times, (first, last), request, role, names[role], folder / f"{number:06d}"
            )
            for role, side in enumerate(stamping.sides)
        ]
        pieces.append(
            (Piece(low=low, high=high, stretches=(stretches[0], stretches[1])), stretches)
        )
    tasks = [
        Edges(
            output=str(folder / f"{number:06d}"),
            stretches=(stretches[0], stretches[1]),
            request=request,
            names=names,
        )
        for number, (_, stretches) in enumerate(pieces)
    ]
    run(find_edges, tasks)
    made = [_carried(tasks, role, times, spans) for role in (0, 1)]
    return Resampling(times=times, blocks=[piece for piece, _ in pieces], made=(made[0], made[1]))


def _stretch(
    side: OwnTimes,
    times: Times,
    span: Ends,
    request: EvaluationRequest,
    role: int,
    name: str,
    folder: Path,
) -> Resampled:
    """What of a side is between two moments."""
    own = side.times[slice(*places(side.times, *span))]
    return Resampled(
        side=side.side,
        span=(own[0].item(), own[-1].item()) if len(own) else NO_SPAN,
        ticks=_ticks(times, *span)[0],
        ends=(side.times[0].item(), side.times[-1].item()) if len(side.times) else None,
        request=request,
        number=role,
        names=(name, "--resample"),
        around=tuple(f"{folder}-{role}-{where}" for where in ("before", "after")),
    )


def _ticks(times: Times, first: float, last: float) -> tuple[Times, Ints]:
    """Steps from one time to another, those beside them, the first and the last; and their places.

    A stamp may be the step next to it but for rounding.
    """
    low, high = places(times, first, last)
    inside = np.arange(max(low - 1, 0), min(high + 1, len(times)))
    place = np.unique(np.append(inside, (0, len(times) - 1)))
    return times[place], place


def _carried(tasks: Sequence[Edges], role: int, times: Times, spans: Sequence[Ends]) -> Made:
    """Write what is before and after each block, and count what will be at the steps."""
    own, between = np.zeros(len(times), np.int64), np.zeros(len(times), np.int64)
    rows = narrow = 0
    ids: list[NDArray[np.str_]] = []
    held: Trajectories | None = None
    for task, span in zip(tasks, spans, strict=True):
        stretch, folder = task.stretches[role], Path(task.output)
        first, last = (_load(folder / f"{role}-{name}") for name in ("first", "last"))
        with np.load(folder / f"{role}.npz") as found:
            place = _ticks(times, *span)[1]
            own[place] += found["own"]
            between[place] += found["between"]
            narrow += int(found["narrow"])
            rows += int(found["rows"])
        ids = [np.unique(np.concatenate([*ids, first.ids.astype(np.str_)]))]
        held = some(first, NO_ROWS) if held is None else stretch.near(held, span[0])
        _save(stretch.around[0], held)
        both = merged([held, first])
        if len(held.step) and len(first.step):
            ticks, place = _ticks(times, both.times[0].item(), both.times[-1].item())
            across = replace(stretch, ticks=ticks).forecast(both)
            between[place] += across.between
            narrow += across.narrow
        held = outermost(merged([held, last]), last=True)
    held = None
    for task, span in zip(tasks[::-1], spans[::-1], strict=True):
        stretch = task.stretches[role]
        first = _load(Path(task.output) / f"{role}-first")
        held = some(first, NO_ROWS) if held is None else stretch.near(held, span[1])
        _save(stretch.around[1], held)
        held = outermost(merged([first, held]), last=False)
    tracks = len(ids[0]) if ids else 0
    return Made(own=own, between=between, unused=rows - int(own.sum()), gaps=rows - tracks - narrow)


def _load(path: Path) -> Trajectories:
    found: Trajectories = pickle.loads(path.read_bytes())
    return found


def _save(path: str, side: Trajectories) -> None:
    with writing(path) as beside:
        beside.write_bytes(pickle.dumps(side))
