"""Numbers and tables of an evaluation, or of several that were added up.

This module draws and saves nothing. A side is the truth or the estimate. Symbols (c, p) are those
of docs/theory/notation.md.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.config import SettingsFile, settings_field
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, messages_of
from tgospa_eval.common.words import counted, number
from tgospa_eval.errors import ConfigError
from tgospa_eval.problem.metric_family import POWER
from tgospa_eval.problem.solution import Brackets, Unjudged, Windows
from tgospa_eval.quoting import quoted
from tgospa_eval.results import records
from tgospa_eval.results.consistency import NEES, NeesSums
from tgospa_eval.results.slices import Slicing
from tgospa_eval.results.summary import Summary, TrackedShares, flat, headline
from tgospa_eval.tracks.coverage import Coverage

if TYPE_CHECKING:
    import pandas as pd

RESULT_SCHEMA = "tgospa-eval/result/1"

OPEN = 0.99
"""Relative gap above which the lower bound says hardly anything."""

BRACKET = ("tgospa", "total", "lower_bound", "upper_bound", "relative_gap", "certified")
LOGGED = (*BRACKET, *records.PARTS)
"""Names of the numbers that every result has."""

DOCUMENTED = (
    *(*LOGGED, "within_rounding", "metric", "counts", "normalised", "parameters", "sizes"),
    *("judged", "solver", "timings", "input", "version", "files", "summary", "headline"),
)
"""Attributes that are fields of the JSON document without a change."""


def frame_of(name: str, about: str) -> "cached_property[pd.DataFrame]":
    """Return a cached property: the table `name` as a DataFrame. `about` is its docstring."""

    def made(result: Any) -> "pd.DataFrame":
        frame: pd.DataFrame = result.frame(name)
        return frame

    made.__doc__ = about
    return cached_property(made)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Evaluation(ABC):
    """Numbers and tables of an evaluation; attributes have the names of the JSON document.

    Parameters
    ----------
    proof : Costs
        Proven bounds of the cost, and the cost by part and step.
    labels : Labels
        Times of the steps, and ids of objects and tracks.
    gap : float
        Largest relative gap of the total with which the value counts as exact.
    settings : dict
        Every option that changes the number.
    solver : dict
        Name, status, iterations, kernel, convergence history.
    timings : dict
        Seconds by stage.
    input : dict
        Number of rows and digest of each side.
    evaluated_on : Coverage
        Steps and true objects that were evaluated.
    sizes : dict of str to int
        Numbers of trajectories, steps, near pairs of trajectories (near at any step), near pairs
        of states, and components.
    objects : pair of int
        Number of object-steps of the truth, and number of estimate-steps.
    version : str
        Version of the package.
    split : mapping of str to float, optional
        Parts of the localisation cost by name, from `SPLIT_PARTS`; they sum to the cost.
    curve_bounds : Brackets, optional
        Brackets of the cost of the steps 1 to k, for each step k, if requested.
    window_bounds : Windows, optional
        Brackets of the cost of each sliding window, if requested.
    warnings : tuple of Notice
        Warnings, with `code`, `text` and `remedy`.
    notices : tuple of str
        Sentences about how the sides were read, and about defaults in use.
    files : dict
        Paths of truth and estimate as they were given; None for data in memory.
    with_ : dict
        Numbers of other metrics that were requested, by name of the metric and of the number.
    slicings : tuple of Slicing
        Costs and counts split by attributes, if requested.
    sums : dict
        Sums from which other metrics of several recordings together are computed. Keys are
        ``metric.name``; values of HOTA are lists with a number for each threshold.
    unjudged : Unjudged, optional
        States that were ignored, excused and absorbed, if there are any.
    nees : NeesSums, optional
        Consistency of the covariances with the errors, if the estimate has covariances.
    calibration : Calibration, optional
        Parameters of the score `similarity`, if ``--similarity`` was given. Outputs then show the
        score.
    settings_file : SettingsFile, optional
        Configuration file that set some options.
    tracked_shares : TrackedShares
        Shares of its steps at which the summary counts an object as "mostly tracked" or "mostly
        lost".
    """

    proof: records.Costs
    labels: records.Labels
    gap: float
    settings: Mapping[str, object]
    solver: records.Json
    timings: records.Json
    input: Mapping[str, records.Json]
    evaluated_on: Coverage
    sizes: dict[str, int]
    objects: tuple[int, int]
    version: str
    split: Mapping[str, float] | None = None
    curve_bounds: Brackets | None = None
    window_bounds: Windows | None = None
    warnings: tuple[Notice, ...] = ()
    notices: tuple[str, ...] = ()
    files: dict[str, str | None] = field(default_factory=lambda: {"truth": None, "estimate": None})
    with_: records.OtherMetrics = field(default_factory=dict)
    slicings: tuple[Slicing, ...] = ()
    sums: records.MetricSums = field(default_factory=dict)
    unjudged: Unjudged | None = None
    nees: NeesSums | None = None
    calibration: records.Calibration | None = None
    settings_file: SettingsFile | None = None
    tracked_shares: TrackedShares = TrackedShares()

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(tgospa={self.tgospa:.6g}, lower_bound={self.lower_bound:.6g}, "
            f"certified={self.certified})"
        )

    @property
    def messages(self) -> list[str]:
        """Messages to print with the number: settings file in use, warnings, notices."""
        return [*messages_of(self.settings_file, self.warnings), *self.notices]

    @cached_property
    def scale(self) -> float:
        """c^p, the unit of costs in the solvers."""
        return self.proof.parameters.scale

    def _root(self, cost: float) -> float:
        return self.proof.parameters.root(cost)

    @property
    def total_bounds(self) -> tuple[float, float]:
        """Proven bounds of the cost, rounded outward."""
        return self.proof.total_bounds

    @property
    def tgospa(self) -> float:
        """Metric of the reported assignment, in state units: `upper_bound` up to rounding."""
        return self._root(self.proof.breakdown.total)

    @property
    def total(self) -> float:
        """``tgospa ** order``, the cost of the reported assignment."""
        return self.scale * self.proof.breakdown.total

    @property
    def lower_bound(self) -> float:
        """Proven lower bound of the metric, rounded down."""
        return self.proof.outward_root(self.proof.bounds.lower, -1)

    @property
    def upper_bound(self) -> float:
        """Proven upper bound of the metric, rounded up."""
        return self.proof.outward_root(self.proof.bounds.upper, 1)

    @property
    def relative_gap(self) -> float:
        """Relative gap of the totals, (upper - lower) / upper."""
        return self.proof.bounds.relative_gap

    @property
    def certified(self) -> bool:
        """True if the value is exact: its bracket is as narrow as requested."""
        return self.proof.bounds.met(self.gap)

    @property
    def within_rounding(self) -> bool:
        """True if only rounding makes the bracket wider than requested."""
        return self.proof.bounds.within_rounding(self.gap)

    @property
    def finished(self) -> bool:
        """True if the solver reached its goal.

        The goal of ``"certified"`` is the requested gap, also for each step of the curve and each
        window.
        """
        if self.solver["name"] != "certified":
            return bool(self.solver["finished"])
        parts = (part for part in (self.curve_bounds, self.window_bounds) if part is not None)
        return self.certified and all(bool(part.met(self.gap).all()) for part in parts)

    @property
    def localisation(self) -> float:
        """Cost of localisation errors."""
        return self.scale * float(self.proof.breakdown.localisation.sum())

    @property
    def localisation_mean(self) -> float | None:
        """Part of localisation by errors of means; None without such a part, or if p is not 2."""
        return (self.split or {}).get("localisation_mean")

    @property
    def localisation_spread(self) -> float | None:
        """Part of localisation by differences of covariances; None like `localisation_mean`."""
        return (self.split or {}).get("localisation_spread")

    @property
    def existence_mismatch(self) -> float | None:
        """Part of localisation by different existence probabilities; None without probabilities."""
        return (self.split or {}).get("existence_mismatch")

    @property
    def expected_localisation(self) -> float | None:
        """Localisation cost without `existence_mismatch`; None without probabilities."""
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
        """Numbers of missed targets, false targets and switches; fractions are possible."""
        split = self.proof.breakdown
        return {
            "missed": float(split.missed_count.sum()),
            "false": float(split.false_count.sum()),
            "switch": float(split.switch_count.sum()),
        }

    @property
    def ignored(self) -> dict[str, float] | None:
        """Numbers of states that are not evaluated; None if all states are evaluated.

        ``truth_states`` counts ignored states of the truth. ``absorbed`` is the sum of the weights
        of the estimates assigned to ignored states. ``excused`` counts states of the estimate that
        cost nothing if they are false.
        """
        return None if self.unjudged is None else self.unjudged.totals

    @property
    def exclusions(self) -> str:
        """Parts of the data that are not evaluated, in words; blank if all are evaluated."""
        if self.ignored is None:
            return ""
        truths, absorbed, excused = self.ignored.values()
        return (
            f"not judged: {counted(int(truths), 'ground-truth state')} (followed by "
            f"{number(absorbed)} estimate states at no cost) and "
            f"{counted(int(excused), 'excused estimate state')}; so TGOSPA is not a metric here"
        )

    @property
    def normalised(self) -> dict[str, float]:
        """Values ``(total / n) ** (1 / order)`` and their bounds.

        For ``tgospa``, n is the number of steps of the horizon. For ``per_object``, n is the number
        of states of the truth that count.
        """
        total, bounds, root = self.proof.breakdown.total, self.proof.bounds, self.proof.outward_root
        each = {"tgospa": self.evaluated_on.each, "per_object": self.evaluated_on.truth_states}
        values: dict[str, float] = {}
        for (name, count), before in zip(each.items(), ("", "per_object_"), strict=True):
            if count:
                values |= {
                    name: self._root(total / count),
                    f"{before}lower_bound": root(bounds.lower / count, -1),
                    f"{before}upper_bound": root(bounds.upper / count, 1),
                }
        return values

    def each_in_words(self, name: str, digits: int = 6) -> str:
        """Format a value of `normalised`, with its lower bound if it is not exact."""
        before = "" if name == "tgospa" else f"{name}_"
        low = self.normalised[f"{before}lower_bound"]
        value = self.quantity(self.normalised[name], digits)
        return value if self.certified else f"{number(low, digits)} to {value}"

    @cached_property
    @abstractmethod
    def summarised(self) -> Summary:
        """Summary of tracking, with its columns for the tables of objects and tracks."""

    @property
    @abstractmethod
    def is_unique(self) -> bool | None:
        """True if the assignment is proven to be the only optimal one, None if this is unknown."""

    @property
    def summary(self) -> records.Json:
        """Numbers of tracking of the reported assignment (docs/reference/summary.md).

        ``unique`` is true if the assignment is proven to be the only optimal one. Otherwise another
        optimal assignment may have other numbers.
        """
        return {**self.summarised.numbers, "unique": self.is_unique}

    @property
    def headline(self) -> str:
        """Most important numbers of tracking, in one sentence."""
        quantity = partial(self.quantity, digits=3)
        numbers, counts = self.summarised.numbers, self.counts
        words = headline(numbers, counts["switch"], counts["false"], quantity)
        if "per_object" not in self.normalised:
            return words
        return f"{words}; TGOSPA per object and step {self.each_in_words('per_object', 3)}"

    @property
    def parameters(self) -> Mapping[str, object]:
        """All options that change the number."""
        return self.settings

    @property
    def metric(self) -> str:
        """Name of the metric in its family (docs/theory/family.md), such as ``"quasi-tgospa"``."""
        quasi = "" if self.proof.parameters.rho == 0.5 else "quasi-"
        weighted = "time-weighted-" if "step_weights" in self.settings else ""
        masked = "" if self.unjudged is None else "masked-"
        return f"{masked}{weighted}{'probabilistic-' if self.probabilistic else ''}{quasi}tgospa"

    @property
    def probabilistic(self) -> bool:
        """True if states have probabilities of existence."""
        return "existence" in self.settings

    def parameters_in_words(self, unit: str | None = None) -> str:
        """Return the cutoff, order, switch penalty and other options of the metric, in words."""
        return self.proof.parameters.in_words(unit) + records.members_in_words(self.settings)

    @property
    def judged(self) -> dict[str, object]:
        """Steps and true objects that were evaluated."""
        return self.evaluated_on.record()

    def table(self, name: str) -> records.Columns:
        """Return a table as plain columns; a table that was not requested has no columns.

        Names are ``"per_step"``, ``"per_truth"``, ``"per_estimate"``, ``"switches"``,
        ``"assignments"``, ``"curve"``, ``"windows"`` and ``"per_class"``.

        Raises
        ------
        ConfigError
            The table is unknown.
        """
        if name in ("per_step", "curve", "windows", "per_class"):
            made: records.Columns = getattr(self, f"_{name}")()
            return made
        if name in ("assignments", "switches", "per_truth", "per_estimate"):
            return self._of_tracks(name)
        raise ConfigError(f"no table {quoted(name)}; see Result.table")

    @abstractmethod
    def _of_tracks(self, name: str) -> records.Columns:
        """Return the table ``assignments``, ``switches``, ``per_truth`` or ``per_estimate``."""

    def _per_step(self) -> records.Columns:
        """Return the table ``per_step``: the parts of the cost of each step."""
        costs = records.step_columns(self.proof.breakdown, self.scale)
        ignored = {} if self.unjudged is None else vars(self.unjudged)
        return {"t": list(self.labels.times)} | records.as_lists(costs) | records.as_lists(ignored)

    def _curve(self) -> records.Columns:
        """Return the normalised curve (docs/theory/solvers.md): no columns if it was not requested.

        The row of step k is about the steps 1 to k. `steps` is the number of steps of the horizon
        up to k. The metric and its bounds are (cost / steps) ** (1 / order). The parts are divided
        by `steps`.
        """
        bounds = self.curve_bounds
        if bounds is None:
            return {}
        steps = self.evaluated_on.so_far
        each = np.maximum(steps, 1)
        table: records.Columns = {"t": list(self.labels.times), "steps": steps.tolist()}
        table |= self._rooted(bounds, each)
        for name, cost in zip(records.PARTS, bounds.parts, strict=True):
            table[name] = (self.scale * cost / each).tolist()
        return table

    def _windows(self) -> records.Columns:
        """Return the sliding windows: no columns if they were not requested.

        A row has the metric of one window, evaluated by itself, its bounds, and the parts of its
        cost. `steps` is the number of steps of the horizon in the window. `normalised` is
        (cost / steps) ** (1 / order).
        """
        windows = self.window_bounds
        if windows is None:
            return {}
        times = self.labels.times
        steps = self.evaluated_on.so_far[windows.last] - self.evaluated_on.before[windows.first]
        table: records.Columns = {
            "t_first": [times[k] for k in windows.first.tolist()],
            "t_last": [times[k] for k in windows.last.tolist()],
            "steps": steps.tolist(),
        }
        table |= self._rooted(windows, np.ones(len(steps)))
        table["normalised"] = self._rooted(windows, np.maximum(steps, 1))["tgospa"]
        for name, cost in zip(records.PARTS, windows.parts, strict=True):
            table[name] = (self.scale * cost).tolist()
        return table

    def _rooted(self, costs: Brackets, each: Floats | Ints) -> records.Columns:
        """Divide costs by `each`, and return their metric and its bounds."""
        power = 1 / self.proof.parameters.order
        table: records.Columns = {}
        for name, cost, sign in (
            ("tgospa", costs.parts.sum(axis=0), 0),
            ("lower_bound", costs.lower, -1),
            ("upper_bound", costs.upper, 1),
        ):
            value = self.proof.parameters.cutoff * (cost / each) ** power
            table[name] = (value * (1 + sign * (2 * POWER + self.proof.root_error(cost)))).tolist()
        return table

    def first_switches(self, count: int) -> tuple[records.Columns, int]:
        """Return the first `count` rows of the table of switches, and the number of all rows."""
        table = self.table("switches")
        return {name: column[:count] for name, column in table.items()}, len(table["t"])

    def _per_class(self) -> records.Columns:
        """Return value and costs of each class; no columns if classes are evaluated together."""
        return {}

    def worst(self, count: int = 5) -> records.Columns:
        """Return the `count` costliest steps, true objects and estimates, the costliest first.

        Steps, objects and estimates without cost are left out.
        """
        per_step = self.table("per_step")
        answer = {"steps": records.costliest(per_step["t"], np.array(per_step["total"]), count)}
        for name, kind in (("truth", "missed"), ("estimates", "false")):
            answer[name] = self._worst_tracks(kind, count)
        return answer

    def _worst_tracks(self, kind: str, count: int) -> list[str]:
        table = self.table("per_truth" if kind == "missed" else "per_estimate")
        cost = sum(np.array(table[part]) for part in ("localisation", kind, "switch"))
        return records.costliest(table["id"], np.asarray(cost), count)

    def to_dict(self) -> records.Json:
        """Return the JSON document as plain Python values."""
        curve = {} if self.curve_bounds is None else {"curve": records.records(self.table("curve"))}
        if self.window_bounds is not None:
            curve["windows"] = records.records(self.table("windows"))
        return {
            **self.split_parts,
            **curve,
            **({"with": self.with_} if self.with_ else {}),
            **({} if self.nees is None else {NEES: self.nees.record()}),
            **({} if self.ignored is None else {"ignored": self.ignored}),
            **({} if self.calibration is None else {"similarity": asdict(self.similarity())}),
            **({"slices": [one.record() for one in self.slicings]} if self.slicings else {}),
            "schema": RESULT_SCHEMA,
            **{name: getattr(self, name) for name in DOCUMENTED},
            **self._records(),
            "worst": self.worst(),
            "warnings": [notice.record() for notice in self.warnings],
            "notices": list(self.notices),
            **settings_field(self.settings_file),
        }

    def _records(self) -> records.Json:
        """Return the fields of the JSON with a record for each step, and for each switch."""
        return {
            "per_step": records.records(self.table("per_step")),
            "switches": records.records(self.table("switches")),
        }

    @property
    def split_parts(self) -> dict[str, float]:
        """Parts of localisation by name; empty if the distance and the metric have none."""
        parts = {name: getattr(self, name) for name in records.SPLIT_PARTS}
        return {name: part for name, part in parts.items() if part is not None}

    def metrics(self) -> dict[str, float]:
        """Return the numbers as a flat dict of floats, for loggers of experiments.

        Names are those of the JSON, with a dot between levels:

        - always: ``tgospa``, ``total``, ``lower_bound``, ``upper_bound``, ``relative_gap``,
          ``certified`` (1 or 0), ``localisation``, ``missed``, ``false``, ``switch``,
          ``counts.missed``, ``counts.false``, ``counts.switch``, ``normalised.tgospa``,
          ``normalised.lower_bound``, ``normalised.upper_bound``
        - if the distance compares covariances: ``localisation_mean``, ``localisation_spread``
        - with probabilities of existence: ``expected_localisation``, ``existence_mismatch``
        - if states are not evaluated: ``ignored.truth_states`` and other counts
        - for requested metrics: names such as ``with.hota.HOTA``, ``similarity``, ``nees``,
          ``nees.anees``, ``nees.inside``
        - for defined numbers of the summary: names such as ``summary.detection_rate``
        """
        scored = {} if self.calibration is None else {"similarity": self.similarity().score}
        names = [*LOGGED, *self.split_parts]
        groups = {"counts": self.counts, "normalised": self.normalised}
        if self.ignored is not None:
            groups["ignored"] = self.ignored
        return {
            **{name: float(getattr(self, name)) for name in names},
            **scored,
            **({} if self.nees is None else self.nees.numbers()),
            **dotted(groups),
            **self.other_numbers,
            **dict(flat(self.summarised.numbers)),
        }

    @property
    def other_numbers(self) -> dict[str, float]:
        """Numbers of other metrics, by names such as ``with.hota.HOTA``."""
        return dotted({f"with.{name}": numbers for name, numbers in self.with_.items()})

    def similarity(
        self, false_targets: float | None = None, score: float = records.DEFAULT_SCORE
    ) -> records.Similarity:
        """Return a score from 0 to 1 of the value per step: 1 is perfect.

        Parameters
        ----------
        false_targets : float
            Number n of false targets at each step. An estimate whose only errors are n false
            targets at each step gets `score`. By default, n and `score` are those of
            ``--similarity``.
        score : float
            Score for n false targets at each step; allowed only with `false_targets`.

        Returns
        -------
        Similarity
            Score with proven bounds.

        Raises
        ------
        ConfigError
            A number is out of its range; `score` is given without `false_targets`; or the steps are
            weighted, so that a value per step has no meaning.
        """
        calibration = self.calibration
        if false_targets is not None:
            calibration = records.Calibration(false_targets=false_targets, score=score)
        elif score != records.DEFAULT_SCORE:
            raise ConfigError("similarity: a score needs the number of false targets")
        if calibration is None:
            raise ConfigError(
                "similarity: give the number of false targets per step for which the score is 0.1"
            )
        if "step_weights" in self.settings:
            raise ConfigError(
                "similarity: the score needs steps that all count the same; leave the step "
                "weights out"
            )
        value, *ends = (self.normalised[k] for k in ("tgospa", "lower_bound", "upper_bound"))
        return calibration.similarity(value, (ends[0], ends[1]), self.proof.parameters)

    def to_json(self) -> str:
        """Return the JSON document, with sorted keys and full precision, without NaN."""
        return records.json_text(self.to_dict())

    def quantity(self, value: float, digits: int = 6) -> str:
        """Format a value with the unit of the states."""
        return number(value, digits) + (f" {self.labels.unit}" if self.labels.unit else "")

    def share(self, part: float) -> str:
        """Format a cost in percent of the total."""
        return f"{100 * part / self.total:.1f} %" if self.total > 0 else "-"

    @property
    def proven(self) -> str:
        """Precision of the value, in words: how near the proven bounds are."""
        if self.within_rounding:
            lower, upper = self.quantity(self.lower_bound), self.quantity(self.upper_bound)
            return f"within the rounding of the distances: proven to be between {lower} and {upper}"
        if self.certified:
            # At most 12 digits: further ones depend on the rounding of the machine.
            digits = math.floor(-math.log10(max(self.relative_gap, 1e-12)) + 1e-9)
            return f"exact: proven lower and upper bound agree to {digits} digits"
        if self.relative_gap > OPEN:
            return "proven; the total may be close to 0"
        return f"proven (the totals differ by {number(100 * self.relative_gap, 2)}%)"

    @property
    def claim(self) -> str:
        """The value if it is exact, otherwise the bracket, in words."""
        value = self.quantity(self.tgospa)
        if self.certified:
            return f"TGOSPA = {value}"
        return f"TGOSPA is between {self.quantity(self.lower_bound)} and {value}"

    per_step = frame_of("per_step", "Cost of each step by kind.")
    curve = frame_of("curve", "TGOSPA of the steps up to each step, and its parts, if requested.")
    windows = frame_of("windows", "Sliding windows, if requested.")
    switches = frame_of("switches", "Changes of each truth's assignment.")
    assignments = frame_of("assignments", "Assigned pairs of states nearer than the cutoff.")
    per_truth = frame_of("per_truth", "Steps, costs and counts of each truth.")
    per_estimate = frame_of("per_estimate", "Steps, costs and counts of each estimate.")

    def frame(self, name: str) -> "pd.DataFrame":
        """Return a table as a DataFrame."""
        import pandas as pd  # lazy: pandas is slow to import

        return pd.DataFrame(self.table(name))


def dotted(groups: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Return the numbers of all groups in one dict, with the names ``group.name``."""
    return {
        f"{group}.{name}": float(x) for group, each in groups.items() for name, x in each.items()
    }
