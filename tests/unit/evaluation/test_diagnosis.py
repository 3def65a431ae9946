"""Warnings about units, axes, origins, clocks, sides: where they should be, and nowhere else."""

import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Run, Write
from runs import warnings_of

from tgospa_eval import TgospaWarning, Trajectories, evaluate, read_trajectories, sweep
from tgospa_eval.common.notices import Notice
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.simulation import SCENARIOS, Scene, Tracker, simulate

Sides = tuple[Trajectories, Trajectories]


@pytest.fixture(scope="module")
def sample(quickstart: tuple[str, str]) -> Sides:
    """Sound data."""
    return read_trajectories(quickstart[0]), read_trajectories(quickstart[1])


def found(truth: Trajectories, estimate: Trajectories, cutoff: float = 10.0) -> list[Notice]:
    return warnings_of(truth, estimate, Parameters(cutoff=cutoff, order=2, switch_penalty=5))


def moved(side: Trajectories, change: Callable[[np.ndarray], Any]) -> Trajectories:
    return replace(side, state=change(np.array(side.state)))


STATES: dict[str, tuple[str, Callable[[np.ndarray], Any], str]] = {
    "km": ("unit-scale", lambda x: x / 1000, "1000 times too small"),
    "m": ("unit-scale", lambda x: x * 1000, "1000 times too large"),
    "feet": ("unit-scale", lambda x: x / 0.3048, "3.28084 times too large"),
    "swapped": ("axis-swap", lambda x: x[:, ::-1], "; write both files in the same axes"),
    "turned": ("axis-swap", lambda x: x[:, ::-1] * [1, -1], "with x negated"),
    "negated": ("axis-sign", lambda x: x * [1, -1], "y of the estimate seems negated; "),
    "image": (
        "axis-sign",
        lambda x: np.add(x * [1, -1], [0, 480]),
        "the origin of the estimate differs",
    ),
    "far": ("offset", lambda x: np.add(x, [5e5, 5e6]), "displaced by (500000, 5000000) in x,y"),
    "exact": ("offset", lambda x: x + 700.0, "displaced by (700, 700) in x,y"),
    "biased": ("offset", lambda x: np.add(x, [3, 4]), "displaced by (2.965, 3.911) in x,y"),
}


@pytest.mark.parametrize("fault", STATES)
def test_states(sample: Sides, fault: str) -> None:
    code, change, said = STATES[fault]
    (notice,) = found(sample[0], moved(sample[1], change))
    assert notice.code == code
    assert said in str(notice)
    assert "the per-step GOSPA cost of 53 steps falls by" in notice.text
    assert "100 %" not in notice.text  # which no bounds prove


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t + 2, "be 2 ahead"),
        (lambda t: t - 1_700_000_000, "be 1700000000 behind"),
        (
            lambda t: t * 1000,
            "run 1,000 times as fast as that of the truth, like milliseconds",
        ),
        (lambda t: t * 10**9, "run 1,000,000,000 times as fast"),
        (
            lambda t: t / 1000,
            "run 1,000 times slower than that of the truth, like seconds next to",
        ),
    ],
)
def test_clocks(sample: Sides, change: Callable[[np.ndarray], Any], said: str) -> None:
    truth, estimate = sample
    notices = found(truth, replace(estimate, times=change(estimate.times)))
    (shift,) = (notice for notice in notices if notice.code == "clock-shift")
    assert said in shift.text


def test_epoch_in_milliseconds(sample: Sides) -> None:
    truth, estimate = (replace(side, times=side.times + 1_700_000_000) for side in sample)
    notices = found(truth, replace(estimate, times=estimate.times * 1000))
    assert [notice.code for notice in notices] == ["steps-unmatched", "clock-shift"]


def test_longitude_and_latitude_exchanged() -> None:
    rng = np.random.default_rng(1)
    start = rng.uniform([47, 8], [47.2, 8.2], (4, 2))
    states = start + np.arange(30)[:, None, None] * 1e-3
    sides = [Trajectories.from_array(one, ("lat", "lon")) for one in (states, states[..., ::-1])]
    with pytest.warns(TgospaWarning, match="lat and lon of the estimate seem swapped"):
        result = evaluate(*sides, cutoff=50.0, distance="haversine")
    assert [notice.code for notice in result.warnings] == ["axis-swap"]


