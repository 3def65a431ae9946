"""Curves over the time of many runs, as records, and as CSV and JSON."""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.formats.times import TimeError, places
from tgospa_eval.results.records import PARTS, Columns, Json, Time, records
from tgospa_eval.show.rendering import csv_text
from tgospa_eval.show.time_axis import TimeAxis, moments

CurveKind = Literal["step", "cumulative", "growing"]

CURVE_KINDS: Mapping[CurveKind, str] = {
    "step": "per time step",
    "cumulative": "of the steps up to t",
    "growing": "evaluated up to t",
}
"""What the RMS is of: costs of the step at t; their sum up to t by the steps of the horizon up to
t; the same of an evaluation of these steps alone."""

LINE_NAMES = {
    "total": "RMS-TGOSPA",
    "localisation": "RMS localisation error",
    "missed": "RMS missed target error",
    "false": "RMS false target error",
    "switch": "RMS track switch error",
}
"""What is drawn of a curve, as papers call it."""

BandKind = Literal["interval", "bootstrap", "percentiles", "deviation"]

BANDS: Mapping[BandKind, str] = {
    "interval": "95 % intervals of the RMS over the runs, from 6 runs on",
    "bootstrap": "95 % bootstrap intervals of the RMS over the runs, from 6 runs on",
    "percentiles": "the 2.5th to the 97.5th percentile of the runs",
    "deviation": "one standard deviation of the runs to either side",
}
"""What bands around curves are; the first by default."""

POINT_COLUMNS = (
    *("step", "t", "runs", "rms", "lower_bound", "upper_bound", "band_low", "band_high"),
    *(f"{part}{end}" for part in PARTS for end in ("", "_low", "_high")),
)
"""Of a table with a row for each time."""

KIND_COLUMN = "curve"
"""What comes before them where several curves are in one table."""

Band = tuple[Sequence[float], Sequence[float]]
"""Lower and upper ends."""


@dataclass(frozen=True, kw_only=True)
class RmsCurve:
    """One curve: of the runs of a group, over the K times at which any of them has a step.

    Parameters
    ----------
    group : mapping of str to str
        Labels of the group, and parameters where those differ; none is called like a column.
    kind : str
        One of `CURVE_KINDS`.
    times : sequence of int, float or str
        As they were read, in order.
    runs : int
        How many there are; all count at each time.
    rms : mapping of str to sequence of float
        Root mean squares at the K times, in state units: of the whole cost, ``total``, and of its
        parts by name; the whole alone where each point is an evaluation of its own.
    bands : mapping of str to pair of sequence of float
        What is around each; empty where there are too few runs.
    bounds : pair of sequence of float, optional
        Proven bounds of the values; None where costs are of one assignment.
    band : str
        What the bands are, one of `BANDS`.
    """

    group: Mapping[str, str]
    kind: CurveKind
    times: Sequence[Time]
    runs: int
    rms: Mapping[str, Sequence[float]]
    bands: Mapping[str, Band]
    bounds: tuple[Sequence[float], Sequence[float]] | None
    band: BandKind

    @property
    def name(self) -> str:
        """The group in a line."""
        return "/".join(self.group.values())

    def top(self, name: str) -> float:
        """The largest value of the whole cost or a part, with its band."""
        return max((*self.rms[name], *(self.bands[name][1] if name in self.bands else ())))

    def table(self) -> Columns:
        """A row for each time."""
        size = len(self.times)
        none = [None] * size
        each = {
            name: (values, *self.bands.get(name, (none, none))) for name, values in self.rms.items()
        }
        rms, *band = each["total"]
        columns: list[Sequence[object]] = [range(1, size + 1), self.times, [self.runs] * size]
        columns += [rms, *(self.bounds or (none, none)), *band]
        columns += [column for part in PARTS for column in each.get(part, (none,) * 3)]
        return {name: list(values) for name, values in zip(POINT_COLUMNS, columns, strict=True)}


def on_one_axis(
    curves: Sequence[RmsCurve],
) -> tuple[TimeAxis, list[Floats], tuple[float, float]]:
    """The axis of the times of all these curves, where on it those of each are, and its ends.

    Times of several kinds have no order: then the axis is that of the numbers of the steps.
    """
    try:
        found = places([curve.times for curve in curves])
        times = [t for curve in curves for t in curve.times]
    except TimeError:
        found = [np.arange(len(curve.times)) for curve in curves]
        times = [k + 1 for own in found for k in own.tolist()]
    _, first = np.unique(np.concatenate(found), return_index=True)
    union = [times[k] for k in first.tolist()]
    axis = TimeAxis(times=union, axis=moments(union))
    at = axis.at
    room = 0.0 if len(at) > 1 else 0.5
    ends = float(at[0]) - room, float(at[-1]) + room
    return axis, [at[own] for own in found], ends


def curves_csv(curves: Sequence[RmsCurve]) -> str:
    """All curves in one table."""
    table: Columns = {}
    for curve in curves:
        own = curve.table()
        size = len(curve.times)
        labels = {name: [value] * size for name, value in curve.group.items()}
        for name, column in (labels | {KIND_COLUMN: [curve.kind] * size} | own).items():
            table.setdefault(name, []).extend(column)
    return csv_text(table)


def curves_json(curves: Sequence[RmsCurve]) -> list[Json]:
    """All curves, each with its points."""
    return [
        {
            "by": dict(curve.group),
            KIND_COLUMN: curve.kind,
            "band": curve.band,
            "points": records(curve.table()),
        }
        for curve in curves
    ]
