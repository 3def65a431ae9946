"""The values of jobs side by side: one label across, another down, darker where more is lost."""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.figures import THOUSANDS
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.interval import Interval
from tgospa_eval.common.palette import HEAT_LEVELS
from tgospa_eval.common.words import natural

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
    for number in np.unique(scale[kept]):
        rows = np.array([k for k in kept if scale[k] == number])
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
