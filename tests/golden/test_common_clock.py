"""The common clock against its definition, and what has to hold of it whatever the trackers are."""

import itertools
from typing import Any

import numpy as np
import pandas as pd
import pytest
from examples import seeds
from oracles import programme

from tgospa_eval import ConfigError, evaluate

C, P, GAMMA, GAP, LENGTH = 20.0, 2.0, 10.0, 2.5, 24.0
SCENES = range(12)
MANY = range(12, 1040)
Tracks = dict[str, list[tuple[float, np.ndarray]]]


class Scene:
    """Objects that turn, and two trackers with periods and stamps of their own."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        self.truth: Tracks = {}
        for k in range(int(rng.integers(1, 4))):
            speed, angle = rng.uniform(0, 3), rng.uniform(0, 2 * np.pi)
            begin, end = (0.0, LENGTH) if k == 0 else sorted(rng.uniform(0, LENGTH, 2))
            stamps = np.arange(np.ceil(begin), np.floor(end) + 1)
            place, rows = np.array([60.0 * k, 0.0]), []
            for t in stamps.tolist():
                rows.append((t, place.copy()))
                place += speed * np.array([np.cos(angle), np.sin(angle)])
                angle += rng.normal(0, 0.2)
            self.truth[str(k)] = rows
        self.periods = (1.0, float(rng.choice([1.5, 2.0, 3.0])))
        self.trackers = [self.tracker(period) for period in self.periods]

    def tracker(self, period: float) -> Tracks:
        """Reports off by less than half of what a miss costs, some missing, and false ones."""
        rng, tracks = self.rng, {}
        offset = rng.uniform(0, period)
        for name in self.truth:
            error, rows = rng.uniform(0, C / 4), []
            for t in np.arange(offset, LENGTH, period).tolist():
                at = place_at(self.truth[name], t)
                if at is not None and rng.random() > 0.1:
                    angle = rng.uniform(0, 2 * np.pi)
                    rows.append((t, at + error * np.array([np.cos(angle), np.sin(angle)])))
            tracks[f"e{name}"] = rows
        for k in range(int(rng.integers(0, 4))):
            tracks[f"f{k}"] = [(float(rng.uniform(0, LENGTH)), rng.uniform(-500, 500, 2))]
        return {name: rows for name, rows in tracks.items() if rows}

    def value(self, tracks: Tracks, step: float, period: float, **more: Any) -> Any:
        return evaluate(
            table(self.truth), table(tracks), C, P, GAMMA,
            resample=step, max_gap=GAP, period=period, **more,
        )  # fmt: skip


def table(tracks: Tracks) -> pd.DataFrame:
    rows = [(name, t, *place) for name, own in tracks.items() for t, place in own]
    return pd.DataFrame(rows, columns=["id", "t", "x", "y"])


def place_at(rows: list[tuple[float, np.ndarray]], t: float) -> np.ndarray | None:
    """On the line between two states that are near enough in time."""
    for (a, first), (b, second) in itertools.pairwise(rows):
        if a <= t <= b and b - a <= GAP:
            return first + (t - a) / (b - a) * (second - first)
    return next((place for s, place in rows if s == t), None)


def by_definition(scene: Scene, tracks: Tracks, step: float, period: float) -> float:
    """The programme of the definition, of costs that are filled in one by one."""
    every = [t for rows in scene.truth.values() for t, _ in rows]
    first, last = np.ceil(min(every) / step), np.floor(max(every) / step)
    ticks = [k * step for k in range(int(first), int(last) + 1)]
    held: list[dict[float, tuple[float, np.ndarray]]] = []
    for rows in tracks.values():
        own: dict[float, tuple[float, np.ndarray]] = {}
        for k, (t, place) in enumerate(rows):
            low, high = t - period / 2, t + period / 2
            if k and t - rows[k - 1][0] <= 1.5 * period:
                low = (t + rows[k - 1][0]) / 2
            if k + 1 < len(rows) and rows[k + 1][0] - t <= 1.5 * period:
                high = (t + rows[k + 1][0]) / 2
            own |= {s: (t, place) for s in ticks if low - 1e-9 * period <= s < high - 1e-9 * period}
        held.append(own)
    truths = list(scene.truth.values())
    m, n = len(truths), len(held)
    costs = np.zeros((len(ticks), m + 1, n + 1))
    for k, s in enumerate(ticks):
        for i in range(m):
            exists = place_at(truths[i], s) is not None
            costs[k, i, n] = 0.5 * exists
            for j in range(n):
                costs[k, m, j] = 0.5 * (s in held[j])
                costs[k, i, j] = 0.5 * (exists + (s in held[j]))
                if exists and s in held[j]:
                    t, place = held[j][s]
                    at = place_at(truths[i], t)
                    if at is not None:
                        costs[k, i, j] = min(np.linalg.norm(place - at) / C, 1.0) ** P
    return programme(costs, C, P, GAMMA)


def check(scene: Scene) -> None:
    """The value, and what a report more or less does to it."""
    rng = scene.rng
    for tracks, period in zip(scene.trackers, scene.periods, strict=True):
        step = 0.5
        result = scene.value(tracks, step, period)
        total = result.total
        assert total == pytest.approx(by_definition(scene, tracks, step, period), rel=1e-7)
        assert result.parameters["period"] == period
        slack = 1e-9 * (total + 1)
        # One more report that is false.
        false = tracks | {"more": [(float(rng.uniform(0, LENGTH)), np.array([4e3, 4e3]))]}
        more = scene.value(false, step, period).total - total
        assert more >= 0.5 * C**P * (period / step - 1) * 0.5 - slack  # at an end half of it
        # One that is followed less: in a run of regular ones its period is missed.
        name = next(iter(tracks))
        if len(tracks[name]) > 3 and name.startswith("e"):
            k = int(rng.integers(1, len(tracks[name]) - 1))
            less = tracks | {name: [row for j, row in enumerate(tracks[name]) if j != k]}
            assert scene.value(less, step, period).total >= total - slack
        # A dead stretch.
        dead = {
            own: kept
            for own, rows in tracks.items()
            if (kept := [row for row in rows if not 6 < row[0] < 6 + 4 * period + 1])
        }
        found = scene.value(dead, step, period)
        assert found.missed >= result.missed - slack
        assert found.judged == result.judged


@pytest.mark.parametrize("seed", SCENES)
def test_the_value_is_that_of_the_definition(seed: int) -> None:
    check(Scene(seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", MANY)
def test_many_scenes(seed: int) -> None:
    check(Scene(seed))
    exchange(seed)


def exchange(seed: int) -> None:
    """Two parallel objects whose tracks exchange ids: as dear as at the tracker's own stamps."""
    rng = np.random.default_rng(seed)
    period, offset = float(rng.choice([1.0, 1.5, 2.0])), rng.uniform(0, 1)
    scene = Scene(seed)
    scene.truth = {
        k: [(float(t), np.array([3.0 * t, 15.0 * int(k)])) for t in range(25)] for k in "01"
    }
    stamps = np.arange(offset, 24, period).tolist()
    plain: Tracks = {
        k: [(t, np.array([3.0 * t, 15.0 * int(k) + rng.normal(0, 1)])) for t in stamps]
        for k in "01"
    }
    at = float(rng.uniform(8, 16))
    swapped = {
        k: [
            row if row[0] < at else (row[0], other[1])
            for row, other in zip(plain[k], plain[o], strict=True)
        ]
        for k, o in ("01", "10")
    }
    own = [
        evaluate(
            table(scene.truth), table(side), C, P, GAMMA, interpolate="truth", max_gap=GAP
        ).total
        for side in (plain, swapped)
    ]
    for step in (period, period / 2, period / 5):
        before, after = (scene.value(side, step, period).total for side in (plain, swapped))
        assert after - before == pytest.approx(own[1] - own[0], rel=0.1), step


