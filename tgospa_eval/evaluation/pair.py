"""The evaluation of one pair of sides. Knows no solver and no file."""

from collections.abc import Mapping
from dataclasses import field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.summary import Tracked, summarise
from tgospa_eval.evaluation.uniqueness import is_unique
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.readout import read_assigned, read_switches, read_tracks
from tgospa_eval.results.consistency import NEES, mean_nees, or_none
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.explanation import Explanation
from tgospa_eval.results.records import Columns, Json, PairProof, as_lists, track_columns
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    from tgospa_eval.evaluation.prepare import AlignedPair
    from tgospa_eval.evaluation.request import EvaluationRequest


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PairEvaluation(Evaluation):
    """One evaluation. Attributes bear the names of the JSON; tables are built when read.

    Parameters
    ----------
    proof : PairProof
        Bounds and assignment.
    labels, gap, settings, solver, timings, input, version
        Times and ids, the gap that counts as exact, options, and how it was made.
    source : pair of AlignedPair and EvaluationRequest, optional
        What was evaluated, and how.
    assigned : mapping of str to (N,) float array
        What is known of each assigned pair beside its cost, in the order of the table of
        assignments: parts of the cost by name, and ``nees``.
    explained : Explanation, optional
        Single repairs that would save most, if they were asked for.
    """

    proof: PairProof
    assigned: Mapping[str, Floats] = field(default_factory=dict)
    source: "tuple[AlignedPair, EvaluationRequest] | None" = None
    explained: Explanation | None = None

    def to_dict(self) -> Json:
        """The JSON document as plain Python values."""
        found = {} if self.explained is None else {"explanation": self.explained.record()}
        return super().to_dict() | found

    @cached_property
    def tracked(self) -> Tracked:
        """States and pairs of the assignment, as the summary reads them."""
        return Tracked.of(self.proof)

    @cached_property
    def summarised(self) -> Summary:
        """Numbers of tracking, with columns of each track."""
        return summarise(self, self.tracked)

    @cached_property
    def is_unique(self) -> bool:
        """Whether the assignment is proven to be the only best one."""
        return is_unique(self.proof, self.gap)

    def _of_tracks(self, name: str) -> Columns:
        if name == "assignments":
            return self._assignments()
        if name == "switches":
            return self._switches()
        k = ("per_truth", "per_estimate").index(name)
        return self._per_track(k, (self.labels.truths, self.labels.estimates)[k])

    def _assignments(self) -> Columns:
        """Pairs that both exist, are nearer than the cutoff, and are assigned."""
        problem = self.proof.states.problem
        found = read_assigned(self.proof.states, self.proof.weights)
        cutoff, p = self.proof.parameters.cutoff, self.proof.parameters.order
        return {
            "t": [self.labels.times[k] for k in found.step],
            "truth": [self.labels.truths[i] for i in found.truth],
            "estimate": [self.labels.estimates[j] for j in found.estimate],
            "weight": found.weight.tolist(),
            "distance": (cutoff * problem.powers(found.entry) ** (1 / p)).tolist(),
            "cost": (self.scale * problem.cost[found.entry] * found.weight).tolist(),
            **self._marks(found.entry),
            **{name: or_none(values) for name, values in self.assigned.items()},
        }

    def _marks(self, entry: Ints) -> Columns:
        """Whether the truth of each pair is ignored, where any is."""
        problem = self.proof.states.problem
        if problem.unjudged is None:
            return {}
        return {"ignored": problem.unjudged[0][problem.truth_row[entry]].astype(int).tolist()}

    def _switches(self) -> Columns:
        """Changes of each truth's assignment, from its largest loss to its largest gain."""
        found = read_switches(self.proof.states, self.proof.weights)
        named = [*self.labels.estimates, None]  # the last is that of -1
        price = self.proof.states.problem.switch_price_at[found.step]
        return {
            "t": [self.labels.times[k] for k in found.step.tolist()],
            "truth": [self.labels.truths[i] for i in found.truth.tolist()],
            "from": [named[j] for j in found.before.tolist()],
            "to": [named[j] for j in found.after.tolist()],
            "mass": (0.5 * found.variation).tolist(),
            "cost": (self.scale * price * found.variation).tolist(),
        }

    def _per_track(self, k: int, ids: list[str]) -> Columns:
        costs = read_tracks(self.proof.states, self.proof.weights, k)
        steps = np.bincount(self.proof.states.problem.sides[k].track, minlength=len(ids))
        table = {"id": list(ids)} | as_lists(track_columns(k, steps, costs, self.scale))
        side = ("truth", "estimate")[k]
        return table | self._of_assigned(side, len(ids)) | self.summarised.columns(f"per_{side}")

    def _per_step(self) -> Columns:
        return super()._per_step() | self._of_assigned("step", len(self.labels.times))

    def _of_assigned(self, by: str, size: int) -> Columns:
        """Parts of the cost of localisation, and mean NEES, by step, truth or estimate."""
        if not self.assigned:
            return {}
        found = read_assigned(self.proof.states, self.proof.weights)
        index = getattr(found, by)
        table: Columns = {
            name: sum_by(index, values, size).tolist()
            for name, values in self.assigned.items()
            if name != NEES
        }
        if NEES in self.assigned:
            components = len(self.proof.compared.columns)
            table |= mean_nees(index, found.weight, self.assigned[NEES], components, size)
        return table


def explanation_of(evaluation: Evaluation) -> Explanation | None:
    """The repairs that were asked for, if there are any."""
    return evaluation.explained if isinstance(evaluation, PairEvaluation) else None


def source_of(result: PairEvaluation) -> "tuple[AlignedPair, EvaluationRequest]":
    """What was evaluated, and how: enough to evaluate something like it.

    Raises
    ------
    ConfigError
        The result was not made by `evaluate`.
    """
    if result.source is None:
        raise ConfigError("this result was not made by evaluate: evaluate again")
    return result.source
