"""From a filter of Stone Soup to the answer: objects, CSV and MAT give one number and verdict."""

import datetime
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from tgospa_eval import ConfigError, InputError, associate, evaluate, reduce

with warnings.catch_warnings(action="ignore"):  # its own
    pytest.importorskip("stonesoup")
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import (
        CombinedLinearGaussianTransitionModel,
        ConstantVelocity,
    )
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.predictor.particle import ParticlePredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState, ParticleState
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import KalmanUpdater
    from stonesoup.updater.particle import ParticleUpdater

STEPS, TARGETS, PARTICLES = 12, 3, 500
START, SECOND = datetime.datetime(2026, 1, 1), datetime.timedelta(seconds=1)
ROOT = np.diag([1.0, 0.5, 1.0, 0.5])
GIVEN = {"cutoff": 20.0, "switch_penalty": 5.0}
PLACES = {"columns": ("x=x0", "y=x2")}


def filtered(*, particles: bool, belief: float = 1.0) -> tuple[list[Any], list[Any]]:
    """Targets, and a filter that is told their noise, times `belief`, of each."""
    rng = np.random.default_rng(5)
    model = CombinedLinearGaussianTransitionModel([ConstantVelocity(0.05)] * 2, seed=6)
    sensor = LinearGaussian(4, (0, 2), np.eye(2), seed=7)
    told = LinearGaussian(4, (0, 2), belief * np.eye(2))
    predictor, updater = KalmanPredictor(model), KalmanUpdater(told)
    if particles:
        predictor = ParticlePredictor(model)
        updater = ParticleUpdater(told, SystematicResampler())
    truths, tracks = [], []
    np.random.seed(8)  # noqa: NPY002  (the resampler draws there)
    for k in range(TARGETS):
        middle = np.array([[60.0 * k], [1.0], [40.0 * k], [0.5]])
        states = [GroundTruthState(middle + ROOT @ rng.normal(size=(4, 1)), timestamp=START)]
        prior = GaussianState(middle, ROOT**2, timestamp=START)
        if particles:
            cloud = StateVectors(middle + ROOT @ rng.normal(size=(4, PARTICLES)))
            equal = np.full(PARTICLES, 1 / PARTICLES)
            prior = ParticleState(cloud, weight=equal, timestamp=START)
        track = Track([prior], id=str(k + 1))
        for step in range(1, STEPS):
            moved = model.function(states[-1], noise=True, time_interval=SECOND)
            states.append(GroundTruthState(moved, timestamp=START + step * SECOND))
            seen = sensor.function(states[-1], noise=True)
            detection = Detection(seen, timestamp=states[-1].timestamp, measurement_model=told)
            predicted = predictor.predict(track[-1], timestamp=detection.timestamp)
            track.append(updater.update(SingleHypothesis(predicted, detection)))
        truths.append(GroundTruthPath(states, id=str(k + 1)))
        tracks.append(track)
    return truths, tracks


def of_states(paths: list[Any], name: str) -> np.ndarray:
    """An attribute of all states (T, n, ...), as numbers."""
    found = [[np.asarray(getattr(s, name), float) for s in path.states] for path in paths]
    return np.stack(found, axis=1)


def rows(paths: list[Any]) -> pd.DataFrame:
    """A table of positions, with what is around them."""
    found = []
    for path in paths:
        for step, state in enumerate(path.states):
            at = {"id": path.id, "t": step}
            if hasattr(state, "weight"):
                vectors = np.asarray(state.state_vector, float)
                weights = np.asarray(state.weight, float)
                found += [
                    at | {"weight": w, "x": v[0], "y": v[2]}
                    for w, v in zip(weights, vectors.T, strict=True)
                ]
                continue
            mean = np.asarray(state.state_vector, float).ravel()
            spread = getattr(state, "covar", None)
            around = {}
            if spread is not None:
                around = {"P11": spread[0, 0], "P12": spread[0, 2], "P22": spread[2, 2]}
            found.append(at | {"x": mean[0], "y": mean[2]} | around)
    return pd.DataFrame(found)


def variables(truths: list[Any], tracks: list[Any], *, particles: bool) -> dict[str, Any]:
    """Structures of MATLAB, with the coordinates first."""
    beside = {"t": np.arange(STEPS), "id": np.arange(1, TARGETS + 1)}
    x = of_states(truths, "state_vector")[..., 0].transpose(2, 0, 1)
    if particles:
        clouds = of_states(tracks, "state_vector").transpose(2, 3, 0, 1)
        around = {"particles": clouds, "weights": of_states(tracks, "weight").transpose(2, 0, 1)}
    else:
        means = of_states(tracks, "mean")[..., 0].transpose(2, 0, 1)
        around = {"x": means, "P": of_states(tracks, "covar").transpose(2, 3, 0, 1)}
    return {"X": beside | {"x": x}, "Y": beside | around}


