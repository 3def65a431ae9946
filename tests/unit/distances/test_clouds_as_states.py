"""Particle clouds as states: files, base distance of the metric, associate and reduce."""

import json
import math
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Run, Write
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import cloud_distance, programme

from tgospa_eval import ConfigError, InputError, Trajectories, evaluate, read_trajectories, sensors
from tgospa_eval.api.sensors import Association
from tgospa_eval.common import progress
from tgospa_eval.common.frozen import recast
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import (
    CloudWasserstein,
    Distance,
    GaussianWasserstein,
    Geodesic,
    Mahalanobis,
    Norm,
    PairMahalanobis,
    Pairs,
    Reduction,
    Resources,
    SlicedWasserstein,
    cloud_wasserstein,
    near_pairs,
)
from tgospa_eval.distances import clouds as bounds
from tgospa_eval.distances.clouds import reduced
from tgospa_eval.formats import ReadOptions, read
from tgospa_eval.formats.write import TABLES
from tgospa_eval.show.draw_plane import Plane, ellipses
from tgospa_eval.show.style import STYLES
from tgospa_eval.tracks.alignment import TimeMatching, align
from tgospa_eval.tracks.clouds import Cloud, Clouds
from tgospa_eval.tracks.covariances import unpack

TRUTH = "id,t,weight,x,y\n1,0,.5,0,0\n1,0,.3,2,0\n1,0,.2,0,3\n2,0,1,50,50\n1,1,.5,9,9\n1,1,.5,7,9\n"
ESTIMATE = "id,t,weight,x,y\na,0,.6,1,0\na,0,.4,0,2\nb,0,1,50,51\na,1,1,8,9\n"
WHOLE = "--distance", "cloud-wasserstein"


def associate(first: Trajectories, second: Trajectories, **options: Any) -> Association:
    return recast(sensors.associate(first, second, **options), Association)


def scene(seed: int, tracks: int = 6, steps: int = 3, size: int = 2, most: int = 9) -> Trajectories:
    """Clouds of one to nine particles, some with two modes; coincident particles and points."""
    rng = np.random.default_rng(seed)
    rows = tracks * steps
    counts = rng.integers(1, most + 1, rows)
    first = np.concatenate(([0], np.cumsum(counts)))
    centre = np.repeat(rng.uniform(0, 20, (rows, size)), counts, axis=0)
    modes = rng.integers(0, 2, (first[-1], 1)) * 4
    points = np.round(centre + modes + rng.standard_normal((first[-1], size)))
    weights = rng.integers(1, 5, first[-1]).astype(float)
    weights /= np.repeat(np.add.reduceat(weights, first[:-1]), counts)
    clouds = Clouds(points=points, weights=weights, first=first)
    return Trajectories(
        step=np.repeat(np.arange(steps), tracks),
        track=np.tile(np.arange(tracks), steps),
        state=clouds.means,
        ids=np.array([str(k) for k in range(tracks)], dtype=object),
        times=np.arange(steps),
        columns=tuple(f"x{k}" for k in range(size)),
        clouds=clouds,
    )


def one_by_one(a: Trajectories, b: Trajectories, cutoff: float, **settings: object) -> dict:
    """Distances of all pairs of a step below the cutoff, each by itself."""
    found = {}
    for i, step in enumerate(a.step):
        for j in np.flatnonzero(b.step == step):
            value = cloud_wasserstein(*a.clouds[i], *b.clouds[int(j)], **settings)
            if value < cutoff:
                found[i, int(j)] = value
    return found


def below(cutoff: float, every: dict) -> dict:
    return {pair: value for pair, value in every.items() if value < cutoff}


def as_dict(pairs: Pairs) -> dict:
    keys = zip(pairs.truth_row.tolist(), pairs.estimate_row.tolist(), strict=True)
    return dict(zip(keys, pairs.distance.tolist(), strict=True))


# --- the base distance ----------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_gated_is_ungated_is_one_by_one(size: int, order: int) -> None:
    a, b = scene(1, size=size), scene(2, size=size)
    every = one_by_one(a, b, math.inf, order=order)
    for cutoff in (3.0, 8.0, 100.0):
        gated, whole = (
            near_pairs(
                a, b, cutoff, CloudWasserstein(order=order, gating=gating), Resources(jobs=jobs)
            )
            for gating, jobs in ((True, 1), (False, 3))
        )
        assert np.array_equal(gated.truth_row, whole.truth_row)
        assert np.array_equal(gated.estimate_row, whole.estimate_row)
        np.testing.assert_allclose(gated.distance, whole.distance, rtol=1e-12)
        assert as_dict(gated) == pytest.approx(below(cutoff, every), rel=1e-9)


def test_bounds_never_exceed_the_distance() -> None:
    for seed in range(20):
        a, b = scene(seed, size=1 + seed % 3), scene(seed + 100, size=1 + seed % 3)
        moments = [bounds._traces_and_factors(side.clouds) for side in (a, b)]
        rows = np.arange(len(a.step))
        squares = ((a.state - b.state) ** 2).sum(axis=1)
        bound = np.sqrt(squares + bounds._spread(moments, rows, rows))
        exact = [cloud_wasserstein(*a.clouds[i], *b.clouds[i]) for i in range(len(rows))]
        assert (bound <= np.array(exact) * (1 + 1e-12) + 1e-12).all()
        # Against a point it is exact.
        points = np.flatnonzero((a.clouds.counts == 1) | (b.clouds.counts == 1))
        np.testing.assert_allclose(bound[points], np.array(exact)[points], rtol=1e-9)


def test_bounds_save_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    solved = []
    whole = bounds.distance
    monkeypatch.setattr(bounds, "distance", lambda *pair: solved.append(1) or whole(*pair))
    a, b = scene(3, tracks=20), scene(4, tracks=20)
    counts = []
    for gating in (True, False):
        near_pairs(a, b, 2.0, CloudWasserstein(gating=gating))
        counts.append(len(solved))
        solved.clear()
    assert counts[0] * 5 < counts[1]


def test_inner_mahalanobis_scale_and_large_coordinates() -> None:
    a, b = scene(5), scene(6)
    matrix = [[4.0, 1.0], [1.0, 2.0]]
    near = near_pairs(a, b, 3, CloudWasserstein(inner="mahalanobis", covariance=matrix))
    assert as_dict(near) == pytest.approx(one_by_one(a, b, 3, covariance=matrix), rel=1e-9)
    near = near_pairs(a, b, 3, CloudWasserstein(scale=(0.5, 2.0)))
    by_scale = [[4.0, 0], [0, 0.25]]
    assert as_dict(near) == pytest.approx(one_by_one(a, b, 3, covariance=by_scale), rel=1e-9)
    far = [side.with_clouds(side.clouds.moved(side.clouds.points + 5e6)) for side in (a, b)]
    for distance in (CloudWasserstein(), CloudWasserstein(inner="mahalanobis", covariance=matrix)):
        here, there = near_pairs(a, b, 6, distance), near_pairs(*far, 6, distance)
        assert as_dict(there) == pytest.approx(as_dict(here), abs=1e-7)


