"""What Stone Soup has at the end of a run, as it is: the number of the arrays behind it."""

import datetime
import warnings
from collections.abc import Callable

import numpy as np
import pytest

from tgospa_eval import Result, evaluate

START = datetime.datetime(2026, 1, 1)
STEPS = 6


def paths(kind: type, states: np.ndarray, make: Callable[..., object]) -> set:
    """One for each column of the states, (x, vx, y, vy) at each step."""
    found = set()
    for column in np.moveaxis(states, 1, 0):
        vectors = [np.array([[x], [9.0], [y], [9.0]]) for x, y in column]
        moments = [START + datetime.timedelta(seconds=k) for k in range(STEPS)]
        found.add(kind([make(v, timestamp=t) for v, t in zip(vectors, moments, strict=True)]))
    return found


def test_paths_and_tracks() -> None:
    with warnings.catch_warnings(action="ignore"):  # its own; here: slow to import
        pytest.importorskip("stonesoup")
        from stonesoup.types.array import StateVectors
        from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
        from stonesoup.types.state import GaussianState, ParticleState
        from stonesoup.types.track import Track

    rng = np.random.default_rng(2)
    states = rng.normal(size=(STEPS, 2, 2)).cumsum(axis=0) + 15 * np.arange(2)[:, None]
    estimates = states + rng.normal(size=states.shape)
    truths = paths(GroundTruthPath, states, GroundTruthState)
    spread = np.diag([4.0, 1.0, 9.0, 1.0])

    def gaussian(vector: np.ndarray, timestamp: datetime.datetime) -> GaussianState:
        return GaussianState(vector, spread, timestamp=timestamp)

    def particles(vector: np.ndarray, timestamp: datetime.datetime) -> ParticleState:
        cross = np.array([[1, -1, 0, 0], [0, 0, 0, 0], [0, 0, 1, -1], [0, 0, 0, 0]])
        return ParticleState(
            StateVectors(vector + cross), weight=np.full(4, 0.25), timestamp=timestamp
        )

    def value(make: Callable[..., object], distance: str) -> Result:
        tracks = paths(Track, estimates, make)
        given = {"cutoff": 20.0, "switch_penalty": 5.0, "mapping": (0, 2)}
        return evaluate(truths, tracks, distance=distance, **given)

    expected = evaluate(states, estimates, 20.0, 2, 5.0).total
    found = value(gaussian, "euclidean")
    assert found.total == pytest.approx(expected)
    assert set(found.labels.truths) == {path.id for path in truths}
    assert found.labels.times[1] == "2026-01-01T00:00:01"
    # Against points: the trace of each covariance is added.
    each = STEPS * 2
    assert value(gaussian, "gaussian-wasserstein").total == pytest.approx(expected + 13 * each)
    pytest.importorskip("ot")
    assert value(particles, "cloud-wasserstein").total == pytest.approx(expected + each)
