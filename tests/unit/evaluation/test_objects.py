"""What programs hold in memory: each form gives the number of the file with the same content."""

import datetime
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from tgospa_eval import (
    ConfigError,
    InputError,
    Recorder,
    Result,
    TgospaWarning,
    Trajectories,
    evaluate,
    sweep,
)

GIVEN: dict[str, Any] = {"cutoff": 10.0, "switch_penalty": 5.0}


class Tensor:
    """As of PyTorch: numbers are seen without the derivative, on the CPU."""

    def __init__(self, array: np.ndarray, place: str = "gpu") -> None:
        self.array, self.place = array, place

    def detach(self) -> "Tensor":
        return self

    def cpu(self) -> "Tensor":
        return Tensor(self.array, "cpu")

    def __array__(self, *given: object, **options: object) -> np.ndarray:
        if self.place != "cpu":
            raise TypeError("can't convert cuda:0 device type tensor to numpy")
        return self.array


@dataclass
class State:
    """As of Stone Soup."""

    timestamp: Any
    state_vector: np.ndarray
    covar: np.ndarray | None = None
    mean: np.ndarray | None = None
    weight: list[float] | None = None


@dataclass(eq=False)
class Track:
    id: str
    states: list[State] = field(default_factory=list)


@pytest.fixture(scope="module")
def arrays() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    truth = rng.normal(size=(6, 3, 2)).cumsum(axis=0) + 20 * np.arange(3)[:, None]
    estimate = truth + rng.normal(size=truth.shape)
    truth[0, 0] = truth[4:, 1] = estimate[2, 1] = estimate[:3, 2] = np.nan
    return truth, estimate


@pytest.fixture(scope="module")
def expected(arrays: tuple[np.ndarray, np.ndarray]) -> Result:
    return evaluate(*arrays, **GIVEN)


def same(found: Result, expected: Result) -> None:
    assert found.total == pytest.approx(expected.total, rel=1e-12)
    assert found.counts == expected.counts
    assert found.sizes == expected.sizes


def test_each_form_gives_the_same_number(
    arrays: tuple[np.ndarray, np.ndarray], expected: Result
) -> None:
    stamps = [7.5, 8, 10, 11, 12, 20]
    dates = [datetime.datetime(2026, 1, 1) + datetime.timedelta(seconds=s) for s in stamps]

    def by_id(array: np.ndarray) -> dict:
        return {f"t{k}": array[:, k] for k in range(array.shape[1])}

    def timed(array: np.ndarray, times: list) -> dict:
        """Only the states that are, backwards."""
        found = {}
        for k in reversed(range(array.shape[1])):
            there = np.flatnonzero(~np.isnan(array[:, k, 0]))[::-1]
            found[k] = ([times[step] for step in there], array[there, k])
        return found

    for of_side in (
        Tensor,
        lambda array: (stamps, array),
        lambda array: (np.array(dates, "datetime64[ns]"), Tensor(array)),
        by_id,
        lambda array: timed(array, stamps),
        lambda array: timed(array, dates),
    ):
        same(evaluate(*map(of_side, arrays), **GIVEN), expected)
    mixed = evaluate(by_id(arrays[0]), arrays[1], **GIVEN)
    same(mixed, expected)
    assert mixed.labels.truths == ["t0", "t1", "t2"]
    times = evaluate(*((dates, array) for array in arrays), **GIVEN).labels.times
    assert str(times[0]) == "2026-01-01T00:00:07.500000"
    assert sweep(by_id(arrays[0]), Tensor(arrays[1]), [10.0], 2, 5.0).points[0].total == mixed.total


