"""NEES wherever results go: point distances, data in parts, gates, batches, rankings, pictures."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tgospa_eval.partitioned import components, run

Invoke = Callable[..., Any]
METRIC = ("-c", "12", "-g", "5", "-q", "--jobs", "1")
GAUSSIAN = ("--distance", "gaussian-wasserstein")


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def write_sides(name: str, error: float, claimed: float, seed: int = 3, tracks: int = 8) -> None:
    """A truth, and an estimate with other ids from step 30 on, of which 5 % are missed."""
    rng, steps = np.random.default_rng(seed), 60
    track, step = (each.ravel() for each in np.indices((tracks, steps)))
    truth = pd.DataFrame({"id": track, "t": step, "x": 15.0 * track, "y": 0.5 * step})
    estimate = truth.assign(id=[f"e{i}.{t // 30}" for i, t in zip(track, step, strict=True)])
    estimate[["x", "y"]] += rng.normal(0, error, (len(truth), 2))
    size = claimed**2 * rng.uniform(0.8, 1.25, len(truth))
    estimate = estimate.assign(cov_xx=size, cov_xy=0.1 * size, cov_yy=size)
    estimate.loc[::97, ["cov_xx", "cov_xy"]] = 0.0  # singular ones
    estimate = estimate[rng.random(len(truth)) < 0.95]
    truth.to_csv("truth.csv", index=False)
    estimate.to_csv(f"{name}.csv", index=False)


@pytest.mark.parametrize("asked", [GAUSSIAN, ("--with", "nees")])
@pytest.mark.parametrize(("rows", "entries"), [(40, 10**6), (10**6, 60)])
def test_data_in_parts_have_the_numbers_of_files_in_memory(
    invoke: Invoke,
    monkeypatch: pytest.MonkeyPatch,
    asked: tuple[str, ...],
    rows: int,
    entries: int,
) -> None:
    """Sums add up block by block, in the order of time: equal to 1e-12."""
    write_sides("kf", 1.3, 1.0)
    for side in ("truth", "kf"):
        Path(side).mkdir()
        for k, part in pd.read_csv(f"{side}.csv").groupby(lambda row: row % 3):
            part.to_parquet(f"{side}/{k}.parquet")
    monkeypatch.setattr(run, "MOST_ROWS", rows)
    monkeypatch.setattr(run, "MOST_ENTRIES", entries)  # few: as long components
    monkeypatch.setattr(components, "SHARD_ENTRIES", entries)
    assert invoke("truth.csv", "kf.csv", *METRIC, *asked, "-o", "one").status == 0
    answer = invoke("truth", "kf", *METRIC, *asked, "--memory", "200MB", "-o", "many")
    assert answer.status == 0, answer.err
    one, many = (json.loads(Path(name, "result.json").read_text()) for name in ("one", "many"))
    both = [document["nees"] for document in (one, many)]
    sums = [record.pop("sums") for record in both]
    assert [record.pop("verdict") for record in both] == ["overconfident"] * 2
    assert [record.pop("ranks") for record in sums] == [[], []]
    assert both[1] == pytest.approx(both[0], rel=1e-12)
    assert sums[1] == pytest.approx(sums[0], rel=1e-12)
    assert sums[0]["singular"] > 0
    assert one["per_step"][7].keys() == many["per_step"][7].keys()
    assert [w["code"] for w in one["warnings"]] == [w["code"] for w in many["warnings"]]
    assert ("localisation_spread" in many) is (asked == GAUSSIAN)
    for table in ("per_step", "per_truth", "per_estimate", "assignments"):
        path = f"many/{table}" + ("" if table == "assignments" else ".parquet")
        texts = dict.fromkeys(("id", "truth", "estimate"), str)
        expected, found = pd.read_csv(f"one/{table}.csv", dtype=texts), pd.read_parquet(path)
        assert "nees" in expected
        pd.testing.assert_frame_equal(found, expected, rtol=1e-12, atol=0, check_dtype=False)
