"""Presentation of a batch: sums of groups, proven and statistical order, curves over time.

A group has all jobs with the same value of some labels, such as all jobs of a tracker. The proven
order of groups is a fact about the evaluated files. The statistical order tells what to expect of
similar files. The page and the pictures are made from the tables in this module.
"""

import itertools
import json
import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.words import counted, natural, number
from tgospa_eval.formats.fields import TimeError, places
from tgospa_eval.quoting import listed, option
from tgospa_eval.results.consistency import NEES, STORED_NEES, NeesSums, or_none
from tgospa_eval.results.evaluation import dotted
from tgospa_eval.results.records import (
    PARTS,
    Columns,
    Json,
    Part,
    Time,
    frame_records,
    json_text,
    records,
)
from tgospa_eval.results.slices import Slicing, slices_columns
from tgospa_eval.results.summary import SUMMARY
from tgospa_eval.show import result_text, study_table, table_text
from tgospa_eval.show.style import HEAT_LEVELS
from tgospa_eval.show.time_axis import TimeAxis

if TYPE_CHECKING:
    import pandas as pd


CurveKind = Literal["step", "cumulative", "growing"]

CURVE_KINDS: Mapping[CurveKind, str] = {
    "step": "per time step",
    "cumulative": "of the steps up to t",
    "growing": "evaluated up to t",
}
"""Kinds of curves with their names. Each run has a cost at each time t.

The value of a curve at t is the p-th root of the mean of these costs. The cost of a run at t is:

- ``step``: the cost of the step at t
- ``cumulative``: the sum of the costs up to t, divided by the number of steps of the horizon up to
  t
- ``growing``: the same quotient from an evaluation of only the steps up to t
"""

LINE_NAMES = {
    "total": "RMS-TGOSPA",
    "localisation": "RMS localisation error",
    "missed": "RMS missed target error",
    "false": "RMS false target error",
    "switch": "RMS track switch error",
    "gospa": "RMS GOSPA",
    "gospa.localisation": "RMS GOSPA localisation",
    "gospa.missed": "RMS GOSPA missed target",
    "gospa.false": "RMS GOSPA false target",
    "estimate_states": "cardinality",
    "detection_rate": "detection rate",
    NEES: "NEES",
}
"""Displayed names of the lines of a curve, as papers use them."""

BandKind = Literal["interval", "bootstrap", "percentiles", "deviation"]

BANDS: Mapping[BandKind, str] = {
    "interval": "95 % intervals of the RMS over the runs (at least 6 runs)",
    "bootstrap": "95 % bootstrap intervals of the RMS over the runs (at least 6 runs)",
    "percentiles": "the 2.5th to the 97.5th percentile of the runs",
    "deviation": "plus and minus one standard deviation of the runs",
}
"""Kinds of bands around curves, with descriptions. The first kind is the default."""

POINT_COLUMNS = (
    *("step", "t", "runs", "rms", "lower_bound", "upper_bound", "band_low", "band_high"),
    *(f"{part}{end}" for part in PARTS for end in ("", "_low", "_high")),
)
"""Columns of the table of a curve. The table has a row for each time."""

KIND_COLUMN = "curve"
"""Name of the column with the kind of a curve, if a table has several curves."""

Band = tuple[Sequence[float | None], Sequence[float | None]]
"""Lower and upper ends of a band at each time; None if too few runs have a value at this time."""


@dataclass(frozen=True, kw_only=True)
class RmsCurve:
    """Root mean square of the costs of the runs of a group, over time.

    The curve has K times. At each of them, at least one run has a step.

    Parameters
    ----------
    group : mapping of str to str
        Labels of the group, and the parameters that differ in the batch. Their names are not
        names of columns of `table`.
    kind : str
        One of `CURVE_KINDS`.
    times : sequence of int, float or str
        Times as they were read, in order.
    runs : sequence of int
        Number of runs over which the mean is taken, at each time.
    rms : mapping of str to sequence of float
        Lines of the curve by name: K values each, in state units. The names are ``total`` and those
        of the parts. Curves of the kind ``step`` also have ``gospa`` and ``gospa.PART``.
    bands : mapping of str to pair of sequence of float
        Band around each line, by the same names; empty if there are too few runs.
    bounds : pair of sequence of float, optional
        Proven lower and upper bounds of the line ``total``. Only curves of the kind ``growing``
        have bounds. For other kinds, this is None.
    band : str
        Kind of the bands, one of `BANDS`.
    means : mapping of str to sequence of float
        Further lines of curves of the kind ``step``, with K means each. ``truth_states`` and
        ``estimate_states`` are means over the runs. ``detection_rate`` and ``nees`` are means over
        all states of all runs. A mean is NaN at times without a value.
    """

    group: Mapping[str, str]
    kind: CurveKind
    times: Sequence[Time]
    runs: Sequence[int]
    rms: Mapping[str, Sequence[float]]
    bands: Mapping[str, Band]
    bounds: tuple[Sequence[float], Sequence[float]] | None
    band: BandKind
    means: Mapping[str, Sequence[float]] = field(default_factory=dict)

    def values(self, name: str) -> Sequence[float]:
        """Return the K values of the line `name`, from `rms` or `means`."""
        return self.rms[name] if name in self.rms else self.means[name]

    @property
    def name(self) -> str:
        """Labels of the group in one line."""
        return "/".join(self.group.values())

    def top(self, name: str) -> float:
        """Return the largest value of a line and of its band."""
        ends = self.bands[name][1] if name in self.bands else ()
        known = [value for value in self.values(name) if value == value]
        return max((*known, *(end for end in ends if end is not None)), default=0.0)

    def table(self) -> Columns:
        """Return the curve as a table with a row for each time."""
        size = len(self.times)
        none = [None] * size
        each = {
            name: (values, *self.bands.get(name, (none, none))) for name, values in self.rms.items()
        }
        rms, *band = each["total"]
        columns: list[Sequence[object]] = [range(1, size + 1), self.times, self.runs]
        columns += [rms, *(self.bounds or (none, none)), *band]
        columns += [column for part in PARTS for column in each.get(part, (none,) * 3)]
        more = {name.replace(".", "_"): self.rms[name] for name in self.rms if name[:5] == "gospa"}
        return {
            **{name: list(values) for name, values in zip(POINT_COLUMNS, columns, strict=True)},
            **{name: or_none(np.array(values)) for name, values in (more | {**self.means}).items()},
        }