@pytest.mark.parametrize(
    ("truth", "message"),
    [
        (np.zeros((5, 1, 2)), "truth has 5 steps and estimate has 6.*pair"),
        ({"a": np.zeros((5, 2))}, "truth has 5 steps and estimate has 6"),
        ({"a": np.zeros((5, 2)), "b": np.zeros((4, 2))}, '"a" has the shape .*"b" .4, 2.'),
        ({"a": np.zeros((6, 2)), 1: ([1], np.zeros((1, 2)))}, "some tracks are pairs"),
        ({"a": ([1, 2], np.zeros((1, 2)))}, 'truth, track "a": 2 times and 1 states'),
        ({"a": ([1, 1], np.zeros((2, 2)))}, 'id "a" is a duplicate at t = 1'),
        ({"a": ([1, "x"], np.zeros((2, 2)))}, "truth, row 1"),
        ({1: np.zeros((6, 2)), "1": np.zeros((6, 2))}, 'two tracks have the id "1"'),
        ({"": np.zeros((6, 2))}, "blank id"),
        ({(1, 2): np.zeros((6, 2))}, "an id is a value of type tuple"),
        ({"id": [1], "t": [0], "x": [1.0]}, 'track "id": shape .1,.*pandas.DataFrame'),
        ({"a": np.full((6, 2), np.inf)}, 'track "a": infinite'),
        ({"a": [["x", "y"]] * 6}, "holds numbers"),
        (([1, 2], np.zeros((3, 1, 2))), "2 times and 3 steps"),
        (([1, 1, 2], np.zeros((3, 1, 2))), "increase strictly"),
        (Tensor(np.zeros(3)), r"truth: .*axes \(T, k, d\)"),
        ([np.zeros((6, 2))], "truth is of the type list"),
        ([Track("a", [State(1, np.zeros((4, 1)))])], r"4 components.*mapping=\(0, 2\)"),
        ({"a": np.zeros((6, 2), complex)}, "not of type complex128"),
        ({"a": (5, np.zeros((1, 2)))}, r'"a": times of shape \(\)'),
        ([Track("a", None)], 'track "a": states is of the type NoneType'),
        ([Track("a", [object()])], "without timestamp"),
        ([Track("a", [State(1, None)])], "without state_vector"),
        ([Track("a", [State(None, np.zeros((1, 1)))])], "without timestamp"),
    ],
)
def test_what_is_refused(truth: Any, message: str) -> None:
    with pytest.raises((ConfigError, InputError), match=message):
        evaluate(truth, np.zeros((6, 1, 2)), **GIVEN)


def test_no_tracks_at_all_is_a_side(arrays: tuple[np.ndarray, np.ndarray]) -> None:
    truth = arrays[0]
    missed = evaluate(truth, {}, **GIVEN)
    assert missed.counts["missed"] == (~np.isnan(truth[:, :, 0])).sum()
    assert evaluate(set(), (list("123456"), truth), **GIVEN).total == missed.total
    assert evaluate([], {}, **GIVEN).total == 0