@pytest.mark.parametrize("seed", SCENES)
def test_an_exchange_of_ids_costs_what_it_costs_whatever_the_clock(seed: int) -> None:
    exchange(seed)


@pytest.mark.parametrize("seed", seeds(4, 10))
def test_values_converge_as_the_clock_gets_finer(seed: int) -> None:
    """Costs of steps become an integral; switches are counted."""
    scene = Scene(seed)
    for tracks, period in zip(scene.trackers, scene.periods, strict=True):
        found = {}
        for step in (0.5, 0.25, 0.125, 1 / 128):
            result = scene.value(tracks, step, period)
            found[step] = step * (result.localisation + result.missed + result.false)
        limit = found.pop(1 / 128)
        ends = 2 * sum(map(len, [*tracks.values(), *scene.truth.values()]))
        for step, value in found.items():  # each end of a report or a truth is off by a step
            assert abs(value - limit) < ends * C**P / 2 * step / 4
        assert abs(found[0.125] - limit) <= abs(found[0.5] - limit) + 0.02 * limit


def test_the_cases_that_were_wrong() -> None:
    """Single false reports, an exchange, and a tracker that is dead most of the time."""
    truth = pd.DataFrame({"id": "a", "t": np.arange(0, 61.0), "x": np.arange(0, 61.0), "y": 0.0})
    clean = truth.assign(t=truth["t"] + 0.3, x=truth["x"] + 0.3)
    clutter = pd.DataFrame(
        {"id": [f"c{k}" for k in range(50)], "t": np.arange(50) + 0.7, "x": 5e3, "y": 5e3}
    )
    metric = {"cutoff": C, "switch_penalty": GAMMA, "resample": 1, "max_gap": 2}
    before = evaluate(truth, clean, **metric)
    after = evaluate(truth, pd.concat([clean, clutter]), **metric)
    assert after.total - before.total == pytest.approx(50 * C**2 / 2)
    run = pd.DataFrame({"id": "f", "t": np.arange(10) + 5.4, "x": 5e3, "y": 5e3})
    after = evaluate(truth, pd.concat([clean, run]), **metric)
    assert after.total - before.total == pytest.approx(10 * C**2 / 2)
    dead = evaluate(truth, clean[clean["t"] % 60 < 6], **metric)
    assert dead.missed >= 50 * C**2 / 2
    with pytest.raises(ConfigError, match="could fall between two steps; give at most 1"):
        evaluate(truth, clean, **metric | {"resample": 3})
    held = evaluate(truth, clean, **metric | {"resample": 3}, period=3)
    assert held.parameters["period"] == 3


