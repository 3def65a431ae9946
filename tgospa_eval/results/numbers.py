"""The numbers of an evaluation, or of a sum of several, and their tables. Knows no output."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import field
from functools import cached_property
from typing import TypeVar

import numpy as np

from tgospa_eval.common.config import SettingsFile
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, told
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.problem.solution import Brackets, Curve, Windows
from tgospa_eval.problem.tgospa import POWER, Parameters
from tgospa_eval.results.records import (
    PARTS,
    Columns,
    Costs,
    FileRecord,
    Labels,
    MetricSums,
    OtherMetrics,
    SolverRecord,
    Timings,
)
from tgospa_eval.results.slices import Slicing
from tgospa_eval.tracks.judged import Judged

USUAL_SCORE = 0.1
"""What the false targets of the calibration score, as in the authors' scripts."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """What false targets alone score.

    Parameters
    ----------
    false_targets : float
        n > 0: how many at each step.
    score : float
        0 < s < 1: what that scores.

    Raises
    ------
    ConfigError
        A number is out of its range.
    """

    false_targets: float
    score: float = USUAL_SCORE

    def __post_init__(self) -> None:
        for name, most in (("false_targets", math.inf), ("score", 1.0)):
            value = real_number(name.replace("_", " "), getattr(self, name))
            if not 0 < value < most:
                limit = "finite" if math.isinf(most) else f"< {most:g}"
                raise ConfigError(f"{name.replace('_', ' ')} is {value:g}: must be > 0 and {limit}")
            object.__setattr__(self, name, value)

    def beta(self, parameters: Parameters) -> float:
        """The scale on which the metric counts, in its unit."""
        false = parameters.root(parameters.rho * self.false_targets)
        return false / math.log((2 - self.score) / self.score)

    def of(self, value: float, parameters: Parameters) -> float:
        """The score of a value per step."""
        small = math.exp(-value / self.beta(parameters))
        return 2 * small / (1 + small)

    def similarity(
        self, value: float, bounds: tuple[float, float], parameters: Parameters
    ) -> "Similarity":
        """The score of a value per step, and what its bounds prove of it."""
        beta = self.beta(parameters)
        ends = []
        for bound, sign in zip(bounds, (1, -1), strict=True):  # the score falls
            error = POWER * (2 + bound / beta)
            ends.append(self.of(bound, parameters) * (1 + sign * error))
        return Similarity(
            score=self.of(value, parameters),
            lower_bound=max(ends[1], 0.0),
            upper_bound=min(ends[0], 1.0),
            beta=beta,
            calibration=self,
        )


@dataclass(frozen=True, kw_only=True)
class Similarity:
    """The score of an evaluation.

    Parameters
    ----------
    score : float
        Of the value per step, from 0 to 1.
    lower_bound, upper_bound : float
        Proven bounds of it.
    beta : float
        Its scale, in the unit of the metric.
    calibration : Calibration
        What that comes from.
    """

    score: float
    lower_bound: float
    upper_bound: float
    beta: float
    calibration: Calibration

    def record(self) -> dict[str, float]:
        """Its part of the JSON document."""
        return {
            "score": self.score,
            "lower_bound": self.lower_bound,
            "upper_bound": self.upper_bound,
            "beta": self.beta,
            "false_targets": self.calibration.false_targets,
            "score_of_false_targets": self.calibration.score,
        }


T = TypeVar("T")

SPLIT_PARTS = (
    *("localisation_mean", "localisation_spread"),
    *("expected_localisation", "existence_mismatch"),
)
"""Parts of the cost of localisation, those of which the distance, or the metric, knows."""

PROBABILITIES = "probabilities of existence (experimental)"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Numbers(ABC):
    """What is known: one evaluation, or the sum of several over the same steps.

    Parameters
    ----------
    proof : Costs
        Bounds and breakdown.
    labels : Labels
        Times and ids.
    gap : float
        Relative gap of the total that counts as exact.
    settings : dict
        Every option that changes the number.
    solver : dict
        Name, status, iterations, kernel, convergence history.
    timings : dict
        Seconds by stage.
    input : dict
        Rows and digest of either side.
    judged_on : Judged
        What it was judged on: the horizon, and the truth that counts.
    version : str
        Version of the package that made it.
    split : mapping of str to float, optional
        Parts of the cost of localisation by name, of `SPLIT_PARTS`, if it has any; they sum to it.
    traced : Curve, optional
        Costs of the steps up to each step, if they were asked for.
    slid : Windows, optional
        Costs of sliding windows, if they were asked for.
    warnings : tuple of Notice
        What looks wrong, with `code`, `text` and `remedy`.
    files : dict
        Paths of truth and estimate as they were given; None of what was no file.
    with_ : dict
        Other metrics, those that were asked for: numbers by metric and name.
    sliced : tuple of Slicing
        Costs and counts split by attributes, those that were asked for.
    sums : dict
        Of these what those of several recordings are joined from, by metric and name with a dot
        between; lists over the thresholds of HOTA.
    calibration : Calibration, optional
        Of `similarity`, if every output is to show it.
    settings_file : SettingsFile, optional
        The configuration file that set options of it.
    """

    proof: Costs
    labels: Labels
    gap: float
    settings: Mapping[str, object]
    solver: SolverRecord
    timings: Timings
    input: Mapping[str, FileRecord]
    judged_on: Judged
    version: str
    split: Mapping[str, float] | None = None
    traced: Curve | None = None
    slid: Windows | None = None
    warnings: tuple[Notice, ...] = ()
    files: dict[str, str | None] = field(default_factory=lambda: {"truth": None, "estimate": None})
    with_: OtherMetrics = field(default_factory=dict)
    sliced: tuple[Slicing, ...] = ()
    sums: MetricSums = field(default_factory=dict)
    calibration: Calibration | None = None
    settings_file: SettingsFile | None = None

    @property
    def told(self) -> list[str]:
        """What is said beside the number: where settings come from, and what looks wrong."""
        return told(self.settings_file, self.warnings)

    @cached_property
    def scale(self) -> float:
        """c^p: costs of one unit of the dimensionless problem."""
        return float(self.proof.parameters.cutoff**self.proof.parameters.order)

    def _root(self, cost: float) -> float:
        return self.proof.parameters.root(cost)

    def _root_error(self, cost: Floats | float) -> Floats:
        """How wrong a root is because 1/p is no double, relative."""
        digits: Floats = np.abs(np.log(np.maximum(cost, 1e-300)))
        return 2.0**-52 * digits / self.proof.parameters.order

    def outward_root(self, cost: float, sign: int) -> float:
        """The metric of a cost in units of c^p, rounded down (-1) or up (1)."""
        return outward(self._root(cost), sign, float(self._root_error(cost)))

    @property
    def total_bounds(self) -> tuple[float, float]:
        """Proven bounds of the cost, rounded outward."""
        bounds = self.proof.bounds
        return outward(self.scale * bounds.lower, -1), outward(self.scale * bounds.upper, 1)

    @property
    def tgospa(self) -> float:
        """The metric, in state units: of a feasible assignment, `upper_bound` but for rounding."""
        return self._root(self.proof.breakdown.total)

    @property
    def total(self) -> float:
        """``tgospa ** order``, the cost of that assignment."""
        return self.scale * self.proof.breakdown.total

    @property
    def lower_bound(self) -> float:
        """Proven lower bound of the metric, rounded down."""
        return self.outward_root(self.proof.bounds.lower, -1)

    @property
    def upper_bound(self) -> float:
        """Proven upper bound of the metric, rounded up."""
        return self.outward_root(self.proof.bounds.upper, 1)

    @property
    def relative_gap(self) -> float:
        """(upper - lower) / upper of the totals."""
        return self.proof.bounds.relative_gap

    @property
    def certified(self) -> bool:
        """Whether the value is exact: the bracket is met."""
        return self.proof.bounds.met(self.gap)

    @property
    def within_rounding(self) -> bool:
        """Whether the bracket is wider, but the value itself is one of the last places."""
        return self.proof.bounds.within_rounding(self.gap)

    @property
    def finished(self) -> bool:
        """Whether what was asked for is reached, at each step of the curve and window as well."""
        if self.solver["name"] != "certified":
            return bool(self.solver["finished"])
        asked = (part for part in (self.traced, self.slid) if part is not None)
        return self.certified and all(bool(part.met(self.gap).all()) for part in asked)

    @property
    def localisation(self) -> float:
        """Cost of localisation errors."""
        return self.scale * float(self.proof.breakdown.localisation.sum())

    @property
    def localisation_mean(self) -> float | None:
        """Its part by errors of means; None if the distance has no such part, or p is not 2."""
        return (self.split or {}).get("localisation_mean")

    @property
    def localisation_spread(self) -> float | None:
        """Its part by differences of covariances; None as for means."""
        return (self.split or {}).get("localisation_spread")

    @property
    def existence_mismatch(self) -> float | None:
        """Its part by different probabilities of existence; None if these are not compared."""
        return (self.split or {}).get("existence_mismatch")

    @property
    def expected_localisation(self) -> float | None:
        """Its part by errors of states that are expected to exist; None as for the mismatch."""
        mismatch = self.existence_mismatch
        if mismatch is None:
            return None
        return (self.split or {}).get("expected_localisation", self.localisation - mismatch)

    @property
    def missed(self) -> float:
        """Cost of missed targets."""
        return self.scale * float(self.proof.breakdown.missed.sum())

    @property
    def false(self) -> float:
        """Cost of false targets."""
        return self.scale * float(self.proof.breakdown.false.sum())

    @property
    def switch(self) -> float:
        """Cost of track switches."""
        return self.scale * float(self.proof.breakdown.switch.sum())

    @property
    def counts(self) -> dict[str, float]:
        """Missed and false object-steps, and switches (halves and fractions are possible)."""
        split = self.proof.breakdown
        return {
            "missed": float(split.missed_count.sum()),
            "false": float(split.false_count.sum()),
            "switch": float(split.switch_count.sum()),
        }

    @property
    def normalised(self) -> dict[str, float]:
        """``(total / T) ** (1 / order)`` over the T steps of the horizon."""
        return {"tgospa": self._root(self.proof.breakdown.total / self.judged_on.each)}

    @property
    def parameters(self) -> Mapping[str, object]:
        """Every option that changes the number."""
        return self.settings

    @property
    def metric(self) -> str:
        """Which member of the metric family it is (docs/theory/family.md)."""
        quasi = "" if self.proof.parameters.rho == 0.5 else "quasi-"
        weighted = "time-weighted-" if "step_weights" in self.settings else ""
        return f"{weighted}{'probabilistic-' if self.probabilistic else ''}{quasi}tgospa"

    @property
    def probabilistic(self) -> bool:
        """Whether objects exist with probabilities."""
        return "existence" in self.settings

    def parameters_in_words(self, unit: str | None = None) -> str:
        """Cutoff, order, switch penalty, and what makes it another metric of the family."""
        weighted = ", weighted steps" if "step_weights" in self.settings else ""
        uncertain = f", {PROBABILITIES}" if self.probabilistic else ""
        return self.proof.parameters.in_words(unit) + weighted + uncertain

    @property
    def judged(self) -> dict[str, object]:
        """What the value was judged on: the horizon, and the truth that counts."""
        return self.judged_on.record()

    def per_step_table(self) -> Columns:
        """Cost of each step by kind."""
        split = self.proof.breakdown
        parts = {name: self.scale * getattr(split, name) for name in PARTS}
        table: Columns = {"t": list(self.labels.times)}
        table.update({name: part.tolist() for name, part in parts.items()})
        table["total"] = sum(parts.values(), np.zeros(len(self.labels.times))).tolist()
        return table

    def curve_table(self) -> Columns:
        """The normalised curve (docs/theory/solvers.md): no columns if it was not asked for.

        At each step the metric of the steps up to it with its bounds, and the parts of its cost:
        (cost / steps) ** (1 / order) and cost / steps, with the `steps` of the horizon up to it.
        """
        traced = self.traced
        if traced is None:
            return {}
        steps = self.judged_on.so_far
        each = np.maximum(steps, 1)
        table: Columns = {"t": list(self.labels.times), "steps": steps.tolist()}
        table |= self._rooted(traced, each)
        for name, cost in zip(PARTS, traced.parts, strict=True):
            table[name] = (self.scale * cost / each).tolist()
        return table

    def windows_table(self) -> Columns:
        """The sliding windows: no columns if they were not asked for.

        Of each window the metric by itself with its bounds and the parts of its cost, and
        ``normalised``, (cost / steps) ** (1 / order), over its `steps` of the horizon.
        """
        slid = self.slid
        if slid is None:
            return {}
        times = self.labels.times
        steps = self.judged_on.so_far[slid.last] - self.judged_on.before[slid.first]
        table: Columns = {
            "t_first": [times[k] for k in slid.first.tolist()],
            "t_last": [times[k] for k in slid.last.tolist()],
            "steps": steps.tolist(),
        }
        table |= self._rooted(slid, np.ones(len(steps)))
        table["normalised"] = self._rooted(slid, np.maximum(steps, 1))["tgospa"]
        for name, cost in zip(PARTS, slid.parts, strict=True):
            table[name] = (self.scale * cost).tolist()
        return table

    def _rooted(self, found: Brackets, each: Floats | Ints) -> Columns:
        """The metric of costs that are divided by `each`, and its bounds."""
        power = 1 / self.proof.parameters.order
        table: Columns = {}
        for name, cost, sign in (
            ("tgospa", found.parts.sum(axis=0), 0),
            ("lower_bound", found.lower, -1),
            ("upper_bound", found.upper, 1),
        ):
            value = self.proof.parameters.cutoff * (cost / each) ** power
            table[name] = (value * (1 + sign * (2 * POWER + self._root_error(cost)))).tolist()
        return table

    @property
    @abstractmethod
    def sizes(self) -> dict[str, int]:
        """Numbers of trajectories, steps, near pairs, their steps, and components."""

    @property
    @abstractmethod
    def objects(self) -> tuple[int, int]:
        """States of the truth and of the estimate."""

    @abstractmethod
    def assignments_table(self) -> Columns:
        """Pairs that both exist, are nearer than the cutoff, and are assigned."""

    @abstractmethod
    def switches_table(self) -> Columns:
        """Changes of each truth's assignment, from its largest loss to its largest gain."""

    @abstractmethod
    def per_truth_table(self) -> Columns:
        """Steps, costs and counts of each truth."""

    @abstractmethod
    def per_estimate_table(self) -> Columns:
        """Steps, costs and counts of each estimate."""

    def first_switches(self, most: int) -> tuple[Columns, int]:
        """The first rows of `switches_table`, so many at most, and how many it has."""
        table = self.switches_table()
        return {name: column[:most] for name, column in table.items()}, len(table["t"])

    def per_class_table(self) -> Columns:
        """Value and costs of each class, where they were evaluated apart; else no columns."""
        return {}

    def worst(self, count: int = 5) -> Columns:
        """The `count` costliest steps, truths and estimates, in order, free ones left out."""
        per_step = self.per_step_table()
        answer = {"steps": costliest(per_step["t"], np.array(per_step["total"]), count)}
        for name, kind in (("truth", "missed"), ("estimates", "false")):
            answer[name] = self._worst_tracks(kind, count)
        return answer

    def _worst_tracks(self, kind: str, count: int) -> list[str]:
        table = self.per_truth_table() if kind == "missed" else self.per_estimate_table()
        cost = sum(np.array(table[part]) for part in ("localisation", kind, "switch"))
        return costliest(table["id"], np.asarray(cost), count)


def outward(value: float, sign: int, error: float = 0.0) -> float:
    """The value moved down (-1) or up (1) by more than a power and products are off by.

    `error` is a relative one beside these.
    """
    if not value:
        return 0.0
    return math.nextafter(value * (1 + sign * (2 * POWER + error)), sign * math.inf)


def costliest(names: list[T], cost: Floats, count: int) -> list[T]:
    """The names of the highest of these costs, of equal ones the first; none that is 0."""
    order = np.argsort(-cost, kind="stable")[:count]
    return [names[k] for k in order if cost[k] > 0]
