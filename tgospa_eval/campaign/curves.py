"""Root mean squares over runs at each time: docs/reference/batch.md has the definitions.

Every run of a group counts at each time, with cost 0 where it has nothing. Sums over time and over
runs go from left to right, runs in the order of the jobs, and powers are those of Python, so that a
script that adds up single results gets the same doubles.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.campaign.grouping import in_words, labels_of, shown_labels, with_parameters
from tgospa_eval.campaign.row import LABEL
from tgospa_eval.campaign.statistics import CONFIDENCE, LEAST_PAIRS, NUMBERS_AT_ONCE, intervals
from tgospa_eval.campaign.store import COST_COLUMNS, CURVE_COLUMNS
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.formats.times import TimeError, places
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.reports.curves import (
    KIND_COLUMN,
    POINT_COLUMNS,
    BandKind,
    CurveKind,
    RmsCurve,
    RmsLine,
)
from tgospa_eval.results.records import Time
from tgospa_eval.text import listed

if TYPE_CHECKING:
    import pandas as pd

BAND_RESAMPLES, BAND_SEED = 1000, 1
"""Of the bootstrap."""

BAND_LEVELS = ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2)
"""Ends of bands."""

BAND_TAIL = round(BAND_RESAMPLES * BAND_LEVELS[0])
"""Draws that are at either end of a band, or outside."""

MOST_BANDED = 20_000
"""Times with bands, of runs that have few in common."""

LEAST_RUNS: Mapping[BandKind, int] = {
    "interval": LEAST_PAIRS,
    "bootstrap": LEAST_PAIRS,
    "percentiles": 2,
    "deviation": 2,
}
"""With fewer there are no bands."""


def rms_curves(
    rows: "pd.DataFrame",
    steps: "pd.DataFrame | None",
    by: Sequence[str],
    band: BandKind = "interval",
) -> tuple[list[RmsCurve], list[str]]:
    """The curves of each group of jobs whose steps are stored, and what is to be told of them.

    Parameters
    ----------
    rows : DataFrame
        Of a store, in the order of the jobs.
    steps : DataFrame, optional
        Of these rows, as `read_steps` has them.
    by : sequence of str
        Labels that make a group; parameters that differ make groups as well.
    band : str
        What is around the curves.
    """
    if steps is None:
        return [], []
    rows, differing = with_parameters(rows)
    valued = rows[rows["status"] != "failed"]
    there = [name for name in by if name in labels_of(rows)]
    keys = [*(LABEL + name for name in there), *differing]
    heads = [*shown_labels(there, {KIND_COLUMN, *POINT_COLUMNS, *differing}), *differing]
    grouped = valued.assign(_all="").groupby(keys or "_all", sort=True, dropna=False)
    number = np.full(int(rows.index.max()) + 1, -1)
    number[valued.index] = grouped.ngroup()
    parts: dict[Any, pd.DataFrame] = dict(iter(steps.groupby(number[steps["job"]])))
    found: list[RmsCurve] = []
    notes: dict[str, list[str]] = {}
    for k, (_, group) in enumerate(grouped):
        if k not in parts:
            continue
        first = group.iloc[0]
        labels = {head: in_words(first[key]) for head, key in zip(heads, keys, strict=True)}
        made = _Curves(group=labels, order=float(first["order"]), band=band)
        # A run without any step has nothing at all times.
        counts = group.index.isin(parts[k]["job"]) | (group["sizes.steps"] == 0).to_numpy()
        try:
            found += made.of(parts[k], group.index[counts].to_numpy())
        except TimeError as error:
            made.notes.append(f"there are none: {error}")
        if not counts.all():
            missing = f"{np.count_nonzero(~counts):,} of {counted(len(counts), 'run')}"
            made.notes.append(f"of {missing} no steps are stored, and these do not count")
        for text in made.notes:
            notes.setdefault(text, []).append("/".join(labels.values()) or "all jobs")
    return found, [f"curves of {listed(names)}: {text}" for text, names in notes.items()]


@dataclass(frozen=True, kw_only=True)
class _Curves:
    """What makes the curves of a group.

    Parameters
    ----------
    group : mapping of str to str
        Its labels.
    order : float
        The order p.
    band : str
        What is around the curves.
    notes : list of str
        What is to be told of them.
    """

    group: Mapping[str, str]
    order: float
    band: BandKind
    notes: list[str] = field(default_factory=list)

    def of(self, steps: "pd.DataFrame", jobs: Ints) -> Iterator[RmsCurve]:
        """The curves of these jobs, whose steps these are."""
        runs = _Runs(steps, jobs)
        if runs.apart:
            bands = f"; more than {MOST_BANDED:,} times have no bands" if runs.many else ""
            self.notes.append(
                "at most times half of the runs or fewer have a step, and the others count with "
                f"cost 0{bands}; where their stamps differ, --resample puts all on one clock"
            )
        costs = runs.columns(COST_COLUMNS)
        kinds: tuple[CurveKind, CurveKind] = ("step", "cumulative")
        for kind, rows in zip(kinds, (costs, runs.so_far(costs)), strict=True):
            lines = [self._line(runs, kind, row) for row in rows]
            yield self._curve(kind, runs, lines)
        traced = steps[steps[CURVE_COLUMNS[0]].notna()]
        if not len(traced):
            return
        having = np.isin(jobs, traced["job"]) | ~np.isin(jobs, steps["job"])
        if not having.all():
            missing = f"{np.count_nonzero(~having):,} of {counted(len(having), 'run')}"
            self.notes.append(f"{missing} have no values of the steps up to each step")
        runs = _Runs(traced, jobs[having])
        value, lower, upper = self._powers(runs.columns(CURVE_COLUMNS))
        line = self._line(runs, "growing", value, (lower, upper))
        bounds = self._rms(runs, "growing", lower), self._rms(runs, "growing", upper)
        yield self._curve("growing", runs, [line], bounds)

    def _curve(
        self,
        kind: CurveKind,
        runs: "_Runs",
        lines: Sequence[RmsLine],
        bounds: tuple[Sequence[float], Sequence[float]] | None = None,
    ) -> RmsCurve:
        return RmsCurve(
            group=self.group,
            kind=kind,
            times=runs.times,
            runs=runs.count,
            lines=dict(zip(COST_COLUMNS, lines, strict=False)),
            bounds=bounds,
            band=self.band,
        )

    def _powers(self, values: Floats) -> Floats:
        return np.array([[value**self.order for value in own] for own in values.tolist()])

    def _rms(self, runs: "_Runs", kind: CurveKind, costs: Floats) -> list[float]:
        means = runs.sums(costs, carried=kind != "step") / runs.count
        return [cost ** (1 / self.order) for cost in means.tolist()]

    def _line(
        self,
        runs: "_Runs",
        kind: CurveKind,
        costs: Floats,
        bounds: tuple[Floats, Floats] | None = None,
    ) -> RmsLine:
        """The line of the costs (R,) at rows, with the band of costs between bounds."""
        band = None
        if runs.count >= LEAST_RUNS[self.band] and not runs.many:
            ends = []
            for row, there in runs.cells(carried=kind != "step"):
                cells = [np.where(there, side[row], 0.0) for side in bounds or (costs,)]
                ends.append(self._band(cells[0], cells[-1]))
            low, high = np.concatenate(ends, axis=1).tolist()
            band = low, high
        return RmsLine(rms=self._rms(runs, kind, costs), band=band)

    def _band(self, lower: Floats, upper: Floats) -> Floats:
        """Ends of the band (2, K) of costs (N, K) of runs that are between these bounds."""
        root, runs = 1 / self.order, len(lower)
        if self.band == "interval":
            return np.stack(intervals(lower.T / runs, upper.T / runs, self.order))
        if self.band == "bootstrap":
            least = _resampled(lower)
            most = least if upper is lower else _resampled(upper)
            return np.stack([least[BAND_TAIL - 1], most[-BAND_TAIL]]) ** root
        low, high = lower**root, upper**root
        if self.band == "percentiles":
            levels = zip((low, high), BAND_LEVELS, strict=True)
            return np.stack([np.quantile(values, level, axis=0) for values, level in levels])
        least, most = (side.mean(axis=0) ** root for side in (lower, upper))
        least, most = least - low.std(axis=0, ddof=1), most + high.std(axis=0, ddof=1)
        return np.stack([np.maximum(least, 0.0), most])


def _resampled(costs: Floats) -> Floats:
    """Means of costs (N, K) of runs that are drawn with replacement, sorted."""
    runs, rng = len(costs), np.random.default_rng(BAND_SEED)
    draws = max(1, NUMBERS_AT_ONCE // runs)
    means = np.concatenate(
        [
            rng.multinomial(runs, [1 / runs] * runs, min(draws, BAND_RESAMPLES - done)) @ costs
            for done in range(0, BAND_RESAMPLES, draws)
        ]
    )
    means /= runs
    means.sort(axis=0)
    return means


class _Runs:
    """The R steps of N runs, by run and time, and the T times at which any run has one.

    Raises
    ------
    TimeError
        Times are of several kinds.
    """

    def __init__(self, steps: "pd.DataFrame", jobs: Ints) -> None:
        import pandas as pd

        codes, texts = pd.factorize(steps["t"].to_numpy())
        read = [_as_read(text) for text in texts]
        (place,) = places([read])
        run, place = np.searchsorted(jobs, steps["job"]), place[codes]
        order = np.lexsort((place, run))
        self.count, self.steps = len(jobs), steps.iloc[order]
        self.run, self.place = run[order], place[order]
        # Of equal times, as 1 and 1.0, that of the first run is shown.
        first = order[np.unique(self.place, return_index=True)[1]]
        self.times: list[Time] = [read[code] for code in codes[first].tolist()]
        begins = np.flatnonzero(np.diff(self.run, prepend=-1)).tolist()
        self.slices = [slice(*ends) for ends in pairwise([*begins, len(steps)])]
        self.divisor = np.maximum(self.columns(["steps"])[0], 1)

    def columns(self, names: Sequence[str]) -> Floats:
        """Columns (M, R) of the steps."""
        return np.ascontiguousarray(self.steps[list(names)].to_numpy(float).T)

    @cached_property
    def apart(self) -> bool:
        """Whether most times within several runs are steps of half of these or fewer."""
        size = len(self.times)
        inside = np.zeros(size + 1, np.int64)
        for own in self.slices:
            inside[self.place[own.start]] += 1
            inside[self.place[own.stop - 1] + 1] -= 1
        inside = np.cumsum(inside)[:-1]
        having = np.bincount(self.place, minlength=size)[inside > 1]
        few = 2 * having <= inside[inside > 1]
        return bool(2 * np.count_nonzero(few) > len(few))

    @property
    def many(self) -> bool:
        """Whether bands, which take runs by times instead of rows, would take too long."""
        return self.apart and len(self.times) > MOST_BANDED

    def so_far(self, costs: Floats) -> Floats:
        """Sums of the costs (M, R) up to each step, by the steps of the horizon up to it."""
        found = np.empty_like(costs)
        for own in self.slices:
            np.cumsum(costs[:, own], axis=1, out=found[:, own])
        found /= self.divisor
        return found

    def sums(self, costs: Floats, *, carried: bool) -> Floats:
        """Sums over the runs, from the first to the last, of costs (R,) at each time.

        Where they are `carried` a run has at each time that of its last step up to it.
        """
        size = len(self.times)
        found = np.zeros(size)
        for own in self.slices:
            place = self.place[own]
            if carried:
                found[place[0] :] += np.repeat(costs[own], np.diff(place, append=size))
            else:
                found[place] += costs[own]
        return found

    def cells(self, *, carried: bool) -> Iterator[tuple[Ints, NDArray[np.bool_]]]:
        """Of some times after the others the steps (N, K) of all runs, and whether there are such.

        Where they are `carried` a run has at each time its last step up to it.
        """
        size = len(self.times)
        keys = self.run * size + self.place
        width = max(1, NUMBERS_AT_ONCE // max(self.count, BAND_RESAMPLES))
        for low in range(0, size, width):
            first = size * np.arange(self.count)[:, None]
            wanted = first + np.arange(low, min(low + width, size))
            row = np.searchsorted(keys, wanted, side="right") - 1
            there = (row >= 0) & (keys[row] >= (first if carried else wanted))
            yield row, there


def _as_read(text: str) -> Time:
    """A time of which the text is stored."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text
