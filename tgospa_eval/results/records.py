"""Plain records of a result: tables, labels, costs, scores, both sides and their proof.

Knows no solver and no file.
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
    from tgospa_eval.tracks.alignment import ClockReports
    from tgospa_eval.tracks.clouds import Clouds


Part: TypeAlias = Literal["localisation", "missed", "false", "switch"]
CountedPart: TypeAlias = Literal["missed", "false", "switch"]

COUNTED_PARTS: tuple[CountedPart, ...] = ("missed", "false", "switch")
PARTS: tuple[Part, ...] = ("localisation", *COUNTED_PARTS)
"""The parts of the cost, in the order of every output; those that also have a number."""

Json: TypeAlias = dict[str, Any]
"""A JSON object of plain Python values."""

Columns: TypeAlias = dict[str, list[Any]]
"""Columns by name, all of one length, of plain Python values."""

Time: TypeAlias = int | float | str
"""A step as it was read."""


@dataclass(frozen=True, kw_only=True)
class Labels:
    """Names of the numbered steps and tracks.

    Parameters
    ----------
    times : list of int, float or str
        Each step as it was read.
    truths, estimates : list of str
        Ids.
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
        The bracket.
    breakdown : Breakdown
        The cost of a feasible assignment by step.
    """

    parameters: Parameters
    bounds: Bounds
    breakdown: Breakdown

    def root_error(self, cost: Floats | float) -> Floats:
        """Return the relative error of a root because 1/p is no double."""
        digits: Floats = np.abs(np.log(np.maximum(cost, 1e-300)))
        return 2.0**-52 * digits / self.parameters.order

    def outward_root(self, cost: float, sign: int) -> float:
        """Return the metric of a cost in units of c^p, rounded down (-1) or up (1)."""
        return outward(self.parameters.root(cost), sign, float(self.root_error(cost)))

    @property
    def total_bounds(self) -> tuple[float, float]:
        """Proven bounds of the cost, rounded outward."""
        scale, bounds = self.parameters.scale, self.bounds
        return outward(scale * bounds.lower, -1), outward(scale * bounds.upper, 1)

    def numbers(self, gap: float, steps: int) -> dict[str, Any]:
        """Return the main numbers of a row: value, bounds, cost, parts and counts.

        It is exact with a relative gap up to `gap`; the value per step is of so many steps.
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
MetricSums = Mapping[str, float | list[float]]
"""Numbers of other metrics, by metric and name; with the similarity that they compare."""


def input_record(file: Json, sha256: str, off: Mapping[str, int]) -> Json:
    """Return the record of the file of a side.

    Parameters
    ----------
    file : dict
        Its ``rows`` and ``format``, and rows that do not take part, ``left_out``, by the rule or
        option that left them out.
    sha256 : str
        Digest of what takes part.
    off : mapping of str to int
        Rows at steps that do not count, by option.
    """
    left_out = file["left_out"] | {name: rows for name, rows in off.items() if rows}
    record = {"rows": file["rows"], "left_out": left_out, "sha256": sha256}
    return record | ({"format": file["format"]} if "format" in file else {})


Arrays: TypeAlias = dict[str, NDArray[Any]]
"""Columns by name, all of one length, as arrays."""


def step_columns(split: Breakdown, scale: float) -> Arrays:
    """Return the cost of each step by kind, and of all; `scale` is c^p."""
    columns = {name: scale * getattr(split, name) for name in PARTS}
    return columns | {"total": sum(columns.values(), np.zeros(len(split.switch)))}


def track_columns(side: int, steps: Ints, costs: PerTrack, scale: float) -> Arrays:
    """Return costs of each truth (side 0) or estimate (side 1); `steps` has their lengths."""
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
    """Return columns of plain Python values."""
    return {name: column.tolist() for name, column in columns.items()}


def json_text(document: Mapping[str, object]) -> str:
    """Return a document as JSON: sorted keys, no NaN, full doubles."""
    import json  # lazy: the table does without

    return json.dumps(document, sort_keys=True, allow_nan=False, indent=1) + "\n"


def records(table: Columns) -> list[Json]:
    """Return the rows of a table."""
    return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]


# -------------------------------------------------------------------------------------------------
# A score from 0 to 1 of an evaluation, and bounds that are rounded outward.

DEFAULT_SCORE = 0.1
"""Score of the false targets of the calibration, as in the authors' scripts."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Scale of a similarity score, set by the score of false targets alone.

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
    score: float = DEFAULT_SCORE

    def __post_init__(self) -> None:
        for name, maximum in (("false_targets", math.inf), ("score", 1.0)):
            value = real_number(name.replace("_", " "), getattr(self, name))
            if not 0 < value < maximum:
                limit = "finite" if math.isinf(maximum) else f"< {maximum:g}"
                raise ConfigError(f"{name.replace('_', ' ')} is {value:g}: must be > 0 and {limit}")
            object.__setattr__(self, name, value)

    def beta(self, parameters: Parameters) -> float:
        """Return the scale on which the metric counts, in its unit."""
        false = parameters.root(parameters.rho * self.false_targets)
        return false / math.log((2 - self.score) / self.score)

    def of(self, value: float, parameters: Parameters) -> float:
        """Return the score of a value per step."""
        small = math.exp(-value / self.beta(parameters))
        return 2 * small / (1 + small)

    def similarity(
        self, value: float, bounds: tuple[float, float], parameters: Parameters
    ) -> "Similarity":
        """Return the score of a value per step, and its bounds."""
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
            false_targets=self.false_targets,
            score_of_false_targets=self.score,
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
    false_targets, score_of_false_targets : float
        What that comes from: how many false targets at each step, and what they score.
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
"""Parts of the cost of localisation, those of which the distance, or the metric, knows."""


def members_in_words(settings: Mapping[str, Any]) -> str:
    """Return options beside c, p and gamma that choose the member of the family."""
    words = ["weighted steps"] * ("step_weights" in settings)
    words += ["probabilities of existence (experimental)"] * ("existence" in settings)
    words += [f"not judged: {text}" for text in settings.get("ignore", ())]
    return "".join(f", {text}" for text in words)


def outward(value: float, sign: int, error: float = 0.0) -> float:
    """Move a value down (-1) or up (1) by more than the error of a power and products.

    `error` is a relative one beside these.
    """
    if not value:
        return 0.0
    return math.nextafter(value * (1 + sign * (2 * POWER + error)), sign * math.inf)


def costliest(names: list[T], cost: Floats, count: int) -> list[T]:
    """Return the names of the highest of these costs, of equal ones the first; none that is 0."""
    order = np.argsort(-cost, kind="stable")[:count]
    return [names[k] for k in order if cost[k] > 0]


# -------------------------------------------------------------------------------------------------
# The two sides as they were compared, and their proof. Knows no solver and no file.


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedSides:
    """The two sides as they were compared, after filters, grid and joined stamps.

    Parameters
    ----------
    timestamps : (T,) int or float array
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
    reports : ClockReports, optional
        Reports of which the rows of the estimate are, on a common clock.
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
    """Costs that `certify` proved, and the problem that they are proven for.

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
