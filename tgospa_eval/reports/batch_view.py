"""What page and pictures of a batch have in common: values, colours, what is beside what."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.palette import HEAT_LEVELS
from tgospa_eval.common.words import THOUSANDS, natural, number
from tgospa_eval.reports.batch import NARROW, interval
from tgospa_eval.reports.batch_records import BatchTables, value_in_words
from tgospa_eval.reports.curves import RmsCurve
from tgospa_eval.results.records import PARTS, Part

if TYPE_CHECKING:
    import pandas as pd


TABLE_ROWS = 60
"""Most rows of a table with numbers; of more there are squares."""

MOST_SQUARES = 1000
"""Of each column; of more jobs those are shown that lose most."""

MOST_COLUMNS = 12

DIGITS = 4
"""Of the largest value."""

MOST_DECIMALS = 6


@dataclass(frozen=True, kw_only=True)
class HeatCell:
    """The jobs of one row and one column.

    Parameters
    ----------
    value : Interval, optional
        Bracket of TGOSPA per step; None if no job has one.
    jobs, failed : int
        How many there are, and how many of them failed.
    level : int
        Its shade, from 0.
    link : str
        Where its report is, if it is a single job that has one.
    best : bool
        Whether no other of its row can be proven to be better or equal.
    """

    value: Interval | None
    jobs: int
    failed: int
    level: int = 0
    link: str = ""
    best: bool = False


@dataclass(frozen=True, kw_only=True)
class Heat:
    """The whole picture.

    Parameters
    ----------
    down, across : str
        Names of the labels.
    rows, columns : sequence of str
        Their values.
    cells : sequence of sequence of HeatCell or None
        By row and column; None where there is no job.
    ends : pair of float, optional
        Least and largest value.
    scales : int
        Sets of parameters: a shade is between the least and the largest value of its own.
    hidden_rows, hidden_columns : int
        How many are left out, those with the smallest values and the last.
    """

    down: str
    across: str
    rows: Sequence[str]
    columns: Sequence[str]
    cells: Sequence[Sequence[HeatCell | None]]
    ends: tuple[float, float] | None
    scales: int = 1
    hidden_rows: int = 0
    hidden_columns: int = 0

    @property
    def squares(self) -> bool:
        """Whether there are too many rows for numbers."""
        return len(self.rows) > TABLE_ROWS

    def text(self, value: Interval) -> str:
        """A value with as many decimals as all have, or both ends where they differ there."""
        largest = self.ends[1] if self.ends else 0.0
        decimals = max(0, DIGITS - 1 - math.floor(math.log10(largest))) if largest > 0 else 0
        if largest >= THOUSANDS or decimals > MOST_DECIMALS:
            low, high = (f"{end:.{DIGITS - 1}e}" for end in (value.lower, value.upper))
        else:
            low, high = (f"{end:,.{decimals}f}" for end in (value.lower, value.upper))
        return high if low == high else f"{low} to {high}"


def heat_of(
    rows: "pd.DataFrame",
    labels: tuple[str, str],
    columns: Sequence[str],
    link: Callable[["pd.Series[Any]"], str],
    parameters: Sequence[str] = (),
) -> Heat:
    """The picture of the jobs of some rows.

    Parameters
    ----------
    rows : DataFrame
        Of a store.
    labels : pair of str
        Names of the labels down and across.
    columns : sequence of str
        Values of the label across, in order; others are left out.
    link : callable
        Where the report of the job of a row is; nothing if there is none.
    parameters : sequence of str
        Columns in which rows differ: costs are not added up over these, they are named down.
    """
    down, across = (rows[f"label.{name}"].fillna("").astype(str) for name in labels)
    for name in parameters:
        down = down + [f" {name}={_in_words(value)}" for value in rows[name]]
    shown = list(columns)[:MOST_COLUMNS]
    of_shown = across.isin(shown)
    found = rows[of_shown].assign(_down=down[of_shown], _across=across[of_shown])
    names = sorted(found["_down"].unique(), key=natural)
    found["_row"] = found["_down"].map({name: k for k, name in enumerate(names)})
    found["_column"] = found["_across"].map({name: k for k, name in enumerate(shown)})
    lower, upper, jobs, failed = _sums(found, (len(names), len(shown)))
    scale = _scales(found, parameters)
    size = np.array([np.nanmax(upper[scale == k], initial=0.0) for k in range(scale.max() + 1)])
    share = upper / np.maximum(size, np.finfo(float).tiny)[scale][:, None]
    kept = _kept(np.where(np.isnan(upper) & (jobs > 0), np.inf, share))
    single = found[jobs[found["_row"], found["_column"]] == 1]
    links = {
        (int(row["_row"]), int(row["_column"])): link(row)
        for _, row in single[single["_row"].isin(kept)].iterrows()
    }
    known = upper[kept][~np.isnan(upper[kept])]
    ends = (float(known.min()), float(known.max())) if len(known) else None
    shades = _shades(upper, scale, kept)

    def cell(k: int, column: int) -> HeatCell | None:
        if not jobs[k, column]:
            return None
        low, high = float(lower[k, column]), float(upper[k, column])
        counts = int(jobs[k, column]), int(failed[k, column])
        if np.isnan(high):
            return HeatCell(value=None, jobs=counts[0], failed=counts[1], link="")
        others = np.delete(lower[k], column)
        return HeatCell(
            value=Interval(lower=low, upper=high),
            jobs=counts[0],
            failed=counts[1],
            level=int(shades[k, column]),
            link=links.get((k, column), ""),
            best=len(shown) > 1 and not bool((others <= high).any()),
        )

    return Heat(
        down=labels[0],
        across=labels[1],
        rows=[names[k] for k in kept],
        columns=shown,
        cells=[[cell(k, column) for column in range(len(shown))] for k in kept],
        ends=ends,
        scales=len({scale[k] for k in kept if not np.isnan(upper[k]).all()}),
        hidden_rows=len(names) - len(kept),
        hidden_columns=len(columns) - len(shown),
    )


def _scales(found: "pd.DataFrame", parameters: Sequence[str]) -> Any:
    """Of each row the number of its set of parameters; of jobs without value it does not matter."""
    if not parameters:
        return np.zeros(int(found["_row"].max()) + 1, int)
    sets = found.groupby(list(parameters), dropna=False).ngroup()
    return sets.groupby(found["_row"]).first().to_numpy()


def _shades(values: Any, scale: Any, kept: Sequence[int]) -> Any:
    """Of each cell its shade, from 0 for the least value of its set of parameters."""
    shades = np.zeros(values.shape)
    for each in np.unique(scale[kept]):
        rows = np.array([k for k in kept if scale[k] == each])
        own = values[rows]
        if np.isnan(own).all():
            continue
        least, width = np.nanmin(own), np.nanmax(own) - np.nanmin(own)
        shades[rows] = np.nan_to_num((own - least) / width if width > 0 else 0.0 * own)
    return np.minimum((shades * HEAT_LEVELS).astype(int), HEAT_LEVELS - 1)


def _in_words(value: float | str) -> str:
    """A parameter, which a failed job does not have."""
    if isinstance(value, str):
        return value
    return f"{value:g}" if value == value else "-"


def _sums(found: "pd.DataFrame", shape: tuple[int, int]) -> tuple[Any, Any, Any, Any]:
    """Bounds of TGOSPA per step, and numbers of jobs and of those that failed, by cell."""
    place = found["_row"].to_numpy(), found["_column"].to_numpy()
    bad = (found["status"] == "failed").to_numpy()

    def added(values: Any) -> Any:
        total = np.zeros(shape)
        np.add.at(total, place, values)
        return total

    if bad.all():
        nothing = np.full(shape, np.nan)
        return nothing, nothing, added(1), added(bad)
    steps = added(found["judged.steps"].fillna(0.0).to_numpy(float))
    orders = found.groupby("_row")["order"].first().reindex(range(shape[0]))
    order = orders.fillna(1.0).to_numpy(float)[:, None]
    valued = added(~bad) > 0
    bounds = []
    for name in ("total_lower", "total_upper"):
        total = added(found[name].fillna(0.0).to_numpy(float))
        value = (total / np.maximum(steps, 1.0)) ** (1 / order)
        bounds.append(np.where(valued, value, np.nan))
    return bounds[0], bounds[1], added(1), added(bad)


def _kept(values: Any) -> list[int]:
    """The rows that are shown: all, or those with the largest value; failed jobs are infinite."""
    if len(values) <= MOST_SQUARES:
        return list(range(len(values)))
    largest = np.where(np.isnan(values), -np.inf, values).max(axis=1)
    return sorted(np.argsort(-largest, kind="stable")[:MOST_SQUARES].tolist())


MOST_LINES = 6
"""Groups whose curves are drawn."""

METRIC_COLUMNS = ("distance", "cutoff", "order", "switch_penalty")
"""Columns of parameters."""


@dataclass(frozen=True, kw_only=True)
class GroupCosts:
    """A group of jobs.

    Parameters
    ----------
    name : str
        Its labels, and parameters where these differ.
    track : int
        Number of its colour.
    jobs, expected : int
        How many have a value, and how many there should be.
    values : mapping of str to Interval
        Brackets of ``per_step``, ``combined`` and ``rms``.
    costs : mapping of str to float
        Parts of the cost per step.
    parameters : tuple of str
        Those that differ in the batch: costs of other ones are no larger or smaller.
    """

    name: str
    track: int
    jobs: int
    expected: int
    values: Mapping[str, Interval]
    costs: Mapping[Part, float]
    parameters: tuple[str, ...]

    @property
    def cost(self) -> float:
        """Of a step."""
        return sum(self.costs.values())


@dataclass(frozen=True, kw_only=True)
class BatchView:
    """A batch as it is shown.

    Parameters
    ----------
    tables : BatchTables
        Groups, rows, rankings and curves.
    settings : mapping of str to object
        What was evaluated, and how.
    link : callable
        Where the report of the job of a row is; nothing if there is none.
    """

    tables: BatchTables
    settings: Mapping[str, Any]
    link: "Callable[[pd.Series[Any]], str]"

    @property
    def unit(self) -> str:
        """Of the states."""
        return str(self.settings["options"].get("unit") or "")

    @property
    def labels(self) -> list[str]:
        """Names of the labels."""
        columns = self.tables.rows.columns
        return [name.removeprefix("label.") for name in columns if name.startswith("label.")]

    def values_of(self, label: str) -> "pd.Series[str]":
        """The value of a label of each job."""
        return self.tables.rows[f"label.{label}"].fillna("").astype(str)

    def name_of(self, row: "pd.Series[Any]") -> str:
        """Labels of a job, and options of its own."""
        own = json.loads(str(row["options"]))
        texts = [str(row[f"label.{name}"]) for name in self.labels]
        texts += [f"{key}={value}" for key, value in own.items()]
        return "/".join(texts) or str(row["estimate"])

    def quantity(self, value: float, digits: int = 6) -> str:
        """A value with its unit."""
        return f"{number(value, digits)} {self.unit}" if self.unit else number(value, digits)

    def between(self, value: Interval, digits: int = 6) -> str:
        """A value, or both ends where they differ."""
        if value.upper - value.lower <= NARROW * value.upper:
            return self.quantity(value.upper, digits)
        return f"{number(value.lower, digits)} to {self.quantity(value.upper, digits)}"

    @cached_property
    def compared(self) -> dict[str, int]:
        """Values of the first label, those that are ranked first, with numbers of colours."""
        names = [entry["name"] for ranking in self.tables.rankings for entry in ranking.entries]
        if self.tables.by:
            names += sorted(self.values_of(self.tables.by[0]).unique())
        return {name: k for k, name in enumerate(dict.fromkeys(names))}

    @cached_property
    def groups(self) -> list[GroupCosts]:
        """All groups, in the order of the ranking."""
        groups, names = self.tables.groups, list(self.tables.heads)
        if self.tables.by and len(groups):
            first = groups[names[0]].astype(str).map(self.compared)
            groups = groups.loc[first.sort_values(kind="stable").index]
        return [
            GroupCosts(
                name="/".join(value_in_words(row[name]) for name in names),
                track=self.compared.get(str(row[names[0]]), 0) if names else 0,
                jobs=int(row["jobs"]),
                expected=int(row["expected"]),
                values={name: interval(row, name) for name in ("per_step", "combined", "rms")},
                costs={
                    name: float(row[name]) / max(float(row["judged.steps"]), 1.0) for name in PARTS
                },
                parameters=tuple(value_in_words(row[name]) for name in self.tables.parameters),
            )
            for _, row in groups.iterrows()
        ]

    @cached_property
    def heat(self) -> Heat | None:
        """The first label of the groups across, the second or another down."""
        labels = [*self.tables.by, *(name for name in self.labels if name not in self.tables.by)]
        if len(labels) < 2:
            return None
        across = list(self.compared) or sorted(self.values_of(labels[0]).unique())
        parameters = self.tables.parameters
        return heat_of(self.tables.rows, (labels[1], labels[0]), across, self.link, parameters)

    @cached_property
    def drawn_curves(self) -> list[tuple[int, RmsCurve]]:
        """Those of the first groups, with numbers of colours."""
        names = list(dict.fromkeys(curve.name for curve in self.tables.curves))
        first = {curve.name: next(iter(curve.group.values()), "") for curve in self.tables.curves}
        names.sort(key=lambda name: self.compared.get(first[name], len(names)))
        # The colour is that of the ranking, unless several lines would have it.
        alone = len(set(first.values())) == len(names)
        track = {
            name: self.compared.get(first[name], k) if alone else k for k, name in enumerate(names)
        }
        return [
            (track[name], curve)
            for name in names[:MOST_LINES]
            for curve in self.tables.curves
            if curve.name == name
        ]