def test_sides() -> None:
    one = Trajectories.from_array(np.zeros((4, 1, 2)))
    none = Trajectories.from_array(np.full((4, 1, 2), np.nan))

    def codes(a: Trajectories, b: Trajectories) -> list[str]:
        return [notice.code for notice in found(a, b)]

    assert codes(one, none) == ["empty-side"]
    assert codes(none, none) == ["empty-side", "empty-side"]
    detections = replace(one, track=np.arange(4), ids=np.array(["1", "2", "3", "4"], object))
    assert codes(one, detections) == ["single-rows"]
    for period in (1, 2):  # a report that holds at two steps is one report
        clock = {"resample": 1, "max_gap": 2, "period": period}
        with pytest.warns(TgospaWarning, match="every id of the estimate has a single row"):
            evaluate(one, detections, 2.0, **clock)
    assert codes(one, moved(one, lambda x: x + 1000.0)) == ["nothing-near"]
    two = Trajectories.from_array(np.zeros((2, 2, 2)))
    for ids in (["7", "7.0"], ["7", "07"], ["07", "7.00"], ["0", "00"], ["007", "07"]):
        assert codes(two, replace(two, ids=np.array(ids, object))) == ["id-types"]
    for ids in (["7", "70"], ["07", "08"], ["0", "1"], ["7", "7.5"], ["0", "0x0"]):
        assert not codes(two, replace(two, ids=np.array(ids, object)))


