"""A result whose tables are files says what one in memory says."""

import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from partitioned import without_summary, write_sides

from tgospa_eval import InputError, Result, evaluate, simulate
from tgospa_eval.results.summary import flat
from tgospa_eval.show import plot_data
from tgospa_eval.show.result_text import REPORTS

TABLES = ("per_truth", "per_estimate", "switches", "assignments")
METRIC = {"cutoff": 8.0, "switch_penalty": 2.0}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A scene with switches, misses and false targets; c^p is a power of 2."""
    sides = simulate(
        scenario="crossing", targets=8, steps=60, seed=3,
        noise=1.0, detection=0.9, swaps=0.2, near=20, false_rate=0.02, fragmentation=0.02,
    )  # fmt: skip
    return write_sides(sides, tmp_path_factory.mktemp("sides"))


@pytest.fixture(scope="module")
def known(folders: tuple[str, str]) -> Result:
    return evaluate(*(f"{folder}.parquet" for folder in folders), **METRIC)


def in_parts(folders: tuple[str, str]) -> Any:
    return evaluate(*folders, **METRIC, memory="400MB", jobs=1)


@pytest.fixture(scope="module")
def stored(folders: tuple[str, str]) -> Any:
    return in_parts(folders)


def test_numbers_tables_and_texts_are_those_of_the_result_in_memory(
    known: Result, stored: Any
) -> None:
    documents = stored.to_dict(), known.to_dict()
    assert documents[0]["tables"]["per_step"] == "per_step.parquet"
    for name in documents[1].keys() - {"timings", "files", "solver", "notices"}:
        one, other = (document[name] for document in documents)
        if name == "summary":  # sums tell some of its numbers
            other = {key: other[key] for key in one} | {"siap": one["siap"], "unique": None}
            one, other = ({**dict(flat(each))} for each in (one, other))
            other = pytest.approx(other, rel=1e-12)
        if name == "normalised":  # bounds are sums in another order, values are the same
            bounds = [key for key in other if key.endswith("_bound")]
            assert [one.pop(key) for key in bounds] == pytest.approx(
                [other.pop(key) for key in bounds], rel=1e-12
            )
        assert one == (pytest.approx(other, 1e-12, 1e-9) if type(other) is float else other), name
    assert len(documents[0]["switches"]) > 5
    assert all(documents[0]["worst"].values())
    for name in TABLES:
        expected = without_summary(getattr(known, name))
        assert stored.table(name) == {key: known.table(name)[key] for key in expected}
        pd.testing.assert_frame_equal(getattr(stored, name), expected, check_dtype=False)
    assert stored.table("per_step") == known.table("per_step")
    silent = [replace(result, notices=()) for result in (stored, known)]
    for report in (*(REPORTS[form] for form in ("markdown", "latex", "csv")), Result._repr_html_):
        one, other = (report(result).splitlines() for result in silent)
        assert {*one} <= {*other}
        assert one[:8] == other[:8]
    assert set(dir(stored)) >= {"per_step", "assignments", "per_truth", "worst"}
    assert stored.worst(3) == known.worst(3)


def test_what_has_too_many_records_is_named_in_the_json_and_no_more(
    stored: Any, invoke: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    most = "tgospa_eval.results.partitioned.MAX_RECORDS"
    monkeypatch.setattr(most, 59)
    document = json.loads(stored.to_json())
    assert "per_step" not in document
    assert document["tables"]["assignments"] == "assignments"
    for name in "ab":
        (tmp_path / f"{name}.json").write_text(stored.to_json())
    answer = invoke("compare", "a.json", "b.json")
    assert "a result of data in parts with too many steps to rank" in answer.err
    monkeypatch.setattr(most, 2)
    assert "switches" not in json.loads(stored.to_json())


def test_files_do_not_depend_on_shards_nor_on_what_is_in_memory(
    folders: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tgospa_eval.partitioned.tables.ROW_GROUP", 32)
    monkeypatch.setattr("tgospa_eval.partitioned.tables.ROWS_A_PART", 100)
    made = []
    for entries, rows in ((1, 10), (40, 1), (10_000, 1000)):
        monkeypatch.setattr("tgospa_eval.evaluation.memory.SHARD_ENTRIES", entries)
        monkeypatch.setattr("tgospa_eval.evaluation.memory.MAX_ROWS", 10 * rows)
        monkeypatch.setattr("tgospa_eval.partitioned.tables.ROWS_AT_ONCE", rows)
        result = in_parts(folders)
        files = (path for path in Path(result.tables.folder).rglob("*") if path.is_file())
        made.append({path.name: path.read_bytes() for path in files})
    assert len(made[0]) > 4 + 2
    assert made[0] == made[1] == made[2]


def test_tables_that_are_gone_or_damaged_are_said_to_be(folders: tuple[str, str]) -> None:
    result = in_parts(folders)
    folder = Path(result.tables.folder)
    (folder / "per_truth.parquet").unlink()
    with pytest.raises(InputError, match=r"per_truth.parquet: no longer exists"):
        result.table("per_truth")
    (folder / "switches.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"switches.parquet: cannot be read: "):
        result.table("switches")


def test_page_and_pictures_show_means_over_stretches_of_steps(
    stored: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plot_data, "MAX_STRETCHES", 8)
    made = plot_data.plot_data(stored)
    data, arrays = made.document, made.arrays
    assert data["together"] == 8
    assert data["times"] == stored.labels.times[::8]
    per_step, curve = stored.table("per_step"), plot_data.curves(stored)
    means_of = ("localisation", "missed", "false", "switch")
    for name in means_of:
        ends = [*range(0, 60, 8), 60]
        means = [np.mean(per_step[name][a:b]) for a, b in itertools.pairwise(ends)]
        assert np.allclose(data["costs"][name], means, rtol=1e-6)
        assert np.allclose(data["curve"][name], [curve[name][b - 1] for b in ends[1:]], rtol=1e-6)
    assert not any(map(len, arrays.values()))
    assert "Each bar is the mean of 8 steps" in stored.to_html()
    worst = stored.worst(20)
    assert data["worst"]["t"] == worst["steps"]
    for name, ids in (("truth", worst["truth"]), ("estimate", worst["estimates"])):
        assert data["tracks"][name]["id"] == ids
    figure = stored.plot_costs()
    assert figure.axes[0].get_xlabel().endswith("; a bar is the mean of 8 steps")
    lines = stored.plot_cumulative().axes[0].lines
    assert lines[0].get_ydata()[-1] == pytest.approx(curve[lines[0].get_label()][-1])


def test_a_result_without_steps_has_a_page(tmp_path: Path) -> None:
    for name in ("truth", "estimate"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.csv").write_text("id,t,x,y\n")
    stored = in_parts((str(tmp_path / "truth"), str(tmp_path / "estimate")))
    assert "TGOSPA = 0" in stored.to_html()
    assert stored.to_dict()["worst"] == {"steps": [], "truth": [], "estimates": []}
    stored.save(tmp_path / "saved")
    assert (tmp_path / "saved" / "assignments" / "part-00000.parquet").is_file()
