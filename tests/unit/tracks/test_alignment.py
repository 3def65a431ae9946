"""Stamps that become one step, steps that count, and the warnings about clocks."""

import json
from typing import Any

import numpy as np
import pytest
from answer import Run, Write
from examples import seeds
from hypothesis import given
from hypothesis import strategies as st
from runs import warnings_of
from strategies import scene

from tgospa_eval import ConfigError, Trajectories, evaluate
from tgospa_eval.api import options
from tgospa_eval.distances import DISTANCES
from tgospa_eval.evaluation.diagnosis import alignment_notices
from tgospa_eval.evaluation.diagnosis.costs import StepRows, step_costs
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.tracks.alignment import GRIDS, INTERPOLATED, TimeMatching, align, nearest

EUCLIDEAN = DISTANCES["euclidean"]


def side(times: list[Any], clock: str = "number") -> Trajectories:
    """One object, there at all times."""
    rows = len(times)
    return Trajectories(
        step=np.arange(rows), track=np.zeros(rows, int), state=np.zeros((rows, 1)),
        ids=np.array(["a"][:rows], object), times=np.array(times), columns=("x",), clock=clock,
    )  # fmt: skip


STAMPS = st.lists(st.integers(-60, 60), min_size=1, max_size=12, unique=True).map(sorted)


@given(STAMPS, STAMPS, st.integers(0, 40), st.booleans())
def test_joining_is_one_to_one_and_in_order(
    first: list[int], second: list[int], tolerance: int, decimal: bool
) -> None:
    """Against the definition: each the nearest of the other, ties to the earlier."""
    scale = 0.25 if decimal else 1  # exact in doubles
    a, b = (np.array(values) * scale for values in (first, second))
    mine, other, _ = nearest(a, b)
    expected = []
    for i, x in enumerate(a):
        j = int(np.argmin(np.abs(b - x)))  # the first of the nearest
        if int(np.argmin(np.abs(a - b[j]))) == i:
            expected.append((i, j))
    assert list(zip(mine.tolist(), other.tolist(), strict=True)) == expected
    assert (np.diff(other) > 0).all()
    done = align(side(a.tolist()), side(b.tolist()), TimeMatching(tolerance=tolerance * scale))
    close = [(i, j) for i, j in expected if abs(a[i] - b[j]) <= tolerance * scale]
    assert done.common == len(close)
    assert done.union == len(a) + len(b) - len(close)
    times = done.truth.times
    assert set(a) <= set(times)  # a joined step bears the stamp of the truth
    for i, j in close:
        assert times[done.truth.step[i]] == times[done.estimate.step[j]] == a[i]


def test_stamps_are_exact() -> None:
    low, high = -(2**63), 2**63 - 1
    base = 1_700_000_000_123_456_789
    far = align(side([low, base]), side([base + 1, high]), TimeMatching(tolerance=1))
    assert (far.common, far.joined, far.union) == (1, 1, 3)
    assert align(side([base]), side([base + 1])).common == 0
    assert align(side([1.0]), side([1.05]), TimeMatching(tolerance=0.05)).common == 1  # as written
    assert align(side([1.0]), side([1.0500001]), TimeMatching(tolerance=0.05)).common == 0
    iso = side([0], "zoned"), side([290_000_000], "zoned")
    assert align(*iso, TimeMatching(tolerance=0.29)).common == 1
    assert align(*iso, TimeMatching(tolerance=0.289999999)).common == 0
    assert align(*iso, TimeMatching(tolerance=1e300)).common == 1


@pytest.mark.parametrize(
    ("grid", "missed", "false", "steps"),
    [("union", 1, 2, 5), ("truth", 1, 0, 3), ("estimate", 0, 2, 4), ("common", 0, 0, 2)],
)
def test_grid(grid: str, missed: int, false: int, steps: int) -> None:
    """Truth at 1, 2, 3 and estimate at 2, 3, 4, 5, all at 0: what is alone is missed or false."""
    result = evaluate(side([1, 2, 3]), side([2, 3, 4, 5]), grid=grid)
    assert result.counts["missed"] == missed
    assert result.counts["false"] == false
    assert result.sizes["steps"] == steps
    assert result.parameters["grid"] == grid
    left_out = {name: result.input[name]["left_out"] for name in ("truth", "estimate")}
    assert left_out == {
        "truth": {"grid": 1 - missed} if not missed else {},
        "estimate": {"grid": 2 - false} if not false else {},
    }


def test_nothing_counts() -> None:
    """Not 0, the value of a perfect tracker."""
    with pytest.raises(ConfigError, match='grid="common": none of 2 steps is left'):
        evaluate(side([1]), side([2]), grid="common")


@pytest.mark.parametrize(
    "options", [{"time_tolerance": -1}, {"time_tolerance": float("nan")}, {"grid": "both"}]
)
def test_bad_values(options: dict) -> None:
    with pytest.raises(ConfigError, match=r"must be"):
        evaluate(side([1]), side([1]), **options)


def test_grids_are_spelled_alike() -> None:
    assert options.GRIDS == GRIDS
    assert options.INTERPOLATED == INTERPOLATED


# --- warnings -------------------------------------------------------------------------------------


def shift_of(truth: np.ndarray, estimate: np.ndarray, cutoff: float = 3.0) -> str | None:
    """What the warning says of the clock."""
    sides = Trajectories.from_array(truth), Trajectories.from_array(estimate)
    parameters = Parameters(cutoff=cutoff, order=2, switch_penalty=0)
    found = warnings_of(*sides, parameters)
    return next((notice.text for notice in found if notice.code == "clock-shift"), None)


