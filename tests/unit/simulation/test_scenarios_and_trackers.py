"""Every scenario and every error does what its page says; the same seed gives the same bytes."""

import re
import runpy
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from checkout import ROOT
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from tgospa_eval import ConfigError, InputError, Trajectories, evaluate, read_trajectories
from tgospa_eval.cli.simulate import SCENARIOS as OFFERED
from tgospa_eval.cli.simulate import SCENE_FORMATS as OFFERED_FORMATS
from tgospa_eval.formats.write import WRITERS, csv_text, kitti_text, motchallenge_text
from tgospa_eval.simulation import SCENARIOS, Scene, Tracker, simulate, tracker
from tgospa_eval.simulation.scenarios import encounters

SEEDS = st.integers(0, 2**32 - 1)


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def present(states: np.ndarray) -> np.ndarray:
    return ~np.isnan(states[..., 0])


def lines(*positions: list[float]) -> np.ndarray:
    """One-dimensional positions of some targets at each step, as (T, m, 2)."""
    x = np.array(positions, float).T
    return np.stack((x, np.where(np.isnan(x), np.nan, 0.0)), axis=-1)


@st.composite
def truths(draw: st.DrawFn) -> np.ndarray:
    name = draw(st.sampled_from(sorted(SCENARIOS)))
    return SCENARIOS[name](
        draw(st.integers(0, 6)), draw(st.integers(1, 40)), 100.0, rng(draw(SEEDS))
    )


# --- scenarios ------------------------------------------------------------------------------------


def test_members_are_offered_and_documented() -> None:
    assert set(OFFERED) == set(SCENARIOS)
    assert set(OFFERED_FORMATS) == set(WRITERS)
    page = (ROOT / "docs" / "reference" / "simulate.md").read_text(encoding="utf-8")
    for name in (*OFFERED, *OFFERED_FORMATS):
        assert f"`{name}`" in page


@pytest.mark.parametrize("name", sorted(SCENARIOS))
@settings(max_examples=examples(20))
@given(targets=st.integers(0, 8), steps=st.integers(1, 50), seed=SEEDS)
def test_scenes_stay_in_their_square(name: str, targets: int, steps: int, seed: int) -> None:
    states = SCENARIOS[name](targets, steps, 50.0, rng(seed))
    assert states.shape == (steps, targets, 2)
    assert present(states).any(axis=0).all()
    there = states[present(states)]
    assert ((there >= 0) & (there <= 50)).all()


def test_crossing_targets_meet_at_half_time() -> None:
    states = SCENARIOS["crossing"](6, 61, 200.0, rng(0))
    assert np.abs(states[30] - 100).max() <= 200 / 40
    assert np.hypot(*(states[0] - states[-1]).T) == pytest.approx(160)


def test_born_targets_live_once_for_a_quarter_at_least() -> None:
    there = present(SCENARIOS["births"](200, 50, 200.0, rng(0)))
    assert (there.sum(axis=0) >= 13).all()
    assert (np.abs(np.diff(there.astype(int), axis=0)).sum(axis=0) <= 2).all()
    assert len({int(t) for t in there.argmax(axis=0)}) > 10


def test_manoeuvring_targets_keep_their_speed() -> None:
    states = SCENARIOS["manoeuvring"](1, 12, 200.0, rng(3))
    speed = np.hypot(*np.diff(states[:, 0], axis=0).T)
    assert speed == pytest.approx(2.0)  # a hundredth of the area; no wall is near with this seed


# --- errors ---------------------------------------------------------------------------------------


def test_encounters() -> None:
    nan = np.nan
    truth = lines([0, 0, 0, 0, 0, 0], [9, 2, 1, 2, 9, 1], [nan, nan, -1, 5, nan, nan])
    assert encounters(truth, 3.0).tolist() == [
        [0, 1, 1, 4, 2],
        [0, 2, 2, 3, 2],
        [1, 2, 2, 3, 2],
        [0, 1, 5, 6, 5],
    ]


@given(truths(), SEEDS, st.floats(0, 1))
def test_misses_only_take_away(truth: np.ndarray, seed: int, detection: float) -> None:
    left = tracker.miss(truth, detection, rng(seed))
    kept = present(left)
    assert not (kept & ~present(truth)).any()
    assert np.array_equal(left[kept], truth[kept])


def test_the_rates_are_those_asked_for() -> None:
    """Binomial and Poisson counts within five standard deviations; deviation of 20,000 draws."""
    states = np.zeros((1000, 10, 2))
    missed = (~present(tracker.miss(states, 0.9, rng(1)))).sum()
    assert abs(missed - 1000) < 5 * np.sqrt(900)
    noise = tracker.add_noise(states, 3.0, rng(1))
    assert abs(noise.std() - 3) < 5 * 3 / np.sqrt(40000)
    false = tracker.false_tracks(10_000, 0.05, (3, 3), 10.0, rng(1))
    assert abs(false.shape[1] - 500) < 5 * np.sqrt(500)