def test_global_covariance_is_the_mean_of_all_clouds() -> None:
    a, b = scene(7), scene(8)
    mean = np.concatenate((a.clouds.covariances, b.clouds.covariances)).mean(axis=0)
    given_one = evaluate(a, b, distance=CloudWasserstein(inner="mahalanobis", covariance=mean))
    by_itself = evaluate(a, b, distance=CloudWasserstein(inner="mahalanobis"))
    assert by_itself.tgospa == given_one.tgospa
    np.testing.assert_allclose(by_itself.parameters["inner_cov"], mean)
    line = Trajectories.from_array(np.zeros((2, 1, 2)))
    with pytest.raises(ConfigError, match="needs the mean covariance of the clouds, but there are"):
        evaluate(line, line, distance=CloudWasserstein(inner="mahalanobis"))
    flat = a.with_clouds(a.clouds.moved(a.clouds.points * np.array([1.0, 0.0])))
    with pytest.raises(InputError, match="the mean covariance of the clouds is singular"):
        evaluate(flat, flat, distance=CloudWasserstein(inner="mahalanobis"))


@settings(max_examples=examples(12))
@given(st.integers(0, 10**6), st.sampled_from([1, 2]), st.sampled_from([1.0, 2.0]))
def test_tgospa_of_clouds_is_a_metric(seed: int, cloud_order: int, order: float) -> None:
    sides = [scene(seed + k, tracks=3, most=4) for k in range(3)]
    distance = CloudWasserstein(order=cloud_order)

    def value(a: int, b: int) -> float:
        return evaluate(sides[a], sides[b], 6, order, 2, distance=distance).tgospa

    assert value(0, 0) <= 1e-6
    assert value(0, 1) == pytest.approx(value(1, 0), rel=1e-9)
    assert value(0, 2) <= value(0, 1) + value(1, 2) + 1e-7


def test_reduction_belongs_to_the_distance() -> None:
    a, b = scene(9, most=40), scene(10, most=40)
    distance = CloudWasserstein(reduction=Reduction(size=5))
    result = evaluate(a, b, distance=distance)
    small = [
        side.with_clouds(reduced(side.clouds, Reduction(size=5), Resources())) for side in (a, b)
    ]
    assert result.tgospa == evaluate(*small, distance=CloudWasserstein()).tgospa
    assert result.parameters["reduce"] == 5
    assert evaluate(a, a, distance=distance).tgospa <= 1e-6
    with pytest.raises(ConfigError, match=r"reduction is 5: must be a Reduction\(size=\.\.\.\)"):
        CloudWasserstein(reduction=5)
    drawn = CloudWasserstein(reduction=Reduction(size=5, method="multinomial"))
    assert evaluate(a, a, distance=drawn).tgospa <= 1e-6


@pytest.mark.parametrize("seconds", [0.05, 0.4, 3.0])
def test_the_time_left_follows_from_the_pace(seconds: float) -> None:
    """Whatever a piece takes, and whatever came before: what is told is what is left."""
    now, said = [0.0], []
    stopwatch = Stopwatch(lambda: now[0])
    stopwatch.notify = lambda text: said.append((now[0], text))

    def pieces() -> Iterator[int]:
        for k in range(200):
            now[0] += seconds * (1 + k % 2)
            yield k

    works = [1 + k % 2 for k in range(200)]
    assert list(stopwatch.paced(pieces(), works, "200 clouds to reduce")) == list(range(200))
    ((at, text),) = said
    assert progress.PACED_FROM < at <= progress.PACED_FROM + 4 * seconds
    number, unit = text.removeprefix("200 clouds to reduce, about ").split()[:2]
    told = float(number) * {"s": 1, "min": 60}[unit]
    assert told == pytest.approx(now[0] - at, rel=0.1)
    assert stopwatch.progress.left is None  # what comes next has another pace


def test_the_user_is_told_of_long_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "PACED_FROM", 0.0)
    monkeypatch.setattr(progress, "ANNOUNCED_FROM", 0.0)
    monkeypatch.setattr(bounds, "MANY_PARTICLES", 5)
    said: list[str] = []
    stopwatch = Stopwatch()
    stopwatch.notify = said.append
    near_pairs(scene(11), scene(12), 5, CloudWasserstein(), Resources(jobs=1, stopwatch=stopwatch))
    assert re.fullmatch(
        r"\d+ distances of clouds of up to 9 particles; reduce=50 reduces them, "
        r"about 0 s left",
        said[0],
    )
    reduced(scene(11).clouds, Reduction(size=2), Resources(stopwatch=stopwatch))
    assert re.fullmatch(r"\d+ clouds to reduce, about 0 s left", said[1])


def test_clouds_that_are_too_large_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounds, "MAX_PARTICLES", 5)
    with pytest.raises(
        InputError,
        match=r'id "\d" with \d+ particles and id "\d" with \d+ particles at t \d: more than ',
    ):
        near_pairs(scene(13), scene(14), 100, CloudWasserstein())


# --- sliced ---------------------------------------------------------------------------------------


def sliced_one_by_one(a: Cloud, b: Cloud, distance: SlicedWasserstein) -> float:
    """From transports of single projections, on directions spelt out."""
    (x, u), (y, v) = a, b
    lines = np.linalg.inv(np.linalg.cholesky(distance.covariance or np.eye(2))).T
    angles = np.pi * (np.arange(distance.directions) + 0.5) / distance.directions
    lines = np.column_stack((np.cos(angles), np.sin(angles))) @ lines.T * (distance.scale or 1.0)
    q = distance.order
    values = np.array([cloud_wasserstein(x @ w, u, y @ w, v, order=q) for w in lines])
    return float(values.max() if distance.maximum else np.mean(values**q) ** (1 / q))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("maximum", [False, True])
def test_sliced_is_the_mean_or_the_largest_of_transports(order: int, maximum: bool) -> None:
    a, b = scene(1, tracks=4, steps=2), scene(2, tracks=4, steps=2)
    for inner in ({}, {"inner": "mahalanobis", "covariance": [[4, 1], [1, 2]], "scale": (2, 0.5)}):
        distance = SlicedWasserstein(order=order, maximum=maximum, directions=7, **inner)
        every = {
            (i, int(j)): sliced_one_by_one(a.clouds[i], b.clouds[int(j)], distance)
            for i, step in enumerate(a.step)
            for j in np.flatnonzero(b.step == step)
        }
        for cutoff in (2.0, 6.0, 100.0):
            gated, whole = (
                near_pairs(a, b, cutoff, replace(distance, gating=gating), Resources(jobs=jobs))
                for gating, jobs in ((True, 1), (False, 3))
            )
            assert as_dict(gated) == as_dict(whole)
            assert as_dict(gated) == pytest.approx(below(cutoff, every), rel=1e-9, abs=1e-9)


@settings(max_examples=examples(12))
@given(st.integers(0, 10**6), st.sampled_from([1, 2]), st.booleans(), st.sampled_from([2, 3]))
def test_sliced_is_a_pseudometric_below_the_whole_distance(
    seed: int, order: int, maximum: bool, size: int
) -> None:
    sides = [scene(seed + k, tracks=3, most=5, size=size) for k in range(3)]
    distance = SlicedWasserstein(order=order, maximum=maximum)

    def value(a: int, b: int) -> dict:
        return as_dict(near_pairs(sides[a], sides[b], 1e6, distance))

    ab, ba, bc, ac = value(0, 1), value(1, 0), value(1, 2), value(0, 2)
    whole = as_dict(near_pairs(sides[0], sides[1], 1e6, CloudWasserstein(order=order)))
    assert all(ab[pair] <= whole[pair] * (1 + 1e-9) + 1e-9 for pair in whole)
    assert {pair[::-1]: each for pair, each in ba.items()} == pytest.approx(ab, abs=1e-12)
    assert all(ac[i, k] <= ab[i, j] + bc[j, k] + 1e-9 for i, j in ab for (h, k) in bc if h == j)
    assert max(value(0, 0)[k, k] for k in range(len(sides[0].step))) == 0.0


