"""However a recording lies in files, and whatever fits together: the number of the whole.

The same few cases run always, new ones by ``make fuzz``.
"""

import json
import math
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from answer import Invoke
from examples import examples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tgospa_eval import Trajectories
from tgospa_eval.evaluation import memory
from tgospa_eval.simulation import Scene, Tracker, simulate

PARTS = ("localisation", "missed", "false", "switch")
SCENARIOS = ["crossing", "parallel", "convoy", "dense", "births", "manoeuvring"]


def write(side: Trajectories, folder: Path, files: int, overlapping: int, group: int) -> None:
    """In so many files by time, of which some rows are in the wrong one, in no order."""
    rng = np.random.default_rng(files)
    x, y = side.state.T
    rows = {"id": side.ids[side.track].astype(str), "t": side.times[side.step], "x": x, "y": y}
    table = pa.table(rows)
    home = side.step * files // (len(side.times) + 1)
    moved = rng.integers(0, max(len(home), 1), overlapping if len(home) else 0)
    home[moved] = rng.integers(0, files, len(moved))
    for k in range(files):
        own = table.take(pa.array(rng.permutation(np.flatnonzero(home == k))))
        place = folder / (f"{9 - k}.parquet" if k % 2 else f"part={k}/rows.parquet")
        place.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(own, place, row_group_size=group)


CASES = st.fixed_dictionaries(
    {
        "scenario": st.sampled_from(SCENARIOS),
        "-c": st.sampled_from([3.0, 10.0, 50.0]),
        "-p": st.sampled_from([1.0, 2.0, 3.0]),
        "-g": st.sampled_from([0.0, 1.0, 5.0]),
        "--grid": st.sampled_from(["union", "truth", "estimate --outage none"]),
        "layout": st.tuples(
            st.integers(1, 5), st.sampled_from([0, 9]), st.sampled_from([1, 7, 1000])
        ),
        "rows of a block": st.sampled_from([1, 10, 30, 200]),
        "entries of a shard": st.integers(1, 100),
    }
)


@given(seed=st.integers(0, 2**32 - 1), case=CASES)
@settings(
    max_examples=examples(4),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_the_bracket_is_that_of_the_whole(invoke: Invoke, seed: int, case: dict[str, Any]) -> None:
    rng = np.random.default_rng(seed)
    sides = simulate(
        Scene(
            scenario=case["scenario"],
            targets=int(rng.integers(1, 7)),
            steps=int(rng.integers(1, 20)),
            area=float(rng.choice([30, 100, 400])),
        ),
        Tracker(noise=2, detection=0.9, swaps=0.3, near=10, fragmentation=0.05, false_rate=0.2),
        rng,
    )
    asked = [word for name in ("-c", "-p", "-g") for word in (name, str(case[name]))]
    if rng.random() < 0.3:
        asked += ["--steps=-5:40:2.5"]
        sides = sides[0], replace(sides[1], times=sides[1].times + 0.5)
    else:
        asked += ["--grid", *case["--grid"].split()]
    asked += ["--jobs", "1", "--format", "json", "-q"]
    work = Path(tempfile.mkdtemp())
    try:
        paths = str(work / "truth"), str(work / "estimate")
        single = str(work / "truth.parquet"), str(work / "estimate.parquet")
        for side, folder, file in zip(sides, paths, single, strict=True):
            write(side, Path(folder), *case["layout"])
            write(side, work / "whole", 1, 0, 1000)
            shutil.move(work / "whole" / "part=0" / "rows.parquet", file)
        whole = invoke(*single, *asked)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(memory, "MAX_ROWS", case["rows of a block"])
            patch.setattr(memory, "SHARD_ENTRIES", case["entries of a shard"])
            parts = invoke(*paths, *asked)
    finally:
        shutil.rmtree(work)
    assert parts.status == whole.status, parts.err
    if whole.status:  # nothing to evaluate, say
        assert parts.err.splitlines()[-1].split(": ")[-1] in whole.err
        return
    one, other = json.loads(whole.out), json.loads(parts.out)
    for name in ("sizes", "parameters", "judged", "input"):
        assert other[name] == one[name], name
    lower, upper = other["lower_bound"], other["upper_bound"]
    assert lower <= one["upper_bound"]
    assert upper >= one["lower_bound"]
    assert math.isclose(other["tgospa"], one["tgospa"], rel_tol=1e-9)
    for costs in (one, other):
        by_step = math.fsum(sum(step[part] for part in PARTS) for step in costs["per_step"])
        assert math.isclose(by_step, costs["total"], rel_tol=1e-9, abs_tol=1e-9)
