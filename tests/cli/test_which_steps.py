"""Which steps count, and what "per step" divides by: the same for all that are compared."""

import json
import shutil
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Answer, Invoke
from checkout import SAMPLES
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from tgospa_eval import ConfigError, compare, evaluate

METRIC = {"cutoff": 10.0, "switch_penalty": 5.0}
GIVEN = ("-c", "10", "-g", "5")
CLOCKS: dict[str, dict[str, Any]] = {
    "default": {},
    "truth": {"grid": "truth"},
    "steps": {"steps": "0:30"},
    "resample": {"resample": 2, "max_gap": 4, "period": 2},
    "interpolated estimate": {"interpolate": "estimate", "max_gap": 4},
    "interpolated truth": {"interpolate": "truth", "max_gap": 4},
}
"""Options of time."""


def table(states: Mapping[tuple[str, float], float]) -> pd.DataFrame:
    """A side from places by id and time."""
    rows = [(name, t, x) for (name, t), x in states.items()]
    return pd.DataFrame(rows, columns=["id", "t", "x"]).astype({"t": float, "x": float})


def truth() -> pd.DataFrame:
    """Three objects, 100 apart, for 31 steps of 1."""
    return table({(str(k), t): 100.0 * k + t for k in range(3) for t in range(31)})


def tracker(*, silent: tuple[float, float] = (0, 0), error: float = 1.0) -> pd.DataFrame:
    """Reports of these every second step, half a step late, none within the silence."""
    stamps = [2 * j + 0.5 for j in range(15)]
    return table(
        {
            (str(k), t): 100.0 * k + t + error
            for k in range(3)
            for t in stamps
            if not silent[0] < t < silent[1]
        }
    )


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A truth, a tracker, and the same one dead for a third of the time."""
    for name, side in {
        "truth": truth(),
        "alive": tracker(),
        "dead": tracker(silent=(10, 20)),
    }.items():
        side.to_csv(tmp_path / f"{name}.csv", index=False)
    return tmp_path


def value(answer: Answer) -> dict[str, Any]:
    assert answer.status == 0, answer.err
    found: dict[str, Any] = json.loads(answer.out)
    return found


def test_a_silence_is_charged(files: Path, invoke: Invoke) -> None:
    clock = ("--interpolate", "truth", "--max-gap", "4", "--format", "json", *GIVEN)
    alive = value(invoke("truth.csv", "alive.csv", *clock))
    dead = value(invoke("truth.csv", "dead.csv", *clock))
    assert alive["total"] == pytest.approx(45)
    # Ten stamps of the truth, from 9 to 20, and three objects at each, 50 for each miss.
    assert dead["missed"] == 50 * 3 * 12
    # The steps are those of the estimate, and of its silence.
    assert dead["judged"]["steps"] == 10 + 12
    assert dead["normalised"]["tgospa"] == pytest.approx((dead["total"] / 22) ** 0.5)
    (warned,) = [notice for notice in dead["warnings"] if notice["code"] == "silences"]
    assert (
        "no state within c of a true object in 1 outage of total length 12; 36 states of the truth"
        in warned["text"]
    )
    free = value(invoke("truth.csv", "dead.csv", *clock, "--outage", "none"))
    assert free["missed"] == 0
    assert "outages do not count" in json.dumps(free["warnings"])
    longer = value(invoke("truth.csv", "dead.csv", *clock, "--outage", "12"))
    assert longer["missed"] == 0
    assert alive["judged"]["truth_sha256"] != dead["judged"]["truth_sha256"]


@pytest.mark.parametrize("grid", ["estimate", "common"])
def test_a_silence_is_charged_where_the_estimate_chooses_the_steps(
    grid: str, files: Path, invoke: Invoke
) -> None:
    """Also by an absolute limit of a gate: who is dead is no better than who is not."""
    shift = tracker()
    shift["t"] = shift["t"].round()
    shift.to_csv("alive.csv", index=False)
    shift[~shift["t"].between(9, 20)].to_csv("dead.csv", index=False)
    clock = ("--grid", grid, *GIVEN)
    alive, dead = (
        value(invoke("truth.csv", f"{name}.csv", *clock, "--format", "json"))
        for name in ("alive", "dead")
    )
    assert alive["missed"] == 0
    assert alive["judged"]["steps"] == alive["sizes"]["steps"]
    assert dead["missed"] > 0
    assert dead["normalised"]["tgospa"] > alive["normalised"]["tgospa"]
    limit = str(alive["normalised"]["tgospa"] + 1e-6)
    gate = ("gate", "truth.csv", "{}.csv", "--max", f"normalised.tgospa={limit}", *clock, "-q")
    for name, status in (("alive", 0), ("dead", 1)):
        assert invoke(*(part.format(name) for part in gate)).status == status
    answer = invoke(*(part.format("dead") for part in gate), "--outage", "none")
    assert (answer.status, "it does not count outages" in answer.err) == (2, True)


@pytest.mark.parametrize(
    ("second", "clock"),
    [
        *((name, {"grid": grid}) for name in "12" for grid in ("estimate", "common")),
        ("1", {"interpolate": "truth", "max_gap": 10}),
        ("2", {"interpolate": "truth", "max_gap": 60}),
    ],
)
def test_time_without_a_true_object_is_no_outage(second: str, clock: dict[str, Any]) -> None:
    """One object with a gap or two objects: a tracker with a period of 4 misses nothing."""
    truth = table({("1" if t < 60 else second, t): t for t in (*range(52), *range(101, 151))})
    stamps = (*range(0, 49, 4), *range(104, 149, 4))
    estimate = {("a" if t < 60 else f"a{second}", t): t + 0.5 for t in stamps}
    result = evaluate(truth, table(estimate), **METRIC, **clock)
    assert (result.counts["missed"], "outage" in str(result.warnings)) == (0, False)
    dead = {key: x for key, x in estimate.items() if not 36 < key[1] < 128}
    result = evaluate(truth, table(dead), **METRIC, **clock)
    assert result.counts["missed"] == (51 - 36) + (128 - 101)
    assert "1 outage of total length 42;" in str(result.warnings)


@pytest.mark.parametrize("grid", ["estimate", "common"])
@pytest.mark.parametrize("outage", [None, "none"])
def test_reports_between_the_times_of_the_truth_are_no_outage(
    grid: str, outage: str | None
) -> None:
    """The remedy is the one that works: with it half of the objects are followed."""
    clock: dict[str, Any] = {"grid": grid, "outage": outage}
    lone = {("late", 3.0): 3.0}  # else a common grid without outages would be empty
    own = {("1", t): t for t in range(10)} | {("2", t): t + 200 for t in range(10)}
    late = {("a", t + 0.25): t + 0.5 for t in range(10)}
    result = evaluate(table(own), table(late | lone), **METRIC, **clock)
    remedy = 'use interpolate="truth" max_gap=5: 9 states of the estimate in outages are then'
    assert remedy.replace("9", "7") in str(result.warnings)
    found = evaluate(table(own), table(late), **METRIC, interpolate="truth", max_gap=5)
    assert found.summary["detection_rate"] == 0.5
    if outage is None:
        result = evaluate(table(own), table(late), **METRIC, **clock)
        assert remedy in str(result.warnings)
        far = dict.fromkeys(late, -500.0)
        result = evaluate(table(own), table(far), **METRIC, **clock)
        assert ("outage of" in str(result.warnings), "use " in str(result.warnings)) == (
            True,
            False,
        )


@pytest.mark.parametrize(
    ("swapped", "clock", "remedy"),
    [
        (False, {"resample": 1, "max_gap": "10,5"}, {"resample": 1, "max_gap": "30,5"}),
        (False, {"interpolate": "truth", "max_gap": 10}, {"interpolate": "truth", "max_gap": 30}),
        (
            True,
            {"interpolate": "estimate", "max_gap": 10},
            {"interpolate": "estimate", "max_gap": 30},
        ),
    ],
)
def test_a_track_that_the_clock_leaves_out_is_told(
    swapped: bool, clock: dict[str, Any], remedy: dict[str, Any]
) -> None:
    ships = {("1", t): t for t in range(0, 101, 5)}
    ships |= {("2", t + 0.5): t + 500 for t in (0, 30, 60, 90)}
    sides = table(ships), table({("a", t): t + 0.5 for t in range(0, 99, 2)})
    sides = sides[::-1] if swapped else sides

    def warned(clock: dict[str, Any]) -> list[str]:
        found = evaluate(*sides, **METRIC, **clock)
        return [str(notice) for notice in found.warnings if notice.code == "not-evaluated"]

    noun = "estimates" if swapped else "ground-truth objects"
    (text,) = warned(clock)
    assert f"1 of 2 {noun} has no state at a step that counts, so it costs nothing: id 2" in text
    name, value = list(remedy.items())[-1]
    assert f"{name}={value}" in text.replace('"', "")
    assert not warned(remedy)


def test_a_false_alarm_ends_no_silence(files: Path, invoke: Invoke) -> None:
    clock = ("--interpolate", "truth", "--max-gap", "4", "--format", "json", *GIVEN)
    dead = value(invoke("truth.csv", "dead.csv", *clock))
    with Path("dead.csv").open("a", encoding="utf-8") as file:
        file.write("far,14.5,-5000\n")
    more = value(invoke("truth.csv", "dead.csv", *clock))
    assert "36 states of the truth at these times" in json.dumps(more["warnings"])
    # It is one false state, at a step at which three more objects are missed.
    assert more["total"] == pytest.approx(dead["total"] + 4 * 50)


def test_a_silence_is_no_fault_of_the_clock_and_an_hour_is_one(files: Path, invoke: Invoke) -> None:
    clock = ("--interpolate", "truth", "--max-gap", "4", *GIVEN)
    answer = invoke("truth.csv", "dead.csv", *clock)
    assert "no state within c of a true object in 1 outage of total length 12" in answer.err
    assert "of the steps are in both files" not in answer.err
    ahead = tracker()
    ahead["t"] += 9.25
    ahead.to_csv("ahead.csv", index=False)
    answer = invoke("truth.csv", "ahead.csv", *clock)
    assert "the clock of the estimate seems to be" in answer.err


def test_who_is_judged_at_other_steps_has_no_order(files: Path, invoke: Invoke) -> None:
    clock = ("--interpolate", "truth", "--max-gap", "4", "--outage", "none", *GIVEN)
    answer = invoke("compare", "truth.csv", "alive.csv", "dead.csv", *clock, "-q")
    assert (answer.status, answer.out) == (2, "")
    assert (
        "no ranking: not judged on the same steps and truth (alive, alive.csv: 45 truth states at "
        "15 of 15 steps; dead, dead.csv: 30 truth states at 10 of 10 steps); evaluate all on a "
        "common clock, by --resample, or with"
    ) in answer.err
    gate = ("gate", "truth.csv", "alive.csv", "--baseline", "base.json", *clock, "-q")
    assert invoke(*gate, "--update-baseline").status == 0
    Path("alive.csv").write_bytes(Path("dead.csv").read_bytes())
    answer = invoke(*gate)
    assert answer.status == 2
    said = " ".join(answer.out.split())
    assert "not judged on the same steps and truth (now: 30 truth states at 10 of 10" in said


def test_no_ranking_of_a_batch_either(files: Path, invoke: Invoke) -> None:
    for run in "12":
        Path(f"gt_{run}.csv").write_bytes(Path("truth.csv").read_bytes())
        for name in ("alive", "dead"):
            Path(f"{name}_{run}.csv").write_bytes(Path(f"{name}.csv").read_bytes())
    batch = ("batch", "--truth", "gt_{run}.csv", "--estimate", "{tracker}_{run}.csv", *GIVEN, "-q",
             "--by", "tracker")  # fmt: skip
    answer = invoke(*batch, "--interpolate", "truth", "--max-gap", "4", "-o", "own")
    assert answer.status == 0
    assert "tracker is not ranked: gt_1.csv: not judged on the same steps and truth" in " ".join(
        answer.out.split()
    )
    answer = invoke(*batch, "--resample", "2", "--max-gap", "4", "-o", "common")
    assert "not ranked" not in answer.out
    rows = [line.split() for line in answer.out.splitlines()]
    assert [row[0] for row in rows if row[:1] and row[0] in ("alive", "dead")][:2] == [
        "alive",
        "dead",
    ]


def test_false_alarms_at_empty_times_raise_the_value_per_step() -> None:
    known, alive = truth(), tracker()
    alarms = table({(f"f{k}", 1000.0 + k): 0.0 for k in range(25)})
    before = evaluate(known, alive, **METRIC)
    after = evaluate(known, pd.concat([alive, alarms]), **METRIC)
    assert before.judged == after.judged
    assert after.total == pytest.approx(before.total + 25 * 50)
    assert after.normalised["tgospa"] == pytest.approx((after.total / 31) ** 0.5)


def test_a_pair_has_one_value_per_step_in_all_verbs(files: Path, invoke: Invoke) -> None:
    alarms = table({(f"f{k}", 1000.0 + k): 0.0 for k in range(25)})
    alarms.to_csv("alive.csv", index=False, mode="a", header=False)
    one = value(invoke("truth.csv", "alive.csv", *GIVEN, "--format", "json"))
    each = one["normalised"]["tgospa"]
    both = value(
        invoke("compare", "truth.csv", "alive.csv", "dead.csv", *GIVEN, "--format", "json")
    )
    assert both["steps"] == [31]
    assert each in [
        pytest.approx(item["normalised"]["tgospa"], rel=1e-12) for item in both["estimates"]
    ]
    gate = ("gate", "truth.csv", "alive.csv", "--baseline", "base.json", *GIVEN)
    assert invoke(*gate, "--update-baseline").status == 0
    entry = json.loads(Path("base.json").read_text(encoding="utf-8"))["pairs"]
    assert next(iter(entry.values()))["values"]["normalised"]["tgospa"] == pytest.approx(each)
    batch = ("batch", "--truth", "truth.csv", "--estimate", "al{name}.csv", *GIVEN, "-o", "res")
    assert invoke(*batch, "--pictures", "none").status == 0
    rows = pd.read_parquet("res/jobs")
    assert rows["normalised.tgospa"].tolist() == [pytest.approx(each, rel=1e-12)]
    assert rows["judged.steps"].tolist() == [31]


def test_declared_steps_count_whether_something_exists_or_not() -> None:
    found = evaluate(truth(), tracker(), **METRIC, steps="0:99", time_tolerance=0.5)
    assert (found.judged["steps"], found.judged["truth_states"]) == (100, 93)
    assert found.normalised["tgospa"] == pytest.approx((found.total / 100) ** 0.5)
    part = evaluate(truth(), tracker(), **METRIC, steps="10:19")
    assert part.judged["truth_states"] == 30
    assert part.input["truth"]["left_out"] == {"steps": 63}
    tenths = table({("a", k / 10): 0.0 for k in range(11)})
    exact = evaluate(tenths, tenths, **METRIC, steps="0:1:0.1")
    assert (exact.judged["truth_states"], exact.total) == (11, 0)


@pytest.mark.parametrize(
    ("estimate", "options", "text"),
    [
        ("e", {"steps": "0:100"}, "101 steps count: 10 with states of the truth, 5 of the est"),
        ("e", {"resample": 1, "period": 1}, "10 steps count: 10 with states of the truth, 5 of t"),
        ("e", {"resample": 1}, "the truth, 9 of the estimate, 9 of both"),
        ("none", {"resample": 1}, "the truth, 0 of the estimate, 0 of both"),
        ("e", {"interpolate": "estimate"}, "the truth, 9 of the estimate, 9 of both"),
        ("e", {}, "5 of 10 steps are in both files"),
    ],
)
def test_how_many_steps_have_states(estimate: str, options: dict[str, Any], text: str) -> None:
    """Of a declared clock, no step is in a file: it has states or not."""
    whole = table({("a", t): float(t) for t in range(10)})
    side = whole[whole["t"] % 2 == 0] if estimate == "e" else whole[:0]
    gap = {} if "steps" in options or not options else {"max_gap": 2}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = evaluate(whole, side, **METRIC, **options, **gap)
    assert text in " ".join(found.notices)


def test_inspect_counts_the_steps_with_states(files: Path, invoke: Invoke) -> None:
    truth().to_csv("t.csv", index=False)
    answer = invoke("inspect", "t.csv", "t.csv", "--steps", "0:100")
    assert "101 steps count: 31 with states of the truth, 31 of the estimate" in answer.out


def test_a_range_of_time_takes_its_part_of_declared_steps(files: Path, invoke: Invoke) -> None:
    truth().assign(x=lambda side: side["x"] + 1).to_csv("late.csv", index=False)
    given = ("truth.csv", "late.csv", *GIVEN, "--format", "json")
    part = value(invoke(*given, "--steps", "5:9"))
    both = value(invoke(*given, "--steps", "0:30", "--time", "5:9"))
    assert both["judged"] == part["judged"]
    assert both["normalised"] == part["normalised"]
    answer = invoke(*given, "--steps", "0:30", "--time", "50:90")
    assert (answer.status, answer.out) == (2, "")
    assert "--time 50:90: is beyond all steps of --steps 0:30" in answer.err


def test_steps_without_any_row_are_no_proven_zero(files: Path, invoke: Invoke) -> None:
    wrong = "--steps 0.25:3.25:1: no row of either file is at one of these steps; all 138 are at"
    given = ("truth.csv", "alive.csv", *GIVEN, "--steps", "0.25:3.25:1", "-q")
    for answer in (
        invoke(*given),
        invoke("gate", *given, "--max", "tgospa=1"),
        invoke("compare", *given[:2], "dead.csv", *given[2:]),
    ):
        assert answer.status == 2
        assert wrong in answer.out + answer.err
    with pytest.raises(ConfigError, match="no row of either file"):
        evaluate(truth(), tracker(), **METRIC, steps="0.25:3.25:1")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"steps": "5:1"}, "ends before it begins"),
        ({"steps": "0:1:0"}, "more than 0 apart"),
        ({"steps": "0:1e9:1"}, "at most 10,000,000 are evaluated"),
        ({"steps": "0:1.5"}, "say how far apart the steps are"),
        ({"steps": "later"}, "must be FIRST:LAST"),
        ({"steps": "0:9", "grid": "truth"}, "says which steps count"),
        ({"steps": "0:9", "resample": 1, "max_gap": 2}, "leave one out"),
        ({"resample": 1}, "needs max_gap"),
        ({"resample": "3s", "max_gap": 9}, "plain numbers, whose unit is not known"),
        ({"max_gap": 3}, "is for"),
        ({"resample": "3 parsecs", "max_gap": 9}, "must be a number, or one with a unit"),
        ({"outage": 3}, "needs interpolate"),
        ({"time_tolerance": "20ms"}, "plain numbers"),
    ],
)
def test_what_does_not_fit(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        evaluate(truth(), tracker(), **METRIC, **options)


def test_durations_have_units_where_stamps_are_times() -> None:
    def iso(side: pd.DataFrame) -> pd.DataFrame:
        stamps = pd.Timestamp("2026-05-01T08:00:00Z") + pd.to_timedelta(side["t"], unit="s")
        return side.assign(t=stamps.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ"))

    plain = evaluate(truth(), tracker(), **METRIC, resample=2, max_gap=(4, 3))
    found = evaluate(
        iso(truth()), iso(tracker()), **METRIC, resample="2s", max_gap=("4000ms", "0.05min")
    )
    assert found.total == plain.total
    assert found.judged["steps"] == plain.judged["steps"] == 16
    assert found.parameters["max_gap"] == [4.0, 3.0]
    assert evaluate(iso(truth()), iso(tracker()), **METRIC, time_tolerance="500ms").total == (
        evaluate(truth(), tracker(), **METRIC, time_tolerance=0.5).total
    )


def test_gaps_of_the_truth_are_told() -> None:
    known = truth()
    known = known[~((known["id"] == "1") & known["t"].between(10, 20))]
    found = evaluate(known, tracker(), **METRIC, resample=1, max_gap=4)
    (told,) = [notice for notice in found.warnings if notice.code == "truth-gaps"]
    assert (
        "the truth has 1 gap longer than 4, of total length 12, in the tracks of id 1; 12"
        in told.text
    )
    assert "costs up to 600" in told.text
    assert found.counts["false"] == 12  # one of them is made in the gap, and holds after it


def test_a_class_that_a_sequence_has_not_is_nothing(tmp_path: Path, invoke: Invoke) -> None:
    car = "id,t,x,class\n1,0,0,car\n1,1,1,car\n"
    for folder in ("gt", "out"):
        Path(folder).mkdir()
        Path(folder, "0.csv").write_text(car, encoding="utf-8")
        Path(folder, "1.csv").write_text(car + "2,1,9,bike\n", encoding="utf-8")
    batch = ("batch", "--truth", "gt/{run}.csv", "--estimate", "out/{run}.csv", *GIVEN)
    answer = invoke(*batch, "--class", "bike", "-o", "bikes")
    assert answer.status == 0
    assert "no row is left to evaluate in 1 of 2 jobs: total 0" in answer.err
    rows = pd.read_parquet("bikes/jobs")
    assert rows["judged.steps"].tolist() == [2, 2]
    answer = invoke(*batch, "--class", "train", "-o", "trains")
    assert answer.status == 5
    assert "no row is left to evaluate in any of 2 jobs" in answer.err
    assert invoke("gt/0.csv", "out/0.csv", *GIVEN, "--class", "bike").status == 2


scenes = st.lists(
    st.tuples(st.integers(0, 2), st.integers(0, 30), st.floats(-6, 6)), min_size=1, max_size=40
)


@pytest.mark.parametrize("clock", CLOCKS)
@settings(max_examples=examples(5))
@given(scene=scenes, at=st.integers(-5, 35))
def test_another_false_state_never_lowers_the_value_per_step(
    clock: str, scene: list[tuple[int, int, float]], at: int
) -> None:
    """It is farther than c from every truth."""
    states = {(str(k), float(t)): 100.0 * k + t + error for k, t, error in scene}
    more = table(states | {("far", float(at)): -5000.0})
    options = METRIC | CLOCKS[clock]
    before = evaluate(truth(), table(states), **options)
    after = evaluate(truth(), more, **options)
    if clock != "interpolated truth":  # where the estimate decides which steps there are
        assert before.judged == after.judged
    if before.judged == after.judged:
        assert after.upper_bound >= before.lower_bound
        assert after.normalised["tgospa"] >= before.normalised["tgospa"] * (1 - 1e-12)


@pytest.mark.parametrize("clock", ["default", "resample", "interpolated truth"])
def test_another_false_state_never_improves_a_rank(
    clock: str, tmp_path: Path, invoke: Invoke
) -> None:
    """Nor RMS values over runs, nor the root mean square of any step."""
    rng = np.random.default_rng(3)
    given = [
        part
        for name, value in CLOCKS[clock].items()
        for part in ("--" + name.replace("_", "-"), str(value))
    ]
    batch = ("batch", "--truth", "{run}/truth.csv", "--estimate", "{run}/{tracker}.csv", "--by",
             "tracker", *GIVEN, *given, "--per-step", "--format", "json", "-q")  # fmt: skip
    better: list[tuple[dict[str, Any], dict[str, list[int]], dict[float, float]]] = []
    for run in "12":
        Path(run).mkdir()
        truth().to_csv(f"{run}/truth.csv", index=False)
        for name in "ab":
            side = tracker(error=float(rng.uniform(0.5, 5)))
            side[rng.random(len(side)) > 0.2].to_csv(f"{run}/{name}.csv", index=False)
    for more in ("", "far,7,-5000\nfar,12.5,-5000\nfar,-3,-5000\n"):
        with Path("2/b.csv").open("a", encoding="utf-8") as file:
            file.write(more)
        found = value(invoke(*batch, "-o", f"out{len(better)}"))
        group = next(one for one in found["groups"] if one["tracker"] == "b")
        places = {one["name"]: one["place"] for one in found["ranking"]}
        steps = pd.read_csv(f"out{len(better)}/curve.csv")
        steps = steps[(steps["tracker"] == "b") & (steps["curve"] == "step")]
        better.append((group, places, dict(zip(steps["t"], steps["rms"], strict=True))))
    before, after = better
    for name in ("per_step", "rms", "combined"):
        assert after[0][name] >= before[0][name] * (1 - 1e-12)
    if clock == "interpolated truth":  # each tracker has steps of its own
        assert not after[1]
    else:
        assert before[1]["b"] <= after[1]["b"]
    assert all(after[2][t] >= rms * (1 - 1e-12) for t, rms in before[2].items())


@pytest.mark.parametrize("clock", ["default", "truth", "steps", "interpolated truth"])
@settings(max_examples=examples(5))
@given(scene=scenes, gone=st.sets(st.integers(0, 39), min_size=1))
def test_a_tracker_that_says_less_is_never_better(
    clock: str, scene: list[tuple[int, int, float]], gone: set[int]
) -> None:
    """Its states lie within c / 2^(1/p) of their truth, and it has no switches."""
    states = {(str(k), float(t)): 100.0 * k + t + error for k, t, error in scene}
    left = {key: x for n, (key, x) in enumerate(states.items()) if n not in gone}
    options = METRIC | {"switch_penalty": 0.0} | CLOCKS[clock]
    before = evaluate(truth(), table(states), **options)
    after = evaluate(truth(), table(left), **options)
    if before.judged == after.judged:
        assert after.upper_bound >= before.lower_bound
    else:
        assert clock == "interpolated truth"
        with pytest.raises(ConfigError, match="no ranking: not judged on the same"):
            compare(truth(), {"more": table(states), "less": table(left)}, **options)


def test_the_horizon_of_an_empty_truth_is_that_of_the_steps() -> None:
    nothing = truth().iloc[:0]
    found = evaluate(nothing, tracker(), **METRIC)
    assert found.judged["steps"] == 15
    assert np.isclose(found.total, 45 * 50)


JSON = (*GIVEN, "--format", "json", "-o", "r", "--workers", "1")
MOT = ("batch", "--layout", "motchallenge", "gt", "out", *JSON)
KITTI = ("batch", "--layout", "kitti", "gt", "out", *JSON)
BOX = ",10,10,20,20,1,-1,-1,-1\n"
LABEL = " Car 0 0 -1 10 10 30 30 1 1 1 1 1 1 0 1\n"


def written(path: str, text: str) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(text, encoding="utf-8")


def jobs(answer: Answer) -> pd.DataFrame:
    """The jobs of a batch whose report is JSON."""
    return pd.DataFrame(json.loads(answer.out)["jobs"])


def seqinfo(name: str, length: object) -> None:
    written(f"gt/{name}/seqinfo.ini", f"[Sequence]\nname={name}\nseqLength={length}\n")


@pytest.fixture
def sequences(invoke: Invoke) -> None:  # which goes to a folder of its own
    """Two sequences of 10 and 20 frames, with an object in the first three."""
    for name, length in (("A", 10), ("B", 20)):
        seqinfo(name, length)
        written(f"gt/{name}/gt/gt.txt", "".join(f"{t},1,10,10,20,20,1,1,1\n" for t in (1, 2, 3)))
        written(f"out/x/data/{name}.txt", "1,7,90,90,20,20,1,-1,-1,-1\n")
        written(f"out/y/data/{name}.txt", f"1,7{BOX}12,8{BOX}")


@pytest.mark.usefixtures("sequences")
def test_steps_of_motchallenge_are_the_frames_of_seqinfo(invoke: Invoke) -> None:
    answer = invoke(*MOT, "--by", "tracker", "--per-step")
    assert answer.status == 0, answer.err
    document = json.loads(answer.out)
    rows = jobs(answer).set_index(["label.tracker", "label.sequence"])
    assert rows["judged.steps"].to_dict() == {
        (tracker, name): length for tracker in "xy" for name, length in (("A", 10), ("B", 20))
    }
    # 50 for each miss; x has none of three and a false alarm, y one, and one beyond the end of A.
    assert rows["total"].to_dict() == pytest.approx(
        {("x", "A"): 200, ("x", "B"): 200, ("y", "A"): 100, ("y", "B"): 150}
    )
    assert rows["normalised.tgospa"]["y", "B"] == pytest.approx((150 / 20) ** 0.5)
    # Sequences of different lengths are one group, and ranked.
    assert [(g["tracker"], g["jobs"]) for g in document["groups"]] == [("x", 2), ("y", 2)]
    assert document["groups"][1]["per_step"] == pytest.approx((250 / 30) ** 0.5)
    assert {one["name"] for one in document["ranking"]} == {"x", "y"}
    assert {point["t"] for point in document["curves"][0]["points"]} == set(range(1, 21))
    assert (
        "tracker=y sequence=A: 0 rows of the truth and 1 of the estimate are left out: their"
        in answer.err
    )
    # The same of a single evaluation.
    single = invoke(
        "gt/A/gt/gt.txt", "out/y/data/A.txt", *GIVEN, "--steps", "1:10", "--format", "json"
    )
    result = json.loads(single.out)
    assert result["normalised"]["tgospa"] == rows["normalised.tgospa"]["y", "A"]
    assert result["judged"]["steps_sha256"] == rows["judged.steps_sha256"]["y", "A"]


@pytest.mark.usefixtures("sequences")
def test_a_changed_seqinfo_is_another_horizon(invoke: Invoke) -> None:
    assert invoke(*MOT).status == 0
    seqinfo("A", 5)
    answer = invoke(*MOT)
    assert "2 jobs of 4 done before" in answer.err
    assert jobs(answer)["judged.steps"].tolist() == [5, 20, 5, 20]
    assert "4 jobs of 4 done before" in invoke(*MOT).err


@pytest.mark.usefixtures("sequences")
@pytest.mark.parametrize(
    ("options", "steps"),
    [
        (("--steps", "0:99"), [100, 100]),
        (("--grid", "truth"), [3, 3]),
        (("--resample", "1", "--max-gap", "2"), [3, 3]),
        (("--interpolate", "estimate", "--max-gap", "2"), [3, 3]),
        (("--time", "3:"), [8, 18]),
        (("--time", "15:"), [0, 6]),
    ],
)
def test_options_that_say_which_steps_count_win(
    invoke: Invoke, options: tuple[str, ...], steps: list[int]
) -> None:
    answer = invoke(*MOT, *options)
    assert answer.status in (0, 5), answer.err
    assert jobs(answer)["judged.steps"].tolist() == steps * 2


@pytest.mark.usefixtures("sequences")
@pytest.mark.parametrize(
    ("length", "message"),
    [
        ("ten", 'gt/A/seqinfo.ini, line 3: seqLength is "ten"; it must be the number of frames'),
        ("", 'line 3: seqLength is ""'),
        ("0", 'line 3: seqLength is "0"'),
        ("10.0", 'line 3: seqLength is "10.0"'),
        ("10000001", "the number of frames, 1 to 10,000,000"),
        ("1" * 5000, "line 3: seqLength is"),
        ("10\nseqLength=11", "seqLength is given twice, with different values"),
        ("10\nauthor=\udcfc", "line 4: not UTF-8 (byte 0xfc); save it as UTF-8"),
    ],
)
def test_a_seqinfo_without_meaning_is_named(invoke: Invoke, length: str, message: str) -> None:
    text = f"[Sequence]\nname=A\nseqLength={length}\n"
    Path("gt/A/seqinfo.ini").write_bytes(text.encode("utf-8", "surrogateescape"))
    answer = invoke(*MOT)
    assert (answer.status, answer.out, Path("r").exists()) == (3, "", False)
    assert message in answer.err
    assert len(answer.err.splitlines()) == 1
    if not length:
        assert invoke(*MOT, "--steps", "1:10").status == 0  # which needs none


@pytest.mark.usefixtures("sequences")
def test_sequences_without_a_length_keep_the_steps_of_their_truth(invoke: Invoke) -> None:
    Path("gt/A/seqinfo.ini").write_text("\ufeff[Sequence]\r\nname=A\r\n", encoding="utf-8")
    answer = invoke(*MOT)
    notice = "gt: no seqinfo.ini with seqLength for A: values per step are divided by the"
    assert answer.status == 0
    assert answer.err.count(notice) == 1
    assert jobs(answer)["judged.steps"].tolist() == [3, 20, 3, 20]
    Path("gt/A/seqinfo.ini").write_text("\ufeff[Sequence]\r\nSEQLENGTH : 9\r\n", encoding="utf-8")
    answer = invoke(*MOT)
    assert notice not in answer.err
    assert jobs(answer)["judged.steps"].tolist() == [9, 20, 9, 20]


def test_steps_of_kitti_are_the_frames_of_the_seqmap(invoke: Invoke) -> None:
    """The last number is how many there are: frames 0 to 153 of 154."""
    for name in ("0000", "0001"):
        written(f"gt/label_02/{name}.txt", f"0 1{LABEL}3 1{LABEL}")
        written(f"out/x/data/{name}.txt", f"9 1{LABEL}10 1{LABEL}")
    told = "gt: no frames in evaluate_tracking.seqmap.training for"
    answer = invoke(*KITTI)
    assert f"{told} 0000, 0001: values per step" in answer.err
    assert jobs(answer)["judged.steps"].tolist() == [2, 2]
    written("gt/evaluate_tracking.seqmap.training", "0000 empty 000000 000010\n")
    written("gt/evaluate_tracking.seqmap.test", "0000 empty 000000 000099\n0001 empty 0 99\n")
    answer = invoke(*KITTI)
    assert f"{told} 0001: values per step" in answer.err
    assert "tracker=x sequence=0000: 0 rows of the truth and 1 of the estimate" in answer.err
    rows = jobs(answer)
    assert rows["judged.steps"].tolist() == [10, 2]
    assert rows["total"].tolist() == pytest.approx([150, 200])
    assert rows["normalised.tgospa"][0] == pytest.approx(15**0.5)
    # A map of names selects; one with frames goes before that of the folder.
    written("names", "0000\n")
    rerun = [*KITTI[:-3], "s", *KITTI[-2:], "--seqmap"]
    assert jobs(invoke(*rerun, "names"))["judged.steps"].tolist() == [10]
    written("frames", "0001,empty,000002,000012\n")
    rerun[rerun.index("s")] = "u"
    (row,) = jobs(invoke(*rerun, "frames")).to_dict("records")
    assert (row["judged.steps"], row["judged.first"], row["judged.last"]) == (10, "2", "11")
    written("frames", "0001 empty 000010 000010\n")
    answer = invoke(*rerun, "frames")
    assert answer.status == 3
    assert 'frames, line 1: "000010 000010" must be the first frame and the one after' in answer.err


def test_steps_of_nuscenes_are_the_samples(invoke: Invoke) -> None:
    """Those without an annotation too; the folder of tables is a truth of a batch."""
    shutil.copytree(SAMPLES / "formats" / "v1.0-mini", "tables/v1.0-mini")
    annotations = Path("tables/v1.0-mini/sample_annotation.json")
    times = {
        one["token"]: one["timestamp"]
        for one in json.loads(Path("tables/v1.0-mini/sample.json").read_text(encoding="utf-8"))
    }
    early = sorted(times.values())[5]
    kept = [
        one
        for one in json.loads(annotations.read_text(encoding="utf-8"))
        if times[one["sample_token"]] <= early
    ]
    annotations.write_text(json.dumps(kept), encoding="utf-8")
    written("out/none.json", '{"meta": {}, "results": {}}')
    for run in ("--truth", "tables/v1.0-mini", "--estimate", "out/{tracker}.json"), ("m.csv",):
        written("m.csv", "truth,estimate\ntables/v1.0-mini,out/none.json\n")
        store = ("-o", f"r{len(run)}", "--workers", "1")
        answer = invoke("batch", *run, "-c", "2", "-g", "1", *store)
        assert answer.status == 0, answer.err
        (row,) = pd.read_parquet(f"{store[1]}/jobs").to_dict("records")
        assert row["judged.steps"] == len(times) == 12
        assert row["judged.truth_steps"] == 6
        assert row["normalised.tgospa"] == pytest.approx((row["total"] / 12) ** 0.5)
    annotations.write_text("[]", encoding="utf-8")
    assert "done before" not in invoke("batch", *run, "-c", "2", "-g", "1", *store).err


def test_classes_with_steps_of_their_own_are_refused(invoke: Invoke) -> None:
    """What the message proposes works."""
    rows = [(k, t, k * 3.0, "ab"[k]) for k in (0, 1) for t in range(20)]
    truth = pd.DataFrame(rows, columns=["id", "t", "x", "class"])
    estimate = truth[(truth["class"] == "a") | ~truth["t"].between(6, 11)]
    estimate = estimate.assign(t=estimate["t"] + 0.5)
    truth.to_csv("truth.csv", index=False)
    estimate.to_csv("estimate.csv", index=False)
    asked = ("truth.csv", "estimate.csv", "-c", "2", "-g", "1", "--max-gap", "3", "-q")
    answer = invoke(*asked, "--by", "class", "--interpolate", "truth")
    assert answer.status == 2
    assert answer.err.startswith("--by class: --interpolate gives each class its own steps")
    assert invoke(*asked, "--by", "class", "--resample", "1").status == 0
    assert invoke(*asked, "--class", "a", "--interpolate", "truth").status == 0
