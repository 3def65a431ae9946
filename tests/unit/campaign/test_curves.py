"""Root mean squares over runs at each time, and their bands."""

from typing import get_args

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tgospa_eval.api.options import BAND_KINDS
from tgospa_eval.campaign.statistics import intervals
from tgospa_eval.campaign.store import COST_COLUMNS, CURVE_COLUMNS
from tgospa_eval.campaign.sums import rms_curves
from tgospa_eval.show.batch import BANDS, BandKind, RmsCurve

Steps = dict[str, float]
"""Cost by time."""


def rows(trackers: str, order: float = 2.0, steps: int = 1) -> pd.DataFrame:
    """A job for each letter, of the tracker of that name."""
    same = {"status": "done", "distance": "euclidean", "cutoff": 5.0, "switch_penalty": 1.0}
    same |= {"order": order, "sizes.steps": steps}
    return pd.DataFrame([{"label.tracker": t} | same for t in trackers])


def stored(*runs: Steps, horizon: int = 0, traced: bool = False) -> pd.DataFrame:
    """Steps of runs: a quarter of the cost is localisation, the rest false.

    Of each the first `horizon` are no stamps of the truth. The value of the steps up to each is the
    number of the step, its bounds 10 % apart.
    """
    number = np.concatenate([np.arange(len(run)) for run in runs])
    total = np.array([cost for run in runs for cost in run.values()], float)
    none = np.zeros(len(total))
    value = number + 1.0 if traced else np.full(len(total), np.nan)
    table = {
        "job": np.repeat(np.arange(len(runs)), [len(run) for run in runs]),
        "steps": np.maximum(number + 1 - horizon, 0),
        "t": np.array([t for run in runs for t in run], object),
    }
    costs = total, total / 4, none, 3 * total / 4, none
    bounds = value, 0.9 * value, value
    table |= zip((*COST_COLUMNS, *CURVE_COLUMNS), (*costs, *bounds), strict=True)
    return pd.DataFrame(table)


def curves(steps: pd.DataFrame, count: int, **settings: BandKind) -> dict[str, RmsCurve]:
    """Those of one group by kind."""
    found, _ = rms_curves(rows("a" * count), steps, [], **settings)
    return {curve.kind: curve for curve in found}


def test_groups_are_apart_and_so_are_parameters() -> None:
    table = pd.concat([rows("a", 1.0), rows("ab", 3.0)], ignore_index=True)
    found, notes = rms_curves(table, stored({"1": 2}, {"1": 8}, {"1": 27}), ["tracker"])
    assert notes == []
    assert [(curve.group, curve.rms["total"]) for curve in found if curve.kind == "step"] == [
        ({"tracker": "a", "order": "1"}, [2.0]),
        ({"tracker": "a", "order": "3"}, [2.0]),
        ({"tracker": "b", "order": "3"}, [3.0]),
    ]
    assert rms_curves(table, None, ["tracker"]) == ([], [])


@pytest.mark.parametrize(
    ("runs", "times"),
    [
        (({"9": 1, "10": 1}, {"9.0": 3, "9.5": 1, "1e1": 3}), [9, 9.5, 10]),
        (({"-1": 1, "9007199254740993": 1}, {"-1.0": 3, "9007199254740992": 9}), None),
        (
            (
                {"2026-01-01T10:00:00Z": 1, "2026-01-01T12:00:00Z": 1},
                {"2026-01-01T12:00:00+02:00": 3, "2026-01-01T12:30:00+02:00": 1}
                | {"2026-01-01T13:00:00+01:00": 3},
            ),
            ["2026-01-01T10:00:00Z", "2026-01-01T12:30:00+02:00", "2026-01-01T12:00:00Z"],
        ),
    ],
)
def test_times_are_compared_as_times(runs: tuple[Steps, ...], times: list | None) -> None:
    found = curves(stored(*runs), 2)["step"]
    assert found.times == (times or [-1, 9007199254740992, 9007199254740993])
    costs = [2.0, 0.5, 2.0] if times else [2.0, 4.5, 0.5]
    assert found.rms["total"] == pytest.approx(np.sqrt(costs))


def test_times_of_several_kinds_have_no_curve() -> None:
    for text in ("2026-01-01T10:00:00", "2026-01-01T10:00:00Z"):
        steps = stored({"2026-01-01T10:00:00": 1}, {text if text[-1] == "Z" else "3": 1}, {"1": 2})
        found, notes = rms_curves(rows("aab"), steps, ["tracker"])
        assert {curve.name for curve in found} == {"b"}
        (note,) = notes
        assert note.startswith("curves of a: not available: mixed kinds of time: ")