def as_hdf5(path: Path, structures: dict[str, Any]) -> Path:
    """A file of version 7.3."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, fields in structures.items():
            for field, values in fields.items():
                file[f"{name}/{field}"] = np.atleast_2d(values).T
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


@pytest.mark.parametrize(
    ("particles", "belief", "verdict"),
    [(False, 1.0, "consistent"), (False, 0.05, "overconfident"), (True, 1.0, "consistent")],
)
def test_one_answer_from_every_input(
    tmp_path: Path, particles: bool, belief: float, verdict: str
) -> None:
    truths, tracks = filtered(particles=particles, belief=belief)
    for name, side in (("truth", truths), ("estimate", tracks)):
        rows(side).to_csv(tmp_path / f"{name}.csv", index=False)
    structures = variables(truths, tracks, particles=particles)
    savemat(tmp_path / "a.mat", structures)
    axes = {"x": "dTn", "P": "ddTn", "particles": "dNTn", "weights": "NTn", "t": "", "id": ""}
    held = [
        {f"{k}_{axes[k]}".rstrip("_"): values for k, values in side.items()}
        for side in structures.values()
    ]
    given = GIVEN | {"distance": "cloud-wasserstein" if particles else "gaussian-wasserstein"}
    if particles:
        pytest.importorskip("ot")
    want = evaluate(truths, tracks, mapping=(0, 2), **given)
    assert want.nees is not None
    assert want.nees.verdict == verdict
    for found in (
        evaluate(tmp_path / "truth.csv", tmp_path / "estimate.csv", **given),
        evaluate(rows(truths), rows(tracks), **given),
        evaluate(tmp_path / "a.mat", tmp_path / "a.mat", **given, **PLACES),
        evaluate(*[as_hdf5(tmp_path / "b.mat", structures)] * 2, **given, **PLACES),
        evaluate(*held, mapping=(0, 2), **given),
    ):
        assert found.total == pytest.approx(want.total, rel=1e-12)
        assert found.nees is not None
        assert found.nees.mean == pytest.approx(want.nees.mean, rel=1e-9)
        assert found.nees.verdict == verdict
        assert found.labels.estimates == ["1", "2", "3"]


def test_one_guard(tmp_path: Path) -> None:
    """What is refused from files is refused of objects, in the same words."""
    truths, gaussian = filtered(particles=False)
    _, clouds = filtered(particles=True)
    rows(gaussian).to_csv(tmp_path / "g.csv", index=False)
    rows(clouds).to_csv(tmp_path / "p.csv", index=False)
    files = {"cutoff": 20.0}
    objects = {"cutoff": 20.0, "mapping": (0, 2)}
    for sides, given in (
        ((gaussian, clouds), objects),
        ((rows(gaussian), rows(clouds)), files),
        ((tmp_path / "g.csv", tmp_path / "p.csv"), files),
    ):
        for verb in (evaluate, associate):
            moments = given | {"distance": "gaussian-wasserstein"}
            with pytest.raises(
                InputError, match=r'mixed="moments", which treats a cloud as a Gaussian'
            ):
                verb(*sides, **moments)
            assert verb(*sides, **moments, mixed="moments").total > 0
            for wrong in ((sides[0], sides[0]), (sides[0], sides[1])):
                with pytest.raises(InputError, match="has covariances"):
                    verb(*wrong, **given, distance="cloud-wasserstein")
        small, table = reduce(sides[1], 20, **({"mapping": (0, 2)} if given is objects else {}))
        assert (len(small.clouds.points), table["kept"].tolist()) == (36 * 20, [20] * 36)
        with pytest.raises(InputError, match="no particles"):
            reduce(sides[0], 20, **({"mapping": (0, 2)} if given is objects else {}))
    bare = GroundTruthState(gaussian[1][4].mean, timestamp=gaussian[1][4].timestamp)
    gaussian[1].states[4] = bare
    given = objects | {"distance": "gaussian-wasserstein"}
    for verb in (evaluate, associate):
        with pytest.raises(InputError, match=r'id "2", t 2026-01-01T00:00:04\): no covariance'):
            verb(truths, gaussian, **given)
        assert verb(truths, gaussian, **given, missing_cov="zero").total > 0
    with pytest.raises(
        InputError, match=r'id "1", t .* has a covariance, but other states have part'
    ):
        evaluate(truths, [*gaussian[:1], *clouds[1:]], **given)
    gaussian[1].states[4] = GaussianState(bare.state_vector, -np.eye(4), timestamp=bare.timestamp)
    with pytest.raises(InputError, match=r"t 2026-01-01T00:00:04\): negative .* or use fix_cov"):
        evaluate(truths, gaussian, **given)
    assert evaluate(truths, gaussian, **given, fix_cov=True).total > 0
    assert evaluate(truths, [Track([], id="none")], **given).counts["missed"] == STEPS * TARGETS
    with pytest.raises(ConfigError, match=r"b: state vectors have 4 components.*mapping=\(0, 2\)"):
        associate(rows(truths), gaussian, 20.0)
    with pytest.raises(InputError, match=r"a has 2 steps and b has 3: arrays"):
        associate(np.zeros((2, 1, 2)), np.zeros((3, 1, 2)), 5.0)
