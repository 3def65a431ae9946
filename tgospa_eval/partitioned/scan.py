"""A block of time: both sides read, near pairs found, objects counted."""

import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.distances import Effort
from tgospa_eval.distances.gating import prepared_pairs
from tgospa_eval.evaluation.axis import Axis, Sides
from tgospa_eval.evaluation.prepare import Fitted, fit
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.formats import Reading
from tgospa_eval.partitioned.shards import ENTRY
from tgospa_eval.partitioned.steps import BlockPiece
from tgospa_eval.partitioned.tasks import writing
from tgospa_eval.problem.problem import Ints, Problem
from tgospa_eval.problem.tgospa import tgospa_problem
from tgospa_eval.tracks.alignment import Times
from tgospa_eval.tracks.judged import NO_SUMS, row_sums

PAIR = np.dtype([("truth", "<i4"), ("estimate", "<i4"), ("entries", "<i8")])
"""Tracks that come near each other, by their numbers in a block, and at how many steps."""


def placed(piece: BlockPiece, times: Times, sides: Sides) -> Axis:
    """Both sides at the steps of a piece."""
    truth, estimate = (
        stretch.at(side, times) for stretch, side in zip(piece.stretches, sides, strict=True)
    )
    return Axis(sides=(truth, estimate), horizon=truth)


@dataclass(frozen=True, kw_only=True, eq=False)
class Scanned:
    """What is known of a block beside its entries.

    Parameters
    ----------
    first : int
        Number of its first step.
    objects : pair of (L,) int arrays
        Truths and estimates at each step.
    ids : pair of (k,) arrays of str
        Tracks of either side that have a row.
    rows : pair of (k,) int arrays
        How many rows they have.
    near : int
        Pairs of tracks that come near each other.
    slack : float
        As `Problem.cost_slack`.
    blur : float
        As `Distance.last_place`; infinite without objects.
    read : pair of Read
        What else is known of the two sides.
    judged : tuple of int
        `row_sums` of the truth at the steps.
    folder : Path
        Where it was read from.
    """

    first: int
    objects: tuple[Ints, Ints]
    ids: tuple[NDArray[np.str_], NDArray[np.str_]]
    rows: tuple[Ints, Ints]
    near: int
    slack: float
    blur: float
    read: "tuple[Read, Read]"
    judged: tuple[int, ...]
    folder: Path

    @property
    def pairs(self) -> NDArray[np.void]:
        """Tracks that come near each other, of PAIR: read anew each time, as they may be many."""
        with np.load(self.folder / "block.npz") as found:
            pairs: NDArray[np.void] = found["pairs"]
            return pairs

    @classmethod
    def load(cls, folder: Path) -> "Scanned":
        """Read what `scan` wrote."""
        with np.load(folder / "block.npz") as found:
            both = {
                name: (found[f"truth_{name}"], found[f"estimate_{name}"])
                for name in ("objects", "ids", "rows")
            }
            first, second = (Read(**of) for of in json.loads(str(found["read"])))
            return cls(
                **both,
                first=int(found["first"]),
                near=int(found["near"]),
                folder=folder,
                slack=float(found["slack"]),
                blur=float(found["blur"]),
                read=(first, second),
                judged=tuple(json.loads(str(found["judged"]))),
            )


@dataclass(frozen=True, kw_only=True)
class Read:
    """What is known of the rows of one side in a block.

    Parameters
    ----------
    left_out : dict of str to int
        Rows that take no part, by rule.
    named : list of str
        Classes, if they were asked for.
    off : int
        Rows at stamps that are no steps.
    sums : tuple of int
        `row_sums` of what takes part; the first is their number.
    warnings : list of dict
        What was repaired, as `Notice` records it.
    """

    left_out: dict[str, int]
    named: list[str]
    off: int
    sums: tuple[int, ...]
    warnings: list[dict[str, str]]

    @classmethod
    def of(cls, reading: Reading, off: int, kinds: tuple[str, ...]) -> "Read":
        """Of what was read, as states of these kinds."""
        return cls(
            left_out=reading.left_out,
            named=list(reading.named),
            off=off,
            sums=row_sums(reading.trajectories.seen_as(kinds)),
            warnings=[vars(notice) for notice in reading.warnings],
        )


NOT_TOLD = Read(left_out={}, named=[], off=0, sums=NO_SUMS, warnings=[])
"""Of what another block tells."""


