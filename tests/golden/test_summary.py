"""The summary of tracking: by a script that knows the tables alone, and by Stone Soup."""

import csv
import datetime
import io
import itertools
import json
import math
import statistics
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Run
from examples import seeds

from tgospa_eval import Result, Trajectories, evaluate
from tgospa_eval.results.summary import flat


def scene(seed: int, *, gaps: int = 2, swaps: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Truth and estimate (30, n, 2): lost for four steps, exchanged, begun late, and false."""
    rng = np.random.default_rng(seed)
    n, steps = 5, 30
    truth = np.cumsum(rng.normal(0, 1, (n, steps, 2)), 1) + rng.uniform(0, 90, (n, 1, 2))
    estimate = truth + rng.normal(0, 0.7, truth.shape)
    for k in range(n):
        for begin in rng.integers(3, steps - 8, gaps):
            estimate[k, begin : begin + 4] = np.nan
    for k in range(n - 1) if swaps else ():
        at = rng.integers(8, steps - 5)
        estimate[[k, k + 1], at:] = estimate[[k + 1, k], at:]
    false = rng.uniform(200, 230, (2, steps, 2))
    false[:, :10] = np.nan
    truth[0, :4] = truth[1, 25:] = np.nan
    return truth.transpose(1, 0, 2), np.concatenate([estimate, false]).transpose(1, 0, 2)


def judged(seed: int, **about: Any) -> tuple[np.ndarray, np.ndarray, Result]:
    """A scene and its result."""
    truth, estimate = scene(seed, **about)
    return truth, estimate, evaluate(truth, estimate, cutoff=5, switch_penalty=1.5)


@pytest.mark.parametrize("seed", seeds(7, 20))
def test_by_a_script_that_knows_the_assignments(seed: int) -> None:
    truth, estimate, result = judged(seed)
    rows = list(result.assignments.itertuples())
    assert {row.weight for row in rows} == {1.0}
    exists = {
        side: {str(k): np.flatnonzero(~np.isnan(states[:, k, 0])).tolist() for k in range(n)}
        for side, states, n in (("truth", truth, 5), ("estimate", estimate, 7))
    }
    who: dict[str, dict[int, str]] = defaultdict(dict)
    for row in rows:
        who[row.truth][row.t] = row.estimate
    errors = sorted(row.distance for row in rows)
    number, truths = len(rows), sum(map(len, exists["truth"].values()))
    estimates = sum(map(len, exists["estimate"].values()))
    pairs: dict[tuple[str, str], int] = defaultdict(int)
    for row in rows:
        pairs[row.truth, row.estimate] += 1

    def best(side: int) -> int:
        most: dict[str, int] = defaultdict(int)
        for pair, count in pairs.items():
            most[pair[side]] = max(most[pair[side]], count)
        return sum(most.values())

    fragments = breaks = longest = 0
    delays, held = [], 0.0
    for name, steps in exists["truth"].items():
        flags = [step in who[name] for step in steps]
        runs = "".join("x" if flag else " " for flag in flags).split()
        fragments += max(len(runs) - 1, 0)
        longest = max([longest, *map(len, runs)])
        delays.append(steps[flags.index(True)] - steps[0])
        for here, after in itertools.pairwise(steps):
            if here in who[name]:
                held += after - here
                breaks += who[name][here] != who[name].get(after)
    shares = [len(who[name]) / len(steps) for name, steps in exists["truth"].items()]
    surplus = (~np.isnan(estimate[..., 0])).sum(1) - (~np.isnan(truth[..., 0])).sum(1)
    difference = np.array([estimate[r.t, int(r.estimate)] - truth[r.t, int(r.truth)] for r in rows])
    along, across, ways, bends = [], [], [], []
    for row, error in zip(rows, difference, strict=True):
        steps = exists["truth"][row.truth]
        k = steps.index(row.t)
        before, after = steps[max(k - 1, 0)], steps[min(k + 1, len(steps) - 1)]
        path = truth[:, int(row.truth)]
        velocity = (path[after] - path[before]) / (after - before)
        unit = velocity / np.hypot(*velocity)
        along.append(error @ unit)
        across.append(error @ [-unit[1], unit[0]])
        ways.append((error @ velocity, velocity @ velocity, error @ error))
        later = [who[row.truth].get(row.t + i) for i in (0, 1, 2)]
        if later == [row.estimate] * 3:
            three = (estimate[row.t : row.t + 3, int(row.estimate)], path[row.t : row.t + 3])
            bends.append([np.sum((x[2] - 2 * x[1] + x[0]) ** 2) for x in three])
    crossed, moved, squared = np.sum(ways, axis=0)
    followers = {row.estimate for row in rows}
    false = [len(steps) for name, steps in exists["estimate"].items() if name not in followers]

    expected = {
        "assigned_states": number,
        "truth_states": truths,
        "estimate_states": estimates,
        "detection_rate": number / truths,
        "precision": number / estimates,
        "rmse": math.sqrt(sum(error**2 for error in errors) / number),
        "mean_error": sum(errors) / number,
        "median_error": statistics.median(errors),
        "p95_error": errors[math.ceil(0.95 * number) - 1],
        "rmse_by_axis": dict(
            zip(("x", "y"), np.sqrt((difference**2).mean(axis=0)).tolist(), strict=True)
        ),
        "rmse_along_track": math.sqrt(np.mean(np.square(along))),
        "rmse_across_track": math.sqrt(np.mean(np.square(across))),
        "latency": {"shift": -crossed / moved, "gain": crossed**2 / moved / squared},
        "mostly_tracked": sum(share >= 0.8 for share in shares),
        "partly_tracked": sum(0.2 <= share < 0.8 for share in shares),
        "mostly_lost": sum(share < 0.2 for share in shares),
        "purity": best(1) / number,
        "completeness": best(0) / truths,
        "fragments": fragments,
        "longest_stretch": longest,
        "switches_per_truth": result.counts["switch"] / 5,
        "never_tracked": 0,
        "time_to_first": sum(delays) / 5,
        "breaks": breaks,
        "mean_time_between_breaks": held / breaks,
        "false_tracks": len(false),
        "false_tracks_per_step": sum(false) / 30,
        "false_track_length": sum(false) / len(false),
        "cardinality_error": surplus.mean(),
        "cardinality_mean_absolute": abs(surplus).mean(),
        "cardinality_rms": math.sqrt((surplus**2).mean()),
        "smoothness": dict(
            zip(("estimate", "truth"), np.sqrt(np.mean(bends, axis=0)).tolist(), strict=True)
        ),
    }
    found = dict(result.summary)
    assert found.pop("tracked_shares") == [0.2, 0.8]
    assert found.pop("unique") in (True, False)
    found.pop("siap")
    for name in ("rmse_by_axis", "latency", "smoothness"):
        assert found.pop(name) == pytest.approx(expected.pop(name), rel=1e-9, abs=1e-12), name
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("seed", [4, 17, 48, 52, 54, 56])  # all pairs last for two steps or more
def test_siap_is_that_of_stone_soup(seed: int) -> None:
    soup = pytest.importorskip("stonesoup.metricgenerator.tracktotruthmetrics")
    from stonesoup.measures import Euclidean
    from stonesoup.metricgenerator.manager import MultiManager
    from stonesoup.types.association import AssociationSet, TimeRangeAssociation
    from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
    from stonesoup.types.state import State
    from stonesoup.types.time import TimeRange
    from stonesoup.types.track import Track

    rng = np.random.default_rng(seed)
    truth, estimate = (
        np.concatenate([states, rng.normal(0, 0.3, states.shape)], axis=2) for states in scene(seed)
    )
    columns = ("x", "y", "vx", "vy")
    sides = (Trajectories.from_array(states, columns) for states in (truth, estimate))
    result = evaluate(*sides, cutoff=5, switch_penalty=1.5)

    def at(step: int) -> datetime.datetime:
        return datetime.datetime(2020, 1, 1) + datetime.timedelta(seconds=int(step))

    def paths(states: np.ndarray, path: Any, state: Any) -> list[Any]:
        return [
            path([
                state(one[:, None], timestamp=at(k))
                for k, one in enumerate(track)
                if not np.isnan(one[0])
            ])
            for track in states.transpose(1, 0, 2)
        ]  # fmt: skip

    truths = paths(truth, GroundTruthPath, GroundTruthState)
    tracks = paths(estimate, Track, State)
    associations = set()
    for (own, other), rows in result.assignments.groupby(["truth", "estimate"]):
        steps = rows["t"].to_numpy()
        for run in np.split(steps, np.flatnonzero(np.diff(steps) != 1) + 1):
            pair = {truths[int(own)], tracks[int(other)]}
            associations.add(TimeRangeAssociation(pair, TimeRange(at(run[0]), at(run[-1]))))
    generator = soup.SIAPMetrics(
        position_measure=Euclidean((0, 1)), velocity_measure=Euclidean((2, 3))
    )
    manager = MultiManager([generator])
    manager.add_data({"groundtruth_paths": set(truths), "tracks": set(tracks)})
    manager.association_set = AssociationSet(associations)
    theirs = manager.generate_metrics()["siap_generator"]
    names = {
        "completeness": "Completeness",
        "ambiguity": "Ambiguity",
        "spuriousness": "Spuriousness",
        "positional_accuracy": "Position Accuracy",
        "velocity_accuracy": "Velocity Accuracy",
        "track_number_change_rate": "Rate of Track Number Change",
        "longest_track_segment": "Longest Track Segment",
    }
    ours = {name: result.summary["siap"][name] for name in names}
    assert ours == pytest.approx(
        {name: theirs[f"SIAP {name_}"].value for name, name_ in names.items()}, abs=1e-12
    )


def test_a_late_tracker_is_late() -> None:
    time = np.arange(40.0)
    path = np.stack([3 * time, np.sin(time / 8)], axis=1)[:, None]
    late = np.stack([3 * (time - 0.5), np.sin((time - 0.5) / 8)], axis=1)[:, None]
    latency = evaluate(path, late, cutoff=5).summary["latency"]
    assert latency["shift"] == pytest.approx(0.5, rel=1e-3)
    assert latency["gain"] > 0.999


def test_on_the_earth_axes_are_in_metres() -> None:
    import pandas as pd

    truth = pd.DataFrame({"t": range(5), "id": 1, "lat": 60.0, "lon": np.linspace(10, 10.01, 5)})
    estimate = truth.assign(lat=truth.lat + 1e-4, lon=truth.lon + 1e-4)
    summary = evaluate(truth, estimate, cutoff=100, distance="haversine").summary
    assert summary["rmse_by_axis"] == pytest.approx({"east": 5.56, "north": 11.12}, abs=0.01)
    assert summary["rmse_along_track"] == pytest.approx(5.56, abs=0.01)
    assert summary["rmse"] == pytest.approx(math.hypot(5.56, 11.12), abs=0.02)


def test_nothing_is_nothing() -> None:
    """Undefined numbers are None, and no number is made up."""
    summary = evaluate(np.zeros((3, 1, 2)), np.zeros((3, 0, 2)), cutoff=1).summary
    assert summary["detection_rate"] == 0
    assert summary["never_tracked"] == 1
    for name in ("precision", "rmse", "latency", "purity", "time_to_first", "smoothness"):
        assert summary[name] is None, name


def test_classes_are_counted_together(invoke: Run, tmp_path: Path) -> None:
    lines = {"t.csv": "", "e.csv": ""}
    for name in ("car", "bus"):
        for k in range(6):
            lines["t.csv"] += f"{k},{name},{name},{k},{10 * (name == 'bus')}\n"
            if name == "bus" or k < 3:
                lines["e.csv"] += f"{k},{name}1,{name},{k}.5,{10 * (name == 'bus')}\n"
    paths = []
    for file, text in lines.items():
        (tmp_path / file).write_text("t,id,class,x,y\n" + text, encoding="utf-8")
        paths.append(str(tmp_path / file))
    done = invoke(*paths, "-c", "2", "-g", "1", "--by", "class", "--format", "json")
    document = json.loads(done.out)
    whole = json.loads(invoke(*paths, "-c", "2", "-g", "1", "--format", "json").out)
    assert document["summary"] == whole["summary"]
    assert document["by_class"]["bus"]["summary"]["detection_rate"] == 1
    assert document["headline"].startswith("75 % of 12 object-steps followed, RMS error 0.5")


def test_numbers_of_data_in_parts(invoke: Run, tmp_path: Path) -> None:
    """Those that sums tell are the same, the others are not there."""
    truth, estimate = scene(3)
    paths = []
    for name, states in (("t", truth), ("e", estimate)):
        lines = [
            f"{t},{k},{x},{y}"
            for t, row in enumerate(states)
            for k, (x, y) in enumerate(row)
            if not math.isnan(x)
        ]
        (tmp_path / name).mkdir()
        text = "\n".join(["t,id,x,y", *lines]) + "\n"
        (tmp_path / name / "part.csv").write_text(text, encoding="utf-8")
        paths.append(str(tmp_path / name))
    options = ("-c", "5", "-g", "1.5", "--format", "json")
    files = (f"{path}/part.csv" for path in paths)
    whole = json.loads(invoke(*files, *options).out)["summary"]
    parts = json.loads(invoke(*paths, *options, "--memory", "1GB", "-o", str(tmp_path / "o")).out)
    assert parts["summary"]["unique"] is None
    for name, value in parts["summary"].items():
        if name == "siap":
            assert value == pytest.approx({key: whole["siap"][key] for key in value})
        elif name != "unique":
            assert value == pytest.approx(whole[name]), name
    assert {"rmse", "detection_rate", "false_tracks", "mostly_tracked"} <= parts["summary"].keys()


def test_rules_of_a_gate(invoke: Run, tmp_path: Path) -> None:
    truth, estimate = scene(1)
    worse = estimate.copy()
    worse[20:, 2] = np.nan
    for name, states in (("t", truth), ("e", estimate), ("w", worse)):
        np.save(tmp_path / f"{name}.npy", states)
    t, e, w = (str(tmp_path / f"{name}.npy") for name in "tew")
    base = ("--baseline", str(tmp_path / "b.json"), "-c", "5", "-g", "1.5")
    rule = ("--fail-on", "summary.detection_rate:-0.01")
    assert invoke("gate", t, e, *base, "--update-baseline").status == 0
    assert invoke("gate", t, e, *base, *rule).status == 0
    done = invoke("gate", t, w, *base, *rule)
    assert done.status == 1
    assert "summary.detection_rate is" in done.out
    assert (
        invoke("gate", t, e, "-c", "5", "-g", "1.5", "--fail-on", "summary.rmse:..0.1").status == 1
    )
    wrong = invoke("gate", t, e, *base, "--fail-on", "summary.detection:-0.01")
    assert wrong.status == 2
    assert "summary.detection" in wrong.err
    assert "detection_rate" in wrong.err


def test_rows_of_a_batch_have_it(invoke: Run, tmp_path: Path) -> None:
    truth, estimate = scene(2)
    for name, states in (("t_1.npy", truth), ("e_1.npy", estimate)):
        np.save(tmp_path / name, states)
    sides = (f"--{side}={tmp_path}/{side[0]}_{{run}}.npy" for side in ("truth", "estimate"))
    done = invoke(
        "batch", *sides, "-c", "5", "-g", "1.5", "--format", "csv", "-o", str(tmp_path / "store")
    )
    assert done.status == 0
    (row,) = csv.DictReader(io.StringIO(done.out))
    summary = evaluate(truth, estimate, cutoff=5, switch_penalty=1.5).summary
    assert float(row["summary.rmse"]) == pytest.approx(summary["rmse"])
    completeness = float(row["summary.siap.completeness"])
    assert completeness == pytest.approx(summary["siap"]["completeness"])


def test_thresholds_are_options() -> None:
    truth, estimate = scene(1)
    options: dict[str, Any] = {"cutoff": 5, "tracked_shares": "0.5:0.99"}
    summary = evaluate(truth, estimate, **options).summary
    assert summary["mostly_tracked"] == 0
    assert summary["tracked_shares"] == [0.5, 0.99]
    with pytest.raises(Exception, match="tracked_shares is"):
        evaluate(truth, estimate, tracked_shares="0.9:0.1")


def test_means_per_step_are_over_all_evaluated_steps(tmp_path: Path) -> None:
    """The truth has two steps, the estimate five, and they have five together."""
    false = [(8, 2, 50, 2), (8, 4, 3, 4), (9, 2, 60, 2)]
    sides = [(1, 0, 0, 0), (1, 4, 0, 4)], [(7, t, 1.0 * (t == 0), t) for t in range(4)] + false
    files = [tmp_path / name / "rows.parquet" for name in ("truth", "estimate")]
    for path, rows in zip(files, sides, strict=True):
        path.parent.mkdir()
        pd.DataFrame(rows, columns=["id", "t", "x", "y"]).to_parquet(path)
    whole = evaluate(*files, 10.0, 2, 5.0).summary
    parts = evaluate(*(path.parent for path in files), 10.0, 2, 5.0).summary
    assert whole["median_error"] == 2  # of the errors 1 and 3
    for summary in (whole, parts):  # differences 0, 1, 3, 1, 0
        assert summary["cardinality_error"] == summary["cardinality_mean_absolute"] == 1
        assert summary["cardinality_rms"] == pytest.approx(math.sqrt(11 / 5))
        assert summary["false_tracks_per_step"] == 1 / 5


def test_states_are_read_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same numbers, second differences across the ends of pieces included."""
    truth, estimate, whole = judged(5)
    monkeypatch.setattr("tgospa_eval.evaluation.summary.PAIRS_TOGETHER", 7)
    pieces = evaluate(truth, estimate, cutoff=5, switch_penalty=1.5)
    assert dict(flat(pieces.summary)) == pytest.approx(dict(flat(whole.summary)), rel=1e-12)


def test_mixed_assignments_count_by_their_weights() -> None:
    rng = np.random.default_rng(4)
    truth = np.abs(rng.uniform(0, 15, (1, 25, 2)) + rng.normal(0, 1, (12, 25, 2)).cumsum(0)) % 15
    estimate = truth + rng.normal(0, 2, truth.shape)
    result = evaluate(truth, estimate, 5.0, 2, 2.0)
    pairs, summary = result.assignments, result.summary
    assert (pairs["weight"] < 1).any()
    total = pairs["weight"].sum()
    assert summary["detection_rate"] == pytest.approx(total / 300)
    by_pair = pairs.groupby(["truth", "estimate"])["weight"].sum()
    for name, side, size in (("purity", "estimate", total), ("completeness", "truth", 300)):
        assert summary[name] == pytest.approx(by_pair.groupby(side).max().sum() / size)
    order = np.argsort(pairs["distance"].to_numpy(), kind="stable")
    up_to = pairs["weight"].to_numpy()[order].cumsum()
    middle = np.searchsorted(up_to, total / 2 + np.array([-1e-9, 1e-9]))
    assert summary["median_error"] == pairs["distance"].to_numpy()[order][middle].mean()
    held = pairs.groupby(["truth", "t"])["weight"].sum() > 0.5 - 1e-9
    flags = held.unstack(fill_value=False).reindex(columns=range(12), fill_value=False)
    runs = ("".join("x" if flag else " " for flag in row).split() for row in flags.to_numpy())
    assert summary["fragments"] == sum(max(len(run) - 1, 0) for run in runs)
