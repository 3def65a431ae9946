"""Result of one evaluation, and the sum of the results of separate classes.

This module depends on neither solvers nor files.
"""

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.summary import Tracked, summarise
from tgospa_eval.evaluation.uniqueness import is_unique
from tgospa_eval.problem.gospa import per_step_gospa
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.solution import (
    Bounds,
    Brackets,
    Breakdown,
    Unjudged,
    read_assigned,
    read_switches,
    read_tracks,
)
from tgospa_eval.quoting import option
from tgospa_eval.results.consistency import NEES, NeesSums, mean_nees, or_none
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.explanation import Explanation
from tgospa_eval.results.records import (
    PARTS,
    Arrays,
    Columns,
    Costs,
    Json,
    PairProof,
    as_lists,
    input_record,
    track_columns,
)
from tgospa_eval.results.slices import added_up
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    from tgospa_eval.evaluation.prepare import AlignedPair
    from tgospa_eval.evaluation.request import EvaluationRequest


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PairEvaluation(Evaluation):
    """Result of one evaluation, with attributes named as in the JSON, and tables built on access.

    Parameters
    ----------
    proof : PairProof
        Bounds and assignment.
    labels, gap, settings, solver, timings, input, version
        Fields of `Evaluation`.
    source : pair of AlignedPair and EvaluationRequest, optional
        Data and request of the evaluation.
    assigned : mapping of str to (N,) float array
        Further columns of the table of assignments: parts of the cost, and ``nees``. The table has
        N rows.
    explained : Explanation, optional
        Repairs that would save the most, if requested.
    """

    proof: PairProof
    assigned: Mapping[str, Floats] = field(default_factory=dict)
    source: "tuple[AlignedPair, EvaluationRequest] | None" = None
    explained: Explanation | None = None

    def to_dict(self) -> Json:
        """Return the JSON document as plain Python values."""
        explanation = {} if self.explained is None else {"explanation": self.explained.record()}
        return super().to_dict() | explanation

    @cached_property
    def tracked(self) -> Tracked:
        """States and pairs of the assignment, in the form that the summary reads."""
        return Tracked.of(self.proof)

    @cached_property
    def summarised(self) -> Summary:
        """Common tracking numbers, with columns for the tables of objects and tracks."""
        return summarise(self, self.tracked)

    @cached_property
    def is_unique(self) -> bool:
        """True if the assignment is proven to be the only best one."""
        return is_unique(self.proof, self.gap)

    def _of_tracks(self, name: str) -> Columns:
        if name == "assignments":
            return self._assignments()
        if name == "switches":
            return self._switches()
        k = ("per_truth", "per_estimate").index(name)
        return self._per_track(k, (self.labels.truths, self.labels.estimates)[k])

    def _assignments(self) -> Columns:
        """Return the assigned pairs in which both states exist and are nearer than the cutoff."""
        problem = self.proof.states.problem
        assigned = read_assigned(self.proof.states, self.proof.weights)
        cutoff, p = self.proof.parameters.cutoff, self.proof.parameters.order
        return {
            "t": [self.labels.times[k] for k in assigned.step],
            "truth": [self.labels.truths[i] for i in assigned.truth],
            "estimate": [self.labels.estimates[j] for j in assigned.estimate],
            "weight": assigned.weight.tolist(),
            "distance": (cutoff * problem.powers(assigned.entry) ** (1 / p)).tolist(),
            "cost": (self.scale * problem.cost[assigned.entry] * assigned.weight).tolist(),
            **self._marks(assigned.entry),
            **{name: or_none(values) for name, values in self.assigned.items()},
        }

    def _marks(self, entry: Ints) -> Columns:
        """Return the column ``ignored``: 1 if the true object of a pair is ignored, else 0.

        `entry` has the index of each pair in the problem. The result is empty if the problem has
        neither ignored nor excused states.
        """
        problem = self.proof.states.problem
        if problem.unjudged is None:
            return {}
        return {"ignored": problem.unjudged[0][problem.truth_row[entry]].astype(int).tolist()}

    def _switches(self) -> Columns:
        """Return the table of switches: changes of the assignment of true objects.

        ``from`` is the estimate whose weight falls most, and ``to`` is the one whose weight rises
        most.
        """
        switches = read_switches(self.proof.states, self.proof.weights)
        named = [*self.labels.estimates, None]  # the index -1 means no estimate
        price = self.proof.states.problem.switch_price_at[switches.step]
        return {
            "t": [self.labels.times[k] for k in switches.step.tolist()],
            "truth": [self.labels.truths[i] for i in switches.truth.tolist()],
            "from": [named[j] for j in switches.before.tolist()],
            "to": [named[j] for j in switches.after.tolist()],
            "mass": (0.5 * switches.variation).tolist(),
            "cost": (self.scale * price * switches.variation).tolist(),
        }

    def _per_track(self, k: int, ids: list[str]) -> Columns:
        costs = read_tracks(self.proof.states, self.proof.weights, k)
        steps = np.bincount(self.proof.states.problem.sides[k].track, minlength=len(ids))
        table = {"id": list(ids)} | as_lists(track_columns(k, steps, costs, self.scale))
        side = ("truth", "estimate")[k]
        return table | self._of_assigned(side, len(ids)) | self.summarised.columns(f"per_{side}")

    def step_numbers(self) -> Arrays:
        """Return counts and sums for each step, (T,); their sums over the steps are the totals.

        ``truth_states``, ``estimate_states`` and ``assigned_states`` are those of the summary. If
        there are covariances, ``nees.total`` is the sum of NEES, and ``nees.pairs`` is the number
        of pairs in it. If GOSPA is requested, there are ``gospa`` and its parts, in state units to
        the power p.
        """
        size, tracked = len(self.labels.times), Tracked.of(self.proof)
        step, weight = tracked.truth.step, tracked.weight
        numbers: dict[str, Floats] = {
            "truth_states": np.bincount(step, minlength=size).astype(float),
            "estimate_states": np.bincount(tracked.estimate.step, minlength=size).astype(float),
            "assigned_states": sum_by(step[tracked.at], weight, size),
        }
        if NEES in self.assigned:
            assigned, nees = (
                read_assigned(self.proof.states, self.proof.weights),
                self.assigned[NEES],
            )
            known = ~np.isnan(nees)
            of_step, mass = assigned.step[known], assigned.weight[known]
            numbers[f"{NEES}.total"] = sum_by(of_step, mass * nees[known], size)
            numbers[f"{NEES}.pairs"] = sum_by(of_step, mass, size)
        if "gospa" in self.with_:
            _, *parts = per_step_gospa(self.proof.states.problem)
            costs = self.scale * np.array(parts)
            numbers["gospa"] = costs.sum(axis=0)
            names = (f"gospa.{name}" for name in PARTS[:3])
            numbers |= dict(zip(names, costs, strict=True))
        return numbers

    def _per_step(self) -> Columns:
        return super()._per_step() | self._of_assigned("step", len(self.labels.times))

    def _of_assigned(self, by: str, size: int) -> Columns:
        """Return sums of the parts of the localisation cost, and the mean NEES, by group.

        `by` is "step", "truth" or "estimate": assigned pairs with the same value are one group.
        `size` is the number of groups.
        """
        if not self.assigned:
            return {}
        assigned = read_assigned(self.proof.states, self.proof.weights)
        index = getattr(assigned, by)
        table: Columns = {
            name: sum_by(index, values, size).tolist()
            for name, values in self.assigned.items()
            if name != NEES
        }
        if NEES in self.assigned:
            components = len(self.proof.compared.columns)
            table |= mean_nees(index, assigned.weight, self.assigned[NEES], components, size)
        return table