def scan(
    output: str, piece: BlockPiece, times: Times, request: EvaluationRequest, names: tuple[str, str]
) -> None:
    """Read a block and write what it has.

    Parameters
    ----------
    output : str
        The folder that is written.
    piece : BlockPiece
        Which steps, and what is read of truth and estimate.
    times : (L,) array
        The steps.
    request : EvaluationRequest
        What is asked.
    names : pair of str
        The sides, for messages.

    Raises
    ------
    TgospaError
        Something is wrong with the data.
    """
    readings = [stretch.read() for stretch in piece.stretches]
    truth, estimate = (reading.trajectories for reading in readings)
    sides = fit(truth, estimate, request, names, partial(placed, piece, times))
    problem, blur = _problem(sides, request)
    aligned, kinds = (sides.alignment.truth, sides.alignment.estimate), sides.distance.kinds
    entry = np.empty(len(problem.cost), ENTRY)
    entry["step"] = problem.entry_step
    entry["step"] += np.int32(piece.low)
    entry["truth"] = problem.truth_track[problem.truth_row]
    entry["estimate"] = problem.estimate_track[problem.estimate_row]
    entry["cost"] = problem.cost
    pairs = _pairs(entry, len(aligned[1].ids))
    found: dict[str, object] = {
        "first": piece.low,
        "near": len(pairs),
        "pairs": pairs,
        "slack": problem.cost_slack,
        "blur": blur,
        "read": json.dumps(
            [
                vars(Read.of(reading, len(reading.trajectories.step) - len(side.step), kinds))
                if piece.told
                else vars(NOT_TOLD)
                for reading, side in zip(readings, aligned, strict=True)
            ]
        ),
        "judged": json.dumps(row_sums(aligned[0].seen_as(kinds))),
    }
    for role, side in zip(("truth", "estimate"), aligned, strict=True):
        found[f"{role}_objects"] = np.bincount(side.step, minlength=len(times))
        found[f"{role}_ids"] = side.ids.astype(np.str_)
        found[f"{role}_rows"] = np.bincount(side.track, minlength=len(side.ids))
    with writing(output) as folder:
        folder.mkdir()
        np.save(folder / "entries.npy", entry)
        np.savez(folder / "block.npz", **found)  # type: ignore[arg-type]


def _problem(sides: Fitted, request: EvaluationRequest) -> tuple[Problem, float]:
    """The near pairs of a block as a problem, and what last places change of a distance."""
    aligned, distance = (sides.alignment.truth, sides.alignment.estimate), sides.distance
    seen = tuple(side.seen_as(distance.kinds) for side in aligned)
    effort = Effort(jobs=1)
    (truth, estimate), prepared = distance.prepared((seen[0], seen[1]), effort)
    pairs = prepared_pairs((truth, estimate), request.parameters.cutoff, prepared, effort)
    problem = tgospa_problem(
        parameters=request.parameters,
        steps=len(truth.times),
        truths=len(truth.ids),
        estimates=len(estimate.ids),
        truth_step=truth.step,
        truth_track=truth.track,
        estimate_step=estimate.step,
        estimate_track=estimate.track,
        truth_row=pairs.truth_row,
        estimate_row=pairs.estimate_row,
        distance=pairs.distance,
        distance_error=prepared.error(truth.state.shape[1]),
    )
    blur = (
        prepared.last_place((truth, estimate)) if len(truth.step) + len(estimate.step) else np.inf
    )
    return problem, blur


def _pairs(entry: NDArray[np.void], width: int) -> NDArray[np.void]:
    key, entries = np.unique(
        entry["truth"].astype(np.int64) * max(width, 1) + entry["estimate"], return_counts=True
    )
    found = np.empty(len(key), PAIR)
    found["truth"], found["estimate"] = np.divmod(key, max(width, 1))
    found["entries"] = entries
    return found


def constants(request: EvaluationRequest, dimension: int, blocks: "list[Scanned]") -> Problem:
    """A problem without entries that has the constants of the whole: errors, rounding.

    `dimension` is the number of components of a state.
    """
    parameters, none = request.parameters, np.zeros(0, np.int32)
    problem = tgospa_problem(
        parameters=parameters,
        steps=0,
        truths=0,
        estimates=0,
        truth_step=none,
        truth_track=none,
        estimate_step=none,
        estimate_track=none,
        truth_row=none,
        estimate_row=none,
        distance=np.zeros(0),
        distance_error=request.distance.error(dimension),
    )
    objects = sum(int(found.sum()) for block in blocks for found in block.objects)
    blur = min((block.blur for block in blocks), default=np.inf) / parameters.cutoff
    return replace(
        problem,
        cost_slack=math.fsum(block.slack for block in blocks),
        rounding=objects * blur**parameters.order if blur < 1 else 0.0,
    )
