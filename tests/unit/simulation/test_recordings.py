"""Recordings of any length: the same size at every step, tracks whole over the seams, and files."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import (
    AIS,
    CITY,
    GRAIN,
    RECORDINGS,
    Layout,
    RecordingKind,
    hold_tracks,
    simulate_recording,
    write_recording,
)

from tgospa_eval import evaluate
from tgospa_eval.simulation import Tracker

SMALL = {
    "ais": replace(AIS, targets=40, lifetimes=(3, 30)),
    "city": replace(CITY, targets=30, lifetimes=(5, 60)),
}


COLUMNS = ("t", "id", "x", "y")
SWAPS = {"swaps": 0.5, "near": 5.0}


def tables(
    kind: RecordingKind, steps: int, stretch: int, seed: int = 0
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Both sides of a recording, its stretches one after another."""
    layout = Layout(steps=steps, stretch=stretch, part=stretch)
    stretches = list(simulate_recording(kind, layout, np.random.default_rng(seed)))
    truth, estimate = (
        pd.DataFrame({c: np.concatenate([rows[c] for rows in side]) for c in COLUMNS})
        for side in zip(*stretches, strict=True)
    )
    return truth, estimate


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_layout_has_all_rows_in_whole_steps(name: str) -> None:
    kind = RECORDINGS[name]
    for rows in (1, kind.targets, kind.targets + 1, 10**6, 10**8):
        layout = Layout.of(kind, rows)
        assert (layout.steps - 1) * kind.targets < rows <= layout.steps * kind.targets
        assert layout.part % layout.stretch == 0
        assert layout.parts >= min(4, layout.steps)
        # Memory does not grow with the recording: not what is made at once, nor what a file holds.
        assert layout.stretch * kind.targets <= 2**16
        assert layout.part * kind.targets <= 2**19


@pytest.mark.parametrize("name", RECORDINGS)
@pytest.mark.parametrize("stretch", [3, 90])
def test_truths_live_once_and_are_as_many_at_every_step(name: str, stretch: int) -> None:
    """Also where a target is born and dies within a stretch."""
    kind = SMALL[name]
    truth, estimate = tables(kind, 400, stretch)
    assert (truth.groupby("t").size() == kind.targets).all()
    assert truth.t.iloc[[0, -1]].tolist() == [1, 400]
    for side in (truth, estimate):
        order = side.sort_values(["t", "id"], kind="stable").index
        assert (order == side.index).all()
        assert not side.duplicated(["t", "id"]).any()
        assert (side[["x", "y"]] * GRAIN % 1 == 0).all(axis=None)
    lives = truth.groupby("id").t.agg(["min", "max", "size"])
    assert (lives["max"] - lives["min"] + 1 == lives["size"]).all()
    whole = lives[(lives["min"] > 1) & (lives["max"] < 400)]["size"]
    assert whole.between(*kind.lifetimes).all()
    # Log-uniform lifetimes of many: those of the first step must fit in.
    least, most = kind.lifetimes
    mean = (most + 1 - least) / np.log((most + 1) / least)
    assert len(lives) == pytest.approx(kind.targets + 399 * kind.targets / mean, rel=0.1)
    speed = truth.groupby("id")[["x", "y"]].diff().dropna()
    assert np.hypot(speed.x, speed.y).max() < (1.1 * 130 if name == "ais" else 12 + 6)


def test_cars_keep_to_the_streets_of_their_square() -> None:
    truth, _ = tables(SMALL["city"], 300, 50)
    assert truth.x.between(0, 1000).all()
    assert truth.y.between(0, 1000).all()
    off = np.abs((truth[["x", "y"]] + 50) % 100 - 50).min(axis=1)
    assert (off <= 3).all()
    moved = np.sign(truth.groupby("id")[["x", "y"]].agg(np.ptp) - 7)
    assert (moved == 1).all(axis=1).mean() > 0.3  # of those that turned somewhere


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_tracker_without_errors_costs_nothing(name: str) -> None:
    kind = replace(SMALL[name], tracker=Tracker())
    truth, estimate = tables(kind, 60, 9)
    assert truth[["t", "x", "y"]].equals(estimate[["t", "x", "y"]])
    assert truth.groupby("id").size().tolist() == estimate.groupby("id").size().tolist()


