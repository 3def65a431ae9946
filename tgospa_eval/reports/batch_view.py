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
from tgospa_eval.results.records import PARTS, Json, Part

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

VALUE_COLUMNS = ("total_lower", "total_upper", "judged.steps", "order")

TINY = np.finfo(float).tiny


@dataclass(frozen=True, kw_only=True)
class Heat:
    """The whole picture.

    Parameters
    ----------
    down, across : str
        Names of the labels.
    rows, columns : sequence of str
        Their values.
    cells : sequence of sequence of dict or None
        By row and column; None where there is no job. ``value`` is the bracket of TGOSPA per step,
        None if all ``jobs`` have ``failed``; ``level`` its shade, from 0; ``link`` where its report
        is, if it is a single job that has one; ``best`` whether no other of its row can be proven
        to be better or equal.
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
    cells: Sequence[Sequence[Json | None]]
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
    link: Callable[[Mapping[Any, Any]], str],
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
        values = rows[name].map(value_in_words).where(rows[name].notna(), "-")
        down = down + f" {name}=" + values
    shown = list(columns)[:MOST_COLUMNS]
    # Where all jobs failed there are no columns of values.
    rows = rows.reindex(columns=list(dict.fromkeys([*rows.columns, *VALUE_COLUMNS])))
    found = rows.assign(_row=down, _column=across)[across.isin(shown)]
    sets = found.groupby(list(parameters), dropna=False).ngroup() if parameters else 0
    found = found.assign(_failed=found["status"] == "failed", _set=sets, _at=np.arange(len(found)))
    numbers = found.groupby(["_row", "_column"], sort=False).agg(
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
    # Of many rows those with the largest value of their set; failed jobs are infinite.
    largest = numbers.groupby("scale")["upper"].transform("max").clip(lower=TINY)
    share = (numbers["upper"] / largest).fillna(np.inf).groupby(level="_row").max()
    names = sorted(share.index, key=natural)
    kept = set(share.loc[names].nlargest(MOST_SQUARES).index)
    numbers = numbers[numbers.index.isin(kept, level="_row")]
    own = numbers.groupby("scale")["upper"]
    least, width = own.transform("min"), own.transform("max") - own.transform("min")
    shades = ((numbers["upper"] - least) / width.where(width > 0)).fillna(0.0)
    numbers["level"] = (shades * HEAT_LEVELS).astype(int).clip(upper=HEAT_LEVELS - 1)
    alone = numbers[(numbers["jobs"] == 1) & (numbers["failed"] == 0)]
    links = dict(
        zip(alone.index, map(link, found.iloc[alone["at"]].to_dict("records")), strict=True)
    )
    cells: dict[tuple[str, str], Json] = {}
    for item in numbers.reset_index().to_dict("records"):
        place = item["_row"], item["_column"]
        has = item["jobs"] > item["failed"]
        cells[place] = {
            "value": Interval(lower=item["lower"], upper=item["upper"]) if has else None,
            "jobs": item["jobs"],
            "failed": item["failed"],
            "level": item["level"],
            "link": links.get(place, ""),
            "best": False,
        }
    names = [name for name in names if name in kept]
    table = [[cells.get((name, column)) for column in shown] for name in names]
    for row in table if len(shown) > 1 else ():
        valued = [cell for cell in row if cell and cell["value"]]
        for cell in valued:
            high = cell["value"].upper
            cell["best"] = sum(other["value"].lower <= high for other in valued) == 1
    known = numbers["upper"].dropna()
    return Heat(
        down=labels[0],
        across=labels[1],
        rows=names,
        columns=shown,
        cells=table,
        ends=(known.min(), known.max()) if len(known) else None,
        scales=numbers.loc[known.index, "scale"].nunique(),
        hidden_rows=len(share) - len(names),
        hidden_columns=len(columns) - len(shown),
    )


MOST_LINES = 6
"""Groups whose curves are drawn."""

METRIC_COLUMNS = ("distance", "cutoff", "order", "switch_penalty")
"""Columns of parameters."""


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
    link: Callable[[Mapping[Any, Any]], str]

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
    def groups(self) -> list[Json]:
        """All groups, in the order of the ranking.

        Each has its ``name``, the number of its colour (``track``), ``jobs`` with a value and as
        many as are ``expected``, the brackets ``per_step`` and ``rms``, the parts of the ``cost``
        per step (``costs``), and the ``parameters`` that differ in the batch: costs of other ones
        are no larger or smaller.
        """
        groups, names = self.tables.groups, list(self.tables.heads)
        if self.tables.by and len(groups):
            first = groups[names[0]].astype(str).map(self.compared)
            groups = groups.loc[first.sort_values(kind="stable").index]
        found: list[Json] = []
        for row in groups.to_dict("records"):
            steps = max(float(row["judged.steps"]), 1.0)
            costs: dict[Part, float] = {name: float(row[name]) / steps for name in PARTS}
            found.append(
                {
                    "name": "/".join(self.tables.named(row)),
                    "track": self.compared.get(str(row[names[0]]), 0) if names else 0,
                    "jobs": int(row["jobs"]),
                    "expected": int(row["expected"]),
                    "per_step": interval(row, "per_step"),
                    "rms": interval(row, "rms"),
                    "costs": costs,
                    "cost": sum(costs.values()),
                    "parameters": [value_in_words(row[name]) for name in self.tables.parameters],
                }
            )
        return found

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