def test_of_points_it_is_the_mean_of_projections_in_any_dimension() -> None:
    """A tight frame: the squares of V projections sum to V |x|^2 / d."""
    rng = np.random.default_rng(3)
    for size in (1, 2, 3, 4, 6):
        a, b = rng.normal(size=(2, 9, size)) + 6e6
        apart = np.linalg.norm(a - b, axis=1)
        assert SlicedWasserstein()(a, b) == pytest.approx(apart / np.sqrt(size), rel=1e-9)
        largest = SlicedWasserstein(maximum=True)(a, b)
        assert (largest <= apart * (1 + 1e-9)).all()
        assert (largest >= apart / np.sqrt(size) * (1 - 1e-9)).all()


def test_different_clouds_may_be_at_no_distance() -> None:
    """Which is why it is no metric: both have the same projections on two orthogonal directions."""
    frames = [
        pd.DataFrame({"id": 1, "t": 0, "weight": 0.5, "x": x, "y": y})
        for x, y in (([1, -1], [0, 0]), ([0, 0], [1, -1]))  # directions are (1, 1) and (-1, 1)
    ]
    few, many = (
        evaluate(*frames, cutoff=9, distance=SlicedWasserstein(directions=count)).tgospa
        for count in (2, 3)
    )
    assert few <= 1e-7
    assert many > 0.1


@pytest.mark.parametrize("name", ["sliced-wasserstein", "max-sliced-wasserstein"])
def test_sliced_from_the_command_line(name: str, write: Write, invoke: Run) -> None:
    truth, estimate = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    options = ("--distance", name, "-c", "10", "-g", "5", "--directions", "6", "--seed", "3")
    answer = invoke(truth, estimate, *options, "--format", "json")
    found = json.loads(answer.out)
    distance = SlicedWasserstein(maximum=name[0] == "m", directions=6, seed=3)
    result = evaluate(truth, estimate, cutoff=10, switch_penalty=5, distance=distance)
    assert found["tgospa"] == result.tgospa
    recorded = {key: found["parameters"][key] for key in ("distance", "directions", "seed")}
    assert recorded == {"distance": name, "directions": 6, "seed": 3}
    assert (found.get("localisation_spread") is None) == distance.maximum
    for wrong, message in (
        (("--directions", "1"), "directions is 1: must be a whole number, 2 or more"),
        (("--reduce-method", "atl"), "--reduce-method needs --reduce N"),
    ):
        assert message in invoke(truth, estimate, "--distance", name, *wrong).err
    assert invoke("associate", truth, estimate, "--distance", name, "-c", "9").status == 0
    with pytest.raises(ConfigError, match=f"the distance {name} has no known derivative"):
        evaluate(truth, estimate, cutoff=10, distance=distance).gradient()


# --- the record -----------------------------------------------------------------------------------


def test_chosen_rows_keep_their_particles() -> None:
    side = scene(15)
    rows = np.array([1, 4, 7])
    part = side.chosen(rows, side.step[rows], side.times)
    for k, row in enumerate(rows):
        assert np.array_equal(part.clouds[k][0], side.clouds[row][0])
    other = Trajectories.from_array(np.zeros((2, 1, 2)), side.columns)
    aligned = align(side, other, TimeMatching(grid="common"))
    assert len(aligned.truth.clouds) == len(aligned.truth.step) == 12


def test_merging_changes_no_measure() -> None:
    clouds = scene(16).clouds
    merged = clouds.merged()
    assert len(merged.points) < len(clouds.points)
    for row in range(len(clouds)):
        assert cloud_wasserstein(*clouds[row], *merged[row]) <= 1e-7
    np.testing.assert_allclose(merged.covariances, clouds.covariances, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros(3)}, "do not fit"),
        ({"first": [0, 2, 2, 3]}, "first must increase strictly from 0 to the 3 particles"),
        ({"first": [0, 2]}, "first must increase strictly from 0 to the 3 particles"),
        ({"points": [[0, np.nan]] * 3}, "points must be finite"),
        ({"weights": [2, -1, 1]}, "weights must be >= 0 and sum to 1"),
        ({"weights": [0.5, 0.2, 1]}, "weights must be >= 0 and sum to 1"),
    ],
)
def test_wrong_records(change: dict, message: str) -> None:
    good = {"points": np.zeros((3, 2)), "weights": [0.5, 0.5, 1], "first": [0, 2, 3]}
    with pytest.raises(InputError, match=message):
        Clouds(**(good | change))


def test_states_are_the_means() -> None:
    side = scene(17)
    with pytest.raises(InputError, match="states of clouds must be the means of their particles"):
        Trajectories(**{**vars(side), "state": side.state + 1})


# --- files ----------------------------------------------------------------------------------------


def test_rows_of_one_id_and_time_are_a_cloud(write: Write) -> None:
    side = read_trajectories(write("t.csv", TRUTH))
    assert side.clouds.counts.tolist() == [3, 1, 2]
    np.testing.assert_allclose(side.state, [(0.6, 0.6), (50, 50), (8, 9)])
    points = read_trajectories(write("p.csv", "id,t,x,weight\n1,0,5,70\n"))
    assert points.clouds is None  # a weight of another kind
    single = read_trajectories(write("p.csv", "id,t,x,weight\n1,0,5,70\n"), clouds=True)
    assert single.clouds.weights.tolist() == [1]


def test_value_of_the_worked_example(write: Write, invoke: Run) -> None:
    """Distances sqrt(1.6) and 1, then two particles at 1 from a point."""
    paths = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    status, out, _ = invoke(*paths, *WHOLE, "-c", "10", "-g", "2", "--format", "json")
    assert status == 0
    assert json.loads(out)["total"] == pytest.approx(1.6 + 1 + 1, rel=1e-12)
    status, out, _ = invoke(*paths, *WHOLE, "--cloud-order", "1", "-c", "10", "--format", "json")
    result = json.loads(out)
    assert result["total"] == pytest.approx(1.2**2 + 1 + 1, rel=1e-12)
    assert result["parameters"]["cloud_order"] == 1
    status, out, err = invoke(*paths, "-c", "10", "-g", "2", "--format", "json")
    assert json.loads(out)["total"] == pytest.approx(0.2**2 + 1, rel=1e-12)
    assert "3 clouds of 6 particles are compared by their means; --distance cloud-w" in err
    status, out, _ = invoke("inspect", *paths, *WHOLE, "--format", "json")
    assert status == 0
    assert json.loads(out)["truth"]["deviation"]["y"]["max"] == pytest.approx(1.2, rel=1e-12)


