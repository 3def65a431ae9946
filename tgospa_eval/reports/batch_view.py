"""What page and pictures of a batch have in common: values, colours, what is beside what."""

import json
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from tgospa_eval.common.figures import number
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.reports.batch import NARROW
from tgospa_eval.reports.batch_records import BatchTables, value_in_words
from tgospa_eval.reports.curves import RmsCurve
from tgospa_eval.reports.heat import Heat, heat_of
from tgospa_eval.results.records import PARTS, Part

if TYPE_CHECKING:
    import pandas as pd

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
        names = [entry.name for ranking in self.tables.rankings for entry in ranking.entries]
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


def interval(row: "pd.Series[Any]", name: str) -> Interval:
    """The bracket of a value of a group."""
    return Interval(lower=float(row[f"{name}_lower"]), upper=float(row[f"{name}_upper"]))
