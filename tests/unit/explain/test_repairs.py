"""Repairs of an estimate: what each is known to save, by hand and by evaluating it again."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from any_options import AnyOptions
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import scene

from tgospa_eval import ConfigError, Explanation, Sinkhorn, Trajectories, evaluate
from tgospa_eval.formats.write import csv_text
from tgospa_eval.results.explanation import KINDS, Repair

NAN = math.nan
C, GAMMA = 10.0, 3.0
"""p is 2: a missed or a false state costs 50, a switch 9."""


def explained(truth: Any, estimate: Any, top: int = 20, **settings: Any) -> Explanation:
    return evaluate(truth, estimate, C, 2, GAMMA, **settings).explain(top)


def path(steps: int, x: float, speed: float = 1.0) -> np.ndarray:
    """A straight way, (T, 2)."""
    return np.stack((x + speed * np.arange(steps), np.full(steps, x)), axis=1)


def tracks(*columns: np.ndarray) -> np.ndarray:
    return np.stack(columns, axis=1)


def only(states: np.ndarray, begin: int, end: int) -> np.ndarray:
    """The steps from begin to before end."""
    kept = np.full_like(states, NAN)
    kept[begin:end] = states[begin:end]
    return kept


def of_kind(found: Explanation, kind: str) -> Repair:
    return next(repair for repair in found.repairs if repair.kind == kind)


def check(repair: Repair, saves: float, total: float) -> None:
    assert repair.saving_lower <= saves * (1 + 1e-12)
    assert repair.saving_upper >= saves * (1 - 1e-12)
    assert repair.saving_upper - repair.saving_lower <= 1e-9 * (saves + total)
    assert repair.total == pytest.approx(total, rel=1e-12, abs=1e-12)


A, B = path(12, 0.0), path(12, 500.0)


def test_merge_saves_the_switch() -> None:
    found = explained(tracks(A), tracks(only(A, 0, 5), only(A, 5, 12)))
    (repair,) = found.repairs
    assert (repair.kind, repair.text) == ("merge", "join estimate 1, t = 5 to 11, to estimate 0")
    assert (repair.estimates, repair.begin, repair.end) == (("0", "1"), 5, 11)
    check(repair, GAMMA**2, 0.0)


def test_merge_of_tracks_that_take_turns_saves_every_switch() -> None:
    even = np.where((np.arange(12) // 3 % 2 == 0)[:, None], A, NAN)
    odd = np.where((np.arange(12) // 3 % 2 == 1)[:, None], A, NAN)
    check(of_kind(explained(tracks(A), tracks(even, odd)), "merge"), 3 * GAMMA**2, 0.0)


def test_a_track_that_goes_on_as_another_one_is_joined_from_there() -> None:
    """Estimate 1 follows B first and A from 6 on, where estimate 0 ends."""
    estimate = tracks(only(A, 0, 6), np.concatenate((B[:6], A[6:])))
    repair = explained(tracks(A, only(B, 0, 6)), estimate).repairs[0]
    assert repair.text == "join estimate 1 from t = 6 on to estimate 0"
    check(repair, 1.5 * GAMMA**2, 0.0)


def test_both_ends_are_extended_at_constant_velocity() -> None:
    found = explained(tracks(A), tracks(only(A, 2, 9)))
    late, early = found.repairs
    assert (late.text, early.text) == (
        "extend estimate 0 to t = 11",
        "extend estimate 0 back to t = 0",
    )
    assert early.rows["x"] == [0.0, 1.0]
    assert late.rows["x"] == [9.0, 10.0, 11.0]
    check(late, 3 * 50, 2 * 50)
    check(early, 2 * 50, 3 * 50)


@pytest.mark.parametrize("periodic", [False, True])
def test_a_constant_offset_is_taken_off(periodic: bool) -> None:
    angle = np.array([350.0, 355.0, 0.0, 5.0, 10.0])
    truth = np.stack((np.arange(5.0), angle), axis=1)
    estimate = truth + np.array([1.0, -2.0])
    if periodic:
        estimate[:, 1] %= 360.0
    from tgospa_eval.distances import Norm

    norm = Norm(name="euclidean", power=2.0, period=(math.inf, 360.0))
    found = explained(tracks(truth), tracks(estimate), distance=norm)
    repair = of_kind(found, "offset")
    assert repair.offset == pytest.approx({"x": 1.0, "y": -2.0})
    check(repair, 5 * 5.0, 0.0)


def test_what_is_right_needs_no_repair() -> None:
    for truth, estimate in ((A, A), (only(A, 0, 0), only(A, 0, 0)), (A, only(A, 0, 0))):
        found = explained(tracks(truth), tracks(estimate))
        assert found.repairs == ()
        with pytest.raises(ConfigError, match="repair 1: there is none"):
            found.repaired()


def sound(repair: Repair, before: Any, after: Any) -> None:
    """Whether what is promised is what an evaluation of the repaired estimate finds."""
    assert after.total == pytest.approx(repair.total, rel=1e-9, abs=1e-9)
    assert repair.lower_bound <= after.upper_bound
    assert after.lower_bound <= repair.upper_bound
    slack = 1e-9 * before.total
    saved = before.total - after.total
    assert repair.saving_lower - slack <= saved <= repair.saving_upper + slack


@pytest.mark.parametrize("seed", range(4))
def test_every_repair_saves_what_a_full_evaluation_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    m, n, steps = (int(rng.integers(*span)) for span in ((2, 6), (2, 7), (8, 24)))
    truth, estimate = scene(seed, m, n, steps, side=(15, 40, 150)[seed % 3])
    estimate += rng.choice([0.0, 3.0])
    settings = {
        "cutoff": float(rng.choice([3, 8])),
        "order": float(rng.choice([1, 2])),
        "switch_penalty": float(rng.choice([0, 2, 5])),
        "rho": float(rng.choice([0.5, 0.3])),
        "step_weights": rng.choice([0.0, 1.0, 2.0], steps) if seed % 2 else None,
    }
    before = evaluate(truth, estimate, **settings)
    found = before.explain(8)
    assert found.repairs
    for rank, repair in enumerate(found.repairs, 1):
        assert repair.kind in KINDS
        repaired = found.repaired(rank)
        sound(repair, before, evaluate(Trajectories.from_array(truth), repaired, **settings))


@pytest.mark.parametrize("grid", ["truth", "estimate", "common"])
def test_steps_that_a_repair_takes_from_the_grid(grid: str) -> None:
    """At t = 11 only a false track has a state; without it the step is no step of the estimate."""
    estimate = Trajectories.from_array(tracks(only(A, 0, 9), only(B, 9, 10))[:10])
    estimate = replace(estimate, times=[*(np.arange(9) + 0.001), 11.001])
    settings: dict[str, Any] = {"grid": grid, "time_tolerance": 0.01}
    truth = Trajectories.from_array(tracks(A))
    before = evaluate(truth, estimate, C, 2, GAMMA, **settings)
    found = before.explain()
    for rank, repair in enumerate(found.repairs, 1):
        after = evaluate(truth, found.repaired(rank), C, 2, GAMMA, **settings)
        sound(repair, before, after)
    check(
        of_kind(found, "drop"),
        *{"truth": (50, 150), "estimate": (100, 0), "common": (100, 0)}[grid],
    )


@pytest.mark.parametrize("grid", ["estimate", "common"])
def test_a_repair_that_leaves_no_step_is_none(grid: str) -> None:
    """The only track is false: without it no step counts, and there is nothing to evaluate."""
    truth = pd.DataFrame({"id": "a", "t": [1.0, 2.0, 3.0], "x": 0.0})
    false = pd.DataFrame({"id": "b", "t": [2.0, 3.0], "x": 500.0})
    found = evaluate(truth, false, C, 2, GAMMA, grid=grid).explain()
    assert all(repair.kind != "drop" for repair in found.repairs)
    other = pd.DataFrame({"id": ["b", "c"], "t": [2.0, 3.0], "x": [500.0, 0.0]})
    weights = {1: 0, 2: 1, 3: 0}  # of the grid, b has the only step that counts
    found = evaluate(truth, other, C, 2, GAMMA, grid=grid, step_weights=weights).explain()
    assert all("b" not in repair.tracks for repair in found.repairs if repair.kind == "drop")


@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_promised_is_what_evaluate_gives(seed: int) -> None:
    """Of the repaired file, with the same options, whatever they are."""
    scene = AnyOptions(seed)
    before = scene.evaluate()
    assume(before is not None and "resample" not in before.parameters)
    explanation = before.explain(6)
    for rank, repair in enumerate(explanation.repairs, 1):
        text = csv_text(explanation.repaired(rank))
        sound(repair, before, scene.evaluate(scene.read(text)))


def test_states_that_fill_a_gap_in_a_region_are_excused() -> None:
    """Of three that are added one follows a truth, and two are false but for the region."""
    truth = pd.DataFrame(
        {"id": ["a", "a", "b", "b"], "t": [6, 7, 4, 5], "x": [2.8, 2.2, 1.5, 0.6],
         "y": [3.6, 3.1, 2.8, 2.7]}
    )  # fmt: skip
    estimate = pd.DataFrame({"id": "c", "t": [3, 7], "x": [1.8, 2.6], "y": [2.7, 2.9]})
    regions = pd.DataFrame({"left": [0.0], "top": [0.0], "width": [3.0], "height": [3.0]})
    settings: dict[str, Any] = {"cutoff": 2, "switch_penalty": 1, "ignore_regions": regions}
    before = evaluate(truth, estimate, **settings)
    found = before.explain()
    repair = of_kind(found, "fill")
    assert (before.total, repair.total) == (pytest.approx(6.2), pytest.approx(4.175))
    sound(repair, before, evaluate(truth, found.repaired(), **settings))


def test_steps_are_those_of_the_repaired_estimate() -> None:
    """With the truth at its stamps a false track takes its own with it."""
    truth = pd.DataFrame({"id": "a", "t": [0, 4, 8], "x": 0.0})
    estimate = pd.DataFrame({"id": list("bbc"), "t": [1, 3, 4], "x": [50.0, 50.0, 0.0]})
    settings = {"interpolate": "truth", "max_gap": 20, "outage": "none"}
    found = explained(truth, estimate, **settings)
    check(of_kind(found, "drop"), 4 * 50, 0.0)


def test_a_repaired_estimate_is_in_its_own_units() -> None:
    truth = pd.DataFrame({"id": "a", "t": np.arange(12) / 10, "x": 0.1 * np.arange(12.0)})
    late = {"t": 100 * np.arange(12) + 250, "x": np.arange(12.0)}
    estimate = pd.DataFrame({"id": "b", **late}).drop([4, 5])
    settings = {"time_scale": 0.001, "time_offset": -0.25, "unit_scale": 0.1}
    found = explained(truth, estimate, **settings)
    made = found.repaired()
    assert found.repairs[0].rows["t"] == [0.4, 0.5]
    assert made.times.tolist() == late["t"].tolist()
    assert made.state[:, 0] == pytest.approx(late["x"])
    assert evaluate(truth, made, C, 2, GAMMA, **settings).total == found.repairs[0].total


def test_the_rules_of_a_benchmark_depend_on_the_repair() -> None:
    result = evaluate(tracks(A), tracks(B))
    sides, request = result.source
    request = replace(request, recorded={"preprocess": "kitti"})
    result = replace(result, source=(sides, request))
    with pytest.raises(ConfigError, match="what it leaves out changes with the repair"):
        result.explain()


def test_covariances_of_new_states_lie_between() -> None:
    def gaussian(states: np.ndarray, deviation: float) -> Trajectories:
        return Trajectories.from_array(states, covariance=deviation**2 * np.eye(2))

    estimate = A.copy()
    estimate[4:6] = NAN
    distance: Any = {"distance": "gaussian-wasserstein"}
    truth, with_gap = gaussian(tracks(A), 1.0), gaussian(tracks(estimate), 2.0)
    found = explained(truth, with_gap, **distance)
    repair = of_kind(found, "fill")
    check(repair, 2 * (50 - 2.0), 12 * 2.0)  # (2 - 1)^2 for each of two axes
    before = evaluate(truth, with_gap, C, 2, GAMMA, **distance)
    sound(repair, before, evaluate(truth, found.repaired(), C, 2, GAMMA, **distance))


def test_stamps_of_a_shift_go_on_as_iso_times_do() -> None:
    moments = np.array(
        ["2026-01-01T00:00:59.5", "2026-01-01T00:01", "2026-01-01T00:01:00.5"], "datetime64[ns]"
    )
    labels = np.array([f"{moment}Z".replace("000000000", "") for moment in moments], dtype=object)
    far = path(3, 0.0, 9.0)
    sides = [
        replace(
            Trajectories.from_array(tracks(states)),
            times=moments.astype(np.int64),
            clock="zoned",
            labels=labels,
        )
        for states in (far, np.concatenate((far[:1] - np.array([9.0, 0.0]), far[:-1])))
    ]
    found = explained(*sides)
    rank = next(k for k, repair in enumerate(found.repairs, 1) if repair.kind == "shift")
    made = found.repaired(rank)
    assert made.shown[0] == "2026-01-01T00:00:59Z"
    sound(
        found.repairs[rank - 1],
        evaluate(*sides, C, 2, GAMMA),
        evaluate(sides[0], made, C, 2, GAMMA),
    )


def test_an_open_bracket_is_told() -> None:
    truth, estimate = scene(3, 6, 6, 20, side=8)
    before = evaluate(truth, estimate, 5.0, 2, 2.0, solver=Sinkhorn(epsilon=0.3))
    exact = evaluate(truth, estimate, 5.0, 2, 2.0)
    assert not before.certified
    found = before.explain(3)
    for rank, repair in enumerate(found.repairs, 1):
        after = evaluate(Trajectories.from_array(truth), found.repaired(rank), 5.0, 2, 2.0)
        assert repair.saving_lower <= exact.total - after.total <= repair.saving_upper


def test_what_cannot_be_explained_is_said() -> None:
    result = evaluate(tracks(A), tracks(B))
    with pytest.raises(ConfigError, match="top is 0: must be a whole number, 1 or more"):
        result.explain(0)
    with pytest.raises(ConfigError, match="top is '3'"):
        result.explain("3")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="was not made by evaluate"):
        replace(result, source=None).explain()
