"""Root mean squares over runs at each step, and their bands."""

import csv
import io
import math

import numpy as np
import pandas as pd
import pytest

from tgospa_eval.batches.curves import rms_curves
from tgospa_eval.batches.per_step import StoredSteps
from tgospa_eval.batches.resampling import intervals
from tgospa_eval.reports.curves import curves_csv, curves_json


def rows(trackers: str, order: float = 2.0) -> pd.DataFrame:
    """A job for each letter, of the tracker of that name."""
    same = {"status": "done", "distance": "euclidean", "cutoff": 5.0, "switch_penalty": 1.0}
    return pd.DataFrame([{"label.tracker": t, "order": order} | same for t in trackers])


def steps(*runs: tuple[list[float], list[float] | None]) -> StoredSteps:
    """Of each run the cost of its steps, and the curve with bounds 10 % apart."""
    lengths = [len(cost) for cost, _ in runs]
    number = np.concatenate([np.arange(size) for size in lengths])
    curve = np.concatenate(
        [np.array(curve or [np.nan] * len(cost)) for cost, curve in runs], dtype=float
    )
    return StoredSteps(
        job=np.repeat(np.arange(len(runs)), lengths),
        step=number,
        occupied=number + 1,
        times=np.array([str(10 * k) for k in number], object),
        total=np.concatenate([np.array(cost, float) for cost, _ in runs]),
        curve=np.array([curve, 0.9 * curve, curve]),
    )


def test_means_of_costs_and_never_of_roots() -> None:
    found = rms_curves(rows("aab"), steps(([1, 4], [1, 2]), ([7], [3]), ([2], None)), ["tracker"])
    assert [(curve.name, curve.kind) for curve in found] == [
        ("a", "step"),
        ("a", "growing"),
        ("b", "step"),
    ]
    single, growing, other = found
    assert single.runs == [2, 1]  # the horizons differ
    assert single.times == ["0", "10"]
    assert single.rms == pytest.approx([2.0, 2.0])
    assert single.bounds is None
    assert growing.rms == pytest.approx([5**0.5, 2.0])
    assert growing.bounds is not None
    assert growing.bounds[0] == pytest.approx([0.9 * 5**0.5, 1.8])
    assert growing.bounds[1] == pytest.approx(growing.rms)
    assert other.rms == pytest.approx([2**0.5])
    # With fewer than six runs nothing is said of others.
    assert single.band == growing.band == ([None, None], [None, None])
    assert rms_curves(rows("a"), None, ["tracker"]) == []


def test_the_order_is_that_of_the_jobs_and_other_parameters_are_other_groups() -> None:
    table = pd.concat([rows("a", 1.0), rows("a", 3.0)], ignore_index=True)
    found = rms_curves(table, steps(([2, 4], None), ([8, 1], None)), [])
    assert [curve.group for curve in found] == [{"order": "1"}, {"order": "3"}]
    assert found[0].rms == pytest.approx([2.0, 4.0])
    assert found[1].rms == pytest.approx([2.0, 1.0])


def test_times_that_differ_between_runs_are_left_blank() -> None:
    same = steps(([1, 2], None), ([3, 4], None))
    same.times[3] = "11"
    assert rms_curves(rows("aa"), same, [])[0].times == ["0", None]


def test_bands_are_the_intervals_of_tables() -> None:
    costs = np.random.default_rng(3).gamma(2.0, 3.0, size=(40, 3))
    costs[30:, 2] = np.nan
    runs = [([value for value in run if not math.isnan(value)], None) for run in costs.tolist()]
    (curve,) = rms_curves(rows("a" * 40), steps(*runs), [])
    assert curve.runs == [40, 40, 30]
    for k in range(3):
        there = costs[~np.isnan(costs[:, k]), k][None]
        ends = [float(end[0]) / there.size**0.5 for end in intervals(there, there, 2.0)]
        assert [curve.band[0][k], curve.band[1][k]] == pytest.approx(ends)
        assert ends[0] < curve.rms[k] < ends[1]
    assert rms_curves(rows("a" * 40), steps(*runs), []) == [curve]


def test_as_csv_and_json() -> None:
    found = rms_curves(rows("aa"), steps(([1, 4], [1, 2]), ([7], [3])), ["tracker"])
    table = list(csv.DictReader(io.StringIO(curves_csv(found))))
    assert [
        (row["tracker"], row["curve"], row["step"], row["t"], row["runs"]) for row in table
    ] == [
        ("a", "step", "1", "0", "2"),
        ("a", "step", "2", "10", "1"),
        ("a", "growing", "1", "0", "2"),
        ("a", "growing", "2", "10", "1"),
    ]
    assert float(table[0]["rms"]) == 2.0
    assert table[0]["band_low"] == ""
    document = curves_json(found)
    assert [(item["by"], item["curve"]) for item in document] == [
        ({"tracker": "a"}, "step"),
        ({"tracker": "a"}, "growing"),
    ]
    assert document[1]["points"][1]["rms"] == pytest.approx(2.0)