def _meeting(**errors: Any) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Many cars on few streets, with some errors alone."""
    kind = replace(SMALL["city"], motion=replace(CITY.motion, blocks=2), area=200.0)
    return tables(replace(kind, tracker=Tracker(**errors)), 300, 16)


def test_swaps_exchange_tracks_and_change_no_place() -> None:
    truth, estimate = _meeting(**SWAPS)
    both = truth.merge(estimate, on=["t", "x", "y"], suffixes=("", "_of_estimate"))
    both = both.drop_duplicates(["t", "id"])
    assert len(truth) == len(estimate)
    changed = both.sort_values(["id", "t"]).groupby("id").id_of_estimate.nunique()
    assert (changed > 1).mean() > 0.3
    # A track that was of one target is of another from one step to the next.
    assert estimate.groupby("t").id.nunique().eq(30).all()


def test_losses_are_silent_for_three_steps_and_go_on_under_a_new_number() -> None:
    errors = Tracker(fragmentation=0.03, lost=3)
    truth, estimate = tables(replace(SMALL["ais"], tracker=errors), 300, 16)
    tracks = truth.merge(estimate, on=["t", "x", "y"], suffixes=("", "_of_estimate"))
    assert len(tracks) == len(estimate)  # ships are never at one place
    tracks = tracks.sort_values(["id", "t"])
    gap = tracks.groupby("id").t.diff()
    renamed = tracks.groupby("id").id_of_estimate.diff().fillna(0) != 0
    assert gap[renamed].eq(4).all()
    assert gap[~renamed].dropna().eq(1).all()
    assert tracks.groupby("id").t.min().eq(truth.groupby("id").t.min()).all()
    # At each reported step but the first of a track: five standard deviations.
    possible = len(estimate) - estimate.id.nunique()
    ends = tracks.groupby("id").t.max() < truth.groupby("id").t.max()
    losses = renamed.sum() + ends.sum()
    assert abs(losses - 0.03 * possible) < 5 * np.sqrt(0.03 * possible)
    # Whoever is silent takes that along when tracks are exchanged: no more is lost, and no less.
    lost = [len(_meeting(fragmentation=0.03, lost=3, **more)[1]) for more in ({}, SWAPS)]
    assert lost[0] == pytest.approx(lost[1], rel=0.01)


@given(st.integers(0, 2**32 - 1), st.integers(0, 4), st.integers(1, 12))
def test_tracks_of_a_stretch_are_those_of_single_steps(seed: int, silent: int, cut: int) -> None:
    """Against a loop over steps and targets; and a seam anywhere changes nothing."""
    rng = np.random.default_rng(seed)
    detected, lost = rng.random((2, 12, 3)) < np.array([0.8, 0.3])[:, None, None]
    swaps = [(k, *rng.permutation(3)[:2]) for k in np.flatnonzero(rng.random(12) < 0.4)]
    exchanged = np.array(swaps, np.int64).reshape(-1, 3)
    held = np.array([1, 2, 3]), rng.integers(0, 5, 3), 4
    tracks, reported, after = hold_tracks(detected, exchanged, lost, silent, held)

    track, free, fresh = held[0].tolist(), held[1].tolist(), 4
    for step in range(12):
        for at, one, two in swaps:
            if at == step:
                track[one], track[two] = track[two], track[one]
                free[one], free[two] = free[two], free[one]
        for target in range(3):
            if lost[step, target] and free[target] < step:
                track[target], free[target], fresh = fresh, step + silent, fresh + 1
            assert tracks[step, target] == track[target]
            assert reported[step, target] == (detected[step, target] and free[target] <= step)
    assert (after[0].tolist(), after[1].tolist(), after[2]) == (track, free, fresh)

    early = exchanged[:, 0] < cut
    one = hold_tracks(detected[:cut], exchanged[early], lost[:cut], silent, held)
    middle = one[2][0], one[2][1] - cut, one[2][2]
    late = exchanged[~early] - [cut, 0, 0]
    two = hold_tracks(detected[cut:], late, lost[cut:], silent, middle)
    assert np.array_equal(np.concatenate((one[0], two[0])), tracks)
    assert np.array_equal(np.concatenate((one[1], two[1])), reported)
    assert np.array_equal(two[2][0], after[0])


def test_rates_are_those_asked_for() -> None:
    truth, estimate = _meeting(noise=2.0)
    tracks = truth.assign(key=truth.index).merge(estimate, on=["t", "id"])
    assert len(tracks) == len(truth)
    errors = (tracks[["x_x", "y_x"]].to_numpy() - tracks[["x_y", "y_y"]].to_numpy()).ravel()
    assert abs(errors.std() - 2) < 5 * 2 / np.sqrt(2 * len(errors))
    _, missed = _meeting(detection=0.9)
    assert abs(len(missed) - 0.9 * 9000) < 5 * np.sqrt(9000 * 0.09)
    _, false = _meeting(false_rate=0.5, false_length=(4, 6))
    made = false.merge(truth, on=["t", "x", "y"], how="left", indicator=True)
    made = made[made._merge == "left_only"].groupby("id_x").size()
    assert abs(len(made) - 150) < 5 * np.sqrt(150)
    assert made.mode().item() in (4, 5, 6)
    assert made.max() == 6


def test_an_error_leaves_the_draws_of_the_others() -> None:
    one, two = _meeting(detection=0.9), _meeting(detection=0.9, noise=1.0, false_rate=1.0)
    assert one[0].equals(two[0])
    both = one[1].merge(two[1], on="t")
    close = np.hypot(both.x_x - both.x_y, both.y_x - both.y_y) < 6
    assert both[close].groupby(["t", "x_x", "y_x"]).ngroups == len(
        one[1].drop_duplicates(["t", "x", "y"])
    )


def test_parts_are_by_time(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    write_recording(tmp_path / "a", CITY, 9801, seed=3)
    sides = {}
    for side in ("truth", "estimate"):
        paths = sorted((tmp_path / "a" / side).iterdir())
        assert [path.name for path in paths] == [f"part-0000{k}.parquet" for k in range(5)]
        spans = [pd.read_parquet(path).t.agg(["min", "max"]).tolist() for path in paths]
        assert spans == [[1, 4], [5, 8], [9, 12], [13, 16], [17, 20]]
        file = pq.ParquetFile(paths[0])
        assert file.num_row_groups == 2
        assert [str(field.type) for field in file.schema_arrow] == ["int64"] * 2 + ["double"] * 2
        assert file.schema_arrow.names == ["t", "id", "x", "y"]
        sides[side] = pd.concat([pd.read_parquet(path) for path in paths])
    assert len(sides["truth"]) == 10_000
    result = evaluate(sides["truth"], sides["estimate"], cutoff=10, switch_penalty=5)
    assert result.relative_gap < 1e-9
    assert result.tgospa > 0

    write_recording(tmp_path / "b", CITY, 9801, seed=3)  # the same bytes
    files = [
        [path.read_bytes() for path in sorted((tmp_path / name).rglob("*.parquet"))]
        for name in "ab"
    ]
    assert files[0] == files[1]
