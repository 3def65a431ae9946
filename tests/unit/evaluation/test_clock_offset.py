"""The offset of the clock of an estimate: found where the scene determines it, else nothing."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Run, Write

from tgospa_eval import TgospaWarning, Trajectories, evaluate
from tgospa_eval.simulation import SCENARIOS, Scene, Tracker, simulate

BEGIN = datetime(2024, 5, 1, 12, tzinfo=UTC)


def moment(second: float, *, iso: bool) -> str:
    if not iso:
        return f"{second:.4f}".rstrip("0").rstrip(".")
    return f"{BEGIN + timedelta(microseconds=round(second * 1e6)):%Y-%m-%dT%H:%M:%S.%f}Z"


def table(side: Trajectories, moments: np.ndarray, *, iso: bool) -> str:
    rows = zip(side.step, side.track, side.state, strict=True)
    lines = (
        f"{side.ids[k]},{moment(float(moments[s]), iso=iso)},{x:.5f},{y:.5f}"
        for s, k, (x, y) in rows
    )
    return "\n".join(["id,t,x,y", *lines, ""])


def clock(invoke: Run, truth: str, estimate: str, *options: str) -> Any:
    done = invoke("inspect", truth, estimate, "-c", "10", *options, "--format", "json")
    assert done.status == 0, done.err
    return json.loads(done.out)["both"]["clock"]


def every(side: Trajectories, count: int, first: int) -> Trajectories:
    """Of so many steps one, counted from `first`."""
    rows = np.flatnonzero(side.step % count == first)
    times = side.times[first::count]
    return side.chosen(rows, (side.step[rows] - first) // count, times)


def found(invoke: Run, write: Write, seed: int, *, moved: bool) -> tuple[Any, float, float]:
    """What is said of a scene, the offset that it has, and half its step.

    In every other scene the two sides have other moments of the same motion.
    """
    rng = np.random.default_rng([seed, moved])
    scenario = list(SCENARIOS)[seed % len(SCENARIOS)]
    step = (1.0, 3.0, 0.1)[seed // 2 % 3]
    iso, parts = bool(seed // 6 % 2), 1 + (seed % 2) * int(rng.integers(1, 4))
    steps = int(rng.integers(40, 150))
    scene = Scene(scenario=scenario, targets=int(rng.integers(2, 12)), steps=steps * parts)
    tracker = Tracker(
        noise=float(rng.choice([0.1, 0.5, 1.0, 2.0])),
        detection=float(rng.uniform(0.7, 1)),
        false_rate=float(rng.choice([0, 0.2, 1.0])),
        confirmation=int(rng.integers(0, 4)),
        swaps=float(rng.choice([0, 0.5])),
        fragmentation=float(rng.choice([0, 0.02])),
    )
    truth, estimate = simulate(scene, tracker, rng)
    truth, estimate = every(truth, parts, 0), every(estimate, parts, int(rng.integers(parts)))
    long = steps * step
    offsets = (
        24.7,
        3600.0,
        step * float(rng.integers(1, 8)),
        float(rng.uniform(-1, 1)) * long,
        float(rng.uniform(0, 7200)),
    )
    offset = round(offsets[seed % 5], 3) if moved else 0.0
    stamps = [side.times * step / parts for side in (truth, estimate)]
    files = (
        write("truth.csv", table(truth, stamps[0], iso=iso)),
        write("estimate.csv", table(estimate, stamps[1] + offset, iso=iso)),
    )
    return clock(invoke, *files), offset, step / 2


@pytest.mark.parametrize("count", [3, pytest.param(200, marks=pytest.mark.slow)])
def test_found_within_half_a_step(invoke: Run, write: Write, count: int) -> None:
    """Offsets up to two hours, at least 95 % of them; nothing is said of what has none."""
    right = 0
    for seed in range(count):
        said, offset, half = found(invoke, write, seed, moved=True)
        right += abs((said["time_offset"] if said else 0.0) + offset) <= half
        said, *_ = found(invoke, write, seed, moved=False)
        assert said is None, (seed, said)
    assert right >= 0.95 * count


def lines(
    path: Callable[[np.ndarray], np.ndarray], steps: int = 120, noise: float = 0.5, offset: int = 0
) -> tuple[Trajectories, Trajectories]:
    """Truth (T, k, 2) by time, and an estimate with noise whose stamps are so many steps late."""
    states = path(np.arange(steps, dtype=float)[:, None])
    rng = np.random.default_rng(0)
    truth = Trajectories.from_array(states)
    estimate = Trajectories.from_array(states + rng.normal(0, noise, states.shape))
    return truth, replace(estimate, times=estimate.times + offset)


def in_plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.stack(np.broadcast_arrays(x, y), axis=-1)


PLACES = np.array([[10.0, 60.0, 150.0]])
SILENT = {
    "parked": lambda t: in_plane(PLACES + 0 * t, PLACES),
    "on circles": lambda t: in_plane(
        PLACES + 30 * np.cos(2 * np.pi * t / 20), 30 * np.sin(2 * np.pi * t / 20)
    ),
    "queueing": lambda t: in_plane(5.0 * np.arange(40) - 5.0 * (t % 1) + 0 * t, 0.0),
}


@pytest.mark.parametrize("motion", SILENT)
def test_nothing_where_the_data_do_not_say(invoke: Run, write: Write, motion: str) -> None:
    """At rest, where every shift fits; in periods, of which several fit alike."""
    for offset in (0, 7):
        sides = lines(SILENT[motion], offset=offset)
        files = (
            write(f"{k}.csv", table(side, side.times, iso=False)) for k, side in enumerate(sides)
        )
        assert clock(invoke, *files) is None


def test_nothing_of_another_recording_or_of_few_pairs(invoke: Run, write: Write) -> None:
    scene = Scene(scenario="dense", targets=20, steps=60)
    (truth, _), (_, other) = (
        simulate(scene, Tracker(noise=1.0), np.random.default_rng(seed)) for seed in (1, 2)
    )
    first = write("t.csv", table(truth, truth.times, iso=False))
    second = write("e.csv", table(other, other.times, iso=False))
    assert clock(invoke, first, second) is None
    few = "id,t,x,y\n" + "".join(f"1,{k},{9 * k},0\n" for k in range(6))
    late = "id,t,x,y\n" + "".join(f"1,{k + 40},{9 * k},0\n" for k in range(6))
    assert clock(invoke, write("t.csv", few), write("e.csv", late)) is None


def test_one_target_at_constant_velocity(invoke: Run, write: Write) -> None:
    """Positions are taken to be unbiased; the table says what no warning has."""
    truth, estimate = lines(lambda t: in_plane(2 * t + [[0.0]], 0.0), noise=2.0, offset=1)
    files = (
        write("t.csv", table(truth, truth.times, iso=False)),
        write("e.csv", table(estimate, estimate.times, iso=False)),
    )
    said = clock(invoke, *files)
    assert said["time_offset"] == -1
    assert 0.05 < said["uncertainty"] < 0.5  # two of 2 / (2 sqrt(120)) = 0.09
    assert said["saving"] < 0.5
    done = invoke("inspect", *files, "-c", "10")
    assert "fit better with --time-offset -1 (+/- " in done.out
    assert "warning: the clock" not in done.out


def test_the_offset_that_is_proposed_works(invoke: Run, write: Write) -> None:
    """With another offset given before it, an hour of a time zone, and in Python."""
    scene = Scene(scenario="crossing", targets=5, steps=80)
    truth, estimate = simulate(scene, Tracker(noise=0.5), np.random.default_rng(3))
    first = write("t.csv", table(truth, truth.times * 3.0, iso=True))
    second = write("e.csv", table(estimate, estimate.times * 3.0 + 3600, iso=True))
    done = invoke(first, second, "-c", "10", "-g", "5")
    assert "be 3600 s ahead (+/- " in done.err
    assert "use --time-offset -3600." in done.err
    assert "use --time-offset -3600." in invoke(first, second, "--time-offset", "-90").err
    assert (
        "warning" not in invoke(first, second, "-c", "10", "-g", "5", "--time-offset", "-3600").err
    )
    late = replace(estimate, times=estimate.times + 24.7)
    with pytest.warns(TgospaWarning, match=r"use time_offset=-24\.7\."):
        evaluate(truth, late, 10.0, 2, 5.0)


def test_stamps_that_doubles_do_not_tell_apart_name_no_offset() -> None:
    """Nanoseconds since 1970 beside numbers of steps, and one stamp that is small."""
    states = [
        *((0.1, -0.1), (0.6, 0.1), (-0.5, 0.4), (1.4, 0.8), (-0.1, -1.2), (-1.2, 0.4)),
        *((-0.9, 0.6), (-1.3, -1.9), (-1.7, 0.1), (-0.5, 1.6), (-1.4, -0.5), (-2.4, 0.4)),
        *((0.4, 1.7), (-2.2, -1.4), (-2.8, 0.7), (-0.6, 1.5), (-2.3, -0.9), (-2.6, 1.0)),
        *((-1.2, 1.4), (-1.6, 0.6), (-3.9, 2.5), (0.1, 2.2), (-1.3, 0.3), (-2.4, 4.5)),
    ]
    others = [
        *((0.5, 0.1), (0.7, -0.1), (-0.5, 0.5), (1.2, 0.9), (0.0, -1.0), (-1.4, 0.3)),
        *((-1.0, 0.4), (-1.0, -2.0), (-1.6, 0.0), (-0.2, 1.9), (-1.3, -1.0), (-2.4, 0.6)),
        *((0.6, 1.6), (-1.8, -1.7), (-3.0, 0.8), (-0.6, 1.9), (-2.3, -1.0), (-2.7, 0.8)),
        *((-1.5, 1.5), (-1.4, 0.8), (-4.0, 2.9), (0.0, 2.5), (-1.4, 0.1), (-2.4, 4.7)),
    ]
    begin, steps = 578721382704613377, np.arange(24) // 3
    for small in (False, True):
        times = begin + (steps - 1) % 8
        times[-1] = 526343 if small else times[-1]
        sides = (
            pd.DataFrame(own, columns=["x", "y"]).assign(id=np.arange(24) % 3, t=t)
            for t, own in ((steps, states), (times, others))
        )
        with pytest.warns(TgospaWarning) as caught:
            result = evaluate(*sides, 3.0, 2.0, 1.0)
        assert result.tgospa == pytest.approx(216**0.5)
        assert not any("inf" in str(one.message) for one in caught)


def displaced(seed: int) -> tuple[pd.DataFrame, pd.DataFrame, float]:
    """Ships that turn slowly, an estimate with a bias up to c / 2, and its offset."""
    rng = np.random.default_rng(seed)
    count, fine, length = int(rng.integers(3, 8)), 10, 200
    angle = rng.uniform(0, 2 * np.pi)
    bias = rng.uniform(0, 50) * np.array([np.cos(angle), np.sin(angle)])
    offset = float(rng.choice([0.08, 0.5, 2.0, 4.7]) * rng.choice([-1, 1]))
    noise, speed = float(rng.choice([1, 5, 10])), float(rng.choice([5, 10, 50]))
    place, course = rng.uniform(-5000, 5000, (count, 2)), rng.uniform(0, 2 * np.pi, count)
    turn, path = rng.normal(0, 0.01, count), []
    for _ in range(length * fine):
        path.append(place)
        place = place + speed / fine * np.stack([np.cos(course), np.sin(course)], axis=1)
        course = course + turn / fine
    names = ["id", "t", "x", "y"]
    truth = [(i, float(t), *path[t * fine][i]) for t in range(length) for i in range(count)]
    estimate = [
        (i, t + offset, *(path[round(t * fine)][i] + bias + rng.normal(0, noise, 2)))
        for t in (np.arange(10, length - 10, 2) + 0.3).tolist()
        for i in range(count)
    ]
    return pd.DataFrame(truth, columns=names), pd.DataFrame(estimate, columns=names), offset


@pytest.mark.parametrize("count", [6, pytest.param(200, marks=pytest.mark.slow)])
def test_an_offset_beside_a_bias(count: int, invoke: Run, write: Write) -> None:
    """The interval covers 95 % of those that are named; large ones all are."""
    named = inside = 0
    for seed in range(count):
        truth, estimate, offset = displaced(seed)
        files = (
            write(f"{name}.csv", side.to_csv(index=False))
            for name, side in (("truth", truth), ("estimate", estimate))
        )
        said = clock(invoke, *files, "-c", "100")
        if said is None:
            assert abs(offset) < 4.7, seed
            continue
        named += 1
        inside += abs(said["time_offset"] + offset) <= said["uncertainty"] * 1.001
    assert named > count / 2
    assert inside >= 0.95 * named - 0.5


def remedied(invoke: Run, files: tuple[str, str], *metric: str) -> tuple[str, float, float]:
    """Return the options that the warning names, and the missed states without and with them."""
    done = invoke(*files, *metric)
    named = re.search(r"or use (--[^.]*(?:\.\d+[^.]*)*)\. Do not", done.err)
    assert named is not None, done.err
    answer = invoke(*files, *metric, *named[1].split(), "-q", "--format", "json")
    shares = (
        json.loads(out)["counts"]["missed"]
        for out in (invoke(*files, *metric, "-q", "--format", "json").out, answer.out)
    )
    return named[1], *shares


WAVES = [
    (i, k, 40 * i + 3 * k, 30 * i + 8 * np.sin(k / 3 + i)) for i in range(3) for k in range(30)
]
NOISY = [
    (i, k, x + 0.6 * np.sin(7 * k + i), y + 0.6 * np.cos(5 * k + 2 * i)) for i, k, x, y in WAVES
]


@pytest.mark.parametrize(
    ("stamps", "options"),
    [
        ((lambda k: k, lambda k: k * 1000), "--time-scale 0.001"),
        ((lambda k: round(0.1 * k, 1), lambda k: k * 100), "--time-scale 0.001"),
        ((lambda k: k, lambda k: (k + 2) * 1000), "--time-scale 0.001 --time-offset -2"),
        (
            (lambda k: 10**17 + 10**8 * k + 37 * (k % 27), lambda k: 10**14 + 10**5 * k),
            "--time-scale 1000 --time-tolerance 1000",
        ),
        ((lambda k: k, lambda k: k + 5.25), "--time-offset -5.25"),
    ],
    ids=["milliseconds", "tenths", "late", "truncated", "offset"],
)
def test_the_remedy_joins_the_steps(
    invoke: Run, write: Write, stamps: tuple[Callable[[int], Any], ...], options: str
) -> None:
    """Errors look like a small shift, which would leave no step in both files."""
    files = (
        write(f"{n}.csv", "\n".join(("id,t,x,y", *(f"{i},{at(k)},{x},{y}" for i, k, x, y in rows))))
        for n, at, rows in zip("te", stamps, (WAVES, NOISY), strict=True)
    )
    named, before, after = remedied(invoke, tuple(files), "-c", "10", "-g", "5")
    assert named == options
    assert (before > 80, after) == (True, 0)


@pytest.mark.parametrize(
    ("stamps", "tolerance"),
    [
        (("{k}", lambda k: k + 0.02 * (k % 2)), "0.02"),
        (("{k}", lambda k: k + 0.005 * (k % 2)), "0.005"),
        (("{k}", lambda k: k + 0.02 * (k % 4 > 0)), "0.02"),
        (("{k}", lambda k: k + 0.03 * np.sin(k * k)), "0.03"),
        (("{k}", lambda k: k + 0.1 * np.sin(k * k)), "0.1"),
        ((lambda k: f"{k / 30:.6f}", lambda k: f"{k / 30:.3f}"), "0.00034"),
        ((lambda k: f"{k / 29.97:.6f}", lambda k: f"{k / 29.97:.3f}"), "0.0005"),
        ((lambda k: f"{k / 119.88:.6f}", lambda k: f"{int(1000 * k / 119.88) / 1000}"), "0.00091"),
        (("{k}", lambda k: k + 0.3), ""),
        (("{k}", lambda k: k + 0.2 + 0.03 * np.sin(k * k)), ""),
        (("{k}", lambda k: 0.7 * k), ""),
    ],
)
def test_stamps_with_jitter_are_joined(
    invoke: Run, write: Write, stamps: tuple[Any, ...], tolerance: str
) -> None:
    """A displacement along the direction of travel looks like another clock, but is none."""
    at = [one if callable(one) else one.format for one in stamps]
    files = [
        write(
            f"{k}.csv",
            "id,t,x,y\n"
            + "".join(f"{i},{at[k](k=t)},{x + k * 0.3},{y + k * 0.1}\n" for i, t, x, y in WAVES),
        )
        for k in (0, 1)
    ]
    told = invoke(*files, "-c", "10", "-g", "5").err
    if not tolerance:
        assert "nearly the same" not in told
        return
    assert f"; --time-tolerance {tolerance} makes each pair one step\n" in told
    assert "clock of the estimate" not in told
    told = invoke(*files, "-c", "10", "-g", "5", "--time-tolerance", tolerance).err
    assert "30 of 30 steps are in both files" in told


def test_stamps_that_never_meet_are_interpolated(invoke: Run, write: Write) -> None:
    between = [(i, 1.3 * k + 0.11) for i in range(3) for k in range(22)]
    rows = [(i, t, 40 * i + 3 * t, 30 * i + 8 * np.sin(t / 3 + i)) for i, t in between]
    files = (
        write("t.csv", "\n".join(("id,t,x,y", *(f"{i},{k},{x},{y}" for i, k, x, y in WAVES)))),
        write(
            "e.csv", "\n".join(("id,t,x,y", *(f"{i},{t + 7:.3f},{x},{y}" for i, t, x, y in rows)))
        ),
    )
    named, _, after = remedied(invoke, files, "-c", "5", "-g", "2")
    assert named.endswith("--interpolate truth --max-gap 5")
    assert after == 0


def test_near_stamps_are_counted_as_the_option_joins_them(invoke: Run, write: Write) -> None:
    """No double is 0.01 more than most of these."""
    files = (
        write("t.csv", "id,t,x\n" + "".join(f"1,{k},{3 * k}\n" for k in range(1, 31))),
        write("e.csv", "id,t,x\n" + "".join(f"1,{k}.01,{3 * k}\n" for k in range(1, 31))),
    )
    told = invoke(*files, "-c", "10", "-g", "5").err
    assert "30 pairs of timestamps are nearly the same, at most 0.01 apart" in told
    assert "--time-tolerance 0.01 makes each pair one step\n" in told


def test_times_of_another_column_are_proposed_where_both_have_it(invoke: Run, write: Write) -> None:
    rows = [(k, 1772366400 + k / 10, 3 * k) for k in range(1, 9)]
    files = (
        write("t.csv", "frame,timestamp,id,x\n" + "".join(f"{k},{t},1,{x}\n" for k, t, x in rows)),
        write("e.csv", "frame,id,x\n" + "".join(f"{k},1,{x}\n" for k, _, x in rows)),
    )
    told = invoke(*files, "-c", "10", "-g", "5").err
    assert "; --truth-columns t=frame reads both times from columns of one name" in told
    assert "--time-scale" not in told
    assert "8 of 8 steps" in invoke(*files, "-c", "10", "--truth-columns", "t=frame").err