@given(truths(), st.integers(0, 50))
def test_latency_is_a_shift(truth: np.ndarray, steps: int) -> None:
    late = tracker.lag(truth, steps)
    assert late.shape == truth.shape
    assert not present(late[:steps]).any()
    assert np.array_equal(late[steps:], truth[: max(len(truth) - steps, 0)], equal_nan=True)


@given(truths(), st.integers(0, 10))
def test_late_confirmation_takes_the_first_steps(truth: np.ndarray, delay: int) -> None:
    left = present(tracker.confirm_late(truth, delay)).sum(axis=0)
    assert np.array_equal(left, np.maximum(present(truth).sum(axis=0) - delay, 0))


@given(SEEDS, st.integers(1, 5), st.integers(0, 5))
def test_lengths_of_false_tracks(seed: int, least: int, more: int) -> None:
    there = present(tracker.false_tracks(30, 0.5, (least, least + more), 10.0, rng(seed)))
    length, begin = there.sum(axis=0), there.argmax(axis=0)
    ends = begin + length
    assert (length <= least + more).all()
    assert ((length >= least) | (ends == 30)).all()
    assert (np.abs(np.diff(there.astype(int), axis=0)).sum(axis=0) <= 2).all()  # without holes


def test_a_swap_is_at_the_closest_step() -> None:
    truth = lines([0, 1, 2, 3, 4], [4, 3, 2.5, 1, 0])
    meetings = encounters(truth, 1.0)
    swapped = tracker.swap(truth, meetings, 1.0, rng(0))
    assert swapped[..., 0].T.tolist() == [[0, 1, 2.5, 1, 0], [4, 3, 2, 3, 4]]
    assert np.array_equal(tracker.swap(truth, meetings, 0.0, rng(0)), truth)


@given(truths(), SEEDS)
def test_swaps_exchange_and_lose_nothing(truth: np.ndarray, seed: int) -> None:
    """With certainty: one full switch a meeting, unless several meetings share a step."""
    meetings = encounters(truth, 10.0)
    swapped = tracker.swap(truth, meetings, 1.0, rng(seed))
    key = np.lexsort(np.moveaxis(truth, -1, 0), axis=1)
    again = np.lexsort(np.moveaxis(swapped, -1, 0), axis=1)
    assert np.array_equal(
        np.take_along_axis(truth, key[..., None], 1),
        np.take_along_axis(swapped, again[..., None], 1),
        equal_nan=True,
    )
    track = np.arange(truth.shape[1])
    for step in range(len(truth)):
        for first, second, *_ in meetings[meetings[:, 4] == step]:
            track[[first, second]] = track[[second, first]]
        assert np.array_equal(swapped[step, track], truth[step], equal_nan=True)


def test_a_merge_lasts_as_long_as_the_encounter() -> None:
    truth = lines([0, 1, 2, 3, 4], [4, 3, 2.5, 1, 0], [9, 9, 2.25, 9, 9])
    merged = tracker.merge(truth, encounters(truth, 1.0), 1.0, rng(0))
    first, second, third = merged[..., 0].T
    assert first.tolist() == [0, 1, 2.25, 3, 4]  # (2 + 2.5) / 2 at the one step
    assert np.isnan(second).tolist() == [False, False, True, False, False]
    assert third.tolist() == [9, 9, 2.25, 9, 9]  # merges with one other at a time


@given(truths(), SEEDS, st.floats(0, 1), st.integers(0, 5))
def test_fragments_go_on_under_a_new_number_after_the_gap(
    truth: np.ndarray, seed: int, probability: float, gap: int
) -> None:
    found = tracker.fragment(truth, probability, gap, rng(seed))
    assert (present(found).sum(axis=1) <= present(truth).sum(axis=1)).all()
    assert present(found)[:, truth.shape[1] :].any(axis=0).all()
    if gap == 0:  # a new number at once: nothing is lost
        assert np.array_equal(present(found).sum(axis=1), present(truth).sum(axis=1))


def test_fragments_are_as_long_as_can_be_counted() -> None:
    """Lost at every chance: one report, `gap` silent steps, one report under the next number."""
    found = tracker.fragment(lines([0, 1, 2, 3, 4, 5, 6, 7]), 1.0, 2, rng(0))
    assert found.shape[1] == 3
    for column, step in enumerate((0, 3, 6)):
        assert np.flatnonzero(present(found)[:, column]).tolist() == [step]


