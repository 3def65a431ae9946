"""Digests of sides: of everything that changes the number, and of nothing else."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Invoke, Write

from tgospa_eval import ConfigError, SolverError, Trajectories, compare, evaluate, gate
from tgospa_eval.campaign.row import same_data
from tgospa_eval.common.interval import Interval
from tgospa_eval.tracks.clouds import Clouds
from tgospa_eval.tracks.coverage import NOT_COUNTED, digest, marked

Change = Callable[[Trajectories], Trajectories]

POINTS = Trajectories(
    step=np.array([0, 0, 1, 2]),
    track=np.array([0, 1, 0, 1]),
    state=np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0], [6.0, 7.0]]),
    ids=np.array(["a", "b"], dtype=object),
    times=np.array([0.0, 0.5, 1.0]),
    columns=("x", "y"),
    attributes={"existence": np.array([1.0, 0.5, 1.0, 0.25]), "class": np.array([*"ccdd"], object)},
)
LAWS = dataclasses.replace(POINTS, covariance=np.tile([1.0, 0.0, 1.0], (4, 1)))
CLOUDS = POINTS.with_clouds(
    Clouds(
        points=np.arange(16.0).reshape(8, 2),
        weights=np.tile([0.25, 0.75], 4),
        first=np.array([0, 2, 4, 6, 8]),
    )
)


def changed(**fields: Any) -> Change:
    return lambda side: dataclasses.replace(side, **fields)


def other_cloud(**fields: Any) -> Change:
    return lambda side: side.with_clouds(dataclasses.replace(side.clouds, **fields))


def marking(*rows: int) -> Change:
    return lambda side: marked(side, np.isin(np.arange(len(side.step)), rows))


COUNTS = {
    "step": (POINTS, changed(step=np.array([0, 0, 1, 1]), track=np.array([0, 1, 0, 1]))),
    "track": (POINTS, changed(track=np.array([0, 1, 1, 1]))),
    "state": (POINTS, changed(state=POINTS.state + 2.0**-50)),
    "ids": (POINTS, changed(ids=np.array(["a", "c"], dtype=object))),
    "times": (POINTS, changed(times=np.array([0.0, 0.5, 2.0]))),
    "columns": (POINTS, changed(columns=("x", "z"))),
    "covariance": (LAWS, changed(covariance=np.tile([1.0, 0.1, 1.0], (4, 1)))),
    "covariance that is not there": (POINTS, changed(covariance=LAWS.covariance)),
    "clouds: points": (CLOUDS, other_cloud(points=np.arange(16.0).reshape(8, 2) * 2)),
    "clouds: weights": (CLOUDS, other_cloud(weights=np.tile([0.5, 0.5], 4))),
    "clouds: sizes": (
        CLOUDS,
        other_cloud(
            first=np.array([0, 1, 4, 6, 8]), weights=np.array([1.0, *[1 / 3] * 3, *[0.5] * 4])
        ),
    ),
    "clouds that are not there": (POINTS, changed(clouds=CLOUDS.clouds, state=CLOUDS.state)),
    "attributes: not judged": (POINTS, marking(1)),
    "attributes: another not judged": (marking(1)(POINTS), marking(2)),
    "attributes: existence": (POINTS, changed(attributes={"existence": np.ones(4)})),
}
DOES_NOT = {
    "labels": (POINTS, changed(labels=np.array(["0", "half", "1"], object))),
    "clock": (POINTS, changed(clock="local")),  # in the digest of the steps
    "offered": (POINTS, changed(offered=("id", "t"))),
    "attributes: others": (
        POINTS,
        lambda side: dataclasses.replace(
            side, attributes={"existence": side.attributes["existence"], "size": np.ones(4)}
        ),
    ),
    "attributes: nothing is marked": (
        POINTS,
        lambda side: dataclasses.replace(
            side, attributes={**side.attributes, NOT_COUNTED: np.zeros(4)}
        ),
    ),
    "ids: without rows": (POINTS, changed(ids=np.array(["a", "b", "z"], dtype=object))),
    "times: without rows": (POINTS, changed(times=np.array([0.0, 0.5, 1.0, 7.0]))),
    "times: of another type": (
        dataclasses.replace(POINTS, times=np.array([0.0, 1.0, 2.0])),
        changed(times=np.array([0, 1, 2])),
    ),
}


@pytest.mark.parametrize("name", COUNTS)
def test_what_changes_the_number_changes_the_digest(name: str) -> None:
    side, change = COUNTS[name]
    assert digest(change(side), existence=True) != digest(side, existence=True)


@pytest.mark.parametrize("name", DOES_NOT)
def test_what_changes_no_number_does_not(name: str) -> None:
    side, change = DOES_NOT[name]
    assert digest(change(side), existence=True) == digest(side, existence=True)


def test_each_thing_that_can_be_in_a_side_is_tried() -> None:
    tried = {name.partition(":")[0].partition(" that")[0] for name in (*COUNTS, *DOES_NOT)}
    assert tried == {field.name for field in dataclasses.fields(Trajectories)}


def test_digests_of_earlier_versions_hold_where_nothing_is_marked() -> None:
    assert digest(POINTS) == "e0703a57b3f528aa101b92e5f5e372b3ede96da5ff0be7c0cc2bc616d8cc0811"
    assert digest(LAWS) == "81b18230284ad6cb3beefde2333bf6f750fd515b0ea8e130533f13c1789bb4ce"
    assert digest(CLOUDS) == "a62ae3d942efe6ed7758ccdf72ef8c1f918bc0fccf763f87354ffb7229b5cec7"


def test_zeros_have_no_sign() -> None:
    for side in (POINTS, LAWS, CLOUDS):
        fields = {"state": side.state, "times": side.times, "covariance": side.covariance}
        negative = {n: np.where(v == 0, -0.0, v) for n, v in fields.items() if v is not None}
        if side.clouds is not None:
            points = np.where(side.clouds.points == 0, -0.0, side.clouds.points)
            negative["clouds"] = dataclasses.replace(side.clouds, points=points)
        assert digest(dataclasses.replace(side, **negative)) == digest(side)


def test_a_truth_with_a_negative_zero_is_the_same_truth(write: Write, invoke: Invoke) -> None:
    rows = "id,t,x,y\n1,{0},{0},0\n1,0.5,1,{0}\n"
    region, weights = "x,y,radius\n{0},40,1\n", "t,weight\n0,1\n0.5,{0}\n"
    found = []
    for zero in ("0.0", "-0.0"):
        paths = [
            write(f"{zero}{k}.csv", text.format(zero)) for k, text in enumerate((rows, region))
        ]
        step_weights = write(f"{zero}w.csv", weights.format(zero))
        options = ("--ignore-regions", paths[1], "--step-weights", step_weights)
        answer = invoke(paths[0], paths[0], "-c", "3", "-g", "1", *options, "--format", "json")
        assert answer.status == 0, answer.err
        document = json.loads(answer.out)
        found.append([document[name] for name in ("judged", "input", "parameters")])
    assert found[0] == found[1]


TRUTH = "id,t,x,y,ignored\n1,0,0,0,0\n1,1,1,0,0\n"
ROWS = "id,t,x,y,excused\n7,0,0,0,0\n8,1,9,9,{0}\n9,1,20,20,{0}\n"
METRIC = ("-c", "3", "-g", "1")


@pytest.fixture
def sides(write: Write) -> tuple[str, str, str]:
    """A truth, and two estimates that differ in nothing but their marks."""
    return (
        write("truth.csv", TRUTH),
        write("a.csv", ROWS.format(0)),
        write("b.csv", ROWS.format(1)),
    )


def test_marks_of_estimates_count_where_they_are_asked_for(
    sides: tuple[str, str, str], invoke: Invoke
) -> None:
    def evaluated(path: str, rule: str) -> dict[str, Any]:
        document = invoke(sides[0], path, *METRIC, "--ignore", rule, "--format", "json").out
        return dict(json.loads(document))

    unmarked, excused = (evaluated(path, "marked") for path in sides[1:])
    assert unmarked["total"] == excused["total"] == 13.5
    assert unmarked["input"]["estimate"] == excused["input"]["estimate"]
    unmarked, excused = (evaluated(path, "marked-estimates") for path in sides[1:])
    assert (unmarked["total"], excused["total"]) == (13.5, 4.5)
    assert unmarked["input"]["estimate"] != excused["input"]["estimate"]


def test_compare_and_gate_do_not_take_marks_of_estimates(
    sides: tuple[str, str, str], invoke: Invoke, tmp_path: Path
) -> None:
    own = ("--ignore", "marked-estimates")
    answer = invoke("compare", *sides, *METRIC, *own)
    assert answer.status == 2
    assert "compare does not take marks of estimates, or the tracker would choose" in answer.err
    assert len(answer.err.splitlines()) == 1
    for name, path in zip("ab", sides[1:], strict=True):
        assert invoke(sides[0], path, *METRIC, *own, "-o", name, "--pictures", "none").status == 0
    answer = invoke("compare", "a", "b")
    assert answer.status == 2
    assert "compare does not take marks of estimates" in answer.err
    answer = invoke("compare", *sides, *METRIC, "--ignore", "marked")
    assert "Proven to be equal on these files by TGOSPA per step" in answer.out

    judged = (*sides[:2], "--baseline", "base.json")
    answer = invoke("gate", *judged, *METRIC, *own, "--update-baseline")
    assert answer.status == 2
    assert "gate does not take marks of estimates" in answer.err
    assert not Path("base.json").exists()
    assert invoke("gate", *judged, *METRIC, "--update-baseline").status == 0
    answer = invoke("gate", sides[0], sides[2], "--baseline", "base.json", *own)
    assert answer.status == 2
    assert "gate does not take marks of estimates" in answer.out + answer.err
    options: dict[str, Any] = {"cutoff": 3, "switch_penalty": 1, "ignore": "marked-estimates"}
    with pytest.raises(ConfigError, match="gate does not take marks of estimates"):
        gate(sides[0], sides[2], "base.json", **options)
    with pytest.raises(ConfigError, match="compare does not take marks of estimates"):
        compare(sides[0], list(sides[1:]), **options)
    with pytest.raises(ConfigError, match="has no column excused"):
        evaluate(sides[0], pd.read_csv(sides[2]).drop(columns="excused"), **options)


def test_a_batch_does_not_rank_estimates_that_excuse_themselves(
    sides: tuple[str, str, str], write: Write, invoke: Invoke
) -> None:
    rows = "".join(
        f"{sides[0]},{path},{name}\n" for name, path in zip("ab", sides[1:], strict=True)
    )
    manifest = write("manifest.csv", "truth,estimate,tracker\n" + rows)
    for rule, ranked in (("marked-estimates", False), ("marked", True)):
        out = ("-o", rule, "--workers", "1", "--by", "tracker")
        answer = invoke("batch", manifest, *METRIC, "--ignore", rule, *out)
        assert answer.status == 0, answer.err
        assert ("tracker is not ranked: its estimates themselves mark" in answer.out) != ranked


def test_brackets_of_the_same_data_have_a_value_in_common() -> None:
    one, other = ([Interval(lower=low, upper=low + 1)] for low in (0.0, 5.0))
    same, names = (["d"], ["d"]), ("a", "b")
    assert same_data(names, same, (one, one))
    assert not same_data(names, (["d"], ["e"]), (one, other))
    assert not same_data(names, ([""], [""]), (one, other))
    assert not same_data(names, ([], []), ([], []))
    with pytest.raises(SolverError, match='"a" and "b" have the same data, and their brackets'):
        same_data(names, same, (one, other))
    with pytest.raises(SolverError):  # of one run of several
        same_data(names, (["d", "x"], ["d", "y"]), (one * 2, other * 2))
    thin = ([Interval(lower=1.0, upper=1.0)], [Interval(lower=1 + 1e-12, upper=1 + 1e-12)])
    assert same_data(names, same, thin)


CONTRADICTION = "have the same data, and their brackets"


def test_saved_results_that_contradict_each_other_are_refused(
    sides: tuple[str, str, str], invoke: Invoke
) -> None:
    """As if a version had found another value of the same data."""
    for name, path in (("a", sides[1]), ("b", sides[2])):
        assert invoke(sides[0], path, *METRIC, "-o", name, "--pictures", "none").status == 0
    assert "Proven to be equal" in invoke("compare", "a", "b").out
    _make_worse(Path("b", "result.json"))
    answer = invoke("compare", "a", "b")
    assert answer.status == 4
    assert CONTRADICTION in answer.err
    assert len(answer.err.splitlines()) == 1


def _make_worse(path: Path) -> None:
    """Twice the total, and all that follows from it."""
    document = json.loads(path.read_text(encoding="utf-8"))
    for part in (document, *document["per_step"]):
        for name in ("total", "localisation", "missed", "false", "switch"):
            part[name] *= 2
    for name in document["counts"]:
        document["counts"][name] *= 2
    for name in ("tgospa", "lower_bound", "upper_bound"):
        document[name] *= 2**0.5
    document["normalised"]["tgospa"] *= 2**0.5
    path.write_text(json.dumps(document), encoding="utf-8")


def test_a_baseline_that_contradicts_its_own_data_is_an_error(
    sides: tuple[str, str, str], invoke: Invoke
) -> None:
    judged = ("gate", *sides[:2], "--baseline", "base.json")
    assert invoke(*judged, *METRIC, "--update-baseline").status == 0
    assert invoke(*judged).status == 0
    path = Path("base.json")
    document = json.loads(path.read_text(encoding="utf-8"))
    (entry,) = document["pairs"].values()
    for name in ("total", "localisation", "missed", "false", "switch"):
        entry["values"][name] *= 2
    for name in entry["values"]["counts"]:
        entry["values"]["counts"][name] *= 2
    for name in ("tgospa", "lower_bound", "upper_bound"):
        entry["values"][name] *= 2**0.5
    entry["values"]["normalised"]["tgospa"] *= 2**0.5
    path.write_text(json.dumps(document), encoding="utf-8")
    answer = invoke(*judged)
    assert answer.status == 4
    assert CONTRADICTION in answer.err
    del entry["estimate_sha256"]  # of an earlier version
    path.write_text(json.dumps(document), encoding="utf-8")
    assert invoke(*judged).status == 0


def test_a_store_whose_rows_contradict_each_other_is_not_ranked(
    sides: tuple[str, str, str], write: Write, invoke: Invoke
) -> None:
    rows = "".join(
        f"{sides[0]},{path},{name}\n" for name, path in zip("ab", sides[1:], strict=True)
    )
    manifest = write("manifest.csv", "truth,estimate,tracker\n" + rows)
    assert invoke("batch", manifest, *METRIC, "-o", "store", "--workers", "1").status == 0
    assert "1=" in invoke("batch", "report", "store", "--by", "tracker").out
    for path in Path("store", "jobs").glob("*.parquet"):
        table = pd.read_parquet(path)
        worse = table["label.tracker"] == "b"
        costs = ["total", "total_lower", "total_upper", "missed", "false"]
        for name in (*costs, *(column for column in table if column.startswith("counts."))):
            if name in table:
                table.loc[worse, name] *= 2
        for name in ("tgospa", "lower_bound", "upper_bound", "normalised.tgospa"):
            table.loc[worse, name] *= 2**0.5
        table.to_parquet(path)
    answer = invoke("batch", "report", "store", "--by", "tracker")
    assert answer.status == 4
    assert CONTRADICTION in answer.err


def test_options_of_a_job_tell_the_same_tracks_apart(write: Write, invoke: Invoke) -> None:
    """Tracks that are matched in time otherwise have other values: no contradiction."""
    truth = write("t.csv", "id,t,x\n1,0,0\n1,1,0\n")
    estimate = write("e.csv", "id,t,x\n1,0.2,0\n1,1.2,0\n")
    rows = "".join(f"{truth},{estimate},{name},{own}\n" for name, own in (("a", 0.1), ("b", 0.5)))
    manifest = write("manifest.csv", "truth,estimate,tracker,time-tolerance\n" + rows)
    answer = invoke("batch", manifest, *METRIC, "-o", "store", "--workers", "1", "--by", "tracker")
    assert answer.status == 0, answer.err
    assert CONTRADICTION not in answer.err
    assert "1=" not in answer.out