def explanation_of(evaluation: Evaluation) -> Explanation | None:
    """Return the repairs of a result, or None if they were not requested."""
    return evaluation.explained if isinstance(evaluation, PairEvaluation) else None


def source_of(result: PairEvaluation) -> "tuple[AlignedPair, EvaluationRequest]":
    """Return the data and the request of a result, for further evaluations of the same data.

    Raises
    ------
    ConfigError
        The result was not made by `evaluate`.
    """
    if result.source is None:
        raise ConfigError("this result was not made by evaluate: evaluate again")
    return result.source


B = TypeVar("B", bound=Brackets)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class EvaluationByClass(Evaluation):
    """Result of each class, and their sum: totals, bounds, counts and parts add up.

    Parameters
    ----------
    results : dict of str to Result
        Result of each class, at least one, in the order of the tables.
    """

    results: Mapping[str, PairEvaluation]

    @cached_property
    def summarised(self) -> Summary:
        """Common tracking numbers of all classes together."""
        return summarise(self, Tracked.joined([part.tracked for part in self.results.values()]))

    @property
    def is_unique(self) -> bool:
        """True if the assignment of each class is proven to be the only best one."""
        return all(part.is_unique for part in self.results.values())

    def _of_tracks(self, name: str) -> Columns:
        """Return the table `name` of all classes, with the class as first column."""
        tables = {part: made.table(name) for part, made in self.results.items()}
        sizes = {part: len(next(iter(table.values()))) for part, table in tables.items()}
        joined: Columns = {"class": [part for part, size in sizes.items() for _ in range(size)]}
        for column in dict.fromkeys(name for table in tables.values() for name in table):
            joined[column] = [  # a class without ignored states lacks the column ``ignored``
                value
                for part, table in tables.items()
                for value in table.get(column, [0] * sizes[part])
            ]
        return joined

    def _per_class(self) -> Columns:
        """Return TGOSPA and the costs of each class; costs add up over classes, TGOSPA does not."""
        names = ("tgospa", "total", *PARTS)
        parts = self.results.values()
        return {"class": list(self.results)} | {
            name: [getattr(part, name) for part in parts] for name in names
        }

    def to_dict(self) -> Json:
        """Return the JSON document of the sum, which includes the documents of the classes."""
        return super().to_dict() | {
            "by_class": {name: part.to_dict() for name, part in self.results.items()}
        }