def test_runs_without_steps() -> None:
    """One of nothing has nothing at all times; one whose steps are not stored does not count."""
    table = rows("aaa")
    table.loc[1, "sizes.steps"] = 0
    steps = stored({"1": 4})
    found, notes = rms_curves(table, steps, [])
    assert (found[0].runs, found[0].rms["total"]) == ([2], pytest.approx([2**0.5]))
    (note,) = notes
    assert "all jobs: 1 of 3 runs have no stored steps, and do not count" in note
    steps = stored({"1": 4}, {"1": 4}, traced=True)
    steps.loc[1, list(CURVE_COLUMNS)] = np.nan
    found, notes = rms_curves(rows("aa"), steps, [])
    assert [(curve.kind, curve.runs) for curve in found] == [
        ("step", [2]), ("cumulative", [2]), ("growing", [1])
    ]  # fmt: skip
    assert "1 of 2 runs have no stored values of the steps up to each step" in notes[0]


def test_runs_with_stamps_of_their_own_are_told() -> None:
    def told(*runs: list[float]) -> list[str]:
        return rms_curves(
            rows("a" * len(runs)), stored(*({str(t): 1 for t in r} for r in runs)), []
        )[1]

    (note,) = told([0, 1, 2, 3], [0.1, 1.1, 2.1, 3.1])
    assert "half of the runs or fewer have a step" in note
    assert "resample" in note
    assert told([0, 1, 2, 3], [2, 3, 4, 5], [1, 2, 4], [4, 5]) == []
    (note,) = told([0, 1, 2, 3], [2, 3, 4, 5], [1, 2, 4], [9])
    assert "at the last time only 1 of 4 runs have not ended: the others count with cost 0" in note
    (note,) = told([0, 1], [5, 6])
    assert "t is the time since the start of each run" in note


def test_recordings_with_absolute_times() -> None:
    """No run is absent with cost 0, whichever clock is shown."""
    steps = stored({"5": 4, "6": 4}, {"10": 4, "11": 4, "12": 4}, {"20": 4, "21": 4})
    times = {None: [0, 1, 2], "start": [0, 1, 2], "stamps": [5, 6, 10, 11, 12, 20, 21]}
    counts = {None: [3, 3, 1], "start": [3, 3, 1], "stamps": [1] * 7}
    for over in times:
        found, notes = rms_curves(rows("aaa"), steps, [], "percentiles", over)
        for curve in found:
            assert (list(curve.times), list(curve.runs)) == (times[over], counts[over])
        assert found[0].rms["total"] == pytest.approx([2] * len(times[over]))
        low, high = found[0].bands["total"]
        there = [count > 1 for count in counts[over]]
        assert (
            [value is not None for value in low] == [value is not None for value in high] == there
        )
        assert len(notes) == (over is None)


def test_bands() -> None:
    costs = np.random.default_rng(3).gamma(2.0, 3.0, size=(40, 3))
    costs[30:, 2] = 0.0
    names = "123"
    steps = stored(
        *(dict(zip(names[: 2 + (k < 30)], run, strict=False)) for k, run in enumerate(costs))
    )
    found = {kind: curves(steps, 40, band=kind)["step"].bands for kind in get_args(BandKind)}
    assert found["interval"] == curves(steps, 40)["step"].bands
    for part, share in (("total", 1.0), ("localisation", 0.25)):
        values = np.sqrt(share * costs)
        bands = {kind: np.array(around[part]) for kind, around in found.items()}
        other = stats.bootstrap(
            (share * costs,), lambda x, axis: np.mean(x, axis=axis) ** 0.5, n_resamples=20_000,
            method="percentile", rng=np.random.default_rng(1),
        ).confidence_interval  # fmt: skip
        both = intervals(share * costs.T / 40, share * costs.T / 40, 2.0)
        assert bands["interval"] == pytest.approx(np.stack(both))
        # Of a thousand draws a quantile is known to some percent of the width.
        few = 0.15 * (other.high - other.low).max()
        assert bands["bootstrap"] == pytest.approx(np.stack([other.low, other.high]), abs=few)
        assert bands["percentiles"] == pytest.approx(np.percentile(values, [2.5, 97.5], axis=0))
        rms, spread = np.sqrt((share * costs).mean(axis=0)), values.std(axis=0, ddof=1)
        assert bands["deviation"] == pytest.approx(
            np.stack([np.maximum(rms - spread, 0), rms + spread])
        )
    one = curves(stored({"1": 4}), 1, band="deviation")["step"]
    assert one.bands == {}


def test_bands_of_values_with_bounds_hold_both() -> None:
    steps = stored(*({"1": 0, "2": 0} for _ in range(6)), traced=True)
    for kind in get_args(BandKind):
        low, high = curves(steps, 6, band=kind)["growing"].bands["total"]
        if kind == "interval":
            # It contains that of any values between.
            assert np.all(np.array(low) < [0.9, 1.8])
            assert np.all(np.array(high) > [1, 2])
        else:
            assert low == pytest.approx([0.9, 1.8])
            assert high == pytest.approx([1, 2])


def test_the_command_offers_all_bands() -> None:
    assert tuple(BANDS) == get_args(BandKind) == BAND_KINDS