def test_classes_have_the_period_of_the_whole_estimate() -> None:
    """A class with few reports is judged with the period of all reports."""
    times = np.arange(41.0)
    rows = [
        pd.DataFrame({"id": name, "t": own, "x": own, "y": y, "class": name})
        for name, own, y in (("car", times, 0.0), ("van", times, 50.0), ("van", times[::10], 50.0))
    ]
    truth, estimate = pd.concat(rows[:2]), pd.concat([rows[0], rows[2]])
    metric = {"cutoff": C, "switch_penalty": GAMMA, "resample": 1, "max_gap": 2}
    whole = evaluate(truth, estimate, **metric)
    for given in ({}, {"period": 1}):
        result = evaluate(truth, estimate, **metric, by="class", **given)
        assert result.missed == whole.missed == 36 * C**2 / 2
        periods = [part.parameters["period"] for part in (result, *result.results.values())]
        assert periods == [1, 1, 1]


def test_an_even_number_of_intervals_has_the_mean_of_the_middle_two() -> None:
    truth = pd.DataFrame({"id": "a", "t": [0, 2, 4, 8, 12], "x": 0.0})
    metric = {"cutoff": C, "switch_penalty": GAMMA, "resample": 1, "max_gap": 4}
    assert evaluate(truth, truth, **metric).parameters["period"] == 3
