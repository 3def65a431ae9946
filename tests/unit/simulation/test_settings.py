"""Settings of the literature: what is drawn has the moments that the source says."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from answer import Run

from tgospa_eval import Trajectories
from tgospa_eval.cli import simulate
from tgospa_eval.simulation.settings import PUBLISHED, run_setting


def test_the_names_are_those_of_the_options() -> None:
    assert tuple(PUBLISHED) == simulate.PUBLISHED


@pytest.mark.parametrize("name", PUBLISHED)
def test_draws_have_the_moments_of_the_source(name: str) -> None:
    setting = PUBLISHED[name]
    runs = [run_setting(setting, seed) for seed in range(60)]
    assert [len(measurements) for _, _, measurements in runs] == [setting.steps] * 60
    truth = runs[0][0]
    ends = [
        (int(steps[0]) + 1, int(steps[-1]) + 1)
        for steps in (truth.step[truth.track == k] for k in range(len(truth.ids)))
    ]
    assert tuple(ends) == setting.alive
    same = np.array_equal(truth.state, runs[1][0].state)
    assert same == setting.one_truth
    counts = np.array([[len(step) for step in measurements] for _, _, measurements in runs])
    alive = np.bincount(truth.step, minlength=setting.steps)
    expected = setting.clutter + setting.detection * alive
    assert counts.mean() == pytest.approx(expected.mean(), rel=0.02)
    errors = np.concatenate([_errors(truth, estimate) for truth, estimate, _ in runs])
    assert errors.std() == pytest.approx(np.sqrt(setting.noise), rel=0.02)
    detected = sum(len(estimate.step) for _, estimate, _ in runs)
    assert detected / (60 * len(truth.step)) == pytest.approx(setting.detection, abs=0.01)
    places = np.concatenate([np.concatenate(measurements) for _, _, measurements in runs])
    assert setting.square[0] - 50 < places.min() < places.max() < setting.square[1] + 50


def _errors(truth: Trajectories, estimate: Trajectories) -> np.ndarray:
    tracks = np.array([int(name) - 101 for name in estimate.ids])
    return np.asarray(estimate.state - truth.dense()[estimate.step, tracks[estimate.track]])


def test_motion_nearly_keeps_its_velocity() -> None:
    """Second differences of positions have variance 2 q / 3, neighbours covariance q / 6."""
    setting = PUBLISHED["xia-2019"]
    jumps = []
    for seed in range(150):
        dense = run_setting(setting, seed)[0].dense()
        for k, (first, last) in enumerate(setting.alive):
            jumps.append(np.diff(dense[first - 1 : last, k], n=2, axis=0))
    jump = np.array(jumps)
    assert jump.var() == pytest.approx(2 / 3 * setting.motion, rel=0.05)
    assert (jump[:, 1:] * jump[:, :-1]).mean() == pytest.approx(setting.motion / 6, rel=0.15)


def test_simulate_writes_a_setting_and_the_metric_of_its_source(
    invoke: Run, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    done = invoke("simulate", str(folder), "--setting", "garcia-fernandez-2020", "--seed", "3")
    assert done.status == 0, done.err
    what, source, printed = done.out.splitlines()
    assert "2020, 81 steps; 4 ground-truth objects with 283 rows in truth.csv" in what
    assert "ScenarioWilliams15.m; the random numbers differ from those of the source" in source
    assert printed.endswith("-c 10 -p 2 -g 1")
    result = json.loads(invoke(*printed.split()[1:], "--format", "json").out)
    assert result["sizes"]["steps"] == 81
    table = pd.read_csv(folder / "measurements.csv")
    estimate = pd.read_csv(folder / "estimate.csv")
    found = set(zip(table.t, table.x, table.y, strict=True))
    assert set(zip(estimate.t, estimate.x, estimate.y, strict=True)) <= found
    again = invoke("simulate", str(folder), "--setting", "garcia-fernandez-2020", "--seed", "3")
    assert again.out == done.out
    refused = invoke(
        "simulate", str(folder), "--setting", "xia-2019", "--targets", "3", "--lost", "1"
    )
    assert refused.status == 2
    assert "--setting fixes the scene: leave out --targets, --lost" in refused.err