@pytest.mark.parametrize("name", sorted(SCENARIOS))
@pytest.mark.parametrize("state", ["point", "box"])
def test_without_errors_the_estimate_is_the_truth(name: str, state: str) -> None:
    truth, estimate = simulate(Scene(scenario=name, state=state), Tracker(), rng(1))
    result = evaluate(truth, estimate)
    assert result.tgospa == 0
    assert result.counts == {"missed": 0, "false": 0, "switch": 0}


def test_swaps_are_the_switches_of_the_metric() -> None:
    truth = lines([0, 10, 20, 30, 40, 50], [50, 40, 31, 20, 10, 0])
    swapped = tracker.swap(truth, encounters(truth, 12.0), 1.0, rng(0))
    result = evaluate(truth, swapped, cutoff=5.0, switch_penalty=1.0)
    assert result.counts == {"missed": 0, "false": 0, "switch": 2}
    assert result.total == pytest.approx(2.0, rel=1e-12)  # gamma^2 for each of the two


def test_errors_have_their_own_random_numbers() -> None:
    """Without false tracks the real ones are the same, row by row."""
    with_false = simulate(Scene(), Tracker(noise=1, detection=0.9, false_rate=0.5), rng(4))[1]
    without = simulate(Scene(), Tracker(noise=1, detection=0.9), rng(4))[1]
    real = csv_text(with_false).splitlines()
    assert set(csv_text(without).splitlines()) <= set(real)
    assert len(real) > len(csv_text(without).splitlines())


@pytest.mark.parametrize(
    ("record", "setting", "part"),
    [
        (Scene, {"scenario": "circus"}, 'scenario is "circus": must be one of crossing'),
        (Scene, {"targets": -1}, "targets is -1: must be a whole number, from 0 to "),
        (Scene, {"steps": 0}, "steps is 0"),
        (Scene, {"steps": 10**30}, "steps is 1000000000000000000000000000000: must be"),
        (Scene, {"targets": 10**6, "steps": 10**6}, "targets times steps must be at most"),
        (Scene, {"area": float("nan")}, "area is nan"),
        (Tracker, {"noise": float("inf")}, "noise is inf"),
        (Tracker, {"detection": 1.5}, "detection is 1.5: must be from 0 to 1"),
        (Tracker, {"latency": 0.5}, "latency is 0.5: must be a whole number"),
        (Tracker, {"false_length": (5, 2)}, "false-length is 5:2"),
        (Tracker, {"false_length": 5}, "false-length is 5: must be two numbers"),
    ],
)
def test_bad_settings(record: type, setting: dict, part: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(part)):
        record(**setting)


# --- writers --------------------------------------------------------------------------------------


@given(
    st.lists(
        st.tuples(
            st.text(st.characters(codec="utf-8", categories=["L", "N", "P"]), min_size=1),
            st.floats(allow_nan=False, allow_infinity=False),
        ),
        min_size=1,
        max_size=5,
        unique_by=lambda row: row[0],
    )
)
def test_csv_is_read_back_as_it_was(tmp_path_factory: pytest.TempPathFactory, rows: list) -> None:
    written = Trajectories(
        step=np.zeros(len(rows), int),
        track=np.arange(len(rows)),
        state=np.array([[x] for _, x in rows]),
        ids=np.array([name for name, _ in rows], dtype=object),
        times=np.array([2**53 + 1]),
        columns=("x",),
    )
    path = tmp_path_factory.mktemp("csv") / "t.csv"
    path.write_text(csv_text(written), encoding="utf-8", newline="")
    read = read_trajectories(path)
    assert read.times.tolist() == [2**53 + 1]
    states = dict(zip(read.ids[read.track], read.state[:, 0].tolist(), strict=True))
    assert states == dict(rows)


def test_benchmark_formats_line_by_line() -> None:
    boxes = Trajectories(
        step=np.array([0]),
        track=np.array([0]),
        state=np.array([[10.5, 20.0, 4.0, 8.25]]),
        ids=np.array(["7"], dtype=object),
        times=np.array([3]),
        columns=("left", "top", "width", "height"),
    )
    assert motchallenge_text(boxes, "truth") == "3,7,10.5,20.0,4.0,8.25,1,1,1\n"
    assert motchallenge_text(boxes, "estimate") == "3,7,10.5,20.0,4.0,8.25,1,-1,-1,-1\n"
    fields = kitti_text(boxes, "truth").split()
    assert fields[:6] == ["3", "7", "Car", "0", "0", "-10"]
    assert [float(x) for x in fields[6:10]] == [10.5, 20.0, 14.5, 28.25]
    assert fields[10:] == ["-1"] * 3 + ["-1000"] * 3 + ["-10"]
    assert kitti_text(boxes, "estimate").split()[10:] == [*fields[10:], "1"]