def on_one_axis(
    curves: Sequence[RmsCurve],
) -> tuple[TimeAxis, list[Floats], tuple[float, float]]:
    """Return one time axis for all curves, the positions of each curve on it, and the axis limits.

    Times of different kinds, such as dates and numbers, have no common order. If there are several
    kinds, the axis counts steps.
    """
    try:
        positions = places([curve.times for curve in curves])
        times = [t for curve in curves for t in curve.times]
    except TimeError:
        positions = [np.arange(len(curve.times)) for curve in curves]
        times = [k + 1 for own in positions for k in own.tolist()]
    _, first = np.unique(np.concatenate(positions), return_index=True)
    union = [times[k] for k in first.tolist()]
    axis = TimeAxis.of(union)
    at = axis.at
    room = 0.0 if len(at) > 1 else 0.5
    ends = float(at[0]) - room, float(at[-1]) + room
    return axis, [at[own] for own in positions], ends


def curves_columns(curves: Sequence[RmsCurve]) -> Columns:
    """Return all curves in one table."""
    table: Columns = {}
    rows = 0
    for curve in curves:
        own = curve.table()
        size = len(curve.times)
        labels = {name: [value] * size for name, value in curve.group.items()}
        for name, column in (labels | {KIND_COLUMN: [curve.kind] * size} | own).items():
            table.setdefault(name, [*itertools.repeat(None, rows)]).extend(column)
        rows += size
        for each in table.values():  # columns that this curve lacks
            each.extend(itertools.repeat(None, rows - len(each)))
    return table


def curves_json(curves: Sequence[RmsCurve]) -> list[Json]:
    """Return all curves as JSON objects, each with its points."""
    return [
        {
            "by": dict(curve.group),
            KIND_COLUMN: curve.kind,
            "band": curve.band,
            "points": records(curve.table()),
        }
        for curve in curves
    ]


Places = tuple[int, int]
"""Best and worst possible place, counted from 1."""

