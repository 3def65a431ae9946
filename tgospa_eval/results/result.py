"""The result that a user holds. Knows no solver and no file."""

from collections.abc import Mapping
from dataclasses import field
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import spoken_in_python
from tgospa_eval.problem.problem import sum_by
from tgospa_eval.problem.readout import read_assigned, read_switches, read_tracks
from tgospa_eval.problem.solution import Reduced
from tgospa_eval.problem.states import States
from tgospa_eval.results.consistency import NEES, mean_nees, or_none
from tgospa_eval.results.records import Columns, Costs, Labels, as_lists, track_columns
from tgospa_eval.results.slices import Slicing
from tgospa_eval.results.summary import Summary

if TYPE_CHECKING:
    import os

    from tgospa_eval.results.explanation import Explanation
    from tgospa_eval.results.gradient import Gradient
    from tgospa_eval.tracks.clouds import Clouds


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedSides:
    """The two sides as they were compared, after filters, grid and joined stamps.

    Parameters
    ----------
    moments : (T,) int or float array
        The steps, as numbers.
    labels : Labels
        Ids.
    settings : mapping of str to object
        Every option that changes the number.
    columns : tuple of str
        Names of the d state columns.
    truth, estimate : (R, d) float arrays
        States as they were read, before the distance prepared them, in the order of the rows of the
        problem, by step and track.
    truth_covariance, estimate_covariance : (R, d (d + 1) / 2) float arrays, optional
        Lower triangles of the covariances of these states, of clouds the second moments: for NEES
        and pictures.
    truth_clouds, estimate_clouds : Clouds, optional
        The particles.
    """

    moments: NDArray[Any]
    labels: Labels
    settings: Mapping[str, object]
    columns: tuple[str, ...]
    truth: Floats
    estimate: Floats
    truth_covariance: Floats | None = None
    estimate_covariance: Floats | None = None
    truth_clouds: "Clouds | None" = None
    estimate_clouds: "Clouds | None" = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Proof(Costs):
    """What `certify` returned, with what it was proven for.

    Parameters
    ----------
    states : States
        The reduced problem.
    weights : (S,) int array
        The feasible assignment.
    prices : (K,) float array
        The prices of the lower bound.
    reduced : tuple of Reduced
        Blocks whose lower bound is of a smaller cutoff.
    compared : ComparedSides
        What the numbers of steps and tracks stand for.
    """

    states: States
    weights: Ints
    prices: Floats
    reduced: tuple[Reduced, ...]
    compared: ComparedSides

    def save(self, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
        """Write the proof folder: what a third party needs to check the bounds again.

        Parameters
        ----------
        folder : str or path
            Where; a folder that an earlier proof was saved to is written anew.
        force : bool
            Whether it may hold files of others.

        Raises
        ------
        ConfigError
            The folder cannot be written, or holds files of others.
        SolverError
            A checker finds that it does not prove what it claims.
        """
        import_module("tgospa_eval.reports.proofs").save(self, folder, force=force)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Result(Summary):
    """One evaluation. Attributes bear the names of the JSON; tables are built when read.

    Parameters
    ----------
    proof : Proof
        Bounds and assignment.
    labels, gap, settings, solver, timings, input, version
        Times and ids, the gap that counts as exact, options, and how it was made.
    source : tuple, optional
        What was evaluated and how, as of `evaluation.prepare.source_of`.
    assigned : mapping of str to (N,) float array
        What is known of each assigned pair beside its cost, in the order of the table of
        assignments: parts of the cost by name, and ``nees``.
    """

    proof: Proof
    assigned: Mapping[str, Floats] = field(default_factory=dict)
    source: tuple[Any, Any] | None = None

    def explain(self, top: int = 10) -> "Explanation":
        """Which single repairs of the estimate would save most, each with proven bounds.

        Tracks are merged, exchanged, split, dropped, cut, filled and extended, and the whole
        estimate is moved in time and space, one change at a time. What each saves is proven from
        bounds before and after it. Savings do not add up.

        Parameters
        ----------
        top : int
            How many repairs to list at most; up to twice as many are tried.

        Returns
        -------
        Explanation
            Repairs, the best first; `Explanation.repaired` makes the repaired estimate.

        Raises
        ------
        ConfigError
            `top` is less than 1, or the result was not made by `evaluate`.
        """
        explained: Explanation = import_module("tgospa_eval.explain.explain").explain(self, top)
        return explained

    def gradient(self) -> "Gradient":
        """How the cost changes with every state of the estimate, with cutoff and switch penalty.

        By the envelope theorem: the derivative of the cost at the reported assignment, which is
        held. Where the best assignment is unique it is that of the metric, else one of those in
        some direction; `Gradient.unique` says what is known.

        Returns
        -------
        Gradient
            Of ``total`` and of ``tgospa``.

        Raises
        ------
        ConfigError
            No derivative is known of the base distance.
        """
        found: Gradient = import_module("tgospa_eval.evaluation.gradient").gradient(self)
        return found

    def slices(self, *by: str) -> tuple[Slicing, ...]:  # noqa: D102  (as of Summary)
        if not by:
            return self.sliced
        with spoken_in_python(reads=False):
            split = import_module("tgospa_eval.evaluation.slices.split")
            found: tuple[Slicing, ...] = split.slices_of(self, by)
        return found

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
        return table | self._of_assigned(("truth", "estimate")[k], len(ids))

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