def add_up(
    results: Mapping[str, PairEvaluation], files: Sequence[Json], read: float
) -> EvaluationByClass:
    """Return the sum of the results of all classes.

    Parameters
    ----------
    results : dict
        Result of each class, at least one; all have the same steps and settings.
    files : pair of dict
        Records of the two files (see `input_record`).
    read : float
        Reading time in seconds.

    Raises
    ------
    ConfigError
        The classes have different steps.
    """
    parts = list(results.values())
    first = parts[0]
    if any(part.labels.times != first.labels.times for part in parts):
        raise ConfigError(
            f"{option('by', 'class')}: {option('interpolate')} gives each class its own steps, so "
            f"costs do not add up; use {option('resample')}, or choose one class with "
            f"{option('class_', metavar='NAME')}"
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
        curve_bounds=_sum_of_brackets([part.curve_bounds for part in parts]),
        window_bounds=_sum_of_brackets([part.window_bounds for part in parts]),
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
        slicings=tuple(added_up([part.slicings for part in parts])),
        warnings=tuple(dict.fromkeys(notice for part in parts for notice in part.warnings)),
    )


def _sum_of_brackets(parts: list[B | None]) -> B | None:
    """Add up the brackets of all classes, which have the same steps or windows."""
    known = [part for part in parts if part is not None]
    if not known:
        return None
    sums = {
        field.name: np.sum([getattr(part, field.name) for part in known], axis=0)
        for field in fields(Brackets)
    }
    rounding = (len(known) + 1) * 2.0**-53
    sums["lower"] *= 1 - rounding
    sums["upper"] *= 1 + rounding
    return replace(known[0], **sums)


def _joined_input(file: Json, inputs: dict[str, Json]) -> Json:
    """Return the record of one file from the records of its classes, `inputs`."""
    # The digest leaves out classes without rows in this file. Otherwise, the digest of the truth
    # would depend on the classes of the estimate.
    sha256 = _joined_digest((name, one["sha256"]) for name, one in inputs.items() if one["rows"])
    off = {
        option: sum(one["left_out"].get(option, 0) for one in inputs.values())
        for option in ("grid", "steps")
    }
    return input_record(file, sha256, off)


def _joined_digest(digests: Iterable[tuple[str, str]]) -> str:
    return hashlib.sha256(repr(list(digests)).encode()).hexdigest()


def _sum_of_splits(splits: list[Mapping[str, float] | None]) -> dict[str, float] | None:
    known = [split for split in splits if split is not None]
    return _sums(known) if len(known) == len(splits) else None


def _sum_of_times(parts: list[Json], read: float) -> Json:
    """Sum the seconds of all classes by name; the time per state is left out."""
    no_sums = ("solve", "nanoseconds_per_state")
    flat = [{k: v for k, v in part.items() if k not in no_sums} for part in parts]
    total = _sums([*flat, {"read": read, "total": read}])
    return {**total, "solve": _sums([part["solve"] for part in parts])}


def _sums(parts: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Sum numbers by name; a missing one is 0."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: math.fsum(part.get(name, 0.0) for part in parts) for name in names}