def test_near_by_chance(sample: Sides) -> None:
    """Another recording of as many objects, and a poor tracker that is near as rarely."""
    scene = Scene(scenario="dense", targets=20, steps=60)
    (truth, _), (_, other) = (
        simulate(scene, Tracker(noise=1.0), np.random.default_rng(seed)) for seed in (1, 2)
    )
    (notice,) = found(truth, other, 5.0)
    assert notice.code == "nothing-near"
    assert (
        "only 3.5 % of the ground-truth states have an estimate within c = 5 at 60 steps"
        in notice.text
    )
    _, poor = simulate(
        scene, Tracker(noise=1.0, detection=0.1, false_rate=1.0), np.random.default_rng(1)
    )
    assert found(truth, poor, 5.0) == []
    still = replace(truth, state=truth.state[truth.track])  # at rest: near at any other step too
    rng = np.random.default_rng(0)
    sizes = np.where(rng.random((len(still.step), 1)) < 0.1, 1.0, 60.0)
    errors = rng.normal(0, sizes, still.state.shape)
    assert found(still, moved(still, lambda x: x + errors), 5.0) == []


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 4, np.pi / 2])
def test_another_recording_of_the_same_road(angle: float) -> None:
    """Chance is what is near along the road; a tracker that misses three of four is none."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])

    def recording(seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        speed, begin, lane = rng.uniform(1.5, 3, 40), rng.integers(-100, 190, 40), np.arange(40) % 4
        along = speed * (np.arange(200)[:, None] - begin)
        along[(along < 0) | (along > 400)] = np.nan
        return np.stack((along, np.broadcast_to(3.5 * lane, along.shape)), axis=2) @ turn

    road, other = recording(0), recording(1)
    rng = np.random.default_rng(2)
    poor = road + rng.normal(0, 1, road.shape)
    poor[rng.random(road.shape[:2]) < 0.75] = np.nan
    truth, *estimates = map(Trajectories.from_array, (road, other, poor))
    for cutoff in (2.0, 5.0):
        codes = [[notice.code for notice in found(truth, side, cutoff)] for side in estimates]
        assert codes == [["nothing-near"], []]


@pytest.mark.parametrize("speed", [0.0, 0.1, 2.0, 12.0])
def test_late_where_most_are_missed(speed: float) -> None:
    """Nothing to see of slow objects; of fast ones nothing is near but a step later."""
    rng = np.random.default_rng(7)
    lines = rng.uniform(0, 200, (1, 8, 2)) + speed * np.arange(101)[:, None, None]
    reported = lines + rng.normal(0, 0.3, lines.shape)
    reported[rng.random(lines.shape[:2]) > 0.4] = np.nan
    truth = Trajectories.from_array(lines[1:])
    assert found(truth, Trajectories.from_array(reported[1:])) == []
    late = found(truth, Trajectories.from_array(reported[:-1]))
    assert [notice.code for notice in late] == ["clock-shift"] * (speed > 1)
    for notice in late:
        assert "be 1 ahead (+/- 0.0" in notice.text
        assert "A constant error of position along the direction of travel" in notice.remedy


TRACKERS = {
    "noisy": Tracker(noise=5.0),
    "poor": Tracker(noise=3.0, detection=0.5, false_rate=1.0),
    "late": Tracker(noise=1.0, confirmation=15),
    "mixed": Tracker(noise=1.0, merges=0.8, swaps=0.5, near=20.0, fragmentation=0.1),
}


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_no_warning_about_sound_data(scenario: str, every: int) -> None:
    """Of trackers, sizes and cutoffs all that meet, or one of four, others in each scenario."""
    sizes, cutoffs = ((1, 30), (5, 60), (20, 40)), (3.0, 10.0, 50.0)
    cases = [*itertools.product(enumerate(TRACKERS.values()), sizes, cutoffs)]
    first = [*SCENARIOS].index(scenario) % every
    for (seed, tracker), (targets, steps), cutoff in cases[first::every]:
        scene = Scene(scenario=scenario, targets=targets, steps=steps)
        sides = simulate(scene, tracker, np.random.default_rng(seed))
        empty = [] if len(sides[1].step) else ["empty-side"]  # confirmed later than it lives
        assert [notice.code for notice in found(*sides, cutoff)] == empty


def test_warnings_travel(invoke: Run, write: Write, sample: Sides) -> None:
    """An off-by-one of the clock: on stderr with -q as well, and in every format and file."""
    lines = [
        f"{side.ids[k]},{side.times[s] + shift},{x!r},{y!r}"
        for side, shift in zip(sample, (0, 1), strict=True)
        for s, k, (x, y) in zip(side.step, side.track, side.state.tolist(), strict=True)
    ]
    size = len(sample[0].step)
    truth = write("t.csv", "\n".join(["id,t,x,y", *lines[:size]]))
    late = write("e.csv", "\n".join(["id,t,x,y", *lines[size:]]))
    given = truth, late, "-c", "10", "-g", "5", "-q"
    said = "the clock of the estimate seems to be 1 ahead (+/- "
    done = invoke(*given, "--format", "json", "-o", "result")
    assert done.err.startswith(f"warning: {said}")
    document = json.loads(done.out)
    (warning,) = document["warnings"]
    assert set(warning) == {"code", "text", "remedy"}
    assert warning["code"] == "clock-shift"
    assert document["files"] == {"truth": truth, "estimate": late}
    for kind in ("markdown", "latex"):
        assert said in invoke(*given, "--format", kind).out.replace("\\", "")
    assert said in Path("result/report.html").read_text(encoding="utf-8")
    assert said in invoke(*given, "--sweep", "cutoff=5,10", "--format", "json").out
    assert said in invoke("compare", *given, "--format", "json").out
    assert said in invoke("inspect", truth, late, "-q", "--format", "json").out
    gate = "gate", *given, "--baseline", "b.json"
    invoke(*gate, "--update-baseline")
    done = invoke(*gate, "--github", "--junit", "j.xml", "--format", "json")
    (pair,) = json.loads(done.out)["pairs"]
    assert (pair["verdict"], pair["warnings"]) == ("pass", [warning])
    assert "::warning title=" in done.err
    assert said in Path("j.xml").read_text(encoding="utf-8")


def test_python_warns(sample: Sides) -> None:
    truth, estimate = sample
    late = replace(estimate, times=estimate.times + 1)
    with pytest.warns(TgospaWarning, match="be 1 ahead") as caught:
        result = evaluate(truth, late, cutoff=10.0, switch_penalty=5.0)
    assert caught[0].filename == __file__
    assert [notice.code for notice in result.warnings] == ["clock-shift"]
    assert json.loads(result.to_json())["warnings"] == [result.warnings[0].record()]
    assert "be 1 ahead" in result._repr_html_()
    with pytest.warns(TgospaWarning, match="be 1 ahead"):
        assert len(sweep(truth, late, cutoff=[5, 10], switch_penalty=5.0).warnings) == 1
    with pytest.warns(TgospaWarning, match="choose with cutoff"):
        result = evaluate(np.zeros((3, 1, 2)), np.full((3, 1, 2), 30.0))
    assert "default-parameters" in [notice.code for notice in result.warnings]


def test_small_numbers_are_no_fault(sample: Sides) -> None:
    """Rounded coordinates, a truth that rests at the origin, ids with a number after a point."""
    truth = sample[0]
    assert found(truth, moved(truth, lambda x: np.floor(x * 100) / 100)) == []
    still = Trajectories.from_array(np.zeros((40, 3, 2)))
    noise = np.random.default_rng(0).normal(0, 15, (40, 3, 2))
    codes = [notice.code for notice in found(still, Trajectories.from_array(noise))]
    assert "unit-scale" not in codes
    parts = replace(truth, ids=np.array(["1", "1.1", "1.10", "2", "2.5"], object))
    assert found(truth, parts) == []


@pytest.mark.parametrize(
    ("truth_unit", "estimate_unit", "said"),
    [
        (10**9, 1, "run 1,000,000,000 times slower than that of the truth"),
        (10**6, 1, "run 1,000,000 times slower"),
        (10**9, 10**6, "run 1,000 times slower"),
        (10**6, 10**9, "run 1,000 times as fast"),
    ],
)
def test_epochs_in_other_units(
    sample: Sides, truth_unit: int, estimate_unit: int, said: str
) -> None:
    """Integers, which no double holds."""
    epoch = 1_700_000_000
    truth, estimate = (
        replace(side, times=(side.times.astype(np.int64) + epoch) * unit)
        for side, unit in zip(sample, (truth_unit, estimate_unit), strict=True)
    )
    texts = [notice.text for notice in found(truth, estimate) if notice.code == "clock-shift"]
    assert len(texts) == 1
    assert said in texts[0]


def test_few_common_steps_are_told_with_any_grid(sample: Sides) -> None:
    truth, estimate = sample
    moved = replace(estimate, times=estimate.times + 50)
    with pytest.warns(TgospaWarning, match="; other steps are left out"):
        evaluate(truth, moved, 10.0, 2, 5.0, grid="common", outage="none")
