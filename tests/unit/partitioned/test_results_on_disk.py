"""A result whose tables are files says what one in memory says."""

import itertools
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.support.partitioned import partitioned
from tgospa_eval import Result, evaluate
from tgospa_eval.errors import InputError
from tgospa_eval.partitioned import tables
from tgospa_eval.partitioned import tables as by_time
from tgospa_eval.results import partitioned as module
from tgospa_eval.results.partitioned import PartitionedResult, StoredTables
from tgospa_eval.results.saved import read_result
from tgospa_eval.show import html, plot_data
from tgospa_eval.show.charts import plot
from tgospa_eval.show.files import save
from tgospa_eval.show.result_text import REPORTS
from tgospa_eval.simulation import Scene, Tracker, simulate

TABLES = ("per_truth", "per_estimate", "switches", "assignments")


@pytest.fixture(scope="module")
def known() -> Result:
    """A scene with switches, misses and false targets; c^p is a power of 2."""
    tracker = Tracker(
        noise=1.0, detection=0.9, swaps=0.2, near=20, false_rate=0.02, fragmentation=0.02
    )
    scene = Scene(scenario="crossing", targets=8, steps=60)
    truth, estimate = simulate(scene, tracker, np.random.default_rng(3))
    return evaluate(truth, estimate, cutoff=8.0, switch_penalty=2.0)


@pytest.fixture(scope="module")
def stored(known: Result, tmp_path_factory: pytest.TempPathFactory) -> PartitionedResult:
    return partitioned(known, tmp_path_factory.mktemp("stored"))


def test_numbers_tables_and_texts_are_those_of_the_result_in_memory(
    known: Result, stored: PartitionedResult
) -> None:
    document = stored.to_dict()
    assert document.pop("tables")["per_step"] == "per_step.parquet"
    assert document == known.to_dict()
    assert len(document["switches"]) > 5
    assert all(document["worst"].values())
    for name in TABLES:
        assert stored.table(name) == known.table(name)
        pd.testing.assert_frame_equal(
            getattr(stored, name), getattr(known, name), check_dtype=False
        )
    assert stored.tables.columns("per_step") == known.table("per_step")
    for form, report in REPORTS.items():
        if form != "json":
            assert report(stored) == report(known)
    assert set(dir(stored)) >= {"per_step", "assignments", "per_truth", "worst"}
    assert html.card(stored) == html.card(known)


def test_what_has_too_many_records_is_named_in_the_json_and_no_more(
    stored: PartitionedResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MOST_RECORDS", 59)
    document = json.loads(stored.to_json())
    assert "per_step" not in document
    assert document["tables"]["assignments"] == "assignments"
    (tmp_path / "result.json").write_text(stored.to_json())
    with pytest.raises(InputError, match="of data in parts, with more steps than a ranking takes"):
        read_result(str(tmp_path / "result.json"))
    monkeypatch.setattr(module, "MOST_RECORDS", 2)
    assert "switches" not in json.loads(stored.to_json())


def test_files_do_not_depend_on_shards_nor_on_what_is_in_memory(
    known: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables, "ROW_GROUP", 32)
    monkeypatch.setattr(by_time, "ROWS_A_PART", 100)
    for name, shards, rows in (("a", 1, 10), ("b", 2, 1), ("c", 5, 1000)):
        monkeypatch.setattr(by_time, "ROWS_AT_ONCE", rows)
        stored = partitioned(known, tmp_path / name, shards)
    files = stored.tables.names()
    assert len(files) > 4 + 2
    for name in files:
        found = {(tmp_path / run / "tables" / name).read_bytes() for run in "abc"}
        assert len(found) == 1, name
    assert stored.worst(3) == known.worst(3)
    assert stored.table("assignments") == known.table("assignments")
    assert stored.first_switches(3) == known.first_switches(3)


def test_tables_that_are_gone_or_damaged_are_said_to_be(known: Result, tmp_path: Path) -> None:
    stored = partitioned(known, tmp_path)
    folder = Path(stored.tables.folder)
    (folder / "per_truth.parquet").unlink()
    with pytest.raises(InputError, match=r"per_truth.parquet: is not there any more"):
        stored.table("per_truth")
    (folder / "switches.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"switches.parquet: cannot be read: "):
        StoredTables(str(folder)).rows("switches")


def test_page_and_pictures_show_means_over_stretches_of_steps(
    stored: PartitionedResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plot_data, "MOST_STRETCHES", 8)
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
    assert "Each bar is the mean of 8 steps" in html.page(stored)
    worst = stored.worst(20)
    assert data["worst"]["t"] == worst["steps"]
    for name, ids in (("truth", worst["truth"]), ("estimate", worst["estimates"])):
        assert data["tracks"][name]["id"] == ids
    figure = plot(stored, "costs")
    assert figure.axes[0].get_xlabel().endswith("; a bar is the mean of 8 steps")
    lines = plot(stored, "cumulative").axes[0].lines
    assert lines[0].get_ydata()[-1] == pytest.approx(curve[lines[0].get_label()][-1])


def test_a_result_without_steps_has_a_page(tmp_path: Path) -> None:
    nothing = evaluate(np.zeros((0, 0, 2)), np.zeros((0, 0, 2)), cutoff=1.0, switch_penalty=1.0)
    stored = partitioned(nothing, tmp_path)
    assert "TGOSPA = 0" in html.page(stored)
    assert stored.to_dict()["worst"] == {"steps": [], "truth": [], "estimates": []}
    save(stored, tmp_path / "saved", force=False)
    assert (tmp_path / "saved" / "assignments" / "part-00000.parquet").is_file()
