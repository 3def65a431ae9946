"""What shards contribute, and the objects without a near pair, added up to the whole."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.partitioned.components import Tracks
from tgospa_eval.partitioned.scan import Scanned
from tgospa_eval.partitioned.share import PARTS_OF_TRACKS, PartialSums
from tgospa_eval.problem.certificate import lower_cost, upper_cost
from tgospa_eval.problem.paths import down
from tgospa_eval.problem.problem import Floats, Ints, Problem
from tgospa_eval.problem.solution import Bounds, Breakdown
from tgospa_eval.problem.tgospa import Parameters


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluationSums:
    """The whole evaluation, in units of c^p.

    Parameters
    ----------
    bounds, breakdown : Bounds, Breakdown
        As `certify` gives them.
    objects : pair of (T,) int arrays
        Truths and estimates at each step.
    tracks : pair of dict of str to (k,) float array
        What each truth and estimate contributes, by the names of `problem.readout.PerTrack`.
    iterations, states : int
        Of all shards.
    unsolved : int
        Shards that the solver did not finish.
    """

    bounds: Bounds
    breakdown: Breakdown
    objects: tuple[Ints, Ints]
    tracks: tuple[dict[str, Floats], dict[str, Floats]]
    iterations: int
    states: int
    unsolved: int


def add_up(
    folders: Sequence[Path],
    blocks: Sequence[Scanned],
    steps: int,
    tracks: tuple[Tracks, Tracks],
    constants: Problem,
    parameters: Parameters,
) -> EvaluationSums:
    """Add up all shards, in order, and the objects that are in none.

    Parameters
    ----------
    folders : sequence of Path
        What `solve_shard` wrote.
    blocks : sequence of Scanned
        All blocks.
    steps : int
        T.
    tracks : pair of Tracks
        Those of truth and estimate.
    constants : Problem
        Has errors and rounding of the whole.
    parameters : Parameters
        Of the metric.
    """
    objects = np.zeros(steps, np.int64), np.zeros(steps, np.int64)
    for block in blocks:
        for counts, found in zip(objects, block.objects, strict=True):
            counts[block.first : block.first + len(found)] += found
    parts = {name: np.zeros(steps) for name in Breakdown.__annotations__ if name != "total"}
    left = [counts.copy() for counts in objects]
    lower: list[float] = []
    upper: list[float] = []
    iterations = states = unsolved = 0
    for folder in folders:
        share = PartialSums.load(folder / "share.npz")
        span = slice(share.first, share.first + len(share.truths))
        for name, part in parts.items():
            part[span] += getattr(share, name)
        for counts, found in zip(left, (share.truths, share.estimates), strict=True):
            counts[span] -= found
        lower += share.lower.tolist()
        upper.append(share.upper)
        iterations += share.iterations
        states += share.states
        unsolved += not share.solved
    for name, counts, price in zip(
        ("missed", "false"), left, parameters.unassigned_prices, strict=True
    ):
        parts[name] += price * counts
        parts[f"{name}_count"] += counts
        rest = float(price * counts.sum())
        upper.append(rest)
        lower.append(float(down(np.array([rest]))[0]) if rest else 0.0)
    breakdown = Breakdown(**parts, total=math.fsum(upper))
    bounds = Bounds(
        lower=lower_cost(constants, math.fsum(lower)),
        upper=upper_cost(constants, breakdown),
        rounding=constants.rounding,
    )
    names = ("truths", "estimates")
    both = [
        _tracks(folders, name, side, price)
        for name, side, price in zip(names, tracks, parameters.unassigned_prices, strict=True)
    ]
    return EvaluationSums(
        bounds=bounds,
        breakdown=breakdown,
        objects=objects,
        tracks=(both[0], both[1]),
        iterations=iterations,
        states=states,
        unsolved=unsolved,
    )


def _tracks(folders: Sequence[Path], name: str, tracks: Tracks, price: float) -> dict[str, Floats]:
    """What each track contributes; the rows of those in shards that have no near pair as well."""
    found = {part: np.zeros(len(tracks.ids)) for part in PARTS_OF_TRACKS}
    rest = tracks.rows.copy()
    for folder in folders:
        with np.load(folder / f"{name}.npz") as shard:
            track = shard["track"]
            for part, values in found.items():
                values[track] += shard[part]
            rest[track] -= shard["rows"]
    found["unassigned"] += price * rest
    found["unassigned_count"] += rest
    return found
