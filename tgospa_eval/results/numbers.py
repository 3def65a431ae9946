"""A score from 0 to 1 of an evaluation, and bounds that are rounded outward."""

import math
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, real_number
from tgospa_eval.problem.metric_family import POWER, Parameters

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
    """What makes it another member of the family than c, p and gamma do, after a comma each."""
    found = ["weighted steps"] * ("step_weights" in settings)
    found += ["probabilities of existence (experimental)"] * ("existence" in settings)
    found += [f"not judged: {text}" for text in settings.get("ignore", ())]
    return "".join(f", {text}" for text in found)


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