def test_tracks_of_stone_soup(arrays: tuple[np.ndarray, np.ndarray], expected: Result) -> None:
    start = datetime.datetime(2026, 1, 1)

    def tracks(array: np.ndarray, places: tuple[int, int], size: int) -> set[Track]:
        found = set()
        for k in range(array.shape[1]):
            track = Track(f"id{k}")
            for step in np.flatnonzero(~np.isnan(array[:, k, 0])):
                vector = np.full((size, 1), 99.0)
                vector[list(places), 0] = array[step, k]
                time = start + datetime.timedelta(seconds=int(step))
                # A prediction first, and its update at the same time: the last counts.
                track.states += [State(time, vector + 1), State(time, vector, np.eye(size))]
            found.add(track)
        return found

    truth, estimate = tracks(arrays[0], (0, 2), 4), tracks(arrays[1], (0, 3), 6)
    same(evaluate(truth, estimate, **GIVEN, mapping=((0, 2), (0, 3))), expected)
    same(evaluate(list(truth), tracks(arrays[1], (0, 2), 4), **GIVEN, mapping=(0, 2)), expected)
    for side in (*truth, *estimate):
        side.states = side.states[1::2]
    spread = evaluate(
        truth, estimate, **GIVEN, mapping=((0, 2), (0, 3)), distance="gaussian-wasserstein"
    )
    assert spread.total == pytest.approx(expected.total)  # the same covariance on both sides
    assert spread.localisation_spread == 0
    cross = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
    given = {"mapping": (0, 1), "cutoff": 9.0, "distance": "cloud-wasserstein"}

    def particles(shift: float, weight: list[float] | None = None) -> list[Track]:
        """Four particles around each of three points, backwards."""
        points = [np.array([[20.0 * k], [k + shift]]) for k in (2, 1, 0)]
        states = [State(int(p[0, 0]), p + cross, None, p, weight) for p in points]
        return [Track("a", states)]

    pytest.importorskip("ot")
    # Clouds that are moved: their distance is the shift; and from a point the spread is in it.
    assert evaluate(particles(0), particles(2), **given).total == pytest.approx(3 * 2**2)
    even = [Track("a", [State(20 * k, np.array([[20.0 * k], [k]])) for k in range(3)])]
    assert evaluate(even, particles(0), **given).total == pytest.approx(3 * 1.0)
    # Unnormalised: 1/2 of the weight on each of the two of the first axis.
    assert evaluate(even, particles(0, [2, 2, 0, 0]), **given).total == pytest.approx(3 * 1.0)
    odd = [Track("a", [State(k, np.zeros((2 + k, 1))) for k in range(2)])]
    with pytest.raises(InputError, match=r'id "a", t 1 has 3 components, the first state has 2'):
        evaluate(even, odd, cutoff=9.0, columns="x0,x1")
    odd = [Track("a", [State(3, np.zeros((2, 1)), np.eye(3))])]
    with pytest.raises(InputError, match=r'"a", t 3: covar is \(3, 3\); must be \(2, 2\)'):
        evaluate(even, odd, **given)
    with pytest.raises(InputError, match="4 particles and 1 weights"):
        evaluate(even, particles(0, [1]), **given)
    for mapping in ((0, 4), (0, 0), (), "ab", 1):
        with pytest.raises(ConfigError, match="mapping is"):
            evaluate(truth, truth, **GIVEN, mapping=mapping)
    with pytest.raises(ConfigError, match="mapping is for tracks and arrays"):
        evaluate(Trajectories.from_array(arrays[0]), "b.csv", **GIVEN, mapping=(0, 1))


def test_a_loop(arrays: tuple[np.ndarray, np.ndarray], expected: Result) -> None:
    recorder = Recorder()
    buffer = np.zeros((3, 2))  # as a loop that fills the same array again and again
    for step, (truth, estimate) in enumerate(zip(*arrays, strict=True)):
        there = np.flatnonzero(~np.isnan(truth[:, 0]))
        buffer[:] = estimate
        ids = [7, 8.0, "9"]
        recorder.update(np.float64(step), np.array(there), Tensor(truth[there]), ids, buffer)
    assert len(recorder) == 6
    found = recorder.evaluate(**GIVEN)
    same(found, expected)
    assert found.labels.estimates == ["7", "8", "9"]
    assert recorder.truth.dense().shape == arrays[0].shape
    places = Recorder()
    places.update(datetime.datetime(2026, 1, 1), ["a"], [[52.0, 4.0]], [], [])
    places.update(datetime.datetime(2026, 1, 2), [], [], [], [])
    with pytest.warns(TgospaWarning):
        assert places.evaluate(cutoff=100.0, distance="haversine").counts["missed"] == 1
    assert Recorder().evaluate(**GIVEN).total == 0


