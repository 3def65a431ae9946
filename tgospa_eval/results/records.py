"""Plain records of a result: tables, labels, costs, scores, the compared data and their proof.

A side is the truth or the estimate. Symbols (c, p) are those of docs/theory/notation.md. This
module depends on neither solvers nor files.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.arrays import Floats, Ints
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem.metric_family import POWER, Parameters
from tgospa_eval.problem.solution import Bounds, Breakdown, PerTrack, Reduced
from tgospa_eval.problem.states import States

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.tracks.alignment import ClockReports
    from tgospa_eval.tracks.clouds import Clouds


Part: TypeAlias = Literal["localisation", "missed", "false", "switch"]
CountedPart: TypeAlias = Literal["missed", "false", "switch"]

COUNTED_PARTS: tuple[CountedPart, ...] = ("missed", "false", "switch")
PARTS: tuple[Part, ...] = ("localisation", *COUNTED_PARTS)
"""Parts of the cost, in the order of all outputs; all except the first have a count."""

Json: TypeAlias = dict[str, Any]
"""JSON object of plain Python values."""

Columns: TypeAlias = dict[str, list[Any]]
"""Columns by name: lists of plain Python values, all of one length."""

Time: TypeAlias = int | float | str
"""Time of a step as it was read."""


@dataclass(frozen=True, kw_only=True)
class Labels:
    """Times of the steps, and ids of true objects and estimates, in the order of their indices.

    Parameters
    ----------
    times : list of int, float or str
        Time of each step as it was read.
    truths, estimates : list of str
        Ids of the true objects and of the estimates.
    unit : str, optional
        Unit of states and distances.
    """

    times: list[Time]
    truths: list[str]
    estimates: list[str]
    unit: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Costs:
    """Proven costs.

    Parameters
    ----------
    parameters : Parameters
        Cutoff, order, switch penalty.
    bounds : Bounds
        Proven bounds of the cost, in units of c^p.
    breakdown : Breakdown
        Parts of the cost of a feasible assignment by step, in units of c^p.
    """

    parameters: Parameters
    bounds: Bounds
    breakdown: Breakdown

    def root_error(self, cost: Floats | float) -> Floats:
        """Return a bound of the relative error that rounding 1/p causes in the p-th root."""
        digits: Floats = np.abs(np.log(np.maximum(cost, 1e-300)))
        return 2.0**-52 * digits / self.parameters.order

    def outward_root(self, cost: float, sign: int) -> float:
        """Return the metric of a cost (in units of c^p), rounded down (`sign` -1) or up (1)."""
        return outward(self.parameters.root(cost), sign, float(self.root_error(cost)))

    @property
    def total_bounds(self) -> tuple[float, float]:
        """Proven bounds of the cost, rounded outward."""
        scale, bounds = self.parameters.scale, self.bounds
        return outward(scale * bounds.lower, -1), outward(scale * bounds.upper, 1)

    def numbers(self, gap: float, steps: int) -> dict[str, Any]:
        """Return the main numbers of a row of a table: value, bounds, cost, parts and counts.

        `gap` is the largest relative gap of an exact value. The normalised value is per step of
        `steps` steps.
        """
        root, scale, split = self.parameters.root, self.parameters.scale, self.breakdown
        lower, upper = self.total_bounds
        counts = {name: getattr(split, f"{name}_count") for name in COUNTED_PARTS}
        return {
            "tgospa": root(split.total),
            "lower_bound": self.outward_root(self.bounds.lower, -1),
            "upper_bound": self.outward_root(self.bounds.upper, 1),
            "normalised.tgospa": root(split.total / steps),
            "total": scale * split.total,
            "total_lower": lower,
            "total_upper": upper,
            "certified": self.bounds.met(gap),
            **{name: scale * float(getattr(split, name).sum()) for name in PARTS},
            **{f"counts.{name}": float(count.sum()) for name, count in counts.items()},
        }


OtherMetrics = Mapping[str, Mapping[str, float]]
"""Numbers of other metrics, by name of the metric and of the number."""

MetricSums = Mapping[str, float | list[float]]
"""Sums from which other metrics of several recordings are computed, see `Evaluation.sums`."""


def input_record(file: Json, sha256: str, off: Mapping[str, int]) -> Json:
    """Return the record of one input file in the JSON.

    Parameters
    ----------
    file : dict
        Record of the reader with ``rows``, ``left_out`` and perhaps ``format``. ``left_out`` has
        the numbers of rows that were left out, by rule or option.
    sha256 : str
        Digest of the rows that are evaluated.
    off : mapping of str to int
        For each option that chooses steps, the number of rows that are left out.
    """
    left_out = file["left_out"] | {name: rows for name, rows in off.items() if rows}
    record = {"rows": file["rows"], "left_out": left_out, "sha256": sha256}
    return record | ({"format": file["format"]} if "format" in file else {})


Arrays: TypeAlias = dict[str, NDArray[Any]]
"""Columns by name: arrays, all of one length."""


def step_columns(split: Breakdown, scale: float) -> Arrays:
    """Return the parts and the sum of the cost of each step; `scale` is c^p."""
    columns = {name: scale * getattr(split, name) for name in PARTS}
    return columns | {"total": sum(columns.values(), np.zeros(len(split.switch)))}


def track_columns(side: int, steps: Ints, costs: PerTrack, scale: float) -> Arrays:
    """Return the costs of each true object (`side` 0) or estimate (1).

    `steps` are their numbers of states, and `scale` is c^p.
    """
    kind = ("missed", "false")[side]
    return {
        "steps": steps,
        "localisation": scale * costs.localisation,
        kind: scale * costs.unassigned,
        "switch": scale * costs.switch,
        f"{kind}_count": costs.unassigned_count,
        "switch_count": costs.switch_count,
    }


def as_lists(columns: Arrays) -> Columns:
    """Return arrays as lists of plain Python values."""
    return {name: column.tolist() for name, column in columns.items()}


def json_text(document: Mapping[str, object]) -> str:
    """Return a document as JSON, with sorted keys, without NaN, with full doubles."""
    import json  # lazy: tables do not need it

    return json.dumps(document, sort_keys=True, allow_nan=False, indent=1) + "\n"


def records(table: Columns) -> list[Json]:
    """Return the rows of a table as dicts."""
    return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]


def frame_records(frame: "pd.DataFrame") -> list[dict[Any, Any]]:
    """Return the rows of a frame as dicts. `DataFrame.to_dict` is slow if columns are many."""
    return records({name: frame[name].tolist() for name in frame.columns} if len(frame) else {})


# -------------------------------------------------------------------------------------------------
# Similarity: a score from 0 to 1 of an evaluation, with bounds that are rounded outward. With the
# value v per step and a scale beta, it is 2 e^(-v / beta) / (1 + e^(-v / beta)).

DEFAULT_SCORE = 0.1
"""Default of `Calibration.score`, as in the scripts of the authors of the metric."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Choice of the scale of the similarity: n false targets at each step get a given score.

    Parameters
    ----------
    false_targets : float
        Number n > 0 of false targets at each step.
    score : float
        Score of n false targets at each step, between 0 and 1.

    Raises
    ------
    ConfigError
        A number is out of its range.
    """

    false_targets: float
    score: float = DEFAULT_SCORE

    def __post_init__(self) -> None:
        for name, maximum in (("false_targets", math.inf), ("score", 1.0)):
            value = real_number(name.replace("_", " "), getattr(self, name))
            if not 0 < value < maximum:
                limit = "finite" if math.isinf(maximum) else f"< {maximum:g}"
                raise ConfigError(f"{name.replace('_', ' ')} is {value:g}: must be > 0 and {limit}")
            object.__setattr__(self, name, value)

    def beta(self, parameters: Parameters) -> float:
        """Return the scale beta of the score, in the unit of the metric."""
        false = parameters.root(parameters.rho * self.false_targets)
        return false / math.log((2 - self.score) / self.score)

    def of(self, value: float, parameters: Parameters) -> float:
        """Return the score of a value of the metric per step."""
        small = math.exp(-value / self.beta(parameters))
        return 2 * small / (1 + small)

    def similarity(
        self, value: float, bounds: tuple[float, float], parameters: Parameters
    ) -> "Similarity":
        """Return the score of a value per step with its bounds, from the bounds of this value."""
        beta = self.beta(parameters)
        ends = []
        for bound, sign in zip(bounds, (1, -1), strict=True):  # a larger value has a smaller score
            error = POWER * (2 + bound / beta)
            ends.append(self.of(bound, parameters) * (1 + sign * error))
        return Similarity(
            score=self.of(value, parameters),
            lower_bound=max(ends[1], 0.0),
            upper_bound=min(ends[0], 1.0),
            beta=beta,
            false_targets=self.false_targets,
            score_of_false_targets=self.score,
        )


@dataclass(frozen=True, kw_only=True)
class Similarity:
    """Similarity score of an evaluation.

    Parameters
    ----------
    score : float
        Score of the value per step, from 0 to 1.
    lower_bound, upper_bound : float
        Proven bounds of the score.
    beta : float
        Scale of the score, in the unit of the metric.
    false_targets, score_of_false_targets : float
        Parameters of the scale, see `Calibration`.
    """

    score: float
    lower_bound: float
    upper_bound: float
    beta: float
    false_targets: float
    score_of_false_targets: float


T = TypeVar("T")

MEAN, SPREAD = "localisation_mean", "localisation_spread"
SPLIT_PARTS = (
    *(MEAN, SPREAD),
    *("expected_localisation", "existence_mismatch"),
)
"""Parts of the localisation cost; which of them exist depends on distance and metric."""


def members_in_words(settings: Mapping[str, Any]) -> str:
    """Return the options besides c, p and gamma that choose the variant of the metric, in words."""
    words = ["weighted steps"] * ("step_weights" in settings)
    words += ["probabilities of existence (experimental)"] * ("existence" in settings)
    words += [f"not judged: {text}" for text in settings.get("ignore", ())]
    return "".join(f", {text}" for text in words)


def outward(value: float, sign: int, error: float = 0.0) -> float:
    """Round a computed value down (`sign` -1) or up (1), to be surely a bound of the exact value.

    The computation is a power and some products. `error` is a further relative error.
    """
    if not value:
        return 0.0
    return math.nextafter(value * (1 + sign * (2 * POWER + error)), sign * math.inf)


def costliest(names: list[T], cost: Floats, count: int) -> list[T]:
    """Return up to `count` names with the largest positive costs; of equal costs, the first."""
    order = np.argsort(-cost, kind="stable")[:count]
    return [names[k] for k in order if cost[k] > 0]


# -------------------------------------------------------------------------------------------------
# Truth and estimate as they were compared, and the proof of their value.


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedSides:
    """Both sides as they were compared: on one grid, without the rows that were left out.

    Parameters
    ----------
    timestamps : (T,) int or float array
        Times of the T steps, as numbers.
    labels : Labels
        Times as they were read, and ids.
    settings : mapping of str to object
        Every option that changes the number.
    columns : tuple of str
        Names of the d state columns.
    truth, estimate : (R, d) float arrays
        States, without the preparation by the distance. They are sorted by step and track, like
        the rows of the problem.
    truth_covariance, estimate_covariance : (R, d (d + 1) / 2) float arrays, optional
        Lower triangles of the covariances of these states, or of clouds. They are used for NEES and
        pictures.
    truth_clouds, estimate_clouds : Clouds, optional
        Particles of the states.
    reports : ClockReports, optional
        The report from which each row of the estimate comes, if the estimate is on a common clock.
    """

    timestamps: NDArray[Any]
    labels: Labels
    settings: Mapping[str, object]
    columns: tuple[str, ...]
    truth: Floats
    estimate: Floats
    truth_covariance: Floats | None = None
    estimate_covariance: Floats | None = None
    truth_clouds: "Clouds | None" = None
    estimate_clouds: "Clouds | None" = None
    reports: "ClockReports | None" = None


@dataclass(frozen=True, kw_only=True, eq=False)
class PairProof(Costs):
    """Costs that `certify` proved, with all that the proof needs.

    Parameters
    ----------
    states : States
        The reduced problem, with S states and K slots.
    weights : (S,) int array
        Feasible assignment: the weight of each state.
    prices : (K,) float array
        Price of each slot, which proves the lower bound.
    reduced : tuple of Reduced
        Blocks of the problem whose lower bound is proven at a smaller cutoff.
    compared : ComparedSides
        Both sides as they were compared, with their times and ids.
    """

    states: States
    weights: Ints
    prices: Floats
    reduced: tuple[Reduced, ...]
    compared: ComparedSides