def test_benchmark_formats_refuse_what_they_cannot_hold() -> None:
    points = Trajectories.from_array(np.zeros((1, 1, 2)))
    with pytest.raises(InputError, match="hold boxes left,top,width,height, not x,y"):
        motchallenge_text(points, "truth")
    named = Trajectories(
        step=np.array([0]),
        track=np.array([0]),
        state=np.ones((1, 4)),
        ids=np.array(["car"], dtype=object),
        times=np.array([1]),
        columns=("left", "top", "width", "height"),
    )
    with pytest.raises(InputError, match='id "car" at 1 does not fit'):
        kitti_text(named, "truth")


# --- the command ----------------------------------------------------------------------------------


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("format_", OFFERED_FORMATS)
def test_the_same_seed_makes_the_same_bytes(invoke, tmp_path: Path, format_: str) -> None:
    every = ["--merges", "0.5", "--latency", "1", "--scenario", "dense", "--format", format_]
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        assert invoke("simulate", name, "--seed", seed, *every).status == 0
    first, same, other = (contents(tmp_path / name) for name in "abc")
    assert first == same
    assert all(first[name] != other[name] for name in first)


def test_a_folder_that_is_not_empty(invoke, write, tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    write("a/note.txt", "mine")
    status, out, err = invoke("simulate", "a")
    assert (status, out) == (2, "")
    assert err == "DIR a: is not empty; name another folder, or --force\n"
    assert invoke("simulate", "a", "--force").status == 0
    made = {"truth.csv", "estimate.csv", ".tgospa-eval.json"}
    assert set(contents(tmp_path / "a")) == {"note.txt"} | made
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a"]  # nothing temporary is left


def test_a_scene_is_written_anew(invoke, write, tmp_path: Path) -> None:
    assert invoke("simulate", "a", "-q") == (0, "", "")
    first = contents(tmp_path / "a")
    assert invoke("simulate", "a", "--seed", "1", "-q").status == 0
    assert contents(tmp_path / "a")["truth.csv"] != first["truth.csv"]
    assert invoke("simulate", "a", "--format", "kitti").status == 0
    assert set(contents(tmp_path / "a")) == {"gt.txt", "res.txt", ".tgospa-eval.json"}
    write("a/gt.txt", "mine")
    assert "has changed since" in invoke("simulate", "a", "--format", "kitti").err


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--scenario", "circus"], "circus"),
        (["--noise", "-1"], "noise is -1: must be from 0 to 1e+12"),
        (["--false-length", "x"], "'x': must be A:B or A, in steps"),
        (["--false-length", "1_0:20"], "'1_0:20': must be A:B or A, in steps"),
        (["--steps", "1_0"], "'1_0' is no whole number"),
        (["--seed", "-1"], "--seed"),
        (["--particles", "30"], "--particles needs --state cloud"),
        (["--format", "kitti", "--state", "point"], "--state point: kitti files hold boxes"),
    ],
)
def test_bad_options(invoke, tmp_path: Path, arguments: list[str], part: str) -> None:
    status, out, err = invoke("simulate", "a", *arguments)
    assert (status, out) == (2, "")
    assert part in err
    assert not (tmp_path / "a").exists()


SCRIPTS = sorted((ROOT / "sample_data").glob("*/make.py"))


def commands() -> list[str]:
    page = (ROOT / "sample_data" / "README.md").read_text(encoding="utf-8")
    return re.findall(r"^tgospa-eval simulate .*", page.replace("\\\n", " "), re.MULTILINE)


@pytest.mark.parametrize("command", commands(), ids=lambda command: command.split()[2])
def test_sample_data_is_made_by_its_commands(invoke, tmp_path: Path, command: str) -> None:
    arguments = shlex.split(command)[1:]
    assert invoke(*arguments).status == 0
    folder = arguments[1]
    made = contents(tmp_path / folder)
    del made[".tgospa-eval.json"]
    assert made == contents(ROOT / folder)


def test_all_sample_data_has_its_command() -> None:
    folders = {path.name for path in (ROOT / "sample_data").iterdir() if path.is_dir()}
    folders -= {"gate", *(script.parent.name for script in SCRIPTS)}  # judges the others
    assert {Path(command.split()[2]).name for command in commands()} == folders


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.parent.name)
def test_sample_data_is_made_by_its_script(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: Path
) -> None:
    monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path)])
    runpy.run_path(str(script), run_name="__main__")
    files = (path for path in script.parent.rglob("*") if path.is_file() and path != script)
    assert {path.relative_to(script.parent): path.read_bytes() for path in files} == {
        path.relative_to(tmp_path): path.read_bytes()
        for path in tmp_path.rglob("*.*")
        if path.is_file()
    }
