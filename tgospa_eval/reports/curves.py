"""Curves over the steps of many runs, as records, and as CSV and JSON."""

from collections.abc import Mapping, Sequence
from typing import Literal

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.reports.files import csv_text
from tgospa_eval.results.records import Columns, Json, records

CurveKind = Literal["step", "growing"]

CURVE_KINDS: Mapping[CurveKind, str] = {
    "step": "RMS of single steps",
    "growing": "RMS per step of the steps so far",
}
"""(mean of the costs of step k)^(1/p); (mean of total(k) / n(k))^(1/p), evaluated up to k."""

POINT_COLUMNS = ("step", "t", "runs", "rms", "lower_bound", "upper_bound", "band_low", "band_high")
"""Of a table with a row for each step."""

KIND_COLUMN = "curve"
"""What comes before them where several curves are in one table."""


@dataclass(frozen=True, kw_only=True)
class RmsCurve:
    """One curve: of K steps of the runs of a group.

    Parameters
    ----------
    group : mapping of str to str
        Labels of the group, and parameters where those differ; none is called like a column.
    kind : str
        One of `CURVE_KINDS`.
    times : list of str or None
        Each step as it was read; None where runs differ.
    runs : list of int
        How many runs have the step.
    rms : list of float
        Value, in state units.
    bounds : pair of lists of float, optional
        Proven bounds of the value; None for single steps, whose costs are of one assignment.
    band : pair of lists of float or None
        95 % interval over the runs; None where there are too few.
    """

    group: Mapping[str, str]
    kind: CurveKind
    times: Sequence[str | None]
    runs: Sequence[int]
    rms: Sequence[float]
    bounds: tuple[Sequence[float], Sequence[float]] | None
    band: tuple[Sequence[float | None], Sequence[float | None]]

    @property
    def name(self) -> str:
        """The group in a line."""
        return "/".join(self.group.values())

    def table(self) -> Columns:
        """A row for each step."""
        lower, upper = self.bounds or ([None] * len(self.rms),) * 2
        steps = range(1, len(self.rms) + 1)
        columns = (steps, self.times, self.runs, self.rms, lower, upper, *self.band)
        return {name: list(values) for name, values in zip(POINT_COLUMNS, columns, strict=True)}


def curves_csv(curves: Sequence[RmsCurve]) -> str:
    """All curves in one table."""
    table: Columns = {}
    for curve in curves:
        own = curve.table()
        size = len(curve.rms)
        labels = {name: [value] * size for name, value in curve.group.items()}
        for name, column in (labels | {KIND_COLUMN: [curve.kind] * size} | own).items():
            table.setdefault(name, []).extend(column)
    return csv_text(table)


def curves_json(curves: Sequence[RmsCurve]) -> list[Json]:
    """All curves, each with its points."""
    return [
        {"by": dict(curve.group), KIND_COLUMN: curve.kind, "points": records(curve.table())}
        for curve in curves
    ]
