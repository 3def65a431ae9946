"""Root mean squares over runs, at each step: docs/reference/batch.md has the definitions.

Of single steps ``(mean of cost(k))^(1/p)``, and of the steps so far ``(mean of total(k) / n(k))^
(1/p)``, where ``total(k)`` is of an evaluation of the steps up to k alone and ``n(k)`` of them are
those at which something exists. The mean is over the runs that have the step k.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.batches.pairing import LABEL, in_words, labels_of, shown_labels, with_parameters
from tgospa_eval.batches.per_step import StoredSteps
from tgospa_eval.batches.resampling import LEAST_PAIRS, intervals
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.reports.curves import KIND_COLUMN, POINT_COLUMNS, RmsCurve

if TYPE_CHECKING:
    import pandas as pd


def rms_curves(
    rows: "pd.DataFrame", steps: StoredSteps | None, by: Sequence[str]
) -> list[RmsCurve]:
    """The curves of each group of jobs whose steps are stored.

    Parameters
    ----------
    rows : DataFrame
        Of a store.
    steps : StoredSteps, optional
        Of these rows.
    by : sequence of str
        Labels that make a group; parameters that differ make groups as well.
    """
    if steps is None:
        return []
    rows, differing = with_parameters(rows)
    valued = rows[rows["status"] != "failed"]
    there = [name for name in by if name in labels_of(rows)]
    keys = [*(LABEL + name for name in there), *differing]
    heads = [*shown_labels(there, {KIND_COLUMN, *POINT_COLUMNS, *differing}), *differing]
    grouped = valued.assign(_all="").groupby(keys or "_all", sort=True, dropna=False)
    codes = _codes(steps.times)
    number = np.full(int(rows.index.max()) + 1, -1)
    number[valued.index] = grouped.ngroup()
    order = np.argsort(number[steps.job], kind="stable")
    ends = np.cumsum(np.bincount(number[steps.job], minlength=grouped.ngroups))
    found: list[RmsCurve] = []
    for k, (_, group) in enumerate(grouped):
        at = order[ends[k - 1] if k else 0 : ends[k]]
        if len(at):
            first = group.iloc[0]
            labels = {head: in_words(first[key]) for head, key in zip(heads, keys, strict=True)}
            found += _curves_of(_Runs(steps, codes, at), labels, float(first["order"]))
    return found


def _codes(times: "np.ndarray[Any, Any]") -> tuple[Ints, "np.ndarray[Any, Any]"]:
    """Numbers of the times, and the time of each number."""
    import pandas as pd

    codes, texts = pd.factorize(times)
    return codes, np.asarray(texts, object)


class _Runs:
    """Steps of the N runs of a group as (N, K) arrays; NaN where a run has no such step."""

    def __init__(
        self, steps: StoredSteps, codes: tuple[Ints, "np.ndarray[Any, Any]"], at: Ints
    ) -> None:
        jobs, self.run = np.unique(steps.job[at], return_inverse=True)
        self.step = steps.step[at]
        self.shape = len(jobs), int(self.step.max()) + 1
        self.total = self._dense(steps.total[at])
        self.curve = [self._dense(values[at]) for values in steps.curve]
        numbers = self._dense(codes[0][at].astype(float))
        low, high = np.nanmin(numbers, axis=0), np.nanmax(numbers, axis=0)
        self.times = [
            str(codes[1][int(a)]) if a == b else None for a, b in zip(low, high, strict=True)
        ]

    def _dense(self, values: Floats) -> Floats:
        found = np.full(self.shape, np.nan)
        found[self.run, self.step] = values
        return found


def _curves_of(runs: _Runs, group: Mapping[str, str], order: float) -> Iterator[RmsCurve]:
    """Both curves of a group, or the first alone."""
    yield RmsCurve(
        group=group,
        kind="step",
        times=runs.times,
        runs=np.count_nonzero(~np.isnan(runs.total), axis=0).tolist(),
        rms=_root(np.nanmean(runs.total, axis=0), order),
        bounds=None,
        band=_band(runs.total, runs.total, order),
    )
    value, lower, upper = (values**order for values in runs.curve)
    having = np.count_nonzero(~np.isnan(value), axis=0)
    size = int(np.count_nonzero(having))  # of the longest that has one
    if not size:
        return
    value, lower, upper = (costs[:, :size] for costs in (value, lower, upper))
    yield RmsCurve(
        group=group,
        kind="growing",
        times=runs.times[:size],
        runs=having[:size].tolist(),
        rms=_root(np.nanmean(value, axis=0), order),
        bounds=(
            _root(np.nanmean(lower, axis=0), order),
            _root(np.nanmean(upper, axis=0), order),
        ),
        band=_band(lower, upper, order),
    )


def _root(costs: Floats, order: float) -> list[float]:
    found: list[float] = (costs ** (1 / order)).tolist()
    return found


def _band(
    lower: Floats, upper: Floats, order: float
) -> tuple[list[float | None], list[float | None]]:
    """Intervals over the runs that have a step; steps that the same runs have go together."""
    size = lower.shape[1]
    ends: list[list[float | None]] = [[None] * size, [None] * size]
    patterns, which = np.unique(~np.isnan(lower), axis=1, return_inverse=True)
    for k, having in enumerate(patterns.T):
        runs = int(having.sum())
        if runs < LEAST_PAIRS:
            continue
        at = np.flatnonzero(which.ravel() == k)
        costs = [side[np.ix_(having, at)].T / runs for side in (lower, upper)]
        for end, values in zip(ends, intervals(costs[0], costs[1], order), strict=True):
            for place, value in zip(at, values.tolist(), strict=True):
                end[place] = value
    return ends[0], ends[1]
