"""What a gate judges: numbers with their brackets, and what they were made with."""

import json
from collections.abc import Mapping
from typing import Any

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.regression.rules import SPLIT, Key, Value
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import Summary
from tgospa_eval.tracks.judged import JUDGED_FIELDS


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One evaluation, of this run or stored.

    Parameters
    ----------
    values : mapping of str, or of class and str, to Value
        Those that rules can name.
    bounds : pair of float
        Of the metric, in state units.
    parameters : mapping
        As in the JSON of a result.
    judged : mapping
        What it was judged on, as in the JSON of a result.
    version : str
        Of the program.
    status : str
        How the solver ended.
    certified : bool
        Whether the asked gap was met.
    """

    values: Mapping[Key, Value]
    bounds: tuple[float, float]
    parameters: Mapping[str, object]
    judged: Mapping[str, Any]
    version: str
    status: str
    certified: bool

    @property
    def order(self) -> float:
        """The order p."""
        return float(str(self.parameters["order"]))

    @property
    def relative_gap(self) -> float:
        """Of the total."""
        total = self.values["total"]
        return (total.upper - total.lower) / total.upper if total.upper > 0 else 0.0

    @property
    def remedy(self) -> str:
        """Which option makes the bracket narrower, by how the solver ended."""
        settings, name = self.parameters, self.parameters["solver"]
        if "time limit" in self.status and "time_limit" in settings:
            return f"a larger --time-limit than {settings['time_limit']:g}"
        if name == "sinkhorn":
            if "bracket is met" in self.status:
                return f"a smaller --gap than {settings['gap']:g}, or --solver certified"
            return f"a smaller --epsilon than {settings['epsilon']:g}, or --solver certified"
        if name == "exact":
            return "--solver certified narrows the bracket"
        if not self.certified:
            return (
                f'the solver ended with "{self.status}"; let the rule allow more, or try --solver '
                "exact"
            )
        if float(str(settings["gap"])) <= ROUNDING_GAP:
            return "the bracket is about as narrow as rounding; let the rule allow more"
        return f"a smaller --gap than {settings['gap']:g}"


ROUNDING_GAP = 1e-9
"""Relative gap of certified that is about as narrow as rounding."""


def measured(result: Summary) -> Measured:
    """What a gate judges of a result."""
    found = _measured_values(result)
    if result.per_class_table():
        from tgospa_eval.results.by_class import ByClass  # here: few evaluate classes apart

        assert isinstance(result, ByClass)
        for name, part in result.results.items():
            found |= {(name, str(path)): value for path, value in _measured_values(part).items()}
    settings = json.loads(json.dumps(result.parameters, allow_nan=False))  # as they come back
    return Measured(
        values=found,
        bounds=(result.lower_bound, result.upper_bound),
        parameters=settings,
        judged={name: result.judged[name] for name in JUDGED_FIELDS},
        version=result.version,
        status=str(result.solver["status"]),
        certified=result.certified,
    )


def values_of(numbers: Mapping[str, float], scale: float) -> dict[Key, Value]:
    """Values that rules can name, with their brackets.

    Parameters
    ----------
    numbers : mapping of str to float
        Each by its path, and the bounds `total_lower` and `lower_bound`.
    scale : float
        c^p.
    """
    normalised, tgospa = numbers["normalised.tgospa"], numbers["tgospa"]
    share = normalised / tgospa if tgospa > 0 else 0.0
    brackets = {
        "total": (numbers["total_lower"], numbers["total"], scale),
        "tgospa": (numbers["lower_bound"], tgospa, 1.0),
        "normalised.tgospa": (share * numbers["lower_bound"] * (1 - 2.0**-50), normalised, 1.0),
    }
    found: dict[Key, Value] = {
        path: Value(lower=low, upper=high, proven=True, unit=unit)
        for path, (low, high, unit) in brackets.items()
    }
    for path in SPLIT:
        unit = 1.0 if path.startswith("counts.") else scale
        found[path] = Value(lower=numbers[path], upper=numbers[path], proven=False, unit=unit)
    return found


def _measured_values(result: Summary) -> dict[Key, Value]:
    numbers = {
        "total": result.total,
        "total_lower": result.total_bounds[0],
        "tgospa": result.tgospa,
        "lower_bound": result.lower_bound,
        "normalised.tgospa": result.normalised["tgospa"],
        **{path: getattr(result, path) for path in PARTS},
        **{f"counts.{name}": count for name, count in result.counts.items()},
    }
    return values_of(numbers, result.scale)
