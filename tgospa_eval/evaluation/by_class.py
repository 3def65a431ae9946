"""The sum of evaluations of classes that never meet, on the same steps. Knows no file."""

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.pair import PairEvaluation
from tgospa_eval.evaluation.summary import Tracked, summarise
from tgospa_eval.problem.readout import Unjudged
from tgospa_eval.problem.solution import Bounds, Brackets, Breakdown
from tgospa_eval.results.consistency import NeesSums
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import PARTS, Columns, Costs, Json, input_record
from tgospa_eval.results.slices import added_up
from tgospa_eval.results.summary import Summary
from tgospa_eval.text import option

B = TypeVar("B", bound=Brackets)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class EvaluationByClass(Evaluation):
    """One result for each class, and their sum: totals, bounds, counts and parts add up.

    Parameters
    ----------
    results : dict of str to Result
        By class, in order; at least one.
    """

    results: Mapping[str, PairEvaluation]

    @cached_property
    def summarised(self) -> Summary:
        """Numbers of tracking of all classes together."""
        return summarise(self, Tracked.joined([part.tracked for part in self.results.values()]))

    @property
    def is_unique(self) -> bool:
        """Whether the assignment of each class is proven to be the only best one."""
        return all(part.is_unique for part in self.results.values())

    def _of_tracks(self, name: str) -> Columns:
        """Class by class, with the class in front."""
        tables = {part: made.table(name) for part, made in self.results.items()}
        sizes = {part: len(next(iter(table.values()))) for part, table in tables.items()}
        joined: Columns = {"class": [part for part, size in sizes.items() for _ in range(size)]}
        for column in dict.fromkeys(name for table in tables.values() for name in table):
            joined[column] = [  # what is not judged, which some classes have none of
                value
                for part, table in tables.items()
                for value in table.get(column, [0] * sizes[part])
            ]
        return joined

    def _per_class(self) -> Columns:
        """Value and costs of each class; the costs add up, the values do not."""
        names = ("tgospa", "total", *PARTS)
        parts = self.results.values()
        return {"class": list(self.results)} | {
            name: [getattr(part, name) for part in parts] for name in names
        }

    def to_dict(self) -> Json:
        """The document of the sum, with those of the classes."""
        return super().to_dict() | {
            "by_class": {name: part.to_dict() for name, part in self.results.items()}
        }


def add_up(
    results: Mapping[str, PairEvaluation], files: Sequence[Json], read: float
) -> EvaluationByClass:
    """The sum of the results of all classes.

    Parameters
    ----------
    results : dict
        By class, at least one, all on the same steps and with the same settings.
    files : pair of dict
        The two files, as of `input_record`.
    read : float
        Seconds that reading took.

    Raises
    ------
    ConfigError
        The classes have different steps.
    """
    parts = list(results.values())
    first = parts[0]
    if any(part.labels.times != first.labels.times for part in parts):
        raise ConfigError(
            f"{option('by', 'class')}: {option('interpolate')} leaves each class steps of its "
            f"own, and their costs do not add up; {option('resample')} gives all the same, or "
            f"choose one class by {option('class_', metavar='NAME')}"
        )
    bounds = [part.proof.bounds for part in parts]
    splits = [part.proof.breakdown for part in parts]
    unfinished = [part.solver for part in parts if not part.solver["finished"]]
    return EvaluationByClass(
        results=results,
        proof=Costs(
            parameters=first.proof.parameters,
            bounds=Bounds(
                lower=math.fsum(part.lower for part in bounds) * (1 - 2.0**-52),
                upper=math.fsum(part.upper for part in bounds) * (1 + 2.0**-52),
                rounding=sum(part.rounding for part in bounds),
            ),
            breakdown=Breakdown(
                **{
                    field.name: np.sum([getattr(split, field.name) for split in splits], axis=0)
                    for field in fields(Breakdown)
                    if field.name != "total"
                },
                total=math.fsum(split.total for split in splits),
            ),
        ),
        traced=_sum_of_brackets([part.traced for part in parts]),
        slid=_sum_of_brackets([part.slid for part in parts]),
        labels=replace(
            first.labels,
            truths=[name for part in parts for name in part.labels.truths],
            estimates=[name for part in parts for name in part.labels.estimates],
        ),
        gap=first.gap,
        sizes={name: sum(part.sizes[name] for part in parts) for name in first.sizes}
        | {"steps": first.sizes["steps"]},
        objects=(sum(part.objects[0] for part in parts), sum(part.objects[1] for part in parts)),
        settings=first.settings,
        solver={
            **(unfinished or [first.solver])[0],
            "iterations": sum(part.solver["iterations"] for part in parts),
            "history": [],
        },
        timings=_sum_of_times([part.timings for part in parts], read),
        input={
            side: _joined_input(file, {name: part.input[side] for name, part in results.items()})
            for side, file in zip(("truth", "estimate"), files, strict=True)
        },
        evaluated_on=replace(
            first.evaluated_on,
            truth_states=sum(part.evaluated_on.truth_states for part in parts),
            truth_steps=len(
                np.unique(np.concatenate([part.proof.states.problem.truth_step for part in parts]))
            ),
            truth_sha256=_joined_digest(
                (name, part.evaluated_on.truth_sha256)
                for name, part in results.items()
                if part.evaluated_on.truth_states
            ),
        ),
        version=first.version,
        split=_sum_of_splits([part.split for part in parts]),
        unjudged=Unjudged.joined([part.unjudged for part in parts if part.unjudged is not None]),
        nees=NeesSums.joined([part.nees for part in parts if part.nees is not None]),
        sliced=tuple(added_up([part.sliced for part in parts])),
        warnings=tuple(dict.fromkeys(notice for part in parts for notice in part.warnings)),
    )


def _sum_of_brackets(found: list[B | None]) -> B | None:
    """Of all classes, on the same stretches of steps."""
    asked = [part for part in found if part is not None]
    if not asked:
        return None
    sums = {
        field.name: np.sum([getattr(part, field.name) for part in asked], axis=0)
        for field in fields(Brackets)
    }
    rounding = (len(asked) + 1) * 2.0**-53
    sums["lower"] *= 1 - rounding
    sums["upper"] *= 1 + rounding
    return replace(asked[0], **sums)


def _joined_input(file: Json, inputs: dict[str, Json]) -> Json:
    """The record of a file, with the rows that the grid left out and a digest of its classes."""
    # Those of the other file are left out: the truth has a digest of its own.
    sha256 = _joined_digest((name, one["sha256"]) for name, one in inputs.items() if one["rows"])
    off = {
        option: sum(one["left_out"].get(option, 0) for one in inputs.values())
        for option in ("grid", "steps")
    }
    return input_record(file, sha256, off)


def _joined_digest(digests: Iterable[tuple[str, str]]) -> str:
    return hashlib.sha256(repr(list(digests)).encode()).hexdigest()


def _sum_of_splits(splits: list[Mapping[str, float] | None]) -> dict[str, float] | None:
    found = [split for split in splits if split is not None]
    return _sums(found) if len(found) == len(splits) else None


def _sum_of_times(parts: list[Json], read: float) -> Json:
    """Sums of seconds by name; the time per state is no sum and left out."""
    no_sums = ("solve", "nanoseconds_per_state")
    flat = [{k: v for k, v in part.items() if k not in no_sums} for part in parts]
    total = _sums([*flat, {"read": read, "total": read}])
    return {**total, "solve": _sums([part["solve"] for part in parts])}


def _sums(parts: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Sums of numbers by name; what some do not have is 0 of these."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: math.fsum(part.get(name, 0.0) for part in parts) for name in names}
