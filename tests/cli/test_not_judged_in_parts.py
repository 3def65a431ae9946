"""What is not judged, of data in parts: the numbers of one file, whatever says it."""

import json
import math
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from answer import Invoke
from examples import examples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from partitioned import without_summary

from tgospa_eval import SolverError
from tgospa_eval.evaluation import memory
from tgospa_eval.partitioned import run
from tgospa_eval.simulation import Scene, Tracker, simulate

METRIC = ("-c", "8", "-g", "3", "--jobs", "1", "-q")
REGIONS = "t,x,y,radius\n,40,40,15\n12,60,60,40\n13,60,60,40\n"
BOXES = "t,left,top,width,height\n,20,0,40,90\n9,0,0,100,100\n"
TABLES = ("per_step", "per_truth", "per_estimate", "switches", "assignments")
SAME = ("judged", "metric", "parameters", "sizes")


def recording(seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Objects of three classes, some hidden or marked, at some steps of no truth, with gaps."""
    rng = np.random.default_rng(seed)
    tracker = Tracker(noise=1.5, detection=0.9, swaps=0.3, near=10, false_rate=0.4)
    tables = []
    for side in simulate(Scene(scenario="crossing", targets=8, steps=40, area=100), tracker, rng):
        x, y = side.state.T.round(3)
        rows = {"id": side.ids[side.track], "t": side.times[side.step], "x": x, "y": y}
        tables.append(pd.DataFrame(rows))
    truth, estimate = tables
    truth["class"] = truth["id"].map(
        {name: ["Car", "Van", "Bus"][k % 3] for k, name in enumerate(truth["id"].unique())}
    )
    truth["occlusion"] = rng.choice([0, 1, 2, np.nan], len(truth))
    truth["ignored"] = (rng.random(len(truth)) < 0.2).astype(int)
    estimate["excused"] = (rng.random(len(estimate)) < 0.3).astype(int)
    gap = truth["id"].isin(truth["id"].unique()[:3]) & truth["t"].between(10, 25)
    return truth[~gap & (truth["t"] % 9 != 5)], estimate


def write(sides: tuple[pd.DataFrame, pd.DataFrame], folder: Path, parts: int = 3) -> None:
    """As files, and as folders of parts, which overlap in time a little."""
    for name, table in zip(("truth", "estimate"), sides, strict=True):
        table.to_csv(folder / f"{name}.csv", index=False)
        (folder / name).mkdir()
        home = (table["t"] * parts // (table["t"].max() + 1) + (table["x"] > 90)) % parts
        for part, rows in table.groupby(home):
            rows.to_csv(folder / name / f"{part}.csv", index=False)


@contextmanager
def small(rows: int, shard: int) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(memory, "MAX_ROWS", rows)
        patch.setattr(memory, "SHARD_ENTRIES", shard)
        yield


def both(
    invoke: Invoke, folder: Path, *asked: str, sizes: tuple[int, int] = (30, 25)
) -> tuple[Any, Any]:
    """The documents of one file a side and of parts; numbers that must be the same are."""
    names = ("truth", "estimate")
    files, parts = ([str(folder / f"{name}{end}") for name in names] for end in (".csv", ""))
    whole = invoke(*files, *METRIC, *asked, "-o", str(folder / "whole"), "--pictures", "none")
    assert whole.status == 0, whole.err
    out = folder / "-".join(map(str, sizes))
    with small(*sizes):
        given_parts = (*parts, *METRIC, *asked, "--memory", "400MB", "-o", str(out))
        answer = invoke(*given_parts, "--pictures", "none")
    assert answer.status == 0, answer.err
    one, other = (json.loads((at / "result.json").read_text()) for at in (folder / "whole", out))
    assert {name: one.get(name) for name in SAME} == {name: other.get(name) for name in SAME}
    assert other["lower_bound"] <= one["upper_bound"]
    assert other["upper_bound"] >= one["lower_bound"]
    for name in ("truth_states", "excused"):  # what is absorbed may differ: some optima are many
        assert other["ignored"][name] == one["ignored"][name]
    for role in names:
        assert other["input"][role] == one["input"][role]
    assert math.isclose(other["total"], one["total"], rel_tol=1e-9)
    return one, other


RULES = {
    "class": ("--ignore", "class=van,Bus"),
    "filtered class": ("--ignore", "class=van", "--truth-class", "Car"),
    "number": ("--ignore", "occlusion>1"),
    "values": ("--ignore", "occlusion=1,2", "--ignore", "x<30"),
    "marked": ("--ignore", "marked"),
    "both marked": ("--ignore", "marked,marked-estimates"),
    "outside": ("--ignore", "outside-truth-steps,class=Bus"),
    "steps": ("--ignore", "outside-truth-steps,marked-estimates", "--steps", "0:40:0.5"),
    "circles": ("--ignore-regions", "circles.csv", "--ignore", "class=Van"),
    "boxes": ("--ignore-regions", "boxes.csv"),
}


@pytest.mark.parametrize("rule", RULES)
def test_parts_have_the_numbers_and_tables_of_one_file(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rule: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("circles.csv").write_text(REGIONS, encoding="utf-8")
    Path("boxes.csv").write_text(BOXES, encoding="utf-8")
    write(recording(3), tmp_path)
    one, other = both(invoke, tmp_path, *RULES[rule])
    assert other["ignored"] == one["ignored"]
    assert sum(one["ignored"].values()) > 0
    for name in TABLES:
        place = "30-25" + ("/assignments" if name == "assignments" else f"/{name}.parquet")
        table = without_summary(pd.read_csv(f"whole/{name}.csv"))
        stored = pd.read_parquet(place)
        assert [*table] == [*stored], name
        for column in table:
            if table[column].dtype.kind in "fi" and column not in ("id", "truth", "estimate"):
                found = stored[column].astype(float)
                np.testing.assert_allclose(found, table[column], rtol=1e-9, atol=1e-9)
            else:
                mine, theirs = (one[column].fillna("").astype(str) for one in (stored, table))
                assert [*mine] == [*theirs], (name, column)


@given(
    seed=st.integers(0, 2**32 - 1),
    rule=st.sampled_from(["both marked", "number"]),
    metric=st.tuples(
        st.sampled_from([3.0, 20.0]), st.sampled_from([1, 2]), st.sampled_from([0.5, 0.2])
    ),
    sizes=st.tuples(st.sampled_from([10, 30, 300]), st.integers(1, 60)),
)
@settings(
    max_examples=examples(2),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_any_parts(
    invoke: Invoke,
    seed: int,
    rule: str,
    metric: tuple[float, int, float],
    sizes: tuple[int, int],
) -> None:
    folder = Path(tempfile.mkdtemp())
    try:
        write(recording(seed), folder, parts=1 + seed % 4)
        asked = [
            f"--{name}={value}"
            for name, value in zip(("cutoff", "order", "rho"), metric, strict=True)
        ]
        both(invoke, folder, *RULES[rule], *asked, sizes=sizes)
    finally:
        shutil.rmtree(folder)


def test_what_cannot_be_compared_alike_is_refused(invoke: Invoke, tmp_path: Path) -> None:
    truth, estimate = recording(3)
    truth = truth.sort_values("t").assign(kind=np.where(truth["t"].sort_values() < 20, "1", "far"))
    write((truth, estimate), tmp_path)
    folders = str(tmp_path / "truth"), str(tmp_path / "estimate")
    with small(30, 25):
        answer = invoke(*folders, *METRIC, "--memory", "400MB", "--ignore", "kind=far")
    assert answer.status == 3
    assert 'truth, column "kind": some parts have only numbers and some have texts' in answer.err
    assert len(answer.err.splitlines()) == 1


def test_faults_and_rules_that_fit_nothing_are_told_as_of_one_file(
    invoke: Invoke, tmp_path: Path
) -> None:
    truth, estimate = recording(3)
    write((truth.assign(wrong="perhaps"), estimate.drop(columns="excused")), tmp_path)
    sides = [
        (str(tmp_path / f"truth{end}"), str(tmp_path / f"estimate{end}")) for end in (".csv", "")
    ]
    for asked in (
        ("--ignore", "colour=red"),
        ("--ignore", "occlusion=far"),
        ("--ignore", "wrong>1"),
        ("--ignore", "class=Tram"),
        ("--ignore", "occlusion>7"),
        ("--ignore", "marked-estimates"),
    ):
        one, other = (
            invoke(*pair, *METRIC[:-1], *asked, "--memory", "400MB", "--max-input", "0")
            if pair[0].endswith(".csv")
            else invoke(*pair, *METRIC[:-1], *asked, "--memory", "400MB")
            for pair in sides
        )
        assert one.status == other.status
        told = [line for line in one.err.splitlines() if asked[1] in line or one.status]
        for line in told:
            assert line.replace(".csv", "") in other.err, asked


def test_other_regions_under_the_same_name_are_another_evaluation(
    invoke: Invoke, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(recording(3), tmp_path)
    regions = tmp_path / "regions.csv"
    regions.write_text(REGIONS, encoding="utf-8")
    folders = str(tmp_path / "truth"), str(tmp_path / "estimate")
    asked = (*METRIC, "--memory", "400MB", "--ignore-regions", str(regions))
    asked = (*asked, "-o", str(tmp_path / "out"))

    def broken_off(*args: object, **more: object) -> None:
        raise SolverError("broken off")

    with monkeypatch.context() as patch:
        patch.setattr(run, "solve_shard", broken_off)
        assert "broken off" in invoke(*folders, *asked).err
    regions.write_text(BOXES, encoding="utf-8")
    answer = invoke(*folders, *asked)
    assert answer.status == 2
    assert "ignore-regions was " in answer.err