@pytest.mark.parametrize("cloud_order", [1, 2])
@pytest.mark.parametrize("order", [1.0, 2.0])
def test_value_is_the_optimum_of_plain_programmes(
    write: Write, cloud_order: int, order: float
) -> None:
    """Of one for each pair of clouds, and one of the definition over their distances."""
    rng = np.random.default_rng(13)
    sides: list[dict] = [{}, {}]
    texts = ["id,t,w,x,y\n", "id,t,w,x,y\n"]
    for number, step, track in np.ndindex(2, 3, 3):
        count = int(rng.integers(0, 4))  # none: absent at that step
        points = 2 * track + rng.integers(-3, 4, (count, 2)) / 2
        weights = rng.integers(1, 5, count)
        rows = [f"{track},{step},{w},{x},{y}\n" for w, (x, y) in zip(weights, points, strict=True)]
        texts[number] += "".join(rows)
        if count:
            sides[number][step, track] = points, weights / weights.sum()
    c, gamma = 3.0, 1.0
    costs = np.zeros((3, 4, 4))
    for k, i, j in np.ndindex(3, 4, 4):
        a, b = sides[0].get((k, i)), sides[1].get((k, j))
        costs[k, i, j] = 0.5 * (a is not None) + 0.5 * (b is not None)
        if a and b:
            costs[k, i, j] = min(cloud_distance(a, b, cloud_order) / c, 1) ** order
    truth, estimate = (read_trajectories(write(f"{k}.csv", texts[k]), clouds=True) for k in (0, 1))
    distance = CloudWasserstein(order=cloud_order)
    result = evaluate(truth, estimate, c, order, gamma, distance=distance)
    assert result.total == pytest.approx(programme(costs, c, order, gamma), rel=1e-8)


def test_formats_hold_the_same(write: Write, tmp_path: Path) -> None:
    side = read_trajectories(write("t.csv", TRUTH))
    for suffix, text in TABLES.items():
        path = tmp_path / f"copy{suffix}"
        path.write_bytes(text(side))
        copy = read_trajectories(path)
        assert np.array_equal(copy.clouds.points, side.clouds.points)
        assert np.array_equal(copy.clouds.first, side.clouds.first)
        assert copy.ids.tolist() == side.ids.tolist()
    frame = pd.read_csv(write("t.csv", TRUTH))
    result = evaluate(frame, frame, distance="cloud-wasserstein")
    assert result.tgospa == 0
    assert len(result.labels.truths) == 2


def test_npz_with_one_array_of_positions(tmp_path: Path) -> None:
    path = tmp_path / "cloud.npz"
    ids, weight, x = np.array([1, 1, 2]), np.array([0.5, 0.5, 1]), np.arange(12.0).reshape(3, 4)
    np.savez(path, id=ids, t=np.zeros(3), weight=weight, x=x)
    side = read_trajectories(path)
    assert side.columns == ("x0", "x1", "x2", "x3")
    assert side.clouds.counts.tolist() == [2, 1]
    np.savez(path, id=ids, t=np.zeros(3), weight=weight, x=x[:, :2])
    assert read_trajectories(path).columns == ("x", "y")
    np.savez(path, id=ids, t=np.zeros(2), weight=weight, x=x)
    with pytest.raises(InputError, match=r"they must be columns of one length, x may be \(P, d\)"):
        read_trajectories(path)
    for data in (b"PK\x03\x04 and no archive", b""):
        path.write_bytes(data)
        with pytest.raises(InputError, match=r"cloud.npz: (not a readable npz|the file is empty)"):
            read_trajectories(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,0,.5,0,0\n1,0,-.5,1,1\n", 'line 3: the weight of a particle of id "1", t 0 is negativ'),
        ("1,0,,0,0\n1,0,1,1,1\n", 'line 2: the weight of a particle of id "1", t 0 is blank; w'),
        ("1,0,1,0,0\n2,5,0,0,0\n2,5,0,1,1\n", 'line 3: all weights of id "2", t 5 are zero; wei'),
        ("1,0,inf,0,0\n1,0,1,1,1\n", 'column "weight": infinite: "inf"'),
    ],
)
def test_wrong_weights(write: Write, invoke: Run, text: str, message: str) -> None:
    path = write("t.csv", "id,t,weight,x,y\n" + text)
    for options in ((), WHOLE):
        status, _, err = invoke(path, path, "-c", "1", *options)
        assert status == 3
        assert message in err


def test_huge_and_tiny_weights_keep_their_ratio(write: Write) -> None:
    for small, large in (("5e307", "1.5e308"), ("1e-123", "3e-123"), (".25", ".75")):
        text = f"id,t,weight,x\n1,0,{small},0\n1,0,{large},4\n"
        side = read_trajectories(write("t.csv", text))
        np.testing.assert_allclose(side.clouds.weights, [0.25, 0.75], rtol=1e-15)


def test_weights_that_sum_to_one_are_kept(write: Write) -> None:
    rows = "".join(f"1,0,{1 / 30!r},{k}\n" for k in range(30))
    side = read_trajectories(write("t.csv", "id,t,weight,x\n" + rows))
    assert set(side.clouds.weights.tolist()) == {1 / 30}


def test_texts_beside_points_are_no_weights(write: Write, invoke: Run) -> None:
    """A column w may say anything as long as nobody needs weights."""
    path = write("t.csv", "id,t,x,y,w\n1,0,1,0,heavy\n2,0,5,5,\n")
    status, out, err = invoke(path, path, "-c", "1", "-g", "1", "--format", "json")
    assert (status, json.loads(out)["total"]) == (0, 0)
    assert "columns not used: w" in err
    frame = pd.read_csv(path)
    assert evaluate(frame, frame).tgospa == 0
    status, _, err = invoke(path, path, "-c", "1", *WHOLE)
    assert (status, 'line 2, column "w": not a number: "heavy"; weights must' in err) == (3, True)
    with pytest.raises(InputError, match='row 0, column "w": not a number: "heavy"'):
        evaluate(frame, frame, distance="cloud-wasserstein")
    path = write("t.csv", "id,t,x,y,w\n1,0,1,0,heavy\n1,0,5,5,1\n")
    status, _, err = invoke(path, path, "-c", "1")
    assert (status, 'line 2, column "w": not a number: "heavy"' in err) == (3, True)


def test_equal_clouds_in_another_order(write: Write, invoke: Run) -> None:
    """Also reduced: what is kept does not depend on the order of the particles."""
    rng = np.random.default_rng(0)
    weights, points = rng.dirichlet(np.ones(40)), rng.standard_normal((40, 2))
    paths = []
    for name, factor, order in (("a", 1, np.arange(40)), ("b", 7, rng.permutation(40))):
        table = np.column_stack((factor * weights, points))[order].tolist()
        rows = "".join(f"1,0,{w},{x},{y}\n" for w, x, y in table)
        paths.append(write(f"{name}.csv", "id,t,weight,x,y\n" + rows))
    for options in ((), ("--cloud-order", "1"), ("--reduce", "5"), ("--inner", "mahalanobis")):
        answer = invoke(*paths, *WHOLE, "-c", "10", "-g", "2", *options, "--format", "json")
        assert json.loads(answer.out)["tgospa"] <= 1e-9


def test_repeated_rows_without_weight(write: Write, invoke: Run) -> None:
    path = write("t.csv", "id,t,x\n1,0,1\n1,0,2\n")
    status, _, err = invoke(path, path, *WHOLE)
    assert status == 3
    assert 'line 3: id "1" at t 0 is already in line 2' in err
    assert "particles of one object, add a column" in err


def test_what_is_normalised_and_left_out_is_said(write: Write) -> None:
    text = "id,t,weight,x\n1,0,3,0\n1,0,4,1\n2,0,0,5\n2,0,1,6\n2,1,1,\n3,0,1,9\n"
    reading = read(write("t.csv", text), ReadOptions(clouds=True))
    assert reading.trajectories.clouds.counts.tolist() == [2, 1, 1]
    assert reading.trajectories.state[:, 0].tolist() == [4 / 7, 6, 9]
    said = "\n".join(reading.notices)
    assert "1 cloud has weights that do not sum to 1 (the farthest to 7): normalised" in said
    assert "1 particle of weight 0 left out" in said
    assert reading.left_out == {"blank": 1}


