"""Blocks of time: their steps, their rows, and the near pairs of these rows.

The *times* of a side are the distinct times of its rows. A *step* is an evaluated time. A time of a
side can be matched to a step that is slightly earlier or later. If it is matched to no step, its
rows are not evaluated. An array over the steps of a block has the size (L,), and an array over all
steps the size (T,).
"""

import itertools
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Ints, Mask, stretches
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.writing import writing_folder
from tgospa_eval.distances import Pairs, Resources
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.axis import Axis, Sides, on_axis
from tgospa_eval.evaluation.prepare import AlignedPair, NearPairs, fit
from tgospa_eval.evaluation.prove import parts_of_distances
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.partitioned.shards import ENTRY, marks_of
from tgospa_eval.partitioned.sides import PartsSide
from tgospa_eval.problem.problem import Problem
from tgospa_eval.quoting import option
from tgospa_eval.results.consistency import NEES
from tgospa_eval.results.records import Arrays, Json
from tgospa_eval.tracks.alignment import Alignment, Times, align
from tgospa_eval.tracks.coverage import row_sums
from tgospa_eval.tracks.interpolation import find_times
from tgospa_eval.tracks.trajectories import Trajectories


def read_times(side: PartsSide, span: slice) -> Reading:
    """Read the rows at the times in a slice of `side.times`; the slice may be empty."""
    times = side.times[span]
    return side.read(times[0].item(), times[-1].item()) if len(times) else side.read(1, 0)


