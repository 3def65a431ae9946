"""What passes between the stages: entries, assignments, and what a shard contributes."""

import math
from dataclasses import fields
from pathlib import Path

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.problem.solution import Breakdown

ENTRY = np.dtype([("step", "<i4"), ("truth", "<i4"), ("estimate", "<i4"), ("cost", "<f8")])
"""A near pair: global numbers of step and tracks, and (d / c)^p."""

HELD = np.dtype(
    [("truth", "<i4"), ("estimate", "<i4"), ("begin", "<i4"), ("end", "<i4"), ("weight", "<i8")]
)
"""An assignment from one step to another, both included; weights in units of `weights.ONE`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PartialSums:
    """What some components contribute, in units of c^p.

    Objects are the rows (track and step) that have a near pair in these components, no others.

    Parameters
    ----------
    first : int
        The first of the L steps.
    localisation, missed, false, switch : (L,) float arrays
        Cost by step.
    missed_count, false_count, switch_count : (L,) float arrays
        Numbers by step.
    truths, estimates : (L,) int arrays
        Objects by step.
    lower : (B,) float array
        Their sum is a proven lower bound of the cost, rounded outward.
    upper : float
        Cost of the assignment, rounded to the nearest.
    iterations : int
        Of the solver.
    states : int
        Of the reduced problem.
    solved : bool
        Whether the solver came to its end.
    """

    first: int
    localisation: Floats
    missed: Floats
    false: Floats
    switch: Floats
    missed_count: Floats
    false_count: Floats
    switch_count: Floats
    truths: Ints
    estimates: Ints
    lower: Floats
    upper: float
    iterations: int = 0
    states: int = 0
    solved: bool = True

    @classmethod
    def of(
        cls,
        breakdown: Breakdown,
        objects: tuple[Ints, Ints],
        lower: Floats,
        *,
        first: int = 0,
        iterations: int = 0,
        states: int = 0,
        solved: bool = True,
    ) -> "PartialSums":
        """Of a breakdown over L steps from `first` on, and the objects at each."""
        parts = {name: value for name, value in vars(breakdown).items() if name != "total"}
        return cls(
            **parts,
            first=first,
            truths=objects[0],
            estimates=objects[1],
            lower=lower,
            upper=breakdown.total,
            iterations=iterations,
            states=states,
            solved=solved,
        )

    def save(self, path: Path) -> None:
        """Write it."""
        with path.open("wb") as file:
            np.savez(file, **{field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: Path) -> "PartialSums":
        """Read what `save` wrote."""
        with np.load(path) as found:
            values = {name: found[name] for name in found.files}
        return cls(**{k: v.item() if v.ndim == 0 else v for k, v in values.items()})

    @property
    def bracket(self) -> tuple[float, float]:
        """Both bounds, rounded to the nearest, for those who watch."""
        return math.fsum(self.lower), self.upper


PARTS_OF_TRACKS = ("localisation", "unassigned", "switch", "unassigned_count", "switch_count")
"""What is known of each track, as `problem.readout.PerTrack` has it."""