def test_a_cloud_is_inside_a_region_where_its_mean_is(write: Write) -> None:
    reading = read(write("t.csv", TRUTH), ReadOptions(region="x=0.5:10"))
    assert reading.trajectories.clouds.counts.tolist() == [3, 2]
    assert reading.left_out == {"region": 1}


def test_options_that_do_not_fit(write: Write, invoke: Run) -> None:
    path = write("t.csv", TRUTH)
    for options, message in (
        (("--reduce", "5"), "--reduce is for distances of clouds, not for euclidean"),
        ((*WHOLE, "--polish", "1"), "--polish needs --reduce N"),
        (
            (*WHOLE, "--reduce", "2", "--reduce-method", "top", "--seed", "1"),
            "--seed is for the methods sliced, recursive, atl, kmeans, systematic, stratified, mul",
        ),
        ((*WHOLE, "--inner-cov", "global"), "--inner-cov is for --inner mahalanobis"),
        ((*WHOLE, "--cloud-order", "3"), "3 is not in the range 1<=x<=2"),
        ((*WHOLE, "--periodic", "x"), "--periodic is for the norms and gaussian-wasserstein"),
    ):
        status, _, err = invoke(path, path, *options)
        assert status == 2
        assert message in err
    singular = write("p.csv", "1,1\n1,1\n")
    status, _, err = invoke(path, path, *WHOLE, "--inner", "mahalanobis", "--inner-cov", singular)
    assert status == 3
    assert "p.csv: covariance is not positive definite" in err


# --- verbs ----------------------------------------------------------------------------------------


def test_associate(write: Write, invoke: Run, tmp_path: Path) -> None:
    a = write("a.csv", TRUTH)
    b = write("b.csv", ESTIMATE.replace("b,0,1,50,51", "b,0,1,90,90"))
    files = "--cost-matrix", "costs.csv", "--cross-cov", "cross.csv"
    status, out, err = invoke("associate", a, b, "-c", "4", *WHOLE, *files, "--format", "json")
    assert status == 0, err
    document = json.loads(out)
    assert document["counts"] == {"steps": 2, "associated": 2, "alone_a": 1, "alone_b": 1}
    assert document["total"] == pytest.approx(np.sqrt(1.6) + 1 + 4)
    assert [(row["id_a"], row["id_b"]) for row in document["associations"]] == [
        ("1", "a"),
        ("2", None),
        (None, "b"),
        ("1", "a"),
    ]
    costs = pd.read_csv(tmp_path / "costs.csv")  # all pairs, also those beyond the cutoff
    assert costs[["t", "id_a", "id_b"]].to_numpy().tolist() == [
        [0, 1, "a"], [0, 1, "b"], [0, 2, "a"], [0, 2, "b"], [1, 1, "a"],
    ]  # fmt: skip
    near = costs["distance"] < 4
    np.testing.assert_allclose(costs["distance"][near], [np.sqrt(1.6), 1])
    np.testing.assert_allclose(costs["mean_distance"][near], [0.2, 0], atol=1e-12)
    assert costs["associated"].tolist() == near.astype(int).tolist()
    far = 0.5 * (90**2 + 90**2) + 0.3 * (88**2 + 90**2) + 0.2 * (90**2 + 87**2)
    assert costs["distance"][1] == pytest.approx(np.sqrt(far))
    same = *files[:3], "costs.csv", "--force"
    status, _, err = invoke("associate", a, b, "-c", "4", *WHOLE, *same)
    assert (status, "--cross-cov costs.csv: is also read or written by this command" in err) == (
        2,
        True,
    )
    status, _, err = invoke("associate", a, b, "-c", "4", "--cost-matrix", b, "--force")
    assert (status, "--cost-matrix" in err, "is also read or written by this command" in err) == (
        2,
        True,
        True,
    )
    status, _, err = invoke("reduce", a, a, "-n", "1", "--force")
    assert (status, "is also read or written by this command" in err) == (2, True)
    cross = pd.read_csv(tmp_path / "cross.csv")
    np.testing.assert_allclose(
        cross.loc[0, ["cov_x_x", "cov_x_y", "cov_y_x", "cov_y_y"]].astype(float),
        [0.24, -0.48, -0.36, 0.72],
        atol=1e-12,
    )
    status, _, err = invoke("associate", a, b, "-c", "4", *WHOLE, *files)
    assert (status, "costs.csv: exists; name another file, or --force" in err) == (2, True)


def test_the_folder_of_an_association(write: Write, invoke: Run, tmp_path: Path) -> None:
    a, b = write("a.csv", TRUTH), write("b.csv", ESTIMATE.replace("b,0,1,50,51", "b,0,1,90,90"))
    plain = "associate", a, b, "-c", "4", *WHOLE
    status, out, err = invoke(*plain, "-o", "pairs", "--format", "json", "--pictures", "png")
    assert status == 0, err
    assert "to pairs/; open pairs/report.html" in err
    files = {file.name for file in (tmp_path / "pairs").iterdir() if file.name[0] != "."}
    assert files == {"associate.json", "associations.csv", "plane.png", "report.html"}
    assert (tmp_path / "pairs" / "associate.json").read_text(encoding="utf-8") == out
    assert invoke(*plain, "--format", "csv").out == (
        tmp_path / "pairs" / "associations.csv"
    ).read_text(encoding="utf-8")
    assert invoke(*plain, "-o", "pairs", "-q").status == 0  # its own files are replaced
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").touch()
    status, out, err = invoke(*plain, "-o", "other")
    assert (status, out) == (2, "")
    assert "--output other: is not empty; name another folder, or --force" in err
    assert invoke("associate", a, b, "-c", "4", "-o", "x", "--cost-matrix", "x/y").status == 2


def test_what_is_drawn_of_an_association(tmp_path: Path) -> None:
    """Costs by step and by track are the sum that was minimised; particles and pairs are there."""
    found = associate(scene(0), scene(1), cutoff=9.0, distance="cloud-wasserstein")
    data = found.plot_data.document
    assert sum(map(sum, data["costs"].values())) == pytest.approx(found.total, rel=1e-6)
    tables = data["tracks"]
    lost = [sum(tables[side]["unassigned"]) for side in ("truth", "estimate")]
    paired = sum(tables["truth"]["localisation"])
    assert paired + sum(lost) == pytest.approx(found.total, rel=1e-6)
    assert [len(side.unassigned) for side in found.plot_data.sides] == list(found.unassigned)
    for side, held in zip(found.plot_data.sides, (scene(0), scene(1)), strict=True):
        several = held.clouds.counts[held.clouds.counts > 1].sum()
        assert len(side.particles["row"]) <= several  # equal ones once, if they are thinned
        assert len(side.particles["row"]) == several
    found.save(tmp_path / "folder")
    (tmp_path / "a").touch()
    with pytest.raises(ConfigError, match="is a file; name a folder"):
        found.save(tmp_path / "a")
    drawn = found.plot_plane(columns=("x1", "x0")).axes
    assert [axis.get_xlabel() for axis in drawn] == ["x1", "x1"]
    assert {line.get_label() for line in drawn[0].get_lines()} >= {"pairs", "missed", "false"}