@pytest.mark.parametrize("seed", seeds(10, 30))
def test_no_warning_about_good_data(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, estimate = scene(
        seed, rng.integers(1, 9), rng.integers(1, 9), rng.integers(3, 60),
        side=float(rng.choice([5, 20, 100])), noise=float(rng.choice([0.01, 0.5])),
    )  # fmt: skip
    still = np.broadcast_to(truth[:1], truth.shape)
    for cutoff in (1.0, 3.0, 10.0):
        assert shift_of(truth, estimate, cutoff) is None
        assert shift_of(still, still + rng.normal(0, 0.3, still.shape), cutoff) is None
    late = truth.copy()
    late[: len(late) // 3] = np.nan  # confirmed late: a third of the steps are missed, and no more
    assert shift_of(still, np.where(np.isnan(late), np.nan, still)) is None


def test_a_shift_is_found() -> None:
    """Velocity 1, noise 0.1: the error of a step is 1, that of the shifted one 0.01 in squares."""
    rng = np.random.default_rng(1)
    truth = np.arange(40.0)[:, None, None] + 100 * np.arange(3)[:, None] + np.zeros(2)
    estimate = truth + rng.normal(0, 0.1, truth.shape)
    late, early = estimate[:-1], estimate[1:]
    assert "be 1 ahead (+/- 0.0" in (shift_of(truth, np.concatenate((late[:1], late))) or "")
    assert "be 1 behind" in (shift_of(truth, np.concatenate((early, early[-1:]))) or "")
    assert shift_of(truth, estimate) is None


def test_settling_by_assignment() -> None:
    """A dense scene, where greedy pairs do not decide."""
    truth, estimate = scene(4, 9, 9, 60, side=8, noise=0.3)
    late = np.roll(estimate, 1, axis=0)
    parameters = Parameters(cutoff=2, order=1, switch_penalty=0)
    aligned = align(Trajectories.from_array(truth), Trajectories.from_array(late))
    rows = (StepRows.of(side) for side in (aligned.truth, aligned.estimate))
    costs = step_costs(*rows, parameters, EUCLIDEAN)
    before = costs.lower.copy(), costs.upper.copy()
    costs.settle()
    assert (before[0] <= costs.lower + 1e-12).all()
    assert (costs.upper <= before[1] + 1e-12).all()
    exact = evaluate(truth, late, 2, 1, 0).per_step["total"].to_numpy() / 2
    assert costs.lower == pytest.approx(exact)


def test_near_misses_name_the_tolerance_that_joins_them(invoke: Run, write: Write) -> None:
    truth = "id,t,x\n" + "".join(f"a,{k / 10},0\n" for k in range(20))
    estimate = "id,t,x\n" + "".join(f"1,{k / 10 + 0.00033},0\n" for k in range(20))
    files = write("t.csv", truth), write("e.csv", estimate)
    err = invoke(*files).err
    assert "0 of 40 steps are in both files" in err
    assert "20 pairs of timestamps are nearly the same, at most 0.00033 apart" in err
    done = invoke(*files, "--time-tolerance", "0.00033", "--format", "json")
    document = json.loads(done.out)
    assert document["total"] == 0
    assert document["parameters"]["time_tolerance"] == 0.00033
    assert [step["t"] for step in document["per_step"]][:3] == [0.0, 0.1, 0.2]
    assert "20 of 20 steps are in both files\n20 pairs of timestamps were joined" in done.err
    assert "warning" not in done.err


def test_near_misses_of_iso_times(invoke: Run, write: Write) -> None:
    stamps = [f"2024-01-01T00:00:0{k}" for k in range(5)]
    truth = write("t.csv", "id,t,x\n" + "".join(f"a,{t},0\n" for t in stamps))
    estimate = write("e.csv", "id,t,x\n" + "".join(f"a,{t}.0015,0\n" for t in stamps))
    assert "--time-tolerance 0.0015 makes" in invoke(truth, estimate).err
    done = invoke(truth, estimate, "--time-tolerance", "0.0015", "--format", "csv")
    assert done.out.splitlines()[1].startswith("2024-01-01T00:00:00,")


def test_what_the_grid_leaves_out_is_said(invoke: Run, quickstart: tuple[str, str]) -> None:
    done = invoke(*quickstart, "--grid", "common")
    assert "53 of 56 steps are in both files" in done.err
    assert (
        "3 steps left out (--grid common), with 4 rows of the truth and 0 of the estimate"
        in done.err
    )
    assert "53 steps" in done.out


def test_good_files_have_no_warnings(invoke: Run, quickstart: tuple[str, str]) -> None:
    assert "warning" not in invoke(*quickstart).err


def test_notices_on_empty_sides() -> None:
    empty = side([])
    parameters = Parameters(cutoff=1, order=2, switch_penalty=0)
    for sides in ((empty, empty), (side([1, 2]), empty), (empty, side([1]))):
        aligned = align(*sides)
        assert alignment_notices(aligned, TimeMatching())[0].startswith("0 of ")
        codes = [notice.code for notice in warnings_of(*sides, parameters)]
        assert codes[: sum(not len(one.step) for one in sides)] == ["empty-side"] * len(
            codes[: 2 if sides[0] is sides[1] else 1]
        )