MAX_LINES = 6
"""Largest number of groups whose curves are drawn."""


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """Ranking of the values of a label, such as all trackers.

    The values are ordered by the number ``combined``. It is the p-th root of the sum of the totals
    of all jobs.

    Parameters
    ----------
    label : str
        Name of the label.
    entries : list of dict
        An entry for each ranked value of the label, best first. It has the value as ``name``, its
        proven ``place`` (best and worst possible), lower and upper bounds of ``combined`` and
        ``per_step``, and parts by name. It also has ``confidence`` (the 95 % interval of
        ``combined``) and ``statistical_place``; both are None if there are too few pairs.
    comparisons : list of dict
        A comparison for each pair of entries; the ``first`` has the smaller value. It has the
        proven ``verdict`` and the proven bounds of the ``difference`` of ``combined``. It also has
        statistics: the ends ``lower`` and ``upper`` of the 95 % interval of the difference,
        ``p_value``, ``p_holm`` and ``significant``. They are None if there are too few `pairs`.
    jobs : int
        Number of jobs for which all entries have a value; only these are compared.
    all_jobs : int
        Number of jobs for which at least one entry has a value.
    pairs : int
        Number of pairs in the statistics. A pair has the values of two entries for one truth, or
        for one job if there is only one truth.
    truths : int
        Number of truths.
    permutations : int
        Number of permutations in the test; 0 if there are too few pairs.
    seed : int
        Seed of the random permutations, which are used if there are too many to try all.
    order : float
        The order p.
    parameters : mapping of str to float or str
        Parameters of this ranking that differ in the batch.
    left_out : tuple of str
        Values of the label that are not ranked, because none of their jobs has a value.
    """

    label: str
    entries: list[Json]
    comparisons: list[Json]
    jobs: int
    all_jobs: int
    pairs: int
    truths: int
    permutations: int
    seed: int
    order: float = 2.0
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    @property
    def value(self) -> str:
        """Name of the ranked value."""
        return study_table.value_name(self.order, self.jobs)

    @property
    def p_values(self) -> list[float | None]:
        """P value of the difference to the first entry, for each entry.

        It is NaN for the first entry itself. All are None if there are too few pairs.
        """
        if not self.permutations:
            return [None] * len(self.entries)
        best = self.entries[0]["name"]
        each = {row["second"]: row["p_holm"] for row in self.comparisons if row["first"] == best}
        return [each.get(entry["name"], math.nan) for entry in self.entries]

    def place(self, entry: Json) -> str:
        """Return the proven place of an entry in words."""
        return table_text.place_in_words(
            *entry["place"], shared=entry["name"] in table_text.equal_names(self.comparisons)
        )

    def total(self, entry: Json) -> Interval:
        """Return both bounds of the cost per step of an entry."""
        value = bracket(entry, "per_step")
        return Interval(lower=value.lower**self.order, upper=value.upper**self.order)

    @property
    def population(self) -> str:
        """Name of the data to which statistics apply: other runs of this truth, or other truths."""
        return "other runs of this scene" if self.truths == 1 else "other scenes"


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchTables:
    """Content of all reports of a batch.

    Parameters
    ----------
    rows : DataFrame
        Jobs, one per row.
    groups : DataFrame
        Groups, one per row.
    by : tuple of str
        Labels that define a group; values of the first label are compared.
    parameters : tuple of str
        Parameters of the metric that differ in the batch. Jobs with different values of them are in
        different groups.
    rankings : tuple of Ranking
        A ranking for each set of values of the `parameters`.
    notes : tuple of str
        Sentences: warnings, reasons for missing rankings, and sources of settings.
    slices : mapping of int to list of Slicing
        For each group, by the index of its row in `groups`: the costs split by attributes, summed
        over the jobs of the group.
    curves : tuple of RmsCurve
        Curves over time; empty if the steps of the runs are not stored.
    settings : mapping of str to object
        Inputs and options of the evaluation, for the page and pictures.
    link : callable
        Function that receives the row of a job and returns the path of its report, or an empty
        text.
    columns : tuple of str
        Requested columns of the study table; empty for the default.
    """

    rows: "pd.DataFrame"
    groups: "pd.DataFrame"
    by: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    rankings: tuple[Ranking, ...] = ()
    notes: tuple[str, ...] = ()
    slices: Mapping[int, Sequence[Slicing]] = field(default_factory=dict)
    curves: tuple[RmsCurve, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    link: Callable[[Mapping[Any, Any]], str] = lambda _: ""
    columns: tuple[str, ...] = ()

    @property
    def expected(self) -> int:
        """Number of jobs of the whole batch, also of those that are not done."""
        return max(len(self.rows), int(self.settings.get("expected", 0)))

    @property
    def order(self) -> float | None:
        """Order p, if it is the same for all jobs."""
        known = set(self.rows["order"].dropna()) if "order" in self.rows else ()
        return float(*known) if len(known) == 1 else None

    @property
    def value(self) -> str:
        """Name of the value per step."""
        return study_table.value_name(
            self.order, int(self.groups["jobs"].max()) if len(self.groups) else 0
        )

    @property
    def heads(self) -> dict[str, str]:
        """Displayed names of the columns of `groups` that distinguish groups, by column."""
        headings = {
            f"label.{name}" if f"label.{name}" in self.groups else name: name for name in self.by
        }
        return headings | {name: name for name in self.parameters}

    def named(self, row: "Mapping[Hashable, Any] | pd.Series[Any]") -> tuple[str, ...]:
        """Return the labels and parameters of a row of `groups`, as texts."""
        return tuple(value_in_words(row[name]) for name in self.heads)

    @property
    def unit(self) -> str:
        """Unit of the states."""
        return str(self.settings["options"].get("unit") or "")

    @property
    def labels(self) -> list[str]:
        """Names of the labels."""
        columns = self.rows.columns
        return [name.removeprefix("label.") for name in columns if name.startswith("label.")]

    def values_of(self, label: str) -> "pd.Series[str]":
        """Return the value of a label for each job."""
        return self.rows[f"label.{label}"].fillna("").astype(str)

    def name_of(self, row: "pd.Series[Any]") -> str:
        """Return a name for a job: its labels, and the options that are set only for this job."""
        own = json.loads(str(row["options"]))
        texts = [str(row[f"label.{name}"]) for name in self.labels]
        texts += [f"{key}={value}" for key, value in own.items()]
        return "/".join(texts) or str(row["estimate"])

    def quantity(self, value: float, digits: int = 6) -> str:
        """Return a value with its unit."""
        return f"{number(value, digits)} {self.unit}" if self.unit else number(value, digits)

    def between(self, value: Interval, digits: int = 6) -> str:
        """Format the bounds of a value: one number, or both bounds if they differ visibly."""
        if value.upper - value.lower <= study_table.NARROW * value.upper:
            return self.quantity(value.upper, digits)
        return f"{number(value.lower, digits)} to {self.quantity(value.upper, digits)}"

    @cached_property
    def compared(self) -> dict[str, int]:
        """Values of the first label, ranked ones first, each with the index of its colour."""
        names = [entry["name"] for ranking in self.rankings for entry in ranking.entries]
        if self.by:
            names += sorted(self.values_of(self.by[0]).unique())
        return {name: k for k, name in enumerate(dict.fromkeys(names))}

    @cached_property
    def shown_groups(self) -> list[Json]:
        """All groups that have a value, in the order of the ranking.

        Each has its ``name`` and the index of its colour (``track``). ``jobs`` is the number of
        jobs with a value, and ``expected`` the number of all jobs. ``per_step`` and ``rms`` are
        intervals. ``costs`` has the cost per step of each part, and ``cost`` their sum.
        ``parameters`` has the values of the parameters that differ in the batch. Costs can be
        compared only between groups with the same ``parameters``.
        """
        groups, names = self.groups, list(self.heads)
        if self.by and len(groups):
            first = groups[names[0]].astype(str).map(self.compared)
            groups = groups.loc[first.sort_values(kind="stable").index]
        shown: list[Json] = []
        for row in (one for one in frame_records(groups) if one["jobs"]):
            steps = max(float(row["judged.steps"]), 1.0)
            costs: dict[Part, float] = {name: float(row[name]) / steps for name in PARTS}
            shown.append(
                {
                    "name": "/".join(self.named(row)),
                    "track": self.compared.get(str(row[names[0]]), 0) if names else 0,
                    "jobs": int(row["jobs"]),
                    "expected": int(row["expected"]),
                    "per_step": interval(row, "per_step"),
                    "rms": interval(row, "rms"),
                    "costs": costs,
                    "cost": sum(costs.values()),
                    "parameters": [value_in_words(row[name]) for name in self.parameters],
                }
            )
        return shown

    @cached_property
    def heat(self) -> Json | None:
        """Table of the jobs by `heat_of`; None if the jobs have fewer than two labels.

        The columns are the values of the first label. The rows are the values of the second label.
        """
        labels = [*self.by, *(name for name in self.labels if name not in self.by)]
        if len(labels) < 2:
            return None
        across = list(self.compared) or sorted(self.values_of(labels[0]).unique())
        return heat_of(self.rows, (labels[1], labels[0]), across, self.link, self.parameters)

    @cached_property
    def plotted_curves(self) -> list[tuple[int, RmsCurve]]:
        """Curves of the first `MAX_LINES` groups, each with the index of its colour."""
        names = list(dict.fromkeys(curve.name for curve in self.curves))
        first = {curve.name: next(iter(curve.group.values()), "") for curve in self.curves}
        names.sort(key=lambda name: self.compared.get(first[name], len(names)))
        # If all groups differ in their first label, its values have the same colours as in other
        # pictures.
        one_line_each = len(set(first.values())) == len(names)
        track = {
            name: self.compared.get(first[name], k) if one_line_each else k
            for k, name in enumerate(names)
        }
        return [
            (track[name], curve)
            for name in names[:MAX_LINES]
            for curve in self.curves
            if curve.name == name
        ]


def value_in_words(value: object) -> str:
    """Format a label, or the value of a parameter."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def parameters_in_words(parameters: Mapping[str, float | str]) -> str:
    """Format parameters and their values on one line."""
    return ", ".join(f"{name} {value_in_words(value)}" for name, value in parameters.items())


def interval(row: "Mapping[Hashable, Any] | pd.Series[Any]", name: str) -> Interval:
    """Return the bounds of the value `name` from a row of the groups."""
    return Interval(lower=float(row[f"{name}_lower"]), upper=float(row[f"{name}_upper"]))


def bracket(row: Mapping[str, Any], name: str) -> Interval:
    """Return the bounds of the value `name` from an entry of a ranking.

    In an entry, ``name`` itself is the upper bound, and ``name_lower`` is the lower bound.
    """
    return Interval(lower=row[f"{name}_lower"], upper=row[name])


# -------------------------------------------------------------------------------------------------
# The table of all jobs. The columns are values of one label, the rows are values of another label.

TABLE_ROWS = 60
"""Largest number of rows of a table with numbers. Larger tables have coloured squares instead."""

MAX_SQUARES = 1000
"""Largest number of rows of a table. If there are more, rows with failed jobs are kept first, then
rows with the largest values."""

MAX_COLUMNS = 12

VALUE_COLUMNS = ("total_lower", "total_upper", "judged.steps", "order")

TINY = np.finfo(float).tiny


def heat_of(
    rows: "pd.DataFrame",
    labels: tuple[str, str],
    columns: Sequence[str],
    link: Callable[[Mapping[Any, Any]], str],
    parameters: Sequence[str] = (),
) -> Json:
    """Return a table of the jobs with a cell for each pair of values of two labels.

    Parameters
    ----------
    rows : DataFrame
        Rows of a store, one for each job.
    labels : pair of str
        Names of the labels down and across.
    columns : sequence of str
        Displayed values of the label across, in order.
    link : callable
        Function that receives a row and returns the path of its report, or an empty text.
    parameters : sequence of str
        Parameters that differ between jobs. Jobs with different values of these parameters are in
        different rows. The names of the rows contain the values.

    Returns
    -------
    dict
        - ``down``, ``across``: names of the two labels
        - ``rows``, ``columns``: values of the label down and of the label across
        - ``hidden_rows``: number of rows that are left out, which have the smallest values
        - ``hidden_columns``: number of columns that are left out at the end
        - ``squares``: true if there are too many rows to show numbers
        - ``ends``: smallest and largest value; None without values
        - ``scales``: number of sets of parameters
        - ``cells``: for each row, a list of cells; a cell without a job is None

        Each set of parameters has its own scale of shades, from the smallest to the largest value
        of its jobs. Each cell is a dict:

        - ``jobs``, ``failed``: number of its jobs, and number of its failed jobs
        - ``value``: both bounds of TGOSPA per step; None if all jobs failed
        - ``text``: the value as text, or "failed"
        - ``level``: index of the shade, 0 for the smallest value
        - ``link``: path of the report if the cell has a single job
        - ``best``: true if the value is proven to be the best of its row
    """
    down, across = (rows[f"label.{name}"].fillna("").astype(str) for name in labels)
    for name in parameters:
        values = rows[name].map(value_in_words).where(rows[name].notna(), "-")
        down = down + f" {name}=" + values
    shown = list(columns)[:MAX_COLUMNS]
    # If all jobs failed, `rows` lacks the columns of values.
    rows = rows.reindex(columns=list(dict.fromkeys([*rows.columns, *VALUE_COLUMNS])))
    jobs = rows.assign(_row=down, _column=across)[across.isin(shown)]
    sets = jobs.groupby(list(parameters), dropna=False).ngroup() if parameters else 0
    jobs = jobs.assign(_failed=jobs["status"] == "failed", _set=sets, _at=np.arange(len(jobs)))
    numbers = jobs.groupby(["_row", "_column"], sort=False).agg(
        jobs=("_failed", "size"),
        failed=("_failed", "sum"),
        lower=("total_lower", "sum"),
        upper=("total_upper", "sum"),
        steps=("judged.steps", "sum"),
        order=("order", "first"),
        scale=("_set", "first"),
        at=("_at", "first"),
    )
    for end in ("lower", "upper"):
        total = numbers[end].astype(float) / numbers["steps"].astype(float).clip(lower=1.0)
        value = total ** (1 / numbers["order"].astype(float))
        numbers[end] = value.where(numbers["jobs"] > numbers["failed"])
    # If there are too many rows, those with failed jobs are kept first, then those with the largest
    # values. Values are relative to the largest value of the same set of parameters.
    largest = numbers.groupby("scale")["upper"].transform("max").clip(lower=TINY)
    share = (numbers["upper"] / largest).fillna(np.inf).groupby(level="_row").max()
    names = sorted(share.index, key=natural)
    kept = set(share.loc[names].nlargest(MAX_SQUARES).index)
    numbers = numbers[numbers.index.isin(kept, level="_row")]
    own = numbers.groupby("scale")["upper"]
    low, width = own.transform("min"), own.transform("max") - own.transform("min")
    shades = ((numbers["upper"] - low) / width.where(width > 0)).fillna(0.0)
    numbers["level"] = (shades * HEAT_LEVELS).astype(int).clip(upper=HEAT_LEVELS - 1)
    single = numbers[(numbers["jobs"] == 1) & (numbers["failed"] == 0)]
    links = dict(zip(single.index, map(link, frame_records(jobs.iloc[single["at"]])), strict=True))
    known = numbers["upper"].dropna()
    lowest, highest = (known.min(), known.max()) if len(known) else (0.0, 0.0)
    cells: dict[tuple[str, str], Json] = {}
    for item in numbers.reset_index().to_dict("records"):
        place = item["_row"], item["_column"]
        has = item["jobs"] > item["failed"]
        bounds = Interval(lower=item["lower"], upper=item["upper"]) if has else None
        text = "failed" if bounds is None else study_table.fixed(bounds, highest)
        cells[place] = {"value": bounds, "text": text, "link": links.get(place, ""), "best": False}
        cells[place] |= {name: item[name] for name in ("jobs", "failed", "level")}
    names = [name for name in names if name in kept]
    table = [[cells.get((name, column)) for column in shown] for name in names]
    for row in table if len(shown) > 1 else ():
        valued = [cell for cell in row if cell and cell["value"]]
        for cell in valued:
            high = cell["value"].upper
            cell["best"] = sum(other["value"].lower <= high for other in valued) == 1
    return {
        "down": labels[0],
        "across": labels[1],
        "rows": names,
        "columns": shown,
        "cells": table,
        "ends": (lowest, highest) if len(known) else None,
        "scales": numbers.loc[known.index, "scale"].nunique(),
        "squares": len(names) > TABLE_ROWS,
        "hidden_rows": len(share) - len(names),
        "hidden_columns": len(columns) - len(shown),
    }


# -------------------------------------------------------------------------------------------------
# Tables of a batch as text, Markdown, LaTeX, CSV and JSON.


def slice_tables(tables: BatchTables) -> Iterator[table_text.Table]:
    """Yield a table for each attribute by which costs are split; none if no split is requested."""
    yield from result_text.group_tables(list(tables.heads.values()), list(_named_slices(tables)))


def _named_slices(tables: BatchTables) -> Iterator[tuple[tuple[str, ...], Sequence[Slicing]]]:
    """Yield the names and slices of each group that has slices."""
    for group, slicings in tables.slices.items():
        yield tables.named(tables.groups.iloc[group]), slicings


def slices_of_groups(tables: BatchTables) -> Columns:
    """Return the slices of all groups as one table; its first columns are the labels."""
    table: Columns = {}
    for names, slicings in _named_slices(tables):
        part = slices_columns(slicings)
        heads = zip(tables.heads.values(), names, strict=True)
        rows = {head: [name] * len(part["by"]) for head, name in heads} | part
        for head, values in rows.items():
            table.setdefault(head, []).extend(values)
    return table


def about_slices_of(tables: BatchTables) -> Iterator[str]:
    """Yield sentences that explain the slices; none without slices."""
    yield from result_text.about_slices(
        [one for slicings in tables.slices.values() for one in slicings]
    )


# -------------------------------------------------------------------------------------------------
# Tables of a batch for programs: CSV and JSON.

STORED = "slices"
"""Column with the slices of each job, as a JSON text."""

THRESHOLDS = ".at."
"""Text in some column names. The values of these columns are lists: a number for each threshold of
HOTA."""


def batch_columns(tables: BatchTables) -> Columns:
    """Return a table with a row for each job."""
    return {
        str(name): [value if value == value else None for value in column.tolist()]
        for name, column in tables.rows.items()
        if THRESHOLDS not in str(name) and name not in (STORED, STORED_NEES)
    }


def batch_json(tables: BatchTables) -> str:
    """Return groups, rankings, comparisons, slices, curves and jobs as JSON."""
    return json_text(
        {
            "schema": "tgospa-eval/batch/1",
            "by": list(tables.by),
            "expected": tables.expected,
            "groups": _records(tables.groups),
            "ranking": [
                {**row, **_of_jobs(ranking), "of_jobs": ranking.all_jobs}
                for ranking in tables.rankings
                for row in ranking.entries
            ],
            "comparisons": [
                {
                    **row,
                    **_of_jobs(ranking),
                    "pairs": ranking.pairs,
                    "permutations": ranking.permutations,
                    "seed": ranking.seed,
                }
                for ranking in tables.rankings
                for row in ranking.comparisons
            ],
            "notes": list(tables.notes),
            **({"curves": curves_json(tables.curves)} if tables.curves else {}),
            **({"slices": records(slices_of_groups(tables))} if tables.slices else {}),
            "jobs": _records(tables.rows),
        }
    )


def _of_jobs(ranking: Ranking) -> dict[str, object]:
    return {"parameters": dict(ranking.parameters), "jobs": ranking.jobs}


def _records(frame: "pd.DataFrame") -> list[dict[str, object]]:
    """Return rows as JSON objects, without missing values."""
    return [
        {
            str(name): _plain(str(name), value)
            for name, value in row.items()
            if THRESHOLDS in str(name) or value == value
        }
        for row in frame_records(frame)
    ]


def _plain(name: str, value: Any) -> Any:
    if name in (STORED, STORED_NEES):
        return json.loads(value)
    return list(value) if THRESHOLDS in name else value


def document(tables: BatchTables) -> table_text.Document:
    """Return the report of a batch: tables with a row for each group, and its rankings."""
    rows, groups = tables.rows, tables.groups
    failed = int((rows["status"] == "failed").sum()) if len(rows) else 0
    done = f"{len(rows):,} of " if len(rows) < tables.expected else ""
    return table_text.Document(
        title=f"{done}{counted(tables.expected, 'job')}, {failed} failed",
        lines=[
            *filter(None, [table_text.parameters_of(_parameters(tables))]),
            *(line for ranking in tables.rankings for line in _orders(ranking)),
            *filter(_warns, tables.notes),
        ],
        tables=[
            *(study_tables(tables) if len(groups) else ()),
            *other_tables(tables),
            *slice_tables(tables),
        ],
        notes=list(_notes(tables)),
    )


def _warns(note: str) -> bool:
    """Check whether a note is a warning."""
    return note.startswith("warning:")


def of_expected(jobs: int, expected: int) -> str:
    """Format the number of jobs with a value; "3 of 4" if some of all jobs have none."""
    return f"{jobs:,} of {expected:,}" if jobs < expected else f"{jobs:,}"


def study_tables(tables: BatchTables) -> Iterator[table_text.Table]:
    """Yield the table of the study, the table of costs per run, and possibly a table of rankings.

    If the rankings use all jobs and each group has only one label, the first table shows the
    rankings. Otherwise the rankings have a table of their own.
    """
    heads, groups = tuple(tables.heads.values()), frame_records(tables.groups)
    places = _places(tables)
    rank = {own: k for k, own in enumerate(places)}
    groups.sort(key=lambda row: rank.get(_group_key(tables, row), len(rank)))
    rows = [_study_row(tables, row, places) for row in groups]
    title, rivals = tables.value, _rivals(tables, groups)
    caption = study_table.study_caption(title, _parameters(tables))
    yield study_table.study_table(rows, heads, rivals, title, tables.columns, caption)
    yield study_table.costs_table(rows, heads, rivals, caption)
    own = list(_ranked(tables))
    if own and not places:
        yield study_table.study_table(
            [
                study_table.StudyRow(
                    names=(entry["name"], *map(value_in_words, ranking.parameters.values())),
                    jobs=of_expected(ranking.jobs, ranking.all_jobs),
                    steps=1.0,
                    order=ranking.order,
                    total=ranking.total(entry),
                    costs={part: entry[part] ** ranking.order for part in PARTS},
                    confidence=entry["per_step_confidence"],
                    place=ranking.place(entry),
                    p=p_value,
                )
                for ranking, entry, p_value in own
            ],
            (tables.rankings[0].label, *tables.rankings[0].parameters),
            [[k for k, one in enumerate(own) if one[0] is ranking] for ranking in tables.rankings],
            title,
            caption=f"Values are those of the jobs that all rows of a ranking have. {caption}",
        )


GroupKey = tuple[object, ...]


def _group_key(tables: BatchTables, row: Mapping[Hashable, Any]) -> GroupKey:
    return tuple(row[name] for name in tables.heads)


Ranked = tuple[Ranking, Json, float | None]
"""A ranking, one of its entries, and the p value of the entry."""


def _ranked(tables: BatchTables) -> Iterator[Ranked]:
    """Yield the entries of all rankings, best first."""
    for ranking in tables.rankings:
        for entry, p_value in zip(ranking.entries, ranking.p_values, strict=True):
            yield ranking, entry, p_value


def _places(tables: BatchTables) -> dict[GroupKey, Ranked]:
    """Return the ranking, entry and p value of each group, best first.

    The result is empty if groups have several labels, or if a ranking leaves out jobs.
    """
    if len(tables.by) != 1 or any(one.jobs < one.all_jobs for one in tables.rankings):
        return {}
    return {(one[1]["name"], *one[0].parameters.values()): one for one in _ranked(tables)}


def _study_row(
    tables: BatchTables,
    row: Mapping[Hashable, Any],
    places: Mapping[GroupKey, Ranked],
) -> study_table.StudyRow:
    jobs = max(int(row["jobs"]), 1)
    order = float(row["order"]) if "order" in row else tables.order or 1.0
    ranking, entry, p_value = places.get(_group_key(tables, row), (None, {}, None))
    sure = interval(row, "per_step_confidence")
    metrics = next(result_text.other_records([row]))
    return study_table.StudyRow(
        names=tables.named(row),
        jobs=of_expected(int(row["jobs"]), int(row["expected"])),
        steps=max(float(row["judged.steps"]) / jobs, 1.0),
        order=order,
        total=interval(row, "total").scaled(1 / jobs),
        costs={part: float(row[part]) / jobs for part in PARTS},
        confidence=(sure.lower, sure.upper) if sure.lower == sure.lower else None,
        place=ranking.place(entry) if ranking else "",
        p=p_value,
        mean_of_roots=row.get("mean_of_roots"),
        numbers={
            **dotted(metrics),
            **{str(k): v for k, v in row.items() if str(k).startswith(f"{SUMMARY}.") and v == v},
            **({"gospa.total": metrics["gospa"]["total"] / jobs} if "gospa" in metrics else {}),
        },
    )


def _parameters(tables: BatchTables) -> Json:
    """Return the parameters that have the same value in all jobs."""
    if "parameters" not in tables.rows:
        return {}
    first, *rest = map(json.loads, tables.rows["parameters"].dropna().unique())
    return {
        name: value
        for name, value in first.items()
        if all(name in own and own[name] == value for own in rest)
    }


def _rivals(tables: BatchTables, rows: Sequence[Mapping[Hashable, Any]]) -> list[list[int]]:
    """Return lists of indices of rows that differ only in the first label.

    A list is left out if its rows have different numbers of jobs, or if their ranking does not use
    all jobs.
    """
    ranked = [item.parameters for item in tables.rankings if item.jobs == item.all_jobs]
    rivals: dict[tuple[Any, ...], list[int]] = {}
    for k, row in enumerate(rows):
        if row["jobs"] and {name: row[name] for name in tables.parameters} in ranked:
            rivals.setdefault(tuple(row[name] for name in [*tables.heads][1:]), []).append(k)
    return [alike for alike in rivals.values() if len({rows[k]["jobs"] for k in alike}) == 1]


def other_tables(tables: BatchTables) -> Iterator[table_text.Table]:
    """Yield the table of other metrics and the table of covariances, if they are requested."""
    heads, rows = tables.heads, _with_values(tables)
    names = [tables.named(row) for row in rows]
    means = [  # costs of GOSPA are shown as means over the runs
        {name: own / row["jobs"] if "gospa." in str(name) else own for name, own in row.items()}
        for row in rows
    ]
    other = list(result_text.other_records(means))
    yield from result_text.grouped_table(tuple(heads.values()), names, other, _rivals(tables, rows))
    nees = [NeesSums.of_row(row) for row in rows]
    items = [{**row, NEES: own and own.record()} for row, own in zip(rows, nees, strict=True)]
    yield from result_text.covariances_table(tuple(heads.values()), names, items)


def _with_values(tables: BatchTables) -> list[dict[Hashable, Any]]:
    """Return the rows of groups in which at least one job has a value."""
    return [row for row in frame_records(tables.groups) if row["jobs"]]


def _orders(ranking: Ranking) -> Iterator[str]:
    """Yield a sentence about the proven order, then one about the statistical order."""
    entries, where = ranking.entries, _where(ranking)
    jobs = f"{counted(ranking.jobs, 'job')} each"
    if ranking.jobs < ranking.all_jobs:
        all_have = f"over the {counted(ranking.jobs, 'job')} that all {len(entries)} have"
        jobs = f"{all_have}, of {ranking.all_jobs:,}"
    order = table_text.order_in_words(ranking.value, entries, ranking.comparisons)
    yield f"{where}{order} ({jobs})"
    begin = f"{where}Statistical order, {counted(ranking.pairs, 'pair')}"
    if not ranking.permutations:
        copied = ranking.truths == 1 and ranking.jobs >= 6
        why = "; copies count once: a test needs different runs on both sides, or several truths"
        yield f"{begin}: at least 6 are needed for a test about {ranking.population}{why * copied}"
        return
    first = [item["name"] for item in entries if item["statistical_place"][0] == 1]
    if len(first) == 1 and entries[0]["statistical_place"] == (1, 1):
        yield f"{begin}: {first[0]} is significantly better than all others"
    else:
        top = table_text.first_names([[name] for name in first])
        yield f"{begin}: no significant difference at the top between {top}"


def _where(ranking: Ranking) -> str:
    """Return the beginning of a sentence on a ranking: its parameters, or an empty text."""
    return f"{parameters_in_words(ranking.parameters)}: " if ranking.parameters else ""


def _notes(tables: BatchTables) -> Iterator[str]:
    if not len(tables.groups):
        return
    title = tables.value
    roots = (
        "; mean of roots: the plain mean of the values" if "mean_of_roots" in tables.groups else ""
    )
    yield (
        f"{title}: (sum of the totals / sum of the steps)^(1/p), each part likewise; TGOSPA: "
        f"(mean of the totals of the runs)^(1/p); costs: means over the runs{roots}"
    )
    steps = tables.rows["judged.steps"].dropna() if "judged.steps" in tables.rows else ()
    lengths = sorted(set(map(int, steps)))
    if len(lengths) > 1:
        yield (
            f"the jobs have {lengths[0]:,} to {counted(lengths[-1], 'step')}: long jobs weigh "
            "more; in values per step every step weighs the same"
        )
    for row in frame_records(tables.groups[tables.groups["jobs"] < tables.groups["expected"]]):
        yield (
            f"{of_expected(row['jobs'], row['expected'])} jobs: the other jobs have no value; "
            "their costs are missing"
        )
        break
    opened = int(tables.groups["open"].sum())
    if opened:
        yield f"{counted(opened, 'job')} did not reach the requested accuracy"
    yield from (note for note in tables.notes if not _warns(note))
    if tables.rankings:
        yield "order and places are proven for these files, by the bounds"
    certified = tables.rows["certified"].dropna() if "certified" in tables.rows else ()
    if not all(certified):
        yield "values are between the proven bounds"
        yield table_text.SPLIT_NOTE
    for population in dict.fromkeys(
        item.population for item in tables.rankings if item.permutations
    ):
        yield (
            f"p of the difference to the best, for {population} drawn as these were: by a "
            "two-sided permutation test, adjusted for all pairs (Holm); significant below 0.05"
        )
    if tables.groups["confidence_upper"].notna().any():
        yield f"{study_table.INTERVAL}: of {title}, by Student's t and the jackknife"
    for ranking in tables.rankings:
        if ranking.left_out:
            names = listed(ranking.left_out, table_text.MAX_NAMED)
            yield f"{_where(ranking)}{names}: not ranked, no job has a value"
    texts = tables.rows["parameters"].dropna().unique() if "parameters" in tables.rows else ()
    yield from about_periods(tables)
    for name in sorted({str(json.loads(text).get("preprocess") or "") for text in texts} - {""}):
        done = "are not judged" if name.endswith(":ignore") else "were left out before all metrics"
        yield f"by {option('preprocess', name)} boxes {done}"
    yield from about_other_metrics(tables)
    yield from about_slices_of(tables)


def about_periods(tables: BatchTables) -> Iterator[str]:
    """Yield a sentence on the time for which an estimate stays valid, for each group."""
    if "parameters" in tables.rows:
        keys = [*(f"label.{name}" for name in tables.by), *tables.parameters, "_all"]
        rows = tables.rows.dropna(subset="parameters").assign(_all="")
        yield from table_text.about_periods(
            (" ".join(map(value_in_words, key)).strip(), list(map(json.loads, own.unique())))
            for key, own in rows.groupby(keys, dropna=False)["parameters"]
        )


def about_other_metrics(tables: BatchTables) -> Iterator[str]:
    """Yield sentences that explain the other metrics; none if no other metric was requested."""
    other = next(result_text.other_records(_with_values(tables)), {})
    if other:
        yield "other metrics are joined as TrackEval joins sequences: counts over all jobs of a row"
        yield from result_text.direction(other)


def batch_report(tables: BatchTables, format: str) -> str:
    """Return the report of a batch in the format of ``--format``."""
    return table_text.rendered(format, tables, document, batch_json, batch_columns)