def test_an_association_of_nothing() -> None:
    none = Trajectories.from_array(np.zeros((0, 0, 2)))
    found = associate(none, none, cutoff=1.0)
    assert "0 associated" in found.to_html()
    assert len(found.plot_plane().axes) == 1
    alone = Trajectories.from_array(np.zeros((1, 1, 2)))
    one = Trajectories.from_array(np.full((1, 1, 2), np.nan))
    found = associate(alone, one, cutoff=1.0)
    assert found.unassigned == (1, 0)
    assert "1 of A" in found.to_html()
    assert found.plot_plane()


C = np.array([[4.0, 1.2], [1.2, 1.0]])


@pytest.mark.parametrize(
    ("distance", "cutoff"),
    [
        (Norm(name="euclidean", power=2.0, scale=(0.5, 2.0)), 3.0),
        (Norm(name="manhattan", power=1.0), 3.0),
        (Norm(name="chebyshev", power=np.inf, scale=(0.5, 2.0)), 3.0),
        (Mahalanobis(covariance=C, scale=(0.5, 2.0)), 2.0),
        (PairMahalanobis(), 2.0),
        (GaussianWasserstein(scale=(2.0, 1.0)), 3.0),
        (CloudWasserstein(inner="mahalanobis", covariance=C), 2.0),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_a_gate_is_where_the_distance_of_means_is_the_cutoff(
    distance: Distance, cutoff: float
) -> None:
    """Partners that lie on the outline that is drawn, of equal covariance, are at the cutoff."""
    gaussian = "gaussian" in distance.kinds
    place, spread = np.array([[[10.0, 20.0]]]), {"covariance": C} if gaussian else {}
    a = Trajectories.from_array(place, **spread)
    found = associate(a, a, cutoff=cutoff, distance=distance)
    seen = found.plot_data
    plane = Plane(data=seen, across="x", up="y", style=STYLES["screen"])
    power = seen.document["gate"]["power"] or np.inf
    outline = ellipses(plane.places["truth"], plane.gates, power)[0]
    for share, count in ((1 - 1e-9, 1), (1 + 1e-9, 0)):
        for point in outline[::5]:
            b = Trajectories.from_array(place + share * (point - place), **spread)
            assert associate(a, b, cutoff=cutoff, distance=distance).chosen.sum() == count


def test_a_gate_on_the_map() -> None:
    """10 km at 60 degrees north: 0.09 degrees of latitude, twice as many of longitude."""
    a = Trajectories.from_array(np.array([[[60.0, 10.0]]]), ("lat", "lon"))
    found = associate(a, a, cutoff=10_000.0, distance="haversine")
    lat, _, lon = np.sqrt(found.gates[0])
    assert lat == pytest.approx(np.degrees(10_000 / 6371008.8))
    assert lon == pytest.approx(2 * lat)
    pytest.importorskip("pyproj")
    high = Trajectories.from_array(np.array([[[60.0, 10.0, 500.0]]]), ("lat", "lon", "alt"))
    found = associate(high, high, cutoff=100.0, distance=Geodesic(vertical_weight=4.0))
    lat, _, lon, _, _, alt = np.sqrt(found.gates[0])
    assert (lon / lat, alt) == pytest.approx((2, 25))
    for column, size in enumerate((lat, lon, alt)):
        place = high.dense() + np.eye(3)[column] * size
        far = found.distance(high.dense(), place)[0, 0]
        assert far == pytest.approx(100, rel=0.01)
    boxes = Trajectories.from_array(np.ones((1, 1, 4)), ("left", "top", "width", "height"))
    assert associate(boxes, boxes, cutoff=0.5, distance="iou").gates is None
    assert len(associate(boxes, boxes, cutoff=0.5).plot_plane().axes) == 1  # not of centres


def test_associate_says_what_a_filter_leaves(write: Write, invoke: Run) -> None:
    path = write("a.csv", "id,t,class,weight,x\n1,0,car,.5,0\n1,0,car,.5,2\n2,0,van,1,9\n")
    status, out, _ = invoke("associate", path, path, "-c", "1", "--class", "car", "--format", "csv")
    assert (status, out.splitlines()[1:]) == (0, ["0,1,1,0.0,0.0"])
    status, _, err = invoke("associate", path, path, "-c", "1", "--class", "bus")
    assert (status, 'no row is of that class; there are "car", "van"' in err) == (2, True)


def test_associate_with_a_covariance_of_each_pair(write: Write, invoke: Run) -> None:
    paths = write("a.csv", TRUTH), write("b.csv", ESTIMATE)
    inner = *WHOLE, "--inner", "mahalanobis"
    pair = *inner, "--inner-cov", "pair"
    told = "-c", "4", "--time", "1:1", "--format", "json"
    # At t = 1 a point and (9, 9), (7, 9): singular by itself, so the default is the pair's.
    assert invoke("associate", *paths, *told, *inner)[0] == 3
    status, out, _ = invoke(
        "associate", *paths, *told[:2], *told[4:], *inner, "--inner-cov", "global"
    )
    assert (status, len(json.loads(out)["parameters"]["inner_cov"])) == (0, 2)
    for order, value in ((1, 1.5991335783), (2, 1.6345506187)):
        options = *pair, "--cloud-order", str(order), "--time", "0:0", "--region", "x=:10"
        status, out, _ = invoke("associate", *paths, "-c", "4", *options, "--format", "json")
        assert status == 0
        document = json.loads(out)
        assert document["associations"][0]["distance"] == pytest.approx(value, rel=1e-9)
        assert document["parameters"]["inner_cov"] == "pair"
    status, _, err = invoke("associate", *paths, "-c", "4", *pair)
    assert status == 3
    assert 'id "1" and id "b" at t 0' not in err
    assert "the covariance of the pair is singular, as there are too few" in err
    status, _, err = invoke(*paths, *pair)
    assert (status, "--inner-cov pair is not a metric, so only associate" in err) == (2, True)


def test_associate_names_its_own_options(write: Write, invoke: Run) -> None:
    empty, boxes = write("a.csv", ""), write("b.txt", "1,1,0,0,2,2,1,-1,-1,-1\n")
    status, _, err = invoke("associate", empty, boxes, "-c", "4")
    assert (status, "(--a-format, --b-format)" in err, "truth" in err) == (3, True, False)
    status, _, err = invoke("associate", boxes, boxes, "-c", "4")
    assert status == 0
    assert ["to change this, use" in err, "--a-format" in err, "--b-format" in err] == [True] * 3
    status, _, err = invoke("reduce", empty, "out.csv", "-n", "1")
    assert (status, "(--in-format)" in err) == (3, True)


def test_associate_measures_means_as_the_distance_does(write: Write, invoke: Run) -> None:
    a, b = write("a.csv", "id,t,x,h\n1,0,0,359\n"), write("b.csv", "id,t,x,h\n1,0,2,2\n")
    columns = "--columns", "x,h", "--periodic", "h=360", "--scale", "x=2"
    status, out, _ = invoke("associate", a, b, "-c", "9", *columns, "--format", "csv")
    assert (status, out.splitlines()[1]) == (0, "0,1,1,5.0,5.0")  # 3 degrees, and twice 2


def test_associate_checks_what_it_is_given() -> None:
    rng = np.random.default_rng(1)
    states = rng.normal(size=(2, 3, 2))
    points = Trajectories.from_array(states)
    laws = Trajectories.from_array(states, covariance=np.eye(2))
    clouds = replace(scene(1, 2, 2), columns=("x", "y"))
    for second, distance, message in (
        (Trajectories.from_array(states[:1]), "euclidean", "have different times"),
        (Trajectories.from_array(states, ("y", "x")), "euclidean", "in different orders"),
        (Trajectories.from_array(states, ("y", "z")), "euclidean", 'first has a column "x"'),
        (laws, "cloud-wasserstein", "second has covariances, not particles"),
        (clouds, "gaussian-wasserstein", "second has particles"),
    ):
        with pytest.raises(InputError, match=message):
            associate(points, second, cutoff=1.0, distance=distance)
    with pytest.raises(ConfigError, match='no distance "nearest"'):
        associate(points, points, cutoff=1.0, distance="nearest")
    with pytest.raises(InputError, match="in different orders"):
        evaluate(points, Trajectories.from_array(states, ("y", "x")), 1.0)


@pytest.mark.parametrize("name", ["euclidean", "gaussian-wasserstein", "cloud-wasserstein"])
def test_all_pairs_make_the_same_association(name: str) -> None:
    a, b = scene(3), scene(4)
    if name == "gaussian-wasserstein":
        a, b = (replace(side, clouds=None, covariance=side.clouds.covariances) for side in (a, b))
    for cutoff in (1.0, 6.0, 100.0):
        some, every = (
            associate(a, b, cutoff=cutoff, distance=name, all_pairs=way) for way in (False, True)
        )
        assert some.associations_table() == every.associations_table()
        assert len(every.costs_table()["t"]) == 3 * 6 * 6
        assert every.total == pytest.approx(some.total, rel=1e-14)


def test_associate_points_takes_the_least_sum(write: Write, invoke: Run) -> None:
    """The nearest pair, 2-3, would leave one of 2.5; 1 and 1 are less than 0.5 and 2.5."""
    a = write("a.csv", "id,t,x\n1,0,0\n2,0,1.5\n")
    b = write("b.csv", "id,t,x\n3,0,1\n4,0,2.5\n")
    status, out, _ = invoke("associate", a, b, "-c", "4", "--format", "csv")
    assert status == 0
    rows = [line.split(",")[:4] for line in out.splitlines()]
    assert rows == [
        ["t", "id_a", "id_b", "distance"],
        ["0", "1", "3", "1.0"],
        ["0", "2", "4", "1.0"],
    ]
    status, out, _ = invoke("associate", a, b, "-c", "4")
    assert "2 associated, 0 of A and 0 of B unassociated, in 1 step" in out
    assert invoke("associate", a, b, "-c", "-1")[0] == 2
    status, out, _ = invoke("associate", a, b, "-c", "0.1")
    assert (status, "0 associated, 2 of A and 2 of B unassociated" in out) == (0, True)
    nothing = write("none.csv", "id,t,x\n")
    status, out, _ = invoke("associate", nothing, nothing, "-c", "1")
    assert (status, "0 associated, 0 of A and 0 of B unassociated, in 0 steps" in out) == (0, True)
    assert invoke("associate", a, b)[0] == 2
    status, _, err = invoke("associate", a, b, "-c", "1", "--cross-cov", "c.csv")
    assert (status, "cross-covariances need particles" in err) == (3, True)


def test_reduce(write: Write, invoke: Run, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rows = "".join(f"7,3,.01,{x:.6f},{y:.6f}\n" for x, y in rng.standard_normal((100, 2)))
    path = write("in.csv", "id,t,weight,x,y\n" + rows)
    status, out, err = invoke("reduce", path, "out.parquet", "-n", "10", "--format", "json")
    assert (status, err) == (0, "")
    document = json.loads(out)
    assert document["counts"] == {"clouds": 1, "particles": 100, "kept": 10}
    (row,) = document["clouds"]
    assert row["mean_shift"] < 1e-12
    # Of the default directions, on which the result is measured too; here they stay at the end.
    assert row["history"][-1] == pytest.approx(row["sliced_wasserstein"], rel=1e-9)
    assert (np.diff(row["history"]) <= 1e-12).all()
    assert "history" not in invoke("reduce", path, "b.csv", "-n", "9", "--format", "csv").out
    before = read_trajectories(path)
    after = read_trajectories(tmp_path / "out.parquet")
    assert after.clouds.counts.tolist() == [10]
    assert (
        "to change this, use --in-format" in invoke("reduce", "out.parquet", "p.npz", "-n", "9").err
    )
    assert row["wasserstein"] == pytest.approx(
        cloud_wasserstein(*before.clouds[0], *after.clouds[0])
    )
    assert invoke("reduce", path, "out.parquet", "-n", "10")[0] == 2
    for target, text in (
        ("out.txt", "must end in .csv"),
        ("no/out.csv", "there is no such folder"),
    ):
        status, _, err = invoke("reduce", path, target, "-n", "10")
        assert (status, text in err) == (2, True)
    points = write("points.csv", "id,t,x\n1,0,1\n")
    status, _, err = invoke("reduce", points, "o.csv", "-n", "2")
    assert (status, "points.csv: no particles; with a column weight, the rows" in err) == (3, True)
    status, out, _ = invoke("reduce", path, "again.csv", "-n", "10", "--reduce-method", "top")
    assert "1 cloud, 100 particles -> 10" in out


def test_reduce_without_pot(
    write: Write, invoke: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "ot", None)
    path = write("in.csv", TRUTH)
    status, out, err = invoke("reduce", path, "out.csv", "-n", "2", "--format", "json")
    assert status == 0
    assert "no exact distances to the original clouds: distances of particle clouds need the" in err
    document = json.loads(out)
    assert document["change"]["wasserstein"] is None
    assert document["clouds"][0]["wasserstein"] is None
    assert read_trajectories(tmp_path / "out.csv").clouds.counts.tolist() == [2, 1, 2]
    status, out, _ = invoke("reduce", path, "out.csv", "-n", "2", "--force")
    assert (status, "Wasserstein distance to the cloud " in out) == (0, False)
    status, _, err = invoke("reduce", path, "o.csv", "-n", "2", "--reduce-method", "atl")
    assert (status, "need the extra clouds: " in err) == (2, True)
    assert not (tmp_path / "o.csv").exists()


LAW = "id,t,x,y,cov_xx,cov_yy\n1,0,0.4,0.8,0.24,0.96\n"
"""The mean of the first cloud of ESTIMATE, with other variances than its own."""
NORMAL = ("--distance", "gaussian-wasserstein", "-c", "10", "-g", "2")


def test_clouds_against_normal_laws_by_their_moments(write: Write, invoke: Run) -> None:
    """The cloud has the covariance ((.24, -.48), (-.48, .96)), of rank one and trace 1.2.

    So C2 = u u' and B^2 = tr C1 + 1.2 - 2 sqrt(u' C1 u), with u = (.24, -.48) / sqrt(.24) and
    u' C1 u = .24 * .24 + .96 * .96.
    """
    law, cloud = write("law.csv", LAW), write("cloud.csv", CLOUD)
    status, out, err = invoke(law, cloud, *NORMAL, "--mixed", "moments", "--format", "json")
    assert status == 0
    result = json.loads(out)
    expected = 1.2 + 1.2 - 2 * (0.24 * 0.24 + 0.96 * 0.96) ** 0.5
    assert result["total"] == pytest.approx(expected, rel=1e-12)
    assert result["localisation_mean"] == pytest.approx(0, abs=1e-15)
    assert result["localisation_spread"] == pytest.approx(expected, rel=1e-12)
    assert result["parameters"]["mixed"] == "moments"
    assert "by their means" not in err
    both = json.loads(invoke(cloud, cloud, *NORMAL, "--mixed", "moments", "--format", "json")[1])
    assert both["total"] == pytest.approx(0, abs=1e-13)


CLOUD = "id,t,weight,x,y\na,0,0.6,0,1.6\na,0,0.4,1,-0.4\n"


def test_kinds_that_do_not_fit(write: Write, invoke: Run) -> None:
    law, cloud, point = write("law.csv", LAW), write("c.csv", CLOUD), write("p.csv", POINT)
    whole = (*WHOLE, "-c", "10", "-g", "2")
    for paths, options, message in (
        ((law, cloud), NORMAL, "c.csv has particles: the distance between a Gaussian and a cloud"),
        ((cloud, law), whole, "c.csv has particles: the distance between a Gaussian and a cloud"),
        ((point, cloud), NORMAL, "c.csv has particles: clouds are not Gaussians; use --distance"),
        ((point, law), whole, "law.csv has covariances, not particles; use --distance gaussian"),
    ):
        status, out, err = invoke(*paths, *options)
        assert (status, out) == (3, "")
        assert message in err
    status, _, err = invoke(cloud, cloud, *whole, "--mixed", "moments")
    assert status == 2
    assert "--mixed is for gaussian-wasserstein, not for cloud-wasserstein" in err
    with pytest.raises(InputError, match="a covariance each, or a cloud, not both"):
        replace(read_trajectories(cloud), covariance=np.zeros((1, 3)))
    with pytest.raises(ConfigError, match='mixed is "mean": must be one of error, moments'):
        GaussianWasserstein(mixed="mean")


POINT = "id,t,x,y\n1,0,0,0\n"


def test_covariances_of_particles_are_not_used(write: Write, invoke: Run) -> None:
    """Rows of a cloud with covariances are components of a mixture, which nothing compares."""
    mixture = write("m.csv", "id,t,weight,x,y,cov_xx,cov_yy\n1,0,.5,0,0,1,1\n1,0,.5,2,0,1,1\n")
    status, out, err = invoke(mixture, mixture, *WHOLE, "-c", "10", "-g", "2", "--format", "json")
    assert (status, json.loads(out)["total"]) == (0, 0)
    assert "columns not used: cov_xx, cov_yy" in err


def test_localisation_of_clouds_in_parts(write: Write, invoke: Run) -> None:
    """Squared distances 1.6 and 1 of pairs whose means are 0.2 and 1 apart."""
    paths = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    answer = invoke(*paths, *WHOLE, "-c", "10", "-g", "2", "--format", "json")
    result = json.loads(answer[1])
    mean, spread = result["localisation_mean"], result["localisation_spread"]
    assert mean + spread == pytest.approx(result["localisation"], rel=1e-12)
    assert mean == pytest.approx(0.2**2 + 1, rel=1e-12)
    first = json.loads(invoke(*paths, *WHOLE, "--cloud-order", "1", "--format", "json")[1])
    assert "localisation_mean" not in first


def test_associate_normal_laws(write: Write, invoke: Run, tmp_path: Path) -> None:
    """W2 of N(0, 1) from N(3, 4) is sqrt(9 + 1), from N(2.9, 9) sqrt(8.41 + 4): not the nearest."""
    a = write("a.csv", "id,t,x,cov_xx\n1,0,0,1\n")
    b = write("b.csv", "id,t,x,cov_xx\nnear,0,2.9,9\nlike,0,3,4\n")
    laws = ("--distance", "gaussian-wasserstein", "-c", "5")
    status, out, _ = invoke("associate", a, b, *laws, "--format", "csv")
    assert status == 0
    row = out.splitlines()[1].split(",")
    assert row[:3] == ["0", "1", "like"]
    assert float(row[3]) == pytest.approx(10**0.5, rel=1e-14)
    status, _, err = invoke("associate", a, b, *laws, "--cross-cov", "cross.csv")
    assert status == 3
    assert "cross-covariances need particles, but neither file has any" in err


def test_associate_by_the_covariances_of_each_pair(write: Write, invoke: Run) -> None:
    """Of diag(4, 1) and diag(2, 3) the mean is diag(3, 2): (3, 2) is sqrt(9/3 + 4/2) away."""
    a = write("a.csv", "id,t,x,y,cov_xx,cov_xy,cov_yy\n1,0,0,0,4,0,1\n2,0,9,9,1,0,1\n")
    b = write("b.csv", "id,t,x,y,cov_xx,cov_xy,cov_yy\n7,0,3,2,2,0,3\n8,0,9,10,1,1,1\n")
    options = "--distance", "mahalanobis", "-c", "5"
    status, out, err = invoke("associate", a, b, *options, "--format", "json")
    assert (status, err) == (0, "")
    document = json.loads(out)
    assert document["parameters"]["covariance"] == "pair"
    # (0, 1) by [[1, 0.5], [0.5, 1]], whose inverse has 1 / 0.75 in that place
    for row, value in zip(document["associations"], (5**0.5, 0.75**-0.5), strict=True):
        assert row["distance"] == pytest.approx(value, rel=1e-13)
    points = write("p.csv", "id,t,x,y\n7,0,3,2\n")
    status, out, _ = invoke("associate", points, a, *options, "--format", "csv")
    assert float(out.splitlines()[1].split(",")[3]) == pytest.approx(12.5**0.5)  # 9/2 + 4/0.5
    status, _, err = invoke("associate", points, points, *options)
    assert (status, "neither file has cov" in err) == (3, True)
    line = write("l.csv", "id,t,x,y,cov_xx,cov_xy,cov_yy\n5,0,3,2,1,1,1\n")
    status, _, err = invoke("associate", points, line, *options)
    assert (status, 'id "7" and id "5" at t 0: the covariance of the pair is' in err) == (3, True)
    status, _, err = invoke(points, a, *options)
    assert (status, "needs --covariance FILE" in err) == (2, True)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_near_pairs_by_the_covariances_of_each_pair(size: int) -> None:
    rng = np.random.default_rng(size)
    sides = []
    for _ in range(2):
        factors = rng.normal(size=(4, 6, size, size)) * np.exp(rng.normal(size=(4, 6, 1, 1)))
        sides.append(
            Trajectories.from_array(
                rng.uniform(0, 9, (4, 6, size)), covariance=factors @ factors.swapaxes(2, 3)
            )
        )
    a, b = (unpack(side.covariance.T) for side in sides)
    inverse = np.linalg.inv((a[:, None] + b[None]) / 2)
    apart = sides[0].state[:, None] - sides[1].state[None]
    every = np.sqrt(np.einsum("rsi,rsij,rsj->rs", apart, inverse, apart))
    together = sides[0].step[:, None] == sides[1].step[None]
    for cutoff in (0.5, 3.0, np.inf):
        i, j = np.nonzero((every < cutoff) & together)
        pairs = near_pairs(*sides, cutoff, PairMahalanobis())
        assert np.array_equal(pairs.truth_row, i)
        assert np.array_equal(pairs.estimate_row, j)
        np.testing.assert_allclose(pairs.distance, every[i, j], rtol=1e-7)


def test_compare_with_clouds(write: Write, invoke: Run) -> None:
    """Solvers get prepared clouds; --seed is that of a study and not of a reduction."""
    paths = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    options = (*WHOLE, "-c", "10", "-g", "2", "--solvers", "certified", "--reduce", "2")
    status, out, err = invoke("compare", *paths, *options, "--format", "json")
    assert status == 0, err
    assert json.loads(out)["agree"] is True