@pytest.mark.parametrize(
    ("update", "message"),
    [
        ((4, [1], [[0, 0]], [2], [[1, 1]]), "t = 4: time goes back; the previous update was at 5"),
        ((5, [1], [[0, 0]], [2], [[1, 1]]), "t = 5: this time was already given"),
        ((float("nan"), [], [], [], []), "no time"),
        (("6", [], [], [], []), "the type str, but the previous one .5. has int"),
        (([6], [], [], [], []), "no time"),
        ((6, None, [], [], []), "truth: ids are of the type NoneType"),
        ((6, [1, "1"], [[0, 0], [1, 1]], [], []), 't = 6, truth: id "1" is a duplicate'),
        ((6, [1], [[0, 0, 0]], [], []), "3 components, but those of truth at t = 5 have 2"),
        ((6, [], [], [1], [[0, 0], [1, 1]]), "estimate: states of shape .2, 2. for 1 ids"),
        ((6, [1], [0, 0], [], []), "states of shape .2,. for 1 ids"),
        ((6, [1], [[np.inf, 0]], [], []), "infinite"),
        ((6, [None], [[0, 0]], [], []), "NoneType, not an id"),
        ((6, [1], [["a", "b"]], [], []), "holds numbers"),
        ((6, [1], [[1], [1, 2]], [], []), "not an array|for 1 ids"),
    ],
)
def test_updates_that_are_refused_leave_nothing(update: tuple, message: str) -> None:
    recorder = Recorder()
    recorder.update(5, ["a"], [[0.0, 0.0]], ["b"], [[0.5, 0.0]])
    with pytest.raises(InputError, match=message):
        recorder.update(*update)
    assert repr(recorder) == "Recorder(1 updates)"
    assert recorder.evaluate(**GIVEN).total == pytest.approx(0.25)


def test_a_recorder_keeps_covariances_and_particles() -> None:
    rng = np.random.default_rng(0)
    truth = np.cumsum(rng.normal(size=(6, 2, 2)), axis=0)
    mean = truth + rng.normal(size=truth.shape)
    mean[3] = np.nan
    spread = np.broadcast_to(2 * np.eye(2), (*mean.shape, 2))
    points, weights = mean[:, :, None] + rng.normal(size=(6, 2, 9, 2)), rng.random((6, 2, 9))
    gaussian, cloud, ids = Recorder(), Recorder(), [0, 1]
    for k, true in enumerate(truth):
        if k == 3:
            for recorder in (gaussian, cloud):
                recorder.update(k, ids, true, [], [])
            continue
        gaussian.update(k, ids, true, ids, mean[k], estimate_covariances=spread[k])
        given: Any = list(points[k]) if k % 2 else points[k]
        cloud.update(k, ids, true, ids, given, estimate_weights=weights[k])
    own: Any = {"cutoff": 5.0, "distance": "gaussian-wasserstein", "with_": "nees"}
    expected = evaluate(truth, Trajectories.from_array(mean, covariance=spread), **own)
    assert gaussian.evaluate(**own).total == pytest.approx(expected.total, rel=1e-12)
    assert str(gaussian.evaluate(**own).nees) == str(expected.nees)
    own = {"cutoff": 5.0, "distance": "cloud-wasserstein"}
    whole = {"particles": points, "weights": weights / weights.sum(axis=2, keepdims=True)}
    total = evaluate(truth, whole, **own).total
    assert cloud.evaluate(**own).total == pytest.approx(total, rel=1e-12)
    assert len(cloud.estimate.ids) == 2
    wrong: list[tuple[Recorder, dict[str, Any], str]] = [
        (cloud, {"estimate": mean[0]}, "estimate: points, but particles in earlier updates"),
        (gaussian, {"estimate": mean[0]}, "estimate: points, but states with covariances"),
        (cloud, {"estimate": points[0], "estimate_weights": weights[0, :, 1:]}, r"weights \(8,\)"),
        (cloud, {"estimate": points[0] * np.inf}, "points must be finite"),
        (
            cloud,
            {"estimate": [points[0, 0], points[0, 1, :, :1]]},
            "different numbers of components",
        ),
        (gaussian, {"estimate": mean[0], "estimate_covariances": spread[0, 0]}, r"shape \(2, 2\);"),
        (gaussian, {"estimate": mean[0], "estimate_weights": weights[0]}, "are only for particles"),
    ]
    for recorder, arguments, message in wrong:
        with pytest.raises(InputError, match=message):
            recorder.update(7, ids, truth[0], ids, **arguments)
        assert len(recorder) == 6