def places(times: Times, first: float, last: float) -> slice:
    """Return the slice of the sorted `times` from `first` to `last`, both included."""
    begin = int(np.searchsorted(times, first, side="left"))
    return slice(begin, int(np.searchsorted(times, last, side="right")))


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockPiece:
    """A block: consecutive steps, and the times of both sides that are read for it.

    Parameters
    ----------
    low : int
        Index of the first step of the block among all steps.
    times : (L,) array
        Times of the steps. A block can be without steps.
    sides : pair of PartsSide
        Truth and estimate.
    spans : pair of slice
        For each side, the slice of its times that are read.
    step : pair of int arrays
        For each side and each time that is read, the index of its step in the block; -1 if the time
        is at no step.
    """

    low: int
    times: Times
    sides: tuple[PartsSide, PartsSide]
    spans: tuple[slice, ...]
    step: tuple[Ints, ...]

    def read(self) -> tuple[Reading, Reading]:
        """Read the rows of truth and estimate."""
        first, second = map(read_times, self.sides, self.spans)
        return first, second

    def at(self, which: int, trajectories: Trajectories) -> tuple[Trajectories, int]:
        """Return the rows of a side that are at steps, and their number.

        `which` is 0 for the truth and 1 for the estimate. `trajectories` has all rows that were
        read for this side.
        """
        step = self.step[which]
        on = step >= 0
        place, there = find_times(
            trajectories.times, self.sides[which].times[self.spans[which]][on]
        )
        rows = np.flatnonzero(there[trajectories.step])
        step = step[on][place[trajectories.step[rows]]]
        return trajectories.chosen(rows, step, self.times), len(rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockPlan:
    """Plan of the blocks: all steps of an evaluation, and how the times of both sides match them.

    Parameters
    ----------
    times : (T,) array
        Times of the steps.
    sides : pair of PartsSide
        Truth and estimate.
    step : pair of int arrays
        For each side and each of its times, the index of the step; -1 if the time is at no step.
    request : EvaluationRequest
        Options of the evaluation.
    names : pair of str
        Names of truth and estimate in messages.
    """

    times: Times
    sides: tuple[PartsSide, PartsSide]
    step: tuple[Ints, Ints]
    request: EvaluationRequest
    names: tuple[str, str]

    @cached_property
    def rows(self) -> Ints:
        """Number of rows of both sides at each step and between it and the next step, (T,)."""
        rows = np.zeros(len(self.times), np.int64)
        if len(rows):
            for side, timestamps in zip(self.sides, self.timestamps, strict=True):
                inside = places(timestamps, self.times[0], self.times[-1])
                at = np.searchsorted(self.times, timestamps[inside], side="right") - 1
                np.add.at(rows, at, side.counts[inside])
        return rows

    @cached_property
    def timestamps(self) -> tuple[Times, ...]:
        """Times of both sides; a time that is matched to a step is replaced by that of the step."""
        of_sides = []
        for side, step in zip(self.sides, self.step, strict=True):
            timestamps = side.times.astype(np.result_type(side.times, self.times))
            timestamps[step >= 0] = self.times[step[step >= 0]]
            of_sides.append(timestamps)
        return tuple(of_sides)

    def pieces(self, max_rows: int) -> Iterator[BlockPiece]:
        """Yield all blocks, each with about `max_rows` rows of both sides together."""
        timestamps = np.unique(np.concatenate((*self.timestamps, self.times)))
        rows = np.zeros(len(timestamps), np.int64)
        for side, own in zip(self.sides, self.timestamps, strict=True):
            rows[np.searchsorted(timestamps, own)] += side.counts
        for begin, end in itertools.pairwise(stretches(rows, max_rows).tolist()):
            yield self._between(timestamps[begin].item(), timestamps[end - 1].item())

    def piece(self, low: int, high: int) -> BlockPiece:
        """Return the block with the steps from index `low` until before `high`."""
        return self._between(self.times[low].item(), self.times[high - 1].item())

    def _between(self, first: float, last: float) -> BlockPiece:
        steps = places(self.times, first, last)
        spans = tuple(places(timestamps, first, last) for timestamps in self.timestamps)
        return BlockPiece(
            low=steps.start,
            times=self.times[steps],
            sides=self.sides,
            spans=spans,
            step=tuple(
                np.where(step[span] >= 0, step[span] - steps.start, -1)
                for step, span in zip(self.step, spans, strict=True)
            ),
        )


# -------------------------------------------------------------------------------------------------
# Steps of both sides, from their timestamps.

STAMP = "stamp"
"""Name of the attribute that has the index of each time in the result of `clock_of`."""


def find_steps(
    sides: tuple[PartsSide, PartsSide],
    clocks: Sides,
    request: EvaluationRequest,
    names: tuple[str, str],
) -> tuple[Axis, Alignment, BlockPlan]:
    """Match the times of truth and estimate; return time axis, alignment, and plan of the blocks.

    In the alignment, each side has a row for each of its times that is matched to a step.

    Parameters
    ----------
    sides : pair of PartsSide
        Truth and estimate.
    clocks : pair of Trajectories
        Times of both sides, from `clock_of`.
    request : EvaluationRequest
        Options of the evaluation.
    names : pair of str
        Names of truth and estimate in messages.

    Raises
    ------
    TgospaError
        There is no step, or the data are wrong.
    """
    matching = request.time_matching
    axis = on_axis(clocks, matching, request.distance, names, request.parameters.cutoff)
    grid = align(*axis.sides, matching, names)
    if matching.of_estimate:
        axis = replace(axis, horizon=grid.truth)
    if grid.union and not len(grid.truth.times):
        raise ConfigError(f"{option('grid', matching.grid)}: none of {grid.union:,} steps is left")
    if matching.of_estimate and matching.outage != "none":
        raise ConfigError(
            f"{option('grid', matching.grid)}: for data in parts it is not known what a tracker "
            f"misses in outages; use {option('grid', 'truth')}, or {option('outage', 'none')} "
            "if the tracker reports only what it sees"
        )
    step = _step_of(sides[0], grid.truth), _step_of(sides[1], grid.estimate)
    sides = replace(sides[0], clock=grid.truth.clock), replace(sides[1], clock=grid.truth.clock)
    plan = BlockPlan(times=grid.truth.times, sides=sides, step=step, request=request, names=names)
    return axis, grid, plan


def clock_of(side: PartsSide) -> Trajectories:
    """Return the times of a side as a single track that has a row at each time."""
    size = len(side.times)
    return Trajectories(
        step=np.arange(size, dtype=np.int32),
        track=np.zeros(size, np.int32),
        state=np.zeros((size, len(side.columns))),
        ids=np.array(["times"], dtype=object),
        times=side.times,
        columns=side.columns,
        clock=side.clock,
        labels=side.labels,
        attributes={STAMP: np.arange(size, dtype=np.float64)},
    )


def _step_of(side: PartsSide, on: Trajectories) -> Ints:
    """Return, for each time of a side, the index of its step; -1 if the time is at no step.

    `on` has the rows of the result of `clock_of` that are at steps.
    """
    step = np.full(len(side.times), -1)
    if len(on.step):
        step[on.attributes[STAMP].astype(np.int64)] = on.step
    return step


PAIR = np.dtype([("truth", "<i4"), ("estimate", "<i4"), ("entries", "<i8")])
"""Type of a pair of tracks of a block that are near at some step. Its fields are the indices of
both tracks in the block, and the number of steps of the block at which they are near."""


def fitted(
    piece: BlockPiece, sides: Sides, request: EvaluationRequest, names: tuple[str, str]
) -> tuple[AlignedPair, tuple[int, int]]:
    """Align both sides of a block on its steps, and count the rows of each side at steps.

    `sides` has the rows that were read for the block.
    """
    truth, estimate = (piece.at(which, side) for which, side in enumerate(sides))
    axis = Axis(sides=(truth[0], estimate[0]), horizon=truth[0])
    return fit(*sides, request, names, lambda _: axis), (truth[1], estimate[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Scanned:
    """Facts about a block after its rows were read. Its near pairs remain in a file.

    Parameters
    ----------
    first : int
        Index of the first step of the block among all steps.
    objects : pair of (L,) int arrays
        Number of truths and number of estimates at each step.
    unjudged : pair of (L,) int arrays
        Number of ignored truths and number of excused estimates at each step.
    near : int
        Number of pairs of tracks that are near at some step.
    slack : float
        `Problem.cost_slack` of the block.
    blur : float
        `Distance.last_place` of the block; infinite if it has no rows at steps.
    at_cutoff : int
        `Problem.at_cutoff` of the block.
    counting : tuple of int
        Result of `tracks.coverage.row_sums` from the rows of the truth that are at steps.
    folder : Path
        Folder of the block, which `scan` wrote.
    """

    first: int
    objects: tuple[Ints, Ints]
    unjudged: tuple[Ints, Ints]
    near: int
    slack: float
    blur: float
    at_cutoff: int
    counting: tuple[int, ...]
    folder: Path

    def read(self, name: str) -> NDArray[Any]:
        """Read one of the arrays that are kept in a file, because they grow with the tracks.

        - ``"pairs"``: pairs of tracks that are near at some step (type PAIR)
        - ``"truth_ids"``: id of each truth with a row at a step
        - ``"truth_rows"``: number of rows of these truths at steps
        - ``"truth_unjudged_rows"``: number of these rows that are not evaluated
        - ``"estimate_ids"``, ``"estimate_rows"``, ``"estimate_unjudged_rows"``: the same for
          estimates
        """
        with np.load(self.folder / "block.npz") as arrays:
            array: NDArray[Any] = arrays[name]
            return array

    @classmethod
    def load(cls, folder: Path) -> "Scanned":
        """Read the facts from a folder that `scan` wrote."""
        with np.load(folder / "block.npz") as arrays:
            both = {
                name: (arrays[f"truth_{name}"], arrays[f"estimate_{name}"])
                for name in ("objects", "unjudged")
            }
            return cls(
                **both,
                first=int(arrays["first"]),
                near=int(arrays["near"]),
                folder=folder,
                slack=float(arrays["slack"]),
                blur=float(arrays["blur"]),
                at_cutoff=int(arrays["at_cutoff"]),
                counting=tuple(json.loads(str(arrays["counting"]))),
            )


BESIDE = "beside.npz"
"""Name of a file of a block. It has *further values* of the near pairs: parts of distances, and
NEES. The file is only written if there are such values."""

READ = "read.json"
"""Name of a file of a block. It has facts about all rows that were read, for each side."""


def scan(
    output: str, piece: BlockPiece, request: EvaluationRequest, names: tuple[str, str]
) -> None:
    """Read the rows of a block, search its near pairs, and write pairs and facts about the rows.

    Parameters
    ----------
    output : str
        Folder to write. It gets the file `READ`, the near pairs (type `shards.ENTRY`), and the data
        of `Scanned`. It also gets the file `BESIDE` if there are further values.
    piece : BlockPiece
        The block.
    request : EvaluationRequest
        Options of the evaluation.
    names : pair of str
        Names of truth and estimate in messages.

    Raises
    ------
    TgospaError
        The data are wrong.
    """
    readings = piece.read()
    sides = readings[0].trajectories, readings[1].trajectories
    on_steps, own = fitted(piece, sides, request, names)
    with writing_folder(output) as folder:
        _write_block(folder, piece.low, on_steps, request)
        known: list[Json] = [
            {
                "left_out": reading.left_out,
                "idle": list(reading.idle) if reading.rows else None,
                "sums": row_sums(reading.trajectories.reduced_to(request.distance.kinds)),
                "at_steps": count,
                "warnings": [vars(notice) for notice in reading.warnings],
            }
            for reading, count in zip(readings, own, strict=True)
        ]
        (folder / READ).write_text(json.dumps(known), encoding="utf-8")


def _write_block(folder: Path, low: int, fitted: AlignedPair, request: EvaluationRequest) -> None:
    """Write the near pairs of a block, their further values, and the data of `Scanned`.

    `low` is the index of the first step of the block.
    """
    near, problem, beside = _problem(fitted, request)
    aligned, kinds = (fitted.alignment.truth, fitted.alignment.estimate), fitted.distance.kinds
    entry = np.empty(len(problem.cost), ENTRY)
    entry["step"] = problem.entry_step
    entry["step"] += np.int32(low)
    entry["truth"] = problem.truth_track[problem.truth_row]
    entry["estimate"] = problem.estimate_track[problem.estimate_row]
    entry["cost"], entry["marks"] = problem.powers(slice(None)), marks_of(problem, slice(None))
    pairs = _pairs(entry, len(aligned[1].ids))
    unjudged, is_empty = near.unjudged, not len(problem.truth_step) + len(problem.estimate_step)
    arrays: dict[str, object] = {
        "first": low,
        "near": len(pairs),
        "pairs": pairs,
        "slack": problem.cost_slack,
        "blur": np.inf if is_empty else near.distance.last_place(near.sides),
        "at_cutoff": problem.at_cutoff,
        "counting": json.dumps(row_sums(aligned[0].reduced_to(kinds))),
    }
    masks: tuple[Mask | slice, Mask | slice] = unjudged or (slice(0), slice(0))
    for role, side, mask in zip(("truth", "estimate"), aligned, masks, strict=True):
        arrays[f"{role}_objects"] = np.bincount(side.step, minlength=len(side.times))
        arrays[f"{role}_ids"] = side.ids.astype(np.str_)
        arrays[f"{role}_rows"] = np.bincount(side.track, minlength=len(side.ids))
        arrays[f"{role}_unjudged"] = np.bincount(side.step[mask], minlength=len(side.times))
        arrays[f"{role}_unjudged_rows"] = np.bincount(side.track[mask], minlength=len(side.ids))
    np.save(folder / "entries.npy", entry)
    if beside:
        np.savez(folder / BESIDE, **beside)  # type: ignore[arg-type]
    np.savez(folder / "block.npz", **arrays)  # type: ignore[arg-type]


def _problem(sides: AlignedPair, request: EvaluationRequest) -> tuple[NearPairs, Problem, Arrays]:
    """Return near pairs, their problem, and the further values of each pair (see `BESIDE`)."""
    aligned, parameters = sides.alignment, request.parameters
    near = NearPairs.of(aligned, request, sides.distance, parameters.cutoff, Resources(jobs=1))
    problem, distance, unjudged = near.problem(parameters), near.distance, near.unjudged
    entries, rows = np.arange(len(problem.cost)), (problem.truth_row, problem.estimate_row)
    beside = parts_of_distances(
        near.sides,
        distance,
        parameters,
        problem,
        entries,
        (problem.truth_row[entries], problem.estimate_row[entries]),
    )
    reduced = aligned.truth.reduced_to(request.kinds), aligned.estimate.reduced_to(request.kinds)
    spread = reduced[1].spread
    if spread is not None:
        from tgospa_eval.evaluation.consistency import nees_of, periods_in  # lazy: rarely needed

        periods = periods_in(distance, reduced[0].columns)
        spreads = reduced[0].spread, spread
        beside[NEES] = nees_of((reduced[0].state, reduced[1].state), spreads, rows, periods)
        if unjudged is not None:  # pairs with an ignored truth have no NEES
            beside[NEES][unjudged[0][rows[0]]] = np.nan
    return near, problem, beside


def _pairs(entry: NDArray[np.void], width: int) -> NDArray[np.void]:
    key, entries = np.unique(
        entry["truth"].astype(np.int64) * max(width, 1) + entry["estimate"], return_counts=True
    )
    pairs = np.empty(len(key), PAIR)
    pairs["truth"], pairs["estimate"] = np.divmod(key, max(width, 1))
    pairs["entries"] = entries
    return pairs


def constants(
    request: EvaluationRequest, columns: tuple[str, ...], blocks: Sequence[Scanned]
) -> Problem:
    """Return a problem without entries that has the error fields of the whole problem.

    The error fields are `cost_error`, `cost_slack` and `rounding`. They are needed for the bounds
    of the whole problem.
    """
    parameters, none = request.parameters, np.zeros(0, np.int32)
    nothing = Trajectories.of_times(np.zeros(0), columns, "number")
    pairs = Pairs(truth_row=none, estimate_row=none, distance=np.zeros(0))
    near = NearPairs(sides=(nothing, nothing), distance=request.distance, pairs=pairs)
    problem = near.problem(parameters)
    objects = sum(int(counts.sum()) for block in blocks for counts in block.objects)
    blur = min((block.blur for block in blocks), default=np.inf) / parameters.cutoff
    return replace(
        problem,
        cost_slack=math.fsum(block.slack for block in blocks),
        rounding=objects * blur**parameters.order if blur < 1 else 0.0,
    )
