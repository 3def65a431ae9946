"""Result of a sweep: an evaluation for each of several values of one parameter."""

from collections.abc import Mapping
from dataclasses import asdict
from itertools import pairwise

from tgospa_eval.common.config import SettingsFile, settings_field
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice, messages_of
from tgospa_eval.results.records import Columns, Json, json_text

SWEEP_SCHEMA = "tgospa-eval/sweep/1"


@dataclass(frozen=True, kw_only=True)
class Point:
    """Numbers of one evaluation of a sweep.

    Parameters
    ----------
    value : float
        Value of the parameter.
    tgospa, lower_bound, total : float
        The metric (a proven upper bound), a proven lower bound, and the total ``tgospa ** order``.
    relative_gap : float
        Relative gap of the totals, (upper - lower) / upper.
    certified : bool
        Whether the value is exact.
    normalised : float
        ``(total / T) ** (1 / order)`` over the T steps of the horizon.
    localisation, missed, false, switch : float
        Costs, which sum to the total.
    missed_count, false_count, switch_count : float
        Numbers of missed targets, false targets and switches.
    status : str
        Reason for which the solver stopped.
    finished : bool
        Whether the solver reached its goal.
    """

    value: float
    tgospa: float
    lower_bound: float
    total: float
    relative_gap: float
    certified: bool
    normalised: float
    localisation: float
    missed: float
    false: float
    switch: float
    missed_count: float
    false_count: float
    switch_count: float
    status: str
    finished: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepEvaluation:
    """Evaluations that differ in one parameter.

    Parameters
    ----------
    parameter : str
        ``"cutoff"``, ``"order"``, ``"switch_penalty"`` or ``"rho"``.
    points : tuple of Point
        Points in the order of their values.
    settings, sizes, input, timings : dict
        Records as in a `Result`. `settings` has the options without the swept parameter. `sizes`
        has the numbers of trajectories and steps. `input` has rows and digests of both files.
        `timings` has the seconds of each stage.
    version : str
        Version of the package that computed the sweep.
    warnings : tuple of Notice
        Warnings about the data.
    settings_file : SettingsFile, optional
        Configuration file that set some options.
    """

    parameter: str
    points: tuple[Point, ...]
    settings: Mapping[str, object]
    sizes: dict[str, int]
    input: Mapping[str, Json]
    timings: dict[str, float]
    version: str
    warnings: tuple[Notice, ...] = ()
    settings_file: SettingsFile | None = None

    def __repr__(self) -> str:
        first, last = self.points[0].value, self.points[-1].value
        return (
            f"Sweep({self.parameter}={first:g}...{last:g}, points={len(self.points)}, "
            f"certified={self.certified})"
        )

    @property
    def messages(self) -> list[str]:
        """Messages to print with the numbers: settings file in use, and warnings."""
        return messages_of(self.settings_file, self.warnings)

    @property
    def certified(self) -> bool:
        """True if all values are exact."""
        return all(point.certified for point in self.points)

    @property
    def unit(self) -> str | None:
        """Unit of the swept parameter, or None if it has no unit or the unit is unknown."""
        unit = self.settings["unit"]
        return None if unit is None or self.parameter in ("order", "rho") else str(unit)

    def columns(self) -> Columns:
        """Return the points as columns, with the parameter first."""
        rows = [asdict(point) for point in self.points]
        table = {name: [row[name] for row in rows] for name in rows[0]}
        return {self.parameter: table.pop("value"), **table}

    def unchanged(self, *counts: str) -> tuple[int, int] | None:
        """Return the indices of the first and last point of the longest range with equal counts.

        `counts` are the names of the compared fields. None means that neighbouring points always
        differ. The counts at values between two points are not known.
        """
        same = [
            all(abs(getattr(a, name) - getattr(b, name)) < 1e-6 for name in counts)
            for a, b in pairwise(self.points)
        ]
        best, begin = (0, 0), 0
        for k, is_same in enumerate([*same, False]):
            if not is_same:
                best = max(best, (begin, k), key=lambda span: span[1] - span[0])
                begin = k + 1
        return best if best[1] > best[0] else None

    def to_dict(self) -> Json:
        """Return the JSON document as plain Python values."""
        return {
            "schema": SWEEP_SCHEMA,
            "version": self.version,
            "parameter": self.parameter,
            "parameters": self.settings,
            "certified": self.certified,
            "points": [_nested(point) for point in self.points],
            "unchanged": {
                "missed_false": self._range("missed_count", "false_count"),
                "switch": self._range("switch_count"),
            },
            "sizes": self.sizes,
            "input": self.input,
            "timings": self.timings,
            "warnings": [notice.record() for notice in self.warnings],
            **settings_field(self.settings_file),
        }

    def to_json(self) -> str:
        """Return the JSON document, with sorted keys, without NaN, with full doubles."""
        return json_text(self.to_dict())

    def _range(self, *counts: str) -> Json | None:
        span = self.unchanged(*counts)
        if span is None:
            return None
        first, last = span
        return {
            "from": self.points[first].value,
            "to": self.points[last].value,
            "points": last - first + 1,
        }


def _nested(point: Point) -> Json:
    """Return the numbers of a point in the form of the JSON of a result."""
    names = asdict(point)
    counts = {name: names.pop(f"{name}_count") for name in ("missed", "false", "switch")}
    solver = {name: names.pop(name) for name in ("status", "finished")}
    normalised = {"tgospa": names.pop("normalised")}
    return {**names, "counts": counts, "normalised": normalised, "solver": solver}
